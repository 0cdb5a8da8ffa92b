"""Validation of an optimised layout in MuJoCo, at the poses of the optimisation and midway between them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from cdpr_sim.core.checks import refuse_unless
from cdpr_sim.core.equilibrium_batch import EquilibriumBatch
from cdpr_sim.core.html_repr import HtmlRepr
from cdpr_sim.core.robot import Robot
from cdpr_sim.core.robot_batch import RobotBatch
from cdpr_sim.crosscheck.compare import Verdict, compare_many
from cdpr_sim.design.layout_equilibria import Cases, LayoutEquilibria
from cdpr_sim.design.layout_result import PROMISE, LayoutResult
from cdpr_sim.design.objectives import OBJECTIVES, Objective
from cdpr_sim.physics.settle import settle_many
from cdpr_sim.statics.newton import solve_many

WATCHED = "worst tilt", "worst deviation", "most slack cables"
"""Objectives that a better layout may worsen: reported, whatever was optimised."""

NOTED = 0.01
"""Smallest worsening that is reported: as a share, and in the objective's unit; one of slack cables."""

WORSE = "(worse)"
"""End of a printed figure of merit that is worse than before."""


@dataclass(frozen=True, eq=False)
class ValidatedRobot:
    """One robot at all poses, by both methods.

    Attributes:
        robot: the robot.
        solved: by statics, (rows,).
        settled: by MuJoCo, (rows,).
        errors: largest differences, by the names of ``Agreement``, without ``neutral`` rows; nan if no other row has an
            equilibrium by both methods.
        agrees: (rows,) whether the two methods agree.
        neutral: number of rows where they agree except in directions without stiffness, in which poses may differ.
        score: objective in MuJoCo [SI]; nan if MuJoCo did not settle at every pose.
        each: (rows,) the objective's ``quantity`` in MuJoCo [SI], nan where it did not settle; the deviation for an
            objective without one.
        watched: objectives of ``WATCHED`` in MuJoCo, by name.
    """

    robot: Robot
    solved: EquilibriumBatch
    settled: EquilibriumBatch
    errors: dict[str, float]
    agrees: Bool[np.ndarray, " rows"]
    neutral: int
    score: float
    each: Float[np.ndarray, " rows"]
    watched: dict[str, float]


@dataclass(frozen=True, eq=False)
class LayoutValidation(HtmlRepr):
    """Both layouts settled in MuJoCo, at the poses of the optimisation and midway between them.

    Attributes:
        layout: the optimised layout.
        cases: the poses at twice the resolution, under every load and with every stiffness.
        before, after: the given robot, and the robot with the optimised layout.
    """

    layout: LayoutResult
    cases: Cases
    before: ValidatedRobot
    after: ValidatedRobot

    @property
    def agrees(self) -> bool:
        """Whether MuJoCo and statics agree on the optimised layout at every pose."""
        return bool(self.after.agrees.all())

    @property
    def better(self) -> bool:
        """Whether the layout is better than the given one in MuJoCo, between the poses as well.

        If the given one violates a constraint: whether MuJoCo settles at every pose.
        """
        if not self.layout.given_allowed:
            return not np.isnan(self.after.score)
        return self.layout.objective.better(self.after.score, self.before.score)

    @property
    def worse(self) -> tuple[str, ...]:
        """Objectives of ``WATCHED`` that are worse than before."""
        return tuple(name for name in WATCHED if self.after.watched[name] > self._allowed(name))

    def _allowed(self, name: str) -> float:
        was, unit = self.before.watched[name], OBJECTIVES[name].unit
        return was + max(NOTED * was, NOTED * OBJECTIVES[name].size) if unit else was

    @property
    def side_effects(self) -> tuple[str, ...]:
        """What is worse than before, and the constraint that prevents it, a sentence each."""
        sentences = []
        for name in self.worse:
            of, was, now = OBJECTIVES[name], self.before.watched[name], self.after.watched[name]
            limit = f"{self._allowed(name):.4g}"
            sentences.append(
                f"Worse than before: {name} {of.shown(was)} → {of.shown(now)}; prevented by --limit "
                f'"{name}={limit}", in Python by subject_to={{"{name}": {limit}}}.'
            )
        return tuple(sentences)

    @property
    def sentences(self) -> tuple[str, ...]:
        """Results of the validation, warnings and limits, a sentence each."""
        of, after = self.layout.objective, self.after
        settled = int(after.settled.converged.sum())
        sentences = [
            f"In MuJoCo, at these poses and midway between them ({len(self.cases)} in all, of which {settled} "
            f"settled): {of.name} {of.shown(self.before.score)} before, {of.shown(after.score)} now."
        ]
        if self.agrees:
            differences = (
                f"within {1e3 * after.errors['position_error']:.1e} mm, "
                f"{np.degrees(after.errors['rotation_error']):.1e}° and {after.errors['tension_error']:.1e} N"
            )
            if after.neutral == len(self.cases):
                differences = "all are neutrally stable"
            elif after.neutral:
                differences = f"{after.neutral} are neutrally stable, the others agree {differences}"
            sentences.append(f"MuJoCo and Newton agree at all of them: {differences}.")
        else:
            sentences.append(f"MuJoCo and Newton do not agree at {int((~after.agrees).sum())} of them.")
        if not self.better:
            sentences.append("Between the poses it is no better than before: optimise for more poses.")
        return (*sentences, *self.side_effects, *self.layout.warnings, PROMISE)

    def __repr__(self) -> str:
        agreement = "both methods agree" if self.agrees else "the methods do not agree"
        name, poses = self.layout.given.name, len(self.cases)
        better = "better" if self.better else "no better"
        return f"<LayoutValidation of {name!r}: {better} in MuJoCo at {poses} poses, {agreement}>"


def validate_layout(layout: LayoutResult) -> LayoutValidation:
    """Settle both layouts in MuJoCo at the poses of the optimisation and midway between them, and compare with statics.

    Args:
        layout: from ``find_layout``.

    Returns:
        The results of both methods for both layouts, and ``sentences`` that summarise them.

    Raises:
        InvalidInput: not a ``LayoutResult``.
    """
    refuse_unless(LayoutResult, layout=layout)
    cases = layout.cases.finer()
    return LayoutValidation(
        layout,
        cases,
        *(
            _validated(*one, cases, layout)
            for one in (
                (layout.given, layout.equilibria_before.layouts),
                (layout.robot, layout.equilibria.layouts),
            )
        ),
    )


def _validated(robot: Robot, batch: RobotBatch, cases: Cases, layout: LayoutResult) -> ValidatedRobot:
    problems = cases.problems(robot)
    solved, settled = solve_many(problems), settle_many(problems)
    comparison, errors = compare_many(solved, settled), {}
    neutral = comparison.verdicts == Verdict.AGREE_EXCEPT_NEUTRAL
    for name, column in comparison.errors.items():
        known = column[~neutral & np.isfinite(column)]
        errors[name] = float(known.max()) if known.size else np.nan
    equilibria = _of_layout(batch, cases, settled)

    def score(objective: Objective) -> float:
        if objective.equilibria and not settled.converged.all():
            return np.nan
        return float(np.asarray(objective.score(equilibria, layout.limits), dtype=float)[0])

    return ValidatedRobot(
        robot, solved, settled, errors, comparison.agrees, int(neutral.sum()), score(layout.objective),
        values_of(layout, equilibria), {name: score(OBJECTIVES[name]) for name in WATCHED},
    )  # fmt: skip


def values_of(layout: LayoutResult, equilibria: LayoutEquilibria) -> Float[np.ndarray, " cases"]:
    """The quantity of the objective in each case of one layout, nan where it needs an equilibrium and there is none."""
    objective = mapped(layout.objective)
    assert objective.each is not None
    with np.errstate(invalid="ignore"):
        found = objective.each(equilibria, layout.limits)[0]
    return np.where(equilibria.converged[0], found, np.nan) if objective.equilibria else found


def mapped(objective: Objective) -> Objective:
    """The objective whose quantity has a value at each pose: the objective itself, or the worst deviation."""
    return OBJECTIVES["worst deviation"] if objective.each is None else objective


def _of_layout(batch: RobotBatch, cases: Cases, settled: EquilibriumBatch) -> LayoutEquilibria:
    """MuJoCo's equilibria as those of one layout."""
    problems = cases.layout_problems(batch)
    return LayoutEquilibria(
        problems, settled.positions[None], settled.rotations[None], settled.lengths[None], settled.tensions[None],
        settled.residuals[None], settled.iterations[None], settled.status[None], "mujoco", settled.eigenvalues[None],
        cases,
    )  # fmt: skip

"""Is the better layout better in MuJoCo, too, and between the poses at which it was looked for?"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from cdpr_sim.core.checks import refuse_unless
from cdpr_sim.core.equilibrium_batch import EquilibriumBatch
from cdpr_sim.core.html_repr import HtmlRepr
from cdpr_sim.core.robot import Robot
from cdpr_sim.crosscheck.check import compare_many
from cdpr_sim.crosscheck.compare import compare
from cdpr_sim.design.layout_result import PROMISE, LayoutResult
from cdpr_sim.design.objectives import NO_LIMITS, Objective
from cdpr_sim.design.robot_batch import Cases, LayoutEquilibria, RobotBatch
from cdpr_sim.physics.settle import settle_many
from cdpr_sim.statics.newton import solve_many


@dataclass(frozen=True, eq=False)
class ValidatedRobot:
    """One robot at all poses, by both methods.

    Attributes:
        robot: the robot.
        solved: by statics, (rows,).
        settled: by MuJoCo, (rows,).
        errors: largest differences, by the names of ``Agreement``; nan where no row rests on both methods.
        agrees: (rows,) whether the two methods do.
        score: the objective in MuJoCo [SI]; nan where some platform does not rest.
    """

    robot: Robot
    solved: EquilibriumBatch
    settled: EquilibriumBatch
    errors: dict[str, float]
    agrees: Bool[np.ndarray, " rows"]
    score: float


@dataclass(frozen=True, eq=False)
class LayoutValidation(HtmlRepr):
    """Both layouts settled in MuJoCo, at the poses that were asked and midway between them.

    Attributes:
        found: the layout.
        cases: the poses, twice as fine, under every load and with every stiffness.
        before, after: the robot as given, and with the layout that was found.
    """

    found: LayoutResult
    cases: Cases
    before: ValidatedRobot
    after: ValidatedRobot

    @property
    def agrees(self) -> bool:
        """Whether MuJoCo and statics agree on the layout that was found, at every pose."""
        return bool(self.after.agrees.all())

    @property
    def better(self) -> bool:
        """Whether MuJoCo finds it better than the one given, between the poses as well."""
        return not np.isnan(self.after.score) and not self.found.objective.better(self.before.score, self.after.score)

    @property
    def sentences(self) -> tuple[str, ...]:
        """What MuJoCo says, and what is not promised."""
        of, after = self.found.objective, self.after
        rested = int(after.settled.converged.sum())
        told = [
            f"In MuJoCo, at these poses and midway between them ({len(self.cases)} in all, of which {rested} come to "
            f"rest): {of.name} {of.shown(self.before.score)} before, {of.shown(after.score)} now."
        ]
        if self.agrees:
            told.append(
                f"MuJoCo and Newton agree at every one: within {1e3 * after.errors['position_error']:.1e} mm, "
                f"{np.degrees(after.errors['rotation_error']):.1e}° and {after.errors['tension_error']:.1e} N."
            )
        else:
            told.append(f"MuJoCo and Newton do not agree at {int((~after.agrees).sum())} of them.")
        if not self.better:
            told.append("Between the poses it is no better than before: ask for more poses.")
        return (*told, *self.found.warnings, PROMISE)

    def __repr__(self) -> str:
        said = "both methods agree" if self.agrees else "the methods do not agree"
        name, poses = self.found.given.name, len(self.cases)
        result = "better" if self.better else "no better"
        return f"<LayoutValidation of {name!r}: {result} in MuJoCo at {poses} poses, {said}>"


def validate_layout(found: LayoutResult) -> LayoutValidation:
    """Settle both layouts in MuJoCo, at the poses that were asked and midway between them, and compare with statics.

    Args:
        found: from ``find_layout``.

    Returns:
        What MuJoCo finds of both layouts, and ``sentences`` for people.

    Raises:
        InvalidInput: not a layout that was found.
    """
    refuse_unless(LayoutResult, found=found)
    cases = found.cases.finer()
    return LayoutValidation(
        found, cases, *(_side(robot, cases, found.objective) for robot in (found.given, found.robot))
    )


def _side(robot: Robot, cases: Cases, objective: Objective) -> ValidatedRobot:
    problems = cases.problems(robot)
    solved, settled = solve_many(problems), settle_many(problems)
    columns, within = compare_many(solved, settled)
    for row in np.flatnonzero(~within & solved.converged & settled.converged):
        within[row] = compare(solved[row], settled[row]).agrees
    errors = {
        name: float(np.nanmax(column)) if np.isfinite(column).any() else np.nan for name, column in columns.items()
    }
    return ValidatedRobot(robot, solved, settled, errors, within, _score(robot, cases, objective, settled))


def _score(robot: Robot, cases: Cases, objective: Objective, settled: EquilibriumBatch) -> float:
    """The objective of where MuJoCo has the platforms."""
    if objective.equilibria and not settled.converged.all():
        return np.nan
    equilibria = LayoutEquilibria(
        settled.problems, settled.positions[None], settled.rotations[None], settled.lengths[None],
        settled.tensions[None], settled.residuals[None], settled.iterations[None], settled.status[None], "mujoco",
        settled.eigenvalues[None], RobotBatch.of([robot]), cases,
    )  # fmt: skip
    scores: Float[np.ndarray, " layouts"] = np.asarray(objective.score(equilibria, NO_LIMITS), dtype=float)
    return float(scores[0])

"""Result of a layout optimisation."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from cdpr_sim.analysis.sensitivity import name_of, unit_of
from cdpr_sim.core.checks import Frozen
from cdpr_sim.core.html_repr import HtmlRepr
from cdpr_sim.core.robot import Robot
from cdpr_sim.core.robot_batch import VARIED
from cdpr_sim.design.layout_equilibria import Cases, LayoutEquilibria
from cdpr_sim.design.objectives import Limits, Objective

PROMISE = (
    "The layout was optimised for these poses and loads only: elsewhere, under other loads, with other cables or by "
    "other criteria it may be worse than before, and a better layout may exist."
)
"""Limits of the result."""

ROUNDING = 1e-9
"""[m] Rounding of an exit that is kept on a face of the frame."""


@dataclass(frozen=True)
class Change:
    """A parameter that changed.

    Attributes:
        name: as "exit 3 z" or "EA of cable 2".
        before, after: in SI units.
        unit: "m", "N" or "kg/m".
    """

    name: str
    before: float
    after: float
    unit: str


@dataclass(frozen=True, eq=False)
class LayoutResult(Frozen, HtmlRepr):
    """Best layout of an optimisation.

    Attributes:
        robot: the robot with that layout; the given one if no better layout was found.
        given: the robot that the search started from.
        objective: what was minimised or maximised.
        before, after: its values, in SI units.
        cases: poses, loads and stiffnesses of the optimisation.
        limits: of the tensions, for objectives that use them.
        given_allowed: whether the given layout has an equilibrium in every case and satisfies the constraints.
        equilibria_before, equilibria: equilibria of both robots, each (1, cases).
        history: (generations, 3): generation, layouts evaluated so far, best value of the objective.
        layouts_evaluated: number of layouts evaluated.
        message: how the search ended, in a sentence.
        values: of the variables.
        variables: their names.
    """

    robot: Robot
    given: Robot
    objective: Objective
    before: float
    after: float
    cases: Cases
    limits: Limits
    given_allowed: bool
    equilibria_before: LayoutEquilibria
    equilibria: LayoutEquilibria
    history: Float[np.ndarray, "generations 3"]
    layouts_evaluated: int
    message: str
    values: Float[np.ndarray, " variables"]
    variables: tuple[str, ...]

    @property
    def better(self) -> bool:
        """Whether the layout is better than the given one: by the objective, or since that violates a constraint."""
        return not self.given_allowed or self.objective.better(self.after, self.before)

    @property
    def largest_displacement(self) -> float:
        """Displacement of the point that moved most [m]."""
        return float(self.equilibria.layouts.displacements[0])

    @property
    def warnings(self) -> tuple[str, ...]:
        """Reasons why this layout can probably not be built, a sentence each."""
        outside = outside_frame(self.robot, self.given)
        if not outside.any():
            return ()
        cables = ", ".join(str(cable + 1) for cable in np.flatnonzero(outside))
        return (
            f"The exits of cables {cables} are outside the frame now, by up to {1e3 * outside.max():.3g} mm; a box for "
            "`within` keeps them inside.",
        )

    @property
    def changes(self) -> tuple[Change, ...]:
        """Every parameter that changed."""
        changes = []
        for name in VARIED:
            before, after = (np.ravel(getattr(robot, name)).tolist() for robot in (self.given, self.robot))
            for index, ends in enumerate(zip(before, after, strict=True)):
                if ends[0] != ends[1]:
                    changes.append(Change(name_of(name, index), *ends, unit_of(name)))
        return tuple(changes)

    def __str__(self) -> str:
        of = self.objective
        if not self.better:
            return f"{self.none_better} {self.message}"
        return (
            f"{self.given.name}: {of.name} {of.shown(self.before)} before, {of.shown(self.after)} now, with points "
            f"moved by at most {1e3 * self.largest_displacement:.3g} mm. "
            f"{' '.join([self.message, *self.warnings, PROMISE])}"
        )

    @property
    def none_better(self) -> str:
        """That no layout is better, in a sentence."""
        of, count = self.objective, f"{self.layouts_evaluated:,} layouts evaluated"
        return f"{self.given.name}: {of.name} {of.shown(self.before)} as given, and none of {count} is better."

    def __repr__(self) -> str:
        of = self.objective
        if not self.better:
            return (
                f"<LayoutResult of {self.given.name!r}: no better layout, {of.name} {of.shown(self.before)} as given>"
            )
        return (
            f"<LayoutResult of {self.given.name!r}: {of.name} {of.shown(self.before)} before, "
            f"{of.shown(self.after)} now, "
            f"points moved by at most {1e3 * self.largest_displacement:.3g} mm>"
        )


def outside_frame(robot: Robot, given: Robot) -> Float[np.ndarray, " cables"]:
    """Distance of each exit of ``robot`` outside its frame, if larger than that of ``given``; else 0, (cables,) [m].

    The default frame is the box around the exits, with no exit outside.
    """

    def outside(exits: Float[np.ndarray, "cables 3"]) -> Float[np.ndarray, " cables"]:
        return np.linalg.norm(exits - exits.clip(*robot.frame), axis=-1)

    now, before = outside(robot.exits), outside(given.exits)
    return np.where(now > before + ROUNDING, now, 0.0)

"""Hybrid control: lengths of some cables, tensions of the others, which are the redundant ones."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Bool, Float
from scipy.spatial.transform import RigidTransform

from cdpr_sim.analysis.compensation import Compensation
from cdpr_sim.control.plan import Limits, Plan
from cdpr_sim.core.checks import listed, whole
from cdpr_sim.core.controller import Command, Measurement, Reference
from cdpr_sim.core.errors import InvalidInput
from cdpr_sim.core.limits import checked_limits
from cdpr_sim.core.robot import Robot
from cdpr_sim.statics import forces

LOOKS = 5
"""Knots of a reference motion at which the choice of cables is evaluated."""


@dataclass
class LengthsAndTensions:
    """Some winches control the tensions of ``compensate`` and the others its lengths.

    If at most as many cables as the platform has free directions are controlled by length, inconsistent lengths cause
    no internal tensions.

    Attributes:
        robot: the controller's model of the robot.
        by_tension: the cables that are controlled by tension, counted from 1; default: the surplus of cables over free
            directions, chosen so that the others hold the platform stiffly along the whole motion.
        tension_limits: smallest and largest tension [N]; default: those of ``compensate``.
    """

    robot: Robot
    by_tension: Sequence[int] | None = None
    tension_limits: Limits | None = None
    _plan: Plan = field(init=False, repr=False)
    _held: Bool[np.ndarray, " cables"] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        checked_limits(self.robot, self.tension_limits)
        if self.by_tension is not None:
            given = listed("by_tension", self.by_tension, "numbers of cables")
            chosen = {whole("by_tension", cable, 1, self.robot.cables) for cable in given}
            if len(chosen) == self.robot.cables:
                raise InvalidInput(f"by_tension: found all {len(chosen)} cables, expected some that hold their lengths")

    def start(self, reference: Reference) -> Float[np.ndarray, " cables"]:
        """Compensate along the reference motion, and choose cables unless they are given.

        Returns:
            (cables,) rest lengths [m].
        """
        self._plan = Plan.of(self.robot, reference, self.tension_limits)
        if self.by_tension is None:
            chosen = _left_to_tension(self.robot, self._plan.compensations)
        else:
            chosen = [cable - 1 for cable in self.by_tension]
        self._held = np.isin(np.arange(self.robot.cables), chosen)
        return self._plan.robot.rest_lengths(reference.pose(0.0)) + self._plan.at(0.0)[0]

    def command(self, time: float, pose: RigidTransform, measurement: Measurement) -> Command:
        """The lengths at ``pose``, with the correction of the reference at ``time``; and its tensions at that time.

        Returns:
            Lengths [m] for some winches and tensions [N] for the others.
        """
        correction, tensions = self._plan.at(time)
        return Command(self._plan.robot.rest_lengths(pose) + correction, tensions, self._held)


def _left_to_tension(robot: Robot, compensations: Sequence[Compensation]) -> tuple[int, ...]:
    """The cables without whose elasticity the platform's smallest stiffness, along the motion, is largest."""
    spare = max(0, robot.cables - len(robot.free))
    some = np.unique(np.linspace(0, len(compensations) - 1, LOOKS).round().astype(int))
    found = [compensations[row].equilibrium for row in some]
    states = [forces.at(one.problem, one.position, one.rotation.as_matrix()) for one in found]

    def softest(chosen: tuple[int, ...]) -> float:
        """The smallest eigenvalue of the remaining stiffness along the motion."""
        held = np.isin(np.arange(robot.cables), chosen)
        lost = ((one.wrench_matrix * (_along(robot, one) * held)) @ one.wrench_matrix.T for one in states)
        pairs = zip(states, lost, strict=True)
        return min(float(forces.eigenvalues(robot, one.stiffness_matrix - part)[0]) for one, part in pairs)

    return max(itertools.combinations(range(robot.cables), spare), key=softest)


def _along(robot: Robot, state: forces.State) -> Float[np.ndarray, " cables"]:
    """Stiffness of each rope in the direction of its pull [N/m]; of a sagging one, smaller than its spring's."""
    u = state.pull_directions
    of_pull = np.einsum("ci,cij,cj->c", u, state.cable_stiffness, u)  # of all parts, by the length of one
    return robot.cabling.tensions(robot.cabling.tensions(of_pull))

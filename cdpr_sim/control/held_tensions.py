"""Force control: winches control the tensions that carry the platform along the reference motion."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import RigidTransform

from cdpr_sim.analysis.compensation import compensate, default_limits
from cdpr_sim.analysis.tensions import Demand, nearest, smallest
from cdpr_sim.control.plan import Limits
from cdpr_sim.core.controller import Command, Measurement, Reference
from cdpr_sim.core.limits import checked_limits
from cdpr_sim.core.memory import without_memory
from cdpr_sim.core.pretension import without_pretension
from cdpr_sim.core.problem import Problem
from cdpr_sim.core.robot import Robot
from cdpr_sim.statics import forces
from cdpr_sim.statics.given_tensions import cut

DIRECTIONS = 3
"""Corrections of the directions in which cables with mass pull under the chosen tensions: each comes nearer tenfold or
more."""


@dataclass
class HeldTensions:
    """Winches control the smallest tensions within limits that carry and accelerate the platform along the reference.

    If there are none, these tensions leave the smallest part of its weight and inertia unbalanced. Cables whose tension
    does not depend on their length are no springs: only the change of the cables' directions returns the platform to
    its pose.

    Attributes:
        robot: the controller's model of the robot.
        tension_limits: smallest and largest tension [N]; default: those of ``compensate``.
    """

    robot: Robot
    tension_limits: Limits | None = None
    _reference: Reference = field(init=False, repr=False)
    _rigid: Robot = field(init=False, repr=False)

    def __post_init__(self) -> None:
        checked_limits(self.robot, self.tension_limits)

    def start(self, reference: Reference) -> Float[np.ndarray, " cables"]:
        """The unstretched lengths of cables with these tensions at the first pose, or near it.

        Returns:
            (cables,) rest lengths [m].
        """
        self._reference, self._rigid = reference, without_pretension(self.robot)
        return compensate(
            without_memory(self._rigid), reference.pose(0.0), tension_limits=self.tension_limits
        ).rest_lengths

    def command(self, time: float, pose: RigidTransform, measurement: Measurement) -> Command:
        """The tensions at ``pose``.

        Returns:
            Tensions [N] for all winches.
        """
        robot = self._rigid
        rotation, free, units = pose.rotation.as_matrix(), robot.free, robot.units
        inertia = -robot.mass * self._reference.acceleration(time)
        problem = Problem.of(
            robot, pose, external_wrench=[*inertia, *np.cross(rotation @ robot.center_of_mass, inertia)]
        )
        limits = default_limits(problem) if self.tension_limits is None else self.tension_limits
        lower, upper = checked_limits(robot, limits)
        where, count = (pose.translation, rotation), len(free)
        demand = Demand(
            wrench_matrix=(forces.geometry(robot, *where).wrench_matrix / units[:, None])[free],
            load=(forces.load_wrench(problem, rotation) / units)[free],
            lower=lower,
            upper=upper,
            stiffness=np.zeros((count, count)),
            stiffness_by_tension=np.zeros((robot.cables, count, count)),
        )
        tensions = _chosen(demand)
        for _ in range(0 if robot.cabling.springs else DIRECTIONS):
            demand = replace(demand, wrench_matrix=(cut(robot, *where, tensions)[1] / units[:, None])[free])
            tensions = _chosen(demand)
        return Command(problem.rest_lengths, tensions, np.ones(robot.cables, dtype=bool))


def _chosen(demand: Demand) -> Float[np.ndarray, " cables"]:
    """The smallest tensions that balance the load, or those that leave the least of it."""
    tensions = smallest(demand)
    return nearest(demand) if tensions is None else tensions

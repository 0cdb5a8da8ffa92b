"""Feedforward of elastic cables' unstretched lengths."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import RigidTransform

from cdpr_sim.control.plan import Limits, Plan
from cdpr_sim.core.controller import Measurement, Reference
from cdpr_sim.core.limits import checked_limits
from cdpr_sim.core.robot import Robot


@dataclass
class ElasticLengths:
    """Winches let out the lengths of ``compensate`` for the reference pose, or for the nearest pose that can be held.

    Attributes:
        robot: the controller's model of the robot, with its elastic cables.
        tension_limits: smallest and largest tension [N]; default: those of ``compensate``.
    """

    robot: Robot
    tension_limits: Limits | None = None
    _plan: Plan = field(init=False, repr=False)

    def __post_init__(self) -> None:
        checked_limits(self.robot, self.tension_limits)

    def start(self, reference: Reference) -> Float[np.ndarray, " cables"]:
        """Compensate along the reference motion.

        Returns:
            (cables,) [m], the compensated rest lengths at the first pose.
        """
        self._plan = Plan.of(self.robot, reference, self.tension_limits)
        return self._plan.robot.rest_lengths(reference.pose(0.0)) + self._plan.at(0.0)[0]

    def command(self, time: float, pose: RigidTransform, measurement: Measurement) -> Float[np.ndarray, " cables"]:
        """The lengths at ``pose``, with the correction of the reference motion at ``time``.

        Returns:
            (cables,) rest lengths [m].
        """
        return self._plan.robot.rest_lengths(pose) + self._plan.at(time)[0]

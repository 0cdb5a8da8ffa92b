"""Feedforward of the lengths of rigid cables, as on DemoBot."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import RigidTransform

from cdpr_sim.core.checks import refuse_unless
from cdpr_sim.core.controller import Measurement, Reference
from cdpr_sim.core.robot import Robot


@dataclass(frozen=True)
class RigidLengths:
    """Winches let out the distance from exit to anchor at the reference pose (paper Eq. 1, 2).

    If the model has a pretension, they let out its ``rest_lengths`` at the reference pose.

    Attributes:
        robot: the controller's model of the robot; without pretension, only its geometry is used.
    """

    robot: Robot

    def __post_init__(self) -> None:
        refuse_unless(Robot, robot=self.robot)

    def start(self, reference: Reference) -> Float[np.ndarray, " cables"]:
        """The lengths at the first pose.

        Returns:
            (cables,) rest lengths [m].
        """
        return self.robot.rest_lengths(reference.pose(0.0))

    def command(self, time: float, pose: RigidTransform, measurement: Measurement) -> Float[np.ndarray, " cables"]:
        """The lengths at ``pose``.

        Returns:
            (cables,) rest lengths [m].
        """
        return self.robot.rest_lengths(pose)

"""A path of commanded poses: straight lines through poses, smooth in time, and the rest lengths along it."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float
from numpy.typing import ArrayLike
from scipy.spatial.transform import RigidTransform, Rotation, Slerp

from cdpr_sim.core.checks import checked_array
from cdpr_sim.core.pretension import commanded_lengths, without_pretension
from cdpr_sim.core.robot import Robot


class PosePath:
    """Straight lines through poses, as a function of the fraction of time that has passed.

    The command moves smoothly and follows the minimum-jerk profile of Flash and Hogan (1985,
    doi:10.1523/JNEUROSCI.05-07-01688.1985) over the whole path: velocity and acceleration are zero at both ends.

    Args:
        robot: robot whose winches follow the path.
        poses: at least one.
        rest_lengths: rest lengths at each pose, (poses, cables) [m]; between two poses, their difference from the rigid
            lengths is interpolated linearly. Default: ``robot.rest_lengths`` at every pose, rigid without pretension.

    Raises:
        InvalidInput: rest lengths that do not fit.
    """

    def __init__(self, robot: Robot, poses: list[RigidTransform], rest_lengths: ArrayLike | None = None) -> None:
        self.robot = robot if rest_lengths is None else without_pretension(robot)
        self.positions = np.array([pose.translation for pose in poses])
        rotations = Rotation.concatenate([pose.rotation for pose in poses])
        turns = (rotations[1:] * rotations[:-1].inv()).magnitude() if len(poses) > 1 else np.zeros(0)
        moves = np.linalg.norm(np.diff(self.positions, axis=0), axis=1)
        legs = np.hypot(moves, robot.characteristic_length * turns)
        moving = np.append(True, legs > 0)
        self.along = np.append(0.0, np.cumsum(legs))[moving]
        self.positions = self.positions[moving]
        corrections = np.zeros((len(poses), robot.cables))
        if rest_lengths is not None:
            given = checked_array("rest_lengths", rest_lengths, (len(poses), robot.cables))
            corrections = given - [self.robot.rest_lengths(pose) for pose in poses]
        self.corrections = corrections[moving]
        self.rotations = Rotation.from_quat(rotations.as_quat()[moving])
        self.length = float(self.along[-1])

    def at(self, fractions: Float[np.ndarray, " steps"]) -> RigidTransform:
        """Commanded poses after these fractions of the time."""
        return self._poses(self._along(fractions))

    def evenly(self, count: int) -> RigidTransform:
        """Poses at equal distances along the path, both ends included."""
        return self._poses(np.linspace(0, self.length, count))

    def _poses(self, along: Float[np.ndarray, " steps"]) -> RigidTransform:
        if len(self.along) == 1:
            return RigidTransform.from_components(
                np.repeat(self.positions, len(along), 0), Rotation.concatenate([self.rotations] * len(along))
            )
        positions = np.stack([np.interp(along, self.along, column) for column in self.positions.T], axis=1)
        return RigidTransform.from_components(positions, Slerp(self.along, self.rotations)(along.clip(0, self.length)))

    def winches(self, fractions: Float[np.ndarray, " steps"]) -> Float[np.ndarray, "steps cables"]:
        """Rest lengths let out after these fractions of the time [m]."""
        commanded = self.at(fractions)
        lengths = commanded_lengths(self.robot, commanded.translation, commanded.rotation.as_matrix())
        along = self._along(fractions)
        return lengths + np.stack([np.interp(along, self.along, column) for column in self.corrections.T], axis=1)

    def _along(self, s: Float[np.ndarray, " steps"]) -> Float[np.ndarray, " steps"]:
        return self.length * s**3 * (10 - 15 * s + 6 * s**2)

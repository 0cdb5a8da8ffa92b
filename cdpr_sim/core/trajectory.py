"""A motion of the platform and what was commanded meanwhile: data, filled in by MuJoCo and shown in pictures."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float
from scipy.spatial.transform import RigidTransform

from cdpr_sim.core.robot import Robot


@dataclass(frozen=True, eq=False)
class Trajectory:
    """A motion of the platform, state by state; usable without rendering.

    Attributes:
        robot: whose platform it is.
        times: (steps,) [s].
        poses: of the platform in the base frame, a stack of (steps,).
        lengths: of the cables, (steps, cables) [m].
        tensions: (steps, cables) [N].
        commanded: the poses that the winches were set for, a stack of (steps,).
        rest_lengths: unstretched cable lengths that the winches had let out, (steps, cables) [m].
    """

    robot: Robot
    times: Float[np.ndarray, " steps"]
    poses: RigidTransform
    lengths: Float[np.ndarray, "steps cables"]
    tensions: Float[np.ndarray, "steps cables"]
    commanded: RigidTransform
    rest_lengths: Float[np.ndarray, "steps cables"]

    def __post_init__(self) -> None:
        for array in (self.times, self.lengths, self.tensions, self.rest_lengths):
            array.flags.writeable = False

    def __len__(self) -> int:
        return len(self.times)

    @property
    def slack(self) -> Bool[np.ndarray, "steps cables"]:
        """Which cables carry no tension."""
        return self.tensions <= 0

    @property
    def deviations(self) -> Float[np.ndarray, "steps 3"]:
        """Position minus commanded position [m]; its z is minus the sag."""
        return self.poses.translation - self.commanded.translation

    @property
    def tilts(self) -> Float[np.ndarray, " steps"]:
        """The angle [rad] between the platform's z axis and the vertical."""
        x, y, z = self.poses.rotation.as_matrix()[:, :, 2].T
        return np.arctan2(np.hypot(x, y), z)

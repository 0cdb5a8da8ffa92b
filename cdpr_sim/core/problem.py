"""What both roads are asked: where does this robot rest, with these cables let out and this load?"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from numpy.typing import ArrayLike
from scipy.spatial.transform import RigidTransform

from cdpr_sim.core.errors import InvalidInput
from cdpr_sim.core.pose import PoseLike
from cdpr_sim.core.robot import Robot, checked_array


@dataclass(frozen=True, eq=False)
class Problem:
    """A robot, the pose it starts from, its rest lengths and an external wrench; checked and frozen.

    Attributes:
        robot: the robot.
        pose: the commanded pose, from which both roads start.
        rest_lengths: unstretched cable lengths l0, (cables,) [m].
        external_wrench: force [N] and torque [N m] on the platform's origin, in the base frame, besides gravity.
    """

    robot: Robot
    pose: RigidTransform
    rest_lengths: Float[np.ndarray, " cables"]
    external_wrench: Float[np.ndarray, "6"]

    @classmethod
    def of(
        cls,
        robot: Robot,
        pose: PoseLike,
        rest_lengths: ArrayLike | None = None,
        external_wrench: ArrayLike | None = None,
    ) -> Problem:
        """The problem that users describe; rest lengths default to the rigid ones at ``pose`` (paper Eq. 1, 2).

        Raises:
            InvalidInput: a pose, a length or a wrench that cannot be right, or a commanded pose at which every
                exit lies below the platform, so that it falls.
        """
        transform = robot.pose(pose)
        if rest_lengths is None:
            rest = robot.rest_lengths(transform)
        else:
            rest = checked_array("rest_lengths", rest_lengths, (robot.cables,))
            if not rest.min() > 0:
                raise InvalidInput(f"rest_lengths: found {rest.min():g} m, expected more than 0")
        wrench = checked_array("external_wrench", np.zeros(6) if external_wrench is None else external_wrench, (6,))
        held = np.setdiff1d(np.arange(6), robot.free_directions)
        if wrench[held].any():
            raise InvalidInput(
                f"external_wrench: found {wrench.tolist()}, but {robot.name!r} is planar: "
                "expected only forces along x and z and a torque about y"
            )
        if rest_lengths is None:
            _refuse_a_fall(robot, transform, wrench)
        for array in (rest, wrench):
            array.flags.writeable = False
        return cls(robot, transform, rest, wrench)

    @property
    def stiffnesses(self) -> Float[np.ndarray, " cables"]:
        """Spring constants EA / l0 of the cables, (cables,) [N/m] (paper Eq. 10)."""
        return self.robot.axial_stiffness / self.rest_lengths

    @property
    def load(self) -> float:
        """The largest of weight, external force and external torque over the characteristic length [N]."""
        scale = np.repeat([1.0, self.robot.characteristic_length], 3)
        return max(self.robot.weight, float(np.abs(self.external_wrench / scale).max()))

    def same_as(self, other: Problem) -> bool:
        """Whether both ask for the same robot, rest lengths and load (the starting pose may differ)."""
        mine, theirs = self.robot, other.robot
        return (
            np.array_equal(self.rest_lengths, other.rest_lengths)
            and np.array_equal(self.external_wrench, other.external_wrench)
            and (mine.mass, mine.gravity, mine.mobility) == (theirs.mass, theirs.gravity, theirs.mobility)
            and all(
                np.array_equal(getattr(mine, field), getattr(theirs, field))
                for field in ("exits", "anchors", "axial_stiffness", "center_of_mass")
            )
        )


def _refuse_a_fall(robot: Robot, pose: RigidTransform, wrench: Float[np.ndarray, "6"]) -> None:
    """A cable only pulls: with every exit below its anchor, nothing holds a platform that is pushed down."""
    rise = robot.exits[:, 2] - pose.apply(robot.anchors)[:, 2]
    if robot.weight > wrench[2] and not rise.max() > 0:
        raise InvalidInput(
            f"pose: found every exit of {robot.name!r} below the platform, which falls since cables cannot push; "
            "expected at least one exit above its anchor"
        )

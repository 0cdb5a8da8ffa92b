"""Poses as users give them: a position, the paper's six-vector, or a SciPy ``RigidTransform``.

The pose of the platform frame in the base frame: z up, metres and radians. The six-vector is the paper's
[x, y, z, alpha, beta, gamma] with R = Rz(gamma) Ry(beta) Rx(alpha).
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TypeAlias

import numpy as np
from jaxtyping import Float
from numpy.typing import ArrayLike
from scipy.spatial.transform import RigidTransform, Rotation

from cdpr_sim.core.checks import MOST_LENGTH, Frozen, as_numbers, frozen, refuse_far
from cdpr_sim.core.errors import InvalidInput

_LEVEL = frozen(np.eye(3))


@dataclass(frozen=True, eq=False)
class Pose(Frozen):
    """A pose as plain arrays, and as a ``RigidTransform`` on demand, since making one takes longer than solving.

    Attributes:
        position: position of the platform's origin in the base frame, (3,) [m].
        rotation_matrix: rotation from the platform frame to the base frame, (3, 3).
    """

    position: Float[np.ndarray, "3"]
    rotation_matrix: Float[np.ndarray, "3 3"]

    @classmethod
    def of(cls, pose: PoseLike) -> Pose:
        """The pose that ``pose`` describes.

        Args:
            pose: a position (3,) [m] with the platform level, a six-vector (6,) [m, rad], or a ``RigidTransform``.

        Raises:
            InvalidInput: another shape, a number that is not finite, or a position beyond any robot.
        """
        if isinstance(pose, Pose):
            return pose
        if isinstance(pose, RigidTransform):
            if not pose.single:
                raise InvalidInput(f"pose: found a stack of {len(pose)} transforms, expected a single one")
            frame = pose.as_matrix()
            _refuse_impossible(frame[:3, 3], frame[:3, :3].ravel())
            made = cls(frame[:3, 3].copy(), frame[:3, :3].copy())
            made.__dict__["transform"] = pose
            return made
        vector = as_numbers("pose", pose, "3 or 6 numbers or a RigidTransform")
        if vector.shape not in {(3,), (6,)}:
            raise InvalidInput(
                f"pose: found an array of shape {vector.shape}, expected (x, y, z) or (x, y, z, alpha, beta, gamma)"
            )
        _refuse_impossible(vector[:3], vector[3:])
        level = vector.size == 3
        return cls(vector[:3].copy(), _LEVEL if level else Rotation.from_euler("xyz", vector[3:]).as_matrix())

    @cached_property
    def transform(self) -> RigidTransform:
        """The same pose as a SciPy ``RigidTransform``."""
        return poses_of(self.position, self.rotation_matrix)


PoseLike: TypeAlias = ArrayLike | Sequence[float] | RigidTransform | Pose


class PoseField:
    """Field of a frozen dataclass that takes a ``RigidTransform`` or a ``Pose``, and returns the former.

    It must be in a base class of the dataclass, which would otherwise take it for the field's default.
    """

    def __set_name__(self, owner: type, name: str) -> None:
        self.name = name

    def __set__(self, instance: object, pose: RigidTransform | Pose) -> None:
        vars(instance)[self.name] = Pose.of(pose)

    def __get__(self, instance: object | None, owner: type) -> RigidTransform:
        if instance is None:
            raise AttributeError(self.name)  # where dataclasses look for a default
        return Pose.of(vars(instance)[self.name]).transform


class Posed(Frozen):
    """Base with the field ``pose``, which is also available as plain arrays."""

    pose = PoseField()

    @property
    def at(self) -> Pose:
        """The pose as plain arrays."""
        return Pose.of(vars(self)["pose"])

    @property
    def position(self) -> Float[np.ndarray, "3"]:
        """Position of the platform's origin in the base frame, (3,) [m]."""
        return self.at.position.copy()

    @property
    def rotation_matrix(self) -> Float[np.ndarray, "3 3"]:
        """Rotation from the platform frame to the base frame, (3, 3)."""
        return self.at.rotation_matrix


def _refuse_impossible(position: np.ndarray, rotation: np.ndarray) -> None:
    found = [*position.tolist(), *rotation.tolist()]
    if not all(map(math.isfinite, found)):  # on so few numbers, faster than NumPy
        raise InvalidInput(f"pose: found {found}, expected finite numbers")
    if max(map(abs, found[:3])) > MOST_LENGTH:
        refuse_far("pose", position)


def euler(rotation: Rotation) -> Float[np.ndarray, "3"]:
    """(alpha, beta, gamma) [rad] of R = Rz(gamma) Ry(beta) Rx(alpha), the paper's convention.

    At beta = ±90° only the sum or difference of alpha and gamma is defined; gamma is then 0.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # SciPy's gimbal-lock warning; see the docstring
        return rotation.as_euler("xyz")


def six_vector(pose: RigidTransform) -> Float[np.ndarray, "6"]:
    """The paper's [x, y, z, alpha, beta, gamma] of ``pose`` [m, rad]."""
    return np.concatenate([pose.translation, euler(pose.rotation)])


def euler_of_matrices(matrices: Float[np.ndarray, "*batch 3 3"]) -> Float[np.ndarray, "*batch 3"]:
    """``euler`` of rotation matrices, (..., 3) [rad]; nan where a matrix is."""
    known = np.isfinite(matrices).all((-1, -2))
    angles = np.full((*known.shape, 3), np.nan)
    if known.any():
        angles[known] = euler(Rotation.from_matrix(matrices[known]))
    return angles


def tilt_of_matrices(matrices: Float[np.ndarray, "*batch 3 3"]) -> Float[np.ndarray, "*batch"]:
    """The angle between the platform's z axis and the vertical, of rotation matrices, (...) [rad]."""
    upright = matrices[..., 2, 2].copy()  # NumPy 2.0's arctan2 of strided numbers differs by an ulp with their address
    return np.arctan2(np.hypot(matrices[..., 0, 2], matrices[..., 1, 2]), upright)


def angle_between(one: Float[np.ndarray, "*#batch 3 3"], other: Float[np.ndarray, "*#batch 3 3"]) -> np.ndarray:
    """The angle of the rotation from one to the other, (...) [rad], by sine and cosine: accurate if small."""
    turn = one @ np.swapaxes(other, -1, -2)
    sines = [turn[..., i, j] - turn[..., j, i] for i, j in ((2, 1), (0, 2), (1, 0))]
    return np.arctan2(np.sqrt(sum(sine * sine for sine in sines)), np.trace(turn, axis1=-2, axis2=-1) - 1)


def poses_of(positions: Float[np.ndarray, "*batch 3"], matrices: Float[np.ndarray, "*batch 3 3"]) -> RigidTransform:
    """Poses from positions and rotation matrices; where either is nan, level and with a position of nan."""
    known = np.asarray(np.isfinite(positions).all(-1) & np.isfinite(matrices).all((-1, -2)))
    if known.all():
        return RigidTransform.from_components(positions, Rotation.from_matrix(matrices))
    frames = np.zeros((*known.shape, 4, 4))
    frames[..., :3, :3] = np.where(known[..., None, None], matrices, np.eye(3))
    frames[..., :3, 3] = np.where(known[..., None], positions, np.nan)
    frames[..., 3, 3] = 1.0
    return RigidTransform.from_matrix(frames)


def moved(pose: RigidTransform, step: Float[np.ndarray, "6"]) -> RigidTransform:
    """``pose`` after a step (translation [m], left-applied rotation vector [rad])."""
    return RigidTransform.from_components(pose.translation + step[:3], Rotation.from_rotvec(step[3:]) * pose.rotation)


def distance(one: RigidTransform, other: RigidTransform, arm: float) -> float:
    """sqrt(|translation|² + (arm·angle)²) between two poses [m]; ``arm`` [m] turns rotations into lengths."""
    frame, reference = one.as_matrix(), other.as_matrix()
    shift = np.linalg.norm(frame[:3, 3] - reference[:3, 3])
    return float(np.hypot(shift, arm * angle_between(frame[:3, :3], reference[:3, :3])))

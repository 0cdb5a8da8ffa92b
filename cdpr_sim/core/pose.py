"""Poses in and out: a position, the paper's six-vector, or a SciPy ``RigidTransform``.

The pose of the platform frame in the base frame: z up, metres and radians. The six-vector is the paper's
[x, y, z, alpha, beta, gamma] with R = Rz(gamma) Ry(beta) Rx(alpha).
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from typing import TypeAlias

import numpy as np
from jaxtyping import Float
from numpy.typing import ArrayLike
from scipy.spatial.transform import RigidTransform, Rotation

from cdpr_sim.core.checks import refuse_far, shown
from cdpr_sim.core.errors import InvalidInput

PoseLike: TypeAlias = ArrayLike | Sequence[float] | RigidTransform


def as_pose(pose: PoseLike) -> RigidTransform:
    """The pose that ``pose`` describes.

    Args:
        pose: a position (3,) [m] with the platform level, a six-vector (6,) [m, rad], or a ``RigidTransform``.

    Raises:
        InvalidInput: another shape, a number that is not finite, or a position beyond any robot.
    """
    if isinstance(pose, RigidTransform):
        if not pose.single:
            raise InvalidInput(f"pose: found a stack of {len(pose)} transforms, expected a single one")
        _refuse_impossible(pose.translation, pose.rotation.as_quat())
        return pose
    try:
        vector = np.asarray(pose, dtype=float)
    except (TypeError, ValueError, OverflowError):
        raise InvalidInput(f"pose: found {shown(pose)}, expected 3 or 6 numbers or a RigidTransform") from None
    if vector.shape not in {(3,), (6,)}:
        raise InvalidInput(
            f"pose: found an array of shape {vector.shape}, expected (x, y, z) or (x, y, z, alpha, beta, gamma)"
        )
    _refuse_impossible(vector[:3], vector[3:])
    rotation = Rotation.from_euler("xyz", vector[3:]) if vector.size == 6 else Rotation.identity()
    return RigidTransform.from_components(vector[:3], rotation)


def _refuse_impossible(position: np.ndarray, rotation: np.ndarray) -> None:
    found = [*position.tolist(), *rotation.tolist()]
    if not np.isfinite(found).all():
        raise InvalidInput(f"pose: found {found}, expected finite numbers")
    refuse_far("pose", position)


def euler(rotation: Rotation) -> Float[np.ndarray, "3"]:
    """(alpha, beta, gamma) [rad] of R = Rz(gamma) Ry(beta) Rx(alpha), the paper's convention.

    At beta = ±90° only the sum or difference of alpha and gamma is defined; gamma is then 0.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # SciPy's gimbal-lock warning, answered above
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


def tilt(rotation: Rotation) -> float:
    """The angle [rad] between the platform's z axis and the vertical."""
    return float(tilt_of_matrices(rotation.as_matrix()))


def tilt_of_matrices(matrices: Float[np.ndarray, "*batch 3 3"]) -> Float[np.ndarray, "*batch"]:
    """``tilt`` of rotation matrices, (...) [rad]."""
    upright = matrices[..., 2, 2].copy()  # NumPy 2.0's arctan2 of strided numbers differs by an ulp with their address
    return np.arctan2(np.hypot(matrices[..., 0, 2], matrices[..., 1, 2]), upright)


def poses_of(positions: Float[np.ndarray, "*batch 3"], matrices: Float[np.ndarray, "*batch 3 3"]) -> RigidTransform:
    """Poses of their positions and rotation matrices; where either is nan, level and with a position of nan."""
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
    shift = np.linalg.norm(one.translation - other.translation)
    return float(np.hypot(shift, arm * (one.rotation * other.rotation.inv()).magnitude()))

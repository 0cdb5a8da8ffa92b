"""Grids of commanded positions over a workspace: counts, coordinates, or a robot's own box."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, TypeAlias

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import RigidTransform, Rotation

from cdpr_sim.core import free_ram
from cdpr_sim.core.checks import checked_array, listed, shown
from cdpr_sim.core.errors import InvalidInput
from cdpr_sim.core.pose import PoseLike
from cdpr_sim.core.problem import positions_and_rotations
from cdpr_sim.core.robot import Robot

if TYPE_CHECKING:
    import xarray as xr

GridLike: TypeAlias = Sequence[int] | Mapping[str, Sequence[float] | np.ndarray]
"""Counts (nx, ny, nz) over the robots' workspace, or coordinates {"x": ..., "y": ..., "z": ...} [m]."""

DEFAULT = (40, 25, 10)
"""Default counts: ten thousand positions."""

AXES = ("x", "y", "z")

MOST_POSES = 10**10
"""Largest number of positions. More is a typing error: it would take hours and hundreds of gigabytes."""


LEAST_BYTES = 100.0
"""[bytes] Least memory that any result needs per pose."""


def as_grid(grid: GridLike | None, robots: Sequence[Robot]) -> dict[str, np.ndarray]:
    """The coordinates x, y and z [m] that ``grid`` describes, each strictly ascending.

    Args:
        grid: counts (nx, ny, nz), spread evenly over the workspace from face to face (one: its middle), or coordinates
            by name. Missing coordinates are the middle of the workspace. Default: ``DEFAULT``.
        robots: robots with a common workspace; a planar robot has a single y = 0.

    Raises:
        InvalidInput: an empty or too large grid, or robots of different workspaces and an incomplete grid.
    """
    if isinstance(grid, Mapping):
        for name in grid:
            if name not in AXES:
                raise InvalidInput(f"grid: found an axis {shown(name)}, expected x, y or z")
        given = {name: _coordinates(name, values) for name, values in grid.items()}
    else:
        given = dict(zip(AXES, _counts(DEFAULT if grid is None else grid), strict=True))
    axes, spread = {}, {}
    for i, name in enumerate(AXES):
        value = given.get(name, 1)
        if not isinstance(value, np.ndarray):
            lower, upper = _shared_workspace(robots)[:, i]
            if value > 1 and upper > lower:
                spread[name] = lower, upper, value
            value = np.array([(lower + upper) / 2])
        axes[name] = value
    poses = math.prod(float(spread[name][2] if name in spread else len(axes[name])) for name in AXES)
    if poses > MOST_POSES:
        raise InvalidInput(f"grid: found {poses:.1e} positions, expected {MOST_POSES:.0e} at most")
    for name, (lower, upper, count) in spread.items():
        free_ram.refuse_beyond(f"grid: {count:,} coordinates {name}", LEAST_BYTES * count, "fewer")
        axes[name] = np.linspace(lower, upper, count)
    for robot in robots:
        if robot.mobility == "planar" and axes["y"].any():
            raise InvalidInput(f"grid: found y = {axes['y'][-1]:g} m, but {robot.name!r} is planar: expected y = 0")
    return axes


def as_poses(
    poses: RigidTransform | Sequence[PoseLike] | np.ndarray, robot: Robot, grid: GridLike | None, turn: ArrayLike
) -> RigidTransform:
    """A stack of the poses that are given instead of a grid.

    Raises:
        InvalidInput: invalid poses or none, or a grid or an orientation besides them.
    """
    if grid is not None or np.any(turn):
        raise InvalidInput("poses: found them besides a grid or an orientation, expected one of them")
    if isinstance(poses, RigidTransform) or (isinstance(poses, np.ndarray) and poses.dtype.kind in "fiu"):
        # All at once, unless one is to be refused.
        at, _ = positions_and_rotations(robot, poses, None)
        if at.ndim == 2 and isinstance(poses, RigidTransform):
            return poses
        if at.ndim == 2 and np.isfinite(rows := np.asarray(poses)).all():
            turned = Rotation.from_euler("xyz", np.broadcast_to(rows[:, 3:] if rows.shape[1] > 3 else 0.0, at.shape))
            return RigidTransform.from_components(at, turned)
    found = listed("poses", poses, "a list of poses")
    if not found:
        raise InvalidInput("poses: found none, expected at least one")
    return RigidTransform.concatenate([robot.pose(pose) for pose in found])


def plane(name: str, at: float | None, points: int, robots: Sequence[Robot]) -> dict[str, np.ndarray]:
    """The coordinates of a plane through the robots' workspace.

    Args:
        name: its two axes, such as "xz".
        at: position along the third axis [m]; default: the middle of the workspace.
        points: number of points along its longer side; cells are square.
        robots: robots with a common workspace.

    Raises:
        InvalidInput: no such plane, too few points, or robots of different workspaces.
    """
    across = set(AXES) - set(name)
    if len(name) != 2 or len(across) != 1 or not set(name) <= set(AXES):
        raise InvalidInput(f"plane: found {name!r}, expected xy, xz or yz")
    if points < 2:
        raise InvalidInput(f"points: found {points}, expected at least 2")
    lower, upper = _shared_workspace(robots)
    extent = [upper[AXES.index(axis)] - lower[AXES.index(axis)] for axis in name]
    if not min(extent) > 0:
        raise InvalidInput(
            f"plane: found a workspace of {extent[0]:g} m by {extent[1]:g} m, expected a plane with an area"
        )
    axes = {}
    for i, axis in enumerate(AXES):
        if axis in across:
            axes[axis] = np.array([(lower[i] + upper[i]) / 2 if at is None else at])
        else:
            count = max(2, round(points * (upper[i] - lower[i]) / max(extent)))
            axes[axis] = np.linspace(lower[i], upper[i], count)
    return as_grid(axes, robots)  # type: ignore[return-value]


def extent_of(mask: xr.DataArray) -> float:
    """Area or volume of a mask over a grid [m³; m² or m where the grid is a plane or a line], by the trapezoidal rule.

    Poses on a face of the grid count half, those on an edge a quarter: the volume of where the mask is true, with an
    error of the layer of cells on its border. Zero for a single pose.
    """
    wide = [name for name in AXES if mask.sizes[name] > 1]
    covered = mask.astype(float)
    for name in wide:
        covered = covered.integrate(name)
    return float(covered.squeeze()) if wide else 0.0


def _counts(grid: Sequence[int]) -> list[int]:
    counts = checked_array("grid", grid, (3,))
    if not ((counts >= 1) & (counts == np.round(counts))).all():
        found = ", ".join(f"{count:g}" for count in counts)
        raise InvalidInput(f"grid: found ({found}), expected three whole numbers of at least 1, or coordinates by name")
    return [int(count) for count in counts]


def _coordinates(name: str, values: Sequence[float] | np.ndarray) -> np.ndarray:
    coordinates = np.atleast_1d(checked_array(f"grid[{name!r}]", values, None))
    if coordinates.ndim != 1 or coordinates.size == 0:
        raise InvalidInput(f"grid[{name!r}]: found an array of shape {coordinates.shape}, expected a list of numbers")
    if not (np.diff(coordinates) > 0).all():
        raise InvalidInput(f"grid[{name!r}]: found coordinates out of order or twice, expected them to ascend")
    return coordinates


def _shared_workspace(robots: Sequence[Robot]) -> np.ndarray:
    first = robots[0]
    for robot in robots[1:]:
        if not np.array_equal(robot.workspace, first.workspace):
            raise InvalidInput(
                f"grid: {first.name!r} and {robot.name!r} have different workspaces; "
                "expected the grid's coordinates, by name, for robots that are swept together"
            )
    return first.workspace

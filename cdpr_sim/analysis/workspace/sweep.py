"""The whole workspace at once: equilibria over a grid of commanded positions, as an ``xarray.Dataset``.

The compiled gufuncs go through ``xarray.apply_ufunc``: over NumPy arrays in one call, over chunks by Dask on threads,
out of core, or on the cluster to which a ``dask.distributed.Client`` is connected; the code is the same for all.
"""

from __future__ import annotations

import math
import shutil
import warnings
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import RigidTransform, Rotation

from cdpr_sim.analysis.workspace import store as stores
from cdpr_sim.analysis.workspace.feasibility import capacity_margin, feasible
from cdpr_sim.analysis.workspace.grids import AXES, GridLike, as_grid, as_poses
from cdpr_sim.core import extras, free_ram
from cdpr_sim.core.checks import FLAG, checked_array, checked_label, listed, one_of, refuse_unless, whole
from cdpr_sim.core.describe import cables_name
from cdpr_sim.core.errors import InvalidInput
from cdpr_sim.core.limits import checked_limits, checked_wrenches
from cdpr_sim.core.pose import PoseLike
from cdpr_sim.core.robot import Robot
from cdpr_sim.core.status import Status
from cdpr_sim.core.sweep_quantities import BySimulation, Quantity
from cdpr_sim.robots.catalogue import load_robot
from cdpr_sim.robots.robot_file_text import as_toml
from cdpr_sim.statics.newton import solve_many, stiffness_of

if TYPE_CHECKING:
    import xarray as xr

CHUNK = 32_768
"""Poses per task: half a second and 20 MB (``scripts/dev/measure_constants.py``), long in comparison with Dask's
overhead per task and small in comparison with memory."""

TASKS, LEAST_CHUNK = 8, 2_500
"""A small sweep is divided too, into this many tasks, unless they would have fewer poses than this."""

MOST_BITS = 63
"""Largest number of cables that ``slack_set`` can represent."""

MEMORY_COPIES = 2
"""Copies of a result that is computed in memory: the chunks, and the whole into which they are joined."""

COMPRESSION = 3
"""Largest compression of a store: numbers with noise in their last digits do not get smaller than a third."""

STATUSES = {
    int(status): status.name.lower()
    for status in Status
    if status not in (Status.DIVERGED, Status.MOVING, Status.TOO_SHORT)
}
"""Values of ``status``, as its CF flags."""


QUANTITIES = {
    "position": Quantity(("axis",), float, "m", "position of the platform's origin in the base frame"),
    "rotation_vector": Quantity(("axis",), float, "rad", "rotation of the platform, as axis times angle, base frame"),
    "deviation": Quantity(("axis",), float, "m", "position minus commanded position"),
    "distance": Quantity((), float, "m", "distance from the commanded position"),
    "tilt": Quantity((), float, "rad", "angle between the platform's z axis and the vertical"),
    "tensions": Quantity(("cable",), float, "N", "cable tensions, at the platform"),
    "slack_count": Quantity((), float, "1", "number of slack cables"),
    "slack_set": Quantity((), np.int64, "1", "slack cables, cable i as bit i − 1; −1 where there is no equilibrium"),
    "eigenvalues": Quantity(("mode",), float, "N m-1", "eigenvalues of the stiffness matrix, ascending"),
    "frequency": Quantity((), float, "Hz", "lowest natural frequency"),
    "residual": Quantity((), float, "N", "largest unbalanced force, torques over the characteristic length"),
    "iterations": Quantity((), np.int16, "1", "Newton iterations"),
    "status": Quantity((), np.int8, "1", "how the solve ended", STATUSES),
}
"""Quantities that a sweep computes at every pose; each is nan (with the reason in the status) where there is no
equilibrium."""

DEFAULT = (*QUANTITIES, "feasible")
"""Names of the quantities that are computed unless others are requested."""

RIGID = {
    "feasible": Quantity((), bool, "1", "rigid cables can hold the platform as commanded"),
    "capacity_margin": Quantity(
        (), float, "N",
        "by how much rigid cables' tensions can keep from their limits, as commanded; negative outside",
    ),
    "wrench_feasible": Quantity(
        (), bool, "1", "rigid cables can hold the platform as commanded against every one of the wrenches"
    ),
}  # fmt: skip
"""Quantities of rigid cables. ``capacity_margin`` takes longer than an equilibrium, and is computed only on request;
``wrench_feasible`` if a set of wrenches is given."""

ROBOT = {
    "frame": ("m", "two opposite corners of the frame"),
    "exits": ("m", "exit points of the cables, in the base frame"),
    "anchors": ("m", "anchor points of the cables, in the platform frame"),
    "axial_stiffness": ("N", "axial stiffness EA of the cables"),
    "linear_density": ("kg m-1", "mass per length of the cables"),
    "mass": ("kg", "mass of the platform"),
    "pretension": ("N", "pretension of the rest lengths at commanded poses; nan for rigid lengths"),
    "robot_file": ("", "the robot in full, as the text of its file, on its own cables"),
}
"""Coordinates that describe the robots: unit and meaning."""

_MODES = {"eigenvalues", "frequency"}


def sweep(
    robots: str | Robot | Sequence[str | Robot],
    grid: GridLike | None = None,
    materials: Sequence[str] | Mapping[str, float] | None = None,
    *,
    poses: RigidTransform | Sequence[PoseLike] | np.ndarray | None = None,
    orientation: ArrayLike = (0.0, 0.0, 0.0),
    external_wrench: ArrayLike | None = None,
    tension_limits: tuple[ArrayLike, ArrayLike] | None = None,
    wrenches: ArrayLike | None = None,
    quantities: Sequence[str] | None = None,
    chunk: int | None = CHUNK,
    compute: bool = True,
    store: str | Path | None = None,
    progress: bool = False,
) -> xr.Dataset:
    """Equilibria of the platform for every commanded position of a grid, for every robot and material.

    Args:
        robots: one robot or several, as objects, catalogue names or .toml files; several give a dimension ``robot``.
        grid: counts (nx, ny, nz) over the workspace, or coordinates {"x": ..., "y": ..., "z": ...} [m]; default: 10⁴.
        materials: names of the catalogue, or {name: EA [N]}; they give a dimension ``material``. Default: each robot's.
        poses: commanded poses, instead of a grid, all of them in memory: (rows, 3), (rows, 6), a stack of transforms or
            a list of poses; they give a dimension ``pose`` instead of x, y and z.
        orientation: on a grid, commanded, (alpha, beta, gamma) [rad]; default: level.
        external_wrench: force [N] and torque [N m] on the platform's origin, in the base frame, besides gravity, (6,).
        tension_limits: smallest and largest tension [N] for the feasible workspaces, one number or one per cable each;
            default: each robot's ``force_min`` and ``force_max``.
        wrenches: a set of external wrenches (sets, 6) [N, N m]: adds ``wrench_feasible``.
        quantities: names of ``QUANTITIES`` and "feasible", which are the default, without "eigenvalues" and "frequency"
            if cables of a robot have a memory; or "capacity_margin", which is zero
            on the border of the feasible workspace, between the poses of the grid; or "settled", which settles every
            pose in MuJoCo and compares it with statics as ``check`` does, in the variables of
            ``crosscheck.settled_quantities``. The status is always included.
        chunk: largest number of poses of a grid per Dask task; None: one call of NumPy, without Dask.
        compute: False for a Dataset of Dask arrays that are not computed yet, for other tools and clusters.
        store: a new .nc file, or a .zarr folder, in which an interrupted sweep is resumed, and of which all chunks are
            checked and lost or corrupt ones computed again; the result is then read from there, slab by slab as it is
            used.
        progress: show a progress bar on standard error.

    Returns:
        Variables over (robot, material, x, y, z), or (robot, material, pose), with units in their attributes.
        Coordinates describe the input: ``robot`` and ``material`` by name, those of ``ROBOT``, and ``wrenches``;
        attributes the orientation on a grid and the external wrench. ``feasible`` is whether rigid cables could hold
        the platform at the commanded pose itself.

    Raises:
        InvalidInput: an invalid grid, pose, name, limit or store, or a store for poses.
        UnknownName: no such robot, material or quantity.
        StoreError: the store cannot be written; its content is kept.

    Warns:
        StoreRepaired: something in the store was lost or corrupt, and was computed again.
    """
    extras.require("sweep", "sweep")
    import xarray as xr

    refuse_unless(FLAG, compute=compute, progress=progress)
    many = not isinstance(robots, (str, Robot))
    group = as_robots(robots)
    stack = None if poses is None else as_poses(poses, group[0], grid, orientation)
    if stack is not None and (store is not None or not compute):
        raise InvalidInput("poses: found them with a store or without compute, expected a grid for those")
    axes = as_grid(grid, group) if stack is None else {"pose": np.arange(len(stack))}
    variants = on_materials(group, materials)
    names = _checked_quantities(quantities, group)
    most = max(group, key=lambda robot: robot.cables)
    if "slack_set" in names and most.cables > MOST_BITS:
        raise InvalidInput(
            f"quantities: slack_set has bits for {MOST_BITS} cables at most, and {most.name!r} has {most.cables}; "
            "expected quantities without it"
        )
    turn = Rotation.from_euler("xyz", checked_array("orientation", orientation, (3,)))
    rotation = (turn if stack is None else stack.rotation).as_matrix()
    wrench = np.zeros(6) if external_wrench is None else checked_array("external_wrench", external_wrench, (6,))
    limits = [checked_limits(robot, tension_limits) for robot in group]
    for robot in group:
        checked_wrenches(robot, wrench)
        if wrenches is not None:
            checked_wrenches(robot, wrenches)
        robot.pose(np.r_[robot.home, orientation])
    settled = BySimulation.settled() if "settled" in names else None
    if chunk is not None:
        whole("chunk", chunk, 1)
    if store is not None:
        chunk = chunk or CHUNK
        store = stores.checked_path(store)
    chunk = chunk if stack is None else None
    if chunk is not None and settled is not None:
        chunk = min(chunk, settled.ROWS)
    threads = 0 if chunk is None else 1  # Dask computes chunks side by side
    blocks = None if chunk is None else _blocks(axes, 1 if materials is None else len(materials), chunk)
    if stack is None:
        points = _coordinates(axes, blocks)
    else:
        attrs = {"units": "m", "long_name": "commanded position"}
        points = [xr.DataArray(column, dims=("pose",), attrs=attrs) for column in stack.translation.T]

    if compute or store is not None:
        count = sum(map(len, variants.values())) * math.prod(len(values) for values in axes.values())
        kinds = [QUANTITIES[name] for name in names if name in QUANTITIES]
        kinds += [] if settled is None else settled.QUANTITIES.values()
        _refuse_what_cannot_fit(count, most.cables, kinds, store)
    rigid = {name: wrench for name in RIGID if name in names}
    if wrenches is not None:
        rigid["wrench_feasible"] = np.atleast_2d(wrenches) + wrench
    parts = []
    for robot in group:
        labels = {} if materials is None else {"material": list(materials)}
        each = [one.axial_stiffness for one in variants[robot.name]]
        stiffness = xr.DataArray(np.array(each if labels else each[0]), dims=(*labels, "cable"), coords=labels)
        # Robots that differ in stiffness alone are computed in one call.
        alike = [(slice(None), robot)]
        weighs = any((one.linear_density != robot.linear_density).any() for one in variants[robot.name])
        if weighs:
            alike = [(slice(row, row + 1), one) for row, one in enumerate(variants[robot.name])]
        pieces = []
        for rows, one in alike:
            some = stiffness.isel(material=rows) if labels else stiffness
            given: dict[str, Any] = dict(rotations=rotation, external_wrench=wrench)
            solved = {name: kind for name, kind in QUANTITIES.items() if name in names}
            piece = _arrays(_solved, solved, one, points, some, threads=threads, **given)
            if settled is not None:
                piece = piece.merge(_arrays(settled.compute, settled.QUANTITIES, one, points, some, **given))
            for name, loads in rigid.items():
                conditions: dict[str, Any] = dict(rotations=rotation, tension_limits=tension_limits, wrenches=loads)
                found = _arrays(_of_rigid_cables, {name: RIGID[name]}, one, points, threads=threads, **conditions)
                piece = piece.merge(found.expand_dims(material=some["material"]) if weighs else found)
            pieces.append(piece)
        part: xr.Dataset = pieces[0] if len(pieces) == 1 else xr.concat(pieces, "material")  # type: ignore[assignment]
        density = np.array([one.linear_density for one in variants[robot.name]]) if weighs else robot.linear_density
        parts.append(_with_robot(part, robot, stiffness, density))
    result = parts[0]
    if many:  # cables and modes that a robot does not have are nan
        per_robot = [*ROBOT, *({"material"} - set(result.dims))]
        result = xr.concat(parts, "robot", join="outer", data_vars="all", coords=per_robot, compat="equals")  # type: ignore[call-overload]
        assert isinstance(result, xr.Dataset)
    if stack is not None:
        result = result.assign_coords({name: point.variable for name, point in zip(AXES, points, strict=True)})
    if wrenches is not None:
        meaning = "external wrenches of the wrench-feasible workspace, besides gravity and external_wrench"
        attrs = {"units": "N, N m", "long_name": meaning}
        result = result.assign_coords(wrenches=(("wrench", "component"), np.atleast_2d(wrenches).astype(float), attrs))
    lower, upper = zip(*limits, strict=True)
    result.attrs = {
        "title": "Static equilibria of cable-driven parallel robots over their workspace",
        "source": "cdpr_sim.sweep",
        "Conventions": "CF-1.11",
        "orientation": np.asarray(orientation, dtype=float).tolist(),
        "external_wrench": wrench.tolist(),
        "tension_limits": [float(np.concatenate(lower).min()), float(np.concatenate(upper).max())],
    }
    if store is not None:
        variables = sorted(map(str, result.variables))
        identity = [group, axes, variants, rotation, wrench, limits, wrenches, variables, blocks]
        return stores.written(result, store, identity, progress=progress)
    return stores.computed(result, progress=progress) if compute and chunk is not None else result


def _refuse_what_cannot_fit(poses: int, cables: int, kinds: Sequence[Quantity], store: Path | None) -> None:
    """Refuse a grid whose result is too large for memory, or for the disk of the store."""
    sizes = {"axis": 3, "cable": cables, "mode": 6}
    each = sum(np.dtype(kind.dtype).itemsize * math.prod(sizes[dim] for dim in kind.dims) for kind in kinds) + 2
    what = f"grid: a sweep of {poses:,.0f} poses"
    if store is None or store.suffix == ".nc":
        copies = MEMORY_COPIES if store is None else MEMORY_COPIES + 1
        free_ram.refuse_beyond(what, copies * poses * each, "fewer poses, fewer quantities, or a .zarr store")
    else:
        free = shutil.disk_usage(store.parent).free
        if poses * each > COMPRESSION * free:
            raise InvalidInput(
                f"{what} would take about {free_ram.describe_size(poses * each)} before compression, and "
                f"{free_ram.describe_size(free)} are free in {store.parent}; expected fewer poses or "
                "fewer quantities"
            )


def as_robots(robots: str | Robot | Sequence[str | Robot]) -> list[Robot]:
    """One robot or several, as objects, catalogue names or .toml files.

    Raises:
        InvalidInput: none, something else, or two of the same name.
        UnknownName: no such robot.
    """
    group = [robots] if isinstance(robots, (str, Robot)) else listed("robots", robots, "robots or their names")
    group = [load_robot(one) if isinstance(one, str) else one for one in group]
    for robot in group:
        refuse_unless(Robot | str, robots=robot)
    names = [robot.name for robot in group]
    if not names:
        raise InvalidInput("robots: found none, expected at least one")
    for name in names:
        if names.count(name) > 1:
            raise InvalidInput(f"robots: found {names.count(name)} called {name!r}, expected a different name for each")
    return group


def on_materials(
    robots: Sequence[Robot], materials: Sequence[str] | Mapping[str, float] | None
) -> dict[str, list[Robot]]:
    """Each robot on the cables of each material, by its name; itself if no materials are given.

    Raises:
        InvalidInput: no material, one twice, or an axial stiffness that is not positive; a material whose mass per
            length is not known, for a robot whose cables have that of their material.
        UnknownName: no such material.
    """
    if materials is None:
        return {robot.name: [robot] for robot in robots}
    if isinstance(materials, str):
        raise InvalidInput(f"materials: found the text {materials!r}, expected a list of names")
    for name in listed("materials", materials, "a list of names"):
        checked_label("materials", name)
    if len(materials) == 0 or len(set(materials)) < len(materials):
        raise InvalidInput(f"materials: found {list(materials)}, expected at least one and none twice")
    if isinstance(materials, Mapping):
        values = checked_array("materials", list(materials.values()), (None,))
        if not values.min() > 0:
            raise InvalidInput(f"materials: found an axial stiffness of {values.min():g} N, expected more than 0")
        return {robot.name: [robot.replace(axial_stiffness=value) for value in values] for robot in robots}
    return {robot.name: [robot.replace(material=name) for name in materials] for robot in robots}


def default_quantities(robots: Sequence[Robot]) -> list[str]:
    """``DEFAULT``; if cables of a robot have a memory, those without stiffness, which they do not have."""
    remember = any(robot.cabling.has_memory.any() for robot in robots)
    return [name for name in DEFAULT if not (remember and name in _MODES)]


def _checked_quantities(quantities: Sequence[str] | None, robots: Sequence[Robot]) -> list[str]:
    if quantities is None:
        return default_quantities(robots)
    known = [*DEFAULT, "capacity_margin", "settled"]
    for name in listed("quantities", quantities, "a list of names"):
        one_of("quantity", name, known)
    if _MODES & set(quantities):
        for robot in robots:
            robot.cabling.refuse_memory()
    return [name for name in known if name in quantities or name == "status"]


def _blocks(axes: Mapping[str, np.ndarray], materials: int, chunk: int) -> dict[str, int]:
    """Coordinates per chunk along each axis: whole columns along z, then rows of them along y, then along x."""
    poses = materials * int(np.prod([len(values) for values in axes.values()]))
    left = min(chunk, max(LEAST_CHUNK, poses // TASKS)) // materials
    blocks = {}
    for name in reversed(AXES):
        pieces = -(-len(axes[name]) // max(1, left))
        blocks[name] = -(-len(axes[name]) // pieces)  # of nearly the same size
        left //= blocks[name]
    return blocks


def _coordinates(axes: Mapping[str, np.ndarray], blocks: Mapping[str, int] | None) -> list[xr.DataArray]:
    import xarray as xr

    points = []
    for name, values in axes.items():
        coordinate = xr.DataArray(values, dims=(name,), attrs={"units": "m", "long_name": f"commanded {name}"})
        point = xr.DataArray(values, dims=(name,), coords={name: coordinate}, name=f"commanded_{name}")
        points.append(point if blocks is None else point.chunk({name: blocks[name]}))
    return points


def _arrays(
    compute: Callable[..., Mapping[str, np.ndarray]],
    quantities: Mapping[str, Quantity],
    robot: Robot,
    points: Sequence[xr.DataArray],
    stiffness: xr.DataArray | None = None,
    **given: Any,
) -> xr.Dataset:
    """The quantities over the grid, by a function of a robot, of positions and of ``given``, which returns them."""
    import xarray as xr

    names, kinds = list(quantities), list(quantities.values())
    sizes = {"cable": robot.cables, "axis": 3, "mode": len(robot.free)}
    inputs = points if stiffness is None else (stiffness, *points)
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Increasing number of chunks")  # by Dask
        arrays = xr.apply_ufunc(
            _block,
            *inputs,
            kwargs=dict(**given, compute=compute, robot=robot, names=tuple(names)),
            input_core_dims=[["cable"]] * (stiffness is not None) + [[], [], []],
            output_core_dims=[list(kind.dims) for kind in kinds],
            output_dtypes=[kind.dtype for kind in kinds],
            dask="parallelized",
            dask_gufunc_kwargs={"output_sizes": {dim: sizes[dim] for kind in kinds for dim in kind.dims}},
        )
    dataset = xr.Dataset(dict(zip(names, arrays if len(names) > 1 else [arrays], strict=True)))
    for name, kind in quantities.items():
        dataset[name].attrs = kind.attrs
    return dataset


def _block(*arrays: np.ndarray, compute, robot, names, **given) -> tuple[np.ndarray, ...] | np.ndarray:
    """The quantities ``names`` over one block of the grid: what runs on each thread or worker."""
    *stiffness, x, y, z = arrays
    if stiffness:
        given["axial_stiffness"] = np.atleast_2d(stiffness[0])
    values = compute(robot, np.stack(np.broadcast_arrays(x, y, z), axis=-1), names=names, **given)
    return tuple(values[name] for name in names) if len(names) > 1 else values[names[0]]


def _solved(robot: Robot, commanded: np.ndarray, *, names: Sequence[str], **given: Any) -> dict[str, np.ndarray]:
    """Those of ``QUANTITIES`` that are wanted."""
    equilibria = solve_many(robot, commanded, **given)
    found = equilibria.converged
    eigenvalues, frequency = stiffness_of(equilibria) if _MODES & set(names) else (None, None)
    bits = 1 << np.arange(robot.cables, dtype=np.int64)
    read = {
        "position": lambda: equilibria.positions,
        "rotation_vector": lambda: rotation_vectors(equilibria.rotations, found),
        "deviation": lambda: equilibria.deviation,
        "distance": lambda: np.linalg.norm(equilibria.deviation, axis=-1),
        "tilt": lambda: equilibria.tilt,
        "tensions": lambda: equilibria.tensions,
        "slack_count": lambda: equilibria.slack.sum(-1),
        "slack_set": lambda: np.where(found, equilibria.slack @ bits, -1),
        "eigenvalues": lambda: eigenvalues,
        "frequency": lambda: frequency,
        "residual": lambda: equilibria.residuals,
        "iterations": lambda: equilibria.iterations,
        "status": lambda: equilibria.status,
    }
    return {name: as_stored(QUANTITIES[name], read[name](), found) for name in names}


def _of_rigid_cables(robot: Robot, commanded: np.ndarray, *, names: Sequence[str], **conditions: Any) -> dict[str, Any]:
    """One of ``RIGID``."""
    function = capacity_margin if names[0] == "capacity_margin" else feasible
    return {names[0]: function(robot, commanded, **conditions)}


def as_stored(kind: Quantity, values: np.ndarray, known: np.ndarray) -> np.ndarray:
    """Values of the type of their variable; nan where they are not ``known``, if that type has it."""
    stored = np.array(values, dtype=kind.dtype)
    if kind.dtype is float:
        stored[~known] = np.nan
    return stored


def rotation_vectors(rotations: np.ndarray, known: np.ndarray) -> np.ndarray:
    """Rotation matrices (..., 3, 3) as axis times angle [rad], (..., 3); nan where they are not ``known``."""
    vectors = np.full(rotations.shape[:-1], np.nan)
    if known.any():
        vectors[known] = Rotation.from_matrix(rotations[known], assume_valid=True).as_rotvec()  # twice as fast
    return vectors


def _with_robot(dataset: xr.Dataset, robot: Robot, stiffness: xr.DataArray, density: np.ndarray) -> xr.Dataset:
    """Add names of the axes, and coordinates that describe the robot."""
    described = {
        "frame": (("corner", "axis"), robot.frame),
        "exits": (("cable", "axis"), robot.exits),
        "anchors": (("cable", "axis"), robot.anchors),
        "axial_stiffness": (stiffness.dims, stiffness.values),
        "linear_density": (stiffness.dims[-density.ndim :], density),
        "mass": ((), robot.mass),
        "pretension": ((), np.nan if robot.pretension is None else robot.pretension),
        "robot_file": ((), as_toml(robot)),
    }
    coords: dict[str, Any] = {"robot": robot.name, "axis": list(AXES), "cable": np.arange(1, robot.cables + 1)}
    for name, (unit, meaning) in ROBOT.items():
        coords[name] = (*described[name], {"units": unit, "long_name": meaning} if unit else {"long_name": meaning})
    if "material" not in stiffness.dims:
        coords["material"] = cables_name(robot)
    if "mode" in dataset.dims:
        coords["mode"] = np.arange(1, len(robot.free) + 1)
    return dataset.assign_coords(coords)

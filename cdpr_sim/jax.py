"""The equilibrium as a function of JAX (extra ``jax``), with its derivatives by the implicit function theorem.

The equilibrium is computed by ``solve_many`` in NumPy, on the processor, in double precision; JAX calls it back. The
derivatives are those of ``sensitivity``, so that no step of the solver is differentiated. Forward and reverse mode,
``jit`` and ``vmap`` work; second derivatives do not.
"""

# pyright: reportMissingImports=false
# JAX is not among the packages for development.
from __future__ import annotations

import math
from collections.abc import Sequence
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from cdpr_sim.analysis.sensitivity import sensitivity
from cdpr_sim.core import extras
from cdpr_sim.core.cable import PROPERTIES
from cdpr_sim.core.checks import refuse_unless
from cdpr_sim.core.equilibrium import Stability
from cdpr_sim.core.equilibrium_batch import EquilibriumBatch
from cdpr_sim.core.errors import InvalidInput
from cdpr_sim.core.problem import Problems
from cdpr_sim.core.robot import Robot
from cdpr_sim.core.status import Status
from cdpr_sim.statics import derivatives, newton

extras.require("jax", "cdpr_sim.jax")

import jax  # noqa: E402
import jax.numpy as jnp  # noqa: E402
from jax.custom_derivatives import SymbolicZero  # noqa: E402

POSITIVE = ("rest_lengths", "axial_stiffness", "mass")
"""Parameters that are more than zero; elsewhere there is no equilibrium."""

PER_ROW = ("rest_lengths", "axial_stiffness", "mass", "external_wrench")
"""Parameters in which the rows of one ``solve_many`` may differ; rows with other robots are solved one after the
other."""


class Solution(NamedTuple):
    """Equilibria as arrays of JAX; nan where there is none.

    Attributes:
        position: of the platform, (..., 3) [m].
        rotation: its rotation matrix, (..., 3, 3).
        tensions: of the ropes, (..., cables) [N].
    """

    position: jax.Array
    rotation: jax.Array
    tensions: jax.Array


def solve(
    robot: Robot,
    pose: ArrayLike | jax.Array,
    rest_lengths: ArrayLike | jax.Array | None = None,
    *,
    external_wrench: ArrayLike | jax.Array | None = None,
    axial_stiffness: ArrayLike | jax.Array | None = None,
    mass: ArrayLike | jax.Array | None = None,
    exits: ArrayLike | jax.Array | None = None,
    anchors: ArrayLike | jax.Array | None = None,
    center_of_mass: ArrayLike | jax.Array | None = None,
    **properties: ArrayLike | jax.Array | None,
) -> Solution:
    """Static equilibria as a differentiable function of JAX.

    All arrays broadcast over the dimensions before their own; ``vmap`` adds such dimensions. Each parameter defaults to
    that of ``robot``. A row for which ``solve`` finds no equilibrium is nan.

    The derivatives are those for the present set of taut cables. Where a cable without mass is on the verge of
    slackness, the pose and the tensions are continuous, and their derivatives are not: the result is the derivative on
    one side, that of the slack cable where its length equals its rest length. They are nan in neutrally stable
    equilibria.

    Args:
        robot: the robot, a constant.
        pose: commanded poses, from which the solver starts, (..., 3) [m] or (..., 6) [m, rad]; not differentiated.
        rest_lengths: (..., cables) [m]; default: ``robot.rest_lengths(pose)``.
        external_wrench: (..., 6) [N, N m]; default: none.
        axial_stiffness: EA, a number, or (..., cables) [N].
        mass: (...) [kg].
        exits: (..., cables, 3) [m].
        anchors: (..., cables, 3) [m].
        center_of_mass: (..., 3) [m].
        properties: of robots whose cables have them, by name and in the units of ``Robot``, (..., cables), (...,
            cables, 2) or (..., cables, 3): those by which ``sensitivity`` has derivatives, as ``linear_density``.

    Returns:
        Positions [m], rotation matrices and tensions [N].

    Raises:
        InvalidInput: JAX computes in single precision; invalid shapes; a parameter that the robot does not have; a
            derivative by ``pose``.
        MissingExtra: JAX is not installed.
    """
    refuse_unless(Robot, robot=robot)
    robot.cabling.refuse_memory()
    if not jax.config.read("jax_enable_x64"):
        raise InvalidInput(
            "jax_enable_x64: found JAX in single precision, in which rounding of a rest length changes a stiff cable's "
            'tension visibly; expected jax.config.update("jax_enable_x64", True)'
        )
    given = {
        "rest_lengths": rest_lengths, "external_wrench": external_wrench, "axial_stiffness": axial_stiffness,
        "mass": mass, "exits": exits, "anchors": anchors, "center_of_mass": center_of_mass,
    } | properties  # fmt: skip
    values = {name: jnp.asarray(value, dtype=float) for name, value in given.items() if value is not None}
    if "axial_stiffness" in values and values["axial_stiffness"].ndim == 0:
        values["axial_stiffness"] = jnp.broadcast_to(values["axial_stiffness"], (robot.cables,))
    shapes = _shapes(robot)
    for name, value in values.items():
        if name not in shapes:
            raise InvalidInput(f"{name}: found one for {robot.name!r}, which has none; expected it left out")
        if value.shape[value.ndim - len(shapes[name]) :] != shapes[name] or value.ndim < len(shapes[name]):
            expected = ", ".join(["...", *map(str, shapes[name])])
            raise InvalidInput(f"{name}: found an array of shape {value.shape}, expected ({expected})")
    start = jnp.asarray(pose, dtype=float)
    if start.shape[-1:] not in ((3,), (6,)):
        raise InvalidInput(f"pose: found an array of shape {start.shape}, expected (..., 3) or (..., 6)")
    before = [start.shape[:-1], *(value.shape[: value.ndim - len(shapes[name])] for name, value in values.items())]
    try:
        batch = np.broadcast_shapes(*before)
    except ValueError:
        found = ", ".join(f"{name} {shape}" for name, shape in zip(["pose", *values], before, strict=True) if shape)
        raise InvalidInput(f"shapes before the last dimensions do not fit one another: {found}") from None
    every = {"pose": start.shape[-1:]} | {name: shapes[name] for name in values}
    arrays = zip((start, *values.values()), every.values(), strict=True)
    return _equilibrium(robot, tuple(values), *(jnp.broadcast_to(one, batch + own) for one, own in arrays))


def _shapes(robot: Robot) -> dict[str, tuple[int, ...]]:
    """Shape of each parameter of one equilibrium."""
    every = {"rest_lengths": (robot.cables,), "external_wrench": (6,), "mass": (), "center_of_mass": (3,)}
    every |= {name: (robot.cables, *one.shape) for name, one in PROPERTIES.items()}
    return {name: every[name] for name in derivatives.parameters(robot)}


@partial(jax.custom_jvp, nondiff_argnums=(0, 1))
def _equilibrium(robot: Robot, names: Sequence[str], pose: jax.Array, *values: jax.Array) -> Solution:
    return Solution(*_called_back(robot, names, (), pose, *values))


def _jvp(robot: Robot, names: Sequence[str], primals: Sequence[Any], tangents: Sequence[Any]) -> tuple[Any, Any]:
    """The derivatives along ``tangents``: linear in them, so that JAX transposes them for reverse mode."""
    if not isinstance(tangents[0], SymbolicZero):
        raise InvalidInput("pose: found a derivative by the commanded pose, expected one by rest_lengths")
    steps = {name: step for name, step in zip(names, tangents[1:], strict=True) if not isinstance(step, SymbolicZero)}
    *found, by_pose, by_tensions = _called_back(robot, names, tuple(steps), *primals)
    flat = [step.reshape(*found[0].shape[:-1], -1) for step in steps.values()]
    step = jnp.concatenate(flat, axis=-1)[..., None]
    pose, tensions = (by_pose @ step)[..., 0], (by_tensions @ step)[..., 0]
    turned = jnp.cross(pose[..., None, 3:], found[1], axisb=-2, axisc=-2)
    return Solution(*found), Solution(pose[..., :3], turned, tensions)


_equilibrium.defjvp(_jvp, symbolic_zeros=True)


def _called_back(robot: Robot, names: Sequence[str], by: Sequence[str], *arrays: jax.Array) -> Sequence[jax.Array]:
    """Results of ``_on_host`` as arrays of JAX."""
    shapes, batch = _shapes(robot), arrays[0].shape[:-1]
    columns = sum(math.prod(shapes[name]) for name in by)
    kinds = [(3,), (3, 3), (robot.cables,), *([(6, columns), (robot.cables, columns)] if by else [])]
    results = [jax.ShapeDtypeStruct((*batch, *kind), np.float64) for kind in kinds]
    return jax.pure_callback(partial(_on_host, robot, names, by, kinds), results, *arrays, vmap_method="broadcast_all")


def _on_host(
    robot: Robot, names: Sequence[str], by: Sequence[str], kinds: Sequence[tuple[int, ...]], pose: Any, *values: Any
) -> list[np.ndarray]:
    """Positions, rotations and tensions, and with ``by`` the derivatives of pose and tensions by those parameters."""
    shapes, batch = {"pose": pose.shape[-1:], **_shapes(robot)}, pose.shape[:-1]
    rows = {
        name: np.asarray(one, dtype=float).reshape(-1, *shapes[name])
        for name, one in zip(("pose", *names), (pose, *values), strict=True)
    }
    count = len(rows["pose"])
    results = [np.full((count, *kind), np.nan) for kind in kinds]
    possible = np.ones(count, dtype=bool)
    for name, row in rows.items():
        core = tuple(range(1, row.ndim))
        possible &= np.isfinite(row).all(core) & ((row > 0).all(core) if name in POSITIVE else True)
    if "rest_lengths" not in rows:
        believed = Problems.of(robot, np.where(np.isfinite(rows["pose"]), rows["pose"], 0.0))
        rows["rest_lengths"] = believed.rest_lengths
        possible &= believed.refusals == Status.PENDING
    ours = [name for name in names if name not in PER_ROW]
    where = np.flatnonzero(possible)
    keys = np.concatenate(
        [rows[name][where].reshape(len(where), -1) for name in ours] or [np.empty((len(where), 0))], 1
    )
    groups = np.unique(keys, axis=0, return_inverse=True)[1].ravel() if ours else np.zeros(len(where), dtype=int)
    for group in range(groups.max(initial=-1) + 1):
        some = where[groups == group]
        one = robot.replace(**{name: rows[name][some[0]] for name in ours}) if ours else robot
        each: dict[str, Any] = {name: rows[name][some] for name in PER_ROW if name in rows}
        found = newton.solve_many(one, rows["pose"][some], **each)
        for result, seen in zip(results, (found.positions, found.rotations, found.tensions), strict=False):
            result[some[found.converged]] = seen[found.converged]
        if by:
            for row in np.flatnonzero(found.converged):
                for result, slopes in zip(results[3:], _slopes(found, int(row), by), strict=True):
                    result[some[row]] = slopes
    return [result.reshape(*batch, *kind) for result, kind in zip(results, kinds, strict=True)]


def _slopes(found: EquilibriumBatch, row: int, by: Sequence[str]) -> tuple[np.ndarray | float, np.ndarray | float]:
    """Derivatives of the pose and the tensions of a row by all numbers of ``by``; nan in a neutral equilibrium."""
    point = found.point(row)
    if point.stability is Stability.NEUTRAL:
        return np.nan, np.nan
    exact = sensitivity(point)
    pose, tensions = (np.concatenate([of[name] for name in by], axis=1) for of in (exact.pose, exact.tensions))
    return pose, tensions

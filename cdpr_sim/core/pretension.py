"""Rest lengths under given tensions that balance the load, or under those that balance it and are near a pretension.

Functions take the robot, whose class uses them.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np
from jaxtyping import Bool, Float
from numpy.typing import ArrayLike

from cdpr_sim.core import cable_law, cable_path
from cdpr_sim.core.cable import MOST_STRAIN
from cdpr_sim.core.checks import checked_array
from cdpr_sim.core.errors import InvalidInput
from cdpr_sim.core.pose import Pose
from cdpr_sim.core.with_mass import WithMass

Robot = Any
"""A robot, whose class imports this module."""

BALANCED = 1e-3
"""Fraction of the largest tension that given tensions may leave unbalanced. Four digits of a printed table suffice."""

DIRECTIONS, SETTLED = 30, 1e-12
"""Choices of tensions nearest to a pretension, of cables with mass, each with the directions of the last, which come
nearer tenfold or more; and the fraction of the load that may then be left unbalanced."""


@dataclass(frozen=True, eq=False)
class Balance:
    """Tensions that should balance the load at some poses.

    Attributes:
        tensions: of the ropes, (..., cables) [N].
        left: largest unbalanced force, torques over the characteristic length, (...) [N].
        balanced: whether that is only rounding, (...).
        within: whether each is within the cable's force limits, (..., cables).
    """

    tensions: Float[np.ndarray, "*batch cables"]
    left: Float[np.ndarray, "*batch"]
    balanced: Bool[np.ndarray, "*batch"]
    within: Bool[np.ndarray, "*batch cables"]


def balance(
    robot: Robot,
    positions: Float[np.ndarray, "*#batch 3"],
    rotations: Float[np.ndarray, "*#batch 3 3"],
    wanted: Float[np.ndarray, "*cables"],
    wrench: Float[np.ndarray, "6"],
    cut: Callable,
) -> Balance:
    """The given tensions, (cables,), or those nearest to a number, which balance the load, at one pose or many.

    Args:
        robot: the robot.
        positions: [m].
        rotations: matrices.
        wanted: tensions [N], or a number.
        wrench: external force [N] and torque [N m], besides gravity.
        cut: gives the rest lengths under tensions, and the wrench matrix then, for cables with mass.
    """
    free, units = robot.free, robot.units
    weight = np.array([0.0, 0.0, -robot.weight])
    about = np.cross(rotations @ robot.center_of_mass, weight)
    load = (np.concatenate([np.broadcast_to(weight, about.shape), about], axis=-1) + wrench) / units
    matrix = cable_path.wrench_matrix(robot.cabling, positions, rotations)
    shape = matrix.shape[:-2]
    load = np.broadcast_to(load[..., free], (*shape, len(free)))

    def on_free(matrix: np.ndarray) -> np.ndarray:
        scaled = (matrix / units[:, None])[..., free, :]
        return np.where(np.isfinite(scaled).all((-1, -2), keepdims=True), scaled, 0.0)

    def nearest() -> Float[np.ndarray, "*batch cables"]:
        unbalanced = matrix.sum(-1) * wanted + load
        return wanted - (np.linalg.pinv(matrix) @ unbalanced[..., None])[..., 0]

    matrix = on_free(matrix)
    pulls = np.broadcast_to(wanted, (*shape, robot.cables)).copy()
    for _ in range(0 if robot.cabling.springs else DIRECTIONS):
        # Cables that are no springs pull in directions that depend on their tensions.
        before = pulls
        if wanted.ndim == 0:
            pulls = nearest()
        possible = pulls.min(-1) >= 0
        if not possible.any():
            break
        turned = on_free(cut(robot, positions, rotations, np.where(possible[..., None], pulls, np.abs(before)))[1])
        matrix = np.where(possible[..., None, None], turned, matrix)
        moved = np.abs(pulls - before).max(-1) > SETTLED * np.abs(pulls).max(-1)
        if wanted.ndim or not (moved & possible).any():
            break
    if wanted.ndim == 0:
        pulls = nearest()
    left = np.asarray(np.abs((matrix @ pulls[..., None])[..., 0] + load).max(-1))
    scale = np.maximum(np.abs(load).max(-1), pulls.max(-1))
    within = (pulls >= robot.cabling.force_min) & (pulls <= robot.cabling.force_max)
    return Balance(pulls, left, np.asarray(left <= BALANCED * scale), np.asarray(within))


def lengths_under(
    robot: Robot, at: Pose, tensions: ArrayLike, external_wrench: ArrayLike | None, field: str = "tensions"
) -> Float[np.ndarray, " cables"]:
    """Rest lengths [m] for tensions, one per cable, which are checked to balance the load, or for a pretension.

    Raises:
        InvalidInput: as ``Robot.rest_lengths``; messages begin with ``field``.
    """
    wanted = checked_array(field, tensions, None)
    if wanted.ndim:
        wanted = checked_array(field, wanted, (robot.cables,))
    if wanted.min() < 0:
        raise InvalidInput(f"{field}: found {wanted.min():g} N, expected 0 or more: cables only pull")
    wrench = np.zeros(6) if external_wrench is None else checked_array("external_wrench", external_wrench, (6,))
    where = at.position, at.rotation_matrix

    def cut(robot: Robot, *given: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        _refuse_beyond_law(robot, given[-1], field)
        return WithMass.cut(robot, *given, field=field)

    found = balance(robot, *where, wanted, wrench, cut)
    if not found.balanced:
        raise InvalidInput(
            f"{field}: found that they leave {found.left:.3g} N unbalanced at the pose, expected tensions that balance "
            "the load there; give one number for the nearest ones, or use compensate for any within limits"
            if wanted.ndim
            else f"{field}: found none near {wanted:g} N that balance the load at the pose: cables that pull or "
            f"push leave {found.left:.3g} N, expected a pose at which they can carry it"
        )
    if wanted.ndim == 0 and not found.within.all():
        cable = int(np.argmin(found.within))
        low, high = robot.cabling.force_min[cable], robot.cabling.force_max[cable]
        raise InvalidInput(
            f"{field}: found {found.tensions[cable]:.4g} N in cable {cable + 1} where tensions nearest to {wanted:g} N "
            f"balance the load at the pose, expected {low:g} to {high:g} N; another pretension may "
            "do, and compensate finds tensions within limits"
        )
    return cut(robot, *where, found.tensions)[0]


def commanded_lengths(
    robot: Robot,
    positions: Float[np.ndarray, "*#at 3"],
    rotations: Float[np.ndarray, "*#at 3 3"],
    axial_stiffness: Float[np.ndarray, "*#kinds cables"] | None = None,
    mass: Float[np.ndarray, "*#kinds"] | None = None,
) -> Float[np.ndarray, "*rows cables"]:
    """``Robot.rest_lengths`` at many poses, of cables of other stiffness [N] and with another mass [kg] if given.

    All arguments broadcast; without a pretension, stiffness and mass have no effect.

    nan where a cable has no path, or where no tensions near the robot's pretension hold the platform.
    """
    rigid = cable_path.lengths(robot.cabling, positions, rotations)
    if robot.pretension is None:
        return rigid
    stiffness = robot.axial_stiffness if axial_stiffness is None else axial_stiffness
    masses = np.array(robot.mass) if mass is None else mass
    outer = np.broadcast_shapes(stiffness.shape[:-1], masses.shape)
    parts = (stiffness, robot.cables), (masses[..., None], 1)
    keys = np.concatenate([np.broadcast_to(part, (*outer, columns)) for part, columns in parts], axis=-1)
    shape = np.broadcast_shapes(rigid.shape[:-1], keys.shape[:-1])
    kinds, which = np.unique(keys.reshape(-1, keys.shape[-1]), axis=0, return_inverse=True)
    which = np.broadcast_to(which.reshape(keys.shape[:-1]), shape)
    at, turned = np.broadcast_to(positions, (*shape, 3)), np.broadcast_to(rotations, (*shape, 3, 3))
    found = np.full((*shape, robot.cables), np.nan)
    for number, kind in enumerate(kinds):
        rows = which == number
        same = mass is None and axial_stiffness is None
        one = robot if same else robot.replace(axial_stiffness=kind[:-1], mass=kind[-1])
        found[rows] = _pretensioned(one, at[rows], turned[rows])
    return found


def _pretensioned(
    robot: Robot, positions: Float[np.ndarray, "rows 3"], rotations: Float[np.ndarray, "rows 3 3"]
) -> Float[np.ndarray, "rows cables"]:
    with np.errstate(all="ignore"):
        found = balance(robot, positions, rotations, np.array(robot.pretension), np.zeros(6), _cut)
        most = cable_law.largest_tension(robot.cabling.law)
        held = found.balanced & found.within.all(-1) & (found.tensions <= most).all(-1)
        rest, _ = _cut(robot, positions, rotations, np.where(held[:, None], found.tensions, np.abs(found.tensions)))
        return np.where((held & (rest > robot.cabling.least_lengths).all(-1))[:, None], rest, np.nan)


def _cut(robot: Robot, *given: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    return WithMass.cut(robot, *given, refuse=False)


Machine = TypeVar("Machine")


def without_pretension(robot: Machine) -> Machine:
    """The robot whose rest lengths at a pose are those of rigid cables."""
    machine: Any = robot
    return robot if machine.pretension is None else machine.replace(pretension=None)


def _refuse_beyond_law(robot: Robot, pulls: Float[np.ndarray, " cables"], field: str) -> None:
    most = cable_law.largest_tension(robot.cabling.law)
    if (pulls > most).any():
        cable = int(np.argmax(pulls > most))
        raise InvalidInput(
            f"{field}: found {pulls[cable]:.4g} N in cable {cable + 1}, expected at most {most[cable]:.4g} N, a "
            f"strain of {MOST_STRAIN:.0%}, up to which its nonlinear law is defined"
        )

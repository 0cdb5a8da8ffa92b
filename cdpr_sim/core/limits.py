"""Checks of tension limits and of sets of wrenches: one row per cable or per wrench."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float
from numpy.typing import ArrayLike

from cdpr_sim.core.checks import as_numbers, checked_array, refuse_unless, shown
from cdpr_sim.core.errors import InvalidInput
from cdpr_sim.core.problem import refuse_wrench_out_of_plane
from cdpr_sim.core.robot import Robot


def checked_limits(
    robot: Robot, tension_limits: Sequence[ArrayLike] | np.ndarray | None, field: str = "tension_limits"
) -> tuple[Float[np.ndarray, " cables"], Float[np.ndarray, " cables"]]:
    """Tension limits, one per cable, (cables,) and (cables,) [N]; by default the robot's own.

    Raises:
        InvalidInput: no robot; not a pair, nan, negative, or a smallest tension above the largest.
    """
    refuse_unless(Robot, robot=robot)
    if tension_limits is None:
        return robot.force_min.copy(), robot.force_max.copy()
    try:
        lower, upper = (np.broadcast_to(as_numbers(field, limit), (robot.cables,)).copy() for limit in tension_limits)
    except (TypeError, ValueError):
        raise InvalidInput(
            f"{field}: found {shown(tension_limits)}, expected (smallest, largest) [N], each one number or "
            f"one for each of the {robot.cables} cables of {robot.name!r}"
        ) from None
    if not (np.isfinite(lower).all() and (lower >= 0).all()):
        raise InvalidInput(
            f"{field}: found a smallest tension of {lower.min():g} N, expected 0 or more: cables only pull"
        )
    if not (lower <= upper).all():  # also if one is nan
        cable = int(np.argmin(lower <= upper))
        raise InvalidInput(
            f"{field}: found a smallest tension of {lower[cable]:g} N above the largest, {upper[cable]:g} N, "
            f"in cable {cable + 1}; expected tau_min <= tau_max"
        )
    return lower, upper


def checked_wrenches(robot: Robot, wrenches: ArrayLike | None) -> Float[np.ndarray, "sets 6"]:
    """External wrenches on the platform's origin, (sets, 6) [N, N m]; by default a single one, of zero.

    Raises:
        InvalidInput: an empty set, not wrenches, or one out of the plane of a planar robot.
    """
    loads = np.atleast_2d(checked_array("wrenches", np.zeros(6) if wrenches is None else wrenches, None))
    loads = checked_array("wrenches", loads, (None, 6))
    if len(loads) == 0:
        raise InvalidInput("wrenches: found an empty set, expected at least one wrench (6,)")
    refuse_wrench_out_of_plane(robot, loads, "wrenches")
    return loads

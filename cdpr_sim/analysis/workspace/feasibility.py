"""Which poses can rigid cables hold at all, with tensions within limits? The feasible workspaces, by two roads.

A wrench w_e on the platform can be held at a pose where

    W tau + w_e = 0,    tau_min ≤ tau ≤ tau_max

has a solution (paper Eq. 3). The *static* feasible workspace asks it of the weight (and an external wrench, if there is
one); the *wrench-feasible* workspace of every wrench of a set: all wrenches in their convex hull are then feasible too
(Bosscher, Riechel, Ebert-Uphoff 2006, doi:10.1109/TRO.2006.878967).

The fast road minimises ‖W tau + w_e‖² within the limits by the active-set method of Stark and Parker (1995, "Bounded-
variable least squares", Computational Statistics 10), compiled. It is finite, and both of its answers are proofs:
either tensions that balance the load, or a residual r with rᵀ(W tau + w_e) ≥ ‖r‖² > 0 for all tensions within the
limits, a direction in which the cables cannot pull enough (Farkas). The reference is linear programming, by HiGHS.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from jaxtyping import Bool, Float
from numba import float64, guvectorize, int64, njit
from numpy.typing import ArrayLike

from cdpr_sim.statics import forces as statics
from cdpr_sim.core.compiling import built_once
from cdpr_sim.core.errors import InvalidInput
from cdpr_sim.core.problem import Problem
from cdpr_sim.core.robot import Robot, checked_array

Array = np.ndarray

BALANCED = 1e-9
"""Unbalanced force, as a fraction of the load, that still counts as balance. Where forces do balance, what is left
is rounding, 1e-15; at 1e-9 outside the workspace, a micrometre decides."""

ROUNDING = 1e-12
"""A slope smaller than this fraction of the load is rounding: that tension is where it should be."""

DEPENDENT = 1e-10
"""A column shorter than this after projection, as a fraction of itself, depends on the others."""

MOST_CHANGES = 100
"""Of the active set. Eight cables need five to twelve; where rounding makes the sets cycle, HiGHS decides."""

SLACK_TO_ANYTHING = (0.0, np.inf)
"""Tension limits [N] of cables that pull as hard as it takes."""

_inline = njit(cache=True, error_model="numpy", forceinline=True)


def unbalanced(
    robot: Robot,
    positions: ArrayLike,
    *,
    rotations: ArrayLike | None = None,
    tension_limits: tuple[ArrayLike, ArrayLike] = SLACK_TO_ANYTHING,
    wrenches: ArrayLike | None = None,
) -> Float[Array, "*batch"]:
    """What is left of the load when the cables do their best, as a fraction of the load; rounding where feasible.

    Args:
        robot: the robot.
        positions: (..., 3) [m].
        rotations: (..., 3, 3); default: level.
        tension_limits: smallest and largest tension [N], each one number or one per cable.
        wrenches: external forces and torques on the platform's origin besides gravity, (6,) or a set of them (sets, 6)
            [N, N m]; the worst one counts. Default: none.

    Returns:
        The norm of W tau + w_e at the tensions that make it least, torques divided by the characteristic length, over
        the largest norm of w_e. Nan where a pose is not finite or an anchor lies on its exit.

    Raises:
        InvalidInput: limits or wrenches that cannot be right.
    """
    lower, upper = checked_limits(robot, tension_limits)
    loads = checked_wrenches(robot, wrenches)
    positions = np.asarray(positions, dtype=float)
    if positions.shape[-1:] != (3,):
        raise InvalidInput(f"positions: found an array of shape {positions.shape}, expected (..., 3)")
    rotations = np.eye(3) if rotations is None else np.asarray(rotations, dtype=float)
    free = np.array(robot.free_directions)
    with np.errstate(all="ignore"):
        left = np.asarray(
            _unbalanced_gufunc()(
                robot.exits, robot.anchors, lower, upper, robot.weight, robot.center_of_mass, loads, free,
                robot.characteristic_length, positions, rotations,
            )
        )  # fmt: skip
    for index in np.argwhere(np.isposinf(left)):  # the sets cycled
        at = tuple(index)
        position = np.broadcast_to(positions, (*left.shape, 3))[at]
        rotation = np.broadcast_to(rotations, (*left.shape, 3, 3))[at]
        left[at] = max(_least_by_linprog(robot, position, rotation, lower, upper, load) for load in loads)
    return left


def feasible(
    robot: Robot,
    positions: ArrayLike,
    *,
    rotations: ArrayLike | None = None,
    tension_limits: tuple[ArrayLike, ArrayLike] = SLACK_TO_ANYTHING,
    wrenches: ArrayLike | None = None,
) -> Bool[Array, "*batch"]:
    """Whether rigid cables hold the platform there, with tensions within limits, against its weight and ``wrenches``.

    Arguments and errors as in ``unbalanced``. Without wrenches this is the static feasible workspace (what ARACHNIS
    computes); with a set of them, the wrench-feasible workspace of their convex hull.
    """
    left = unbalanced(robot, positions, rotations=rotations, tension_limits=tension_limits, wrenches=wrenches)
    return left <= BALANCED


def feasible_by_linprog(
    robot: Robot,
    position: ArrayLike,
    rotation: ArrayLike | None = None,
    *,
    tension_limits: tuple[ArrayLike, ArrayLike] = SLACK_TO_ANYTHING,
    wrenches: ArrayLike | None = None,
) -> bool:
    """The reference for ``feasible``, at one pose: linear programming by HiGHS, to its tolerance of 1e-7.

    Raises:
        InvalidInput: limits or wrenches that cannot be right.
    """
    lower, upper = checked_limits(robot, tension_limits)
    rotation = np.eye(3) if rotation is None else np.asarray(rotation, dtype=float)
    return all(
        _balance_by_linprog(robot, np.asarray(position, dtype=float), rotation, lower, upper, load)
        for load in checked_wrenches(robot, wrenches)
    )


def checked_limits(
    robot: Robot, tension_limits: tuple[ArrayLike, ArrayLike]
) -> tuple[Float[Array, " cables"], Float[Array, " cables"]]:
    """Tension limits, one per cable, (cables,) and (cables,) [N].

    Raises:
        InvalidInput: not a pair, nan, negative, or a smallest tension above the largest.
    """
    try:
        pair = [np.asarray(limit, dtype=float) for limit in tension_limits]
        lower, upper = (np.broadcast_to(limit, (robot.cables,)).copy() for limit in pair)
    except (TypeError, ValueError):
        raise InvalidInput(
            f"tension_limits: found {tension_limits!r}, expected (smallest, largest) [N], each one number or one for "
            f"each of the {robot.cables} cables of {robot.name!r}"
        ) from None
    if not (np.isfinite(lower).all() and (lower >= 0).all()):
        raise InvalidInput(f"tension_limits: found a smallest tension of {lower.min():g} N, expected 0 or more")
    if not (lower <= upper).all():  # also where one is nan
        cable = int(np.argmin(lower <= upper))
        raise InvalidInput(
            f"tension_limits: found a smallest tension of {lower[cable]:g} N above the largest, {upper[cable]:g} N, "
            f"in cable {cable + 1}; expected tau_min <= tau_max"
        )
    return lower, upper


def checked_wrenches(robot: Robot, wrenches: ArrayLike | None) -> Float[Array, "sets 6"]:
    """External wrenches on the platform's origin, (sets, 6) [N, N m]; a single one, of zero, for none.

    Raises:
        InvalidInput: an empty set, not wrenches, or one that a planar robot cannot take.
    """
    loads = np.atleast_2d(checked_array("wrenches", np.zeros(6) if wrenches is None else wrenches, None))
    loads = checked_array("wrenches", loads, (None, 6))
    if len(loads) == 0:
        raise InvalidInput("wrenches: found an empty set, expected at least one wrench (6,)")
    held = np.setdiff1d(np.arange(6), robot.free_directions)
    if loads[:, held].any():
        raise InvalidInput(
            f"wrenches: found one out of the plane, but {robot.name!r} is planar: "
            "expected only forces along x and z and a torque about y"
        )
    return loads


def _system(
    robot: Robot, position: Float[Array, "3"], rotation: Float[Array, "3 3"], wrench: Float[Array, "6"]
) -> tuple[Float[Array, "free cables"], Float[Array, " free"]]:
    """W and w_e on the free directions, torques divided by the characteristic length, in units of the load."""
    free = list(robot.free_directions)
    units = np.repeat([1.0, robot.characteristic_length], 3)
    W = statics.wrench_matrix(robot, position, rotation) / units[:, None]
    problem = Problem(robot, robot.pose(robot.home), np.ones(robot.cables), wrench)
    load = (statics.load_wrench(problem, rotation) / units)[free]
    return W[free], load / (np.linalg.norm(load) or 1.0)


def _balance_by_linprog(robot, position, rotation, lower, upper, wrench) -> bool:
    from scipy.optimize import linprog

    W, load = _system(robot, position, rotation, wrench)
    scale = _load_of(robot, rotation, wrench)
    bounds = np.column_stack([lower, upper]) / scale
    result = linprog(np.zeros(robot.cables), A_eq=W, b_eq=-load, bounds=bounds, method="highs")
    return result.status == 0


def _least_by_linprog(robot, position, rotation, lower, upper, wrench) -> float:
    """The least largest component of W tau + w_e, over the load: as ``unbalanced``, in another norm."""
    from scipy.optimize import linprog

    W, load = _system(robot, position, rotation, wrench)
    rows = len(load)
    scale = _load_of(robot, rotation, wrench)
    A = np.block([[W, -np.ones((rows, 1))], [-W, -np.ones((rows, 1))]])
    bounds = np.vstack([np.column_stack([lower, upper]) / scale, [0.0, np.inf]])
    result = linprog(np.append(np.zeros(robot.cables), 1.0), A_ub=A, b_ub=np.append(-load, load), bounds=bounds)
    return float(result.fun) if result.status == 0 else np.nan


def _load_of(robot, rotation, wrench) -> float:
    units = np.repeat([1.0, robot.characteristic_length], 3)
    problem = Problem(robot, robot.pose(robot.home), np.ones(robot.cables), wrench)
    return float(np.linalg.norm((statics.load_wrench(problem, rotation) / units)[list(robot.free_directions)])) or 1.0


@built_once
def _unbalanced_gufunc() -> Callable:
    """``unbalanced`` as a gufunc: inf where the active sets cycle, nan where the input is not finite."""
    vector, matrix = float64[:], float64[:, :]
    inputs = (matrix, matrix, vector, vector, float64, vector, matrix, int64[:], float64, vector, matrix)
    return guvectorize(
        [(*inputs, vector)], "(m,c),(m,c),(m),(m),(),(c),(k,d),(f),(),(c),(c,c)->()", cache=True
    )(_unbalanced)  # fmt: skip


def _unbalanced(exits, anchors, lower, upper, weight, com, wrenches, free, scale, position, rotation, left):
    """One element of the gufunc."""
    m, n = len(lower), len(free)
    W, w = np.empty((6, m)), np.empty(6)
    on_free, load, height = np.empty((n, m)), np.empty(n), np.empty(m)
    r, c = np.empty(3), np.empty(3)
    for i in range(m):
        length2 = 0.0
        for a in range(3):
            r[a] = rotation[a, 0] * anchors[i, 0] + rotation[a, 1] * anchors[i, 1] + rotation[a, 2] * anchors[i, 2]
            W[a, i] = exits[i, a] - position[a] - r[a]
            length2 += W[a, i] ** 2
        length = np.sqrt(length2)
        for a in range(3):
            W[a, i] /= length
        W[3, i] = (r[1] * W[2, i] - r[2] * W[1, i]) / scale
        W[4, i] = (r[2] * W[0, i] - r[0] * W[2, i]) / scale
        W[5, i] = (r[0] * W[1, i] - r[1] * W[0, i]) / scale
        for a in range(n):
            on_free[a, i] = W[free[a], i]
        if not np.isfinite(length) or length == 0.0:
            left[0] = np.nan
            return
    for a in range(3):
        c[a] = rotation[a, 0] * com[0] + rotation[a, 1] * com[1] + rotation[a, 2] * com[2]
    left[0] = 0.0
    for k in range(len(wrenches)):
        w[0], w[1], w[2] = wrenches[k, 0], wrenches[k, 1], wrenches[k, 2] - weight
        w[3] = (wrenches[k, 3] - c[1] * weight) / scale
        w[4] = (wrenches[k, 4] + c[0] * weight) / scale
        w[5] = wrenches[k, 5] / scale
        norm2 = 0.0
        for a in range(n):
            norm2 += w[free[a]] ** 2
        norm = np.sqrt(norm2) if norm2 > 0 else 1.0
        for a in range(n):
            load[a] = w[free[a]] / norm
        for i in range(m):
            height[i] = (upper[i] - lower[i]) / norm
            for a in range(n):
                load[a] += on_free[a, i] * (lower[i] / norm)
        left[0] = max(left[0], _least_squares(on_free, load, height))
        if left[0] == np.inf:
            return


@_inline
def _least_squares(W, w, height):
    """The least ‖W t + w‖ over 0 ≤ t ≤ height: Stark and Parker's active-set method; inf where it does not end."""
    n, m = W.shape
    t, target, r = np.zeros(m), np.zeros(m), np.empty(n)
    state = np.zeros(m, np.int64)  # 0 at its lower limit, 1 at its upper, 2 free
    blocked = np.zeros(m, np.bool_)
    Q, U, order = np.empty((n, n)), np.empty((n, n)), np.empty(n, np.int64)
    size = 1.0
    for a in range(n):
        size = max(size, abs(w[a]))
    for _ in range(MOST_CHANGES):
        norm2 = 0.0
        for a in range(n):
            r[a] = w[a]
            for i in range(m):
                r[a] += W[a, i] * t[i]
            norm2 += r[a] ** 2
        if norm2 <= (ROUNDING * size) ** 2:
            return np.sqrt(norm2)
        enter, steepest = -1, ROUNDING * size
        for i in range(m):
            if state[i] == 2 or blocked[i] or height[i] == 0.0:
                continue
            slope = 0.0
            for a in range(n):
                slope -= W[a, i] * r[a]
            if state[i] == 1:
                slope = -slope
            if slope > steepest:
                enter, steepest = i, slope
        if enter < 0:
            return np.sqrt(norm2)
        came_from = state[enter]
        state[enter] = 2
        first = True
        while True:
            independent = _solve_free(W, w, height, state, enter if first else -1, Q, U, order, target)
            backwards = first and (target[enter] <= 0.0 if came_from == 0 else target[enter] >= height[enter])
            if first and (not independent or backwards):  # rounding made it look as if this tension helped
                state[enter] = came_from
                blocked[enter] = True
                break
            first = False
            step, stop = 1.0, -1
            for i in range(m):
                if state[i] != 2:
                    continue
                limit = 0.0 if target[i] < 0.0 else height[i]
                if target[i] < 0.0 or target[i] > height[i]:
                    fraction = (limit - t[i]) / (target[i] - t[i])
                    if fraction < step or stop < 0:
                        step, stop = min(fraction, step), i
            for i in range(m):
                if state[i] == 2:
                    t[i] += step * (target[i] - t[i])
            if stop < 0:
                blocked[:] = False
                break
            state[stop] = 0 if target[stop] < 0.0 else 1
            t[stop] = 0.0 if state[stop] == 0 else height[stop]
            for i in range(m):  # others that the same step brought to a limit
                if state[i] == 2 and (t[i] <= 0.0 and target[i] < 0.0):
                    state[i], t[i] = 0, 0.0
                elif state[i] == 2 and (t[i] >= height[i] and target[i] > height[i]):
                    state[i], t[i] = 1, height[i]
    return np.inf


@_inline
def _solve_free(W, w, height, state, newest, Q, U, order, target):
    """Least squares over the free tensions, the rest at their limits; False where the newest column is dependent.

    Gram-Schmidt, twice, which is enough for orthogonality to rounding; the newest column comes last.
    """
    n, m = W.shape
    b, q = np.empty(n), np.empty(n)
    for a in range(n):
        b[a] = -w[a]
        for i in range(m):
            if state[i] == 1:
                b[a] -= W[a, i] * height[i]
    columns = 0
    for turn in range(2):
        for i in range(m):
            if state[i] != 2 or (i == newest) != (turn == 1):
                continue
            if columns == n:
                return False
            before = 0.0
            for a in range(n):
                q[a] = W[a, i]
                before += q[a] ** 2
            for c in range(columns):
                U[c, columns] = 0.0
            for _ in range(2):
                for c in range(columns):
                    along = 0.0
                    for a in range(n):
                        along += Q[a, c] * q[a]
                    U[c, columns] += along
                    for a in range(n):
                        q[a] -= along * Q[a, c]
            after = 0.0
            for a in range(n):
                after += q[a] ** 2
            if not after > DEPENDENT**2 * before:
                return False
            norm = np.sqrt(after)
            U[columns, columns] = norm
            for a in range(n):
                Q[a, columns] = q[a] / norm
            order[columns] = i
            columns += 1
    for c in range(columns - 1, -1, -1):
        value = 0.0
        for a in range(n):
            value += Q[a, c] * b[a]
        for later in range(c + 1, columns):
            value -= U[c, later] * target[order[later]]
        target[order[c]] = value / U[c, c]
    return True

"""Feasible workspaces: poses at which rigid cables can hold the platform with tensions within limits, by two methods.

A wrench w_e on the platform can be held at a pose where

    W tau + w_e = 0,    tau_min ≤ tau ≤ tau_max

has a solution (paper Eq. 3). The *static* feasible workspace requires it for the weight (and an external wrench, if
there is one); the *wrench-feasible* workspace for every wrench of a set: all wrenches in their convex hull are then
feasible too (Bosscher, Riechel, Ebert-Uphoff 2006, doi:10.1109/TRO.2006.878967).

The fast method minimises ‖W tau + w_e‖² within the limits, compiled (``statics.balance_kernel``). It is finite; both
of its results are proofs: either tensions that balance the load, or a residual r with rᵀ(W tau + w_e) ≥ ‖r‖² > 0 for
all tensions within the limits, a direction in which the cables cannot pull enough (Farkas). The reference is linear
programming, by HiGHS.

A cable with mass pulls along its chord with the tension at its middle, and half its weight is a load on the anchor:
the first order in weight over tension. Both of its ends keep within the limits, whose tensions differ by the weight
times the difference of height. On ``cogiro-crane`` with ropes of 0.064 kg/m the pulls, 136 N and more, are then wrong
by at most 0.012 N (60 random poses).
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float
from numpy.typing import ArrayLike

from cdpr_sim.core.cable_path import off_wheel
from cdpr_sim.core.checks import checked_array
from cdpr_sim.core.compiling import Kernel
from cdpr_sim.core.errors import InvalidInput
from cdpr_sim.core.limits import checked_limits, checked_wrenches
from cdpr_sim.core.on_threads import checked_threads, on_threads
from cdpr_sim.core.problem import Problem, positions_and_rotations
from cdpr_sim.core.robot import Robot
from cdpr_sim.statics import forces
from cdpr_sim.statics.balance_kernel import BALANCED
from cdpr_sim.statics.gufuncs import MARGINS, SHORTFALLS

Array = np.ndarray

LEAST_PIECE = 1000
"""Poses for which a piece of a batch is worth a thread: milliseconds."""

HIGHS_TOLERANCE = 1e-7
"""Largest violation of a constraint by HiGHS."""


def shortfall(
    robot: Robot,
    positions: ArrayLike,
    *,
    rotations: ArrayLike | None = None,
    tension_limits: tuple[ArrayLike, ArrayLike] | None = None,
    wrenches: ArrayLike | None = None,
    threads: int = 0,
) -> Float[Array, "*batch"]:
    """Smallest unbalanced part of the load, as a fraction of the load; rounding where feasible.

    Args:
        robot: the robot.
        positions: (..., 3) [m].
        rotations: (..., 3, 3); default: level.
        tension_limits: smallest and largest tension [N], each one number or one per cable; default: the robot's
            ``force_min`` and ``force_max``.
        wrenches: external forces and torques on the platform's origin besides gravity, (6,) or a set of them (sets, 6)
            [N, N m]; the worst one counts. Default: none.
        threads: among which poses along the first axis are divided, for 2,000 poses and more; 0 for one per processor,
            1 for none. They do not change the results.

    Returns:
        The norm of W tau + w_e at the tensions that make it least, torques divided by the characteristic length, over
        the largest norm of w_e. Of many poses, nan where one is not finite, an anchor lies on its exit, or a cable
        leaves its pulley's wheel; infinite where the weight of a cable alone needs more than its limits.

    Raises:
        InvalidInput: an invalid argument; a single pose at which a cable leaves its pulley's wheel.
    """
    demand = _demand(robot, positions, rotations, tension_limits, wrenches)
    left = over_poses(SHORTFALLS, robot, *demand, threads=checked_threads(threads))
    left = np.where((demand[0] > demand[1]).any(-1), np.inf, left)
    for index in map(tuple, np.argwhere(np.isposinf(left))):  # the active sets cycled, or limits exclude each other
        parts = zip(demand, (1, 1, 2, 1, 2), strict=True)
        row = (np.broadcast_to(part, left.shape + part.shape[part.ndim - core :])[index] for part, core in parts)
        left[index] = _least_by_linprog(robot, *row)
    return left


def feasible(
    robot: Robot,
    positions: ArrayLike,
    *,
    rotations: ArrayLike | None = None,
    tension_limits: tuple[ArrayLike, ArrayLike] | None = None,
    wrenches: ArrayLike | None = None,
    threads: int = 0,
) -> Bool[Array, "*batch"]:
    """Whether rigid cables can hold the platform there, within limits of tension, against its weight and ``wrenches``.

    Their exits do not move: a frame that gives way is rigid here, as cables are. Without wrenches this is the static
    feasible workspace (what ARACHNIS computes); with a set of them, the wrench-feasible workspace of their convex hull.

    Args:
        robot: the robot.
        positions: (..., 3) [m].
        rotations: (..., 3, 3); default: level.
        tension_limits: smallest and largest tension [N], each one number or one per cable; default: the robot's
            ``force_min`` and ``force_max``.
        wrenches: external forces and torques on the platform's origin besides gravity, (6,) or a set of them (sets, 6)
            [N, N m]; the worst one counts. Default: none.
        threads: among which poses along the first axis are divided, for 2,000 poses and more; 0 for one per processor,
            1 for none. They do not change the results.

    Returns:
        (...) True where the unbalanced part is only rounding; False where ``shortfall`` is nan.

    Raises:
        InvalidInput: as in ``shortfall``.
    """
    conditions = {"tension_limits": tension_limits, "wrenches": wrenches}
    return shortfall(robot, positions, rotations=rotations, threads=threads, **conditions) <= BALANCED


def closed_form_feasible(
    robot: Robot,
    positions: ArrayLike,
    *,
    rotations: ArrayLike | None = None,
    tension_limits: tuple[ArrayLike, ArrayLike] | None = None,
    wrenches: ArrayLike | None = None,
) -> Bool[Array, "*batch"]:
    """Whether the tensions nearest to the middle of their limits, tau = mid − W⁺ (W mid + w_e), are within them.

    It is fast and continuous, and so used by controllers (Pott,
    Bruckmann, Mikelsons, "Closed-form force distribution for parallel wire robots", Computational Kinematics 2009). It
    does not find other tensions within limits that would hold a pose: its workspace is a subset of ``feasible``.

    Args:
        robot: the robot.
        positions: (..., 3) [m].
        rotations: (..., 3, 3); default: level.
        tension_limits: smallest and largest tension [N], each one number or one per cable, finite; default: the robot's
            ``force_min`` and ``force_max``.
        wrenches: external forces and torques on the platform's origin besides gravity, (6,) or a set of them (sets, 6)
            [N, N m]; all count. Default: none.

    Returns:
        (...) True where these tensions are within their limits under each of the wrenches.

    Raises:
        InvalidInput: as in ``shortfall``, or a limit that is infinite.
    """
    _, most = checked_limits(robot, tension_limits)
    if not np.isfinite(most).all():
        cable = int(np.argmax(~np.isfinite(most)))
        raise InvalidInput(f"tension_limits: found no largest tension in cable {cable + 1}, expected a finite one")
    lower, upper, loads, at, turned = _demand(robot, positions, rotations, tension_limits, wrenches)
    W = (forces.geometry(robot, at, turned).wrench_matrix / robot.units[:, None])[..., robot.free, :]
    known = np.asarray(np.isfinite(W).all((-1, -2)))
    W = np.where(known[..., None, None], W, 0.0)
    middle = (lower + upper) / 2
    held = known.copy()
    for wrench in np.moveaxis(loads, -2, 0):
        load = ((_weight(robot, turned) + wrench) / robot.units)[..., robot.free]
        tensions = middle - np.einsum("...cf,...f->...c", np.linalg.pinv(W), (W @ middle[..., None])[..., 0] + load)
        left = np.abs((W @ tensions[..., None])[..., 0] + load).max(-1)
        held &= (left <= BALANCED * upper.max(-1)) & ((tensions >= lower) & (tensions <= upper)).all(-1)
    return held


def capacity_margin(
    robot: Robot,
    positions: ArrayLike,
    *,
    rotations: ArrayLike | None = None,
    tension_limits: tuple[ArrayLike, ArrayLike] | None = None,
    wrenches: ArrayLike | None = None,
    threads: int = 0,
) -> Float[Array, "*batch"]:
    """Largest distance of all tensions from their limits at which they still hold the platform [N].

        max t   such that   W tau + w_e = 0,   tau_min + t ≤ tau ≤ tau_max − t

    It is positive inside the feasible workspace, zero on its border, and negative outside, where it is the necessary
    change of every limit; where W has full rank it is continuous, so that the border can be interpolated.

    Args:
        robot: the robot.
        positions: (..., 3) [m].
        rotations: (..., 3, 3); default: level.
        tension_limits: as in ``shortfall``.
        wrenches: as in ``shortfall``; the worst one counts.
        threads: as in ``shortfall``.

    Returns:
        At most the load, which is far enough from the border; -inf where no tensions at all, not even pushing ones,
        balance the load (under-actuated robots). Nan as in ``shortfall``.

    Raises:
        InvalidInput: as in ``shortfall``.
    """
    demand = _demand(robot, positions, rotations, tension_limits, wrenches)
    return over_poses(MARGINS, robot, *demand, threads=checked_threads(threads))


def feasible_by_linprog(
    robot: Robot,
    position: ArrayLike,
    rotation: ArrayLike | None = None,
    *,
    tension_limits: tuple[ArrayLike, ArrayLike] | None = None,
    wrenches: ArrayLike | None = None,
) -> bool:
    """The reference for ``feasible``, at one pose: linear programming by HiGHS, to its tolerance.

    Raises:
        InvalidInput: as in ``shortfall``.
    """
    demand = _demand(robot, checked_array("position", position, (3,)), rotation, tension_limits, wrenches)
    return _least_by_linprog(robot, *demand) <= HIGHS_TOLERANCE


def _demand(
    robot: Robot,
    positions: ArrayLike,
    rotations: ArrayLike | None,
    tension_limits: tuple[ArrayLike, ArrayLike] | None,
    wrenches: ArrayLike | None,
) -> tuple[
    Float[Array, "*#batch cables"],
    Float[Array, "*#batch cables"],
    Float[Array, "*#batch sets 6"],
    Float[Array, "*batch 3"],
    Float[Array, "*#batch 3 3"],
]:
    """Limits of the tensions at the middles of the cables, loads with half of the cables' weight, and poses.

    A single pose without paths of its cables is refused, as in ``solve``.
    """
    (lower, upper), loads = checked_limits(robot, tension_limits), checked_wrenches(robot, wrenches)
    at, turned = positions_and_rotations(robot, positions, rotations, "positions")
    if at.ndim == 1 and turned.ndim == 2:
        lost = off_wheel(robot.cabling, at, turned)
        if lost and np.isfinite(at).all() and np.isfinite(turned).all():
            raise InvalidInput(f"positions: found {lost}")
    difference, weight = forces.weight_of_cables(robot, at, turned)
    return lower + difference, upper - difference, loads + weight[..., None, :], at, turned


def over_poses(
    kernel: Kernel,
    robot: Robot,
    lower: Float[Array, "*#batch cables"],
    upper: Float[Array, "*#batch cables"],
    loads: Float[Array, "*#batch sets 6"],
    positions: Float[Array, "*#batch 3"],
    rotations: Float[Array, "*#batch 3 3"],
    *,
    threads: int = 1,
) -> Float[Array, "*batch"]:
    """Results of a compiled function of ``balance_kernel`` at each pose."""

    def evaluated(*given: np.ndarray | float) -> tuple[np.ndarray]:
        with np.errstate(all="ignore"):
            return (np.asarray(kernel(*given)),)

    given = (
        robot.cabling.packed, lower, upper, robot.weight, robot.center_of_mass, loads, np.array(robot.free),
        robot.characteristic_length, positions, rotations,
    )  # fmt: skip
    return on_threads(evaluated, given, (2, 1, 1, 0, 1, 2, 1, 0, 1, 2), threads, LEAST_PIECE)[0]


def _least_by_linprog(
    robot: Robot,
    lower: Float[Array, " cables"],
    upper: Float[Array, " cables"],
    wrenches: Float[Array, "sets 6"],
    position: Float[Array, "3"],
    rotation: Float[Array, "3 3"],
) -> float:
    """The least largest component of W tau + w_e, over the load: as ``shortfall``, in another norm."""
    from scipy.optimize import linprog

    if (lower > upper).any():
        return np.inf
    W = (forces.geometry(robot, position, rotation).wrench_matrix / robot.units[:, None])[robot.free]
    least = []
    for load in (_weight(robot, rotation) + wrenches) / robot.units:
        load = load[robot.free]
        size = float(np.linalg.norm(load)) or 1.0
        over = -np.ones((len(load), 1))
        bounds = np.vstack([np.column_stack([lower, upper]) / size, [0.0, np.inf]])
        result = linprog(
            np.append(np.zeros(robot.cables), 1.0),
            A_ub=np.block([[W, over], [-W, over]]),
            b_ub=np.append(-load, load) / size,
            bounds=bounds,
        )
        least.append(result.fun if result.status == 0 else np.nan)
    return float(np.max(least))


def _weight(robot: Robot, rotations: Float[Array, "*batch 3 3"]) -> Float[Array, "*batch 6"]:
    """Gravity's wrench on the platform."""
    return forces.load_wrench(Problem(robot, robot.pose(robot.home), np.ones(robot.cables), np.zeros(6)), rotations)

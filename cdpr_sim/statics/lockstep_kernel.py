"""Stiffness, and balance of forces, at many poses, eight at a time on ``core.lanes``; compiled.

The formulas are those of ``stiffness_kernel`` and ``balance_kernel``, compiled for lanes. Eight poses are begun and
ended together, since they take nearly the same number of steps; where fewer are left, the last pose is repeated.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from cdpr_sim.core.cable import PARTS
from cdpr_sim.core.compiling import where
from cdpr_sim.core.lanes import WIDTH, Room, masks, matrix3, matrix6, room_for, vector
from cdpr_sim.statics import cable_kernel as ck
from cdpr_sim.statics.balance_kernel import BalanceScratch, fill_pulls, least_part
from cdpr_sim.statics.lanes_kernel import GIVEN, MEMORY, load_cables, load_pose, new_state, on_lanes
from cdpr_sim.statics.matrix_kernel import Tridiagonal
from cdpr_sim.statics.stiffness_kernel import ModesScratch, fill_modes


def _mode_kernel(new_cables: Callable) -> Callable:
    """The function for cables of the type that ``new_cables`` makes."""

    def modes_of_all(
        tables, rest_lengths, masses, gravity, centers_of_mass, inertia, free, scales, positions, rotations, numbers,
        flags, eigenvalues, frequencies,
    ):  # fmt: skip
        """Modes at (rows, columns) of poses; the arguments are those of ``stiffness_kernel``, and memory."""
        columns, m = rest_lengths.shape[1:]
        n, poses = len(free), rest_lengths.shape[0] * columns
        room = Room(numbers, flags, np.zeros(2, np.int64))
        cables, p, R, com = new_cables(room, m), vector(room, 3), matrix3(room, 3), vector(room, 3)
        platform = vector(room, 3)  # two numbers of it, and a result
        state = new_state(cables, room)
        scratch = ModesScratch(
            matrix6(room, m), matrix6(room, 6), matrix6(room, 6), matrix6(room, n), matrix6(room, n), vector(room, n),
            Tridiagonal(vector(room, n), vector(room, n), vector(room, n)),
        )  # fmt: skip
        for first in range(0, poses, WIDTH):
            for w in range(WIDTH):
                pose = min(first + w, poses - 1)
                at = pose // columns, pose % columns
                load_cables(cables, tables[at], rest_lengths[at], w)
                load_pose(positions[at], rotations[at], centers_of_mass[at], w, p, R, com)
                platform[0, w], platform[1, w] = masses[at], scales[at]
            ck.measure(cables, p, R, state)
            platform[2] = fill_modes(state, platform[0], gravity, com, inertia, free, platform[1], R, scratch)
            for w in range(min(WIDTH, poses - first)):
                at = (first + w) // columns, (first + w) % columns
                frequencies[at] = platform[2, w]
                for a in range(n):
                    eigenvalues[at][a] = scratch.d[a, w]

    return modes_of_all


_FREE = "Array(int64, 1, 'A', readonly=True)"

_MODES = on_lanes(
    "stiffness at eight poses at once",
    _mode_kernel,
    f"{GIVEN[4]}, {GIVEN[3]}, {GIVEN[2]}, float64, {GIVEN[3]}, {GIVEN[2]}, {_FREE}, {GIVEN[2]}, {GIVEN[3]}, "
    f"{GIVEN[4]}, {MEMORY}, float64[:, :, ::1], float64[:, ::1]",
)


def modes(
    bent: bool, tables, rest_lengths, masses, gravity, centers_of_mass, inertia, free, scales, positions, rotations
) -> tuple[np.ndarray, ...]:
    """Results of ``gufuncs.stiffness_gufunc`` for (rows, columns) of poses: plain or bent cables.

    The arguments are those of the gufunc, all with these two axes before their own, except ``gravity``, ``inertia`` and
    ``free``.
    """
    loop, m = rest_lengths.shape[:2], rest_lengths.shape[2]
    results = np.empty((*loop, len(free))), np.empty(loop)
    room = room_for(40 * m + 220)
    _MODES[bent].compiled(
        tables, rest_lengths, masses, float(gravity), centers_of_mass, inertia, free, scales, positions, rotations,
        room.numbers, room.flags, *results,
    )  # fmt: skip
    return results


def _shortfall_kernel(new_cables: Callable) -> Callable:
    """The function for cables of the type that ``new_cables`` makes."""

    def shortfalls_of_all(
        tables, lower, upper, weights, centers_of_mass, wrenches, free, scales, positions, rotations, numbers, flags,
        left,
    ):  # fmt: skip
        """Unbalanced parts at (rows, columns) of poses; the arguments are those of ``balance_kernel``, and memory."""
        columns, m = lower.shape[1:]
        poses = lower.shape[0] * columns
        room = Room(numbers, flags, np.zeros(2, np.int64))
        cables, p, R, com = new_cables(room, m), vector(room, 3), matrix3(room, 3), vector(room, 3)
        platform = vector(room, 3)  # two numbers of it, and a result
        state, low, high = new_state(cables, room), vector(room, m), vector(room, m)
        scratch = BalanceScratch(
            matrix6(room, m), matrix6(room, m), vector(room, m * m), vector(room, 6), vector(room, 6), vector(room, 6),
            vector(room, 6), vector(room, 6), vector(room, m), vector(room, m), vector(room, m), masks(room, m),
            masks(room, m), masks(room, m),
        )  # fmt: skip
        parts, ones = vector(room, m), np.ones(m)
        for first in range(0, poses, WIDTH):
            for w in range(WIDTH):
                pose = min(first + w, poses - 1)
                at = pose // columns, pose % columns
                load_cables(cables, tables[at], ones, w)  # rest lengths have no effect here
                load_pose(positions[at], rotations[at], centers_of_mass[at], w, p, R, com)
                platform[0, w], platform[1, w] = weights[at], scales[at]
                for i in range(m):
                    low[i, w], high[i, w], parts[i, w] = lower[at][i], upper[at][i], tables[at][i, PARTS]
            ck.measure(cables, p, R, state)
            known = fill_pulls(state, parts, platform[1], scratch)
            platform[2] = 0.0
            for k in range(wrenches.shape[2]):
                for w in range(WIDTH):
                    pose = min(first + w, poses - 1)
                    for a in range(6):
                        scratch.wrench[a, w] = wrenches[pose // columns, pose % columns][k, a]
                part = least_part(low, high, platform[0], com, free, platform[1], R, scratch)
                platform[2] = max(platform[2], part)
            platform[2] = where(known, platform[2], np.nan)
            for w in range(min(WIDTH, poses - first)):
                left[(first + w) // columns, (first + w) % columns] = platform[2, w]

    return shortfalls_of_all


_SHORTFALLS = on_lanes(
    "balance of forces at eight poses at once",
    _shortfall_kernel,
    f"{GIVEN[4]}, {GIVEN[3]}, {GIVEN[3]}, {GIVEN[2]}, {GIVEN[3]}, {GIVEN[4]}, {_FREE}, {GIVEN[2]}, {GIVEN[3]}, "
    f"{GIVEN[4]}, {MEMORY}, float64[:, ::1]",
)


def shortfalls(
    bent: bool, tables, lower, upper, weights, centers_of_mass, wrenches, free, scales, positions, rotations
) -> tuple[np.ndarray, ...]:
    """Results of ``gufuncs.shortfall_gufunc`` for (rows, columns) of poses: plain or bent cables.

    The arguments are those of the gufunc, all with these two axes before their own, except ``free``.
    """
    m = lower.shape[2]
    left = np.empty(lower.shape[:2])
    room = room_for(m * m + 60 * m + 120, 3 * m)
    _SHORTFALLS[bent].compiled(
        tables, lower, upper, weights, centers_of_mass, wrenches, free, scales, positions, rotations, room.numbers,
        room.flags, left,
    )  # fmt: skip
    return (left,)

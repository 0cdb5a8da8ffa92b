"""Stiffness, and balance of forces, at many poses, eight at a time on ``core.lanes``; compiled.

The formulas are those of ``stiffness_kernel`` and ``balance_kernel``, compiled for lanes. Eight poses are begun and
ended together, since they take nearly the same number of steps; where fewer are left, the last pose is repeated.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from cdpr_sim.core.cable import PARTS
from cdpr_sim.core.compiling import matrix, vector, where
from cdpr_sim.core.lanes import WIDTH, Room
from cdpr_sim.statics import balance_kernel, lanes_kernel, stiffness_kernel  # noqa: F401  (choices for lanes)
from cdpr_sim.statics import cable_kernel as ck
from cdpr_sim.statics.newton_kernel import copy_pose


def modes(new_cables: Callable) -> Callable:
    """The function for cables of the type that ``new_cables`` makes."""

    def modes_of_all(
        tables, rest_lengths, masses, gravity, centers_of_mass, inertia, free, scales, positions, rotations, numbers,
        flags, eigenvalues, frequencies,
    ):  # fmt: skip
        """Modes at (rows, columns) of poses; the arguments are those of ``stiffness_kernel``, and memory."""
        columns, m = rest_lengths.shape[1:]
        n, poses = len(free), rest_lengths.shape[0] * columns
        room = Room(numbers, flags, np.zeros(2, np.int64))
        cables, p, R, com = new_cables(room, tables[0, 0]), vector(room, 3), matrix(room, 3, 3), vector(room, 3)
        platform = vector(room, 3)  # two numbers of it, and a result
        state, scratch = ck.new_state(cables, room), stiffness_kernel.new_scratch(room, m, n)
        for first in range(0, poses, WIDTH):
            for w in range(WIDTH):
                pose = min(first + w, poses - 1)
                at = pose // columns, pose % columns
                ck.load(cables, tables[at], rest_lengths[at], (w,))
                copy_pose(positions[at], rotations[at], (), p, R, (w,))
                for a in range(3):
                    com[a, w] = centers_of_mass[at][a]
                platform[0, w], platform[1, w] = masses[at], scales[at]
            ck.measure(cables, p, R, state)
            platform[2] = stiffness_kernel.fill_modes(
                state, platform[0], gravity, com, inertia, free, platform[1], R, scratch
            )
            for w in range(min(WIDTH, poses - first)):
                at = (first + w) // columns, (first + w) % columns
                frequencies[at] = platform[2, w]
                for a in range(n):
                    eigenvalues[at][a] = scratch.d[a, w]

    return modes_of_all


def shortfalls(new_cables: Callable) -> Callable:
    """The function for cables of the type that ``new_cables`` makes."""

    def shortfalls_of_all(
        tables, lower, upper, weights, centers_of_mass, wrenches, free, scales, positions, rotations, numbers, flags,
        left,
    ):  # fmt: skip
        """Unbalanced parts at (rows, columns) of poses; the arguments are those of ``balance_kernel``, and memory."""
        columns, m = lower.shape[1:]
        poses = lower.shape[0] * columns
        room = Room(numbers, flags, np.zeros(2, np.int64))
        cables, p, R, com = new_cables(room, tables[0, 0]), vector(room, 3), matrix(room, 3, 3), vector(room, 3)
        platform = vector(room, 3)  # two numbers of it, and a result
        state, scratch = ck.new_state(cables, room), balance_kernel.new_scratch(room, m)
        low, high, parts, ones = vector(room, m), vector(room, m), vector(room, m), np.ones(m)
        for first in range(0, poses, WIDTH):
            for w in range(WIDTH):
                pose = min(first + w, poses - 1)
                at = pose // columns, pose % columns
                ck.load(cables, tables[at], ones, (w,))  # rest lengths have no effect here
                copy_pose(positions[at], rotations[at], (), p, R, (w,))
                for a in range(3):
                    com[a, w] = centers_of_mass[at][a]
                platform[0, w], platform[1, w] = weights[at], scales[at]
                for i in range(m):
                    low[i, w], high[i, w], parts[i, w] = lower[at][i], upper[at][i], tables[at][i, PARTS]
            ck.measure(cables, p, R, state)
            known = balance_kernel.fill_pulls(state, parts, platform[1], scratch)
            platform[2] = 0.0
            for k in range(wrenches.shape[2]):
                for w in range(WIDTH):
                    pose = min(first + w, poses - 1)
                    for a in range(6):
                        scratch.wrench[a, w] = wrenches[pose // columns, pose % columns][k, a]
                part = balance_kernel.least_part(low, high, platform[0], com, free, platform[1], R, scratch)
                platform[2] = max(platform[2], part)
            platform[2] = where(known, platform[2], np.nan)
            for w in range(min(WIDTH, poses - first)):
                left[(first + w) // columns, (first + w) % columns] = platform[2, w]

    return shortfalls_of_all

"""Stiffness, and balance of forces, at many poses, eight at a time on ``core.lanes``; compiled.

The formulas are those of ``stiffness_kernel`` and ``balance_kernel``, compiled for lanes. Eight poses are begun and
ended together, since they take nearly the same number of steps; where fewer are left, the last pose is repeated.
"""

from __future__ import annotations

import numpy as np

from cdpr_sim.core.compiling import Compiled, Kernel
from cdpr_sim.core.lanes import WIDTH, Room, matrix3, matrix6, room_for, vector
from cdpr_sim.statics import cable_kernel as ck
from cdpr_sim.statics.lanes_kernel import GIVEN, MEMORY, load_cables, load_pose, new_cables, new_state
from cdpr_sim.statics.matrix_kernel import Tridiagonal
from cdpr_sim.statics.stiffness_kernel import Memory, fill_modes


def _modes(
    tables, rest_lengths, masses, gravity, centers_of_mass, inertia, free, scales, positions, rotations, numbers,
    flags, eigenvalues, frequencies,
):  # fmt: skip
    """Modes at (rows, columns) of poses; the arguments are those of ``stiffness_kernel``, and memory."""
    columns, m = rest_lengths.shape[1:]
    n, poses = len(free), rest_lengths.shape[0] * columns
    room = Room(numbers, flags, np.zeros(2, np.int64))
    cables, p, R, com, platform = (
        new_cables(room, m),
        vector(room, 3),
        matrix3(room, 3),
        vector(room, 3),
        vector(room, 3),
    )
    state = new_state(room, cables)
    memory = Memory(
        matrix6(room, m), matrix6(room, 6), matrix6(room, 6), matrix6(room, n), matrix6(room, n), vector(room, n),
        Tridiagonal(vector(room, n), vector(room, n), vector(room, n)),
    )  # fmt: skip
    for first in range(0, poses, WIDTH):
        for w in range(WIDTH):
            pose = min(first + w, poses - 1)
            at = pose // columns, pose % columns
            load_cables(tables[at], rest_lengths[at], w, cables)
            load_pose(positions[at], rotations[at], centers_of_mass[at], w, p, R, com)
            platform[0, w], platform[1, w] = masses[at], scales[at]
        ck.measure(cables, p, R, state)
        platform[2] = fill_modes(state, platform[0], gravity, com, inertia, free, platform[1], R, memory)
        for w in range(min(WIDTH, poses - first)):
            at = (first + w) // columns, (first + w) % columns
            frequencies[at] = platform[2, w]
            for a in range(n):
                eigenvalues[at][a] = memory.d[a, w]


_FREE = "Array(int64, 1, 'A', readonly=True)"

_MODES = Compiled(
    "stiffness at eight poses at once",
    _modes,
    f"void({GIVEN[4]}, {GIVEN[3]}, {GIVEN[2]}, float64, {GIVEN[3]}, {GIVEN[2]}, {_FREE}, {GIVEN[2]}, {GIVEN[3]}, "
    f"{GIVEN[4]}, {MEMORY}, float64[:, :, ::1], float64[:, ::1])",
    error_model="numpy",
    nogil=True,
)


def modes(
    kernel: Kernel, tables, rest_lengths, masses, gravity, centers_of_mass, inertia, free, scales, positions, rotations
) -> tuple[np.ndarray, ...]:
    """Results of ``stiffness_kernel.stiffness_gufunc`` for (rows, columns) of poses: plain cables.

    The arguments are those of the gufunc, all with these two axes before their own, except ``gravity``, ``inertia`` and
    ``free``.
    """
    loop, m = rest_lengths.shape[:2], rest_lengths.shape[2]
    results = np.empty((*loop, len(free))), np.empty(loop)
    room = room_for(24 * m + 200)
    _MODES.compiled(
        tables, rest_lengths, masses, float(gravity), centers_of_mass, inertia, free, scales, positions, rotations,
        room.numbers, room.flags, *results,
    )  # fmt: skip
    return results

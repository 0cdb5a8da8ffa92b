"""Search for roots of the net wrench by ``roots_kernel`` from many starts, eight at a time on ``core.lanes``; compiled.

The formulas of a step are those of ``roots_kernel``, compiled for lanes. Here each pass of one loop is a step of eight
searches. One that has ended gets the next start at once: it is a trial pose that is accepted in any case.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from cdpr_sim.core.compiling import nowhere, where
from cdpr_sim.core.lanes import WIDTH, Room, bits_of, everywhere, mask_of, masks, matrix6, room_for, vector
from cdpr_sim.statics import cable_kernel as ck
from cdpr_sim.statics import newton_kernel as nk
from cdpr_sim.statics import roots_kernel as rk
from cdpr_sim.statics.lanes_kernel import GIVEN, MEMORY, load_cables, load_pose, new_point, on_lanes, take
from cdpr_sim.statics.newton_kernel import Case, Model


def _searcher(new_cables: Callable) -> Callable:
    """The search from many starts with cables of the type that ``new_cables`` makes."""

    def search_all(
        table, rest_lengths, weight, center_of_mass, wrench, free, scale, enough, damping, starts, start_rotations,
        numbers, flags, positions, rotations, unbalanced,
    ):  # fmt: skip
        """Roots from (rows, columns) of starts; the arguments are those of ``roots_kernel``, and memory."""
        in_a_row, m = starts.shape[1], len(rest_lengths)
        searches = starts.shape[0] * in_a_row
        room = Room(numbers, flags, np.zeros(2, np.int64))
        cables, com = new_cables(room, m), vector(room, 3)
        here, trial = new_point(room, cables), new_point(room, cables)
        model = Model(
            matrix6(room, m), vector(room, m), vector(room, 6), matrix6(room, 6), matrix6(room, 6), vector(room, 6)
        )
        slope, normal, gradient, x = matrix6(room, 6), matrix6(room, 6), vector(room, 6), vector(room, 6)
        tau, taut, found = vector(room, m), masks(room, m), vector(room, 1)
        case = Case(cables, weight, com, wrench, free, scale)
        for w in range(WIDTH):
            load_cables(cables, table, rest_lengths, w)

        size, share, steps = everywhere(np.inf), everywhere(damping), everywhere(0.0)
        who, active, given = np.zeros(WIDTH, np.int64), 0, 0
        while True:
            begun = 0
            for w in range(WIDTH):
                if given < searches and not (active >> w) & 1:
                    at = given // in_a_row, given % in_a_row
                    load_pose(starts[at], start_rotations[at], center_of_mass, w, trial.p, trial.R, com)
                    begun |= 1 << w
                    who[w] = given
                    given += 1
            active |= begun
            if active == 0:
                break

            # The trial pose.
            fresh = mask_of(begun)
            ck.measure(cables, trial.p, trial.R, trial.c)
            left = rk.fill_wrench(case, trial, model, tau, taut)
            accepts = fresh | (left < size)
            lower = where(accepts, max(rk.LOWER * share, rk.LEAST_DAMPING), rk.HIGHER * share)
            share, steps = where(fresh, damping, lower), where(fresh, 0.0, steps)
            size = where(accepts, left, size)
            take(accepts, trial, here)
            if not nowhere(~accepts):
                rk.fill_wrench(case, here, model, tau, taut)

            going = (size > enough) & (size < np.inf) & (share <= rk.MOST_DAMPING) & (steps < rk.STEPS)
            ended = active & bits_of(~going)
            if ended:
                found[0] = size
                for w in range(WIDTH):
                    if (ended >> w) & 1:
                        at = who[w] // in_a_row, who[w] % in_a_row
                        unbalanced[at] = found[0, w]
                        for a in range(3):
                            positions[at][a] = here.p[a, w]
                            for b in range(3):
                                rotations[at][a, b] = here.R[a, b, w]
                active &= ~ended

            # The next one.
            rk.fill_slope(case, here, model, tau, taut, slope, gradient)
            rk.fill_step(case, slope, gradient, share, normal, x)
            nk.move(case, here, x, trial)
            steps += 1.0

    return search_all


_SEARCH = on_lanes(
    "search for saddles from eight poses at once",
    _searcher,
    f"{GIVEN[2]}, {GIVEN[1]}, float64, {GIVEN[1]}, {GIVEN[1]}, {GIVEN[1]}, float64, float64, float64, "
    f"{GIVEN[3]}, {GIVEN[4]}, {MEMORY}, float64[:, :, ::1], float64[:, :, :, ::1], float64[:, ::1]",
)


def search(
    bent: bool, table, rest_lengths, weight, center_of_mass, wrench, free, scale, enough, damping, starts,
    start_rotations,
) -> tuple[np.ndarray, ...]:  # fmt: skip
    """Results of ``gufuncs.roots_gufunc`` for plain or bent cables from (rows, columns) of starts.

    The arguments are those of the gufunc; the poses have these two axes before their own, and the rest is the same for
    all starts.
    """
    loop, m = starts.shape[:2], len(rest_lengths)
    results = np.empty((*loop, 3)), np.empty((*loop, 3, 3)), np.empty(loop)
    room = room_for(60 * m + 260, m)
    _SEARCH[bent].compiled(
        table, rest_lengths, float(weight), center_of_mass, wrench, free, float(scale), float(enough), float(damping),
        starts, start_rotations, room.numbers, room.flags, *results,
    )  # fmt: skip
    return results

"""Search for roots of the net wrench by ``roots_kernel`` from many starts, eight at a time on ``core.lanes``; compiled.

The formulas of a step are those of ``roots_kernel``, compiled for lanes. Here each pass of one loop is a step of eight
searches. One that has ended gets the next start at once: it is a trial pose that is accepted in any case.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from cdpr_sim.core.compiling import matrix, nowhere, truths, vector, where
from cdpr_sim.core.lanes import WIDTH, Room, bits_of, everywhere, mask_of
from cdpr_sim.statics import cable_kernel as ck
from cdpr_sim.statics import newton_kernel as nk
from cdpr_sim.statics import roots_kernel as rk
from cdpr_sim.statics.lanes_kernel import take


def search(new_cables: Callable) -> Callable:
    """The search from many starts with cables of the type that ``new_cables`` makes."""

    def search_all(
        table, rest_lengths, weight, center_of_mass, wrench, free, scale, enough, damping, starts, start_rotations,
        numbers, flags, positions, rotations, unbalanced,
    ):  # fmt: skip
        """Roots from (rows, columns) of starts; the arguments are those of ``roots_kernel``, and memory."""
        in_a_row, m = starts.shape[1], len(rest_lengths)
        searches = starts.shape[0] * in_a_row
        room = Room(numbers, flags, np.zeros(2, np.int64))
        cables = new_cables(room, table)
        here, trial, model = nk.new_point(room, cables), nk.new_point(room, cables), nk.new_model(room, m)
        slope, normal, gradient, x = matrix(room, 6, 6), matrix(room, 6, 6), vector(room, 6), vector(room, 6)
        tau, taut, found = vector(room, m), truths(room, m), vector(room, 1)
        case = nk.Case(cables, weight, center_of_mass, wrench, free, scale)
        for w in range(WIDTH):
            ck.load(cables, table, rest_lengths, (w,))

        size, share, steps = everywhere(np.inf), everywhere(damping), everywhere(0.0)
        who, active, given = np.zeros(WIDTH, np.int64), 0, 0
        while True:
            begun = 0
            for w in range(WIDTH):
                if given < searches and not (active >> w) & 1:
                    at = given // in_a_row, given % in_a_row
                    nk.copy_pose(starts[at], start_rotations[at], (), trial.p, trial.R, (w,))
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
                        nk.copy_pose(here.p, here.R, (w,), positions[at], rotations[at], ())
                active &= ~ended

            # The next one.
            rk.fill_slope(case, here, model, tau, taut, slope, gradient)
            rk.fill_step(case, slope, gradient, share, normal, x)
            nk.move(case, here, x, trial)
            steps += 1.0

    return search_all

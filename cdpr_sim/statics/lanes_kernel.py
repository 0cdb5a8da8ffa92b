"""Newton's method of ``newton_kernel`` for many problems, eight at a time on ``core.lanes``; compiled.

The formulas of a step are those of ``newton_kernel``, compiled for lanes. What is written here is their order. For one
problem it is a nest of loops: iterations, step lengths, sets of taut cables, retractions. Eight problems go through
these at different paces, so here it is one loop, whose every pass solves the linear system once for each lane, whatever
for:

1. The trial pose is measured. The lane *accepts* it, *retracts* it to the valley's floor, or *rejects* it.
2. Lanes that accepted it have a new point: forces, curvature. Where forces balance at a minimum, the lane has ended.
3. The linear system is solved, for the minimum of the local model or for a retraction. If the minimum has the taut
   cables of the system, it is the next trial pose; if not, the lane *searches* on, with those that it has.

A lane that has ended gets the next problem at once, so that none waits for its neighbours. The pose where a problem
starts is a trial pose that is accepted in any case. A lane to which a formula does not apply computes the same numbers
as before, or numbers that nothing uses.

What is rare is left to ``newton_kernel``: at saddles and neutral equilibria it continues; after stalls, the limit of
iterations, rotations by more than ``LARGEST_TURN`` in one step, and with numbers that are not finite, it begins anew.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from cdpr_sim.core import cable_path
from cdpr_sim.core.compiling import by_type, inline, nowhere, truths, vector, where
from cdpr_sim.core.lanes import WIDTH, Room, bits_of, everywhere, mask_of, of_lanes
from cdpr_sim.core.status import Status
from cdpr_sim.statics import cable_kernel as ck
from cdpr_sim.statics import newton_kernel as nk
from cdpr_sim.statics.cable_kernel import BentState
from cdpr_sim.statics.matrix_kernel import factorise, substitute
from cdpr_sim.statics.newton_kernel import Case, Scales

LARGEST_TURN = 2.4
"""Largest rotation in a step that is accepted [rad]: up to it, the series of ``_turn`` are exact to rounding. Steps are
shorter (``newton_kernel.MAX_ROTATION``), but for retractions, which can be long where they are rejected."""

FIRST_THIRD, MIDDLE, SECOND_THIRD = (math.tan(part * math.pi / 16) for part in (1, 2, 3))
"""Bounds between angles near 0, near 22.5° and near 45°, and the second of these, as slopes. The series of
``_wrap_angle`` is exact to rounding up to the first."""

_CONVERGED, _PENDING = int(Status.CONVERGED), int(Status.PENDING)


@of_lanes(nk.turn)
def _turn(angle2):
    """By the series of sine and cosine at half the angle: processors have no instruction for those."""
    z = 0.25 * angle2
    sine, versine = 1.0, 1.0
    for k in (8, 7, 6, 5, 4, 3, 2, 1):
        sine = 1.0 - z * (sine * (1.0 / (2 * k * (2 * k + 1))))
        versine = 1.0 - z * (versine * (1.0 / ((2 * k + 1) * (2 * k + 2))))
    return sine * (1.0 - 0.5 * z * versine), 0.5 * sine * sine


@of_lanes(cable_path.wrap_angle)
def _wrap_angle(sine, cosine, height):
    """By the series of atan((y − c x)/(x + c y)) = atan(y/x) − atan(c), c the nearest of 0, tan 22.5° and 1."""
    tall, wide = abs(sine), abs(cosine)
    y, x = min(tall, wide), max(tall, wide)
    middle, steep = y > FIRST_THIRD * x, y > SECOND_THIRD * x
    c = where(steep, 1.0, where(middle, MIDDLE, 0.0))
    z = (y - c * x) / (x + c * y)
    square, series = z * z, 0.0
    for k in (10, 9, 8, 7, 6, 5, 4, 3, 2, 1, 0):
        series = 1.0 / (2 * k + 1) - square * series
    angle = where(steep, 0.25 * np.pi, where(middle, 0.125 * np.pi, 0.0)) + z * series
    angle = where(tall > wide, 0.5 * np.pi - angle, angle)
    angle = where(cosine < 0, np.pi - angle, angle)
    return where(sine < 0, where(height < 0, 2 * np.pi, 0.0) - angle, angle)


def solver(new_cables: Callable) -> Callable:
    """The solver of many problems with cables of the type that ``new_cables`` makes."""

    def solve_all(
        tables, rest_lengths, weights, centers_of_mass, wrenches, free, scales_of_length, starts, start_rotations,
        numbers, flags, positions, rotations, lengths, tensions, residuals, iterations, status,
    ):  # fmt: skip
        """Equilibria of (rows, columns) of problems; the arguments are those of ``newton_kernel``, and memory."""
        in_a_row, m = rest_lengths.shape[1:]
        problems = rest_lengths.shape[0] * in_a_row
        room = Room(numbers, flags, np.zeros(2, np.int64))
        cables = new_cables(room, tables[0, 0])
        com, wrench, platform = vector(room, 3), vector(room, 6), vector(room, 2)
        here, trial, model = nk.new_point(room, cables), nk.new_point(room, cables), nk.new_model(room, m)
        x, other = vector(room, 6), vector(room, 6)
        tau, predicted, other_predicted = vector(room, m), vector(room, m), vector(room, m)
        found = vector(room, 2)
        taut, other_taut = truths(room, m), truths(room, m)

        zero, none = everywhere(0.0), mask_of(0)
        V, decrease, work, shift, count, trials, sets, retractions = zero, zero, zero, zero, zero, zero, zero, zero
        scales, least_reach = Scales(zero, zero, zero, zero, zero), zero
        moves, searches, retracts, rounding, certified, too_far = none, none, none, none, none, none
        who, active, given = np.zeros(WIDTH, np.int64), 0, 0
        while True:
            begun = 0
            for w in range(WIDTH):
                if given < problems and not (active >> w) & 1:
                    at = given // in_a_row, given % in_a_row
                    ck.load(cables, tables[at], rest_lengths[at], (w,))
                    platform[0, w], platform[1, w] = weights[at], scales_of_length[at]
                    nk.copy_pose(starts[at], start_rotations[at], (), trial.p, trial.R, (w,))
                    for a in range(3):
                        com[a, w] = centers_of_mass[at][a]
                    for a in range(6):
                        wrench[a, w] = wrenches[at][a]
                    begun |= 1 << w
                    who[w] = given
                    given += 1
            active |= begun
            if active == 0:
                break
            fresh = mask_of(begun)
            moves &= ~fresh  # what the problem before did is forgotten
            searches &= ~fresh
            case = Case(cables, platform[0], com, wrench, free, platform[1])

            # 1. The trial pose.
            V_trial = nk.measure(case, trial)
            fall = V - (V_trial - work)
            last = retractions >= nk.MAX_RETRACTIONS
            enough = (fall >= nk.SUFFICIENT * decrease) | (last & (fall >= nk.LEAST_DECREASE * decrease))
            accepts = moves & (enough | (rounding & (V_trial == V_trial)))
            retracts = moves & ~(accepts | rounding | last)
            rejects = ~(accepts | retracts | searches)
            certified = accepts & (shift == 0.0)
            lower = accepts & (fall > nk.TRUSTED * decrease)
            shift = where(lower, nk.smaller_shift(shift, scales), where(rejects, nk.larger_shift(shift, scales), shift))
            retractions = where(retracts, retractions + 1.0, 0.0)
            sets = where(searches, sets, 0.0)
            count, trials = (
                where(accepts, count + 1.0, count),
                where(accepts, 0.0, where(rejects, trials + 1.0, trials)),
            )
            new = accepts | fresh
            V = where(new, V_trial, V)
            take(new, trial, here)
            for i in range(m):
                certified &= taut[i] == (here.c.e[i] > 0)
                tau[i] = where(accepts, here.c.k[i] * max(predicted[i], 0.0), tau[i])
                taut[i] = where(accepts, predicted[i] > 0, where(rejects, tau[i] > 0, taut[i]))
            if begun:
                scales = _chosen(fresh, nk.scales_of(case, here), scales)
                least_reach = where(fresh, nk.LEAST_REACH * ck.mean(cables.l0), least_reach)
                shift, count, trials = where(fresh, 0.0, shift), where(fresh, 0.0, count), where(fresh, 0.0, trials)
                nk.first_tensions(case, here, scales.load, other_predicted, other_taut)
                for i in range(m):
                    tau[i] = where(fresh, other_predicted[i], tau[i])
                    taut[i] = where(fresh, other_taut[i], taut[i])

            # 2. The point.
            unbalanced = nk.fill_slopes(case, here, model)
            balanced = new & (unbalanced <= scales.force)
            uncertain = balanced & ~certified
            if not nowhere(uncertain):
                nk.spring_tensions(here, other_predicted, other_taut)
                for i in range(m):
                    tau[i] = where(uncertain, other_predicted[i], tau[i])
            nk.fill_curvature(case, here, tau, model)
            if not nowhere(uncertain):
                certified |= uncertain & nk.is_minimum(here, model)
            done = balanced & certified & ck.on_wheels(here.c)
            lost = (balanced & ~done) | (trials >= nk.MAX_TRIALS) | (count >= nk.MAX_ITERATIONS)
            lost |= ~(abs(V + scales.force) < np.inf) | (accepts & too_far)
            ended = active & bits_of(done | lost)
            if ended:
                found[0], found[1] = unbalanced, count
                for w in range(WIDTH):
                    if (ended >> w) & 1:
                        at = who[w] // in_a_row, who[w] % in_a_row
                        status[at] = _CONVERGED if (bits_of(done) >> w) & 1 else _PENDING
                        residuals[at], iterations[at] = found[0, w], int(found[1, w])
                        nk.copy_pose(here.p, here.R, (w,), positions[at], rotations[at], ())
                        if not (bits_of(balanced) >> w) & 1:  # begins anew
                            iterations[at], positions[at], rotations[at] = 0, starts[at], start_rotations[at]
                        for i in range(m):
                            lengths[at][i] = here.c.l[i, w]
                            tensions[at][i] = here.c.k[i, w] * max(here.c.e[i, w], 0.0)
                active &= ~ended

            # 3. The next trial pose.
            nk.fill_system(here, model, shift, taut)
            if not nowhere(retracts):
                nk.fill_correction(trial.c, model, predicted, other)
                _choose(retracts, other, model.rhs)
            solved = factorise(model.L, 6)
            substitute(model.L, model.rhs, other)
            for a in range(6):
                x[a] += other[a]  # which counts where the step is retracted
            for i in range(m):
                other_taut[i] = taut[i]
            searches = ~retracts & solved & nk.update_taut(here, model, other, other_taut)
            for i in range(m):
                taut[i] = where(searches, other_taut[i], taut[i])
            cycles = searches & (sets >= nk.MAX_TAUT_SETS - 1.0)
            targets = solved & ~(searches | retracts)
            searches &= ~cycles
            sets = where(searches, sets + 1.0, sets)
            nk.shorten(other, nk.MAX_TRANSLATION * max(ck.mean(here.c.l), least_reach), nk.MAX_ROTATION * case.scale)
            model_decrease = nk.model_decrease(here.c, model, other, other_predicted)
            decrease = where(targets, model_decrease, decrease)
            _choose(targets, other_predicted, predicted)
            rounding = targets & (abs(decrease) <= nk.energy_noise(here.c, scales, V))
            moves = retracts | (targets & ((decrease > 0) | rounding))
            _choose(~retracts, other, x)
            rotation = x[3] * x[3] + x[4] * x[4] + x[5] * x[5]
            too_far = rotation > case.scale * case.scale * LARGEST_TURN**2
            work = nk.move(case, here, x, trial)

    return solve_all


@inline
def _choose(mask, source, target):
    """Copy the vector ``source`` to ``target`` where the mask is true."""
    for i in range(len(target)):
        target[i] = where(mask, source[i], target[i])


@inline
def take(mask, source, target):
    """Copy a point where the mask is true."""
    for a in range(3):
        target.p[a] = where(mask, source.p[a], target.p[a])
        for b in range(3):
            target.R[a, b] = where(mask, source.R[a, b], target.R[a, b])
    old, new = target.c, source.c
    for i in range(len(old.l)):
        old.l[i], old.f[i] = where(mask, new.l[i], old.l[i]), where(mask, new.f[i], old.f[i])
        old.e[i] = where(mask, new.e[i], old.e[i])
        for a in range(3):
            old.r[i, a] = where(mask, new.r[i, a], old.r[i, a])
            old.u[i, a] = where(mask, new.u[i, a], old.u[i, a])
    _take_bends(old, new, mask)


@by_type
def _take_bends(old, new, mask):
    """Copy what only bent cables have."""


@_take_bends.of(BentState)
def _take_all_bends(old, new, mask):
    for i in range(len(old.l)):
        old.k[i], old.bend[i] = where(mask, new.k[i], old.k[i]), where(mask, new.bend[i], old.bend[i])
        old.clear[i] = where(mask, new.clear[i], old.clear[i])
        for a in range(3):
            old.across[i, a] = where(mask, new.across[i, a], old.across[i, a])


@inline
def _chosen(mask, one, other):
    """The scales ``one`` where the mask is true, and ``other`` elsewhere."""
    return Scales(
        where(mask, one.load, other.load), where(mask, one.size, other.size),
        where(mask, one.least_shift, other.least_shift), where(mask, one.force, other.force),
        where(mask, one.energy, other.energy),
    )  # fmt: skip

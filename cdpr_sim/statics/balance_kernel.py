"""Balance of a load by tensions within limits, compiled: bounded-variable least squares.

The active-set method of Stark and Parker (1995, "Bounded-variable least squares", Computational Statistics 10).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from cdpr_sim.core.cable import PARTS
from cdpr_sim.core.compiling import HEAP, inline, matrix, nowhere, truths, vector, where
from cdpr_sim.statics import cable_kernel as ck

ROUNDING = 1e-12
"""A slope smaller than this fraction of the load is rounding: that tension is optimal."""

DEPENDENT = 1e-10
"""A column whose length after projection is a smaller fraction of its own length depends on the others."""

MOST_CHANGES = 200
"""Largest number of active sets. Eight cables need about ten; where rounding makes the sets cycle, HiGHS decides."""

BALANCED = 1e-9
"""Unbalanced force, as a fraction of the load, that still counts as balance. Where forces balance, the rounding left is
1e-15; this much is left within a nanometre of the border (``scripts/dev/measure_constants.py``)."""

MOST_CUTS = 60
"""Largest number of cutting planes, directions in which the cables pull too little; catalogue robots need a few."""

MOST_GIVEN = 1e3
"""Largest change of the limits, in loads. If no smaller change helps, no tensions balance the load."""


class BalanceScratch(NamedTuple):
    """Intermediate results of ``fill_pulls`` and ``least_squares`` for m cables.

    J, Q: (m, 6); U: (m m); wrench, load, r, q, b: (6); height, t, target: (m); free, upper, blocked: (m), truth values.
    """

    J: np.ndarray
    Q: np.ndarray
    U: np.ndarray
    wrench: np.ndarray
    load: np.ndarray
    r: np.ndarray
    q: np.ndarray
    b: np.ndarray
    height: np.ndarray
    t: np.ndarray
    target: np.ndarray
    free: np.ndarray
    upper: np.ndarray
    blocked: np.ndarray


@inline
def new_scratch(room, m):
    """Memory of these results."""
    return BalanceScratch(
        matrix(room, m, 6), matrix(room, m, 6), vector(room, m * m), vector(room, 6), vector(room, 6), vector(room, 6),
        vector(room, 6), vector(room, 6), vector(room, m), vector(room, m), vector(room, m), truths(room, m),
        truths(room, m), truths(room, m),
    )  # fmt: skip


def shortfall(new_cables: Callable) -> Callable:
    """An element of the gufunc, for cables of the type that ``new_cables`` makes."""

    def unbalanced(table, lower, upper, weight, com, wrenches, free, scale, position, rotation, left):
        """Unbalanced part of the worst load."""
        scratch = new_scratch(HEAP, len(lower))
        if not _fill_pulls_at(new_cables(HEAP, table), table, scale, position, rotation, scratch):
            left[0] = np.nan
            return
        left[0] = 0.0
        for k in range(len(wrenches)):
            for a in range(6):
                scratch.wrench[a] = wrenches[k, a]
            left[0] = max(left[0], least_part(lower, upper, weight, com, free, scale, rotation, scratch))
            if left[0] == np.inf:
                return

    return unbalanced


@inline
def least_part(lower, upper, weight, com, free, scale, rotation, scratch):
    """Unbalanced part of the load ``scratch.wrench``; inf where the active sets cycle."""
    load, height, J = scratch.load, scratch.height, scratch.J
    norm = _fill_load(weight, com, rotation, free, scale, scratch)
    for i in range(len(height)):
        height[i] = (upper[i] - lower[i]) / norm
        for a in range(len(free)):
            load[a] += J[i, free[a]] * (lower[i] / norm)
    return _least_squares(load, free, scratch)


def margin(new_cables: Callable) -> Callable:
    """The same."""

    def least_distance(table, lower, upper, weight, com, wrenches, free, scale, position, rotation, distance):
        """Largest distance of the tensions from their limits: cutting planes, from above.

        Where tensions at least t from their limits do not balance the load, the residual r of the least squares is a
        direction in which they pull too little. The most that they can pull along r is linear in t: the t at which it
        suffices is the next iterate. There are finitely many such directions, and every step excludes one.
        """
        m, n, shifted = len(lower), len(free), np.empty(6)
        scratch = new_scratch(HEAP, m)
        load, height, J, r = scratch.load, scratch.height, scratch.J, scratch.r
        if not _fill_pulls_at(new_cables(HEAP, table), table, scale, position, rotation, scratch):
            distance[0] = np.nan
            return
        distance[0] = np.inf
        for k in range(len(wrenches)):
            for a in range(6):
                scratch.wrench[a] = wrenches[k, a]
            norm = _fill_load(weight, com, rotation, free, scale, scratch)
            t = 1.0
            for i in range(m):
                t = min(t, (upper[i] - lower[i]) / (2 * norm))
            for _ in range(MOST_CUTS):
                for a in range(n):
                    shifted[a] = load[a]
                for i in range(m):
                    height[i] = max(0.0, (upper[i] - lower[i]) / norm - 2 * t)
                    for a in range(n):
                        shifted[a] += J[i, free[a]] * (lower[i] / norm + t)
                left = _least_squares(shifted, free, scratch)
                if left == np.inf:
                    distance[0] = np.nan
                    return
                if left <= BALANCED:
                    break
                needed, pull, size = 0.0, 0.0, 0.0
                for a in range(n):
                    needed += r[a] * load[a]
                    size += r[a] ** 2
                for i in range(m):
                    along = 0.0
                    for a in range(n):
                        along += r[a] * J[i, free[a]]
                    if along <= 0.0 and upper[i] == np.inf:
                        continue  # rounding: without an upper limit the pull along r is unbounded
                    pull += abs(along)
                    needed += along * (lower[i] if along > 0.0 else upper[i]) / norm
                if not needed < MOST_GIVEN * pull:
                    t = -np.inf
                    break
                following = -needed / pull
                if not following < t:
                    break
                t = following
            distance[0] = min(distance[0], t * norm)

    return least_distance


@inline
def _fill_pulls_at(cables, table, scale, position, rotation, scratch):
    """``fill_pulls`` at a pose."""
    ck.load(cables, table, np.ones(len(table)), ())  # rest lengths have no effect here
    state = ck.new_state(cables, HEAP)
    ck.measure(cables, position, rotation, state)
    return fill_pulls(state, table[:, PARTS], scale, scratch)


@inline
def fill_pulls(state, parts, scale, scratch):
    """Force of each cable on the six directions per newton in its rope, into ``scratch.J``; False where not finite."""
    J = scratch.J
    ck.fill_jacobian(state, scale, J)
    known = ck.on_wheels(state)
    for i in range(len(J)):
        known &= (state.l[i] > 0.0) & (state.l[i] < np.inf)
        for a in range(6):
            J[i, a] *= -parts[i]
    return known


@inline
def _fill_load(weight, com, rotation, free, scale, scratch):
    """The weight and ``scratch.wrench`` on the free directions, as fractions of their size [N], into ``scratch.load``.

    Returns:
        That size; 1 where there is no load.
    """
    w, load, R = scratch.wrench, scratch.load, rotation
    w[2] -= weight
    w[3] -= (R[1, 0] * com[0] + R[1, 1] * com[1] + R[1, 2] * com[2]) * weight
    w[4] += (R[0, 0] * com[0] + R[0, 1] * com[1] + R[0, 2] * com[2]) * weight
    norm2 = 0.0
    for a in range(len(free)):
        load[a] = w[free[a]] / scale if free[a] >= 3 else w[free[a]]
        norm2 += load[a] * load[a]
    norm = math.sqrt(where(norm2 > 0.0, norm2, 1.0))
    for a in range(len(free)):
        load[a] /= norm
    return norm


@inline
def _least_squares(w, free, scratch):
    """The least ‖J t + w‖ over 0 ≤ t ≤ height, on the directions ``free``; inf where the active sets cycle.

    Stark and Parker's active-set method: a tension whose change reduces the residual enters the set of free ones; where
    the least squares over the set leave the limits, the step ends there, and what reaches its limit leaves the set. In
    each pass of the loop, least squares are solved once. The residual J t + w is written into ``scratch.r``.
    """
    J, height, r, t, target = scratch.J, scratch.height, scratch.r, scratch.t, scratch.target
    inside, upper, blocked = scratch.free, scratch.upper, scratch.blocked
    m, n, size = len(height), len(free), 1.0
    for i in range(m):
        t[i], inside[i], upper[i], blocked[i] = 0.0, False, False, False
    for a in range(n):
        size = max(size, abs(w[a]))
    runs = size == size  # all of them
    chooses, left = runs, where(runs, np.inf, size)
    for _ in range(MOST_CHANGES):
        norm2 = 0.0
        for a in range(n):
            r[a] = w[a]
            for i in range(m):
                r[a] += J[i, free[a]] * t[i]
            norm2 += r[a] * r[a]
        enters, steepest = -1.0, ROUNDING * size
        for i in range(m):
            slope = 0.0
            for a in range(n):
                slope -= J[i, free[a]] * r[a]
            slope = where(inside[i] | blocked[i] | (height[i] == 0.0), 0.0, where(upper[i], -slope, slope))
            enters = where(slope > steepest, i, enters)
            steepest = max(steepest, slope)
        ends = runs & chooses & ((enters < 0.0) | (norm2 <= (ROUNDING * size) * (ROUNDING * size)))
        left = where(ends, math.sqrt(norm2), left)
        runs = where(ends, False, runs)
        if nowhere(runs):
            break
        chooses &= runs
        for i in range(m):
            inside[i] = inside[i] | (chooses & (enters == i))
        wrong = _solve_free(w, free, scratch)
        for i in range(m):  # only by rounding did this tension seem to help
            backwards = where(upper[i], target[i] >= height[i], target[i] <= 0.0)
            wrong = wrong | ((enters == i) & backwards)
        wrong = wrong & chooses
        for i in range(m):
            out = wrong & (enters == i)
            inside[i] = where(out, False, inside[i])
            blocked[i] = blocked[i] | out
        step, stops = 1.0, -1.0
        for i in range(m):
            beyond = inside[i] & ((target[i] < 0.0) | (target[i] > height[i]))
            fraction = (where(target[i] < 0.0, 0.0, height[i]) - t[i]) / where(beyond, target[i] - t[i], 1.0)
            nearest = beyond & ((fraction < step) | (stops < 0.0))
            step, stops = where(nearest, min(fraction, step), step), where(nearest, i, stops)
        goes = where(wrong, False, runs)
        whole = goes & (stops < 0.0)
        for i in range(m):
            moves = goes & inside[i]
            t[i] = where(moves, t[i] + step * (target[i] - t[i]), t[i])
            low = moves & (target[i] < 0.0) & ((stops == i) | (t[i] <= 0.0))
            high = moves & (target[i] > height[i]) & ((stops == i) | (t[i] >= height[i]))
            t[i] = where(low, 0.0, where(high, height[i], t[i]))
            inside[i] = where(low | high, False, inside[i])
            upper[i] = where(low | high, high, upper[i])
            blocked[i] = where(whole, False, blocked[i])
        chooses = wrong | whole
    return left


@inline
def _solve_free(w, free, scratch):
    """Least squares over the tensions inside, the others at their limits, into ``target``; True where dependent.

    Gram-Schmidt, twice, which makes the columns orthogonal to rounding.
    """
    J, Q, U, q, b, target = scratch.J, scratch.Q, scratch.U, scratch.q, scratch.b, scratch.target
    inside, upper, height = scratch.free, scratch.upper, scratch.height
    m, n = len(height), len(free)
    dependent = inside[0] != inside[0]
    for a in range(n):
        b[a] = -w[a]
    for i in range(m):
        target[i] = 0.0
        full = where(upper[i], where(inside[i], 0.0, height[i]), 0.0)
        if not nowhere(full > 0.0):
            for a in range(n):
                b[a] -= J[i, free[a]] * full
        if nowhere(inside[i]):
            continue
        before, after = 0.0, 0.0
        for a in range(n):
            q[a] = J[i, free[a]]
            before += q[a] * q[a]
        for c in range(i):
            U[c * m + i] = 0.0
        for _ in range(2):
            for c in range(i):
                if nowhere(inside[c]):
                    continue
                along = 0.0
                for a in range(n):
                    along += Q[c, a] * q[a]
                U[c * m + i] += along
                for a in range(n):
                    q[a] -= along * Q[c, a]
        for a in range(n):
            after += q[a] * q[a]
        lost = inside[i] & (after <= DEPENDENT * DEPENDENT * before)
        dependent = dependent | lost
        norm = math.sqrt(where(lost, 1.0, where(inside[i], after, 1.0)))
        U[i * m + i] = norm
        for a in range(n):
            Q[i, a] = where(inside[i], q[a] / norm, 0.0)
    for c in range(m - 1, -1, -1):
        if nowhere(inside[c]):
            continue
        value = 0.0
        for a in range(n):
            value += Q[c, a] * b[a]
        for later in range(c + 1, m):
            if nowhere(inside[later]):
                continue
            value -= U[c * m + later] * target[later]
        target[c] = where(inside[c], value / U[c * m + c], 0.0)
    return dependent

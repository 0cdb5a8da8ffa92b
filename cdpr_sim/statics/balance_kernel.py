"""Balance of a load by tensions within limits, compiled: bounded-variable least squares.

The active-set method of Stark and Parker (1995, "Bounded-variable least squares", Computational Statistics 10).
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from cdpr_sim.core.cable import PARTS
from cdpr_sim.core.compiling import Kernel, inline
from cdpr_sim.statics import cable_kernel as ck

ROUNDING = 1e-12
"""A slope smaller than this fraction of the load is rounding: that tension is optimal."""

DEPENDENT = 1e-10
"""A column whose length after projection is a smaller fraction of its own length depends on the others."""

MOST_CHANGES = 100
"""Largest number of changes of the active set. Eight cables need about ten; where rounding makes the sets cycle, HiGHS
decides."""

BALANCED = 1e-9
"""Unbalanced force, as a fraction of the load, that still counts as balance. Where forces balance, the rounding left is
1e-15; this much is left within a nanometre of the border (``scripts/measure_constants.py``)."""

MOST_CUTS = 60
"""Largest number of cutting planes, directions in which the cables pull too little; catalogue robots need a few."""

MOST_GIVEN = 1e3
"""Largest change of the limits, in loads. If no smaller change helps, no tensions balance the load."""


def _shortfall(unpack: Callable) -> Callable:
    """An element of the gufunc, for cables of the type that ``unpack`` makes of the table."""

    def shortfall(table, lower, upper, weight, com, wrenches, free, scale, position, rotation, left):
        """Unbalanced part of the worst load."""
        cables = unpack(table, np.ones(len(lower)))  # rest lengths have no effect here
        m, n = len(lower), len(free)
        on_free, load, height, r = np.empty((n, m)), np.empty(n), np.empty(m), np.empty(n)
        if not _fill_pulls(table, cables, free, scale, position, rotation, on_free):
            left[0] = np.nan
            return
        left[0] = 0.0
        for k in range(len(wrenches)):
            norm = _fill_load(wrenches[k], weight, com, rotation, free, scale, load)
            for i in range(m):
                height[i] = (upper[i] - lower[i]) / norm
                for a in range(n):
                    load[a] += on_free[a, i] * (lower[i] / norm)
            left[0] = max(left[0], _least_squares(on_free, load, height, r))
            if left[0] == np.inf:
                return

    return shortfall


def _margin(unpack: Callable) -> Callable:
    """The same."""

    def least_distance(table, lower, upper, weight, com, wrenches, free, scale, position, rotation, margin):
        """Largest distance of the tensions from their limits: cutting planes, from above.

        Where tensions at least t from their limits do not balance the load, the residual r of the least squares is a
        direction in which they pull too little. The most that they can pull along r is linear in t: the t at which it
        suffices is the next iterate. There are finitely many such directions, and every step excludes one.
        """
        cables = unpack(table, np.ones(len(lower)))  # rest lengths have no effect here
        m, n = len(lower), len(free)
        on_free, load, shifted = np.empty((n, m)), np.empty(n), np.empty(n)
        height, r = np.empty(m), np.empty(n)
        if not _fill_pulls(table, cables, free, scale, position, rotation, on_free):
            margin[0] = np.nan
            return
        margin[0] = np.inf
        for k in range(len(wrenches)):
            norm = _fill_load(wrenches[k], weight, com, rotation, free, scale, load)
            t = 1.0
            for i in range(m):
                t = min(t, (upper[i] - lower[i]) / (2 * norm))
            for _ in range(MOST_CUTS):
                for a in range(n):
                    shifted[a] = load[a]
                for i in range(m):
                    height[i] = max(0.0, (upper[i] - lower[i]) / norm - 2 * t)
                    for a in range(n):
                        shifted[a] += on_free[a, i] * (lower[i] / norm + t)
                left = _least_squares(on_free, shifted, height, r)
                if left == np.inf:
                    margin[0] = np.nan
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
                        along += r[a] * on_free[a, i]
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
            margin[0] = min(margin[0], t * norm)

    return least_distance


_LAYOUT = "(m,n),(m),(m),(),(c),(k,d),(f),(),(c),(c,c)->()"
_SHORTFALLS = ck.kernels("balance of forces", _shortfall, _LAYOUT, ("free",))
_MARGINS = ck.kernels("margins of tensions", _margin, _LAYOUT, ("free",))


def shortfall_gufunc(*, bent: bool = False) -> Kernel:
    """Gufunc of the unbalanced part of the load: inf where the active sets cycle, nan where the input is not finite."""
    return _SHORTFALLS[bent]


def margin_gufunc(*, bent: bool = False) -> Kernel:
    """Gufunc of the largest distance of tensions from limits [N]: nan for cycles and input that is not finite."""
    return _MARGINS[bent]


@inline
def _fill_pulls(table, cables, free, scale, position, rotation, on_free):
    """Force of each cable on the free directions per newton in its rope, into (free, cables).

    False where it is not finite.
    """
    m, n = on_free.shape[1], len(free)
    state, J = ck.new_state(cables), np.empty((m, 6))
    ck.measure(cables, position, rotation, state)
    ck.fill_jacobian(state, scale, J)
    for i in range(m):
        if not np.isfinite(state.l[i]) or state.l[i] == 0.0 or not ck.on_wheels(state):
            return False
        for a in range(n):
            on_free[a, i] = -table[i, PARTS] * J[i, free[a]]
    return True


@inline
def _fill_load(wrench, weight, com, rotation, free, scale, load):
    """The weight and an external wrench on the free directions, as fractions of their size [N]; returns that size."""
    n, w, c = len(free), np.empty(6), np.empty(3)
    for a in range(3):
        c[a] = rotation[a, 0] * com[0] + rotation[a, 1] * com[1] + rotation[a, 2] * com[2]
    w[0], w[1], w[2] = wrench[0], wrench[1], wrench[2] - weight
    w[3] = (wrench[3] - c[1] * weight) / scale
    w[4] = (wrench[4] + c[0] * weight) / scale
    w[5] = wrench[5] / scale
    norm2 = 0.0
    for a in range(n):
        norm2 += w[free[a]] ** 2
    norm = np.sqrt(norm2) if norm2 > 0 else 1.0
    for a in range(n):
        load[a] = w[free[a]] / norm
    return norm


@inline
def _least_squares(W, w, height, r):
    """The least ‖W t + w‖ over 0 ≤ t ≤ height: Stark and Parker's active-set method; inf where it does not end.

    The residual W t + w is written into ``r``.
    """
    n, m = W.shape
    t, target = np.zeros(m), np.zeros(m)
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
            if first and (not independent or backwards):  # only by rounding did this tension seem to help
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
            for i in range(m):  # other tensions that reach a limit in the same step
                if state[i] == 2 and (t[i] <= 0.0 and target[i] < 0.0):
                    state[i], t[i] = 0, 0.0
                elif state[i] == 2 and (t[i] >= height[i] and target[i] > height[i]):
                    state[i], t[i] = 1, height[i]
    return np.inf


@inline
def _solve_free(W, w, height, state, newest, Q, U, order, target):
    """Least squares over the free tensions, the others at their limits; False where the newest column is dependent.

    Gram-Schmidt, twice, which makes the columns orthogonal to rounding; the newest column is the last.
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

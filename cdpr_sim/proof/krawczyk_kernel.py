"""Krawczyk's test for a box of poses, compiled: no equilibrium, exactly one, or perhaps some."""

from __future__ import annotations

import numpy as np

from cdpr_sim.core.compiling import outlined
from cdpr_sim.proof.contraction_kernel import invert
from cdpr_sim.proof.geometry_kernel import (
    ACROSS,
    ARM,
    BEND,
    BEYOND,
    DIRECTION,
    EA_HIGH,
    FREE,
    LENGTH,
    RADIUS,
    REST,
    WHOLE_HIGH,
    WHOLE_LOW,
    compliance,
    geometry,
    load,
    slope,
    strained,
    strains_over,
    tension,
)
from cdpr_sim.proof.interval_kernel import (
    TINY,
    add,
    cross,
    down,
    multiply,
    narrowed,
    negative,
    of_sums,
    over,
    product,
    row,
    scaled,
    subtract,
    up,
)

OPENED = 0.05
"""Fraction by which a range of tensions is widened for Krawczyk's test, so that the image of slack can lie inside."""

EMPTY, CONTRACTED, UNIQUE = 0, 1, 2
"""Results of Krawczyk's test for a box: no equilibrium, perhaps some, exactly one."""


@outlined
def bending(o, i, setup, B):
    """Fill B (free, free, 2): derivatives of cable i's direction and moment by translation and rotation vector."""
    rows, n = setup.rows, len(setup.rows)
    c, E, planar = o[i], np.zeros((3, 6, 2)), n == 3
    for r in range(3):  # E = ([n]×, n·u − u nᵀ), and (1 − n nᵀ) seen by the arm is Eᵀ E
        if planar and r != 1:
            continue
        s, t = (r + 1) % 3, (r + 2) % 3
        E[r, s, 0], E[r, s, 1] = negative(row(c, DIRECTION + t))
        E[r, t, 0], E[r, t, 1] = row(c, DIRECTION + s)
        for x in range(3):
            if x != r and not planar:
                E[r, 3 + x, 0], E[r, 3 + x, 1] = negative(multiply(row(c, ARM + r), row(c, DIRECTION + x)))
        along = multiply(row(c, ARM + s), row(c, DIRECTION + s)), multiply(row(c, ARM + t), row(c, DIRECTION + t))
        E[r, 3 + r, 0], E[r, 3 + r, 1] = add(along[0], along[1])
    for k in range(n):
        for j in range(k + 1):
            total = 0.0, 0.0
            for e in range(3):
                if not planar or e == 1:
                    total = add(total, product(E[e], rows[k], rows[j]))
            turned = over(total, row(c, FREE))
            B[k, j, 0], B[k, j, 1] = turned
            B[j, k, 0], B[j, k, 1] = turned
    if setup.wheels[i, RADIUS, 0] > 0 and not planar:  # a planar robot's wheel does not swivel
        side = np.empty((6, 2))
        for r in range(3):
            side[r, 0], side[r, 1] = row(c, ACROSS + r)
        for r in range(3):
            side[3 + r, 0], side[3 + r, 1] = cross(c, ARM, side, 0, r)
        for r in range(6):
            for x in range(6):
                swivelled = multiply(product(side, r, x), row(c, BEND))
                B[r, x, 0], B[r, x, 1] = add(row(B[r], x), swivelled)
    for k in range(n):
        for j in range(n):
            if rows[k] > 2 and rows[j] > 2:  # the pull keeps its direction and its arm turns: u nᵀ − n·u
                B[k, j, 0], B[k, j, 1] = subtract(row(B[k], j), row(E[rows[k] - 3], rows[j]))


@outlined
def derivatives(T, setup, o, spin, acting, count, B, J):
    """Fill J: derivatives of the balances and of the cables' extensions by the free coordinates, at tensions T.

    The columns of the tensions are those of taut cables. B (cables, free, free, 2) is each cable's ``bending``.
    """
    m, rows, n = setup.exits.shape[0], setup.rows, len(setup.rows)
    turned, weight = np.empty((6, 2)), (setup.weight[0], setup.weight[1])
    for r in range(n + count):
        for x in range(n):
            total = 0.0, 0.0
            if r >= n:
                total = row(o[acting[r - n]], DIRECTION + rows[x])
            else:
                for k in range(count):
                    i = acting[k]
                    total = add(total, multiply(row(B[i, r], x), row(T, i)))
                e, f = rows[r] - 3, rows[x] - 3
                if e >= 0 and f == 2:
                    total = add(total, multiply(weight, row(o[m], ARM + e)))
                if e >= 0 and e == f:
                    total = subtract(total, multiply(weight, row(o[m], ARM + 2)))
            turned[x, 0], turned[x, 1] = total
        for x in range(n):  # from rotation vectors to v: by its angular velocities
            total = row(turned, x)
            if rows[x] > 2:
                total = 0.0, 0.0
                for e in range(n):
                    if rows[e] > 2:
                        total = add(total, multiply(row(turned, e), row(spin, 3 * (rows[x] - 3) + rows[e] - 3)))
            if r >= n:
                i = acting[r - n]
                total = multiply(total, slope(setup.law[i], strains_over(setup.law[i], row(o[i], LENGTH))))
            J[r, x, 0], J[r, x, 1] = total
    for k in range(count):
        i = acting[k]
        for r in range(count):
            J[n + r, n + k, 0] = J[n + r, n + k, 1] = 0.0
        for r in range(n):
            J[r, n + k, 0], J[r, n + k, 1] = row(o[i], DIRECTION + rows[r])
        J[n + k, n + k, 0], J[n + k, n + k, 1] = negative(compliance(setup.law[i]))


@outlined
def branched(J, setup, o, acting, count, taut, low, high, gap):
    """Multiply the tensions' columns of J: the tension is max(y, 0), with a slope in [low, high] (cables,).

    And the cable's extension is min(y, 0) times ``gap`` where it is slack.
    """
    rows, n = setup.rows, len(setup.rows)
    for k in range(count):
        if taut[k]:
            continue
        i, share = acting[k], (low[k], high[k])
        for r in range(n):
            J[r, n + k, 0], J[r, n + k, 1] = multiply(row(o[i], DIRECTION + rows[r]), share)
        longer = multiply(share, compliance(setup.law[i])), scaled(subtract((1.0, 1.0), share), gap[k])
        J[n + k, n + k, 0], J[n + k, n + k, 1] = negative(add(longer[0], longer[1]))


@outlined
def enclosed(J, Jm, Jr):
    """Middles and radii of J, rounded upwards."""
    for r in range(J.shape[0]):
        for c in range(J.shape[0]):
            mean = 0.5 * (J[r, c, 0] + J[r, c, 1])
            Jm[r, c], Jr[r, c] = mean, up(max(up(J[r, c, 1] - mean), up(mean - J[r, c, 0])))


@outlined
def deviations(C, Jm, Jr, E, spread):
    """Fill E with bounds of |1 − C J|, and ``spread`` with the part of them that is from the width of J."""
    N = C.shape[0]
    share = of_sums(N)
    for r in range(N):
        for c in range(N):
            E[r, c], spread[r, c] = (1.0 if r == c else 0.0), 0.0
        size = np.abs(E[r])
        for s in range(N):
            part = C[r, s]
            for c in range(N):
                E[r, c] -= part * Jm[s, c]
                size[c] += abs(part * Jm[s, c])
                spread[r, c] += abs(part) * Jr[s, c]
        for c in range(N):
            E[r, c] = (abs(E[r, c]) + spread[r, c] + share * size[c]) * (1 + share) + TINY


@outlined
def krawczyk(q, T, setup, o, spin, at, smear):
    """Krawczyk's test in the free coordinates and in one unknown y for each cable that may be taut; contracts q and T.

    y is the tension where it is positive; where it is negative, y times ``gap`` is the cable's extension l − l0 < 0.
    With a ``gap`` near the compliance that the cable meets, the slopes by y hardly differ between taut and slack.
    A cable whose tension is proved positive has one slope, even if its length in the box may be below its rest length.

    The image is taken with slopes about the middle, which are narrower than derivatives; these prove uniqueness.

    Returns EMPTY, CONTRACTED or UNIQUE; the middle of its image is written to ``at`` (6,), and to ``smear`` (6,) by how
    much each coordinate's width widens the image.
    """
    m, rows, n = T.shape[0], setup.rows, len(setup.rows)
    acting, count = np.empty(m, np.int64), 0
    if not geometry(q, setup, o, spin):
        return EMPTY
    for i in range(m):
        if setup.wheels[i, RADIUS, 0] > 0 and not (o[i, FREE, 0] > 0 and o[i, BEYOND, 0] > 0):
            return CONTRACTED
        if o[i, LENGTH, 1] > setup.law[i, REST]:
            if not o[i, FREE, 0] > 0:
                return CONTRACTED
            acting[count] = i
            count += 1
    N = n + count
    pull = setup.weight[1] + abs(setup.wrench[0]) + abs(setup.wrench[1]) + abs(setup.wrench[2])
    middle, radius, thin, between = np.empty(N), np.empty(N), q.copy(), np.zeros((m, 2))
    B, J, taut = np.empty((m, n, n, 2)), np.empty((N, N, 2)), np.empty(count, np.bool_)
    gap, low, high, Y = np.empty(count), np.empty(count), np.empty(count), np.empty((N, 2))
    C, Jm, Jr, choices = np.empty((N, N)), np.empty((N, N)), np.empty((N, N)), 1
    for r in range(n):
        Y[r, 0], Y[r, 1] = row(q, rows[r])
        middle[r] = 0.5 * (Y[r, 0] + Y[r, 1])
        thin[rows[r], 0] = thin[rows[r], 1] = middle[r]
    for k in range(count):
        i = acting[k]
        bending(o, i, setup, B[i])
        taut[k] = T[i, 0] > 0
        gap[k] = setup.law[i, REST] / pull
        if not taut[k]:
            choices = 2
    for choice in range(choices):
        for k in range(count):
            i = acting[k]
            wider = OPENED * (T[i, 1] - T[i, 0]) + 1e-9 * pull + TINY
            bottom, low[k], high[k] = max(T[i, 0] - wider, 0.5 * T[i, 0]), 1.0, 1.0
            if not taut[k]:
                bottom = min(down(down(o[i, LENGTH, 0] - setup.law[i, REST]) / gap[k]), 0.0)
                wider += OPENED * abs(bottom)
                bottom -= wider
            top = T[i, 1] + wider
            y = 0.5 * (bottom + top)
            Y[n + k, 0], Y[n + k, 1], middle[n + k] = bottom, top, y
            between[i, 0] = between[i, 1] = max(y, 0.0)
            if not taut[k]:  # slopes of max(y, 0) about the middle
                low[k] = max(down(y / up(y - bottom)), 0.0) if y > 0 else 0.0
                high[k] = 1.0 if y > 0 else up(top / down(top - y))
        derivatives(between, setup, o, spin, acting, count, B, J)
        branched(J, setup, o, acting, count, taut, low, high, gap)
        enclosed(J, Jm, Jr)
        C[:] = Jm
        if not invert(C):
            return CONTRACTED
        if choice < choices - 1:
            for k in range(count):
                if not taut[k]:  # the pivot is h (compliance met + compliance of the cable) + (1 − h) gap
                    i = acting[k]
                    h, own = max(0.5 * (low[k] + high[k]), 0.1), setup.law[i, WHOLE_LOW] / setup.law[i, EA_HIGH]
                    met = (1 / max(abs(C[n + k, n + k]), TINY) - (1 - h) * gap[k]) / h
                    gap[k] = min(max(met, own), 1e3 * setup.law[i, REST] / pull)
    for r in range(N):
        radius[r] = up(max(up(Y[r, 1] - middle[r]), up(middle[r] - Y[r, 0])))
    E, spread, G, g = np.empty((N, N)), np.empty((N, N)), np.empty((N, 2)), np.empty((6, 2))
    deviations(C, Jm, Jr, E, spread)
    for c in range(n):
        smear[rows[c]] = 0.0
        for r in range(n):
            smear[rows[c]] = max(smear[rows[c]], setup.scales[rows[r]] * spread[r, c] * radius[c])
    if not geometry(thin, setup, o, spin):
        return CONTRACTED
    load(setup, o, g)
    for r in range(n):
        G[r, 0], G[r, 1] = row(g, rows[r])
    for k in range(count):
        i, tau, y = acting[k], between[acting[k], 0], middle[n + k]
        law = setup.law[i]
        for r in range(n):
            G[r, 0], G[r, 1] = add(row(G, r), scaled(row(o[i], DIRECTION + rows[r]), tau))
        a, b = strains_over(law, row(o[i], LENGTH))
        low_end, high_end = strained(law, (a, a))[0] + min(a, 0.0), strained(law, (b, b))[1] + min(b, 0.0)
        extension = multiply((down(low_end), up(high_end)), (law[WHOLE_LOW], law[WHOLE_HIGH]))
        off = subtract(extension, multiply(compliance(law), (tau, tau)))
        if y < 0:
            off = subtract(off, (down(y * gap[k]), up(y * gap[k])))
        G[n + k, 0], G[n + k, 1] = off
    inside, share = True, of_sums(N)
    for r in range(N):
        step, size, wide = 0.0, 0.0, 0.0
        for c in range(N):
            mean = 0.5 * (G[c, 0] + G[c, 1])
            step -= C[r, c] * mean
            size += abs(C[r, c] * mean)
            wide += abs(C[r, c]) * up(G[c, 1] - G[c, 0]) + E[r, c] * radius[c]
        wide = (wide + share * size) * (1 + share) + TINY
        k0, k1 = down(down(middle[r] + step) - wide), up(up(middle[r] + step) + wide)
        if not (k0 > -np.inf and k1 < np.inf):
            return CONTRACTED
        inside = inside and k0 > Y[r, 0] and k1 < Y[r, 1]
        k0, k1 = max(k0, Y[r, 0]), min(k1, Y[r, 1])
        if k0 > k1:
            return EMPTY
        if r < n:
            q[rows[r], 0], q[rows[r], 1] = k0, k1
            at[rows[r]] = 0.5 * (k0 + k1)
        elif not narrowed(T, acting[r - n], (k0, max(k1, 0.0))):
            return EMPTY
    if not inside:
        return CONTRACTED
    for r in range(n):
        thin[rows[r], 0], thin[rows[r], 1] = row(Y, r)
    if not geometry(thin, setup, o, spin):
        return CONTRACTED
    for k in range(count):
        between[acting[k], 0], between[acting[k], 1] = max(Y[n + k, 0], 0.0), max(Y[n + k, 1], 0.0)
        low[k], high[k] = 0.0, 1.0
    derivatives(between, setup, o, spin, acting, count, B, J)
    branched(J, setup, o, acting, count, taut, low, high, gap)
    enclosed(J, Jm, Jr)
    deviations(C, Jm, Jr, E, spread)
    for r in range(N):
        wide = 0.0
        for c in range(N):
            wide = up(wide + up(E[r, c] * radius[c]))
        if not wide < down(radius[r]):
            return CONTRACTED
    return UNIQUE


@outlined
def steps_to_equilibrium(start, setup, o, spin):
    """Newton's steps in floats from a pose (6,): the last pose, and whether they converge. Not a proof."""
    m, rows, n = setup.exits.shape[0], setup.rows, len(setup.rows)
    y, last, g, B = start.copy(), np.inf, np.empty((6, 2)), np.empty((m, n, n, 2))
    thin, T, acting = np.empty((6, 2)), np.zeros((m, 2)), np.empty(m, np.int64)
    for _ in range(40):
        for r in range(6):
            thin[r, 0] = thin[r, 1] = y[r]
        if not geometry(thin, setup, o, spin):
            return y, False
        load(setup, o, g)
        count = 0
        F = np.zeros(n)
        for r in range(n):
            F[r] = g[rows[r], 0]
        for i in range(m):
            tau = tension(setup.law[i], (o[i, LENGTH, 0], o[i, LENGTH, 0]))[1]
            T[i, 0] = T[i, 1] = tau
            if o[i, LENGTH, 0] > setup.law[i, REST]:
                acting[count] = i
                count += 1
                bending(o, i, setup, B[i])
                for r in range(n):
                    F[r] += tau * o[i, DIRECTION + rows[r], 0]
        J = np.empty((n + count, n + count, 2))
        derivatives(T, setup, o, spin, acting, count, B, J)
        C = J[:, :, 0].copy()
        if not invert(C):
            return y, False
        step, size = np.zeros(n), 0.0
        for r in range(n):
            for c in range(n):
                step[r] -= C[r, c] * F[c]
            size = max(size, abs(step[r]) * setup.scales[rows[r]])
        part = min(1.0, 500 * setup.near / max(size, TINY))
        for r in range(n):
            y[rows[r]] += part * step[r]
        if size < 1e-11 * setup.near or (size < 1e-7 * setup.near and size >= last):
            return y, True
        last = size
    return y, False


@outlined
def within(q, box, rows):
    """Whether q lies in the box."""
    for r in rows:  # noqa: SIM110  (Numba compiles no generator)
        if q[r, 0] < box[r, 0] or q[r, 1] > box[r, 1]:
            return False
    return True


@outlined
def blown_up(q, setup, o, spin, box):
    """Write to ``box`` a box about an equilibrium near q that contains q and exactly one equilibrium. False if none."""
    m, rows = setup.exits.shape[0], setup.rows
    y = np.empty(6)
    for r in range(6):
        y[r] = 0.5 * (q[r, 0] + q[r, 1])
    y, ended = steps_to_equilibrium(y, setup, o, spin)
    if not ended:
        return False
    at, smear, T, size = np.empty(6), np.empty(6), np.empty((m, 2)), 100 * setup.near
    while size > setup.least / 10:
        box[:] = q
        for r in rows:
            box[r, 0], box[r, 1] = y[r] - size / setup.scales[r], y[r] + size / setup.scales[r]
        if not within(q, box, rows):
            return False
        tried = box.copy()
        if not geometry(tried, setup, o, spin):
            return False
        for i in range(m):
            T[i, 0], T[i, 1] = tension(setup.law[i], row(o[i], LENGTH))
        if krawczyk(tried, T, setup, o, spin, at, smear) == UNIQUE:
            return True
        size /= 10
    return False

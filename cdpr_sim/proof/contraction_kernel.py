"""Contraction of a box of poses and of the tensions' ranges by lengths, balances and virtual works, compiled."""

from __future__ import annotations

import numpy as np

from cdpr_sim.core.compiling import outlined
from cdpr_sim.proof.geometry_kernel import (
    ARM,
    BEYOND,
    DIRECTION,
    EA_HIGH,
    EA_LOW,
    FROM_EXIT,
    LENGTH,
    RADIUS,
    REST,
    SLOPE_HIGH,
    SLOPE_LOW,
    WHOLE_HIGH,
    WHOLE_LOW,
    WRAP,
    beyond_law,
    geometry,
    load,
    tension,
)
from cdpr_sim.proof.interval_kernel import (
    TINY,
    add,
    down,
    multiply,
    narrowed,
    negative,
    over,
    root_down,
    row,
    scaled,
    square,
    subtract,
    up,
)

ALMOST_PARALLEL = 1e-6
"""Added to the squares of the cables' directions and moments: almost parallel cables are not isolated."""


@outlined
def balance(T, W, g):
    """Contract tensions T by Σ Tᵢ Wᵢ + g = 0. False if it cannot vanish. W (cables, 2)."""
    m = T.shape[0]
    pulls, total = np.empty((m, 2)), g
    for i in range(m):
        pulls[i, 0], pulls[i, 1] = multiply(row(T, i), row(W, i))
        total = add(total, row(pulls, i))
    if total[0] > 0 or total[1] < 0:
        return False
    for i in range(m):
        if W[i, 0] <= 0 <= W[i, 1]:
            continue
        others = g
        for j in range(m):
            if j != i:
                others = add(others, row(pulls, j))
        needed = over(negative(others), row(W, i)) if W[i, 0] > 0 else over(others, negative(row(W, i)))
        if not narrowed(T, i, needed):
            return False
    return True


@outlined
def virtual_work(T, o, g, rows, y, W):
    """Contract T by the balance along the motion y (6,), whose other entries than ``rows`` are zero."""
    if not normalised(y):
        return True
    total = 0.0, 0.0
    for i in range(T.shape[0]):
        W[i, 0] = W[i, 1] = 0.0
    for r in rows:
        if y[r] == 0:
            continue
        for i in range(T.shape[0]):
            W[i, 0], W[i, 1] = add(row(W, i), scaled(row(o[i], DIRECTION + r), y[r]))
        total = add(total, scaled(row(g, r), y[r]))
    return balance(T, W, total)


@outlined
def unbalanced(T, o, g, rows, y):
    """Unbalanced part of the best tensions within T at the middle, in floats: the motion y."""
    m = T.shape[0]
    tau, W, square_sums = np.empty(m), np.zeros((m, 6)), np.empty(m)
    for r in rows:
        y[r] = 0.5 * (g[r, 0] + g[r, 1])
    for i in range(m):
        tau[i], square_sums[i] = 0.5 * (T[i, 0] + T[i, 1]), TINY
        for r in rows:
            W[i, r] = 0.5 * (o[i, DIRECTION + r, 0] + o[i, DIRECTION + r, 1])
            y[r] += tau[i] * W[i, r]
            square_sums[i] += W[i, r] * W[i, r]
    for _ in range(8):
        for i in range(m):
            along = 0.0
            for r in rows:
                along += W[i, r] * y[r]
            best = min(max(tau[i] - along / square_sums[i], T[i, 0]), T[i, 1])
            for r in rows:
                y[r] += (best - tau[i]) * W[i, r]
            tau[i] = best


@outlined
def normalised(y):
    """Divide y (6,) by its largest entry. False if it is zero."""
    size = 0.0
    for r in range(6):
        size = max(size, abs(y[r]))
    if size > 0:
        for r in range(6):
            y[r] /= size
    return size > 0


@outlined
def contract(q, T, setup, o, spin):
    """Contract a box q (6, 2) and tensions T by lengths, balances and virtual works. False: no equilibrium in it.

    A cable that is strained beyond the range of its law at every pose of the box excludes the box as a whole. The range
    contracts neither q nor T: so a box with one equilibrium has no other one beyond the range either.
    """
    m, rows = T.shape[0], setup.rows
    if not geometry(q, setup, o, spin):
        return False
    for i in range(m):
        if beyond_law(setup.law[i], o[i, LENGTH, 0]):
            return False
        if not narrowed(T, i, tension(setup.law[i], row(o[i], LENGTH))):
            return False
    g, y, W, n = np.empty((6, 2)), np.zeros(6), np.empty((m, 2)), len(rows)
    load(setup, o, g)
    for r in rows:
        for i in range(m):
            W[i, 0], W[i, 1] = row(o[i], DIRECTION + r)
        if not balance(T, W, row(g, r)):
            return False
    w = np.empty((m, n))
    for i in range(m):
        for k in range(n):
            w[i, k] = 0.5 * (o[i, DIRECTION + rows[k], 0] + o[i, DIRECTION + rows[k], 1])
    isolated = np.zeros((m, m))
    if n > 3 and m <= n:
        for i in range(m):
            for j in range(m):
                for k in range(n):
                    isolated[i, j] += w[i, k] * w[j, k]
            isolated[i, i] += ALMOST_PARALLEL
        if not invert(isolated):
            isolated[:] = 0.0
    for i in range(m):
        for j in range(i if n == 3 else 1):
            for k in range(n):
                y[rows[k]] = 0.0
                s, t = (k + 1) % n, (k + 2) % n
                if n == 3:  # the motions along which two cables do no work
                    y[rows[k]] = w[i, s] * w[j, t] - w[i, t] * w[j, s]
                else:  # along which all cables but one do none
                    for p in range(m):
                        y[rows[k]] += isolated[i, p] * w[p, k]
            if not virtual_work(T, o, g, rows, y, W):
                return False
    if n > 3:
        unbalanced(T, o, g, rows, y)
        if not virtual_work(T, o, g, rows, y, W):
            return False
    for i in range(m):  # from tensions to lengths, from lengths to positions
        law = setup.law[i]
        high = up(law[REST] + up(law[WHOLE_HIGH] * up(up(T[i, 1] / law[EA_LOW]) / law[SLOPE_LOW])))
        low = 0.0
        if T[i, 0] > 0:
            low = down(law[REST] + down(law[WHOLE_LOW] * down(down(T[i, 0] / law[EA_HIGH]) / law[SLOPE_HIGH])))
        radius = setup.wheels[i, RADIUS, 0]
        if radius > 0:  # the straight distance d from the exit has d² = s² + 2 r² + 2 r a
            wrap = scaled(row(o[i], WRAP), radius)
            low, high = max(down(low - wrap[1]), 0.0), up(high - wrap[0])
            if high < 0:
                return False
            more = add(square((radius, radius)), scaled(row(o[i], BEYOND), radius))
            low, high = root_down(down(down(low * low) + 2 * more[0])), up(np.sqrt(up(up(high * high) + 2 * more[1])))
        for r in range(3):
            if q[r, 0] == q[r, 1]:
                continue
            from_exit = row(o[i], FROM_EXIT + r)
            across = add(square(row(o[i], FROM_EXIT + (r + 1) % 3)), square(row(o[i], FROM_EXIT + (r + 2) % 3)))
            reach = up(up(high * high) - across[0])
            if reach < 0:
                return False
            reach = up(np.sqrt(reach))
            a, b = max(from_exit[0], -reach), min(from_exit[1], reach)
            clear = down(down(low * low) - across[1])
            if low > 0 and clear > 0:
                clear = root_down(clear)
                if a > -clear:
                    a = max(a, clear)
                if b < clear:
                    b = min(b, -clear)
            if a > b:
                return False
            if a > from_exit[0] or b < from_exit[1]:
                exit_ = setup.exits[i, r]
                if not narrowed(q, r, subtract(add((a, b), (exit_, exit_)), row(o[i], ARM + r))):
                    return False
    return True


@outlined
def invert(M):
    """Replace M by its inverse in floats; False if there is none. Not a proof."""
    n = M.shape[0]
    order = np.empty(n, np.int64)
    for i in range(n):
        p = i
        for j in range(i + 1, n):
            if abs(M[j, i]) > abs(M[p, i]):
                p = j
        order[i] = p
        if not abs(M[p, i]) > TINY:
            return False
        if p != i:
            for k in range(n):
                M[p, k], M[i, k] = M[i, k], M[p, k]
        part, M[i, i] = 1 / M[i, i], 1.0
        for k in range(n):
            M[i, k] *= part
        for j in range(n):
            if j != i:
                part, M[j, i] = M[j, i], 0.0
                for k in range(n):
                    M[j, k] -= part * M[i, k]
    for i in range(n - 1, -1, -1):  # the exchanges of rows, as exchanges of columns
        p = order[i]
        if p != i:
            for k in range(n):
                M[k, p], M[k, i] = M[k, i], M[k, p]
    return True

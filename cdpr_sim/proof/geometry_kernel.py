"""Each cable's direction, moment, length and tension over a box of poses, as intervals, compiled.

A pose is (x, y, z, v) with the rotation of the quaternion (1, v), |v_k| <= 1, in one of several charts. Directions
point from the exit to the anchor, so that the balance is Σ τᵢ (nᵢ, uᵢ × nᵢ) + g = 0 with u the arm from the platform's
origin and g minus the load.

A cable over a wheel has l = r θ + s in the coordinates (a, h) of its anchor: h along the axis e from the exit, and
a = ρ − r >= 0 beyond the wheel's centre (``cables``). There s² = a² + h² − r², sin θ = (a s + h r)/(a² + h²), and cos θ
= (h s − a r)/(a² + h²). The slopes of l are (sin θ, cos θ), and those of θ are (cos θ, −sin θ)/s. So over a rectangle
with 0 < θ < π, which is where h >= 0 or a > r, the extremes of l and θ lie at its corners, except for the least l at
h = r, where θ = π/2. Where h < 0, θ lies between π/2 and 3 π/2, and the least l may lie at a = r, where θ = π. θ comes
from tan(θ/2), or from tan(π − θ) where h < 0, halved three times by tan(x/2) = tan x/(1 + √(1 + tan² x)), and a series.
At an equilibrium every cable is clear of its wheel, a >= 0.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from cdpr_sim.core.cable import MOST_STRAIN
from cdpr_sim.core.compiling import outlined
from cdpr_sim.proof.interval_kernel import (
    add,
    arctangent,
    cross,
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
    unit,
    up,
)

LENGTH, DIRECTION, MOMENT, ARM, FROM_EXIT, FREE, WRAP, BEYOND, ACROSS, BEND, COLUMNS = (
    0, 1, 4, 7, 10, 13, 14, 15, 16, 19, 20
)  # fmt: skip
"""Columns of a cable's geometry: its length, n, u × n, u, and anchor minus exit; the length s that is free, and of a
cable over a wheel θ, a, the unit vector across the wheel's plane, and sin θ/ρ − 1/s, by which it bends more there."""

REST, EA_LOW, EA_HIGH, A2, A3, SLOPE_LOW, SLOPE_HIGH, WHOLE_LOW, WHOLE_HIGH, LAW = 0, 1, 2, 3, 4, 5, 6, 7, 8, 9
"""Columns of a cable's law: rest length, bounds of EA of all parts of line, a2, a3, bounds of the slope
over EA/l0, and of the length that stretches, with what lies behind the exit."""

RADIUS, AXIS, ASIDE, WHEEL = 0, 1, 4, 13
"""Rows of a cable's wheel: its radius (0 without one), e, and 1 − e eᵀ."""

HALF_PI, LARGEST_WRAP = (1.5707963267948963, 1.570796326794897), 4.7124
"""π/2, and 3 π/2, which θ does not exceed."""


class Setup(NamedTuple):
    """A problem in the form of the kernel.

    Attributes:
        exits: (cables, 3) [m].
        anchors: in the chart's platform frame, (cables, 3) [m].
        law: (cables, LAW).
        wheels: intervals of each cable's wheel, (cables, WHEEL, 2).
        center_of_mass: in the chart's platform frame, (3,) [m].
        weight: an interval [N], (2,).
        wrench: external force and torque [N, N m], (6,).
        rows: indices of the free coordinates among (x, y, z, v), which are those of the balances.
        scales: scales for comparing the widths of the coordinates [m], (6,).
        newton: width [m] below which Krawczyk's test is tried.
        near: width [m] below which a nearby equilibrium is searched for.
        least: width [m] below which a box is left undecided.
    """

    exits: Float[np.ndarray, "cables 3"]
    anchors: Float[np.ndarray, "cables 3"]
    law: Float[np.ndarray, "cables law"]
    wheels: Float[np.ndarray, "cables wheel 2"]
    center_of_mass: Float[np.ndarray, "3"]
    weight: Float[np.ndarray, "2"]
    wrench: Float[np.ndarray, "6"]
    rows: np.ndarray
    scales: Float[np.ndarray, "6"]
    newton: float
    near: float
    least: float


@outlined
def turn(q, R, spin):
    """The rotation over a box, (9, 2) row by row; and the angular velocities of v_k, (9, 2), by coordinates k first."""
    s = np.empty((3, 2))
    f = np.empty((3, 2))  # 2 v_k / (1 + |v|²)
    for k in range(3):
        s[k, 0], s[k, 1] = square(row(q, 3 + k))
    total = 1.0, 1.0
    for k in range(3):
        total = add(total, row(s, k))
    twice = over((2.0, 2.0), total)
    for k in range(3):
        others = add(row(s, (k + 1) % 3), row(s, (k + 2) % 3))
        rest = add((1.0, 1.0), others)
        a, b = row(q, 3 + k)
        if a < -1 or b > 1:  # it increases with v_k only between them
            f[k, 0], f[k, 1] = -1.0, 1.0
        else:
            d = up(rest[1] + up(a * a)) if a >= 0 else down(rest[0] + down(a * a))
            f[k, 0] = max(down(2 * a / d), -1.0)
            d = down(rest[0] + down(b * b)) if b >= 0 else up(rest[1] + up(b * b))
            f[k, 1] = min(up(2 * b / d), 1.0)
        most = up(2 * others[1] / down(down(1 + s[k, 0]) + others[1]))
        few = max(down(2 * others[0] / up(up(1 + s[k, 1]) + max(others[0], 0.0))), 0.0)
        R[4 * k, 0], R[4 * k, 1] = down(1 - most), up(1 - few)
        spin[4 * k, 0], spin[4 * k, 1] = twice
    for k in range(3):
        i, j = (k + 1) % 3, (k + 2) % 3
        a, b = multiply(row(f, i), row(q, 3 + j))
        c, d = multiply(row(f, j), row(q, 3 + i))
        part, along = (max(a, c), min(b, d)), row(f, k)
        R[3 * i + j, 0], R[3 * i + j, 1] = subtract(part, along)
        R[3 * j + i, 0], R[3 * j + i, 1] = add(part, along)
        spin[3 * i + j, 0], spin[3 * i + j, 1] = along
        spin[3 * j + i, 0], spin[3 * j + i, 1] = negative(along)


@outlined
def corner(a, h, radius):
    """Intervals s, sin θ, cos θ, θ, l at a point of a wheel's plane; s > 0, a >= 0, and h < 0 or θ < π."""
    squared = square((radius, radius))
    far = add(square((a, a)), square((h, h)))
    s = root_down(down(far[0] - squared[1])), up(np.sqrt(max(up(far[1] - squared[0]), 0.0)))
    low, high = over(add(scaled(s, a), (down(h * radius), up(h * radius))), far)
    sine = max(low, -1.0 if h < 0 else 0.0), min(high, 1.0)
    low, high = over(subtract(scaled(s, h), (down(a * radius), up(a * radius))), far)
    cosine = max(low, -1.0), min(high, 1.0)
    if h >= 0:
        t0 = max(down(sine[0] / up(1 + cosine[1])), 0.0)
        t1 = up(sine[1] / down(1 + cosine[0])) if down(1 + cosine[0]) > 0 else np.inf
    elif cosine[1] < 0:
        t0, t1 = over(sine, negative(cosine))
    else:
        t0, t1 = -np.inf, np.inf
    low, high = -HALF_PI[1], HALF_PI[1]
    for end in range(2):
        t = t1 if end else t0
        if abs(t) < 1e9:
            a, b = arctangent((abs(t), abs(t)))
            if end:
                high = b if t >= 0 else -a
            else:
                low = a if t >= 0 else -b
    if h >= 0:
        theta = 2 * max(low, 0.0), 2 * high
    elif cosine[1] < 0:  # π − atan(sin θ/−cos θ)
        theta = down(2 * HALF_PI[0] - high), up(2 * HALF_PI[1] - low)
    else:
        theta = HALF_PI[0], LARGEST_WRAP
    return s, sine, cosine, theta, add(scaled(theta, radius), s)


@outlined
def over_wheel(o, wheel):
    """Fill in a cable's geometry over its wheel from ``FROM_EXIT`` on. False: it is nowhere clear of the wheel."""
    radius, n = wheel[RADIUS, 0], np.empty((3, 2))
    height, squares, aside, straight = (0.0, 0.0), np.empty((3, 2)), np.empty((3, 2)), 0.0
    for r in range(3):
        height = add(height, multiply(row(o, FROM_EXIT + r), row(wheel, AXIS + r)))
        along = 0.0, 0.0
        for c in range(3):
            along = add(along, multiply(row(o, FROM_EXIT + c), row(wheel, ASIDE + 3 * r + c)))
        aside[r, 0], aside[r, 1] = along
        squares[r, 0], squares[r, 1] = square(along)
        straight = max(down(straight + square(row(o, FROM_EXIT + r))[0]), 0.0)
    h0, h1 = height
    rho = sum_of_squares(squares)
    rho = root_down(rho[0]), up(np.sqrt(rho[1]))
    a0, a1 = max(down(rho[0] - radius), 0.0), up(rho[1] - radius)
    if a1 < 0:
        return False
    most = max(abs(h0), abs(h1))
    far = up(up(a1 * a1) + up(most * most))
    free = up(far - down(radius * radius))
    if free < 0:
        return False
    o[BEYOND, 0], o[BEYOND, 1] = a0, a1
    near = down(down(a0 * a0) + square(height)[0])
    regular = near > up(radius * radius) and (h0 >= 0 or h1 < 0 or a0 > radius)
    s0, s1 = root_down(down(near - up(radius * radius))), up(np.sqrt(free))
    sine, cosine, wrap = (-1.0, 1.0), (-1.0, 1.0), (0.0, LARGEST_WRAP)
    if regular:
        c00, c01 = corner(a0, h0, radius), corner(a0, h1, radius)
        c10, c11 = corner(a1, h0, radius), corner(a1, h1, radius)
        if h1 < 0:  # θ is largest at the steep corner, and least at the flat one
            steep, flat = (c01 if a0 < radius else c00), (c10 if a1 <= radius else c11)
            sine = steep[1][0], flat[1][1]
            cosine = min(steep[2][0], flat[2][0]), max(steep[2][1], flat[2][1])
            l0, l1 = (c11[4][0] if a1 < radius else c01[4][0]), max(c00[4][1], c10[4][1])
            if a0 <= radius <= a1:
                cosine, l0 = (-1.0, cosine[1]), down(down(2 * HALF_PI[0] * radius) - h1)
        else:
            steep, flat = (c10 if h0 >= radius else c00), (c01 if h1 >= radius else c11)
            cosine = steep[2][0], flat[2][1]
            sine = min(steep[1][0], flat[1][0]), max(steep[1][1], flat[1][1])
            if h0 < radius < h1:
                sine, l0 = (sine[0], 1.0), down(a0 + down(HALF_PI[0] * radius))
            else:
                l0 = c00[4][0] if h0 >= radius else c01[4][0]
            l1 = max(c10[4][1], c11[4][1])
        wrap = flat[3][0], steep[3][1]
    else:
        s0, l0, l1 = 0.0, root_down(straight), up(s1 + up(LARGEST_WRAP * radius))
    o[WRAP, 0], o[WRAP, 1] = wrap
    o[LENGTH, 0], o[LENGTH, 1], o[FREE, 0], o[FREE, 1] = l0, l1, s0, s1
    for r in range(3):
        n[r, 0], n[r, 1] = unit(row(aside, r), of_others(squares, r))
    for r in range(3):
        low, high = add(multiply(row(n, r), sine), multiply(row(wheel, AXIS + r), cosine))
        o[DIRECTION + r, 0], o[DIRECTION + r, 1] = max(low, -1.0), min(high, 1.0)
        o[ACROSS + r, 0], o[ACROSS + r, 1] = cross(wheel, AXIS, n, 0, r)
    o[BEND, 0], o[BEND, 1] = -np.inf, np.inf
    if s0 > 0 and rho[0] > 0:
        o[BEND, 0], o[BEND, 1] = subtract(over(sine, rho), (down(1 / s1), up(1 / s0)))
    return True


@outlined
def sum_of_squares(squares):
    """The sum of the intervals in the rows of ``squares`` (3, 2)."""
    return add(add(row(squares, 0), row(squares, 1)), row(squares, 2))


@outlined
def of_others(squares, r):
    """The sum of the intervals in the rows but r of ``squares`` (3, 2), which is not negative."""
    low, high = add(row(squares, (r + 1) % 3), row(squares, (r + 2) % 3))
    return max(low, 0.0), high


@outlined
def geometry(q, setup, o, spin):
    """Fill o (cables + 1, COLUMNS, 2): each cable's geometry over a box; in the last row, the arm of the weight.

    False if a cable is nowhere in the box clear of its wheel.
    """
    m, planar = setup.exits.shape[0], len(setup.rows) == 3  # then R has zeros beside its middle
    R, Rm, middle = np.empty((9, 2)), np.empty((9, 2)), np.empty((6, 2))
    turn(q, R, spin)
    turns = False
    for k in range(6):
        middle[k, 0] = middle[k, 1] = 0.5 * (q[k, 0] + q[k, 1])
        turns = turns or (k > 2 and q[k, 0] < q[k, 1])
    if turns:
        turn(middle, Rm, np.empty((9, 2)))
    centred, squares = np.empty((3, 2)), np.empty((3, 2))
    for i in range(m + 1):
        b = setup.anchors[i] if i < m else setup.center_of_mass
        c = o[i]
        for r in range(3):
            arm, about_middle = (0.0, 0.0), (0.0, 0.0)
            for k in range(3):
                if b[k] == 0 or (planar and (r + k) % 2 == 1):
                    continue
                arm = add(arm, scaled(row(R, 3 * r + k), b[k]))
                if turns:
                    about_middle = add(about_middle, scaled(row(Rm, 3 * r + k), b[k]))
            c[ARM + r, 0], c[ARM + r, 1] = arm
            centred[r, 0], centred[r, 1] = about_middle
        if turns:
            for k in range(3):
                if q[3 + k, 0] == q[3 + k, 1]:
                    continue
                width = subtract(row(q, 3 + k), row(middle, 3 + k))
                for r in range(3):
                    if planar and r == 1:
                        continue
                    moved = multiply(cross(spin, 3 * k, c, ARM, r), width)
                    centred[r, 0], centred[r, 1] = add(row(centred, r), moved)
            for r in range(3):
                narrowed(c, ARM + r, row(centred, r))
        if i == m:
            return True
        for r in range(3):
            exit_ = setup.exits[i, r]
            from_exit = subtract(add(row(q, r), row(c, ARM + r)), (exit_, exit_))
            c[FROM_EXIT + r, 0], c[FROM_EXIT + r, 1] = from_exit
            squares[r, 0], squares[r, 1] = square(from_exit)
        if setup.wheels[i, RADIUS, 0] > 0:
            if not over_wheel(c, setup.wheels[i]):
                return False
        else:
            low, high = sum_of_squares(squares)
            c[LENGTH, 0], c[LENGTH, 1] = root_down(low), up(np.sqrt(high))
            c[FREE, 0], c[FREE, 1] = row(c, LENGTH)
            for r in range(3):
                c[DIRECTION + r, 0], c[DIRECTION + r, 1] = unit(row(c, FROM_EXIT + r), of_others(squares, r))
        for r in range(3):
            if not planar or r == 1:
                c[MOMENT + r, 0], c[MOMENT + r, 1] = cross(c, ARM, c, DIRECTION, r)
    return True


@outlined
def slope(law, strains):
    """The law's slope over EA/l0: 1 + 2 a2 ε + 3 a3 ε², constant beyond MOST_STRAIN."""
    if law[A2] == 0.0 and law[A3] == 0.0:
        return 1.0, 1.0
    e = min(max(strains[0], 0.0), MOST_STRAIN), min(max(strains[1], 0.0), MOST_STRAIN)
    low, high = add(multiply(e, (down(3 * law[A3]), up(3 * law[A3]))), (2 * law[A2], 2 * law[A2]))
    low, high = add(multiply(e, (low, high)), (1.0, 1.0))
    return max(low, law[SLOPE_LOW]), min(high, law[SLOPE_HIGH])


@outlined
def strained(law, strains):
    """τ/EA at strains in an interval, which should be narrow."""
    low, high = max(strains[0], 0.0), max(strains[1], 0.0)
    if law[A2] == 0.0 and law[A3] == 0.0:
        return low, high
    e = min(low, MOST_STRAIN), min(high, MOST_STRAIN)
    curved = add(scaled(e, law[A3]), (law[A2], law[A2]))
    curved = multiply(e, add(multiply(e, curved), (1.0, 1.0)))
    beyond = max(down(low - e[1]), 0.0), max(up(high - e[0]), 0.0)
    if high <= MOST_STRAIN:
        beyond = 0.0, 0.0
    return add(curved, multiply(slope(law, e), beyond))


@outlined
def strain(law, length):
    """The stretch l − l0 over the length that stretches."""
    return over((down(length - law[REST]), up(length - law[REST])), (law[WHOLE_LOW], law[WHOLE_HIGH]))


@outlined
def beyond_law(law, length):
    """Whether a cable of this length is strained beyond ``MOST_STRAIN``, and its law is nonlinear, by proof."""
    return (law[A2] != 0.0 or law[A3] != 0.0) and strain(law, length)[0] > MOST_STRAIN


@outlined
def strains_over(law, lengths):
    """The same over an interval of lengths."""
    return strain(law, lengths[0])[0], strain(law, lengths[1])[1]


@outlined
def compliance(law):
    """The length that stretches over EA."""
    return down(law[WHOLE_LOW] / law[EA_HIGH]), up(law[WHOLE_HIGH] / law[EA_LOW])


@outlined
def tension(law, lengths):
    """τ over an interval of lengths; it is increasing."""
    low, high = strained(law, strain(law, lengths[0]))[0], strained(law, strain(law, lengths[1]))[1]
    return max(down(law[EA_LOW] * low), 0.0), max(up(law[EA_HIGH] * high), 0.0)


@outlined
def load(setup, o, g):
    """Fill g (6, 2): minus the wrench of weight and external wrench about the platform's origin."""
    weight, m = (setup.weight[0], setup.weight[1]), setup.exits.shape[0]
    for r in range(6):
        g[r, 0] = g[r, 1] = -setup.wrench[r]
    g[2, 0], g[2, 1] = add(row(g, 2), weight)
    g[3, 0], g[3, 1] = add(row(g, 3), multiply(weight, row(o[m], ARM + 1)))
    g[4, 0], g[4, 1] = subtract(row(g, 4), multiply(weight, row(o[m], ARM)))

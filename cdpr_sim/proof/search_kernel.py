"""Branch and prune over poses and tensions, compiled: finds every equilibrium and proves that none is missing.

Unknowns are the pose (x, y, z, v) with the rotation of the quaternion (1, v), |v_k| <= 1, in one of several charts, and
the cables' tensions. With tensions as unknowns of their own a stiffness EA enters only as 1/EA, and boxes need not be
as small as the load over the stiffness. Of a planar robot only x, z and v_y vary.

Each result is rounded outwards by more than half a unit in the last place, and only + − × ÷ and the square root are
used, which IEEE 754 rounds correctly: no rounding mode is set, and no library's sine is used. If a compiler
contracts a product and a sum into one operation, that operation is rounded once, and the bounds still hold.

A cable over a wheel has l = r θ + s in the coordinates (a, h) of its anchor: h along the axis e from the exit, and
a = ρ − r >= 0 beyond the wheel's centre (``cables``). There s² = a² + h² − r², sin θ = (a s + h r)/(a² + h²), and cos θ
= (h s − a r)/(a² + h²). The slopes of l are (sin θ, cos θ), and those of θ are (cos θ, −sin θ)/s. So over a rectangle
with 0 < θ < π, which is where h >= 0 or a > r, the extremes of l and θ lie at its corners, except for the least l at
h = r, where θ = π/2. Where h < 0, θ lies between π/2 and 3 π/2, and the least l may lie at a = r, where θ = π. θ comes
from tan(θ/2), or from tan(π − θ) where h < 0, halved three times by tan(x/2) = tan x/(1 + √(1 + tan² x)), and a series:
no library's arc tangent is used. At an equilibrium every cable is clear of its wheel, a >= 0.

Intervals are pairs (lower, upper). Directions point from the exit to the anchor, so that the balance is
Σ τᵢ (nᵢ, uᵢ × nᵢ) + g = 0 with u the arm from the platform's origin and g minus the load.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from cdpr_sim.core import compiling
from cdpr_sim.core.cable import MOST_STRAIN
from cdpr_sim.core.compiling import outlined

SHARE, TINY = 2.3e-16, 1e-300
"""Half a unit in the last place is at most 1.2e-16 of a number; a whole one, 2.3e-16; and an absolute bound below any
length."""

LENGTH, DIRECTION, MOMENT, ARM, APART, FREE, WRAP, BEYOND, ACROSS, BEND, COLUMNS = (
    0,
    1,
    4,
    7,
    10,
    13,
    14,
    15,
    16,
    19,
    20,
)
"""Columns of a cable's geometry: its length, n, u × n, u, and anchor minus exit; the length s that is free, and of a
cable over a wheel θ, a, the unit vector across the wheel's plane, and sin θ/ρ − 1/s, by which it bends more there."""

REST, EA_LOW, EA_HIGH, A2, A3, SLOPE_LOW, SLOPE_HIGH, WHOLE_LOW, WHOLE_HIGH, LAW = 0, 1, 2, 3, 4, 5, 6, 7, 8, 9
"""Columns of a cable's law: rest length, bounds of EA of all parts of line, a2, a3, bounds of the slope
over EA/l0, and of the length that stretches, with what lies behind the exit."""

RADIUS, AXIS, ASIDE, WHEEL = 0, 1, 4, 13
"""Rows of a cable's wheel: its radius (0 without one), e, and 1 − e eᵀ."""

HALF_PI, LARGEST_WRAP = (1.5707963267948963, 1.570796326794897), 4.7124
"""π/2, and 3 π/2, which θ does not exceed."""

ARCTANGENT_TERMS = 14
"""Terms of the series of the arc tangent of x <= tan(π/16): all that is left out is below x²⁸, 3e-20."""

SPLIT = 0.4837
"""Fraction at which a box is divided: equilibria often have symmetric coordinates, at which a box should not end."""

AGAIN = 0.8
"""A box is contracted again while some width falls below this fraction of it."""

ROUNDS = 10
"""Largest number of contractions."""

OPENED = 0.05
"""Fraction by which a range of tensions is widened for Krawczyk's test, so that the image of slack can lie inside."""

EMPTY, CONTRACTED, UNIQUE = 0, 1, 2
"""Results of Krawczyk's test for a box: no equilibrium, perhaps some, exactly one."""

BOXES, BY_BALANCE, BY_KRAWCZYK, PROVED, LEFT, COUNTS = 0, 1, 2, 3, 4, 5
"""Counts of a search: boxes examined; excluded by balances; by Krawczyk's test; proved; undecided."""

TIGHTER = 60
"""Largest number of contractions of a box with one equilibrium."""


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
def up(x):
    """No less than any number that rounds to x."""
    return x + (abs(x) * SHARE + TINY)


@outlined
def down(x):
    """No more than any number that rounds to x."""
    return x - (abs(x) * SHARE + TINY)


@outlined
def add(a, b, c, d):
    """[a, b] + [c, d]."""
    return down(a + c), up(b + d)


@outlined
def subtract(a, b, c, d):
    """[a, b] − [c, d]."""
    return down(a - d), up(b - c)


@outlined
def multiply(a, b, c, d):
    """[a, b] × [c, d]."""
    p, q, r, s = a * c, a * d, b * c, b * d
    return down(min(min(p, q), min(r, s))), up(max(max(p, q), max(r, s)))


@outlined
def scaled(a, b, c):
    """[a, b] × c."""
    p, q = a * c, b * c
    return down(min(p, q)), up(max(p, q))


@outlined
def over(a, b, c, d):
    """[a, b] ÷ [c, d], c > 0."""
    return down(a / d if a >= 0 else a / c), up(b / c if b >= 0 else b / d)


@outlined
def least(a, b):
    """The least |x| in [a, b]."""
    return a if a > 0 else (-b if b < 0 else 0.0)


@outlined
def square(a, b):
    """[a, b]²."""
    low, high = least(a, b), max(abs(a), abs(b))
    return max(down(low * low), 0.0), up(high * high)


@outlined
def root_down(x):
    """√x from below."""
    return max(down(np.sqrt(max(x, 0.0))), 0.0)


@outlined
def unit_down(x, low, high):
    """The least x/√(x² + s) with s in [low, high]."""
    if x >= 0:
        h = up(np.sqrt(up(up(x * x) + high)))
        return down(x / h) if h > 0 else -1.0
    h = root_down(down(down(x * x) + low))
    return max(down(x / h), -1.0) if h > 0 else -1.0


@outlined
def turn(q, R, spin):
    """The rotation over a box, (3, 3, 2); and the angular velocities of v_k, (3, 3, 2), by coordinates k first."""
    s = np.empty((3, 2))
    f = np.empty((3, 2))  # 2 v_k / (1 + |v|²)
    for k in range(3):
        s[k, 0], s[k, 1] = square(q[3 + k, 0], q[3 + k, 1])
    low, high = 1.0, 1.0
    for k in range(3):
        low, high = down(low + s[k, 0]), up(high + s[k, 1])
    double_low, double_high = down(2 / high), up(2 / low)
    for k in range(3):
        i, j = (k + 1) % 3, (k + 2) % 3
        rest_low, rest_high = down(1 + down(s[i, 0] + s[j, 0])), up(1 + up(s[i, 1] + s[j, 1]))
        a, b = q[3 + k, 0], q[3 + k, 1]
        if a < -1 or b > 1:  # it increases with v_k only between them
            f[k, 0], f[k, 1] = -1.0, 1.0
        else:
            d = up(rest_high + up(a * a)) if a >= 0 else down(rest_low + down(a * a))
            f[k, 0] = max(down(2 * a / d), -1.0)
            d = down(rest_low + down(b * b)) if b >= 0 else up(rest_high + up(b * b))
            f[k, 1] = min(up(2 * b / d), 1.0)
        others_low, others_high = down(s[i, 0] + s[j, 0]), up(s[i, 1] + s[j, 1])
        most = up(2 * others_high / down(down(1 + s[k, 0]) + others_high))
        few = max(down(2 * others_low / up(up(1 + s[k, 1]) + max(others_low, 0.0))), 0.0)
        R[k, k, 0], R[k, k, 1] = down(1 - most), up(1 - few)
        spin[k, k, 0], spin[k, k, 1] = double_low, double_high
    for k in range(3):
        i, j = (k + 1) % 3, (k + 2) % 3
        a, b = multiply(f[i, 0], f[i, 1], q[3 + j, 0], q[3 + j, 1])
        c, d = multiply(f[j, 0], f[j, 1], q[3 + i, 0], q[3 + i, 1])
        a, b = max(a, c), min(b, d)
        R[i, j, 0], R[i, j, 1] = subtract(a, b, f[k, 0], f[k, 1])
        R[j, i, 0], R[j, i, 1] = add(a, b, f[k, 0], f[k, 1])
        spin[i, j, 0], spin[i, j, 1] = f[k, 0], f[k, 1]
        spin[j, i, 0], spin[j, i, 1] = -f[k, 1], -f[k, 0]


@outlined
def cross(a, b, r):
    """Component r of a × b, intervals (3, 2)."""
    i, j = (r + 1) % 3, (r + 2) % 3
    p0, p1 = multiply(a[i, 0], a[i, 1], b[j, 0], b[j, 1])
    q0, q1 = multiply(a[j, 0], a[j, 1], b[i, 0], b[i, 1])
    return subtract(p0, p1, q0, q1)


@outlined
def arctangent(low, high):
    """atan over [low, high], low >= 0, below 1e100."""
    for _ in range(3):  # x/(1 + √(1 + x²)) increases
        bottom, top = up(1 + up(np.sqrt(up(1 + up(low * low))))), down(1 + root_down(down(1 + down(high * high))))
        low, high = max(down(low / bottom), 0.0), min(up(high / top), 1.0)
    return max(down(8 * series(low)[0]), 0.0), up(8 * series(high)[1])


@outlined
def series(x):
    """Bounds of atan x for 0 <= x <= tan(π/16)."""
    low, high = square(x, x)
    s0, s1 = 0.0, 0.0
    for k in range(ARCTANGENT_TERMS, 0, -1):  # s_k = 1/(2k + 1) − x² s_(k+1), with 0 < s < 1
        a, b = multiply(low, high, s0, s1)
        if k == ARCTANGENT_TERMS:
            a, b = 0.0, high
        s0, s1 = subtract(down(1 / (2 * k + 1)), up(1 / (2 * k + 1)), a, b)
    a, b = multiply(low, high, s0, s1)
    a, b = subtract(1.0, 1.0, a, b)
    return scaled(a, b, x)


@outlined
def corner(a, h, radius):
    """(s, sin θ, cos θ, θ, l) as intervals at a point of a wheel's plane; s > 0, a >= 0, and h < 0 or θ < π."""
    aa0, aa1 = square(a, a)
    hh0, hh1 = square(h, h)
    rr0, rr1 = square(radius, radius)
    far0, far1 = add(aa0, aa1, hh0, hh1)
    s0, s1 = root_down(down(far0 - rr1)), up(np.sqrt(max(up(far1 - rr0), 0.0)))
    p0, p1 = scaled(s0, s1, a)
    q0, q1 = down(h * radius), up(h * radius)
    sin0, sin1 = add(p0, p1, q0, q1)
    sin0, sin1 = over(sin0, sin1, far0, far1)
    sin0, sin1 = max(sin0, -1.0 if h < 0 else 0.0), min(sin1, 1.0)
    p0, p1 = scaled(s0, s1, h)
    q0, q1 = down(a * radius), up(a * radius)
    cos0, cos1 = subtract(p0, p1, q0, q1)
    cos0, cos1 = over(cos0, cos1, far0, far1)
    cos0, cos1 = max(cos0, -1.0), min(cos1, 1.0)
    if h >= 0:
        half0 = max(down(sin0 / up(1 + cos1)), 0.0)
        half1 = up(sin1 / down(1 + cos0)) if down(1 + cos0) > 0 else np.inf
        t0, t1 = arctangent(min(half0, 1e9), min(half1, 1e9))
        t0, t1 = 2 * t0, 2 * (t1 if half1 < 1e9 else HALF_PI[1])
    elif cos1 < 0:  # π − atan(sin θ/−cos θ)
        t0, t1 = over(sin0, sin1, -cos1, -cos0)
        low, high = -HALF_PI[1], HALF_PI[1]
        if t0 > -1e9 and t1 < 1e9:
            low = arctangent(t0, t0)[0] if t0 >= 0 else -arctangent(-t0, -t0)[1]
            high = arctangent(t1, t1)[1] if t1 >= 0 else -arctangent(-t1, -t1)[0]
        t0, t1 = down(2 * HALF_PI[0] - high), up(2 * HALF_PI[1] - low)
    else:
        t0, t1 = HALF_PI[0], LARGEST_WRAP
    l0, l1 = scaled(t0, t1, radius)
    l0, l1 = add(l0, l1, s0, s1)
    return s0, s1, sin0, sin1, cos0, cos1, t0, t1, l0, l1


@outlined
def over_wheel(o, wheel):
    """Fill in a cable's geometry over its wheel from ``APART``. False: nowhere in the box it is clear of its wheel."""
    radius, d, n = wheel[RADIUS, 0], o[APART : APART + 3], np.empty((3, 2))
    h0, h1, squares, aside = 0.0, 0.0, np.empty((3, 2)), np.empty((3, 2))
    straight = 0.0
    for r in range(3):
        a, b = multiply(d[r, 0], d[r, 1], wheel[AXIS + r, 0], wheel[AXIS + r, 1])
        h0, h1 = add(h0, h1, a, b)
        aside[r, 0] = aside[r, 1] = 0.0
        for c in range(3):
            e = ASIDE + 3 * r + c
            a, b = multiply(d[c, 0], d[c, 1], wheel[e, 0], wheel[e, 1])
            aside[r, 0], aside[r, 1] = add(aside[r, 0], aside[r, 1], a, b)
        squares[r, 0], squares[r, 1] = square(aside[r, 0], aside[r, 1])
        straight = max(down(straight + square(d[r, 0], d[r, 1])[0]), 0.0)
    rho0 = root_down(down(down(squares[0, 0] + squares[1, 0]) + squares[2, 0]))
    rho1 = up(np.sqrt(up(up(squares[0, 1] + squares[1, 1]) + squares[2, 1])))
    a0, a1 = max(down(rho0 - radius), 0.0), up(rho1 - radius)
    if a1 < 0:
        return False
    most = max(abs(h0), abs(h1))
    far = up(up(a1 * a1) + up(most * most))
    free = up(far - down(radius * radius))
    if free < 0:
        return False
    o[BEYOND, 0], o[BEYOND, 1] = a0, a1
    near = down(down(a0 * a0) + square(h0, h1)[0])
    regular = near > up(radius * radius) and (h0 >= 0 or h1 < 0 or a0 > radius)
    s0, s1 = root_down(down(near - up(radius * radius))), up(np.sqrt(free))
    if regular:
        c00, c01 = corner(a0, h0, radius), corner(a0, h1, radius)
        c10, c11 = corner(a1, h0, radius), corner(a1, h1, radius)
    else:
        c00 = c01 = c10 = c11 = corner(radius, radius, radius)  # not used
    if regular and h1 < 0:
        steep, flat = (c01 if a0 < radius else c00), (c10 if a1 <= radius else c11)  # θ is largest, and least
        sin0, sin1 = steep[2], flat[3]
        cos0, cos1 = min(steep[4], flat[4]), max(steep[5], flat[5])
        l0, l1 = (c11[8] if a1 < radius else c01[8]), max(c00[9], c10[9])
        if a0 <= radius <= a1:
            cos0, l0 = -1.0, down(down(2 * HALF_PI[0] * radius) - h1)
        o[WRAP, 0], o[WRAP, 1] = flat[6], steep[7]
    elif regular:
        steep, flat = (c10 if h0 >= radius else c00), (c01 if h1 >= radius else c11)  # θ is largest, and least
        cos0, cos1 = steep[4], flat[5]
        sin0, sin1 = min(steep[2], flat[2]), max(steep[3], flat[3])
        if h0 < radius < h1:
            sin1 = 1.0
            l0 = down(a0 + down(HALF_PI[0] * radius))
        else:
            l0 = c00[8] if h0 >= radius else c01[8]
        l1 = max(c10[9], c11[9])
        o[WRAP, 0], o[WRAP, 1] = flat[6], steep[7]
    else:
        s0, sin0, sin1, cos0, cos1 = 0.0, -1.0, 1.0, -1.0, 1.0
        l0, l1 = root_down(straight), up(s1 + up(LARGEST_WRAP * radius))
        o[WRAP, 0], o[WRAP, 1] = 0.0, LARGEST_WRAP
    o[LENGTH, 0], o[LENGTH, 1], o[FREE, 0], o[FREE, 1] = l0, l1, s0, s1
    for r in range(3):
        s, t = (r + 1) % 3, (r + 2) % 3
        low, high = max(down(squares[s, 0] + squares[t, 0]), 0.0), up(squares[s, 1] + squares[t, 1])
        n[r, 0], n[r, 1] = unit_down(aside[r, 0], low, high), -unit_down(-aside[r, 1], low, high)
    for r in range(3):
        a, b = multiply(n[r, 0], n[r, 1], sin0, sin1)
        c, e = multiply(wheel[AXIS + r, 0], wheel[AXIS + r, 1], cos0, cos1)
        a, b = add(a, b, c, e)
        o[DIRECTION + r, 0], o[DIRECTION + r, 1] = max(a, -1.0), min(b, 1.0)
        o[ACROSS + r, 0], o[ACROSS + r, 1] = cross(wheel[AXIS : AXIS + 3], n, r)
    o[BEND, 0], o[BEND, 1] = -np.inf, np.inf
    if s0 > 0 and rho0 > 0:
        a, b = over(sin0, sin1, rho0, rho1)
        o[BEND, 0], o[BEND, 1] = subtract(a, b, down(1 / s1), up(1 / s0))
    return True


@outlined
def geometry(q, setup, o, spin):
    """Fill o (cables + 1, COLUMNS, 2): each cable's geometry over a box; in the last row, the arm of the weight.

    False if a cable is nowhere in the box clear of its wheel.
    """
    m, planar = setup.exits.shape[0], len(setup.rows) == 3  # then R has zeros beside its middle
    R, Rm, middle = np.empty((3, 3, 2)), np.empty((3, 3, 2)), np.empty((6, 2))
    turn(q, R, spin)
    for k in range(6):
        middle[k, 0] = middle[k, 1] = 0.5 * (q[k, 0] + q[k, 1])
    unused = np.empty((3, 3, 2))
    turn(middle, Rm, unused)
    apart = np.empty((3, 2))
    squares = np.empty((3, 2))
    for i in range(m + 1):
        b = setup.anchors[i] if i < m else setup.center_of_mass
        u = o[i, ARM : ARM + 3]
        centred = np.zeros((3, 2))
        for r in range(3):
            u[r, 0] = u[r, 1] = 0.0
            for c in range(3):
                if planar and (r + c) % 2 == 1:
                    continue
                p0, p1 = scaled(R[r, c, 0], R[r, c, 1], b[c])
                u[r, 0], u[r, 1] = add(u[r, 0], u[r, 1], p0, p1)
                p0, p1 = scaled(Rm[r, c, 0], Rm[r, c, 1], b[c])
                centred[r, 0], centred[r, 1] = add(centred[r, 0], centred[r, 1], p0, p1)
        for k in range(3):
            if q[3 + k, 0] == q[3 + k, 1]:
                continue
            w0, w1 = subtract(q[3 + k, 0], q[3 + k, 1], middle[3 + k, 0], middle[3 + k, 0])
            for r in range(3):
                if planar and r == 1:
                    continue
                p0, p1 = cross(spin[k], u, r)
                p0, p1 = multiply(p0, p1, w0, w1)
                centred[r, 0], centred[r, 1] = add(centred[r, 0], centred[r, 1], p0, p1)
        for r in range(3):
            u[r, 0], u[r, 1] = max(u[r, 0], centred[r, 0]), min(u[r, 1], centred[r, 1])
        if i == m:
            return True
        for r in range(3):
            a, b_ = add(q[r, 0], q[r, 1], u[r, 0], u[r, 1])
            apart[r, 0], apart[r, 1] = subtract(a, b_, setup.exits[i, r], setup.exits[i, r])
            o[i, APART + r, 0], o[i, APART + r, 1] = apart[r, 0], apart[r, 1]
            squares[r, 0], squares[r, 1] = square(apart[r, 0], apart[r, 1])
        n = o[i, DIRECTION : DIRECTION + 3]
        if setup.wheels[i, RADIUS, 0] > 0:
            if not over_wheel(o[i], setup.wheels[i]):
                return False
        else:
            low = down(down(squares[0, 0] + squares[1, 0]) + squares[2, 0])
            high = up(up(squares[0, 1] + squares[1, 1]) + squares[2, 1])
            o[i, LENGTH, 0], o[i, LENGTH, 1] = root_down(low), up(np.sqrt(high))
            o[i, FREE, 0], o[i, FREE, 1] = o[i, LENGTH, 0], o[i, LENGTH, 1]
            for r in range(3):
                s, t = (r + 1) % 3, (r + 2) % 3
                low, high = max(down(squares[s, 0] + squares[t, 0]), 0.0), up(squares[s, 1] + squares[t, 1])
                n[r, 0], n[r, 1] = unit_down(apart[r, 0], low, high), -unit_down(-apart[r, 1], low, high)
        for r in range(3):
            if not planar or r == 1:
                o[i, MOMENT + r, 0], o[i, MOMENT + r, 1] = cross(u, n, r)
    return True


@outlined
def slope(law, strain_low, strain_high):
    """The law's slope over EA/l0: 1 + 2 a2 ε + 3 a3 ε², constant beyond MOST_STRAIN."""
    if law[A2] == 0.0 and law[A3] == 0.0:
        return 1.0, 1.0
    a, b = min(max(strain_low, 0.0), MOST_STRAIN), min(max(strain_high, 0.0), MOST_STRAIN)
    c, d = multiply(a, b, down(3 * law[A3]), up(3 * law[A3]))
    c, d = add(c, d, 2 * law[A2], 2 * law[A2])
    c, d = multiply(a, b, c, d)
    c, d = add(c, d, 1.0, 1.0)
    return max(c, law[SLOPE_LOW]), min(d, law[SLOPE_HIGH])


@outlined
def strained(law, strain_low, strain_high):
    """τ/EA at a strain in an interval, which should be narrow."""
    if law[A2] == 0.0 and law[A3] == 0.0:
        return max(strain_low, 0.0), max(strain_high, 0.0)
    a, b = max(strain_low, 0.0), max(strain_high, 0.0)
    c, d = min(a, MOST_STRAIN), min(b, MOST_STRAIN)
    p, q = scaled(c, d, law[A3])
    p, q = add(p, q, law[A2], law[A2])
    p, q = multiply(c, d, p, q)
    p, q = add(p, q, 1.0, 1.0)
    p, q = multiply(c, d, p, q)
    beyond_low, beyond_high = max(down(a - d), 0.0), max(up(b - c), 0.0)
    if b <= MOST_STRAIN:
        beyond_low = beyond_high = 0.0
    s, t = slope(law, c, d)
    s, t = multiply(s, t, beyond_low, beyond_high)
    return add(p, q, s, t)


@outlined
def strain(law, length):
    """The stretch l − l0 over the length that stretches."""
    return over(down(length - law[REST]), up(length - law[REST]), law[WHOLE_LOW], law[WHOLE_HIGH])


@outlined
def tension(law, low, high):
    """τ over lengths [low, high]; it is increasing."""
    a, b = strain(law, low)
    c, d = strain(law, high)
    p = strained(law, a, b)[0]
    q = strained(law, c, d)[1]
    return max(down(law[EA_LOW] * p), 0.0), max(up(law[EA_HIGH] * q), 0.0)


@outlined
def load(setup, o, g):
    """Fill g (6, 2): minus the wrench of weight and external wrench about the platform's origin."""
    w0, w1 = setup.weight[0], setup.weight[1]
    c = o[-1, ARM : ARM + 3]
    for r in range(6):
        g[r, 0] = g[r, 1] = -setup.wrench[r]
    g[2, 0], g[2, 1] = add(g[2, 0], g[2, 1], w0, w1)
    a, b = multiply(w0, w1, c[1, 0], c[1, 1])
    g[3, 0], g[3, 1] = add(g[3, 0], g[3, 1], a, b)
    a, b = multiply(w0, w1, c[0, 0], c[0, 1])
    g[4, 0], g[4, 1] = subtract(g[4, 0], g[4, 1], a, b)


@outlined
def balance(T, W, g0, g1):
    """Contract tensions T by Σ Tᵢ Wᵢ + [g0, g1] = 0. False if it cannot vanish."""
    m = T.shape[0]
    parts = np.empty((m, 2))
    low, high = g0, g1
    for i in range(m):
        parts[i, 0], parts[i, 1] = multiply(T[i, 0], T[i, 1], W[i, 0], W[i, 1])
        low, high = add(low, high, parts[i, 0], parts[i, 1])
    if low > 0 or high < 0:
        return False
    for i in range(m):
        if W[i, 0] <= 0 <= W[i, 1]:
            continue
        low, high = g0, g1
        for j in range(m):
            if j != i:
                low, high = add(low, high, parts[j, 0], parts[j, 1])
        if W[i, 0] > 0:
            a, b = over(-high, -low, W[i, 0], W[i, 1])
        else:
            a, b = over(low, high, -W[i, 1], -W[i, 0])
        T[i, 0], T[i, 1] = max(T[i, 0], a), min(T[i, 1], b)
        if T[i, 0] > T[i, 1]:
            return False
    return True


@outlined
def virtual_work(T, o, g, rows, y, W):
    """Contract T by the balance along the motion y (6,), whose other entries than ``rows`` are zero."""
    low, high = 0.0, 0.0
    for i in range(T.shape[0]):
        W[i, 0] = W[i, 1] = 0.0
    for r in rows:
        for i in range(T.shape[0]):
            a, b = scaled(o[i, DIRECTION + r, 0], o[i, DIRECTION + r, 1], y[r])
            W[i, 0], W[i, 1] = add(W[i, 0], W[i, 1], a, b)
        a, b = scaled(g[r, 0], g[r, 1], y[r])
        low, high = add(low, high, a, b)
    return balance(T, W, low, high)


@outlined
def unbalanced(T, o, g, rows, y):
    """Unbalanced part of the best tensions within T at the middle, in floats: the motion y, or zero."""
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
    return normalised(y)


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
    """Contract a box q (6, 2) and tensions T by lengths, balances and virtual works. False: no equilibrium in it."""
    m, rows = T.shape[0], setup.rows
    if not geometry(q, setup, o, spin):
        return False
    for i in range(m):
        a, b = tension(setup.law[i], o[i, LENGTH, 0], o[i, LENGTH, 1])
        T[i, 0], T[i, 1] = max(T[i, 0], a), min(T[i, 1], b)
        if T[i, 0] > T[i, 1]:
            return False
    g, y, W = np.empty((6, 2)), np.zeros(6), np.empty((m, 2))
    load(setup, o, g)
    for r in rows:
        if not balance(T, o[:m, DIRECTION + r], g[r, 0], g[r, 1]):
            return False
    if len(rows) == 3:  # the motions along which two cables do no work
        w = np.empty((m, 3))
        for i in range(m):
            for k in range(3):
                w[i, k] = 0.5 * (o[i, DIRECTION + rows[k], 0] + o[i, DIRECTION + rows[k], 1])
        for i in range(m):
            for j in range(i):
                for k in range(3):
                    s, t = (k + 1) % 3, (k + 2) % 3
                    y[rows[k]] = w[i, s] * w[j, t] - w[i, t] * w[j, s]
                if normalised(y) and not virtual_work(T, o, g, rows, y, W):
                    return False
    elif unbalanced(T, o, g, rows, y) and not virtual_work(T, o, g, rows, y, W):
        return False
    for i in range(m):  # from tensions to lengths, from lengths to positions
        law = setup.law[i]
        high = up(law[REST] + up(law[WHOLE_HIGH] * up(up(T[i, 1] / law[EA_LOW]) / law[SLOPE_LOW])))
        low = 0.0
        if T[i, 0] > 0:
            low = down(law[REST] + down(law[WHOLE_LOW] * down(down(T[i, 0] / law[EA_HIGH]) / law[SLOPE_HIGH])))
        radius = setup.wheels[i, RADIUS, 0]
        if radius > 0:  # the straight distance d from the exit has d² = s² + 2 r² + 2 r a
            a, b = scaled(o[i, WRAP, 0], o[i, WRAP, 1], radius)
            low, high = max(down(low - b), 0.0), up(high - a)
            if high < 0:
                return False
            a, b = add(
                down(radius * radius), up(radius * radius), down(radius * o[i, BEYOND, 0]), up(radius * o[i, BEYOND, 1])
            )
            low, high = root_down(down(down(low * low) + 2 * a)), up(np.sqrt(up(up(high * high) + 2 * b)))
        d = o[i, APART : APART + 3]
        for r in range(3):
            s, t = (r + 1) % 3, (r + 2) % 3
            s0, s1 = square(d[s, 0], d[s, 1])
            t0, t1 = square(d[t, 0], d[t, 1])
            reach = up(up(high * high) - down(s0 + t0))
            if reach < 0:
                return False
            if q[r, 0] == q[r, 1]:
                continue
            reach = up(np.sqrt(reach))
            a, b = max(d[r, 0], -reach), min(d[r, 1], reach)
            clear = down(down(low * low) - up(s1 + t1))
            if low > 0 and clear > 0:
                clear = root_down(clear)
                if a > -clear:
                    a = max(a, clear)
                if b < clear:
                    b = min(b, -clear)
            if a > b:
                return False
            if a > d[r, 0] or b < d[r, 1]:
                a, b = add(a, b, setup.exits[i, r], setup.exits[i, r])
                a, b = subtract(a, b, o[i, ARM + r, 0], o[i, ARM + r, 1])
                q[r, 0], q[r, 1] = max(q[r, 0], a), min(q[r, 1], b)
                if q[r, 0] > q[r, 1]:
                    return False
    return True


@outlined
def invert(M):
    """The inverse in floats, and whether it exists. Not a proof."""
    n = M.shape[0]
    a, C = M.copy(), np.zeros((n, n))
    for i in range(n):
        C[i, i] = 1.0
    for i in range(n):
        p = i
        for j in range(i + 1, n):
            if abs(a[j, i]) > abs(a[p, i]):
                p = j
        if not abs(a[p, i]) > TINY:
            return C, False
        for k in range(n):
            a[p, k], a[i, k] = a[i, k], a[p, k]
            C[p, k], C[i, k] = C[i, k], C[p, k]
        part = 1 / a[i, i]
        for k in range(n):
            a[i, k] *= part
            C[i, k] *= part
        for j in range(n):
            part = a[j, i]
            if j != i and part != 0:
                for k in range(n):
                    a[j, k] -= part * a[i, k]
                    C[j, k] -= part * C[i, k]
    return C, True


@outlined
def derivatives(T, setup, o, spin, acting, count, J):
    """Fill J: derivatives of the balances and of the cables' laws by the free coordinates and the acting tensions."""
    m, rows, n = setup.exits.shape[0], setup.rows, len(setup.rows)
    J[:] = 0.0
    K = np.zeros((6, 6, 2))  # of the balances by translation and rotation vector
    w0, w1 = setup.weight[0], setup.weight[1]
    c = o[m, ARM : ARM + 3]
    for r in range(3):
        a, b = multiply(w0, w1, c[r, 0], c[r, 1])
        K[3 + r, 5, 0], K[3 + r, 5, 1] = add(K[3 + r, 5, 0], K[3 + r, 5, 1], a, b)
        a, b = multiply(-w1, -w0, c[2, 0], c[2, 1])
        K[3 + r, 3 + r, 0], K[3 + r, 3 + r, 1] = add(K[3 + r, 3 + r, 0], K[3 + r, 3 + r, 1], a, b)
    E = np.zeros((3, 6, 2))
    for k in range(count):
        i = acting[k]
        t0, t1 = T[i, 0], T[i, 1]
        s0, s1 = over(t0, t1, o[i, FREE, 0], o[i, FREE, 1])
        n_, u = o[i, DIRECTION : DIRECTION + 3], o[i, ARM : ARM + 3]
        for r in range(3):  # E = ([n]×, n·u − u nᵀ), and (1 − n nᵀ) seen by the arm is Eᵀ E
            s, t = (r + 1) % 3, (r + 2) % 3
            E[r, s, 0], E[r, s, 1] = -n_[t, 1], -n_[t, 0]
            E[r, t, 0], E[r, t, 1] = n_[s, 0], n_[s, 1]
            E[r, 3 + r, 0] = E[r, 3 + r, 1] = 0.0
            for x in range(3):
                a, b = multiply(u[r, 0], u[r, 1], n_[x, 0], n_[x, 1])
                E[r, 3 + x, 0], E[r, 3 + x, 1] = -b, -a
            a, b = multiply(u[s, 0], u[s, 1], n_[s, 0], n_[s, 1])
            d, e = multiply(u[t, 0], u[t, 1], n_[t, 0], n_[t, 1])
            E[r, 3 + r, 0], E[r, 3 + r, 1] = add(a, b, d, e)
        for r in rows:
            for x in rows:
                low, high = 0.0, 0.0
                for e in range(3):
                    if r == x:
                        a, b = square(E[e, r, 0], E[e, r, 1])
                    else:
                        a, b = multiply(E[e, r, 0], E[e, r, 1], E[e, x, 0], E[e, x, 1])
                    low, high = add(low, high, a, b)
                a, b = multiply(low, high, s0, s1)
                K[r, x, 0], K[r, x, 1] = add(K[r, x, 0], K[r, x, 1], a, b)
                if r > 2 and x > 2:  # the pull keeps its direction and its arm turns: u nᵀ − n·u
                    a, b = multiply(t0, t1, -E[r - 3, x, 1], -E[r - 3, x, 0])
                    K[r, x, 0], K[r, x, 1] = add(K[r, x, 0], K[r, x, 1], a, b)
        if setup.wheels[i, RADIUS, 0] > 0 and n > 3:  # a planar robot's wheel does not swivel
            s0, s1 = multiply(t0, t1, o[i, BEND, 0], o[i, BEND, 1])
            side = np.empty((6, 2))
            for r in range(3):
                side[r, 0], side[r, 1] = o[i, ACROSS + r, 0], o[i, ACROSS + r, 1]
            for r in range(3):
                side[3 + r, 0], side[3 + r, 1] = cross(u, side, r)
            for r in range(6):
                for x in range(6):
                    if r == x:
                        a, b = square(side[r, 0], side[r, 1])
                    else:
                        a, b = multiply(side[r, 0], side[r, 1], side[x, 0], side[x, 1])
                    a, b = multiply(a, b, s0, s1)
                    K[r, x, 0], K[r, x, 1] = add(K[r, x, 0], K[r, x, 1], a, b)
        law = setup.law[i]
        a, b = strain(law, o[i, LENGTH, 0])[0], strain(law, o[i, LENGTH, 1])[1]
        low, high = slope(law, a, b)
        if o[i, LENGTH, 0] < law[REST]:
            low = 0.0
        for r in range(n):
            w0_, w1_ = o[i, DIRECTION + rows[r], 0], o[i, DIRECTION + rows[r], 1]
            J[r, n + k, 0], J[r, n + k, 1] = w0_, w1_
            K_low, K_high = multiply(low, high, w0_, w1_)
            J[n + k, r, 0], J[n + k, r, 1] = K_low, K_high
        J[n + k, n + k, 0] = -up(law[WHOLE_HIGH] / law[EA_LOW])
        J[n + k, n + k, 1] = -down(law[WHOLE_LOW] / law[EA_HIGH])
    turned = np.empty((6, 2))
    for r in range(n + count):  # from rotation vectors to v: by its angular velocities
        for x in range(3):
            turned[x, 0] = turned[x, 1] = turned[3 + x, 0] = turned[3 + x, 1] = 0.0
        for x in range(n):
            if r < n:
                turned[rows[x], 0], turned[rows[x], 1] = K[rows[r], rows[x], 0], K[rows[r], rows[x], 1]
            else:
                turned[rows[x], 0], turned[rows[x], 1] = J[r, x, 0], J[r, x, 1]
        for x in range(n):
            if rows[x] < 3:
                J[r, x, 0], J[r, x, 1] = turned[rows[x], 0], turned[rows[x], 1]
            else:
                low, high = 0.0, 0.0
                for e in range(3):
                    a, b = turned[3 + e, 0], turned[3 + e, 1]
                    if r < n:
                        a, b = K[rows[r], 3 + e, 0], K[rows[r], 3 + e, 1]
                    a, b = multiply(a, b, spin[rows[x] - 3, e, 0], spin[rows[x] - 3, e, 1])
                    low, high = add(low, high, a, b)
                J[r, x, 0], J[r, x, 1] = low, high


@outlined
def krawczyk(q, T, setup, o, spin, at):
    """Krawczyk's test in the free coordinates and the tensions of cables that may be taut; contracts q and T.

    Returns EMPTY, CONTRACTED or UNIQUE; the middle of its image is written to ``at`` (6,).
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
    Y, opened, J = np.empty((N, 2)), T.copy(), np.empty((N, N, 2))
    for r in range(n):
        Y[r, 0], Y[r, 1] = q[rows[r], 0], q[rows[r], 1]
    for k in range(count):
        i = acting[k]
        wider = OPENED * (T[i, 1] - T[i, 0]) + 1e-9 * setup.weight[1] + TINY
        opened[i, 0], opened[i, 1] = T[i, 0] - wider, T[i, 1] + wider
        Y[n + k, 0], Y[n + k, 1] = opened[i, 0], opened[i, 1]
    derivatives(opened, setup, o, spin, acting, count, J)
    C = np.empty((N, N))
    for r in range(N):
        for c in range(N):
            C[r, c] = 0.5 * (J[r, c, 0] + J[r, c, 1])
    C, regular = invert(C)
    if not regular:
        return CONTRACTED
    middle, thin, G, g = np.empty(N), q.copy(), np.zeros((N, 2)), np.empty((6, 2))
    for r in range(N):
        middle[r] = 0.5 * (Y[r, 0] + Y[r, 1])
    for r in range(n):
        thin[rows[r], 0] = thin[rows[r], 1] = middle[r]
    if not geometry(thin, setup, o, spin):
        return CONTRACTED
    load(setup, o, g)
    for r in range(n):
        G[r, 0], G[r, 1] = g[rows[r], 0], g[rows[r], 1]
    for k in range(count):
        i, tau = acting[k], middle[n + k]
        law = setup.law[i]
        for r in range(n):
            a, b = multiply(o[i, DIRECTION + rows[r], 0], o[i, DIRECTION + rows[r], 1], tau, tau)
            G[r, 0], G[r, 1] = add(G[r, 0], G[r, 1], a, b)
        low = strained(law, strain(law, o[i, LENGTH, 0])[0], strain(law, o[i, LENGTH, 0])[1])[0]
        high = strained(law, strain(law, o[i, LENGTH, 1])[0], strain(law, o[i, LENGTH, 1])[1])[1]
        a, b = multiply(low, high, law[WHOLE_LOW], law[WHOLE_HIGH])
        low, high = multiply(down(law[WHOLE_LOW] / law[EA_HIGH]), up(law[WHOLE_HIGH] / law[EA_LOW]), tau, tau)
        G[n + k, 0], G[n + k, 1] = subtract(a, b, low, high)
    inside, image = True, np.empty((N, 2))
    for r in range(N):
        k0, k1 = middle[r], middle[r]
        for c in range(N):
            a, b = scaled(G[c, 0], G[c, 1], -C[r, c])
            k0, k1 = add(k0, k1, a, b)
        for c in range(N):
            e0 = e1 = 1.0 if r == c else 0.0
            for s in range(N):
                if J[s, c, 0] == 0 and J[s, c, 1] == 0:
                    continue
                a, b = scaled(J[s, c, 0], J[s, c, 1], C[r, s])
                e0, e1 = subtract(e0, e1, a, b)
            a, b = multiply(e0, e1, down(Y[c, 0] - middle[c]), up(Y[c, 1] - middle[c]))
            k0, k1 = add(k0, k1, a, b)
        if not (k0 > -np.inf and k1 < np.inf):
            return CONTRACTED
        inside = inside and k0 > Y[r, 0] and k1 < Y[r, 1]
        image[r, 0], image[r, 1] = max(k0, Y[r, 0]), min(k1, Y[r, 1])
        if image[r, 0] > image[r, 1]:
            return EMPTY
    for r in range(n):
        q[rows[r], 0], q[rows[r], 1] = image[r, 0], image[r, 1]
        at[rows[r]] = 0.5 * (image[r, 0] + image[r, 1])
    for k in range(count):
        i = acting[k]
        T[i, 0], T[i, 1] = max(T[i, 0], image[n + k, 0]), min(T[i, 1], image[n + k, 1])
        if T[i, 0] > T[i, 1]:
            return EMPTY
    return UNIQUE if inside else CONTRACTED


@outlined
def steps_to_equilibrium(start, setup, o, spin):
    """Newton's steps in floats from a pose (6,): the last pose, and whether they converge. Not a proof."""
    m, rows, n = setup.exits.shape[0], setup.rows, len(setup.rows)
    y, last, g = start.copy(), np.inf, np.empty((6, 2))
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
            tau = tension(setup.law[i], o[i, LENGTH, 0], o[i, LENGTH, 0])[1]
            T[i, 0] = T[i, 1] = tau
            if o[i, LENGTH, 0] > setup.law[i, REST]:
                acting[count] = i
                count += 1
                for r in range(n):
                    F[r] += tau * o[i, DIRECTION + rows[r], 0]
        J = np.empty((n + count, n + count, 2))
        derivatives(T, setup, o, spin, acting, count, J)
        C, regular = invert(J[:, :, 0].copy())
        if not regular:
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
    at, T, size = np.empty(6), np.empty((m, 2)), 100 * setup.near
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
            T[i, 0], T[i, 1] = tension(setup.law[i], o[i, LENGTH, 0], o[i, LENGTH, 1])
        if krawczyk(tried, T, setup, o, spin, at) == UNIQUE:
            return True
        size /= 10
    return False


@outlined
def tightened(q, T, setup, o, spin, at):
    """Contract a box with exactly one equilibrium until it hardly shrinks: ``at`` (6,) is near the equilibrium."""
    width = np.inf
    for _ in range(TIGHTER):
        last, width = width, 0.0
        for r in setup.rows:
            width = max(width, (q[r, 1] - q[r, 0]) * setup.scales[r])
        if width > 0.9 * last or not contract(q, T, setup, o, spin):
            return
        if krawczyk(q, T, setup, o, spin, at) == EMPTY:
            return


@outlined
def found_at(found, box, at):
    """Store a box and the point near its equilibrium."""
    for r in range(6):
        found[r, 0], found[r, 1], found[r, 2] = box[r, 0], box[r, 1], at[r]


@outlined
def search(setup, boxes, tensions, top, found, nf, left, nl, most, counts):
    """Continue a search, depth first, for at most ``most`` boxes.

    Args:
        setup: the problem.
        boxes: pending boxes, (room, 6, 2), of which the first ``top`` are filled in.
        tensions: their ranges of tensions, (room, cables, 2).
        top: number of pending boxes.
        found: boxes with exactly one equilibrium: lower, upper and a point near it, (room, 6, 3); ``nf`` are filled in.
        nf: their number.
        left: undecided boxes, (room, 6, 2), of which ``nl`` are filled in.
        nl: their number.
        most: number of boxes to examine.
        counts: counts of the results, (COUNTS,), added to.

    Returns:
        The new top, nf and nl. The search is complete at top = 0; it also stops if the arrays are full.
    """
    m, rows = setup.exits.shape[0], setup.rows
    o, spin, at = np.zeros((m + 1, COLUMNS, 2)), np.empty((3, 3, 2)), np.zeros(6)
    box, end = np.empty((6, 2)), counts[BOXES] + most
    while top > 0 and counts[BOXES] < end:
        if nf == found.shape[0] or nl == left.shape[0] or top + 1 >= boxes.shape[0]:
            return top, nf, nl
        top -= 1
        q, T = boxes[top].copy(), tensions[top].copy()
        counts[BOXES] += 1
        alive = True
        for _ in range(ROUNDS):
            old = q.copy()
            for f in range(nf):
                if within(q, found[f], rows):
                    alive = False
                    break
            if not alive:
                break
            if not contract(q, T, setup, o, spin):
                counts[BY_BALANCE] += 1
                alive = False
                break
            width = 0.0
            for r in rows:
                width = max(width, (q[r, 1] - q[r, 0]) * setup.scales[r])
            if width < setup.newton:
                state = krawczyk(q, T, setup, o, spin, at)
                if state == EMPTY:
                    counts[BY_KRAWCZYK] += 1
                    alive = False
                    break
                if state == UNIQUE:
                    tightened(q, T, setup, o, spin, at)
                    found_at(found[nf], old, at)
                    nf += 1
                    counts[PROVED] += 1
                    alive = False
                    break
            shrunk = 1.0
            for r in rows:
                if old[r, 1] > old[r, 0]:
                    shrunk = min(shrunk, (q[r, 1] - q[r, 0]) / (old[r, 1] - old[r, 0]))
            if shrunk > AGAIN:
                break
        if not alive:
            continue
        widest, width = rows[0], -1.0
        for r in rows:
            if (q[r, 1] - q[r, 0]) * setup.scales[r] > width:
                widest, width = r, (q[r, 1] - q[r, 0]) * setup.scales[r]
        if width < setup.near and blown_up(q, setup, o, spin, box):
            for r in range(6):
                at[r] = 0.5 * (box[r, 0] + box[r, 1])
            found_at(found[nf], box, at)
            nf += 1
            counts[PROVED] += 1
            continue
        if width < setup.least:
            left[nl] = q
            nl += 1
            counts[LEFT] += 1
            continue
        cut = q[widest, 0] + SPLIT * (q[widest, 1] - q[widest, 0])
        boxes[top] = q
        tensions[top] = T
        boxes[top, widest, 1] = cut
        boxes[top + 1] = q
        tensions[top + 1] = T
        boxes[top + 1, widest, 0] = cut
        top += 2
    return top, nf, nl


def _search(
    exits, anchors, law, wheels, center_of_mass, weight, wrench, rows, scales, newton, near, least, boxes, tensions,
    top, found, nf, left, nl, most, counts,
):  # fmt: skip
    """``search`` with the fields of ``Setup`` one by one: a signature in Numba's notation has no named tuples."""
    setup = Setup(exits, anchors, law, wheels, center_of_mass, weight, wrench, rows, scales, newton, near, least)
    return search(setup, boxes, tensions, top, found, nf, left, nl, most, counts)


SEARCH = compiling.Compiled(
    "search for all equilibria",
    _search,
    "UniTuple(int64, 3)(float64[:, ::1], float64[:, ::1], float64[:, ::1], float64[:, :, ::1], float64[::1], "
    "float64[::1], float64[::1], int64[::1], float64[::1], float64, float64, float64, float64[:, :, ::1], "
    "float64[:, :, ::1], int64, float64[:, :, ::1], int64, float64[:, :, ::1], int64, int64, int64[::1])",
    error_model="numpy",
    nogil=True,
)
"""``search`` as machine code. Its arguments are the fields of a ``Setup``, and then those of ``search``."""

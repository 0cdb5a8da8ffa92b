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

THIN = 1e-3
"""Fraction of the widest coordinate below which no coordinate is divided."""

ALMOST_PARALLEL = 1e-6
"""Added to the squares of the cables' directions and moments: almost parallel cables are not isolated."""


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
    """The rotation over a box, (9, 2) row by row; and the angular velocities of v_k, (9, 2), by coordinates k first."""
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
        R[4 * k, 0], R[4 * k, 1] = down(1 - most), up(1 - few)
        spin[4 * k, 0], spin[4 * k, 1] = double_low, double_high
    for k in range(3):
        i, j = (k + 1) % 3, (k + 2) % 3
        a, b = multiply(f[i, 0], f[i, 1], q[3 + j, 0], q[3 + j, 1])
        c, d = multiply(f[j, 0], f[j, 1], q[3 + i, 0], q[3 + i, 1])
        a, b = max(a, c), min(b, d)
        R[3 * i + j, 0], R[3 * i + j, 1] = subtract(a, b, f[k, 0], f[k, 1])
        R[3 * j + i, 0], R[3 * j + i, 1] = add(a, b, f[k, 0], f[k, 1])
        spin[3 * i + j, 0], spin[3 * i + j, 1] = f[k, 0], f[k, 1]
        spin[3 * j + i, 0], spin[3 * j + i, 1] = -f[k, 1], -f[k, 0]


@outlined
def cross(a, p, b, q, r):
    """Component r of the product of the vectors in the rows p, p + 1, p + 2 of a, and q, q + 1, q + 2 of b."""
    i, j = (r + 1) % 3, (r + 2) % 3
    p0, p1 = multiply(a[p + i, 0], a[p + i, 1], b[q + j, 0], b[q + j, 1])
    q0, q1 = multiply(a[p + j, 0], a[p + j, 1], b[q + i, 0], b[q + i, 1])
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
        t0, t1 = max(down(sin0 / up(1 + cos1)), 0.0), up(sin1 / down(1 + cos0)) if down(1 + cos0) > 0 else np.inf
    elif cos1 < 0:
        t0, t1 = over(sin0, sin1, -cos1, -cos0)
    else:
        t0, t1 = -np.inf, np.inf
    low, high = -HALF_PI[1], HALF_PI[1]
    for end in range(2):
        t = t1 if end else t0
        if abs(t) < 1e9:
            a, b = arctangent(abs(t), abs(t))
            if end:
                high = b if t >= 0 else -a
            else:
                low = a if t >= 0 else -b
    if h >= 0:
        t0, t1 = 2 * max(low, 0.0), 2 * high
    elif cos1 < 0:  # π − atan(sin θ/−cos θ)
        t0, t1 = down(2 * HALF_PI[0] - high), up(2 * HALF_PI[1] - low)
    else:
        t0, t1 = HALF_PI[0], LARGEST_WRAP
    l0, l1 = scaled(t0, t1, radius)
    l0, l1 = add(l0, l1, s0, s1)
    return s0, s1, sin0, sin1, cos0, cos1, t0, t1, l0, l1


@outlined
def over_wheel(o, wheel):
    """Fill in a cable's geometry over its wheel from ``APART``. False: nowhere in the box it is clear of its wheel."""
    radius, n = wheel[RADIUS, 0], np.empty((3, 2))
    h0, h1, squares, aside, at = 0.0, 0.0, np.empty((3, 2)), np.empty((3, 2)), np.zeros((4, 10))
    straight = 0.0
    for r in range(3):
        a, b = multiply(o[APART + r, 0], o[APART + r, 1], wheel[AXIS + r, 0], wheel[AXIS + r, 1])
        h0, h1 = add(h0, h1, a, b)
        aside[r, 0] = aside[r, 1] = 0.0
        for c in range(3):
            e = ASIDE + 3 * r + c
            a, b = multiply(o[APART + c, 0], o[APART + c, 1], wheel[e, 0], wheel[e, 1])
            aside[r, 0], aside[r, 1] = add(aside[r, 0], aside[r, 1], a, b)
        squares[r, 0], squares[r, 1] = square(aside[r, 0], aside[r, 1])
        straight = max(down(straight + square(o[APART + r, 0], o[APART + r, 1])[0]), 0.0)
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
        for k in range(4):
            c = at[k]
            c[0], c[1], c[2], c[3], c[4], c[5], c[6], c[7], c[8], c[9] = corner(
                a1 if k > 1 else a0, h1 if k % 2 else h0, radius
            )
    c00, c01, c10, c11 = at[0], at[1], at[2], at[3]
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
        o[ACROSS + r, 0], o[ACROSS + r, 1] = cross(wheel, AXIS, n, 0, r)
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
            low = high = centred_low = centred_high = 0.0
            for k in range(3):
                if b[k] == 0 or (planar and (r + k) % 2 == 1):
                    continue
                p0, p1 = scaled(R[3 * r + k, 0], R[3 * r + k, 1], b[k])
                low, high = add(low, high, p0, p1)
                if turns:
                    p0, p1 = scaled(Rm[3 * r + k, 0], Rm[3 * r + k, 1], b[k])
                    centred_low, centred_high = add(centred_low, centred_high, p0, p1)
            c[ARM + r, 0], c[ARM + r, 1] = low, high
            centred[r, 0], centred[r, 1] = centred_low, centred_high
        if turns:
            for k in range(3):
                if q[3 + k, 0] == q[3 + k, 1]:
                    continue
                w0, w1 = subtract(q[3 + k, 0], q[3 + k, 1], middle[3 + k, 0], middle[3 + k, 0])
                for r in range(3):
                    if planar and r == 1:
                        continue
                    p0, p1 = cross(spin, 3 * k, c, ARM, r)
                    p0, p1 = multiply(p0, p1, w0, w1)
                    centred[r, 0], centred[r, 1] = add(centred[r, 0], centred[r, 1], p0, p1)
            for r in range(3):
                c[ARM + r, 0], c[ARM + r, 1] = max(c[ARM + r, 0], centred[r, 0]), min(c[ARM + r, 1], centred[r, 1])
        if i == m:
            return True
        for r in range(3):
            p0, p1 = add(q[r, 0], q[r, 1], c[ARM + r, 0], c[ARM + r, 1])
            p0, p1 = subtract(p0, p1, setup.exits[i, r], setup.exits[i, r])
            c[APART + r, 0], c[APART + r, 1] = p0, p1
            squares[r, 0], squares[r, 1] = square(p0, p1)
        if setup.wheels[i, RADIUS, 0] > 0:
            if not over_wheel(c, setup.wheels[i]):
                return False
        else:
            low = down(down(squares[0, 0] + squares[1, 0]) + squares[2, 0])
            high = up(up(squares[0, 1] + squares[1, 1]) + squares[2, 1])
            c[LENGTH, 0], c[LENGTH, 1] = root_down(low), up(np.sqrt(high))
            c[FREE, 0], c[FREE, 1] = c[LENGTH, 0], c[LENGTH, 1]
            for r in range(3):
                s, t = (r + 1) % 3, (r + 2) % 3
                low, high = max(down(squares[s, 0] + squares[t, 0]), 0.0), up(squares[s, 1] + squares[t, 1])
                c[DIRECTION + r, 0] = unit_down(c[APART + r, 0], low, high)
                c[DIRECTION + r, 1] = -unit_down(-c[APART + r, 1], low, high)
        for r in range(3):
            if not planar or r == 1:
                c[MOMENT + r, 0], c[MOMENT + r, 1] = cross(c, ARM, c, DIRECTION, r)
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
    w0, w1, m = setup.weight[0], setup.weight[1], setup.exits.shape[0]
    for r in range(6):
        g[r, 0] = g[r, 1] = -setup.wrench[r]
    g[2, 0], g[2, 1] = add(g[2, 0], g[2, 1], w0, w1)
    a, b = multiply(w0, w1, o[m, ARM + 1, 0], o[m, ARM + 1, 1])
    g[3, 0], g[3, 1] = add(g[3, 0], g[3, 1], a, b)
    a, b = multiply(w0, w1, o[m, ARM, 0], o[m, ARM, 1])
    g[4, 0], g[4, 1] = subtract(g[4, 0], g[4, 1], a, b)


@outlined
def balance(T, W, g0, g1):
    """Contract tensions T by Σ Tᵢ Wᵢ + [g0, g1] = 0. False if it cannot vanish. W (cables, 4) has room for Tᵢ Wᵢ."""
    m = T.shape[0]
    low, high = g0, g1
    for i in range(m):
        W[i, 2], W[i, 3] = multiply(T[i, 0], T[i, 1], W[i, 0], W[i, 1])
        low, high = add(low, high, W[i, 2], W[i, 3])
    if low > 0 or high < 0:
        return False
    for i in range(m):
        if W[i, 0] <= 0 <= W[i, 1]:
            continue
        low, high = g0, g1
        for j in range(m):
            if j != i:
                low, high = add(low, high, W[j, 2], W[j, 3])
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
    if not normalised(y):
        return True
    low, high = 0.0, 0.0
    for i in range(T.shape[0]):
        W[i, 0] = W[i, 1] = 0.0
    for r in rows:
        if y[r] == 0:
            continue
        for i in range(T.shape[0]):
            a, b = scaled(o[i, DIRECTION + r, 0], o[i, DIRECTION + r, 1], y[r])
            W[i, 0], W[i, 1] = add(W[i, 0], W[i, 1], a, b)
        a, b = scaled(g[r, 0], g[r, 1], y[r])
        low, high = add(low, high, a, b)
    return balance(T, W, low, high)


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
    """Contract a box q (6, 2) and tensions T by lengths, balances and virtual works. False: no equilibrium in it."""
    m, rows = T.shape[0], setup.rows
    if not geometry(q, setup, o, spin):
        return False
    for i in range(m):
        a, b = tension(setup.law[i], o[i, LENGTH, 0], o[i, LENGTH, 1])
        T[i, 0], T[i, 1] = max(T[i, 0], a), min(T[i, 1], b)
        if T[i, 0] > T[i, 1]:
            return False
    g, y, W, n = np.empty((6, 2)), np.zeros(6), np.empty((m, 4)), len(rows)
    load(setup, o, g)
    for r in rows:
        for i in range(m):
            W[i, 0], W[i, 1] = o[i, DIRECTION + r, 0], o[i, DIRECTION + r, 1]
        if not balance(T, W, g[r, 0], g[r, 1]):
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
            a, b = scaled(o[i, WRAP, 0], o[i, WRAP, 1], radius)
            low, high = max(down(low - b), 0.0), up(high - a)
            if high < 0:
                return False
            a, b = add(
                down(radius * radius), up(radius * radius), down(radius * o[i, BEYOND, 0]), up(radius * o[i, BEYOND, 1])
            )
            low, high = root_down(down(down(low * low) + 2 * a)), up(np.sqrt(up(up(high * high) + 2 * b)))
        for r in range(3):
            if q[r, 0] == q[r, 1]:
                continue
            s, t = APART + (r + 1) % 3, APART + (r + 2) % 3
            s0, s1 = square(o[i, s, 0], o[i, s, 1])
            t0, t1 = square(o[i, t, 0], o[i, t, 1])
            reach = up(up(high * high) - down(s0 + t0))
            if reach < 0:
                return False
            reach, d0, d1 = up(np.sqrt(reach)), o[i, APART + r, 0], o[i, APART + r, 1]
            a, b = max(d0, -reach), min(d1, reach)
            clear = down(down(low * low) - up(s1 + t1))
            if low > 0 and clear > 0:
                clear = root_down(clear)
                if a > -clear:
                    a = max(a, clear)
                if b < clear:
                    b = min(b, -clear)
            if a > b:
                return False
            if a > d0 or b < d1:
                a, b = add(a, b, setup.exits[i, r], setup.exits[i, r])
                a, b = subtract(a, b, o[i, ARM + r, 0], o[i, ARM + r, 1])
                q[r, 0], q[r, 1] = max(q[r, 0], a), min(q[r, 1], b)
                if q[r, 0] > q[r, 1]:
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


@outlined
def bending(o, i, setup, B):
    """Fill B (free, free, 2): derivatives of cable i's direction and moment by translation and rotation vector."""
    rows, n = setup.rows, len(setup.rows)
    c, E, planar = o[i], np.zeros((3, 6, 2)), n == 3
    for r in range(3):  # E = ([n]×, n·u − u nᵀ), and (1 − n nᵀ) seen by the arm is Eᵀ E
        if planar and r != 1:
            continue
        s, t = (r + 1) % 3, (r + 2) % 3
        E[r, s, 0], E[r, s, 1] = -c[DIRECTION + t, 1], -c[DIRECTION + t, 0]
        E[r, t, 0], E[r, t, 1] = c[DIRECTION + s, 0], c[DIRECTION + s, 1]
        for x in range(3):
            if x != r and not planar:
                p, q = multiply(c[ARM + r, 0], c[ARM + r, 1], c[DIRECTION + x, 0], c[DIRECTION + x, 1])
                E[r, 3 + x, 0], E[r, 3 + x, 1] = -q, -p
        p, q = multiply(c[ARM + s, 0], c[ARM + s, 1], c[DIRECTION + s, 0], c[DIRECTION + s, 1])
        d, e = multiply(c[ARM + t, 0], c[ARM + t, 1], c[DIRECTION + t, 0], c[DIRECTION + t, 1])
        E[r, 3 + r, 0], E[r, 3 + r, 1] = add(p, q, d, e)
    for k in range(n):
        for j in range(k + 1):
            r, x, low, high = rows[k], rows[j], 0.0, 0.0
            for e in range(3):
                if planar and e != 1:
                    continue
                if r == x:
                    p, q = square(E[e, r, 0], E[e, r, 1])
                else:
                    p, q = multiply(E[e, r, 0], E[e, r, 1], E[e, x, 0], E[e, x, 1])
                low, high = add(low, high, p, q)
            low, high = over(low, high, c[FREE, 0], c[FREE, 1])
            B[k, j, 0], B[k, j, 1] = low, high
            B[j, k, 0], B[j, k, 1] = low, high
    if setup.wheels[i, RADIUS, 0] > 0 and not planar:  # a planar robot's wheel does not swivel
        side = np.empty((6, 2))
        for r in range(3):
            side[r, 0], side[r, 1] = c[ACROSS + r, 0], c[ACROSS + r, 1]
        for r in range(3):
            side[3 + r, 0], side[3 + r, 1] = cross(c, ARM, side, 0, r)
        for r in range(6):
            for x in range(6):
                if r == x:
                    p, q = square(side[r, 0], side[r, 1])
                else:
                    p, q = multiply(side[r, 0], side[r, 1], side[x, 0], side[x, 1])
                p, q = multiply(p, q, c[BEND, 0], c[BEND, 1])
                B[r, x, 0], B[r, x, 1] = add(B[r, x, 0], B[r, x, 1], p, q)
    for k in range(n):
        for j in range(n):
            if rows[k] > 2 and rows[j] > 2:  # the pull keeps its direction and its arm turns: u nᵀ − n·u
                e, x = rows[k] - 3, rows[j]
                B[k, j, 0], B[k, j, 1] = subtract(B[k, j, 0], B[k, j, 1], E[e, x, 0], E[e, x, 1])


@outlined
def derivatives(T, setup, o, spin, acting, count, B, J):
    """Fill J: derivatives of the balances and of the cables' extensions by the free coordinates, at tensions T.

    The columns of the tensions are those of taut cables. B (cables, free, free, 2) is each cable's ``bending``.
    """
    m, rows, n = setup.exits.shape[0], setup.rows, len(setup.rows)
    turned = np.empty((6, 2))
    w0, w1 = setup.weight[0], setup.weight[1]
    for r in range(n + count):
        for x in range(n):
            low, high = 0.0, 0.0
            if r >= n:
                i = acting[r - n]
                low, high = o[i, DIRECTION + rows[x], 0], o[i, DIRECTION + rows[x], 1]
            else:
                for k in range(count):
                    i = acting[k]
                    a, b = multiply(B[i, r, x, 0], B[i, r, x, 1], T[i, 0], T[i, 1])
                    low, high = add(low, high, a, b)
                e, f = rows[r] - 3, rows[x] - 3
                if e >= 0 and f == 2:
                    a, b = multiply(w0, w1, o[m, ARM + e, 0], o[m, ARM + e, 1])
                    low, high = add(low, high, a, b)
                if e >= 0 and e == f:
                    a, b = multiply(w0, w1, o[m, ARM + 2, 0], o[m, ARM + 2, 1])
                    low, high = subtract(low, high, a, b)
            turned[x, 0], turned[x, 1] = low, high
        for x in range(n):  # from rotation vectors to v: by its angular velocities
            low, high = turned[x, 0], turned[x, 1]
            if rows[x] > 2:
                low, high = 0.0, 0.0
                for e in range(n):
                    if rows[e] > 2:
                        s = 3 * (rows[x] - 3) + rows[e] - 3
                        a, b = multiply(turned[e, 0], turned[e, 1], spin[s, 0], spin[s, 1])
                        low, high = add(low, high, a, b)
            if r >= n:
                law = setup.law[acting[r - n]]
                length = o[acting[r - n]]
                a, b = slope(law, strain(law, length[LENGTH, 0])[0], strain(law, length[LENGTH, 1])[1])
                low, high = multiply(low, high, a, b)
            J[r, x, 0], J[r, x, 1] = low, high
    for k in range(count):
        i = acting[k]
        law = setup.law[i]
        for r in range(count):
            J[n + r, n + k, 0] = J[n + r, n + k, 1] = 0.0
        for r in range(n):
            J[r, n + k, 0], J[r, n + k, 1] = o[i, DIRECTION + rows[r], 0], o[i, DIRECTION + rows[r], 1]
        J[n + k, n + k, 0] = -up(law[WHOLE_HIGH] / law[EA_LOW])
        J[n + k, n + k, 1] = -down(law[WHOLE_LOW] / law[EA_HIGH])


@outlined
def branched(J, setup, o, acting, count, taut, low, high, gap):
    """Multiply the tensions' columns of J: the tension is max(y, 0), with a slope in [low, high] (cables,).

    And the cable's extension is min(y, 0) times ``gap`` where it is slack.
    """
    rows, n = setup.rows, len(setup.rows)
    for k in range(count):
        if taut[k]:
            continue
        i = acting[k]
        law = setup.law[i]
        for r in range(n):
            a, b = o[i, DIRECTION + rows[r], 0], o[i, DIRECTION + rows[r], 1]
            J[r, n + k, 0], J[r, n + k, 1] = multiply(a, b, low[k], high[k])
        a, b = multiply(low[k], high[k], down(law[WHOLE_LOW] / law[EA_HIGH]), up(law[WHOLE_HIGH] / law[EA_LOW]))
        c, d = scaled(down(1 - high[k]), up(1 - low[k]), gap[k])
        a, b = add(a, b, c, d)
        J[n + k, n + k, 0], J[n + k, n + k, 1] = -b, -a


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
    share = (N + 8) * SHARE
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
        Y[r, 0], Y[r, 1] = q[rows[r], 0], q[rows[r], 1]
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
        G[r, 0], G[r, 1] = g[rows[r], 0], g[rows[r], 1]
    for k in range(count):
        i, tau, y = acting[k], between[acting[k], 0], middle[n + k]
        law, length = setup.law[i], o[i]
        for r in range(n):
            a, b = scaled(length[DIRECTION + rows[r], 0], length[DIRECTION + rows[r], 1], tau)
            G[r, 0], G[r, 1] = add(G[r, 0], G[r, 1], a, b)
        a, b = strain(law, length[LENGTH, 0])[0], strain(law, length[LENGTH, 1])[1]
        c, d = strained(law, a, a)[0], strained(law, b, b)[1]
        a, b = multiply(down(c + min(a, 0.0)), up(d + min(b, 0.0)), law[WHOLE_LOW], law[WHOLE_HIGH])
        c, d = multiply(down(law[WHOLE_LOW] / law[EA_HIGH]), up(law[WHOLE_HIGH] / law[EA_LOW]), tau, tau)
        a, b = subtract(a, b, c, d)
        if y < 0:
            a, b = subtract(a, b, down(y * gap[k]), up(y * gap[k]))
        G[n + k, 0], G[n + k, 1] = a, b
    inside, share = True, (N + 8) * SHARE
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
        else:
            i = acting[r - n]
            T[i, 0], T[i, 1] = max(T[i, 0], k0), min(T[i, 1], max(k1, 0.0))
            if T[i, 0] > T[i, 1]:
                return EMPTY
    if not inside:
        return CONTRACTED
    for r in range(n):
        thin[rows[r], 0], thin[rows[r], 1] = Y[r, 0], Y[r, 1]
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
            tau = tension(setup.law[i], o[i, LENGTH, 0], o[i, LENGTH, 0])[1]
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
            T[i, 0], T[i, 1] = tension(setup.law[i], o[i, LENGTH, 0], o[i, LENGTH, 1])
        if krawczyk(tried, T, setup, o, spin, at, smear) == UNIQUE:
            return True
        size /= 10
    return False


@outlined
def tightened(q, T, setup, o, spin, at):
    """Contract a box with exactly one equilibrium until it hardly shrinks: ``at`` (6,) is near the equilibrium."""
    width, smear = np.inf, np.empty(6)
    for _ in range(TIGHTER):
        last, width = width, 0.0
        for r in setup.rows:
            width = max(width, (q[r, 1] - q[r, 0]) * setup.scales[r])
        if width > 0.9 * last or not contract(q, T, setup, o, spin):
            return
        if krawczyk(q, T, setup, o, spin, at, smear) == EMPTY:
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
    o, spin, at, smear = np.zeros((m + 1, COLUMNS, 2)), np.empty((9, 2)), np.zeros(6), np.zeros(6)
    box, end = np.empty((6, 2)), counts[BOXES] + most
    while top > 0 and counts[BOXES] < end:
        if nf == found.shape[0] or nl == left.shape[0] or top + 1 >= boxes.shape[0]:
            return top, nf, nl
        top -= 1
        q, T = boxes[top].copy(), tensions[top].copy()
        counts[BOXES] += 1
        alive, old = True, np.empty((6, 2))
        for _ in range(ROUNDS):
            old[:] = q
            smear[:] = 0.0
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
                state = krawczyk(q, T, setup, o, spin, at, smear)
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
        widest, width, most_smear = rows[0], -1.0, 0.0
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
        for r in rows:
            if smear[r] > most_smear and (q[r, 1] - q[r, 0]) * setup.scales[r] > THIN * width:
                widest, most_smear = r, smear[r]
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

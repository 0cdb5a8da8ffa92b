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
    over,
    root_down,
    scaled,
    square,
    subtract,
    unit_down,
    up,
)

LENGTH, DIRECTION, MOMENT, ARM, APART, FREE, WRAP, BEYOND, ACROSS, BEND, COLUMNS = (
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

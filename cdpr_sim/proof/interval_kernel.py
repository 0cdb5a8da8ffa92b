"""Interval arithmetic, compiled. An interval is a pair (lower, upper).

Each result is rounded outwards by more than half a unit in the last place, and only + − × ÷ and the square root are
used, which IEEE 754 rounds correctly: no rounding mode is set, and no library's sine or arc tangent is used. If a
compiler contracts a product and a sum into one operation, that operation is rounded once, and the bounds still hold.
"""

from __future__ import annotations

import numpy as np

from cdpr_sim.core.compiling import outlined

SHARE, TINY = 2.3e-16, 1e-300
"""Half a unit in the last place is at most 1.2e-16 of a number; a whole one, 2.3e-16; and an absolute bound below any
length."""

ARCTANGENT_TERMS = 14
"""Terms of the series of the arc tangent of x <= tan(π/16): all that is left out is below x²⁸, 3e-20."""


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

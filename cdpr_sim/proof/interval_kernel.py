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
def of_sums(terms):
    """Bound of the rounding of a sum of that many products and of two more, as a share of the sum of magnitudes."""
    return (terms + 8) * SHARE


@outlined
def row(a, i):
    """The interval in row i of an array (rows, 2)."""
    return a[i, 0], a[i, 1]


@outlined
def add(x, y):
    """x + y."""
    return down(x[0] + y[0]), up(x[1] + y[1])


@outlined
def subtract(x, y):
    """x − y."""
    return down(x[0] - y[1]), up(x[1] - y[0])


@outlined
def negative(x):
    """−x."""
    return -x[1], -x[0]


@outlined
def multiply(x, y):
    """x y."""
    p, q, r, s = x[0] * y[0], x[0] * y[1], x[1] * y[0], x[1] * y[1]
    return down(min(min(p, q), min(r, s))), up(max(max(p, q), max(r, s)))


@outlined
def scaled(x, c):
    """c x, c a number."""
    p, q = x[0] * c, x[1] * c
    return down(min(p, q)), up(max(p, q))


@outlined
def over(x, y):
    """x/y, y > 0."""
    return down(x[0] / y[1] if x[0] >= 0 else x[0] / y[0]), up(x[1] / y[0] if x[1] >= 0 else x[1] / y[1])


@outlined
def least(x):
    """The least magnitude of numbers in x."""
    return x[0] if x[0] > 0 else (-x[1] if x[1] < 0 else 0.0)


@outlined
def square(x):
    """x²."""
    low, high = least(x), max(abs(x[0]), abs(x[1]))
    return max(down(low * low), 0.0), up(high * high)


@outlined
def product(a, i, j):
    """Product of the intervals in rows i and j of a; of one number with itself if i = j."""
    return square(row(a, i)) if i == j else multiply(row(a, i), row(a, j))


@outlined
def narrowed(a, i, x):
    """Contract the interval in row i of a to what lies in x too. False if nothing does."""
    a[i, 0], a[i, 1] = max(a[i, 0], x[0]), min(a[i, 1], x[1])
    return not a[i, 0] > a[i, 1]


@outlined
def root_down(x):
    """√x from below."""
    return max(down(np.sqrt(max(x, 0.0))), 0.0)


@outlined
def unit_down(x, squares):
    """The least x/√(x² + s) with s in ``squares``."""
    if x >= 0:
        h = up(np.sqrt(up(up(x * x) + squares[1])))
        return down(x / h) if h > 0 else -1.0
    h = root_down(down(down(x * x) + squares[0]))
    return max(down(x / h), -1.0) if h > 0 else -1.0


@outlined
def unit(x, squares):
    """x/√(x² + s) with s in ``squares``, which is within [−1, 1]."""
    return unit_down(x[0], squares), -unit_down(-x[1], squares)


@outlined
def cross(a, p, b, q, r):
    """Component r of the product of the vectors in the rows p, p + 1, p + 2 of a, and q, q + 1, q + 2 of b."""
    i, j = (r + 1) % 3, (r + 2) % 3
    return subtract(multiply(row(a, p + i), row(b, q + j)), multiply(row(a, p + j), row(b, q + i)))


@outlined
def arctangent(x):
    """atan x, for x >= 0 below 1e100."""
    low, high = x
    for _ in range(3):  # x/(1 + √(1 + x²)) increases
        bottom, top = up(1 + up(np.sqrt(up(1 + up(low * low))))), down(1 + root_down(down(1 + down(high * high))))
        low, high = max(down(low / bottom), 0.0), min(up(high / top), 1.0)
    return max(down(8 * series(low)[0]), 0.0), up(8 * series(high)[1])


@outlined
def series(x):
    """Bounds of atan x for 0 <= x <= tan(π/16)."""
    squared = square((x, x))
    part = 0.0, squared[1]
    for k in range(ARCTANGENT_TERMS, 0, -1):  # s_k = 1/(2k + 1) − x² s_(k+1), with 0 < s < 1
        part = multiply(squared, subtract((down(1 / (2 * k + 1)), up(1 / (2 * k + 1))), part))
    return scaled(subtract((1.0, 1.0), part), x)

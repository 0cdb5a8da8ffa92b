"""Ball arithmetic by python-flint: numbers with a radius that encloses every rounding error.

A comparison of two balls is True only if it is proved: it is possible that neither ``a < b`` nor ``a >= b`` holds.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import cache
from typing import Any

import numpy as np

from cdpr_sim.core import extras

BITS = 106
"""Precision of midpoints: twice a double's, so that 16 digits are left where half of them cancel."""

Ball = Any
"""``flint.arb``, which has no type information."""

Matrix = Any
"""``flint.arb_mat``."""


@contextmanager
def arithmetic(bits: int = BITS) -> Iterator[Any]:
    """The module ``flint`` at a precision, which is restored after the block.

    Raises:
        MissingExtra: python-flint is not installed.
    """
    flint = import_flint()
    with flint.ctx.workprec(bits):
        yield flint


def import_flint() -> Any:
    """The module ``flint``.

    Raises:
        MissingExtra: python-flint is not installed.
    """
    extras.require("proof", "proof")
    import flint

    return flint


def installed() -> bool:
    """Whether proofs can be computed here."""
    return not extras.missing("proof")


@cache
def _types() -> tuple[Any, Any]:
    """The classes of balls and their matrices; an import statement in ``exact`` would take longer than its work."""
    from flint import arb, arb_mat

    return arb, arb_mat


def exact(value: float) -> Ball:
    """A double as a ball with radius 0."""
    return _types()[0](float(value))


def balls(values: Sequence[float] | np.ndarray) -> list[Ball]:
    """Doubles as balls of radius 0."""
    return [exact(value) for value in values]


def matrix(rows: Sequence[Sequence[Ball]]) -> Matrix:
    """Rows of balls as a matrix."""
    return _types()[1]([list(row) for row in rows])


def dot(one: Sequence[Ball], other: Sequence[Ball]) -> Ball:
    """Σ aᵢ bᵢ."""
    total = one[0] * other[0]
    for a, b in zip(one[1:], other[1:], strict=True):
        total += a * b
    return total


def lower(ball: Ball) -> float:
    """The largest double that is proved not to exceed the number."""
    value = float(ball.lower())
    return value if exact(value) <= ball.lower() else float(np.nextafter(value, -np.inf))


def upper(ball: Ball) -> float:
    """The smallest double that is proved not to be below the number."""
    value = float(ball.upper())
    return value if exact(value) >= ball.upper() else float(np.nextafter(value, np.inf))


def middle(ball: Ball) -> float:
    """A double near the midpoint; proves nothing."""
    return float(ball.mid())


def hull(one: Ball, other: Ball) -> Ball:
    """A ball that contains both."""
    return one.union(other)


class Jet:
    """A number with its first and second derivatives by three coordinates, in balls.

    Attributes:
        v: the value.
        d: (3,) first derivatives.
        dd: (3, 3) second derivatives.
    """

    __slots__ = ("d", "dd", "v")

    def __init__(self, v: Ball, d: list[Ball], dd: list[list[Ball]]) -> None:
        self.v, self.d, self.dd = v, d, dd

    @classmethod
    def coordinates(cls, values: Sequence[Ball]) -> list[Jet]:
        """The three coordinates themselves."""
        zero, one = exact(0), exact(1)
        return [
            cls(v, [one if i == k else zero for i in range(3)], [[zero] * 3 for _ in range(3)])
            for k, v in enumerate(values)
        ]

    def __add__(self, other: Jet | Ball) -> Jet:
        if not isinstance(other, Jet):
            return Jet(self.v + other, self.d, self.dd)
        rows = zip(self.dd, other.dd, strict=True)
        return Jet(
            self.v + other.v,
            [a + b for a, b in zip(self.d, other.d, strict=True)],
            [[a + b for a, b in zip(*row, strict=True)] for row in rows],
        )

    def __neg__(self) -> Jet:
        return self * exact(-1)

    def __sub__(self, other: Jet | Ball) -> Jet:
        return self + (-other)

    def __mul__(self, other: Jet | Ball) -> Jet:
        if not isinstance(other, Jet):
            return Jet(self.v * other, [a * other for a in self.d], [[a * other for a in row] for row in self.dd])
        d = [self.v * b + other.v * a for a, b in zip(self.d, other.d, strict=True)]
        dd = [
            [
                self.v * other.dd[i][j] + other.v * self.dd[i][j] + self.d[i] * other.d[j] + self.d[j] * other.d[i]
                for j in range(3)
            ]
            for i in range(3)
        ]
        return Jet(self.v * other.v, d, dd)

    def through(self, f: Ball, df: Ball, ddf: Ball) -> Jet:
        """A function of this number, from its value, slope and second derivative."""
        dd = [[ddf * self.d[i] * self.d[j] + df * self.dd[i][j] for j in range(3)] for i in range(3)]
        return Jet(f, [df * a for a in self.d], dd)

    def sqrt(self) -> Jet:
        """√v."""
        root = self.v.sqrt()
        return self.through(root, 1 / (2 * root), -1 / (4 * root * self.v))

    def inverse(self) -> Jet:
        """1/v."""
        one = 1 / self.v
        return self.through(one, -one * one, 2 * one * one * one)

    def angle(self, cosine: Jet) -> Jet:
        """atan2(self, cosine): its derivatives are those of the arc tangent of the regular quotient."""
        value = type(self.v).atan2(self.v, cosine.v)
        if self.v * self.v > cosine.v * cosine.v:
            quotient = cosine * self.inverse()
            sign = exact(-1)
        else:
            quotient = self * cosine.inverse()
            sign = exact(1)
        slope = sign / (1 + quotient.v * quotient.v)
        return quotient.through(value, slope, -2 * quotient.v * slope / (1 + quotient.v * quotient.v))

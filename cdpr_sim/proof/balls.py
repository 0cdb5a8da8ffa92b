"""Ball arithmetic by python-flint: numbers with a radius that encloses every rounding error.

A comparison of two balls is True only if it is proved: it is possible that neither ``a < b`` nor ``a >= b`` holds.
Vectors and matrices of balls are NumPy arrays of objects, with NumPy's operators.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from cdpr_sim.core import extras

BITS = 106
"""Precision of midpoints: twice a double's, so that 16 digits are left where half of them cancel."""

Ball = Any
"""``flint.arb``, which has no type information."""

Balls = np.ndarray
"""Array of balls."""


@contextmanager
def arithmetic(bits: int = BITS) -> Iterator[Any]:
    """The module ``flint`` at a precision, which is restored after the block.

    Raises:
        MissingExtra: python-flint is not installed.
    """
    extras.require("proof", "proof")
    import flint

    with flint.ctx.workprec(bits):
        yield flint


@cache
def _types() -> tuple[Any, Any, np.ufunc]:
    """The classes of balls and of their matrices, and the former for each entry of an array.

    Without the cache, the import statement would take longer than the work of ``exact``.
    """
    from flint import arb, arb_mat

    return arb, arb_mat, np.frompyfunc(arb, 1, 1)


def exact(values: ArrayLike) -> Any:
    """Doubles as balls of radius 0: an array, or for one number a ball."""
    ball, _, each = _types()
    return ball(float(values)) if isinstance(values, float | int) else each(np.asarray(values, dtype=float))


def zeros(*shape: int) -> Balls:
    """Array of zeros."""
    return np.full(shape, exact(0))


def within(radius: Any) -> Any:
    """All numbers of at most this magnitude, for each entry: of doubles or balls."""
    return _types()[0](0, 1) * radius


def norm(vector: Balls) -> Ball:
    """The length of a vector."""
    square: Ball = vector @ vector
    return square.sqrt()


def product(one: Balls, other: Balls) -> Balls:
    """The product of a matrix with a matrix or a vector: by Arb, which rounds each entry once."""
    return _array(_matrix(one) * _matrix(other), other.shape)


def solution(matrix: Balls, other: Balls) -> Balls:
    """x with ``matrix`` x = ``other``, a vector or a matrix; nan if the matrix may be singular."""
    try:
        return _array(_matrix(matrix).solve(_matrix(other)), other.shape)
    except ZeroDivisionError:
        return exact(np.full(other.shape, np.nan))


def _matrix(array: Balls) -> Any:
    return _types()[1](array.reshape(len(array), -1).tolist())


def _array(matrix: Any, like: tuple[int, ...]) -> Balls:
    """A matrix as an array with the axes of ``like`` after its rows."""
    return np.array(matrix.tolist(), dtype=object).reshape(matrix.nrows(), *like[1:])


def lower(ball: Ball) -> float:
    """The largest double that is proved not to exceed the number."""
    value = float(ball.lower())
    return value if type(ball)(value) <= ball.lower() else float(np.nextafter(value, -np.inf))


def upper(ball: Ball) -> float:
    """The smallest double that is proved not to be below the number."""
    value = float(ball.upper())
    return value if type(ball)(value) >= ball.upper() else float(np.nextafter(value, np.inf))


def bounds(balls: Balls) -> np.ndarray:
    """Lower and upper bounds of each ball, (2, ...)."""
    return np.array([np.frompyfunc(end, 1, 1)(balls) for end in (lower, upper)], dtype=float)


def middle(ball: Ball) -> float:
    """A double near the midpoint; proves nothing."""
    return float(ball.mid())


def middles(balls: Balls) -> np.ndarray:
    """``middle`` of each ball of an array."""
    return np.array(np.frompyfunc(middle, 1, 1)(balls), dtype=float)


centres = np.frompyfunc(lambda ball: ball.mid(), 1, 1)
"""The midpoint of each ball of an array, as balls of radius 0."""

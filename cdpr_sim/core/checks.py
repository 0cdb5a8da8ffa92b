"""What users give, as arrays that can be right: numbers, finite, of the shape that is expected."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float
from numpy.typing import ArrayLike

from cdpr_sim.core.errors import InvalidInput


def checked_array(field: str, value: ArrayLike, shape: tuple[int | None, ...] | None) -> Float[np.ndarray, "..."]:
    """A fresh float array of ``value``; ``None`` in ``shape`` stands for any length.

    Raises:
        InvalidInput: not numbers, not finite, or of another shape.
    """
    array = as_numbers(field, value)
    if shape is not None and (
        array.ndim != len(shape) or any(want not in (None, have) for want, have in zip(shape, array.shape, strict=True))
    ):
        wanted = "(" + ", ".join("any" if n is None else str(n) for n in shape) + ("," if len(shape) == 1 else "") + ")"
        expected = "a single number" if shape == () else f"shape {wanted}"
        raise InvalidInput(f"{field}: found an array of shape {array.shape}, expected {expected}")
    if not np.isfinite(array).all():
        raise InvalidInput(f"{field}: found {array[~np.isfinite(array)][0]}, expected finite numbers")
    return array


def as_numbers(field: str, value: ArrayLike) -> Float[np.ndarray, "..."]:
    """A fresh float array of ``value``, of any shape, finite or not.

    Raises:
        InvalidInput: not numbers.
    """
    try:
        return np.array(value, dtype=float)
    except (TypeError, ValueError):
        raise InvalidInput(f"{field}: found {value!r}, expected numbers") from None


def positive(field: str, value: ArrayLike, unit: str) -> float:
    """A single number above zero.

    Raises:
        InvalidInput: another.
    """
    number = float(checked_array(field, value, ()))
    if not number > 0:
        raise InvalidInput(f"{field}: found {number:g} {unit}, expected more than 0")
    return number


def whole(field: str, value: object, least: int, most: int | None = None) -> int:
    """A whole number within limits.

    Raises:
        InvalidInput: another.
    """
    limits = f"{least} or more" if most is None else f"{least} to {most}"
    if not isinstance(value, (int, np.integer)) or isinstance(value, bool):
        raise InvalidInput(f"{field}: found {value!r}, expected a whole number, {limits}")
    if not (least <= value and (most is None or value <= most)):
        raise InvalidInput(f"{field}: found {value}, expected {limits}")
    return int(value)


def frozen(array: np.ndarray) -> np.ndarray:
    """The same array, read-only from now on."""
    array.flags.writeable = False
    return array

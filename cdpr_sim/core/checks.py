"""Checks of users' input: finite numbers, arrays of the expected shape, names, paths and types."""

from __future__ import annotations

import os
import reprlib
from collections.abc import Callable, Collection, Iterable, Mapping
from pathlib import Path
from types import NoneType
from typing import Any, get_args

import numpy as np
from jaxtyping import Float
from numpy.typing import ArrayLike

from cdpr_sim.core.errors import InvalidInput, UnknownName

MOST_LENGTH = 1e6
"""[m] The largest coordinate that is accepted: beyond it, double precision does not resolve the stretch of cables."""

LONGEST_NAME = 100
"""Largest number of characters of a name: it is printed in tables, and folders are named after it."""

LONGEST_QUOTE = 150
"""Largest number of characters of a value that a message quotes."""

MOST_THREADS = 1024

LARGEST_COUNT = 2**63 - 1
"""The largest integer of 64 bits."""

FLAG = bool | np.bool_
"""True or False; other values that Python treats as true, such as "no", are not accepted."""

PROGRESS = Callable | None
"""A callback of progress."""

NAMES = {
    bool: "True or False", str: "text", os.PathLike: "a path", Callable: "a function", Mapping: "a mapping",
    NoneType: "None",
}  # fmt: skip
"""Names of types in messages, where their own names are unclear."""


class _Short(reprlib.Repr):
    """A few entries of a long value, an array by its shape, a huge integer by its number of digits."""

    def __init__(self) -> None:
        super().__init__()
        self.maxstring = self.maxother = self.maxlong = 60

    def repr_ndarray(self, array: np.ndarray, level: int) -> str:
        return repr(array.tolist()) if array.size <= self.maxlist else f"an array of shape {array.shape}"

    def repr_int(self, x: int, level: int) -> str:
        digits = int(x.bit_length() * 0.30103) + 1
        return repr(x) if digits <= self.maxlong else f"a number of {digits} digits"


def shown(value: Any) -> str:
    """``value`` as a message quotes it: at most one line."""
    text = " ".join(_Short().repr(value).split())
    return text if len(text) <= LONGEST_QUOTE else f"{text[:LONGEST_QUOTE]}..."


def refuse_unless(kind: Any, **values: Any) -> None:
    """Check that each of ``values`` is of a type, or of one of a union of types.

    Args:
        kind: second argument of ``isinstance``.
        values: by their public names.

    Raises:
        InvalidInput: a value of another type; the message names it.
    """
    for field, value in values.items():
        if not isinstance(value, kind):
            names = [NAMES.get(one) or _with_article(one.__name__) for one in get_args(kind) or (kind,)]
            expected = " or ".join(name for name in names if name != "a bool")
            raise InvalidInput(f"{field}: found {shown(value)}, expected {expected}")


def _with_article(name: str) -> str:
    return name if name.endswith("s") else f"{'an' if name[0] in 'AEIOUaeiou' else 'a'} {name}"


def checked_path(field: str, value: Any) -> Path:
    """A path.

    Raises:
        InvalidInput: neither text nor a path, or characters that no path can have.
    """
    refuse_unless(str | os.PathLike, **{field: value})
    path = Path(value)
    if "\0" in str(path):
        raise InvalidInput(f"{field}: found {shown(str(path))}, expected a path without null characters")
    return path


def listed(field: str, value: Any, what: str = "a list") -> list:
    """The entries of a list, a tuple or any other iterable except bytes.

    Raises:
        InvalidInput: it is not iterable.
    """
    try:
        if not isinstance(value, bytes | bytearray):
            return list(value)
    except TypeError:
        pass
    raise InvalidInput(f"{field}: found {shown(value)}, expected {what}")


def one_of(what: str, name: Any, known: Collection[str], meant: Callable[[str], Iterable[str]] | None = None) -> str:
    """A known name; for an unknown one, ``meant`` gives the suggestions, by default the names with similar spelling.

    Raises:
        UnknownName: the name is unknown, or is not text.
    """
    if not isinstance(name, str) or name not in known:
        text = name if isinstance(name, str) else shown(name)
        raise UnknownName(what, text, known, meant=meant(text) if meant else ())
    return name


def checked_name(field: str, value: Any) -> str:
    """A name that is valid in tables and as the name of a folder.

    Raises:
        InvalidInput: not text, empty, too long, not printable, or with a path separator.
    """
    name = checked_label(field, value)
    if set(name) & {"/", "\\"} or name in {".", ".."}:
        raise InvalidInput(
            f"{field}: found {shown(name)}, expected a name without / and \\, as folders are named after it"
        )
    return name


def checked_label(field: str, value: Any) -> str:
    """A short text that is valid in tables.

    Raises:
        InvalidInput: not text, empty, too long, or not printable.
    """
    if not isinstance(value, str) or not value.strip():
        raise InvalidInput(f"{field}: found {shown(value)}, expected text")
    if len(value) > LONGEST_NAME:
        raise InvalidInput(f"{field}: found {len(value)} characters, expected at most {LONGEST_NAME}")
    if not value.isprintable():
        raise InvalidInput(f"{field}: found {shown(value)}, expected printable characters only")
    return value


def checked_text(field: str, value: Any) -> str:
    """A text of any length, which may have several lines.

    Raises:
        InvalidInput: not text, or not printable.
    """
    if not isinstance(value, str) or not all(one.isprintable() or one in "\n\t\N{NO-BREAK SPACE}" for one in value):
        raise InvalidInput(f"{field}: found {shown(value)}, expected printable text")
    return value


def in_range(field: str, value: Float[np.ndarray, "..."] | float, least: float, most: float, unit: str) -> None:
    """Check that numbers are in the range of real robots and of double precision.

    Args:
        field: name of the field.
        value: a number, or an array with a row for each cable.
        least: smallest accepted number.
        most: largest accepted number.
        unit: unit of all three.

    Raises:
        InvalidInput: a number beyond ``least`` or ``most``.
    """
    numbers = np.asarray(value)
    beyond = ~((numbers >= least) & (numbers <= most))
    if beyond.any():
        where = f" in cable {int(np.argwhere(beyond)[0, 0]) + 1}" if numbers.ndim else ""
        raise InvalidInput(
            f"{field}: found {numbers[beyond].flat[0]:g} {unit}{where}, expected {least:g} to {most:g} {unit}".replace(
                "  ", " "
            ).rstrip()
        )


def refuse_far(field: str, lengths: Float[np.ndarray, "..."]) -> None:
    """Refuse lengths and coordinates beyond any robot; nan passes, since another check refuses it.

    Raises:
        InvalidInput: one beyond ``MOST_LENGTH``.
    """
    most = np.abs(lengths[np.isfinite(lengths)]).max(initial=0.0)
    if most > MOST_LENGTH:
        raise InvalidInput(f"{field}: found {most:g} m, expected at most {MOST_LENGTH:g} m")


def checked_array(field: str, value: ArrayLike, shape: tuple[int | None, ...] | None) -> Float[np.ndarray, "..."]:
    """A new float array of ``value``; ``None`` in ``shape`` stands for any length.

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


def as_numbers(field: str, value: ArrayLike, expected: str = "numbers") -> Float[np.ndarray, "..."]:
    """A new float array of ``value``, of any shape, finite or not.

    Raises:
        InvalidInput: not real numbers: NumPy would convert text and booleans, and drop imaginary parts.
    """
    try:
        array = np.array(value)
        if array.dtype.kind in "fiuO":
            return array.astype(float, copy=False)
    except (TypeError, ValueError, OverflowError, RecursionError):
        pass
    raise InvalidInput(f"{field}: found {shown(value)}, expected {expected}")


def positive(field: str, value: ArrayLike, unit: str) -> float:
    """A single number above zero.

    Raises:
        InvalidInput: any other value.
    """
    number = float(checked_array(field, value, ()))
    if not number > 0:
        raise InvalidInput(f"{field}: found {number:g} {unit}, expected more than 0")
    return number


def from_zero(field: str, value: ArrayLike, most: float = np.inf) -> float:
    """A single number of 0 or more, and at most ``most``.

    Raises:
        InvalidInput: any other value.
    """
    number = float(checked_array(field, value, ()))
    if not 0 <= number <= most:
        limits = "0 or more" if np.isinf(most) else f"0 to {most:g}"
        raise InvalidInput(f"{field}: found {number:g}, expected {limits}")
    return number


def whole(field: str, value: object, least: int, most: int = LARGEST_COUNT) -> int:
    """An integer within limits.

    Raises:
        InvalidInput: any other value.
    """
    limits = f"{least} or more" if most == LARGEST_COUNT else f"{least} to {most}"
    if not isinstance(value, (int, np.integer)) or isinstance(value, bool):
        raise InvalidInput(f"{field}: found {shown(value)}, expected a whole number, {limits}")
    if not least <= value <= most:
        limits = limits if value < least else f"{least} to {most:,}"
        raise InvalidInput(f"{field}: found {shown(value)}, expected {limits}")
    return int(value)


class Frozen:
    """Base of dataclasses whose arrays are read-only, also in copies and after unpickling."""

    def __post_init__(self) -> None:
        self._freeze()

    def _freeze(self) -> None:
        for value in vars(self).values():
            if isinstance(value, np.ndarray):
                value.flags.writeable = False

    def __setstate__(self, state: dict) -> None:
        self.__dict__.update(state)
        self._freeze()


def frozen(array: np.ndarray) -> np.ndarray:
    """The same array, made read-only."""
    array.flags.writeable = False
    return array

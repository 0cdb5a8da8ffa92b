"""Errors of pydantic in the words of this package: the place in the file, the value found and the value expected."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from pydantic import ValidationError

from cdpr_sim.core.checks import shown

EXPECTED = {
    "float_type": "a number", "float_parsing": "a number", "finite_number": "a finite number",
    "int_type": "a whole number", "int_parsing": "a whole number", "int_from_float": "a whole number",
    "int_parsing_size": "a whole number", "bool_type": "true or false", "bool_parsing": "true or false",
    "string_type": "text", "string_unicode": "text", "list_type": "a list", "tuple_type": "a list",
    "dict_type": "keys with values", "model_type": "keys with values", "model_attributes_type": "keys with values",
    "none_required": "no value",
}  # fmt: skip
"""What is expected, by the type of pydantic's error."""


def sentence_of(error: ValidationError, place: Callable[[tuple[int | str, ...]], str]) -> str:
    """The first error; of a value that may have several types, what each of them expects.

    Args:
        error: the error.
        place: writes the path of keys to a value.
    """
    every = error.errors(include_url=False)
    first = every[0]
    where = _keys(first["loc"])
    if first["type"] == "missing":
        return f"{place(where)}: missing"
    alike = dict.fromkeys(expected(one) for one in every if _keys(one["loc"]) == where and one["type"] != "missing")
    return f"{place(where)}: found {shown(first['input'])}, expected {' or '.join(alike)}"


def expected(error: Any) -> str:
    """What one error expects, without the word itself."""
    kind, context = error["type"], error.get("ctx", {})
    if kind == "literal_error":
        return context["expected"]
    if kind in ("too_long", "too_short"):
        count = context["max_length" if kind == "too_long" else "min_length"]
        return f"{'at most' if kind == 'too_long' else 'at least'} {count} entries"
    if kind == "value_error":
        return error["msg"].removeprefix("Value error, ").removeprefix("expected ")
    return EXPECTED.get(kind, "another value")


def _keys(path: tuple[int | str, ...]) -> tuple[int | str, ...]:
    """A path without pydantic's names of types, such as "float" and "tuple[float, ...]"."""
    return tuple(part for part in path if part not in ("float", "str") and "[" not in str(part))

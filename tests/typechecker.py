"""The run-time check of annotations: an int will do for a float, as everywhere in Python."""

import functools
from collections.abc import Callable
from types import FunctionType
from typing import Any

import jaxtyping
from beartype import BeartypeConf, beartype

check = beartype(conf=BeartypeConf(is_pep484_tower=True))

CHECKED = 30
"""Calls of each function that are checked in each test: a search makes thousands of the same shapes, and checking
them all took a third of the time of the tests that search."""

calls: dict[Callable, int] = {}
"""Calls of each function since the test began."""

_jaxtyped: Any = jaxtyping.jaxtyped


def first_calls_checked(decorated: Any = None, **options: Any) -> Any:
    """``jaxtyping.jaxtyped``, of the first calls of each function in each test; of a dataclass, of its ``__init__``."""
    if decorated is None:
        return functools.partial(first_calls_checked, **options)
    if isinstance(decorated, FunctionType):
        return _first_calls(_jaxtyped(decorated, **options), decorated)
    plain = vars(decorated).get("__init__") if isinstance(decorated, type) else None
    checked = _jaxtyped(decorated, **options)
    if plain is not None and checked.__init__ is not plain:
        checked.__init__ = _first_calls(checked.__init__, plain)
    return checked


def _first_calls(checked: Callable, plain: Callable) -> Callable:
    """``checked`` in the first calls of a test, then ``plain``."""

    @functools.wraps(plain)
    def first_checked(*args: Any, **kwargs: Any) -> Any:
        __tracebackhide__ = True
        calls[plain] = number = calls.get(plain, 0) + 1
        return (checked if number <= CHECKED else plain)(*args, **kwargs)

    return first_checked

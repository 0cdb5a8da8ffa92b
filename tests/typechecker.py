"""The run-time check of annotations: an int will do for a float, as everywhere in Python."""

import functools
from collections.abc import Callable
from types import FunctionType
from typing import Any

import jaxtyping
from beartype import BeartypeConf, beartype

check = beartype(conf=BeartypeConf(is_pep484_tower=True))

CHECKED = 10
"""Calls of each function that are checked in each test: a search makes thousands of the same shapes, and checking
them all took a third of the time of the tests that search."""

calls: dict[object, int] = {}
"""Calls of each function since the test began, and definitions of each function within a function."""

_jaxtyped: Any = jaxtyping.jaxtyped


def first_calls_checked(decorated: Any = None, **options: Any) -> Any:
    """``jaxtyping.jaxtyped``, of the first calls of each function in each test; of a dataclass, of its ``__init__``.

    Of a function within a function, the first definitions: to decorate one takes a millisecond.
    """
    if decorated is None:
        return functools.partial(first_calls_checked, **options)
    if isinstance(decorated, FunctionType):
        if "<locals>" in decorated.__qualname__ and not _among_first(decorated.__code__):
            return decorated
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
        return (checked if _among_first(plain) else plain)(*args, **kwargs)

    return first_checked


def _among_first(what: object) -> bool:
    calls[what] = number = calls.get(what, 0) + 1
    return number <= CHECKED

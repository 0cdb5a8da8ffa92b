"""The run-time check of annotations: an int will do for a float, as everywhere in Python."""

import dataclasses
import functools
import threading
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

    To decorate takes milliseconds: a function or dataclass of a module is decorated when it is first called. Of one
    within a function the first definitions of each test are checked; they share what was decorated at the first
    definition of all, at once, since annotations may name what is local there.
    """
    if decorated is None:
        return functools.partial(first_calls_checked, **options)
    if isinstance(decorated, FunctionType):
        if "<locals>" in decorated.__qualname__:
            calls[decorated.__code__] = number = calls.get(decorated.__code__, 0) + 1
            if number > CHECKED:
                return decorated
        return _first_calls(decorated, options)
    if isinstance(decorated, type) and dataclasses.is_dataclass(decorated) and "__init__" in vars(decorated):
        decorated.__init__ = _first_calls(decorated.__init__, options)
        return decorated
    return _jaxtyped(decorated, **options)


def _first_calls(plain: Callable, options: dict[str, Any]) -> Callable:
    """``plain``, checked in the first calls of a test."""
    if "<locals>" in plain.__qualname__:
        place = plain.__module__, plain.__code__
        if place not in _shared:
            _shared[place] = _jaxtyped(_given(plain), **options)
        checked = functools.partial(_lent, _shared[place], plain)
    else:
        decorated = functools.cache(lambda: _jaxtyped(plain, **options))
        checked = lambda *args, **kwargs: decorated()(*args, **kwargs)  # noqa: E731

    @functools.wraps(plain)
    def first_checked(*args: Any, **kwargs: Any) -> Any:
        __tracebackhide__ = True
        so_far = calls.get(plain, 0)
        if so_far >= CHECKED:
            return plain(*args, **kwargs)
        calls[plain] = so_far + 1
        return checked(*args, **kwargs)

    return first_checked


_shared: dict[object, Callable] = {}
"""By module and code of a function within a function: what checks the arguments and results of all its definitions."""

_waiting = threading.local()
"""The definition that is called, until its arguments are checked."""


def _given(first: Callable) -> Callable:
    """A function that looks like ``first``, also to who looks up names of its module, and calls the one that waits."""
    waiting = _waiting

    def definition(*args: Any, **kwargs: Any) -> Any:
        return waiting.definition(*args, **kwargs)

    there = FunctionType(definition.__code__, first.__globals__, closure=definition.__closure__)
    return functools.wraps(first)(there)


def _lent(checked: Callable, definition: Callable, *args: Any, **kwargs: Any) -> Any:
    """The result of a definition, checked by what all its definitions share."""
    _waiting.definition = definition
    return checked(*args, **kwargs)

"""Late compilation: a few elements are interpreted by Python, from the same source that is compiled for more.

Numba takes seconds to compile code that Python interprets in a millisecond or two, and more time to be imported and to
load compiled code. So a ``Kernel`` is interpreted for its first few elements, and compiled when more are evaluated.
Threads that need the same compiled function wait for the first of them; processes do not wait for each other.
"""

from __future__ import annotations

import inspect
import logging
import math
import os
import re
import sys
import threading
import time
from collections.abc import Callable
from contextlib import AbstractContextManager
from functools import cached_property
from typing import Any, NamedTuple, cast

import numpy as np

from cdpr_sim.core import code_cache
from cdpr_sim.core.errors import CdprError
from cdpr_sim.core.locks import holding

FEW = 100
"""Elements that a kernel interprets, in each process: as many as a command or a first try evaluates. At two to four
milliseconds each, that takes as long as to import Numba and to load compiled code, and a thirtieth of compiling."""

PARTS, WHOLE = 1, 2
"""Optimisation levels of LLVM: each function that a kernel calls is compiled separately first, and again within the
kernel. Higher levels take longer to compile, and the kernels are no faster."""

LANES_FROM = 1000
"""Elements from which on they are evaluated eight at a time (``lanes``), of kernels that can. For fewer, loading that
code takes longer than it saves. It is also the least number in a piece that threads evaluate, so that the
pieces of a batch are evaluated as the whole is."""

WIDTH = 8
"""Numbers in ``lanes.Lanes``: as many doubles as an AVX-512 register holds. Sixteen are slower there."""

PATIENCE = 2.0, 60.0
"""Seconds to wait for another thread's import of Numba: after the first a warning is logged, after the second an error
is raised."""

_log = logging.getLogger("cdpr_sim")
_called_by_kernels: list[Callable[[], None]] = []
_cut_off = False

_threads = threading.RLock()
"""Held by the thread that compiles or loads."""


class Compiled:
    """A function as machine code, compiled or loaded at its first use."""

    def __init__(self, what: str, function: Callable, signature: str, **options: Any) -> None:
        """Stores the arguments; nothing is compiled yet.

        Args:
            what: name of the compiled code in messages.
            function: its arguments are those of ``signature``.
            signature: in Numba's notation: "void(int64, float64[::1])".
            options: of ``numba.njit``.
        """
        self._what, self._function, self._signature, self._options = what, function, signature, options
        # Numba names machine code after this: with one name, code that two processes compiled counts as the same code.
        function.__qualname__ = f"{function.__name__}_{_as_name(what)}"
        self._compiled: Any = None

    @property
    def compiled(self) -> Any:
        """Machine code.

        Raises:
            CdprError: this process can compile nothing: it was forked while another thread imported Numba.
            StoreError: machine code can be kept nowhere.
        """
        if self._compiled is None:
            import_numba()
            holding(_threads, self._fetch)
        return self._compiled

    def _fetch(self) -> None:
        if self._compiled is None:
            self._compiled = code_cache.fetch(_as_name(self._what), self._build, self._compile)

    def _compile(self) -> Any:
        _log.warning("cdpr_sim compiles its %s: up to a minute, once on this machine", self._what)
        while _called_by_kernels:
            _called_by_kernels[-1]()  # removed only afterwards: Ctrl-C may interrupt between the two
            _called_by_kernels.pop()
        return self._build()

    def _build(self) -> Any:
        import numba

        return numba.njit(self._signature, cache=True, **self._options)(self._function)


class Kernel(Compiled):
    """A function of one element as a NumPy generalised ufunc: it broadcasts and, compiled, releases the GIL.

    Attributes:
        axes: number of axes that each input has for one element.
    """

    def __init__(
        self, what: str, function: Callable, layout: str, integers: tuple[str, ...] = (),
        lanes: Callable[[], Callable] | None = None, alike: tuple[str, ...] = (), finish: Callable | None = None,
    ) -> None:  # fmt: skip
        """Stores the arguments; nothing is compiled yet.

        Args:
            what: name of the compiled code in messages.
            function: of one element's inputs and results, which it fills in; scalars are arrays of one entry.
            layout: core dimensions in NumPy's notation: "(m,k),(m),()->(m),()".
            integers: names of the integer arguments; all others are floats.
            lanes: makes the code that evaluates ``LANES_FROM`` elements and more, on lanes: of the inputs, each with
                two axes of elements, which may be broadcast; the arrays of a ``lanes.Room``; and the results, which
                have these axes, too, and are to be filled in.
            alike: names of inputs that are the same for all elements, which that code takes without these axes.
            finish: function of this kernel, those inputs and those results, which completes the results.
        """
        super().__init__(what, function, layout)
        self._left, self._lanes, self._alike, self._finish = FEW, lanes, alike, finish
        kinds = ["int64" if name in integers else "float64" for name in inspect.signature(function).parameters]
        core = [re.findall(r"\w+", dims) for dims in re.findall(r"\(.*?\)", layout)]
        arguments, inputs = list(zip(kinds, core, strict=True)), layout.split("->")[0].count("(")
        self._names = list(inspect.signature(function).parameters)[:inputs]
        self._inputs, self._results = arguments[:inputs], arguments[inputs:]
        self.axes = tuple(len(dims) for _, dims in self._inputs)

    def __call__(self, *inputs: Any) -> Any:
        """Evaluate each element: interpreted for the first few, on lanes if there are many, else compiled."""
        if self._compiled is None or self._lanes is not None:
            arrays = zip(map(np.asarray, inputs), self.axes, strict=True)
            loops = [array.shape[: array.ndim - own] for array, own in arrays if array.ndim > own]
            loop = np.broadcast_shapes(*loops) if loops else ()
            count = math.prod(loop)
            if self._lanes is not None and count >= LANES_FROM:
                return self._on_lanes(loop, *inputs)
            if self._compiled is None and count <= self._left:
                self._left -= count
                return self._interpreted(loop, *inputs)
        return self.compiled(*inputs)

    def compiled_for_all(self, *inputs: Any) -> Any:
        """Evaluate all elements on lanes if this kernel can, however few they are, else compiled."""
        if self._lanes is None:
            return self.compiled(*inputs)
        return self._on_lanes(np.shape(inputs[-1])[: -self.axes[-1]], *inputs)

    def _build(self) -> Any:
        import numba

        types = [f"{kind}[{', '.join(':' * len(dims))}]" if dims else kind for kind, dims in self._inputs]
        types += [f"{kind}[{', '.join(':' * len(dims) or ':')}]" for kind, dims in self._results]
        gufunc = numba.guvectorize(self._signature, cache=True)(self._function)
        with _optimised(PARTS):
            gufunc.add(f"void({', '.join(types)})")
        with _optimised(WHOLE):
            return gufunc.build_ufunc().ufunc

    @cached_property
    def _of_many(self) -> Compiled:
        types = []
        for name, (kind, dims) in zip(self._names, self._inputs, strict=True):
            axes = len(dims) + 2 * (name not in self._alike)
            types.append(f"Array({kind}, {axes}, 'A', readonly=True)" if axes else kind)
        types += ["float64[::1]", "uint8[::1]"]
        types += [f"{kind}[{', '.join([*':' * (len(dims) + 1), '::1'])}]" for kind, dims in self._results]
        code, signature = cast(Any, self._lanes)(), f"void({', '.join(types)})"
        return Compiled(f"{self._what}, eight at a time", code, signature, error_model="numpy", nogil=True)

    def _on_lanes(self, loop: tuple[int, ...], *inputs: Any) -> Any:
        import_numba()
        sizes, whole, pieces = {}, [], (math.prod(loop[:-1]), loop[-1])
        for name, value, (kind, dims) in zip(self._names, inputs, self._inputs, strict=True):
            array = np.asarray(value, kind)
            core = array.shape[array.ndim - len(dims) :]
            sizes |= zip(dims, core, strict=True)
            if name not in self._alike:
                array = np.broadcast_to(array, loop + core).reshape(pieces + core)
            whole.append(array if array.ndim else array[()])
        results = [np.empty([*pieces, *(sizes[name] for name in dims)], kind) for kind, dims in self._results]
        self._of_many.compiled(*whole, *memory_of_lanes(sizes["m"]), *results)
        if self._finish is not None:
            self._finish(self, whole, results)
        results = [column.reshape(loop + column.shape[2:]) for column in results]
        return tuple(results) if len(results) > 1 else results[0]

    def _interpreted(self, loop: tuple[int, ...], *inputs: Any) -> Any:
        sizes, elements = {"one": 1}, []
        for value, (kind, dims) in zip(inputs, self._inputs, strict=True):
            array = np.asarray(value, kind)
            shape = array.shape[array.ndim - len(dims) :]
            sizes |= zip(dims, shape, strict=True)
            elements.append(np.broadcast_to(array, loop + shape))
        results = [np.empty([*loop, *(sizes[name] for name in dims or ["one"])], kind) for kind, dims in self._results]
        for at in np.ndindex(*loop):
            self._function(*(array[at] for array in elements), *(array[at] for array in results))
        results = [
            array if dims else array[..., 0][()] for array, (_, dims) in zip(results, self._results, strict=True)
        ]
        return tuple(results) if len(results) > 1 else results[0]


def for_kernels(**options: Any) -> Callable:
    """Decorator of functions that compiled ones call: they stay Python, and are compiled into their callers.

    Args:
        options: options of ``numba.njit``.
    """

    def register(function: Callable) -> Callable:
        _called_by_kernels.append(lambda: compile_as(function, lambda *_: function, **options))
        return function

    return register


inline = for_kernels(forceinline=True)
"""The same for functions whose call would take longer than their work."""

outlined = for_kernels()
"""The same for functions that are rarely called."""


def by_type(default: Callable) -> Any:
    """Decorator like ``inline`` of a function that has another coding for some types of its first argument.

    Those types are named tuples; ``of(Kind)``, an attribute of the result, decorates the coding for them. Compiled, the
    choice has no cost.
    """
    codings: dict[type, Callable] = {}

    def function(first, *others):
        return codings.get(type(first), default)(first, *others)

    def of(*kinds: type) -> Callable:
        def register(coding: Callable) -> Callable:
            codings.update(dict.fromkeys(kinds, coding))
            return coding

        return register

    _called_by_kernels.append(
        lambda: compile_as(
            function, lambda first, *_: codings.get(first.instance_class, default), True, forceinline=True
        )
    )
    cast(Any, function).of = of
    return function


def of_one_number(function: Callable, code: Callable | None = None) -> Callable:
    """Decorator like ``inline`` of functions of numbers or truth values, which ``lanes`` defines for eight.

    Args:
        function: the function.
        code: is compiled in its place, if given.
    """

    def choose(first: Any, *_: Any) -> Callable | None:
        from numba import types

        return (code or function) if isinstance(first, types.Number | types.Boolean) else None

    _called_by_kernels.append(lambda: compile_as(function, choose, forceinline=True))
    return function


@of_one_number
def where(condition, one, other):
    """``one`` where the condition is true, and ``other`` elsewhere; both are evaluated."""
    return one if condition else other


@of_one_number
def nowhere(condition):
    """True if the condition is true of no problem that is being solved: then its consequences need no work."""
    return not condition


class Heap(NamedTuple):
    """Where arrays of numbers are made, one by one; arrays of lanes are made in a ``lanes.Room``.

    width: numbers in an entry.
    """

    width: int


HEAP = Heap(1)


@by_type
def vector(room, length):
    """A vector that is to be filled in."""
    return np.empty(length)


@by_type
def matrix(room, rows, columns):
    """A matrix that is to be filled in."""
    return np.empty((rows, columns))


@by_type
def truths(room, length):
    """A vector of truth values that is to be filled in."""
    return np.empty(length, np.bool_)


def memory_of_lanes(cables: int) -> tuple[np.ndarray, np.ndarray]:
    """Memory of a ``lanes.Room`` for any kernel and so many cables; entries begin at multiples of their size.

    The solver needs 56 entries for each cable and 145, the balance of forces cables² + 49 cables + 54.
    """
    numbers = np.zeros((cables * cables + 64 * cables + 260) * WIDTH)
    return numbers[-(numbers.ctypes.data // 8) % WIDTH :], np.zeros(3 * cables, np.uint8)


def compile_as(function: Callable, choose: Callable, literal: bool = False, **options: Any) -> None:
    """Make Numba compile the function that ``choose`` returns, where a kernel calls ``function``.

    With ``literal``, it knows the values of arguments that are written as numbers.
    """
    from numba.extending import overload

    how: Any = {"error_model": "numpy", "no_cfunc_wrapper": True, **options}
    overload(function, jit_options=how, strict=False, prefer_literal=literal)(choose)


def import_numba() -> None:
    """Import Numba while this thread holds none of our locks: the import may run any module, and wait for its threads.

    Raises:
        CdprError: another thread is importing it, and has not finished or does not exist in this process.
    """
    if _cut_off:
        raise CdprError(
            "compiled code: this process was forked while another thread of its parent imported Numba or compiled, and "
            "can do neither; expected processes that are started by 'spawn' or 'forkserver'"
        )
    begun, said = time.monotonic(), False
    while _being_imported():
        waited = time.monotonic() - begun
        if waited > PATIENCE[0] and not said:
            said = True
            _log.warning("cdpr_sim waits for another thread of process %d, which imports Numba", os.getpid())
        if waited > PATIENCE[1]:
            raise CdprError(
                f"compiled code: another thread of process {os.getpid()} has not finished importing Numba within "
                f"{PATIENCE[1]:g} s; expected `import numba` before threads are started"
            )
        time.sleep(0.01)
    # Numba imports ``coverage`` if there is such a module. A tool that measures coverage is imported already; any other
    # may be a user's script of that name, which would run here, within the import for which its threads wait.
    shielded = not {"coverage", "numba"} & sys.modules.keys()
    try:
        if shielded:
            sys.modules["coverage"] = None  # type: ignore[assignment]
        import numba  # noqa: F401
    finally:
        if shielded:
            sys.modules.pop("coverage", None)


def _being_imported() -> bool:
    return getattr(getattr(sys.modules.get("numba"), "__spec__", None), "_initializing", False)


def _as_name(what: str) -> str:
    return re.sub(r"[^a-z]+", "_", what)


def _optimised(level: int) -> AbstractContextManager:
    """Sets the optimisation level of LLVM within the block."""
    from numba.core import config, registry

    registry.cpu_target.target_context  # noqa: B018  (made now, with the user's own level, which it keeps)
    return code_cache.settings(OPT=type(config.__dict__["OPT"])(level))


def _in_child() -> None:
    """A forked child has only one thread of its parent: another thread's operation never ends there."""
    global _cut_off
    _cut_off |= _being_imported()
    try:
        _threads.release()
    except RuntimeError:  # not our lock: Ctrl-C ended the wait for it
        _cut_off = True


if hasattr(os, "register_at_fork"):
    os.register_at_fork(before=_threads.acquire, after_in_parent=_threads.release, after_in_child=_in_child)

"""Compile late, and once: what a few poses ask for, Python answers by itself, from the same source.

Numba takes seconds to compile what Python works out in a millisecond or two, and longer to be imported and to load what
is compiled. So a ``Kernel`` is interpreted for its first few elements, and compiled for whoever asks for more. Threads
that need the same compiled function wait for the first of them; processes do not wait for each other.
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
from typing import Any

import numpy as np

from cdpr_sim.core import code_cache
from cdpr_sim.core.errors import CdprError

FEW = 10
"""Elements that a kernel answers interpreted, in each process: what a command or a first look asks for."""

PARTS, WHOLE = 1, 2
"""How hard LLVM tries: what a kernel calls is compiled on its own first, and again within the whole. Beyond
these levels compiling takes longer, and the kernels are no faster."""

PATIENCE = 2.0, 60.0
"""Seconds of waiting for another thread's import of Numba: after the first this is said, after the second an error."""

_log = logging.getLogger("cdpr_sim")
_called_by_kernels: list[Callable[[], None]] = []
_cut_off = False

_threads = threading.RLock()
"""Held by the thread that compiles or loads. Taken by ``with`` only: between any other call and what follows it, Ctrl-C
can leave a lock locked for ever."""


class Compiled:
    """A function as machine code, which is compiled or loaded when it is first asked for."""

    def __init__(self, what: str, function: Callable, signature: str, **options: Any) -> None:
        """Compiles nothing.

        Args:
            what: is compiled, in words.
            function: of arguments as ``signature`` says.
            signature: as Numba writes it: "void(int64, float64[::1])".
            options: of ``numba.njit``.
        """
        self._what, self._function, self._signature, self._options = what, function, signature, options
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
            with _threads:
                if self._compiled is None:
                    self._compiled = code_cache.fetch(_as_name(self._what), self._build, self._compile)
        return self._compiled

    def _compile(self) -> Any:
        _log.warning("cdpr_sim compiles its %s: up to half a minute, once on this machine", self._what)
        while _called_by_kernels:
            _called_by_kernels[-1]()  # and only then is it forgotten: Ctrl-C may come between
            _called_by_kernels.pop()
        return self._build()

    def _build(self) -> Any:
        import numba

        return numba.njit(self._signature, cache=True, **self._options)(self._function)


class Kernel(Compiled):
    """A function of one element as a NumPy generalised ufunc: it broadcasts and, compiled, releases the GIL."""

    def __init__(self, what: str, function: Callable, layout: str, integers: tuple[str, ...] = ()) -> None:
        """Compiles nothing.

        Args:
            what: is compiled, in words.
            function: of one element's inputs and results, which it fills in; those without dimensions have one entry.
            layout: their core dimensions as NumPy writes them: "(m,k),(m),()->(m),()".
            integers: the names of those that are whole numbers; all others are floats.
        """
        super().__init__(what, function, layout)
        self._left = FEW
        # Numba names machine code after this: with one name, what two processes compiled is taken for the same code.
        function.__qualname__ = f"{function.__name__}_{_as_name(what)}"
        kinds = ["int64" if name in integers else "float64" for name in inspect.signature(function).parameters]
        core = [re.findall(r"\w+", dims) for dims in re.findall(r"\(.*?\)", layout)]
        arguments, inputs = list(zip(kinds, core, strict=True)), layout.split("->")[0].count("(")
        self._inputs, self._results = arguments[:inputs], arguments[inputs:]

    def __call__(self, *inputs: Any) -> Any:
        """For each element: interpreted while few are asked for, then compiled, or loaded from where that lies."""
        if self._compiled is None:
            pairs = zip(inputs, self._inputs, strict=True)
            loop = np.broadcast_shapes(*(np.shape(value)[: np.ndim(value) - len(dims)] for value, (_, dims) in pairs))
            if math.prod(loop) <= self._left:
                self._left -= math.prod(loop)
                return self._interpreted(loop, *inputs)
        return self.compiled(*inputs)

    def _build(self) -> Any:
        import numba

        types = [f"{kind}[{', '.join(':' * len(dims))}]" if dims else kind for kind, dims in self._inputs]
        types += [f"{kind}[{', '.join(':' * len(dims) or ':')}]" for kind, dims in self._results]
        gufunc = numba.guvectorize(self._signature, cache=True)(self._function)
        with _optimised(PARTS):
            gufunc.add(f"void({', '.join(types)})")
        with _optimised(WHOLE):
            return gufunc.build_ufunc().ufunc

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
    """For functions that compiled ones call: they stay Python, and are compiled into those that call them.

    Args:
        options: of ``numba.njit``.
    """

    def register(function: Callable) -> Callable:
        _called_by_kernels.append(lambda: _register(function, lambda *_: function, **options))
        return function

    return register


inline = for_kernels(forceinline=True)
"""The same where a call would cost more than the work."""

outlined = for_kernels()
"""And for what is rarely called."""


def by_type(alternatives: dict[type, Callable]) -> Callable:
    """One function for several types of named tuples as its first argument; compiled, the choice costs nothing."""

    def function(first, *others):
        return alternatives[type(first)](first, *others)

    _called_by_kernels.append(
        lambda: _register(function, lambda first, *_: alternatives[first.instance_class], forceinline=True)
    )
    return function


def _register(function: Callable, choose: Callable, **options: Any) -> None:
    """Numba compiles what ``choose`` says, where a kernel calls ``function``."""
    from numba.extending import overload

    how: Any = {"error_model": "numpy", "no_cfunc_wrapper": True, **options}
    overload(function, jit_options=how, strict=False)(choose)


def import_numba() -> None:
    """Import Numba, while this thread holds no lock of ours: the import may run any module, and wait for its threads.

    Raises:
        CdprError: another thread imports it, and has not finished or does not exist in this process.
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
                f"compiled code: another thread of process {os.getpid()} has not finished to import Numba within "
                f"{PATIENCE[1]:g} s; expected `import numba` before threads are started"
            )
        time.sleep(0.01)
    # Numba imports ``coverage`` wherever there is one. One that measures has been imported before; any other may be a
    # user's script of that name, which would be run here, within the import that its threads need.
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
    """How hard LLVM tries within the block."""
    from numba.core import config, registry

    registry.cpu_target.target_context  # noqa: B018  (made now, with the user's own level, which it keeps)
    return code_cache.settings(OPT=type(config.__dict__["OPT"])(level))


def _in_child() -> None:
    """A forked child has only one thread of its parent's; what another one was amid, it can neither use nor await."""
    global _cut_off
    _cut_off |= _being_imported()
    try:
        _threads.release()
    except RuntimeError:  # not ours: Ctrl-C ended the wait for it
        _cut_off = True


if hasattr(os, "register_at_fork"):
    os.register_at_fork(before=_threads.acquire, after_in_parent=_threads.release, after_in_child=_in_child)

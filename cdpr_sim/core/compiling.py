"""Late compilation by Numba: a few elements are interpreted by Python, more are compiled, from the same source.

Numba takes seconds to compile code that Python interprets in a millisecond or two, and more time to be imported and to
load compiled code. So a ``Kernel`` is interpreted for its first few elements, and compiled when more are evaluated. The
answers are the same to the last bit. With ``INTERPRETED``, nothing is compiled.

Only Numba's public functions are used: ``njit(cache=True)``, ``numba.extending`` and ``numba.config``, whose CACHE_DIR
is what the environment variable NUMBA_CACHE_DIR sets. Numba's key of cached code is the text of one file, but kernels
consist of several; so each version of the package's sources has its own folder (``place``). Code that cannot be loaded,
say from a truncated file, is removed and compiled anew; where none can be kept, each process compiles.
"""

from __future__ import annotations

import _thread
import functools
import hashlib
import inspect
import logging
import math
import os
import platform
import re
import shutil
import sys
import tempfile
import threading
import time
import warnings
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

from cdpr_sim.core.errors import CdprError
from cdpr_sim.core.locks import holding

INTERPRETED = False
"""Whether Python interprets kernels however many elements they get. For tests, and ``scripts/dev/mutate.py``."""

FEW = 100
"""Elements that a kernel interprets, in each process: as many as a command or a first try evaluates. At two to four
milliseconds each, that takes as long as to import Numba and to load compiled code, and a thirtieth of compiling."""

PIECE = 1000
"""Least number of elements that are worth a thread."""

PATIENCE = 2.0, 60.0
"""Seconds to wait for another thread's import of Numba: after the first a warning is logged, after the second an error
is raised."""

LOADING = 10.0
"""Seconds after which a warning is logged that kept code is not loaded yet. One second suffices on an idle machine, so
Numba may have rejected the code, as that of another date, and compile anew."""

STRIDE = 1016
"""Numbers from one row of a scratch array to the next: as many as a robot may have cables, and an odd number of cache
lines. A constant, so that the compiler knows that rows do not overlap: then it computes two to eight cables at once."""

ROWS = 160
"""Rows of a scratch array; ``cable_kernel`` and ``newton_kernel.memory`` say what they are."""

SOURCES = (
    "core/cable.py", "core/cable_law.py", "core/cable_path.py", "core/checks.py", "core/compiling.py", "core/errors.py",
    "core/locks.py", "core/property.py", "core/status.py", "drawing/style.py", "drawing/video/raycast.py",
    "proof/contraction_kernel.py", "proof/geometry_kernel.py", "proof/interval_kernel.py", "proof/krawczyk_kernel.py",
    "proof/search_kernel.py", "statics/any_cable.py", "statics/balance_kernel.py", "statics/cable_kernel.py",
    "statics/catenary.py", "statics/gufuncs.py", "statics/matrix_kernel.py", "statics/memory_kernel.py",
    "statics/newton_kernel.py", "statics/roots_kernel.py", "statics/stiffness_kernel.py",
)  # fmt: skip
"""Modules that are compiled, and all that they import from this package; a test checks that the list is complete."""

_PACKAGE = Path(__file__).parents[1]
_log = logging.getLogger("cdpr_sim")
_called_by_kernels: list[Callable[[], None]] = []
_own = threading.local()
_threads = threading.RLock()
"""Held by the thread that compiles or loads."""
_cut_off = False


def for_kernels(code: Callable | None = None, **options: Any) -> Callable:
    """Decorator of functions that compiled ones call: they stay Python, and are compiled into their callers.

    Args:
        code: what is compiled in place of a function of arrays.
        options: of ``numba.njit``.
    """

    def register(function: Callable) -> Callable:
        def compile() -> None:
            from numba.extending import overload

            how: Any = {"error_model": "numpy", "no_cfunc_wrapper": True, **options}
            overload(function, jit_options=how, strict=False)(lambda *_: code or function)

        _called_by_kernels.append(compile)
        return function

    return register


inline = for_kernels(forceinline=True)
"""The same for functions whose call would take longer than their work."""

outlined = for_kernels(forceinline=False)
"""The same for longer functions, which are compiled once and not into each of their callers."""


def lent(array):
    """The same array for kernels, which do not count who uses it: their caller owns it. Its numbers are contiguous.

    Numba counts the users of each array by an atomic instruction at each call that gets it and at each assignment; in
    functions that compute for a few nanoseconds, that takes two thirds of the time. An array that a kernel makes itself
    must not be lent, since Numba frees it after its last counted use.
    """
    return array


def _compile_lent() -> None:
    import numba
    from numba.extending import overload

    public: Any = vars(numba)
    carray = public["carray"]
    pointer = public["njit"]("voidptr(voidptr)")(lambda address: address)  # Numba converts an array's address to it

    def at_its_address(array: Any) -> Callable:
        return lambda array: carray(pointer(array.ctypes), array.shape, array.dtype)

    overload(lent, strict=False)(at_its_address)


_called_by_kernels.append(_compile_lent)


def of_one_number(function: Callable) -> Callable:
    """A function of module ``math`` for kernels, also interpreted; where it raises an error, NumPy's result.

    NumPy's functions have code of their own for some processors, with another last digit than the C library's, which
    Numba calls.
    """
    name = function.__name__
    otherwise = getattr(np, f"arc{name[1:]}" if name.startswith("a") else name)

    @for_kernels(lambda x: function(x), forceinline=True)
    def interpreted(x):
        try:
            return np.float64(function(x))
        except (ValueError, OverflowError):
            return otherwise(x)

    return interpreted


class Compiled:
    """A function as machine code, compiled or loaded at its first use.

    Attributes:
        folder: name of the folder where the code is kept.
    """

    def __init__(self, what: str, function: Callable, signature: str, **options: Any) -> None:
        """Stores the arguments; nothing is compiled yet.

        Args:
            what: name of the compiled code in messages.
            function: its arguments are those of ``signature``.
            signature: in Numba's notation: "void(int64, float64[::1])".
            options: of ``numba.njit``.
        """
        self._what, self._function, self._signature, self._options = what, function, signature, options
        self.folder = re.sub(r"[^a-z]+", "_", what)
        self._compiled: Any = None

    @property
    def compiled(self) -> Any:
        """Machine code, as a function with ``inspect_asm`` and what else Numba gives it.

        Raises:
            CdprError: this process can compile nothing: it was forked while another thread imported Numba.
        """
        if INTERPRETED:
            return self._function
        if self._compiled is None:
            import_numba()
            _uninterrupted(functools.partial(holding, _threads, self._fetch))
        return self._compiled

    def _fetch(self) -> None:
        if self._compiled is not None:
            return
        while _called_by_kernels:
            _called_by_kernels.pop()()
        home = place()
        kept = home and home / self.folder
        try:
            self._compiled = self._build(kept)
        except Exception as error:  # of any kind: pickle, Numba and LLVM read the files
            if not kept or not kept.is_dir():
                raise
            _log.warning("cdpr_sim: the compiled code in %s cannot be used, and is removed: %r", kept, error)
            shutil.rmtree(kept, ignore_errors=True)
            self._compiled = self._build(None if kept.is_dir() else kept)

    def _build(self, kept: Path | None) -> Any:
        """Load the code from a folder, or compile it and keep it there."""
        import numba

        config: Any = vars(numba)["config"]
        if config.DISABLE_JIT:
            return self._function
        ours = {"CACHE_DIR": str(kept or ""), "CACHE_LOCATOR_CLASSES": ""}
        theirs = {name: getattr(config, name) for name in ours if hasattr(config, name)}
        try:
            vars(config).update(ours)
            code: Any = numba.njit(cache=kept is not None, **self._options)(self._function)
        finally:
            vars(config).update(theirs)
        late = "cdpr_sim still loads its %s, or compiles it anew: up to a minute"
        later = threading.Timer(LOADING, _log.warning, (late, self._what))
        if kept and any(kept.glob("*/*.nbc")):
            later.start()
        else:
            _log.warning("cdpr_sim compiles its %s: up to a minute, once on this machine", self._what)
        try:
            code.compile(self._signature)
        except OSError as error:
            if not code.signatures:
                raise
            _log.warning("cdpr_sim: the compiled code cannot be kept in %s: %s", kept, error.strerror or error)
        finally:
            later.cancel()
        code.disable_compile()  # for other types of arguments
        return code


class Kernel(Compiled):
    """A function of many elements at once, which broadcasts and releases Python's lock.

    Its Python function gets all inputs, each with two axes of elements (rows, columns), a scratch array, and the
    results, which have these axes, too, and which it fills in. The numbers of one element are contiguous.

    Attributes:
        axes: number of axes that each input has for one element.
    """

    def __init__(
        self, what: str, function: Callable, layout: str, integers: tuple[str, ...] = (), alike: tuple[str, ...] = ()
    ) -> None:
        """Stores the arguments; nothing is compiled yet.

        Args:
            what: name of the compiled code in messages.
            function: the function; its arguments are the inputs, ``scratch`` and the results.
            layout: core dimensions in NumPy's notation: "(m,k),(m),()->(m),()".
            integers: names of the integer arguments; all others are floats.
            alike: names of inputs that are the same for all elements; the function takes them without axes of elements.
        """
        names = [name for name in inspect.signature(function).parameters if name != "scratch"]
        core = [re.findall(r"\w+", dims) for dims in re.findall(r"\(.*?\)", layout)]
        kinds = [np.dtype("int64" if name in integers else "float64") for name in names]
        arguments = [(kind, dims, name in alike) for name, kind, dims in zip(names, kinds, core, strict=True)]
        inputs = layout.split("->")[0].count("(")
        self._inputs, self._results, self._left = arguments[:inputs], arguments[inputs:], FEW
        self.axes = tuple(len(dims) for _, dims, _ in self._inputs)
        types = []
        for kind, dims, same in self._inputs:
            axes = len(dims) + 2 * (not same)
            types.append(f"Array({kind}, {axes}, 'A', readonly=True)" if axes else str(kind))
        types.append("float64[::1]")
        types += [f"{kind}[{', '.join([*':' * (len(dims) + 1), '::1'])}]" for kind, dims, _ in self._results]
        super().__init__(what, function, f"void({', '.join(types)})", error_model="numpy", nogil=True)

    def __call__(self, *inputs: Any) -> Any:
        """Evaluate each element: interpreted for the first few, else compiled."""
        arrays, shapes, sizes, given = [], set(), {}, []
        for value, (kind, dims, same) in zip(inputs, self._inputs, strict=True):
            array = np.asarray(value, kind)
            before = array.ndim - len(dims)
            if dims and array.strides[before:] != _contiguous(array.shape[before:]):
                array = np.ascontiguousarray(array)
            sizes |= zip(dims, array.shape[before:], strict=True)
            arrays.append(array)
            if before and not same:
                shapes.add(array.shape[:before])
        loop = shapes.pop() if len(shapes) == 1 else np.broadcast_shapes(*shapes)
        pieces = (math.prod(loop[:-1]), loop[-1]) if loop else (1, 1)
        for array, (_, dims, same) in zip(arrays, self._inputs, strict=True):
            before = array.ndim - len(dims)
            shape, core = array.shape[:before], array.shape[before:]
            if same:
                given.append(array if dims else array[()])
            elif shape == loop:
                given.append(array.reshape(pieces + core))
            elif math.prod(shape) == 1:  # without a copy, however many axes there are
                given.append(np.broadcast_to(array.reshape(core), pieces + core))
            else:
                given.append(np.broadcast_to(array, loop + core).reshape(pieces + core))
        results = [np.empty([*pieces, *(sizes[name] for name in dims)], kind) for kind, dims, _ in self._results]
        count = math.prod(loop)
        if INTERPRETED or (self._compiled is None and count <= self._left):
            self._left -= count
            code = self._function
        else:
            code = self.compiled
        code(*given, scratch(), *results)
        results = [column.reshape(loop + column.shape[2:])[()] for column in results]
        return tuple(results) if len(results) > 1 else results[0]


@functools.cache
def _contiguous(shape: tuple[int, ...]) -> tuple[int, ...]:
    """Strides of an array of contiguous numbers of this shape."""
    return np.empty(shape).strides


def scratch() -> np.ndarray:
    """Memory for a kernel, of this thread: rows of ``STRIDE`` numbers."""
    if not hasattr(_own, "scratch"):
        _own.scratch = np.zeros(ROWS * STRIDE)
    return _own.scratch


def place() -> Path | None:
    """The first folder that can be written, for code of this version and processor; None if there is none."""
    return _place(os.environ.get("NUMBA_CACHE_DIR", ""))


@functools.cache
def _place(given: str) -> Path | None:
    mine = hashlib.sha256(str(_PACKAGE).encode()).hexdigest()[:16]
    places = [Path(given) / "cdpr_sim" / mine] if given else []
    places.append(_PACKAGE / "__pycache__" / "compiled")
    home = Path(os.path.expanduser(os.environ.get("XDG_CACHE_HOME") or "~/.cache"))
    if home.is_absolute():  # a relative one is not the user's home
        places.append(home / "cdpr_sim" / mine)
    for one in places:
        folder = one / digest() / compiler()
        with suppress(OSError):
            folder.mkdir(parents=True, exist_ok=True)
            with tempfile.TemporaryFile(dir=folder):
                pass
            for stale in set(one.iterdir()) - {folder.parent}:  # of other sources
                shutil.rmtree(stale, ignore_errors=True)
            return folder
    _log.warning("cdpr_sim: compiled code is kept nowhere: set NUMBA_CACHE_DIR to a folder that can be written")
    return None


@functools.cache
def digest() -> str:
    """Hash of all sources that are compiled."""
    state = hashlib.sha256()
    for name in SOURCES:
        state.update(name.encode() + b"\0" + (_PACKAGE / name).read_bytes())
    return state.hexdigest()[:16]


@functools.cache
def compiler() -> str:
    """Hash of what else decides about machine code: versions of the compiler, its settings, and the processor.

    Numba's own index knows most of them, but two processes of different processors would mix up its files.
    """
    from importlib.metadata import version

    state = [version("numba"), platform.machine(), platform.processor()]
    settings = {name for name in os.environ if name.startswith("NUMBA_")} - {"NUMBA_CACHE_DIR", "NUMBA_NUM_THREADS"}
    state += [f"{name}={os.environ[name]}" for name in sorted(settings)]
    with suppress(OSError):  # of Linux
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
        state += sorted({line for line in lines if line.startswith(("model name", "flags", "Features", "CPU part"))})
    return hashlib.sha256("\n".join(state).encode()).hexdigest()[:16]


def import_numba() -> None:
    """Import Numba while this thread holds none of our locks: the import may run any module, and wait for its threads.

    Raises:
        CdprError: another thread is importing it, and has not finished or does not exist in this process; a setting
            with which LLVM would abort.
    """
    if _cut_off:
        raise CdprError(
            "compiled code: this process was forked while another thread of its parent imported Numba or compiled, and "
            "can do neither; expected processes that are started by 'spawn' or 'forkserver'"
        )
    features = os.environ.get("NUMBA_CPU_FEATURES", "")
    if any(one and one[0] not in "+-" for one in features.split(",")):  # LLVM would abort the process
        raise CdprError(f"compiled code: found NUMBA_CPU_FEATURES={features}, expected '+' or '-' before each feature")
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
        if "numba" not in sys.modules:  # it warns of values that it ignores by the text of a traceback
            warnings.filterwarnings("ignore", "Environment variable 'NUMBA_", RuntimeWarning)
        import numba  # noqa: F401
    except Exception as error:
        given = ", ".join(f"{name}={os.environ[name]}" for name in os.environ if name.startswith("NUMBA_")) or "none"
        raise CdprError(
            f"compiled code: Numba cannot be imported: {error}; expected that `import numba` works, also with the "
            f"environment variables of Numba that are set: {given}"
        ) from error
    finally:
        if shielded:
            sys.modules.pop("coverage", None)


def _uninterrupted(function: Callable[[], None]) -> None:
    """Call a function in a thread of its own and wait for it: Ctrl-C ends the wait alone, and the function goes on.

    Numba that is interrupted while it loads its own functions has lost some of them for the rest of the process.
    """
    ended, errors = threading.Lock(), []
    ended.acquire()

    def run() -> None:
        try:
            function()
        except BaseException as error:
            errors.append(error)
        finally:
            ended.release()

    _thread.start_new_thread(run, ())  # threading's threads are started and joined by code that Ctrl-C breaks
    ended.acquire()
    if errors:
        raise errors[0]


def _being_imported() -> bool:
    return getattr(getattr(sys.modules.get("numba"), "__spec__", None), "_initializing", False)


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

"""Compile late, and once: what a few poses ask for, Python answers by itself, from the same source.

Numba takes seconds to compile what Python works out in a millisecond or two, and longer to be imported and to load what
is compiled. So a ``Kernel`` is interpreted for its first few elements, and compiled for whoever asks for more.

Whoever comes first compiles: threads and processes that need the same compiled function wait for each other.

Numba keeps compiled code on disk without a lock between processes, and a test run that compiled the same functions in
two processes at once has left a cache from which every later run crashed. So the first compilation, or loading, of a
function happens under a lock that all processes of one user and one installation share.

Numba's own key to that cache is the text of one file, while our kernels are made of several and compile in constants of
others. So each version of the package's sources gets a folder of its own: stale machine code is never loaded.
"""

from __future__ import annotations

import functools
import gc
import hashlib
import inspect
import logging
import math
import os
import re
import shutil
import stat
import tempfile
import threading
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext, suppress
from pathlib import Path
from typing import Any

import numpy as np
from filelock import FileLock

from cdpr_sim.core.errors import StoreError

FEW = 10
"""Elements that a kernel answers interpreted, in each process: what a command or a first look asks for."""

PARTS, WHOLE = 1, 2
"""How hard LLVM tries: what a kernel calls is compiled on its own first, and again within the whole. Beyond
these levels compiling takes longer, and the kernels are no faster."""

SOURCES = (
    "core/cable.py", "core/cable_law.py", "core/cable_path.py", "core/checks.py", "core/compiling.py",
    "core/errors.py", "core/status.py", "drawing/style.py", "drawing/video/raycast.py", "proof/search_kernel.py",
    "statics/balance_kernel.py",
    "statics/cable_kernel.py", "statics/catenary.py", "statics/heavy_kernel.py", "statics/matrix_kernel.py",
    "statics/newton_kernel.py", "statics/stiffness_kernel.py",
)  # fmt: skip
"""What is compiled, and all that it imports from this package; a test keeps the list whole."""

_PACKAGE = Path(__file__).parents[1]
_log = logging.getLogger("cdpr_sim")
_threads = threading.RLock()
_ready: set[str] = set()
_inherited: list[object] = []
_called_by_kernels: list[Callable[[], None]] = []


@contextmanager
def first_use(name: str) -> Iterator[None]:
    """Hold others back while the block compiles or loads what is called ``name``; free of charge from then on."""
    if name in _ready:
        yield
        return
    with _threads, _process_lock(), _cache(), _announced(name):
        yield
        _ready.add(name)


class Kernel:
    """A function of one element as a NumPy generalised ufunc: it broadcasts and, compiled, releases the GIL."""

    def __init__(self, what: str, function: Callable, layout: str, integers: tuple[str, ...] = ()) -> None:
        """Compiles nothing.

        Args:
            what: is compiled, in words.
            function: of one element's inputs and results, which it fills in; those without dimensions have one entry.
            layout: their core dimensions as NumPy writes them: "(m,k),(m),()->(m),()".
            integers: the names of those that are whole numbers; all others are floats.
        """
        self._what, self._function, self._layout, self._left = what, function, layout, FEW
        # Numba names machine code after this: with one name, what two processes compiled is taken for the same code.
        function.__qualname__ = f"{function.__name__}_{re.sub(r'[^a-z]+', '_', what)}"
        kinds = ["int64" if name in integers else "float64" for name in inspect.signature(function).parameters]
        core = [re.findall(r"\w+", dims) for dims in re.findall(r"\(.*?\)", layout)]
        arguments, inputs = list(zip(kinds, core, strict=True)), layout.split("->")[0].count("(")
        self._inputs, self._results = arguments[:inputs], arguments[inputs:]
        self._compiled: Any = None

    def __call__(self, *inputs: Any) -> Any:
        """For each element: interpreted while few are asked for, then compiled, or loaded from where that lies."""
        if self._compiled is None:
            pairs = zip(inputs, self._inputs, strict=True)
            loop = np.broadcast_shapes(*(np.shape(value)[: np.ndim(value) - len(dims)] for value, (_, dims) in pairs))
            if math.prod(loop) <= self._left:
                self._left -= math.prod(loop)
                return self._interpreted(loop, *inputs)
        return self.compiled(*inputs)

    @property
    def compiled(self) -> Any:
        """Machine code: Numba's gufunc."""
        if self._compiled is None:
            with first_use(self._what):
                if self._compiled is None:
                    self._compiled = self._built()
        return self._compiled

    def _built(self) -> Any:
        import numba

        while _called_by_kernels:
            _called_by_kernels.pop()()
        types = [f"{kind}[{', '.join(':' * len(dims))}]" if dims else kind for kind, dims in self._inputs]
        types += [f"{kind}[{', '.join(':' * len(dims) or ':')}]" for kind, dims in self._results]
        gufunc = numba.guvectorize(self._layout, cache=True)(self._function)
        with _optimised(PARTS), _no_collection():
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


def _for_kernels(**options: Any) -> Callable:
    def register(function: Callable) -> Callable:
        _called_by_kernels.append(lambda: _register(function, lambda *_: function, **options))
        return function

    return register


inline = _for_kernels(forceinline=True)
"""For functions that kernels call: Python, and compiled into the kernel, since a call would cost more than the work."""

outlined = _for_kernels()
"""The same for what is rarely called."""


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


def jit(**options: Any) -> Callable:
    """``numba.njit`` whose machine code is kept where that of the kernels is."""
    import numba

    def decorate(function: Callable) -> Callable:
        with _cache():
            return numba.njit(cache=True, **options)(function)

    return decorate


@functools.cache
def digest() -> str:
    """Of all that is compiled: another for every change of the sources."""
    state = hashlib.sha256()
    for name in SOURCES:
        state.update(name.encode() + b"\0" + (_PACKAGE / name).read_bytes())
    return state.hexdigest()[:16]


def _cache() -> AbstractContextManager:
    """Where Numba looks for compiled code, and leaves it, within the block."""
    return _settings(CACHE_DIR=str(_folder()))


def _optimised(level: int) -> AbstractContextManager:
    """How hard LLVM tries within the block."""
    from numba.core import config, registry

    registry.cpu_target.target_context  # noqa: B018  (made now, with the user's own level, which it keeps)
    return _settings(OPT=type(config.__dict__["OPT"])(level))


@contextmanager
def _settings(**ours: Any) -> Iterator[None]:
    """Numba's settings within the block; elsewhere they are as the user has them."""
    from numba.core import config

    before = {name: config.__dict__[name] for name in ours}
    config.__dict__.update(ours)
    try:
        yield
    finally:
        config.__dict__.update(before)


@contextmanager
def _no_collection() -> Iterator[None]:
    """Python looks for no garbage within the block: a tenth of the time, for objects that are nearly all kept."""
    collecting = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if collecting:
            gc.enable()


@contextmanager
def _announced(what: str) -> Iterator[None]:
    """A line for who waits, as soon as Numba compiles within the block; what it only loads is there at once."""
    from numba.core import event

    class Line(event.Listener):
        said = False

        def on_start(self, event: Any) -> None:
            if not self.said:
                self.said = True
                _log.warning("cdpr_sim compiles its %s: some seconds, once on this machine", what)

        def on_end(self, event: Any) -> None:
            pass

    with event.install_listener("numba:run_pass", Line()):
        yield


@functools.cache
def _folder() -> Path:
    """The first of these places that can be written, with a folder for this version; those of others are cleared.

    Raises:
        StoreError: there is none.
    """
    mine = hashlib.sha256(str(_PACKAGE).encode()).hexdigest()[:16]
    given = os.environ.get("NUMBA_CACHE_DIR")
    places = [Path(given) / "cdpr_sim" / mine] if given else []
    home = Path(os.path.expanduser(os.environ.get("XDG_CACHE_HOME") or "~/.cache"))
    places.append(_PACKAGE / "__pycache__" / "compiled")
    if home.is_absolute():  # not where nobody knows whose home it would be
        places.append(home / "cdpr_sim" / mine)
    for place in places:
        folder = place / digest()
        try:
            folder.mkdir(parents=True, exist_ok=True)
            with tempfile.TemporaryFile(dir=folder):
                pass
        except OSError:
            continue
        for stale in place.iterdir():
            if stale != folder:
                shutil.rmtree(stale, ignore_errors=True)
        return folder
    return _temporary_folder(places, mine)


def _temporary_folder(places: list[Path], mine: str) -> Path:
    """A folder of this user's alone, since code is loaded from it; said when it is new, and all is compiled anew."""
    try:
        place = Path(tempfile.gettempdir()) / f"cdpr_sim-{mine}-{_user()}"
        with suppress(FileExistsError):
            place.mkdir(mode=0o700)
        if not _is_ours_alone(place):
            place = Path(tempfile.mkdtemp(prefix="cdpr_sim-"))
        folder = place / digest()
        new = not folder.exists()
        folder.mkdir(exist_ok=True)
    except OSError:
        raise StoreError(
            f"found no folder for compiled code that can be written to (not {', '.join(map(str, places))} either); "
            "expected NUMBA_CACHE_DIR to name one"
        ) from None
    if new:
        _log.warning(
            "cdpr_sim: compiled code is kept in %s: no lasting folder can be written; set NUMBA_CACHE_DIR", place
        )
    return folder


def _is_ours_alone(place: Path) -> bool:
    found = place.lstat()
    mine = not hasattr(os, "getuid") or (found.st_uid == os.getuid() and not found.st_mode & 0o022)
    return mine and stat.S_ISDIR(found.st_mode)


def _user() -> str:
    return str(os.getuid()) if hasattr(os, "getuid") else ""


@functools.cache
def _process_lock() -> AbstractContextManager:
    """Reentrant; one per installation and user, since another user's file could not be locked."""
    home = f"{_PACKAGE}|{os.path.expanduser('~')}|{_user()}"
    try:
        path = Path(tempfile.gettempdir()) / f"cdpr_sim-{hashlib.sha256(home.encode()).hexdigest()[:16]}.lock"
        path.touch()
    except OSError:
        return nullcontext()  # nowhere to put a lock: as good as Numba alone
    return FileLock(path, thread_local=False)


def _begin_anew() -> None:
    """In a child that was forked: locks of the parent's are not the child's, to hold or to release.

    The parent's lock is kept, unused: collected as garbage it would unlock the file that both have open.
    """
    global _threads
    if _process_lock.cache_info().currsize:
        _inherited.append(_process_lock())
        _process_lock.cache_clear()
    _threads = threading.RLock()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_begin_anew)

"""Compile once, whoever comes first: threads and processes that need the same compiled function wait for each other.

Numba keeps compiled code on disk without a lock between processes, and a test run that compiled the same functions in
two processes at once has left a cache from which every later run crashed. So the first compilation, or loading, of a
function happens under a lock that all processes of one user and one installation share.

Numba's own key to that cache is the text of one file, while our kernels are made of several and compile in constants of
others. So each version of the package's sources gets a folder of its own: stale machine code is never loaded.
"""

from __future__ import annotations

import functools
import hashlib
import logging
import os
import shutil
import stat
import tempfile
import threading
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext, suppress
from pathlib import Path
from typing import Any, TypeVar

import numba
from filelock import FileLock
from numba.core import config

from cdpr_sim.core.errors import StoreError

Built = TypeVar("Built")

SOURCES = (
    "core/cable.py", "core/cable_law.py", "core/cable_path.py", "core/checks.py", "core/compiling.py",
    "core/errors.py", "core/status.py", "drawing/style.py", "drawing/video/raycast.py", "statics/balance_kernel.py",
    "statics/cable_kernel.py", "statics/catenary.py", "statics/heavy_kernel.py", "statics/matrix_kernel.py",
    "statics/newton_kernel.py", "statics/stiffness_kernel.py",
)  # fmt: skip
"""What is compiled, and all that it imports from this package; a test keeps the list whole."""

_PACKAGE = Path(__file__).parents[1]
_threads = threading.RLock()
_ready: set[str] = set()
_inherited: list[object] = []


@contextmanager
def first_use(name: str) -> Iterator[None]:
    """Hold others back while the block compiles or loads what is called ``name``; free of charge from then on."""
    if name in _ready:
        yield
        return
    with _threads, _process_lock(), _cache():
        yield
        _ready.add(name)


def built_once(build: Callable[[], Built]) -> Callable[[], Built]:
    """``build``, called at most once in this process and never while another process builds; its result is kept."""
    kept: list[Built] = []

    @functools.wraps(build)
    def get() -> Built:
        if not kept:
            with first_use(f"{build.__module__}.{build.__qualname__}"):
                if not kept:
                    kept.append(build())
        return kept[0]

    return get


def jit(**options: Any) -> Callable:
    """``numba.njit`` whose machine code is kept where that of the kernels is."""

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


@contextmanager
def _cache() -> Iterator[None]:
    """Where Numba looks for compiled code, and leaves it, within the block; elsewhere it is as the user has it."""
    before = config.__dict__["CACHE_DIR"]
    config.__dict__["CACHE_DIR"] = str(_folder())
    try:
        yield
    finally:
        config.__dict__["CACHE_DIR"] = before


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
        logging.getLogger("cdpr_sim").warning(
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

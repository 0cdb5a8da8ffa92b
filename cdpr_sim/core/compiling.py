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
import os
import shutil
import tempfile
import threading
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from pathlib import Path
from typing import TypeVar

from filelock import FileLock
from numba.core import config

Built = TypeVar("Built")

SOURCES = (
    "core/cable.py", "core/cable_path.py", "core/checks.py", "core/compiling.py", "core/errors.py", "core/status.py",
    "drawing/style.py", "drawing/video/raycast.py", "statics/balance_kernel.py", "statics/cable_kernel.py",
    "statics/cable_law.py", "statics/catenary.py", "statics/heavy_kernel.py", "statics/matrix_kernel.py",
    "statics/newton_kernel.py", "statics/stiffness_kernel.py",
)  # fmt: skip
"""What is compiled, and all that it imports from this package; a test keeps the list whole."""

_PACKAGE = Path(__file__).parents[1]
_threads = threading.RLock()
_ready: set[str] = set()


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
    before = vars(config)["CACHE_DIR"]
    vars(config)["CACHE_DIR"] = str(_folder())
    try:
        yield
    finally:
        vars(config)["CACHE_DIR"] = before


@functools.cache
def _folder() -> Path:
    """The first of these places that can be written, with a folder for this version; those of others are cleared."""
    mine = hashlib.sha256(str(_PACKAGE).encode()).hexdigest()[:16]
    given = os.environ.get("NUMBA_CACHE_DIR")
    home = os.environ.get("XDG_CACHE_HOME") or "~/.cache"
    places = [Path(given) / "cdpr_sim" / mine] if given else []
    places += [_PACKAGE / "__pycache__" / "compiled", Path(home).expanduser() / "cdpr_sim" / mine]
    places.append(Path(tempfile.gettempdir()) / f"cdpr_sim-{mine}-{os.getuid() if hasattr(os, 'getuid') else ''}")
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
    return Path(tempfile.mkdtemp(prefix="cdpr_sim-"))


@functools.cache
def _process_lock() -> AbstractContextManager:
    """Reentrant; one per installation and user, since another user's file could not be locked."""
    home = f"{_PACKAGE}|{Path.home()}"
    path = Path(tempfile.gettempdir()) / f"cdpr_sim-{hashlib.sha256(home.encode()).hexdigest()[:16]}.lock"
    try:
        path.touch()
    except OSError:
        return nullcontext()  # nowhere to put a lock: as good as Numba alone
    return FileLock(path, thread_local=False)

"""Compile once, whoever comes first: threads and processes that need the same compiled function wait for each other.

Numba keeps compiled code on disk without a lock between processes, and a test run that compiled the same functions in
two processes at once has left a cache from which every later run crashed. So the first compilation, or loading, of a
function happens under a lock that all processes of one user and one installation share.
"""

from __future__ import annotations

import functools
import hashlib
import tempfile
import threading
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from pathlib import Path
from typing import TypeVar

from filelock import FileLock

Built = TypeVar("Built")

_threads = threading.RLock()
_ready: set[str] = set()


@contextmanager
def first_use(name: str) -> Iterator[None]:
    """Hold others back while the block compiles or loads what is called ``name``; free of charge from then on."""
    if name in _ready:
        yield
        return
    with _threads, _process_lock():
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
def _process_lock() -> AbstractContextManager:
    """Reentrant; one per installation and user, since another user's file could not be locked."""
    home = f"{Path(__file__).parent}|{Path.home()}"
    path = Path(tempfile.gettempdir()) / f"cdpr_sim-{hashlib.sha256(home.encode()).hexdigest()[:16]}.lock"
    try:
        path.touch()
    except OSError:
        return nullcontext()  # nowhere to put a lock: as good as Numba alone
    return FileLock(path, thread_local=False)

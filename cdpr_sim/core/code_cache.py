"""Cache of compiled code on disk: folders that are published complete and never changed afterwards.

Numba's own cache allows two processes to compile the same functions into one folder at the same time; a cache with
files of both crashed every later run. So no process compiles into a folder that others read: it compiles in a private
folder and publishes it by one rename. Processes need no lock and never wait for each other: if two start at the same
time, both compile, and one publishes. A process that cannot use a published folder (another Numba, another processor, a
damaged file) publishes its own under the next number.

The key of Numba's own cache is the text of one file, but our kernels consist of several files and compile in constants
of others. So each version of the package's sources has its own folder: stale machine code is never loaded. Numba's key
also contains the pickled values that a function takes from the one around it, and a pickled function differs between a
process that compiles its module and one that reads the bytecode of it. So Numba's keys leave these values out here.
"""

from __future__ import annotations

import functools
import hashlib
import itertools
import logging
import os
import shutil
import stat
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from cdpr_sim.core.errors import StoreError

SOURCES = (
    "core/cable.py", "core/cable_law.py", "core/cable_path.py", "core/checks.py", "core/code_cache.py",
    "core/compiling.py", "core/errors.py", "core/lanes.py", "core/locks.py", "core/status.py", "drawing/style.py",
    "drawing/video/raycast.py", "proof/contraction_kernel.py", "proof/geometry_kernel.py", "proof/interval_kernel.py",
    "proof/krawczyk_kernel.py", "proof/search_kernel.py", "statics/any_cable.py", "statics/balance_kernel.py",
    "statics/cable_kernel.py", "statics/catenary.py", "statics/gufuncs.py", "statics/lanes_kernel.py",
    "statics/lockstep_kernel.py", "statics/matrix_kernel.py", "statics/memory_kernel.py", "statics/newton_kernel.py",
    "statics/roots_kernel.py", "statics/roots_lanes_kernel.py", "statics/stiffness_kernel.py",
)  # fmt: skip
"""Modules that are compiled, and all that they import from this package; a test checks that the list is complete."""

ABANDONED = 86400.0
"""Age in seconds above which a private folder was left by a killed process."""

_PACKAGE = Path(__file__).parents[1]
_log = logging.getLogger("cdpr_sim")


def fetch(name: str, load: Callable[[], Any], compile: Callable[[], Any]) -> Any:
    """Result of ``load`` from a published folder, or of ``compile`` in a new one, which is then published.

    Args:
        name: name of the folders: letters and underscores.
        load: makes Numba load the code by the same calls as ``compile``; an exception is raised where Numba would begin
            to compile.
        compile: makes Numba compile the code.

    Raises:
        StoreError: there is no folder, or no space in it.
    """
    for number in itertools.count():
        published = folder() / f"{name}-{number}"
        if not published.is_dir():
            return _publish(published, compile)
        try:
            with settings(CACHE_DIR=str(published)), _keys_without_closures(), _no_compilation():
                return load()
        except Exception as error:  # any kind: the compiler would raise it again
            _log.debug("cdpr_sim cannot use %s: %r", published, error)


def _publish(place: Path, compile: Callable[[], Any]) -> Any:
    home = place.parent
    try:
        home.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(prefix=".", dir=home) as private:
            whole = Path(private) / place.name
            with settings(CACHE_DIR=str(whole)), _keys_without_closures():
                result = compile()
            with suppress(OSError):  # another process was first
                whole.rename(place)
        return result
    except OSError as error:
        raise StoreError(
            f"compiled code: cannot be written to {home}: {error.strerror or error}; "
            "expected space, or NUMBA_CACHE_DIR to name another folder"
        ) from None


@contextmanager
def _no_compilation() -> Iterator[None]:
    """Raises an error where Numba would begin to compile within the block, in this thread."""
    from numba.core import event

    here = threading.get_ident()

    class Refusal(event.Listener):
        def on_start(self, event: Any) -> None:
            if threading.get_ident() == here:
                raise LookupError("Numba finds no code for this process there")

        def on_end(self, event: Any) -> None:
            pass

    with event.install_listener("numba:run_pass", Refusal()):
        yield


@contextmanager
def _keys_without_closures() -> Iterator[None]:
    """Numba's keys are signature and processor within the block, in this thread; the folder stands for the function."""
    from numba.core import caching

    cache_class: Any = caching.Cache
    here, whole_key = threading.get_ident(), cache_class._index_key

    def index_key(cache: Any, signature: Any, codegen: Any) -> tuple:
        if threading.get_ident() != here:
            return whole_key(cache, signature, codegen)
        return signature, codegen.magic_tuple()

    cache_class._index_key = index_key
    try:
        yield
    finally:
        cache_class._index_key = whole_key


@contextmanager
def settings(**ours: Any) -> Iterator[None]:
    """Changes Numba's settings within the block; elsewhere they stay as the user set them."""
    from numba.core import config

    before = {name: config.__dict__[name] for name in ours}
    config.__dict__.update(ours)
    try:
        yield
    finally:
        config.__dict__.update(before)


@functools.cache
def digest() -> str:
    """Hash of all sources that are compiled."""
    state = hashlib.sha256()
    for name in SOURCES:
        state.update(name.encode() + b"\0" + (_PACKAGE / name).read_bytes())
    return state.hexdigest()[:16]


@functools.cache
def folder() -> Path:
    """The first place that can be written, with a folder for this version; folders of other versions are removed.

    Raises:
        StoreError: there is none.
    """
    tried = []
    for place in _places(hashlib.sha256(str(_PACKAGE).encode()).hexdigest()[:16]):
        folder = place / digest()
        try:
            folder.mkdir(parents=True, exist_ok=True)
            with tempfile.TemporaryFile(dir=folder):
                pass
        except OSError:
            tried.append(str(place))
            continue
        with suppress(OSError):  # another process may remove them at the same time
            left = {path for path in folder.glob(".*") if path.stat().st_mtime < time.time() - ABANDONED}
            for stale in {*place.iterdir(), *left} - {folder}:
                shutil.rmtree(stale, ignore_errors=True)
        return folder
    raise StoreError(
        f"found no folder for compiled code that can be written to (not {', '.join(tried)} either); "
        "expected NUMBA_CACHE_DIR to name one"
    )


def _places(mine: str) -> Iterator[Path]:
    """Where compiled code may be kept; last a folder of this user's alone, since code is loaded from it."""
    if given := os.environ.get("NUMBA_CACHE_DIR"):
        yield Path(given) / "cdpr_sim" / mine
    yield _PACKAGE / "__pycache__" / "compiled"
    home = Path(os.path.expanduser(os.environ.get("XDG_CACHE_HOME") or "~/.cache"))
    if home.is_absolute():  # a relative one is not the user's home
        yield home / "cdpr_sim" / mine
    with suppress(OSError):
        user = getattr(os, "getuid", str)()
        place = Path(tempfile.gettempdir()) / f"cdpr_sim-{mine}-{user}"
        with suppress(FileExistsError):
            place.mkdir(mode=0o700)
        found = place.lstat()
        if not stat.S_ISDIR(found.st_mode) or (user != "" and (found.st_uid != user or found.st_mode & 0o022)):
            place = Path(tempfile.mkdtemp(prefix="cdpr_sim-"))
        if not (place / digest()).exists():
            _log.warning(
                "cdpr_sim: compiled code is kept in %s: no lasting folder can be written; set NUMBA_CACHE_DIR", place
            )
        yield place

"""MuJoCo's warnings kept out of the terminal and of MUJOCO_LOG.TXT while unstable time steps are tried on purpose."""

# pyright: reportAttributeAccessIssue=false
# mujoco ships no type stubs for its compiled modules.
from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import mujoco

_lock, _before = threading.Lock(), []


@contextmanager
def without_warnings() -> Iterator[None]:
    """The handler of warnings is one for the whole process; the last thread to leave restores the user's."""
    with _lock:
        handler: Any = mujoco.get_mju_user_warning() if not _before else _before[0]
        _before.append(handler)
        mujoco.set_mju_user_warning(lambda message: None)
    try:
        yield
    finally:
        with _lock:
            handler = _before.pop()
            if not _before:
                mujoco.set_mju_user_warning(handler)

"""MuJoCo's warnings, kept out of the terminal and of MUJOCO_LOG.TXT while unstable time steps are tried on purpose."""

# pyright: reportAttributeAccessIssue=false
# mujoco ships no type stubs for its compiled modules.
from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager

import mujoco

from cdpr_sim.core.locks import holding

_lock = threading.RLock()
_users: list[object] = []


@contextmanager
def quiet() -> Iterator[None]:
    """Keep MuJoCo's warnings out of the terminal and MUJOCO_LOG.TXT: they are read from the warning counters instead.

    The handler belongs to the process: the first caller replaces it and the last one restores it.
    """

    def begin() -> None:
        _users.append(mujoco.get_mju_user_warning() if not _users else None)
        mujoco.set_mju_user_warning(lambda message: None)

    def end() -> None:
        previous = _users[0]
        _users.pop()
        if not _users:
            mujoco.set_mju_user_warning(previous)

    holding(_lock, begin)
    try:
        yield
    finally:
        holding(_lock, end)

"""Locks that Ctrl-C does not leave locked."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any


def holding(lock: Any, function: Callable[[], Any]) -> Any:
    """Result of the function, called while this thread holds the ``threading.RLock``.

    Python may raise KeyboardInterrupt after any call. From 3.14 on, that includes the call by which ``with`` acquires a
    lock, before its block begins; so the lock is acquired within ``try``.
    """
    try:
        lock.acquire()
        return function()
    finally:
        try:  # noqa: SIM105  (suppress() would be a call before the release)
            lock.release()
        except RuntimeError:  # Ctrl-C ended the wait for it
            pass

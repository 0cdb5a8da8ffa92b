"""Free memory of the machine, so that a request that cannot fit is refused before the machine runs out of it."""

from __future__ import annotations

import os
from pathlib import Path

from cdpr_sim.core.errors import InvalidInput

CGROUP = Path("/sys/fs/cgroup")
"""Files in which Linux reports the memory limit of a container."""


def available() -> float:
    """Bytes available without swapping: the minimum over machine, container and process; inf if unknown."""
    return min(_of_machine(), _of_container(), _of_process())


def refuse_beyond(what: str, need: float, instead: str) -> None:
    """Refuse a request for more memory than is available.

    Args:
        what: the request, with which the message begins.
        need: estimated memory [bytes].
        instead: what to request instead, with which the message ends.

    Raises:
        InvalidInput: fewer than ``need`` bytes are available.
    """
    free = available()
    if need > free:
        raise InvalidInput(
            f"{what} would take about {describe_size(need)} of memory, and {describe_size(free)} are free; "
            f"expected {instead}"
        )


def describe_size(size: float) -> str:
    """Bytes for people: 3.2 TB."""
    for unit in ("kB", "MB", "GB"):
        size /= 1000
        if size < 1000:
            return f"{size:.3g} {unit}"
    return f"{size / 1000:,.3g} TB" if size < 1e6 else f"{size / 1000:.1e} TB"


def _of_machine() -> float:
    try:
        lines = Path("/proc/meminfo").read_text().splitlines()
        return next(1024.0 * int(line.split()[1]) for line in lines if line.startswith("MemAvailable:"))
    except (OSError, StopIteration, ValueError):
        pass
    try:
        return float(os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES"))
    except (AttributeError, ValueError, OSError):
        return float("inf")


def _of_container() -> float:
    try:
        limit = (CGROUP / "memory.max").read_text().strip()
        return float("inf") if limit == "max" else float(limit) - int((CGROUP / "memory.current").read_text())
    except (OSError, ValueError):
        return float("inf")


def _of_process() -> float:
    try:
        import resource

        limit, _ = resource.getrlimit(resource.RLIMIT_AS)
    except (ImportError, OSError):
        return float("inf")
    return float("inf") if limit == resource.RLIM_INFINITY else float(limit)

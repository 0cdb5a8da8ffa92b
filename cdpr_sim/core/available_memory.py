"""How much memory there is, so that a request that cannot fit is refused before the machine is on its knees."""

from __future__ import annotations

import os
from pathlib import Path

from cdpr_sim.core.errors import InvalidInput

CGROUP = Path("/sys/fs/cgroup")
"""Where Linux says how much memory a container may have."""


def available() -> float:
    """Bytes that can be had without swapping: of the machine, the container, and this process, the least; or inf."""
    return min(_of_machine(), _of_container(), _of_process())


def refuse_beyond(what: str, need: float, instead: str) -> None:
    """See that ``need`` bytes can be had.

    Args:
        what: asks for them, to begin a sentence with.
        need: an estimate [bytes].
        instead: what to ask for, to end the sentence with.

    Raises:
        InvalidInput: they cannot.
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

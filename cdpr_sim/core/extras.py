"""Optional extras of the package: which libraries each installs, and one sentence where one is missing."""

from __future__ import annotations

import sys
from importlib.util import find_spec

from cdpr_sim.core.errors import MissingExtra

_SWEEP = ("xarray", "dask", "zarr", "h5netcdf", "filelock")

LIBRARIES = {
    "sweep": _SWEEP,
    "report": (*_SWEEP, "jinja2"),
    "view": ("glfw", "OpenGL"),
    "video": ("mediapy", "imageio_ffmpeg"),
    "design": ("pymoo",),
    "proof": ("flint",),
    "jax": ("jax",),
    "gym": ("gymnasium",),
}
"""What is imported of each extra of ``pyproject.toml``; ``cluster`` is imported by its users alone."""


def missing(extra: str) -> list[str]:
    """The libraries of an extra that are not installed; none of them is imported."""
    return [
        name for name in LIBRARIES[extra] if (find_spec(name) if name not in sys.modules else sys.modules[name]) is None
    ]


def require(extra: str, work: str) -> None:
    """Refuse ``work`` where a library of its extra is not installed.

    Raises:
        MissingExtra: a sentence that says what to install.
    """
    if absent := missing(extra):
        raise MissingExtra(f'{work}: found no {absent[0]}, expected it installed: pip install "cdpr-sim[{extra}]"')

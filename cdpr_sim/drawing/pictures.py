"""Figures into files: whole or not at all, and never over another file unless asked."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from cdpr_sim.core.errors import InvalidInput
from cdpr_sim.core.files import appearing

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SUFFIXES = {".png", ".svg", ".pdf"}

DPI = 110


def check_target(path: Path, *, force: bool) -> None:
    """Before work begins: whether a picture can go there.

    Raises:
        InvalidInput: no such kind of picture or folder, or a file that is there already.
    """
    if path.suffix not in SUFFIXES:
        raise InvalidInput(f"output: found {path.name!r}, expected a name that ends in .png, .svg or .pdf")
    if not path.parent.is_dir():
        raise InvalidInput(f"output: found no folder {str(path.parent)!r}, expected one that exists")
    if path.exists() and not force:
        raise InvalidInput(f"output: {path} exists; expected a new name, or --force to replace it")


def write(figure: Figure, path: Path) -> None:
    """Save the figure.

    Raises:
        InvalidInput: the file cannot be written; what was there is still there.
    """
    with appearing(path) as (temporary,):
        figure.savefig(temporary, dpi=DPI, format=path.suffix[1:])

"""All figures by name: what each shows, the study that it needs, and writing them whole or not at all."""

from __future__ import annotations

import io
import tempfile
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import matplotlib
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure

from cdpr_sim.studies import tilt_condition as balance, lines_figures as figures, solvers_figures as solver_figures, solvers as solver_studies, lines as studies, two_cable_figures, two_cable as two_cable_studies
from cdpr_sim.drawing import style
from cdpr_sim.robots.catalogue import load_robot
from cdpr_sim.core.errors import InvalidInput, UnknownName
from cdpr_sim.core.files import appearing


@dataclass(frozen=True)
class Picture:
    """A figure that can be asked for by name.

    Attributes:
        paper: the figure of the paper that it redraws, or "" for one of our own.
        shows: what it shows, in a sentence.
        study: computes what it shows.
        draw: draws what ``study`` returns.
    """

    paper: str
    shows: str
    study: Callable[[], Any]
    draw: Callable[[Any], Figure]

    def figure(self) -> Figure:
        """Compute and draw."""
        return self.draw(self.study())


PICTURES: dict[str, Picture] = {
    "two-cable-manifold": Picture(
        "Fig. 3",
        "all poses at which a bar on two cables can rest, and its drift on that surface as the cables soften",
        two_cable_studies.manifold,
        two_cable_figures.manifold,
    ),
    "two-cable-poses": Picture(
        "Fig. 4",
        "the bar as commanded, as it would have to tilt there, and where it rests",
        two_cable_studies.closed_forms,
        two_cable_figures.poses,
    ),
    "two-cable-closed-form": Picture(
        "Eq. 5, 6",
        "the bar's tilt by closed form, solver and MuJoCo, and what the paper's short-bar formula leaves out",
        two_cable_studies.closed_forms,
        two_cable_figures.closed_form,
    ),
    "planar-vertical": Picture(
        "Fig. 7",
        "vertical parallelograms in a plane: poses, tensions, and the zones of one and two slack cables",
        lambda: studies.across_the_width(load_robot("planar-vertical")),
        figures.planar,
    ),
    "planar-horizontal": Picture(
        "Fig. 8",
        "horizontal parallelograms in a plane: no tilt, equal tensions on each side",
        lambda: studies.across_the_width(load_robot("planar-horizontal")),
        figures.planar,
    ),
    "tilt-condition": Picture(
        "Fig. 9",
        "why: the points H and V where the midlines of the pairs meet, and gravity's moment about them",
        balance.moment_balances,
        figures.tilt_condition,
    ),
    "cogiro": Picture(
        "Fig. 10",
        "DemoBot with crossed cables: poses and tensions",
        lambda: studies.across_the_width(load_robot("cogiro"), pose_heights=(0.1,), settled_rows=13),
        figures.spatial,
    ),
    "parallel": Picture(
        "Fig. 11",
        "DemoBot with parallel cables: poses, tensions, and the zones of two and four slack cables",
        lambda: studies.across_the_width(load_robot("parallel"), pose_heights=(0.1,)),
        figures.spatial,
    ),
    "paper-line": Picture(
        "Fig. 12",
        "deviation in z and rotation about y along the paper's line: two layouts, two materials, two heights",
        studies.paper_lines,
        figures.paper_line,
    ),
    "convergence": Picture(
        "",
        "how often and how fast each solver finds rest, against the cables' stiffness",
        solver_studies.convergence,
        solver_figures.convergence,
    ),
    "agreement": Picture(
        "",
        "how far static solver and MuJoCo are apart, over the whole catalogue",
        solver_studies.differences,
        solver_figures.agreement,
    ),
}
"""Every picture by name, in the paper's order."""

KINDS = ("svg", "png")


def list_figures() -> tuple[str, ...]:
    """Names of the figures that ``write_figures`` can write."""
    return tuple(PICTURES)


def write_figures(
    names: Sequence[str], folder: Path, *, kinds: Sequence[str] = KINDS, force: bool = False
) -> Iterator[tuple[str, list[Path]]]:
    """Compute, draw and write figures one by one; yield each one's name and paths when it is there.

    A figure's files are written whole or not at all. Names and places are checked before anything is computed.

    Args:
        names: of ``list_figures()``.
        folder: where <name>.<kind> goes; made if it is not there.
        kinds: "svg", "png" or both.
        force: replace files that are there.

    Raises:
        UnknownName: no such figure, or no such kind of file.
        InvalidInput: a file is there and ``force`` is off, or the folder cannot be written.
    """
    for what, asked, known in (("figure", names, PICTURES), ("kind of file", kinds, KINDS)):
        for name in asked:
            if name not in known:
                raise UnknownName(what, name, known)
    folder = Path(folder)
    targets = {name: [folder / f"{name}.{kind}" for kind in kinds] for name in names}
    existing = [path for paths in targets.values() for path in paths if path.exists()]
    if existing and not force:
        raise InvalidInput(f"{existing[0]}: exists, expected a new place or --force")
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError as error:
        raise _unwritable(folder, error) from None
    return _write(targets)


def _write(targets: dict[str, list[Path]]) -> Iterator[tuple[str, list[Path]]]:
    for name, paths in targets.items():
        figure = PICTURES[name].figure()
        write_whole({path: encoded(figure, path.suffix[1:]) for path in paths})
        yield name, paths


def encoded(figure: Figure, kind: str) -> bytes:
    """The figure as a file's content; the same figure gives the same bytes: no dates, no versions, no random ids."""
    buffer = io.BytesIO()
    with matplotlib.rc_context(style.RC):  # type: ignore[arg-type]
        if kind == "svg":
            FigureCanvasSVG(figure).print_svg(buffer, metadata={"Date": None, "Creator": "cdpr-sim"})
        else:
            figure.set_dpi(style.PNG_DPI)
            FigureCanvasAgg(figure).print_png(buffer, metadata={"Software": "cdpr-sim"})
    return buffer.getvalue()


def write_whole(contents: dict[Path, bytes]) -> None:
    """Write all files beside their places first, then move them there, so that none is ever half there.

    Raises:
        InvalidInput: a place that cannot be written; what was there is still there.
    """
    with appearing(*contents) as temporaries:
        for content, temporary in zip(contents.values(), temporaries, strict=True):
            temporary.write_bytes(content)


def _unwritable(path: Path, error: OSError) -> InvalidInput:
    return InvalidInput(f"{path}: cannot be written: {error.strerror or error}")

"""All figures by name, with their studies, and atomic writing of their files."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

from cdpr_sim.core.checks import FLAG, PROGRESS, checked_path, listed, one_of, refuse_unless
from cdpr_sim.core.files import make_folder, refuse_existing, write_whole
from cdpr_sim.drawing.axes import encoded
from cdpr_sim.robots.catalogue import load_robot
from cdpr_sim.studies import lines, lines_figures, pretension, real_cables, solvers, tilt_condition, two_cable


@dataclass(frozen=True)
class Picture:
    """A figure with a name.

    Attributes:
        paper: the figure of the paper that it redraws, or "".
        shows: its content, in a sentence.
        study: computes its data.
        draw: draws the result of ``study``.
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
        "all equilibria of a bar on two cables, and its drift on that surface with decreasing stiffness",
        two_cable.manifold,
        two_cable.draw_manifold,
    ),
    "two-cable-poses": Picture(
        "Fig. 4",
        "commanded poses of the bar, the tilt of equilibrium at these positions, and its equilibria",
        two_cable.two_cable_bar,
        two_cable.draw_poses,
    ),
    "two-cable-closed-form": Picture(
        "Eq. 5, 6",
        "the bar's tilt by closed form, solver and MuJoCo, and the error of the paper's short-bar formula",
        two_cable.two_cable_bar,
        two_cable.draw_closed_form,
    ),
    "layouts": Picture(
        "Fig. 6",
        "the four layouts: vertical and horizontal parallelograms (planar), vertical ones and crossed cables (spatial)",
        lines.homes,
        lines_figures.layouts,
    ),
    "planar-vertical": Picture(
        "Fig. 7",
        "planar robot with vertical parallelograms: poses, tensions, and the zones of one and two slack cables",
        lambda: lines.across_the_width(load_robot("planar-vertical")),
        lines_figures.planar,
    ),
    "planar-horizontal": Picture(
        "Fig. 8",
        "planar robot with horizontal parallelograms: no tilt, equal tensions on each side",
        lambda: lines.across_the_width(load_robot("planar-horizontal")),
        lines_figures.planar,
    ),
    "tilt-condition": Picture(
        "Fig. 9",
        "cause of the tilt: intersections H and V of the pairs' midlines, and the moment of the weight about them",
        tilt_condition.moment_balances,
        tilt_condition.draw_moment_balances,
    ),
    "cogiro": Picture(
        "Fig. 10",
        "DemoBot with crossed cables: poses and tensions",
        lambda: lines.across_the_width(load_robot("cogiro"), pose_heights=(0.1,), settled_rows=13),
        lines_figures.spatial,
    ),
    "parallel": Picture(
        "Fig. 11",
        "DemoBot with parallel cables: poses, tensions, and the zones of two and four slack cables",
        lambda: lines.across_the_width(load_robot("parallel"), pose_heights=(0.1,)),
        lines_figures.spatial,
    ),
    "paper-line": Picture(
        "Fig. 12",
        "deviation in z and rotation about y along the paper's line: two layouts, two materials, two heights",
        lines.paper_lines,
        lines_figures.paper_line,
    ),
    "convergence": Picture(
        "",
        "success rate and time of each solver over the cables' stiffness",
        solvers.convergence,
        solvers.draw_convergence,
    ),
    "agreement": Picture(
        "",
        "differences between static solver and MuJoCo, for the paper's robots",
        solvers.differences,
        solvers.draw_agreement,
    ),
    "real-cables": Picture(
        "",
        "effect of pulleys, cable mass and nonlinear elasticity on DemoBot and a large crane",
        real_cables.real_cables,
        real_cables.draw_real_cables,
    ),
    "fully-constrained": Picture(
        "",
        "stiffness of IPAnema 1 over pretension, slack cables, and the effect of one length error",
        pretension.pretension,
        pretension.draw_pretension,
    ),
}
"""Every figure by name, in the paper's order."""

KINDS = ("svg", "png")


def list_figures() -> tuple[str, ...]:
    """Names of the figures that ``write_figures`` can write.

    Returns:
        The names that ``write_figures`` and ``cdpr-sim figures`` accept.
    """
    return tuple(PICTURES)


def paths_of(names: Sequence[str], folder: Path, kinds: Sequence[str] = KINDS) -> dict[str, list[Path]]:
    """The files that ``write_figures`` writes, by the name of each figure."""
    return {name: [folder / f"{name}.{kind}" for kind in kinds] for name in names}


def write_figures(
    names: Sequence[str],
    folder: str | Path,
    *,
    kinds: Sequence[str] = KINDS,
    force: bool = False,
    progress: Callable[[float], None] | None = None,
) -> dict[str, list[Path]]:
    """Compute, draw and write figures one by one; return their paths by name.

    A figure's files are written atomically. Names and paths are checked before anything is computed.

    Args:
        names: of ``list_figures()``.
        folder: folder of <name>.<kind>; created if it does not exist.
        kinds: "svg", "png" or both.
        force: whether to replace existing files.
        progress: called after each figure is written, with the fraction done, 0 to 1.

    Returns:
        The paths of each figure's files, by its name.

    Raises:
        UnknownName: no such figure, or no such kind of file.
        InvalidInput: a file exists and ``force`` is false, or the folder cannot be written.
    """
    for what, asked, known in (("figure", names, PICTURES), ("kind of file", kinds, KINDS)):
        for name in listed(f"{what}s", asked, "a list of names"):
            one_of(what, name, known, meant=_of_the_papers if known is PICTURES else None)
    refuse_unless(FLAG, force=force)
    refuse_unless(PROGRESS, progress=progress)
    folder = checked_path("folder", folder)
    places = paths_of(names, folder, kinds)
    refuse_existing((path for paths in places.values() for path in paths), force=force)
    make_folder(folder)
    for done, (name, paths) in enumerate(places.items(), start=1):
        figure = PICTURES[name].figure()
        write_whole({path: encoded(figure, path.suffix[1:]) for path in paths})
        if progress is not None:
            progress(done / len(places))
    return places


def _of_the_papers(name: str) -> list[str]:
    """Figures by their number in the paper: "Fig. 10"."""
    numbers = re.findall(r"\d+", name)
    return [one for one, picture in PICTURES.items() if numbers and re.findall(r"\d+", picture.paper) == numbers]

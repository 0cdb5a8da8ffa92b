"""Draw the figures of the paper anew, and two about the methods: all, or those that are named.

    python scripts/figures/paper_figures.py [NAME...]
    python scripts/figures/paper_figures.py --list

Lines are results of the static solver, points are MuJoCo's. Each figure becomes an SVG and a PNG in the folder
`figures` of the current directory; those that docs/gallery.md shows are also written to pictures/.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

import lines
import lines_figures
import solvers
import tilt_condition
import two_cable
from cdpr_sim.core.errors import CdprError, UnknownName
from cdpr_sim.core.files import write_whole
from cdpr_sim.drawing.figures import encoded
from cdpr_sim.robots.catalogue import load_robot

FOLDER = Path("figures")  # not part of the repository
MANUAL_FOLDER = Path(__file__).parents[2] / "pictures"
GALLERY = MANUAL_FOLDER.parent / "docs" / "gallery.md"


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
}
"""Every figure by name, in the paper's order."""


def write(name: str) -> list[Path]:
    """Compute and draw a figure; return its files, which are written completely or not at all."""
    figure = PICTURES[name].draw(PICTURES[name].study())
    files = [FOLDER / f"{name}.svg", FOLDER / f"{name}.png"]
    if f"paper_figures.py {name}\n" in GALLERY.read_text(encoding="utf-8"):
        files.append(MANUAL_FOLDER / f"{name}.png")
    FOLDER.mkdir(exist_ok=True)
    write_whole({path: encoded(figure, path.suffix[1:]) for path in files})
    return files


def of_the_paper(name: str) -> list[str]:
    """Figures by their number in the paper: "Fig. 10"."""
    numbers = re.findall(r"\d+", name)
    return [one for one, picture in PICTURES.items() if numbers and re.findall(r"\d+", picture.paper) == numbers]


def main(names: list[str]) -> None:
    if names == ["--list"]:
        for name, picture in PICTURES.items():
            print(f"{name:24}{picture.paper:10}{picture.shows}")
        return
    for name in names:
        if name not in PICTURES:
            raise UnknownName("figure", name, PICTURES, meant=of_the_paper(name))
    for name in names or PICTURES:
        print(*write(name), flush=True)


if __name__ == "__main__":
    try:
        main(sys.argv[1:])
    except CdprError as error:
        sys.exit(f"paper_figures: {error}")

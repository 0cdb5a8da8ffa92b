"""Machines that people own, Maslow 4 and Hangprinter 4: stiffness with and without frame flex, tightness, pretension.

Run: python scripts/figures/machines.py. It prints a table and draws pictures/machines.png.
"""

# pyright: reportArgumentType=false, reportAttributeAccessIssue=false, reportCallIssue=false
# matplotlib's stubs know neither keyword dictionaries nor masked arrays.
from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke
from rich.console import Console

import cdpr_sim as cdpr
from cdpr_sim.core.files import write_whole
from cdpr_sim.drawing import style
from cdpr_sim.drawing.figures import canvas, encoded, styled
from cdpr_sim.report.table_style import Sheet, new_table
from robots_on_axes import points

OUTPUT = Path(__file__).parents[2] / "pictures" / "machines.png"

FLEX = 1e-5
"""[m/N] Frame flex at each corner and in each direction, assumed: 1 mm for each 100 N."""

FRAMES = (0.0, FLEX)
"""A rigid frame, and one that gives way."""

MILLIMETRE = 1e-3
"""[m] Error of one length."""

EACH = 33
"""Poses along the longer side of a map."""


@dataclass(frozen=True)
class Machine:
    """What is drawn of a machine.

    Attributes:
        name: in the catalogue.
        axes: the two of the map, of x, y and z.
        lower: corner of the map; its third coordinate is that of the plane [m].
        upper: the other corner [m].
        pretension: of the maps, and the largest of the curves [N].
        force: external, of which the deviation is drawn [N].
        push: what the force is.
        place: of the curves [m].
    """

    name: str
    axes: tuple[int, int]
    lower: tuple[float, float, float]
    upper: tuple[float, float, float]
    pretension: tuple[float, float]
    force: tuple[float, float, float]
    push: str
    place: tuple[float, float, float]

    def robot(self, pretension: float, flex: float) -> cdpr.Robot:
        """The robot, pretensioned, in a frame that gives way by ``flex`` [m/N] in each direction."""
        return cdpr.load_robot(self.name).replace(pretension=pretension or None, exit_compliance=flex)


MACHINES = (
    Machine("maslow-4", (0, 2), (0.1, 0, 0.1), (2.85, 0, 1.95), (150, 300), (0, 0, -50), "50 N down", (1.48, 0, 1.03)),
    Machine(
        "hangprinter-4", (0, 1), (-0.45, -0.45, 0.3), (0.45, 0.45, 0.3), (10, 30), (2, 0, 0), "2 N along x",
        (0.1, 0.1, 0.3),
    ),
)  # fmt: skip


@dataclass(frozen=True, eq=False)
class Answers:
    """Of one machine.

    Attributes:
        machine: the machine.
        positions: of the map, (rows, columns, 3) [m].
        moved: deviation under the force for both ``FRAMES``, (2, rows, columns) [m]; nan where no tensions near the
            pretension hold the platform level.
        tightness: largest increase of a tension if its cable is too short, (rows, columns) [N/m].
        tensions: pretensions of the curves, the first without, (tensions,) [N].
        curves: deviation under the force, for both frames, (2, tensions) [m].
        settled: the same in MuJoCo.
    """

    machine: Machine
    positions: Float[np.ndarray, "rows columns 3"]
    moved: Float[np.ndarray, "2 rows columns"]
    tightness: Float[np.ndarray, "rows columns"]
    tensions: Float[np.ndarray, " tensions"]
    curves: Float[np.ndarray, "2 tensions"]
    settled: Float[np.ndarray, "2 tensions"]


def answers(machine: Machine, each: int = EACH, tensions: int = 13) -> Answers:
    """The maps and curves of a machine.

    Args:
        machine: the machine.
        each: number of poses along the longer side of a map.
        tensions: number of pretensions of the curves.
    """
    lower, upper = np.array(machine.lower), np.array(machine.upper)
    sides = (upper - lower)[list(machine.axes)]
    counts = np.maximum(2, np.round(each * sides / sides.max())).astype(int)
    positions = np.tile(lower, (counts[1], counts[0], 1))
    spans = [np.linspace(lower[axis], upper[axis], count) for axis, count in zip(machine.axes, counts, strict=True)]
    positions[..., list(machine.axes)] = np.stack(np.meshgrid(*spans), axis=-1)
    robots = [machine.robot(machine.pretension[0], flex) for flex in FRAMES]
    moved = np.array([_moved(robot, positions.reshape(-1, 3), machine.force) for robot in robots])
    sizes = np.linspace(0, machine.pretension[1], tensions)
    place = np.array([machine.place])
    curves = [
        [[_moved(machine.robot(size, flex), place, machine.force, method)[0] for size in sizes] for flex in FRAMES]
        for method in (cdpr.solve_many, cdpr.settle_many)
    ]
    return Answers(
        machine, positions, moved.reshape(2, *positions.shape[:-1]),
        _tightness(robots[0], positions.reshape(-1, 3)).reshape(positions.shape[:-1]), sizes, *map(np.array, curves),
    )  # fmt: skip


def _held(robot: cdpr.Robot, positions: Float[np.ndarray, "poses 3"]) -> dict[int, Float[np.ndarray, " cables"]]:
    """Rest lengths for those positions at which tensions near the pretension balance the load, by their numbers."""
    found = {}
    for number, position in enumerate(positions):
        try:
            found[number] = robot.rest_lengths(position)
        except cdpr.InvalidInput:
            continue
    return found


def _moved(robot: cdpr.Robot, positions, force, method=cdpr.solve_many) -> Float[np.ndarray, " poses"]:
    """How far the force moves the platform, with the lengths that hold it without force; nan where there are none."""
    held = _held(robot, positions)
    moved = np.full(len(positions), np.nan)
    if not held:
        return moved
    some, lengths = positions[list(held)], np.array(list(held.values()))
    ends = [method(robot, some, lengths, external_wrench=[*push, 0, 0, 0]).positions for push in (np.zeros(3), force)]
    moved[list(held)] = np.linalg.norm(ends[1] - ends[0], axis=-1)
    return moved


def _tightness(robot: cdpr.Robot, positions) -> Float[np.ndarray, " poses"]:
    """Largest increase of the pull of a cable that is a millimetre too short, over the cables, per metre."""
    held = _held(robot, positions)
    some, lengths = positions[list(held)], np.array(list(held.values()))
    cut = lengths[:, None] - MILLIMETRE * np.eye(robot.cables)  # (poses, cable that is cut, cables)
    before = cdpr.solve_many(robot, some, lengths).tensions
    after = cdpr.solve_many(robot, np.repeat(some[:, None], robot.cables, axis=1), cut).tensions
    rise = np.full(len(positions), np.nan)
    rise[list(held)] = (np.diagonal(after, axis1=1, axis2=2) - before).max(-1) / MILLIMETRE
    return rise


def answers_table(found: Answers) -> Sheet:
    """At the place of the curves: deviation under the force and its share by the frame, over the pretension."""
    machine = found.machine
    x, y, z = machine.place
    table = new_table(
        f"{machine.name} at ({x:g}, {y:g}, {z:g}) m, {machine.push}", "pretension [N]", "moves [mm]",
        "with frame flex [mm]", "MuJoCo differs [mm]",
    )  # fmt: skip
    for size, (rigid, flexible), settled in zip(
        found.tensions, 1e3 * found.curves.T, 1e3 * found.settled.T, strict=True
    ):
        differs = max(abs(settled - (rigid, flexible)))
        table.add_row(f"{size:g}", f"{rigid:.3f}", f"{flexible:.3f}", f"{differs:.1e}")
    return table


@styled
def draw_machines(several: list[Answers]) -> Figure:
    """Maps of the deviation under a force with and without frame flex, and of tightness; deviation over pretension.

    The colours of deviations end at twice the median with frame flex: at the border of a map they grow without limit.
    """
    figure = canvas(
        style.WIDTH,
        12.4,
        "How stiff, how tight: Maslow 4 and Hangprinter 4",
        "Maps: the plane of the sheet, and a horizontal plane 0.3 m above the bed, at 150 N and 10 N; grey where no "
        "tensions near the pretension hold the platform level, or a belt has its dead length alone. Deviation: how far "
        "a force moves the platform. Frame "
        "flex: each corner gives way by 1 mm for each 100 N, an assumption. Tightness: by how much the tension of a "
        "cable rises that is 1 mm too short, the largest of all cables. Curves: statics; points: MuJoCo; at 0 N, "
        "lengths of rigid cables.",
    )
    grid = figure.add_gridspec(4, 2, height_ratios=(1, 1, 1, 0.9))
    for column, found in enumerate(several):
        machine = found.machine
        tension = f"{machine.pretension[0]:g} N pretension"
        most = 2e3 * np.nanmedian(found.moved[1])
        maps = {
            f"{machine.name}: deviation, {machine.push}": (1e3 * found.moved[0], style.MAP_DISTANCE, "mm", most),
            "the same with frame flex": (1e3 * found.moved[1], style.MAP_DISTANCE, "mm", most),
            f"tightness at {tension}": (1e-3 * found.tightness, style.STIFFNESS_MAP, "N/mm", None),
        }
        for row, (title, (values, colors, unit, top)) in enumerate(maps.items()):
            _map(figure.add_subplot(grid[row, column]), found, values, title, colors, unit, top)
        _curves(figure.add_subplot(grid[3, column]), found)
    return figure


def _map(ax: Axes, found: Answers, values, title: str, colors: str, unit: str, top: float | None) -> None:
    across, up = found.machine.axes
    image = ax.pcolormesh(
        found.positions[0, :, across], found.positions[:, 0, up], np.ma.masked_invalid(values), cmap=colors,
        vmin=0 if top else None, vmax=top, shading="nearest",
    )  # fmt: skip
    ax.set_facecolor(style.MAP_UNSOLVED)
    halo = [withStroke(linewidth=3, foreground="white")]
    ax.plot(found.machine.place[across], found.machine.place[up], "+", color=style.INK, ms=8, path_effects=halo)
    ax.set(xlabel=f"{'xyz'[across]} [m]", ylabel=f"{'xyz'[up]} [m]", aspect="equal")
    ax.set_title(title, loc="left")
    ax.figure.colorbar(image, ax=ax, label=f"[{unit}]", extend="max" if top else "neither")


def _curves(ax: Axes, found: Answers) -> None:
    looks = (("rigid frame", style.BLUE, "-"), ("with frame flex", style.VERMILLION, style.DASHES[1]))
    for (label, color, dash), curve, settled in zip(looks, found.curves, found.settled, strict=True):
        ax.plot(found.tensions, 1e3 * curve, color=color, ls=dash, label=label)
        ax.plot(found.tensions[::2], 1e3 * settled[::2], **points(color))
    ax.set(xlabel="pretension [N]", ylabel="deviation [mm]")
    ax.set_ylim(bottom=0)
    ax.set_title(f"at +: {found.machine.push}", loc="left")
    ax.legend()


def main() -> None:
    """Print the tables and draw the figure."""
    found = [answers(machine) for machine in MACHINES]
    console = Console(width=120)
    for one in found:
        console.print(answers_table(one))
    OUTPUT.parent.mkdir(exist_ok=True)
    write_whole({OUTPUT: encoded(draw_machines(found))})
    console.print(f"Wrote {OUTPUT}", soft_wrap=True)


if __name__ == "__main__":
    main()

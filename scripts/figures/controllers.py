"""Compare controllers: both layouts, both cables, the paper's line and a circle, slow and fast, with a wrong model.

    python scripts/figures/controllers.py
    python scripts/figures/controllers.py --ropes

The first takes several minutes on one core, a part of it for compensation at poses that cannot be held. It prints a
table, draws pictures/controllers.png, and renders the best controller along the line beside the worst that stays in the
picture: pictures/controllers.gif. The second prints what friction and hysteresis of the ropes cost each controller.
"""

# pyright: reportArgumentType=false, reportIndexIssue=false
# matplotlib's stubs know neither keyword dictionaries nor grids of axes.
from __future__ import annotations

import dataclasses
import sys
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from rich.console import Console
from rich.progress import Progress
from rich.table import Table

import cdpr_sim as cdpr
from cdpr_sim.core.files import write_whole
from cdpr_sim.core.materials import PAPER_MATERIALS
from cdpr_sim.drawing import style
from cdpr_sim.drawing.figures import canvas, encoded, key, legend_above, styled
from cdpr_sim.report.table_style import new_table
from controller_comparison import (
    ELASTIC,
    ELASTIC_FEEDBACK,
    EXIT_OFF,
    LAYOUTS,
    MIXED,
    PAUSE,
    RIGID,
    RIGID_FEEDBACK,
    ROPES,
    SPEEDS,
    STIFFNESS_BELIEVED,
    TENSIONS,
    RopeTask,
    Run,
    TrackingTask,
    held,
    rms,
    rope_runs,
    runs,
)

FILMED = "line", 0.05  # path, top speed [m/s]
IN_SIGHT = 0.06  # [m] largest distance from the reference; beyond it, a platform leaves the picture
SIZE, SECONDS, FPS = (800, 450), 9.2, 8.0  # pixel, s of video, frames per second
FOLDER = Path(__file__).parents[2] / "pictures"


def runs_table(runs: Sequence[Run]) -> Table:
    """A row for each task and scheme: errors of position and tilt, and tensions."""
    table = new_table(
        "Control schemes with model errors, in MuJoCo",
        "", "mm\nrms", "mm\nmax", "tilt °\nrms", "tilt °\nmax", "N\nlowest", "N\nhighest", dense=True,
    )  # fmt: skip
    robot = task = None
    for run in runs:
        if (run.task.layout, run.task.material) != robot:
            if robot is not None:
                table.add_section()
            robot = run.task.layout, run.task.material
            table.add_row(", ".join(robot), style="bold")
        if run.task != task:
            task = run.task
            table.add_row(f" {task.path}, up to {task.speed:g} m/s")
        errors, tilts = 1e3 * run.position_errors, np.degrees(run.tilts)
        numbers = (rms(errors), errors.max(), rms(tilts), tilts.max(), run.lowest_tension, run.highest_tension)
        table.add_row(f"  {run.scheme}{', falls' if run.fell else ''}", *(f"{number:.2f}" for number in numbers))
    return table


def summary_table(runs: Sequence[Run]) -> Table:
    """A row for each scheme: range of its position errors on each layout at each speed."""
    groups = list(dict.fromkeys((run.task.layout, run.task.speed) for run in runs))
    table = new_table(
        "Position errors [mm], root mean square: range over cables and paths", "",
        *(f"{layout}\n{speed:g} m/s" for layout, speed in groups), dense=True,
    )  # fmt: skip
    for scheme in dict.fromkeys(run.scheme for run in runs):
        cells = []
        for group in groups:
            own = [one for one in runs if one.scheme == scheme and (one.task.layout, one.task.speed) == group]
            errors = [1e3 * rms(one.position_errors) for one in own]
            cells.append(f"{min(errors):.1f} to {max(errors):.1f}" if errors else "")
        table.add_row(scheme, *cells)
    return table


def ropes_table(runs: Sequence[Run]) -> Table:
    """A row for each scheme: its position error on each kind of ropes."""
    table = new_table(
        "Position errors on ropes with a memory [mm], root mean square", "",
        *(ropes.replace(" ", "\n", 1) for ropes in ROPES), dense=True,
    )  # fmt: skip
    for scheme in dict.fromkeys(run.scheme for run in runs):
        errors = {
            run.task.ropes: f"{1e3 * rms(run.position_errors):.3f}{', falls' if run.fell else ''}"
            for run in runs
            if run.scheme == scheme and isinstance(run.task, RopeTask)
        }
        table.add_row(scheme, *(errors.get(ropes, "") for ropes in ROPES))
    return table


COLORS = dict(zip(SPEEDS, (style.BLUE, style.VERMILLION), strict=True))
"""Colours of slow and fast motions."""

ROWS = {
    RIGID: "rigid lengths\n(DemoBot)",
    ELASTIC: "elastic lengths",
    TENSIONS: "tensions\n(force control)",
    MIXED: "lengths on six,\ntensions on two",
    RIGID_FEEDBACK: "rigid lengths,\npose feedback",
    ELASTIC_FEEDBACK: "elastic lengths,\npose feedback",
}
"""Labels of the schemes."""

TITLES = {"cogiro": "crossed cables (cogiro)", "parallel": "parallel cables"}

SPREAD = 0.72
"""Fraction of a row's height used by its runs."""

LEAST = 0.03
"""[N] Position of slack cables on the logarithmic axis."""


@styled
def controllers(runs: Sequence[Run]) -> Figure:
    """Errors of position and tilt, and tensions: a row per scheme, a line per run."""
    figure = canvas(
        style.WIDTH,
        10.0,
        "With model errors, pose feedback reduces the errors more than a better model; no scheme holds poses that "
        "parallel cables cannot hold",
        f"MuJoCo, controllers at 100 Hz. Their model has {STIFFNESS_BELIEVED:.0%} of the true EA and one exit "
        f"{1e3 * EXIT_OFF[0]:g} mm off. Each row: the paper's line and a circle, two cables, two speeds. Errors: point "
        "at the root mean square, line up to the maximum. Tensions: of all cables, slack ones at the left edge. "
        "Sensors: the pose at 100 Hz, 10 ms late, with noise of 0.065 mm and 1 mrad. "
        "Parallel cables can hold the platform level along a third of the line and nowhere on the circle.",
    )
    axes = legend_above(figure, _legend(runs), 6).subgridspec(len(LAYOUTS), 3).subplots(sharey=True, sharex="col")
    for row, layout in zip(axes, LAYOUTS, strict=True):
        own = [one for one in runs if one.task.layout == layout]
        _errors(row[0], own, [1e3 * one.position_errors for one in own])
        _errors(row[1], own, [np.degrees(one.tilts) for one in own])
        _tensions(row[2], own)
        row[0].set_title(TITLES[layout], fontweight="bold")
        row[0].set_yticks(range(len(ROWS)), list(ROWS.values()))
        row[0].set_ylim(len(ROWS) - 0.5, -0.5)
        for ax in row:
            ax.grid(axis="x")
            ax.tick_params(axis="y", length=0)
            for border in range(1, len(ROWS)):
                ax.axhline(border - 0.5, color=style.FAINT, lw=style.HAIR)
    labels = "position error [mm]", "tilt error [°]", "tensions [N], lowest to highest"
    for ax, label in zip(axes[-1], labels, strict=True):
        ax.set_xscale("log")
        ax.xaxis.set_major_formatter("{x:g}")
        ax.set_xlabel(label)
    highest = max(one.highest_tension for one in runs)
    axes[-1, 2].set_xlim(LEAST, 1.3 * highest)
    axes[-1, 2].set_xticks([LEAST, 0.1, 1.0, 10.0], ["slack", "0.1", "1", "10"])
    return figure


def _errors(ax: Axes, runs: Sequence[Run], errors: Sequence[np.ndarray]) -> None:
    for one, values in zip(runs, errors, strict=True):
        height, color, marker = _looks(one, runs)
        ax.plot([rms(values), values.max()], [height] * 2, color=color, lw=1.1, gid=f"range {one.scheme}")
        ax.plot(rms(values), height, **marker, gid=f"rms {one.scheme}")
        if one.fell:
            ax.annotate(" fell", (values.max(), height), color=color, fontsize=7, va="center")


def _tensions(ax: Axes, runs: Sequence[Run]) -> None:
    for one in runs:
        height, color, marker = _looks(one, runs)
        low = max(one.lowest_tension, LEAST)
        ax.plot([low, one.highest_tension], [height] * 2, color=color, lw=1.1, gid=f"tensions {one.scheme}")
        ax.plot(one.highest_tension, height, **marker | {"ms": 4})
        ax.plot(low, height, "|", color=color, ms=4)


def _looks(one: Run, runs: Sequence[Run]) -> tuple[float, str, dict]:
    """Height, colour and marker of a run among the runs of its scheme."""
    likes = [other for other in runs if other.scheme == one.scheme]
    likes.sort(key=lambda other: (other.task.speed, other.task.path, other.task.material))
    height = list(ROWS).index(one.scheme) + SPREAD * ((likes.index(one) + 0.5) / len(likes) - 0.5)
    color = COLORS[one.task.speed]
    marker = "o" if one.task.path == "line" else "s"
    face = "white" if one.task.material == _materials(runs)[-1] else color
    return height, color, {"marker": marker, "color": color, "mfc": face, "mec": color, "ms": 4.5, "ls": "none"}


def _materials(runs: Sequence[Run]) -> list[str]:
    return list(dict.fromkeys(one.task.material for one in runs))


def _legend(runs: Sequence[Run]) -> list[Line2D]:
    stiff, soft = _materials(runs)[0], _materials(runs)[-1]
    marks = {"line": "● ○", "circle": "■ □", stiff: "● ■", soft: "○ □"}  # of both, for the other key
    return [
        *(key(f"up to {speed:g} m/s", color=color, lw=2.2) for speed, color in COLORS.items()),
        *(key(f"{both}  {label}", ls="none") for label, both in marks.items()),
    ]


def titled(run: Run) -> cdpr.Trajectory:
    """The motion after the pause; the robot's name, which is the heading, contains the scheme."""
    motion = run.trajectory
    robot = motion.robot.replace(name=f"{run.task.layout}: {run.scheme}", material=run.task.material)
    rows = np.flatnonzero(run.moving)
    problems = dataclasses.replace(motion.problems.take(rows), robot=robot)
    return cdpr.Trajectory.of(
        problems, motion.times[rows] - PAUSE, motion.poses[rows], motion.lengths[rows], motion.tensions[rows]
    )


def main() -> None:
    console, begun = Console(), time.process_time()
    on_ropes = sys.argv[1:] == ["--ropes"]
    with Progress(console=console, transient=True) as progress:
        task = progress.add_task("Tracking", total=1.0)
        found = (rope_runs if on_ropes else runs)(lambda done: progress.update(task, completed=done))
    if on_ropes:
        console.print(ropes_table(found))
        console.print(f"{len(found)} runs, {time.process_time() - begun:.0f} s of one core")
        return
    console.print(runs_table(found))
    console.print(summary_table(found))
    for layout in LAYOUTS:
        for path in ("line", "circle"):
            part = held(TrackingTask(layout, PAPER_MATERIALS[0], path, 0.5))
            console.print(f"{layout}: the platform can be held level along {part:.0%} of the {path}.")
    console.print(f"{len(found)} runs, {time.process_time() - begun:.0f} s of one core")
    FOLDER.mkdir(exist_ok=True)
    write_whole({FOLDER / "controllers.png": encoded(controllers(found))})
    filmed = sorted(
        (
            one
            for one in found
            if (one.task.path, one.task.speed) == FILMED and one.position_errors.max() < IN_SIGHT and not one.fell
        ),
        key=lambda one: rms(one.position_errors),
    )
    best, worst = filmed[0], filmed[-1]
    pair = [titled(best), titled(worst)]
    cdpr.write_video(FOLDER / "controllers.gif", pair, seconds=SECONDS, fps=FPS, size=SIZE, force=True)
    for one in (best, worst):
        console.print(f"In the video: {one.task.layout}, {one.task.material}, {one.scheme}")


if __name__ == "__main__":
    main()

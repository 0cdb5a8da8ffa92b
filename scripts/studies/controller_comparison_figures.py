"""Figure of the comparison of control schemes. Nothing is computed here."""

# pyright: reportArgumentType=false, reportIndexIssue=false
# matplotlib's stubs know neither keyword dictionaries nor grids of axes.
from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from cdpr_sim.drawing import style
from cdpr_sim.drawing.axes import canvas, styled
from studies.controller_comparison import (
    ELASTIC,
    ELASTIC_FEEDBACK,
    EXIT_OFF,
    LAYOUTS,
    MIXED,
    RIGID,
    RIGID_FEEDBACK,
    SPEEDS,
    STIFFNESS_BELIEVED,
    TENSIONS,
    Run,
    rms,
)

COLORS = dict(zip(SPEEDS, (style.BLUE, style.VERMILLION), strict=True))
"""Colours of slow and fast motions."""

ROWS = {
    RIGID: "rigid lengths\n(DemoBot)",
    ELASTIC: "elastic lengths",
    TENSIONS: "tensions\n(force control)",
    MIXED: "lengths on six cables,\ntensions on two",
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
        12,
        9.2,
        "With model errors, pose feedback reduces the errors more than a better model; no scheme holds poses that "
        "parallel cables cannot hold",
        f"MuJoCo, controllers at 100 Hz. Their model has {STIFFNESS_BELIEVED:.0%} of the true EA and one exit "
        f"{1e3 * EXIT_OFF[0]:g} mm off. Each row: the paper's line and a circle, two cables, two speeds. Errors: point "
        "at the root mean square, line up to the maximum. Tensions: from the lowest to the highest of all cables, "
        "slack ones at the left edge. Sensors: the pose at 100 Hz, 10 ms late, with noise of 0.065 mm and 1 mrad. "
        "Parallel cables can hold the platform level along a third of the line and nowhere on the circle.",
    )
    top, body = figure.add_gridspec(2, 1, height_ratios=(0.03, 1))
    key = figure.add_subplot(top)
    key.set_axis_off()
    key.legend(handles=_legend(runs), loc="center", ncols=6)
    axes = body.subgridspec(len(LAYOUTS), 3).subplots(sharey=True, sharex="col")
    for row, layout in zip(axes, LAYOUTS, strict=True):
        own = [one for one in runs if one.task.layout == layout]
        _errors(row[0], own, [1e3 * one.position_errors for one in own])
        _errors(row[1], own, [np.degrees(one.tilts) for one in own])
        _tensions(row[2], own)
        row[0].set_title(f"{TITLES[layout]}: position")
        row[1].set_title("tilt")
        row[2].set_title("tensions")
        row[0].set_yticks(range(len(ROWS)), list(ROWS.values()))
        row[0].set_ylim(len(ROWS) - 0.5, -0.5)
        for ax in row:
            ax.grid(axis="x")
            ax.tick_params(axis="y", length=0)
            for border in range(1, len(ROWS)):
                ax.axhline(border - 0.5, color=style.FAINT, lw=style.HAIR)
    for ax, label in zip(axes[-1], ("position error [mm]", "tilt error [°]", "tension [N]"), strict=True):
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
    grey = {"color": style.MUTED, "ls": "none", "ms": 5}
    return [
        *(Line2D([], [], color=color, lw=2.2, label=f"up to {speed:g} m/s") for speed, color in COLORS.items()),
        Line2D([], [], marker="o", label="line", **grey),
        Line2D([], [], marker="s", label="circle", **grey),
        Line2D([], [], marker="o", label=stiff, **grey),
        Line2D([], [], marker="o", mfc="white", label=soft, **grey),
    ]

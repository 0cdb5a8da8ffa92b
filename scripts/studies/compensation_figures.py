"""Figure of compensation along a line, before and after. Nothing is computed here."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from cdpr_sim.core.equilibrium import Equilibrium
from cdpr_sim.drawing import style
from studies.compensated_line import CompensatedLine

BEFORE, AFTER, POSITION, OUT_OF_REACH = style.VERMILLION, style.BLUE, style.GREEN, "#f4f1ea"
"""Colours; the last one shades poses that no lengths can hold."""

INK, MUTED, LINE, POINT = style.INK, style.MUTED, style.LINE, style.POINT
SIZE = (8.4, 5.0)


def draw_compensation(lines: Sequence[CompensatedLine]) -> Figure:
    """Errors of position and rotation over the commanded x, before and after compensation: a column per line."""
    figure = Figure(figsize=SIZE, layout="constrained")
    figure.get_layout_engine().set(w_pad=0.08, h_pad=0.05, wspace=0.04, hspace=0.04)  # type: ignore[union-attr]
    axes = figure.subplots(2, len(lines), sharex=True, squeeze=False)
    for column, line in enumerate(lines):
        _panel(axes[0, column], line, "position")
        _panel(axes[1, column], line, "rotation")
        axes[0, column].set_title(line.title, loc="left", fontsize=10, color=INK, pad=9)
        axes[1, column].set_xlabel("commanded x [mm]", color=INK)
    axes[0, 0].set_ylabel("position error [mm]", color=INK)
    axes[1, 0].set_ylabel("rotation error [°]", color=INK)
    entries = {}
    for column in range(len(lines)):
        handles, labels = axes[0, column].get_legend_handles_labels()
        entries |= dict(zip(labels, handles, strict=True))
    figure.legend(
        entries.values(),
        entries.keys(),
        loc="outside lower center",
        ncols=5,
        frameon=False,
        fontsize=8.5,
        columnspacing=1.4,
    )
    return figure


def _power(value: float) -> str:
    """The next power of ten above ``value``."""
    return f"$10^{{{int(np.ceil(np.log10(max(value, 1e-15))))}}}$"


def _panel(axes: Axes, line: CompensatedLine, of: Literal["position", "rotation"]) -> None:
    x = np.array([1e3 * one.commanded.translation[0] for one in line.compensations])
    exact = line.exact

    def errors(results: Sequence[Equilibrium]) -> Float[np.ndarray, " poses"]:
        return 1e3 * line.position_errors(results) if of == "position" else np.degrees(line.rotation_errors(results))

    if not exact.all() and of == "position":
        axes.text(
            0.5, 0.95, "shaded: no cable lengths\nhold the commanded pose", transform=axes.transAxes, ha="center",
            va="top", fontsize=8.5, color=MUTED,
        )  # fmt: skip
    if not exact.all():
        half = np.diff(x).mean() / 2
        for at in x[~exact]:
            axes.axvspan(at - half, at + half, color=OUT_OF_REACH, linewidth=0, zorder=0)
    before, after = errors(line.before), errors(line.after)
    axes.plot(x, before, color=BEFORE, linewidth=LINE, label="rigid lengths")
    axes.plot(x, errors(line.settled_before), "o", color=BEFORE, markersize=POINT, mfc="white", label="… in MuJoCo")
    axes.plot(x, after, color=AFTER, linewidth=LINE, label="compensated lengths", clip_on=False, zorder=3)
    axes.plot(
        x, errors(line.settled_after), "s", color=AFTER, markersize=POINT, mfc="white", label="… in MuJoCo ",
        clip_on=False, zorder=4,
    )  # fmt: skip
    if line.position_only:
        position_only = errors(line.position_only)
        axes.plot(
            x, position_only, color=POSITION, linewidth=LINE, linestyle=(0, (2.2, 1.4)), zorder=2, clip_on=False,
            label="… position only, in MuJoCo",
        )  # fmt: skip
        after = np.append(after, position_only)
    if exact.all():
        worst = max(errors(line.settled_after))
        unit = " mm" if of == "position" else "°"
        axes.annotate(
            f"compensated: at most {_power(worst)}{unit}", (x.mean(), 0), xytext=(0, 11), textcoords="offset points",
            ha="center", fontsize=8.5, color=AFTER,
        )  # fmt: skip
    axes.set_ylim(0, 1.12 * max(before.max(), after.max()))
    axes.set_xlim(x[0] - 12, x[-1] + 12)
    axes.spines[["top", "right"]].set_visible(False)
    axes.spines[["left", "bottom"]].set_color(MUTED)
    axes.tick_params(colors=MUTED, labelcolor=INK, labelsize=8.5)
    axes.grid(axis="y", color="#e6e6e6", linewidth=0.6)
    axes.set_axisbelow(True)

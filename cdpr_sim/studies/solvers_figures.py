"""Figures of solver performance: convergence and time, and the agreement of the two methods."""

# pyright: reportArgumentType=false, reportAttributeAccessIssue=false, reportCallIssue=false
# matplotlib's stubs know neither keyword dictionaries nor the axes of its 3D plots.
from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import FuncFormatter, NullFormatter

from cdpr_sim.core.describe import newtons
from cdpr_sim.crosscheck import compare
from cdpr_sim.drawing import style
from cdpr_sim.drawing.axes import canvas, styled
from cdpr_sim.studies.solvers import Convergence, Differences

NAMES = {
    "newton": ("Newton (ours)", "Newton solves"),
    "fsolve": ("SEECR, fsolve", "fsolve"),
    "least_squares": ("SEECR, least_squares", "least_squares"),
}
"""Names in legends and in the title."""


@styled
def convergence(study: Convergence) -> Figure:
    """Success rate and time of each solver over the cables' stiffness."""
    unstable = int(sum((study.solved[method] - study.stable[method]).sum() for method in study.solved))
    shares = ", ".join(f"{NAMES[one][1]} {100 * n[-1] / study.poses:.0f} %" for one, n in study.solved.items())
    figure = canvas(
        10.5,
        4.7,
        f"With EA = {newtons(study.axial_stiffness[-1])}, {shares} of the poses",
        f"{study.robot.name}: {study.poses} random commanded poses for each of {len(study.axial_stiffness)} "
        "stiffnesses. Solved: forces balance to 1e-6 of the weight; "
        f"{unstable or 'none'} of the solutions {'is' if unstable == 1 else 'are'} unstable. "
        "Time: median per pose, solved or not, with the range from the fastest to the slowest tenth, on the machine "
        "that drew this picture, one pose at a time through the Python interface.",
    )
    left, right = figure.subplots(1, 2)
    looks = {"newton": (style.BLUE, 0), "fsolve": (style.VERMILLION, 1), "least_squares": (style.ORANGE, 2)}
    for method, solved in study.solved.items():
        color, number = looks[method]
        line = {"color": color, "ls": style.DASHES[number], "marker": style.MARKERS[number], "ms": 6}
        left.plot(study.axial_stiffness, 100 * solved / study.poses, label=NAMES[method][0], gid=method, **line)
        milliseconds = 1e3 * study.seconds[method]
        low, middle, high = np.quantile(milliseconds, (0.1, 0.5, 0.9), axis=1)
        shift = 1.06 ** (number - 1)  # so that ranges do not overlap
        right.errorbar(
            study.axial_stiffness * shift, middle, (middle - low, high - middle), capsize=3, gid=method, **line
        )
    right.plot(
        study.axial_stiffness,
        1e3 * study.compiled_seconds,
        color=style.BLUE,
        lw=1.2,
        ls=style.DASHES[3],
        marker="D",
        mfc="white",
        gid="compiled",
    )
    right.annotate(
        "Newton, all poses in one compiled call",
        (study.axial_stiffness[1], 1e3 * study.compiled_seconds[1]),
        (0, 8),
        textcoords="offset points",
        color=style.BLUE,
    )
    left.set(ylim=(-3, 106), ylabel="poses solved [%]", title="success rate")
    right.set(yscale="log", ylabel="time per pose [ms]", title="time")
    right.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    for ax in (left, right):
        ax.set(xscale="log", xlabel="axial stiffness EA [N]")
        ax.grid(axis="y")
    left.legend(loc="lower left")
    return figure


@styled
def agreement(study: Sequence[Differences]) -> Figure:
    """Cumulative distribution of the differences between statics and simulation."""
    poses = sum(len(one.verdicts) for one in study)
    neutral, disagreeing = sum(int(one.neutral.sum()) for one in study), sum(one.disagreeing for one in study)
    agreeing = poses - neutral - disagreeing
    count = f"all {poses}" if agreeing == poses else f"{agreeing} of {poses}"
    verdict = f"agree at {count} poses"
    others = [f"{neutral} are neutrally stable"] * bool(neutral) + [f"at {disagreeing} they disagree"] * bool(
        disagreeing
    )
    crosses = (
        f" Crosses: {neutral} neutrally stable poses, at which the platform hangs on two diagonal cables: it has a "
        "continuum of equilibria about them, and the methods stop at different ones."
        if neutral
        else ""
    )
    figure = canvas(
        10.8,
        4.7,
        "; ".join([f"Statics and simulation, which share no physics code, {verdict}", *others]),
        f"Static solver (Newton) minus MuJoCo at {poses} random commanded poses, both materials; cumulative. Dashed "
        "line: tolerance of the comparison." + crosses,
    )
    panels = (
        ("position_errors", 1.0, compare.POSITION_TOLERANCE, "difference in position [m]"),
        ("rotation_errors", np.degrees(1.0), np.degrees(compare.ROTATION_TOLERANCE), "difference in rotation [°]"),
        ("tension_errors", 1.0, compare.TENSION_TOLERANCE, "largest difference in a tension [N]"),
    )
    colors = (style.BLUE, style.VERMILLION, style.GREEN, style.ORANGE, style.PURPLE)
    axes = figure.subplots(1, 3, sharey=True)
    for ax, (field, unit, tolerance, label) in zip(axes, panels, strict=True):
        for i, one in enumerate(study):
            values = unit * np.sort(getattr(one, field)[~one.neutral])
            share = 100 * np.arange(1, len(values) + 1) / len(values)
            ax.plot(
                values,
                share,
                color=colors[i % 5],
                ls=style.DASHES[i % 5],
                drawstyle="steps-post",
                label=one.name,
                gid=one.name,
            )
            if one.neutral.any():
                values = unit * getattr(one, field)[one.neutral]
                ax.plot(values, np.full(len(values), 103.0), "x", color=colors[i % 5], ms=5, gid=f"{one.name} neutral")
        ax.axvline(tolerance, color=style.INK, lw=style.THIN, ls=(0, (5, 3)))
        ax.set(xscale="log", xlabel=label, ylim=(0, 106))
        ax.set_xlim(left=1e-17)
        ax.xaxis.set_minor_formatter(NullFormatter())
    axes[0].set_ylabel("poses with a smaller difference [%]")
    handles, _ = axes[0].get_legend_handles_labels()
    handles += [
        Line2D([], [], color=style.INK, lw=style.THIN, ls=(0, (5, 3)), label="tolerance"),
        Line2D([], [], color=style.MUTED, ls="none", marker="x", label="neutrally stable"),
    ]
    figure.legend(handles=handles, loc="outside right center")
    return figure

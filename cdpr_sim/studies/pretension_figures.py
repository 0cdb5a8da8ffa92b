"""Figure of the effect of pretension on a fully constrained robot."""

# pyright: reportArgumentType=false, reportAttributeAccessIssue=false, reportCallIssue=false
# matplotlib's stubs know neither keyword dictionaries nor the axes of its 3D plots.
from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from mpl_toolkits.mplot3d import Axes3D

from cdpr_sim.drawing import axes as drawing
from cdpr_sim.drawing import style
from cdpr_sim.drawing.axes import canvas, points, styled
from cdpr_sim.studies.pretension import ABOVE, DRAWN, FORCE, HELD, MOST_ERROR, TORQUE, Pretension, Push, WrongLength

SETTLED = Line2D([], [], **points(style.INK), label="MuJoCo, settled")
LABEL_SPACING = 1.3
"""Smallest ratio between the heights of two labels on a logarithmic scale."""

SLACK = {"color": style.SLACK_CABLE, "ls": style.SLACK_DASH, "lw": 2.2}
"""Line style where cables are slack, as for a slack cable."""


@styled
def pretension(study: Pretension) -> Figure:
    """Stiffness over pretension, slack cables, and the effect of one length error."""
    stiffening, robot = study.stiffening, study.robot
    gain = stiffening.eigenvalues[-1, 0] / stiffening.rigid[0]
    overload = study.wrong[0].short_by(float(robot.force_max[0]))
    figure = canvas(
        13,
        8.2,
        f"Pretension makes IPAnema 1 up to {gain:.0f} times stiffer about its softest axis; one length "
        f"{100 * overload / robot.rest_lengths(robot.home)[ABOVE]:.1f} % too short overloads it",
        f"{robot.name}: 8 cables of 2.5 mm Dyneema, EA = {robot.axial_stiffness[0] / 1e3:.0f} kN, winches of "
        f"{robot.force_max[0]:.0f} N; platform of {robot.mass:g} kg (assumed) commanded to the middle. Pretension p: "
        "rest lengths whose tensions balance the weight and are closest to p. Rotations are weighted by the distance "
        f"of {1e3 * robot.characteristic_length:.0f} mm from the platform's middle to its anchors. Lines: statics; "
        f"hollow points: MuJoCo. Differences below {_power(study.method_differences[0])} m and "
        f"{_power(study.method_differences[1])} of the stiffness.",
    )
    grid = figure.add_gridspec(2, 3)
    _robot(figure.add_subplot(grid[0, 0], projection="3d"), study)
    _stiffness(figure.add_subplot(grid[0, 1]), study)
    _pushes(figure.add_subplot(grid[1, 0]), study, turned=False)
    _pushes(figure.add_subplot(grid[1, 1]), study, turned=True)
    _displacements(figure.add_subplot(grid[0, 2]), study)
    _overload(figure.add_subplot(grid[1, 2]), study)
    return figure


def _robot(ax: Axes3D, study: Pretension) -> None:
    """The robot under a downward force, with too little pretension."""
    drawing.draw_space(ax, study.robot)
    drawing.draw_pose_in_space(ax, study.drawn, 0)
    ax.set_box_aspect(tuple(np.diff(study.robot.frame, axis=0)[0]), zoom=0.78)
    ax.zaxis.labelpad = -6
    for axis, (low, high) in zip((ax.xaxis, ax.yaxis, ax.zaxis), study.robot.frame.T, strict=True):
        axis.set_ticks([0, high] if axis is ax.yaxis else [low, high])
    x, y, z = study.drawn.positions[0]
    ax.quiver(x, y, z + 0.75, 0, 0, -0.6, color=style.INK, lw=2, arrow_length_ratio=0.3)
    above = drawing.seen(ax, np.array([x, y, z + 1.1]))
    ax.text2D(*above, f"{FORCE:g} N", transform=ax.transData, fontsize=8.5, ha="center")
    slack = int(study.drawn.slack[0].sum())
    ax.set_title(f"{DRAWN:g} N: {slack} cables slack under a force", loc="left")
    handles = [handle for handle in drawing.pose_legend(slack=True) if "cable" in str(handle.get_label())]
    ax.legend(handles=handles, loc="lower center", bbox_to_anchor=(0.5, -0.08), ncols=2)


def _stiffness(ax: Axes, study: Pretension) -> None:
    """Six eigenvalues over pretension, labelled by their directions."""
    one = study.stiffening
    for mode, name in enumerate(one.directions):
        color = style.CABLES[mode]
        ax.plot(one.pretensions, one.eigenvalues[:, mode] / 1e3, color=color, gid=f"static {name}")
        ax.plot(one.settled_pretensions, one.settled[:, mode] / 1e3, **points(color), gid=f"mujoco {name}")
    heights = one.eigenvalues[-1] / 1e3
    for mode in range(1, len(heights)):  # room for each label
        heights[mode] = max(heights[mode], LABEL_SPACING * heights[mode - 1])
    for name, color, height in zip(one.directions, style.CABLES, heights, strict=False):
        ax.annotate(name, (1.04 * one.pretensions[-1], height), color=color, fontsize=8.5, va="center",
                    annotation_clip=False)  # fmt: skip
    rigid = one.rigid[0] / 1e3
    ax.plot(0, rigid, "D", color=style.CABLES[0], ms=5, clip_on=False, zorder=6, gid="rigid")
    ax.annotate(f"{rigid:.2g} kN/m with rigid lengths:\nlower cables slack", (0, rigid), (10, 0),
                textcoords="offset points", fontsize=8.5, va="center", color=style.MUTED)  # fmt: skip
    ax.set(xlabel="pretension [N]", ylabel="stiffness [kN/m]", yscale="log")
    ax.set_xlim(0, 1.02 * one.pretensions[-1])
    ax.set_ylim(0.7 * rigid, 900)
    ax.set_title("Six stiffnesses: rotations gain most")
    ax.legend(handles=[SETTLED], loc="upper left")


def _pushes(ax: Axes, study: Pretension, *, turned: bool) -> None:
    """Displacements under forces, or rotations under torques; dotted where a cable is slack."""
    pushes = [push for push in study.pushes if push.what.startswith("turned") == turned]
    sizes, some = study.stiffening.pretensions, study.stiffening.settled_pretensions
    for push, color, marker in zip(pushes, style.CABLES, style.MARKERS, strict=False):
        values, settled = _moved(push, turned=turned)
        slack = sizes <= push.taut
        at = float(np.interp(push.taut, sizes, values))
        ax.plot([push.taut, *sizes[~slack]], [at, *values[~slack]], color=color, gid=f"static {push.what}")
        ax.plot([*sizes[slack], push.taut], [*values[slack], at], **SLACK | {"color": color}, gid=f"slack {push.what}")
        ax.plot(push.taut, at, marker, color=color, ms=6.5, zorder=7)
        ax.plot(some, settled, **points(color, marker), gid=f"mujoco {push.what}")
        ax.plot([], [], color=color, marker=marker, ms=5, label=f"{push.what}: taut from {push.taut:.0f} N")
    what = f"rotation under {TORQUE:g} N m [°]" if turned else f"displacement under {FORCE:g} N [mm]"
    ax.set(xlabel="pretension [N]", ylabel=what, xscale="log")
    ax.set_xlim(0.96 * sizes[0], 1.03 * sizes[-1])
    ticks = [80, 100, 150, 200, 300, 400, 600]
    ax.set_xticks(ticks, [str(tick) for tick in ticks])
    ax.minorticks_off()
    ax.set_ylim(bottom=0)
    ax.set_title(
        "Torque: rotation decreases with pretension" if turned else "Force: large displacement only with slack cables"
    )
    handles, labels = ax.get_legend_handles_labels()
    handles.append(Line2D([], [], **SLACK | {"color": style.MUTED}))
    ax.legend(handles, [*labels, "dotted: cables slack"], loc="upper right")


def _displacements(ax: Axes, study: Pretension) -> None:
    """Displacement of the platform by one length error."""
    for wrong, color, marker in _wrong(study):
        ax.plot(1e3 * wrong.errors, 1e3 * wrong.shifts, color=color, gid=f"static {wrong.cable}")
        ax.plot(1e3 * wrong.settled_errors, 1e3 * wrong.settled_shifts, **points(color, marker))
        ax.plot([], [], color=color, marker=marker, ms=5, label=_named(wrong))
    _along_errors(ax, study)
    ax.set_ylabel("displacement of the platform [mm]")
    ax.set_title(f"One length error, at {HELD:g} N of pretension")
    ax.set_ylim(0, 1.25 * ax.get_ylim()[1])
    ax.legend(loc="upper center", ncols=2)


def _overload(ax: Axes, study: Pretension) -> None:
    """Largest tension of all cables under one length error."""
    for wrong, color, marker in _wrong(study):
        ax.plot(1e3 * wrong.errors, wrong.largest_tensions, color=color, gid=f"static {wrong.cable}")
        ax.plot(1e3 * wrong.settled_errors, wrong.settled_largest_tensions, **points(color, marker))
        first = np.flatnonzero(wrong.slack)
        if first.size:
            at = first[0]
            ax.plot(1e3 * wrong.errors[at], wrong.largest_tensions[at], marker, color=color, ms=6.5, zorder=7)
    limit = study.robot.force_max[0]
    ax.axhline(limit, color=style.INK, lw=1, ls=style.COMMANDED_DASH)
    ax.annotate(f"the winches' {limit:g} N", (1e3 * study.wrong[0].errors[-1], limit), (0, 4), ha="right",
                textcoords="offset points", fontsize=8.5)  # fmt: skip
    short = 1e3 * study.wrong[0].short_by(limit)
    ax.annotate(f"{short:.0f} mm too short", (-short, limit), (12, 22), textcoords="offset points", fontsize=8.5,
                arrowprops={"arrowstyle": "-", "color": style.MUTED, "lw": 0.7})  # fmt: skip
    _along_errors(ax, study)
    ax.set_ylabel("largest tension [N]")
    ax.set_ylim(bottom=0)
    ax.set_title("Largest tension under this length error")
    full = Line2D([], [], ls="none", marker="o", color=style.MUTED, ms=6.5, label="from here on it is slack")
    ax.legend(handles=[SETTLED, full], loc="lower left")


def _wrong(study: Pretension):
    return zip(study.wrong, (style.BLUE, style.VERMILLION), style.MARKERS, strict=False)


def _named(wrong: WrongLength) -> str:
    return "upper cable" if wrong.cable == ABOVE else "lower cable"


def _along_errors(ax: Axes, study: Pretension) -> None:
    most = 1e3 * study.wrong[0].errors[-1]
    ax.set_xlabel(f"error of its length, {MOST_ERROR:.0%} at the ends [mm]")
    ax.set_xlim(-1.03 * most, 1.03 * most)
    ax.axvline(0, color=style.FAINT, lw=style.HAIR, zorder=0)


def _moved(push: Push, *, turned: bool) -> tuple[np.ndarray, np.ndarray]:
    if turned:
        return np.degrees(push.turns), np.degrees(push.settled_turns)
    return 1e3 * push.shifts, 1e3 * push.settled_shifts


def _power(value: float) -> str:
    return f"1e{int(np.ceil(np.log10(value))):d}"

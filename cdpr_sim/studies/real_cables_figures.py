"""Figure of the effects of real cables: a robot with pulleys, a crane with sagging ropes, effect of each property."""

# pyright: reportArgumentType=false, reportAttributeAccessIssue=false, reportCallIssue=false
# matplotlib's stubs know neither keyword dictionaries nor the axes of its 3D plots.
from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from cdpr_sim.drawing import axes as drawing
from cdpr_sim.drawing import style
from cdpr_sim.drawing.axes import canvas, points, styled
from cdpr_sim.drawing.cable_curves import cable_curve, wheel_of
from cdpr_sim.studies.real_cables import (
    AWARE,
    BEHIND,
    BELOW,
    ELASTICITY,
    MASS,
    NONLINEAR,
    UNAWARE,
    UNAWARE_ABOVE,
    CableEffect,
    CableExample,
    Growth,
    RealCables,
)

COLORS = (style.BLUE, style.VERMILLION, style.GREEN)
"""Colours of the robots, in the study's order."""

ROWS = {
    UNAWARE: "pulleys unknown\nto the winches",
    UNAWARE_ABOVE: "…, cables arriving\nfrom above",
    ELASTICITY: "elasticity",
    AWARE: "pulleys known\nto the winches",
    MASS: "mass of the cables",
    NONLINEAR: "nonlinear elasticity",
    BEHIND: "rope behind\nthe exits",
}
"""Labels of the rows."""


@styled
def real_cables(study: RealCables) -> Figure:
    """Real cables: examples, and the displacement of the platform by each of their properties."""
    rates = [one.rate for one in study.growths if one.axis == BELOW][:2]
    figure = canvas(
        12,
        8.2,
        f"Pulleys unknown to the winches cause an error of about {np.mean(rates):.1f} mm per mm of radius; cable mass "
        "and nonlinear elasticity have little effect",
        "Settled in MuJoCo; statics differs by less than "
        f"{_power(max(effect.method_difference for effect in study.effects))} m. DemoBot: 10 mm pulleys, 0.5 g/m, "
        "0.5 m behind the exits; "
        "crane (geometry and 91 kg of CoGiRo, by CASPR): 100 mm pulleys, 4 mm steel rope, 64 g/m, EA = 1 MN, 6 m; "
        "EA doubles at 1 % strain: all these are assumed. Cables arrive from below, up masts, unless stated "
        f"otherwise. {len(study.effects[0].shifts)} random commanded poses per robot; homed at the middle."
        f"{_left_out(study.effects)}",
    )
    columns = figure.add_gridspec(1, 2, width_ratios=(1, 1.18))
    left, right = columns[0].subgridspec(2, 1, height_ratios=(1.55, 1)), columns[1].subgridspec(2, 1)
    _pulleys(figure.add_subplot(left[0]), study.over_pulleys)
    _ropes_with_mass(figure.add_subplot(left[1]), study.with_mass)
    _growth(figure.add_subplot(right[0]), study.growths)
    _effects(figure.add_subplot(right[1]), study.effects)
    return figure


def _pulleys(ax: Axes, example: CableExample) -> None:
    """DemoBot with pulleys, and its commanded pose with point exits."""
    equilibria = example.equilibria
    robot, position, rotation = equilibria.robot, equilibria.positions[0], equilibria.rotations[0]
    drawing.draw_front(ax, robot)
    commanded = equilibria.problems.positions[0]
    for exit_, anchor in zip(robot.exits, commanded + robot.anchors, strict=True):
        ax.plot([exit_[0], anchor[0]], [exit_[2], anchor[2]], color=style.COMMANDED, lw=0.6, ls=style.COMMANDED_DASH)
    drawing.draw_commanded(ax, robot, commanded)
    drawing.draw_platform(ax, robot, position, rotation)
    drawing.draw_cables(ax, robot, position, rotation, equilibria.slack[0], equilibria.rest_lengths[0])
    off = 1e3 * np.linalg.norm(position - commanded)
    radius = 1e3 * robot.cabling.pulley_radius.max()
    ax.set_ylim(-0.02, 0.56)
    ax.set_title(f"DemoBot with {radius:.0f} mm pulleys unknown to its winches: error of {off:.0f} mm")
    handles = drawing.pose_legend(slack=bool(equilibria.slack.any()))
    handles[0] = Line2D(
        [], [], color=style.COMMANDED, lw=0.9, ls=style.COMMANDED_DASH, label="commanded, with point exits"
    )
    ax.legend(handles=[*handles, Patch(**style.WHEEL, label="pulley")], loc="upper center", bbox_to_anchor=(0.5, -0.16),
              ncols=3)  # fmt: skip
    # One exit, closer.
    cable = int(np.argmin(robot.exits @ [1.0, 1.0, 0.0]))
    near, anchor = ax.inset_axes((0.6, 0.05, 0.37, 0.42)), position + rotation @ robot.anchors[cable]
    wheel = wheel_of(robot.cabling, cable, anchor)
    if wheel is None:
        return
    # In the wheel's own plane: outwards and upwards from the exit.
    flat = np.array([wheel.outwards, wheel.axis])
    rim, curve = (
        (wheel.arc() - robot.exits[cable]) @ flat.T,
        (cable_curve(robot.cabling, cable, anchor)) - robot.exits[cable],
    )
    curve = curve @ flat.T
    near.fill(*rim.T, fc=style.WHEEL["fc"], ec=style.WHEEL["ec"], lw=1)
    near.plot([0, 0], [-3 * wheel.radius, 0], color=style.INK, lw=1.2)
    near.plot(*curve.T, color=style.INK, lw=1.2)
    near.plot([0, curve[-1, 0]], [0, curve[-1, 1]], color=style.COMMANDED, lw=1, ls=style.COMMANDED_DASH)
    near.plot(0, 0, "o", color=style.INK, ms=3.5)
    near.set(aspect="equal", xticks=[], yticks=[])
    near.set_xlim(-1.2 * wheel.radius, 3.4 * wheel.radius)
    near.set_ylim(-2.6 * wheel.radius, 1.4 * wheel.radius)
    near.set_title("one pulley, seen from its side", fontsize=8, loc="center")
    for spine in near.spines.values():
        spine.set(visible=True, color=style.FAINT)


def _ropes_with_mass(ax: Axes, example: CableExample) -> None:
    """The crane with the profiles of its ropes."""
    equilibria = example.equilibria
    robot, position, rotation = equilibria.robot, equilibria.positions[0], equilibria.rotations[0]
    drawing.draw_front(ax, robot)
    drawing.draw_platform(ax, robot, position, rotation)
    drawing.draw_cables(ax, robot, position, rotation, equilibria.slack[0], shapes=example.shapes)
    along, sags = _sags(example)
    ax.set_title(f"The crane on steel ropes, with a sag of {sags.max(1).min():.0f} to {sags.max(1).max():.0f} mm")
    # The same profiles, with the sag enlarged.
    near = ax.inset_axes((0.52, 0.14, 0.45, 0.36))
    for sag, slack in zip(sags, equilibria.slack[0], strict=True):
        looks = {"color": style.SLACK_CABLE, "ls": style.SLACK_DASH} if slack else {"color": style.INK}
        near.plot(along, -sag, lw=1.0, **looks)
    near.set_title("sag [mm], from exit to anchor", fontsize=8, loc="center")
    near.tick_params(labelsize=7.5)
    near.set_xticks([])
    if equilibria.slack.any():
        slack = Line2D([], [], color=style.SLACK_CABLE, lw=1.4, ls=style.SLACK_DASH, label="slack rope")
        taut = Line2D([], [], color=style.INK, lw=style.HAIR + 0.2, label="taut rope")
        ax.legend(handles=[taut, slack], loc="lower left", bbox_to_anchor=(0.16, 0.0))


def _growth(ax: Axes, growths: tuple[Growth, ...]) -> None:
    """Position error over radius: DemoBot as curves; the crane, ten times larger, in the legend only."""
    colors = dict(zip(dict.fromkeys(one.title for one in growths), COLORS, strict=False))
    for one in growths:
        if one.title.startswith("crane"):
            continue
        color, from_below = colors[one.title], one.axis == BELOW
        radii = 1e3 * one.radii
        low, middle, high = 1e3 * np.quantile(one.shifts, [0.05, 0.5, 0.95], axis=1)
        arriving = "from below" if from_below else "from above"
        label = f"{_layout(one.title)}, {arriving}: {one.rate:.2f} mm per mm"
        dashes = style.DASHES[0 if from_below else 1]
        ax.fill_between(radii, low, high, color=color, alpha=0.10 if from_below else 0.05, lw=0)
        ax.plot(radii, middle, color=color, ls=dashes, label=label, gid=f"static {one.title} {arriving}")
        settled = 1e3 * np.median(one.settled, axis=1)
        marker = style.MARKERS[list(colors).index(one.title)]
        ax.plot(1e3 * one.settled_radii, settled, **points(color, marker), gid=f"mujoco {one.title} {arriving}")
    crane = next((one for one in growths if one.title.startswith("crane")), None)
    if crane is not None:
        ax.plot([], [], ls="none", label=f"not drawn: crane, from below: {crane.rate:.2f} mm per mm")
    ax.set(xlabel="radius of the pulleys [mm]", ylabel="position error [mm]")
    ax.set_ylim(0, 1.25 * ax.get_ylim()[1])
    ax.set_xlim(0, 1e3 * growths[0].radii[-1])
    ax.set_title("DemoBot, with rest lengths for point exits")
    handles, labels = ax.get_legend_handles_labels()
    handles += [Patch(fc=style.FAINT, alpha=0.6), Line2D([], [], **points(style.INK))]
    ax.legend(handles, [*labels, "from 5 to 95 % of the poses; lines: median", "MuJoCo, settled"], loc="upper left")


def _effects(ax: Axes, effects: tuple[CableEffect, ...]) -> None:
    """A row per property, a point per robot: the median, with a line up to the 95 % quantile."""
    titles = list(dict.fromkeys(effect.robot for effect in effects))
    names = list(ROWS)[::-1]
    for effect in effects:
        robot = titles.index(effect.robot)
        height = names.index(effect.what) + 0.22 * (1 - robot)
        middle, high = 1e3 * np.quantile(effect.shifts, [0.5, 0.95])
        ax.plot(
            [middle, high], [height, height], color=COLORS[robot], lw=1.2, gid=f"range {effect.robot} {effect.what}"
        )
        marker = points(COLORS[robot], style.MARKERS[robot], ms=5.5)
        ax.plot(middle, height, **marker, gid=f"median {effect.robot} {effect.what}")
    ax.set(xscale="log", xlabel="displacement of the platform: median, and up to 95 % of poses [mm]")
    ax.set_yticks(range(len(names)), [ROWS[name] for name in names])
    ax.grid(axis="x")
    ax.set_title("Effect of each property separately, in MuJoCo")
    handles = [
        Line2D([], [], **points(COLORS[i], style.MARKERS[i], ms=5.5) | {"ls": "-", "color": COLORS[i]}, label=title)
        for i, title in enumerate(titles)
    ]
    ax.legend(handles=handles, loc="upper left")
    ax.set_xlim(right=100)


def _left_out(effects: tuple[CableEffect, ...]) -> str:
    missing = sum(effect.unsettled for effect in effects)
    return f" Left out: {missing} poses at which MuJoCo did not settle." if missing else ""


def _layout(title: str) -> str:
    """The layout without the robot's name, which is in the panel's title."""
    return title.removeprefix("DemoBot, ")


def _sags(example: CableExample) -> tuple[np.ndarray, np.ndarray]:
    """Fraction along each rope (points,), and sag below its chord, (cables, points) [mm]."""
    shapes = example.shapes
    along = np.linspace(0, 1, shapes.shape[1])
    chords = shapes[:, :1] + along[:, None] * (shapes[:, -1:] - shapes[:, :1])
    return along, 1e3 * (chords - shapes)[..., 2]


def _power(value: float) -> str:
    return f"1e{int(np.ceil(np.log10(value))):d}"

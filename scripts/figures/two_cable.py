"""The two-cable bar by closed forms, the static solver and MuJoCo, and its figures (the paper's Fig. 3 and 4)."""

# pyright: reportArgumentType=false, reportAttributeAccessIssue=false, reportCallIssue=false
# matplotlib's stubs know neither keyword dictionaries nor the axes of its 3D plots.
from __future__ import annotations

from dataclasses import dataclass

import matplotlib
import numpy as np
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke
from mpl_toolkits.mplot3d import Axes3D
from numpy.typing import ArrayLike

import robots_on_axes as drawing
from cdpr_sim.core.describe import describe_cables, newtons
from cdpr_sim.core.equilibrium_batch import EquilibriumBatch, all_solved
from cdpr_sim.core.robot import Robot
from cdpr_sim.drawing import style
from cdpr_sim.drawing.figures import canvas, key, legend_above, styled
from cdpr_sim.drawing.readable_numbers import power_of_ten
from cdpr_sim.physics.settle import settle_many
from cdpr_sim.robots.catalogue import load_robot
from cdpr_sim.statics import two_cable_closed_form
from cdpr_sim.statics.newton import solve_many
from lines import COLUMNS, PAPER_HEIGHTS, Line, along_x, line
from robots_on_axes import legend_below, points

STIFFEST, SOFTEST = 1e3, 15.0
"""[N] EA at both ends of the drift."""

SURFACE = (61, 41)
"""Points of the surface of equilibria along x and z."""


@dataclass(frozen=True, eq=False)
class Manifold:
    """Drift of the two-cable bar on the surface of its equilibria with decreasing stiffness (Fig. 3).

    Attributes:
        static: one ``EquilibriumBatch`` per stiffness, stiffest first, a row per commanded level pose.
        settled: by MuJoCo, for some of the stiffnesses.
    """

    static: tuple[EquilibriumBatch, ...]
    settled: tuple[EquilibriumBatch, ...]


@dataclass(frozen=True, eq=False)
class TwoCableBar:
    """The two-cable bar by both methods (Fig. 4).

    Attributes:
        line: the bar commanded along x.
        poses: a few poses at a few heights, by the static method.
        settled_poses: the same poses by MuJoCo.
    """

    line: Line
    poses: EquilibriumBatch
    settled_poses: EquilibriumBatch


def manifold(*, drifts: int = 49, settled_every: int = 12) -> Manifold:
    """The two-cable robot's drift with decreasing EA [N].

    Raises:
        NotConverged: the static solver found no equilibrium at some pose.
        NotSettled: MuJoCo did not settle at some pose.
    """
    commanded = np.array([[0.18, 0, 0.3], [0.4, 0, 0.3], [0.58, 0, 0.15]])
    stiffness = 1 / np.linspace(1 / STIFFEST, 1 / SOFTEST, drifts)  # even steps of drift
    robots = [load_robot("two-cable").replace(axial_stiffness=EA) for EA in stiffness]
    return Manifold(
        static=tuple(all_solved(solve_many(one, commanded)) for one in robots),
        settled=tuple(all_solved(settle_many(one, commanded)) for one in robots[::settled_every]),
    )


def two_cable_bar(*, static_rows: int = 201, settled_rows: int = 25) -> TwoCableBar:
    """The two-cable bar commanded across its workspace.

    Raises:
        NotConverged: the static solver found no equilibrium at some pose.
        NotSettled: MuJoCo did not settle at some pose.
    """
    robot = load_robot("two-cable")
    ends = (float(robot.workspace[0, 0]), float(robot.workspace[1, 0]))
    poses = np.concatenate([along_x(robot, z, ends, COLUMNS) for z in (0.1, 0.22, 0.34)])
    return TwoCableBar(
        line=line(robot, PAPER_HEIGHTS[0], ends, static_rows=static_rows, settled_rows=settled_rows),
        poses=all_solved(solve_many(robot, poses)),
        settled_poses=all_solved(settle_many(robot, poses)),
    )


def upright(robot: Robot, position: ArrayLike) -> float:
    """The closed form's equilibrium with the smallest rotation [rad]."""
    rotations = two_cable_closed_form.equilibrium_rotations(robot, position)
    return float(rotations[np.argmin(np.abs(rotations))])


# Figures


@styled
def draw_manifold(study: Manifold) -> Figure:
    """Fig. 3: the surface of all equilibria of the two-cable bar, and its drift with decreasing stiffness."""
    robot, commanded = study.static[0].robot, study.static[0].problems.positions
    stiffness = np.array([equilibria.robot.axial_stiffness[0] for equilibria in study.static])
    softest, stiffest = stiffness.min(), stiffness.max()
    figure = canvas(
        style.WIDTH,
        5.4,
        "The equilibria of a bar on two cables form a surface of poses; with softer cables it drifts along the surface",
        f"{robot.name}, {robot.mass:g} kg. Surface and contours: closed form. Curves: static solver, "
        f"EA from {newtons(stiffest)} down to {newtons(softest)}. Hollow points: MuJoCo, settled. Black dots: "
        "commanded level poses, which are on the surface only midway between the exits. (Paper, Fig. 3)",
    )
    colors = matplotlib.colormaps[style.STIFFNESS_MAP]
    handles = [
        key("commanded, level", ls="none", marker="o", color=style.INK),
        key(f"to the equilibrium with EA = {newtons(stiffest)}", ls=":", lw=0.9, color=style.INK),
        key("static solver, EA decreasing", color=colors(0.6), lw=2.6),
        key("MuJoCo, settled", **points(style.INK, ms=4.5)),
    ]
    grid = legend_above(figure, handles, 4).subgridspec(1, 2, width_ratios=(1.1, 1), wspace=0.15)
    space: Axes3D = figure.add_subplot(grid[0], projection="3d", computed_zorder=False)  # type: ignore[assignment]
    (left, _, bottom), (right, _, top) = robot.workspace
    x, z = np.meshgrid(np.linspace(left, right, SURFACE[0]), np.linspace(bottom, top, SURFACE[1]))
    beta = np.degrees(
        [[upright(robot, [a, 0.0, b]) for a, b in zip(*row, strict=True)] for row in zip(x, z, strict=True)]
    )
    space.plot_surface(x, z, beta, color=style.SKY, alpha=0.3, lw=0, antialiased=True, zorder=1)
    space.plot_wireframe(x, z, beta, color=style.MUTED, lw=0.4, rstride=8, cstride=6, alpha=0.7, zorder=2)
    space.contour(x, z, beta, levels=[0], colors=style.MUTED, linewidths=1.2)
    space.set(zticks=np.arange(-60, 61, 30), yticks=[0.1, 0.2, 0.3, 0.4], xticks=[0.1, 0.3, 0.5, 0.7])
    for axis in (space.xaxis, space.yaxis, space.zaxis):
        axis.set_pane_color("white")
    space.set(xlabel="x [m]", ylabel="z [m]", zlabel="rotation about y [°]")
    space.view_init(elev=22, azim=-58)
    space.set_box_aspect((1.25, 1, 0.9), zoom=1.0)

    front = figure.add_subplot(grid[1])
    contours = front.contour(x, z, beta, levels=np.arange(-60, 61, 10), colors=style.FAINT, linewidths=style.THIN)
    for text in front.clabel(contours, range(-60, 61, 20), fmt="%d°", fontsize=8, colors=style.MUTED, inline=False):
        text.set_path_effects([withStroke(linewidth=3, foreground="white")])
    front.set(xlabel="x [m]", ylabel="z [m]", title="front view: contours of the rotation about y")

    norm = Normalize(-1 / softest, -1 / stiffest)  # by compliance, to which the drift is proportional
    drift = np.array([equilibria.positions for equilibria in study.static])
    turn = np.degrees([equilibria.euler[:, 1] for equilibria in study.static])
    for command, (start_x, _, start_z) in enumerate(commanded):
        here, angle = drift[:, command], turn[:, command]
        space.plot(
            [start_x, here[0, 0]], [start_z, here[0, 2]], [0, angle[0]], color=style.INK, lw=0.9, ls=":", zorder=6
        )
        front.plot([start_x, here[0, 0]], [start_z, here[0, 2]], color=style.INK, lw=0.9, ls=":", zorder=3)
        space.plot(here[:, 0], here[:, 2], angle, color=style.INK, lw=4.6, zorder=6.5, solid_capstyle="round")
        front.plot(here[:, 0], here[:, 2], color=style.INK, lw=4.6, zorder=3.5, gid=f"static {command}")
        for i in range(len(here) - 1):
            color = colors(norm(-1 / stiffness[i]))
            piece = here[i : i + 2]
            space.plot(piece[:, 0], piece[:, 2], angle[i : i + 2], color=color, lw=3.2, zorder=7)
            front.plot(piece[:, 0], piece[:, 2], color=color, lw=3.2, zorder=4)
    for equilibria in study.settled:
        degrees = np.degrees(equilibria.euler[:, 1])
        space.plot(*equilibria.positions[:, [0, 2]].T, degrees, **points(style.INK, ms=4.5) | {"zorder": 9})
        front.plot(*equilibria.positions[:, [0, 2]].T, **points(style.INK, ms=4.5), gid="mujoco")
    space.plot(*commanded[:, [0, 2]].T, 0.0, "o", color=style.INK, ms=5, zorder=10)
    front.plot(*commanded[:, [0, 2]].T, "o", color=style.INK, ms=5, zorder=7)
    bar = figure.colorbar(matplotlib.cm.ScalarMappable(norm, colors), ax=front, shrink=0.85, pad=0.02)
    marks = [EA for EA in (15, 20, 30, 50, 100, 1000) if softest <= EA <= stiffest]
    bar.set_ticks([-1 / EA for EA in marks], labels=[f"{EA:g}" for EA in marks])
    bar.set_label("axial stiffness EA [N]")
    return figure


@styled
def draw_poses(study: TwoCableBar) -> Figure:
    """Fig. 4: commanded poses of the two-cable bar, its equilibrium tilt at these positions, and its equilibria."""
    robot, equilibria, settled = study.poses.robot, study.poses, study.settled_poses
    deviation = 1e3 * np.abs(equilibria.deviation[:, 0]).max()
    figure = canvas(
        8.6,
        6.4,
        f"Commanded level, a bar on two cables tilts and deviates up to {deviation:.0f} mm inwards",
        f"{robot.name}, {describe_cables(robot)}, bar of {1e3 * robot.platform_size[0]:.0f} mm and {robot.mass:g} kg, "
        f"{len(equilibria)} commanded poses. (Paper, Fig. 4)",
    )
    ax = figure.add_subplot()
    drawing.draw_frame(ax, robot)
    half, turns = np.array([robot.anchors[0], robot.anchors[-1]]), equilibria.euler[:, 1]

    def bar(position: np.ndarray, beta: float, **looks) -> None:
        c, s = np.cos(beta), np.sin(beta)
        ends = position + half @ np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]]).T
        ax.plot(ends[:, 0], ends[:, 2], solid_capstyle="round", **looks)

    for row, (commanded, position) in enumerate(zip(equilibria.problems.positions, equilibria.positions, strict=True)):
        bar(commanded, 0.0, color=style.MUTED, lw=2, ls=(0, (1.5, 1)), zorder=3)
        bar(commanded, upright(robot, commanded), color=style.GREEN, lw=2, ls=(0, (5, 1.5)), zorder=3.5)
        bar(position, turns[row], color=style.BLUE, lw=3.4, zorder=4)
        drawing.draw_cables(ax, robot, position, equilibria.rotations[row], equilibria.slack[row], color=style.FAINT)
    ax.plot(*settled.positions[:, [0, 2]].T, **points(style.INK, ms=4.5), gid="mujoco")
    for side in (0, -1):
        anchors = settled.positions + settled.rotations @ robot.anchors[side]
        ax.plot(*anchors[:, [0, 2]].T, **points(style.INK, ms=4.5), gid="mujoco")
    handles = [
        key("commanded, level", color=style.MUTED, lw=2, ls=(0, (1.5, 1))),
        key("closed form: equilibrium tilt there", color=style.GREEN, lw=2, ls=(0, (5, 1.5))),
        key("static solver: equilibrium", color=style.BLUE, lw=3.4),
        key("MuJoCo: ends and middle, settled", **points(style.INK, ms=4.5)),
    ]
    legend_below(ax, handles, 0.1)
    return figure


@styled
def draw_closed_form(study: TwoCableBar) -> Figure:
    """Fig. 4, Eq. 5 and 6: tilt of the two-cable bar by four methods, and the error of the short-bar formula."""
    static, settled, robot = study.line.static, study.line.settled, study.line.robot
    x, beta = static.positions[:, 0], np.degrees(static.euler[:, 1])
    closed = np.degrees([upright(robot, position) for position in static.positions])
    short = np.degrees([two_cable_closed_form.short_bar_rotation(robot, position) for position in static.positions])
    figure = canvas(
        8.6,
        5.6,
        f"Without the bar's length, the closed form has an error of up to {np.abs(short - beta).max():.1f}° of tilt",
        f"{robot.name}, {describe_cables(robot)}, commanded level along z = {study.line.height:g} m; at the {len(x)} "
        "equilibria of the static solver. Short bar: the paper's Eq. 5 and 6 contain terms of the wrong dimension; "
        "corrected, they are tan θ = (h₁X₂ + h₂X₁)/(2X₁X₂), for a bar of length zero.",
    )
    top, bottom = figure.subplots(2, 1, sharex=True, height_ratios=(1.6, 1))
    top.plot(x, closed, color=style.SKY, lw=5, alpha=0.8, label="closed form, with the bar's length")
    top.plot(x, beta, color=style.INK, lw=1.2, label="static solver", gid="static")
    top.plot(
        x, short, color=style.VERMILLION, ls=style.DASHES[1], label="closed form of a short bar (paper, corrected)"
    )
    top.plot(
        settled.positions[:, 0],
        np.degrees(settled.euler[:, 1]),
        **points(style.INK),
        label="MuJoCo, settled",
        gid="mujoco",
    )
    top.set(ylabel="rotation about y [°]")
    top.legend(loc="lower left")
    bottom.axhline(0, color=style.FAINT, lw=style.THIN)
    bottom.plot(x, closed - beta, color=style.SKY, lw=4, label="closed form", gid="closed-form error")
    bottom.plot(x, short - beta, color=style.VERMILLION, ls=style.DASHES[1], label="short bar", gid="short-bar error")
    bottom.annotate(
        f"closed form: within {power_of_ten(np.abs(closed - beta).max())}°",
        (x[len(x) // 3], 0),
        xytext=(0, 7),
        textcoords="offset points",
        fontsize=8.5,
    )
    bottom.set(xlabel="x of the bar [m]", ylabel="error to static solver [°]")
    bottom.legend(loc="lower right")
    return figure

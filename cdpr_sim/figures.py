"""The paper's figures redrawn from both roads, and two of our own: results in, matplotlib ``Figure`` out.

Lines are the static solver's, hollow points MuJoCo's. Nothing is computed here but numbers in titles.
"""

from __future__ import annotations

from collections.abc import Sequence

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Arc
from matplotlib.ticker import FuncFormatter, NullFormatter
from mpl_toolkits.mplot3d import Axes3D
from numpy.typing import ArrayLike

from cdpr_sim import drawing, style
from cdpr_sim.drawing import canvas, points, styled
from cdpr_sim.studies import (
    PAPER_SAG,
    PAPER_TILT,
    Balance,
    ClosedForms,
    Convergence,
    Differences,
    Line,
    Manifold,
    Rests,
    Width,
)

ROADS = "Lines: static solver (Newton). Hollow points: MuJoCo, settled."


@styled
def two_cable_manifold(manifold: Manifold) -> Figure:
    """Fig. 3: the surface of all poses at which the two-cable bar can rest, and its drift as the cables soften."""
    softest, stiffest = manifold.axial_stiffness.min(), manifold.axial_stiffness.max()
    figure = canvas(
        11,
        5.2,
        "A bar on two cables can only rest on one surface of poses; softer cables let it drift along it",
        f"{manifold.robot.name}, {manifold.robot.mass:g} kg. Surface and contours: closed form. Curves: static solver, "
        f"EA from {_newton(stiffest)} (dark: soft, light: stiff) down to {_newton(softest)}. Hollow points: MuJoCo, "
        "settled.\nBlack dots: commanded level poses; only the one in the middle lies on the surface.  "
        "(Paper, Fig. 3)",
    )
    grid = figure.add_gridspec(1, 2, width_ratios=(1.15, 1))
    space: Axes3D = figure.add_subplot(grid[0], projection="3d", computed_zorder=False)  # type: ignore[assignment]
    x, z = np.meshgrid(manifold.x, manifold.z)
    beta = np.degrees(manifold.rotation_about_y)
    space.plot_surface(x, z, beta, color=style.SKY, alpha=0.28, lw=0, antialiased=True, zorder=1)
    space.plot_wireframe(x, z, beta, color=style.MUTED, lw=0.4, rstride=8, cstride=6, alpha=0.7, zorder=2)
    space.set(xlabel="x [m]", ylabel="z [m]", zlabel="rotation about y [°]")
    space.view_init(elev=22, azim=-58)
    space.set_box_aspect((1.25, 1, 0.85), zoom=0.98)

    front = figure.add_subplot(grid[1])
    contours = front.contour(x, z, beta, levels=np.arange(-60, 61, 10), colors=style.FAINT, linewidths=style.THIN)
    front.clabel(contours, fmt="%d°", fontsize=8, colors=style.MUTED)
    front.set(xlabel="x [m]", ylabel="z [m]", title="the same from the front: contours of the rotation about y [°]")

    norm, colors = LogNorm(softest, stiffest), matplotlib.colormaps[style.STIFFNESS_MAP]
    drift = np.array([rests.positions for rests in manifold.static])
    turn = np.degrees([rests.rotation_about_y for rests in manifold.static])
    for command, (start_x, _, start_z) in enumerate(manifold.commanded):
        here, angle = drift[:, command], turn[:, command]
        space.plot(
            [start_x, here[0, 0]], [start_z, here[0, 2]], [0, angle[0]], color=style.INK, lw=0.9, ls=":", zorder=6
        )
        front.plot([start_x, here[0, 0]], [start_z, here[0, 2]], color=style.INK, lw=0.9, ls=":", zorder=3)
        for i in range(len(here) - 1):
            color = colors(norm(manifold.axial_stiffness[i]))
            piece = here[i : i + 2]
            space.plot(piece[:, 0], piece[:, 2], angle[i : i + 2], color=color, lw=2.6, zorder=7)
            front.plot(piece[:, 0], piece[:, 2], color=color, lw=2.6, zorder=4, gid=f"drift-{command}")
    for rests in manifold.settled:
        degrees = np.degrees(rests.rotation_about_y)
        space.plot(*rests.positions[:, [0, 2]].T, degrees, **points(style.INK, ms=4.5) | {"zorder": 9})
        front.plot(*rests.positions[:, [0, 2]].T, **points(style.INK, ms=4.5), gid="mujoco")
    space.plot(*manifold.commanded[:, [0, 2]].T, 0.0, "o", color=style.INK, ms=5, zorder=10)
    front.plot(*manifold.commanded[:, [0, 2]].T, "o", color=style.INK, ms=5, zorder=7)
    bar = figure.colorbar(matplotlib.cm.ScalarMappable(norm, colors), ax=front, shrink=0.8, pad=0.02)
    bar.set_label("axial stiffness EA [N]")
    front.legend(
        handles=[
            Line2D([], [], ls="none", marker="o", color=style.INK, label="commanded, level"),
            Line2D([], [], ls=":", lw=0.9, color=style.INK, label="to where stiff cables leave it"),
            Line2D([], [], color=colors(0.5), lw=2.6, label="static solver, EA falling"),
            Line2D([], [], **points(style.INK, ms=4.5), label="MuJoCo, settled"),
        ],
        loc="upper center",
        bbox_to_anchor=(0.5, -0.14),
        ncols=2,
    )
    return figure


@styled
def two_cable_poses(forms: ClosedForms) -> Figure:
    """Fig. 4: where the two-cable bar is commanded, how it would have to tilt there, and where it rests."""
    robot, rests, settled = forms.poses.robot, forms.poses, forms.settled_poses
    shift = 1e3 * np.abs(rests.positions - rests.commanded)[:, 0].max()
    figure = canvas(
        8.6,
        6.1,
        f"Commanded level, a bar on two cables tilts and moves up to {shift:.0f} mm towards the middle",
        f"{robot.name}, {_cable(robot)}, bar of {1e3 * robot.platform_size[0]:.0f} mm and {robot.mass:g} kg, "
        f"{len(rests)} commanded poses.  (Paper, Fig. 4)",
    )
    ax = figure.add_subplot()
    drawing.draw_front(ax, robot)
    half = np.array([robot.anchors[0], robot.anchors[-1]])

    def bar(position: np.ndarray, beta: float, **looks) -> None:
        c, s = np.cos(beta), np.sin(beta)
        ends = position + half @ np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]]).T
        ax.plot(ends[:, 0], ends[:, 2], solid_capstyle="round", **looks)

    for row, (commanded, position) in enumerate(zip(rests.commanded, rests.positions, strict=True)):
        bar(commanded, 0.0, color=style.MUTED, lw=2, ls=(0, (1.5, 1)), zorder=3)
        bar(commanded, forms.balanced[row], color=style.GREEN, lw=2, ls=(0, (5, 1.5)), zorder=3.5)
        bar(position, rests.rotation_about_y[row], color=style.BLUE, lw=3.4, zorder=4)
        drawing.draw_cables(ax, robot, position, rests.rotations[row], rests.slack[row], color=style.FAINT)
    ax.plot(*settled.positions[:, [0, 2]].T, **points(style.INK, ms=4.5), gid="mujoco")
    for side in (0, -1):
        anchors = settled.positions + settled.rotations @ robot.anchors[side]
        ax.plot(*anchors[:, [0, 2]].T, **points(style.INK, ms=4.5), gid="mujoco")
    ax.legend(
        handles=[
            Line2D([], [], color=style.MUTED, lw=2, ls=(0, (1.5, 1)), label="commanded, level"),
            Line2D([], [], color=style.GREEN, lw=2, ls=(0, (5, 1.5)), label="closed form: tilt it needs there"),
            Line2D([], [], color=style.BLUE, lw=3.4, label="static solver: where it rests"),
            Line2D([], [], **points(style.INK, ms=4.5), label="MuJoCo: its ends and middle, settled"),
        ],
        loc="upper center",
        bbox_to_anchor=(0.5, -0.1),
        ncols=2,
    )
    return figure


@styled
def two_cable_closed_form(forms: ClosedForms) -> Figure:
    """Fig. 4, Eq. 5 and 6: the tilt of the two-cable bar by four witnesses, and how far the short-bar form is off."""
    static, settled, robot = forms.line.static, forms.line.settled, forms.line.robot
    x, beta = static.positions[:, 0], np.degrees(static.rotation_about_y)
    closed, short = np.degrees(forms.closed_form), np.degrees(forms.short_bar)
    figure = canvas(
        8.6,
        5.6,
        f"Leaving out the bar's length costs the tilt up to {np.abs(short - beta).max():.1f}°; "
        "the closed form with it is exact",
        f"{robot.name}, {_cable(robot)}, commanded level along z = {forms.line.height:g} m; at each position where "
        f"the solver finds the bar at rest, {len(x)} in all.\nShort bar: the paper's Eq. 5 and 6 contain terms of the "
        "wrong dimension; mended, they are tan θ = (h₁X₂ + h₂X₁)/(2X₁X₂), a bar of no length.",
    )
    top, bottom = figure.subplots(2, 1, sharex=True, height_ratios=(1.6, 1))
    top.plot(x, closed, color=style.SKY, lw=5, alpha=0.8, label="closed form, with the bar's length")
    top.plot(x, beta, color=style.INK, lw=1.2, label="static solver", gid="static")
    top.plot(x, short, color=style.VERMILLION, ls=style.DASHES[1], label="closed form of a short bar (paper, mended)")
    top.plot(
        settled.positions[:, 0],
        np.degrees(settled.rotation_about_y),
        **points(style.INK),
        label="MuJoCo, settled",
        gid="mujoco",
    )
    top.set(ylabel="rotation about y [°]")
    top.legend(loc="upper right")
    bottom.axhline(0, color=style.FAINT, lw=style.THIN)
    bottom.plot(x, closed - beta, color=style.SKY, lw=4, label="closed form", gid="closed-form error")
    bottom.plot(x, short - beta, color=style.VERMILLION, ls=style.DASHES[1], label="short bar", gid="short-bar error")
    bottom.annotate(
        f"closed form: within {_power(np.abs(closed - beta).max())}°",
        (x[len(x) // 3], 0),
        xytext=(0, 7),
        textcoords="offset points",
        fontsize=8.5,
    )
    bottom.set(xlabel="x where the bar rests [m]", ylabel="minus static solver [°]")
    bottom.legend(loc="upper right")
    return figure


@styled
def planar(width: Width) -> Figure:
    """Fig. 7 and 8: poses of a planar robot at rest, and its cables' tensions along the width."""
    rests = width.poses
    tilt = np.degrees(np.abs(rests.rotation_about_y).max())
    slack = max(count for one in width.lines for *_, count in one.static.zones())
    figure, left, right = _width(width, _headline(rests.robot, tilt, slack), projection=None)
    drawing.draw_front(left, rests.robot)
    for row in range(len(rests)):
        drawing.draw_commanded(left, rests.robot, rests.commanded[row])
        drawing.draw_platform(left, rests.robot, rests.positions[row], rests.rotations[row])
        drawing.draw_cables(
            left,
            rests.robot,
            rests.positions[row],
            rests.rotations[row],
            rests.slack[row],
            rests.rest_lengths[row],
        )
    left.legend(handles=drawing.pose_legend(), loc="upper center", bbox_to_anchor=(0.5, -0.12), ncols=2)
    for ax, one in zip(right, width.lines, strict=True):
        _tensions(ax, one, last=one is width.lines[-1])
    return figure


@styled
def spatial(width: Width, workspace: ArrayLike | None = None) -> Figure:
    """Fig. 10 and 11: poses of a spatial robot at rest, and its cables' tensions along the width.

    Args:
        width: the study.
        workspace: outline of the static feasible workspace, (points, 3) [m], if it is to be drawn.
    """
    rests = width.poses
    tilt = np.degrees(np.abs(rests.rotation_about_y).max())
    slack = max(count for one in width.lines for *_, count in one.static.zones())
    figure, left, right = _width(width, _headline(rests.robot, tilt, slack), projection="3d")
    drawing.draw_space(left, rests.robot)
    handles = []
    if workspace is not None:
        outline = np.asarray(workspace, dtype=float)
        left.plot(*np.vstack([outline, outline[:1]]).T, color=style.GREEN, lw=style.LINE)
        handles = [Line2D([], [], color=style.GREEN, lw=style.LINE, label="static feasible workspace")]
    for row in range(len(rests)):
        drawing.draw_pose_in_space(left, rests, row)
    left.legend(handles=drawing.pose_legend(handles), loc="upper center", bbox_to_anchor=(0.5, 0.02), ncols=2)
    for ax, one in zip(right, width.lines, strict=True):
        _tensions(ax, one, last=one is width.lines[-1])
    return figure


@styled
def tilt_condition(balances: Sequence[Balance]) -> Figure:
    """Fig. 9: where the two sides' lines of force meet, and the moment that gravity has about that point."""
    figure = canvas(
        10.5,
        8.2,
        "The platform tilts where gravity passes beside the point in which the two sides' forces meet",
        "Dash-dotted: each side's line of force; equal tensions put it on the midline of the pair (points H and V). "
        "Dashed: the vertical through the centre of mass.\nTheir distance times the weight is the moment that turns "
        "the platform; at rest the tensions have changed until it is gone.  (Paper, Fig. 9)",
    )
    for ax, balance, letter in zip(figure.subplots(2, 2).flat, balances, "abcd", strict=True):
        _balance(ax, balance, letter)
    return figure


@styled
def paper_line(lines: Sequence[Line]) -> Figure:
    """Fig. 12: deviation in z and rotation about y along the paper's trajectory."""
    heights = sorted({line.height for line in lines})
    count = sum(len(line.settled) for line in lines)
    figure = canvas(
        10.5,
        6.6,
        "Along the paper's line the parallel layout tilts and sags at the ends; the Cogiro layout does not",
        f"DemoBot commanded level from x = {lines[0].static.commanded[0, 0]:g} to "
        f"{lines[0].static.commanded[-1, 0]:g} m at y = 0.25 m (grey band). {ROADS} {count} points.\n"
        "Our EA are assumed (Vectran 10 kN, fishing line 1 kN): the paper gives none. Crosses: read from the "
        "paper's text (“approximately 20°”, “about 15 mm”, downwards), not from its data.  (Paper, Fig. 12)",
    )
    axes = figure.subplots(2, len(heights), sharex=True, sharey="row", squeeze=False)
    layouts = list(dict.fromkeys(line.robot.name for line in lines))
    materials = list(dict.fromkeys(line.robot.material for line in lines))
    for line in lines:
        column = heights.index(line.height)
        i, j = layouts.index(line.robot.name), materials.index(line.robot.material)
        color = ((style.VERMILLION, style.ORANGE), (style.BLUE, style.SKY))[i % 2][j % 2]
        marker = style.MARKERS[2 * i + j]
        looks = {"color": color, "ls": style.DASHES[j], "lw": style.LINE}
        label = f"{line.robot.name}, {line.robot.material}"
        for ax, quantity in zip(axes[:, column], (_sag, _beta), strict=True):
            ax.plot(*quantity(line.static), **looks, gid=f"static {label}")
            ax.plot(*quantity(line.settled), **points(color, marker, ms=4.6), gid=f"mujoco {label}")
    for column, height in enumerate(heights):
        for ax, value in zip(axes[:, column], (1e3 * PAPER_SAG, np.degrees(PAPER_TILT)), strict=True):
            ends = lines[0].static.commanded[[0, -1], 0]
            ax.axvspan(*ends, color="#f2f2f2", zorder=0, lw=0)
            ax.axhline(0, color=style.FAINT, lw=style.THIN, zorder=1)
            marks = (-value, -value) if ax is axes[0, column] else (value, -value)
            ax.plot(ends, marks, ls="none", marker="x", ms=8, mew=2, color=style.INK, zorder=7, gid="paper")
        axes[0, column].set_title(f"z = {height:g} m", fontweight="bold")
        axes[-1, column].set_xlabel("x where the platform rests [m]")
    axes[0, 0].set_ylabel("deviation in z [mm]")
    axes[1, 0].set_ylabel("rotation about y [°]")
    handles = []
    for i, layout in enumerate(layouts):
        for j, material in enumerate(materials):
            color = ((style.VERMILLION, style.ORANGE), (style.BLUE, style.SKY))[i % 2][j % 2]
            looks = points(color, style.MARKERS[2 * i + j]) | {"ls": style.DASHES[j], "color": color}
            handles.append(Line2D([], [], **looks, label=f"{layout}, {material}"))
    handles.append(Line2D([], [], ls="none", marker="x", ms=8, mew=2, color=style.INK, label="paper's text"))
    figure.legend(handles=handles, loc="outside upper left", ncols=5, columnspacing=1.2)
    return figure


@styled
def convergence(study: Convergence) -> Figure:
    """How often each solver finds rest, and how long it takes, against the cables' stiffness."""
    newton = study.solved["newton"].sum() / study.poses / len(study.axial_stiffness)
    figure = canvas(
        10.5,
        4.7,
        f"Stiff cables stop SciPy's solvers; Newton on the energy solves {100 * newton:.0f} % of the poses",
        f"{study.robot.name}: {study.poses} random commanded poses for each of {len(study.axial_stiffness)} "
        "stiffnesses. Solved: forces balance to 1e-6 of the weight where the solver stops.\n"
        "Time: median per pose, solved or not, with the range from the fastest to the slowest tenth, on the machine "
        "that drew this picture, one pose at a time through the Python interface.",
    )
    left, right = figure.subplots(1, 2)
    names = {"newton": "Newton (ours)", "fsolve": "SEECR, fsolve", "least_squares": "SEECR, least_squares"}
    looks = {"newton": (style.BLUE, 0), "fsolve": (style.VERMILLION, 1), "least_squares": (style.ORANGE, 2)}
    for method, solved in study.solved.items():
        color, number = looks[method]
        line = {"color": color, "ls": style.DASHES[number], "marker": style.MARKERS[number], "ms": 6}
        left.plot(study.axial_stiffness, 100 * solved / study.poses, label=names[method], gid=method, **line)
        milliseconds = 1e3 * study.seconds[method]
        low, middle, high = np.quantile(milliseconds, (0.1, 0.5, 0.9), axis=1)
        shift = 1.06 ** (number - 1)  # so that ranges do not hide one another
        right.errorbar(
            study.axial_stiffness * shift, middle, (middle - low, high - middle), label=names[method], capsize=3, **line
        )
    right.plot(
        study.axial_stiffness,
        1e3 * study.compiled_seconds,
        color=style.BLUE,
        lw=1.2,
        ls=style.DASHES[3],
        marker="D",
        mfc="white",
        label="Newton, all poses in one compiled call",
    )
    left.set(ylim=(-3, 106), ylabel="poses solved [%]", title="how often")
    right.set(yscale="log", ylabel="time per pose [ms]", title="how long")
    right.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    for ax in (left, right):
        ax.set(xscale="log", xlabel="axial stiffness EA [N]")
        ax.grid(axis="y", color=style.FAINT, lw=style.HAIR)
    left.legend(loc="lower left")
    right.legend(loc="upper center", bbox_to_anchor=(0.5, -0.16), ncols=2)
    return figure


@styled
def agreement(study: Sequence[Differences]) -> Figure:
    """How far the two roads are apart: the share of poses that differ by less than so much."""
    poses = sum(len(one.verdicts) for one in study)
    free, disagreeing = sum(int(one.free.sum()) for one in study), sum(one.disagreeing for one in study)
    verdict = "agree at every pose" if not disagreeing else f"disagree at {disagreeing} of {poses} poses"
    figure = canvas(
        10.8,
        4.7,
        f"Two roads that share no physics code {verdict}",
        f"Static solver (Newton) minus MuJoCo at {poses} random commanded poses, both materials; cumulative. Beyond the "
        "dashed line the two would count as different.\n"
        f"Crosses: {free} poses of a platform that hangs on two diagonal cables and can turn freely about them: every "
        "pose of a whole family is a rest, and each road stops at its own.",
    )
    panels = (
        ("position_errors", 1.0, 1e-6, "difference in position [m]"),
        ("rotation_errors", np.degrees(1.0), np.degrees(1e-5), "difference in rotation [°]"),
        ("tension_errors", 1.0, 1e-3, "largest difference in a tension [N]"),
    )
    colors = (style.BLUE, style.VERMILLION, style.GREEN, style.ORANGE, style.PURPLE)
    axes = figure.subplots(1, 3, sharey=True)
    for ax, (field, unit, tolerance, label) in zip(axes, panels, strict=True):
        for i, one in enumerate(study):
            values = unit * np.sort(getattr(one, field)[~one.free])
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
            if one.free.any():
                apart = unit * getattr(one, field)[one.free]
                ax.plot(apart, np.full(len(apart), 103.0), "x", color=colors[i % 5], ms=5, gid=f"{one.name} free")
        ax.axvline(tolerance, color=style.INK, lw=style.THIN, ls=(0, (5, 3)))
        ax.set(xscale="log", xlabel=label, ylim=(0, 106))
        ax.xaxis.set_minor_formatter(NullFormatter())
    axes[0].set_ylabel("poses that differ by less [%]")
    handles, labels = axes[0].get_legend_handles_labels()
    handles += [
        Line2D([], [], color=style.INK, lw=style.THIN, ls=(0, (5, 3)), label="tolerance"),
        Line2D([], [], color=style.MUTED, ls="none", marker="x", label="free to turn"),
    ]
    figure.legend(handles=handles, loc="outside upper left", ncols=7)
    return figure


# Parts


def _width(width: Width, title: str, projection: str | None) -> tuple[Figure, Axes, list[Axes]]:
    robot = width.poses.robot
    one = width.lines[0]
    figure = canvas(
        11.5,
        5.6,
        title,
        f"{robot.name}, {robot.mass:g} kg, commanded level. Left: with {_cable(robot)}. Right: tensions along "
        f"z = {one.height:g} m for {len(width.lines)} materials (assumed EA). {ROADS}",
    )
    grid = figure.add_gridspec(len(width.lines), 2, width_ratios=(1, 1))
    left = figure.add_subplot(grid[:, 0], projection=projection)
    first = figure.add_subplot(grid[0, 1])
    rest = [figure.add_subplot(grid[i, 1], sharex=first) for i in range(1, len(width.lines))]
    return figure, left, [first, *rest]


def _tensions(ax: Axes, line: Line, *, last: bool) -> None:
    """Each cable's tension against commanded x; cables that pull the same by symmetry share a line."""
    static, settled, robot = line.static, line.settled, line.robot
    middle = robot.frame[:, 0].mean()
    zones = drawing.draw_zones(ax, static)
    used = {True: 0, False: 0}
    for group in static.twins:
        on_left = bool(robot.exits[group[0], 0] < middle)
        number, used[on_left] = used[on_left], used[on_left] + 1
        color = style.LEFT if on_left else style.RIGHT
        cables = " and ".join(str(cable + 1) for cable in group)
        label = f"cable{'s' if len(group) > 1 else ''} {cables} ({'left' if on_left else 'right'})"
        ax.plot(
            static.commanded[:, 0],
            static.tensions[:, group[0]],
            color=color,
            ls=style.DASHES[number],
            label=label,
            gid=f"static {group[0]}",
        )
        for cable in group:
            ax.plot(
                settled.commanded[:, 0],
                settled.tensions[:, cable],
                **points(color, style.MARKERS[number + 2 * (not on_left)] if used[on_left] < 3 else "o", ms=4.2),
                gid=f"mujoco {cable}",
            )
    ax.set(ylabel="tension [N]", title=_cable(robot).capitalize())
    ax.set_xlim(static.commanded[0, 0], static.commanded[-1, 0])
    ax.set_ylim(bottom=min(-0.02 * ax.get_ylim()[1], 0))
    if last:
        ax.set_xlabel("commanded x [m]")
        handles, _ = ax.get_legend_handles_labels()
        ax.legend(
            handles=handles + [Line2D([], [], **points(style.INK, ms=4.2), label="MuJoCo, settled"), *zones],
            loc="upper center",
            bbox_to_anchor=(0.5, -0.26),
            ncols=3,
        )
    else:
        ax.tick_params(labelbottom=False)


def _balance(ax: Axes, balance: Balance, letter: str) -> None:
    robot = balance.robot
    drawing.draw_front(ax, robot)
    drawing.draw_cables(ax, robot, balance.position, balance.rotation, balance.slack)
    drawing.draw_platform(ax, robot, balance.position, balance.rotation, alpha=0.9)
    meeting, center = balance.intersection, balance.position
    for start, direction in zip(balance.starts, balance.directions, strict=True):
        reach = (robot.exits[:, 2].max() - start[2]) / direction[2]
        below = min(0.0, (meeting - start) @ direction - 0.03)
        ends = start + np.array([[below], [reach]]) * direction
        ax.plot(ends[:, 0], ends[:, 2], ls=(0, (6, 1.5, 1, 1.5)), lw=1.2, color=style.BLUE, zorder=5)
    ax.plot([center[0]] * 2, [-0.02, 0.5], ls=(0, (4, 2)), lw=1.1, color=style.VERMILLION, zorder=5)
    ax.annotate(
        "",
        (center[0], center[2] - 0.085),
        (center[0], center[2]),
        arrowprops={"arrowstyle": "-|>", "color": style.VERMILLION, "lw": 2, "shrinkA": 0, "shrinkB": 0},
        zorder=7,
    )
    ax.plot(center[0], center[2], "o", color=style.VERMILLION, ms=5, zorder=8)
    ax.plot(meeting[0], meeting[2], "D", color=style.BLUE, mec="white", ms=8, zorder=9, gid="meeting point")
    name = "H" if "horizontal" in robot.name else "V"
    if balance.at_rest:
        name = "they meet"
    ax.annotate(
        name, (meeting[0], meeting[2]), (9, -4), textcoords="offset points", fontweight="bold", color=style.BLUE
    )
    tilt = -np.degrees(np.arctan2(balance.rotation[0, 2], balance.rotation[2, 2]))
    state = f"at rest, rotation about y {-tilt:.1f}°" if balance.at_rest else "held level, each pair pulling equally"
    ax.set_title(f"({letter}) {robot.name}: {state}\n{_moment(balance)}")


def _moment(balance: Balance) -> str:
    if abs(balance.arm) < 1e-6:
        return "gravity passes through the meeting point: no moment"
    return (
        f"gravity passes {1e3 * abs(balance.arm):.0f} mm beside it: "
        f"{balance.robot.weight:.2f} N × {1e3 * abs(balance.arm):.0f} mm = {1e3 * abs(balance.moment):.0f} N mm"
    )


def _sag(rests: Rests) -> tuple[np.ndarray, np.ndarray]:
    return rests.positions[:, 0], 1e3 * (rests.positions - rests.commanded)[:, 2]


def _beta(rests: Rests) -> tuple[np.ndarray, np.ndarray]:
    return rests.positions[:, 0], np.degrees(rests.rotation_about_y)


def _headline(robot, tilt: float, slack: int) -> str:
    if slack:
        return f"{robot.name}: up to {tilt:.0f}° of tilt, and up to {slack} of {robot.cables} cables go slack"
    return f"{robot.name}: at most {tilt:.1g}° of tilt, and no cable goes slack" if tilt > 1e-3 else (
        f"{robot.name}: no tilt, and no cable goes slack"
    )


def _cable(robot) -> str:
    EA = robot.axial_stiffness[0]
    return f"{robot.material} cables (EA = {_newton(EA)})" if robot.material else f"cables with EA = {_newton(EA)}"


def _newton(force: float) -> str:
    return f"{force / 1e3:g} kN" if force >= 1e3 else f"{force:g} N"


def _power(value: float) -> str:
    return f"1e{int(np.ceil(np.log10(value))):d}" if value > 0 else "0"


__all__ = [
    "agreement",
    "convergence",
    "paper_line",
    "planar",
    "spatial",
    "tilt_condition",
    "two_cable_closed_form",
    "two_cable_manifold",
    "two_cable_poses",
]

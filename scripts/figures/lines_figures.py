"""The paper's figures of robots with four and eight cables, redrawn from results.

Lines are the static solver's, hollow points MuJoCo's. Only units and the numbers in titles are computed here.
"""

# pyright: reportArgumentType=false, reportAttributeAccessIssue=false, reportCallIssue=false
# matplotlib's stubs know neither keyword dictionaries nor the axes of its 3D plots.
from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

import robots_on_axes as drawing
from cdpr_sim.core.describe import describe_cables, newtons
from cdpr_sim.core.equilibrium_batch import EquilibriumBatch
from cdpr_sim.core.robot import Robot
from cdpr_sim.drawing import style
from cdpr_sim.drawing.figures import canvas, key, styled
from lines import PAPER_DEVIATION, PAPER_TILT, Line, Width, twins, zones
from robots_on_axes import legend_below, points

PAPER_FIGURES = {
    "planar-vertical": " (Paper, Fig. 7)",
    "planar-horizontal": " (Paper, Fig. 8)",
    "cogiro": " (Paper, Fig. 10)",
    "parallel": " (Paper, Fig. 11)",
}

NO_TILT = 1e-3
"""[°] Smaller tilts are called "no tilt" in a title."""

METHODS = "Lines: static solver (Newton). Hollow points: MuJoCo, settled."


@styled
def layouts(homes: Sequence[EquilibriumBatch]) -> Figure:
    """Fig. 6: the four layouts, each in equilibrium at the middle of its workspace, with cable numbers."""
    figure = canvas(
        style.WIDTH,
        7.6,
        "Four layouts: cables in vertical or horizontal parallelograms, and crossed",
        "Equilibrium of each platform, commanded to the middle of its workspace. Numbers: the cables, as in the other "
        "figures; blue: left, red: right. (Paper, Fig. 6)",
    )
    grid = figure.add_gridspec(2, 2)
    for place, equilibria, letter in zip(grid, homes, "abcd", strict=True):
        robot, home = equilibria.robot, ", ".join(f"{value:.3g}" for value in equilibria.problems.positions[0])
        in_space = robot.mobility == "spatial"
        ax = figure.add_subplot(place, projection="3d" if in_space else None)
        drawing.draw_frame(ax, robot)
        anchors = equilibria.positions[0] + robot.anchors @ equilibria.rotations[0].T
        names = _beside_exits(robot)
        for number, (start, end, name) in enumerate(zip(robot.exits, anchors, names, strict=True), start=1):
            color = style.LEFT if start[0] < robot.frame[:, 0].mean() else style.RIGHT
            drawing.plot(ax, np.stack([start, end]), color=color, lw=style.THIN, zorder=3)
            at = drawing.seen(ax, name) if in_space else name[[0, 2]]
            (ax.text2D if in_space else ax.text)(
                *at, str(number), color=color, fontsize=8, ha="center", va="center", transform=ax.transData
            )
        drawing.draw_platform(ax, robot, equilibria.positions[0], equilibria.rotations[0])
        ax.set_title(f"({letter}) {robot.name}, {robot.cables} cables, at ({home}) m", loc="left")
    figure.axes[0].legend(
        handles=[
            key("cable to the left", color=style.LEFT, lw=style.THIN),
            key("cable to the right", color=style.RIGHT, lw=style.THIN),
            key("exit", ls="none", marker="o", ms=3.5, color=style.INK),
            Patch(fc=style.PLATFORM, ec=style.INK, lw=style.HAIR, label="platform"),
        ],
        loc="lower left",
        bbox_to_anchor=(0.05, 0.05),
    )
    return figure


def _beside_exits(robot: Robot) -> np.ndarray:
    """Positions of cable numbers, (cables, 3) [m]: away from the other exit of a pair, or from the middle if planar."""
    size = 0.028 * np.linalg.norm(np.ptp(robot.frame, axis=0))
    if robot.mobility == "planar":
        outwards = np.sign(robot.exits[:, 0] - robot.frame[:, 0].mean())
        return robot.exits + size * outwards[:, None] * np.array([1.0, 0.0, 0.0])
    pairs = robot.exits.reshape(-1, 2, 3)
    outwards = (pairs - pairs.mean(1, keepdims=True)).reshape(-1, 3)
    outwards /= np.linalg.norm(outwards, axis=1, keepdims=True)
    return robot.exits + size * (1.2 * outwards + np.where(outwards[:, 2:] == 0, [0, 0, 0.8], 0))


@styled
def planar(width: Width) -> Figure:
    """Fig. 7 and 8: equilibria of a planar robot, and its cables' tensions along the width."""
    equilibria = width.poses
    commanded = equilibria.problems.positions
    heights = np.unique(commanded[:, 2])[::-1]
    figure, left, _ = _width(width, rows=len(heights))
    for ax, height in zip(left, heights, strict=True):
        drawing.draw_frame(ax, equilibria.robot)
        ax.set_title(f"commanded to z = {height:g} m")
        for row in np.flatnonzero(commanded[:, 2] == height):
            drawing.draw_pose(ax, equilibria, int(row))
        if ax is not left[-1]:
            ax.set_xlabel("")
            ax.tick_params(labelbottom=False)
    handles = drawing.pose_legend(slack=bool(equilibria.slack.any()))
    legend_below(left[-1], handles, 0.24)
    return figure


@styled
def spatial(width: Width) -> Figure:
    """Fig. 10 and 11: equilibria of a spatial robot, its feasible workspace, and tensions along the width."""
    equilibria = width.poses
    figure, (left,), right = _width(width, projection="3d")
    drawing.draw_frame(left, equilibria.robot)
    handles = drawing.pose_legend(slack=bool(equilibria.slack.any()))
    if len(width.workspace):
        left.plot(
            *np.vstack([width.workspace, width.workspace[:1]]).T, color=style.GREEN, lw=style.LINE, gid="feasible"
        )
        handles.append(key("static feasible workspace", color=style.GREEN, lw=style.LINE))
    for row in range(len(equilibria)):
        drawing.draw_pose(left, equilibria, row)
    legend_below(left, handles, -0.06)
    for ax, one in zip(right, width.lines, strict=True):
        feasible = width.feasible(one.height)
        if feasible is not None:
            looks = {"color": style.GREEN, "lw": 4, "clip_on": False, "gid": "feasible"}
            ax.plot(feasible, [1, 1], transform=ax.get_xaxis_transform(), **looks)
    return figure


@styled
def paper_line(lines: Sequence[Line]) -> Figure:
    """Fig. 12: deviation in z and rotation about y along the paper's trajectory."""
    heights = sorted({line.height for line in lines})
    layouts = list(dict.fromkeys(line.robot.name for line in lines))
    materials = {line.robot.material: line.robot.axial_stiffness[0] for line in lines}
    start, end = lines[0].static.problems.positions[[0, -1]]
    count = sum(len(line.settled) for line in lines)
    stiffness = ", ".join(f"{material} {newtons(EA)}" for material, EA in materials.items())
    extremes = []
    for layout in layouts:
        own = [line.static for line in lines if line.robot.name == layout]
        tilt = max(np.abs(_beta(equilibria)[1]).max() for equilibria in own)
        down = max(-_deviation(equilibria)[1].min() for equilibria in own)
        verbs = ("tilts ", "deviates ") if not extremes else ("", "")
        extremes.append(f"{layout} {verbs[0]}{tilt:.2g}° and {verbs[1]}{down:.2g} mm downwards")
    figure = canvas(
        style.WIDTH,
        6.6,
        f"Along the paper's line: {', '.join(extremes)}",
        f"DemoBot commanded level from x = {start[0]:g} to {end[0]:g} m (grey band) at y = {start[1]:g} m; the title "
        f"states the largest values. {METHODS} {count} points. EA is assumed ({stiffness}): the paper gives none."
        " Black bars: values reported in the paper for the parallel layout at both ends, read from its text "
        "(“approximately 20°”, “about 15 mm”; taken as downwards) and not from its data. (Paper, Fig. 12)",
    )
    axes = figure.subplots(2, len(heights), sharex=True, sharey="row", squeeze=False)
    for line in lines:
        column = heights.index(line.height)
        i, j = layouts.index(line.robot.name), list(materials).index(line.robot.material)
        color, looks, marker = _series(i, j)
        label = f"{line.robot.name}, {line.robot.material}"
        for ax, quantity in zip(axes[:, column], (_deviation, _beta), strict=True):
            ax.plot(*quantity(line.static), color=color, **looks, gid=f"static {label}")
            ax.plot(*quantity(line.settled), **points(color, marker, ms=4.6), gid=f"mujoco {label}")
    for column, height in enumerate(heights):
        for ax, value in zip(axes[:, column], (1e3 * PAPER_DEVIATION, np.degrees(PAPER_TILT)), strict=True):
            ax.axvspan(start[0], end[0], color="#f2f2f2", zorder=0, lw=0)
            ax.axhline(0, color=style.FAINT, lw=style.THIN, zorder=1)
            marks = (-value, -value) if ax is axes[0, column] else (value, -value)
            for x, inwards, mark in zip((start[0], end[0]), (0.05, -0.05), marks, strict=True):
                ax.plot([x, x + inwards], [mark, mark], **style.REPORTED, gid="paper")
        axes[0, column].set_title(f"z = {height:g} m", fontweight="bold")
        axes[-1, column].set_xlabel("x of the platform [m]")
    axes[0, 0].set_ylabel("deviation in z [mm]")
    axes[1, 0].set_ylabel("rotation about y [°]")
    handles = []
    for i, layout in enumerate(layouts):
        for j, material in enumerate(materials):
            color, looks, marker = _series(i, j)
            looks = points(color, marker) | {"ls": "-", "color": color} | looks
            handles.append(key(f"{layout}, {material}", **looks))
    handles.append(key("reported in the paper's text", **style.REPORTED))
    axes[0, 0].legend(handles=handles, loc="lower center")
    return figure


# Parts


def _series(layout: int, material: int) -> tuple[str, dict, str]:
    """Colour, line and marker of Fig. 12's series: a hue per layout, dark for one material, light for the other."""
    color = ((style.VERMILLION, style.ORANGE), (style.BLUE, style.SKY))[layout % 2][material % 2]
    return color, (style.DARK, style.LIGHT)[material % 2], style.MARKERS[2 * layout + material]


def _width(width: Width, *, rows: int = 1, projection: str | None = None) -> tuple[Figure, list, list[Axes]]:
    """A canvas with ``rows`` axes on the left, for poses, and one per material on the right, with its tensions."""
    robot, one = width.poses.robot, width.lines[0]
    commanded = np.concatenate(
        [width.poses.problems.positions, *(line.static.problems.positions for line in width.lines)]
    )
    heights = " and ".join(f"{height:g}" for height in np.unique(commanded[:, 2]))
    drawn = f"x = {commanded[:, 0].min():g} to {commanded[:, 0].max():g} m, z = {heights} m"
    if robot.mobility == "spatial":
        drawn += f", y = {commanded[0, 1]:g} m"
    figure = canvas(
        style.WIDTH,
        7.6 if rows > 1 else 6.2,
        _headline(width),
        f"{robot.description}, {robot.mass:g} kg, commanded level. Left: {len(width.poses)} poses with "
        f"{describe_cables(robot)}. Right: tensions along z = {one.height:g} m, for each material (assumed EA). "
        f"The title's numbers refer to what is drawn here: {drawn}. {METHODS}" + PAPER_FIGURES.get(robot.name, ""),
    )
    columns = figure.add_gridspec(1, 2, width_ratios=(0.92, 1))
    left, right = columns[0].subgridspec(rows, 1), columns[1].subgridspec(len(width.lines), 1)
    poses = [figure.add_subplot(left[i], projection=projection) for i in range(rows)]
    tensions = [figure.add_subplot(place) for place in right]
    zones_named: dict[str, Patch] = {}
    for ax, line in zip(tensions, width.lines, strict=True):
        _tensions(ax, line, zones_named, last=line is width.lines[-1])
    return figure, poses, tensions


def _tensions(ax: Axes, line: Line, zones_named: dict[str, Patch], *, last: bool) -> None:
    """Tension of each cable over commanded x; cables with equal tensions by symmetry share a line.

    The legend of the last axes names the zones of all axes, which ``zones_named`` collects.
    """
    static, settled, robot = line.static, line.settled, line.robot
    commanded, middle = static.problems.positions[:, 0], robot.frame[:, 0].mean()
    shaded = _draw_zones(ax, zones(static), robot.cables)
    zones_named.update({str(patch.get_label()): patch for patch in shaded})
    used = {True: 0, False: 0}  # line styles, by side
    handles: list[Line2D] = []
    for group in twins(static):
        on_left = bool(robot.exits[group[0], 0] < middle)
        number = used[on_left] % len(style.DASHES)
        used[on_left] += 1
        color = style.LEFT if on_left else style.RIGHT
        cables = " and ".join(str(cable + 1) for cable in group)
        label = f"cable{'s' if len(group) > 1 else ''} {cables} ({'left' if on_left else 'right'})"
        marker = points(color, style.MARKERS[not on_left], ms=4.2)
        line_style = style.DASHES[number]
        ax.plot(commanded, static.tensions[:, group[0]], color=color, ls=line_style, gid=f"static {group[0]}")
        for cable in group:
            ax.plot(settled.problems.positions[:, 0], settled.tensions[:, cable], **marker, gid=f"mujoco {cable}")
        handles.append(key(label, **marker | {"ls": line_style, "color": color}))
    ax.set(ylabel="tension [N]", title=describe_cables(robot))
    ax.set_xlim(commanded[0], commanded[-1])
    ax.set_ylim(bottom=min(-0.02 * ax.get_ylim()[1], 0))
    if last:
        ax.set_xlabel("commanded x [m]")
        legend_below(ax, [*handles, *(zones_named[label] for label in sorted(zones_named))], 0.24)
    else:
        ax.tick_params(labelbottom=False)


def _deviation(equilibria: EquilibriumBatch) -> tuple[np.ndarray, np.ndarray]:
    """x [m] and deviation in z [mm]."""
    return equilibria.positions[:, 0], 1e3 * equilibria.deviation[:, 2]


def _beta(equilibria: EquilibriumBatch) -> tuple[np.ndarray, np.ndarray]:
    """x [m] and rotation about y [°]."""
    return equilibria.positions[:, 0], np.degrees(equilibria.euler[:, 1])


def _headline(width: Width) -> str:
    """Title: largest tilt and largest number of slack cables over drawn poses and lines."""
    robot, everything = width.poses.robot, [width.poses, *(line.static for line in width.lines)]
    tilt = np.degrees(max(equilibria.tilt.max() for equilibria in everything))
    slack = max(int(equilibria.slack.sum(1).max()) for equilibria in everything)
    tilts = f"up to {tilt:.2g}° of tilt" if tilt > NO_TILT else "no tilt"
    cables = f"up to {slack} of {robot.cables} cables slack" if slack else "no cable slack"
    return f"{robot.name}: {tilts}, and {cables}"


def _draw_zones(ax: Axes, zones: Sequence[tuple[float, float, int]], cables: int) -> list[Patch]:
    """Shade zones (from, to, number of slack cables) along x; return a legend entry for each number."""
    counts = sorted({slack for *_, slack in zones if slack})
    looks = {}
    for count in counts:
        fill, hatch = style.ZONES[0] if count <= cables // 4 else style.ZONES[1]
        looks[count] = {"fc": fill, "ec": style.ZONE_HATCH, "hatch": hatch, "lw": 0}
    for start, end, slack in zones:
        if slack:
            span = ax.axvspan(start, end, zorder=0, **looks[slack])
            span.set_gid(f"zone-{slack}-slack")
    return [Patch(**look, label=f"{count} cable{'s' if count > 1 else ''} slack") for count, look in looks.items()]

"""Presentation of optimised layouts: figures of merit, figures, both robots driven side by side."""

# pyright: reportArgumentType=false, reportAttributeAccessIssue=false, reportCallIssue=false
# matplotlib's stubs know neither keyword dictionaries nor the axes of its 3D plots.

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from cdpr_sim.analysis.clearance import SEARCH_POINTS, clearances
from cdpr_sim.analysis.workspace.grids import plane
from cdpr_sim.analysis.workspace.sweep import sweep
from cdpr_sim.core.equilibrium_batch import EquilibriumBatch
from cdpr_sim.core.errors import InvalidInput
from cdpr_sim.core.robot import Robot
from cdpr_sim.core.trajectory import Trajectory
from cdpr_sim.crosscheck.layout_validation import LayoutValidation, ValidatedRobot
from cdpr_sim.design.front import Front
from cdpr_sim.drawing import style
from cdpr_sim.drawing.axes import canvas, draw_frame, draw_pose, key, slack_key, styled
from cdpr_sim.drawing.maps import outer_edges
from cdpr_sim.physics.drive import drive
from cdpr_sim.physics.settle import settle_many
from cdpr_sim.studies.robot_summary import shapes_of

MAP_POINTS = 121
"""Poses along the longer side of a map of tilt."""

CLEARANCE_POINTS = 61
"""Poses along the longer side of a map of distances."""

WIDTH, HEIGHT = 9.6, 7.4
"""Of the figure of two layouts [inch]."""

FLAT = 0.2
"""Depth, as a fraction of the longest edge, below which a robot has no room for tick labels along y."""

MOST_DEGREES = 45.0
"""Upper end of the tilt scale [°]."""


def numbers(validation: LayoutValidation) -> list[tuple[str, str, str]]:
    """(label, before, after) as text: in MuJoCo, at the poses of the optimisation and midway between them."""
    of, distance = validation.layout.objective, validation.layout.largest_displacement

    def column(side: ValidatedRobot) -> list[str]:
        if not side.settled.converged.any():
            return ["no equilibrium at any pose", *[""] * 4, f"0 of {len(side.agrees)}", ""]
        tilts, deviations = np.degrees(_tilt(side)), 1e3 * _deviation(side)
        return [
            of.shown(side.score),
            f"{np.nanmax(tilts):.3g}°, {np.nanmean(tilts):.3g}°",
            f"{np.nanmax(deviations):.3g} mm, {np.nanmean(deviations):.3g} mm",
            str(side.settled.slack[side.settled.converged].sum(-1).max(initial=0)),
            _tensions(side.settled),
            f"{side.agrees.sum()} of {len(side.agrees)}",
            "" if side is validation.before else f"{1e3 * distance:.3g} mm",
        ]

    labels = [
        f"{of.name}, in MuJoCo", "worst, mean tilt", "worst, mean deviation", "most slack cables",
        "lowest, highest tension", "Newton and MuJoCo agree at", "largest displacement of a point",
    ]  # fmt: skip
    return list(zip(labels, column(validation.before), column(validation.after), strict=True))


def _tilt(side: ValidatedRobot) -> np.ndarray:
    return np.where(side.settled.converged, side.settled.tilt, np.nan)


def _deviation(side: ValidatedRobot) -> np.ndarray:
    return np.where(side.settled.converged, np.linalg.norm(side.settled.deviation, axis=-1), np.nan)


def _tensions(equilibria: EquilibriumBatch) -> str:
    found = equilibria.tensions[equilibria.converged]
    return f"{found.min(initial=np.inf):.3g} N, {found.max(initial=0):.3g} N"


def pareto_picture(front: Front) -> Figure:
    """Figure of a Pareto front."""
    one, other = front.objectives
    sizes = np.array([one.size, other.size])
    labels = tuple(f"{one.name} [{one.unit}]" if one.unit else one.name for one in front.objectives)
    given = front.before / sizes
    return draw_front(
        [(f"NSGA-II, {front.layouts_evaluated:,} layouts", front.scores / sizes)],
        (labels[0], labels[1]),
        f"{front.given.name}: {one.name} against {other.name}",
        f"Each point is a Pareto-optimal layout; by statics, in {len(front.cases)} cases.",
        given=None if np.isnan(given).any() else (float(given[0]), float(given[1])),
    )


def driven(
    validation: LayoutValidation, states: int, seconds: float, drive_seconds: float | None = None
) -> list[Trajectory]:
    """Both robots driven by their winches from pose to pose in MuJoCo, for a video side by side.

    Robots whose cables have mass are settled at each state, for a video of ``seconds``. ``drive_seconds`` is the
    duration of the drive; default: quasi-static.
    """
    found = validation.layout
    each = len(found.cases) // int(np.prod(found.cases.shape, dtype=int))
    line = found.cases.positions[::each]
    motions = []
    for robot, what in ((found.given, "before"), (found.robot, "after")):
        named = robot.replace(name=f"{found.given.name}, {what}")
        if robot.cabling.massless:
            motions.append(drive(named, line, seconds=drive_seconds, states=states))
        else:
            legs = np.linspace(0, len(line) - 1, states)
            at = np.column_stack([np.interp(legs, np.arange(len(line)), axis) for axis in line.T])
            motions.append(Trajectory.through(settle_many(named, at), np.linspace(0, seconds, states)))
    return motions


# Figures


@styled
def picture(validation: LayoutValidation) -> Figure:
    """Before and after, a column each: the robot in 3D with its changes, a map of tilt, and figures of merit.

    The robots are drawn at the pose where the given one tilts most; the maps are in the plane through the middle of the
    poses.
    """
    found, rows = validation.layout, numbers(validation)
    sides, robots = (validation.before, validation.after), (found.given, found.robot)
    asked = found.cases.positions
    across = float(np.median(asked[:, 1]))
    axes = plane("xz", across, MAP_POINTS, [found.given])
    extent = (*outer_edges(axes["x"]), *outer_edges(axes["z"]))
    maps = [
        np.degrees(sweep(robot, axes, quantities=["tilt"], chunk=None)["tilt"].values.squeeze()) for robot in robots
    ]
    most = min(max(float(np.nan_to_num(one).max()) for one in maps), MOST_DEGREES)
    tilts = _tilt(validation.before)
    worst = 0 if np.isnan(tilts).all() else int(np.nanargmax(tilts))
    before, after = (found.objective.shown(side.score) for side in sides)
    figure = canvas(
        WIDTH,
        HEIGHT,
        f"{found.given.name}: {found.objective.name} {before} → {after}",
        "Robots settled in MuJoCo at the pose where the given one tilts most. Maps: statics, commanded level at "
        f"y = {across:.4g} m; grey: no equilibrium; the scale ends at 45° at most. Numbers: MuJoCo, at the poses of "
        f"the optimisation and midway between them, {len(validation.cases)} cases. They do not hold for other poses, "
        "loads and cables.",
    )
    grid = figure.add_gridspec(4, 2, height_ratios=[0.12, 2.6, 1.5, 0.22 * len(rows) + 0.1])
    image, panels = None, []
    for column, (side, tilt, name) in enumerate(zip(sides, maps, ("before", "after"), strict=True)):
        space, shapes = figure.add_subplot(grid[1, column], projection="3d"), shapes_of(side.settled)
        draw_frame(space, side.settled.robot)
        _reach(space, robots)
        if column:
            _draw_moves(space, *robots)
        draw_pose(space, side.settled, worst, None if shapes is None else shapes[worst])
        for drawn in space.get_children():
            drawn.set_clip_on(False)
            drawn.set_in_layout(False)
        space.set_title(name, fontsize=11, fontweight="bold")
        panel = figure.add_subplot(grid[2, column])
        panels.append(panel)
        image = panel.imshow(
            tilt.T, origin="lower", extent=extent, aspect="equal", cmap=style.MAP_TILT, vmin=0, vmax=max(most, 1e-3),
            interpolation="nearest",
        )  # fmt: skip
        panel.set_facecolor(style.MAP_UNSOLVED)
        panel.plot(asked[:, 0], asked[:, 2], ".", ms=3, color=style.SKY, mec="white", mew=0.3)
        panel.set(xlabel="commanded x [m]", ylabel="z [m]", xlim=extent[:2], ylim=extent[2:])
    figure.colorbar(image, ax=panels, label="tilt [°]", shrink=0.9, pad=0.015)
    _write_numbers(figure.add_subplot(grid[3, :]), rows)
    handles = [
        key("exit moved, from its previous position", color=style.PURPLE, lw=1.6, marker="o", ms=4, mfc="white"),
        slack_key(),
        key("pose of the optimisation", color=style.SKY, ls="none", marker="o", ms=4),
    ]
    legend = figure.add_subplot(grid[0, :])
    legend.axis("off")
    legend.legend(handles=handles, loc="center", ncols=3)
    return figure


def _reach(space, robots: Sequence[Robot]) -> None:
    """Set the same limits for both robots, with all exits inside."""
    points = np.vstack([one.frame for one in robots] + [one.exits for one in robots])
    lower, upper = points.min(0), points.max(0)
    wide = np.maximum(upper - lower, 0.05 * (upper - lower).max())
    middle = (lower + upper) / 2
    space.set(**{f"{axis}lim": middle[i] + wide[i] * np.array([-0.5, 0.5]) for i, axis in enumerate("xyz")})
    space.set_box_aspect(tuple(wide), zoom=1.1)
    if wide[1] < FLAT * wide.max():
        space.set_yticks([])
        space.set_ylabel("")


def _draw_moves(space, before: Robot, after: Robot) -> None:
    for start, end in zip(before.exits, after.exits, strict=True):
        if not np.array_equal(start, end):
            space.plot(*np.array([start, end]).T, color=style.PURPLE, lw=1.6)
            space.plot(*start[:, None], "o", ms=4, mfc="white", mec=style.PURPLE)


def _write_numbers(ax: Axes, numbers: Sequence[tuple[str, str, str]]) -> None:
    ax.axis("off")
    table = ax.table(
        [list(row) for row in numbers], colLabels=["", "before", "after"], cellLoc="right", loc="center",
        colWidths=[0.5, 0.2, 0.2], edges="horizontal",
    )  # fmt: skip
    table.auto_set_font_size(value=False)
    table.set_fontsize(9)
    table.scale(1, 1.15)
    for (line, column), cell in table.get_celld().items():
        cell.set_edgecolor(style.FAINT)
        if column == 0:
            cell.set_text_props(ha="left")
        if line == 0:
            cell.set_text_props(fontweight="bold")


@styled
def clearance_map(robot: Robot, name: str, at: float | None, enough: float, fitting: float | None) -> Figure:
    """Map of the interference-free workspace: the smallest distance over a plane, and where it is sufficient.

    Args:
        robot: the robot.
        name: of the plane: "xz", "xy" or "yz".
        at: position of the plane [m]; default: the middle.
        enough: a smaller distance is interference [m].
        fitting: length ignored at both ends of each cable [m].

    Raises:
        InvalidInput: no equilibrium in the plane.
    """
    axes = plane(name, at, CLEARANCE_POINTS, [robot])
    grid = np.stack(np.meshgrid(*axes.values(), indexing="ij"), axis=-1)
    distances = clearances(robot, grid, fitting=fitting, points=SEARCH_POINTS)
    if np.isnan(distances.least).all():
        raise InvalidInput(f"plane: found no pose with an equilibrium of {robot.name!r}, expected one within its reach")
    (normal,), (first, second) = set("xyz") - set(name), sorted(name)
    least = np.take(distances.least, 0, axis="xyz".index(normal))
    nearest = tuple(int(i) for i in np.unravel_index(np.nanargmin(distances.least), distances.least.shape))
    extent = (*outer_edges(axes[first]), *outer_edges(axes[second]))
    wide, high = extent[1] - extent[0], extent[3] - extent[2]
    figure = canvas(
        7.2,
        1.9 + 5.4 * min(high / wide, 1.2),
        f"{robot.name}: interference-free at {distances.free(enough).mean():.0%} of these poses",
        "Smallest distance between centre lines of cables, the platform and the frame at equilibrium, at "
        f"{normal} = {float(axes[normal][0]):.4g} m; {1e3 * distances.fitting:.3g} mm at both ends of each cable "
        f"ignored. Smallest: {distances.nearest(nearest)}.",
    )
    ax = figure.add_subplot()
    image = ax.imshow(
        1e3 * least.T, origin="lower", extent=extent, cmap=style.STIFFNESS_MAP, vmin=0, interpolation="nearest"
    )  # fmt: skip
    ax.set_facecolor(style.MAP_UNSOLVED)
    if (least <= enough).any():
        near = np.where(least <= enough, 1.0, np.nan)
        ax.imshow(
            near.T, origin="lower", extent=extent, cmap=ListedColormap([style.VERMILLION]), interpolation="nearest"
        )  # fmt: skip
        label = f"below {1e3 * enough:g} mm" if enough else "interference: distance zero"
        figure.legend(handles=[Patch(fc=style.VERMILLION, label=label)], loc="outside upper right")
    ax.set(xlabel=f"commanded {first} [m]", ylabel=f"commanded {second} [m]", aspect="equal")
    figure.colorbar(image, ax=ax, label="smallest distance [mm]", shrink=0.9)
    return figure


@styled
def draw_front(
    fronts: Sequence[tuple[str, Float[np.ndarray, "layouts 2"]]],
    axes: tuple[str, str],
    title: str,
    caption: str,
    given: tuple[float, float] | None = None,
    confirmed: Float[np.ndarray, "layouts 2"] | None = None,
) -> Figure:
    """Pareto front of two objectives.

    Args:
        fronts: (label, values) of each series, in the units of ``axes``.
        axes: their labels.
        title: above.
        caption: below.
        given: objectives of the given robot.
        confirmed: objectives by MuJoCo, hollow points.
    """
    figure = canvas(7.2, 4.4, title, caption)
    ax = figure.add_subplot()
    looks = zip((style.BLUE, style.VERMILLION, style.GREEN), style.DASHES, style.MARKERS, strict=False)
    for (name, numbers), (color, dash, marker) in zip(fronts, looks, strict=False):
        ax.plot(*numbers[np.argsort(numbers[:, 0])].T, color=color, ls=dash, marker=marker, ms=4, label=name)
    if confirmed is not None:
        ax.plot(*confirmed.T, "o", ms=8, mfc="none", mec=style.INK, mew=0.9, label="MuJoCo, at twice as many poses")
    if given is not None:
        ax.plot(*given, "D", ms=7, color=style.INK, label="as given")
    ax.set(xlabel=axes[0], ylabel=axes[1])
    ax.set_ylim(bottom=0)
    ax.grid(visible=True)
    ax.legend()
    return figure

"""Presentation of optimised layouts: figures of merit, figures, both robots driven side by side."""

# pyright: reportArgumentType=false, reportAttributeAccessIssue=false, reportCallIssue=false
# matplotlib's stubs know no keyword dictionaries, and mujoco ships none for its compiled modules.

from __future__ import annotations

from collections.abc import Mapping, Sequence

import mujoco
import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from scipy.spatial.transform import RigidTransform

from cdpr_sim.analysis.clearance import SEARCH_POINTS, clearances
from cdpr_sim.analysis.workspace.grids import plane
from cdpr_sim.core.cable import PROPERTIES
from cdpr_sim.core.equilibrium_batch import EquilibriumBatch
from cdpr_sim.core.errors import InvalidInput
from cdpr_sim.core.robot import Robot
from cdpr_sim.core.robot_batch import RobotBatch
from cdpr_sim.core.trajectory import Trajectory
from cdpr_sim.crosscheck.layout_validation import WORSE, LayoutValidation, ValidatedRobot, mapped, values_of
from cdpr_sim.design.front import Front
from cdpr_sim.design.layout_equilibria import solve_layouts
from cdpr_sim.design.layout_result import LayoutResult
from cdpr_sim.design.objectives import Objective
from cdpr_sim.drawing import still, style
from cdpr_sim.drawing.figures import canvas, key, legend_above, styled
from cdpr_sim.drawing.maps import outer_edges
from cdpr_sim.drawing.video.frame_layout import nice_above
from cdpr_sim.drawing.video.scene import Stage
from cdpr_sim.physics.drive import drive
from cdpr_sim.physics.settle import settle_many
from cdpr_sim.report.robot_summary import shapes_of

MAP_POINTS = 121
"""Poses along the longer side of a map of an objective."""

CLEARANCE_POINTS = 61
"""Poses along the longer side of a map of distances."""

WHOLE, CLOSE_UP = (900, 620), (450, 620)
"""[pixel] Width and height of the pictures of robots and of the platform, which are shown at half the size."""

MOST_DEGREES = 45.0
"""Upper end of the tilt scale [°]."""


DIGITS = 3
"""Of numbers in the picture."""


def numbers(validation: LayoutValidation) -> list[tuple[str, str, str]]:
    """(label, before, after) as text: in MuJoCo, at the poses of the optimisation and midway between them."""
    of, distance = validation.layout.objective, validation.layout.largest_displacement
    worse = {name: f" {WORSE}" for name in validation.worse}

    def column(side: ValidatedRobot) -> list[str]:
        if not side.settled.converged.any():
            return ["no equilibrium at any pose", *[""] * 4, f"0 of {len(side.agrees)}", ""]
        tilts, deviations = np.degrees(_tilt(side)), 1e3 * _deviation(side)
        note = (lambda name: "") if side is validation.before else (lambda name: worse.get(name, ""))
        return [
            of.shown(side.score, DIGITS),
            f"{_short(np.nanmax(tilts))}°, {_short(np.nanmean(tilts))}°{note('worst tilt')}",
            f"{_short(np.nanmax(deviations))} mm, {_short(np.nanmean(deviations))} mm{note('worst deviation')}",
            f"{side.settled.slack[side.settled.converged].sum(-1).max(initial=0)}{note('most slack cables')}",
            _tensions(side.settled),
            f"{side.agrees.sum()} of {len(side.agrees)}",
            "" if side is validation.before else f"{1e3 * distance:.3g} mm",
        ]

    labels = [
        f"{of.name}, in MuJoCo", "worst, mean tilt", "worst, mean deviation", "most slack cables",
        "lowest, highest tension", "Newton and MuJoCo agree at", "largest displacement of a point",
    ]  # fmt: skip
    return list(zip(labels, column(validation.before), column(validation.after), strict=True))


def _short(number: float) -> str:
    """With few digits; what is rounding is 0."""
    return f"{round(float(number), 6):.{DIGITS}g}"


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
    """Before and after, a column each: the robot in 3D with its changes, a map of the objective, and figures of merit.

    The robots are drawn at the pose where the given one is worst; the maps are in the plane through that pose. Points
    of the platform that moved are drawn on the platform, enlarged, in a third column.
    """
    found, rows = validation.layout, numbers(validation)
    sides, robots = (validation.before, validation.after), (found.given, found.robot)
    goal, moved = mapped(found.objective), _moved(*robots)
    worst = _worst(validation.before.each, goal)
    at = validation.cases.positions[worst]
    axes = plane("xz", float(at[1]), MAP_POINTS, [found.given])
    extent = (*outer_edges(axes["x"]), *outer_edges(axes["z"]))
    maps = [objective_map(found, robot, axes) / goal.size for robot in robots]
    values = np.nan_to_num(maps)
    most = min(float(values.max()), MOST_DEGREES if goal.unit == "°" else np.inf)
    least = min(0.0, float(values.min()))
    before, after = (found.objective.shown(side.score, DIGITS) for side in sides)
    title = f"{found.given.name}: {found.objective.name} {before} → {after}"
    highest = nice_above(float(np.nan_to_num([side.settled.tensions[worst] for side in sides]).max()))
    stages = [_stage(side, worst, highest) for side in sides]
    figure = canvas(style.WIDTH, 8.0, title, _caption(validation, goal, at, highest))
    on_platform = [one for one in moved if one[-1]]
    handles = [
        *(key(f"{name} moved, from its previous position", **_MOVED, **looks) for name, looks, *_ in moved),
        *(key(f"{name} changed", ls="none") for name in _changed(*robots)),
        *(
            [key("slack cable", color=style.SLACK_COLOR)]
            if any(one.settled.slack[worst].any() for one in sides)
            else []
        ),
        key("pose of the optimisation", **_POSE),
        key("pose drawn above", **_DRAWN),
    ]
    ratios = {
        "height_ratios": [2.6, 1.5, 0.22 * len(rows) + 0.1],
        "width_ratios": [2, 2, 1][: 2 + bool(on_platform)],
    }
    body = legend_above(figure, handles, 3, share=0.08)
    grid = body.subgridspec(3, 2 + bool(on_platform), hspace=0.06, **ratios)
    image, panels = None, []
    camera = next((stage.whole(WHOLE[0] / WHOLE[1], *robots) for stage in stages if stage), None)
    for column, (stage, one, name) in enumerate(zip(stages, maps, ("before", "after"), strict=True)):
        space = _draw_robot(figure.add_subplot(grid[0, column]), stage, camera, WHOLE, name)
        if column and camera:
            _draw_moves(space, camera, [each for each in moved if not each[-1]])
        panel = figure.add_subplot(grid[1, column])
        panels.append(panel)
        image = panel.imshow(
            one.T, origin="lower", extent=extent, aspect="equal",
            cmap=style.STIFFNESS_MAP if goal.largest else style.MAP_TILT, vmin=least, vmax=max(most, least + 1e-3),
            interpolation="nearest",
        )  # fmt: skip
        panel.set_facecolor(style.MAP_UNSOLVED)
        poses = found.cases.positions[np.isclose(found.cases.positions[:, 1], at[1])]
        panel.plot(poses[:, 0], poses[:, 2], **_POSE)
        panel.plot(at[:1], at[2:], **_DRAWN)
        panel.set(xlabel="commanded x [m]", ylabel="z [m]", xlim=extent[:2], ylim=extent[2:])
    label = f"{goal.quantity} [{goal.unit}]" if goal.unit else goal.quantity
    figure.colorbar(image, ax=panels, label=label, shrink=0.9, pad=0.015)
    if on_platform:
        stage = stages[1]
        camera = still.enlarge(stage) if stage else None
        space = _draw_robot(figure.add_subplot(grid[0, 2]), stage, camera, CLOSE_UP, "platform, enlarged")
        if stage and camera:
            _draw_moves(space, camera, on_platform, stage.trajectory.poses[0])
    _write_numbers(figure.add_subplot(grid[2, :]), rows)
    return figure


_POSE = {"ls": "none", "marker": "o", "ms": 4.5, "color": style.SKY, "mec": "white", "mew": 0.5, "clip_on": False}
_DRAWN = {"ls": "none", "marker": "s", "ms": 6, "mfc": "none", "mec": style.GREEN, "mew": 1.5, "clip_on": False}
_MOVED = {"lw": 1.6, "ms": 4, "mfc": "white"}


def _stage(side: ValidatedRobot, case: int, highest: float) -> Stage | None:
    """The robot as it has settled in this case, in the scene of videos; None where MuJoCo has no pose.

    Cables are darkest at the highest tension.
    """
    settled, rows, shapes = side.settled, np.array([case]), shapes_of(side.settled)
    if not np.isfinite(settled.positions[case]).all():
        return None
    poses, lengths, tensions = settled.poses[rows], settled.lengths[rows], settled.tensions[rows]
    state = Trajectory.of(settled.problems.take(rows), np.zeros(1), poses, lengths, tensions)
    stage = Stage(state, largest_tension=highest, shapes=None if shapes is None else shapes[rows])
    stage.set(0)
    return stage


def _draw_robot(
    ax: Axes, stage: Stage | None, camera: mujoco.MjvCamera | None, size: tuple[int, int], title: str
) -> Axes:
    still.of_pixels(ax, *size)
    if stage is None:
        ax.text(size[0] / 2, size[1] / 2, "no equilibrium", ha="center", color=style.MUTED)
    else:
        still.show(ax, stage, camera, "antialiased")
    ax.set_aspect("equal")
    ax.set_title(title, fontweight="bold")
    return ax


def _caption(validation: LayoutValidation, goal: Objective, at: np.ndarray, highest: float) -> str:
    """What is worse than before, and what the parts of the picture show."""
    cases, point = validation.cases, ", ".join(f"{x:.4g}" for x in at)
    frame = " × ".join(f"{edge:.3g}" for edge in np.ptp(validation.layout.given.frame, axis=0))
    several = f", {'smallest' if goal.largest else 'largest'} of {cases.per_pose} cases" if cases.per_pose > 1 else ""
    ends = "; the scale ends at 45° at most" if goal.unit == "°" else ""
    return " ".join([
        *validation.side_effects,
        f"Robots in a frame of {frame} m, settled in MuJoCo at the pose where the {goal.quantity} of the given one is "
        f"worst, ({point}) m; cables: teal without tension to purple with {highest:g} N; grey box: commanded pose. "
        f"Maps: {goal.quantity} by statics{several}, commanded level at y = {at[1]:.4g} m; grey: no equilibrium{ends}. "
        f"Numbers: MuJoCo, at the poses of the optimisation and midway between them, {len(cases)} cases. "
        "They do not hold for other poses, loads and cables.",
    ])  # fmt: skip


def objective_map(found: LayoutResult, robot: Robot, axes: Mapping[str, np.ndarray]) -> Float[np.ndarray, "x z"]:
    """The objective's quantity over a plane of level poses, the worst of all loads and stiffnesses; nan without one."""
    at = np.stack(np.meshgrid(axes["x"], axes["y"], axes["z"], indexing="ij"), axis=-1)
    count = at[..., 0].size
    cases = found.cases.elsewhere(at, np.broadcast_to(np.eye(3), (count, 3, 3)))
    values = values_of(found, solve_layouts(RobotBatch.of([robot]), cases)).reshape(*at.shape[:3], -1)
    reduce = np.min if mapped(found.objective).largest else np.max
    return reduce(values, axis=-1)[:, 0]


def _worst(values: Float[np.ndarray, " cases"], goal: Objective) -> int:
    """The case of the worst value; the first without any value."""
    if np.isnan(values).all():
        return 0
    return int((np.nanargmin if goal.largest else np.nanargmax)(values))


def _moved(before: Robot, after: Robot) -> list[tuple[str, dict[str, str], np.ndarray, bool]]:
    """Kinds of points that moved: name, looks, (points, 2, 3) previous and new positions, whether of the platform."""
    kinds = [
        ("exit", style.PURPLE, "o", before.exits, after.exits, False),
        ("anchor", style.ORANGE, "D", before.anchors, after.anchors, True),
        ("centre of mass", style.BLUE, "^", before.center_of_mass[None], after.center_of_mass[None], True),
    ]
    return [
        (name, {"color": color, "mec": color, "marker": marker}, np.stack([starts, ends], axis=1)[rows], of_platform)
        for name, color, marker, starts, ends, of_platform in kinds
        if (rows := (starts != ends).any(1)).any()
    ]


def _changed(before: Robot, after: Robot) -> list[str]:
    """Names of changed properties of cables that are no points."""
    numbers = {name: one for name, one in PROPERTIES.items() if one.image == "number"}
    changed = (one for name, one in numbers.items() if not np.array_equal(getattr(before, name), getattr(after, name)))
    return [f"{one.title} of cables" for one in changed]


def _draw_moves(
    ax: Axes,
    camera: mujoco.MjvCamera,
    moved: Sequence[tuple[str, dict[str, str], np.ndarray, bool]],
    at: RigidTransform | None = None,
) -> None:
    """Draw a line from each previous position, which is marked; of points of the platform, ``at`` its pose."""
    for _, looks, lines, _ in moved:
        for line in lines:
            ends = still.pixels(ax, camera, line if at is None else at.apply(line))
            ax.plot(*ends.T, color=looks["color"], lw=_MOVED["lw"])
            ax.plot(*ends[:1].T, ls="none", **{**looks, **_MOVED})


def _write_numbers(ax: Axes, numbers: Sequence[tuple[str, str, str]]) -> None:
    ax.axis("off")
    table = ax.table(
        [list(row) for row in numbers], colLabels=["", "before", "after"], cellLoc="right", loc="center",
        colWidths=[0.38, 0.26, 0.3], edges="horizontal",
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
        if cell.get_text().get_text().endswith(WORSE):
            cell.set_text_props(color=style.VERMILLION, fontweight="bold")


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

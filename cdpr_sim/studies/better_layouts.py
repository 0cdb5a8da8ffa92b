"""Presentation of an optimised layout: figures of merit, maps of tilt, both robots driven side by side."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from cdpr_sim.analysis.clearance import SEARCH_POINTS, clearances
from cdpr_sim.analysis.workspace.grids import plane
from cdpr_sim.analysis.workspace.sweep import sweep
from cdpr_sim.core.equilibrium_batch import EquilibriumBatch
from cdpr_sim.core.errors import InvalidInput
from cdpr_sim.core.robot import Robot
from cdpr_sim.core.trajectory import Trajectory
from cdpr_sim.crosscheck.layout_validation import LayoutValidation, ValidatedRobot
from cdpr_sim.design.front import Front
from cdpr_sim.drawing.layout_figures import draw_better_layout, draw_clearance_map, draw_front
from cdpr_sim.drawing.maps import outer_edges
from cdpr_sim.physics.drive import drive
from cdpr_sim.physics.settle import settle_many
from cdpr_sim.studies.robot_summary import shapes_of

MAP_POINTS = 121
"""Poses along the longer side of a map of tilt."""

CLEARANCE_POINTS = 61
"""Poses along the longer side of a map of distances."""


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


def picture(validation: LayoutValidation) -> Figure:
    """Figure of both layouts: changes, maps of tilt through the middle of the poses, and figures of merit."""
    found = validation.layout
    robots = (found.given, found.robot)
    equilibria = (validation.before.settled, validation.after.settled)
    asked = found.cases.positions
    across = float(np.median(asked[:, 1]))
    axes = plane("xz", across, MAP_POINTS, [found.given])
    maps = [sweep(robot, axes, quantities=["tilt"], chunk=None)["tilt"].values for robot in robots]
    tilts = _tilt(validation.before)
    row = 0 if np.isnan(tilts).all() else int(np.nanargmax(tilts))
    shapes = [shapes_of(one) for one in equilibria]
    of, score = found.objective, (validation.before.score, validation.after.score)
    return draw_better_layout(
        equilibria, row, [None if one is None else one[row] for one in shapes],
        (maps[0].squeeze(), maps[1].squeeze()), (*outer_edges(axes["x"]), *outer_edges(axes["z"])),
        asked, numbers(validation),
        f"{found.given.name}: {of.name} {of.shown(score[0])} → {of.shown(score[1])}",
        "Robots settled in MuJoCo at the pose where the given one tilts most. Maps: statics, commanded level at "
        f"y = {across:.4g} m; grey: no equilibrium; the scale ends at 45° at most. Numbers: MuJoCo, at the poses of "
        f"the optimisation and midway between them, {len(validation.cases)} cases. They do not hold for other poses, "
        "loads and cables.",
    )  # fmt: skip


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


def clearance_map(robot: Robot, name: str, at: float | None, enough: float, fitting: float | None) -> Figure:
    """Map of the interference-free workspace over a plane."""
    axes = plane(name, at, CLEARANCE_POINTS, [robot])
    grid = np.stack(np.meshgrid(*axes.values(), indexing="ij"), axis=-1)
    distances = clearances(robot, grid, fitting=fitting, points=SEARCH_POINTS)
    across = next(i for i, axis in enumerate("xyz") if axis not in name)
    least = np.take(distances.least, 0, axis=across)
    first, second = sorted(name)
    if np.isnan(distances.least).all():
        raise InvalidInput(f"plane: found no pose with an equilibrium of {robot.name!r}, expected one within its reach")
    free = distances.free(enough)
    nearest = tuple(int(i) for i in np.unravel_index(np.nanargmin(distances.least), distances.least.shape))
    where = f"{'xyz'[across]} = {float(axes['xyz'[across]][0]):.4g} m"
    return draw_clearance_map(
        least, (*outer_edges(axes[first]), *outer_edges(axes[second])), (first, second), enough,
        f"{robot.name}: interference-free at {free.mean():.0%} of these poses",
        "Smallest distance between centre lines of cables, the platform and the frame at equilibrium, at "
        f"{where}; {1e3 * distances.fitting:.3g} mm at both ends of each cable ignored. "
        f"Smallest: {distances.nearest(nearest)}.",
    )  # fmt: skip


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

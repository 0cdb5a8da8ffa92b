"""One robot for somebody who has never seen it: a pose, the worst of its workspace, maps, and a drive across."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import RigidTransform

from cdpr_sim.analysis.cable_profiles import cable_profiles
from cdpr_sim.analysis.modes import Modes, natural_modes
from cdpr_sim.analysis.workspace import grids
from cdpr_sim.analysis.workspace.grids import GridLike
from cdpr_sim.analysis.workspace.sweep import sweep
from cdpr_sim.core.equilibrium import Equilibrium, NotConverged, NotSettled, Stability
from cdpr_sim.core.equilibrium_batch import EquilibriumBatch
from cdpr_sim.core.errors import CdprError, InvalidInput
from cdpr_sim.core.pose import PoseLike
from cdpr_sim.core.problem import Problem, Problems
from cdpr_sim.core.robot import STANDARD_GRAVITY, Robot
from cdpr_sim.core.trajectory import Trajectory
from cdpr_sim.crosscheck.check import REFUSED, Check, check
from cdpr_sim.crosscheck.compare import Agreement, compare
from cdpr_sim.physics.drive import drive
from cdpr_sim.physics.settle import settle_many
from cdpr_sim.statics.newton import solve_many, solve_trajectory

if TYPE_CHECKING:
    import xarray as xr

GRID = (7, 5, 4)
"""Poses that are settled in MuJoCo, unless the caller says otherwise."""

WORST = 5
"""Poses of the grid that are shown one by one."""

ALIKE = 1e-3
"""Two poses of a grid whose platforms are equally far off, but for this fraction, are listed as one. Symmetry leaves
far less, also where nothing holds the platform in some direction."""

POINTS = 61
"""Of a map, along its longer side."""

MOTION = 49
"""States of the drive: four seconds at twelve frames a second."""

SWINGS = 10
"""That a pendulum as long as the frame makes during the drive: slow enough for the platform to follow."""

MAP = ("tilt", "distance", "slack_count", "feasible")
"""Quantities of a map; and where cables have mass, which of them there are."""


@dataclass(frozen=True, eq=False)
class View:
    """One commanded pose, by both methods.

    Attributes:
        problem: what was asked.
        settled: MuJoCo's answer, or why there is none.
        solved: the static solver's, likewise.
        agreement: of the two, where both rest.
        shapes: how cables hang with mass, (cables, points, 3) [m]; else None.
    """

    problem: Problem
    settled: Equilibrium | NotSettled
    solved: Equilibrium | NotConverged
    agreement: Agreement | None
    shapes: Float[np.ndarray, "cables points 3"] | None


@dataclass(frozen=True, eq=False)
class RobotSummary:
    """What there is to say of a robot.

    Attributes:
        robot: whose.
        first: the pose that was asked for.
        worst: the poses of the grid where the methods do not agree, and then those farthest from where they were
            commanded, rotations counted by what the anchors see; of poses that are alike by symmetry, one.
        most: the largest deviation [m] and the largest tilt [rad] of all poses of the grid, by statics.
        check: both methods over the grid.
        plane: tilt, deviation, slack cables and feasibility over the plane across y through the first of ``worst``;
            None where the workspace is flat.
        modes: natural frequencies at the pose that was asked for; None where there are none.
        motion: a drive across the workspace; None if it was not asked for, or the platform fell.
        static: the static solver's poses during the drive.
        shapes: how cables hang meanwhile, if they have mass.
        missing: why something is left out, a sentence each.
    """

    robot: Robot
    first: View
    worst: tuple[View, ...]
    most: tuple[float, float]
    check: Check
    plane: xr.Dataset | None
    modes: Modes | None
    motion: Trajectory | None
    static: RigidTransform | None
    shapes: Float[np.ndarray, "steps cables points 3"] | None
    missing: tuple[str, ...]


def portray(
    robot: Robot,
    pose: PoseLike | None = None,
    *,
    grid: GridLike | None = None,
    motion: bool = True,
    progress: Callable[[str], None] = lambda _: None,
) -> RobotSummary:
    """Ask both methods what there is to say of a robot.

    Args:
        robot: which.
        pose: that is asked first; default: the middle of the workspace.
        grid: of the poses that are settled in MuJoCo, as ``check`` takes it; default: ``GRID``.
        motion: whether to drive it across its workspace.
        progress: called with what begins, in words.

    Raises:
        InvalidInput: a pose or a grid that cannot be right.
    """
    asked = Problem.of(robot, robot.home if pose is None else pose)
    axes = grids.as_grid(GRID if grid is None else grid, [robot])
    missing: list[str] = []
    progress("MuJoCo settles the platform all over its workspace")
    checked = check(robot, axes)
    problems, most = _worst(robot, axes, checked)
    first, *worst = _views([asked, *problems])
    progress("The static solver maps the workspace")
    plane, modes, drove = None, None, None
    try:
        massless = robot.cabling.massless
        quantities = (*MAP, "capacity_margin") if massless else MAP[:3]
        y = float((problems or [asked])[0].pose.translation[1])
        plane = sweep(robot, grids.plane("xz", y, POINTS, [robot]), quantities=quantities)
    except InvalidInput as error:
        missing.append(f"No maps: {error}.")
    rest = first.solved
    if robot.cabling.massless and isinstance(rest, Equilibrium) and rest.stability is not Stability.UNSTABLE:
        modes = natural_modes(rest)
    if motion:
        progress("MuJoCo drives the platform across its workspace")
        try:
            drove = _across(robot, asked.pose.translation)
        except CdprError as error:
            missing.append(f"No film: {error}.")
    static = None if drove is None else solve_trajectory(drove).poses
    shapes = None if drove is None else shapes_of(drove)
    return RobotSummary(robot, first, tuple(worst), most, checked, plane, modes, drove, static, shapes, tuple(missing))


def settled_along(robot: Robot, waypoints: Float[np.ndarray, "states 3"], seconds: float) -> Trajectory:
    """A motion so slow that the platform settles at each waypoint; of robots whose cables have weight.

    Raises:
        NotSettled: some platform does not come to rest.
    """
    equilibria = settle_many(robot, waypoints)
    for row in np.flatnonzero(~equilibria.converged):
        equilibria[int(row)]  # raises, with the reason
    return Trajectory.through(equilibria, np.linspace(0.0, seconds, len(waypoints)))


def shapes_of(equilibria: EquilibriumBatch) -> Float[np.ndarray, "*batch cables points 3"] | None:
    """How cables hang with mass; None of others, whose shapes need no statics."""
    return None if equilibria.robot.cabling.massless else cable_profiles(equilibria)


def _worst(robot: Robot, axes: dict[str, np.ndarray], checked: Check) -> tuple[list[Problem], tuple[float, float]]:
    """The poses where the methods do not agree, and those farthest from where they were commanded.

    And of all poses the largest deviation [m] and the largest tilt [rad].
    """
    outcome = checked.dataset["outcome"].values.ravel()
    positions = np.stack(np.meshgrid(*axes.values(), indexing="ij"), axis=-1).reshape(-1, 3)
    equilibria = solve_many(robot, positions)
    turned = robot.characteristic_length * np.asarray(equilibria.poses.rotation.magnitude())
    distance, found = np.linalg.norm(equilibria.deviation, axis=-1), equilibria.converged & (outcome != REFUSED)
    away = np.hypot(distance, turned)
    disagreeing = {finding.position for finding in checked.disagreements}
    odd = np.array([tuple(map(float, position)) in disagreeing for position in positions])
    rows: list[int] = []
    for row in np.lexsort((-np.where(equilibria.converged, away, np.inf), ~odd)):
        alike = any(np.isclose(away[row], away[other], rtol=ALIKE, atol=0) for other in rows) and not odd[row]
        if outcome[row] != REFUSED and not alike and len(rows) < WORST:
            rows.append(int(row))
    most = float(distance[found].max(initial=0.0)), float(equilibria.tilt[found].max(initial=0.0))
    return [Problem.of(robot, positions[row]) for row in rows], most


def _views(problems: list[Problem]) -> list[View]:
    stacked = Problems.stack(problems)
    settled, solved = settle_many(stacked), solve_many(stacked)
    shapes = shapes_of(settled)
    views = []
    for row, problem in enumerate(problems):
        ends = []
        for equilibria in (settled, solved):
            try:
                ends.append(equilibria[row])
            except (NotSettled, NotConverged) as failure:
                ends.append(failure)
        both = all(isinstance(end, Equilibrium) for end in ends)
        agreement = compare(ends[1], ends[0]) if both else None
        views.append(View(problem, ends[0], ends[1], agreement, None if shapes is None else shapes[row]))
    return views


def _across(robot: Robot, through: Float[np.ndarray, "3"]) -> Trajectory:
    """Along x from end to end of the workspace, through a pose."""
    ends = np.array([through, through])
    ends[:, 0] = robot.workspace[:, 0]
    seconds = SWINGS * 2 * np.pi * np.sqrt(np.ptp(robot.frame, axis=0).max() / (robot.gravity or STANDARD_GRAVITY))
    if robot.cabling.massless:
        return drive(robot, ends, seconds=seconds, states=MOTION)
    return settled_along(robot, np.linspace(ends[0], ends[1], MOTION), seconds)

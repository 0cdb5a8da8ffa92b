"""Summary of one robot: a pose, the worst poses of its workspace, maps, and a drive across the workspace."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Float
from numpy.typing import ArrayLike
from scipy.spatial.transform import RigidTransform

from cdpr_sim.analysis.cable_profiles import cable_profiles
from cdpr_sim.analysis.modes import Modes, natural_modes
from cdpr_sim.analysis.workspace import grids
from cdpr_sim.analysis.workspace.grids import GridLike
from cdpr_sim.analysis.workspace.sweep import sweep
from cdpr_sim.core.equilibrium import Equilibrium, NotConverged, NotSettled, Stability
from cdpr_sim.core.equilibrium_batch import EquilibriumBatch, all_solved
from cdpr_sim.core.errors import CdprError, InvalidInput
from cdpr_sim.core.pose import PoseLike
from cdpr_sim.core.problem import Problem, Problems
from cdpr_sim.core.robot import STANDARD_GRAVITY, Robot
from cdpr_sim.core.trajectory import Trajectory
from cdpr_sim.crosscheck.check import REFUSED, Check, check
from cdpr_sim.crosscheck.compare import Agreement, compare
from cdpr_sim.drawing import maps
from cdpr_sim.drawing.video.writing import write_video
from cdpr_sim.physics.drive import drive
from cdpr_sim.physics.settle import settle_many
from cdpr_sim.physics.settle_path import settle_path
from cdpr_sim.statics.newton import solve_many, solve_trajectory
from cdpr_sim.statics.solve_path import solve_path

if TYPE_CHECKING:
    import xarray as xr

GRID = (7, 5, 4)
"""Default number of poses settled in MuJoCo along x, y and z."""

WORST = 5
"""Number of worst poses listed."""

ALIKE = 1e-3
"""Poses whose deviations differ by less than this fraction are listed as one. Symmetric poses differ by far less, also
if the platform is neutrally stable."""

POINTS = 61
"""Poses along the longer side of a map."""

MOTION = 49
"""States of the drive: four seconds at twelve frames per second."""

SWINGS = 10
"""Duration of the drive in periods of a pendulum as long as the frame: slow enough for the platform to follow."""


@dataclass(frozen=True, eq=False)
class View:
    """One commanded pose, by both methods.

    Attributes:
        problem: the problem.
        settled: MuJoCo's equilibrium, or why there is none.
        solved: the static solver's equilibrium, or why there is none.
        agreement: of both equilibria, if they exist.
        shapes: profiles of cables with mass, (cables, points, 3) [m]; else None.
    """

    problem: Problem
    settled: Equilibrium | NotSettled
    solved: Equilibrium | NotConverged
    agreement: Agreement | None
    shapes: Float[np.ndarray, "cables points 3"] | None


@dataclass(frozen=True, eq=False)
class RobotSummary:
    """Summary of a robot.

    Attributes:
        robot: the robot.
        first: the requested pose.
        worst: poses of the grid where the methods disagree, then those with the largest deviation, with rotations
            weighted by the characteristic length; one of those that are equivalent by symmetry.
        most: the largest deviation [m] and the largest tilt [rad] of all poses of the grid, by statics.
        check: both methods over the grid.
        plane: tilt, deviation, slack cables and feasibility over the plane across y through the first of ``worst``;
            None where the workspace is flat.
        modes: natural frequencies at the requested pose; None if there are none.
        motion: a drive across the workspace; None if not requested, or if the platform fell.
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
    missing: tuple[str, ...]


def summarise(
    robot: Robot,
    pose: PoseLike | None = None,
    *,
    grid: GridLike | None = None,
    motion: bool = True,
    progress: Callable[[str], None] = lambda _: None,
) -> RobotSummary:
    """Summarise a robot by both methods.

    Args:
        robot: the robot.
        pose: shown first; default: the middle of the workspace.
        grid: poses settled in MuJoCo, as for ``check``; default: ``GRID``.
        motion: whether to drive it across its workspace.
        progress: called with a description of each step.

    Raises:
        InvalidInput: an invalid pose or grid.
    """
    requested = Problem.of(robot, robot.home if pose is None else pose)
    axes = grids.as_grid(GRID if grid is None else grid, [robot])
    missing: list[str] = []
    progress("Settling the platform over its workspace in MuJoCo")
    checked = check(robot, axes)
    problems, most = _worst(robot, axes, checked)
    first, *worst = _views([requested, *problems])
    progress("Computing maps of the workspace by statics")
    plane, modes, drove = None, None, None
    try:
        y = float((problems or [requested])[0].pose.translation[1])
        plane = sweep(robot, grids.plane("xz", y, POINTS, [robot]), quantities=maps.QUANTITIES)
    except InvalidInput as error:
        missing.append(f"No maps: {error}.")
    solved = first.solved
    if robot.cabling.has_memory.any():
        missing.append("No natural frequencies: they are those of elastic cables, and these have a memory.")
    elif isinstance(solved, Equilibrium) and solved.stability is not Stability.UNSTABLE:
        modes = natural_modes(solved)
    if motion:
        progress("Driving the platform across its workspace in MuJoCo")
        try:
            drove = _across(robot, requested.pose.translation)
        except CdprError as error:
            missing.append(f"No video: {error}.")
    return RobotSummary(robot, first, tuple(worst), most, checked, plane, modes, drove, tuple(missing))


def settled_along(
    robot: Robot,
    waypoints: Float[np.ndarray, "states 3"] | RigidTransform,
    seconds: float,
    external_wrench: ArrayLike | Sequence[float] | None = None,
) -> Trajectory:
    """Quasi-static motion: the platform settled at each waypoint; for cables with mass, or with a memory of the path.

    Raises:
        NotSettled: MuJoCo did not settle at some waypoint.
    """
    times = np.linspace(0.0, seconds, len(waypoints))
    if robot.cabling.has_memory.any():
        path = settle_path(robot, waypoints, external_wrench=external_wrench, times=times)
        return Trajectory.through(all_solved(path), times)
    return Trajectory.through(all_solved(settle_many(robot, waypoints, external_wrench=external_wrench)), times)


def solved_along(trajectory: Trajectory) -> EquilibriumBatch:
    """Static equilibria for the commands of a motion's states: where cables have a memory, along its path."""
    if trajectory.robot.cabling.has_memory.any():
        return solve_path(trajectory.problems, times=trajectory.times)
    return solve_trajectory(trajectory)


def write_both_methods(path: str | Path, trajectories: Sequence[Trajectory], **options: Any) -> Path:
    """Write a video of motions in MuJoCo with the static solver's outlines, and options as ``write_video`` has."""
    static = [solved_along(one).poses for one in trajectories]
    return write_video(path, trajectories, static, shapes=[shapes_of(one) for one in trajectories], **options)


def shapes_of(equilibria: EquilibriumBatch) -> Float[np.ndarray, "*batch cables points 3"] | None:
    """Profiles of cables with mass; None for massless cables."""
    return None if equilibria.robot.cabling.massless else cable_profiles(equilibria)


def _worst(robot: Robot, axes: dict[str, np.ndarray], checked: Check) -> tuple[list[Problem], tuple[float, float]]:
    """Problems where the methods disagree, then those with the largest deviation.

    Also the largest deviation [m] and the largest tilt [rad] of all poses.
    """
    outcome = checked.dataset["outcome"].values.ravel()
    positions = np.stack(np.meshgrid(*axes.values(), indexing="ij"), axis=-1).reshape(-1, 3)
    equilibria = solve_many(robot, positions)
    rotation = robot.characteristic_length * np.asarray(equilibria.poses.rotation.magnitude())
    distance, solved = np.linalg.norm(equilibria.deviation, axis=-1), equilibria.converged & (outcome != REFUSED)
    deviation = np.hypot(distance, rotation)
    disagreeing = {one.position for one in checked.disagreements}
    disagrees = np.array([tuple(map(float, position)) in disagreeing for position in positions])
    rows: list[int] = []
    for row in np.lexsort((-np.where(equilibria.converged, deviation, np.inf), ~disagrees)):
        alike = any(np.isclose(deviation[row], deviation[other], rtol=ALIKE, atol=0) for other in rows)
        if outcome[row] != REFUSED and (disagrees[row] or not alike) and len(rows) < WORST:
            rows.append(int(row))
    most = float(distance[solved].max(initial=0.0)), float(equilibria.tilt[solved].max(initial=0.0))
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
    """Drive along x from end to end of the workspace, through a pose."""
    ends = np.array([through, through])
    ends[:, 0] = robot.workspace[:, 0]
    seconds = SWINGS * 2 * np.pi * np.sqrt(np.ptp(robot.frame, axis=0).max() / (robot.gravity or STANDARD_GRAVITY))
    if robot.cabling.massless and not robot.cabling.has_memory.any():
        return drive(robot, ends, seconds=seconds, states=MOTION)
    return settled_along(robot, np.linspace(ends[0], ends[1], MOTION), seconds)

"""Driving: the winches move the platform along a path in MuJoCo, in time.

The winches use the robot's geometry and assume rigid cables: at every instant they let out the rest lengths of the
commanded pose (paper Eq. 1, 2), and a shorter cable is a stiffer one, EA/l0. The motion of the platform is computed by
MuJoCo (``motion``): with true mass and inertia, and the viscous air of ``to_mjcf``. Poses and lengths are read out of
MuJoCo.
"""

# pyright: reportAttributeAccessIssue=false
# mujoco ships no type stubs for its compiled modules.
from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Any

import mujoco
import numpy as np
from jaxtyping import Float
from numpy.typing import ArrayLike
from scipy.spatial.transform import RigidTransform

from cdpr_sim.core.checks import FLAG, PROGRESS, listed, positive, refuse_unless, whole
from cdpr_sim.core.errors import InvalidInput
from cdpr_sim.core.pose import PoseLike, poses_of
from cdpr_sim.core.pose_path import PosePath
from cdpr_sim.core.pretension import without_pretension
from cdpr_sim.core.problem import Problem, Problems
from cdpr_sim.core.robot import STANDARD_GRAVITY, Robot
from cdpr_sim.core.status import Status
from cdpr_sim.core.trajectory import PlatformFell, Trajectory
from cdpr_sim.physics.chains import refuse_short
from cdpr_sim.physics.mjcf import TIMESTEP, settling_air
from cdpr_sim.physics.motion import CALM, Motion
from cdpr_sim.physics.quiet import quiet
from cdpr_sim.physics.settle import at_rest, settle, single, weighs, without_weight
from cdpr_sim.physics.simulations import Observation

STATES = 301
"""Default number of states of a trajectory: ten seconds of video at 30 frames a second."""

NEARLY_STATIC = 1e-3
"""Drag of the viscous air at the top speed of a drive, as a fraction of the weight. It deflects a hanging platform by
this angle [rad], 0.06°: this is the difference between a slow drive and a static one."""

PEAK = 1.875
"""Top speed over mean speed of the minimum-jerk profile (15/8, at half time)."""

PAUSE = 3.0
"""[s] Default duration of a drive along a path of zero length."""

MOST_STATES = 1_000_000
"""Largest number of states of a trajectory: half a gigabyte of numbers, far more than is useful."""

MOST_SECONDS = 1e5
"""Longest drive [s]: fifty million time steps."""

FALLEN = 0.5
"""Distance from the commanded position, in mean rest lengths, beyond which the platform has fallen: no cable that
obeys the law of a spring stretches by half, so that it must have swung out from below its cables."""

BLOCK = 1000
"""Number of instants whose commands are computed at once, in less time than one by one."""

SMOOTH = 0.01
"""Time step of a platform on cables with mass, as a fraction of 1/omega of its slowest oscillation, if more than that
of the model: an oscillation ten times as fast is damped by a twentieth of the critical damping."""


def drive(
    robot: Robot,
    waypoints: RigidTransform | Sequence[PoseLike] | np.ndarray,
    *,
    seconds: float | None = None,
    states: int = STATES,
    from_rest: bool = True,
    rest_lengths: ArrayLike | None = None,
    external_wrench: ArrayLike | Sequence[float] | None = None,
    progress: Callable[[float], None] | None = None,
) -> Trajectory:
    """Drive the platform along ``waypoints`` by its winches while MuJoCo simulates it.

    The command moves along straight lines from waypoint to waypoint as described in ``core.pose_path``: smoothly, with
    zero velocity at both ends.

    Args:
        robot: the robot.
        waypoints: commanded poses in order, at least one: (rows, 3), (rows, 6) or a stack of transforms. With a single
            one the command is constant.
        seconds: duration of the drive; default: slow enough to be nearly static.
        states: number of states to return, evenly spaced in time, the first and the last included.
        from_rest: start at the equilibrium to which the platform settles from the first waypoint; if False it is
            released at the waypoint itself, where its cables are just not taut, and falls.
        rest_lengths: rest lengths at each waypoint, (waypoints, cables) [m], compensated ones for instance; between two
            waypoints, their difference from the rigid lengths is interpolated linearly. Default: the lengths of
            ``robot.rest_lengths`` at every commanded pose.
        external_wrench: constant force [N] and torque [N m] on the platform's origin, in the base frame, besides
            gravity, (6,).
        progress: is called from time to time with the fraction done, 0 to 1.

    Returns:
        The motion, (states,): the platform's poses in MuJoCo with tensions [N], and the commands at those times.

    Raises:
        InvalidInput: invalid waypoints, rest lengths, wrench, duration or number of states; a cable with mass that is
            too short for its pulley; cables with a memory.
        NotSettled: the platform does not come to rest at the first waypoint.
        PlatformFell: it fell during the drive; carries the trajectory so far.
    """
    refuse_unless(FLAG, from_rest=from_rest)
    refuse_unless(PROGRESS, progress=progress)
    poses = poses_through(robot, waypoints)
    robot.cabling.refuse_memory()
    whole("states", states, 2, MOST_STATES)
    if rest_lengths is not None:
        robot = without_pretension(robot)
    path = PosePath(robot, poses, rest_lengths)
    first = Problem.of(robot, poses[0], external_wrench=external_wrench)
    if seconds is None:
        seconds = PEAK * path.length / _slow_speed(first) or PAUSE
    seconds = duration(seconds)
    fractions = np.linspace(0, 1, states)
    commanded = path.at(fractions)
    problems_at(robot, commanded)  # refuses poses that no rest lengths can hold
    problems = Problems.of(robot, commanded, path.winches(fractions), first.external_wrench)
    start = settle(problems[0]).pose if from_rest else poses[0]
    with quiet():
        if weighs(robot):
            for lengths in problems.rest_lengths:
                refuse_short(robot, lengths)
        moving = problems if weighs(robot) else without_weight(problems)
        seen, fell = [], None
        for row, (state, data, platform) in enumerate(_driven(moving, path, start, seconds, from_rest)):
            seen.append(state)
            fell = fallen(problems.positions[row], problems.rotations[row], problems.rest_lengths[row], data, platform)
            if fell:
                break
            if progress is not None:
                progress(row / (states - 1))
    rows = np.arange(len(seen))
    trajectory = Trajectory.of(
        problems.take(rows),
        seconds * fractions[rows],
        poses_of(*(np.concatenate([getattr(one, name) for one in seen]) for name in ("positions", "rotations"))),
        *(np.concatenate([getattr(one, name) for one in seen]) for name in ("lengths", "tensions")),
    )
    if fell:
        x, y, z = trajectory.commanded.translation[-1]
        raise PlatformFell(
            f"{robot.name}: found the platform fallen {trajectory.times[-1]:.4g} s into the drive, when it was "
            f"commanded to ({x:.3g}, {y:.3g}, {z:.3g}) m: {fell}",
            trajectory,
        )
    return trajectory


def duration(seconds: Any) -> float:
    """A duration of a motion [s].

    Raises:
        InvalidInput: not a number above 0, or too long.
    """
    if positive("seconds", seconds, "s") > MOST_SECONDS:
        raise InvalidInput(f"seconds: found {seconds:g}, expected more than 0 and at most {MOST_SECONDS:g}")
    return float(seconds)


def poses_through(robot: Any, waypoints: Any) -> list[RigidTransform]:
    """The waypoints as poses of a robot that can be driven.

    Raises:
        InvalidInput: no robot or no poses.
    """
    refuse_unless(Robot, robot=robot)
    poses = [robot.pose(pose) for pose in listed("waypoints", waypoints, "a list of poses")]
    if not poses:
        raise InvalidInput("waypoints: found none, expected at least one pose")
    return poses


def problems_at(robot: Robot, commanded: RigidTransform) -> Problems:
    """Problems of winches that hold the rigid lengths of each of these poses.

    Raises:
        InvalidInput: nothing could hold the platform at one of the poses, or a cable leaves its pulley there.
    """
    problems = Problems.of(robot, commanded)
    refused = problems.refusals != Status.PENDING
    if refused.any():
        Problem.of(robot, commanded[int(np.argmax(refused))])  # says why
    return problems


def _slow_speed(problem: Problem) -> float:
    """Speed [m/s] of the command at which the air's drag is ``NEARLY_STATIC`` of the weight.

    ``to_mjcf`` damps the swing of rate w = sqrt(g/l) critically: the drag on the platform is 2 m w v.
    """
    gravity = problem.robot.gravity or STANDARD_GRAVITY
    return float(NEARLY_STATIC * np.sqrt(gravity * problem.rest_lengths.mean()) / 2)


def _driven(
    problems: Problems, path: PosePath, start: RigidTransform, seconds: float, from_rest: bool
) -> Iterator[tuple[Observation, mujoco.MjData, int]]:
    """The states at each problem's instant, with MuJoCo's data and the platform's body."""
    first, intervals, heavy = problems[0], len(problems) - 1, weighs(problems.robot)
    simulation = at_rest(first, start) if from_rest and heavy else single(first, start)
    longest = max(TIMESTEP, SMOOTH / simulation.swing[0]) if heavy else TIMESTEP
    air = settling_air(Problem.of(problems.robot, first.pose))[1]
    motion = Motion(simulation, longest, viscosity=air, theta=CALM)
    yield motion.look(), motion.data, motion.platform
    interval = seconds / intervals
    pieces = max(1, int(np.ceil(interval / longest)))
    together = max(1, BLOCK // pieces)
    for first in range(0, intervals, together):
        count = min(together, intervals - first)
        let_out = path.winches((first + np.linspace(0, count, count * pieces + 1)) / intervals)
        for k in range(count):
            rows = let_out[k * pieces : (k + 1) * pieces + 1]
            motion.advance(interval, lambda passed, _, rows=rows: _between(rows, passed / interval))
            yield motion.look(), motion.data, motion.platform


def _between(rows: Float[np.ndarray, "steps cables"], fraction: float) -> Float[np.ndarray, " cables"]:
    """Interpolated linearly between evenly spaced rows."""
    at = fraction * (len(rows) - 1)
    before = min(int(at), len(rows) - 2)
    return rows[before] + (at - before) * (rows[before + 1] - rows[before])


def fallen(
    position: Float[np.ndarray, "3"],
    rotation: Float[np.ndarray, "3 3"],
    rest_lengths: Float[np.ndarray, " cables"],
    data: mujoco.MjData,
    platform: int,
) -> str | None:
    """Reason why the platform, with this commanded pose, has fallen, as text; None if it has not."""
    if data.warning.number.any() or not np.isfinite(data.xpos[platform]).all():
        return "the simulation in MuJoCo became unstable"
    away, limit = np.linalg.norm(data.xpos[platform] - position), FALLEN * rest_lengths.mean()
    if not away <= limit:
        return f"it is {away:.3g} m away, expected at most {limit:.3g} m, half the mean cable length"
    if data.xmat[platform].reshape(3, 3)[:, 2] @ rotation[:, 2] < 0:
        return "it has turned over"
    return None

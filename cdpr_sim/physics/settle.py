"""Let the platform come to rest in MuJoCo, and read out of MuJoCo where that is.

The second road to a static equilibrium, which shares nothing with the first: no formula of statics stands here.
MuJoCo moves the platform and knows its pose, cable lengths and spring forces; a tension is the force that MuJoCo
applies when all other springs are switched off; the residual is the generalised force that it has left over at zero
velocity; the stiffness is how that force changes when the platform is displaced.

Only the rest pose matters and not the time it takes, so that the motion is *dynamic relaxation* (Otter and Day 1960;
Underwood 1983): real mass, inertia and cables, from the commanded pose at zero velocity, in a medium whose damping, and
with a time step whose length, follow what the platform is doing.
"""

# pyright: reportAttributeAccessIssue=false
# mujoco ships no type stubs for its compiled modules.
from __future__ import annotations

import enum
from collections.abc import Sequence
from dataclasses import dataclass

import mujoco
import numpy as np
from jaxtyping import Bool, Float, Int
from mujoco.batch import SimulationError
from numpy.typing import ArrayLike
from scipy.spatial.transform import RigidTransform

from cdpr_sim.physics.batch import Bench, bench_of
from cdpr_sim.core.equilibrium import NEUTRAL, Equilibrium
from cdpr_sim.core.errors import InvalidInput, NotSettled
from cdpr_sim.physics.mjcf import coordinates
from cdpr_sim.core.pose import PoseLike
from cdpr_sim.core.problem import Problem
from cdpr_sim.core.robot import Robot
from cdpr_sim.core.trajectory import Trajectory

RESIDUAL = 1e-9
"""Largest unbalanced force at rest, as a fraction of the load (the weight, or the external wrench where larger)."""

ROUNDING = 2 * np.finfo(float).eps
"""A cable's force is known to this fraction of EA at best: the rounding of a length, times EA/l0."""

ACCEPTABLE = 1e-6
"""Never at rest with more than this fraction of the load unbalanced, whatever the rounding."""

SPEED = 1e-6
"""Speed at rest, as a fraction of (cable length x swing rate): it would take days to cross the frame."""

STEPS = 30_000
"""Time steps after which a platform is restless. DemoBot needs a hundred; sliding along stiff cables, thousands."""

CHUNK = 13
"""Time steps between two looks at the residual; odd, so that a velocity that turns round at every step shows."""

FIRST_STEP, SHORTEST_STEP, LONGEST_STEP = 0.1, 1e-4, 0.3
"""Time steps as fractions of the slowest swing's 1/omega; with longer ones stiff cables throw light platforms about."""

FIRST_DAMPING, LEAST_DAMPING, MOST_DAMPING = 1.5, 0.5, 20.0
"""Damping ratio of the slowest swing: overdamped at first, so that the platform sinks into the equilibrium below it
rather than swinging over into another one."""

BETTER, ALONG, PATIENCE = 0.7, 0.95, 2
"""A residual below this fraction of the best so far is progress; a cosine above this is a force along the velocity; and
after this many looks without either, the platform rattles."""

NUDGES = 3
"""How often a platform that is balanced on a saddle is pushed off it. One that comes back each time is at rest after
all: under an external torque, which is not conservative, the symmetric part of the stiffness does not decide."""


class Outcome(enum.Enum):
    """How a settling ended; the value is the reason in words."""

    SETTLED = "it came to rest"
    RESTLESS = "it did not come to rest"
    WARNED = "MuJoCo found its motion unstable"


@dataclass(frozen=True, eq=False)
class Settlings:
    """Many settlings of one robot, row by row, as in ``Equilibrium``; a row that is not settled holds its last state.

    Attributes:
        problems: what was asked, one per row.
        outcomes: how each ended.
        poses: of the platform, a stack of (rows,).
        tensions: (rows, cables) [N].
        lengths: (rows, cables) [m].
        residuals: (rows,) [N].
        eigenvalues: of the stiffness matrix, (rows, free) [N/m].
        steps: time steps, (rows,).
    """

    problems: tuple[Problem, ...]
    outcomes: tuple[Outcome, ...]
    poses: RigidTransform
    tensions: Float[np.ndarray, "rows cables"]
    lengths: Float[np.ndarray, "rows cables"]
    residuals: Float[np.ndarray, " rows"]
    eigenvalues: Float[np.ndarray, "rows free"]
    steps: Int[np.ndarray, " rows"]

    def __len__(self) -> int:
        return len(self.problems)

    @property
    def settled(self) -> Bool[np.ndarray, " rows"]:
        """Which rows came to rest, (rows,)."""
        return np.array([outcome is Outcome.SETTLED for outcome in self.outcomes])

    def equilibrium(self, row: int) -> Equilibrium:
        """Row ``row`` as the result that ``settle`` returns.

        Raises:
            NotSettled: that row did not come to rest; carries its last state.
        """
        equilibrium = Equilibrium(
            problem=self.problems[row],
            pose=self.poses[row],
            tensions=self.tensions[row].copy(),
            lengths=self.lengths[row].copy(),
            residual=float(self.residuals[row]),
            eigenvalues=self.eigenvalues[row].copy(),
            iterations=int(self.steps[row]),
            source="mujoco",
        )
        if self.outcomes[row] is not Outcome.SETTLED:
            raise NotSettled(_reason(self.outcomes[row], equilibrium), equilibrium)
        return equilibrium


def settle(
    robot: Robot,
    pose: PoseLike,
    rest_lengths: ArrayLike | None = None,
    external_wrench: ArrayLike | None = None,
    *,
    model: mujoco.MjModel | None = None,
) -> Equilibrium:
    """Where MuJoCo's platform comes to rest, let go at ``pose`` with zero velocity.

    A platform that its cables do not hold there falls until they catch it, however far: nothing else is in its way.

    Args:
        robot: the robot.
        pose: where the platform starts: (x, y, z) [m], a six-vector [m, rad], or a ``RigidTransform``.
        rest_lengths: unstretched cable lengths, (cables,) [m]; default: the rigid ones at ``pose``.
        external_wrench: force [N] and torque [N m] on the platform's origin, in the base frame, besides gravity.
        model: settle this model of the robot instead of the generated one, with the springs, masses and gravity that
            it has. Its names must be those of ``to_mjcf``.

    Raises:
        InvalidInput: a pose, a length or a wrench that cannot be right.
        NotSettled: it never comes to rest, or MuJoCo warns of its motion; carries the last state.
    """
    return settle_problems([Problem.of(robot, pose, rest_lengths, external_wrench)], model=model).equilibrium(0)


def settle_trajectory(
    robot: Robot,
    pose: PoseLike,
    rest_lengths: ArrayLike | None = None,
    external_wrench: ArrayLike | None = None,
    *,
    model: mujoco.MjModel | None = None,
) -> tuple[Equilibrium, Trajectory]:
    """``settle``, and the motion that led there, time step by time step (their lengths vary).

    Raises:
        InvalidInput: a pose, a length or a wrench that cannot be right.
        NotSettled: as ``settle``.
    """
    problem = Problem.of(robot, pose, rest_lengths, external_wrench)
    frames: list[tuple[float, np.ndarray]] = []
    equilibrium = settle_problems([problem], model=model, frames=frames).equilibrium(0)
    times, qpos = (np.array(column) for column in zip(*frames, strict=True))
    with bench_of([problem] * len(times), model) as bench:
        seen = bench.observe(qpos)
    return equilibrium, Trajectory(
        robot=robot,
        times=times,
        poses=seen.poses,
        lengths=seen.lengths,
        tensions=seen.tensions,
        commanded=RigidTransform.from_matrix(np.tile(problem.pose.as_matrix(), (len(times), 1, 1))),
        rest_lengths=np.tile(problem.rest_lengths, (len(times), 1)),
    )


def settle_many(
    robot: Robot,
    poses: RigidTransform | Sequence[PoseLike] | np.ndarray,
    rest_lengths: ArrayLike | None = None,
    external_wrench: ArrayLike | None = None,
    *,
    threads: int = 0,
) -> Settlings:
    """Settle one robot from many poses, side by side on threads; the same motions as ``settle`` one by one.

    Args:
        robot: the robot.
        poses: where the platform starts, (rows, 3), (rows, 6) or a stack of transforms.
        rest_lengths: (cables,) for all or (rows, cables) [m]; default: the rigid ones at each pose.
        external_wrench: (6,) for all or (rows, 6) [N, N m].
        threads: 0 for one per processor.

    Raises:
        InvalidInput: a pose, a length or a wrench that cannot be right.
    """
    rows = list(poses)
    lengths = _per_row("rest_lengths", rest_lengths, len(rows))
    wrenches = _per_row("external_wrench", external_wrench, len(rows))
    problems = [Problem.of(robot, *row) for row in zip(rows, lengths, wrenches, strict=True)]
    return settle_problems(problems, threads=threads)


def settle_problems(
    problems: Sequence[Problem],
    *,
    model: mujoco.MjModel | None = None,
    threads: int = 1,
    frames: list[tuple[float, np.ndarray]] | None = None,
) -> Settlings:
    """Settle problems of one and the same robot; what ``settle`` and ``settle_many`` have in common.

    Args:
        problems: at least one, all of the same robot object.
        model: as in ``settle``, for all of them.
        threads: 0 for one per processor.
        frames: where to append (time, qpos) of the first problem at every step.
    """
    with bench_of(problems, model, threads) as bench:
        relaxation = _Relaxation(bench, frames)
        relaxation.run()
        reading = bench.read(relaxation.qpos)
        for _ in range(NUDGES):
            saddle = relaxation.settled & (reading.eigenvalues[:, 0] < -NEUTRAL * np.abs(reading.eigenvalues).max(1))
            if not saddle.any():
                break
            relaxation.nudge(saddle, reading.softest)
            relaxation.run()
            reading = bench.read(relaxation.qpos)
    return Settlings(
        problems=tuple(problems),
        outcomes=tuple(relaxation.outcomes),
        poses=reading.poses,
        tensions=reading.tensions,
        lengths=reading.lengths,
        residuals=reading.residuals,
        eigenvalues=reading.eigenvalues,
        steps=relaxation.steps,
    )


def residual_of(problem: Problem, pose: PoseLike, *, model: mujoco.MjModel | None = None) -> float:
    """The largest unbalanced force [N] that MuJoCo finds on the platform held at ``pose``; zero at equilibrium.

    Torques are divided by the robot's characteristic length, as in ``Equilibrium.residual``.

    Raises:
        InvalidInput: a pose that cannot be right.
    """
    qpos = coordinates(problem.robot, problem.robot.pose(pose))
    with bench_of([problem], model) as bench:
        bench.qpos[:] = qpos
        return float(bench.residuals()[0])


def residuals_of(problems: Sequence[Problem], poses: RigidTransform, *, threads: int = 0) -> Float[np.ndarray, " rows"]:
    """``residual_of`` for many problems of one and the same robot, each at its own of the poses, (rows,) [N].

    Args:
        problems: at least one, all of the same robot object.
        poses: a stack, one for each.
        threads: 0 for one per processor.
    """
    with bench_of(problems, None, threads) as bench:
        bench.qpos[:] = [coordinates(problem.robot, pose) for problem, pose in zip(problems, poses, strict=True)]
        return bench.residuals()


class _Relaxation:
    """Each row's motion towards rest, with a time step and a damping of its own.

    While the residual falls the step grows. Where it does not, there are two reasons, told apart by force and velocity:

    - *slow*: the force keeps pointing along a steady velocity, as it does when damping alone holds the platform back.
      Then the step grows and the damping falls.
    - *rattling*: the force points elsewhere: in a step that long, cables go slack and taut again. Then the step shrinks
      and the damping rises.
    """

    def __init__(self, bench: Bench, frames: list[tuple[float, np.ndarray]] | None) -> None:
        self.bench, self.frames = bench, frames
        robot = bench.robot
        self.reach = bench.band[:, :, 1].max(1)
        wrenches = np.abs(bench.wrenches)
        self.load = np.maximum(robot.weight, np.maximum(wrenches[:, :3].max(1), wrenches[:, 3:].max(1) / bench.length))
        bench.qvel[:] = 0
        bench.batch.forward()
        # Without gravity or wrench the load is what the cables do to one another, or else a strain of one per mille.
        idle = self.load == 0
        self.load[idle] = np.maximum(np.abs(bench.forces[idle]).max(1), 1e-3 * robot.axial_stiffness.mean())
        self.swing = np.sqrt(self.load / robot.mass / bench.band[:, :, 1].mean(1))
        rounding = ROUNDING * float(robot.axial_stiffness.max())
        self.target = np.minimum(np.maximum(RESIDUAL * self.load, rounding), ACCEPTABLE * self.load)
        self.inertia = _inertias(robot)
        self.root_inertia = np.sqrt(self.inertia)
        rows = len(bench.qpos)
        self.steps = np.zeros(rows, dtype=int)
        self.outcomes = np.full(rows, Outcome.RESTLESS)
        self.limit = np.full(rows, STEPS)
        self.live = np.ones(rows, dtype=bool)
        self.qpos = bench.qpos.copy()
        self.velocity = np.zeros_like(bench.qvel)
        self.step, self.ratio = np.full(rows, FIRST_STEP), np.full(rows, FIRST_DAMPING)
        self.best, self.patience = np.full(rows, np.inf), np.zeros(rows, dtype=int)
        if frames is not None:
            frames.append((0.0, self.qpos[0].copy()))

    @property
    def settled(self) -> Bool[np.ndarray, " rows"]:
        return self.outcomes == Outcome.SETTLED

    def nudge(self, rows: Bool[np.ndarray, " rows"], directions: Float[np.ndarray, "rows free"]) -> None:
        """Set ``rows`` going along the direction in which they are not held, as any breath of air would."""
        bench = self.bench
        speed = 1e-3 * self.swing * self.reach
        velocity = directions * (speed * np.where(directions.sum(1) < 0, -1, 1))[:, None]
        velocity[:, bench.angular] /= bench.length
        if bench.model.nv == 6:
            velocity[:, 3:] = np.einsum("nji,nj->ni", bench.rotations, velocity[:, 3:])
        bench.qpos[rows], bench.qvel[rows] = self.qpos[rows], velocity[rows]
        self.live |= rows
        self.outcomes[rows] = Outcome.RESTLESS
        self.step[rows], self.ratio[rows] = FIRST_STEP, FIRST_DAMPING
        self.best[rows], self.patience[rows] = np.inf, 0
        self.limit[rows] = self.steps[rows] + STEPS

    def run(self) -> None:
        """Move the live rows on until each has come to rest or will not."""
        bench = self.bench
        while self.live.any():
            bench.timestep[:] = self.step / self.swing
            bench.damping[:] = 2 * (self.ratio * self.swing)[:, None] * self.inertia / bench.unit
            self.qpos[self.live] = bench.qpos[self.live]
            self._advance()
            self._judge()
            self._adapt()

    def _advance(self) -> None:
        batch = self.bench.batch
        try:
            if self.frames is None:
                batch.step(self.live, nstep=CHUNK)
            else:
                for _ in range(CHUNK):
                    batch.step(self.live)
                    self.frames.append((float(batch.time[0]), self.bench.qpos[0].copy()))
        except SimulationError as error:
            self._end(np.isin(np.arange(len(self.live)), error.ids), Outcome.WARNED, self.qpos)
        self.steps[self.live] += CHUNK
        if batch.warning[:, :, 1].any():
            self._end(self.live & batch.warning[:, :, 1].any(1), Outcome.WARNED, self.qpos)

    def _judge(self) -> None:
        bench = self.bench
        self.residual = np.abs(bench.forces).max(1)
        calm = self.live & (self.residual <= self.target)
        if calm.any():
            # These are the forces of one time step ago, and velocity bends them: look again, at rest.
            speed = np.abs(bench.qvel)
            speed[:, bench.angular] *= bench.length
            calm &= speed.max(1) <= SPEED * self.swing * self.reach
            velocity = bench.qvel.copy()
            bench.qvel[calm] = 0
            bench.batch.forward(calm)
            at_rest = calm & (np.abs(bench.forces).max(1) <= self.target)
            bench.qvel[:] = np.where(at_rest[:, None], 0, velocity)
            self._end(at_rest, Outcome.SETTLED, bench.qpos)
        weary = self.live & (self.steps >= self.limit)
        if weary.any():
            self._end(weary, Outcome.RESTLESS, bench.qpos)

    def _end(self, rows: Bool[np.ndarray, " rows"], outcome: Outcome, qpos: np.ndarray) -> None:
        self.live &= ~rows
        self.qpos[rows] = qpos[rows]
        self.outcomes[rows] = outcome

    def _adapt(self) -> None:
        force, velocity = self.bench.accelerating / self.root_inertia, self.bench.qvel * self.root_inertia
        better = self.residual < BETTER * self.best
        slow = ~better & _parallel(force, velocity) & _parallel(velocity, self.velocity)
        self.velocity = velocity
        going = better | slow
        self.patience = np.where(going, 0, self.patience + 1)
        rattling = self.patience >= PATIENCE
        self.step = np.clip(self.step * np.where(rattling, 0.6, np.where(going, 1.2, 1.0)), SHORTEST_STEP, LONGEST_STEP)
        self.ratio = np.clip(
            self.ratio * np.where(rattling, 1.5, np.where(slow, 0.9, 1.0)), LEAST_DAMPING, MOST_DAMPING
        )
        self.best = np.where(going | rattling, self.residual, self.best)
        self.patience[rattling] = 0


def _parallel(a: Float[np.ndarray, "rows free"], b: Float[np.ndarray, "rows free"]) -> Bool[np.ndarray, " rows"]:
    return (a * b).sum(1) > ALONG * np.sqrt((a * a).sum(1) * (b * b).sum(1))


def _inertias(robot: Robot) -> Float[np.ndarray, " free"]:
    """Mass [kg] and moments of inertia about the platform's axes [kg m²], per free direction, for the damping."""
    offset = robot.center_of_mass
    about_origin = robot.inertia + robot.mass * (offset @ offset * np.eye(3) - np.outer(offset, offset))
    return np.concatenate([np.full(3, robot.mass), np.diag(about_origin)])[list(robot.free_directions)]


def _per_row(field: str, values: ArrayLike | None, rows: int) -> Sequence[ArrayLike | None]:
    if values is None:
        return [None] * rows
    array = np.asarray(values, dtype=float)
    if array.ndim == 1:
        return [array] * rows
    if len(array) != rows:
        raise InvalidInput(f"{field}: found {len(array)} rows, expected 1 or {rows}, as many as poses")
    return list(array)


def _reason(outcome: Outcome, last: Equilibrium) -> str:
    name = last.problem.robot.name
    if outcome is Outcome.RESTLESS:
        return (
            f"{name}: {outcome.value} within {last.iterations} time steps: {last.residual:.3g} N are still unbalanced"
        )
    return f"{name}: {outcome.value}"

"""Tasks of the environments: targets, observations and rewards, for many simulations at once."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, ClassVar, NamedTuple

import numpy as np
from jaxtyping import Bool, Float
from numpy.typing import ArrayLike
from scipy.spatial.transform import RigidTransform

from cdpr_sim.core.checks import checked_array, from_zero, listed, one_of, positive, whole
from cdpr_sim.core.controller import Command, Measurement, Reference
from cdpr_sim.core.equilibrium import NotConverged
from cdpr_sim.core.errors import InvalidInput
from cdpr_sim.core.pose import PoseLike
from cdpr_sim.core.pose_path import PosePath
from cdpr_sim.core.problem import Problem
from cdpr_sim.core.robot import Robot
from cdpr_sim.learning.domain import Domain
from cdpr_sim.learning.driven_model import DrivenModel
from cdpr_sim.learning.task_simulations import TaskSimulations, rotation_vectors
from cdpr_sim.physics.drive import FALLEN, poses_through
from cdpr_sim.physics.sensing import pose_of
from cdpr_sim.physics.track import CABLE_DAMPING, DAMPING
from cdpr_sim.physics.winches import WINCH_SPEED, largest_forces
from cdpr_sim.robots.catalogue import load_robot
from cdpr_sim.statics import newton

REWARDS = {"position": 1.0, "rotation": 0.5, "effort": 0.1, "slack": 0.0, "fall": 10.0}
"""Default weights of the terms of the reward (``Task.terms``)."""

NEAR, LEVEL = 0.005, 0.01
"""Errors of position, in mean rest lengths, and of rotation [rad], at which their terms are a half."""

TRIES = 100
"""Poses that are drawn at most until one is an equilibrium."""

MOST_PERIODS = 1_000_000
"""Largest number of control periods of an episode."""


class Moment(NamedTuple):
    """State of all simulations at the end of a control period, as rewards need it.

    Attributes:
        position_errors: distances of the platforms from the targets, (count,) [m].
        rotation_errors: angles between their orientations, (count,) [rad].
        actions: of this period, (count, cables).
        tensions: (count, cables) [N].
        fallen: (count,) platforms that have fallen, or whose simulation became unstable.
    """

    position_errors: Float[np.ndarray, " count"]
    rotation_errors: Float[np.ndarray, " count"]
    actions: Float[np.ndarray, "count cables"]
    tensions: Float[np.ndarray, "count cables"]
    fallen: Bool[np.ndarray, " count"]


class Task:
    """Move the platform along a reference motion by actions of the winches; the base of all tasks.

    The motion goes smoothly along straight lines, with zero velocity at both ends.

    An **observation** is, for each simulation, in SI units and in the base frame: position (3) and rotation vector (3)
    of the platform, its velocity (3) and angular velocity (3), tensions (cables), rest lengths (cables), and of the
    target at the end of the coming period: position (3), rotation vector (3) and velocity (3).

    An **action** is a number between -1 and 1 for each winch: the fraction of its largest speed, positive to let out
    rope, or for a winch that controls its tension, from 0 to the largest tension.

    Args:
        robot: a name of the catalogue, a robot file, or a ``Robot``: the nominal robot. Its cables are massless and
            linear.
        count: number of simulations.
        control: "speeds", "tensions", or the numbers, from 1, of the winches that control tensions while the others
            control speeds.
        rate: control periods per second [Hz].
        seconds: duration of an episode [s].
        domain: ranges of randomised parameters, a ``Domain`` or its arguments by name; default: the nominal robot.
        rewards: weights of terms of the reward, by name; those not given keep their default (``REWARDS``).
        winch_speed: largest rate at which a rest length changes [m/s].
        winch_force: largest tension of the winches [N], as for ``to_mjcf``.
        damping: of the platform by the air, as for ``track``.
        cable_damping: of each cable [s], as for ``track``.
        threads: number of threads; 0 is one per core.

    Raises:
        InvalidInput: an invalid argument.
    """

    defaults: ClassVar[dict[str, Any]] = {"seconds": 4.0}

    def __init__(
        self,
        robot: str | Robot = "cogiro",
        count: int = 1,
        *,
        control: str | Sequence[int] = "speeds",
        rate: float = 100.0,
        seconds: float | None = None,
        domain: Domain | Mapping[str, float] | None = None,
        rewards: Mapping[str, float] | None = None,
        winch_speed: float = WINCH_SPEED,
        winch_force: ArrayLike | None = None,
        damping: float = DAMPING,
        cable_damping: float = CABLE_DAMPING,
        threads: int = 1,
    ) -> None:
        self.robot = robot = robot if isinstance(robot, Robot) else load_robot(robot)
        robot.cabling.refuse_memory()
        robot.cabling.refuse_unknown("learning", "cdpr_sim.learning")
        if not robot.cabling.linear:
            cable = int(np.argmax(robot.cabling.nonlinear)) + 1
            raise InvalidInput(
                f"cdpr_sim.learning: found cable {cable} with nonlinear elasticity, expected linear ones: the winch of "
                "a nonlinear cable has no limit of force, without which random controls end a simulation"
            )
        self.count, period = whole("count", count, 1), 1 / positive("rate", rate, "Hz")
        seconds = positive("seconds", self.defaults["seconds"] if seconds is None else seconds, "s")
        self.periods = whole("seconds times rate", max(1, round(seconds / period)), 1, MOST_PERIODS)
        self.period, self.seconds = period, self.periods * period
        self.domain = domain if isinstance(domain, Domain) else Domain(**(domain or {}))
        for name in rewards or {}:
            one_of("term of the reward", name, REWARDS)
        self.weights = REWARDS | {name: float(checked_array(name, of, ())) for name, of in (rewards or {}).items()}
        by_tension, largest = self._by_tension(control), largest_forces(robot, winch_force)
        machine = DrivenModel(
            robot,
            robot.pose(robot.home),
            robot.rest_lengths(robot.home),
            winch_speed=positive("winch_speed", winch_speed, "m/s"),
            damping=from_zero("damping", damping),
            cable_damping=from_zero("cable_damping", cable_damping),
            winch_force=largest,
        )
        self.simulations = TaskSimulations(
            machine, count, period=period, by_tension=by_tension, largest=largest, threads=threads
        )
        states = self.periods + 1
        self.references: list[Reference | None] = [None] * count
        self.robots = [robot] * count
        self.frictions = np.zeros((count, robot.cables))
        self.ticks = np.zeros(count, dtype=int)
        # Of each period: where the platform is wanted (position, quaternion), and what is observed of the next period.
        self._plan = np.zeros((count, states, 16))
        self._every, self._first = self._plan.reshape(-1, 16), states * np.arange(count)
        self._look()
        speeds = ~self.simulations.by_tension
        self._effort = speeds / -max(1, speeds.sum())
        self._far = FALLEN / robot.cables
        self._near = NEAR * robot.rest_lengths(robot.home).mean()
        self.size = 12 + 2 * robot.cables + 9

    def _by_tension(self, control: str | Sequence[int]) -> Bool[np.ndarray, " cables"]:
        if isinstance(control, str):
            one_of("control", control, ("speeds", "tensions"))
            return np.full(self.robot.cables, control == "tensions")
        given = listed("control", control, "'speeds', 'tensions' or numbers of cables")
        chosen = {whole("control", cable, 1, self.robot.cables) for cable in given}
        return np.isin(np.arange(1, self.robot.cables + 1), list(chosen))

    # What differs between tasks.

    def draw(self, random: np.random.Generator) -> tuple[list[RigidTransform], RigidTransform]:
        """Waypoints of the reference motion of an episode, and the pose at which the platform is commanded first.

        Here three level poses in the robot's workspace, and the first of them.
        """
        poses = [self.random_pose(random) for _ in range(3)]
        return poses, poses[0]

    def terms(self, moment: Moment) -> dict[str, Float[np.ndarray, " count"]]:
        """Terms of the reward of a period, before they are multiplied by their weights.

        ``position`` and ``rotation`` are 1 without an error, and a half at 0.5 % of the mean rest length and at 0.01
        rad. ``effort`` is minus the mean square of the actions: of speeds; ``slack`` is minus the share of slack
        cables, where its weight is not zero; ``fall`` is -1 when the platform falls.
        """
        terms = {
            "position": self._near / (self._near + moment.position_errors),
            "rotation": LEVEL / (LEVEL + moment.rotation_errors),
            "effort": np.add.reduce(moment.actions * moment.actions * self._effort, 1),
            "fall": -1.0 * moment.fallen,
        }
        if self.weights["slack"]:
            terms["slack"] = -(moment.tensions <= 0).sum(1) / self.robot.cables  # of cables without mass
        return terms

    # What is the same.

    def random_pose(self, random: np.random.Generator) -> RigidTransform:
        """A level pose in the workspace."""
        lower, upper = self.robot.workspace
        return RigidTransform.from_translation(random.uniform(lower, upper))

    def begin(
        self,
        row: int,
        random: np.random.Generator,
        waypoints: Sequence[PoseLike] | np.ndarray | None = None,
        start: PoseLike | None = None,
    ) -> None:
        """Begin an episode in one simulation, in equilibrium on the rigid lengths at the start.

        Args:
            row: the simulation.
            random: of all that is drawn.
            waypoints: of the reference motion; default: drawn.
            start: the pose commanded first; default: the first waypoint, or drawn with them.

        Raises:
            InvalidInput: invalid poses; no equilibrium there, or at none of many poses that were drawn.
        """
        robot, friction = self.domain.draw(self.robot, random)
        for _ in range(TRIES):
            if waypoints is None:
                poses, first = self.draw(random)
            else:
                poses = poses_through(self.robot, waypoints)
                first = poses[0]
            first = first if start is None else self.robot.pose(start)
            self.robots[row], self.frictions[row] = robot, friction
            try:
                self.restart(row, self.robot.rest_lengths(first), first)
            except (NotConverged, InvalidInput):
                if waypoints is not None:
                    raise
                continue
            self._follow(row, Reference(PosePath(self.robot, poses), self.seconds))
            return
        raise InvalidInput(
            f"workspace: found no equilibrium of {self.robot.name!r} at {TRIES} poses in it, expected some"
        )

    def restart(self, row: int, rest_lengths: ArrayLike, pose: PoseLike) -> None:
        """Put the platform of one simulation at rest in the equilibrium on ``rest_lengths`` [m] near ``pose``.

        Raises:
            InvalidInput: lengths out of range.
            NotConverged: there is no equilibrium.
        """
        machine, robot = self.simulations.machine, self.robots[row]
        lengths = machine.checked(rest_lengths).rest_lengths
        found = newton.solve(Problem.of(robot, pose, lengths))
        self.simulations.begin(row, robot, self.frictions[row], found.pose, lengths)
        self.ticks[row] = 0

    def _follow(self, row: int, reference: Reference) -> None:
        """Give a simulation its reference motion."""
        self.references[row] = reference
        times = self.period * np.arange(self.periods + 1)
        poses = reference.poses(times)
        positions, facing = poses.translation, poses.rotation.as_quat(canonical=True, scalar_first=True)
        following = np.minimum(np.arange(self.periods + 1) + 1, self.periods)
        velocities = (positions[following] - positions[following - 1]) / self.period
        parts = positions, facing, positions[following], rotation_vectors(facing[following]), velocities
        self._plan[row] = np.concatenate(parts, axis=1)
        self._look()

    def _look(self) -> None:
        """Find the present targets in the plans."""
        self._now = self._every.take(self._first + self.ticks, axis=0)

    def observe(self) -> Float[np.ndarray, "count size"]:
        """Observations of all simulations."""
        simulations, poses = self.simulations, self.simulations.poses
        pose = poses[:, :3], rotation_vectors(poses[:, 3:])
        cables = simulations.tensions, simulations.rest_lengths
        return np.concatenate([*pose, simulations.twists(), *cables, self._now[:, 7:]], axis=1)

    def step(
        self, actions: Float[np.ndarray, "count cables"]
    ) -> tuple[
        Float[np.ndarray, " count"], Bool[np.ndarray, " count"], Bool[np.ndarray, " count"], dict[str, np.ndarray]
    ]:
        """Simulate a control period.

        Returns:
            Rewards; whether the platform has fallen; whether the episode has reached its end; and the terms of the
            rewards, with the errors of ``Moment``.

        Raises:
            InvalidInput: no episode has begun.
        """
        if None in self.references:
            raise InvalidInput("step: found no episode, expected reset() before the first step")
        actions = np.minimum(np.maximum(actions, -1.0), 1.0)
        simulations = self.simulations
        simulations.advance(actions)
        self.ticks = np.minimum(self.ticks + 1, self.periods)
        self._look()
        poses, now = simulations.poses, self._now
        away = poses[:, :3] - now[:, :3]
        errors = np.sqrt(np.add.reduce(away * away, 1))
        angles = 2 * np.arccos(np.minimum(np.abs(np.add.reduce(poses[:, 3:] * now[:, 3:7], 1)), 1.0))
        # As ``track`` judges: far away, or turned over.
        near = errors <= self._far * np.add.reduce(simulations.rest_lengths, 1)
        fallen = simulations.failed | ~near | simulations.overturned
        moment = Moment(errors, angles, actions, simulations.tensions, fallen)
        terms = self.terms(moment)
        rewards = sum((self.weights.get(name, 1.0) * term for name, term in terms.items()), np.zeros(self.count))
        info = {"position_error": errors, "rotation_error": angles} | {
            f"reward_{name}": of for name, of in terms.items()
        }
        return rewards, fallen, self.ticks >= self.periods, info

    # For controllers and pictures.

    def target(self, row: int) -> Float[np.ndarray, "7"]:
        """Present target of the platform of one simulation: position [m], and quaternion w x y z."""
        return self._now[row, :7]

    def measurement(self, row: int) -> Measurement:
        """What exact sensors without delay measure in one simulation."""
        pose, _, tensions, rest_lengths = self.simulations.seen(row)
        return Measurement(float(self.ticks[row] * self.period), pose_of(pose), tensions, rest_lengths)

    def action_of(self, row: int, answer: Command | ArrayLike) -> Float[np.ndarray, " cables"]:
        """The action by which winches come nearest to a controller's command.

        Raises:
            InvalidInput: a command that these winches cannot carry out, or that controls the tensions of others.
        """
        simulations = self.simulations
        command = simulations.machine.checked(answer)
        if not np.array_equal(command.by_tension, simulations.by_tension):
            found, ours = (np.flatnonzero(one) + 1 for one in (command.by_tension, simulations.by_tension))
            raise InvalidInput(
                f"control: found winches {ours.tolist()} that control tensions, and a command of the tensions of "
                f"{found.tolist()}; expected control={found.tolist()}"
            )
        speeds = (command.rest_lengths - simulations.rest_lengths[row]) / (
            simulations.machine.winch_speed * self.period
        )
        tensions = 2 * command.tensions / simulations.largest - 1
        return np.where(simulations.by_tension, tensions, speeds).clip(-1, 1)


class ReachTask(Task):
    """Reach a pose from another one, and stay there."""

    defaults: ClassVar[dict[str, Any]] = {"seconds": 2.0}

    def draw(self, random: np.random.Generator) -> tuple[list[RigidTransform], RigidTransform]:
        """A level pose in the workspace to be reached, and another one to start from."""
        start, target = self.random_pose(random), self.random_pose(random)
        return [target], start

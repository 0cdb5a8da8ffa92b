"""Comparison of control schemes: the same motions on the same robots, by controllers with model errors."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from cdpr_sim.analysis.compensation import default_limits
from cdpr_sim.analysis.workspace.feasibility import feasible
from cdpr_sim.control.elastic_lengths import ElasticLengths
from cdpr_sim.control.held_tensions import HeldTensions
from cdpr_sim.control.lengths_and_tensions import LengthsAndTensions
from cdpr_sim.control.pose_feedback import PoseFeedback
from cdpr_sim.control.rigid_lengths import RigidLengths
from cdpr_sim.core.controller import Controller, Sensors
from cdpr_sim.core.materials import PAPER_MATERIALS
from cdpr_sim.core.memory import without_memory
from cdpr_sim.core.problem import Problem
from cdpr_sim.core.robot import Robot
from cdpr_sim.core.trajectory import PlatformFell, Trajectory
from cdpr_sim.physics.drive import PEAK
from cdpr_sim.physics.track import track
from cdpr_sim.robots.catalogue import load_robot
from lines import PAPER_LINE

LAYOUTS = ("cogiro", "parallel")
SPEEDS = (0.05, 0.5)
"""[m/s] Top speeds; the mean is lower by 1.875."""

HEIGHT, RADIUS, CORNERS = 0.1, 0.1, 120
"""[m] Height of the line and the circle; radius of the circle about the middle of the workspace, and its number of
segments."""

STIFFNESS_BELIEVED = 0.8
"""EA in the controllers' model, as a fraction of the true EA."""

EXIT_OFF = (0.005, 0.0, 0.0)
"""[m] Error of the exit of cable 1 in the controllers' model."""

PAUSE = 4.0
"""[s] Pause before the motion, excluded from the errors: feedback has converged by then."""

SENSORS = Sensors(period=0.01, delay=0.01, position_noise=6.5e-5, rotation_noise=1e-3, seed=1)
"""The paper's tracker is accurate to 0.065 mm, which over half a platform is 1e-3 rad; rate and delay are assumed."""

RIGID, ELASTIC, TENSIONS, MIXED = "rigid lengths", "elastic lengths", "tensions", "lengths and tensions"
RIGID_FEEDBACK, ELASTIC_FEEDBACK = "rigid, pose feedback", "elastic, pose feedback"

SCHEMES: dict[str, Callable[[Robot], Controller]] = {
    RIGID: RigidLengths,
    ELASTIC: ElasticLengths,
    TENSIONS: HeldTensions,
    MIXED: LengthsAndTensions,
    RIGID_FEEDBACK: lambda robot: PoseFeedback(RigidLengths(robot)),
    ELASTIC_FEEDBACK: lambda robot: PoseFeedback(ElasticLengths(robot)),
}
"""Controllers by name, as functions of the model robot."""


@dataclass(frozen=True)
class TrackingTask:
    """A motion of a robot.

    Attributes:
        layout: name of the robot.
        material: of its cables.
        path: "line" or "circle".
        speed: largest speed [m/s].
    """

    layout: str
    material: str
    path: str
    speed: float

    @property
    def robot(self) -> Robot:
        """The true robot."""
        return load_robot(self.layout).replace(material=self.material)

    @property
    def waypoints(self) -> Float[np.ndarray, "waypoints 3"]:
        """Level positions [m]."""
        middle = self.robot.home
        if self.path == "line":
            return np.array([[x, middle[1], HEIGHT] for x in PAPER_LINE])
        turned = np.linspace(0, 2 * np.pi, CORNERS + 1)
        return np.stack([*(middle[:2, None] + RADIUS * np.array([np.cos(turned), np.sin(turned)])),
                         np.full(len(turned), HEIGHT)], axis=1)  # fmt: skip

    @property
    def seconds(self) -> float:
        """Duration of the motion."""
        return float(PEAK * np.linalg.norm(np.diff(self.waypoints, axis=0), axis=1).sum() / self.speed)


def tasks() -> tuple[TrackingTask, ...]:
    """All tasks."""
    return tuple(TrackingTask(*one) for one in itertools.product(LAYOUTS, PAPER_MATERIALS, ("line", "circle"), SPEEDS))


def believed(robot: Robot) -> Robot:
    """The controllers' model of the robot, with errors of EA and of one exit."""
    exits = robot.exits.copy()
    exits[0] += EXIT_OFF
    return robot.replace(exits=exits, axial_stiffness=STIFFNESS_BELIEVED * robot.axial_stiffness)


ROPES = {
    "elastic": {"hysteresis": [(1e-6, np.inf, 1e-6)]},
    "friction 2 %": {"pulley_friction": 0.02},
    "friction 5 %": {"pulley_friction": 0.05},
    "hysteresis 5 %": {"hysteresis": [(0.2, np.inf, 0.1)]},
    "hysteresis 10 %": {"hysteresis": [(0.2, np.inf, 0.2)]},
}
"""What ropes have besides elasticity: friction c at the exits, or a loop as a part of the tension. Assumed, in the
range of measured ropes (``docs/concepts/memory.md``). Elastic ones have a loop of 1e-12, so that all are simulated in
the same way: ``track`` damps the strain of ropes with a memory, and the length of others."""

BEHIND = 0.5
"""[m] Assumed rope between winch and exit: friction acts on winches that control lengths through it."""


@dataclass(frozen=True)
class RopeTask(TrackingTask):
    """A motion of a robot on ropes with a memory.

    Attributes:
        ropes: a key of ``ROPES``.
    """

    ropes: str

    @property
    def robot(self) -> Robot:
        """The true robot."""
        return super().robot.replace(winch_to_exit=BEHIND, **ROPES[self.ropes])


def rope_tasks() -> tuple[RopeTask, ...]:
    """A fast circle of the crossed layout on all ropes."""
    return tuple(RopeTask(LAYOUTS[0], PAPER_MATERIALS[-1], "circle", SPEEDS[-1], ropes) for ropes in ROPES)


@dataclass(frozen=True, eq=False)
class Run:
    """Result of a task with a control scheme; errors and tensions are those after the pause.

    Attributes:
        task: the motion.
        scheme: name of the control scheme.
        trajectory: the simulated motion.
        fell: whether the platform fell, which ends the trajectory.
    """

    task: TrackingTask
    scheme: str
    trajectory: Trajectory
    fell: bool

    @property
    def moving(self) -> Bool[np.ndarray, " states"]:
        """States after the pause; all states if the platform fell before."""
        counts = self.trajectory.times >= PAUSE
        return counts if counts.any() else ~counts

    @property
    def position_errors(self) -> Float[np.ndarray, " counted"]:
        """Distances from the commanded position [m]."""
        return np.linalg.norm(self.trajectory.deviation, axis=1)[self.moving]

    @property
    def tilts(self) -> Float[np.ndarray, " counted"]:
        """Errors of tilt [rad]; commanded is 0."""
        return self.trajectory.tilt[self.moving]

    @property
    def lowest_tension(self) -> float:
        """Smallest tension of all cables [N]."""
        return float(self.trajectory.tensions[self.moving].min())

    @property
    def highest_tension(self) -> float:
        """Largest tension of all cables [N]."""
        return float(self.trajectory.tensions[self.moving].max())


def rms(values: Float[np.ndarray, " values"]) -> float:
    """Root mean square."""
    return float(np.sqrt(np.mean(values**2)))


def run(task: TrackingTask, scheme: str, *, robot: Robot | None = None, wrong: Robot | None = None) -> Run:
    """Simulate one task with one scheme.

    Args:
        task: the motion.
        scheme: a key of ``SCHEMES``.
        robot: the true robot, if already loaded.
        wrong: the controller's model, if already made; plans are cached for further runs with the same model.
    """
    robot = task.robot if robot is None else robot
    controller = SCHEMES[scheme](believed(robot) if wrong is None else wrong)
    try:
        done = track(robot, task.waypoints, controller, seconds=task.seconds, pause=PAUSE, sensors=SENSORS)
    except PlatformFell as error:
        if error.trajectory is None:
            raise
        return Run(task, scheme, error.trajectory, fell=True)
    return Run(task, scheme, done, fell=False)


def runs(progress: Callable[[float], None] | None = None) -> tuple[Run, ...]:
    """Every task with every scheme."""
    return _every(tasks(), believed, progress)


def rope_runs(progress: Callable[[float], None] | None = None) -> tuple[Run, ...]:
    """Every task on ropes with a memory with every scheme, whose model is right but for the memory."""
    return _every(rope_tasks(), without_memory, progress)


def _every(
    tasks: Sequence[TrackingTask], believed: Callable[[Robot], Robot], progress: Callable[[float], None] | None
) -> tuple[Run, ...]:
    """Each task with each scheme; ``believed`` makes the controllers' model of a robot."""
    robots = {_ropes_of(task): task.robot for task in tasks}
    models = {key: believed(robot) for key, robot in robots.items()}
    pairs = list(itertools.product(tasks, SCHEMES))
    results = []
    for number, (task, scheme) in enumerate(pairs):
        key = _ropes_of(task)
        results.append(run(task, scheme, robot=robots[key], wrong=models[key]))
        if progress is not None:
            progress((number + 1) / len(pairs))
    return tuple(results)


def _ropes_of(task: TrackingTask) -> tuple[str, ...]:
    """What makes two tasks those of one robot."""
    return task.layout, task.material, task.ropes if isinstance(task, RopeTask) else ""


def held(task: TrackingTask, poses: int = 200) -> float:
    """Fraction of the path along which tensions within the limits of ``compensate`` can hold the platform level."""
    robot, waypoints = task.robot, task.waypoints
    along = np.append(0, np.cumsum(np.linalg.norm(np.diff(waypoints, axis=0), axis=1)))
    at = np.linspace(0, along[-1], poses)
    points = np.stack([np.interp(at, along, column) for column in waypoints.T], axis=1)
    limits = default_limits(Problem.of(robot, points[0]))
    return float(np.mean(feasible(robot, points, tension_limits=limits)))

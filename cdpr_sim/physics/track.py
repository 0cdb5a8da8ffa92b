"""Tracking in MuJoCo: a controller in closed loop along a reference motion, with imperfect winches and sensors.

Time is divided into control periods. In each, the controller gets the newest sample that has arrived from the sensors,
and commands the winches for the end of the next period; meanwhile they move at constant speed, as interpolating drives
do, and no faster than their maximum. ``motion`` describes the motion. A winch that controls the tension of a massless
cable is a constant force: an ideal motor with free speed. Its speed is limited too; at the limit its length is
controlled, and its cable is a spring again. Of a cable with mass it lets out, at each step, the length that gives the
cable's end this tension. Cables with a memory pull as ``rope_motion`` describes.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager

import numpy as np
from jaxtyping import Float
from numpy.typing import ArrayLike
from scipy.spatial.transform import RigidTransform

from cdpr_sim.core.checks import PROGRESS, from_zero, positive, refuse_unless
from cdpr_sim.core.controller import Command, Controller, Reference, Sensors
from cdpr_sim.core.errors import CdprError, InvalidInput
from cdpr_sim.core.pose import PoseLike
from cdpr_sim.core.pose_path import PosePath
from cdpr_sim.core.problem import Problem, Problems
from cdpr_sim.core.robot import Robot, without_mass
from cdpr_sim.core.trajectory import BadCommand, PlatformFell, Trajectory
from cdpr_sim.physics import winches
from cdpr_sim.physics.cable import Law
from cdpr_sim.physics.chains import refuse_short
from cdpr_sim.physics.damping import STEPS, stiffest
from cdpr_sim.physics.drive import MOST_SECONDS, MOST_STATES, PAUSE, fallen, poses_through, problems_at
from cdpr_sim.physics.mjcf import TIMESTEP, settling_air
from cdpr_sim.physics.motion import Motion
from cdpr_sim.physics.quiet import quiet
from cdpr_sim.physics.sensing import Seen, Sensing, recorded
from cdpr_sim.physics.settle import at_rest, settle, single, weighs
from cdpr_sim.physics.settle_path import settle_path
from cdpr_sim.physics.simulations import Simulations
from cdpr_sim.physics.winches import WINCH_SPEED

SPEED = 0.05
"""[m/s] Default of the mean speed along the waypoints."""

DAMPING = 0.05
"""Default damping of the platform's slowest oscillation, as a fraction of critical damping: it oscillates for
some periods, as platforms on cables do."""

CABLE_DAMPING = 2.5e-4
"""[s] Assumed: a loss factor of 2 % at the 10 Hz of ``cogiro``'s motion of least stiffness on fishing line, of 5 % at
Vectran's 33 Hz."""

MOST_CABLE_DAMPING = 1.0
"""[s] Such a cable's stretch decays in seconds. Chains became unstable beyond 3 s, for ``segesta``."""

ROUNDING = 1e-9
"""Rounding of a length or a number of steps, as a fraction."""

STRETCHES = 2.0
"""How many times as far as at the first lengths a nonlinear cable is assumed to stretch in a motion."""

EXACT = Sensors()
"""Default sensors: at 100 Hz, without delay and noise."""


def track(
    robot: Robot,
    waypoints: RigidTransform | Sequence[PoseLike] | np.ndarray,
    controller: Controller,
    *,
    seconds: float | None = None,
    pause: float = 0.0,
    rate: float = 100.0,
    sensors: Sensors = EXACT,
    winch_speed: float = WINCH_SPEED,
    damping: float = DAMPING,
    cable_damping: float = CABLE_DAMPING,
    progress: Callable[[float], None] | None = None,
) -> Trajectory:
    """Move the platform along ``waypoints`` in MuJoCo by the commands of ``controller``, which gets only measurements.

    The reference moves along straight lines from waypoint to waypoint as described in ``core.pose_path``: smoothly,
    with zero velocity at both ends. The platform starts in equilibrium on the controller's first lengths.

    Args:
        robot: the simulated robot; the controller may have another model. Cables with a memory start as new ropes.
        waypoints: reference poses in order, at least one: (rows, 3), (rows, 6) or a stack of transforms. A single one
            is held.
        controller: any object with the two methods of ``Controller``; those of ``cdpr_sim.control``, for instance.
        seconds: duration of the motion; default: at 0.05 m/s in the mean.
        pause: time at the first waypoint before the motion begins [s].
        rate: rate of the controller [Hz]; the last period is shorter if the motion ends within it.
        sensors: properties of the sensors.
        winch_speed: largest rate at which a rest length changes [m/s].
        damping: damping of the platform's slowest oscillation by the air, as a fraction of critical.
        cable_damping: damping of each cable: its resistance to stretching, as a multiple of its stiffness [s], at
            most 1.
        progress: is called from time to time with the fraction done, 0 to 1.

    Returns:
        A state for each control period, the first and the last instant included. Its commanded poses are those of the
        reference, its rest lengths those that the winches had let out.

    Raises:
        InvalidInput: an invalid argument; a pose that no rest lengths can hold.
        NotSettled: the platform does not come to rest on the controller's first lengths.
        PlatformFell: it fell during the motion; carries the trajectory so far.
        BadCommand: the controller failed, or gave a command that winches cannot carry out; carries the trajectory so
            far.
    """
    refuse_unless(PROGRESS, progress=progress)
    reference = _course(robot, waypoints, seconds, pause)
    period = min(1 / positive("rate", rate, "Hz"), reference.end)
    refuse_unless(Sensors, sensors=sensors)
    _check_controller(controller)
    speed = positive("winch_speed", winch_speed, "m/s")
    if reference.end / period >= MOST_STATES:
        raise InvalidInput(f"rate: found {rate:g} Hz for {reference.end:g} s, expected at most {MOST_STATES} states")
    times = period * np.arange(np.ceil(reference.end / period - ROUNDING) + 1)
    times[-1] = reference.end
    wanted = reference.poses(times)
    held = problems_at(robot, wanted)
    with _errors_named(robot, "when the controller starts"):
        lengths = Command.of(controller.start(reference), robot.cables).rest_lengths
    with quiet():
        machine = Machine(
            robot if weighs(robot) else without_mass(robot),
            wanted[0],
            lengths,
            winch_speed=speed,
            damping=from_zero("damping", damping),
            cable_damping=from_zero("cable_damping", cable_damping, MOST_CABLE_DAMPING),
        )
        seen: list[Seen] = []
        try:
            _run(machine, controller, Sensing(sensors), times, held, seen, progress)
        except (PlatformFell, BadCommand) as stopped:
            stopped.trajectory = recorded(robot, wanted, times, seen)
            raise
    return recorded(robot, wanted, times, seen)


def _course(
    robot: Robot,
    waypoints: RigidTransform | Sequence[PoseLike] | np.ndarray,
    seconds: float | None,
    pause: float,
) -> Reference:
    path = PosePath(robot, poses_through(robot, waypoints))
    if seconds is None:
        seconds = path.length / SPEED or PAUSE
    seconds = positive("seconds", seconds, "s")
    pause = from_zero("pause", pause)
    if not seconds + pause <= MOST_SECONDS:
        raise InvalidInput(f"seconds: found {seconds + pause:g} with the pause, expected at most {MOST_SECONDS:g}")
    return Reference(path, seconds, pause)


def _check_controller(controller: Controller) -> None:
    if isinstance(controller, type):
        found = controller.__name__
        raise InvalidInput(f"controller: found the class {found}, expected an object of it, such as {found}(robot)")
    for name in ("start", "command"):
        if not callable(getattr(controller, name, None)):
            raise InvalidInput(f"controller: found {controller!r}, expected an object with a method {name!r}")


@contextmanager
def _errors_named(robot: Robot, when: str) -> Iterator[None]:
    """Converts any exception of a user's controller into a ``BadCommand`` with the time."""
    try:
        yield
    except Exception as error:
        what = str(error) if isinstance(error, CdprError) else f"found {type(error).__name__}: {error}"
        raise BadCommand(f"{robot.name}: {when}: {what}") from error


def _run(
    machine: Machine,
    controller: Controller,
    sensing: Sensing,
    times: Float[np.ndarray, " ticks"],
    wanted: Problems,
    seen: list[Seen],
    progress: Callable[[float], None] | None,
) -> None:
    """Run from the first of ``times`` to the last; the state at each is appended to ``seen``.

    Raises:
        PlatformFell: the platform fell during the motion.
        BadCommand: the controller gave no command that the winches can carry out.
    """
    name, last = machine.robot.name, len(times) - 1
    for tick, time in enumerate(times.tolist()):
        if machine.finite:
            seen.append(machine.seen())
        position, rotation = wanted.positions[tick], wanted.rotations[tick]
        motion = machine.motion
        fell = fallen(position, rotation, motion.let_out, motion.data, motion.platform)
        if fell:
            x, y, z = position
            raise PlatformFell(
                f"{name}: found the platform fallen {time:.4g} s into the motion, when the reference was at ({x:.3g}, "
                f"{y:.3g}, {z:.3g}) m: {fell}"
            )
        if progress is not None:
            progress(tick / last)
        if tick == last:
            return
        if sensing.due(time):
            sensing.sample(time, machine.seen())
        then = float(times[tick + 1])
        with _errors_named(machine.robot, f"controller: {time:.4g} s into the motion"):
            command = machine.checked(controller.command(then, wanted.poses[tick + 1], sensing.newest(time)))
        looked = False
        for passed in machine.follow(command, then - time):
            looked = sensing.due(time + passed)
            if looked:
                machine.look()
                if machine.finite:
                    sensing.sample(time + passed, machine.seen())
        if not looked:
            machine.look()


class Machine:
    """A robot in motion, from its equilibrium on its first lengths, with winches of limited speed and range.

    Attributes:
        robot: the robot.
        motion: its motion in MuJoCo, with the platform and the cables damped.
        winch_speed: largest rate at which a rest length changes [m/s].
        reach: shortest and longest lengths that the winches can let out, (2, cables) [m].
        finite: whether the pose was finite at the last look: not after the simulation became unstable.
    """

    def __init__(
        self,
        robot: Robot,
        pose: RigidTransform,
        lengths: Float[np.ndarray, " cables"],
        *,
        winch_speed: float,
        damping: float,
        cable_damping: float,
    ) -> None:
        self.robot, self.winch_speed, heavy = robot, winch_speed, weighs(robot)
        written = Problem.of(robot, pose)
        self.reach = winches.reach(robot, written.rest_lengths)
        first = Problem.of(robot, pose, self.checked(lengths).rest_lengths)
        memory = None
        if robot.cabling.has_memory.any():
            path = settle_path(Problems.stack([first]))
            start, memory = path[0].pose, path.memory[None]
        else:
            start = settle(first).pose
        if heavy:
            refuse_short(robot, first.rest_lengths)
        simulation = at_rest(first, start) if heavy else single(first, start)
        square, mass = _stiffest(robot, written, simulation)
        drag = damping * settling_air(written)[0] / robot.mass  # [1/s]
        damped = drag + cable_damping * square
        self.motion = Motion(
            simulation,
            min(TIMESTEP, 2 * np.pi / np.sqrt(square) / STEPS),
            damping=drag * mass.diagonal(),
            cable_damping=cable_damping,
            damping_time=1 / damped if damped else np.inf,
            memory=memory,
        )
        self.look()

    def checked(self, answer: Command | ArrayLike) -> Command:
        """A controller's return value as a command that the winches can carry out (``winches.checked``)."""
        return winches.checked(self.robot, answer, self.reach)

    def look(self) -> None:
        """Read the state out of MuJoCo."""
        motion, seen = self.motion, self.motion.look()
        read = np.concatenate([seen.positions[0], motion.data.xquat[motion.platform]])
        self.finite = bool(np.isfinite(read).all())
        self._seen = read, seen.lengths[0], seen.tensions[0], motion.let_out.copy()

    def seen(self) -> Seen:
        """The state as of the last look."""
        return self._seen

    def follow(self, command: Command, seconds: float) -> Iterator[float]:
        """Run for ``seconds``, step by step: the time [s] since its beginning, after each.

        A winch that can reach the length of its tension holds it; else its length changes as fast as it can.
        """
        motion, by_tension = self.motion, command.by_tension
        start, some = motion.let_out, bool(by_tension.any())
        rates = ((command.rest_lengths - start) / seconds).clip(-self.winch_speed, self.winch_speed)
        motion.hold(np.zeros(self.robot.cables, dtype=bool), command.tensions)

        def let_out(now: float, step: float) -> Float[np.ndarray, " cables"]:
            lengths = start + now * rates
            if some:
                held, most = motion.lengths_under(command.tensions, step), self.winch_speed * step
                near = held.clip(motion.let_out - most, motion.let_out + most).clip(*self.reach)
                motion.hold(by_tension & (near == held), command.tensions)
                lengths = np.where(by_tension, near, lengths)
            return lengths

        yield from motion.steps(seconds, let_out)


def _stiffest(robot: Robot, written: Problem, simulation: Simulations) -> tuple[float, Float[np.ndarray, "free free"]]:
    """``damping.stiffest`` with the cables' stiffness near the first lengths; of nonlinear ones, at rest there.

    Exits that give way make nothing stiffer: with them, no oscillation is faster.
    """
    cabling, rest = robot.cabling, written.rest_lengths
    law = Law.of(cabling)
    springs = np.where(law.held, law.sticking(rest).stiffness, law.springs(rest).stiffness)
    if not cabling.linear:
        simulation.residuals(simulation.all)
        first = simulation.first
        stretch = np.maximum(simulation.ten_length[0, first] - simulation.bands[0, first, 1], 0)
        near = law.springs(rest)._replace(stiffness=springs)
        springs = np.maximum(springs, near.force(STRETCHES * stretch)[1])
    model = simulation.batch.get_model(0)
    model.dof_armature[: simulation.free] = 0  # which is for settling
    return stiffest(model, robot, springs)

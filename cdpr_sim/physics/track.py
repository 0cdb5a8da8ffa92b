"""Tracking in MuJoCo: a controller in closed loop along a reference motion, with imperfect winches and sensors.

Time is divided into control periods. In each, the controller gets the newest sample that has arrived from the sensors,
and commands the winches for the end of the next period; meanwhile they move at constant speed, as interpolating drives
do, and no faster than their maximum. A winch that controls a length is the model's actuator at that control. One that
controls a tension is the same actuator with a constant force instead of a spring: an ideal motor with free speed. Its
speed is limited too; at the limit its length is controlled, and its cable is a spring again. Robots whose cables have
mass or are nonlinear have no actuators: their winches let out lengths as ``sagging.chain_motion`` describes, and one
that controls a tension lets out, at each step, the length that gives the cable's end this tension.
Cables with a memory pull as ``rope_motion`` describes.
"""

# pyright: reportAttributeAccessIssue=false
# mujoco ships no type stubs for its compiled modules.
from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager

import mujoco
import numpy as np
from jaxtyping import Float
from numpy.typing import ArrayLike
from scipy.spatial.transform import RigidTransform

from cdpr_sim.core.checks import PROGRESS, from_zero, positive, refuse_unless
from cdpr_sim.core.controller import Command, Controller, Reference, Sensors
from cdpr_sim.core.errors import CdprError, InvalidInput
from cdpr_sim.core.memory import without_memory
from cdpr_sim.core.pose import PoseLike
from cdpr_sim.core.pose_path import PosePath
from cdpr_sim.core.problem import Problem, Problems
from cdpr_sim.core.robot import Robot
from cdpr_sim.core.trajectory import BadCommand, PlatformFell, Trajectory
from cdpr_sim.physics import tendons, winches
from cdpr_sim.physics.chains import refuse_short
from cdpr_sim.physics.damping import STEPS, stiffest
from cdpr_sim.physics.drive import MOST_SECONDS, MOST_STATES, PAUSE, fallen, poses_through, problems_at
from cdpr_sim.physics.dynamic_relaxation import inertias
from cdpr_sim.physics.mjcf import TIMESTEP, place, settling_air, to_mjcf
from cdpr_sim.physics.quiet import quiet
from cdpr_sim.physics.rope_motion import RopeMotion
from cdpr_sim.physics.sagging.chain_derivatives import ChainDerivatives
from cdpr_sim.physics.sagging.chain_motion import LEAST_AHEAD, ChainMotion
from cdpr_sim.physics.sagging.settle_chains import at_rest, single
from cdpr_sim.physics.sensing import Readings, Seen, Sensing, recorded
from cdpr_sim.physics.settle import settle, weighs, weightless
from cdpr_sim.physics.settle_path import settle_path
from cdpr_sim.physics.winches import WINCH_SPEED

SPEED = 0.05
"""[m/s] Default of the mean speed along the waypoints."""

DAMPING = 0.05
"""Default damping of the platform's slowest oscillation, as a fraction of critical damping: it oscillates for
some periods, as platforms on cables do."""

CABLE_DAMPING = 2.5e-4
"""[s] Assumed: a loss factor of 2 % at the 10 Hz of ``cogiro``'s motion of least stiffness on fishing line, of 5 % at
Vectran's 33 Hz."""

ROUNDING = 1e-9
"""Rounding of a length or a number of steps, as a fraction."""

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
        cable_damping: damping of each cable: its resistance to stretching, as a multiple of its stiffness [s].
        progress: is called from time to time with the fraction done, 0 to 1.

    Returns:
        A state for each control period, the first and the last instant included. Its commanded poses are those of the
        reference, its rest lengths those that the winches had let out.

    Raises:
        InvalidInput: an invalid argument; cables with a memory and mass or nonlinear elasticity; a pose that no rest
            lengths can hold.
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
        machine = _kind_of_machine(robot)(
            robot if weighs(robot) else weightless(robot),
            wanted[0],
            lengths,
            winch_speed=speed,
            damping=from_zero("damping", damping),
            cable_damping=from_zero("cable_damping", cable_damping),
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


def _kind_of_machine(robot: Robot) -> type[Machine]:
    """What simulates ``robot``.

    Raises:
        InvalidInput: cables with a memory that have mass or are nonlinear.
    """
    if weighs(robot) or not robot.cabling.linear:
        robot.cabling.refuse_memory()
        return _ChainMachine
    return _RopeMachine if robot.cabling.has_memory.any() else Machine


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
        seen.append(machine.seen())
        position, rotation = wanted.positions[tick], wanted.rotations[tick]
        fell = fallen(position, rotation, machine.let_out, machine.data, machine.platform)
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
        for passed in machine.follow(command, then - time):
            if sensing.due(time + passed):
                machine.look()
                sensing.sample(time + passed, machine.seen())
        machine.look()


class Machine:
    """A robot in MuJoCo, in equilibrium on its first lengths, with winches of limited speed and range.

    Attributes:
        robot: the robot.
        model, data: in MuJoCo, with the platform and the cables damped.
        readings: of the model's sensors.
        platform: number of the platform's body.
        winch_speed: largest rate at which a rest length changes [m/s].
        fastest: angular frequency of the fastest oscillation [rad/s].
        damping_time: of that oscillation [s].
        reach: shortest and longest lengths that the winches can let out, (2, cables) [m].
        let_out: rest lengths that winches have let out, (cables,) [m].
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
        winch_force: ArrayLike | None = np.inf,
    ) -> None:
        self.robot = robot
        text = to_mjcf(without_memory(robot), pose, winches=True, winch_force=winch_force)
        self.model = mujoco.MjModel.from_xml_string(text)
        self.data = mujoco.MjData(self.model)
        self.readings = Readings(self.model, robot)
        self.platform = self.model.body("platform").id
        self._written = robot.rest_lengths(pose)
        self.fastest, self.damping_time = self._damp(damping, cable_damping)
        self._longest = min(TIMESTEP, 2 * np.pi / self.fastest / STEPS)
        self.winch_speed = winch_speed
        self.model.opt.integrator = mujoco.mjtIntegrator.mjINT_IMPLICIT
        self.reach = winches.reach(robot, self._written)
        self._springs = self.model.actuator_gainprm.copy(), self.model.actuator_biasprm.copy()
        self._motors = np.zeros(robot.cables, dtype=bool)
        self._acceleration = np.zeros(self.model.nv)
        self.let_out = self.checked(lengths).rest_lengths
        place(self.model, self.data, robot, self._settled(pose))
        self.look()
        self._wind(self.let_out, 0.0)
        self.look()

    def _settled(self, pose: RigidTransform) -> RigidTransform:
        """The equilibrium at which a motion begins."""
        return settle(self.robot, pose, self.let_out).pose

    def _wind(self, lengths: Float[np.ndarray, " cables"], seconds: float) -> None:
        """Let out ``lengths`` [m], ``seconds`` after the last ones."""
        self.let_out = lengths
        self.data.ctrl[:] = self.controls(lengths)

    def _damp(self, damping: float, cable_damping: float) -> tuple[float, float]:
        """Damp the platform, equally in all directions, and its cables.

        Returns:
            For the fastest oscillation: its angular frequency [rad/s], and its damping time [s].
        """
        model, robot = self.model, self.robot
        springs = tendons.springs(robot.cabling, robot.axial_stiffness, self._written)
        square, mass = stiffest(model, robot, self._stiffest(springs))
        critical = model.dof_damping[0] / robot.mass  # [1/s], the damping written in the model
        model.dof_damping[: len(mass)] = damping * critical * mass.diagonal()
        model.actuator_biasprm[:, 2] = -cable_damping * springs
        damped = damping * critical + cable_damping * square
        return float(np.sqrt(square)), float(1 / damped) if damped else np.inf

    def _stiffest(self, springs: Float[np.ndarray, " cables"]) -> Float[np.ndarray, " cables"]:
        """The largest stiffness of each cable at the first lengths [N/m], from that of elastic ones."""
        return springs

    def checked(self, answer: Command | ArrayLike) -> Command:
        """A controller's return value as a command that the winches can carry out.

        Raises:
            InvalidInput: a command that no winch can carry out, or that is out of the range of these.
        """
        command = Command.of(answer, self.robot.cables)
        lengths, (lowest, highest) = command.rest_lengths, self.reach
        beyond = ~command.by_tension & ~((lengths >= (1 - ROUNDING) * lowest) & (lengths <= (1 + ROUNDING) * highest))
        if beyond.any():
            cable = int(np.argmax(beyond))
            raise InvalidInput(
                f"rest_lengths: found {lengths[cable]:.4g} m in cable {cable + 1}, expected {lowest[cable]:.4g} to "
                f"{highest[cable]:.4g} m, which its winch can let out"
            )
        return command

    def controls(self, rest_lengths: Float[np.ndarray, "*rows cables"]) -> Float[np.ndarray, "*rows cables"]:
        """Controls of the actuators that let out ``rest_lengths`` [m] (``winch_controls``)."""
        extra = winches.shared(self.robot)
        return winches.controls(self._written + extra, rest_lengths + extra)

    def seen(self) -> Seen:
        """The state as of the last look, with the lengths let out now."""
        return *self.readings.of(self.data.sensordata), self.let_out.copy()

    def _within(self, wanted: Float[np.ndarray, " cables"], most: float) -> Float[np.ndarray, " cables"]:
        """The lengths [m] in reach that are nearest to those ``wanted``, at most ``most`` [m] from those let out."""
        return wanted.clip(self.let_out - most, self.let_out + most).clip(*self.reach)

    def look(self) -> None:
        """Update MuJoCo's sensors, which otherwise have the values before the step."""
        mujoco.mj_forward(self.model, self.data)

    def follow(self, command: Command, seconds: float) -> Iterator[float]:
        """Run for ``seconds``, step by step: the time [s] since its beginning, after each.

        A step is one of velocity Verlet, so that positions, velocities and winches belong to the same instant: the
        velocity changes by half a step of the acceleration at its beginning, the position by that velocity, the
        velocity by half a step of the acceleration at its end. The model's own integrator, which is implicit in the
        springs, is stable with far fewer steps: but it damps the springs, so that unstable feedback looked stable, and
        peaks of tension were far too high. This one is of second order, and without damping beyond that of the model.
        """
        model, data, by_tension = self.model, self.data, command.by_tension
        some = bool(by_tension.any())
        steps = max(1, int(np.ceil(seconds / self._longest - ROUNDING)))
        step = seconds / steps
        half, most = step / 2, self.winch_speed * step
        model.opt.timestep = max(half, step - self.damping_time)
        advance = ((command.rest_lengths - self.let_out) / steps).clip(-most, most)
        if some or self._motors.any():
            self._held_tensions(command, most, 0.0)
            self._wind(self.let_out, 0.0)
            self._acceleration = self._accelerated()
        for number in range(1, steps + 1):
            data.qvel += half * self._acceleration
            mujoco.mj_integratePos(model, data.qpos, data.qvel, step)
            mujoco.mj_step1(model, data)
            ahead = self.let_out + advance
            self._wind(np.where(by_tension, self._held_tensions(command, most, step), ahead) if some else ahead, step)
            self._acceleration = self._accelerated()
            data.qvel += half * self._acceleration
            yield number * step

    def _accelerated(self) -> Float[np.ndarray, " coordinates"]:
        """The acceleration of a step, by MuJoCo's implicit integrator; the state does not change.

        The velocity is half a step old. The integrator evaluates damping and gyroscopic torques at a velocity that is
        ``timestep`` later: half a step, which makes the method one of second order. Where the damping time of the
        stiffest motion is shorter than half a step, ``timestep`` is larger, so that the motion decays and does not
        alternate.
        """
        model, data = self.model, self.data
        qpos, qvel = data.qpos.copy(), data.qvel.copy()
        mujoco.mj_step2(model, data)
        acceleration = (data.qvel - qvel) / model.opt.timestep
        data.qpos[:], data.qvel[:] = qpos, qvel
        return acceleration

    def _held_tensions(self, command: Command, most: float, seconds: float) -> Float[np.ndarray, " cables"]:
        """Rest lengths of winches that control a tension, at most ``most`` [m] from those ``seconds`` before.

        A winch that can reach the length of its tension becomes a constant force, the others are springs.
        """
        strains = command.tensions / self.robot.axial_stiffness
        wanted = winches.lengths_at(self.robot, strains, self.seen()[1])
        near = self._within(wanted, most)
        self._motors = command.by_tension & (near == wanted)
        gain, bias = self.model.actuator_gainprm, self.model.actuator_biasprm
        gain[:], bias[:] = self._springs
        gain[self._motors] = bias[self._motors] = 0.0
        bias[self._motors, 0] = (self.robot.reeving * command.tensions)[self._motors]
        return near


class _RopeMachine(Machine):
    """A robot on cables with a memory, like ``Machine``.

    Its actuators are constant forces for a time step, those of ``rope_motion``, and the dampers of the cables. A rope
    that slides at its exit under a held tension has no damper, as without memory.
    """

    def _stiffest(self, springs: Float[np.ndarray, " cables"]) -> Float[np.ndarray, " cables"]:
        cabling = self.robot.cabling
        stuck = tendons.spring(cabling.axial_stiffness, cabling.reeving * self._written, cabling.reeving)
        return np.where(cabling.has("pulley_friction"), stuck, springs)

    def _settled(self, pose: RigidTransform) -> RigidTransform:
        first = settle_path(Problems.stack([Problem.of(self.robot, pose, self.let_out)]))
        self._ropes, self._held = RopeMotion(self.robot, first.memory[None]), None
        return first[0].pose

    def _held_tensions(self, command: Command, most: float, seconds: float) -> Float[np.ndarray, " cables"]:
        self._held = self._ropes.under(self.seen()[1], command.tensions, seconds)
        wanted = self._held.rest_lengths
        near = self._within(wanted, most)
        self._motors = command.by_tension & (near == wanted)
        return near

    def _wind(self, lengths: Float[np.ndarray, " cables"], seconds: float) -> None:
        rates = (lengths - self.let_out) / seconds if seconds else np.zeros_like(lengths)
        self.let_out = lengths
        state = self._ropes.at(self.seen()[1], lengths, seconds)
        if self._held is not None:
            state = state.where(self._motors, self._held)
        self._ropes.memory = state.memory
        undamped = (self._motors & ~state.sticks) | (state.pulls <= 0)
        dampers = np.where(undamped, 0.0, self._springs[1][:, 2])
        gain, bias = self.model.actuator_gainprm, self.model.actuator_biasprm
        gain[:] = bias[:] = 0.0
        bias[:, 0], bias[:, 2] = state.pulls + dampers * rates, dampers


class _ChainMachine(Machine):
    """A robot on cables of which some have mass or are nonlinear, like ``Machine``, with springs for actuators."""

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
        self.robot, self.winch_speed = robot, winch_speed
        written = Problem.of(robot, pose)
        self.reach = winches.reach(robot, written.rest_lengths)
        first = Problem.of(robot, pose, self.checked(lengths).rest_lengths)
        refuse_short(robot, first.rest_lengths)
        start = settle(first).pose
        simulation = at_rest(first, start) if weighs(robot) else single(first, start)
        inertia = inertias(robot)
        simulation.residuals(simulation.all)
        stiffest = float(np.abs(ChainDerivatives.of(simulation, simulation.all).stiffness()[0]).max())
        fastest = np.sqrt(stiffest / float((inertia / robot.units[robot.free] ** 2).min()))
        calm = 2 * cable_damping or TIMESTEP  # steps that damp no more than the cables
        self._longest = min(TIMESTEP, 2 * np.pi / fastest / STEPS, calm)
        self._chains = ChainMotion(
            simulation,
            self._longest,
            damping=damping * settling_air(written)[0] / robot.mass * inertia,
            ahead=LEAST_AHEAD,
            cable_damping=cable_damping,
        )
        self.data, self.platform = self._chains.data, simulation.platform
        self.let_out = self._chains.let_out
        self.look()

    def look(self) -> None:
        self._seen = self._chains.look()

    def seen(self) -> Seen:
        pose = self._seen.poses[0]
        read = np.concatenate([pose.translation, pose.rotation.as_quat(scalar_first=True)])
        return read, self._seen.lengths[0], self._seen.tensions[0], self.let_out.copy()

    def follow(self, command: Command, seconds: float) -> Iterator[float]:
        start, passed = self.let_out, 0.0
        rates = ((command.rest_lengths - start) / seconds).clip(-self.winch_speed, self.winch_speed)
        by_tension = command.by_tension

        def let_out(now: float) -> Float[np.ndarray, " cables"]:
            lengths, most = start + now * rates, self.winch_speed * (now - passed)
            if by_tension.any():
                held = self._chains.lengths_under(command.tensions, now - passed)
                lengths = np.where(by_tension, self._within(held, most), lengths)
            return lengths

        for passed in self._chains.steps(seconds, let_out):
            self.let_out = self._chains.let_out
            yield passed

"""Track a course in MuJoCo: a controller in closed loop, with winches and sensors that are not perfect.

Time goes in control periods. At each the controller is given the newest sample that has come through from the sensors,
and says what winches hold one period later; meanwhile they run there evenly, as drives that interpolate do, and no
faster than they can. A winch that holds a length is the model's actuator at that control. One that holds a tension is
the same actuator with a constant force instead of a spring: an ideal motor that gives way. It can do so no faster than
it turns; beyond that it is held by its speed, and its cable is a spring again.
"""

# pyright: reportAttributeAccessIssue=false
# mujoco ships no type stubs for its compiled modules.
from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

import mujoco
import numpy as np
from jaxtyping import Bool, Float
from numpy.typing import ArrayLike
from scipy.linalg import eigh
from scipy.spatial.transform import RigidTransform

from cdpr_sim.core.checks import PROGRESS, checked_array, positive, refuse_unless
from cdpr_sim.core.controller import Command, Controller, Course, Sensors
from cdpr_sim.core.errors import CdprError, InvalidInput
from cdpr_sim.core.path import Path
from cdpr_sim.core.pose import PoseLike
from cdpr_sim.core.problem import Problem, Problems
from cdpr_sim.core.robot import Robot
from cdpr_sim.core.trajectory import BadCommand, PlatformFell, Trajectory
from cdpr_sim.physics.batch import quiet
from cdpr_sim.physics.drive import MOST_SECONDS, MOST_STATES, PAUSE, fallen, poses_through
from cdpr_sim.physics.mjcf import TIMESTEP, place, to_mjcf
from cdpr_sim.physics.sensing import Readings, Sensing, pose_of
from cdpr_sim.physics.settle import settle

SPEED = 0.05
"""[m/s] Mean speed along the waypoints, unless the caller says otherwise."""

DAMPING = 0.05
"""Of the platform's slowest swing, as a fraction of critical damping, unless the caller says otherwise: it swings on
for some periods, as platforms on cables do."""

CABLE_DAMPING = 2.5e-4
"""[s] Assumed: a loss factor of 2 % at the 10 Hz of ``cogiro``'s softest motion on fishing line, of 5 % at
Vectran's 33 Hz."""

STEPS = 20
"""Per period of the platform's stiffest motion. The model's own integrator, which is implicit in the springs, is stable
with far fewer: but it damps them, so that feedback looked stable that is not, and tensions peaked far too high.
This one is symplectic in the springs, and damps nothing that the model does not."""

ROUNDING = 1e-9
"""Of a length or a number of steps, as a fraction."""

EXACT = Sensors()
"""Sensors unless the caller says otherwise: at 100 Hz, at once and without noise."""


def track(
    robot: Robot,
    waypoints: RigidTransform | Sequence[PoseLike] | np.ndarray,
    controller: Controller,
    *,
    seconds: float | None = None,
    pause: float = 0.0,
    rate: float = 100.0,
    sensors: Sensors = EXACT,
    winch_speed: float = 1.0,
    damping: float = DAMPING,
    cable_damping: float = CABLE_DAMPING,
    progress: Callable[[float], None] | None = None,
) -> Trajectory:
    """Move the platform along ``waypoints`` in MuJoCo as ``controller`` says, which sees only what sensors say.

    What is wanted moves along straight lines from waypoint to waypoint as ``core.path`` says: turning evenly, starting
    and ending at rest. The platform starts at rest on the lengths with which the controller starts.

    Args:
        robot: the true one; the controller may believe in another.
        waypoints: poses wanted in turn, at least one: (rows, 3), (rows, 6) or a stack of transforms. A single one is
            held.
        controller: any object with the two methods of ``Controller``; those of ``cdpr_sim.control``, for instance.
        seconds: duration of the motion; default: at 0.05 m/s in the mean.
        pause: how long the first waypoint is wanted before the motion begins [s].
        rate: of the controller [Hz].
        sensors: what they are like.
        winch_speed: largest rate at which a rest length changes [m/s].
        damping: of the platform's slowest swing by the air, as a fraction of critical.
        cable_damping: of each cable: its resistance to stretching, as a multiple of its stiffness [s].
        progress: called now and then with the fraction done, 0 to 1.

    Returns:
        A state for each control period, the first and the last instant included. Its commanded poses are those that the
        course wants, its rest lengths those that winches had let out.

    Raises:
        InvalidInput: an argument that cannot be right; cables that weigh something or stiffen.
        NotSettled: the platform does not come to rest on the controller's first lengths.
        PlatformFell: it fell on the way; carries the trajectory so far.
        BadCommand: the controller failed, or said what winches cannot do; carries the trajectory so far.
    """
    refuse_unless(PROGRESS, progress=progress)
    course = _course(robot, waypoints, seconds, pause)
    period = 1 / positive("rate", rate, "Hz")
    refuse_unless(Sensors, sensors=sensors)
    for name in ("start", "command"):
        if not callable(getattr(controller, name, None)):
            raise InvalidInput(f"controller: found {controller!r}, expected an object with a method {name!r}")
    speed = positive("winch_speed", winch_speed, "m/s")
    ticks = max(1, round(course.end / period))
    if ticks >= MOST_STATES:
        raise InvalidInput(f"rate: found {rate:g} Hz for {course.end:g} s, expected at most {MOST_STATES} states")
    times = period * np.arange(ticks + 1)
    wanted = course.poses(times)
    held = Problems.of(robot, wanted)
    if held.falls.any():
        Problem.of(robot, wanted[int(np.argmax(held.falls))])  # says that nothing could hold it
    try:
        lengths = Command.of(controller.start(course), robot.cables).rest_lengths
    except InvalidInput as error:
        raise BadCommand(f"{robot.name}: when the controller starts: {error}") from error
    with quiet():
        machine = _Machine(
            robot,
            wanted[0],
            lengths,
            period=period,
            winch_speed=speed,
            damping=_from_zero("damping", damping),
            cable_damping=_from_zero("cable_damping", cable_damping),
        )
        motion = _Motion(machine.readings)
        try:
            _run(machine, controller, Sensing(sensors, machine.readings), times, held, motion, progress)
        except (PlatformFell, BadCommand) as stopped:
            stopped.trajectory = motion.trajectory(robot, wanted, times)
            raise
    return motion.trajectory(robot, wanted, times)


def _course(
    robot: Robot,
    waypoints: RigidTransform | Sequence[PoseLike] | np.ndarray,
    seconds: float | None,
    pause: float,
) -> Course:
    path = Path(robot, poses_through(robot, waypoints, "tracking"))
    if not robot.cabling.linear:
        raise InvalidInput("stiffening: found cables whose law is not linear, expected linear ones for tracking")
    if seconds is None:
        seconds = path.length / SPEED or PAUSE
    seconds = positive("seconds", seconds, "s")
    pause = _from_zero("pause", pause)
    if not seconds + pause <= MOST_SECONDS:
        raise InvalidInput(f"seconds: found {seconds + pause:g} with the pause, expected at most {MOST_SECONDS:g}")
    return Course(path, seconds, pause)


def _from_zero(field: str, value: float) -> float:
    number = float(checked_array(field, value, ()))
    if number < 0:
        raise InvalidInput(f"{field}: found {number:g}, expected 0 or more")
    return number


def _run(
    machine: _Machine,
    controller: Controller,
    sensing: Sensing,
    times: Float[np.ndarray, " ticks"],
    wanted: Problems,
    motion: _Motion,
    progress: Callable[[float], None] | None,
) -> None:
    """From the first of ``times`` to the last.

    Raises:
        PlatformFell: it fell on the way.
        BadCommand: no command that the winches can follow.
    """
    name, last = machine.robot.name, len(times) - 1
    for tick, time in enumerate(times.tolist()):
        motion.see(machine)
        position, rotation = wanted.positions[tick], wanted.rotations[tick]
        fell = fallen(position, rotation, machine.let_out, machine.data, machine.platform)
        if fell:
            x, y, z = position
            raise PlatformFell(
                f"{name}: found the platform fallen {time:.4g} s into the motion, when it was wanted at ({x:.3g}, "
                f"{y:.3g}, {z:.3g}) m: {fell}"
            )
        if progress is not None:
            progress(tick / last)
        if tick == last:
            return
        if sensing.due(time):
            sensing.sample(machine.data, time, machine.let_out)
        try:
            answer = controller.command(float(times[tick + 1]), wanted.poses[tick + 1], sensing.newest(time))
            command = machine.checked(answer)
        except Exception as error:  # whatever a user's controller raises
            what = str(error) if isinstance(error, CdprError) else f"found {type(error).__name__}: {error}"
            raise BadCommand(f"{name}: controller: {time:.4g} s into the motion: {what}") from error
        for passed in machine.follow(command):
            if sensing.due(time + passed):
                machine.look()
                sensing.sample(machine.data, time + passed, machine.let_out)
        machine.look()


class _Motion:
    """What is seen at each control instant."""

    def __init__(self, readings: Readings) -> None:
        self._readings = readings
        self._seen: list[tuple[np.ndarray, ...]] = []

    def see(self, machine: _Machine) -> None:
        """The platform, its cables and its winches, now."""
        read, data = self._readings, machine.data
        self._seen.append((read.pose(data), read.lengths(data), read.tensions(data), machine.let_out.copy()))

    def trajectory(self, robot: Robot, wanted: RigidTransform, times: Float[np.ndarray, " ticks"]) -> Trajectory:
        """All of it."""
        poses, lengths, tensions, rest_lengths = (np.array(column) for column in zip(*self._seen, strict=True))
        rows = np.arange(len(self._seen))
        problems = Problems.of(robot, wanted[rows], rest_lengths)
        return Trajectory.of(problems, times[rows], pose_of(poses), lengths, tensions)


class _Machine:
    """A robot in MuJoCo, at rest on its first lengths, and winches that do as they are told if they can.

    Attributes:
        let_out: rest lengths that winches have let out, (cables,) [m].
    """

    def __init__(
        self,
        robot: Robot,
        pose: RigidTransform,
        lengths: Float[np.ndarray, " cables"],
        *,
        period: float,
        winch_speed: float,
        damping: float,
        cable_damping: float,
    ) -> None:
        self.robot = robot
        self.model = mujoco.MjModel.from_xml_string(to_mjcf(robot, pose, winches=True))
        self.data = mujoco.MjData(self.model)
        self.readings = Readings(self.model, robot)
        self.platform = self.model.body("platform").id
        self._written = robot.rest_lengths(pose)
        shortest = self._calm(damping, cable_damping)
        self.steps = int(np.ceil(period / min(TIMESTEP, shortest / STEPS) - ROUNDING))
        self.timestep = self.model.opt.timestep = period / self.steps
        self.model.opt.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
        self._most = winch_speed * self.timestep
        self._reach = (self._written[:, None] / (1 + self.model.actuator_ctrlrange)).T[::-1]
        self._springs = self.model.actuator_gainprm.copy(), self.model.actuator_biasprm.copy()
        self.let_out = self.checked(lengths).rest_lengths
        place(self.model, self.data, robot, settle(robot, pose, self.let_out).pose)
        self.data.ctrl[:] = self._written / self.let_out - 1
        self.look()

    def _calm(self, damping: float, cable_damping: float) -> float:
        """Damp the platform, alike in all directions, and its cables; the period of its stiffest motion [s]."""
        model, data, free = self.model, self.data, len(self.robot.free)
        mass, stretch = np.zeros((free, model.nv)), np.zeros((free, model.nu))
        for coordinate, unit in enumerate(np.eye(free, model.nv)):
            data.qvel[:] = unit
            mujoco.mj_forward(model, data)
            mujoco.mj_mulM(model, data, mass[coordinate], unit)
            stretch[coordinate] = data.actuator_velocity
        data.qvel[:] = 0
        critical = model.dof_damping[0] / self.robot.mass  # [1/s], as the model is written
        model.dof_damping[:free] = damping * critical * mass.diagonal()
        springs = self.robot.axial_stiffness / self._written
        model.actuator_biasprm[:, 2] = -cable_damping * springs
        fastest = eigh(stretch * springs @ stretch.T, mass[:, :free], eigvals_only=True)[-1]
        return float(2 * np.pi / np.sqrt(fastest))

    def checked(self, answer: Command | ArrayLike) -> Command:
        """A controller's answer, as a command that the winches can follow.

        Raises:
            InvalidInput: what no winch can hold, or these cannot let out.
        """
        command = Command.of(answer, self.robot.cables)
        lengths, (lowest, highest) = command.rest_lengths, self._reach
        beyond = ~command.by_tension & ~((lengths >= (1 - ROUNDING) * lowest) & (lengths <= (1 + ROUNDING) * highest))
        if beyond.any():
            cable = int(np.argmax(beyond))
            raise InvalidInput(
                f"rest_lengths: found {lengths[cable]:.4g} m in cable {cable + 1}, expected {lowest[cable]:.4g} to "
                f"{highest[cable]:.4g} m, which its winch can let out"
            )
        return command

    def look(self) -> None:
        """Bring MuJoCo's sensors up to date, which speak of the time before a step."""
        mujoco.mj_forward(self.model, self.data)

    def follow(self, command: Command) -> Iterator[float]:
        """Run for a period, step by step: the time [s] since its beginning, after each."""
        by_tension, model, data = command.by_tension, self.model, self.data
        some, stretch = bool(by_tension.any()), 1 + command.tensions / self.robot.axial_stiffness
        self._let_go(np.zeros_like(by_tension), command.tensions)
        advance = ((command.rest_lengths - self.let_out) / self.steps).clip(-self._most, self._most)
        for step in range(1, self.steps + 1):
            mujoco.mj_step1(model, data)
            let_out = self.let_out + advance
            if some:
                gives_way = self.readings.lengths(data) / stretch
                near = gives_way.clip(self.let_out - self._most, self.let_out + self._most).clip(*self._reach)
                self._let_go(by_tension & (near == gives_way), command.tensions)
                let_out = np.where(by_tension, near, let_out)
            self.let_out = let_out
            data.ctrl[:] = self._written / let_out - 1
            mujoco.mj_step2(model, data)
            yield step * self.timestep

    def _let_go(self, by_motor: Bool[np.ndarray, " cables"], tensions: Float[np.ndarray, " cables"]) -> None:
        """Make some actuators constant forces, and the others springs again."""
        gain, bias = self.model.actuator_gainprm, self.model.actuator_biasprm
        gain[:], bias[:] = self._springs
        gain[by_motor] = bias[by_motor] = 0.0
        bias[by_motor, 0] = tensions[by_motor]

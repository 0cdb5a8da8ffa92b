"""One robot's simulations side by side in MuJoCo, and what MuJoCo says of their state.

Everything is read out of MuJoCo; no formula of statics stands here.
"""

# pyright: reportAttributeAccessIssue=false
# mujoco ships no type stubs for its compiled modules.
from __future__ import annotations

import copy
import functools
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import mujoco
import numpy as np
from jaxtyping import Bool, Float
from mujoco.batch import Batch
from scipy.spatial.transform import RigidTransform, Rotation

from cdpr_sim.core.errors import InvalidInput
from cdpr_sim.core.problem import Problems
from cdpr_sim.core.robot import Robot
from cdpr_sim.physics import cables
from cdpr_sim.physics.mjcf import coordinates, to_mjcf

MASS_IN_UNITS = 2.0**30
"""The platform's mass, in the unit of mass that MuJoCo is given. Its discrete integrator ends each step's iteration
at an absolute tolerance: in kilograms, 3e-8 N no longer accelerate 1 kg, and the platform would come to a false rest. A
unit of a power of two kilograms rounds no number, so that the motion is the same."""

ARENA = 2**17
"""Bytes of working memory for MuJoCo; a model without contacts needs little of the default's 13 MB per thread."""

DIFFERENCE = 3e-6
"""Displacement for differencing forces, as a fraction of the mean cable length: near the cube root of rounding, where
truncation (its square) and rounding (over it) meet."""


@dataclass(frozen=True)
class Observation:
    """What MuJoCo says of each row's pose and cables."""

    poses: RigidTransform
    lengths: Float[np.ndarray, "rows cables"]
    tensions: Float[np.ndarray, "rows cables"]


@dataclass(frozen=True)
class Reading(Observation):
    """What MuJoCo says of each row's state at zero velocity, its balance included."""

    residuals: Float[np.ndarray, " rows"]
    eigenvalues: Float[np.ndarray, "rows free"]
    softest: Float[np.ndarray, "rows free"]


class Simulations:
    """One robot side by side, each with its own rest lengths, load and state."""

    def __init__(self, robot: Robot, model: mujoco.MjModel, rows: int, threads: int = 1) -> None:
        self.robot, self.model = robot, model
        self.length = robot.characteristic_length
        self.unit = unit_of(robot)
        self.batch = Batch(model, rows, threads)
        self.band, self.springs = self.batch.expand("tendon_lengthspring"), self.batch.expand("tendon_stiffness")
        self.timestep = self.batch.expand("opt.timestep").reshape(rows)
        self.damping, self.armature = self.batch.expand("dof_damping"), self.batch.expand("dof_armature")
        self.qpos, self.qvel = self.batch.bind("qpos"), self.batch.bind("qvel")
        self._smooth, self._damper = self.batch.bind("qfrc_smooth"), self.batch.bind("qfrc_damper")
        self._spring, self._jacobian = self.batch.bind("qfrc_spring"), self.batch.bind("ten_J")
        self._lengths = self.batch.bind("ten_length")
        self._xpos, self._xquat, self._xmat = (self.batch.bind(name) for name in ("xpos", "xquat", "xmat"))
        self._loads = self.batch.bind("xfrc_applied")
        self._platform, self._origin = (
            mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, name) for name in ("platform", "origin")
        )

    def start(self, problems: Problems, *, own_springs: bool) -> None:
        """Put each row at its problem's pose, with zero velocity, its load and, unless ``own_springs``, its springs."""
        self.batch.reset(stage=mujoco.mjtStage.mjSTAGE_NONE.value)
        self.place(problems.poses)
        self.wrenches = np.broadcast_to(problems.external_wrench, (len(problems), 6))
        if self.wrenches.any():
            if self._origin < 0:
                raise InvalidInput("model: found no body 'origin' in the platform, expected one to apply the wrench to")
            self._loads[:, self._origin] = self.wrenches / self.unit
        if not own_springs:
            self.band[:, :, 1] = problems.rest_lengths
            self.springs[:] = cables.springs(problems.axial_stiffness, problems.rest_lengths) / self.unit
        self.armature[:] = self.model.dof_armature

    def place(self, poses: RigidTransform) -> None:
        """Put each row's platform at its pose."""
        self.qpos[:] = [coordinates(self.robot, pose) for pose in poses]

    @property
    def accelerating(self) -> Float[np.ndarray, "rows free"]:
        """Net generalised force without the damping, as of MuJoCo's last call, in the joints' coordinates [N, N m]."""
        return (self._smooth - self._damper) * self.unit

    @property
    def forces(self) -> Float[np.ndarray, "rows free"]:
        """Net force and torque on the platform's origin without the damping, as of MuJoCo's last call [N], base frame.

        Torques are divided by the robot's characteristic length.
        """
        forces = self.accelerating
        if self.robot.mobility == "spatial":  # a free joint's torque is in the body frame
            forces[:, 3:] = np.einsum("nij,nj->ni", self.rotations, forces[:, 3:])
        forces[:, self.angular] /= self.length
        return forces

    @property
    def pull(self) -> Float[np.ndarray, " rows"]:
        """The tensions of all cables together [N], as of MuJoCo's last call: to judge the motion by, and no answer."""
        return cables.pull(self._lengths, self.band, self.springs).sum(1) * self.unit

    @property
    def slack(self) -> Bool[np.ndarray, "rows cables"]:
        """Which cables are within their dead band, as of MuJoCo's last call."""
        return (self._lengths >= self.band[:, :, 0]) & (self._lengths <= self.band[:, :, 1])

    @property
    def rotations(self) -> Float[np.ndarray, "rows 3 3"]:
        """Rotation matrices of the platforms, as of MuJoCo's last call."""
        return self._xmat[:, self._platform].reshape(-1, 3, 3)

    @property
    def angular(self) -> slice:
        """Which of the free directions are rotations."""
        return slice(3, 6) if self.robot.mobility == "spatial" else slice(2, 3)

    def residuals(self) -> Float[np.ndarray, " rows"]:
        """The largest unbalanced force at the present poses and zero velocity, (rows,) [N]."""
        self.qvel[:] = 0
        self.batch.forward()
        return np.abs(self.forces).max(1)

    def read(self, qpos: Float[np.ndarray, "rows coordinates"]) -> Reading:
        """Each row's state at ``qpos`` and zero velocity."""
        self.qpos[:] = qpos
        residuals = self.residuals()
        seen = self._observed()
        return Reading(seen.poses, seen.lengths, seen.tensions, residuals, *self._stiffness())

    def observe(self, qpos: Float[np.ndarray, "rows coordinates"]) -> Observation:
        """Each row's pose and cables at ``qpos``: ``read`` without the balance, for motions of many states."""
        self.qpos[:] = qpos
        self.residuals()
        return self._observed()

    def _observed(self) -> Observation:
        lengths = self._lengths.copy()
        poses = RigidTransform.from_components(
            self._xpos[:, self._platform], Rotation.from_quat(self._xquat[:, self._platform], scalar_first=True)
        )
        return Observation(poses, lengths, self._tensions())

    def _tensions(self) -> Float[np.ndarray, "rows cables"]:
        """Tension [N] of each cable: MuJoCo's spring force with only that spring switched on, along its tendon.

        qfrc_spring = -J' tau, hence tau = -(J . qfrc_spring) / (J . J): negative, were a cable to push.
        """
        all_springs = self.springs.copy()
        tensions = np.empty_like(all_springs)
        for cable in range(self.robot.cables):
            self.springs[:] = 0
            self.springs[:, cable] = all_springs[:, cable]
            self.batch.forward(stage=mujoco.mjtStage.mjSTAGE_VEL.value)
            first, entries = self.model.ten_J_rowadr[cable], self.model.ten_J_rownnz[cable]
            row = self._jacobian[:, first : first + entries]
            force = self._spring[:, self.model.ten_J_colind[first : first + entries]]
            # The two are parallel. Where J vanishes, at an anchor on its exit, so does the spring's force.
            tensions[:, cable] = -(row * force).sum(1) / np.maximum((row * row).sum(1), np.finfo(float).tiny)
        self.springs[:] = all_springs
        return tensions * self.unit + 0.0  # no negative zero

    def _stiffness(self) -> tuple[Float[np.ndarray, "rows free"], Float[np.ndarray, "rows free"]]:
        """Eigenvalues [N/m], ascending, of how MuJoCo's force gives way at the present poses; the softest direction.

        Central differences on the cables that are taut now: for the while those may push and slack ones do nothing, so
        that a displacement does not cross the kink of a cable that is stretched by less.
        """
        band, springs = self.band.copy(), self.springs.copy()
        self.qvel[:] = 0
        self.batch.forward()
        length = self._lengths
        self.springs[self.slack] = 0
        self.band[:] = np.where(length > band[:, :, 1], band[:, :, 1], band[:, :, 0])[:, :, None]
        rest, rotations = self.qpos.copy(), self.rotations.copy()
        step = DIFFERENCE * length.mean(1)
        free = self.model.nv
        stiffness = np.empty((len(rest), free, free))
        for j, sign in ((j, sign) for j in range(free) for sign in (1, -1)):
            moves = np.zeros((len(rest), free))
            moves[:, j] = sign * step
            moves[:, self.angular] /= self.length
            if free == 6:
                moves[:, 3:] = np.einsum("nji,nj->ni", rotations, moves[:, 3:])
            for row, move in enumerate(moves):
                moved = rest[row].copy()
                mujoco.mj_integratePos(self.model, moved, move, 1)
                self.qpos[row] = moved
            self.batch.forward()
            change = -self.forces / (2 * step[:, None])
            stiffness[:, :, j] = change if sign > 0 else stiffness[:, :, j] - change
        self.qpos[:], self.band[:], self.springs[:] = rest, band, springs
        known = np.isfinite(stiffness).all((1, 2))
        eigenvalues, directions = np.full((2, len(rest), free), np.nan)
        values, vectors = np.linalg.eigh((stiffness + stiffness.transpose(0, 2, 1))[known] / 2)
        eigenvalues[known], directions[known] = values, vectors[:, :, 0]
        return eigenvalues, directions


_idle: dict[Robot, Simulations] = {}
"""Simulations of one row between two uses: building one takes as long as a settling."""

MOST_IDLE = 16
"""Robots whose simulations are kept."""


@contextmanager
def simulations_of(problems: Problems, model: mujoco.MjModel | None = None, threads: int = 1) -> Iterator[Simulations]:
    """``problems`` at their start: for this caller alone, and with MuJoCo kept quiet.

    Args:
        problems: (rows,) of them, of one mass.
        model: the model to use instead of the generated one, with the springs that it has.
        threads: 0 for one per processor.

    Raises:
        InvalidInput: masses of their own, which one model cannot have.
    """
    robot, rows = problems.robot, len(problems)
    if (problems.mass != robot.mass).any():
        raise InvalidInput("mass: found one per problem, expected the robot's own: MuJoCo has one model for all rows")
    reusable = model is None and rows == 1
    found = _idle.pop(robot, None) if reusable else None  # taken out, so that no other thread can have it
    with quiet():
        if found is None:
            found = Simulations(
                robot, _model_of(robot) if model is None else _prepared(model, unit_of(robot)), rows, threads
            )
        found.start(problems, own_springs=model is not None)
        yield found
    if reusable:
        _idle[robot] = found
        while len(_idle) > MOST_IDLE:
            _idle.pop(next(iter(_idle)), None)


@functools.lru_cache(maxsize=MOST_IDLE)
def _model_of(robot: Robot) -> mujoco.MjModel:
    """The compiled model of ``robot``, never written to: each problem brings its own pose, lengths and stiffnesses."""
    middle = RigidTransform.from_translation(robot.workspace.mean(0))
    spec = mujoco.MjSpec.from_string(to_mjcf(robot, middle, np.ones(robot.cables)))
    spec.memory = ARENA
    return _prepared(spec.compile(), unit_of(robot))


def unit_of(robot: Robot) -> float:
    """Of mass [kg], and hence of force [N], in which MuJoCo is given this robot: a power of two."""
    return float(2.0 ** np.round(np.log2(robot.mass / MASS_IN_UNITS)))


def _prepared(model: mujoco.MjModel, unit: float) -> mujoco.MjModel:
    """A copy of ``model`` in that unit, whose damping and time step are ours to choose: they move no equilibrium."""
    model = copy.copy(model)
    model.opt.integrator = mujoco.mjtIntegrator.mjINT_DISCRETE
    model.opt.viscosity = model.opt.density = 0
    for quantity in (model.body_mass, model.body_inertia, model.tendon_stiffness, model.tendon_damping):
        quantity /= unit
    mujoco.mj_setConst(model, mujoco.MjData(model))  # what MuJoCo derives from masses
    return model


_quiet_lock = threading.Lock()
_quiet_users: list[object] = []


@contextmanager
def quiet() -> Iterator[None]:
    """Keep MuJoCo's warnings out of the terminal and MUJOCO_LOG.TXT: they are read from the warning counters instead.

    The handler belongs to the process: the first to come replaces it and the last to go puts it back.
    """
    with _quiet_lock:
        _quiet_users.append(mujoco.get_mju_user_warning() if not _quiet_users else None)
        mujoco.set_mju_user_warning(_ignore)
    try:
        yield
    finally:
        with _quiet_lock:
            previous = _quiet_users[0]
            _quiet_users.pop()
            if not _quiet_users:
                mujoco.set_mju_user_warning(previous)


def _ignore(message: str) -> None:
    pass

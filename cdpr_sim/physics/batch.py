"""Simulations of one robot side by side in MuJoCo, and the readout of their state.

All results are read out of MuJoCo; this module uses no formula of statics.
"""

# pyright: reportAttributeAccessIssue=false
# mujoco ships no type stubs for its compiled modules.
from __future__ import annotations

import copy
import functools
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import mujoco
import numpy as np
from jaxtyping import Bool, Float, Int
from mujoco.batch import Batch
from scipy.spatial.transform import RigidTransform

from cdpr_sim.core.errors import InvalidInput
from cdpr_sim.core.memory import Memory, without_memory
from cdpr_sim.core.pose import poses_of
from cdpr_sim.core.problem import Problems
from cdpr_sim.core.robot import Robot
from cdpr_sim.core.status import NEUTRAL
from cdpr_sim.physics import pulleys
from cdpr_sim.physics.cable import Law
from cdpr_sim.physics.exits import Slides
from cdpr_sim.physics.mjcf import coordinates_of, to_mjcf
from cdpr_sim.physics.quiet import quiet
from cdpr_sim.physics.rope_memory import Elements, RopeStep, add_elements

DISABLED = mujoco.mjtDisableBit

MASS_IN_UNITS = 2.0**30
"""The platform's mass, in the unit of mass of the model in MuJoCo. MuJoCo's discrete integrator ends each step's
iteration at an absolute tolerance: in kilograms, 3e-8 N no longer accelerate 1 kg, and the platform would stop before
equilibrium. A unit of a power of two kilograms rounds no number, so that the motion is the same."""

ARENA = 2**17
"""Bytes of working memory for MuJoCo; a model without contacts needs little of the default's 13 MB per thread."""

DIFFERENCE = 3e-6
"""Displacement for differencing forces, as a fraction of the mean cable length: near the cube root of rounding, where
the error of truncation (its square) equals that of rounding (its inverse)."""


UNUSED = sum(flag.value for flag in (DISABLED.mjDSBL_CONTACT, DISABLED.mjDSBL_CONSTRAINT, DISABLED.mjDSBL_SENSOR))
"""Stages of MuJoCo that our models do not need: without them a forward pass takes a tenth less time."""

HELD = 1e6
"""Inertia of a wheel about its axis, as a multiple of the platform's: MuJoCo does not rotate it between two updates.
At equilibrium its torque must vanish too: it is part of the residual."""


@dataclass(frozen=True)
class Observation:
    """Pose and cables of each row, from MuJoCo."""

    positions: Float[np.ndarray, "rows 3"]
    rotations: Float[np.ndarray, "rows 3 3"]
    lengths: Float[np.ndarray, "rows cables"]
    tensions: Float[np.ndarray, "rows cables"]

    @property
    def poses(self) -> RigidTransform:
        """The poses, a stack of (rows,)."""
        return poses_of(self.positions, self.rotations)


@dataclass(frozen=True)
class SimulationReading(Observation):
    """State of each row at zero velocity, from MuJoCo, with residual and stiffness."""

    residuals: Float[np.ndarray, " rows"]
    eigenvalues: Float[np.ndarray, "rows free"]
    softest: Float[np.ndarray, "rows free"]
    off_wheel: Bool[np.ndarray, " rows"]

    @property
    def unstable(self) -> Bool[np.ndarray, " rows"]:
        """Which rows are not stable: where they rest, they are at a saddle."""
        return self.eigenvalues[:, 0] < -NEUTRAL * np.abs(self.eigenvalues).max(1)


class Simulations:
    """Simulations of one robot side by side, each with its own rest lengths, load and state."""

    def __init__(self, robot: Robot, model: mujoco.MjModel, rows: int, threads: int = 1) -> None:
        self.robot, self.model = robot, model
        self.length = robot.characteristic_length
        self.unit = unit_of(robot)
        self.batch = Batch(model, rows, threads)
        self.step: RopeStep | None = None
        self.free, self.swivels = len(robot.free), pulleys.Swivels.of(model, robot.cabling)
        self.slides = Slides.of(model, robot.cables)
        own = slice(0, robot.cables)  # the tendons behind them are the elements of cables with a memory
        self.band = self.batch.expand("tendon_lengthspring")[:, own]
        self.springs = self.batch.expand("tendon_stiffness")[:, own]
        self.polynomials = self.batch.expand("tendon_stiffnesspoly")[:, own]
        self._elements = Elements(self.batch, model, robot.cabling, self.unit)
        self.entries = pulleys.entries(robot.cabling)
        self.timestep = self.batch.expand("opt.timestep").reshape(rows)
        self.damping, self.armature = self.batch.expand("dof_damping"), self.batch.expand("dof_armature")
        self.qpos, self.qvel = self.batch.bind("qpos"), self.batch.bind("qvel")
        self._smooth, self._damper = self.batch.bind("qfrc_smooth"), self.batch.bind("qfrc_damper")
        self._spring, self._jacobian = self.batch.bind("qfrc_spring"), self.batch.bind("ten_J")
        self._entry_cables = np.repeat(np.arange(model.ntendon), model.ten_J_rownnz)
        self._lengths = self.batch.bind("ten_length")[:, own]
        self._xpos, self._xmat = self.batch.bind("xpos"), self.batch.bind("xmat")
        self._loads = self.batch.bind("xfrc_applied")
        if len(self.swivels):
            self._anchors, self._quaternions = self.batch.bind("site_xpos"), self.batch.expand("body_quat")
            self._points = self.batch.bind("ten_wrapnum")
        self._platform, self._origin = (
            mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, name) for name in ("platform", "origin")
        )

    def start(
        self, problems: Problems, *, own_springs: bool, memory: Memory | None = None, duration: float = 0.0
    ) -> None:
        """Put each row at its problem's pose, with zero velocity, its load and, unless ``own_springs``, its springs.

        Cables with a memory start a step of ``duration`` [s] from ``memory``, (rows,); default: that of new ropes.
        """
        self.batch.reset(stage=mujoco.mjtStage.mjSTAGE_NONE.value)
        if self.robot.cabling.has_memory.any():
            memory = Memory.fresh(self.robot, (len(problems),)) if memory is None else memory
            rest = np.broadcast_to(problems.rest_lengths, (len(problems), self.robot.cables))
            self.step = RopeStep.of(self.robot.cabling, problems.axial_stiffness, rest, memory, duration)
            self.polynomials[:] = 0
        self.place(problems.positions, problems.rotations)
        self.wrenches = np.broadcast_to(problems.external_wrench, (len(problems), 6))
        if self.wrenches.any():
            if self._origin < 0:
                raise InvalidInput("model: found no body 'origin' in the platform, expected one to apply the wrench to")
            self._apply_wrenches()
        if not own_springs and self.step is None:
            self.band[:, :, 1] = problems.rest_lengths + self.entries
            springs = Law.of(self.robot.cabling, problems.axial_stiffness).springs(problems.rest_lengths)
            self.springs[:] = springs.stiffness / self.unit
            if not self.robot.cabling.linear:
                self.polynomials[:] = springs.polynomial / self.unit
        self.armature[:] = self.model.dof_armature

    def reset(self, rows: Bool[np.ndarray, " rows"]) -> None:
        """Reset the motion of ``rows`` and MuJoCo's warnings; apply the loads again: MuJoCo drops them."""
        self.batch.reset(rows, stage=mujoco.mjtStage.mjSTAGE_NONE.value)
        if self.wrenches.any():
            self._apply_wrenches()

    def _apply_wrenches(self) -> None:
        self._loads[:, self._origin] = self.wrenches / self.unit

    def place(self, positions: Float[np.ndarray, "*#rows 3"], rotations: Float[np.ndarray, "*#rows 3 3"]) -> None:
        """Put each row's platform at its pose, with the wheels turned towards it."""
        starts = coordinates_of(self.robot, positions, rotations)
        self.qpos[:, : starts.shape[-1]] = starts
        self.follow()

    def follow(self, rows: Bool[np.ndarray, " rows"] | None = None) -> None:
        """Turn the wheels towards their anchors and hold the elements of cables with a memory.

        Exits that give way are then where their forces balance.
        """
        self.move_exits(rows)
        self.turn_wheels(rows)
        self.hold(rows)

    def move_exits(self, rows: Bool[np.ndarray, " rows"] | None = None, *, hold: bool = True) -> None:
        """Move exits that give way to where their forces balance; the wheels turn on the way."""
        if not self.slides:
            return
        rows = np.ones(len(self.qpos), dtype=bool) if rows is None else rows
        rows = rows & np.isfinite(self.qpos).all(1)
        at = np.flatnonzero(rows)

        def springs() -> Float[np.ndarray, "rows dofs"]:
            self.turn_wheels(rows)
            if hold:
                self.hold(rows)
            self.batch.forward(at, stage=mujoco.mjtStage.mjSTAGE_VEL.value)
            return self._spring

        if len(at):
            self.slides.settle(self.qpos, at, self.rest_lengths[at].mean(1), springs)
            self.qvel[at[:, None], self.slides.dofs[self.slides.some]] = 0

    def hold(self, rows: Bool[np.ndarray, " rows"] | None = None) -> None:
        """Put the elements of cables with a memory where they are after a straight way from the start of the step."""
        if self.step is None:
            return
        rows = np.ones(len(self.qpos), dtype=bool) if rows is None else rows
        self.batch.forward(rows, stage=mujoco.mjtStage.mjSTAGE_POS.value)
        springs, ends = self._elements.hold(self.step, rows, self._lengths, self.entries)
        self.springs[rows], self.band[rows, :, 1] = springs[rows], ends[rows]

    def turn_wheels(self, rows: Bool[np.ndarray, " rows"] | None = None) -> None:
        """Turn each wheel towards its anchor, as a taut cable does and a slack one does not."""
        if not len(self.swivels):
            return
        rows = np.ones(len(self.qpos), dtype=bool) if rows is None else rows
        self.batch.forward(rows, stage=mujoco.mjtStage.mjSTAGE_POS.value)
        turns, each = self.swivels.turns(self._xpos, self._xmat, self._anchors)[rows], np.flatnonzero(rows)[:, None]
        if self.robot.mobility == "spatial":
            self.qpos[each, self.swivels.coordinates] += turns
            self.qvel[each, self.swivels.dofs] = 0
        else:
            wheels = each, self.swivels.bodies
            self._quaternions[wheels] = pulleys.flipped(self._quaternions[wheels], turns)

    @property
    def off_wheel(self) -> Bool[np.ndarray, " rows"]:
        """Whether a cable is off its wheel, as of MuJoCo's last call."""
        if not len(self.swivels):
            return np.zeros(len(self.qpos), dtype=bool)
        points = self._points[:, self.swivels.cables]
        return np.any(self.swivels.off_wheel(self._xpos, self._xmat, self._anchors, points), axis=1)

    @property
    def rest_lengths(self) -> Float[np.ndarray, "rows cables"]:
        """Unstretched cable lengths l0 [m]."""
        return self.band[:, :, 1] - self.entries if self.step is None else self.step.rest_lengths

    def evaluate(
        self, at: Int[np.ndarray, " some"], qpos: Float[np.ndarray, "some coordinates"]
    ) -> Float[np.ndarray, "some free"]:
        """``forces`` on the rows ``at`` at ``qpos`` and zero velocity, with the wheels turned and the elements held."""
        rows = np.zeros(len(self.qpos), dtype=bool)
        rows[at] = True
        self.qpos[at], self.qvel[at] = qpos, 0
        self.follow(rows)
        self.batch.forward(at)
        net = (self._smooth[at, : self.free] - self._damper[at, : self.free]) * self.unit
        return in_base_frame(net, self._xmat[at, self._platform].reshape(-1, 3, 3), self.length)

    @property
    def accelerating(self) -> Float[np.ndarray, "rows free"]:
        """Net generalised force on the platform without the damping, as of MuJoCo's last call [N, N m].

        In the coordinates of its joints.
        """
        return (self._smooth[:, : self.free] - self._damper[:, : self.free]) * self.unit

    @property
    def unbalanced(self) -> Float[np.ndarray, " rows"]:
        """The largest component of ``forces``, and of the torques on wheels, over their radii [N]."""
        largest = np.abs(self.forces).max(1)
        if len(self.swivels.dofs):
            turning = np.abs(self._smooth - self._damper)[:, self.swivels.dofs] * self.unit / self.swivels.radii
            largest = np.maximum(largest, turning.max(1))
        return largest

    @property
    def unbalanced_exits(self) -> Float[np.ndarray, " rows"]:
        """The largest force that is left on an exit that gives way [N], as of MuJoCo's last call."""
        left = np.abs(self._smooth - self._damper)[:, self.slides.dofs[self.slides.some]] * self.unit
        return left.max(1, initial=0)

    @property
    def forces(self) -> Float[np.ndarray, "rows free"]:
        """Net force and torque on the platform's origin without the damping, as of MuJoCo's last call [N], base frame.

        Torques are divided by the robot's characteristic length.
        """
        return in_base_frame(self.accelerating, self.rotations, self.length)

    @property
    def pull(self) -> Float[np.ndarray, " rows"]:
        """The sum of all tensions [N], as of MuJoCo's last call: it controls the motion, and is not a result."""
        return (self.springs * np.maximum(self._lengths - self.band[:, :, 1], 0)).sum(1) * self.unit

    @property
    def unstretched(self) -> Bool[np.ndarray, "rows cables"]:
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
        self.follow()
        self.batch.forward()
        return np.maximum(self.unbalanced, self.unbalanced_exits)

    def displaced(
        self, qpos: Float[np.ndarray, "some coordinates"], moves: Float[np.ndarray, "*each some free"]
    ) -> Float[np.ndarray, "*each some coordinates"]:
        """Coordinates of platforms after ``moves``: translation and rotation times the length, base frame [m]."""
        there = np.empty((*moves.shape[:-1], qpos.shape[-1]))
        there[:] = qpos
        if self.robot.mobility != "spatial":
            there[..., : self.free] += moves / np.r_[1.0, 1.0, self.length]
            return there
        there[..., :3] += moves[..., :3]
        there[..., 3:7] = turned(qpos[:, 3:7], moves[..., 3:] / self.length)
        return there

    def read(self, qpos: Float[np.ndarray, "rows coordinates"]) -> SimulationReading:
        """Each row's state at ``qpos`` and zero velocity."""
        self.qpos[:] = qpos
        residuals = self.residuals()
        off_wheel, poses = self.off_wheel, (self._xpos[:, self._platform].copy(), self.rotations.copy())
        lengths = self._lengths - self.entries
        stiffness = self._stiffness()
        self.turn_wheels()
        return SimulationReading(*poses, lengths, self._tensions(), residuals, *stiffness, off_wheel)

    def observe(self, qpos: Float[np.ndarray, "rows coordinates"]) -> Observation:
        """Each row's pose and cables at ``qpos``: ``read`` without residual and stiffness, for many states."""
        self.qpos[:], self.qvel[:] = qpos, 0
        self.hold()
        self.batch.forward()
        at, lengths = self._xpos[:, self._platform].copy(), self._lengths - self.entries
        return Observation(at, self.rotations.copy(), lengths, self._tensions())

    def _tensions(self) -> Float[np.ndarray, "rows cables"]:
        """Tension [N] of each rope: MuJoCo's spring force with only that spring switched on, along its tendon.

        qfrc_spring = -J' f, hence f = -(J . qfrc_spring) / (J . J): it would be negative if a cable pushed. All parts
        of line pull with f, and share it.
        """
        all_springs, all_polynomials = self.springs.copy(), self.polynomials.copy()
        elements = self._elements.stiffnesses.copy()
        forces = np.empty((self.robot.cables, *self._spring.shape))
        for cable in range(self.robot.cables):
            self.springs[:] = self.polynomials[:] = 0
            self._elements.stiffnesses[:] = np.where(self._elements.owners == cable, elements, 0)
            self.springs[:, cable], self.polynomials[:, cable] = all_springs[:, cable], all_polynomials[:, cable]
            self.batch.forward(stage=mujoco.mjtStage.mjSTAGE_VEL.value)
            forces[cable] = self._spring
        self.springs[:], self.polynomials[:] = all_springs, all_polynomials
        self._elements.stiffnesses[:] = elements
        jacobian = np.zeros_like(forces)
        own = self._entry_cables < len(forces)
        jacobian[self._entry_cables[own], :, self.model.ten_J_colind[own]] = self._jacobian.T[own]
        jacobian[..., self.slides.dofs[self.slides.some]] = 0  # where the frame's springs act, too
        # The two are parallel. Where J vanishes, at an anchor on its exit, the spring's force vanishes too.
        squares = (jacobian * jacobian).sum(-1)
        pulls = -(jacobian * forces).sum(-1) / np.maximum(squares, np.finfo(float).tiny)
        return self.robot.cabling.tensions(pulls.T * self.unit) + 0.0  # no negative zero

    def _stiffness(self) -> tuple[Float[np.ndarray, "rows free"], Float[np.ndarray, "rows free"]]:
        """Eigenvalues [N/m], ascending, of the stiffness in MuJoCo after ``residuals``; direction of the smallest.

        Central differences on the cables that are stretched now: during the differencing these may push and others have
        no force, so that a displacement does not cross the kink of a cable that is stretched by less; and no element of
        a memory begins or ends to slide. The wheels follow the platform. Eigenvalues within the error of truncation,
        which is of the square of the largest rotation, are 0.
        """
        band, springs, polynomials = self.band.copy(), self.springs.copy(), self.polynomials.copy()
        elements = self._elements.stiffnesses.copy()
        length = self._lengths
        unstretched = self.unstretched
        self.band[:] = np.where(length > band[:, :, 1], band[:, :, 1], band[:, :, 0])[:, :, None]
        if self.step is not None:
            slopes, free = self.step.tangent(length - self.entries)
            self.springs[:], self.band[:] = slopes / self.unit, (free + self.entries)[:, :, None]
            self._elements.stiffnesses[:] = 0
        self.springs[unstretched] = self.polynomials[unstretched] = 0
        rest = self.qpos.copy()
        step = DIFFERENCE * (length - self.entries).mean(1)
        free = self.free
        directions, ways = np.tile(np.arange(free), 2), np.repeat([1.0, -1.0], free)
        moves = np.zeros((2 * free, len(rest), free))
        moves[np.arange(2 * free), :, directions] = ways[:, None] * step
        pushed, rotations = np.empty((2 * free, len(rest), free)), np.empty((2 * free, len(rest), 3, 3))
        for i, displaced in enumerate(self.displaced(rest, moves)):
            self.qpos[:] = displaced
            self.move_exits(hold=False)
            self.turn_wheels()
            self.batch.forward()
            pushed[i], rotations[i] = self.accelerating, self.rotations
        forces = in_base_frame(pushed, rotations, self.length)
        stiffness = np.moveaxis((forces[free:] - forces[:free]) / (2 * step[:, None]), 0, -1)
        self.qpos[:], self.band[:], self.springs[:], self.polynomials[:] = rest, band, springs, polynomials
        self._elements.stiffnesses[:] = elements
        known = np.isfinite(stiffness).all((1, 2))
        values, vectors = np.linalg.eigh((stiffness + stiffness.swapaxes(1, 2))[known] / 2)
        truncation = (step[known, None] / self.length) ** 2 * np.abs(values).max(1, keepdims=True)
        values[np.abs(values) <= truncation] = 0
        eigenvalues, softest = np.full((2, *stiffness.shape[:2]), np.nan)
        eigenvalues[known], softest[known] = values, vectors[:, :, 0]
        return eigenvalues, softest


def in_base_frame(
    forces: Float[np.ndarray, "*batch free"], rotations: Float[np.ndarray, "*batch 3 3"], length: float
) -> Float[np.ndarray, "*batch free"]:
    """Forces, and torques over ``length``, of platforms with these rotations from MuJoCo's generalised forces [N]."""
    forces = forces.copy()
    if forces.shape[-1] == 6:  # a free joint's torque is in the body frame
        forces[..., 3:] = (rotations @ forces[..., 3:, None])[..., 0]
    forces[..., slice(3, 6) if forces.shape[-1] == 6 else slice(2, 3)] /= length
    return forces


def matrices(quaternions: Float[np.ndarray, "*batch 4"]) -> Float[np.ndarray, "*batch 3 3"]:
    """Rotation matrices of unit quaternions (w, x, y, z)."""
    w, x, y, z = (quaternions[..., i] for i in range(4))
    rows = (
        (1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)),
        (2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)),
        (2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)),
    )
    whole = np.empty((*w.shape, 3, 3))
    for i, row in enumerate(rows):
        whole[..., i, 0], whole[..., i, 1], whole[..., i, 2] = row
    return whole


def turned(
    quaternions: Float[np.ndarray, "*#batch 4"], angles: Float[np.ndarray, "*#batch 3"]
) -> Float[np.ndarray, "*batch 4"]:
    """Orientations (w, x, y, z) after rotations by these vectors in the base frame [rad]."""
    half = angles / 2
    angle = np.sqrt(np.vecdot(half, half))
    sine = half * np.sinc(angle / np.pi)[..., None]
    cosine, (x, y, z) = np.cos(angle), (sine[..., i] for i in range(3))
    a, b, c, d = (quaternions[..., i] for i in range(4))
    product = np.stack(
        (
            cosine * a - x * b - y * c - z * d,
            cosine * b + x * a + y * d - z * c,
            cosine * c + y * a + z * b - x * d,
            cosine * d + z * a + x * c - y * b,
        ),
        axis=-1,
    )
    return product / np.sqrt(np.vecdot(product, product))[..., None]


def refuse_own_masses(problems: Problems) -> None:
    """Refuse a mass per problem, since one model has one mass.

    Raises:
        InvalidInput: another mass than the robot's.
    """
    if (problems.mass != problems.robot.mass).any():
        raise InvalidInput("mass: found one per problem, expected the robot's own: MuJoCo has one model for all rows")


_idle: dict[Robot, Simulations] = {}
"""Cache of simulations of one row: building one takes as long as a settling."""

MOST_IDLE = 16
"""Number of robots whose simulations are cached."""


@contextmanager
def simulations_of(problems: Problems, model: mujoco.MjModel | None = None, threads: int = 1) -> Iterator[Simulations]:
    """Simulations of ``problems`` at their start: for this caller only, with MuJoCo's warnings suppressed.

    Args:
        problems: (rows,) problems, of one mass.
        model: the model to use instead of the generated one, with its own springs.
        threads: 0 for one per processor.

    Raises:
        InvalidInput: a mass per problem, since all rows have one model.
    """
    robot, rows = problems.robot, len(problems)
    refuse_own_masses(problems)
    reusable = model is None and rows == 1
    found = _idle.pop(robot, None) if reusable else None  # removed, so that no other thread can use it
    with quiet():
        if found is None:
            found = Simulations(robot, _model_of(robot) if model is None else _prepared(model, robot), rows, threads)
        found.start(problems, own_springs=model is not None)
        yield found
    if reusable:
        _idle[robot] = found
        while len(_idle) > MOST_IDLE:
            _idle.pop(next(iter(_idle)), None)


@functools.lru_cache(maxsize=MOST_IDLE)
def _model_of(robot: Robot) -> mujoco.MjModel:
    """The compiled model of ``robot``, never modified: each problem sets its own pose, lengths and stiffnesses."""
    middle = RigidTransform.from_translation(robot.workspace.mean(0))
    spec = mujoco.MjSpec.from_string(to_mjcf(without_memory(robot), middle, 1.0 + robot.cabling.least_lengths))
    add_elements(spec, robot.cabling)
    spec.memory = ARENA
    spec.option.disableflags |= UNUSED
    return _prepared(spec.compile(), robot)


def unit_of(robot: Robot) -> float:
    """Unit of mass [kg], and hence of force [N], of this robot's model in MuJoCo: a power of two."""
    return float(2.0 ** np.round(np.log2(robot.mass / MASS_IN_UNITS)))


def _prepared(model: mujoco.MjModel, robot: Robot) -> mujoco.MjModel:
    """A copy of ``model`` in its unit, with our own damping, time step and inertia of wheels.

    They do not change the equilibrium.
    """
    model, unit = copy.copy(model), unit_of(robot)
    model.opt.integrator = mujoco.mjtIntegrator.mjINT_DISCRETE
    model.opt.viscosity = model.opt.density = 0
    for quantity in (
        model.body_mass,
        model.body_inertia,
        model.tendon_stiffness,
        model.tendon_stiffnesspoly,
        model.tendon_damping,
        model.jnt_stiffness,
    ):
        quantity /= unit
    dofs = pulleys.Swivels.of(model, robot.cabling).dofs
    model.dof_armature[dofs] = HELD * robot.mass * robot.characteristic_length**2 / unit
    mujoco.mj_setConst(model, mujoco.MjData(model))  # constants that MuJoCo computes from masses
    return model

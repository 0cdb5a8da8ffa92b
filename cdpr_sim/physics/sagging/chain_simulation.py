"""One platform in MuJoCo, on cables some of which have mass: its state, its forces, and the division of its chains."""

# pyright: reportAttributeAccessIssue=false
# mujoco ships no type stubs for its compiled modules.
from __future__ import annotations

import copy
import functools
from collections.abc import Iterator
from contextlib import contextmanager

import mujoco
import numpy as np
from jaxtyping import Bool, Float
from scipy.spatial.transform import RigidTransform, Rotation

from cdpr_sim.core.memory import Memory, without_memory
from cdpr_sim.core.robot import STANDARD_GRAVITY, Robot
from cdpr_sim.physics import pulleys, tendons
from cdpr_sim.physics.batch import HELD
from cdpr_sim.physics.chains import SEGMENTS, STRAIGHT, ChainDivision, Chains, divisions, felt_at_exit, straight
from cdpr_sim.physics.mjcf import place, to_mjcf
from cdpr_sim.physics.rope_memory import RopeStep

TURNING = 5.0
"""Inertia added to the platform's rotation, as a multiple of its own: a small platform rotates faster than it
swings, and only the swing has to be resolved."""

IMMOVABLE = 1e100
"""Inertia of a platform that is held fixed: no force moves it."""


class ChainSimulation:
    """One platform on cables of which some have mass, or none.

    Args:
        robot: the robot.
        rest_lengths: (cables,) [m].
        axial_stiffness: (cables,) [N].
        external_wrench: force and torque on the platform's origin, (6,) [N, N m].
        start: initial pose of the platform.
        model: the model to use instead of the generated one, with its own springs and masses.
        memory: where cables have a memory, that before this step, and the time since then [s]; default: that of new
            ropes. It is held (``rope_memory``): springs are tangents of its laws at the present lengths.
    """

    def __init__(
        self,
        robot: Robot,
        rest_lengths: Float[np.ndarray, " cables"],
        axial_stiffness: Float[np.ndarray, " cables"],
        external_wrench: Float[np.ndarray, "6"],
        start: RigidTransform,
        model: mujoco.MjModel | None = None,
        memory: tuple[Memory, float] | None = None,
    ) -> None:
        self.robot, self.rest_lengths = robot, rest_lengths
        cabling = robot.cabling
        self.model = copy.copy(_model_of(robot) if model is None else model)
        self.model.opt.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
        self.model.opt.viscosity = self.model.opt.density = 0
        self.data, self.film = mujoco.MjData(self.model), mujoco.MjData(self.model)
        self.chains = Chains.of(self.model, cabling)
        self.weights = self._weights()
        self.slides = self.chains.dofs.reshape(len(self.chains.dofs), 3 * (SEGMENTS - 1))
        self.massless = np.flatnonzero(cabling.linear_density == 0)
        self.single = np.array([self._id(mujoco.mjtObj.mjOBJ_TENDON, f"cable_{i + 1}") for i in self.massless], int)
        self.swivels = pulleys.Swivels.of(self.model, cabling)
        self.entries = pulleys.entries(cabling)
        first = np.zeros(robot.cables, int)  # the tendon that leaves each exit
        first[self.massless], first[self.chains.cables] = self.single, self.chains.segments[:, 0]
        self.guided = first[self.swivels.cables]
        self.remembering, self.first, self.ropes = np.flatnonzero(cabling.remembers), first, None
        if len(self.remembering):
            before, duration = memory or (Memory.fresh(robot), 0.0)
            self.ropes = RopeStep.of(cabling, axial_stiffness[None], rest_lengths[None], before[None], duration)
        self.axial_stiffness, self.wrench, self.given = axial_stiffness, external_wrench, model is not None
        if not self.given:
            self._let_out(straight(felt_at_exit(cabling, self.chains.cables)))
        self.free, self.length, self.held = len(robot.free), robot.characteristic_length, False
        self.angular = slice(3, 6) if self.free == 6 else slice(2, 3)
        self.inertia = np.concatenate([np.full(3, robot.mass), np.diag(robot.inertia)])[robot.free]
        self.model.dof_armature[self.angular] = TURNING * self.inertia[self.angular]
        self.model.dof_armature[self.swivels.dofs] = HELD * robot.mass * self.length**2
        self._compile()
        self.tendons = np.concatenate([self.chains.segments.ravel(), self.single])
        self.platform = self._id(mujoco.mjtObj.mjOBJ_BODY, "platform")
        self.load = (
            max(robot.weight, float(np.abs(external_wrench / robot.units).max())) or robot.mass * STANDARD_GRAVITY
        )
        self.swing = float(np.sqrt(self.load / robot.mass / rest_lengths.mean()))
        self.let_go(start)

    def let_go(self, pose: RigidTransform) -> None:
        """Put the platform at ``pose``, with zero velocity."""
        self.reset()
        place(self.model, self.data, self.robot, pose)

    def reset(self) -> None:
        """Reset the motion, and apply the load again: MuJoCo removes it where a motion diverges."""
        mujoco.mj_resetData(self.model, self.data)
        if self.wrench.any():
            self.data.xfrc_applied[self._id(mujoco.mjtObj.mjOBJ_BODY, "origin")] = self.wrench

    def _id(self, kind: mujoco.mjtObj, name: str) -> int:
        return mujoco.mj_name2id(self.model, kind.value, name)

    def _let_out(self, division: ChainDivision) -> None:
        """Springs and masses for the present rest lengths."""
        self.division = division
        model, cabling, rest, axial_stiffness = self.model, self.robot.cabling, self.rest_lengths, self.axial_stiffness
        self.chains.let_out(model, self.robot, axial_stiffness, rest, division)
        model.tendon_lengthspring[self.single, 1] = (rest + self.entries)[self.massless]
        model.tendon_stiffness[self.single] = tendons.springs(cabling, axial_stiffness, rest)[self.massless]
        further = tendons.polynomials(cabling, axial_stiffness, rest)
        model.tendon_stiffnesspoly[self.single] = further[self.massless]
        if self.ropes is not None:
            beyond = rest.copy()
            beyond[self.chains.cables] = self.chains.rest_lengths(model)[:, 0]
            self.ropes, self.within = self.ropes.in_chain(beyond[None]), rest - beyond

    def hold_ropes(self) -> None:
        """Springs that pull as cables with a memory do at their present lengths, as of MuJoCo's last positions."""
        if self.ropes is None:
            return
        model, which = self.model, self.remembering
        stiffness, free = self.ropes.tangent(self._lengths_in_chains()[None])
        model.tendon_lengthspring[self.first[which], 1] = (free[0] - self.within + self.entries)[which]
        for springs, polynomials in (
            (model.tendon_stiffness, model.tendon_stiffnesspoly),
            (self.springs, self.polynomials),
        ):
            springs[self.first[which]], polynomials[self.first[which]] = stiffness[0, which], 0.0

    def _lengths_in_chains(self) -> Float[np.ndarray, " cables"]:
        """Lengths for ``RopeStep.in_chain``: the first segments', and the rest lengths of the others [m]."""
        return self.data.ten_length[self.first] - self.entries + self.within

    def remembered(self) -> Memory:
        """The memory of the cables, which are at rest, without the time; of those with mass, that at their exits."""
        assert self.ropes is not None
        tensions = self.tensions()
        hung = [cable for cable in self.remembering if cable in self.chains.cables]
        for cable in hung:
            tensions[cable] = self._along(self.first[cable]) / self.robot.reeving[cable]
        return self.ropes.memory_after(self._lengths_in_chains()[None], tensions[None])[0]

    def wind(self, rest_lengths: Float[np.ndarray, " cables"]) -> None:
        """Let cables out, in motion: all segments of a chain change alike, so that it stays divided as it is.

        Exact in equilibrium. The masses slide along the material, which neglects the momentum of what is wound.
        MuJoCo's constants stay as they are: in motion it uses only sums of masses, to choose points of reference.
        """
        self.rest_lengths = rest_lengths
        self.weights = self._weights()
        self._let_out(self.division)
        self._note_springs()

    def _weights(self) -> Float[np.ndarray, " chains"]:
        beyond = self.rest_lengths - self.robot.wrapped_lengths
        return (self.robot.cable_weights * beyond)[self.chains.cables]

    def _compile(self) -> None:
        """Compute the constants that follow from springs and masses."""
        mujoco.mj_setConst(self.model, self.data)
        self._note_springs()
        self.reset()

    def _note_springs(self) -> None:
        self.springs, self.polynomials = self.model.tendon_stiffness.copy(), self.model.tendon_stiffnesspoly.copy()

    @property
    def pose(self) -> RigidTransform:
        """The platform's pose, as of MuJoCo's last call."""
        data = self.data
        return RigidTransform.from_components(
            data.xpos[self.platform].copy(), Rotation.from_quat(data.xquat[self.platform], scalar_first=True)
        )

    @property
    def rotation(self) -> Float[np.ndarray, "3 3"]:
        """The platform's rotation matrix in MuJoCo."""
        return self.data.xmat[self.platform].reshape(3, 3)

    @property
    def chords(self) -> Float[np.ndarray, " chains"]:
        """Lengths of the massless paths from exit to anchor [m]."""
        return self.data.ten_length[self.chains.chords] - self.chains.entries

    @property
    def lengths(self) -> Float[np.ndarray, " cables"]:
        """Length of each cable [m]; for a cable with mass, its chord, over a wheel that faces the anchor."""
        model, data, qpos = self.model, self.data, self.data.qpos.copy()
        aside = bool(self.chains.over.any())  # the wheels face the first masses
        if aside:
            self.swivels.face(model, data, anchors=True)
            mujoco.mj_fwdPosition(model, data)
        lengths = np.empty(self.robot.cables)
        lengths[self.chains.cables] = self.chords
        lengths[self.massless] = data.ten_length[self.single] - self.entries[self.massless]
        if aside:
            data.qpos[:] = qpos
            self.turn_wheels()
            mujoco.mj_fwdPosition(model, data)
        return lengths

    @property
    def net(self) -> Float[np.ndarray, " dofs"]:
        """Unbalanced generalised forces [N, N m], as of MuJoCo's last call."""
        return self.data.qfrc_smooth - self.data.qfrc_damper

    def forces(self) -> tuple[Float[np.ndarray, " free"], Float[np.ndarray, "chains slides"]]:
        """Net force and torque over the characteristic length [N] on the platform, base frame; and on the slides."""
        net = self.net
        platform = net[: self.free].copy()
        if self.free == 6:
            platform[3:] = self.rotation @ platform[3:]
        platform[self.angular] /= self.length
        return platform, net[self.slides]

    def in_dofs(self, x: Float[np.ndarray, " free"]) -> Float[np.ndarray, " dofs"]:
        """A translation and rotation of the platform, base frame [m], in MuJoCo's degrees of freedom; or a velocity."""
        move = np.zeros(self.model.nv)
        move[: self.free] = x
        move[self.angular] /= self.length
        if self.free == 6:
            move[3:6] = self.rotation.T @ move[3:6]
        return move

    def unbalanced(self) -> float:
        """The largest unbalanced force [N], on the platform, on a mass, or on a wheel, as of MuJoCo's last call."""
        platform, slides = self.forces()
        largest = np.abs(slides).max(initial=0.0)
        if not self.held:
            largest = max(np.abs(platform).max(), largest)
        if len(self.swivels.dofs):
            largest = max(largest, np.abs(self.net[self.swivels.dofs] / self.swivels.radii).max())
        return float(largest)

    def hold(self) -> None:
        """Fix the platform at its pose, whatever pulls it."""
        self.model.dof_armature[: self.free] = IMMOVABLE
        self.held = True

    def residual(self) -> float:
        """``unbalanced`` at the present coordinates, at zero velocity and with the true springs."""
        self.model.tendon_stiffness[:], self.model.tendon_stiffnesspoly[:] = self.springs, self.polynomials
        self.data.qvel[:] = 0
        self.turn_wheels()
        if self.ropes is not None:
            mujoco.mj_fwdPosition(self.model, self.data)
            self.hold_ropes()
        mujoco.mj_forward(self.model, self.data)
        return self.unbalanced()

    @property
    def true(self) -> bool:
        """Whether every spring has its true stiffness."""
        return bool((self.model.tendon_stiffness == self.springs).all())

    def turn_wheels(self) -> None:
        """Turn each wheel towards its anchor, or towards the first mass of its chain."""
        if len(self.swivels):
            self.swivels.face(self.model, self.data)

    def seen(self) -> tuple[RigidTransform, Float[np.ndarray, " cables"], Float[np.ndarray, " cables"]]:
        """Pose, lengths and tensions of the present state; the motion goes on undisturbed."""
        data, self.data = self.data, self.film
        self.data.qpos[:], self.data.qvel[:] = data.qpos, 0
        tensions = self.tensions()
        read = self.pose, self.lengths, tensions
        self.data = data
        return read

    def anchor_pulls(self) -> Float[np.ndarray, "chains 3"]:
        """Pull of each chain on the platform [N], base frame: its last segment's, and the weight of the mass there."""
        with self._only(self.chains.segments[:, -1]):
            pulled = self.data.qfrc_spring[self.chains.dofs[:, 0]] @ self.rotation.T
        return self.model.body_mass[self.chains.ends, None] * self.model.opt.gravity - pulled

    def tensions(self) -> Float[np.ndarray, " cables"]:
        """Tension of each cable [N], with the present springs; for a cable with mass, at the platform's end.

        For a massless cable, the force of its own spring along it.
        """
        tensions = np.empty(self.robot.cables)
        tensions[self.chains.cables] = np.linalg.norm(self.anchor_pulls(), axis=1)
        for cable, tendon in zip(self.massless, self.single, strict=True):
            tensions[cable] = self._along(tendon)
        return tensions / self.robot.reeving

    def _along(self, tendon: np.integer) -> float:
        """MuJoCo's force of one tendon's spring along it [N]."""
        model, data = self.model, self.data
        first, entries = model.ten_J_rowadr[tendon], model.ten_J_rownnz[tendon]
        with self._only(tendon):
            row = data.ten_J[first : first + entries]
            force = data.qfrc_spring[model.ten_J_colind[first : first + entries]]
            return float(-(row @ force) / max(row @ row, np.finfo(float).tiny) + 0.0)

    @contextmanager
    def _only(self, tendons: np.ndarray | np.integer) -> Iterator[None]:
        """MuJoCo's forces with only these springs, within the block."""
        model, data = self.model, self.data
        springs, polynomials = model.tendon_stiffness.copy(), model.tendon_stiffnesspoly.copy()
        model.tendon_stiffness[:] = model.tendon_stiffnesspoly[:] = 0
        model.tendon_stiffness[tendons] = springs[tendons]
        model.tendon_stiffnesspoly[tendons] = polynomials[tendons]
        mujoco.mj_fwdPosition(model, data)
        mujoco.mj_fwdVelocity(model, data)
        yield
        model.tendon_stiffness[:], model.tendon_stiffnesspoly[:] = springs, polynomials

    def off_wheel(self) -> bool:
        """Whether a cable is off its wheel, as of MuJoCo's last call."""
        if not len(self.swivels):
            return False
        points = self.data.ten_wrapnum[self.guided]
        return bool(self.swivels.off_wheel(self.data.xpos, self.data.xmat, self.data.site_xpos, points).any())

    def lay(self, pulls: Float[np.ndarray, "chains 3"]) -> Bool[np.ndarray, " chains"]:
        """Lay out chains as they hang between exit and anchor for these approximate pulls on the platform [N].

        Only chains for which that succeeds are changed; returns which they are.
        """
        model, data, chains = self.model, self.data, self.chains
        mujoco.mj_kinematics(model, data)
        extents, found = chains.hung(model, pulls, self.spans())
        data.qpos[chains.coordinates[found]] = extents[found] @ self.rotation
        return found

    def spans(self) -> Float[np.ndarray, "chains 3"]:
        """Vectors from anchors to exits [m], as of MuJoCo's last call."""
        return self.robot.exits[self.chains.cables] - self.data.xpos[self.chains.ends]

    def divide_at_bends(self) -> bool:
        """Move the masses of chains with bends to where they bend; returns whether there are any.

        MuJoCo's pull on the anchor gives the place of the bend: its horizontal component is the same along the whole
        chain, and its vertical component over the weight per length is the distance to the point where the chain is
        horizontal.
        """
        data, chains = self.data, self.chains
        weights = self.weights[:, None]
        pulls = self.anchor_pulls() / weights
        bends = np.hypot(pulls[:, 0], pulls[:, 1])
        if self.given or not (bends < STRAIGHT).any():
            return False
        qpos = data.qpos.copy()
        for _ in range(2):
            division = divisions(1 + pulls[:, 2], bends, felt_at_exit(self.robot.cabling, chains.cables))
            self._let_out(division)
            self._compile()
            data.qpos[:] = qpos
            bends[~self.lay(pulls * weights)] = STRAIGHT  # a folded chain stays as it is
        return True


@functools.lru_cache(maxsize=16)
def _model_of(robot: Robot) -> mujoco.MjModel:
    """The compiled model of ``robot``, which is never modified."""
    middle = RigidTransform.from_translation(robot.workspace.mean(0))
    lengths = 1.0 + robot.wrapped_lengths + SEGMENTS**2 * robot.cabling.pulley_radius  # enough for every wheel
    return mujoco.MjModel.from_xml_string(to_mjcf(without_memory(robot), middle, lengths))

"""Platforms side by side in MuJoCo, on cables some of which have mass: states, forces, and divisions of chains."""

# pyright: reportAttributeAccessIssue=false
# mujoco ships no type stubs for its compiled modules.
from __future__ import annotations

import copy
import functools
from collections.abc import Iterator
from contextlib import contextmanager

import mujoco
import numpy as np
from jaxtyping import Bool, Float, Int
from mujoco.batch import Batch
from scipy.spatial.transform import RigidTransform

from cdpr_sim.core.memory import Memory, without_memory
from cdpr_sim.core.problem import Problems
from cdpr_sim.core.robot import STANDARD_GRAVITY, Robot
from cdpr_sim.physics import pulleys
from cdpr_sim.physics.batch import HELD, Observation, in_base_frame, matrices, refuse_own_masses, turned
from cdpr_sim.physics.cable import Law, Springs
from cdpr_sim.physics.chains import (
    SEGMENTS,
    STRAIGHT,
    ChainDivision,
    Chains,
    cut,
    divisions,
    ends_of,
    expected_pulls,
    hang,
    profiles,
    straight,
)
from cdpr_sim.physics.mjcf import coordinates_of, to_mjcf
from cdpr_sim.physics.rope_memory import RopeStep

TURNING = 5.0
"""Inertia added to the platform's rotation, as a multiple of its own: a small platform rotates faster than it
swings, and only the swing has to be resolved."""

IMMOVABLE = 1e100
"""Inertia of a platform that is held fixed: no force moves it."""

SHORTEST_FREE = 0.1
"""Least free length of a first segment that damping assumes, in radii of its wheel."""

UPRIGHT = np.array([1.0, 0.0, 0.0, 0.0])
"""Quaternion w x y z without rotation."""

POSITIONS, VELOCITIES, FORCES = (
    stage.value for stage in (mujoco.mjtStage.mjSTAGE_POS, mujoco.mjtStage.mjSTAGE_VEL, mujoco.mjtStage.mjSTAGE_ACC)
)
"""Stages of MuJoCo's forward pass."""

SPRINGS = ("tendon_lengthspring", "tendon_stiffness", "tendon_stiffnesspoly")
OTHERS = ("body_mass", "body_subtreemass", "body_quat")
"""Fields of the model that rows have of their own, and on which forces at zero velocity depend."""

PLACES = 9
"""Coordinates at which forces are evaluated at once beside those of a row: as many as ``ChainDerivatives`` needs, six
displacements of a spatial platform and three of the masses, or three of a planar platform and six of the masses."""

Rows = Int[np.ndarray, " some"]
"""Indices of some of the rows, ascending."""


class ChainSimulations:
    """Platforms of one robot side by side, on cables of which some have mass, or none.

    No row has an effect on another one. Methods take the rows ``at`` which they act; results are in their order.

    Args:
        problems: (rows,) problems of one mass.
        starts: initial poses of the platforms, a stack of (rows,).
        model: the model to use instead of the generated one, with its own springs and masses.
        memory: where cables have a memory, that before this step, (rows,), and the time since then [s]; default: that
            of new ropes. It is held (``rope_memory``): springs are tangents of its laws at the present lengths.
        threads: on which MuJoCo computes the rows; 0 for one per processor.

    Raises:
        InvalidInput: a mass per problem, since all rows have one model.
    """

    def __init__(
        self,
        problems: Problems,
        starts: RigidTransform,
        *,
        model: mujoco.MjModel | None = None,
        memory: tuple[Memory, float] | None = None,
        threads: int = 1,
    ) -> None:
        refuse_own_masses(problems)
        self.robot, rows, self.starts = problems.robot, len(problems), starts
        robot, cabling = self.robot, self.robot.cabling
        self.all = np.arange(rows)
        self.rest_lengths, self.axial_stiffness, self.wrenches = (
            np.broadcast_to(numbers, (rows, each))
            for numbers, each in (
                (problems.rest_lengths, robot.cables),
                (problems.axial_stiffness, robot.cables),
                (problems.external_wrench, 6),
            )
        )
        self.given, self.held = model is not None, False
        self.free, self.length = len(robot.free), robot.characteristic_length
        self.angular = slice(3, 6) if self.free == 6 else slice(2, 3)
        self.inertia = _inertia(robot)
        self.model, self.chains, self.swivels, self.descendants = (
            _generated(robot) if model is None else _prepared(model, robot)
        )
        chains = self.chains
        self.batch = Batch(self.model, rows * (1 + PLACES), threads)  # behind all rows there are simulations for PLACES
        self._name_fields()
        # Applied loads and actuators of a given model count only in the last of MuJoCo's stages.
        self._stage = FORCES if self.given or self.wrenches.any() else VELOCITIES
        self.slides = chains.dofs.reshape(len(chains.dofs), 3 * (SEGMENTS - 1))
        self.massless = np.flatnonzero(~cabling.with_mass)
        self.single = np.array([self._id(mujoco.mjtObj.mjOBJ_TENDON, f"cable_{i + 1}") for i in self.massless], int)
        self.platform, self.origin = (self._id(mujoco.mjtObj.mjOBJ_BODY, name) for name in ("platform", "origin"))
        self.entries = pulleys.entries(cabling)
        self.first = np.zeros(robot.cables, int)  # the tendon that leaves each exit
        self.first[self.massless], self.first[chains.cables] = self.single, chains.segments[:, 0]
        self.tendons = np.concatenate([chains.segments.ravel(), self.single])
        self._facing = np.full(robot.cables, -1)  # the chain whose first mass a wheel faces
        self._facing[chains.cables] = np.arange(len(chains.cables))
        self.weights = self._weights()
        self.with_memory, self.ropes = np.flatnonzero(cabling.has_memory), None
        if len(self.with_memory):
            before, duration = memory or (Memory.fresh(robot, (rows,)), 0.0)
            self.ropes = RopeStep.of(cabling, self.axial_stiffness, self.rest_lengths, before, duration)
        self.springs, self.polynomials = self.stiffnesses.copy(), self.further.copy()
        if not self.given:
            division = straight(ends_of(cabling))
            self.division = ChainDivision(*(np.tile(part, (rows, 1, 1)) for part in division))
            self._let_out(self.all)
        load = np.maximum(robot.weight, np.abs(self.wrenches / robot.units).max(1))
        self.load = np.where(load > 0, load, robot.mass * STANDARD_GRAVITY)
        self.swing = np.sqrt(self.load / robot.mass / self.rest_lengths.mean(1))
        self.net, self.rotations = np.zeros((rows, self.model.nv)), np.zeros((rows, 3, 3))
        self.restart(self.all)

    def _name_fields(self) -> None:
        """MuJoCo's fields: those of the model that rows have of their own, states, and what MuJoCo computes."""
        rows = len(self.all)

        def own(name: str) -> np.ndarray:
            return self.batch.expand(name)[:rows]

        def computed(name: str) -> np.ndarray:
            return self.batch.bind(name)[:rows]

        self.bands, self.stiffnesses, self.further = (own(name) for name in SPRINGS)
        self.masses, self._subtrees, self._quaternions = (own(name) for name in OTHERS)
        self.tendon_damping, self.damping = own("tendon_damping"), own("dof_damping")
        self.armature, self.timestep = own("dof_armature"), own("opt.timestep").reshape(-1)
        self.qpos, self.qvel, self._loads = computed("qpos"), computed("qvel"), computed("xfrc_applied")
        self._passive, self._bias = computed("qfrc_passive"), computed("qfrc_bias")
        self._damper, self._spring = computed("qfrc_damper"), computed("qfrc_spring")
        self._smooth, self._jacobian = computed("qfrc_smooth"), computed("ten_J")
        self.ten_length, self.ten_velocity = computed("ten_length"), computed("ten_velocity")
        self.xpos, self.xmat = computed("xpos"), computed("xmat")
        self._frames = matrices(self.model.body_quat[self.swivels.bodies])
        if len(self.swivels):
            self._sites, self._points = computed("site_xpos"), computed("ten_wrapnum")
            self._grooves = computed("geom_xpos")

    def _id(self, kind: mujoco.mjtObj, name: str) -> int:
        return mujoco.mj_name2id(self.model, kind.value, name)

    def restart(self, at: Rows) -> None:
        """Put the platforms at their initial poses, with zero velocity, and their chains in approximate profiles."""
        if not len(at):
            return
        self.reset(at)
        robot, chains = self.robot, self.chains
        positions, rotations = self.starts[at].translation, self.starts[at].rotation.as_matrix()
        coordinates = coordinates_of(robot, positions, rotations)
        self.qpos[at, : coordinates.shape[1]] = coordinates
        lengths = np.zeros((len(at), robot.cables))
        lengths[:, chains.cables] = chains.rest_lengths(self.bands[at]).sum(2)
        anchors = positions[:, None] + robot.anchors @ rotations.swapaxes(1, 2)
        self.qpos[at[:, None, None, None], chains.coordinates] = profiles(robot, anchors, lengths) @ rotations[:, None]
        self.turn_wheels(at)

    def reset(self, at: Rows) -> None:
        """Reset the motion, and apply the loads again: MuJoCo removes them where a motion diverges."""
        self.batch.reset(at, stage=mujoco.mjtStage.mjSTAGE_NONE.value)
        self.net[at] = 0
        if self.wrenches.any():
            self._loads[at, self.origin] = self.wrenches[at]

    def _let_out(self, at: Rows) -> None:
        """Springs and masses for the present rest lengths and divisions.

        Of the constants that MuJoCo derives from masses, forces use only the sums of masses of subtrees, and only to
        choose points of reference.
        """
        chains, rest, row = self.chains, self.rest_lengths[at], at[:, None]
        law = Law.of(self.robot.cabling, self.axial_stiffness[at])
        lengths, masses = cut(self.robot, rest, ChainDivision(*(part[at] for part in self.division)))
        springs, segments = law.some(chains.cables).segments(lengths), (row[..., None], chains.segments)
        self.stiffnesses[segments], self.further[segments] = springs.stiffness, springs.polynomial
        lengths[..., 0] += chains.entries
        self.bands[(*segments, 1)] = lengths
        self.bands[row, self.single, 1] = (rest + self.entries)[:, self.massless]
        springs = law.springs(rest)
        self.stiffnesses[row, self.single] = springs.stiffness[:, self.massless]
        self.further[row, self.single] = springs.polynomial[:, self.massless]
        self.springs[at], self.polynomials[at] = self.stiffnesses[at], self.further[at]
        self.masses[row[..., None], chains.nodes] = masses[..., -2::-1]
        self.masses[row, chains.ends] = masses[..., -1]
        self._subtrees[at] = np.vecdot(self.masses[at][:, None], self.descendants)
        if self.ropes is not None:
            beyond = self.rest_lengths.copy()
            beyond[:, chains.cables] = chains.rest_lengths(self.bands)[..., 0]
            self.ropes, self._within = self.ropes.in_chain(beyond), self.rest_lengths - beyond

    def hold_ropes(self, at: Rows) -> None:
        """Springs that pull as cables with a memory do at their present lengths, as of MuJoCo's last positions."""
        if self.ropes is None:
            return
        which, row = self.with_memory, at[:, None]
        stiffness, free = self.ropes.tangent(self._lengths_in_chains())
        first = row, self.first[which]
        self.bands[(*first, 1)] = (free - self._within + self.entries)[row, which]
        self.stiffnesses[first] = self.springs[first] = stiffness[row, which]
        self.further[first] = self.polynomials[first] = 0.0

    def _lengths_in_chains(self) -> Float[np.ndarray, "rows cables"]:
        """Lengths for ``RopeStep.in_chain``: the first segments', and the rest lengths of the others [m]."""
        return self.ten_length[:, self.first] - self.entries + self._within

    def remembered(self) -> Memory:
        """The memory of the cables, which are at rest, without the time; of those with mass, that at their exits."""
        assert self.ropes is not None
        tensions = self.tensions(self.all)
        for cable in set(self.with_memory) & set(self.chains.cables):
            tensions[:, cable] = self._along(self.all, self.first[cable]) / self.robot.cabling.reeving[cable]
        return self.ropes.memory_after(self._lengths_in_chains(), tensions)

    def _weights(self) -> Float[np.ndarray, "rows chains"]:
        beyond = Law.of(self.robot.cabling).ropes(self.rest_lengths) - self.robot.wrapped_lengths
        return (self.robot.cable_weights * beyond)[:, self.chains.cables]

    def observe(self, at: Rows) -> Observation:
        """Poses, lengths and tensions of the present states, with their springs; the motion goes on undisturbed."""
        velocity = self.qvel[at].copy()
        self.qvel[at] = 0
        tensions = self.tensions(at)
        poses = self.xpos[at, self.platform], self.xmat[at, self.platform].reshape(-1, 3, 3)
        lengths = self.lengths(at)
        self.qvel[at] = velocity
        return Observation(*poses, lengths, tensions)

    def chords(self, at: Rows) -> Float[np.ndarray, "some chains"]:
        """Lengths of the massless paths from exit to anchor [m], as of MuJoCo's last call."""
        return self.ten_length[at][:, self.chains.chords] - self.chains.entries

    def lengths(self, at: Rows) -> Float[np.ndarray, "some cables"]:
        """Length of each cable [m]; for a cable with mass, its chord, over a wheel that faces the anchor."""
        aside = bool(self.chains.over.any())  # the wheels face the first masses
        if aside:
            self.turn_wheels(at, anchors=True)
        self.batch.forward(at, stage=POSITIONS)
        lengths = np.empty((len(at), self.robot.cables))
        lengths[:, self.chains.cables] = self.chords(at)
        lengths[:, self.massless] = self.ten_length[at][:, self.single] - self.entries[self.massless]
        if aside:
            self.turn_wheels(at)
        return lengths

    def free_lengths(self, at: Rows) -> Float[np.ndarray, "some chains segments"]:
        """Lengths of the segments that are free to turn [m]: at rest; of the first over a wheel, what is beyond it."""
        chains = self.chains
        lengths = chains.rest_lengths(self.bands[at])
        if chains.over.any():
            away = self.xpos[at][:, chains.first] - self._grooves[at][:, chains.grooves]
            squares = chains.radii[chains.over] ** 2
            free = np.maximum((away * away).sum(2) - squares, SHORTEST_FREE**2 * squares)
            lengths[:, chains.over, 0] = np.sqrt(free)
        return lengths

    def forces(self, at: Rows) -> tuple[Float[np.ndarray, "some free"], Float[np.ndarray, "some chains slides"]]:
        """Net force and torque over the characteristic length [N] on the platform, base frame; and on the slides.

        As of the last evaluation, or at the beginning of the last time step.
        """
        platform = in_base_frame(self.net[at, : self.free], self.rotations[at], self.length)
        return platform, self.net[at][:, self.slides]

    def in_dofs(self, at: Rows, x: Float[np.ndarray, "some free"]) -> Float[np.ndarray, "some dofs"]:
        """Translations and rotations of platforms, base frame [m], in MuJoCo's degrees of freedom; or velocities."""
        move = np.zeros((len(at), self.model.nv))
        move[:, : self.free] = x
        move[:, self.angular] /= self.length
        if self.free == 6:
            move[:, 3:6] = (move[:, None, 3:6] @ self.rotations[at])[:, 0]
        return move

    def displaced(
        self, qpos: Float[np.ndarray, "*#batch coordinates"], moves: Float[np.ndarray, "*#batch dofs"]
    ) -> Float[np.ndarray, "*batch coordinates"]:
        """Coordinates after ``moves``, while chains keep their directions in space where a platform rotates.

        Masses that rotate with it would move by the length of a chain over the platform's: too far for differences, and
        too far from where they are in balance.
        """
        turning = moves[..., 3:6] if self.free == 6 else moves[..., 2:3] * [0.0, 1.0, 0.0]
        rotations, (places, dofs) = matrices(turned(UPRIGHT, turning)), (self.chains.coordinates, self.chains.dofs)
        if self.free == 6:
            quaternions = qpos[..., 3:7]
            angles = (matrices(quaternions) @ turning[..., None])[..., 0]
            parts = qpos[..., :3] + moves[..., :3], turned(quaternions, angles), qpos[..., 7:] + moves[..., 6:]
            there = np.concatenate(parts, axis=-1)
        else:
            there = qpos + moves
        there[..., places] = qpos[..., places] @ rotations[..., None, :, :] + moves[..., dofs]
        return there

    def forces_at(
        self,
        at: Rows,
        qpos: Float[np.ndarray, "some places coordinates"],
        springs: tuple[Float[np.ndarray, "some ..."], ...],
    ) -> tuple[Float[np.ndarray, "some places free"], Float[np.ndarray, "some places chains slides"]]:
        """``forces`` at ``PLACES`` other coordinates, at zero velocity, with the wheels turned.

        Args:
            at: the rows.
            qpos: the coordinates.
            springs: the ``SPRINGS`` there.
        """
        batch, first, count = self.batch, len(self.all), len(at) * PLACES
        places = slice(first, first + count)
        for name, values in zip(SPRINGS, springs, strict=True):
            batch.expand(name)[places] = np.repeat(values, PLACES, axis=0)
        for name in OTHERS:
            field = batch.expand(name)
            field[places] = np.repeat(field[at], PLACES, axis=0)
        batch.state[places] = np.repeat(batch.state[at], PLACES, axis=0)
        batch.qpos[places] = qpos.reshape(count, -1)
        rows = np.arange(first, first + count)
        self._turn_wheels(batch.qpos, batch.expand("body_quat"), rows)
        batch.forward(rows, stage=self._stage)
        if self._stage == FORCES:
            net = batch.qfrc_smooth[places]
        else:
            net = batch.qfrc_passive[places] - batch.qfrc_bias[places]
        net = net.reshape(len(at), PLACES, -1)
        rotations = batch.xmat[places, self.platform].reshape(len(at), PLACES, 3, 3)
        return in_base_frame(net[..., : self.free], rotations, self.length), net[..., self.slides]

    def unbalanced(self, at: Rows) -> Float[np.ndarray, " some"]:
        """The largest unbalanced force [N], on the platform, on a mass, or on a wheel, as ``forces``."""
        platform, slides = self.forces(at)
        largest = np.abs(slides).max((1, 2), initial=0.0)
        if not self.held:
            largest = np.maximum(np.abs(platform).max(1), largest)
        if len(self.swivels.dofs):
            turning = np.abs(self.net[at][:, self.swivels.dofs] / self.swivels.radii)
            largest = np.maximum(largest, turning.max(1))
        return largest

    def hold(self) -> None:
        """Fix the platforms at their poses, whatever pulls them."""
        self.armature[:, : self.free] = IMMOVABLE
        self.held = True

    def residuals(self, at: Rows) -> Float[np.ndarray, " some"]:
        """``unbalanced`` at the present coordinates, at zero velocity and with the true springs."""
        self.stiffnesses[at], self.further[at] = self.springs[at], self.polynomials[at]
        self.qvel[at] = 0
        self.turn_wheels(at)
        if self.ropes is not None:
            self.batch.forward(at, stage=POSITIONS)
            self.hold_ropes(at)
        self.evaluate(at)
        return self.unbalanced(at)

    def evaluate(self, at: Rows) -> None:
        """MuJoCo's forces at the present state."""
        self.batch.forward(at, stage=self._stage)
        self._take_over(at)

    def step(self, at: Rows) -> None:
        """One time step of MuJoCo."""
        self.batch.step(at)
        self._take_over(at)

    def _take_over(self, at: Rows) -> None:
        """Keep MuJoCo's unbalanced generalised forces [N, N m] without damping: readings in between have others."""
        forces = self._smooth[at] if self._stage == FORCES else self._passive[at] - self._bias[at]
        self.net[at] = forces - self._damper[at]
        self.rotations[at] = self.xmat[at, self.platform].reshape(-1, 3, 3)

    def true(self, at: Rows) -> Bool[np.ndarray, " some"]:
        """Whether every spring has its true stiffness."""
        return np.asarray((self.stiffnesses[at] == self.springs[at]).all(1))

    def unstable(self, at: Rows) -> Bool[np.ndarray, " some"]:
        """Whether MuJoCo warned, or a velocity is not finite."""
        return self.batch.warning[at, :, 1].any(1) | ~np.isfinite(self.qvel[at]).all(1)

    def _platforms(
        self, qpos: Float[np.ndarray, "some coordinates"]
    ) -> tuple[Float[np.ndarray, "some 3"], Float[np.ndarray, "some 3 3"]]:
        """Positions and rotation matrices of platforms with these coordinates."""
        if self.free == 6:
            return qpos[:, :3], matrices(qpos[:, 3:7])
        x, z, beta = qpos[:, :3].T
        zero = np.zeros_like(x)
        quaternions = np.stack([np.cos(beta / 2), zero, np.sin(beta / 2), zero], axis=1)
        return np.stack([x, zero, z], axis=1), matrices(quaternions)

    def turn_wheels(self, at: Rows, *, anchors: bool = False) -> None:
        """Turn each wheel towards the first mass of its chain; of a massless cable, or of all, towards its anchor."""
        self._turn_wheels(self.qpos, self._quaternions, at, anchors=anchors)

    def _turn_wheels(
        self,
        all_qpos: Float[np.ndarray, "rows coordinates"],
        all_quaternions: Float[np.ndarray, "rows bodies 4"],
        at: Rows,
        *,
        anchors: bool = False,
    ) -> None:
        """``turn_wheels`` in these coordinates and orientations of bodies."""
        if not len(self.swivels):
            return
        swivels, model, chains, qpos = self.swivels, self.model, self.chains, all_qpos[at]
        seen = np.tile(model.site_pos[swivels.anchors], (len(at), 1, 1))
        if not anchors:
            chain = self._facing[swivels.cables]
            seen[:, chain >= 0] += qpos[:, chains.coordinates[chain[chain >= 0]]].sum(2)
        positions, rotations = self._platforms(qpos)
        away = positions[:, None] + seen @ rotations.swapaxes(1, 2) - model.body_pos[swivels.bodies]
        wheels = at[:, None], swivels.bodies
        turning = len(swivels.coordinates) > 0
        frames = self._frames if turning else matrices(all_quaternions[wheels])
        there = (away[:, :, None] @ frames)[:, :, 0]
        turns = np.arctan2(there[..., 1], there[..., 0])
        if turning:
            all_qpos[at[:, None], swivels.coordinates] = model.qpos0[swivels.coordinates] + turns
        else:
            all_quaternions[wheels] = pulleys.flipped(all_quaternions[wheels], turns)

    def off_wheel(self, at: Rows) -> Bool[np.ndarray, " some"]:
        """Whether a cable is off its wheel, as of MuJoCo's last call."""
        if not len(self.swivels):
            return np.zeros(len(at), dtype=bool)
        points = self._points[at][:, self.first[self.swivels.cables]]
        return np.any(self.swivels.off_wheel(self.xpos[at], self.xmat[at], self._sites[at], points), axis=1)

    def anchor_pulls(self, at: Rows) -> Float[np.ndarray, "some chains 3"]:
        """Pull of each chain on the platform [N], base frame: its last segment's, and the weight of the mass there."""
        chains = self.chains
        with self._only(at, chains.segments[:, -1]):
            rotations = self.xmat[at, self.platform].reshape(-1, 3, 3)
            pulled = self._spring[at][:, chains.dofs[:, 0]] @ rotations.swapaxes(1, 2)
        return self.masses[at][:, chains.ends, None] * self.model.opt.gravity - pulled

    def tensions(self, at: Rows) -> Float[np.ndarray, "some cables"]:
        """Tension of each cable [N], with the present springs; for a cable with mass, at the platform's end.

        For a massless cable, the force of its own spring along it.
        """
        tensions = np.empty((len(at), self.robot.cables))
        tensions[:, self.chains.cables] = np.linalg.norm(self.anchor_pulls(at), axis=2)
        for cable, tendon in zip(self.massless, self.single, strict=True):
            tensions[:, cable] = self._along(at, tendon)
        return self.robot.cabling.tensions(tensions)

    def _along(self, at: Rows, tendon: np.integer) -> Float[np.ndarray, " some"]:
        """MuJoCo's force of one tendon's spring along it [N]."""
        entries = slice(self.model.ten_J_rowadr[tendon], None)
        entries = slice(entries.start, entries.start + self.model.ten_J_rownnz[tendon])
        with self._only(at, tendon):
            row, force = self._jacobian[at, entries], self._spring[at][:, self.model.ten_J_colind[entries]]
        return -np.vecdot(row, force) / np.maximum(np.vecdot(row, row), np.finfo(float).tiny) + 0.0

    @contextmanager
    def _only(self, at: Rows, tendons: np.ndarray | np.integer) -> Iterator[None]:
        """MuJoCo's forces with only these springs, within the block."""
        springs, polynomials = self.stiffnesses[at], self.further[at]
        some = np.ones(self.model.ntendon, dtype=bool)
        some[tendons] = False
        self.stiffnesses[at], self.further[at] = np.where(some, 0, springs), np.where(some[:, None], 0, polynomials)
        self.batch.forward(at, stage=VELOCITIES)
        yield
        self.stiffnesses[at], self.further[at] = springs, polynomials

    def lay(self, at: Rows, pulls: Float[np.ndarray, "some chains 3"]) -> Bool[np.ndarray, "some chains"]:
        """Lay out chains as they hang between exit and anchor for these approximate pulls on the platform [N].

        Only chains for which that succeeds are changed; returns which they are.
        """
        chains, rows, model = self.chains, len(at), self.model
        bodies = np.concatenate([chains.nodes[:, ::-1], chains.ends[:, None]], axis=1)
        weights = self.masses[at][:, bodies, None] * model.opt.gravity
        stiffness, further = self.stiffnesses[at][:, chains.segments], self.further[at][:, chains.segments]

        def each(array: np.ndarray) -> np.ndarray:
            return array.reshape(-1, *array.shape[2:])

        with np.errstate(over="ignore", invalid="ignore"):  # of a simulation that becomes unstable
            extents, found = hang(
                each(weights),
                each(chains.rest_lengths(self.bands[at])),
                Springs(each(stiffness), each(further[..., 0]), each(further[..., 1])),
                np.tile(chains.radii, rows),
                np.tile(chains.axes, (rows, 1)),
                each(pulls),
                each(self.spans(at)),
            )
        found, rotations = found.reshape(rows, len(chains.cables)), self._platforms(self.qpos[at])[1]
        laid = extents.reshape(*found.shape, *extents.shape[1:]) @ rotations[:, None]
        coordinates = at[:, None, None, None], chains.coordinates
        self.qpos[coordinates] = np.where(found[:, :, None, None], laid, self.qpos[coordinates])
        return found

    def expected_pulls(self, at: Rows) -> Float[np.ndarray, "some chains 3"]:
        """``chains.expected_pulls``, as of MuJoCo's last call."""
        cables, weights = self.chains.cables, self.weights[at][..., None] * [0.0, 0.0, -1.0]
        strains = self.chords(at) / self.rest_lengths[at][:, cables] - 1
        stiffness = self.robot.cabling.pulls(self.axial_stiffness[at])[:, cables]
        return expected_pulls(self.spans(at), strains, stiffness, weights)

    def spans(self, at: Rows) -> Float[np.ndarray, "some chains 3"]:
        """Vectors from anchors to exits [m]."""
        positions, rotations = self._platforms(self.qpos[at])
        ends = positions[:, None] + self.model.body_pos[self.chains.ends] @ rotations.swapaxes(1, 2)
        return self.robot.exits[self.chains.cables] - ends

    def divide_at_bends(self, at: Rows) -> Int[np.ndarray, " bent"]:
        """Move the masses of chains with bends to where they bend; returns the rows that have any.

        MuJoCo's pull on the anchor gives the place of the bend: its horizontal component is the same along the whole
        chain, and its vertical component over the weight per length is the distance to the point where the chain is
        horizontal.
        """
        if self.given or not len(at):
            return at[:0]
        pulls = self.anchor_pulls(at) / self.weights[at][..., None]
        bends = np.hypot(pulls[..., 0], pulls[..., 1])
        bent = (bends < STRAIGHT).any(1)
        at, pulls, bends = at[bent], pulls[bent], bends[bent]
        qpos, weights = self.qpos[at].copy(), self.weights[at][..., None]
        for _ in range(2 if len(at) else 0):
            division = divisions(1 + pulls[..., 2], bends, ends_of(self.robot.cabling))
            for own, part in zip(self.division, division, strict=True):
                own[at] = part
            self._let_out(at)
            self.reset(at)
            self.qpos[at] = qpos
            bends[~self.lay(at, pulls * weights)] = STRAIGHT  # a folded chain stays as it is
        return at


def _inertia(robot: Robot) -> Float[np.ndarray, " free"]:
    """Mass [kg] and moments of inertia [kg m²] per free direction."""
    return np.concatenate([np.full(3, robot.mass), np.diag(robot.inertia)])[robot.free]


@functools.lru_cache(maxsize=16)
def _generated(robot: Robot) -> tuple[mujoco.MjModel, Chains, pulleys.Swivels, Float[np.ndarray, "bodies bodies"]]:
    """``_prepared`` of the generated model."""
    middle = RigidTransform.from_translation(robot.workspace.mean(0))
    weighing = 1.0 + SEGMENTS**2 * robot.cabling.pulley_radius  # enough for every wheel
    lengths = robot.cabling.least_lengths + robot.wrapped_lengths + weighing
    return _prepared(mujoco.MjModel.from_xml_string(to_mjcf(without_memory(robot), middle, lengths)), robot)


def _prepared(
    model: mujoco.MjModel, robot: Robot
) -> tuple[mujoco.MjModel, Chains, pulleys.Swivels, Float[np.ndarray, "bodies bodies"]]:
    """A copy of ``model``, which is never modified, with our own integrator and inertias; and its indices.

    With them, for each body, 1 for the bodies of its subtree and 0 for others.
    """
    model, swivels = copy.copy(model), pulleys.Swivels.of(model, robot.cabling)
    model.opt.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    model.opt.viscosity = model.opt.density = 0
    angular = slice(3, 6) if len(robot.free) == 6 else slice(2, 3)
    model.dof_armature[angular] = TURNING * _inertia(robot)[angular]
    model.dof_armature[swivels.dofs] = HELD * robot.mass * robot.characteristic_length**2
    descendants = np.eye(model.nbody)
    for body in range(model.nbody - 1, 0, -1):
        descendants[model.body_parentid[body]] += descendants[body]
    return model, Chains.of(model, robot.cabling), swivels, descendants

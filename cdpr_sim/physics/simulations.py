"""Platforms of one robot side by side in MuJoCo, on cables of any kind: states, forces, and divisions of chains.

All results are read out of MuJoCo; this module uses no formula of statics.
"""

# pyright: reportAttributeAccessIssue=false
# mujoco ships no type stubs for its compiled modules.
from __future__ import annotations

import copy
import functools
from collections.abc import Callable, Iterator, Sequence
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
from cdpr_sim.core.problem import OWN_AXES, Problems
from cdpr_sim.core.robot import Robot
from cdpr_sim.core.status import IDLE_STRAIN
from cdpr_sim.physics import pulleys
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
    least_lengths,
    profiles,
    straight,
)
from cdpr_sim.physics.exits import Slides
from cdpr_sim.physics.mjcf import coordinates_of, to_mjcf
from cdpr_sim.physics.quiet import quiet
from cdpr_sim.physics.rope_memory import Elements, RopeStep, add_elements
from cdpr_sim.physics.tendons import Jacobian

MASS_IN_UNITS = 2.0**30
"""The platform's mass, in the unit of mass of the model in MuJoCo. MuJoCo's discrete integrator ends each step's
iteration at an absolute tolerance: in kilograms, 3e-8 N no longer accelerate 1 kg, and the platform would stop before
equilibrium. A unit of a power of two kilograms rounds no number, so that the motion is the same."""

ARENA = 2**17
"""Bytes of working memory for MuJoCo; a model without contacts needs little of the default's 13 MB per thread."""

DISABLED = mujoco.mjtDisableBit

UNUSED = sum(flag.value for flag in (DISABLED.mjDSBL_CONTACT, DISABLED.mjDSBL_CONSTRAINT, DISABLED.mjDSBL_SENSOR))
"""Stages of MuJoCo that our models do not need: without them a forward pass takes a tenth less time."""

TURNING = 5.0
"""Inertia added to the rotation of a platform on chains, as a multiple of its own: a small platform rotates faster than
it swings, and only the swing has to be resolved."""

IMMOVABLE = 1e100
"""Inertia of a platform that is held fixed: no force moves it."""

HELD = 1e6
"""Inertia of a wheel about its axis, as a multiple of the platform's: MuJoCo does not rotate it between two updates.
At equilibrium its torque must vanish too: it is part of the residual."""

UPRIGHT = np.array([1.0, 0.0, 0.0, 0.0])
"""Quaternion w x y z without rotation."""

POSITIONS, VELOCITIES, FORCES = (
    stage.value for stage in (mujoco.mjtStage.mjSTAGE_POS, mujoco.mjtStage.mjSTAGE_VEL, mujoco.mjtStage.mjSTAGE_ACC)
)
"""Stages of MuJoCo's forward pass."""

SPRINGS = ("tendon_lengthspring", "tendon_stiffness", "tendon_stiffnesspoly")
OTHERS = ("body_mass", "body_subtreemass", "body_quat")
"""Fields of the model that rows have of their own, and on which forces at zero velocity depend."""

Rows = Int[np.ndarray, " some"]
"""Indices of some of the rows, ascending."""


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


class Simulations:
    """Platforms of one robot side by side.

    No row has an effect on another one. Methods take the rows ``at`` which they act; results are in their order.

    Where no cable has mass and the platforms settle, MuJoCo's own springs slide where cables have a memory, and its
    discrete integrator steps them, in a unit of mass of its own. Else springs are tangents of the memory's laws.

    Args:
        robot: the robot; all rows have its mass.
        rows: their number.
        model: the model to use instead of the generated one, with its own springs and masses.
        moves: for a motion that is not one to rest.
        threads: on which MuJoCo computes the rows; 0 for one per processor.
    """

    def __init__(
        self, robot: Robot, rows: int, *, model: mujoco.MjModel | None = None, moves: bool = False, threads: int = 1
    ) -> None:
        self.robot, self.all, self.given, self.held = robot, np.arange(rows), model is not None, False
        cabling = robot.cabling
        self.sinks = cabling.massless and not moves
        self.unit = unit_of(robot) if self.sinks else 1.0
        self.free, self.length = len(robot.free), robot.characteristic_length
        self.angular = slice(3, 6) if self.free == 6 else slice(2, 3)
        self.inertia = _inertia(robot)
        self.model, self.chains, self.swivels, self.descendants = (
            _generated(robot, self.sinks) if model is None else _prepared(model, robot, self.sinks)
        )
        self.frames, chains = Slides.of(self.model, robot.cables), self.chains
        self._gives_way = bool(self.frames)
        self.heavy = bool(len(chains.cables))
        # Behind all rows there are simulations at other places: for each row, as many as ``Derivatives`` needs, six
        # displacements of a spatial platform and three of the masses, or three of a planar platform and six of them;
        # without masses, those to both sides.
        self.places = 9 if self.heavy else 2 * self.free
        self.batch = Batch(self.model, rows * (1 + self.places), threads)
        self._name_fields()
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
        self.with_memory = np.flatnonzero(cabling.has_memory)
        self.elements = (
            Elements(self.batch, self.model, cabling, self.unit, rows) if self.sinks and len(self.with_memory) else None
        )
        self._own = [self.batch.state, *([] if self.elements is None else [self.elements.yields])]
        if self.heavy or len(self.swivels):
            self._own += self._others
        self.net, self.rotations = np.zeros((rows, self.model.nv)), np.zeros((rows, 3, 3))

    def _name_fields(self) -> None:
        """MuJoCo's fields: those of the model that rows have of their own, states, and what MuJoCo computes."""
        batch, rows = self.batch, len(self.all)
        # Of all simulations, also those at other places.
        names = "qpos", "qvel", "qfrc_passive", "qfrc_bias", "qfrc_smooth", "qfrc_spring", "xmat"
        self._every = {name: batch.bind(name) for name in names}
        self._springs, self._others = ([batch.expand(name) for name in names] for names in (SPRINGS, OTHERS))

        self.bands, self.stiffnesses, self.further = (field[:rows] for field in self._springs)
        self.masses, self._subtrees, self._quaternions = (field[:rows] for field in self._others)
        self.damping, self.armature, timestep = (
            batch.expand(name)[:rows] for name in ("dof_damping", "dof_armature", "opt.timestep")
        )
        self.timestep = timestep.reshape(-1)
        self.qpos, self.qvel, self._passive, self._bias, self._smooth, self._pulls, self.xmat = (
            field[:rows] for field in self._every.values()
        )
        names = "xfrc_applied", "qfrc_damper", "ten_J", "ten_length", "xpos"
        self._loads, self._damper, self._jacobian, self.ten_length, self.xpos = (
            batch.bind(name)[:rows] for name in names
        )
        self._rates, self._frames = Jacobian(self.model), matrices(self.model.body_quat[self.swivels.bodies])
        if len(self.swivels):
            self._sites, self._points = batch.bind("site_xpos")[:rows], batch.bind("ten_wrapnum")[:rows]

    def start(self, problems: Problems, memory: tuple[Memory, float] | None = None) -> None:
        """Put the platforms at their poses, with zero velocity, and with the rest lengths and loads of their problems.

        Args:
            problems: (rows,) problems of one mass.
            memory: where cables have a memory, that before this step, (rows,), and the time since then [s]; default:
                that of new ropes. It is held (``rope_memory``).

        Raises:
            InvalidInput: a wrench on a model without a body ``origin``.
        """
        robot, cabling, rows = self.robot, self.robot.cabling, len(self.all)
        names, self.law = ("positions", "rotations", "rest_lengths", "external_wrench"), Law.of_rows(problems)
        *self._from, self.rest_lengths, self.wrenches = fields = [
            np.empty((rows, *getattr(problems, name).shape[-OWN_AXES[name] :])) for name in names
        ]
        for name, field in zip(names, fields, strict=True):
            field[:] = getattr(problems, name)
        if self.given and not self.heavy:
            self.rest_lengths = self.bands[:, self.first, 1] - self.entries
        if self.wrenches.any() and self.origin < 0:
            raise InvalidInput("model: found no body 'origin' in the platform, expected one to apply the wrench to")
        self.held, self.armature[:], self.damping[:] = False, self.model.dof_armature, self.model.dof_damping
        # Applied loads and actuators of a given model count only in the last of MuJoCo's stages.
        self._stage = FORCES if self.given or self.wrenches.any() else VELOCITIES
        self.weights, self.ropes = self._weights(), None
        if len(self.with_memory):
            self._before, duration = before, _ = memory or (Memory.fresh(robot, (rows,)), 0.0)
            self.ropes = RopeStep.of(cabling, self.law, self.rest_lengths, before, duration)
        if not self.given:
            if self.heavy:
                division = straight(ends_of(cabling))
                self.division = ChainDivision(*(np.tile(part, (rows, 1, 1)) for part in division))
            self._let_out(self.all)
        load = np.maximum(robot.weight, np.abs(self.wrenches / robot.units).max(1))
        if not load.all():  # the largest force of the cables on each other
            stiff = self.stiffnesses[:, self.first] * self.unit * self.rest_lengths
            load = np.where(load > 0, load, IDLE_STRAIN * stiff.mean(1))
        self.load = load
        self.size = self.rest_lengths.mean(1)
        self.swing = np.sqrt(self.load / robot.mass / self.size)
        self.restart(self.all)

    def _id(self, kind: mujoco.mjtObj, name: str) -> int:
        return mujoco.mj_name2id(self.model, kind.value, name)

    def restart(self, at: Rows) -> None:
        """Put the platforms at their initial poses, with zero velocity, and their chains in approximate profiles."""
        if not len(at):
            return
        self.reset(at)
        robot, chains = self.robot, self.chains
        positions, rotations = (part[at] for part in self._from)
        coordinates = coordinates_of(robot, positions, rotations)
        self.qpos[at, : coordinates.shape[1]] = coordinates
        if self.heavy:
            lengths = np.zeros((len(at), robot.cables))
            lengths[:, chains.cables] = chains.rest_lengths(self.bands[at]).sum(2)
            anchors = positions[:, None] + robot.anchors @ rotations.swapaxes(1, 2)
            self.qpos[at[:, None, None, None], chains.coordinates] = (
                profiles(robot, anchors, lengths) @ rotations[:, None]
            )
        self.follow(at)

    def reset(self, at: Rows) -> None:
        """Reset the motion and MuJoCo's warnings, and apply the loads again: MuJoCo removes them."""
        self.batch.reset(at, stage=mujoco.mjtStage.mjSTAGE_NONE.value)
        self.net[at] = 0
        if self.wrenches.any():
            self._loads[at, self.origin] = self.wrenches[at] / self.unit

    def _let_out(self, at: Rows) -> None:
        """Springs and masses for the present rest lengths and divisions.

        Of the constants that MuJoCo derives from masses, forces use only the sums of masses of subtrees, and only to
        choose points of reference.
        """
        chains, cabling, rest, row = self.chains, self.robot.cabling, self.rest_lengths[at], at[:, None]
        law = self.law.at(at)
        springs = law.springs(rest)
        self.bands[row, self.single, 1] = (rest + self.entries)[:, self.massless]
        self.stiffnesses[row, self.single] = springs.stiffness[:, self.massless] / self.unit
        if not cabling.linear:
            self.further[row, self.single] = springs.polynomial[:, self.massless] / self.unit
        if self.heavy:
            lengths, masses = cut(self.robot, rest, ChainDivision(*(part[at] for part in self.division)))
            springs, segments = law.some(chains.cables).segments(lengths), (row[..., None], chains.segments)
            self.stiffnesses[segments], self.further[segments] = springs.stiffness, springs.polynomial
            lengths[..., 0] += chains.entries
            self.bands[(*segments, 1)] = lengths
            self.masses[row[..., None], chains.nodes] = masses[..., -2::-1]
            self.masses[row, chains.ends] = masses[..., -1]
            self._subtrees[at] = np.vecdot(self.masses[at][:, None], self.descendants)
        if self.ropes is not None and not self.sinks:
            beyond = self.rest_lengths.copy()
            beyond[:, chains.cables] = chains.rest_lengths(self.bands)[..., 0]
            self.ropes, self._within = self.ropes.in_chain(beyond), self.rest_lengths - beyond

    def follow(self, at: Rows) -> None:
        """Turn the wheels, and hold cables with a memory where they are after a straight way to the present lengths.

        Exits that give way are then where their forces balance.
        """
        if self._gives_way:
            self._move_exits(at, self.size[at], lambda: self._follow(at))
        self._follow(at)

    def _follow(self, at: Rows) -> None:
        """``follow``, with exits that give way where they are."""
        self.turn_wheels(at)
        if self.ropes is not None:
            self.batch.forward(at, stage=POSITIONS)
            self._hold_ropes(at)

    def _hold_ropes(self, at: Rows) -> None:
        assert self.ropes is not None
        which, row = self.with_memory, at[:, None]
        if self.elements is not None:
            rows = np.zeros(len(self.all), dtype=bool)
            rows[at] = True
            springs, ends = self.elements.hold(self.ropes, rows, self.ten_length[:, self.first], self.entries)
            self.stiffnesses[row, self.first], self.bands[row, self.first, 1] = springs[at], ends[at]
            self.further[row, self.first] = 0.0
            return
        stiffness, free = self.ropes.tangent(self._lengths_in_chains())
        first = row, self.first[which]
        self.bands[(*first, 1)] = (free - self._within + self.entries)[row, which]
        self.stiffnesses[first], self.further[first] = stiffness[row, which], 0.0

    def tangents(self, at: Rows) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """``SPRINGS`` with the present forces and slopes; those of cables with a memory are tangents of its laws."""
        bands, stiffnesses, further = self.bands[at], self.stiffnesses[at], self.further[at]
        if self.elements is not None and self.ropes is not None:
            slopes, free = self.ropes.tangent(self.ten_length[:, self.first] - self.entries)
            stiffnesses[:, self.elements.of.ravel()] = 0.0
            stiffnesses[:, self.first] = slopes[at] / self.unit
            bands[:, self.first, 1] = (free + self.entries)[at]
        return bands, stiffnesses, further

    def _lengths_in_chains(self) -> Float[np.ndarray, "rows cables"]:
        """Lengths for ``RopeStep.in_chain``: the first segments', and the rest lengths of the others [m]."""
        return self.ten_length[:, self.first] - self.entries + self._within

    def remembered(self) -> Memory | None:
        """The memory of the cables, which are at rest, without the time; of those with mass, that at their exits."""
        if self.ropes is None:
            return None
        tensions = self.tensions(self.all)
        if self.sinks:
            return self.ropes.memory_after(self.ten_length[:, self.first] - self.entries, tensions)
        heavy = sorted(set(self.with_memory) & set(self.chains.cables))
        if heavy:
            pulls = self._along(self.all, [self.first[[cable]] for cable in heavy])
            tensions[:, heavy] = pulls / self.law.parts[heavy]
        return self.ropes.memory_after(self._lengths_in_chains(), tensions)

    def memory_of(self, row: int) -> Memory | None:
        """The memory of one row before this step, (1,)."""
        return None if self.ropes is None else self._before[row][None]

    def _weights(self) -> Float[np.ndarray, "rows chains"]:
        if not self.heavy:
            return np.zeros((len(self.all), 0))
        beyond = self.law.ropes(self.rest_lengths) - self.robot.wrapped_lengths
        return (self.robot.cable_weights * beyond)[:, self.chains.cables]

    def observe(self, at: Rows) -> Observation:
        """Poses, lengths and tensions of the present states, at zero velocity."""
        self.qvel[at] = 0
        lengths, tensions = self.lengths(at), self.tensions(at)
        return Observation(self.xpos[at, self.platform], self._turned(at), lengths, tensions)

    def _turned(self, at: Rows) -> Float[np.ndarray, "some 3 3"]:
        """Rotation matrices as of MuJoCo's last call."""
        return self.xmat[at, self.platform].reshape(-1, 3, 3)

    def chords(self, at: Rows) -> Float[np.ndarray, "some chains"]:
        """Lengths of the massless paths from exit to anchor [m], as of MuJoCo's last call."""
        return self.ten_length[at][:, self.chains.chords] - self.chains.entries

    def lengths(self, at: Rows) -> Float[np.ndarray, "some cables"]:
        """Length of each cable [m], as of MuJoCo's last call; for a cable with mass, its chord.

        That is over a wheel that faces the anchor.
        """
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

    def forces(self, at: Rows) -> tuple[Float[np.ndarray, "some free"], Float[np.ndarray, "some chains slides"]]:
        """Net force and torque over the characteristic length [N] on the platform, base frame; and on the slides.

        As of the last evaluation, or at the beginning of the last time step.
        """
        net = self.net[at]
        return in_base_frame(net[:, : self.free], self.rotations[at], self.length), net[:, self.slides]

    def pull(self, at: Rows) -> Float[np.ndarray, " some"]:
        """The sum of all tensions [N], as of MuJoCo's last call: it controls the motion, and is not a result."""
        cables = at[:, None], self.first
        stretch = np.maximum(self.ten_length[cables] - self.bands[(*cables, 1)], 0)
        return (self.stiffnesses[cables] * stretch).sum(1) * self.unit

    def in_dofs(self, at: Rows, x: Float[np.ndarray, "*some free"]) -> Float[np.ndarray, "*some dofs"]:
        """Translations and rotations of platforms, base frame [m], in MuJoCo's degrees of freedom; or velocities."""
        move = np.zeros((*x.shape[:-1], self.model.nv))
        move[..., : self.free] = x
        move[..., self.angular] /= self.length
        if self.free == 6:
            move[..., 3:6] = (move[..., None, 3:6] @ self.rotations[at].reshape(len(at), *[1] * (x.ndim - 2), 3, 3))[
                ..., 0, :
            ]
        return move

    def displaced(
        self, qpos: Float[np.ndarray, "*#batch coordinates"], moves: Float[np.ndarray, "*#batch dofs"]
    ) -> Float[np.ndarray, "*batch coordinates"]:
        """Coordinates after ``moves``, while chains keep their directions in space where a platform rotates.

        Masses that rotate with it would move by the length of a chain over the platform's: too far for differences, and
        too far from where they are in balance.
        """
        if self.free == 6:
            turning = moves[..., 3:6]
            quaternions = turned(qpos[..., 3:7], turning)
            parts = qpos[..., :3] + moves[..., :3], quaternions, qpos[..., 7:] + moves[..., 6:]
            there = np.concatenate(parts, axis=-1)
        else:
            turning, there = moves[..., 2:3] * [0.0, 1.0, 0.0], qpos + moves
        if self.heavy:
            rotations, (places, dofs) = matrices(turned(UPRIGHT, turning)), (self.chains.coordinates, self.chains.dofs)
            there[..., places] = qpos[..., places] @ rotations[..., None, :, :] + moves[..., dofs]
        return there

    def forces_at(
        self,
        at: Rows,
        qpos: Float[np.ndarray, "some places coordinates"],
        springs: tuple[Float[np.ndarray, "some ..."], ...],
    ) -> tuple[Float[np.ndarray, "some places free"], Float[np.ndarray, "some places chains slides"]]:
        """``forces`` at ``places`` other coordinates, at zero velocity, with the wheels turned.

        Args:
            at: the rows.
            qpos: the coordinates.
            springs: the ``SPRINGS`` there.
        """
        every, each = self._every, (len(at), qpos.shape[1])
        places = self._elsewhere(at, each[1], qpos, tuple(spring[:, None] for spring in springs))
        rows = np.arange(places.start, places.stop)

        def turn() -> None:
            self._turn_wheels(self._every["qpos"], self._others[-1], rows)

        if self._gives_way:
            self._move_exits(rows, np.repeat(self.size[at], each[1]), turn)
        turn()
        self.batch.forward(rows, stage=self._stage)
        if self._stage == FORCES:
            net = every["qfrc_smooth"][places]
        else:
            net = every["qfrc_passive"][places] - every["qfrc_bias"][places]
        net = net.reshape(*each, -1) * self.unit
        rotations = every["xmat"][places, self.platform].reshape(*each, 3, 3)
        return in_base_frame(net[..., : self.free], rotations, self.length), net[..., self.slides]

    def unbalanced(self, at: Rows) -> Float[np.ndarray, " some"]:
        """The largest unbalanced force [N], on the platform, on a mass, or on a wheel, as ``forces``."""
        platform, slides = self.forces(at)
        largest = np.zeros(len(at)) if self.held else np.abs(platform).max(1)
        if self.heavy:
            largest = np.maximum(np.abs(slides).max((1, 2)), largest)
        if len(self.swivels.dofs):
            turning = np.abs(self.net[at][:, self.swivels.dofs] / self.swivels.radii)
            largest = np.maximum(largest, turning.max(1))
        return largest

    def hold(self) -> None:
        """Fix the platforms at their poses, whatever pulls them."""
        self.armature[:, : self.free] = IMMOVABLE
        self.held = True

    def residuals(self, at: Rows) -> Float[np.ndarray, " some"]:
        """``unbalanced`` at the present coordinates, at zero velocity."""
        self.qvel[at] = 0
        self.follow(at)
        self.batch.forward(at, stage=self._stage)
        self.take_over(at)
        left = self.unbalanced(at)
        if self._gives_way:
            frames = np.abs(self._pulls[at][:, self.frames.dofs[self.frames.some]]).max(1)
            left = np.maximum(left, frames * self.unit)
        return left

    def _move_exits(self, rows: Rows, length: Float[np.ndarray, " some"], follow: Callable[[], None]) -> None:
        """Move exits that give way to where their forces balance, also of simulations behind the rows.

        ``follow`` lets wheels and springs follow; ``length`` is that of the cables [m].
        """

        def springs() -> Float[np.ndarray, "all dofs"]:
            follow()
            self.batch.forward(rows, stage=VELOCITIES)
            return self._every["qfrc_spring"]

        with np.errstate(over="ignore", invalid="ignore"):  # of a simulation that becomes unstable
            self.frames.settle(self._every["qpos"], rows, length, springs)
        self._every["qvel"][rows[:, None], self.frames.dofs[self.frames.some]] = 0

    def _exits(self, qpos: Float[np.ndarray, "some coordinates"]) -> Float[np.ndarray, "some cables 3"]:
        """Where exits are with these coordinates, base frame [m]."""
        return self.robot.exits + np.where(self.frames.some, qpos[:, self.frames.coordinates], 0.0)

    def take_over(self, at: Rows) -> None:
        """Keep MuJoCo's unbalanced generalised forces [N, N m] without damping: readings in between have others."""
        forces = self._smooth[at] if self._stage == FORCES else self._passive[at] - self._bias[at]
        self.net[at] = (forces - self._damper[at]) * self.unit
        self.rotations[at] = self._turned(at)

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
        if len(self.swivels.dofs):
            self.qvel[at[:, None], self.swivels.dofs] = 0
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
        away = positions[:, None] + seen @ rotations.swapaxes(1, 2) - self._exits(qpos)[:, swivels.cables]
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
        springs = self._alone(at, [chains.segments[:, -1]])[:, 0]
        pulled = springs[:, chains.dofs[:, 0]] @ self._turned(at).swapaxes(1, 2)
        return self.masses[at][:, chains.ends, None] * self.model.opt.gravity - pulled

    def tensions(self, at: Rows) -> Float[np.ndarray, "some cables"]:
        """Tension of each rope [N], with the present springs; for a cable with mass, at the platform's end.

        For a massless cable, the force of its own springs along it. All parts of line share the pull.
        """
        tensions = np.empty((len(at), self.robot.cables))
        if self.heavy:
            tensions[:, self.chains.cables] = np.linalg.norm(self.anchor_pulls(at), axis=2)
        own = [np.array([tendon]) for tendon in self.single]
        if self.elements is not None:
            own = [np.append(one, more) for one, more in zip(own, self.elements.of, strict=True)]
        tensions[:, self.massless] = self._along(at, own)
        return self.robot.cabling.tensions(tensions)

    def _along(self, at: Rows, sets: Sequence[Int[np.ndarray, " n"]]) -> Float[np.ndarray, "some sets"]:
        """MuJoCo's force of the springs of each set of tendons with one path along it [N].

        qfrc_spring = -J' f, hence f = -(J . qfrc_spring) / (J . J). Where J vanishes, at an anchor on its exit, the
        spring's force vanishes too.
        """
        if self.heavy:  # wheels may have turned
            self.batch.forward(at, stage=POSITIONS)
        rates, springs = self._rates.of(self._jacobian[at]), self._alone(at, sets)
        if self._gives_way:
            rates[..., self.frames.dofs[self.frames.some]] = 0  # where the frame's springs act, too
        ways = np.ascontiguousarray(rates[:, [tendons[0] for tendons in sets]])
        pulls = -(ways * springs).sum(2) / np.maximum((ways * ways).sum(2), np.finfo(float).tiny)
        return pulls * self.unit + 0.0  # no negative zero

    def _alone(self, at: Rows, sets: Sequence[Int[np.ndarray, " n"]]) -> Float[np.ndarray, "some sets dofs"]:
        """MuJoCo's forces of springs on the coordinates with only the springs of one of the sets of tendons."""
        found = np.empty((len(at), len(sets), self.model.nv))
        springs = self.bands[at], self.stiffnesses[at], self.further[at]
        for first in range(0, len(sets), self.places):
            some = sets[first : first + self.places]
            only = np.zeros((len(some), self.model.ntendon), dtype=bool)
            for k, tendons_of in enumerate(some):
                only[k, tendons_of] = True
            alone = (
                springs[0][:, None],
                np.where(only, springs[1][:, None], 0),
                np.where(only[..., None], springs[2][:, None], 0),
            )
            places = self._elsewhere(at, len(some), self.qpos[at, None], alone)
            self.batch.forward(np.arange(places.start, places.stop), stage=VELOCITIES)
            found[:, first : first + len(some)] = self._every["qfrc_spring"][places].reshape(len(at), len(some), -1)
        return found

    def _elsewhere(
        self,
        at: Rows,
        count: int,
        qpos: Float[np.ndarray, "*some coordinates"],
        springs: tuple[Float[np.ndarray, "..."], ...],
    ) -> slice:
        """Simulations like those of the rows, ``count`` for each, at other coordinates and with other ``SPRINGS``."""
        first = len(self.all)
        places, each = slice(first, first + len(at) * count), (len(at), count)

        def write(field: np.ndarray, values: np.ndarray) -> None:
            field[places].reshape(*each, *field.shape[1:])[:] = values

        for field, values in zip(self._springs, springs, strict=True):
            write(field, values)
        for field in self._own:
            write(field, field[at, None])
        write(self._every["qpos"], qpos)
        return places

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
        stiffness = self.law.at(at).strained.stiffness[:, cables]
        return expected_pulls(self.spans(at), strains, stiffness, weights)

    def spans(self, at: Rows) -> Float[np.ndarray, "some chains 3"]:
        """Vectors from anchors to exits [m]."""
        positions, rotations = self._platforms(self.qpos[at])
        ends = positions[:, None] + self.model.body_pos[self.chains.ends] @ rotations.swapaxes(1, 2)
        return self._exits(self.qpos[at])[:, self.chains.cables] - ends

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
    """Orientations (w, x, y, z) after rotations by these vectors in their own frames [rad]."""
    half = angles / 2
    x, y, z = (half[..., i] for i in range(3))
    angle = np.sqrt(x * x + y * y + z * z)
    sine, cosine = np.sinc(angle / np.pi), np.cos(angle)
    x, y, z = x * sine, y * sine, z * sine
    a, b, c, d = (quaternions[..., i] for i in range(4))
    product = (
        a * cosine - b * x - c * y - d * z,
        a * x + b * cosine + c * z - d * y,
        a * y - b * z + c * cosine + d * x,
        a * z + b * y - c * x + d * cosine,
    )
    size = np.sqrt(sum(part * part for part in product))
    whole = np.empty((*size.shape, 4))
    for i, part in enumerate(product):
        whole[..., i] = part / size
    return whole


_idle: dict[tuple[Robot, int, int], Simulations] = {}
"""Cache of simulations by robot, rows and threads: building one takes as long as a settling."""

MOST_IDLE, MOST_ROWS = 16, 64
"""Largest number of simulations that are cached, and of their rows."""


@contextmanager
def simulations_of(
    problems: Problems,
    *,
    model: mujoco.MjModel | None = None,
    memory: tuple[Memory, float] | None = None,
    threads: int = 1,
) -> Iterator[Simulations]:
    """Simulations of ``problems``: for this caller only, with MuJoCo's warnings suppressed.

    Args:
        problems: (rows,) problems, of one mass.
        model: the model to use instead of the generated one, with its own springs.
        memory: as in ``Simulations.start``.
        threads: 0 for one per processor.

    Raises:
        InvalidInput: a mass per problem, since all rows have one model.
    """
    robot, rows = problems.robot, len(problems)
    if (problems.mass != robot.mass).any():
        raise InvalidInput("mass: found one per problem, expected the robot's own: MuJoCo has one model for all rows")
    reusable, key = model is None and rows <= MOST_ROWS, (robot, rows, threads)
    found = _idle.pop(key, None) if reusable else None  # removed, so that no other thread can use it
    with quiet():
        if found is None:
            found = Simulations(robot, rows, model=model, threads=threads)
        found.start(problems, memory)
        yield found
    if reusable:
        _idle[key] = found
        while len(_idle) > MOST_IDLE:
            _idle.pop(next(iter(_idle)), None)


Indices = tuple[mujoco.MjModel, Chains, pulleys.Swivels, Float[np.ndarray, "bodies bodies"]]
"""A model, and in it the chains, the wheels, and for each body 1 for the bodies of its subtree and 0 for others."""


@functools.lru_cache(maxsize=MOST_IDLE)
def _generated(robot: Robot, sinks: bool) -> Indices:
    """``_prepared`` of the generated model: each problem sets its own pose, lengths and stiffnesses."""
    middle = RigidTransform.from_translation(robot.workspace.mean(0))
    spec = mujoco.MjSpec.from_string(to_mjcf(without_memory(robot), middle, 1.0 + least_lengths(robot)))
    if sinks:
        add_elements(spec, robot.cabling)
        spec.memory = ARENA
        spec.option.disableflags |= UNUSED
    return _prepared(spec.compile(), robot, sinks)


def unit_of(robot: Robot) -> float:
    """Unit of mass [kg], and hence of force [N], of this robot's model in MuJoCo: a power of two."""
    return float(2.0 ** np.round(np.log2(robot.mass / MASS_IN_UNITS)))


def _prepared(model: mujoco.MjModel, robot: Robot, sinks: bool) -> Indices:
    """A copy of ``model``, which is never modified, with our own integrator and inertias; and its indices."""
    model, swivels, unit = copy.copy(model), pulleys.Swivels.of(model, robot.cabling), 1.0
    model.opt.viscosity = model.opt.density = 0
    if sinks:
        unit, model.opt.integrator = unit_of(robot), mujoco.mjtIntegrator.mjINT_DISCRETE
        masses, springs = (model.body_mass, model.body_inertia), (model.tendon_stiffness, model.tendon_stiffnesspoly)
        for quantity in (*masses, *springs, model.tendon_damping, model.jnt_stiffness):
            quantity /= unit
    else:
        model.opt.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
        angular = slice(3, 6) if len(robot.free) == 6 else slice(2, 3)
        model.dof_armature[angular] = TURNING * _inertia(robot)[angular]
        frames = Slides.of(model, robot.cables)
        dofs = frames.dofs[frames.some]
        model.dof_armature[dofs] = model.dof_M0[dofs] = IMMOVABLE  # by time steps; they move between them
    model.dof_armature[swivels.dofs] = HELD * robot.mass * robot.characteristic_length**2 / unit
    if sinks:
        mujoco.mj_setConst(model, mujoco.MjData(model))  # constants that MuJoCo computes from masses
    descendants = np.eye(model.nbody)
    for body in range(model.nbody - 1, 0, -1):
        descendants[model.body_parentid[body]] += descendants[body]
    return model, Chains.of(model, robot.cabling), swivels, descendants

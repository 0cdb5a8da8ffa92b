"""Platforms on cables that weigh something, one at a time in MuJoCo: how they come to rest, and what it says there.

What ``batch`` and ``relaxation`` are for massless cables. Those would shake a chain (``chains``), whose masses are
light and whose springs are stiff. Here each step is implicit in all that is stiff: a spring acts as it will at the
step's end, since a taut tendon is damped by as much as its spring gains in the step; and so does a taut string that is
plucked. The platform takes steps as long as its slowest swing allows. Near rest they become longer than any swing:
implicit in the whole stiffness, as MuJoCo shows it when everything is displaced a little.

A slack chain is a row of nearly rigid links, which a step cannot but stretch. While its shape is still wrong it is
therefore let stretch by a hundredth under its own weight; then it stiffens from step to step, up to what it is.
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
from jaxtyping import Bool, Float
from scipy.spatial.transform import RigidTransform, Rotation

from cdpr_sim.core.problem import Problems
from cdpr_sim.core.robot import STANDARD_GRAVITY, Robot
from cdpr_sim.core.status import NEUTRAL, Status
from cdpr_sim.physics import cables, pulleys
from cdpr_sim.physics.batch import HELD, quiet, refuse_own_masses
from cdpr_sim.physics.chains import STRAIGHT, Chains, divisions, plucked, straight
from cdpr_sim.physics.mjcf import place, to_mjcf
from cdpr_sim.physics.relaxation import ACCEPTABLE, ALONG, NUDGES, RESIDUAL, ROUNDING, SPEED

STEPS = 10_000
"""Time steps after which a platform is restless; with taut cables it needs twenty, with slack ones hundreds."""

LOOK = 5
"""Time steps between two looks at the residual."""

STEPS_AT_MOST, SHORTEST = (0.1, 0.03), 1e-4
"""Longest time steps, and the shortest, as fractions of the slowest swing's 1/omega. A platform that does not come to
rest with the first is let go again with the second."""

FIRST_DAMPING, LEAST_DAMPING, MOST_DAMPING = 1.5, 0.5, 1000.0
"""Damping ratio of the platform's slowest swing. Where it has to wander with chains that are just slack, steps stay
long and the platform is slowed down: what the chains cannot bear is its speed."""

BETTER, PATIENCE = 0.9, 5
"""A residual below this fraction of the best so far is progress; and after this many looks without it, the platform
rattles."""

PASSAGE = 0.2
"""By how much of its distance from being just taut a chain may come nearer to it in a step, or go away from it."""

NEAREST = 1e-9
"""That distance is never less than this fraction of the length."""

TURNING = 5.0
"""Inertia that is added to the platform's rotation, as a multiple of its own: a small platform turns faster than it
swings, and only the swing has to be followed."""

PLUCKED = 1.2
"""Of a segment's resistance to being plucked, how much is taken to be there; below 0.5 a step would overshoot."""

SOFT, GROWTH, STIFF = 100.0, 1.3, 1e100
"""A slack chain's axial stiffness at first, in its weight; by how much it grows in a step; and more than any is."""

CALM = 0.05
"""While more than this fraction of the load is unbalanced, or on a chain more than its weight, it does not stiffen."""

GENTLE, LEAST_PULL = 0.1, 1e-3
"""With less than this fraction of a chain's weight unbalanced, each segment resists being plucked by its own tension,
though by no less than this fraction of the chain's largest; before, all resist by the largest."""

CLOSE = 0.01
"""Of the load, and of each chain's weight, what is left unbalanced where a platform begins to ``approach`` its rest."""

APPROACHES, SHORTER = 400, 20
"""Its steps at most, of which a handful do; and how often one is halved at most."""

TRUSTED, CLOSER, TURN = 0.1, 0.5, 0.2
"""What a step may leave unbalanced, of the load or of what was; and by how much it may turn the platform [rad]."""

DIFFERENCE = 1e-7
"""Displacement for differencing forces, as a fraction of the mean cable length: smaller than in ``batch``, since
a chain's segments are short and hardly stretched."""


Frames = list[tuple[float, RigidTransform, np.ndarray, np.ndarray]]
"""(time, pose, lengths, tensions) at every step of a motion."""


@dataclass(frozen=True)
class Reading:
    """What MuJoCo says of one state at zero velocity."""

    pose: RigidTransform
    lengths: Float[np.ndarray, " cables"]
    tensions: Float[np.ndarray, " cables"]
    residual: float
    eigenvalues: Float[np.ndarray, " free"]
    softest: Float[np.ndarray, " free"]
    off_wheel: bool


class Hanging:
    """One platform on cables of which some are heavy.

    Args:
        robot: whose platform it is.
        rest_lengths: (cables,) [m].
        axial_stiffness: (cables,) [N].
        external_wrench: force and torque on the platform's origin, (6,) [N, N m].
        start: where the platform is at first.
        model: the model to use instead of the generated one, with the springs and masses that it has.
    """

    def __init__(
        self,
        robot: Robot,
        rest_lengths: Float[np.ndarray, " cables"],
        axial_stiffness: Float[np.ndarray, " cables"],
        external_wrench: Float[np.ndarray, "6"],
        start: RigidTransform,
        model: mujoco.MjModel | None = None,
    ) -> None:
        self.robot, self.rest_lengths = robot, rest_lengths
        cabling = robot.cabling
        self.model = copy.copy(_model_of(robot) if model is None else model)
        self.model.opt.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
        self.model.opt.viscosity = self.model.opt.density = 0
        self.data = mujoco.MjData(self.model)
        self.chains = Chains.of(self.model, cabling)
        self.massless = np.flatnonzero(cabling.linear_density == 0)
        self.single = np.array([self._id(mujoco.mjtObj.mjOBJ_TENDON, f"cable_{i + 1}") for i in self.massless], int)
        self.swivels = pulleys.Swivels.of(self.model, cabling)
        self.entries = pulleys.entries(cabling)
        self.axial_stiffness, self.given = axial_stiffness, model is not None
        if not self.given:
            self._let_out()
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
        self.let_go(start)
        if external_wrench.any():
            self.data.xfrc_applied[self._id(mujoco.mjtObj.mjOBJ_BODY, "origin")] = external_wrench

    def let_go(self, pose: RigidTransform) -> None:
        """Put the platform at ``pose``, with zero velocity."""
        self.reset()
        place(self.model, self.data, self.robot, pose)

    def reset(self) -> None:
        """Forget the motion, and not the load."""
        wrenches = self.data.xfrc_applied.copy()
        mujoco.mj_resetData(self.model, self.data)
        self.data.xfrc_applied[:] = wrenches

    def _id(self, kind: mujoco.mjtObj, name: str) -> int:
        return mujoco.mj_name2id(self.model, kind.value, name)

    def _let_out(self) -> None:
        model, cabling, rest, axial_stiffness = self.model, self.robot.cabling, self.rest_lengths, self.axial_stiffness
        self.chains.let_out(model, cabling, axial_stiffness, rest, straight())
        model.tendon_lengthspring[self.single, 1] = (rest + self.entries)[self.massless]
        model.tendon_stiffness[self.single] = cables.springs(axial_stiffness, rest)[self.massless]
        further = cables.polynomials(axial_stiffness, cabling.stiffening, rest)
        model.tendon_stiffnesspoly[self.single] = further[self.massless]

    def _compile(self) -> None:
        """What follows from springs and masses."""
        mujoco.mj_setConst(self.model, self.data)
        self.springs = self.model.tendon_stiffness.copy()
        self.reset()

    @property
    def pose(self) -> RigidTransform:
        """The platform's, as of MuJoCo's last call."""
        data = self.data
        return RigidTransform.from_components(
            data.xpos[self.platform].copy(), Rotation.from_quat(data.xquat[self.platform], scalar_first=True)
        )

    @property
    def chords(self) -> Float[np.ndarray, " chains"]:
        """From exit to anchor [m]."""
        return self.data.ten_length[self.chains.chords]

    @property
    def lengths(self) -> Float[np.ndarray, " cables"]:
        """Of each cable [m]; of a heavy one the chord."""
        lengths = np.empty(self.robot.cables)
        lengths[self.chains.cables] = self.chords
        lengths[self.massless] = (self.data.ten_length[self.single]) - self.entries[self.massless]
        return lengths

    def forces(self) -> tuple[Float[np.ndarray, " free"], Float[np.ndarray, "chains slides"]]:
        """Net force and torque over the characteristic length [N] on the platform, base frame; and on the slides."""
        net = self.data.qfrc_smooth - self.data.qfrc_damper
        platform = net[: self.free].copy()
        if self.free == 6:
            platform[3:] = self.data.xmat[self.platform].reshape(3, 3) @ platform[3:]
        platform[self.angular] /= self.length
        return platform, net[self.chains.dofs.reshape(len(self.chains.dofs), -1)]

    def unbalanced(self) -> float:
        """The largest force [N] left over, on the platform, on a mass, or turning a wheel, as of MuJoCo's last call."""
        platform, slides = self.forces()
        largest = np.abs(slides).max() if self.held else max(np.abs(platform).max(), np.abs(slides).max())
        if len(self.swivels.dofs):
            net = self.data.qfrc_smooth - self.data.qfrc_damper
            largest = max(largest, np.abs(net[self.swivels.dofs] / self.swivels.radii).max())
        return float(largest)

    def hold(self) -> None:
        """Let the platform move no more, whatever pulls it."""
        self.model.dof_armature[: self.free] = STIFF
        self.held = True

    def residual(self) -> float:
        """``unbalanced`` at the present coordinates, at zero velocity and with the true springs."""
        self.model.tendon_stiffness[:] = self.springs
        self.data.qvel[:] = 0
        self.turn_wheels()
        mujoco.mj_forward(self.model, self.data)
        return self.unbalanced()

    def turn_wheels(self) -> None:
        """Turn each wheel towards its anchor."""
        if len(self.swivels):
            pulleys.toward_anchors(self.model, self.data, self.robot)

    def divide_at_bends(self) -> bool:
        """Move the masses of chains that bend to where they do; whether there are any.

        Where it does, MuJoCo's pull on the anchor says: its horizontal part is the same all along the chain, and its
        vertical part over the weight per length is how far it is to where the chain lies level.
        """
        model, data, chains = self.model, self.data, self.chains
        weights = (self.robot.cabling.linear_density * self.robot.gravity * self.rest_lengths)[chains.cables, None]
        pulls = self.anchor_pulls() / weights
        bends = np.hypot(pulls[:, 0], pulls[:, 1])
        if self.given or not (bends < STRAIGHT).any():
            return False
        qpos = data.qpos.copy()
        for _ in range(2):
            division = divisions(1 + pulls[:, 2], bends)
            chains.let_out(model, self.robot.cabling, self.axial_stiffness, self.rest_lengths, division)
            self._compile()
            data.qpos[:] = qpos
            bends[~self.lay(pulls * weights)] = STRAIGHT  # one that hangs folded stays as it is
        return True

    def anchor_pulls(self) -> Float[np.ndarray, "chains 3"]:
        """What each chain pulls the platform by [N], base frame: its last segment, and the weight of the mass there."""
        with self._only(self.chains.segments[:, -1]):
            pulled = self.data.qfrc_spring[self.chains.dofs[:, 0]] @ self.data.xmat[self.platform].reshape(3, 3).T
        return self.model.body_mass[self.chains.ends, None] * self.model.opt.gravity - pulled

    def tensions(self) -> Float[np.ndarray, " cables"]:
        """Of each cable [N], with the springs that there are; of a heavy one at the platform's end.

        Of a massless cable, its own spring's force, along it.
        """
        model, data = self.model, self.data
        tensions = np.empty(self.robot.cables)
        tensions[self.chains.cables] = np.linalg.norm(self.anchor_pulls(), axis=1)
        for cable, tendon in zip(self.massless, self.single, strict=True):
            first, entries = model.ten_J_rowadr[tendon], model.ten_J_rownnz[tendon]
            with self._only(tendon):
                row = data.ten_J[first : first + entries]
                force = data.qfrc_spring[model.ten_J_colind[first : first + entries]]
                tensions[cable] = -(row @ force) / max(row @ row, np.finfo(float).tiny) + 0.0
        return tensions

    @contextmanager
    def _only(self, tendons: np.ndarray | np.integer) -> Iterator[None]:
        """MuJoCo's forces with no other springs than these, within the block."""
        model, data = self.model, self.data
        springs, polynomials = model.tendon_stiffness.copy(), model.tendon_stiffnesspoly.copy()
        model.tendon_stiffness[:] = model.tendon_stiffnesspoly[:] = 0
        model.tendon_stiffness[tendons] = springs[tendons]
        model.tendon_stiffnesspoly[tendons] = polynomials[tendons]
        mujoco.mj_fwdPosition(model, data)
        mujoco.mj_fwdVelocity(model, data)
        yield
        model.tendon_stiffness[:], model.tendon_stiffnesspoly[:] = springs, polynomials

    def read(self) -> Reading:
        """The present state at zero velocity and with the true springs."""
        residual = self.residual()
        pose, lengths, off_wheel = self.pose, self.lengths, self.off_wheel()
        eigenvalues, softest = self._stiffness()
        return Reading(pose, lengths, self.tensions(), residual, eigenvalues, softest, off_wheel)

    def off_wheel(self) -> bool:
        """Whether a cable is off its wheel, as of MuJoCo's last call."""
        if not len(self.swivels):
            return False
        points = self.data.ten_wrapnum[self.single[np.isin(self.massless, self.swivels.cables)]]
        return bool(self.swivels.off_wheel(self.data.xpos, self.data.xmat, self.data.site_xpos, points).any())

    def approach(self, target: float) -> bool:
        """Move on to rest in time steps that are implicit in MuJoCo's own stiffness; whether that leads there.

        Such steps may be as long as one likes, and are Newton's then, where damping alone would let a softly held
        platform creep for ever. The chains are laid anew after each, and it is shortened while that leaves too much
        unbalanced. Where this does not lead to rest, all is left as it was.
        """
        data = self.data
        before, turn, last = (data.qpos.copy(), data.qvel.copy()), TURN, np.zeros_like(data.qvel[self.angular])
        for _ in range(APPROACHES):
            residual = self.residual()
            if residual <= target:
                return True
            step = self._implicit_step()
            if step is None:
                break
            back = step[self.angular] @ last < 0
            turn, last = turn / 2 if back else turn, step[self.angular]
            step = step / max(1.0, float(np.abs(last).max()) / turn)
            start, pulls = data.qpos.copy(), self.anchor_pulls()
            for shortened in range(SHORTER):
                data.qpos[:] = start
                mujoco.mj_integratePos(self.model, data.qpos, 0.5**shortened * step, 1)
                if self.residual() <= CLOSER * residual:
                    break
                self.lay(pulls)
                if self.residual() <= max(TRUSTED * self.load, CLOSER * residual):
                    break
        data.qpos[:], data.qvel[:] = before
        return False

    def lay(self, pulls: Float[np.ndarray, "chains 3"]) -> Bool[np.ndarray, " chains"]:
        """Lay chains where they would hang between exit and anchor, as they pull about so on the platform [N].

        Those for which that is found; which they are.
        """
        model, data, chains = self.model, self.data, self.chains
        mujoco.mj_kinematics(model, data)
        spans = self.spans()
        extents, found = chains.hung(model, pulls, spans)
        data.qpos[chains.coordinates[found]] = extents[found] @ data.xmat[self.platform].reshape(3, 3)
        return found

    def spans(self) -> Float[np.ndarray, "chains 3"]:
        """From anchors to exits [m], as of MuJoCo's last call."""
        return self.robot.exits[self.chains.cables] - self.data.xpos[self.chains.ends]

    def _implicit_step(self) -> Float[np.ndarray, " dofs"] | None:
        """To where forces would balance if they went on as they change here; None where they are not known.

        Along directions in which they repel the platform it goes as far the other way, which is away from a saddle.
        """
        direct, across, within = self._slopes()
        if not (np.isfinite(direct).all() and np.isfinite(within).all()):
            return None
        platform, slides = self.forces()
        loose = np.linalg.pinv(within)
        alone, follow = np.einsum("nij,nj->ni", loose, slides), loose @ across
        x = np.zeros(self.free)
        if not self.held:
            stiffness = direct - (np.swapaxes(across, 1, 2) @ follow).sum(0)
            values, vectors = np.linalg.eigh((stiffness + stiffness.T) / 2)
            if values[0] <= 0:
                stiffness = (vectors * np.maximum(np.abs(values), NEUTRAL * values[-1])) @ vectors.T
            x = np.linalg.solve(stiffness, platform - np.einsum("nif,ni->f", across, alone))
        step = self._move(x)
        step[self.chains.dofs.reshape(alone.shape)] = alone - follow @ x
        return step

    def _move(self, x: Float[np.ndarray, " free"]) -> Float[np.ndarray, " dofs"]:
        """The platform's translation and rotation, base frame [m], in MuJoCo's degrees of freedom."""
        move = np.zeros(self.model.nv)
        move[: self.free] = x
        move[self.angular] /= self.length
        if self.free == 6:
            move[3:6] = self.data.xmat[self.platform].reshape(3, 3).T @ move[3:6]
        return move

    def _stiffness(self) -> tuple[Float[np.ndarray, " free"], Float[np.ndarray, " free"]]:
        """Eigenvalues [N/m], ascending, of how the force on the platform gives way; and the softest direction.

        With the masses' degrees of freedom condensed out.
        """
        direct, across, within = self._slopes()
        if not (np.isfinite(direct).all() and np.isfinite(within).all()):
            return np.full(self.free, np.nan), np.full(self.free, np.nan)
        stiffness = direct - sum(
            a.T @ np.linalg.lstsq((k + k.T) / 2, a, rcond=None)[0] for a, k in zip(across, within, strict=True)
        )
        values, vectors = np.linalg.eigh((stiffness + stiffness.T) / 2)
        return values, vectors[:, 0]

    def _slopes(
        self,
    ) -> tuple[
        Float[np.ndarray, "free free"],
        Float[np.ndarray, "chains slides free"],
        Float[np.ndarray, "chains slides slides"],
    ]:
        """How forces fall: on the platform as it moves; on the slides, then; on the slides as they move.

        Central differences as in ``batch``. The slides of one chain do not feel another's, so that all chains are
        displaced together.
        """
        model, data = self.model, self.data
        band, springs, polynomials = (
            model.tendon_lengthspring.copy(), model.tendon_stiffness.copy(), model.tendon_stiffnesspoly.copy()
        )  # fmt: skip
        taut = self.data.ten_length > band[:, 1]
        model.tendon_lengthspring[:] = np.where(taut, band[:, 1], band[:, 0])[:, None]
        model.tendon_stiffness[~taut] = model.tendon_stiffnesspoly[~taut] = 0
        rest = data.qpos.copy()
        step = DIFFERENCE * float(self.rest_lengths.mean())
        slides = self.chains.dofs.reshape(len(self.chains.dofs), -1)

        def change(move: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            found = []
            for sign in (-1, 1):
                data.qpos[:] = rest
                mujoco.mj_integratePos(model, data.qpos, sign * move, 1)
                self.turn_wheels()
                mujoco.mj_forward(model, data)
                found.append(self.forces())
            return tuple((a - b) / (2 * step) for a, b in zip(*found, strict=True))  # type: ignore[return-value]

        direct = np.empty((self.free, self.free))
        across = np.empty((*slides.shape, self.free))
        within = np.empty((*slides.shape, slides.shape[1]))
        moves = [self._move(step * axis) for axis in np.eye(self.free)]
        for j, move in enumerate(moves):
            direct[:, j], across[:, :, j] = change(move)
        for j in range(slides.shape[1]):
            move = np.zeros(model.nv)
            move[slides[:, j]] = step
            _, within[:, :, j] = change(move)
        data.qpos[:] = rest
        model.tendon_lengthspring[:], model.tendon_stiffness[:] = band, springs
        model.tendon_stiffnesspoly[:] = polynomials
        mujoco.mj_forward(model, data)
        return direct, across, within


class HangingRelaxation:
    """The motion of one platform towards rest.

    Args:
        hanging: the platform.
        frames: takes every step, if it is given.
        longest: time step, as a fraction of the slowest swing's 1/omega.
    """

    def __init__(self, hanging: Hanging, frames: Frames | None = None, longest: float = STEPS_AT_MOST[0]) -> None:
        self.hanging, self.frames, self.longest = hanging, frames, longest
        robot, rest = hanging.robot, hanging.rest_lengths
        self.swing = float(np.sqrt(hanging.load / robot.mass / rest.mean()))
        self.speed = SPEED * self.swing * float(rest.max())
        rounding = ROUNDING * float(hanging.springs[hanging.chains.segments].max()) * float(rest.max())
        self.target = min(max(RESIDUAL * hanging.load, rounding), ACCEPTABLE * hanging.load)
        chains, model = hanging.chains, hanging.model
        self.weights = robot.cabling.linear_density[chains.cables] * robot.gravity * rest[chains.cables]
        self.segment_lengths = model.tendon_lengthspring[chains.segments, 1]
        self.stiffness = hanging.springs[chains.segments] * self.segment_lengths
        mujoco.mj_fwdPosition(model, hanging.data)
        self.slack = (hanging.chords <= rest[chains.cables]) & (self.weights > 0)
        self.softness = np.where(self.slack, SOFT, STIFF)
        self.film = mujoco.MjData(model)
        self.steps, self.time, self.status = 0, 0.0, Status.ITERATION_LIMIT

    def again(self, longest: float) -> HangingRelaxation:
        """Another, from where the platform is now, in steps as long as that; time goes on."""
        other = HangingRelaxation(self.hanging, self.frames, longest)
        other.steps, other.time = self.steps, self.time
        return other

    def divide_at_bends(self) -> HangingRelaxation:
        """Come to rest with the chains divided where they bend: this relaxation, or one that has gone on."""
        if self.status is not Status.CONVERGED or not self.hanging.divide_at_bends():
            return self
        other = self.again(self.longest)
        other.softness[:] = STIFF  # their shape is right already
        if other._approach():
            other.status = Status.CONVERGED
        else:
            other.run()
        return other

    def run(self) -> None:
        """Move until the platform has come to rest or will not."""
        hanging, data = self.hanging, self.hanging.data
        self.step, self.calm, self.gentle, self.ratio = self.longest, True, False, FIRST_DAMPING
        self.velocity = np.zeros(hanging.free)
        self.pulls = np.zeros(len(self.slack))
        self._damp()
        best, patience, good, limit, close = np.inf, 0, data.qpos.copy(), self.steps + STEPS, CLOSE
        self.status = Status.ITERATION_LIMIT
        while self.steps < limit:
            for _ in range(LOOK):
                self._advance()
            hanging.turn_wheels()
            if data.warning.number.any() or not np.isfinite(data.qvel).all():
                if self.step < SHORTEST:
                    self.status = Status.DIVERGED
                    break
                self._restart(good)
                best, patience = np.inf, 0
                continue
            residual = hanging.unbalanced()
            self.calm = residual < CALM * hanging.load
            self.gentle = self.true and residual < GENTLE * self.weights.max()
            apart = self._apart() if self.true else np.inf
            if (residual <= self.target and self.true and self._at_rest()) or (apart <= close and self._approach()):
                self.status = Status.CONVERGED
                break
            close = min(close, 0.1 * apart) if apart <= close else close
            better, slow = residual < BETTER * best, self._slow()
            best, patience = (residual, 0) if better or slow else (best, patience + 1)
            if better:
                good = data.qpos.copy()
            if better or slow:
                self.step = min(1.2 * self.step, self.longest)
                self.ratio = max((0.9 if slow else 0.95) * self.ratio, LEAST_DAMPING)
            if patience > PATIENCE:
                if self.ratio == MOST_DAMPING:
                    self.step = max(0.6 * self.step, SHORTEST)
                self.ratio = min(3 * self.ratio, MOST_DAMPING)
                best, patience = residual, 0
            self._damp()
        if self.status is not Status.CONVERGED:
            data.qpos[:] = good

    def approach_from_afar(self) -> bool:
        """Whether the platform's ``approach`` leads to rest from here, with chains laid that pull by their weight."""
        hanging = self.hanging
        hanging.residual()
        spans = hanging.spans()
        hanging.lay(self.weights[:, None] * spans / np.linalg.norm(spans, axis=1, keepdims=True))
        if self._approach():
            self.status = Status.CONVERGED
        return self.status is Status.CONVERGED

    def _approach(self) -> bool:
        """Whether the platform's ``approach`` leads to rest, which then is the motion's next state."""
        rests = self.hanging.approach(self.target)
        if rests:
            self.steps, self.time = self.steps + 1, self.time + self.longest / self.swing
            if self.frames is not None:
                self._film(self.frames)
        return rests

    def _damp(self) -> None:
        """The platform, by the present ratio."""
        hanging = self.hanging
        hanging.model.dof_damping[: hanging.free] = 2 * self.ratio * self.swing * hanging.inertia

    def _slow(self) -> bool:
        """Whether force and velocity point the same way as before: damping alone holds the platform back."""
        hanging, data = self.hanging, self.hanging.data
        root = np.sqrt(hanging.inertia)
        force = (data.qfrc_smooth - data.qfrc_damper)[: hanging.free] / root
        velocity, before = data.qvel[: hanging.free] * root, self.velocity
        self.velocity = velocity

        def parallel(a: np.ndarray, b: np.ndarray) -> bool:
            return bool(a @ b > ALONG * np.sqrt(a @ a * (b @ b)))

        return parallel(force, velocity) and parallel(velocity, before)

    def _time_step(self) -> float:
        """[s], short enough for chains that pass from slack to taut or back, and for segments that turn.

        As a chain becomes taut its tension rises from its weight to EA within a strain of (weight/EA)^(2/3). A segment
        that turns by an angle in a step is stretched by half its square, which is to be no more than it is already.
        """
        hanging, data, chains = self.hanging, self.hanging.data, self.hanging.chains
        rest = hanging.rest_lengths[chains.cables]
        stiffness = np.minimum(self.stiffness[:, 0], np.where(self.slack, self.softness * self.weights, np.inf))
        near = np.maximum((self.weights / stiffness) ** (2 / 3), NEAREST) * rest
        passage = PASSAGE * np.maximum(np.abs(hanging.chords - rest), near) / np.abs(data.ten_velocity[chains.chords])
        strains = np.maximum(self.pulls, self.weights) / stiffness
        extending = np.concatenate([data.ten_velocity[chains.brakes][:, None], data.qvel[chains.dofs][:, ::-1]], axis=1)
        turning = np.sqrt(np.maximum((extending**2).sum(2) - data.ten_velocity[chains.segments] ** 2, 0))
        turns = np.sqrt(2 * np.maximum(strains, NEAREST**2))[:, None] * self.segment_lengths / turning
        return float(min(self.step / self.swing, np.nanmin(passage), np.nanmin(turns)))

    def nudge(self, direction: Float[np.ndarray, " free"]) -> None:
        """Set the platform going along the direction in which it is not held, as any breath of air would."""
        hanging = self.hanging
        hanging.data.qvel[:], self.softness[:] = 0, STIFF
        velocity = direction * (-1 if direction.sum() < 0 else 1) * 1e-3 * self.swing * hanging.rest_lengths.max()
        velocity[hanging.angular] /= hanging.length
        if hanging.free == 6:
            velocity[3:] = hanging.data.xmat[hanging.platform].reshape(3, 3).T @ velocity[3:]
        hanging.data.qvel[: hanging.free] = velocity

    @property
    def true(self) -> bool:
        """Whether every spring has its true stiffness."""
        return bool((self.hanging.model.tendon_stiffness == self.hanging.springs).all())

    def _advance(self) -> None:
        """One time step."""
        hanging, model, data = self.hanging, self.hanging.model, self.hanging.data
        chains = hanging.chains
        mujoco.mj_step1(model, data)
        with np.errstate(divide="ignore", invalid="ignore"):  # what stands still may take any step
            model.opt.timestep = step = self._time_step()
        soft = np.where(
            self.slack[:, None], np.minimum((self.softness * self.weights)[:, None], self.stiffness), self.stiffness
        )
        model.tendon_stiffness[chains.segments] = np.where(
            soft == self.stiffness, hanging.springs[chains.segments], soft / self.segment_lengths
        )
        _, left_over = hanging.forces()
        grows = self.calm & (np.abs(left_over).max(1) <= self.weights)
        self.softness = np.where(grows, np.minimum(GROWTH * self.softness, STIFF), self.softness)
        stretch = np.maximum(data.ten_length - model.tendon_lengthspring[:, 1], 0)[hanging.tendons]
        tangent = model.tendon_stiffness[hanging.tendons] + (
            stretch[:, None] ** [1, 2] * [2, 3] * model.tendon_stiffnesspoly[hanging.tendons]
        ).sum(1)
        model.tendon_damping[hanging.tendons] = np.where(stretch > 0, step * tangent, 0)
        pulls = (stretch[: chains.segments.size] * model.tendon_stiffness[chains.segments.ravel()]).reshape(soft.shape)
        self.pulls = pulls.max(1)
        largest = np.maximum(pulls.max(1), self.weights)[:, None]
        tension = np.maximum(pulls, LEAST_PULL * largest) if self.gentle else largest
        resisting = plucked(self.longest / self.swing, PLUCKED * tension, self.segment_lengths)
        model.dof_damping[chains.dofs] = resisting[:, :0:-1, None]
        model.tendon_damping[chains.brakes] = resisting[:, :1]
        mujoco.mj_passive(model, data)
        mujoco.mj_step2(model, data)
        self.steps, self.time = self.steps + 1, self.time + step
        if self.frames is not None:
            self._film(self.frames)

    def _film(self, frames: Frames) -> None:
        """The present state, looked at in a copy: looking changes nothing."""
        hanging, data = self.hanging, self.hanging.data
        self.film.qpos[:], self.film.qvel[:] = data.qpos, 0
        hanging.data = self.film
        tensions = hanging.tensions()
        frames.append((self.time, hanging.pose, hanging.lengths, tensions))
        hanging.data = data

    def _restart(self, qpos: np.ndarray) -> None:
        """From the last good coordinates, in shorter steps."""
        hanging = self.hanging
        hanging.reset()
        hanging.data.qpos[:] = qpos
        self.step *= 0.3
        self.softness = np.where(self.slack, SOFT, STIFF)

    def _at_rest(self) -> bool:
        """The forces are those of one time step ago, and velocity bends them: look again, at rest."""
        hanging, data = self.hanging, self.hanging.data
        speed = np.abs(data.qvel[: hanging.free])
        speed[hanging.angular] *= hanging.length
        velocity = data.qvel.copy()
        if speed.max() <= self.speed and hanging.residual() <= self.target:
            return True
        data.qvel[:] = velocity
        return False

    def _apart(self) -> float:
        """From rest: unbalanced forces, of the load and of each chain's weight."""
        platform, slides = self.hanging.forces()
        apart = (np.abs(slides) / self.weights[:, None]).max()
        return float(apart if self.hanging.held else max(apart, np.abs(platform).max() / self.hanging.load))


@functools.lru_cache(maxsize=16)
def _model_of(robot: Robot) -> mujoco.MjModel:
    """The compiled model of ``robot``, never written to."""
    middle = RigidTransform.from_translation(robot.workspace.mean(0))
    return mujoco.MjModel.from_xml_string(to_mjcf(robot, middle, np.ones(robot.cables)))


def released(
    problems: Problems,
    starts: RigidTransform,
    *,
    model: mujoco.MjModel | None = None,
    frames: Frames | None = None,
) -> tuple[list[Reading], list[int], list[Status]]:
    """Each of (rows,) problems, its platform let go at its start: the last state, time steps, and how it ended.

    Args:
        problems: what is asked.
        starts: a stack, one for each.
        model: the model to use instead of the generated one.
        frames: takes the first one's motion.

    Raises:
        InvalidInput: masses of their own, which one model cannot have.
    """
    readings, steps, status = [], [], []
    for row, hanging in enumerate(_rows(problems, starts, model)):
        relaxation = _relaxed(hanging, starts[row], frames if row == 0 else None)
        reading = hanging.read()
        for _ in range(NUDGES):
            values = reading.eigenvalues
            if relaxation.status is not Status.CONVERGED or not values[0] < -NEUTRAL * np.abs(values).max():
                break
            relaxation.nudge(reading.softest)
            relaxation.run()
            reading = hanging.read()
        readings.append(reading)
        steps.append(relaxation.steps)
        # A cable off its wheel is another robot's: whatever holds it there is not this one's equilibrium.
        status.append(Status.DIVERGED if reading.off_wheel else relaxation.status)
    return readings, steps, status


def _relaxed(hanging: Hanging, start: RigidTransform, frames: Frames | None) -> HangingRelaxation:
    """In long steps, or else by approach from the start, or else in shorter ones; then divided where chains bend."""
    relaxation = HangingRelaxation(hanging, frames, STEPS_AT_MOST[0])
    relaxation.run()
    if relaxation.status is not Status.CONVERGED:
        hanging.let_go(start)
        if relaxation.approach_from_afar():
            return relaxation.divide_at_bends()
        hanging.let_go(start)
        relaxation = relaxation.again(STEPS_AT_MOST[1])
        relaxation.run()
    return relaxation.divide_at_bends()


def unbalanced(
    problems: Problems, poses: RigidTransform, *, model: mujoco.MjModel | None = None
) -> Float[np.ndarray, " rows"]:
    """The largest force [N] on each platform held at its pose, with its chains at rest; nan where they do not rest."""
    found = []
    for hanging in _rows(problems, poses, model):
        hanging.hold()
        relaxation = HangingRelaxation(hanging)
        relaxation.run()
        rested = relaxation.divide_at_bends().status is Status.CONVERGED
        hanging.held = False
        found.append(hanging.unbalanced() if rested else np.nan)
    return np.array(found)


def _rows(problems: Problems, starts: RigidTransform, model: mujoco.MjModel | None) -> Iterator[Hanging]:
    robot, rows = problems.robot, len(problems)
    refuse_own_masses(problems)
    rest = np.broadcast_to(problems.rest_lengths, (rows, robot.cables))
    stiffness = np.broadcast_to(problems.axial_stiffness, (rows, robot.cables))
    wrenches = np.broadcast_to(problems.external_wrench, (rows, 6))
    with quiet():
        for row in range(rows):
            yield Hanging(robot, rest[row], stiffness[row], wrenches[row], starts[row], model)

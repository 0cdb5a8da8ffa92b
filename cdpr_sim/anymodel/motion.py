"""Way to the equilibrium by time steps: velocities become zero at each peak of kinetic energy (Cundall 1976).

Island by island: one that falls does not keep the others from coming to rest; it is held once it is far away. The
time step shrinks where the motion rattles, and grows up to half the smallest time constant of a contact: beyond,
``refsafe`` would soften the contacts, which is another equilibrium.
"""

# pyright: reportAttributeAccessIssue=false
# mujoco ships no type stubs for its compiled modules.
from __future__ import annotations

import copy
import time
from collections.abc import Callable
from dataclasses import dataclass

import mujoco
import numpy as np
from jaxtyping import Bool, Float, Int

from cdpr_sim.anymodel.balance import Balance, Unbalanced
from cdpr_sim.anymodel.forces import write_state
from cdpr_sim.anymodel.friction import LOADED, SLIDES
from cdpr_sim.anymodel.islands import coordinates_of, groups_of_trees

STEPS = 20_000
"""Time steps, at most, unless asked otherwise."""

CHECK = 100
"""Time steps between two evaluations of the balance."""

CHECK_STICKING = 20
"""The same once friction holds: it is then a force that each evaluation finds anew."""

READY = 3
"""Evaluations at which friction could hold an island that it loads, after which it does. MuJoCo's own friction creeps,
and a box that creeps on its corners does not come to rest."""

NEAR = 0.1
"""Residual of such an evaluation, at most: bodies that still fall are not held."""

PATIENCE = 15
"""And evaluations with loaded friction after which it is applied as a force in any case, within its limits."""

LONG = 30
"""Evaluations in a row without a residual of half the size, while friction holds, after which the motion stalls."""

BLOWS_UP = 1e12
"""[J/kg] Kinetic energy above which the motion has diverged."""

STALLS, TIME_SPENT, DIVERGES = "it does not get nearer", "time spent", "the simulation diverges at every time step"
"""Reasons for an end without rest; from the first, the motion may go on."""

FAR = 100.0
"""Distance, in sizes of the model, after which a body that still accelerates counts as falling."""

MANY_TURNS = 20
"""Turns of a hinge without a limit, after which it counts as turning for ever."""

RATTLES, QUICK = 6, 4
"""This many peaks, each within so many steps of the one before, are rattling."""

STILL = 1e-5
"""Residual of an island below which it is at rest, and its rattling does not count."""

SHRINKS, GROWS, CALM = 0.6, 1.3, 40
"""Factors of the time step; it grows where a peak came after more than ``CALM`` steps."""

QUIET = 200
"""Steps without rattling after which a time step shorter than the model's grows again."""

SHORT = 1 / 2
"""Shortest time step that rattling leads to, in time steps of the model: contacts may rattle at any."""

SHORTEST = 1 / 2000
"""And that divergence leads to."""

SLOW = 1000
"""Steps after which the model's damping, which only delays the rest, is switched off."""


@dataclass(frozen=True, eq=False)
class MotionEnd:
    """Where the time steps ended.

    Attributes:
        qpos: best pose.
        residual: of the degrees of freedom that were not held.
        steps: number of time steps.
        reason: why it stopped; empty at rest.
        falling: trees that moved away without end, and were held.
        sliding: trees among them that touched something.
        turning: joints that turned without end.
    """

    qpos: Float[np.ndarray, " nq"]
    residual: float
    steps: int
    reason: str
    falling: Bool[np.ndarray, " trees"]
    sliding: Bool[np.ndarray, " trees"]
    turning: tuple[int, ...]


class Motion:
    """Time steps of a model with kinetic damping, from a pose.

    Friction holds from the beginning if ``sticks``; otherwise once it could for some time.
    """

    def __init__(
        self, balance: Balance, qpos: Float[np.ndarray, " nq"], dofs: Int[np.ndarray, " n"], sticks: bool = False
    ) -> None:
        self.balance = balance
        self.model = model = copy.copy(balance.forces.model)
        if model.opt.integrator != mujoco.mjtIntegrator.mjINT_DISCRETE:
            model.opt.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
        self.data = mujoco.MjData(model)
        write_state(self.data, balance.forces.data)
        self.data.qpos[:] = qpos
        self.applied = self.data.qfrc_applied.copy()
        self.first = float(model.opt.timestep)
        references = np.concatenate([model.geom_solref, model.jnt_solref, model.eq_solref, model.tendon_solref_lim])
        positive = references[:, 0][references[:, 0] > 0]
        self.longest = max(self.first, min(5 * self.first, float(positive.min(initial=np.inf)) / 2))
        self.active = np.zeros(model.nv, dtype=bool)
        self.active[dofs] = True
        self.falling = np.zeros(model.ntree, dtype=bool)
        self.sliding, self.touched = np.zeros(model.ntree, dtype=bool), np.zeros(model.ntree, dtype=bool)
        self.turning: set[int] = set()
        self.trees = np.array(model.dof_treeid)
        self.still, self.alone = np.zeros(model.ntree, dtype=bool), np.zeros(model.ntree, dtype=bool)
        self.quiet = 0
        self.sticks = np.full(model.ntree, sticks)
        self.ready, self.loaded = np.zeros(model.ntree, dtype=int), np.zeros(model.ntree, dtype=int)
        mujoco.mj_forward(model, self.data)
        self.start_positions, self.start_qpos = self.data.xipos.copy(), self.data.qpos.copy()
        self.extent = max(float(model.stat.extent), 0.1)
        self.heaviest = max(1.0, float(model.body_mass.sum()))
        self._hold()
        self._regroup(anew=True)

    def run(
        self, *, tolerance: float, steps: int, deadline: float, report: Callable[[int], None] = lambda steps: None
    ) -> MotionEnd:
        """Move on until the forces balance, the motion stalls, or the steps or the time are spent."""
        model, data = self.model, self.data
        self.good = data.qpos.copy()
        best, best_residual, reason, count = data.qpos.copy(), np.inf, "time steps spent", 0
        momentum, damped, check, in_vain, half = np.zeros(model.nv), True, CHECK, 0, np.inf
        if self.sticks.any():
            self._residual()
        while count < steps:
            count += 1
            mujoco.mj_step(model, data)
            if len(self.held):
                data.qpos[self.held] = self.held_at
                data.qvel[~self.active] = 0
            mujoco.mj_mulM(model, data, momentum, data.qvel)
            kinetic = np.bincount(self.stops[self.trees], data.qvel * momentum, self.number)
            whole = float(kinetic.sum() + np.abs(data.qacc).sum())
            if not np.isfinite(whole) or kinetic.max(initial=0) > BLOWS_UP * self.heaviest:
                if model.opt.timestep / 4 < self.first * SHORTEST:
                    best = best if np.isfinite(best_residual) else self.good
                    return self._end(best, best_residual, count, DIVERGES)
                self._again()
                continue
            self._damp(kinetic)
            if damped and count > SLOW:
                damped = False
                model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_DAMPER)
                affine = model.actuator_biastype == mujoco.mjtBias.mjBIAS_AFFINE
                model.actuator_biasprm[affine, 2] = 0
            if count % check and count != steps:
                continue
            report(count)
            residual = self._residual()
            if residual < 1.2 * best_residual:
                best, best_residual = data.qpos.copy(), residual
            if residual <= tolerance:
                return self._end(best, best_residual, count, "")
            if time.monotonic() > deadline:
                reason = TIME_SPENT
                break
            in_vain += 1
            moves = ~(self.sticks | self.still)[self.trees[self.active]]
            if residual < half / 2 or moves.any():
                half, in_vain = min(residual, half), 0
            if in_vain > LONG:
                reason = STALLS
                break
            if self._gone():
                best, best_residual = data.qpos.copy(), np.inf
            if not self.active.any():
                reason = "nothing stays"
                break
            self._regroup()
            check = CHECK_STICKING if self.sticks.any() else CHECK
        return self._end(best, best_residual, count, reason)

    def _end(self, qpos: np.ndarray, residual: float, count: int, reason: str) -> MotionEnd:
        turning = tuple(sorted(self.turning))
        return MotionEnd(qpos, residual, count, reason, self.falling, self.sliding, turning)

    def _damp(self, kinetic: Float[np.ndarray, " islands"]) -> None:
        """Stop the islands whose kinetic energy is past its peak, and adapt the time step."""
        options, since = self.model.opt, self.since + 1
        self.quiet += 1
        if self.quiet >= QUIET and options.timestep < self.first:
            options.timestep, self.quiet = min(self.first, options.timestep * GROWS), 0
        peaks = kinetic < self.energy * (1 - 1e-12)
        self.energy = np.where(peaks, 0.0, kinetic)
        if peaks.any():
            self.data.qvel[peaks[self.stops[self.trees]]] = 0
            still = np.bincount(self.stops, ~self.still, self.number) == 0
            self.rattles = np.where(peaks, np.where((since <= QUICK) & ~still, self.rattles + 1, 0), self.rattles)
            self.alone |= (self.rattles >= RATTLES)[self.stops]
            if self.rattles.max() >= RATTLES and options.timestep > self.first * SHORT:
                options.timestep *= SHRINKS
                self.rattles[:], self.quiet = 0, 0
            elif since[peaks].min() > CALM:
                options.timestep = min(self.longest, options.timestep * GROWS)
            since[peaks] = 0
            self.good = self.data.qpos.copy()
        self.since = since

    def _again(self) -> None:
        """Go back to the last stop, with a shorter time step."""
        model, data = self.model, self.data
        model.opt.timestep /= 4
        self.quiet = 0
        mujoco.mj_resetData(model, data)
        write_state(data, self.balance.forces.data)
        data.qpos[:], data.qfrc_applied[:] = self.good, self.applied
        self._regroup(anew=True)

    def _residual(self) -> float:
        """The largest residual of an island; once friction holds, it is applied as a force."""
        forces = self.balance.forces
        net = forces.net(self.data.qpos)
        rows = self.balance.rows()
        used = np.unique(self.groups[self.active])
        parts = [np.flatnonzero(self.active & (self.groups == group)) for group in used]
        states = self.balance.evaluated(net, rows, parts)
        self.touched[:] = False
        for part, state in zip(parts, states, strict=True):
            self.touched[forces.model.dof_treeid[part]] = state.held.apart.shape[1] < len(part)
        for part, state in zip(parts, states, strict=True):
            self.still[self.trees[part]] = state.residual < STILL
        self.data.qfrc_applied[:] = self.applied
        for part, state in zip(parts, states, strict=True):
            self._stick(part, state)
        return max((state.residual for state in states), default=0.0)

    def _stick(self, part: Int[np.ndarray, " n"], state: Unbalanced) -> None:
        """Decide whether friction holds an island, never one that touches nothing; if so, it is applied as a force."""
        trees, share = self.trees[part], state.held.largest
        if not self.touched[trees].any():
            self.sticks[trees], self.ready[trees], self.loaded[trees] = False, 0, 0
        elif share > LOADED:
            one = np.unique(trees)
            self.loaded[one] += 1
            self.ready[one] = self.ready[one] + 1 if state.residual < NEAR and share < SLIDES else 0
            if self.ready[one].min() >= READY or self.loaded[one].min() >= PATIENCE:
                self.sticks[one] = True
        # Of what slides, it must take energy out of the motion; otherwise the friction is MuJoCo's alone.
        if self.sticks[trees].all() and (share < SLIDES or state.held.force @ self.data.qvel[part] <= 0):
            self.data.qfrc_applied[part] += state.held.force

    def _regroup(self, anew: bool = False) -> None:
        """Find the islands, and what stops together; with others than before, kinetic energies begin anew."""
        islands = groups_of_trees(self.model, self.data)
        self.groups = islands[self.trees]
        own = islands.max(initial=-1) + 1 + np.arange(self.model.ntree)
        stops = np.unique(np.where(self.alone, own, islands), return_inverse=True)[1]
        if anew or not np.array_equal(stops, self.stops):
            self.stops, self.number = stops, int(stops.max(initial=-1)) + 1
            self.energy = np.zeros(self.number)
            self.since, self.rattles = np.zeros(self.number, dtype=int), np.zeros(self.number, dtype=int)

    def _gone(self) -> bool:
        """Hold the islands of bodies that are far away and of joints that turn for ever; whether there are new ones."""
        model, data = self.model, self.data
        moved = data.xipos - self.start_positions
        away = np.linalg.norm(moved, axis=1) > FAR * self.extent
        gravity = model.opt.gravity / (np.linalg.norm(model.opt.gravity) or 1.0)
        touched = self.touched[np.maximum(model.body_treeid, 0)]
        along = np.where(touched | ~gravity.any(), -0.5, 0.5)  # what was thrown up or aside comes back
        away &= moved @ gravity >= along * np.linalg.norm(moved, axis=1)
        trees = np.unique(model.body_treeid[away & (model.body_treeid >= 0)])
        trees = trees[[bool(self.active[model.dof_treeid == tree].any()) for tree in trees]]
        hinges = (model.jnt_type == mujoco.mjtJoint.mjJNT_HINGE) & (model.jnt_limited == 0)
        turned = np.abs(data.qpos - self.start_qpos)[model.jnt_qposadr] > MANY_TURNS * 2 * np.pi
        turning = [int(joint) for joint in np.flatnonzero(hinges & turned) if self.active[model.jnt_dofadr[joint]]]
        self.turning |= set(turning)
        self.falling[trees] = True
        for tree in trees:
            self.sliding[tree] = self.touched[tree]
        stop = np.isin(model.dof_treeid, [*trees, *model.dof_treeid[model.jnt_dofadr[turning]]])
        stop = np.isin(self.groups, self.groups[stop]) & self.active
        self.active &= ~stop
        self._hold()
        return bool(stop.any())

    def _hold(self) -> None:
        """Hold the degrees of freedom that are not active where they are."""
        self.held = coordinates_of(self.model, np.flatnonzero(~self.active))
        self.held_at = self.data.qpos[self.held]
        self.data.qvel[~self.active] = 0

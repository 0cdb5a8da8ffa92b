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

from cdpr_sim.anymodel.balance import Balance
from cdpr_sim.anymodel.forces import write_state
from cdpr_sim.anymodel.islands import groups_of_trees

STEPS = 20_000
CHECK = 100
"""Time steps between two evaluations of the balance."""

FAR = 100.0
"""Distance, in sizes of the model, after which a body that still accelerates counts as falling."""

MANY_TURNS = 20
"""Turns of a hinge without a limit, after which it counts as turning for ever."""

RATTLES, QUICK = 6, 4
"""This many peaks, each within so many steps of the one before, are rattling."""

SHRINKS, GROWS, CALM = 0.6, 1.3, 40
"""Factors of the time step; it grows where a peak came after more than ``CALM`` steps."""

SHORTEST = 1 / 2000
"""Shortest time step, in time steps of the model."""

SLOW = 1000
"""Steps without a peak after which damping, which only delays the rest, is switched off."""


@dataclass(frozen=True, eq=False)
class MotionEnd:
    """Where the time steps ended.

    Attributes:
        qpos: best pose.
        residual: of the degrees of freedom that were not held.
        steps: number of time steps.
        reason: why it stopped; empty at rest.
        falling: trees that moved away without end, and were held.
        turning: joints that turned without end.
        diverged: whether it diverged at every time step.
    """

    qpos: Float[np.ndarray, " nq"]
    residual: float
    steps: int
    reason: str
    falling: Bool[np.ndarray, " trees"]
    turning: tuple[int, ...]
    diverged: bool


class Motion:
    """Time steps of a model with kinetic damping."""

    def __init__(self, balance: Balance, dofs: Int[np.ndarray, " n"]) -> None:
        self.balance, self.dofs = balance, dofs
        source = balance.forces.model
        self.model = model = copy.copy(source)
        if not model.nflex:
            model.opt.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
        self.data = mujoco.MjData(model)
        write_state(self.data, balance.forces.data)
        self.first = float(model.opt.timestep)
        references = np.concatenate([model.geom_solref, model.jnt_solref, model.eq_solref, model.tendon_solref_lim])
        positive = references[:, 0][references[:, 0] > 0]
        self.longest = max(self.first, min(5 * self.first, float(positive.min(initial=np.inf)) / 2))
        self.active = np.zeros(model.nv, dtype=bool)
        self.active[dofs] = True
        self.falling = np.zeros(model.ntree, dtype=bool)
        self.turning: set[int] = set()
        self.where: np.ndarray | None = None
        """Which coordinates of ``qpos`` are held, and the pose that holds them."""
        self.held_qpos = np.array(self.data.qpos)
        mujoco.mj_forward(model, self.data)
        self.start_positions = self.data.xipos.copy()
        self.start_qpos = self.data.qpos.copy()
        self.extent = max(float(model.stat.extent), 0.1)

    def run(
        self, *, tolerance: float, steps: int, deadline: float, report: Callable[[int], None] = lambda steps: None
    ) -> MotionEnd:
        """Move until the forces balance, or the steps or the time are spent."""
        model, data = self.model, self.data
        best, best_residual = data.qpos.copy(), np.inf
        good = data.qpos.copy()
        groups = self._groups()
        number = int(groups.max(initial=-1)) + 1
        energy, since, rattles = np.zeros(number), np.zeros(number, dtype=int), np.zeros(number, dtype=int)
        momentum = np.zeros(model.nv)
        reason, count, diverged = "time steps spent", 0, False
        self._hold(~self.active)
        damped = True
        for count in range(1, steps + 1):
            mujoco.mj_step(model, data)
            if self.where is not None:
                data.qpos[self.where] = self.held_qpos[self.where]
                data.qvel[~self.active] = 0
            mujoco.mj_mulM(model, data, momentum, data.qvel)
            kinetic = np.bincount(groups, data.qvel * momentum, number)
            if not np.isfinite(kinetic.sum() + np.abs(data.qacc).sum()) or kinetic.max(initial=0) > 1e12 * max(
                1.0, float(model.body_mass.sum())
            ):
                model.opt.timestep /= 4
                if model.opt.timestep < self.first * SHORTEST:
                    reason, diverged = "the simulation diverges at every time step", True
                    best = good if not np.isfinite(best_residual) else best
                    break
                mujoco.mj_resetData(model, data)
                write_state(data, self.balance.forces.data)
                data.qpos[:] = good
                energy[:], since[:], rattles[:] = 0, 0, 0
                continue
            since += 1
            peaks = kinetic < energy * (1 - 1e-12)
            if peaks.any():
                energy = np.where(peaks, 0.0, kinetic)
                data.qvel[peaks[groups]] = 0
                rattles = np.where(peaks, np.where(since <= QUICK, rattles + 1, 0), rattles)
                if rattles.max() >= RATTLES and model.opt.timestep > self.first * SHORTEST:
                    model.opt.timestep *= SHRINKS
                    rattles[:] = 0
                elif since[peaks].min() > CALM:
                    model.opt.timestep = min(self.longest, model.opt.timestep * GROWS)
                since = np.where(peaks, 0, since)
                good = data.qpos.copy()
            else:
                energy = kinetic
            if damped and since.max(initial=0) > SLOW:
                damped = False
                model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_DAMPER)
                affine = model.actuator_biastype == mujoco.mjtBias.mjBIAS_AFFINE
                model.actuator_biasprm[affine, 2] = 0
            if count % CHECK and count != steps:
                continue
            report(count)
            dofs = np.flatnonzero(self.active)
            state = self.balance.at(data.qpos, dofs)
            if state.residual < 1.2 * best_residual:
                best, best_residual = data.qpos.copy(), state.residual
            if state.residual <= tolerance:
                reason = ""
                break
            if time.monotonic() > deadline:
                reason = "time spent"
                break
            if self._gone():
                best, best_residual = data.qpos.copy(), np.inf
            if not self.active.any():
                break
            new = self._groups()
            if not np.array_equal(new, groups):
                groups, number = new, int(new.max(initial=-1)) + 1
                energy, since, rattles = np.zeros(number), np.zeros(number, dtype=int), np.zeros(number, dtype=int)
        return MotionEnd(best, best_residual, count, reason, self.falling, tuple(sorted(self.turning)), diverged)

    def _groups(self) -> Int[np.ndarray, " nv"]:
        """Number of the island of each degree of freedom, at present."""
        return groups_of_trees(self.model, self.data)[self.model.dof_treeid]

    def _gone(self) -> bool:
        """Hold trees that are far away, and islands of joints that turn for ever; whether there were any."""
        model, data = self.model, self.data
        away = np.abs(data.xipos - self.start_positions).max(axis=1) > FAR * self.extent
        away &= model.body_treeid >= 0
        trees = np.unique(model.body_treeid[away])
        trees = trees[~self.falling[trees]]
        hinges = (model.jnt_type == mujoco.mjtJoint.mjJNT_HINGE) & (model.jnt_limited == 0)
        turned = np.abs(data.qpos - self.start_qpos)[model.jnt_qposadr] > MANY_TURNS * 2 * np.pi
        turning = [int(joint) for joint in np.flatnonzero(hinges & turned) if self.active[model.jnt_dofadr[joint]]]
        if not len(trees) and not turning:
            return False
        self.turning |= set(turning)
        self.falling[trees] = True
        stop = self.falling[model.dof_treeid] & self.active
        for joint in turning:
            stop |= (model.dof_treeid == model.dof_treeid[model.jnt_dofadr[joint]]) & self.active
        self.active &= ~stop
        self._hold(~self.active)
        return True

    def _hold(self, dofs: Bool[np.ndarray, " nv"]) -> None:
        """Hold degrees of freedom where they are."""
        self.held_qpos = np.array(self.data.qpos)
        if dofs.any():
            self.where = coordinates_of(self.model, dofs)
            self.data.qvel[dofs] = 0


def coordinates_of(model: mujoco.MjModel, dofs: Bool[np.ndarray, " nv"]) -> Bool[np.ndarray, " nq"]:
    """Which coordinates of ``qpos`` belong to the joints of degrees of freedom."""
    where = np.zeros(model.nq, dtype=bool)
    ends = np.append(model.jnt_qposadr[1:], model.nq)
    for joint in np.unique(model.dof_jntid[dofs]):
        where[model.jnt_qposadr[joint] : ends[joint]] = True
    return where

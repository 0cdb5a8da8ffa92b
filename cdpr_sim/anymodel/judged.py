"""Judgement of a pose: balance, stability and motion island by island, contact forces, creep."""

# pyright: reportAttributeAccessIssue=false
# mujoco ships no type stubs for its compiled modules.
from __future__ import annotations

import time
from typing import Any

import mujoco
import numpy as np
from jaxtyping import Float, Int
from scipy.linalg import eigvals

from cdpr_sim.anymodel.balance import Balance, Unbalanced
from cdpr_sim.anymodel.forces import RestForces, write_state
from cdpr_sim.anymodel.islands import islands
from cdpr_sim.anymodel.model_equilibrium import ContactForce
from cdpr_sim.anymodel.motion import coordinates_of
from cdpr_sim.anymodel.names import name_of
from cdpr_sim.anymodel.stiffness import STEP, Modes, modes, stiffness_of_islands

LARGEST = 400
"""Degrees of freedom of an island above which the linearised motion is not judged."""

MOST_STEPS = 5000
"""Time steps of the measurement of creep, at most."""


class Judged:
    """The balance and the modes at a pose, island by island."""

    def __init__(self, balance: Balance, qpos: Float[np.ndarray, " nq"], dofs: Int[np.ndarray, " n"]) -> None:
        self.balance, self.qpos, self.dofs = balance, qpos, dofs
        forces = balance.forces
        net = forces.net(qpos)
        self.islands = islands(forces.model, forces.data, dofs)
        self.states: list[Unbalanced] = balance.evaluated(net, self.islands)
        self._modes: list[Modes] | None = None

    def rests(self, residual: float, of_load: float) -> bool:
        """Whether all forces balance, each island by its own scale."""
        return all(state.residual <= residual and state.of_load <= of_load for state in self.states)

    @property
    def residual(self) -> float:
        """The largest residual of an island."""
        return max((state.residual for state in self.states), default=0.0)

    @property
    def modes(self) -> list[Modes]:
        """Of each island."""
        if self._modes is None:
            forces = self.balance.forces
            matrices = stiffness_of_islands(forces, self.qpos, self.islands)
            every = zip(self.islands, self.states, matrices, strict=True)
            self._modes = [modes(forces, self.qpos, part, state.free, matrix) for part, state, matrix in every]
        return self._modes

    def spread(self, island: int, values: Float[np.ndarray, " n"]) -> Float[np.ndarray, " nv"]:
        """Values of an island's degrees of freedom among all."""
        full = np.zeros(self.balance.forces.model.nv)
        full[self.islands[island]] = values
        return full

    @property
    def eigenvalues(self) -> Float[np.ndarray, " free"]:
        """Of the stiffness of all islands, ascending [1/s²]."""
        return np.sort(np.concatenate([np.zeros(0), *(one.eigenvalues for one in self.modes)]))

    @property
    def neutral_directions(self) -> list[Float[np.ndarray, "..."]]:
        """Directions in which nothing resists."""
        return [
            self.spread(island, one.directions[:, column])
            for island, one in enumerate(self.modes)
            for column in np.flatnonzero(np.abs(one.eigenvalues) <= one.floor)
        ]

    @property
    def unstable_directions(self) -> list[Float[np.ndarray, "..."]]:
        """Directions in which the forces push away, the worst of each island."""
        return [
            self.spread(island, one.directions[:, 0])
            for island, one in enumerate(self.modes)
            if len(one.eigenvalues) and one.eigenvalues[0] < -one.floor
        ]

    @property
    def growth(self) -> float:
        """Largest real part of the eigenvalues of the linearised motion, neutral directions apart [1/s]."""
        rates = [
            growth(self.balance.forces, self.qpos, part, one)
            for part, one in zip(self.islands, self.modes, strict=True)
        ]
        return max(rates, default=0.0)


def growth(forces: RestForces, qpos: Float[np.ndarray, " nq"], dofs: Int[np.ndarray, " n"], found: Modes) -> float:
    """Largest real part of the eigenvalues of M a + C v + K x = 0 on the directions that are not neutral [1/s].

    M with the constraints' part, whose force depends on the acceleration. A real part that rounding explains is 0.
    """
    stiff = found.directions[:, np.abs(found.eigenvalues) > found.floor]
    if not stiff.shape[1]:
        return 0.0
    if len(dofs) > LARGEST:
        return float("nan")
    unit, zero = np.zeros(forces.model.nv), np.zeros(len(dofs))
    damping, inertia = np.empty((len(dofs), stiff.shape[1])), np.empty((len(dofs), stiff.shape[1]))
    for column in range(stiff.shape[1]):
        unit[dofs] = STEP * stiff[:, column]
        damping[:, column] = forces.net(qpos, -unit).force[dofs] - forces.net(qpos, unit).force[dofs]
        inertia[:, column] = forces.net(qpos, 0.0, -unit).force[dofs] - forces.net(qpos, 0.0, unit).force[dofs]
        unit[dofs] = zero
    mass = stiff.T @ found.mass @ stiff + stiff.T @ inertia / (2 * STEP)
    c, k = stiff.T @ damping / (2 * STEP), stiff.T @ found.stiffness @ stiff
    size = len(mass)
    solved = np.linalg.solve(mass, np.hstack([-k, -c]))
    roots = eigvals(np.vstack([np.hstack([np.zeros((size, size)), np.eye(size)]), solved]))
    rounding = 1e-6 * float(np.abs(roots).max())
    return float(max(roots.real.max(), 0.0)) if roots.real.max() > rounding else min(0.0, float(roots.real.max()))


def contact_forces(model: Any, data: Any, states: list[Unbalanced]) -> tuple[ContactForce, ...]:
    """The contacts that carry a force, after an evaluation of the forces."""
    found, six = [], np.zeros(6)
    for number in range(data.ncon):
        contact = data.contact[number]
        if contact.efc_address < 0:
            continue
        mujoco.mj_contactForce(model, data, number, six)
        if six[0] == 0:
            continue
        friction, share = float(np.linalg.norm(six[1:3])), 0.0
        for held in (state.held for state in states):
            for cone in np.flatnonzero((held.contacts == number) & (held.share > 0)):
                rows = held.rows[held.cones == cone]
                friction, share = float(np.linalg.norm(rows[:2])), float(held.share[cone])
        one, two = (name_of(model, "body", int(model.geom_bodyid[geom])) for geom in contact.geom)
        found.append(ContactForce((one, two), contact.pos.copy(), float(six[0]), friction, share))
    return tuple(found)


def creep_of(
    forces: RestForces, model: Any, qpos: np.ndarray, ignored: np.ndarray, seconds: float
) -> tuple[float, float]:
    """Largest speed of a coordinate after half a time and all of it, by the model's own time steps [m/s, rad/s].

    Args:
        forces: the forces, with activations, controls and all else that they depend on.
        model: the model with its own options, in which the bodies left out touch nothing.
        qpos: where it starts.
        ignored: degrees of freedom that are held, (nv,) bool.
        seconds: [s].

    Returns:
        Both speeds; nan where the time was spent.
    """
    data = mujoco.MjData(model)
    write_state(data, forces.data)
    data.qpos[:] = qpos
    where = coordinates_of(model, ignored)
    steps, speeds = int(np.clip(np.ceil(seconds / model.opt.timestep), 1, MOST_STEPS)), []
    for step in range(steps):
        mujoco.mj_step(model, data)
        if ignored.any():
            data.qpos[where] = qpos[where]
            data.qvel[ignored] = 0
        if time.monotonic() > forces.deadline:
            return float("nan"), float("nan")
        if step in (steps // 2, steps - 1):
            speed = float(np.abs(data.qvel).max(initial=0))
            speeds.append(speed if np.isfinite(speed) else float("inf"))
    return speeds[0], speeds[-1]

"""The fastest mode of a model, and the longest time step with which each integrator is stable.

Near a pose M a + C v + K q = 0. Euler's method and the implicit ones of MuJoCo compute q' = q + h v' and
(M + h D) (v' - v) / h = -K q - C v. D is what they treat implicitly: the damping of joints, or all of it. Their
stability ends where the motion flips its sign in each step, q' = -q and v' = -v: there 4 M s² + (4 D - 2 C) s - K is
singular, s = 1 / h. RK4 is stable where |1 + z + z²/2 + z³/6 + z⁴/24| <= 1, z being h times each eigenvalue of the
motion.
"""

# pyright: reportAttributeAccessIssue=false
# mujoco ships no type stubs for its compiled modules.
from __future__ import annotations

import copy
import math
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np
from jaxtyping import Float
from scipy.linalg import eig, eigh, null_space

from cdpr_sim.anymodel.constraints import jacobian
from cdpr_sim.anymodel.forces import RestForces, write_state
from cdpr_sim.anymodel.names import movers
from cdpr_sim.anymodel.stiffness import slopes, stiffness_of

MOST_DOFS = 300
"""Above this number of degrees of freedom the modes are not computed: the matrices are dense."""

SPEED = 1e-6
"""[m/s, rad/s] Of the differences that give the damping."""

REAL = 1e-3
"""A root counts as real if its imaginary part is smaller than this fraction; differences round equal roots apart."""

REHEARSED = 200
"""Time steps of a rehearsal."""

PUSH = 1e-7
"""[m, rad] Displacement that a rehearsal begins with."""

TOLERANCE = 1e-12
"""Of MuJoCo's solver in a rehearsal: below the displacement. With 0 the integrator ``discrete`` itself diverges."""

GROWN, CALM = 1e3, 10.0
"""Growth of that displacement by which a rehearsal is unstable, and up to which it is stable."""

INTEGRATORS = {
    int(mujoco.mjtIntegrator.mjINT_EULER): "Euler",
    int(mujoco.mjtIntegrator.mjINT_RK4): "RK4",
    int(mujoco.mjtIntegrator.mjINT_IMPLICIT): "implicit",
    int(mujoco.mjtIntegrator.mjINT_IMPLICITFAST): "implicitfast",
    int(mujoco.mjtIntegrator.mjINT_DISCRETE): "discrete",
}
"""MuJoCo's integrators by their names in MJCF."""

LIMIT_OF = {"Euler": "Euler", "implicit": "implicitfast", "implicitfast": "implicitfast", "RK4": "RK4"}
"""The limit that holds for each: at rest, both implicit ones are the same. None is known for ``discrete``."""


@dataclass(frozen=True)
class StableSteps:
    """The fastest mode at a pose, and the longest stable time steps.

    Attributes:
        fastest_period: of the fastest mode [s]; infinite if nothing oscillates.
        joints: those that move most in the mode that limits the time step of the model's integrator.
        longest: longest stable time step by integrator [s]: "Euler", "implicitfast" (and "implicit"), "RK4"; infinite
            if none is too long.
        direction: the mode that limits it, (nv,).
    """

    fastest_period: float
    joints: tuple[str, ...]
    longest: dict[str, float]
    direction: Float[np.ndarray, " nv"]


def stable_steps(model: Any, data: Any) -> StableSteps | None:
    """The fastest mode at the pose of ``data``, without contacts and limits; None of large or empty models."""
    if not 0 < model.nv <= MOST_DOFS:
        return None
    free = _free(model, data)
    if not free.shape[1]:
        return None
    alone = copy.copy(model)
    alone.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONSTRAINT)
    forces, qpos = RestForces(alone, data), np.array(data.qpos)
    (stiffness,) = stiffness_of(forces, qpos, [np.arange(model.nv)])
    damping = slopes(lambda step: forces.net(qpos, step).force, np.eye(model.nv), SPEED)
    forces.net(qpos)
    joints = np.zeros_like(damping)
    if not model.opt.disableflags & int(mujoco.mjtDisableBit.mjDSBL_EULERDAMP | mujoco.mjtDisableBit.mjDSBL_DAMPER):
        joints = np.diag(_joint_damping(model))
    mass, stiffness, damping, joints = (
        free.T @ (matrix + matrix.T) @ free / 2 for matrix in (forces.mass(), stiffness, damping, joints)
    )
    squares = np.asarray(eigh(stiffness, mass, eigvals_only=True))
    limits = {
        "Euler": _flips(mass, damping, joints, stiffness),
        "implicitfast": _flips(mass, damping, damping, stiffness),
        "RK4": _runge_kutta(mass, damping, stiffness),
    }
    direction = free @ limits[LIMIT_OF.get(INTEGRATORS[int(model.opt.integrator)], "Euler")][1]
    period = 2 * math.pi / math.sqrt(squares[-1]) if squares[-1] > 0 else math.inf
    longest = {integrator: step for integrator, (step, _) in limits.items()}
    return StableSteps(period, movers(model, direction), longest, direction)


def _free(model: Any, data: Any) -> Float[np.ndarray, "nv free"]:
    """Directions that equality constraints leave."""
    there = mujoco.MjData(model)
    write_state(there, data)
    mujoco.mj_fwdPosition(model, there)
    rows = jacobian(model, there)[there.efc_type == mujoco.mjtConstraint.mjCNSTR_EQUALITY]
    return null_space(rows, rcond=1e-9) if len(rows) else np.eye(model.nv)


def _joint_damping(model: Any) -> Float[np.ndarray, " nv"]:
    damping = np.array(model.dof_damping)
    on_joints = (model.actuator_trntype == mujoco.mjtTrn.mjTRN_JOINT) & (model.actuator_damping != 0)
    for actuator in np.flatnonzero(on_joints):
        gear = float(model.actuator_gear[model.actuator_outadr[actuator], 0])
        damping[model.jnt_dofadr[model.actuator_trnid[actuator, 0]]] += (
            float(model.actuator_damping[actuator]) * gear**2
        )
    return damping


def _flips(
    mass: Float[np.ndarray, "n n"],
    damping: Float[np.ndarray, "n n"],
    implicit: Float[np.ndarray, "n n"],
    stiffness: Float[np.ndarray, "n n"],
) -> tuple[float, Float[np.ndarray, " n"]]:
    """The shortest time step with which a motion flips its sign, and the motion."""
    n = len(mass)
    zero, one = np.zeros((n, n)), np.eye(n)
    roots, vectors = _eig(
        np.block([[zero, one], [stiffness / 4, damping / 2 - implicit]]), np.block([[one, zero], [zero, mass]])
    )
    real = np.where((np.abs(roots.imag) <= REAL * np.abs(roots)) & np.isfinite(roots), roots.real, 0.0)
    last = int(np.argmax(real))
    return (1 / float(real[last]) if real[last] > 0 else math.inf), vectors[:n, last].real


def _runge_kutta(
    mass: Float[np.ndarray, "n n"], damping: Float[np.ndarray, "n n"], stiffness: Float[np.ndarray, "n n"]
) -> tuple[float, Float[np.ndarray, " n"]]:
    """The shortest time step with which a decaying motion grows in RK4, and the motion."""
    n = len(mass)
    rates, vectors = _eig(
        np.block([[np.zeros((n, n)), np.eye(n)], [-np.linalg.solve(mass, stiffness), -np.linalg.solve(mass, damping)]])
    )
    size = np.abs(rates)
    decays = (rates.real <= 1e-9 * size.max()) & (size > 0)
    if not decays.any():
        return math.inf, vectors[:n, 0].real
    radii = np.linspace(0.0, 3.0, 3001)[1:]
    z = radii[:, None] * np.where(decays, rates, -1.0) / np.where(decays, size, 1.0)
    grows = np.abs(1 + z * (1 + z / 2 * (1 + z / 3 * (1 + z / 4)))) > 1 + 1e-9
    steps = np.where(decays, radii[np.argmax(grows, axis=0)] / np.where(decays, size, 1.0), math.inf)
    last = int(np.argmin(steps))
    return float(steps[last]), vectors[:n, last].real


def _eig(matrix: np.ndarray, metric: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray]:
    found: Any = eig(matrix, metric)
    return found


def growth(model: Any, data: Any, time_step: float, direction: Float[np.ndarray, " nv"]) -> float:
    """By how much a small displacement along a direction grows in ``mj_step``, against the motion without it."""
    there = copy.copy(model)
    there.opt.timestep, there.opt.tolerance = time_step, min(TOLERANCE, there.opt.tolerance)
    there.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_AUTORESET | mujoco.mjtDisableBit.mjDSBL_SENSOR)
    there.opt.enableflags &= ~int(mujoco.mjtEnableBit.mjENBL_SLEEP)
    one, two = copy.copy(data), copy.copy(data)
    mujoco.mj_integratePos(there, two.qpos, PUSH * direction / np.abs(direction).max(), 1)
    apart, most = np.zeros(model.nv), 0.0
    for _ in range(REHEARSED):
        mujoco.mj_step(there, one)
        mujoco.mj_step(there, two)
        mujoco.mj_differentiatePos(there, apart, 1, one.qpos, two.qpos)
        if not (np.isfinite(apart).all() and np.isfinite(one.qpos).all() and np.isfinite(two.qpos).all()):
            return math.inf
        most = max(most, float(np.abs(apart).max()) / PUSH)
        if most > GROWN:
            break
    return most

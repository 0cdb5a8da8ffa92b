"""The equilibrium with its evidence: forces, stability, agreement of the two ways, creep."""

# pyright: reportAttributeAccessIssue=false
# mujoco ships no type stubs for its compiled modules.
from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from typing import Any

import mujoco
import numpy as np
from jaxtyping import Float, Int

from cdpr_sim.anymodel.agreement import agreement
from cdpr_sim.anymodel.constraints import jacobian, names_of_bodies, softened, touching
from cdpr_sim.anymodel.forces import OutOfTime, RestForces, write_state
from cdpr_sim.anymodel.friction import LOADED
from cdpr_sim.anymodel.friction_limits import shares
from cdpr_sim.anymodel.islands import coordinates_of
from cdpr_sim.anymodel.judged import Judged
from cdpr_sim.anymodel.model_equilibrium import ContactForce, ModelAgreement, ModelEquilibrium, NoRest
from cdpr_sim.anymodel.names import joints_of, movers
from cdpr_sim.anymodel.tendons import tendon_tensions
from cdpr_sim.core.equilibrium import NotSettled, Stability

CREEP_TIME = 0.5
"""[s] After which creep is measured."""

MOST_STEPS = 5000
"""Time steps of that measurement, at most."""

MOVES = 0.5
"""[m/s, rad/s] Speed at that time above which the model is not at rest in MuJoCo, whatever friction could hold."""

GROWS = 0.05, 1.5
"""The same, if it is more than so many times that at half the time."""


def equilibrium_at(
    model: Any,
    judged: Judged,
    dofs: Int[np.ndarray, " n"],
    counts: dict[str, int],
    way: str,
    deadline: float,
    others: Sequence[tuple[str, Callable[[], Float[np.ndarray, " nq"]]]] = (),
) -> ModelEquilibrium:
    """The equilibrium at a pose where all forces balance.

    Args:
        model: the model with its own options.
        judged: the pose.
        dofs: degrees of freedom that are not held.
        counts: iterations, by name.
        way: the way to it.
        deadline: time at which the judgement ends.
        others: poses of the other way, until one agrees: where Newton's method began, and what finds the pose.

    Raises:
        NotSettled: it moves all the same: friction creeps too fast, a surface drives it, or an oscillation grows.
    """
    try:
        with judged.balance.forces.until(deadline):
            agreed = None
            for newton_from, pose in others:
                agreed = agreement(judged, pose(), newton_from)
                if agreed.agrees:
                    break
            found, half = described(model, judged, dofs, counts, way, agreed)
    except OutOfTime:
        reason = "the forces balance, but the time was spent before the stability was judged: give more seconds"
        raise NotSettled(reason, None, NoRest.NOT_CONVERGED) from None
    if way == "newton" and found.stability is Stability.UNSTABLE:
        reason = f"{NoRest.NOT_CONVERGED.value}: time steps do not end, and Newton's method found only a saddle"
        raise NotSettled(reason, found, NoRest.NOT_CONVERGED, judged.unstable)
    grows = found.creep > GROWS[0] and found.creep > GROWS[1] * half
    if found.friction_share > LOADED and (grows or found.creep >= MOVES):
        reason = (
            f"{NoRest.SLIDES.value}: friction could hold, but after 0.5 s it moves at {found.creep:.2g} m/s or rad/s"
        )
        raise NotSettled(reason, found, NoRest.SLIDES)
    for part in judged.islands:
        belt = belt_of(judged.balance.forces, judged.qpos, part) if found.creep > GROWS[0] else None
        if belt is not None:
            reason = (
                f"{NoRest.BELT.value}: forces balance, but by the contact of {belt[0]} and {belt[1]} it moves on at"
            )
            raise NotSettled(f"{reason} {found.creep:.2g} m/s or rad/s", found, NoRest.BELT, joints_of(model, part))
    if found.growth > 0 and found.stability is not Stability.UNSTABLE:
        reason = f"{NoRest.LIMIT_CYCLE.value}: oscillations grow at {found.growth:.2g} 1/s"
        raise NotSettled(reason, found, NoRest.LIMIT_CYCLE, judged.growing)
    return found


def described(
    model: Any,
    judged: Judged,
    dofs: np.ndarray,
    counts: dict[str, int],
    way: str,
    agreed: ModelAgreement | None = None,
) -> tuple[ModelEquilibrium, float]:
    """The equilibrium, or the best pose, with its forces; and the speed after half the time of the creep."""
    forces, qpos = judged.balance.forces, judged.qpos
    eigenvalues, neutral = judged.eigenvalues, judged.neutral_directions
    stability = Stability.NEUTRAL if neutral else Stability.STABLE
    if judged.unstable_directions:
        stability = Stability.UNSTABLE
    unbalanced, friction, share = np.zeros(model.nv), np.zeros(model.nv), 0.0
    for part, state in zip(judged.islands, judged.states, strict=True):
        unbalanced[part], friction[part] = state.force, state.held.force
        share = max(share, state.held.largest)
    ignored = np.ones(model.nv, dtype=bool)
    ignored[dofs] = False
    half, creep = creep_of(forces, model, qpos, ignored, CREEP_TIME)
    names = tuple(dict.fromkeys(name for one in neutral for name in movers(model, one)))
    notes = []
    if share > LOADED:
        notes.append("friction carries load: the equilibrium depends on the path, and MuJoCo's friction creeps")
    forces.net(qpos)
    if softened(forces.model, forces.data):
        notes.append("a time constant in solref is below two time steps: the equilibrium depends on the time step")
    if model.opt.noslip_iterations and share > 0:
        notes.append(
            "noslip_iterations changes contact forces after MuJoCo's solver: it is left out of this equilibrium"
        )
    if np.isnan(creep):
        notes.append("the creep was not measured: the time was spent")
    found = ModelEquilibrium(
        qpos=np.array(qpos),
        act=np.array(forces.data.act),
        ctrl=np.array(forces.data.ctrl),
        tendon_tensions=tendon_tensions(forces.model, forces.data),
        contact_forces=contact_forces(judged),
        residual=judged.residual,
        unbalanced=unbalanced,
        friction=friction,
        friction_share=share,
        creep=creep,
        stiffness_eigenvalues=eigenvalues,
        growth=max(judged.growths, default=0.0),
        stability=stability,
        neutral=names,
        iterations=dict(counts),
        way=way,
        agreement=agreed,
        notes=tuple(notes),
    )
    return found, half


def belt_of(forces: RestForces, qpos: Float[np.ndarray, " nq"], dofs: Int[np.ndarray, " n"]) -> tuple[str, str] | None:
    """The bodies of a contact whose surface moves while they are at rest, and which exerts a force on an island."""
    forces.net(qpos)
    model, data = forces.model, forces.data
    moves = (data.efc_vel != 0) & (data.efc_force != 0) & np.any(jacobian(model, data)[:, dofs], axis=1)
    moves &= data.efc_type >= int(mujoco.mjtConstraint.mjCNSTR_CONTACT_FRICTIONLESS)
    for number, bodies, _ in touching(model, data):
        if number in data.efc_id[moves]:
            return names_of_bodies(model, bodies)
    return None


def contact_forces(judged: Judged) -> tuple[ContactForce, ...]:
    """The contacts that carry a force."""
    forces, rows = judged.balance.forces, judged.rows
    model, data = forces.model, forces.data
    forces.net(judged.qpos)
    found = []
    use = np.sum([np.zeros(len(rows.limits)), *(state.held.use for state in judged.states)], axis=0)
    share = shares(use, rows.cones, rows.corners)
    for number, bodies, force in touching(model, data):
        if force[0] == 0:
            continue
        friction, used = float(np.linalg.norm(force[1:])), 0.0
        for cone in np.flatnonzero((rows.contacts == number) & (share > 0)):
            here = rows.cones == cone
            friction, used = float(np.linalg.norm((rows.limits * use)[here][:2])), float(share[cone])
        place, names = data.contact.pos[number].copy(), names_of_bodies(model, bodies)
        found.append(ContactForce(names, place, float(force[0]), friction, used))
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
    where = coordinates_of(model, np.flatnonzero(ignored))
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

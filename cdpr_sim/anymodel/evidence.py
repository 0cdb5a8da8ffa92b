"""The equilibrium with its evidence, or the refusal with its reason, of the pose where a search ended."""

# pyright: reportAttributeAccessIssue=false
# mujoco ships no type stubs for its compiled modules.
from __future__ import annotations

from typing import Any

import mujoco
import numpy as np
from jaxtyping import Float, Int

from cdpr_sim.anymodel.agreement import agreement
from cdpr_sim.anymodel.balance import Balance
from cdpr_sim.anymodel.forces import OutOfTime
from cdpr_sim.anymodel.friction import SLIDES
from cdpr_sim.anymodel.judged import Judged, contact_forces, creep_of, growth
from cdpr_sim.anymodel.model_equilibrium import ModelAgreement, ModelEquilibrium, NoRest
from cdpr_sim.anymodel.motion import TIME_SPENT, MotionEnd
from cdpr_sim.anymodel.names import joints_of, listed, movers, name_of
from cdpr_sim.anymodel.stiffness import NEUTRAL, STEP
from cdpr_sim.anymodel.tendons import tendon_tensions
from cdpr_sim.core.equilibrium import NotSettled, Stability

CREEP_TIME = 0.5
"""[s] After which creep is measured."""

MOVES = 0.5
"""[m/s, rad/s] Speed at that time above which the model is not at rest in MuJoCo, whatever friction could hold."""

GROWS = 0.05, 1.5
"""The same, if it is more than so many times that at half the time."""

PUSHED = 1e-3
"""Residual above which a body that is far away is pushed further, by gravity for example."""

LOADED = 1e-6
"""Share of a friction limit above which friction carries load."""


def equilibrium_at(
    model: Any,
    balance: Balance,
    qpos: Float[np.ndarray, " nq"],
    dofs: Int[np.ndarray, " n"],
    counts: dict[str, int],
    way: str,
    by_motion: Float[np.ndarray, " nq"] | None = None,
    by_newton: Float[np.ndarray, " nq"] | None = None,
) -> ModelEquilibrium:
    """The equilibrium at a pose where all forces balance.

    Raises:
        NotSettled: it moves all the same: friction creeps too fast, or an oscillation grows.
    """
    try:
        found, half = _at(model, balance, qpos, dofs, counts, way, by_motion, by_newton)
    except OutOfTime:
        reason = "the forces balance, but the time was spent before the stability was judged: give more seconds"
        raise NotSettled(reason, None, NoRest.NOT_CONVERGED) from None
    finally:
        balance.forces.deadline = float("inf")
    if way == "newton" and found.stability is Stability.UNSTABLE:
        reason = f"{NoRest.NOT_CONVERGED.value}: time steps do not end, and Newton's method found only a saddle"
        raise NotSettled(reason, found, NoRest.NOT_CONVERGED, joints_of_unstable(model, balance, qpos, dofs))
    grows = found.creep > GROWS[0] and found.creep > GROWS[1] * half
    if found.friction_share > LOADED and (grows or found.creep >= MOVES):
        reason = (
            f"{NoRest.SLIDES.value}: friction could hold, but after 0.5 s it moves at {found.creep:.2g} m/s or rad/s"
        )
        raise NotSettled(reason, found, NoRest.SLIDES)
    if found.growth > 0 and found.stability is not Stability.UNSTABLE:
        names = judged_growth(model, balance, qpos, dofs)
        reason = f"{NoRest.LIMIT_CYCLE.value}: oscillations grow at {found.growth:.2g} 1/s"
        raise NotSettled(reason, found, NoRest.LIMIT_CYCLE, names)
    return found


def judged_growth(model: Any, balance: Balance, qpos: np.ndarray, dofs: np.ndarray) -> tuple[str, ...]:
    """Names of the joints of the islands in which an oscillation grows."""
    judged = Judged(balance, qpos, dofs)
    every = zip(judged.islands, judged.modes, strict=True)
    grows = [part for part, found in every if growth(balance.forces, qpos, part, found) > 0]
    return tuple(name for part in grows for name in joints_of(model, part))


def joints_of_unstable(model: Any, balance: Balance, qpos: np.ndarray, dofs: np.ndarray) -> tuple[str, ...]:
    """Names of the joints that move along the unstable directions at a pose."""
    directions = Judged(balance, qpos, dofs).unstable_directions
    return tuple(dict.fromkeys(name for one in directions for name in movers(model, one)))


def _at(
    model: Any,
    balance: Balance,
    qpos: np.ndarray,
    dofs: np.ndarray,
    counts: dict[str, int],
    way: str,
    by_motion: np.ndarray | None = None,
    by_newton: np.ndarray | None = None,
) -> tuple[ModelEquilibrium, float]:
    """What is there at a pose, and the speed after half the time of the creep."""
    forces, judged = balance.forces, Judged(balance, qpos, dofs)
    eigenvalues, neutral = judged.eigenvalues, judged.neutral_directions
    stability = Stability.NEUTRAL if neutral else Stability.STABLE
    if judged.unstable_directions:
        stability = Stability.UNSTABLE
    compared: ModelAgreement | None = None
    if by_motion is not None:
        if by_newton is not None:
            compared = agreement(forces, qpos, by_newton if way == "motion" else by_motion, neutral, "start")
        if way == "motion" and (compared is None or not compared.agrees):
            compared = agreement(forces, qpos, by_motion, neutral, "motion")
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
    if softened(forces.model):
        notes.append("a time constant in solref is below two time steps: the equilibrium depends on the time step")
    if np.isnan(creep):
        notes.append("the creep was not measured: the time was spent")
    forces.net(qpos)
    found = ModelEquilibrium(
        qpos=np.array(qpos),
        act=np.array(forces.data.act),
        ctrl=np.array(forces.data.ctrl),
        tendon_tensions=tendon_tensions(forces.model, forces.data),
        contact_forces=contact_forces(forces.model, forces.data, judged.states),
        residual=judged.residual,
        unbalanced=unbalanced,
        friction=friction,
        friction_share=share,
        creep=creep,
        stiffness_eigenvalues=eigenvalues,
        growth=judged.growth,
        stability=stability,
        neutral=names,
        iterations=dict(counts),
        way=way,
        agreement=compared,
        notes=tuple(notes),
    )
    return found, half


def _never_resisted(balance: Balance, start: np.ndarray, direction: np.ndarray) -> bool:
    """Whether at the start, too, a force pushes along a direction that nothing resists: a body in flight may land."""
    model, forces = balance.forces.model, balance.forces
    free = model.jnt_type[model.dof_jntid] == int(mujoco.mjtJoint.mjJNT_FREE)
    if np.any(direction[free]):
        return False
    step = STEP * direction / np.sqrt(model.dof_M0 @ direction**2)
    ahead, behind = forces.net(forces.moved(start, step)), forces.net(forces.moved(start, -step))
    stiffness = (behind.force - ahead.force) @ step / (2 * STEP**2)
    return bool(forces.net(start).force @ step > 0 and abs(stiffness) <= NEUTRAL)


def softened(model: Any) -> bool:
    """Whether MuJoCo's ``refsafe`` softens an element with a time constant shorter than two time steps."""
    if model.opt.disableflags & int(mujoco.mjtDisableBit.mjDSBL_REFSAFE):
        return False
    fields = ("geom_solref", "jnt_solref", "eq_solref", "tendon_solref_lim", "pair_solref")
    references = np.concatenate([np.reshape(getattr(model, field), (-1, 2))[:, 0] for field in fields])
    return bool(np.any((references > 0) & (references < 2 * model.opt.timestep)))


def refusal(
    model: Any,
    balance: Balance,
    qpos: Float[np.ndarray, " nq"],
    dofs: Int[np.ndarray, " n"],
    counts: dict[str, int],
    ended: MotionEnd,
    start: Float[np.ndarray, " nq"],
) -> NotSettled:
    """Why a model does not come to rest, with the best pose found."""
    best, modes, late = None, [], balance.forces.deadline
    balance.forces.deadline = float("inf")
    judged = Judged(balance, qpos, dofs)
    balance.forces.deadline = late
    try:
        best, _ = _at(model, balance, qpos, dofs, counts, "motion", ended.qpos)
        modes = judged.modes
    except OutOfTime:
        pass  # the reason does not need it
    finally:
        balance.forces.deadline = float("inf")
    for trees, case, why in (
        (ended.falling & ~ended.sliding, NoRest.FALLS, "nothing holds"),
        (ended.falling & ended.sliding, NoRest.SLIDES, "it moves away:"),
    ):
        here = [
            state
            for part, state in zip(judged.islands, judged.states, strict=True)
            if trees[model.dof_treeid[part]].any()
        ]
        if trees.any() and max((state.residual for state in here), default=0.0) > PUSHED:
            names = tuple(name_of(model, "body", int(model.tree_bodyadr[tree])) for tree in np.flatnonzero(trees))
            joints = joints_of(model, np.flatnonzero(trees[model.dof_treeid]))
            reason = f"{case.value}: {why} body {listed(names)}; ignore={names[0]!r} leaves it out"
            return NotSettled(reason, best, case, joints)
    if ended.turning:
        joints = joints_of(model, np.array([model.jnt_dofadr[joint] for joint in ended.turning]))
        return NotSettled(f"{NoRest.TURNS.value}: joint {listed(joints)}", best, NoRest.TURNS, joints)
    for island, (state, found) in enumerate(zip(judged.states, modes, strict=False)):
        if state.residual <= 1e-8 or not len(found.eigenvalues) or state.held.largest > SLIDES:
            continue
        push = found.directions.T @ state.force
        loose = np.abs(found.eigenvalues) <= found.floor
        if np.linalg.norm(push[loose]) > 0.5 * np.linalg.norm(push):
            direction = judged.spread(island, found.directions[:, loose] @ push[loose])
            if _never_resisted(balance, start, direction):
                names = movers(model, direction)
                return NotSettled(f"{NoRest.MECHANISM.value}: joint {listed(names)}", best, NoRest.MECHANISM, names)
    worst = int(np.argmax([state.residual for state in judged.states]))
    names = movers(model, judged.spread(worst, judged.states[worst].force / model.dof_M0[judged.islands[worst]]))
    share = judged.states[worst].held.largest
    if ended.diverged:
        return NotSettled(NoRest.DIVERGES.value, best, NoRest.DIVERGES, names)
    if share > SLIDES and ended.reason != TIME_SPENT:
        return NotSettled(f"{NoRest.SLIDES.value}: joint {listed(names)}", best, NoRest.SLIDES, names)
    reason = (
        f"{NoRest.NOT_CONVERGED.value}: {judged.residual:.1e} of the largest force remains at joint {listed(names)}"
    )
    return NotSettled(f"{reason} ({ended.reason})", best, NoRest.NOT_CONVERGED, names)

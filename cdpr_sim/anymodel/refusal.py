"""Why a model does not come to rest: what the search of an equilibrium that failed shows."""

# pyright: reportAttributeAccessIssue=false
# mujoco ships no type stubs for its compiled modules.
from __future__ import annotations

import contextlib
from typing import Any

import mujoco
import numpy as np
from jaxtyping import Float, Int

from cdpr_sim.anymodel.balance import Balance
from cdpr_sim.anymodel.evidence import belt_of, described
from cdpr_sim.anymodel.forces import OutOfTime
from cdpr_sim.anymodel.friction import SLIDES
from cdpr_sim.anymodel.judged import Judged
from cdpr_sim.anymodel.jumps import JUMP, lasting_jump
from cdpr_sim.anymodel.model_equilibrium import NoRest
from cdpr_sim.anymodel.motion import DIVERGES, STILL, TIME_SPENT, MotionEnd
from cdpr_sim.anymodel.names import joints_of, listed, movers, name_of
from cdpr_sim.anymodel.stiffness import NEUTRAL, STEP
from cdpr_sim.core.equilibrium import NotSettled

PUSHED = 1e-3
"""Residual above which a body that is far away is pushed further, by gravity for example."""


def refusal(
    model: Any,
    judged: Judged,
    dofs: Int[np.ndarray, " n"],
    counts: dict[str, int],
    ended: MotionEnd,
    start: Float[np.ndarray, " nq"],
    deadline: float,
) -> NotSettled:
    """Why a model does not come to rest, with the best pose found."""
    best = loose = None
    with contextlib.suppress(OutOfTime), judged.balance.forces.until(deadline):  # the reason does not need them
        best, _ = described(model, judged, dofs, counts, "motion")
        loose = _mechanism(judged, start)

    def because(case: NoRest, names: tuple[str, ...], rest: str | None = None) -> NotSettled:
        return NotSettled(f"{case.value}: {rest or f'joint {listed(names)}'}", best, case, names)

    def driven(part: np.ndarray, qpos: np.ndarray) -> NotSettled | None:
        belt, names = belt_of(judged.balance.forces, qpos, part), joints_of(model, part)
        by = f"the contact of {' and '.join(belt)} drives joint {listed(names)}" if belt else ""
        return because(NoRest.BELT, names, by) if belt else None

    for part, state in zip(judged.islands, judged.states, strict=True):
        belt = driven(part, judged.qpos) if state.residual > PUSHED else None
        if belt is not None:
            return belt
    for trees, case, why in (
        (ended.falling & ~ended.sliding, NoRest.FALLS, "nothing holds"),
        (ended.falling & ended.sliding, NoRest.SLIDES, "it moves away:"),
    ):
        every = zip(judged.islands, judged.states, strict=True)
        if any(state.residual > PUSHED for part, state in every if trees[model.dof_treeid[part]].any()):
            names = tuple(name_of(model, "body", int(model.tree_bodyadr[tree])) for tree in np.flatnonzero(trees))
            joints = joints_of(model, np.flatnonzero(trees[model.dof_treeid]))
            return because(case, joints, f"{why} body {listed(names)}; ignore={names[0]!r} leaves it out")
    if ended.turning:
        return because(NoRest.TURNS, joints_of(model, model.jnt_dofadr[list(ended.turning)]))
    if loose is not None:
        return because(NoRest.MECHANISM, movers(model, loose))
    worst = int(np.argmax([state.residual for state in judged.states]))
    state, part = judged.states[worst], judged.islands[worst]
    names = movers(model, judged.spread(worst, state.force / model.dof_M0[part]))
    if ended.reason == DIVERGES:
        return because(NoRest.DIVERGES, names)
    if state.held.largest > SLIDES and ended.reason != TIME_SPENT:
        return because(NoRest.SLIDES, names)
    jump = lasting_jump(judged.balance.forces, judged.qpos, part, deadline) if state.residual > JUMP else None
    if jump is not None:
        by = f"jumps by {jump.size:.0%} of the largest force where {jump.cause}"
        why = f"the force on joint {listed(jump.joints)} {by}"
        return driven(part, jump.qpos) or because(NoRest.JUMPS, jump.joints, why)
    left = f"{judged.residual:.1e} of the largest force remains at joint {listed(names)}"
    still = sum(one.residual < STILL for one in judged.states)
    others = f"; {still} of {len(judged.states)} independent parts are at rest" if len(judged.states) > 1 else ""
    return because(NoRest.NOT_CONVERGED, names, f"{left}{others} ({ended.reason})")


def _mechanism(judged: Judged, start: Float[np.ndarray, " nq"]) -> Float[np.ndarray, " nv"] | None:
    """A direction along which a force pushes and nothing resists."""
    for island, (state, found) in enumerate(zip(judged.states, judged.modes, strict=True)):
        if state.residual <= 1e-8 or not len(found.eigenvalues) or state.held.largest > SLIDES:
            continue
        push = found.directions.T @ state.force
        loose = np.abs(found.eigenvalues) <= found.floor
        if np.linalg.norm(push[loose]) > 0.5 * np.linalg.norm(push):
            direction = judged.spread(island, found.directions[:, loose] @ push[loose])
            if _never_resisted(judged.balance, start, direction):
                return direction
    return None


def _never_resisted(balance: Balance, start: Float[np.ndarray, " nq"], direction: Float[np.ndarray, " nv"]) -> bool:
    """Whether at the start, too, a force pushes along a direction that nothing resists: a body in flight may land."""
    model, forces = balance.forces.model, balance.forces
    free = model.jnt_type[model.dof_jntid] == int(mujoco.mjtJoint.mjJNT_FREE)
    if np.any(direction[free]):
        return False
    step = STEP * direction / np.sqrt(model.dof_M0 @ direction**2)
    ahead, behind = forces.net(forces.moved(start, step)), forces.net(forces.moved(start, -step))
    stiffness = (behind.force - ahead.force) @ step / (2 * STEP**2)
    return bool(forces.net(start).force @ step > 0 and abs(stiffness) <= NEUTRAL)

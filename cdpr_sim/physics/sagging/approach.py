"""The last steps of a platform on cables with mass to its rest: longer than any swing, and Newton's then."""

# pyright: reportAttributeAccessIssue=false
# mujoco ships no type stubs for its compiled modules.
from __future__ import annotations

import mujoco
import numpy as np
from jaxtyping import Float

from cdpr_sim.core.status import NEUTRAL
from cdpr_sim.physics.sagging.chain_derivatives import ChainDerivatives
from cdpr_sim.physics.sagging.chain_simulation import ChainSimulation

SHORTER, VAIN = 20, 5
"""How often a step is halved at most; and after how many in turn that lead nowhere, however short, others will not."""

TRUSTED, CLOSER, TURN = 0.1, 0.5, 0.2
"""What a step may leave unbalanced, of the load or of what was; and by how much it may turn the platform [rad]."""


def approach(simulation: ChainSimulation, target: float, most: int) -> tuple[bool, int]:
    """Move on to rest in time steps that are implicit in MuJoCo's own stiffness.

    Such steps may be as long as one likes, and are Newton's then, where damping alone would let a softly held
    platform creep for ever. The chains are laid anew after each, and it is shortened while that leaves too much
    unbalanced. Where this does not lead to rest, all is left as it was.

    Args:
        simulation: the platform.
        target: the largest force [N] that may be left over at rest.
        most: steps to be tried; a handful do where chains hang well, and some hundreds where one hangs folded.

    Returns:
        Whether that leads to rest, and how many steps were tried.
    """
    data, angular = simulation.data, simulation.angular
    before, turn, last = (data.qpos.copy(), data.qvel.copy()), TURN, np.zeros_like(data.qvel[angular])
    tried, vain = 0, 0
    while (residual := simulation.residual()) > target and tried < most and vain < VAIN:
        step = _implicit_step(simulation)
        if step is None:
            break
        back = step[angular] @ last < 0
        turn, last = turn / 2 if back else turn, step[angular]
        step = step / max(1.0, float(np.abs(last).max()) / turn)
        trusted, tries = _stepped(simulation, step, residual)
        tried, vain = tried + tries, 0 if trusted else vain + 1
    equilibria = bool(residual <= target)
    if not equilibria:
        data.qpos[:], data.qvel[:] = before
    return equilibria, tried


def _stepped(simulation: ChainSimulation, step: Float[np.ndarray, " dofs"], residual: float) -> tuple[bool, int]:
    """Go that step, as far as it can be trusted; whether it can, and how many were tried."""
    data, start, pulls = simulation.data, simulation.data.qpos.copy(), simulation.anchor_pulls()
    for shortened in range(SHORTER):
        data.qpos[:] = start
        mujoco.mj_integratePos(simulation.model, data.qpos, 0.5**shortened * step, 1)
        if simulation.residual() <= CLOSER * residual:
            return True, shortened + 1
        simulation.lay(pulls)
        if simulation.residual() <= max(TRUSTED * simulation.load, CLOSER * residual):
            return True, shortened + 1
    return False, SHORTER


def _implicit_step(simulation: ChainSimulation) -> Float[np.ndarray, " dofs"] | None:
    """To where forces would balance if they went on as they change here; None where they are not known.

    Along directions in which they repel the platform it goes as far the other way, which is away from a saddle.
    """
    derivatives = ChainDerivatives.of(simulation)
    if not derivatives.known:
        return None
    direct, across, within = derivatives
    platform, slides = simulation.forces()
    loose = np.linalg.pinv(within)
    alone, follow = np.einsum("nij,nj->ni", loose, slides), loose @ across
    x = np.zeros(simulation.free)
    if not simulation.held:
        stiffness = direct - (np.swapaxes(across, 1, 2) @ follow).sum(0)
        values, vectors = np.linalg.eigh((stiffness + stiffness.T) / 2)
        if values[0] <= 0:
            stiffness = (vectors * np.maximum(np.abs(values), NEUTRAL * values[-1])) @ vectors.T
        x = np.linalg.solve(stiffness, platform - np.einsum("nif,ni->f", across, alone))
    step = simulation.in_dofs(x)
    step[simulation.slides] = alone - follow @ x
    return step

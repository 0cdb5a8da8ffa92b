"""The last steps of a platform on cables with mass to its equilibrium: longer than any oscillation, so Newton steps."""

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
"""Largest number of halvings of a step; and number of failed steps in turn after which the approach stops."""

QUICK = 0.1
"""A step that leaves less than this fraction of the residual: the next one takes the same derivatives again, which cost
as much as twenty steps."""

TRUSTED, CLOSER, TURN = 0.1, 0.5, 0.2
"""Largest unbalanced force after a step, as a fraction of the load or of the force before; and largest rotation in a
step [rad]."""


def approach(simulation: ChainSimulation, target: float, most: int) -> tuple[bool, int]:
    """Move to equilibrium in time steps that are implicit in MuJoCo's own stiffness.

    Such steps may have any length, and are Newton steps in the limit, where a platform on a small stiffness would creep
    under damping alone. The chains are laid out again after each step, and the step is shortened while it leaves too
    large an unbalanced force. If this does not lead to equilibrium, the state is restored.

    Args:
        simulation: the platform.
        target: largest unbalanced force [N] of an equilibrium.
        most: largest number of steps; a few suffice for hanging chains, and some hundred for a folded one.

    Returns:
        Whether equilibrium was reached, and the number of steps that were tried.
    """
    data, angular = simulation.data, simulation.angular
    before, turn, last = (data.qpos.copy(), data.qvel.copy()), TURN, np.zeros_like(data.qvel[angular])
    tried, vain, derivatives, earlier = 0, 0, None, np.inf
    loose = np.empty(0)
    while (residual := simulation.residual()) > target and tried < most and vain < VAIN:
        if derivatives is None or residual > QUICK * earlier:
            derivatives = ChainDerivatives.of(simulation, quick=True)
            if not derivatives.known:
                break
            loose = np.linalg.pinv(derivatives.within)
        step, earlier = _implicit_step(simulation, derivatives, loose), residual
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
    """Take the step, shortened to where it is reliable; returns whether it is, and the number of attempts."""
    data, start, pulls = simulation.data, simulation.data.qpos.copy(), simulation.anchor_pulls()
    for shortened in range(SHORTER):
        data.qpos[:] = start
        mujoco.mj_integratePos(simulation.model, data.qpos, 0.5**shortened * step, 1)
        if simulation.residual() <= CLOSER * residual:
            return True, shortened + 1
        simulation.lay(pulls)
        if simulation.residual() <= max(TRUSTED * simulation.load, (1 - (1 - CLOSER) * 0.5**shortened) * residual):
            return True, shortened + 1
    return False, SHORTER


def _implicit_step(
    simulation: ChainSimulation, derivatives: ChainDerivatives, loose: Float[np.ndarray, "chains slides slides"]
) -> Float[np.ndarray, " dofs"]:
    """Step to where forces would balance if they changed linearly; ``loose`` is the inverse of ``within``.

    Along directions of negative stiffness the step has the opposite sign, which leads away from a saddle.
    """
    direct, across, _ = derivatives
    platform, slides = simulation.forces()
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

"""The last steps of platforms on cables with mass to their equilibria: longer than any oscillation, so Newton steps."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float, Int

from cdpr_sim.core.status import NEUTRAL
from cdpr_sim.physics.sagging.chain_derivatives import ChainDerivatives
from cdpr_sim.physics.sagging.chain_simulations import ChainSimulations, Rows

SHORTER, VAIN = 20, 5
"""Largest number of halvings of a step; and number of failed steps in turn after which the approach stops."""

QUICK = 0.1
"""A step that leaves less than this fraction of the residual: the next one takes the same derivatives again, which cost
as much as twenty steps."""

TRUSTED, CLOSER, TURN = 0.1, 0.5, 0.2
"""Largest unbalanced force after a step, as a fraction of the load or of the force before; and largest rotation in a
step [rad]."""


def approach(
    simulations: ChainSimulations, at: Rows, target: Float[np.ndarray, " some"], most: Int[np.ndarray, " some"]
) -> tuple[Bool[np.ndarray, " some"], Int[np.ndarray, " some"]]:
    """Move to equilibrium in time steps that are implicit in MuJoCo's own stiffness.

    Such steps may have any length, and are Newton steps in the limit, where a platform on a small stiffness would creep
    under damping alone. The chains are laid out again after each step, and the step is shortened while it leaves too
    large an unbalanced force. If this does not lead to equilibrium, the state is restored.

    Args:
        simulations: the platforms.
        at: the rows that move.
        target: largest unbalanced force [N] of an equilibrium.
        most: largest number of steps; a few suffice for hanging chains, and some hundred for a folded one.

    Returns:
        Whether equilibrium was reached, and the number of steps that were tried.
    """
    rows, chains, slides, free = len(at), *simulations.slides.shape, simulations.free
    qpos, qvel = simulations.qpos[at], simulations.qvel[at]
    turn, last = np.full(rows, TURN), np.zeros_like(qvel[:, simulations.angular])
    tried, vain, earlier = np.zeros(rows, dtype=int), np.zeros(rows, dtype=int), np.zeros(rows)
    shapes = (free, free), (chains, slides, free), (chains, slides, slides), (chains, slides, free)
    derivatives = ChainDerivatives(*(np.zeros((rows, *shape)) for shape in shapes))
    loose, known = np.zeros_like(derivatives.within), np.ones(rows, dtype=bool)
    residual = simulations.residuals(at)
    while True:
        going = known & (residual > target) & (tried < most) & (vain < VAIN)
        stale = np.flatnonzero(going & (residual > QUICK * earlier))
        if len(stale):
            fresh = ChainDerivatives.of(simulations, at[stale], quick=True)
            known[stale] = fresh.known
            for whole, part in zip(derivatives, fresh, strict=True):
                whole[stale] = part
            finite = stale[fresh.known]
            loose[finite] = np.linalg.pinv(derivatives.within[finite])
        live = np.flatnonzero(going & known)
        if not len(live):
            break
        earlier[live] = residual[live]
        some = ChainDerivatives(*(part[live] for part in derivatives))
        step = _implicit_step(simulations, at[live], some, loose[live])
        turning = step[:, simulations.angular]
        back = np.vecdot(turning, last[live]) < 0
        turn[live] = np.where(back, turn[live] / 2, turn[live])
        last[live] = turning
        with np.errstate(over="ignore"):  # a step without bound is shortened to nothing
            step /= np.maximum(1.0, np.abs(turning).max(1) / turn[live])[:, None]
        reliable, tries, residual[live] = _stepped(simulations, at[live], step, residual[live])
        tried[live] += tries
        vain[live] = np.where(reliable, 0, vain[live] + 1)
    reached = residual <= target
    left = at[~reached]
    simulations.qpos[left], simulations.qvel[left] = qpos[~reached], qvel[~reached]
    return reached, tried


def _stepped(
    simulations: ChainSimulations,
    at: Rows,
    step: Float[np.ndarray, "some dofs"],
    residual: Float[np.ndarray, " some"],
) -> tuple[Bool[np.ndarray, " some"], Int[np.ndarray, " some"], Float[np.ndarray, " some"]]:
    """Take the steps, shortened to where they are reliable.

    Returns:
        Whether each step is; the number of attempts; and the residual after the last one [N].
    """
    start, pulls, load = simulations.qpos[at], simulations.anchor_pulls(at), simulations.load[at]
    reliable, tries, after = np.zeros(len(at), dtype=bool), np.zeros(len(at), dtype=int), residual.copy()
    for shortened in range(SHORTER):
        left = np.flatnonzero(~reliable)
        tries[left] += 1
        simulations.qpos[at[left]] = simulations.displaced(start[left], 0.5**shortened * step[left])
        after[left] = simulations.residuals(at[left])
        reliable[left] = after[left] <= CLOSER * residual[left]
        left = left[~reliable[left]]
        if not len(left):
            break
        simulations.lay(at[left], pulls[left])
        after[left] = simulations.residuals(at[left])
        allowed = np.maximum(TRUSTED * load, (1 - (1 - CLOSER) * 0.5**shortened) * residual)
        reliable[left] = after[left] <= allowed[left]
        if reliable.all():
            break
    return reliable, tries, after


def _implicit_step(
    simulations: ChainSimulations,
    at: Rows,
    derivatives: ChainDerivatives,
    loose: Float[np.ndarray, "some chains slides slides"],
) -> Float[np.ndarray, "some dofs"]:
    """Steps to where forces would balance if they changed linearly; ``loose`` is the inverse of ``within``.

    Along directions of negative stiffness the step has the opposite sign, which leads away from a saddle.
    """
    direct, across, _, carried = derivatives
    platform, slides = simulations.forces(at)
    platform = platform + np.einsum("rcs,rcsf->rf", slides, carried)
    alone, follow = (loose @ slides[..., None])[..., 0], loose @ across
    x = np.zeros_like(platform)
    if not simulations.held:
        stiffness = direct - (across.swapaxes(2, 3) @ follow).sum(1)
        values, vectors = np.linalg.eigh((stiffness + stiffness.swapaxes(1, 2)) / 2)
        away = values[:, 0] <= 0
        sizes = np.maximum(np.abs(values), NEUTRAL * values[:, -1:])
        stiffness[away] = ((vectors * sizes[:, None]) @ vectors.swapaxes(1, 2))[away]
        pushed = platform - (across.swapaxes(2, 3) @ alone[..., None])[..., 0].sum(1)
        x = np.linalg.solve(stiffness, pushed[..., None])[..., 0]
    step = simulations.in_dofs(at, x)
    step[:, simulations.slides] = alone - (follow @ x[:, None, :, None])[..., 0]
    return step

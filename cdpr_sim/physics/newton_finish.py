"""Newton's method on MuJoCo's own forces: the last part of a settling, where the motion would only creep.

Close to equilibrium the path of the platform does not matter any more, and one forward pass of MuJoCo costs as much as
a time step. The derivatives of the forces are differences of MuJoCo's forces, and are updated by Broyden's formula
(1965, doi 10.1090/S0025-5718-1965-0198670-6); no formula of statics is used.

The motion chooses the equilibrium. So Newton's method is used only where the stiffness is positive definite and its
first step is short. Where a step does not reduce the forces, a cable has become slack or taut: the motion then
continues from where it was, as if nothing had happened.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float, Int

from cdpr_sim.physics.batch import Simulations

DIFFERENCE = 1e-7
"""Displacement for differences to one side, as a fraction of the mean cable length: smaller than for the central
differences of ``batch``, since the error of truncation is larger, and a step needs three digits only."""

LONGEST = 1e-3
"""Longest first step, as a fraction of the mean cable length. Longer ones do not reach equilibrium on stiff cables, and
another equilibrium may be as near."""

DEFINITE = 1e-7
"""Smallest eigenvalue of a stiffness that counts as positive, as a fraction of the largest: the error of such
differences. In a direction of less stiffness, the motion alone determines where the platform stops."""

SHRINKING = 0.5
"""A step fails that leaves a larger fraction of the force."""

MOST = 20
"""Largest number of steps; one to three are usual."""


def finish(
    simulations: Simulations, rows: Bool[np.ndarray, " rows"], target: Float[np.ndarray, " rows"]
) -> Int[np.ndarray, " rows"]:
    """Move ``rows`` to the equilibrium beside them, if Newton's method reaches it.

    Rows that do not reach it are put back, with their velocity.

    Args:
        simulations: in motion.
        rows: which may be near their equilibrium.
        target: largest unbalanced force of an equilibrium [N].

    Returns:
        Number of steps of the rows that reached it; 0 of all others.
    """
    at, taken = np.flatnonzero(rows), np.zeros(len(rows), dtype=int)
    qpos, qvel = simulations.qpos[at].copy(), simulations.qvel[at].copy()
    length, lower = simulations.rest_lengths[at].mean(1), target[at]
    forces = simulations.evaluate(at, qpos)
    inverse, usable = _compliance(simulations, at, simulations.qpos[at].copy(), forces, DIFFERENCE * length)
    moves = _product(inverse, forces)
    usable &= np.abs(moves).max(1) <= LONGEST * length
    live = np.flatnonzero(usable)
    here, moves, forces, inverse = qpos[live], moves[live], forces[live], inverse[live]
    for step in range(1, MOST + 1):
        if not live.size:
            break
        here = simulations.displaced(here, moves)
        left = simulations.evaluate(at[live], here)
        here = simulations.qpos[at[live]].copy()  # the wheels are turned
        largest = np.abs(left).max(1)
        reached = largest <= lower[live]
        taken[at[live[reached]]] = step
        going = ~reached & (largest <= SHRINKING * np.abs(forces).max(1))
        live, here, inverse = live[going], here[going], inverse[going]
        inverse = _updated(inverse, moves[going], (forces - left)[going])
        forces = left[going]
        moves = _product(inverse, forces)
    failed = taken[at] == 0
    simulations.qpos[at[failed]], simulations.qvel[at[failed]] = qpos[failed], qvel[failed]
    return taken


def _compliance(
    simulations: Simulations,
    at: Int[np.ndarray, " some"],
    qpos: Float[np.ndarray, "some coordinates"],
    forces: Float[np.ndarray, "some free"],
    step: Float[np.ndarray, " some"],
) -> tuple[Float[np.ndarray, "some free free"], Bool[np.ndarray, " some"]]:
    """Inverse of the stiffness at ``qpos`` [m/N], by differences of ``step`` [m]; and where it is positive definite."""
    stiffness = np.empty((*forces.shape, forces.shape[1]))
    moves = step[:, None] * np.eye(forces.shape[1])[:, None]
    for j, displaced in enumerate(simulations.displaced(qpos, moves)):
        stiffness[:, :, j] = (forces - simulations.evaluate(at, displaced)) / step[:, None]
    stiffness[~np.isfinite(stiffness).all((1, 2))] = 0
    values = np.linalg.eigvalsh((stiffness + stiffness.swapaxes(1, 2)) / 2)
    definite = values[:, 0] > DEFINITE * values[:, -1]
    stiffness[~definite] = np.eye(forces.shape[1])
    return np.linalg.inv(stiffness), definite


def _updated(
    inverse: Float[np.ndarray, "some free free"],
    moves: Float[np.ndarray, "some free"],
    changes: Float[np.ndarray, "some free"],
) -> Float[np.ndarray, "some free free"]:
    """``inverse`` after steps ``moves`` that reduced the forces by ``changes``: Broyden's first formula."""
    expected = _product(inverse, changes)
    along = (moves[:, None, :] @ inverse)[:, 0]
    left = (moves - expected) / np.vecdot(moves, expected)[:, None]
    return inverse + left[:, :, None] * along[:, None, :]


def _product(
    matrices: Float[np.ndarray, "some free free"], vectors: Float[np.ndarray, "some free"]
) -> Float[np.ndarray, "some free"]:
    return (matrices @ vectors[:, :, None])[:, :, 0]

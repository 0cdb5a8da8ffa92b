"""Newton's method on the net force at rest, in the modes of the stiffness.

While a mode is unstable, the step goes downhill along it, by the magnitude of its eigenvalue; otherwise it is
Newton's, with the full stiffness, which follower forces make unsymmetric. A step counts if the unbalanced force
falls, or if the force still pushes along it: bodies that must first fall onto something fall.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from cdpr_sim.anymodel.balance import Balance
from cdpr_sim.anymodel.forces import OutOfTime
from cdpr_sim.anymodel.friction import SLIDES
from cdpr_sim.anymodel.stiffness import modes, stiffness_of

ITERATIONS = 80
TARGET = 1e-12
"""Residual at which nothing is left to gain."""

SOFT = 1e-12
"""Eigenvalues smaller than this fraction of the largest are rounding."""

REACH = 0.1, 0.3
"""Largest step: as a fraction of the model's size [m] for translations, and of a rotation [rad]."""

PATIENCE = 10
"""Iterations without progress, with friction at its limit, after which the search ends."""

SHORTEST = 1e-9
"""Fraction of a step below which the search along it ends."""


@dataclass(frozen=True, eq=False)
class NewtonEnd:
    """Where Newton's method ended: the best pose, its residual, and why it stopped."""

    qpos: Float[np.ndarray, " nq"]
    residual: float
    iterations: int
    reason: str


def newton(
    balance: Balance,
    qpos: Float[np.ndarray, " nq"],
    dofs: Int[np.ndarray, " n"],
    *,
    tolerance: float,
    deadline: float,
    iterations: int = ITERATIONS,
) -> NewtonEnd:
    """Search for an equilibrium of the degrees of freedom ``dofs``; the others stay where they are."""
    forces = balance.forces
    extent = max(float(forces.model.stat.extent), 0.1)
    reach = np.where(balance.translates[dofs], REACH[0] * extent, REACH[1])
    best, best_residual, level, reason, count = qpos, np.inf, 1e-3, "iterations spent", -1
    stuck = 0
    forces.deadline = deadline
    try:
        while count < iterations:
            count += 1
            state = balance.at(qpos, dofs)
            residual = state.residual
            gained = residual < 0.5 * best_residual
            stuck = stuck + 1 if state.held.largest >= SLIDES and not residual < 0.9 * best_residual else 0
            if residual < best_residual:
                best, best_residual = qpos, residual
            if best_residual <= tolerance and (not gained or residual <= TARGET):
                reason = ""
                break
            if stuck > PATIENCE:
                reason = "friction at its limit does not hold"
                break
            if not np.isfinite(residual):
                reason = "the forces are not finite"
                break
            if state.free.shape[1] == 0:
                reason = "friction holds every direction, but not within its limits"
                break
            # Friction that holds follows the pose: its derivative counts, unless it is at a limit, where it has none.
            follows = 0 < state.held.largest < SLIDES
            force = (lambda there: balance.at(there, dofs).force) if follows else None
            found = modes(forces, qpos, dofs, state.free, stiffness_of(forces, qpos, dofs, force))
            push, largest = found.directions.T @ state.force, float(np.abs(found.eigenvalues).max())
            size = float(np.linalg.norm(push))
            soft = np.abs(found.eigenvalues) < max(found.floor, SOFT * largest)
            along = push / (np.abs(found.eigenvalues) + level * largest + 1e-300)
            if np.all(found.eigenvalues[~soft] > 0):
                stiff = found.directions[:, ~soft]
                exact = np.linalg.lstsq(stiff.T @ found.stiffness @ stiff, push[~soft], rcond=None)[0]
                if exact @ push[~soft] > 0:
                    along[~soft] = exact
            along[soft] = np.where(np.abs(push[soft]) > 1e-9 * size, push[soft], 0)  # over 1/s²
            step = found.directions @ along
            step *= min(1.0, float(np.min(reach / np.maximum(np.abs(step), 1e-300))))
            fraction, accepted, there = 1.0, False, qpos
            while fraction > SHORTEST and not accepted:
                there = balance.moved(qpos, dofs, fraction * step)
                at_there = found.directions.T @ balance.at(there, dofs).force
                after = float(np.linalg.norm(at_there))
                falls = after < (1 - 1e-4 * fraction) * size
                accepted = falls or (at_there @ along > 0 and after < 1.5 * size)
                fraction /= 2
            level = min(1.0, level * 10) if fraction < 0.1 else max(1e-12, level / 5)
            if not accepted:
                reason = "no step along the force lowers it" + (": contacts come and go" if forces.data.ncon else "")
                break
            qpos = there
    except OutOfTime:
        reason = "time spent"
    finally:
        forces.deadline = float("inf")
    if best_residual <= tolerance:
        reason = ""
    return NewtonEnd(best, best_residual, count, reason)

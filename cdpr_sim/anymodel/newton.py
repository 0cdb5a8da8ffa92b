"""Newton's method on the net force at rest, in the modes of the stiffness, of all islands at once.

While a mode is unstable, the step goes downhill along it, by the magnitude of its eigenvalue; otherwise it is
Newton's, with the full stiffness, which follower forces make unsymmetric. A step counts if the unbalanced force
falls, or if the force still pushes along it: bodies that must first fall onto something fall. Each island has its own
steps and its own end, so that one without an equilibrium does not stop the others.
"""

from __future__ import annotations

import contextlib
from collections import defaultdict
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from cdpr_sim.anymodel.balance import Balance, Unbalanced
from cdpr_sim.anymodel.forces import OutOfTime
from cdpr_sim.anymodel.friction import SLIDES
from cdpr_sim.anymodel.islands import coordinates_of, islands_at
from cdpr_sim.anymodel.judged import Judged
from cdpr_sim.anymodel.stiffness import Modes

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


@dataclass(eq=False)
class _Search:
    """Search of one island: its lowest residual, the damping of its steps, iterations in vain, and its step."""

    lowest: float = np.inf
    level: float = 1e-3
    stuck: int = 0
    ended: bool = False
    modes: Modes | None = None
    along: np.ndarray | None = None
    size: float = 0.0
    fraction: float = 1.0
    accepted: bool = True

    def begin(self, state: Unbalanced, tolerance: float) -> bool:
        """Take note of the balance before a step; whether it is the best so far. The search may end here."""
        gained, better = state.residual < 0.5 * self.lowest, state.residual < self.lowest
        slides = state.held.largest >= SLIDES and not state.residual < 0.9 * self.lowest
        self.stuck = self.stuck + 1 if slides else 0
        self.lowest = min(self.lowest, state.residual)
        done = self.lowest <= tolerance and (not gained or state.residual <= TARGET)
        hopeless = not np.isfinite(state.residual) or state.held.free.shape[1] == 0
        self.ended = done or hopeless or self.stuck > PATIENCE
        return better

    def aim(self, found: Modes, force: np.ndarray, reach: np.ndarray) -> None:
        """Choose the step at a pose where ``force`` is unbalanced."""
        push, largest = found.directions.T @ force, float(np.abs(found.eigenvalues).max())
        size = float(np.linalg.norm(push))
        soft = np.abs(found.eigenvalues) < max(found.floor, SOFT * largest)
        along = push / (np.abs(found.eigenvalues) + self.level * largest + 1e-300)
        if np.all(found.eigenvalues[~soft] > 0):
            stiff = found.directions[:, ~soft]
            exact = np.linalg.lstsq(stiff.T @ found.stiffness @ stiff, push[~soft], rcond=None)[0]
            if exact @ push[~soft] > 0:
                along[~soft] = exact
        along[soft] = np.where(np.abs(push[soft]) > 1e-9 * size, push[soft], 0)  # over 1/s²
        step = np.abs(found.directions @ along)
        along *= min(1.0, float(np.min(reach / np.maximum(step, 1e-300))))
        self.modes, self.along, self.size, self.fraction, self.accepted = found, along, size, 1.0, False

    def step(self) -> np.ndarray:
        """The present fraction of the step."""
        assert self.modes is not None
        assert self.along is not None
        return self.fraction * (self.modes.directions @ self.along)

    def judge(self, force: np.ndarray) -> None:
        """Accept the step, by the force after it, or shorten it; the search ends where it becomes too short."""
        assert self.modes is not None
        assert self.along is not None
        push = self.modes.directions.T @ force
        after = float(np.linalg.norm(push))
        falls = after < (1 - 1e-4 * self.fraction) * self.size
        self.accepted = falls or bool(push @ self.along > 0 and after < 1.5 * self.size)
        if self.accepted:
            self.level = min(1.0, self.level * 10) if self.fraction < 0.2 else max(1e-12, self.level / 5)
            return
        self.fraction /= 2
        if self.fraction < SHORTEST:
            self.fraction, self.accepted, self.ended = 0.0, True, True


def newton(
    balance: Balance, qpos: Float[np.ndarray, " nq"], dofs: Int[np.ndarray, " n"], *, tolerance: float, deadline: float
) -> tuple[Float[np.ndarray, " nq"], int]:
    """Search for an equilibrium of the degrees of freedom ``dofs``; the others stay where they are.

    Returns:
        The best pose found of each island, and the number of iterations.
    """
    forces = balance.forces
    model, best, count = forces.model, np.array(qpos), 0
    extent = max(float(model.stat.extent), 0.1)
    reach = np.where(balance.translates, REACH[0] * extent, REACH[1])
    searches: defaultdict[bytes, _Search] = defaultdict(_Search)
    with contextlib.suppress(OutOfTime), forces.until(deadline):
        while count < ITERATIONS:
            parts = [part for part in islands_at(forces, qpos, dofs) if not searches[part.tobytes()].ended]
            if not parts:
                break
            judged, every = Judged(balance, qpos, parts), [searches[part.tobytes()] for part in parts]
            for part, one, state in zip(parts, every, judged.states, strict=True):
                if one.begin(state, tolerance):
                    where = coordinates_of(model, part)
                    best[where] = qpos[where]
            if any(one.ended for one in every):
                continue
            count += 1
            for part, one, state, found in zip(parts, every, judged.states, judged.modes, strict=True):
                one.aim(found, state.force, reach[part])
            there = qpos
            while not all(one.accepted for one in every):
                step = np.zeros(model.nv)
                for part, one in zip(parts, every, strict=True):
                    step[part] = one.step()
                there = forces.moved(qpos, step)
                force = judged.force(there)
                for part, one in zip(parts, every, strict=True):
                    if not one.accepted:
                        one.judge(force[part])
            qpos = there
    return best, count

"""Judgement of a pose, island by island: balance, stability and linearised motion."""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np
from jaxtyping import Float, Int
from scipy.linalg import eigvals

from cdpr_sim.anymodel.balance import Balance
from cdpr_sim.anymodel.forces import RestForces
from cdpr_sim.anymodel.islands import islands_at
from cdpr_sim.anymodel.names import joints_of, movers
from cdpr_sim.anymodel.stiffness import STEP, Modes, modes, slopes, stiffness_of

LARGEST = 400
"""Degrees of freedom of an island above which the linearised motion is not judged."""


class Judged:
    """The balance and the modes at a pose, of several islands."""

    def __init__(self, balance: Balance, qpos: Float[np.ndarray, " nq"], islands: list[Int[np.ndarray, "..."]]) -> None:
        self.balance, self.qpos, self.islands = balance, qpos, islands
        net = balance.forces.net(qpos)
        self.rows = balance.rows()
        self.states = balance.evaluated(net, self.rows, islands)
        self.force = balance.following(self.rows, self.states)

    @classmethod
    def at(cls, balance: Balance, qpos: Float[np.ndarray, " nq"], dofs: Int[np.ndarray, " n"]) -> Judged:
        """All islands among some degrees of freedom."""
        return cls(balance, qpos, islands_at(balance.forces, qpos, dofs))

    def rests(self, residual: float, of_load: float) -> bool:
        """Whether all forces balance, each island by its own scale."""
        return all(state.residual <= residual and state.of_load <= of_load for state in self.states)

    @property
    def residual(self) -> float:
        """The largest residual of an island."""
        return max((state.residual for state in self.states), default=0.0)

    @cached_property
    def modes(self) -> list[Modes]:
        """Of each island."""
        forces = self.balance.forces
        matrices = stiffness_of(forces, self.qpos, self.islands, self.force)
        forces.net(self.qpos)
        mass, every = forces.mass(), zip(self.islands, self.states, matrices, strict=True)
        return [modes(mass[np.ix_(part, part)], state.held.free, matrix) for part, state, matrix in every]

    def spread(self, island: int, values: Float[np.ndarray, " n"]) -> Float[np.ndarray, " nv"]:
        """Values of an island's degrees of freedom among all."""
        full = np.zeros(self.balance.forces.model.nv)
        full[self.islands[island]] = values
        return full

    @property
    def eigenvalues(self) -> Float[np.ndarray, " free"]:
        """Of the stiffness of all islands, ascending [1/s²]."""
        return np.sort(np.concatenate([np.zeros(0), *(one.eigenvalues for one in self.modes)]))

    @property
    def neutral_directions(self) -> list[Float[np.ndarray, "..."]]:
        """Directions in which nothing resists."""
        return [
            self.spread(island, one.directions[:, column])
            for island, one in enumerate(self.modes)
            for column in np.flatnonzero(np.abs(one.eigenvalues) <= one.floor)
        ]

    @property
    def resisting_directions(self) -> Float[np.ndarray, "directions nv"]:
        """Directions in which forces resist or push away, but friction does not hold, in rows; of unit mass."""
        every = [
            self.spread(island, one.directions[:, column])
            for island, one in enumerate(self.modes)
            for column in np.flatnonzero(np.abs(one.eigenvalues) > one.floor)
        ]
        return np.array(every).reshape(len(every), self.balance.forces.model.nv)

    @property
    def unstable_directions(self) -> list[Float[np.ndarray, "..."]]:
        """Directions in which the forces push away, the worst of each island."""
        return [
            self.spread(island, one.directions[:, 0])
            for island, one in enumerate(self.modes)
            if len(one.eigenvalues) and one.eigenvalues[0] < -one.floor
        ]

    @property
    def elastic_direction(self) -> Float[np.ndarray, " nv"]:
        """A direction in which forces resist and no friction acts: equal forces on all modes; its largest part is 1."""
        total = np.zeros(self.balance.forces.model.nv)
        for island, (one, state) in enumerate(zip(self.modes, self.states, strict=True)):
            resist, apart = one.eigenvalues > one.floor, state.held.apart
            if resist.any() and apart.shape[1]:
                every = one.directions[:, resist] @ (1 / one.eigenvalues[resist])
                total += self.spread(island, apart @ np.linalg.lstsq(apart, every, rcond=None)[0])
        return total / max(float(np.abs(total).max(initial=0.0)), 1e-300)

    @property
    def unstable(self) -> tuple[str, ...]:
        """Names of the joints that move along the unstable directions."""
        model = self.balance.forces.model
        return tuple(dict.fromkeys(name for one in self.unstable_directions for name in movers(model, one)))

    @cached_property
    def growths(self) -> list[float]:
        """Of each island, the largest real part of the eigenvalues of the linearised motion [1/s]."""
        every = zip(self.islands, self.modes, strict=True)
        return [growth(self.balance.forces, self.qpos, part, one) for part, one in every]

    @property
    def growing(self) -> tuple[str, ...]:
        """Names of the joints of the islands in which an oscillation grows."""
        model, every = self.balance.forces.model, zip(self.islands, self.growths, strict=True)
        return tuple(name for part, one in every if one > 0 for name in joints_of(model, part))


def growth(forces: RestForces, qpos: Float[np.ndarray, " nq"], dofs: Int[np.ndarray, " n"], found: Modes) -> float:
    """Largest real part of the eigenvalues of M a + C v + K x = 0 on the directions that are not neutral [1/s].

    M with the constraints' part, whose force depends on the acceleration. A real part that rounding explains is 0.
    """
    stiff = found.directions[:, np.abs(found.eigenvalues) > found.floor]
    if not stiff.shape[1]:
        return 0.0
    if len(dofs) > LARGEST:
        return float("nan")
    full = np.zeros((forces.model.nv, stiff.shape[1]))
    full[dofs] = stiff
    damping = slopes(lambda step: forces.net(qpos, step).force, full, STEP)[dofs]
    inertia = slopes(lambda step: forces.net(qpos, 0.0, step).force, full, STEP)[dofs]
    mass = stiff.T @ (found.mass @ stiff + inertia)
    c, k = stiff.T @ damping, stiff.T @ found.stiffness @ stiff
    size = len(mass)
    solved = np.linalg.solve(mass, np.hstack([-k, -c]))
    roots: Any = eigvals(np.vstack([np.hstack([np.zeros((size, size)), np.eye(size)]), solved]))
    rounding = 1e-6 * float(np.abs(roots).max())
    return float(max(roots.real.max(), 0.0)) if roots.real.max() > rounding else min(0.0, float(roots.real.max()))

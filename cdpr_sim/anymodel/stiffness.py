"""Stiffness of a model at rest, in the tangent space, and its modes in the metric of the masses."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int
from scipy.linalg import eigh

from cdpr_sim.anymodel.forces import RestForces

STEP = 1e-6
"""[m, rad] Of central differences: with it, rounding and curvature leave about 1e-9 of the stiffness."""

NEUTRAL = 1e-4
"""[1/s²] A direction with a smaller squared frequency is neutral: its period is longer than ten minutes."""

ROUNDING = 1e-9
"""And so is one with less than this fraction of the largest, which the differences do not resolve."""


@dataclass(frozen=True, eq=False)
class Modes:
    """Stiffness and its modes, on some degrees of freedom and there on the free directions.

    Attributes:
        stiffness: -d net / d q, (n, n) [N/m, N m/rad]; not symmetric under follower forces.
        eigenvalues: of its symmetric part in the metric of the masses, ascending [1/s²].
        directions: the modes in columns, (n, free), of unit mass.
        mass: (n, n).
    """

    stiffness: Float[np.ndarray, "n n"]
    eigenvalues: Float[np.ndarray, " free"]
    directions: Float[np.ndarray, "n free"]
    mass: Float[np.ndarray, "n n"]

    @property
    def floor(self) -> float:
        """Magnitude [1/s²] below which an eigenvalue is neutral."""
        return max(NEUTRAL, ROUNDING * float(np.abs(self.eigenvalues).max(initial=0)))


def stiffness_of(
    forces: RestForces,
    qpos: Float[np.ndarray, " nq"],
    dofs: Int[np.ndarray, " n"],
    force: Callable[[np.ndarray], np.ndarray] | None = None,
) -> Float[np.ndarray, "n n"]:
    """-d force / d q of the degrees of freedom ``dofs``, by central differences; default: of the net force."""
    at = force or (lambda there: forces.net(there).force[dofs])
    matrix = np.empty((len(dofs), len(dofs)))
    step = np.zeros(forces.model.nv)
    for column, dof in enumerate(dofs):
        step[dof] = STEP
        matrix[:, column] = (at(forces.moved(qpos, -step)) - at(forces.moved(qpos, step))) / (2 * STEP)
        step[dof] = 0.0
    return matrix


def stiffness_of_islands(
    forces: RestForces, qpos: Float[np.ndarray, " nq"], islands: list[Int[np.ndarray, "..."]]
) -> list[Float[np.ndarray, "..."]]:
    """The same of islands, which do not depend on each other: they are displaced together."""
    matrices = [np.empty((len(dofs), len(dofs))) for dofs in islands]
    for column in range(max((len(dofs) for dofs in islands), default=0)):
        step = np.zeros(forces.model.nv)
        step[[dofs[column] for dofs in islands if column < len(dofs)]] = STEP
        change = forces.net(forces.moved(qpos, -step)).force - forces.net(forces.moved(qpos, step)).force
        for matrix, dofs in zip(matrices, islands, strict=True):
            if column < len(dofs):
                matrix[:, column] = change[dofs] / (2 * STEP)
    return matrices


def modes(
    forces: RestForces,
    qpos: Float[np.ndarray, " nq"],
    dofs: Int[np.ndarray, " n"],
    free: Float[np.ndarray, "n free"],
    matrix: Float[np.ndarray, "n n"],
) -> Modes:
    """The modes of a stiffness on the free directions (columns)."""
    forces.net(qpos)
    mass = forces.mass()[np.ix_(dofs, dofs)]
    within = free.T @ mass @ free
    within += 1e-15 * np.trace(within) * np.eye(len(within))
    eigenvalues, directions = eigh(free.T @ (matrix + matrix.T) @ free / 2, within)
    return Modes(matrix, eigenvalues, free @ directions, mass)

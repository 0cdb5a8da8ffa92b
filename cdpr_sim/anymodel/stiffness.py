"""Stiffness of a model at rest, in the tangent space, and its modes in the metric of the masses."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int
from scipy.linalg import eigh

from cdpr_sim.anymodel.forces import RestForces
from cdpr_sim.anymodel.islands import displaced_together

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
    parts: list[Int[np.ndarray, "..."]],
    force: Callable[[np.ndarray], np.ndarray] | None = None,
) -> list[Float[np.ndarray, "..."]]:
    """-d force / d q of islands, by central differences; what does not depend on each other is displaced together.

    Args:
        forces: the forces at rest.
        qpos: the pose.
        parts: the degrees of freedom of each island.
        force: of all degrees of freedom, as a function of the pose; default: the net force.
    """
    at = force or (lambda there: forces.net(there).force)
    model = forces.model
    place, island = np.zeros(model.nv, dtype=int), np.full(model.nv, -1)
    for number, dofs in enumerate(parts):
        place[dofs], island[dofs] = np.arange(len(dofs)), number
    matrices = [np.zeros((len(dofs), len(dofs))) for dofs in parts]
    forces.net(qpos)
    for together in displaced_together(model, forces.data):
        wanted = [(dof, felt[island[felt] == island[dof]]) for dof, felt in together if island[dof] >= 0]
        if not wanted:
            continue
        step = np.zeros(model.nv)
        step[[dof for dof, _ in wanted]] = STEP
        change = at(forces.moved(qpos, -step)) - at(forces.moved(qpos, step))
        for dof, felt in wanted:
            matrices[island[dof]][place[felt], place[dof]] = change[felt] / (2 * STEP)
    return matrices


def slopes(
    force: Callable[[np.ndarray], Float[np.ndarray, " nv"]], directions: Float[np.ndarray, "nv n"], size: float
) -> Float[np.ndarray, "nv n"]:
    """Change of minus the force along each direction, by central differences over ``size``."""
    found = np.empty_like(directions)
    for column in range(directions.shape[1]):
        step = size * directions[:, column]
        found[:, column] = (force(-step) - force(step)) / (2 * size)
    return found


def modes(mass: Float[np.ndarray, "n n"], free: Float[np.ndarray, "n free"], matrix: Float[np.ndarray, "n n"]) -> Modes:
    """The modes of a stiffness on the free directions (columns)."""
    within = free.T @ mass @ free
    within += 1e-15 * np.trace(within) * np.eye(len(within))
    eigenvalues, directions = eigh(free.T @ (matrix + matrix.T) @ free / 2, within)
    return Modes(matrix, eigenvalues, free @ directions, mass)

"""Newton's method island by island: each has its own steps, and one without an equilibrium does not stop the others."""

from __future__ import annotations

import time

import numpy as np
from jaxtyping import Float, Int

from cdpr_sim.anymodel.balance import Balance
from cdpr_sim.anymodel.islands import islands
from cdpr_sim.anymodel.newton import newton

ROUNDS = 5
"""Number of times that islands are found again: bodies that were apart may touch."""


def newton_by_islands(
    balance: Balance,
    qpos: Float[np.ndarray, " nq"],
    dofs: Int[np.ndarray, " n"],
    *,
    tolerance: float,
    deadline: float,
) -> tuple[Float[np.ndarray, " nq"], int]:
    """Where Newton's method ends, and its number of iterations."""
    forces, total = balance.forces, 0
    for _ in range(ROUNDS):
        forces.net(qpos)
        parts = islands(forces.model, forces.data, dofs)
        for part in parts:
            end = newton(balance, qpos, part, tolerance=tolerance, deadline=deadline)
            qpos, total = end.qpos, total + end.iterations
        forces.net(qpos)
        after = islands(forces.model, forces.data, dofs)
        same = len(after) == len(parts) and all(np.array_equal(a, b) for a, b in zip(parts, after, strict=True))
        if same or time.monotonic() > deadline:
            break
    return qpos, total

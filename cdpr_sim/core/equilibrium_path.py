"""``EquilibriumPath``: equilibria one after another, of ropes with a memory, and the memory at the end."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from cdpr_sim.core.equilibrium_batch import EquilibriumBatch
from cdpr_sim.core.memory import Memory


@dataclass(frozen=True, eq=False, repr=False)
class EquilibriumPath(EquilibriumBatch):
    """Equilibria along a path, (steps, ...): a batch whose rows follow one another; further dimensions are paths.

    Attributes:
        times: time of each step, (steps,) [s].
        memory: the memory at the end, with which ``solve_path`` and ``settle_path`` can continue.
    """

    times: Float[np.ndarray, " steps"]
    memory: Memory

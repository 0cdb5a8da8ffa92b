"""State of a platform on cables with mass, from MuJoCo: pose, lengths, tensions, residual and stiffness."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import RigidTransform

from cdpr_sim.core.memory import Memory
from cdpr_sim.physics.sagging.chain_derivatives import ChainDerivatives
from cdpr_sim.physics.sagging.chain_simulation import ChainSimulation


@dataclass(frozen=True)
class ChainState:
    """One state at zero velocity, from MuJoCo.

    Attributes:
        pose: pose of the platform.
        lengths: length of each cable [m]; for a cable with mass, its chord.
        tensions: tension of each cable [N]; for a cable with mass, at the platform's end.
        residual: the largest unbalanced force [N].
        eigenvalues: eigenvalues of the stiffness on the free directions [N/m], ascending; nan if unknown.
        softest: direction of the smallest eigenvalue.
        off_wheel: whether a cable is off its wheel.
        memory: of the cables there, without the time; None where none has one.
    """

    pose: RigidTransform
    lengths: Float[np.ndarray, " cables"]
    tensions: Float[np.ndarray, " cables"]
    residual: float
    eigenvalues: Float[np.ndarray, " free"]
    softest: Float[np.ndarray, " free"]
    off_wheel: bool
    memory: Memory | None

    @classmethod
    def of(cls, simulation: ChainSimulation) -> ChainState:
        """The present state at zero velocity and with the true springs."""
        residual = simulation.residual()
        pose, lengths, off_wheel = simulation.pose, simulation.lengths, simulation.off_wheel()
        eigenvalues, softest = ChainDerivatives.of(simulation).stiffness()
        memory = None if simulation.ropes is None else simulation.remembered()
        return cls(pose, lengths, simulation.tensions(), residual, eigenvalues, softest, off_wheel, memory)

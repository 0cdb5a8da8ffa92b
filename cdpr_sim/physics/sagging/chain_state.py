"""What MuJoCo says of a platform on cables with mass where it is: pose, lengths, tensions, and how it is held there."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import RigidTransform

from cdpr_sim.physics.sagging.chain_derivatives import ChainDerivatives
from cdpr_sim.physics.sagging.chain_simulation import ChainSimulation


@dataclass(frozen=True)
class ChainState:
    """What MuJoCo says of one state at zero velocity.

    Attributes:
        pose: the platform's.
        lengths: of each cable [m]; of a heavy one the chord.
        tensions: of each cable [N]; of a heavy one at the platform's end.
        residual: the largest force left over [N].
        eigenvalues: of the stiffness on the free directions [N/m], ascending; nan where it is not known.
        softest: the direction of the first.
        off_wheel: whether a cable is off its wheel.
    """

    pose: RigidTransform
    lengths: Float[np.ndarray, " cables"]
    tensions: Float[np.ndarray, " cables"]
    residual: float
    eigenvalues: Float[np.ndarray, " free"]
    softest: Float[np.ndarray, " free"]
    off_wheel: bool

    @classmethod
    def of(cls, simulation: ChainSimulation) -> ChainState:
        """The present state at zero velocity and with the true springs."""
        residual = simulation.residual()
        pose, lengths, off_wheel = simulation.pose, simulation.lengths, simulation.off_wheel()
        eigenvalues, softest = ChainDerivatives.of(simulation).stiffness()
        return cls(pose, lengths, simulation.tensions(), residual, eigenvalues, softest, off_wheel)

"""Derivatives of the forces around a platform on cables with mass: MuJoCo's own, by small displacements."""

# pyright: reportAttributeAccessIssue=false
# mujoco ships no type stubs for its compiled modules.
from __future__ import annotations

from typing import NamedTuple

import mujoco
import numpy as np
from jaxtyping import Float

from cdpr_sim.physics.sagging.chain_simulation import ChainSimulation

DIFFERENCE = 1e-7
"""Displacement for differencing forces, as a fraction of the mean cable length: smaller than in ``batch``, since
a chain's segments are short and hardly stretched."""

SMALL = 0.01
"""Fraction of the least stretch of a segment. A larger displacement changes that segment's tension, and with it its
transverse stiffness, too much for differences to one side."""


class ChainDerivatives(NamedTuple):
    """Decrease of forces by displacement [N/m].

    Attributes:
        direct: on the platform by its own displacement.
        across: on the slides by the platform's displacement.
        within: on the slides by their own displacement; the slides of different chains do not interact.
    """

    direct: Float[np.ndarray, "free free"]
    across: Float[np.ndarray, "chains slides free"]
    within: Float[np.ndarray, "chains slides slides"]

    @classmethod
    def of(cls, simulation: ChainSimulation, *, quick: bool = False) -> ChainDerivatives:
        """Central differences as in ``batch``, with all chains displaced together.

        Args:
            simulation: at zero velocity, with its wheels turned, and with the forces of its coordinates.
            quick: displace to one side only, where all segments are so taut that this suffices for a step.
        """
        model, data, slides, free = simulation.model, simulation.data, simulation.slides, simulation.free
        band, springs, polynomials = (
            model.tendon_lengthspring.copy(), model.tendon_stiffness.copy(), model.tendon_stiffnesspoly.copy()
        )  # fmt: skip
        taut = data.ten_length > band[:, 1]
        model.tendon_lengthspring[:] = np.where(taut, band[:, 1], band[:, 0])[:, None]
        model.tendon_stiffness[~taut] = model.tendon_stiffnesspoly[~taut] = 0
        rest = data.qpos.copy()
        step = DIFFERENCE * float(simulation.rest_lengths.mean())

        stretches = (data.ten_length - band[:, 1])[simulation.chains.segments]
        central = not quick or bool(step > SMALL * stretches.min())
        here = simulation.forces()

        def displaced(move: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            data.qpos[:] = rest
            mujoco.mj_integratePos(model, data.qpos, move, 1)
            simulation.turn_wheels()
            mujoco.mj_forward(model, data)
            return simulation.forces()

        def change(move: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            before, after = displaced(-move) if central else here, displaced(move)
            apart = 2 * step if central else step
            return (before[0] - after[0]) / apart, (before[1] - after[1]) / apart

        direct = np.empty((free, free))
        across = np.empty((*slides.shape, free))
        within = np.empty((*slides.shape, slides.shape[1]))
        moves = [simulation.in_dofs(step * axis) for axis in np.eye(free)]
        for j, move in enumerate(moves):
            direct[:, j], across[:, :, j] = change(move)
        for j in range(slides.shape[1]):
            move = np.zeros(model.nv)
            move[slides[:, j]] = step
            _, within[:, :, j] = change(move)
        data.qpos[:] = rest
        model.tendon_lengthspring[:], model.tendon_stiffness[:] = band, springs
        model.tendon_stiffnesspoly[:] = polynomials
        mujoco.mj_forward(model, data)
        return cls(direct, across, within)

    @property
    def known(self) -> bool:
        """Whether all forces were finite."""
        return bool(np.isfinite(self.direct).all() and np.isfinite(self.within).all())

    def stiffness(self) -> tuple[Float[np.ndarray, " free"], Float[np.ndarray, " free"]]:
        """Eigenvalues [N/m], ascending, of the stiffness of the platform; and the direction of the smallest one.

        The masses' degrees of freedom are condensed out; nan if the derivatives are unknown.
        """
        if not self.known:
            return np.full(len(self.direct), np.nan), np.full(len(self.direct), np.nan)
        stiffness = self.direct - sum(
            a.T @ np.linalg.lstsq((k + k.T) / 2, a, rcond=None)[0]
            for a, k in zip(self.across, self.within, strict=True)
        )
        values, vectors = np.linalg.eigh((stiffness + stiffness.T) / 2)
        return values, vectors[:, 0]

    def following(self, x: Float[np.ndarray, " free"]) -> Float[np.ndarray, "chains slides"]:
        """Displacements of the slides with which the masses stay in balance where the platform moves by x [m]."""
        return -(np.linalg.pinv(self.within) @ self.across) @ x

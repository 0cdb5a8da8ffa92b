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


def _balanced(nodes: int) -> Float[np.ndarray, " nodes"]:
    """Numbers of similar size, none zero, whose sum is zero: 1, -1, ..., and 1, 1, -2 at the end of an odd number."""
    numbers = np.where(np.arange(nodes) % 2 == 0, 1.0, -1.0)
    if nodes % 2:
        numbers[-2:] = 1, -2
    return numbers


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
        here = simulation.net.copy(), simulation.rotation.copy()

        def displaced(move: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            data.qpos[:] = rest
            mujoco.mj_integratePos(model, data.qpos, move, 1)
            simulation.turn_wheels()
            simulation.evaluate()
            return simulation.net.copy(), simulation.rotation.copy()

        def slopes(moves: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            """Decrease of ``ChainSimulation.forces`` per step along each of (n, dofs) moves, which come last."""
            sides = [displaced(-move) for move in moves] if central else [here] * len(moves)
            sides += [displaced(move) for move in moves]
            forces = simulation.split(*(np.array(each) for each in zip(*sides, strict=True)))
            apart = 2 * step if central else step
            platform, nodes = ((each[: len(moves)] - each[len(moves) :]) / apart for each in forces)
            return np.moveaxis(platform, 0, -1), np.moveaxis(nodes, 0, -1)

        def along_slides(distances: np.ndarray) -> np.ndarray:
            """Decrease of forces on nodes displaced by these distances along each axis, (chains, nodes, 3, 3)."""
            moves = np.zeros((3, model.nv))
            moves[:, slides] = step * np.kron(distances, np.eye(3))[:, None]
            return slopes(moves)[1].reshape(len(slides), len(distances), 3, 3)

        direct, across = slopes(np.array([simulation.in_dofs(step * axis) for axis in np.eye(free)]))
        # A slide extends its own segment and the first one. Distances whose sum is zero leave the first as it is.
        distances = _balanced(slides.shape[1] // 3)
        own = along_slides(distances) / distances[:, None, None]
        # A translation of the platform extends the first segments only; a planar one makes none along y.
        alone = np.eye(len(distances))[0]
        first = across[:, :3, :3] @ simulation.rotation if free == 6 else along_slides(alone)[:, -1]
        within = np.tile(first, (1, len(distances), len(distances)))
        for k in range(len(distances)):
            node = slice(3 * k, 3 * k + 3)
            within[:, node, node] += own[:, k]
        data.qpos[:] = rest
        model.tendon_lengthspring[:], model.tendon_stiffness[:] = band, springs
        model.tendon_stiffnesspoly[:] = polynomials
        simulation.evaluate()
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
        within = (self.within + np.swapaxes(self.within, 1, 2)) / 2
        loose = np.linalg.pinv(within, rcond=within.shape[-1] * np.finfo(float).eps, hermitian=True)
        stiffness = self.direct - (np.swapaxes(self.across, 1, 2) @ loose @ self.across).sum(0)
        values, vectors = np.linalg.eigh((stiffness + stiffness.T) / 2)
        return values, vectors[:, 0]

    def following(self, x: Float[np.ndarray, " free"]) -> Float[np.ndarray, "chains slides"]:
        """Displacements of the slides with which the masses stay in balance where the platform moves by x [m]."""
        return -(np.linalg.pinv(self.within) @ self.across) @ x

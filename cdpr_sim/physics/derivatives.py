"""Derivatives of the forces around platforms: MuJoCo's own, by small displacements."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from cdpr_sim.physics.simulations import Rows, Simulations

DIFFERENCE, FINE = 3e-6, 1e-7
"""Displacement for differencing forces, as a fraction of the mean cable length: near the cube root of rounding, where
the error of truncation (its square) equals that of rounding (its inverse); and a smaller one, for chains, whose
segments are short and hardly stretched, and for differences to one side, whose error of truncation is larger."""

SMALL = 0.01
"""Fraction of the least stretch of a segment. A larger displacement changes that segment's tension, and with it its
transverse stiffness, too much for differences to one side."""


def _balanced(nodes: int) -> Float[np.ndarray, " nodes"]:
    """Numbers of similar size, none zero, whose sum is zero: 1, -1, ..., and 1, 1, -2 at the end of an odd number."""
    numbers = np.where(np.arange(nodes) % 2 == 0, 1.0, -1.0)
    if nodes % 2:
        numbers[-2:] = 1, -2
    return numbers


class Derivatives(NamedTuple):
    """Decrease of forces by displacement [N/m], of some rows.

    Where the platform rotates, its chains keep their directions in space (``Simulations.displaced``).

    Attributes:
        direct: on the platform, with its chains, by its own displacement.
        across: on the slides by the platform's displacement.
        within: on the slides by their own displacement; the slides of different chains do not interact.
        carried: displacements of the slides by that of the platform [m/m], through which forces on them act on it.
        truncation: relative error of central differences, of the square of the largest rotation.
    """

    direct: Float[np.ndarray, "some free free"]
    across: Float[np.ndarray, "some chains slides free"]
    within: Float[np.ndarray, "some chains slides slides"]
    carried: Float[np.ndarray, "some chains slides free"]
    truncation: Float[np.ndarray, " some"]

    @classmethod
    def of(cls, simulations: Simulations, at: Rows, *, quick: bool = False) -> Derivatives:
        """Central differences, with all chains displaced together.

        On the cables that are stretched now: during the differencing these may push and others have no force, so that a
        displacement does not cross the kink of a cable that is stretched by less; and no element of a memory begins or
        ends to slide. The wheels follow the platform.

        Args:
            simulations: at zero velocity, with their wheels turned, and with the forces of their coordinates.
            at: the rows.
            quick: displace to one side only, where all segments are so taut that this suffices for a step.
        """
        slides, free, nodes = simulations.slides, simulations.free, simulations.slides.shape[1] // 3
        step = (FINE if quick or simulations.heavy else DIFFERENCE) * simulations.size[at]
        # A slide extends its own segment and the first one. Distances whose sum is zero leave the first as it is. A
        # translation of the platform extends the first segments only; a planar one makes none along y.
        distances = _balanced(nodes)
        along_slides = ([distances] if free == 6 else [distances, np.eye(nodes)[0]]) if simulations.heavy else []
        moves = np.zeros((len(at), free + 3 * len(along_slides), simulations.model.nv))
        moves[:, :free] = simulations.in_dofs(at, np.broadcast_to(np.eye(free), (len(at), free, free)))
        for k, along in enumerate(along_slides):
            some = slice(free + 3 * k, free + 3 * k + 3)
            moves[:, some, slides] = np.kron(along, np.eye(3))[:, None]
        platform, masses = _slopes(simulations, at, step, moves, quick)
        truncation = (step / simulations.length) ** 2
        if not simulations.heavy:
            nothing = np.zeros((len(at), *simulations.slides.shape, free))
            within = np.zeros((len(at), *simulations.slides.shape, simulations.slides.shape[1]))
            return cls(np.moveaxis(platform, 1, -1), nothing, within, nothing, truncation)
        carried = _carried(simulations, at)
        platform = platform + np.einsum("rmcs,rcsf->rmf", masses, carried)

        direct, across = np.moveaxis(platform[:, :free], 1, -1), np.moveaxis(masses[:, :free], 1, -1)
        nodewise = np.moveaxis(masses[:, free:].reshape(len(at), len(along_slides), 3, len(slides), nodes, 3), 2, -1)
        own = nodewise[:, 0] / distances[:, None, None]
        first = across[:, :, :3, :3] @ simulations.rotations[at, None] if free == 6 else nodewise[:, 1, :, -1]
        within = np.tile(first, (1, 1, nodes, nodes))
        for k in range(nodes):
            node = slice(3 * k, 3 * k + 3)
            within[:, :, node, node] += own[:, :, k]
        return cls(direct, across, within, carried, truncation)

    @property
    def known(self) -> Bool[np.ndarray, " some"]:
        """Whether all forces were finite."""
        known = np.isfinite(self.direct).all((1, 2))
        return np.asarray(known & np.isfinite(self.within).all((1, 2, 3)) if self.within.size else known)

    def stiffness(self) -> tuple[Float[np.ndarray, "some free"], Float[np.ndarray, "some free"]]:
        """Eigenvalues [N/m], ascending, of the stiffness of the platforms; and the directions of the smallest ones.

        The masses' degrees of freedom are condensed out, mode by mode of each chain: the product with an inverse would
        lose the soft modes beside the stiff ones. Modes below the noise of the differences, which shows as asymmetry,
        are left out; eigenvalues within the error that this noise and truncation cause are 0. The result is nan if the
        derivatives are unknown.
        """
        known = self.known
        direct, across, within, carried, truncation = (part[known] for part in self)
        stiffness, noise, follow = direct, None, across
        if within.size:
            modal, modes = np.linalg.eigh((within + within.swapaxes(2, 3)) / 2)
            rounding = within.shape[-1] * np.finfo(float).eps * np.abs(modal).max(2)
            noise = np.maximum(np.abs(within - within.swapaxes(2, 3)).max((2, 3)), rounding)
            loose = np.divide(1, modal, out=np.zeros_like(modal), where=np.abs(modal) > noise[..., None])
            pulled = modes.swapaxes(2, 3) @ across
            follow = loose[..., None] * pulled
            stiffness = direct - (pulled.swapaxes(2, 3) @ follow).sum(1)
        values, vectors = np.linalg.eigh((stiffness + stiffness.swapaxes(1, 2)) / 2)
        error = truncation[:, None] * np.abs(values).max(1, keepdims=True)
        if noise is not None:
            turning, following = (np.abs(moved @ vectors[:, None]).sum(2) for moved in (carried, follow))
            error = error + (noise[..., None] * (1 + turning + following) * (1 + following)).sum(1)
        values[np.abs(values) <= error] = 0
        eigenvalues, softest = np.full((2, *self.direct.shape[:2]), np.nan)
        eigenvalues[known], softest[known] = values, vectors[:, :, 0]
        return eigenvalues, softest

    def following(self, x: Float[np.ndarray, "some free"]) -> Float[np.ndarray, "some chains slides"]:
        """Displacements of the slides with which the masses stay in balance where the platforms move by x [m]."""
        return -((np.linalg.pinv(self.within) @ self.across) @ x[:, None, :, None])[..., 0]


def _carried(simulations: Simulations, at: Rows) -> Float[np.ndarray, "some chains slides free"]:
    """Displacements of the slides, in the platform's frame, with which chains keep their directions in space."""
    turns = simulations.rotations[at] if simulations.free == 6 else simulations.rotations[at, 1:2]
    extents = simulations.qpos[at][:, simulations.chains.coordinates]
    carried = np.zeros((len(at), *simulations.slides.shape, simulations.free))
    moved = np.cross(extents[..., None, :], turns[:, None, None]) / simulations.length
    carried[..., simulations.angular] = moved.swapaxes(-1, -2).reshape(*carried.shape[:3], turns.shape[1])
    return carried


def _slopes(
    simulations: Simulations,
    at: Rows,
    step: Float[np.ndarray, " some"],
    moves: Float[np.ndarray, "some moves dofs"],
    quick: bool,
) -> tuple[Float[np.ndarray, "some moves free"], Float[np.ndarray, "some moves chains slides"]]:
    """Decrease of ``Simulations.forces`` along moves, by differences of ``step`` [m]."""
    bands, stiffnesses, further = simulations.tangents(at)
    lengths, qpos = simulations.ten_length[at], simulations.qpos[at, None]
    loose = (lengths >= bands[..., 0]) & (lengths <= bands[..., 1])
    ends = np.where(lengths > bands[..., 1], bands[..., 1], bands[..., 0])
    springs = np.stack([ends, ends], axis=-1), np.where(loose, 0, stiffnesses), np.where(loose[..., None], 0, further)
    central = np.full(len(at), not quick)
    if simulations.heavy:
        stretches = (lengths - bands[..., 1])[:, simulations.chains.segments]
        central |= step > SMALL * stretches.min((1, 2))
    there, count = step[:, None, None] * moves, moves.shape[1]
    if not (quick or simulations.heavy):
        both = simulations.displaced(qpos, np.concatenate([there, -there], axis=1))
        found = simulations.forces_at(at, both, springs)
        width = 2 * step[:, None, None]
        platform, slides = (forces[:, count:] - forces[:, :count] for forces in found)
        return platform / width, slides / width[..., None]
    after = simulations.forces_at(at, simulations.displaced(qpos, there), springs)
    before = [np.repeat(forces[:, None], count, axis=1) for forces in simulations.forces(at)]
    if central.any():
        behind = simulations.displaced(qpos[central], -there[central])
        found = simulations.forces_at(at[central], behind, tuple(field[central] for field in springs))
        for forces, ones in zip(before, found, strict=True):
            forces[central] = ones
    width = np.where(central, 2 * step, step)
    platform, slides = (a - b for a, b in zip(before, after, strict=True))
    return platform / width[:, None, None], slides / width[:, None, None, None]

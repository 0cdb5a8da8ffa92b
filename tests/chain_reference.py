"""A cable as a chain of finitely many pieces: springs that only pull, in a row, between nodes that have the weight.

A simulator replaces a cable with mass by such a chain. The mathematics solves the same finite chain, so
that the two can be compared to the last digit, and the chain with the catenary, its limit.

Let t be the tension at the exit end, a vector, and W_1, W_2, ... the weights of the nodes between; then piece j is
under the tension t_j = t + (W_1 + ... + W_(j−1)) up, and from exit to anchor a chain of pieces ℓ_j at rest spans

    d(t) = Σ ℓ_j (1/EA + 1/|t_j|) t_j = ∂/∂t Σ ℓ_j (|t_j|²/(2 EA) + |t_j|),

the slope of a convex function. A piece without tension has any length up to ℓ_j, and any direction.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from cdpr_sim.core.problem import Problem
from cdpr_sim.statics.forces import cross_matrix, load_wrench
from cdpr_sim.statics.profiles import catenary

Array = np.ndarray

MAX_ITERATIONS = 200
"""Largest number of steps of either Newton iteration; about ten suffice."""

ENOUGH = 4 * np.finfo(float).eps
"""Largest distance between a chain's end and its anchor, per length."""

BALANCED = 1e-12
"""Unbalanced force of a platform on chains, per load, at the level of rounding."""

UP = np.array([0.0, 0.0, 1.0])


class Division(NamedTuple):
    """How a cable is divided. lengths: of pieces, (pieces,); weights: of nodes, both ends included, (pieces + 1,).

    As fractions of the whole.
    """

    lengths: Float[Array, " pieces"]
    weights: Float[Array, " nodes"]


class Chain(NamedTuple):
    """State of a hanging chain.

    Attributes:
        pull: force on the anchor, the last node's weight included, base frame, (3,) [N].
        stiffness: −∂pull/∂anchor, symmetric, (3, 3) [N/m].
        energy: of stretch and weight, which is 0 at height 0 [J].
        nodes: their places from exit to anchor, (pieces + 1, 3) [m].
    """

    pull: Float[Array, "3"]
    stiffness: Float[Array, "3 3"]
    energy: float
    nodes: Float[Array, "nodes 3"]


def uniform(pieces: int) -> Division:
    """Equal pieces, half a weight at either end: its error falls by four when the pieces are doubled."""
    weights = np.full(pieces + 1, 1 / pieces)
    weights[[0, -1]] /= 2
    return Division(np.full(pieces, 1 / pieces), weights)


def gauss(pieces: int) -> Division:
    """Pieces and weights by Gauss and Legendre's quadrature along the cable: far better unless it bends sharply."""
    points, weights = np.polynomial.legendre.leggauss(pieces)
    return Division(weights / 2, np.diff(np.r_[-1.0, points, 1.0]) / 2)


def chain(
    exit_: Float[Array, "3"],
    anchor: Float[Array, "3"],
    lengths: Float[Array, " pieces"],
    weights: Float[Array, " nodes"],
    axial_stiffness: float,
) -> Chain:
    """A chain between two points.

    Args:
        exit_: (3,) [m].
        anchor: (3,) [m].
        lengths: of the pieces at rest, from the exit on, (pieces,) [m].
        weights: of the nodes, the one at the exit first, (pieces + 1,) [N].
        axial_stiffness: EA [N].
    """
    hung = np.r_[0.0, np.cumsum(weights[1:-1])][:, None] * UP  # t_j − t
    span = anchor - exit_
    t, slack = _tension(span, lengths, hung, axial_stiffness)
    at = t + hung
    size = np.linalg.norm(at, axis=1)
    pieces = lengths[:, None] * at * (1 / axial_stiffness + 1 / np.where(slack, np.inf, size))[:, None]
    if slack.any():
        pieces[slack] += lengths[slack, None] / lengths[slack].sum() * (span - pieces.sum(0))
    nodes = exit_ + np.vstack([np.zeros(3), np.cumsum(pieces, axis=0)])
    energy = 0.5 * lengths @ size**2 / axial_stiffness + weights @ nodes[:, 2]
    flexibility = _flexibility(at[~slack], lengths[~slack], axial_stiffness)
    stiffness = np.zeros((3, 3)) if slack.any() else np.linalg.inv(flexibility)
    return Chain(-at[-1] - weights[-1] * UP, 0.5 * (stiffness + stiffness.T), float(energy), nodes)


def equilibrium_of_chains(
    problem: Problem,
    lengths: Float[Array, "cables pieces"],
    weights: Float[Array, "cables nodes"],
    position: Float[Array, "3"],
    rotation: Float[Array, "3 3"],
) -> tuple[Float[Array, "3"], Float[Array, "3 3"], float]:
    """Equilibrium of the platform with a chain in place of each cable, by Newton's method from a nearby pose.

    Args:
        problem: robot and load; its rest lengths are those of ``lengths``.
        lengths: of the pieces at rest, (cables, pieces) [m].
        weights: of the nodes, both ends included, (cables, pieces + 1) [N].
        position: to start from, (3,) [m].
        rotation: to start from, (3, 3).

    Returns:
        Position, rotation matrix and the largest unbalanced force [N], torques over characteristic lengths. Steps end
        when they no longer reduce that force; whether it is small enough is decided by the caller.
    """
    robot = problem.robot
    free, units = robot.free, robot.units
    net, K = _balance(problem, lengths, weights, position, rotation)
    residual = np.abs(net).max()
    for _ in range(MAX_ITERATIONS):
        if residual <= BALANCED * problem.load:
            break
        eigenvalues, modes = np.linalg.eigh(K)
        stiff = np.maximum(np.abs(eigenvalues), 1e-9 * np.abs(eigenvalues).max())
        x = np.zeros(6)
        x[free] = modes @ (modes.T @ net / stiff)
        for shorter in 0.5 ** np.arange(12):
            step = shorter * x / units
            trial = position + step[:3], Rotation.from_rotvec(step[3:]).as_matrix() @ rotation
            net, K = _balance(problem, lengths, weights, *trial)
            if np.abs(net).max() < residual:
                break
        else:
            break
        (position, rotation), residual = trial, np.abs(net).max()
    return position, rotation, float(residual)


def _balance(
    problem: Problem,
    lengths: Float[Array, "cables pieces"],
    weights: Float[Array, "cables nodes"],
    position: Float[Array, "3"],
    rotation: Float[Array, "3 3"],
) -> tuple[Float[Array, " free"], Float[Array, "free free"]]:
    """Unbalanced forces and stiffness on the free directions, rotations in characteristic lengths."""
    robot = problem.robot
    net, K = load_wrench(problem, rotation), np.zeros((6, 6))
    center, gravity = rotation @ robot.center_of_mass, -problem.mass * robot.gravity * UP
    K[3:, 3:] = _dipole(gravity, center)
    for i, arm in enumerate(robot.anchors @ rotation.T):
        cable = chain(robot.exits[i], position + arm, lengths[i], weights[i], problem.axial_stiffness[i])
        D = np.hstack([np.eye(3), -cross_matrix(arm)])
        net += D.T @ cable.pull
        K += D.T @ cable.stiffness @ D
        K[3:, 3:] += _dipole(cable.pull, arm)
    K /= np.outer(robot.units, robot.units)
    return (net / robot.units)[robot.free], K[robot.free][:, robot.free]


def _dipole(force: Float[Array, "3"], arm: Float[Array, "3"]) -> Float[Array, "3 3"]:
    """(f·r) 1 − ½ (f rᵀ + r fᵀ): what a force on an arm adds to the stiffness against rotations."""
    outer = np.outer(force, arm)
    return np.trace(outer) * np.eye(3) - 0.5 * (outer + outer.T)


def _tension(
    span: Float[Array, "3"], lengths: Float[Array, " pieces"], hung: Float[Array, "pieces 3"], EA: float
) -> tuple[Float[Array, "3"], np.ndarray]:
    """The tension t at the exit, and which pieces have none: the minimum of Σ ℓ (|t_j|²/(2 EA) + |t_j|) − t·d."""
    for held in np.unique(hung[:, 2]):  # does the minimum lie where pieces lose their tension, in one of its edges?
        slack = hung[:, 2] == held
        at = (hung - held * UP)[~slack]
        size = np.linalg.norm(at, axis=1)
        rest = span - (lengths[~slack] * (1 / EA + 1 / size)) @ at
        if np.linalg.norm(rest) <= lengths[slack].sum():
            return -held * UP, slack
    L0 = lengths.sum()
    weight = hung[-1, 2] * len(lengths) / max(len(lengths) - 1, 1)  # about
    near = catenary(np.zeros(3), span, L0, EA, max(weight / L0, 1e-12 * EA / L0))
    start = -near.pull - 0.5 * (weight + hung[-1, 2]) * UP
    t, off = _minimum(start, span, lengths, hung, EA, 0.0)
    if off > 1e-12 * L0:  # caught at the edge of some piece that hardly pulls: round the edges off, less and less
        t = start
        for blunt in weight * 0.3 ** np.arange(20):
            t, _ = _minimum(t, span, lengths, hung, EA, blunt)
        t, _ = _minimum(t, span, lengths, hung, EA, 0.0)
    return t, np.zeros(len(lengths), bool)


def _minimum(
    t: Float[Array, "3"],
    span: Float[Array, "3"],
    lengths: Float[Array, " pieces"],
    hung: Float[Array, "pieces 3"],
    EA: float,
    blunt: float,
) -> tuple[Float[Array, "3"], float]:
    """By Newton's method from t, with |t_j| as √(|t_j|² + blunt²): the best t, and how far off its chain ends."""

    def value(t: Float[Array, "3"]) -> float:
        size = np.linalg.norm(t + hung, axis=1)
        return float(lengths @ (0.5 * size * size / EA + np.hypot(size, blunt)) - t @ span)

    enough = ENOUGH * (lengths.sum() + np.linalg.norm(span))
    best, least = t, np.inf
    for _ in range(MAX_ITERATIONS):
        at = t + hung
        off = span - (lengths * (1 / EA + 1 / np.hypot(np.linalg.norm(at, axis=1), blunt))) @ at
        if np.linalg.norm(off) < least:
            best, least = t, np.linalg.norm(off)
        if least <= enough:
            break
        step = np.linalg.solve(_flexibility(at, lengths, EA, blunt), off)
        here, slope, shorter = value(t), off @ step, 1.0
        while value(t + shorter * step) > here - 0.1 * shorter * slope + 1e-14 * abs(here):
            shorter *= 0.5
            if shorter < 1e-6:
                return best, float(least)
        t = t + shorter * step
    return best, float(least)


def _flexibility(
    at: Float[Array, "pieces 3"], lengths: Float[Array, " pieces"], EA: float, blunt: float = 0.0
) -> Float[Array, "3 3"]:
    """∂d/∂t = Σ ℓ [1/EA + (1 − u uᵀ)/|t_j|] with the pieces' directions u; of their rounded sizes, if they are."""
    size = np.hypot(np.linalg.norm(at, axis=1), blunt)
    u = at / size[:, None]
    turning = lengths / size
    return (lengths.sum() / EA + turning.sum()) * np.eye(3) - (turning[:, None] * u).T @ u

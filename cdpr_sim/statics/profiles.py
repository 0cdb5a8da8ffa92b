"""The catenary in NumPy, and the profiles of hanging cables, to draw and to measure clearances."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float
from numpy.typing import ArrayLike

from cdpr_sim.core import cable_law, cable_path
from cdpr_sim.core.cable import COLUMNS, GIVES, STIFFNESS, WEIGHT, WRAPPED
from cdpr_sim.core.equilibrium_batch import EquilibriumBatch
from cdpr_sim.core.memory import without_memory
from cdpr_sim.core.robot import Robot
from cdpr_sim.statics.any_cable import Catenary, any_cables
from cdpr_sim.statics.catenary import MASSLESS

TRACE = 1e-12
"""Weight of a massless cable for the computation of its profile, as a fraction of EA/L0: a taut cable stays
straight."""


def catenary(
    exits: ArrayLike, anchors: ArrayLike, rest_lengths: ArrayLike, axial_stiffness: ArrayLike, weights: ArrayLike
) -> Catenary:
    """States of linear cables between points; all arguments broadcast.

    Args:
        exits: base frame, (..., 3) [m].
        anchors: base frame, (..., 3) [m].
        rest_lengths: unstretched lengths, (...) [m].
        axial_stiffness: EA, (...) [N].
        weights: weight per unstretched length, (...) [N/m]; 0 is a massless cable.
    """
    A, L0, EA, w = (np.asarray(v, float) for v in (exits, rest_lengths, axial_stiffness, weights))
    table = np.zeros((*np.broadcast_shapes(EA.shape, w.shape), COLUMNS))
    table[..., STIFFNESS], table[..., WEIGHT] = EA, w
    found = any_cables(table, np.asarray(anchors, float) - A, L0)
    return found._replace(energy=found.energy + w * L0 * A[..., 2])


def profile(
    exits: ArrayLike,
    anchors: ArrayLike,
    rest_lengths: ArrayLike,
    axial_stiffness: ArrayLike,
    weights: ArrayLike,
    points: int,
    rigid: ArrayLike = 0.0,
) -> Float[np.ndarray, "*batch points 3"]:
    """Profile of a cable: points from exit to anchor, equally spaced on the unstretched cable, (..., points, 3) [m].

    Arguments as of ``catenary``. A massless cable has the profile that it has in the limit of small weight. With a part
    of the length ``rigid`` [m] behind the anchor, straight along the cable's end, on which the last points lie.
    """
    A, B = np.asarray(exits, float), np.asarray(anchors, float)
    L0, EA, w = (np.asarray(v, float)[..., None] for v in (rest_lengths, axial_stiffness, weights))
    light = w * L0 <= 2 * MASSLESS * EA
    w = np.where(light, TRACE * EA / L0, w)
    pull = catenary(A, B, L0[..., 0], EA[..., 0], w[..., 0]).pull
    sideways = np.hypot(pull[..., 0], pull[..., 1])[..., None]
    end = -pull[..., 2:] - w * L0  # vertical component of the tension at the exit
    further = np.asarray(rigid, float)[..., None]
    along = np.linspace(0.0, 1.0, points) * (L0 + further)
    s = np.minimum(along, L0)
    both = np.hypot(sideways, end) + np.hypot(sideways, end + w * s)  # sum of the tensions at the exit and at s
    both[both == 0] = np.inf
    t, H = w * s / both, np.where(sideways > 0, sideways, 1.0)
    # The difference of two asinh, by an addition theorem that does not cancel where the cable is nearly straight.
    turned = np.where(t < 0.5, 2 * np.arctanh(np.minimum(t, 0.5)), np.arcsinh((end + w * s) / H) - np.arcsinh(end / H))
    run = sideways * s / EA + sideways * turned / w
    rise = s * (2 * end + w * s) * (0.5 / EA + 1 / both)
    across = -pull[..., None, :2] / H[..., None]
    positions = np.concatenate([across * run[..., None], rise[..., None]], axis=-1) + A[..., None, :]
    span = np.linspace(0.0, 1.0, points)[:, None] * (B - A)[..., None, :]
    straight = light & (np.linalg.norm(B - A, axis=-1)[..., None] > L0)  # the trace of weight is seen at small strains
    positions = np.where(straight[..., None], A[..., None, :] + span, positions)
    with np.errstate(invalid="ignore", divide="ignore"):
        beyond = (along - s)[..., None] * (-pull / np.linalg.norm(pull, axis=-1, keepdims=True))[..., None, :]
    beyond = np.where((along > s)[..., None], beyond, 0.0)
    positions[..., -1, :] = B
    return positions + beyond


def moved_exits(
    equilibria: EquilibriumBatch, exits: Float[np.ndarray, "*#batch cables 3"], anchors: Float[np.ndarray, "..."]
) -> Float[np.ndarray, "*batch cables 3"]:
    """Where exits that give way are under their cables, (..., cables, 3) [m].

    By the tensions of cables without mass; by the lengths of those with mass, which here have no memory.

    Args:
        equilibria: (...).
        exits: where they are without cables, base frame [m].
        anchors: (..., cables, 3), base frame [m].
    """
    robot, cabling = equilibria.robot, equilibria.robot.cabling
    if cabling.rigid_exits:
        return exits
    moves = cable_path.exit_moves(cabling, exits - anchors, cabling.pulls(equilibria.tensions))
    if not cabling.massless:
        table = without_memory(robot).cable_table(equilibria.problems.axial_stiffness)
        hanging = any_cables(table, anchors - exits, equilibria.rest_lengths).moved
        moves = np.where(cabling.with_mass[:, None], hanging, moves)
    return exits + moves


def profiles(
    robot: Robot,
    exits: ArrayLike,
    anchors: ArrayLike,
    rest_lengths: ArrayLike,
    axial_stiffness: Float[np.ndarray, "*#batch cables"],
    weights: Float[np.ndarray, "*#batch cables"],
    points: int,
) -> Float[np.ndarray, "*batch cables points 3"]:
    """Where cables hang: points from exit to anchor, or from where a cable with mass leaves its wheel, to draw [m].

    From exits where they are under their cables (``moved_exits``), with the axial stiffness of the ropes, and weights
    per rest length with all parts of line [N/m]. A massless cable has the shape to which its weight's last trace would
    bring it, without its pulley. A nonlinear one is taken as linear there, as stiff as at its mean tension; one with a
    memory as elastic. What is rigid at the anchor of a cable with mass is straight.
    """
    exits, anchors, rest = (np.asarray(value, float) for value in (exits, anchors, rest_lengths))
    cabling, shape = robot.cabling, np.broadcast_shapes(axial_stiffness.shape, weights.shape)
    straight = cabling.linear and not (cabling.pulleys.any() or cabling.behind.any() or cabling.least_lengths.any())
    if straight or not np.any(weights):
        return profile(exits, anchors, rest, cabling.pulls(np.broadcast_to(axial_stiffness, shape)), weights, points)
    table = np.array(without_memory(robot).cable_table(np.broadcast_to(axial_stiffness, shape)))
    table[..., WEIGHT], table[..., GIVES:] = weights, 0.0
    axial_stiffness, wrapped = table[..., STIFFNESS], table[..., WRAPPED]
    found = any_cables(table, anchors - exits, rest)
    rigid = np.where(weights > 0, cabling.least_lengths, 0.0)
    rest = rest - rigid
    with np.errstate(all="ignore"):
        t = -found.pull
        t[..., 2] -= weights * (rest - wrapped)
        T = found.exit_tension
        beyond_exit, on_wheel = cable_path.leaves_wheel(cabling, t / T[..., None])
        law = cable_law.of_table(table)
        unstretched = cable_law.rest_length_for(1.0, T, law)
        # Rope from behind the exit that its stretch moves past the exit.
        pulled_out = np.where(weights > 0, cabling.behind * (1 - unstretched), 0.0)
        mean = np.fmax(0.5 * (T + found.anchor_tension), np.finfo(float).tiny * 1e10)
        secant = mean / cable_law.strain_at(mean, law)
        over = cabling.pulleys & (weights > 0)
        starts = np.where(over[..., None], exits + beyond_exit, exits)
        ends = anchors + (rigid / found.anchor_tension)[..., None] * found.pull
        ends = np.where((rigid > 0)[..., None], ends, anchors)
    rest = np.where(over, rest - on_wheel * unstretched, rest) + pulled_out
    stiffness = np.where(cabling.nonlinear & np.isfinite(secant) & (secant > 0), secant, axial_stiffness)
    return profile(starts, ends, rest, stiffness, weights, points, rigid)

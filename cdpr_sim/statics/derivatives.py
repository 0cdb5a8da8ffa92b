"""How the net wrench on the platform changes: with the pose, with the tensions, and with every number of the robot.

The building blocks of sensitivities, identification, compensation and the search for saddles. A step of the pose is
(translation, left-applied rotation vector), as in ``statics``. All are exact on the present set of taut cables.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from cdpr_sim.statics import forces as statics
from cdpr_sim.core.problem import Problem

Array = np.ndarray

PARAMETERS = ("rest_lengths", "axial_stiffness", "exits", "anchors", "mass", "center_of_mass", "external_wrench")
"""What an equilibrium depends on, by the names of ``Robot`` and ``Problem``."""

_LEVI_CIVITA = np.zeros((3, 3, 3))
_LEVI_CIVITA[[0, 1, 2], [1, 2, 0], [2, 0, 1]] = 1.0
_LEVI_CIVITA[[0, 1, 2], [2, 0, 1], [1, 2, 0]] = -1.0


def wrench_slope(
    problem: Problem, position: Float[Array, "*#batch 3"], rotation: Float[Array, "*#batch 3 3"]
) -> Float[Array, "*batch 6 6"]:
    """∂(net wrench)/∂(pose step) [N/m, N, N m], at any pose, in equilibrium or not.

    Minus the stiffness matrix, but for one term: the Hessian in a rotation vector is symmetric, whereas the torque
    that it is the slope of turns with the platform. With m the torque of cables and weight alone, that is −½ [m]×
    in the rotations' block. It vanishes at an equilibrium without an external torque.
    """
    slope = -statics.stiffness_matrix(problem, position, rotation)
    torque = statics.net_wrench(problem, position, rotation)[..., 3:] - problem.external_wrench[3:]
    slope[..., 3:, 3:] -= 0.5 * cross_matrix(torque)
    return slope


def wrench_slope_at_fixed_tensions(
    problem: Problem, position: Float[Array, "*#batch 3"], rotation: Float[Array, "*#batch 3 3"]
) -> Float[Array, "*batch 6 6"]:
    """As ``wrench_slope``, of cables whose tension would not change with their length: what geometry alone does."""
    robot = problem.robot
    tau = statics.tensions(statics.lengths(robot, position, rotation), problem.rest_lengths, robot.axial_stiffness)
    W = statics.wrench_matrix(robot, position, rotation)
    elastic = problem.stiffnesses * (tau > 0)
    return wrench_slope(problem, position, rotation) + np.einsum("...ic,...c,...jc->...ij", W, elastic, W)


def wrench_by_parameter(
    problem: Problem, position: Float[Array, "3"], rotation: Float[Array, "3 3"]
) -> dict[str, Float[Array, "6 parameters"]]:
    """∂(net wrench)/∂(parameter) at a fixed pose, for each of ``PARAMETERS``.

    Exits and anchors are in the order x, y, z of cable 1, x, y, z of cable 2, and so on.
    """
    robot = problem.robot
    arms, vectors = statics.cable_vectors(robot, position, rotation)
    length = np.linalg.norm(vectors, axis=-1)
    directions = vectors / length[:, None]
    W = np.concatenate([directions, np.cross(arms, directions)], axis=-1).T
    tau = statics.tensions(length, problem.rest_lengths, robot.axial_stiffness)
    tension_by = tension_by_parameter(problem, position, rotation)
    # The cable's force f = tau u: moving its upper end turns it, and moving its lower end turns it back.
    turning = (tau / length)[:, None, None] * (np.eye(3) - directions[:, :, None] * directions[:, None, :])
    by_exit = np.concatenate([turning, cross_matrix(arms) @ turning], axis=1)
    lever = np.concatenate([np.zeros_like(turning), -cross_matrix(tau[:, None] * directions)], axis=1)
    by_anchor = (lever - by_exit) @ rotation
    cables = robot.cables
    center = rotation @ robot.center_of_mass
    pull = np.array([0.0, 0.0, -robot.gravity])
    return {
        "rest_lengths": W @ tension_by["rest_lengths"],
        "axial_stiffness": W @ tension_by["axial_stiffness"],
        "exits": W @ tension_by["exits"] + by_exit.transpose(1, 0, 2).reshape(6, 3 * cables),
        "anchors": W @ tension_by["anchors"] + by_anchor.transpose(1, 0, 2).reshape(6, 3 * cables),
        "mass": np.concatenate([pull, np.cross(center, pull)])[:, None],
        "center_of_mass": np.vstack([np.zeros((3, 3)), -robot.mass * cross_matrix(pull) @ rotation]),
        "external_wrench": np.eye(6),
    }


def tension_by_parameter(
    problem: Problem, position: Float[Array, "3"], rotation: Float[Array, "3 3"]
) -> dict[str, Float[Array, "cables parameters"]]:
    """∂(tensions)/∂(parameter) at a fixed pose, for each of ``PARAMETERS``: tau = EA (l − l0)/l0 where taut."""
    robot = problem.robot
    _, vectors = statics.cable_vectors(robot, position, rotation)
    length = np.linalg.norm(vectors, axis=-1)
    directions = vectors / length[:, None]
    rest, cables = problem.rest_lengths, robot.cables
    taut = length > rest
    elastic = taut * problem.stiffnesses
    rows = np.arange(cables)
    by_exit = np.zeros((cables, cables, 3))
    by_exit[rows, rows] = elastic[:, None] * directions
    by_anchor = np.zeros((cables, cables, 3))
    by_anchor[rows, rows] = -(elastic[:, None] * directions) @ rotation
    return {
        "rest_lengths": np.diag(-elastic * length / rest),
        "axial_stiffness": np.diag(taut * (length - rest) / rest),
        "exits": by_exit.reshape(cables, 3 * cables),
        "anchors": by_anchor.reshape(cables, 3 * cables),
        "mass": np.zeros((cables, 1)),
        "center_of_mass": np.zeros((cables, 3)),
        "external_wrench": np.zeros((cables, 6)),
    }


def tension_by_pose(
    problem: Problem, position: Float[Array, "3"], rotation: Float[Array, "3 3"]
) -> Float[Array, "cables 6"]:
    """∂(tensions)/∂(pose step): a taut cable's EA/l0 times the slope of its length, −Wᵀ."""
    robot = problem.robot
    taut = statics.lengths(robot, position, rotation) > problem.rest_lengths
    W = statics.wrench_matrix(robot, position, rotation)
    return -W.T * (taut * problem.stiffnesses)[:, None]


def cross_matrix(vectors: Float[Array, "*batch 3"]) -> Float[Array, "*batch 3 3"]:
    """[v]× with [v]× w = v × w."""
    return np.einsum("ijk,...j->...ik", _LEVI_CIVITA, vectors)

"""Derivatives of the net wrench on the platform by the pose, the tensions and every parameter of the robot.

Sensitivities, identification, compensation and the search for saddles are built on them. A step of the pose is
(translation, left-applied rotation vector), as in ``forces``. All are exact for the present set of taut cables.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from cdpr_sim.core import cable_law
from cdpr_sim.core.robot import Robot
from cdpr_sim.statics.forces import State, cross_matrix

Array = np.ndarray

PARAMETERS = ("rest_lengths", "axial_stiffness", "exits", "anchors", "mass", "center_of_mass", "external_wrench")
"""Parameters of an equilibrium, by the names of ``Robot`` and ``Problem``."""

PULLEY_PARAMETERS = ("pulley_radius",)
"""Parameters of an equilibrium of a robot with pulleys."""


def parameters(robot: Robot) -> tuple[str, ...]:
    """Parameters on which an equilibrium of ``robot`` depends."""
    return PARAMETERS + (PULLEY_PARAMETERS if robot.cabling.pulleys.any() else ())


def wrench_slope(state: State) -> Float[Array, "*batch 6 6"]:
    """∂(net wrench)/∂(pose step) [N/m, N, N m], at any pose, in equilibrium or not.

    It is minus the stiffness matrix, except for one term: the Hessian in a rotation vector is symmetric, but the torque
    turns with the platform. With m the torque of cables and weight without the external wrench, the term is −½ [m]×
    in the rotations' block. It vanishes at an equilibrium without an external torque.
    """
    slope = -state.stiffness_matrix
    torque = state.net_wrench[..., 3:] - state.problem.external_wrench[..., 3:]
    slope[..., 3:, 3:] -= 0.5 * cross_matrix(torque)
    return slope


def wrench_slope_at_fixed_tensions(state: State) -> Float[Array, "*batch 6 6"]:
    """As ``wrench_slope``, for cables whose tensions do not change with their lengths: the geometric part."""
    W = state.wrench_matrix
    return wrench_slope(state) + np.einsum("...ic,...c,...jc->...ij", W, state.tangent_stiffness, W)


def wrench_by_parameter(state: State) -> dict[str, Float[Array, "6 parameters"]]:
    """∂(net wrench)/∂(parameter) at a fixed pose, for each of ``parameters``; ``state`` is of a single pose.

    Exits and anchors are in the order x, y, z of cable 1, x, y, z of cable 2, and so on.
    """
    robot, rotation, geometry, tau = state.problem.robot, state.rotation, state.geometry, state.tensions
    arms, directions, W = geometry.arms, geometry.directions, geometry.wrench_matrix
    tension_by = tension_by_parameter(state)
    # The cable's force is f = tau u: a step of its exit turns it, and a step of its anchor turns it back.
    turning = tau[:, None, None] * geometry.length_hessians
    by_exit = np.concatenate([turning, cross_matrix(arms) @ turning], axis=1)
    lever = np.concatenate([np.zeros_like(turning), -cross_matrix(tau[:, None] * directions)], axis=1)
    by_anchor = (lever - by_exit) @ rotation
    cables = robot.cables
    center = rotation @ robot.center_of_mass
    pull = np.array([0.0, 0.0, -robot.gravity])
    by_radius = {}
    if robot.cabling.pulleys.any():
        forces = tau[:, None] * _turning_by_radius(state)
        by_radius["pulley_radius"] = W @ tension_by["pulley_radius"] + np.hstack([forces, np.cross(arms, forces)]).T
    return by_radius | {
        "rest_lengths": W @ tension_by["rest_lengths"],
        "axial_stiffness": W @ tension_by["axial_stiffness"],
        "exits": W @ tension_by["exits"] + by_exit.transpose(1, 0, 2).reshape(6, 3 * cables),
        "anchors": W @ tension_by["anchors"] + by_anchor.transpose(1, 0, 2).reshape(6, 3 * cables),
        "mass": np.concatenate([pull, np.cross(center, pull)])[:, None],
        "center_of_mass": np.vstack([np.zeros((3, 3)), -robot.mass * cross_matrix(pull) @ rotation]),
        "external_wrench": np.eye(6),
    }


def tension_by_parameter(state: State) -> dict[str, Float[Array, "cables parameters"]]:
    """∂(tensions)/∂(parameter) at a fixed pose, for each of ``parameters``; ``state`` is of a single pose.

    The law is a function of the strain s/l0, so that a change dl0 of the rest length acts like a change −(l/l0) dl0 of
    the length.
    """
    problem, lengths, elastic = state.problem, state.lengths, state.tangent_stiffness
    rest, cables = problem.rest_lengths, problem.robot.cables
    directions = state.geometry.directions
    rows = np.arange(cables)
    by_exit = np.zeros((cables, cables, 3))
    by_exit[rows, rows] = elastic[:, None] * directions
    by_anchor = np.zeros((cables, cables, 3))
    by_anchor[rows, rows] = -(elastic[:, None] * directions) @ state.rotation
    by_radius = {}
    if problem.robot.cabling.pulleys.any():
        # A larger wheel takes up more cable by its wrap, and reduces the distance to the anchor by as much.
        wraps = state.geometry.wraps
        by_radius["pulley_radius"] = np.diag(elastic * (wraps - np.sin(wraps)))
    per_stiffness = cable_law.per_axial_stiffness(lengths - rest, rest, *problem.robot.cabling.stiffening.T)
    return by_radius | {
        "rest_lengths": np.diag(-elastic * lengths / rest),
        "axial_stiffness": np.diag((state.tensions > 0) * per_stiffness),
        "exits": by_exit.reshape(cables, 3 * cables),
        "anchors": by_anchor.reshape(cables, 3 * cables),
        "mass": np.zeros((cables, 1)),
        "center_of_mass": np.zeros((cables, 3)),
        "external_wrench": np.zeros((cables, 6)),
    }


def tension_by_pose(state: State) -> Float[Array, "cables 6"]:
    """∂(tensions)/∂(pose step): the tangent stiffness of a taut cable times the slope of its length, −Wᵀ."""
    return -state.wrench_matrix.T * state.tangent_stiffness[:, None]


def _turning_by_radius(state: State) -> Float[Array, "cables 3"]:
    """∂u/∂r of the directions in which cables pull [1/m], zero without a wheel.

    With e the axis, u = −(sin(theta) n + cos(theta) e) and m = cos(theta) n − sin(theta) e: −m (1 − cos(theta))/s.
    """
    geometry, axes = state.geometry, state.problem.robot.cabling.pulley_axis
    wraps = geometry.wraps[:, None]
    n = np.cross(geometry.across, axes)
    m = np.cos(wraps) * n - np.sin(wraps) * axes
    turning = -m * (1 - np.cos(wraps)) / geometry.free_lengths[:, None]
    return np.where(state.problem.robot.cabling.pulleys[:, None], turning, 0.0)

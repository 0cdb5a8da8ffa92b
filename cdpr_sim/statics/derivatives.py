"""Derivatives of the net wrench on the platform by the pose, the tensions and every parameter of the robot.

Sensitivities, identification, compensation and the search for saddles are built on them. A step of the pose is
(translation, left-applied rotation vector), as in ``forces``. All are exact for the present set of taut cables.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from cdpr_sim.core import cable_law
from cdpr_sim.core.robot import Robot
from cdpr_sim.statics.any_cable import any_cable_slopes
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
    robot, rotation, arms = state.problem.robot, state.rotation, state.geometry.arms
    center = rotation @ robot.center_of_mass
    weight = np.array([0.0, 0.0, -robot.gravity])
    found = {
        "mass": np.concatenate([weight, np.cross(center, weight)])[:, None],
        "center_of_mass": np.vstack([np.zeros((3, 3)), -robot.mass * cross_matrix(weight) @ rotation]),
        "external_wrench": np.eye(6),
    }
    for name, by in pull_by_parameter(state).items():
        torque = cross_matrix(arms) @ by
        if name == "anchors":  # which are the pulls' levers, too
            torque = torque - cross_matrix(state.pulls) @ rotation
        found[name] = np.concatenate([by, torque], axis=1).transpose(1, 0, 2).reshape(6, -1)
    return found


def tension_by_parameter(state: State) -> dict[str, Float[Array, "cables parameters"]]:
    """∂(tensions)/∂(parameter) at a fixed pose, for each of ``parameters``; ``state`` is of a single pose."""
    cables, directions = state.problem.robot.cables, state.pull_directions
    found = {
        "mass": np.zeros((cables, 1)), "center_of_mass": np.zeros((cables, 3)), "external_wrench": np.zeros((cables, 6))
    }  # fmt: skip
    for name, by in pull_by_parameter(state).items():
        along = (directions[:, None, :] @ by)[:, 0]
        found[name] = (np.eye(cables)[..., None] * along[:, None]).reshape(cables, -1)
    return found


def tension_by_pose(state: State) -> Float[Array, "cables 6"]:
    """∂(tensions)/∂(pose step): minus the pull's change along itself with the anchor's step, 1 and −[r]×."""
    along = (state.pull_directions[:, None, :] @ state.cable_stiffness)[:, 0]
    return -np.hstack([along, np.cross(state.geometry.arms, along)])


def pull_by_parameter(state: State) -> dict[str, Float[Array, "cables 3 parameters"]]:
    """∂(pull)/∂(parameter) of each cable on its anchor at a fixed pose, by its own parameters; of a single pose.

    The law is a function of the strain s/l0, so that a change dl0 of the rest length acts like a change −(l/l0) dl0 of
    the length.
    """
    problem, robot, stiffness = state.problem, state.problem.robot, state.cable_stiffness
    found = {"exits": stiffness, "anchors": -stiffness @ state.rotation}
    if state.hanging is not None:
        by_length, by_stiffness, by_radius = any_cable_slopes(
            robot.cabling.packed_with(problem.axial_stiffness), state.hanging, problem.rest_lengths,
            robot.cable_weights, robot.wrapped_lengths,
        )  # fmt: skip
    else:
        rest, elastic, u, wraps = (
            problem.rest_lengths,
            state.tangent_stiffness,
            state.geometry.directions,
            state.geometry.wraps,
        )
        per_stiffness = cable_law.per_axial_stiffness(state.lengths - rest, rest, *robot.cabling.stiffening.T)
        by_length = (-elastic * state.lengths / rest)[:, None] * u
        by_stiffness = ((state.tensions > 0) * per_stiffness)[:, None] * u
        # A larger wheel takes up more cable by its wrap, and reduces the distance to the anchor by as much.
        by_radius = (elastic * (wraps - np.sin(wraps)))[:, None] * u + state.tensions[:, None] * _turning_by_radius(
            state
        )
    found |= {"rest_lengths": by_length[..., None], "axial_stiffness": by_stiffness[..., None]}
    return found | ({"pulley_radius": by_radius[..., None]} if robot.cabling.pulleys.any() else {})


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

"""Derivatives of the net wrench on the platform by the pose, the tensions and every parameter of the robot.

Sensitivities, identification, compensation and the search for saddles are built on them. A step of the pose is
(translation, left-applied rotation vector), as in ``forces``. All are exact for the present set of taut cables.
"""

from __future__ import annotations

from collections.abc import Sequence

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

DRIVE_LINE_PARAMETERS = ("winch_to_exit",)
"""Parameters of an equilibrium of a robot with rope between winches and exits."""


def parameters(robot: Robot) -> tuple[str, ...]:
    """Parameters on which an equilibrium of ``robot`` depends."""
    further = PULLEY_PARAMETERS if robot.cabling.pulleys.any() else ()
    return PARAMETERS + further + (DRIVE_LINE_PARAMETERS if robot.winch_to_exit.any() else ())


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


def wrench_by_parameter(state: State, names: Sequence[str] = ()) -> dict[str, Float[Array, "6 parameters"]]:
    """∂(net wrench)/∂(parameter) at a fixed pose, for each of ``names``; ``state`` is of a single pose.

    By default for each of ``parameters``. Exits and anchors are in the order x, y, z of cable 1, x, y, z of cable 2,
    and so on.
    """
    robot, rotation, arms = state.problem.robot, state.rotation, state.geometry.arms
    center = rotation @ robot.center_of_mass
    weight = np.array([0.0, 0.0, -robot.gravity])
    found = {
        "mass": np.concatenate([weight, np.cross(center, weight)])[:, None],
        "center_of_mass": np.vstack([np.zeros((3, 3)), -robot.mass * cross_matrix(weight) @ rotation]),
        "external_wrench": np.eye(6),
    }
    wanted = names or parameters(robot)
    for name, by in pull_by_parameter(state).items():
        if name not in wanted:
            continue
        torque = cross_matrix(arms) @ by
        if name == "anchors":  # which are the pulls' levers, too
            torque = torque - cross_matrix(state.pulls) @ rotation
        found[name] = np.concatenate([by, torque], axis=1).transpose(1, 0, 2).reshape(6, -1)
    return {name: by for name, by in found.items() if name in wanted}


def tension_by_parameter(state: State) -> dict[str, Float[Array, "cables parameters"]]:
    """∂(tensions)/∂(parameter) at a fixed pose, for each of ``parameters``; ``state`` is of a single pose."""
    cables, directions = state.problem.robot.cables, state.pull_directions
    found = {
        "mass": np.zeros((cables, 1)), "center_of_mass": np.zeros((cables, 3)), "external_wrench": np.zeros((cables, 6))
    }  # fmt: skip
    for name, by in pull_by_parameter(state).items():
        if name not in parameters(state.problem.robot):
            continue
        along = (directions[:, None, :] @ by)[:, 0] / state.problem.robot.reeving[:, None]
        found[name] = (np.eye(cables)[..., None] * along[:, None]).reshape(cables, -1)
    return found


def tension_by_pose(state: State) -> Float[Array, "cables 6"]:
    """∂(tensions)/∂(pose step): minus the pull's change along itself with the anchor's step, 1 and −[r]×."""
    along = (state.pull_directions[:, None, :] @ state.cable_stiffness)[:, 0]
    along = along / state.problem.robot.reeving[:, None]
    return -np.hstack([along, np.cross(state.geometry.arms, along)])


def pull_by_parameter(state: State) -> dict[str, Float[Array, "cables 3 parameters"]]:
    """∂(pull)/∂(parameter) of each cable on its anchor at a fixed pose, by its own parameters; of a single pose.

    The law is a function of the strain n (l − l0)/(n l0 + g), so that the changes dl0 of the rest length and dg of the
    rope between winch and exit act like the change −(1 + eps) dl0 − eps dg/n of the length.
    """
    problem, robot, stiffness = state.problem, state.problem.robot, state.cable_stiffness
    found, n = {"exits": stiffness, "anchors": -stiffness @ state.rotation}, robot.reeving
    if state.hanging is not None:
        by_length, by_stiffness, by_radius, by_behind = any_cable_slopes(
            robot.cabling.packed_with(problem.axial_stiffness), state.hanging, problem.rest_lengths,
            robot.cable_weights, robot.wrapped_lengths,
        )  # fmt: skip
    else:
        rest, u, wraps = problem.rest_lengths, state.geometry.directions, state.geometry.wraps
        stretch, whole = state.lengths - rest, rest + robot.cabling.behind
        elastic = n * n * state.tangent_stiffness
        per_stiffness = cable_law.per_axial_stiffness(stretch, whole, *robot.cabling.stiffening.T)
        by_length = (-elastic * (state.lengths + robot.cabling.behind) / whole)[:, None] * u
        by_behind = (-elastic * stretch / whole)[:, None] * u
        by_stiffness = ((state.tensions > 0) * per_stiffness)[:, None] * u
        # A larger wheel takes up more cable by its wrap, and reduces the distance to the anchor by as much.
        by_radius = (elastic * (wraps - np.sin(wraps)))[:, None] * u
        by_radius = by_radius + state.pull_sizes[:, None] * _turning_by_radius(state)
    by_own = {
        "rest_lengths": by_length, "axial_stiffness": n[:, None] * by_stiffness, "pulley_radius": by_radius,
        "winch_to_exit": by_behind / n[:, None],
    }  # fmt: skip
    return found | {name: by[..., None] for name, by in by_own.items()}


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

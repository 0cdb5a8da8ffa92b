"""The statics of elastic cables in NumPy: lengths, tensions, wrenches, energy, its slope and its stiffness matrix.

Everything broadcasts over leading dimensions: positions (..., 3) and rotation matrices (..., 3, 3).
A step from a pose is (translation, left-applied rotation vector), six coordinates [m, rad].
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float
from numpy.typing import ArrayLike
from scipy.spatial.transform import RigidTransform

from cdpr_sim.core.equilibrium import Equilibrium
from cdpr_sim.core.problem import Problem
from cdpr_sim.core.robot import Robot

Array = np.ndarray


def cable_vectors(
    robot: Robot, position: Float[Array, "*#batch 3"], rotation: Float[Array, "*#batch 3 3"]
) -> tuple[Float[Array, "*#batch cables 3"], Float[Array, "*batch cables 3"]]:
    """Arms R bᵢ from the platform's origin to the anchors, and cable vectors aᵢ − p − R bᵢ, base frame [m] (Eq. 8)."""
    arms = np.einsum("...ij,cj->...ci", rotation, robot.anchors)
    return arms, robot.exits - np.asarray(position)[..., None, :] - arms


def lengths(
    robot: Robot, position: Float[Array, "*#batch 3"], rotation: Float[Array, "*#batch 3 3"]
) -> Float[Array, "*batch cables"]:
    """Cable lengths lᵢ = ‖aᵢ − bᵢ‖ [m] (Eq. 2, 9)."""
    return np.linalg.norm(cable_vectors(robot, position, rotation)[1], axis=-1)


def tensions(
    lengths: Float[Array, "*batch cables"], rest_lengths: ArrayLike, axial_stiffness: ArrayLike
) -> Float[Array, "*batch cables"]:
    """tau = EA max(l − l0, 0) / l0 [N]: a cable pulls and never pushes (Eq. 10, 11)."""
    rest_lengths = np.asarray(rest_lengths)
    return axial_stiffness * np.maximum(lengths - rest_lengths, 0.0) / rest_lengths


def wrench_matrix(
    robot: Robot, position: Float[Array, "*#batch 3"], rotation: Float[Array, "*#batch 3 3"]
) -> Float[Array, "*batch 6 cables"]:
    """W, whose column i is (uᵢ, R bᵢ × uᵢ): the wrench on the platform of unit tension in cable i (Eq. 4)."""
    arms, vectors = cable_vectors(robot, position, rotation)
    directions = vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)
    return np.swapaxes(np.concatenate([directions, np.cross(arms, directions)], axis=-1), -1, -2)


def load_wrench(problem: Problem, rotation: Float[Array, "*#batch 3 3"]) -> Float[Array, "*batch 6"]:
    """Gravity at the centre of mass plus the external wrench, about the platform's origin: w_e of Eq. 3 [N, N m]."""
    robot = problem.robot
    weight = np.array([0.0, 0.0, -robot.weight])
    arm = rotation @ robot.center_of_mass
    gravity = np.concatenate([np.broadcast_to(weight, arm.shape), np.cross(arm, weight)], axis=-1)
    return gravity + problem.external_wrench


def net_wrench(
    problem: Problem, position: Float[Array, "*#batch 3"], rotation: Float[Array, "*#batch 3 3"]
) -> Float[Array, "*batch 6"]:
    """W tau + w_e, zero at equilibrium (Eq. 3) [N, N m]: minus the slope of the energy."""
    robot = problem.robot
    tau = tensions(lengths(robot, position, rotation), problem.rest_lengths, robot.axial_stiffness)
    return np.einsum("...ic,...c->...i", wrench_matrix(robot, position, rotation), tau) + load_wrench(problem, rotation)


def residual(
    problem: Problem, position: Float[Array, "*#batch 3"], rotation: Float[Array, "*#batch 3 3"]
) -> Float[Array, "*batch"] | float:
    """Largest unbalanced force over the free directions, torques divided by the characteristic length [N]."""
    robot = problem.robot
    free = list(robot.free_directions)
    return np.abs(net_wrench(problem, position, rotation) / _units(robot))[..., free].max(-1)


def energy(
    problem: Problem, position: Float[Array, "*#batch 3"], rotation: Float[Array, "*#batch 3 3"]
) -> Float[Array, "*batch"] | float:
    """Elastic plus potential energy V = Σ ½ (EA/l0) max(l − l0, 0)² + m g z_com − f·p [J].

    The external torque is left out: a torque that keeps its direction in space does work that depends on the way.
    """
    robot = problem.robot
    position = np.asarray(position)
    stretch = np.maximum(lengths(robot, position, rotation) - problem.rest_lengths, 0.0)
    height = position[..., 2] + np.einsum("...j,j->...", rotation[..., 2, :], robot.center_of_mass)
    elastic = 0.5 * (problem.stiffnesses * stretch**2).sum(-1)
    return elastic + robot.weight * height - position @ problem.external_wrench[:3]


def stiffness_matrix(
    problem: Problem, position: Float[Array, "*#batch 3"], rotation: Float[Array, "*#batch 3 3"]
) -> Float[Array, "*batch 6 6"]:
    """The Hessian of the energy over (translation, left-applied rotation vector) [N/m, N, N m].

    Over the taut cables, K = Σ (EA/l0) Jᵀ J + tau ∂²l, and the weight's part; J = ∂l = −(u, r × u) is minus
    the wrench matrix's column. With D = [−1, [r]×] and r = R b,

        ∂²l = (Dᵀ D − Jᵀ J)/l + [0, (u·r) 1 − ½ (u rᵀ + r uᵀ)].

    Exact wherever no cable is just at its rest length, where it jumps.
    """
    robot = problem.robot
    arms, vectors = cable_vectors(robot, position, rotation)
    length = np.linalg.norm(vectors, axis=-1)
    directions = vectors / length[..., None]
    tau = tensions(length, problem.rest_lengths, robot.axial_stiffness)
    elastic = problem.stiffnesses * (tau > 0)
    J = -np.concatenate([directions, np.cross(arms, directions)], axis=-1)
    D = np.concatenate([np.broadcast_to(-np.eye(3), (*arms.shape, 3)), _cross_matrix(arms)], axis=-1)
    per_length = tau / length
    matrix = np.einsum("...c,...ci,...cj->...ij", elastic - per_length, J, J)
    matrix += np.einsum("...c,...cki,...ckj->...ij", per_length, D, D)
    matrix[..., 3:, 3:] += np.einsum("...c,...cij->...ij", tau, _dipole(directions, arms))
    arm = rotation @ robot.center_of_mass
    matrix[..., 3:, 3:] += _dipole(np.broadcast_to([0.0, 0.0, -robot.weight], arm.shape), arm)
    return matrix


def eigenvalues(
    problem: Problem, position: Float[Array, "*#batch 3"], rotation: Float[Array, "*#batch 3 3"]
) -> Float[Array, "*batch free"]:
    """Of the stiffness matrix on the free directions, ascending [N/m]; rotations in characteristic lengths."""
    units = _units(problem.robot)
    free = list(problem.robot.free_directions)
    matrix = stiffness_matrix(problem, position, rotation) / np.outer(units, units)
    return np.linalg.eigvalsh(matrix[..., free, :][..., free])


def equilibrium_at(problem: Problem, pose: RigidTransform, *, iterations: int, source: str) -> Equilibrium:
    """What statics says of the platform at ``pose``: tensions, residual and eigenvalues, as evidence."""
    position, rotation = pose.translation, pose.rotation.as_matrix()
    length = lengths(problem.robot, position, rotation)
    return Equilibrium(
        problem=problem,
        pose=pose,
        tensions=tensions(length, problem.rest_lengths, problem.robot.axial_stiffness),
        lengths=length,
        residual=float(residual(problem, position, rotation)),
        eigenvalues=eigenvalues(problem, position, rotation),
        iterations=iterations,
        source=source,
    )


def _units(robot: Robot) -> Float[Array, "6"]:
    """What turns (translation, rotation) into lengths, and (force, torque) into forces."""
    return np.repeat([1.0, robot.characteristic_length], 3)


def _cross_matrix(vectors: Float[Array, "*#batch 3"]) -> Float[Array, "*batch 3 3"]:
    """[v]× with [v]× w = v × w."""
    return np.cross(vectors[..., None, :], np.eye(3)).swapaxes(-1, -2)


def _dipole(forces: Float[Array, "*#batch 3"], arms: Float[Array, "*#batch 3"]) -> Float[Array, "*batch 3 3"]:
    """(f·r) 1 − ½ (f rᵀ + r fᵀ): minus the second derivative of f·exp(φ×) r."""
    outer = forces[..., :, None] * arms[..., None, :]
    return np.trace(outer, axis1=-2, axis2=-1)[..., None, None] * np.eye(3) - 0.5 * (outer + outer.swapaxes(-1, -2))

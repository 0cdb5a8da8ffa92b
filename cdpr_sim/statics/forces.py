"""The statics of elastic cables in NumPy: lengths, tensions, wrenches, energy, its slope and its stiffness matrix.

All of it is read off a frozen state: ``at(problem, position, rotation).net_wrench``. Everything broadcasts over leading
dimensions: positions (..., 3) and rotation matrices (..., 3, 3), and a whole batch of problems.
A step from a pose is (translation, left-applied rotation vector), six coordinates [m, rad].
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import RigidTransform

from cdpr_sim.core import cable_law
from cdpr_sim.core.cable_path import paths
from cdpr_sim.core.equilibrium import Equilibrium
from cdpr_sim.core.pose import Pose
from cdpr_sim.core.problem import Problem, Problems
from cdpr_sim.core.robot import Robot
from cdpr_sim.statics.any_cable import any_cables
from cdpr_sim.statics.catenary import Catenary

Array = np.ndarray

NO_LENGTH = np.finfo(float).tiny
"""[m] A slack cable whose anchor touches its exit pulls nowhere, rather than in a direction of 0/0."""

_LEVI_CIVITA = np.zeros((3, 3, 3))
_LEVI_CIVITA[[0, 1, 2], [1, 2, 0], [2, 0, 1]] = 1.0
_LEVI_CIVITA[[0, 1, 2], [2, 0, 1], [1, 2, 0]] = -1.0


@dataclass(frozen=True, eq=False)
class Geometry:
    """Where the cables run with the platform at a pose, or many.

    Attributes:
        robot: whose cables they are.
        arms: R bᵢ from the platform's origin to the anchors, base frame, (..., cables, 3) [m] (Eq. 8).
        directions: unit vectors along which the cables pull on the anchors, (..., cables, 3).
        lengths: of the cables, (..., cables) [m] (Eq. 2, 9).
        free_lengths: of their free pieces, which are rods whose far ends stay put, to first order, (..., cables) [m].
        across: unit vectors across the wheels that cables run over, (..., cables, 3); zero without one.
        bends: how much more slowly directions turn that way, (..., cables) [1/m]; 0 without a wheel.
        wraps: angles [rad] by which cables are wrapped round their wheels, (..., cables); 0 without one.
    """

    robot: Robot
    arms: Float[Array, "*#batch cables 3"]
    directions: Float[Array, "*batch cables 3"]
    lengths: Float[Array, "*batch cables"]
    free_lengths: Float[Array, "*batch cables"]
    across: Float[Array, "*batch cables 3"]
    bends: Float[Array, "*batch cables"]
    wraps: Float[Array, "*batch cables"]

    @cached_property
    def wrench_matrix(self) -> Float[Array, "*batch 6 cables"]:
        """W, whose column i is (uᵢ, R bᵢ × uᵢ): the wrench on the platform of unit tension in cable i (Eq. 4)."""
        return _wrenches(self.directions, self.arms)

    @cached_property
    def length_hessians(self) -> Float[Array, "*batch cables 3 3"]:
        """∂²l/∂b² of each cable by its anchor's place, base frame [1/m]: (1 − u uᵀ)/(free length) + bend b bᵀ."""
        u, b = self.directions, self.across
        straight = (np.eye(3) - u[..., :, None] * u[..., None, :]) / self.free_lengths[..., None, None]
        if not self.robot.cabling.pulleys.any():
            return straight
        return straight + self.bends[..., None, None] * b[..., :, None] * b[..., None, :]


@dataclass(frozen=True, eq=False)
class State:
    """The forces with the platform at a pose, or many.

    Attributes:
        problem: what was asked, once or many times.
        position: (..., 3) [m].
        rotation: (..., 3, 3).
        geometry: where the cables run.
        tensions: (..., cables) [N], 0 where slack (Eq. 10, 11); of a cable with weight, at the platform's end.
        hanging: what cables do of which some have mass.
    """

    problem: Problem | Problems
    position: Float[Array, "*#batch 3"]
    rotation: Float[Array, "*#batch 3 3"]
    geometry: Geometry
    tensions: Float[Array, "*batch cables"]
    hanging: Catenary | None = None

    @property
    def lengths(self) -> Float[Array, "*batch cables"]:
        """Of the cables, (..., cables) [m] (Eq. 2, 9)."""
        return self.geometry.lengths

    @property
    def wrench_matrix(self) -> Float[Array, "*batch 6 cables"]:
        """W (Eq. 4)."""
        return self.geometry.wrench_matrix

    @cached_property
    def tangent_stiffness(self) -> Float[Array, "*batch cables"]:
        """∂tau/∂l, (..., cables) [N/m], 0 where slack; nan of robots whose cables have mass."""
        if self.hanging is not None:
            return np.full(self.lengths.shape, np.nan)
        k, _ = cable_law.tangent(self.lengths - self.problem.rest_lengths, *_law(self.problem))
        return k * (self.tensions > 0)

    @cached_property
    def load_wrench(self) -> Float[Array, "*batch 6"]:
        """Gravity at the centre of mass plus the external wrench, about the origin: w_e of Eq. 3 [N, N m]."""
        return load_wrench(self.problem, self.rotation)

    @cached_property
    def net_wrench(self) -> Float[Array, "*batch 6"]:
        """W tau + w_e, zero at equilibrium (Eq. 3) [N, N m]: minus the slope of the energy."""
        if self.hanging is None:
            return (self.wrench_matrix * self.tensions[..., None, :]).sum(-1) + self.load_wrench
        return _wrenches(self.hanging.pull, self.geometry.arms).sum(-1) + self.load_wrench

    @property
    def residual(self) -> Float[Array, "*batch"] | float:
        """Largest unbalanced force over the free directions, torques divided by the characteristic length [N]."""
        robot = self.problem.robot
        return np.abs(self.net_wrench / robot.units)[..., robot.free].max(-1)

    @property
    def energy(self) -> Float[Array, "*batch"] | float:
        """Elastic plus potential energy V = Σ U(l) + m g z_com − f·p [J].

        The external torque is left out: a torque that keeps its direction in space does work that depends on the way.
        """
        problem, robot = self.problem, self.problem.robot
        height = self.position[..., 2] + np.einsum("...j,j->...", self.rotation[..., 2, :], robot.center_of_mass)
        if self.hanging is None:
            elastic = cable_law.energy(self.lengths - problem.rest_lengths, *_law(problem)).sum(-1)
        else:
            elastic = self.hanging.energy.sum(-1)
        work = np.einsum("...i,...i->...", self.position, problem.external_wrench[..., :3])
        return elastic + problem.mass * robot.gravity * height - work

    @cached_property
    def stiffness_matrix(self) -> Float[Array, "*batch 6 6"]:
        """The Hessian of the energy over (translation, left-applied rotation vector) [N/m, N, N m].

        Over the taut cables, K = Σ k ∂lᵀ ∂l + tau ∂²l, and the weight's part; ∂l = −(u, r × u) is minus the wrench
        matrix's column. With D = ∂b = [1, −[r]×] for the anchor's place b and r = R b,

            ∂²l = Dᵀ (∂²l/∂b²) D + [0, (u·r) 1 − ½ (u rᵀ + r uᵀ)],

        in which ∂²l/∂b² = (1 − u uᵀ)/s + bend b bᵀ (``Geometry.length_hessians``) and Dᵀ u = (u, r × u).
        Exact wherever no cable is just at its rest length, where it jumps.
        """
        robot, geometry, tau = self.problem.robot, self.geometry, self.tensions
        arms, W = geometry.arms, geometry.wrench_matrix
        if self.hanging is None:
            across = tau / geometry.free_lengths
            matrix = (W * (self.tangent_stiffness - across)[..., None, :]) @ np.swapaxes(W, -1, -2)
            matrix[..., :3, :3] += across.sum(-1)[..., None, None] * np.eye(3)
            lever = cross_matrix((across[..., None] * arms).sum(-2))
            matrix[..., 3:, :3] += lever
            matrix[..., :3, 3:] -= lever
            pulls = tau[..., None] * geometry.directions + across[..., None] * arms
            if robot.cabling.pulleys.any():
                wheels = _wrenches(geometry.across, arms)
                matrix += (wheels * (tau * geometry.bends)[..., None, :]) @ np.swapaxes(wheels, -1, -2)
        else:
            D = np.concatenate([np.broadcast_to(np.eye(3), (*arms.shape, 3)), -cross_matrix(arms)], axis=-1)
            matrix = (np.swapaxes(D, -1, -2) @ self.hanging.stiffness @ D).sum(-3)
            pulls = self.hanging.pull
        matrix[..., 3:, 3:] += _turning(np.swapaxes(pulls, -1, -2) @ arms)
        arm = self.rotation @ robot.center_of_mass
        matrix[..., 3:, 3:] += _turning(_weight(self.problem, arm)[..., :, None] * arm[..., None, :])
        return matrix

    @property
    def eigenvalues(self) -> Float[Array, "*batch free"]:
        """Of the stiffness matrix on the free directions, ascending [N/m]; rotations in characteristic lengths."""
        return eigenvalues(self.problem.robot, self.stiffness_matrix)


def geometry(robot: Robot, position: Float[Array, "*#batch 3"], rotation: Float[Array, "*#batch 3 3"]) -> Geometry:
    """Where the cables of ``robot`` run with the platform at a pose, or many."""
    turn, (a, b, c) = rotation[..., None, :, :], robot.anchors.T[..., None]
    arms = turn[..., 0] * a + turn[..., 1] * b + turn[..., 2] * c
    found = paths(robot.cabling, robot.exits - np.asarray(position)[..., None, :] - arms)
    lengths, free, bends, wraps = found[0], np.maximum(found[4], NO_LENGTH), found[8], found[9]
    directions = np.moveaxis(found[1:4] / free, 0, -1)
    return Geometry(robot, arms, directions, lengths, free, np.moveaxis(found[5:8], 0, -1), bends, wraps)


def at(
    problem: Problem | Problems, position: Float[Array, "*#batch 3"], rotation: Float[Array, "*#batch 3 3"]
) -> State:
    """The forces of ``problem`` with the platform at a pose, or many; of many problems, each at its own."""
    robot, cables = problem.robot, geometry(problem.robot, position, rotation)
    rest = problem.rest_lengths
    if not robot.cabling.massless:
        apart = np.asarray(position)[..., None, :] + cables.arms - robot.exits
        table = robot.cabling.packed_with(problem.axial_stiffness)
        hanging = any_cables(table, apart, rest, robot.cable_weights, robot.wrapped_lengths)
        return State(problem, np.asarray(position), rotation, cables, hanging.anchor_tension, hanging)
    tau = cable_law.tension(cables.lengths - rest, *_law(problem))
    return State(problem, np.asarray(position), rotation, cables, tau)


def load_wrench(problem: Problem | Problems, rotation: Float[Array, "*#batch 3 3"]) -> Float[Array, "*batch 6"]:
    """Gravity at the centre of mass plus the external wrench, about the origin: w_e of Eq. 3 [N, N m]."""
    arm = (rotation * problem.robot.center_of_mass).sum(-1)
    weight = np.asarray(problem.mass * problem.robot.gravity)
    wrench = np.zeros((*np.broadcast_shapes(arm.shape[:-1], weight.shape), 6))
    wrench[..., 2], wrench[..., 3], wrench[..., 4] = -weight, -weight * arm[..., 1], weight * arm[..., 0]
    return wrench + problem.external_wrench


def eigenvalues(robot: Robot, stiffness_matrix: Float[Array, "*batch 6 6"]) -> Float[Array, "*batch free"]:
    """Of a stiffness matrix on the free directions, ascending [N/m]; rotations in characteristic lengths."""
    matrix = stiffness_matrix / np.outer(robot.units, robot.units)
    return np.linalg.eigvalsh(matrix[..., robot.free, :][..., robot.free])


def eigenvalues_at(problem: Problem, pose: Pose) -> Float[Array, " free"]:
    """Those of ``problem``'s stiffness matrix with the platform at ``pose``."""
    return at(problem, pose.position, pose.rotation_matrix).eigenvalues


def rest_lengths_for(
    robot: Robot, lengths: Float[Array, "*batch cables"], tensions: Float[Array, "*batch cables"]
) -> Float[Array, "*batch cables"]:
    """How long to cut cables so that they have these lengths under these tensions [m]."""
    return cable_law.rest_length_for(lengths, tensions, *robot.cabling.law)


def equilibrium_at(problem: Problem, pose: RigidTransform, *, iterations: int, source: str) -> Equilibrium:
    """What statics says of the platform at ``pose``: tensions, residual and eigenvalues, as evidence."""
    where = Pose.of(pose)
    state = at(problem, where.position, where.rotation_matrix)
    return Equilibrium(
        problem=problem,
        pose=where,
        tensions=state.tensions,
        lengths=state.lengths,
        residual=float(state.residual),
        eigenvalues=state.eigenvalues,
        iterations=iterations,
        source=source,
    )


def cross_matrix(vectors: Float[Array, "*batch 3"]) -> Float[Array, "*batch 3 3"]:
    """[v]× with [v]× w = v × w."""
    return np.einsum("ijk,...j->...ik", _LEVI_CIVITA, vectors)


def _law(problem: Problem | Problems) -> tuple[Array, ...]:
    """What ``cable_law`` wants to know besides stretches."""
    return problem.rest_lengths, problem.axial_stiffness, *problem.robot.cabling.stiffening.T


def _weight(problem: Problem | Problems, arm: Float[Array, "*batch 3"]) -> Float[Array, "*batch 3"]:
    """The force of gravity, one per arm [N]."""
    pull = np.asarray(-problem.mass * problem.robot.gravity)[..., None] * np.array([0.0, 0.0, 1.0])
    return np.broadcast_to(pull, np.broadcast_shapes(pull.shape, arm.shape))


def _turning(moments: Float[Array, "*batch 3 3"]) -> Float[Array, "*batch 3 3"]:
    """Of M = Σ f rᵀ: tr(M) 1 − ½ (M + Mᵀ), minus the second derivative of Σ f·exp(φ×) r."""
    trace = np.trace(moments, axis1=-2, axis2=-1)[..., None, None]
    return trace * np.eye(3) - 0.5 * (moments + moments.swapaxes(-1, -2))


def _wrenches(
    forces: Float[Array, "*batch cables 3"], arms: Float[Array, "*#batch cables 3"]
) -> Float[Array, "*batch 6 cables"]:
    """Of forces at the ends of arms: columns (f, r × f)."""
    return np.swapaxes(np.concatenate([forces, np.cross(arms, forces)], axis=-1), -1, -2)

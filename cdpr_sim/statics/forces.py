"""The statics of elastic cables in NumPy: lengths, tensions, wrenches, energy, its slope and its stiffness matrix.

All quantities are attributes of a frozen state: ``at(problem, position, rotation).net_wrench``. All arguments broadcast
over leading dimensions: positions (..., 3), rotation matrices (..., 3, 3), and a whole batch of problems.
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
from cdpr_sim.statics.any_cable import Catenary, any_cables

Array = np.ndarray

NO_LENGTH = np.finfo(float).tiny
"""[m] A slack cable whose anchor touches its exit has the direction 0, rather than 0/0."""

_LEVI_CIVITA = np.zeros((3, 3, 3))
_LEVI_CIVITA[[0, 1, 2], [1, 2, 0], [2, 0, 1]] = 1.0
_LEVI_CIVITA[[0, 1, 2], [2, 0, 1], [1, 2, 0]] = -1.0


@dataclass(frozen=True, eq=False)
class Geometry:
    """Geometry of the cables with the platform at a pose, or many.

    Attributes:
        robot: robot of these cables.
        arms: R bᵢ from the platform's origin to the anchors, base frame, (..., cables, 3) [m] (Eq. 8).
        directions: unit vectors along which the cables pull on the anchors, (..., cables, 3).
        lengths: cable lengths, (..., cables) [m] (Eq. 2, 9).
        free_lengths: lengths of the free segments, which turn like rods with fixed far ends, to first order, (...,
            cables) [m].
        across: unit vectors normal to the planes of the wheels, (..., cables, 3); zero without one.
        bends: decrease of the change of direction along ``across``, (..., cables) [1/m]; 0 without a wheel.
        wraps: wrap angles of cables on their wheels, (..., cables) [rad]; 0 without one.
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
        """W, whose column i is nᵢ (uᵢ, R bᵢ × uᵢ): the wrench on the platform of unit tension in rope i (Eq. 4).

        nᵢ is its number of parts of line. The rope's length changes by minus this column times the platform's step.
        """
        return self.robot.cabling.pulls(_wrenches(self.directions, self.arms))

    @cached_property
    def length_hessians(self) -> Float[Array, "*batch cables 3 3"]:
        """∂²l/∂b² of each cable by its anchor's position, base frame [1/m]: (1 − u uᵀ)/(free length) + bend b bᵀ."""
        u, b = self.directions, self.across
        straight = (np.eye(3) - u[..., :, None] * u[..., None, :]) / self.free_lengths[..., None, None]
        if not self.robot.cabling.pulleys.any():
            return straight
        return straight + self.bends[..., None, None] * b[..., :, None] * b[..., None, :]


@dataclass(frozen=True, eq=False)
class State:
    """Forces with the platform at a pose, or many.

    Attributes:
        problem: the problem, or a batch of problems.
        position: (..., 3) [m].
        rotation: (..., 3, 3).
        geometry: geometry of the cables.
        tensions: tensions of the ropes, (..., cables) [N], 0 where not stretched (Eq. 10, 11); for a cable with mass,
            at the platform's end.
        hanging: states of the cables if some have mass.
    """

    problem: Problem | Problems
    position: Float[Array, "*#batch 3"]
    rotation: Float[Array, "*#batch 3 3"]
    geometry: Geometry
    tensions: Float[Array, "*batch cables"]
    hanging: Catenary | None = None

    @property
    def lengths(self) -> Float[Array, "*batch cables"]:
        """Cable lengths, (..., cables) [m] (Eq. 2, 9)."""
        return self.geometry.lengths

    @cached_property
    def wrench_matrix(self) -> Float[Array, "*batch 6 cables"]:
        """W (Eq. 4)."""
        return self.problem.robot.cabling.pulls(_wrenches(self.pull_directions, self.geometry.arms))

    @cached_property
    def tangent_stiffness(self) -> Float[Array, "*batch cables"]:
        """∂tau/∂(n l), (..., cables) [N/m], 0 where not stretched; nan for robots whose cables have mass.

        Tension by the length of all n parts of line: the spring constant of the whole rope, EA/(n l0 + g).
        """
        if self.hanging is not None:
            return np.full(self.lengths.shape, np.nan)
        k, _ = cable_law.tangent(self.lengths - self.problem.rest_lengths, *_stretched(self.problem))
        return self.problem.robot.cabling.tensions(k) * (self.tensions > 0)

    @property
    def pulls(self) -> Float[Array, "*batch cables 3"]:
        """Forces of the cables on their anchors, base frame, (..., cables, 3) [N]."""
        if self.hanging is not None:
            return self.hanging.pull
        return self.pull_sizes[..., None] * self.geometry.directions

    @property
    def pull_sizes(self) -> Float[Array, "*batch cables"]:
        """Magnitudes of the pulls, (..., cables) [N]: tensions times parts of line."""
        return self.problem.robot.cabling.pulls(self.tensions)

    @property
    def pull_directions(self) -> Float[Array, "*batch cables 3"]:
        """Unit vectors of the pulls; of slack massless cables, ``Geometry.directions``."""
        if self.hanging is None:
            return self.geometry.directions
        tau = self.pull_sizes[..., None]
        return np.where(tau > 0, self.pulls / np.where(tau > 0, tau, 1.0), self.geometry.directions)

    @cached_property
    def cable_stiffness(self) -> Float[Array, "*batch cables 3 3"]:
        """−∂(pull)/∂(anchor) of each cable, symmetric, (..., cables, 3, 3) [N/m]: n² k u uᵀ + n tau ∂²l/∂b²."""
        if self.hanging is not None:
            return self.hanging.stiffness
        u = self.geometry.directions
        of_parts = self.problem.robot.cabling.pulls(self.problem.robot.cabling.pulls(self.tangent_stiffness))
        turning = self.pull_sizes[..., None, None] * self.geometry.length_hessians
        return of_parts[..., None, None] * (u[..., :, None] * u[..., None, :]) + turning

    @cached_property
    def load_wrench(self) -> Float[Array, "*batch 6"]:
        """Gravity at the centre of mass plus the external wrench, about the origin: w_e of Eq. 3 [N, N m]."""
        return load_wrench(self.problem, self.rotation)

    @cached_property
    def net_wrench(self) -> Float[Array, "*batch 6"]:
        """W tau + w_e, zero at equilibrium (Eq. 3) [N, N m]: minus the slope of the energy."""
        return (self.wrench_matrix * self.tensions[..., None, :]).sum(-1) + self.load_wrench

    @property
    def residual(self) -> Float[Array, "*batch"] | float:
        """Largest unbalanced force over the free directions, torques divided by the characteristic length [N]."""
        robot = self.problem.robot
        return np.abs(self.net_wrench / robot.units)[..., robot.free].max(-1)

    @property
    def energy(self) -> Float[Array, "*batch"] | float:
        """Elastic plus potential energy V = Σ U(l) + m g z_com − f·p [J].

        The external torque is left out: the work of a torque with a constant direction in space depends on the path.
        """
        problem, robot = self.problem, self.problem.robot
        height = self.position[..., 2] + np.einsum("...j,j->...", self.rotation[..., 2, :], robot.center_of_mass)
        if self.hanging is None:
            each = cable_law.energy(self.lengths - problem.rest_lengths, *_stretched(problem))
            elastic = robot.cabling.pulls(each).sum(-1)
        else:
            elastic = self.hanging.energy.sum(-1)
        work = np.einsum("...i,...i->...", self.position, problem.external_wrench[..., :3])
        return elastic + problem.mass * robot.gravity * height - work

    @cached_property
    def stiffness_matrix(self) -> Float[Array, "*batch 6 6"]:
        """The Hessian of the energy over (translation, left-applied rotation vector) [N/m, N, N m].

        Of a cable with the pull f and the stiffness k (``cable_stiffness``) at the arm r, with D = [1, −[r]×]:

            Dᵀ k D + [0, (f·r) 1 − ½ (f rᵀ + r fᵀ)],

        plus the weight's part. Exact unless a massless cable is exactly at its rest length, where the matrix is
        discontinuous.
        """
        robot, arms = self.problem.robot, self.geometry.arms
        D = np.concatenate([np.broadcast_to(np.eye(3), (*arms.shape, 3)), -cross_matrix(arms)], axis=-1)
        flat = *arms.shape[:-2], 3 * robot.cables, 6  # one product of matrices for all cables
        matrix = np.swapaxes(D.reshape(flat), -1, -2) @ (self.cable_stiffness @ D).reshape(flat)
        matrix[..., 3:, 3:] += _turning(np.swapaxes(self.pulls, -1, -2) @ arms)
        arm = self.rotation @ robot.center_of_mass
        matrix[..., 3:, 3:] += _turning(_weight(self.problem, arm)[..., :, None] * arm[..., None, :])
        return matrix

    @property
    def eigenvalues(self) -> Float[Array, "*batch free"]:
        """Eigenvalues of the stiffness matrix on the free directions [N/m], ascending; see ``eigenvalues``."""
        return eigenvalues(self.problem.robot, self.stiffness_matrix)


def geometry(
    robot: Robot,
    position: Float[Array, "*#batch 3"],
    rotation: Float[Array, "*#batch 3 3"],
    moved: Float[Array, "*#batch cables 3"] | float = 0.0,
) -> Geometry:
    """Geometry of the cables of ``robot`` with the platform at a pose, or many; by default from exits that do not move.

    ``moved`` is by how much they have moved under their cables [m].
    """
    turn, (a, b, c) = rotation[..., None, :, :], robot.anchors.T[..., None]
    arms = turn[..., 0] * a + turn[..., 1] * b + turn[..., 2] * c
    found = paths(robot.cabling, robot.exits + moved - np.asarray(position)[..., None, :] - arms)
    lengths, free, bends, wraps = found[0], np.maximum(found[4], NO_LENGTH), found[8], found[9]
    directions = np.moveaxis(found[1:4] / free, 0, -1)
    return Geometry(robot, arms, directions, lengths, free, np.moveaxis(found[5:8], 0, -1), bends, wraps)


def at(
    problem: Problem | Problems, position: Float[Array, "*#batch 3"], rotation: Float[Array, "*#batch 3 3"]
) -> State:
    """Forces of ``problem`` with the platform at a pose, or many; for many problems, each at its own pose."""
    robot, cables = problem.robot, geometry(problem.robot, position, rotation)
    rest = problem.rest_lengths
    if not robot.cabling.springs:
        chords = np.asarray(position)[..., None, :] + cables.arms - robot.exits
        hanging = any_cables(robot.cable_table(problem.axial_stiffness), chords, rest)
        cables = geometry(robot, position, rotation, hanging.moved)
        tau = robot.cabling.tensions(hanging.anchor_tension)
        return State(problem, np.asarray(position), rotation, cables, tau, hanging)
    tau = cable_law.tension(cables.lengths - rest, *_stretched(problem))
    return State(problem, np.asarray(position), rotation, cables, tau)


def weight_of_cables(
    robot: Robot, position: Float[Array, "*#batch 3"], rotation: Float[Array, "*#batch 3 3"]
) -> tuple[Float[Array, "*#batch cables"], Float[Array, "*#batch 6"]]:
    """Effects of the mass of taut cables, to the first order in weight over tension.

    Such a cable pulls along its chord with the tension at the middle of the rope, and half its weight, or less where
    its middle is nearer to the exit, is a load on the anchor.

    Returns:
        By how much the tension at either end of each rope differs from that at its middle, (..., cables) [N]; the
        wrench of these loads about the origin, (..., 6) [N, N m].
    """
    if robot.cabling.massless:
        return np.zeros(robot.cables), np.zeros(6)
    cables = geometry(robot, position, rotation)
    ropes = robot.cabling.ropes(cables.free_lengths)
    half = robot.cable_weights * ropes / 2
    down = (half * (ropes / cables.free_lengths))[..., None] * np.array([0.0, 0.0, -1.0])
    return robot.cabling.tensions(half) * np.abs(cables.directions[..., 2]), _wrenches(down, cables.arms).sum(-1)


def load_wrench(problem: Problem | Problems, rotation: Float[Array, "*#batch 3 3"]) -> Float[Array, "*batch 6"]:
    """Gravity at the centre of mass plus the external wrench, about the origin: w_e of Eq. 3 [N, N m]."""
    arm = (rotation * problem.robot.center_of_mass).sum(-1)
    weight = np.asarray(problem.mass * problem.robot.gravity)
    wrench = np.zeros((*np.broadcast_shapes(arm.shape[:-1], weight.shape), 6))
    wrench[..., 2], wrench[..., 3], wrench[..., 4] = -weight, -weight * arm[..., 1], weight * arm[..., 0]
    return wrench + problem.external_wrench


def eigenvalues(robot: Robot, stiffness_matrix: Float[Array, "*batch 6 6"]) -> Float[Array, "*batch free"]:
    """Ascending eigenvalues of a stiffness matrix on the free directions [N/m]; rotations in characteristic lengths.

    nan where the matrix is not finite, as where a cable has no path.
    """
    matrix = (stiffness_matrix / np.outer(robot.units, robot.units))[..., robot.free, :][..., robot.free]
    finite = np.asarray(np.isfinite(matrix).all((-2, -1)))
    values = np.linalg.eigvalsh(np.where(finite[..., None, None], matrix, 0.0))
    return np.where(finite[..., None], values, np.nan)


def mass_matrix(problem: Problem | Problems, rotation: Float[Array, "*batch 3 3"]) -> Float[Array, "*batch 6 6"]:
    """M about the platform's origin in the base frame [kg, kg m, kg m²].

    With c the centre of mass relative to it: [[m 1, −m [c]×], [m [c]×, R I Rᵀ + m (c·c 1 − c cᵀ)]].
    """
    robot, mass = problem.robot, np.asarray(problem.mass)[..., None, None]
    center = rotation @ robot.center_of_mass
    lever = cross_matrix(center)
    matrix = np.zeros((*rotation.shape[:-2], 6, 6))
    matrix[..., :3, :3] = mass * np.eye(3)
    matrix[..., :3, 3:], matrix[..., 3:, :3] = -mass * lever, mass * lever
    matrix[..., 3:, 3:] = rotation @ robot.inertia @ np.swapaxes(rotation, -1, -2) - mass * lever @ lever
    return matrix


def eigenvalues_at(problem: Problem, pose: Pose) -> Float[Array, " free"]:
    """Eigenvalues of ``problem``'s stiffness matrix with the platform at ``pose``."""
    return at(problem, pose.position, pose.rotation_matrix).eigenvalues


def equilibrium_at(problem: Problem, pose: RigidTransform | Pose, *, iterations: int, source: str) -> Equilibrium:
    """Result of statics with the platform at ``pose``, with the tensions, residual and eigenvalues that certify it."""
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


def _stretched(problem: Problem | Problems) -> tuple[Array, tuple[Array, ...]]:
    """The arguments of ``cable_law`` besides stretches: the length of rope that stretches, and the law."""
    cabling = problem.robot.cabling
    cabling.refuse_memory()
    return cabling.stretching(problem.rest_lengths), cabling.law_of(problem.axial_stiffness)


def _weight(problem: Problem | Problems, arm: Float[Array, "*batch 3"]) -> Float[Array, "*batch 3"]:
    """Force of gravity, one per arm [N]."""
    pull = np.asarray(-problem.mass * problem.robot.gravity)[..., None] * np.array([0.0, 0.0, 1.0])
    return np.broadcast_to(pull, np.broadcast_shapes(pull.shape, arm.shape))


def _turning(moments: Float[Array, "*batch 3 3"]) -> Float[Array, "*batch 3 3"]:
    """Rotation block of M = Σ f rᵀ: tr(M) 1 − ½ (M + Mᵀ), minus the second derivative of Σ f·exp(φ×) r."""
    trace = np.trace(moments, axis1=-2, axis2=-1)[..., None, None]
    return trace * np.eye(3) - 0.5 * (moments + moments.swapaxes(-1, -2))


def _wrenches(
    forces: Float[Array, "*batch cables 3"], arms: Float[Array, "*#batch cables 3"]
) -> Float[Array, "*batch 6 cables"]:
    """Wrenches of forces at the ends of arms: columns (f, r × f)."""
    here, there = [1, 2, 0], [2, 0, 1]  # faster than np.cross, with the same rounding
    torques = arms[..., here] * forces[..., there] - arms[..., there] * forces[..., here]
    return np.swapaxes(np.concatenate([forces, torques], axis=-1), -1, -2)

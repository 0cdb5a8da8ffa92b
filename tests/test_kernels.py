"""Kernels against NumPy and SciPy at a few poses each, as the Python that they are when little is asked of them.

Robots are lopsided on purpose, so that no axis, sign or term could be another's.
"""

import numpy as np
import pytest
from scipy.linalg import eigh
from scipy.spatial.transform import Rotation

import cdpr_sim as cdpr
from cdpr_sim.statics import forces, matrix_kernel
from cdpr_sim.statics.forces import mass_matrix
from cdpr_sim.statics.gufuncs import ROOTS
from cdpr_sim.statics.newton import stiffness_of

POSES = [(0.3, 0.2, 0.1, 0.05, -0.1, 0.2), (0.45, 0.3, 0.2, -0.1, 0.02, -0.3), (0.2, 0.25, 0.15, 0.0, 0.1, 0.0)]

WRENCH = np.array([0.3, -0.4, -0.5, 0.004, -0.006, 0.003])

KINDS = {
    "plain": {},
    "pulleys": {"pulley_radius": [0.01] * 4 + [0.0] * 4, "pulley_axis": (0, 0, 1)},
    "stiffening": {"stiffening": (8.0, -20.0)},
}


MOST_STEPS = {"mass": 20}
"""Of the solver, as measured; 11 where cables have no mass."""


def lopsided(kind: str = "plain", name: str = "cogiro") -> cdpr.Robot:
    """DemoBot with an eccentric mass, a full inertia, and cables no two of which are alike."""
    robot = cdpr.load_robot(name)
    return robot.replace(
        axial_stiffness=np.linspace(800, 2500, robot.cables),
        center_of_mass=(0.01, -0.015, 0.02),
        inertia=[[4e-4, 1e-5, -2e-5], [1e-5, 5e-4, 3e-5], [-2e-5, 3e-5, 6e-4]],
        **KINDS[kind],
    )


@pytest.mark.parametrize("kind", [*KINDS, "mass"])
def test_eigenvalues_and_frequencies_are_numpys(kind):
    """Of the stiffness matrix, and of it over the mass matrix, at equilibria to which few steps lead."""
    robot = lopsided("plain").replace(linear_density=[2e-3, 0] * 4) if kind == "mass" else lopsided(kind)
    equilibria = cdpr.solve_many(robot, POSES, external_wrench=WRENCH * [1, 1, 1, 0, 0, 0])
    assert equilibria.converged.all()
    assert equilibria.iterations.max() <= MOST_STEPS.get(kind, 11)
    state = forces.at(equilibria.problems, equilibria.positions, equilibria.rotations)
    values, frequencies = stiffness_of(equilibria)
    np.testing.assert_allclose(values, state.eigenvalues, rtol=1e-9)
    for row, rotation in enumerate(equilibria.rotations):
        squares = eigh(state.stiffness_matrix[row], mass_matrix(equilibria.problems[row], rotation))[0]
        assert frequencies[row] == pytest.approx(np.sqrt(squares[0]) / (2 * np.pi), rel=1e-9)


def test_matrices_are_factorised_as_by_numpy():
    """Factors, substitution and eigenvalues of symmetric ones; what is indefinite has no factors."""
    rng = np.random.default_rng(1)
    for _ in range(5):
        half = rng.normal(size=(6, 6))
        S, rhs, x = half @ half.T + 0.1 * np.eye(6), rng.normal(size=6), np.empty(6)
        L = S.copy()
        assert matrix_kernel.factorise(L, 6)
        cholesky = (np.tril(L, -1) + np.eye(6)) / np.sqrt(np.diag(L))
        np.testing.assert_allclose(cholesky, np.linalg.cholesky(S), atol=1e-12)
        matrix_kernel.substitute(L, rhs, x)
        np.testing.assert_allclose(S @ x, rhs, atol=1e-9)
        other = half + half.T
        d, memory = np.empty(6), matrix_kernel.Tridiagonal(np.empty(6), np.empty(6), np.empty(6))
        apart = np.kron(np.eye(2), half[:3, :3] + half[:3, :3].T)  # each eigenvalue twice
        tridiagonal = np.diag(np.diag(half)) + np.eye(6, k=1) + np.eye(6, k=-1)
        for symmetric in (other, tridiagonal, apart, np.diag(np.diag(half)), half[:, :2] @ half[:, :2].T, 0 * half):
            matrix_kernel.eigenvalues_of(np.tril(symmetric), memory, d)
            np.testing.assert_allclose(d, np.linalg.eigvalsh(symmetric), atol=1e-12)
        assert not matrix_kernel.factorise(other.copy(), 6)


@pytest.mark.parametrize("kind", KINDS)
def test_roots_of_the_net_wrench_are_those_of_numpy(kind):
    """From anywhere, the wrench that is left is the one of NumPy there; from near an equilibrium, none is."""
    robot, force = lopsided(kind), WRENCH * [1, 1, 1, 0, 0, 0]
    problem = cdpr.Problem.of(robot, POSES[0], external_wrench=force)
    equilibrium = cdpr.solve(problem)
    turns = Rotation.from_rotvec([(0.0, 0.0, 0.0), (0.01, -0.02, 0.01), (0.3, 0.2, -0.2)]).as_matrix()
    with np.errstate(all="ignore"):
        positions, rotations, left = ROOTS[robot.cabling.bent](
            robot.cable_table(), problem.rest_lengths, robot.weight, robot.center_of_mass, force, np.ones(6),
            robot.characteristic_length, 1e-11 * problem.load, 1e-2, equilibrium.position + 1e-3,
            turns @ equilibrium.rotation.as_matrix(),
        )  # fmt: skip
    net = np.linalg.norm(forces.at(problem, positions, rotations).net_wrench / robot.units, axis=1)
    np.testing.assert_allclose(left, net, rtol=1e-6, atol=1e-9)
    assert left[:2].max() < 1e-9 * problem.load

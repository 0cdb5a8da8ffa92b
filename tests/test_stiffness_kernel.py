import numpy as np
import pytest
from hypothesis import assume, given
from sample_problems import grid, hanging_mass, random_problems

import cdpr_sim as cdpr
from cdpr_sim.statics import forces
from cdpr_sim.statics.gufuncs import STIFFNESSES

ROUNDING = 1e-11
"""Relative to the largest eigenvalue: 1e-14 measured on DemoBot, 1e-12 where cables are stiff and tensions large."""

FREQUENCY_ROUNDING = 1e-6
"""Relative: the lowest of the ω² is known to 1e-13 of the largest, which is up to 1e7 times as large."""

KINK = 1e-12
"""[m] A cable closer to its rest length is taut or slack by rounding alone, and the stiffness jumps there."""


def stiffness(problem, positions, rotations):
    """(eigenvalues, lowest frequency) by the compiled kernel."""
    robot = problem.robot
    return STIFFNESSES[0](
        robot.cabling.packed, problem.rest_lengths, robot.mass, robot.gravity, robot.center_of_mass, robot.inertia,
        np.array(robot.free), robot.characteristic_length, positions, rotations,
    )  # fmt: skip


def mass_matrix(robot, rotation):
    """About the platform's origin in the base frame, from the kinetic energy of its centre of mass and spin."""
    x, y, z = rotation @ robot.center_of_mass
    jacobian = np.array([[1, 0, 0, 0, z, -y], [0, 1, 0, -z, 0, x], [0, 0, 1, y, -x, 0]])  # v + ω × arm
    spin = np.zeros((6, 6))
    spin[3:, 3:] = rotation @ robot.inertia @ rotation.T
    return robot.mass * jacobian.T @ jacobian + spin


@given(random_problems())
def test_eigenvalues_are_those_of_the_stiffness_matrix(problem):
    """The compiled assembly and eigenvalue iteration against NumPy and LAPACK, on random robots away from balance."""
    position, rotation = problem.pose.translation - [0, 0, 0.02], problem.pose.rotation.as_matrix()
    expected = forces.at(problem, position, rotation).eigenvalues
    found, _ = stiffness(problem, position, rotation)
    np.testing.assert_allclose(found, expected, rtol=0, atol=ROUNDING * np.abs(expected).max())


@given(random_problems(min_cables=6, max_cables=10, wrench=False))
def test_frequency_is_that_of_the_generalised_eigenproblem(problem):
    """K v = ω² M v by SciPy, at the equilibrium."""
    from scipy.linalg import eigh

    robot = problem.robot
    equilibrium = cdpr.solve(robot, problem.pose)
    assume(np.abs(equilibrium.lengths - equilibrium.rest_lengths).min() > KINK)
    rotation = equilibrium.rotation.as_matrix()
    free = np.ix_(robot.free, robot.free)
    K = forces.at(problem, equilibrium.position, rotation).stiffness_matrix[free]
    squares = eigh(K, mass_matrix(robot, rotation)[free], eigvals_only=True)
    _, frequency = stiffness(problem, equilibrium.position, rotation)
    if squares[0] > 1e-7 * squares[-1]:
        assert frequency == pytest.approx(np.sqrt(squares[0]) / (2 * np.pi), rel=FREQUENCY_ROUNDING)
    else:
        assert frequency <= np.sqrt(2e-7 * squares[-1]) / (2 * np.pi)


def test_mass_on_a_stiff_cable_swings_like_a_pendulum():
    """f = sqrt(g / l) / 2 pi with l from exit to centre of mass: with hardly any inertia it stays in line."""
    length, offset = 1.5, 0.3
    robot = cdpr.Robot(
        exits=[[0, 0, 2]], anchors=[[0, 0, offset]], axial_stiffness=1e9, mass=3.0, mobility="planar",
        center_of_mass=[0, 0, 0], inertia=[1e-7] * 3, platform_size=[0.1] * 3,
    )  # fmt: skip
    problem = cdpr.Problem.of(robot, (0, 0, 2 - offset - length))
    equilibrium = cdpr.solve(robot, problem.pose)
    _, frequency = stiffness(problem, equilibrium.position, equilibrium.rotation.as_matrix())
    expected = np.sqrt(robot.gravity / (length + offset)) / (2 * np.pi)
    assert frequency == pytest.approx(expected, rel=1e-6)  # inertia, 1e-7 of m l², and strain, 1e-8, are not quite 0


def test_free_rotation_has_no_frequency():
    """A mass on one cable turns freely about it: 0 Hz, not the square root of a rounding error."""
    problem = hanging_mass()
    equilibrium = cdpr.solve(problem.robot, problem.pose)
    eigenvalues, frequency = stiffness(problem, equilibrium.position, equilibrium.rotation.as_matrix())
    assert abs(eigenvalues[0]) < 1e-9 * eigenvalues[-1]
    assert frequency == 0


def test_saddle_has_no_frequency():
    """An inverted platform is an equilibrium that nothing returns to: nan."""
    problem = hanging_mass()
    robot = problem.robot.replace(center_of_mass=[0, 0, 0.2], inertia=[1.0, 1.0, 1.0])  # above its anchor
    problem = cdpr.Problem.of(robot, problem.pose)
    stretch = robot.weight * problem.rest_lengths[0] / robot.axial_stiffness[0]
    position = problem.pose.translation - [0, 0, stretch]
    eigenvalues, frequency = stiffness(problem, position, np.eye(3))
    assert eigenvalues[0] < 0
    assert np.isnan(frequency)


def test_poses_without_numbers_give_nan(catalogue):
    """Never an endless iteration, never a number."""
    robot = catalogue["parallel"]
    problem = cdpr.Problem.of(robot, robot.home)
    positions = np.vstack([grid(robot, 8)[:3], [np.nan, 0, 0]])
    with np.errstate(invalid="ignore"):
        eigenvalues, frequency = stiffness(problem, positions, np.eye(3))
    assert np.isnan(eigenvalues[3]).all()
    assert np.isnan(frequency[3])
    assert np.isfinite(eigenvalues[:3]).all()

import numpy as np
import pytest
from hypothesis import given
from problems import hanging_mass, random_problems

import cdpr_sim as cdpr
from cdpr_sim.core import pose
from cdpr_sim.statics import forces as statics

KINK = 1e-4
"""Cables are kept this far [m] from their rest length, ten times the largest step of the finite differences."""


def away_from_kinks(problem: cdpr.Problem, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """A pose near the commanded one at which no cable is close to its rest length."""
    rng = np.random.default_rng(seed)
    step = rng.normal(size=6) * 0.02
    step[np.setdiff1d(np.arange(6), problem.robot.free_directions)] = 0
    for _ in range(100):
        moved = pose.moved(problem.pose, step)
        at = moved.translation, moved.rotation.as_matrix()
        if np.abs(statics.lengths(problem.robot, *at) - problem.rest_lengths).min() > KINK:
            return at
        step *= 1.1
    raise AssertionError("no pose away from the kinks")


def at_step(at, step):
    moved = pose.moved(pose.RigidTransform.from_components(at[0], pose.Rotation.from_matrix(at[1])), step)
    return moved.translation, moved.rotation.as_matrix()


def taylor_slope(remainders, steps):
    """Exponent p of remainder ~ step^p, from the two largest steps, where rounding is smallest."""
    return np.log(remainders[0] / remainders[1]) / np.log(steps[0] / steps[1])


STEPS = np.array([1e-5, 5e-6])
SLOPE_TOLERANCE = 0.1
"""The remainder's next order is a step/length ~ 1e-4 effect; rounding is below 1e-3 of the remainder."""


@pytest.mark.parametrize("seed", range(20))
def test_energy_has_minus_the_net_wrench_as_its_slope(seed):
    """V(q + h d) − V(q) + h w·d is of second order in h: Eq. 3 is the slope of the energy."""
    problem, at, direction = soft_case(seed)
    slope = -statics.net_wrench(problem, *at) @ direction
    remainders = [
        abs(statics.energy(problem, *at_step(at, h * direction)) - statics.energy(problem, *at) - h * slope)
        for h in 100 * STEPS
    ]
    assert taylor_slope(remainders, STEPS) == pytest.approx(2, abs=SLOPE_TOLERANCE)


@pytest.mark.parametrize("seed", range(20))
def test_energy_is_exact_to_second_order_with_the_stiffness_matrix(seed):
    """With slope and Hessian taken off, V's remainder is of third order in the step."""
    problem, at, direction = soft_case(seed)
    slope = -statics.net_wrench(problem, *at) @ direction
    curvature = direction @ statics.stiffness_matrix(problem, *at) @ direction
    remainders = [
        abs(
            statics.energy(problem, *at_step(at, h * direction))
            - statics.energy(problem, *at)
            - h * slope
            - 0.5 * h * h * curvature
        )
        for h in 300 * STEPS
    ]
    assert taylor_slope(remainders, STEPS) == pytest.approx(3, abs=3 * SLOPE_TOLERANCE)


def test_taylor_test_notices_a_wrong_hessian():
    """Negative control: without the weight's part of the Hessian the remainder is of second order, not third."""
    problem, at, direction = soft_case(3)
    weightless = cdpr.Problem.of(problem.robot.replace(gravity=0.0), problem.pose, problem.rest_lengths)
    slope = -statics.net_wrench(problem, *at) @ direction
    curvature = direction @ statics.stiffness_matrix(weightless, *at) @ direction
    remainders = [
        abs(
            statics.energy(problem, *at_step(at, h * direction))
            - statics.energy(problem, *at)
            - h * slope
            - 0.5 * h * h * curvature
        )
        for h in 300 * STEPS
    ]
    assert taylor_slope(remainders, STEPS) < 2.5


def soft_case(seed):
    """A robot with an offset centre of mass, cables of like stiffness and some slack, and a direction of unit size."""
    rng = np.random.default_rng(seed)
    cables = rng.integers(3, 9)
    exits = rng.uniform([-1, -1, 0.6], [1, 1, 1.5], (cables, 3))
    anchors = rng.uniform(-0.15, 0.15, (cables, 3))
    robot = cdpr.Robot(exits, anchors, 50.0, 1.0, center_of_mass=rng.uniform(-0.1, 0.1, 3))
    problem = cdpr.Problem.of(robot, rng.uniform(-0.2, 0.2, 6))
    direction = rng.normal(size=6)
    direction /= np.linalg.norm(direction)
    for attempt in range(100):
        at = away_from_kinks(problem, seed + 1000 * attempt)
        reach = 1e-2  # ten times the largest step taken
        stretch = statics.lengths(robot, *at) - problem.rest_lengths
        if np.abs(stretch).min() > reach:
            return problem, at, direction
    raise AssertionError("no pose far from the kinks")


@given(random_problems())
def test_stiffness_matrix_is_minus_the_derivative_of_the_net_wrench_in_translation(problem):
    """Column by column, by central differences of Eq. 3."""
    at = away_from_kinks(problem, 1)
    h = 1e-6
    matrix = statics.stiffness_matrix(problem, *at)
    scale = np.abs(matrix).max()
    for axis in range(3):
        step = np.zeros(6)
        step[axis] = h
        forward, back = (statics.net_wrench(problem, *at_step(at, sign * step)) for sign in (1, -1))
        # Truncation is (h/l)² ~ 1e-11 and rounding eps/h ~ 1e-10 of the stiffness.
        np.testing.assert_allclose(-(forward - back)[:3] / (2 * h), matrix[:3, axis], rtol=0, atol=1e-8 * scale)


@given(random_problems())
def test_wrench_matrix_columns_are_minus_the_derivatives_of_the_lengths(problem):
    """Virtual work: a cable's wrench is the slope of its length, reversed."""
    at = away_from_kinks(problem, 2)
    h = 1e-6
    W = statics.wrench_matrix(problem.robot, *at)
    for axis in range(6):
        step = np.zeros(6)
        step[axis] = h
        forward, back = (statics.lengths(problem.robot, *at_step(at, sign * step)) for sign in (1, -1))
        np.testing.assert_allclose((forward - back) / (2 * h), -W[axis], rtol=0, atol=1e-9)


@given(random_problems())
def test_slack_cable_has_no_tension_and_a_taut_one_is_stretched(problem):
    """The unilateral law: tension or slack, never both, never a push (Eq. 11)."""
    at = away_from_kinks(problem, 3)
    stretch = statics.lengths(problem.robot, *at) - problem.rest_lengths
    tau = statics.tensions(stretch + problem.rest_lengths, problem.rest_lengths, problem.robot.axial_stiffness)
    assert ((tau == 0) == (stretch <= 0)).all()
    assert (tau >= 0).all()


def test_hanging_mass_stretches_by_its_weight():
    """One vertical cable: at a stretch of m g l0 / EA the forces balance."""
    problem = hanging_mass()
    stretch = problem.robot.weight * problem.rest_lengths[0] / problem.robot.axial_stiffness[0]
    at = problem.pose.translation - [0, 0, stretch], np.eye(3)
    assert statics.residual(problem, *at) < 1e-12 * problem.robot.weight
    lower = problem.pose.translation - [0, 0, 1.01 * stretch], np.eye(3)
    assert statics.residual(problem, *lower) == pytest.approx(0.01 * problem.robot.weight)


def test_everything_broadcasts_over_poses():
    """Many poses at once give what one at a time gives."""
    problem = cdpr.Problem.of(cdpr.load_robot("parallel"), (0.2, 0.25, 0.1))
    positions = np.random.default_rng(0).uniform([0.1, 0.1, 0.05], [0.7, 0.4, 0.4], (2, 3, 3))
    rotations = pose.Rotation.from_rotvec(np.random.default_rng(1).normal(size=(6, 3))).as_matrix().reshape(2, 3, 3, 3)
    for function in (
        statics.net_wrench,
        statics.energy,
        statics.stiffness_matrix,
        statics.eigenvalues,
        statics.residual,
    ):
        many = function(problem, positions, rotations)
        one = function(problem, positions[1, 2], rotations[1, 2])
        np.testing.assert_allclose(many[1, 2], one, rtol=1e-12, atol=1e-12)

import numpy as np
import pytest
from hypothesis import given
from sample_problems import random_problems

import cdpr_sim as cdpr
from cdpr_sim.core import pose
from cdpr_sim.statics import forces

KINK = 1e-4
"""Cables are kept this far [m] from their rest length, ten times the largest step of the finite differences."""

At = tuple[np.ndarray, np.ndarray]
"""A position [m] and a rotation matrix."""


def away_from_kinks(problem: cdpr.Problem, seed: int) -> At:
    """A pose near the commanded one at which no cable is close to its rest length."""
    rng = np.random.default_rng(seed)
    step = rng.normal(size=6) * 0.02
    step[np.setdiff1d(np.arange(6), problem.robot.free)] = 0
    for _ in range(100):
        moved = pose.moved(problem.pose, step)
        at = moved.translation, moved.rotation.as_matrix()
        if np.abs(forces.geometry(problem.robot, *at).lengths - problem.rest_lengths).min() > KINK:
            return at
        step *= 1.1
    raise AssertionError("no pose away from the kinks")


def at_step(at: At, step: np.ndarray) -> At:
    moved = pose.moved(pose.RigidTransform.from_components(at[0], pose.Rotation.from_matrix(at[1])), step)
    return moved.translation, moved.rotation.as_matrix()


# --- the energy, its slope and its curvature -----------------------------------------------------------------------

STEPS = np.array([1e-5, 5e-6])
SLOPE_TOLERANCE = 0.1
"""The remainder's next order is a step/length ~ 1e-4 effect; rounding is below 1e-3 of the remainder."""

CASES = 10
"""Random robots, poses and directions: enough to meet 3 to 8 cables, taut and slack."""


def soft_case(seed: int) -> tuple[cdpr.Problem, At, np.ndarray]:
    """A robot with an offset centre of mass, at a pose where about every other cable is slack, and a direction."""
    rng = np.random.default_rng(seed)
    cables = rng.integers(3, 9)
    exits = rng.uniform([-1, -1, 0.6], [1, 1, 1.5], (cables, 3))
    anchors = rng.uniform(-0.15, 0.15, (cables, 3))
    robot = cdpr.Robot(exits, anchors, 50.0, 1.0, center_of_mass=rng.uniform(-0.1, 0.1, 3))
    at = pose.Pose.of(rng.uniform(-0.2, 0.2, 6)).transform
    lengths = robot.rest_lengths(at) * rng.choice([0.9, 1.1], cables)  # far from the kinks for any step taken here
    direction = rng.normal(size=6)
    return (
        cdpr.Problem.of(robot, at, lengths),
        (at.translation, at.rotation.as_matrix()),
        direction / np.linalg.norm(direction),
    )


def order_of_remainder(
    problem: cdpr.Problem, at: At, direction: np.ndarray, sizes: np.ndarray, slope: float, curvature: float = 0.0
) -> float:
    """The exponent p with which V(q + h d) − V(q) − h slope − ½ h² curvature falls as h^p."""
    start = forces.at(problem, *at).energy
    remainders = [
        abs(forces.at(problem, *at_step(at, h * direction)).energy - start - h * slope - 0.5 * h * h * curvature)
        for h in sizes
    ]
    return np.log(remainders[0] / remainders[1]) / np.log(sizes[0] / sizes[1])


def test_energy_has_the_net_wrench_as_its_slope_and_the_stiffness_matrix_as_its_curvature():
    """Taylor: with the slope taken off (Eq. 3), V's remainder is of second order in the step; with both, of third."""
    some_slack = 0
    for seed in range(CASES):
        problem, at, direction = soft_case(seed)
        state = forces.at(problem, *at)
        some_slack += 0 < (state.tensions == 0).sum() < len(state.tensions)
        slope, curvature = -state.net_wrench @ direction, direction @ state.stiffness_matrix @ direction
        second = order_of_remainder(problem, at, direction, 100 * STEPS, slope)
        assert second == pytest.approx(2, abs=SLOPE_TOLERANCE), seed
        third = order_of_remainder(problem, at, direction, 300 * STEPS, slope, curvature)
        assert third == pytest.approx(3, abs=3 * SLOPE_TOLERANCE), seed
    assert some_slack > 0.8 * CASES


def test_taylor_test_notices_a_wrong_hessian():
    """Negative control: without the weight's part of the Hessian the remainder is of second order, not third."""
    problem, at, direction = soft_case(3)
    weightless = cdpr.Problem.of(problem.robot.replace(gravity=0.0), problem.pose, problem.rest_lengths)
    slope = -forces.at(problem, *at).net_wrench @ direction
    curvature = direction @ forces.at(weightless, *at).stiffness_matrix @ direction
    assert order_of_remainder(problem, at, direction, 300 * STEPS, slope, curvature) < 2.5


# --- the law ------------------------------------------------------------------------------------------------------


@given(random_problems())
def test_slack_cable_has_no_tension_and_a_taut_one_is_stretched(problem):
    """The unilateral law: tension or slack, never both, never a push, and Hooke's where it pulls (Eq. 10, 11)."""
    state = forces.at(problem, *away_from_kinks(problem, 3))
    stretch = state.lengths - problem.rest_lengths
    springs = problem.robot.axial_stiffness / problem.rest_lengths
    assert ((state.tensions == 0) == (stretch <= 0)).all()
    assert (state.tensions >= 0).all()
    np.testing.assert_allclose(state.tensions, np.where(stretch > 0, springs * stretch, 0), rtol=1e-12)
    np.testing.assert_allclose(state.tangent_stiffness, np.where(stretch > 0, springs, 0), rtol=1e-12)


def test_residual_is_the_largest_force_with_torques_over_the_characteristic_length():
    """0.3 N and 0.02 N m left over on anchors 0.05 m from the origin: 0.4 N; and what the plane carries counts not."""
    anchors = [[-0.05, 0, 0], [0.05, 0, 0]]
    exits = [[-0.05, 0, 1], [0.05, 0, 1]]
    weightless = cdpr.Robot(exits, anchors, 1e3, 1.0, gravity=0.0)
    wrench = [0.3, 0, 0, 0, 0, 0.02]
    problem = cdpr.Problem.of(weightless, (0, 0, 0), external_wrench=wrench)
    assert weightless.characteristic_length == pytest.approx(0.05)
    at = problem.pose.translation, problem.pose.rotation.as_matrix()
    assert forces.at(problem, *at).residual == pytest.approx(0.4)
    planar = cdpr.Problem(weightless.replace(mobility="planar"), problem.pose, problem.rest_lengths, np.array(wrench))
    assert forces.at(planar, *at).residual == pytest.approx(0.3)


# --- many at once ---------------------------------------------------------------------------------------------------

QUANTITIES = (
    "tensions", "lengths", "wrench_matrix", "load_wrench", "net_wrench", "residual", "energy", "stiffness_matrix",
    "eigenvalues", "tangent_stiffness",
)  # fmt: skip


def test_everything_broadcasts_over_poses_and_over_problems():
    """Many poses at once, of one problem or of as many, give what one at a time gives."""
    robot = cdpr.load_robot("parallel").replace(center_of_mass=(0.01, 0.02, -0.01))
    rng = np.random.default_rng(0)
    positions = rng.uniform([0.1, 0.1, 0.05], [0.7, 0.4, 0.4], (2, 3, 3))
    rotations = pose.Rotation.from_rotvec(rng.normal(size=(6, 3))).as_matrix().reshape(2, 3, 3, 3)
    wrenches, stiffnesses = rng.normal(size=(2, 3, 6)), rng.uniform(1e3, 1e5, (2, 3, 8))
    one = cdpr.Problem.of(robot, (0.2, 0.25, 0.1))
    many = cdpr.Problems.of(robot, positions, external_wrench=wrenches, axial_stiffness=stiffnesses, mass=[1.0, 2, 3])
    for asked, alone in ((one, one), (many, many[1, 2])):
        together, single = forces.at(asked, positions, rotations), forces.at(alone, positions[1, 2], rotations[1, 2])
        for name in QUANTITIES:
            np.testing.assert_allclose(
                getattr(together, name)[1, 2], getattr(single, name), rtol=1e-12, atol=1e-12, err_msg=name
            )

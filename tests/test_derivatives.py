import numpy as np
import pytest
from hypothesis import given, settings
from problems import random_problems

import cdpr_sim as cdpr
from cdpr_sim.core.pose import moved
from cdpr_sim.statics import derivatives
from cdpr_sim.statics import forces as statics

SLOPE = 1e-6
"""Relative error of central differences over 1e-6 m: rounding of 1e-16/1e-6 times what nearly cancels; the test's own
negative control shows what it does not let pass."""

KINK = 1e-4
"""[m] A problem with a cable this close to its rest length is not differenced: there the slope jumps."""


def changed(problem: cdpr.Problem, name: str, index: int, step: float) -> cdpr.Problem:
    """``problem`` with one number of one parameter changed."""
    holder = problem if name in ("rest_lengths", "external_wrench") else problem.robot
    value = np.array(getattr(holder, name), dtype=float)
    value.reshape(-1)[index] += step
    robot, rest, wrench = problem.robot, problem.rest_lengths, problem.external_wrench
    if name == "rest_lengths":
        rest = value
    elif name == "external_wrench":
        wrench = value
    else:
        robot = robot.replace(**{name: value if value.ndim else float(value)})
    return cdpr.Problem(robot, problem.pose, rest, wrench)


def away_from_kinks(problem: cdpr.Problem) -> bool:
    lengths = statics.lengths(problem.robot, problem.pose.translation, problem.pose.rotation.as_matrix())
    return bool(np.abs(lengths - problem.rest_lengths).min() > KINK)


def stretched(problem: cdpr.Problem, torque: bool = True) -> cdpr.Problem:
    """``problem`` with some cables taut and others slack, and a torque: out of balance."""
    factors = np.where(np.arange(problem.robot.cables) % 3 == 2, 1.02, 0.97)
    wrench = problem.external_wrench + (np.array([0, 0, 0, 0, 0.01, 0]) * problem.load if torque else 0)
    return cdpr.Problem.of(problem.robot, problem.pose, problem.rest_lengths * factors, wrench)


@settings(max_examples=40)
@given(random_problems())
def test_slope_of_the_wrench_is_exact_out_of_balance_and_under_a_torque(problem):
    """Against central differences, at poses that are no equilibria: there the slope is not symmetric."""
    problem = stretched(problem)
    if not away_from_kinks(problem):
        return
    position, rotation = problem.pose.translation, problem.pose.rotation.as_matrix()
    exact = derivatives.wrench_slope(problem, position, rotation)

    def wrench(step):
        pose = moved(problem.pose, step)
        return statics.net_wrench(problem, pose.translation, pose.rotation.as_matrix())

    differenced = np.array([(wrench(1e-6 * d) - wrench(-1e-6 * d)) / 2e-6 for d in np.eye(6)]).T
    assert np.abs(exact - differenced).max() <= SLOPE * np.abs(exact).max()
    # Negative control: without the term that makes it unsymmetric, the differences show it.
    symmetric = -statics.stiffness_matrix(problem, position, rotation)
    torque = statics.net_wrench(problem, position, rotation)[3:] - problem.external_wrench[3:]
    if np.abs(torque).max() > 1e2 * SLOPE * np.abs(exact).max():
        assert np.abs(symmetric - differenced).max() > SLOPE * np.abs(exact).max()


@pytest.mark.parametrize("name", derivatives.PARAMETERS)
@settings(max_examples=20)
@given(problem=random_problems())
def test_wrench_and_tensions_by_parameter_are_exact(name, problem):
    """Every column against central differences, in every parameter."""
    problem = stretched(problem, torque=False)
    if not away_from_kinks(problem):
        return
    position, rotation = problem.pose.translation, problem.pose.rotation.as_matrix()
    wrench = derivatives.wrench_by_parameter(problem, position, rotation)[name]
    tension = derivatives.tension_by_parameter(problem, position, rotation)[name]
    # The wrench is linear in mass and external wrench, so that their steps may be large and rounding small.
    stiffness = problem.robot.axial_stiffness.mean()
    steps = {"axial_stiffness": 1e-6 * stiffness, "mass": 0.1 * problem.robot.mass, "external_wrench": 1e-3 * stiffness}
    size = steps.get(name, 1e-6)

    def both(index: int, step: float) -> np.ndarray:
        other = changed(problem, name, index, step)
        tau = statics.tensions(
            statics.lengths(other.robot, position, rotation), other.rest_lengths, other.robot.axial_stiffness
        )
        return np.concatenate([statics.net_wrench(other, position, rotation), tau])

    planar = problem.robot.mobility == "planar"
    for index in range(wrench.shape[1]):
        if planar and (name in ("exits", "anchors", "center_of_mass") and index % 3 == 1):
            continue
        differenced = (both(index, size) - both(index, -size)) / (2 * size)
        exact = np.concatenate([wrench[:, index], tension[:, index]])
        scale = max(np.abs(exact).max(), 1e-9 * problem.load / size)
        assert np.abs(exact - differenced).max() <= 10 * SLOPE * scale

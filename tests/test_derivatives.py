from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import assume, given, settings
from sample_problems import random_problems

import cdpr_sim as cdpr
from cdpr_sim.core.pose import moved
from cdpr_sim.statics import derivatives, forces

SLOPE = 1e-6
"""Relative error of central differences over 1e-6 m: rounding of 1e-16/1e-6 times what nearly cancels; the test's own
negative control shows what it does not let pass."""

KINK = 1e-4
"""[m] A problem with a cable this close to its rest length is not differenced: there the slope jumps."""


def changed(problem: cdpr.Problem, name: str, index: int, step: float) -> cdpr.Problem:
    """``problem`` with one number of one parameter changed. What lies on the wheels does not follow."""
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
        robot.__dict__["wrapped_lengths"] = problem.robot.wrapped_lengths
    return cdpr.Problem(robot, problem.pose, rest, wrench)


def at(problem: cdpr.Problem) -> forces.State:
    """The forces at the commanded pose."""
    return forces.at(problem, problem.pose.translation, problem.pose.rotation.as_matrix())


def stretched(problem: cdpr.Problem, torque: bool = True) -> cdpr.Problem:
    """``problem`` with some cables taut and others slack, and a torque: out of balance."""
    factors = np.where(np.arange(problem.robot.cables) % 3 == 2, 1.02, 0.97)
    wrench = problem.external_wrench + (np.array([0, 0, 0, 0, 0.01, 0]) * problem.load if torque else 0)
    changed = cdpr.Problem.of(problem.robot, problem.pose, problem.rest_lengths * factors, wrench)
    assume(np.abs(at(changed).lengths - changed.rest_lengths).min() > KINK)
    return changed


def by_step(problem: cdpr.Problem, quantity: Callable[[forces.State], np.ndarray], size: float = 1e-6) -> np.ndarray:
    """Central differences of what is computed from the forces, by a shift along and a rotation about each axis."""

    def there(step: np.ndarray) -> np.ndarray:
        pose = moved(problem.pose, step)
        return quantity(forces.at(problem, pose.translation, pose.rotation.as_matrix()))

    return np.array([(there(size * unit) - there(-size * unit)) / (2 * size) for unit in np.eye(6)]).T


@settings(max_examples=15)
@given(random_problems())
def test_slopes_of_wrench_and_tensions_are_exact_out_of_balance_and_under_a_torque(problem):
    """Against central differences, at poses that are no equilibria: there the wrench's slope is not symmetric."""
    problem = stretched(problem)
    state = at(problem)
    exact, differenced = derivatives.wrench_slope(state), by_step(problem, lambda state: state.net_wrench)
    assert np.abs(exact - differenced).max() <= SLOPE * np.abs(exact).max()
    # Negative control: without the term that makes it unsymmetric, the differences show it.
    torque = state.net_wrench[3:] - problem.external_wrench[3:]
    if np.abs(torque).max() > 1e2 * SLOPE * np.abs(exact).max():
        assert np.abs(-state.stiffness_matrix - differenced).max() > SLOPE * np.abs(exact).max()
    exact = derivatives.tension_by_pose(state)
    assert np.abs(exact - by_step(problem, lambda state: state.tensions)).max() <= SLOPE * np.abs(exact).max()


@settings(max_examples=10)
@given(random_problems())
def test_slope_at_fixed_tensions_is_that_of_cables_without_elasticity(problem):
    """Against central differences of W tau + w_e with tau as it is."""
    problem = stretched(problem)
    state = at(problem)
    exact, _ = derivatives.wrench_under_tensions(state)
    differenced = by_step(problem, lambda other: other.wrench_matrix @ state.tensions + other.load_wrench)
    # What is left is small beside the elastic part that was taken off, whose rounding stays.
    assert np.abs(exact - differenced).max() <= SLOPE * np.abs(exact).max() + 1e-12 * state.tangent_stiffness.max()


@settings(max_examples=8)
@given(problem=random_problems())
def test_wrench_and_tensions_by_parameter_are_exact(problem):
    """Every column against central differences, in every parameter."""
    problem = stretched(problem, torque=False)
    state = at(problem)
    wrenches, tensions = derivatives.wrench_by_parameter(state), derivatives.tension_by_parameter(state)
    assert wrenches.keys() == tensions.keys() == set(derivatives.PARAMETERS)
    # The wrench is linear in mass and external wrench, so that their steps may be large and rounding small.
    stiffness = problem.robot.axial_stiffness.mean()
    steps = {"axial_stiffness": 1e-6 * stiffness, "mass": 0.1 * problem.robot.mass, "external_wrench": 1e-3 * stiffness}

    def both(name: str, index: int, step: float) -> np.ndarray:
        other = at(changed(problem, name, index, step))
        return np.concatenate([other.net_wrench, other.tensions])

    planar = problem.robot.mobility == "planar"
    for name in derivatives.PARAMETERS:
        size = steps.get(name, 1e-6)
        wrench, tension = wrenches[name], tensions[name]
        for index in range(wrench.shape[1]):
            if planar and (name in ("exits", "anchors", "center_of_mass") and index % 3 == 1):
                continue
            differenced = (both(name, index, size) - both(name, index, -size)) / (2 * size)
            exact = np.concatenate([wrench[:, index], tension[:, index]])
            scale = max(np.abs(exact).max(), 1e-9 * problem.load / size)
            assert np.abs(exact - differenced).max() <= 10 * SLOPE * scale, (name, index)


@pytest.mark.parametrize("seed", range(4))
def test_derivatives_of_cables_of_every_kind_are_exact(seed):
    """Of robots that mix wheels, laws, drive lines and, each second one, masses: energy, every parameter, the pose.

    Taut and slack cables, out of balance and under a torque, which has no energy.
    """
    random = np.random.default_rng(seed)
    robot = cdpr.load_robot("cogiro").replace(
        axial_stiffness=10 ** random.uniform(3, 4, 8), linear_density=0.01 * (random.random(8) < 0.8) * (seed % 2),
        pulley_radius=0.02 * (random.random(8) < 0.6),
        stiffening=np.array([20.0, 500.0]) * (random.random((8, 1)) < 0.6),
        winch_to_exit=random.uniform(0, 0.8, 8) * (random.random(8) < 0.5), reeving=random.integers(1, 4, 8),
    )  # fmt: skip
    pose, torque = (0.2, 0.25, 0.15, 0.05, -0.03, 0.1), np.array([0, 0, 0, 0, 0.01, 0.02])
    rest = robot.rest_lengths(pose) * random.choice([0.97, 0.999, 1.02], 8)
    problem = cdpr.Problem.of(robot, pose, rest, [0.1, -0.2, 0.3, *torque[3:]])
    state = at(problem)

    def both(name: str, index: int, step: float) -> np.ndarray:
        other = at(changed(problem, name, index, step))
        return np.concatenate([other.net_wrench, other.tensions])

    wrenches, tensions = derivatives.wrench_by_parameter(state), derivatives.tension_by_parameter(state)
    of_kinds = {"pulley_radius", "stiffening", "winch_to_exit"} | ({"linear_density"} if seed % 2 else set())
    every = {*derivatives.PARAMETERS, *of_kinds}
    assert set(wrenches) == set(tensions) == set(derivatives.parameters(robot)) == every
    sizes = {
        "axial_stiffness": 0.1, "mass": 0.01, "external_wrench": 1e-3, "linear_density": 1e-5, "stiffening": 0.1
    }  # fmt: skip
    for name, wrench in wrenches.items():
        size = sizes.get(name, 1e-6)
        scale = max(np.abs(wrench).max(), np.abs(tensions[name]).max(), 1e-9 * problem.load / size)
        for index in range(wrench.shape[1]):
            if name == "pulley_radius" and robot.pulley_radius[index] == 0:
                continue
            exact = np.concatenate([wrench[:, index], tensions[name][:, index]])
            steps, weights = (-2, -1, 1, 2), (1 / 12, -2 / 3, 2 / 3, -1 / 12)
            zero = name in ("linear_density", "winch_to_exit") and getattr(robot, name)[index] == 0
            if zero:  # to one side
                steps, weights = (0, 1, 2, 3, 4), (-25 / 12, 4, -3, 4 / 3, -1 / 4)
            there = [both(name, index, step * size) for step in steps]
            differenced = sum(w * one for w, one in zip(weights, there, strict=True)) / size
            assert np.abs(exact - differenced).max() <= 10 * SLOPE * scale, (name, index)

    exact = np.vstack([derivatives.wrench_slope(state), derivatives.tension_by_pose(state)])
    differenced = by_step(problem, lambda state: np.concatenate([state.net_wrench, state.tensions]))
    assert np.abs(exact - differenced).max() <= SLOPE * np.abs(exact).max()
    by_energy = -by_step(problem, lambda state: np.array([state.energy])).ravel()
    assert np.abs(by_energy + torque - state.net_wrench).max() <= SLOPE * np.abs(state.net_wrench).max()


def test_derivatives_at_many_poses_are_those_at_each():
    """Of problems with masses of their own, with and without mass, taut and slack."""
    robot = cdpr.load_robot("parallel").replace(linear_density=[5e-4] * 4 + [0.0] * 4, pulley_radius=0.005)
    poses = np.random.default_rng(0).uniform(*robot.workspace, (6, 3))
    found = cdpr.solve_many(robot, poses, mass=np.linspace(0.9, 1.1, 6) * robot.mass)
    assert found.slack.any()
    many = forces.at(found.problems, found.positions, found.rotations)
    for derivative in (derivatives.wrench_by_parameter, derivatives.tension_by_parameter):
        for row, by in enumerate(map(derivative, map(forces.at, found.problems, found.positions, found.rotations))):
            for name, each in derivative(many).items():
                np.testing.assert_allclose(each[row], by[name], rtol=0, atol=1e-10 * np.abs(by[name]).max())

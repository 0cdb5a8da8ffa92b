"""All derivatives: (quantity, by what) rows, each exact to the order of a Taylor series, or of equilibria solved anew.

Derivatives of equilibria by one number of each parameter are also judged by the oracle, row ``sensitivity`` of
``test_matrix.py``.
"""

import functools
from dataclasses import replace

import numpy as np
import pytest
from sample_problems import random_problem

import cdpr_sim as cdpr
from cdpr_sim.core import cable_law
from cdpr_sim.core.pose import moved
from cdpr_sim.statics import derivatives, forces

ORDER = 2.9
"""Least exponent with which a central difference's error falls with the step: 3 but for terms of higher order. An error
of the slope makes it 1."""

NEGLIGIBLE = 1e-9
"""Of the difference: what is left where a quantity is of second order, or rounding is all."""


def stretched(robot: cdpr.Robot, pose, factors) -> cdpr.Problem:
    """Some cables taut and others slack, none close to its rest length, a force and a torque: out of balance."""
    load = 0.1 * robot.weight * np.array([0.3, 0.2, 0.4, 0.01, 0.03, 0.02])
    load[np.setdiff1d(np.arange(6), robot.free)] = 0
    rest = robot.rest_lengths(pose) * np.resize(factors, robot.cables)
    return cdpr.Problem.of(robot, pose, rest, load)


def mixed(seed: int, heavy: bool = False) -> cdpr.Problem:
    """Wheels, laws, drive lines and reeving on some cables, and masses."""
    random = np.random.default_rng(seed)
    robot = cdpr.load_robot("cogiro").replace(
        axial_stiffness=10 ** random.uniform(3, 4, 8), linear_density=0.01 * heavy * (random.random(8) < 0.8),
        pulley_radius=0.02 * (random.random(8) < 0.6), center_of_mass=(0.01, 0.02, -0.01),
        stiffening=np.array([20.0, 500.0]) * (random.random((8, 1)) < 0.6),
        winch_to_exit=random.uniform(0, 0.8, 8) * (random.random(8) < 0.5), reeving=random.integers(1, 4, 8),
    )  # fmt: skip
    return stretched(robot, (0.2, 0.25, 0.15, 0.05, -0.03, 0.1), random.choice([0.97, 0.98, 1.02], 8))


CASES = {
    "plain": lambda: stretched(
        cdpr.load_robot("parallel").replace(center_of_mass=(0.01, 0.02, -0.01)), (0.3, 0.25, 0.2, 0.1, -0.2, 0.3),
        [0.97, 0.98, 1.02],
    ),
    "planar": lambda: stretched(
        cdpr.load_robot("planar-vertical").replace(center_of_mass=(0.01, 0, -0.01)), (0.3, 0, 0.2, 0, 0.2, 0),
        [0.97, 1.02, 0.98],
    ),
    "random": lambda: stretched((at := random_problem(11)).robot, at.pose, [0.97, 1.02, 0.96]),
    "mixed": lambda: mixed(1),
    "mixed, too": lambda: mixed(4),
    "with mass": lambda: mixed(3, heavy=True),
    "with mass, too": lambda: mixed(5, heavy=True),
}  # fmt: skip


@functools.cache
def case(name: str) -> tuple[cdpr.Problem, forces.State]:
    problem = CASES[name]()
    return problem, forces.at(problem, problem.position, problem.pose.rotation.as_matrix())


def order(value, slope: np.ndarray, step: np.ndarray, one_sided: bool = False) -> float:
    """With which power of the step the remainder falls; infinite where it is negligible."""
    left = []
    for part in (1.0, 0.5):
        before = value(0 * step) if one_sided else value(-part * step)
        exact = (1 if one_sided else 2) * part * slope @ step
        left.append(np.abs(value(part * step) - before - exact).max())
    if left[0] <= NEGLIGIBLE * np.abs(exact).max() + 1e-14 * np.abs(value(0 * step)).max():
        return np.inf
    return np.log2(left[0] / left[1]) + one_sided


def direction(size: float, numbers: int, seed: int = 0) -> np.ndarray:
    """No number much smaller than the others."""
    random = np.random.default_rng(seed)
    return size * random.uniform(0.5, 1, numbers) * random.choice([-1, 1], numbers)


# --- by the pose ---------------------------------------------------------------------------------------------------

BY_POSE = {
    "energy": (lambda at: at.energy[None], lambda at: at.problem.external_wrench * [0, 0, 0, 1, 1, 1] - at.net_wrench),
    "net wrench": (lambda at: at.net_wrench, derivatives.wrench_slope),
    "tensions": (lambda at: at.tensions, derivatives.tension_by_pose),
    "lengths": (lambda at: at.lengths, lambda at: -at.geometry.wrench_matrix.T / at.problem.robot.reeving[:, None]),
}
"""A quantity of a state, and its slope; an external torque has no energy."""


@pytest.mark.parametrize("quantity", BY_POSE)
@pytest.mark.parametrize("name", CASES)
def test_slopes_by_the_pose_are_exact_out_of_balance_and_under_a_torque(name, quantity):
    """Along a shift and a rotation at once; there the wrench's slope is not symmetric."""
    problem, state = case(name)
    value, slope = BY_POSE[quantity]
    step = np.zeros(6)
    step[problem.robot.free] = direction(1e-3, len(problem.robot.free))

    def at(step):
        pose = moved(problem.pose, step)
        return value(forces.at(problem, pose.translation, pose.rotation.as_matrix()))

    assert order(at, np.atleast_2d(slope(state)), step) >= ORDER
    if (name, quantity) == ("plain", "net wrench"):  # negative control: without the term that makes it unsymmetric
        assert order(at, -state.stiffness_matrix, step) < 2


# --- by the parameters ---------------------------------------------------------------------------------------------

SIZES = {
    "axial_stiffness": 50.0, "mass": 0.01, "external_wrench": 0.1, "linear_density": 1e-3, "stiffening": 1.0,
    "winch_to_exit": 1e-2,
}  # fmt: skip
"""Of steps; lengths have a millimetre."""


def changed(problem: cdpr.Problem, name: str, step: np.ndarray) -> cdpr.Problem:
    """``problem`` with all numbers of a parameter changed."""
    holder = problem if name in ("rest_lengths", "external_wrench") else problem.robot
    value = np.array(getattr(holder, name), dtype=float)
    value = value + step.reshape(value.shape)
    if holder is problem:
        return replace(problem, **{name: value})
    robot = problem.robot.replace(workspace=problem.robot.workspace, **{name: value if value.ndim else float(value)})
    return cdpr.Problem(robot, problem.pose, problem.rest_lengths, problem.external_wrench)


def along(problem: cdpr.Problem, name: str, seed: int = 0) -> np.ndarray:
    """A step of all numbers of a parameter that can change, in the plane of a planar robot."""
    value = np.ravel(getattr(problem if name in ("rest_lengths", "external_wrench") else problem.robot, name))
    step = direction(SIZES.get(name, 1e-3), value.size, seed)
    if problem.robot.mobility == "planar" and name in ("exits", "anchors", "center_of_mass"):
        step[1::3] = 0
    if problem.robot.mobility == "planar" and name == "external_wrench":
        step[[1, 3, 5]] = 0
    if name in ("pulley_radius", "stiffening"):
        step[value == 0] = 0
    return np.where(value == 0, np.abs(step), step) if name in ("linear_density", "winch_to_exit") else step


@pytest.mark.parametrize("name", CASES)
def test_wrench_and_tensions_by_every_parameter_are_exact(name):
    """All numbers of a parameter at once; to one side where some are 0 and cannot be less."""
    problem, state = case(name)
    by = derivatives.by_parameter(state, derivatives.parameters(problem.robot))
    wrenches, tensions = ({parameter: both[kind] for parameter, both in by.items()} for kind in (0, 1))
    more = {"pulley_radius", "stiffening", "winch_to_exit"} if "mi" in name or "mass" in name else set()
    more |= {"linear_density"} if "mass" in name else set()
    expected = {*derivatives.PARAMETERS, *more}
    assert set(wrenches) == set(tensions) == set(derivatives.parameters(problem.robot)) == expected
    units = problem.robot.units
    for parameter, slope in wrenches.items():
        zeros = parameter in ("linear_density", "winch_to_exit")
        step = along(problem, parameter) * (1e-2 if zeros else 1)
        for value, by in (
            (lambda at: at.net_wrench / units, slope / units[:, None]), (lambda at: at.tensions, tensions[parameter])
        ):  # fmt: skip

            def at(step, value=value, parameter=parameter):
                other = changed(problem, parameter, step)
                return value(forces.at(other, other.position, other.pose.rotation.as_matrix()))

            assert order(at, by, step, one_sided=zeros) >= ORDER - 0.1 * zeros, parameter


def test_what_lies_on_a_wheel_follows_exit_and_anchor(monkeypatch):
    """Of heavy ropes on large wheels it is a 400th of the derivative; left out, the order of Taylor's series is 1."""
    robot = cdpr.load_robot("cogiro").replace(linear_density=2.0, pulley_radius=0.1, axial_stiffness=1e3)
    problem = cdpr.Problem.of(robot, (0.2, 0.25, 0.15, 0.05, -0.03, 0.1))
    state = forces.at(problem, problem.position, problem.pose.rotation.as_matrix())
    for name in ("exits", "anchors"):
        step = 0.1 * along(problem, name)

        def at(step, name=name):
            other = changed(problem, name, step)
            return forces.at(other, other.position, other.pose.rotation.as_matrix()).tensions

        assert order(at, derivatives.by_parameter(state, [name])[name][1], step) >= ORDER
        with monkeypatch.context() as without:
            without.setattr(derivatives, "_wrapped_by_exit", lambda robot: np.zeros((robot.cables, 3)))
            assert order(at, derivatives.by_parameter(state, [name])[name][1], step) < 2


def test_energy_tension_and_tangent_of_a_law_are_one_potential():
    """Also beyond the strain of 20 % where it goes on straight."""
    stretch = np.array([0.01, 0.1, 0.19, 0.25, 0.6])
    law = 1.0, (1e4, 20.0, 300.0)
    slope, _ = cable_law.tangent(stretch, *law)
    for value, exact in ((cable_law.energy, cable_law.tension(stretch, *law)), (cable_law.tension, slope)):
        by = np.diag(np.asarray(exact))
        assert order(lambda step, value=value: value(stretch + step, *law), by, direction(1e-3, 5)) >= ORDER


# --- of equilibria -------------------------------------------------------------------------------------------------


def test_tilt_grows_as_the_solver_says(catalogue):
    """Its own derivative, against the solver's tilt."""
    robot = catalogue["parallel"]
    base = cdpr.solve(robot, (0.2, 0.22, 0.1))
    exact = cdpr.sensitivity(base).tilt("rest_lengths")[0]
    tilts = [cdpr.solve(robot, base.pose, base.rest_lengths + np.eye(8)[0] * step).tilt for step in (1e-6, -1e-6)]
    assert exact == pytest.approx((tilts[0] - tilts[1]) / 2e-6, rel=1e-4)


def test_effects_are_what_a_millimetre_a_percent_and_a_newton_do(catalogue):
    """Every number's name and unit, and its effect in mm, degrees and N; the largest first."""
    robot = catalogue["parallel"].replace(axial_stiffness=np.linspace(4e3, 6e3, 8))
    answer = cdpr.sensitivity(robot, (0.25, 0.25, 0.1))
    meant = {f"rest length {i + 1}": ("rest_lengths", i, "mm", 1e-3) for i in range(8)}
    meant |= {f"EA of cable {i + 1}": ("axial_stiffness", i, "%", robot.axial_stiffness[i] / 100) for i in range(8)}
    for which in ("exit", "anchor"):
        for i, number in enumerate(f"{which} {cable} {axis}" for cable in range(1, 9) for axis in "xyz"):
            meant[number] = (f"{which}s", i, "mm", 1e-3)
    meant["mass"] = ("mass", 0, "%", robot.mass / 100)
    for i, axis in enumerate("xyz"):
        meant[f"centre of mass {axis}"] = ("center_of_mass", i, "mm", 1e-3)
        meant[f"force {axis}"] = ("external_wrench", i, "N", 1.0)
        meant[f"torque {axis}"] = ("external_wrench", 3 + i, "N mm", 1e-3)
    effects = answer.effects()
    assert sorted(effect.name for effect in effects) == sorted(meant)
    for effect in effects:
        parameter, index, per, size = meant[effect.name]
        assert (effect.parameter, effect.index, effect.per) == (parameter, index, per)
        step = size * answer.pose[parameter][:, index]
        assert effect.position == pytest.approx(1000 * np.linalg.norm(step[:3]))
        assert effect.rotation == pytest.approx(np.linalg.norm(step[3:]) * 180 / np.pi)
        assert effect.tension == pytest.approx(size * np.abs(answer.tensions[parameter][:, index]).max())
    moves = [np.hypot(e.position, np.radians(e.rotation) * 1000 * robot.characteristic_length) for e in effects]
    assert moves == sorted(moves, reverse=True)
    stretches = answer.equilibrium.lengths - answer.equilibrium.rest_lengths
    assert answer.margin == min(abs(stretches))

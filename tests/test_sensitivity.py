from dataclasses import replace

import numpy as np
import pytest
from sample_problems import hanging_mass
from test_derivatives import changed

import cdpr_sim as cdpr
from cdpr_sim.core.pose import moved
from cdpr_sim.statics import derivatives, forces

CUBE = 1e-4
"""Relative error of central differences through the solver: its rounding over the step, and the square of the step; at
most 4e-7 measured on the catalogue with the steps below."""

KINK = 1e-5
"""[m] Closer to its rest length than this, a cable may change between slack and taut while we difference."""


def moved_by(problem: cdpr.Problem, base: cdpr.Equilibrium, name: str, index: int, step: float) -> np.ndarray:
    """(pose step, tensions) from ``base`` of the equilibrium of a changed problem, solved anew from there."""
    other = changed(
        cdpr.Problem(problem.robot, base.pose, base.rest_lengths, problem.external_wrench), name, index, step
    )
    aside = np.zeros(6)
    aside[problem.robot.free] = 1e-4  # or the solver would find the old pose good enough
    found = cdpr.solve(replace(other, pose=moved(base.pose, aside)))
    shift = found.position - base.position
    return np.concatenate([shift, (found.rotation * base.rotation.inv()).as_rotvec(), found.tensions])


def check_column(problem, base, answer, name: str, index: int, size: float) -> bool:
    """Whether exact and differenced columns agree."""
    up, down = (moved_by(problem, base, name, index, sign * size) for sign in (1, -1))
    differenced = (up - down) / (2 * size)
    exact = np.concatenate([answer.pose[name][:, index], answer.tensions[name][:, index]])
    units = problem.robot.units
    motion = np.abs((exact - differenced)[:6] * units).max() / max(np.abs(exact[:6] * units).max(), 1e-9 / size)
    tension = np.abs((exact - differenced)[6:]).max() / max(np.abs(exact[6:]).max(), 1e-7 * problem.load / size)
    return bool(max(motion, tension) <= CUBE)


def sizes(robot: cdpr.Robot) -> dict[str, float]:
    """Steps large enough for the solver's rounding, small enough for the cube of them; lengths have 1e-5 m."""
    return {"axial_stiffness": 1e-4 * robot.axial_stiffness.mean(), "mass": 1e-3 * robot.mass, "external_wrench": 1e-4}


@pytest.mark.parametrize("robot", ["cogiro", "parallel", "planar-vertical"])
def test_derivatives_are_those_of_the_solver(catalogue, robot):
    """Every column of every parameter, off the middle, against solving anew on both sides."""
    robot = catalogue[robot].replace(material="fishing-0.4mm")
    y = 0.0 if robot.mobility == "planar" else 0.22
    answer = cdpr.sensitivity(robot, (0.25, y, 0.15))
    base = answer.equilibrium
    assert answer.margin > KINK
    assert set(answer.pose) == set(answer.tensions) == set(derivatives.PARAMETERS)
    for name in derivatives.PARAMETERS:
        for index in range(answer.pose[name].shape[1]):
            if robot.mobility == "spatial" or in_plane(name, index):
                step = sizes(robot).get(name, 1e-5)
                assert check_column(base.problem, base, answer, name, index, step), (name, index)


def in_plane(name: str, index: int) -> bool:
    if name in ("exits", "anchors", "center_of_mass"):
        return index % 3 != 1
    return name != "external_wrench" or index in (0, 2, 4)


def test_under_a_torque_the_derivatives_still_hold(catalogue):
    """A torque that keeps its direction in space makes the slope unsymmetric; the symmetric part alone is off."""
    answer = cdpr.sensitivity(
        catalogue["cogiro"].replace(axial_stiffness=50.0), (0.3, 0.25, 0.15), external_wrench=[0, 0, 0, 0.01, 0.02, 0]
    )
    base, free = answer.equilibrium, answer.equilibrium.problem.robot.free
    assert check_column(base.problem, base, answer, "external_wrench", 4, 1e-5)
    # Negative control.
    stiffness = forces.at(base.problem, base.position, base.rotation.as_matrix()).stiffness_matrix
    symmetric = np.zeros((6, 6))
    symmetric[free] = np.linalg.inv(stiffness[np.ix_(free, free)])
    wrong = replace(answer, pose={**answer.pose, "external_wrench": symmetric})
    assert not check_column(base.problem, base, wrong, "external_wrench", 4, 1e-5)


def test_moving_the_whole_frame_moves_the_platform_along(catalogue):
    """The sum over all exits of any axis is a pure translation: an identity that no finite difference blurs."""
    answer = cdpr.sensitivity(catalogue["parallel"], (0.2, 0.22, 0.1))
    together = answer.pose["exits"].reshape(6, -1, 3).sum(1)
    assert together == pytest.approx(np.vstack([np.eye(3), np.zeros((3, 3))]), abs=1e-7)
    assert answer.tensions["exits"].reshape(8, -1, 3).sum(1) == pytest.approx(np.zeros((8, 3)), abs=1e-4)


def test_tilt_grows_as_the_solver_says(catalogue):
    """Its own derivative, against the solver's tilt."""
    robot = catalogue["parallel"]
    base = cdpr.solve(robot, (0.2, 0.22, 0.1))
    exact = cdpr.sensitivity(base).tilt("rest_lengths")[0]
    tilts = [cdpr.solve(robot, base.pose, base.rest_lengths + np.eye(8)[0] * step).tilt for step in (1e-6, -1e-6)]
    assert exact == pytest.approx((tilts[0] - tilts[1]) / 2e-6, rel=CUBE)


def test_a_platform_that_turns_freely_has_no_derivatives():
    """One sentence instead of infinite numbers."""
    problem = hanging_mass()
    with pytest.raises(cdpr.InvalidInput, match="found a neutral equilibrium of 'hanging mass'"):
        cdpr.sensitivity(problem)


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


def test_derivatives_hold_for_cables_with_every_property():
    """With mass, over pulleys, nonlinear, beside a plain one: against solving anew on both sides."""
    robot = cdpr.load_robot("cogiro").replace(
        material="fishing-0.4mm", linear_density=[5e-3] * 7 + [0], pulley_radius=[0.01] * 7 + [0],
        stiffening=[[1.0, 20.0]] * 7 + [[0, 0]],
    )  # fmt: skip
    answer = cdpr.sensitivity(robot, (0.25, 0.22, 0.15))
    base = answer.equilibrium
    assert answer.margin == abs(base.lengths - base.rest_lengths)[7]  # the law of the others has no kink
    for name in derivatives.parameters(robot):
        for index in range(0, answer.pose[name].shape[1], 3):
            step = sizes(robot).get(name, 1e-5)
            assert check_column(base.problem, base, answer, name, index, step), (name, index)

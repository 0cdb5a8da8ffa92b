"""Exits that give way (``exit_compliance``): closed forms in statics and in MuJoCo, limits, and what refuses them."""

import numpy as np
import pytest
from scipy.optimize import brentq

import cdpr_sim as cdpr
from cdpr_sim.robots.robot_file_text import as_toml

EXACT = 1e-9
"""[m] Largest deviation from a closed form. Measured: statics 6e-16; MuJoCo 5e-11, where forces of 1e-9 are left."""

METHODS = {"statics": cdpr.solve, "simulation": cdpr.settle}

EA, MASS, G = 1e3, 2.0, 9.81


def hung(exits, anchors, **changes) -> cdpr.Robot:
    """A platform on cables of 1 kN."""
    given = {"platform_size": (0.2, 0.2, 0.2), "workspace": [(-0.1, -0.1, 0.5), (0.1, 0.1, 1.0)], "gravity": G}
    return cdpr.Robot(exits, anchors, EA, MASS, **given | changes)


@pytest.fixture(params=METHODS.values(), ids=[*METHODS])
def solve(request):
    return request.param


def sunk(solve, compliance) -> float:
    """How far a mass sinks on a plumb cable of 2 m."""
    robot = hung([(0, 0, 3)], [(0, 0, 0)], exit_compliance=compliance)
    return 1.0 - solve(robot, (0, 0, 1), [2.0]).position[2]


def test_a_mass_on_a_plumb_cable_sinks_by_the_stretch_and_the_frames_own(solve):
    """By m g (l0/EA + c_z), whatever the compliance sideways; a hundredth more of it would be seen."""
    expected = MASS * G * (2.0 / EA + 3e-3)
    assert sunk(solve, (1e-4, 2e-4, 3e-3)) == pytest.approx(expected, abs=EXACT)
    assert sunk(solve, (1e-4, 2e-4, 3.03e-3)) != pytest.approx(expected, abs=EXACT)


def mirrored(compliance: float) -> tuple[cdpr.Robot, float]:
    """A point on two cables of 2 m from exits 3 m apart that move sideways; and its height by the balance of one.

    A cable of the tension T at the angle a below the level: 2 T sin(a) = m g, (l + c T) cos(a) = 1.5 m.
    """

    def missed(tension: float) -> float:
        sine = MASS * G / (2 * tension)
        return (2.0 * (1 + tension / EA) + compliance * tension) * np.sqrt(1 - sine**2) - 1.5

    tension = brentq(missed, MASS * G / 2 * (1 + 1e-12), 100 * MASS * G, xtol=1e-14, rtol=1e-15)
    height = 3.0 - 2.0 * (1 + tension / EA) * MASS * G / (2 * tension)
    exits = [(-1.5, 0, 3), (1.5, 0, 3)]
    return hung(exits, np.zeros((2, 3)), exit_compliance=(compliance, 0, 0), mobility="planar"), height


@pytest.mark.parametrize("compliance", [1e-4, 2e-3, 3e-2])
def test_two_mirrored_cables_draw_their_exits_together(solve, compliance):
    """The height at rest is that of the one equation in one unknown; with a hundredth more compliance it is not."""
    robot, height = mirrored(compliance)
    for factor in (1.0, 1.01):
        found = solve(robot.replace(exit_compliance=(factor * compliance, 0, 0)), (0, 0, 1.6), [2.0, 2.0])
        assert (found.position[2] == pytest.approx(height, abs=EXACT)) == (factor == 1.0)


def test_a_small_compliance_acts_in_proportion(solve):
    """As it tends to 0, the equilibrium tends to that on a rigid frame."""
    robot = cdpr.load_robot("cogiro").replace(linear_density=1e-3, pulley_radius=0.01)
    pose = np.add(robot.home, [0.05, 0.05, 0.02])
    rigid = solve(robot, pose).position
    small, tenth = (solve(robot.replace(exit_compliance=c), pose).position - rigid for c in (1e-6, 1e-7))
    assert np.abs(small).max() > 1e2 * EXACT
    assert np.abs(small - 10 * tenth).max() < 1e-2 * np.abs(small).max()


def test_one_number_stands_for_three():
    """For all cables or for each, in Python and in robot files; two numbers, or fewer than 0, are refused."""
    robot = cdpr.load_robot("cogiro")
    np.testing.assert_array_equal(robot.replace(exit_compliance=2e-6).exit_compliance, np.full((8, 3), 2e-6))
    each = robot.replace(exit_compliance=1e-6 * np.arange(8)[:, None])
    np.testing.assert_array_equal(each.exit_compliance, 1e-6 * np.arange(8)[:, None] * np.ones(3))
    for wrong in ((1e-6, 1e-6), np.full(8, 1e-6), -1e-6):
        with pytest.raises(cdpr.InvalidInput, match="exit_compliance: found"):
            robot.replace(exit_compliance=wrong)


def test_robot_files_have_it_as_a_number_or_as_three(tmp_path):
    """For the whole robot and for a cable; written and read, it is the same."""
    robot = cdpr.load_robot("planar-vertical")
    file = tmp_path / "robot.toml"
    text = as_toml(robot).replace("[platform]", "exit_compliance = 2e-6\n\n[platform]", 1)
    file.write_text(text.replace("[[cables]]", "[[cables]]\nexit_compliance = [1e-6, 0.0, 3e-6]", 1))
    read = cdpr.load_robot(file)
    np.testing.assert_array_equal(read.exit_compliance, [(1e-6, 0, 3e-6), *[(2e-6,) * 3] * (robot.cables - 1)])
    file.write_text(as_toml(read))
    np.testing.assert_array_equal(cdpr.load_robot(file).exit_compliance, read.exit_compliance)


def test_identification_finds_the_compliance_of_all_exits():
    """From poses that were measured, one number for all."""
    robot = cdpr.load_robot("cogiro")
    poses = robot.home + np.random.default_rng(3).uniform(-0.1, 0.1, (12, 3)) * [1, 1, 0.5]
    measured = cdpr.solve_many(robot.replace(exit_compliance=2e-5), poses)
    table = cdpr.Measurements.of(poses, measured.positions, coordinates=("x", "y", "z"))
    found = cdpr.identify(robot.replace(exit_compliance=1e-5), table, ("exit_compliance",), position_error=1e-6).robot
    np.testing.assert_allclose(found.exit_compliance, 2e-5, rtol=1e-6)


def test_angles_of_pulleys_that_move_are_refused():
    """Swivel angles are those of wheels that stay where they are."""
    robot = cdpr.load_robot("cogiro").replace(exit_compliance=2e-5, pulley_radius=0.01)
    poses = robot.home + np.random.default_rng(3).uniform(-0.1, 0.1, (6, 3)) * [1, 1, 0.5]
    measured = cdpr.solve_many(robot, poses).positions
    table = cdpr.Measurements.of(poses, measured, coordinates=("x", "y", "z"), swivels=np.zeros((6, 8)))
    errors = {"position_error": 1e-6, "swivel_error": 1e-3}
    with pytest.raises(cdpr.InvalidInput, match="swivels: found exit_compliance in cable 1"):
        cdpr.identify(robot, table, ("mass",), **errors)

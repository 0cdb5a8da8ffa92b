"""Exits that give way (``exit_compliance``): closed forms in statics and in MuJoCo, limits, and what refuses them."""

import json

import mujoco
import numpy as np
import pytest
from inputs import run, said

import cdpr_sim as cdpr
from cdpr_sim.drawing.cable_curves import with_moved_exits
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


class Lowered:
    """A controller whose winch lets out a millimetre at once."""

    def start(self, reference):
        return np.array([2.0])

    def command(self, time, pose, measurement):
        return np.array([2.001])


def decay(compliance: float, damping: float) -> complex:
    """Complex angular frequency [1/s] of a mass that was lowered on a plumb cable, by linear prediction."""
    robot = hung([(0, 0, 3)], [(0, 0, 0)], exit_compliance=(0, 0, compliance), mobility="planar")
    motion = cdpr.track(robot, [(0, 0, 1)], Lowered(), seconds=3, rate=50, damping=0, cable_damping=damping)
    z = motion.positions[2:, 2]
    past = np.stack([z[1:-1], z[:-2], np.ones(len(z) - 2)], axis=1)
    two = np.linalg.lstsq(past, z[2:], rcond=None)[0]
    return complex(np.log(np.roots([1, -two[0], -two[1]]).astype(complex))[0] * 50)


@pytest.mark.parametrize("compliance", [0.0, 1e-3, 4e-3])
def test_a_frame_takes_its_part_of_a_motion_from_the_cables_damper(compliance):
    """A mass on a spring k with the damper c k, and the frame's spring in series: m s² + 1/(1/(k (1 + c s)) + C) = 0.

    With the whole motion in the damper, oscillations would decay up to nine times as fast.
    """
    k, c = EA / 2.0, 2e-3
    # m s² (1 + C k (1 + c s)) + k (1 + c s) = 0
    roots = np.roots([MASS * compliance * k * c, MASS * (1 + compliance * k), k * c, k])
    expected = roots[np.argmax(roots.imag)]
    found = decay(compliance, c)
    assert abs(found.imag) == pytest.approx(expected.imag, rel=1e-3)
    assert found.real == pytest.approx(expected.real, rel=2e-2)
    assert decay(1.05 * compliance + 1e-4, c).real != pytest.approx(expected.real, rel=2e-2)


def test_a_model_of_cables_with_mass_comes_to_rest_when_it_is_stepped():
    """The body of an exit is light, and the integrator of chains does not know springs."""
    robot = cdpr.load_robot("cogiro").replace(exit_compliance=[1e-5, 2e-5, 3e-5], linear_density=1e-3)
    pose = np.add(robot.home, [0.03, 0.0, 0.02])
    model = mujoco.MjModel.from_xml_string(cdpr.to_mjcf(robot, pose))
    data = mujoco.MjData(model)
    mujoco.mj_step(model, data, nstep=round(5 / model.opt.timestep))
    assert not data.warning.number.any()
    np.testing.assert_allclose(data.body("platform").xpos, cdpr.solve(robot, pose).position, rtol=0, atol=EXACT)


def test_one_number_stands_for_three(tmp_path):
    """For all cables or for each, in Python and in robot files; two numbers, or fewer than 0, are refused."""
    robot = cdpr.load_robot("cogiro")
    np.testing.assert_array_equal(robot.replace(exit_compliance=2e-6).exit_compliance, np.full((8, 3), 2e-6))
    file = tmp_path / "robot.toml"
    file.write_text(as_toml(robot).replace("[platform]", "exit_compliance = 2e-6\n\n[platform]", 1))
    np.testing.assert_array_equal(cdpr.load_robot(file).exit_compliance, np.full((8, 3), 2e-6))
    each = robot.replace(exit_compliance=1e-6 * np.arange(8)[:, None])
    np.testing.assert_array_equal(each.exit_compliance, 1e-6 * np.arange(8)[:, None] * np.ones(3))
    for wrong in ((1e-6, 1e-6), np.full(8, 1e-6), -1e-6):
        with pytest.raises(cdpr.InvalidInput, match="exit_compliance: found"):
            robot.replace(exit_compliance=wrong)


def test_identification_finds_the_compliance_of_all_exits():
    """From poses that were measured, one number for all."""
    robot = cdpr.load_robot("cogiro")
    poses = robot.home + np.random.default_rng(3).uniform(-0.1, 0.1, (12, 3)) * [1, 1, 0.5]
    measured = cdpr.solve_many(robot.replace(exit_compliance=2e-5), poses)
    table = cdpr.Measurements.of(poses, measured.positions, coordinates=("x", "y", "z"))
    found = cdpr.identify(robot.replace(exit_compliance=1e-5), table, ("exit_compliance",), position_error=1e-6).robot
    np.testing.assert_allclose(found.exit_compliance, 2e-5, rtol=1e-6)


def test_drawn_exits_of_cables_with_mass_are_where_their_profiles_begin():
    """And not where massless cables would bring them; drawn to a scale, they move as many times as far."""
    robot = cdpr.load_robot("cogiro").replace(exit_compliance=1e-4, linear_density=0.02)
    batch = cdpr.solve_many(robot, np.add(robot.home, [0.05, 0, 0])[None])
    one, shapes = batch[0], cdpr.cable_profiles(batch, 20)[0]
    anchors = one.pose.apply(robot.anchors)
    drawn = with_moved_exits(robot, anchors, one.tensions, shapes, 10.0).exits
    np.testing.assert_allclose(drawn - robot.exits, 10 * (shapes[:, 0] - robot.exits), rtol=0, atol=1e-12)
    without = with_moved_exits(robot, anchors, one.tensions, None, 10.0).exits
    assert np.abs(drawn - without).max() > 0.05 * np.abs(drawn - robot.exits).max()


def test_settling_shows_details_of_a_frame_that_gives_way_and_proves_only_when_asked_to(tmp_path):
    """Proofs do not know such exits: --certify says so, and all else is answered with the extra installed, too."""
    pytest.importorskip("flint")
    file = cdpr.write_robot(tmp_path / "soft.toml", cdpr.load_robot("parallel").replace(exit_compliance=1e-3))
    told = run("settle", file, "--json")
    assert told.exit_code == 0, told.stderr
    assert json.loads(told.stdout)["agrees"]
    table = run("settle", file, "--all")
    assert (table.exit_code, "unbalanced" in table.stdout, "proved" in table.stdout) == (0, True, False)
    assert "proved within" in run("settle", "parallel", "--all").stdout
    refused = run("settle", file, "--certify")
    assert refused.exit_code == 2
    assert said(refused.stderr).endswith(
        "exit_compliance in cable 1, expected cables without: proof does not take it into account"
    )

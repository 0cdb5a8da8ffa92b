"""Exits that give way (``exit_compliance``): closed forms in statics and in MuJoCo, limits, and what refuses them."""

import mujoco
import numpy as np
import pytest
from scipy.optimize import brentq

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


def test_winches_of_a_model_move_exits_and_reset_puts_them_where_they_balance():
    """Stepped, the platform comes to the equilibrium of its lengths; reset there, nothing is unbalanced."""
    robot = cdpr.load_robot("cogiro").replace(exit_compliance=[1e-5, 2e-5, 3e-5], pulley_radius=0.01)
    wanted = robot.rest_lengths(np.add(robot.home, [0.03, 0.0, 0.02]))
    model = mujoco.MjModel.from_xml_string(cdpr.to_mjcf(robot, robot.home, winches=True))
    data = mujoco.MjData(model)
    data.ctrl = cdpr.winch_controls(robot, robot.home, wanted)
    mujoco.mj_step(model, data, nstep=round(10 / model.opt.timestep))
    solved = cdpr.solve(robot, robot.home, wanted)
    np.testing.assert_allclose(data.body("platform").xpos, solved.position, rtol=0, atol=EXACT)
    rigid = cdpr.solve(robot.replace(exit_compliance=0), robot.home, wanted)
    assert np.abs(rigid.position - solved.position).max() > 1e3 * EXACT
    cdpr.reset(model, data, solved.pose, rest_lengths=wanted)
    left = data.qfrc_passive + data.qfrc_actuator - data.qfrc_bias
    assert np.abs(left).max() < 1e-8 * robot.weight
    with pytest.raises(cdpr.InvalidInput, match="pretension: found exits that give way"):
        cdpr.reset(model, data, solved.pose, pretension=1.0)


def test_a_model_of_cables_with_mass_comes_to_rest_when_it_is_stepped():
    """The body of an exit is light, and the integrator of chains does not know springs."""
    robot = cdpr.load_robot("cogiro").replace(exit_compliance=[1e-5, 2e-5, 3e-5], linear_density=1e-3)
    pose = np.add(robot.home, [0.03, 0.0, 0.02])
    model = mujoco.MjModel.from_xml_string(cdpr.to_mjcf(robot, pose))
    data = mujoco.MjData(model)
    mujoco.mj_step(model, data, nstep=round(5 / model.opt.timestep))
    assert not data.warning.number.any()
    np.testing.assert_allclose(data.body("platform").xpos, cdpr.solve(robot, pose).position, rtol=0, atol=EXACT)


@pytest.mark.parametrize(
    ("more", "beside"), [({"linear_density": 1e-3}, "cables with mass"), ({"stiffening": (50, 0)}, "nonlinear cables")]
)
def test_winches_beside_mass_or_a_nonlinear_law_are_refused(more, beside):
    """And so are dampers of cables, where the body of an exit would oscillate."""
    robot = cdpr.load_robot("cogiro").replace(exit_compliance=1e-5, **more)
    with pytest.raises(cdpr.InvalidInput, match=f"winches: found exit_compliance in cable 1 beside {beside}"):
        cdpr.to_mjcf(robot, robot.home, winches=True)
    with pytest.raises(cdpr.InvalidInput, match="damping: found exit_compliance in cable 1"):
        cdpr.to_mjcf(robot, robot.home, damping="none")


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

"""The winches drive, MuJoCo moves: slowly it is statics, quickly it is not."""

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

import cdpr_sim as cdpr
from cdpr_sim.analysis.compensation import compensate
from cdpr_sim.core.errors import InvalidInput
from cdpr_sim.core.robot import Robot
from cdpr_sim.core.trajectory import PlatformFell
from cdpr_sim.physics.drive import NEARLY_STATIC, drive, fallen
from cdpr_sim.physics.mjcf import place, to_mjcf
from cdpr_sim.physics.settle import settle, settle_many
from cdpr_sim.robots.catalogue import load_robot

LINE = [[0.17, 0.25, 0.1], [0.63, 0.25, 0.1]]
"""The paper's, for DemoBot [m]."""

NEXT = [0.25, 0.25, 0.1]
"""On the line."""

STATES = 21

NEARLY = {"cogiro": (2e-7, 2e-7), "parallel": (1e-4, 1e-3), "planar-vertical": (1e-4, 1e-3)}
"""[m, rad] By which a nearly static drive lags behind its equilibria. Measured 9e-8 m and 7e-8 rad for `cogiro`, all
of whose cables are taut, and 5e-5 m and 7e-4 rad for `parallel`, which swings on two: there the drag, 1e-3 of the
weight, leans it by that angle."""

FAST = 0.5
"""[s] For a drive from there to there that is not static: at 0.3 m/s the drag is a quarter of the weight."""

COMPENSATED = 1e-5
"""[m] Drag at the default speed, 1e-3 of the weight, against the crossed layout: some 1e3 N/m, hence 4e-6 m; and
corrections interpolated over 5 mm."""

KINEMATICS = 1e-12
"""[m] Rounding of a length of a metre, with room."""


def apart(trajectory, settled) -> tuple[float, float]:
    """Largest distance [m] and angle [rad] between a trajectory's poses and settled ones."""
    shift = np.linalg.norm(trajectory.poses.translation - settled.poses.translation, axis=1)
    return shift.max(), (trajectory.poses.rotation * settled.poses.rotation.inv()).magnitude().max()


@pytest.mark.parametrize("name", sorted(NEARLY))
def test_a_slow_drive_passes_through_the_equilibria_and_a_fast_one_does_not(name):
    """Poses agree with ``settle`` at the same commands when the drive is slow; when it is fast they must not."""
    robot = load_robot(name)
    line = [[x, 0.0 if robot.mobility == "planar" else y, z] for x, y, z in (LINE[0], NEXT)]
    slow = drive(robot, line, states=STATES)
    settled = settle_many(slow.problems)
    assert settled.converged.all()
    position, rotation = apart(slow, settled)
    assert position < NEARLY[name][0]
    assert rotation < NEARLY[name][1]
    position, rotation = apart(drive(robot, line, states=STATES, seconds=FAST), settled)
    assert position > 10 * NEARLY[name][0]
    assert rotation > 10 * NEARLY[name][1]


def test_a_slower_drive_lags_less():
    """What is left between a nearly static drive and its equilibria is the air's drag: half the speed, half the lag."""
    robot, line = load_robot("parallel"), [LINE[0], [0.21, 0.25, 0.1]]
    usual = drive(robot, line, states=STATES)
    settled = settle_many(robot, usual.commanded)
    slower = drive(robot, line, states=STATES, seconds=2 * usual.times[-1])
    # The largest lag lies where a cable goes slack, and not quite at the same state: hence not exactly one half.
    assert 0.35 < apart(slower, settled)[1] / apart(usual, settled)[1] < 0.65
    assert apart(usual, settled)[1] < 2 * NEARLY_STATIC


def test_winches_let_out_the_rigid_lengths_of_the_command():
    """Rest lengths and commanded poses run along the line, from its one end to its other, in time."""
    robot = load_robot("cogiro")
    trajectory = drive(robot, [[*LINE[0], 0, 0, 0], [*LINE[1], 0, 0.2, 0]], states=STATES, seconds=2.0)
    assert len(trajectory) == STATES
    np.testing.assert_allclose(np.diff(trajectory.times), 2.0 / (STATES - 1), rtol=1e-9)
    np.testing.assert_allclose(trajectory.commanded.translation[[0, -1]], LINE, atol=KINEMATICS)
    np.testing.assert_allclose(trajectory.commanded.rotation[-1].as_euler("xyz"), [0, 0.2, 0], atol=KINEMATICS)
    middle = trajectory.commanded[STATES // 2]
    np.testing.assert_allclose(middle.translation, np.mean(LINE, axis=0), atol=KINEMATICS)
    np.testing.assert_allclose(middle.rotation.as_euler("xyz"), [0, 0.1, 0], atol=KINEMATICS)
    for step in (0, 7, STATES - 1):
        expected = robot.rest_lengths(trajectory.commanded[step])
        np.testing.assert_allclose(trajectory.rest_lengths[step], expected, atol=KINEMATICS)


@pytest.mark.parametrize(("angle", "why"), [(80, None), (100, "it has turned over")])
def test_a_platform_that_has_turned_over_has_fallen(angle, why):
    """Beyond a right angle from how it was commanded; however near it is."""
    robot = load_robot("cogiro")
    model = mujoco.MjModel.from_xml_string(to_mjcf(robot, robot.home))
    data = mujoco.MjData(model)
    place(model, data, robot, robot.pose([*robot.home, np.radians(angle), 0, 0]))
    mujoco.mj_kinematics(model, data)
    found = fallen(robot.home, np.eye(3), robot.rest_lengths(robot.home), data, model.body("platform").id)
    assert found == why


def test_stiffness_follows_the_length(monkeypatch):
    """A winch that shortens a cable stiffens it; with the stiffness of the start kept, the end is another."""
    robot = load_robot("cogiro").replace(material="fishing-0.4mm")
    path = [LINE[0], [0.63, 0.25, 0.3]]
    true = drive(robot, path, states=3, seconds=60.0)
    settled = settle(robot, path[-1])
    np.testing.assert_allclose(true.poses[-1].translation, settled.position, atol=1e-6)
    # The negative control: EA/l0 as at the start, which is EA l0(end)/l0(start) in EA.
    ratio = true.rest_lengths[-1] / true.rest_lengths[0]
    frozen = settle(robot.replace(axial_stiffness=robot.axial_stiffness * ratio), path[-1])
    assert np.linalg.norm(frozen.position - settled.position) > 1e-5


def test_a_platform_let_go_drops_from_where_it_was_commanded():
    """Without ``from_rest`` it starts at the command with no tension, falls freely at first, and comes to rest."""
    robot, pose = load_robot("parallel"), LINE[0]
    trajectory = drive(robot, [pose], states=601, seconds=12.0, from_rest=False)
    np.testing.assert_allclose(trajectory.poses[0].translation, pose, atol=KINEMATICS)
    assert trajectory.tensions[0].max() < 1e-9 * robot.weight
    fall = 0.5 * robot.gravity * trajectory.times[1] ** 2
    assert 0 < -trajectory.deviation[1, 2] < 2 * fall
    rest = settle(robot, pose)
    # Critically damped at 4.4/s for 12 s, and softer about some axes.
    np.testing.assert_allclose(trajectory.poses[-1].translation, rest.position, atol=1e-4)
    np.testing.assert_allclose(trajectory.tensions[-1], rest.tensions, atol=1e-2)
    np.testing.assert_array_equal(trajectory.slack[-1], rest.slack)


def test_a_platform_that_falls_is_said_to_fall():
    """Three cables on one side cannot hold a platform beside them: it swings away, and the motion so far is kept."""
    robot = Robot(
        exits=[[0, 0, 1], [0, 0.4, 1], [0.1, 0.2, 1.0]],
        anchors=[[0, -0.05, 0], [0, 0.05, 0], [0.02, 0, 0.02]],
        axial_stiffness=1e4,
        mass=1.0,
        name="one-sided",
    )
    with pytest.raises(PlatformFell, match=r"one-sided: found the platform fallen .* s into the drive.*m away") as fell:
        drive(robot, [[0.1, 0.2, 0.4], [0.9, 0.2, 0.9]], seconds=20.0, states=101)
    assert fell.value.trajectory is not None
    assert 1 < len(fell.value.trajectory) < 101
    assert drive(robot, [[0.05, 0.2, 0.4], [0.05, 0.2, 0.5]], seconds=20.0, states=11).times[-1] == 20.0


@pytest.mark.parametrize(
    ("waypoints", "words", "message"),
    [
        ([], {}, "waypoints: found none"),
        (LINE, {"states": 1}, "states: found 1, expected 2"),
        (LINE, {"states": 10**9}, "states: found 1000000000"),
        (LINE, {"seconds": 0.0}, "seconds: found 0 s, expected more than 0"),
        (LINE, {"seconds": np.nan}, "seconds: found nan"),
        (LINE, {"seconds": 1e9}, r"seconds: found 1e\+09"),
        ([[0.4, 0.25, np.inf]], {}, "pose: found .*inf"),
        ([LINE[0], [0.4, 0.25, 0.9]], {}, "falls since cables cannot push"),
    ],
)
def test_bad_input_is_refused_in_a_sentence(waypoints, words, message):
    """Before anything is simulated."""
    with pytest.raises(InvalidInput, match=message):
        drive(load_robot("cogiro"), waypoints, **words)


def test_progress_is_told():
    """From the start to the end, in order."""
    told = []
    drive(load_robot("cogiro"), LINE, seconds=1.0, states=11, progress=told.append)
    np.testing.assert_allclose(told, np.linspace(0, 1, 11))


def test_waypoints_may_repeat_and_come_as_transforms():
    """A stack of transforms is taken as it is, and standing still on the way is no division by zero."""
    stack = RigidTransform.from_components([LINE[0], LINE[0], LINE[1]], Rotation.identity(3))
    trajectory = drive(load_robot("cogiro"), stack, seconds=1.0, states=3)
    np.testing.assert_allclose(trajectory.commanded.translation[-1], LINE[1], atol=KINEMATICS)


def test_compensated_winches_keep_the_platform_on_the_line():
    """Crossed layout, fishing line: half a millimetre low with rigid lengths, on the line with compensated ones."""
    robot = load_robot("cogiro").replace(material="fishing-0.4mm")
    line = np.linspace([0.3, 0.25, 0.1], [0.32, 0.25, 0.1], 5)
    lengths = [compensate(robot, waypoint).rest_lengths for waypoint in line]
    rigid, compensated = (drive(robot, line, states=5, rest_lengths=one) for one in (None, lengths))
    errors = [np.linalg.norm(one.deviation, axis=1).max() for one in (rigid, compensated)]
    assert errors[0] > 4e-4
    assert errors[1] < COMPENSATED


def test_rest_lengths_of_another_shape_are_refused():
    """As many rows as waypoints."""
    robot = load_robot("two-cable")
    with pytest.raises(InvalidInput, match=r"rest_lengths: found an array of shape \(1, 2\)"):
        drive(robot, [[0.3, 0, 0.2], [0.4, 0, 0.2]], rest_lengths=[[1.0, 1.0]])


def test_a_wrench_acts_during_a_drive():
    """The platform follows the equilibria under it; without it, it is elsewhere."""
    robot, wrench = cdpr.load_robot("cogiro"), (3.0, 0.0, -10.0, 0.0, 0.02, 0.0)
    motion = cdpr.drive(robot, [(0.4, 0.25, 0.1), (0.38, 0.25, 0.1)], states=3, external_wrench=wrench)
    static = cdpr.solve_trajectory(motion)
    ends = [0, -1]
    np.testing.assert_allclose(motion.poses.translation[ends], static.positions[ends], rtol=0, atol=1e-5)
    without = cdpr.solve(robot, (0.4, 0.25, 0.1)).position
    assert np.linalg.norm(motion.poses.translation[0] - without) > 1e-4

"""Closed loop in MuJoCo: winches go where they are told and no faster, sensors are as good as they are said to be."""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform

import cdpr_sim as cdpr
from cdpr_sim import HeldTensions, PoseFeedback, RigidLengths
from cdpr_sim.core.pose import moved
from cdpr_sim.core.pose_path import PosePath
from cdpr_sim.core.trajectory import BadCommand, PlatformFell
from cdpr_sim.physics.track import Machine

LINE = [[0.3, 0.25, 0.1], [0.36, 0.25, 0.1]]
POSE = [0.3, 0.25, 0.1]

UNDER_A_PULLEY = [[0.07, 0.07, 0.1], [0.14, 0.07, 0.1]]
"""Anchor 2 of DemoBot passes below exit 2, which is at (0.04, 0.08) m; neither waypoint is within 0.02 m of there."""

AT_REST = 1e-9
"""[m] By which a platform moves that ``settle`` has put to rest: it stops at 1e-9 of the load on 1e3 N/m."""

COPIED = 1e-12
"""[m] Of numbers that are handed on, or computed anew with other roundings."""


def demobot(**changes) -> cdpr.Robot:
    return cdpr.load_robot("cogiro").replace(**{"material": "fishing-0.4mm"} | changes)


@dataclass
class Listener:
    """Rigid lengths, and all that sensors have said."""

    robot: cdpr.Robot
    heard: list[tuple[float, cdpr.Measurement]] = field(default_factory=list)

    def start(self, reference: cdpr.Reference) -> np.ndarray:
        self.heard.clear()
        return self.robot.rest_lengths(reference.pose(0.0))

    def command(self, time: float, pose: RigidTransform, measurement: cdpr.Measurement) -> np.ndarray:
        self.heard.append((time, measurement))
        return self.robot.rest_lengths(pose)


@dataclass
class After:
    """Rigid lengths, until an ``answer`` of another kind after a tenth of a second."""

    robot: cdpr.Robot
    answer: Callable[[np.ndarray], Any]

    def start(self, reference: cdpr.Reference) -> np.ndarray:
        return self.robot.rest_lengths(reference.pose(0.0))

    def command(self, time: float, pose: RigidTransform, measurement: cdpr.Measurement) -> Any:
        lengths = self.robot.rest_lengths(pose)
        if time <= 0.105:
            return lengths
        return self.answer(lengths)


@pytest.mark.parametrize(
    "robot",
    [
        demobot(),
        cdpr.load_robot("parallel"),
        cdpr.load_robot("planar-vertical"),
        demobot(pulley_radius=0.01, pulley_axis=(0, 0, 1)),
    ],
    ids=["spatial", "slack", "planar", "pulleys"],
)
def test_a_platform_at_rest_stays_there(robot):
    """The winch model rests where the model without winches does; with one cable a hair shorter it does not."""
    pose = [0.3, 0.0 if robot.mobility == "planar" else 0.25, 0.1]
    still = cdpr.track(robot, [pose], RigidLengths(robot), seconds=0.1)
    assert np.abs(still.positions - still.positions[0]).max() < AT_REST
    settled = cdpr.settle(robot, pose)
    np.testing.assert_allclose(still.tensions[-1], settled.tensions, atol=1e-6)
    np.testing.assert_allclose(still.lengths[-1], settled.lengths, atol=AT_REST)
    moved = cdpr.track(
        robot, [pose], After(robot, lambda lengths: lengths - 1e-5 * np.eye(len(lengths))[0]), seconds=0.2
    )
    assert np.abs(moved.positions - still.positions[0]).max() > 100 * AT_REST


def test_winches_are_where_they_were_told_to_be_at_the_next_instant():
    """One state per control period; between two the winches run evenly, so that they lag behind by nothing."""
    robot = demobot()
    motion = cdpr.track(robot, LINE, RigidLengths(robot), seconds=0.5, pause=0.1, rate=50.0)
    np.testing.assert_allclose(motion.times, np.arange(31) / 50, atol=COPIED)
    for row in (0, 5, 15, 30):
        np.testing.assert_allclose(motion.rest_lengths[row], robot.rest_lengths(motion.commanded[row]), atol=COPIED)
    np.testing.assert_allclose(motion.commanded[5].translation, LINE[0], atol=COPIED)
    np.testing.assert_allclose(motion.commanded[-1].translation, LINE[1], atol=COPIED)


def test_winches_run_no_faster_than_they_can():
    """Half as fast as the motion wants them they fall behind, and make up for it once it slows down."""
    robot, speed = demobot(), 0.06
    slow = cdpr.track(robot, LINE, RigidLengths(robot), seconds=0.8, winch_speed=speed)
    change = np.abs(np.diff(slow.rest_lengths, axis=0)).max() / 0.01
    assert change == pytest.approx(speed, rel=1e-6)
    wanted = np.array([robot.rest_lengths(pose) for pose in slow.commanded])
    assert np.abs(slow.rest_lengths - wanted).max() > 1e-3
    free = cdpr.track(robot, LINE, RigidLengths(robot), seconds=0.8)
    assert speed < np.abs(np.diff(free.rest_lengths, axis=0)).max() / 0.01 < 1.0


def test_sensors_say_what_was_so_when_they_looked():
    """Period and delay: the newest sample that has come through, and its pose and tensions are the true ones then."""
    robot, listener = demobot(), Listener(demobot())
    motion = cdpr.track(robot, LINE, listener, seconds=1.0, sensors=cdpr.Sensors(period=0.03, delay=0.02))
    assert len(listener.heard) == 100
    for time, measurement in listener.heard[10:]:
        now = time - 0.01
        assert measurement.time == pytest.approx(0.03 * np.floor((now - 0.02) / 0.03 + 1e-6), abs=1e-9)
        row = round(100 * measurement.time)
        np.testing.assert_array_equal(measurement.pose.translation, motion.poses[row].translation)
        np.testing.assert_array_equal(measurement.tensions, motion.tensions[row])
        np.testing.assert_array_equal(measurement.rest_lengths, motion.rest_lengths[row])
    first = listener.heard[0][1]
    assert first.time == pytest.approx(-0.02)  # the platform has stood still for a while
    np.testing.assert_array_equal(first.pose.translation, motion.poses[0].translation)


def test_noise_is_as_large_as_it_is_said_to_be_and_moves_nothing_by_itself():
    """Standard deviations of 400 samples; a controller that does not listen goes where it went without noise."""
    robot, listener = demobot(), Listener(demobot())
    sensors = cdpr.Sensors(period=1 / 400, position_noise=1e-3, rotation_noise=1e-2, tension_noise=0.1)
    noisy = cdpr.track(robot, [POSE], listener, seconds=1.0, rate=400.0, sensors=sensors)
    quiet = cdpr.track(robot, [POSE], Listener(robot), seconds=1.0, rate=400.0)
    np.testing.assert_array_equal(noisy.positions, quiet.positions)
    heard = [measurement for _, measurement in listener.heard]
    positions = np.array([one.pose.translation for one in heard]) - noisy.positions[:-1]
    turns = np.array([one.pose.rotation.as_rotvec() for one in heard]) - noisy.poses[:-1].rotation.as_rotvec()
    tensions = np.array([one.tensions for one in heard]) - noisy.tensions[:-1]
    # 400 samples tell a deviation to 3.5 % (1 sigma).
    np.testing.assert_allclose(positions.std(0), sensors.position_noise, rtol=0.15)
    np.testing.assert_allclose(turns.std(0), sensors.rotation_noise, rtol=0.15)
    np.testing.assert_allclose(tensions.std(0), sensors.tension_noise, rtol=0.15)


def test_seeds_repeat_bit_for_bit():
    """The same controller object twice: nothing is left of the first run. Another seed is another motion."""
    robot = demobot()
    controller = PoseFeedback(RigidLengths(robot))

    def once(seed: int) -> cdpr.Trajectory:
        sensors = cdpr.Sensors(delay=0.01, position_noise=1e-4, rotation_noise=1e-3, seed=seed)
        return cdpr.track(robot, LINE, controller, seconds=0.2, sensors=sensors)

    one, again, other = once(3), once(3), once(4)
    for name in ("positions", "rotations", "tensions", "rest_lengths"):
        np.testing.assert_array_equal(getattr(one, name), getattr(again, name))
    assert np.abs(one.positions - other.positions).max() > 1e-6


def test_delay_matters():
    """Feedback that is quick to believe what it sees is calm with fresh samples, and swings up with stale ones."""
    robot = demobot(material="vectran-0.7mm")
    exits = robot.exits.copy()
    exits[0, 0] += 0.005
    controller = PoseFeedback(RigidLengths(robot.replace(exits=exits)), gain=9.0)
    errors = []
    for delay in (0.0, 0.35):  # an integral takes a delay of pi/2 over its gain, 0.17 s
        motion = cdpr.track(robot, [POSE], controller, seconds=2.0, damping=0.2, sensors=cdpr.Sensors(delay=delay))
        errors.append(np.linalg.norm(motion.deviation[-25:], axis=1).max())
    assert errors[0] < 1e-5
    assert errors[1] > 1e-3


def test_damping_is_of_the_platforms_swing():
    """Held by tensions alone the platform is a pendulum: pushed off, it swings on, or creeps back."""
    robot = demobot()
    swings = []
    for damping in (0.05, 1.0):
        motion = cdpr.track(robot, [POSE], Pushed(HeldTensions(robot)), seconds=2.0, rate=25.0, damping=damping)
        along = motion.deviation[:, 0]
        swings.append(int((np.diff(np.sign(along[np.abs(along) > 1e-5])) != 0).sum()))
    assert swings[0] >= 2
    assert swings[1] == 0


def test_overdamped_cables_pull_evenly(monkeypatch):
    """Cables that are damped 400 times more than critically; with damping taken half a step ahead they jerk."""
    robot = demobot(material="vectran-0.7mm")

    def peak() -> float:
        return float(cdpr.track(robot, LINE, RigidLengths(robot), seconds=0.6, cable_damping=1.0).tensions.max())

    assert peak() < robot.weight
    as_written = Machine._damp
    monkeypatch.setattr(Machine, "_damp", lambda *given: (as_written(*given)[0], np.inf))
    assert peak() > 5 * robot.weight


@dataclass
class Pushed:
    """Another controller, whose platform begins 20 mm beside its place."""

    inner: cdpr.Controller

    def start(self, reference: cdpr.Reference) -> np.ndarray:
        robot, beside = reference.path.robot, moved(reference.pose(0.0), np.array([0.02, 0, 0, 0, 0, 0]))
        aside = cdpr.Reference(PosePath(robot, [beside]), 1.0)
        first = np.asarray(self.inner.start(aside))
        self.inner.start(reference)
        return first

    def command(self, time: float, pose: RigidTransform, measurement: cdpr.Measurement):
        return self.inner.command(time, pose, measurement)


@pytest.fixture(scope="module")
def whole() -> np.ndarray:
    """Positions of a motion by a controller that does not fail."""
    return cdpr.track(demobot(), LINE, RigidLengths(demobot()), seconds=1.0).positions


@pytest.mark.parametrize(
    ("answer", "message"),
    [
        (lambda lengths: lengths * np.nan, r"rest_lengths: found nan, expected finite numbers"),
        (lambda lengths: lengths[:3], r"rest_lengths: found an array of shape \(3,\), expected shape \(8,\)"),
        (lambda lengths: lengths * 0, r"rest_lengths: found 0 m, expected more than 0"),
        (lambda lengths: lengths * 9, r"rest_lengths: found [\d.]+ m in cable 1, expected [\d.]+ to [\d.]+ m"),
        (lambda lengths: ["shorter"] * 8, "rest_lengths: found .*, expected numbers"),
        (lambda lengths: 1 / 0, "found ZeroDivisionError: division by zero"),
        (
            lambda lengths: cdpr.Command(lengths, np.full(8, -1.0), np.ones(8, dtype=bool)),
            "tensions: found -1 N, expected 0 or more",
        ),
        (lambda lengths: cdpr.Command(lengths, np.ones(8), np.ones(8)), "by_tension: found .* True or False"),
    ],
)
def test_a_bad_command_is_said_in_a_sentence_and_loses_nothing(answer, message, whole):
    """The motion so far is the one of a controller that does not fail."""
    robot = demobot()
    with pytest.raises(BadCommand, match=rf"cogiro: controller: 0\.1 s into the motion: {message}") as bad:
        cdpr.track(robot, LINE, After(robot, answer), seconds=1.0)
    so_far = bad.value.trajectory
    assert so_far is not None
    np.testing.assert_array_equal(so_far.positions, whole[:11])


def test_a_platform_that_falls_is_said_to_fall():
    """As when it is driven: the motion so far is kept."""
    robot = cdpr.Robot(
        exits=[[0, 0, 1], [0, 0.4, 1], [0.1, 0.2, 1.0]],
        anchors=[[0, -0.05, 0], [0, 0.05, 0], [0.02, 0, 0.02]],
        axial_stiffness=1e4,
        mass=1.0,
        name="one-sided",
        workspace=[[0, 0, 0.2], [1, 0.4, 0.9]],
    )
    with pytest.raises(
        PlatformFell, match=r"one-sided: found the platform fallen .* s into the motion.*m away"
    ) as fell:
        cdpr.track(robot, [[0.1, 0.2, 0.4], [0.9, 0.2, 0.9]], RigidLengths(robot), seconds=5.0)
    assert fell.value.trajectory is not None
    assert 1 < len(fell.value.trajectory) < 501


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ({"rate": 0.0}, "rate: found 0 Hz, expected more than 0"),
        ({"rate": 1e9}, r"rate: found 1e\+09 Hz"),
        ({"seconds": 0.0}, "seconds: found 0 s"),
        ({"seconds": 1e9}, r"seconds: found 1e\+09"),
        ({"pause": -1.0}, "pause: found -1, expected 0 or more"),
        ({"winch_speed": 0.0}, "winch_speed: found 0 m/s"),
        ({"damping": -0.1}, "damping: found -0.1"),
        ({"cable_damping": np.nan}, "cable_damping: found nan"),
        ({"sensors": 100}, "sensors: found 100, expected Sensors"),
        ({"controller": 7}, "controller: found 7, expected an object with a method 'start'"),
        ({"controller": RigidLengths}, r"controller: found the class RigidLengths, expected .* RigidLengths\(robot\)"),
        ({"waypoints": []}, "waypoints: found none"),
        ({"waypoints": [[0.4, 0.25, 0.9]]}, "falls since cables cannot push"),
        (
            {"robot": demobot(pulley_radius=0.02), "waypoints": UNDER_A_PULLEY},
            "pose: found the anchor of cable 2 inside or below its pulley's wheel",
        ),
    ],
)
def test_bad_input_is_refused_in_a_sentence(words, message):
    """Before anything is simulated, and before the controller is asked for anything."""
    robot = demobot()
    given: dict[str, Any] = {"robot": robot, "waypoints": LINE, "controller": RigidLengths(robot)} | words
    with pytest.raises(cdpr.InvalidInput, match=message):
        cdpr.track(**given)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ({"period": 0.0}, "period: found 0 s"),
        ({"delay": -0.01}, "delay: found -0.01"),
        ({"position_noise": np.nan}, "position_noise: found nan"),
        ({"seed": -1}, "seed: found -1"),
    ],
)
def test_sensors_that_cannot_be_are_refused(words, message):
    """When they are described."""
    with pytest.raises(cdpr.InvalidInput, match=message):
        cdpr.Sensors(**words)


@pytest.mark.parametrize(
    ("start", "message"),
    [
        (lambda: np.full(8, np.nan), "rest_lengths: found nan"),
        (lambda: 1 / 0, "found ZeroDivisionError: division by zero"),
        (lambda: cdpr.load_robot("cogrio"), "unknown robot 'cogrio'"),
    ],
)
def test_a_controller_that_fails_at_its_start_is_said_in_a_sentence(start, message):
    """A controller may fail before it begins, as it may later."""
    robot = demobot()

    @dataclass
    class Never:
        def start(self, reference):
            return start()

        def command(self, time, pose, measurement):
            return np.ones(8)

    with pytest.raises(BadCommand, match=f"cogiro: when the controller starts: ({message})"):
        cdpr.track(robot, LINE, Never())


@pytest.mark.parametrize(("rate", "times"), [(1e-6, [0, 0.25]), (2.0, [0, 0.25]), (10.0, [0, 0.1, 0.2, 0.25])])
def test_a_motion_ends_with_its_course(rate, times):
    """Where a period of the controller is longer than what is left of the course, the period ends with it."""
    motion = cdpr.track(demobot(), LINE, RigidLengths(demobot()), seconds=0.2, pause=0.05, rate=rate)
    np.testing.assert_allclose(motion.times, times, atol=COPIED)
    np.testing.assert_allclose(motion.commanded[-1].translation, LINE[1], atol=COPIED)
    np.testing.assert_allclose(motion.rest_lengths[-1], demobot().rest_lengths(LINE[1]), atol=COPIED)


def test_what_is_wanted_accelerates_as_minimum_jerk_says():
    """x'' = L/T² (60 s − 180 s² + 120 s³) (Flash and Hogan 1985), and nothing before and after."""
    robot = demobot()
    reference = cdpr.Reference(PosePath(robot, [robot.pose(one) for one in LINE]), seconds=2.0, pause=1.0)
    for time in (1.5, 2.0, 2.7):
        s = (time - 1.0) / 2.0
        expected = 0.06 / 4 * (60 * s - 180 * s**2 + 120 * s**3)
        np.testing.assert_allclose(reference.acceleration(time), [expected, 0, 0], atol=1e-5)
    np.testing.assert_allclose(reference.acceleration(0.5), 0, atol=1e-9)
    np.testing.assert_allclose(reference.acceleration(3.5), 0, atol=1e-9)

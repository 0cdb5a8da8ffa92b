"""Closed loop in MuJoCo: winches go where they are told and no faster, sensors are as good as they are said to be."""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform
from test_drive import EVERY, LAW

import cdpr_sim as cdpr
from cdpr_sim import PoseFeedback, RigidLengths
from cdpr_sim.core.pose_path import PosePath
from cdpr_sim.core.trajectory import BadCommand

POSE = [0.3, 0.25, 0.1]
LINE = [POSE, [0.36, 0.25, 0.1]]

ROBOT = cdpr.load_robot("cogiro").replace(material="fishing-0.4mm")
STIFF = cdpr.load_robot("cogiro")

COPIED = 1e-12
"""[m] Of numbers that are handed on, or computed anew with other roundings."""

HELD = 1e-3
"""Fraction by which winches miss a tension of sagging or nonlinear cables while the platform moves."""


@dataclass
class Listener:
    """Rigid lengths, and all that sensors have said; or an ``answer`` of another kind after a tenth of a second."""

    robot: cdpr.Robot
    answer: Callable[[np.ndarray], Any] | None = None
    heard: list[tuple[float, cdpr.Measurement]] = field(default_factory=list)

    def start(self, reference: cdpr.Reference) -> np.ndarray:
        self.heard.clear()
        return self.robot.rest_lengths(reference.pose(0.0))

    def command(self, time: float, pose: RigidTransform, measurement: cdpr.Measurement) -> Any:
        self.heard.append((time, measurement))
        lengths = self.robot.rest_lengths(pose)
        return lengths if self.answer is None or time <= 0.105 else self.answer(lengths)


@dataclass
class ByTime:
    """Winches that let out lengths, or hold tensions, by time alone."""

    at: Callable[[float], Any]
    first: np.ndarray

    def start(self, reference: cdpr.Reference) -> np.ndarray:
        return self.first

    def command(self, time: float, pose: RigidTransform, measurement: cdpr.Measurement) -> Any:
        return self.at(time)


# Winches.


@pytest.mark.parametrize(
    ("rate", "times"),
    [(50.0, np.arange(16) / 50), (1e-6, [0, 0.3]), (2.0, [0, 0.3]), (8.0, [0, 0.125, 0.25, 0.3])],
)
def test_winches_are_where_they_were_told_to_be_at_the_next_instant(rate, times):
    """One state per control period; between two the winches run evenly, so that they lag behind by nothing.

    Where a period is longer than what is left of the course, it ends with it.
    """
    motion = cdpr.track(ROBOT, LINE, RigidLengths(ROBOT), seconds=0.2, pause=0.1, rate=rate)
    np.testing.assert_allclose(motion.times, times, atol=COPIED)
    lengths = cdpr.Problems.of(ROBOT, motion.commanded).rest_lengths
    np.testing.assert_allclose(motion.rest_lengths, lengths, rtol=0, atol=COPIED)
    np.testing.assert_allclose(motion.commanded.translation[[0, -1]], LINE, atol=COPIED)
    np.testing.assert_allclose(motion.commanded.translation[motion.times <= 0.1][-1], POSE, atol=COPIED)


def test_winches_run_no_faster_than_they_can():
    """Half as fast as the motion wants them they fall behind, and make up for it once it slows down."""
    slow = cdpr.track(ROBOT, LINE, RigidLengths(ROBOT), seconds=0.8, winch_speed=0.06)
    assert np.abs(np.diff(slow.rest_lengths, axis=0)).max() / 0.01 == pytest.approx(0.06, rel=1e-6)
    wanted = np.array([ROBOT.rest_lengths(pose) for pose in slow.commanded])
    assert np.abs(slow.rest_lengths - wanted).max() > 1e-3
    free = cdpr.track(ROBOT, LINE, RigidLengths(ROBOT), seconds=0.8)
    assert 0.06 < np.abs(np.diff(free.rest_lengths, axis=0)).max() / 0.01 < 1.0


LINEAR = [LAW, LAW, *[(0.0, 0.0)] * 6]
HOLDING = {
    "crane of all kinds": (cdpr.load_robot("cogiro-crane").replace(**EVERY | {"stiffening": LINEAR}), (1.0, 1.0, 2.0)),
    "nonlinear": (ROBOT.replace(stiffening=LINEAR), (0.3, 0.2, 0.15)),
    "nonlinear over pulleys": (
        ROBOT.replace(stiffening=LINEAR, pulley_radius=0.01, winch_to_exit=0.5, reeving=2),
        (0.3, 0.2, 0.15),
    ),
}


@pytest.mark.parametrize("name", HOLDING)
def test_winches_hold_the_tensions_of_sagging_and_nonlinear_cables(name):
    """At the platform's end, from tensions that were others; those of an equilibrium, in which the platform stays."""
    robot, pose = HOLDING[name]
    wanted, first = cdpr.compensate(robot, pose).tensions, robot.rest_lengths(pose)
    command = cdpr.Command(first, wanted, np.ones(robot.cables, bool))
    motion = cdpr.track(robot, [pose], ByTime(lambda time: command, first), seconds=0.1)
    assert np.abs(motion.tensions[0] - wanted).max() > 10 * HELD
    np.testing.assert_allclose(motion.tensions[-1], wanted, rtol=HELD)


# Sensors.


def test_sensors_say_what_was_so_when_they_looked():
    """Period and delay: the newest sample that has come through, and its pose and tensions are the true ones then."""
    listener = Listener(ROBOT)
    motion = cdpr.track(ROBOT, LINE, listener, seconds=1.0, sensors=cdpr.Sensors(period=0.03, delay=0.02))
    assert len(listener.heard) == 100
    for time, measurement in listener.heard[10:]:
        assert measurement.time == pytest.approx(0.03 * np.floor((time - 0.03) / 0.03 + 1e-6), abs=1e-9)
        row = round(100 * measurement.time)
        np.testing.assert_array_equal(measurement.pose.translation, motion.poses[row].translation)
        np.testing.assert_array_equal(measurement.tensions, motion.tensions[row])
        np.testing.assert_array_equal(measurement.rest_lengths, motion.rest_lengths[row])
    first = listener.heard[0][1]
    assert first.time == pytest.approx(-0.02)  # the platform has stood still for a while
    np.testing.assert_array_equal(first.pose.translation, motion.poses[0].translation)


def test_noise_is_as_large_as_it_is_said_to_be_and_moves_nothing_by_itself():
    """Standard deviations of 400 samples, which tell them to 3.5 %; who does not listen goes as without noise."""
    listener = Listener(ROBOT)
    sensors = cdpr.Sensors(period=1 / 400, position_noise=1e-3, rotation_noise=1e-2, tension_noise=0.1)
    noisy = cdpr.track(ROBOT, [POSE], listener, seconds=1.0, rate=400.0, sensors=sensors)
    quiet = cdpr.track(ROBOT, [POSE], Listener(ROBOT), seconds=1.0, rate=400.0)
    np.testing.assert_array_equal(noisy.positions, quiet.positions)
    heard = [measurement for _, measurement in listener.heard]
    positions = np.array([one.pose.translation for one in heard]) - noisy.positions[:-1]
    turns = np.array([one.pose.rotation.as_rotvec() for one in heard]) - noisy.poses[:-1].rotation.as_rotvec()
    tensions = np.array([one.tensions for one in heard]) - noisy.tensions[:-1]
    for found, said in ((positions, 1e-3), (turns, 1e-2), (tensions, 0.1)):
        np.testing.assert_allclose(found.std(0), said, rtol=0.15)


def test_seeds_repeat_bit_for_bit():
    """The same controller object twice: nothing is left of the first run. Another seed is another motion."""
    controller = PoseFeedback(RigidLengths(ROBOT))

    def once(seed: int) -> cdpr.Trajectory:
        sensors = cdpr.Sensors(delay=0.01, position_noise=1e-4, rotation_noise=1e-3, seed=seed)
        return cdpr.track(ROBOT, LINE, controller, seconds=0.2, sensors=sensors)

    one, again, other = once(3), once(3), once(4)
    for name in ("positions", "rotations", "tensions", "rest_lengths"):
        np.testing.assert_array_equal(getattr(one, name), getattr(again, name))
    assert np.abs(one.positions - other.positions).max() > 1e-6


# Damping.


def test_overdamped_cables_pull_evenly():
    """Cables that are damped 400 times more than critically: with damping taken half a step ahead they would jerk."""
    robot = STIFF.replace(material="vectran-0.7mm")
    motion = cdpr.track(robot, LINE, RigidLengths(robot), seconds=0.6, cable_damping=1.0)
    assert motion.tensions.max() < robot.weight  # five times as much where they jerk


def test_overdamped_chains_follow_their_winches():
    """A damper that would push takes its spring's pull and no more: chains flew apart where it left the spring."""
    robot, line = STIFF.replace(linear_density=5e-4), [STIFF.home, STIFF.home + np.array([0.02, 0.0, 0.0])]
    motion = cdpr.track(robot, line, RigidLengths(robot), seconds=0.1, cable_damping=0.1)
    assert np.abs(motion.positions[-1] - line[1]).max() < 1e-3  # the platform follows to a twentieth of the way


def test_a_simulation_that_becomes_unstable_is_said_and_gives_the_finite_part(monkeypatch):
    """Its last state, which is not finite, is neither measured nor returned."""
    monkeypatch.setattr("cdpr_sim.physics.track.MOST_CABLE_DAMPING", np.inf)
    with pytest.raises(cdpr.PlatformFell, match="the simulation in MuJoCo became unstable") as fell:
        cdpr.track(ROBOT, LINE, RigidLengths(ROBOT), seconds=0.6, cable_damping=1e300)
    assert fell.value.trajectory is not None
    assert np.isfinite(fell.value.trajectory.positions).all()


# Commands and references.


def test_a_bad_command_loses_nothing():
    """The motion so far is the one of a controller that does not fail."""
    with pytest.raises(BadCommand, match=r"cogiro: controller: 0\.1 s into the motion: rest_lengths: found nan") as bad:
        cdpr.track(ROBOT, LINE, Listener(ROBOT, lambda lengths: lengths * np.nan), seconds=1.0)
    whole = cdpr.track(ROBOT, LINE, RigidLengths(ROBOT), seconds=1.0)
    assert bad.value.trajectory is not None
    np.testing.assert_array_equal(bad.value.trajectory.positions, whole.positions[:11])


def test_what_is_wanted_accelerates_as_minimum_jerk_says():
    """x'' = L/T² (60 s − 180 s² + 120 s³) (Flash and Hogan 1985), and nothing before and after."""
    reference = cdpr.Reference(PosePath(ROBOT, [ROBOT.pose(one) for one in LINE]), seconds=2.0, pause=1.0)
    for time in (1.5, 2.0, 2.7):
        s = (time - 1.0) / 2.0
        expected = 0.06 / 4 * (60 * s - 180 * s**2 + 120 * s**3)
        np.testing.assert_allclose(reference.acceleration(time), [expected, 0, 0], atol=1e-5)
    for time in (0.5, 3.5):
        np.testing.assert_allclose(reference.acceleration(time), 0, atol=1e-9)

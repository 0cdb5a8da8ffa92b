"""Controllers, each against what statics or arithmetic says its motion must come to."""

import itertools
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

import cdpr_sim as cdpr
from cdpr_sim import ElasticLengths, HeldTensions, LengthsAndTensions, PoseFeedback, RigidLengths
from cdpr_sim.core.pose import moved
from cdpr_sim.core.pose_path import PosePath

POSE = [0.3, 0.25, 0.1]
QUICK = [POSE, [0.5, 0.25, 0.1]]

CALM: dict[str, Any] = {"seconds": 1.0, "damping": 4.0}
"""A still target, and enough time and drag, some 40/s per mass, to come to rest there."""

SAME = 1e-8
"""[m] Between a platform that has come to rest in MuJoCo and its equilibrium by statics: measured below 1e-9 m."""

HELD = 1e-9
"""[N] By which an ideal motor misses its tension: rounding of some newtons."""

STIFF = cdpr.load_robot("cogiro")
ROBOT = STIFF.replace(material="fishing-0.4mm")


def wrong(robot: cdpr.Robot) -> cdpr.Robot:
    """20 % in EA, 5 mm in one exit."""
    exits = robot.exits + 0.005 * np.outer(np.arange(8) == 0, [1, 0, 0])
    return robot.replace(exits=exits, axial_stiffness=0.8 * robot.axial_stiffness)


BELIEVED = wrong(ROBOT)


def reference(*positions: list[float]) -> cdpr.Reference:
    """A line through these positions in a second."""
    return cdpr.Reference(PosePath(ROBOT, [RigidTransform.from_translation(one) for one in positions]), seconds=1.0)


def seen(time: float, pose: RigidTransform) -> cdpr.Measurement:
    return cdpr.Measurement(time, pose, np.zeros(8), np.ones(8))


def deviations(robot: cdpr.Robot, line: list, controller: cdpr.Controller, **words) -> np.ndarray:
    """Distance from where the platform is wanted, at each state [m]."""
    return np.linalg.norm(cdpr.track(robot, line, controller, **words).deviation, axis=1)


def test_the_progress_of_a_motion_is_told_from_its_beginning_to_its_end():
    """As fractions that grow evenly, of a track and of a drive."""
    for motion in (
        lambda tell: cdpr.track(ROBOT, QUICK, RigidLengths(ROBOT), seconds=0.2, rate=50, progress=tell),
        lambda tell: cdpr.drive(ROBOT, QUICK, seconds=0.2, states=11, progress=tell),
    ):
        told: list[float] = []
        motion(told.append)
        assert told == pytest.approx(np.linspace(0, 1, 11))


def test_held_tensions_start_at_the_first_pose_however_fast_the_motion_is():
    """On the lengths that hold it there."""
    line = cdpr.Reference(reference(*QUICK).path, seconds=2e-3)
    there = cdpr.compensate(STIFF, POSE).rest_lengths
    np.testing.assert_allclose(HeldTensions(STIFF).start(line), there, rtol=0, atol=1e-12)


# Lengths.


def test_elastic_lengths_between_compensated_poses():
    """Along a line the platform stays on it, though compensation is computed every 20 mm only; rigid lengths sag.

    What is left is the platform's inertia, m a/K = 0.4 kg 0.14 m/s² / 1700 N/m = 3e-5 m, and what rings after it.
    Compensation between these poses is within 2 µm of what is right there: 0.7 measured, and 34 with two ends alone.
    """
    words = {"seconds": 2.0, "damping": 0.0}
    line = [[0.25, 0.25, 0.1], [0.35, 0.25, 0.1]]
    assert deviations(ROBOT, line, ElasticLengths(ROBOT), **words).max() < 1e-4
    assert deviations(ROBOT, line, RigidLengths(ROBOT), **words).max() > 4e-4
    line, controller = reference([0.15, 0.2, 0.08], [0.6, 0.3, 0.12]), ElasticLengths(ROBOT)
    controller.start(line)
    for time in np.linspace(0.1, 0.9, 7):
        pose = line.pose(time)
        right = cdpr.compensate(ROBOT, pose).rest_lengths
        np.testing.assert_allclose(controller.command(time, pose, seen(0.0, pose)), right, atol=2e-6)


# Feedback.


@pytest.mark.parametrize("inner", [RigidLengths, ElasticLengths])
def test_pose_feedback_removes_a_constant_error_of_the_model(inner):
    """At the rate it is told: e falls by exp(−gain t); without it the error stays."""
    believed, gain, seconds = wrong(STIFF), 5.0, 1.8
    stays = deviations(STIFF, [POSE], inner(believed), seconds=0.1)
    assert stays.min() > 1e-3
    controller = PoseFeedback(inner(believed), gain=gain)
    motion = cdpr.track(STIFF, [POSE], controller, seconds=seconds, damping=0.2)
    errors = np.linalg.norm(motion.deviation, axis=1)
    assert errors[0] == pytest.approx(stays[0], rel=1e-6)
    expected = errors[0] * np.exp(-gain * seconds)
    assert expected / 5 < errors[-1] < 5 * expected
    assert motion.tilt[-1] < 1e-3 * motion.tilt[0]


def test_pose_feedback_corrects_no_further_than_it_may():
    """A target out of reach is given up at 50 mm, and does not wind up cables without end."""
    beside = np.array([0.1, 0, 0, 0, 0, 0])

    class Elsewhere(RigidLengths):
        """Rigid lengths of another pose, 0.1 m beside."""

        def start(self, reference):
            return self.robot.rest_lengths(moved(reference.pose(0.0), beside))

        def command(self, time, pose, measurement):
            return super().command(time, moved(pose, beside), measurement)

    motion = cdpr.track(STIFF, [[0.4, 0.25, 0.1]], PoseFeedback(Elsewhere(STIFF), gain=4.0), seconds=1.0)
    assert motion.deviation[-1, 0] == pytest.approx(0.05, abs=2e-3)


def test_pose_feedback_compares_a_late_sample_with_what_was_wanted_then():
    """A platform that is always where it was wanted needs no correction, however late its sensors say so.

    One that is seen 10 mm aside for 0.9 s at a gain of 5/s needs 45 mm; and a new run begins without.
    """
    line, controller = reference(POSE, [0.4, 0.25, 0.1]), PoseFeedback(RigidLengths(ROBOT), gain=5.0)
    for aside, wanted in ((0.0, 0.0), (0.01, -0.045), (0.0, 0.0)):
        controller.start(line)
        for time in np.linspace(0.1, 1.0, 10):
            late = moved(line.pose(time - 0.1), np.eye(6)[1] * aside)
            controller.command(time, line.pose(time), seen(time - 0.1, late))
        told = controller.command(1.1, line.pose(1.0), seen(0.9, line.pose(0.9)))
        expected = moved(line.pose(1.0), np.eye(6)[1] * wanted)
        np.testing.assert_allclose(told, ROBOT.rest_lengths(expected), atol=1e-12)


# Tensions.


def test_force_control_holds_the_wanted_tensions():
    """Whatever EA is: winches have let out what such cables stretch to that. Lengths under a wrong EA do not."""
    believed = ROBOT.replace(axial_stiffness=0.8 * ROBOT.axial_stiffness)
    tensions = cdpr.compensate(ROBOT, POSE).tensions
    motion = cdpr.track(ROBOT, [POSE], HeldTensions(believed), seconds=1.0)
    np.testing.assert_allclose(motion.tensions[1:], np.broadcast_to(tensions, (100, 8)), atol=HELD)
    strain = motion.lengths[-1] / motion.rest_lengths[-1] - 1
    np.testing.assert_allclose(ROBOT.axial_stiffness * strain, tensions, rtol=1e-3)
    lengths = cdpr.track(ROBOT, [POSE], ElasticLengths(believed), seconds=1.0)
    assert np.abs(lengths.tensions[-1] - tensions).max() > 1e6 * HELD


def test_force_control_carries_the_platforms_inertia():
    """Along a quick line in vacuum it is where it is wanted; as if it stood still it would be left behind by m a/K.

    That is centimetres, since tensions hold it like a spring of some 2 N/m.
    """

    class Standing(HeldTensions):
        def command(self, time, pose, measurement):
            return super().command(-1.0, pose, measurement)  # before anything moves

    words = {"seconds": 1.0, "damping": 0.0}
    assert deviations(ROBOT, QUICK, HeldTensions(ROBOT), **words).max() < 3e-3
    assert deviations(ROBOT, QUICK, Standing(ROBOT), **words).max() > 3e-2


def test_force_control_accelerates_the_center_of_mass():
    """Newton and Euler on a box whose mass is not at its centre: forces add up to m (a − g), and do not turn it."""
    robot = ROBOT.replace(center_of_mass=[0.02, -0.01, 0.03])
    line, controller = reference(POSE, [0.4, 0.3, 0.12]), HeldTensions(robot)
    controller.start(line)
    pose, acceleration = line.pose(0.25), line.acceleration(0.25)
    tensions = controller.command(0.25, pose, seen(0.0, pose)).tensions
    ropes = robot.exits - pose.translation - robot.anchors
    pulls = tensions[:, None] * ropes / np.linalg.norm(ropes, axis=1, keepdims=True)
    assert np.linalg.norm(acceleration) > 0.3
    np.testing.assert_allclose(pulls.sum(0), robot.mass * (acceleration + np.array([0, 0, robot.gravity])), atol=1e-9)
    turning = np.cross(robot.anchors - robot.center_of_mass, pulls).sum(0)
    np.testing.assert_allclose(turning, 0, atol=1e-9)


def test_force_control_leaves_what_no_tensions_can_carry():
    """Outside the parallel layout's feasible workspace it holds what is nearest, within limits, and misses the pose."""
    robot = cdpr.load_robot("parallel")
    motion = cdpr.track(robot, [[0.25, 0.25, 0.1]], HeldTensions(robot), seconds=0.5)
    assert motion.tensions[1:].min() == pytest.approx(0.01 * robot.weight, rel=1e-6)
    assert np.linalg.norm(motion.deviation[-1]) > 0.02


def test_lengths_on_some_cables_and_tensions_on_the_others():
    """Two of eight cables, as many as there are to spare, have the planned tension; the others the planned length."""
    plan = cdpr.compensate(BELIEVED, POSE)
    motion = cdpr.track(ROBOT, [POSE], LengthsAndTensions(BELIEVED), seconds=1.0)
    by_tension = np.abs(motion.tensions[1:] - plan.tensions).max(0) < HELD
    assert by_tension.sum() == 2
    np.testing.assert_allclose(motion.rest_lengths[-1, ~by_tension], plan.rest_lengths[~by_tension], atol=1e-12)
    assert np.abs(motion.rest_lengths[-1, by_tension] - plan.rest_lengths[by_tension]).min() > 1e-5
    chosen = cdpr.track(ROBOT, [POSE], LengthsAndTensions(BELIEVED, by_tension=[3]), seconds=0.2)
    np.testing.assert_allclose(chosen.tensions[1:, 2], plan.tensions[2], atol=HELD)


def held_by(robot: cdpr.Robot, pose: list[float]) -> tuple[int, ...]:
    """The cables that ``LengthsAndTensions`` holds by tension, from 0."""
    controller, line = LengthsAndTensions(robot), reference(pose)
    controller.start(line)
    return tuple(np.flatnonzero(controller.command(0.0, line.pose(0.0), seen(0.0, line.pose(0.0))).by_tension).tolist())


def test_the_cables_left_to_tension_are_those_that_are_missed_least():
    """Of all 28 pairs: the softest direction of the other six cables' springs, by finite differences of their pull."""
    rest = cdpr.compensate(ROBOT, POSE)

    def wrench(move: np.ndarray, held: np.ndarray) -> np.ndarray:
        arms = Rotation.from_rotvec(move[3:] / ROBOT.characteristic_length).apply(np.array(ROBOT.anchors))
        ropes = ROBOT.exits - (POSE + move[:3] + arms)
        lengths = np.linalg.norm(ropes, axis=1)
        tensions = np.where(held, rest.tensions, ROBOT.axial_stiffness * (lengths / rest.rest_lengths - 1))
        pulls = tensions[:, None] * ropes / lengths[:, None]
        return np.append(pulls.sum(0), np.cross(arms, pulls).sum(0) / ROBOT.characteristic_length)

    def softest(pair: tuple[int, ...]) -> float:
        held, step = np.isin(np.arange(8), pair), 1e-6
        stiffness = np.array([(wrench(-move, held) - wrench(move, held)) / (2 * step) for move in step * np.eye(6)])
        return np.linalg.eigvalsh((stiffness + stiffness.T) / 2)[0]

    assert held_by(ROBOT, POSE) == max(itertools.combinations(range(8), 2), key=softest)


def test_a_trace_of_mass_does_not_change_which_cables_are_held_by_tension():
    """The choice is by the stiffness of the others, which sagging cables have as well."""
    for density in (0.0, 1e-6):
        assert held_by(STIFF.replace(linear_density=density), [0.3, 0.2, 0.15]) == (4, 5)


@pytest.mark.parametrize("kind", [ElasticLengths, HeldTensions, LengthsAndTensions])
def test_controllers_keep_within_the_tensions_that_they_are_given(kind):
    """A little more than the slackest cable has by default: no less, at the start and at the end."""
    least = 1.05 * cdpr.compensate(ROBOT, POSE).tensions.min()
    motion = cdpr.track(ROBOT, [POSE], kind(ROBOT, tension_limits=(least, ROBOT.weight)), **CALM)
    assert np.linalg.norm(motion.deviation[-1]) < SAME
    np.testing.assert_allclose(motion.tensions[[0, -1]].min(1), least, rtol=1e-6)

"""Controllers, each against what statics or arithmetic says its motion must come to."""

import itertools
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

import cdpr_sim as cdpr
from cdpr_sim import ElasticLengths, HeldTensions, LengthsAndTensions, PoseFeedback, RigidLengths
from cdpr_sim.core.pose import moved
from cdpr_sim.core.pose_path import PosePath

POSE = [0.3, 0.25, 0.1]

CALM: dict[str, Any] = {"seconds": 1.0, "damping": 4.0}
"""A still target, and enough time and drag, some 40/s per mass, to come to rest there."""

SAME = 1e-8
"""[m] Between a platform that has come to rest in MuJoCo and its equilibrium by statics: measured below 1e-9 m."""

HELD = 1e-9
"""[N] By which an ideal motor misses its tension: rounding of some newtons."""


def demobot() -> cdpr.Robot:
    return cdpr.load_robot("cogiro").replace(material="fishing-0.4mm")


def wrong(robot: cdpr.Robot) -> cdpr.Robot:
    """20 % in EA, 5 mm in one exit."""
    exits = robot.exits.copy()
    exits[0, 0] += 0.005
    return robot.replace(exits=exits, axial_stiffness=0.8 * robot.axial_stiffness)


@dataclass
class Aside:
    """Another controller, whose run begins with two cables 3 mm shorter: it has somewhere to go."""

    inner: cdpr.Controller

    def start(self, reference: cdpr.Reference) -> np.ndarray:
        lengths = np.array(self.inner.start(reference))
        lengths[:2] -= 0.003
        return lengths

    def command(self, time: float, pose: RigidTransform, measurement: cdpr.Measurement):
        return self.inner.command(time, pose, measurement)


def test_rigid_lengths_end_where_statics_says():
    """The platform comes to the equilibrium of the rigid lengths, from elsewhere; that is not where it is wanted."""
    robot = demobot()
    motion = cdpr.track(robot, [POSE], Aside(RigidLengths(robot)), **CALM)
    rest = cdpr.solve(robot, POSE)
    assert np.linalg.norm(motion.positions[0] - rest.position) > 1e-3
    np.testing.assert_allclose(motion.positions[-1], rest.position, atol=SAME)
    np.testing.assert_allclose(motion.tensions[-1], rest.tensions, atol=1e-5)
    assert np.linalg.norm(motion.positions[-1] - POSE) > 1e-4


def test_elastic_lengths_end_where_statics_says():
    """With the right model at the pose; with a wrong one where the true robot rests on those lengths."""
    robot = demobot()
    right = cdpr.track(robot, [POSE], Aside(ElasticLengths(robot)), **CALM)
    np.testing.assert_allclose(right.positions[-1], POSE, atol=SAME)
    believed = wrong(robot)
    lengths = cdpr.compensate(believed, POSE).rest_lengths
    off = cdpr.track(robot, [POSE], Aside(ElasticLengths(believed)), **CALM)
    np.testing.assert_allclose(off.positions[-1], cdpr.solve(robot, POSE, lengths).position, atol=SAME)
    assert np.linalg.norm(off.positions[-1] - POSE) > 1e-4


def test_elastic_lengths_between_compensated_poses():
    """Along a line the platform stays on it, though compensation is computed every 20 mm only; rigid lengths sag."""
    robot = demobot()
    line = [[0.25, 0.25, 0.1], [0.35, 0.25, 0.1]]
    errors = [
        np.linalg.norm(cdpr.track(robot, line, one, seconds=2.0, damping=0.0).deviation, axis=1).max()
        for one in (ElasticLengths(robot), RigidLengths(robot))
    ]
    # What is left is the platform's inertia, m a/K = 0.4 kg 0.14 m/s² / 1700 N/m = 3e-5 m, and what rings after it.
    assert errors[0] < 1e-4
    assert errors[1] > 4e-4


@pytest.mark.parametrize("inner", [RigidLengths, ElasticLengths])
def test_pose_feedback_removes_a_constant_error_of_the_model(inner):
    """At the rate it is told: e falls by exp(−gain t); without it the error stays."""
    robot, gain, seconds = cdpr.load_robot("cogiro"), 5.0, 1.8
    believed = wrong(robot)
    without = cdpr.track(robot, [POSE], inner(believed), seconds=0.1)
    stays = np.linalg.norm(without.deviation, axis=1)
    assert stays.min() > 1e-3
    motion = cdpr.track(robot, [POSE], PoseFeedback(inner(believed), gain=gain), seconds=seconds, damping=0.2)
    errors = np.linalg.norm(motion.deviation, axis=1)
    assert errors[0] == pytest.approx(stays[0], rel=1e-6)
    expected = errors[0] * np.exp(-gain * seconds)
    assert expected / 5 < errors[-1] < 5 * expected
    assert motion.tilt[-1] < 1e-3 * motion.tilt[0]


def test_pose_feedback_corrects_no_further_than_it_may():
    """A target out of reach is given up at 50 mm, and does not wind up cables without end."""
    robot = cdpr.load_robot("cogiro")

    beside = np.array([0.1, 0, 0, 0, 0, 0])

    class Elsewhere(RigidLengths):
        """Rigid lengths of another pose, 0.1 m beside."""

        def start(self, reference):
            return self.robot.rest_lengths(moved(reference.pose(0.0), beside))

        def command(self, time, pose, measurement):
            return super().command(time, moved(pose, beside), measurement)

    motion = cdpr.track(robot, [[0.4, 0.25, 0.1]], PoseFeedback(Elsewhere(robot), gain=4.0), seconds=1.0)
    assert motion.deviation[-1, 0] == pytest.approx(0.05, abs=2e-3)


def test_force_control_holds_the_wanted_tensions():
    """Whatever EA is. Lengths under a wrong EA do not."""
    robot = demobot()
    believed = robot.replace(axial_stiffness=0.8 * robot.axial_stiffness)
    tensions = cdpr.compensate(robot, POSE).tensions
    motion = cdpr.track(robot, [POSE], HeldTensions(believed), seconds=1.0)
    np.testing.assert_allclose(motion.tensions[1:], np.broadcast_to(tensions, (100, 8)), atol=HELD)
    strain = (
        motion.lengths[-1] / motion.rest_lengths[-1] - 1
    )  # winches have let out what such a cable stretches to that
    np.testing.assert_allclose(robot.axial_stiffness * strain, tensions, rtol=1e-3)
    lengths = cdpr.track(robot, [POSE], ElasticLengths(believed), seconds=1.0)
    assert np.abs(lengths.tensions[-1] - tensions).max() > 1e6 * HELD


def test_force_control_carries_the_platforms_inertia():
    """Along a quick line in vacuum it is where it is wanted; as if it stood still it would be left behind by m a/K.

    That is centimetres, since tensions hold it like a spring of some 2 N/m.
    """
    robot = demobot()
    line = [[0.3, 0.25, 0.1], [0.5, 0.25, 0.1]]
    motion = cdpr.track(robot, line, HeldTensions(robot), seconds=1.0, damping=0.0)
    assert np.linalg.norm(motion.deviation, axis=1).max() < 3e-3

    class Standing(HeldTensions):
        def command(self, time, pose, measurement):
            return super().command(-1.0, pose, measurement)  # before anything moves

    behind = cdpr.track(robot, line, Standing(robot), seconds=1.0, damping=0.0)
    assert np.linalg.norm(behind.deviation, axis=1).max() > 3e-2


def test_force_control_leaves_what_no_tensions_can_carry():
    """Outside the parallel layout's feasible workspace it holds what is nearest, within limits, and misses the pose."""
    robot = cdpr.load_robot("parallel")
    pose = [0.25, 0.25, 0.1]
    motion = cdpr.track(robot, [pose], HeldTensions(robot), seconds=0.5)
    lower = 0.01 * robot.weight
    assert motion.tensions[1:].min() == pytest.approx(lower, rel=1e-6)
    assert np.linalg.norm(motion.deviation[-1]) > 0.02


def test_a_winch_that_cannot_keep_up_holds_no_tension():
    """Its cable is then a spring that is wound as fast as the winch turns."""
    robot = demobot()
    line = [[0.3, 0.25, 0.1], [0.5, 0.25, 0.1]]
    motion = cdpr.track(robot, line, HeldTensions(robot), seconds=1.0, winch_speed=0.05)
    assert np.abs(np.diff(motion.rest_lengths, axis=0)).max() <= 0.05 * 0.01 * (1 + 1e-6)
    wanted = cdpr.compensate(robot, motion.commanded[50]).tensions
    assert np.abs(motion.tensions[50] - wanted).max() > 0.1


def test_lengths_on_some_cables_and_tensions_on_the_others():
    """Two of eight cables, as many as there are to spare, have the planned tension; the others the planned length."""
    robot = demobot()
    believed = wrong(robot)
    plan = cdpr.compensate(believed, POSE)
    motion = cdpr.track(robot, [POSE], LengthsAndTensions(believed), seconds=1.0)
    by_tension = np.abs(motion.tensions[1:] - plan.tensions).max(0) < HELD
    assert by_tension.sum() == 2
    np.testing.assert_allclose(motion.rest_lengths[-1, ~by_tension], plan.rest_lengths[~by_tension], atol=1e-12)
    assert np.abs(motion.rest_lengths[-1, by_tension] - plan.rest_lengths[by_tension]).min() > 1e-5
    chosen = cdpr.track(robot, [POSE], LengthsAndTensions(believed, by_tension=[3]), seconds=0.2)
    np.testing.assert_allclose(chosen.tensions[1:, 2], plan.tensions[2], atol=HELD)


@pytest.mark.parametrize(
    ("cables", "message"), [([0], "by_tension: found 0"), (range(1, 9), "by_tension: found all 8")]
)
def test_cables_that_are_not_there_are_refused(cables, message):
    """They count from 1, and some must hold a length."""
    robot = demobot()
    with pytest.raises(cdpr.InvalidInput, match=message):
        cdpr.track(robot, [POSE], LengthsAndTensions(robot, by_tension=cables), seconds=0.1)


def test_controllers_are_controllers():
    """All of them have what the protocol asks for; a robot does not."""
    robot = demobot()
    for one in (
        RigidLengths,
        ElasticLengths,
        HeldTensions,
        LengthsAndTensions,
        lambda r: PoseFeedback(RigidLengths(r)),
    ):
        assert isinstance(one(robot), cdpr.Controller)
    assert not isinstance(robot, cdpr.Controller)


def reference(robot: cdpr.Robot, *positions: list[float]) -> cdpr.Reference:
    """A line through these positions in a second."""
    return cdpr.Reference(PosePath(robot, [RigidTransform.from_translation(one) for one in positions]), seconds=1.0)


def seen(time: float, pose: RigidTransform) -> cdpr.Measurement:
    return cdpr.Measurement(time, pose, np.zeros(8), np.ones(8))


@pytest.mark.parametrize("kind", [ElasticLengths, HeldTensions, LengthsAndTensions])
def test_controllers_keep_within_the_tensions_that_they_are_given(kind):
    """A little more than the slackest cable has by default: no less, at the start and at the end."""
    robot = demobot()
    least = 1.05 * cdpr.compensate(robot, POSE).tensions.min()
    motion = cdpr.track(robot, [POSE], kind(robot, tension_limits=(least, robot.weight)), **CALM)
    assert np.linalg.norm(motion.deviation[-1]) < SAME
    np.testing.assert_allclose(motion.tensions[[0, -1]].min(1), least, rtol=1e-6)


def test_force_control_accelerates_the_center_of_mass():
    """Newton and Euler on a box whose mass is not at its centre: forces add up to m (a − g), and do not turn it."""
    robot = demobot().replace(center_of_mass=[0.02, -0.01, 0.03])
    line = reference(robot, [0.3, 0.25, 0.1], [0.4, 0.3, 0.12])
    controller = HeldTensions(robot)
    controller.start(line)
    pose = line.pose(0.25)
    tensions = controller.command(0.25, pose, seen(0.0, pose)).tensions
    corners = pose.translation + robot.anchors
    ropes = robot.exits - corners
    pulls = tensions[:, None] * ropes / np.linalg.norm(ropes, axis=1, keepdims=True)
    acceleration = line.acceleration(0.25)
    assert np.linalg.norm(acceleration) > 0.3
    np.testing.assert_allclose(pulls.sum(0), robot.mass * (acceleration + np.array([0, 0, robot.gravity])), atol=1e-9)
    turning = np.cross(corners - pose.translation - robot.center_of_mass, pulls).sum(0)
    np.testing.assert_allclose(turning, 0, atol=1e-9)


def test_the_cables_left_to_tension_are_those_that_are_missed_least():
    """Of all 28 pairs: the softest direction of the other six cables' springs, by finite differences of their pull."""
    robot = demobot()
    rest = cdpr.compensate(robot, POSE)

    def wrench(move: np.ndarray, held: np.ndarray) -> np.ndarray:
        arms = Rotation.from_rotvec(move[3:] / robot.characteristic_length).apply(np.array(robot.anchors))
        ropes = robot.exits - (POSE + move[:3] + arms)
        lengths = np.linalg.norm(ropes, axis=1)
        tensions = np.where(held, rest.tensions, robot.axial_stiffness * (lengths / rest.rest_lengths - 1))
        pulls = tensions[:, None] * ropes / lengths[:, None]
        return np.append(pulls.sum(0), np.cross(arms, pulls).sum(0) / robot.characteristic_length)

    def softest(pair: tuple[int, ...]) -> float:
        held, step = np.isin(np.arange(8), pair), 1e-6
        columns = [(wrench(-move, held) - wrench(move, held)) / (2 * step) for move in step * np.eye(6)]
        stiffness = np.array(columns)
        return np.linalg.eigvalsh((stiffness + stiffness.T) / 2)[0]

    controller, line = LengthsAndTensions(robot), reference(robot, POSE)
    controller.start(line)
    held = controller.command(0.0, line.pose(0.0), seen(0.0, line.pose(0.0))).by_tension
    stiffnesses = {pair: softest(pair) for pair in itertools.combinations(range(8), 2)}
    assert tuple(np.flatnonzero(held)) == max(stiffnesses, key=lambda pair: stiffnesses[pair])


def test_compensation_between_knots_is_as_good_as_at_them():
    """Along half a metre, within 2 µm of what is right there: 0.7 measured, and 34 with its two ends alone."""
    robot = demobot()
    line, controller = reference(robot, [0.15, 0.2, 0.08], [0.6, 0.3, 0.12]), ElasticLengths(robot)
    controller.start(line)
    for time in np.linspace(0.1, 0.9, 7):
        pose = line.pose(time)
        right = cdpr.compensate(robot, pose).rest_lengths
        np.testing.assert_allclose(controller.command(time, pose, seen(0.0, pose)), right, atol=2e-6)


def test_pose_feedback_compares_a_late_sample_with_what_was_wanted_then():
    """A platform that is always where it was wanted needs no correction, however late its sensors say so.

    One that is seen 10 mm aside for 0.9 s at a gain of 5/s needs 45 mm; and a new run begins without.
    """
    robot = demobot()
    line, controller = reference(robot, [0.3, 0.25, 0.1], [0.4, 0.25, 0.1]), PoseFeedback(RigidLengths(robot), gain=5.0)
    times = np.linspace(0.1, 1.0, 10)
    for aside, wanted in ((0.0, 0.0), (0.01, -0.045), (0.0, 0.0)):
        controller.start(line)
        for time in times:
            late = line.pose(time - 0.1)
            controller.command(time, line.pose(time), seen(time - 0.1, moved(late, np.eye(6)[1] * aside)))
        told = controller.command(1.1, line.pose(1.0), seen(0.9, line.pose(0.9)))
        expected = moved(line.pose(1.0), np.eye(6)[1] * wanted)
        np.testing.assert_allclose(told, robot.rest_lengths(expected), atol=1e-12)

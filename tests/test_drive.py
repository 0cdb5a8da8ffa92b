"""The winches drive, MuJoCo moves: slowly it is statics, quickly it is not. Cables of every kind."""

from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

import cdpr_sim as cdpr
from cdpr_sim.core.trajectory import PlatformFell

LINE = [[0.17, 0.25, 0.1], [0.63, 0.25, 0.1]]
"""The paper's, for DemoBot [m]."""

COGIRO, PARALLEL, CRANE = map(cdpr.load_robot, ("cogiro", "parallel", "cogiro-crane"))
LAW = (100.0, 2e4)
EVERY: dict[str, Any] = {
    "linear_density": [0.064, 0.0, 0.064, 0.064, 0.0, 0.064, 0.0, 0.03],
    "pulley_radius": [0.1, 0.1, 0.0, 0.05, 0.0, 0.1, 0.1, 0.0],
    "stiffening": [LAW, LAW, LAW, *[(0, 0)] * 5],
    "winch_to_exit": [6.0, 0.0, 3.0, 0.0, 2.0, 0.0, 0.0, 1.0],
    "reeving": [1, 2] * 4,
}
CRANE = CRANE.replace(**EVERY)
"""With each of the eight kinds of cable once, and drive lines."""

ONE_SIDED = cdpr.Robot(
    exits=[[0, 0, 1], [0, 0.4, 1], [0.1, 0.2, 1.0]], anchors=[[0, -0.05, 0], [0, 0.05, 0], [0.02, 0, 0.02]],
    axial_stiffness=1e4, mass=1.0, name="one-sided",
)  # fmt: skip
"""Three cables on one side, which cannot hold a platform beside them."""

KINEMATICS = 1e-12
"""[m] Rounding of a length of a metre, with room."""


def test_winches_let_out_the_rigid_lengths_of_the_command():
    """Rest lengths and commanded poses run along the line, from its one end to its other, in time; progress is told.

    A stack of transforms is taken as it is, and standing still on the way is no division by zero.
    """
    told: list[float] = []
    words = {"states": 21, "seconds": 2.0, "progress": told.append}
    trajectory = cdpr.drive(COGIRO, [[*LINE[0], 0, 0, 0], [*LINE[1], 0, 0.2, 0]], **words)
    np.testing.assert_allclose(trajectory.times, np.linspace(0, 2, 21), rtol=1e-9)
    np.testing.assert_allclose(told, np.linspace(0, 1, 21))
    for row, part in ((0, 0.0), (10, 0.5), (20, 1.0)):
        where = trajectory.commanded[row]
        np.testing.assert_allclose(where.translation, np.add(LINE[0], [0.46 * part, 0, 0]), atol=KINEMATICS)
        np.testing.assert_allclose(where.rotation.as_euler("xyz"), [0, 0.2 * part, 0], atol=KINEMATICS)
    for row in (0, 7, 20):
        expected = COGIRO.rest_lengths(trajectory.commanded[row])
        np.testing.assert_allclose(trajectory.rest_lengths[row], expected, atol=KINEMATICS)
    stack = RigidTransform.from_components([LINE[0], LINE[0], LINE[1]], Rotation.identity(3))
    standing = cdpr.drive(COGIRO, stack, seconds=1.0, states=3)
    np.testing.assert_allclose(standing.commanded.translation[-1], LINE[1], atol=KINEMATICS)


@pytest.mark.parametrize(
    ("robot", "pose", "seconds", "near"),
    [(PARALLEL, LINE[0], 12.0, (1e-4, 1e-2)), (CRANE, [1.0, 1.0, 2.0], 7.0, (1e-6, 0.1))],
    ids=["parallel", "crane"],
)
def test_a_platform_let_go_drops_from_where_it_was_commanded(robot, pose, seconds, near):
    """Without ``from_rest`` it starts at the command with no tension, falls freely at first, and comes to rest."""
    motion = cdpr.drive(robot, [pose], states=601, seconds=seconds, from_rest=False)
    np.testing.assert_allclose(motion.positions[0], pose, atol=KINEMATICS)
    if not robot.linear_density.any():
        assert motion.tensions[0].max() < 1e-9 * robot.weight
        assert 0 < -motion.deviation[1, 2] < robot.gravity * motion.times[1] ** 2
    rest = cdpr.solve(robot, pose)
    assert np.linalg.norm(motion.deviation, axis=1).max() > np.linalg.norm(rest.deviation)
    # Critically damped at 4.4/s for 12 s, and softer about some axes.
    np.testing.assert_allclose(motion.positions[-1], rest.position, atol=near[0])
    np.testing.assert_allclose(motion.tensions[-1], rest.tensions, atol=near[1])
    np.testing.assert_array_equal(motion.slack[-1], rest.slack)


@pytest.mark.parametrize(
    "moves",
    [
        lambda line: cdpr.drive(ONE_SIDED, line, seconds=20.0, states=101),
        lambda line: cdpr.track(ONE_SIDED, line, cdpr.RigidLengths(ONE_SIDED), seconds=20.0, rate=5.0),
    ],
    ids=["drive", "track"],
)
def test_a_platform_that_falls_is_said_to_fall(moves):
    """It swings away from three cables on one side, and the motion so far is kept; beside them it does not."""
    with pytest.raises(PlatformFell, match=r"one-sided: found the platform fallen .* s into the .*m away") as fell:
        moves([[0.1, 0.2, 0.4], [0.9, 0.2, 0.9]])
    assert fell.value.trajectory is not None
    assert 1 < len(fell.value.trajectory) < 101
    assert moves([[0.05, 0.2, 0.4], [0.05, 0.2, 0.5]]).times[-1] == 20.0


def test_a_platform_that_turns_over_is_said_to_fall():
    """By more than a right angle from how it was commanded, however near it is."""
    bar = cdpr.load_robot("two-cable")
    with pytest.raises(PlatformFell, match=r"two-cable: found the platform fallen 0\.\d+ s .*: it has turned over"):
        cdpr.drive(bar, [[*bar.home, 0, np.radians(150), 0]], seconds=3.0, states=31, from_rest=False)


def test_compensated_winches_keep_the_platform_on_the_line():
    """Crossed layout, fishing line: half a millimetre low with rigid lengths, on the line with compensated ones.

    Within the drag at the default speed, 1e-3 of the weight, against some 1e3 N/m, hence 4e-6 m; and corrections that
    are interpolated over 5 mm.
    """
    robot, line = COGIRO.replace(material="fishing-0.4mm"), np.linspace([0.3, 0.25, 0.1], [0.32, 0.25, 0.1], 5)
    lengths = [cdpr.compensate(robot, waypoint).rest_lengths for waypoint in line]
    rigid, compensated = (cdpr.drive(robot, line, states=5, rest_lengths=one) for one in (None, lengths))
    assert np.linalg.norm(rigid.deviation, axis=1).max() > 4e-4
    assert np.linalg.norm(compensated.deviation, axis=1).max() < 1e-5


def test_without_gravity_cables_are_driven_as_massless_ones():
    """They weigh nothing there, for settling as well."""
    robot = cdpr.load_robot("ipanema-1").replace(gravity=0.0)
    line, words = [(0, 0, 1), (0.1, 0, 1)], {"seconds": 1.0, "states": 5}
    plain, motion = (cdpr.drive(one, line, **words) for one in (robot, robot.replace(linear_density=0.01)))
    np.testing.assert_array_equal(motion.positions, plain.positions)
    np.testing.assert_array_equal(motion.tensions, plain.tensions)


@pytest.mark.parametrize("move", ["drive", "track"])
def test_light_cables_do_not_jerk_where_they_become_taut(move):
    """With 0.5 g/m over wheels, tensions stay near those of massless cables; there were peaks of 53 and 45 N."""
    robot = cdpr.load_robot("parallel").replace(pulley_radius=0.01)
    line = [robot.home, robot.home + np.array([0.05, 0, 0])]

    def largest(robot: cdpr.Robot) -> float:
        if move == "drive":
            return cdpr.drive(robot, line, seconds=1.0, states=31).tensions.max()
        return cdpr.track(robot, line, cdpr.RigidLengths(robot), seconds=0.5).tensions.max()

    assert largest(robot.replace(linear_density=5e-4)) < 1.05 * largest(robot)

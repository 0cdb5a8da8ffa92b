"""One batch of answers for both methods: each row is the single ``Equilibrium``, or says why there is none."""

import dataclasses

import numpy as np
import pytest
from sample_problems import garage_crane
from scipy.spatial.transform import Rotation

import cdpr_sim as cdpr
from cdpr_sim.core.pose import Pose
from cdpr_sim.core.robot_batch import RobotBatch
from cdpr_sim.design.constraints import ALL_TAUT
from cdpr_sim.design.layout_equilibria import Cases, solve_layouts
from cdpr_sim.statics.forces import equilibrium_at

METHODS = {
    "newton": (cdpr.solve, cdpr.solve_many, cdpr.NotConverged),
    "mujoco": (cdpr.settle, cdpr.settle_many, cdpr.NotSettled),
}
"""Per source: one, many, and what is raised where there is no rest."""

SAME = 1e-12
"""[m, rad, and relative] The same kernel, or the same simulation; rotations pass through a quaternion."""

TILTED, FREE, PUSHED = (0.17, 0.25, 0.1), (0.1, 0.1, 0.05), (0.4, 0.2, 0.2)
"""On ``parallel``: tilted with four slack cables; free to turn on two; and pushed by a wrench."""

WRENCHES = np.array([[0, 0, 0, 0, 0, 0], [0, 0, 0, 0, 0, 0], [0.2, -0.1, 0.3, 0.01, 0.02, -0.01]])

SAID = ("tilt", "euler", "deviation", "slack", "eigenvalues", "rest_lengths", "tensions", "lengths", "stable")


@pytest.mark.parametrize("source", METHODS)
def test_a_row_is_the_equilibrium_of_its_problem_alone(catalogue, source):
    """Indexing gives an ``Equilibrium``: that of the single call, in all that it and the batch say of themselves."""
    solve, many, _ = METHODS[source]
    batch = many(catalogue["parallel"], [TILTED, FREE, PUSHED], external_wrench=WRENCHES)
    assert (len(batch), batch.shape, batch.converged.all()) == (3, (3,), True)
    for row, one in enumerate(batch):
        alone = solve(batch.robot, (TILTED, FREE, PUSHED)[row], external_wrench=WRENCHES[row])
        assert (one.source, one.iterations) == (alone.source, alone.iterations) == (source, batch.iterations[row])
        assert one.residual <= 1e-8
        assert one.problem.same_as(alone.problem) or source == "newton"  # there, to a rounding
        assert batch.stability[row] is one.stability is alone.stability
        np.testing.assert_array_equal(batch.commanded[row].translation, one.problem.pose.translation)
        np.testing.assert_allclose(batch.poses[row].as_matrix(), one.pose.as_matrix(), rtol=0, atol=SAME)
        np.testing.assert_allclose(one.pose.as_matrix(), alone.pose.as_matrix(), rtol=0, atol=SAME)
        for name in SAID:
            rounding = dict(tensions=1e-8, eigenvalues=1e-6).get(name, SAME)  # EA/l0 times SAME
            np.testing.assert_allclose(getattr(batch, name)[row], getattr(one, name), rtol=0, atol=SAME, err_msg=name)
            np.testing.assert_allclose(getattr(one, name), getattr(alone, name), rtol=1e-9, atol=rounding, err_msg=name)
        assert one.tilt == pytest.approx(np.arccos(one.rotation_matrix[2, 2]), abs=1e-7)
        np.testing.assert_allclose(Rotation.from_euler("xyz", one.euler).as_matrix(), one.rotation_matrix, atol=SAME)
    stable, neutral = cdpr.Stability.STABLE, cdpr.Stability.NEUTRAL
    assert batch.stability.tolist() == [stable, neutral, stable]
    assert batch.slack[0].sum() == 4
    assert "tilt 26.420°, 4 of 8 cables slack" in repr(batch[0])


def test_a_residual_is_the_largest_force_with_torques_over_the_characteristic_length():
    """0.3 N and 0.02 N m left over on anchors 0.05 m from the origin: 0.4 N; and what the plane carries counts not."""
    exits, anchors = [[-0.05, 0, 1], [0.05, 0, 1]], [[-0.05, 0, 0], [0.05, 0, 0]]
    robot, there = cdpr.Robot(exits, anchors, 1e3, 1.0, gravity=0.0), Pose(np.zeros(3), np.eye(3))
    problem = cdpr.Problem.of(robot, (0, 0, 0), external_wrench=[0.3, 0, 0, 0, 0, 0.02])
    planar = dataclasses.replace(problem, robot=robot.replace(mobility="planar"))
    for asked, left in ((problem, 0.4), (planar, 0.3)):
        assert equilibrium_at(asked, there, iterations=0, source="hand").residual == pytest.approx(left)


@pytest.mark.parametrize("source", METHODS)
def test_a_row_without_a_rest_says_why_and_raises(catalogue, source):
    """By both methods the same ``Status``, no numbers, and the best point of one that a torque spins up."""
    solve, many, error = METHODS[source]
    level, spin = (0, 0, 0), np.zeros((5, 6))
    spin[4, 5] = 50.0
    poses = [(*TILTED, *level), (np.nan, 0.25, 0.1, *level), (0.4, 0.25, 2.0, *level), (0.4, 0.25, 0.1, np.inf, 0, 0)]
    found = many(catalogue["parallel"], [*poses, (*PUSHED, *level)], external_wrench=spin)
    words = [cdpr.Status.CONVERGED, cdpr.Status.NOT_FINITE, cdpr.Status.FALLS, cdpr.Status.NOT_FINITE]
    assert [cdpr.Status(int(status)) for status in found.status[:4]] == words
    assert found.converged.tolist() == [True, *[False] * 4]
    assert found[0].residual < 1e-8
    assert np.isnan(found.residuals[1:4]).all()
    assert all(len(getattr(found, name)) == 5 for name in (*SAID, "poses", "stability"))
    assert not found.stable[1:].any()
    for row in (1, 2, 3):
        assert np.isnan(found.poses[row].translation).all()
        assert np.isnan(found.tensions[row]).all()
        assert np.isnan(found.point(row).residual)  # whatever was asked before
        with pytest.raises(error, match=f"parallel: .*{words[row].sentence}") as caught:
            found[row]
        assert np.isnan(caught.value.equilibrium.residual)
    with pytest.raises(error):
        list(found)
    best = found.point(4)
    np.testing.assert_allclose(found.poses[4].translation, best.position, rtol=0, atol=SAME)
    for ask in (lambda: found[4], lambda: solve(found.problems[4])):
        with pytest.raises(error, match="under a torque with a constant direction in space there may be no") as said:
            ask()
        assert cdpr.Status(int(found.status[4])).sentence in str(said.value)
        assert said.value.reason == str(said.value)
        assert said.value.equilibrium.source == source
        assert not said.value.equilibrium.residual <= 1e-6 * found.problems[4].load


def test_a_trajectory_is_a_batch_with_times(catalogue):
    """Every state says of itself what a rest does, but is on its way: ``MOVING``, and no equilibrium."""
    one, motion = cdpr.settle_trajectory(catalogue["parallel"], TILTED)
    assert isinstance(motion, cdpr.EquilibriumBatch)
    assert motion.times.shape == motion.shape == motion.tilt.shape == (len(motion),)
    assert set(motion.status) == {cdpr.Status.MOVING}
    assert not motion.converged.any()
    assert np.isnan(motion.residuals).all()
    assert np.isnan(motion.eigenvalues).all()
    with pytest.raises(cdpr.NotSettled, match="the platform is moving"):
        motion[-1]
    np.testing.assert_array_equal(motion.point(-1).pose.as_matrix(), one.pose.as_matrix())
    for name in ("slack", "tilt", "euler", "deviation"):
        np.testing.assert_allclose(getattr(motion, name)[-1], getattr(one, name), atol=SAME)
    np.testing.assert_array_equal(motion.commanded[0].translation, TILTED)
    # The statics of its commands is a batch again, and may be asked of them as they are.
    static = cdpr.solve_trajectory(motion)
    assert static.problems is motion.problems
    np.testing.assert_allclose(static[-1].position, one.position, atol=1e-6)


# --- slack -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("density", [1e-3, 1e-6, 1e-9])
def test_light_cables_are_slack_where_massless_ones_are(catalogue, density):
    """By both methods, however light; negative control: with their own weight alone as the limit, half of them."""
    light = catalogue["parallel"]
    slack = cdpr.solve(light, TILTED).slack
    assert slack.sum() == 4
    robot = light.replace(linear_density=density)
    found = cdpr.solve_many(robot, [TILTED])
    for one in (found[0], cdpr.settle(robot, TILTED)):
        np.testing.assert_array_equal(one.slack, slack)
    by_weight = (found.lengths <= found.rest_lengths) & (found.tensions <= robot.cable_weights * found.rest_lengths)
    assert by_weight.sum() == 2


LEVEL = dict(axial_stiffness=1e9, mass=1.0, linear_density=1.0, gravity=10.0)
STEEL = dict(axial_stiffness=6.5e5, mass=2.0, linear_density=0.064)


@pytest.mark.parametrize(
    ("rope", "to", "rest_length", "pulls", "slack"),
    [
        # A level cable that leaves its ends at 30° has its own weight as tension there, sags by (2/sqrt 3 - 1)/ln 3, a
        # seventh of its span, and is 2/sqrt 3/ln 3 = 1.0510 long (Irvine, Cable Structures, 1981, chapter 1).
        (LEVEL, (1, 0, 0), 1.0505, (10.5, 10.6), False),
        (LEVEL, (1, 0, 0), 1.0515, (10.4, 10.52), True),
        # Steel of 4 mm and a platform of 2 kg: neither length nor tension alone says it.
        (STEEL, (4.7, 0, 0), 4.7 * (1 + 6e-5), (50, 60), False),  # a shallow catenary, longer than its path
        (STEEL, (0, 0, -3), 3 * (1 - 2.2e-6), (0.3, 0.6), False),  # plumb, stretched, with less than 1.9 N of its own
        (STEEL, (0.5, 0, 0), 3.0, (0, 3), True),  # a hanging loop
    ],
)
def test_a_shallow_catenary_and_a_plumb_cable_are_taut_and_a_loop_is_slack(rope, to, rest_length, pulls, slack):
    """A level cable is slack from a seventh of its span of sag on."""
    robot = cdpr.Robot([[0, 0, 0]], [[0, 0, 0]], platform_size=(0.1, 0.1, 0.1), **rope)
    there = Pose(np.array(to, dtype=float), np.eye(3))
    one = equilibrium_at(cdpr.Problem.of(robot, there, [rest_length]), there, iterations=0, source="newton")
    assert pulls[0] < one.tensions[0] < pulls[1]
    assert one.slack[0] == slack


def test_no_cable_of_a_crane_on_steel_rope_is_slack_because_it_sags():
    """By both methods; all parts of line count together; about half of the cables are longer than their paths."""
    for robot in (garage_crane(), garage_crane().replace(reeving=2, winch_to_exit=3.0)):
        poses = np.random.default_rng(0).uniform(*robot.workspace, (20, 3))
        for found in (cdpr.solve_many(robot, poses), cdpr.settle_many(robot, poses)):
            assert found.converged.all()
            assert (found.lengths <= found.rest_lengths).sum() > 20
            assert not found.slack.any()


def test_each_layout_and_each_mass_of_a_batch_has_its_own_limit_of_slackness():
    """Heavier ropes in the second layout are slack; in a batch of masses, each row is as its single equilibrium."""
    robot = garage_crane()
    heavy = robot.replace(linear_density=2.0)
    layouts = solve_layouts(RobotBatch.of([robot, heavy]), Cases.of(robot, [(1.5, 1.5, 0.3)]), 1)
    counts = [cdpr.solve(one, (1.5, 1.5, 0.3)).slack.sum() for one in (robot, heavy)]
    assert layouts.slack.sum((1, 2)).tolist() == counts
    assert counts[0] == 0 < counts[1]
    assert (ALL_TAUT.violation(layouts) > 0).tolist() == [False, True]
    masses = cdpr.solve_many(robot, [(1.2, 1.2, 1.0)], mass=np.array([[5.0], [500.0]]))
    for row, mass in enumerate((5.0, 500.0)):
        np.testing.assert_array_equal(masses.slack[row, 0], cdpr.solve(robot.replace(mass=mass), (1.2, 1.2, 1.0)).slack)

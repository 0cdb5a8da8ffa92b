"""One batch of answers for both methods: each row is the single ``Equilibrium``, or says why there is none."""

import copy
import dataclasses
import pickle
from collections.abc import Iterator

import numpy as np
import pytest
from sample_problems import garage_crane
from scipy.spatial.transform import Rotation

import cdpr_sim as cdpr
from cdpr_sim.core.cable import Cabling
from cdpr_sim.core.pose import Pose
from cdpr_sim.core.robot_batch import RobotBatch
from cdpr_sim.design.constraints import ALL_TAUT
from cdpr_sim.design.layout_equilibria import Cases, solve_layouts
from cdpr_sim.statics.forces import equilibrium_at
from cdpr_sim.statics.profiles import profiles

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


@pytest.fixture(scope="module", params=METHODS)
def batch(request, catalogue) -> cdpr.EquilibriumBatch:
    _, many, _ = METHODS[request.param]
    return many(catalogue["parallel"], [TILTED, FREE, PUSHED], external_wrench=WRENCHES)


def test_a_row_is_the_equilibrium_of_its_problem_alone(batch):
    """Indexing gives an ``Equilibrium``: that of the single call, in all that it says of itself."""
    one, _, _ = METHODS[batch.source]
    assert (len(batch), batch.shape, batch.converged.all()) == (3, (3,), True)
    for row, equilibrium in enumerate(batch):
        alone = one(batch.robot, (TILTED, FREE, PUSHED)[row], external_wrench=WRENCHES[row])
        assert isinstance(equilibrium, cdpr.Equilibrium)
        assert (equilibrium.source, equilibrium.iterations) == (alone.source, alone.iterations)
        np.testing.assert_allclose(equilibrium.pose.as_matrix(), alone.pose.as_matrix(), rtol=0, atol=SAME)
        np.testing.assert_allclose(equilibrium.tensions, alone.tensions, rtol=0, atol=1e-8)  # EA/l0 times SAME
        np.testing.assert_allclose(equilibrium.lengths, alone.lengths, rtol=0, atol=SAME)
        np.testing.assert_allclose(equilibrium.rest_lengths, alone.rest_lengths, rtol=SAME)
        np.testing.assert_allclose(equilibrium.eigenvalues, alone.eigenvalues, rtol=1e-9, atol=1e-6)
        assert equilibrium.residual <= 1e-8
        assert equilibrium.problem.same_as(alone.problem) or batch.source == "newton"  # there, to a rounding


def test_what_a_batch_says_of_itself_is_what_its_rows_say(batch):
    """tilt, euler, deviation, slack, stability, eigenvalues, rest lengths and poses: written once, equal everywhere."""
    for row, one in enumerate(batch):
        np.testing.assert_allclose(batch.tilt[row], one.tilt, rtol=0, atol=SAME)
        np.testing.assert_allclose(batch.euler[row], one.euler, rtol=0, atol=SAME)
        np.testing.assert_allclose(batch.deviation[row], one.deviation, rtol=0, atol=SAME)
        np.testing.assert_allclose(batch.poses[row].as_matrix(), one.pose.as_matrix(), rtol=0, atol=SAME)
        np.testing.assert_array_equal(batch.slack[row], one.slack)
        np.testing.assert_array_equal(batch.eigenvalues[row], one.eigenvalues)
        np.testing.assert_array_equal(batch.rest_lengths[row], one.rest_lengths)
        np.testing.assert_array_equal(batch.commanded[row].translation, one.problem.pose.translation)
        assert batch.stability[row] is one.stability
        assert batch.stable[row] == one.stable
        assert one.tilt == pytest.approx(np.arccos(one.rotation.as_matrix()[2, 2]), abs=1e-7)
        np.testing.assert_allclose(
            Rotation.from_euler("xyz", batch.euler[row]).as_matrix(), one.rotation.as_matrix(), atol=SAME
        )
    stable, neutral = cdpr.Stability.STABLE, cdpr.Stability.NEUTRAL
    assert batch.stability.tolist() == [stable, neutral, stable]
    assert batch.slack.sum(1).tolist()[0] == 4


def test_the_two_methods_say_the_same_row_by_row(catalogue):
    """The same type with the same fields; and for the same problems the same ``Status``, good or bad."""
    level = (0, 0, 0)
    poses = [(*TILTED, *level), (np.nan, 0.25, 0.1, *level), (0.4, 0.25, 2.0, *level), (0.4, 0.25, 0.1, np.inf, 0, 0)]
    solved, settled = (many(catalogue["parallel"], poses) for _, many, _ in METHODS.values())
    assert type(solved) is type(settled) is cdpr.EquilibriumBatch
    words = [cdpr.Status.CONVERGED, cdpr.Status.NOT_FINITE, cdpr.Status.FALLS, cdpr.Status.NOT_FINITE]
    for equilibria in (solved, settled):
        assert [cdpr.Status(int(status)) for status in equilibria.status] == words
        assert equilibria.converged.tolist() == [True, False, False, False]
        assert np.isnan(equilibria.residuals[1:]).all()
        for name in ("tilt", "euler", "deviation", "stability", "slack", "eigenvalues", "rest_lengths"):
            assert len(getattr(equilibria, name)) == 4, name
        assert len(equilibria.poses) == 4
        for row in (1, 2, 3):
            assert np.isnan(equilibria.poses[row].translation).all()
            assert np.isnan(equilibria.tensions[row]).all()
        assert not equilibria.stable[1:].any()
    np.testing.assert_allclose(solved.positions[0], settled.positions[0], atol=1e-6)


@pytest.mark.parametrize("source", METHODS)
def test_a_row_without_a_rest_raises_and_says_why(catalogue, source):
    """The status in words, and no equilibrium; the others are there; ``point`` gives the row as it is."""
    _, many, error = METHODS[source]
    equilibria = many(catalogue["parallel"], [(np.nan, 0.25, 0.1), TILTED, (0.4, 0.25, 2.0)])
    for row, status in ((0, cdpr.Status.NOT_FINITE), (2, cdpr.Status.FALLS)):
        with pytest.raises(error, match=f"parallel: .*{status.sentence}") as caught:
            equilibria[row]
        assert np.isnan(caught.value.equilibrium.residual)
        assert np.isnan(equilibria.point(row).position).any()
    assert equilibria[1].residual < 1e-8
    with pytest.raises(error):
        list(equilibria)


@pytest.mark.parametrize("source", METHODS)
def test_spun_up_row_raises_and_carries_the_best_point(catalogue, source):
    """A torque that nothing resists: the reason names it, and the point is no equilibrium."""
    one, many, error = METHODS[source]
    equilibria = many(catalogue["parallel"], [PUSHED, PUSHED], external_wrench=[[0] * 6, [0, 0, 0, 0, 0, 50.0]])
    assert equilibria.converged.tolist() == [True, False]
    best = equilibria.point(1)
    np.testing.assert_allclose(equilibria.poses[1].translation, equilibria.positions[1], rtol=0, atol=SAME)
    np.testing.assert_array_equal(
        equilibria.point(1).pose.as_matrix(), best.pose.as_matrix()
    )  # whatever was asked before
    for ask in (lambda: equilibria[1], lambda: one(equilibria.problems[1])):
        with pytest.raises(
            error, match="under a torque with a constant direction in space there may be no equilibrium"
        ) as said:
            ask()
        assert cdpr.Status(int(equilibria.status[1])).sentence in str(said.value)
        assert said.value.reason == str(said.value)
        assert said.value.equilibrium.source == source
        assert not said.value.equilibrium.residual <= 1e-6 * equilibria.problems[1].load


def test_a_grid_of_problems_is_a_grid_of_answers(catalogue):
    """Statics takes any shape; an index of as many numbers gives the one."""
    robot = catalogue["parallel"]
    many = cdpr.solve_many(robot, np.array([TILTED, PUSHED])[:, None], axial_stiffness=[[1e3], [1e4], [1e5]])
    assert (many.shape, many.tensions.shape, many.eigenvalues.shape, many.tilt.shape) == (
        (2, 3), (2, 3, 8), (2, 3, 6), (2, 3),
    )  # fmt: skip
    alone = cdpr.solve(robot.replace(axial_stiffness=1e5), TILTED)
    one = many[0, 2]
    np.testing.assert_allclose(one.position, alone.position, rtol=0, atol=SAME)
    np.testing.assert_allclose(many.eigenvalues[0, 2], alone.eigenvalues, rtol=1e-9)
    assert (one.problem.robot.axial_stiffness == 1e5).all()
    assert many.stability[0, 2] is one.stability
    with pytest.raises(cdpr.InvalidInput, match=r"found problems of shape \(2, 3\), expected rows"):
        cdpr.settle_many(many.problems)


def test_a_trajectory_is_a_batch_with_times(catalogue):
    """Every state says of itself what a rest does, but is on its way: ``MOVING``, and no equilibrium."""
    robot = catalogue["parallel"]
    rest, motion = cdpr.settle_trajectory(robot, TILTED)
    assert isinstance(motion, cdpr.EquilibriumBatch)
    assert isinstance(motion, cdpr.Trajectory)
    assert motion.times.shape == motion.shape == motion.tilt.shape == (len(motion),)
    assert set(motion.status) == {cdpr.Status.MOVING}
    assert not motion.converged.any()
    assert np.isnan(motion.residuals).all()
    assert np.isnan(motion.eigenvalues).all()
    with pytest.raises(cdpr.NotSettled, match="the platform is moving"):
        motion[-1]
    last = motion.point(-1)
    np.testing.assert_array_equal(last.pose.as_matrix(), rest.pose.as_matrix())
    np.testing.assert_array_equal(motion.slack[-1], rest.slack)
    assert motion.tilt[-1] == pytest.approx(rest.tilt, abs=SAME)
    np.testing.assert_allclose(motion.euler[-1], rest.euler, atol=SAME)
    np.testing.assert_allclose(motion.deviation[-1], rest.deviation, atol=SAME)
    np.testing.assert_array_equal(motion.commanded[0].translation, TILTED)
    # The statics of its commands is a batch again, and may be asked of them as they are.
    static = cdpr.solve_trajectory(motion)
    assert static.problems is motion.problems
    np.testing.assert_allclose(static[-1].position, rest.position, atol=1e-6)


def arrays_in(value: object, path: str = "") -> Iterator[tuple[str, np.ndarray]]:
    """All arrays in a value of this package and in the values that it holds, by their names."""
    if isinstance(value, np.ndarray):
        yield path, value
    elif isinstance(value, (cdpr.Robot, cdpr.Problem, cdpr.Problems, cdpr.Equilibrium, cdpr.EquilibriumBatch, Cabling)):
        for field in dataclasses.fields(value):
            if not field.name.startswith("_"):
                yield from arrays_in(getattr(value, field.name), f"{path}.{field.name}")


@pytest.mark.parametrize(
    "make",
    [
        lambda robot: robot,
        lambda robot: robot.cabling,
        lambda robot: cdpr.Problem.of(robot, TILTED),
        lambda robot: cdpr.Problems.of(robot, [TILTED, PUSHED]),
        lambda robot: cdpr.solve(robot, TILTED),
        lambda robot: cdpr.solve_many(robot, [TILTED, PUSHED]),
        lambda robot: cdpr.settle_many(robot, [TILTED, PUSHED]),
        lambda robot: cdpr.settle_trajectory(robot, TILTED)[1],
    ],
    ids=["robot", "cabling", "problem", "problems", "equilibrium", "solved", "settled", "trajectory"],
)
def test_values_are_frozen_and_so_are_their_copies(catalogue, make):
    """MuJoCo's model of a robot is kept: an array that could be written would be answered with the old one."""
    original = make(catalogue["parallel"])
    arrays = dict(arrays_in(original))
    assert len(arrays) > 1
    for other in (original, pickle.loads(pickle.dumps(original)), copy.deepcopy(original)):
        same = dict(arrays_in(other))
        assert same.keys() == arrays.keys()
        for name, array in same.items():
            np.testing.assert_array_equal(array, arrays[name])
            assert not array.flags.writeable, name


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
    np.testing.assert_array_equal(found.slack[0], slack)
    by_weight = (found.lengths <= found.rest_lengths) & (found.tensions <= robot.cable_weights * found.rest_lengths)
    assert by_weight.sum() == 2


@pytest.mark.parametrize("rest_length", [1.050, 1.052])
def test_a_level_cable_is_slack_from_a_seventh_of_its_span_of_sag_on(rest_length):
    """Under its own weight at both ends it leaves them at 30°, so it sags by (2/sqrt 3 - 1)/ln 3 and is 1.0510 long.

    Irvine, Cable Structures, 1981, chapter 1; the length is the tangent, 1/sqrt 3, over its arsinh, ln(3)/2.
    """
    robot = cdpr.Robot(
        [[0, 0, 1]], [[0, 0, 0]], 1e9, 1.0, linear_density=1.0, gravity=10.0, platform_size=(0.1, 0.1, 0.1)
    )
    there = Pose(np.array([1.0, 0, 1]), np.eye(3))
    one = equilibrium_at(cdpr.Problem.of(robot, there, [rest_length]), there, iterations=0, source="newton")
    assert one.slack[0] == (rest_length > 2 / np.sqrt(3) / np.log(3))
    weights = robot.cable_weights
    curve = profiles(robot, robot.exits, there.position[None], one.rest_lengths, robot.axial_stiffness, weights, 101)
    sag = np.ptp(curve[..., 2])
    assert sag == pytest.approx((2 / np.sqrt(3) - 1) / np.log(3), abs=2e-3)
    assert one.slack[0] == (sag > (2 / np.sqrt(3) - 1) / np.log(3))


@pytest.mark.parametrize(
    ("to", "rest_length", "pulls", "slack"),
    [
        ((4.7, 0, 3), 4.7 * (1 + 6e-5), (50, 60), False),  # a shallow catenary of 3 N, longer than its path
        ((0, 0, 0), 3 * (1 - 2.2e-6), (0.3, 0.6), False),  # plumb, stretched, with 0.5 N below 1.9 N of its own
        ((0.5, 0, 3), 3.0, (0, 3), True),  # a hanging loop
    ],
    ids=["catenary", "plumb", "loop"],
)
def test_a_shallow_catenary_and_a_plumb_cable_are_taut_and_a_loop_is_slack(to, rest_length, pulls, slack):
    """Steel of 4 mm and a platform of 2 kg: neither length nor tension alone says it."""
    robot = cdpr.Robot([[0, 0, 3]], [[0, 0, 0]], 6.5e5, 2.0, linear_density=0.064, platform_size=(0.1, 0.1, 0.1))
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
        single = cdpr.solve(robot.replace(mass=mass), (1.2, 1.2, 1.0))
        np.testing.assert_array_equal(masses.slack[row, 0], single.slack)


def test_what_an_equilibrium_says_of_itself_is_in_degrees(catalogue):
    """26° at the end of the paper's line, and four cables slack."""
    assert "tilt 26.420°, 4 of 8 cables slack" in repr(cdpr.solve(catalogue["parallel"], TILTED))

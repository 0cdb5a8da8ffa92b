"""What both methods are asked: once, or many times, checked as a whole before anything computes."""

import inspect

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

import cdpr_sim as cdpr
from cdpr_sim.core.robot_batch import RobotBatch

POSE = (0.3, 0.25, 0.1)

SINGLE = ("solve", "settle", "settle_trajectory", "sensitivity", "natural_modes", "find_equilibria", "follow_load")
"""Functions that are asked one question, all alike."""

MANY = ("solve_many", "settle_many")
"""Functions that are asked many."""


@pytest.fixture
def parallel(catalogue) -> cdpr.Robot:
    return catalogue["parallel"]


# --- one ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("keywords", "words"),
    [
        (dict(pose=None), r"pose: found none, expected \(x, y, z\), a six-vector or a RigidTransform"),
        (dict(rest_lengths=[1, 1]), r"rest_lengths: .*expected shape \(8,\)"),
        (dict(rest_lengths=[1] * 7 + [0]), "rest_lengths: found 0 m, expected more than 0"),
        (dict(external_wrench=[1, 2, 3]), r"external_wrench: .*expected shape \(6,\)"),
        (dict(external_wrench=[0, 0, np.inf, 0, 0, 0]), "external_wrench: found inf"),
    ],
)
def test_bad_problem_is_refused(parallel, keywords, words):
    """Poses, rest lengths and wrenches are checked before any solver sees them."""
    with pytest.raises(cdpr.InvalidInput, match=words):
        cdpr.Problem.of(**(dict(robot=parallel, pose=POSE) | keywords))


def test_what_is_no_robot_is_refused():
    """A name is not a robot, neither once nor many times."""
    with pytest.raises(cdpr.InvalidInput, match="robot: found 'parallel', expected a Robot or a Problem"):
        cdpr.Problem.of("parallel", POSE)  # type: ignore[arg-type]
    with pytest.raises(cdpr.InvalidInput, match="robot: found 'parallel', expected a Robot or Problems"):
        cdpr.Problems.of("parallel", [POSE])  # type: ignore[arg-type]


def test_planar_robot_refuses_a_wrench_out_of_its_plane():
    """What the plane would carry is not ignored in silence."""
    with pytest.raises(cdpr.InvalidInput, match=r"external_wrench: .*planar"):
        cdpr.Problem.of(cdpr.load_robot("two-cable"), (0.4, 0, 0.2), external_wrench=[0, 1, 0, 0, 0, 0])


def test_robot_that_no_cable_holds_falls(parallel):
    """Commanded above all its exits, a platform falls: cables cannot push."""
    with pytest.raises(cdpr.InvalidInput, match="falls since cables cannot push"):
        cdpr.Problem.of(parallel, (0.4, 0.25, 2.0))
    lifted = [0, 0, 20, 0, 0, 0]
    assert cdpr.Problem.of(parallel, (0.4, 0.25, 2.0), external_wrench=lifted).pose.translation[2] == 2.0


def test_a_problem_that_is_ready_is_asked_as_it_is(parallel):
    """Both methods take a ``Problem`` for (robot, pose, ...), and answer as if its parts had been given."""
    lengths, wrench = 1.01 * parallel.rest_lengths(POSE), [0, 0.1, 0, 0, 0, 1e-3]
    problem = cdpr.Problem.of(parallel, POSE, lengths, wrench)
    assert cdpr.Problem.of(problem) is problem
    for method in (cdpr.solve, cdpr.settle):
        ready, parts = method(problem), method(parallel, POSE, lengths, external_wrench=wrench)
        assert ready.problem is problem
        np.testing.assert_array_equal(ready.pose.as_matrix(), parts.pose.as_matrix())
        np.testing.assert_array_equal(ready.tensions, parts.tensions)


@pytest.mark.parametrize("name", SINGLE)
@pytest.mark.parametrize("beside", ["pose", "rest_lengths", "external_wrench"])
def test_a_problem_takes_nothing_beside_it(parallel, name, beside):
    """Two answers to one question are refused, not merged; neither does an equilibrium, where that is taken."""
    value = {"pose": POSE, "rest_lengths": parallel.rest_lengths(POSE), "external_wrench": np.zeros(6)}[beside]
    problem = cdpr.Problem.of(parallel, POSE)
    for ready in [problem, *([cdpr.solve(problem)] if name in ("sensitivity", "natural_modes") else [])]:
        with pytest.raises(cdpr.InvalidInput, match=f"{beside}: found one beside a Problem"):
            getattr(cdpr, name)(ready, **{beside: value})


def test_sensitivity_and_modes_of_an_equilibrium_are_those_of_its_problem(parallel):
    """However they are asked for, with the same load."""
    wrench = [0.1, 0, 0, 0, 0, 0]
    problem = cdpr.Problem.of(parallel, POSE, external_wrench=wrench)
    for asked in (problem, cdpr.solve(problem)):
        by_pose = cdpr.sensitivity(parallel, POSE, external_wrench=wrench).pose["exits"]
        np.testing.assert_array_equal(cdpr.sensitivity(asked).pose["exits"], by_pose)
        frequencies = cdpr.natural_modes(parallel, POSE, external_wrench=wrench).frequencies
        np.testing.assert_array_equal(cdpr.natural_modes(asked).frequencies, frequencies)


def test_every_question_is_asked_alike():
    """(robot, pose, rest_lengths) in this order, and options by name alone, the external wrench first."""
    for name in SINGLE + MANY:
        parameters = list(inspect.signature(getattr(cdpr, name)).parameters.values())
        positional = [one.name for one in parameters if one.kind is not inspect.Parameter.KEYWORD_ONLY]
        options = [one.name for one in parameters if one.kind is inspect.Parameter.KEYWORD_ONLY]
        assert positional[1:] == ["poses" if name in MANY else "pose", "rest_lengths"], name
        assert options[0] == "external_wrench", name
    with pytest.raises(TypeError, match="positional"):
        cdpr.solve(cdpr.load_robot("cogiro"), POSE, None, None, "newton")  # type: ignore[misc]


# --- many ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("many", [getattr(cdpr, name) for name in MANY], ids=MANY)
def test_no_shape_of_the_stiffness_is_ambiguous(parallel, many):
    """8 poses and 8 values of EA on 8 cables: one per cable or one per pose? It has to be said; and then it counts."""
    poses, values = np.tile(POSE, (8, 1)), np.linspace(5e3, 2e4, 8)
    with pytest.raises(cdpr.InvalidInput, match=r"axial_stiffness: found \(8,\), which could be one per cable or one"):
        many(parallel, poses, axial_stiffness=values)
    per_cable = many(parallel, poses, axial_stiffness=values[None])
    per_pose = many(parallel, poses, axial_stiffness=values[:, None])
    for row in (0, 7):
        alone = cdpr.solve(parallel.replace(axial_stiffness=values), POSE)
        np.testing.assert_allclose(per_cable.positions[row], alone.position, atol=1e-8)
        alone = cdpr.solve(parallel.replace(axial_stiffness=values[row]), POSE)
        np.testing.assert_allclose(per_pose.positions[row], alone.position, atol=1e-8)
    assert np.ptp(per_pose.positions[:, 2]) > 1e-5


@pytest.mark.parametrize(
    "batch",
    [
        dict(poses=np.tile(POSE, (5, 8, 1))),
        dict(external_wrench=np.zeros((8, 6))),
        dict(rest_lengths=np.ones((8, 8))),
        dict(rotations=np.tile(np.eye(3), (8, 1, 1))),
        dict(mass=np.full(8, 0.4)),
    ],
    ids=lambda batch: next(iter(batch)),
)
def test_wherever_the_eight_rows_come_from_a_stiffness_of_eight_is_refused(parallel, batch):
    """One per cable or one per row: whatever it is that makes eight rows."""
    with pytest.raises(cdpr.InvalidInput, match=r"axial_stiffness: found \(8,\), which could be"):
        cdpr.Problems.of(parallel, **(dict(poses=POSE) | batch), axial_stiffness=np.full(8, 1e4))


def test_stiffness_that_can_mean_one_thing_only_is_taken(parallel):
    """A number; one per cable, where there are not as many poses; per pose in a column; rows of cables."""
    per_cable = np.linspace(5e3, 2e4, 8)
    for poses, given, expected in [
        ([POSE] * 3, 2e3, np.full((3, 8), 2e3)),
        ([POSE] * 3, per_cable, np.tile(per_cable, (3, 1))),
        ([POSE] * 8, np.arange(1, 9)[:, None], np.repeat(np.arange(1, 9), 8).reshape(8, 8)),
        ([POSE] * 8, np.arange(1, 65).reshape(8, 8), np.arange(1, 65).reshape(8, 8)),
    ]:
        problems = cdpr.Problems.of(parallel, poses, axial_stiffness=given)
        np.testing.assert_array_equal([problem.axial_stiffness for problem in problems], expected)
    with pytest.raises(cdpr.InvalidInput, match=r"axial_stiffness: found an array of shape \(3,\), expected"):
        cdpr.Problems.of(parallel, [POSE] * 3, axial_stiffness=[1e3, 1e4, 1e5])


@pytest.mark.parametrize("many", [getattr(cdpr, name) for name in MANY], ids=MANY)
@pytest.mark.parametrize("pose", [(0.4, 0.1, 0.2), (0.4, 0, 0.2, 0.1, 0, 0), (0.4, 0, 0.2, 0, 0, 0.1)])
def test_many_refuse_a_planar_robot_out_of_its_plane(catalogue, many, pose):
    """As ``solve`` does, wherever in the batch the pose is; by numbers, by transforms, and by rotation matrices."""
    robot, well = catalogue["two-cable"], np.array([0.4, 0, 0.2, 0, 0.1, 0])
    six = np.append(pose, [0, 0, 0])[:6]
    stack = RigidTransform.from_components([well[:3], six[:3]], Rotation.from_euler("xyz", [well[3:], six[3:]]))
    matrices = stack.rotation.as_matrix()
    for poses, options in [([well, six], {}), (stack, {}), (stack.translation, {"rotations": matrices})]:
        with pytest.raises(cdpr.InvalidInput, match="'two-cable' is planar: expected y = 0 and"):
            many(robot, poses, **options)
    assert many(robot, [well]).converged.all()


@pytest.mark.parametrize(
    ("asked", "words"),
    [
        (dict(poses=None), "poses: found none"),
        (dict(poses=np.empty((0, 3))), "poses: found none"),
        (dict(poses=[0.3, 0.25]), r"poses: found an array of shape \(2,\), expected \(..., 3\) or \(..., 6\)"),
        (dict(poses="up"), "poses: found 'up'"),
        (dict(rest_lengths=np.ones((3, 8))), r"do not fit one another: poses \(2,\), rest_lengths \(3,\)"),
        (dict(rest_lengths=[0.0] + [1.0] * 7), "rest_lengths: found 0 m, expected more than 0"),
        (dict(rest_lengths=np.ones((2, 5))), r"rest_lengths: found an array of shape \(2, 5\), expected \(..., 8\)"),
        (dict(external_wrench=[0, 0, 1.0]), r"external_wrench: found an array of shape \(3,\), expected \(..., 6\)"),
        (dict(axial_stiffness=-1.0), "axial_stiffness: found -1 N, expected more than 0"),
        (dict(mass=[0.4, 0.0]), "mass: found 0 kg, expected more than 0"),
        (dict(mass=[0.4] * 3), r"do not fit one another: poses \(2,\), .*mass \(3,\)"),
        (dict(external_wrench=np.zeros((3, 6))), r"do not fit one another: poses \(2,\), .*external_wrench \(3,\)"),
        (dict(rotations=2 * np.eye(3)), "rotations: found a matrix that is no rotation"),
        (dict(rotations=[np.eye(3), np.diag([1, 1, -1])]), r"no rotation at \[1\], expected orthogonal ones"),
        (dict(rotations=np.ones(3)), r"rotations: found an array of shape \(3,\)"),
        (dict(poses=RigidTransform.identity(2), rotations=np.eye(3)), "rotations: found them beside transforms"),
    ],
)
def test_bad_problems_are_refused_as_a_whole(parallel, asked, words):
    """The message names the argument, what was found and what is expected."""
    with pytest.raises(cdpr.InvalidInput, match=words):
        cdpr.Problems.of(**(dict(robot=parallel, poses=[POSE, POSE]) | asked))


def test_problems_that_are_ready_are_asked_as_they_are(parallel):
    """Both methods take ``Problems``, and refuse whatever stands beside them."""
    problems = cdpr.Problems.of(parallel, [POSE, (0.4, 0.2, 0.2)])
    for many in (cdpr.solve_many, cdpr.settle_many):
        assert many(problems).problems is problems
        for name in ("poses", "rest_lengths", "external_wrench", "rotations", "axial_stiffness"):
            with pytest.raises(cdpr.InvalidInput, match=f"{name}: found it beside Problems"):
                many(problems, **{name: 1.0})


def test_a_row_is_the_problem_asked_alone(parallel):
    """Numbers, transforms and matrices broadcast: each row is the ``Problem`` of its own parts, to the last bit."""
    poses = np.array([(*POSE, 0, 0, 0), (0.2, 0.2, 0.15, 0.1, -0.2, 0.3), (0.5, 0.3, 0.3, 0, 0, 1.0)])
    stack = RigidTransform.concatenate([parallel.pose(pose) for pose in poses])
    wrenches = np.random.default_rng(0).normal(size=(3, 6))
    matrices = stack.rotation.as_matrix()
    asked = [(poses, {}), (stack, {}), (list(poses), {}), (list(stack), {}), (poses[:, :3], {"rotations": matrices})]
    for many, options in asked:
        problems = cdpr.Problems.of(parallel, many, external_wrench=wrenches, **options)
        assert (len(problems), problems.shape) == (3, (3,))
        assert problems.finite.all()
        for row, problem in enumerate(problems):
            alone = cdpr.Problem.of(parallel, poses[row], external_wrench=wrenches[row])
            np.testing.assert_array_equal(problem.pose.as_matrix()[:3, 3], poses[row, :3])
            np.testing.assert_allclose(problem.pose.as_matrix(), alone.pose.as_matrix(), rtol=0, atol=1e-15)
            np.testing.assert_allclose(problem.rest_lengths, alone.rest_lengths, rtol=1e-15)
            np.testing.assert_array_equal(problem.external_wrench, wrenches[row])
            assert problem.robot is parallel
            assert problems.load[row] == pytest.approx(alone.load, rel=1e-15)


def test_stiffness_and_mass_of_a_row_are_those_of_its_robot(parallel):
    """A row with a stiffness or a mass of its own is a problem of a changed copy of the robot."""
    problems = cdpr.Problems.of(parallel, POSE, axial_stiffness=[[1e3], [1e4]], mass=np.array([[0.2], [0.4], [0.8]]))
    assert problems.shape == (3, 2)
    soft = problems[2, 0]
    assert (soft.robot.axial_stiffness == 1e3).all()
    assert (soft.mass, problems[1, 1].robot) == (0.8, parallel)
    np.testing.assert_allclose(soft.robot.inertia, 2 * parallel.inertia)
    np.testing.assert_array_equal(problems.load, parallel.gravity * np.array([[0.2], [0.4], [0.8]]))


def test_a_row_has_one_index_for_each_axis(parallel):
    """Of problems and of equilibria; with another number of indices the row is refused."""
    problems = cdpr.Problems.of(parallel, POSE, axial_stiffness=[[1e3], [1e4]], mass=[[0.2], [0.4], [0.8]])
    for rows in (problems, cdpr.solve_many(problems)):
        for row in (0, (0, 1, 0), ()):
            with pytest.raises(cdpr.InvalidInput, match=r"row: found .* of shape \(3, 2\), expected 2 indices"):
                rows[row]


def test_problems_of_several_robots_are_each_robots_own_or_refused(parallel):
    """A row has its robot; what knows one robot only refuses them, also those that have been solved."""
    robots = [parallel, parallel.replace(exits=parallel.exits + np.array([0.02, 0, 0]))]
    places = np.array([POSE, (0.4, 0.25, 0.1)])
    problems = cdpr.Problems.of_robots(
        RobotBatch.of(robots), places, np.array([np.eye(3)] * 2), np.zeros((2, 6)), np.ones(2)
    )
    equilibria = cdpr.solve_many(problems)
    for row, robot in enumerate(robots):
        for column, place in enumerate(places):
            alone = cdpr.solve(robot, place)
            np.testing.assert_array_equal(problems[row, column].robot.exits, robot.exits)
            np.testing.assert_allclose(equilibria.positions[row, column], alone.pose.translation, rtol=0, atol=1e-9)
    for question in (cdpr.cable_profiles, cdpr.clearances):
        with pytest.raises(cdpr.InvalidInput, match="equilibria: found those of several robots, expected of one"):
            question(equilibria)


def test_problems_of_different_robots_are_not_stacked(parallel):
    """They would all be solved with the first one's cables; an equal copy of a robot is the same one."""
    problem, other = (cdpr.Problem.of(robot, POSE) for robot in (parallel, parallel.replace(axial_stiffness=1e3)))
    copied = cdpr.Problem.of(parallel.replace(), POSE)
    assert len(cdpr.Problems.stack([problem, copied])) == 2
    with pytest.raises(
        cdpr.InvalidInput, match="problems: found another robot in row 1, expected problems of one robot"
    ):
        cdpr.Problems.stack([problem, other])


def test_rows_that_cannot_be_asked_say_so(parallel):
    """One that is not finite, and one above all exits, which is well if it is pulled up or has its rest lengths."""
    poses = [POSE, (np.nan, 0.25, 0.1), (0.4, 0.25, 2.0)]
    problems = cdpr.Problems.of(parallel, poses)
    assert problems.finite.tolist() == [True, False, True]
    assert problems.falls.tolist() == [False, False, True]
    assert not cdpr.Problems.of(parallel, poses, external_wrench=[0, 0, 20, 0, 0, 0]).falls.any()
    assert not cdpr.Problems.of(parallel, poses, parallel.rest_lengths(POSE)).falls.any()
    taken = problems.take(np.array([2, 0]))
    assert (taken.shape, taken.falls.tolist()) == ((2,), [True, False])
    np.testing.assert_array_equal(taken.positions, np.array(poses)[[2, 0]])

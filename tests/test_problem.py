"""What both methods are asked: once, or many times; refusals are in ``test_refusals_statics.py``."""

import inspect

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform

import cdpr_sim as cdpr

POSE = (0.3, 0.25, 0.1)

SINGLE = ("solve", "settle", "settle_trajectory", "sensitivity", "natural_modes", "find_equilibria", "follow_load")
MANY = ("solve_many", "settle_many")


@pytest.fixture
def parallel(catalogue) -> cdpr.Robot:
    return catalogue["parallel"]


def test_a_platform_above_all_exits_is_a_problem_if_something_pulls_it_up(parallel):
    """Cables cannot push; rows of a batch say it of themselves."""
    poses, lifted = [POSE, (np.nan, 0.25, 0.1), (0.4, 0.25, 2.0)], [0, 0, 20, 0, 0, 0]
    assert cdpr.Problem.of(parallel, poses[2], external_wrench=lifted).pose.translation[2] == 2.0
    problems = cdpr.Problems.of(parallel, poses)
    assert problems.finite.tolist() == [True, False, True]
    assert problems.falls.tolist() == [False, False, True]
    assert not cdpr.Problems.of(parallel, poses, external_wrench=lifted).falls.any()
    assert not cdpr.Problems.of(parallel, poses, parallel.rest_lengths(POSE)).falls.any()
    taken = problems.take(np.array([2, 0]))
    assert (taken.shape, taken.falls.tolist()) == ((2,), [True, False])
    np.testing.assert_array_equal(taken.positions, np.array(poses)[[2, 0]])


QUESTIONS = {
    "solve": lambda *ask, **more: cdpr.solve(*ask, **more).position,
    "settle": lambda *ask, **more: cdpr.settle(*ask, **more).position,
    "settle_trajectory": lambda *ask, **more: cdpr.settle_trajectory(*ask, **more)[1].positions,
    "sensitivity": lambda *ask, **more: cdpr.sensitivity(*ask, **more).pose["exits"],
    "natural_modes": lambda *ask, **more: cdpr.natural_modes(*ask, **more).frequencies,
    "find_equilibria": lambda *ask, **more: cdpr.find_equilibria(*ask, starts=20, **more)[0].position,
    "compensate": lambda *ask, **more: cdpr.compensate(*ask, **more).rest_lengths,
    "follow_load": lambda *ask, **more: cdpr.follow_load(*ask, **more).reached.position,
    "grow_gravity": lambda *ask, **more: cdpr.grow_gravity(*ask, seconds=0.2).position,
}


@pytest.mark.parametrize("name", QUESTIONS)
def test_a_problem_is_asked_as_its_parts(catalogue, name):
    """A ``Problem``, or what it is made of: the same answer to the last bit; of an equilibrium, where one is taken."""
    robot, pose = catalogue["planar-vertical"], (0.25, 0, 0.1)
    load = {} if name == "grow_gravity" else {"external_wrench": [0.1, 0, 0, 0, 0, 0]}
    problem, ask = cdpr.Problem.of(robot, pose, **load), QUESTIONS[name]
    assert cdpr.Problem.of(problem) is problem
    found = ask(problem)
    np.testing.assert_array_equal(ask(robot, [*pose, 0, 0, 0], **load), found)
    if name in ("sensitivity", "natural_modes"):
        np.testing.assert_array_equal(ask(cdpr.solve(problem)), found)
    if name in ("solve", "settle"):
        given = cdpr.Problem.of(robot, pose, 1.01 * problem.rest_lengths)
        np.testing.assert_array_equal(ask(given), ask(robot, pose, given.rest_lengths))
        assert getattr(cdpr, name)(given).problem is given


def test_every_question_is_asked_alike():
    """(robot, pose, rest_lengths) in this order, and options by name alone, the external wrench first."""
    for name in SINGLE + MANY:
        parameters = list(inspect.signature(getattr(cdpr, name)).parameters.values())
        positional = [one.name for one in parameters if one.kind is not inspect.Parameter.KEYWORD_ONLY]
        options = [one.name for one in parameters if one.kind is inspect.Parameter.KEYWORD_ONLY]
        assert positional[1:] == ["poses" if name in MANY else "pose", "rest_lengths"], name
        assert options[0] == "external_wrench", name


def test_problems_that_are_ready_are_asked_as_they_are(parallel):
    """By both methods; an equal copy of a robot is the same robot."""
    problems = cdpr.Problems.of(parallel, [POSE, (0.4, 0.2, 0.2)])
    for many in (cdpr.solve_many, cdpr.settle_many):
        assert many(problems).problems is problems
    one, copied = cdpr.Problem.of(parallel, POSE), cdpr.Problem.of(parallel.replace(), POSE)
    assert len(cdpr.Problems.stack([one, copied])) == 2


def test_stiffness_that_can_mean_one_thing_only_is_taken(parallel):
    """A number; one per cable, where there are not as many poses; per pose in a column; rows of cables."""
    per_cable = np.linspace(5e3, 2e4, 8)
    for rows, given, expected in [
        (3, 2e3, np.full((3, 8), 2e3)),
        (3, per_cable, np.tile(per_cable, (3, 1))),
        (8, per_cable[None], np.tile(per_cable, (8, 1))),
        (8, np.arange(1, 9)[:, None], np.repeat(np.arange(1, 9), 8).reshape(8, 8)),
        (8, np.arange(1, 65).reshape(8, 8), np.arange(1, 65).reshape(8, 8)),
    ]:
        problems = cdpr.Problems.of(parallel, [POSE] * rows, axial_stiffness=given)
        np.testing.assert_array_equal([problem.axial_stiffness for problem in problems], expected)


def test_a_row_is_the_problem_asked_alone(parallel):
    """Numbers, transforms and matrices broadcast: each row is the ``Problem`` of its own parts, to the last bit."""
    poses = np.array([(*POSE, 0, 0, 0), (0.2, 0.2, 0.15, 0.1, -0.2, 0.3), (0.5, 0.3, 0.3, 0, 0, 1.0)])
    stack = RigidTransform.concatenate([parallel.pose(pose) for pose in poses])
    wrenches = np.random.default_rng(0).normal(size=(3, 6))
    matrices = stack.rotation.as_matrix()
    asked = [(poses, {}), (stack, {}), (list(poses), {}), (list(stack), {}), (poses[:, :3], {"rotations": matrices})]
    for many, options in asked:
        problems = cdpr.Problems.of(parallel, many, external_wrench=wrenches, **options)
        assert (len(problems), problems.shape, problems.finite.all()) == (3, (3,), True)
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

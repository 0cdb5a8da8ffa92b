"""Robots that shake: drawn tight by a hundred weights, tilted by a right angle, or with no weight at all."""

import itertools

import numpy as np
import pytest

import cdpr_sim as cdpr
from cdpr_sim.crosscheck.compare import Verdict, compare_many
from cdpr_sim.physics import dynamic_relaxation

CORNERS = np.array(list(itertools.product([-2, 2], [-1.5, 1.5], [0, 2])), dtype=float)
CUBE = np.array(list(itertools.product([-0.06, 0.06], repeat=3)))
STRAINS = (1e-4, 1e-3, 3e-3, 1e-2, 3e-2)
STIFFNESSES = (1e4, 1e5, 1e6)


def drawn_tight(number: int, stiffness: float) -> cdpr.Robot:
    """Like IPAnema: 25 kg, 0.12 m, eight cables to the corners of a room of 4 x 3 x 2 m, straight or crossed."""
    random = np.random.default_rng(number)
    anchors = CUBE * [1, 1, -1 if number % 2 else 1] + (number % 4 >= 2) * random.uniform(-0.02, 0.02, (8, 3))
    exits = CORNERS + (number >= 4) * random.uniform(-0.1, 0.1, (8, 3))
    return cdpr.Robot(exits, anchors, stiffness, 25.0, name=f"tight {number}")


def pretensioned(number: int, stiffness: float) -> cdpr.Problems:
    """In the middle and at two poses of the workspace, all cables shortened by each strain."""
    robot = drawn_tight(number, stiffness)
    poses = np.vstack([[0, 0, 1], np.random.default_rng(number).uniform([-1, -0.8, 0.6], [1, 0.8, 1.4], (2, 3))])
    rigid = np.array([robot.rest_lengths(pose) for pose in poses])
    lengths = np.concatenate([(1 - strain) * rigid for strain in STRAINS])
    return cdpr.Problems.of(robot, np.tile(poses, (len(STRAINS), 1)), lengths)


@pytest.mark.parametrize("stiffness", STIFFNESSES)
@pytest.mark.parametrize("number", [0, 3, 6])
def test_robots_drawn_tight_settle_where_statics_says(number, stiffness):
    """Up to 3 % of strain: tensions of a thousandth to a hundred weights each, all of them, within 1000 time steps."""
    problems = pretensioned(number, stiffness)
    settled, solved = cdpr.settle_many(problems), cdpr.solve_many(problems)
    assert settled.converged.all()
    assert solved.converged.all()
    verdicts = compare_many(solved, settled).verdicts
    assert Verdict.DISAGREE not in verdicts
    assert (
        set(verdicts) == {Verdict.AGREE} or stiffness == STIFFNESSES[0]
    )  # soft and hardly tight, a platform has several places to rest
    assert settled.iterations.max() < 5000


def test_with_the_pace_of_the_weight_they_do_not(monkeypatch):
    """Negative control: it takes the tensions' own pace and inertia, or Newton's method, to settle the tightest."""
    monkeypatch.setattr(dynamic_relaxation, "READY", 0.0)
    monkeypatch.setattr(dynamic_relaxation, "STRAINED", np.inf)
    monkeypatch.setattr(dynamic_relaxation, "RATTLES", 10**9)
    settled = cdpr.settle_many(pretensioned(1, 1e6).take(np.array([-1])))
    assert not settled.converged.any()


def test_a_planar_robot_given_as_spatial_settles_from_a_right_angle():
    """Four cables in the x-y plane, turned by 90°: hanging on soft cables it turns faster than it swings, by far."""
    exits = np.array(list(itertools.product([-3.94, 3.94], [-2.37, 2.37], [0])))
    anchors = np.array(list(itertools.product([-0.058, 0.058], [-0.058, 0.058], [0])))
    robot = cdpr.Robot(exits, anchors, 3700.0, 19.0, platform_size=(0.12, 0.12, 0.12), name="flat")
    pose, lengths = [-1.18, 0.51, 0, 0, np.pi / 2, -0.0176], [3.951, 3.301, 5.846, 5.424]
    settled = cdpr.settle(robot, pose, lengths)
    assert cdpr.compare(cdpr.solve(robot, settled.pose, lengths), settled).agrees


@pytest.mark.parametrize("plane", [(0, 2, 1), (0, 1, 2)], ids=["in x-z", "in x-y"])
@pytest.mark.parametrize("axis", range(3))
def test_tilted_planar_robots_settle_drawn_tight_or_not(plane, axis):
    """Four cables in a plane, hardly held across it, turned by 90° about each axis, soft and stiff, light and heavy."""
    exits = np.array(list(itertools.product([-2, 2], [-1.5, 1.5], [0])))[:, plane]
    anchors = np.array(list(itertools.product([-0.1, 0.1], [-0.06, 0.06], [0])))[:, plane]
    pose = np.zeros(6)
    pose[:2], pose[3 + axis] = (0.3, -0.2) if plane[1] == 1 else (0.3, 0), np.pi / 2
    for stiffness, mass in itertools.product([3e3, 3e5, 3e7], [1, 200]):
        robot = cdpr.Robot(exits, anchors, stiffness, mass, platform_size=(0.2, 0.2, 0.2), name="flat")
        lengths = np.array([1, 1 - 1e-4, 1 - 1e-2])[:, None] * robot.rest_lengths(pose)
        assert cdpr.settle_many(robot, [pose] * 3, lengths).converged.all()


def weightless() -> tuple[cdpr.Robot, np.ndarray, tuple[float, float, float]]:
    """A planar robot in a horizontal plane, its rest lengths, and a start beside its place of rest."""
    rows = [0, 1, 4, 5]
    exits, anchors = CORNERS[rows] * [1, 0, 1], CUBE[rows] * [1, 0, 1]
    robot = cdpr.Robot(exits, anchors, 1e5, 10.0, mobility="planar", gravity=0, name="weightless")
    return robot, 0.999 * robot.rest_lengths((0, 0, 1)), (0.01, 0, 0.98)


def test_without_load_the_methods_agree():
    """The measure of forces is then the cables' own, on each method by its own means."""
    robot, lengths, start = weightless()
    solved, settled = cdpr.solve(robot, start, lengths), cdpr.settle(robot, start, lengths)
    agreement = cdpr.compare(solved, settled)
    assert agreement.verdict is Verdict.AGREE, agreement.reasons
    equilibria = [method(robot, [start, (0, 0, 1)], lengths) for method in (cdpr.solve_many, cdpr.settle_many)]
    assert set(compare_many(*equilibria).verdicts) == {Verdict.AGREE}


def test_without_load_a_wrong_model_still_disagrees():
    """Negative control: a cable that is 1 % stiffer in MuJoCo."""
    import mujoco

    robot, lengths, start = weightless()
    model = mujoco.MjModel.from_xml_string(cdpr.to_mjcf(robot, start, lengths))
    model.tendon_stiffness[0] *= 1.01
    wrong = cdpr.settle(robot, start, lengths, model=model)
    assert cdpr.compare(cdpr.solve(robot, start, lengths), wrong).verdict is Verdict.DISAGREE


def test_a_robot_of_a_tenth_of_a_millimetre_settles():
    """What is only drawn is not rounded to nothing, which MuJoCo would refuse."""
    robot = cdpr.Robot(5e-5 * CORNERS, 5e-5 * CUBE, 100.0, 1e-2, pulley_radius=[2e-6] + 7 * [0])
    problem = cdpr.Problem.of(robot, (0, 0, 5e-5))
    assert np.linalg.norm(cdpr.settle(problem).position - cdpr.solve(problem).position) < 1e-8

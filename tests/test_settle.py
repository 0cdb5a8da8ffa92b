"""MuJoCo's platform comes to rest, and only there is it called settled."""

import concurrent.futures
import contextlib
import itertools
import os
import re
import signal

import mujoco
import numpy as np
import oracle
import pytest
from oracle import Rig, Ropes
from sample_problems import random_problem, random_robot
from scipy.spatial.transform import RigidTransform

import cdpr_sim as cdpr
from cdpr_sim.core.status import Status
from cdpr_sim.crosscheck.compare import Verdict, compare_many
from cdpr_sim.physics.settle import residual_of, residuals_of, settle_trajectory

FINISHED = 1e-9
"""[m], entries of a rotation, of EA. By motion or by Newton's method, a billionth of the load stays unbalanced at rest:
with a stiffness of one load per metre, that is 1e-9 m."""

POSE = (0.3, 0.25, 0.1)
MASS = {"linear_density": 5e-4}
WHEELS = {"pulley_radius": 0.01, "pulley_axis": (0, 0, -1), "stiffening": (3.0, 2.0)}


def unbalanced(problem: cdpr.Problem, pose: RigidTransform) -> float:
    """The largest component [N] of what the oracle leaves unbalanced, torques over the characteristic length."""
    rig = Rig.of(problem.robot)
    ropes, matrix = Ropes(rig, problem.rest_lengths), pose.rotation.as_matrix()
    found = oracle.balance(rig, pose.translation, matrix, ropes, problem.external_wrench)
    return float(np.abs(found.wrench / np.repeat([1.0, rig.size], 3))[list(rig.free)].max())


# --- where it comes to rest ----------------------------------------------------------------------------------------


def test_random_robots_settle_where_the_oracle_finds_balance_and_statics_agrees():
    """Whatever the cables, size and mass, pushed or not: 1 mm above, forces do not balance; MuJoCo's residual is that.

    Statics agrees, or each method confirms the other's own equilibrium: most platforms that are not pushed end alike.
    """
    unpushed = []
    for seed in range(20):
        robot, position, _ = random_robot(seed)
        for problem in (cdpr.Problem.of(robot, position), random_problem(seed)):
            rest, robot = cdpr.settle(problem), problem.robot
            lifted = RigidTransform.from_translation([0, 0, 1e-3]) * rest.pose
            assert unbalanced(problem, rest.pose) < 1e-7 * robot.weight, seed
            assert rest.stability is not cdpr.Stability.UNSTABLE, seed
            assert unbalanced(problem, lifted) > 1e-4 * robot.weight, seed
            many = residuals_of(cdpr.Problems.stack([problem] * 2), RigidTransform.concatenate([rest.pose, lifted]))
            alone = [residual_of(problem, pose) for pose in (rest.pose, lifted)]
            assert many[1] == pytest.approx(alone[1], rel=1e-12) == pytest.approx(unbalanced(problem, lifted), rel=1e-7)
            assert max(many[0], alone[0]) < 1e-7 * robot.weight
            found = cdpr.compare(cdpr.solve(problem), rest)
            assert found.verdict is not Verdict.DISAGREE, found.reasons
            unpushed += [found.agrees] if not problem.external_wrench.any() else []
    assert np.mean(unpushed) > 0.9
    assert len(unpushed) > 25


@pytest.mark.parametrize("aside", [0.0, 1e-5, 0.05])
def test_a_balanced_platform_is_not_called_settled_but_topples(aside):
    """Held below its centre of mass by one cable or two, forces balance level; it ends hanging down, beside or not."""
    one = cdpr.Robot([[0, 0, 1]], [[0, 0, -0.02]], 1e4, 1.0)
    assert cdpr.settle(one, [aside, 0, 0.5]).tilt == pytest.approx(np.pi, abs=1e-6)
    ends = [[-0.5, 0, 1], [0.5, 0, 1]], [[-0.01, 0, -0.05], [0.01, 0, -0.05]]
    two = cdpr.Robot(*ends, 1e4, 1.0, mobility="planar", name="top-heavy")
    rest = cdpr.settle(two, [aside, 0, 0.5])
    assert rest.stable
    assert rest.tilt > 1


@pytest.mark.parametrize(("name", "axial_stiffness"), [("cogiro", 1e4), ("parallel", 1e6)])
def test_rest_is_what_is_said_of_it(name, axial_stiffness):
    """A billionth of the weight is left over, also where forces were that small in passing, at some velocity."""
    robot = cdpr.load_robot(name).replace(axial_stiffness=axial_stiffness)
    equilibria = cdpr.settle_many(robot, np.random.default_rng(1).uniform(*robot.workspace, (1000, 3)))
    assert equilibria.converged.all()
    assert equilibria.residuals.max() <= 1e-9 * robot.weight


CORNERS = np.array(list(itertools.product([-2, 2], [-1.5, 1.5], [0, 2])), dtype=float)
CUBE = np.array(list(itertools.product([-0.06, 0.06], repeat=3)))


@pytest.mark.parametrize(("number", "stiffness"), [(0, 1e5), (3, 1e6), (6, 1e4)])
def test_robots_drawn_tight_settle_where_statics_says(number, stiffness):
    """25 kg on eight cables, straight or crossed, shortened by up to 3 %: tensions of a thousandth to 100 weights."""
    random = np.random.default_rng(number)
    anchors = CUBE * [1, 1, -1 if number % 2 else 1] + (number % 4 >= 2) * random.uniform(-0.02, 0.02, (8, 3))
    robot = cdpr.Robot(CORNERS + (number >= 4) * random.uniform(-0.1, 0.1, (8, 3)), anchors, stiffness, 25.0)
    poses = np.vstack([[0, 0, 1], random.uniform([-1, -0.8, 0.6], [1, 0.8, 1.4], (2, 3))])
    rigid = np.array([robot.rest_lengths(pose) for pose in poses])
    lengths = np.concatenate([(1 - strain) * rigid for strain in (1e-4, 1e-3, 3e-3, 1e-2, 3e-2)])
    problems = cdpr.Problems.of(robot, np.tile(poses, (5, 1)), lengths)
    settled, solved = cdpr.settle_many(problems), cdpr.solve_many(problems)
    assert settled.converged.all()
    verdicts = set(compare_many(solved, settled).verdicts)
    # Soft and hardly tight, a platform has several equilibria.
    assert verdicts == {Verdict.AGREE} or (stiffness == 1e4 and Verdict.DISAGREE not in verdicts)
    assert settled.iterations.max() < 5000


@pytest.mark.parametrize("plane", [(0, 2, 1), (0, 1, 2)], ids=["vertical", "horizontal"])
def test_a_planar_robot_given_as_spatial_settles_from_a_right_angle(plane):
    """Four cables in a plane, hardly held across it, turned about each axis; soft or stiff, light or heavy, tight."""
    exits = np.array(list(itertools.product([-2, 2], [-1.5, 1.5], [0])))[:, plane]
    anchors = np.array(list(itertools.product([-0.1, 0.1], [-0.06, 0.06], [0])))[:, plane]
    for axis, stiffness, mass in itertools.product(range(3), [3e3, 3e5, 3e7], [1, 200]):
        pose = np.array([0.3, -0.2 * (plane[1] == 1), 0, 0, 0, 0])
        pose[3 + axis] = np.pi / 2
        robot = cdpr.Robot(exits, anchors, stiffness, mass, platform_size=(0.2, 0.2, 0.2), name="flat")
        lengths = np.array([1, 1 - 1e-4, 1 - 1e-2])[:, None] * robot.rest_lengths(pose)
        assert cdpr.settle_many(robot, [pose] * 3, lengths).converged.all()


def test_a_platform_that_turns_faster_than_it_swings_settles():
    """Hanging on soft cables in a horizontal plane, turned by 90°: it found no rest."""
    square = np.array(list(itertools.product([-1, 1], [-1, 1], [0])))
    robot = cdpr.Robot(
        square * [3.94, 2.37, 0], 0.058 * square, 3700.0, 19.0, platform_size=(0.12, 0.12, 0.12), name="flat"
    )
    settled = cdpr.settle(robot, [-1.18, 0.51, 0, 0, np.pi / 2, -0.0176], [3.951, 3.301, 5.846, 5.424])
    assert cdpr.compare(cdpr.solve(robot, settled.pose, settled.rest_lengths), settled).agrees


SLACK_CHAIN = cdpr.Problem.of(
    cdpr.Robot(
        [[0, 0, 1], [0.3, 0, 1]], np.zeros((2, 3)), [1e3, 1e5], 1.0, stiffening=[(50, 0), (0, 0)],
        linear_density=[0, 1e-3], platform_size=(0.05, 0.05, 0.05), name="beside a slack cable",
    ), (0, 0, 0.3), [0.69, 5.0],
)  # fmt: skip
"""A mass on a cable with nonlinear elasticity, beside a slack one with mass."""


def test_five_metres_of_slack_cable_with_mass_hang_folded():
    """The platform rests where the tension of the other cable and half its weight do."""
    settled = cdpr.settle(SLACK_CHAIN)
    assert 9.81 < settled.tensions[0] < 9.81 * (1 + 5e-3)
    strain = settled.lengths[0] / 0.69 - 1
    assert settled.tensions[0] == pytest.approx(1e3 * (strain + 50 * strain**2), rel=1e-6)
    assert settled.iterations < 10_000


@pytest.mark.parametrize(("density", "size"), [(0.0, 0.05), (0.0, 0.01), (0.05, 0.05)])
def test_a_free_rotation_beside_stiff_directions_is_neutral(density, size):
    """Anchors on a line across the axes, far below the exits: the platform is free to rotate about that line."""
    line = size * np.array([1, 1, 0.3])
    exits, anchors = [[-11, -9, 10], [10, -10, 9], [9, 10, 11], [-10, 11, 10]], [-line, line, line, -line]
    robot = cdpr.Robot(exits, anchors, 1e4, 1.0, linear_density=density, platform_size=(size,) * 3, name="bar")
    settled = cdpr.settle(robot, (0, 0, 0))
    assert settled.stability is cdpr.Stability.NEUTRAL
    assert settled.eigenvalues[0] == 0 < settled.eigenvalues[1]


@pytest.mark.parametrize(
    ("seed", "why"),
    [
        (98, "one taut cable hardly holds it against turning"),
        (56, "a slack cable hangs folded, with no pull sideways"),
        (201, "slack cables bend within a hundredth of their length"),
        pytest.param(155, "one taut cable, and it starts radians away", marks=pytest.mark.slow),
        (247, "0.3 N/m hold it, and one cable is a third too long"),
    ],
)
def test_robots_on_hard_heavy_cables_settle_where_statics_has_them(seed, why):
    """Of 300 random ones (``stress_test_real_cables.py``) those that did not settle, or settled 0.1 mm off."""
    robot, position, random = random_robot(seed, stiffest=1e6)
    density = 10 ** random.uniform(-4, -1) * robot.mass / robot.rest_lengths(position).sum()
    problem = cdpr.Problem.of(robot.replace(linear_density=density), position)
    found = cdpr.compare(cdpr.solve(problem), cdpr.settle(problem))
    assert found.agrees, why
    assert found.position_error < 3e-7


def test_robots_without_weight_or_of_a_tenth_of_a_millimetre_settle():
    """Where nothing weighs anything, the measure of forces is the cables' own; what is drawn is not rounded to 0."""
    rows = [0, 1, 4, 5]
    flat = cdpr.Robot(CORNERS[rows] * [1, 0, 1], CUBE[rows] * [1, 0, 1], 1e5, 10.0, mobility="planar", gravity=0)
    asked = flat, [(0.01, 0, 0.98), (0, 0, 1)], 0.999 * flat.rest_lengths((0, 0, 1))
    assert set(compare_many(cdpr.solve_many(*asked), cdpr.settle_many(*asked)).verdicts) == {Verdict.AGREE}
    small = cdpr.Robot(5e-5 * CORNERS, 5e-5 * CUBE, 100.0, 1e-2, pulley_radius=[2e-6] + 7 * [0])
    problem = cdpr.Problem.of(small, (0, 0, 5e-5))
    assert np.linalg.norm(cdpr.settle(problem).position - cdpr.solve(problem).position) < 1e-8


def test_a_cable_that_pushes_shows_a_negative_tension():
    """Negative control of what is read: with the spring of a slack cable that pushes, it is negative and not zero."""
    problem = cdpr.Problem.of(cdpr.load_robot("parallel"), [0.17, 0.25, 0.1])
    model = mujoco.MjModel.from_xml_string(cdpr.to_mjcf(problem))
    slack = int(np.flatnonzero(cdpr.settle(problem).slack)[0])
    model.tendon_lengthspring[slack, 0] = model.tendon_lengthspring[slack, 1]
    assert cdpr.settle(problem, model=model).tensions[slack] < -0.01


# --- when it does not come to rest ---------------------------------------------------------------------------------


def test_beside_platforms_that_fall_or_spin_only_those_at_rest_are_settled():
    """What falls, spins or is torn away leaves its neighbour alone, has no equilibrium, and says why.

    Pulled up by twice its weight, it is caught on the other side: it ends above its exits, hanging upwards on them.
    """
    robot = cdpr.load_robot("parallel")
    poses, wrench = np.array([(0.4, 0.25, 10.0), POSE, POSE, POSE, (0.4, 0.25, 0.2)]), np.zeros((5, 6))
    wrench[1, 5], wrench[3, 5], wrench[4, 2] = 1, 50, 2 * robot.weight
    found = cdpr.settle_many(robot, poses, external_wrench=wrench)
    ended = [Status.FALLS, Status.ITERATION_LIMIT, Status.CONVERGED, Status.DIVERGED, Status.CONVERGED]
    assert found.status.tolist() == ended
    np.testing.assert_array_equal(found[2].tensions, cdpr.settle(robot, POSE).tensions)
    assert found[4].position[2] > robot.exits[:, 2].max()
    assert found[4].stable
    for row, words in {
        0: "every exit lies below the platform, which falls",
        1: r"no equilibrium was reached within the .* steps \(\d+ steps, \d.* N still unbalanced\)",
        3: "the simulation in MuJoCo became unstable",
    }.items():
        with pytest.raises(cdpr.NotSettled, match=words):
            found[row]
    with pytest.raises(cdpr.NotSettled) as caught:
        cdpr.settle(robot, POSE, external_wrench=wrench[1])
    assert caught.value.equilibrium is not None
    assert caught.value.equilibrium.residual > 1e-6 * robot.weight


def test_mujocos_warnings_become_not_settled_and_leave_no_log(tmp_path, monkeypatch, capfd):
    """A model whose motion blows up: one exception, nothing printed, no MUJOCO_LOG.TXT; and the next is well."""
    monkeypatch.chdir(tmp_path)
    problem = cdpr.Problem.of(cdpr.load_robot("parallel"), [0.4, 0.25, 0.2])
    model = mujoco.MjModel.from_xml_string(cdpr.to_mjcf(problem))
    model.opt.gravity[2] = -1e13
    before = mujoco.get_mju_user_warning()
    with pytest.raises(cdpr.NotSettled, match="the simulation in MuJoCo became unstable"):
        cdpr.settle(problem, model=model)
    assert os.listdir(tmp_path) == []
    assert capfd.readouterr() == ("", "")
    assert mujoco.get_mju_user_warning() is before
    assert cdpr.settle(problem).stable


def test_progress_is_said_when_asked_and_an_interrupt_changes_nothing(monkeypatch):
    """Steps and what is unbalanced, and of many poses which; after Ctrl-C, the next settling is the same."""
    taut = cdpr.Problem.of(cdpr.load_robot("cogiro").replace(**MASS), POSE)
    shown, said, before = [], [], cdpr.settle(taut)

    @contextlib.contextmanager
    def saying(show):
        shown.append(show)
        yield said.append

    monkeypatch.setattr("cdpr_sim.physics.settle.saying", saying)
    cdpr.settle_many(cdpr.Problems.stack([taut] * 2), progress=True)
    cdpr.settle(taut)
    assert shown == [True, False]
    assert re.fullmatch(r"MuJoCo settles the platform: pose 1 of 2: 1 steps, \S+ N of 3.92 N unbalanced", said[0])
    assert any("pose 2 of 2" in words for words in said)

    @contextlib.contextmanager
    def interrupting(_):
        yield lambda words: signal.raise_signal(signal.SIGINT)

    monkeypatch.setattr("cdpr_sim.physics.settle.saying", interrupting)
    started = signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell's background processes ignore it
    with pytest.raises(KeyboardInterrupt):
        cdpr.settle_many(cdpr.Problems.stack([taut]), progress=True)
    monkeypatch.undo()
    signal.signal(signal.SIGINT, started)
    np.testing.assert_array_equal(cdpr.settle(taut).position, before.position)


# --- many, and in motion -------------------------------------------------------------------------------------------


def spread(robot: cdpr.Robot, rows: int) -> cdpr.Problems:
    """Anywhere in the workspace, with lengths, a force and a stiffness of its own in every row."""
    random = np.random.default_rng(1)
    poses, wrench = random.uniform(*robot.workspace, (rows, 3)), np.zeros((rows, 6))
    wrench[:, 0] = random.uniform(0, 0.1 * robot.weight, rows)
    lengths = np.array([robot.rest_lengths(pose) * random.uniform(0.99, 1.01, robot.cables) for pose in poses])
    stiffness = robot.axial_stiffness * random.uniform(0.5, 2, (rows, 1))
    return cdpr.Problems.of(robot, poses, lengths, wrench, axial_stiffness=stiffness)


@pytest.mark.parametrize(
    ("name", "changes", "rows"),
    [("parallel", {}, 20), ("planar-vertical", WHEELS, 6), ("cogiro", MASS, 3), ("cogiro", MASS | WHEELS, 3)],
    ids=["plain", "planar, over wheels", "with mass", "with mass, over wheels"],
)
def test_many_settle_as_one_by_one_on_any_threads_and_in_any_order(name, changes, rows):
    """To the last bit on two threads and in another order. With mass, up to rounding: 2e-9 of a tension measured."""
    problems = spread(cdpr.load_robot(name).replace(**changes), rows)
    many, order = cdpr.settle_many(problems, threads=1), np.random.default_rng(2).permutation(rows)
    assert many.converged.all()
    for other, at in (
        (cdpr.settle_many(problems, threads=2), np.arange(rows)),
        (cdpr.settle_many(problems.take(order), threads=1), order),
    ):
        for read in ("positions", "rotations", "lengths", "tensions", "residuals", "eigenvalues", "iterations"):
            np.testing.assert_array_equal(getattr(other, read), getattr(many, read)[at], err_msg=read)
    for row in range(rows):
        alone = cdpr.settle(problems[row])
        rounding = (1e-11, 1e-7 * many.tensions.max()) if changes else (0, 0)
        np.testing.assert_allclose(many.positions[row], alone.position, rtol=0, atol=rounding[0])
        np.testing.assert_allclose(many.tensions[row], alone.tensions, rtol=0, atol=rounding[1])
        assert many.iterations[row] == alone.iterations


def test_settling_in_several_python_threads_gives_the_same_result():
    """Threads that settle the same robot at once do not share a simulation."""
    problems = spread(cdpr.load_robot("parallel"), 12)
    with concurrent.futures.ThreadPoolExecutor(4) as pool:
        together = [rest.position for rest in pool.map(cdpr.settle, problems)]
    np.testing.assert_array_equal(together, [cdpr.settle(problem).position for problem in problems])


@pytest.mark.parametrize("name", ["parallel", "cogiro", "falcon-7", "ipanema-1"])
def test_a_motion_leads_from_the_commanded_pose_to_where_the_platform_settles(name):
    """It falls from rest; Newton's method, which ends it early, ends where all of it would."""
    robot, longer = cdpr.load_robot(name), 0
    for problem in spread(robot, 4):
        rest, motion = settle_trajectory(problem)
        alone = cdpr.settle(problem)
        longer += len(motion) > alone.iterations + 1
        assert motion.times[0] == 0
        assert (np.diff(motion.times) > 0).all()
        for found, expected, tolerance in (
            (motion.positions[0], problem.pose.translation, 1e-15),
            (motion.positions[-1], rest.position, 0),
            (motion.positions[-1], alone.position, FINISHED),
            (motion.rotations[-1], alone.rotation_matrix, 100 * FINISHED),
            (motion.tensions[-1], alone.tensions, FINISHED * robot.axial_stiffness.max()),
        ):
            np.testing.assert_allclose(found, expected, rtol=0, atol=tolerance)
    assert longer >= 2
    _, motion = settle_trajectory(robot, robot.home)  # all cables just slack
    assert 0 < robot.home[2] - motion.positions[1, 2] < 1.05 * robot.gravity * motion.times[1] ** 2


def test_a_motion_with_mass_ends_where_the_platform_settles():
    """It begins where cables without mass would hold the platform."""
    robot = cdpr.load_robot("parallel").replace(**MASS)
    rest, motion = settle_trajectory(robot, POSE)
    for found, expected in ((motion.positions[-1], rest.position), (cdpr.settle(robot, POSE).position, rest.position)):
        np.testing.assert_allclose(found, expected, rtol=0, atol=FINISHED)
    assert (np.diff(motion.times) > 0).all()

"""MuJoCo's platform comes to rest, and only there is it called settled.

A plain MjModel that knows nothing of ``settle`` is the judge; for closed forms see ``test_consistency_with_mujoco.py``.
"""

import concurrent.futures
import os

import mujoco
import numpy as np
import pytest
from sample_problems import random_robot
from scipy.spatial.transform import RigidTransform

from cdpr_sim.core.equilibrium import NotSettled, Stability
from cdpr_sim.core.errors import InvalidInput
from cdpr_sim.core.problem import Problem, Problems
from cdpr_sim.core.robot import Robot
from cdpr_sim.core.status import Status
from cdpr_sim.physics import batch, dynamic_relaxation, newton_finish
from cdpr_sim.physics.batch import Simulations
from cdpr_sim.physics.dynamic_relaxation import ACCEPTABLE
from cdpr_sim.physics.mjcf import coordinates, to_mjcf
from cdpr_sim.physics.settle import residual_of, residuals_of, settle, settle_many, settle_trajectory
from cdpr_sim.robots.catalogue import load_robot

FINISHED = 1e-9
"""[m], entries of a rotation. By motion or by Newton's method, a billionth of the load stays unbalanced at rest: with
a stiffness of one load per metre, that is 1e-9 m."""

GRID = 60
"""Random poses per catalogue robot and stiffness: enough to meet every number of slack cables."""


SEEDS = 40
"""Random robots: of 3 to 10 cables and four orders of magnitude in stiffness, some are always odd."""


def random_poses(robot: Robot, rows: int, seed: int = 0) -> np.ndarray:
    """Positions anywhere in the workspace, (rows, 3)."""
    return np.random.default_rng(seed).uniform(robot.workspace[0], robot.workspace[1], (rows, 3))


def model_of(problem: Problem) -> mujoco.MjModel:
    """The problem's model as a user would compile it."""
    return mujoco.MjModel.from_xml_string(to_mjcf(problem.robot, problem.pose, problem.rest_lengths))


def unbalanced(problem: Problem, pose: RigidTransform) -> float:
    """The largest component [N] of the generalised force that plain MuJoCo finds at ``pose`` and zero velocity."""
    model = model_of(problem)
    data = mujoco.MjData(model)
    data.qpos[:] = coordinates(problem.robot, pose)
    mujoco.mj_forward(model, data)
    forces = data.qfrc_passive - data.qfrc_bias
    angular = slice(2, None) if problem.robot.mobility == "planar" else slice(3, None)
    forces[angular] /= problem.robot.characteristic_length
    return float(np.abs(forces).max())


# --- where it comes to rest ----------------------------------------------------------------------------------------


def test_random_robots_settle_where_plain_mujoco_finds_balance():
    """Whatever the cables, size and mass: at rest an independent MjModel finds balance, and 1 mm above it does not."""
    for seed in range(SEEDS):
        robot, position, _ = random_robot(seed)
        rest = settle(robot, position)
        assert unbalanced(rest.problem, rest.pose) < ACCEPTABLE * robot.weight, seed
        assert rest.stability is not Stability.UNSTABLE, seed
        lifted = RigidTransform.from_translation([0, 0, 1e-3]) * rest.pose
        assert unbalanced(rest.problem, lifted) > 100 * ACCEPTABLE * robot.weight, seed


def test_a_balanced_platform_is_not_called_settled_but_topples():
    """Held below its centre of mass on one plumb cable, forces balance at once; it must still end hanging down."""
    robot = Robot([[0, 0, 1]], [[0, 0, -0.02]], 1e4, 1.0)
    rest = settle(robot, [0, 0, 0.5])
    assert rest.tilt == pytest.approx(np.pi, abs=1e-6)
    assert rest.position[2] < 0.46


TOP_HEAVY = Robot(
    [[-0.5, 0, 1], [0.5, 0, 1]], [[-0.01, 0, -0.05], [0.01, 0, -0.05]], 1e4, 1.0, mobility="planar", name="top-heavy"
)
"""Held below its centre of mass by two cables: level in the middle it is balanced, and not stable."""


def balanced(aside: float) -> Simulations:
    """``TOP_HEAVY`` balanced in MuJoCo, and moved aside by this much [m]."""
    simulations = Simulations(TOP_HEAVY, batch._model_of(TOP_HEAVY), 1)
    simulations.start(Problems.of(TOP_HEAVY, [[0, 0, 0.5]]), own_springs=False)
    relaxation = dynamic_relaxation.Relaxation(simulations, [])
    relaxation.run()
    assert (relaxation.status == Status.CONVERGED).all()
    simulations.qpos[:] = relaxation.qpos + np.array([aside, 0, 0])
    return simulations


@pytest.mark.parametrize("name", ["parallel", "falcon-7", "ipanema-1"])
def test_newtons_method_ends_where_the_motion_would(name, monkeypatch):
    """Where several equilibria exist, the motion chooses: Newton's method takes its last part only.

    A direction without stiffness is left out, since nothing determines the platform's place in it.
    """
    robot = load_robot(name)
    poses = random_poses(robot, GRID)
    short = settle_many(robot, poses)
    monkeypatch.setattr(dynamic_relaxation, "READY", 0.0)
    long = settle_many(robot, poses)
    assert short.converged.all()
    assert short.iterations.mean() < 0.7 * long.iterations.mean()
    held = long.stability == Stability.STABLE
    assert held.mean() > 0.9
    np.testing.assert_allclose(short.positions, long.positions, rtol=0, atol=FINISHED)
    np.testing.assert_allclose(short.rotations[held], long.rotations[held], rtol=0, atol=1e2 * FINISHED)


def test_newtons_method_does_not_approach_a_saddle(monkeypatch):
    """Beside a pose at which forces balance, and which is not stable, the platform stays where it is."""
    simulations, row = balanced(aside=1e-5), np.ones(1, dtype=bool)
    before, target = simulations.qpos.copy(), np.array([1e-9 * TOP_HEAVY.weight])
    assert simulations.residuals()[0] > 100 * target[0]
    assert not newton_finish.finish(simulations, row, target).any()
    np.testing.assert_array_equal(simulations.qpos, before)
    # Negative control: without the condition on the stiffness, it goes there.
    monkeypatch.setattr(newton_finish, "DEFINITE", -np.inf)
    assert newton_finish.finish(simulations, row, target).all()
    assert simulations.residuals()[0] <= target[0]


def test_a_saddle_that_newtons_method_found_is_left_again(monkeypatch):
    """Whatever finishes a motion, the stiffness at the end decides: the motion continues from where it was."""
    saddle, pose = balanced(aside=0.0).qpos.copy(), [0.05, 0, 0.5]
    undisturbed = settle(TOP_HEAVY, pose)
    assert undisturbed.tilt > 1

    def to_the_saddle(simulations, rows, target):
        simulations.qpos[rows], simulations.qvel[rows] = saddle, 0
        return rows.astype(int)

    monkeypatch.setattr(dynamic_relaxation, "READY", np.inf)
    monkeypatch.setattr(dynamic_relaxation, "finish", to_the_saddle)
    rest = settle(TOP_HEAVY, pose)
    np.testing.assert_allclose(rest.pose.as_matrix(), undisturbed.pose.as_matrix(), rtol=0, atol=1e2 * FINISHED)
    # Negative control: where nobody looks at the stiffness, the saddle is what is found.
    monkeypatch.setattr("cdpr_sim.physics.batch.SimulationReading.unstable", np.zeros(1, dtype=bool))
    assert settle(TOP_HEAVY, pose).tilt < 1e-6


# --- what is read out of MuJoCo ------------------------------------------------------------------------------------


def test_a_cable_that_pushes_shows_a_negative_tension():
    """Let the spring of a slack cable push (a negative control): the tension read out is negative, and not zero."""
    problem = Problem.of(load_robot("parallel"), [0.17, 0.25, 0.1])
    model = model_of(problem)
    slack = int(np.flatnonzero(settle(problem.robot, problem.pose).slack)[0])
    model.tendon_lengthspring[slack, 0] = model.tendon_lengthspring[slack, 1]
    rest = settle(problem.robot, problem.pose, model=model)
    assert rest.tensions[slack] < -0.01


def test_residual_of_a_pose_is_what_plain_mujoco_finds_there():
    """Zero at the settled pose, and elsewhere the force that an independent model shows; of many as of one."""
    rest = settle(load_robot("planar-vertical"), [0.2, 0, 0.1])
    lifted = RigidTransform.from_translation([1e-3, 0, 1e-3]) * rest.pose
    assert residual_of(rest.problem, rest.pose) < ACCEPTABLE * rest.problem.robot.weight
    assert residual_of(rest.problem, lifted) == pytest.approx(unbalanced(rest.problem, lifted), rel=1e-9)
    many = residuals_of(Problems.stack([rest.problem] * 2), RigidTransform.concatenate([rest.pose, lifted]))
    np.testing.assert_array_equal(many, [residual_of(rest.problem, pose) for pose in (rest.pose, lifted)])


# --- when it does not come to rest ---------------------------------------------------------------------------------


def test_a_platform_that_is_lifted_off_is_caught_on_the_other_side():
    """Pulled up by twice its weight, all cables slack, it ends above its exits, hanging upwards on them."""
    robot = load_robot("parallel")
    rest = settle(robot, [0.4, 0.25, 0.2], external_wrench=[0, 0, 2 * robot.weight, 0, 0, 0])
    assert rest.position[2] > robot.exits[:, 2].max()
    assert rest.stable
    assert rest.residual < ACCEPTABLE * robot.weight


def test_a_platform_that_is_spun_up_for_ever_does_not_settle():
    """A torque that no cable can balance does work at every turn: there is no rest, and the reason says so."""
    with pytest.raises(NotSettled, match="the simulation in MuJoCo became unstable"):
        settle(load_robot("parallel"), [0.4, 0.25, 0.2], external_wrench=[0, 0, 0, 0, 0, 50])


def test_mujocos_warnings_become_not_settled_and_leave_no_log(tmp_path, monkeypatch, capfd):
    """A model whose motion blows up: one exception, nothing printed, no MUJOCO_LOG.TXT; and the next is well."""
    monkeypatch.chdir(tmp_path)
    problem = Problem.of(load_robot("parallel"), [0.4, 0.25, 0.2])
    model = model_of(problem)
    model.opt.gravity[2] = -1e13
    before = mujoco.get_mju_user_warning()
    with pytest.raises(NotSettled, match="the simulation in MuJoCo became unstable"):
        settle(problem.robot, problem.pose, model=model)
    assert os.listdir(tmp_path) == []
    assert capfd.readouterr() == ("", "")
    assert mujoco.get_mju_user_warning() is before
    assert settle(problem.robot, problem.pose).stable


def test_running_out_of_steps_is_not_settling(monkeypatch):
    """Given too few steps, the status says so, the reason says what is left, and the state is no equilibrium."""
    monkeypatch.setattr(dynamic_relaxation, "STEPS", 2 * dynamic_relaxation.CHUNK)
    words = r"no equilibrium was reached within the .* time steps \(26 time steps, \d.* N still unbalanced\)"
    with pytest.raises(NotSettled, match=words) as caught:
        settle(load_robot("parallel"), [0.17, 0.25, 0.1])
    assert caught.value.equilibrium is not None
    assert caught.value.equilibrium.residual > ACCEPTABLE * load_robot("parallel").weight


def test_beside_platforms_that_fall_or_spin_only_those_at_rest_are_settled():
    """A batch of which MuJoCo is asked a part; what spins leaves its neighbour alone, and has no equilibrium."""
    robot = load_robot("parallel")
    pose, above, spin = random_poses(robot, 1)[0], [0.4, 0.25, 10], [0, 0, 0, 0, 0, 1]
    equilibria = settle_many(robot, [above, pose, pose], external_wrench=[[0] * 6, spin, [0] * 6])
    assert equilibria.status.tolist() == [Status.FALLS, Status.ITERATION_LIMIT, Status.CONVERGED]
    np.testing.assert_array_equal(equilibria[2].tensions, settle(robot, pose).tensions)
    with pytest.raises(NotSettled):
        equilibria[1]


@pytest.mark.parametrize(("name", "axial_stiffness"), [("cogiro", 1e4), ("parallel", 1e6)])
def test_rest_is_what_is_said_of_it(name, axial_stiffness):
    """A billionth of the weight is left over, also where forces were that small in passing, at some velocity."""
    robot = load_robot(name).replace(axial_stiffness=axial_stiffness)
    equilibria = settle_many(robot, np.random.default_rng(1).uniform(*robot.workspace, (1000, 3)))
    assert equilibria.converged.all()
    assert equilibria.residuals.max() <= 1e-9 * robot.weight


def test_another_mass_in_every_row_is_refused():
    """MuJoCo has one model for all rows; statics takes them."""
    robot = load_robot("cogiro")
    problems = Problems.of(robot, [robot.home] * 2, mass=[0.4, 0.5])
    with pytest.raises(InvalidInput, match="mass: found one per problem"):
        settle_many(problems)


def test_a_model_without_the_origin_body_refuses_a_wrench():
    """A model of one's own that has no body to apply the wrench to: one sentence, and no silent neglect."""
    robot = load_robot("cogiro")
    text = to_mjcf(robot, [0.4, 0.25, 0.2]).replace('<body name="origin" />', "")
    with pytest.raises(InvalidInput, match="origin"):
        settle(
            robot,
            [0.4, 0.25, 0.2],
            external_wrench=[1, 0, 0, 0, 0, 0],
            model=mujoco.MjModel.from_xml_string(text),
        )


# --- many, and in motion -------------------------------------------------------------------------------------------


def test_many_settle_exactly_as_one_by_one():
    """On two threads, side by side, each row is bit for bit what ``settle`` gives alone, on its own rest lengths."""
    robot = load_robot("parallel")
    poses = random_poses(robot, 20, seed=1)
    lengths = Problems.of(robot, poses).rest_lengths * np.linspace(0.99, 1.01, 20)[:, None]
    many = settle_many(robot, poses, lengths, threads=2)
    for row, pose in enumerate(poses):
        alone = settle(robot, pose, lengths[row])
        np.testing.assert_array_equal(many.poses[row].as_matrix(), alone.pose.as_matrix())
        np.testing.assert_array_equal(many.tensions[row], alone.tensions)
        np.testing.assert_array_equal(many.eigenvalues[row], alone.eigenvalues)
        assert many.iterations[row] == alone.iterations


def test_settling_in_several_python_threads_gives_the_same_result():
    """Two threads that settle the same robot at once do not share a simulation."""
    robot = load_robot("parallel")
    poses = random_poses(robot, 40, seed=2)
    alone = [settle(robot, pose).position for pose in poses]
    with concurrent.futures.ThreadPoolExecutor(4) as pool:
        together = [rest.position for rest in pool.map(lambda pose: settle(robot, pose), poses)]
    np.testing.assert_array_equal(together, alone)


def test_the_trajectory_leads_from_the_commanded_pose_to_rest():
    """It begins at time 0 at the commanded pose with slack cables, moves, and ends where ``settle`` says."""
    robot, pose = load_robot("parallel"), [0.17, 0.25, 0.1]
    rest, motion = settle_trajectory(robot, pose)
    alone = settle(robot, pose)
    assert len(motion) == rest.iterations + 1 > alone.iterations + 1  # the whole motion, without Newton's method
    assert motion.times[0] == 0
    assert (np.diff(motion.times) > 0).all()
    np.testing.assert_allclose(motion.poses[0].translation, pose, atol=1e-15)
    np.testing.assert_array_equal(motion.poses[-1].as_matrix(), rest.pose.as_matrix())
    np.testing.assert_allclose(motion.poses[-1].as_matrix(), alone.pose.as_matrix(), rtol=0, atol=FINISHED)
    np.testing.assert_allclose(motion.tensions[-1], alone.tensions, rtol=0, atol=FINISHED * robot.axial_stiffness.max())
    np.testing.assert_allclose(motion.tensions[0], 0, atol=1e-9 * robot.weight)
    fall = 0.5 * robot.gravity * motion.times[1] ** 2
    assert 0 < pose[2] - motion.poses[1].translation[2] < 2.1 * fall  # it falls, and is not put at its goal


def test_the_motion_does_not_depend_on_the_unit_of_mass(monkeypatch):
    """Another power of two for the unit of mass changes no step on the way."""
    robot, pose = load_robot("parallel"), [0.17, 0.25, 0.1]
    _, scaled = settle_trajectory(robot, pose)
    monkeypatch.setattr(batch, "MASS_IN_UNITS", 2.0**20)
    _, other = settle_trajectory(robot.replace(name="another object, not the cached one"), pose)
    np.testing.assert_allclose(scaled.poses[40].translation, other.poses[40].translation, atol=1e-12)

"""MuJoCo's platform comes to rest, and only there is it called settled.

Where a closed form exists it is the judge; elsewhere a plain MjModel that knows nothing of ``settle`` is.
"""

import concurrent.futures
import os

import mujoco
import numpy as np
import pytest
from sample_problems import random_robot
from scipy.spatial.transform import RigidTransform, Rotation

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
from cdpr_sim.robots.catalogue import PAPER_ROBOTS, load_robot

CLOSED_FORM = 1e-8
"""Relative. At rest 1e-9 of the load is unbalanced; on a pendulum of length l that is 1e-9 l of displacement."""

DIFFERENCED = 1e-5
"""Relative. Forces are differenced over 3e-6 cable lengths; truncation is the square of that, times EA over tension."""

FINISHED = 1e-9
"""[m], entries of a rotation. By motion or by Newton's method, a billionth of the load stays unbalanced at rest: with
a stiffness of one load per metre, that is 1e-9 m."""

MOVED = 1e-6
"""[m] What two methods must agree to; a negative control must move the platform further."""

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


@pytest.mark.parametrize("name", PAPER_ROBOTS)
def test_the_papers_robots_settle_anywhere_in_their_workspace(name):
    """Every random pose ends at rest: forces balance to 1e-6 of the weight, and nothing pulls the platform away."""
    for axial_stiffness in (1e3, 1e4, 1e6):
        robot = load_robot(name).replace(axial_stiffness=axial_stiffness)
        equilibria = settle_many(robot, random_poses(robot, GRID))
        assert equilibria.converged.all()
        assert equilibria.residuals.max() < ACCEPTABLE * robot.weight
        assert (equilibria.stability != Stability.UNSTABLE).all()
        assert (equilibria.tensions >= 0).all()


def test_random_robots_settle_where_plain_mujoco_finds_balance():
    """Whatever the cables, size and mass: at rest an independent MjModel finds balance, and 1 mm above it does not."""
    for seed in range(SEEDS):
        robot, position, _ = random_robot(seed)
        rest = settle(robot, position)
        assert unbalanced(rest.problem, rest.pose) < ACCEPTABLE * robot.weight, seed
        assert rest.stability is not Stability.UNSTABLE, seed
        lifted = RigidTransform.from_translation([0, 0, 1e-3]) * rest.pose
        assert unbalanced(rest.problem, lifted) > 100 * ACCEPTABLE * robot.weight, seed


def test_a_platform_on_one_cable_hangs_plumb_below_its_exit():
    """One cable, let go aside: tension m g, length l0 (1 + m g/EA), and the centre of mass plumb below the exit."""
    robot = Robot([[0.2, -0.1, 1]], [[0, 0, 0.02]], 1e3, 1.5, center_of_mass=[0, 0, -0.01])
    rest = settle(robot, [0.3, 0, 0.5])
    length = rest.rest_lengths[0] * (1 + robot.weight / 1e3)
    np.testing.assert_allclose(rest.tensions, robot.weight, rtol=CLOSED_FORM)
    np.testing.assert_allclose(rest.lengths, length, rtol=CLOSED_FORM)
    np.testing.assert_allclose(
        rest.position, [0.2, -0.1, 1 - length - 0.02], atol=1e-6
    )  # turning about the cable is free
    assert rest.stability is Stability.NEUTRAL


def test_two_plumb_cables_share_the_weight_as_levers_do():
    """A bar on two plumb cables, its centre of mass at a quarter: three quarters and one quarter of the weight."""
    robot = Robot(
        [[-0.1, 0, 1], [0.1, 0, 1]],
        [[-0.1, 0, 0], [0.1, 0, 0]],
        1e7,
        2.0,
        center_of_mass=[0.05, 0, 0],
        mobility="planar",
    )
    rest = settle(robot, [0, 0, 0.5])
    np.testing.assert_allclose(rest.tensions, robot.weight * np.array([0.25, 0.75]), rtol=1e-5)  # it swings by 1e-6 l


def test_eigenvalues_are_those_of_a_pendulum_on_a_spring():
    """A point on one cable: EA/l0 along it, tension/l across it (twice), and nothing for turning about the point."""
    robot = Robot([[0, 0, 1]], [[0, 0, 0]], 1e4, 1.0, platform_size=[0.1, 0.1, 0.1])
    rest = settle(robot, [0, 0, 0.4])
    across = robot.weight / rest.lengths[0]
    expected = [0, 0, 0, across, across, 1e4 / rest.rest_lengths[0]]
    np.testing.assert_allclose(rest.eigenvalues, expected, rtol=DIFFERENCED, atol=DIFFERENCED * across)


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


def test_tension_follows_from_length_in_every_cable():
    """The tensions and lengths that are read out obey Hooke's law, slack cables included."""
    rest = settle(load_robot("parallel"), [0.17, 0.25, 0.1])
    stretch = np.maximum(rest.lengths - rest.rest_lengths, 0)
    springs = rest.problem.axial_stiffness / rest.rest_lengths
    np.testing.assert_allclose(rest.tensions, springs * stretch, rtol=1e-9, atol=1e-9)
    assert rest.slack.sum() == 4


def test_an_external_wrench_acts_on_the_origin_and_not_on_the_centre_of_mass():
    """Without gravity, the weight as a wrench settles as gravity on a centred mass, wherever the mass really is."""
    robot = load_robot("parallel")
    offset = robot.replace(gravity=0.0, center_of_mass=[0.02, 0.01, 0.01])
    by_gravity = settle(robot, [0.2, 0.2, 0.1])
    by_wrench = settle(offset, [0.2, 0.2, 0.1], external_wrench=[0, 0, -robot.weight, 0, 0, 0])
    np.testing.assert_allclose(by_wrench.position, by_gravity.position, atol=CLOSED_FORM)
    np.testing.assert_allclose(by_wrench.tensions, by_gravity.tensions, atol=CLOSED_FORM * robot.weight)
    offset_by_gravity = settle(offset.replace(gravity=robot.gravity), [0.2, 0.2, 0.1])
    assert np.linalg.norm(offset_by_gravity.position - by_gravity.position) > 1000 * MOVED


def test_a_torque_turns_the_platform_about_the_base_frame_axis():
    """Under a torque about the vertical the level platform of the symmetric robot turns about the vertical."""
    robot = load_robot("cogiro")
    turned = settle(robot, [0.4, 0.25, 0.2], external_wrench=[0, 0, 0, 0, 0, 0.01]).rotation
    assert turned.as_rotvec()[2] > 1e-5
    assert abs(turned.as_rotvec()[2]) > 10 * np.abs(turned.as_rotvec()[:2]).max()


def test_residual_of_a_pose_is_what_plain_mujoco_finds_there():
    """Zero at the settled pose, and elsewhere the force that an independent model shows; of many as of one."""
    rest = settle(load_robot("planar-vertical"), [0.2, 0, 0.1])
    lifted = RigidTransform.from_translation([1e-3, 0, 1e-3]) * rest.pose
    assert residual_of(rest.problem, rest.pose) < ACCEPTABLE * rest.problem.robot.weight
    assert residual_of(rest.problem, lifted) == pytest.approx(unbalanced(rest.problem, lifted), rel=1e-9)
    many = residuals_of(Problems.stack([rest.problem] * 2), RigidTransform.concatenate([rest.pose, lifted]))
    np.testing.assert_array_equal(many, [residual_of(rest.problem, pose) for pose in (rest.pose, lifted)])


# --- negative controls: a corrupted model must show -----------------------------------------------------------------


def stiffer(model: mujoco.MjModel) -> None:
    """One tendon is 1 % stiffer."""
    model.tendon_stiffness[0] *= 1.01


def anchor_moved(model: mujoco.MjModel) -> None:
    """One anchor is 1 mm off."""
    model.site("anchor_1").pos[0] += 1e-3


def gravity_tilted(model: mujoco.MjModel) -> None:
    """Gravity leans by 0.1°."""
    model.opt.gravity[:] = Rotation.from_rotvec([0, np.radians(0.1), 0]).apply(model.opt.gravity)


@pytest.mark.parametrize("corrupt", [stiffer, anchor_moved, gravity_tilted], ids=lambda corrupt: corrupt.__name__)
def test_a_corrupted_model_rests_elsewhere(corrupt):
    """A small fault in the model moves its rest pose by more than two methods may differ, and the original does not."""
    problem = Problem.of(load_robot("parallel"), [0.17, 0.25, 0.1])
    model = model_of(problem)
    rest = settle(problem.robot, problem.pose)
    same = settle(problem.robot, problem.pose, model=model)
    corrupt(model)
    other = settle(problem.robot, problem.pose, model=model)
    assert np.linalg.norm(same.position - rest.position) < MOVED / 100
    assert np.linalg.norm(other.position - rest.position) > MOVED


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


def test_in_a_batch_only_the_spinning_rows_are_not_settled():
    """A row that does not rest leaves its neighbours alone; asking for its equilibrium raises."""
    robot = load_robot("parallel")
    poses, spin = random_poses(robot, 4), [0, 0, 0, 0, 0, 1]
    equilibria = settle_many(robot, poses, external_wrench=[spin, [0] * 6, [0] * 6, spin])
    words = [Status.ITERATION_LIMIT, Status.CONVERGED, Status.CONVERGED, Status.ITERATION_LIMIT]
    assert equilibria.status.tolist() == words
    np.testing.assert_array_equal(equilibria[2].tensions, settle(robot, poses[2]).tensions)
    with pytest.raises(NotSettled):
        equilibria[3]


def test_beside_platforms_that_fall_only_those_at_rest_are_settled():
    """A batch of which MuJoCo is asked a part: the part that falls, the part that spins and the part that rests."""
    robot = load_robot("parallel")
    pose, above, spin = random_poses(robot, 1)[0], [0.4, 0.25, 10], [0, 0, 0, 0, 0, 1]
    equilibria = settle_many(robot, [above, pose, pose], external_wrench=[[0] * 6, spin, [0] * 6])
    assert equilibria.status.tolist() == [Status.FALLS, Status.ITERATION_LIMIT, Status.CONVERGED]


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
    """On two threads, side by side, each row is bit for bit what ``settle`` gives alone."""
    robot = load_robot("parallel")
    poses = random_poses(robot, 20, seed=1)
    many = settle_many(robot, poses, threads=2)
    for row, pose in enumerate(poses):
        alone = settle(robot, pose)
        np.testing.assert_array_equal(many.poses[row].as_matrix(), alone.pose.as_matrix())
        np.testing.assert_array_equal(many.tensions[row], alone.tensions)
        np.testing.assert_array_equal(many.eigenvalues[row], alone.eigenvalues)
        assert many.iterations[row] == alone.iterations


def test_rest_lengths_and_poses_come_in_rows_too():
    """Per-row rest lengths and a stack of transforms mean the same as the same problems one by one."""
    robot = load_robot("planar-vertical")
    poses = RigidTransform.from_translation([[0.2, 0, 0.1], [0.3, 0, 0.2]])
    lengths = np.array([robot.rest_lengths(pose) for pose in poses]) * 0.99
    many = settle_many(robot, poses, lengths)
    alone = settle(robot, poses[1], lengths[1])
    np.testing.assert_array_equal(many.tensions[1], alone.tensions)
    with pytest.raises(InvalidInput, match=r"do not fit one another: poses \(2,\), .*rest_lengths \(3,\)"):
        settle_many(robot, poses, np.ones((3, robot.cables)))


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

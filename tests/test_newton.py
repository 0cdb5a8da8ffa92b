import copy
import dataclasses
import pickle
import subprocess
import sys

import numpy as np
import pytest
from hypothesis import given
from sample_problems import grid, hanging_mass, paper_line, random_problems, symmetric_pair
from scipy.optimize import brentq
from scipy.spatial.transform import RigidTransform, Rotation

import cdpr_sim as cdpr
from cdpr_sim.core import pose as core_pose
from cdpr_sim.statics import forces, newton
from cdpr_sim.statics.gufuncs import EQUILIBRIA
from cdpr_sim.statics.newton_kernel import FORCE_TOLERANCE, ROUNDING

SAME = 1e-13
"""[m] The same kernel on rest lengths that were rounded in two ways."""

POSITION = 1e-8
"""[m] A residual of 2e-9 of the weight over a platform as soft as 1 weight per metre."""


def balanced(problem: cdpr.Problem) -> float:
    """The residual [N] that the solver promises."""
    robot = problem.robot
    size = max(np.abs(robot.exits).max(), np.abs(problem.pose.translation).max())
    stiffest = (problem.axial_stiffness / problem.rest_lengths).max()
    return 2 * (FORCE_TOLERANCE * problem.load + ROUNDING * stiffest * size)


def test_hanging_mass_may_spin_freely_and_says_so():
    """One vertical cable through the centre of mass holds no rotation about itself."""
    result = newton.solve(hanging_mass())
    assert result.stability is cdpr.Stability.NEUTRAL
    assert not result.stable


@pytest.mark.parametrize("axial_stiffness", [10.0, 1e3, 1e6])
def test_symmetric_pair_rests_where_both_cables_share_the_weight(axial_stiffness):
    """2 EA (l − l0)/l0 (h + d)/l = m g for the drop d: one equation, solved by bisection."""
    problem = symmetric_pair(axial_stiffness=axial_stiffness)
    (span, _, height), l0 = problem.robot.exits[1], problem.rest_lengths[0]

    def unbalanced(drop):
        length = np.hypot(span, height + drop)
        return 2 * axial_stiffness * (length - l0) / l0 * (height + drop) / length - problem.robot.weight

    drop = brentq(unbalanced, 0, 10, xtol=1e-15)
    result = newton.solve(problem)
    np.testing.assert_allclose(result.position, [0, 0, -drop], atol=POSITION)


@given(random_problems(min_cables=1))
def test_every_random_robot_finds_a_rest_below_its_start(problem):
    """Forces balance, nothing is unstable, and the energy is no higher than at the commanded pose."""
    result = newton.solve(problem)
    assert result.residual <= balanced(problem)
    assert result.stability is not cdpr.Stability.UNSTABLE
    start, end = (
        forces.at(problem, pose.translation, pose.rotation.as_matrix()).energy for pose in (problem.pose, result.pose)
    )
    assert end <= start + 1e-12 * abs(start)
    assert (result.slack == (result.lengths <= result.rest_lengths)).all()


def top_heavy(linear_density: float = 0.0) -> cdpr.Problem:
    """A bar on two vertical cables with its centre of mass above them: level it balances on a saddle."""
    robot = cdpr.Robot(
        exits=[[-0.1, 0, 1], [0.1, 0, 1]],
        anchors=[[-0.1, 0, 0], [0.1, 0, 0]],
        center_of_mass=[0, 0, 0.2],
        axial_stiffness=50.0,  # 2 EA/l0 b² = 1 N m/rad against m g h = 2 N m/rad
        mass=1.0,
        mobility="planar",
        linear_density=linear_density,
        name="top heavy",
    )
    return cdpr.Problem.of(robot, (0, 0, 0))


@pytest.mark.parametrize("linear_density", [0.0, 0.01])
def test_solver_leaves_a_saddle_for_a_stable_equilibrium(linear_density):
    """SEECR stops at the level saddle and reports it as one; ours goes on downhill and turns over."""
    problem = top_heavy(linear_density)
    saddle = cdpr.solve(problem.robot, problem.pose, method="fsolve")
    assert saddle.stability is cdpr.Stability.UNSTABLE
    assert saddle.tilt < 1e-6
    result = newton.solve(problem)
    assert result.stable
    assert result.tilt > np.radians(90)


def test_the_side_on_which_it_leaves_a_saddle_is_not_the_blas_choice(monkeypatch):
    """An eigenvector's sign is: with the other one, the platform turns over the same way, to the last bit."""
    kernel, decompose, signs = EQUILIBRIA[0], np.linalg.eigh, iter([1.0, -1.0])

    def signed(matrix):
        values, vectors = decompose(matrix)
        return values, next(signs) * vectors

    monkeypatch.setattr(np.linalg, "eigh", signed)
    turned = []
    for _ in range(2):
        monkeypatch.setattr(kernel, "_compiled", None)  # interpreted: compiled code has LAPACK's own
        monkeypatch.setattr(kernel, "_left", 1)
        turned.append(newton.solve(top_heavy()).rotation_matrix)
    assert next(signs, None) is None
    np.testing.assert_array_equal(*turned)


STIFFNESSES = [1e2, 1e3, 1e4, 1e5, 1e6, 1e7]
"""EA [N]."""


@pytest.mark.parametrize("name", ["cogiro", "parallel"])
def test_every_pose_is_solved_at_a_cost_that_does_not_depend_on_stiffness(catalogue, name):
    """Random poses of the workspace, five decades of stiffness: all in fewer than 12 iterations on average."""
    robot = catalogue[name]
    positions = np.random.default_rng(7).uniform(*robot.workspace, (3000, 3))
    equilibria = newton.solve_many(robot, positions, axial_stiffness=np.array(STIFFNESSES)[:, None, None])
    assert equilibria.converged.all()
    for row, axial_stiffness in enumerate(STIFFNESSES):
        assert equilibria.residuals[row].max() <= max(1e-8, 1e-13 * axial_stiffness)
        assert equilibria.iterations[row].mean() < 12


def test_every_equilibrium_of_the_parallel_layout_is_stable_or_free_to_turn(catalogue):
    """A few per cent of its poses hang on two cables whose anchors' line passes through the centre of mass."""
    robot = catalogue["parallel"]
    equilibria = newton.solve_many(robot, grid(robot, 1000))
    eigenvalues = forces.at(equilibria.problems, equilibria.positions, equilibria.rotations).eigenvalues
    smallest, largest = eigenvalues[:, 0], eigenvalues[:, -1]
    assert (smallest > -1e-9 * largest).all()
    free = smallest < 1e-9 * largest
    assert 0 < free.mean() < 0.1
    assert ((equilibria.tensions[free] > 0).sum(1) <= 3).all()
    at_kink = (np.abs(equilibria.lengths - equilibria.rest_lengths) < 1e-9).any(1)  # counts as taut or as slack
    assert ((free == (equilibria.stability == cdpr.Stability.NEUTRAL)) | at_kink).all()


def test_one_call_broadcasts_and_equals_single_solves(catalogue):
    """Poses x stiffnesses x masses at once, each as if solved alone: it is the same kernel."""
    robot = catalogue["parallel"]
    positions = paper_line(robot, 3)
    stiffnesses, masses = np.array([1e3, 1e4]), np.array([0.2, 0.4, 0.8])
    many = newton.solve_many(robot, positions[:, None, None], axial_stiffness=stiffnesses[:, None, None], mass=masses)
    assert many.positions.shape == (6, 2, 3, 3)
    assert many.tensions.shape == (6, 2, 3, 8)
    for i, position in enumerate(positions):
        for j, stiffness in enumerate(stiffnesses):
            for k, mass in enumerate(masses):
                one = cdpr.solve(robot.replace(axial_stiffness=stiffness, mass=mass), position)
                np.testing.assert_allclose(many.positions[i, j, k], one.position, rtol=0, atol=SAME)
                assert many.iterations[i, j, k] == one.iterations


@pytest.mark.parametrize("linear_density", [0.0, 5e-4])
def test_pose_that_is_not_a_number_is_not_filled_in(catalogue, linear_density):
    """nan in, nan and a status out; its neighbours are solved."""
    positions = [[0.3, 0.25, 0.1], [np.nan, 0.25, 0.1]]
    many = newton.solve_many(catalogue["parallel"].replace(linear_density=linear_density), positions)
    assert many.status.tolist() == [cdpr.Status.CONVERGED, cdpr.Status.NOT_FINITE]
    assert np.isnan(many.residuals[1])


def test_torque_that_nothing_resists_is_not_converged():
    """A mass on one cable, turned about it by a constant torque, spins for ever."""
    problem = hanging_mass()
    with pytest.raises(cdpr.NotConverged, match="there may be no equilibrium") as error:
        cdpr.solve(problem.robot, problem.pose, external_wrench=[0, 0, 0, 0, 0, 1.0])
    assert error.value.equilibrium is not None
    assert error.value.equilibrium.residual > 1


MIRROR = np.diag([1.0, -1.0, 1.0])

UNCHANGED = dict(order=np.arange(8), world=np.eye(3), platform=np.eye(3), shift=np.zeros(3), scale=1.0)

INVARIANCES = {
    "order of cables": dict(order=np.arange(8)[::-1]),
    "place and heading": dict(world=Rotation.from_rotvec([0, 0, 0.7]).as_matrix(), shift=np.array([3.0, -2.0, 1.0])),
    "mirror image": dict(world=MIRROR, platform=MIRROR),
    "metres in hundreds": dict(scale=1e-2),
    "millimetres": dict(scale=1e3),
}
"""What cannot matter: exits and poses in another world, anchors in another platform, with the same forces."""

EVERY_PROPERTY = dict(
    linear_density=[5e-4] * 7 + [0], pulley_radius=np.linspace(0, 0.014, 8), pulley_axis=(0.1, 0.2, -1),
    stiffening=[(0, 0)] * 3 + [(100, 2e4)] * 5, winch_to_exit=[0.5, 0] * 4, reeving=[1, 2, 1, 1, 3, 1, 1, 2],
)  # fmt: skip


@pytest.mark.parametrize("changes", [{}, EVERY_PROPERTY], ids=["plain", "every property"])
@pytest.mark.parametrize("what", INVARIANCES)
def test_what_cannot_matter_does_not(catalogue, what, changes):
    """Order, place, heading, mirror image and units, of plain cables, four of them slack, and of all others."""
    robot, pose = catalogue["parallel"].replace(**changes), np.array([0.2, 0.2, 0.12])
    order, world, platform, shift, scale = (UNCHANGED | INVARIANCES[what]).values()
    other = cdpr.Robot(
        scale * robot.exits[order] @ world.T + shift, scale * robot.anchors[order] @ platform.T,
        robot.axial_stiffness[order], robot.mass, pulley_radius=scale * robot.pulley_radius[order],
        pulley_axis=robot.pulley_axis[order] @ world.T, linear_density=robot.linear_density[order] / scale,
        stiffening=robot.stiffening[order], winch_to_exit=scale * robot.winch_to_exit[order],
        reeving=robot.reeving[order],
    )  # fmt: skip
    result = cdpr.solve(robot, pose)
    moved = cdpr.solve(
        other, RigidTransform.from_components(scale * world @ pose + shift, Rotation.from_matrix(world @ platform.T))
    )
    expected = scale * world @ result.position + shift
    np.testing.assert_allclose(moved.position, expected, rtol=0, atol=POSITION * scale)
    turned = world @ result.rotation_matrix @ platform.T
    np.testing.assert_allclose(moved.rotation_matrix, turned, rtol=0, atol=1e-7)
    np.testing.assert_allclose(moved.tensions, result.tensions[order], rtol=0, atol=1e-6)


def test_importing_the_package_is_light_and_compiles_nothing():
    """No MuJoCo, Numba or SciPy until they are needed, and no compilation until the first solve."""
    code = (
        "import sys, cdpr_sim; heavy = {'mujoco', 'numba', 'scipy', 'pydantic', 'typer'} & sys.modules.keys(); "
        "assert not heavy, heavy; "
        "from cdpr_sim.statics import newton, stiffness_kernel, balance_kernel; "
        "assert 'numba' not in sys.modules"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


# --- what is computed when it is asked for ---------------------------------------------------------------------------


def test_solving_computes_nothing_that_nobody_asked_for(catalogue, monkeypatch):
    """Neither SciPy's poses nor the stiffness matrix: they take many times as long as the solver."""
    problem = cdpr.Problem.of(catalogue["parallel"], (0.3, 0.25, 0.1))

    def refused(*_):
        raise AssertionError

    with monkeypatch.context() as patch:
        patch.setattr(core_pose, "poses_of", refused)
        patch.setattr(forces, "at", refused)
        found = cdpr.solve(problem)
        assert found.position[2] < 0.1
        with pytest.raises(AssertionError):
            found.pose  # noqa: B018
        with pytest.raises(AssertionError):
            found.stable  # noqa: B018
    assert found.stable
    assert found.eigenvalues is found.eigenvalues
    assert not found.eigenvalues.flags.writeable
    np.testing.assert_array_equal(found.pose.translation, found.position)


def test_an_equilibrium_is_copied_whole_before_and_after_it_was_asked(catalogue):
    """Pickled, deep-copied or with a changed field, all that it says is the same."""
    rest = cdpr.solve(catalogue["cogiro"], (0.3, 0.25, 0.1))
    copies = [pickle.loads(pickle.dumps(rest)), copy.deepcopy(rest), dataclasses.replace(rest)]
    assert rest.stable
    copies += [pickle.loads(pickle.dumps(rest)), copy.deepcopy(rest), cdpr.Equilibrium(**vars(rest))]
    for one in copies:
        np.testing.assert_array_equal(one.eigenvalues, rest.eigenvalues)
        np.testing.assert_array_equal(one.pose.as_matrix(), rest.pose.as_matrix())
        np.testing.assert_array_equal(one.tensions, rest.tensions)
    elsewhere = dataclasses.replace(rest, pose=rest.problem.pose)
    np.testing.assert_array_equal(elsewhere.position, [0.3, 0.25, 0.1])
    assert elsewhere.pose is rest.problem.pose


def test_a_planar_robot_stays_in_its_plane():
    """Its mass high above its anchors would turn it over sideways, where nothing but the plane holds it."""
    robot = cdpr.load_robot("planar-vertical").replace(center_of_mass=(0.0, 0.0, 0.05))
    found = cdpr.solve(robot, robot.home)
    np.testing.assert_allclose(found.rotation_matrix[1], [0, 1, 0], atol=1e-12)
    assert found.position[1] == 0
    assert cdpr.compare(found, cdpr.settle(robot, robot.home)).agrees
    sideways = robot.replace(mobility="spatial", inertia=np.eye(3) * 1e-4)
    assert cdpr.solve(sideways, robot.home).rotation_matrix[1, 1] < 0.5  # the negative control: free, it turns over


def test_an_equilibrium_is_taken_as_it_is():
    """It is not solved for anew."""
    found = cdpr.solve(cdpr.load_robot("cogiro"), (0.3, 0.25, 0.1))
    assert newton.equilibrium_of(found) is found


# --- the last bit ---------------------------------------------------------------------------------------------------

STEPS = (0.0, 1e-9, 1e-7)
"""[m] By which rest lengths are changed, up or down at random; 0 stands for one unit in the last place."""

CONDITION = 100
"""Most that ``falcon-7`` moves per change of a rest length where it moves steadily; 24 is measured."""

ROUNDED = 1e-12
"""[m] Without the tolerance at the start, 49 of 20,000 poses move by 2e-4 to 2e-3 m."""

JUMPED = (748, 946, 2169, 3567, 3981, 4008, 4380, 4566, 4894, 4971)
"""Some of those poses."""

THERE = 1e-7
"""[m] Statics and MuJoCo at the same of two stable equilibria, which are 2e-4 m apart and more."""


def falcons() -> tuple[cdpr.Problems, np.ndarray]:
    """20,000 poses of ``falcon-7`` on rigid lengths, at which every cable is just at its rest length; those lengths."""
    robot = cdpr.load_robot("falcon-7")
    problems = cdpr.Problems.of(robot, np.random.default_rng(0).uniform(*robot.workspace, (20_000, 3)))
    return problems, problems.rest_lengths


def test_the_last_bit_of_a_rest_length_chooses_no_equilibrium():
    """Rest lengths that differ by rounding, by a nanometre and by a hundred: answers that differ in proportion."""
    problems, lengths = falcons()
    equilibria, up = newton.solve_many(problems), np.random.default_rng(1).random(lengths.shape) < 0.5
    for step in STEPS:
        changed = np.where(up, lengths + step, lengths - step) if step else np.nextafter(lengths, np.where(up, 9, 0))
        assert (changed != lengths).all()
        others = newton.solve_many(dataclasses.replace(problems, rest_lengths=changed))
        assert equilibria.converged.all()
        assert others.converged.all()
        moved = np.linalg.norm(equilibria.positions - others.positions, axis=1)
        assert moved.max() < ROUNDED + CONDITION * step


def test_mujoco_settles_where_that_choice_leads():
    """At 99 of 100 poses from which rounding led to either of two stable equilibria."""
    problems, _ = falcons()
    asked = problems.take(np.array(JUMPED))
    solved, settled = newton.solve_many(asked), cdpr.settle_many(asked)
    apart = np.linalg.norm(solved.positions - settled.positions, axis=1)
    assert (apart < THERE).sum() >= len(JUMPED) - 1

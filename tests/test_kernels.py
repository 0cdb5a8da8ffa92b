"""Kernels against NumPy and SciPy at a few poses each, as the Python that they are when little is asked of them.

Robots are lopsided on purpose, so that no axis, sign or term could be another's.
"""

import numpy as np
import pytest
from scipy.linalg import eigh
from scipy.spatial.transform import Rotation

import cdpr_sim as cdpr
from cdpr_sim.analysis.workspace import feasibility
from cdpr_sim.core import cable_law
from cdpr_sim.core.status import Status
from cdpr_sim.statics import derivatives, forces, matrix_kernel
from cdpr_sim.statics.forces import mass_matrix
from cdpr_sim.statics.gufuncs import ROOTS
from cdpr_sim.statics.newton import stiffness_of
from cdpr_sim.statics.profiles import catenary

POSES = [(0.3, 0.2, 0.1, 0.05, -0.1, 0.2), (0.45, 0.3, 0.2, -0.1, 0.02, -0.3), (0.2, 0.25, 0.15, 0.0, 0.1, 0.0)]

WRENCH = np.array([0.3, -0.4, -0.5, 0.004, -0.006, 0.003])

KINDS = {
    "plain": {},
    "pulleys": {"pulley_radius": [0.01] * 4 + [0.0] * 4, "pulley_axis": (0, 0, 1)},
    "stiffening": {"stiffening": (8.0, -20.0)},
}


def lopsided(kind: str = "plain", name: str = "cogiro") -> cdpr.Robot:
    """DemoBot with an eccentric mass, a full inertia, and cables no two of which are alike."""
    robot = cdpr.load_robot(name)
    return robot.replace(
        axial_stiffness=np.linspace(800, 2500, robot.cables),
        center_of_mass=(0.01, -0.015, 0.02),
        inertia=[[4e-4, 1e-5, -2e-5], [1e-5, 5e-4, 3e-5], [-2e-5, 3e-5, 6e-4]],
        **KINDS[kind],
    )


def solved(kind: str, wrench=WRENCH * [1, 1, 1, 4, 4, 4]) -> cdpr.EquilibriumBatch:
    return cdpr.solve_many(lopsided(kind), POSES, external_wrench=wrench)


@pytest.mark.parametrize("kind", KINDS)
def test_rests_balance_and_are_minima(kind):
    """By the forces and the stiffness matrix of NumPy; lengths and tensions are NumPy's; few steps lead there."""
    equilibria = solved(kind)
    assert equilibria.converged.all()
    state = forces.at(equilibria.problems, equilibria.positions, equilibria.rotations)
    assert np.abs(state.residual).max() < 1e-8
    np.testing.assert_allclose(equilibria.residuals, state.residual, atol=1e-8)
    np.testing.assert_allclose(equilibria.lengths, state.lengths, rtol=1e-14)
    np.testing.assert_allclose(equilibria.tensions, state.tensions, atol=1e-9)
    assert (state.eigenvalues[:, 0] > 0).all()
    assert equilibria.iterations.max() <= 11  # as measured
    np.testing.assert_allclose(
        equilibria.rotations @ equilibria.rotations.swapaxes(1, 2), np.tile(np.eye(3), (3, 1, 1)), atol=1e-12
    )


@pytest.mark.parametrize("kind", KINDS)
def test_eigenvalues_and_frequencies_are_numpys(kind):
    """Of the stiffness matrix, and of it over the mass matrix, about rests without a torque."""
    equilibria = solved(kind, WRENCH * [1, 1, 1, 0, 0, 0])
    state = forces.at(equilibria.problems, equilibria.positions, equilibria.rotations)
    values, frequencies = stiffness_of(equilibria)
    np.testing.assert_allclose(values, state.eigenvalues, rtol=1e-9)
    for row, rotation in enumerate(equilibria.rotations):
        squares = eigh(state.stiffness_matrix[row], mass_matrix(equilibria.problems[row], rotation))[0]
        assert frequencies[row] == pytest.approx(np.sqrt(squares[0]) / (2 * np.pi), rel=1e-9)


def test_slack_cables_and_planar_robots_rest_where_forces_balance():
    """Four slack cables at the end of the paper's line; two free translations and one rotation; another mass."""
    for name, pose in (
        ("parallel", (0.17, 0.25, 0.1)),
        ("planar-vertical", (0.17, 0, 0.1)),
        ("two-cable", (0.3, 0, 0.2)),
    ):
        robot = cdpr.load_robot(name)
        equilibria = cdpr.solve_many(robot, [pose], mass=[0.7])
        assert equilibria.converged.all()
        state = forces.at(equilibria.problems, equilibria.positions, equilibria.rotations)
        assert state.residual[0] < 1e-8
        assert state.eigenvalues[0, 0] > 0
        np.testing.assert_array_equal(equilibria.slack, state.tensions <= 0)
        assert equilibria.iterations[0] <= 12
        np.testing.assert_allclose(stiffness_of(equilibria)[0], state.eigenvalues, rtol=1e-7)


def test_a_balanced_platform_is_left_for_one_that_hangs():
    """What balances with its mass on top turns over; nan stays nan, and a spun platform finds no rest."""
    top_heavy = cdpr.Robot(  # 2 EA/l0 b² = 1 N m/rad against m g h = 2 N m/rad
        [[-0.1, 0, 1], [0.1, 0, 1]], [[-0.1, 0, 0], [0.1, 0, 0]], 50.0, 1.0, mobility="planar",
        center_of_mass=(0, 0, 0.2),
    )  # fmt: skip
    assert cdpr.solve(top_heavy, (0, 0, 0)).tilt > np.radians(90)
    nowhere = cdpr.solve_many(lopsided(), [(np.nan, 0.25, 0.1)])
    assert nowhere.status[0] == Status.NOT_FINITE
    spun = cdpr.solve_many(cdpr.load_robot("parallel"), [POSES[0]], external_wrench=[0, 0, 0, 0, 0, 50.0])
    assert not spun.converged[0]


@pytest.mark.parametrize("kind", ["plain", "pulleys"])
@pytest.mark.parametrize("limits", [(0.02, 6.0), (0.2, 2.5), (0.4, 1.5)])
def test_feasibility_and_margins_are_those_of_linear_programming(kind, limits):
    """At poses within and without, between limits, against two wrenches."""
    robot = lopsided(kind)
    wrenches = np.array([WRENCH, -2 * WRENCH])
    poses = np.array([(0.4, 0.25, 0.2), (0.4, 0.25, 0.4), (0.25, 0.2, 0.3), (0.7, 0.4, 0.4), (0.1, 0.1, 0.45)])
    held = cdpr.feasible(robot, poses, tension_limits=limits, wrenches=wrenches)
    margins = feasibility.capacity_margin(robot, poses, tension_limits=limits, wrenches=wrenches)
    by_programming = [
        feasibility.feasible_by_linprog(robot, pose, tension_limits=limits, wrenches=wrenches) for pose in poses
    ]
    assert held.tolist() == by_programming
    assert not all(by_programming)
    assert any(by_programming) or limits[0] > 0.1
    np.testing.assert_array_equal(margins > 0, held)
    for pose, margin in zip(poses, margins, strict=True):  # just held with limits that are moved by the margin
        for inside, moved in ((True, margin - 1e-6), (False, margin + 1e-6)):
            low, high = limits[0] + moved, limits[1] - moved
            if low >= 0:
                asked = dict(tension_limits=(low, high), wrenches=wrenches)
                assert feasibility.feasible_by_linprog(robot, pose, **asked) == inside
                assert bool(cdpr.feasible(robot, pose, **asked)) == inside


def test_heavy_cables_rest_where_catenaries_balance():
    """Some heavy, some massless; under a wrench with a torque."""
    robot = lopsided().replace(linear_density=[2e-3, 0, 1e-3, 0, 3e-3, 1e-3, 0, 5e-4])
    for equilibria in (cdpr.solve_many(robot, POSES, external_wrench=WRENCH), cdpr.solve_many(robot, POSES)):
        assert equilibria.converged.all()
        state = forces.at(equilibria.problems, equilibria.positions, equilibria.rotations)
        assert np.abs(state.residual).max() < 1e-7
        np.testing.assert_allclose(equilibria.tensions, state.tensions, rtol=1e-9)
        np.testing.assert_allclose(equilibria.lengths, state.lengths, rtol=1e-12)
        assert (state.eigenvalues[:, 0] > 0).all()
        assert equilibria.iterations.max() <= 20
        light = cdpr.solve_many(
            robot.replace(linear_density=0.0), POSES, external_wrench=equilibria.problems.external_wrench
        )
        assert (equilibria.iterations > light.iterations).all()  # which are counted as well


@pytest.mark.parametrize(
    "cable",
    [
        (0.3, 0.2, -0.4, 0.5, 0.01),
        (0.3, 0.2, 0.1, 0.6, 2.0),
        (0.0, 0.0, -0.7, 0.5, 0.3),
        (0.0, 0.0, -0.3, 0.5, 0.3),
        (0.3, 0.1, 0.4, 0.51, 0),
    ],
)
def test_a_catenarys_pull_and_stiffness_are_slopes_of_its_energy(cable):
    """Taut, slack, plumb and massless; and its tensions are those of its pull."""
    *away, length, weight = cable

    def at(step=(0.0, 0.0, 0.0)):
        return catenary([0.1, 0.2, 0.3], np.array([0.1, 0.2, 0.3]) + away + step, length, 50.0, weight)

    found, step = at(), 1e-5
    for axis, unit in enumerate(np.eye(3)):
        more, less = at(step * unit), at(-step * unit)
        assert (less.energy - more.energy) / (2 * step) == pytest.approx(found.pull[axis], abs=1e-5)
        if axis == 2 or away[0] != 0:  # a plumb slack one hardly resists being moved aside, and more the further
            by_difference = (less.pull - more.pull) / (2 * step)
            np.testing.assert_allclose(by_difference, found.stiffness[axis], rtol=1e-3, atol=2e-4)
    assert found.anchor_tension == pytest.approx(np.linalg.norm(found.pull), abs=1e-9)
    upper = np.add(found.pull, (0, 0, weight * length))
    assert found.exit_tension == pytest.approx(np.linalg.norm(upper), abs=1e-9)


def test_matrices_are_factorised_as_by_numpy():
    """Factors, substitution and eigenvalues of symmetric ones; what is indefinite has no factors."""
    rng = np.random.default_rng(1)
    for _ in range(5):
        half = rng.normal(size=(6, 6))
        S, rhs, x = half @ half.T + 0.1 * np.eye(6), rng.normal(size=6), np.empty(6)
        L = S.copy()
        assert matrix_kernel.factorise(L, 6)
        cholesky = (np.tril(L, -1) + np.eye(6)) / np.sqrt(np.diag(L))
        np.testing.assert_allclose(cholesky, np.linalg.cholesky(S), atol=1e-12)
        matrix_kernel.substitute(L, rhs, x)
        np.testing.assert_allclose(S @ x, rhs, atol=1e-9)
        other = half + half.T
        d, memory = np.empty(6), matrix_kernel.Tridiagonal(np.empty(6), np.empty(6), np.empty(6))
        apart = np.kron(np.eye(2), half[:3, :3] + half[:3, :3].T)  # each eigenvalue twice
        tridiagonal = np.diag(np.diag(half)) + np.eye(6, k=1) + np.eye(6, k=-1)
        for symmetric in (other, tridiagonal, apart, np.diag(np.diag(half)), half[:, :2] @ half[:, :2].T, 0 * half):
            matrix_kernel.eigenvalues_of(np.tril(symmetric), memory, d)
            np.testing.assert_allclose(d, np.linalg.eigvalsh(symmetric), atol=1e-12)
        assert not matrix_kernel.factorise(other.copy(), 6)


@pytest.mark.parametrize("kind", [*KINDS, "heavy"])
def test_slopes_are_those_of_differences_whatever_the_cables(kind):
    """Of energy and net wrench by the pose, away from equilibrium; of both by the radius of each wheel."""
    robot = lopsided("plain" if kind == "heavy" else kind)
    robot = robot.replace(linear_density=0.02) if kind == "heavy" else robot
    rest = 0.98 * robot.rest_lengths(POSES[0])
    position, rotation = np.array([0.32, 0.22, 0.13]), Rotation.from_rotvec([0.1, -0.2, 0.3])

    def at(step, changed=robot) -> forces.State:
        turned = (Rotation.from_rotvec(step[3:]) * rotation).as_matrix()
        return forces.at(cdpr.Problem.of(changed, POSES[0], rest), position + step[:3], turned)

    state, small = at(np.zeros(6)), 1e-6
    for axis, unit in enumerate(np.eye(6)):
        more, less = at(small * unit), at(-small * unit)
        assert (less.energy - more.energy) / (2 * small) == pytest.approx(state.net_wrench[axis], rel=1e-6, abs=1e-6)
        by_difference = (more.net_wrench - less.net_wrench) / (2 * small)
        np.testing.assert_allclose(derivatives.wrench_slope(state)[:, axis], by_difference, rtol=1e-5, atol=1e-3)
    np.testing.assert_allclose(state.residual, np.abs(state.net_wrench / robot.units).max())
    for cable in np.flatnonzero(robot.cabling.pulleys):
        radii = [robot.cabling.pulley_radius + sign * small * (np.arange(8) == cable) for sign in (1, -1)]
        more, less = (at(np.zeros(6), robot.replace(pulley_radius=radius)) for radius in radii)
        by_wrench = derivatives.wrench_by_parameter(state)["pulley_radius"][:, cable]
        by_tension = derivatives.tension_by_parameter(state)["pulley_radius"][:, cable]
        np.testing.assert_allclose(by_wrench, (more.net_wrench - less.net_wrench) / (2 * small), rtol=1e-4, atol=1e-3)
        np.testing.assert_allclose(by_tension, (more.tensions - less.tensions) / (2 * small), rtol=1e-4, atol=1e-3)


def test_cables_are_cut_for_the_tensions_that_are_asked():
    """With a law that stiffens as well."""
    for kind in ("plain", "stiffening"):
        robot, tensions = lopsided(kind), np.linspace(1, 20, 8)
        lengths = robot.rest_lengths(POSES[0])
        rest = cable_law.rest_length_for(lengths, tensions, *robot.cabling.law)
        pose = robot.pose(POSES[0])
        state = forces.at(cdpr.Problem.of(robot, pose, rest), pose.translation, pose.rotation.as_matrix())
        np.testing.assert_allclose(state.tensions, tensions, rtol=1e-9)


@pytest.mark.parametrize("kind", KINDS)
def test_roots_of_the_net_wrench_are_those_of_numpy(kind):
    """From anywhere, the wrench that is left is the one of NumPy there; from near an equilibrium, none is."""
    robot, force = lopsided(kind), WRENCH * [1, 1, 1, 0, 0, 0]
    problem = cdpr.Problem.of(robot, POSES[0], external_wrench=force)
    equilibrium = cdpr.solve(problem)
    turns = Rotation.from_rotvec([(0.0, 0.0, 0.0), (0.01, -0.02, 0.01), (0.3, 0.2, -0.2)]).as_matrix()
    with np.errstate(all="ignore"):
        positions, rotations, left = ROOTS[robot.cabling.bent](
            robot.cable_table(), problem.rest_lengths, robot.weight, robot.center_of_mass, force, np.ones(6),
            robot.characteristic_length, 1e-11 * problem.load, 1e-2, equilibrium.position + 1e-3,
            turns @ equilibrium.rotation.as_matrix(),
        )  # fmt: skip
    net = np.linalg.norm(forces.at(problem, positions, rotations).net_wrench / robot.units, axis=1)
    np.testing.assert_allclose(left, net, rtol=1e-6, atol=1e-9)
    assert left[:2].max() < 1e-9 * problem.load

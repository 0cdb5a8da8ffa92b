"""Many are as one by one: rows, columns, threads and layouts of every batch against the single call."""

import threading

import numpy as np
import pytest
from sample_problems import VARIED
from scipy.spatial.transform import Rotation

import cdpr_sim as cdpr
from cdpr_sim.analysis.workspace.feasibility import capacity_margin, feasible_by_linprog
from cdpr_sim.core import on_threads
from cdpr_sim.statics import derivatives, forces
from cdpr_sim.statics.profiles import catenary, profile

FEW, MANY = 5, 1100
"""Rows of a batch: such large ones have code of their own."""

SAME = 1e-9
"""[m, and of the weight] Where both stop at an unbalanced force of 2e-9 of the load, and roundings differ."""

DIFFERENCED = 1e-8
"""Of derivatives by properties of cables with mass: of differences, rounding leaves 1e-9."""

KINK = 1e-7
"""[m] A cable closer to its rest length is taut or slack by rounding alone, and the stiffness jumps there."""


def wheels(robot: cdpr.Robot) -> dict:
    some = np.arange(robot.cables) % 2 == 0
    return dict(
        pulley_radius=np.where(some, 0.008, 0.0), pulley_axis=(0, 0, 1), winch_to_exit=0.3, stiffening=(8.0, -20.0),
        reeving=np.where(some, 1, 2), axial_stiffness=1e3,
    )  # fmt: skip


def with_mass(robot: cdpr.Robot) -> dict:
    return wheels(robot) | {"linear_density": np.where(np.arange(robot.cables) % 3 == 0, 2e-3, 0.0)}


ROBOTS = {name: (name, lambda robot: {}) for name in (*VARIED, "parallel")}
ROBOTS |= {
    f"{name} {what}": (name, changes)
    for name in ("cogiro", "parallel", "planar-vertical")
    for what, changes in (("over wheels", wheels), ("with mass", with_mass))
}


@pytest.mark.parametrize("name", ROBOTS)
def test_an_equilibrium_does_not_depend_on_how_many_are_asked_for(name) -> None:
    """Statics of few poses, of many, and of one, under a wrench of its own; and their eigenvalues."""
    of, changes = ROBOTS[name]
    robot = cdpr.load_robot(of)
    robot = robot.replace(**changes(robot))
    random, count = np.random.default_rng(5), MANY if robot.cabling.massless else 150
    poses = random.uniform(*robot.workspace, (count, 3))
    load = 0.1 * robot.weight * random.normal(size=(count, 6)) * np.repeat([1, robot.characteristic_length], 3)
    load[:, np.setdiff1d(np.arange(6), robot.free)] = 0
    many = cdpr.solve_many(robot, poses, external_wrench=load)
    few = cdpr.solve_many(robot, poses[-FEW:], external_wrench=load[-FEW:])
    assert (few.status == many.status[-FEW:]).all()
    for row in np.flatnonzero(few.converged):
        one = cdpr.solve(robot, poses[row - FEW], external_wrench=load[row - FEW])
        steady = one.stable and np.abs(one.lengths - one.rest_lengths).min() > KINK
        for other in (few[row], many[row - FEW]):
            assert np.abs(one.position - other.position).max() <= SAME
            assert np.abs(one.lengths - other.lengths)[one.stable].max(initial=0) <= 2 * SAME
            assert np.abs(one.tensions - other.tensions).max() <= 1e3 * SAME * max(robot.weight, one.tensions.max())
            if steady:
                assert other.eigenvalues == pytest.approx(one.eigenvalues, rel=1e-5, abs=1e-9 * one.eigenvalues[-1])
    order = random.permutation(count)
    again = cdpr.solve_many(robot, poses[order], external_wrench=load[order])
    np.testing.assert_array_equal(again.positions, many.positions[order])  # neighbours change no bit
    np.testing.assert_array_equal(again.iterations, many.iterations[order])


def test_rows_may_differ_in_all_that_problems_may_differ_in(catalogue) -> None:
    """Poses x stiffnesses x masses, rotations and wrenches at once: each as if it was solved alone."""
    robot, random = catalogue["parallel"], np.random.default_rng(1)
    poses = np.hstack([random.uniform(*robot.workspace, (100, 3)), random.uniform(-0.2, 0.2, (100, 3))])
    wrenches = random.normal(size=(100, 6)) * np.repeat([0.1, 0.002], 3)
    stiffnesses, masses = np.array([[1e3], [1e4], [1e5]]), np.array([0.2, 0.4, 0.8, 0.6])
    for rows in (slice(0, 2), slice(0, 100)):
        many = cdpr.solve_many(
            robot, poses[rows, None, None], axial_stiffness=stiffnesses[:, None], mass=masses,
            external_wrench=wrenches[rows, None, None],
        )  # fmt: skip
        assert many.positions.shape == (len(poses[rows]), 3, 4, 3)
        for i, j, k in ((0, 0, 3), (1, 2, 0), (0, 1, 2)):
            alone = robot.replace(axial_stiffness=float(stiffnesses[j, 0]), mass=masses[k])
            one = cdpr.solve(alone, poses[i], external_wrench=wrenches[i])
            np.testing.assert_allclose(many.positions[i, j, k], one.position, rtol=0, atol=SAME)
            assert (many[i, j, k].problem.robot.axial_stiffness == stiffnesses[j, 0]).all()


@pytest.mark.parametrize("rows", [2, 400])
def test_what_is_rare_is_solved_in_a_batch_as_alone(catalogue, rows) -> None:
    """Saddles, poses that are no numbers, cables that leave their wheels, a torque that nothing resists."""
    top_heavy = cdpr.Robot(
        [[-0.1, 0, 1], [0.1, 0, 1]], [[-0.1, 0, 0], [0.1, 0, 0]], 50.0, 1.0, mobility="planar",
        center_of_mass=(0, 0, 0.2),
    )  # fmt: skip
    turned = cdpr.solve_many(top_heavy, np.tile([(0, 0, 0), (0.01, 0, 0), (0, 0, 0.1)], (rows, 1)))
    assert (turned.tilt > np.pi / 2).all()
    spin = np.zeros((3 * rows, 6))
    spin[1::3, 5] = 50.0
    asked = np.tile([(np.nan, 0.25, 0.1), (0.3, 0.2, 0.1), (0.4, 0.25, 2.0)], (rows, 1))
    found = cdpr.solve_many(catalogue["parallel"], asked, external_wrench=spin)
    with pytest.raises(cdpr.NotConverged) as failure:
        cdpr.solve(catalogue["parallel"], asked[1], external_wrench=spin[1])
    assert set(found.status[0::3]) == {cdpr.Status.NOT_FINITE}
    assert set(found.status[2::3]) == {cdpr.Status.FALLS}
    assert cdpr.Status(int(found.status[-2])).sentence in str(failure.value)
    np.testing.assert_array_equal(found.positions[-2], failure.value.equilibrium.position)
    over = catalogue["planar-vertical"].replace(pulley_radius=0.05)
    poses = np.random.default_rng(5).uniform(*over.workspace, (40, 3))
    found = cdpr.solve_many(over, np.tile(poses, (1 + rows // 20, 1)))
    assert set(found.status) == {cdpr.Status.CONVERGED, cdpr.Status.OFF_WHEEL}
    for row in range(0, 40, 8):
        if found.converged[row]:
            np.testing.assert_allclose(found.positions[row], cdpr.solve(over, poses[row]).position, rtol=0, atol=SAME)


@pytest.mark.parametrize("name", ["cogiro", "ipanema-1", "planar-vertical", "parallel over wheels"])
def test_frequencies_of_a_sweep_are_those_of_natural_modes(name) -> None:
    """The lowest one, at few poses and at many; 0 where a direction is free; and the eigenvalues."""
    of, changes = ROBOTS[name]
    robot = cdpr.load_robot(of).replace(center_of_mass=(0.01, 0, -0.02))
    robot = robot.replace(**changes(robot))
    for count in (FEW, MANY):
        poses = np.random.default_rng(2).uniform(*robot.workspace, (count, 3))
        swept = cdpr.sweep(robot, poses=poses, quantities=["eigenvalues", "frequency"], chunk=None)
        compared = 0
        for row in range(FEW):
            one = cdpr.solve(robot, poses[row])
            if one.stable and np.abs(one.lengths - one.rest_lengths).min() > KINK:
                modes = cdpr.natural_modes(one)
                assert float(swept.frequency.values.ravel()[row]) == pytest.approx(modes.frequencies[0], rel=1e-5)
                values = swept.eigenvalues.values.reshape(count, -1)[row]
                assert values == pytest.approx(one.eigenvalues, rel=1e-5, abs=1e-9 * one.eigenvalues[-1])
                compared += 1
        assert compared > 1


# --- rigid cables --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("limits", [None, (0.1, 3.0)])
@pytest.mark.parametrize("name", ROBOTS)
def test_workspaces_of_many_poses_are_those_of_each(name, limits) -> None:
    """Feasibility, shortfall and margin, against two loads; a row without numbers disturbs no other."""
    of, changes = ROBOTS[name]
    robot = cdpr.load_robot(of)
    robot = robot.replace(**changes(robot))
    poses, loads = np.random.default_rng(5).uniform(*robot.workspace, (MANY, 3)), np.zeros((2, 6))
    loads[1, [0, 2, 4]] = 0.1 * robot.weight * np.array([1, 0.3, 0.01])
    poses[1] = np.nan
    given = dict(tension_limits=limits, wrenches=loads)
    left, holds = (f(robot, poses, **given) for f in (cdpr.shortfall, cdpr.feasible))
    margin = capacity_margin(robot, poses[:FEW], **given)
    assert np.isnan([left[1], margin[1]]).all()
    assert not holds[1]
    for row in (0, 2, 3, 4):
        one = cdpr.shortfall(robot, poses[row], **given)
        assert left[row] == pytest.approx(one, abs=1e-13)
        assert holds[row] == cdpr.feasible(robot, poses[row], **given)
        assert margin[row] == pytest.approx(capacity_margin(robot, poses[row], **given), abs=1e-12 * robot.weight)
        if robot.cabling.massless and not 1e-9 < one < 1e-6:
            assert holds[row] == feasible_by_linprog(robot, poses[row], **given)


# --- threads -------------------------------------------------------------------------------------------------------

ROWS = 2500
"""More than two pieces' worth."""

MASSES = np.linspace(0.2, 0.6, ROWS)

ON_THREADS = {
    "solve_many": lambda robot, poses, n: cdpr.solve_many(robot, poses, mass=MASSES, threads=n).positions,
    "few long rows": lambda robot, poses, n: (
        cdpr.solve_many(robot, np.resize(poses, (5, 700, 3)), threads=n).positions  # two pieces: one row is too few
    ),
    "columns": lambda robot, poses, n: cdpr.solve_many(robot, poses[:, None], mass=[0.3, 0.5], threads=n).tensions,
    "broadcast": lambda robot, poses, n: cdpr.solve_many(robot, poses[:1], mass=MASSES, threads=n).rotations,
    "shortfall": lambda robot, poses, n: cdpr.shortfall(robot, poses, threads=n),
    "feasible": lambda robot, poses, n: cdpr.feasible(robot, poses, threads=n),
    "capacity_margin": lambda robot, poses, n: capacity_margin(robot, poses, threads=n),
}


@pytest.mark.parametrize("name", ON_THREADS)
def test_threads_change_no_result(catalogue, name, monkeypatch) -> None:
    """One thread or three, to the last bit; and there are three."""
    used, submitted = set(), on_threads.ThreadPoolExecutor.submit

    def submit(self, function, *arguments):
        return submitted(self, lambda: (used.add(threading.get_ident()), function(*arguments))[1])

    monkeypatch.setattr(on_threads.ThreadPoolExecutor, "submit", submit)
    robot = catalogue["parallel"]
    poses = np.random.default_rng(0).uniform(*robot.workspace, (ROWS, 3))
    one = ON_THREADS[name](robot, poses, 1)
    assert not used
    np.testing.assert_array_equal(ON_THREADS[name](robot, poses, 3), one)
    assert used


# --- paths, and what statics consist of ----------------------------------------------------------------------------


def test_paths_side_by_side_are_those_paths() -> None:
    """Of ropes with every memory, at three heights at once, with their memories at the end."""
    robot = cdpr.load_robot("cogiro").replace(
        pulley_friction=0.1, winch_to_exit=0.8, hysteresis=[(0.15, 4e-5), (0.1, 1.5e-4, 0.8)], creep=[(4e4, 3.0)],
        reeving=2, pulley_radius=0.01,
    )  # fmt: skip
    there = np.linspace([0.2, 0.25, 0.1], [0.6, 0.25, 0.1], 5)
    heights = np.concatenate([there, there[-2::-1]])[:, None] + [[0, 0, 0], [0, 0, 0.05], [0, 0, 0.1]]
    paths = cdpr.solve_path(robot, heights, times=np.arange(9.0), steps=2)
    assert paths.shape == (9, 3)
    for one in range(3):
        alone = cdpr.solve_path(robot, heights[:, one], times=np.arange(9.0), steps=2)
        assert np.abs(paths.positions[:, one] - alone.positions).max() < 5e-12
        assert paths.eigenvalues[:, one] == pytest.approx(alone.eigenvalues, rel=1e-9)
        assert paths.memory.beyond[one] == pytest.approx(alone.memory.beyond, abs=5e-12)


STATE = (
    "tensions", "lengths", "wrench_matrix", "load_wrench", "net_wrench", "residual", "energy", "stiffness_matrix",
    "eigenvalues", "tangent_stiffness",
)  # fmt: skip


@pytest.mark.parametrize("kind", ["plain", "with mass"])
def test_forces_and_derivatives_at_many_poses_are_those_at_each(kind) -> None:
    """Of one problem or of as many, with masses and stiffnesses of their own, taut and slack."""
    robot, random = cdpr.load_robot("parallel").replace(center_of_mass=(0.01, 0.02, -0.01)), np.random.default_rng(0)
    if kind == "with mass":
        robot = robot.replace(linear_density=[5e-4] * 4 + [0.0] * 4, pulley_radius=0.005)
    positions = random.uniform([0.1, 0.1, 0.05], [0.7, 0.4, 0.4], (2, 3, 3))
    rotations = Rotation.from_rotvec(0.3 * random.normal(size=(6, 3))).as_matrix().reshape(2, 3, 3, 3)
    one, many = cdpr.Problem.of(robot, (0.2, 0.25, 0.1)), cdpr.Problems.of(
        robot, positions, external_wrench=random.normal(size=(2, 3, 6)), mass=[1.0, 2, 3],
        axial_stiffness=random.uniform(1e3, 1e5, (2, 3, 8)),
    )  # fmt: skip
    for asked, alone in ((one, one), (many, many[1, 2])):
        together, single = forces.at(asked, positions, rotations), forces.at(alone, positions[1, 2], rotations[1, 2])
        for name in STATE:
            value = getattr(single, name)
            near = dict(rtol=1e-9, atol=1e-10 * np.abs(value).max(), err_msg=name)
            np.testing.assert_allclose(getattr(together, name)[1, 2], value, **near)
        names = derivatives.parameters(robot)
        by, by_many = (derivatives.by_parameter(state, names) for state in (single, together))
        for name in names:
            for each, alone in zip(by_many[name], by[name], strict=True):
                far = np.abs(each[1, 2] - alone).max()
                assert far <= DIFFERENCED * np.abs(alone).max(), name


def test_hanging_cables_are_asked_at_once() -> None:
    """Everything broadcasts, row by row as one by one."""
    random = np.random.default_rng(1)
    A, L0, EA, w = (
        random.normal(size=(6, 3)),
        random.uniform(0.5, 2, 6),
        10 ** random.uniform(2, 4, 6),
        np.arange(1.0, 7),
    )
    B = A + random.normal(size=(6, 3)) * 0.5
    table = catenary(A[:, None], B, L0, EA, w)
    assert (table.pull.shape, table.stiffness.shape) == ((6, 6, 3), (6, 6, 3, 3))
    np.testing.assert_array_equal(table.pull[2, 4], catenary(A[2], B[4], L0[4], EA[4], w[4]).pull)
    np.testing.assert_array_equal(profile(A, B, L0, EA, w, 7)[3], profile(A[3], B[3], L0[3], EA[3], w[3], 7))

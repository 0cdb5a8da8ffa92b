"""Eight problems at once: lanes compute what one number would, and batches get the answers of the solver for one."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import cdpr_sim as cdpr
from cdpr_sim.analysis.equilibria import _starts
from cdpr_sim.analysis.workspace.feasibility import feasible_by_linprog
from cdpr_sim.core import compiling
from cdpr_sim.core.cable import COLUMNS
from cdpr_sim.core.status import Status
from cdpr_sim.design.layout_equilibria import Cases, solve_layouts
from cdpr_sim.design.moves import Move, Space
from cdpr_sim.statics import balance_kernel, cable_kernel, forces, newton_kernel, stiffness_kernel
from cdpr_sim.statics.balance_kernel import BALANCED
from cdpr_sim.statics.gufuncs import ROOTS
from cdpr_sim.statics.newton import stiffness_of

SAME = 1e-9
"""Largest difference between a position on lanes and from the solver for one problem [m]: both stop where an unbalanced
force of 2e-9 of the load is left, and roundings differ."""

EIGENVALUES = 1e-12
"""Largest difference between an eigenvalue and LAPACK's, as a fraction of the largest: 4e-15 measured."""

KINK = 1e-12
"""[m] A cable closer to its rest length is taut or slack by rounding alone, and the stiffness jumps there."""

PACKAGE = Path(cdpr.__file__).parents[1]

POSES = 64
"""Of each robot. Lanes are made to solve so few here."""


@pytest.fixture(scope="module")
def massless(catalogue) -> dict[str, cdpr.Robot]:
    """All robots of the catalogue without mass; and some over pulleys, with nonlinear laws, drive lines and reeving."""
    robots = {name: robot for name, robot in catalogue.items() if robot.cabling.massless}
    for name in ("cogiro", "parallel", "planar-vertical"):
        robot = robots[name]
        some = np.arange(len(robot.exits)) % 2 == 0
        robots[f"{name} over pulleys"] = robot.replace(pulley_radius=0.01)
        robots[f"{name} with a law"] = robot.replace(stiffening=(3.0, 2.0))
        robots[f"{name} with everything"] = robot.replace(
            pulley_radius=np.where(some, 0.02, 0.0), pulley_axis=(0, 0, 1), winch_to_exit=0.3, stiffening=(8.0, -20.0),
            reeving=np.where(some, 1, 2), axial_stiffness=1e3,
        )  # fmt: skip
    return robots


@pytest.fixture
def on_lanes(monkeypatch):
    """Calls a function with lanes, whatever the number of problems, and again without them."""

    def both(function, *arguments, **keywords):
        found = []
        for least in (1, np.inf):
            monkeypatch.setattr(compiling, "LANES_FROM", least)
            found.append(function(*arguments, **keywords))
        return found

    return both


def apart(one: cdpr.EquilibriumBatch, other: cdpr.EquilibriumBatch) -> float:
    """Largest distance between equilibria [m], and of rotations times a tenth of a metre."""
    assert (one.status == other.status).all()
    found = one.converged
    turned = 0.1 * np.abs(one.rotations - other.rotations)[stable(one)].max(initial=0.0)
    return max(np.abs(one.positions - other.positions)[found].max(initial=0.0), turned)


def stable(equilibria: cdpr.EquilibriumBatch) -> np.ndarray:
    """Which are stable: where an equilibrium is neutral, some rotations are as good as others."""
    return equilibria.stability == cdpr.Stability.STABLE


def poses_in(robot: cdpr.Robot, count: int = POSES, seed: int = 5) -> np.ndarray:
    return np.random.default_rng(seed).uniform(robot.workspace[0], robot.workspace[1], (count, 3))


def test_batches_get_the_answers_of_the_solver_for_one_whatever_the_robot(massless, on_lanes):
    """Every robot without mass, spatial or planar, with and without an external wrench; tensions and lengths too."""
    seen = set()
    for name, robot in massless.items():
        seen.add(robot.mobility)
        load = 0.2 * robot.weight * np.array([1, 0, 0.3, 0, 0.05, 0])
        if robot.mobility == "spatial":
            load += 0.1 * robot.weight * np.array([0, 1, 0, 0.02, 0, -0.03])
        for wrench in (None, load):
            lanes, one = on_lanes(cdpr.solve_many, robot, poses_in(robot), external_wrench=wrench)
            assert apart(lanes, one) <= SAME, name
            difference = np.abs(lanes.lengths - one.lengths)[stable(one)]
            assert difference.max() <= 2 * SAME, name
            tensions = one.tensions[one.converged]
            np.testing.assert_allclose(lanes.tensions[one.converged], tensions, rtol=0, atol=1e-6 * tensions.max())
            # Rounding decides some steps: of 64 poses at most one takes another way for a while.
            assert (np.abs(lanes.iterations - one.iterations) > 1).sum() <= 1, name
    assert seen == {"spatial", "planar"}


def test_rows_may_differ_in_all_that_problems_may_differ_in(catalogue, on_lanes):
    """Mass, stiffness, load and rotation per row; and no row's answer depends on its neighbours, to the last bit."""
    robot, rng = catalogue["parallel"], np.random.default_rng(1)
    each = dict(
        mass=rng.uniform(0.3, 0.6, POSES),
        axial_stiffness=rng.uniform(500, 2e4, (POSES, 1)),
        external_wrench=rng.normal(size=(POSES, 6)) * [0.1, 0.1, 0.1, 0.002, 0.002, 0.002],
    )
    poses = np.hstack([poses_in(robot), rng.uniform(-0.2, 0.2, (POSES, 3))])
    lanes, one = on_lanes(cdpr.solve_many, robot, poses, **each)
    assert lanes.converged.all()
    assert apart(lanes, one) <= SAME
    order = rng.permutation(POSES)[: POSES // 2]
    some = {name: value[order] for name, value in each.items()}
    again, _ = on_lanes(cdpr.solve_many, robot, poses[order], **some)
    np.testing.assert_array_equal(again.positions, lanes.positions[order])
    np.testing.assert_array_equal(again.iterations, lanes.iterations[order])


def test_layouts_are_solved_on_lanes(catalogue, on_lanes):
    """Exits, centres of mass and characteristic lengths differ from layout to layout; cables are plain."""
    robot = catalogue["parallel"]
    cases = Cases.of(robot, [(x, 0.25, 0.1) for x in np.linspace(0.25, 0.55, 6)])
    space = Space.of(robot, [Move("exits", 0.02), Move("anchors", 0.005)])
    tried = np.random.default_rng(2).uniform(space.lower, space.upper, (POSES // 4, len(space)))
    lanes, one = on_lanes(solve_layouts, space.layouts(tried), cases, threads=1)
    assert lanes.status.shape == (POSES // 4, 6)
    assert apart(lanes, one) <= SAME


def test_what_is_rare_is_left_to_the_solver_for_one(on_lanes):
    """Saddles, input that is not finite, cables off their wheels, no equilibrium: as by the other solver."""
    top_heavy = cdpr.Robot(
        [[-0.1, 0, 1], [0.1, 0, 1]], [[-0.1, 0, 0], [0.1, 0, 0]], 50.0, 1.0, mobility="planar",
        center_of_mass=(0, 0, 0.2),
    )  # fmt: skip
    lanes, one = on_lanes(cdpr.solve_many, top_heavy, [(0, 0, 0), (0.01, 0, 0), (0, 0, 0.1)])
    assert (lanes.tilt > np.pi / 2).all()
    assert apart(lanes, one) <= SAME
    nowhere, _ = on_lanes(cdpr.solve_many, cdpr.load_robot("cogiro"), [(np.nan, 0.25, 0.1), (0.4, 0.25, 0.1)])
    assert nowhere.status.tolist() == [Status.NOT_FINITE, Status.CONVERGED]
    over = cdpr.load_robot("planar-vertical").replace(pulley_radius=0.05)
    lanes, one = on_lanes(cdpr.solve_many, over, poses_in(over))
    assert set(lanes.status) == {Status.CONVERGED, Status.OFF_WHEEL}
    assert apart(lanes, one) <= SAME
    spin = [0, 0, 0, 0, 0, 50.0]
    spun, alone = on_lanes(cdpr.solve_many, cdpr.load_robot("parallel"), [(0.3, 0.2, 0.1)], external_wrench=spin)
    assert not spun.converged[0]
    np.testing.assert_array_equal(spun.positions, alone.positions)


def test_eigenvalues_and_frequencies_on_lanes_are_numpys(massless, on_lanes):
    """Of every robot without mass, beside LAPACK; a row without numbers has none, and disturbs no other."""
    for name, robot in massless.items():
        poses = poses_in(robot, 13)
        poses[4] = np.nan
        equilibria = cdpr.solve_many(robot, poses)
        lanes, one = on_lanes(stiffness_of, equilibria)
        known = equilibria.converged & (np.abs(equilibria.lengths - equilibria.rest_lengths).min(-1) > KINK)
        assert np.isnan(lanes[0][4]).all()
        assert np.isnan(lanes[1][4])
        assert known.any()
        found = equilibria.problems.take(known)
        state = forces.at(found, equilibria.positions[known], equilibria.rotations[known])
        largest = np.abs(state.eigenvalues).max(-1, keepdims=True)
        assert np.abs((lanes[0][known] - state.eigenvalues) / largest).max() <= EIGENVALUES, name
        np.testing.assert_allclose(lanes[1][known], one[1][known], rtol=1e-6, atol=0, err_msg=name)


def test_stiffness_of_layouts_on_lanes_is_that_of_each(catalogue, on_lanes):
    """Tables, centres of mass and characteristic lengths differ from row to row, and are shared along columns."""
    robot = catalogue["parallel"]
    cases = Cases.of(robot, [(x, 0.25, 0.1) for x in np.linspace(0.25, 0.55, 6)], stiffness=[1.0, 0.5])
    space = Space.of(robot, [Move("exits", 0.02), Move("anchors", 0.005), Move("center_of_mass", 0.01)])
    tried = np.random.default_rng(2).uniform(space.lower, space.upper, (5, len(space)))
    found = solve_layouts(space.layouts(tried), cases, threads=1)
    lanes, one = on_lanes(lambda: stiffness_of(found))
    np.testing.assert_allclose(lanes[0], one[0], rtol=0, atol=EIGENVALUES * one[0].max())
    np.testing.assert_allclose(lanes[1], one[1], rtol=1e-6, equal_nan=True)


@pytest.mark.parametrize("limits", [None, (0.1, 3.0)])
def test_balance_of_forces_on_lanes_is_that_of_linear_programming(massless, on_lanes, limits):
    """Of every robot without mass, against two loads; a row without numbers has none, and disturbs no other."""
    held = set()
    for name, robot in massless.items():
        poses, loads = poses_in(robot, 13), 0.1 * robot.weight * np.array([[0.0] * 6, [1, 0, 0.3, 0, 0.01, 0]])
        poses[4] = np.nan
        lanes, one = on_lanes(cdpr.shortfall, robot, poses, tension_limits=limits, wrenches=loads)
        np.testing.assert_allclose(lanes, one, rtol=0, atol=1e-13, err_msg=name)
        assert np.isnan(lanes[4])
        for row in (0, 1, 12):
            expected = feasible_by_linprog(robot, poses[row], tension_limits=limits, wrenches=loads)
            assert (lanes[row] <= BALANCED) == expected, name
            held.add(expected)
    assert held == {True, False}


def test_roots_on_lanes_are_those_of_the_search_from_one_start(massless):
    """From the same starts, anywhere, to the same roots, or to none; each start alone as among its neighbours."""
    for name, robot in massless.items():
        force = 0.1 * robot.weight * np.array([1, 0, 0.3, 0, 0, 0])
        problem, free = cdpr.Problem.of(robot, robot.workspace.mean(0), external_wrench=force), np.zeros(6)
        free[robot.free] = 1.0
        starts = _starts(problem, POSES, np.random.default_rng(6))
        given = (
            robot.cable_table(), problem.rest_lengths, robot.weight, robot.center_of_mass, force, free,
            robot.characteristic_length, 1e-11 * problem.load, 1e-2,
        )  # fmt: skip
        search = ROOTS[robot.cabling.bent]
        with np.errstate(all="ignore"):
            one, lanes = search.compiled(*given, *starts), search.compiled_for_all(*given, *starts)
            alone = search.compiled_for_all(*given, *(each[5:6] for each in starts))
        found = one[2] <= 1e-8 * problem.load
        assert found.any(), name
        np.testing.assert_array_equal(found, lanes[2] <= 1e-8 * problem.load, name)
        for poses, others, row in zip(one[:2], lanes[:2], alone[:2], strict=True):
            np.testing.assert_allclose(poses[found], others[found], rtol=0, atol=SAME, err_msg=name)
            np.testing.assert_array_equal(others[5], row[0])


def test_a_lane_that_computes_something_else_is_noticed(catalogue, on_lanes, monkeypatch):
    """Negative control: problems that differ by a millionth of their stiffness are further apart than ``SAME``."""
    robot = catalogue["parallel"]
    lanes, _ = on_lanes(cdpr.solve_many, robot, poses_in(robot))
    _, other = on_lanes(cdpr.solve_many, robot, poses_in(robot), axial_stiffness=robot.axial_stiffness * (1 + 1e-6))
    assert apart(lanes, other) > SAME


def test_without_avx_the_answers_are_the_same(catalogue, tmp_path):
    """A processor of 2003: the compiler makes four instructions of one; in a process of its own."""
    robot = catalogue["cogiro"]
    poses = poses_in(robot, compiling.LANES_FROM)
    np.save(tmp_path / "poses.npy", poses)
    code = (
        "import numpy as np, cdpr_sim as cdpr; from cdpr_sim.statics import gufuncs; "
        "found = cdpr.solve_many(cdpr.load_robot('cogiro'), np.load('poses.npy')); "
        "np.save('found.npy', found.positions); "
        "assert found.converged.all() and gufuncs.EQUILIBRIA[0]._compiled is None"
    )
    place = os.environ | {"NUMBA_CPU_NAME": "generic", "PYTHONPATH": str(PACKAGE)}
    subprocess.run([sys.executable, "-c", code], cwd=tmp_path, env=place, check=True)
    equilibria = cdpr.solve_many(robot, poses)
    assert np.abs(np.load(tmp_path / "found.npy") - equilibria.positions).max() <= SAME


@pytest.mark.parametrize("cables", [1, 2, 8, 60])
def test_the_memory_of_lanes_is_enough_for_each_kernel(cables):
    """As counted with the functions that make the arrays; code on lanes would write beyond it without an error."""

    class Counted:
        entries, masks = 0, 0

    @compiling.vector.of(Counted)
    def _vector(room, length):
        room.entries += length
        return np.empty(length)

    @compiling.matrix.of(Counted)
    def _matrix(room, rows, columns):
        room.entries += rows * columns
        return np.empty((rows, columns))

    @compiling.truths.of(Counted)
    def _truths(room, length):
        room.masks += length
        return np.empty(length, np.bool_)

    def solver_or_search(room, bent):
        for _ in range(2):
            newton_kernel.new_point(room, bent)
        newton_kernel.new_model(room, cables)

    def at_a_pose(new_scratch):
        return lambda room, bent: (cable_kernel.new_state(bent, room), new_scratch(room))

    more = {  # beside these: vectors of six numbers, of a number for each cable, and masks
        "solver": (solver_or_search, 5, 3, 2),
        "search": (solver_or_search, 16, 1, 1),
        "stiffness": (at_a_pose(lambda room: stiffness_kernel.new_scratch(room, cables, 6)), 3, 0, 0),
        "balance": (at_a_pose(lambda room: balance_kernel.new_scratch(room, cables)), 3, 3, 0),
    }
    numbers, flags = compiling.memory_of_lanes(cables)
    for arrays, sixes, each, masks in more.values():
        room = Counted()
        bent = list(cable_kernel.TYPES.values())[cable_kernel.BENT](room, np.zeros((cables, COLUMNS)))
        arrays(room, bent)
        assert room.entries + 6 * sixes + each * cables <= len(numbers) // compiling.WIDTH
        assert room.masks + masks * cables <= len(flags)

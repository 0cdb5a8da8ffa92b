import json
import re

import numpy as np
import pytest
from sample_problems import random_problem
from scipy.spatial.transform import Rotation
from typer.testing import CliRunner

import cdpr_sim as cdpr
from cdpr_sim.analysis import compensation
from cdpr_sim.analysis.compensation import MOST_LOADS, MOST_STRAIN
from cdpr_sim.analysis.workspace.feasibility import BALANCED
from cdpr_sim.cli import app
from cdpr_sim.core.pose import moved
from cdpr_sim.crosscheck.compensation_check import held
from cdpr_sim.report import as_json
from cdpr_sim.report.analysis_tables import compensation_table, compensation_verdict
from cdpr_sim.robots.robot_file_text import as_toml
from cdpr_sim.statics import forces, newton
from cdpr_sim.statics.derivatives import wrench_under_tensions
from cdpr_sim.statics.given_tensions import cut

MICROMETRE = 1e-6

ROUNDING = 1e-9
"""Of a limit of tension, as a fraction."""

OF_CABLES = {
    "massless": ({}, 0.999),
    "with mass": ({"linear_density": 1e-4}, 0.99),
}
"""Cables, and the distance, per distance of the nearest pose, within which no pose is feasible."""

NEAREST = {
    ("parallel", (0.17, 0.25, 0.1)): 0.03528348316695387,
    ("two-cable", (0.25, 0, 0.1)): 0.02336114750971086,
    ("ipanema-1", (2.0, 0, 1.0)): 0.11511185760828377,
}
"""Distances [m] of the nearest poses of hard cases, where SLSQP went on until rounding stopped it (ftol = 1e-14)."""

NEAREST_ROUNDING, MOST_EVALUATIONS = 1e-12, 900
"""[m] Measured 2e-14. Measured 243, 181 and 644 evaluations; with ftol = 1e-14, and three of them for each point that
SLSQP tries, 1000 and more."""

SIZED = {"platform_size": (0.1, 0.1, 0.1)}

SLOPE = 1e-7
"""Relative error of differences with steps of 10 micrometres."""

SOFT = 1e-7
"""[m] Likewise where the platform hangs on softly held directions, at the edge of what is reachable."""


def errors(found: cdpr.Equilibrium, pose) -> tuple[float, float]:
    """Of position [m] and rotation [rad]."""
    shift = np.linalg.norm(found.position - pose.translation)
    return float(shift), float((found.rotation * pose.rotation.inv()).magnitude())


def by_mujoco(robot, compensation: cdpr.Compensation) -> tuple[cdpr.Equilibrium, cdpr.Equilibrium]:
    """Where the platform rests with rigid lengths, and where it goes from there when the winches are corrected."""
    before = cdpr.settle(robot, compensation.commanded)
    return before, cdpr.settle(robot, before.pose, compensation.rest_lengths)


def test_no_default_tension_breaks_a_rope_and_one_that_would_is_said_to(catalogue):
    """The stiffest tensions of a stretched robot: a fifth of the breaking load, or a word in result, table and JSON."""
    robot = catalogue["ipanema-1"].replace(force_max=np.inf, breaking_load=5000.0)
    pose, bears = robot.home, robot.breaking_load
    found = cdpr.compensate(robot, pose, prefer="stiffest")
    assert found.tensions.max() == pytest.approx(bears[0] / 5, rel=ROUNDING)
    assert not found.overloaded.any()
    assert "breaking" not in repr(found) + compensation_verdict(found)
    torn = cdpr.compensate(robot, pose, tensions=(0, 1.5 * bears), prefer="stiffest")
    np.testing.assert_array_equal(torn.overloaded, torn.tensions > bears)
    assert torn.overloaded.any()
    assert "beyond the breaking load" in repr(torn)
    assert re.search(
        r"Cable 3 would break: tension 7500 N, above its breaking load of 5000 N", compensation_verdict(torn)
    )
    table = compensation_table(torn, [found.equilibrium], [torn.equilibrium])
    assert [list(column.cells)[-3] for column in table.columns] == ["overloaded cables", "0 of 8", "8 of 8"]
    told = as_json.compensation(torn.equilibrium.problem, torn, cdpr.verify_compensation(torn), [], [torn.equilibrium])
    assert told["after"]["compensation"]["overloaded"] == torn.overloaded.tolist()
    assert told["cables"]["breaking_load"] == bears.tolist()


def test_on_parallel_it_says_where_no_lengths_help_and_why(catalogue):
    """In the middle exact; at the ends the nearest pose, a proof that none hold it, and MuJoCo at that nearest pose."""
    robot = catalogue["parallel"]
    assert cdpr.compensate(robot, (0.4, 0.25, 0.1)).exact
    for x in (0.17, 0.63):
        found = cdpr.compensate(robot, (x, 0.25, 0.1))
        assert found.outcome is cdpr.CompensationOutcome.NEAREST
        assert "would have to push" in found.reasons[0]
        assert "without any cable getting longer" in found.reasons[1]
        before, after = by_mujoco(robot, found)
        assert max(errors(after, found.pose)) < SOFT
        arm = robot.characteristic_length
        assert found.distance == pytest.approx(np.hypot(*np.multiply(errors(after, found.commanded), [1, arm])))
        assert found.distance < np.hypot(*np.multiply(errors(before, found.commanded), [1, arm]))


def test_of_the_poses_at_a_position_the_one_with_the_least_rotation_is_found(catalogue):
    """As with an arm of 1 mm, which weighs both: it misses the position by a micrometre, with less rotation."""
    robot = catalogue["parallel"].replace(material="fishing-0.4mm")
    turns = []
    for arm in (0.0, 1e-3):
        found = cdpr.compensate(robot, (0.25, 0.25, 0.1), arm=arm)
        shift, turn = errors(found.equilibrium, found.commanded)
        assert shift < 2e-6
        turns.append(np.degrees(turn))
    assert turns[1] < turns[0] < turns[1] + 0.01


@pytest.mark.parametrize("kind", OF_CABLES)
def test_no_pose_nearer_than_the_nearest_is_feasible(catalogue, kind):
    """By the workspace's own method, on thousands of poses nearer to the commanded one than what was found.

    That method is of the first order in the weight of cables with mass over their tension. MuJoCo holds the platform
    at the nearest pose with the lengths for it, and not with those for massless cables.
    """
    changes, beyond = OF_CABLES[kind]
    robot = catalogue["planar-vertical"].replace(**changes)
    limits = (0.01 * robot.weight, np.inf)
    found = cdpr.compensate(robot, (0.2, 0, 0.1), tensions=limits)
    assert found.outcome is cdpr.CompensationOutcome.NEAREST
    steps = np.random.default_rng(0).normal(size=(5000, 3)) * found.distance / np.sqrt(3)
    steps = steps[np.linalg.norm(steps, axis=1) < beyond * found.distance]
    assert len(steps) > 2000
    positions = found.commanded.translation + steps * [1, 0, 1]
    turned = Rotation.from_rotvec(steps[:, 1:2] / robot.characteristic_length * [0.0, 1, 0]).as_matrix()
    assert cdpr.shortfall(robot, positions, rotations=turned, tension_limits=limits).min() > BALANCED
    # Negative control: what was found is feasible, but for its limits' rounding.
    there, turn = found.pose.translation, found.pose.rotation.as_matrix()
    assert cdpr.shortfall(robot, there, rotations=turn, tension_limits=(0.99 * limits[0], np.inf)) < BALANCED
    assert (found.tensions >= limits[0] * (1 - ROUNDING)).all()
    assert max(errors(cdpr.settle(robot, found.pose, found.rest_lengths), found.pose)) < SOFT
    if changes:
        light = cdpr.compensate(robot.replace(linear_density=0.0), (0.2, 0, 0.1), tensions=limits)
        assert errors(cdpr.settle(robot, light.pose, light.rest_lengths), light.pose)[0] > MICROMETRE


def test_forces_under_given_tensions_have_exact_derivatives(catalogue):
    """By the pose and by the tensions, where rest lengths follow: cables of every kind side by side, and massless."""
    every = catalogue["cogiro"].replace(
        linear_density=[5e-4, 0.0] * 4, pulley_radius=[0.01, 0.01, 0.0, 0.0] * 2, winch_to_exit=0.3, reeving=2,
        stiffening=[(100.0, 2e4)] * 6 + [(0.0, 0.0)] * 2,
    )  # fmt: skip
    tensions, start = np.linspace(2.0, 5.0, 8), every.pose((0.3, 0.22, 0.15, 0.1, 0.2, -0.1))
    for robot in (every, every.replace(linear_density=0.0)):

        def at(step, change, robot=robot):
            pose = moved(start, step)
            position, rotation = pose.translation, pose.rotation.as_matrix()
            rest, W = cut(robot, position, rotation, tensions + change)
            state = forces.at(cdpr.Problem.of(robot, pose, rest), position, rotation)
            return W @ (tensions + change) + state.load_wrench, state

        by_pose, by_tension = wrench_under_tensions(at(np.zeros(6), np.zeros(8))[1])
        h = 1e-5
        for by, unit in ((by_pose, lambda x: (x, np.zeros(8))), (by_tension, lambda x: (np.zeros(6), x))):
            measured = [(at(*unit(h * x))[0] - at(*unit(-h * x))[0]) / (2 * h) for x in np.eye(by.shape[1])]
            np.testing.assert_allclose(np.array(measured).T, by, rtol=0, atol=SLOPE * np.abs(by).max())


@pytest.mark.parametrize(("name", "pose"), NEAREST)
def test_the_nearest_pose_is_found_by_few_evaluations_of_the_geometry(catalogue, name, pose, monkeypatch):
    """Twenty-two descents from everywhere around, a few tens of evaluations each; the pose is the one of thousands."""
    calls, geometry = [], forces.geometry
    monkeypatch.setattr(forces, "geometry", lambda *given: calls.append(given) or geometry(*given))
    found = cdpr.compensate(catalogue[name], pose)
    assert found.distance == pytest.approx(NEAREST[name, pose], abs=NEAREST_ROUNDING)
    assert len(calls) < MOST_EVALUATIONS


def test_searches_for_a_stable_pose_that_run_away_are_given_up(monkeypatch):
    """Three cables cannot hold this pose; half the searches with a constraint of stability lead out of the frame."""
    robot = cdpr.Robot(
        exits=[[-0.79, 0.74, 1.14], [0.05, 0.72, 1.41], [0.41, -0.57, 0.8]], mass=10.4,
        anchors=[[0.013, -0.113, -0.003], [-0.087, 0.089, -0.098], [-0.147, 0.074, 0.078]],
        axial_stiffness=[4800.0, 4700.0, 4000.0],
    )  # fmt: skip
    calls, geometry = [], forces.geometry
    monkeypatch.setattr(forces, "geometry", lambda *given: calls.append(given) or geometry(*given))
    found = cdpr.compensate(robot, (-0.08, 0.12, 0.38, 0.03, 0.1, 0.22))
    assert found.equilibrium.stable
    assert found.distance == pytest.approx(
        0.36770672822860, abs=NEAREST_ROUNDING
    )  # with up to 300 steps for each search
    assert len(calls) < 10_000  # 123,672 with them


def test_what_balances_but_would_fall_over_is_not_called_held():
    """A platform whose centre of mass is far above its anchors balances, and no lengths hold it there."""
    robot = cdpr.Robot(
        exits=[[-0.1, 0, 1], [0.1, 0, 1]], anchors=[[-0.1, 0, 0], [0.1, 0, 0]], axial_stiffness=200, mass=1.0,
        center_of_mass=(0, 0, 0.5), mobility="planar",
    )  # fmt: skip
    found = cdpr.compensate(robot, (0, 0, 0), tension_limits=(0, np.inf))
    assert not found.exact
    assert "every such equilibrium is unstable" in found.reasons[0]
    assert found.equilibrium.stable


def test_limits_are_kept_and_binding_ones_are_named(catalogue):
    """Tensions stay within limits; where the limits are what forbids the pose, the reason says so."""
    robot = catalogue["cogiro"]
    free = cdpr.compensate(robot, (0.3, 0.25, 0.1), tension_limits=(0.2, 0.8))
    assert free.tensions.min() >= 0.2 - 1e-9
    assert free.tensions.max() <= 0.8 + 1e-6
    tight = cdpr.compensate(robot, (0.17, 0.25, 0.1), tension_limits=(0.3, 0.9))
    assert not tight.exact
    assert "not within the limits" in tight.reasons[0]
    assert tight.tensions.min() >= 0.3 - 1e-6
    assert tight.tensions.max() <= 0.9 + 1e-6


@pytest.mark.parametrize("changes", [{}, {"linear_density": 1e-3, "winch_to_exit": 0.1}, {"stiffening": (3.0, 50.0)}])
def test_no_cable_is_shorter_than_a_winch_can_have(monkeypatch, changes):
    """A load beside its exit: with a least length of 20 mm it is moved by what the cable lacks, along the cable."""
    monkeypatch.setattr(compensation, "ROUNDS", 1)
    robot = cdpr.Robot([[0, 0, 1], [1, 0, 1]], [[0, 0, 0]] * 2, 1e3, 1.0, mobility="planar", **SIZED).replace(**changes)
    pose, least = (0.001, 0, 0.999), 0.02
    found = cdpr.compensate(robot, pose, least_length=least)
    assert not found.exact
    assert "shorter than the least length of 20 mm: cable 1, 1.41 mm from exit to anchor" in found.reasons[0]
    assert found.rest_lengths.min() == pytest.approx(least, rel=1e-5)
    lacking = found.equilibrium.lengths[0] - np.hypot(0.001, 0.001)
    assert lacking * (1 - 1e-9) < found.distance < 1.01 * lacking  # straight, but for what the tension changes
    assert cdpr.solve(robot, found.pose, found.rest_lengths).position == pytest.approx(found.pose.translation, abs=1e-9)
    # Negative control: with a bound of 10 µm, a pose nearer than that is held, on a cable of a millimetre or less.
    free = cdpr.compensate(robot, pose, least_length=1e-5)
    assert free.distance < 0.5 * found.distance
    assert free.rest_lengths.min() < 0.002


def test_a_compensation_that_is_not_reached_from_the_commanded_pose_is_told(monkeypatch, tmp_path):
    """From there the search ends beyond the law's range; the command says what it has no result of."""
    monkeypatch.setattr(compensation, "ROUNDS", 2)
    robot = cdpr.Robot(
        [[-0.53, 0, 1], [-0.81, 0, 1], [-0.68, 0, 1]], [[-0.04, 0, -0.03], [0.03, 0, 0.18], [-0.09, 0, 0.08]], 53.3,
        1.0, stiffening=(-2, 5), mobility="planar", name="soft",
    )  # fmt: skip
    # With the compensated lengths, one of which is 1.3 mm, rounding decides where the search from there ends.
    rigid, solve = robot.rest_lengths((-1, 0, 0.9)), newton.solve
    with pytest.raises(cdpr.NotConverged) as beyond:
        solve(cdpr.Problem.of(robot, (-1, 0, 0.9)))

    def ends_beyond(problem, *more, **options):
        if np.allclose(problem.position, (-1, 0, 0.9)) and not np.allclose(problem.rest_lengths, rigid):
            raise beyond.value
        return solve(problem, *more, **options)

    monkeypatch.setattr(newton, "solve", ends_beyond)
    found = cdpr.compensate(robot, (-1, 0, 0.9))
    assert found.reached is None
    assert not found.reached_from_commanded
    assert found.equilibrium.stable
    # The command with the same result, which takes seconds to compute.
    asked = []
    monkeypatch.setattr(cdpr, "compensate", lambda *_, **options: asked.append(options) or found)
    (tmp_path / "soft.toml").write_text(as_toml(robot))
    command = ["compensate", str(tmp_path / "soft.toml"), "--pose", "-1", "0", "0.9", "--least-length", "0.001"]
    told = CliRunner().invoke(app, command, env={"COLUMNS": "140"})
    assert told.exit_code == 1
    assert "no result before: soft: newton: a cable is strained by more than 20%" in " ".join(told.stdout.split())
    values = json.loads(CliRunner().invoke(app, [*command, "--json"]).stdout)
    assert values["before"] == {}
    by_statics = [one.partition(": ")[0] for one in values["missing"] if "newton" in one]
    assert by_statics == ["before", "after, from there"]
    assert asked[0]["least_length"] == 0.001


def test_default_limits_keep_strains_sensible_and_mujoco_holds_what_is_called_held(catalogue):
    """The stiffest tensions of a stretched robot reach them; there were once strains of 1200."""
    robot = catalogue["ipanema-1"].replace(force_max=np.inf, breaking_load=np.inf)
    found = cdpr.compensate(robot, robot.home, prefer="stiffest")
    most = np.maximum(MOST_STRAIN * robot.axial_stiffness, MOST_LOADS * robot.weight)
    assert found.tensions.max() == pytest.approx(most[0], rel=1e-6)
    assert (found.tensions <= most * (1 + 1e-6)).all()
    assert cdpr.verify_compensation(found).held


def test_lengths_that_do_not_hold_are_not_confirmed(catalogue):
    """Negative control: compensated for one pose, and called so for another, a millimetre beside it."""
    robot = catalogue["cogiro"].replace(material="fishing-0.4mm")
    found, other = (cdpr.compensate(robot, (0.3 + shift, 0.25, 0.1)) for shift in (0, 1e-3))
    assert held(found) is found
    vars(found)["equilibrium"] = other.equilibrium
    vars(other.equilibrium)["pose"] = found.commanded
    hold = cdpr.verify_compensation(found)
    assert not hold.held
    assert "it is not held" in hold.reasons[0]
    with pytest.raises(cdpr.NotSettled, match="it is not held"):
        held(found)


@pytest.mark.parametrize(("seed", "nearest"), [(53, 0.5217), (103, 0.4431), (37, 2.312)])
def test_the_nearest_found_is_as_near_as_a_long_search_finds(seed, nearest):
    """In characteristic lengths; from four starts 1.2343, 1.3514 and 3.0945 were found."""
    problem = random_problem(seed)
    found = cdpr.compensate(problem)
    assert found.distance / problem.robot.characteristic_length <= 1.01 * nearest
    assert "nearest found" in found.outcome.value


def test_where_the_commanded_pose_leads_elsewhere_it_is_said():
    """These lengths hold the platform at the compensated pose, but let go at the commanded one it goes elsewhere."""
    found = cdpr.compensate(random_problem(53))
    hold = cdpr.verify_compensation(found)
    assert hold.held
    assert not hold.reached_from_commanded
    assert "released at the commanded pose" in hold.reasons[0]
    assert found.reached is not None
    assert not found.reached_from_commanded

"""What the figures show is what the methods answered."""

import dataclasses

import numpy as np
import pytest

import cdpr_sim as cdpr
import lines as studies
import solvers as solver_studies
import tilt_condition as balance
import two_cable as two_cable_studies
from cdpr_sim.core.equilibrium_batch import EquilibriumBatch, all_solved
from cdpr_sim.core.problem import Problems
from cdpr_sim.crosscheck.compare import POSITION_TOLERANCE, TENSION_TOLERANCE, Verdict
from cdpr_sim.physics.settle import settle_many
from cdpr_sim.statics import two_cable_closed_form
from cdpr_sim.statics.newton import solve_many

MANIFOLD_TOLERANCE = 1e-8
"""[rad] The closed form where the bar was put: 3e-12 measured for the solver, 1e-9 for MuJoCo, which stops at 1e-9 of
the weight unbalanced; the formula without the bar's length is 7e-2 off."""

MOMENT_TOLERANCE = 1e-12
"""[N m] Both sides of an identity in floating point, of moments of 0.1 N m; 3e-17 measured."""

REST_MOMENT_TOLERANCE = 1e-9
"""[N m] What the solver's residual leaves as a moment, 1e-13 measured; held level it is 1e-1."""


def rests_with(slack: list[list[bool]]) -> EquilibriumBatch:
    """Rests whose cables are slack as given, one row per 0.1 m, each elsewhere than it was commanded."""
    pattern = np.array(slack)
    rows, cables = pattern.shape
    robot = cdpr.Robot(
        exits=np.c_[np.arange(cables), np.zeros(cables), np.ones(cables)],
        anchors=np.c_[np.arange(cables), np.zeros((cables, 2))],
        axial_stiffness=1e3,
        mass=1.0,
    )
    positions = np.c_[0.1 * np.arange(rows), np.zeros((rows, 2))]
    return EquilibriumBatch(
        problems=Problems.of(robot, positions),
        positions=positions + np.array([0.03, 0.0, -0.2]),
        rotations=np.tile(np.eye(3), (rows, 1, 1)),
        lengths=np.ones((rows, cables)),
        tensions=np.where(pattern, 0.0, 1.0),
        residuals=np.zeros(rows),
        iterations=np.zeros(rows, dtype=int),
        status=np.zeros(rows, dtype=int),
        source="",
        stiffness=np.ones((rows, 6)),
    )


def test_lines_go_along_x_midway_in_y():
    """From the first end to the second, at one height."""
    rows = studies.along_x(cdpr.load_robot("parallel"), 0.1, (0.17, 0.63), 3)
    assert rows == pytest.approx(np.array([[0.17, 0.25, 0.1], [0.4, 0.25, 0.1], [0.63, 0.25, 0.1]]))


def test_zones_are_where_the_number_of_slack_cables_changes():
    """Neighbouring zones share an end, and together they cover the line."""
    equilibria = rests_with([[True, True], [True, True], [True, False], [False, False], [False, False]])
    starts, ends, slack = zip(*studies.zones(equilibria), strict=True)
    assert starts == pytest.approx((0.0, 0.2, 0.3))
    assert ends == pytest.approx((0.2, 0.3, 0.4))
    assert slack == (2, 1, 0)


def test_twins_are_cables_that_pull_the_same_everywhere():
    """Equal at one pose is not enough."""
    equilibria = rests_with([[False, False, True], [True, False, True], [False, False, False]])
    assert studies.twins(equilibria) == [[0], [1], [2]]
    tensions = equilibria.tensions.copy()
    tensions[:, 1] = tensions[:, 0]
    assert studies.twins(dataclasses.replace(equilibria, tensions=tensions)) == [[0, 1], [2]]


@pytest.mark.parametrize("robot", ["parallel", "planar-vertical"])
def test_both_methods_answer_the_same_line(robot):
    """Commanded alike, they rest alike; a softer cable on one method is noticed."""
    line = studies.line(cdpr.load_robot(robot), 0.1, (0.17, 0.63), static_rows=7, settled_rows=7)
    assert (line.static.source, line.settled.source) == ("newton", "mujoco")
    assert np.abs(line.static.positions - line.settled.positions).max() < POSITION_TOLERANCE
    assert np.abs(line.static.tensions - line.settled.tensions).max() < TENSION_TOLERANCE
    softer = settle_many(line.robot.replace(axial_stiffness=9e3), line.static.problems.positions)
    assert np.abs(line.static.positions - softer.positions).max() > POSITION_TOLERANCE


def test_a_row_without_rest_is_no_rest():
    """Where a solver finds nothing, nothing is drawn: the study says so."""
    with pytest.raises(cdpr.NotConverged, match=r"parallel.*not finite"):
        all_solved(solve_many(cdpr.load_robot("parallel"), [[np.nan, 0.25, 0.1]]))


@pytest.mark.parametrize(
    ("robot", "counts"),
    [("planar-vertical", {0, 1, 2}), ("planar-horizontal", {0}), ("parallel", {0, 2, 4}), ("cogiro", {0})],
)
def test_cables_go_slack_as_the_paper_reports(robot, counts, monkeypatch):
    """Fig. 7, 8, 10, 11: four, three, two taut cables; none slack; two and four of eight; none slack."""
    monkeypatch.setattr(studies, "feasible_outline", lambda robot: np.empty((0, 3)))
    width = studies.across_the_width(cdpr.load_robot(robot), static_rows=301, settled_rows=3)
    for line in width.lines:
        assert {slack for *_, slack in studies.zones(line.static)} == counts


def test_the_bar_drifts_on_its_manifold():
    """At every stiffness the closed form with the bar's length holds where the bar rests; without it, it does not."""
    study = two_cable_studies.manifold(drifts=5, settled_every=2)
    for equilibria in (*study.static, *study.settled):
        for position, beta in zip(equilibria.positions, equilibria.euler[:, 1], strict=True):
            assert (
                np.abs(two_cable_closed_form.equilibrium_rotations(equilibria.robot, position) - beta).min()
                < MANIFOLD_TOLERANCE
            )
    short = [two_cable_closed_form.short_bar_rotation(study.static[0].robot, p) for p in study.static[0].positions]
    assert np.abs(short - study.static[0].euler[:, 1]).max() > 1e6 * MANIFOLD_TOLERANCE
    fall = [equilibria.positions[1, 2] for equilibria in study.static]
    assert (np.diff(fall) < 0).all()  # the softer, the lower


def test_gravity_passes_through_h_wherever_the_platform_is():
    """Horizontal pairs: H is the middle of the platform's top edge, above the centre of mass."""
    robot = cdpr.load_robot("planar-horizontal")
    for x in (0.2, 0.4, 0.55):
        case = balance.equal_pulls(robot, np.array([x, 0, 0.2]))
        assert case.intersection == pytest.approx([x, 0, 0.2 + robot.anchors[0, 2]], abs=1e-12)
        assert case.net_moment == pytest.approx(0, abs=MOMENT_TOLERANCE)


def test_gravity_misses_v_beside_the_middle():
    """Vertical pairs: the moment that equal tensions leave is the weight's about V, and none only in the middle."""
    robot = cdpr.load_robot("planar-vertical")
    middle = balance.equal_pulls(robot, np.array([0.4, 0, 0.2]))
    half, exit_height, exit_x = 0.0515, (0.486 + 0.450) / 2, 0.04
    below = half * (exit_height - 0.2) / (0.4 - half - exit_x)  # similar triangles: midline, extended past the anchors
    assert middle.intersection == pytest.approx([0.4, 0, 0.2 - below], abs=1e-12)
    assert middle.net_moment == pytest.approx(0, abs=MOMENT_TOLERANCE)
    beside = balance.equal_pulls(robot, np.array([0.25, 0, 0.2]))
    assert beside.net_moment == pytest.approx(beside.moment, abs=MOMENT_TOLERANCE)
    assert beside.moment > 0.05  # so that it turns towards positive rotation about y, as it does


@pytest.mark.parametrize("x", [0.25, 0.31])
def test_at_rest_the_lines_of_force_meet_below_the_centre_of_mass(x):
    """With two taut cables as with four: three forces in a plane balance only if their lines meet."""
    case = balance.balance_at_rest(cdpr.load_robot("planar-vertical").replace(material="fishing-0.4mm"), [x, 0.0, 0.2])
    assert case.moment == pytest.approx(0, abs=REST_MOMENT_TOLERANCE)
    assert case.net_moment == pytest.approx(0, abs=REST_MOMENT_TOLERANCE)


def test_convergence_counts_stalled_solvers_as_unsolved(monkeypatch):
    """A solver that stalls at one of three poses, and finds an unstable equilibrium at another; Newton solves all."""
    solve = solver_studies.solvers.solve
    asked = []

    def stalls(robot, position, method):
        found = solve(robot, position)
        asked.append((robot.axial_stiffness[0], method))
        if asked.count((1e4, "fsolve")) == 1 and asked[-1] == (1e4, "fsolve"):
            raise cdpr.NotConverged("stalls")
        unstable = asked[-1] == (1e4, "fsolve") and asked.count(asked[-1]) == 2
        return dataclasses.replace(found, eigenvalues=-found.eigenvalues) if unstable else found

    monkeypatch.setattr(solver_studies.solvers, "solve", stalls)
    study = solver_studies.convergence(axial_stiffness=[1e4, 2e4], poses=3, methods=["newton", "fsolve"])
    assert study.solved["newton"].tolist() == study.stable["newton"].tolist() == [3, 3]
    assert (study.solved["fsolve"].tolist(), study.stable["fsolve"].tolist()) == ([2, 3], [1, 3])
    assert all((seconds > 0).all() and seconds.shape == (2, 3) for seconds in study.seconds.values())
    assert asked == [(EA, method) for EA in (1e4, 2e4) for method in ("newton", "fsolve") for _ in range(3)]


def test_differences_are_judged_by_compare(monkeypatch):
    """Agreement everywhere; and with a solver of stiffer cables, disagreement everywhere."""
    (agreeing,) = solver_studies.differences(["planar-vertical"], ["fishing-0.4mm"], poses=3).values()
    assert all(one.agrees for one in agreeing)
    assert max(one.position_error for one in agreeing) < POSITION_TOLERANCE
    solve = solver_studies.solvers.solve

    def stiffer(robot, position):
        wrong = solve(robot.replace(axial_stiffness=1.1e3), position)
        return dataclasses.replace(solve(robot, position), pose=wrong.pose)

    monkeypatch.setattr(solver_studies.solvers, "solve", stiffer)
    (wrong,) = solver_studies.differences(["planar-vertical"], ["fishing-0.4mm"], poses=3).values()
    assert [one.verdict for one in wrong] == [Verdict.DISAGREE] * 3

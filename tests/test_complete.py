"""No equilibrium is missing: against searches from many starts, and by attacks on every test that excludes a box."""

import dataclasses
import inspect
import re
import time
from fractions import Fraction
from types import SimpleNamespace
from typing import Any

import numba
import numpy as np
import pytest
from sample_problems import symmetric_pair
from scipy.spatial.transform import Rotation
from typer.testing import CliRunner

import cdpr_sim as cdpr
from cdpr_sim.cli import app
from cdpr_sim.core.errors import StoreError
from cdpr_sim.core.pose import Pose
from cdpr_sim.proof import complete, geometry_kernel, interval_kernel, krawczyk_kernel
from cdpr_sim.proof import search_kernel as kernel
from cdpr_sim.proof.balance import Balance
from cdpr_sim.proof.balls import arithmetic, exact, middles
from cdpr_sim.proof.cables import Cable
from cdpr_sim.proof.certificate import Enclosure
from cdpr_sim.report import proof_tables
from cdpr_sim.robots.robot_file_text import as_toml

flint = pytest.importorskip("flint")

STARTS = 40
"""Of the other search; 300 find the same equilibria of these planar robots."""

BOXES_EACH = 40
"""Random boxes thrown about each proved equilibrium."""

STEPS = 12
"""Largest number of boxes that the search examines from each of them: its first contractions, and parts."""

ON_EDGE = np.array([0.348887, 0.256688, 0.374405, 0.578541, -0.292278, -0.00832])
"""[m], and v in the last chart: an unstable equilibrium of ``four_cables``, to six decimals."""

UNKNOWN_TENSIONS = np.tile([0.0, 1e300], (4, 1))
"""Of four cables."""

FEW_BOXES = 500
"""More than the 15 boxes within 3 mm of it; 5,043 with slopes between those of slack and taut."""

FOLD = (0.24706, 0.1)
"""[m] (x, z) of ``planar-horizontal`` with EA = 1 kN at which two equilibria of four meet, within 1e-6 m of x."""


def planar(name: str, **changes) -> cdpr.Robot:
    return cdpr.load_robot(name).replace(**changes)


CASES = {
    "two cables": cdpr.Problem.of(planar("two-cable"), (0.2, 0, 0.1)),
    "two unequal cables": cdpr.Problem.of(planar("two-cable"), (0.4, 0, 0.1), [0.4, 0.75]),
    "two cables, one slack": cdpr.Problem.of(planar("two-cable"), (0.4, 0, 0.1), [0.3, 1.2]),
    "vertical": cdpr.Problem.of(planar("planar-vertical"), (0.4, 0, 0.225)),
    "horizontal": cdpr.Problem.of(planar("planar-horizontal", axial_stiffness=1e3), (0.2, 0, 0.1)),
    "cables below": cdpr.Problem.of(planar("fastkit-planar"), (1.2, 0, 1.3)),
    "force": cdpr.Problem.of(planar("planar-vertical"), (0.3, 0, 0.2), external_wrench=(1.5, 0, -0.5, 0, 0, 0)),
    "law": cdpr.Problem.of(planar("planar-vertical", stiffening=(-0.5, 30), axial_stiffness=20.0), (0.3, 0, 0.2)),
    "drive line": cdpr.Problem.of(
        planar("planar-vertical", winch_to_exit=[0.3, 0.0, 1.0, 0.2], reeving=[1, 2, 3, 1], stiffening=(5, 30)),
        (0.3, 0, 0.2),
    ),
    "pulleys": cdpr.Problem.of(planar("planar-vertical", pulley_radius=0.02), (0.3, 0, 0.2)),
    "pulleys below": cdpr.Problem.of(
        planar("fastkit-planar", pulley_radius=0.05, pulley_axis=(0, 0, 1)), (1.2, 0, 1.3)
    ),
    "tilted pulleys": cdpr.Problem.of(
        planar("planar-vertical", pulley_radius=[0.02, 0.01, 0.0, 0.03], pulley_axis=(0.3, 0, -1)), (0.4, 0, 0.2)
    ),
    "shifted mass": cdpr.Problem.of(planar("planar-horizontal", center_of_mass=(0.01, 0, -0.02)), (0.5, 0, 0.2)),
}


@pytest.fixture(scope="module")
def lists() -> dict[str, cdpr.CompleteEquilibria]:
    return {name: cdpr.certify_all(problem) for name, problem in CASES.items()}


@pytest.mark.parametrize("case", CASES)
def test_the_list_of_a_planar_robot_is_proved_complete_and_many_starts_find_the_same(case, lists):
    """Each with its certificate; as many with an even as with an odd number of unstable directions."""
    proved = lists[case]
    assert proved.complete
    assert all(one.proved for one in proved)
    assert sum((-1) ** one.index for one in proved) == 0
    found = cdpr.find_equilibria(CASES[case], saddles=True, starts=STARTS)
    assert len(found) == len(proved)
    assert proved.missing_from(found) == ()
    assert len(proved.missing_from(found.found[:1])) == len(proved) - 1


@pytest.mark.parametrize("stiffness", [5.0, 3.0])
def test_equilibria_beyond_the_range_of_a_law_are_not_in_the_list(stiffness):
    """At 5 N one of two roots is within 20 % of strain, at 3 N none: the list holds them, and says over which poses."""
    robot = planar("planar-vertical", stiffening=(-0.5, 30), axial_stiffness=stiffness)
    problem = cdpr.Problem.of(robot, (0.3, 0, 0.2))
    proved = cdpr.certify_all(problem)
    assert proved.complete
    assert len(proved) == (stiffness > 4)
    assert all((one.equilibrium.lengths <= 1.2 * one.equilibrium.rest_lengths).all() for one in proved)
    assert "strained by at most 20%, the range of their law" in proof_tables.complete_note(proved)
    if proved.certificates:  # of many starts, as many with an even as with an odd index are expected only if all count
        found = cdpr.find_equilibria(problem, saddles=True, starts=STARTS)
        assert (len(found), found.imbalance) == (1, None)
    else:
        with pytest.raises(cdpr.NotConverged, match="beyond the range of its nonlinear law") as refused:
            cdpr.solve(problem)
        certificate = cdpr.certify(refused.value.equilibrium)
        assert not certificate.exists
        assert re.fullmatch(
            r"cable 1 is strained by \S+%, beyond the range of its nonlinear law, 20%", *certificate.reasons
        )


def test_the_range_of_a_law_ends_where_it_ends():
    """A platform on one cable is in the list at a strain of 20 % less a billionth, and not at a billionth more."""
    for more, count in ((-1e-9, 1), (1e-9, 0)):
        strain = 0.2 + more
        robot = cdpr.Robot(
            [[0, 0, 2]], [[0, 0, 0.1]], 100.0, 100 * strain * (1 + strain * (3 + 5 * strain)) / 9.81,
            stiffening=(3, 5), mobility="planar", platform_size=(0.2, 0.2, 0.2),
        )  # fmt: skip
        proved = cdpr.certify_all(robot, [1.0])
        assert proved.complete
        assert sum(one.stable for one in proved) == count


def test_a_torque_leaves_the_list_complete():
    """Torques have no energy, and the search needs none: what the solver finds from several starts is in the list."""
    problem = cdpr.Problem.of(planar("planar-vertical"), (0.4, 0, 0.2), external_wrench=(0, 0, 0, 0, 0.01, 0))
    proved = cdpr.certify_all(problem)
    assert proved.complete
    assert all(one.proved for one in proved)
    assert sum((-1) ** one.index for one in proved) == 0
    assert attack(proved, problem) == 1.0
    for x in np.linspace(0.1, 0.7, 4):
        found = cdpr.solve(problem.robot, (x, 0, 0.2), problem.rest_lengths, external_wrench=problem.external_wrench)
        assert len(proved.missing_from([found])) == len(proved) - 1


def test_random_planar_robots_are_proved_complete():
    """Exits, anchors, stiffness and rest lengths at random, half of them with pulleys and drive lines.

    Every equilibrium from many starts is in the list.
    """
    random = np.random.default_rng(5)
    for trial in range(2):
        cables = int(random.integers(2, 5))
        exits, anchors = random.uniform(-1, 1, (cables, 3)), random.uniform(-0.2, 0.2, (cables, 3))
        exits[:, 2] += 2
        exits[:, 1] = anchors[:, 1] = 0
        robot = cdpr.Robot(
            exits, anchors, 10 ** random.uniform(2, 5), 1.0, mobility="planar", pulley_radius=trial % 2 * 0.05,
            winch_to_exit=trial % 2 * random.uniform(0, 2, cables), reeving=1 + trial % 2 * np.arange(cables),
        )  # fmt: skip
        problem = cdpr.Problem.of(robot, (0, 0, 0.5), random.uniform(0.8, 1.3) * robot.rest_lengths((0, 0, 0.5)))
        proved = cdpr.certify_all(problem)
        assert proved.complete
        assert not proved.missing_from(cdpr.find_equilibria(problem, saddles=True, starts=STARTS))


def chart_coordinates(one: cdpr.Certificate, signs: np.ndarray) -> np.ndarray | None:
    """(x, y, z, v) of a proved equilibrium in a chart, where it lies within the chart.

    Of the proved pose: Newton's method ends up to 1e-11 from it, farther than the thrown boxes spare.
    """
    turn = Rotation.from_matrix(np.array(one.decimals["rotation"], float).reshape(3, 3) * signs).as_quat()
    if np.abs(turn[:3]).max() > abs(turn[3]):
        return None
    return np.array([*one.position.mean(0), *turn[:3] / turn[3]])


@pytest.mark.parametrize("case", [case for case in CASES if not case.startswith("two")])
def test_no_test_excludes_a_box_that_holds_an_equilibrium(case, lists):
    """Boxes of random size thrown about proved equilibria survive, and the equilibrium stays in one of their parts.

    The negative control: the same boxes of the same robot with a load that is 1 % larger do not all survive.
    """
    survived = attack(lists[case], CASES[case])
    assert survived == 1.0
    heavier = dataclasses.replace(CASES[case], robot=CASES[case].robot.replace(mass=1.01 * CASES[case].robot.mass))
    assert attack(lists[case], heavier) < 0.9


def attack(proved: cdpr.CompleteEquilibria, problem: cdpr.Problem) -> float:
    """The share of random boxes about the equilibria from which a few steps of the compiled search lose nothing."""
    random = np.random.default_rng(2)
    search = complete._Search(problem, None)
    m, survived, thrown = problem.robot.cables, 0, 0
    boxes = np.empty((2 * STEPS + 3, 6 + m, 2))
    found, left = np.empty((STEPS + 1, 6, 3)), np.empty((STEPS + 1, 6, 2))
    for chart, setup in enumerate(search.setups):
        rows = list(setup.rows)
        for one in proved:
            centre = chart_coordinates(one, complete.SIGNS[search.charts[chart]])
            if centre is None:
                continue
            spare = max(float(np.ptp(one.position, axis=0).max()), 1e-15) * 10
            pulls = one.equilibrium.pulls
            uncertain = 1e-9 * (1 + pulls.max())

            def holds(box: np.ndarray, rows=rows, centre=centre, spare=spare) -> bool:
                return bool(((box[rows, 0] <= centre[rows] + spare) & (centre[rows] - spare <= box[rows, 1])).all())

            for _ in range(BOXES_EACH):
                q = np.zeros((6, 2))
                wide = 10 ** random.uniform(-9, 0, 6)
                part = random.uniform(0, 1, 6)
                q[rows, 0], q[rows, 1] = (
                    (centre - part * wide - spare)[rows],
                    (centre + (1 - part) * wide + spare)[rows],
                )
                q[3:] = np.clip(q[3:], -1, 1)
                boxes[0, :6], boxes[0, 6:] = q, (0.0, 1e300)
                steps, counts = int(random.integers(1, STEPS + 1)), np.zeros(kernel.COUNTS, np.int64)
                top, nf, nl = kernel.SEARCH.compiled(*setup, boxes, 1, found, 0, left, 0, steps, counts)
                thrown += 1
                survived += any(map(holds, [*found[:nf], *left[:nl]])) or any(
                    holds(box) and ((box[6:, 0] <= pulls + uncertain) & (pulls - uncertain <= box[6:, 1])).all()
                    for box in boxes[:top]
                )
    assert thrown
    return survived / thrown


def four_cables() -> cdpr.Problem:
    """The frame and the platform of ``cogiro`` with four stiff cables, some almost slack at equilibrium."""
    cogiro = cdpr.load_robot("cogiro")
    (low, high), top = (cogiro.exits.min(0), cogiro.exits.max(0)), cogiro.exits[:, 2].max()
    exits = [[x, y, top] for x in (low[0], high[0]) for y in (low[1], high[1])]
    anchors = [[x, y, 0.018] for x in (-0.0515, 0.0515) for y in (-0.03, 0.03)]
    return cdpr.Problem.of(cdpr.Robot(exits, anchors, 1e4, 0.4), (0.3, 0.2, 0.15))


SPATIAL = {
    "law": {"stiffening": (3, 20), "axial_stiffness": 100.0},
    "pulleys": {"pulley_radius": 0.02, "pulley_axis": (0.2, -0.1, -1)},
}


@pytest.mark.parametrize("changes", SPATIAL.values(), ids=SPATIAL)
def test_a_spatial_box_with_an_equilibrium_survives(changes):
    """Eight cables, six coordinates, four charts: the same attack on equilibria that Newton found."""
    problem = cdpr.Problem.of(cdpr.load_robot("cogiro").replace(**changes), (0.3, 0.2, 0.15))
    found = cdpr.find_equilibria(problem, starts=30)
    proved = [cdpr.certify(one) for one in found]
    listed = complete.CompleteEquilibria(problem, tuple(one for one in proved if one.proved), (), 0, 0, 0.0)
    assert len(listed)
    assert attack(listed, problem) == 1.0


def test_no_test_excludes_a_box_that_holds_an_equilibrium_with_almost_slack_cables():
    """Four stiff cables, tensions from 0.02 N to 11 N: the same attack; and the negative control, 1 % more load."""
    problem = four_cables()
    proofs = [cdpr.certify(one) for one in cdpr.find_equilibria(problem, saddles=True, starts=300)]
    listed = complete.CompleteEquilibria(problem, tuple(proofs), (), 0, 0, 0.0)
    assert all(one.proved for one in proofs)
    assert attack(listed, problem) == 1.0
    heavier = dataclasses.replace(problem, robot=problem.robot.replace(mass=1.01 * problem.robot.mass))
    assert attack(listed, heavier) < 0.9


def test_few_boxes_are_examined_near_an_equilibrium_with_a_slack_cable():
    """Within 3 mm of it: boxes need not be as small as the stretch of a cable of 1.5 N, 6e-5 m."""
    problem = four_cables()
    search = complete._Search(problem, None)
    wide = 3e-3 / search.setups[3].scales
    box = np.stack([ON_EDGE - wide, ON_EDGE + 1.1 * wide], 1)
    search.waiting = [(3, np.concatenate([box, UNKNOWN_TENSIONS])[None])]
    search.run(np.inf, 1, False)
    with arithmetic():
        certificates, undecided = complete._proved(problem, search)
    assert undecided == ()
    assert len(certificates) == 1
    assert certificates[0].proved
    assert search.counts[kernel.BOXES] < FEW_BOXES


@pytest.mark.parametrize("name", ["cogiro", "planar-vertical"])
def test_each_chart_has_the_coordinates_of_its_poses(name):
    """The way from v to a rotation and back, in every chart: which box an equilibrium lies in depends on it."""
    robot, random = cdpr.load_robot(name), np.random.default_rng(4)
    problem = cdpr.Problem.of(robot, robot.home)
    for chart, half_turn in enumerate(complete.CHARTS[robot.mobility]):
        v = random.uniform(-1, 1, 3) * (np.isin([3, 4, 5], robot.free_directions))
        pose = Pose(robot.home, Rotation.from_quat([*v, 1.0]).as_matrix() * complete.SIGNS[half_turn])
        with arithmetic():
            balance = Balance(problem, pose)
            around = balance.start + flint.arb(0, 1e-6)
            at = Enclosure(around, balance.start, balance.at(balance.start), 1e-6)
            member = complete._Member(balance, at, chart, None)
            found = middles(complete._in_chart(member, chart))
            here = np.array([*robot.home, *v])
            assert complete._in_balls(member, chart, np.stack([here - 1e-9, here + 1e-9], 1))
            assert not complete._in_balls(member, chart, np.stack([here + 1e-4, here + 2e-4], 1))
        assert found == pytest.approx([*robot.home, *v], abs=1e-12)


def test_spatial_equilibria_are_proved_from_boxes_about_them_in_every_chart():
    """Four cables: upright, turned over, and on edges; in two charts at once they count as one."""
    problem = four_cables()
    proofs = [cdpr.certify(one) for one in cdpr.find_equilibria(problem, saddles=True, starts=300)]
    search = complete._Search(problem, None)
    search.waiting, charts = [], set()
    for one in proofs:
        for chart, half_turn in enumerate(complete.CHARTS["spatial"]):
            at = chart_coordinates(one, complete.SIGNS[half_turn])
            if at is not None:
                charts.add(chart)
                box = np.stack([at - 1e-5, at + 1.1e-5], 1)
                search.waiting.append((chart, np.concatenate([box, UNKNOWN_TENSIONS])[None]))
    assert charts == {0, 1, 2, 3}
    search.run(np.inf, 1, False)
    with arithmetic():
        certificates, undecided = complete._proved(problem, search)
    assert undecided == ()
    assert len(certificates) == len(proofs)
    assert all(one.proved for one in certificates)


def test_near_a_fold_both_equilibria_are_listed_and_proved():
    """A pair 2e-5 m apart, 1e-4 m from where it vanishes: by the proof and by ``find_equilibria`` alike."""
    robot = planar("planar-horizontal", axial_stiffness=1e3)
    problem = cdpr.Problem.of(robot, (FOLD[0] - 1e-4, 0, FOLD[1]))
    proved = cdpr.certify_all(problem)
    assert proved.complete
    assert sorted(one.index for one in proved) == [0, 0, 1, 1]
    assert proved.missing_from(cdpr.find_equilibria(problem, saddles=True)) == ()


def test_a_family_is_reported_and_not_called_complete():
    """A point on two cables that meet at its centre of mass turns freely: boxes of every rotation are left."""
    proved = cdpr.certify_all(symmetric_pair())
    assert not proved.complete
    assert any("family" in one.reason for one in proved.undecided)


def test_a_time_limit_does_not_count_the_compilation(monkeypatch):
    """A first search with a limit shorter than the compilation ends as any other."""

    def slowly(*_):
        time.sleep(0.5)
        return compiled

    compiled = kernel.SEARCH.compiled
    monkeypatch.setattr(type(kernel.SEARCH), "compiled", property(slowly))
    assert cdpr.certify_all(CASES["horizontal"], time_limit=0.4).complete


def test_a_stable_equilibrium_at_a_kink_is_proved_by_convexity():
    """A third cable just at its rest length: boxes are left about it, and one ball covers them."""
    robot = cdpr.Robot(
        exits=[[-0.5, 0, 2], [0.5, 0, 2], [0, 0, 2]],
        anchors=[[-0.5, 0, 0], [0.5, 0, 0], [0, 0, 0]],
        axial_stiffness=[64, 64, 1e6],
        mass=8,
        gravity=8,
        center_of_mass=(0, 0, -0.1),
        mobility="planar",
        platform_size=(1, 0.1, 0.1),
    )
    proved = cdpr.certify_all(robot, [1, 1, 1.5])
    stable = [one for one in proved if one.stable]
    assert any(one.slack == (False, False, None) for one in stable)
    assert np.abs(stable[0].equilibrium.position - [0, 0, 0.5]).max() < 1e-12


def test_a_search_that_is_stopped_is_resumed(tmp_path):
    """With what it had found; another problem's file, or a damaged one, is refused in a sentence."""
    problem, file = cdpr.Problem.of(cdpr.load_robot("cogiro"), (0.3, 0.2, 0.15)), tmp_path / "search.npz"
    first = cdpr.certify_all(problem, time_limit=0.1, store=file)
    assert not first.complete
    assert first.pending
    second = cdpr.certify_all(problem, time_limit=0.1, store=file, threads=2)
    assert second.boxes > first.boxes
    assert second.seconds > first.seconds
    with pytest.raises(StoreError, match="another problem"):
        cdpr.certify_all(cdpr.Problem.of(problem.robot, (0.3, 0.2, 0.16)), store=file)
    file.write_bytes(b"PK damaged")
    with pytest.raises(StoreError, match="resumed"):
        cdpr.certify_all(problem, store=file)


def test_what_cannot_be_searched_or_stored_is_refused_before_the_search(monkeypatch, tmp_path):
    """A place that cannot be written; on the command line also cables with mass, before other equilibria are found."""
    monkeypatch.setattr(complete._Search, "run", lambda *_: pytest.fail("it searches"))
    monkeypatch.setattr(cdpr, "find_equilibria", lambda *_, **__: pytest.fail("it searches"))
    with pytest.raises(cdpr.InvalidInput, match="cannot be written"):
        cdpr.certify_all(CASES["horizontal"], store="/proc/search.npz")
    file = tmp_path / "heavy.toml"
    file.write_text(as_toml(cdpr.load_robot("two-cable").replace(linear_density=5e-4)))
    told = CliRunner().invoke(app, ["equilibria", str(file), "--certify"])
    assert told.exit_code == 2
    assert "found cables of" in told.stderr


def test_a_planar_search_in_pieces_is_the_search_in_one(monkeypatch, lists):
    """Many short calls on two threads, divided between them, find the same equilibria."""
    monkeypatch.setattr(complete, "CALL", 20)
    again = cdpr.certify_all(CASES["horizontal"], threads=2)
    assert again.complete
    assert [one.index for one in again] == [one.index for one in lists["horizontal"]]


def test_a_resumed_search_keeps_what_it_found(monkeypatch, lists, tmp_path):
    """Stopped again and again, it ends with the same equilibria."""
    monkeypatch.setattr(complete, "CALL", 100)
    rounds = 1
    while not (found := cdpr.certify_all(CASES["horizontal"], time_limit=1e-9, store=tmp_path / "search.npz")).complete:
        rounds += 1
    assert rounds > 3
    assert [one.index for one in found] == [one.index for one in lists["horizontal"]]


def test_a_cluster_that_an_equilibrium_covers_in_part_is_undecided(monkeypatch):
    """Elsewhere in it there may be others."""
    cluster = np.array([[[0.0, 1.0]] * 6, [[1.0, 2.0]] * 6])
    search: Any = SimpleNamespace(setups=[SimpleNamespace(scales=np.ones((6, 1)), least=1.0)])
    monkeypatch.setattr(complete, "_near", lambda *_: "member")
    monkeypatch.setattr(complete, "_at_kink", lambda *_: False)
    monkeypatch.setattr(complete, "_beyond_law", lambda _: False)
    for covered, undecided in ((2.0, 0), (1.0, 1)):
        monkeypatch.setattr(complete, "_in_balls", lambda _, chart, box, most=covered: box.max() <= most)
        members: list[Any] = []
        assert len(inspect.unwrap(complete._covered)(search, 0, cluster, members)) == undecided
        assert members == ["member"] * (1 - undecided)


@pytest.mark.parametrize(
    ("changes", "words"),
    [({"linear_density": 0.01}, "kg/m"), ({"gravity": 0}, "no load")],
)
def test_what_is_not_taken_is_refused_in_a_sentence(changes, words):
    """Mass, and no load at all."""
    robot = planar("planar-vertical", **changes)
    with pytest.raises(cdpr.InvalidInput, match=words):
        cdpr.certify_all(robot, [0.5] * 4)


@pytest.mark.parametrize("beside", [{"rest_lengths": [0.5] * 4}, {"external_wrench": np.zeros(6)}])
def test_what_is_given_beside_a_problem_is_named(beside):
    """Rest lengths and wrench are the problem's own."""
    with pytest.raises(cdpr.InvalidInput, match=f"{next(iter(beside))}: found one beside a Problem"):
        cdpr.certify_all(CASES["vertical"], **beside)


def test_intervals_are_rounded_outwards():
    """Against fractions, which are exact: sums, products, quotients and roots of random numbers of every size."""
    random = np.random.default_rng(0)
    for _ in range(500):
        a, b, c, d = random.normal(size=4) * 10 ** random.uniform(-8, 8, 4)
        a, b, c, d = min(a, b), max(a, b), min(c, d), max(c, d)
        exact = {
            interval_kernel.add: [Fraction(a) + Fraction(c), Fraction(b) + Fraction(d)],
            interval_kernel.subtract: [Fraction(a) - Fraction(d), Fraction(b) - Fraction(c)],
            interval_kernel.multiply: [Fraction(x) * Fraction(y) for x in (a, b) for y in (c, d)],
        }
        for function, ends in exact.items():
            low, high = function((a, b), (c, d))
            assert Fraction(low) <= min(ends)
            assert Fraction(high) >= max(ends)
        low, high = interval_kernel.scaled((a, b), c)
        assert Fraction(low) <= min(Fraction(a) * Fraction(c), Fraction(b) * Fraction(c))
        assert Fraction(high) >= max(Fraction(a) * Fraction(c), Fraction(b) * Fraction(c))
        c, d = abs(c) + 1e-9, abs(c) + 1e-9 + abs(d)
        low, high = interval_kernel.over((a, b), (c, d))
        assert Fraction(low) <= min(Fraction(x) / Fraction(y) for x in (a, b) for y in (c, d))
        assert Fraction(high) >= max(Fraction(x) / Fraction(y) for x in (a, b) for y in (c, d))
        assert Fraction(interval_kernel.root_down(d)) ** 2 <= Fraction(d)


def test_the_matrix_of_krawczyks_test_is_bounded():
    """|1 − C J| in floats with a bound of their rounding, against fractions, for random intervals J."""
    random = np.random.default_rng(3)
    for _ in range(40):
        n = int(random.integers(1, 11))
        C = random.normal(size=(n, n)) * 10 ** random.uniform(-6, 6, (n, 1))
        low = np.linalg.inv(C) * (1 + 10 ** random.uniform(-17, 0) * random.normal(size=(n, n)))
        J = np.stack([low, low + abs(low) * 10 ** random.uniform(-17, 0) * (random.random() < 0.7)], -1)
        J.sort(-1)
        mean, radius, bound, spread = (np.empty((n, n)) for _ in range(4))
        krawczyk_kernel.enclosed(J, mean, radius)
        krawczyk_kernel.deviations(C, mean, radius, bound, spread)
        for r in range(n):
            for c in range(n):
                parts = [[Fraction(C[r, s]) * Fraction(end) for end in J[s, c]] for s in range(n)]
                ends = [(r == c) - sum(map(max, parts)), (r == c) - sum(map(min, parts))]
                assert max(map(abs, ends)) <= Fraction(bound[r, c])


def test_rotations_of_a_box_are_enclosed_and_those_of_a_point_to_rounding():
    """Cayley's R = 1 + 2 (V + V²)/(1 + |v|²), and its angular velocities 2 (e_k + v × e_k)/(1 + |v|²)."""
    random, R, spin = np.random.default_rng(0), np.zeros((9, 2)), np.zeros((9, 2))
    for half in (0.0, 1e-3, 0.3):
        for _ in range(30):
            middle, q = random.uniform(-0.7, 0.7, 3), np.zeros((6, 2))
            q[3:] = np.stack([middle - half, middle + half], axis=1)
            geometry_kernel.turn(q, R, spin)
            for v in random.uniform(q[3:, 0], q[3:, 1], (20, 3)):
                V, size = np.cross(np.eye(3), -v).T, 1 + v @ v
                turned, spun = np.eye(3) + 2 * (V + V @ V) / size, 2 * (np.eye(3) + V.T) / size
                for enclosed, value in ((R, turned.ravel()), (spin, spun.ravel())):
                    assert (enclosed[:, 0] <= value + 1e-15).all()
                    assert (enclosed[:, 1] >= value - 1e-15).all()
            if half == 0:  # negative control: no wider than rounding
                assert np.ptp([R, spin], axis=-1).max() < 1e-14


def test_arc_tangents_and_paths_over_wheels_are_enclosed():
    """Boxes of every size about random anchors, on every side of a wheel: lengths and directions at points in them.

    Beyond the wheel's centre only: there a cable has a path. Many boxes reach over the edge of the wheel.
    """
    random = np.random.default_rng(1)
    robot = cdpr.load_robot("cogiro").replace(pulley_radius=0.1, pulley_axis=random.normal(size=3))
    problem = cdpr.Problem.of(robot, robot.home, np.ones(8))
    axis = robot.cabling.pulley_axis[0]
    with arithmetic():
        cable = Cable(problem, 0)
        wheel = complete._wheels([cable])[0]
    compared, narrow, half_turned, beyond = 0, 0, 0, 0
    for _ in range(500):
        x = 10 ** random.uniform(-9, 9)
        with arithmetic():
            angle = flint.arb(x).atan()
            low, high = interval_kernel.arctangent((x, x))
            assert flint.arb(low) <= angle <= flint.arb(high)
            assert high - low < 1e-14
        wide = 10 ** random.uniform(-9, 0) * random.uniform(0, 1, 3)
        at = 0.1 * random.normal(size=3) * 10 ** random.uniform(0, 1)
        o = np.zeros((geometry_kernel.COLUMNS, 2))
        o[geometry_kernel.FROM_EXIT : geometry_kernel.FROM_EXIT + 3] = np.stack(
            [at - random.uniform(0, 1, 3) * wide, at + wide], 1
        )
        reached = geometry_kernel.over_wheel(o, wheel)
        with arithmetic():
            length, along, _ = cable._path(exact(at))
            if not length.is_finite():
                continue
            assert reached
            for value, column in [(length, geometry_kernel.LENGTH), *zip(along, range(1, 4), strict=True)]:
                assert not value < exact(o[column, 0])
                assert not value > exact(o[column, 1])
            narrow += np.ptp(o[:4], axis=1).max() < 1e-6
            half_turned += bool(along @ cable.axis < -0.9)
            beyond += float(np.dot(middles(along), np.cross(axis, np.cross(at, axis)))) < 0
        compared += 1
    assert compared > 100
    assert narrow > 15
    assert half_turned > 6
    assert beyond > 6


def test_the_compiler_contracts_no_product_and_sum():
    """With one rounding instead of two, (1 + 2⁻³⁰)(1 − 2⁻³⁰) − 1 would be −2⁻⁶⁰ rather than 0."""

    @numba.njit(error_model="numpy", nogil=True)
    def product_and_sum(a, b, c):
        return a * b + c

    e = 2.0**-30
    assert product_and_sum(1 + e, 1 - e, -1.0) == 0.0

"""A proved list lacks no equilibrium: by searches from many starts, points in boxes, and bounds in exact arithmetic."""

import dataclasses
import functools
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
from scipy.optimize import lsq_linear
from scipy.spatial.transform import Rotation

import cdpr_sim as cdpr
from cdpr_sim.core.cable import MOST_STRAIN
from cdpr_sim.core.errors import StoreError
from cdpr_sim.core.pose import Pose
from cdpr_sim.proof import complete, contraction_kernel, geometry_kernel, interval_kernel, krawczyk_kernel
from cdpr_sim.proof import search_kernel as kernel
from cdpr_sim.proof.balance import Balance
from cdpr_sim.proof.balls import arithmetic, exact, middles
from cdpr_sim.proof.cables import Cable, slopes_of_law, wheels
from cdpr_sim.proof.certificate import Enclosure
from cdpr_sim.report import proof_tables

flint = pytest.importorskip("flint")

STARTS = 40
"""Of the other search; 300 find the same equilibria of these planar robots."""

FOLD = (0.24706, 0.1)
"""[m] (x, z) of ``planar-horizontal`` with EA = 1 kN at which two equilibria of four meet, within 1e-6 m of x."""

FEW = 0.02
"""Of a number of boxes: whole numbers that hang on comparisons of rounded ones, a few of which may differ elsewhere."""

CUBE = {"mobility": "planar", "platform_size": (0.2, 0.2, 0.2)}


def planar(name: str, pose, rest=None, wrench=None, **changes) -> cdpr.Problem:
    return cdpr.Problem.of(cdpr.load_robot(name).replace(**changes), pose, rest, wrench)


CASES = {
    "two cables": (planar("two-cable", (0.2, 0, 0.1)), [0, 1], 198),
    "two unequal cables": (planar("two-cable", (0.4, 0, 0.1), [0.4, 0.75]), [0, 1], 164),
    "two cables, one slack": (planar("two-cable", (0.4, 0, 0.1), [0.3, 1.2]), [0, 1], 96),
    "vertical": (planar("planar-vertical", (0.4, 0, 0.225)), [0, 1], 518),
    "horizontal": (planar("planar-horizontal", (0.2, 0, 0.1), axial_stiffness=1e3), [0, 0, 1, 1], 268),
    "near a fold": (planar("planar-horizontal", (FOLD[0] - 1e-4, 0, FOLD[1]), axial_stiffness=1e3), [0, 0, 1, 1], 324),
    "cables below": (planar("fastkit-planar", (1.2, 0, 1.3)), [0, 1], 420),
    "force": (planar("planar-vertical", (0.3, 0, 0.2), None, (1.5, 0, -0.5, 0, 0, 0)), [0, 0, 0, 1, 1, 1], 626),
    "torque": (planar("planar-vertical", (0.4, 0, 0.2), None, (0, 0, 0, 0, 0.01, 0)), [0, 0, 0, 1, 1, 1], 746),
    "law": (planar("planar-vertical", (0.3, 0, 0.2), stiffening=(-0.5, 30), axial_stiffness=20.0), [0, 1], 644),
    "drive line": (
        planar(
            "planar-vertical", (0.3, 0, 0.2), winch_to_exit=[0.3, 0, 1, 0.2], reeving=[1, 2, 3, 1], stiffening=(5, 30)
        ), [0, 0, 0, 1, 1, 1], 700,
    ),
    "pulleys": (planar("planar-vertical", (0.3, 0, 0.2), pulley_radius=0.02), [0, 1], 624),
    "pulleys below": (planar("fastkit-planar", (1.2, 0, 1.3), pulley_radius=0.05, pulley_axis=(0, 0, 1)), [0, 1], 458),
    "tilted pulleys": (
        planar("planar-vertical", (0.4, 0, 0.2), pulley_radius=[0.02, 0.01, 0.0, 0.03], pulley_axis=(0.3, 0, -1)),
        [0, 1], 1138,
    ),
    "shifted mass": (planar("planar-horizontal", (0.5, 0, 0.2), center_of_mass=(0.01, 0, -0.02)), [0, 1], 370),
}  # fmt: skip
"""A planar problem; the number of unstable directions of each of its equilibria; boxes that the search examines."""


@functools.cache
def listed(case: str) -> cdpr.CompleteEquilibria:
    return cdpr.certify_all(CASES[case][0])


@pytest.mark.parametrize("case", CASES)
def test_the_list_of_a_planar_robot_is_proved_complete(case):
    """Each with its certificate. What bounds lose in width, or lack, shows in the number of boxes."""
    _, indices, boxes = CASES[case]
    proved = listed(case)
    assert proved.complete
    assert all(one.proved for one in proved)
    assert [one.index for one in proved] == indices
    assert proved.boxes == pytest.approx(boxes, rel=FEW)


@pytest.mark.parametrize("case", CASES)
def test_many_starts_find_the_equilibria_of_the_list(case):
    """And a list of one of them lacks the others. With a torque, there is no energy to search by: from four poses."""
    problem, proved = CASES[case][0], listed(case)
    if case == "torque":
        poses = [(x, 0, 0.2) for x in np.linspace(0.1, 0.7, 4)]
        found = [
            cdpr.solve(problem.robot, at, problem.rest_lengths, external_wrench=problem.external_wrench) for at in poses
        ]
        assert {len(proved.missing_from([one])) for one in found} == {len(proved) - 1}
        return
    found = cdpr.find_equilibria(problem, saddles=True, starts=STARTS)
    assert len(found) == len(proved)
    assert proved.missing_from(found) == ()
    assert len(proved.missing_from(found.found[:1])) == len(proved) - 1


def test_random_planar_robots_are_proved_complete():
    """Exits, anchors, stiffness and rest lengths at random, one robot with pulleys and a drive line."""
    random = np.random.default_rng(5)
    for rolled in (0, 1):
        cables = int(random.integers(2, 5))
        exits, anchors = random.uniform(-1, 1, (cables, 3)), random.uniform(-0.2, 0.2, (cables, 3))
        exits[:, 2] += 2
        exits[:, 1] = anchors[:, 1] = 0
        robot = cdpr.Robot(
            exits, anchors, 10 ** random.uniform(2, 5), 1.0, mobility="planar", pulley_radius=rolled * 0.05,
            winch_to_exit=rolled * random.uniform(0, 2, cables), reeving=1 + rolled * np.arange(cables),
        )  # fmt: skip
        problem = cdpr.Problem.of(robot, (0, 0, 0.5), random.uniform(0.8, 1.3) * robot.rest_lengths((0, 0, 0.5)))
        proved = cdpr.certify_all(problem)
        assert proved.complete
        assert not proved.missing_from(cdpr.find_equilibria(problem, saddles=True, starts=STARTS))


@pytest.mark.parametrize("stiffness", [5.0, 3.0])
def test_equilibria_beyond_the_range_of_a_law_are_not_in_the_list(stiffness):
    """At 5 N one of two roots is within 20 % of strain, at 3 N none: the list holds them, and says over which poses."""
    problem = planar("planar-vertical", (0.3, 0, 0.2), stiffening=(-0.5, 30), axial_stiffness=stiffness)
    proved = cdpr.certify_all(problem)
    assert proved.complete
    assert len(proved) == (stiffness > 4)
    assert "strained by at most 20%, the range of their law" in proof_tables.complete_note(proved)
    if proved.certificates:  # of many starts, as many with an even as with an odd index are expected only if all count
        found = cdpr.find_equilibria(problem, saddles=True, starts=STARTS)
        assert (len(found), found.imbalance) == (1, None)
        return
    with pytest.raises(cdpr.NotConverged, match="beyond the range of its nonlinear law") as refused:
        cdpr.solve(problem)
    certificate = cdpr.certify(refused.value.equilibrium)
    assert not certificate.exists
    assert re.fullmatch(
        r"cable 1 is strained by \S+%, beyond the range of its nonlinear law, 20%", *certificate.reasons
    )


@pytest.mark.parametrize(("more", "count"), [(-1e-9, 1), (1e-9, 0)])
def test_the_range_of_a_law_ends_where_it_ends(more, count):
    """A platform on one cable is in the list at a strain of 20 % less a billionth, and not at a billionth more."""
    strain = 0.2 + more
    mass = 100 * strain * (1 + strain * (3 + 5 * strain)) / 9.81
    proved = cdpr.certify_all(cdpr.Robot([[0, 0, 2]], [[0, 0, 0.1]], 100.0, mass, stiffening=(3, 5), **CUBE), [1.0])
    assert proved.complete
    assert sum(one.stable for one in proved) == count


# --- points of the proved equilibria, in boxes


def chart_coordinates(one: cdpr.Certificate, signs: np.ndarray) -> np.ndarray | None:
    """(x, y, z, v) of a proved equilibrium in a chart, where it lies within the chart.

    Of the proved pose: Newton's method ends up to 1e-11 from it, farther than the thrown boxes spare.
    """
    turn = Rotation.from_matrix(np.array(one.decimals["rotation"], float).reshape(3, 3) * signs).as_quat()
    return None if np.abs(turn[:3]).max() > abs(turn[3]) else np.array([*one.position.mean(0), *turn[:3] / turn[3]])


def lost(proofs: list[cdpr.Certificate], problem: cdpr.Problem) -> float:
    """The share of random boxes about equilibria that lose them in a few steps of the search.

    40 about each, 1e-9 to 1 wide, of which up to 12 boxes are examined: its first contractions, and parts.
    """
    random, steps = np.random.default_rng(2), 12
    search = complete._Search(problem, None)
    m, gone, thrown = problem.robot.cables, 0, 0
    boxes = np.empty((2 * steps + 3, 6 + m, 2))
    found, left = np.empty((steps + 1, 6, 3)), np.empty((steps + 1, 6, 2))
    for chart, setup in enumerate(search.setups):
        rows = list(setup.rows)
        for one in proofs:
            centre = chart_coordinates(one, complete.SIGNS[search.charts[chart]])
            if centre is None:
                continue
            spare = max(float(np.ptp(one.position, axis=0).max()), 1e-15) * 10
            pulls = one.equilibrium.pulls
            uncertain = 1e-9 * (1 + pulls.max())

            def holds(box: np.ndarray, rows=rows, centre=centre, spare=spare) -> bool:
                return bool(((box[rows, 0] <= centre[rows] + spare) & (centre[rows] - spare <= box[rows, 1])).all())

            for _ in range(40):
                q, wide, part = np.zeros((6, 2)), 10 ** random.uniform(-9, 0, 6), random.uniform(0, 1, 6)
                ends = centre - part * wide - spare, centre + (1 - part) * wide + spare
                q[rows] = np.stack(ends, 1)[rows]
                q[3:] = np.clip(q[3:], -1, 1)
                boxes[0, :6], boxes[0, 6:] = q, (0.0, 1e300)
                most, counts = int(random.integers(1, steps + 1)), np.zeros(kernel.COUNTS, np.int64)
                top, nf, nl = kernel.SEARCH.compiled(*setup, boxes, 1, found, 0, left, 0, most, counts)
                thrown += 1
                gone += not any(map(holds, [*found[:nf], *left[:nl]])) and not any(
                    holds(box) and ((box[6:, 0] <= pulls + uncertain) & (pulls - uncertain <= box[6:, 1])).all()
                    for box in boxes[:top]
                )
    return gone / thrown


def four_cables() -> cdpr.Problem:
    """The frame and the platform of ``cogiro`` with four stiff cables: tensions from 0.02 N to 11 N."""
    cogiro = cdpr.load_robot("cogiro")
    (low, high), top = (cogiro.exits.min(0), cogiro.exits.max(0)), cogiro.exits[:, 2].max()
    exits = [[x, y, top] for x in (low[0], high[0]) for y in (low[1], high[1])]
    anchors = [[x, y, 0.018] for x in (-0.0515, 0.0515) for y in (-0.03, 0.03)]
    return cdpr.Problem.of(cdpr.Robot(exits, anchors, 1e4, 0.4), (0.3, 0.2, 0.15))


def cogiro(**changes) -> cdpr.Problem:
    return cdpr.Problem.of(cdpr.load_robot("cogiro").replace(**changes), (0.3, 0.2, 0.15))


SPATIAL = {
    "four cables": (four_cables(), 300, 1e-3, [30, 2, 8, 10, 0]),
    "spatial law": (cogiro(stiffening=(3, 20), axial_stiffness=100.0), 30, 1e-5, [3, 0, 0, 3, 0]),
    "spatial pulleys": (cogiro(pulley_radius=0.02, pulley_axis=(0.2, -0.1, -1)), 30, 1e-5, [23, 1, 8, 5, 0]),
}
"""A spatial problem, starts that find equilibria; width of boxes about them, and counts of the results of a search."""


@functools.cache
def found(case: str) -> tuple[cdpr.Certificate, ...]:
    problem, starts, *_ = SPATIAL[case]
    proofs = [cdpr.certify(one) for one in cdpr.find_equilibria(problem, saddles=case == "four cables", starts=starts)]
    assert proofs
    assert all(one.proved for one in proofs)
    return tuple(proofs)


@pytest.mark.parametrize("case", [*(case for case in CASES if not case.startswith("two")), *SPATIAL])
def test_no_test_excludes_a_box_that_holds_an_equilibrium(case):
    """And the equilibrium stays in one of its parts. Negative control: with 1 % more load, some boxes do lose it."""
    problem = (CASES | SPATIAL)[case][0]
    proofs = found(case) if case in SPATIAL else listed(case).certificates
    assert lost(proofs, problem) == 0.0
    heavier = dataclasses.replace(problem, robot=problem.robot.replace(mass=1.01 * problem.robot.mass))
    assert lost(proofs, heavier) > 0.1


def searched(problem: cdpr.Problem, boxes: list[tuple[int, np.ndarray]]) -> tuple[complete._Search, tuple, tuple]:
    """A search of some boxes of charts (6, 2) alone, with its certificates and what is undecided."""
    search = complete._Search(problem, None)
    any_tension = np.tile([0.0, 1e300], (problem.robot.cables, 1))
    search.waiting = [(chart, np.concatenate([box, any_tension])[None]) for chart, box in boxes]
    search.run(np.inf, 1, False)
    with arithmetic():
        return search, *complete._proved(problem, search)


@pytest.mark.parametrize("case", SPATIAL)
def test_spatial_equilibria_are_proved_from_boxes_about_them_in_every_chart(case):
    """Upright, turned over and on edges; one in two charts counts once. The number of boxes is that of tight bounds."""
    problem, _, wide, counts = SPATIAL[case]
    boxes = []
    for one in found(case):
        for chart, half_turn in enumerate(complete.CHARTS["spatial"]):
            at = chart_coordinates(one, complete.SIGNS[half_turn])
            if at is not None:
                boxes.append((chart, np.stack([at - wide, at + 1.1 * wide], 1)))
    search, certificates, undecided = searched(problem, boxes)
    assert undecided == ()
    assert len(certificates) == len(found(case))
    assert all(one.proved for one in certificates)
    assert search.counts.tolist() == counts
    if case == "four cables":
        assert {chart for chart, _ in boxes} == {0, 1, 2, 3}


def test_few_boxes_are_examined_near_an_equilibrium_with_a_slack_cable():
    """Within 3 mm of it: boxes need not be as small as the stretch of a cable of 1.5 N, 6e-5 m."""
    on_edge = np.array([0.348887, 0.256688, 0.374405, 0.578541, -0.292278, -0.00832])  # in the last chart
    wide = 3e-3 / complete._Search(four_cables(), None).setups[3].scales
    search, certificates, undecided = searched(
        four_cables(), [(3, np.stack([on_edge - wide, on_edge + 1.1 * wide], 1))]
    )
    assert undecided == ()
    assert [one.proved for one in certificates] == [True]
    assert search.counts[kernel.BOXES] == 15  # 5,043 with slopes between those of slack and taut


@pytest.mark.parametrize("name", ["cogiro", "planar-vertical"])
def test_each_chart_has_the_coordinates_of_its_poses(name):
    """The way from v to a rotation and back, in every chart: which box an equilibrium lies in depends on it."""
    robot, random = cdpr.load_robot(name), np.random.default_rng(4)
    problem = cdpr.Problem.of(robot, robot.home)
    for chart, half_turn in enumerate(complete.CHARTS[robot.mobility]):
        v = random.uniform(-1, 1, 3) * (np.isin([3, 4, 5], robot.free_directions))
        here = np.array([*robot.home, *v])
        with arithmetic():
            turned = Rotation.from_quat([*v, 1.0]).as_matrix() * complete.SIGNS[half_turn]
            balance = Balance(problem, Pose(robot.home, turned))
            around = balance.start + flint.arb(0, 1e-6)
            at = Enclosure(around, balance.start, balance.at(balance.start), 1e-6)
            member = complete._Member(balance, at, chart, None)
            assert middles(complete._in_chart(member, chart)) == pytest.approx(here, abs=1e-12)
            assert complete._in_balls(member, chart, np.stack([here - 1e-9, here + 1e-9], 1))
            assert not complete._in_balls(member, chart, np.stack([here + 1e-4, here + 2e-4], 1))
            there = np.array([exact(v) for v in robot.home])
            for off, inside in ((0.9e-6, True), (1.1e-6, False)):  # of a multiple of the unit quaternion
                q = 3 * (balance.quaternion + sum(tangent * exact(off) for tangent in balance.tangents))
                assert complete._unique_at(member, there, q) is inside
            boxed = dataclasses.replace(member, box=np.stack([here - 1e-3, here + 1e-3, here], 1))
            assert complete._same(boxed, member) is complete._same(member, boxed) is True  # whichever has the box


# --- what is undecided, and what stops


def test_a_family_is_reported_and_not_called_complete():
    """A point on two cables that meet at its centre of mass turns freely: boxes of every rotation are left."""
    proved = cdpr.certify_all(symmetric_pair())
    assert not proved.complete
    assert any("family" in one.reason for one in proved.undecided)


def test_a_stable_equilibrium_at_a_kink_is_proved_by_convexity():
    """A third cable just at its rest length: boxes are left about it, and one ball covers them."""
    robot = cdpr.Robot(
        exits=[[-0.5, 0, 2], [0.5, 0, 2], [0, 0, 2]], anchors=[[-0.5, 0, 0], [0.5, 0, 0], [0, 0, 0]],
        axial_stiffness=[64, 64, 1e6], mass=8, gravity=8, center_of_mass=(0, 0, -0.1), mobility="planar",
        platform_size=(1, 0.1, 0.1),
    )  # fmt: skip
    stable = [one for one in cdpr.certify_all(robot, [1, 1, 1.5]) if one.stable]
    assert any(one.slack == (False, False, None) for one in stable)
    assert np.abs(stable[0].equilibrium.position - [0, 0, 0.5]).max() < 1e-12


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


def test_a_time_limit_does_not_count_the_compilation(monkeypatch):
    """A first search with a limit shorter than the compilation ends as any other."""
    compiled = kernel.SEARCH.compiled
    monkeypatch.setattr(type(kernel.SEARCH), "compiled", property(lambda _: time.sleep(0.5) or compiled))
    assert cdpr.certify_all(CASES["horizontal"][0], time_limit=0.4).complete


def test_a_search_that_is_stopped_is_resumed(tmp_path):
    """With what it had found; another problem's file, or a damaged one, is refused in a sentence."""
    problem, file = cogiro(), tmp_path / "search.npz"
    first = cdpr.certify_all(problem, time_limit=0.1, store=file)
    assert first.pending
    assert not first.complete
    second = cdpr.certify_all(problem, time_limit=0.1, store=file, threads=2)
    assert (second.boxes > first.boxes, second.seconds > first.seconds) == (True, True)
    with pytest.raises(StoreError, match="another problem"):
        cdpr.certify_all(cdpr.Problem.of(problem.robot, (0.3, 0.2, 0.16)), store=file)
    file.write_bytes(b"PK damaged")
    with pytest.raises(StoreError, match="resumed"):
        cdpr.certify_all(problem, store=file)


def test_a_search_in_pieces_is_the_search_in_one(monkeypatch, tmp_path):
    """In many short calls on two threads, divided between them; and stopped and resumed again and again."""
    problem, indices, _ = CASES["horizontal"]
    monkeypatch.setattr(complete, "CALL", 20)
    assert [one.index for one in cdpr.certify_all(problem, threads=2)] == indices
    monkeypatch.setattr(complete, "CALL", 100)
    rounds = 1
    while not (one := cdpr.certify_all(problem, time_limit=1e-9, store=tmp_path / "search.npz")).complete:
        rounds += 1
    assert rounds > 3
    assert [each.index for each in one] == indices


# --- bounds, against exact numbers


def test_intervals_are_rounded_outwards_and_no_further_than_a_few_units():
    """Against fractions and balls: random numbers of every size and sign."""
    random = np.random.default_rng(0)
    for _ in range(300):
        a, b, c, d = random.normal(size=4) * 10 ** random.uniform(-8, 8, 4)
        x, y = (min(a, b), max(a, b)), (min(c, d), max(c, d))
        z = abs(c) + 1e-9, abs(c) + 1e-9 + abs(d)
        X, Y, Z = ([Fraction(end) for end in one] for one in (x, y, z))
        rows = np.array([x, y])
        products, squares = [p * q for p in X for q in Y], [p * p for p in X] + [Fraction(0)] * bool(x[0] < 0 < x[1])
        for got, ends in (
            (interval_kernel.add(x, y), [X[0] + Y[0], X[1] + Y[1]]),
            (interval_kernel.subtract(x, y), [X[0] - Y[1], X[1] - Y[0]]),
            (interval_kernel.negative(x), [-X[1], -X[0]]),
            (interval_kernel.multiply(x, y), products),
            (interval_kernel.product(rows, 0, 1), products),
            (interval_kernel.scaled(x, c), [p * Fraction(c) for p in X]),
            (interval_kernel.over(x, z), [p / q for p in X for q in Z]),
            (interval_kernel.square(x), squares),
            (interval_kernel.product(rows, 0, 0), squares),
        ):
            spare = 4e-16 * float(max(map(abs, ends))) + 1e-299
            assert min(ends) - Fraction(spare) <= Fraction(got[0]) <= min(ends)
            assert max(ends) <= Fraction(got[1]) <= max(ends) + Fraction(spare)
        with arithmetic():
            root = exact(z[0]).sqrt()
            unit = interval_kernel.unit(x, z)
            ends = [exact(p) / (exact(p) ** 2 + exact(q)).sqrt() for p in x for q in z]
            assert exact(interval_kernel.root_down(z[0])) <= root
            assert exact(interval_kernel.root_down(z[0])) * (1 + 1e-15) >= root
            for end in ends:
                assert exact(unit[0]) <= end
                assert exact(unit[1]) >= end
            assert any(exact(unit[0]) >= end - 1e-15 for end in ends)
            assert any(exact(unit[1]) <= end + 1e-15 for end in ends)


def test_products_of_vectors_are_enclosed_wherever_their_rows_are():
    """Against numbers, which are off by a few units: each component, of three rows from any row on."""
    random = np.random.default_rng(6)
    a, b = random.normal(size=(2, 9))
    for r in range(3):
        low, high = interval_kernel.cross(np.stack([a, a], 1), 5, np.stack([b, b], 1), 2, r)
        assert low <= high
        assert [low, high] == pytest.approx([np.cross(a[5:8], b[2:5])[r]] * 2, abs=1e-14)


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
    """Cayley's R = 1 + 2 (V + V²)/(1 + |v|²), and its angular velocities 2 (e_k + v × e_k)/(1 + |v|²).

    The diagonal of R and the angular velocities take their extremes at ends of the box, or at 0: they are attained.
    """
    random, R, spin = np.random.default_rng(0), np.zeros((9, 2)), np.zeros((9, 2))
    for half in (0.0, 1e-3, 0.3):
        for _ in range(30):
            middle, q = random.uniform(-0.7, 0.7, 3), np.zeros((6, 2))
            q[3:] = np.stack([middle - half, middle + half], axis=1)
            geometry_kernel.turn(q, R, spin)
            ends = [[low, high, *([0.0] if low < 0 < high else [])] for low, high in q[3:]]
            points = np.concatenate(
                [random.uniform(q[3:, 0], q[3:, 1], (20, 3)), np.stack(np.meshgrid(*ends), -1).reshape(-1, 3)]
            )
            values = []
            for v in points:
                V, size = np.cross(np.eye(3), -v).T, 1 + v @ v
                values.append([(np.eye(3) + 2 * (V + V @ V) / size).ravel(), (2 * (np.eye(3) + V.T) / size).ravel()])
            low, high = np.min(values, axis=0), np.max(values, axis=0)
            assert (np.stack([R, spin])[..., 0] <= low + 1e-15).all()
            assert (np.stack([R, spin])[..., 1] >= high - 1e-15).all()
            tight = np.ones((2, 9), bool)
            tight[0] = half == 0 or np.eye(3, dtype=bool).ravel()
            excess = np.stack([low, -high]) - np.stack([R, spin])[..., :].transpose(2, 0, 1) * [[[1]], [[-1]]]
            assert excess[:, tight].max() < 1e-14


BESIDE_A_WHEEL = {
    "steep": (0.05, 0.2, 0.3, 0.5), "about a quarter turn": (0.3, 0.5, 0.02, 0.3), "flat": (0.2, 0.3, 0.01, 0.08),
    "level and above": (0.2, 0.3, -0.1, 0.2), "level": (0.2, 0.3, -0.1, 0.05), "above, far": (0.2, 0.4, -0.5, -0.3),
    "above, near": (0.02, 0.08, -0.5, -0.3), "above, about a half turn": (0.05, 0.3, -0.5, -0.3),
    "far below": (1e-3, 0.01, 150.0, 250.0),
}  # fmt: skip
"""Ranges of the distance beyond the centre of a wheel of radius 0.1, and of the height below the exit [m]."""


@pytest.mark.parametrize("where", BESIDE_A_WHEEL)
def test_bounds_of_a_path_over_a_wheel_are_attained(where):
    """In a wheel's plane, against balls: at points of a grid with lines on which extremes may lie; and of a point."""
    radius, e = 0.1, geometry_kernel
    a0, a1, h0, h1 = BESIDE_A_WHEEL[where]
    wheel = np.zeros((e.WHEEL, 2))
    wheel[e.RADIUS], wheel[e.AXIS + 2] = radius, -1.0
    wheel[[e.ASIDE, e.ASIDE + 4]] = 1.0

    def path(rho, h):
        """Length, n, s, θ, a, the vector across, and the bend."""
        rho, h, r = exact(rho), exact(h), exact(radius)
        a = rho - r
        far = a * a + h * h
        s = (far - r * r).sqrt()
        sine, cosine, turned = (
            (a * s + h * r) / far,
            (h * s - a * r) / far,
            flint.arb.atan2(a, h) + flint.arb.atan2(r, s),
        )
        return [
            r * turned + s,
            sine,
            exact(0),
            -cosine,
            s,
            turned,
            a,
            exact(0),
            exact(-1),
            exact(0),
            sine / rho - 1 / s,
        ]

    def compare(rhos, heights):
        """Bounds of a box with the values at points."""
        o = np.zeros((e.COLUMNS, 2))
        o[e.FROM_EXIT], o[e.FROM_EXIT + 2] = (rhos[0], rhos[-1]), (-heights[-1], -heights[0])
        assert e.over_wheel(o, wheel)
        low, high = o[[0, 1, 2, 3, *range(e.FREE, e.COLUMNS)]].T
        with arithmetic():
            values = np.array([path(rho, h) for rho in rhos for h in heights])
            assert not (values < exact(low)).any()
            assert not (values > exact(high)).any()
            values = middles(values)
        return low - values.min(0), high - values.max(0)

    rhos = sorted({*np.linspace(a0, a1, 5) + radius, *([2 * radius] if a0 < radius < a1 else [])})
    heights = sorted({*np.linspace(h0, h1, 5), *(at for at in (0.0, radius) if h0 < at < h1)})
    attained = compare(rhos, heights)  # but for the bend, a difference of two bounds
    assert np.abs(attained)[:, :10].max() < 1e-13 * max(1, h1)
    for rho, h in ((rhos[0], h1), (rhos[-1], h0)):
        assert np.abs(compare([rho], [h])).max() < 1e-12 * max(1, h1)


def test_arc_tangents_and_paths_over_wheels_are_enclosed():
    """Boxes of every size about random anchors, on every side of a wheel: lengths and directions at points in them.

    Beyond the wheel's centre only: there a cable has a path. Many boxes reach over the edge of the wheel.
    """
    random = np.random.default_rng(1)
    problem = cogiro(pulley_radius=0.1, pulley_axis=random.normal(size=3))
    axis = problem.robot.cabling.pulley_axis[0]
    with arithmetic():
        cable = Cable(problem, 0)
        wheel = wheels([cable])[0]
    seen = np.zeros(4, int)
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
        first = geometry_kernel.FROM_EXIT
        o[first : first + 3] = np.stack([at - random.uniform(0, 1, 3) * wide, at + wide], 1)
        reached = geometry_kernel.over_wheel(o, wheel)
        with arithmetic():
            length, along, _ = cable._path(exact(at))
            if not length.is_finite():
                continue
            assert reached
            for value, column in [(length, geometry_kernel.LENGTH), *zip(along, range(1, 4), strict=True)]:
                assert not value < exact(o[column, 0])
                assert not value > exact(o[column, 1])
            beyond = float(np.dot(middles(along), np.cross(axis, np.cross(at, axis)))) < 0
            seen += [1, np.ptp(o[:4], axis=1).max() < 1e-6, bool(along @ cable.axis < -0.9), beyond]
    assert (seen > [100, 15, 6, 6]).all()


def test_the_compiler_contracts_no_product_and_sum():
    """With one rounding instead of two, (1 + 2⁻³⁰)(1 − 2⁻³⁰) − 1 would be −2⁻⁶⁰ rather than 0."""

    @numba.njit(error_model="numpy", nogil=True)
    def product_and_sum(a, b, c):
        return a * b + c

    e = 2.0**-30
    assert product_and_sum(1 + e, 1 - e, -1.0) == 0.0


def test_boxes_that_are_left_are_grouped_with_what_they_touch():
    """Each is in one group: two that touch in every coordinate together; one that is apart in a single one, alone."""
    box = np.tile([0.0, 1.0], (6, 1))
    touching, apart, far = box + 1.0, box.copy(), box + 10.0
    apart[2] += 5.0
    groups = complete._joined(np.stack([box, far, touching, apart]), 1e-9)
    found = sorted(sorted(one[:, 2, 0].tolist()) for one in groups)
    assert found == [[0.0, 1.0], [5.0], [10.0]]


def test_bounds_of_the_laws_slope_hold_between_the_ends():
    """Of laws that soften and then stiffen within the polynomial, or the other way round, and of linear ones."""
    laws = [(0.0, 0.0), (-4.0, 20.0), (-4.0, 15.0), (6.0, -15.0), (5.0, 50.0), (3.0, 0.0)]
    robot = cdpr.load_robot("cogiro").replace(stiffening=[*laws, (0.0, 0.0), (0.0, 0.0)])
    low, high = slopes_of_law(robot)
    strain = np.linspace(0, MOST_STRAIN, 2001)[:, None]
    a2, a3 = robot.stiffening.T
    slopes = 1 + 2 * a2 * strain + 3 * a3 * strain**2
    np.testing.assert_allclose(low, slopes.min(0), rtol=0, atol=1e-6)
    np.testing.assert_allclose(high, slopes.max(0), rtol=0, atol=1e-6)
    assert (low <= slopes.min(0)).all()
    assert (high >= slopes.max(0)).all()


def test_the_motion_of_virtual_work_is_what_the_best_tensions_leave():
    """By SciPy's bounded least squares, at the middles of the intervals; for cables that pull at right angles."""
    random = np.random.default_rng(5)
    W = np.linalg.qr(random.normal(size=(6, 6)))[0][:3] * [[1.0], [2.0], [3.0]]
    T, g = np.array([[0.0, 1.0], [0.5, 0.6], [0.0, 2.0]]), random.normal(size=6)
    o, first = np.zeros((3, geometry_kernel.COLUMNS, 2)), geometry_kernel.DIRECTION
    o[:, first : first + 6] = np.stack([W - 1e-3, W + 1e-3], -1)
    y = np.zeros(6)
    contraction_kernel.unbalanced(T, o, np.stack([g - 0.1, g + 0.2], 1), np.arange(6), y)
    best = lsq_linear(W.T, -(g + 0.05), T.T, tol=1e-15).x
    np.testing.assert_allclose(y, g + 0.05 + W.T @ best, atol=1e-9)
    assert 0 < np.isclose(best[:, None], T, atol=1e-9).any(1).sum() < 3  # some are at a limit


def test_a_platform_of_a_gram_is_no_platform_without_a_load():
    """Its weight is 0.01 N: the search is of the same equilibria as for a kilogram on cables as many times as stiff."""
    light = planar("two-cable", (0.2, 0, 0.1), mass=1e-3, axial_stiffness=1.0)
    heavy = planar("two-cable", (0.2, 0, 0.1), mass=1.0, axial_stiffness=1e3)
    found = [cdpr.certify_all(one) for one in (light, heavy)]
    assert all(one.complete for one in found)
    poses = [[one.position for one in each.equilibria] for each in found]
    np.testing.assert_allclose(*poses, atol=1e-9)

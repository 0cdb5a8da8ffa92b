import contextlib
import dataclasses

import numpy as np
import pytest
from sample_problems import grid

import cdpr_sim as cdpr
from cdpr_sim.core import pose
from cdpr_sim.crosscheck import check as checking
from cdpr_sim.crosscheck import compare
from cdpr_sim.crosscheck.check import OUTCOMES
from cdpr_sim.crosscheck.compare import compare_many
from cdpr_sim.crosscheck.compensation_check import SAME, CompensationCheck
from cdpr_sim.drawing import maps
from cdpr_sim.physics import dynamic_relaxation
from cdpr_sim.report.workspace_tables import check_table, sweep_table


def methods(robot: cdpr.Robot, positions: np.ndarray) -> tuple[cdpr.EquilibriumBatch, cdpr.EquilibriumBatch]:
    """Both methods' answers to the same problems."""
    problems = cdpr.Problems.of(robot, positions)
    return cdpr.solve_many(problems), cdpr.settle_many(problems)


@pytest.mark.parametrize("name", ["parallel", "cogiro", "planar-vertical", "two-cable"])
def test_many_rows_are_compared_as_one_by_one(catalogue, name):
    """The same errors, cross residuals and verdicts as ``compare``, row by row, neutral equilibria included."""
    robot = catalogue[name]
    solved, settled = methods(robot, grid(robot, 30))
    many = compare_many(solved, settled)
    verdicts, outcome = set(), checking.outcomes_of(many)
    for row in range(len(solved)):
        one = cdpr.compare(solved[row], settled[row])
        verdicts.add(one.verdict)
        assert many.verdicts[row] is one.verdict
        assert many.agreement(row).reasons == one.reasons
        for field, column in many.errors.items():
            assert column[row] == pytest.approx(getattr(one, field), rel=1e-6, abs=1e-11), field  # rounding of 1 N
        assert OUTCOMES[outcome[row]] == one.verdict.name.lower()
    assert (cdpr.Verdict.AGREE_EXCEPT_NEUTRAL in verdicts) == (name == "parallel")


def moved(array, amount):
    """``array`` with its first row moved."""
    array = array.copy()
    array[0] += amount
    return array


@pytest.mark.parametrize(
    ("tolerance", "method", "field", "amount"),
    [
        ("POSITION_TOLERANCE", "solved", "positions", 2 * compare.POSITION_TOLERANCE),
        ("ROTATION_TOLERANCE", "solved", "rotations", 1e-4 * np.array([[0, -1, 0], [1, 0, 0], [0, 0, 0]])),
        ("TENSION_TOLERANCE", "solved", "tensions", 2 * compare.TENSION_TOLERANCE),
        ("CROSS_TOLERANCE", "solved", "positions", np.array([0, 0, 5e-7])),  # 0.01 N that MuJoCo finds there,
        ("CROSS_TOLERANCE", "settled", "positions", np.array([0, 0, 5e-7])),  # and here statics
    ],
)
def test_every_tolerance_counts(catalogue, monkeypatch, tolerance, method, field, amount):
    """A negative control for each, alone: one row off by more than it is not agreement; the others still are."""
    robot = catalogue["cogiro"]
    both = dict(zip(("solved", "settled"), methods(robot, grid(robot, 12)), strict=True))
    assert set(compare_many(**both).verdicts) == {cdpr.Verdict.AGREE}
    for other in ("POSITION_TOLERANCE", "ROTATION_TOLERANCE", "TENSION_TOLERANCE", "CROSS_TOLERANCE"):
        if other != tolerance:
            monkeypatch.setattr(compare, other, np.inf)
    if field == "tensions":  # not of slack cables, which would then be taut
        amount *= both[method].tensions[0] > 0
    wrong = dataclasses.replace(both[method], **{field: moved(getattr(both[method], field), amount)})
    wrong_pair = both | {method: wrong}
    verdicts = compare_many(**wrong_pair).verdicts
    assert not cdpr.compare(*(one[0] for one in wrong_pair.values())).agrees
    assert verdicts[0] is not cdpr.Verdict.AGREE
    assert set(verdicts[1:]) == {cdpr.Verdict.AGREE}


def test_wrong_stiffness_on_one_method_is_found_at_every_pose(monkeypatch):
    """The negative control of the whole check: cables 1 % stiffer in statics, and every pose is reported."""
    solve = checking.solve_many

    def stiffer(problems):
        wrong = problems.robot.replace(axial_stiffness=1.01 * problems.robot.axial_stiffness)
        return dataclasses.replace(solve(wrong, problems.positions), problems=problems)

    monkeypatch.setattr(checking, "solve_many", stiffer)
    check = cdpr.check("cogiro", (3, 2, 2))
    assert not check.agrees
    assert len(check.disagreements) == 12
    assert (check.dataset["outcome"] == OUTCOMES.index("disagree")).all()
    first = check.disagreements[0]
    assert (first.robot, first.material, first.outcome) == ("cogiro", "vectran-0.7mm", "disagree")
    assert first.position == tuple(float(check.dataset[name][0]) for name in "xyz")
    assert any("residual" in reason for reason in first.reasons)


def test_a_check_counts_the_poses_whose_equilibria_are_proved(monkeypatch):
    """All of `cogiro`; of `parallel` those that are not neutral; none with cables that are 1 % stiffer in MuJoCo."""
    pytest.importorskip("flint")
    check = cdpr.check(["cogiro", "parallel"], (3, 2, 2), certify=True)
    neutral = check.dataset["outcome"] == OUTCOMES.index("agree_except_neutral")
    assert 0 < neutral.sum() < 12
    np.testing.assert_array_equal(check.dataset["proved"], ~neutral)
    counts = list(check_table(check.dataset).columns[-1].cells)
    assert counts == ["12", str(12 - int(neutral.sum()))]
    settle = checking.settle_many

    def stiffer(problems, threads):
        wrong = problems.robot.replace(axial_stiffness=1.01 * problems.robot.axial_stiffness)
        settled = settle(cdpr.Problems.of(wrong, problems.positions, problems.rest_lengths), threads=threads)
        return dataclasses.replace(settled, problems=problems)

    monkeypatch.setattr(checking, "settle_many", stiffer)
    assert not cdpr.check("cogiro", (2, 2, 1), certify=True).dataset["proved"].any()


def test_cables_of_robots_own_files_are_called_by_their_names():
    """In the dataset, in the table and over the map; those without a name, by their stiffness."""
    nameless = cdpr.load_robot("cogiro").replace(axial_stiffness=2e3, name="nameless")
    for result in (
        cdpr.check(["parallel", nameless], (2, 1, 2)),
        cdpr.sweep(["parallel", nameless], (2, 1, 2)),
    ):
        found = result.dataset if isinstance(result, cdpr.Check) else result
        assert found["material"].to_series().to_dict() == {"parallel": "vectran-0.7mm", "nameless": "EA = 2 kN"}
        table = check_table(result.dataset) if isinstance(result, cdpr.Check) else sweep_table(result)
        assert list(table.columns[1].cells) == ["vectran-0.7mm", "EA = 2 kN"]
        draw = maps.draw_agreement_map if isinstance(result, cdpr.Check) else maps.draw_elastic_map
        headings = {text.get_text() for ax in draw(found).axes for text in ax.texts}
        assert {"parallel\nvectran-0.7mm", "nameless\nEA = 2 kN"} <= headings


def test_platform_that_does_not_rest_is_a_finding(monkeypatch):
    """No answer is not agreement."""
    monkeypatch.setattr(dynamic_relaxation, "STEPS", 13)
    check = cdpr.check("cogiro", (2, 1, 1))
    assert [finding.outcome for finding in check.disagreements] == ["unsettled", "unsettled"]
    assert check.disagreements[0].reasons == (cdpr.Status.ITERATION_LIMIT.sentence,)


@pytest.fixture
def first_row_stalls(monkeypatch) -> None:
    """A solver that gives up at the first pose it is asked for."""
    solve = checking.solve_many

    def stalled(problems):
        equilibria = solve(problems)
        status = equilibria.status.copy()
        status[0] = cdpr.Status.STALLED
        return dataclasses.replace(equilibria, status=status)

    monkeypatch.setattr(checking, "solve_many", stalled)


@pytest.mark.usefixtures("first_row_stalls")
def test_pose_that_statics_cannot_solve_is_a_finding():
    """And names the solver's reason."""
    check = cdpr.check("cogiro", (2, 1, 1))
    assert [finding.outcome for finding in check.disagreements] == ["unsolved"]
    assert "forces do not balance" in check.disagreements[0].reasons[0]
    assert np.isnan(check.dataset["position_error"].values.ravel()[0])


def test_pose_from_which_the_platform_falls_is_refused_by_both_methods():
    """Neither agreement nor disagreement: there is nothing to compare."""
    check = cdpr.check("cogiro", {"z": [0.2, 0.7]})
    assert check.dataset["outcome"].values.ravel().tolist() == [OUTCOMES.index("agree"), OUTCOMES.index("refused")]
    assert check.agrees


@pytest.mark.usefixtures("first_row_stalls")
def test_across_shows_the_worst_along_an_axis():
    """One pose that is not solved marks its column, seen along y, and no other."""
    flat = cdpr.check("cogiro", (2, 3, 2)).across("y")
    assert flat["outcome"].sizes == {"y": 1, "robot": 1, "x": 2, "z": 2}
    words = [OUTCOMES[code] for code in flat["outcome"].values.ravel()]
    assert words == ["unsolved", "agree", "agree", "agree"]


def test_cross_residuals_are_compared_with_the_load(monkeypatch, catalogue):
    """A hundred-thousandth of the weight: a little less agrees, a little more does not."""
    robot = catalogue["cogiro"]
    problems = cdpr.Problems.of(robot, [(0.3, 0.25, 0.1)])
    solved, settled = cdpr.solve_many(problems), cdpr.settle_many(problems)
    for share, within in ((0.9, True), (1.1, False)):
        left = np.array([share * 1e-5 * robot.weight])
        monkeypatch.setattr(compare, "residuals_of", lambda *asked, threads, left=left: left)
        assert (compare_many(solved, settled).verdicts == cdpr.Verdict.AGREE).tolist() == [within]


def test_both_methods_are_asked_about_the_cables_that_are_named(monkeypatch):
    """And findings of all blocks of rows are kept."""
    asked, settle, solve = [], checking.settle_many, checking.solve_many

    def recorded(problems, threads):
        asked.append(problems)
        return settle(problems, threads=threads)

    def wrong(problems):
        asked.append(problems)
        solved = solve(problems)
        return dataclasses.replace(solved, positions=solved.positions + 1e-3)

    monkeypatch.setattr(checking, "ROWS", 2)
    monkeypatch.setattr(checking, "settle_many", recorded)
    monkeypatch.setattr(checking, "solve_many", wrong)
    found = cdpr.check("cogiro", {"x": [0.3, 0.4, 0.5]}, ["fishing-0.4mm"])
    assert [problems.axial_stiffness.max() for problems in asked] == [1e3] * 4
    assert [finding.position[0] for finding in found.disagreements] == [0.3, 0.4, 0.5]


def test_across_an_axis_errors_are_those_of_poses_that_agree():
    """A pose that does not agree gives the outcome, and no error."""
    found = cdpr.check("cogiro", {"y": [0.2, 0.3]})
    found.dataset["outcome"][..., 1, :] = checking.OUTCOMES.index("disagree")
    found.dataset["position_error"][:] = np.reshape([1e-9, 1.0], found.dataset["position_error"].shape)
    worst = found.across()
    assert worst["position_error"].item() == 1e-9
    assert worst["outcome"].item() == checking.OUTCOMES.index("disagree")


def test_how_far_from_where_it_should_be_a_platform_rests_is_said_in_millimetres(catalogue):
    """Three of them."""
    found = cdpr.compensate(catalogue["cogiro"], (0.4, 0.25, 0.2))
    away = dataclasses.replace(found.equilibrium, pose=pose.moved(found.pose, 0.003 * np.eye(6)[0]))
    assert (
        "MuJoCo's platform settles 3 mm from there: it is not held" in CompensationCheck(found, away, away).reasons[0]
    )


@pytest.mark.parametrize(("share", "reached_from_commanded"), [(0.5, True), (2.0, False)])
def test_a_platform_is_there_within_its_tolerance(catalogue, share, reached_from_commanded):
    """A fraction of the characteristic length away, which is 55 mm here."""
    robot = catalogue["cogiro"].replace(material="fishing-0.4mm")
    found = cdpr.compensate(robot, (0.35, 0.25, 0.15))
    away = [share * SAME * robot.characteristic_length, 0, 0, 0, 0, 0]
    rest = dataclasses.replace(found.equilibrium, pose=pose.moved(found.pose, np.array(away)))
    assert CompensationCheck(found, found.equilibrium, rest).reached_from_commanded == reached_from_commanded


def test_the_bar_counts_poses_and_the_estimate_is_of_all_robots_and_materials(monkeypatch):
    """Two robots with two materials at 12 poses: 48 in all."""
    told, counted = [], []
    monkeypatch.setattr(checking.free_ram, "refuse_beyond", lambda *asked: told.append(asked))

    @contextlib.contextmanager
    def bar(what: str, total: float, *, show: bool = True):
        counted.append(total)
        yield counted.append

    monkeypatch.setattr(checking, "bar", bar)
    cdpr.check(["parallel", "cogiro"], (3, 2, 2), ["vectran-0.7mm", "fishing-0.4mm"])
    sizes = {what: size for what, size, _ in told}
    assert sizes["grid: a check of 48 poses"] == 12 * checking.BYTES_PER_POSITION + 48 * checking.BYTES_PER_POSE
    assert counted[0] == sum(counted[1:]) == 48


def test_a_tilted_and_loaded_platform_is_checked():
    """The methods agree there too, at other poses than those of a level platform without load."""
    bare = cdpr.check("cogiro", (2, 2, 1))
    found = cdpr.check("cogiro", (2, 2, 1), orientation=(0.05, -0.03, 0.1), external_wrench=(0.5, 0, -1, 0, 0.01, 0))
    assert found.agrees
    assert not np.array_equal(found.dataset["settled_in_statics"], bare.dataset["settled_in_statics"])


def test_single_poses_are_checked_instead_of_a_grid():
    """With the outcomes of a grid at the same poses, and without a plane to draw."""
    grid = cdpr.check("cogiro", {"x": [0.3, 0.4], "y": [0.25], "z": [0.1]})
    poses = cdpr.check("cogiro", poses=[(0.3, 0.25, 0.1), (0.4, 0.25, 0.1)])
    assert poses.dataset["outcome"].dims == ("robot", "pose")
    np.testing.assert_array_equal(
        poses.dataset["position_error"].values.ravel(), grid.dataset["position_error"].values.ravel()
    )
    assert "2 poses" in repr(poses)


def test_where_no_energy_counts_as_constant_equilibria_are_different(monkeypatch):
    """Negative control of neutral stability, which is decided for all rows at once."""
    monkeypatch.setattr(compare, "LEVEL", -1.0)
    solved, settled = methods(cdpr.load_robot("parallel"), np.array([[0.1, 0.1, 0.05], [0.4, 0.25, 0.2]]))
    outcome = checking.outcomes_of(compare_many(solved, settled))
    assert [OUTCOMES[code] for code in outcome] == ["different_equilibria", "agree"]

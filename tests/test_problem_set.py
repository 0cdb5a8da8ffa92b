"""The set of problems is what it says, and a score counts what is right: known answers, false ones, none, and files."""

import json
import math
from pathlib import Path

import numpy as np
import pytest
from inputs import run
from scipy.spatial.transform import RigidTransform, Rotation

import generate_problems as problem_drawing
from cdpr_sim.crosscheck import problem_set, score

pytest.importorskip("flint")

FOLDER = problem_set.PROBLEMS

ALL_AGAIN = 23
"""Every so many-th problem's whole solution is proved again."""


@pytest.fixture(scope="module")
def problems() -> list[problem_set.SetProblem]:
    return problem_set.read_problems()


@pytest.fixture(scope="module")
def few(tmp_path_factory) -> Path:
    """A folder with the first five problems of each level."""
    folder = tmp_path_factory.mktemp("few")
    for level in problem_set.LEVELS:
        told = json.loads((FOLDER / f"{level}.json").read_text())
        (folder / f"{level}.json").write_text(json.dumps(told | {"problems": told["problems"][:5]}))
    return folder


def perfect(one: problem_set.SetProblem) -> RigidTransform:
    stable = one.index.index(0)
    return RigidTransform.from_components(one.positions[stable], Rotation.from_matrix(one.rotations[stable]))


def test_the_set_has_its_levels_and_every_answer_has_the_digits_of_a_double(problems):
    """A hundred of each level, three starts each, names of their own, a stable equilibrium each."""
    assert len({one.name for one in problems}) == len(problems)
    for level in problem_set.LEVELS:
        assert sum(one.level == level for one in problems) == problem_drawing.EACH
    told = [
        one for level in problem_set.LEVELS for one in json.loads((FOLDER / f"{level}.json").read_text())["problems"]
    ]
    assert min(equilibrium["digits"] for one in told for equilibrium in one["equilibria"]) >= 15
    assert all(len(one.starts) == 3 and 0 in one.index for one in problems)
    assert any(one.complete and len(one.index) > 2 for one in problems)


@pytest.mark.slow
def test_solutions_follow_from_what_the_files_state(problems):
    """What ``generate_problems.py`` writes: equilibria, their number and order, and whether they are all."""
    for one in problems[::ALL_AGAIN]:
        solved = problem_drawing.solutions(one)
        assert solved["complete"] == one.complete, one.name
        assert tuple(each["unstable_directions"] for each in solved["equilibria"]) == one.index
        positions = np.array([[float(v) for v in each["position"]] for each in solved["equilibria"]])
        assert np.abs(positions - one.positions).max() <= 1e-15 * np.abs(one.positions).max()


def test_a_solver_that_is_right_has_15_digits_and_one_that_is_off_has_as_many_as_it_has(problems):
    """1 µm at 1 m are 6 digits; a pose that is no equilibrium is called false; no answer is none."""
    one = problems[0]
    size = np.linalg.norm(one.positions[0])
    assert score.evaluated(one, 0, perfect(one), 0.0).digits > 14
    moved = RigidTransform.from_translation([1e-6 * size, 0, 0]) * perfect(one)
    off = score.evaluated(one, 0, moved, 0.0)
    assert off.digits == pytest.approx(6, abs=0.01)
    assert off.solved
    far = RigidTransform.from_translation([0.1 * size, 0, 0]) * perfect(one)
    assert not score.evaluated(one, 0, far, 0.0).solved
    assert score.evaluated(one, 0, far, 0.0).claimed
    assert not score.evaluated(one, 0, None, 0.0).claimed
    assert not score.evaluated(one, 0, [math.nan] * 3, 0.0).claimed


def test_an_equilibrium_that_a_list_lacks_counts_if_it_is_proved(problems):
    """Of a problem whose list is not complete, with its only equilibrium taken away."""
    one = next(one for one in problems if not one.complete)
    other = problem_set.SetProblem(
        **{**vars(one), "positions": one.positions[:1] + 1.0, "rotations": one.rotations[:1], "index": (0,)}
    )
    assert score.evaluated(other, 0, perfect(one), 0.0).digits > 10


def test_score_counts_a_function_of_ones_own_and_a_file_of_answers(tmp_path, monkeypatch, problems, few):
    """Both give what the file gives; status 1 where something is called solved that is not."""
    some = [one for level in problem_set.LEVELS for one in [p for p in problems if p.level == level][:2]]
    answers = {
        one.name: [
            {"position": perfect(one).translation.tolist(), "quaternion": perfect(one).rotation.as_quat().tolist()}
        ] * 3
        for one in some
    }  # fmt: skip
    file = tmp_path / "mine.json"
    file.write_text(json.dumps({"solver": "mine", "answers": answers}))
    words = ["--problems", str(few), "--first", "2", "--json"]
    result = run("score", str(file), *words)
    assert result.exit_code == 0
    told = json.loads(result.stdout)["mine"]
    assert all(told[level]["solved"] == 6 and told[level]["digits"] > 14 for level in problem_set.LEVELS)
    (tmp_path / "stays.py").write_text(
        "def solver(robot, rest_lengths, start, external_wrench=None):\n    return start\n"
    )
    monkeypatch.syspath_prepend(str(tmp_path))
    result = run("score", "stays:solver", *words)
    assert result.exit_code == 1
    assert sum(json.loads(result.stdout)["stays:solver"][level]["false_claims"] for level in problem_set.LEVELS) > 6


def test_newton_solves_what_it_calls_solved_of_the_level_and_number_that_are_asked_for(problems, few):
    """To ten digits and more; of the problems of a folder."""
    some = [one for level in problem_set.LEVELS for one in [p for p in problems if p.level == level][:3]]
    found = score.score("newton", score.SOLVERS["newton"], some)
    assert all(one.solved for one in found.outcomes if one.claimed)
    assert np.median([one.digits for one in found.outcomes]) > 10
    result = run("score", "newton", "--problems", few, "--level", "lower", "--first", "1", "--json")
    assert result.exit_code == 0
    told = json.loads(result.stdout)["newton"]
    assert told["lower"]["solved"] == 3
    assert all(told[level]["requested"] == 0 for level in problem_set.LEVELS if level != "lower")

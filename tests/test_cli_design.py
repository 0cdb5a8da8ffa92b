"""`cdpr-sim design` and `clearances`: files, tables, exit statuses, sentences."""

import json
import re

import numpy as np
import pytest
from typer.testing import CliRunner

import cdpr_sim as cdpr
from cdpr_sim.cli import app
from cdpr_sim.crosscheck.layout_validation import LayoutValidation
from cdpr_sim.design.objectives import OBJECTIVES

LINE = ["--line", "0.17", "0.25", "0.1", "0.63", "0.25", "0.1", "--points", "4"]
QUICK = [*LINE, "--generations", "10"]


def run(*words: str):
    return CliRunner().invoke(app, list(map(str, words)))


def test_design_writes_a_robot_that_is_better(tmp_path):
    """A file that loads, and a picture; the numbers that it prints are those of the file."""
    output, picture = tmp_path / "better.toml", tmp_path / "better.png"
    told = run("design", "parallel", *QUICK, "--move", "exits=0.08", "-o", output, "--picture", picture, "--json")
    assert told.exit_code == 0, told.output
    found = json.loads(told.stdout)
    robot = cdpr.load_robot(output)
    assert robot.exits.tolist() == found["exits"]
    assert np.abs(robot.exits - cdpr.load_robot("parallel").exits).max() <= 0.08 + 1e-12
    line = np.linspace((0.17, 0.25, 0.1), (0.63, 0.25, 0.1), 4)
    assert cdpr.solve_many(robot, line).tilt.max() == pytest.approx(found["after"], abs=1e-9)
    assert found["after_in_mujoco"] < 0.5 * found["before_in_mujoco"]
    assert found["poses_in_mujoco"] == 7
    assert picture.read_bytes().startswith(b"\x89PNG")
    again = run("design", "parallel", *QUICK, "-o", output)
    assert again.exit_code == 2
    assert "exists" in again.stderr


@pytest.mark.parametrize(("agrees", "better", "status"), [(True, True, 0), (False, True, 1), (True, False, 1)])
def test_design_exits_by_what_mujoco_says(agrees, better, status, monkeypatch):
    """0 only where both methods agree that the new layout is better."""
    monkeypatch.setattr(LayoutValidation, "agrees", agrees)
    monkeypatch.setattr(LayoutValidation, "better", better)
    assert run("design", "parallel", *LINE[:-1], 2, "--generations", "1").exit_code == status


LEVEL = ["--move", "exits=0.05", "--grid", "3", "1", "2", "--generations", "3"]
"""Of `planar-horizontal`, which never tilts."""


def test_design_that_finds_nothing_better_says_so_and_writes_nothing(tmp_path, monkeypatch):
    """In one sentence, with exit status 1; in Python the result is the given robot; JSON says that it is not better."""
    monkeypatch.chdir(tmp_path)
    files = ["-o", "a.toml", "--picture", "a.png"]
    told = run("design", "planar-horizontal", *LEVEL, *files)
    assert told.exit_code == 1
    said = " ".join(told.stdout.split())
    assert said.startswith("planar-horizontal: worst tilt 0° as given, and none of ")
    assert said.endswith(" layouts evaluated is better. Nothing is written.")
    as_json = run("design", "planar-horizontal", *LEVEL, *files, "--json")
    assert (as_json.exit_code, json.loads(as_json.stdout)["better"]) == (1, False)
    assert not [*tmp_path.iterdir()]
    robot = cdpr.load_robot("planar-horizontal")
    found = cdpr.find_layout(robot, [(0.3, 0, 0.1), (0.5, 0, 0.3)], within=0.05, generations=2)
    assert not found.better
    assert found.robot is robot
    assert found.changes == ()
    assert "none of" in str(found)
    assert "no better layout" in repr(found)
    assert not cdpr.validate_layout(found).better


def test_a_front_without_a_better_layout_says_so_and_writes_nothing(tmp_path):
    """As `design` does."""
    pytest.importorskip("pymoo")
    folder = tmp_path / "front"
    told = run("front", "planar-horizontal", *LEVEL, "-o", folder)
    assert told.exit_code == 1
    said = " ".join(told.stdout.split())
    assert said.startswith("planar-horizontal: points moved 0 mm and worst tilt 0° as given, and none of ")
    assert said.endswith("is better by either. Nothing is written.")
    assert not folder.exists()
    line = [(x, 0.25, 0.1) for x in (0.2, 0.4)]
    options = dict(within=0.05, generations=2, population=10)
    assert cdpr.find_front(cdpr.load_robot("parallel"), line, **options).better
    flat = cdpr.find_front(cdpr.load_robot("planar-horizontal"), [(0.3, 0, 0.1)], **options)
    assert "no layout better" in repr(flat)


def test_a_layout_that_only_satisfies_the_constraints_is_better():
    """The given one does not; how far points moved is measured from it, in MuJoCo as well."""
    limit = ["--objective", "points moved", "--limit", "worst tilt=0.4"]
    told = run("design", "parallel", *LINE, "--generations", "20", "--move", "exits=0.05", *limit, "--json")
    found = json.loads(told.stdout)
    assert (told.exit_code, found["better"], found["before"]) == (0, True, 0)
    assert found["after_in_mujoco"] == pytest.approx(found["after"]) == pytest.approx(found["largest_displacement"])
    assert found["after"] > 0


def test_help_names_every_objective():
    """Of `design` and of `front`."""
    for command in ("design", "front"):
        said = " ".join(run(command, "--help").stdout.split())
        assert [name for name in OBJECTIVES if name not in said] == []


def test_design_says_what_is_worse_than_before_and_the_limit_that_prevents_it():
    """Slack cables and deviation, for the highest tension; with the limits that it names, neither is worse."""
    words = [
        "design",
        "planar-horizontal",
        "--move",
        "exits=0.1",
        "--objective",
        "highest tension",
        "--generations",
        "15",
    ]
    said = " ".join(run(*words).stdout.split())
    limits = re.findall(r'--limit "([^"]+)"', said)
    assert [limit.partition("=")[0] for limit in limits] == ["worst deviation", "most slack cables"]
    assert said.count("(worse)") == 2
    kept = run(*words, *(word for limit in limits for word in ("--limit", limit)))
    assert kept.exit_code == 0, kept.output
    assert "orse" not in " ".join(kept.stdout.split()).replace("it may be worse than before", "")


def test_design_says_what_it_does_not_promise():
    """Tables of what moved, of before and after, and the limits of it all."""
    told = run("design", "parallel", *QUICK, "--along", "0", "0", "1", "--within", "0.02")
    assert "exit 1 z" in told.stdout
    assert "exit 1 x" not in told.stdout
    assert "The layout was optimised for these poses" in " ".join(told.stdout.split())


def test_design_says_that_exits_leave_the_frame_and_a_box_keeps_them_in(tmp_path):
    """On the command line, in JSON and in Python; a frame that nobody gave is the box around the exits, and moves."""
    quick = ["--line", "0.17", "0.25", "0.1", "0.63", "0.25", "0.1", "--points", "2", "--generations", "1"]
    told = run("design", "cogiro", *quick, "--move", "exits=0.16")
    said = " ".join(told.stdout.split())
    assert "are outside the frame now, by up to" in said
    boxed = run("design", "cogiro", *quick, "--move", "exits", "--within", "0,0,0.4,0.8,0.5,0.5", "--json")
    found = json.loads(boxed.stdout)
    assert found["warnings"] == []
    assert found["changes"]
    exits = np.array(found["exits"])
    assert (exits >= [0, 0, 0.4]).all()
    assert (exits <= [0.8, 0.5, 0.5]).all()
    unframed = cdpr.load_robot("cogiro").replace(frame=None)
    searched = dict(within=0.16, generations=1, population=5, polish=False)
    assert cdpr.find_layout(unframed, unframed.home, **searched).warnings == ()
    framed = cdpr.find_layout(cdpr.load_robot("cogiro"), unframed.home, **searched, objective="worst deviation")
    assert framed.better
    assert any("outside the frame now" in sentence for sentence in framed.warnings)
    assert framed.warnings[0] in str(framed)


def test_front_says_which_layouts_leave_the_frame():
    """By the numbers that its table gives them."""
    robot = cdpr.load_robot("cogiro")
    found = cdpr.find_front(robot, robot.home, within=0.16, generations=1, population=5)
    outside = [
        row + 1
        for row in range(len(found))
        if ((found.robot(row).exits < robot.frame[0]) | (found.robot(row).exits > robot.frame[1])).any()
    ]
    assert outside
    assert found.warnings[0].endswith(f"outside the frame: {', '.join(map(str, outside))}.")
    inside = cdpr.find_front(robot, robot.home, within=robot.frame, generations=1, population=5)
    assert inside.warnings == ()


def test_clearances_say_what_is_nearest():
    """Exit status 1 where something comes nearer than it may."""
    free, tight = (run("clearances", "cogiro", *LINE, "--min-distance", least) for least in (0.001, 0.03))
    assert (free.exit_code, tight.exit_code) == (0, 1)
    assert "cable 2 and the platform" in free.stdout
    assert "at 4 of 4 poses" in free.stdout
    assert "at 0 of 4 poses" in tight.stdout

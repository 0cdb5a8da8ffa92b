"""`cdpr-sim design` and `clearances`: files, tables, exit statuses, sentences."""

import json

import numpy as np
import pytest
from typer.testing import CliRunner

import cdpr_sim as cdpr
from cdpr_sim.cli import app
from cdpr_sim.crosscheck.layout_validation import LayoutValidation

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
    framed = cdpr.find_layout(cdpr.load_robot("cogiro"), unframed.home, **searched)
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

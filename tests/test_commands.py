"""Commands: what each says, its exit status and its JSON; what its options reach; and a world that fails."""

import ast
import dataclasses
import functools
import inspect
import json
import math
import os
import re
import shlex
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from contextlib import contextmanager, suppress
from pathlib import Path

import numpy as np
import pytest
import typer
from inputs import FILES, run, said
from rich.console import Console
from sample_problems import garage_crane
from test_writers import WRITERS

import cdpr_sim as cdpr
from cdpr_sim.cli import app, main, terminal
from cdpr_sim.crosscheck import check as checking
from cdpr_sim.crosscheck.layout_validation import LayoutValidation
from cdpr_sim.design.objectives import OBJECTIVES
from cdpr_sim.drawing import maps, still
from cdpr_sim.physics import viewer
from cdpr_sim.report import robot_summary
from cdpr_sim.robots.importing import FORMATS
from cdpr_sim.robots.robot_file_text import as_toml

COMMANDS = typer.main.get_command(app).commands  # type: ignore[attr-defined]
POSE, SOFT = (0.3, 0.22, 0.15), "fishing-0.4mm"
LINE = "--line 0.17 0.25 0.1 0.63 0.25 0.1"
LEVEL = "--move exits=0.05 --grid 3 1 2 --generations 3"
"""Of `planar-horizontal`, which never tilts."""

STOPS = "--waypoint 0.35,0.25,0.1 --waypoint 0.35,0.25,0.15,0,0,0.1 --waypoint 0.45,0.25,0.15"
GARAGE = "garage.toml --pose 1.5 1.5 0.3"


def mixed() -> cdpr.Robot:
    """DemoBot with each mixture of properties on another cable, with mass on most."""
    return cdpr.load_robot("cogiro").replace(
        material=SOFT, pulley_radius=[0.01, 0.0] * 4, stiffening=[(100.0, 2e4), (100.0, 2e4), (0, 0), (0, 0)] * 2,
        winch_to_exit=[0.5] * 4 + [0.0] * 4, reeving=[1, 2, 1, 1, 2, 1, 3, 1],
        linear_density=[5e-4, 5e-4, 0.0, 1e-3, 5e-4, 0.0, 1e-3, 0.0],
    )  # fmt: skip


@pytest.fixture(scope="session")
def files() -> dict[str, str]:
    """Robots, one called as if it were markup; and measurements by MuJoCo at EA = 800 N."""
    soft, parallel = cdpr.load_robot("cogiro").replace(axial_stiffness=800.0), cdpr.load_robot("parallel")
    lines = ["commanded_x [mm],commanded_y [mm],commanded_z [mm],measured_x [mm],measured_z [mm],measured_beta [deg]"]
    for x in (200.0, 300.0, 450.0, 600.0):
        found = cdpr.settle(soft, (x / 1e3, 0.2, 0.1))
        told = *(1e3 * found.position[[0, 2]]).tolist(), math.degrees(found.euler[1])
        lines.append(",".join(map(repr, (x, 200, 100, *told))))
    memory = dict(winch_to_exit=0.5, pulley_friction=0.02, hysteresis=[(0.1, np.inf, 0.2)], creep=[(4e5, 600.0)])
    robots = {
        "garage": garage_crane(), "rope": parallel.replace(linear_density=0.002), "mixed": mixed(),
        "memory": cdpr.load_robot("cogiro").replace(material=SOFT, **memory),
        "odd": parallel.replace(name="crane [v2] [bold] $x"),
    }  # fmt: skip
    return {f"{name}.toml": as_toml(robot) for name, robot in robots.items()} | {"line.csv": "\n".join(lines)}


@pytest.fixture
def folder(files, tmp_path, monkeypatch) -> Path:
    """To work in, with these files; reports have small maps."""
    for name, text in files.items():
        (tmp_path / name).write_text(text)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(robot_summary, "POINTS", 5)
    return tmp_path


def contains(text: str, words: str) -> bool:
    """In this order, with anything for each …, at the beginning after ^, whatever line breaks there are."""
    beginning, words = ("^", words[1:]) if words.startswith("^") else ("", words)
    return re.search(beginning + ".*".join(map(re.escape, words.split("…"))), said(text)) is not None


def away(one: dict, pose: tuple = (0.3, 0.25, 0.1)) -> float:
    return float(np.linalg.norm(np.subtract(one["position"], pose)))


def by_size(effects: list[dict]) -> bool:
    """By how far they move the platform [mm], the largest first."""
    arm = 1e3 * cdpr.load_robot("parallel").characteristic_length
    moved = [math.hypot(one["position"], arm * math.radians(one["rotation"])) for one in effects]
    return moved == sorted(moved, reverse=True)


ANSWERS = [  # a command, its exit status, what it says, and what is in its JSON
    ("settle parallel --pose 0.17 0.25 0.1 --all", 0,
     "^The two methods agree. Stable equilibrium. deviation…tilt…slack cables 4 of 8…26.420 26.420…seecr/fsolve: ",
     {"agrees": True, "results.fsolve.equilibrium": False}),
    ("settle parallel --pose 0.2 0.25 0.1", 0,
     "^The two methods agree. Stable equilibrium. deviation…tilt…slack cables…highest tension…load is unknown", {}),
    ("settle parallel --material dyneema-2mm", 0, "highest tension…% of its breaking load of", {}),
    ("settle parallel --pose 0.1 0.1 0.05", 0, "", {}),  # neutral
    ("settle parallel --waypoint 0.1,0.1,0.05 --waypoint 0.4,0.25,0.2 --path-points 2", 0,
     "^The methods agree at 2 of 2 poses.", {}),
    (f"settle cogiro {STOPS} --path-points 4 --wrench 0,0,-1,0,0,0", 0, "The methods agree at 4 of 4 poses.",
     {"agrees": [True] * 4, "mujoco.tensions": lambda found: np.shape(found) == (4, 8),
      "positions": lambda found: found[0] == [0.35, 0.25, 0.1]}),
    (f"settle {GARAGE} --no-certify", 0, "slack cables 0 of 8",
     {"results.newton.tensions": lambda found: min(found) > 10}),
    ("solve parallel --pose 0.2 0.25 0.1", 0, "^Stable equilibrium, …deviation…tilt…slack cables…highest tension", {}),
    ("solve parallel --pose 0.2 0.25 0.1 --all", 0, "iterations", {"equilibrium": True}),
    ("certify two-cable", 0, "^Proved: ", {}),
    ("compensate cogiro --material fishing-0.4mm --pose 0.3 0.25 0.1", 0, "^The commanded pose is held exactly",
     {"held": True, "before.mujoco": lambda one: away(one) > 4e-4, "before.newton": lambda one: away(one) > 4e-4,
      "after.mujoco": lambda one: away(one) < 1e-9, "after.newton": lambda one: away(one) < 1e-9}),
    ("compensate parallel --pose 0.17 0.25 0.1", 1, "^No lengths hold the commanded pose…would have to push", {}),
    ("compensate parallel --pose 0.17 0.25 0.1 --arm 0", 1, "",
     {"exact": False, "distance": lambda found: found < 1e-6,
      "after.mujoco": lambda one: away(one, (0.17, 0.25, 0.1)) < 1e-6}),
    (f"compensate {GARAGE} --tension-limits 15 300", 0, "",
     {"after.mujoco.tensions": lambda found: min(found) > 10, "before.newton.tensions": lambda found: min(found) > 10}),
    ("sensitivity parallel --pose 0.25 0.25 0.1 --rows 5", 0, "^Largest effects: …rest length 1…natural frequencies",
     {"frequencies": lambda found: len(found) == 6, "effects": by_size}),
    ("equilibria two-cable --starts 20", 0, "^1 equilibrium found, 1 stable.", {}),
    ("equilibria rope.toml --pose 0.2 0.25 0.1 --starts 5", 0, "MuJoCo reaches the same one",
     {"equilibria.0.stays_in_mujoco": None}),  # undamped cables would oscillate themselves
    ("identify cogiro line.csv --position-error 0.01 --rotation-error 0.01", 0, "",
     {"unknowns.axial_stiffness.value": lambda found: found == pytest.approx(800, rel=1e-4)}),
    ("identify cogiro line.csv --unknown axial_stiffness --unknown mass", 1,
     "undetermined…undetermined…cannot distinguish axial_stiffness and mass", {}),
    ("check two-cable --grid 2 1 1", 0, "^No disagreement at 2 poses", {}),
    ("check parallel cogiro --grid 3 2 2", 0, "No disagreement at 24 poses; MuJoCo settled at all of them.", {}),
    (f"check cogiro {STOPS} --path-points 5", 0, "No disagreement at 5 poses", {}),
    ("clearances cogiro --grid 1 1 1", 0, "^Interference-free", {}),
    (f"clearances cogiro {LINE} --points 4 --min-distance 0.001", 0, "at 4 of 4 poses…cable 2 and the platform", {}),
    (f"clearances cogiro {LINE} --points 4 --min-distance 0.03", 1, "at 0 of 4 poses", {}),
    ("sweep garage.toml --grid 2 2 2", 0, "8 commanded poses…garage", {}),
    (f"map parallel cogiro --material vectran-0.7mm --material {SOFT} --points 5 -o map.png", 0,
     f"parallel vectran-0.7mm…parallel {SOFT}…cogiro vectran-0.7mm…cogiro {SOFT}…parallel with rigid cables: static"
     "…cogiro with rigid cables: static", {}),
    (f"map parallel cogiro {STOPS} --path-points 9 -o path.svg", 0, "9 commanded poses", {}),
    (f"design parallel {LINE} --points 2 --generations 2 --along 0 0 1 --within 0.02", 0,
     "The layout was optimised for these poses…exit 1 z", {"better": True}),
    (f"design parallel {LINE} --points 4 --generations 20 --move exits=0.05 --objective 'points moved' "
     "--limit 'worst tilt=0.4'", 0, "", {"better": True, "before": 0, "": lambda told: told["after"] > 0
     and [told["after_in_mujoco"], told["largest_displacement"]] == pytest.approx([told["after"]] * 2)}),
    (f"design planar-horizontal {LEVEL} -o a.toml --picture a.png", 1,
     "^planar-horizontal: worst tilt 0° as given, and none of …layouts evaluated is better. Nothing is written.",
     {"better": False}),
    (f"front planar-horizontal {LEVEL} -o front", 1,
     "^planar-horizontal: points moved 0 mm and worst tilt 0° as given, and none of …by either. Nothing is written",
     {}),
    (f"design cogiro {LINE} --points 2 --generations 1 --move exits=0.16", 0,
     "are outside the frame now, by up to",
     {"warnings": lambda found: sum("outside the frame" in one for one in found) == 1}),
    (f"design cogiro {LINE} --points 2 --generations 1 --move exits --within 0,0,0.4,0.8,0.5,0.5", 0, "",
     {"warnings": [], "changes": len, "exits": lambda found: (np.array(found) >= [0, 0, 0.4]).all()
      and (np.array(found) <= [0.8, 0.5, 0.5]).all()}),
    ("models two-cable -o there", 0, "robot.xml", {}),
    (f"import {FILES / 'crane_gazebo.yaml'} -o mine.toml", 0,
     "crane_gazebo, spatial, 4 cables, 5 kg…- The elasticity of its cables is not given", {}),
    ("video two-cable --drive-seconds 0.5 --seconds 0.4 --fps 5 --size 320 240 -o v.gif", 0, "^v.gif", {}),
    ("show two-cable -o two.png", 0, "two-cable…two.png", {}),
    *((f"{command.replace(' ', f' {name}.toml ', 1)}", (0, 1) if command.startswith("clear") else 0, "", {})
      for command in ("sweep --grid 2 1 1 -o s.nc", "map --points 3 -o map.png", "check --grid 1 1 1", "show -o a.png",
                      "clearances --grid 1 1 1", "video --seconds 0.4 --fps 5 --size 320 240 -o v.gif",
                      "report --no-video --grid 1 1 1 -o r.html")
      for name in ("mixed", "memory")),
    *((f"{command} mixed.toml --pose {POSE[0]} {POSE[1]} {POSE[2]} {more}", 0, "", {"": len})
      for command, more in {"settle": "", "solve": "", "compensate": "", "sensitivity": "", "equilibria": "--starts 5"
                            }.items()),
    ("settle memory.toml", 0, "", {"agrees": True}), ("solve memory.toml", 0, "", {"equilibrium": True}),
    ("models mixed.toml -o models", 0, "", {}),
    ("design mixed.toml --line 0.3 0.2 0.15 0.4 0.2 0.15 --points 2 --generations 1 --within 0.01", (0, 1), "", {}),
    *((command, (0, 1), "crane [v2] [bold] $x", {}) for command in (
        "settle odd.toml", "solve odd.toml", "compensate odd.toml", "sensitivity odd.toml",
        "sweep odd.toml --grid 2 1 1",
        "equilibria odd.toml --starts 50", "check odd.toml --grid 2 1 1", "map odd.toml --points 5 -o map.png",
        "models odd.toml -o models")),
]  # fmt: skip


@pytest.mark.parametrize(("command", "status", "words", "told"), ANSWERS, ids=[command for command, *_ in ANSWERS])
def test_commands_answer_in_words_in_json_and_by_their_status(command, status, words, told, folder, monkeypatch):
    """The verdict comes first; robots of every kind and name are taken; what ``-o`` names is there afterwards."""
    release = cdpr.release
    monkeypatch.setattr(cdpr, "release", lambda one, seconds: release(one, seconds=seconds / 20))
    statuses = status if isinstance(status, tuple) else (status,)
    named = [Path(place) for place in re.findall(r"(?:-o|--picture) (\S+)", command)]
    if words or not told:
        result = run(*shlex.split(command), columns=140)
        assert result.exit_code in statuses, result.output
        assert contains(result.stdout, words)
        assert "…" not in result.stdout
        assert [place.exists() for place in named] == [0 in statuses] * len(named)
    if told:
        result = run(*shlex.split(command), "--json")
        assert result.exit_code in statuses, result.output
        values = json.loads(result.stdout)
        for path, expected in told.items():
            found = (
                functools.reduce(lambda one, key: one[int(key) if key.isdigit() else key], path.split("."), values)
                if path
                else values
            )
            assert expected(found) if callable(expected) else found == expected, (path, found)


@pytest.mark.parametrize(
    ("command", "absent"),
    [
        ("settle parallel --pose 0.2 0.25 0.1", ("SEECR", "fsolve", "iterations", "unbalanced")),
        ("solve parallel --pose 0.2 0.25 0.1", ("iterations",)),
        (f"sensitivity {GARAGE}", ("set of taut cables",)),
        ("equilibria rope.toml --pose 0.2 0.25 0.1 --starts 5", ("released",)),
        (f"design parallel {LINE} --points 2 --generations 1 --along 0 0 1 --within 0.02", ("exit 1 x",)),
        ("import --help", ("...",)),
    ],
)
def test_what_was_not_asked_for_or_does_not_apply_is_not_said(command, absent, folder):
    """Details and the paper's solver come with --all alone."""
    found = run(*command.split())
    assert found.exit_code == 0
    assert not [words for words in absent if words in found.stdout]


def test_what_can_be_named_is_listed_as_reviewed(snapshot):
    """Robots and materials with their numbers; help of `import` and `design` names formats and objectives."""
    snapshot("commands/robots.txt", run("robots", columns=200).stdout, rel=1e-9)
    listed = run("robots", columns=200).stdout
    for name in (*cdpr.list_robots(), *cdpr.MATERIALS):
        assert name in listed
    section = np.pi / 4 * 0.002**2  # of the circle that a rope of 2 mm fills in part
    for name, modulus, fill in re.findall(r"^ (\S+) +(\S+) GPa +(\S+) +\S+ kg/m³", listed, re.MULTILINE):
        robot = cdpr.load_robot("cogiro").replace(material=f"{name}-2mm")
        expected = 1e9 * float(modulus) * float(fill) * section
        assert robot.axial_stiffness == pytest.approx(expected, rel=1e-2), name
    formats = said(run("import", "--help", columns=200).stdout)
    assert all(one.TITLE in formats and name in formats.partition("--format")[2] for name, one in FORMATS.items())
    for command in ("design", "front"):
        assert [name for name in OBJECTIVES if name not in said(run(command, "--help").stdout)] == []
    for status in ("0 for success; 1 if", "2 for invalid input", "3 for system errors", "130 if interrupted"):
        assert status in said(run("--help").stdout)


def test_a_pose_may_be_written_with_commas():
    """The same pose."""
    usual = run("solve", "parallel", "--json", "--pose", "0.17", "0.25", "0.1")
    assert usual.exit_code == 0, usual.output
    for words in (["--pose", "0.17,0.25,0.1"], ["--pose", "0.17, 0.25, 0.1"], ["--pose=0.17,0.25,0.1"]):
        assert run("solve", "parallel", "--json", *words).stdout == usual.stdout


def test_an_imported_file_is_the_robot_of_the_file_that_it_writes(folder):
    """One command from another project's file to ours, which any command takes; notes are told."""
    given = FILES / "crane_gazebo.yaml"
    assert run("import", given, "-o", "mine.toml").exit_code == 0
    ours, theirs = (run("solve", place, "--json") for place in ("mine.toml", given))
    assert (ours.exit_code, ours.stdout) == (0, theirs.stdout)
    assert "cdpr-sim: note: The elasticity of its cables is not given" in theirs.stderr


def test_a_robot_is_drawn_with_its_numbers(folder):
    """Each cable's number at both ends, one label for exits at one point; `show` writes what a notebook shows."""
    robot = cdpr.load_robot("cogiro")
    figure = cdpr.draw(robot)
    for ax in figure.axes:
        numbers = [int(number) for text in ax.texts for number in re.findall(r"\d+", text.get_text())]
        assert sorted(numbers) == list(range(1, robot.cables + 1))
    assert run("show", "cogiro", "-o", "robot.png").exit_code == 0
    assert Path("robot.png").read_bytes() == figure._repr_png_()
    pair = robot.replace(exits=robot.exits[[0, 0, 2, 3, 4, 5, 6, 7]], linear_density=1e-3)
    assert "1, 2" in [text.get_text() for text in cdpr.draw(pair).axes[0].texts]
    moved, usual = (
        np.asarray(cdpr.draw(robot, pose).axes[0].images[0].get_array()) for pose in ((0.3, 0.2, 0.2), None)
    )
    assert (moved != usual).any(-1).mean() > 0.01  # of the pixels
    one = cdpr.Robot(exits=[[0, 0, 0]], anchors=[[0, 0, 0]], axial_stiffness=1e3, mass=1, platform_size=[1, 1, 1])
    assert still.encoded(cdpr.draw(one.replace(name="$odd{$"), (0.5, 0, 0)))  # a frame of no size


def test_sweep_keeps_its_result_and_what_mujoco_says(folder):
    """A store that can be opened."""
    assert run("sweep", "cogiro", "--grid", "2", "1", "1", "--settle", "-o", "settled.zarr").exit_code == 0
    with cdpr.open_sweep("settled.zarr") as swept:
        poses = [(x, swept.y.item(), swept.z.item()) for x in swept.x.values]
        settled = cdpr.settle_many(cdpr.load_robot("cogiro"), poses).positions
        np.testing.assert_array_equal(swept["settled_position"].values.reshape(2, 3), settled)
        assert not np.array_equal(swept["position"].values.reshape(2, 3), settled)


def test_maps_draw_each_quantity_of_each_robot_and_checks_a_plane(folder, monkeypatch):
    """Along a path; where the methods agree, seen along y."""
    drawn, draw = [], maps.draw_agreement_map
    monkeypatch.setattr(maps, "draw_agreement_map", lambda flat: drawn.append(dict(flat.sizes)) or draw(flat))
    assert run("check", "cogiro", "--grid", "3", "2", "2", "-o", "agreement.png").exit_code == 0
    assert (drawn[0]["x"], drawn[0]["y"], drawn[0]["z"]) == (3, 1, 2)
    assert run("map", "parallel", "cogiro", *STOPS.split(), "--path-points", "3", "-o", "path.svg").exit_code == 0
    for name in ("tilt", "distance", "slack_count", "feasible"):
        assert Path("path.svg").read_text().count(f'<g id="{name}">') == 2


# ---------------------------------------------------------------------------------------------------- disagreements


def stiffer(problem: cdpr.Problem, method: str = "newton") -> cdpr.Equilibrium:
    """Statics with cables 1 % too stiff."""
    found = cdpr.solve_many(problem.robot.replace(axial_stiffness=1.01 * problem.robot.axial_stiffness), [problem.pose])
    return dataclasses.replace(found[0], problem=problem)


def test_commands_exit_1_and_say_so_where_the_methods_disagree(monkeypatch):
    """With the pose and the reason; only agreement is success."""
    solve = checking.solve_many

    def wrong(asked):
        harder = dataclasses.replace(asked, axial_stiffness=1.01 * asked.axial_stiffness)
        return dataclasses.replace(solve(harder), problems=asked)

    monkeypatch.setattr(cdpr, "solve", stiffer)
    settled = run("settle", "parallel", "--pose", "0.38", "0.25", "0.1")
    assert (settled.exit_code, contains(settled.stdout, "^The two methods disagree")) == (1, True), settled.output
    monkeypatch.setattr(checking, "solve_many", wrong)
    checked = run("check", "cogiro", "--grid", "2", "1", "1")
    assert checked.exit_code == 1
    assert contains(
        checked.stdout,
        "2 of 2 poses do not agree…cogiro, vectran-0.7mm at (0.1, 0.25, 0.225) m: "
        "disagree: MuJoCo at the static pose has a residual of",
    )


@pytest.mark.parametrize(("agrees", "better", "status"), [(True, True, 0), (False, True, 1), (True, False, 1)])
def test_design_exits_by_what_mujoco_says(agrees, better, status, monkeypatch):
    """0 only where both methods agree that the new layout is better."""
    monkeypatch.setattr(LayoutValidation, "agrees", agrees)
    monkeypatch.setattr(LayoutValidation, "better", better)
    assert run("design", "parallel", *LINE.split(), "--points", 2, "--generations", "1").exit_code == status


def test_design_writes_a_robot_that_is_better_by_the_numbers_that_it_prints(folder):
    """Within its bounds; the file's tilt is that of the JSON."""
    words = f"design parallel {LINE} --points 4 --generations 10 --move exits=0.08 -o better.toml --json"
    told = run(*words.split())
    assert told.exit_code == 0, told.output
    found, robot = json.loads(told.stdout), cdpr.load_robot("better.toml")
    assert robot.exits.tolist() == found["exits"]
    assert np.abs(robot.exits - cdpr.load_robot("parallel").exits).max() <= 0.08 + 1e-12
    line = np.linspace((0.17, 0.25, 0.1), (0.63, 0.25, 0.1), 4)
    assert cdpr.solve_many(robot, line).tilt.max() == pytest.approx(found["after"], abs=1e-9)
    assert found["after_in_mujoco"] < 0.5 * found["before_in_mujoco"]
    assert found["poses_in_mujoco"] == 7


def test_design_says_what_is_worse_than_before_and_the_limit_that_prevents_it():
    """Slack cables and deviation, for the highest tension; with the limits that it names, neither is worse."""
    words = ["design", "planar-horizontal", "--move", "exits=0.1", "--generations", "15", "--objective"]
    text = said(run(*words, "highest tension").stdout)
    limits = re.findall(r'--limit "([^"]+)"', text)
    assert [limit.partition("=")[0] for limit in limits] == ["worst deviation", "most slack cables"]
    assert text.count("(worse)") == 2
    kept = run(*words, "highest tension", *(word for limit in limits for word in ("--limit", limit)))
    assert kept.exit_code == 0, kept.output
    assert "orse" not in said(kept.stdout).replace("it may be worse than before", "")


def test_a_search_says_what_is_no_better_and_which_layouts_leave_the_frame():
    """In Python: the given robot is the result; a frame that nobody gave is the box around the exits, and moves."""
    robot, cogiro = cdpr.load_robot("planar-horizontal"), cdpr.load_robot("cogiro")
    found = cdpr.find_layout(robot, [(0.3, 0, 0.1), (0.5, 0, 0.3)], within=0.05, generations=2)
    assert (found.better, found.robot is robot, found.changes) == (False, True, ())
    assert "none of" in str(found)
    assert "no better layout" in repr(found)
    assert not cdpr.validate_layout(found).better
    few = dict(within=0.16, generations=1, population=5)
    assert "no layout better" in repr(cdpr.find_front(robot, [(0.3, 0, 0.1)], **few))
    line = [(x, 0.25, 0.1) for x in (0.2, 0.4)]
    assert cdpr.find_front(cdpr.load_robot("parallel"), line, within=0.05, generations=2, population=10).better
    assert cdpr.find_layout(cogiro.replace(frame=None), cogiro.home, **few, polish=False).warnings == ()
    front = cdpr.find_front(cogiro, cogiro.home, **few)
    exits = [front.robot(number).exits for number in range(len(front))]
    outside = [n + 1 for n, one in enumerate(exits) if ((one < cogiro.frame[0]) | (one > cogiro.frame[1])).any()]
    assert outside
    assert front.warnings[0].endswith(f"outside the frame: {', '.join(map(str, outside))}.")
    assert cdpr.find_front(cogiro, cogiro.home, **few | {"within": cogiro.frame}).warnings == ()


# ---------------------------------------------------------------------------------------------------------- options

AT = [0.3, 0.2, 0.1]
TURN = "0.01 -0.02 0.03"
LOAD, WRENCH = [0.0, 0.0, -1.0, 0.0, 0.01, 0.0], "--wrench 0,0,-1,0,0.01,0"
IPANEMA = cdpr.load_robot("ipanema-1")
TIGHT = IPANEMA.rest_lengths(IPANEMA.home, 500.0).tolist()  # [m]
CHANGED = f"--material {SOFT} --mass 0.7"
THREE = [[0.3, 0.2, 0.1], [pytest.approx(0.35), 0.2, 0.1], [0.4, 0.2, 0.1]]
POINTS = "--line 0.3 0.2 0.1 0.4 0.2 0.1 --points 3"
SEARCH = f"--move anchors=0.01 --move exits --symmetry none --seed 5 --generations 7 --material {SOFT}"
MOVES = [("anchors", 0.01, None), ("exits", 0.05, None)]


def robot_of(asked: dict) -> cdpr.Robot:
    """Of what is asked: the first robot, alone, in a list or in a problem."""
    first = next(one for key in (0, 1) for one in [asked[key]] if not isinstance(one, Path))
    first = first[0] if isinstance(first, list) else first
    return first if isinstance(first, cdpr.Robot) else first.robot


SEEN: dict[object, Callable] = {
    "at": lambda asked: asked[0].pose.translation.tolist(),
    "turned": lambda asked: asked[0].pose.rotation.as_euler("xyz").tolist(),
    "load": lambda asked: asked[0].external_wrench.tolist(),
    "lengths": lambda asked: asked[0].rest_lengths.tolist(),
    "material": lambda asked: robot_of(asked).material,
    "mass": lambda asked: robot_of(asked).mass,
    "pretension": lambda asked: robot_of(asked).pretension,
    "moves": lambda asked: [(one.what, one.within, one.along) for one in asked["move"]],
    "within": lambda asked: dict(asked["subject_to"]),
    "shape": lambda asked: np.shape(asked[1]),
    "points": lambda asked: np.asarray(asked[1]).tolist(),
    "path": lambda asked: asked["poses"].translation.tolist(),
    "positions": lambda asked: asked[0].positions.tolist(),
    "planes": lambda asked: (asked[1]["x"].tolist(), len(asked[1]["y"]), len(asked[1]["z"])),
    "file": lambda asked: str(asked.get("store", asked[0])),
    "line": lambda asked: list(asked[1]),
}
"""What is looked at, by its name; others are arguments, by name or position."""

REACHED = [  # a command with its options, what is called, and what that is given, in the units of the package
    (f"settle parallel --pose 0.3 0.2 0.1 {TURN} {CHANGED} {WRENCH}", "settle",
     {"at": AT, "turned": pytest.approx([0.01, -0.02, 0.03]), "material": SOFT, "mass": 0.7, "load": LOAD}),
    (f"solve parallel --pose 0.3 0.2 0.1 {CHANGED} {WRENCH} --method fsolve --all", "solve",
     {"at": AT, "material": SOFT, "mass": 0.7, "load": LOAD, "method": "fsolve"}),
    (f"certify parallel {CHANGED}", "settle", {"material": SOFT, "mass": 0.7}),
    ("equilibria two-cable --certify --time-limit 60", "certify_all", {"time_limit": 60.0}),
    (f"compensate parallel --pose 0.3 0.2 0.1 --material {SOFT} --tension-limits=1,9 --prefer stiffest --arm 0.5",
     "compensate", {"at": AT, "material": SOFT, "tension_limits": (1.0, 9.0), "prefer": "stiffest", "arm": 0.5}),
    (f"sensitivity parallel --pose 0.3 0.2 0.1 --material {SOFT}", "sensitivity", {"at": AT, "material": SOFT}),
    (f"equilibria parallel --pose 0.3 0.2 0.1 --material {SOFT} --saddles --starts 7", "find_equilibria",
     {"at": AT, "material": SOFT, "saddles": True, "starts": 7}),
    *((f"{command} --pretension 500", function, {"lengths": TIGHT}) for command, function in {
        "certify ipanema-1": "settle", "view ipanema-1": "physics.viewer.open_viewer",
        "sensitivity ipanema-1": "sensitivity", "equilibria ipanema-1": "find_equilibria"}.items()),
    *((f"{command} --pretension 500", function, {"pretension": 500.0}) for command, function in {
        "show ipanema-1 -o there.png": "drawing.still.draw", "identify ipanema-1 line.csv": "identify",
        "design ipanema-1": "find_layout", "front ipanema-1 -o there": "find_front", "check ipanema-1": "check",
        "clearances ipanema-1": "clearances", "sweep ipanema-1 ipanema-2": "sweep", "map ipanema-1": "sweep",
        "video ipanema-1": "drive", "report ipanema-1": "write_report"}.items()),
    (f"identify parallel line.csv --unknown mass --material {SOFT} --position-error 3 --rotation-error 2 "
     "--tension-error 4 --swivel-error 5 --frequency-error 6 --rest-length-error 7 --robust", "identify",
     {2: ["mass"], "material": SOFT, "position_error": 0.003, "rotation_error": math.radians(2), "tension_error": 4,
      "swivel_error": math.radians(5), "frequency_error": 6, "rest_length_error": 0.007, "robust": True}),
    ("identify maslow-4 --lengths belts.csv --length-error 3 --gauge 'exit 3 x' --unknown exits", "identify",
     {2: ["exits"], "length_error": 0.003, "gauge": ["exit 3 x"]}),
    (f"design parallel {SEARCH} {POINTS} --objective mean_tilt --stiffness 0.5 --stiffness 2 --store there.npz",
     "find_layout", {"moves": MOVES, "symmetry": "none", "objective": "mean_tilt", "seed": 5, "generations": 7,
                     "material": SOFT, "points": THREE, "stiffness": [0.5, 2.0], "file": "there.npz"}),
    ("design parallel --within 0.02 --along 0 0 1 --grid 2 3 4 --tension-limits 1 9 --taut --stable --clearance 0.01 "
     "--limit points_moved=0.02", "find_layout",
     {"moves": [("exits", 0.02, (0.0, 0.0, 1.0))], "shape": (2, 3, 4, 3), "within":
      {"tensions": (1.0, 9.0), "all taut": True, "stable": True, "clearance": 0.01, "points_moved": 0.02}}),
    ("design parallel -o old/a.toml --picture old/a.png --video old/a.gif --force", "find_layout", {}),
    (f"front parallel -o old --force {SEARCH} {POINTS} --objectives points_moved mean_tilt --max-files 150",
     "find_front", {"moves": MOVES, "symmetry": "none", "seed": 5, "generations": 7, "material": SOFT,
                    "points": THREE, 2: ("points_moved", "mean_tilt"), "population": 150}),
    ("front parallel -o there --within 0.02 --along 0 0 1 --grid 2 3 4", "find_front",
     {"moves": [("exits", 0.02, (0.0, 0.0, 1.0))], "shape": (2, 3, 4, 3)}),
    (f"clearances parallel {POINTS} --fitting 0.02 --material {SOFT}", "clearances",
     {"points": THREE, "fitting": 0.02, "material": SOFT}),
    ("clearances parallel --grid 2 3 4", "clearances", {"shape": (2, 3, 4, 3)}),
    ("import line.csv --format wirex --cables short", "import_robot", {1: "wirex", 2: "short"}),
    (f"sweep parallel --grid 2 3 4 --material {SOFT} -o there.zarr --tension-limits 1 2 --wrench 1,2,3,4,5,6 "
     "--wrenches 6,5,4,3,2,1", "sweep",
     {1: (2, 3, 4), 2: [SOFT], "file": "there.zarr", "tension_limits": (1.0, 2.0),
      "external_wrench": [1.0, 2.0, 3.0, 4.0, 5.0, 6.0], "wrenches": [[6.0, 5.0, 4.0, 3.0, 2.0, 1.0]]}),
    (f"map parallel --plane yz --at 0.3 --points 21 {CHANGED} --tension-limits 1 2 --orientation 0.1 0 -0.2 "
     "--wrench 1,2,3,4,5,6 --wrenches 6,5,4,3,2,1 -o old/a.png --force", "sweep",
     {"planes": ([0.3], 18, 21), 2: [SOFT], "mass": 0.7, "tension_limits": (1.0, 2.0), "orientation": (0.1, 0.0, -0.2),
      "external_wrench": [1.0, 2.0, 3.0, 4.0, 5.0, 6.0], "wrenches": [[6.0, 5.0, 4.0, 3.0, 2.0, 1.0]]}),
    (f"check parallel --grid 2,3,4 {CHANGED} --certify --orientation 0.1 0 -0.2 --wrench 1,2,3,4,5,6 -o old/a.png "
     "--force", "check", {1: (2, 3, 4), 2: [SOFT], "mass": 0.7, "certify": True, "orientation": (0.1, 0.0, -0.2),
                          "external_wrench": [1.0, 2.0, 3.0, 4.0, 5.0, 6.0]}),
    ("check parallel --waypoint 0.3 0.2 0.1 --waypoint 0.4 0.2 0.1 --path-points 3", "check", {"path": THREE}),
    ("settle parallel --waypoint 0.3 0.2 0.1 --waypoint 0.4 0.2 0.1 --path-points 3 --mass 0.7",
     "crosscheck.check.both", {"positions": THREE, "mass": 0.7}),
    ("video parallel --path 0.3 0.4 --y 0.2 --z 0.1 --drive-seconds 3 --seconds 2 --fps 10 -o old/a.gif --force",
     "drive", {"line": [(0.3, 0.2, 0.1), (0.4, 0.2, 0.1)], "seconds": 3.0, "states": 20}),
    (f"video parallel --drop {CHANGED} {WRENCH}", "drive",
     {"from_rest": False, "shape": (1, 3), "material": SOFT, "mass": 0.7, "external_wrench": LOAD}),
    ("video parallel --waypoint 0.3 0.2 0.1 --waypoint 0.4,0.2,0.1,0,0,0.1 --waypoint=0.3,0.3,0.1", "drive",
     {"line": [(0.3, 0.2, 0.1), (0.4, 0.2, 0.1, 0.0, 0.0, 0.1), (0.3, 0.3, 0.1)]}),
    (f"report parallel --pose 0.3 0.2 0.1 --material {SOFT} --grid 2 3 4 --video -o there.html --force", "write_report",
     {2: (0.3, 0.2, 0.1), "material": SOFT, "grid": (2, 3, 4), "video": True, "file": "there.html", "force": True}),
    ("report parallel --no-video", "write_report", {"video": False}),
]  # fmt: skip


class Asked(cdpr.CdprError):
    """Raised in place of the work."""


@pytest.mark.parametrize(("words", "function", "expected"), REACHED, ids=[words for words, *_ in REACHED])
def test_options_reach_what_they_are_for(words, function, expected, folder, monkeypatch):
    """In the units of the package; positions among the arguments count from 0."""
    asked: dict = {}
    Path("old").mkdir()
    Path("belts.csv").write_text("length_1 [mm],length_2 [mm],length_3 [mm],length_4 [mm]\n1500,1600,1700,1800\n")
    for name in ("a.png", "a.gif", "a.toml", "front.png", "robot-1.toml"):
        Path("old", name).write_text("old")

    def record(*args, **options):
        asked.update(dict(enumerate(args)) | options)
        raise Asked("asked")

    monkeypatch.setattr(f"cdpr_sim.{function}", record)
    told = run(*shlex.split(words))
    assert (told.exit_code, told.stderr.strip()) == (2, "cdpr-sim: asked")  # bars may end in an empty line
    found = {name: SEEN.get(name, lambda asked, name=name: asked[name])(asked) for name in expected}
    assert found == expected


FUNCTIONS = {
    "solve": cdpr.solve, "compensate": cdpr.compensate, "equilibria": cdpr.find_equilibria, "design": cdpr.find_layout,
    "front": cdpr.find_front, "check": cdpr.check, "video": cdpr.write_video,
}  # fmt: skip
"""What commands call, with defaults under the same names."""


def test_without_an_option_a_command_does_what_its_function_does():
    """Defaults are the same; no flag is set without its option, except the video of a report."""
    compared = []
    for name, function in FUNCTIONS.items():
        defaults = {one.name: one.default for one in inspect.signature(inspect.unwrap(function)).parameters.values()}
        for option in COMMANDS[name].params:
            if option.default is not None and defaults.get(option.name) is not None:
                compared.append((name, option.name, option.default, defaults[option.name]))
    assert [one for one in compared if one[2] != one[3]] == []
    assert len(compared) > 15
    flags = [(name, one.name) for name, made in COMMANDS.items() for one in made.params if one.default is True]
    assert flags == [("report", "video")]


FILMS = [  # words, robots that are settled state by state, and those that are driven
    ("video cogiro --seconds 2", [], [("cogiro", None, True)]),
    ("video fast-like --seconds 2", [("fast-like", 2.0)], []),
    ("video fast-like --seconds 2 --drive-seconds 3", [], [("fast-like", 3.0, True)]),
    ("video fast-like --seconds 2 --drop", [], [("fast-like", None, False)]),
    ("video fast-like --seconds 2 --compensate", [], [("fast-like", 2.0, True), ("fast-like, compensated", 2.0, True)]),
    ("video cogiro --path 0.3 0.4 --compensate --size 400 240 --exaggerate 5 --renderer raycast", [],
     [("cogiro", None, True), ("cogiro, compensated", None, True)]),
]  # fmt: skip


@pytest.mark.parametrize(("words", "settled", "driven"), FILMS)
def test_a_film_has_the_motions_and_settings_that_are_asked_for(words, settled, driven, folder, monkeypatch):
    """With mass it is settled, unless a drive or compensation is asked for; each part of the work has its bar."""
    stills, drives, lengths, bars, filmed = [], [], [], {}, {}

    def drive(robot, *_, seconds, from_rest, progress, rest_lengths=None, **options):
        drives.append((robot.name, seconds, from_rest))
        lengths.append(rest_lengths)
        progress(0.25)
        return cdpr.solve_many(robot, [robot.home])

    def settled_along(robot, poses, seconds, load):
        stills.append((robot.name, seconds))
        return cdpr.solve_many(robot, [robot.home])

    def film(path, *args, progress, **options):
        filmed.update(options | {"path": path})
        progress(0.75)

    @contextmanager
    def recorded():
        yield lambda label: lambda done: bars.update({label: done})

    monkeypatch.setattr("cdpr_sim.cli.picture_commands.progress_bars", recorded)
    monkeypatch.setattr(cdpr, "drive", drive)
    monkeypatch.setattr(cdpr, "compensate", lambda robot, at, **load: (robot, at))
    monkeypatch.setattr(
        "cdpr_sim.crosscheck.compensation_check.held",
        lambda asked: cdpr.solve(*asked, asked[0].rest_lengths(asked[1]) - 1e-3),
    )
    monkeypatch.setattr(robot_summary, "settled_along", settled_along)
    monkeypatch.setattr(robot_summary, "write_both_methods", film)
    told = run(*words.split(), "-o", "new.mp4")
    assert (told.exit_code, told.stdout) == (0, "new.mp4\n")
    assert (stills, drives) == (settled, driven)
    name = words.split()[1]
    compensating = {f"Compensating {name}": 1.0} if "--compensate" in words else {}
    assert bars == {f"MuJoCo drives {name}": 0.25 for name, *_ in driven} | compensating | {"Drawing": 0.75}
    if "--size" in words:
        assert (filmed["size"], filmed["exaggeration"], filmed["renderer"]) == ((400, 240), 5.0, "raycast")
        assert (filmed["path"], filmed["force"], lengths[0]) == (Path("new.mp4"), False, None)
        robot = cdpr.load_robot("cogiro")
        wanted = np.linspace((0.3, *robot.home[1:]), (0.4, *robot.home[1:]), len(lengths[1]))
        np.testing.assert_allclose(lengths[1], [robot.rest_lengths(at) - 1e-3 for at in wanted], rtol=1e-14)


def test_pictures_and_models_are_of_the_robot_at_the_pose_on_the_cables_that_are_asked(folder, monkeypatch):
    """`show`, `view`, `models`; and the interference-free workspace of `clearances`."""
    drawn: list = []
    with monkeypatch.context() as patch:
        patch.setattr(still, "draw", lambda robot, pose: drawn.append((robot, pose)) or still.Still())
        patch.setattr(viewer, "open_viewer", lambda problem: drawn.append((problem.robot, problem.pose)))
        for words in (
            "show cogiro --pose 0.3 0.2 0.1 --material fishing-0.4mm -o new.png",
            "view cogiro --pose 0.3 0.2 0.1 --material fishing-0.4mm",
        ):
            assert run(*words.split()).exit_code == 0
            robot, pose = drawn.pop()
            assert (robot.material, pose.translation.tolist()) == (SOFT, AT)
    words = "models two-cable --pose 0.3 0 0.1 --material fishing-0.4mm --winches -o ."
    assert run(*words.split()).exit_code == 0
    robot = cdpr.load_robot("two-cable").replace(material=SOFT)
    assert Path("two-cable/robot.xml").read_text() == cdpr.to_mjcf(robot, (0.3, 0, 0.1))
    assert Path("two-cable/winch.xml").read_text() == cdpr.to_mjcf(robot, (0.3, 0, 0.1), winches=True)
    monkeypatch.setattr(
        "cdpr_sim.report.layout_pictures.clearance_map", lambda *given: drawn.append(given) or still.Still()
    )
    words = "clearances cogiro --plane yz --at 0.4 --min-distance 0.002 --fitting 0.01 -o a.png --force --grid 1 1 1"
    told = run(*words.split())
    assert drawn[0][1:] == ("yz", 0.4, 0.002, 0.01)
    assert contains(told.stdout, "(distance above 2 mm) at 1 of 1 poses; 10 mm at both ends of each cable")


def words_of(node: ast.AST) -> list[str]:
    """The constant words of a list, a tuple, a call or a string, in order."""
    if isinstance(node, ast.Constant):
        return node.value.split() if isinstance(node.value, str) else []
    parts = node.elts if isinstance(node, ast.List | ast.Tuple) else node.args if isinstance(node, ast.Call) else []
    return [word for part in parts for word in words_of(part)]


def test_every_option_is_named_in_a_test():
    """With its command, in one list, call or string of words: an option that is new needs a test of its own."""
    named: dict[str, set[str]] = {command: set() for command in COMMANDS}
    for words, *_, told in (*REACHED, *ANSWERS):
        named[words.split()[0]] |= {*words.split(), *("--json" for _ in told)}
    for words in WRITERS:
        named[words.split()[0]] |= {*words.split(), "--force"}
    for file in Path(__file__).parent.glob("test_*.py"):
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            if isinstance(node, ast.List | ast.Tuple | ast.Call | ast.Constant):
                words = words_of(node)
                for command in named.keys() & words[:2]:
                    named[command] |= set(words)
    forgotten = [
        f"{command} {option.opts[-1]}"
        for command, made in COMMANDS.items()
        for option in made.params
        if option.opts[0].startswith("-") and not named[command] & set(option.opts)
    ]
    assert forgotten == []


def test_a_flag_that_is_not_given_is_off():
    """But those that have a name for off: --no-certify."""
    on = [
        f"{command} {option.opts[0]}"
        for command, made in COMMANDS.items()
        for option in made.params
        if getattr(option, "is_flag", False) and option.default and not option.secondary_opts
    ]
    assert on == []


# ----------------------------------------------------------------------------------------------- the world outside

COMMAND = [sys.executable, "-c", "from cdpr_sim.__main__ import main; main()"]
ENVIRONMENT = os.environ | {"PYTHONPATH": str(Path(cdpr.__file__).parents[1]), "COLUMNS": "80"}


def process(*words: str, **how):
    """The command in a process of its own, which ends with the test."""
    how = {"env": ENVIRONMENT, "stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "timeout": 600} | how
    return subprocess.run([*COMMAND, *words], **how, text=True)


def one_sentence(error: str, words: str) -> None:
    """On standard error, in a line, without a traceback."""
    assert words in error
    assert len(error.strip().splitlines()) == 1
    assert "Traceback" not in error


def ended(monkeypatch, stdout, *words: str) -> int:
    """The exit status of the command in this process; the test closes ``stdout``, as the end of a process does."""
    with monkeypatch.context() as patch:
        patch.setattr(sys, "stdout", stdout)
        patch.setattr(sys, "argv", ["cdpr-sim", *words])
        with pytest.raises(SystemExit) as end:
            main()
    return end.value.code


def test_an_output_that_is_full_or_that_nobody_reads_has_a_status_of_its_own(monkeypatch, capsys):
    """1 would mean that the methods disagree. A full one is one sentence, a closed pipe (``| head -1``) silence."""
    reading, writing = os.pipe()
    os.close(reading)
    with open("/dev/full", "w") as full, os.fdopen(writing, "w") as pipe:
        result = process("--help", stdout=full)
        assert (result.returncode, process("--help", stdout=pipe).stderr) == (terminal.OUTSIDE, "")
        assert ended(monkeypatch, pipe, "robots") == terminal.OUTSIDE
        assert capsys.readouterr().err == ""
        assert ended(monkeypatch, full, "solve", "cogiro", "--json") == terminal.OUTSIDE
    for error in (result.stderr, capsys.readouterr().err):
        one_sentence(error, "cdpr-sim: No space left on device")


@pytest.mark.parametrize("words", [["settle", "cogiro"], ["robots"]])
def test_letters_that_cannot_be_shown_are_question_marks(words, monkeypatch, tmp_path):
    """ASCII, as ``PYTHONIOENCODING=ascii`` has it: the same tables, in plain lines."""
    with open(tmp_path / "printed", "w+", encoding="ascii") as printed:
        assert ended(monkeypatch, printed, *words) == 0
        printed.seek(0)
        assert printed.read().count("\n") > 5


def test_no_memory_is_one_sentence_and_an_interrupt_130_wherever_it_comes(monkeypatch):
    """While working and while printing."""

    def raising(error):
        return lambda *_, **__: (_ for _ in ()).throw(error)

    for target, error, status in (
        (cdpr, MemoryError, terminal.OUTSIDE), (cdpr, KeyboardInterrupt, 130), (terminal.Output, KeyboardInterrupt, 130)
    ):  # fmt: skip
        with monkeypatch.context() as patch:
            patch.setattr(target, "solve" if target is cdpr else "print", raising(error))
            result = run("solve", "cogiro")
        assert result.exit_code == status
        if error is MemoryError:
            one_sentence(result.stderr, "out of memory")


@pytest.mark.skipif(os.name == "nt", reason="Windows has no process groups to send an interrupt to")
def test_an_interrupt_is_130_even_where_a_shell_runs_the_tests_in_the_background():
    """``&`` has children ignore SIGINT: the test restores it, and cleans up whatever happens."""
    # Not while it imports: there Python ignores some interrupts.
    ready = "import cdpr_sim.cli, cdpr_sim.report.analysis_tables; import cdpr_sim as cdpr;"
    ready += "cdpr.find_equilibria(cdpr.load_robot('cogiro'), (0.4, 0.25, 0.2), starts=1)"
    words = [f"{ready}; print('ready', flush=True); {COMMAND[2]}", "equilibria", "cogiro", "--starts", "40000"]
    running = subprocess.Popen(
        [sys.executable, "-c", *words], env=ENVIRONMENT, start_new_session=True, stdout=subprocess.PIPE,
        stderr=subprocess.PIPE, text=True, preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    )  # fmt: skip
    try:
        assert running.stdout is not None
        assert running.stdout.readline() == "ready\n"
        time.sleep(0.3)  # the first starts
        assert running.poll() is None
        os.killpg(running.pid, signal.SIGINT)
        _, error = running.communicate(timeout=60)
    finally:
        with suppress(ProcessLookupError):
            os.killpg(running.pid, signal.SIGKILL)
        running.communicate()
    assert running.returncode == 130
    assert "Traceback" not in error


IMPORTING = """
import os, signal, sys, time
signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell may have it ignored
class Interrupt:
    def find_spec(self, name, *_):
        if name == 'typer':
            {}
sys.meta_path.insert(0, Interrupt())
from cdpr_sim.__main__ import main
main()
"""
IN_C = """
            try: os.kill(os.getpid(), signal.SIGINT); time.sleep(9)
            except KeyboardInterrupt: raise ImportError('initialization failed') from None"""
"""As MuJoCo does: a module in C turns the interrupt of its own imports into an ImportError."""


@pytest.mark.parametrize("raised", ["raise KeyboardInterrupt", IN_C])
def test_an_interrupt_while_importing_is_130_as_well(raised):
    """No traceback in the first second: importing MuJoCo and SciPy takes that long."""
    words = [sys.executable, "-c", IMPORTING.format(raised)]
    result = subprocess.run(words, env=ENVIRONMENT, capture_output=True, text=True, timeout=60)
    assert (result.returncode, result.stderr) == (130, "")


@pytest.mark.parametrize(
    ("variable", "words", "sentence"),
    [
        ("MPLBACKEND", ["show", "parallel"], ""),
        ("MUJOCO_GL", ["settle", "parallel"], "MUJOCO_GL: found 'nonsense', which MuJoCo cannot use here, expected"),
    ],
)
def test_a_variable_of_a_library_with_nonsense_is_no_traceback(variable, words, sentence, tmp_path):
    """Pictures are files, for which no backend matters; MuJoCo cannot be imported, which is said in a sentence."""
    done = process(*words, env=ENVIRONMENT | {variable: "nonsense"}, cwd=tmp_path)
    if sentence:
        assert (done.returncode, done.stdout) == (2, "")
        one_sentence(done.stderr, sentence)
    else:
        assert (done.returncode, done.stderr) == (0, "")
        assert (tmp_path / "robot.png").exists()


NARROW = ["settle parallel", "sweep cogiro parallel --grid 2 1 1", "check cogiro --grid 2 1 1", "compensate cogiro",
          "sensitivity cogiro", "robots"]  # fmt: skip


@pytest.mark.parametrize("command", NARROW)
def test_a_narrow_terminal_gets_row_below_row_and_no_number_cut(command):
    """Every number of the wide one; without any width the usual one, where nothing was printed, with status 0."""
    wide, usual = run(*command.split(), columns=120).stdout, run(*command.split(), columns=80).stdout
    for columns in (20, 40) if command == "settle parallel" else (40,):
        narrow = run(*command.split(), columns=columns).stdout
        assert "…" not in narrow
        assert set(re.findall(r"\d+\.\d{3,4}\b", wide)) == set(re.findall(r"\d+\.\d{3,4}\b", narrow))
        assert max(map(len, narrow.splitlines())) <= columns
    if command == "settle parallel":
        assert run(*command.split(), columns=0).stdout == usual


@pytest.mark.parametrize("is_terminal", [True, False])
def test_progress_is_shown_on_a_terminal_alone(is_terminal, monkeypatch, capsys):
    """On standard error, with its label as it is and its fraction."""
    monkeypatch.setattr(Console, "is_terminal", is_terminal)
    with terminal.progress_bars() as bars:
        bars("Drawing [v2]")(0.5)
    output, errors = capsys.readouterr()
    assert output == ""
    assert ("Drawing [v2]" in errors, "50%" in errors) == (is_terminal, is_terminal)

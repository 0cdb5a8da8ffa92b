"""Every option of every command reaches what it is for, in the units of the package; and none has no test."""

import ast
import inspect
import math
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
import typer
from rich.console import Console
from typer.testing import CliRunner

import cdpr_sim as cdpr
from cdpr_sim.cli import app
from cdpr_sim.cli.terminal import progress_bars
from cdpr_sim.drawing import still
from cdpr_sim.physics import viewer

TESTS = Path(__file__).parent
COMMANDS = typer.main.get_command(app).commands  # type: ignore[attr-defined]

AT = [0.3, 0.2, 0.1]
SOFT = "fishing-0.4mm"
IPANEMA = cdpr.load_robot("ipanema-1")
TIGHT = IPANEMA.rest_lengths(IPANEMA.home, 500.0).tolist()
"""[m]"""


class Asked(cdpr.CdprError):
    """Raised in place of the work."""


def place(problem: cdpr.Problem) -> list[float]:
    return problem.pose.translation.tolist()


def cables(problem: cdpr.Problem) -> str | None:
    return problem.robot.material


def turned(problem: cdpr.Problem) -> list[float]:
    """The commanded orientation, as the paper's angles [rad]."""
    return pytest.approx(problem.pose.rotation.as_euler("xyz").tolist())


def cut(problem: cdpr.Problem) -> list[float]:
    return problem.rest_lengths.tolist()


def mass(problem: cdpr.Problem) -> float:
    return problem.robot.mass


def load(problem: cdpr.Problem) -> list[float]:
    return problem.external_wrench.tolist()


def masses(robots: list[cdpr.Robot]) -> list[float]:
    return [robot.mass for robot in robots]


def tight(robots: list[cdpr.Robot] | cdpr.Robot) -> set[float | None]:
    """Their pretensions [N]."""
    return {robot.pretension for robot in (robots if isinstance(robots, list) else [robots])}


def moves(found) -> list[tuple]:
    return [(one.what, one.within, one.along) for one in found]


REACHED = [
    # command and option, what is called, its arguments: by name or position, perhaps as a function sees them
    ("settle parallel --pose 0.3 0.2 0.1", "settle", {(0, place): AT}),
    ("settle parallel --material fishing-0.4mm", "settle", {(0, cables): SOFT}),
    ("settle parallel --pose 0.3 0.2 0.1 0.01 -0.02 0.03", "settle",
     {(0, place): AT, (0, turned): [0.01, -0.02, 0.03]}),
    ("settle parallel --mass 0.7 --wrench 0,0,-1,0,0.01,0", "settle",
     {(0, mass): 0.7, (0, load): [0, 0, -1, 0, 0.01, 0]}),
    ("solve parallel --mass 0.7 --wrench 0,0,-1,0,0.01,0", "solve",
     {(0, mass): 0.7, (0, load): [0, 0, -1, 0, 0.01, 0]}),
    ("certify parallel --mass 0.7", "settle", {(0, mass): 0.7}),
    ("certify parallel --material fishing-0.4mm", "settle", {(0, cables): SOFT}),
    ("certify ipanema-1 --pretension 500", "settle", {(0, cut): TIGHT}),
    ("equilibria two-cable --certify --time-limit 60", "certify_all", {"time_limit": 60.0}),
    ("solve parallel --pose 0.3 0.2 0.1", "solve", {(0, place): AT}),
    ("solve parallel --material fishing-0.4mm", "solve", {(0, cables): SOFT}),
    ("solve parallel --method fsolve --all", "solve", {"method": "fsolve"}),
    ("compensate parallel --pose 0.3 0.2 0.1", "compensate", {(0, place): AT}),
    ("compensate parallel --material fishing-0.4mm", "compensate", {(0, cables): SOFT}),
    ("compensate parallel --tension-limits=1,9", "compensate", {"tension_limits": (1.0, 9.0)}),
    ("compensate parallel --prefer stiffest", "compensate", {"prefer": "stiffest"}),
    ("compensate parallel --arm 0.5", "compensate", {"arm": 0.5}),
    ("sensitivity parallel --pose 0.3 0.2 0.1", "sensitivity", {(0, place): AT}),
    ("view ipanema-1 --pretension 500", "physics.viewer.open_viewer", {(0, cut): TIGHT}),
    ("show ipanema-1 --pretension 500 -o there.png", "drawing.still.draw", {(0, tight): {500.0}}),
    ("sensitivity ipanema-1 --pretension 500", "sensitivity", {(0, cut): TIGHT}),
    ("equilibria ipanema-1 --pretension 500", "find_equilibria", {(0, cut): TIGHT}),
    ("identify ipanema-1 m.csv --pretension 500", "identify", {(0, tight): {500.0}}),
    ("design ipanema-1 --pretension 500", "find_layout", {(0, tight): {500.0}}),
    ("front ipanema-1 -o there --pretension 500", "find_front", {(0, tight): {500.0}}),
    ("clearances ipanema-1 --pretension 500", "clearances", {(0, tight): {500.0}}),
    ("sweep ipanema-1 ipanema-2 --pretension 500", "sweep", {(0, tight): {500.0}}),
    ("map ipanema-1 --pretension 500", "sweep", {(0, tight): {500.0}}),
    ("check ipanema-1 --pretension 500", "check", {(0, tight): {500.0}}),
    ("video ipanema-1 --pretension 500", "drive", {(0, tight): {500.0}}),
    ("report ipanema-1 --pretension 500", "write_report", {(1, tight): {500.0}}),
    ("sensitivity parallel --material fishing-0.4mm", "sensitivity", {(0, cables): SOFT}),
    ("equilibria parallel --pose 0.3 0.2 0.1", "find_equilibria", {(0, place): AT}),
    ("equilibria parallel --material fishing-0.4mm", "find_equilibria", {(0, cables): SOFT}),
    ("equilibria parallel --saddles", "find_equilibria", {"saddles": True}),
    ("equilibria parallel --starts 7", "find_equilibria", {"starts": 7}),
    ("identify parallel m.csv --unknown mass", "identify", {2: ["mass"]}),
    ("identify parallel m.csv --material fishing-0.4mm", "identify", {(0, lambda robot: robot.material): SOFT}),
    ("identify parallel m.csv --position-error 3", "identify", {"position_error": 0.003}),
    ("identify parallel m.csv --rotation-error 2", "identify", {"rotation_error": math.radians(2)}),
    ("identify parallel m.csv --tension-error 2", "identify", {"tension_error": 2}),
    ("identify parallel m.csv --swivel-error 2", "identify", {"swivel_error": math.radians(2)}),
    ("identify parallel m.csv --frequency-error 2", "identify", {"frequency_error": 2}),
    ("identify parallel m.csv --rest-length-error 2", "identify", {"rest_length_error": 0.002}),
    ("identify parallel m.csv --robust", "identify", {"robust": True}),
    ("design parallel --move anchors=0.01 --move exits", "find_layout",
     {("move", moves): [("anchors", 0.01, None), ("exits", 0.05, None)]}),
    ("design parallel --within 0.02", "find_layout", {("move", moves): [("exits", 0.02, None)]}),
    ("design parallel --along 0 0 1", "find_layout", {("move", moves): [("exits", 0.05, (0.0, 0.0, 1.0))]}),
    ("design parallel --symmetry none", "find_layout", {"symmetry": "none"}),
    ("design parallel --objective mean_tilt", "find_layout", {"objective": "mean_tilt"}),
    ("design parallel --grid 2 3 4", "find_layout", {(1, np.shape): (2, 3, 4, 3)}),
    ("design parallel --line 0.2 0.3 0.1 0.4 0.3 0.1 --points 3", "find_layout",
     {(1, np.ndarray.tolist): [[0.2, 0.3, 0.1], [pytest.approx(0.3), 0.3, 0.1], [0.4, 0.3, 0.1]]}),
    ("design parallel --tension-limits 1 9", "find_layout", {("subject_to", dict.items): {("tensions", (1.0, 9.0))}}),
    ("design parallel --taut", "find_layout", {("subject_to", dict.items): {("all taut", True)}}),
    ("design parallel --stable", "find_layout", {("subject_to", dict.items): {("stable", True)}}),
    ("design parallel --clearance 0.01", "find_layout", {("subject_to", dict.items): {("clearance", 0.01)}}),
    ("design parallel --limit points_moved=0.02", "find_layout",
     {("subject_to", dict.items): {("points_moved", 0.02)}}),
    ("design parallel --stiffness 0.5 --stiffness 2", "find_layout", {"stiffness": [0.5, 2.0]}),
    ("design parallel --material fishing-0.4mm", "find_layout", {(0, lambda robot: robot.material): SOFT}),
    ("design parallel --seed 5", "find_layout", {"seed": 5}),
    ("design parallel --generations 7", "find_layout", {"generations": 7}),
    ("design parallel --store there.npz", "find_layout", {("store", str): "there.npz"}),
    ("design parallel -o full/robot-1.toml --picture full/old.png --video full/old.gif --force", "find_layout", {}),
    ("front parallel -o there --objectives points_moved mean_tilt", "find_front", {2: ("points_moved", "mean_tilt")}),
    ("front parallel -o there --move anchors=0.01", "find_front", {("move", moves): [("anchors", 0.01, None)]}),
    ("front parallel -o there --within 0.02", "find_front", {("move", moves): [("exits", 0.02, None)]}),
    ("front parallel -o there --along 0 0 1", "find_front", {("move", moves): [("exits", 0.05, (0.0, 0.0, 1.0))]}),
    ("front parallel -o there --symmetry none", "find_front", {"symmetry": "none"}),
    ("front parallel -o there --grid 2 3 4", "find_front", {(1, np.shape): (2, 3, 4, 3)}),
    ("front parallel -o there --line 0.2 0.3 0.1 0.4 0.3 0.1 --points 3", "find_front", {(1, np.shape): (3, 3)}),
    ("front parallel -o there --material fishing-0.4mm", "find_front", {(0, lambda robot: robot.material): SOFT}),
    ("front parallel -o there --seed 5", "find_front", {"seed": 5}),
    ("front parallel -o there --generations 7", "find_front", {"generations": 7}),
    ("front parallel -o there --max-files 150", "find_front", {"population": 150}),
    ("front parallel -o full --force", "find_front", {}),
    ("clearances parallel --grid 2 3 4", "clearances", {(1, np.shape): (2, 3, 4, 3)}),
    ("clearances parallel --line 0.2 0.3 0.1 0.4 0.3 0.1 --points 3", "clearances", {(1, np.shape): (3, 3)}),
    ("clearances parallel --fitting 0.02", "clearances", {"fitting": 0.02}),
    ("clearances parallel --material fishing-0.4mm", "clearances", {(0, lambda robot: robot.material): SOFT}),
    ("import m.csv --format wirex", "import_robot", {1: "wirex"}),
    ("import m.csv --cables short", "import_robot", {2: "short"}),
    ("sweep parallel --grid 2 3 4", "sweep", {1: (2, 3, 4)}),
    ("sweep parallel --material fishing-0.4mm", "sweep", {2: [SOFT]}),
    ("sweep parallel -o there.zarr", "sweep", {("store", str): "there.zarr"}),
    ("sweep parallel --tension-limits 1 2", "sweep", {"tension_limits": (1.0, 2.0)}),
    ("sweep parallel --wrenches 1,2,3,4,5,6", "sweep", {"wrenches": [[1.0, 2.0, 3.0, 4.0, 5.0, 6.0]]}),
    ("sweep parallel --wrench 1,2,3,4,5,6", "sweep", {"external_wrench": [1.0, 2.0, 3.0, 4.0, 5.0, 6.0]}),
    ("map parallel --material fishing-0.4mm", "sweep", {2: [SOFT]}),
    ("map parallel --plane yz --at 0.3 --points 21", "sweep",
     {(1, lambda grid: (grid["x"].tolist(), len(grid["y"]), len(grid["z"]))): ([0.3], 18, 21)}),
    ("map parallel --tension-limits 1 2", "sweep", {"tension_limits": (1.0, 2.0)}),
    ("map parallel --wrenches 1,2,3,4,5,6", "sweep", {"wrenches": [[1.0, 2.0, 3.0, 4.0, 5.0, 6.0]]}),
    ("map parallel --mass 0.7", "sweep", {(0, masses): [0.7]}),
    ("map parallel --orientation 0.1 0 -0.2 --wrench 1,2,3,4,5,6", "sweep",
     {"orientation": (0.1, 0.0, -0.2), "external_wrench": [1.0, 2.0, 3.0, 4.0, 5.0, 6.0]}),
    ("map parallel -o full/old.png --force", "sweep", {}),
    ("check parallel --grid 2,3,4", "check", {1: (2, 3, 4)}),
    ("check parallel --material fishing-0.4mm", "check", {2: [SOFT]}),
    ("check parallel --certify", "check", {"certify": True}),
    ("check parallel --waypoint 0.3 0.2 0.1 --waypoint 0.4 0.2 0.1 --waypoint 0.4 0.3 0.1 0 0 0.2 --path-points 3",
     "check",
     {("poses", lambda found: found.translation[[0, -1]].tolist()): [[0.3, 0.2, 0.1], [0.4, 0.3, 0.1]],
      ("poses", len): 3}),
    ("settle parallel --waypoint 0.3 0.2 0.1 --waypoint 0.4 0.2 0.1 --path-points 3 --mass 0.7",
     "crosscheck.check.both",
     {(0, lambda found: found.positions.tolist()): [[0.3, 0.2, 0.1], [pytest.approx(0.35), 0.2, 0.1], [0.4, 0.2, 0.1]],
      (0, lambda found: found.robot.mass): 0.7}),
    ("check parallel --mass 0.7", "check", {(0, masses): [0.7]}),
    ("check parallel --orientation 0.1 0 -0.2 --wrench 1,2,3,4,5,6", "check",
     {"orientation": (0.1, 0.0, -0.2), "external_wrench": [1.0, 2.0, 3.0, 4.0, 5.0, 6.0]}),
    ("check parallel -o full/old.png --force", "check", {}),
    ("video parallel --path 0.3 0.4", "drive", {(1, lambda line: [x for x, _, _ in line]): [0.3, 0.4]}),
    ("video parallel --y 0.2 --z 0.1", "drive", {(1, lambda line: [at[1:] for at in line]): [(0.2, 0.1)] * 2}),
    ("video parallel --drop", "drive", {"from_rest": False, (1, len): 1}),
    ("video parallel --material fishing-0.4mm", "drive", {(0, lambda robot: robot.material): SOFT}),
    ("video parallel --mass 0.7 --wrench 0,0,-1,0,0,0", "drive",
     {(0, lambda robot: robot.mass): 0.7, "external_wrench": [0, 0, -1, 0, 0, 0]}),
    ("video parallel --waypoint 0.3 0.2 0.1 --waypoint 0.4,0.2,0.1,0,0,0.1 --waypoint=0.3,0.3,0.1", "drive",
     {1: [(0.3, 0.2, 0.1), (0.4, 0.2, 0.1, 0.0, 0.0, 0.1), (0.3, 0.3, 0.1)]}),
    ("video parallel --drive-seconds 3", "drive", {"seconds": 3.0}),
    ("video parallel --seconds 2 --fps 10", "drive", {"states": 20}),
    ("video parallel -o full/old.gif --force", "drive", {}),
    ("report parallel --pose 0.3 0.2 0.1", "write_report", {2: (0.3, 0.2, 0.1)}),
    ("report parallel --material fishing-0.4mm", "write_report", {(1, lambda robot: robot.material): SOFT}),
    ("report parallel --grid 2 3 4", "write_report", {"grid": (2, 3, 4)}),
    ("report parallel --video", "write_report", {"video": True}),
    ("report parallel --no-video", "write_report", {"video": False}),
    ("report parallel -o there.html --force", "write_report", {(0, str): "there.html", "force": True}),
]  # fmt: skip


@pytest.fixture
def folder(monkeypatch, tmp_path) -> Path:
    """To work in: measurements, and a folder with results of before."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "m.csv").write_text(
        "commanded_x [mm],commanded_y [mm],commanded_z [mm],measured_z [mm]\n400,250,100,99\n"
    )
    (tmp_path / "full").mkdir()
    for name in ("old.png", "old.gif", "front.png", "robot-1.toml"):
        (tmp_path / "full" / name).write_text("old")
    return tmp_path


@pytest.mark.parametrize(("words", "function", "expected"), REACHED, ids=[words for words, *_ in REACHED])
def test_options_reach_what_they_are_for(words, function, expected, folder, monkeypatch):
    """In the units of the package; positions among the arguments count from 0."""
    asked: dict = {}

    def record(*args, **options):
        asked.update(dict(enumerate(args)) | options)
        raise Asked("asked")

    monkeypatch.setattr(f"cdpr_sim.{function}", record)
    told = CliRunner().invoke(app, words.split())
    assert (told.exit_code, told.stderr.strip()) == (2, "cdpr-sim: asked")  # bars may end in an empty line
    for name, value in expected.items():
        name, seen = name if isinstance(name, tuple) else (name, lambda found: found)
        found = seen(asked[name])
        assert (set(found) if isinstance(value, set) else found) == value


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


def test_settings_of_a_film_reach_the_film(folder, monkeypatch):
    """Size, exaggeration and renderer; compensated lengths beside rigid ones, by robots of that name."""
    driven, filmed = [], {}
    monkeypatch.setattr(cdpr, "drive", lambda robot, *args, **options: driven.append((robot, options)) or robot)
    monkeypatch.setattr(cdpr, "compensate", lambda robot, at, **load: (robot, at))
    monkeypatch.setattr(
        "cdpr_sim.crosscheck.compensation_check.held",
        lambda asked: cdpr.solve(*asked, asked[0].rest_lengths(asked[1]) - 1e-3),
    )
    monkeypatch.setattr(
        "cdpr_sim.studies.robot_summary.write_both_methods",
        lambda path, *args, **options: filmed.update(options | {"path": path}),
    )
    words = "video cogiro --path 0.3 0.4 --compensate --size 400 240 --exaggerate 5 --renderer raycast -o new.gif"
    told = CliRunner().invoke(app, words.split())
    assert (told.exit_code, told.stdout) == (0, "new.gif\n")
    assert (filmed["size"], filmed["exaggeration"], filmed["renderer"]) == ((400, 240), 5.0, "raycast")
    assert (filmed["path"], filmed["force"]) == (Path("new.gif"), False)
    assert [robot.name for robot, _ in driven] == ["cogiro", "cogiro, compensated"]
    lengths = [options["rest_lengths"] for _, options in driven]
    assert lengths[0] is None
    robot = cdpr.load_robot("cogiro")
    wanted = np.linspace((0.3, *robot.home[1:]), (0.4, *robot.home[1:]), len(lengths[1]))
    np.testing.assert_allclose(lengths[1], [robot.rest_lengths(at) - 1e-3 for at in wanted], rtol=1e-14)


@pytest.mark.parametrize(
    ("words", "settled", "driven"),
    [
        ("cogiro --seconds 2", [], [("cogiro", None, True)]),
        ("fast-like --seconds 2", [("fast-like", 2.0)], []),
        ("fast-like --seconds 2 --drive-seconds 3", [], [("fast-like", 3.0, True)]),
        ("fast-like --seconds 2 --drop", [], [("fast-like", None, False)]),
        ("fast-like --seconds 2 --compensate", [], [("fast-like", 2.0, True), ("fast-like, compensated", 2.0, True)]),
    ],
)
def test_a_film_of_cables_with_mass_is_settled_state_by_state(words, settled, driven, folder, monkeypatch):
    """Unless a drive or compensation is asked for; each part of the work has a progress bar, which it moves."""
    stills, drives, bars = [], [], {}

    def drive(robot, *_, seconds, from_rest, progress, **options):
        drives.append((robot.name, seconds, from_rest))
        progress(0.25)
        return cdpr.solve_many(robot, [robot.home])

    def settled_along(robot, poses, seconds, load):
        stills.append((robot.name, seconds))
        return cdpr.solve_many(robot, [robot.home])

    @contextmanager
    def recorded():
        yield lambda label: lambda done: bars.update({label: done})

    monkeypatch.setattr("cdpr_sim.cli.picture_commands.progress_bars", recorded)
    monkeypatch.setattr(cdpr, "drive", drive)
    monkeypatch.setattr(cdpr, "compensate", lambda robot, at, **load: (robot, at))
    monkeypatch.setattr("cdpr_sim.crosscheck.compensation_check.held", lambda asked: cdpr.solve(*asked))
    monkeypatch.setattr("cdpr_sim.studies.robot_summary.settled_along", settled_along)
    monkeypatch.setattr(
        "cdpr_sim.studies.robot_summary.write_both_methods", lambda *args, progress, **options: progress(0.75)
    )
    told = CliRunner().invoke(app, ["video", *words.split(), "-o", "new.mp4"])
    assert told.exit_code == 0, told.output
    assert (stills, drives) == (settled, driven)
    compensating = {"Compensating fast-like": 1.0} if "--compensate" in words else {}
    assert bars == {f"MuJoCo drives {name}": 0.25 for name, *_ in driven} | compensating | {"Drawing": 0.75}


@pytest.mark.parametrize("is_terminal", [True, False])
def test_progress_is_shown_on_a_terminal_alone(is_terminal, monkeypatch, capsys):
    """On standard error, with its label as it is and its fraction."""
    monkeypatch.setattr(Console, "is_terminal", is_terminal)
    with progress_bars() as bars:
        bars("Drawing [v2]")(0.5)
    output, errors = capsys.readouterr()
    assert output == ""
    assert ("Drawing [v2]" in errors, "50%" in errors) == (is_terminal, is_terminal)


def test_a_picture_is_of_the_robot_at_the_pose_on_the_cables_that_are_asked(folder, monkeypatch):
    """`show`, `view`; `models` write the model there."""
    drawn: list = []
    with monkeypatch.context() as patch:
        patch.setattr(still, "draw", lambda robot, pose: drawn.append((robot, pose)) or still.Still())
        patch.setattr(viewer, "open_viewer", lambda problem: drawn.append((problem.robot, problem.pose)))
        for words in (
            "show cogiro --pose 0.3 0.2 0.1 --material fishing-0.4mm -o new.png",
            "view cogiro --pose 0.3 0.2 0.1 --material fishing-0.4mm",
        ):
            assert CliRunner().invoke(app, words.split()).exit_code == 0
            robot, pose = drawn.pop()
            assert (robot.material, pose.translation.tolist()) == (SOFT, AT)
    words = "models two-cable --pose 0.3 0 0.1 --material fishing-0.4mm --winches -o ."
    assert CliRunner().invoke(app, words.split()).exit_code == 0
    robot = cdpr.load_robot("two-cable").replace(material=SOFT)
    written = folder / "two-cable"
    assert (written / "robot.xml").read_text() == cdpr.to_mjcf(robot, (0.3, 0, 0.1))
    assert (written / "winch.xml").read_text() == cdpr.to_mjcf(robot, (0.3, 0, 0.1), winches=True)


def test_files_that_are_there_are_replaced_with_force_alone(folder):
    """By `new` and `show`."""
    for words, name in (("new mine --force", "mine.toml"), ("show two-cable -o mine.png --force", "mine.png")):
        (folder / name).write_text("mine")
        assert CliRunner().invoke(app, words.split()[:-1]).exit_code == 2
        assert (folder / name).read_text() == "mine"
        assert CliRunner().invoke(app, words.split()).exit_code == 0
        assert (folder / name).read_bytes() != b"mine"


def test_the_interference_free_workspace_is_drawn_where_it_is_asked_for(folder, monkeypatch):
    """Plane, place, least distance and fitting; the table counts by the same distance."""
    asked = []
    monkeypatch.setattr(
        "cdpr_sim.studies.better_layouts.clearance_map", lambda *args: asked.append(args) or still.Still()
    )
    words = (
        "clearances cogiro --plane yz --at 0.4 --min-distance 0.002 --fitting 0.01 -o full/old.png --force --grid 1 1 1"
    )
    told = CliRunner().invoke(app, words.split())
    assert asked[0][1:] == ("yz", 0.4, 0.002, 0.01)
    assert "(distance above 2 mm) at 1 of 1 poses; 10 mm at both ends of each cable" in " ".join(told.stdout.split())
    assert (folder / "full" / "old.png").read_bytes().startswith(b"\x89PNG")


def words_of(node: ast.AST) -> list[str]:
    """The constant words of a list, a tuple, a call or a string, in order."""
    if isinstance(node, ast.Constant):
        return node.value.split() if isinstance(node.value, str) else []
    parts = node.elts if isinstance(node, ast.List | ast.Tuple) else node.args if isinstance(node, ast.Call) else []
    return [word for part in parts for word in words_of(part)]


def test_every_option_is_named_in_a_test():
    """With its command, in one list, call or string of words: an option that is new needs a test of its own."""
    named: dict[str, set[str]] = {command: set() for command in COMMANDS}
    for file in TESTS.glob("test_*.py"):
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

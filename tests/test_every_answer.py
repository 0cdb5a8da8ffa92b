"""Every answer of the package for every mixture of cables.

How right the answers are is checked elsewhere; here, that none is refused but a proved list with mass, and of cables
with a memory those that know no path.
"""

# pyright: reportAttributeAccessIssue=false
# mujoco ships no type stubs for its compiled modules.
from __future__ import annotations

import functools
import itertools
import json
import re
import warnings
from collections.abc import Callable
from pathlib import Path

import mujoco
import numpy as np
import pytest
from typer.testing import CliRunner

import cdpr_sim as cdpr
from cdpr_sim import cli
from cdpr_sim.cli import app
from cdpr_sim.core import compiling
from cdpr_sim.robots.robot_file_text import as_toml
from cdpr_sim.studies import robot_summary

POSE = (0.3, 0.22, 0.15)

PROPERTIES = {
    "pulley": ("pulley_radius", [0.01] * 7 + [0.0]),
    "mass": ("linear_density", [5e-4] * 7 + [0.0]),
    "law": ("stiffening", [(100.0, 2e4)] * 7 + [(0.0, 0.0)]),
    "drive line": ("winch_to_exit", [0.5] * 7 + [0.0]),
}
"""What a cable may have; the last of a robot has none of it."""

MIXED = {
    "pulley_radius": [0.01, 0.0] * 4, "stiffening": [(100.0, 2e4), (100.0, 2e4), (0.0, 0.0), (0.0, 0.0)] * 2,
    "winch_to_exit": [0.5] * 4 + [0.0] * 4, "reeving": [1, 2, 1, 1, 2, 1, 3, 1],
}  # fmt: skip
"""Without mass, each mixture on one cable; with it, of three cables two."""


def robots() -> dict[str, cdpr.Robot]:
    """DemoBot with sets of properties; with each set on another cable; and that with mass.

    Sets of one, and of an even number: of any three properties they have every combination.
    """
    plain, found = cdpr.load_robot("cogiro").replace(material="fishing-0.4mm"), {}
    for count in (0, 1, 2, 4):
        for names in itertools.combinations(PROPERTIES, count):
            found[" + ".join(names) or "plain"] = plain.replace(**dict(PROPERTIES[name] for name in names))
    found["mixed"] = plain.replace(**MIXED)
    found["mixed with mass"] = plain.replace(**MIXED, linear_density=[5e-4, 5e-4, 0.0, 1e-3, 5e-4, 0.0, 1e-3, 0.0])
    return found


ROBOTS = robots()

FEW = ("mixed", "mixed with mass")
"""Robots of the answers that take long."""


@functools.cache
def solved(robot: cdpr.Robot) -> cdpr.Equilibrium:
    return cdpr.solve(robot, POSE)


class Holding:
    """Winches that hold the tensions of the equilibrium at the reference's start."""

    def __init__(self, robot: cdpr.Robot) -> None:
        self.robot, self.tensions = robot, solved(robot).tensions

    def start(self, reference: cdpr.Reference) -> np.ndarray:
        return self.robot.rest_lengths(reference.pose(0.0))

    def command(self, time: float, pose: object, measurement: cdpr.Measurement) -> cdpr.Command:
        by_tension = np.arange(self.robot.cables) < 2
        return cdpr.Command(self.robot.rest_lengths(POSE), self.tensions, by_tension)


def measured(robot: cdpr.Robot) -> cdpr.Measurements:
    poses = np.array([POSE, (0.4, 0.25, 0.12), (0.5, 0.2, 0.18)])
    return cdpr.Measurements.of(poses, cdpr.solve_many(robot, poses).positions, coordinates=("x", "y", "z"))


def modelled(robot: cdpr.Robot, **options) -> bool:
    model = mujoco.MjModel.from_xml_string(cdpr.to_mjcf(robot, POSE, **options))
    data = mujoco.MjData(model)
    mujoco.mj_step(model, data)
    return bool(np.isfinite(data.qpos).all())


def near(position: np.ndarray, robot: cdpr.Robot, within: float = 1e-6) -> bool:
    return bool(np.abs(position - solved(robot).position).max() < within)


def kept(robot: cdpr.Robot) -> bool:
    found = cdpr.compensate(robot, POSE)
    return bool(np.abs(robot.rest_lengths(POSE, found.tensions) - found.rest_lengths).max() < 1e-12)


QUICK: dict[str, Callable[[cdpr.Robot], object]] = {
    "solve": lambda robot: cdpr.solve(robot, POSE).stable,
    "solve(fsolve)": lambda robot: near(cdpr.solve(robot, POSE, method="fsolve").position, robot),
    "solve(least_squares)": lambda robot: near(cdpr.solve(robot, POSE, method="least_squares").position, robot),
    "solve_many": lambda robot: near(cdpr.solve_many(robot, np.array([POSE])).positions[0], robot),
    "settle, compare": lambda robot: cdpr.compare(solved(robot), cdpr.settle(robot, POSE)).agrees,
    "to_mjcf": modelled,
    "to_mjcf(winches)": lambda robot: modelled(robot, winches=True),
    "winch_controls": lambda robot: np.abs(cdpr.winch_controls(robot, POSE, robot.rest_lengths(POSE))).max() < 1e-9,
    "rest_lengths(tensions)": kept,
    "sensitivity": lambda robot: all(np.isfinite(by).all() for by in cdpr.sensitivity(robot, POSE).pose.values()),
    "natural_modes": lambda robot: (cdpr.natural_modes(solved(robot)).frequencies > 0).all(),
    "neutral_directions": lambda robot: len(cdpr.neutral_directions(solved(robot))) == 0,
    "compensate": lambda robot: cdpr.compensate(robot, POSE).exact,
    "follow_load": lambda robot: near(cdpr.follow_load(robot, POSE).equilibria[-1].position, robot),
    "feasible": lambda robot: cdpr.feasible(robot, POSE),
    "shortfall": lambda robot: cdpr.shortfall(robot, POSE) < 1e-6,
    "clearances": lambda robot: np.isfinite(cdpr.clearances(robot, [POSE]).least).all(),
    "cable_profiles": lambda robot: cdpr.cable_profiles(cdpr.solve_many(robot, [POSE])).shape == (1, 8, 25, 3),
    "sweep": lambda robot: near(cdpr.sweep(robot, {"x": [POSE[0]], "y": [POSE[1]], "z": [POSE[2]]}, chunk=None)[
        "position"
    ].values.ravel(), robot),
}  # fmt: skip
"""Each holds for every robot of ``ROBOTS``."""

SLOW: dict[str, Callable[[cdpr.Robot], object]] = {
    "settle_many": lambda robot: near(cdpr.settle_many(cdpr.Problems.of(robot, [POSE])).positions[0], robot),
    "find_equilibria": lambda robot: any(
        near(one.position, robot) for one in cdpr.find_equilibria(robot, POSE, starts=9)
    ),
    "grow_gravity": lambda robot: near(cdpr.grow_gravity(robot, POSE, seconds=1.0).position, robot),
    "release": lambda robot: cdpr.release(solved(robot), seconds=0.05).stays,
    "drive": lambda robot: len(cdpr.drive(robot, [POSE, POSE], seconds=0.1, states=2)) == 2,
    "track": lambda robot: len(cdpr.track(robot, [POSE], cdpr.RigidLengths(robot), seconds=0.05)) > 2,
    "track(tensions)": lambda robot: len(cdpr.track(robot, [POSE], Holding(robot), seconds=0.05)) > 2,
    "workspace_hull": lambda robot: cdpr.workspace_hull(robot, depth=0).volume > 0,
    "check": lambda robot: cdpr.check(robot, poses=[POSE], threads=1).agrees,
    "certify": lambda robot: cdpr.certify(solved(robot)).proved,
    "identify": lambda robot: cdpr.identify(robot, measured(robot), position_error=1e-4).robot.axial_stiffness[0] > 0,
    "find_layout": lambda robot: cdpr.find_layout(
        robot, [POSE], within=0.01, generations=1, population=5, polish=False, threads=1
    ).robot.cables == 8,
    "find_front": lambda robot: len(cdpr.find_front(
        robot, [POSE], within=0.01, generations=1, population=5, threads=1
    )) > 0,
    "draw": lambda robot: len(cdpr.draw(robot, POSE).axes) > 0,
}  # fmt: skip
"""Each holds for the robots of ``FEW``."""


def answered(ask: Callable[[cdpr.Robot], object], names: tuple[str, ...]) -> None:
    """Each robot has this answer."""
    wrong = []
    for name in names:
        try:
            if not ask(ROBOTS[name]):
                wrong.append(f"{name}: not as it should be")
        except cdpr.CdprError as error:
            wrong.append(f"{name}: {error!r}")
    assert not wrong, wrong


@pytest.mark.parametrize("answer", QUICK)
def test_every_set_of_properties_has_every_quick_answer(answer):
    """All sets, with one plain cable beside; and each mixture on another cable."""
    answered(QUICK[answer], tuple(ROBOTS))


@pytest.mark.parametrize("answer", SLOW)
def test_cables_of_every_kind_side_by_side_have_every_answer(answer):
    """Without mass and with it."""
    if answer == "certify":
        pytest.importorskip("flint")
    answered(SLOW[answer], FEW)


def test_all_equilibria_of_a_planar_robot_are_proved_or_refused():
    """Over pulleys, with nonlinear cables and drive lines they are; with mass the sentence says that they are not."""
    pytest.importorskip("flint")
    plain = cdpr.load_robot("two-cable")
    mixed = plain.replace(pulley_radius=[0.01, 0.0], pulley_axis=(0, 0, -1), winch_to_exit=[0.2, 0.0], reeving=[1, 2])
    found = cdpr.certify_all(mixed, mixed.rest_lengths((0.4, 0.0, 0.2)))
    assert len(found.equilibria) > 0
    with pytest.raises(cdpr.InvalidInput, match="expected massless") as refused:
        cdpr.certify_all(mixed.replace(linear_density=1e-4), mixed.rest_lengths((0.4, 0.0, 0.2)))
    assert "\n" not in str(refused.value)


def with_memory() -> dict[str, cdpr.Robot]:
    """DemoBot with the sets of an even number of properties, and a memory on all cables but the fourth."""
    found = {}
    for name in [name for name in ROBOTS if name not in {*PROPERTIES, "mixed"}]:
        both = "mass" in name and ("law" in name or "mixed" in name)
        hysteresis = [] if both else [(0.1, 5e-5), (0.1, np.inf, 0.3)]
        found[name] = ROBOTS[name].replace(
            hysteresis=[hysteresis, hysteresis, hysteresis, []] * 2,
            pulley_friction=[0.05, 0.05, 0.05, 0.0] * 2,
            creep=[[(4e4, 60.0)], [], [], []] * 2,
        )
    return found


REMEMBERED = with_memory()

POSES = np.linspace((0.25, 0.25, 0.1), (0.45, 0.25, 0.1), 2)[[0, 1, 0]]


@pytest.mark.parametrize("name", REMEMBERED)
def test_cables_with_a_memory_and_all_other_properties_have_paths_by_both_methods(name):
    """There and back, which is not the same equilibrium; with what else is asked of a path."""
    robot = REMEMBERED[name]
    paths = [method(robot, POSES, times=np.arange(3.0)) for method in (cdpr.solve_path, cdpr.settle_path)]
    assert np.abs(paths[0].positions - paths[1].positions).max() < 1e-9
    assert all(cdpr.compare(*both).agrees for both in zip(*paths, strict=True))
    assert np.abs(paths[0].positions[0] - paths[0].positions[2]).max() > 1e-8
    assert cdpr.compare(solved(robot), cdpr.settle(robot, POSE)).agrees
    assert cdpr.cable_profiles(paths[0]).shape == (3, 8, 25, 3)
    assert cdpr.feasible(robot, POSE) == cdpr.feasible(ROBOTS[name], POSE)
    with pytest.raises(cdpr.InvalidInput, match="their memory is not taken into account here") as refused:
        cdpr.sensitivity(robot, POSE)
    assert "\n" not in str(refused.value)


AT = f"--pose {POSE[0]} {POSE[1]} {POSE[2]}"

COMMANDS = {
    "settle": f"{AT} --json",
    "solve": f"{AT} --json",
    "compensate": f"{AT} --json",
    "sensitivity": f"{AT} --json",
    "equilibria": f"{AT} --starts 5 --json",
    "clearances": "--grid 1 1 1",
    "show": "-o OUT/robot.png",
    "models": "-o OUT/models",
    "sweep": "--grid 2 1 1 -o OUT/sweep.nc",
    "map": "--points 3 -o OUT/map.png",
    "check": "--grid 1 1 1",
    "design": "--line 0.3 0.2 0.15 0.4 0.2 0.15 --points 2 --generations 1 --within 0.01",
    "video": "--seconds 0.4 --fps 5 --size 320 240 -o OUT/video.gif",
    "report": "--no-video --grid 1 1 1 -o OUT/report.html",
}
"""What is asked on the command line, as quickly as it can be."""


@pytest.mark.parametrize("command", COMMANDS)
def test_commands_take_cables_of_every_kind_side_by_side(command, tmp_path, monkeypatch):
    """With mass, from a robot file, without an error."""
    monkeypatch.setattr(robot_summary, "POINTS", 5)  # of the maps in a report
    file = tmp_path / "robot.toml"
    file.write_text(as_toml(ROBOTS["mixed with mass"]))
    words = [word.replace("OUT", str(tmp_path)) for word in COMMANDS[command].split()]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", cdpr.ImplausibleRobot)
        told = CliRunner().invoke(app, [command, str(file), *words])
    assert told.exit_code in ((0, 1) if command in ("design", "clearances") else (0,)), told.output
    if "--json" in words:
        assert json.loads(told.stdout)
    written = [Path(word) for word in words if word.startswith(str(tmp_path))]
    assert all(path.exists() for path in written)


REMEMBERING = ROBOTS["plain"].replace(
    winch_to_exit=0.5, pulley_friction=0.02, hysteresis=[(0.1, np.inf, 0.2)], creep=[(4e5, 600.0)]
)
"""Ropes with friction, hysteresis and creep."""

KNOWS_MEMORY = (
    "solve", "solve_many", "settle, compare", "settle_many", "track", "track(tensions)", "clearances",
    "cable_profiles", "check", "draw", "feasible", "shortfall", "sweep", "workspace_hull",
)  # fmt: skip
"""Answers that take the memory into account, or that depend on equilibria from new ropes, or on tensions alone."""


@pytest.mark.parametrize("answer", [*QUICK, *SLOW])
def test_ropes_with_a_memory_have_an_answer_or_a_reason(answer):
    """What depends on the path is answered along it, or refused in one sentence: never answered as if elastic."""
    if answer == "certify":
        pytest.importorskip("flint")
    ask = (QUICK | SLOW)[answer]
    if answer in KNOWS_MEMORY:
        assert ask(REMEMBERING)
        return
    with pytest.raises(
        cdpr.InvalidInput, match=r"^robot: found pulley_friction and hysteresis and creep in "
    ) as refused:
        ask(REMEMBERING)
    assert "\n" not in str(refused.value)


REFUSED_COMMANDS = {
    **{name: COMMANDS[name] for name in ("compensate", "sensitivity", "equilibria", "design")},
    "models": "-o OUT/models",
    "view": "",
    "certify": "",
    "front": "--within 0.01 -o OUT/front",
    "identify": "OUT/measured.csv",
    "settle --certify": "",
    "settle --pretension": "5",
    "solve --method": "fsolve",
    "check --certify": "--grid 1 1 1",
    "equilibria --certify": "",
    "video --drop": "-o OUT/video.gif",
    "video --compensate": "-o OUT/video.gif",
    "video --drive-seconds": "1 -o OUT/video.gif",
}
"""Commands and options that need the elastic law."""

ALLOWED_COMMANDS = ("settle", "solve", "clearances", "show", "sweep", "map", "check", "video", "report")
WITHOUT_A_ROBOT = {"robots", "new", "schema", "import", "figures", "score", "settle-model", "diagnose"}


@pytest.mark.parametrize("command", [*REFUSED_COMMANDS, *ALLOWED_COMMANDS])
def test_commands_refuse_ropes_with_a_memory_before_they_compute_or_not_at_all(command, tmp_path, monkeypatch):
    """Nothing is compiled, settled or written before a refusal, which is one sentence with one beginning."""
    file = tmp_path / "robot.toml"
    file.write_text(as_toml(REMEMBERING))
    (tmp_path / "measured.csv").write_text("commanded_x [mm],commanded_y [mm],commanded_z [mm],measured_z [mm]\n")
    with (tmp_path / "measured.csv").open("a") as rows:
        rows.writelines(f"{400 + n},250,100,{99 + n}\n" for n in range(3))
    refused = command in REFUSED_COMMANDS
    monkeypatch.setattr(robot_summary, "POINTS", 5)
    if refused:
        monkeypatch.setattr(compiling.Compiled, "compiled", property(lambda kernel: pytest.fail("it computes")))
        monkeypatch.setattr(mujoco.MjModel, "from_xml_string", lambda *given: pytest.fail("it settles"))
    before = set(tmp_path.iterdir())
    name, *option = command.split()
    words = (REFUSED_COMMANDS if refused else COMMANDS)[command].replace("OUT", str(tmp_path)).split()
    told = CliRunner().invoke(app, [name, str(file), *option, *words])
    assert not isinstance(told.exception, BaseException) or isinstance(told.exception, SystemExit), told.exception
    if refused:
        assert (told.exit_code, told.stdout) == (2, "")
        assert told.stderr.startswith("cdpr-sim: robot: found pulley_friction and hysteresis and creep in cable 1, ")
        assert set(tmp_path.iterdir()) == before
    else:
        assert told.exit_code in (0, 1 if command == "clearances" else 0), told.output


def test_the_page_of_limits_names_what_refuses_ropes_with_a_memory():
    """All public functions and commands are in its lists, those that refuse in the list of those."""
    page = (Path(__file__).parents[1] / "docs" / "verification" / "limits.md").read_text().split("- Collisions")[0]
    accepted, _, refused = page.partition("these refuse the robot")
    listed = [set(re.findall(r"`(--[a-z-]+|[a-z_]+)`", part)) for part in (accepted, refused)]
    answers = {re.split(r"\W", name)[0] for name in [*QUICK, *SLOW]}
    knows = {re.split(r"\W", name)[0] for name in KNOWS_MEMORY}
    assert knows <= listed[0]
    assert answers - knows - {"rest_lengths"} <= listed[1]
    options = {f"--{word}" for word in ("certify", "pretension", "drop", "compensate", "drive-seconds")}
    assert options == {word for word in listed[1] if word.startswith("--")}
    assert set(ALLOWED_COMMANDS) <= listed[0]
    assert {name for name in REFUSED_COMMANDS if " " not in name} <= listed[1]
    assert {*ALLOWED_COMMANDS, *WITHOUT_A_ROBOT, *(name.split()[0] for name in REFUSED_COMMANDS)} == set(cli.COMMANDS)
    of_results = {"show", "write_video", "write_figures", "reset", "validate_layout", "verify_compensation"}
    of_files = {"import_robot", "list_figures", "list_robots", "load_robot", "open_sweep", "read_measurements"}
    of_models = {"settle_model", "holding_controls", "tendon_tensions", "diagnose_model"}
    functions = {name for name in cdpr.__all__ if name[0].islower()} - of_models
    assert functions - of_results - of_files <= listed[0] | listed[1]

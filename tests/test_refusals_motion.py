"""Bad input of motions, controllers, tasks, models with winches, measurements, and robots: one sentence each."""

import re
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import gymnasium
import mujoco
import numpy as np
import pytest
from inputs import run as run_command

import cdpr_sim as cdpr
from cdpr_sim.core import checks
from cdpr_sim.core.trajectory import BadCommand
from cdpr_sim.learning.controllers import run
from cdpr_sim.learning.domain import Domain

COGIRO, PARALLEL, PLANAR, TWO = map(cdpr.load_robot, ("cogiro", "parallel", "planar-vertical", "two-cable"))
LINE = [[0.3, 0.25, 0.1], [0.36, 0.25, 0.1]]
PLACE = [0.4, 0.25, 0.1]
SOUND: dict[str, Any] = dict(
    exits=[[-1, -1, 2], [1, -1, 2], [1, 1, 2], [-1, 1, 2]],
    anchors=[[-0.1, -0.1, 0.1], [0.1, -0.1, 0.1], [0.1, 0.1, 0.1], [-0.1, 0.1, 0.1]],
    axial_stiffness=1e4,
    mass=2.0,
)
FILE = 'name = "mine"\naxial_stiffness = 1e4\n[platform]\nmass = 2.0\nsize = [0.2, 0.2, 0.2]\n'
CABLES = "".join(
    f"[[cables]]\nexit = {[float(x) for x in exit]}\nanchor = {anchor}\n"
    for exit, anchor in zip(SOUND["exits"], SOUND["anchors"], strict=True)
)
"""A robot, and its file."""

POSES = """# DemoBot, fishing line
commanded_x [mm], commanded_y [mm], commanded_z [mm], measured_z [mm], measured_beta [deg], robot
170, 250, 100, 92.3, 26.4, parallel
400, 250, 100, 99.5,, parallel
"""
SENSORS = """commanded_x [m],commanded_y [m],commanded_z [m],rest_length_1 [m],rest_length_2 [m],\
rest_length_1_error [mm],tension_2 [kN],tension_2_error [N],swivel_1 [deg],frequency_1 [Hz],mass [g],\
force_z [N],torque_y [N mm]
0.4,0,0.2,0.5,0.6,1,0.03,2,90,2.5,400,-1,20
0.4,0,0.3,0.4,0.5,,,,,,,,
"""
"""Measured poses, and all that robots can measure."""


@dataclass
class Says:
    """A controller of two functions."""

    start: Callable[..., Any]
    command: Callable[..., Any]


def track(answer=lambda lengths: lengths, start=lambda lengths: lengths, robot=COGIRO, **given):
    """A motion by a controller that answers something to the rigid lengths."""
    says = Says(
        lambda reference: start(robot.rest_lengths(reference.pose(0.0))),
        lambda time, pose, measurement: answer(robot.rest_lengths(pose)),
    )
    return cdpr.track(**{"robot": robot, "waypoints": LINE, "controller": says, "seconds": 0.1} | given)


def drive(waypoints: Any = LINE, robot=COGIRO, **given):
    return cdpr.drive(robot, waypoints, **given)


def task(name: str = "Track-v0", **settings):
    return gymnasium.make(f"cdpr_sim/{name}", disable_env_checker=True, **settings)


def begun(**settings):
    environment = task(seconds=0.1, **settings)
    environment.reset(seed=0)
    return environment


def model_of(robot: cdpr.Robot = COGIRO, **options) -> tuple[mujoco.MjModel, mujoco.MjData]:
    model = mujoco.MjModel.from_xml_string(cdpr.to_mjcf(robot, robot.home, **options))
    return model, mujoco.MjData(model)


def reset(pose: Any, robot=PLANAR, winches: Any = True, **given):
    model, data = model_of(robot, winches=winches)
    cdpr.reset(model, data, pose, **given)


def read(folder: Path, *edit: str, file: str = POSES):
    """The measurements of a file with one change."""
    assert not edit or edit[0] in file
    (folder / "data.csv").write_text(file.replace(*edit, 1) if edit else file, encoding="utf-8")
    return cdpr.read_measurements(folder / "data.csv")


def load(folder: Path, text: str = FILE + CABLES):
    (folder / "mine.toml").write_text(text, encoding="utf-8")
    return cdpr.load_robot(folder / "mine.toml")


def made(**changes):
    return cdpr.Robot(**SOUND | changes)


def with_memory(**changes):
    """DemoBot with every kind of memory on all cables."""
    kinds = dict(pulley_friction=0.02, hysteresis=[(0.1, 1e-3), (0.1, np.inf, 0.2)], creep=[(4e4, 600.0)])
    return COGIRO.replace(**kinds | changes)


def path(poses: Any = None, **given):
    poses = np.linspace([0.2, 0.25, 0.1], [0.6, 0.25, 0.1], 5) if poses is None else poses
    return cdpr.solve_path(with_memory(), poses, **given)


def identify(unknowns: Any = "axial_stiffness", robot=COGIRO, rows: int = 1, **given):
    data = {name: given.pop(name) for name in ("robot_name", "rest_lengths") if name in given}
    data = {"robot": data.pop("robot_name", None)} | data
    return cdpr.identify(robot, cdpr.Measurements.of([PLACE] * rows, np.zeros((rows, 6)), **data), unknowns, **given)


def sense(robot=COGIRO, **measured):
    cdpr.identify(robot, cdpr.Measurements.of([[0.4, 0.25, 0.2]], **measured))


STEEL = COGIRO.replace(linear_density=5e-4)
NONLINEAR = COGIRO.replace(stiffening=(50, 100))
WHEELS = COGIRO.replace(pulley_radius=0.02)
FLEXIBLE = {"exit_compliance": 1e-5}
UNDER_A_WHEEL = [[0.07, 0.07, 0.1], [0.14, 0.07, 0.1]]
"""Anchor 2 of DemoBot passes below exit 2, which is at (0.04, 0.08) m; neither waypoint is within 0.02 m of there."""

OFF = np.ones(8)

BAD_COMMANDS = [
    (
        lambda _: track(lambda x: x * np.nan),
        "cogiro: controller: 0 s into the motion: rest_lengths: found nan, expected",
    ),
    (lambda _: track(lambda x: x[:3]), "rest_lengths: found an array of shape (3,), expected shape (8,)"),
    (lambda _: track(lambda x: x * 0), "rest_lengths: found 0 m, expected more than 0"),
    (lambda _: track(lambda x: x * 9), "rest_lengths: found … m in cable 1, expected … to … m"),
    (lambda _: track(lambda x: ["shorter"] * 8), "rest_lengths: found …, expected numbers"),
    (lambda _: track(lambda x: 1 / 0), "found ZeroDivisionError: division by zero"),
    (lambda _: track(lambda x: cdpr.Command(x, -OFF, OFF > 0)), "tensions: found -1 N, expected 0 or more"),
    (lambda _: track(lambda x: cdpr.Command(x, OFF, OFF)), "by_tension: found … True or False"),
    (lambda _: track(start=lambda x: x * np.nan), "cogiro: when the controller starts: rest_lengths: found nan"),
    (lambda _: track(start=lambda x: 1 / 0), "when the controller starts: found ZeroDivisionError: division by zero"),
    (lambda _: track(start=lambda x: cdpr.Sensors(seed=-1)), "when the controller starts: seed: found -1"),
]
"""Of controllers: a call that gets an empty folder, and words of its sentence, in which … is anything."""

NUMBERS = [
    (task, "rate seconds winch_speed damping cable_damping", (np.nan, -1)),
    (Domain, "axial_stiffness mass exits friction", (np.nan, -0.1, np.inf)),
    (lambda **given: model_of(winches=True, **given), "winch_force", (0.0, -3.0, [1.0, 2.0])),
    (made, "gravity pulley_radius linear_density mass axial_stiffness", (1e300,)),
    (made, "center_of_mass pulley_axis inertia platform_size", ([1, 1, 1e300], [1, 1, np.nan])),
    (made, "frame workspace", ([[0, 0, 0], [1, 1, 1e300]], [[0, 0, 0], [1, 1, np.nan]])),
    (made, "stiffening", ((1e300, 1e300), (np.nan, 0))),
    (made, "material description source", ("a\0b", "\x1b[31m", 3)),
]  # fmt: skip
"""Of one argument: a call, names of arguments, and values that ``test_wrong_types.py`` does not give."""


INVALID = [
    *((lambda _, call=call, one={name: value}: call(**one), f"{name}: found ")
        for call, names, values in NUMBERS for name in names.split() for value in values),
    # Motions.
    (lambda _: track(rate=1e9), "rate: found 1e+09 Hz"),
    (lambda _: track(cable_damping=1e300), "cable_damping: found 1e+300, expected 0 to 1"),
    (lambda _: track(seconds=1e9), "seconds: found 1e+09"),
    (lambda _: track(sensors=100), "sensors: found 100, expected Sensors"),
    (lambda _: track(controller=7), "controller: found 7, expected an object with a method 'start'"),
    (lambda _: track(controller=cdpr.RigidLengths), "found the class RigidLengths, expected … RigidLengths(robot)"),
    (lambda _: track(waypoints=[]), "waypoints: found none"),
    (lambda _: track(waypoints=[[0.4, 0.25, 0.9]]), "falls since cables cannot push"),
    (lambda _: track(robot=WHEELS, waypoints=UNDER_A_WHEEL), "anchor of cable 2 inside or below its pulley's wheel"),
    (lambda _: track(controller=cdpr.LengthsAndTensions(COGIRO, by_tension=[0])), "by_tension: found 0"),
    (lambda _: track(controller=cdpr.LengthsAndTensions(COGIRO, by_tension=range(1, 9))), "by_tension: found all 8"),
    (lambda _: drive([]), "waypoints: found none"),
    (lambda _: drive(states=1), "states: found 1, expected 2"),
    (lambda _: drive(states=10**9), "states: found 1000000000"),
    (lambda _: drive(seconds=1e9), "seconds: found 1e+09"),
    (lambda _: drive([[0.4, 0.25, np.inf]]), "pose: found …inf"),
    (lambda _: drive([LINE[0], [0.4, 0.25, 0.9]]), "falls since cables cannot push"),
    (lambda _: drive([[0.3, 0, 0.2], [0.4, 0, 0.2]], TWO, rest_lengths=[[1, 1]]), "found an array of shape (1, 2)"),
    (lambda _: drive([PLACE, [0.2, 0.15, 0.35]], COGIRO.replace(linear_density=5e-4, pulley_radius=0.018,
        pulley_axis=(0, 0, 1)), seconds=1.0), "rest_lengths: found … m in cable …, with mass and over a pulley"),
    # Tasks.
    (lambda _: task(control=(9,)), "control: found 9"),
    (lambda _: task(domain={"mass": 1.5}), "mass: found 1.5"),
    (lambda _: task(robot=STEEL), "found linear_density in cable 1"),
    (lambda _: task(robot=NONLINEAR), "found cable 1 with nonlinear elasticity"),
    (lambda _: task(seconds=0.1).unwrapped.step(np.zeros(8)), "step: found no episode, expected reset"),
    (lambda _: begun().unwrapped.step(np.full(8, np.nan)), "action: found a number that is not finite"),
    (lambda _: run(begun(), cdpr.HeldTensions(COGIRO), options={"waypoints": LINE}), "expected control=[1, 2, 3"),
    # Models with winches.
    (lambda _: model_of(winches="speed", winch_speed=0), "winch_speed: found 0 m/s"),
    (lambda _: model_of(COGIRO.replace(stiffening=[(0.0, 0.0)] * 7 + [(100.0, 2e4)]), winches=True, winch_force=40.0),
        "winch_force: found 40 N for cable 8 with nonlinear elasticity"),
    (lambda _: model_of(damping="some"), "expected 'settle', 'none' or a loss factor from 0 to 1"),
    (lambda _: model_of(damping=True), "damping: found True, expected"),
    (lambda _: model_of(NONLINEAR, damping=0.02), "damping: found a loss factor of 0.02 and cable 1 with nonlinear"),
    (lambda _: model_of(STEEL.replace(**FLEXIBLE), winches=True), "exit_compliance in cable 1 beside cables with mass"),
    (lambda _: model_of(NONLINEAR.replace(**FLEXIBLE), winches=True), "in cable 1 beside nonlinear cables"),
    (lambda _: model_of(STEEL.replace(**FLEXIBLE), damping="none"), "damping: found exit_compliance in cable 1"),
    (lambda _: model_of(NONLINEAR.replace(**FLEXIBLE), damping="none"), "damping: found exit_compliance in cable 1"),
    (lambda _: cdpr.winch_controls(COGIRO, COGIRO.home, 0 * OFF), "found 0 m for cable 1, expected 0.… to 1.… m"),
    (lambda _: cdpr.winch_controls(COGIRO, COGIRO.home, np.r_[OFF[1:] / 2, 9]), "found 9 m for cable 8, expected … m"),
    (lambda _: reset((0.3, 0.1, 0.2)), "pose: found y = 0.1 m, but the robot is planar"),
    (lambda _: reset((0.3, 0, 0.2, 0.1, 0, 0)), "pose: found a rotation about x or z"),
    (lambda _: reset((30, 0, 0.2)), "rest_lengths: found … m for cable 1, expected … m, which its winch can let out"),
    (lambda _: reset((0.3, 0, 0.2), rest_lengths=OFF[:4], pretension=3), "pretension: found one besides rest_lengths"),
    (lambda _: reset((0.9, 0, 0.2), pretension=0), "pretension: found no tensions near 0 N"),
    (lambda _: reset(COGIRO.home, STEEL, False), "massless cables, or those with mass in a model with winches"),
    (lambda _: reset(COGIRO.home, STEEL, pretension=100.0), "pretension: found cables with mass"),
    (lambda _: reset(COGIRO.home, COGIRO.replace(**FLEXIBLE), pretension=1.0), "found exits that give way"),
    (lambda _: cdpr.reset(bare := mujoco.MjModel.from_xml_string("<mujoco/>"), mujoco.MjData(bare), (0, 0, 0)),
        "model: found no body 'platform' with cables"),
    # Ropes with a memory.
    (lambda _: with_memory(hysteresis=3), "hysteresis: found 3, expected rows of 2 or 3 numbers"),
    (lambda _: with_memory(hysteresis=[(1,)]), "hysteresis: found a row of shape"),
    (lambda _: with_memory(hysteresis=[(0.1, -1)]), "hysteresis: found … in cable 1, expected numbers above 0"),
    (lambda _: with_memory(hysteresis=[(0.1, 0.1, 2)]), "w of at most 1"),
    (lambda _: with_memory(hysteresis=[(0.5, 1e-3)]), "expected less than 1: the tension could fall"),
    (lambda _: with_memory(hysteresis=[(0.49, 1e-3)], pulley_friction=0.05), "expected less than 1"),
    (lambda _: with_memory(hysteresis=[[(0.1, 1)], []]), "found rows of 2 cables, expected those of 8"),
    (lambda _: with_memory(creep=[(1e4, np.inf)]), "creep: found an infinite time"),
    (lambda _: with_memory(creep=[(1e4, 1, 1)]), "creep: found a row of shape"),
    (lambda _: with_memory(pulley_friction=-1), "pulley_friction: found -1 in cable 1, expected 0 to 1"),
    (lambda _: with_memory(linear_density=0.1, stiffening=(1, 0)), "mass and a nonlinear law, expected at most two"),
    (lambda _: with_memory(stiffening=(-2, 0)), "as the law's slope falls to 0.2 EA: the tension could fall"),
    (lambda _: path(PLACE), "found a single pose, expected a path"),
    (lambda _: path(times=[0, 1, 2, 1, 3]), "times: found 1 s at step 4, after 2 s"),
    (lambda _: path(memory=cdpr.solve_path(TWO, [TWO.home]).memory), "memory: found …'cogiro'"),
    # Measurements.
    (lambda at: read(at, "measured_z [mm]", "measured_z"), "'measured_z': found no unit, expected one of m, cm, mm"),
    (lambda at: read(at, "measured_z [mm]", "measured_z [deg]"), "found unit 'deg', expected one of m, cm"),
    (lambda at: read(at, "measured_z [mm]", "measured_beta [deg]"), "found column 'measured_beta' twice"),
    (lambda at: read(at, "commanded_x [mm]", "commanded_alpha [deg]"), "found no column 'commanded_x'"),
    (lambda at: read(at, "92.3", "nan"), "line 3, column 'measured_z': found 'nan', expected a finite number"),
    (lambda at: read(at, "92.3", "92,3"), "line 3: found 7 cells, expected 6"),
    (lambda at: read(at, "92.3", "high"), "line 3, column 'measured_z': found 'high'"),
    (lambda at: read(at, "170,", ","), "line 3, column 'commanded_x': found nothing"),
    (lambda at: read(at, ", parallel\n400", ", cogiro\n400"), "found measurements of cogiro, parallel, expected"),
    (lambda at: read(at, "tension_2_error", "tension_3_error", file=SENSORS),
        "found column 'tension_3_error', expected 'tension_3' as well"),
    (lambda at: read(at, ",0.03,2,", ",0.03,0,", file=SENSORS),
        "line 2, column 'tension_2_error': found 0, expected a positive number"),
    (lambda at: read(at, ",2.5,400", ",-2.5,400", file=SENSORS), "frequencies: found -2.5, expected positive numbers"),
    (lambda at: read(at, "mass [g]", "mass [m]", file=SENSORS), "column 'mass': found unit 'm', expected one of kg, g"),
    (lambda at: read(at, "0.03,2,90,2.5", ",,,", file=SENSORS), "found no measured number"),
    (lambda at: cdpr.read_measurements(at / "none.csv"), "no such file"),
    (lambda at: cdpr.read_measurements(at), "cannot be read: Is a directory"),
    (lambda at: read(at, file=POSES.splitlines()[1]), "found no rows"),
    (lambda at: read(at, file=POSES.replace(",", ";")), "found ';' between the columns, expected ','"),
    (lambda at: read(at, file=POSES.replace(",", "\t")), "found a tab between the columns, expected ','"),
    (lambda at: cdpr.read_measurements(at / str((at / "x").write_bytes(b"\xff\xfe\0\x80") and "x")),
        "found bytes that are not UTF-8, expected text"),
    (lambda _: cdpr.Measurements.of([[0, 0, 0]], [[0, 0]]), "measured: found an array of shape"),
    (lambda _: cdpr.Measurements.of([[0, 0]], [[0] * 6]), "commanded: found 2 columns"),
    (lambda _: cdpr.Measurements.of([[0, 0, 0]], [[np.nan] * 6]), "found no measured number"),
    (lambda _: sense(tensions=[[1.0] * 4]), "found 4 tensions, expected 8, one per cable"),
    (lambda _: sense(swivels=[[1.0] * 8]), "found the swivel angle of cable 1, which has no pulley"),
    (lambda _: sense(WHEELS.replace(**FLEXIBLE), swivels=[[0.0] * 8]), "swivels: found exit_compliance in cable 1"),
    (lambda _: sense(frequencies=[[1.0] * 7]), "found 7 natural frequencies, expected at most 6"),
    (lambda _: sense(frequencies=[[1.0]], wrenches=[[0, 0, 0, 0, 1.0, 0]]), "under an external torque"),
    # Identification.
    (lambda _: identify([]), "unknowns: found none"),
    (lambda _: identify(["mass", "mass"]), "expected each once"),
    (lambda _: identify(["axial_stiffness", "axial_stiffness_each"]), "expected one of the two"),
    (lambda _: identify(["angle_zeros", "yaw_zero"]), "found angle_zeros and yaw_zero, expected one of the two"),
    (lambda _: identify(["axial_stiffness_each", "rest_length_offsets"]), "found 6 measured numbers, expected 16"),
    (lambda _: identify("force_gains"), "unknowns: found force_gains without a measurement"),
    (lambda _: identify("pulley_radius"), "unknowns: found pulley_radius without a robot"),
    (lambda _: identify("swivel_zeros"), "unknowns: found swivel_zeros without a measurement"),
    (lambda _: identify(robot=PARALLEL, robot_name="cogiro"), "measurements of 'cogiro', expected those of 'parallel'"),
    (lambda _: identify(rows=2, rest_lengths=np.ones((2, 4))), "found 4 rest lengths, expected 8"),
    (lambda _: identify(robot=TWO, rows=2), "'two-cable' is planar"),
    # Robots that cannot be.
    *((lambda _, name=name: made(name=name), "name: found") for name in ("../../x", "a/b", "a\\b", "..", ".", "", "  ",
        "a\nb", "nul\0", "x" * 10_000, "\ud800", "tab\there", 7, None)),
    (lambda _: made(material="a\0b"), "material: found"),
    (lambda _: made(mass=1e-12), "mass: found 1e-12 kg, expected 1e-06 to 1e+12 kg"),
    (lambda _: made(mass=10**400), "mass: found a number of 401 digits, expected numbers"),
    (lambda _: made(exits=[[1e308, 0, 1]] * 4), "exits: found 1e+308 m in cable 1, expected -1e+06 to 1e+06 m"),
    (lambda _: made(anchors=[[0, 0, 0]] * 3 + [[0, 1e9, 0]]), "anchors: found 1e+09 m in cable 4"),
    (lambda _: made(anchors=[[0, 0, 1e-300]] * 4, platform_size=[1, 1, 1]), "anchors: found all within 1e-300 m"),
    (lambda _: made(axial_stiffness=1e-320), "found 9.99989e-321 N in cable 1, expected 1e-06 to 1e+15 N"),
    (lambda _: made(platform_size=[1, 1, 1e-200]), "platform_size: found 1e-200 m, expected at least 1e-09 m"),
    (lambda _: made(inertia=[1e-16] * 3), "inertia: found a moment of 1e-16 kg m², expected 1e-14 to 1e+24 kg m²"),
    (lambda _: made(exits=["no"] * 100_000), "exits: found ['no', 'no', 'no', 'no', 'no', 'no', ...], expected"),
    (lambda _: made(exits=np.zeros((100_000, 3))), "exits: found 100000 cables, expected at most 1000"),
]  # fmt: skip

UNKNOWN_NAMES = [
    (lambda _: task(control="speed"), "unknown control 'speed'"),
    (lambda _: task(rewards={"tilt": 1.0}), "unknown term of the reward 'tilt'"),
    (lambda _: task(robot="crane-with-heavy-cables"), "unknown robot 'crane-with-heavy-cables'"),
    (lambda _: task().unwrapped.reset(options={"pose": 1}), "unknown option 'pose'"),
    (lambda _: identify(["axial_stifness"]), "did you mean axial_stiffness"),
    (lambda _: cdpr.Measurements.of([[0, 0, 0]], [[0]], coordinates=["h"]), "unknown coordinate 'h'"),
    (lambda at: read(at, "measured_beta", "mesured_beta"),
        "unknown column 'mesured_beta [deg]': did you mean 'measured_beta'"),
    (lambda at: read(at, "force_z [N]", "force_w [N]", file=SENSORS),
        "unknown column 'force_w [N]': did you mean 'force_"),
]  # fmt: skip

NESTED, ROW = "[" * 900 + "]" * 900, "[[cables]]\nexit = [0.0, 0.0, 1.0]\nanchor = [0.0, 0.0, 0.0]\n"
FILES = [
    (lambda at: load(at, f"a = {NESTED}"), "found brackets nested too deeply"),
    (lambda at: load(at, "a = " + "9" * 5000), "found an integer of thousands of digits"),
    (lambda at: load(at, (FILE + CABLES).replace("mine", "a\\u0000b")), "name: found"),
    (lambda at: load(at, FILE.replace("2.0", "1e-12") + CABLES), "mass: found 1e-12 kg"),
    (lambda at: load(at, FILE.replace("2.0", "[" * 40 + "1" + "]" * 40) + CABLES), "platform.mass: found [[[[[["),
    (lambda at: load(at, FILE.replace("1e4", "1e-320") + CABLES), "axial_stiffness: found"),
    (lambda at: load(at, FILE + CABLES.replace("1.0", "1e308")), "exits: found"),
    (lambda at: load(at, FILE + CABLES.replace("anchor = [0.1, 0.1, 0.1]", "anchor = [0.1, 0.1]")),
        "cable 3: anchor.z: missing"),
    (lambda at: load(at, FILE + CABLES + "k" * 5000 + " = 1\n"), "cable 4: kkkk"),
    (lambda at: load(at, FILE.replace("mine", "../../x") + CABLES), "name: found '../../x', expected a name without /"),
    (lambda at: load(at, 'units = "inch"\n' + FILE + CABLES), "units: found 'inch', expected 'm' or 'mm'"),
    (lambda at: load(at, FILE + ROW * 100_000), "found more than 1 MB"),
    (lambda at: load(at, FILE + ROW * 2_000), "cables: found 2000, expected at most 1000"),
    (lambda at: load(at, f"cables = [{'{exit=[0,0,0],anchor=[0,0,0]},' * 2000}]\n" + FILE),
        "cables: found 2000, expected at most 1000"),
    (lambda at: cdpr.load_robot(device(at)), "found a device, expected a file"),
]  # fmt: skip


def device(folder: Path) -> Path:
    """A file that never ends, under a good name."""
    (folder / "endless.toml").symlink_to("/dev/zero")
    return folder / "endless.toml"


TABLE = [(BadCommand, BAD_COMMANDS), (cdpr.InvalidInput, INVALID), (cdpr.CdprError, UNKNOWN_NAMES)]
ROWS = [(error, *row) for error, rows in [*TABLE, (cdpr.RobotFileError, FILES)] for row in rows]


@pytest.mark.parametrize(("error", "call", "words"), ROWS, ids=[ascii(words[:50]) for *_, words in ROWS])
def test_bad_input_is_refused_in_one_sentence(error, call, words, tmp_path):
    """It names the field, what was found and what is expected; it is no longer than a line, and comes at once."""
    began = time.process_time()
    with pytest.raises(error, match=re.escape(words).replace("…", ".*")) as refused:
        call(tmp_path)
    said = str(refused.value).removeprefix(str(tmp_path))
    assert "\n" not in said
    assert len(said) < 400
    assert time.process_time() - began < 2.0


@pytest.mark.parametrize(
    "name", ["crane [v2]", "[bold]", "Kran Ä (größer)", "机器人", "cogiro, compensated", "x" * 100]
)
def test_a_name_in_any_language_is_taken(name):
    """Brackets are no markup, and letters are not English alone."""
    assert made(name=name).name == name


def test_a_model_that_cannot_be_reset_is_left_as_it_was():
    """Neither the model nor its state changes."""
    robot = PLANAR.replace(pulley_radius=0.01, pulley_axis=(0, 0, 1))
    model, data = model_of(robot, winches=True)
    mujoco.mj_step(model, data, 3)
    before = data.qpos.copy(), model.body_quat.copy(), model.key_qpos.copy()
    with pytest.raises(cdpr.InvalidInput, match="which its winch can let out"):
        cdpr.reset(model, data, (30, 0, 0.2))
    for now, then in zip((data.qpos, model.body_quat, model.key_qpos), before, strict=True):
        np.testing.assert_array_equal(now, then)


def test_a_window_without_a_display_is_refused_in_a_sentence(monkeypatch):
    """Before MuJoCo's viewer ends the process: of a task, and of a command, with the status of input that is wrong."""
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    with pytest.raises(cdpr.InvalidInput, match="display: found none"):
        task("Reach-v0", render_mode="human").reset(seed=0)
    result = run_command("view", "cogiro")
    assert result.exit_code == 2
    assert result.stderr.count("\n") == 1
    assert "display: found none" in result.stderr


@pytest.mark.parametrize(
    "value",
    [[*range(10**6)], np.zeros((999, 999)), "x" * 10**6, 10**5000, {i: i for i in range(10**5)}, [[[1] * 99] * 99]],
    ids=["list", "array", "text", "number", "table", "nested"],
)
def test_what_a_message_quotes_is_short(value):
    """Lists, arrays, texts, numbers, tables."""
    assert len(checks.shown(value)) < 250

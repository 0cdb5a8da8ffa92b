"""Refusals of files, commands and calls: one sentence that names what was found and what is expected."""

import json
import os
import re
import shlex
import shutil
import sys
import time
from pathlib import Path

import mujoco
import numpy as np
import pytest
from inputs import FILES, changed, robot_file, run
from test_matrix import MEMORY, ROWS
from test_model_commands import BOX

import cdpr_sim as cdpr
from cdpr_sim import cli
from cdpr_sim.core import compiling
from cdpr_sim.core.extras import LIBRARIES
from cdpr_sim.design.layout_equilibria import Cases, solve_layouts
from cdpr_sim.design.moves import Space
from cdpr_sim.robots.importers.draft import Draft
from cdpr_sim.robots.robot_file_text import as_toml


def sentence(error: BaseException) -> str:
    """Its message, in one line, without a word of pydantic's own."""
    message = str(error)
    assert message.isprintable()
    assert not re.search(r"Input should|valid \w+, unable|instance of", message)
    return message


# ------------------------------------------------------------------------------------------------------ robot files

MASS, EXIT = "mass = 1.5", "exit = [0, 0, 1]"

IN_OUR_FILE = [  # what is changed in a robot file, and the sentence
    ({"#robot": "EA = 1e4"}, "EA: unknown key, did you mean 'axial_stiffness'?"),
    ({"#platform": "com = [0, 0, 0]"}, "platform.com: unknown key, did you mean 'center_of_mass'?"),
    ({"#robot": "com = [0, 0, 0]"}, "com: unknown key, did you mean 'center_of_mass' in [platform]?"),
    ({"#robot": "exits = [[0, 0, 1]]"}, "exits: unknown key, did you mean 'exit' in [[cables]]?"),
    ({"#cable": "pulley_radius = 0.1"}, "pulley_radius: unknown key, did you mean 'radius' in [pulley]?"),
    ({"#robot": "platform_size = [1, 1, 1]"}, "platform_size: unknown key, did you mean 'size' in [platform]?"),
    ({"#cable": "mobility = 'planar'"}, "did you mean 'mobility' for the whole robot?"),
    ({"#robot": "material = 'steel'"}, "did you mean steel-rope-2mm?"),
    ({"#robot": "material = 'Dyneema'"}, "did you mean dyneema-2mm?"),
    ({"#robot": "material = 'Dyneema'\ndiameter = 0.002"}, "unknown material 'Dyneema': did you mean dyneema?"),
    ({"#robot": "diameter = 0.002", "#cable": "material = 'DYNEEMA'"}, "'DYNEEMA': did you mean dyneema-2mm?"),
    ({"#cable": "material = 'fishing'"}, "unknown material 'fishing': did you mean fishing-0.4mm"),
    ({"#robot": "material = 'fishing-0.4mm'\ndiameter = 0.002"}, "the robot: found diameter, expected none"),
    ({"#robot": "material = 'rope'"}, "or give axial_stiffness [N], or modulus [Pa] and diameter"),
    ({"#robot": "material = 'nylon'"}, "the robot: found material 'nylon' without diameter, expected both"),
    ({"#robot": "modulus = 60e9"}, "the robot: found modulus without diameter, expected both"),
    ({"#robot": "axial_stiffness = 1e4\ndiameter = 0.002"}, "the robot: found diameter, expected none"),
    ({"#robot": "axial_stiffness = 1e4\nmodulus = 1e9"}, "the robot: found both axial_stiffness and modulus"),
    ({"#robot": "modulus = -1\ndiameter = 0.002"}, "modulus: found -1 Pa, expected more than 0"),
    ({"#robot": "axial_stiffness = 1e4\ndiameter = 0"}, "the robot: found diameter, expected none"),
    ({"#robot": "material = 'dyneema'\ndiameter = 0"}, "diameter: found 0 m, expected more than 0"),
    ({"#robot": "axial_stiffness = 1e4\nlinear_density = 'material'"}, "the mass of a cable given by its stiffness is"),
    ({"#robot": "axial_stiffness = 1e4\nlinear_density = 'heavy'"}, "found 'heavy', expected a number or 'material'"),
    ({"#robot": "material = 'dyneema-2mm'", "#cable": "breaking_load = 0"}, "breaking_load: found 0 N in cable 1"),
    ({"#robot": ""}, "cable 1: found neither material nor axial_stiffness nor modulus"),
    ({MASS: "mass = 'heavy'"}, "platform.mass: found 'heavy', expected "),
    ({MASS: "mass = '1.5'"}, "platform.mass: found '1.5', expected a number"),
    ({MASS: "mass = true"}, "platform.mass: found True, expected a number"),
    ({MASS: "mass = [1]"}, "platform.mass: found [1], expected "),
    ({MASS: "mas = 1.5"}, "platform.mas: unknown key, did you mean 'mass'"),
    ({MASS: "mass = nan"}, "platform.mass: found nan, expected "),
    ({MASS: "mass = inf"}, "platform.mass: found inf, expected "),
    ({MASS: "mass = -1.5"}, "mass: found -1.5 kg, expected more than 0"),
    ({EXIT: "exit = [0, 0]"}, "cable 1: exit.z: missing"),
    ({f"{EXIT}\n": ""}, "cable 1: exit: missing"),
    ({EXIT: f"{EXIT}\ncolour = 1"}, "cable 1: colour: unknown key"),
    ({"name =": "name"}, "is not TOML"),
    ({"[[cables]]\nexit = [0": "[cables]\nexit = [0", "[[cables]]\nexit = [1, 0, 1]\nanchor = [0.1, 0, 0.05]": ""},
     "expected one table [[cables]] for each"),
    *(({"#robot": f"axial_stiffness = 1.0\n{key} = {value}"}, f"{key}: found …, expected ") for key, value in {
        "reeving": "'two'", "units": 3, "stiffening": 1, "pulley": 1, "linear_density": "[]",
        "description": 1}.items()),
    ({"#robot": "axial_stiffness = 1\nhysteresis = [1]"}, "hysteresis.1: found 1, expected a list"),
    ({"#robot": "axial_stiffness = 1\nstiffening = [1, 2, 3]"}, "stiffening: found …, expected "),
    ({"#robot": "axial_stiffness = 1\nstiffening = [1, 'a']"}, "stiffening.2: found 'a', expected a number"),
    ({"#robot": "axial_stiffness = 1\npulley = { radius = 0.1, axis = 'z' }"}, "pulley.axis: found 'z', expected "),
]  # fmt: skip


def contains(message: str, words: str) -> bool:
    """In this order, with anything for each … between them."""
    return re.search(".*".join(map(re.escape, words.split("…"))), message) is not None


@pytest.mark.parametrize(("changes", "words"), IN_OUR_FILE)
def test_what_is_wrong_in_a_robot_file_is_one_sentence(changes, words, tmp_path):
    """The file, the key in it, what was found, and what is expected or was meant."""
    file = robot_file(tmp_path, changes)
    with pytest.raises(cdpr.RobotFileError) as refused:
        cdpr.load_robot(file)
    message = sentence(refused.value)
    assert contains(message, words)
    assert message.startswith(str(file))


CDPYR = json.loads((FILES / "crane_cdpyr.json").read_text())

IN_OTHER_FILES = [  # a file, what is changed in it, and the sentence
    ("crane_bodies.xml", {"</link_rigid>": "</link_rigid><link_rigid/>"}, "found 2 bodies, expected one platform"),
    ("crane_bodies.xml", {"SPATIAL_EULER_XYZ": "S_EULER_XYZ"}, "found 'S_EULER_XYZ', which holds the body"),
    ("crane_bodies.xml", {"<mass>5</mass>": ""}, "<physical>: missing <mass>"),
    ("crane_bodies.xml", {"<mass>5<": "<mass>5 kg<"}, "<mass>: found ['5', 'kg'], expected numbers"),
    ("crane_bodies.xml", {"<mass>5<": "<mass>nan<"}, "<mass>: found nan, expected finite numbers"),
    ("crane_bodies.xml", {"<mass>5<": "<mass>-5<"}, "mass: found -5 kg, expected more than 0"),
    ("crane_bodies.xml", {'ref="joint"': 'ref="here"'}, "<inertia> ref: found 'here'"),
    ("crane_bodies.xml", {'attachment_reference="com"': ""}, "cable 1: attachment_reference: found None"),
    ("crane_bodies.xml", {"</attachments>": "<a/></attachments>"}, "cable 1: found 3 attachments, expected two"),
    ("crane_bodies.xml", {"cable_linear_spring name": "a name", "</cable_linear_spring>": "</a>"}, "found <a>"),
    ("crane_bodies.xml", {"<link>1</link>": "<link>2</link>"}, "cable 1: found ends on links 0 and 2"),
    ("crane_bodies.xml", {'default_cable_set="on': 'default_cable_set="at'}, "unknown set of cables 'at_pulleys'"),
    ("crane.wcrfx", {"</robot>": "</robot><robot/>"}, "found 2 robots, expected one"),
    ("crane.wcrfx", {"3R3T": "1T"}, "motionpattern: found '1T'"),
    ("crane.wcrfx", {'x="-1"': ""}, "<base>: missing x"),
    ("crane.wcrfx", {'elasticity="2e9"': 'elasticity="-1"'}, "found an elasticity of -1"),
    ("crane.wcrfx", {"<models": "<modules", "</models": "</modules"}, "expected a robot's file"),
    ("crane_cdpyr.json", {'"platforms": [': '"platforms": [{}, '}, "platforms.0.anchors: missing"),
    ("crane_cdpyr.json", {'"translation": 3': '"translation": 1'}, "found 1 translations and 3 rotations"),
    ("crane_cdpyr.json", {'"frame_anchor": 3': '"frame_anchor": 4'}, "found frame_anchor 4 of 4, counted from 0"),
    ("crane_cdpyr.json", {'"frame_anchor": 3': '"frame_anchor": -1'}, "kinematic_chains.3.frame_anchor: found -1"),
    ("crane_cdpyr.json", {"0.005046265044": "true"}, "cables.0.diameter: found True, expected a number"),
    ("crane_cdpyr.json", {'"linear": [[5': '"linear": [[Infinity'}, "platforms.0.inertia.linear.0.0: found inf"),
    ("crane_bologna.json", {'"mass": 5': '"mass": "5 kg"'}, "platform.mass: found '5 kg'"),
    ("crane_bologna.json", {"[[0], [0], [1]]": "[[0], [0], [0]]"}, "gravity_axis: found (0.0, 0.0, 0.0)"),
    ("crane_bologna.json", {"[[-1.], [-0.8], [2.]]": "[[-1.], [-0.8]]"}, "actuator.0.pulley"),
    ("crane_bologna.json", {"{": '{"motion_pattern": "TWO",'}, "motion_pattern: found 'TWO'"),
    ("crane_gazebo.yaml", {"mass: 5": "mass: -5"}, "mass: found -5 kg, expected more than 0"),
    ("crane_gazebo.yaml", {"points:": "points: []\nmore:"}, "points: found []"),
    ("crane_gazebo.yaml", {"platform: [-0.1": "platform: [.inf"}, "points.0.platform.0: found inf"),
    ("crane_gazebo.yaml", {"mass: 5": "mass: 5: 6"}, "is not YAML: mapping values are not allowed here in line"),
    ("crane_mjcf.xml", {"<freejoint />": ""}, "found none with a free joint"),
    ("crane_mjcf.xml", {"<freejoint />": '<joint type="ball" />'}, "found 1 joints, expected a free one"),
    ("crane_mjcf.xml", {'<site site="b" />': '<site site="A" />'}, "found both ends on one body"),
    ("crane_mjcf.xml", {'<site site="b" />': '<site site="z" />'}, "does not compile: Error: site 'z' not found"),
    ("crane_mjcf.xml", {'class="last"><site': 'class="lost"><site'}, "unknown default class"),
    ("crane_mjcf.xml", {'mass="5"': ""}, "required attribute missing: 'mass'"),
    ("crane_mjcf.xml", {'mass="5"': 'mass="nan"'}, "found nan, expected finite numbers"),
    ("crane_mjcf.xml", {'stiffness="20000"': 'stiffness="20000 1"'}, "expected a linear spring"),
    ("crane_mjcf.xml", {'springlength="0 1.25"': 'springlength="0 0"'}, "found a rest length of 0 m"),
    ("crane_mjcf.xml", {"<worldbody>": '<option gravity="1 0 0" /><worldbody>'}, "expected one along -z"),
    ("crane_mjcf.xml", {"<worldbody>": '<include file="a.xml" /><worldbody>'}, "Error opening file 'a.xml'"),
    ("hangprinter.g", {"K6": "K1"}, "M669 K: found '1', expected 6"),
    ("hangprinter.g", {"N5": "N15"}, "M669 N: found 15, expected 1 to 9 anchors"),
    ("hangprinter.g", {"I0:0:2345": ""}, "M669: missing the anchor I"),
    ("hangprinter.g", {"W2.5": ""}, "M666: missing W, the mover's mass"),
    ("hangprinter.g", {"U2:2:2:2:4": "U2:2:2"}, "M666 U: found 3 numbers, expected 5"),
    ("hangprinter.g", {"U2:2:2:2:4": "U2:2:2:2:4.5"}, "expected whole numbers"),
]  # fmt: skip


@pytest.mark.parametrize(("name", "changes", "words"), IN_OTHER_FILES)
def test_what_is_wrong_in_another_projects_file_or_has_no_counterpart_is_one_sentence(name, changes, words, tmp_path):
    """Which file, where in it, what was found, what is expected."""
    path = changed(tmp_path, name, changes)
    with pytest.raises(cdpr.RobotFileError) as refused:
        cdpr.import_robot(path)
    message = sentence(refused.value)
    assert words in message
    assert message.startswith(str(path))


ALIASES = "\n".join(f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 9)}]" for i in range(1, 31))

CONTENTS = {
    "bomb.xml": (b'<!DOCTYPE a [<!ENTITY b "bb"><!ENTITY c "&b;&b;">]><models><robot>&c;</robot></models>', "entities"),
    "outside.wcrfx": (b'<!DOCTYPE a [<!ENTITY b SYSTEM "file:///etc/hostname">]><models>&b;</models>', "entities"),
    "unknown.xml": (b'<?xml version="1.0" encoding="klingon"?><models/>', "is not XML"),
    "merges.yaml": (b"a: &a {x: 1}\npoints: {<<: [*a, *a]}\n", "is not YAML"),
    "objects.yaml": (b"points: !!python/object/apply:os.getcwd []\n", "is not YAML: could not determine a constructor"),
    "date.yaml": (b"points: 2001-99-99\n", "is not YAML: 'month must be in 1..12"),
    "deep.json": (b"[" * 100_000, "nested too deeply"),
    "letters.json": ('{"actuator": "é"}'.encode("latin-1"), "not UTF-8"),
    "digits.json": (b'{"actuator": ' + b"9" * 5000 + b"}", "is not JSON"),
    "large.yaml": (b"#" * 1_000_001, "more than 1 MB"),
    "empty.yaml": (b"", "expected a robot's file"),
    "notes.txt": (b"", "found the suffix '.txt', expected one of .xml, .wcrfx, .json, .yaml, .yml"),
    "odd.xml": (b"<bodies_system><links><link_rigid/></links></bodies_system>", "missing <joint>"),
    "two.json": (json.dumps(CDPYR | {"platforms": 2 * CDPYR["platforms"]}).encode(), "found 2, expected one"),
    # aliases that stand for 9^30 numbers: what is wrong is said before they are counted
    "aliases.yaml": (f"a0: &a0 [1, 1, 1]\n{ALIASES}\npoints: *a30\nplatform: {{mass: *a30, inertia: *a30}}".encode(),
                     "points.0: found [[…expected keys with values"),
}  # fmt: skip


@pytest.mark.parametrize("name", CONTENTS)
def test_hostile_files_are_refused_in_one_sentence(name, tmp_path):
    """Nothing is expanded, fetched or constructed, and no parser's own exception gets out."""
    content, words = CONTENTS[name]
    (tmp_path / name).write_bytes(content)
    with pytest.raises(cdpr.RobotFileError) as refused:
        cdpr.import_robot(tmp_path / name)
    assert contains(sentence(refused.value), words)


# ------------------------------------------------------------------------------------------------------------ calls


def copied(folder: Path, name: str, to: str = "") -> Path:
    return Path(shutil.copy(FILES / name, folder / (to or name)))


def written(path: Path, text: str) -> Path:
    path.write_text(text)
    return path


def piped(path: Path) -> Path:
    os.mkfifo(path)
    return path


def half_a_store(path: Path) -> Path:
    np.savez(path, identity="x", done=1, members=np.zeros(1000), history=np.zeros(3))
    path.write_bytes(path.read_bytes()[:-300])
    return path


PAIR = "NAME_{}.xml, with NAME_{}.xml in the same folder"
EXITS, ANCHORS = (np.array([[x, 0.8 * y, 2.0] for x, y in [(-1, -1), (1, -1), (1, 1), (-1, 1)]]) * s for s in (1, 0.1))
LINE = [(0.2, 0.25, 0.1), (0.4, 0.25, 0.1)]


def with_store(store: Path):
    return cdpr.find_layout(cdpr.load_robot("parallel"), LINE, within=0.01, generations=1, population=5, store=store)


def crowded():
    """Each pose in each layout of a generation: the estimate is made where the layouts are solved."""
    robot = cdpr.load_robot("parallel")
    space = Space.of(robot, [cdpr.Move("exits", 0.05)])
    many = Cases.of(robot, np.broadcast_to([0.3, 0.25, 0.1], (1_000_000, 3)))
    return solve_layouts(space.layouts(np.zeros((20_000, len(space)))), many)


CALLS = [  # a call with a folder, the class of its error, and its sentence
    (lambda at: cdpr.load_robot(at / "nowhere.toml"), cdpr.RobotFileError, "nowhere.toml: no such file"),
    (lambda at: cdpr.load_robot(at / "nowhere.json"), cdpr.RobotFileError, "nowhere.json: no such file"),
    (lambda at: cdpr.load_robot("COGIRO"), cdpr.UnknownName, "did you mean cogiro"),
    (lambda at: cdpr.load_robot(written(at / "six.toml", "").stem), cdpr.UnknownName,
     "unknown robot 'six': did you mean six.toml? known: acrobot"),
    *((lambda at, name=name: cdpr.load_robot(name), cdpr.UnknownName, "unknown robot")
      for name in ("x" * 10_000, "a\0b", "\ud800")),  # no names of files
    (lambda at: cdpr.import_robot(copied(at, "crane_bodies.xml")), cdpr.RobotFileError, "_cables.xml: no such file"),
    (lambda at: cdpr.import_robot(copied(at, "crane_cables.xml")), cdpr.RobotFileError, "_bodies.xml: no such file"),
    (lambda at: cdpr.import_robot(copied(at, "crane_bodies.xml", "crane.xml")), cdpr.RobotFileError,
     f"found the name 'crane.xml', expected {PAIR.format('bodies', 'cables')}"),
    (lambda at: cdpr.import_robot(copied(at, "crane_cables.xml", "cables.xml")), cdpr.RobotFileError,
     f"found the name 'cables.xml', expected {PAIR.format('cables', 'bodies')}"),
    (lambda at: cdpr.import_robot(FILES / "crane.wcrfx", format="caspr"), cdpr.RobotFileError,
     "found no bodies_system at the top, expected CASPR's XML"),
    (lambda at: cdpr.import_robot(FILES / "crane_bodies.xml", cables="x"), cdpr.RobotFileError,
     "crane_cables.xml: unknown set of cables 'x'…known: from_points, on_"),
    (lambda at: cdpr.import_robot(FILES / "crane.wcrfx", cables="x"), cdpr.RobotFileError, "only CASPR's files"),
    (lambda at: cdpr.import_robot(FILES.parents[1] / "models/irma4u/robot.xml"), cdpr.RobotFileError,
     "expected a single rigid platform"),
    (lambda at: cdpr.import_robot(FILES.parents[1] / "models/fast-like/robot.xml"), cdpr.RobotFileError,
     "expected a single rigid platform"),
    (lambda at: Draft("table", EXITS + np.eye(4, 3) * 1e-6, ANCHORS, 2.0, plane="yz").robot(), cdpr.InvalidInput,
     "leave the plane by"),
    (lambda at: Draft("stiff", EXITS, ANCHORS, 5.0, turns=False).robot(), cdpr.InvalidInput, "translates and does not"),
    (lambda at: cdpr.draw(cdpr.load_robot("two-cable"), (0.3, 0.2, 0.2)), cdpr.InvalidInput, "planar"),
    *((lambda at, name=name: cdpr.open_sweep(at / name), cdpr.InvalidInput, "found no sweep")
      for name in ("nothing.zarr", "nothing.nc")),
    (lambda at: cdpr.open_sweep(written(at / "mine.nc", "mine")), cdpr.InvalidInput, "found no sweep"),
    (lambda at: with_store(piped(at / "pipe.npz")), cdpr.InvalidInput, "pipe.npz: found a folder, a pipe"),
    (lambda at: with_store(written(at / "text.npz", "no store")), cdpr.InvalidInput, "text.npz: found a file that is"),
    (lambda at: with_store(half_a_store(at / "half.npz")), cdpr.InvalidInput, "half.npz: found a file that is not"),
    (lambda at: crowded(), cdpr.InvalidInput, "poses: 1,000,000 of them in each of 20,000 layouts would take about"),
]  # fmt: skip


@pytest.mark.parametrize(("call", "kind", "words"), CALLS, ids=[words for *_, words in CALLS])
def test_a_call_that_cannot_be_answered_is_refused_in_one_sentence(call, kind, words, tmp_path, monkeypatch):
    """Names, files that are missing or of something else, planes, and what does not fit."""
    monkeypatch.chdir(tmp_path)
    with pytest.raises(kind) as refused:
        call(tmp_path)
    assert contains(sentence(refused.value), words)


# --------------------------------------------------------------------------------------------------------- commands

ROOT = FILES.parents[1]
REFUSED = {path.stem: path for path in (Path(__file__).parent / "snapshots" / "refused").glob("*.txt")}
"""Commands after ``$ ``, each with the line that it gets on standard error, … for anything; of each command, and of
ropes with a memory. ``--update-snapshots`` writes the lines of new commands."""


def transcript(name: str) -> list[tuple[str, str]]:
    """Its commands and their lines."""
    return re.findall(r"^\$ (.*)\n(.*)\n", REFUSED[name].read_text(encoding="utf-8"), re.MULTILINE)


def test_the_page_of_limits_names_what_refuses_ropes_with_a_memory():
    """All public functions and commands are in its lists, those that refuse in the list of those."""
    page = (ROOT / "docs" / "verification" / "limits.md").read_text().split("- Collisions")[0]
    accepts, refuses = (
        set(re.findall(r"`(--[a-z-]+|[a-z_]+)`", part)) for part in page.split("these refuse the robot", 1)
    )
    functions = {name for name in cdpr.__all__ if name[0].islower()}
    answering = {
        name
        for row in ROWS.values()
        if not {frozenset({one}) for one in MEMORY} <= row.refuses.keys()
        for name in row.of
    } & functions
    refusing = {name for row in ROWS.values() for name in row.of} & functions - answering
    of_results = {
        "show",
        "write_video",
        "reset",
        "validate_layout",
        "verify_compensation",
        "scene_mjcf",
    }
    of_files = {"import_robot", "list_robots", "load_robot", "write_robot", "open_sweep", "read_measurements"}
    assert answering - of_files <= accepts
    assert refusing - of_results - of_files <= refuses
    of_models = {"diagnose_model", "holding_controls", "settle_model", "tendon_tensions"}
    assert functions - of_results - of_files - of_models <= accepts | refuses
    words = [command.split() for command, _ in transcript("memory")]
    options = {option for _, _, *given in words for option in given if option.startswith("--")}
    assert options & refuses == {"--certify", "--pretension", "--drop", "--compensate", "--drive-seconds"}
    assert {name for name, *_ in words} - {"settle", "solve", "check", "video"} <= refuses
    without = {"robots", "new", "schema", "import", "score", "settle-model", "diagnose"}
    assert set(cli.COMMANDS) - without <= accepts | refuses


MISSING = [
    ("certify two-cable", "proof"), ("settle two-cable --certify", "proof"),
    ("equilibria two-cable --certify", "proof"),
    ("video two-cable -o v.mp4", "video"), ("report two-cable -o r.html", "video"),
    ("report two-cable --no-video -o r.html", "report"),
    ("design two-cable --within 0.01 --video v.mp4", "video"),
]  # fmt: skip
"""Commands that need an extra."""


@pytest.fixture
def folder(tmp_path, monkeypatch) -> Path:
    """To work in: a picture, pipes, a file that is too large, measurements, and robots."""
    monkeypatch.chdir(tmp_path)
    Path("mine.png").write_text("mine")
    for suffix in (".toml", ".json", ".csv"):
        os.mkfifo(f"pipe{suffix}")
    with open("endless.csv", "wb") as file:
        file.truncate(60_000_000)
    Path("box.xml").write_text(BOX)
    Path("wrong.xml").write_text("<mujoco><wordlbody/></mujoco>")
    parallel, soft = cdpr.load_robot("parallel"), cdpr.load_robot("cogiro").replace(material="fishing-0.4mm")
    memory = dict(winch_to_exit=0.5, pulley_friction=0.02, hysteresis=[(0.1, np.inf, 0.2)], creep=[(4e5, 600.0)])
    Path("stiff.toml").write_text(as_toml(parallel.replace(axial_stiffness=1e15)))
    Path("memory.toml").write_text(as_toml(soft.replace(**memory)))
    head = "commanded_x [mm],commanded_y [mm],commanded_z [mm],measured_z [mm]\n"
    Path("measured.csv").write_text(head + "".join(f"{400 + n},250,100,{99 + n}\n" for n in range(3)))
    return tmp_path


def contents() -> dict[str, int]:
    """Names and sizes of what is in the current folder."""
    return {one.name: one.stat().st_size for one in os.scandir()}


def refused(command: str, words: str = "") -> str:
    """One line on standard error, nothing on standard output, no traceback, nothing written or lost."""
    before = contents()
    result = run(*shlex.split(command))
    assert (result.exit_code, result.stdout) == (2, ""), result.output
    (line,) = result.stderr.strip().splitlines()
    assert line.startswith("cdpr-sim: ")
    assert contains(line, words), line
    assert contents() == before
    return line


@pytest.mark.parametrize("name", sorted(REFUSED))
def test_commands_that_cannot_be_are_refused_in_one_sentence_before_any_work(name, folder, monkeypatch, request):
    """Nothing is solved, settled or, of ropes with a memory, compiled; the sentences are as reviewed."""
    for function in ("solve_many", "settle_many", "drive", "find_equilibria") if name != "memory" else ():
        monkeypatch.setattr(cdpr, function, None)
    monkeypatch.setattr(mujoco.MjModel, "from_xml_string", lambda *given: pytest.fail("it settles"))
    if name == "memory":
        monkeypatch.setattr(compiling.Compiled, "compiled", property(lambda kernel: pytest.fail("it computes")))
    asked, began = transcript(name), time.process_time()
    found = [(command, refused(command)) for command, _ in asked]
    assert time.process_time() - began < 5.0 + len(asked)  # with imports; the work takes longer to begin
    told = [old if old[1] and contains(new[1], old[1]) else new for old, new in zip(asked, found, strict=True)]
    if request.config.getoption("update_snapshots"):
        REFUSED[name].write_text("".join(f"$ {command}\n{line}\n" for command, line in told), encoding="utf-8")
    else:
        assert told == asked
    assert asked


@pytest.mark.parametrize(("command", "extra"), MISSING)
def test_a_missing_extra_is_said_before_the_work(command, extra, folder, monkeypatch):
    """Not after the search, or where the video would be written: nothing is compiled and no model is made."""
    for name in LIBRARIES[extra]:
        monkeypatch.setitem(sys.modules, name, None)
    monkeypatch.setattr(compiling.Compiled, "compiled", property(lambda kernel: pytest.fail("it computes")))
    monkeypatch.setattr(mujoco.MjModel, "from_xml_string", lambda *given: pytest.fail("it settles"))
    refused(command, f'pip install "cdpr-sim[{extra}]"')


@pytest.mark.parametrize(
    ("command", "words"),
    [
        ("solve parallel --pose 0.285 0.25 0.1 --method least_squares", "stopped with"),
        (
            "design cogiro --line 0.17 0.25 0.1 0.63 0.25 0.1 --points 4 --generations 1 --tension-limits 100 200",
            "subject_to: found no feasible layout",
        ),
    ],
)
def test_what_turns_out_to_be_impossible_is_said_in_one_sentence(command, words, folder):
    """A solver that stalls, a design that nothing satisfies, a drive that cannot begin."""
    refused(command, words)


def test_loads_at_the_ends_of_the_range_that_is_not_refused_are_answered_by_both_methods():
    """Strains of 1e-8 and 1."""
    robot = cdpr.load_robot("parallel")
    for strain in (1e-8, 1.0):
        at = robot.replace(axial_stiffness=robot.weight / strain), (0.3, 0.25, 0.1)
        assert cdpr.compare(cdpr.solve(*at), cdpr.settle(*at)).agrees


WARNED = [
    ("solve soft.toml", "crane [v2] [bold] $x: found cables that stretch by 49% or more"),
    ("settle ipanema-2 --pose 5 5 1", "ipanema-2: found a commanded position beside or above"),
    ("solve parallel", ""),
]


@pytest.mark.parametrize(("command", "words"), WARNED)
def test_an_implausible_question_is_one_line_beside_the_answer(command, words, folder):
    """Not an error: the status and the table are as ever."""
    soft = cdpr.load_robot("parallel").replace(name="crane [v2] [bold] $x", axial_stiffness=1e4)
    Path("soft.toml").write_text(as_toml(soft).replace("10000.0", "1.0"))
    result = run(*command.split())
    warned = [line for line in result.stderr.splitlines() if "warning" in line]
    assert result.exit_code == 0 or "soft" in command
    assert len(warned) == bool(words)
    assert all(line.startswith(f"cdpr-sim: warning: {words}") for line in warned)


def test_a_pipe_that_is_written_to_is_read(tmp_path):
    """Others are refused, as above."""
    reading = os.open(piped(tmp_path / "pipe.csv"), os.O_RDONLY | os.O_NONBLOCK)  # until the reader has opened it
    with open(tmp_path / "pipe.csv", "w") as pipe:
        pipe.write("commanded_x [mm],commanded_y [mm],commanded_z [mm],measured_z [mm]\n400,250,100,99.5\n")
        pipe.flush()
        reader = os.open(tmp_path / "pipe.csv", os.O_RDONLY | os.O_NONBLOCK)
    os.close(reading)
    assert len(cdpr.read_measurements(tmp_path / "pipe.csv")) == 1
    os.close(reader)

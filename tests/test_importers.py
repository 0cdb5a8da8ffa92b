"""Robots of other projects: one crane of our own, written in each format, and all that can be wrong with such files."""

import importlib.util
import inspect
import itertools
import json
import re
import shutil
import time
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import cdpr_sim as cdpr
from cdpr_sim.cli import app
from cdpr_sim.core.robot import FIELDS
from cdpr_sim.robots.importers.draft import Draft
from cdpr_sim.robots.importing import FORMATS
from cdpr_sim.robots.robot_file_text import as_toml

FILES = Path(__file__).parent / "imported"
MODELS = Path(__file__).parents[1] / "models"
EXITS = np.array([[-1, -0.8, 2], [1, -0.8, 2], [1, 0.8, 2.1], [-1, 0.8, 2.1]])
ANCHORS = np.array([[-0.1, -0.08, 0.05], [0.1, -0.08, 0.05], [0.1, 0.08, -0.05], [-0.1, 0.08, -0.05]])
AXES = np.array([[0.0, 0, 1], [0, 0, -1], [1, 0, 0], [0, 1, 0]])
INERTIA = np.array([[0.03, 0.001, 0.002], [0.001, 0.04, 0.003], [0.002, 0.003, 0.05]])
STIFFNESS = 40e3  # N
ROUNDING = 1e-15  # of inertia and anchors that the file gives from another point
WRITTEN = 1e-9  # of a stiffness: a rope's diameter has ten digits in the file

CRANES = {
    "crane_bodies.xml": {"stretches", "wheels", "home"},
    "crane.wcrfx": {"stretches", "wheels"},
    "crane_cdpyr.json": {"stretches", "wheels", "home"},
    "crane_cdpyr.yaml": {"stretches", "wheels", "home"},
    "crane_bologna.json": {"wheels"},
    "crane_gazebo.yaml": {"home"},
    "crane_mjcf.xml": {"stretches", "home"},
    "crane_uacdpr.mat": {"wheels"},
}
"""Per file, what its format can say beyond geometry, mass and inertia."""


def changed(folder: Path, name: str, *changes: tuple[str, str]) -> Path:
    """A copy of one of the files, and of CASPR's cables beside it, with something else in them."""
    parts = {part: (FILES / part).read_text(encoding="utf-8") for part in {name, name.replace("_bodies", "_cables")}}
    for old, new in changes:
        assert any(old in text for text in parts.values()), old
        parts = {part: text.replace(old, new, 1) for part, text in parts.items()}
    for part, text in parts.items():
        (folder / part).write_text(text, encoding="utf-8")
    return folder / name


@pytest.mark.parametrize("name", CRANES)
def test_every_format_tells_of_the_same_crane(name):
    """Frames, references, orders and units differ from format to format; the robot does not."""
    robot = cdpr.import_robot(FILES / name)
    assert robot.exits == pytest.approx(EXITS, abs=0)
    assert robot.anchors == pytest.approx(ANCHORS, abs=ROUNDING)
    assert (robot.mass, robot.mobility) == (5, "spatial")
    center = (0, 0, 0) if name == "crane_gazebo.yaml" else (0.01, -0.02, 0.03)  # Gazebo's is the origin
    assert robot.center_of_mass.tolist() == pytest.approx(center, abs=0)
    assert robot.inertia == pytest.approx(INERTIA, abs=ROUNDING)
    assert robot.cabling.pulley_radius.tolist() == [0.03 * ("wheels" in CRANES[name])] * 4
    if "wheels" in CRANES[name]:
        assert robot.cabling.pulley_axis == pytest.approx(AXES, abs=0)
    if "stretches" in CRANES[name]:
        assert robot.axial_stiffness == pytest.approx(np.full(4, STIFFNESS), rel=WRITTEN)
    else:
        assert robot.axial_stiffness == pytest.approx(5 * 9.81 / 1e-3, rel=0.05)
        assert any("axial stiffness of 49000 N was assumed" in note for note in robot.notes)
    if "home" in CRANES[name]:
        assert robot.home == pytest.approx(np.array([0.1, 0.05, 1]), abs=0)


def test_limits_of_force_come_along():
    """Per cable in CASPR, for all in Gazebo."""
    assert cdpr.import_robot(FILES / "crane_bodies.xml").force_max.tolist() == [100, 110, 120, 130]
    gazebo = cdpr.import_robot(FILES / "crane_gazebo.yaml")
    assert (gazebo.force_min.tolist(), gazebo.force_max.tolist()) == ([1] * 4, [100] * 4)


def test_a_hangprinter_has_reeving_and_line_to_its_spools():
    """Millimetres become metres; the spring constant of the firmware times the length of line is EA."""
    robot = cdpr.import_robot(FILES / "hangprinter.g")
    assert robot.exits[[0, 4]].tolist() == [[0, -1.6, -0.11], [0, 0, 2.345]]
    assert not robot.anchors.any()
    assert robot.mass == 2.5
    assert robot.reeving.tolist() == [2, 2, 2, 2, 4]
    assert robot.winch_to_exit == pytest.approx(np.array([2.9, 3.1, 2.98, 2.89, 0]))
    assert (robot.axial_stiffness == 30e3).all()
    assert (robot.force_min.tolist(), robot.force_max.tolist()) == ([0, 0, 0, 0, 1], [100, 100, 100, 100, 120])


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("K6", "K1", "M669 K: found '1', expected 6"),
        ("N5", "N15", "M669 N: found 15, expected 1 to 9 anchors"),
        ("I0:0:2345", "", "M669: missing the anchor I"),
        ("W2.5", "", "M666: missing W, the mover's mass"),
        ("U2:2:2:2:4", "U2:2:2", "M666 U: found 3 numbers, expected 5"),
        ("U2:2:2:2:4", "U2:2:2:2:4.5", "expected whole numbers"),
    ],
)
def test_what_is_wrong_with_a_hangprinter_is_one_sentence(old, new, said, tmp_path):
    """Which command and letter."""
    with pytest.raises(cdpr.RobotFileError, match=re.escape(said)):
        cdpr.import_robot(changed(tmp_path, "hangprinter.g", (old, new)))


POINT_TO_POINT = ("cogiro", "parallel", "planar-vertical", "two-cable", "nist-robocrane", "ipanema-3", "cogiro-crane")
"""Of the catalogue: cables without mass, pulleys or a drive line, whose models have tendons from site to site."""


@pytest.mark.parametrize("name", POINT_TO_POINT)
def test_our_own_models_give_the_robot_back(name, catalogue):
    """As MJCF: all that statics depends on, EA to twelve digits; statics of both are the same."""
    robot, again = catalogue[name], cdpr.import_robot(MODELS / name / "robot.xml")
    for field in ("exits", "anchors", "mass", "center_of_mass", "inertia", "mobility", "gravity", "name"):
        np.testing.assert_array_equal(getattr(robot, field), getattr(again, field), err_msg=field)
    assert again.axial_stiffness == pytest.approx(robot.axial_stiffness, rel=1e-12)


@pytest.mark.parametrize(
    ("name", "said"),
    [("irma4u", "expected two sites and no pulley"), ("fast-like", "expected a single rigid platform")],
)
def test_models_with_pulleys_or_chains_are_refused(name, said):
    """A wheel or a chain of masses is no tendon from site to site."""
    with pytest.raises(cdpr.RobotFileError, match=said):
        cdpr.import_robot(MODELS / name / "robot.xml")


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("<freejoint />", "", "found none with a free joint"),
        ("<freejoint />", '<joint type="ball" />', "found 1 joints, expected a free one"),
        ('<site site="b" />', '<site site="A" />', "found both ends on one body"),
        ('<site site="b" />', '<site site="z" />', "found no site 'z'"),
        ('class="last"><site', 'class="lost"><site', "found the class 'lost'"),
        ('mass="5"', "", "<inertial>: missing mass"),
        ('springlength="0 1.25"', 'springlength="0 0"', "found a rest length of 0 m"),
        ('quat="0 0 0 1"', 'euler="0 0 180"', "found euler, expected a quaternion"),
        ("<worldbody>", '<option gravity="1 0 0" /><worldbody>', "expected one along -z"),
        ("<worldbody>", '<include file="a.xml" /><worldbody>', "expected a model in a single file"),
    ],
)
def test_what_is_wrong_with_mjcf_is_one_sentence(old, new, said, tmp_path):
    """And what has no counterpart."""
    with pytest.raises(cdpr.RobotFileError, match=re.escape(said)):
        cdpr.import_robot(changed(tmp_path, "crane_mjcf.xml", (old, new)))


def test_a_spring_that_pushes_is_noted(tmp_path):
    """MuJoCo's tendons with one springlength do; without any, it is the length of the model as it stands."""
    robot = cdpr.import_robot(changed(tmp_path, "crane_mjcf.xml", ('springlength="0 2"', "")))
    length = np.linalg.norm(EXITS[0] - ANCHORS[0] - [0.1, 0.05, 1])
    assert robot.axial_stiffness == pytest.approx([20e3 * length, STIFFNESS, STIFFNESS, STIFFNESS])
    assert any("pushes as well" in note for note in robot.notes)


def wirex_length(exit_, axis, radius, anchor):
    """Pott, Cable-driven Parallel Robots (2018), pulley kinematics, in a frame whose z axis is the swivel axis."""
    along = (anchor - exit_) @ axis
    across = np.linalg.norm(anchor - exit_ - along * axis)
    to_center = np.hypot(across - radius, along)
    free = np.sqrt(to_center**2 - radius**2)
    return radius * (np.arccos(free / to_center) + np.arccos(along / to_center)) + free


def caspr_length(exit_, axis, radius, anchor):
    """CASPR's: the wheel's centre, the point where the cable leaves it, and the arc between."""
    normal = np.cross(axis, anchor - exit_)
    inwards = np.cross(normal, axis)
    center = exit_ + radius * inwards / np.linalg.norm(inwards)
    ratio = radius / np.linalg.norm(anchor - center)
    to_anchor = anchor - center
    off = ratio**2 * to_anchor - ratio * np.sqrt(1 - ratio**2) * np.cross(normal / np.linalg.norm(normal), to_anchor)
    arc = radius * np.arccos((exit_ - center) @ off / radius**2)
    return arc + np.linalg.norm(to_anchor - off)


def bologna_length(exit_, axis, radius, anchor):
    """Ida, Bruckmann, Carricato (2019): the tangent angle psi of a swivelling pulley."""
    to_anchor = anchor - exit_
    along = to_anchor @ axis
    u = (to_anchor - along * axis) / np.linalg.norm(to_anchor - along * axis)
    slope = along / (u @ to_anchor)
    psi = 2 * np.arctan(slope + np.sqrt(1 - 2 * radius / (u @ to_anchor) + slope**2))
    free = to_anchor - radius * (u + u * np.cos(psi) + axis * np.sin(psi))
    return radius * (np.pi - psi) + np.linalg.norm(free)


@pytest.mark.parametrize("length", [wirex_length, caspr_length, bologna_length])
def test_cables_run_over_wheels_as_each_project_says(length):
    """Which way an axis points is a convention; the length of the cable tells whether it was met."""
    robot = cdpr.import_robot(FILES / "crane.wcrfx")
    position = np.array([0.1, 0.05, 1.0])
    rows = zip(EXITS, AXES, position + ANCHORS, strict=True)
    lengths = np.array([length(exit_, axis, 0.03, anchor) for exit_, axis, anchor in rows])
    assert robot.rest_lengths(position) == pytest.approx(lengths, abs=1e-12)
    backwards = robot.replace(pulley_axis=-AXES).rest_lengths(position)
    assert (np.abs(backwards - lengths) > 1e-3).all()


@pytest.mark.parametrize("name", CRANES)
def test_a_written_robot_file_reads_back_as_the_same_robot(name, tmp_path):
    """To the last bit, wheels and workspace included; notes become remarks."""
    robot = cdpr.import_robot(FILES / name)
    place = tmp_path / "crane.toml"
    place.write_text(as_toml(robot), encoding="utf-8")
    again = cdpr.load_robot(place)
    assert again.cabling.same_as(robot.cabling)
    assert np.array_equal(again.force_max, robot.force_max)
    for field in ("center_of_mass", "inertia", "platform_size", "frame", "workspace"):
        assert np.array_equal(getattr(again, field), getattr(robot, field)), field
    for field in ("mass", "gravity", "mobility", "name", "description", "source"):
        assert getattr(again, field) == getattr(robot, field), field
    assert all(f"# {note}" in place.read_text(encoding="utf-8") for note in robot.notes)


EVERYTHING = dict(
    exits=[[0, 0, 1], [1, 0, 1.1], [1 / 7, 0, 1.2]], anchors=[[-0.1, 0, 0], [0.1, 0, 1 / 3], [0, 0, 0.1]],
    axial_stiffness=[1e3, 2e4, 3e3 / 7], mass=0.1, linear_density=[0, 0.01, 0], pulley_radius=[0.01, 0, 0],
    pulley_axis=[[0.3, 0, 0.7], [1, 0, 0], [0, 0, 1]], stiffening=[(1, 2), (1 / 3, 0), (0, 0)], force_min=[1, 2, 0],
    force_max=[np.inf, 50, 60], breaking_load=[90, np.inf, 70], winch_to_exit=[0.3, 0, 1 / 7], reeving=[1, 2, 3],
    pulley_friction=[0.02, 0, 0], hysteresis=[[(0.1, 5e-5)], [], []], creep=[[(4e4, 60.0)], [], []],
    center_of_mass=(0.001, 0, 0.002), inertia=[[0.03, 0.001, 0], [0.001, 0.04, 0.003], [0, 0.003, 0.05]],
    mobility="planar", gravity=1 / 3, name="a \"b\" 'c' é", platform_size=(0.2, 0.1, 0.05),
    frame=[[0, 0, 0], [1, 0, 1.2]], workspace=[[0.2, 0, 0.1], [0.4, 0, 0.3]], material="own rope",
    from_material={}, pretension=1 / 3,
    description='tab\tand "quote" and new\nline', source="π", notes=("a remark",),
)  # fmt: skip
"""Each field of a robot, with numbers of its own, and letters that need care."""


@pytest.mark.parametrize(
    "changes",
    [{}, {"mobility": "spatial"}, {"gravity": 0.0}, {"material": "dyneema-2mm"},
     {"material": "fishing-0.4mm", "axial_stiffness": 999.0}],
    ids=str,
)  # fmt: skip
def test_a_robot_with_all_there_is_reads_back_as_the_same(changes, tmp_path):
    """Every field to the last bit; materials by name where they have one, and notes as remarks."""
    fields = inspect.signature(cdpr.Robot).parameters
    assert all(EVERYTHING[name] is not None and EVERYTHING[name] != one.default for name, one in fields.items())
    robot = cdpr.Robot(**EVERYTHING).replace(**changes)
    place = tmp_path / "all.toml"
    place.write_text(as_toml(robot), encoding="utf-8")
    again = cdpr.load_robot(place)
    for name in set(fields) - {"notes"}:
        np.testing.assert_array_equal(getattr(again, name), getattr(robot, name), err_msg=name)
    assert again.cabling.same_as(robot.cabling)
    assert "# a remark" in place.read_text(encoding="utf-8")


def test_an_axis_of_length_one_is_kept_to_the_last_bit():
    """Else a robot that is written and read again would drift."""
    axes = np.random.default_rng(0).normal(size=(1000, 3))
    once = cdpr.Robot(np.eye(1000, 3), -np.eye(1000, 3), 1e9, 1.0, pulley_axis=axes)
    assert np.array_equal(once.replace(pulley_axis=once.pulley_axis).pulley_axis, once.pulley_axis)


def test_load_robot_and_the_solver_take_such_a_file():
    """All methods that take a robot's name take the path of another project's file."""
    robot = cdpr.load_robot(FILES / "crane.wcrfx")
    rest = cdpr.solve(robot, robot.home)
    assert cdpr.compare(rest, cdpr.settle(robot, robot.home)).agrees


def test_a_set_of_cables_is_chosen_by_name():
    """CASPR's files hold several; the other set here has ideal cables without wheels, one from platform to base."""
    robot = cdpr.import_robot(FILES / "crane_bodies.xml", cables="from_points")
    assert robot.exits == pytest.approx(EXITS, abs=0)
    assert robot.anchors == pytest.approx(ANCHORS, abs=0)
    assert not robot.cabling.pulleys.any()
    with pytest.raises(
        cdpr.RobotFileError, match=r"crane_cables.xml: unknown set of cables 'x'.*known: from_points, on_"
    ):
        cdpr.import_robot(FILES / "crane_bodies.xml", cables="x")
    with pytest.raises(cdpr.RobotFileError, match="only CASPR's files"):
        cdpr.import_robot(FILES / "crane.wcrfx", cables="x")


NOTED = {
    "crane_bodies.xml": [],
    "crane.wcrfx": ["Motors, drums and limits"],
    "crane_cdpyr.json": ["Motors, gearboxes and drums", "viscosity"],
    "crane_bologna.json": [
        "Inactive actuators were left out, 1 of its 5",
        "Transmission ratios",
        r"external force (1.0, 0.0, 0.0) N",
    ],
    "crane_gazebo.yaml": [],
}


@pytest.mark.parametrize("name", NOTED)
def test_notes_say_what_has_no_counterpart(name):
    """One sentence each, and none but these and the assumed stiffness."""
    notes = [note for note in cdpr.import_robot(FILES / name).notes if "was assumed" not in note]
    assert len(notes) == len(NOTED[name])
    for note, words in zip(notes, NOTED[name], strict=True):
        assert words in note
        assert note[0].isupper()
        assert note.endswith(".")


def test_dummies_of_wirex_are_recognised(tmp_path):
    """Its writer puts a centre of gravity one metre off and 25 kg where it knows neither."""
    dummies = [
        ('mass="5"', 'mass="25.000000"'),
        ('x="0.01" y="-0.02" z="0.03"', 'x="0.000000" y="1.000000" z="0.200000"'),
        ('Iyy="0.04"', ""),
        ('elasticity="2e9" radius="0.002523132522"', 'elasticity="110000000000.0" radius="0.006"'),
        *[('radius="0.03"', 'radius="0.100000"')] * 4,
    ]
    robot = cdpr.import_robot(changed(tmp_path, "crane.wcrfx", *dummies))
    assert not robot.center_of_mass.any()
    assert robot.inertia[0, 1] == 0
    for words in ("placeholder, at 1 m", "25 kg", "incomplete", "steel wire", "0.1 m, is WireX's default"):
        assert any(words in note for note in robot.notes), words


def test_wirex_elasticity_is_a_modulus_or_a_compliance(tmp_path):
    """In Pa in its files, in 1/N in its description: the same rope either way."""
    robot = cdpr.import_robot(changed(tmp_path, "crane.wcrfx", ('elasticity="2e9"', 'elasticity="2.5e-5"')))
    assert robot.axial_stiffness == pytest.approx(STIFFNESS)


def test_density_comes_along_over_wheels_too(tmp_path):
    """kg/m in WireX; kg/m³ or kg/m in cdpyr; the written robot has it as well."""
    heavy = cdpr.import_robot(changed(tmp_path, "crane.wcrfx", ('weight="0"', 'weight="0.064"')))
    assert heavy.cabling.pulleys.all()
    assert heavy.cabling.linear_density.tolist() == [0.064] * 4
    for given, expected in (("970", 970 * 2e-5), ("0.0017", 0.0017), ("Infinity", 0)):
        robot = cdpr.import_robot(changed(tmp_path, "crane_cdpyr.json", ('"density": Infinity', f'"density": {given}')))
        assert robot.cabling.linear_density == pytest.approx(expected, rel=WRITTEN)


def test_gravity_along_another_axis_turns_the_base(tmp_path):
    """Bologna's files say which way is up: heights above the turned ground are what they were along that axis."""
    path = changed(tmp_path, "crane_bologna.json", ("[[0], [0], [1]]", "[[0.6], [0], [0.8]]"))
    robot = cdpr.import_robot(path)
    assert robot.exits[:, 2] == pytest.approx(EXITS @ [0.6, 0, 0.8])
    assert robot.cabling.pulley_axis[:, 2] == pytest.approx(AXES @ [0.6, 0, 0.8])
    assert np.linalg.det(robot.exits[1:]) == pytest.approx(np.linalg.det(EXITS[1:]))  # not mirrored
    assert robot.gravity == pytest.approx(9.80665)
    assert any("turned by 36.9 degrees" in note for note in robot.notes)


def test_gravity_is_as_strong_as_its_axis_is_long(tmp_path):
    """In Bologna's files; a sixth, and a crane stands on the moon."""
    path = changed(tmp_path, "crane_bologna.json", ("[[0], [0], [1]]", "[[0], [0], [0.166]]"))
    assert cdpr.import_robot(path).gravity == pytest.approx(0.166 * 9.80665)


@pytest.mark.parametrize(("plane", "normal"), [("xy", 2), ("xz", 1), ("yz", 0)])
def test_planar_robots_of_any_plane_come_to_lie_in_ours(plane, normal):
    """In-plane distances are kept, nothing is mirrored, and the moment about the normal stays with it."""
    points = np.insert(np.array([[-1.0, -1], [1, -1], [1, 2], [-1, 2]]), normal, 0.3, axis=1)
    anchors = np.insert(np.array([[-0.1, 0.0], [0.1, 0], [0.1, 0.2], [-0.1, 0.2]]), normal, 0.3, axis=1)
    inertia = np.zeros((3, 3))
    inertia[normal, normal] = 0.5
    draft = Draft("table", points, anchors, 2.0, inertia=inertia, plane=plane, axial_stiffness=1e4)
    robot = draft.robot()
    assert robot.mobility == "planar"
    assert not robot.exits[:, 1].any()
    up = {"xy": 1, "xz": 2, "yz": 2}[plane]
    assert robot.exits[:, 2] == pytest.approx(points[:, up], abs=0)
    assert robot.exits[:, 0] == pytest.approx(points[:, "xyz".index(plane[0])], abs=0)
    assert robot.inertia[1, 1] == 0.5
    points[0, normal] += 1e-6
    with pytest.raises(cdpr.InvalidInput, match="leave the plane by 1e-06 m"):
        Draft("table", points, anchors, 2.0, plane=plane).robot()


@pytest.mark.parametrize(("plane", "axes"), [("xy", [(0, 1), (2, -1), (1, 1)]), ("yz", [(1, 1), (0, -1), (2, 1)])])
def test_mass_turns_with_the_plane_it_is_in(plane, axes):
    """Each of our axes is one of the file's, or its opposite: for centre of mass and every entry of the inertia."""
    normal = axes[1][0]
    points = np.insert(np.array([[-1.0, -1], [1, -1], [1, 2], [-1, 2]]), normal, 0.0, axis=1)
    center = np.insert([0.01, 0.02], normal, 0.0)
    draft = Draft("table", points, points / 10, 2.0, inertia=INERTIA, center_of_mass=center, plane=plane)
    robot = draft.robot()
    turned = [[p * q * INERTIA[i, j] for j, q in axes] for i, p in axes]
    assert robot.inertia == pytest.approx(np.array(turned), abs=ROUNDING)
    assert robot.center_of_mass.tolist() == [sign * center[axis] for axis, sign in axes]


def flattened(folder: Path, name: str, pattern: str, *changes: tuple[str, str]) -> cdpr.Robot:
    """A crane with all of its points at a height of 0, as a planar robot."""
    for part in {name, name.replace("_bodies", "_cables")}:
        text = re.sub(pattern, lambda found: f"{found[1]}0{found[2]}", (FILES / part).read_text(encoding="utf-8"))
        (folder / part).write_text(text, encoding="utf-8")
    path = folder / name
    for old, new in changes:
        assert old in path.read_text(encoding="utf-8"), old
        path.write_text(path.read_text(encoding="utf-8").replace(old, new), encoding="utf-8")
    return cdpr.import_robot(path)


def test_planar_robots_that_lie_flat_have_no_weight(tmp_path):
    """In the x-y plane of WireX and CASPR gravity acts across it; upright ones of CASPR have theirs."""
    heights = r'(<(?:base|platform) x="\S+" y="\S+" z=")[^"]+(")'
    wirex = flattened(tmp_path, "crane.wcrfx", heights, ("3R3T", "1R2T"))
    assert (wirex.mobility, wirex.gravity) == ("planar", 0)
    heights = r"(location>\S+ \S+ )\S+(</)"
    caspr = flattened(tmp_path, "crane_bodies.xml", heights, ("SPATIAL_EULER_XYZ", "PLANAR_XY"))
    assert (caspr.mobility, caspr.gravity) == ("planar", 0)
    assert caspr.exits == pytest.approx(EXITS[:, [0, 2, 1]] * [1, 0, 1], abs=0)
    depths = r"(location>\S+ )\S+( \S+</)"
    upright = flattened(tmp_path, "crane_bodies.xml", depths, ("SPATIAL_EULER_XYZ", "PLANAR_XZ"))
    assert (upright.mobility, upright.gravity) == ("planar", 9.81)


def test_a_wheel_of_wirex_swivels_about_z_unless_it_says_otherwise(tmp_path):
    """Its third column is the axis, the unit matrix where there is none."""
    text = re.sub(r' a\d\d="\S+"', "", (FILES / "crane.wcrfx").read_text(encoding="utf-8"))
    (tmp_path / "upright.wcrfx").write_text(text, encoding="utf-8")
    assert cdpr.import_robot(tmp_path / "upright.wcrfx").cabling.pulley_axis.tolist() == [[0, 0, 1]] * 4


def test_platforms_that_only_shift_are_points_or_refused():
    """Ours turn: a point does not mind, a rigid one would be another robot."""
    point = Draft("point", EXITS, np.zeros((4, 3)), 5.0, turns=False).robot()
    assert point.platform_size.tolist() == [0.1] * 3
    assert any("does not rotate there" in note for note in point.notes)
    with pytest.raises(cdpr.InvalidInput, match="translates and does not rotate"):
        Draft("stiff", EXITS, ANCHORS, 5.0, turns=False).robot()


def test_exits_on_the_floor_leave_room_below():
    """Where a file counts heights from its exits downwards, home is below them."""
    robot = Draft("hanging", EXITS * [1, 1, 0], ANCHORS, 5.0).robot()
    assert robot.home[2] == pytest.approx(-1)
    assert any("exits lie on the floor" in note for note in robot.notes)


WRONG = [
    ("crane_bodies.xml", [("</link_rigid>", "</link_rigid><link_rigid/>")], "found 2 bodies, expected one platform"),
    ("crane_bodies.xml", [("SPATIAL_EULER_XYZ", "S_EULER_XYZ")], "found 'S_EULER_XYZ', which holds the body"),
    ("crane_bodies.xml", [("<mass>5</mass>", "")], "<physical>: missing <mass>"),
    ("crane_bodies.xml", [("<mass>5<", "<mass>5 kg<")], "<mass>: found ['5', 'kg'], expected numbers"),
    ("crane_bodies.xml", [("<mass>5<", "<mass>nan<")], "<mass>: found nan, expected finite numbers"),
    ("crane_bodies.xml", [("<mass>5<", "<mass>-5<")], "mass: found -5 kg, expected more than 0"),
    ("crane_bodies.xml", [('ref="joint"', 'ref="here"')], "<inertia> ref: found 'here'"),
    ("crane_bodies.xml", [('attachment_reference="com"', "")], "cable 1: attachment_reference: found None"),
    ("crane_bodies.xml", [("</attachments>", "<a/></attachments>")], "cable 1: found 3 attachments, expected two"),
    ("crane_bodies.xml", [("cable_linear_spring name", "a name"), ("</cable_linear_spring>", "</a>")], "found <a>"),
    ("crane_bodies.xml", [("<link>1</link>", "<link>2</link>")], "cable 1: found ends on links 0 and 2"),
    ("crane_bodies.xml", [('default_cable_set="on', 'default_cable_set="at')], "unknown set of cables 'at_pulleys'"),
    ("crane.wcrfx", [("</robot>", "</robot><robot/>")], "found 2 robots, expected one"),
    ("crane.wcrfx", [("3R3T", "1T")], "motionpattern: found '1T'"),
    ("crane.wcrfx", [('x="-1"', "")], "<base>: missing x"),
    ("crane.wcrfx", [('elasticity="2e9"', 'elasticity="-1"')], "found an elasticity of -1"),
    ("crane.wcrfx", [("<models", "<modules"), ("</models", "</modules")], "expected a robot's file"),
    ("crane_cdpyr.json", [('"platforms": [', '"platforms": [{}, ')], "platforms.0.anchors: missing"),
    ("crane_cdpyr.json", [('"translation": 3', '"translation": 1')], "found 1 translations and 3 rotations"),
    ("crane_cdpyr.json", [('"frame_anchor": 3', '"frame_anchor": 4')], "found frame_anchor 4 of 4, counted from 0"),
    ("crane_cdpyr.json", [('"frame_anchor": 3', '"frame_anchor": -1')], "kinematic_chains.3.frame_anchor: found -1"),
    ("crane_cdpyr.json", [("0.005046265044", "true")], "cables.0.diameter: found True, expected a number"),
    ("crane_cdpyr.json", [('"linear": [[5', '"linear": [[Infinity')], "platforms.0.inertia.linear.0.0: found inf"),
    ("crane_bologna.json", [('"mass": 5', '"mass": "5 kg"')], "platform.mass: found '5 kg'"),
    ("crane_bologna.json", [("[[0], [0], [1]]", "[[0], [0], [0]]")], "gravity_axis: found (0.0, 0.0, 0.0)"),
    ("crane_bologna.json", [("[[-1.], [-0.8], [2.]]", "[[-1.], [-0.8]]")], "actuator.0.pulley"),
    ("crane_bologna.json", [("{", '{"motion_pattern": "TWO",')], "motion_pattern: found 'TWO'"),
    ("crane_gazebo.yaml", [("mass: 5", "mass: -5")], "mass: found -5 kg, expected more than 0"),
    ("crane_gazebo.yaml", [("points:", "points: []\nmore:")], "points: found []"),
    ("crane_gazebo.yaml", [("platform: [-0.1", "platform: [.inf")], "points.0.platform.0: found inf"),
    ("crane_gazebo.yaml", [("mass: 5", "mass: 5: 6")], "is not YAML: mapping values are not allowed here in line"),
]  # fmt: skip


@pytest.mark.parametrize(("name", "changes", "said"), WRONG)
def test_what_is_wrong_or_has_no_counterpart_is_one_sentence(name, changes, said, tmp_path):
    """Which file, where in it, what was found, what is expected."""
    path = changed(tmp_path, name, *changes)
    with pytest.raises(cdpr.RobotFileError) as caught:
        cdpr.import_robot(path)
    message = str(caught.value)
    assert said in message
    assert message.startswith(str(path))
    assert message.isprintable()


def test_several_platforms_are_refused(tmp_path):
    """cdpyr's files can have them."""
    document = json.loads((FILES / "crane_cdpyr.json").read_text())
    document["platforms"] *= 2
    (tmp_path / "two.json").write_text(json.dumps(document))
    with pytest.raises(cdpr.RobotFileError, match="platforms: found 2, expected one"):
        cdpr.import_robot(tmp_path / "two.json")


HOSTILE = {
    "bomb.xml": (
        b'<!DOCTYPE a [<!ENTITY b "bb"><!ENTITY c "&b;&b;">]><models><robot>&c;</robot></models>',
        "entities",
    ),
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
}


@pytest.mark.parametrize("name", HOSTILE)
def test_hostile_files_are_refused_in_one_sentence(name, tmp_path):
    """Nothing is expanded, fetched or constructed, and no parser's own exception gets out."""
    content, said = HOSTILE[name]
    (tmp_path / name).write_bytes(content)
    with pytest.raises(cdpr.RobotFileError, match=said):
        cdpr.import_robot(tmp_path / name)


def test_yaml_that_grows_without_bound_is_not_walked(tmp_path):
    """Thirty lines of aliases stand for 9^30 numbers: what is wrong is said before they are counted."""
    lines = ["a0: &a0 [1, 1, 1]", *(f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 9)}]" for i in range(1, 31))]
    (tmp_path / "bomb.yaml").write_text("\n".join([*lines, "points: *a30", "platform: {mass: *a30, inertia: *a30}"]))
    with pytest.raises(cdpr.RobotFileError, match=r"points.0: found \[\[.*expected keys with values"):
        cdpr.import_robot(tmp_path / "bomb.yaml")


def test_missing_files_and_formats_are_one_sentence(tmp_path):
    """The file that is missing is named, CASPR's second one included."""
    with pytest.raises(cdpr.RobotFileError, match=r"nowhere\.json: no such file"):
        cdpr.load_robot(tmp_path / "nowhere.json")
    shutil.copy(FILES / "crane_bodies.xml", tmp_path)
    with pytest.raises(cdpr.RobotFileError, match=r"crane_cables\.xml: no such file"):
        cdpr.import_robot(tmp_path / "crane_bodies.xml")
    (tmp_path / "crane_bodies.xml").rename(tmp_path / "crane.xml")
    shutil.copy(FILES / "crane_cables.xml", tmp_path)
    with pytest.raises(cdpr.RobotFileError, match=r"crane_bodies\.xml: no such file"):
        cdpr.import_robot(tmp_path / "crane_cables.xml")
    (tmp_path / "crane_cables.xml").rename(tmp_path / "cables.xml")
    for name, mine, other in (("crane.xml", "bodies", "cables"), ("cables.xml", "cables", "bodies")):
        expected = rf"found the name '{name}', expected NAME_{mine}\.xml, with NAME_{other}\.xml in the same folder"
        with pytest.raises(cdpr.RobotFileError, match=expected):
            cdpr.import_robot(tmp_path / name)
    with pytest.raises(cdpr.UnknownName, match=r"unknown format 'wirx': did you mean wirex"):
        cdpr.import_robot(FILES / "crane.wcrfx", format="wirx")
    with pytest.raises(cdpr.RobotFileError, match=r"found no bodies_system at the top, expected CASPR's XML"):
        cdpr.import_robot(FILES / "crane.wcrfx", format="caspr")
    for format, name in {"wirex": "crane.wcrfx", "cdpyr": "crane_cdpyr.yaml", "bologna": "crane_bologna.json"}.items():
        assert cdpr.import_robot(FILES / name, format).mass == 5


@pytest.mark.parametrize("format", [None, "caspr"])
def test_either_file_of_casprs_pair_stands_for_both(format):
    """Neither says more than the other of which robot is meant."""
    robots = [cdpr.import_robot(FILES / f"crane_{part}.xml", format, "from_points") for part in ("bodies", "cables")]
    for name in FIELDS:
        np.testing.assert_array_equal(*(getattr(robot, name) for robot in robots), err_msg=name)


MUTATIONS = 15


def mutate_imports():
    """The script of that name."""
    path = Path(__file__).parents[1] / "scripts" / "mutate_imports.py"
    spec = importlib.util.spec_from_file_location("mutate_imports", path)
    assert spec is not None
    assert spec.loader is not None
    script = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(script)
    return script


@pytest.mark.parametrize("name", [*CRANES, "hangprinter.g"])
def test_damaged_files_give_a_robot_or_a_sentence(name, tmp_path):
    """Some of what ``scripts/mutate_imports.py`` does by the thousand."""
    kinds = [kind for kind, _ in mutate_imports().answers(FILES / name, MUTATIONS, 1, tmp_path)]
    assert set(kinds) == {"robot", "sentence"}


def test_a_busy_machine_makes_no_file_too_slow(monkeypatch):
    """The script counts the importer's own processor time: clocks that leap a minute at each look change nothing."""
    minutes = itertools.count(step=60)
    for clock in ("monotonic", "perf_counter", "time"):
        monkeypatch.setattr(time, clock, lambda: float(next(minutes)))
    assert mutate_imports().answer(FILES / "crane_gazebo.yaml")[0] == "robot"


runner = CliRunner()


def test_help_names_every_format():
    """In words of its own, so that ``--help`` need not load what reads them."""
    shown = " ".join(runner.invoke(app, ["import", "--help"], env={"COLUMNS": "200"}).output.split())
    for name, one in FORMATS.items():
        assert one.TITLE in shown
        assert name in shown.partition("--format")[2]


def test_import_writes_a_robot_file_that_settles(tmp_path):
    """One command from another project's file to ours, which any command takes; notes are told and kept."""
    place = tmp_path / "mine.toml"
    result = runner.invoke(app, ["import", str(FILES / "crane_gazebo.yaml"), "-o", str(place)])
    assert result.exit_code == 0, result.output
    assert "crane_gazebo, spatial, 4 cables, 5 kg" in result.stdout
    assert "- The elasticity of its cables is not given" in result.stdout
    first = runner.invoke(app, ["solve", str(place), "--json"])
    second = runner.invoke(app, ["solve", str(FILES / "crane_gazebo.yaml"), "--json"])
    assert first.exit_code == second.exit_code == 0
    assert first.stdout == second.stdout
    assert "cdpr-sim: note: The elasticity of its cables is not given" in second.stderr


def test_import_replaces_nothing_unasked_and_writes_nothing_broken(tmp_path):
    """What was there stays there, after a mistake as well."""
    place = tmp_path / "mine.toml"
    place.write_text("mine")
    result = runner.invoke(app, ["import", str(FILES / "crane.wcrfx"), "-o", str(place)])
    assert (result.exit_code, place.read_text()) == (2, "mine")
    assert "exists, expected a new place or --force" in result.stderr
    result = runner.invoke(app, ["import", str(FILES / "crane.csv"), "-o", str(place), "--force"])
    assert (result.exit_code, place.read_text()) == (2, "mine")
    assert result.stderr.count("\n") == 1
    result = runner.invoke(app, ["import", str(FILES / "crane.wcrfx"), "-o", str(place), "--force"])
    assert result.exit_code == 0
    assert cdpr.load_robot(place).name == "crane"
    assert sorted(tmp_path.iterdir()) == [place]

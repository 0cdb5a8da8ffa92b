"""Formats of robots: one crane of our own in each format of other projects, and what our files write and read."""

import inspect
import json
import re
import tomllib
from pathlib import Path

import numpy as np
import pytest
from inputs import FILES, changed, robot_file, run, said

import cdpr_sim as cdpr
import mutate_imports
from cdpr_sim.core.cable import PROPERTIES
from cdpr_sim.core.robot import FIELDS
from cdpr_sim.robots import robot_file as fields_of_files
from cdpr_sim.robots.importers.draft import Draft
from cdpr_sim.robots.robot_file_text import as_toml

ROOT = Path(__file__).parents[1]
EXITS = np.array([[-1, -0.8, 2], [1, -0.8, 2], [1, 0.8, 2.1], [-1, 0.8, 2.1]])
ANCHORS = np.array([[-0.1, -0.08, 0.05], [0.1, -0.08, 0.05], [0.1, 0.08, -0.05], [-0.1, 0.08, -0.05]])
AXES = np.array([[0.0, 0, 1], [0, 0, -1], [1, 0, 0], [0, 1, 0]])
INERTIA = np.array([[0.03, 0.001, 0.002], [0.001, 0.04, 0.003], [0.002, 0.003, 0.05]])
HOME = np.array([0.1, 0.05, 1])
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


def assert_same(one: cdpr.Robot, other: cdpr.Robot, but: tuple[str, ...] = ()) -> None:
    """To the last bit, in all fields."""
    for name in FIELDS:
        if name not in but:
            np.testing.assert_array_equal(getattr(one, name), getattr(other, name), err_msg=name)


def read_back(robot: cdpr.Robot, folder: Path) -> cdpr.Robot:
    """Written to a file, which has each note as a remark, and read again."""
    file = cdpr.write_robot(folder / "again.toml", robot, force=True)
    text = file.read_text(encoding="utf-8")
    assert all(f"# {note}" in text for note in robot.notes)
    return cdpr.load_robot(file)


# Other projects' formats


@pytest.mark.parametrize("name", CRANES)
def test_every_format_tells_of_the_same_crane_which_our_file_keeps(name, tmp_path):
    """Frames, references, orders and units differ from format to format; the robot does not."""
    robot = cdpr.import_robot(FILES / name)
    assert robot.exits == pytest.approx(EXITS, abs=0)
    assert robot.anchors == pytest.approx(ANCHORS, abs=ROUNDING)
    assert (robot.mass, robot.mobility) == (5, "spatial")
    center = (0, 0, 0) if name == "crane_gazebo.yaml" else (0.01, -0.02, 0.03)  # Gazebo's is the origin
    assert robot.center_of_mass.tolist() == pytest.approx(center, abs=0)
    assert robot.inertia == pytest.approx(INERTIA, abs=ROUNDING)
    assert robot.cabling.pulley_radius.tolist() == [0.03 * ("wheels" in CRANES[name])] * 4
    for field, plain in {"linear_density": 0, "winch_to_exit": 0, "reeving": 1, "stiffening": 0}.items():
        assert (getattr(robot, field) == plain).all(), field
    if "wheels" in CRANES[name]:
        assert robot.cabling.pulley_axis == pytest.approx(AXES, abs=0)
    if "stretches" in CRANES[name]:
        assert robot.axial_stiffness == pytest.approx(np.full(4, STIFFNESS), rel=WRITTEN)
    else:
        assert robot.axial_stiffness == pytest.approx(5 * 9.81 / 1e-3, rel=0.05)
        assert any("axial stiffness of 49000 N was assumed" in note for note in robot.notes)
    if "home" in CRANES[name]:
        assert robot.home == pytest.approx(HOME, abs=0)
    assert all(note[0].isupper() and note.endswith(".") for note in robot.notes)
    assert_same(read_back(robot, tmp_path), robot, but=("notes",))


DUMMIES = {
    'mass="5"': 'mass="25.000000"', 'x="0.01" y="-0.02" z="0.03"': 'x="0.000000" y="1.000000" z="0.200000"',
    'Iyy="0.04"': "", 'elasticity="2e9" radius="0.002523132522"': 'elasticity="110000000000.0" radius="0.006"',
    re.compile('radius="0.03"'): 'radius="0.100000"',
}  # fmt: skip
"""What WireX writes where it knows nothing: a centre of gravity one metre off, 25 kg, steel wire."""

FLAT = {
    "crane.wcrfx": {re.compile(r'(<(?:base|platform) x="\S+" y="\S+" z=")[^"]+'): r"\g<1>0", "3R3T": "1R2T"},
    "crane_bodies.xml": {re.compile(r"(location>\S+ \S+ )\S+(</)"): r"\g<1>0\2", "SPATIAL_EULER_XYZ": "PLANAR_XY"},
}


def spread(off: np.ndarray) -> np.ndarray:
    """Inertia of a unit mass so far from the origin."""
    return off @ off * np.eye(3) - np.outer(off, off)


UPRIGHT = {re.compile(r"(location>\S+ )\S+( \S+</)"): r"\g<1>0\2", "SPATIAL_EULER_XYZ": "PLANAR_XZ"}

TOLD = [  # a file, what is changed in it, what is read of the robot, and words of its notes
    ("crane_bodies.xml", {}, "force_max", [100, 110, 120, 130], []),
    ("crane_gazebo.yaml", {}, "force_min", [1] * 4, ["was assumed"]),
    ("crane_gazebo.yaml", {}, "force_max", [100] * 4, ["was assumed"]),
    ("crane.wcrfx", {'elasticity="2e9"': 'elasticity="2.5e-5"'}, "axial_stiffness", [STIFFNESS] * 4, ["Motors, drums"]),
    ("crane.wcrfx", {'weight="0"': 'weight="0.064"'}, "linear_density", [0.064] * 4, ["Motors, drums and limits"]),
    ("crane.wcrfx", {re.compile(r' a\d\d="\S+"'): ""}, "pulley_axis", [[0, 0, 1]] * 4, ["Motors"]),
    ("crane.wcrfx", DUMMIES, "center_of_mass", [0, 0, 0],
     ["placeholder, at 1 m", "25 kg", "incomplete", "steel wire", "0.1 m, is WireX's default"]),
    ("crane.wcrfx", DUMMIES, "inertia", lambda found: found[0, 1] == 0, ["placeholder"]),
    ("crane.wcrfx", FLAT["crane.wcrfx"], "gravity", 0, []),
    ("crane.wcrfx", FLAT["crane.wcrfx"], "mobility", "planar", []),
    ("crane_bodies.xml", FLAT["crane_bodies.xml"], "gravity", 0, []),  # in the x-y plane gravity acts across it
    ("crane_bodies.xml", FLAT["crane_bodies.xml"], "exits", EXITS[:, [0, 2, 1]] * [1, 0, 1], []),
    ("crane_bodies.xml", UPRIGHT, "gravity", 9.81, []),
    ("crane_bodies.xml", UPRIGHT, "mobility", "planar", []),
    ("crane_cdpyr.json", {}, "mass", 5, ["Motors, gearboxes and drums", "viscosity"]),
    *(("crane_cdpyr.json", {'"density": Infinity': f'"density": {given}'}, "linear_density", [expected] * 4, [])
      for given, expected in (("970", 970 * 2e-5), ("0.0017", 0.0017), ("Infinity", 0))),  # per volume or per length
    ("crane_bologna.json", {"[[0], [0], [1]]": "[[0], [0], [0.166]]"}, "gravity", 0.166 * 9.80665,
     ["Inactive actuators were left out, 1 of its 5", "Transmission ratios", "external force (1.0, 0.0, 0.0) N"]),
    ("crane_bologna.json", {"[[0], [0], [1]]": "[[0.6], [0], [0.8]]"}, "gravity", 9.80665, ["turned by 36.9 degrees"]),
    ("crane_bologna.json", {"[[0], [0], [1]]": "[[1e-4], [0], [1]]"}, "gravity", 9.80665 * np.hypot(1, 1e-4),
     ["turned by 0.00573 degrees"]),  # of a ten-thousandth
    ("crane_bologna.json", {"[[0], [0], [1]]": "[[0.6], [0], [0.8]]"}, "exits",  # heights stay; it is not mirrored
     lambda found: [found[:, 2], np.linalg.det(found[1:])]
     == [pytest.approx(EXITS @ [0.6, 0, 0.8]), pytest.approx(np.linalg.det(EXITS[1:]))], []),
    ("crane_bologna.json", {"[[0], [0], [1]]": "[[0.6], [0], [0.8]]"}, "pulley_axis",
     lambda found: found[:, 2] == pytest.approx(AXES @ [0.6, 0, 0.8]), []),
    ("crane_mjcf.xml", {'springlength="0 2"': ""}, "axial_stiffness",  # the length of the model as it stands
     [20e3 * np.linalg.norm(EXITS[0] - ANCHORS[0] - HOME), *[STIFFNESS] * 3], ["pushes as well"]),
    ("crane_mjcf.xml", {'quat="0 0 0 1"': 'euler="0 0 180"'}, "exits", lambda found: found == pytest.approx(EXITS), []),
    ("crane_mjcf.xml", {'<geom type': '<geom mass="9" type'}, "mass", 5, []),  # as MuJoCo: <inertial> overrides
    ("crane_mjcf.xml", {'<body pos="0 0.08 0">': '<body pos="0 0.08 0"><geom size="0.1" mass="2" />'}, "mass", 7, []),
    ("crane_mjcf.xml", {'<body pos="0 0.08 0">': '<body pos="0 0.08 0"><geom size="0.1" mass="2" />'}, "center_of_mass",
     [0.05 / 7, (-0.1 + 0.16) / 7, 0.15 / 7], []),
    ("crane_mjcf.xml", {'<body pos="0 0.08 0">': '<body pos="0 0.08 0"><geom size="0.1" mass="2" />'}, "inertia",
     INERTIA + 5 * spread(np.array([0.01, -0.02, 0.03])) + 2 * spread(np.array([0, 0.08, 0])) + 0.008 * np.eye(3)
     - 7 * spread(np.array([0.05, 0.06, 0.15]) / 7), []),
]  # fmt: skip


@pytest.mark.parametrize(("name", "changes", "field", "expected", "notes"), TOLD)
def test_what_other_files_tell_is_read_and_what_has_no_counterpart_is_noted(
    name, changes, field, expected, notes, tmp_path
):
    """Limits of force, units of elasticity and density, axes of wheels, planes, gravity, and placeholders."""
    robot = cdpr.import_robot(changed(tmp_path, name, changes))
    found = getattr(robot, field)
    if callable(expected):
        assert expected(found)
    elif isinstance(expected, str):
        assert found == expected
    else:
        np.testing.assert_allclose(found, np.array(expected, float), rtol=WRITTEN, atol=0)
    for words in notes:
        assert any(words in note for note in robot.notes), words
    assert len(robot.notes) >= len(notes)
    if changes == {} or "weight" in str(changes):
        assert len(robot.notes) == len(notes)  # and nothing else is noted


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


@pytest.mark.parametrize("name", ["cogiro", "planar-vertical", "nist-robocrane", "cogiro-crane"])
def test_our_own_models_give_the_robot_back(name, catalogue):
    """As MJCF: all that statics depends on, EA to twelve digits; also from the scene, which includes the robot."""
    robot, again = catalogue[name], cdpr.import_robot(ROOT / "models" / name / "robot.xml")
    for field in ("exits", "anchors", "mass", "center_of_mass", "mobility", "gravity", "name"):
        np.testing.assert_array_equal(getattr(robot, field), getattr(again, field), err_msg=field)
    assert again.inertia == pytest.approx(robot.inertia, abs=ROUNDING * robot.inertia.max())
    assert again.axial_stiffness == pytest.approx(robot.axial_stiffness, rel=1e-12)
    scene = cdpr.import_robot(ROOT / "models" / name / "scene.xml")
    assert_same(scene, again, but=("name", "source", "description"))


def wheel_length(exit_, axis, radius, anchor):
    """Pott, Cable-driven Parallel Robots (2018), pulley kinematics, in a frame whose z axis is the swivel axis."""
    along = (anchor - exit_) @ axis
    across = np.linalg.norm(anchor - exit_ - along * axis)
    to_center = np.hypot(across - radius, along)
    free = np.sqrt(to_center**2 - radius**2)
    return radius * (np.arccos(free / to_center) + np.arccos(along / to_center)) + free


def test_cables_run_over_wheels_as_other_projects_say():
    """Which way an axis points is a convention; the length of the cable tells whether it was met."""
    robot = cdpr.import_robot(FILES / "crane.wcrfx")
    rows = zip(EXITS, AXES, HOME + ANCHORS, strict=True)
    lengths = np.array([wheel_length(exit_, axis, 0.03, anchor) for exit_, axis, anchor in rows])
    assert robot.rest_lengths(HOME) == pytest.approx(lengths, abs=1e-12)
    assert (np.abs(robot.replace(pulley_axis=-AXES).rest_lengths(HOME) - lengths) > 1e-3).all()


def test_a_set_of_cables_is_chosen_by_name_and_either_file_of_casprs_pair_stands_for_both():
    """The other set here has ideal cables without wheels, one from platform to base."""
    parts = [(part, format) for part in ("bodies", "cables") for format in (None, "caspr")]
    robots = [cdpr.import_robot(FILES / f"crane_{part}.xml", format, "from_points") for part, format in parts]
    assert robots[0].exits == pytest.approx(EXITS, abs=0)
    assert robots[0].anchors == pytest.approx(ANCHORS, abs=0)
    assert not robots[0].cabling.pulleys.any()
    for robot in robots[1:]:
        assert_same(robot, robots[0])


@pytest.mark.parametrize(
    ("plane", "axes"),
    [("xy", [(0, 1), (2, -1), (1, 1)]), ("xz", [(0, 1), (1, 1), (2, 1)]), ("yz", [(1, 1), (0, -1), (2, 1)])],
)
def test_planar_robots_of_any_plane_come_to_lie_in_ours(plane, axes):
    """Each of our axes is one of the file's, or its opposite: for points, centre of mass and inertia; none mirrored."""
    normal = axes[1][0]
    points = np.insert(np.array([[-1.0, -1], [1, -1], [1, 2], [-1, 2]]), normal, 0.3, axis=1)
    center = np.insert([0.01, 0.02], normal, 0.3)
    given = dict(inertia=INERTIA, center_of_mass=center, plane=plane, axial_stiffness=1e4)
    robot = Draft("table", points, points, 2.0, **given).robot()
    turned = np.array([[sign * (axis == i) for i in range(3)] for axis, sign in axes])
    in_plane = np.delete(np.eye(3), normal, 0).sum(0)
    assert (robot.mobility, np.linalg.det(turned)) == ("planar", pytest.approx(1))
    assert robot.exits == pytest.approx(points * in_plane @ turned.T, abs=0)
    assert robot.center_of_mass == pytest.approx(turned @ (center * in_plane), abs=0)
    assert robot.inertia == pytest.approx(turned @ INERTIA @ turned.T, abs=ROUNDING)


def test_what_a_file_leaves_open_is_filled_in_and_noted():
    """A point that only shifts has a size; where heights are counted from the exits downwards, home is below them."""
    point = Draft("point", EXITS, np.zeros((4, 3)), 5.0, turns=False).robot()
    assert point.platform_size.tolist() == [0.1] * 3
    assert any("does not rotate there" in note for note in point.notes)
    hanging = Draft("hanging", EXITS * [1, 1, 0], ANCHORS, 5.0).robot()
    assert hanging.home[2] == pytest.approx(-1)
    assert any("exits lie on the floor" in note for note in hanging.notes)


@pytest.mark.parametrize("name", [*CRANES, "hangprinter.g"])
def test_damaged_files_give_a_robot_or_a_sentence(name, tmp_path):
    """Fifteen of what ``scripts/dev/mutate_imports.py`` does by the thousand."""
    assert {kind for kind, _ in mutate_imports.answers(FILES / name, 15, 1, tmp_path)} == {"robot", "sentence"}


# Our own


EXAMPLES = {
    name: tomllib.loads(f"value = {one.example[0]}")["value"] for name, one in PROPERTIES.items() if one.example
}
EVERYTHING = EXAMPLES | dict(
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
"""Each field of a robot, with numbers of its own, or those of the template; and letters that need care."""


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
    assert_same(read_back(robot, tmp_path), robot, but=("notes",))


def test_materials_and_pretension_are_written_by_name_and_read_back(tmp_path):
    """Also where they differ from cable to cable; a copy of a catalogue robot keeps its words."""
    words = {"#robot": 'material = "dyneema-2mm"\nlinear_density = "material"\npretension = 3.5'}
    robot = cdpr.load_robot(robot_file(tmp_path, words | {"#cable": "linear_density = 0.01"}))
    for one in (robot, robot.replace(material="nylon-0.4mm", linear_density=0), robot.replace(axial_stiffness=5e3)):
        again = read_back(one, tmp_path)
        assert_same(again, one)
        assert (again.from_material, again.pretension) == (one.from_material, 3.5)


def test_an_axis_of_length_one_is_kept_to_the_last_bit():
    """Else a robot that is written and read again would drift."""
    axes = np.random.default_rng(0).normal(size=(1000, 3))
    once = cdpr.Robot(np.eye(1000, 3), -np.eye(1000, 3), 1e9, 1.0, pulley_axis=axes)
    assert np.array_equal(once.replace(pulley_axis=once.pulley_axis).pulley_axis, once.pulley_axis)


SECTION = np.pi * 0.002**2 / 4

CABLES = [  # what a file says of the robot's cables, what else of the first, and stiffnesses and a material
    ("axial_stiffness = 5e3", "", 5e3, None),
    ('axial_stiffness = 5e3\ncable_name = "mine"', "", 5e3, "mine"),
    ("modulus = 60e9\ndiameter = 0.0015", "", 60e9 * np.pi * 0.0015**2 / 4, None),
    ('units = "mm"\nmodulus = 60e9\ndiameter = 1.5', "", 60e9 * np.pi * 0.0015**2 / 4, None),
    ('material = "vectran-0.7mm"', "", 10e3, "vectran-0.7mm"),
    ('material = "dyneema"\ndiameter = 0.002', "", 64e9 * 0.65 * SECTION, "dyneema-2mm"),
    ('units = "mm"\nmaterial = "dyneema"\ndiameter = 2', "", 64e9 * 0.65 * SECTION, "dyneema-2mm"),
    ('material = "dyneema-2mm"', "", 64e9 * 0.65 * SECTION, "dyneema-2mm"),
    ("axial_stiffness = 1.0", "axial_stiffness = 5e3", [5e3, 1.0], None),
    ("axial_stiffness = 1.0", "modulus = 60e9\ndiameter = 0.002", [60e9 * SECTION, 1.0], None),
    ("axial_stiffness = 1.0", 'material = "dyneema"\ndiameter = 0.002', [64e9 * 0.65 * SECTION, 1.0], None),
    ("axial_stiffness = 2000.0", 'material = "fishing-0.4mm"', [1000, 2000], None),
    ('material = "dyneema"\ndiameter = 0.002', "diameter = 0.004", 64e9 * 0.65 * SECTION * np.array([4, 1]), None),
    ('material = "steel-rope"\ndiameter = 0.004', "", 40.4e9 * 0.004**2, "steel-rope-4mm"),
]  # fmt: skip


@pytest.mark.parametrize(("robot", "cable", "stiffness", "material"), CABLES)
def test_cables_are_given_in_one_of_three_ways(robot, cable, stiffness, material, tmp_path):
    """For all of them, or for one, which then has a stiffness and a name of its own; in millimetres as well."""
    found = cdpr.load_robot(robot_file(tmp_path, {"#robot": robot, "#cable": cable}))
    rounded = 2e-3 if "steel" in robot else 1e-12  # EN 12385-4 has three digits
    np.testing.assert_allclose(found.axial_stiffness, np.broadcast_to(stiffness, 2), rtol=rounded)
    assert (found.name, found.material) == ("mine", material)


def test_ropes_weigh_and_break_where_their_sources_say_and_nowhere_else(tmp_path):
    """6x19 steel, grade 1770: 0.400 kg/m per cm² of d² and 0.356 d² 1770 MPa (EN 12385-4); braided HMPE: 580 MPa d²."""
    words = {"#robot": 'material = "steel-rope"\ndiameter = 0.004\nlinear_density = "material"'}
    robot = cdpr.load_robot(robot_file(tmp_path, words | {"#cable": 'material = "dyneema-2mm"'}))
    assert robot.linear_density[1] == pytest.approx(0.400e4 * 0.004**2, rel=2e-3)
    np.testing.assert_allclose(robot.breaking_load, [580e6 * 0.002**2, 0.356 * 1770e6 * 0.004**2], rtol=1e-3)
    for name, rope in cdpr.ROPES.items():
        known = name in {"steel-rope", "dyneema", "nylon"}
        assert rope.source
        assert 0 < rope.fill <= 1
        assert (rope.strength is not None) == ("breaking" in rope.source and "not known" not in rope.source) == known
        assert np.isfinite(robot.replace(material=f"{name}-2mm").breaking_load).all() == known
    assert {name for name, one in cdpr.MATERIALS.items() if one.breaking_load is not None} == {"nylon-0.4mm"}
    words = {"#robot": 'material = "dyneema-2mm"\nbreaking_load = 900', "#cable": "breaking_load = 700"}
    assert cdpr.load_robot(robot_file(tmp_path, words)).breaking_load.tolist() == [700, 900]


def test_another_material_changes_the_mass_of_cables_that_had_the_last_ones(tmp_path, monkeypatch):
    """In a sweep, in a check and with `--material`; a mass given by hand stays, and is noted."""
    monkeypatch.chdir(tmp_path)
    crane = cdpr.load_robot("cogiro-crane").replace(material="steel-rope-4mm")
    text = as_toml(crane).replace(
        'material = "steel-rope-4mm"', 'material = "steel-rope-4mm"\nlinear_density = "material"'
    )
    Path("crane.toml").write_text(text)
    Path("rope.toml").write_text(text.replace("steel-rope-4mm", "dyneema-4mm"))
    Path("hand.toml").write_text(text.replace('linear_density = "material"', "linear_density = 0.064"))
    words = ("--material", "dyneema-4mm", "--json")
    told = [run("solve", "crane.toml", *words), run("solve", "rope.toml", "--json"), run("solve", "hand.toml", *words)]
    asked, meant, stays = (json.loads(one.stdout)["position"] for one in told)
    assert asked == meant
    assert abs(stays[2] - meant[2]) > 1e-5
    assert "given by hand, and not changed by --material dyneema-4mm: mass per length" in said(told[2].stderr)
    crane, rope = cdpr.load_robot("crane.toml"), cdpr.load_robot("rope.toml")
    both = cdpr.sweep(crane, (2, 1, 1), ["steel-rope-4mm", "dyneema-4mm"])
    for material, one in (("steel-rope-4mm", crane), ("dyneema-4mm", rope)):
        single, mine = cdpr.sweep(one, (2, 1, 1)), both.sel(material=material)
        for name in ("position", "tensions", "feasible", "linear_density"):
            np.testing.assert_array_equal(mine[name], single[name], err_msg=name)
    checked = (cdpr.check(crane, (1, 1, 1), ["dyneema-4mm"]), cdpr.check(rope, (1, 1, 1)))
    np.testing.assert_array_equal(*(one.dataset["position_error"].squeeze() for one in checked))
    shown = said(run("show", "hand.toml", *words[:2]).stdout)
    assert "EA, breaking load of dyneema-4mm; by hand: mass per length" in shown
    shown = json.loads(run("show", "crane.toml", "--force", "--json").stdout)
    assert set(shown["from_material"]) == {"axial_stiffness", "linear_density", "breaking_load"}


KEYS = {key for table in fields_of_files.TABLES.values() for key in table.model_fields}


def test_the_document_and_the_schema_know_every_key_and_nothing_else():
    """docs/robot-file.md is what `cdpr-sim schema --document` prints; the schema is strict, and describes each key."""
    printed = run("schema", "--document").stdout
    assert (ROOT / "docs" / "robot-file.md").read_text(encoding="utf-8") == printed
    for table in fields_of_files.TABLES.values():
        for key, field in table.model_fields.items():
            assert re.search(rf"^\| `{key}` \| .* \| {re.escape(field.description)} \|$", printed, re.MULTILINE), key
    schema = json.loads(run("schema").stdout)
    tables = [schema, *schema["$defs"].values()]
    assert {key for table in tables for key in table["properties"]} == KEYS
    assert all(table["additionalProperties"] is False for table in tables)
    assert all("description" in value for table in tables for value in table["properties"].values())


def test_the_template_settles_as_it_is_and_mentions_every_key(tmp_path, monkeypatch):
    """Both methods agree on what `new` writes; with its comments uncommented, it is a robot as well."""
    monkeypatch.chdir(tmp_path)
    assert run("new", "mine").exit_code == 0
    robot = cdpr.load_robot("mine.toml")
    assert robot.name == "mine"
    assert cdpr.compare(cdpr.solve(robot, robot.home), cdpr.settle(robot, robot.home)).agrees
    text = Path("mine.toml").read_text(encoding="utf-8")
    of_wheel = {one.place[1] for one in PROPERTIES.values() if one.place[0] == "pulley"}  # in one line
    for key in KEYS - of_wheel - {"platform", "frame", "workspace", "cables"}:
        assert re.search(rf"^#?{key} = ", text, re.MULTILINE), key
    memories, without = "pulley_friction|hysteresis|creep", "axial_stiffness|modulus|linear_density|name"
    for refused in (memories, "stiffening"):  # a rope with a memory has a linear law
        with_all = re.sub(rf"^#(?!{without}|{refused})(\w+ = )", r"\1", text, flags=re.MULTILINE)
        assert with_all != text
        Path("mine.toml").write_text(with_all)
        assert cdpr.load_robot("mine.toml").material == "my own rope"


def test_new_copies_a_robot_and_says_what_a_name_means(tmp_path, monkeypatch):
    """`--from` a name or a file; a name of the catalogue is noted."""
    monkeypatch.chdir(tmp_path)
    assert run("new", "mine", "--from", "cogiro-crane-built").exit_code == 0
    built = cdpr.load_robot("cogiro-crane-built")
    assert cdpr.load_robot("mine.toml").cabling.same_as(built.cabling)
    assert "# kg/m: 0.064" in Path("mine.toml").read_text()
    assert run("new", "second", "--from", "mine.toml").exit_code == 0
    assert_same(cdpr.load_robot("second.toml").replace(name=built.name), built, but=("notes", "description", "source"))
    assert "parallel is a robot of the catalogue as well" in said(run("new", "parallel").stderr)

"""Robots that cannot be or are hardly meant, machines that lend no folder, and requests that cannot fit."""

import re
import time
import warnings

import numpy as np
import pytest

import cdpr_sim as cdpr
from cdpr_sim.core import checks
from cdpr_sim.design.layout_equilibria import Cases

SOUND = dict(
    exits=[[-1, -1, 2], [1, -1, 2], [1, 1, 2], [-1, 1, 2]],
    anchors=[[-0.1, -0.1, 0.1], [0.1, -0.1, 0.1], [0.1, 0.1, 0.1], [-0.1, 0.1, 0.1]],
    axial_stiffness=1e4,
    mass=2.0,
)

FILE = """
name = "mine"
axial_stiffness = 1e4
[platform]
mass = 2.0
size = [0.2, 0.2, 0.2]
"""

CABLES = "".join(
    f"[[cables]]\nexit = {[float(x) for x in exit]}\nanchor = {anchor}\n"
    for exit, anchor in zip(SOUND["exits"], SOUND["anchors"], strict=True)
)


def sentence(error: Exception) -> str:
    """The message, which is one line of readable length."""
    text = str(error)
    assert "\n" not in text
    assert len(text) < 400, text
    return text


@pytest.mark.parametrize(
    "name",
    ["../../x", "a/b", "a\\b", "..", ".", "", "  ", "a\nb", "nul\0", "x" * 10_000, "\ud800", "tab\there", 7, None],
    ids=ascii,
)
def test_a_name_that_cannot_head_a_table_or_name_a_folder_is_refused(name):
    """Path separators, control characters, empty, over-long, no text: at the door, in one sentence."""
    with pytest.raises(cdpr.InvalidInput, match="name: found") as refused:
        cdpr.Robot(**SOUND, name=name)
    sentence(refused.value)


@pytest.mark.parametrize(
    "name", ["crane [v2]", "[bold]", "Kran Ä (größer)", "机器人", "cogiro, compensated", "x" * 100]
)
def test_a_name_in_any_language_is_taken(name):
    """Brackets are no markup, and letters are not English alone."""
    assert cdpr.Robot(**SOUND, name=name).name == name


@pytest.mark.parametrize(
    ("field", "text"), [("material", "a\0b"), ("material", ""), ("description", "\x1b[31m"), ("source", 3)]
)
def test_texts_with_control_characters_are_refused(field, text):
    """A description that turns the terminal red is none."""
    with pytest.raises(cdpr.InvalidInput, match=f"{field}: found"):
        cdpr.Robot(**SOUND, **{field: text})


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        (dict(mass=1e-12), "mass: found 1e-12 kg, expected 1e-06 to 1e+12 kg"),
        (dict(mass=10**400), "mass: found a number of 401 digits, expected numbers"),
        (dict(exits=[[1e308, 0, 1]] * 4), "exits: found 1e+308 m in cable 1, expected -1e+06 to 1e+06 m"),
        (dict(anchors=[[0, 0, 0]] * 3 + [[0, 1e9, 0]]), "anchors: found 1e+09 m in cable 4"),
        (dict(anchors=[[0, 0, 1e-300]] * 4, platform_size=[1, 1, 1]), "anchors: found all within 1e-300 m"),
        (dict(axial_stiffness=1e-320), "axial_stiffness: found 9.99989e-321 N in cable 1, expected 1e-06 to 1e+15 N"),
        (dict(axial_stiffness=[1, 1, 1e300, 1]), "axial_stiffness: found 1e+300 N in cable 3"),
        (dict(gravity=1e300), "gravity: found 1e+300 m/s², expected 0 to 1e+06 m/s²"),
        (dict(center_of_mass=[0, 0, 1e200]), "center_of_mass: found 1e+200 m"),
        (dict(platform_size=[1, 1, 1e-200]), "platform_size: found 1e-200 m, expected at least 1e-09 m"),
        (dict(platform_size=[1, 1, 1e200]), "platform_size: found 1e+200 m"),
        (dict(inertia=[1e-16] * 3), "inertia: found a moment of 1e-16 kg m², expected 1e-14 to 1e+24 kg m²"),
        (dict(inertia=[1e200] * 3), "inertia: found 1e+200 kg m²"),
        (dict(frame=[[0, 0, 0], [1e300, 1, 1]]), "frame: found 1e+300 m"),
        (dict(workspace=[[0, 0, 0], [1, 1, 1e300]]), "workspace: found 1e+300 m"),
        (dict(exits=["no"] * 100_000), "exits: found ['no', 'no', 'no', 'no', 'no', 'no', ...], expected numbers"),
        (dict(exits=np.zeros((100_000, 3))), "exits: found 100000 cables, expected at most 1000"),
        (dict(mobility="x" * 10_000), "unknown mobility 'xxx"),
        (dict(pulley_axis=[1e300, 1e300, 1]), "pulley_axis: found 1e+300 in cable 1, expected -1e+06 to 1e+06"),
        (dict(pulley_radius=1e300), "pulley_radius: found 1e+300 m, expected at most 1e+06 m"),
        (dict(linear_density=1e300), "linear_density: found 1e+300 kg/m in cable 1, expected 0 to 100000 kg/m"),
        (dict(stiffening=(1e300, 1e300)), "stiffening: found 1e+300 in cable 1, expected -1e+09 to 1e+09"),
    ],
)
def test_what_no_robot_can_be_is_refused_with_the_sensible_range(changes, words):
    """In one sentence that never quotes a whole array."""
    with pytest.raises(cdpr.CdprError, match=re.escape(words)) as refused:
        cdpr.Robot(**(SOUND | changes))
    sentence(refused.value)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("a = " + "[" * 900 + "]" * 900, "found brackets nested too deeply"),
        ("a = " + "9" * 5000, "found an integer of thousands of digits"),
        ("name = 'a\\u0000b'\n".replace("'", '"') + FILE.lstrip().partition("\n")[2] + CABLES, "name: found"),
        (FILE.replace("2.0", "1e-12") + CABLES, "mass: found 1e-12 kg"),
        (FILE.replace("2.0", "[" * 40 + "1" + "]" * 40) + CABLES, "platform.mass: found [[[[[["),
        (FILE.replace("1e4", "1e-320") + CABLES, "axial_stiffness: found"),
        (FILE + CABLES.replace("1.0", "1e308"), "exits: found"),
        (FILE + CABLES.replace("anchor = [0.1, 0.1, 0.1]", "anchor = [0.1, 0.1]"), "cable 3: anchor.z: missing"),
        (FILE + CABLES + "k" * 5000 + " = 1\n", "cable 4: kkkk"),
        (FILE.replace("mine", "../../x") + CABLES, "name: found '../../x', expected a name without /"),
    ],
    ids=["brackets", "digits", "nul", "mass", "nested", "stiffness", "far", "cable", "key", "name"],
)
def test_a_robot_file_that_cannot_be_is_refused_in_one_sentence(tmp_path, text, words):
    """Whatever is in it."""
    path = tmp_path / "mine.toml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(cdpr.RobotFileError, match=re.escape(words)) as refused:
        cdpr.load_robot(path)
    assert len(sentence(refused.value).removeprefix(str(path))) < 250


@pytest.mark.parametrize(
    "row", ["[[cables]]\nexit = [0.0, 0.0, 1.0]\nanchor = [0.0, 0.0, 0.0]\n", "{exit=[0,0,0],anchor=[0,0,0]},"]
)
def test_a_hundred_thousand_cables_are_refused_at_once(tmp_path, row):
    """By the size of the file, or by the count before each is looked at; it took 16 s."""
    for count in (100_000, 2_000):
        cables = row * count if row[0] == "[" else f"cables = [{row * count}]\n"
        text = cables + FILE if row[0] == "{" else FILE + cables
        path = tmp_path / "mine.toml"
        path.write_text(text)
        began = time.process_time()
        with pytest.raises(
            cdpr.RobotFileError, match=r"found more than 1 MB|cables: found 2000, expected at most 1000"
        ):
            cdpr.load_robot(path)
        assert time.process_time() - began < 1.0


def test_a_device_is_no_robot_file(tmp_path):
    """Not even under a good name."""
    path = tmp_path / "endless.toml"
    path.symlink_to("/dev/zero")
    with pytest.raises(cdpr.RobotFileError, match="found a device, expected a file"):
        cdpr.load_robot(path)


@pytest.mark.parametrize(
    "value",
    [
        list(range(10**6)),
        np.zeros((1000, 1000)),
        "x" * 10**6,
        10**5000,
        {i: i for i in range(10**5)},
        [[[1] * 99] * 99] * 99,
    ],
    ids=["list", "array", "text", "number", "table", "nested"],
)
def test_what_a_message_quotes_is_short(value):
    """Lists, arrays, texts, numbers, tables."""
    assert len(checks.shown(value)) < 250


MILLIMETRES = {name: 1e3 * np.array(SOUND[name]) for name in ("exits", "anchors")}


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        (MILLIMETRES, "found a frame of 3464 m across; are its lengths in millimetres?"),
        (
            {k: 1e2 * np.array(SOUND[k]) for k in ("exits", "anchors")} | dict(mass=0.01),
            "are its lengths in millimetres?",
        ),
        (dict(platform_size=[5, 5, 5]), "found a platform of 5 × 5 × 5 m in a frame of 2 × 2 × 2 m"),
        (dict(platform_size=[0.01] * 3), "found the anchor of cable 1 0.165 m outside the platform's box"),
        (
            dict(workspace=[[200, 200, 500], [300, 300, 900]]),
            "found a workspace around (250, 250, 700) m, outside the frame",
        ),
        (dict(axial_stiffness=10.0), "found cables that stretch by 49% or more under a weight of 19.62 N"),
        (dict(anchors=np.zeros((4, 3)), platform_size=[0.1] * 3), "found all anchors in one point"),
    ],
    ids=["frame", "density", "platform", "anchor", "workspace", "strain", "point"],
)
def test_an_implausible_robot_is_warned_of_where_it_is_made(changes, words):
    """One line that says the robot's name, the number and what may be wrong; it is made all the same."""
    with pytest.warns(cdpr.ImplausibleRobot, match=re.escape(words)) as told:
        robot = cdpr.Robot(**(SOUND | changes), name="odd")
    assert all(str(one.message).startswith("odd: ") and "\n" not in str(one.message) for one in told)
    assert told[0].filename == __file__
    assert any(words in doubt for doubt in robot.warnings)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        robot.replace(name="copy")  # what is odd about it has been said


def test_the_catalogue_and_a_sound_robot_are_not_warned_of():
    """A warning that is always there is read by nobody."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        cdpr.Robot(**SOUND)
        for name in cdpr.list_robots():
            assert not cdpr.load_robot(name).warnings


INSIDE, BESIDE = (0, 0, 1), (5, 5, 1)
"""[m] Of the robot "ipanema-2", whose frame is 8 × 6 × 5 m: the second hangs 0.7 m below the floor."""


@pytest.mark.parametrize(
    "ask",
    [
        lambda robot: cdpr.solve(robot, BESIDE),
        lambda robot: cdpr.settle(robot, BESIDE),
        lambda robot: cdpr.solve_many(robot, [INSIDE, BESIDE]),
        lambda robot: cdpr.solve(robot, (400, 250, 0.1)),
        lambda robot: Cases.of(robot, [INSIDE, BESIDE]),
    ],
    ids=["solve", "settle", "many", "millimetres", "layouts"],
)
def test_a_pose_outside_the_frame_is_warned_of_where_it_is_asked(ask, catalogue):
    """By one line, whatever is asked: both methods find an equilibrium, and agree on it."""
    with pytest.warns(cdpr.ImplausibleRobot, match="ipanema-2: found a commanded position beside or above") as told:
        ask(catalogue["ipanema-2"])
    assert {str(one.message) for one in told} == {str(told[0].message)}
    assert "from (-4, -3, 0) to (4, 3, 5) m" in str(told[0].message)


def test_poses_in_and_near_the_frame_are_not_warned_of(catalogue):
    """In the workspace of every robot, on the frame's corners, deep below it; nor where lengths are given for it."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for robot in catalogue.values():
            cdpr.Problems.of(robot, robot.workspace)
            inside = robot.frame * ([1, 0, 1] if robot.mobility == "planar" else 1)
            cdpr.Problems.of(robot, np.vstack([inside, inside[:1] - [0, 0, 10]]))
        robot = catalogue["ipanema-2"]
        cdpr.Problem.of(robot, BESIDE, robot.rest_lengths(INSIDE))


@pytest.mark.parametrize(("diameter", "warned"), [(1.5, True), (0.046, False)])
def test_a_rope_of_metres_is_warned_of(diameter, warned, tmp_path):
    """By its name, in a robot file by material and by modulus; the ropes of the FAST telescope, 46 mm, are not."""
    path = tmp_path / "mine.toml"

    def given(*lines: str) -> cdpr.Robot:
        own = [*lines, f"diameter = {diameter}"]
        path.write_text(FILE.replace("axial_stiffness = 1e4", "\n".join(own)) + CABLES)
        return cdpr.load_robot(path)

    for ask in (
        lambda: cdpr.ROPES["dyneema"].of(diameter),
        lambda: cdpr.Robot(**SOUND).replace(material=f"dyneema-{1e3 * diameter:g}mm"),
        lambda: given('material = "dyneema"'),
        lambda: given("modulus = 1e9"),
    ):
        with warnings.catch_warnings(record=True) as told:
            warnings.simplefilter("always")
            ask()
        about = [str(one.message) for one in told if "diameter" in str(one.message)]
        assert bool(about) == warned
        assert set(about) <= {"found a rope of 1.5 m in diameter; is it in millimetres?"}


def test_a_file_in_millimetres_is_the_robot_in_metres(tmp_path, catalogue):
    """To the last bit, with ``units = "mm"``; without it, the warning asks."""
    robot = catalogue["parallel"]
    mm = lambda row: [float(f"{1e3 * x:.10g}") for x in row]  # noqa: E731
    text = f"""
name = "parallel"
units = "mm"
axial_stiffness = 1e4
[platform]
mass = 0.4
size = {mm(robot.platform_size)}
center_of_mass = [0.0, 0.0, 5.0]
[frame]
lower = {mm(robot.frame[0])}
upper = {mm(robot.frame[1])}
[workspace]
lower = {mm(robot.workspace[0])}
upper = {mm(robot.workspace[1])}
"""
    for exit, anchor in zip(robot.exits, robot.anchors, strict=True):
        text += f"[[cables]]\nexit = {mm(exit)}\nanchor = {mm(anchor)}\npulley = {{radius = 20.0, axis = [0, 0, 1]}}\n"
    path = tmp_path / "mm.toml"
    path.write_text(text)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        read = cdpr.load_robot(path)
    for name in ("exits", "anchors", "platform_size", "frame", "workspace"):
        np.testing.assert_array_equal(getattr(read, name), getattr(robot, name), err_msg=name)
    assert read.center_of_mass.tolist() == [0, 0, 0.005]
    assert read.cabling.pulley_radius.tolist() == [0.02] * 8
    path.write_text(text.replace('units = "mm"', ""))
    with pytest.warns(cdpr.ImplausibleRobot, match="millimetres"):
        cdpr.load_robot(path)
    path.write_text(text.replace('"mm"', '"inch"'))
    with pytest.raises(cdpr.RobotFileError, match=re.escape("units: found 'inch', expected 'm' or 'mm'")):
        cdpr.load_robot(path)

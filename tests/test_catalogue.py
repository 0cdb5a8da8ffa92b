import re

import numpy as np
import pytest

import cdpr_sim as cdpr
from cdpr_sim.robots.catalogue import PAPER_ROBOTS

MINE = """
name = "mine"
axial_stiffness = 2000.0
[platform]
mass = 1.5
size = [0.2, 0.1, 0.1]
[[cables]]
exit = [0, 0, 1]
anchor = [0, 0, 0.05]
[[cables]]
exit = [1, 0, 1]
anchor = [0.1, 0, 0.05]
material = "fishing-0.4mm"
"""


TABLE_II = {
    "cogiro": """
        A1 .08 .04 .485  B1  .04   -.03   .018      A5 .72 .46 .485  B5 -.04    .03   .018
        A2 .04 .08 .485  B2 -.0515  .022 -.018      A6 .76 .42 .485  B6  .0515 -.022 -.018
        A3 .04 .42 .485  B3 -.0515 -.022  .018      A7 .76 .08 .485  B7  .0515  .022  .018
        A4 .08 .04 .485  B4  .04    .03  -.018      A8 .72 .04 .485  B8 -.04   -.03  -.018
    """,
    "parallel": """
        A1 .04 .04 .486  B1 -.0515 -.022  .018      A5 .76 .46 .486  B5  .0515  .022  .018
        A2 .04 .04 .450  B2 -.0515 -.022 -.018      A6 .76 .46 .450  B6  .0515  .022 -.018
        A3 .04 .46 .486  B3 -.0515  .022  .018      A7 .76 .04 .486  B7  .0515 -.022  .018
        A4 .04 .46 .450  B4 -.0515  .022 -.018      A8 .76 .04 .450  B8  .0515 -.022 -.018
    """,
}
"""The paper's Table II as it is printed [m]: exits A_i in the base frame, anchors B_i in the platform frame."""

ERRATUM = {"cogiro": (3, [0.08, 0.46, 0.485])}
"""The paper prints A4 of the Cogiro layout as (.08, .04, .485), a repeat of A1. The layout is symmetric under a half
turn about the vertical through (.4, .25), which takes A1 to A5, A2 to A6 and A3 to A7, and B likewise; so A4 is the
image of A8 = (.72, .04, .485)."""


def test_catalogue_has_the_papers_five_robots():
    """The names that others rely on, among all that have a file."""
    assert PAPER_ROBOTS == ("cogiro", "parallel", "planar-horizontal", "planar-vertical", "two-cable")
    assert set(PAPER_ROBOTS) <= set(cdpr.list_robots())


def printed(table: str) -> tuple[np.ndarray, np.ndarray]:
    """Exits and anchors of a table, in order, (8, 3) each."""
    rows = {name: [float(x) for x in xyz.split()] for name, xyz in re.findall(r"([AB]\d)([-. \d]+)", table)}
    return tuple(np.array([rows[f"{letter}{i}"] for i in range(1, 9)]) for letter in "AB")


@pytest.mark.parametrize("name", sorted(TABLE_II))
def test_the_catalogue_has_the_papers_numbers(name):
    """Every exit and anchor of Table II, to the last digit, but for the one that is misprinted."""
    exits, anchors = printed(TABLE_II[name])
    if name in ERRATUM:
        cable, mended = ERRATUM[name]
        np.testing.assert_array_equal(exits[cable], exits[0])  # as printed: a repeat of A1
        exits[cable] = mended
    robot = cdpr.load_robot(name)
    np.testing.assert_array_equal(robot.exits, exits)
    np.testing.assert_array_equal(robot.anchors, anchors)


def test_robots_without_a_table_are_what_their_descriptions_say():
    """Fig. 6b: exits a platform width apart, anchors at the ends of the top edge. Fig. 2: the frame's upper corners."""
    horizontal, pair = cdpr.load_robot("planar-horizontal"), cdpr.load_robot("two-cable")
    width, _, height = [0.103, 0.044, 0.036]  # between Table II's anchors
    np.testing.assert_array_equal(horizontal.exits[:, 2], 0.486)
    np.testing.assert_allclose(horizontal.exits[:, 0], [0.04, 0.04 + width, 0.76 - width, 0.76], rtol=1e-15)
    np.testing.assert_allclose(
        horizontal.anchors[:, [0, 2]], [[side * width / 2, height / 2] for side in (-1, 1, -1, 1)], rtol=1e-15
    )
    np.testing.assert_array_equal(pair.exits, [[0, 0, 0.5], [0.8, 0, 0.5]])
    np.testing.assert_allclose(pair.anchors, [[-0.051, 0, 0], [0.051, 0, 0]], rtol=1e-15)


def test_planar_vertical_is_the_projection_of_parallel():
    """Fig. 6a has no table: its cables are those of `parallel`, seen along y."""
    spatial, planar = cdpr.load_robot("parallel"), cdpr.load_robot("planar-vertical")

    def seen(robot):
        return {tuple(row) for row in np.hstack([robot.exits, robot.anchors])[:, [0, 2, 3, 5]].tolist()}

    assert seen(planar) == seen(spatial)


def test_demobot_is_the_papers(catalogue):
    """0.4 kg, a platform of 102 x 44 x 36 mm, a frame 0.8 m wide and 0.5 m high, Vectran: all five."""
    for robot in (catalogue[name] for name in PAPER_ROBOTS):
        assert robot.mass == 0.4
        np.testing.assert_array_equal(robot.platform_size, [0.102, 0.044, 0.036])
        np.testing.assert_array_equal(np.ptp(robot.frame, axis=0)[[0, 2]], [0.8, 0.5])
        assert robot.material == "vectran-0.7mm"
        assert (robot.axial_stiffness == 10e3).all()
    for name in TABLE_II:
        np.testing.assert_array_equal(catalogue[name].frame, [[0, 0, 0], [0.8, 0.5, 0.5]])


def test_robot_of_ones_own_is_read_from_a_file(tmp_path):
    """A cable's own material goes before the robot's stiffness."""
    file = tmp_path / "mine.toml"
    file.write_text(MINE)
    robot = cdpr.load_robot(file)
    assert robot.name == "mine"
    np.testing.assert_array_equal(robot.axial_stiffness, [2000.0, 1000.0])


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (("mass = 1.5", "mass = 'heavy'"), "platform.mass: found 'heavy'"),
        (("mass = 1.5", "mass = '1.5'"), "platform.mass: found '1.5', expected a number"),
        (("mass = 1.5", "mass = true"), "platform.mass: found True, expected a number"),
        (("mass = 1.5", "mas = 1.5"), "platform.mas: unknown key, did you mean 'mass'"),
        (("mass = 1.5", "mass = nan"), "platform.mass: found nan"),
        (("mass = 1.5", "mass = -1.5"), "mass: found -1.5 kg, expected more than 0"),
        (("exit = [0, 0, 1]", "exit = [0, 0]"), "cable 1: exit.z: missing"),
        (("exit = [0, 0, 1]\n", ""), "cable 1: exit: missing"),
        (("name =", "name"), "is not TOML"),
        (("axial_stiffness = 2000.0", ""), "cable 1: found neither material nor axial_stiffness"),
        (("fishing-0.4mm", "fishing"), "unknown material 'fishing': did you mean fishing-0.4mm"),
        (("exit = [0, 0, 1]", "exit = [0, 0, 1]\ncolour = 1"), "cable 1: colour: unknown key"),
    ],
)
def test_wrong_file_is_refused_with_the_path_inside_it(tmp_path, change, words):
    """The message names the file, the key, what was found and what is expected."""
    file = tmp_path / "mine.toml"
    assert change[0] in MINE
    file.write_text(MINE.replace(*change))
    with pytest.raises(cdpr.RobotFileError, match=words) as error:
        cdpr.load_robot(file)
    assert str(error.value).startswith(str(file))
    assert "\n" not in str(error.value)


def test_missing_file_and_unknown_name_are_told_apart(tmp_path, monkeypatch):
    """A path is looked up as a file; a name in the catalogue, and a file that is called so is named."""
    monkeypatch.chdir(tmp_path)
    with pytest.raises(cdpr.RobotFileError, match="no such file"):
        cdpr.load_robot("nowhere.toml")
    with pytest.raises(cdpr.UnknownName, match="did you mean parallel"):
        cdpr.load_robot("paralel")
    with pytest.raises(cdpr.UnknownName, match=r"did you mean cogiro\b"):
        cdpr.load_robot("COGIRO")
    (tmp_path / "six.toml").write_text(MINE)
    with pytest.raises(cdpr.UnknownName, match=r"unknown robot 'six': did you mean six\.toml\? known: acrobot"):
        cdpr.load_robot("six")
    for name in ("x" * 10_000, "a\0b", "\ud800"):  # no names of files
        with pytest.raises(cdpr.UnknownName, match="unknown robot"):
            cdpr.load_robot(name)

import numpy as np
import pytest

import cdpr_sim as cdpr

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


def test_catalogue_has_the_five_robots():
    """The names that others rely on."""
    assert cdpr.list_robots() == ("cogiro", "parallel", "planar-horizontal", "planar-vertical", "two-cable")


def test_cogiro_is_symmetric_under_a_half_turn():
    """The paper prints A4 as a repeat of A1; the half turn about (0.4, 0.25) that the layout has mends it."""
    robot = cdpr.load_robot("cogiro")
    image = [4, 5, 6, 7, 0, 1, 2, 3]
    half_turn = np.array([-1, -1, 1])
    np.testing.assert_allclose(robot.exits[image], robot.exits * half_turn + [0.8, 0.5, 0], atol=1e-15)
    np.testing.assert_array_equal(robot.anchors[image], robot.anchors * half_turn)


def test_planar_vertical_is_the_projection_of_parallel():
    """Fig. 6a has no table: its cables are those of `parallel`, seen along y."""
    spatial, planar = cdpr.load_robot("parallel"), cdpr.load_robot("planar-vertical")

    def seen(robot):
        return {tuple(row) for row in np.hstack([robot.exits, robot.anchors])[:, [0, 2, 3, 5]].tolist()}

    assert seen(planar) == seen(spatial)


def test_demobot_is_the_papers(catalogue):
    """Mass 0.4 kg and a platform of 102 x 44 x 36 mm, for every robot of the catalogue."""
    for robot in catalogue.values():
        assert robot.mass == 0.4
        np.testing.assert_array_equal(robot.platform_size, [0.102, 0.044, 0.036])


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
        (("mass = 1.5", "mass = '1.5'"), "platform.mass: found '1.5': Input should be a valid number"),
        (("mass = 1.5", "mass = true"), "platform.mass: found True: Input should be a valid number"),
        (("mass = 1.5", "mas = 1.5"), "platform.mas: unknown key, did you mean 'mass'"),
        (("mass = 1.5", "mass = nan"), "platform.mass: found nan"),
        (("mass = 1.5", "mass = -1.5"), "mass: found -1.5 kg, expected more than 0"),
        (("exit = [0, 0, 1]", "exit = [0, 0]"), "cables.0.exit.2: missing"),
        (("exit = [0, 0, 1]\n", ""), "cables.0.exit: missing"),
        (("name =", "name"), "is not TOML"),
        (("axial_stiffness = 2000.0", ""), "cables.0: found neither material nor axial_stiffness"),
        (("fishing-0.4mm", "fishing"), "unknown material 'fishing': did you mean fishing-0.4mm"),
        (("exit = [0, 0, 1]", "exit = [0, 0, 1]\ncolour = 1"), "cables.0.colour: unknown key"),
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


def test_missing_file_and_unknown_name_are_told_apart():
    """A path is looked up as a file; a name in the catalogue."""
    with pytest.raises(cdpr.RobotFileError, match="no such file"):
        cdpr.load_robot("nowhere.toml")
    with pytest.raises(cdpr.UnknownName, match="did you mean parallel"):
        cdpr.load_robot("paralel")

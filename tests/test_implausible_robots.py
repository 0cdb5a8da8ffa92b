"""Robots and poses that are hardly meant are warned of once, where they are made or asked; others never are."""

import re
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from test_refusals_motion import CABLES, FILE, SOUND, made

import cdpr_sim as cdpr
from cdpr_sim.design.layout_equilibria import Cases

POINTS = {name: np.array(SOUND[name]) for name in ("exits", "anchors")}

IMPLAUSIBLE: dict[str, tuple[dict[str, Any], str]] = {
    "frame": (
        {name: 1e3 * one for name, one in POINTS.items()},
        "found a frame of 3464 m across; are its lengths in millimetres?",
    ),
    "density": ({name: 1e2 * one for name, one in POINTS.items()} | {"mass": 0.01}, "lengths in millimetres?"),
    "platform": ({"platform_size": [5, 5, 5]}, "found a platform of 5 × 5 × 5 m in a frame of 2 × 2 × 2 m"),
    "anchor": ({"platform_size": [0.01] * 3}, "the anchor of cable 1 0.165 m outside the platform's box"),
    "workspace": (
        {"workspace": [[200, 200, 500], [300, 300, 900]]},
        "found a workspace around (250, 250, 700) m, outside the frame",
    ),
    "strain": ({"axial_stiffness": 10.0}, "cables that stretch by 49% or more under a weight of 19.62 N"),
    "point": ({"anchors": np.zeros((4, 3)), "platform_size": [0.1] * 3}, "found all anchors in one point"),
}


@pytest.mark.parametrize(("changes", "words"), IMPLAUSIBLE.values(), ids=IMPLAUSIBLE)
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


INSIDE, BESIDE = (0, 0, 1), (5, 5, 1)
"""[m] Of the robot "ipanema-2", whose frame is 8 × 6 × 5 m: the second hangs 0.7 m below the floor."""

ASK = {
    "solve": lambda robot: cdpr.solve(robot, BESIDE),
    "settle": lambda robot: cdpr.settle(robot, BESIDE),
    "many": lambda robot: cdpr.solve_many(robot, [INSIDE, BESIDE]),
    "millimetres": lambda robot: cdpr.solve(robot, (400, 250, 0.1)),
    "layouts": lambda robot: Cases.of(robot, [INSIDE, BESIDE]),
}


@pytest.mark.parametrize("ask", ASK.values(), ids=ASK)
def test_a_pose_outside_the_frame_is_warned_of_where_it_is_asked(ask, catalogue):
    """By one line, whatever is asked: both methods find an equilibrium, and agree on it."""
    with pytest.warns(cdpr.ImplausibleRobot, match="ipanema-2: found a commanded position beside or above") as told:
        ask(catalogue["ipanema-2"])
    assert {str(one.message) for one in told} == {str(told[0].message)}
    assert "from (-4, -3, 0) to (4, 3, 5) m" in str(told[0].message)


def test_robots_and_poses_that_are_meant_are_not_warned_of(catalogue):
    """The catalogue; poses in workspaces, on the frames' corners, deep below; nor where lengths are given for it."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        made()
        for robot in catalogue.values():
            assert not robot.warnings
            cdpr.Problems.of(robot, robot.workspace)
            inside = robot.frame * ([1, 0, 1] if robot.mobility == "planar" else 1)
            cdpr.Problems.of(robot, np.vstack([inside, inside[:1] - [0, 0, 10]]))
        robot = catalogue["ipanema-2"]
        cdpr.Problem.of(robot, BESIDE, robot.rest_lengths(INSIDE))


def from_file(folder: Path, text: str) -> cdpr.Robot:
    (folder / "mine.toml").write_text(text, encoding="utf-8")
    return cdpr.load_robot(folder / "mine.toml")


@pytest.mark.parametrize(
    ("diameter", "told"), [(1.5, ["found a rope of 1.5 m in diameter; is it in millimetres?"]), (0.046, [])]
)
@pytest.mark.parametrize("given", ["name", "replaced", 'material = "dyneema"', "modulus = 1e9"])
def test_a_rope_of_metres_is_warned_of(diameter, told, given, tmp_path):
    """By its name, in a robot file by material and by modulus; the ropes of the FAST telescope, 46 mm, are not."""
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        if given == "name":
            cdpr.ROPES["dyneema"].of(diameter)
        elif given == "replaced":
            made().replace(material=f"dyneema-{1e3 * diameter:g}mm")
        else:
            from_file(tmp_path, FILE.replace("axial_stiffness = 1e4", f"{given}\ndiameter = {diameter}") + CABLES)
    assert sorted({str(one.message) for one in said if "diameter" in str(one.message)}) == told


def test_a_file_in_millimetres_is_the_robot_in_metres(tmp_path):
    """To the last bit, with ``units = "mm"``; without it, the warning asks."""
    own = "center_of_mass = [0.0, 0.0, 0.005]\n[frame]\nlower = [-1, -1, 0]\nupper = [1, 1, 2]\n[workspace]\n"
    own += "lower = [-0.2, -0.2, 0.5]\nupper = [0.2, 0.2, 0.9]\n"
    metres = FILE + own + CABLES.replace("anchor", "pulley = {radius = 0.02, axis = [0, 0, 1]}\nanchor")
    scaled = re.sub(r"(?<!axis = )(?<=[\[ ])-?[\d.]+(?=[,\]])", lambda x: f"{1e3 * float(x[0]):.10g}", metres)
    scaled = scaled.replace("axis = [0, 0, 1000]", "axis = [0, 0, 1]")
    one, other = from_file(tmp_path, metres), from_file(tmp_path, 'units = "mm"\n' + scaled)
    for name in ("exits", "anchors", "platform_size", "frame", "workspace", "center_of_mass", "pulley_radius"):
        np.testing.assert_array_equal(getattr(other, name), getattr(one, name), err_msg=name)
    assert (one.mass, one.axial_stiffness.tolist()) == (other.mass, other.axial_stiffness.tolist())
    with pytest.warns(cdpr.ImplausibleRobot, match="millimetres"):
        from_file(tmp_path, scaled)

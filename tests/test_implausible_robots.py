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


@pytest.mark.parametrize(("diameter", "warned"), [(1.5, True), (0.046, False)])
def test_a_rope_of_metres_is_warned_of(diameter, warned, tmp_path):
    """By its name, in a robot file by material and by modulus; the ropes of the FAST telescope, 46 mm, are not."""

    def given(line: str) -> cdpr.Robot:
        return from_file(tmp_path, FILE.replace("axial_stiffness = 1e4", f"{line}\ndiameter = {diameter}") + CABLES)

    for ask in (
        lambda: cdpr.ROPES["dyneema"].of(diameter),
        lambda: made().replace(material=f"dyneema-{1e3 * diameter:g}mm"),
        lambda: given('material = "dyneema"'),
        lambda: given("modulus = 1e9"),
    ):
        with warnings.catch_warnings(record=True) as told:
            warnings.simplefilter("always")
            ask()
        about = {str(one.message) for one in told if "diameter" in str(one.message)}
        assert about == ({"found a rope of 1.5 m in diameter; is it in millimetres?"} if warned else set())


def test_a_file_in_millimetres_is_the_robot_in_metres(tmp_path, catalogue):
    """To the last bit, with ``units = "mm"``; without it, the warning asks."""
    robot = catalogue["parallel"]
    mm = lambda row: [float(f"{1e3 * x:.10g}") for x in row]  # noqa: E731
    text = 'name = "parallel"\nunits = "mm"\naxial_stiffness = 1e4\n'
    text += f"[platform]\nmass = 0.4\nsize = {mm(robot.platform_size)}\ncenter_of_mass = [0.0, 0.0, 5.0]\n"
    for name in ("frame", "workspace"):
        lower, upper = getattr(robot, name)
        text += f"[{name}]\nlower = {mm(lower)}\nupper = {mm(upper)}\n"
    for exit, anchor in zip(robot.exits, robot.anchors, strict=True):
        text += f"[[cables]]\nexit = {mm(exit)}\nanchor = {mm(anchor)}\npulley = {{radius = 20.0, axis = [0, 0, 1]}}\n"
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        read = from_file(tmp_path, text)
    for name in ("exits", "anchors", "platform_size", "frame", "workspace"):
        np.testing.assert_array_equal(getattr(read, name), getattr(robot, name), err_msg=name)
    assert read.center_of_mass.tolist() == [0, 0, 0.005]
    assert read.cabling.pulley_radius.tolist() == [0.02] * 8
    with pytest.warns(cdpr.ImplausibleRobot, match="millimetres"):
        from_file(tmp_path, text.replace('units = "mm"', ""))

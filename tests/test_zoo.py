"""The zoo: every robot file there is, solved, settled and compared; what follows from the folder follows."""

from pathlib import Path

import numpy as np
import pytest
from inputs import run
from matplotlib import image

import cdpr_sim as cdpr
from cdpr_sim.drawing.still import stamp_of
from check_zoo import PRETENSION_STRAIN, check_robot

MODELS = Path(__file__).parents[1] / "models"

NAMES = cdpr.list_robots()

POSES = 3
"""Random ones per robot; ``scripts/research/check_zoo.py`` takes 200."""


@pytest.mark.parametrize("name", NAMES)
def test_both_methods_agree_over_the_workspace(name):
    """Pose, tensions and slack cables; on a fully constrained robot also with cables a thousandth shorter.

    Cables from below then pull, at the middle of the workspace as well, and more.
    """
    robot = cdpr.load_robot(name)
    found = check_robot(robot, POSES)
    assert found.agreeing == POSES, found.verdicts
    assert found.tension > 0
    if robot.kind == "fully constrained":
        tight = check_robot(robot, POSES, PRETENSION_STRAIN)
        assert tight.agreeing == POSES, tight.verdicts
        assert tight.tension > found.tension
        lengths = (1 - PRETENSION_STRAIN) * robot.rest_lengths(robot.home)
        static = cdpr.solve(robot, robot.home, lengths)
        assert cdpr.compare(static, cdpr.settle(robot, robot.home, lengths)).agrees
        assert not static.slack.any()


def test_kinds_are_what_they_are_called():
    """By their cables: fewer than freedoms, all from above, or some from below."""
    kinds = {name: cdpr.load_robot(name).kind for name in NAMES}
    assert {kinds[name] for name in ("cogiro", "cogiro-crane", "nist-robocrane", "caroca")} == {"suspended"}
    assert {kinds[name] for name in ("ipanema-1", "falcon-7", "segesta", "macarm")} == {"fully constrained"}
    assert {kinds[name] for name in ("two-cable", "irma4u", "grab-3")} == {"under-actuated"}
    robot = cdpr.load_robot("cogiro")
    assert robot.replace(anchors=robot.anchors + np.array([0, 0, 1])).kind == "fully constrained"


def test_every_robot_says_where_its_numbers_come_from_and_is_in_the_lists():
    """A source and a description; a workspace within the frame; no warning; under its kind, printed and in models/."""
    assert {path.name for path in MODELS.iterdir()} == {
        *NAMES,
        "README.md",
        "robots.png",
    }
    printed, index = run("robots").stdout, (MODELS / "README.md").read_text(encoding="utf-8")
    for name in NAMES:
        robot = cdpr.load_robot(name)
        assert robot.name == name
        assert len(robot.source) > 20
        assert robot.description
        assert robot.warnings == ()
        lower, upper = robot.frame
        assert ((lower <= robot.workspace) & (robot.workspace <= upper)).all()
        assert f"[{name}]({name})" in index.partition(f"## {robot.kind.capitalize()}\n")[2].partition("\n## ")[0]
        assert f" {name} " in printed.partition(f"Robots: {robot.kind}")[2]


def test_every_model_has_its_picture():
    """Small ones, with something in them, each stamped with what it was drawn from."""
    pictures = [*(MODELS / name / "robot.png" for name in NAMES), MODELS / "robots.png"]
    assert len({stamp_of(picture) for picture in pictures} - {None}) == len(NAMES) + 1
    assert max(picture.stat().st_size for picture in pictures) < 100_000
    assert (image.imread(MODELS / "robots.png")[..., :3].min(-1) < 0.9).mean() > 0.02
    assert run("models", "ipanema-1", "--winches", "-o", str(MODELS), "--check").exit_code == 0


def test_a_page_shows_all_robots(tmp_path):
    """Of those that are named; at no pose, which would be that of one."""
    assert run("show", "cogiro", "two-cable", "-o", str(tmp_path / "two.png")).exit_code == 0
    refused = run("show", "cogiro", "two-cable", "--pose", "1", "1", "1", "-o", str(tmp_path / "none.png"))
    assert (refused.exit_code, "found a pose and several robots" in refused.stderr) == (2, True)

"""The zoo: every robot file there is, solved, settled and compared; what follows from the folder follows."""

from pathlib import Path

import numpy as np
import pytest
from inputs import run
from matplotlib import image

import cdpr_sim as cdpr
from cdpr_sim.crosscheck.compare import Verdict
from cdpr_sim.drawing.still import stamp_of
from studies.zoo_check import PRETENSION_STRAIN, check_robot

MODELS = Path(__file__).parents[1] / "models"

NAMES = cdpr.list_robots()

CONSTRAINED = [name for name in NAMES if cdpr.load_robot(name).kind == "fully constrained"]

POSES = 3
"""Random ones per robot; ``scripts/check_zoo.py`` takes 200."""


@pytest.mark.parametrize("name", NAMES)
def test_both_methods_agree_over_the_workspace(name):
    """At the rest lengths of the commanded poses: pose, tensions and slack cables."""
    found = check_robot(cdpr.load_robot(name), POSES)
    assert found.agreeing == POSES, found.verdicts
    assert found.tension > 0


@pytest.mark.parametrize("name", CONSTRAINED)
def test_both_methods_agree_where_all_cables_are_drawn_in(name):
    """Shorter by a thousandth: cables from below then pull, at the middle of the workspace as well, and more."""
    robot = cdpr.load_robot(name)
    slack, tight = check_robot(robot, POSES), check_robot(robot, POSES, PRETENSION_STRAIN)
    assert tight.agreeing == POSES, tight.verdicts
    assert tight.tension > slack.tension
    lengths = (1 - PRETENSION_STRAIN) * robot.rest_lengths(robot.home)
    static, settled = cdpr.solve(robot, robot.home, lengths), cdpr.settle(robot, robot.home, lengths)
    assert cdpr.compare(static, settled).agrees
    assert not static.slack.any()


@pytest.mark.parametrize("name", ["cogiro-crane", "ipanema-2", "fast-like", "irma4u"])
def test_a_cable_one_per_cent_stiffer_is_noticed(name):
    """Negative control, over pulleys and with weight too: MuJoCo settles a robot with one such cable."""
    robot = cdpr.load_robot(name)
    wrong = robot.axial_stiffness.copy()
    wrong[0] *= 1.01
    lengths = (1 - PRETENSION_STRAIN) * robot.rest_lengths(robot.home)
    settled = cdpr.settle(robot.replace(axial_stiffness=wrong), robot.home, lengths)
    passed_off = type(settled)(**(vars(settled) | {"problem": cdpr.Problem.of(robot, robot.home, lengths)}))
    agreement = cdpr.compare(cdpr.solve(robot, robot.home, lengths), passed_off)
    assert agreement.verdict in (Verdict.DISAGREE, Verdict.DIFFERENT_EQUILIBRIA)


def test_kinds_are_what_they_are_called():
    """By their cables: fewer than freedoms, all from above, or some from below."""
    kinds = {name: cdpr.load_robot(name).kind for name in NAMES}
    assert {kinds[name] for name in ("cogiro", "cogiro-crane", "nist-robocrane", "caroca")} == {"suspended"}
    assert {kinds[name] for name in ("ipanema-1", "falcon-7", "segesta", "macarm")} == {"fully constrained"}
    assert {kinds[name] for name in ("two-cable", "irma4u", "grab-3")} == {"under-actuated"}
    robot = cdpr.load_robot("cogiro")
    upside_down = robot.replace(anchors=robot.anchors + np.array([0, 0, 1]))
    assert upside_down.kind == "fully constrained"


@pytest.mark.parametrize("name", NAMES)
def test_every_robot_says_where_its_numbers_come_from(name):
    """A source and a description; a workspace within the frame; nothing that looks like a mistake."""
    robot = cdpr.load_robot(name)
    assert robot.name == name
    assert len(robot.source) > 20
    assert robot.description
    assert robot.warnings == ()
    lower, upper = robot.frame
    assert ((lower <= robot.workspace) & (robot.workspace <= upper)).all()


def test_lists_follow_from_the_folder():
    """`cdpr-sim robots` and models/README.md have every robot, under its kind."""
    printed, index = run("robots").stdout, (MODELS / "README.md").read_text(encoding="utf-8")
    for name in NAMES:
        kind = cdpr.load_robot(name).kind
        assert f"[{name}]({name})" in index.partition(f"## {kind.capitalize()}\n")[2].partition("\n## ")[0]
        assert f" {name} " in printed.partition(f"Robots: {kind}")[2]


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

"""The zoo: every robot file there is, solved, settled and compared; what follows from the folder follows."""

import itertools
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest
from inputs import run
from matplotlib import image
from matplotlib.backends.backend_agg import FigureCanvasAgg
from sample_problems import grid

import cdpr_sim as cdpr
from cdpr_sim.crosscheck.compare import POSITION_TOLERANCE, TENSION_TOLERANCE, Verdict, compare_many
from cdpr_sim.drawing import still, style
from cdpr_sim.drawing.still import stamp_of
from cdpr_sim.drawing.video import raycast, scene
from cdpr_sim.robots.catalogue import PAPER_ROBOTS
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


@pytest.mark.slow
@pytest.mark.parametrize("material", ["vectran-0.7mm", "fishing-0.4mm"])
@pytest.mark.parametrize("name", PAPER_ROBOTS)
def test_methods_agree_at_a_thousand_poses_of_the_papers_robots(name, material):
    """Within the tolerances of the check; only on ``parallel`` platforms turn freely, about two diagonal cables."""
    robot = cdpr.load_robot(name).replace(material=material)
    problems = cdpr.Problems.of(robot, grid(robot, 1200))
    found = compare_many(cdpr.solve_many(problems), cdpr.settle_many(problems))
    assert len(problems) > 1000
    assert found.errors["position_error"].max() <= POSITION_TOLERANCE
    assert found.errors["tension_error"].max() <= TENSION_TOLERANCE
    assert all(found.agreement(row).agrees and found.agreement(row).same_slack for row in range(len(problems)))
    free = np.mean(found.verdicts == Verdict.AGREE_EXCEPT_NEUTRAL)
    assert 0 < free < 0.08 if name == "parallel" else free == 0


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
    assert max(picture.stat().st_size for picture in pictures[:-1]) < 100_000
    assert pictures[-1].stat().st_size < 5_000 * len(NAMES)
    assert (image.imread(MODELS / "robots.png")[..., :3].min(-1) < 0.9).mean() > 0.02
    assert run("models", "ipanema-1", "--winches", "-o", str(MODELS), "--check").exit_code == 0


def overlapping(name: str) -> int:
    """Pairs of numbers in the picture of a robot that overlap, with the letters' true size."""
    figure = cdpr.draw(cdpr.load_robot(name))
    figure.set_dpi(style.PNG_DPI)
    renderer, pairs = FigureCanvasAgg(figure).get_renderer(), []
    for ax in figure.axes:
        boxes = [text.get_window_extent(renderer) for text in ax.texts if text.get_text()[:1].isdigit()]
        assert len(boxes) >= 3
        pairs += itertools.combinations(boxes, 2)
    return sum(one.padded(-1).overlaps(other.padded(-1)) for one, other in pairs)


def test_numbers_of_cables_do_not_overlap(monkeypatch):
    """Exits of these robots are close to each other in the picture, or the same; control: letters without a size."""
    crowded = ["acrobot", "cogiro-crane-built", "falcon-7", "parallel", "segesta"]
    assert {name: overlapping(name) for name in crowded} == dict.fromkeys(crowded, 0)
    monkeypatch.setattr(still, "LETTER", 0.0)
    monkeypatch.setattr(still, "LINE", 0.0)
    assert sum(map(overlapping, crowded)) > 0


def test_a_still_shows_points_where_its_camera_sees_them():
    """Pixels that change without the platform lie around its projected middle, and not around that of a higher one."""
    robot = cdpr.load_robot("ipanema-2")
    stage = still._stage(robot, robot.pose(robot.home))
    camera, pictures = stage.whole(1.5), []
    for opaque in (1.0, 0.0):
        stage.model.geom("platform").rgba[3] = opaque
        stage.set(0)
        with closing(raycast.RayCaster(stage.model)) as caster:
            pictures.append(caster.start(stage.look(camera), 300, 200)().astype(int))
    rows, columns = np.nonzero(np.abs(pictures[0] - pictures[1]).max(-1) > 20)
    middle = np.array([columns.mean() - 149.5, 99.5 - rows.mean()]) / 100
    at, higher = scene.seen(camera, robot.home + np.array([[0, 0, 0], [0, 0, 0.5]]))
    assert np.abs(middle - at).max() < 0.03
    assert np.abs(middle - higher).max() > 0.1


def test_a_page_shows_all_robots(tmp_path):
    """Of those that are named; at no pose, which would be that of one."""
    assert run("show", "cogiro", "two-cable", "-o", str(tmp_path / "two.png")).exit_code == 0
    refused = run("show", "cogiro", "two-cable", "--pose", "1", "1", "1", "-o", str(tmp_path / "none.png"))
    assert (refused.exit_code, "found a pose and several robots" in refused.stderr) == (2, True)

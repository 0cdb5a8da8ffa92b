"""What cannot be drawn or written is refused in one sentence, before anything is computed, and nothing is written."""

import made_up
import numpy as np
import pytest
from drawn_figures import rests
from matplotlib.figure import Figure

import cdpr_sim as cdpr
import paper_figures
import robots_on_axes
from cdpr_sim.core.files import check_place
from cdpr_sim.drawing import maps
from cdpr_sim.drawing.video.scene import Stage

HEAVY = cdpr.load_robot("cogiro").replace(linear_density=0.0005)
AT_REST = cdpr.Trajectory.through(rests(1, HEAVY, [(0.3, 0.25, 0.1)] * 2), np.array([0.0, 1.0]))
UNSHAPED = "shapes: found none of cable 1, which has mass"


def film(name: str, **words) -> object:
    return cdpr.write_video(name, made_up.states(), **words)


def figures(name: str) -> object:
    return paper_figures.main(["agreement", name])


REFUSED = [
    (lambda: figures("paperline"), "unknown figure 'paperline': did you mean paper-line"),
    (lambda: figures("Fig. 10"), r"unknown figure 'Fig. 10': did you mean cogiro\? known: agreement"),
    (lambda: figures("figure 10"), r"unknown figure 'figure 10': did you mean cogiro\? known: agreement"),
    (lambda: figures("Fig. 1"), r"unknown figure 'Fig\. 1': known: agreement"),
    (lambda: check_place("map.bmp", maps.SUFFIXES, field="output"), "ends in"),
    (lambda: check_place("nowhere/map.png", maps.SUFFIXES, field="output"), "no folder"),
    (lambda: check_place("there.mp4", (".mp4",), field="output"), "exists"),
    (lambda: maps.draw_elastic_map(cdpr.sweep("cogiro", (3, 2, 2))), "expected a plane"),
    (lambda: maps.draw_elastic_map(cdpr.sweep("cogiro", (3, 1, 1))), "expected a plane"),
    (lambda: maps.draw_elastic_map(cdpr.sweep("cogiro", (2, 1, 2), quantities=["tilt"])), "no variable 'distance'"),
    (lambda: robots_on_axes.draw_cables(Figure().add_subplot(), HEAVY, np.zeros(3), np.eye(3), [False] * 8), UNSHAPED),
    (lambda: robots_on_axes.draw_pose(Figure().add_subplot(projection="3d"), AT_REST, 0), UNSHAPED),
    (lambda: Stage(AT_REST, largest_tension=2.0), UNSHAPED),
    (lambda: Stage(AT_REST, largest_tension=2, shapes=np.ones((1, 8, 3, 3))), "expected 2 states of 8 cables"),
    (lambda: cdpr.cable_profiles(AT_REST, points=1), "points: found 1"),
    (lambda: film("v.avi"), r"found the suffix '.avi', expected .mp4 or .gif"),
    (lambda: film("v"), "found no suffix"),
    (lambda: film("there.mp4"), "exists, expected a new place or --force"),
    (lambda: film("folder.mp4"), "found a folder"),
    (lambda: film("no/where.mp4"), "found no folder"),
    (lambda: film("v.mp4", seconds=0.0), "seconds: found 0 at 30 frames per second, expected 2 to"),
    (lambda: film("v.mp4", seconds=np.inf), "seconds: found inf"),
    (lambda: film("v.mp4", fps=0.0), "fps: found 0"),
    (lambda: film("v.mp4", size=(0, 480)), "size: found 0 x 480"),
    (lambda: film("v.mp4", size=(641, 480)), "size: found 641 x 480 pixels, expected even"),
    (lambda: film("v.mp4", size=(10**6, 480)), "size: found 1000000 x 480"),
    (lambda: film("v.mp4", exaggeration=0.0), "exaggeration: found 0"),
    (lambda: film("v.mp4", static=[]), "static: found 0 stacks"),
]


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """With a file and a folder whose names are taken, which are the same afterwards."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "there.mp4").write_text("mine")
    (tmp_path / "folder.mp4").mkdir()
    yield
    assert sorted(file.name for file in tmp_path.rglob("*")) == ["folder.mp4", "there.mp4"]
    assert (tmp_path / "there.mp4").read_text() == "mine"


@pytest.mark.parametrize(("ask", "said"), REFUSED, ids=[said for _, said in REFUSED])
def test_what_cannot_be_shown_is_refused_in_one_sentence(folder, monkeypatch, ask, said):
    """Before it is computed."""
    monkeypatch.setattr(paper_figures, "write", lambda name: pytest.fail("computed"))
    with pytest.raises(cdpr.CdprError, match=said) as refused:
        ask()
    assert "\n" not in str(refused.value)

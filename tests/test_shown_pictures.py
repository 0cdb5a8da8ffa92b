"""What a picture says is what was computed: numbers, bars and outlines of videos, against states that are made up."""

import dataclasses

import numpy as np
import pytest
from PIL import ImageDraw
from scipy.spatial.transform import RigidTransform, Rotation

import cdpr_sim as cdpr
from cdpr_sim.drawing import maps, style
from cdpr_sim.drawing.video import film, page

SIZE = (640, 360)


@pytest.fixture
def words(monkeypatch) -> list[str]:
    """All that is written from here on, in order."""
    said: list[str] = []
    write = ImageDraw.ImageDraw.text

    def record(self, at, text, *args, **options):
        said.append(text)
        return write(self, at, text, *args, **options)

    monkeypatch.setattr(ImageDraw.ImageDraw, "text", record)
    return said


def a_page() -> page.Page:
    robot = cdpr.load_robot("planar-vertical")
    return page.Page(SIZE, [robot], ["caption"], largest_tension=2.0, footnote="footnote", outlined=True)


def a_frame(of: page.Page, tensions, slack) -> np.ndarray:
    (cell,) = of.cells
    views = [np.zeros((box.height, box.width, 3), np.uint8) for box in (cell.view, cell.close_up)]
    deviation = np.array([3e-3, 4e-3, -12.3e-3])
    return of.frame(views[:1], views[1:], [np.radians(26.0)], [deviation], [np.asarray(tensions)], [np.asarray(slack)])


def test_a_frames_numbers_are_the_states(words):
    """26° of tilt, 5 mm aside, 12.3 mm below, two cables of four slack."""
    of = a_page()
    words.clear()
    a_frame(of, [0.0, 0.5, 2.0, 0.0], [True, False, False, True])
    shown = [words[words.index(name) + 1 : words.index(name) + 3] for name in ("tilt", "shift", "sag")]
    assert shown == [["26.0", " °"], ["5.00", " mm"], ["12.3", " mm"]]
    place = words.index(" of 4")
    assert words[place - 2 : place] == ["slack", "2"]


def test_bars_are_as_high_as_tensions():
    """A quarter and the whole of the scale; a slack cable's is an empty frame of its own colour."""
    of = a_page()
    frame = a_frame(of, [0.0, 0.5, 2.0, 0.0], [True, False, False, True])
    chart = of._chart(of.cells[0].bars)
    middles = [int(chart.left + (i + 0.5) * chart.width / 4) for i in range(4)]
    paper = np.array(page._rgb(style.PAGE_PAPER))
    filled = [(np.abs(frame[chart.top : chart.bottom, x].astype(int) - paper).max(1) > 60).mean() for x in middles]
    assert filled[1] == pytest.approx(0.25, abs=0.06)
    assert filled[2] == pytest.approx(1.0, abs=0.02)
    assert max(filled[0], filled[3]) < 0.5  # the frame's two lines, and the word along it
    edge = frame[(chart.top + chart.bottom) // 2, chart.left : middles[0]].astype(int)
    assert np.abs(edge - page._rgb(style.SLACK_COLOR)).max(1).min() == 0


@pytest.fixture(scope="module")
def moving() -> cdpr.Trajectory:
    """`parallel` along a piece of the paper's line."""
    return cdpr.drive(cdpr.load_robot("parallel"), [[0.17, 0.25, 0.1], [0.3, 0.25, 0.1]], seconds=20.0, states=5)


def test_every_frame_is_given_its_own_state(moving, monkeypatch):
    """Tilt, deviation, tensions and slack cables of the state that is drawn."""
    given = []
    drawn = page.Page.frame
    monkeypatch.setattr(page.Page, "frame", lambda self, *args: given.append(args[2:]) or drawn(self, *args))
    list(film.frames(moving, seconds=0.5, fps=10, size=SIZE, renderer="raycast"))
    assert len(given) == 5
    for step, (tilts, deviations, tensions, slack) in enumerate(given):
        assert tilts[0] == moving.tilt[step]
        np.testing.assert_array_equal(deviations[0], moving.deviation[step])
        np.testing.assert_array_equal(tensions[0], moving.tensions[step])
        np.testing.assert_array_equal(slack[0], moving.slack[step])
    assert np.ptp([tilts[0] for tilts, *_ in given]) > 0.1


def outline(picture: np.ndarray) -> np.ndarray:
    """Mean column and row of the pixels in the static outline's colour."""
    rows, columns = np.nonzero(np.abs(picture.astype(int) - np.round(255 * np.array(style.STATIC_COLOR))).max(2) < 60)
    assert len(rows) > 20
    return np.array([columns.mean(), rows.mean()])


def test_the_outline_is_where_the_static_solver_puts_it(moving):
    """Given poses that are 60 mm higher, it is drawn higher."""
    poses = cdpr.solve_trajectory(moving).poses
    lifted = RigidTransform.from_components(poses.translation + np.array([0, 0, 0.06]), Rotation.identity(len(moving)))
    places = []
    for static in (poses, lifted):
        with film._Film(moving, static, None, 0.5, 10.0, (1280, 720), 1.0, "raycast") as shown:
            (picture, *_) = shown.frames()
            view = shown.page.cells[0].view
            places.append(outline(picture[view.top : view.bottom, view.left : view.right]))
    assert places[0][1] - places[1][1] > 20  # pixels


def test_the_legend_names_the_outline_only_where_there_is_one(words, moving):
    """With the static solver's poses, and without."""
    for static, count in ((cdpr.solve_trajectory(moving).poses, 1), (None, 0)):
        words.clear()
        film._Film(moving, static, None, 0.5, 10.0, (1280, 720), 1.0, "raycast")
        assert sum("static" in word for word in words) == count


def test_maps_say_how_much_is_feasible_and_how_far_apart_the_roads_are():
    """A quarter of the poses; the largest difference, 1.5e-6 mm, rounded up, and not the mean."""
    dataset = cdpr.sweep("cogiro", {"x": [0.3, 0.4], "z": [0.1, 0.2]})
    dataset["feasible"][:] = np.reshape([True, False, False, False], dataset["feasible"].shape)
    figure = maps.draw_elastic_map(dataset, names=["feasible"])
    assert "25 % of the poses" in [text.get_text() for ax in figure.axes for text in ax.texts]
    checked = cdpr.check("cogiro", {"x": [0.3, 0.4], "z": [0.1, 0.2]}).dataset
    checked["position_error"][:] = np.reshape([1.5e-9, 1e-15, 1e-15, 1e-15], checked["position_error"].shape)
    said = [text.get_text() for ax in maps.draw_agreement_map(checked).axes for text in ax.texts]
    assert said == ["at most 10⁻⁵ mm"]


def test_the_caption_says_what_is_in_the_frame(moving):
    """Material and stiffness, platform and frame, in their units."""
    robot = moving.robot.replace(material="fishing-0.4mm")
    caption = film._caption(dataclasses.replace(moving, problems=dataclasses.replace(moving.problems, robot=robot)))
    assert caption == "fishing-0.4mm, EA = 1 kN · platform 0.4 kg · frame 0.8 × 0.5 × 0.5 m"

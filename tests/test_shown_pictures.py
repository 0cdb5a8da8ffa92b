"""What a picture says is what was computed: numbers, bars and outlines of videos, against states that are made up."""

import dataclasses
import itertools
from types import SimpleNamespace
from typing import NamedTuple
from unittest.mock import Mock

import matplotlib
import numpy as np
import pytest
from matplotlib.colors import same_color
from PIL import ImageDraw
from scipy.spatial.transform import RigidTransform, Rotation

import cdpr_sim as cdpr
from cdpr_sim.crosscheck.layout_validation import LayoutValidation, ValidatedRobot
from cdpr_sim.design.layout_equilibria import Cases
from cdpr_sim.design.objectives import OBJECTIVES
from cdpr_sim.drawing import maps, still, style
from cdpr_sim.drawing.video import frame_layout, scene, writing
from cdpr_sim.studies import better_layouts

SIZE = (640, 360)


class Word(NamedTuple):
    """What is written, where [pixel], and in which colour."""

    text: str
    x: float
    y: float
    color: tuple[int, int, int]


@pytest.fixture
def written(monkeypatch) -> list[Word]:
    """All that is written from here on, in order."""
    said: list[Word] = []
    write = ImageDraw.ImageDraw.text

    def record(self, at, text, fill, *args, **options):
        said.append(Word(text, *at, fill))
        return write(self, at, text, fill, *args, **options)

    monkeypatch.setattr(ImageDraw.ImageDraw, "text", record)
    return said


def a_page() -> frame_layout.Page:
    robot = cdpr.load_robot("planar-vertical")
    return frame_layout.Page(SIZE, [robot], [["caption"]], largest_tension=2.0, footnote="footnote", outlined=True)


def a_frame(of: frame_layout.Page, tensions, slack) -> np.ndarray:
    (cell,) = of.cells
    views = [np.zeros((box.height, box.width, 3), np.uint8) for box in (cell.view, cell.close_up)]
    deviation = np.array([3e-3, 4e-3, -12.3e-3])
    return of.frame(views[:1], views[1:], [np.radians(26.0)], [deviation], [np.asarray(tensions)], [np.asarray(slack)])


@pytest.mark.parametrize("size", [(640, 360), (480, 640)], ids=["numbers beside", "numbers below"])
@pytest.mark.parametrize("robots", [1, 2])
def test_areas_of_a_frame_have_their_places(size, robots):
    """Heading above the view, which is the largest; the others beside or below it; none overlaps another."""
    robot = cdpr.load_robot("parallel")
    page = frame_layout.Page(
        size, [robot] * robots, [["caption"]] * robots, largest_tension=2.0, footnote="footnote", outlined=True
    )
    every = []
    for cell in page.cells:
        view, others = cell.view, [cell.heading, cell.close_up, cell.numbers, cell.bars]
        assert view.width * view.height > max(one.width * one.height for one in others)
        assert cell.heading.bottom <= min(one.top for one in (view, *others[1:]))
        assert all(one.left >= view.right or one.top >= view.bottom for one in others[1:])
        assert cell.close_up.top <= cell.numbers.top <= cell.bars.top
        assert cell.close_up.left <= cell.numbers.left <= cell.bars.left
        every += [view, *others]
    for one, other in itertools.combinations(every, 2):
        assert one.right <= other.left or other.right <= one.left or one.bottom <= other.top or other.bottom <= one.top
    assert all(one.left >= 0 and one.right <= size[0] and one.top >= 0 and one.bottom <= size[1] for one in every)


def test_a_frames_numbers_are_the_states(written):
    """26° of tilt, 5 mm aside, 12.3 mm below, one cable of four slack."""
    of = a_page()
    written.clear()
    a_frame(of, [0.0, 0.5, 2.0, 1.0], [True, False, False, False])
    words = [word.text for word in written]
    shown = [words[words.index(name) + 1 : words.index(name) + 3] for name in ("tilt", "dev. xy", "dev. -z")]
    assert shown == [["26.0", " °"], ["5.00", " mm"], ["12.3", " mm"]]
    place = words.index(" of 4")
    assert words[place - 2 : place] == ["slack", "1"]
    units = [word for word in written if word.text in (" °", " mm", " of 4")]
    left = of.cells[0].numbers.left
    names = [word for word in written if word.x == left and word.text in ("tilt", "dev. xy", "dev. -z", "slack")]
    assert [word.y for word in units] == [word.y for word in names]  # each in its own line


def test_bars_are_as_high_as_tensions():
    """A quarter and the whole of the scale; a slack cable's has a frame of its own colour, empty without mass."""
    of = a_page()
    frame = a_frame(of, [0.0, 0.5, 2.0, 0.0], [True, False, False, True])
    chart = of._chart(of.cells[0].bars)
    middles = [int(chart.left + (i + 0.5) * chart.width / 4) for i in range(4)]
    paper = np.array(frame_layout._rgb(style.PAGE_PAPER))
    filled = [(np.abs(frame[chart.top : chart.bottom, x].astype(int) - paper).max(1) > 60).mean() for x in middles]
    assert filled[1] == pytest.approx(0.25, abs=0.06)
    assert filled[2] == pytest.approx(1.0, abs=0.02)
    assert max(filled[0], filled[3]) < 0.5  # the frame's two lines, and the word along it
    heavy = a_frame(of, [0.0, 0.5, 2.0, 1.0], [True, False, False, True])[chart.top : chart.bottom, middles[3] + 12]
    assert (np.abs(heavy - paper).max(1) > 60).mean() == pytest.approx(0.5, abs=0.06)
    edge = frame[(chart.top + chart.bottom) // 2, chart.left : middles[0]].astype(int)
    assert np.abs(edge - frame_layout._rgb(style.SLACK_COLOR)).max(1).min() == 0


def test_bars_reach_the_numbers_of_their_tensions(written):
    """On a scale of 0, 1 and 2 N, upwards, bars of 1 and 2 N end where it says so, over the numbers of their cables."""
    of = a_page()
    frame = a_frame(of, [1.0, 2.0, 1.0, 0.0], [False, False, False, True]).astype(int)
    chart = of._chart(of.cells[0].bars)
    heights = {word.text: word.y for word in written if word.x < chart.left and chart.top <= word.y < chart.bottom}
    assert list(heights) == ["0", "1", "2"]
    under = [word for word in written if word.y > chart.bottom and chart.left < word.x < chart.right]
    under = {word.x: word for word in under[:4] + under[-1:]}  # a slack cable's is written again
    for number, (x, word) in enumerate(sorted(under.items()), start=1):
        assert word.text == str(number)
        assert word.color == frame_layout._rgb(style.SLACK_COLOR if number == 4 else style.PAGE_INK)
        if number < 4:
            column = np.abs(frame[chart.top : chart.bottom, int(x)] - frame_layout._rgb(style.PAGE_PAPER)).max(1)
            top = chart.top + np.flatnonzero(column > 100)[0]
            assert top == pytest.approx(heights[{1: "1", 2: "2", 3: "1"}[number]], abs=1)


def test_bars_have_the_legends_colours(written):
    """A quarter, a half and all of the scale, which ends at 2 N; where it is darkest, as the colour map has it."""
    of = a_page()
    frame = a_frame(of, [0.5, 1.0, 2.0, 0.0], [False, False, False, True])
    chart = of._chart(of.cells[0].bars)
    least, most = (next(word for word in written if word.text == end) for end in ("0", "2 N"))
    scale = frame[int(most.y), int(least.x) : int(most.x)]
    scale = scale[np.ptp(scale.astype(int), axis=1) > 30]  # without the paper on both sides, and what is written
    for cable, share in enumerate((0.25, 0.5, 1.0)):
        bar = frame[chart.bottom - 3, int(chart.left + (cable + 0.5) * chart.width / 4)].astype(int)
        assert np.abs(bar - scale[round(share * (len(scale) - 1))]).max() <= 4
        true = 255 * np.array(matplotlib.colormaps["viridis"](0.58 * (1 - share))[:3])
        assert np.abs(bar - true).max() <= 1


def test_the_legends_swatches_have_the_colours_of_what_they_name(written):
    """Blue for MuJoCo's platform, a yellow edge for the static solver's, vermilion for a slack cable; grey between."""
    of = a_page()
    blank = np.asarray(of._blank).astype(int)
    named = {word.text: word for word in written}

    def swatch(name: str) -> np.ndarray:
        x, y = int(named[name].x), int(named[name].y)
        return blank[y - 7 : y + 7, x - 22 : x - 2].reshape(-1, 3)

    platform, yellow, vermilion = (
        frame_layout._rgb(color) for color in (style.PLATFORM_COLOR, style.STATIC_COLOR, style.SLACK_COLOR)
    )
    holds = {
        name: [bool((np.abs(swatch(name) - color).max(1) <= 2).any()) for color in (platform, yellow, vermilion)]
        for name in ("platform in MuJoCo", "commanded", "static solver", "slack cable")
    }
    assert holds == {
        "platform in MuJoCo": [True, False, False],
        "commanded": [False, False, False],
        "static solver": [True, True, False],
        "slack cable": [False, False, True],
    }


def test_a_picture_says_what_is_drawn_larger(written, moving):
    """So many times, in every frame; and nothing where all is to scale."""
    for times, said in ((3.0, ["Deviations drawn 3 × larger; the numbers are the true values"]), (1.0, [])):
        with writing.VideoFrames(moving, None, None, 0.5, 4.0, (1280, 720), times, "raycast", None) as shown:
            written.clear()
            next(shown.frames())
        assert [word.text for word in written if "large" in word.text] == said


@pytest.fixture(scope="module")
def moving() -> cdpr.Trajectory:
    """`parallel` along a piece of the paper's line."""
    return cdpr.drive(cdpr.load_robot("parallel"), [[0.17, 0.25, 0.1], [0.3, 0.25, 0.1]], seconds=20.0, states=5)


def test_every_frame_is_given_its_own_state(moving, monkeypatch):
    """Tilt, deviation, tensions and slack cables of the state that is drawn."""
    given = []
    drawn = frame_layout.Page.frame
    monkeypatch.setattr(frame_layout.Page, "frame", lambda self, *args: given.append(args[2:]) or drawn(self, *args))
    list(writing.VideoFrames(moving, seconds=0.5, fps=10, size=SIZE, renderer="raycast").frames())
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
        with writing.VideoFrames(moving, static, None, 0.5, 4.0, (1280, 720), 1.0, "raycast", None) as shown:
            (picture, *_) = shown.frames()
            view = shown.page.cells[0].view
            places.append(outline(picture[view.top : view.bottom, view.left : view.right]))
    assert places[0][1] - places[1][1] > 20  # pixels


def test_the_legend_names_the_outline_only_where_there_is_one(written, moving):
    """With the static solver's poses, and without."""
    for static, count in ((cdpr.solve_trajectory(moving).poses, 1), (None, 0)):
        written.clear()
        writing.VideoFrames(moving, static, None, 0.5, 4.0, (1280, 720), 1.0, "raycast", None)
        assert sum("static" in word.text for word in written) == count


def test_two_videos_share_the_scale_of_the_harder_pull(written, moving):
    """Whichever stands first: the legend's end is the round number above it, for bars and cables alike."""
    weak = dataclasses.replace(moving, tensions=moving.tensions / 10)
    most = float(moving.tensions.max())
    for both in ([moving, weak], [weak, moving]):
        written.clear()
        shown = writing.VideoFrames(both, [None, None], None, 0.5, 10.0, (1280, 720), 1.0, "raycast", None)
        ends = [float(word.text[:-2]) for word in written if word.text.endswith(" N") and word.text[0].isdigit()]
        assert len(ends) == 1
        assert most <= ends[0] <= 1.5 * most
        assert [stage.largest_tension for stage in shown.stages] == ends * 2


def test_time_begins_when_the_motion_does(moving):
    """Frames of a motion that begins at a hundred seconds are those of one that begins at none."""
    later = dataclasses.replace(moving, times=moving.times + 100.0)
    shares = np.linspace(0, 1, 9)
    assert [writing._state_at(later, share) for share in shares] == [
        writing._state_at(moving, share) for share in shares
    ]


def test_cables_ghost_and_trail_are_those_of_the_state(moving):
    """Halfway: every taut cable in the colour of its tension then, the ghost where the platform was commanded then."""
    stage = scene.Stage(moving, largest_tension=2.0)
    step = 3
    stage.set(step)
    taut = ~moving.slack[step]
    true = matplotlib.colormaps["viridis"](0.58 * (1 - moving.tensions[step, taut] / 2.0))[:, :3]
    np.testing.assert_allclose(stage.model.tendon_rgba[taut, :3], true, atol=1e-6)
    assert np.abs(moving.tensions[step] - moving.tensions[0]).max() > 0.05
    shapes = stage.scene.geoms[: stage.scene.ngeom]
    (ghost,) = [geom for geom in shapes if geom.rgba[3] == np.float32(style.GHOST_ALPHA)]
    np.testing.assert_allclose(ghost.pos, moving.commanded.translation[step], atol=1e-6)
    assert np.linalg.norm(moving.deviation[step]) > 1e-3
    trail = [
        geom.pos for geom in shapes
        if np.allclose(geom.rgba, (*style.PLATFORM_COLOR, 1)) and geom.objtype == scene.mujoco.mjtObj.mjOBJ_UNKNOWN
    ]  # fmt: skip
    np.testing.assert_allclose(trail, (moving.positions[:step] + moving.positions[1 : step + 1]) / 2, atol=1e-6)


def test_maps_say_how_much_is_feasible_and_how_far_apart_the_methods_are():
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
    robot = moving.robot.replace(material="fishing-0.4mm", frame=[[0.0, 0.0, 0.0], [0.8, 0.5, 0.6]])
    captions = writing._captions(
        dataclasses.replace(moving, problems=dataclasses.replace(moving.problems, robot=robot))
    )
    assert captions[0] == "fishing-0.4mm, EA = 1 kN · platform 0.4 kg · frame 0.8 × 0.5 × 0.6 m"
    assert captions[-1] == "fishing-0.4mm, EA = 1 kN"
    assert sorted(captions, key=len, reverse=True) == captions or captions[-2] == captions[-1]


@pytest.mark.parametrize(("size", "count"), [((800, 450), 2), ((640, 360), 1), ((1280, 720), 2)])
@pytest.mark.parametrize("name", cdpr.list_robots())
def test_headings_are_whole(written, name, size, count):
    """Of every robot, at the sizes that are shown: what does not fit gives way to fewer words, and never breaks off."""
    robot = cdpr.load_robot(name)
    robot = robot.replace(description="with a description as long as those that people like to write")
    captions = writing._captions(SimpleNamespace(robot=robot))
    frame_layout.Page(size, [robot] * count, [captions] * count, largest_tension=2.0, footnote="", outlined=True)
    said = [word.text for word in written]
    assert said.count(name) == count
    assert sum(said.count(text) for text in captions) == count
    assert not [text for text in said if text.endswith("…")]


@pytest.fixture(scope="module")
def layouts() -> tuple[cdpr.EquilibriumBatch, cdpr.EquilibriumBatch]:
    """`parallel` and the same with two exits lower, at rest at two poses."""
    robot = cdpr.load_robot("parallel")
    exits = robot.exits.copy()
    exits[[0, 6], 2] -= 0.1
    poses = [(0.4, 0.25, 0.2), (0.2, 0.25, 0.1)]
    return cdpr.solve_many(robot, poses), cdpr.solve_many(robot.replace(exits=exits), poses)


def test_before_and_after_are_not_swapped(layouts, monkeypatch):
    """Each with its exits, its map in degrees and its column of numbers; what moved is drawn on the second alone."""
    before, after = layouts
    tilts = np.radians([[1.0, 2.0, 3.0], [4.0, 5.0, np.nan]])  # over x, and z
    asked, numbers = before.problems.positions, [("worst tilt", "6°", "3°"), ("deviation", "2 mm", "1 mm")]
    maps = {before.robot: tilts, after.robot: tilts / 2}
    axes = {"x": np.array([0.5, 1.5]), "y": np.zeros(1), "z": np.array([0.5, 1.5, 2.5])}
    monkeypatch.setattr(better_layouts, "numbers", lambda _: numbers)
    monkeypatch.setattr(better_layouts, "plane", lambda *_: axes)
    monkeypatch.setattr(better_layouts, "objective_map", lambda _, robot, __: maps[robot])
    goal, cases = OBJECTIVES["worst tilt"], Cases.of(before.robot, asked)
    found = SimpleNamespace(given=before.robot, robot=after.robot, cases=cases, objective=goal)
    sides = [Mock(spec=ValidatedRobot, settled=one, score=1.0, each=np.array([0.1, 0.2])) for one in layouts]
    validation = Mock(
        spec=LayoutValidation, layout=found, before=sides[0], after=sides[1], cases=cases, side_effects=("worse",)
    )
    figure = better_layouts.picture(validation)
    spaces = [ax for ax in figure.axes if ax.name == "3d"]
    assert [ax.get_title() or ax.get_title(loc="left") for ax in spaces] == ["before", "after"]
    for ax, equilibria in zip(spaces, layouts, strict=True):
        exits = next(line for line in ax.lines if same_color(line.get_color(), style.INK) and line.get_marker() == "o")
        np.testing.assert_array_equal(np.transpose(exits.get_data_3d()), equilibria.robot.exits)
    purple = [[line for line in ax.lines if style.PURPLE in (line.get_color(), line.get_mec())] for ax in spaces]
    moves = [np.transpose(line.get_data_3d()).tolist() for line in purple[1]]
    was, now = (equilibria.robot.exits[[0, 6]].tolist() for equilibria in layouts)
    assert not purple[0]
    assert moves == [[was[0], now[0]], [was[0]], [was[1], now[1]], [was[1]]]  # a line, and a circle where it was
    planes = [ax for ax in figure.axes if ax.images]
    for ax, times in zip(planes, (1.0, 0.5), strict=True):
        shown = ax.images[0]
        assert shown.origin == "lower"
        assert shown.get_extent() == [0, 2, 0, 3]
        assert shown.get_clim() == (0, pytest.approx(5.0))
        np.testing.assert_allclose(
            np.ma.filled(shown.get_array(), np.nan), times * np.array([[1, 4], [2, 5], [3, np.nan]])
        )
        assert (ax.get_xlabel(), ax.get_ylabel()) == ("commanded x [m]", "z [m]")
        np.testing.assert_array_equal(ax.lines[0].get_xydata(), asked[:, [0, 2]])
    assert "tilt [°]" in [ax.get_ylabel() for ax in figure.axes]
    (table,) = (table for ax in figure.axes for table in ax.tables)
    cells = {place: cell.get_text().get_text() for place, cell in table.get_celld().items()}
    rows = [[cells[row, column] for column in range(3)] for row in range(3)]
    assert rows == [["", "before", "after"], *map(list, numbers)]


def test_what_moved_on_the_platform_is_drawn_enlarged_and_named(parallel_with_other_anchors):
    """Anchors and the centre of mass in a third column, exits on the frame; the map is of the objective's quantity."""
    figure = better_layouts.picture(parallel_with_other_anchors)
    (legend,) = (ax.get_legend() for ax in figure.axes if ax.get_legend())
    said = [text.get_text() for text in legend.get_texts()]
    assert [text for text in said if "moved" in text] == ["anchor moved, from its previous position"]
    spaces = [ax for ax in figure.axes if ax.name == "3d"]
    assert [ax.get_title() for ax in spaces] == ["before", "after", "platform,\nenlarged"]
    drawn = [np.transpose(line.get_data_3d()) for line in spaces[2].lines if same_color(line.get_color(), style.ORANGE)]
    found = parallel_with_other_anchors.layout
    moves = np.stack([found.given.anchors, found.robot.anchors], axis=1)
    np.testing.assert_allclose([line for line in drawn if len(line) == 2], moves)
    assert "deviation [mm]" in [ax.get_ylabel() for ax in figure.axes]
    panel = next(ax for ax in figure.axes if ax.images)
    image = panel.images[0]
    x0, x1, z0, z1 = image.get_extent()
    rows, columns = image.get_array().shape
    (x, _, z), y = (x0 + (x1 - x0) / columns / 2, 0, z0 + (z1 - z0) / rows / 2), 0.25
    corner = cdpr.solve(found.given, (x, y, z))
    assert image.get_array()[0, 0] == pytest.approx(1e3 * np.linalg.norm(corner.deviation), rel=1e-6)


@pytest.fixture(scope="module")
def parallel_with_other_anchors() -> LayoutValidation:
    """`parallel` with anchors moved for the least deviation at one pose."""
    found = cdpr.find_layout(
        cdpr.load_robot("parallel"), [(0.2, 0.25, 0.1), (0.4, 0.25, 0.1)], move="anchors", within=0.01, generations=2,
        objective="worst deviation", population=10,
    )  # fmt: skip
    assert found.better
    return cdpr.validate_layout(found)


def test_a_map_of_distances_is_in_millimetres_and_red_where_they_are_too_small(monkeypatch):
    """4 mm of 5 needed are red, 12 mm are not; nor is a pose without rest."""
    least = np.array([[0.004, 0.012, 0.006], [0.0125, np.nan, 0.020]])  # over y, and z
    axes = {"x": np.zeros(1), "y": np.array([0.5, 1.5]), "z": np.array([0.5, 1.5, 2.5])}
    found = SimpleNamespace(
        least=least[None], fitting=0.0, free=lambda enough: least > enough, nearest=lambda index: str(index)
    )
    monkeypatch.setattr(better_layouts, "plane", lambda *_: axes)
    monkeypatch.setattr(better_layouts, "clearances", lambda *_, **__: found)
    figure = better_layouts.clearance_map(cdpr.load_robot("parallel"), "yz", None, 0.005, None)
    ax, bar = figure.axes
    distances, near = ax.images
    for image, of in ((distances, [[4, 12.5], [12, np.nan], [6, 20]]), (near, [[1, np.nan]] + 2 * [[np.nan] * 2])):
        assert (image.origin, image.get_extent()) == ("lower", [0, 2, 0, 3])
        np.testing.assert_allclose(np.ma.filled(image.get_array(), np.nan), of)
    assert distances.get_clim() == (0, 20)  # colours begin at no distance at all
    assert same_color(near.cmap(0.5), style.VERMILLION)
    (legend,) = figure.legends
    assert [text.get_text() for text in legend.get_texts()] == ["below 5 mm"]
    assert same_color(legend.get_patches()[0].get_facecolor(), style.VERMILLION)
    assert (ax.get_xlabel(), ax.get_ylabel()) == ("commanded y [m]", "commanded z [m]")
    assert bar.get_ylabel() == "smallest distance [mm]"


def test_a_front_has_its_first_goal_to_the_right():
    """One series after the other, MuJoCo's and the given robot's beside them, each under its own name."""
    one, confirmed = np.array([[2.0, 10.0], [1.0, 30.0]]), np.array([[2.1, 11.0], [1.1, 31.0]])
    figure = better_layouts.draw_front(
        [("first", one), ("second", one + 1)], ("tilt [°]", "size [mm]"), "title", "caption", (5.0, 50.0), confirmed
    )
    (ax,) = figure.axes
    drawn = {line.get_label(): line.get_xydata().tolist() for line in ax.lines}
    assert drawn == {
        "first": [[1, 30], [2, 10]],
        "second": [[2, 31], [3, 11]],
        "MuJoCo, at twice as many poses": [[2.1, 11], [1.1, 31]],
        "as given": [[5, 50]],
    }
    assert (ax.get_xlabel(), ax.get_ylabel()) == ("tilt [°]", "size [mm]")


def test_a_sheet_says_what_each_robot_is():
    """Cables, mass in kg, and width, depth and height of the frame in m, below its name."""
    robots = [cdpr.load_robot("parallel"), cdpr.load_robot("two-cable")]
    spatial, planar = (robot.replace(mass=1234.5, frame=[(0, 0, 0), (3, 2 * (i == 0), 1)])
                       for i, robot in enumerate(robots))  # fmt: skip
    figure = still.sheet([spatial, planar])
    assert [ax.get_title() for ax in figure.axes] == ["parallel", "two-cable"]
    said = [ax.texts[-1].get_text() for ax in figure.axes]
    assert said[0].splitlines() == [f"{spatial.kind}, 8 cables", "1,230 kg, 3 × 2 × 1 m"]
    assert said[1].splitlines() == [f"planar, {planar.kind}, 2 cables", "1,230 kg, 3 × 1 m"]


def test_a_still_shows_cables_where_they_run_and_its_platform_in_its_own_frame():
    """Turned by 90° about z, the platform sees an exit that stands in front of it on its right."""
    robot = cdpr.Robot(
        exits=[[1, 0, 1], [-1, 0, 1], [0, 1, 1]], anchors=[[0, -0.1, 0], [0, 0.1, 0], [0.1, 0, 0.05]],
        axial_stiffness=1e3, mass=1, platform_size=(0.2, 0.2, 0.1), center_of_mass=(0.02, 0.01, -0.03),
    )  # fmt: skip
    figure = still.draw(robot, (0, 0, 0.2, 0, 0, np.pi / 2))
    whole, close = figure.axes
    anchors = [[0.1, 0, 0.2], [-0.1, 0, 0.2], [0, 0.1, 0.25]]  # (x, y) to (-y, x), and up
    for cable in range(3):
        lines = [
            line for line in whole.lines if line.get_color() == style.CABLES[cable] and line.get_marker() == "None"
        ]
        np.testing.assert_allclose(
            np.transpose(lines[0].get_data_3d()), [robot.exits[cable], anchors[cable]], atol=1e-12
        )
    seen = [[0, -1, 0.8], [0, 1, 0.8], [1, 0, 0.8]]  # (x, y) to (y, -x)
    for cable in range(3):
        (line,) = (line for line in close.lines if line.get_color() == style.CABLES[cable])
        start, end = np.transpose(line.get_data_3d())
        np.testing.assert_allclose(start, robot.anchors[cable])
        away = np.array(seen[cable]) - robot.anchors[cable]
        np.testing.assert_allclose((end - start) / np.linalg.norm(end - start), away / np.linalg.norm(away), atol=1e-12)
    (cross,) = (line for line in close.lines if line.get_marker() == "+")
    np.testing.assert_allclose(np.ravel(cross.get_data_3d()), [0.02, 0.01, -0.03])
    for ax, points in ((whole, robot.exits), (close, robot.anchors)):
        numbers = {int(text.get_text()): np.array(text.get_position_3d()) for text in ax.texts}
        for number, place in numbers.items():
            assert np.argmin(np.linalg.norm(points - place, axis=1)) == number - 1
            assert same_color(
                next(t for t in ax.texts if t.get_text() == str(number)).get_color(), style.CABLES[number - 1]
            )

"""What a stranger would trip over in pictures: numbers, labels that collide, stepped borders, wrong colours."""

import functools
import io
import itertools

import numpy as np
import pytest
from matplotlib import font_manager
from matplotlib.collections import QuadMesh
from matplotlib.colors import same_color
from matplotlib.text import Text

import cdpr_sim as cdpr
from cdpr_sim.analysis.workspace import feasibility
from cdpr_sim.drawing import lettering, maps, style
from cdpr_sim.drawing.readable_numbers import per_cent, plain, power_of_ten
from cdpr_sim.drawing.video import writing
from cdpr_sim.studies import lines, lines_figures, tilt_condition

PLANE = {"x": np.linspace(0.1, 0.7, 61), "z": np.linspace(0.05, 0.4, 36)}
MATERIALS = ["vectran-0.7mm", "fishing-0.4mm"]


BORDER = 1e-3
"""[m] How far the drawn border may be off, on cells of 10 mm: 0.1 mm measured; around the cells it is 5 mm off."""


@pytest.fixture(scope="module")
def both():
    """Two layouts and two materials."""
    return cdpr.sweep(["parallel", "cogiro"], PLANE, MATERIALS, quantities=maps.QUANTITIES)


@pytest.fixture(scope="module")
def single():
    """One robot."""
    return cdpr.sweep("cogiro", PLANE, quantities=maps.QUANTITIES)


@pytest.fixture(scope="module")
def under_actuated():
    """A bar that only a line of poses can hold level, on coarse cells."""
    return cdpr.sweep("two-cable", {"x": np.linspace(0.1, 0.7, 25), "z": PLANE["z"]}, quantities=maps.QUANTITIES)


@pytest.fixture(scope="module")
def drawn_map(both, single, under_actuated):
    """The elastic map of each, with all its labels in their places."""
    datasets = {"both": both, "single": single, "under_actuated": under_actuated}

    @functools.cache
    def of(name):
        figure = maps.draw_elastic_map(datasets[name])
        figure.draw_without_rendering()
        return figure

    return of


@pytest.fixture(scope="module")
def balances():
    """The figure of the tilt condition."""
    return laid_out(tilt_condition.draw_moment_balances(tilt_condition.moment_balances()))


@pytest.fixture(scope="module")
def widths():
    """Small results for the figures of poses and tensions."""
    names = ("planar-horizontal", "cogiro", "parallel")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(lines, "feasible_outline", functools.partial(lines.feasible_outline, columns=61, rows=15))
        return {name: lines.across_the_width(cdpr.load_robot(name), static_rows=61, settled_rows=5) for name in names}


def panels(figure):
    return [ax for ax in figure.axes if ax.get_label() == "panel"]


def words(figure):
    """All that is written on the page and in its panels."""
    return [text.get_text() for text in (*figure.texts, *(t for ax in figure.axes for t in ax.texts))]


def tick_boxes(ax, names):
    """Where the numbers of these axes stand on the page, those within the limits."""
    boxes = []
    for axis in (getattr(ax, f"{name}axis") for name in names):
        low, high = sorted(axis.get_view_interval())
        for tick in axis.get_major_ticks():
            if low <= tick.get_loc() <= high and tick.label1.get_visible() and tick.label1.get_text():
                boxes.append(tick.label1.get_window_extent())
    return boxes


def laid_out(figure):
    """The figure, with everything in its place."""
    figure.draw_without_rendering()
    return figure


def touching(boxes, pixels=8):
    """Pairs of boxes with less than so many pixels between them: read as one number, if they are numbers."""
    wide = [box.padded(pixels / 2) for box in boxes]
    return [(a, b) for a, b in itertools.combinations(wide, 2) if a.overlaps(b)]


# Numbers


def test_numbers_are_written_as_people_read_them():
    """No exponents, and neither all nor nothing is claimed of a part."""
    assert [plain(value) for value in (0.0619, 3.81, 41.17, 170, 12345.6)] == ["0.062", "3.8", "41", "170", "12,346"]
    assert [power_of_ten(value) for value in (8e-8, 1e-7, 3.0)] == ["10⁻⁷", "10⁻⁷", "10¹"]
    assert [per_cent(share) for share in (0, 1e-6, 0.005, 0.424, 0.9992, 1)] == [
        "0 %", "0.1 %", "0.5 %", "42 %", "99.9 %", "100 %",
    ]  # fmt: skip


def test_maps_say_which_poses_their_numbers_are_of(drawn_map):
    """The plane, its extent and how many: the same robot's tilt is another on another grid."""
    foot = " ".join(next(text for text in words(drawn_map("both")) if text.startswith("All numbers")).split())
    assert "61 × 36 commanded poses: x = 0.1 to 0.7 m, z = 0.05 to 0.4 m, y = 0.25 m" in foot


# Room


def test_tick_labels_of_neighbouring_panels_do_not_collide(drawn_map):
    """A letter's width lies between the last of one panel and the first of the next."""
    for name in "xy":
        boxes = [box for ax in panels(drawn_map("both")) for box in tick_boxes(ax, name)]
        assert len(boxes) > 15
        assert not touching(boxes)


@pytest.mark.parametrize("dataset", ["both", "single", "under_actuated"])
def test_contour_labels_are_whole(dataset, drawn_map):
    """Within what is coloured, and clear of one another."""
    labels = 0
    for ax in panels(drawn_map(dataset)):
        (x0, y0), (x1, y1) = ax.transData.transform([(0.1, 0.05), (0.7, 0.4)])
        boxes = [t.get_window_extent() for c in ax.collections for t in getattr(c, "labelTexts", [])]
        labels += len(boxes)
        for box in boxes:
            assert x0 <= box.x0
            assert box.x1 <= x1
            assert y0 <= box.y0
            assert box.y1 <= y1
        assert not touching(boxes, 0)
    assert labels > 3


def test_one_robot_is_no_strip(drawn_map):
    """Its four panels go two by two, each quantity with its bar."""
    figure = drawn_map("single")
    width, height = figure.get_size_inches()
    assert 1 < width / height < 2.5
    boxes = [ax.get_position() for ax in figure.axes]
    assert not touching(boxes, 0)


# The border of the feasible workspace


def test_margin_is_swept_where_it_is_asked_for(both, single):
    """And nowhere else: it takes as long as an equilibrium."""
    assert both["capacity_margin"].dims == ("robot", "x", "y", "z")
    assert both["capacity_margin"].attrs["units"] == "N"
    assert ((both["capacity_margin"] >= 0) == both["feasible"]).all()
    assert "capacity_margin" not in cdpr.sweep("cogiro", (2, 1, 2))


def border(ax):
    """Vertices of the green contour."""
    for collection in ax.collections:
        if any(same_color(color, style.MAP_BORDER) for color in collection.get_edgecolor()):
            return np.concatenate([path.vertices for path in collection.get_paths()])
    return np.empty((0, 2))


def test_border_passes_between_the_poses(drawn_map):
    """Where linear programming has it, and not around the cells."""
    figure = drawn_map("both")
    robot = cdpr.load_robot("parallel")
    for ax in (panels(figure)[0], panels(figure)[12]):
        vertices = border(ax)
        assert len(vertices) > 40
        for x, z in vertices[:: len(vertices) // 20]:
            inwards = BORDER if x < 0.4 else -BORDER
            assert feasibility.feasible_by_linprog(robot, [x + inwards, 0.25, z])
            assert not feasibility.feasible_by_linprog(robot, [x - inwards, 0.25, z])


def test_feasible_poses_are_drawn_once_per_robot(drawn_map):
    """What rigid cables hold knows no material; beside the panel it says so."""
    figure = drawn_map("both")
    assert len(panels(figure)) == 3 * 4 + 2
    assert sum("the same for every material" in text for text in words(figure)) == 2


def test_a_feasible_line_is_drawn_as_a_line(drawn_map):
    """One of no area, and nothing is said of its share."""
    figure = drawn_map("under_actuated")
    ax = panels(figure)[3]
    for mesh in (one for one in ax.collections if isinstance(one, QuadMesh)):
        assert not np.asarray(mesh.get_array()).any()
    segments = [line for line in ax.lines if same_color(line.get_color(), style.MAP_BORDER)]
    assert segments
    assert all(np.allclose(line.get_xdata(), 0.4) for line in segments)
    assert "only on the line" in words(figure)


# Figures


def test_names_of_meeting_points_stand_beside_them(balances):
    """H and V within 50 mm of their points on the drawing."""
    for ax in balances.axes:
        point = next(a for a in ax.lines if a.get_gid() == "meeting point").get_xydata()[0]
        name = next(text for text in ax.texts if text.get_text() in ("H", "V", "intersection"))
        box = name.get_window_extent().transformed(ax.transData.inverted())
        apart = np.maximum([box.x0 - point[0], box.y0 - point[1]], [point[0] - box.x1, point[1] - box.y1]).max()
        assert apart < 0.05


def test_legend_of_the_tilt_condition_is_clear_of_the_frame(balances):
    """It used to end on the line."""
    ax = balances.axes[3]
    right = ax.get_legend().get_window_extent().transformed(ax.transData.inverted()).x1
    assert right < 0.79


@pytest.mark.parametrize("name", ["cogiro", "parallel"])
def test_numbers_of_axes_in_space_do_not_collide(name, widths):
    """Where two axes share a corner."""
    boxes = tick_boxes(laid_out(lines_figures.spatial(widths[name])).axes[0], "xyz")
    assert len(boxes) > 10
    assert not touching(boxes)


def test_vectran_comes_first_as_everywhere_and_poses_show_the_softer_line(widths):
    """In Fig. 7, 8, 10 and 11."""
    for width in widths.values():
        assert [line.robot.material for line in width.lines] == MATERIALS
        assert width.poses.robot.material == "fishing-0.4mm"


def test_commanded_pose_shows_where_the_platform_hangs_just_there(widths):
    """Over the platform, not under it."""
    ax = lines_figures.planar(widths["planar-horizontal"]).axes[0]
    outlines = [patch for patch in ax.patches if same_color(patch.get_edgecolor(), style.COMMANDED)]
    platforms = [patch for patch in ax.patches if same_color(patch.get_facecolor(), style.PLATFORM)]
    assert outlines
    assert min(patch.get_zorder() for patch in outlines) > max(patch.get_zorder() for patch in platforms)


def test_captions_say_what_the_titles_numbers_are_of(widths):
    """The tilt of cogiro is another along this line than over its whole workspace."""
    caption = " ".join(lines_figures.spatial(widths["cogiro"]).get_supxlabel().split())
    assert "numbers refer to what is drawn here: x = 0.1 to 0.7 m, z = 0.1 and 0.28 m, y = 0.25 m" in caption


def test_outline_of_the_feasible_workspace_passes_between_its_grids_columns():
    """On columns 20 mm apart it is within a millimetre of where linear programming has it."""
    robot = cdpr.load_robot("parallel")
    for x, y, z in lines.feasible_outline(robot, columns=31, rows=5):
        inwards = BORDER if x < 0.4 else -BORDER
        assert feasibility.feasible_by_linprog(robot, [x + inwards, y, z])
        assert not feasibility.feasible_by_linprog(robot, [x - inwards, y, z])


def test_numbers_of_cables_do_not_collide():
    """Fig. 6, in which each cable has its own."""
    for ax in laid_out(cdpr.PICTURES["layouts"].figure()).axes:
        assert not touching([text.get_window_extent() for text in ax.texts], 0)


# Videos


NAME = "机器人"
"""Letters that DejaVu Sans lacks."""


def test_names_in_any_script_are_drawn_without_warnings_by_a_font_that_has_them(catalogue, monkeypatch):
    """In figures and videos: with a font where one is installed, and with boxes where there is none."""
    robot = catalogue["two-cable"].replace(name=NAME)
    dataset = cdpr.sweep(robot, {"x": [0.3, 0.4], "z": [0.1, 0.2]}, quantities=maps.QUANTITIES)
    for installed in (True, False):
        if not installed:
            plain = [font for font in font_manager.fontManager.ttflist if font.name == "DejaVu Sans"]
            monkeypatch.setattr(font_manager.fontManager, "ttflist", plain)
            lettering.richest.cache_clear()
        text, font = lettering.legible(NAME)
        assert (text == "□□□") == (font is None)
        for figure in (cdpr.draw(robot), maps.draw_elastic_map(dataset)):
            figure.savefig(io.BytesIO())  # warnings are errors in these tests
            assert any(text in one.get_text() for one in figure.findobj(Text))
    lettering.richest.cache_clear()


def test_slack_cables_have_the_legends_colour_in_shade_as_well():
    """On their dark side too: every vermilion pixel is the legend's or mixed with its neighbours."""
    trajectory = cdpr.drive(cdpr.load_robot("parallel"), [(0.17, 0.25, 0.1), (0.2, 0.25, 0.1)], states=2)
    shown = writing.VideoFrames(trajectory, seconds=2, fps=1, size=(960, 720), renderer="raycast")
    frame = next(shown.frames()).astype(float) / 255
    red, green, blue = np.moveaxis(frame, -1, 0)
    slack = (red > 2.5 * green) & (red > 4 * blue)
    assert slack.sum() > 500
    assert np.quantile(red[slack], 0.02) > 0.8 * style.SLACK_COLOR[0]

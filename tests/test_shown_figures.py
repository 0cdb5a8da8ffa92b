"""Figures say what was computed: whole figures as text, rows of numbers worked out here, and what a reader sees.

Their results are made up (``drawn_figures.py``), each method's numbers its own, so that one drawn as the other is
noticed. Of every figure, all that is drawn is compared with what was reviewed in ``snapshots/figures/``
(``pytest --update-snapshots`` writes it).
"""

import dataclasses
import functools
import io
import itertools
import math
import re

import drawn_figures
import matplotlib
import numpy as np
import pytest
from artists import by_gid, key_of, text_of
from drawn_figures import AWAY, FIGURES, STUDIES, figure, made
from matplotlib import font_manager
from matplotlib.axes import Axes
from matplotlib.collections import QuadMesh
from matplotlib.colors import same_color, to_rgb
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.text import Text
from mpl_toolkits.mplot3d.art3d import Text3D

import cdpr_sim as cdpr
import lines
import lines_figures
import paper_figures
import two_cable
from cdpr_sim.analysis.workspace.feasibility import feasible_by_linprog
from cdpr_sim.crosscheck.check import OUTCOMES
from cdpr_sim.drawing import lettering, maps, still, style

RELATIVE = 1e-5
"""Numbers are written with six digits, of which the last may differ with the machine."""

BORDER = 1e-3
"""[m] How far a drawn border may be off, on cells of 10 mm: 0.1 mm measured; around the cells it is 5 mm off."""


@pytest.mark.parametrize("name", FIGURES)
def test_figures_are_as_reviewed(name, snapshot):
    """Every line, point, area, mesh, word, unit, limit and legend, in data coordinates, in its colour."""
    snapshot(f"figures/{name.replace(' ', '-')}.txt", text_of(figure(name)), rel=RELATIVE)


# Numbers, worked out here


def tilts(equilibria) -> np.ndarray:
    """[°] About y alone: made up so."""
    return np.degrees(np.arctan2(equilibria.rotations[:, 0, 2], equilibria.rotations[:, 2, 2]))


def deviations(equilibria) -> np.ndarray:
    """[mm] From where it was commanded."""
    return 1e3 * (equilibria.positions - equilibria.problems.positions)


def x(equilibria) -> np.ndarray:
    return equilibria.positions[:, 0]


def commanded(equilibria) -> np.ndarray:
    return equilibria.problems.positions[:, 0]


SLACK, LINE = made("planar-vertical").lines[0], made("paper-line")[0]
BAR, PULLED, MEASURED = made("two-cable-closed-form"), made("fully-constrained"), made("real-cables")
NAME = f"{LINE.robot.name}, {LINE.robot.material}"
CLOSED = [math.degrees(two_cable.upright(BAR.line.robot, at)) for at in BAR.line.static.positions]
ERRORS = drawn_figures.agreements(drawn_figures.AGREE, drawn_figures.AGREE, drawn_figures.AGREE, drawn_figures.NEUTRAL)

NUMBERS = [  # figure, which of its axes, gid or label of the line, x, y
    ("planar-vertical", 2, "static 3", commanded(SLACK.static), SLACK.static.tensions[:, 3]),
    ("planar-vertical", 2, "mujoco 3", commanded(SLACK.settled), SLACK.settled.tensions[:, 3]),
    ("paper-line", 0, f"static {NAME}", x(LINE.static), deviations(LINE.static)[:, 2]),
    ("paper-line", 2, f"mujoco {NAME}", x(LINE.settled), tilts(LINE.settled)),
    ("two-cable-closed-form", 1, "closed form", x(BAR.line.static), CLOSED - tilts(BAR.line.static)),
    ("agreement", 0, "second", np.sort([one.position_error for one in ERRORS["second"]]), [25, 50, 75, 100]),
    ("fully-constrained", 1, "mujoco along x", [80, 300], PULLED.unloaded.settled.eigenvalues[:, 5] / 1e3),
    ("real-cables", 2, "mujoco DemoBot, parallel from below", [0, 20],
     1e3 * np.median(MEASURED.growths[1].settled, axis=1)),
    ("compensation", 1, "mujoco after", [300, 400], 1e3 * np.array(AWAY["settled_after"])),
    ("front of a design", 0, "NSGA-II, 99 layouts", np.degrees([0.1, 0.2]), [20, 10]),
    ("maps along a path", 0, "cogiro, vectran-0.7mm", [0, 0.25, 0.5, 0.75, 1], np.degrees(0.01 * np.arange(1, 6))),
]  # fmt: skip
"""One of each kind; all others were reviewed in the snapshots."""


def series(ax: Axes) -> dict[str, Line2D]:
    """Lines by their labels, and by their ids."""
    return {str(line.get_label()): line for line in ax.lines} | by_gid(ax)


@pytest.mark.parametrize(("name", "at", "line", "x", "y"), NUMBERS, ids=lambda one: one if isinstance(one, str) else "")
def test_each_line_is_what_its_name_says(name, at, line, x, y):
    """In the unit of its axes: MuJoCo's numbers at MuJoCo's points, the solver's on the solver's lines."""
    np.testing.assert_allclose(series(figure(name).axes[at])[line].get_xydata(), np.transpose([x, y]), rtol=1e-9)


def test_layouts_are_drawn_as_they_settled_in_the_worst_case(monkeypatch):
    """Platforms stand where MuJoCo let them rest, under one camera, with their slack cables; the last one enlarged."""
    shown = []
    monkeypatch.setattr(still, "show", lambda _, stage, camera, *__: shown.append((stage, camera)))
    drawn_figures.picture()
    (before, one), (after, other), (enlarged, _) = shown
    found, worst = drawn_figures.validation(), 1
    assert enlarged is after
    for stage, side in ((before, found.before), (after, found.after)):
        np.testing.assert_allclose(stage.data.body("platform").xpos, side.settled.positions[worst], atol=1e-9)
        assert stage.trajectory.slack.tolist() == [side.settled.slack[worst].tolist()]
    assert before.trajectory.slack.any()
    assert one is other


def test_a_robot_that_settles_nowhere_has_words_in_place_of_a_picture(monkeypatch):
    """As one whose poses lie above its exits, before these are moved up: MuJoCo has no pose of it at all."""
    true = drawn_figures.validation()
    rest = true.before.settled
    none = {name: np.nan * getattr(rest, name) for name in ("positions", "rotations", "lengths", "tensions")}
    nowhere = dataclasses.replace(rest, **none, status=np.full(3, int(cdpr.Status.FALLS)))
    before = dataclasses.replace(true.before, settled=nowhere, each=np.full(3, np.nan), score=np.nan)
    monkeypatch.setattr(drawn_figures, "validation", lambda *_: dataclasses.replace(true, before=before))
    _, old, _, new, *_ = drawn_figures.picture().axes
    assert [text.get_text() for text in old.texts] == ["no equilibrium"]
    assert not old.images
    assert new.images


# What a reader sees


@pytest.mark.parametrize("name", STUDIES)
def test_every_picture_has_a_title_labels_with_units_and_a_legend(name):
    """A stranger can read it: what it shows, of what, in which units; and which series is which."""
    drawn = figure(name)
    assert len(drawn.get_suptitle()) > 20
    assert len(drawn.get_supxlabel()) > 20
    for ax in (one for one in drawn.axes if one.get_label() != "legend"):
        names = [ax.get_ylabel()] if ax.get_label() == "<colorbar>" else [ax.get_xlabel(), ax.get_ylabel()]
        if hasattr(ax, "get_zlabel"):
            names.append(ax.get_zlabel())
        shared_x = not ax.xaxis.get_tick_params().get("labelbottom", True)
        shared_y = not ax.yaxis.get_tick_params().get("labelleft", True)
        rows_named = all(re.search("[a-z]{3}", label.get_text()) for label in ax.get_yticklabels())
        for label, needless in zip(names, (shared_x, shared_y or rows_named, False), strict=False):
            assert re.search(r"\[(m|mm|°|N|kN/m|ms|%)\]$", label) or (needless and not label), (ax, names)
    assert drawn.legends or any(ax.get_legend() for ax in drawn.axes)


@pytest.mark.parametrize("name", FIGURES)
def test_no_two_keys_of_a_legend_look_the_same(name):
    drawn = figure(name)
    for legend in filter(None, [*drawn.legends, *(ax.get_legend() for ax in drawn.axes)]):
        looks = [key_of(artist) for artist in legend.legend_handles]
        looks = [look for look in looks if look]  # without: words alone, which contain their markers
        assert len(set(looks)) == len(looks), looks


@functools.cache
def laid_out(name: str) -> Figure:
    """One more, with everything in its place."""
    drawn = FIGURES[name]()
    drawn.draw_without_rendering()
    return drawn


@pytest.mark.parametrize("name", [*STUDIES, "controllers", "better layout", "distances", "maps along a path"])
def test_no_word_runs_out_of_the_picture(name):
    """Titles and captions are wrapped to the figure's width."""
    box = laid_out(name).bbox.padded(1)
    axes = laid_out(name).axes
    ticks = {id(label) for ax in axes for axis in ax._axis_map.values() for label in axis.findobj(Text)}
    ticks -= {id(label) for ax in axes for label in (ax.xaxis.label, ax.yaxis.label)}  # those beyond the limits
    for text in laid_out(name).findobj(Text):
        if text.get_text() and text.get_visible() and id(text) not in ticks and not isinstance(text, Text3D):
            extent = text.get_window_extent()
            assert box.x0 <= extent.x0 <= extent.x1 <= box.x1, text
            assert box.y0 <= extent.y0 <= extent.y1 <= box.y1, text


def tick_boxes(ax, names):
    """Where the numbers of these axes stand on the page, those within the limits."""
    boxes = []
    for axis in (getattr(ax, f"{name}axis") for name in names):
        low, high = sorted(axis.get_view_interval())
        for tick in axis.get_major_ticks():
            if low <= tick.get_loc() <= high and tick.label1.get_visible() and tick.label1.get_text():
                boxes.append(tick.label1.get_window_extent())
    return boxes


def touching(boxes, pixels=8):
    """Pairs of boxes with less than so many pixels between them: read as one number, if they are numbers."""
    wide = [box.padded(pixels / 2) for box in boxes]
    return [(a, b) for a, b in itertools.combinations(wide, 2) if a.overlaps(b)]


def panels(figure):
    """Axes that are maps, row by row."""
    return [ax for ax in figure.axes if ax.get_label() == "panel"]


@pytest.fixture(scope="module")
def fine() -> Figure:
    """A map on cells of 10 mm, laid out."""
    plane = {"x": np.linspace(0.1, 0.7, 61), "z": np.linspace(0.05, 0.4, 36)}
    drawn = maps.draw_elastic_map(cdpr.sweep("parallel", plane, quantities=maps.QUANTITIES))
    drawn.draw_without_rendering()
    return drawn


def test_numbers_do_not_collide(fine):
    """Of axes in space where two share a corner, of cables, and of neighbouring maps."""
    for name in ("cogiro", "parallel"):
        assert not touching(tick_boxes(laid_out(name).axes[0], "xyz"))
    for ax in laid_out("layouts").axes:
        assert not touching([text.get_window_extent() for text in ax.texts], 0)
    for axis in "xy":
        boxes = [box for ax in panels(laid_out("maps")) for box in tick_boxes(ax, axis)]
        assert len(boxes) > 4
        assert not touching(boxes)
    for drawn in (laid_out("maps"), laid_out("maps of a line"), fine):
        labels = 0
        for ax in panels(drawn):
            (x0, y0), (x1, y1) = ax.get_window_extent().get_points()
            texts = [text for one in ax.collections for text in getattr(one, "labelTexts", []) if text.get_visible()]
            boxes = [text.get_window_extent() for text in texts]
            labels += len(boxes)
            assert all(x0 <= box.x0 <= box.x1 <= x1 and y0 <= box.y0 <= box.y1 <= y1 for box in boxes)
            assert not touching(boxes, 0)
        assert labels > (3 if drawn is fine else 1)


def test_names_of_meeting_points_stand_beside_them():
    """H and V within 50 mm of their points on the drawing; the legend ends before the frame."""
    for ax in laid_out("tilt-condition").axes:
        point = by_gid(ax)["meeting point"].get_xydata()[0]
        name = next(text for text in ax.texts if text.get_text() in ("H", "V", "intersection"))
        box = name.get_window_extent().transformed(ax.transData.inverted())
        apart = np.maximum([box.x0 - point[0], box.y0 - point[1]], [point[0] - box.x1, point[1] - box.y1]).max()
        assert apart < 0.05
    assert ax.get_legend().get_window_extent().transformed(ax.transData.inverted()).x1 < 0.79


@pytest.mark.parametrize("name", ["planar-vertical", "parallel"])
def test_every_zone_is_named_in_the_legend(name):
    """Also one that only the stiffer cables have, whose axes have no legend."""
    zones = [patch for ax in figure(name).axes for patch in ax.patches if str(patch.get_gid()).startswith("zone")]
    (one,) = [one for ax in figure(name).axes if (one := ax.get_legend()) and "left" in str(one.get_texts()[0])]
    entries = {text.get_text(): patch for text, patch in zip(one.get_texts(), one.legend_handles, strict=True)}
    assert len(zones) == 2
    for zone in zones:
        count = int(str(zone.get_gid()).split("-")[1])
        entry = entries[f"{count} cable{'s' * (count > 1)} slack"]
        assert same_color(entry.get_facecolor(), zone.get_facecolor())
        assert entry.get_hatch() == zone.get_hatch()


def test_a_commanded_pose_is_drawn_over_the_platform_that_hangs_there():
    """Not under it."""
    patches = figure("planar-horizontal").axes[0].patches
    outlines = [patch.get_zorder() for patch in patches if same_color(patch.get_edgecolor(), style.COMMANDED)]
    platforms = [patch.get_zorder() for patch in patches if same_color(patch.get_facecolor(), style.PLATFORM)]
    assert min(outlines) > max(platforms)


def test_a_file_depends_on_the_results_alone():
    """No dates, no random ids; a user's style does not get in, and the house's style is not left behind."""
    width, before = made("planar-vertical"), dict(matplotlib.rcParams)
    few = dataclasses.replace(width, lines=width.lines[:1])
    once = paper_figures.encoded(lines_figures.planar(few), "svg")
    assert dict(matplotlib.rcParams) == before
    with matplotlib.rc_context({"font.size": 30, "lines.linewidth": 9, "axes.facecolor": "black"}):
        assert paper_figures.encoded(lines_figures.planar(few), "svg") == once
    others = dataclasses.replace(few, lines=width.lines[1:])
    assert paper_figures.encoded(lines_figures.planar(others), "svg") != once


NAME = "机器人"
"""Letters that DejaVu Sans lacks."""


def test_names_in_any_script_are_drawn_without_warnings_by_a_font_that_has_them(monkeypatch):
    """With a font where one is installed, and with boxes where there is none."""
    robot = cdpr.load_robot("two-cable").replace(name=NAME)
    dataset = cdpr.sweep(robot, {"x": [0.3, 0.4], "z": [0.1, 0.2]}, quantities=maps.QUANTITIES)
    for installed in (True, False):
        if not installed:
            plain = [font for font in font_manager.fontManager.ttflist if font.name == "DejaVu Sans"]
            monkeypatch.setattr(font_manager.fontManager, "ttflist", plain)
            lettering.richest.cache_clear()
        text, font = lettering.legible(NAME)
        assert (text == "□□□") == (font is None)
        for one in (cdpr.draw(robot), maps.draw_elastic_map(dataset)):
            one.savefig(io.BytesIO())  # warnings are errors in these tests
            assert any(text in word.get_text() for word in one.findobj(Text))
    lettering.richest.cache_clear()


# Maps


def meshes(ax) -> list[QuadMesh]:
    """The last drawn last."""
    return [artist for artist in ax.collections if isinstance(artist, QuadMesh)]


def bars(figure):
    """Axes that are colour bars."""
    return [ax for ax in figure.axes if ax.get_label() == "<colorbar>"]


def test_maps_fill_their_panels():
    """Whatever part of its frame a grid covers: the cells reach from edge to edge, also of coarse and slender grids.

    Bars are as high as their panels; a grid that is too slender is not to scale, else its panel could not be read.
    """
    for plane, slope in (
        ({"x": [0.3, 0.5], "z": [0.1, 0.15, 0.2]}, 0.15 / 0.4),
        ({"x": np.linspace(0.1, 0.7, 12), "z": [0.2, 0.21]}, maps.SLOPES[0]),
        ({"x": [0.4, 0.41], "z": [0.1, 0.3]}, maps.SLOPES[1]),
    ):
        drawn = maps.draw_elastic_map(cdpr.sweep("cogiro", plane, quantities=maps.QUANTITIES), names=["slack_count"])
        drawn.draw_without_rendering()
        for ax, bar in zip(panels(drawn), bars(drawn), strict=True):
            corners = meshes(ax)[-1].get_coordinates()
            assert [*ax.get_xlim()] == pytest.approx(corners[0, [0, -1], 0], rel=1e-9)
            assert [*ax.get_ylim()] == pytest.approx(corners[[0, -1], 0, 1], rel=1e-9)
            box = ax.get_window_extent()
            assert box.height / box.width == pytest.approx(slope, rel=0.02)
            assert bar.get_window_extent().intervaly == pytest.approx(box.intervaly)


def test_maps_stand_under_their_names_and_one_robots_are_no_strip():
    """Robots and materials above each column; above a robot's first, the frame to scale; one robot's go two by two."""
    drawn = laid_out("maps")
    first = panels(drawn)[:4]
    names = [ax.texts[0].get_text() for ax in first]
    assert names == [f"{name}\n{one}" for name in ("parallel", "cogiro") for one in ("vectran-0.7mm", "fishing-0.4mm")]
    for ax in first:
        box, name = ax.get_window_extent(), ax.texts[0].get_window_extent()
        assert (name.x0, name.y0 > box.y1) == (pytest.approx(box.x0, abs=2), True)
    assert [len(ax.child_axes) for ax in first] == [1, 0, 1, 0]
    for ax in first[::2]:
        box, name = ax.child_axes[0].get_window_extent(), ax.texts[0].get_window_extent()
        assert box.width / box.height == pytest.approx(0.8 / 0.5, rel=0.05)
        assert name.y1 < box.y0
    drawn = laid_out("maps of one robot")
    width, height = drawn.get_size_inches()
    assert 0.8 < width / height < 2.5
    assert not touching([ax.get_window_extent() for ax in drawn.axes], 0)


@pytest.mark.parametrize("plane", [{"x": [0.3, 0.4], "y": [0.2, 0.3]}, {"y": [0.2, 0.25, 0.3], "z": [0.1, 0.2]}])
def test_any_plane_can_be_drawn(plane):
    """Seen from above and along x as well: the first axis to the right, the second up."""
    data = cdpr.sweep("parallel", plane)
    (ax,) = panels(maps.draw_elastic_map(data, names=["tilt"]))
    assert (ax.get_xlabel(), ax.get_ylabel()) == tuple(f"{name} [m]" for name in plane)
    shown = np.degrees(data["tilt"].squeeze().transpose(*[*plane][::-1]))
    np.testing.assert_allclose(meshes(ax)[-1].get_array(), shown)


def test_a_map_through_all_outcomes_shows_the_worst_and_each_has_a_colour():
    """Also those that nobody wants to see."""
    assert set(style.MAP_OUTCOMES) == set(OUTCOMES)
    drawn = maps.draw_agreement_map(cdpr.check("cogiro", (2, 2, 2)).across())
    assert any("the worst along y" in text.get_text() for text in drawn.texts)


DICHROMATS = {
    "deuteranopia": [[0.367, 0.861, -0.228], [0.280, 0.673, 0.047], [-0.012, 0.043, 0.969]],
    "protanopia": [[0.152, 1.053, -0.205], [0.115, 0.786, 0.099], [-0.004, -0.048, 1.052]],
}
"""Linear RGB as seen without one kind of cones: Machado, Oliveira and Fernandes, doi:10.1109/TVCG.2009.113, table 1."""

APART = 15.0
"""CIE 1976 colour difference; 2.3 is just noticeable side by side. Green and red of the same lightness have 14."""


def as_seen(color: str, eye: str) -> np.ndarray:
    """CIE L*a*b* of an sRGB colour seen by such an eye."""
    rgb = np.array(to_rgb(color))
    linear = np.where(rgb <= 0.04045, rgb / 12.92, ((rgb + 0.055) / 1.055) ** 2.4)
    seen = np.clip(np.array(DICHROMATS[eye]) @ linear, 0, 1)
    xyz = np.array([[0.4125, 0.3576, 0.1804], [0.2127, 0.7152, 0.0722], [0.0193, 0.1192, 0.9503]]) @ seen
    x, y, z = (np.cbrt(v) if v > 0.00886 else 7.787 * v + 16 / 116 for v in xyz / [0.9505, 1.0, 1.0888])
    return np.array([116 * y - 16, 500 * (x - y), 200 * (y - z)])


@pytest.mark.parametrize("eye", DICHROMATS)
@pytest.mark.parametrize("name", ["outcomes", "cables left, right, and the feasible workspace", "zones", "feasible"])
def test_colours_that_mean_different_things_are_told_apart_by_colour_blind_readers(name, eye):
    """Where colour alone tells them apart, without a line style, a marker or a hatch."""
    colors = {
        "outcomes": [*style.MAP_OUTCOMES.values()],
        "cables left, right, and the feasible workspace": [style.LEFT, style.RIGHT, style.GREEN, style.INK],
        "zones": ["white", style.ZONES[0][0], style.ZONES[1][0]],
        "feasible": [style.MAP_FEASIBLE, style.MAP_INFEASIBLE, style.MAP_BORDER],
    }[name]
    for a, b in itertools.combinations(colors, 2):
        assert np.linalg.norm(as_seen(a, eye) - as_seen(b, eye)) > APART, (a, b)


@pytest.mark.parametrize("largest", [1e-9, 0.062, 0.3, 1, 1.9, 2.2, 4.9, 7, 41.2, 64, 99.9, 3e5])
def test_levels_are_three_to_six_round_numbers(largest):
    """1, 2 or 5 times a power of ten apart, the highest within the data."""
    levels = maps._round_levels(largest)
    assert 2 <= len(levels) <= 6
    assert levels[-1] <= largest * (1 + 1e-9)
    assert levels[-1] + levels[0] > largest
    digits = levels[0] / 10 ** np.floor(np.log10(levels[0]) + 1e-9)
    assert round(digits, 6) in (1, 2, 5)


def test_the_smallest_tilt_is_not_told_apart():
    """Half of a degree's thousandth is said to be less than one."""
    data = cdpr.sweep("cogiro", {"x": [0.3, 0.5], "z": [0.1, 0.2]})
    data["tilt"][:] = np.radians(5e-4)
    (ax,) = panels(maps.draw_elastic_map(data, names=["tilt"]))
    assert ax.get_title(loc="left") == "less than 0.001°"


def border(ax) -> np.ndarray:
    """Vertices of the green contour."""
    for collection in ax.collections:
        if any(same_color(color, style.MAP_BORDER) for color in collection.get_edgecolor()):
            return np.concatenate([path.vertices for path in collection.get_paths()])
    return np.empty((0, 2))


def on_border(robot: cdpr.Robot, x: float, z: float) -> bool:
    """HiGHS holds the pose just inside, and not the one just outside."""
    inwards = BORDER if x < 0.4 else -BORDER
    inside, outside = ([x + way, robot.home[1], z] for way in (inwards, -inwards))
    return feasible_by_linprog(robot, inside) and not feasible_by_linprog(robot, outside)


def test_borders_are_where_linear_programming_finds_them(fine):
    """On maps, and the outline of the feasible workspace: between the poses, and not around the cells."""
    robot = cdpr.load_robot("parallel")
    for ax in (panels(fine)[0], panels(fine)[-1]):
        vertices = border(ax)
        assert len(vertices) > 40
        assert all(on_border(robot, x, z) for x, z in vertices[:: len(vertices) // 12])
    assert all(on_border(robot, x, z) for x, _, z in lines.feasible_outline(robot, columns=31, rows=5))
    data = cdpr.sweep(robot, (5, 1, 4), quantities=["feasible", "capacity_margin"])
    assert ((data["capacity_margin"] >= 0) == data["feasible"]).all()
    assert "capacity_margin" not in cdpr.sweep(robot, (2, 1, 2))  # only where asked for: it takes as long


# Studies


def test_studies_go_through_layouts_materials_and_heights(monkeypatch):
    """The stiffer material first, as everywhere; poses are drawn of the softer one; MuJoCo rests on the line."""
    materials = ["vectran-0.7mm", "fishing-0.4mm"]
    found = lines.paper_lines(static_rows=3, settled_rows=2)
    asked = [(one.robot.name, one.robot.material, one.height) for one in found]
    assert asked == [*itertools.product(("parallel", "cogiro"), materials, (0.1, 0.2))]
    for one in found:
        np.testing.assert_allclose(one.settled.positions, one.static.positions[::2], atol=1e-6)
        np.testing.assert_allclose(commanded(one.static), [0.17, 0.4, 0.63])
    homes = lines.homes()
    assert [one.robot.name for one in homes] == ["planar-vertical", "planar-horizontal", "parallel", "cogiro"]
    monkeypatch.setattr(lines, "feasible_outline", functools.partial(lines.feasible_outline, columns=7, rows=3))
    width = lines.across_the_width(cdpr.load_robot("planar-vertical"), static_rows=3, settled_rows=2)
    assert [line.robot.material for line in width.lines] == materials
    assert width.poses.robot.material == "fishing-0.4mm"

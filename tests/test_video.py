"""Videos: as many frames as asked for, showing what the trajectory says, by either renderer, whole or not there.

Of a scene all shapes, and of a page all words, are compared with those reviewed in ``snapshots/film/``.
"""

import base64
import dataclasses
import itertools
import os
import re
import signal
import subprocess
import sys
import threading
from contextlib import suppress
from pathlib import Path
from types import SimpleNamespace
from typing import NamedTuple

import made_up
import matplotlib
import mediapy
import mujoco
import numpy as np
import pytest
from artists import color, numbers
from drawn_figures import UP, rests
from PIL import ImageDraw
from scipy.spatial.transform import RigidTransform, Rotation
from typer.testing import CliRunner

import cdpr_sim as cdpr
from cdpr_sim.cli import app
from cdpr_sim.drawing import style
from cdpr_sim.drawing.video import frame_layout, raycast, render, scene, writing

VIEW = (320, 240)

SAME_SHADE = 24
"""[of 255] Two renderers' pixels may differ by this much: highlights, which ours leaves out, measure up to 20."""

EDGES = 0.03
"""Fraction of pixels that may differ by more: round shapes have twelve sides in OpenGL and none in ours, and pixels at
their edges are sampled at other points. Measured 0.9 %; drawing the platform 5 mm aside adds 1 %, see the control."""

MOVED = 5e-3
"""[m] What the comparison of two renderers must notice."""

TRACKED = 0.12
"""Between the way of a blob's centre and of its body's. Measured 0.095: from end to end of the line, other faces come
into view. The commanded way is 0.18 longer."""

SINGLE = 1e-4
"""Relative: MuJoCo keeps shapes in single precision."""

PIXEL = 5e-3
"""Relative to a place on a page: letters of another version of Pillow may be a pixel wider."""

QUICK = dict(seconds=0.4, fps=10, size=(320, 240), renderer="raycast")


@pytest.fixture(scope="module")
def parallel() -> cdpr.Trajectory:
    """`parallel` at rest along the paper's line: four cables are slack at its ends."""
    along = np.linspace([0.17, 0.25, 0.1], [0.63, 0.25, 0.1], 21)
    return cdpr.Trajectory.through(cdpr.solve_many(cdpr.load_robot("parallel"), along), np.linspace(0, 60, 21))


@pytest.fixture(scope="module")
def static(parallel) -> RigidTransform:
    """Poses for the outline, 60 mm higher than the platform's."""
    return RigidTransform.from_components(parallel.positions + np.array([0, 0, 0.06]), parallel.poses.rotation)


# Scenes


def shapes_of(stage: scene.Stage) -> str:
    """Every shape of the scene, and where the cameras are."""
    kinds, lines = {value: name for name, value in raycast.SHAPES.items()}, []
    for geom in stage.scene.geoms[: stage.scene.ngeom]:
        what = mujoco.mjtObj(geom.objtype).name.removeprefix("mjOBJ_").lower()
        what += f" {geom.objid}" * (what != "unknown") + f", shines {geom.emission:g}" * (geom.emission > 1)
        turn = geom.mat.reshape(3, 3)
        where = f"{numbers(geom.pos)}; {numbers(np.abs(turn) @ geom.size)}; {numbers(turn[:, 2])}"
        lines.append(f"{kinds[geom.type]} {what}: {color(geom.rgba)}: {where}")
    for one in (stage.whole(1.5), stage.close_up()):
        lines.append(f"camera at {numbers(one.lookat)}, {one.distance:.6g} m: {one.azimuth:g}° {one.elevation:g}°")
    return "\n".join(lines)


def real() -> cdpr.Trajectory:
    """Over pulleys, the second and the third cable with mass; the first is slack in the second state."""
    some = dict(pulley_radius=0.02, pulley_axis=UP, linear_density=[0, 1e-3, 1e-3] + 5 * [0])
    robot = cdpr.load_robot("cogiro").replace(**some)
    return cdpr.Trajectory.through(rests(1, robot, [(0.3, 0.25, 0.1), (0.4, 0.3, 0.2)], [(1, 0)]), np.array([0.0, 1.0]))


SHAPES = np.random.default_rng(1).uniform(0.1, 0.4, (2, 8, 4, 3))
"""[m] Of cables: they end somewhere else, and are drawn as far as to where they do."""

SCENES = {
    "plain": (made_up.states, 3, {}),
    "with an outline": (made_up.states, 3, {"static": made_up.states().poses}),
    "three times larger": (made_up.states, 1, {"static": made_up.states().poses, "exaggeration": 3.0}),
    "real cables": (real, 1, {"shapes": SHAPES}),
}


@pytest.mark.parametrize("name", SCENES)
def test_scenes_are_as_reviewed(name, snapshot):
    """Platform, ghost, shadow, paths, outline, and every cable in its shape and colour; where the cameras are."""
    motion, step, options = SCENES[name]
    stage = scene.Stage(motion(), largest_tension=8.0, **options)
    stage.set(step)
    snapshot(f"film/scene-{name.replace(' ', '-')}.txt", shapes_of(stage), rel=SINGLE)


def test_no_tension_is_coloured_like_a_slack_cable():
    """Every colour of the scale is far from slack's, in lightness or hue, and grows darker with tension."""
    colors = scene.tension_colors(np.linspace(0, 1, 64), 1.0)
    assert np.linalg.norm(colors - style.SLACK_COLOR, axis=1).min() > 0.5
    assert (np.diff(colors @ [0.2126, 0.7152, 0.0722]) < 0).all()


@pytest.mark.parametrize("fallen", [0.0, 0.6])
def test_the_platform_stays_in_the_picture_wherever_it_goes(parallel, fallen):
    """Also beside and below its frame, where the floor goes down with it; else the camera is where it always was."""
    away = np.array([0.0, 0.0, -fallen])
    poses = RigidTransform.from_components(parallel.positions + away, parallel.poses.rotation)
    motion = cdpr.Trajectory.of(parallel.problems, parallel.times, poses, parallel.lengths, parallel.tensions)
    stage, (width, height) = scene.Stage(motion, largest_tension=2.0), (480, 300)
    camera = stage.whole(width / height)
    corners = np.array([*itertools.product((-0.5, 0.5), repeat=3)]) * motion.robot.platform_size
    axes, center = scene._camera_axes(), np.array(camera.lookat)
    for step in (0, len(motion) // 2, len(motion) - 1):
        stage.set(step)
        seen = (stage.poses[step].apply(corners) - center) @ axes.T
        sides = np.abs(seen[:, :2]) / (camera.distance - seen[:, 2:])
        assert (sides < np.tan(np.radians(style.FIELD_OF_VIEW) / 2) * np.array([width / height, 1])).all()
        assert stage.poses[step].apply(corners)[:, 2].min() >= stage.data.geom("floor").xpos[2] - 1e-12
    usual = scene.Stage(parallel, largest_tension=2.0)
    assert (usual.whole(1.6).distance < stage.whole(1.6).distance) == (fallen > 0)
    assert (usual.model.geom("floor").pos[2] > stage.model.geom("floor").pos[2]) == (fallen > 0)


# Renderers


def opengl(model: mujoco.MjModel) -> render.Renderer:
    """OpenGL, or a test that is skipped and says why."""
    try:
        return render.open_renderer(model, *VIEW, "opengl")
    except render.OpenGLUnavailable as error:
        pytest.skip(f"nothing to compare with: {error}")


def unlike(one: np.ndarray, other: np.ndarray) -> float:
    """Fraction of pixels that differ in more than shading."""
    return float((np.abs(one.astype(int) - other.astype(int)).max(2) > SAME_SHADE).mean())


@pytest.mark.parametrize("name", ["parallel", "two-cable"])
def test_both_renderers_give_the_same_picture_up_to_shading(name):
    """OpenGL and the ray caster agree on all but shading and edges; a platform 5 mm aside is noticed."""
    robot = cdpr.load_robot(name)
    pose = [0.25, 0.0 if robot.mobility == "planar" else 0.25, 0.15]
    motion = cdpr.Trajectory.through(cdpr.solve_many(robot, [pose] * 2), np.array([0.0, 1.0]))
    stage = scene.Stage(motion, motion.poses, largest_tension=2.0)
    theirs, ours = opengl(stage.model), raycast.RayCaster(stage.model)
    stage.set(1)
    try:
        for camera in (stage.whole(VIEW[0] / VIEW[1]), stage.close_up()):
            stage.look(camera)
            true = theirs.start(stage.scene, *VIEW)()
            alike = unlike(true, ours.start(stage.scene, *VIEW)())
            assert alike < EDGES
        for geom in stage.scene.geoms[: stage.scene.ngeom]:
            if geom.type == raycast.BOX and geom.objtype == mujoco.mjtObj.mjOBJ_GEOM:
                geom.pos[:] += [MOVED, 0, 0]
        assert unlike(true, ours.start(stage.scene, *VIEW)()) > alike + 0.005
    finally:
        theirs.close()
        ours.close()


@pytest.mark.parametrize("kind", sorted(raycast.SHAPES))
def test_each_shape_is_cast_as_opengl_draws_it(kind):
    """One shape alone, tilted, before an empty sky."""
    model = mujoco.MjModel.from_xml_string(
        "<mujoco><worldbody><light pos='1 1 3' dir='-0.3 0.4 -1' directional='true'/></worldbody></mujoco>"
    )
    model.vis.quality.numslices = model.vis.quality.numstacks = 64
    theirs, ours = opengl(model), raycast.RayCaster(model)
    shapes, camera, data = mujoco.MjvScene(model, maxgeom=10), mujoco.MjvCamera(), mujoco.MjData(model)
    camera.distance, camera.elevation = 2.0, -30.0
    mujoco.mj_forward(model, data)
    everything = mujoco.mjtCatBit.mjCAT_ALL.value
    mujoco.mjv_updateScene(model, data, mujoco.MjvOption(), None, camera, everything, shapes)
    nothing = ours.start(shapes, *VIEW)()
    size = {"SPHERE": [0.3] * 3, "CAPSULE": [0.15, 0.15, 0.3], "CYLINDER": [0.15, 0.15, 0.3]}.get(kind, [0.2, 0.3, 0.4])
    turn = np.eye(3) if kind == "PLANE" else Rotation.from_euler("xyz", [0.5, 0.9, 0.3]).as_matrix()
    paint = np.float32([0.8, 0.3, 0.2, 1])
    mujoco.mjv_initGeom(shapes.geoms[0], raycast.SHAPES[kind], np.array(size), np.zeros(3), turn.ravel(), paint)
    shapes.ngeom = 1
    shapes.flags[mujoco.mjtRndFlag.mjRND_SHADOW] = shapes.flags[mujoco.mjtRndFlag.mjRND_SKYBOX] = False
    try:
        drawn, cast = (picture.astype(int) for picture in (theirs.start(shapes, *VIEW)(), ours.start(shapes, *VIEW)()))
    finally:
        theirs.close()
        ours.close()
    inside_theirs = np.abs(drawn - drawn[0, 0]).max(2) > 8
    inside_ours = np.abs(cast - nothing).max(2) > 8
    assert inside_ours.mean() > 0.02
    assert (inside_theirs != inside_ours).mean() < 0.004
    assert np.median(np.abs(drawn - cast).max(2)[inside_theirs & inside_ours]) < SAME_SHADE


def test_what_stands_still_is_not_drawn_again_and_looks_the_same(parallel, static):
    """Every picture of a caster that has drawn others before is, bit for bit, that of one that has not."""
    stage = scene.Stage(parallel, static, largest_tension=2.0)
    used, size = raycast.RayCaster(stage.model), (160, 120)
    whole, other, floor = stage.whole(4 / 3), stage.whole(2.0), stage.model.geom("floor").id
    moves = {
        "a rod of the frame": lambda geoms: geoms[5].pos.__setitem__(0, geoms[5].pos[0] + 0.1),
        "the floor's colour": lambda geoms: geoms[floor].rgba.__setitem__(0, 0.5),
        "a light": lambda geoms: stage.scene.lights[0].diffuse.__setitem__(slice(None), 0.2),
    }
    known = []
    shots = [(whole, False), (whole, False), (other, False), (other, False), (other, True)]
    for step, (move, (camera, now)) in enumerate(itertools.product(moves, shots)):
        stage.set(step)
        stage.look(camera)
        if now:
            moves[move](stage.scene.geoms)
        fresh = raycast.RayCaster(stage.model)
        np.testing.assert_array_equal(used.start(stage.scene, *size)(), fresh.start(stage.scene, *size)(), err_msg=move)
        known.append(used._backdrops[size].known)
        fresh.close()
    used.close()
    assert max(known) > 10  # that much of the frame was not drawn again


def project(stage: scene.Stage, points: np.ndarray, width: int, height: int) -> np.ndarray:
    """Columns and rows of points [m] in the picture from the scene's camera."""
    camera = stage.scene.camera[0]
    forward, up = np.array(camera.forward), np.array(camera.up)
    offset = points - np.array(stage.scene.camera[0].pos) / 2 - np.array(stage.scene.camera[1].pos) / 2
    scale = height * camera.frustum_near / (camera.frustum_top - camera.frustum_bottom) / (offset @ forward)
    return np.stack([width / 2 + scale * (offset @ np.cross(forward, up)), height / 2 - scale * (offset @ up)], axis=-1)


def test_the_platforms_pixels_are_where_its_pose_is(parallel):
    """The blue of the platform is where its pose projects, and not where it was commanded; it moves along."""
    stage = scene.Stage(parallel, largest_tension=2.0)
    caster, whole, moves = raycast.RayCaster(stage.model), stage.whole(4 / 3), []
    for step in (0, 20):
        stage.set(step)
        for camera in (stage.close_up(), whole):
            stage.look(camera)
            red, green, blue = caster.start(stage.scene, 480, 360)().astype(int).transpose(2, 0, 1)
            rows, columns = np.nonzero((blue > 1.35 * green) & (blue > 2.5 * red))
            blob = np.array([columns.mean(), rows.mean()])
            at, commanded = (
                project(stage, poses[step].translation, 480, 360) for poses in (parallel.poses, parallel.commanded)
            )
            assert np.linalg.norm(blob - at) < 0.65 * np.linalg.norm(blob - commanded)
        moves.append((blob, at))
    caster.close()
    (first, start), (last, end) = moves
    assert abs(end[0] - start[0]) > 100
    np.testing.assert_allclose(last - first, end - start, rtol=TRACKED, atol=1.0)


def test_slack_cables_have_the_legends_colour_in_shade_as_well(parallel):
    """On their dark side too: every vermilion pixel is the legend's or mixed with its neighbours."""
    frame = next(writing.VideoFrames(parallel, seconds=2, fps=1, size=(960, 720), renderer="raycast").frames())
    red, green, blue = np.moveaxis(frame.astype(float) / 255, -1, 0)
    slack = (red > 2.5 * green) & (red > 4 * blue)
    assert slack.sum() > 500
    assert np.quantile(red[slack], 0.02) > 0.8 * style.SLACK_COLOR[0]


def test_without_any_opengl_the_ray_caster_draws(parallel, monkeypatch):
    """Where neither EGL nor OSMesa loads, "auto" falls back, and "opengl" says in a sentence what was tried."""
    monkeypatch.setattr(render, "_candidates", lambda: ["no_such_module", "nor_this"])
    stage = scene.Stage(parallel, largest_tension=2.0)
    assert isinstance(render.open_renderer(stage.model, *VIEW), raycast.RayCaster)
    with pytest.raises(render.OpenGLUnavailable, match=r"no_such_module: .*; nor_this: "):
        render.open_renderer(stage.model, *VIEW, "opengl")


def test_no_environment_variable_is_needed_or_left_behind(monkeypatch):
    """EGL, then OSMesa; MUJOCO_GL, where set, chooses; a failed attempt leaves PyOpenGL free for the next."""
    monkeypatch.setattr(sys, "platform", "linux")
    for wanted, names in {"": ["egl", "osmesa"], "osmesa": ["osmesa", "egl"], "disable": []}.items():
        monkeypatch.setenv("MUJOCO_GL", wanted)
        assert render._candidates() == names
    monkeypatch.setenv("PYOPENGL_PLATFORM", "wrong")
    render._forget("egl", None)
    assert "PYOPENGL_PLATFORM" not in os.environ


# The page around the pictures


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


def films(size: tuple[int, int] = (1280, 720), exaggeration: float = 3.0, outlined: bool = True) -> writing.VideoFrames:
    """Two motions, the second with a tenth of the tensions."""
    motion = made_up.states()
    both = [motion, dataclasses.replace(motion, tensions=motion.tensions / 10)]
    static = [None, motion.poses] if outlined else None
    return writing.VideoFrames(both, static, None, 0.5, 4.0, size, exaggeration, "raycast", None)


@pytest.mark.parametrize("how", [(1280, 720), (480, 640), (320, 240), "to scale, without an outline"], ids=str)
def test_pages_are_as_reviewed(how, monkeypatch, snapshot):
    """Every word and shape, its colour, size and place: names, captions, legend, scales, numbers, pictures, bars."""
    lines: list[str] = []

    def paint(value) -> str:
        return color(np.array(value) / 255) if isinstance(value, tuple) else format(value or "", "g" * bool(value))

    def told(kind: str):
        drawn = getattr(ImageDraw.ImageDraw, kind)

        def tell(self, at, *args, **options):
            words = [paint(one) for one in (*args, *options.values()) if isinstance(one, tuple | int | float)]
            words += [f"“{args[0]}” {args[2].size} {options.get('anchor', '')}"] if kind == "text" else []
            if not (kind == "line" and at[0] == at[2]):  # a column of the colour scale
                lines.append(f"{kind} {numbers(at)} {' '.join(words)}")
            return drawn(self, at, *args, **options)

        monkeypatch.setattr(ImageDraw.ImageDraw, kind, tell)

    for kind in ("text", "rectangle", "line", "arc", "bitmap"):
        told(kind)
    with films(how) if isinstance(how, tuple) else films((1280, 720), 1.0, outlined=False) as shown:
        next(shown.frames())
    snapshot(f"film/page-{how[0] if isinstance(how, tuple) else 'to-scale'}.txt", "\n".join(lines), rel=PIXEL)
    assert [stage.largest_tension for stage in shown.stages] == [6.0, 6.0]  # above the harder pull


def a_page(size=(640, 360), robots=1) -> frame_layout.Page:
    several = [cdpr.load_robot("planar-vertical")] * robots
    texts = [["caption" * 30]] * robots
    return frame_layout.Page(size, several, texts, largest_tension=2.0, footnote="foot" * 70, outlined=True)


def a_frame(of: frame_layout.Page, tensions, slack) -> np.ndarray:
    count = len(of.cells)
    views = [np.zeros((cell.view.height, cell.view.width, 3), np.uint8) for cell in of.cells]
    close_ups = [np.zeros((cell.close_up.height, cell.close_up.width, 3), np.uint8) for cell in of.cells]
    state = np.radians(26.0), np.array([3e-3, 4e-3, -12.3e-3]), np.asarray(tensions), np.asarray(slack)
    return of.frame(views, close_ups, *([one] * count for one in state))


SIZES = [(320, 240), (640, 360), (480, 640), (640, 480), (1280, 720), (400, 900), (1920, 300)]


@pytest.mark.parametrize(("size", "robots"), [*itertools.product(SIZES, (1, 2)), *itertools.product(SIZES, (4, 6))])
def test_a_page_of_any_size_has_room_for_everything(size, robots):
    """No area is empty, leaves the page or overlaps another; the view is the largest, the heading above all others."""
    of, every = a_page(size, robots), []
    for cell in of.cells:
        own = [cell.heading, cell.view, cell.close_up, cell.numbers, cell.bars]
        every += own
        if robots < 3:
            assert cell.view.width * cell.view.height > max(one.width * one.height for one in (own[0], *own[2:]))
            assert cell.heading.bottom <= min(one.top for one in own[1:])
            assert all(one.left >= cell.view.right or one.top >= cell.view.bottom for one in own[2:])
            assert cell.close_up.top <= cell.numbers.top <= cell.bars.top
            assert cell.close_up.left <= cell.numbers.left <= cell.bars.left
    for one in every:
        assert 0 <= one.left < one.right <= size[0]
        assert 0 <= one.top < one.bottom <= size[1]
    for one, other in itertools.combinations(every, 2):
        apart = one.right <= other.left or other.right <= one.left
        assert apart or one.bottom <= other.top or other.bottom <= one.top
    assert a_frame(of, [0.0, 0.5, 2.0, 1.0], [True, False, False, False]).shape == (size[1], size[0], 3)


def test_bars_are_as_high_and_dark_as_their_tensions(written):
    """On a scale of 0, 1 and 2 N, over the numbers of their cables, in the colours of the legend's scale."""
    of = a_page()
    frame = a_frame(of, [0.5, 1.0, 2.0, 0.0], [False, False, False, True]).astype(int)
    chart, paper = of._chart(of.cells[0].bars), np.array(frame_layout._rgb(style.PAGE_PAPER))
    heights = {word.text: word.y for word in written if word.x < chart.left and chart.top <= word.y < chart.bottom}
    assert list(heights) == ["0", "1", "2"]
    under = [word for word in written if word.y > chart.bottom and chart.left < word.x < chart.right]
    under = sorted({word.x: word for word in under[:4] + under[-1:]}.items())  # a slack cable's is written again
    least, most = (next(word for word in written if word.text == end) for end in ("0", "2 N"))
    scale = frame[int(most.y), int(least.x) : int(most.x)]
    scale = scale[np.ptp(scale, axis=1) > 30]  # without the paper on both sides, and what is written
    for number, ((at, word), tension) in enumerate(zip(under, (0.5, 1.0, 2.0, 0.0), strict=True), start=1):
        assert word.text == str(number)
        assert word.color == frame_layout._rgb(style.SLACK_COLOR if number == 4 else style.PAGE_INK)
        filled = np.abs(frame[chart.top : chart.bottom, int(at)] - paper).max(1) > 60
        if number == 4:
            assert filled.mean() < 0.5  # the frame's two lines, and the word along it
            continue
        true = np.interp(tension, [0, 1, 2], [*heights.values()])
        assert chart.top + np.flatnonzero(filled)[0] == pytest.approx(true, abs=1)
        bar, share = frame[chart.bottom - 3, int(at)], tension / 2
        assert np.abs(bar - scale[round(share * (len(scale) - 1))]).max() <= 4
        assert np.abs(bar - 255 * np.array(matplotlib.colormaps["viridis"](0.58 * (1 - share))[:3])).max() <= 1
    heavy = a_frame(of, [0.0, 0.5, 2.0, 1.0], [True, False, False, True]).astype(int)
    column = heavy[chart.top : chart.bottom, int(under[3][0]) + 12]
    assert (np.abs(column - paper).max(1) > 60).mean() == pytest.approx(0.5, abs=0.06)  # slack, and its weight pulls
    edge = heavy[(chart.top + chart.bottom) // 2, chart.left : int(under[0][0])]
    assert np.abs(edge - frame_layout._rgb(style.SLACK_COLOR)).max(1).min() == 0


def test_the_legends_swatches_have_the_colours_of_what_they_name(written):
    """Blue for MuJoCo's platform, a yellow edge for the static solver's, vermilion for a slack cable; grey between."""
    blank = np.asarray(a_page()._blank).astype(int)
    named = {word.text: (int(word.x), int(word.y)) for word in written}
    paints = [frame_layout._rgb(one) for one in (style.PLATFORM_COLOR, style.STATIC_COLOR, style.SLACK_COLOR)]
    for name, expected in {
        "platform in MuJoCo": [True, False, False],
        "commanded": [False, False, False],
        "static solver": [True, True, False],
        "slack cable": [False, False, True],
    }.items():
        x, y = named[name]
        swatch = blank[y - 7 : y + 7, x - 22 : x - 2].reshape(-1, 3)
        assert [bool((np.abs(swatch - paint).max(1) <= 2).any()) for paint in paints] == expected, name


@pytest.mark.parametrize(("size", "count"), [((800, 450), 2), ((640, 360), 1), ((1280, 720), 2)])
def test_headings_are_whole(written, catalogue, size, count):
    """Of every robot, at the sizes that are shown: what does not fit gives way to fewer words, and never breaks off."""
    for name, robot in catalogue.items():
        written.clear()
        robot = robot.replace(description="with a description as long as those that people like to write")
        captions = writing._captions(SimpleNamespace(robot=robot))
        frame_layout.Page(size, [robot] * count, [captions] * count, largest_tension=2.0, footnote="", outlined=True)
        said = [word.text for word in written]
        assert said.count(name) == count
        assert sum(said.count(text) for text in captions) == count
        assert not [text for text in said if text.endswith("…")]


def test_the_page_says_what_is_shown(parallel):
    """What happens, how fast, and with which cables, from long to short."""
    driven = dataclasses.replace(parallel, status=np.full(21, int(cdpr.Status.MOVING)))
    for seconds, speed in ((60.0, "in real time"), (10.0, "6 times faster"), (120.0, "2 times slower")):
        assert writing._footnote([driven], seconds).endswith(f"the dark line; simulated by MuJoCo, shown {speed}.")
    still = made_up.Problems.of(made_up.PLAIN, [(0.4, 0.25, 0.2)] * 6)
    released = dataclasses.replace(made_up.states(), problems=still)
    assert "released at the commanded pose" in writing._footnote([released], 1.25)
    assert "MuJoCo has settled at every state" in writing._footnote([parallel], 1.0)
    changes = dict(frame=[(0, 0, 0), (0.8, 0.5, 0.6)], pulley_radius=0.02, pulley_axis=UP)
    robot = parallel.robot.replace(material="fishing-0.4mm", **changes)
    cables = "fishing-0.4mm, EA = 1 kN, over pulleys of 20 mm radius"
    assert writing._captions(SimpleNamespace(robot=robot)) == [
        f"{cables} · platform 0.4 kg · frame 0.8 × 0.5 × 0.6 m", f"{cables} · 0.4 kg · 0.8 × 0.5 × 0.6 m",
        f"{cables} · 0.4 kg", cables, "fishing-0.4mm, EA = 1 kN",
    ]  # fmt: skip


@pytest.mark.parametrize(("value", "end"), [(1.8, 2), (2.0, 2), (0.11, 0.12), (71, 80), (0.0, 1), (9.1e-5, 1e-4)])
def test_scales_end_at_round_numbers(value, end):
    """Not below the value."""
    assert frame_layout.nice_above(value) == pytest.approx(end)


# Films


def test_every_frame_is_given_its_own_state(monkeypatch):
    """Tilt, deviation, tensions and slack cables of the state at its time, whenever the motion begins."""
    motion, given = made_up.states(), []
    drawn = frame_layout.Page.frame
    monkeypatch.setattr(frame_layout.Page, "frame", lambda self, *args: given.append(args[2:]) or drawn(self, *args))
    list(writing.VideoFrames(motion, seconds=0.6, fps=10, size=(320, 240), renderer="raycast").frames())
    for values, name in zip(zip(*given, strict=True), ("tilt", "deviation", "tensions", "slack"), strict=True):
        np.testing.assert_array_equal([one for (one,) in values], getattr(motion, name))
    fractions = np.linspace(0, 1, 41)
    steps = [writing._state_at(motion, fraction) for fraction in fractions]
    assert (steps[0], steps[-1]) == (0, 5)
    assert np.abs(np.array(steps) - 5 * fractions).max() <= 0.5 + 1e-9


@pytest.mark.parametrize("suffix", [".mp4", ".gif"])
def test_a_video_decodes_to_the_frames_and_size_asked_for(tmp_path, parallel, static, suffix):
    """Two robots side by side, 0.5 s at 12 frames a second, 322 by 242 pixels; it moves; one frame after another."""
    told: list[float] = []
    path = tmp_path / f"two{suffix}"
    cdpr.write_video(
        path, [parallel, parallel], [static, None], seconds=0.5, fps=12, size=(322, 242), renderer="raycast",
        progress=told.append,
    )  # fmt: skip
    frames = np.asarray(mediapy.read_video(path))
    assert frames.shape[:3] == (6, 242, 322)
    assert told == pytest.approx([k / 6 for k in range(1, 7)])
    assert np.abs(frames[0].astype(int) - frames[-1].astype(int)).max() > 50
    assert [file.name for file in tmp_path.iterdir()] == [path.name]


def test_frames_stream(tmp_path, parallel, monkeypatch):
    """A frame is handed to the encoder before the next is drawn, so that memory does not grow with length."""
    events, drawn = [], frame_layout.Page.frame
    monkeypatch.setattr(frame_layout.Page, "frame", lambda *a, **k: events.append("drawn") or drawn(*a, **k))
    cdpr.write_video(tmp_path / "v.mp4", parallel, progress=lambda done: events.append("written"), **QUICK)
    assert events == ["drawn", "written"] * 4


def test_a_film_is_the_same_on_any_number_of_processors(tmp_path, parallel, static, monkeypatch):
    """Byte for byte, drawn and encoded on one and on many."""
    films = []
    everywhere = os.sched_getaffinity(0) if hasattr(os, "sched_setaffinity") else None
    for processors in (1, 5):
        monkeypatch.setattr(os, "cpu_count", lambda count=processors: count)
        try:
            if everywhere and processors == 1:
                os.sched_setaffinity(0, {min(everywhere)})  # which the encoder inherits
            path = tmp_path / f"{processors}.mp4"
            cdpr.write_video(path, [parallel, parallel], [static, None], **(QUICK | {"seconds": 0.8}))
        finally:
            if everywhere:
                os.sched_setaffinity(0, everywhere)
        films.append(path.read_bytes())
    assert films[0] == films[1]


def test_show_plays_in_a_notebook(parallel, monkeypatch):
    """What the notebook is given is an H.264 video of the size asked for, embedded; on a narrow page it shrinks."""
    displayed = []
    monkeypatch.setattr("IPython.display.display", lambda thing: displayed.append(thing.data))
    cdpr.show(parallel, **QUICK)
    (html,) = displayed
    assert 'width="320" height="240" style="max-width: 100%; height: auto;' in html
    assert "<table" not in html
    data = base64.b64decode(re.search(r"data:video/mp4;base64,([^\"]+)", html).group(1))
    assert np.asarray(mediapy.decompress_video(data)).shape == (4, 240, 320, 3)


# Whole or not there


def test_a_failure_while_drawing_keeps_the_old_file(tmp_path, parallel):
    """With ``force`` too, a file is replaced only by a complete one."""
    path = tmp_path / "there.mp4"
    path.write_text("mine")

    def fail(done: float) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        cdpr.write_video(path, parallel, force=True, progress=fail, **QUICK)
    assert path.read_text() == "mine"
    assert [file.name for file in tmp_path.iterdir()] == ["there.mp4"]


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")  # mediapy leaves a pipe to be collected
@pytest.mark.parametrize(
    ("error", "said"),
    [
        (cdpr.InvalidInput, r": cannot be written: \S"),
        (cdpr.StoreError, ": cannot be written: No space left on device$"),
    ],
)
def test_an_encoder_that_fails_is_one_sentence(tmp_path, parallel, monkeypatch, error, said):
    """ffmpeg's last line, and nothing left behind; a full disk is no mistake of the user's."""
    writer = mediapy.VideoWriter

    class Full(writer):
        def close(self) -> None:
            super().close()
            raise RuntimeError("Error writing 'v.mp4': [out#0/mp4 @ 0x1] Error closing file: No space left on device\n")

    wrong = lambda *a, **k: writer(*a, **{**k, "ffmpeg_args": ["-no-such-option"]})  # noqa: E731
    monkeypatch.setattr(mediapy, "VideoWriter", Full if error is cdpr.StoreError else wrong)
    with pytest.raises(error, match=said):
        cdpr.write_video(tmp_path / "v.mp4", parallel, **QUICK)
    assert not list(tmp_path.iterdir())


DRAWING = """
import sys
from cdpr_sim.cli import main
from cdpr_sim.drawing.video import writing

frames = writing.VideoFrames.frames

def paused(pictures):
    list(frames(pictures))
    pictures.__exit__()
    for frame in frames(pictures):
        yield frame
        print("drawn", flush=True)
        sys.stdin.read()

writing.VideoFrames.frames = paused
main()
"""
"""The command, which waits when ffmpeg has a frame: so it is drawing that is interrupted, under any load. Nothing is
left to be compiled or loaded then, since all frames have been drawn once."""


@pytest.mark.skipif(os.name == "nt", reason="Windows has no process groups to send an interrupt to")
@pytest.mark.parametrize("name", ["SIGINT", "SIGTERM"])
def test_an_interrupted_command_leaves_nothing(tmp_path, name):
    """Ctrl-C in a terminal reaches Python and ffmpeg alike: no file, no temporary one, no traceback, status 128 + 2."""
    words = ["video", "planar-vertical", "--drive-seconds", "1", "--fps", "2", "--size", "320", "240", "-o", "v.mp4"]
    process = subprocess.Popen(
        [sys.executable, "-c", DRAWING, *words], cwd=tmp_path, start_new_session=True, text=True,
        env=os.environ | {"PYTHONPATH": str(Path(cdpr.__file__).parents[1])},
        stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),  # ignored where a shell runs us with &
    )  # fmt: skip
    try:
        assert process.stdout.readline() == "drawn\n", process.stderr.read()
        assert any(tmp_path.iterdir())
        os.killpg(process.pid, getattr(signal, name))
        error = process.communicate()[1]
    finally:
        with suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
        process.communicate()
    assert process.returncode == 128 + getattr(signal, name)
    assert not list(tmp_path.iterdir())
    assert "Traceback" not in error


def test_ctrl_c_ends_all_drives_at_once(tmp_path, monkeypatch):
    """One is interrupted; the other, which would go on for ever, is told; and nothing is written."""
    monkeypatch.chdir(tmp_path)
    both, ended = threading.Barrier(2), []

    def drive(robot, *_, progress, **__):
        both.wait(timeout=60)
        while robot.name == "parallel":
            try:
                progress(0.5)
            except BaseException:
                ended.append(robot.name)
                raise
        raise KeyboardInterrupt

    monkeypatch.setattr(cdpr, "drive", drive)
    result = CliRunner().invoke(app, ["video", "cogiro", "parallel"])
    assert result.exit_code == 128 + signal.SIGINT
    assert ended == ["parallel"]
    assert not list(tmp_path.iterdir())

"""Videos: as many frames as asked for, showing what the trajectory says, by either renderer, whole or not there."""

import base64
import itertools
import os
import re
import signal
import subprocess
import sys
import threading
from contextlib import suppress
from pathlib import Path

import imageio_ffmpeg
import mediapy
import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation
from typer.testing import CliRunner

import cdpr_sim as cdpr
from cdpr_sim.cli import app
from cdpr_sim.drawing import style
from cdpr_sim.drawing.video import frame_layout as panel
from cdpr_sim.drawing.video import raycast, render, scene
from cdpr_sim.drawing.video import writing as video

LINE = [[0.17, 0.25, 0.1], [0.63, 0.25, 0.1]]
"""The paper's, for DemoBot [m]."""

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


@pytest.fixture(scope="module")
def parallel() -> cdpr.Trajectory:
    """`parallel` along the paper's line, quickly."""
    return cdpr.drive(cdpr.load_robot("parallel"), LINE, seconds=60.0, states=21)


@pytest.fixture(scope="module")
def static(parallel) -> RigidTransform:
    """The static solver's poses along it."""
    return cdpr.solve_trajectory(parallel).poses


def opengl(model: mujoco.MjModel) -> render.Renderer:
    """OpenGL, or a test that is skipped and says why."""
    try:
        return render.open_renderer(model, *VIEW, "opengl")
    except render.OpenGLUnavailable as error:
        pytest.skip(f"nothing to compare with: {error}")


def unlike(one: np.ndarray, other: np.ndarray) -> float:
    """Fraction of pixels that differ in more than shading."""
    return float((np.abs(one.astype(int) - other.astype(int)).max(2) > SAME_SHADE).mean())


def project(stage: scene.Stage, points: np.ndarray, width: int, height: int) -> np.ndarray:
    """Columns and rows of points [m] in the picture from the scene's camera."""
    camera = stage.scene.camera[0]
    forward, up = np.array(camera.forward), np.array(camera.up)
    offset = points - np.array(stage.scene.camera[0].pos) / 2 - np.array(stage.scene.camera[1].pos) / 2
    scale = height * camera.frustum_near / (camera.frustum_top - camera.frustum_bottom) / (offset @ forward)
    return np.stack([width / 2 + scale * (offset @ np.cross(forward, up)), height / 2 - scale * (offset @ up)], axis=-1)


def platform_blob(picture: np.ndarray) -> np.ndarray:
    """Mean column and row of the pixels that are as blue as the platform."""
    red, green, blue = picture.astype(int).transpose(2, 0, 1)
    rows, columns = np.nonzero((blue > 1.35 * green) & (blue > 2.5 * red))
    assert len(rows) > 50
    return np.array([columns.mean(), rows.mean()])


@pytest.mark.parametrize("name", ["parallel", "two-cable"])
def test_both_renderers_give_the_same_picture_up_to_shading(name):
    """OpenGL and the ray caster agree on all but shading and edges; a platform 5 mm aside is noticed."""
    robot = cdpr.load_robot(name)
    pose = [0.25, 0.0 if robot.mobility == "planar" else 0.25, 0.15]
    trajectory = cdpr.drive(robot, [pose], seconds=0.1, states=2)
    stage = scene.Stage(trajectory, trajectory.poses, largest_tension=2.0)
    theirs, ours = opengl(stage.model), raycast.RayCaster(stage.model)
    stage.set(1)
    try:
        for camera in (stage.whole(VIEW[0] / VIEW[1]), stage.close_up()):
            stage.look(camera)
            true = theirs.start(stage.scene, *VIEW)()
            alike = unlike(true, ours.start(stage.scene, *VIEW)())
            assert alike < EDGES
        for geom in stage.scene.geoms[: stage.scene.ngeom]:
            if geom.type == mujoco.mjtGeom.mjGEOM_BOX and geom.objtype == mujoco.mjtObj.mjOBJ_GEOM:
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
    shapes = mujoco.MjvScene(model, maxgeom=10)
    camera = mujoco.MjvCamera()
    camera.distance, camera.elevation = 2.0, -30.0
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    everything = mujoco.mjtCatBit.mjCAT_ALL.value
    mujoco.mjv_updateScene(model, data, mujoco.MjvOption(), None, camera, everything, shapes)
    nothing = ours.start(shapes, *VIEW)()
    size = {"SPHERE": [0.3] * 3, "CAPSULE": [0.15, 0.15, 0.3], "CYLINDER": [0.15, 0.15, 0.3]}.get(kind, [0.2, 0.3, 0.4])
    turn = np.eye(3) if kind == "PLANE" else Rotation.from_euler("xyz", [0.5, 0.9, 0.3]).as_matrix()
    mujoco.mjv_initGeom(
        shapes.geoms[0], raycast.SHAPES[kind], np.array(size), np.zeros(3), turn.ravel(), np.float32([0.8, 0.3, 0.2, 1])
    )
    shapes.ngeom = 1
    shapes.flags[mujoco.mjtRndFlag.mjRND_SHADOW] = False
    shapes.flags[mujoco.mjtRndFlag.mjRND_SKYBOX] = False
    try:
        drawn, cast = (picture.astype(int) for picture in (theirs.start(shapes, *VIEW)(), ours.start(shapes, *VIEW)()))
    finally:
        theirs.close()
        ours.close()
    inside_theirs = np.abs(drawn - drawn[0, 0]).max(2) > 8
    inside_ours = np.abs(cast - nothing).max(2) > 8
    assert inside_ours.mean() > 0.02
    assert (inside_theirs != inside_ours).mean() < 0.004
    both = inside_theirs & inside_ours
    assert np.median(np.abs(drawn - cast).max(2)[both]) < SAME_SHADE


def test_what_stands_still_is_not_drawn_again_and_looks_the_same(parallel, static):
    """Every picture of a caster that has drawn others before is, bit for bit, that of one that has not."""
    stage = scene.Stage(parallel, static, largest_tension=2.0)
    used, size = raycast.RayCaster(stage.model), (160, 120)
    whole, floor = stage.whole(4 / 3), stage.model.geom("floor").id
    moves = {
        "a rod of the frame": lambda geoms: geoms[5].pos.__setitem__(0, geoms[5].pos[0] + 0.1),
        "the floor's colour": lambda geoms: geoms[floor].rgba.__setitem__(0, 0.5),
        "a light": lambda geoms: stage.scene.lights[0].diffuse.__setitem__(slice(None), 0.2),
    }
    known = []
    other = stage.whole(2.0)
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


def test_a_film_is_the_same_on_any_number_of_processors(tmp_path, parallel, static, monkeypatch):
    """Byte for byte, drawn and encoded on one and on many."""
    films = []
    everywhere = os.sched_getaffinity(0) if hasattr(os, "sched_setaffinity") else None
    for processors in (1, 5):
        monkeypatch.setattr(os, "cpu_count", lambda count=processors: count)
        try:
            if everywhere and processors == 1:
                os.sched_setaffinity(0, {min(everywhere)})  # which the encoder inherits
            path = cdpr.write_video(
                tmp_path / f"{processors}.mp4",
                [parallel, parallel],
                [static, None],
                seconds=0.8,
                fps=10,
                size=(322, 242),
                renderer="raycast",
            )
        finally:
            if everywhere:
                os.sched_setaffinity(0, everywhere)
        films.append(path.read_bytes())
    assert films[0] == films[1]


def test_the_platforms_pixels_move_as_its_pose_does(parallel, static):
    """The blue of the platform goes where MuJoCo's pose projects, and is not where it was commanded."""
    stage = scene.Stage(parallel, static, largest_tension=2.0)
    caster = raycast.RayCaster(stage.model)
    whole = stage.whole(4 / 3)
    blobs, actual = [], []
    for step in (0, 2, 18, 20):
        stage.set(step)
        stage.look(stage.close_up())
        blob = platform_blob(caster.start(stage.scene, 480, 360)())
        off = [
            np.linalg.norm(blob - project(stage, poses[step].translation, 480, 360))
            for poses in (parallel.poses, parallel.commanded)
        ]
        assert off[0] < 0.5 * off[1]
        stage.look(whole)
        blobs.append(platform_blob(caster.start(stage.scene, 480, 360)()))
        actual.append(project(stage, parallel.poses[step].translation, 480, 360))
    caster.close()
    moves, expected = np.diff(blobs, axis=0), np.diff(actual, axis=0)
    assert expected[1, 0] > 100
    np.testing.assert_allclose(moves, expected, rtol=TRACKED, atol=1.0)


def test_slack_cables_hang_and_have_their_own_colour(parallel):
    """MuJoCo is told a rest length beyond the distance for slack cables only; taut ones are coloured by tension."""
    stage = scene.Stage(parallel, largest_tension=2.0)
    stage.set(0)
    slack = parallel.slack[0]
    assert 0 < slack.sum() < len(slack)
    spare = stage.model.tendon_lengthspring[:, 1] - stage.data.ten_length
    np.testing.assert_allclose(spare[slack], (parallel.rest_lengths - parallel.lengths)[0, slack], atol=1e-9)
    assert (spare[~slack] < 0).all()
    np.testing.assert_allclose(
        stage.model.tendon_rgba[slack, :3], np.tile(style.SLACK_COLOR, (slack.sum(), 1)), atol=1e-6
    )
    expected = scene.tension_colors(parallel.tensions[0, ~slack], 2.0)
    np.testing.assert_allclose(stage.model.tendon_rgba[~slack, :3], expected, atol=1e-6)
    pieces = sum(geom.type == raycast.CAPSULE for geom in stage.scene.geoms[: stage.scene.ngeom])
    stage.model.tendon_lengthspring[:] = 0
    everything = mujoco.mjtCatBit.mjCAT_ALL.value
    mujoco.mjv_updateScene(stage.model, stage.data, mujoco.MjvOption(), None, stage.close_up(), everything, stage.scene)
    straight = sum(geom.type == raycast.CAPSULE for geom in stage.scene.geoms[: stage.scene.ngeom])
    assert pieces > straight + slack.sum()


def test_no_tension_is_coloured_like_a_slack_cable():
    """Every colour of the scale is far from slack's, in lightness or hue, and grows darker with tension."""
    colors = scene.tension_colors(np.linspace(0, 1, 64), 1.0)
    assert np.linalg.norm(colors - style.SLACK_COLOR, axis=1).min() > 0.5
    luminance = colors @ [0.2126, 0.7152, 0.0722]
    assert (np.diff(luminance) < 0).all()


def test_exaggeration_multiplies_what_is_drawn_and_leaves_the_numbers(parallel, static):
    """Shift and rotation away from the command are drawn three times as large; the command itself stays."""
    stage = scene.Stage(parallel, static, largest_tension=2.0, exaggeration=3.0)
    deviation = stage.poses.translation - parallel.commanded.translation
    np.testing.assert_allclose(deviation, 3 * parallel.deviation, atol=1e-12)
    turn = (stage.poses.rotation * parallel.commanded.rotation.inv()).magnitude()
    np.testing.assert_allclose(turn, 3 * (parallel.poses.rotation * parallel.commanded.rotation.inv()).magnitude())
    assert scene.exaggerated(parallel.poses, parallel.commanded, 1.0) is parallel.poses


@pytest.mark.parametrize("suffix", [".mp4", ".gif"])
def test_a_video_decodes_to_the_frames_and_size_asked_for(tmp_path, parallel, static, suffix):
    """Two robots side by side, 0.5 s at 12 frames a second, 322 by 242 pixels; and it moves."""
    told = []
    path = cdpr.write_video(
        tmp_path / f"two{suffix}",
        [parallel, parallel],
        [static, None],
        seconds=0.5,
        fps=12,
        size=(322, 242),
        renderer="raycast",
        progress=told.append,
    )
    frames = np.asarray(mediapy.read_video(path))
    assert frames.shape[:3] == (6, 242, 322)
    assert told == pytest.approx([k / 6 for k in range(1, 7)])
    assert np.abs(frames[0].astype(int) - frames[-1].astype(int)).max() > 50
    assert [file.name for file in tmp_path.iterdir()] == [path.name]


def test_the_encoder_that_comes_along_is_found(tmp_path):
    """mediapy uses imageio-ffmpeg's program, whatever the machine's PATH holds."""
    video._mediapy()
    assert mediapy.video_is_available()
    assert Path(imageio_ffmpeg.get_ffmpeg_exe()).is_file()


def test_frames_show_the_trajectory_at_even_times(parallel):
    """The first frame is the first state, the last the last, whatever the number of states."""
    steps = [video._state_at(parallel, fraction) for fraction in np.linspace(0, 1, 41)]
    assert steps[0] == 0
    assert steps[-1] == len(parallel) - 1
    assert np.abs(np.array(steps) - np.linspace(0, len(parallel) - 1, 41)).max() <= 0.5 + 1e-9


def test_frames_stream(tmp_path, parallel, monkeypatch):
    """A frame is handed to the encoder before the next is drawn, so that memory does not grow with length."""
    events = []
    drawn = panel.Page.frame
    monkeypatch.setattr(panel.Page, "frame", lambda *a, **k: events.append("drawn") or drawn(*a, **k))
    cdpr.write_video(
        tmp_path / "v.mp4", parallel, seconds=0.4, fps=10, size=(320, 240), renderer="raycast",
        progress=lambda done: events.append("written"),
    )  # fmt: skip
    assert events == ["drawn", "written"] * 4


def test_the_page_says_what_is_shown(parallel):
    """What happens, and how fast, in words."""
    assert "in real time" in video._footnote([parallel], 60.0)
    assert "6 times faster" in video._footnote([parallel], 10.0)
    assert "2 times slower" in video._footnote([parallel], 120.0)
    assert "follow the dark line" in video._footnote([parallel], 60.0)
    dropped = cdpr.drive(parallel.robot, LINE[:1], seconds=0.1, states=2, from_rest=False)
    assert "released" in video._footnote([dropped], 60.0)


@pytest.mark.parametrize("fallen", [0.0, 0.6])
def test_the_platform_stays_in_the_picture_wherever_it_goes(parallel, fallen):
    """Also beside and below its frame, where the floor goes down with it; else the camera is where it always was."""
    away = np.array([0.0, 0.0, -fallen])
    poses = RigidTransform.from_components(parallel.positions + away, parallel.poses.rotation)
    motion = cdpr.Trajectory.of(parallel.problems, parallel.times, poses, parallel.lengths, parallel.tensions)
    stage = scene.Stage(motion, largest_tension=2.0)
    width, height = 480, 300
    camera = stage.whole(width / height)
    corners = np.array(list(itertools.product(*(np.array([-0.5, 0.5])[:, None] * motion.robot.platform_size).T)))
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


@pytest.mark.parametrize(
    ("size", "robots"),
    [
        ((320, 240), 1), ((640, 480), 2), ((1280, 720), 4), ((400, 900), 1), ((1920, 300), 6), ((320, 240), 6),
        ((400, 900), 4), ((1920, 300), 1),
    ],
)  # fmt: skip
def test_a_page_of_any_size_has_room_for_everything(size, robots):
    """No box is empty or leaves the page, and no two of a cell overlap."""
    robot = cdpr.load_robot("parallel")
    page = panel.Page(
        size, [robot] * robots, [["x" * 200]] * robots, largest_tension=2.0, footnote="y" * 300, outlined=True
    )
    for cell in page.cells:
        boxes = [cell.heading, cell.view, cell.close_up, cell.numbers, cell.bars]
        for i, box in enumerate(boxes):
            assert box.width > 0
            assert box.height > 0
            assert box.left >= 0
            assert box.top >= 0
            assert box.right <= size[0]
            assert box.bottom <= size[1]
            for other in boxes[:i]:
                apart = box.left >= other.right or other.left >= box.right
                assert apart or box.top >= other.bottom or other.top >= box.bottom
    views, close_ups = (
        [np.zeros((box.height, box.width, 3), np.uint8) for box in boxes]
        for boxes in ([cell.view for cell in page.cells], [cell.close_up for cell in page.cells])
    )
    tensions, slack = np.linspace(0, 2, robot.cables), np.arange(robot.cables) == 0
    each = [[what] * robots for what in (0.1, np.zeros(3), tensions, slack)]
    assert page.frame(views, close_ups, *each).shape == (size[1], size[0], 3)


@pytest.mark.parametrize(("value", "end"), [(1.8, 2), (2.0, 2), (0.11, 0.12), (71, 80), (0.0, 1), (9.1e-5, 1e-4)])
def test_scales_end_at_round_numbers(value, end):
    """Not below the value."""
    assert panel.nice_above(value) == pytest.approx(end)


@pytest.mark.parametrize(
    ("name", "words", "message"),
    [
        ("v.avi", {}, r"found the suffix '.avi', expected .mp4 or .gif"),
        ("v", {}, "found no suffix"),
        ("there.mp4", {}, "exists, expected a new place or --force"),
        ("folder.mp4", {}, "found a folder"),
        ("no/where.mp4", {}, "found no folder"),
        ("v.mp4", {"seconds": 0.0}, "seconds: found 0 at 30 frames per second, expected 2 to"),
        ("v.mp4", {"seconds": np.inf}, "seconds: found inf"),
        ("v.mp4", {"fps": 0.0}, "fps: found 0"),
        ("v.mp4", {"size": (0, 480)}, "size: found 0 x 480"),
        ("v.mp4", {"size": (641, 480)}, "size: found 641 x 480 pixels, expected even"),
        ("v.mp4", {"size": (10**6, 480)}, "size: found 1000000 x 480"),
        ("v.mp4", {"exaggeration": 0.0}, "exaggeration: found 0"),
        ("v.mp4", {"static": []}, "static: found 0 stacks"),
        ("v.mp4", {"renderer": "opngl"}, "did you mean opengl"),
    ],
)
def test_bad_input_is_one_sentence_and_leaves_nothing(tmp_path, parallel, name, words, message):
    """Nothing new in the folder, and what was there is as it was."""
    (tmp_path / "there.mp4").write_text("mine")
    (tmp_path / "folder.mp4").mkdir()
    with pytest.raises(cdpr.CdprError, match=message):
        cdpr.write_video(tmp_path / name, parallel, **words)
    assert sorted(file.name for file in tmp_path.iterdir()) == ["folder.mp4", "there.mp4"]
    assert (tmp_path / "there.mp4").read_text() == "mine"


def test_a_failure_while_drawing_keeps_the_old_file(tmp_path, parallel):
    """With ``force`` too, a file is replaced only by a complete one."""
    path = tmp_path / "there.mp4"
    path.write_text("mine")

    def fail(done: float) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        cdpr.write_video(
            path, parallel, seconds=1, fps=10, size=(320, 240), renderer="raycast", force=True, progress=fail
        )
    assert path.read_text() == "mine"
    assert [file.name for file in tmp_path.iterdir()] == ["there.mp4"]


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")  # mediapy leaves a pipe to be collected
def test_an_encoder_that_fails_is_one_sentence(tmp_path, parallel, monkeypatch):
    """ffmpeg's last line, and nothing left behind."""
    writer = mediapy.VideoWriter
    monkeypatch.setattr(mediapy, "VideoWriter", lambda *a, **k: writer(*a, **{**k, "ffmpeg_args": ["-no-such-option"]}))
    with pytest.raises(cdpr.InvalidInput, match="cannot be written"):
        cdpr.write_video(tmp_path / "v.mp4", parallel, seconds=1, fps=10, size=(320, 240), renderer="raycast")
    assert not list(tmp_path.iterdir())


def test_an_encoder_that_fills_the_disk_is_no_mistake_of_the_users(tmp_path, parallel, monkeypatch):
    """Where mediapy quotes ffmpeg, the sentence keeps the reason, and the error is the one of a full disk."""

    class Full(mediapy.VideoWriter):
        def close(self) -> None:
            super().close()
            raise RuntimeError("Error writing 'v.mp4': [out#0/mp4 @ 0x1] Error closing file: No space left on device\n")

    monkeypatch.setattr(mediapy, "VideoWriter", Full)
    path = tmp_path / "v.mp4"
    with pytest.raises(cdpr.StoreError) as full:
        cdpr.write_video(path, parallel, seconds=1, fps=10, size=(320, 240), renderer="raycast")
    assert str(full.value) == f"{path}: cannot be written: No space left on device"
    assert not list(tmp_path.iterdir())


DRAWING = """
import sys
from cdpr_sim.cli import main
from cdpr_sim.drawing.video import writing

frames = writing.VideoFrames.frames

def paused(pictures):
    for frame in frames(pictures):
        yield frame
        print("drawn", flush=True)
        sys.stdin.read()

writing.VideoFrames.frames = paused
main()
"""
"""The command, which waits when ffmpeg has a frame: so it is drawing that is interrupted, under any load."""


@pytest.mark.skipif(os.name == "nt", reason="Windows has no process groups to send an interrupt to")
@pytest.mark.parametrize("name", ["SIGINT", "SIGTERM"])
def test_an_interrupted_command_leaves_nothing(tmp_path, name):
    """Ctrl-C in a terminal reaches Python and ffmpeg alike: no file, no temporary one, no traceback, status 128 + 2."""
    words = ["video", "planar-vertical", "--drive-seconds", "1", "--fps", "2", "--size", "320", "240", "-o", "v.mp4"]
    process = subprocess.Popen(
        [sys.executable, "-c", DRAWING, *words],
        cwd=tmp_path,
        env=os.environ | {"PYTHONPATH": str(Path(cdpr.__file__).parents[1])},
        start_new_session=True,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),  # ignored where a shell runs us with &
    )
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


def test_without_any_opengl_the_ray_caster_draws(parallel, monkeypatch):
    """Where neither EGL nor OSMesa loads, "auto" falls back, and "opengl" says in a sentence what was tried."""
    monkeypatch.setattr(render, "_candidates", lambda: ["no_such_module", "nor_this"])
    stage = scene.Stage(parallel, largest_tension=2.0)
    assert isinstance(render.open_renderer(stage.model, *VIEW), raycast.RayCaster)
    with pytest.raises(render.OpenGLUnavailable, match=r"no_such_module: .*; nor_this: "):
        render.open_renderer(stage.model, *VIEW, "opengl")


def test_no_environment_variable_is_needed_or_left_behind(monkeypatch):
    """EGL, then OSMesa; MUJOCO_GL, where set, chooses; a failed attempt leaves PyOpenGL free for the next."""
    monkeypatch.delenv("MUJOCO_GL", raising=False)
    monkeypatch.setattr(sys, "platform", "linux")
    assert render._candidates() == ["egl", "osmesa"]
    monkeypatch.setenv("MUJOCO_GL", "osmesa")
    assert render._candidates() == ["osmesa", "egl"]
    monkeypatch.setenv("MUJOCO_GL", "disable")
    assert render._candidates() == []
    monkeypatch.setenv("PYOPENGL_PLATFORM", "wrong")
    render._forget("egl", None)
    assert "PYOPENGL_PLATFORM" not in os.environ


def test_show_plays_in_a_notebook(parallel, monkeypatch):
    """What the notebook is given is an H.264 video of the size asked for, embedded; on a narrow page it shrinks."""
    displayed = []
    monkeypatch.setattr("IPython.display.display", lambda thing: displayed.append(thing.data))
    cdpr.show(parallel, seconds=0.2, fps=10, size=(320, 240), renderer="raycast")
    (html,) = displayed
    assert 'width="320" height="240" style="max-width: 100%; height: auto;' in html
    assert "<table" not in html
    data = base64.b64decode(re.search(r"data:video/mp4;base64,([^\"]+)", html).group(1))
    assert np.asarray(mediapy.decompress_video(data)).shape == (2, 240, 320, 3)


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


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--z", "2"], "falls since cables cannot push"),
        (["--seconds", "0"], "seconds: found 0"),
        (["-o", "v.avi"], "found the suffix '.avi'"),
        (["--size", "1", "1"], "size: found 1 x 1"),
        (["--drive-seconds", "-1"], "seconds: found -1"),
        (["--renderer", "vulkan"], "unknown renderer 'vulkan'"),
    ],
)
def test_a_users_mistake_gets_one_sentence_and_exit_status_2(tmp_path, monkeypatch, words, message):
    """Before the platform is driven anywhere, and nothing is written."""
    monkeypatch.chdir(tmp_path)
    result = CliRunner().invoke(app, ["video", "cogiro", "--drive-seconds", "1", *words])
    assert result.exit_code == 2
    assert message in result.stderr
    assert len(result.stderr.strip().splitlines()) == 1
    assert not list(tmp_path.iterdir())

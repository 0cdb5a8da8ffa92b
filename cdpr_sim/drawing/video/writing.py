"""Videos of trajectories, synchronised side by side: files, written atomically, and players in notebooks."""

from __future__ import annotations

import errno
import os
import signal
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any, get_args

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import RigidTransform

from cdpr_sim.core import extras
from cdpr_sim.core.checks import FLAG, PROGRESS, checked_array, listed, one_of, refuse_unless
from cdpr_sim.core.describe import describe_properties, describe_stiffness
from cdpr_sim.core.errors import InvalidInput, StoreError
from cdpr_sim.core.files import appearing, check_place
from cdpr_sim.core.trajectory import Trajectory
from cdpr_sim.drawing.readable_numbers import plain
from cdpr_sim.drawing.video.frame_layout import Page, nice_above
from cdpr_sim.drawing.video.render import Backend, Picture, Renderer, open_renderer
from cdpr_sim.drawing.video.scene import Stage

SIZE = (1280, 720)
FPS = 30.0
SECONDS = 10.0

SUFFIXES = (".mp4", ".gif")

LEAST_SIZE, MOST_SIZE = (320, 240), (3840, 2160)
"""[pixel] Smaller frames are illegible; larger ones take software OpenGL more than a second."""

MOST_FRAMES, MOST_FPS = 100_000, 240.0
MOST_EXAGGERATION = 1e4
MOST_ROBOTS = 6

Shapes = Float[np.ndarray, "steps cables points 3"]

AHEAD = 4
"""Frames drawn ahead of the one being composed: more would not use more processors, since they are started one by one,
but cost memory."""

ENCODERS = 4
"""Threads of the encoder, the same on every machine, since the bytes of H.264 depend on it."""

COLORS = 128
"""Of a gif: a tenth smaller than with 256, and 98 % of the pixels are the same within 8 of 255; 64 show as bands."""

QUALITY = 18.0
"""Constant rate factor, or quantiser, of H.264: visually lossless."""


def checked_file(path: str | Path, *, force: bool = False) -> Path:
    """``path``, if a video can be written there; to be called before the motion is computed.

    Raises:
        InvalidInput: a path that cannot be written, an existing file without ``force``, or an unknown suffix.
        MissingExtra: a library of the extra ``video`` is not installed.
    """
    path = check_place(path, SUFFIXES, force=force)
    extras.require("video", "video")
    return path


def write_video(
    path: str | Path,
    trajectories: Trajectory | Sequence[Trajectory],
    static: RigidTransform | Sequence[RigidTransform | None] | None = None,
    *,
    shapes: Shapes | Sequence[Shapes | None] | None = None,
    seconds: float = SECONDS,
    fps: float = FPS,
    size: tuple[int, int] = SIZE,
    exaggeration: float = 1.0,
    renderer: Backend = "auto",
    force: bool = False,
    progress: Callable[[float], None] | None = None,
) -> Path:
    """Write a video of one trajectory, or of several synchronised side by side; mp4 (H.264) or gif, by suffix.

    Frames are encoded one by one. The file is written atomically: after an interrupt there is no partial file, and an
    existing file is unchanged.

    Args:
        path: of the file, ending in .mp4 or .gif.
        trajectories: one or several; each is shown from its first state to its last.
        static: the static solver's poses for each, a stack of (steps,) or None, drawn as outlines.
        shapes: profiles of the cables in each state, from ``cable_profiles``, or None; required for cables with mass.
        seconds: duration of the video; the motion is shown faster or slower to fit, as stated in the picture.
        fps: frames per second.
        size: (width, height) [pixel], even numbers.
        exaggeration: factor by which deviations, tilts, slack and moves of exits are drawn larger, as stated in the
            picture.
        renderer: "opengl", "raycast", or "auto" for the first that works on this machine.
        force: whether to replace an existing file.
        progress: called after each frame with the fraction done, 0 to 1.

    Returns:
        The path of the file that was written.

    Raises:
        InvalidInput: a path that cannot be written, an existing file, an unknown suffix, an invalid size, duration or
            number of frames.
        StoreError: a full disk, or an encoder that was killed.
    """
    refuse_unless(FLAG, force=force)
    path = checked_file(path, force=force)
    pictures = VideoFrames(trajectories, static, shapes, seconds, fps, size, exaggeration, renderer, progress)
    with pictures, appearing(path) as (temporary,):
        try:
            with _interrupts_held():
                video = _writer(temporary, pictures).__enter__()
            with closing(video):
                for frame in pictures.frames():
                    video.add_image(frame)
        except RuntimeError as error:  # mediapy's, which quotes ffmpeg
            if (full := os.strerror(errno.ENOSPC)) in str(error):
                raise StoreError(f"{path}: cannot be written: {full}") from error
            raise InvalidInput(f"{path}: cannot be written: {str(error).strip().splitlines()[-1]}") from error
    return path


def show(
    trajectories: Trajectory | Sequence[Trajectory],
    static: RigidTransform | Sequence[RigidTransform | None] | None = None,
    *,
    shapes: Shapes | Sequence[Shapes | None] | None = None,
    seconds: float = SECONDS,
    fps: float = FPS,
    size: tuple[int, int] = (960, 540),
    exaggeration: float = 1.0,
    renderer: Backend = "auto",
    progress: Callable[[float], None] | None = None,
) -> None:
    """Play a trajectory, or several synchronised side by side, in a notebook.

    Args:
        trajectories: one or several; each is shown from its first state to its last.
        static: the static solver's poses for each, a stack of (steps,) or None, drawn as outlines.
        shapes: profiles of the cables in each state, (steps, cables, points, 3) [m], or None; required for cables with
            mass.
        seconds: duration; the motion is shown faster or slower to fit, as stated in the picture.
        fps: frames per second.
        size: (width, height) [pixel], even numbers.
        exaggeration: factor by which deviations, tilts, slack and moves of exits are drawn larger, as stated in the
            picture.
        renderer: "opengl", "raycast", or "auto" for the first that works on this machine.
        progress: called after each frame with the fraction done, 0 to 1.

    Raises:
        InvalidInput: an invalid size, duration or number of frames.
        UnknownName: no such renderer.
    """
    mediapy = _mediapy()
    from IPython.display import HTML, display

    pictures = VideoFrames(trajectories, static, shapes, seconds, fps, size, exaggeration, renderer, progress)
    with pictures:
        content = mediapy.compress_video(pictures.frames(), fps=fps, qp=round(QUALITY))
    # Without the table that show_video would put around it, in which a width of 100 % is the video's own.
    display(HTML(mediapy.html_from_compressed_video(content, *size, border="max-width: 100%; height: auto")))


class VideoFrames:
    """The frames of a video: scenes, page layout and renderers; arguments and errors as in ``write_video``."""

    def __init__(
        self,
        trajectories: Trajectory | Sequence[Trajectory],
        static: RigidTransform | Sequence[RigidTransform | None] | None = None,
        shapes: Shapes | Sequence[Shapes | None] | None = None,
        seconds: float = SECONDS,
        fps: float = FPS,
        size: tuple[int, int] = SIZE,
        exaggeration: float = 1.0,
        renderer: Backend = "auto",
        progress: Callable[[float], None] | None = None,
    ) -> None:
        refuse_unless(PROGRESS, progress=progress)
        several = [trajectories] if isinstance(trajectories, Trajectory) else listed("trajectories", trajectories)
        for trajectory in several:
            refuse_unless(Trajectory, trajectories=trajectory)
        statics = _each("static", static, RigidTransform, len(several))
        profiles = _each("shapes", shapes, np.ndarray, len(several))
        self.count = check_settings(seconds, fps, size, exaggeration, renderer)
        self.fps, self.size = fps, (int(size[0]), int(size[1]))
        check_count(len(several))
        if len(statics) != len(several):
            raise InvalidInput(f"static: found {len(statics)} stacks of poses, expected {len(several)}, one each")
        if len(profiles) != len(several):
            raise InvalidInput(f"shapes: found {len(profiles)} arrays, expected {len(several)}, or None, each")
        for trajectory, poses in zip(several, statics, strict=True):
            if poses is not None and (poses.single or len(poses) != len(trajectory)):
                raise InvalidInput(f"static: expected {len(trajectory)} poses, as many as the trajectory has states")
        largest = nice_above(max(float(trajectory.tensions.max()) for trajectory in several))
        self.stages = [
            Stage(trajectory, poses, largest_tension=largest, exaggeration=exaggeration, shapes=curves)
            for trajectory, poses, curves in zip(several, statics, profiles, strict=True)
        ]
        self._numbers = [
            [getattr(trajectory, name) for trajectory in several] for name in ("tilt", "deviation", "tensions", "slack")
        ]
        rigid = all(trajectory.robot.cabling.rigid_exits for trajectory in several)
        enlarged = "Deviations" if rigid else "Deviations and moves of exits"
        self.page = Page(
            self.size,
            [trajectory.robot for trajectory in several],
            [_captions(trajectory) for trajectory in several],
            largest_tension=largest,
            footnote=_footnote(several, seconds),
            warning=""
            if exaggeration == 1
            else f"{enlarged} drawn {exaggeration:g} × larger; the numbers are the true values",
            outlined=any(poses is not None for poses in statics),
        )
        self._wholes = [
            stage.whole(cell.view.width / cell.view.height)
            for stage, cell in zip(self.stages, self.page.cells, strict=True)
        ]
        self._backend: Backend = renderer
        self._progress = progress
        self._renderers: list[Renderer] = []

    def __enter__(self) -> VideoFrames:
        return self

    def __exit__(self, *_: object) -> None:
        for renderer in self._renderers:
            renderer.close()
        self._renderers = []

    def frames(self) -> Iterator[Picture]:
        """All frames; states at equal fractions of each trajectory's own duration."""
        boxes = [box for cell in self.page.cells for box in (cell.view, cell.close_up)]
        width, height = max(box.width for box in boxes), max(box.height for box in boxes)
        self._renderers = [open_renderer(stage.model, width, height, self._backend) for stage in self.stages]
        begun = (self._begun(float(fraction)) for fraction in np.linspace(0, 1, self.count))
        for done, finished in enumerate(_ahead(begun), start=1):
            yield finished()
            if self._progress is not None:
                self._progress(done / self.count)

    def _begun(self, fraction: float) -> Callable[[], Picture]:
        """Start drawing the pictures of one frame; the returned function waits for the frame."""
        steps, views, close_ups = [], [], []
        for stage, renderer, camera, cell in zip(
            self.stages, self._renderers, self._wholes, self.page.cells, strict=True
        ):
            steps.append(_state_at(stage.trajectory, fraction))
            stage.set(steps[-1])
            views.append(renderer.start(stage.look(camera), cell.view.width, cell.view.height))
            close_ups.append(renderer.start(stage.look(stage.close_up()), cell.close_up.width, cell.close_up.height))

        def finished() -> Picture:
            numbers = [[of[step] for of, step in zip(each, steps, strict=True)] for each in self._numbers]
            return self.page.frame([draw() for draw in views], [draw() for draw in close_ups], *numbers)

        return finished


def _each(field: str, given: Any, kind: type, count: int) -> list[Any]:
    """What is given for each of ``count`` trajectories: one of this kind, several of them or None, or None at all."""
    several = [given] if isinstance(given, kind) else listed(field, [None] * count if given is None else given)
    for one in several:
        refuse_unless(kind | None, **{field: one})
    return several


def _ahead(begun: Iterable[Callable[[], Picture]]) -> Iterator[Callable[[], Picture]]:
    """The same functions in the same order, each after ``AHEAD`` more have been started."""
    waiting = deque()
    for frame in begun:
        waiting.append(frame)
        if len(waiting) > AHEAD:
            yield waiting.popleft()
    yield from waiting


def _state_at(trajectory: Trajectory, fraction: float) -> int:
    """The state nearest to ``fraction`` of the duration, the later one of two."""
    times = trajectory.times
    away = np.abs(times - (times[0] + fraction * (times[-1] - times[0])))
    return len(times) - 1 - int(away[::-1].argmin())


def check_count(robots: int) -> None:
    """Check the number of robots side by side.

    Raises:
        InvalidInput: none, or too many.
    """
    if not 1 <= robots <= MOST_ROBOTS:
        raise InvalidInput(f"trajectories: found {robots}, expected 1 to {MOST_ROBOTS} side by side")


def check_settings(seconds: float, fps: float, size: tuple[int, int], exaggeration: float, renderer: str) -> int:
    """The number of frames of a video with these settings.

    Raises:
        InvalidInput: an invalid duration, rate, size or exaggeration.
        UnknownName: no such renderer.
    """
    one_of("renderer", renderer, get_args(Backend))
    numbers = {"seconds": seconds, "fps": fps, "exaggeration": exaggeration}
    seconds, fps, exaggeration = (float(checked_array(name, value, ())) for name, value in numbers.items())
    if not 0 < exaggeration <= MOST_EXAGGERATION:
        raise InvalidInput(
            f"exaggeration: found {exaggeration:g}, expected more than 0 and at most {MOST_EXAGGERATION:g}"
        )
    width, height = checked_array("size", size, (2,)).tolist()
    (a, b), (c, d) = LEAST_SIZE, MOST_SIZE
    if not (a <= width <= c and b <= height <= d) or width % 2 or height % 2:
        raise InvalidInput(
            f"size: found {width:.0f} x {height:.0f} pixels, expected even numbers from {a} x {b} to {c} x {d}"
        )
    if not 0 < fps <= MOST_FPS:
        raise InvalidInput(f"fps: found {fps:g}, expected more than 0 and at most {MOST_FPS:g} frames per second")
    count = round(seconds * fps)
    if not 2 <= count <= MOST_FRAMES:
        raise InvalidInput(
            f"seconds: found {seconds:g} at {fps:g} frames per second, expected 2 to {MOST_FRAMES} frames in all"
        )
    return count


def _captions(trajectory: Trajectory) -> list[str]:
    """Descriptions of cables, platform and frame, from long to short."""
    robot = trajectory.robot
    size = " × ".join(f"{edge:.3g}" for edge in np.ptp(robot.frame, axis=0))
    stiffness = ", ".join([robot.material or "cables", describe_stiffness(robot, "kN")])
    cables = ", ".join([stiffness, *describe_properties(robot)])
    return [
        f"{cables} · platform {robot.mass:g} kg · frame {size} m",
        f"{cables} · {robot.mass:g} kg · {size} m",
        f"{cables} · {robot.mass:g} kg",
        cables,
        stiffness,
    ]


def _footnote(trajectories: Sequence[Trajectory], seconds: float) -> str:
    durations = [float(trajectory.times[-1] - trajectory.times[0]) for trajectory in trajectories]
    rate = float(np.mean(durations)) / seconds
    speed = "in real time"
    if rate > 1.05:
        speed = f"{plain(rate)} times faster"
    elif rate < 0.95:
        speed = f"{plain(1 / rate)} times slower"
    still = all(np.ptp(trajectory.commanded.translation, axis=0).max() == 0 for trajectory in trajectories)
    motion = "The platform is released at the commanded pose" if still else "The winches follow the dark line"
    if all(trajectory.converged.all() for trajectory in trajectories):
        return f"{motion}; MuJoCo has settled at every state."
    return f"{motion}; simulated by MuJoCo, shown {speed}."


def _writer(path: Path, pictures: VideoFrames):
    mediapy, (width, height) = _mediapy(), pictures.size
    if path.suffix == ".gif":
        # One palette, of the first frame (whose legend holds every colour), so that no frame has to wait for the last.
        # Undithered it is smaller by 5 %, and nearer to the frame by half.
        palette = f"split[a][b];[a]trim=end_frame=1,palettegen=max_colors={COLORS}[p];[b][p]paletteuse=dither=none"
        return mediapy.VideoWriter(path, (height, width), fps=pictures.fps, codec="gif", ffmpeg_args=["-vf", palette])
    options = ["-preset", "veryfast", "-threads", str(ENCODERS), "-movflags", "+faststart"]
    return mediapy.VideoWriter(path, (height, width), fps=pictures.fps, crf=QUALITY, ffmpeg_args=options)


@contextmanager
def _interrupts_held() -> Iterator[None]:
    """Block interrupts while a child process is started, so that Ctrl-C does not reach the child: we end it ourselves.

    An interrupt during the block is delivered when the block ends.
    """
    if not hasattr(signal, "pthread_sigmask"):  # Windows
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT, signal.SIGTERM})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _mediapy():
    """mediapy, with the ffmpeg of ``imageio-ffmpeg``."""
    extras.require("video", "video")
    import imageio_ffmpeg
    import mediapy

    mediapy.set_ffmpeg(imageio_ffmpeg.get_ffmpeg_exe())
    return mediapy

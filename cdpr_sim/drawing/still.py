"""Figure of a robot at a commanded pose, in the scene of its videos: numbered cables, and a close-up of the platform.

Pictures are ray-cast, so that OpenGL need not be there, and numbers are placed where they cover neither each other nor
another cable's exit.
"""

# pyright: reportArgumentType=false, reportAttributeAccessIssue=false, reportCallIssue=false
# matplotlib's stubs do not know keyword dictionaries, and mujoco ships none for its compiled modules.
from __future__ import annotations

import io
from collections.abc import Sequence
from contextlib import closing
from pathlib import Path

import mujoco
import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke
from PIL import Image
from PIL.PngImagePlugin import PngInfo
from scipy.spatial.transform import RigidTransform

from cdpr_sim.core.checks import refuse_unless
from cdpr_sim.core.describe import describe_cables
from cdpr_sim.core.pose import PoseLike
from cdpr_sim.core.problem import Problems
from cdpr_sim.core.robot import Robot, without_mass
from cdpr_sim.core.trajectory import Trajectory
from cdpr_sim.drawing import style
from cdpr_sim.drawing.figures import canvas, encoded, styled
from cdpr_sim.drawing.video.raycast import RayCaster
from cdpr_sim.drawing.video.scene import Stage, seen

STAMP = "Source"
"""Key of the PNG text chunk with the hash of the picture's source."""


class Still(Figure):
    """A figure with a notebook display."""

    def _repr_png_(self) -> bytes:
        return encoded(self)


def small(picture: bytes, stamp: str) -> bytes:
    """A PNG with 256 colours and a third of the size, for a repository; ``stamp`` is the hash of its source.

    One step of k-means keeps the colours of large areas, such as a platform's, within 5 of 255.
    """
    buffer, text = io.BytesIO(), PngInfo()
    text.add_text(STAMP, stamp)
    Image.open(io.BytesIO(picture)).convert("RGB").quantize(256, Image.Quantize.MAXCOVERAGE, kmeans=1).save(
        buffer, "png", optimize=True, pnginfo=text
    )
    return buffer.getvalue()


def stamp_of(path: Path) -> str | None:
    """The stamp that ``small`` wrote into the picture; None without such a picture."""
    try:
        with Image.open(path) as picture:
            return picture.info.get(STAMP)
    except OSError:
        return None


@styled
def draw(robot: Robot, pose: PoseLike | None = None) -> Figure:
    """Draw ``robot`` at its commanded pose: cables straight, with the numbers used in tables.

    Args:
        robot: the robot.
        pose: of its platform; default: the middle of its workspace.

    Returns:
        A matplotlib figure, displayed in notebooks; ``figure.savefig("robot.png")`` writes it.

    Raises:
        InvalidInput: an invalid pose.
    """
    refuse_unless(Robot, robot=robot)
    at = robot.pose(robot.home if pose is None else pose)
    x, y, z = at.translation
    size = " × ".join(f"{edge:.3g}" for edge in np.ptp(robot.frame, axis=0))
    figure = canvas(
        style.WIDTH,
        4.95,
        f"{robot.name}: {robot.description or f'{robot.cables} cables'}",
        f"Numbers: cables, at their exits and anchors. Cross: centre of mass. Commanded to ({x:.4g}, "
        f"{y:.4g}, {z:.4g}) m in a frame of {size} m. A platform of {robot.mass:g} kg on {robot.cables} "
        f"{describe_cables(robot)}; {robot.mobility}.",
        Still,
    )
    stage = _stage(robot, at)
    whole, close = (_axes(figure, box) for box in (WHOLE, CLOSE_UP))
    camera = stage.whole(WHOLE[2] / WHOLE[3])
    show(whole, stage, camera)
    _draw_directions(whole, stage, camera)
    _number(whole, camera, robot.exits, robot.frame.mean(0))
    whole.set_title("the robot, as commanded")
    camera = enlarge(stage)
    show(close, stage, camera)
    _number(close, camera, at.apply(robot.anchors), at.translation)
    close.plot(*pixels(close, camera, at.apply(robot.center_of_mass[None])).T, "+", ms=9, mew=1.5, color=style.INK)
    close.set_title("the platform")
    return figure


WHOLE, CLOSE_UP = (13, 64, 600, 400), (629, 64, 348, 400)
"""[pixel] Places of both pictures: left, bottom, width and height."""

CELL, CELL_VIEW = (208, 226), (11, 55, 186, 136)
"""[pixel] Size of a robot's place on a sheet, and in it the place of its picture."""


def _stage(robot: Robot, at: RigidTransform) -> Stage:
    """The scene at the commanded pose: cables as long as their paths, in the colours of their numbers."""
    robot = without_mass(robot)  # sagging is a result
    poses, lengths = RigidTransform.from_components([at.translation], at.rotation), robot.rest_lengths(at)[None]
    problems = Problems.of(robot, poses, lengths)
    motion = Trajectory.of(problems, np.zeros(1), poses, lengths, tensions=np.zeros_like(lengths))
    colors = np.array([to_rgb(style.CABLES[cable % len(style.CABLES)]) for cable in range(robot.cables)])
    stage = Stage(motion, largest_tension=1.0, colors=colors)
    stage.set(0)
    return stage


def _axes(figure: Figure, box: tuple[int, int, int, int]) -> Axes:
    """Axes at this place, with pixels as their coordinates."""
    left, bottom, width, height = box
    figure.set_layout_engine("none")  # places are given
    page = figure.get_size_inches() * style.PNG_DPI
    return of_pixels(
        figure.add_axes((left / page[0], bottom / page[1], width / page[0], height / page[1])), width, height
    )


def of_pixels(ax: Axes, width: int, height: int) -> Axes:
    """The axes, with the pixels of a picture as their coordinates."""
    ax.set(xlim=(0, width), ylim=(0, height), xticks=[], yticks=[])
    ax.spines[:].set(visible=True, color=style.FAINT)
    return ax


def enlarge(stage: Stage) -> mujoco.MjvCamera:
    """A camera close to the platform, which becomes translucent, with cables and anchors thin beside it."""
    stage.model.geom("platform").rgba[3] = style.STILL_PLATFORM_ALPHA
    for size in (stage.model.tendon_width, stage.model.site_size):  # of the frame, in which the platform may be small
        np.minimum(size, style.STILL_THICKEST * np.linalg.norm(stage.robot.platform_size), out=size)
    stage.set(stage.step)
    return stage.close_up()


def show(ax: Axes, stage: Stage, camera: mujoco.MjvCamera, interpolation: str = "nearest") -> None:
    """Fill axes of pixels with the picture, which another ``interpolation`` is for where they are shown smaller."""
    width, height = round(ax.get_xlim()[1]), round(ax.get_ylim()[1])
    with closing(RayCaster(stage.model)) as caster:
        picture = caster.start(stage.look(camera), width, height)()
    ax.imshow(picture, extent=(0, width, 0, height), aspect="auto", interpolation=interpolation, zorder=0)


def pixels(ax: Axes, camera: mujoco.MjvCamera, points: Float[np.ndarray, "points 3"]) -> Float[np.ndarray, "points 2"]:
    """Where the axes show points [m]."""
    width, height = ax.get_xlim()[1], ax.get_ylim()[1]
    return np.array([width, height]) / 2 + seen(camera, points) * height / 2


def _draw_directions(ax: Axes, stage: Stage, camera: mujoco.MjvCamera) -> None:
    """Draw the directions of x, y and z from the frame's lower corner."""
    corner = stage.robot.frame[0]
    ends = corner + 0.11 * stage.diagonal * np.eye(3)
    origin, *tips = pixels(ax, camera, np.vstack([corner, ends]))
    for name, tip in zip("xyz", tips, strict=True):
        looks = {"arrowstyle": "-|>", "color": style.INK, "lw": style.THIN, "shrinkA": 0, "shrinkB": 0}
        ax.annotate("", tip, origin, arrowprops=looks)
        _write(ax, tip + 9 * (tip - origin) / (np.linalg.norm(tip - origin) or 1.0), name, fontstyle="italic")


def _write(ax: Axes, at: Float[np.ndarray, "2"], text: str, **looks) -> None:
    halo = [withStroke(linewidth=2.5, foreground="white")]  # legible over cables and edges
    looks |= {"color": style.INK, "fontsize": 8, "ha": "center", "va": "center", "zorder": 7, "path_effects": halo}
    ax.text(*at, text, **looks)


LETTER, LINE = 8.5, 13.0
"""[pixel] Width of a digit and height of a line of the numbers."""

SAME = 4.0
"""[pixel] Nearer ends have one text."""

AWAY = (13, 18, 24, 31, 39)
"""[pixel] Distances of a number from its point, in the order in which they are tried."""


def _number(
    ax: Axes, camera: mujoco.MjvCamera, ends: Float[np.ndarray, "cables 3"], middle: Float[np.ndarray, "3"]
) -> None:
    """Mark the ends of cables, and write numbers beside them, outwards from the middle; at one place, one text.

    A number stands at the nearest place that covers no other number and no end, and far from its end it has a line
    to it.
    """
    *points, center = pixels(ax, camera, np.vstack([ends, middle]))
    points = np.array(points)
    ax.plot(*points.T, ls="none", marker="o", ms=3.5, color=style.INK)
    places: list[list[int]] = []
    for cable, point in enumerate(points):
        near = (place for place in places if np.linalg.norm(points[place[0]] - point) < SAME)
        if (place := next(near, None)) is None:
            places.append([cable])
        else:
            place.append(cable)
    page = np.array([ax.get_xlim()[1], ax.get_ylim()[1]])
    taken = [(point, np.array([3.0, 3.0])) for point in points]
    for cables in places:
        text, point = ", ".join(str(cable + 1) for cable in cables), points[cables].mean(0)
        half = np.array([LETTER * len(text), LINE]) / 2
        outwards = np.arctan2(*(point - center)[::-1])
        tried = [
            point + (away + half - LINE / 2) * [np.cos(angle), np.sin(angle)]
            for away in AWAY
            for angle in outwards + np.radians([0, 30, -30, 60, -60, 90, -90, 120, -120, 150, -150, 180])
        ]

        def covered(at: Float[np.ndarray, "2"], half: Float[np.ndarray, "2"] = half) -> float:
            """Area of the number's box that something else covers or that is outside the picture."""
            shared = [np.prod(np.maximum(0, half + other - np.abs(at - where))) for where, other in taken]
            return float(sum(shared) + 1e3 * np.maximum(0, np.abs(at - page / 2) + half - page / 2).sum())

        at = min(tried, key=lambda at: round(covered(at)))
        taken.append((at, half))
        if np.linalg.norm(at - point) > AWAY[1] + half[0]:
            ax.plot(*np.stack([point, at]).T, color=style.INK, lw=style.HAIR)
        _write(ax, at, text, fontweight="bold")


@styled
def sheet(robots: Sequence[Robot]) -> Figure:
    """Draw all ``robots`` in one figure, each commanded to the middle of its workspace."""
    columns = min(6, len(robots))
    rows = -(-len(robots) // columns)
    width, height = CELL[0] * columns, CELL[1] * rows + 88
    figure = canvas(
        width / style.PNG_DPI,
        height / style.PNG_DPI,
        f"{len(robots)} robots",
        "Each platform is commanded to the middle of its workspace; scales differ. Below each robot: kind, number of "
        "cables, mass of the platform, size of the frame.",
        Still,
    )
    left, bottom, *view = CELL_VIEW
    for place, robot in enumerate(robots):
        row, column = divmod(place, columns)
        ax = _axes(figure, (CELL[0] * column + left, height - 40 - CELL[1] * (row + 1) + bottom, *view))
        stage = _stage(robot, robot.pose(robot.home))
        show(ax, stage, stage.whole(view[0] / view[1]))
        ax.set_title(robot.name, loc="center", fontweight="bold", parse_math=False)
        planar = robot.mobility == "planar"
        size = " × ".join(f"{edge:.3g}" for edge in np.ptp(robot.frame, axis=0)[:: 2 if planar else 1])
        text = f"{'planar, ' * planar}{robot.kind}, {robot.cables} cables\n{float(f'{robot.mass:.3g}'):,g} kg, {size} m"
        ax.text(view[0] / 2, -6, text, ha="center", va="top", fontsize=7, color=style.MUTED)
    return figure

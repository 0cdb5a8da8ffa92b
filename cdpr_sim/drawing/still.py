"""Figure of a robot at a commanded pose: frame, exits and numbered cables, and a close-up of the platform."""

# pyright: reportArgumentType=false, reportAttributeAccessIssue=false, reportCallIssue=false
# pyright: reportOptionalMemberAccess=false
# matplotlib's stubs know neither keyword dictionaries nor the axes of its 3D plots.
from __future__ import annotations

import io
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke
from matplotlib.ticker import MaxNLocator
from PIL import Image
from PIL.PngImagePlugin import PngInfo

from cdpr_sim.core.checks import refuse_unless
from cdpr_sim.core.describe import describe_cables
from cdpr_sim.core.pose import PoseLike
from cdpr_sim.core.robot import Robot, without_mass
from cdpr_sim.drawing import style
from cdpr_sim.drawing.axes import canvas, draw_frame, draw_platform, encoded, plot, styled
from cdpr_sim.drawing.cable_curves import cable_curve, wheel_of

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
    position, rotation = at.translation, at.rotation.as_matrix()
    x, y, z = position
    figure = canvas(
        style.WIDTH,
        5.2,
        f"{robot.name}: {robot.description or f'{robot.cables} cables'}",
        f"Numbers: cables, at their exits and anchors. Cross: centre of mass. Commanded to ({x:.4g}, "
        f"{y:.4g}, {z:.4g}) m. A platform of {robot.mass:g} kg on {robot.cables} {describe_cables(robot)}; "
        f"{robot.mobility}.",
        Still,
    )
    grid = figure.add_gridspec(1, 2, width_ratios=(1.55, 1))
    projection = "3d" if robot.mobility == "spatial" else None
    whole, close = (figure.add_subplot(place, projection=projection) for place in grid)
    draw_robot(whole, robot, position, rotation)
    frame = _with_room(robot).frame
    size = float(np.linalg.norm(np.ptp(frame, axis=0)))
    if not projection:  # numbers stand outside the frame, and ticks outside the numbers
        room = 0.09 * size
        whole.set(xlim=frame[:, 0] + [-room, room], ylim=frame[:, 2] + [-room, room])
    _label(whole, robot, robot.exits, frame.mean(0), size)
    whole.set_title("the robot, as commanded", loc="left")
    _close_up(close, robot, position, rotation)
    return figure


def draw_robot(ax: Axes, robot: Robot, position: np.ndarray, rotation: np.ndarray, width: float = style.THIN) -> None:
    """Draw frame, exits, cables and platform, in 3D or in the x-z plane."""
    draw_frame(ax, _with_room(robot))
    straight = without_mass(robot).cabling  # sagging is a result
    for cable, anchor in enumerate(position + robot.anchors @ rotation.T):
        plot(ax, cable_curve(straight, cable, anchor), color=_color(cable), lw=width, zorder=3)
        wheel = wheel_of(straight, cable, anchor)
        if wheel is not None:
            plot(ax, wheel.arc(), color=style.WHEEL["ec"], lw=style.WHEEL["lw"])
    draw_platform(ax, robot, position, rotation)


def _with_room(robot: Robot) -> Robot:
    """The robot with a frame that is thick enough to be drawn."""
    lower, upper = robot.frame
    least = 0.02 * max(np.linalg.norm(upper - lower), np.linalg.norm(robot.platform_size))
    pad = np.where(upper - lower < least, least / 2, 0.0)
    return robot.replace(frame=[lower - pad, upper + pad]) if pad.any() else robot


def _close_up(ax: Axes, robot: Robot, position: np.ndarray, rotation: np.ndarray) -> None:
    """Draw the platform in its own frame, with the last part of each cable."""
    exits, origin, level = (robot.exits - position) @ rotation, np.zeros(3), np.eye(3)
    half = 1.4 * max(float(np.abs(robot.anchors).max()), float(robot.platform_size.max()) / 2)
    around = robot.replace(frame=[(-half, -half, -half), (half, half, half)])
    draw_frame(ax, around, exits=False)
    for cable, (exit_, anchor) in enumerate(zip(exits, robot.anchors, strict=True)):
        away = exit_ - anchor
        end = anchor + away * min(1.0, 0.5 * half / max(float(np.linalg.norm(away)), 1e-12))
        plot(ax, np.stack([anchor, end]), color=_color(cable), lw=style.LINE, zorder=3)
    draw_platform(ax, robot, origin, level, alpha=0.6)
    plot(ax, robot.anchors, ls="none", marker="o", ms=3.5, color=style.INK, zorder=6)
    plot(ax, robot.center_of_mass[None], ls="none", marker="+", ms=9, color=style.INK, zorder=6)
    _label(ax, robot, robot.anchors, origin, 2 * half, beside=0.08)
    ax.set_title("the platform, in its own frame", loc="left")
    in_space = robot.mobility == "spatial"
    for axis in (ax.xaxis, ax.yaxis, *([ax.zaxis] if in_space else [])):
        axis.set_major_locator(MaxNLocator(3, prune="both" if in_space else None))


def _label(ax: Axes, robot: Robot, points: np.ndarray, middle: np.ndarray, size: float, beside: float = 0.055) -> None:
    """Write cable numbers beside their points, outwards from the middle; numbers of the same point together."""
    places: dict[tuple[float, ...], list[int]] = {}
    for cable, point in enumerate(points):
        places.setdefault(tuple(np.round(point / size, 3)), []).append(cable)
    for cables in places.values():
        point = points[cables[0]]
        outwards = point - middle
        outwards = outwards / (np.linalg.norm(outwards) or 1.0)
        at = point + beside * size * outwards
        numbers = ", ".join(str(cable + 1) for cable in cables)
        looks = {"color": style.INK, "fontsize": 8, "fontweight": "bold", "ha": "center", "va": "center", "zorder": 7}
        looks["path_effects"] = [withStroke(linewidth=2.5, foreground="white")]  # legible over cables and edges
        ax.text(*(at if robot.mobility == "spatial" else at[[0, 2]]), numbers, **looks)


def _color(cable: int) -> str:
    return style.CABLES[cable % len(style.CABLES)]


@styled
def sheet(robots: Sequence[Robot]) -> Figure:
    """Draw all ``robots`` in one figure, each commanded to the middle of its workspace."""
    columns = min(6, len(robots))
    rows = -(-len(robots) // columns)
    figure = canvas(
        2.1 * columns,
        2.5 * rows + 0.8,
        f"{len(robots)} robots",
        "Each platform is commanded to the middle of its workspace; scales differ. Below each robot: kind, number of "
        "cables, mass of the platform, size of the frame.",
        Still,
    )
    figure.get_layout_engine().set(hspace=0.2, rect=(0, 0.03, 1, 0.95))  # room for text below
    for place, robot in zip(figure.add_gridspec(rows, columns), robots, strict=False):
        in_space = robot.mobility == "spatial"
        ax = figure.add_subplot(place, projection="3d" if in_space else None)
        draw_robot(ax, robot, robot.home, np.eye(3), width=style.HAIR)
        ax.set_axis_off()
        ax.set_title(robot.name, loc="center", fontweight="bold", parse_math=False)
        size = " × ".join(f"{edge:.3g}" for edge in np.ptp(robot.frame, axis=0)[:: 1 if in_space else 2])
        kind = robot.kind if in_space else f"planar, {robot.kind}"
        text = f"{kind}, {robot.cables} cables\n{float(f'{robot.mass:.3g}'):,g} kg, {size} m"
        (ax.text2D if in_space else ax.text)(
            0.5, -0.03, text, transform=ax.transAxes, ha="center", va="top", fontsize=7, color=style.MUTED
        )
    return figure

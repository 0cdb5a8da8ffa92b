"""Robots on matplotlib axes, in 3D or in the x-z plane: frames, platforms, taut and slack cables, pulleys, legends."""

# pyright: reportArgumentType=false, reportAttributeAccessIssue=false, reportCallIssue=false
# matplotlib's stubs know neither keyword dictionaries nor the axes of its 3D plots.
from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
from jaxtyping import Float
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, Polygon, Rectangle
from matplotlib.ticker import MaxNLocator
from mpl_toolkits.mplot3d import Axes3D
from mpl_toolkits.mplot3d.art3d import Line3DCollection, Poly3DCollection
from mpl_toolkits.mplot3d.proj3d import proj_transform

from cdpr_sim.core.equilibrium_batch import EquilibriumBatch
from cdpr_sim.core.robot import Robot
from cdpr_sim.drawing import style
from cdpr_sim.drawing.cable_curves import cable_curve, wheel_of, with_moved_exits
from cdpr_sim.drawing.figures import key

FACES = ((0, 1, 3, 2), (4, 5, 7, 6), (0, 1, 5, 4), (2, 3, 7, 6), (0, 2, 6, 4), (1, 3, 7, 5))
EDGES = ((0, 1), (2, 3), (4, 5), (6, 7), (0, 2), (1, 3), (4, 6), (5, 7), (0, 4), (1, 5), (2, 6), (3, 7))
"""Faces and edges of a box whose corners are numbered in binary (x, y, z)."""


def plot(ax: Axes, points: Float[np.ndarray, "points 3"], **looks) -> None:
    """Draw a curve [m]."""
    ax.plot(*(points.T if isinstance(ax, Axes3D) else points[:, [0, 2]].T), **looks)


def draw_frame(ax: Axes, robot: Robot) -> None:
    """Draw the frame and the exits, to scale [m], with labelled axes."""
    if isinstance(ax, Axes3D):
        _draw_frame_in_space(ax, robot)
        return
    (left, _, bottom), (right, _, top) = robot.frame
    ax.add_patch(Rectangle((left, bottom), right - left, top - bottom, fill=False, ec=style.FAINT, lw=style.THIN))
    ax.plot(*robot.exits[:, [0, 2]].T, "o", ms=3.5, color=style.INK, zorder=5, clip_on=False)
    ax.set(aspect="equal", xlabel="x [m]", ylabel="z [m]")
    ax.set_xlim(left - 0.02, right + 0.02)
    ax.set_ylim(bottom - 0.02, top + 0.02)
    ax.spines[:].set_visible(False)


def _draw_frame_in_space(ax: Axes3D, robot: Robot) -> None:
    lower, upper = robot.frame
    ax.add_collection3d(Line3DCollection(_edges(_corners(lower, upper)), colors=style.FAINT, lw=style.THIN))
    ax.plot(*robot.exits.T, "o", ms=3, color=style.INK)
    ax.set(xlabel="x [m]", ylabel="y [m]", zlabel="z [m]")
    ax.set_xlim(lower[0], upper[0])
    ax.set_ylim(lower[1], upper[1])
    ax.set_zlim(lower[2], upper[2])
    ax.set_box_aspect(tuple(upper - lower), zoom=1.0)
    ax.set_proj_type("persp", focal_length=0.6)
    ax.view_init(elev=14, azim=-72)
    # Each axis omits the tick label at the corner that it shares with the next axis.
    ax.xaxis.set_major_locator(MaxNLocator(5, prune="upper"))
    ax.set_yticks(np.linspace(lower[1], upper[1], 3)[1:])
    ax.zaxis.set_major_locator(MaxNLocator(5, prune="lower"))
    for axis in (ax.xaxis, ax.yaxis, ax.zaxis):
        axis.pane.fill = False
        axis.pane.set_edgecolor("white")
    ax.grid(visible=False)


def draw_platform(ax: Axes, robot: Robot, position: np.ndarray, rotation: np.ndarray, **looks) -> None:
    """Draw the platform: its box, or the section of it."""
    half, looks = robot.platform_size / 2, {"fc": style.PLATFORM, "ec": style.INK, "zorder": 4} | looks
    if isinstance(ax, Axes3D):
        corners = position + _corners(-half, half) @ rotation.T
        alpha = looks.pop("alpha", 1.0)  # set after the colours, to which it applies
        faces = [corners[list(face)] for face in FACES]
        ax.add_collection3d(Poly3DCollection(faces, **{"lw": 0.6, "shade": False} | looks, alpha=alpha))
    else:
        corners = position + half * [[-1, 0, -1], [1, 0, -1], [1, 0, 1], [-1, 0, 1]] @ rotation.T
        ax.add_patch(Polygon(corners[:, [0, 2]], closed=True, **{"lw": style.HAIR + 0.2} | looks))


def draw_commanded(ax: Axes, robot: Robot, position: np.ndarray) -> None:
    """Draw the commanded level pose as an outline; in the plane above the platform, since both may coincide."""
    if isinstance(ax, Axes3D):
        half = robot.platform_size / 2
        box = position + _corners(-half, half)
        dashed = {"colors": style.COMMANDED, "lw": 0.7, "ls": style.COMMANDED_DASH}
        ax.add_collection3d(Line3DCollection(_edges(box), **dashed))
    else:
        looks = {"fc": "none", "ec": style.COMMANDED, "lw": style.THIN, "ls": style.COMMANDED_DASH, "zorder": 4.5}
        draw_platform(ax, robot, position, np.eye(3), **looks)


def draw_cables(
    ax: Axes,
    robot: Robot,
    position: np.ndarray,
    rotation: np.ndarray,
    slack: Iterable[bool],
    rest_lengths: Iterable[float] | None = None,
    shapes: Float[np.ndarray, "cables points 3"] | None = None,
    **looks,
) -> None:
    """Draw taut cables as straight lines; slack ones dotted, in another colour, sagging with their rest length.

    Cables over pulleys leave from their wheels, which are drawn too. The ``shapes`` of cables with mass are those of
    ``cable_profiles``.

    Raises:
        InvalidInput: cables with mass without ``shapes``.
    """
    in_space = isinstance(ax, Axes3D)
    dotted = {"color": style.SLACK_CABLE, "ls": style.SLACK_DASH}
    dotted |= {"lw": 1.2} if in_space else {"lw": 1.4, "zorder": 3}
    line = {"color": style.INK} | ({"lw": 0.6} if in_space else {"lw": style.HAIR + 0.2, "zorder": 2.5}) | looks
    anchors = position + robot.anchors @ rotation.T
    lengths = [None] * robot.cables if rest_lengths is None else rest_lengths
    for cable, (anchor, is_slack, rest_length) in enumerate(zip(anchors, slack, lengths, strict=True)):
        length = float(rest_length) if is_slack and rest_length is not None else None
        curve = cable_curve(robot.cabling, cable, anchor, length, None if shapes is None else shapes[cable])
        plot(ax, curve, **dotted if is_slack else line)
        wheel = wheel_of(robot.cabling, cable, anchor)
        if wheel is not None and in_space:
            plot(ax, wheel.arc(), color=style.WHEEL["ec"], lw=style.WHEEL["lw"])
        elif wheel is not None:
            ax.add_patch(Polygon(wheel.arc()[:, [0, 2]], closed=True, **style.WHEEL, zorder=2.4))


def draw_pose(
    ax: Axes, equilibria: EquilibriumBatch, row: int, shapes: Float[np.ndarray, "cables points 3"] | None = None
) -> None:
    """Draw one equilibrium with the outline of its commanded pose, taut and slack cables, and pulley wheels.

    Raises:
        InvalidInput: cables with mass without ``shapes`` from ``cable_profiles``.
    """
    position, rotation = equilibria.positions[row], equilibria.rotations[row]
    anchors = position + equilibria.robot.anchors @ rotation.T
    robot = with_moved_exits(equilibria.robot, anchors, equilibria.tensions[row], shapes)
    draw_commanded(ax, robot, equilibria.problems.positions[row])
    draw_platform(ax, robot, position, rotation)
    draw_cables(ax, robot, position, rotation, equilibria.slack[row], equilibria.rest_lengths[row], shapes)


def seen(ax: Axes3D, point: np.ndarray) -> tuple[float, float]:
    """Projection of a 3D point to the 2D coordinates of the axes."""
    x, y, _ = proj_transform(*point, ax.get_proj())
    return float(x), float(y)


def _corners(lower: np.ndarray, upper: np.ndarray) -> Float[np.ndarray, "8 3"]:
    choice = (np.arange(8)[:, None] >> np.array([2, 1, 0])) & 1
    return np.where(choice, upper, lower)


def _edges(corners: Float[np.ndarray, "8 3"]) -> list[Float[np.ndarray, "2 3"]]:
    return [corners[list(edge)] for edge in EDGES]


def pose_legend(*, slack: bool) -> list[Patch | Line2D]:
    """Legend of a drawn pose."""
    handles = [
        Patch(fc="none", ec=style.COMMANDED, ls=style.COMMANDED_DASH, label="commanded pose"),
        Patch(fc=style.PLATFORM, ec=style.INK, lw=style.HAIR, label="platform at equilibrium"),
        key("taut cable", color=style.INK, lw=style.HAIR + 0.2),
    ]
    if slack:
        handles.append(slack_key())
    return handles


def points(color: str, marker: str = "o", **looks) -> dict:
    """Marker style of MuJoCo's points: hollow."""
    return {"ls": "none", "marker": marker, "mfc": "white", "mec": color, "mew": 1.1, "zorder": 6} | looks


def legend_below(ax: Axes, handles: Sequence[Artist], down: float, columns: int = 2) -> None:
    """Place a legend below the axes, ``down`` in heights of the axes."""
    ax.legend(handles=handles, loc="upper center", bbox_to_anchor=(0.5, -down), ncols=columns)


def slack_key(label: str = "slack cable") -> Line2D:
    """Legend entry of slack cables."""
    return key(label, color=style.SLACK_CABLE, lw=1.4, ls=style.SLACK_DASH)

"""Cause of the tilt of a planar platform on parallel cables: intersection of its two sides' forces (paper, Fig. 9)."""

# pyright: reportArgumentType=false, reportAttributeAccessIssue=false, reportCallIssue=false
# matplotlib's stubs know neither keyword dictionaries nor the axes of its 3D plots.
from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import ArrayLike

import robots_on_axes as drawing
from cdpr_sim.core.describe import newtons
from cdpr_sim.core.robot import Robot
from cdpr_sim.drawing import style
from cdpr_sim.drawing.figures import canvas, key, styled
from cdpr_sim.robots.catalogue import load_robot
from cdpr_sim.statics.forces import at, geometry
from cdpr_sim.statics.given_tensions import cut
from cdpr_sim.statics.solve import solve

DIRECTIONS = 10
"""Choices of equal tensions of cables with mass, each with the directions in which they pull under the last."""


@dataclass(frozen=True, eq=False)
class MomentBalance:
    """Moment balance of a planar platform on two pairs of cables (Fig. 9).

    Attributes:
        robot: the robot.
        position: of the platform (and of its centre of mass), (3,) [m].
        rotation: (3, 3).
        wrench_matrix: (6, cables).
        tensions: (cables,) [N].
        rest_lengths: (cables,) [m], at the commanded pose.
        slack: which cables are slack, (cables,).
        at_rest: whether the tensions are those of the equilibrium, or equal in each pair.
    """

    robot: Robot
    position: Float[np.ndarray, "3"]
    rotation: Float[np.ndarray, "3 3"]
    wrench_matrix: Float[np.ndarray, "6 cables"]
    tensions: Float[np.ndarray, " cables"]
    rest_lengths: Float[np.ndarray, " cables"]
    slack: Bool[np.ndarray, " cables"]
    at_rest: bool

    @cached_property
    def lines_of_force(self) -> tuple[Float[np.ndarray, "2 3"], Float[np.ndarray, "2 3"]]:
        """A point on each side's line of force [m], and unit vectors along them."""
        forces = (self.tensions * self.wrench_matrix[:3]).T.reshape(2, -1, 3)
        anchors = (self.position + self.robot.anchors @ self.rotation.T).reshape(2, -1, 3)
        starts = np.array([_point_of_action(points, pair) for points, pair in zip(anchors, forces, strict=True)])
        total = forces.sum(1)
        return starts, total / np.linalg.norm(total, axis=1, keepdims=True)

    @cached_property
    def intersection(self) -> Float[np.ndarray, "3"]:
        """Of the two lines of force, (3,) [m]; ``point`` for equal tensions in each pair."""
        starts, directions = self.lines_of_force
        plane = np.stack([directions[0, [0, 2]], -directions[1, [0, 2]]], -1)
        return starts[0] + np.linalg.solve(plane, (starts[1] - starts[0])[[0, 2]])[0] * directions[0]

    @property
    def point(self) -> str:
        """The paper's name of the midlines' intersection: "H" for horizontal pairs, "V" for vertical ones."""
        return "H" if self.robot.anchors[0, 2] == self.robot.anchors[1, 2] else "V"

    @property
    def arm(self) -> float:
        """Horizontal distance of the centre of mass from the intersection [m], positive to the right."""
        return float(self.position[0] - self.intersection[0])

    @property
    def moment(self) -> float:
        """Of the weight about the intersection [N m], positive as rotation about y: m g arm."""
        return self.robot.weight * self.arm

    @property
    def net_moment(self) -> float:
        """Of all forces together about y, by the wrench matrix [N m]; equals ``moment``."""
        return float((self.wrench_matrix @ self.tensions)[4])


def equal_pulls(robot: Robot, position: ArrayLike) -> MomentBalance:
    """Moment balance at a level pose, with equal tensions in each pair that carry the weight.

    The intersection is the paper's point H or V, and ``net_moment`` tilts the platform.
    """
    position = np.asarray(position, dtype=float)
    rotation = np.eye(3)
    pulls, tensions = geometry(robot, position, rotation).wrench_matrix, np.zeros(robot.cables)
    for _ in range(1 if robot.cabling.massless else DIRECTIONS):
        pairs = pulls.reshape(6, 2, -1).sum(-1)  # unit tension in both cables of a pair
        sides = np.linalg.solve(pairs[[0, 2]], [0.0, robot.weight])
        tensions = np.repeat(sides, robot.cables // 2)
        pulls = pulls if robot.cabling.massless else cut(robot, position, rotation, tensions)[1]
    return MomentBalance(
        robot, position, rotation, pulls, tensions, robot.rest_lengths(position), tensions <= 0, at_rest=False
    )


def balance_at_rest(robot: Robot, commanded: ArrayLike) -> MomentBalance:
    """Moment balance at the static equilibrium: the lines intersect on the vertical through the centre of mass.

    Raises:
        NotConverged: the static solver found no equilibrium.
    """
    one = solve(robot, np.asarray(commanded, dtype=float))
    rotation = one.rotation.as_matrix()
    pulls = at(one.problem, one.position, rotation).wrench_matrix
    return MomentBalance(robot, one.position, rotation, pulls, one.tensions, one.rest_lengths, one.slack, at_rest=True)


def moment_balances() -> tuple[MomentBalance, ...]:
    """Cases of Fig. 9: horizontal pairs beside the middle; vertical pairs at the middle, beside it, and at equilibrium.

    Raises:
        NotConverged: the static solver found no equilibrium.
    """
    horizontal, vertical = load_robot("planar-horizontal"), load_robot("planar-vertical")
    middle, beside = np.array([0.4, 0.0, 0.2]), np.array([0.25, 0.0, 0.2])
    return (
        equal_pulls(horizontal, beside),
        equal_pulls(vertical, middle),
        equal_pulls(vertical, beside),
        balance_at_rest(vertical.replace(material="fishing-0.4mm"), beside),
    )


def _point_of_action(
    points: Float[np.ndarray, "pair 3"], forces: Float[np.ndarray, "pair 3"]
) -> Float[np.ndarray, "3"]:
    """The point on the line of the resultant of ``forces`` in the x-z plane that is closest to the anchors' middle."""
    total, middle = forces.sum(0), points.mean(0)
    moment = np.cross(points - middle, forces).sum(0)
    return middle + np.cross(total, moment) / (total @ total)


# Figure


@styled
def draw_moment_balances(balances: Sequence[MomentBalance]) -> Figure:
    """Fig. 9: intersection of the lines of force of the two sides, and the moment of the weight about it."""
    softest = newtons(min(balance.robot.axial_stiffness.min() for balance in balances if balance.at_rest))
    figure = canvas(
        10.5,
        7.6,
        "The platform tilts where the line of the weight misses the intersection of the two sides' forces",
        "With equal tensions in a pair, their resultant lies on the pair's midline; the midlines intersect at the "
        "paper's points H and V. The weight times the distance of its line from this point is the moment that "
        f"rotates the platform; at equilibrium (EA = {softest}) the tensions have changed such that it vanishes. "
        "(Paper, Fig. 9)",
    )
    axes = figure.subplots(2, 2)
    for ax, balance, letter in zip(axes.flat, balances, "abcd", strict=True):
        _draw_balance(ax, balance, letter)
    axes[1, 1].legend(
        handles=[
            key("line of a side's force", ls=(0, (6, 1.5, 1, 1.5)), lw=1.2, color=style.BLUE),
            key("intersection", ls="none", marker="D", color=style.BLUE, mec="white", ms=8),
            key("line of the weight", ls=(0, (4, 2)), lw=1.1, color=style.VERMILLION),
            drawing.slack_key(),
        ],
        loc="lower right",
        bbox_to_anchor=(0.955, 0),
        borderaxespad=0,
    )
    return figure


def _draw_balance(ax: Axes, balance: MomentBalance, letter: str) -> None:
    robot = balance.robot
    drawing.draw_frame(ax, robot)
    ax.set_ylim(0.08, 0.52)
    drawing.draw_cables(ax, robot, balance.position, balance.rotation, balance.slack, balance.rest_lengths)
    drawing.draw_platform(ax, robot, balance.position, balance.rotation, alpha=0.9)
    meeting, center = balance.intersection, balance.position
    for start, direction in zip(*balance.lines_of_force, strict=True):
        reach = (robot.exits[:, 2].max() - start[2]) / direction[2]
        below = min(0.0, (meeting - start) @ direction - 0.03)
        ends = start + np.array([[below], [reach]]) * direction
        ax.plot(ends[:, 0], ends[:, 2], ls=(0, (6, 1.5, 1, 1.5)), lw=1.2, color=style.BLUE, zorder=5)
    ax.plot([center[0]] * 2, [-0.02, 0.5], ls=(0, (4, 2)), lw=1.1, color=style.VERMILLION, zorder=5)
    ax.annotate(
        "",
        (center[0], center[2] - 0.085),
        (center[0], center[2]),
        arrowprops={"arrowstyle": "-|>", "color": style.VERMILLION, "lw": 2, "shrinkA": 0, "shrinkB": 0},
        zorder=7,
    )
    ax.plot(center[0], center[2], "o", color=style.VERMILLION, ms=5, zorder=8)
    ax.plot(meeting[0], meeting[2], "D", color=style.BLUE, mec="white", ms=8, zorder=9, gid="meeting point")
    ax.annotate(
        "intersection" if balance.at_rest else balance.point,
        (meeting[0], meeting[2]),
        (-9, -11)
        if balance.point == "H"
        else (-13, -4),  # H lies on the platform's edge: its label is placed on the platform
        textcoords="offset points",
        ha="right",
        fontweight="bold",
        color=style.BLUE,
        bbox={"boxstyle": "round,pad=0.15", "fc": "white", "ec": "none", "alpha": 0.8},
        zorder=10,
    )
    beta = np.degrees(np.arctan2(balance.rotation[0, 2], balance.rotation[2, 2]))
    state = f"equilibrium, rotation about y {beta:.1f}°" if balance.at_rest else "level, equal tensions in each pair"
    ax.set_title(f"({letter}) {robot.name}: {state}\n{_moment(balance)}")


def _moment(balance: MomentBalance) -> str:
    """The moment balance as text."""
    if abs(balance.arm) < 1e-6:
        return "the weight passes through the intersection: no moment"
    return (
        f"the weight passes {1e3 * abs(balance.arm):.0f} mm beside it: "
        f"{balance.robot.weight:.2f} N × {1e3 * abs(balance.arm):.0f} mm = {1e3 * abs(balance.moment):.0f} N mm"
    )

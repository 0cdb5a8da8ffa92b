"""Curves of cables for drawing, from exit to anchor, and the wheels of pulleys. Geometry only.

A taut cable is straight, a slack one sags with its rest length; a cable over a pulley follows the wheel and leaves it
on the tangent to its anchor. The profile of a cable with mass is not geometry: it has to be given.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from cdpr_sim.core import cable_path
from cdpr_sim.core.cable import Cabling
from cdpr_sim.core.errors import InvalidInput
from cdpr_sim.core.robot import Robot, beside

POINTS = 25
"""Number of points along a slack cable."""

ARC = 24
"""Number of points around a full wheel."""

Curve = Float[np.ndarray, "points 3"]


@dataclass(frozen=True)
class Wheel:
    """The wheel of one pulley, turned towards its anchor.

    Attributes:
        center: (3,) [m].
        outwards: unit vector from the pulley's axis to the centre, (3,); with ``axis`` it spans the wheel's plane.
        axis: the direction in which the cable arrives, (3,).
        radius: [m].
        wrap: angle [rad] over which the cable lies on it, from the exit.
    """

    center: Float[np.ndarray, "3"]
    outwards: Float[np.ndarray, "3"]
    axis: Float[np.ndarray, "3"]
    radius: float
    wrap: float

    def arc(self, angle: float = 2 * np.pi) -> Curve:
        """The rim from the exit over this angle, in the direction of the cable; the full rim by default."""
        angles = np.linspace(0.0, angle, max(2, 1 + int(np.ceil(ARC * angle / (2 * np.pi)))))[:, None]
        return self.center + self.radius * (np.sin(angles) * self.axis - np.cos(angles) * self.outwards)

    def angle_to(self, point: Float[np.ndarray, "3"]) -> float:
        """Of a point of the rim, the way the cable goes."""
        away = point - self.center
        return float(np.mod(np.arctan2(away @ self.axis, -away @ self.outwards), 2 * np.pi))


def with_moved_exits(
    robot: Robot,
    anchors: Float[np.ndarray, "cables 3"],
    tensions: Float[np.ndarray, " cables"],
    shapes: Float[np.ndarray, "cables points 3"] | None,
    times: float = 1.0,
) -> Robot:
    """The robot with its exits where they are under these tensions [N] to ``anchors``; they move ``times`` as far.

    Those of cables with mass are where their profiles, ``shapes``, begin; over a pulley those of massless cables.
    """
    cabling = robot.cabling
    if cabling.rigid_exits:
        return robot
    moves = cable_path.exit_moves(cabling, robot.exits - anchors, cabling.pulls(tensions))
    if shapes is not None:
        hang = cabling.moving_exits & cabling.with_mass & ~cabling.pulleys
        moves[hang] = (shapes[:, 0] - robot.exits)[hang]
    return beside(robot, "exits", robot.exits + times * np.nan_to_num(moves))


def wheel_of(cabling: Cabling, cable: int, anchor: Float[np.ndarray, "3"]) -> Wheel | None:
    """Wheel of a cable to ``anchor``, base frame [m]; None without a pulley, or if the anchor lies within the wheel."""
    if not cabling.pulleys[cable]:
        return None
    found = cable_path.wheel(cabling, cable, anchor)
    return None if np.isnan(found[-1]) else Wheel(*found)


def cable_curve(
    cabling: Cabling,
    cable: int,
    anchor: Float[np.ndarray, "3"],
    rest_length: float | None = None,
    shape: Float[np.ndarray, "hanging 3"] | None = None,
) -> Curve:
    """The curve of one cable from its exit to ``anchor``, base frame [m].

    Args:
        cabling: the robot's.
        cable: index of the cable.
        anchor: its end, (3,) [m].
        rest_length: of a slack cable [m]; None draws it straight.
        shape: profile of a cable with mass from where it leaves its wheel, (hanging, 3) [m]; it is shifted linearly if
            its end is drawn elsewhere.

    Raises:
        InvalidInput: a cable with mass without its profile.
    """
    if cabling.with_mass[cable]:
        if shape is None:
            raise InvalidInput(
                f"shapes: found none of cable {cable + 1}, which has mass, expected its profile, from cable_profiles"
            )
        free = shape + np.linspace(0, 1, len(shape))[:, None] * (anchor - shape[-1])
        wheel = wheel_of(cabling, cable, anchor)
        return free if wheel is None else np.concatenate([wheel.arc(wheel.angle_to(free[0]))[:-1], free])
    start, wheel = cabling.exits[cable], wheel_of(cabling, cable, anchor)
    before = np.empty((0, 3))
    if wheel is not None:
        arc = wheel.arc(wheel.wrap)
        before, start = arc[:-1], arc[-1]
        rest_length = None if rest_length is None else rest_length - wheel.radius * wheel.wrap
    free = np.stack([start, anchor]) if rest_length is None else sagging_curve(start, anchor, rest_length)
    return np.concatenate([before, free])


def sagging_curve(
    start: Float[np.ndarray, "3"], end: Float[np.ndarray, "3"], rest_length: float, points: int = POINTS
) -> Curve:
    """A parabola from start to end of about ``rest_length``: longer than the straight line by 8 (s cos a)²/(3 l).

    s is the sag below the straight line and a its slope; steep cables are drawn with the sag of a = 70°.
    """
    length = float(np.linalg.norm(end - start))
    level = max(float(np.hypot(*(end - start)[:2])) / length, np.cos(np.radians(70)))
    sag = np.sqrt(max(rest_length - length, 0.0) * 3 * length / 8) / level
    along = np.linspace(0, 1, points)[:, None]
    return start + along * (end - start) - 4 * sag * along * (1 - along) * np.array([0.0, 0.0, 1.0])

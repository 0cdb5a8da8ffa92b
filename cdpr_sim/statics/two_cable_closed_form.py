"""The two-cable robot's tilt in closed form: a reference that is independent of elasticity.

A bar of half length b hangs on two cables by its ends, its centre of mass in the middle at p. It is in equilibrium
where the lines of both cables and the vertical through p meet in one point. With X = A_x − p_x, h = A_z − p_z for each
exit, s = sin θ, c = cos θ, the lines of cables 1 and 2 cross the vertical through p at the heights

    −b s + b c (h1 + b s)/(X1 + b c)   and   b s − b c (h2 − b s)/(X2 − b c),

and equating them gives, for θ counter-clockwise in the x-z plane,

    −2 s X1 X2 + c (h1 X2 + h2 X1) + b s c (X1 − X2) + b c² (h2 − h1) = 0,

a quartic in t = tan(θ/2). The paper's Eq. 5 and 6 have terms of the wrong dimension; corrected, they give
tan θ = (h1 X2 + h2 X1)/(2 X1 X2), which is this equation for b → 0.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float
from numpy.typing import ArrayLike

from cdpr_sim.core.checks import checked_array
from cdpr_sim.core.errors import InvalidInput
from cdpr_sim.core.robot import Robot

_REAL = 1e-7
"""Imaginary part below which a root of the quartic counts as real (the error of a double root is the square root of
rounding)."""


def equilibrium_rotations(robot: Robot, position: ArrayLike) -> Float[np.ndarray, " rotations"]:
    """Every rotation about y [rad] at which the bar is in equilibrium at ``position`` with both cables pulling.

    Counter-clockwise in the x-z plane is a negative rotation about y: beta = ``euler[1]`` = −θ.

    Args:
        robot: a planar robot with two cables at the ends of a bar, its centre of mass in the middle.
        position: of the bar's middle, (3,) [m].

    Raises:
        InvalidInput: another robot, cables with mass or over pulleys, or an invalid position.
    """
    (X1, X2), (h1, h2), b = _geometry(robot, position)
    H, D, P, Q = h1 * X2 + h2 * X1, b * (X1 - X2), X1 * X2, b * (h2 - h1)
    roots = np.roots([Q - H, -4 * P - 2 * D, -2 * Q, 2 * D - 4 * P, Q + H])
    theta = 2 * np.arctan(roots[np.abs(roots.imag) < _REAL].real)
    if np.isclose(Q, H):  # the leading term of the quartic vanishes: t = ∞, the bar upside down
        theta = np.append(theta, np.pi)
    beta = -theta
    pulling = [(tensions(robot, position, angle) > 0).all() for angle in beta]
    return np.sort(beta[pulling])


def tensions(robot: Robot, position: ArrayLike, rotation: float) -> Float[np.ndarray, "2"]:
    """The two tensions [N] that carry the weight at ``position`` and ``rotation`` about y; a negative one means a push.

    Raises:
        InvalidInput: another robot, or an invalid position.
    """
    (X1, X2), (h1, h2), b = _geometry(robot, position)
    s, c = np.sin(-rotation), np.cos(rotation)
    cables = np.array([[X1 + b * c, X2 - b * c], [h1 + b * s, h2 - b * s]])
    directions = cables / np.linalg.norm(cables, axis=0)
    try:
        return np.linalg.solve(directions, [0.0, robot.weight])
    except np.linalg.LinAlgError:
        return np.full(2, np.nan)


def short_bar_rotation(robot: Robot, position: ArrayLike) -> float:
    """The paper's Eq. 5 and 6, corrected: the rotation about y [rad] of a bar of negligible length.

    Raises:
        InvalidInput: another robot, or an invalid position.
    """
    (X1, X2), (h1, h2), _ = _geometry(robot, position)
    return float(-np.arctan((h1 * X2 + h2 * X1) / (2 * X1 * X2)))


def _geometry(robot: Robot, position: ArrayLike) -> tuple[np.ndarray, np.ndarray, float]:
    """(X1, X2), (h1, h2) and b [m]."""
    robot.cabling.refuse_unknown("closed form", "two-cable closed form")
    first, second = (robot.anchors[0], robot.anchors[-1])
    if (
        robot.cables != 2
        or robot.mobility != "planar"
        or not np.allclose(first, -second, rtol=0, atol=1e-12)
        or first[2] != 0
        or not first[0] < 0
        or robot.center_of_mass.any()
    ):
        raise InvalidInput(
            f"robot: found {robot.name!r}, expected a planar bar on two cables, the first at its -x end, with its "
            "centre of mass in the middle"
        )
    x, _, z = checked_array("position", position, (3,))
    return robot.exits[:, 0] - x, robot.exits[:, 2] - z, float(second[0])

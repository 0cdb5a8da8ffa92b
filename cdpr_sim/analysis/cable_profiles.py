"""Profiles of cables between their exits and a platform in equilibrium, for drawing and distances."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from cdpr_sim.core.checks import refuse_unless, whole
from cdpr_sim.core.equilibrium_batch import EquilibriumBatch
from cdpr_sim.statics import profiles

MOST_POINTS = 100_000
"""Largest number of points along a cable; a picture has fewer pixels."""


def cable_profiles(equilibria: EquilibriumBatch, points: int = 25) -> Float[np.ndarray, "*batch cables points 3"]:
    """Points along each cable from exit to anchor, with the platforms at the poses of ``equilibria`` [m], base frame.

    They are equally spaced on the unstretched cable. A massless taut cable is straight; a massless slack one has the
    profile of the limit of small weight; nan for massless cables over pulleys, whose path over the wheel
    the drawing functions compute. Profiles of cables with mass over pulleys begin where the cable leaves its wheel.

    Args:
        equilibria: equilibria by either method.
        points: number of points along each cable, 2 or more.

    Returns:
        (..., cables, points, 3) [m]; nan for massless cables over pulleys.

    Raises:
        InvalidInput: not equilibria, or those of several robots; fewer than 2 points, or not an integer.
    """
    refuse_unless(EquilibriumBatch, equilibria=equilibria)
    equilibria.problems.refuse_several_robots("equilibria")
    whole("points", points, 2, MOST_POINTS)
    robot = equilibria.robot
    anchors = equilibria.positions[..., None, :] + robot.anchors @ np.swapaxes(equilibria.rotations, -1, -2)
    exits = profiles.moved_exits(equilibria, robot.exits, anchors)
    shapes = profiles.profiles(
        robot, exits, anchors, equilibria.rest_lengths, equilibria.problems.axial_stiffness,
        robot.cable_weights, points,
    )  # fmt: skip
    shapes[..., robot.cabling.pulleys & ~robot.cabling.with_mass, :, :] = np.nan
    return shapes

"""How cables hang between their exits and a platform at rest, for whoever draws them."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from cdpr_sim.core.checks import refuse_unless, whole
from cdpr_sim.core.equilibrium_batch import EquilibriumBatch
from cdpr_sim.statics import any_cable

MOST_POINTS = 100_000
"""Along a cable; a picture has fewer pixels."""


def cable_profiles(equilibria: EquilibriumBatch, points: int = 25) -> Float[np.ndarray, "*batch cables points 3"]:
    """Points along each cable from exit to anchor, with the platforms where ``equilibria`` has them [m], base frame.

    They are equally far apart on the cable at rest. A massless taut cable is straight, a massless slack one hangs as
    its weight's last trace would have it; nan of massless cables over pulleys, which drawing leads over their wheels by
    itself. Those of cables with mass over pulleys begin where the cable leaves its wheel.

    Args:
        equilibria: platforms at rest, by either method.
        points: along each cable, 2 or more.

    Returns:
        (..., cables, points, 3) [m]; nan of massless cables over pulleys.

    Raises:
        InvalidInput: no rests; fewer points, or no whole number of them.
    """
    refuse_unless(EquilibriumBatch, equilibria=equilibria)
    whole("points", points, 2, MOST_POINTS)
    robot = equilibria.robot
    anchors = equilibria.positions[..., None, :] + robot.anchors @ np.swapaxes(equilibria.rotations, -1, -2)
    shapes = any_cable.profiles(
        robot.cabling, robot.exits, anchors, equilibria.rest_lengths, equilibria.problems.axial_stiffness,
        robot.cable_weights, robot.wrapped_lengths, points,
    )  # fmt: skip
    shapes[..., robot.cabling.pulleys & (robot.linear_density == 0), :, :] = np.nan
    return shapes

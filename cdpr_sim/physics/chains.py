"""A cable that has weight, in MuJoCo."""

from __future__ import annotations

from cdpr_sim.core.errors import InvalidInput
from cdpr_sim.core.robot import Robot


def refuse_weight(robot: Robot, doing: str) -> None:
    """Weight is not ignored in silence.

    Raises:
        InvalidInput: a robot whose cables have weight.
    """
    if not robot.cabling.massless:
        raise InvalidInput(
            f"linear_density: found {robot.cabling.linear_density.max():g} kg/m, expected massless cables: "
            f"{doing} takes no account of their weight"
        )

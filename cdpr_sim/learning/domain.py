"""Domain randomisation: robots whose parameters differ from the nominal ones in each episode."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
from jaxtyping import Float

from cdpr_sim.core.checks import checked_array
from cdpr_sim.core.errors import InvalidInput
from cdpr_sim.core.robot import Robot


@dataclass(frozen=True)
class Domain:
    """Ranges from which the parameters of an episode are drawn, uniformly and independently.

    Attributes:
        axial_stiffness: largest deviation of each cable's EA, as a fraction.
        mass: largest deviation of the platform's mass and inertia, as a fraction.
        exits: largest deviation of each coordinate of an exit [m].
        friction: largest coefficient of the viscous friction of each rope at its exit [N s/m]. Friction never makes a
            cable push. Dry friction is not modelled: MuJoCo's would hold slack cables.
    """

    axial_stiffness: float = 0.0
    mass: float = 0.0
    exits: float = 0.0
    friction: float = 0.0

    def __post_init__(self) -> None:
        for field in fields(self):
            value = float(checked_array(field.name, getattr(self, field.name), ()))
            most = 1.0 if field.name in ("axial_stiffness", "mass") else np.inf
            if not 0 <= value < most:
                raise InvalidInput(f"{field.name}: found {value:g}, expected a deviation from 0, below {most:g}")

    def draw(self, robot: Robot, random: np.random.Generator) -> tuple[Robot, Float[np.ndarray, " cables"]]:
        """A robot of this domain, and the friction of its ropes, (cables,) [N s/m].

        The same numbers are drawn whichever ranges are zero, so that a range does not change the other parameters.
        """
        stiffness, mass = random.uniform(-1, 1, robot.cables), random.uniform(-1, 1)
        shift, friction = random.uniform(-1, 1, (robot.cables, 3)), random.uniform(0, 1, robot.cables)
        if robot.mobility == "planar":
            shift[:, 1] = 0
        changes = {}
        if self.axial_stiffness:
            changes["axial_stiffness"] = robot.axial_stiffness * (1 + self.axial_stiffness * stiffness)
        if self.mass:
            factor = 1 + self.mass * mass
            changes |= {"mass": robot.mass * factor, "inertia": robot.inertia * factor}
        if self.exits:
            changes |= {"exits": robot.exits + self.exits * shift, "workspace": robot.workspace, "frame": robot.frame}
        return (robot.replace(**changes) if changes else robot), self.friction * friction

"""Three questions to the search for layouts: how little is enough, a crane's masts, and which numbers matter most."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from cdpr_sim.core.robot import Robot
from cdpr_sim.crosscheck.layout_validation import LayoutValidation, validate_layout
from cdpr_sim.design.moves import Move, Space
from cdpr_sim.design.search import find_layout
from cdpr_sim.physics.settle import settle_many
from cdpr_sim.robots.catalogue import load_robot
from cdpr_sim.statics.newton import solve_many
from cdpr_sim.studies.real_cables import BELOW, CRANE_DENSITY, CRANE_RADIUS, crane

LINE = np.array([(x, 0.25, 0.1) for x in np.linspace(0.17, 0.63, 18)])
"""[m] The paper's lower line."""

FRAME_TOP = ((0.0, 0.0, 0.3), (0.8, 0.5, 0.5))
"""[m] Where DemoBot's exits may be: on its frame's posts and beams, or within."""

REACHES = (0.02, 0.04, 0.06, 0.08, 0.1, 0.12, 0.14, 0.16, 0.18, 0.2)
"""[m] How far an exit may move."""

MAST = 1.0
"""[m] How far the crane's exits may move up and down their masts."""

ERROR = 1e-3
"""[m] Of a number of the frame that was built wrong."""


def level_parallel(reaches: Sequence[float] = REACHES, generations: int = 100) -> list[LayoutValidation]:
    """The least worst tilt of ``parallel`` along the paper's line, with exits that move no further than these."""
    robot, move = load_robot("parallel"), Move("exits", FRAME_TOP)
    return [
        validate_layout(
            find_layout(robot, LINE, move=move, subject_to={"displacement": reach}, generations=generations)
        )
        for reach in reaches
    ]


def crane_masts(generations: int = 40) -> dict[str, LayoutValidation]:
    """The crane's deviation over its workspace, with exits that slide on their masts.

    With cables with mass, and with pulleys: weight and a pulley on one cable the package does not know.
    """
    poses = np.stack(np.meshgrid([-4.5, 0.0, 4.5], [-3.0, 3.0], [1.0, 3.0], indexing="ij"), axis=-1)
    move = Move("exits", MAST, along=(0, 0, 1))
    robots = {
        "4 mm steel rope that weighs": crane().replace(linear_density=CRANE_DENSITY),
        "massless rope over pulleys": crane().replace(pulley_radius=CRANE_RADIUS, pulley_axis=BELOW),
    }
    return {
        what: validate_layout(
            find_layout(robot, poses, move=move, symmetry="none", objective="worst deviation", generations=generations)
        )
        for what, robot in robots.items()
    }


@dataclass(frozen=True, eq=False)
class FrameNumber:
    """What it does when one number of a frame, the same in all places that symmetry ties, is built ``ERROR`` too large.

    Attributes:
        name: of the number.
        shifts: how much further off the platform is in MuJoCo, at each pose (poses,) [m].
        turns: by how much it turns (poses,) [rad].
        apart: largest distance between MuJoCo and statics over these poses [m].
    """

    name: str
    shifts: Float[np.ndarray, " poses"]
    turns: Float[np.ndarray, " poses"]
    apart: float

    def size(self, arm: float) -> float:
        """Root mean square move along the line, turns counted by ``arm``."""
        return float(np.sqrt((self.shifts**2 + (arm * self.turns) ** 2).mean()))


def frame_numbers(robot: Robot) -> list[FrameNumber]:
    """Each independent number of the exits of ``robot``, the one that matters most along the paper's line first.

    Nobody tells the winches: rest lengths are those of the frame as it was drawn. A millimetre is far more than cables
    stretch, and changes which of them are taut: first derivatives would not do.
    """
    space = Space.of(robot, [Move("exits", ERROR)])
    drawn = settle_many(robot, LINE)
    found = []
    for number, name in enumerate(space.names):
        wrong = robot.replace(exits=robot.exits + ERROR * space.exits[number])
        built = settle_many(wrong, LINE, drawn.rest_lengths)
        solved = solve_many(wrong, LINE, drawn.rest_lengths)
        found.append(
            FrameNumber(
                name,
                np.linalg.norm(built.positions - drawn.positions, axis=-1),
                (built.poses.rotation * drawn.poses.rotation.inv()).magnitude(),
                float(np.linalg.norm(built.positions - solved.positions, axis=-1).max()),
            )
        )
    return sorted(found, key=lambda one: -one.size(robot.characteristic_length))

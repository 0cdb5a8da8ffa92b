"""Studies of layout optimisation: smallest displacement of exits, masts of a crane, errors of frame dimensions."""

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
"""[m] Box of DemoBot's exits: its frame's posts and beams, and the space between."""

REACHES = (0.02, 0.04, 0.06, 0.08, 0.1, 0.12, 0.14, 0.16, 0.18, 0.2)
"""[m] Limits of an exit's displacement."""

MAST = 1.0
"""[m] Limit of the displacement of the crane's exits along their masts."""

ERROR = 1e-3
"""[m] Error of a dimension of the frame."""


def level_parallel(reaches: Sequence[float] = REACHES, generations: int = 100) -> list[LayoutValidation]:
    """Minimise the largest tilt of ``parallel`` along the paper's line, for each limit of the exits' displacement."""
    robot, move = load_robot("parallel"), Move("exits", FRAME_TOP)
    return [
        validate_layout(
            find_layout(robot, LINE, move=move, subject_to={"points moved": reach}, generations=generations)
        )
        for reach in reaches
    ]


def crane_masts(generations: int = 40) -> dict[str, LayoutValidation]:
    """Minimise the crane's largest deviation over its workspace, with exits that slide on their masts.

    With cables with mass, with pulleys, and with both.
    """
    poses = np.stack(np.meshgrid([-4.5, 0.0, 4.5], [-3.0, 3.0], [1.0, 3.0], indexing="ij"), axis=-1)
    move = Move("exits", MAST, along=(0, 0, 1))
    mass, pulleys = dict(linear_density=CRANE_DENSITY), dict(pulley_radius=CRANE_RADIUS, pulley_axis=BELOW)
    robots = {
        "4 mm steel rope with mass": crane().replace(**mass),
        "massless rope over pulleys": crane().replace(**pulleys),
        "rope with mass over pulleys": crane().replace(**mass, **pulleys),
    }
    return {
        name: validate_layout(
            find_layout(robot, poses, move=move, symmetry="none", objective="worst deviation", generations=generations)
        )
        for name, robot in robots.items()
    }


@dataclass(frozen=True, eq=False)
class FrameNumber:
    """Effect of an error ``ERROR`` of one dimension of a frame, including its symmetric counterparts.

    Attributes:
        name: of the dimension.
        shifts: displacement of the platform in MuJoCo, at each pose (poses,) [m].
        turns: rotation of the platform (poses,) [rad].
        method_difference: largest distance between MuJoCo and statics over these poses [m].
    """

    name: str
    shifts: Float[np.ndarray, " poses"]
    turns: Float[np.ndarray, " poses"]
    method_difference: float

    def size(self, arm: float) -> float:
        """Root mean square displacement along the line, with rotations weighted by ``arm``."""
        return float(np.sqrt((self.shifts**2 + (arm * self.turns) ** 2).mean()))


def frame_numbers(robot: Robot) -> list[FrameNumber]:
    """Effect of each independent dimension of the exits of ``robot`` along the paper's line, the largest first.

    The error is unknown to the winches: rest lengths are those of the nominal frame. A millimetre is far more than the
    elongation of cables and changes the set of taut cables, so that first derivatives are not sufficient.
    """
    space = Space.of(robot, [Move("exits", ERROR)])
    nominal = settle_many(robot, LINE)
    effects = []
    for number, name in enumerate(space.names):
        wrong = robot.replace(exits=robot.exits + ERROR * space.by["exits"][number])
        built = settle_many(wrong, LINE, nominal.rest_lengths)
        solved = solve_many(wrong, LINE, nominal.rest_lengths)
        effects.append(
            FrameNumber(
                name,
                np.linalg.norm(built.positions - nominal.positions, axis=-1),
                (built.poses.rotation * nominal.poses.rotation.inv()).magnitude(),
                float(np.linalg.norm(built.positions - solved.positions, axis=-1).max()),
            )
        )
    return sorted(effects, key=lambda one: -one.size(robot.characteristic_length))

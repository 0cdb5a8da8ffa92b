"""Compare both methods over the workspace of each robot of the catalogue.

Run: python scripts/research/check_zoo.py [ROBOT...]

The rest lengths are those of the commanded poses. Fully constrained robots are also compared with all cables shorter by
a thousandth.
"""

from __future__ import annotations

import sys
from collections import Counter
from dataclasses import dataclass

import numpy as np

import cdpr_sim as cdpr
from cdpr_sim.core.problem import Problems
from cdpr_sim.core.robot import Robot
from cdpr_sim.crosscheck.compare import Verdict, compare_many
from cdpr_sim.physics.settle import settle_many
from cdpr_sim.statics.newton import solve_many

POSES = 200  # random poses without rotation, per robot


PRETENSION_STRAIN = 1e-3
"""Reduction of each rest length, as a fraction, for fully constrained robots: a simple pretension with the same strain
in all cables, which moves the platform where the tensions do not balance."""


@dataclass(frozen=True, eq=False)
class RobotCheck:
    """Comparison of both methods for one robot at poses of its workspace.

    Attributes:
        robot: the robot.
        poses: number of poses.
        verdicts: counts over the poses where both methods found an equilibrium.
        unsolved: number of poses where the static solver found none, or MuJoCo did not settle.
        position_error: largest value where both agree [m].
        tension_error: largest value where both agree [N].
        tension: largest tension [N].
    """

    robot: Robot
    poses: int
    verdicts: Counter[Verdict]
    unsolved: int
    position_error: float
    tension_error: float
    tension: float

    @property
    def agreeing(self) -> int:
        """Number of poses at which the methods agree."""
        return self.verdicts[Verdict.AGREE] + self.verdicts[Verdict.AGREE_EXCEPT_NEUTRAL]


def check_robot(robot: Robot, poses: int = 200, strain: float = 0.0, seed: int = 0) -> RobotCheck:
    """Compare both methods at random level poses of the workspace, with rest lengths reduced by ``strain``."""
    positions = np.random.default_rng(seed).uniform(robot.workspace[0], robot.workspace[1], (poses, 3))
    problems = Problems.of(robot, positions)
    if strain:
        problems = Problems.of(robot, positions, (1 - strain) * problems.rest_lengths)
    solved, settled = solve_many(problems), settle_many(problems)
    many, found = compare_many(solved, settled), solved.converged & settled.converged
    agree = many.verdicts == Verdict.AGREE
    return RobotCheck(
        robot=robot,
        poses=poses,
        verdicts=Counter(many.verdicts[found]),
        unsolved=int((~found).sum()),
        position_error=float(many.errors["position_error"][agree].max(initial=0.0)),
        tension_error=float(many.errors["tension_error"][agree].max(initial=0.0)),
        tension=float(solved.tensions[found].max(initial=0.0)),
    )


HEAD = (
    "robot",
    "drawn in",
    "agree",
    "free",
    "different",
    "disagree",
    "unsolved",
    "diff. [mm]",
    "tension [N]",
    "diff. [N]",
)


def main(names: list[str]) -> None:
    print(f"{POSES} random poses without rotation per row\n")
    print(f"{HEAD[0]:>22}" + "".join(f"{word:>13}" for word in HEAD[1:]))
    for name in names or cdpr.list_robots():
        robot = cdpr.load_robot(name)
        for strain in (0.0, PRETENSION_STRAIN) if robot.kind == "fully constrained" else (0.0,):
            found = check_robot(robot, POSES, strain)
            counts = [found.verdicts[verdict] for verdict in Verdict]
            print(
                f"{name:>22}{strain:>13.1%}"
                + "".join(f"{count:>13}" for count in (*counts, found.unsolved))
                + f"{1e3 * found.position_error:>13.1e}{found.tension:>13.4g}{found.tension_error:>13.1e}",
                flush=True,
            )


if __name__ == "__main__":
    try:
        main(sys.argv[1:])
    except cdpr.CdprError as error:
        sys.exit(f"check_zoo: {error}")

"""Both methods over the workspaces of the zoo's robots, and with their cables drawn in."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass

import numpy as np

from cdpr_sim.core.problem import Problems
from cdpr_sim.core.robot import Robot
from cdpr_sim.crosscheck.check import compare_many
from cdpr_sim.crosscheck.compare import Verdict, compare
from cdpr_sim.physics.settle import settle_many
from cdpr_sim.statics.newton import solve_many

DRAWN_IN = 1e-3
"""Of each cable's length, to tension a robot that is held from all sides: a crude pretension, the same strain in all
cables, which moves the platform where they do not balance."""


@dataclass(frozen=True, eq=False)
class Visit:
    """What both methods say of one robot at poses of its workspace.

    Attributes:
        robot: which.
        poses: how many.
        verdicts: of each pose where both came to rest.
        unsolved: where the static solver found no rest, or MuJoCo did not settle.
        position_error: the largest where both agree [m].
        tension_error: likewise [N].
        tension: the largest there is [N].
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
        """At how many poses the methods agree."""
        return self.verdicts[Verdict.AGREE] + self.verdicts[Verdict.AGREE_BUT_FREE]


def visit(robot: Robot, poses: int = 200, drawn_in: float = 0.0, seed: int = 0) -> Visit:
    """Both methods from ``poses`` random level poses of the workspace, its cables shorter by ``drawn_in``."""
    positions = np.random.default_rng(seed).uniform(robot.workspace[0], robot.workspace[1], (poses, 3))
    problems = Problems.of(robot, positions)
    if drawn_in:
        problems = Problems.of(robot, positions, (1 - drawn_in) * problems.rest_lengths)
    solved, settled = solve_many(problems), settle_many(problems)
    errors, agree = compare_many(solved, settled)
    rested = solved.converged & settled.converged
    verdicts = Counter({Verdict.AGREE: int(agree.sum())})
    verdicts.update(compare(solved[row], settled[row]).verdict for row in np.flatnonzero(rested & ~agree).tolist())
    return Visit(
        robot=robot,
        poses=poses,
        verdicts=verdicts,
        unsolved=int((~rested).sum()),
        position_error=float(errors["position_error"][agree].max(initial=0.0)),
        tension_error=float(errors["tension_error"][agree].max(initial=0.0)),
        tension=float(solved.tensions[rested].max(initial=0.0)),
    )

"""SEECR, the paper's solver for the equilibrium of elastic cable robots, faithful to its Fig. 5.

ICRA 2024, "Towards Solving Cable-Driven Parallel Robot Inaccuracy due to Cable Elasticity". It looks for a root of the
static equilibrium W tau + w_e = 0 (Eq. 3) over the six-vector deviation of the pose (Eq. 7) with SciPy's ``fsolve`` or
``least_squares``, starting from a vertical fall. Both stall where cables go slack, because tensions have a kink
there, and ``least_squares`` then reports success; this implementation never returns a stalled pose as an equilibrium.
"""

from __future__ import annotations

from typing import Literal, get_args

import numpy as np
from jaxtyping import Float
from scipy import optimize

from cdpr_sim.core.equilibrium import Equilibrium, NotConverged
from cdpr_sim.core.errors import UnknownName
from cdpr_sim.core.pose import Pose, six_vector
from cdpr_sim.core.problem import Problem
from cdpr_sim.core.status import ACCEPTABLE, Status
from cdpr_sim.statics import forces

Solver = Literal["fsolve", "least_squares"]

RESIDUAL_TOLERANCE = ACCEPTABLE
"""Largest unbalanced force of an equilibrium, as a fraction of the load; the same limit holds for MuJoCo."""


def solve(problem: Problem, solver: Solver = "fsolve") -> Equilibrium:
    """The pose at which SEECR ends, if it is an equilibrium; it may be an unstable one.

    Raises:
        NotConverged: forces do not balance where SciPy stopped, or a cable is strained beyond the range of its law;
            carries that point.
        UnknownName: no such solver.
    """
    free = problem.robot.free
    start = six_vector(problem.pose)

    def pose_at(deviation: Float[np.ndarray, " free"]) -> Pose:
        vector = start.copy()
        vector[free] += deviation  # Eq. 7
        return Pose.of(vector)

    def unbalanced(deviation: Float[np.ndarray, " free"]) -> Float[np.ndarray, " free"]:
        pose = pose_at(deviation)  # Eq. 8 to 11, then Eq. 3
        return forces.at(problem, pose.position, pose.rotation_matrix).net_wrench[free]

    guess = initial_deviation(problem)[free]
    if solver == "fsolve":
        deviation, info, _, message = optimize.fsolve(unbalanced, guess, full_output=True)
        evaluations = info["nfev"]
    elif solver == "least_squares":
        outcome = optimize.least_squares(unbalanced, guess)
        deviation, evaluations, message = outcome.x, outcome.nfev, outcome.message
    else:
        raise UnknownName("SEECR solver", str(solver), get_args(Solver))
    source = f"seecr/{solver}"
    result = forces.equilibrium_at(problem, pose_at(deviation), iterations=int(evaluations or 0), source=source)
    if not result.residual <= RESIDUAL_TOLERANCE * problem.force_scale:
        said = " ".join(str(message).split()).rstrip(".")
        raise NotConverged(f"seecr/{solver}: stopped with {result.residual:.1e} N unbalanced (SciPy: {said})", result)
    if problem.robot.cabling.beyond_law(result.lengths, result.rest_lengths).any():
        raise NotConverged.because(Status.OVERSTRAINED, result)
    return result


def initial_deviation(problem: Problem) -> Float[np.ndarray, "6"]:
    """The first guess: a vertical fall by m g l_vmean / EA (step 4 of the algorithm).

    l_vmean is the mean vertical component of the cables; the paper prints its formula without the 1/m.
    """
    robot = problem.robot
    cables = forces.geometry(robot, problem.pose.translation, problem.pose.rotation.as_matrix())
    vertical = cables.directions[:, 2] * cables.free_lengths
    fall = robot.weight * vertical.mean() / robot.axial_stiffness.mean()
    return np.array([0.0, 0.0, -fall, 0.0, 0.0, 0.0])

"""``solve``: one static equilibrium, by the solver that is named."""

from __future__ import annotations

from typing import Literal, get_args

from numpy.typing import ArrayLike

from cdpr_sim.core.checks import one_of
from cdpr_sim.core.equilibrium import Equilibrium
from cdpr_sim.core.pose import PoseLike
from cdpr_sim.core.problem import Problem
from cdpr_sim.core.robot import Robot
from cdpr_sim.statics import newton, seecr

Method = Literal["newton", "fsolve", "least_squares"]


def solve(
    robot: Robot | Problem,
    pose: PoseLike | None = None,
    rest_lengths: ArrayLike | None = None,
    *,
    external_wrench: ArrayLike | None = None,
    method: Method = "newton",
) -> Equilibrium:
    """Static equilibrium of the platform, by statics.

    Args:
        robot: the robot; or a ``Problem``, without other arguments.
        pose: the commanded pose, from which the solver starts: (x, y, z), a six-vector or a ``RigidTransform``.
        rest_lengths: l0, (cables,) [m]; default: the rigid lengths at ``pose`` (paper Eq. 1, 2).
        external_wrench: constant force [N] and torque [N m] on the platform's origin, base frame, (6,).
        method: "newton" (the package's own: ends at a stable equilibrium), "fsolve" or "least_squares" (the paper's
            SEECR).

    Returns:
        The equilibrium, with the residual [N] and the stiffness [N/m] that certify it.

    Raises:
        InvalidInput: an invalid argument.
        UnknownName: no such method.
        NotConverged: the solver stopped away from equilibrium, or where a nonlinear cable is strained by more than
            20 %; carries the best point.
    """
    one_of("method", method, get_args(Method))
    problem = Problem.of(robot, pose, rest_lengths, external_wrench)
    if method == "newton":
        return newton.solve(problem)
    return seecr.solve(problem, method)

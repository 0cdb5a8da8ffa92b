"""Our static solver: descent on the energy to a pose where the platform can rest. The method is in ``descent``."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy.typing import ArrayLike
from scipy.spatial.transform import RigidTransform, Rotation

from cdpr_sim.statics import forces as statics
from cdpr_sim.statics.newton_kernel import Status, equilibrium_gufunc
from cdpr_sim.core.equilibrium import Equilibrium
from cdpr_sim.core.errors import InvalidInput, NotConverged
from cdpr_sim.core.problem import Problem
from cdpr_sim.core.robot import Robot
from cdpr_sim.core.trajectory import Trajectory


@dataclass(frozen=True, eq=False)
class Solutions:
    """Many static equilibria, as arrays over the leading dimensions of the call.

    Attributes:
        positions: (..., 3) [m].
        rotations: (..., 3, 3) rotation matrices.
        lengths: (..., cables) [m].
        tensions: (..., cables) [N].
        residuals: (...) largest unbalanced force [N], torques divided by the characteristic length.
        iterations: (...) Newton iterations.
        status: (...) a ``Status`` each; where it is not ``CONVERGED`` the numbers are the best point seen.
    """

    positions: Float[np.ndarray, "*batch 3"]
    rotations: Float[np.ndarray, "*batch 3 3"]
    lengths: Float[np.ndarray, "*batch cables"]
    tensions: Float[np.ndarray, "*batch cables"]
    residuals: Float[np.ndarray, "*batch"]
    iterations: Int[np.ndarray, "*batch"]
    status: Int[np.ndarray, "*batch"]

    @property
    def converged(self) -> Bool[np.ndarray, "*batch"]:
        """(...) whether each one is an equilibrium."""
        return self.status == Status.CONVERGED

    @property
    def poses(self) -> RigidTransform:
        """(...) the poses; nan where a row is no equilibrium."""
        positions = np.where(self.converged[..., None], self.positions, np.nan)
        return RigidTransform.from_components(positions, Rotation.from_matrix(self.rotations))


def solve(problem: Problem) -> Equilibrium:
    """The stable equilibrium that descent from the commanded pose leads to.

    Raises:
        NotConverged: forces do not balance at the best point found, which the exception carries.
    """
    robot = problem.robot
    position, rotation, _, residual, iterations, status = _solve(
        robot.exits,
        robot.anchors,
        robot.axial_stiffness,
        problem.rest_lengths,
        robot.weight,
        robot.center_of_mass,
        problem.external_wrench,
        _free(robot),
        robot.characteristic_length,
        problem.pose.translation,
        problem.pose.rotation.as_matrix(),
    )
    pose = RigidTransform.from_components(position, Rotation.from_matrix(rotation))
    result = statics.equilibrium_at(problem, pose, iterations=int(iterations), source="newton")
    if status != Status.CONVERGED:
        reason = f"newton: {Status(int(status)).sentence} (residual {residual:.1e} N)"
        if problem.external_wrench[3:].any():
            reason += "; under a torque that keeps its direction in space there may be none"
        raise NotConverged(reason, result)
    return result


def solve_many(
    robot: Robot,
    positions: ArrayLike,
    *,
    rotations: ArrayLike | None = None,
    rest_lengths: ArrayLike | None = None,
    axial_stiffness: ArrayLike | None = None,
    mass: ArrayLike | None = None,
    external_wrench: ArrayLike | None = None,
) -> Solutions:
    """Equilibria from many commanded poses in one compiled call, everything broadcast against everything.

    Args:
        robot: the robot; its geometry, and the default of what follows.
        positions: commanded positions, (..., 3) [m].
        rotations: commanded rotation matrices, (..., 3, 3); default: level.
        rest_lengths: (..., cables) [m]; default: the rigid lengths at each commanded pose (paper Eq. 1, 2).
        axial_stiffness: EA, (...) or (..., cables) [N].
        mass: (...) [kg].
        external_wrench: (..., 6) [N, N m].

    Raises:
        InvalidInput: shapes that do not fit.
    """
    positions = np.asarray(positions, dtype=float)
    if positions.shape[-1:] != (3,):
        raise InvalidInput(f"positions: found an array of shape {positions.shape}, expected (..., 3)")
    rotations = np.eye(3) if rotations is None else np.asarray(rotations, dtype=float)
    if rest_lengths is None:
        rest_lengths = statics.lengths(robot, positions, rotations)
    stiffness = np.asarray(robot.axial_stiffness if axial_stiffness is None else axial_stiffness, dtype=float)
    if stiffness.ndim == 0 or stiffness.shape[-1] != robot.cables:
        stiffness = np.repeat(stiffness[..., None], robot.cables, axis=-1)
    solved_positions, solved_rotations, lengths, residuals, iterations, status = _solve(
        robot.exits,
        robot.anchors,
        stiffness,
        rest_lengths,
        np.asarray(robot.mass if mass is None else mass) * robot.gravity,
        robot.center_of_mass,
        np.zeros(6) if external_wrench is None else external_wrench,
        _free(robot),
        robot.characteristic_length,
        positions,
        rotations,
    )
    tensions = statics.tensions(lengths, rest_lengths, stiffness)
    return Solutions(solved_positions, solved_rotations, lengths, tensions, residuals, iterations, status)


def solve_trajectory(trajectory: Trajectory) -> Solutions:
    """The static equilibrium for each state's command, as if the winches had stopped there: (steps,) of them."""
    return solve_many(
        trajectory.robot,
        trajectory.commanded.translation,
        rotations=trajectory.commanded.rotation.as_matrix(),
        rest_lengths=trajectory.rest_lengths,
    )


def _solve(*arguments: ArrayLike) -> list[np.ndarray]:
    """The compiled solver; that its input is not finite is said by a status, not by a warning of NumPy's."""
    with np.errstate(all="ignore"):
        return [np.asarray(result) for result in equilibrium_gufunc()(*arguments)]


def _free(robot: Robot) -> Float[np.ndarray, "6"]:
    """1 for the free directions, 0 for the others."""
    free = np.zeros(6)
    free[list(robot.free_directions)] = 1.0
    return free

"""Newton's method for static equilibria: descent on the energy to a stable one. The method is in ``newton_kernel``."""

from __future__ import annotations

import dataclasses
from functools import partial
from typing import TypeAlias

import numpy as np
from jaxtyping import Float
from numpy.typing import ArrayLike
from scipy.spatial.transform import RigidTransform

from cdpr_sim.core import cable_law, compiling
from cdpr_sim.core.cable import COLUMNS
from cdpr_sim.core.checks import refuse_unless
from cdpr_sim.core.equilibrium import Equilibrium, NotConverged
from cdpr_sim.core.equilibrium_batch import EquilibriumBatch
from cdpr_sim.core.memory import Memory
from cdpr_sim.core.on_threads import checked_threads, on_threads
from cdpr_sim.core.pose import Pose, PoseLike, poses_of
from cdpr_sim.core.problem import Problem, Problems
from cdpr_sim.core.robot import Robot
from cdpr_sim.core.status import ACCEPTABLE, Status
from cdpr_sim.core.trajectory import Trajectory
from cdpr_sim.statics import forces
from cdpr_sim.statics.any_cable import any_cables
from cdpr_sim.statics.gufuncs import EQUILIBRIA, STIFFNESSES
from cdpr_sim.statics.memory_law import MemoryLaw

Start: TypeAlias = tuple[Float[np.ndarray, "*#batch 3"], Float[np.ndarray, "*#batch 3 3"]]

FELT = 1e-2 * ACCEPTABLE
"""Unbalanced force at convergence, as a fraction of the load, above which rounding matters: then the residual is
evaluated at the pose as stored, with its rotation normalised once more, for one problem and in a batch."""


def solve(problem: Problem) -> Equilibrium:
    """The stable equilibrium that descent from the commanded pose reaches.

    Raises:
        NotConverged: forces do not balance at the best point found; the exception carries that point.
    """
    robot = problem.robot
    if robot.cabling.has_memory.any():
        return solve_step(Problems.stack([problem]), Memory.fresh(robot, (1,)))[0][0]
    position, rotation, lengths, tensions, residual, iterations, ended = solve_table(
        problem, robot.cable_table(), problem.position, problem.rotation_matrix
    )
    pose, status = Pose(position, rotation), Status(int(ended))
    result = Equilibrium(
        problem=problem,
        pose=pose,
        tensions=tensions,
        lengths=lengths,
        residual=float(residual),
        eigenvalues=partial(forces.eigenvalues_at, problem, pose),
        iterations=int(iterations),
        source="newton",
    )
    if status is Status.CONVERGED and not residual <= FELT * problem.force_scale:
        result = forces.equilibrium_at(problem, pose.transform, iterations=int(iterations), source="newton")
        if not result.residual <= ACCEPTABLE * problem.force_scale:
            status = Status.STALLED
    if status is not Status.CONVERGED:
        raise NotConverged.because(status, result)
    return result


def equilibrium_of(
    found: Equilibrium | Problem | Robot,
    pose: PoseLike | None = None,
    rest_lengths: ArrayLike | None = None,
    external_wrench: ArrayLike | None = None,
) -> Equilibrium:
    """The given equilibrium, or the one that ``solve`` finds for a problem or for a robot with its pose and loads.

    Raises:
        InvalidInput: an invalid argument.
        NotConverged: the solver found none.
    """
    refuse_unless(Equilibrium | Problem | Robot, equilibrium=found)
    if not isinstance(found, Equilibrium):
        return solve(Problem.of(found, pose, rest_lengths, external_wrench))
    Problem.of(found.problem, pose, rest_lengths, external_wrench)  # refuses arguments given beside an equilibrium
    return found


def solve_many(
    robot: Robot | Problems,
    poses: RigidTransform | ArrayLike | None = None,
    rest_lengths: ArrayLike | None = None,
    *,
    external_wrench: ArrayLike | None = None,
    rotations: ArrayLike | None = None,
    axial_stiffness: ArrayLike | None = None,
    mass: ArrayLike | None = None,
    threads: int = 0,
) -> EquilibriumBatch:
    """Equilibria from many commanded poses in one compiled call; all arguments broadcast.

    Args:
        robot: the robot; its geometry, and the default of the other arguments. Or ``Problems``, without other
            arguments.
        poses: commanded poses, (..., 3) [m], (..., 6) [m, rad], a stack of transforms, or a list of poses of any kind.
        rest_lengths: (..., cables) [m]; default: ``robot.rest_lengths`` at each commanded pose.
        external_wrench: (..., 6) [N, N m].
        rotations: commanded rotation matrices, (..., 3, 3), where ``poses`` are positions; default: level.
        axial_stiffness: EA [N], a number, or with the cables last: (..., cables), or (..., 1) for all cables alike.
        mass: (...) [kg].
        threads: among which rows along the first axis are divided, for 2,000 problems and more; 0 for one per
            processor, 1 for none. They do not change the results.

    Returns:
        A row for each pose. The status marks a row that is not finite, or at which the platform would fall.

    Raises:
        InvalidInput: shapes that do not fit or are ambiguous, invalid numbers.
    """
    problems = Problems.of(
        robot, poses, rest_lengths, external_wrench, rotations=rotations, axial_stiffness=axial_stiffness, mass=mass
    )
    robot, threads = problems.robot, checked_threads(threads)
    if robot.cabling.has_memory.any():
        return solve_step(problems, Memory.fresh(robot, problems.shape))[0]
    return _solved(problems, problems.cable_table(), (problems.positions, problems.rotations), threads)


def solve_step(
    problems: Problems, memory: Memory, duration: float = 0.0, start: Start | None = None
) -> tuple[EquilibriumBatch, Memory]:
    """Equilibria, each the next of a path; and the memory there.

    Args:
        problems: (...).
        memory: that of the last equilibria, (...).
        duration: time since then [s].
        start: positions and rotation matrices from which the descent begins; by default the commanded poses.
    """
    robot, law = problems.robot, None
    rest = np.broadcast_to(problems.rest_lengths, (*problems.shape, robot.cables))
    if robot.cabling.has_memory.any():
        law = MemoryLaw(robot, problems.axial_stiffness, rest, memory, duration)
    table = problems.cable_table() if law is None else law.table()
    positions, rotations = start or (problems.positions, problems.rotations)
    possible = (problems.refusals == Status.PENDING)[..., None]
    found = _solved(problems, table, (np.where(possible, positions, np.nan), rotations))
    ended = np.where(found.converged[..., None], found.tensions, np.nan)
    moment = duration + (0.0 if np.isnan(memory.time) else memory.time)
    if law is None:
        return found, dataclasses.replace(memory, beyond=rest.copy(), tensions=ended, time=moment)
    with_mass = robot.cabling.has_memory & (robot.cable_weights > 0)
    if with_mass.any():
        ends = found.positions[..., None, :] + robot.anchors @ np.swapaxes(found.rotations, -1, -2)
        pulled = robot.cabling.tensions(any_cables(table, ends - robot.exits, rest).exit_tension)
        ended = np.where(with_mass & ~np.isnan(ended), pulled, ended)
    return found, law.after(found.lengths, ended, moment)


def _solved(
    problems: Problems, table: Float[np.ndarray, "*#batch cables columns"], start: Start, threads: int = 1
) -> EquilibriumBatch:
    """Equilibria with the cables of a table: that of the problems, or of ``MemoryLaw``."""
    elastic, (positions, rotations) = table.shape[-1] == COLUMNS, start
    if problems.falls.any():
        positions = np.where(problems.falls[..., None], np.nan, positions)
    found = solve_table(problems, table, positions, rotations, threads)
    positions, turned, lengths, tensions, residuals, iterations, status = found
    felt = (status == Status.CONVERGED) & ~(residuals <= FELT * problems.force_scale)
    if felt.any():
        if problems.robots is None and elastic:
            asked, read = problems.take(felt), poses_of(positions[felt], turned[felt])
            state = forces.at(asked, read.translation, read.rotation.as_matrix())
            positions[felt], turned[felt] = state.position, state.rotation
            lengths[felt], tensions[felt], residuals[felt] = state.lengths, state.tensions, state.residual
        balanced = residuals <= ACCEPTABLE * problems.force_scale
        status = np.where(felt & ~balanced, Status.STALLED.value, status)
    if (status != Status.CONVERGED).any():
        status = np.where(problems.refusals == Status.PENDING, status, problems.refusals)
    columns = positions, turned, lengths, tensions, np.asarray(residuals), iterations, status
    stiffness = _eigenvalues if elastic else partial(_eigenvalues, table=table)
    return EquilibriumBatch(problems, *columns, source="newton", stiffness=stiffness)


def _eigenvalues(
    equilibria: EquilibriumBatch, table: Float[np.ndarray, "*batch cables columns"] | None = None
) -> Float[np.ndarray, "*batch free"]:
    """Eigenvalues on demand; a named function, so that a batch can be pickled."""
    return stiffness_of(equilibria, table)[0]


def stiffness_of(
    equilibria: EquilibriumBatch, table: Float[np.ndarray, "*batch cables columns"] | None = None
) -> tuple[Float[np.ndarray, "*batch free"], Float[np.ndarray, "*batch"]]:
    """Eigenvalues of the stiffness matrix, ascending [N/m], and the lowest natural frequency [Hz], row by row.

    Cables count as springs: their own inertia and oscillation are neglected, also where their mass makes them sag.

    Args:
        equilibria: (...).
        table: that of ``MemoryLaw``; by default the table of elastic cables.
    """
    problems, robot = equilibria.problems, equilibria.robot
    table = problems.cable_table() if table is None else table
    with np.errstate(all="ignore"):
        return STIFFNESSES(
            table, problems.rest_lengths, problems.mass, robot.gravity, problems.center_of_mass, robot.inertia,
            np.array(robot.free), problems.characteristic_length, int(not robot.cabling.springs),
            equilibria.positions, equilibria.rotations,
        )  # fmt: skip


def solve_trajectory(trajectory: Trajectory) -> EquilibriumBatch:
    """Static equilibria for the commands of a trajectory's states, as if the winches had stopped there: (steps,).

    Args:
        trajectory: from ``drive``, ``track`` or ``settle_trajectory``.

    Returns:
        (steps,) equilibria, to be drawn with the motion by ``write_video(path, trajectory, equilibria.poses)``.

    Raises:
        InvalidInput: not a trajectory.
    """
    refuse_unless(Trajectory, trajectory=trajectory)
    return solve_many(trajectory.problems)


def solve_table(
    problem: Problem | Problems,
    table: Float[np.ndarray, "*#batch cables columns"],
    positions: Float[np.ndarray, "*#batch 3"],
    rotations: Float[np.ndarray, "*#batch 3 3"],
    threads: int = 1,
) -> tuple[np.ndarray, ...]:
    """Positions, rotations, lengths, tensions, residuals, iterations and status by the compiled solvers.

    Input that is not finite is reported by a status, not by a NumPy warning, and so is a cable that is strained beyond
    the range of its law where forces balance. Where cables have mass, the search starts at the equilibrium with
    massless cables. ``table`` is that of the problem, or of ``MemoryLaw``.
    """
    robot, cabling, free = problem.robot, problem.robot.cabling, np.zeros(6)
    free[robot.free] = 1.0
    given = (
        table, problem.rest_lengths, problem.mass * robot.gravity, problem.center_of_mass, problem.external_wrench,
        free, problem.characteristic_length, int(not cabling.springs), positions, rotations,
    )  # fmt: skip

    def solved(*given: np.ndarray | float) -> tuple[np.ndarray, ...]:
        with np.errstate(all="ignore"):
            return tuple(map(np.asarray, EQUILIBRIA(*given)))

    at, turned, lengths, pulls, residuals, iterations, status = on_threads(
        solved, given, EQUILIBRIA.axes, threads, compiling.PIECE
    )
    with np.errstate(all="ignore"):
        tensions = cabling.tensions(pulls)
        if not cabling.linear:
            largest = cable_law.largest_tension(cable_law.of_table(table))
            beyond = (status == Status.CONVERGED) & (pulls > largest).any(-1)
            status = np.where(beyond, Status.OVERSTRAINED.value, status)
    return at, turned, lengths, tensions, residuals, iterations, status

"""``solve_path``: equilibria one after another, of ropes with a memory."""

from __future__ import annotations

import dataclasses
from functools import partial

import numpy as np
from jaxtyping import Float
from numpy.typing import ArrayLike
from scipy.spatial.transform import RigidTransform

from cdpr_sim.core.equilibrium_batch import EquilibriumBatch, EquilibriumPath
from cdpr_sim.core.memory import Memory
from cdpr_sim.core.path_problem import PathProblem, moved_as_commanded
from cdpr_sim.core.problem import Problems
from cdpr_sim.core.robot import Robot
from cdpr_sim.core.status import Status
from cdpr_sim.statics import newton

STACKED = ("positions", "rotations", "lengths", "tensions", "residuals", "iterations", "status")


def solve_path(
    robot: Robot | Problems,
    poses: RigidTransform | ArrayLike | None = None,
    rest_lengths: ArrayLike | None = None,
    *,
    external_wrench: ArrayLike | None = None,
    rotations: ArrayLike | None = None,
    times: ArrayLike | None = None,
    memory: Memory | None = None,
    steps: int = 1,
) -> EquilibriumPath:
    """Static equilibria along a path, by statics: each depends on those before by friction, hysteresis and creep.

    Each step is one minimum of energy, with the memory of the step before, from the equilibrium there. Where all
    stretches increase or decrease from one command to the next, more steps change nothing.

    Args:
        robot: the robot; or ``Problems`` of shape (steps, ...), without other arguments about them.
        poses: commanded poses one after another, (steps, 3) [m], (steps, 6) [m, rad], a stack of transforms or a list
            of poses; further dimensions, (steps, ..., 3), are paths side by side.
        rest_lengths: (steps, ..., cables) [m]; default: the rigid lengths at each commanded pose (paper Eq. 1, 2).
        external_wrench: (6,) or (steps, ..., 6) [N, N m].
        rotations: commanded rotation matrices (steps, ..., 3, 3), where ``poses`` are positions; default: level.
        times: time of each command, (steps,) [s], for creep; between two commands the tensions change linearly in time,
            and commands with the same time are a jump. Default: no time passes.
        memory: the memory at the beginning, of an ``EquilibriumPath`` before; default: that of new ropes.
        steps: number of steps from each command to the next, along the commanded poses.

    Returns:
        (steps, ...) equilibria with their status, and ``memory`` at the end, with which another path can start. A step
        without an equilibrium ends its path: all later steps have its status.

    Raises:
        InvalidInput: an invalid argument, a single pose, times that decrease, a memory of another robot.
    """
    commands = Problems.of(robot, poses, rest_lengths, external_wrench, rotations=rotations)
    path = PathProblem.of(commands, times=times, memory=memory, steps=steps)
    return follow(path)


def follow(path: PathProblem) -> EquilibriumPath:
    """The equilibria of a path, one after another; many paths side by side in one compiled call for each step."""
    memory, found, here = path.memory[None], [], None
    kept = set(path.kept.tolist())
    for index, duration in enumerate(path.durations.tolist()):
        problems = path.fine.take(np.array([index]))
        start = None if here is None else _moved(here, problems)
        status = None if here is None else here.status
        here, memory = newton.solve_step(problems, memory, duration, start)
        if status is not None:
            here = dataclasses.replace(here, status=np.where(status == Status.CONVERGED, here.status, status))
        if index in kept:
            found.append(here)
    return EquilibriumPath(
        problems=path.problems,
        **{name: np.concatenate([getattr(one, name) for one in found]) for name in STACKED},
        source="newton",
        stiffness=partial(_eigenvalues, tuple(found)),
        times=path.times,
        memory=dataclasses.replace(memory[0], time=float(path.times[-1])),
    )


def _moved(here: EquilibriumBatch, problems: Problems) -> newton.Start:
    """The last equilibria, moved as their commands move; nan where a path has ended."""
    positions, turned = moved_as_commanded(here.positions, here.rotations, here.problems, problems)
    return np.where(here.converged[..., None], positions, np.nan), turned


def _eigenvalues(found: tuple[EquilibriumBatch, ...], path: EquilibriumBatch) -> Float[np.ndarray, "*batch free"]:
    """Eigenvalues on demand, step by step; a named function, so that a path can be pickled."""
    return np.concatenate([one.eigenvalues for one in found])

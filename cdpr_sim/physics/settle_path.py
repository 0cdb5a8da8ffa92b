"""Settling along a path: from one equilibrium in MuJoCo to the next, with the memory of the cables."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import RigidTransform

from cdpr_sim.core.checks import MOST_THREADS, whole
from cdpr_sim.core.equilibrium_batch import EquilibriumPath
from cdpr_sim.core.memory import Memory
from cdpr_sim.core.path_problem import PathProblem, moved_as_commanded
from cdpr_sim.core.problem import Problems
from cdpr_sim.core.robot import Robot
from cdpr_sim.core.status import Status
from cdpr_sim.physics.settle import come_to_rest, refused, released, settled_without_mass, unread, weighs


def settle_path(
    robot: Robot | Problems,
    poses: RigidTransform | ArrayLike | None = None,
    rest_lengths: ArrayLike | None = None,
    *,
    external_wrench: ArrayLike | None = None,
    rotations: ArrayLike | None = None,
    times: ArrayLike | None = None,
    memory: Memory | None = None,
    steps: int = 1,
    threads: int = 0,
) -> EquilibriumPath:
    """Equilibria along a path in MuJoCo, each with the memory of the cables from the path so far.

    From each equilibrium the winches turn to the next command, and the platform comes to rest. The cables go straight
    from one equilibrium to the next: their memory does not depend on the motion between them. A robot without a memory
    is settled from one equilibrium to the next.

    Args:
        robot: the robot; or ``Problems`` of shape (steps, ...), without the next four arguments.
        poses: commanded poses in order, (steps, ..., 3) [m] or (steps, ..., 6) [m, rad], or a stack of transforms;
            further dimensions are paths side by side.
        rest_lengths: (..., cables) [m]; default: the rigid ones at each pose.
        external_wrench: (..., 6) [N, N m].
        rotations: (steps, ..., 3, 3), if ``poses`` are positions; default: level.
        times: time of each command, (steps,) [s], on which creep depends; equal times are a jump. Default: all at once.
        memory: with which the path begins; default: that of new ropes.
        steps: equilibria from each command to the next, along the commanded poses: with few, the slip of elements forth
            and back between two commands is missed.
        threads: 0 for one per processor.

    Returns:
        Equilibria at the commands, (steps, ...), and the memory at the end. Where the platform does not come to rest,
        the path ends: that row and all further ones have the reason as their status.

    Raises:
        InvalidInput: commands, times or a memory that do not fit.
    """
    commands = Problems.of(robot, poses, rest_lengths, external_wrench, rotations=rotations)
    path = PathProblem.of(commands, times=times, memory=memory, steps=steps)
    whole("threads", threads, 0, MOST_THREADS)
    robot, shape, kept = path.robot, path.problems.shape[1:], set(path.kept.tolist())
    count = int(np.prod(shape))
    parts = {name: part.reshape(count, *part.shape[len(shape) :]).copy() for name, part in path.memory.arrays.items()}
    here, before, found = {"status": np.full(count, Status.CONVERGED.value)}, None, []
    for row, duration in enumerate(path.durations.tolist()):
        which = np.zeros(path.fine.shape, dtype=bool)
        which[row] = True
        commands, last = path.fine.take(which), here
        here = unread(robot, np.where(last["status"] == Status.CONVERGED, refused(commands), last["status"]))
        going = np.flatnonzero(here["status"] == Status.PENDING)
        if len(going):
            starts = commands.take(going)
            if before is not None:  # from the equilibria before, moved as the commands are
                there = last["positions"][going], last["rotations"][going]
                starts = released(starts, *moved_as_commanded(*there, before.take(going), starts))
            elif weighs(robot):
                starts = settled_without_mass(starts, threads)
            remembered = Memory(**{name: part[going] for name, part in parts.items()}, time=np.nan)
            read, after = come_to_rest(starts, memory=(remembered, duration), threads=threads)
            if after is None:
                rest = np.broadcast_to(starts.rest_lengths, read["tensions"].shape)
                after = replace(remembered, beyond=rest, tensions=read["tensions"])
            for arrays, values in ((here, read), (parts, after.arrays)):
                for name, part in values.items():
                    arrays[name][going] = part
        before = commands
        if row in kept:
            found.append(here)
    for part in parts.values():
        part[here["status"] != Status.CONVERGED] = np.nan
    shaped = {name: part.reshape(*shape, *part.shape[1:]) for name, part in parts.items()}
    columns = {name: np.stack([one[name] for one in found]) for name in found[0]}
    return EquilibriumPath(
        problems=path.problems,
        **{name: column.reshape(len(found), *shape, *column.shape[2:]) for name, column in columns.items()},
        source="mujoco",
        times=path.times,
        memory=Memory(**shaped, time=float(path.times[-1])),
    )

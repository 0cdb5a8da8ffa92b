"""Settling along a path: from one equilibrium in MuJoCo to the next, with the memory of the cables."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from typing import TypeAlias

import numpy as np
from jaxtyping import Bool, Int
from numpy.typing import ArrayLike
from scipy.spatial.transform import RigidTransform

from cdpr_sim.core.checks import MOST_THREADS, whole
from cdpr_sim.core.equilibrium_path import EquilibriumPath
from cdpr_sim.core.memory import Memory
from cdpr_sim.core.path_problem import PathProblem, moved
from cdpr_sim.core.problem import Problems
from cdpr_sim.core.robot import Robot
from cdpr_sim.core.status import Status
from cdpr_sim.physics.batch import Simulations, simulations_of
from cdpr_sim.physics.sagging.settle_chains import released
from cdpr_sim.physics.settle import come_to_rest, refused, settled_without_mass, weighs

READ = ("positions", "rotations", "lengths", "tensions", "residuals", "eigenvalues")

RowSettling: TypeAlias = Callable[[Problems, Memory, float, bool], tuple[dict[str, np.ndarray], Memory]]
"""Settles one row of a path from these poses, with the memory before and the time since then [s]; whether the row is
the first of its path. Returns what was read, and the memory there."""


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
    """Equilibria along a path in MuJoCo, each with the memory that the cables have from the way there.

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
        steps: equilibria from each command to the next, along the commanded poses: elements that slide forth and back
            between two commands are missed with few.
        threads: 0 for one per processor.

    Returns:
        Equilibria at the commands, (steps, ...), and the memory at the end. Where the platform does not come to rest,
        the path ends: that row and all further ones have the reason as their status.

    Raises:
        InvalidInput: commands, times or a memory that do not fit.
    """
    path = PathProblem.of(
        robot, poses, rest_lengths, external_wrench, rotations=rotations, times=times, memory=memory, steps=steps
    )
    whole("threads", threads, 0, MOST_THREADS)
    return _SettledPath(path, threads).result()


class _SettledPath:
    """Equilibria at all rows of a path, of which those of the commands are kept."""

    def __init__(self, path: PathProblem, threads: int) -> None:
        self.path, self.threads, robot = path, threads, path.robot
        rows, self.shape = len(path.fine), path.problems.shape[1:]
        count = int(np.prod(self.shape))

        def empty(*core: int) -> np.ndarray:
            return np.full((rows, count, *core), np.nan)

        self.positions, self.rotations = empty(3), empty(3, 3)
        self.lengths, self.tensions = empty(robot.cables), empty(robot.cables)
        self.residuals, self.eigenvalues = empty(), empty(len(robot.free))
        self.iterations = np.zeros((rows, count), dtype=int)
        self.status = np.full((rows, count), Status.PENDING.value)
        self.memory = {
            name: getattr(path.memory, name).reshape(count, *core).copy() for name, core in _parts(robot).items()
        }

    def result(self) -> EquilibriumPath:
        """The equilibria at the commands."""
        row, alive = 0, np.ones(self.status.shape[1], dtype=bool)
        while row < len(self.status) and alive.any():
            row, alive = self._go_on(row, alive)
        for part in self.memory.values():
            part[~alive] = np.nan
        memory = {name: self.memory[name].reshape(*self.shape, *core) for name, core in _parts(self.path.robot).items()}
        kept = self.path.kept

        def shaped(array: np.ndarray) -> np.ndarray:
            return array[kept].reshape(len(kept), *self.shape, *array.shape[2:])

        return EquilibriumPath(
            problems=self.path.problems,
            positions=shaped(self.positions),
            rotations=shaped(self.rotations),
            lengths=shaped(self.lengths),
            tensions=shaped(self.tensions),
            residuals=shaped(self.residuals),
            iterations=shaped(self.iterations),
            status=shaped(self.status),
            source="mujoco",
            stiffness=shaped(self.eigenvalues),
            times=self.path.times,
            memory=Memory(**memory, time=float(self.path.times[-1])),
        )

    def _commands(self, row: int) -> Problems:
        """The problems of one row of the path, (paths,)."""
        which = np.zeros(self.path.fine.shape, dtype=bool)
        which[row] = True
        return self.path.fine.take(which)

    def _go_on(self, row: int, alive: Bool[np.ndarray, " paths"]) -> tuple[int, Bool[np.ndarray, " paths"]]:
        """Go on from ``row`` until a path ends: the row to go on with, and which paths go on."""
        paths = np.flatnonzero(alive)
        before, commands = (self._commands(max(row - 1, 0)).take(paths), self._commands(row).take(paths))
        failed = refused(commands)
        if (failed != Status.PENDING).any():
            return row, self._end(row, alive, paths, failed)
        with _settling(commands, self.threads) as settle_row:
            while True:
                self._settle(settle_row, row, paths, before, commands)
                failed, row = self.status[row, paths], row + 1
                failed = np.where(failed == Status.CONVERGED, Status.PENDING.value, failed)
                if row < len(self.status) and (failed == Status.PENDING).all():
                    before, commands = commands, self._commands(row).take(paths)
                    failed = refused(commands)
                if row == len(self.status) or (failed != Status.PENDING).any():
                    return row, self._end(row, alive, paths, failed)

    def _settle(
        self, settle_row: RowSettling, row: int, paths: Int[np.ndarray, " some"], before: Problems, commands: Problems
    ) -> None:
        """Settle ``paths`` at one row, from the equilibria before, moved as the commands are."""
        starts = commands
        if row > 0:
            positions, rotations = moved(
                self.positions[row - 1, paths], self.rotations[row - 1, paths], before, commands
            )
            starts = replace(commands, positions=positions, rotations=rotations)
        memory = Memory(**{name: part[paths] for name, part in self.memory.items()}, time=np.nan)
        found, after = settle_row(starts, memory, float(self.path.durations[row]), row == 0)
        for name, part in found.items():
            getattr(self, name)[row, paths] = part
        for name, part in self.memory.items():
            part[paths] = getattr(after, name)

    def _end(
        self,
        row: int,
        alive: Bool[np.ndarray, " paths"],
        paths: Int[np.ndarray, " some"],
        status: Int[np.ndarray, " some"],
    ) -> Bool[np.ndarray, " paths"]:
        """End those of ``paths`` with another status than ``PENDING`` from ``row`` on; which paths go on."""
        ended = status != Status.PENDING
        self.status[row:, paths[ended]] = status[ended]
        going = alive.copy()
        going[paths[ended]] = False
        return going


@contextmanager
def _settling(problems: Problems, threads: int) -> Iterator[RowSettling]:
    """What settles rows of a path, for the robot and as many paths as these problems are."""
    if weighs(problems.robot):
        yield partial(_settled_with_mass, threads)
        return
    with simulations_of(problems, threads=threads) as simulations:
        yield partial(_settled_without_mass, simulations)


def _settled_without_mass(
    simulations: Simulations, starts: Problems, memory: Memory, duration: float, first: bool
) -> tuple[dict[str, np.ndarray], Memory]:
    """Equilibria with massless cables, from the poses of ``starts``, and the memory there."""
    simulations.start(starts, own_springs=False, memory=memory, duration=duration)
    relaxation, reading = come_to_rest(simulations)
    found = {name: getattr(reading, name) for name in READ}
    return found | dict(iterations=relaxation.steps, status=relaxation.status), simulations.remembered(reading)


def _settled_with_mass(
    threads: int, starts: Problems, memory: Memory, duration: float, first: bool
) -> tuple[dict[str, np.ndarray], Memory]:
    """The same where some cables have mass; the first of a path starts where massless cables rest."""
    at = settled_without_mass(starts, threads) if first else starts.poses
    settled = released(starts, at, memory=(memory, duration), threads=threads)
    found = {name: getattr(settled, name) for name in READ} | dict(iterations=settled.steps, status=settled.status)
    if settled.memory is None:
        rest = np.broadcast_to(starts.rest_lengths, settled.tensions.shape)
        return found, replace(memory, beyond=rest, tensions=settled.tensions)
    return found, settled.memory


def _parts(robot: Robot) -> dict[str, tuple[int, ...]]:
    """The arrays of a ``Memory`` of one path, by their shapes."""
    fresh = Memory.fresh(robot)
    return {name: getattr(fresh, name).shape for name in ("strains", "beyond", "creep", "tensions")}

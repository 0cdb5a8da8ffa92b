"""``PathProblem``: the commands along a path, in small steps, and the memory at its beginning; of both methods."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from cdpr_sim.core import cable_path
from cdpr_sim.core.checks import Frozen, checked_array, refuse_unless, whole
from cdpr_sim.core.errors import InvalidInput
from cdpr_sim.core.memory import Memory
from cdpr_sim.core.problem import Problems
from cdpr_sim.core.robot import Robot

MOST_STEPS = 100_000
"""Largest number of steps between two commands."""


def moved_as_commanded(
    positions: Float[np.ndarray, "*batch 3"],
    rotations: Float[np.ndarray, "*batch 3 3"],
    before: Problems,
    now: Problems,
) -> tuple[Float[np.ndarray, "*batch 3"], Float[np.ndarray, "*batch 3 3"]]:
    """Poses near the equilibria of ``now``: those of ``before``, moved as the commanded poses move."""
    turned = now.rotations @ np.swapaxes(before.rotations, -1, -2) @ rotations
    turned = turned @ (3 * np.eye(3) - np.swapaxes(turned, -1, -2) @ turned) / 2  # removes the rounding of many steps
    return positions + (now.positions - before.positions), turned


@dataclass(frozen=True, eq=False)
class PathProblem(Frozen):
    """Commands of a robot one after another, or of many paths side by side; checked and frozen.

    A method goes from row to row of ``fine``: it finds the equilibrium of that row's problem with the memory of the row
    before, from the pose there, and then the new memory. Rows that cannot be solved end their path.

    Attributes:
        problems: the commands, (steps, ...); further dimensions are paths side by side.
        fine: the commands with the steps between them, (fine, ...).
        kept: index in ``fine`` of each of ``problems``, (steps,).
        durations: time from the row before to each row of ``fine``, (fine,) [s]; 0 for the first of a new path.
        times: time of each of ``problems``, (steps,) [s].
        memory: the memory before the first command, (...).
    """

    problems: Problems
    fine: Problems
    kept: Int[np.ndarray, " steps"]
    durations: Float[np.ndarray, " fine"]
    times: Float[np.ndarray, " steps"]
    memory: Memory

    @property
    def robot(self) -> Robot:
        """The robot of all rows."""
        return self.problems.robot

    @classmethod
    def of(
        cls, problems: Problems, *, times: ArrayLike | None = None, memory: Memory | None = None, steps: int = 1
    ) -> PathProblem:
        """The path through these commands; the other arguments are those of ``solve_path``.

        Steps between two commands go along the commanded poses: between lengths that are interpolated, cables would
        change by more than their stretch. Given rest lengths are interpolated by their difference from the rigid ones.

        Raises:
            InvalidInput: a single pose in place of a path; times that decrease; a memory of other cables; steps that
                are no whole number.
        """
        robot, shape = problems.robot, problems.shape
        if not shape:
            raise InvalidInput("poses: found a single pose, expected a path, (steps, 3) or (steps, 6)")
        steps = whole("steps", steps, 1, MOST_STEPS)
        refuse_unless(Memory | None, memory=memory)
        begin = (Memory.fresh(robot) if memory is None else memory).broadcast(robot, shape[1:])
        moments = _checked_times(times, shape[0], begin)
        durations = np.diff(moments, prepend=moments[0] if np.isnan(begin.time) else begin.time)
        fine = problems if steps == 1 else _divided(problems, steps)
        kept = steps * np.arange(shape[0])
        return cls(
            problems=problems,
            fine=fine,
            kept=kept,
            durations=np.append(durations[:1], np.repeat(durations[1:] / steps, steps)),
            times=moments,
            memory=begin,
        )

    def __repr__(self) -> str:
        return f"<PathProblem of {self.robot.name!r}: {self.problems.shape}, in {len(self.fine)} steps>"


def _divided(problems: Problems, steps: int) -> Problems:
    """The same commands, with ``steps`` steps from each to the next; the commands themselves stay the same numbers."""
    robot, shape = problems.robot, problems.shape
    positions = np.broadcast_to(problems.positions, (*shape, 3))
    rotations = np.broadcast_to(problems.rotations, (*shape, 3, 3))
    wrenches = np.broadcast_to(problems.external_wrench, (*shape, 6))
    given = np.broadcast_to(problems.rest_lengths, (*shape, robot.cables))
    more = given - cable_path.lengths(robot.cabling, positions, rotations)
    turns = rotations[1:] @ np.swapaxes(rotations[:-1], -1, -2)
    known = np.isfinite(turns).all((-1, -2), keepdims=True)
    turns = Rotation.from_matrix(np.where(known, turns, np.eye(3)).reshape(-1, 3, 3)).as_rotvec()
    part = (np.arange(1, steps) / steps).reshape(-1, *np.ones(len(shape), int))

    def between(commands: np.ndarray) -> np.ndarray:
        """Interpolated linearly, (steps, steps between them, ...)."""
        return commands[:-1, None] + part * (commands[1:] - commands[:-1])[:, None]

    def in_order(inner: np.ndarray, commands: np.ndarray) -> np.ndarray:
        """The first command, and then for each step those before it and itself."""
        return np.concatenate([commands[:1], *np.concatenate([inner, commands[1:, None]], axis=1)])

    vectors = part * turns.reshape(shape[0] - 1, 1, *shape[1:], 3)
    turned = Rotation.from_rotvec(vectors.reshape(-1, 3)).as_matrix().reshape(*vectors.shape, 3) @ rotations[:-1, None]
    at = between(positions)
    rest = cable_path.lengths(robot.cabling, at, turned) + between(more)
    falls = np.broadcast_to(problems.falls, shape)
    return Problems(
        robot=robot,
        positions=in_order(at, positions),
        rotations=in_order(turned, rotations),
        rest_lengths=in_order(rest, given),
        external_wrench=in_order(between(wrenches), wrenches),
        axial_stiffness=problems.axial_stiffness,
        mass=problems.mass,
        shape=(1 + steps * (shape[0] - 1), *shape[1:]),
        falls=np.concatenate([falls[:1], np.repeat(falls[1:], steps, axis=0)]),
    )


def _checked_times(times: ArrayLike | None, steps: int, memory: Memory) -> Float[np.ndarray, " steps"]:
    """Moments of a path [s]; without ``times``, all are that of the memory, or 0."""
    if times is None:
        return np.full(steps, 0.0 if np.isnan(memory.time) else memory.time)
    moments = checked_array("times", times, (steps,))
    before = np.append(moments[0] if np.isnan(memory.time) else memory.time, moments)
    backwards = np.diff(before) < 0
    if backwards.any():
        step = int(np.argmax(backwards))
        raise InvalidInput(
            f"times: found {moments[step]:g} s at step {step + 1}, after {before[step]:g} s, expected times that do "
            "not decrease"
        )
    return moments

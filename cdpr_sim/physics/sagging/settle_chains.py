"""Settling of robots whose cables have mass; and residuals at given poses."""

# pyright: reportAttributeAccessIssue=false
# mujoco ships no type stubs for its compiled modules.
from __future__ import annotations

from collections.abc import Callable
from functools import partial

import mujoco
import numpy as np
from jaxtyping import Bool, Float
from scipy.spatial.transform import RigidTransform

from cdpr_sim.core.equilibrium import NotSettled
from cdpr_sim.core.memory import Memory
from cdpr_sim.core.problem import Problem, Problems
from cdpr_sim.core.status import Status
from cdpr_sim.physics.batch import SimulationReading, quiet
from cdpr_sim.physics.chains import too_short
from cdpr_sim.physics.dynamic_relaxation import settled
from cdpr_sim.physics.sagging.chain_derivatives import ChainDerivatives
from cdpr_sim.physics.sagging.chain_simulations import ChainSimulations
from cdpr_sim.physics.sagging.settling import Settling

Frames = list[tuple[float, RigidTransform, np.ndarray, np.ndarray]]
"""(time, pose, lengths, tensions) at every step of the motion of the first row."""

ROWS = 256
"""Rows that move side by side: with more, each costs no less, and they need 0.2 MB each."""


def released(
    problems: Problems,
    starts: RigidTransform,
    *,
    model: mujoco.MjModel | None = None,
    frames: Frames | None = None,
    say: Callable[[str], None] | None = None,
    memory: tuple[Memory, float] | None = None,
    threads: int = 1,
) -> tuple[dict[str, np.ndarray], Memory | None]:
    """Settle each of (rows,) problems from its start.

    Args:
        problems: the problems.
        starts: a stack of poses, one for each.
        model: the model to use instead of the generated one.
        frames: collects the motion of the first one.
        say: is called from time to time with the progress as text.
        memory: of cables with one, (rows,), and the time since then [s]; default: that of new ropes.
        threads: 0 for one per processor.

    Returns:
        Columns of an ``EquilibriumBatch``; and the memory, without the time, None where no cable has one.

    Raises:
        InvalidInput: a mass per problem, since all rows have one model.
    """
    count, found, memories = len(problems), [], []
    for first in range(0, count, ROWS):
        rows = np.arange(first, min(first + ROWS, count))

        def report(row: int, progress: str, first: int = first) -> None:
            if say is not None:
                say(f"pose {first + row + 1} of {count}: {progress}" if count > 1 else progress)

        with quiet():
            simulations = ChainSimulations(
                problems.take(rows),
                starts[rows],
                model=model,
                memory=None if memory is None else (memory[0][rows], memory[1]),
                threads=threads,
            )
            settling = Settling(simulations, report if say is not None else None)
            if frames is not None and first == 0:
                _record(settling, frames)
            settling.settle()
            found.append(settled(settling, read(simulations), partial(read, simulations)))
            memories.append({} if simulations.ropes is None else simulations.remembered().arrays)
    columns, after = (
        {name: np.concatenate([part[name] for part in parts]) for name in parts[0]} for parts in (found, memories)
    )
    return columns, Memory(**after, time=np.nan) if after else None


def _record(settling: Settling, frames: Frames) -> None:
    """Move the first row to rest in a viscous medium."""
    for motion in settling.damped():
        seen = motion.look()
        frames.append((motion.time, seen.poses[0], seen.lengths[0], seen.tensions[0]))


def read(simulations: ChainSimulations) -> SimulationReading:
    """Each row's state at its coordinates, zero velocity and with the true springs."""
    rows = simulations.all
    residuals = simulations.residuals(rows)
    off_wheel = simulations.off_wheel(rows)
    eigenvalues, softest = ChainDerivatives.of(simulations, rows).stiffness()
    seen = vars(simulations.observe(rows))
    return SimulationReading(**seen, residuals=residuals, eigenvalues=eigenvalues, softest=softest, off_wheel=off_wheel)


def at_rest(problem: Problem, start: RigidTransform, *, held: bool = False) -> ChainSimulations:
    """Simulation of one problem at the equilibrium to which its platform settles from ``start``.

    If it is ``held`` there, whatever pulls it, its chains settle.

    Raises:
        NotSettled: it does not settle, or its chains do not.
    """
    simulations = single(problem, start)
    if not _settles(simulations, held=held)[0]:
        what = "the cables with mass" if held else "the platform on cables with mass"
        raise NotSettled(f"{problem.robot.name}: {what} did not come to rest in MuJoCo")
    return simulations


def single(problem: Problem, start: RigidTransform) -> ChainSimulations:
    """Simulation of one problem, released at ``start``."""
    return ChainSimulations(Problems.stack([problem]), RigidTransform.concatenate([start]))


def _settles(simulations: ChainSimulations, *, held: bool) -> Bool[np.ndarray, " rows"]:
    """Which rows settle, with their platforms ``held`` or not."""
    if held:
        simulations.hold()
    settling = Settling(simulations)
    settling.settle()
    simulations.held = False
    return settling.status == Status.CONVERGED


def unbalanced(
    problems: Problems, poses: RigidTransform, *, model: mujoco.MjModel | None = None, threads: int = 1
) -> Float[np.ndarray, " rows"]:
    """Largest unbalanced force [N] on each platform held at its pose.

    It is nan if its chains do not settle, or are too short for their wheels.
    """
    found = np.full(len(problems), np.nan)
    long_enough = ~too_short(
        problems.robot, np.broadcast_to(problems.rest_lengths, (len(problems), problems.robot.cables))
    ).any(1)
    possible = np.flatnonzero(long_enough)
    for first in range(0, len(possible), ROWS):
        rows = possible[first : first + ROWS]
        with quiet():
            simulations = ChainSimulations(problems.take(rows), poses[rows], model=model, threads=threads)
            settles = _settles(simulations, held=True)
            found[rows] = np.where(settles, simulations.unbalanced(simulations.all), np.nan)
    return found

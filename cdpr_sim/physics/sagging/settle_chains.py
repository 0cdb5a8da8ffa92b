"""Settling of robots whose cables have mass, problem by problem; and residuals at given poses."""

# pyright: reportAttributeAccessIssue=false
# mujoco ships no type stubs for its compiled modules.
from __future__ import annotations

from collections.abc import Callable, Iterator

import mujoco
import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import RigidTransform

from cdpr_sim.core.equilibrium import NotSettled
from cdpr_sim.core.memory import Memory
from cdpr_sim.core.problem import Problem, Problems
from cdpr_sim.core.status import NEUTRAL, Status
from cdpr_sim.physics.batch import quiet, refuse_own_masses
from cdpr_sim.physics.chains import too_short
from cdpr_sim.physics.dynamic_relaxation import NUDGES
from cdpr_sim.physics.sagging.chain_relaxation import ChainRelaxation, Frames
from cdpr_sim.physics.sagging.chain_simulation import ChainSimulation
from cdpr_sim.physics.sagging.chain_state import ChainState

LONGEST_AGAIN = 0.03
"""Longest time step, as a fraction of 1/omega of the slowest oscillation, for a platform that did not settle at
first."""


def released(
    problems: Problems,
    starts: RigidTransform,
    *,
    model: mujoco.MjModel | None = None,
    frames: Frames | None = None,
    say: Callable[[str], None] = lambda words: None,
    memory: tuple[Memory, float] | None = None,
) -> tuple[list[ChainState], list[int], list[Status]]:
    """Settle each of (rows,) problems from its start: last state, number of time steps, and status.

    Args:
        problems: the problems.
        starts: a stack of poses, one for each.
        model: the model to use instead of the generated one.
        frames: collects the motion of the first one.
        say: is called from time to time with the progress as text.
        memory: of cables with one, (rows,), and the time since then [s]; default: that of new ropes.

    Raises:
        InvalidInput: a mass per problem, since all rows have one model.
    """
    readings, steps, status = [], [], []
    for row, (simulation, start) in enumerate(_rows(problems, starts, model, memory)):
        which = f"pose {row + 1} of {len(problems)}: " if len(problems) > 1 else ""
        relaxation = _relaxed(
            simulation, start, frames if row == 0 else None, lambda words, which=which: say(which + words)
        )
        reading = ChainState.of(simulation)
        for _ in range(NUDGES):
            values = reading.eigenvalues
            if relaxation.status is not Status.CONVERGED or not values[0] < -NEUTRAL * np.abs(values).max():
                break
            relaxation.nudge(reading.softest)
            relaxation.run()
            reading = ChainState.of(simulation)
        readings.append(reading)
        steps.append(relaxation.steps)
        if problems.robot.cabling.beyond_law(reading.lengths, simulation.rest_lengths).any():
            status.append(Status.OVERSTRAINED)
            continue
        # A cable off its wheel is no longer this robot's: an equilibrium that depends on it does not count.
        status.append(Status.OFF_WHEEL if reading.off_wheel else relaxation.status)
    return readings, steps, status


def _relaxed(
    simulation: ChainSimulation,
    start: RigidTransform,
    frames: Frames | None,
    say: Callable[[str], None] = lambda words: None,
) -> ChainRelaxation:
    """Settle in long steps, else by ``approach`` from the start, else in shorter steps; then divide chains at bends.

    Over wheels ``approach`` comes first, unless the motion is wanted: time steps take ten times as long there.
    """
    relaxation = ChainRelaxation(simulation, frames, say)
    at_once = frames is None and bool(simulation.chains.over.any())
    if at_once:
        if relaxation.approach_from_afar():
            return relaxation.divide_at_bends()
        simulation.let_go(start)
    relaxation.run()
    if relaxation.status is not Status.CONVERGED:
        simulation.let_go(start)
        if not at_once and relaxation.approach_from_afar():
            return relaxation.divide_at_bends()
        simulation.let_go(start)
        relaxation = relaxation.again(LONGEST_AGAIN)
        relaxation.run()
    return relaxation.divide_at_bends()


def at_rest(problem: Problem, start: RigidTransform) -> ChainSimulation:
    """Simulation of a problem at the equilibrium to which its platform settles from ``start``.

    Raises:
        NotSettled: it does not come to rest.
    """
    robot = problem.robot
    simulation = ChainSimulation(robot, problem.rest_lengths, robot.axial_stiffness, problem.external_wrench, start)
    if _relaxed(simulation, start, None).status is not Status.CONVERGED:
        raise NotSettled(f"{robot.name}: the platform on cables with mass did not come to rest in MuJoCo")
    return simulation


def held_at(problem: Problem, pose: RigidTransform) -> ChainSimulation:
    """Simulation of a problem with the platform at ``pose``, whatever pulls it, and its chains at rest.

    Raises:
        NotSettled: the chains do not come to rest.
    """
    robot = problem.robot
    simulation = ChainSimulation(robot, problem.rest_lengths, robot.axial_stiffness, problem.external_wrench, pose)
    simulation.hold()
    if _relaxed(simulation, pose, None).status is not Status.CONVERGED:
        raise NotSettled(f"{robot.name}: the cables with mass did not come to rest in MuJoCo")
    simulation.held = False
    return simulation


def unbalanced(
    problems: Problems, poses: RigidTransform, *, model: mujoco.MjModel | None = None
) -> Float[np.ndarray, " rows"]:
    """Largest unbalanced force [N] on each platform held at its pose.

    It is nan if its chains do not settle, or are too short for their wheels.
    """
    found = []
    for simulation, pose in _rows(problems, poses, model):
        if too_short(problems.robot, simulation.rest_lengths).any():
            found.append(np.nan)
            continue
        simulation.hold()
        rested = _relaxed(simulation, pose, None).status is Status.CONVERGED
        simulation.held = False
        found.append(simulation.unbalanced() if rested else np.nan)
    return np.array(found)


def _rows(
    problems: Problems,
    starts: RigidTransform,
    model: mujoco.MjModel | None,
    memory: tuple[Memory, float] | None = None,
) -> Iterator[tuple[ChainSimulation, RigidTransform]]:
    """Each problem's simulation, and where it starts."""
    robot, rows = problems.robot, len(problems)
    refuse_own_masses(problems)
    rest = np.broadcast_to(problems.rest_lengths, (rows, robot.cables))
    stiffness = np.broadcast_to(problems.axial_stiffness, (rows, robot.cables))
    wrenches = np.broadcast_to(problems.external_wrench, (rows, 6))
    with quiet():
        for row in range(rows):
            start = starts[row]
            before = None if memory is None else (memory[0][row], memory[1])
            yield ChainSimulation(robot, rest[row], stiffness[row], wrenches[row], start, model, before), start

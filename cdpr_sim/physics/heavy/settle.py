"""What is asked of heavy cables, problem by problem: where each platform rests, and what holding it at a pose takes."""

# pyright: reportAttributeAccessIssue=false
# mujoco ships no type stubs for its compiled modules.
from __future__ import annotations

from collections.abc import Callable, Iterator

import mujoco
import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import RigidTransform

from cdpr_sim.core.problem import Problems
from cdpr_sim.core.status import NEUTRAL, Status
from cdpr_sim.physics.batch import quiet, refuse_own_masses
from cdpr_sim.physics.heavy.hanging import Hanging
from cdpr_sim.physics.heavy.reading import Reading
from cdpr_sim.physics.heavy.relaxation import Frames, HangingRelaxation
from cdpr_sim.physics.relaxation import NUDGES

LONGEST_AGAIN = 0.03
"""Longest time step, as a fraction of the slowest swing's 1/omega, of a platform that did not come to rest at first."""


def released(
    problems: Problems,
    starts: RigidTransform,
    *,
    model: mujoco.MjModel | None = None,
    frames: Frames | None = None,
    say: Callable[[str], None] = lambda words: None,
) -> tuple[list[Reading], list[int], list[Status]]:
    """Each of (rows,) problems, its platform let go at its start: the last state, time steps, and how it ended.

    Args:
        problems: what is asked.
        starts: a stack, one for each.
        model: the model to use instead of the generated one.
        frames: takes the first one's motion.
        say: is told now and then how far it is.

    Raises:
        InvalidInput: masses of their own, which one model cannot have.
    """
    readings, steps, status = [], [], []
    for row, hanging in enumerate(_rows(problems, starts, model)):
        which = f"pose {row + 1} of {len(problems)}: " if len(problems) > 1 else ""
        relaxation = _relaxed(
            hanging, starts[row], frames if row == 0 else None, lambda words, which=which: say(which + words)
        )
        reading = Reading.of(hanging)
        for _ in range(NUDGES):
            values = reading.eigenvalues
            if relaxation.status is not Status.CONVERGED or not values[0] < -NEUTRAL * np.abs(values).max():
                break
            relaxation.nudge(reading.softest)
            relaxation.run()
            reading = Reading.of(hanging)
        readings.append(reading)
        steps.append(relaxation.steps)
        # A cable off its wheel is another robot's: whatever holds it there is not this one's equilibrium.
        status.append(Status.OFF_WHEEL if reading.off_wheel else relaxation.status)
    return readings, steps, status


def _relaxed(
    hanging: Hanging, start: RigidTransform, frames: Frames | None, say: Callable[[str], None]
) -> HangingRelaxation:
    """In long steps, or else by approach from the start, or else in shorter ones; then divided where chains bend."""
    relaxation = HangingRelaxation(hanging, frames, say)
    relaxation.run()
    if relaxation.status is not Status.CONVERGED:
        hanging.let_go(start)
        if relaxation.approach_from_afar():
            return relaxation.divide_at_bends()
        hanging.let_go(start)
        relaxation = relaxation.again(LONGEST_AGAIN)
        relaxation.run()
    return relaxation.divide_at_bends()


def unbalanced(
    problems: Problems, poses: RigidTransform, *, model: mujoco.MjModel | None = None
) -> Float[np.ndarray, " rows"]:
    """The largest force [N] on each platform held at its pose, with its chains at rest; nan where they do not rest."""
    found = []
    for hanging in _rows(problems, poses, model):
        hanging.hold()
        relaxation = HangingRelaxation(hanging)
        relaxation.run()
        rested = relaxation.divide_at_bends().status is Status.CONVERGED
        hanging.held = False
        found.append(hanging.unbalanced() if rested else np.nan)
    return np.array(found)


def _rows(problems: Problems, starts: RigidTransform, model: mujoco.MjModel | None) -> Iterator[Hanging]:
    robot, rows = problems.robot, len(problems)
    refuse_own_masses(problems)
    rest = np.broadcast_to(problems.rest_lengths, (rows, robot.cables))
    stiffness = np.broadcast_to(problems.axial_stiffness, (rows, robot.cables))
    wrenches = np.broadcast_to(problems.external_wrench, (rows, 6))
    with quiet():
        for row in range(rows):
            yield Hanging(robot, rest[row], stiffness[row], wrenches[row], starts[row], model)

"""Controllers of ``cdpr_sim.control`` in the environments."""

from __future__ import annotations

from typing import Any

import numpy as np

from cdpr_sim.core.checks import refuse_unless
from cdpr_sim.core.controller import Command, Controller
from cdpr_sim.core.trajectory import Trajectory
from cdpr_sim.learning.environments import Environment
from cdpr_sim.physics.sensing import pose_of, recorded


def run(
    environment: Any, controller: Controller, *, seed: int | None = None, options: dict[str, Any] | None = None
) -> tuple[Trajectory, float]:
    """An episode in which a controller acts, from the equilibrium on its first lengths, as in ``track``.

    Its sensors are exact and without delay, and sample once in each control period.

    Args:
        environment: of one simulation, as ``gymnasium.make`` returns it.
        controller: any with the two methods of ``Controller``; its model is its own.
        seed: of the environment's reset.
        options: of the environment's reset.

    Returns:
        The motion, a state for each control period and the first and the last instant; and the sum of the rewards.

    Raises:
        InvalidInput: not such an environment, or a command that its winches cannot carry out.
        NotConverged: there is no equilibrium on the controller's first lengths.
    """
    refuse_unless(Environment, environment=environment.unwrapped)
    task = environment.unwrapped.task
    environment.reset(seed=seed, options=options)
    reference = task.references[0]
    lengths = Command.of(controller.start(reference), task.robot.cables).rest_lengths
    task.restart(0, lengths, pose_of(task.simulations.poses[0]))
    times = task.period * np.arange(task.periods + 1)
    wanted = reference.poses(times)
    seen, total, over = [task.simulations.seen(0)], 0.0, False
    while not over:
        tick = len(seen)
        command = controller.command(tick * task.period, wanted[tick], task.measurement(0))
        _, reward, fallen, ended, _ = environment.step(task.action_of(0, command))
        seen.append(task.simulations.seen(0))
        total, over = total + float(reward), fallen or ended
    return recorded(task.robot, wanted, times, seen), total

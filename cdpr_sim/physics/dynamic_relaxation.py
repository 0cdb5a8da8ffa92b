"""Dynamic relaxation: move platforms in MuJoCo to equilibrium, with adaptive damping and time steps.

Otter and Day 1960; Underwood 1983. Only the equilibrium matters and not the time to reach it: true mass, inertia and
cables, from the commanded pose at zero velocity, in a medium of adaptive damping, with adaptive time steps. The last
part, where only the equilibrium beside the platform is possible, is Newton's method (``newton_finish``).
"""

# pyright: reportAttributeAccessIssue=false
# mujoco ships no type stubs for its compiled modules.
from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any

import mujoco
import numpy as np
from jaxtyping import Bool, Float
from mujoco.batch import SimulationError

from cdpr_sim.core.checks import frozen
from cdpr_sim.core.robot import Robot
from cdpr_sim.core.status import ACCEPTABLE, IDLE_STRAIN, Status
from cdpr_sim.physics.batch import MOST_IDLE, SimulationReading, Simulations
from cdpr_sim.physics.newton_finish import finish

RESIDUAL = 1e-9
"""Largest unbalanced force of an equilibrium, as a fraction of the load (the weight, or the external wrench if
larger)."""

ROUNDING = 2 * np.finfo(float).eps
"""Relative accuracy of a cable's force, in EA: the rounding of a length, times EA/l0."""

SPEED = 1e-6
"""Largest speed at equilibrium, as a fraction of (cable length x angular frequency): at it, crossing the frame takes
days."""

STEPS = 30_000
"""Time steps after which a platform counts as not converging. DemoBot needs a hundred; sliding along stiff cables,
thousands."""

NUDGES = 3
"""Number of pushes of a platform that is balanced on a saddle. One that returns each time counts as stable after
all: under an external torque, which is not conservative, the symmetric part of the stiffness does not decide."""

CHUNK = 13
"""Time steps between two evaluations of the residual; odd, so that a velocity that alternates at every step is
visible."""

FIRST_STEP, SHORTEST_STEP, LONGEST_STEP = 0.1, 1e-4, 0.3
"""Time steps as fractions of 1/omega of the slowest oscillation; with longer ones stiff cables make light platforms
unstable."""

FIRST_DAMPING, LEAST_DAMPING, MOST_DAMPING = 1.5, 0.5, 20.0
"""Damping ratio of the slowest oscillation: overdamped at first, so that the platform sinks into the equilibrium below
it and does not swing into another one."""

OVERDAMPED = 10.0
"""Smallest damping ratio of a platform that has been below a wheel: it does not swing past an equilibrium beside the
wheel; at 5, one in thirty on a single cable still did."""

STRAINED = 20.0
"""Sum of initial tensions, in loads, above which they, and not the load, determine the frequencies of oscillations."""

SLUGGISH = 3.0
"""Rate at which such a platform rotates under its tensions, over that of its translations, after its inertia is
increased: highly tensioned cables rotate a small platform faster than the time steps for the translations can
resolve."""

RATTLES = 8
"""Numbers of time steps after which the rotational inertia is doubled. The added inertia is halved again where
a platform is slow at the least damping."""

READY, AGAIN = 1e-3, 0.03
"""Unbalanced force, as a fraction of the load, below which Newton's method is tried; and the fraction of that force
below which it is tried again, if it failed."""

BETTER, ALONG, PATIENCE = 0.7, 0.95, 2
"""A residual below this fraction of the best so far is progress; a cosine above this is a force along the velocity; and
after this many evaluations without either, the platform oscillates."""


class Relaxation:
    """Motion of each row towards equilibrium, with its own time step and damping.

    While the residual falls, the step grows. Where it does not, force and velocity distinguish two cases:

    - *slow*: the force keeps the direction of a steady velocity, because only damping slows the platform.
      Then the step grows and the damping falls.
    - *oscillating*: the force has another direction: in such a long step, cables go slack and taut again. Then the step
      shrinks and the damping grows.
    """

    def __init__(self, simulations: Simulations, frames: list[tuple[float, np.ndarray]] | None) -> None:
        self.simulations, self.frames = simulations, frames
        robot = simulations.robot
        rest_lengths = simulations.rest_lengths
        self.reach = rest_lengths.max(1)
        wrenches = np.abs(simulations.wrenches)
        self.load = np.maximum(
            robot.weight, np.maximum(wrenches[:, :3].max(1), wrenches[:, 3:].max(1) / simulations.length)
        )
        simulations.qvel[:] = 0
        simulations.batch.forward(stage=mujoco.mjtStage.mjSTAGE_POS.value)
        # Without gravity or wrench the load is the largest force of the cables on each other.
        stiffness = simulations.springs * rest_lengths * simulations.unit
        self.load = np.where(self.load > 0, self.load, IDLE_STRAIN * stiffness.mean(1))
        self.length = rest_lengths.mean(1)
        pull = simulations.pull
        self.strained = pull > STRAINED * self.load
        self.swing = np.sqrt(np.where(self.strained, pull, self.load) / robot.mass / self.length)
        rounding = ROUNDING * stiffness.max(1)
        self.target = np.minimum(np.maximum(RESIDUAL * self.load, rounding), ACCEPTABLE * self.load)
        self.own_inertia, self.inertia_added = inertias(robot), False
        self.inertia = np.tile(self.own_inertia, (len(self.load), 1))
        turning = self.inertia[:, simulations.angular]
        needed = robot.mass * simulations.length * self.length / SLUGGISH**2
        self._add_inertia(np.where(self.strained[:, None], np.maximum(needed[:, None] - turning, 0), 0))
        rows = len(simulations.qpos)
        self.steps = np.zeros(rows, dtype=int)
        self.status = np.full(rows, Status.ITERATION_LIMIT.value)
        self.limit = np.full(rows, STEPS)
        self.live = np.ones(rows, dtype=bool)
        self.start = simulations.qpos.copy()
        self.qpos = self.start.copy()
        self.least_damping = np.full(rows, LEAST_DAMPING)
        self.velocity = np.zeros((rows, simulations.free))
        self.step, self.ratio = np.full(rows, FIRST_STEP), np.full(rows, FIRST_DAMPING)
        self.best, self.patience = np.full(rows, np.inf), np.zeros(rows, dtype=int)
        self.rattles = np.zeros(rows, dtype=int)
        self.ready = READY * self.load
        self.moving = self.start.copy(), np.zeros_like(simulations.qvel)  # before Newton's method
        self.finished = np.zeros(rows, dtype=bool)
        if frames is not None:
            frames.append((0.0, self.qpos[0].copy()))

    def nudge(self, rows: Bool[np.ndarray, " rows"], directions: Float[np.ndarray, "rows free"]) -> None:
        """Move ``rows`` on with a small velocity along an unstable direction, as any disturbance would."""
        simulations = self.simulations
        speed = 1e-3 * self.swing * self.reach
        velocity = directions * (speed * np.where(directions.sum(1) < 0, -1, 1))[:, None]
        velocity[:, simulations.angular] /= simulations.length
        if simulations.free == 6:
            velocity[:, 3:] = np.einsum("nji,nj->ni", simulations.rotations, velocity[:, 3:])
        simulations.qvel[rows, : simulations.free] = velocity[rows]
        self._set_off(rows, self.qpos)
        self.run()

    def again(self, rows: Bool[np.ndarray, " rows"]) -> None:
        """Start ``rows`` again from their initial pose, overdamped."""
        self.least_damping[rows] = OVERDAMPED
        self.simulations.reset(rows)
        self._set_off(rows, self.start)
        if self.frames is not None:
            self.frames[:] = self.frames[:1]

    def _set_off(self, rows: Bool[np.ndarray, " rows"], qpos: Float[np.ndarray, "rows coordinates"]) -> None:
        self.simulations.qpos[rows] = qpos[rows]
        self.simulations.hold(rows)
        self.live |= rows
        self.status[rows] = Status.ITERATION_LIMIT
        self.step[rows], self.ratio[rows] = FIRST_STEP, np.maximum(FIRST_DAMPING, self.least_damping[rows])
        self.best[rows], self.patience[rows] = np.inf, 0
        self.limit[rows] = self.steps[rows] + STEPS
        self.ready[rows], self.finished[rows] = READY * self.load[rows], False

    def resume(self, rows: Bool[np.ndarray, " rows"]) -> None:
        """Let ``rows`` that Newton's method finished move on from where it began, without it."""
        simulations = self.simulations
        simulations.qpos[rows], simulations.qvel[rows] = self.moving[0][rows], self.moving[1][rows]
        simulations.follow(rows)
        self.live |= rows
        self.status[rows] = Status.ITERATION_LIMIT
        self.ready[rows], self.finished[rows] = 0.0, False

    def run(self) -> None:
        """Move the live rows until each has reached equilibrium or its limit."""
        simulations = self.simulations
        while self.live.any():
            if self.strained.any():
                load = np.where(self.strained, np.maximum(simulations.pull, self.load), self.load)
                self.swing = np.sqrt(load / simulations.robot.mass / self.length)
            simulations.timestep[:] = self.step / self.swing
            simulations.damping[:, : simulations.free] = (self.ratio * self.swing)[:, None] * self.twice_inertia
            np.copyto(self.qpos, simulations.qpos, where=self.live[:, None])
            self._advance()
            self._judge()
            self._adapt()
            self._finish()
            simulations.follow(self.live)

    def _advance(self) -> None:
        batch = self.simulations.batch
        try:
            if self.frames is None:
                batch.step(self.live, nstep=CHUNK)
            else:
                for _ in range(CHUNK):
                    batch.step(self.live)
                    self.frames.append((float(batch.time[0]), self.simulations.qpos[0].copy()))
        except SimulationError as error:
            self._end(np.isin(np.arange(len(self.live)), error.ids), Status.DIVERGED, self.qpos)
        self.steps += CHUNK * self.live
        if batch.warning[:, :, 1].any():
            self._end(self.live & batch.warning[:, :, 1].any(1), Status.DIVERGED, self.qpos)

    def _judge(self) -> None:
        simulations = self.simulations
        self.residual = simulations.unbalanced
        calm = self.live & (self.residual <= self.target)
        if calm.any():
            # These are the forces of one time step ago, at a velocity: evaluate them again at zero velocity.
            speed = np.abs(simulations.qvel[:, : simulations.free])
            speed[:, simulations.angular] *= simulations.length
            calm &= speed.max(1) <= SPEED * self.swing * self.reach
            velocity = simulations.qvel.copy()
            simulations.qvel[calm] = 0
            simulations.follow(calm)
            simulations.batch.forward(calm)
            at_rest = calm & (simulations.unbalanced <= self.target)
            simulations.qvel[:] = np.where(at_rest[:, None], 0, velocity)
            self._end(at_rest, Status.CONVERGED, simulations.qpos)
        stalled = self.live & (self.steps >= self.limit)
        if stalled.any():
            self._end(stalled, Status.ITERATION_LIMIT, simulations.qpos)

    def _finish(self) -> None:
        """Let rows near their equilibrium reach it by Newton's method, unless the motion itself is wanted."""
        ready = self.live & (self.residual < self.ready)
        if self.frames is not None or not ready.any():
            return
        self.ready[ready] = AGAIN * self.residual[ready]
        self.moving[0][ready], self.moving[1][ready] = self.simulations.qpos[ready], self.simulations.qvel[ready]
        taken = finish(self.simulations, ready, self.target)
        self.steps += taken
        self.finished |= taken > 0
        self._end(taken > 0, Status.CONVERGED, self.simulations.qpos)

    def _end(self, rows: Bool[np.ndarray, " rows"], status: Status, qpos: np.ndarray) -> None:
        self.live &= ~rows
        self.qpos[rows] = qpos[rows]
        self.status[rows] = status

    def _adapt(self) -> None:
        velocity = self.simulations.qvel[:, : self.simulations.free] * self.root_inertia
        better = self.residual < BETTER * self.best
        slow = ~better
        if slow.any():
            force = self.simulations.accelerating / self.root_inertia
            slow &= parallel(force, velocity) & parallel(velocity, self.velocity)
        self.velocity = velocity
        going = better | slow
        self.patience = np.where(going, 0, self.patience + 1)
        rattling = self.patience >= PATIENCE
        longer, thinner = np.where(rattling, 0.6, np.where(going, 1.2, 1.0)), np.where(slow, 0.9, 1.0)
        self.step = np.minimum(np.maximum(self.step * longer, SHORTEST_STEP), LONGEST_STEP)
        self.ratio = self.ratio * np.where(rattling, 1.5, thinner)
        self.ratio = np.minimum(np.maximum(self.ratio, self.least_damping), MOST_DAMPING)
        self.best = np.where(going | rattling, self.residual, self.best)
        self.patience[rattling] = 0
        if not (self.inertia_added or rattling.any()):
            return
        self.rattles += rattling
        heavier = rattling & (self.rattles % RATTLES == 0)
        lighter = slow & (self.ratio == self.least_damping)
        if heavier.any() or lighter.any():
            turning, own = (inertia[..., self.simulations.angular] for inertia in (self.inertia, self.own_inertia))
            self._add_inertia(heavier[:, None] * turning - lighter[:, None] * (turning - own) / 2)

    def _add_inertia(self, added: Float[np.ndarray, "rows turns"]) -> None:
        """Increase the rotational inertia: the equilibrium does not depend on it."""
        simulations = self.simulations
        self.inertia_added = bool((added > 0).any()) or self.inertia_added
        simulations.armature[:, simulations.angular] += added / simulations.unit
        self.inertia[:, simulations.angular] += added
        self.root_inertia, self.twice_inertia = np.sqrt(self.inertia), 2 * self.inertia / simulations.unit


def settled(
    relaxation: Any, reading: SimulationReading, read: Callable[[], SimulationReading]
) -> dict[str, np.ndarray]:
    """Columns of an ``EquilibriumBatch`` after a relaxation, with a nudge of platforms that are at saddles.

    Args:
        relaxation: a ``Relaxation``, or the ``ChainRelaxation`` of cables with mass.
        reading: the state after it.
        read: reads the state again.
    """
    robot = relaxation.simulations.robot
    for _ in range(NUDGES):
        saddles = (relaxation.status == Status.CONVERGED) & reading.unstable
        if not saddles.any():
            break
        relaxation.nudge(saddles, reading.softest)
        reading = read()
    beyond = robot.cabling.beyond_law(reading.lengths, relaxation.simulations.rest_lengths).any(1)
    relaxation.status[beyond] = Status.OVERSTRAINED
    # A cable off its wheel is no longer this robot's: an equilibrium that depends on it does not count.
    relaxation.status[reading.off_wheel] = Status.OFF_WHEEL
    columns = {name: getattr(reading, name) for name in ("positions", "rotations", "lengths", "tensions", "residuals")}
    return columns | {"stiffness": reading.eigenvalues, "iterations": relaxation.steps, "status": relaxation.status}


def parallel(a: Float[np.ndarray, "rows free"], b: Float[np.ndarray, "rows free"]) -> Bool[np.ndarray, " rows"]:
    """Whether vectors have nearly the same direction."""
    return np.vecdot(a, b) > ALONG * np.sqrt(np.vecdot(a, a) * np.vecdot(b, b))


@functools.lru_cache(maxsize=MOST_IDLE)
def inertias(robot: Robot) -> Float[np.ndarray, " free"]:
    """Mass [kg] and moments of inertia about the platform's axes [kg m²], per free direction, for the damping."""
    offset = robot.center_of_mass
    about_origin = robot.inertia + robot.mass * (offset @ offset * np.eye(3) - np.outer(offset, offset))
    return frozen(np.concatenate([np.full(3, robot.mass), np.diag(about_origin)])[robot.free])

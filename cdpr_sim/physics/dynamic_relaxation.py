"""Dynamic relaxation: move platforms in MuJoCo to equilibrium, with adaptive damping and time steps.

Otter and Day 1960; Underwood 1983. Only the equilibrium matters and not the time to reach it: true mass, inertia and
cables, from the commanded pose at zero velocity, in a medium of adaptive damping, with adaptive time steps. The last
part, where only the equilibrium beside the platform is possible, is Newton's method (``settling``).
"""

# pyright: reportAttributeAccessIssue=false
# mujoco ships no type stubs for its compiled modules.
from __future__ import annotations

import functools
from collections.abc import Callable

import mujoco
import numpy as np
from jaxtyping import Bool, Float, Int
from mujoco.batch import SimulationError

from cdpr_sim.core.checks import frozen
from cdpr_sim.core.robot import Robot
from cdpr_sim.core.status import Status
from cdpr_sim.physics.simulations import MOST_IDLE, Rows, Simulations

Frames = list[tuple[float, np.ndarray]]
"""(time, qpos) at every step of a motion."""

SPEED = 1e-6
"""Largest speed at equilibrium, as a fraction of (cable length x angular frequency): at it, crossing the frame takes
days."""

STEPS = 30_000
"""Time steps after which a platform counts as not converging. DemoBot needs a hundred; sliding along stiff cables,
thousands."""

CHUNK = 13
"""Time steps between two evaluations of the residual; odd, so that a velocity that alternates at every step is
visible."""

FIRST_STEP, SHORTEST_STEP, LONGEST_STEP = 0.1, 1e-4, 0.3
"""Time steps as fractions of 1/omega of the slowest oscillation; with longer ones stiff cables make light platforms
unstable."""

FIRST_DAMPING, LEAST_DAMPING, MOST_DAMPING = 1.5, 0.5, 20.0
"""Damping ratio of the slowest oscillation: overdamped at first, so that the platform sinks into the equilibrium below
it and does not swing into another one. Fast oscillations are not overdamped: of random platforms that fall into eight
cables as long as their spans, one in a hundred ends in another equilibrium than an overdamped motion."""

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

    Args:
        simulations: the platforms.
        target: largest unbalanced force of an equilibrium [N].
        steps: of the rows, counted here.
        status: of the rows, set here.
        finish: moves rows to the equilibria beside them; returns which reach them.
        frames: collects every step of the first row, if given; then no row is finished.
    """

    def __init__(
        self,
        simulations: Simulations,
        target: Float[np.ndarray, " rows"],
        steps: Int[np.ndarray, " rows"],
        status: Int[np.ndarray, " rows"],
        finish: Callable[[Rows], Bool[np.ndarray, " some"]],
        frames: Frames | None,
    ) -> None:
        self.simulations, self.target, self.steps, self.status = simulations, target, steps, status
        self.finish, self.frames = finish, frames
        robot, self.load, rows = simulations.robot, simulations.load, len(simulations.all)
        self.length, self.reach = simulations.size, simulations.rest_lengths.max(1)
        simulations.batch.forward(simulations.all, stage=mujoco.mjtStage.mjSTAGE_POS.value)
        pull = simulations.pull(simulations.all)
        self.strained = pull > STRAINED * self.load
        self.swing = np.sqrt(np.where(self.strained, pull, self.load) / robot.mass / self.length)
        self.own_inertia, self.inertia_added = inertias(robot), False
        self.inertia = np.tile(self.own_inertia, (rows, 1))
        turning = self.inertia[:, simulations.angular]
        needed = robot.mass * simulations.length * self.length / SLUGGISH**2
        self._add_inertia(np.where(self.strained[:, None], np.maximum(needed[:, None] - turning, 0), 0))
        self.limit = np.full(rows, STEPS)
        self.live = np.ones(rows, dtype=bool)
        self.start = simulations.qpos.copy()
        self.qpos = self.start.copy()
        self.least_damping = np.full(rows, LEAST_DAMPING)
        self.velocity = np.zeros((rows, simulations.free))
        self.step, self.ratio = np.full(rows, FIRST_STEP), np.full(rows, FIRST_DAMPING)
        self.best, self.patience = np.full(rows, np.inf), np.zeros(rows, dtype=int)
        self.rattles = np.zeros(rows, dtype=int)
        self.residual, self.ready = np.zeros(rows), READY * self.load
        self.moving = self.start.copy(), np.zeros_like(simulations.qvel)  # before Newton's method
        self.finished = np.zeros(rows, dtype=bool)
        if frames is not None:
            frames.append((0.0, self.qpos[0].copy()))

    def nudge(self, rows: Bool[np.ndarray, " rows"], directions: Float[np.ndarray, "rows free"]) -> None:
        """Move ``rows`` on with a small velocity along an unstable direction, as any disturbance would."""
        simulations, at = self.simulations, np.flatnonzero(rows)
        speed = 1e-3 * self.swing[at] * self.reach[at] * np.where(directions[at].sum(1) < 0, -1, 1)
        simulations.qvel[at] = simulations.in_dofs(at, directions[at] * speed[:, None])
        self._set_off(rows, self.qpos)

    def again(self, rows: Bool[np.ndarray, " rows"]) -> None:
        """Start ``rows`` again from their initial pose, overdamped."""
        self.least_damping[rows] = OVERDAMPED
        self.simulations.reset(np.flatnonzero(rows))
        if self.frames is not None:
            self.frames[:] = self.frames[:1]
        self._set_off(rows, self.start)

    def _set_off(self, rows: Bool[np.ndarray, " rows"], qpos: Float[np.ndarray, "rows coordinates"]) -> None:
        self.simulations.qpos[rows] = qpos[rows]
        self.simulations.follow(np.flatnonzero(rows))
        self.step[rows], self.ratio[rows] = FIRST_STEP, np.maximum(FIRST_DAMPING, self.least_damping[rows])
        self.best[rows], self.patience[rows] = np.inf, 0
        self.limit[rows] = self.steps[rows] + STEPS
        self.ready[rows], self.finished[rows] = READY * self.load[rows], False
        self._go(rows)

    def resume(self, rows: Bool[np.ndarray, " rows"]) -> None:
        """Let ``rows`` that Newton's method finished move on from where it began, without it."""
        simulations = self.simulations
        simulations.qpos[rows], simulations.qvel[rows] = self.moving[0][rows], self.moving[1][rows]
        simulations.follow(np.flatnonzero(rows))
        self.ready[rows], self.finished[rows] = 0.0, False
        self._go(rows)

    def _go(self, rows: Bool[np.ndarray, " rows"]) -> None:
        self.live |= rows
        self.status[rows] = Status.ITERATION_LIMIT
        self.run()

    def run(self) -> None:
        """Move the live rows until each has reached equilibrium or its limit."""
        simulations = self.simulations
        while self.live.any():
            if self.strained.any():
                pull = np.maximum(simulations.pull(simulations.all), self.load)
                self.swing = np.sqrt(np.where(self.strained, pull, self.load) / simulations.robot.mass / self.length)
            simulations.timestep[: len(self.live)] = self.step / self.swing
            simulations.damping[:, : simulations.free] = (self.ratio * self.swing)[:, None] * self.twice_inertia
            np.copyto(self.qpos, simulations.qpos, where=self.live[:, None])
            self._advance()
            self._judge()
            self._adapt()
            self._finish()
            simulations.follow(np.flatnonzero(self.live))

    def _advance(self) -> None:
        batch, at = self.simulations.batch, np.flatnonzero(self.live)
        try:
            if self.frames is None:
                batch.step(at, nstep=CHUNK)
            else:
                for _ in range(CHUNK):
                    batch.step(at)
                    self.frames.append((float(batch.time[0]), self.simulations.qpos[0].copy()))
        except SimulationError as error:
            self._end(np.isin(self.simulations.all, error.ids), Status.DIVERGED, self.qpos)
        self.steps[at] += CHUNK
        warned = batch.warning[: len(self.live), :, 1].any(1)
        if warned.any():
            self._end(self.live & warned, Status.DIVERGED, self.qpos)

    def _judge(self) -> None:
        simulations, at = self.simulations, np.flatnonzero(self.live)
        simulations.take_over(at)
        self.residual[at] = simulations.unbalanced(at)
        calm = at[self.residual[at] <= self.target[at]]
        if len(calm):
            # These are the forces of one time step ago, at a velocity: evaluate them again at zero velocity.
            speed = np.abs(simulations.qvel[calm, : simulations.free])
            speed[:, simulations.angular] *= simulations.length
            calm = calm[speed.max(1) <= SPEED * self.swing[calm] * self.reach[calm]]
            velocity = simulations.qvel[calm]
            rests = simulations.residuals(calm) <= self.target[calm]
            simulations.qvel[calm[~rests]] = velocity[~rests]
            at_rest = np.zeros_like(self.live)
            at_rest[calm[rests]] = True
            self._end(at_rest, Status.CONVERGED, simulations.qpos)
        stalled = self.live & (self.steps >= self.limit)
        if stalled.any():
            self._end(stalled, Status.ITERATION_LIMIT, simulations.qpos)

    def _finish(self) -> None:
        """Let rows near their equilibrium reach it by Newton's method, unless the motion itself is wanted."""
        at = np.flatnonzero(self.live & (self.residual < self.ready))
        if self.frames is not None or not len(at):
            return
        simulations = self.simulations
        self.ready[at] = AGAIN * self.residual[at]
        self.moving[0][at], self.moving[1][at] = simulations.qpos[at], simulations.qvel[at]
        reached = np.zeros_like(self.live)
        reached[at] = self.finish(at)
        self.finished |= reached
        self._end(reached, Status.CONVERGED, simulations.qpos)

    def _end(self, rows: Bool[np.ndarray, " rows"], status: Status, qpos: np.ndarray) -> None:
        self.live &= ~rows
        self.qpos[rows] = qpos[rows]
        self.status[rows] = status

    def _adapt(self) -> None:
        velocity = self.simulations.qvel[:, : self.simulations.free] * self.root_inertia
        better = self.residual < BETTER * self.best
        slow = ~better
        if slow.any():
            force = self.simulations.net[:, : self.simulations.free] / self.root_inertia
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


def parallel(a: Float[np.ndarray, "rows free"], b: Float[np.ndarray, "rows free"]) -> Bool[np.ndarray, " rows"]:
    """Whether vectors have nearly the same direction."""
    return np.vecdot(a, b) > ALONG * np.sqrt(np.vecdot(a, a) * np.vecdot(b, b))


@functools.lru_cache(maxsize=MOST_IDLE)
def inertias(robot: Robot) -> Float[np.ndarray, " free"]:
    """Mass [kg] and moments of inertia about the platform's axes [kg m²], per free direction, for the damping."""
    offset = robot.center_of_mass
    about_origin = robot.inertia + robot.mass * (offset @ offset * np.eye(3) - np.outer(offset, offset))
    return frozen(np.concatenate([np.full(3, robot.mass), np.diag(about_origin)])[robot.free])

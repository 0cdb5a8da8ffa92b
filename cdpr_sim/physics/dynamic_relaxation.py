"""Dynamic relaxation: move platforms in MuJoCo until they rest, with damping and time steps that follow what they do.

Otter and Day 1960; Underwood 1983. Only the place of rest matters and not the time that it takes: real mass, inertia
and cables, from the commanded pose at zero velocity, in a medium whose damping adapts, with time steps that do.
"""

from __future__ import annotations

import functools

import numpy as np
from jaxtyping import Bool, Float
from mujoco.batch import SimulationError

from cdpr_sim.core.checks import frozen
from cdpr_sim.core.robot import Robot
from cdpr_sim.core.status import ACCEPTABLE, IDLE_STRAIN, Status
from cdpr_sim.physics.batch import MOST_IDLE, Simulations

RESIDUAL = 1e-9
"""Largest unbalanced force at rest, as a fraction of the load (the weight, or the external wrench where larger)."""

ROUNDING = 2 * np.finfo(float).eps
"""A cable's force is known to this fraction of EA at best: the rounding of a length, times EA/l0."""

SPEED = 1e-6
"""Speed at rest, as a fraction of (cable length x swing rate): it would take days to cross the frame."""

STEPS = 30_000
"""Time steps after which a platform is restless. DemoBot needs a hundred; sliding along stiff cables, thousands."""

NUDGES = 3
"""How often a platform that is balanced on a saddle is pushed off it. One that comes back each time is at rest after
all: under an external torque, which is not conservative, the symmetric part of the stiffness does not decide."""

CHUNK = 13
"""Time steps between two looks at the residual; odd, so that a velocity that turns round at every step shows."""

FIRST_STEP, SHORTEST_STEP, LONGEST_STEP = 0.1, 1e-4, 0.3
"""Time steps as fractions of the slowest swing's 1/omega; with longer ones stiff cables throw light platforms about."""

FIRST_DAMPING, LEAST_DAMPING, MOST_DAMPING = 1.5, 0.5, 20.0
"""Damping ratio of the slowest swing: overdamped at first, so that the platform sinks into the equilibrium below it
rather than swinging over into another one."""

OVERDAMPED = 10.0
"""Least damping ratio of a platform that had been lost under a wheel: it does not swing past an equilibrium beside the
wheel, where at 5 one in thirty on a single cable still did."""

STRAINED = 20.0
"""Tensions of this many loads, together, at the start: then they, and not the load, set the pace of the swings."""

SLUGGISH = 3.0
"""Rate at which such a platform turns under its tensions, over that of its swings, once it is given the inertia for it:
cables that are drawn tight turn a small platform faster than time steps that suit the rest can follow."""

RATTLES = 8
"""After so many, and again after as many more, the rotational inertia is doubled. What was added is halved again where
a platform is slow at the least damping."""

BETTER, ALONG, PATIENCE = 0.7, 0.95, 2
"""A residual below this fraction of the best so far is progress; a cosine above this is a force along the velocity; and
after this many looks without either, the platform rattles."""


class Relaxation:
    """Each row's motion towards rest, with a time step and a damping of its own.

    While the residual falls the step grows. Where it does not, there are two reasons, told apart by force and velocity:

    - *slow*: the force keeps pointing along a steady velocity, as it does when damping alone holds the platform back.
      Then the step grows and the damping falls.
    - *rattling*: the force points elsewhere: in a step that long, cables go slack and taut again. Then the step shrinks
      and the damping rises.
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
        simulations.batch.forward()
        # Without gravity or wrench the load is what the cables could do to one another.
        stiffness = simulations.springs * rest_lengths * simulations.unit
        self.load = np.where(self.load > 0, self.load, IDLE_STRAIN * stiffness.mean(1))
        self.length = rest_lengths.mean(1)
        pull = simulations.pull
        self.strained = pull > STRAINED * self.load
        self.swing = np.sqrt(np.where(self.strained, pull, self.load) / robot.mass / self.length)
        rounding = ROUNDING * stiffness.max(1)
        self.target = np.minimum(np.maximum(RESIDUAL * self.load, rounding), ACCEPTABLE * self.load)
        self.own_inertia, self.heavy = _inertias(robot), False
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
        if frames is not None:
            frames.append((0.0, self.qpos[0].copy()))

    @property
    def settled(self) -> Bool[np.ndarray, " rows"]:
        """Which rows have come to rest."""
        return self.status == Status.CONVERGED

    def nudge(self, rows: Bool[np.ndarray, " rows"], directions: Float[np.ndarray, "rows free"]) -> None:
        """Set ``rows`` going along the direction in which they are not held, as any breath of air would."""
        simulations = self.simulations
        speed = 1e-3 * self.swing * self.reach
        velocity = directions * (speed * np.where(directions.sum(1) < 0, -1, 1))[:, None]
        velocity[:, simulations.angular] /= simulations.length
        if simulations.free == 6:
            velocity[:, 3:] = np.einsum("nji,nj->ni", simulations.rotations, velocity[:, 3:])
        simulations.qvel[rows, : simulations.free] = velocity[rows]
        self._set_off(rows, self.qpos)

    def again(self, rows: Bool[np.ndarray, " rows"]) -> None:
        """Let ``rows`` go again where they started, overdamped."""
        self.least_damping[rows] = OVERDAMPED
        self.simulations.reset(rows)
        self._set_off(rows, self.start)
        if self.frames is not None:
            self.frames[:] = self.frames[:1]

    def _set_off(self, rows: Bool[np.ndarray, " rows"], qpos: Float[np.ndarray, "rows coordinates"]) -> None:
        self.simulations.qpos[rows] = qpos[rows]
        self.live |= rows
        self.status[rows] = Status.ITERATION_LIMIT
        self.step[rows], self.ratio[rows] = FIRST_STEP, np.maximum(FIRST_DAMPING, self.least_damping[rows])
        self.best[rows], self.patience[rows] = np.inf, 0
        self.limit[rows] = self.steps[rows] + STEPS

    def run(self) -> None:
        """Move the live rows on until each has come to rest or will not."""
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
            simulations.turn_wheels(self.live)

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
            # These are the forces of one time step ago, and velocity bends them: look again, at rest.
            speed = np.abs(simulations.qvel[:, : simulations.free])
            speed[:, simulations.angular] *= simulations.length
            calm &= speed.max(1) <= SPEED * self.swing * self.reach
            velocity = simulations.qvel.copy()
            simulations.qvel[calm] = 0
            simulations.turn_wheels(calm)
            simulations.batch.forward(calm)
            at_rest = calm & (simulations.unbalanced <= self.target)
            simulations.qvel[:] = np.where(at_rest[:, None], 0, velocity)
            self._end(at_rest, Status.CONVERGED, simulations.qpos)
        weary = self.live & (self.steps >= self.limit)
        if weary.any():
            self._end(weary, Status.ITERATION_LIMIT, simulations.qpos)

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
            slow &= _parallel(force, velocity) & _parallel(velocity, self.velocity)
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
        if not (self.heavy or rattling.any()):
            return
        self.rattles += rattling
        heavier = rattling & (self.rattles % RATTLES == 0)
        lighter = slow & (self.ratio == self.least_damping)
        if heavier.any() or lighter.any():
            turning, own = (inertia[..., self.simulations.angular] for inertia in (self.inertia, self.own_inertia))
            self._add_inertia(heavier[:, None] * turning - lighter[:, None] * (turning - own) / 2)

    def _add_inertia(self, added: Float[np.ndarray, "rows turns"]) -> None:
        """Make rotations slower: the pose of rest does not depend on inertia."""
        simulations = self.simulations
        self.heavy = bool((added > 0).any()) or self.heavy
        simulations.armature[:, simulations.angular] += added / simulations.unit
        self.inertia[:, simulations.angular] += added
        self.root_inertia, self.twice_inertia = np.sqrt(self.inertia), 2 * self.inertia / simulations.unit


def _parallel(a: Float[np.ndarray, "rows free"], b: Float[np.ndarray, "rows free"]) -> Bool[np.ndarray, " rows"]:
    return np.vecdot(a, b) > ALONG * np.sqrt(np.vecdot(a, a) * np.vecdot(b, b))


@functools.lru_cache(maxsize=MOST_IDLE)
def _inertias(robot: Robot) -> Float[np.ndarray, " free"]:
    """Mass [kg] and moments of inertia about the platform's axes [kg m²], per free direction, for the damping."""
    offset = robot.center_of_mass
    about_origin = robot.inertia + robot.mass * (offset @ offset * np.eye(3) - np.outer(offset, offset))
    return frozen(np.concatenate([np.full(3, robot.mass), np.diag(about_origin)])[robot.free])

"""Dynamic relaxation of platforms on cables with mass, to equilibrium, with adaptive time steps and damping.

Like ``physics.dynamic_relaxation`` for massless cables, with steps that are stable for chains (``stepping``) and Newton
steps at the end (``approach``).
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from jaxtyping import Bool, Float
from scipy.spatial.transform import RigidTransform

from cdpr_sim.core.status import Status
from cdpr_sim.physics.dynamic_relaxation import ACCEPTABLE, RESIDUAL, ROUNDING, SPEED, parallel
from cdpr_sim.physics.sagging.approach import approach
from cdpr_sim.physics.sagging.chain_simulations import ChainSimulations, Rows
from cdpr_sim.physics.sagging.stepping import Stepping

STEPS, MOST_STEPS = 10_000, 30_000
"""Time steps after which a platform counts as not converging: on taut cables it needs some ten, on slack ones tens to
thousands. And the largest number in total, with new starts in shorter steps or from a saddle."""

MOST_APPROACHES = 2000
"""Total number of steps of ``approach``: one costs as much as one to fifty time steps."""

LOOK = 5
"""Time steps between two evaluations of the residual."""

LONGEST, SHORTEST = 0.1, 1e-4
"""Time steps, as fractions of 1/omega of the slowest oscillation."""

FIRST_DAMPING, LEAST_DAMPING, MOST_DAMPING = 1.5, 0.5, 1000.0
"""Damping ratio of the platform's slowest oscillation. Where it moves far with chains that are just slack, steps stay
long and the platform is damped more: only its speed is too high for the chains."""

BETTER, PATIENCE = 0.9, 5
"""A residual below this fraction of the best so far is progress; after this many evaluations without progress, the
platform oscillates."""

CLOSE = 0.01
"""Unbalanced force, as a fraction of the load and of each chain's weight, below which a platform begins to ``approach``
its equilibrium."""

LONGEST_AGAIN = 0.03
"""``LONGEST`` for a platform that did not settle at first."""

Frames = list[tuple[float, RigidTransform, np.ndarray, np.ndarray]]
"""(time, pose, lengths, tensions) at every step of the motion of the first row."""


class ChainRelaxation:
    """The motion of platforms towards equilibrium, each with its own time step and damping.

    Args:
        simulations: the platforms.
        frames: collects every step of the first row, if given.
        say: is called from time to time with a row and its progress as text.
    """

    def __init__(
        self,
        simulations: ChainSimulations,
        frames: Frames | None = None,
        say: Callable[[int, str], None] | None = None,
    ) -> None:
        self.simulations, self.frames, self.say = simulations, frames, say
        rows = len(simulations.all)
        self.longest = np.full(rows, LONGEST)
        self.target = np.zeros(rows)
        self.steps, self.approaches = np.zeros((2, rows), dtype=int)
        self.time, self.step, self.ratio = np.zeros((3, rows))
        self.status = np.full(rows, Status.ITERATION_LIMIT.value)
        self.velocity = np.zeros((rows, simulations.free))
        self.best, self.patience = np.zeros(rows), np.zeros(rows, dtype=int)
        self.good = simulations.qpos.copy()
        self.stepping = Stepping(simulations, LONGEST / simulations.swing)
        self._aim(simulations.all)

    def _aim(self, at: Rows) -> None:
        """The largest unbalanced force of an equilibrium, with these springs."""
        simulations = self.simulations
        stiffest = simulations.springs[at][:, simulations.chains.segments].max((1, 2))
        rounding = ROUNDING * stiffest * simulations.rest_lengths[at].max(1)
        load = simulations.load[at]
        self.target[at] = np.minimum(np.maximum(RESIDUAL * load, rounding), ACCEPTABLE * load)

    def relax(self) -> None:
        """Settle in long steps, else by ``approach`` from the start, else in shorter ones; then divide at bends.

        Over wheels ``approach`` comes first, unless the motion is wanted: time steps take ten times as long there. It
        also does where exits give way, which time steps hold in place.
        """
        simulations = self.simulations
        at_once = self.frames is None and (bool(simulations.chains.over.any()) or bool(simulations.frames))
        if at_once:
            self.approach_from_afar(simulations.all)
            simulations.restart(self._unsettled)
        self.run(self._unsettled)
        simulations.restart(self._unsettled)
        if not at_once:
            self.approach_from_afar(self._unsettled)
            simulations.restart(self._unsettled)
        left = self._unsettled
        if len(left):
            self.longest[left] = LONGEST_AGAIN
            self._prepare(left)
            self.run(left)
        self._divide_at_bends()

    @property
    def _unsettled(self) -> Rows:
        """The rows that have not come to rest."""
        return np.flatnonzero(self.status != Status.CONVERGED)

    def _prepare(self, at: Rows) -> None:
        """Begin anew from the present state, with the springs that there are now; time continues."""
        self._aim(at)
        self.stepping.longest[at] = self.longest[at] / self.simulations.swing[at]
        self.stepping.prepare(at)

    def _divide_at_bends(self) -> None:
        """Settle rows at rest with their chains divided finely where they bend."""
        at = self.simulations.divide_at_bends(np.flatnonzero(self.status == Status.CONVERGED))
        if len(at):
            self._prepare(at)
            self.stepping.stiffen(at)
            self.status[at] = Status.ITERATION_LIMIT
            self.run(at[~self._approach(at)])

    def run(self, at: Rows) -> None:
        """Move rows until the platform is in equilibrium or the limits are reached."""
        simulations = self.simulations
        self.step[at], self.ratio[at] = self.longest[at], FIRST_DAMPING
        self.velocity[at] = 0
        self.best[at], self.patience[at], self.good[at] = np.inf, 0, simulations.qpos[at]
        self.stepping.begin(at)
        self._damp(at)
        limit, close = np.minimum(self.steps + STEPS, MOST_STEPS), np.full(len(self.steps), CLOSE)
        self.status[at] = Status.ITERATION_LIMIT
        moving = at
        while len(live := moving[(self.steps < limit)[moving]]):
            for _ in range(LOOK):
                self._advance(live)
            simulations.turn_wheels(live)
            unstable = simulations.unstable(live)
            broken = live[unstable]
            hopeless = self.step[broken] < SHORTEST
            self.status[broken[hopeless]] = Status.DIVERGED
            self._restart(broken[~hopeless])
            calm = live[~unstable]
            simulations.move_exits(calm)
            residual = simulations.unbalanced(calm)
            if self.say is not None:
                for row, left in zip(calm, residual, strict=True):
                    load = simulations.load[row]
                    self.say(int(row), f"{self.steps[row]} time steps, {left:.1e} N of {load:.3g} N unbalanced")
            self.stepping.adapt_to(calm, residual)
            true = simulations.true(calm)
            unbalanced = np.where(true, self._unbalanced(calm), np.inf)
            rest = calm[(residual <= self.target[calm]) & true]
            self.status[rest[self._at_rest(rest)]] = Status.CONVERGED
            near = (unbalanced <= close[calm]) & (self.status[calm] != Status.CONVERGED)
            self._approach(calm[near])
            going = self.status[calm] != Status.CONVERGED
            close[calm] = np.where(near, np.minimum(close[calm], 0.1 * unbalanced), close[calm])
            self._adapt(calm[going], residual[going])
            moving = live[self.status[live] == Status.ITERATION_LIMIT]
        failed = at[self.status[at] != Status.CONVERGED]
        simulations.qpos[failed] = self.good[failed]

    def approach_from_afar(self, at: Rows) -> None:
        """Rows that ``approach`` takes to equilibrium from here, with chains laid out for the pulls to expect."""
        if len(at):
            self.simulations.residuals(at)
            self.simulations.lay(at, self.simulations.expected_pulls(at))
            self._approach(at)

    def nudge(self, rows: Bool[np.ndarray, " rows"], directions: Float[np.ndarray, "rows free"]) -> None:
        """Move ``rows`` on with a small velocity along an unstable direction, as any disturbance would."""
        simulations, at = self.simulations, np.flatnonzero(rows)
        self.stepping.stiffen(at)
        speed = 1e-3 * simulations.swing[at] * simulations.rest_lengths[at].max(1)
        ways = np.where(directions[at].sum(1) < 0, -1, 1)
        simulations.qvel[at] = simulations.in_dofs(at, directions[at] * (ways * speed)[:, None])
        self.run(at)

    def _approach(self, at: Rows) -> Bool[np.ndarray, " some"]:
        """Which rows ``approach`` takes to equilibrium, which then is the next and last state of the motion."""
        if not len(at):
            return np.zeros(0, dtype=bool)
        reached, taken = approach(self.simulations, at, self.target[at], MOST_APPROACHES - self.approaches[at])
        self.approaches[at] += taken
        there = at[reached]
        self.status[there] = Status.CONVERGED
        self._record(there, self.longest[there] / self.simulations.swing[there])
        return reached

    def _advance(self, at: Rows) -> None:
        self._record(at, self.stepping.advance(at, self.step[at] / self.simulations.swing[at]))

    def _record(self, at: Rows, time: Float[np.ndarray, " some"]) -> None:
        """Record one step of that duration [s]."""
        self.steps[at] += 1
        self.time[at] += time
        if self.frames is not None and len(at) and at[0] == 0:
            seen = self.simulations.observe(self.simulations.all[:1])
            self.frames.append((self.time[0], seen.poses[0], seen.lengths[0], seen.tensions[0]))

    def _restart(self, at: Rows) -> None:
        """Restart from the last good coordinates, in shorter steps."""
        if len(at):
            self.simulations.reset(at)
            self.simulations.qpos[at] = self.good[at]
            self.step[at] *= 0.3
            self.best[at], self.patience[at] = np.inf, 0
            self.stepping.soften(at)

    def _adapt(self, at: Rows, residual: Float[np.ndarray, " some"]) -> None:
        """Adapt steps and damping to this residual: longer steps and less damping with progress, else the opposite."""
        better, slow = residual < BETTER * self.best[at], self._slow(at)
        progress = better | slow
        self.good[at[better]] = self.simulations.qpos[at[better]]
        step, ratio = self.step[at], self.ratio[at]
        step = np.where(progress, np.minimum(1.2 * step, self.longest[at]), step)
        ratio = np.where(progress, np.maximum(np.where(slow, 0.9, 0.95) * ratio, LEAST_DAMPING), ratio)
        patience = np.where(progress, 0, self.patience[at] + 1)
        stalled = patience > PATIENCE
        step = np.where(stalled & (ratio == MOST_DAMPING), np.maximum(0.6 * step, SHORTEST), step)
        self.step[at], self.ratio[at] = step, np.where(stalled, np.minimum(3 * ratio, MOST_DAMPING), ratio)
        self.best[at] = np.where(progress | stalled, residual, self.best[at])
        self.patience[at] = np.where(stalled, 0, patience)
        self._damp(at)

    def _damp(self, at: Rows) -> None:
        """Damp the platforms by their present ratios."""
        simulations = self.simulations
        damping = (2 * self.ratio[at] * simulations.swing[at])[:, None] * simulations.inertia
        simulations.damping[at, : simulations.free] = damping

    def _slow(self, at: Rows) -> Bool[np.ndarray, " some"]:
        """Whether force and velocity point the same way as before: only damping slows the platform."""
        simulations = self.simulations
        root = np.sqrt(simulations.inertia)
        force = simulations.net[at, : simulations.free] / root
        velocity, before = simulations.qvel[at, : simulations.free] * root, self.velocity[at]
        self.velocity[at] = velocity
        return parallel(force, velocity) & parallel(velocity, before)

    def _at_rest(self, at: Rows) -> Bool[np.ndarray, " some"]:
        """Whether platforms are in equilibrium, with forces evaluated again at zero velocity."""
        simulations = self.simulations
        speed = np.abs(simulations.qvel[at, : simulations.free])
        speed[:, simulations.angular] *= simulations.length
        highest = SPEED * simulations.swing[at] * simulations.rest_lengths[at].max(1)
        calm = speed.max(1) <= highest
        velocity = simulations.qvel[at]
        calm[calm] = simulations.residuals(at[calm]) <= self.target[at[calm]]
        simulations.qvel[at[~calm]] = velocity[~calm]
        return calm

    def _unbalanced(self, at: Rows) -> Float[np.ndarray, " some"]:
        """Unbalanced forces, as fractions of the load and of each chain's weight."""
        simulations = self.simulations
        platform, slides = simulations.forces(at)
        unbalanced = (np.abs(slides) / simulations.weights[at][..., None]).max((1, 2))
        return (
            unbalanced if simulations.held else np.maximum(unbalanced, np.abs(platform).max(1) / simulations.load[at])
        )

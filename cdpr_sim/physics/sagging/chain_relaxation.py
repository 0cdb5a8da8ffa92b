"""Dynamic relaxation of one platform on cables with mass, to equilibrium, with adaptive time steps and damping.

Like ``physics.dynamic_relaxation`` for massless cables, with steps that are stable for chains (``stepping``) and Newton
steps at the end (``approach``).
"""

# pyright: reportAttributeAccessIssue=false
# mujoco ships no type stubs for its compiled modules.
from __future__ import annotations

from collections.abc import Callable

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import RigidTransform

from cdpr_sim.core.status import Status
from cdpr_sim.physics.dynamic_relaxation import ACCEPTABLE, ALONG, RESIDUAL, ROUNDING, SPEED
from cdpr_sim.physics.sagging.approach import approach
from cdpr_sim.physics.sagging.chain_simulation import ChainSimulation
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

Frames = list[tuple[float, RigidTransform, np.ndarray, np.ndarray]]
"""(time, pose, lengths, tensions) at every step of a motion."""


class ChainRelaxation:
    """The motion of one platform towards equilibrium.

    Args:
        simulation: the platform.
        frames: collects every step, if given.
        say: is called from time to time with the progress as text.
        longest: time step, as a fraction of 1/omega of the slowest oscillation.
    """

    def __init__(
        self,
        simulation: ChainSimulation,
        frames: Frames | None = None,
        say: Callable[[str], None] = lambda words: None,
        longest: float = LONGEST,
    ) -> None:
        self.simulation, self.frames, self.say, self.longest = simulation, frames, say, longest
        rest = simulation.rest_lengths
        self.swing = simulation.swing
        self.speed = SPEED * self.swing * float(rest.max())
        rounding = ROUNDING * float(simulation.springs[simulation.chains.segments].max()) * float(rest.max())
        self.target = min(max(RESIDUAL * simulation.load, rounding), ACCEPTABLE * simulation.load)
        self.stepping = Stepping(simulation, longest / self.swing)
        self.steps, self.time, self.approaches, self.status = 0, 0.0, 0, Status.ITERATION_LIMIT

    def again(self, longest: float) -> ChainRelaxation:
        """A new relaxation from the present state, with time steps of at most that fraction; time continues."""
        other = ChainRelaxation(self.simulation, self.frames, self.say, longest)
        other.steps, other.time, other.approaches = self.steps, self.time, self.approaches
        return other

    def divide_at_bends(self) -> ChainRelaxation:
        """Settle with the chains divided finely where they bend: returns this relaxation, or a continued one."""
        if self.status is not Status.CONVERGED or not self.simulation.divide_at_bends():
            return self
        other = self.again(self.longest)
        other.stepping.stiffen()
        if not other._approach():
            other.run()
        return other

    def run(self) -> None:
        """Move until the platform is in equilibrium or the limits are reached."""
        simulation, data = self.simulation, self.simulation.data
        self.step, self.ratio = self.longest, FIRST_DAMPING
        self.velocity = np.zeros(simulation.free)
        self.best, self.patience, self.good = np.inf, 0, data.qpos.copy()
        self.stepping.begin()
        self._damp()
        limit, close = min(self.steps + STEPS, MOST_STEPS), CLOSE
        self.status = Status.ITERATION_LIMIT
        while self.steps < limit:
            for _ in range(LOOK):
                self._advance()
            simulation.turn_wheels()
            if data.warning.number.any() or not np.isfinite(data.qvel).all():
                if self.step < SHORTEST:
                    self.status = Status.DIVERGED
                    break
                self._restart()
                continue
            residual = simulation.unbalanced()
            self.say(f"{self.steps} time steps, {residual:.1e} N of {simulation.load:.3g} N unbalanced")
            self.stepping.heed(residual)
            apart = self._apart() if simulation.true else np.inf
            if residual <= self.target and simulation.true and self._at_rest():
                self.status = Status.CONVERGED
                break
            if apart <= close:
                if self._approach():
                    break
                close = min(close, 0.1 * apart)
            self._adapt(residual)
        if self.status is not Status.CONVERGED:
            data.qpos[:] = self.good

    def approach_from_afar(self) -> bool:
        """Whether ``approach`` reaches equilibrium from here, with chains laid out for the pulls to expect."""
        self.simulation.residual()
        self.simulation.lay(self.simulation.expected_pulls())
        return self._approach()

    def nudge(self, direction: Float[np.ndarray, " free"]) -> None:
        """Give the platform a small velocity along an unstable direction, as any disturbance would."""
        simulation = self.simulation
        self.stepping.stiffen()
        velocity = direction * (-1 if direction.sum() < 0 else 1) * 1e-3 * self.swing * simulation.rest_lengths.max()
        simulation.data.qvel[:] = simulation.in_dofs(velocity)

    def _approach(self) -> bool:
        """Whether ``approach`` reaches equilibrium, which then is the next and last state of the motion."""
        equilibria, taken = approach(self.simulation, self.target, MOST_APPROACHES - self.approaches)
        self.approaches += taken
        if equilibria:
            self.status = Status.CONVERGED
            self._went_on(self.longest / self.swing)
        return equilibria

    def _advance(self) -> None:
        self._went_on(self.stepping.advance(self.step / self.swing))

    def _went_on(self, time: float) -> None:
        """Record one step of that duration [s]."""
        self.steps, self.time = self.steps + 1, self.time + time
        if self.frames is not None:
            self._film(self.frames)

    def _film(self, frames: Frames) -> None:
        """Record the present state."""
        frames.append((self.time, *self.simulation.seen()))

    def _restart(self) -> None:
        """Restart from the last good coordinates, in shorter steps."""
        self.simulation.reset()
        self.simulation.data.qpos[:] = self.good
        self.step *= 0.3
        self.best, self.patience = np.inf, 0
        self.stepping.soften()

    def _adapt(self, residual: float) -> None:
        """Adapt steps and damping to this residual: longer steps and less damping with progress, else the opposite."""
        better, slow = residual < BETTER * self.best, self._slow()
        self.best, self.patience = (residual, 0) if better or slow else (self.best, self.patience + 1)
        if better:
            self.good = self.simulation.data.qpos.copy()
        if better or slow:
            self.step = min(1.2 * self.step, self.longest)
            self.ratio = max((0.9 if slow else 0.95) * self.ratio, LEAST_DAMPING)
        if self.patience > PATIENCE:
            if self.ratio == MOST_DAMPING:
                self.step = max(0.6 * self.step, SHORTEST)
            self.ratio = min(3 * self.ratio, MOST_DAMPING)
            self.best, self.patience = residual, 0
        self._damp()

    def _damp(self) -> None:
        """Damp the platform by the present ratio."""
        simulation = self.simulation
        simulation.model.dof_damping[: simulation.free] = 2 * self.ratio * self.swing * simulation.inertia

    def _slow(self) -> bool:
        """Whether force and velocity point the same way as before: only damping slows the platform."""
        simulation = self.simulation
        root = np.sqrt(simulation.inertia)
        force = simulation.net[: simulation.free] / root
        velocity, before = simulation.data.qvel[: simulation.free] * root, self.velocity
        self.velocity = velocity

        def parallel(a: np.ndarray, b: np.ndarray) -> bool:
            return bool(a @ b > ALONG * np.sqrt(a @ a * (b @ b)))

        return parallel(force, velocity) and parallel(velocity, before)

    def _at_rest(self) -> bool:
        """Whether the platform is in equilibrium, with forces evaluated again at zero velocity."""
        simulation, data = self.simulation, self.simulation.data
        speed = np.abs(data.qvel[: simulation.free])
        speed[simulation.angular] *= simulation.length
        velocity = data.qvel.copy()
        if speed.max() <= self.speed and simulation.residual() <= self.target:
            return True
        data.qvel[:] = velocity
        return False

    def _apart(self) -> float:
        """Unbalanced forces, as fractions of the load and of each chain's weight."""
        simulation = self.simulation
        platform, slides = simulation.forces()
        apart = (np.abs(slides) / simulation.weights[:, None]).max()
        return float(apart if simulation.held else max(apart, np.abs(platform).max() / simulation.load))

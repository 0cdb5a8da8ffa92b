"""One time step of platforms on cables with mass, implicit in all stiff forces.

A spring acts with its force at the step's end, since a taut tendon is damped by as much as its spring gains in the
step; the same holds for the transverse stiffness of a taut string.

A loose chain, whose path is not longer than its rest length, is a row of nearly rigid links, which a time step cannot
move without stretching them. While its profile is still wrong, it may therefore stretch by a hundredth under its own
weight; then its stiffness grows from step to step up to the true one.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from jaxtyping import Float

from cdpr_sim.physics.chains import plucked
from cdpr_sim.physics.sagging.chain_simulations import POSITIONS, VELOCITIES, ChainSimulations, Rows

PASSAGE = 0.2
"""Largest change in a step of a chain's distance from being just taut, as a fraction of it."""

NEAREST = 1e-9
"""Lower bound of that distance, as a fraction of the length."""

SOFT, GROWTH, STIFF = 100.0, 1.3, 1e100
"""Initial axial stiffness of a loose chain, in its weight; its growth in a step; and an upper bound."""

CALM = 0.05
"""While a larger fraction of the load is unbalanced, or on a chain of its weight, its stiffness does not grow."""

PLUCKED = 1.2
"""Fraction of a segment's transverse stiffness that a step assumes; below 0.5 a step would overshoot."""

GENTLE, LEAST_PULL = 0.1, 1e-3
"""With less than this fraction of a chain's weight unbalanced, each segment's transverse stiffness is that of its own
tension, or at least of this fraction of the chain's largest; before, it is that of the largest."""


class Stepping:
    """Time steps of platforms, with the present stiffness of their loose chains.

    Args:
        simulations: the platforms.
        longest: longest time step of each row that will be used, (rows,) [s].
        ahead: part of a step after which a spring's force acts; from a half on, steps are stable.
        cable_damping: damping of springs, as a multiple of their stiffness, if that is more [s].
    """

    def __init__(
        self,
        simulations: ChainSimulations,
        longest: Float[np.ndarray, " rows"],
        *,
        ahead: float = 1.0,
        cable_damping: float = 0.0,
    ) -> None:
        self.simulations, self.longest, self.ahead, self.cable_damping = simulations, longest, ahead, cable_damping
        chains = simulations.chains
        shape = rows, count = len(longest), len(chains.cables)
        self.rates, self.turning = np.zeros(shape), bool(chains.over.any())
        self.loose, self.softness, self.pulls = np.zeros(shape, dtype=bool), np.zeros(shape), np.zeros(shape)
        self.calm, self.gentle = np.ones(rows, dtype=bool), np.zeros(rows, dtype=bool)
        self.segment_lengths, self.stiffness = np.zeros((2, rows, count, chains.segments.shape[1]))
        self.prepare(simulations.all)

    def prepare(self, at: Rows) -> None:
        """Begin anew from the present coordinates: with these springs, and soft where a chain is loose now."""
        simulations = self.simulations
        self.measure(at)
        simulations.batch.forward(at, stage=POSITIONS)
        loose = simulations.chords(at) <= simulations.rest_lengths[at][:, simulations.chains.cables]
        self.loose[at] = loose & (simulations.weights[at] > 0)
        self.soften(at)

    def measure(self, at: Rows) -> None:
        """Take over the models' rest lengths and springs."""
        simulations = self.simulations
        self.segment_lengths[at] = simulations.chains.rest_lengths(simulations.bands[at])
        self.stiffness[at] = simulations.springs[at][:, simulations.chains.segments] * self.segment_lengths[at]

    def soften(self, at: Rows) -> None:
        """Let chains stretch that were loose at first."""
        self.softness[at] = np.where(self.loose[at], SOFT, STIFF)

    def stiffen(self, at: Rows) -> None:
        """Give all chains their true stiffness: their profiles are right already."""
        self.softness[at] = STIFF

    def begin(self, at: Rows) -> None:
        """Begin at zero velocity, without a known residual."""
        self.pulls[at] = 0
        self.calm[at], self.gentle[at] = True, False

    def adapt_to(self, at: Rows, residual: Float[np.ndarray, " some"]) -> None:
        """Choose the next steps by these unbalanced forces [N]."""
        simulations = self.simulations
        self.calm[at] = residual < CALM * simulations.load[at]
        self.gentle[at] = simulations.true(at) & (residual < GENTLE * simulations.weights[at].max(1))

    def advance(
        self,
        at: Rows,
        longest: Float[np.ndarray, " some"],
        wind: Callable[[Float[np.ndarray, " some"]], None] = lambda step: None,
    ) -> Float[np.ndarray, " some"]:
        """One time step, at most that long [s]; returns its duration in each row.

        ``wind`` is called with the durations, before forces are computed: winches may let cables out.
        """
        simulations, chains = self.simulations, self.simulations.chains
        if self.turning:  # a wheel that lags behind its chain excites it
            simulations.turn_wheels(at)
        grows = self.calm[at, None] & (np.abs(simulations.forces(at)[1]).max(2) <= simulations.weights[at])
        simulations.batch.forward(at, stage=VELOCITIES)
        simulations.hold_ropes(at)
        free = simulations.free_lengths(at)
        with np.errstate(divide="ignore", invalid="ignore"):  # no limit for a coordinate without velocity
            step = self._time_step(at, longest, free)
        simulations.timestep[at] = step
        wind(step)
        weights, stiffness, segments = simulations.weights[at], self.stiffness[at], (at[:, None, None], chains.segments)
        most = np.where(self.loose[at], self.softness[at] * weights, np.inf)
        soft = np.minimum(most[..., None], stiffness)
        true = soft == stiffness
        simulations.stiffnesses[segments] = np.where(
            true, simulations.springs[segments], soft / self.segment_lengths[at]
        )
        simulations.further[segments] = np.where(true[..., None], simulations.polynomials[segments], 0.0)
        self.softness[at] = np.where(grows, np.minimum(GROWTH * self.softness[at], STIFF), self.softness[at])
        every = at[:, None], simulations.tendons
        stretch = np.maximum(simulations.ten_length[every] - simulations.bands[(*every, 1)], 0)
        further = stretch[..., None] ** [1, 2] * simulations.further[every]
        secant = simulations.stiffnesses[every] + further.sum(2)
        tangent = simulations.stiffnesses[every] + (further * [2, 3]).sum(2)
        simulations.tendon_damping[every] = np.where(stretch > 0, self.lag(step)[:, None] * tangent, 0)
        pulls = (stretch * secant)[:, : chains.segments.size].reshape(soft.shape)
        self.pulls[at] = pulls.max(2)
        largest = np.maximum(self.pulls[at], weights)[..., None]
        tension = np.where(self.gentle[at, None, None], np.maximum(pulls, LEAST_PULL * largest), largest)
        resisting = plucked(self.longest[at, None, None], PLUCKED * tension, free)
        simulations.damping[at[:, None, None, None], chains.dofs] = resisting[..., :0:-1, None]
        simulations.tendon_damping[at[:, None, None], chains.brakes] = resisting[..., :1]
        simulations.step(at)
        return step

    def lag(self, step: Float[np.ndarray, " some"]) -> Float[np.ndarray, " some"]:
        """Time after the beginning of a step at which springs act [s]."""
        return np.maximum(self.ahead * step, self.cable_damping)

    def _time_step(
        self, at: Rows, longest: Float[np.ndarray, " some"], free: Float[np.ndarray, "some chains segments"]
    ) -> Float[np.ndarray, " some"]:
        """[s] Short enough for chains that change between loose and taut, and for segments that rotate.

        As a chain becomes taut, its tension rises from its weight to EA within a strain of (weight/EA)^(2/3). A segment
        that rotates by an angle in a step is stretched by half its square, which must not exceed its present strain.
        """
        simulations, chains = self.simulations, self.simulations.chains
        weights, velocity = simulations.weights[at], simulations.ten_velocity[at]
        rest = simulations.rest_lengths[at][:, chains.cables]
        most = np.where(self.loose[at], self.softness[at] * weights, np.inf)
        stiffness = np.minimum(self.stiffness[at, :, 0], most)
        near = np.maximum((weights / stiffness) ** (2 / 3), NEAREST) * rest
        passage = (
            PASSAGE
            * np.maximum(np.abs(simulations.chords(at) - rest), near)
            / np.abs(velocity[:, chains.chords] - self.rates[at])
        )
        strains = np.maximum(self.pulls[at], weights) / stiffness
        slides = simulations.qvel[at][:, chains.dofs][:, :, ::-1]
        extending = np.concatenate([velocity[:, chains.brakes][:, :, None], slides], axis=2)
        turning = np.sqrt(np.maximum((extending**2).sum(3) - velocity[:, chains.segments] ** 2, 0))
        turns = np.sqrt(2 * np.maximum(strains, NEAREST**2))[..., None] * free / turning
        shortest = np.fmin(
            np.fmin.reduce(passage, axis=1, initial=np.inf), np.fmin.reduce(turns, (1, 2), initial=np.inf)
        )
        return np.fmin(longest, shortest)

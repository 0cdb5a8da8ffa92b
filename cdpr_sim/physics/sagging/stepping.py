"""One time step of a platform on cables with mass, implicit in all stiff forces.

A spring acts with its force at the step's end, since a taut tendon is damped by as much as its spring gains in the
step; the same holds for the transverse stiffness of a taut string.

A slack chain is a row of nearly rigid links, which a time step cannot move without stretching them. While its profile
is still wrong, it may therefore stretch by a hundredth under its own weight; then its stiffness grows from step to step
up to the true one.
"""

# pyright: reportAttributeAccessIssue=false
# mujoco ships no type stubs for its compiled modules.
from __future__ import annotations

from collections.abc import Callable

import mujoco
import numpy as np

from cdpr_sim.physics.chains import plucked
from cdpr_sim.physics.sagging.chain_simulation import ChainSimulation

PASSAGE = 0.2
"""Largest change in a step of a chain's distance from being just taut, as a fraction of it."""

NEAREST = 1e-9
"""Lower bound of that distance, as a fraction of the length."""

SOFT, GROWTH, STIFF = 100.0, 1.3, 1e100
"""Initial axial stiffness of a slack chain, in its weight; its growth in a step; and an upper bound."""

CALM = 0.05
"""While a larger fraction of the load is unbalanced, or on a chain of its weight, its stiffness does not grow."""

PLUCKED = 1.2
"""Fraction of a segment's transverse stiffness that a step assumes; below 0.5 a step would overshoot."""

GENTLE, LEAST_PULL = 0.1, 1e-3
"""With less than this fraction of a chain's weight unbalanced, each segment's transverse stiffness is that of its own
tension, or at least of this fraction of the chain's largest; before, it is that of the largest."""


class Stepping:
    """Time steps of a platform, with the present stiffness of its slack chains.

    Args:
        simulation: the platform.
        longest: longest time step that will be used [s].
        ahead: part of a step after which a spring's force acts; from a half on, steps are stable.
        cable_damping: damping of springs, as a multiple of their stiffness, if that is more [s].
    """

    def __init__(
        self, simulation: ChainSimulation, longest: float, *, ahead: float = 1.0, cable_damping: float = 0.0
    ) -> None:
        self.simulation, self.longest, self.ahead, self.cable_damping = simulation, longest, ahead, cable_damping
        chains, model = simulation.chains, simulation.model
        self.rates, self.turning = np.zeros(len(chains.cables)), bool(chains.over.any())
        self.measure()
        mujoco.mj_fwdPosition(model, simulation.data)
        self.slack = (simulation.chords <= simulation.rest_lengths[chains.cables]) & (simulation.weights > 0)
        self.soften()

    def measure(self) -> None:
        """Take over the model's rest lengths and springs."""
        simulation = self.simulation
        self.segment_lengths = simulation.chains.rest_lengths(simulation.model)
        self.stiffness = simulation.springs[simulation.chains.segments] * self.segment_lengths

    def soften(self) -> None:
        """Let chains stretch that were slack at first."""
        self.softness = np.where(self.slack, SOFT, STIFF)

    def stiffen(self) -> None:
        """Give all chains their true stiffness: their profile is right already."""
        self.softness[:] = STIFF

    def begin(self) -> None:
        """Begin at zero velocity, without a known residual."""
        self.pulls = np.zeros(len(self.slack))
        self.calm, self.gentle = True, False

    def heed(self, residual: float) -> None:
        """Choose the next steps by this unbalanced force [N]."""
        simulation = self.simulation
        self.calm = residual < CALM * simulation.load
        self.gentle = simulation.true and residual < GENTLE * simulation.weights.max()

    def advance(self, longest: float, wind: Callable[[float], None] = lambda step: None) -> float:
        """One time step, at most that long [s]; returns its duration.

        ``wind`` is called with the duration of the step, before its forces are computed: winches may let cables out.
        """
        simulation, model, data, weights = (
            self.simulation,
            self.simulation.model,
            self.simulation.data,
            self.simulation.weights,
        )
        chains = simulation.chains
        if self.turning:  # a wheel that lags behind its chain excites it
            simulation.turn_wheels()
        mujoco.mj_step1(model, data)
        simulation.hold_ropes()
        self.free = chains.free(model, data)
        with np.errstate(divide="ignore", invalid="ignore"):  # no limit for a coordinate without velocity
            model.opt.timestep = step = self._time_step(longest)
        wind(step)
        soft = np.where(
            self.slack[:, None], np.minimum((self.softness * weights)[:, None], self.stiffness), self.stiffness
        )
        true = soft == self.stiffness
        model.tendon_stiffness[chains.segments] = np.where(
            true, simulation.springs[chains.segments], soft / self.segment_lengths
        )
        model.tendon_stiffnesspoly[chains.segments] = np.where(
            true[..., None], simulation.polynomials[chains.segments], 0.0
        )
        _, left_over = simulation.forces()
        grows = self.calm & (np.abs(left_over).max(1) <= weights)
        self.softness = np.where(grows, np.minimum(GROWTH * self.softness, STIFF), self.softness)
        stretch = np.maximum(data.ten_length - model.tendon_lengthspring[:, 1], 0)[simulation.tendons]
        further = stretch[:, None] ** [1, 2] * model.tendon_stiffnesspoly[simulation.tendons]
        secant = model.tendon_stiffness[simulation.tendons] + further.sum(1)
        tangent = model.tendon_stiffness[simulation.tendons] + (further * [2, 3]).sum(1)
        model.tendon_damping[simulation.tendons] = np.where(stretch > 0, self.lag(step) * tangent, 0)
        pulls = (stretch * secant)[: chains.segments.size].reshape(soft.shape)
        self.pulls = pulls.max(1)
        largest = np.maximum(self.pulls, weights)[:, None]
        tension = np.maximum(pulls, LEAST_PULL * largest) if self.gentle else largest
        resisting = plucked(self.longest, PLUCKED * tension, self.free)
        model.dof_damping[chains.dofs] = resisting[:, :0:-1, None]
        model.tendon_damping[chains.brakes] = resisting[:, :1]
        mujoco.mj_passive(model, data)
        mujoco.mj_step2(model, data)
        return step

    def lag(self, step: float) -> float:
        """Time after the beginning of a step at which springs act [s]."""
        return max(self.ahead * step, self.cable_damping)

    def _time_step(self, longest: float) -> float:
        """[s] Short enough for chains that change between slack and taut, and for segments that rotate.

        As a chain becomes taut, its tension rises from its weight to EA within a strain of (weight/EA)^(2/3). A segment
        that rotates by an angle in a step is stretched by half its square, which must not exceed its present strain.
        """
        simulation, data, chains, weights = (
            self.simulation,
            self.simulation.data,
            self.simulation.chains,
            self.simulation.weights,
        )
        rest = simulation.rest_lengths[chains.cables]
        stiffness = np.minimum(self.stiffness[:, 0], np.where(self.slack, self.softness * weights, np.inf))
        near = np.maximum((weights / stiffness) ** (2 / 3), NEAREST) * rest
        passage = (
            PASSAGE
            * np.maximum(np.abs(simulation.chords - rest), near)
            / np.abs(data.ten_velocity[chains.chords] - self.rates)
        )
        strains = np.maximum(self.pulls, weights) / stiffness
        extending = np.concatenate([data.ten_velocity[chains.brakes][:, None], data.qvel[chains.dofs][:, ::-1]], axis=1)
        turning = np.sqrt(np.maximum((extending**2).sum(2) - data.ten_velocity[chains.segments] ** 2, 0))
        turns = np.sqrt(2 * np.maximum(strains, NEAREST**2))[:, None] * self.free / turning
        return float(min(np.nanmin(passage, initial=longest), np.nanmin(turns, initial=longest)))

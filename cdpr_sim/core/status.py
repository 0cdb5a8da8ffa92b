"""Outcome of a search for equilibrium: one enum for both methods."""

from __future__ import annotations

import enum

from cdpr_sim.core.cable import MOST_STRAIN

NEUTRAL = 1e-9
"""Eigenvalues smaller than this fraction of the largest are rounding: that direction is neutrally stable."""


ACCEPTABLE = 1e-6
"""Largest unbalanced force of an equilibrium, as a fraction of the load, whatever the rounding."""

IDLE_STRAIN = 1e-3
"""Without load, the scale of forces is the one that strains the mean cable by this much."""


class Status(enum.IntEnum):
    """Outcome of a solve or a settling; ``sentence`` describes it."""

    PENDING = -1
    CONVERGED = 0
    ITERATION_LIMIT = 1
    STALLED = 2
    NOT_FINITE = 3
    FALLS = 4
    DIVERGED = 5
    MOVING = 6
    OVERSTRAINED = 7
    OFF_WHEEL = 8
    TOO_SHORT = 9

    @property
    def sentence(self) -> str:
        """Meaning of the status."""
        return _SENTENCES[self]


_SENTENCES = {
    Status.PENDING: "not computed yet",
    Status.CONVERGED: "forces balance",
    Status.ITERATION_LIMIT: "no equilibrium was reached within the allowed iterations or time steps",
    Status.STALLED: "no step lowers the energy any more, but forces do not balance to tolerance",
    Status.NOT_FINITE: "the input is not finite, or a cable is shorter than rounding",
    Status.FALLS: "every exit lies below the platform, which falls since cables cannot push",
    Status.DIVERGED: "the simulation in MuJoCo became unstable",
    Status.MOVING: "the platform is moving",
    Status.OVERSTRAINED: f"a cable is strained by more than {MOST_STRAIN:.0%}, beyond the range of its nonlinear law",
    Status.OFF_WHEEL: "a cable leaves its pulley's wheel",
    Status.TOO_SHORT: "a cable with mass is so short that the first mass of its chain in MuJoCo could touch its wheel",
}

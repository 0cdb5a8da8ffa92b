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

    sentence: str

    def __new__(cls, number: int, sentence: str) -> Status:
        """A member of this number."""
        member = int.__new__(cls, number)
        member._value_, member.sentence = number, sentence
        return member

    PENDING = -1, "not computed yet"
    CONVERGED = 0, "forces balance"
    ITERATION_LIMIT = 1, "no equilibrium was reached within the allowed iterations or steps"
    STALLED = 2, "no step lowers the energy any more, but forces do not balance to tolerance"
    NOT_FINITE = 3, "the input is not finite, or a cable is shorter than rounding"
    FALLS = 4, "every exit lies below the platform, which falls since cables cannot push"
    DIVERGED = 5, "the simulation in MuJoCo became unstable"
    MOVING = 6, "the platform is moving"
    OVERSTRAINED = 7, f"a cable is strained by more than {MOST_STRAIN:.0%}, beyond the range of its nonlinear law"
    OFF_WHEEL = 8, "a cable leaves its pulley's wheel"
    TOO_SHORT = (
        9, "a cable with mass is so short that the first mass of its chain in MuJoCo could touch its wheel"
    )  # fmt: skip
    NO_PRETENSION = 10, "no tensions near the pretension, within their limits, balance the weight"

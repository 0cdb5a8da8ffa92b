"""How looking for rest ended: one enum for both methods."""

from __future__ import annotations

import enum

from cdpr_sim.core.cable import MOST_STRAIN

NEUTRAL = 1e-9
"""Eigenvalues smaller than this fraction of the largest are rounding: that direction is neither held nor repelled."""


ACCEPTABLE = 1e-6
"""Forces never count as balanced with more than this fraction of the load left over, whatever the rounding."""

IDLE_STRAIN = 1e-3
"""Without load, forces are compared with what strains the mean cable by this much."""


class Status(enum.IntEnum):
    """How a solve or a settling ended; ``sentence`` says it in words."""

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

    @property
    def sentence(self) -> str:
        """What the status means."""
        return _SENTENCES[self]


_SENTENCES = {
    Status.PENDING: "not computed yet",
    Status.CONVERGED: "forces balance at rest",
    Status.ITERATION_LIMIT: "it did not come to rest within the iterations or time steps that it is given",
    Status.STALLED: "no step lowers the energy any more, but forces do not balance to tolerance",
    Status.NOT_FINITE: "the input is not finite, or a cable is shorter than rounding",
    Status.FALLS: "every exit lies below the platform, which falls since cables cannot push",
    Status.DIVERGED: "MuJoCo found its motion unstable",
    Status.MOVING: "the platform is on its way, and not at rest",
    Status.OVERSTRAINED: f"a cable is strained by more than {MOST_STRAIN:.0%}, up to which its nonlinear law is given",
    Status.OFF_WHEEL: "a cable leaves its pulley's wheel",
}

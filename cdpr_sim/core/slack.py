"""The definition of a slack cable, for all cables and both methods.

A cable is slack if it is not stretched, and pulls the platform by at most its own weight w l0, or at most 1 % of the
platform's weight m g, whichever is more (``slack_limits``). Not stretched: its path from exit to anchor is not longer
than its rest length.

A slack cable thus does no more for the platform than a rope does that hangs from it. A cable without mass that is not
stretched has no tension: the paper's definition (Eq. 10, 11). One with mass may carry much and be longer than its path:
a catenary. Between two points at one height, a catenary that pulls at its ends by its own weight is inclined by 30°
there, its sag is (2/sqrt(3) − 1)/ln 3 = 0.141 of its span, and it is 5 % longer than that (Irvine, Cable Structures,
1981, chapter 1: H = w l0 sqrt(3)/2). A rope with more tension sags less. Without the share of the platform's weight,
the limit would vanish with the mass of the cable, and a cable that is a little longer than its path would count as taut
however light it is, with a tension of 1e-9 N, while the same cable without mass is slack.

The proof states the same definition in ball arithmetic (``proof.cables``). Solvers do not use it: a law has its kink
where a cable without mass is just not stretched, and none in one with mass.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float

from cdpr_sim.core.problem import Problem, Problems

SHARE = 0.01
"""Fraction of the platform's weight by which a cable may pull and be slack: 100 such cables carry the platform."""


def slack_limits(problem: Problem | Problems) -> Float[np.ndarray, "*batch cables"]:
    """Largest pulls on the platform, all parts of line together, with which cables may be slack, (..., cables) [N]."""
    platforms = np.asarray(problem.mass)[..., None] * problem.robot.gravity
    return np.maximum(problem.cable_weights * problem.robot.cabling.ropes(problem.rest_lengths), SHARE * platforms)


def slack_cables(
    problem: Problem | Problems,
    lengths: Float[np.ndarray, "*batch cables"],
    tensions: Float[np.ndarray, "*batch cables"],
) -> Bool[np.ndarray, "*batch cables"]:
    """Which cables are slack, (..., cables).

    Args:
        problem: the problem, or those of all rows.
        lengths: of the paths from exit to anchor, (..., cables) [m].
        tensions: of the ropes, at their anchors, (..., cables) [N].
    """
    # A cable without mass is not stretched if it has no tension; with a memory, its unstretched length is not l0.
    idle = tensions <= 0
    if problem.robot.cabling.massless:
        return idle
    light = problem.robot.cabling.pulls(tensions) <= slack_limits(problem)
    return np.where(problem.cable_weights > 0, (lengths <= problem.rest_lengths) & light, idle)

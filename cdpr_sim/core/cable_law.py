"""The cable law: tension, energy and stiffness of a stretched cable. The mathematics has this one coding of it.

A cable is a spring that only pulls (paper Eq. 10, 11), and its elasticity may be nonlinear: with the strain eps = s/l0
of a stretch s = l − l0,

    tau = EA (eps + a2 eps² + a3 eps³)   for s > 0,   else 0.

A law with a2 or a3 is defined up to a strain of 20 % (``cable.MOST_STRAIN``), and no equilibrium is accepted beyond it
(``Cabling.beyond_law``). These functions continue it linearly there: with a decreasing polynomial, a search for
equilibrium could diverge. A *law* is one value, (EA, a2, a3). The functions work on arrays and, compiled, on numbers
alike.
"""

from __future__ import annotations

import numpy as np

from cdpr_sim.core.cable import MOST_STRAIN as M
from cdpr_sim.core.cable import STIFFNESS
from cdpr_sim.core.compiling import for_kernels, inline

STRAIN_STEPS = 30
"""Largest number of Newton steps to the strain of a given tension; five or fewer suffice."""


def of_table(table):
    """The laws in rows of ``Robot.cable_table``, (..., columns), of all parts of line together: EA [N], a2, a3."""
    return at(np.moveaxis(table, -1, 0), STIFFNESS, 1)


@inline
def at(numbers, first, step):
    """The law whose numbers are in an array, at ``first`` and at steps from there."""
    return numbers[first], numbers[first + step], numbers[first + 2 * step]


@for_kernels(lambda law: law[1] == 0.0 and law[2] == 0.0, forceinline=True)
def linear(law):
    """Whether a law, or all of many, is proportional."""
    return not (np.any(law[1]) or np.any(law[2]))


@inline
def stiffens(law):
    """Whether the slope of a law never falls."""
    return law[1] >= 0.0 and law[2] >= 0.0


def tension(stretch, rest_length, law):
    """tau [N]: tension of a cable, which pulls and never pushes (Eq. 10, 11).

    ``rest_length``, here and below, is all that shares the stretch: l0, and with it ``Cabling.behind``.
    """
    pulled = np.maximum(stretch, 0.0)
    proportional = law[0] * pulled / rest_length
    if linear(law):
        return proportional
    return proportional + law[0] * stiffened(pulled / rest_length, law)


def largest_tension(law):
    """Tension up to which a law is defined [N]: infinite for a linear law."""
    return np.where((law[1] != 0) | (law[2] != 0), tension(M, 1.0, law), np.inf)


@inline
def energy(stretch, rest_length, law):
    """∫ tau ds [J]."""
    EA, a2, a3 = law
    pulled = np.maximum(stretch, 0.0)
    curved = np.minimum(pulled / rest_length, M)
    over = pulled / rest_length - curved
    more = curved * curved * (curved * (a2 / 3.0 + curved * (0.25 * a3)) + over * (a2 + curved * a3))
    more = more + 0.5 * over * over * (curved * (2.0 * a2 + curved * (3.0 * a3)))
    return 0.5 * (EA / rest_length * (pulled * pulled)) + EA * rest_length * more


@inline
def tangent(stretch, rest_length, law):
    """(k, e): the linear spring k max(e, 0) that has the law's tension and slope at this stretch [N/m, m].

    For a slack cable, the spring at the beginning of its stretch.
    """
    EA, a2, a3 = law
    strain = np.maximum(stretch, 0.0) / rest_length
    curved = np.minimum(strain, M)
    slope = 1.0 + curved * (2.0 * a2 + curved * (3.0 * a3))
    return EA / rest_length * slope, (stretch + rest_length * stiffened(strain, law)) / slope


@inline
def stiffened(strain, law):
    """tau/EA − eps, the nonlinear part of the law, for eps >= 0."""
    _, a2, a3 = law
    curved = np.minimum(strain, M)
    return curved * curved * (a2 + curved * a3) + (strain - curved) * (curved * (2.0 * a2 + curved * (3.0 * a3)))


def strain_at(tension, law):
    """eps under the tension tau >= 0 [N]: the inverse of the law."""
    return 1 / rest_length_for(1.0, tension, law) - 1


def rest_length_for(length, pull, law, behind: float | np.ndarray = 0.0):
    """l0 = (l − eps c)/(1 + eps): unstretched length of a cable that has length l under the tension ``pull`` (Eq. 10).

    A length c ``behind`` the exit stretches with it.
    """
    if linear(law):
        return (length * law[0] - behind * pull) / (law[0] + pull)
    law, pull = (1.0, *law[1:]), pull / law[0]
    strain = pull
    for _ in range(STRAIN_STEPS):
        slope, _ = tangent(strain, 1.0, law)
        strain = strain - (tension(strain, 1.0, law) - pull) / slope
    return (length - strain * behind) / (1.0 + strain)

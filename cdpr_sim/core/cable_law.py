"""The cable law: tension, energy and stiffness of a stretched cable. The mathematics has this one coding of it.

A cable is a spring that only pulls (paper Eq. 10, 11), and its elasticity may be nonlinear: with the strain eps = s/l0
of a stretch s = l − l0,

    tau = EA (eps + a2 eps² + a3 eps³)   for s > 0,   else 0.

A law with a2 or a3 is defined up to a strain of 20 % (``cable.MOST_STRAIN``), and no equilibrium is accepted beyond it
(``Cabling.beyond_law``). These functions continue it linearly there: with a decreasing polynomial, a search for
equilibrium could diverge. The functions work on arrays and, compiled, on numbers alike.
"""

from __future__ import annotations

import numpy as np

from cdpr_sim.core.cable import MOST_STRAIN as M
from cdpr_sim.core.compiling import inline

STRAIN_STEPS = 30
"""Largest number of Newton steps to the strain of a given tension; five or fewer suffice."""


def tension(stretch, rest_length, axial_stiffness, a2, a3):
    """tau [N]: tension of a cable, which pulls and never pushes (Eq. 10, 11).

    ``rest_length``, here and below, is all that shares the stretch: l0, and with it ``Cabling.behind``.
    """
    pulled = np.maximum(stretch, 0.0)
    linear = axial_stiffness * pulled / rest_length
    if not (np.any(a2) or np.any(a3)):
        return linear
    return linear + axial_stiffness * stiffened(pulled / rest_length, a2, a3)


def largest_tension(axial_stiffness, a2, a3):
    """Tension up to which a law is defined [N]: infinite for a linear law."""
    return np.where((a2 != 0) | (a3 != 0), tension(M, 1.0, axial_stiffness, a2, a3), np.inf)


@inline
def energy(stretch, rest_length, axial_stiffness, a2, a3):
    """∫ tau ds [J]."""
    pulled = np.maximum(stretch, 0.0)
    curved = np.minimum(pulled / rest_length, M)
    over = pulled / rest_length - curved
    more = curved * curved * (curved * (a2 / 3.0 + curved * (0.25 * a3)) + over * (a2 + curved * a3))
    more = more + 0.5 * over * over * (curved * (2.0 * a2 + curved * (3.0 * a3)))
    return 0.5 * (axial_stiffness / rest_length * (pulled * pulled)) + axial_stiffness * rest_length * more


@inline
def tangent(stretch, rest_length, axial_stiffness, a2, a3):
    """(k, e): the linear spring k max(e, 0) that has the law's tension and slope at this stretch [N/m, m].

    For a slack cable, the spring at the beginning of its stretch.
    """
    strain = np.maximum(stretch, 0.0) / rest_length
    curved = np.minimum(strain, M)
    slope = 1.0 + curved * (2.0 * a2 + curved * (3.0 * a3))
    return axial_stiffness / rest_length * slope, (stretch + rest_length * stiffened(strain, a2, a3)) / slope


@inline
def stiffened(strain, a2, a3):
    """tau/EA − eps, the nonlinear part of the law, for eps >= 0."""
    curved = np.minimum(strain, M)
    return curved * curved * (a2 + curved * a3) + (strain - curved) * (curved * (2.0 * a2 + curved * (3.0 * a3)))


def rest_length_for(length, pull, axial_stiffness, a2, a3, behind: float | np.ndarray = 0.0):
    """l0 = (l − eps c)/(1 + eps): unstretched length of a cable that has length l under the tension ``pull`` (Eq. 10).

    A length c ``behind`` the exit stretches with it.
    """
    if not (np.any(a2) or np.any(a3)):
        return (length * axial_stiffness - behind * pull) / (axial_stiffness + pull)
    pull = pull / axial_stiffness
    strain = pull
    for _ in range(STRAIN_STEPS):
        slope, _ = tangent(strain, 1.0, 1.0, a2, a3)
        strain = strain - (tension(strain, 1.0, 1.0, a2, a3) - pull) / slope
    return (length - strain * behind) / (1.0 + strain)

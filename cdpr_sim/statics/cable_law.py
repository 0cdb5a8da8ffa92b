"""The law of a cable: its tension, energy and stiffness when it is stretched. Written here once for the mathematics.

A cable is a spring that only pulls (paper Eq. 10, 11), and may stiffen as it is pulled: with the strain eps = s/l0 of a
stretch s = l − l0,

    tau = EA (eps + a2 eps² + a3 eps³)   for s > 0,   else 0.

The functions work on arrays and, compiled, on numbers alike. Compiled code measures per metre of cable: a cable of rest
length l0, axial stiffness EA and coefficients a2, a3 is one of rest length 1 with EA/l0, a2/l0 and a3/l0², and the same
stretch.
"""

from __future__ import annotations

import numpy as np

STRAIN_STEPS = 30
"""Newton steps to the strain of a given tension; a handful do."""


def tension(stretch, rest_length, axial_stiffness, a2, a3):
    """tau [N]: a cable pulls and never pushes (Eq. 10, 11)."""
    pulled = np.maximum(stretch, 0.0)
    strain = pulled / rest_length
    return axial_stiffness * pulled / rest_length * (1.0 + strain * (a2 + strain * a3))


def energy(stretch, rest_length, axial_stiffness, a2, a3):
    """∫ tau ds [J]."""
    pulled = np.maximum(stretch, 0.0)
    strain = pulled / rest_length
    return 0.5 * (axial_stiffness / rest_length * pulled**2) * (1.0 + strain * (a2 / 1.5 + strain * (0.5 * a3)))


def tangent(stretch, rest_length, axial_stiffness, a2, a3):
    """(k, e): the linear spring k max(e, 0) that has the law's tension and slope at this stretch [N/m, m].

    Of a slack cable, the spring that it becomes when it is stretched.
    """
    strain = np.maximum(stretch, 0.0) / rest_length
    slope = 1.0 + strain * (2.0 * a2 + strain * (3.0 * a3))
    return axial_stiffness / rest_length * slope, stretch * (1.0 + strain * (a2 + strain * a3)) / slope


def per_axial_stiffness(stretch, rest_length, a2, a3):
    """∂tau/∂EA of a taut cable."""
    strain = stretch / rest_length
    return strain * (1.0 + strain * (a2 + strain * a3))


def rest_length_for(length, tension, axial_stiffness, a2, a3):
    """l0 = l/(1 + eps): what a cable of length l under tension tau measures when nothing pulls (Eq. 10)."""
    if not (np.any(a2) or np.any(a3)):
        return length * axial_stiffness / (axial_stiffness + tension)
    pull = tension / axial_stiffness
    strain = pull
    for _ in range(STRAIN_STEPS):
        excess = strain * (1.0 + strain * (a2 + strain * a3)) - pull
        step = excess / (1.0 + strain * (2.0 * a2 + strain * (3.0 * a3)))
        strain = strain - step
    return length / (1.0 + strain)

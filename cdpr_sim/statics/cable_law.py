"""The law of a cable: its tension, energy and stiffness when it is stretched. Written here once for the mathematics.

A cable is a spring that only pulls (paper Eq. 10, 11): tau = EA s/l0 for a stretch s = l − l0 above zero, else 0.

The functions work on arrays and, compiled, on numbers alike. Compiled code measures per metre of cable: a cable of rest
length l0 and axial stiffness EA is one of rest length 1 and axial stiffness EA/l0, with the same stretch.
"""

from __future__ import annotations

import numpy as np


def tension(stretch, rest_length, axial_stiffness):
    """tau [N]: a cable pulls and never pushes (Eq. 10, 11)."""
    return axial_stiffness * np.maximum(stretch, 0.0) / rest_length


def energy(stretch, rest_length, axial_stiffness):
    """∫ tau ds [J]."""
    return 0.5 * (axial_stiffness / rest_length * np.maximum(stretch, 0.0) ** 2)


def tangent(stretch, rest_length, axial_stiffness):
    """(k, e): the linear spring k max(e, 0) that has the law's tension and slope at this stretch [N/m, m].

    Of a slack cable, the spring that it becomes when it is stretched.
    """
    return axial_stiffness / rest_length, stretch


def per_axial_stiffness(stretch, rest_length):
    """∂tau/∂EA of a taut cable."""
    return stretch / rest_length


def rest_length_for(length, tension, axial_stiffness):
    """l0 = l EA/(EA + tau): what a cable of length l under tension tau measures when nothing pulls (Eq. 10)."""
    return length * axial_stiffness / (axial_stiffness + tension)

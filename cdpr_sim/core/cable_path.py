"""The path of a cable from its exit to its anchor: how long it is, and its free piece. Geometry, without elasticity.

This is what a winch that believes in rigid cables knows (paper Eq. 1, 2), and hence part of the question that both
roads are asked: the rest lengths. Beyond that, the mathematics alone builds on it; MuJoCo has paths of its own.

Functions of coordinates work on arrays and, compiled, on numbers alike.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from cdpr_sim.core.cable import Cabling


def path(x, y, z):
    """Of a cable whose exit lies at (x, y, z) from its anchor, base frame [m]: (length, free piece, its length).

    The free piece runs from the anchor to the point where the cable leaves what guides it; a straight cable is free all
    the way. The cable pulls along it, and its direction turns as the anchor moves across it: as fast as at the end of a
    rod of its length.
    """
    length = np.sqrt(x * x + y * y + z * z)
    return length, x, y, z, length


def lengths(
    cabling: Cabling, positions: Float[np.ndarray, "*#batch 3"], rotations: Float[np.ndarray, "*#batch 3 3"]
) -> Float[np.ndarray, "*batch cables"]:
    """Length of each cable's path with the platform at these poses, (..., cables) [m] (paper Eq. 1, 2)."""
    a, b, c = cabling.anchors.T
    apart = []
    for i, exits in enumerate(cabling.exits.T):
        at, turn = np.asarray(positions)[..., i, None], rotations[..., i, :, None]
        # In the order in which SciPy's RigidTransform.apply adds: to the last bit the same, of one pose or of many.
        anchors = (turn[..., 1, :] * b + at) + (turn[..., 0, :] * a + turn[..., 2, :] * c)
        apart.append(exits - anchors)
    return path(*apart)[0]

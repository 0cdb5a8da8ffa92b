"""Warnings about implausible robots: millimetres for metres, a rope as soft as rubber, a platform as light as air."""

from __future__ import annotations

import math
import sys
import warnings
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from jaxtyping import Float

from cdpr_sim.core.cable import Cabling
from cdpr_sim.core.checks import positive
from cdpr_sim.core.errors import ImplausibleRobot

MOST_STRAIN = 0.05
"""Strain of cables under the weight alone; ropes of steel and of polymers break at 2 to 5 %, nylon at 20 %."""

LARGEST_FRAME = 1000.0
"""[m] The largest robot on cables, the FAST telescope, is 600 m across."""

LIGHTEST = 0.01
"""[kg/m³] A hundredth of air's density; with lengths in millimetres a platform has a billionth of its true density."""

OUTSIDE = 0.1
"""Fraction of the frame's diagonal: a commanded position further beside or above the frame is implausible.
Below the frame, the platform may hang as deep as its cables are long."""

LARGEST_DIAMETER = 0.2
"""[m] Diameter of a rope. The FAST telescope hangs on ropes of 46 mm; floating platforms are moored by ropes of about
this."""

_PACKAGE = str(Path(__file__).parents[1])


def implausibilities(
    cabling: Cabling,
    mass: float,
    weight: float,
    center_of_mass: Float[np.ndarray, "3"],
    platform_size: Float[np.ndarray, "3"],
    frame: Float[np.ndarray, "2 3"],
    workspace: Float[np.ndarray, "2 3"],
    planar: bool,
) -> Iterator[str]:
    """A sentence for each implausible property: the value found, and the value expected of most robots."""
    diagonal = math.dist(*frame)
    platform = float(np.linalg.norm(platform_size))
    density = mass / float(np.prod(platform_size))
    if diagonal > LARGEST_FRAME:
        yield f"found a frame of {diagonal:.4g} m across; are its lengths in millimetres?"
    elif density < LIGHTEST:
        yield f"found {mass:g} kg in a platform of {_box(platform_size)} m; are its lengths in millimetres?"
    if platform > diagonal > 0:
        yield f"found a platform of {_box(platform_size)} m in a frame of {_box(frame[1] - frame[0])} m"
    beyond = np.linalg.norm(np.maximum(np.abs(cabling.anchors) - platform_size / 2, 0), axis=1)
    if beyond.max() > platform:
        cable = int(np.argmax(beyond))
        yield (
            f"found the anchor of cable {cable + 1} {beyond[cable]:.3g} m outside the platform's box of "
            f"{_box(platform_size)} m; are its units the same?"
        )
    middle, margin = workspace.mean(0), 1e-6 * diagonal
    if ((middle < frame[0] - margin) | (middle > frame[1] + margin)).any():
        yield f"found a workspace around ({', '.join(f'{x:.4g}' for x in middle)}) m, outside the frame"
    strain = weight / float(cabling.pulls(cabling.axial_stiffness).sum())
    if strain > MOST_STRAIN:
        yield f"found cables that stretch by {strain:.0%} or more under a weight of {weight:.4g} N"
    below = weight > 0 and center_of_mass[2] < cabling.anchors[0, 2]
    if len(cabling) > 1 and not np.ptp(cabling.anchors, axis=0).any() and not (planar and below):
        yield "found all anchors in one point, about which the platform swings freely"


def checked_diameter(diameter: float) -> float:
    """The diameter of a rope [m], with a warning if no such rope exists.

    Raises:
        InvalidInput: not above 0.
    """
    diameter = positive("diameter", diameter, "m")
    if diameter > LARGEST_DIAMETER:
        warn(f"found a rope of {diameter:.4g} m in diameter; is it in millimetres?")
    return diameter


def warn(sentence: str) -> None:
    """Issue an ``ImplausibleRobot`` at the line outside this package that made the robot or commanded it."""
    frame, level = sys._getframe(1), 2
    while frame.f_back is not None and frame.f_code.co_filename.startswith(_PACKAGE):
        frame, level = frame.f_back, level + 1
    warnings.warn(sentence, ImplausibleRobot, stacklevel=level)


def _box(size: Float[np.ndarray, "3"]) -> str:
    return " × ".join(f"{edge:.4g}" for edge in size)

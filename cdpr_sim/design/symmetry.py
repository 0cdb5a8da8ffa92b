"""Symmetries of a layout about the vertical: half turn and mirrors, detected in a robot, or given and checked."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from cdpr_sim.core.cable import PROPERTIES, Cabling
from cdpr_sim.core.checks import listed, one_of
from cdpr_sim.core.errors import InvalidInput
from cdpr_sim.core.robot import Robot

SIGNS = {"half-turn": (-1.0, -1.0, 1.0), "mirror-x": (-1.0, 1.0, 1.0), "mirror-y": (1.0, -1.0, 1.0)}
"""Signs of the coordinates about the middle of the exits, and in the platform's frame."""

SAME = 1e-6
"""Tolerance of equal points, as a fraction of the robot's size."""


@dataclass(frozen=True)
class Symmetry:
    """One symmetry.

    Attributes:
        signs: of the coordinates, (3,).
        images: index of the cable that each cable is mapped to, (cables,).
    """

    signs: Float[np.ndarray, "3"]
    images: Int[np.ndarray, " cables"]


def group(robot: Robot, wanted: str | Sequence[str]) -> list[Symmetry]:
    """The group of symmetries of a robot, including the identity.

    Args:
        robot: the robot.
        wanted: "detected" for all that the robot has, "none", or names of ``SIGNS``.

    Raises:
        UnknownName: no such symmetry.
        InvalidInput: a symmetry that the robot does not have.
    """
    found = [Symmetry(np.ones(3), np.arange(robot.cables))]
    names = [wanted] if isinstance(wanted, str) else listed("symmetry", wanted, "a list of names")
    for name in names:
        one_of("symmetry", name, (*SIGNS, "detected", "none"))
    detected = "detected" in names
    for name in SIGNS if detected else [name for name in names if name != "none"]:
        symmetry, why = _of(robot, np.array(SIGNS[name]))
        if symmetry is not None:
            found.append(symmetry)
        elif not detected:
            raise InvalidInput(
                f"symmetry: found {name!r}, which {robot.name!r} does not have: {why}; expected another or 'none'"
            )
    if len(found) == 3:  # two of them make the third
        a, b = found[1:]
        found.append(Symmetry(a.signs * b.signs, b.images[a.images]))
    return found


def _of(robot: Robot, signs: np.ndarray) -> tuple[Symmetry | None, str]:
    """The symmetry, or why the robot does not have it."""
    size = float(np.ptp(robot.exits, axis=0).max()) or 1.0
    middle = np.append(robot.exits[:, :2].mean(0), 0.0)
    points = np.hstack([robot.exits - middle, robot.anchors])
    image = points * np.tile(signs, 2)
    distances = np.abs(image[:, None] - points[None]).max(-1)
    images = distances.argmin(1)
    far = distances.min(1)
    if far.max() > SAME * size or len(set(images)) < robot.cables:
        cable = int(far.argmax())
        return None, f"the image of cable {cable + 1} is {1e3 * far[cable]:.3g} mm from the nearest cable"
    numbers, axes = _properties(robot.cabling, "number"), _properties(robot.cabling, "axis")
    mirrored = axes * np.tile(signs, axes.shape[1] // 3)
    same = np.isclose(numbers, numbers[images]).all(1) & np.isclose(mirrored, axes[images]).all(1)
    if not same.all():
        return None, f"cable {int(np.argmin(same)) + 1} has other properties than its image"
    if np.abs(robot.center_of_mass * signs - robot.center_of_mass).max() > SAME * size:
        return None, "the centre of mass is not its own image"
    return Symmetry(signs, images), ""


def _properties(cabling: Cabling, image: str) -> Float[np.ndarray, "cables numbers"]:
    """Properties with this image, 0 where a cable has them without an effect."""
    named = [name for name, one in PROPERTIES.items() if one.image == image]
    each = [np.where(cabling.has(name), getattr(cabling, name).reshape(len(cabling), -1).T, 0.0).T for name in named]
    return np.hstack(each)

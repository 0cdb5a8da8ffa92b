"""Robots of cdpyr (Philipp Tempel), in the format of its marshmallow schema: JSON or YAML.

Frames are rotation matrices by rows, ``dcm``; a cable enters its pulley along the z axis of the frame anchor's ``dcm``
times the pulley's. Motion patterns with one or two translations are in the x-y plane, and gravity, which its files do
not contain, acts along their last translation.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import AliasPath, Field

from cdpr_sim.core.errors import InvalidInput
from cdpr_sim.robots.importers.documents import Matrix, Number, Part, Unbounded, Vector, as_model
from cdpr_sim.robots.importers.draft import Draft

TITLE = "cdpyr's JSON or YAML"
MARKS = {"kinematic_chains"}

LIGHTEST_MATERIAL = 100.0
"""A cable density above this value is in kg/m³, below it in kg/m: no rope is less dense than cork, or heavier than a
rail."""

PATTERNS: dict[tuple[int, int], tuple[str | None, bool]] = {
    (3, 3): (None, True),
    (3, 2): (None, True),
    (3, 0): (None, False),
    (2, 1): ("xy", True),
    (2, 0): ("xy", False),
}
"""For each (translations, rotations): the plane of a planar robot, and whether the platform rotates."""


_Row = tuple[Unbounded, Unbounded, Unbounded]
"""cdpyr writes infinity for a value that is not given."""


class _Pulley(Part):
    radius: Number
    dcm: Matrix | None = None


class _Anchor(Part):
    position: Vector
    dcm: Matrix | None = None
    pulley: _Pulley | None = None
    drivetrain: dict | None = None


class _Platform(Part):
    name: str = ""
    anchors: list[_Anchor]
    translations: int = Field(validation_alias=AliasPath("motion_pattern", "translation"))
    rotations: int = Field(validation_alias=AliasPath("motion_pattern", "rotation"))
    center_of_gravity: Vector = (0.0, 0.0, 0.0)
    mass: Matrix = Field(validation_alias=AliasPath("inertia", "linear"))
    inertia: tuple[_Row, _Row, _Row] | None = Field(None, validation_alias=AliasPath("inertia", "angular"))


class _Modulus(Part):
    elasticities: list[Number] | None = None
    viscosities: list[Any] | None = None


class _Cable(Part):
    diameter: Number
    modulus: _Modulus | None = None
    density: Unbounded | None = None


class _Chain(Part):
    frame_anchor: int = Field(ge=0)
    platform: int = Field(0, ge=0)
    platform_anchor: int = Field(ge=0)
    cable: int = Field(ge=0)


class _Linear(Part):
    position: Vector | None = None


class _Pose(Part):
    linear: _Linear | None = None


class _Robot(Part):
    name: str | None = None
    frame_anchors: list[_Anchor] = Field(validation_alias=AliasPath("frame", "anchors"))
    platforms: list[_Platform]
    cables: list[_Cable]
    kinematic_chains: list[_Chain] = Field(min_length=1)
    home_pose: _Pose | None = None


def read(document: Any, path: Path) -> Draft:
    """The robot of such a file.

    Raises:
        InvalidInput: something is missing or invalid, or there are several platforms.
    """
    file = as_model(_Robot, document)
    if len(file.platforms) != 1:
        raise InvalidInput(f"platforms: found {len(file.platforms)}, expected one")
    platform, notes = file.platforms[0], []
    pattern = (platform.translations, platform.rotations)
    if pattern not in PATTERNS:
        raise InvalidInput(
            f"platforms.0.motion_pattern: found {pattern[0]} translations and {pattern[1]} rotations, "
            "expected 3 and 3, 3 and 2, 3 and 0, 2 and 1, or 2 and 0"
        )
    if pattern == (3, 2):
        notes.append("The platform does not rotate about its own axis there; here it does.")
    plane, turns = PATTERNS[pattern]
    ends = [_picked("frame_anchor", file.frame_anchors, one.frame_anchor) for one in file.kinematic_chains]
    cables = [_picked("cable", file.cables, one.cable) for one in file.kinematic_chains]
    for one in file.kinematic_chains:
        _picked("platform", file.platforms, one.platform)
    if any(end.drivetrain for end in ends):
        notes.append("Motors, gearboxes and drums of its winches were left out.")
    if any(cable.modulus and cable.modulus.viscosities for cable in cables):
        notes.append("The viscosity of its cables was left out: it has no effect in static equilibrium.")
    if plane:
        notes.append("Gravity, which its file does not contain, acts along y, as in cdpyr's own planar robots.")
    return Draft(
        name=file.name or path.stem,
        exits=[end.position for end in ends],
        anchors=[
            _picked("platform_anchor", platform.anchors, one.platform_anchor).position for one in file.kinematic_chains
        ],
        mass=platform.mass[0][0],
        axial_stiffness=_stiffness(cables),
        linear_density=[_density(cable) for cable in cables],
        pulley_radius=[end.pulley.radius if end.pulley else 0.0 for end in ends],
        pulley_axis=[_turned(end.dcm) @ _turned(end.pulley and end.pulley.dcm) @ [0.0, 0.0, 1.0] for end in ends],
        center_of_mass=platform.center_of_gravity,
        inertia=_inertia(platform.inertia),
        plane=plane,
        turns=turns,
        home=file.home_pose and file.home_pose.linear and file.home_pose.linear.position,
        notes=notes,
    )


def _picked(field: str, items: Sequence, index: int) -> Any:
    if index >= len(items):
        raise InvalidInput(f"kinematic_chains: found {field} {index} of {len(items)}, counted from 0")
    return items[index]


def _turned(dcm: Matrix | None) -> np.ndarray:
    return np.eye(3) if dcm is None else np.array(dcm)


def _section(cable: _Cable) -> float:
    return math.pi * cable.diameter**2 / 4


def _stiffness(cables: list[_Cable]) -> list[float] | None:
    """EA [N]: the first elasticity [Pa] is the static spring, times the section."""
    moduli = [
        cable.modulus.elasticities[0] if cable.modulus and cable.modulus.elasticities else None for cable in cables
    ]
    if None in moduli:
        return None
    return [modulus * _section(cable) for modulus, cable in zip(moduli, cables, strict=True) if modulus is not None]


def _density(cable: _Cable) -> float:
    """Mass per length of a cable [kg/m]."""
    if cable.density is None or not math.isfinite(cable.density):
        return 0.0
    return cable.density * _section(cable) if cable.density > LIGHTEST_MATERIAL else cable.density


def _inertia(angular: tuple | None) -> np.ndarray | None:
    matrix = np.array(np.inf if angular is None else angular)
    return matrix if np.isfinite(matrix).all() else None

"""Robots of the University of Bologna (IRMA L@B): JSON with an actuator per cable, with trailing commas.

There are three generations of names. In the older ones (``pos_D_glob``, ``pos_A_loc``, later ``pos_OD_glob``,
``pos_PA_loc``) D is a point of the frame, the cable enters its swivelling pulley there in the direction ``vers_k``, and
A is the anchor on the platform. In the newest (``pos_OA_glob``, ``pos_PD_loc``) the pulleys are mounted on the
platform, and A is a fixed point of the frame.
Gravity is 9.80665 m/s² opposite to the axis that the file gives in the base frame.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from pydantic import AliasChoices, AliasPath, Field
from scipy.spatial.transform import Rotation

from cdpr_sim.core.checks import shown
from cdpr_sim.core.errors import InvalidInput
from cdpr_sim.robots.importers.documents import Matrix, Number, Part, Vector, as_model
from cdpr_sim.robots.importers.draft import Draft

TITLE = "the Bologna group's JSON"
MARKS = {"actuator", "cable"}

UP, NOWHERE = (0.0, 0.0, 1.0), (0.0, 0.0, 0.0)

GRAVITY = 9.80665
"""[m/s²] Gravity in the group's code."""

UPRIGHT = 1e-12
"""Sine of the largest angle between an axis and z that counts as zero."""

PATTERNS: dict[str, tuple[str | None, bool]] = {
    "THREE_R_THREE_T": (None, True),
    "ONE_R_TWO_T": ("xz", True),
    "THREE_T": (None, False),
    "TWO_T": ("xz", False),
}
"""Per motion pattern: the plane of a planar robot, and whether the platform turns."""


def _called(*names: str, part: str | None = None, **options: Any) -> Any:
    """A field with any of these names, in a part of its own or, in the oldest files, in none."""
    parts = [AliasPath(part, name) for name in names] if part else []
    return Field(validation_alias=AliasChoices(*parts, *names), **options)


class _Actuator(Part):
    active: bool = True
    radius: Number = _called("radius", "swivel_pulley_r", part="pulley", default=0.0)
    exit: Vector = _called("pos_OD_glob", "pos_OA_glob", "pos_D_glob", "pos_glob_D", part="pulley")
    axis: Vector = _called("vers_k", "vers_k_loc", part="pulley", default=UP)
    on_platform: Any = _called("pos_OA_glob", part="pulley", default=None)
    anchor: Vector = _called("pos_PA_loc", "pos_PD_loc", "pos_A_loc", "pos_loc_A", part="winch")


class _Platform(Part):
    mass: Number
    inertia: Matrix | None = _called("inertia_mat_G_loc", "inertia_mat_loc_G", default=None)
    center_of_mass: Vector = _called("pos_PG_loc", "pos_G_loc", "pos_loc_G", default=NOWHERE)
    up: Vector = _called("gravity_axis", "grav_ax", default=UP)
    force: Vector = _called("ext_force_loc", default=NOWHERE)
    torque: Vector = _called("ext_torque_loc", "ext_moments_loc", default=NOWHERE)


class _File(Part):
    motion_pattern: str = "THREE_R_THREE_T"
    actuators: list[_Actuator] = _called("actuator", "cable", min_length=1)
    platform: _Platform


def read(document: Any, path: Path) -> Draft:
    """The robot of such a file.

    Raises:
        InvalidInput: something is missing or invalid.
    """
    file = as_model(_File, document)
    if file.motion_pattern not in PATTERNS:
        raise InvalidInput(f"motion_pattern: found {shown(file.motion_pattern)}, expected one of {', '.join(PATTERNS)}")
    plane, turns = PATTERNS[file.motion_pattern]
    used, platform, notes = [one for one in file.actuators if one.active], file.platform, []
    if not used:
        raise InvalidInput("actuator: found no active one, expected at least one")
    if idle := len(file.actuators) - len(used):
        notes.append(f"Inactive actuators were left out, {idle} of its {len(file.actuators)}.")
    notes.append("Transmission ratios and drums of its winches were left out.")
    if any(platform.force) or any(platform.torque):
        notes.append(
            f"Its external force {platform.force} N and torque {platform.torque} N m were left out: they are a "
            "wrench to solve with."
        )
    radii = np.array([one.radius for one in used])
    if any(one.on_platform for one in used) and radii.any():
        notes.append(
            f"Its pulleys, of {radii.max():g} m, are mounted on the platform, and were left out: anchors are points."
        )
        radii = np.zeros(len(used))
    upright = _upright(platform.up, notes)
    return Draft(
        name=path.stem,
        exits=upright.apply([one.exit for one in used]),
        anchors=[one.anchor for one in used],
        mass=platform.mass,
        pulley_radius=radii,
        pulley_axis=upright.apply([one.axis for one in used]),
        center_of_mass=platform.center_of_mass,
        inertia=platform.inertia,
        plane=plane,
        turns=turns,
        gravity=GRAVITY * float(np.linalg.norm(platform.up)),
        notes=notes,
    )


def _upright(axis: Vector, notes: list[str]) -> Rotation:
    """The rotation of the base frame after which gravity acts along -z."""
    length = float(np.linalg.norm(axis))
    if not (length > 0 and np.isfinite(length)):
        raise InvalidInput(f"platform.gravity_axis: found {axis}, expected a direction")
    up = np.array(axis) / length
    normal = np.cross(up, [0.0, 0.0, 1.0])
    sine = float(np.linalg.norm(normal))
    if sine < UPRIGHT and up[2] > 0:
        return Rotation.identity()
    angle = float(np.arctan2(sine, up[2]))
    notes.append(f"Its base frame was turned by {np.degrees(angle):.3g} degrees, so that gravity acts along -z.")
    return Rotation.from_rotvec(angle * (normal / sine if sine > 0 else np.array([1.0, 0.0, 0.0])))

"""Robots in MuJoCo's XML (MJCF): a platform on spatial tendons from site to site, as this package's own models.

MuJoCo compiles the file, so that defaults, included files and every kind of orientation are read as it reads them. Each
tendon with a stiffness that ends in two sites, one on the platform and one in the world, is a cable. MuJoCo's spring is
linear with the constant k beyond the upper ``springlength``, so that EA is their product. The body with a free joint is
the platform; with two slides and a hinge in the x-z plane, that of a planar robot.
"""

# pyright: reportAttributeAccessIssue=false
# mujoco ships no type stubs for its compiled modules.
from __future__ import annotations

from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from cdpr_sim.core.checks import shown
from cdpr_sim.core.errors import InvalidInput
from cdpr_sim.robots.importers.draft import Draft

TITLE = "MuJoCo's XML"
MARKS = {"mujoco"}

DIGITS = 14
"""Significant digits of EA: stiffness times length rounds in the sixteenth."""

DRAWN = 1e-100
"""[N/m] Tendons of a smaller stiffness pull nothing: scenes of this package have such ones for MuJoCo to draw."""

PLANAR = {("slide", (1.0, 0.0, 0.0)), ("slide", (0.0, 0.0, 1.0)), ("hinge", (0.0, 1.0, 0.0))}
"""Type and axis of the joints of a planar platform."""


def read(document: Element, path: Path) -> Draft:
    """The robot of such a file.

    Raises:
        InvalidInput: MuJoCo does not compile it, something is missing, or has no counterpart.
    """
    import mujoco

    if any("nan" in value.lower().split() for one in document.iter() for value in one.attrib.values()):
        raise InvalidInput("found nan, expected finite numbers")  # MuJoCo would warn, and go on
    try:
        model = mujoco.MjModel.from_xml_path(str(path))
    except ValueError as error:
        raise InvalidInput(f"found what MuJoCo does not compile: {' '.join(str(error).split())}") from None
    platform, planar = _platform(model)
    notes: list[str] = []
    world, plate = _fixed_to(model, 0), _fixed_to(model, platform)
    springs = np.flatnonzero(model.tendon_stiffness > DRAWN)
    cables = [_cable(model, one, world, plate, notes) for one in springs.tolist()]
    if not cables:
        raise InvalidInput("<tendon>: found no spatial tendon with a stiffness, expected the cables")
    exits, anchors, EA = zip(*cables, strict=True)
    x, y, z = model.opt.gravity
    if x or y or z > 0:
        raise InvalidInput(f"<option> gravity: found {shown([x, y, z])}, expected one along -z")
    mass, center, inertia = _inertia(model, plate)
    boxes = (model.geom_bodyid == platform) & (model.geom_type == mujoco.mjtGeom.mjGEOM_BOX)
    return Draft(
        name=document.get("model", path.stem),
        exits=exits,
        anchors=anchors,
        mass=mass,
        axial_stiffness=EA,
        center_of_mass=center,
        inertia=inertia,
        plane="xz" if planar else None,
        gravity=float(-z),
        platform_size=2 * model.geom_size[boxes][0] if boxes.any() else None,
        home=world[int(model.body_parentid[platform])].apply(model.body_pos[platform]),
        notes=notes,
    )


def _platform(model: Any) -> tuple[int, bool]:
    """Index of the only body with joints, and whether it is that of a planar robot."""
    import mujoco

    moving = np.flatnonzero(model.body_jntnum)
    if not len(moving):
        raise InvalidInput("<body>: found none with a free joint, expected the platform")
    if len(moving) > 1:
        raise InvalidInput("<body>: found a second one with joints, expected a single rigid platform")
    names = [mujoco.mjtJoint(kind).name.removeprefix("mjJNT_").lower() for kind in model.jnt_type]
    planar = len(names) == 3 and set(zip(names, map(tuple, model.jnt_axis.tolist()), strict=True)) == PLANAR
    if names != ["free"] and not planar:
        raise InvalidInput(
            f"<body name={shown(model.body(moving[0]).name)}>: found {len(names)} joints, expected a free one, or two "
            "slides and a hinge in the x-z plane"
        )
    return int(moving[0]), planar


def _fixed_to(model: Any, root: int) -> dict[int, RigidTransform]:
    """The bodies that are fixed to one, itself included, and where they are in it."""
    places = {root: RigidTransform.identity()}
    for body in range(root + 1, model.nbody):  # a body follows the one that it is in
        within = int(model.body_parentid[body])
        if within in places and not model.body_jntnum[body]:
            places[body] = places[within] * _placed(model.body_pos[body], model.body_quat[body])
    return places


def _placed(position: np.ndarray, quaternion: np.ndarray) -> RigidTransform:
    return RigidTransform.from_components(position, Rotation.from_quat(quaternion, scalar_first=True))


def _cable(
    model: Any, tendon: int, world: dict[int, RigidTransform], plate: dict[int, RigidTransform], notes: list[str]
) -> tuple[np.ndarray, np.ndarray, float]:
    """Exit, anchor and EA of a tendon."""
    import mujoco

    name = f"tendon {shown(model.tendon(tendon).name)}"
    path = slice(model.tendon_adr[tendon], model.tendon_adr[tendon] + model.tendon_num[tendon])
    kinds, sites = model.wrap_type[path], model.wrap_objid[path]
    if kinds.tolist() != [mujoco.mjtWrap.mjWRAP_SITE] * 2:
        raise InvalidInput(f"{name}: found {len(kinds)} points on its path, expected two sites and no wheel or pulley")
    if model.tendon_stiffnesspoly[tendon].any():
        raise InvalidInput(f"{name}: found a stiffness with further coefficients, expected a linear spring")
    bodies = [int(body) for body in model.site_bodyid[sites]]
    if (bodies[0] in plate) == (bodies[1] in plate):
        raise InvalidInput(f"{name}: found both ends on one body, expected one on the platform and one in the world")
    ends = [(plate if body in plate else world)[body].apply(model.site_pos[site])
            for body, site in zip(bodies, sites, strict=True)]  # fmt: skip
    exit, anchor = reversed(ends) if bodies[0] in plate else ends
    least, length = model.tendon_lengthspring[tendon]
    if least > 0:
        notes.append(f"The spring of {name} pushes as well when it is shorter; here it is a cable.")
    if not length > 0:
        raise InvalidInput(f"{name}: found a rest length of {length:g} m, expected a positive one")
    return exit, anchor, float(f"{model.tendon_stiffness[tendon] * length:.{DIGITS}g}")


def _inertia(model: Any, plate: dict[int, RigidTransform]) -> tuple[float, np.ndarray, np.ndarray]:
    """Mass, centre of mass and inertia about it of all bodies of the platform, in the platform's axes."""
    bodies = [body for body in plate if model.body_mass[body] > 0]
    masses = model.body_mass[bodies]
    places = [plate[body] * _placed(model.body_ipos[body], model.body_iquat[body]) for body in bodies]
    centers = np.array([place.translation for place in places])
    center = centers[0] + masses @ (centers - centers[0]) / masses.sum()
    inertia = np.zeros((3, 3))
    for body, mass, place in zip(bodies, masses, places, strict=True):
        turn, off = place.rotation.as_matrix(), place.translation - center
        inertia += turn @ np.diag(model.body_inertia[body]) @ turn.T + mass * (
            off @ off * np.eye(3) - np.outer(off, off)
        )
    return float(masses.sum()), center, inertia

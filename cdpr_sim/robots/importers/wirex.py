"""Robots of WireX and WireCenter (Andreas Pott): ``.wcrfx``, XML with a ``chain`` per cable, in SI units.

A cable arrives at its pulley along the z axis of the base's rotation matrix (a13, a23, a33). ``elasticity`` is Young's
modulus [Pa] in WireX's code and files, and 1/EA [1/N] in its description of the format: modulus and compliance differ
by twenty orders of magnitude. WireX writes placeholders where it has no data of platform and cable: they are
recognised. Its planar robots are in the x-y plane, and gravity acts normal to it.
"""

from __future__ import annotations

import math
from pathlib import Path
from xml.etree.ElementTree import Element

import numpy as np

from cdpr_sim.core.checks import shown
from cdpr_sim.core.errors import InvalidInput
from cdpr_sim.robots.importers.documents import attribute, child
from cdpr_sim.robots.importers.draft import Draft

TITLE = "WireX's wcrfx"
MARKS = {"models"}

DUMMY_MASS, DUMMY_CENTER = 25.0, (0.0, 1.0, 0.2)
"""[kg, m] Placeholders that WireX writes for a platform without data; and an Ixx without the other moments."""

DUMMY_CABLE = (110e9, 0.006)
"""[Pa, m] Placeholders of modulus and radius: steel wire, on the diameter of a Dyneema rope."""

DUMMY_PULLEY = 0.1
"""[m] Placeholder of the radius of every pulley; also used where none is given."""

LEAST_MODULUS = 1.0
"""[Pa] An ``elasticity`` below this value is a compliance, in 1/N."""

PATTERNS: dict[str, tuple[str | None, bool]] = {
    "3R3T": (None, True),
    "2R3T": (None, True),
    "3T": (None, False),
    "1R2T": ("xy", True),
    "2T": ("xy", False),
}
"""For each motion pattern: the plane of a planar robot, and whether the platform rotates."""


def read(document: Element, path: Path) -> Draft:
    """The robot of such a file.

    Raises:
        InvalidInput: something is missing or invalid, or there are several robots.
    """
    robots = document.findall("robot")
    if len(robots) != 1:
        raise InvalidInput(f"<models>: found {len(robots)} robots, expected one")
    robot, notes = robots[0], []
    pattern = robot.get("motionpattern") or robot.get("motion_pattern") or "3R3T"
    if pattern not in PATTERNS:
        raise InvalidInput(f"<robot> motionpattern: found {shown(pattern)}, expected one of {', '.join(PATTERNS)}")
    if pattern == "2R3T":
        notes.append("The platform does not rotate about its own axis there; here it does.")
    plane, turns = PATTERNS[pattern]
    chains = child(robot, "geometry").findall("chain")
    if not chains:
        raise InvalidInput("<geometry>: found no <chain>, expected one for each cable")
    bases = [child(chain, "base") for chain in chains]
    if document.find("winch") is not None:
        notes.append("Motors, drums and limits of its winches were left out.")
    radii = [attribute(base, "radius", DUMMY_PULLEY) for base in bases]
    if set(radii) == {DUMMY_PULLEY}:
        notes.append(f"The radius of its pulleys, {DUMMY_PULLEY:g} m, is WireX's default, and was used.")
    mass, center, inertia = _platform(robot.find("platform"), notes)
    stiffness, density = _cable(document.find("cable"), notes)
    return Draft(
        name=robot.get("name") or path.stem,
        exits=[_position(base) for base in bases],
        anchors=[_position(child(chain, "platform")) for chain in chains],
        mass=mass,
        axial_stiffness=stiffness,
        linear_density=density,
        pulley_radius=radii,
        pulley_axis=[[attribute(base, f"a{row}3", float(row == 3)) for row in (1, 2, 3)] for base in bases],
        center_of_mass=center,
        inertia=inertia,
        plane=plane,
        turns=turns,
        gravity=0.0 if plane else 9.81,
        description=robot.get("description", ""),
        source=f"{robot.get('author') or 'unnamed author'}, in {path.name}",
        notes=notes,
    )


def _position(element: Element) -> list[float]:
    return [attribute(element, axis) for axis in "xyz"]


def _platform(platform: Element | None, notes: list[str]) -> tuple[float, list[float], np.ndarray | None]:
    """Mass, centre of mass and inertia, placeholders replaced."""
    if platform is None:
        notes.append(f"Its platform is not described: {DUMMY_MASS:g} kg, WireX's own default, were used.")
        return DUMMY_MASS, [0.0, 0.0, 0.0], None
    mass = attribute(platform, "mass", DUMMY_MASS)
    element = platform.find("centerofgravity")
    center = [0.0, 0.0, 0.0] if element is None else _position(element)
    if tuple(center) == DUMMY_CENTER:
        center = [0.0, 0.0, 0.0]
        notes.append("Its centre of gravity is WireX's placeholder, at 1 m; the platform's origin was used.")
        if mass == DUMMY_MASS:
            notes.append(f"Its mass, {mass:g} kg, is WireX's placeholder, and was used.")
    tensor = platform.find("inertiatensor")
    names = [[f"I{row}{column}" for column in "xyz"] for row in "xyz"]
    if tensor is None or not {"Ixx", "Iyy", "Izz"} <= set(tensor.keys()):
        if tensor is not None:
            notes.append("Its tensor of inertia is incomplete, and was replaced by that of a uniform box.")
        return mass, center, None
    return mass, center, np.array([[attribute(tensor, name, 0.0) for name in row] for row in names])


def _cable(cable: Element | None, notes: list[str]) -> tuple[float | None, float]:
    """EA [N] and mass per length [kg/m]."""
    if cable is None:
        return None, 0.0
    elasticity, radius = attribute(cable, "elasticity", 0.0), attribute(cable, "radius", 0.0)
    density = attribute(cable, "weight", 0.0)
    if (elasticity, radius) == DUMMY_CABLE:
        notes.append("Its cable is WireX's default, steel wire of 6 mm radius, and was used.")
    if elasticity < 0 or (elasticity >= LEAST_MODULUS and not radius > 0):
        raise InvalidInput(
            f"<cable>: found an elasticity of {elasticity:g} and a radius of {radius:g} m, expected both above 0"
        )
    if elasticity >= LEAST_MODULUS:
        return elasticity * math.pi * radius**2, density
    if elasticity > 0:
        notes.append(f"Its elasticity, {elasticity:g}, was read as 1/EA in 1/N.")
        return 1 / elasticity, density
    return None, density

"""Robots of CASPR (Darwin Lau): XML in two files, ``*_bodies.xml`` and ``*_cables.xml`` in the same folder, in metres.

A body is attached by a joint: its frame is at the joint, which moves from its location on the parent. Attachments
are relative to the joint or to the centre of mass, as ``attachment_reference`` states; the inertia likewise, by its
``ref``. Gravity is 9.81 m/s² along -z. ``K`` of a spring cable is its EA.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element

import numpy as np

from cdpr_sim.core.cable import DOWN
from cdpr_sim.core.checks import shown
from cdpr_sim.core.errors import LONGEST, CdprError, InvalidInput, UnknownName
from cdpr_sim.robots.importers.documents import child, numbers, read_document, spelled
from cdpr_sim.robots.importers.draft import Draft, symmetric

TITLE = "CASPR's XML"
MARKS = {"bodies_system"}

JOINTS: dict[str, tuple[str | None, bool]] = {
    "SPATIAL_EULER_XYZ": (None, True),
    "SPATIAL_QUATERNION": (None, True),
    "T_XYZ": (None, False),
    "PLANAR_XY": ("xy", True),
    "PLANAR_XZ": ("xz", True),
    "PLANAR_YZ": ("yz", True),
    "P_XY": ("xy", False),
    "P_XZ": ("xz", False),
}
"""For each type of joint that leaves a platform to its cables: the plane of a planar one, and whether the platform
rotates."""

CABLES = {"cable_ideal", "cable_linear_spring"}
"""Types of cables with a counterpart; the others are springs, devices and muscles."""


def read(document: Element, path: Path, cables: str | None = None) -> Draft:
    """The robot of such a pair of files.

    Args:
        document: the bodies.
        path: their file.
        cables: the ``id`` of a ``cable_set``; default: the file's own.

    Raises:
        InvalidInput: something is missing or invalid, or has no counterpart: several bodies, a joint about which the
            body turns, cables through several bodies, springs and muscles; or no such set of cables.
    """
    bodies = document.findall("links/link_rigid")
    if len(bodies) != 1:
        raise InvalidInput(f"<links>: found {len(bodies)} bodies, expected one platform")
    body, joint = bodies[0], child(bodies[0], "joint")
    kind = joint.get("type", "")
    if kind not in JOINTS:
        raise InvalidInput(f"<joint>: found {shown(kind)}, which holds the body, expected one of {', '.join(JOINTS)}")
    plane, turns = JOINTS[kind]
    physical = child(body, "physical")
    mass, com = numbers(physical, "mass", 1)[0], np.array(numbers(physical, "com_location", 3))
    notes: list[str] = []
    offset = np.array(numbers(child(body, "parent"), "location", 3))
    depth = offset * [axis not in (plane or "xyz") for axis in "xyz"]  # the constant coordinate of a planar platform
    if (offset != depth).any():
        notes.append(f"Its poses are relative to {tuple((offset - depth).tolist())} m, ours to the origin.")
    file = beside(path, "bodies", "cables")
    document = read_document(file)
    try:
        found = _cables(_cable_set(document, cables), com, depth)
    except CdprError as error:
        raise InvalidInput(f"{file.name}: {error}") from None
    return Draft(
        name=path.stem.removesuffix("_bodies"),
        mass=mass,
        **found,
        center_of_mass=com,
        inertia=_inertia(child(physical, "inertia"), mass, com),
        plane=plane,
        turns=turns,
        gravity=0.0 if plane == "xy" else 9.81,
        home=_home(joint, plane, offset) - depth,
        description=body.get("name", ""),
        notes=notes,
    )


def _home(joint: Element, plane: str | None, offset: np.ndarray) -> np.ndarray:
    """Initial position of the platform: the translations are a joint's first coordinates."""
    axes = ["xyz".index(axis) for axis in plane or "xyz"]
    given = (joint.get("q_initial") or "").split()[: len(axes)]
    home = offset.copy()
    home[axes] += spelled("<joint> q_initial", given or np.zeros(len(axes)), (len(axes),))
    return home


def _inertia(element: Element, mass: float, com: np.ndarray) -> np.ndarray:
    inertia = symmetric(*(numbers(element, f"I{axes}", 1)[0] for axes in ("xx", "yy", "zz", "xy", "xz", "yz")))
    reference = element.get("ref")
    if reference not in {"com", "joint"}:
        raise InvalidInput(f"<inertia> ref: found {shown(reference)}, expected 'com' or 'joint'")
    return inertia if reference == "com" else inertia - mass * (com @ com * np.eye(3) - np.outer(com, com))


def beside(path: Path, part: str, other: str) -> Path:
    """The file of the other part of the robot.

    Raises:
        InvalidInput: the file name does not end in its part.
    """
    if not path.stem.endswith(f"_{part}"):
        raise InvalidInput(
            f"found the name {shown(path.name)}, expected NAME_{part}.xml, with NAME_{other}.xml in the same folder"
        )
    return path.with_name(f"{path.stem.removesuffix(part)}{other}{path.suffix}")


def _cable_set(document: Element, wanted: str | None) -> Element:
    sets = {one.get("id", ""): one for one in document.findall("cable_set")}
    chosen = wanted or document.get("default_cable_set") or next(iter(sets), "")
    if chosen not in sets:
        raise UnknownName("set of cables", chosen, sets)
    return sets[chosen]


def _cables(cable_set: Element, com: np.ndarray, depth: np.ndarray) -> dict[str, Any]:
    """Fields of ``Draft`` of a set of cables, a value per cable."""
    found: list[dict[str, Any]] = []
    for number, element in enumerate(cable_set, 1):
        try:
            found.append(_cable(element, com))
        except InvalidInput as error:
            raise InvalidInput(f"cable {number}: {error}") from None
    if not found:
        raise InvalidInput("<cable_set>: found no cable, expected at least one")
    fields = {name: [one[name] for one in found] for name in found[0]}
    stiffness = fields["axial_stiffness"]
    if len({one is None for one in stiffness}) > 1:
        raise InvalidInput("<cable_set>: found elastic cables beside rigid ones, expected one kind")
    return fields | {"exits": fields["exits"] - depth, "axial_stiffness": None if None in stiffness else stiffness}


def _cable(element: Element, com: np.ndarray) -> dict[str, Any]:
    """Fields of ``Draft`` of one cable; the stiffness of a rigid one is None."""
    if element.tag not in CABLES:
        raise InvalidInput(f"found <{element.tag[:LONGEST]}>, expected one of {', '.join(sorted(CABLES))}")
    reference = element.get("attachment_reference")
    if reference not in {"com", "joint"}:
        raise InvalidInput(f"attachment_reference: found {shown(reference)}, expected 'com' or 'joint'")
    ends = list(child(element, "attachments"))
    if len(ends) != 2:
        raise InvalidInput(f"found {len(ends)} attachments, expected two: cables do not run through several bodies")
    if ends[0].tag == "base_rotating_pulley":
        exit, links = numbers(ends[0], "fixed_location", 3), [0.0, *numbers(ends[1], "link", 1)]
        radius, axis = numbers(ends[0], "pulley_radius", 1)[0], numbers(ends[0], "cable_entry_vector", 3)
    elif ends[0].tag == ends[1].tag == "attachment":
        ends.sort(key=lambda end: numbers(end, "link", 1)[0] != 0)  # from the base to the platform
        exit, links = numbers(ends[0], "location", 3), [numbers(end, "link", 1)[0] for end in ends]
        radius, axis = 0.0, DOWN
    else:
        raise InvalidInput(f"found <{ends[0].tag[:LONGEST]}> and <{ends[1].tag[:LONGEST]}>, expected two attachments")
    if links != [0, 1]:
        raise InvalidInput(
            f"found ends on links {links[0]:g} and {links[1]:g}, expected one on the base, 0, and one on 1"
        )
    anchor, properties = np.array(numbers(ends[1], "location", 3)), child(element, "properties")
    return {
        "exits": exit,
        "anchors": anchor + com if reference == "com" else anchor,
        "pulley_radius": radius,
        "pulley_axis": axis,
        "axial_stiffness": numbers(properties, "K", 1)[0] if element.tag == "cable_linear_spring" else None,
        "force_min": numbers(properties, "force_min", 1)[0],
        "force_max": numbers(properties, "force_max", 1)[0],
    }

"""Robots in MuJoCo's XML (MJCF): a platform on spatial tendons from site to site, as this package's own models.

Each tendon with a stiffness that ends in two sites, one on the platform and one in the world, is a cable. MuJoCo's
spring is linear with the constant k beyond the upper ``springlength``, so that EA is their product. Attributes come
from ``<default>`` classes as in MuJoCo. The body with a free joint is the platform; with two slides and a hinge in the
x-z plane, that of a planar robot. MuJoCo itself is not needed.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple
from xml.etree.ElementTree import Element

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from cdpr_sim.core.checks import shown
from cdpr_sim.core.errors import InvalidInput
from cdpr_sim.robots.importers.documents import spelled
from cdpr_sim.robots.importers.draft import Draft, symmetric

TITLE = "MuJoCo's XML"
MARKS = {"mujoco"}

DEEPEST = 100
"""Largest depth of nested bodies and default classes."""

DIGITS = 14
"""Significant digits of EA: stiffness times length rounds in the sixteenth."""

PLANAR = {("slide", (1.0, 0.0, 0.0)), ("slide", (0.0, 0.0, 1.0)), ("hinge", (0.0, 1.0, 0.0))}
"""Type and axis of the joints of a planar platform."""

TURNED = ("axisangle", "euler", "xyaxes", "zaxis")
"""Orientations other than quaternions, which are not read."""


class _Site(NamedTuple):
    """Position in the frame of the world or of the platform, and in which."""

    position: np.ndarray
    of_platform: bool


def read(document: Element, path: Path) -> Draft:
    """The robot of such a file.

    Raises:
        InvalidInput: something is missing or invalid, or has no counterpart.
    """
    if document.find(".//include") is not None:
        raise InvalidInput("<include>: found one, expected a model in a single file")
    for one in document.iterfind("tendon/*"):
        if one.find("geom") is not None or one.find("pulley") is not None:
            raise InvalidInput(
                f"tendon {shown(one.get('name', ''))}: found a wheel or a pulley on its path, "
                "expected two sites and no pulley"
            )
    model = _Reader(document)
    if model.platform is None:
        raise InvalidInput("<body>: found none with a free joint, expected the platform")
    cables = [one for one in document.iterfind("tendon/*") if model.stiffness(one) > 0]
    if not cables:
        raise InvalidInput("<tendon>: found no spatial tendon with a stiffness, expected the cables")
    notes: list[str] = []
    exits, anchors, EA = zip(*(model.cable(cable, notes) for cable in cables), strict=True)
    inertial = model.platform.find("inertial")
    if inertial is None:
        raise InvalidInput("<body>: found no <inertial> of the platform, expected its mass")
    gravity = _numbers(document.find("option"), "gravity", 3, (0.0, 0.0, -9.81))
    if gravity[0] or gravity[1] or gravity[2] > 0:
        raise InvalidInput(f"<option> gravity: found {shown(gravity.tolist())}, expected one along -z")
    size = next(
        (2 * _numbers(one, "size", 3) for one in model.platform.iterfind("geom") if one.get("type") == "box"), None
    )
    return Draft(
        name=document.get("model", path.stem),
        exits=exits,
        anchors=anchors,
        mass=float(_numbers(inertial, "mass", 1)[0]),
        axial_stiffness=EA,
        center_of_mass=_numbers(inertial, "pos", 3, (0.0, 0.0, 0.0)),
        inertia=_inertia(inertial),
        plane="xz" if model.planar else None,
        gravity=float(-gravity[2]),
        platform_size=size,
        home=_numbers(model.platform, "pos", 3, (0.0, 0.0, 0.0)),
        notes=notes,
    )


class _Reader:
    """Sites, default classes and the platform of a model."""

    def __init__(self, document: Element) -> None:
        self.sites: dict[str, _Site] = {}
        self.classes: dict[str, dict[str, dict[str, str]]] = {"main": {}}
        self.platform: Element | None = None
        self.planar = False
        self.at = RigidTransform.identity()
        for one in document.iterfind("default"):
            self._read_class(one, {}, 0)
        world = document.find("worldbody")
        if world is None:
            raise InvalidInput("<mujoco>: missing <worldbody>")
        self._read_body(world, RigidTransform.identity(), False, 0)

    def attributes(self, element: Element) -> Mapping[str, str]:
        """Attributes of an element with those of its default class."""
        name = element.get("class", "main")
        if name not in self.classes:
            raise InvalidInput(f"<{element.tag[:40]}>: found the class {shown(name)}, expected one of <default>")
        return self.classes[name].get("tendon" if element.tag == "spatial" else element.tag, {}) | element.attrib

    def stiffness(self, tendon: Element) -> float:
        return float(_numbers_of(f"<{tendon.tag[:40]}>", self.attributes(tendon), "stiffness", None, (0.0,))[0])

    def cable(self, tendon: Element, notes: list[str]) -> tuple[np.ndarray, np.ndarray, float]:
        """Exit, anchor and EA of a tendon."""
        name = f"tendon {shown(tendon.get('name', ''))}"
        ends = [one.get("site", "") for one in tendon if one.tag == "site"]
        if tendon.tag != "spatial" or len(tendon) != 2 or len(ends) != 2:
            raise InvalidInput(f"{name}: found {len(tendon)} points on its path, expected two sites and no pulley")
        missing = [site for site in ends if site not in self.sites]
        if missing:
            raise InvalidInput(f"{name}: found no site {shown(missing[0])}")
        first, second = (self.sites[site] for site in ends)
        if first.of_platform == second.of_platform:
            raise InvalidInput(
                f"{name}: found both ends on one body, expected one on the platform and one in the world"
            )
        exit, anchor = (second, first) if first.of_platform else (first, second)
        given = self.attributes(tendon)
        spring = _numbers_of(name, given, "springlength", None, (-1.0,))
        length = float(spring[-1])
        if length < 0:
            length = float(np.linalg.norm(self.at.apply(anchor.position) - exit.position))
        if len(spring) == 1 or spring[0] > 0:
            notes.append(f"The spring of {name} pushes as well when it is shorter; here it is a cable.")
        if not length > 0:
            raise InvalidInput(f"{name}: found a rest length of {length:g} m, expected a positive one")
        return exit.position, anchor.position, float(f"{self.stiffness(tendon) * length:.{DIGITS}g}")

    def _read_class(self, element: Element, inherited: Mapping[str, Mapping[str, str]], depth: int) -> None:
        if depth > DEEPEST:
            raise InvalidInput("<default>: found classes nested too deeply")
        own = {tag: dict(given) for tag, given in inherited.items()}
        for one in element:
            if one.tag != "default":
                own[one.tag] = own.get(one.tag, {}) | one.attrib
        self.classes[element.get("class", "main")] = own
        for one in element.iterfind("default"):
            self._read_class(one, own, depth + 1)

    def _read_body(self, body: Element, at: RigidTransform, of_platform: bool, depth: int) -> None:
        """Sites of a body and of those in it that are fixed to it; ``at`` is where it is in world or platform."""
        if depth > DEEPEST:
            raise InvalidInput("<body>: found bodies nested too deeply")
        for site in body.iterfind("site"):
            position = at.apply(_numbers_of("<site>", self.attributes(site), "pos", 3, (0.0, 0.0, 0.0)))
            self.sites[site.get("name", "")] = _Site(position, of_platform)
        for one in body.iterfind("body"):
            joints = [*one.iterfind("freejoint"), *one.iterfind("joint")]
            placed = at * _pose(one)
            if not joints:
                self._read_body(one, placed, of_platform, depth + 1)
            elif of_platform or self.platform is not None:
                raise InvalidInput("<body>: found a second one with joints, expected a single rigid platform")
            else:
                self._check_platform(one, joints)
                self.platform, self.at = one, placed
                self._read_body(one, RigidTransform.identity(), True, depth + 1)

    def _check_platform(self, body: Element, joints: list[Element]) -> None:
        kinds = {
            (given.get("type", "hinge"), tuple(_numbers_of("<joint>", given, "axis", 3, (0.0, 0.0, 1.0)).tolist()))
            for given in map(self.attributes, joints)
        }
        free = len(joints) == 1 and (joints[0].tag == "freejoint" or next(iter(kinds))[0] == "free")
        self.planar = kinds == PLANAR and len(joints) == 3
        if not free and not self.planar:
            raise InvalidInput(
                f"<body name={shown(body.get('name', ''))}>: found {len(joints)} joints, expected a free one, or two "
                "slides and a hinge in the x-z plane"
            )


def _pose(body: Element) -> RigidTransform:
    turned = [name for name in TURNED if body.get(name) is not None]
    if turned:
        raise InvalidInput(f"<body>: found {turned[0]}, expected a quaternion, quat")
    quaternion = _numbers(body, "quat", 4, (1.0, 0.0, 0.0, 0.0))
    if not np.linalg.norm(quaternion) > 0:
        raise InvalidInput(f"<body> quat: found {shown(quaternion.tolist())}, expected a rotation")
    return RigidTransform.from_components(
        _numbers(body, "pos", 3, (0.0, 0.0, 0.0)), Rotation.from_quat(quaternion, scalar_first=True)
    )


def _inertia(inertial: Element) -> np.ndarray | None:
    """The matrix about the centre of mass in the platform's axes; None where it is not given."""
    if inertial.get("fullinertia") is not None:
        return symmetric(*_numbers(inertial, "fullinertia", 6))
    if inertial.get("diaginertia") is None:
        return None
    turn = _pose(inertial).rotation.as_matrix()
    return turn @ np.diag(_numbers(inertial, "diaginertia", 3)) @ turn.T


def _numbers(element: Element | None, name: str, count: int, default: tuple[float, ...] | None = None) -> np.ndarray:
    tag = "option" if element is None else element.tag[:40]
    return _numbers_of(f"<{tag}>", {} if element is None else element.attrib, name, count, default)


def _numbers_of(
    where: str, given: Mapping[str, str], name: str, count: int | None, default: tuple[float, ...] | None = None
) -> np.ndarray:
    """Numbers of an attribute; any one or two with ``count`` None."""
    text = given.get(name)
    if text is None:
        if default is None:
            raise InvalidInput(f"{where}: missing {name}")
        return np.array(default)
    words = text.split()
    if count is None:
        count = 2 if len(words) == 2 else 1
    return spelled(f"{where} {name}", words, (count,))

"""A pulley in MuJoCo: a body that swivels about the axis of the arriving cable, and a sphere that the tendon wraps.

The cable arrives along the axis e and touches the wheel at the exit A. In MuJoCo that is

- a body at A with a hinge about e, the swivel; its x axis points from A to the centre of the wheel;
- a *sphere* of the wheel's radius at that centre, the groove. The plane of entry, centre and anchor cuts it in a great
  circle, wherever the anchor is. On a cylinder the tendon may slide off as a helix, and the swivel is then unstable.
  In a planar robot, whose wheels do not swivel, a cylinder: the first mass of a chain would slide off the sphere;
- a site beyond the wheel, seen along e: it selects the side on which the tendon passes;
- a site on the axis before A, where the tendon begins. At less than about ten radii, the swivel is unstable.

So the tendon is longer than the cable by that straight entry, ``ENTRY`` radii. No force turns the wheel of a slack
cable; it is turned towards its anchor explicitly (``toward_anchors``), as by a taut cable; the wheel of a cable with
mass, towards the first mass of its chain. A planar robot's wheel lies in the plane, on the side of its axis where the
anchor is, and does not swivel.
"""

# pyright: reportAttributeAccessIssue=false
# mujoco ships no type stubs for its compiled modules.
from __future__ import annotations

import functools
import xml.etree.ElementTree as ET
from collections.abc import Sized
from dataclasses import dataclass

import mujoco
import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.spatial.transform import RigidTransform

from cdpr_sim.core.cable import Cabling
from cdpr_sim.core.checks import frozen
from cdpr_sim.core.robot import STANDARD_GRAVITY, Robot
from cdpr_sim.physics.exits import holder
from cdpr_sim.physics.number_format import LEAST_INERTIA, add, add_inertia, magnitude

ENTRY = 10.0
"""Length of the straight entry, in radii."""

SIDE = 1.2
"""Distance from the wheel's centre to the site that selects the side, in radii."""

WIDTH = 0.15
"""Half the width of the drawn wheel, in radii."""

POINTS = 4
"""Points of a tendon's path: entry, first and last contact with the wheel, anchor."""

SWIVELLING = 50.0
"""[rad/s] Angular frequency of a wheel about its axis with a cable that carries the platform's weight: higher than that
of platforms, low enough for the time step also where cables carry hundreds of times the weight."""

SWIVEL_DAMPING = 0.5
"""Damping ratio of that oscillation."""

LIGHT = 1e-6
"""Mass of a swivel, as a fraction of the platform's: MuJoCo requires one. It lies on the axis, where it has no
effect."""


def entries(cabling: Cabling) -> Float[np.ndarray, " cables"]:
    """Difference between the length of each tendon and its cable [m]."""
    return ENTRY * cabling.pulley_radius


def circumferences(cabling: Cabling) -> Float[np.ndarray, " cables"]:
    """Of the wheels [m]; 0 of a point."""
    return 2 * np.pi * cabling.pulley_radius


def arriving(cabling: Cabling) -> Float[np.ndarray, "cables 3"]:
    """Unit vectors along which cables arrive at their exits."""
    return cabling.pulley_axis


def add_defaults(defaults: ET.Element) -> None:
    """Classes of auxiliary elements: they are in a group that viewers hide."""
    hidden = add(defaults, "default", {"class": "guide"})
    add(hidden, "site", group=4, size=0.001)
    add(hidden, "geom", type="sphere", group=4, contype=0, conaffinity=0, mass=0)


def add_pulleys(world: ET.Element, robot: Robot, pose: RigidTransform, color: tuple[float, ...]) -> None:
    """The bodies ``pulley_1``, ... with joints ``swivel_1``, ..., turned towards the anchors at ``pose``.

    They follow the platform in the model, so that its coordinates stay the first ones. ``ref`` makes a swivel's
    coordinate its angle from a direction that depends only on the axis, and is the same in all models of a robot.
    """
    cabling = robot.cabling
    load, directions, angles = _load(robot), *facing(robot, pose.apply(robot.anchors))
    for cable, outwards, angle in zip(np.flatnonzero(cabling.pulleys), directions, angles, strict=True):
        i, radius = cable + 1, cabling.pulley_radius[cable]
        held, origin = holder(world, robot, int(cable))
        exit_, axis = cabling.exits[cable] - origin, cabling.pulley_axis[cable]
        add(held, "site", {"name": f"entry_{i}", "class": "guide"}, pos=exit_ - ENTRY * radius * axis)
        floats = None if held is world else 1
        turned = [*outwards, *np.cross(axis, outwards)]
        body = add(held, "body", name=f"pulley_{i}", pos=exit_, xyaxes=turned, gravcomp=floats)
        if robot.mobility == "spatial":
            armature = load * radius / SWIVELLING**2
            damping = 2 * SWIVEL_DAMPING * SWIVELLING * armature
            swivel = {"name": f"swivel_{i}", "type": "hinge", "axis": "0 0 1"}
            add(body, "joint", swivel, ref=angle, armature=armature, damping=damping)
            mass = LIGHT * robot.mass
            add_inertia(body, mass, max(mass * radius * radius, LEAST_INERTIA))
        groove = {"name": f"groove_{i}", "class": "guide", "size": radius}
        if robot.mobility == "planar":
            groove |= {"type": "cylinder", "size": [radius, WIDTH * radius], "zaxis": [0, 1, 0]}
        add(body, "geom", groove, pos=[radius, 0, 0])
        add(body, "site", {"name": f"side_{i}", "class": "guide"}, pos=[radius, 0, SIDE * radius])
        wheel = {"name": f"wheel_{i}", "class": "drawn", "type": "cylinder"}
        sides = [radius, -WIDTH * radius, 0, radius, WIDTH * radius, 0]
        add(body, "geom", wheel, size=radius, fromto=sides, rgba=color)


def facing(
    robot: Robot, anchors: Float[np.ndarray, "*rows cables 3"]
) -> tuple[Float[np.ndarray, "*rows pulleys 3"], Float[np.ndarray, "*rows pulleys"]]:
    """Unit vectors from the exits to the centres of the wheels, turned towards ``anchors``; the swivels' angles [rad].

    For the cables that have a pulley. The angles are rounded to 1e-12, since the last digit of an arc tangent
    differs between processors. For an anchor on the axis the angle is 0.
    """
    cabling = robot.cabling
    over = np.flatnonzero(cabling.pulleys)
    away = anchors[..., over, :] - robot.exits[over]
    sides = np.array([_sides(*axis) for axis in cabling.pulley_axis[over]]).reshape(-1, 2, 3)
    x, y = np.moveaxis((sides * away[..., None, :]).sum(-1), -1, 0)
    if robot.mobility == "planar":
        y = np.zeros_like(y)
    size = np.sqrt(x * x + y * y)
    x = np.where(size > 0, x, 1.0) / np.where(size > 0, size, 1.0)
    y = y / np.where(size > 0, size, 1.0)
    return x[..., None] * sides[:, 0] + y[..., None] * sides[:, 1], np.round(np.arctan2(y, x), 12)


def departures(robot: Robot, anchors: Float[np.ndarray, "*rows cables 3"]) -> Float[np.ndarray, "*rows cables 3"]:
    """Points where the cables leave their wheels on the tangents to ``anchors`` [m].

    The exits of cables without a pulley, and of those whose anchors are inside their wheels.
    """
    cabling, points = robot.cabling, np.broadcast_to(robot.exits, anchors.shape).copy()
    over = np.flatnonzero(cabling.pulleys)
    radius, axis, (outwards, _) = cabling.pulley_radius[over, None], cabling.pulley_axis[over], facing(robot, anchors)
    centers = robot.exits[over] + radius * outwards
    away = anchors[..., over, :] - centers
    aside, ahead = ((away * direction).sum(-1, keepdims=True) for direction in (outwards, axis))
    square = aside * aside + ahead * ahead
    free = square - radius * radius
    turned = aside * axis - ahead * outwards
    tangent = centers + radius / square * (radius * away + np.sqrt(np.maximum(free, 0)) * turned)
    points[..., over, :] = np.where(free > 0, tangent, points[..., over, :])
    return points


def add_way(tendon: ET.Element, i: int) -> None:
    """Elements between entry and anchor in the tendon of cable ``i``, over the wheel."""
    add(tendon, "geom", geom=f"groove_{i}", sidesite=f"side_{i}")


@dataclass(frozen=True)
class Swivels:
    """Indices in a model of its pulleys, in the order of the cables that have one.

    Attributes:
        cables: indices of the cables.
        bodies: bodies of the pulleys.
        anchors: sites of the anchors.
        faced: sites that the wheels face: the anchors, or the first masses of chains.
        coordinates: indices of the swivels in ``qpos``; none in planar robots.
        dofs: indices of the swivels in ``qvel``.
        radii: radii of the wheels in the model [m].
    """

    cables: Int[np.ndarray, " pulleys"]
    bodies: Int[np.ndarray, " pulleys"]
    anchors: Int[np.ndarray, " pulleys"]
    faced: Int[np.ndarray, " pulleys"]
    coordinates: Int[np.ndarray, " swivels"]
    dofs: Int[np.ndarray, " swivels"]
    radii: Float[np.ndarray, " pulleys"]

    @classmethod
    def of(cls, model: mujoco.MjModel, cables: Sized, prefix: str = "") -> Swivels:
        """The indices, by name, in a model of so many ``cables``; all names begin with ``prefix``."""
        kinds, count = mujoco.mjtObj, len(cables)
        grooves = numbered(model, kinds.mjOBJ_GEOM, prefix + "groove_{}", count)
        anchors = numbered(model, kinds.mjOBJ_SITE, prefix + "anchor_{}", count)
        masses = numbered(model, kinds.mjOBJ_SITE, prefix + "node_{}_1", count)
        over = np.flatnonzero(grooves >= 0)
        joints = numbered(model, kinds.mjOBJ_JOINT, prefix + "swivel_{}", count)[over]
        joints = joints[joints >= 0]
        return cls(
            cables=over,
            bodies=numbered(model, kinds.mjOBJ_BODY, prefix + "pulley_{}", count)[over],
            anchors=anchors[over],
            faced=np.where(masses >= 0, masses, anchors)[over],
            coordinates=model.jnt_qposadr[joints].astype(int),
            dofs=model.jnt_dofadr[joints].astype(int),
            radii=model.geom_size[grooves[over], 0],
        )

    def __len__(self) -> int:
        return len(self.cables)

    def face(self, model: mujoco.MjModel, data: mujoco.MjData, *, anchors: bool = False) -> None:
        """Turn each wheel of a single simulation towards its site, or its anchor; ``mj_kinematics`` has to follow."""
        mujoco.mj_kinematics(model, data)
        seen = self._seen(data.xpos, data.xmat, data.site_xpos[self.anchors if anchors else self.faced])
        turns = np.arctan2(seen[..., 1], seen[..., 0])
        if len(self.coordinates):
            data.qpos[self.coordinates] += turns
        else:
            model.body_quat[self.bodies] = flipped(model.body_quat[self.bodies], turns)

    def off_wheel(
        self,
        positions: Float[np.ndarray, "*rows bodies 3"],
        matrices: Float[np.ndarray, "*rows bodies 9"],
        sites: Float[np.ndarray, "*rows sites 3"],
        points: Int[np.ndarray, "*rows pulleys"],
    ) -> Bool[np.ndarray, "*rows pulleys"]:
        """Whether each cable is off its wheel: its tendon misses the wheel, or its anchor is below the wheel."""
        seen = self._seen(positions, matrices, sites[..., self.anchors, :])
        return (points < POINTS) | (np.hypot(seen[..., 0], seen[..., 1]) < self.radii)

    def _seen(self, positions: np.ndarray, matrices: np.ndarray, seen: np.ndarray) -> Float[np.ndarray, "*rows n 3"]:
        """Points, one per wheel, in the frames of the wheels [m]: outwards, sideways, along the axis."""
        away = seen - positions[..., self.bodies, :]
        axes = matrices[..., self.bodies, :].reshape(*away.shape, 3)
        return (away[..., None, :] @ axes)[..., 0, :]


def numbered(model: mujoco.MjModel, kind: mujoco.mjtObj, name: str, count: int) -> Int[np.ndarray, " count"]:
    """Indices of the elements ``name`` of cables 1, 2, ...; -1 where there is none."""
    names = [name.format(cable) for cable in range(1, count + 1)]
    return np.array([mujoco.mj_name2id(model, kind.value, each) for each in names], dtype=int)


def toward_anchors(model: mujoco.MjModel, data: mujoco.MjData, robot: Robot) -> None:
    """Turn each wheel of a single simulation towards its anchor or first mass, after the platform was placed."""
    swivels = Swivels.of(model, robot.cabling)
    if len(swivels):
        swivels.face(model, data)
        mujoco.mj_kinematics(model, data)


def flipped(
    quaternions: Float[np.ndarray, "*rows 4"], turns: Float[np.ndarray, "*#rows"]
) -> Float[np.ndarray, "*rows 4"]:
    """Wheels of a planar robot, turned about to the other side of their axes where the anchor is there."""
    w, x, y, z = np.moveaxis(quaternions, -1, 0)
    return np.where((np.abs(turns) > np.pi / 2)[..., None], np.stack([-z, y, -x, w], axis=-1), quaternions)


def _load(robot: Robot) -> float:
    """The platform's weight [N], with or without gravity."""
    return robot.mass * (robot.gravity or STANDARD_GRAVITY)


@functools.lru_cache(maxsize=64)
def _sides(*axis: float) -> Float[np.ndarray, "2 3"]:
    """Unit vectors x and y such that (x, y, axis) is a right-handed frame; x lies in a planar robot's plane."""
    x = np.cross([0.0, 1.0, 0.0] if abs(axis[1]) < 0.9 else [1.0, 0.0, 0.0], axis)
    x /= magnitude(x)
    return frozen(np.array([x, np.cross(axis, x)]))

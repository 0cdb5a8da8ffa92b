"""A cable with mass in MuJoCo: a chain of segments that pull and never push, with point masses between them.

The lengths of segments are the weights of Gauss and Legendre's quadrature times the rest length; each is a tendon like
that of a massless cable, ``springlength="0 l"`` and ``stiffness`` EA/l. Each mass between them is the mass of the cable
between two of the quadrature's points; the mass beyond the last point is at the anchor. The ends of the chain are then
accurate to the order of that quadrature: with six segments the error is 1e-8 of the length where the horizontal tension
is the cable's weight, and 4e-12 where it is twice the weight (``scripts/measure_constants.py``). In chains of equal
segments the error falls only with the square of their number.

For a cable that bends sharply such a division has errors of percents: a slack chain is divided again when it hangs,
more finely where it bends, and then has an error of at most 3e-7, unless it bends more sharply than ``SHARPEST``.

The masses are branches of the platform: each moves on three slide joints relative to its neighbour on the side of the
anchor, so that a coordinate is a segment's own extent, in the platform's frame, and only the first segment is attached
to the world. MuJoCo's implicit integrator takes account of damping, but not of the transverse stiffness of a taut
string. So damping replaces it: of the slides, for the segments between masses; of three tendons to distant points,
``brake_1_x`` and so on, for the segment at the exit. All damping depends on velocities only and does not change the
equilibrium.
"""

# pyright: reportAttributeAccessIssue=false
# mujoco ships no type stubs for its compiled modules.
from __future__ import annotations

import xml.etree.ElementTree as ET
from dataclasses import dataclass
from functools import cache
from typing import NamedTuple

import mujoco
import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.spatial.transform import RigidTransform

from cdpr_sim.core.cable import Cabling
from cdpr_sim.core.errors import InvalidInput
from cdpr_sim.core.robot import Robot
from cdpr_sim.physics.number_format import LEAST_INERTIA, magnitude, text

SEGMENTS = 6
"""Number of segments of a chain."""

SHARPEST = 0.02
"""Sharpest bend for which a chain is divided, as a fraction of its length: segments get no smaller."""

STRAIGHT = 2.0
"""Horizontal tension, in weights of the chain, above which it is divided like a straight one: the error is then
4e-12."""

LEAST_MASS = 1e-14
"""[kg] Smallest point mass: ten times the smallest that MuJoCo accepts."""

LAYINGS, SHORTER = 60, 10
"""Largest number of Newton steps to lay out a chain, and of halvings of each. A few suffice."""

CLOSED, LEAST_PULL = 1e-13, 1e-12
"""Largest distance of a chain's end from its exit, as a fraction of its length; and the smallest pull [N] with a
direction."""

FAR = 1e4
"""Distance of a brake's other end, in rest lengths: at that distance, directions do not change."""

SHALLOWEST = 0.1
"""Smallest chord, in rest lengths, in the formula for a chain's first profile."""


def refuse_weight(robot: Robot, doing: str) -> None:
    """Refuse cables with mass where mass is not taken into account.

    Raises:
        InvalidInput: a robot whose cables have mass.
    """
    if not robot.cabling.massless:
        raise InvalidInput(
            f"linear_density: found {robot.cabling.linear_density.max():g} kg/m, expected massless cables: "
            f"{doing} does not take account of their mass"
        )


class ChainDivision(NamedTuple):
    """ChainDivision of chains from exit to anchor: segments' lengths, and masses, the one at the anchor last.

    As fractions of the whole. The missing mass would be at the exit.
    """

    lengths: Float[np.ndarray, "#chains segments"]
    masses: Float[np.ndarray, "#chains points"]


@cache
def straight() -> ChainDivision:
    """ChainDivision by the quadrature along the cable."""
    points, weights = _quadrature()
    return ChainDivision(weights[None] / 2, np.diff((points + 1) / 2, append=1.0)[None])


def divisions(level: Float[np.ndarray, " chains"], bend: Float[np.ndarray, " chains"]) -> ChainDivision:
    """Divisions of chains with bends: by the quadrature in u, with level + bend sinh(u) the position along the cable.

    So they are divided more finely where they bend. Chains that hardly bend are divided like straight ones.

    Args:
        level: position along each chain, from the exit, where it is horizontal, as a fraction of its length.
        bend: distance from there to where its slope is 45 degrees.
    """
    points, weights = _quadrature()
    level, bend = level[:, None], np.maximum(bend, SHARPEST)[:, None]
    first, last = np.arcsinh(-level / bend), np.arcsinh((1 - level) / bend)
    u = (first + last + (last - first) * points) / 2
    lengths = weights * np.cosh(u)
    bent = ChainDivision(lengths / lengths.sum(1, keepdims=True), np.diff(level + bend * np.sinh(u), append=1.0))
    return ChainDivision(*(np.where(bend < STRAIGHT, *both) for both in zip(bent, straight(), strict=True)))


@cache
def _quadrature() -> tuple[Float[np.ndarray, " points"], Float[np.ndarray, " points"]]:
    """Points from -1 to 1, and weights; rounded, since the last digits differ between versions of NumPy."""
    points, weights = np.polynomial.legendre.leggauss(SEGMENTS)
    return np.round(points, 14), np.round(weights, 14)


def shape(start: Float[np.ndarray, "3"], end: Float[np.ndarray, "3"], rest_length: float) -> Float[np.ndarray, "n 3"]:
    """Initial profile of a chain: its segments, from exit to anchor, straight or sagging along a parabola.

    Its length is approximately that of the cable; MuJoCo then computes the true profile.
    """
    (parts,) = straight().lengths
    s = np.append(0.0, np.cumsum(parts))
    chord = magnitude(end - start)
    sag = np.sqrt(3 / 8 * max(rest_length - chord, 0.0) * max(chord, SHALLOWEST * rest_length))
    places = start + s[:, None] * (end - start)
    places[:, 2] -= 4 * sag * s * (1 - s)
    return np.diff(places, axis=0)


def extents(
    robot: Robot, pose: RigidTransform, rest_lengths: Float[np.ndarray, " cables"]
) -> Float[np.ndarray, "chains nodes 3"]:
    """The slides' coordinates with the platform at ``pose``: per cable with mass, from anchor to first mass."""
    anchors = pose.apply(robot.anchors)
    rows = [shape(robot.exits[i], anchors[i], rest_lengths[i]) for i in np.flatnonzero(robot.cabling.linear_density)]
    inwards = -np.array(rows).reshape(-1, SEGMENTS, 3)[:, :0:-1]
    return pose.rotation.inv().apply(inwards.reshape(-1, 3)).reshape(inwards.shape)


def add_chains(
    platform: ET.Element, robot: Robot, pose: RigidTransform, rest_lengths: Float[np.ndarray, " cables"], step: float
) -> list[float]:
    """The masses ``node_1_4``, ..., ``node_1_1`` of each cable with mass, from the anchor; returns their coordinates.

    Args:
        platform: body of which they are branches.
        robot: the robot.
        pose: pose at which the platform is written.
        rest_lengths: (cables,) [m].
        step: the time step [s] that determines the damping.

    Raises:
        InvalidInput: a cable with too small a mass.
    """
    cabling = robot.cabling
    (lengths,), (parts,) = straight()
    coordinates = extents(robot, pose, rest_lengths)
    for cable, extent in zip(np.flatnonzero(cabling.linear_density), coordinates, strict=True):
        i, length = cable + 1, rest_lengths[cable]
        masses = cabling.linear_density[cable] * length * parts
        if masses.min() < LEAST_MASS:
            raise InvalidInput(
                f"linear_density: found {cabling.linear_density[cable]:g} kg/m in cable {i}, {length:g} m long, "
                "expected 0 or more than that: MuJoCo does not accept smaller masses"
            )
        _point(platform, f"end_{i}", cabling.anchors[cable], masses[-1])
        parent, place = platform, cabling.anchors[cable]
        for k, along in zip(range(SEGMENTS - 1, 0, -1), extent, strict=True):
            parent = _point(parent, f"node_{i}_{k}", place + along, masses[k - 1])
            damping = plucked(step, robot.weight, lengths[k] * length)
            for axis, name in enumerate("xyz"):
                slide = ET.SubElement(parent, "joint", name=f"{name}_{i}_{k}", type="slide")
                slide.set("axis", text(np.eye(3)[axis]))
                slide.set("ref", text(along[axis]))
                slide.set("damping", text(damping))
            ET.SubElement(parent, "site", {"name": f"node_{i}_{k}", "class": "guide"})
            place = np.zeros(3)
    return list(coordinates.ravel())


def add_far(world: ET.Element, cabling: Cabling, rest_lengths: Float[np.ndarray, " cables"]) -> None:
    """The far ends ``far_1_x``, ... of the brakes."""
    for cable in np.flatnonzero(cabling.linear_density):
        for axis, name in enumerate("xyz"):
            far = ET.SubElement(world, "site", {"name": f"far_{cable + 1}_{name}", "class": "guide"})
            far.set("pos", text(cabling.exits[cable] + FAR * rest_lengths[cable] * np.eye(3)[axis]))


def add_segments(tendons: ET.Element, robot: Robot, cable: int, rest_length: float, step: float) -> None:
    """The tendons ``cable_1_1``, ..., from exit to anchor, of one cable with mass, its brakes, and ``chord_1``.

    Their damping is for the time step ``step`` [s] of a model that is only stepped. It also damps slack segments, which
    slows them down and does not change the equilibrium.
    """
    (parts,) = straight().lengths
    i = cable + 1
    sites = [f"exit_{i}", *(f"node_{i}_{k}" for k in range(1, SEGMENTS)), f"anchor_{i}"]
    for k in range(1, SEGMENTS + 1):
        length = parts[k - 1] * rest_length
        stiffness = robot.axial_stiffness[cable] / length
        segment = ET.SubElement(tendons, "spatial", {"name": f"cable_{i}_{k}", "class": "cable"})
        segment.set("stiffness", text(stiffness))
        segment.set("springlength", text([0, length]))
        segment.set("damping", text(step * stiffness))
        for site in sites[k - 1 : k + 1]:
            ET.SubElement(segment, "site", site=site)
    for axis in "xyz":
        brake = ET.SubElement(tendons, "spatial", name=f"brake_{i}_{axis}", group="4")
        brake.set("damping", text(plucked(step, robot.weight, parts[0] * rest_length)))
        for site in (f"far_{i}_{axis}", sites[1]):
            ET.SubElement(brake, "site", site=site)
    chord = ET.SubElement(tendons, "spatial", name=f"chord_{i}", group="4")
    for site in (sites[0], sites[-1]):
        ET.SubElement(chord, "site", site=site)


def plucked(
    step: float, tension: float | Float[np.ndarray, "*#n"], length: float | Float[np.ndarray, "*#n"]
) -> Float[np.ndarray, "*n"]:
    """Damping [N s/m] with the same effect in a time step as the transverse stiffness of a segment of this length."""
    return np.asarray(step * tension / length)


@dataclass(frozen=True)
class Chains:
    """Indices in a model of its cables with mass, one row for each.

    Attributes:
        cables: indices of the cables.
        segments: tendons from exit to anchor.
        brakes: tendons to distant points.
        chords: tendons from exit to anchor.
        nodes: bodies from anchor to exit.
        ends: bodies at the anchors.
        coordinates: indices of the slides in ``qpos``, from anchor to exit.
        dofs: indices of the slides in ``qvel``.
    """

    cables: Int[np.ndarray, " chains"]
    segments: Int[np.ndarray, "chains segments"]
    brakes: Int[np.ndarray, "chains 3"]
    chords: Int[np.ndarray, " chains"]
    nodes: Int[np.ndarray, "chains nodes"]
    ends: Int[np.ndarray, " chains"]
    coordinates: Int[np.ndarray, "chains nodes 3"]
    dofs: Int[np.ndarray, "chains nodes 3"]

    @classmethod
    def of(cls, model: mujoco.MjModel, cabling: Cabling) -> Chains:
        """The indices, by name."""
        cables, inwards = np.flatnonzero(cabling.linear_density), range(SEGMENTS - 1, 0, -1)

        def ids(kind: mujoco.mjtObj, names: list[str]) -> Int[np.ndarray, "..."]:
            found = np.array([mujoco.mj_name2id(model, kind.value, name) for name in names], dtype=int)
            if (found < 0).any():
                missing = names[int(np.argmin(found))]
                raise InvalidInput(
                    f"model: found no {missing!r}, expected the names that to_mjcf gives cables with mass"
                )
            return found.reshape(len(cables), -1)

        bodies, tendons, joints = mujoco.mjtObj.mjOBJ_BODY, mujoco.mjtObj.mjOBJ_TENDON, mujoco.mjtObj.mjOBJ_JOINT
        numbers = cables + 1
        slides = ids(joints, [f"{axis}_{i}_{k}" for i in numbers for k in inwards for axis in "xyz"])
        slides = slides.reshape(len(cables), SEGMENTS - 1, 3)
        return cls(
            cables=cables,
            segments=ids(tendons, [f"cable_{i}_{k}" for i in numbers for k in range(1, SEGMENTS + 1)]),
            brakes=ids(tendons, [f"brake_{i}_{axis}" for i in numbers for axis in "xyz"]),
            chords=ids(tendons, [f"chord_{i}" for i in numbers])[:, 0],
            nodes=ids(bodies, [f"node_{i}_{k}" for i in numbers for k in inwards]),
            ends=ids(bodies, [f"end_{i}" for i in numbers])[:, 0],
            coordinates=model.jnt_qposadr[slides],
            dofs=model.jnt_dofadr[slides],
        )

    def let_out(
        self,
        model: mujoco.MjModel,
        cabling: Cabling,
        axial_stiffness: Float[np.ndarray, " cables"],
        rest_lengths: Float[np.ndarray, " cables"],
        division: ChainDivision,
    ) -> None:
        """Set a model's cables with mass to these rest lengths: springs and masses. ``mj_setConst`` has to follow."""
        lengths = rest_lengths[self.cables, None]
        model.tendon_lengthspring[self.segments, 1] = division.lengths * lengths
        model.tendon_stiffness[self.segments] = axial_stiffness[self.cables, None] / (division.lengths * lengths)
        masses = cabling.linear_density[self.cables, None] * lengths * division.masses
        model.body_mass[self.nodes] = masses[:, -2::-1]
        model.body_mass[self.ends] = masses[:, -1]

    def hung(
        self, model: mujoco.MjModel, pulls: Float[np.ndarray, "chains 3"], spans: Float[np.ndarray, "chains 3"]
    ) -> tuple[Float[np.ndarray, "chains nodes 3"], Bool[np.ndarray, " chains"]]:
        """Extents from anchor to first mass, base frame, of hanging chains, and whether they reach their exits.

        Each segment is parallel to its own pull, which changes from segment to segment by the weights of the masses,
        and is stretched by it; Newton's method finds the pulls on the anchors with which the chains reach their exits.
        These are only initial positions of the masses: whether they are in equilibrium there is decided in MuJoCo. A
        folded chain, with a segment that is not taut, has no such pulls and is not computed.

        Args:
            model: with springs and masses.
            pulls: approximate pulls on the anchors [N].
            spans: vectors from anchors to exits [m].
        """
        masses = np.concatenate([model.body_mass[self.ends, None], model.body_mass[self.nodes]], axis=1)
        hanging = -masses.cumsum(1)[..., None] * model.opt.gravity
        rest = model.tendon_lengthspring[self.segments[:, ::-1], 1][..., None]
        give = 1 / model.tendon_stiffness[self.segments[:, ::-1]][..., None]

        def laid(pulls: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
            each = pulls[:, None] + hanging
            size = np.maximum(np.linalg.norm(each, axis=2, keepdims=True), LEAST_PULL)
            along = each / size
            segments = (rest + give * size) * along
            turning = rest / size
            slope = ((give + turning).sum(1)[..., None]) * np.eye(3) - np.einsum(
                "ns,nsi,nsj->nij", turning[..., 0], along, along
            )
            return segments, spans - segments.sum(1), slope

        # The pulls are the least of a convex function, whose slope jumps by a segment's length where nothing pulls the
        # segment: it is least there where the others leave no more than that length to span.
        folded = np.zeros(len(pulls), dtype=bool)
        for segment in range(SEGMENTS):
            _, off, _ = laid(-hanging[:, segment])
            folded |= np.linalg.norm(off, axis=1) <= rest[:, segment, 0]
        segments, off, slope = laid(pulls)
        found = np.zeros(len(pulls), dtype=bool)
        for _ in range(LAYINGS):
            found = np.linalg.norm(off, axis=1) <= CLOSED * rest.sum(1)[:, 0]
            if (found | folded).all():
                break
            step = np.linalg.solve(slope, off[..., None])[..., 0]
            for _ in range(SHORTER):
                worse = np.linalg.norm(laid(pulls + step)[1], axis=1) > np.linalg.norm(off, axis=1)
                if not (worse & ~folded).any():
                    break
                step[worse] *= 0.5
            pulls = pulls + step
            segments, off, slope = laid(pulls)
        return segments[:, :-1], found


def _point(parent: ET.Element, name: str, position: Float[np.ndarray, "3"], mass: float) -> ET.Element:
    body = ET.SubElement(parent, "body", name=name, pos=text(position))
    ET.SubElement(body, "inertial", pos="0 0 0", mass=text(mass), diaginertia=text([LEAST_INERTIA] * 3))
    return body

"""A cable with mass in MuJoCo: a chain of segments that pull and never push, with point masses between them.

The lengths of segments are the weights of Gauss and Legendre's quadrature times the rest length; each is a tendon like
that of a massless cable, ``springlength="0 l"`` and ``stiffness`` EA/l. Each mass between them is the mass of the cable
between two of the quadrature's points; the mass beyond the last point is at the anchor. The ends of the chain are then
accurate to the order of that quadrature: with six segments the error is 1e-8 of the length where the horizontal tension
is the cable's weight, and 4e-12 where it is twice the weight (``scripts/dev/measure_constants.py``). In chains of equal
segments the error falls only with the square of their number.

For a cable that bends sharply such a division has errors of percents: a slack chain is divided again when it hangs,
more finely where it bends, and then has an error of at most 3e-7, unless it bends more sharply than ``SHARPEST``.

Over a pulley (``pulleys``) the first tendon begins at the entry, wraps the wheel and ends at the first mass, which the
wheel faces. It is longer by the entry and by what lies on the wheel (``Robot.wrapped_lengths``), which has no mass. Its
quadrature is Gauss and Radau's with one point fixed at the exit: the tension of the first segment is then that of the
cable where it leaves the wheel. With Gauss and Legendre's points it is that at the first of them: an error of 5e-8 m
on a crane. The rule is of one order less: a slack chain over a wheel, divided where it bends, has an error of 1e-7 of
its length where the horizontal tension is a tenth of its weight, and of 1e-5 at ``SHARPEST``. The first segment must
reach beyond the wheel (``too_short``).

What is rigid at the anchor lies along the cable's tension there. It lengthens the last segment of a quadrature with a
point fixed at the anchor, whose tension is that one: no mass is beyond it. With points fixed at both ends it is Gauss
and Lobatto's.

A nonlinear law is that of ``cable``, for each segment.

In a model with winches, or without the damping that lets it settle, one tendon ``cable_1`` through all masses is the
spring of the whole cable, or what its winch pulls: as ``winches`` says, with one control for each cable. Constraints
keep the segments' lengths in proportion (``add_proportions``). The masses are those of the written lengths.

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
from cdpr_sim.core.problem import Problem
from cdpr_sim.core.robot import Robot
from cdpr_sim.physics import pulleys
from cdpr_sim.physics.cable import Law, Springs
from cdpr_sim.physics.number_format import LEAST_INERTIA, add, add_inertia

SEGMENTS = 6
"""Number of segments of a chain."""

SHARPEST = 0.02
"""Sharpest bend for which a chain is divided, as a fraction of its length: segments get no smaller."""

STRAIGHT = 2.0
"""Horizontal tension, in weights of the chain, above which it is divided like a straight one: the error is then
4e-12."""

LEAST_MASS = 1e-14
"""[kg] Smallest point mass: ten times the smallest that MuJoCo accepts."""

LAYINGS, SHORTER, CLOSER = 60, 40, 1e-4
"""Largest number of Newton steps to lay out a chain, and of halvings of each, of which a few suffice; and the least
decrease of energy in a step, as a fraction of that of its beginning."""

LONGER = 4.0
"""Factor of a step's share of Newton's for the next one, where a step had to be that short."""

SHARPER = 0.1
"""Factor of a rounded edge's radius after a step."""

CLOSED, NEARLY, LEAST_PULL = 1e-13, 100.0, 1e-12
"""Largest distance of a chain's end from its exit, as a fraction of its length; how many times as far it may be if
rounding lets it come no closer; and the smallest pull with a direction, as a fraction of the chain's weight."""

ROUNDED = 1e-14
"""A smaller change of energy, as a fraction, may be rounding."""

WRAP_MARGIN = 0.5
"""[rad] By how much more than at the middle of the workspace a cable may wrap its wheel before the first mass of its
chain touches it."""

FLAT = 1e-12
"""Least sine of the angle between a wheel's axis and a chain that leaves it: along the axis, none is outwards."""


FAR = 1e4
"""Distance of a brake's other end, in rest lengths: at that distance, directions do not change."""

PROPORTIONAL = (0.9999, 0.9999, 0.001, 0.5, 2)
"""``solimp`` of the constraints that keep segments proportional: they give way by 1e-3 of what they do by default."""

SHALLOWEST = 0.1
"""Smallest chord, in rest lengths, in the formula for a chain's first profile."""


def first_stiffness(root: ET.Element, cable: int) -> float:
    """Stiffness of the first tendon of a chain in a model [N/m]; 0 without a chain of springs."""
    first = root.find(f"tendon/spatial[@name='cable_{cable + 1}_1']")
    return 0.0 if first is None else float(first.get("stiffness", "0").split()[0])


def least_lengths(robot: Robot) -> Float[np.ndarray, " cables"]:
    """Rest lengths from which the first mass of a chain does not touch its wheel [m]."""
    cabling = robot.cabling
    return cabling.least_lengths + robot.wrapped_lengths + WRAP_MARGIN * SEGMENTS**2 * cabling.pulley_radius


def too_short(robot: Robot, rest_lengths: Float[np.ndarray, "*batch cables"]) -> Bool[np.ndarray, "*batch cables"]:
    """Which chains are so short for their wheels that the first mass might touch them."""
    return robot.cabling.with_mass & robot.cabling.pulleys & (rest_lengths < least_lengths(robot))


def refuse_short(robot: Robot, rest_lengths: Float[np.ndarray, " cables"]) -> None:
    """Refuse chains that are ``too_short``.

    Raises:
        InvalidInput: a cable with mass over a pulley is too short for a chain.
    """
    short = too_short(robot, rest_lengths)
    if short.any():
        cable = int(np.argmax(short))
        raise InvalidInput(
            f"rest_lengths: found {rest_lengths[cable]:g} m in cable {cable + 1}, with mass and over a pulley of "
            f"{robot.cabling.pulley_radius[cable]:g} m, expected at least {least_lengths(robot)[cable]:.3g} m: in "
            "MuJoCo its chain's first mass could touch the wheel"
        )


class ChainDivision(NamedTuple):
    """Division of chains from exit to anchor: segments' lengths, and masses, the one at the anchor last.

    As fractions of the cable that has mass. The missing mass would be at the exit.
    """

    lengths: Float[np.ndarray, "*rows #chains segments"]
    masses: Float[np.ndarray, "*rows #chains points"]


def straight(ends: Int[np.ndarray, " chains"]) -> ChainDivision:
    """Divisions by the quadrature along the cable, for chains with these ``fixed_ends``."""
    points, weights = _quadrature(ends)
    return ChainDivision(weights / 2, np.diff((points + 1) / 2, append=1.0))


def divisions(
    level: Float[np.ndarray, "*rows chains"],
    bend: Float[np.ndarray, "*rows chains"],
    ends: Int[np.ndarray, " chains"],
) -> ChainDivision:
    """Divisions of chains with bends: by the quadrature in u, with level + bend sinh(u) the position along the cable.

    So they are divided more finely where they bend. Chains that hardly bend are divided like straight ones.

    Args:
        level: position along each chain, from the exit, where it is horizontal, as a fraction of its length.
        bend: distance from there to where its slope is 45 degrees.
        ends: the chains' ``fixed_ends``.
    """
    points, weights = _quadrature(ends)
    level, bend = level[..., None], np.maximum(bend, SHARPEST)[..., None]
    first, last = np.arcsinh(-level / bend), np.arcsinh((1 - level) / bend)
    u = (first + last + (last - first) * points) / 2
    lengths = weights * np.cosh(u)
    bent = ChainDivision(lengths / lengths.sum(-1, keepdims=True), np.diff(level + bend * np.sinh(u), append=1.0))
    return ChainDivision(*(np.where(bend < STRAIGHT, *both) for both in zip(bent, straight(ends), strict=True)))


def ends_of(cabling: Cabling) -> Int[np.ndarray, " chains"]:
    """``fixed_ends`` of the cables with mass.

    A wheel, the rope behind, a frame that gives way and a memory feel the tension at the exit; what is rigid at the
    anchor, that there.
    """
    at_exit = cabling.pulleys | (cabling.behind > 0) | cabling.moving_exits | cabling.has_memory
    return fixed_ends(at_exit, Law.of(cabling).rigid > 0)[cabling.with_mass]


def fixed_ends(at_exit: Bool[np.ndarray, " chains"], at_anchor: Bool[np.ndarray, " chains"]) -> Int[np.ndarray, "..."]:
    """Numbers of the quadratures of chains whose first or last segments need the tension at the very end."""
    return at_exit + 2 * at_anchor


def _quadrature(ends: Int[np.ndarray, " chains"]) -> tuple[Float[np.ndarray, "chains points"], ...]:
    """Points from -1 to 1, and weights, by ``fixed_ends``: Gauss and Legendre's, Radau's at either end, Lobatto's."""
    return tuple(both[ends] for both in _quadratures())


@cache
def _quadratures() -> tuple[Float[np.ndarray, "4 points"], Float[np.ndarray, "4 points"]]:
    """All four; rounded, since the last digits differ between versions of NumPy."""
    legval = np.polynomial.legendre.legval
    points, weights = np.polynomial.legendre.leggauss(SEGMENTS)
    last = np.eye(SEGMENTS + 1)[SEGMENTS - 1]  # coefficients of the Legendre polynomial of one degree less
    radau = np.polynomial.legendre.legroots(last + np.eye(SEGMENTS + 1)[SEGMENTS]).real  # complex from NumPy 2.5 on
    radau[0] = -1.0
    slopes = (1 - radau) / (SEGMENTS * legval(radau, last)) ** 2
    inner = np.polynomial.legendre.legroots(np.polynomial.legendre.legder(last)).real
    lobatto = np.concatenate([[-1.0], inner, [1.0]])
    both = 2 / (SEGMENTS * (SEGMENTS - 1) * legval(lobatto, last) ** 2)
    return np.round([points, radau, -radau[::-1], lobatto], 14), np.round([weights, slopes, slopes[::-1], both], 14)


def cut(
    robot: Robot, rest_lengths: Float[np.ndarray, "*rows cables"], division: ChainDivision | None = None
) -> tuple[Float[np.ndarray, "*rows chains segments"], Float[np.ndarray, "*rows chains points"]]:
    """Rest lengths [m] of the segments from exit to anchor, what lies on the wheel included; and the masses [kg].

    Of all cables with mass; the default is the ``straight`` division.
    """
    cables = np.flatnonzero(robot.cabling.with_mass)
    division = straight(ends_of(robot.cabling)) if division is None else division
    wrapped = robot.wrapped_lengths[cables]
    weighing = (Law.of(robot.cabling).ropes(rest_lengths)[..., cables] - wrapped)[..., None]
    lengths = division.lengths * weighing
    lengths[..., 0] += wrapped
    lengths[..., -1] += Law.of(robot.cabling).rigid[cables]
    densities = robot.cabling.pulls(robot.cabling.linear_density)  # with all parts of line
    return lengths, densities[cables, None] * weighing * division.masses


def shape(
    starts: Float[np.ndarray, "*rows chains 3"],
    ends: Float[np.ndarray, "*rows chains 3"],
    rest_lengths: Float[np.ndarray, "*rows chains"],
    parts: Float[np.ndarray, "*#rows chains segments"],
) -> Float[np.ndarray, "*rows chains segments 3"]:
    """Initial profiles of chains: their segments, from exits or wheels to anchors, straight or along parabolas.

    Their lengths are approximately those of the cables; MuJoCo then computes the true profiles.
    """
    s = np.cumsum(np.insert(parts, 0, 0.0, axis=-1), axis=-1)
    spans = ends - starts
    chords = np.sqrt((spans * spans).sum(-1))  # without BLAS: models are written with these digits
    sags = np.sqrt(3 / 8 * np.maximum(rest_lengths - chords, 0) * np.maximum(chords, SHALLOWEST * rest_lengths))
    places = starts[..., None, :] + s[..., None] * spans[..., None, :]
    places[..., 2] -= 4 * sags[..., None] * s * (1 - s)
    return np.diff(places, axis=-2)


def expected_pulls(
    spans: Float[np.ndarray, "*rows chains 3"],
    strains: Float[np.ndarray, "*rows chains"],
    stiffness: Float[np.ndarray, "*rows chains"],
    weights: Float[np.ndarray, "*rows chains 3"],
) -> Float[np.ndarray, "*rows chains 3"]:
    """Approximate pulls of chains on their anchors [N], with which to begin to lay them out: those of flat parabolas.

    T, the tension in the middle, stretches a cable by T/EA and lets it sag by (weight across/T)²/24, as fractions of
    its length. Where one of the two is small, T follows from the other.

    Args:
        spans: vectors from anchors to exits [m].
        strains: of straight cables there, below 0 where they sag.
        stiffness: EA [N].
        weights: of the cables [N].
    """
    along = spans / np.linalg.norm(spans, axis=-1, keepdims=True)
    across = weights - np.vecdot(weights, along)[..., None] * along
    sagging = np.vecdot(across, across) / 24
    just_taut = np.cbrt(stiffness * sagging)
    looser = np.sqrt(sagging / np.where(strains < 0, -strains, 1.0))
    tensions = np.where(strains < 0, np.minimum(looser, just_taut), np.maximum(stiffness * strains, just_taut))
    return tensions[..., None] * along + weights / 2


def extents(
    robot: Robot, pose: RigidTransform, rest_lengths: Float[np.ndarray, " cables"]
) -> Float[np.ndarray, "chains nodes 3"]:
    """The slides' coordinates with the platform at ``pose``: per cable with mass, from anchor to first mass."""
    inwards = profiles(robot, pose.apply(robot.anchors), rest_lengths)
    return pose.rotation.inv().apply(inwards.reshape(-1, 3)).reshape(inwards.shape)


def profiles(
    robot: Robot, anchors: Float[np.ndarray, "*rows cables 3"], rest_lengths: Float[np.ndarray, "*rows cables"]
) -> Float[np.ndarray, "*rows chains nodes 3"]:
    """Extents of initial profiles from anchor to first mass, base frame, of cables with mass to these ``anchors``."""
    cables = np.flatnonzero(robot.cabling.with_mass)
    starts, ends = pulleys.departures(robot, anchors)[..., cables, :], anchors[..., cables, :]
    free = (rest_lengths - robot.wrapped_lengths)[..., cables]
    rope = (1 - Law.of(robot.cabling).rigid[cables] / free)[..., None]
    parts = straight(ends_of(robot.cabling)).lengths * rope
    parts[..., -1:] += 1 - rope
    return -shape(starts, ends, free, parts)[..., :0:-1, :]


def add_chains(
    world: ET.Element,
    platform: ET.Element,
    tendon: ET.Element,
    problem: Problem,
    step: float | None,
    damping: Float[np.ndarray, " cables"] | None,
) -> list[float]:
    """The chain of each cable with mass; returns the coordinates of all masses.

    Its masses are ``node_1_4``, ..., ``node_1_1``, from the anchor; its tendons ``cable_1_1``, ..., from the exit,
    ``chord_1``, and the brakes with their far ends ``far_1_x``, ....

    Args:
        world: body of the far ends.
        platform: body of which the masses are branches.
        tendon: element of the tendons.
        problem: the robot with the pose and the rest lengths of the model.
        step: the time step [s] of a model that is only stepped, for which springs are damped. That also damps slack
            segments, which slows them down and does not change the equilibrium. None where the tendon ``cable_1`` is
            the spring of the whole cable (``add_proportions``).
        damping: ``plucked`` of segments of unit length, (cables,) [N s]; None for none, and no brakes.

    Raises:
        InvalidInput: a cable with too small a mass.
    """
    robot, cabling = problem.robot, problem.robot.cabling
    cables, entries = np.flatnonzero(cabling.with_mass), pulleys.entries(cabling)
    coordinates, (divided, points) = (
        extents(robot, problem.pose, problem.rest_lengths),
        cut(robot, problem.rest_lengths),
    )
    springs = Law.of(cabling).some(cables).segments(divided)
    rows = zip(cables, coordinates, divided, points, springs.stiffness, springs.polynomial, strict=True)
    for cable, extent, lengths, masses, stiffnesses, further in rows:
        i, length = int(cable) + 1, problem.rest_lengths[cable]
        over, nonlinear = bool(cabling.pulleys[cable]), bool(cabling.nonlinear[cable])
        if masses[masses != 0].min() < LEAST_MASS:  # none is at the anchor of a cable that is rigid there
            raise InvalidInput(
                f"linear_density: found {cabling.linear_density[cable]:g} kg/m in cable {i}, {length:g} m long, "
                "expected 0 or more than that: MuJoCo does not accept smaller masses"
            )
        _point(platform, f"end_{i}", cabling.anchors[cable], max(masses[-1], LEAST_MASS))
        parent, place = platform, cabling.anchors[cable]
        for k, along in zip(range(SEGMENTS - 1, 0, -1), extent, strict=True):
            parent = _point(parent, f"node_{i}_{k}", place + along, masses[k - 1])
            drag = None if damping is None else damping[cable] / lengths[k]
            for name, axis, at in zip("xyz", ("1 0 0", "0 1 0", "0 0 1"), along, strict=True):
                add(parent, "joint", name=f"{name}_{i}_{k}", type="slide", axis=axis, ref=at, damping=drag)
            add(parent, "site", {"name": f"node_{i}_{k}", "class": "guide"})
            place = np.zeros(3)
        sites = [f"entry_{i}" if over else f"exit_{i}", *(f"node_{i}_{k}" for k in range(1, SEGMENTS)), f"anchor_{i}"]
        uppers = lengths.copy()
        uppers[0] += entries[cable]
        for k, (stiffness, upper) in enumerate(zip(stiffnesses, uppers, strict=True), start=1):
            segment = add(
                tendon,
                "spatial",
                {"name": f"cable_{i}_{k}", "class": "cable"},
                stiffness=None if step is None else [stiffness, *(further[k - 1] if nonlinear else [])],
                springlength=[0, upper],
                damping=None if step is None else step * stiffness,
            )
            _run(segment, i, sites[k - 1 : k + 1], over and k == 1)
        if damping is not None:
            drag = damping[cable] / (lengths[0] - robot.wrapped_lengths[cable])
            for name, axis in zip("xyz", np.eye(3), strict=True):
                end = cabling.exits[cable] + FAR * length * axis
                add(world, "site", {"name": f"far_{i}_{name}", "class": "guide"}, pos=end)
                brake = add(tendon, "spatial", name=f"brake_{i}_{name}", group=4, damping=drag)
                _run(brake, i, [f"far_{i}_{name}", sites[1]])
        _run(add(tendon, "spatial", name=f"chord_{i}", group=4), i, [sites[0], sites[-1]], over)
    return list(coordinates.ravel())


def add_proportions(root: ET.Element, model: mujoco.MjModel, problem: Problem) -> None:
    """Constraints that keep the segments of a chain proportional, whatever length its winch lets out.

    The spring or actuator of the tendon ``cable_1`` pulls all segments alike, and the constraints add what the weights
    between them need: the mean tension is then that of the cable's mean strain. A chain of springs differs from it by
    the places of its masses, in proportion to the differences of the segments' strains.

    Args:
        root: the model, with segments.
        model: the same, compiled: constraints in MuJoCo are relative to its lengths.
        problem: the robot with the rest lengths of the model.
    """
    robot, cabling = problem.robot, problem.robot.cabling
    cables = np.flatnonzero(cabling.with_mass)
    divided, _ = cut(robot, problem.rest_lengths)
    behind, rigid = pulleys.entries(cabling) + robot.wrapped_lengths, Law.of(cabling).rigid
    parent = ET.SubElement(root, "equality")
    for cable, lengths in zip(cables, divided, strict=True):
        names = [f"cable_{cable + 1}_{k}" for k in range(1, SEGMENTS + 1)]
        written = np.array([model.tendon_length0[model.tendon(name).id] for name in names])
        constant = np.zeros(SEGMENTS)
        constant[0], constant[-1] = behind[cable], rigid[cable]
        lengths[0] -= robot.wrapped_lengths[cable]
        lengths[-1] -= rigid[cable]
        longest = int(np.argmax(lengths))
        ratios = lengths / lengths[longest]
        # Rounded: the last digits of lengths differ between versions of MuJoCo.
        begins = np.round(constant + ratios * written[longest] - written, 12)
        for k, name in enumerate(names):
            if k != longest:
                pair, line = {"tendon1": name, "tendon2": names[longest]}, [begins[k], ratios[k], 0, 0, 0]
                add(parent, "tendon", pair, polycoef=line, solimp=PROPORTIONAL)


def uneven(problem: Problem) -> Float[np.ndarray, " cables"]:
    """How much further cables with mass stretch than under their mean tension, at the pose, (cables,) [m].

    What lies on the wheel and behind the exit has the tension at the exit. That is above the mean by the weight of a
    cable half as long as the exit is above the anchor; by more in cables that sag.
    """
    robot = problem.robot
    rise = robot.exits[:, 2] - problem.pose.apply(robot.anchors)[:, 2]
    more = robot.cable_weights * rise / 2 / Law.of(robot.cabling).strained.stiffness
    return (robot.wrapped_lengths + robot.cabling.behind) * more


def swinging(problem: Problem, pulls: Float[np.ndarray, " cables"]) -> float:
    """An upper bound of the angular frequency of chains across their cables under these ``pulls`` [N], [rad/s].

    Of the largest row sum of stiffness over masses; 0 without chains.
    """
    robot, cables = problem.robot, np.flatnonzero(problem.robot.cabling.with_mass)
    lengths, masses = cut(robot, problem.rest_lengths)
    lengths[:, 0] -= robot.wrapped_lengths[cables]
    across = 2 * pulls[cables, None] * (1 / lengths[:, :-1] + 1 / lengths[:, 1:]) / masses[:, :-1]
    return float(np.sqrt(across.max(initial=0.0)))


def _run(tendon: ET.Element, i: int, sites: list[str], over_wheel: bool = False) -> None:
    """Let a tendon of cable ``i`` run between two sites, over the wheel or straight."""
    add(tendon, "site", site=sites[0])
    if over_wheel:
        pulleys.add_way(tendon, i)
    add(tendon, "site", site=sites[1])


def plucked(
    step: float | Float[np.ndarray, "*#n"],
    tension: float | Float[np.ndarray, "*#n"],
    length: float | Float[np.ndarray, "*#n"],
) -> Float[np.ndarray, "*n"]:
    """Damping [N s/m] with the same effect in a time step as the transverse stiffness of a segment of this length."""
    return np.asarray(step * tension / length)


@dataclass(frozen=True)
class Chains:
    """Indices in a model of its cables with mass, one row for each.

    Attributes:
        cables: indices of the cables.
        entries: difference between the length of each first tendon, and each chord, and the cable's [m].
        segments: tendons from exit to anchor.
        brakes: tendons to distant points.
        chords: tendons from exit to anchor.
        nodes: bodies from anchor to exit.
        ends: bodies at the anchors.
        coordinates: indices of the slides in ``qpos``, from anchor to exit.
        dofs: indices of the slides in ``qvel``.
        over: which chains run over wheels.
        first: bodies of the first masses of those chains.
        grooves: geoms of their wheels.
        radii: radii of the wheels of all chains [m], 0 without one.
        axes: their axes.
    """

    cables: Int[np.ndarray, " chains"]
    entries: Float[np.ndarray, " chains"]
    segments: Int[np.ndarray, "chains segments"]
    brakes: Int[np.ndarray, "chains 3"]
    chords: Int[np.ndarray, " chains"]
    nodes: Int[np.ndarray, "chains nodes"]
    ends: Int[np.ndarray, " chains"]
    coordinates: Int[np.ndarray, "chains nodes 3"]
    dofs: Int[np.ndarray, "chains nodes 3"]
    over: Bool[np.ndarray, " chains"]
    first: Int[np.ndarray, " guided"]
    grooves: Int[np.ndarray, " guided"]
    radii: Float[np.ndarray, " chains"]
    axes: Float[np.ndarray, "chains 3"]

    @classmethod
    def of(cls, model: mujoco.MjModel, cabling: Cabling) -> Chains:
        """The indices, by name."""
        cables, inwards = np.flatnonzero(cabling.with_mass), range(SEGMENTS - 1, 0, -1)

        def ids(kind: mujoco.mjtObj, each: int, names: list[str]) -> Int[np.ndarray, "chains each"]:
            found = np.array([mujoco.mj_name2id(model, kind.value, name) for name in names], dtype=int)
            if (found < 0).any():
                missing = names[int(np.argmin(found))]
                raise InvalidInput(
                    f"model: found no {missing!r}, expected the names that to_mjcf gives cables with mass"
                )
            return found.reshape(len(cables), each)

        bodies, tendons, joints = mujoco.mjtObj.mjOBJ_BODY, mujoco.mjtObj.mjOBJ_TENDON, mujoco.mjtObj.mjOBJ_JOINT
        numbers = cables + 1
        slides = ids(joints, 3 * len(inwards), [f"{axis}_{i}_{k}" for i in numbers for k in inwards for axis in "xyz"])
        slides = slides.reshape(len(cables), SEGMENTS - 1, 3)
        nodes = ids(bodies, len(inwards), [f"node_{i}_{k}" for i in numbers for k in inwards])
        over = cabling.pulleys[cables]
        grooves = [mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_GEOM, f"groove_{i}") for i in numbers[over]]
        return cls(
            cables=cables,
            entries=pulleys.entries(cabling)[cables],
            segments=ids(tendons, SEGMENTS, [f"cable_{i}_{k}" for i in numbers for k in range(1, SEGMENTS + 1)]),
            brakes=ids(tendons, 3, [f"brake_{i}_{axis}" for i in numbers for axis in "xyz"]),
            chords=ids(tendons, 1, [f"chord_{i}" for i in numbers])[:, 0],
            nodes=nodes,
            ends=ids(bodies, 1, [f"end_{i}" for i in numbers])[:, 0],
            coordinates=model.jnt_qposadr[slides],
            dofs=model.jnt_dofadr[slides],
            over=over,
            first=nodes[over, -1],
            grooves=np.array(grooves, dtype=int),
            radii=cabling.pulley_radius[cables],
            axes=cabling.pulley_axis[cables],
        )

    def place(self, model: mujoco.MjModel, data: mujoco.MjData, robot: Robot, pose: RigidTransform) -> None:
        """Put the chains of one simulation in an approximate profile, with the platform at ``pose``."""
        lengths = np.zeros(robot.cables)
        lengths[self.cables] = self.rest_lengths(model.tendon_lengthspring).sum(1)
        data.qpos[self.coordinates] = extents(robot, pose, lengths)

    def rest_lengths(self, bands: Float[np.ndarray, "*rows tendons 2"]) -> Float[np.ndarray, "*rows chains segments"]:
        """Rest lengths of the segments [m], what lies on the wheel included, from MuJoCo's ``tendon_lengthspring``."""
        lengths = bands[..., self.segments, 1]
        lengths[..., 0] -= self.entries
        return lengths


def hang(
    weights: Float[np.ndarray, "chains points 3"],
    rest_lengths: Float[np.ndarray, "chains segments"],
    springs: Springs,
    radii: Float[np.ndarray, " chains"],
    axes: Float[np.ndarray, "chains 3"],
    pulls: Float[np.ndarray, "chains 3"],
    spans: Float[np.ndarray, "chains 3"],
) -> tuple[Float[np.ndarray, "chains nodes 3"], Bool[np.ndarray, " chains"]]:
    """Extents from anchor to first mass, base frame, of hanging chains, and whether they reach their exits.

    Each segment is parallel to its own pull, which changes from segment to segment by the weights of the masses, and is
    stretched by it; Newton's method finds the pulls on the anchors with which the chains reach their exits. With these
    the chain's complementary energy, which is convex in the pull, is least: each step lowers it. A first segment over a
    wheel begins where its direction is a tangent of the wheel, and is shorter by the arc from the exit to there. These
    are only initial positions of the masses: whether they are in equilibrium there is decided in MuJoCo. A folded
    chain, with a segment that is not taut, has no such pulls and is not computed. No chain has an effect on others.

    Args:
        weights: of the masses between segments, and of that at the anchor [N]; from exit to anchor, as all numbers.
        rest_lengths: of the segments [m], the first with what lies on the wheel.
        springs: of the segments, (chains, segments).
        radii: of the wheels, 0 without [m].
        axes: of the wheels.
        pulls: approximate pulls on the anchors [N].
        spans: vectors from anchors to exits [m].
    """
    hanging = -weights[:, ::-1].cumsum(1)
    rest = rest_lengths[:, ::-1, None]
    radii = radii[:, None]
    turned = np.cross(axes[:, None], np.eye(3)).swapaxes(1, 2)  # axes x v = turned @ v
    upwards = springs.some(np.s_[:, ::-1])
    bends = np.ones_like(rest)  # segments whose edges are rounded
    bends[:, -1] = radii == 0
    heaviest = np.linalg.norm(hanging[:, -1], axis=1)
    least = np.maximum(LEAST_PULL * heaviest, np.sqrt(np.finfo(float).tiny))  # no pull has no direction

    def laid(pulls: np.ndarray, some: np.ndarray) -> _Laid:
        each = pulls[..., None, :] + hanging[some]
        floor = np.maximum(soft[some, None, None] * bends[some], least[some, None, None])
        size = np.sqrt(np.vecdot(each, each)[..., None] + floor**2)
        along = each / size
        springs = upwards.some(some)
        stretch, give = springs.stretched(size[..., 0])
        reach = rest[some] + stretch[..., None]
        ahead = -np.vecdot(along[..., -1, :], axes[some])[..., None]
        outwards = -along[..., -1, :] - ahead * axes[some]
        aside = np.sqrt(np.vecdot(outwards, outwards))[..., None]
        outwards = outwards / np.maximum(aside, FLAT)
        reach[..., -1, :] -= radii[some] * np.arctan2(aside, ahead)
        leaving = radii[some] * ((1 - ahead) * outwards + aside * axes[some])  # from the exit
        segments = reach * along
        off = spans[some] + leaving - segments.sum(-2)
        swivelling = radii[some] * (1 - ahead) / np.maximum(aside, FLAT) / size[..., -1, :]
        energy = (size * reach).sum((-2, -1)) - springs.energy(stretch).sum(-1)
        energy -= np.vecdot(each[..., -1, :], leaving) + np.vecdot(pulls, spans[some])
        turning = reach / size
        slope = turning.sum(1)[..., None] * np.eye(3)
        slope += ((give[..., None] - turning) * along).swapaxes(1, 2) @ along
        sideways = turned[some] @ outwards[..., None]
        slope += swivelling[..., None] * sideways * sideways.swapaxes(1, 2)
        return _Laid(segments, off, np.sqrt(np.vecdot(off, off)), energy, slope, np.linalg.det(slope) > 0)

    every, soft = np.arange(len(spans)), np.zeros(len(spans))
    # The energy has an edge where nothing pulls a segment: its slope jumps by twice the segment's length. It is least
    # on the edge if the others leave no more than that length to span.
    folded = np.any([laid(-pull, every).gap <= rest[:, k, 0] for k, pull in enumerate(hanging.swapaxes(0, 1))], axis=0)
    here, close, pulls = laid(pulls, every), CLOSED * rest.sum(1)[:, 0], pulls.copy()
    tried = folded | ~here.regular
    some, begun = np.flatnonzero(~tried), np.ones(len(spans))  # the share of Newton's step that is tried first
    for _ in range(LAYINGS):
        some = some[(here.gap[some] > close[some]) | (soft[some] > 0)]
        if not len(some):
            break
        step = np.linalg.solve(here.slope[some], here.off[some, :, None])[..., 0]
        fall, descends = np.vecdot(step, here.off[some]), np.zeros(len(some), dtype=bool)
        for halved in range(SHORTER):
            left = np.flatnonzero(~descends)
            rows = some[left]
            share = begun[rows] * 0.5**halved
            further = pulls[rows] + share[:, None] * step[left]
            there = laid(further, rows)
            rise = there.energy - here.energy[rows]
            terms = np.abs(there.energy) + np.abs(np.vecdot(further, spans[rows]))
            equal = np.abs(rise) <= ROUNDED * terms
            lower = (rise < -CLOSER * share * fall[left]) | (equal & (there.gap <= here.gap[rows]))
            descends[left] = better = lower & there.regular
            pulls[rows[better]] = further[better]
            begun[rows[better]] = np.minimum(LONGER * share[better], 1.0)
            here.update(rows[better], there, better)
            if descends.all():
                break
        # A chain that is on an edge begins again on a rounded one; any other is as close as rounding permits.
        edge = some[~descends]
        edge = edge[~tried[edge]]
        some = np.union1d(some[descends], edge)
        rounded = soft[some] > 0
        soft[some] *= np.where(soft[some] > least[some], SHARPER, 0.0)
        soft[edge], tried[edge], begun[edge] = heaviest[edge], True, 1.0
        changed = some[rounded | (soft[some] > 0)]
        here.update(changed, laid(pulls[changed], changed))
    return here.segments[:, :-1], here.gap <= NEARLY * close


class _Laid(NamedTuple):
    """Hanging chains for some pulls on their anchors.

    Attributes:
        segments: extents from anchor to exit [m].
        off: vectors from their ends to their exits [m]: minus the slope of the ``energy`` by the pull.
        gap: their lengths [m].
        energy: complementary energy of springs and weights [J].
        slope: its second derivative [m/N].
        regular: whether that is positive: else the first segment does not reach beyond its wheel.
    """

    segments: Float[np.ndarray, "chains segments 3"]
    off: Float[np.ndarray, "chains 3"]
    gap: Float[np.ndarray, " chains"]
    energy: Float[np.ndarray, " chains"]
    slope: Float[np.ndarray, "chains 3 3"]
    regular: Bool[np.ndarray, " chains"]

    def update(self, rows: np.ndarray, others: _Laid, which: np.ndarray | slice = slice(None)) -> None:
        """Replace chains by some ``others``."""
        for mine, new in zip(self, others, strict=True):
            mine[rows] = new[which]


def _point(parent: ET.Element, name: str, position: Float[np.ndarray, "3"], mass: float) -> ET.Element:
    body = add(parent, "body", name=name, pos=position)
    add_inertia(body, mass, LEAST_INERTIA)
    return body

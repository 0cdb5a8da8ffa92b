"""Cables as data: where they run, how stiff they are, their mass per length. Each property is declared once, here.

Its declaration in ``Cables`` gives the checks, a row for each cable, the key in robot files (reading, writing, the
template, the page), JSON, the sentences of ``core.describe``, what a symmetry of a layout compares, and the methods
that take it into account: all others refuse it. ``Robot`` repeats the names as arguments, and a test compares both.

Each method codes the behaviour of cables itself: the mathematics in ``core.cable_path``, ``core.cable_law`` and
``statics.catenary``, the MuJoCo side in ``physics.cable``, ``physics.pulleys`` and ``physics.chains``.
"""

# ruff: noqa: RUF009, since a declaration is the same for all robots

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int

from cdpr_sim.core.checks import MOST_LENGTH, Frozen, checked_array, frozen, in_range
from cdpr_sim.core.errors import InvalidInput
from cdpr_sim.core.property import (
    EVERY,
    Method,
    Property,
    Step,
    above_0,
    but,
    declarations,
    declared,
    from_0,
    near,
    within,
)

EXIT, ANCHOR, STIFFNESS, RADIUS, BEHIND, RIGID, PARTS, WEIGHT, WRAPPED, GIVES = 0, 3, 6, 9, 13, 14, 15, 16, 17, 18
LAW, WHEEL, COLUMNS = RADIUS - STIFFNESS, BEHIND - RADIUS, 21
"""Columns of ``Robot.cable_table``: the first coordinate of the exit and of the anchor, axial stiffness of all parts of
line, with the other numbers of the law behind it, the pulley's radius, with its axis behind it, the length
``Cabling.behind`` the exit, the rigid length, the number of parts of line, ``Robot.cable_weights`` and
``Robot.wrapped_lengths``, the exit's compliance along x, y and z; how many numbers a law and a wheel have, and how many
columns there are."""

DOWN = (0.0, 0.0, -1.0)
"""Default axis of a pulley: the cable arrives downwards, along a mast."""

MOST_STRAIN = 0.2
"""Strain up to which a nonlinear law is defined and must be increasing; no rope survives it."""

MOST_CABLES = 1000
"""Largest number of cables of one robot; real robots have up to some dozens."""

MOST_DENSITY = 1e5
"""[kg/m] Largest linear density; a steel rope of one metre diameter has 6e3."""

LEAST_RADIUS = 1e-6
"""[m] Smallest pulley radius: MuJoCo draws no wheel of a tenth of it, and no real cable bends that sharply."""

MOST_STIFFENING = 1e9
"""Largest magnitude of either coefficient of nonlinear elasticity; measured ones are some hundreds."""

MOST_COMPLIANCE = 1e6
"""[m/N] Largest compliance of an exit; of frames it is below 1e-3, and an exit with 1 hangs freely for all purposes."""

ROUNDING = 4e-16
"""Largest deviation from 1 of the length of a unit vector in double precision."""

MOST_REEVING = 100
"""Largest number of parts of line; large cranes have some dozens."""

MOST_FRICTION = 1.0
"""Largest ``pulley_friction``; a rope on a small wheel loses 0.2 (``docs/concepts/memory.md``)."""

NO_ELEMENT, NO_TERM = (0.0, np.inf, 1.0), (np.inf, 1.0)
"""Element of hysteresis and term of creep without an effect, for cables that have fewer of them than others."""

STIFFNESS_RANGE = (1e-6, 1e15)
"""[N] Range of axial stiffness that is accepted: from spider silk to steel ropes of one metre diameter, and far
beyond."""


KEPT: tuple[Method, ...] = ("statics", "simulation", "closed form")
"""Methods that take a memory into account, or most of it (``Cabling.refuse_memory``)."""

LEAST_STRAIN = 1e-5
"""Strain for the scale of steps of the density where there is less."""


def _step_of_density(robot: Any, strain: np.ndarray, length: np.ndarray) -> np.ndarray:
    """Its own value; without one, a weight of 15 sqrt(strain) of the tension: at a step, (w L/T)²/24 is 1e-5 strain."""
    weight = 15 * robot.axial_stiffness * np.maximum(strain, LEAST_STRAIN) ** 1.5 / length
    return np.where(robot.linear_density > 0, robot.linear_density, weight / max(robot.gravity, 1.0))


def _step_of_law(robot: Any, strain: np.ndarray, length: np.ndarray) -> np.ndarray:
    """Terms as large as the linear one; but of a slack cable none with which tension falls within the law's range."""
    strain = np.where(strain > 0, strain, MOST_STRAIN / 4)
    return np.stack([1 / strain, 1 / strain**2], axis=1)


def _step_of_compliance(robot: Any, strain: np.ndarray, length: np.ndarray) -> np.ndarray:
    """That of the cable itself."""
    return np.repeat((length / robot.axial_stiffness)[:, None], 3, axis=1)


def _point_or_wheel(one: Property, radii: np.ndarray) -> np.ndarray:
    tiny = (radii > 0) & (radii < LEAST_RADIUS)
    if tiny.any():
        cable = int(np.argmax(tiny))
        raise InvalidInput(
            f"{one.name}: found {radii[cable]:g} m in cable {cable + 1}, expected 0, for a point, or at least "
            f"{LEAST_RADIUS:g} m"
        )
    return radii


def _unit(one: Property, axes: np.ndarray) -> np.ndarray:
    in_range(one.name, axes, -MOST_LENGTH, MOST_LENGTH, "")
    lengths = np.linalg.norm(axes, axis=1)
    if not lengths.min() > 0:
        cable = int(np.argmin(lengths))
        raise InvalidInput(f"{one.name}: found an axis of length zero in cable {cable + 1}, expected a direction")
    rounding = np.abs(lengths - 1) < ROUNDING  # a unit vector that is written and read again stays identical
    return axes / np.where(rounding, 1.0, lengths)[:, None]


def _whole_parts(one: Property, parts: np.ndarray) -> np.ndarray:
    wrong = (parts != np.round(parts)) | (parts < 1) | (parts > MOST_REEVING)
    if wrong.any():
        cable = int(np.argmax(wrong))
        raise InvalidInput(
            f"{one.name}: found {parts[cable]:g} parts of line in cable {cable + 1}, expected a whole number from 1 to "
            f"{MOST_REEVING}"
        )
    return parts.astype(int)


def _yielding(one: Property, elements: np.ndarray) -> np.ndarray:
    wrong = (~np.isfinite(elements[..., 0]) | (elements[..., 2] > 1)).any(-1)
    if wrong.any():
        cable = int(np.argmax(wrong))
        raise InvalidInput(
            f"{one.name}: found {elements[cable].tolist()} in cable {cable + 1}, expected (share, yield strain, w) "
            "with a finite share and w of at most 1"
        )
    return elements


def _in_finite_time(one: Property, terms: np.ndarray) -> np.ndarray:
    if not np.isfinite(terms[..., 1]).all():
        raise InvalidInput(f"{one.name}: found an infinite time, expected terms (EA1 [N], tau1 [s]) with a finite time")
    return terms


@dataclass(frozen=True, eq=False)
class Cables:
    """The properties of cables: the shape of each is that of its array, with a row for each cable."""

    # fmt: off
    exits: Float[np.ndarray, "cables 3"] = declared(
        "Exit point A_i in the base frame, z up; over a pulley, where the cable first touches it.",
        "m", key="exit", shape=(3,), checks=(within(-MOST_LENGTH, MOST_LENGTH),), image="point", known_to=EVERY,
        label="exit {cable} {part}",
    )
    anchors: Float[np.ndarray, "cables 3"] = declared(
        "Anchor point B_i in the platform frame.",
        "m", key="anchor", shape=(3,), checks=(within(-MOST_LENGTH, MOST_LENGTH),), image="point", known_to=EVERY,
        label="anchor {cable} {part}",
    )
    axial_stiffness: Float[np.ndarray, " cables"] = declared(
        "Axial stiffness EA.", "N", checks=(above_0, within(*STIFFNESS_RANGE)), known_to=EVERY,
        label="EA of cable {cable}", step=Step(lambda robot, strain, length: robot.axial_stiffness),
    )
    linear_density: Float[np.ndarray, " cables"] = declared(
        'Mass per length; 0 is a massless cable, `"material"` the rope\'s own.',
        "kg/m", 0.0, checks=(from_0, within(0, MOST_DENSITY)),
        known_to=but("proof of completeness", "learning", "closed form"),
        label="mass per length of cable {cable}", step=Step(_step_of_density, least=True),
        example=("0.002", 'kg/m, or "material"; default: massless cables'),
        said=("{} g/m", lambda cabling: 1e3 * cabling.linear_density),
    )
    stiffening: Float[np.ndarray, "cables 2"] = declared(
        "Coefficients (a2, a3) of tension = EA (eps + a2 eps² + a3 eps³), for eps up to 0.2.",
        "", (0.0, 0.0), shape=(2,), checks=(within(-MOST_STIFFENING, MOST_STIFFENING),), known_to=EVERY,
        label="{part} of cable {cable}", parts=("a2", "a3"), step=Step(_step_of_law),
        example=("[50, 0]", "(a2, a3) of tension = EA (eps + a2 eps^2 + a3 eps^3)"),
        said=("nonlinear with a2 = {}, a3 = {}", lambda cabling: cabling.stiffening),
    )
    pulley_radius: Float[np.ndarray, " cables"] = declared(
        "Radius of the wheel; 0 is a point.",
        "m", 0.0, key="pulley.radius", checks=(from_0, near, _point_or_wheel), known_to=but("closed form"),
        step=Step(lambda robot, strain, length: robot.pulley_radius, path=True),
        example=("0.02", "m"), said=("over pulleys of {} mm radius", lambda cabling: 1e3 * cabling.pulley_radius),
    )
    pulley_axis: Float[np.ndarray, "cables 3"] = declared(
        "Direction in which the cable arrives, and about which the wheel swivels.",
        "", DOWN, key="pulley.axis", shape=(3,), checks=(_unit,), image="axis", known_to=EVERY,
        only_with="pulley_radius", example=("[0, 0, 1]", "direction in which the cable arrives: here up a mast"),
    )
    force_min: Float[np.ndarray, " cables"] = declared(
        "Smallest tension that `compensate` and `sweep` keep in a cable.",
        "N", 0.0, checks=(from_0,), image=None, known_to=EVERY,
        example=("10", "N: smallest and largest tension that compensate and sweep keep"),
    )
    force_max: Float[np.ndarray, " cables"] = declared(
        "Largest tension that a cable or its winch allows; by default no limit.",
        "N", np.inf, image=None, known_to=EVERY, example=("700", ""),
    )
    breaking_load: Float[np.ndarray, " cables"] = declared(
        "Smallest tension at which a cable breaks; by default that of its material, if known.",
        "N", np.inf, image=None, known_to=EVERY,
        example=("2300", "N: results report tensions above it; default: the material's"),
    )
    winch_to_exit: Float[np.ndarray, " cables"] = declared(
        "Length of rope between the winch and the exit; it stretches with the cable.",
        "m", 0.0, checks=(from_0, near), known_to=but("closed form"), step=Step(lambda robot, strain, length: length),
        example=("6", "m of rope between winch and exit, which also stretches"),
        said=("{} m from winch to exit", lambda cabling: cabling.winch_to_exit),
    )
    exit_compliance: Float[np.ndarray, "cables 3"] = declared(
        "Compliance of the frame at the exit (frame flex): by how much the exit, with its wheel, moves for each newton "
        "with which the cable pulls it towards the anchor; one number for all directions, or three along x, y, z of "
        "the base frame.",
        "m/N", 0.0, shape=(3,), checks=(within(0, MOST_COMPLIANCE),), known_to=("statics", "simulation"),
        label="exit compliance {part} of cable {cable}", step=Step(_step_of_compliance, least=True),
        example=("[2e-7, 2e-7, 1e-7]", "m/N along x, y, z, or one number: the exit moves under the cable's force"),
        said=("exits that give way by {}, {}, {} mm/kN along x, y, z", lambda cabling: 1e6 * cabling.exit_compliance),
    )
    rigid_length: Float[np.ndarray, " cables"] = declared(
        "Part of the rest length, at the anchor, that neither stretches nor weighs: a clamp, a hook.",
        "m", 0.0, checks=(from_0, near), known_to=EVERY, step=Step(lambda robot, strain, length: length),
        example=("0.1", "m at the anchor, which neither stretch nor weigh: a clamp, a hook"),
        said=("{} mm rigid at the anchor", lambda cabling: 1e3 * cabling.rigid_length),
    )
    reeving: Int[np.ndarray, " cables"] = declared(
        "Parts of line between exit and platform, a whole number.",
        "", 1, checks=(_whole_parts,), known_to=but("closed form"),
        example=("2", "parts of line between exit and platform"),
        said=("{} parts of line", lambda cabling: cabling.reeving.astype(float)),
    )
    pulley_friction: Float[np.ndarray, " cables"] = declared(
        "Fraction c of the tension that is lost at the exit.",
        "", 0.0, checks=(within(0, MOST_FRICTION),), memory=True, known_to=KEPT,
        example=("0.02", "fraction of the tension that is lost at the exit"),
        said=("{} % friction at the exit", lambda cabling: 100 * cabling.pulley_friction),
    )
    hysteresis: Float[np.ndarray, "cables elements 3"] = declared(
        "Elements [fraction of EA, yield strain] or [fraction, yield strain, w], which yield at the smaller of the "
        "yield strain, which may be `inf`, and w times the cable's strain; w is 1 unless given.",
        "", (), none=NO_ELEMENT, checks=(_yielding,), memory=True, known_to=KEPT,
        example=("[[0.1, 1e-3]]", "[fraction of EA, yield strain] of each element"),
        said=("{} % of EA with hysteresis", lambda cabling: 100 * cabling.hysteresis[..., 0].sum(-1)),
    )
    creep: Float[np.ndarray, "cables terms 2"] = declared(
        "Terms [EA1, tau1]: the tension T makes the cable longer by the strain T/EA1 (1 - exp(-t/tau1)).",
        "N, s", (), none=NO_TERM, checks=(_in_finite_time,), memory=True, known_to=KEPT,
        example=("[[400e3, 600]]", "[EA1 in N, time in s] of each term"),
        said=(
            "{} % of the stretch as creep",
            lambda cabling: 100 * (cabling.axial_stiffness[:, None] / cabling.creep[..., 0]).sum(-1),
        ),
    )
    # fmt: on


PROPERTIES = declarations(Cables)
"""The properties of cables by name."""

MEMORIES = tuple(name for name, one in PROPERTIES.items() if one.memory)
"""Properties by which a cable has a memory."""


@dataclass(frozen=True, eq=False)
class Cabling(Cables, Frozen):
    """The cables of one robot: what ``Robot`` is given of them, checked, with a row for each; arrays are read-only.

    Attributes have the names and units of the arguments of ``Robot``. ``pulley_axis`` are unit vectors. Cables with
    fewer elements of ``hysteresis`` or terms of ``creep`` than others are filled up with ``NO_ELEMENT`` and
    ``NO_TERM``.
    """

    @classmethod
    def of(cls, given: Mapping[str, Any]) -> Cabling:
        """The cables of a robot with these arguments, by name.

        Raises:
            InvalidInput: a field is invalid; the message names it.
        """
        cables = len(checked_array("exits", given["exits"], (None, 3)))
        if cables < 1:
            raise InvalidInput("exits: found no cable, expected at least one row (x, y, z)")
        if cables > MOST_CABLES:
            raise InvalidInput(f"exits: found {cables} cables, expected at most {MOST_CABLES}")
        made = cls(**{name: one.rows(given[name], cables) for name, one in PROPERTIES.items()})
        _refuse_crossed_limits(made)
        _refuse_falling_law(made.stiffening)
        _refuse_impossible_memory(made)
        return made

    def __len__(self) -> int:
        return len(self.exits)

    @cached_property
    def with_mass(self) -> Bool[np.ndarray, " cables"]:
        """Which cables have mass, (cables,)."""
        return self.linear_density > 0

    @cached_property
    def massless(self) -> bool:
        """Whether no cable has mass."""
        return not self.with_mass.any()

    @property
    def springs(self) -> bool:
        """Whether every cable is a spring along its path: its tension, in the path's direction, is by its length.

        Cables with mass are none, nor are those whose exits give way.
        """
        return self.massless and self.rigid_exits

    @cached_property
    def moving_exits(self) -> Bool[np.ndarray, " cables"]:
        """Which cables have an exit that gives way, (cables,)."""
        return self.has("exit_compliance")

    @cached_property
    def rigid_exits(self) -> bool:
        """Whether no exit gives way."""
        return not self.moving_exits.any()

    @cached_property
    def pulleys(self) -> Bool[np.ndarray, " cables"]:
        """Which cables run over a pulley, (cables,)."""
        return self.pulley_radius > 0

    @cached_property
    def nonlinear(self) -> Bool[np.ndarray, " cables"]:
        """Which cables have a tension that is not proportional to their strain, (cables,)."""
        return np.asarray(self.stiffening.any(-1))

    @cached_property
    def linear(self) -> bool:
        """Whether every cable's tension is proportional to its strain."""
        return not self.nonlinear.any()

    @cached_property
    def has_memory(self) -> Bool[np.ndarray, " cables"]:
        """Which cables have a memory, (cables,): their tension depends on the path to the pose, or on time."""
        return np.any([self.has(name) for name in MEMORIES], axis=0)

    def refuse_memory(self) -> None:
        """Refuse friction at pulleys, hysteresis and creep, where they are not taken into account.

        Raises:
            InvalidInput: some cable has one of them.
        """
        if self.has_memory.any():
            cable = int(np.argmax(self.has_memory))
            names = [name for name in MEMORIES if self.has(name)[cable]]
            raise InvalidInput(
                f"robot: found {' and '.join(names)} in cable {cable + 1}, expected cables without: their memory is "
                "not taken into account here; it is in solve, settle, solve_path, settle_path, check and sweep, and in "
                "track if all cables are massless and linear"
            )

    def has(self, name: str) -> Bool[np.ndarray, " cables"]:
        """Which cables have this property, (cables,): not as by default, and not without an effect."""
        one = PROPERTIES[name]
        own = one.in_effect(getattr(self, name))
        if one.only_with:  # a default other than 0 has an effect, too, as a wheel's axis has
            return self.has(one.only_with) & (own | np.any(one.default))
        return own

    def refuse_unknown(self, method: Method, what: str = "robot") -> None:
        """Refuse the properties that a method does not take into account.

        Raises:
            InvalidInput: some cable has one of them.
        """
        for name in self.unknown_to(method):
            raise InvalidInput(
                f"{what}: found {name} in cable {int(np.argmax(self.has(name))) + 1}, expected cables without: "
                f"{method} does not take it into account"
            )

    def unknown_to(self, method: Method) -> list[str]:
        """Properties that some cable has and a method does not take into account."""
        return [one.name for one in PROPERTIES.values() if method not in one.known_to and self.has(one.name).any()]

    @property
    def law(self) -> tuple[Float[np.ndarray, " cables"], ...]:
        """The law of each rope, of ``cable_law``: axial stiffness [N], a2, a3.

        Raises:
            InvalidInput: cables with a memory, which have another law.
        """
        self.refuse_unknown("statics")
        self.refuse_memory()
        return self.law_of(self.axial_stiffness)

    def law_of(self, axial_stiffness: Float[np.ndarray, "*batch cables"]) -> tuple[Float[np.ndarray, "..."], ...]:
        """The law of ropes of this axial stiffness [N], apart from their memory."""
        return axial_stiffness, *self.stiffening.T

    def pulls(self, tensions: Float[np.ndarray, "*batch cables"]) -> Float[np.ndarray, "*batch cables"]:
        """Of the tensions of ropes the forces on the platform, with all parts of line, (..., cables) [N]."""
        return self.reeving * tensions

    def tensions(self, pulls: Float[np.ndarray, "*batch cables"]) -> Float[np.ndarray, "*batch cables"]:
        """Of the forces on the platform, with all parts of line, the tensions of ropes, (..., cables) [N]."""
        return pulls / self.reeving

    @cached_property
    def behind(self) -> Float[np.ndarray, " cables"]:
        """Length of rope behind each exit for each part of line, (cables,) [m].

        In the mathematics, a rope with n parts of line, g = ``winch_to_exit``, the rest length l0 from exit to anchor,
        the weight w and the law tau(eps) is one cable of the law n tau(eps) and the weight n w, of which a length
        g/n lies behind the exit: the strain n (l − l0)/(n l0 + g) is (l − l0)/(l0 + g/n), and n tau pulls. With the
        ``rigid_length`` r at the anchor the rope from exit to anchor is l0 − r long, and the strain (l − l0)/(l0 − r +
        g/n).
        """
        return frozen(self.winch_to_exit / self.reeving)

    @cached_property
    def added(self) -> Float[np.ndarray, " cables"]:
        """What stretches besides the rest length, for each part of line, (cables,) [m]; negative where less does."""
        return frozen(self.behind - self.rigid_length)

    @property
    def least_lengths(self) -> Float[np.ndarray, " cables"]:
        """What every rest length exceeds, (cables,) [m]: what is no rope of it."""
        return self.rigid_length

    def ropes(self, rest_lengths: Float[np.ndarray, "*batch cables"]) -> Float[np.ndarray, "*batch cables"]:
        """Of rest lengths the lengths of rope between exits and anchors, which stretch and weigh, (..., cables) [m]."""
        return rest_lengths - self.least_lengths

    def stretching(self, rest_lengths: Float[np.ndarray, "*#batch cables"]) -> Float[np.ndarray, "*batch cables"]:
        """All that stretches of cables with these rest lengths, for each part of line, (..., cables) [m]."""
        return rest_lengths + self.added

    def refuse_short(self, field: str, rest_lengths: Float[np.ndarray, " cables"]) -> None:
        """Refuse rest lengths without a rope.

        Raises:
            InvalidInput: one that does not exceed the least; the message begins with ``field``.
        """
        short = ~(rest_lengths > self.least_lengths)
        if short.any():
            cable = int(np.argmax(short))
            least, where, expected = self.rigid_length[cable], "", "0"
            if least:
                where, expected = f" in cable {cable + 1}", f"its rigid_length, {least:g} m"
            raise InvalidInput(f"{field}: found {rest_lengths[cable]:g} m{where}, expected more than {expected}")

    def beyond_law(
        self, lengths: Float[np.ndarray, "*batch cables"], rest_lengths: Float[np.ndarray, "*#batch cables"]
    ) -> Bool[np.ndarray, "*batch cables"]:
        """Which cables are strained beyond the range of their law; a linear law holds for every strain.

        Args:
            lengths: stretched lengths [m].
            rest_lengths: unstretched lengths [m].
        """
        return self.nonlinear & (lengths > (1 + MOST_STRAIN) * rest_lengths + MOST_STRAIN * self.added)

    @cached_property
    def packed(self) -> Float[np.ndarray, "cables columns"]:
        """``Robot.cable_table`` of the cables without their weight, for what does not depend on it.

        Raises:
            InvalidInput: cables with a property that statics does not know.
        """
        self.refuse_unknown("statics")
        return frozen(
            np.column_stack(
                [
                    self.exits,
                    self.anchors,
                    self.reeving * self.axial_stiffness,
                    self.stiffening,
                    self.pulley_radius,
                    self.pulley_axis,
                    self.behind,
                    self.rigid_length,
                    self.reeving,
                    np.zeros((len(self), 2)),
                    self.exit_compliance,
                ]
            )
        )

    def same_as(self, other: Cabling) -> bool:
        """Whether both describe identical cables, to the last bit; force limits are not compared."""
        names = [name for name, one in PROPERTIES.items() if one.image]
        return all(np.array_equal(getattr(self, name), getattr(other, name)) for name in names)


def _refuse_crossed_limits(cabling: Cabling) -> None:
    above = cabling.force_min > cabling.force_max
    if above.any():
        cable = int(np.argmax(above))
        raise InvalidInput(
            f"force_min: found {cabling.force_min[cable]:g} N above force_max, {cabling.force_max[cable]:g} N, in "
            f"cable {cable + 1}; expected force_min <= force_max"
        )


def _refuse_impossible_memory(cabling: Cabling) -> None:
    """Check that a cable that gets longer pulls more."""
    shares, _, widths = np.moveaxis(cabling.hysteresis, -1, 0)
    lost = cabling.pulley_friction / (1 + cabling.pulley_friction**2 / 4)
    steepness = np.minimum(_least_slope(cabling.stiffening), 1.0)
    given_way = (shares * (1 + widths)).sum(-1)
    left = steepness * (1 - lost) - given_way
    if not (left[cabling.has_memory] > 0).all():
        cable = int(np.argmin(np.where(cabling.has_memory, left, np.inf)))
        lowest = "" if steepness[cable] == 1 else f", as the law's slope falls to {steepness[cable]:.4g} EA"
        raise InvalidInput(
            f"hysteresis: found a sum of share (1 + w), and of c/(1 + c²/4) of pulley_friction c, of "
            f"{1 - left[cable] / steepness[cable]:.4g} in cable {cable + 1}, expected less than 1{lowest}: the tension "
            "could fall while the cable gets longer"
        )
    bent = cabling.with_mass & cabling.nonlinear & cabling.has("hysteresis")
    if bent.any():
        raise InvalidInput(
            f"hysteresis: found it in cable {int(np.argmax(bent)) + 1} together with mass and a nonlinear law, "
            "expected at most two of the three"
        )


def _refuse_falling_law(stiffening: Float[np.ndarray, "cables 2"]) -> None:
    """Check 1 + 2 a2 eps + 3 a3 eps² > 0 on [0, MOST_STRAIN], at both ends and at a vertex in between."""
    least, (a2, a3) = _least_slope(stiffening), stiffening.T
    if not least.min() > 0:
        cable = int(np.argmin(least))
        raise InvalidInput(
            f"stiffening: found ({a2[cable]:g}, {a3[cable]:g}) in cable {cable + 1}, with which the tension falls "
            f"before a strain of {MOST_STRAIN:.0%}, expected an increasing law"
        )


def _least_slope(stiffening: Float[np.ndarray, "cables 2"]) -> Float[np.ndarray, " cables"]:
    """The least slope of each law behind its beginning, up to ``MOST_STRAIN``, over EA."""
    a2, a3 = stiffening.T
    vertex = np.divide(-a2, 3 * a3, out=np.zeros_like(a2), where=a3 != 0).clip(0, MOST_STRAIN)
    slopes = [1 + 2 * a2 * strain + 3 * a3 * strain**2 for strain in (np.full_like(a2, MOST_STRAIN), vertex)]
    return np.minimum(*slopes)

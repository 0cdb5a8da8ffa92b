"""Cables as data: where they run, how stiff they are, their mass per length.

Each method codes the behaviour of cables itself: the mathematics in ``core.cable_path``, ``core.cable_law`` and
``statics.catenary``, the MuJoCo side in ``physics.cables``, ``physics.pulleys`` and ``physics.chains``.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, TypeAlias

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy.typing import ArrayLike

from cdpr_sim.core.checks import (
    MOST_LENGTH,
    Frozen,
    as_numbers,
    checked_array,
    frozen,
    in_range,
    listed,
    refuse_far,
)
from cdpr_sim.core.errors import InvalidInput

EXIT, ANCHOR, STIFFNESS, STIFFENING, RADIUS, AXIS, BEHIND, PARTS, WEIGHT, WRAPPED = 0, 3, 6, 7, 9, 10, 13, 14, 15, 16
COLUMNS = 17
"""Columns of ``Robot.cable_table``: the first coordinate of the exit and of the anchor, axial stiffness of all parts of
line, the coefficients of nonlinear elasticity, the pulley's radius and axis, the length ``Cabling.behind`` the exit,
the number of parts of line, ``Robot.cable_weights`` and ``Robot.wrapped_lengths``; and the number of columns."""

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

ROUNDING = 4e-16
"""Largest deviation from 1 of the length of a unit vector in double precision."""

MOST_REEVING = 100
"""Largest number of parts of line; large cranes have some dozens."""

MOST_FRICTION = 1.0
"""Largest ``pulley_friction``; a rope on a small wheel loses 0.2 (``docs/concepts/memory.md``)."""

MOST_ELEMENTS = 50
"""Largest number of elements of hysteresis, and of terms of creep, of one cable; measured ropes are given by a few."""

NO_ELEMENT, NO_TERM = (0.0, np.inf, 1.0), (np.inf, 1.0)
"""Element of hysteresis and term of creep without an effect, for cables that have fewer of them than others."""

STIFFNESS_RANGE = (1e-6, 1e15)
"""[N] Range of axial stiffness that is accepted: from spider silk to steel ropes of one metre diameter, and far
beyond."""


MEMORIES = ("pulley_friction", "hysteresis", "creep")
"""Fields by which a cable has a memory."""

Rows: TypeAlias = Sequence[Sequence[float]] | Sequence[Sequence[Sequence[float]]] | np.ndarray
"""Rows of numbers for all cables, or such rows for each cable."""


@dataclass(frozen=True, eq=False)
class Cabling(Frozen):
    """The cables of one robot: what ``Robot`` is given of them, checked, with a row for each; arrays are read-only.

    Attributes have the names and units of the arguments of ``Robot``. ``pulley_axis`` are unit vectors. Cables with
    fewer elements of ``hysteresis`` or terms of ``creep`` than others are filled up with ``NO_ELEMENT`` and
    ``NO_TERM``.
    """

    exits: Float[np.ndarray, "cables 3"]
    anchors: Float[np.ndarray, "cables 3"]
    axial_stiffness: Float[np.ndarray, " cables"]
    linear_density: Float[np.ndarray, " cables"]
    pulley_radius: Float[np.ndarray, " cables"]
    pulley_axis: Float[np.ndarray, "cables 3"]
    stiffening: Float[np.ndarray, "cables 2"]
    force_min: Float[np.ndarray, " cables"]
    force_max: Float[np.ndarray, " cables"]
    breaking_load: Float[np.ndarray, " cables"]
    winch_to_exit: Float[np.ndarray, " cables"]
    reeving: Int[np.ndarray, " cables"]
    pulley_friction: Float[np.ndarray, " cables"]
    hysteresis: Float[np.ndarray, "cables elements 3"]
    creep: Float[np.ndarray, "cables terms 2"]

    @classmethod
    def of(cls, given: Mapping[str, Any]) -> Cabling:
        """The cables of a robot with these arguments, by name.

        Raises:
            InvalidInput: a field is invalid; the message names it.
        """
        exits = checked_array("exits", given["exits"], (None, 3))
        cables = len(exits)
        if cables < 1:
            raise InvalidInput("exits: found no cable, expected at least one row (x, y, z)")
        if cables > MOST_CABLES:
            raise InvalidInput(f"exits: found {cables} cables, expected at most {MOST_CABLES}")

        def each(name: str, *core: int) -> Float[np.ndarray, "..."]:
            return _per_cable(name, given[name], core, cables)

        values = {
            "exits": exits,
            "anchors": checked_array("anchors", given["anchors"], (cables, 3)),
            "axial_stiffness": each("axial_stiffness"),
            "linear_density": each("linear_density"),
            "pulley_radius": each("pulley_radius"),
            "pulley_axis": _unit(each("pulley_axis", 3)),
            "stiffening": each("stiffening", 2),
            "force_min": each("force_min"),
            "force_max": _limit_per_cable("force_max", given["force_max"], cables),
            "breaking_load": _limit_per_cable("breaking_load", given["breaking_load"], cables),
            "winch_to_exit": each("winch_to_exit"),
            "reeving": _parts_of_line(each("reeving")),
            "pulley_friction": each("pulley_friction"),
            "hysteresis": _rows_per_cable("hysteresis", given["hysteresis"], NO_ELEMENT, 2, cables),
            "creep": _rows_per_cable("creep", given["creep"], NO_TERM, 2, cables),
        }
        in_range("exits", exits, -MOST_LENGTH, MOST_LENGTH, "m")
        in_range("anchors", values["anchors"], -MOST_LENGTH, MOST_LENGTH, "m")
        if not (values["axial_stiffness"] > 0).all():
            least = values["axial_stiffness"].min()
            raise InvalidInput(f"axial_stiffness: found {least:g} N, expected more than 0")
        in_range("axial_stiffness", values["axial_stiffness"], *STIFFNESS_RANGE, "N")
        units = {"linear_density": "kg/m", "pulley_radius": "m", "force_min": "N", "winch_to_exit": "m"}
        for name, unit in units.items():
            cable = int(np.argmin(values[name]))
            if values[name][cable] < 0:
                raise InvalidInput(
                    f"{name}: found {values[name][cable]:g} {unit} in cable {cable + 1}, expected 0 or more"
                )
        refuse_far("pulley_radius", values["pulley_radius"])
        refuse_far("winch_to_exit", values["winch_to_exit"])
        tiny = (values["pulley_radius"] > 0) & (values["pulley_radius"] < LEAST_RADIUS)
        if tiny.any():
            cable = int(np.argmax(tiny))
            raise InvalidInput(
                f"pulley_radius: found {values['pulley_radius'][cable]:g} m in cable {cable + 1}, expected 0, for a "
                f"point, or at least {LEAST_RADIUS:g} m"
            )
        in_range("linear_density", values["linear_density"], 0, MOST_DENSITY, "kg/m")
        in_range("stiffening", values["stiffening"], -MOST_STIFFENING, MOST_STIFFENING, "")
        above = values["force_min"] > values["force_max"]
        if above.any():
            cable = int(np.argmax(above))
            raise InvalidInput(
                f"force_min: found {values['force_min'][cable]:g} N above force_max, {values['force_max'][cable]:g} N, "
                f"in cable {cable + 1}; expected force_min <= force_max"
            )
        made = cls(**values)
        _refuse_falling_law(made.stiffening)
        _refuse_impossible_memory(made)
        return made

    def __len__(self) -> int:
        return len(self.exits)

    @cached_property
    def massless(self) -> bool:
        """Whether no cable has mass."""
        return not self.linear_density.any()

    @cached_property
    def pulleys(self) -> Bool[np.ndarray, " cables"]:
        """Which cables run over a pulley, (cables,)."""
        return self.pulley_radius > 0

    @cached_property
    def linear(self) -> bool:
        """Whether every cable's tension is proportional to its strain."""
        return not self.stiffening.any()

    @cached_property
    def bent(self) -> bool:
        """Whether some cable runs over a pulley or has a nonlinear law: compiled code has a type for them."""
        return bool(self.pulleys.any()) or not self.linear

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
        """Which cables have a memory of this kind, one of ``MEMORIES``, (cables,)."""
        if name == "pulley_friction":
            return self.pulley_friction > 0
        rows = self.hysteresis[..., 0] > 0 if name == "hysteresis" else np.isfinite(self.creep[..., 0])
        return np.asarray(rows.any(-1))

    @property
    def law(self) -> tuple[Float[np.ndarray, " cables"], ...]:
        """The law of each rope, of ``cable_law``: axial stiffness [N], a2, a3.

        Raises:
            InvalidInput: cables with a memory, which have another law.
        """
        self.refuse_memory()
        return self.axial_stiffness, *self.stiffening.T

    @cached_property
    def direct(self) -> bool:
        """Whether every cable is wound at its exit and has one part of line."""
        return not self.winch_to_exit.any() and bool((self.reeving == 1).all())

    @cached_property
    def behind(self) -> Float[np.ndarray, " cables"]:
        """Length of rope behind each exit for each part of line, (cables,) [m].

        In the mathematics, a rope with n parts of line, g = ``winch_to_exit``, the rest length l0 from exit to anchor,
        the weight w and the law tau(eps) is one cable of the law n tau(eps) and the weight n w, of which a length
        g/n lies behind the exit: the strain n (l − l0)/(n l0 + g) is (l − l0)/(l0 + g/n), and n tau pulls.
        """
        return frozen(self.winch_to_exit / self.reeving)

    def refuse_weight(self, what: str) -> None:
        """Refuse cables with mass, where mass is not taken into account.

        Raises:
            InvalidInput: some cable has mass.
        """
        if not self.massless:
            raise InvalidInput(
                f"{what}: found cables of {self.linear_density.max():g} kg/m, expected massless ones: their mass "
                "is not taken into account here"
            )

    def beyond_law(
        self, lengths: Float[np.ndarray, "*batch cables"], rest_lengths: Float[np.ndarray, "*#batch cables"]
    ) -> Bool[np.ndarray, "*batch cables"]:
        """Which cables are strained beyond the range of their law; a linear law holds for every strain.

        Args:
            lengths: stretched lengths [m].
            rest_lengths: unstretched lengths [m].
        """
        behind = MOST_STRAIN * self.behind
        return self.stiffening.any(-1) & (lengths > (1 + MOST_STRAIN) * rest_lengths + behind)

    @cached_property
    def packed(self) -> Float[np.ndarray, "cables columns"]:
        """``Robot.cable_table`` of the cables without their weight, for what does not depend on it."""
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
                    self.reeving,
                    np.zeros((len(self), 2)),
                ]
            )
        )

    def same_as(self, other: Cabling) -> bool:
        """Whether both describe identical cables, to the last bit; force limits are not compared."""
        names = {field.name for field in dataclasses.fields(self)} - {"force_min", "force_max", "breaking_load"}
        return all(np.array_equal(getattr(self, name), getattr(other, name)) for name in names)


def _per_cable(field: str, value: ArrayLike, core: tuple[int, ...], cables: int) -> Float[np.ndarray, "..."]:
    """A row for each cable, from one row for all or one row each."""
    array = checked_array(field, value, None)
    if array.shape != core:
        array = checked_array(field, array, (cables, *core))
    return np.broadcast_to(array, (cables, *core)).copy()


def _parts_of_line(parts: Float[np.ndarray, " cables"]) -> Int[np.ndarray, " cables"]:
    """``reeving``, checked to be a whole number for each cable."""
    wrong = (parts != np.round(parts)) | (parts < 1) | (parts > MOST_REEVING)
    if wrong.any():
        cable = int(np.argmax(wrong))
        raise InvalidInput(
            f"reeving: found {parts[cable]:g} parts of line in cable {cable + 1}, expected a whole number from 1 to "
            f"{MOST_REEVING}"
        )
    return parts.astype(int)


def _rows_per_cable(
    field: str, value: Rows, none: tuple[float, ...], least: int, cables: int
) -> Float[np.ndarray, "cables rows columns"]:
    """Rows for each cable, filled up with ``none``; of a row's numbers ``least`` or all are given."""
    expected = f"rows of {' or '.join(str(n) for n in range(least, len(none) + 1))} numbers, for all cables or for each"
    outer = [listed(field, one, expected) for one in listed(field, value, expected)]
    common = all(np.ndim(number) == 0 for one in outer for number in one)
    if not common and len(outer) != cables:
        raise InvalidInput(f"{field}: found rows of {len(outer)} cables, expected those of {cables}")
    each = [outer if any(outer) else []] * cables if common else outer
    most = max((len(rows) for rows in each), default=0)
    if most > MOST_ELEMENTS:
        raise InvalidInput(f"{field}: found {most} rows for one cable, expected at most {MOST_ELEMENTS}")
    filled = np.tile(np.array(none), (cables, most, 1))
    for cable, rows in enumerate(each):
        for number, row in enumerate(rows):
            numbers = as_numbers(field, row)
            if numbers.ndim != 1 or not least <= len(numbers) <= len(none):
                raise InvalidInput(f"{field}: found a row of shape {numbers.shape}, expected {expected}")
            if not (numbers > 0).all() and not np.array_equal(numbers, none[: len(numbers)]):
                raise InvalidInput(f"{field}: found {numbers.tolist()} in cable {cable + 1}, expected numbers above 0")
            filled[cable, number, : len(numbers)] = numbers
    used = (filled != np.array(none)).any(-1).any(0)
    return filled[:, used]


def _refuse_impossible_memory(cabling: Cabling) -> None:
    """Check the ranges of friction, hysteresis and creep; and that a cable that gets longer pulls more."""
    in_range("pulley_friction", cabling.pulley_friction, 0, MOST_FRICTION, "")
    shares, _, widths = np.moveaxis(cabling.hysteresis, -1, 0)
    if not np.isfinite(shares).all() or (widths > 1).any():
        cable = int(np.argmax((~np.isfinite(shares) | (widths > 1)).any(-1)))
        raise InvalidInput(
            f"hysteresis: found {cabling.hysteresis[cable].tolist()} in cable {cable + 1}, expected (share, yield "
            "strain, w) with a finite share and w of at most 1"
        )
    if not np.isfinite(cabling.creep[..., 1]).all():
        raise InvalidInput("creep: found an infinite time, expected terms (EA1 [N], tau1 [s]) with a finite time")
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
    bent = (cabling.linear_density > 0) & cabling.stiffening.any(-1) & cabling.has("hysteresis")
    if bent.any():
        raise InvalidInput(
            f"hysteresis: found it in cable {int(np.argmax(bent)) + 1} together with mass and a nonlinear law, "
            "expected at most two of the three"
        )


def _limit_per_cable(field: str, value: ArrayLike, cables: int) -> Float[np.ndarray, " cables"]:
    """The same for upper limits, which must be positive and may be infinite."""
    given = as_numbers(field, value)
    none = np.isposinf(given)
    limits = _per_cable(field, np.where(none, 1.0, given), (), cables)
    if not limits.min() > 0:
        cable = int(np.argmin(limits))
        raise InvalidInput(f"{field}: found {limits[cable]:g} N in cable {cable + 1}, expected more than 0")
    return np.where(none, np.inf, limits)


def _unit(axes: Float[np.ndarray, "cables 3"]) -> Float[np.ndarray, "cables 3"]:
    in_range("pulley_axis", axes, -MOST_LENGTH, MOST_LENGTH, "")
    lengths = np.linalg.norm(axes, axis=1)
    if not lengths.min() > 0:
        cable = int(np.argmin(lengths))
        raise InvalidInput(f"pulley_axis: found an axis of length zero in cable {cable + 1}, expected a direction")
    rounding = np.abs(lengths - 1) < ROUNDING  # a unit vector that is written and read again stays identical
    return axes / np.where(rounding, 1.0, lengths)[:, None]


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

"""What a property of cables declares, and what follows from it for any property; ``core.cable`` declares them."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple, TypeAlias, get_args

import numpy as np
from jaxtyping import Bool, Float
from numpy.typing import ArrayLike

from cdpr_sim.core.checks import as_numbers, checked_array, in_range, listed, refuse_far
from cdpr_sim.core.errors import InvalidInput

Method = Literal[
    "statics", "simulation", "proof", "proof of completeness", "cable damping", "learning", "layout search",
    "swivel angles", "closed form",
]  # fmt: skip

EVERY: tuple[Method, ...] = get_args(Method)
"""All methods."""

MOST_ELEMENTS = 50
"""Largest number of elements of hysteresis, and of terms of creep, of one cable; measured ropes are given by a few."""

Rows: TypeAlias = Sequence[Sequence[float]] | Sequence[Sequence[Sequence[float]]] | np.ndarray
"""Rows of numbers for all cables, or such rows for each cable."""

Check: TypeAlias = Callable[["Property", np.ndarray], np.ndarray]
"""Refuses values of a property, with a row for each cable, by an ``InvalidInput``; returns them as they are stored."""


class Step(NamedTuple):
    """Steps of a property for the derivatives of a cable's pull, which are differences.

    Attributes:
        scale: a change that lengthens or shortens the stretch by about as much as there is, a number or more for each
            cable; a function of the robot, the largest strain of each cable, 0 where it is slack, and its length [m].
        path: whether it changes the length of the path. The stretch is kept then, so that no step makes a slack cable
            taut.
        least: whether 0 is the least possible value, with steps to one side from there.
    """

    scale: Callable[[Any, np.ndarray, np.ndarray], np.ndarray]
    path: bool = False
    least: bool = False


REQUIRED: Any = ...
"""Default of a property that every robot gives."""


@dataclass(frozen=True)
class Property:
    """The declaration of one property of cables.

    Attributes:
        meaning: in the documentation of robot files.
        unit: of its numbers in SI; "" of pure numbers.
        default: for every cable; ``REQUIRED`` without one. One that is infinite by default is an upper limit. Where it
            is one number and ``shape`` has more, one number stands for all of them.
        shape: of the numbers of one cable: () is one number.
        none: where a cable has any number of rows of numbers, a row without an effect; its last numbers are optional.
        checks: of its values, in order.
        image: how a symmetry maps it: as a number, a point or an axis. None for what does not change the cable: forces
            that studies keep.
        step: for derivatives by it, if there are any.
        known_to: the methods that take it into account. Others refuse cables that have it.
        memory: whether it makes the tension depend on the path.
        only_with: name of the property without which it has no effect.
        key: in robot files; by default its name. "pulley.radius" is a key of the table ``pulley``.
        label: name of one number, with {cable} and {part}; by default the field's name and the cable.
        parts: names of the numbers of one cable.
        example: as the robot file's template shows it: a value in TOML, and a comment.
        said: of a cable that has it, in descriptions: a text, and the numbers for its {} from a ``Cabling``,
            (cables, ...).
        name: the field's name.
    """

    meaning: str
    unit: str = ""
    default: Any = REQUIRED
    shape: tuple[int, ...] = ()
    none: tuple[float, ...] | None = None
    checks: tuple[Check, ...] = ()
    image: Literal["number", "point", "axis"] | None = "number"
    step: Step | None = None
    known_to: tuple[Method, ...] = ()
    memory: bool = False
    only_with: str | None = None
    key: str | None = None
    label: str = ""
    parts: tuple[str, ...] = ("x", "y", "z")
    example: tuple[str, str] | None = None
    said: tuple[str, Callable[[Any], np.ndarray]] | None = None
    name: str = ""

    def rows(self, value: Any, cables: int) -> np.ndarray:
        """Checked values with a row for each cable, from what a robot is given.

        Raises:
            InvalidInput: not numbers, of another shape, or out of range.
        """
        if self.none is not None:
            values = _rows_per_cable(self.name, value, self.none, 2, cables)
        elif self.image == "point":
            values = checked_array(self.name, value, (cables, *self.shape))
        elif self.limit:
            values = _limit_per_cable(self.name, value, cables)
        else:
            values = _per_cable(self.name, value, self.shape, cables, uniform=self.uniform)
        for check in self.checks:
            values = check(self, values)
        return values

    @property
    def uniform(self) -> bool:
        """Whether one number stands for all numbers of a cable."""
        return self.shape != () and isinstance(self.default, float)

    @property
    def limit(self) -> bool:
        """Whether it is an upper limit."""
        return self.default == np.inf

    def in_effect(self, values: np.ndarray) -> Bool[np.ndarray, " cables"]:
        """Which cables have it: other numbers than the default, or a row with an effect."""
        if self.default is REQUIRED:
            return np.ones(len(values), bool)
        usual, numbers = (self.default, values) if self.none is None else (self.none[0], values[..., 0])
        return np.asarray((numbers != usual).reshape(len(values), -1).any(-1))

    def number(self, index: int) -> str:
        """The name of one number, such as "exit 3 z", by its index among those of all cables."""
        cable, part = divmod(index, int(np.prod(self.shape)))
        label = self.label or f"{self.name.replace('_', ' ')} of cable {{cable}}"
        return label.format(cable=cable + 1, part=self.parts[part])

    @property
    def title(self) -> str:
        """What its numbers are: "EA"."""
        return self.number(0).removesuffix(" of cable 1")

    @property
    def place(self) -> tuple[str, str]:
        """The table of robot files, "" for the cable's own, and the key there."""
        table, _, key = (self.key or self.name).rpartition(".")
        return table, key


def declared(meaning: str, unit: str = "", default: Any = REQUIRED, **more: Any) -> Any:
    """A field of a dataclass with the declaration of a property."""
    return dataclasses.field(metadata={"property": Property(meaning, unit, default, **more)})


def declarations(cables: type) -> dict[str, Property]:
    """The properties that a dataclass declares, by name."""
    return {
        one.name: dataclasses.replace(one.metadata["property"], name=one.name) for one in dataclasses.fields(cables)
    }


def but(*methods: Method) -> tuple[Method, ...]:
    """All methods but these."""
    return tuple(one for one in EVERY if one not in methods)


def above_0(one: Property, values: np.ndarray) -> np.ndarray:
    """Check that all are above 0."""
    if not (values > 0).all():
        raise InvalidInput(f"{one.name}: found {values.min():g} {one.unit}, expected more than 0")
    return values


def from_0(one: Property, values: np.ndarray) -> np.ndarray:
    """Check that all are 0 or more."""
    cable = int(np.argmin(values))
    if values[cable] < 0:
        raise InvalidInput(f"{one.name}: found {values[cable]:g} {one.unit} in cable {cable + 1}, expected 0 or more")
    return values


def near(one: Property, values: np.ndarray) -> np.ndarray:
    """Check that lengths are those of a robot."""
    refuse_far(one.name, values)
    return values


def within(least: float, most: float) -> Check:
    """Check of a range."""

    def check(one: Property, values: np.ndarray) -> np.ndarray:
        in_range(one.name, values, least, most, one.unit)
        return values

    return check


def _per_cable(
    field: str, value: ArrayLike, core: tuple[int, ...], cables: int, *, uniform: bool = False
) -> Float[np.ndarray, "..."]:
    """A row for each cable, from one row for all or one row each; ``uniform``: or from one number in place of a row."""
    array = checked_array(field, value, None)
    if uniform and array.shape in ((), (cables, 1)):
        array = np.broadcast_to(array, (cables, *core))
    if array.shape != core:
        array = checked_array(field, array, (cables, *core))
    return np.broadcast_to(array, (cables, *core)).copy()


def _limit_per_cable(field: str, value: ArrayLike, cables: int) -> Float[np.ndarray, " cables"]:
    """The same for upper limits, which must be positive and may be infinite."""
    given = as_numbers(field, value)
    none = np.isposinf(given)
    limits = _per_cable(field, np.where(none, 1.0, given), (), cables)
    if not limits.min() > 0:
        cable = int(np.argmin(limits))
        raise InvalidInput(f"{field}: found {limits[cable]:g} N in cable {cable + 1}, expected more than 0")
    return np.where(none, np.inf, limits)


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

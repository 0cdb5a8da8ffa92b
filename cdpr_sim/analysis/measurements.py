"""Measurements of a robot in equilibrium: poses, tensions, swivel angles, natural frequencies; from arrays or from CSV.

A CSV file names its columns and their units, ``commanded_x [mm]``, ``measured_beta [deg]``. The columns:

- ``commanded_x``, ``_y``, ``_z`` are needed; ``commanded_alpha``, ``_beta``, ``_gamma`` are 0 unless given.
- ``rest_length_1``, ...: what the winches paid out, where they did not follow the rigid geometry of the commanded pose.
- ``mass``: of the platform with its load in this row; empty: the robot's.
- ``force_x``, ..., ``torque_z``: a known external wrench in this row.
- Measured, at least one of them: ``measured_x``, ..., ``measured_gamma``; ``tension_1``, ... by load cells;
  ``swivel_1``, ... of the pulleys, as in ``core.cable_path.swivel_angles``; ``frequency_1``, ... of the platform's
  natural modes, slowest first.
- ``robot``, a name.

A file with ``length_1``, ..., of all cables, has no poses: neither commanded nor measured ones. They are unstretched
lengths that were read at places that nobody measured; beside them the tensions of cables that were pulled tight.

Each measured column and each rest length may have a standard error, ``tension_1_error [N]``. An empty cell was not
measured. Angles are the paper's R = Rz(gamma) Ry(beta) Rx(alpha).
"""

from __future__ import annotations

import csv
import difflib
import re
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from dataclasses import fields as dataclass_fields
from functools import cached_property
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy.typing import ArrayLike

from cdpr_sim.core.checks import as_numbers, checked_array, checked_path, listed, one_of, refuse_unless, shown
from cdpr_sim.core.errors import InvalidInput
from cdpr_sim.core.files import read_text, readable
from cdpr_sim.core.robot import Robot

COORDINATES = ("x", "y", "z", "alpha", "beta", "gamma")

KINDS = ("position", "rotation", "tension", "swivel", "frequency", "length")
"""Kinds of measured numbers: coordinates [m], angles of the platform [rad], tensions [N], swivel angles [rad], natural
frequencies [Hz], lengths of cables at poses that were not measured [m]."""

LENGTHS = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "µm": 1e-6}
ANGLES = {"rad": 1.0, "deg": np.pi / 180, "°": np.pi / 180, "mrad": 1e-3}
FORCES = {"N": 1.0, "kN": 1e3}
TORQUES = {"N m": 1.0, "Nm": 1.0, "N mm": 1e-3}
MASSES = {"kg": 1.0, "g": 1e-3}
FREQUENCIES = {"Hz": 1.0, "rad/s": 1 / (2 * np.pi)}

WRENCH = ("force_x", "force_y", "force_z", "torque_x", "torque_y", "torque_z")

LARGEST_FILE = 50_000_000
"""Largest size of a file [bytes]: half a million rows."""

_HEADER = re.compile(r"^(?P<name>[a-z_0-9]+)\s*(\[(?P<unit>[^\]]+)\])?$")
_NUMBERED = re.compile(r"^(?P<kind>rest_length|length|tension|swivel|frequency)_(?P<number>[1-9]\d{0,3})$")
_COLUMNS = {
    r"commanded_[xyz]": LENGTHS, r"measured_[xyz](_error)?": LENGTHS, r"(rest_)?length_[1-9]\d{0,3}(_error)?": LENGTHS,
    r"commanded_(alpha|beta|gamma)": ANGLES, r"measured_(alpha|beta|gamma)(_error)?": ANGLES,
    r"swivel_[1-9]\d{0,3}(_error)?": ANGLES, r"tension_[1-9]\d{0,3}(_error)?": FORCES, r"force_[xyz]": FORCES,
    r"torque_[xyz]": TORQUES, r"mass": MASSES, r"frequency_[1-9]\d{0,3}(_error)?": FREQUENCIES,
}  # fmt: skip
"""Patterns of the columns' names, and their units; ``robot`` has none."""


@dataclass(frozen=True, eq=False)
class Measurements:
    """Commanded and measured quantities of equilibria, row by row.

    Attributes:
        commanded: (rows, 6) [m, rad]; nan where only ``lengths`` were measured.
        measured: (rows, 6) poses [m, rad], nan where not measured.
        rest_lengths: (rows, cables) [m], or None where the winches followed the rigid geometry.
        robot: name of the robot, if given.
        source: origin of the data, for messages.
        tensions: (rows, cables) of the ropes [N], nan where not measured; None: none was.
        swivels: (rows, cables) swivel angles of the pulleys [rad], likewise.
        frequencies: (rows, modes) natural frequencies [Hz], slowest first, likewise.
        masses: (rows,) of the platform with its load [kg], nan: the robot's; None: the robot's in all rows.
        wrenches: (rows, 6) known external wrenches [N, N m]; None: none acts.
        stated_errors: standard errors of all ``values``, (rows, numbers), nan where not stated; None: none is.
        rest_length_errors: (rows, cables) standard errors of the rest lengths [m]; None: they are exact.
        lengths: (rows, cables) unstretched lengths that were read at unknown poses [m]; None: poses were commanded.
    """

    commanded: Float[np.ndarray, "rows 6"]
    measured: Float[np.ndarray, "rows 6"]
    rest_lengths: Float[np.ndarray, "rows cables"] | None = None
    robot: str | None = None
    source: str = "measurements"
    tensions: Float[np.ndarray, "rows cables"] | None = None
    swivels: Float[np.ndarray, "rows cables"] | None = None
    frequencies: Float[np.ndarray, "rows modes"] | None = None
    masses: Float[np.ndarray, " rows"] | None = None
    wrenches: Float[np.ndarray, "rows 6"] | None = None
    stated_errors: Float[np.ndarray, "rows numbers"] | None = None
    rest_length_errors: Float[np.ndarray, "rows cables"] | None = None
    lengths: Float[np.ndarray, "rows cables"] | None = None

    @classmethod
    def of(
        cls,
        commanded: ArrayLike | None = None,
        measured: ArrayLike | None = None,
        *,
        coordinates: Sequence[str] = COORDINATES,
        rest_lengths: ArrayLike | None = None,
        lengths: ArrayLike | None = None,
        tensions: ArrayLike | None = None,
        swivels: ArrayLike | None = None,
        frequencies: ArrayLike | None = None,
        masses: ArrayLike | None = None,
        wrenches: ArrayLike | None = None,
        errors: Mapping[str, ArrayLike] | None = None,
        robot: str | None = None,
    ) -> Measurements:
        """Measurements from arrays; nan where a number was not measured.

        Args:
            commanded: (rows, 3) [m] or (rows, 6) [m, rad]; where the search for each equilibrium starts. Left out with
                ``lengths``.
            measured: (rows, len(coordinates)) [m, rad].
            coordinates: which of x, y, z, alpha, beta, gamma the columns of ``measured`` are.
            rest_lengths: (rows, cables) [m]; default: the rigid ones at each commanded pose.
            lengths: (rows, cables) unstretched lengths that were read where no pose is known [m]; beside them only
                ``tensions``, of the cables that were pulled tight, ``masses`` and ``wrenches``.
            tensions: (rows, cables) [N].
            swivels: (rows, cables) [rad], as in ``core.cable_path.swivel_angles``.
            frequencies: (rows, modes) [Hz], slowest first.
            masses: (rows,) of the platform with its load [kg]; default and nan: the robot's.
            wrenches: (rows, 6) external wrenches [N, N m].
            errors: standard errors, by "position", "rotation", "tension", "swivel", "frequency", "length" or
                "rest_length": a number, or an array that broadcasts to (rows, numbers of that kind).
            robot: name of the robot; checked when it is identified.

        Returns:
            Measurements of (rows,) equilibria, checked; coordinates that were not measured are nan.

        Raises:
            InvalidInput: shapes that do not fit, numbers that are infinite, errors that are not positive, or nothing
                measured.
            UnknownName: no such coordinate or kind.
        """
        if (commanded is None) == (lengths is None):
            found = "neither" if lengths is None else "both"
            raise InvalidInput(f"commanded: found {found} of it and lengths at unknown poses, expected one of the two")
        read = None if lengths is None else checked_lengths(as_numbers("lengths", lengths), "lengths")
        given = (
            np.full((len(read), 6), np.nan)
            if read is not None
            else checked_array("commanded", () if commanded is None else commanded, (None, None))
        )
        if given.shape[1] not in (3, 6):
            raise InvalidInput(f"commanded: found {given.shape[1]} columns, expected (x, y, z) or a six-vector")
        rows = len(given)
        whole = np.zeros((rows, 6))
        whole[:, : given.shape[1]] = given
        if rows == 0:
            raise InvalidInput("commanded: found no row, expected at least one")
        coordinates = listed("coordinates", coordinates, "a list of names")
        for name in coordinates:
            one_of("coordinate", name, COORDINATES)
        refuse_unless(str | None, robot=robot)
        refuse_unless(Mapping | None, errors=errors)
        if not coordinates or len(set(coordinates)) < len(coordinates):
            raise InvalidInput(f"coordinates: found {', '.join(coordinates) or 'none'}, expected some, each once")
        poses = np.full((rows, 6), np.nan)
        if measured is not None:
            columns = [COORDINATES.index(name) for name in coordinates]
            poses[:, columns] = _gappy("measured", measured, (rows, len(coordinates)))
        lengths = None if rest_lengths is None else checked_array("rest_lengths", rest_lengths, (rows, None))
        made = cls(
            whole,
            poses,
            lengths,
            robot,
            tensions=None if tensions is None else _gappy("tensions", tensions, (rows, None)),
            swivels=None if swivels is None else _gappy("swivels", swivels, (rows, None)),
            frequencies=None if frequencies is None else _gappy("frequencies", frequencies, (rows, None)),
            masses=None if masses is None else _gappy("masses", masses, (rows,)),
            wrenches=None if wrenches is None else checked_array("wrenches", wrenches, (rows, 6)),
            lengths=read,
        )
        made._check()
        return made.with_errors(errors or {})

    def with_errors(self, errors: Mapping[str, ArrayLike]) -> Measurements:
        """The same measurements with standard errors by kind, where none were stated.

        Args:
            errors: by "position", "rotation", "tension", "swivel", "frequency", "length" or "rest_length": a number, or
                an array that broadcasts to (rows, numbers of that kind).

        Returns:
            Measurements with ``stated_errors`` and ``rest_length_errors``.

        Raises:
            InvalidInput: errors that are not positive, or of a kind that was not measured.
            UnknownName: no such kind.
        """
        refuse_unless(Mapping, errors=errors)
        stated, lengths = self.errors.copy(), self.rest_length_errors
        for kind, given in errors.items():
            one_of("error", kind, (*KINDS, "rest_length"))
            if kind == "rest_length":
                columns = np.arange(0 if self.rest_lengths is None else self.rest_lengths.shape[1])
            else:
                columns = np.flatnonzero(self.kinds == KINDS.index(kind))
            wanted = (len(self), len(columns))
            if not len(columns):
                raise InvalidInput(f"{kind}_error: found one, but no {kind.replace('_', ' ')} was given")
            found = as_numbers(f"{kind}_error", given)
            with suppress(ValueError):
                found = np.broadcast_to(found, wanted)
            found = _gappy(f"{kind}_error", found, wanted)
            if (found <= 0).any():
                raise InvalidInput(f"{kind}_error: found {np.nanmin(found):g}, expected a positive number")
            if kind == "rest_length":
                lengths = found if lengths is None else np.where(np.isnan(lengths), found, lengths)
            else:
                stated[:, columns] = np.where(np.isnan(stated[:, columns]), found, stated[:, columns])
        if lengths is not None:
            lengths = np.nan_to_num(lengths)
        return replace(self, stated_errors=stated, rest_length_errors=lengths)

    def rows(self, chosen: Sequence[int] | Int[np.ndarray, " chosen"] | Bool[np.ndarray, " rows"]) -> Measurements:
        """Some of the rows.

        Args:
            chosen: their indices, from 0, or a mask.

        Returns:
            Measurements of these rows, in this order.

        Raises:
            InvalidInput: no such row, or none chosen.
        """
        listed("chosen", chosen, "a list of rows")
        try:
            given = np.array(chosen)
        except (TypeError, ValueError):
            given = np.zeros(0)  # refused below
        if given.ndim != 1 or (given.dtype == bool and len(given) != len(self)) or given.dtype.kind not in "biu":
            raise InvalidInput(f"chosen: found {shown(chosen)}, expected indices of rows, or a mask of {len(self)}")
        index = np.asarray(np.flatnonzero(given) if given.dtype == bool else given, dtype=int)
        if not len(index) or index.min() < 0 or index.max() >= len(self):
            raise InvalidInput(f"chosen: found {shown(chosen)}, expected some of the rows 0 to {len(self) - 1}")
        fields = ((one.name, getattr(self, one.name)) for one in dataclass_fields(self))
        return replace(self, **{name: one[index] for name, one in fields if isinstance(one, np.ndarray)})

    @cached_property
    def values(self) -> Float[np.ndarray, "rows numbers"]:
        """All measured numbers, nan where not measured: six coordinates, tensions, swivel angles, frequencies."""
        return np.hstack([self.measured, *(one for one in self._further if one is not None)])

    @cached_property
    def kinds(self) -> Int[np.ndarray, " numbers"]:
        """Index into ``KINDS`` of each column of ``values``."""
        counts = [3, 3, *(0 if one is None else one.shape[1] for one in self._further)]
        return np.repeat(np.arange(len(KINDS)), counts)

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Name of each column of ``values``: "x", ..., "gamma", "tension 1", ..."""
        further = [
            f"{kind} {i + 1}"
            for kind, one in zip(KINDS[2:], self._further, strict=True)
            if one is not None
            for i in range(one.shape[1])
        ]
        return (*COORDINATES, *further)

    @property
    def _further(self) -> tuple[Float[np.ndarray, "rows numbers"] | None, ...]:
        return self.tensions, self.swivels, self.frequencies, self.lengths

    @property
    def inputs(self) -> tuple[np.ndarray | None, ...]:
        """What determines the equilibrium of each row: its command, rest lengths and their errors, mass and wrench."""
        return self.commanded, self.rest_lengths, self.rest_length_errors, self.masses, self.wrenches

    @property
    def errors(self) -> Float[np.ndarray, "rows numbers"]:
        """Standard errors of ``values``, nan where not stated."""
        return np.full(self.values.shape, np.nan) if self.stated_errors is None else self.stated_errors

    @property
    def known(self) -> Bool[np.ndarray, "rows numbers"]:
        """Which numbers were measured; the first six columns are the coordinates."""
        return ~np.isnan(self.values)

    def __len__(self) -> int:
        return len(self.commanded)

    def _check(self) -> None:
        """Check what does not depend on the robot.

        Raises:
            InvalidInput: nothing measured, or numbers that are not positive where they must be.
        """
        if not self.known.any():
            raise InvalidInput(f"{self.source}: found no measured number, expected at least one, such as a height")
        for name in ("rest_lengths", "frequencies", "masses"):
            found = getattr(self, name)
            if found is not None and (found <= 0).any():
                raise InvalidInput(f"{self.source}: {name}: found {np.nanmin(found):g}, expected positive numbers")
        beside = {
            "measured poses": self.measured, "rest lengths": self.rest_lengths, "swivel angles": self.swivels,
            "natural frequencies": self.frequencies,
        }  # fmt: skip
        if self.lengths is not None:
            for name, found in beside.items():
                if found is not None and not np.isnan(found).all():
                    raise InvalidInput(
                        f"{self.source}: found {name} beside lengths at unknown poses, expected only tensions, masses "
                        "and wrenches; where poses are known, lengths are rest lengths"
                    )

    def check_robot(self, robot: Robot) -> None:
        """Check that these can be measurements of ``robot``.

        Raises:
            InvalidInput: they are of another one.
        """
        refuse_unless(Robot, robot=robot)
        if self.robot is not None and self.robot != robot.name:
            raise InvalidInput(f"{self.source}: found measurements of {self.robot!r}, expected those of {robot.name!r}")
        named = (
            (self.rest_lengths, "rest lengths"), (self.tensions, "tensions"), (self.swivels, "swivel angles"),
            (self.lengths, "lengths"),
        )  # fmt: skip
        for numbers, name in named:
            if numbers is not None and numbers.shape[1] != robot.cables:
                raise InvalidInput(
                    f"{self.source}: found {numbers.shape[1]} {name}, expected {robot.cables}, one per cable of "
                    f"{robot.name!r}"
                )
        if self.swivels is not None:
            without = ~np.isnan(self.swivels).all(0) & ~robot.cabling.pulleys
            if without.any():
                raise InvalidInput(
                    f"{self.source}: found the swivel angle of cable {int(np.argmax(without)) + 1}, which has no "
                    f"pulley on {robot.name!r}"
                )
        if self.frequencies is not None and self.frequencies.shape[1] > len(robot.free):
            raise InvalidInput(
                f"{self.source}: found {self.frequencies.shape[1]} natural frequencies, expected at most "
                f"{len(robot.free)}, the degrees of freedom of {robot.name!r}"
            )
        if self.frequencies is not None and self.wrenches is not None and self.wrenches[:, 3:].any():
            raise InvalidInput(
                f"{self.source}: found natural frequencies under an external torque, expected none: such a torque is "
                "not conservative"
            )
        if robot.mobility == "planar":
            out = [name for i, name in enumerate(COORDINATES) if i in (1, 3, 5) and self.known[:, i].any()]
            if out or np.nan_to_num(self.commanded[:, [1, 3, 5]]).any():
                found = f"measured {', '.join(out)}" if out else "a commanded pose out of the x-z plane"
                raise InvalidInput(
                    f"{self.source}: found {found}, but {robot.name!r} is planar: expected only x, z and beta"
                )

    def __repr__(self) -> str:
        seen = [name for name, column in zip(self.names, self.values.T, strict=True) if not np.isnan(column).all()]
        of = f" of {self.robot!r}" if self.robot else ""
        return f"<Measurements{of}: {len(self.measured)} rows of {', '.join(seen)}>"


def checked_lengths(lengths: np.ndarray, source: str) -> Float[np.ndarray, "rows cables"]:
    """Lengths of all cables in each row, positive numbers.

    Raises:
        InvalidInput: others; the message names the row.
    """
    if lengths.ndim != 2 or not lengths.size:
        raise InvalidInput(f"{source}: found lengths of shape {lengths.shape}, expected (rows, cables)")
    wrong = ~(np.isfinite(lengths) & (lengths > 0))
    if wrong.any():
        row, cable = np.argwhere(wrong)[0]
        raise InvalidInput(
            f"{source}: row {row + 1}: found a length {cable + 1} of {lengths[row, cable]:g} m, expected a number "
            "above 0"
        )
    return lengths


def _gappy(name: str, given: ArrayLike, shape: tuple[int | None, ...]) -> np.ndarray:
    """As ``checked_array``, with nan where nothing was measured."""
    array = as_numbers(name, given)
    checked_array(name, np.where(np.isnan(array), 0.0, array), shape)
    return array


def read_measurements(path: str | Path) -> Measurements:
    """Measurements from a CSV file with named columns and units; the module describes the format.

    Args:
        path: path of the file.

    Returns:
        A row for each line of the file [m, rad], whatever units its columns have.

    Raises:
        InvalidInput: no such file, no rows, an unknown or missing column or unit, or a cell that is not a number; the
            message names file, line and column.
    """
    path = checked_path("path", path)
    with readable(path):
        text = read_text(path, LARGEST_FILE)
    reader = csv.reader(text.splitlines())
    numbered = [(reader.line_num, row) for row in reader if any(cell.strip() for cell in row)]
    numbered = [(line, row) for line, row in numbered if not row[0].lstrip().startswith("#")]
    lines, rows = [line for line, _ in numbered], [row for _, row in numbered]
    if len(rows) < 2:
        raise InvalidInput(f"{path}: found no rows, expected a line of column names and measurements under it")
    if len(rows[0]) == 1:
        for separator, name in ((";", "';'"), ("\t", "a tab")):
            if separator in rows[0][0]:
                raise InvalidInput(
                    f"{path}: found {name} between the columns, expected ',' and numbers with a decimal point"
                )
    columns = [_column(path, cell) for cell in rows[0]]
    names = [name for name, _ in columns]
    for name in names:
        if names.count(name) > 1:
            raise InvalidInput(f"{path}: found column {name!r} twice, expected it once")
    values, robots = _values(path, columns, rows[1:], lines[1:])
    alone = any(name.startswith("length_") for name in values)
    for needed in () if alone else ("commanded_x", "commanded_y", "commanded_z"):
        if needed not in values:
            raise InvalidInput(f"{path}: found no column {needed!r}, expected one, as '{needed} [mm]'")
    count = len(rows) - 1

    def stacked(names: Iterable[str], missing: float) -> Float[np.ndarray, "rows columns"]:
        return np.stack([values.get(name, np.full(count, missing)) for name in names], axis=1)

    numbered = {
        kind: _numbered(path, kind, values, count)
        for kind in ("rest_length", "length", "tension", "swivel", "frequency")
    }
    wrenches = np.nan_to_num(stacked(WRENCH, 0.0))
    for name, column in [*values.items()]:
        if (
            name.startswith(("commanded_", "rest_length_", "length_"))
            and not name.endswith("_error")
            and np.isnan(column).any()
        ):
            line = lines[1 + int(np.argmax(np.isnan(column)))]
            raise InvalidInput(f"{path}: line {line}, column {name!r}: found nothing, expected a number")
        if name.endswith("_error") and (column <= 0).any():
            line = lines[1 + int(np.argmax(column <= 0))]
            raise InvalidInput(
                f"{path}: line {line}, column {name!r}: found {np.nanmin(column):g}, expected a positive number"
            )
        if name.endswith("_error") and name.removesuffix("_error") not in values:
            raise InvalidInput(f"{path}: found column {name!r}, expected {name.removesuffix('_error')!r} as well")
    if len(robots) > 1:
        raise InvalidInput(f"{path}: found measurements of {', '.join(sorted(robots))}, expected those of one robot")
    made = Measurements(
        stacked((f"commanded_{name}" for name in COORDINATES), np.nan if alone else 0.0),
        stacked((f"measured_{name}" for name in COORDINATES), np.nan),
        numbered["rest_length"],
        next(iter(robots), None),
        str(path),
        tensions=numbered["tension"],
        swivels=numbered["swivel"],
        frequencies=numbered["frequency"],
        masses=values.get("mass"),
        wrenches=wrenches if wrenches.any() else None,
        lengths=None if numbered["length"] is None else checked_lengths(numbered["length"], str(path)),
    )
    made._check()
    if not any(name.endswith("_error") for name in values):
        return made
    columns = (f"measured_{name}" if name in COORDINATES else name.replace(" ", "_") for name in made.names)
    stated = stacked((f"{column}_error" for column in columns), np.nan)
    cables = 0 if made.rest_lengths is None else made.rest_lengths.shape[1]
    lengths = [np.nan_to_num(values.get(f"rest_length_{i + 1}_error", np.zeros(count))) for i in range(cables)]
    return replace(
        made, stated_errors=stated, rest_length_errors=np.stack(lengths, axis=1) if np.any(lengths) else None
    )


def _numbered(path: Path, kind: str, values: Mapping[str, np.ndarray], count: int) -> np.ndarray | None:
    """Columns ``kind_1``, ``kind_2``, ..., or None where there are none; a tension may be missing between others."""
    numbered = [(match["kind"], int(match["number"])) for match in map(_NUMBERED.match, values) if match]
    found = sorted(number for of, number in numbered if of == kind)
    if not found:
        return None
    if kind in ("rest_length", "length") and found != list(range(1, len(found) + 1)):
        raise InvalidInput(f"{path}: found {kind.replace('_', ' ')}s {found}, expected 1 to the number of cables")
    most = max(number for of, number in numbered if (of == "frequency") == (kind == "frequency"))
    unknown = np.full(count, np.nan)
    return np.stack([values.get(f"{kind}_{number}", unknown) for number in range(1, most + 1)], axis=1)


def _column(path: Path, cell: str) -> tuple[str, float]:
    """A column's name, and its unit in SI units."""
    found = _HEADER.match(cell.strip())
    name = found["name"] if found else cell.strip()
    if name == "robot":
        return name, 1.0
    units = next((units for pattern, units in _COLUMNS.items() if re.fullmatch(pattern, name)), None)
    if not found or units is None:
        known = [f"{kind}_{name}" for kind in ("commanded", "measured") for name in COORDINATES]
        known += ["rest_length_1", "length_1", "tension_1", "swivel_1", "frequency_1", "mass", *WRENCH, "robot"]
        near = difflib.get_close_matches(name, known, n=1, cutoff=0.5)
        hint = f"did you mean {near[0]!r}? " if near else ""
        raise InvalidInput(f"{path}: unknown column {cell.strip()!r}: {hint}known: {', '.join(known)}")
    if found["unit"] is None or found["unit"].strip() not in units:
        unit = "no unit" if found["unit"] is None else f"unit {found['unit']!r}"
        raise InvalidInput(
            f"{path}: column {name!r}: found {unit}, expected one of {', '.join(units)}, as '{name} [..]'"
        )
    return name, units[found["unit"].strip()]


def _values(
    path: Path, columns: list[tuple[str, float]], rows: list[list[str]], lines: list[int]
) -> tuple[dict[str, np.ndarray], set[str]]:
    values = {name: np.full(len(rows), np.nan) for name, _ in columns if name != "robot"}
    robots = set()
    for place, (line, row) in enumerate(zip(lines, rows, strict=True)):
        if len(row) != len(columns):
            raise InvalidInput(f"{path}: line {line}: found {len(row)} cells, expected {len(columns)}, one per column")
        for (name, size), cell in zip(columns, row, strict=True):
            if name == "robot":
                robots.add(cell.strip())
                continue
            if not cell.strip():
                continue
            try:
                number = float(cell)
            except ValueError:
                number = np.nan
            if not np.isfinite(number):
                raise InvalidInput(
                    f"{path}: line {line}, column {name!r}: found {cell.strip()!r}, expected a finite number"
                )
            values[name][place] = number * size
    return values, robots - {""}

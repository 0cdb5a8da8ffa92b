"""Measured poses: commanded and measured coordinates, from arrays or from CSV.

A CSV file names its columns and their units, ``commanded_x [mm]``, ``measured_beta [deg]``: commanded_x, _y, _z are
needed, commanded_alpha, _beta, _gamma are 0 unless given, at least one measured_... is, rest_length_1, ... where the
winches did not follow the rigid geometry, and robot, a name. An empty cell was not measured. Angles are the paper's
R = Rz(gamma) Ry(beta) Rx(alpha).
"""

from __future__ import annotations

import csv
import difflib
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float
from numpy.typing import ArrayLike

from cdpr_sim.core.checks import checked_array, checked_path, listed, one_of, refuse_unless
from cdpr_sim.core.errors import InvalidInput
from cdpr_sim.core.files import read_text
from cdpr_sim.core.robot import Robot

COORDINATES = ("x", "y", "z", "alpha", "beta", "gamma")

LENGTHS = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "µm": 1e-6}
ANGLES = {"rad": 1.0, "deg": np.pi / 180, "°": np.pi / 180, "mrad": 1e-3}

LARGEST_FILE = 50_000_000
"""Largest size of a file [bytes]: half a million rows."""

_HEADER = re.compile(r"^(?P<name>[a-z_0-9]+)\s*(\[(?P<unit>[^\]]+)\])?$")
_REST_LENGTH = re.compile(r"^rest_length_(\d+)$")


@dataclass(frozen=True, eq=False)
class Measurements:
    """Commanded and measured poses, row by row, as six-vectors [m, rad].

    Attributes:
        commanded: (rows, 6).
        measured: (rows, 6), nan where not measured.
        rest_lengths: (rows, cables) [m], or None where the winches followed the rigid geometry.
        robot: name of the robot, if given.
        source: origin of the data, for messages.
    """

    commanded: Float[np.ndarray, "rows 6"]
    measured: Float[np.ndarray, "rows 6"]
    rest_lengths: Float[np.ndarray, "rows cables"] | None = None
    robot: str | None = None
    source: str = "measurements"

    @classmethod
    def of(
        cls,
        commanded: ArrayLike,
        measured: ArrayLike,
        *,
        coordinates: Sequence[str] = COORDINATES,
        rest_lengths: ArrayLike | None = None,
        robot: str | None = None,
    ) -> Measurements:
        """Measurements from arrays.

        Args:
            commanded: (rows, 3) [m] or (rows, 6) [m, rad].
            measured: (rows, len(coordinates)) [m, rad].
            coordinates: which of x, y, z, alpha, beta, gamma the columns of ``measured`` are.
            rest_lengths: (rows, cables) [m]; default: the rigid ones at each commanded pose.
            robot: name of the robot; checked when it is identified.

        Returns:
            Measurements of (rows,) poses, checked; coordinates that were not measured are nan.

        Raises:
            InvalidInput: shapes that do not fit, or numbers that are not finite.
            UnknownName: no such coordinate.
        """
        given = checked_array("commanded", commanded, (None, None))
        if given.shape[1] not in (3, 6):
            raise InvalidInput(f"commanded: found {given.shape[1]} columns, expected (x, y, z) or a six-vector")
        whole = np.zeros((len(given), 6))
        whole[:, : given.shape[1]] = given
        if len(given) == 0:
            raise InvalidInput("commanded: found no row, expected at least one")
        coordinates = listed("coordinates", coordinates, "a list of names")
        for name in coordinates:
            one_of("coordinate", name, COORDINATES)
        refuse_unless(str | None, robot=robot)
        if not coordinates or len(set(coordinates)) < len(coordinates):
            raise InvalidInput(f"coordinates: found {', '.join(coordinates) or 'none'}, expected some, each once")
        values = np.full((len(given), 6), np.nan)
        values[:, [COORDINATES.index(name) for name in coordinates]] = checked_array(
            "measured", measured, (len(given), len(coordinates))
        )
        lengths = None if rest_lengths is None else checked_array("rest_lengths", rest_lengths, (len(given), None))
        return cls(whole, values, lengths, robot)

    @property
    def known(self) -> Bool[np.ndarray, "rows 6"]:
        """Which coordinates were measured."""
        return ~np.isnan(self.measured)

    def __len__(self) -> int:
        return len(self.commanded)

    def check_robot(self, robot: Robot) -> None:
        """Check that these can be measurements of ``robot``.

        Raises:
            InvalidInput: they are of another one.
        """
        refuse_unless(Robot, robot=robot)
        if self.robot is not None and self.robot != robot.name:
            raise InvalidInput(f"{self.source}: found measurements of {self.robot!r}, expected of {robot.name!r}")
        if self.rest_lengths is not None and self.rest_lengths.shape[1] != robot.cables:
            raise InvalidInput(
                f"{self.source}: found {self.rest_lengths.shape[1]} rest lengths, expected {robot.cables}, one per "
                f"cable of {robot.name!r}"
            )
        if robot.mobility == "planar":
            out = [name for i, name in enumerate(COORDINATES) if i in (1, 3, 5) and self.known[:, i].any()]
            if out or self.commanded[:, [1, 3, 5]].any():
                found = f"measured {', '.join(out)}" if out else "a commanded pose out of the x-z plane"
                raise InvalidInput(
                    f"{self.source}: found {found}, but {robot.name!r} is planar: expected only x, z and beta"
                )

    def __repr__(self) -> str:
        seen = [name for name, column in zip(COORDINATES, self.measured.T, strict=True) if not np.isnan(column).all()]
        of = f" of {self.robot!r}" if self.robot else ""
        return f"<Measurements{of}: {len(self.measured)} rows of {', '.join(seen)}>"


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
    try:
        text = read_text(path, LARGEST_FILE)
    except FileNotFoundError:
        raise InvalidInput(f"{path}: no such file, expected measurements as CSV") from None
    except (OSError, UnicodeDecodeError) as error:
        raise InvalidInput(f"{path}: cannot be read as text ({error.__class__.__name__}), expected CSV") from None
    reader = csv.reader(text.splitlines())
    numbered = [(reader.line_num, row) for row in reader if any(cell.strip() for cell in row)]
    numbered = [(line, row) for line, row in numbered if not row[0].lstrip().startswith("#")]
    lines, rows = [line for line, _ in numbered], [row for _, row in numbered]
    if len(rows) < 2:
        raise InvalidInput(f"{path}: found no rows, expected a line of column names and measurements under it")
    columns = [_column(path, cell) for cell in rows[0]]
    names = [name for name, _ in columns]
    for name in names:
        if names.count(name) > 1:
            raise InvalidInput(f"{path}: found column {name!r} twice, expected it once")
    values, robots = _values(path, columns, rows[1:], lines[1:])
    for needed in ("commanded_x", "commanded_y", "commanded_z"):
        if needed not in values:
            raise InvalidInput(f"{path}: found no column {needed!r}, expected one, as '{needed} [mm]'")
    count = len(rows) - 1
    commanded = np.stack([values.get(f"commanded_{name}", np.zeros(count)) for name in COORDINATES], axis=1)
    measured = np.stack([values.get(f"measured_{name}", np.full(count, np.nan)) for name in COORDINATES], axis=1)
    if np.isnan(measured).all():
        raise InvalidInput(f"{path}: found nothing measured, expected a column such as 'measured_z [mm]'")
    lengths = sorted((int(found[1]), name) for name in names if (found := _REST_LENGTH.match(name)))
    if [number for number, _ in lengths] != list(range(1, len(lengths) + 1)):
        raise InvalidInput(f"{path}: found rest lengths {[n for n, _ in lengths]}, expected 1 to the number of cables")
    rest = np.stack([values[name] for _, name in lengths], axis=1) if lengths else None
    for name, column in [*values.items()]:
        if not name.startswith("measured_") and np.isnan(column).any():
            line = lines[1 + int(np.argmax(np.isnan(column)))]
            raise InvalidInput(f"{path}: line {line}, column {name!r}: found nothing, expected a number")
    if len(robots) > 1:
        raise InvalidInput(f"{path}: found measurements of {', '.join(sorted(robots))}, expected of one robot")
    return Measurements(commanded, measured, rest, next(iter(robots), None), str(path))


def _column(path: Path, cell: str) -> tuple[str, float]:
    """A column's name, and its unit in SI units."""
    known = [f"{kind}_{name}" for kind in ("commanded", "measured") for name in COORDINATES] + [
        "rest_length_1",
        "robot",
    ]
    found = _HEADER.match(cell.strip())
    name = found["name"] if found else cell.strip()
    if not found or (name not in known and not _REST_LENGTH.match(name)):
        near = difflib.get_close_matches(name, known, n=1, cutoff=0.5)
        hint = f"did you mean {near[0]!r}? " if near else ""
        raise InvalidInput(f"{path}: unknown column {cell.strip()!r}: {hint}known: {', '.join(known)}")
    if name == "robot":
        return name, 1.0
    units = ANGLES if name.endswith(("alpha", "beta", "gamma")) else LENGTHS
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

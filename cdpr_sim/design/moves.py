"""Variables of a layout: points in a box or along a line, tied by symmetry; cable stiffness and diameter."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float
from numpy.typing import ArrayLike

from cdpr_sim.core.checks import checked_array, frozen, listed, one_of, refuse_far, whole
from cdpr_sim.core.errors import InvalidInput
from cdpr_sim.core.materials import OF_MATERIAL
from cdpr_sim.core.robot import Robot
from cdpr_sim.core.robot_batch import VARIED, RobotBatch
from cdpr_sim.design.symmetry import Symmetry, group

POINTS = ("exits", "pulleys", "anchors", "center_of_mass")
FACTORS = ("axial_stiffness", "diameter")
LOGARITHMIC = tuple(name for name in VARIED if name in OF_MATERIAL)
"""What grows with the square of a rope's diameter."""
MOVABLE = POINTS + FACTORS
"""What may move: points; or, for each cable, the axial stiffness, or the diameter, with whose square both stiffness
and mass grow. "pulleys" are the exits of the cables that run over a pulley."""

_Row = tuple[str, float, float, dict[str, np.ndarray]]
"""A variable: its name, its bounds, and the derivatives of the parameters that it changes."""


@dataclass(frozen=True, eq=False)
class Move:
    """A variable part of a layout, and its range.

    Args:
        what: one of ``MOVABLE``.
        within: for points [m]: the largest displacement, one number or one along each of x, y and z, (3,); or a box,
            two corners (2, 3), that contains the points. Along a line: the largest displacement either way, or from
            and to, (2,). For stiffness and diameter: the largest factor, up and down; or the smallest and the largest,
            (2,).
        along: direction of a line, (3,), along which each point slides, as on a rail or a mast.
        cables: numbers of the cables, from 1; those tied to them by symmetry move with them. Default: all.

    Raises:
        UnknownName: no such variable part.
        InvalidInput: invalid or crossed bounds.
    """

    what: str
    within: ArrayLike | None
    along: ArrayLike | None = None
    cables: Sequence[int] | None = None

    def __post_init__(self) -> None:
        one_of("move", self.what, MOVABLE)
        if self.within is None:
            raise InvalidInput(f"within: found none for {self.what}, expected how far it may move")
        for cable in listed("cables", () if self.cables is None else self.cables, "numbers of cables"):
            whole("cables", cable, 1)
        within = checked_array("within", self.within, None)
        refuse_far("within", within)
        if self.what in FACTORS:
            if self.along is not None:
                raise InvalidInput(f"along: found a line for {self.what}, expected it for points alone")
            if within.shape not in ((), (2,)) or not (within > 0).all():
                raise InvalidInput(
                    f"within: found {within.tolist()} for {self.what}, expected a factor, or two, above 0"
                )
            if within.shape == () and within < 1:
                raise InvalidInput(f"within: found a factor of {within:g} for {self.what}, expected 1 or more")
        elif self.along is not None:
            if not np.linalg.norm(checked_array("along", self.along, (3,))) > 0:
                raise InvalidInput("along: found a direction of length zero, expected one")
            if within.shape not in ((), (2,)):
                raise InvalidInput(
                    f"within: found shape {within.shape} along a line, expected a distance, or from and to"
                )
        elif within.shape not in ((), (3,), (2, 3)):
            raise InvalidInput(f"within: found shape {within.shape}, expected a distance, three, or a box (2, 3)")
        if within.shape in ((), (3,)) and within.min() < 0:
            raise InvalidInput(f"within: found {within.min():g} m, expected 0 or more")
        if within.shape in ((2,), (2, 3)) and not (within[0] <= within[1]).all():
            crossed = (within[0] - within[1]).argmax()
            raise InvalidInput(
                f"within: found bounds crossed for {self.what}, from {np.ravel(within[0])[crossed]:g} to "
                f"{np.ravel(within[1])[crossed]:g}, expected the lower one first"
            )


@dataclass(frozen=True, eq=False)
class Space:
    """Space of layouts: variables with bounds, and the robot for each set of values.

    Points are those of ``robot`` plus a sum over the variables; stiffness and density are its own times the exponential
    of a sum, so that doubling and halving are equal steps.

    Attributes:
        robot: the given robot.
        names: of the variables.
        lower, upper: their bounds, (variables,).
        by: derivatives of the parameters by the variables, by the names of ``VARIED``, (variables, ...); those of
            ``LOGARITHMIC`` of the logarithms.
    """

    robot: Robot
    names: tuple[str, ...]
    lower: Float[np.ndarray, " variables"]
    upper: Float[np.ndarray, " variables"]
    by: Mapping[str, np.ndarray]

    @classmethod
    def of(cls, robot: Robot, moves: Sequence[Move], symmetry: str | Sequence[str] = "detected") -> Space:
        """The space of layouts that ``moves`` allow.

        Raises:
            UnknownName: no such symmetry.
            InvalidInput: a symmetry that the robot does not have, contradictory bounds, or nothing that can move.
        """
        symmetries = group(robot, symmetry)
        rows: list[_Row] = []
        taken: set[tuple[str, int]] = set()
        for move in moves:
            rows += _variables(robot, move, symmetries, taken)
        rows = [row for row in rows if row[2] > row[1] or row[1] != 0]
        if not any(row[2] > row[1] for row in rows):
            raise InvalidInput(
                "within: found no point that can move, expected some that the bounds and the symmetry allow to move"
            )
        names, lower, upper, each = zip(*rows, strict=True)
        none = {name: np.zeros_like(getattr(robot, name)) for name in VARIED}
        by = {name: frozen(np.array([(none | one)[name] for one in each])) for name in VARIED}
        return cls(robot, names, np.array(lower), np.array(upper), by)

    def __len__(self) -> int:
        return len(self.names)

    def layouts(self, values: Float[np.ndarray, "layouts variables"]) -> RobotBatch:
        """The robots with these values."""
        changed = {}
        for name, by in self.by.items():
            start, step = getattr(self.robot, name), np.tensordot(values, by, 1)
            changed[name] = start * np.exp(step) if name in LOGARITHMIC else start + step
        return RobotBatch(self.robot, **changed)

    @property
    def given(self) -> Float[np.ndarray, " variables"]:
        """Values of the given robot, clipped to the bounds."""
        return np.zeros(len(self)).clip(self.lower, self.upper)

    @property
    def free(self) -> Bool[np.ndarray, " variables"]:
        """Which variables have room between their bounds."""
        return self.upper > self.lower

    def completed(self, values: Float[np.ndarray, "layouts free"]) -> Float[np.ndarray, "layouts variables"]:
        """Values of all variables, from those of the free ones; the others are the given robot's."""
        whole_rows = np.tile(self.given, (len(values), 1))
        whole_rows[:, self.free] = values
        return whole_rows


def _cables(robot: Robot, move: Move) -> list[int]:
    """Cables that move, counted from 0."""
    cables = range(robot.cables) if move.cables is None else [int(cable) - 1 for cable in move.cables]
    for cable in cables:
        if not 0 <= cable < robot.cables:
            raise InvalidInput(f"cables: found cable {cable + 1}, expected 1 to {robot.cables}")
    if move.what == "pulleys":
        cables = [cable for cable in cables if robot.cabling.pulleys[cable]]
        if not cables:
            raise InvalidInput(f"move: found 'pulleys', but {robot.name!r} has none there; expected 'exits'")
    return sorted(cables)


def _variables(robot: Robot, move: Move, symmetries: list[Symmetry], taken: set[tuple[str, int]]) -> list[_Row]:
    """The variables of a move; the points and cables that they change are added to those ``taken``."""
    parameter = {"pulleys": "exits", "diameter": "axial_stiffness"}.get(move.what, move.what)
    center, cables, within = parameter == "center_of_mass", _cables(robot, move), np.asarray(move.within, dtype=float)
    twice = [cable + 1 for cable in cables if (parameter, cable) in taken and not center]
    if twice:
        raise InvalidInput(f"move: found {move.what} of cable {twice[0]} twice, expected it once")
    points = robot.center_of_mass[None] if center else getattr(robot, parameter)
    images = [(one.signs, np.zeros(1, int) if center else one.images) for one in symmetries]
    directions = np.eye(3)[[0, 2] if robot.mobility == "planar" else [0, 1, 2]]
    if move.along is not None:
        directions = [np.asarray(move.along, dtype=float) / np.linalg.norm(move.along)]
    rows: list[_Row] = []
    for leader in [0] if center else cables:
        if (parameter, leader) in taken:
            continue
        orbit = sorted({int(to[leader]) for _, to in images})
        taken.update((parameter, one) for one in orbit)
        if move.what in FACTORS:
            by = np.isin(np.arange(robot.cables), orbit) * (2.0 if move.what == "diameter" else 1.0)
            least, most = np.log((1 / within, within) if within.shape == () else within).tolist()
            name = f"{move.what.replace('_', ' ')} of cable {_listed(orbit)}"
            changed = LOGARITHMIC if move.what == "diameter" else (parameter,)
            rows.append((name, least, most, dict.fromkeys(changed, by)))
            continue
        boxed = [one for one in orbit if center or one in cables]
        for direction in directions:
            by = np.zeros_like(points)
            for one in orbit:  # mean over the symmetries that map to the same cable
                by[one] = np.mean([signs * direction for signs, to in images if to[leader] == one], axis=0)
            if not by.any():
                continue
            axis = None if move.along is not None else int(np.abs(direction).argmax())
            label = "" if axis is None else f"{'xyz'[axis]} of "
            name = f"{label}centre of mass" if center else f"{label}{parameter} {_listed(orbit)}"
            bounds = _bounds(within, axis, points[boxed], by[boxed], name)
            rows.append((name, *bounds, {parameter: by[0] if center else by}))
    return rows


def _bounds(within: np.ndarray, axis: int | None, points: np.ndarray, by: np.ndarray, name: str) -> tuple[float, float]:
    """Bounds of a variable that moves ``points`` along ``by``."""
    if axis is None or within.ndim < 2:
        reach = within if within.shape != (3,) else within[axis]
        lower, upper = (-reach, reach) if np.shape(reach) == () else reach
        return float(lower), float(upper)
    # Of each point; the interval is reversed where it is mirrored.
    room = (within[:, axis] - points[:, axis, None]) / by[:, axis, None]
    lower, upper = float(room.min(1).max()), float(room.max(1).min())
    if lower > upper:
        raise InvalidInput(
            f"within: found bounds crossed for {name}: no point in the box from {within[0, axis]:g} to "
            f"{within[1, axis]:g} m has its images in the box; expected a box with the same symmetry, or cables=..."
        )
    return lower, upper


def _listed(cables: Sequence[int]) -> str:
    return ", ".join(str(cable + 1) for cable in cables)

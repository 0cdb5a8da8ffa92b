"""Robots as robot files: the TOML that ``load_robot`` reads, with exactly the same numbers."""

from __future__ import annotations

import json
from collections.abc import Iterator

import numpy as np
from numpy.typing import ArrayLike

from cdpr_sim.core.cable import DOWN, NO_ELEMENT, NO_TERM
from cdpr_sim.core.robot import STANDARD_GRAVITY, Robot

OF_ALL = (
    "axial_stiffness", "linear_density", "stiffening", "force_min", "force_max", "breaking_load", "winch_to_exit",
    "pulley_friction", "reeving",
)  # fmt: skip
"""Keys of a cable that the whole robot has as well."""


def as_toml(robot: Robot) -> str:
    """The text of a robot file, in metres, kilograms and newtons; fields with their default values are left out.

    ``robot.notes`` become comments at its beginning.
    """
    return "\n".join(_lines(robot)) + "\n"


def _lines(robot: Robot) -> Iterator[str]:
    given, cabling = robot._given, robot.cabling
    for note in robot.notes:
        yield f"# {' '.join(note.split())}"
    yield f"name = {_text(robot.name)}"
    for field in ("description", "source"):
        if getattr(robot, field):
            yield f"{field} = {_text(getattr(robot, field))}"
    if robot.mobility != "spatial":
        yield f"mobility = {_text(robot.mobility)}"
    if robot.gravity != STANDARD_GRAVITY:
        yield f"gravity = {_numbers(robot.gravity)}"
    common = {name: getattr(cabling, name) for name in OF_ALL if name != "reeving" or (cabling.reeving > 1).any()}
    own = {name: values for name, values in common.items() if (values != values[0]).any()}
    for name, values in common.items():
        if name not in own and values[0].any() and np.isfinite(values[0]).all():
            yield f"{name} = {_numbers(values[0])}"
    rows = {"hysteresis": (cabling.hysteresis, NO_ELEMENT), "creep": (cabling.creep, NO_TERM)}
    for name, (values, none) in rows.items():
        if values.size and (values == values[0]).all():
            yield f"{name} = {_rows(values[0], none)}"
    named = [f"name = {_text(robot.material)}"] if robot.material and "axial_stiffness" in own else []
    if robot.material and not named:
        yield f"cable_name = {_text(robot.material)}"
    yield from ("", "[platform]", f"mass = {_numbers(robot.mass)}")
    for key, field in (("size", "platform_size"), ("center_of_mass", "center_of_mass"), ("inertia", "inertia")):
        if given[field] is not None and np.any(given[field]):
            yield f"{key} = {_numbers(getattr(robot, field))}"
    for field in ("frame", "workspace"):
        if given[field] is not None:
            lower, upper = getattr(robot, field)
            yield from ("", f"[{field}]", f"lower = {_numbers(lower)}", f"upper = {_numbers(upper)}")
    for cable in range(robot.cables):
        yield from ("", "[[cables]]")
        yield f"exit = {_numbers(cabling.exits[cable])}"
        yield f"anchor = {_numbers(cabling.anchors[cable])}"
        yield from named  # a cable's name belongs to its material
        for name, values in own.items():
            if np.isfinite(values[cable]).all():  # an infinite limit is left out
                yield f"{name} = {_numbers(values[cable])}"
        for name, (values, none) in rows.items():
            if (values != values[0]).any() and (values[cable] != none).any():
                yield f"{name} = {_rows(values[cable], none)}"
        if cabling.pulley_radius[cable] > 0 or tuple(cabling.pulley_axis[cable]) != DOWN:
            yield f"pulley = {_pulley(cabling.pulley_radius[cable], cabling.pulley_axis[cable])}"


def _pulley(radius: float, axis: np.ndarray) -> str:
    arrives = "" if tuple(axis) == DOWN else f", axis = {_numbers(axis)}"
    return f"{{ radius = {_numbers(radius)}{arrives} }}"


def _rows(values: np.ndarray, none: tuple[float, ...]) -> str:
    """Rows of one cable, without those that have no effect."""
    return _numbers(values[(values != none).any(-1)])


def _numbers(values: ArrayLike) -> str:
    """Numbers that read back identically: Python's shortest form, and no minus before a zero."""
    return str((np.asarray(values, dtype=float) + 0.0).tolist())


def _text(value: str) -> str:
    """A basic string: JSON's escapes are valid in TOML."""
    return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")

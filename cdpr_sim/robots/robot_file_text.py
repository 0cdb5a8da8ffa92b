"""Robots as robot files: the TOML that ``load_robot`` reads, with exactly the same numbers."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from cdpr_sim.core.cable import PROPERTIES
from cdpr_sim.core.checks import FLAG, refuse_unless
from cdpr_sim.core.files import check_place, write_whole
from cdpr_sim.core.materials import OF_MATERIAL, Material, is_material, load_material
from cdpr_sim.core.property import Property
from cdpr_sim.core.robot import STANDARD_GRAVITY, Robot
from cdpr_sim.robots.catalogue import OF_ALL, OF_WHEEL


def write_robot(path: str | Path, robot: Robot, *, force: bool = False) -> Path:
    """Write a robot file, which ``load_robot`` and all commands read, with exactly the numbers of ``robot``.

    Fields with their default values are left out, and numbers that came from a material are written as its name.
    ``robot.notes`` become comments.

    Args:
        path: of the file, ending in .toml.
        robot: the robot.
        force: whether to replace an existing file.

    Returns:
        The path.

    Raises:
        InvalidInput: a path that cannot be written, an existing file, or no robot.
        StoreError: a full disk.
    """
    refuse_unless(FLAG, force=force)
    refuse_unless(Robot, robot=robot)
    place = check_place(path, [".toml"], force=force)
    write_whole({place: as_toml(robot).encode()})
    return place


def as_toml(robot: Robot) -> str:
    """The text of a robot file, in metres, kilograms and newtons; fields with their default values are left out.

    Numbers that came from a material are written as its name, if it has exactly those numbers.
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
    made = _materials(robot)
    texts = {
        "material": [_text(one.name) if one else "" for one in made],
        "axial_stiffness": ["" if one else _numbers(own) for one, own in zip(made, robot.axial_stiffness, strict=True)],
    }
    texts |= {one.name: _texts(one, getattr(cabling, one.name)) for one in OF_ALL if cabling.has(one.name).any()}
    for name in OF_MATERIAL[1:]:  # the axial stiffness is above
        text = "" if PROPERTIES[name].limit else '"material"'
        names = robot.from_material.get(name, (None,) * robot.cables)
        for cable, one in enumerate(made):
            if (
                name in texts
                and one
                and names[cable] == one.name
                and _same(getattr(one, name), getattr(cabling, name)[cable])
            ):
                texts[name][cable] = text
    own = {name: each for name, each in texts.items() if len(set(each)) > 1}  # an infinite limit is left out
    for name, each in texts.items():
        if name not in own and each[0]:
            yield f"{name} = {each[0]}"
    stiff = {"material", "axial_stiffness"} & {*own}
    named = [f"name = {_text(robot.material)}"] if robot.material and stiff else []
    if robot.material and not named and robot.material != (made[0] and made[0].name):
        yield f"cable_name = {_text(robot.material)}"
    if robot.pretension is not None:
        yield f"pretension = {_numbers(robot.pretension)}"
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
        yield from (f"{name} = {each[cable]}" for name, each in own.items() if each[cable])
        wheel = {one.name: getattr(cabling, one.name)[cable : cable + 1] for one in OF_WHEEL}
        own_of_wheel = [one.name for one in OF_WHEEL if one.in_effect(wheel[one.name])[0]]
        if own_of_wheel:  # a file says of each wheel how large it is
            keys = [one for one in OF_WHEEL if one.name in own_of_wheel or not one.only_with]
            texts_of_wheel = (f"{one.place[1]} = {_numbers(wheel[one.name][0])}" for one in keys)
            yield f"pulley = {{ {', '.join(texts_of_wheel)} }}"


def _materials(robot: Robot) -> list[Material | None]:
    """Of each cable the material from which its stiffness came; None without one, or if its stiffness differs now."""
    names = robot.from_material.get("axial_stiffness", (None,) * robot.cables)
    loads = robot.from_material.get("breaking_load", (None,) * robot.cables)
    found: list[Material | None] = []
    for cable, name in enumerate(names):
        made = load_material(name) if name and is_material(name) else None
        unknown = np.isinf(robot.breaking_load[cable]) and not loads[cable]  # which a file cannot say of a material
        same = made is not None and _same(made.axial_stiffness, robot.axial_stiffness[cable])
        found.append(made if made and same and not (unknown and made.breaking_load is not None) else None)
    return found


def _same(number: float | None, stored: float) -> bool:
    return bool((np.inf if number is None else number) == stored)


def _texts(one: Property, values: np.ndarray) -> list[str]:
    """The value of each cable; "" where it has no limit or no rows."""
    if one.none is None:
        return [_numbers(numbers) if np.isfinite(numbers).all() else "" for numbers in values]
    in_effect = [rows[(rows != one.none).any(-1)] for rows in values]
    return [_numbers(rows) if len(rows) else "" for rows in in_effect]


def _numbers(values: ArrayLike) -> str:
    """Numbers that read back identically: Python's shortest form, and no minus before a zero."""
    return str((np.asarray(values, dtype=float) + 0.0).tolist())


def _text(value: str) -> str:
    """A basic string: JSON's escapes are valid in TOML."""
    return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")

"""Documentation of robot files: a table of their keys, a JSON schema for editors, and a template."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from importlib import resources
from string import Template
from typing import Any

from pydantic import BaseModel
from pydantic.fields import FieldInfo
from pydantic_core import PydanticUndefined

from cdpr_sim.core.checks import checked_name
from cdpr_sim.core.materials import MATERIALS, ROPES
from cdpr_sim.robots.catalogue import (
    OF_ALL,
    OF_WHEEL,
    BoxTable,
    CableTable,
    PlatformTable,
    PulleyTable,
    RobotTable,
    list_robots,
    load_robot,
)
from cdpr_sim.robots.robot_file_text import as_toml

COMMENTS = 34
"""Column of the template at which comments begin."""

TABLES: dict[str, type[BaseModel]] = {
    "The whole robot": RobotTable,
    "`[platform]`": PlatformTable,
    "`[[cables]]`, once for each cable": CableTable,
    "`pulley`, of the whole robot or of a cable": PulleyTable,
    "`[frame]` and `[workspace]`": BoxTable,
}


def template(name: str) -> str:
    """A commented, valid robot file of a robot called ``name``.

    Raises:
        InvalidInput: not a valid name of a robot.
    """
    quoted = json.dumps(checked_name("name", name), ensure_ascii=False)  # as TOML quotes
    text = (resources.files("cdpr_sim.robots") / "template.toml").read_text(encoding="utf-8")
    return text.replace("#CABLES\n", "".join(_examples())).replace('"NAME"', quoted).replace("NAME", name)


def _examples() -> Iterator[str]:
    """Lines of the template: the examples of the properties of cables, those of a pulley in one line."""
    for one in OF_ALL:
        if one.example is not None:
            value, comment = one.example
            yield f"{f'#{one.name} = {value}':{COMMENTS}}# {comment}".removesuffix("# ").rstrip() + "\n"
    keys = ", ".join(f"{one.place[1]} = {one.example[0]}" for one in OF_WHEEL if one.example)
    yield f"#pulley = {{ {keys} }}   # {'; '.join(one.example[1] for one in OF_WHEEL if one.example)}\n"


def copied(source: str, name: str) -> str:
    """The robot file of a robot, a name of the catalogue or a file, for a robot called ``name``.

    Of the catalogue the file itself, with its comments.

    Raises:
        CdprError: no such robot, or not a valid name of a robot.
    """
    robot, name = load_robot(source), checked_name("name", name)
    if source not in list_robots():
        return as_toml(robot.replace(name=name))
    text = (resources.files("cdpr_sim.robots") / "zoo" / f"{source}.toml").read_text(encoding="utf-8")
    quoted = json.dumps(name, ensure_ascii=False)
    return re.sub(r"(?m)^name = .*$", lambda _: f"name = {quoted}", text, count=1)


def json_schema() -> str:
    """The JSON schema of robot files, with which editors check and complete them."""
    schema = {"$schema": "https://json-schema.org/draft/2020-12/schema"} | RobotTable.model_json_schema()
    return json.dumps(schema | {"title": "Robot file of cdpr_sim"}, indent=2, ensure_ascii=False)


def document() -> str:
    """``docs/robot-file.md``: every key with its unit, default and meaning, and the materials, in Markdown."""
    page = Template((resources.files("cdpr_sim.robots") / "robot_file.md").read_text(encoding="utf-8"))
    keys = [
        f"\n## {title}\n\n| key | unit | default | meaning |\n|---|---|---|---|\n"
        + "".join(
            f"| `{key}` | {_unit(field)} | {_default(field)} | {field.description} |\n"
            for key, field in table.model_fields.items()
        )
        for title, table in TABLES.items()
    ]
    ropes, cables = (
        "".join(f"| `{name}` | {' | '.join(cells)} |\n" for name, *cells in rows)
        for rows in (rope_rows(), material_rows())
    )
    return page.substitute(keys="".join(keys), ropes=ropes, cables=cables)


def rope_rows() -> list[tuple[str, ...]]:
    """Name, modulus, fill, density, strength and source of each rope."""
    return [
        (one.name, f"{one.modulus / 1e9:g} GPa", f"{one.fill:g}", f"{one.density:g} kg/m³", one.strength_in_words,
         one.source)
        for one in ROPES.values()
    ]  # fmt: skip


def material_rows() -> list[tuple[str, ...]]:
    """Name, EA, breaking load and source of each cable of one size."""
    return [
        (one.name, f"{one.axial_stiffness:g} N", one.breaking_load_in_words, one.source) for one in MATERIALS.values()
    ]


def _unit(field: FieldInfo) -> str:
    extra = field.json_schema_extra
    return str(extra["unit"]) if isinstance(extra, dict) else ""


def _default(field: FieldInfo) -> str:
    default: Any = field.default
    if default is PydanticUndefined:
        return "**required**"
    if default is None or isinstance(default, BaseModel) or default == "":
        return ""
    return f"`{json.dumps(default)}`"

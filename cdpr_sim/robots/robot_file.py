"""Documentation of robot files: a table of their keys, a JSON schema for editors, and a template."""

from __future__ import annotations

import json
from importlib import resources
from typing import Any

from pydantic import BaseModel
from pydantic.fields import FieldInfo
from pydantic_core import PydanticUndefined

from cdpr_sim.core.checks import checked_name
from cdpr_sim.core.materials import MATERIALS, ROPES
from cdpr_sim.robots.catalogue import BoxTable, CableTable, PlatformTable, PulleyTable, RobotTable

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
    return text.replace('"NAME"', quoted).replace("NAME", name)


def json_schema() -> str:
    """The JSON schema of robot files, with which editors check and complete them."""
    schema = {"$schema": "https://json-schema.org/draft/2020-12/schema"} | RobotTable.model_json_schema()
    return json.dumps(schema | {"title": "Robot file of cdpr_sim"}, indent=2, ensure_ascii=False)


def document() -> str:
    """``docs/robot-file.md``: every key with its unit, default and meaning, and the materials, in Markdown."""
    parts = [_HEAD]
    for title, table in TABLES.items():
        parts.append(f"\n## {title}\n\n| key | unit | default | meaning |\n|---|---|---|---|\n")
        parts += [
            f"| `{key}` | {_unit(field)} | {_default(field)} | {field.description} |\n"
            for key, field in table.model_fields.items()
        ]
    parts.append(_MATERIALS)
    parts += [f"| `{name}` | {' | '.join(cells)} |\n" for name, *cells in rope_rows()]
    parts.append(
        "\nCables of one size, without `diameter`:\n\n| `material` | EA | breaks at | source |\n|---|---|---|---|\n"
    )
    parts += [f"| `{name}` | {' | '.join(cells)} |\n" for name, *cells in material_rows()]
    return "".join(parts)


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


_HEAD = """# The robot file

A robot is a [TOML](https://toml.io) file. `cdpr-sim new mine` writes a valid one with comments,
`cdpr-sim show mine.toml -o mine.png` draws it, and `cdpr-sim settle mine.toml` or `cdpr.load_robot("mine.toml")` read
it, like every command and function that takes a robot. `cdpr-sim schema > robot.schema.json` writes a JSON schema, with
which editors check and complete robot files (in VS Code with Even Better TOML: first line `#:schema
robot.schema.json`).

The base frame has z up; gravity acts along -z. Lengths are in metres, or in millimetres with `units = "mm"`; other
units are kg, N, Pa and kg m². An error in a file is reported in one sentence: `mine.toml: EA: unknown key, did you mean
'axial_stiffness'?`

The stiffness of the cables is given in one of three ways, for all cables or for one cable in its `[[cables]]`: by
`material` (and `diameter`), by `axial_stiffness`, or by `modulus` and `diameter`.

`cdpr-sim schema --document` prints this page.
"""

_MATERIALS = """
## Materials

`material = "steel-rope"` with `diameter = 0.004`, or `material = "steel-rope-4mm"`; or, on the command line,
`--material steel-rope-4mm`, or `robot.replace(material="steel-rope-4mm")`. EA is the modulus times the filled part
of the circle, EA = E fill π d²/4; the mass per length, used with `linear_density = "material"`, is the density
times the same section. A rope's stiffness depends on its construction, its load and its age: a manufacturer's
value, or the result of `cdpr-sim identify`, is better than these. The breaking load of a new rope is its strength
times the square of the diameter.

| `material` | modulus | fill | density | strength | source |
|---|---|---|---|---|---|
"""

"""Robots from TOML files: the ones that come with the package, and yours in the same format."""

from __future__ import annotations

import dataclasses
import difflib
import os
import tomllib
from importlib import resources
from importlib.resources.abc import Traversable
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, Strict, ValidationError

from cdpr_sim.core.cable import DOWN, MOST_CABLES
from cdpr_sim.core.checks import checked_path, positive, refuse_unless, shown
from cdpr_sim.core.errors import LONGEST, CdprError, InvalidInput, RobotFileError, UnknownName
from cdpr_sim.core.files import read_text
from cdpr_sim.core.materials import ROPES, Material, is_material, line_stiffness, load_material
from cdpr_sim.core.plausibility import checked_diameter
from cdpr_sim.core.robot import STANDARD_GRAVITY, Mobility, Robot

Number = Annotated[float, Strict()]  # "0.4" in quotes is a mistake, not a number
Pair = tuple[Number, Number]
Vector = tuple[Number, Number, Number]
Density = Number | Literal["material"]

LARGEST_FILE = 1_000_000
"""Bytes; a thousand cables, with a line of remarks each, take a tenth of it."""

METRES = {"m": 1.0, "mm": 1000.0}
"""How many of each unit make a metre."""


LENGTH = "m or mm"
"""The unit of lengths: what the file's ``units`` say."""


def _key(meaning: str, unit: str = "", default: Any = ...) -> Any:
    """A key of a robot file: what it means, its unit, and its default; ... where it has to be there."""
    return Field(default, description=meaning, json_schema_extra={"unit": unit} if unit else None)


class _Table(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class PlatformTable(_Table):
    """The platform."""

    mass: Number = _key("Mass.", "kg")
    size: Vector | None = _key(
        "Edges of its box, drawn and taken for the inertia unless one is given; by default the box around the anchors.",
        LENGTH,
        None,
    )
    center_of_mass: Vector = _key("Centre of mass in the platform frame.", LENGTH, (0.0, 0.0, 0.0))
    inertia: Vector | tuple[Vector, Vector, Vector] | None = _key(
        "Inertia about the centre of mass in the platform frame, its diagonal or three rows; by default that of a "
        "uniform box.",
        "kg m²",
        None,
    )


class PulleyTable(_Table):
    """A swivelling wheel at the exit."""

    radius: Number = _key("Radius of the wheel; 0 is a point.", LENGTH)
    axis: Vector = _key("The direction in which the cable arrives, and about which the wheel swivels.", "", DOWN)


class CableTable(_Table):
    """One cable. What it does not say is as the whole robot has it."""

    exit: Vector = _key(
        "Exit point A_i in the base frame, z up; of a cable over a pulley, where it touches the wheel first.", LENGTH
    )
    anchor: Vector = _key("Anchor point B_i in the platform frame.", LENGTH)
    name: str | None = _key("What this cable is called.", "", None)
    material: str | None = _key("As for the whole robot.", "", None)
    axial_stiffness: Number | None = _key("As for the whole robot.", "N", None)
    modulus: Number | None = _key("As for the whole robot.", "Pa", None)
    diameter: Number | None = _key("As for the whole robot.", LENGTH, None)
    linear_density: Density | None = _key("As for the whole robot.", "kg/m", None)
    stiffening: Pair | None = _key("As for the whole robot.", "", None)
    force_min: Number | None = _key("As for the whole robot.", "N", None)
    force_max: Number | None = _key("As for the whole robot.", "N", None)
    breaking_load: Number | None = _key("As for the whole robot.", "N", None)
    pulley: PulleyTable | None = _key("As for the whole robot.", "", None)


class BoxTable(_Table):
    """A box in the base frame."""

    lower: Vector = _key("One corner.", LENGTH)
    upper: Vector = _key("The opposite corner.", LENGTH)


class RobotTable(_Table):
    """The whole robot; what it says of cables holds for every one that says nothing of its own."""

    name: str = _key("What tables, models and pictures call the robot.")
    description: str = _key("One line.", "", "")
    source: str = _key("Where the numbers come from.", "", "")
    units: Literal["m", "mm"] = _key("Of every length in the file: exits, anchors, pulleys, diameters, boxes.", "", "m")
    mobility: Mobility = _key("spatial, or planar: x, z and the rotation about y, all else 0.", "", "spatial")
    gravity: Number = _key("Acceleration downwards, along -z.", "m/s²", STANDARD_GRAVITY)
    cable_name: str | None = _key("What the cables are called; by default their material.", "", None)
    material: str | None = _key(
        "What the cables are: a rope with its diameter, `dyneema-2mm` or `dyneema` and `diameter`, or a cable of one "
        "size; `cdpr-sim robots` lists them. Every cable has to have this, or `axial_stiffness`, or `modulus`.",
        "",
        None,
    )
    axial_stiffness: Number | None = _key("EA.", "N", None)
    modulus: Number | None = _key("E over the full circle of `diameter`: EA = E π d²/4.", "Pa", None)
    diameter: Number | None = _key("Of cables given by a rope's `material` or by `modulus`.", LENGTH, None)
    linear_density: Density = _key(
        'Mass per length; 0 is a massless cable, `"material"` the rope\'s own. Not with pulleys or stiffening on one '
        "cable.",
        "kg/m",
        0.0,
    )
    stiffening: Pair = _key("(a2, a3) of tension = EA (eps + a2 eps² + a3 eps³), for eps up to 0.2.", "", (0.0, 0.0))
    force_min: Number = _key("Smallest tension that `compensate` and `sweep` keep in a cable.", "N", 0.0)
    force_max: Number | None = _key("Largest that a cable or its winch takes; by default without a limit.", "N", None)
    breaking_load: Number | None = _key(
        "Smallest tension at which a cable breaks; by default that of its material, where it is known.", "N", None
    )
    pulley: PulleyTable = _key("The wheel at each exit; by default none.", "", PulleyTable(radius=0.0))
    platform: PlatformTable = _key("Its mass, and what it is like: `[platform]`.")
    frame: BoxTable | None = _key("What is drawn; by default the box around the exits, down to the floor.", "", None)
    workspace: BoxTable | None = _key(
        "Where studies command the platform, its middle first of all; by default the middle of the frame.", "", None
    )
    cables: list[CableTable] = _key("One `[[cables]]` for each cable.")

    def robot(self) -> Robot:
        """The robot of this file."""
        made = [self._made(i, cable) for i, cable in enumerate(self.cables)]
        names = {material.name for material in made}
        pulleys = [_own(cable.pulley, self.pulley) for cable in self.cables]
        return Robot(
            exits=[self._metres(cable.exit) for cable in self.cables],
            anchors=[self._metres(cable.anchor) for cable in self.cables],
            axial_stiffness=[material.axial_stiffness for material in made],
            mass=self.platform.mass,
            linear_density=[self._density(i, cable, made[i]) for i, cable in enumerate(self.cables)],
            stiffening=[_own(cable.stiffening, self.stiffening) for cable in self.cables],
            force_min=[_own(cable.force_min, self.force_min) for cable in self.cables],
            force_max=[_own(_own(cable.force_max, self.force_max), np.inf) for cable in self.cables],
            breaking_load=[np.inf if one.breaking_load is None else one.breaking_load for one in made],
            pulley_radius=[pulley.radius / METRES[self.units] for pulley in pulleys],
            pulley_axis=[pulley.axis for pulley in pulleys],
            center_of_mass=self._metres(self.platform.center_of_mass),
            inertia=self.platform.inertia,
            mobility=self.mobility,
            gravity=self.gravity,
            name=self.name,
            platform_size=self.platform.size and self._metres(self.platform.size),
            frame=self.frame and (self._metres(self.frame.lower), self._metres(self.frame.upper)),
            workspace=self.workspace and (self._metres(self.workspace.lower), self._metres(self.workspace.upper)),
            material=names.pop() or None if len(names) == 1 else None,
            description=self.description,
            source=self.source,
        )

    def _metres(self, lengths: Vector) -> Vector:
        x, y, z = (length / METRES[self.units] for length in lengths)
        return x, y, z

    def _made(self, index: int, cable: CableTable) -> Material:
        """What a cable is made of: as it says itself, else as the robot does."""
        for where, table in ((f"cable {index + 1}", cable), ("the robot", self)):
            ways = [way for way in WAYS if getattr(table, way) is not None]
            if len(ways) > 1:
                raise RobotFileError(f"{where}: found both {ways[0]} and {ways[1]}, expected one of them")
            if ways:
                diameter = _own(cable.diameter, self.diameter)
                made = self._material(where, table, diameter, _own(table.diameter, cable.diameter))
                name = _own(cable.name, self.cable_name if table is self else None)
                breaking_load = _own(cable.breaking_load, self.breaking_load)
                return dataclasses.replace(
                    made, name=_own(name, made.name), breaking_load=_own(breaking_load, made.breaking_load)
                )
        raise RobotFileError(
            f"cable {index + 1}: found neither material nor axial_stiffness nor modulus, here or for the whole robot"
        )

    def _material(
        self, where: str, table: CableTable | RobotTable, diameter: float | None, given: float | None
    ) -> Material:
        """Of a table that has one of ``WAYS``; ``given`` is a diameter meant for it alone."""
        metres = None if diameter is None else diameter / METRES[self.units]
        if table.modulus is not None or table.material in ROPES:
            way = "modulus" if table.modulus is not None else f"material {table.material!r}"
            if metres is None:
                raise RobotFileError(f"{where}: found {way} without diameter, expected both")
            if table.modulus is None:
                return ROPES[str(table.material)].of(metres)
            stiffness = line_stiffness(positive("modulus", table.modulus, "Pa"), checked_diameter(metres))
            return Material("", stiffness, "")
        if given is not None:
            if table.material is not None and not is_material(table.material):
                raise UnknownName("material", table.material, ROPES, ", with a diameter")
            raise RobotFileError(
                f"{where}: found diameter, expected none: it goes with modulus or with a material of "
                f"{', '.join(sorted(ROPES))}"
            )
        if table.material is not None:
            return load_material(table.material)
        assert table.axial_stiffness is not None
        return Material("", table.axial_stiffness, "")

    def _density(self, index: int, cable: CableTable, material: Material) -> float:
        density = _own(cable.linear_density, self.linear_density)
        if density != "material":
            return density
        if material.linear_density is None:
            raise RobotFileError(
                f"cable {index + 1}: linear_density: found 'material', expected a number [kg/m]: the mass of "
                f"{material.name or 'a cable given by its stiffness'} is not known"
            )
        return material.linear_density


WAYS = ("material", "axial_stiffness", "modulus")
"""Of saying what a cable is."""


def _own(own, common):
    return common if own is None else own


PAPER_ROBOTS = ("cogiro", "parallel", "planar-horizontal", "planar-vertical", "two-cable")
"""DemoBot, in the paper's layouts."""


def list_robots() -> tuple[str, ...]:
    """Names of the robots that come with the package.

    Returns:
        What ``load_robot`` knows by name, in alphabetical order.
    """
    return tuple(sorted(Path(file.name).stem for file in _folder().iterdir() if file.name.endswith(".toml")))


def load_robot(name: str | Path) -> Robot:
    """A robot of the catalogue by name, or any robot by the path of its ``.toml`` file or of another project's file.

    What ``import_robot`` reads is taken as well, with ``robot.notes``.

    Args:
        name: of the catalogue (``list_robots()``), or the path of a file.

    Returns:
        The robot, checked.

    Raises:
        InvalidInput: neither a name nor a path.
        UnknownName: no such robot in the catalogue.
        RobotFileError: the file is missing, is not TOML, or does not describe a robot: the message gives the
            path inside the file, what was found and what is expected.
    """
    refuse_unless(str | os.PathLike, name=name)
    if str(name).endswith(".toml"):
        return _read(checked_path("name", name), str(name))
    if str(name) in list_robots():
        return _read(_folder() / f"{name}.toml", f"{name}.toml")
    from cdpr_sim.robots.importing import IMPORTED, import_robot  # parsers that the catalogue does not need

    if str(name).lower().endswith(IMPORTED):
        return import_robot(name)
    files = [file for suffix in (".toml", *IMPORTED) if os.path.isfile(file := f"{name}{suffix}")]
    raise UnknownName("robot", str(name), list_robots(), "; a robot of your own is the path of its .toml file", files)


def _folder() -> Traversable:
    return resources.files("cdpr_sim.robots") / "zoo"


def _read(file: Traversable | Path, label: str) -> Robot:
    document = _parsed(file, label)
    cables = document.get("cables")
    if isinstance(cables, list) and len(cables) > MOST_CABLES:
        raise RobotFileError(f"{label}: cables: found {len(cables)}, expected at most {MOST_CABLES}")
    try:
        return RobotTable.model_validate(document).robot()
    except ValidationError as error:
        raise RobotFileError(f"{label}: {_sentence(error)}") from None
    except CdprError as error:
        raise RobotFileError(f"{label}: {error}") from None


def _parsed(file: Traversable | Path, label: str) -> dict[str, Any]:
    try:
        text = read_text(file, LARGEST_FILE) if isinstance(file, Path) else file.read_text(encoding="utf-8")
        return tomllib.loads(text)
    except InvalidInput as error:
        raise RobotFileError(str(error)) from None
    except FileNotFoundError:
        raise RobotFileError(f"{label}: no such file") from None
    except tomllib.TOMLDecodeError as error:
        raise RobotFileError(f"{label}: is not TOML: {error}") from None
    except RecursionError:
        raise RobotFileError(f"{label}: found brackets nested too deeply, expected a robot") from None
    except (OSError, UnicodeDecodeError) as error:
        raise RobotFileError(f"{label}: cannot be read: {error}") from None
    except ValueError:  # Python's limit of digits
        raise RobotFileError(f"{label}: found a whole number of thousands of digits, expected a robot") from None


OTHER_WORDS = {
    "ea": "axial_stiffness", "stiffness": "axial_stiffness", "es": "axial_stiffness", "k": "axial_stiffness",
    "e": "modulus", "youngs_modulus": "modulus", "elasticity": "modulus", "d": "diameter",
    "com": "center_of_mass", "cog": "center_of_mass", "centre_of_mass": "center_of_mass", "m": "mass", "weight": "mass",
    "a": "exit", "base": "exit", "exits": "exit", "anchors": "anchor", "b": "anchor", "attachment": "anchor",
    "rho": "linear_density", "density": "linear_density", "g": "gravity", "i": "inertia", "cable": "cables",
}  # fmt: skip
"""What else is said for keys of a robot file, in small letters."""

TABLES = {
    "platform": PlatformTable,
    "cables": CableTable,
    "pulley": PulleyTable,
    "frame": BoxTable,
    "workspace": BoxTable,
}


def _sentence(error: ValidationError) -> str:
    """The first thing that is wrong: where in the file, what was found, what is expected."""
    first = min(error.errors(), key=lambda one: one["type"] != "extra_forbidden")  # a typo explains what is missing
    path = first["loc"]
    if first["type"] == "extra_forbidden":
        return f"{_place(path)}: unknown key{_meant(str(path[-1]), path[:-1])}"
    where = _place(
        tuple(part for part in path if part != "float" and "[" not in str(part))
    )  # pydantic's names of types
    if first["type"] == "missing":
        return f"{where}: missing"
    return f"{where}: found {shown(first['input'])}: {first['msg']}"


def _meant(key: str, path: tuple[int | str, ...]) -> str:
    """The key that was meant, in this table or else in another."""
    names = [part for part in path if isinstance(part, str)]
    here = TABLES[names[-1]] if names else RobotTable
    word = OTHER_WORDS.get(key.lower(), key.lower())
    places: dict[str, type[_Table]] = {"": here, " for the whole robot": RobotTable}
    places |= {f" in [[{name}]]" if name == "cables" else f" in [{name}]": table for name, table in TABLES.items()}
    for place, table in places.items():
        if word in table.model_fields:
            return f", did you mean {word!r}{place}?"
    for place, table in places.items():
        for near in difflib.get_close_matches(key, table.model_fields, n=1):
            return f", did you mean {near!r}{place}?"
    return ""


def _place(path: tuple[int | str, ...]) -> str:
    """Where in the file: keys, cables counted from 1 as in tables, and coordinates by letter."""
    head = ""
    if path[0] == "cables" and len(path) > 1:
        head, path = f"cable {int(path[1]) + 1}", path[2:]
    keys = ("xyz"[key] if isinstance(key, int) and key < 3 else str(key) for key in path)
    return ": ".join(
        filter(None, [head, ".".join(key if len(key) <= LONGEST else f"{key[:LONGEST]}..." for key in keys)])
    )

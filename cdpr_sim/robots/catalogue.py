"""Robots from TOML files: those of the catalogue, and users' own in the same format."""

from __future__ import annotations

import difflib
import os
import tomllib
from collections.abc import Iterable
from importlib import resources
from importlib.resources.abc import Traversable
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import AllowInfNan, BaseModel, ConfigDict, Field, Strict, ValidationError, create_model

from cdpr_sim.core.cable import MOST_CABLES, PROPERTIES
from cdpr_sim.core.checks import checked_path, positive, refuse_unless, shown
from cdpr_sim.core.errors import LONGEST, CdprError, InvalidInput, RobotFileError, UnknownName
from cdpr_sim.core.files import read_text, readable
from cdpr_sim.core.materials import ROPES, Material, Origin, is_material, line_stiffness, load_material
from cdpr_sim.core.plausibility import checked_diameter
from cdpr_sim.core.property import Property
from cdpr_sim.core.robot import STANDARD_GRAVITY, Mobility, Robot
from cdpr_sim.robots.expectations import sentence_of

Number = Annotated[float, Strict()]  # "0.4" in quotes is a mistake, not a number
Pair = tuple[Number, Number]
Vector = tuple[Number, Number, Number]
Rows = list[list[Annotated[float, Strict(), AllowInfNan(True)]]]
Density = Number | Literal["material"]

LARGEST_FILE = 1_000_000
"""Largest size of a robot file [bytes]; a thousand cables, with a line of comments each, take a tenth of it."""

METRES = {"m": 1.0, "mm": 1000.0}
"""Number of each unit in a metre."""


LENGTH = "m or mm"
"""The unit of lengths: the file's ``units``."""


def _key(meaning: str, unit: str = "", default: Any = ...) -> Any:
    """A key of a robot file: its meaning, its unit, and its default; ... if it is required."""
    return Field(default, description=meaning, json_schema_extra={"unit": unit} if unit else None)


def _of_all(unit: str = "") -> Any:
    """A key of a cable that the whole robot has as well."""
    return _key("As for the whole robot.", unit, None)


class _Table(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


WAYS = ("material", "axial_stiffness", "modulus")
"""Keys that define the cable's stiffness."""

OF_ONE, OF_WHEEL, OF_ALL = (
    [one for one in PROPERTIES.values() if one.name not in WAYS and (one.image == "point", one.place[0]) == kind]
    for kind in ((True, ""), (False, "pulley"), (False, ""))
)
"""Properties whose keys are of a cable alone, of its pulley, and of the whole robot as well as of a cable."""

_TYPES: dict[tuple[int, ...], Any] = {(): Number, (2,): Pair, (3,): Vector}


def _with(properties: Iterable[Property], base: type[_Table] = _Table, *, of_cable: bool = False) -> Any:
    """A table with the keys of these properties behind those of ``base``; in a cable's, each may be missing."""
    keys: dict[str, Any] = {}
    for one in properties:
        kind = Density if one.name == "linear_density" else Rows if one.none is not None else _TYPES[one.shape]
        kind = Number | kind if one.uniform else kind
        unit = LENGTH if one.unit == "m" else one.unit
        default = None if one.limit else list(one.default) if one.none is not None else one.default
        key = _of_all(unit) if of_cable else _key(one.meaning, unit, default)
        keys[one.place[1]] = (kind | None if of_cable or one.limit else kind, key)
    return create_model(base.__name__, __base__=base, **keys)


class PlatformTable(_Table):
    """The platform."""

    mass: Number = _key("Mass.", "kg")
    size: Vector | None = _key(
        "Edges of its box, which is drawn and gives the default inertia; by default the box around the anchors.",
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


class PulleyTable(_with(OF_WHEEL)):
    """A swivelling wheel at the exit."""

    radius: Number = _key(PROPERTIES["pulley_radius"].meaning, LENGTH)  # required here


class _OneCable(_with(OF_ONE)):
    name: str | None = _key("Name of this cable.", "", None)
    material: str | None = _of_all()
    axial_stiffness: Number | None = _of_all("N")
    modulus: Number | None = _of_all("Pa")
    diameter: Number | None = _of_all(LENGTH)


class CableTable(_with(OF_ALL, _OneCable, of_cable=True)):
    """One cable. A key that is missing here has the value for the whole robot."""

    pulley: PulleyTable | None = _of_all()


class BoxTable(_Table):
    """A box in the base frame."""

    lower: Vector = _key("One corner.", LENGTH)
    upper: Vector = _key("The opposite corner.", LENGTH)


class _WholeRobot(_Table):
    name: str = _key("Name of the robot in tables, models and pictures.")
    description: str = _key("Description of the robot in one line.", "", "")
    source: str = _key("Source of the numbers.", "", "")
    units: Literal["m", "mm"] = _key(
        "Unit of all lengths in the file: exits, anchors, pulleys, diameters, boxes.", "", "m"
    )
    mobility: Mobility = _key("spatial, or planar: motion in x, z and about y only, with all y 0.", "", "spatial")
    gravity: Number = _key("Acceleration downwards, along -z.", "m/s²", STANDARD_GRAVITY)
    pretension: Number | None = _key(
        "Rest lengths at a commanded pose are those whose tensions balance the weight there and are closest to this "
        "value; by default those of rigid cables. `--pretension` of commands, or `robot.replace(pretension=...)`, "
        "replaces it.",
        "N",
        None,
    )
    cable_name: str | None = _key("Name of the cables; by default their material.", "", None)
    material: str | None = _key(
        "The cables: a rope with its diameter, `dyneema-2mm` or `dyneema` and `diameter`, or a cable of one "
        "size; `cdpr-sim robots` lists them. Every cable needs this, or `axial_stiffness`, or `modulus`.",
        "",
        None,
    )
    axial_stiffness: Number | None = _key(PROPERTIES["axial_stiffness"].meaning, "N", None)
    modulus: Number | None = _key("Modulus E over the full circle of `diameter`: EA = E π d²/4.", "Pa", None)
    diameter: Number | None = _key(
        "Diameter of cables that are given by a rope's `material` or by `modulus`.", LENGTH, None
    )


class RobotTable(_with(OF_ALL, _WholeRobot)):
    """The whole robot; its keys about cables apply to every cable that does not set them itself."""

    pulley: PulleyTable = _key("The wheel at each exit; by default none.", "", PulleyTable(radius=0.0))
    platform: PlatformTable = _key("The platform: its mass, size, centre of mass and inertia: `[platform]`.")
    frame: BoxTable | None = _key("The drawn frame; by default the box around the exits, down to the floor.", "", None)
    workspace: BoxTable | None = _key(
        "Box of commanded positions; its middle is the default pose. By default the middle of the frame.",
        "",
        None,
    )
    cables: list[CableTable] = _key("One `[[cables]]` for each cable.")

    def robot(self) -> Robot:
        """The robot that this file describes."""
        made = [self._made(i, cable) for i, cable in enumerate(self.cables)]
        names = {name for name, _ in made}
        materials, known = [material for _, material in made], [material.name or None for _, material in made]
        densities, loads = self._each("linear_density"), self._each("breaking_load")
        from_material = {
            "axial_stiffness": known,
            "linear_density": [
                name if density == "material" else None for name, density in zip(known, densities, strict=True)
            ],
            "breaking_load": [name if load is None else None for name, load in zip(known, loads, strict=True)],
        }
        values = {one.name: self._each(one.place[1]) for one in OF_ALL}
        values |= {one.name: [getattr(wheel, one.place[1]) for wheel in self._each("pulley")] for one in OF_WHEEL}
        values |= {one.name: [getattr(cable, one.place[1]) for cable in self.cables] for one in OF_ONE}
        values["axial_stiffness"] = [material.axial_stiffness for material in materials]
        values["linear_density"] = [self._density(i, densities[i], materials[i]) for i in range(len(self.cables))]
        values["breaking_load"] = [_own(load, one.breaking_load) for load, one in zip(loads, materials, strict=True)]
        for name, each in values.items():
            if PROPERTIES[name].limit:
                values[name] = [_own(value, np.inf) for value in each]
            elif PROPERTIES[name].uniform:
                values[name] = [np.broadcast_to(value, PROPERTIES[name].shape) for value in each]
            elif PROPERTIES[name].unit == "m":
                values[name] = (np.array(each) / METRES[self.units]).tolist()
        return Robot(
            **values,
            mass=self.platform.mass,
            center_of_mass=self._metres(self.platform.center_of_mass),
            inertia=self.platform.inertia,
            mobility=self.mobility,
            gravity=self.gravity,
            name=self.name,
            platform_size=self.platform.size and self._metres(self.platform.size),
            frame=self._corners(self.frame),
            workspace=self._corners(self.workspace),
            material=names.pop() or None if len(names) == 1 else None,
            from_material={name: uniform(each) for name, each in from_material.items()},
            pretension=self.pretension,
            description=self.description,
            source=self.source,
        )

    def _each(self, key: str) -> list[Any]:
        """The value of a key for each cable: its own, else the robot's."""
        return [_own(getattr(cable, key), getattr(self, key)) for cable in self.cables]

    def _corners(self, box: BoxTable | None) -> tuple[Vector, Vector] | None:
        return box and (self._metres(box.lower), self._metres(box.upper))

    def _metres(self, lengths: Vector) -> Vector:
        x, y, z = (length / METRES[self.units] for length in lengths)
        return x, y, z

    def _made(self, index: int, cable: CableTable) -> tuple[str, Material]:
        """The material of a cable, its own, else the robot's; and before it the name that is displayed."""
        for where, table in ((f"cable {index + 1}", cable), ("the robot", self)):
            ways = [way for way in WAYS if getattr(table, way) is not None]
            if len(ways) > 1:
                raise RobotFileError(f"{where}: found both {ways[0]} and {ways[1]}, expected one of them")
            if ways:
                diameter = _own(cable.diameter, self.diameter)
                made = self._material(where, table, diameter, _own(table.diameter, cable.diameter))
                name = _own(cable.name, self.cable_name if table is self else None)
                return _own(name, made.name), made
        raise RobotFileError(
            f"cable {index + 1}: found neither material nor axial_stiffness nor modulus, here or for the whole robot"
        )

    def _material(
        self, where: str, table: CableTable | RobotTable, diameter: float | None, given: float | None
    ) -> Material:
        """The material from a table with one of ``WAYS``; ``given`` is a diameter from the same table."""
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

    def _density(self, index: int, density: Density, material: Material) -> float:
        if density != "material":
            return density
        if material.linear_density is None:
            raise RobotFileError(
                f"cable {index + 1}: linear_density: found 'material', expected a number [kg/m]: the mass of "
                f"{material.name or 'a cable given by its stiffness'} is not known"
            )
        return material.linear_density


def uniform(names: list[str | None]) -> Origin:
    """One name for all cables, or a name, or None, for each."""
    return tuple(names) if len(set(names)) > 1 or names[0] is None else names[0]


def _own(own, common):
    return common if own is None else own


PAPER_ROBOTS = ("cogiro", "parallel", "planar-horizontal", "planar-vertical", "two-cable")
"""DemoBot, in the paper's layouts."""


def list_robots() -> tuple[str, ...]:
    """Names of the robots of the catalogue.

    Returns:
        The names that ``load_robot`` accepts, in alphabetical order.
    """
    return tuple(sorted(Path(file.name).stem for file in _folder().iterdir() if file.name.endswith(".toml")))


def load_robot(name: str | Path) -> Robot:
    """A robot of the catalogue by name, or any robot by the path of its ``.toml`` file or of another project's file.

    It also reads the files that ``import_robot`` reads, with ``robot.notes``.

    Args:
        name: name in the catalogue (``list_robots()``), or the path of a file.

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
    cables = document.get("cables", [])
    if not isinstance(cables, list):
        raise RobotFileError(f"{label}: cables: found {shown(cables)}, expected one table [[cables]] for each cable")
    if len(cables) > MOST_CABLES:
        raise RobotFileError(f"{label}: cables: found {len(cables)}, expected at most {MOST_CABLES}")
    try:
        return RobotTable.model_validate(document).robot()
    except ValidationError as error:
        raise RobotFileError(f"{label}: {_sentence(error)}") from None
    except CdprError as error:
        raise RobotFileError(f"{label}: {error}") from None


def _parsed(file: Traversable | Path, label: str) -> dict[str, Any]:
    try:
        with readable(label):
            text = read_text(file, LARGEST_FILE) if isinstance(file, Path) else file.read_text(encoding="utf-8")
        return tomllib.loads(text)
    except InvalidInput as error:
        raise RobotFileError(str(error)) from None
    except tomllib.TOMLDecodeError as error:
        raise RobotFileError(f"{label}: is not TOML: {error}") from None
    except RecursionError:
        raise RobotFileError(f"{label}: found brackets nested too deeply, expected a robot") from None
    except ValueError:  # Python's limit of digits
        raise RobotFileError(f"{label}: found an integer of thousands of digits, expected a robot") from None


NO_POINTS = {one.place[1] for one in PROPERTIES.values() if one.none is not None or one.shape == (2,)}
"""Keys of lists whose elements are no coordinates."""

OTHER_WORDS = {
    "ea": "axial_stiffness", "stiffness": "axial_stiffness", "es": "axial_stiffness", "k": "axial_stiffness",
    "e": "modulus", "youngs_modulus": "modulus", "elasticity": "modulus", "d": "diameter",
    "com": "center_of_mass", "cog": "center_of_mass", "centre_of_mass": "center_of_mass", "m": "mass", "weight": "mass",
    "a": "exit", "base": "exit", "exits": "exit", "anchors": "anchor", "b": "anchor", "attachment": "anchor",
    "rho": "linear_density", "density": "linear_density", "g": "gravity", "i": "inertia", "cable": "cables",
    "pulley_radius": "radius", "pulley_axis": "axis", "platform_size": "size",
}  # fmt: skip
"""Explanations of keys of a robot file, in lower case, for messages."""

TABLES = {
    "platform": PlatformTable,
    "cables": CableTable,
    "pulley": PulleyTable,
    "frame": BoxTable,
    "workspace": BoxTable,
}


def _sentence(error: ValidationError) -> str:
    """The first error: its place in the file, the value found, and the value expected."""
    for one in error.errors(include_url=False):
        if one["type"] == "extra_forbidden":  # a typo explains a missing key
            return f"{_place(one['loc'])}: unknown key{_meant(str(one['loc'][-1]), one['loc'][:-1])}"
    return sentence_of(error, _place)


def _meant(key: str, path: tuple[int | str, ...]) -> str:
    """Suggestion of a key, in this table or else in another."""
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
    """Place in the file: keys, cables and elements of lists counted from 1 as in tables, and coordinates by letter."""
    head = ""
    if path[0] == "cables" and len(path) > 1:
        head, path = f"cable {int(path[1]) + 1}", path[2:]
    points = not NO_POINTS.intersection(path)
    keys = (("xyz"[key] if points and key < 3 else str(key + 1)) if isinstance(key, int) else key for key in path)
    where = ".".join(key if len(key) <= LONGEST else f"{key[:LONGEST]}..." for key in keys)
    return ": ".join(filter(None, [head, where]))

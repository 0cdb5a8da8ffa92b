"""Robots from TOML files: the ones that come with the package, and yours in the same format."""

from __future__ import annotations

import difflib
import tomllib
from importlib import resources
from importlib.resources.abc import Traversable
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Strict, ValidationError

from cdpr_sim.core.cable import DOWN, MOST_CABLES
from cdpr_sim.core.checks import shown
from cdpr_sim.core.errors import LONGEST, CdprError, InvalidInput, RobotFileError, UnknownName
from cdpr_sim.core.files import read_text
from cdpr_sim.core.materials import load_material
from cdpr_sim.core.robot import STANDARD_GRAVITY, Mobility, Robot
from cdpr_sim.robots.importing import IMPORTED, import_robot

Number = Annotated[float, Strict()]  # "0.4" in quotes is a mistake, not a number
Pair = tuple[Number, Number]
Vector = tuple[Number, Number, Number]

LARGEST_FILE = 1_000_000
"""Bytes; a thousand cables, with a line of remarks each, take a tenth of it."""

METRES = {"m": 1.0, "mm": 1000.0}
"""How many of each unit make a metre."""


class _Table(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class PlatformTable(_Table):
    """``[platform]``: mass [kg], edges of its box [m], centre of mass [m], inertia [kg m²]."""

    mass: Number
    size: Vector | None = None
    center_of_mass: Vector = (0.0, 0.0, 0.0)
    inertia: Vector | tuple[Vector, Vector, Vector] | None = None


class PulleyTable(_Table):
    """``pulley``: radius of the wheel [m], and the direction in which the cable arrives at it."""

    radius: Number
    axis: Vector = DOWN


class CableTable(_Table):
    """One cable: exit A_i in the base frame, anchor B_i in the platform frame [m], and what is its own."""

    exit: Vector
    anchor: Vector
    material: str | None = None
    axial_stiffness: Number | None = None
    linear_density: Number | None = None
    stiffening: Pair | None = None
    pulley: PulleyTable | None = None


class BoxTable(_Table):
    """Two opposite corners [m]."""

    lower: Vector
    upper: Vector


class RobotTable(_Table):
    """A whole robot file. What it says of cables holds for every one that says nothing of its own.

    ``material`` or ``axial_stiffness`` [N], ``linear_density`` [kg/m], ``stiffening`` (a2, a3), ``pulley``.
    ``units`` are those of exits, anchors, pulleys, size, frame and workspace; all else is in kg, N and kg m².
    """

    name: str
    description: str = ""
    source: str = ""
    units: Literal["m", "mm"] = "m"
    mobility: Mobility = "spatial"
    gravity: Number = STANDARD_GRAVITY
    material: str | None = None
    axial_stiffness: Number | None = None
    linear_density: Number = 0.0
    stiffening: Pair = (0.0, 0.0)
    pulley: PulleyTable = PulleyTable(radius=0.0)
    platform: PlatformTable
    frame: BoxTable | None = None
    workspace: BoxTable | None = None
    cables: list[CableTable]

    def robot(self) -> Robot:
        """The robot of this file."""
        return Robot(
            exits=[self._metres(cable.exit) for cable in self.cables],
            anchors=[self._metres(cable.anchor) for cable in self.cables],
            axial_stiffness=[self._stiffness(i, cable) for i, cable in enumerate(self.cables)],
            mass=self.platform.mass,
            linear_density=[_own(cable.linear_density, self.linear_density) for cable in self.cables],
            stiffening=[_own(cable.stiffening, self.stiffening) for cable in self.cables],
            pulley_radius=[_own(cable.pulley, self.pulley).radius / METRES[self.units] for cable in self.cables],
            pulley_axis=[_own(cable.pulley, self.pulley).axis for cable in self.cables],
            center_of_mass=self._metres(self.platform.center_of_mass),
            inertia=self.platform.inertia,
            mobility=self.mobility,
            gravity=self.gravity,
            name=self.name,
            platform_size=self.platform.size and self._metres(self.platform.size),
            frame=self.frame and (self._metres(self.frame.lower), self._metres(self.frame.upper)),
            workspace=self.workspace and (self._metres(self.workspace.lower), self._metres(self.workspace.upper)),
            material=self._common_material(),
            description=self.description,
            source=self.source,
        )

    def _metres(self, lengths: Vector) -> Vector:
        x, y, z = (length / METRES[self.units] for length in lengths)
        return x, y, z

    def _stiffness(self, index: int, cable: CableTable) -> float:
        for where, table in ((f"cable {index + 1}", cable), ("the robot", self)):
            if table.material is not None and table.axial_stiffness is not None:
                raise RobotFileError(f"{where}: found both material and axial_stiffness, expected one of them")
            if table.axial_stiffness is not None:
                return table.axial_stiffness
            if table.material is not None:
                return load_material(table.material).axial_stiffness
        raise RobotFileError(
            f"cable {index + 1}: found neither material nor axial_stiffness, here or for the whole robot"
        )

    def _common_material(self) -> str | None:
        own = {cable.material for cable in self.cables if cable.material or cable.axial_stiffness is not None}
        return self.material if not own else None


def _own(own, common):
    return common if own is None else own


def list_robots() -> tuple[str, ...]:
    """Names of the robots that come with the package."""
    return tuple(sorted(Path(file.name).stem for file in _folder().iterdir() if file.name.endswith(".toml")))


def load_robot(name: str | Path) -> Robot:
    """A robot of the catalogue by name, or any robot by the path of its ``.toml`` file or of another project's file.

    What ``import_robot`` reads is taken as well, with ``robot.notes``.

    Raises:
        UnknownName: no such robot in the catalogue.
        RobotFileError: the file is missing, is not TOML, or does not describe a robot: the message gives the
            path inside the file, what was found and what is expected.
    """
    if str(name).endswith(".toml"):
        return _read(Path(name), str(name))
    if str(name).lower().endswith(IMPORTED):
        return import_robot(name)
    if str(name) not in list_robots():
        raise UnknownName("robot", str(name), list_robots(), "; a robot of your own is the path of its .toml file")
    return _read(_folder() / f"{name}.toml", f"{name}.toml")


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


def _sentence(error: ValidationError) -> str:
    """The first thing that is wrong: where in the file, what was found, what is expected."""
    first = min(error.errors(), key=lambda one: one["type"] != "extra_forbidden")  # a typo explains what is missing
    where = _place(first["loc"])
    if first["type"] == "extra_forbidden":
        near = difflib.get_close_matches(str(first["loc"][-1]), _known_keys(first["loc"][:-1]), n=1)
        return f"{where}: unknown key" + (f", did you mean {near[0]!r}?" if near else "")
    if first["type"] == "missing":
        return f"{where}: missing"
    return f"{where}: found {shown(first['input'])}: {first['msg']}"


def _place(path: tuple[int | str, ...]) -> str:
    """Where in the file: keys, cables counted from 1 as in tables, and coordinates by letter."""
    head = ""
    if path[0] == "cables" and len(path) > 1:
        head, path = f"cable {int(path[1]) + 1}", path[2:]
    keys = ("xyz"[key] if isinstance(key, int) and key < 3 else str(key) for key in path)
    return ": ".join(
        filter(None, [head, ".".join(key if len(key) <= LONGEST else f"{key[:LONGEST]}..." for key in keys)])
    )


def _known_keys(path: tuple[int | str, ...]) -> list[str]:
    tables = {
        "platform": PlatformTable,
        "cables": CableTable,
        "pulley": PulleyTable,
        "frame": BoxTable,
        "workspace": BoxTable,
    }
    names = [part for part in path if isinstance(part, str)]
    return list((tables[names[-1]] if names else RobotTable).model_fields)

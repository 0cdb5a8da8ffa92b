"""Materials of cables: ropes of any diameter, and single cables of the robots of the catalogue."""

from __future__ import annotations

import dataclasses
import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from cdpr_sim.core.cable import PROPERTIES
from cdpr_sim.core.checks import checked_label, listed, one_of, refuse_unless
from cdpr_sim.core.errors import InvalidInput, UnknownName
from cdpr_sim.core.plausibility import checked_diameter


def line_stiffness(modulus: float, diameter: float, fill: float = 1.0) -> float:
    """EA [N] of a round line from its modulus [Pa], its diameter [m] and the filled fraction of its section."""
    return modulus * fill * math.pi * diameter**2 / 4


@dataclass(frozen=True)
class Material:
    """A cable of one size.

    Attributes:
        name: name of the cable.
        axial_stiffness: EA [N].
        source: source of the numbers.
        linear_density: mass per length [kg/m]; None if unknown.
        breaking_load: smallest tension at which a new one breaks [N]; None if unknown.
    """

    name: str
    axial_stiffness: float
    source: str
    linear_density: float | None = None
    breaking_load: float | None = None

    @property
    def breaking_load_in_words(self) -> str:
        """For tables."""
        return "unknown" if self.breaking_load is None else f"{self.breaking_load:g} N"


@dataclass(frozen=True)
class Rope:
    """A material of cables of any diameter.

    Attributes:
        name: name of the material.
        modulus: modulus over the section of wires or fibres without voids [Pa].
        fill: that section over the circle of the nominal diameter.
        density: mass over that section and length [kg/m³].
        source: source of the numbers.
        strength: breaking load over the square of the nominal diameter [Pa]; None if no source is known.
    """

    name: str
    modulus: float
    fill: float
    density: float
    source: str
    strength: float | None = None

    @property
    def strength_in_words(self) -> str:
        """For tables."""
        return "unknown" if self.strength is None else f"{self.strength / 1e6:.0f} MPa"

    def of(self, diameter: float) -> Material:
        """The cable of this diameter, named like ``steel-rope-4mm``.

        Args:
            diameter: of the rope [m].

        Returns:
            Its axial stiffness EA = E fill π d²/4 [N], its mass per length [kg/m] and its breaking load [N].

        Raises:
            InvalidInput: a diameter that is not positive.
        """
        diameter = checked_diameter(diameter)
        return Material(
            f"{self.name}-{1e3 * diameter:.6g}mm",
            line_stiffness(self.modulus, diameter, self.fill),
            self.source,
            line_stiffness(self.density, diameter, self.fill),
            None if self.strength is None else self.strength * diameter**2,
        )


_ASSUMED = (
    "assumed: the paper gives no EA, only that the fishing line is about 10 times softer; right order of magnitude"
)

NYLON_MODULUS = 1.5e9
"""[Pa] Modulus of nylon 66 that has absorbed moisture from air: 7.5 MPa at 0.5 % (Toray, "AMILAN nylon resin:
mechanical properties", tensile characteristics). The tensions in the paper's study stretch a 0.4 mm line by up to 1
%."""

NYLON_FIBRES = (0.6 * 1.14e9, 3.0 * 1.14e9)
"""[Pa] Range of drawn nylon around that modulus: initial moduli at 65 % humidity of 0.6 N/tex for nylon 6 and 3.0 N/tex
for nylon 6.6 of medium tenacity (Morton and Hearle, "Physical Properties of Textile Fibres", Table 13.2), times the
density of nylon, 1.14 g/cm³."""

NYLON_STRENGTH = 0.48 * 1.14e9
"""[Pa] Strength of drawn nylon 6.6 of medium tenacity, 0.48 N/tex (the same table); nylon 6 has 0.29 N/tex."""

_NYLON = (
    "1.5 GPa, nylon 66 in moist air (Toray, AMILAN technical data), times a 0.4 mm line's section; not in the paper; "
    "drawn nylon differs: 0.7 to 3.4 GPa (Morton and Hearle, Physical Properties of Textile Fibres); breaking load: "
    "0.48 N/tex, nylon 6.6 of medium tenacity (the same book, Table 13.2)"
)

MATERIALS = {
    material.name: material
    for material in (
        Material("vectran-0.7mm", 10e3, _ASSUMED),
        Material("fishing-0.4mm", 1e3, _ASSUMED),
        Material(
            "nylon-0.4mm",
            round(line_stiffness(NYLON_MODULUS, 0.4e-3)),
            _NYLON,
            breaking_load=round(line_stiffness(NYLON_STRENGTH, 0.4e-3), 1),
        ),
    )
}


PAPER_MATERIALS = ("vectran-0.7mm", "fishing-0.4mm")
"""The cables of DemoBot (section IV)."""

_YARNS = "Table 1, synthetic fibre yarn properties (Tension Technology International, tensiontech.com/papers/deep-mor)"
_MOORPY = "MoorPy's fit of makers' catalogues (github.com/NREL/MoorPy, MoorProps_default.yaml)"
_PARAFIL = "Parafil Technical Note PF1, issue 4: 25 to 30 % of a parallel core is air"

ROPES = {
    rope.name: rope
    for rope in (
        Rope(
            "steel-rope", 90e9, 0.572, 8900.0,
            "6x19 with a steel core: metallic area 0.449 d² and 0.400 kg/m per cm² of d² (EN 12385-4, in Feyrer, Wire "
            "Ropes, Table 1.9); EA = 40.4 GPa d² (moorwire.py of github.com/ddjokic/Mooring-Line-Properties); minimum "
            "breaking force 0.356 d² (EN 12385-4) times a grade of 1770 MPa",
            strength=0.356 * 1770e6,
        ),
        Rope(
            "dyneema", 64e9, 0.65, 970.0,
            "braided HMPE: 496 kg/m and 32.5 GN (56 times a breaking force of 580 MN) per m² of d², " + _MOORPY + "; "
            "the yarn alone has 109 to 132 GPa (DSM, fact sheet CIS YA100, SK75 and SK78)",
            strength=579.5e6,
        ),
        Rope(
            "vectran", 65e9, 0.65, 1410.0,
            "the yarn's 46 N/tex and 1.41 g/cm³, " + _YARNS + "; a braid is softer; fill assumed to be that of braided "
            "HMPE, " + _MOORPY + "; breaking load of a braid not known",
        ),
        Rope(
            "aramid", 71e9, 0.725, 1440.0,
            "Kevlar 29's 49 N/tex and 1.44 g/cm³, " + _YARNS + "; fill: " + _PARAFIL + "; a braid is "
            "softer; breaking load of a rope not known",
        ),
        Rope(
            "nylon", NYLON_MODULUS, 1.0, 1140.0,
            "one filament of nylon 66 in moist air: 1.5 GPa (Toray, AMILAN technical data); 1.14 g/cm³, " + _YARNS
            + "; breaking load: 0.48 N/tex, nylon 6.6 of medium tenacity (Morton and Hearle, Physical Properties of "
            "Textile Fibres, Table 13.2)",
            strength=NYLON_STRENGTH * math.pi / 4,
        ),
    )
}  # fmt: skip
"""Common materials of cables, by name."""

OTHERWISE = "or give axial_stiffness [N], or modulus [Pa] and diameter"
"""Alternatives to the name of a material, for messages."""

_OF_A_DIAMETER = re.compile(r"(.+)-(\d+(?:\.\d+)?)mm")


def is_material(name: str) -> bool:
    """Whether ``load_material`` accepts the name."""
    try:
        load_material(name)
    except UnknownName:
        return False
    return True


def load_material(name: str) -> Material:
    """The material called ``name``: one of ``MATERIALS``, or one of ``ROPES`` with its diameter, "steel-rope-4mm".

    Raises:
        UnknownName: no such material, or a rope without its diameter.
        InvalidInput: not text, or a diameter of 0.
    """
    refuse_unless(str, material=name)
    if name in MATERIALS:
        return MATERIALS[name]
    sized = _OF_A_DIAMETER.fullmatch(name)
    if sized and sized[1] in ROPES:
        return ROPES[sized[1]].of(float(sized[2]) / 1e3)
    diameter = sized[2] if sized else "2"
    known = [*MATERIALS, *(f"{rope}-{diameter}mm" for rope in ROPES)]
    meant = [f"{rope}-{diameter}mm" for rope in ROPES if (sized[1] if sized else name) in rope.split("-")]
    raise UnknownName("material", name, known, f"; a rope has any diameter, dyneema-1.5mm; {OTHERWISE}", meant)


Origin = str | tuple[str | None, ...]
"""The material from which a number of all cables came, or that of each cable; None for a number given by hand."""

OF_MATERIAL = tuple(one.name for one in dataclasses.fields(Material) if one.name in PROPERTIES)
"""Fields of cables that a material gives."""


def is_of_material(value: Any) -> bool:
    """Whether ``value`` is "material", or has it in the place of some cable's number."""
    if isinstance(value, list | tuple) or (isinstance(value, np.ndarray) and value.dtype.kind in "OU"):
        return any(isinstance(one, str) and one == "material" for one in value)
    return isinstance(value, str) and value == "material"


def with_numbers(given: Mapping[str, Any], cables: int) -> dict[str, Any]:
    """Arguments of a robot with the materials' numbers in the place of "material"; ``from_material`` says which.

    ``breaking_load`` is by default that of the material from which the cable's stiffness came, and infinite otherwise.

    Raises:
        InvalidInput: "material" without a material, or one whose number is not known.
        UnknownName: no such material or field.
    """
    origins: dict[str, Origin] = {}
    for field, names in (given["from_material"] or {}).items():
        one_of("field of a material", field, OF_MATERIAL)
        each = (names,) * cables if isinstance(names, str) else tuple(listed("from_material", names, "names"))
        if len(each) != cables:
            raise InvalidInput(f"from_material: found {len(each)} names of {field}, expected one for each cable")
        for name in filter(None, each):
            checked_label("from_material", name)
        if any(each):
            origins[field] = names if isinstance(names, str) else each
    found = dict(given)
    for field in OF_MATERIAL:
        value: Any = given[field]
        stiff = origins.get("axial_stiffness")
        if field == "breaking_load" and value is None and stiff is None:
            value = np.inf
        elif field == "breaking_load" and value is None:
            each = ["material" if name else np.inf for name in each_of(stiff, cables)]
            value = each[0] if len(set(each)) == 1 else each
        if value is None or not is_of_material(value):
            found[field] = value
            continue
        if isinstance(value, str):
            wanted = [name or given["material"] for name in each_of(stiff, cables)]
            numbers = [_number(field, name) for name in dict.fromkeys(wanted)]
            if len(numbers) == 1:
                found[field], origins[field] = numbers[0], _material_of(field, wanted[0]).name
                continue
            value = ["material"] * cables
        if len(value) != cables:
            raise InvalidInput(f"{field}: found {len(value)} entries, expected one for each of {cables} cables")
        own = [isinstance(one, str) and one == "material" for one in value]
        names = each_of(stiff, cables)
        wanted = [(names[i] or given["material"]) if own[i] else None for i in range(cables)]
        found[field] = [_number(field, wanted[i]) if own[i] else value[i] for i in range(cables)]
        origins[field] = tuple(_material_of(field, one).name if own[i] else None for i, one in enumerate(wanted))
    found["from_material"] = origins
    return found


def each_of(origin: Origin | None, cables: int) -> tuple[str | None, ...]:
    """The material's name of each cable; None for a number given by hand."""
    return (origin,) * cables if origin is None or isinstance(origin, str) else origin


def _material_of(field: str, name: str | None) -> Material:
    if name is None:
        raise InvalidInput(f"{field}: found 'material' without a material, expected the name of one as well")
    return load_material(name)


def _number(field: str, name: str | None) -> float:
    made = _material_of(field, name)
    number = getattr(made, field)
    if number is None and field == "linear_density":
        raise InvalidInput(
            f"linear_density: found 'material', expected a number [kg/m]: the mass of {made.name} is not known"
        )
    return np.inf if number is None else number

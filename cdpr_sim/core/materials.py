"""The cables that robots are built with, by name."""

from __future__ import annotations

import math
from dataclasses import dataclass

from cdpr_sim.core.errors import UnknownName


@dataclass(frozen=True)
class Material:
    """A cable: its name, its axial stiffness EA [N], and where that number comes from."""

    name: str
    axial_stiffness: float
    source: str


_ASSUMED = (
    "assumed: the paper gives no EA, only that the fishing line is about 10 times softer; right order of magnitude"
)

NYLON_MODULUS = 1.5e9
"""[Pa] Of nylon 66 that has taken up moisture from air: 7.5 MPa at 0.5 % (Toray, "AMILAN nylon resin: mechanical
properties", tensile characteristics). The tensions here stretch a 0.4 mm line by up to 1 %."""

NYLON_FIBRES = (0.6 * 1.14e9, 3.0 * 1.14e9)
"""[Pa] How far drawn nylon lies around that: initial moduli at 65 % humidity of 0.6 N/tex for nylon 6 and 3.0 N/tex for
nylon 6.6 of medium tenacity (Morton and Hearle, "Physical Properties of Textile Fibres", Table 13.2), times the density
of nylon, 1.14 g/cm³."""


def line_stiffness(modulus: float, diameter: float) -> float:
    """EA [N] of a round line: its modulus [Pa] times its section, from its diameter [m]."""
    return modulus * math.pi * diameter**2 / 4


_NYLON = (
    "1.5 GPa, nylon 66 in moist air (Toray, AMILAN technical data), times a 0.4 mm line's section; not in the paper; "
    "drawn nylon differs: 0.7 to 3.4 GPa (Morton and Hearle, Physical Properties of Textile Fibres)"
)

MATERIALS = {
    material.name: material
    for material in (
        Material("vectran-0.7mm", 10e3, _ASSUMED),
        Material("fishing-0.4mm", 1e3, _ASSUMED),
        Material("nylon-0.4mm", round(line_stiffness(NYLON_MODULUS, 0.4e-3)), _NYLON),
    )
}


PAPER_MATERIALS = ("vectran-0.7mm", "fishing-0.4mm")
"""What DemoBot was strung with (section IV)."""


def load_material(name: str) -> Material:
    """The material called ``name``.

    Raises:
        UnknownName: no such material.
    """
    try:
        return MATERIALS[name]
    except KeyError:
        raise UnknownName("material", name, MATERIALS) from None

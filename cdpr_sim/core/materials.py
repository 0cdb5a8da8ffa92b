"""The cables that robots are built with, by name."""

from __future__ import annotations

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

MATERIALS = {
    material.name: material
    for material in (
        Material("vectran-0.7mm", 10e3, _ASSUMED),
        Material("fishing-0.4mm", 1e3, _ASSUMED),
    )
}


def load_material(name: str) -> Material:
    """The material called ``name``.

    Raises:
        UnknownName: no such material.
    """
    try:
        return MATERIALS[name]
    except KeyError:
        raise UnknownName("material", name, MATERIALS) from None

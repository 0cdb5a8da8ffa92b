"""Numbers as MJCF text that MuJoCo parses back to exactly the same doubles, identical on every machine.

Sums of written numbers are in a fixed order. BLAS, which ``np.linalg``, ``@`` and ``einsum`` call, sums in an order
that depends on the processor, so that the last digit differs between processors.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Any

import numpy as np
from jaxtyping import Float

NONE: Mapping[str, Any] = MappingProxyType({})
"""No attributes."""

LEAST_INERTIA = 1e-14
"""[kg m²] Inertia of a point mass or a small wheel: ten times the least that MuJoCo accepts, and negligible in any
motion."""


def text(values: float | Sequence[float] | np.ndarray) -> str:
    """``repr`` of each double, whole numbers without ``.0``, zero without a sign."""
    numbers = np.asarray(values, dtype=float).ravel().tolist()
    return " ".join(repr(number + 0.0).removesuffix(".0") for number in numbers)


def add(parent: ET.Element, tag: str, attributes: Mapping[str, Any] = NONE, /, **further: Any) -> ET.Element:
    """``ET.SubElement`` with numbers as ``text``, and without the attributes that are None."""
    every = {**attributes, **further}.items()
    written = {name: v if isinstance(v, str) else text(v) for name, v in every if v is not None}
    return ET.SubElement(parent, tag, written)


def add_inertia(body: ET.Element, mass: float, inertia: float) -> None:
    """Mass of a ``body`` at its origin [kg], and its moment of inertia about any axis [kg m²]."""
    add(body, "inertial", pos="0 0 0", mass=mass, diaginertia=[inertia] * 3)


def magnitude(vector: Float[np.ndarray, " n"]) -> float:
    """Euclidean length of a vector, without BLAS."""
    return float(np.sqrt((vector * vector).sum()))

"""Numbers as MJCF text that MuJoCo parses back to exactly the same doubles, identical on every machine.

Sums of written numbers are in a fixed order. BLAS, which ``np.linalg``, ``@`` and ``einsum`` call, sums in an order
that depends on the processor, so that the last digit differs between processors.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

LEAST_INERTIA = 1e-14
"""[kg m²] Inertia of a point mass or a small wheel: ten times the least that MuJoCo accepts, and negligible in any
motion."""


def text(values: float | Sequence[float] | np.ndarray) -> str:
    """``repr`` of each double, whole numbers without ``.0``, zero without a sign."""
    return " ".join(repr(float(value) + 0.0).removesuffix(".0") for value in np.atleast_1d(values))


def magnitude(vector: Float[np.ndarray, " n"]) -> float:
    """Euclidean length of a vector, without BLAS."""
    return float(np.sqrt((vector * vector).sum()))

"""Numbers as MJCF text that MuJoCo parses back to the very same doubles, and that every machine writes alike.

What is written is summed in a fixed order. BLAS, which ``np.linalg``, ``@`` and ``einsum`` call, sums in the order that
its kernel for the processor has, so that the last digit differs from one processor to the next.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

LEAST_INERTIA = 1e-14
"""[kg m²] Of a point mass or a tiny wheel: ten times the least that MuJoCo takes, and felt by nothing that moves."""


def text(values: float | Sequence[float] | np.ndarray) -> str:
    """``repr`` of each double, whole numbers without ``.0``, zero without a sign."""
    return " ".join(repr(float(value) + 0.0).removesuffix(".0") for value in np.atleast_1d(values))


def magnitude(vector: Float[np.ndarray, " n"]) -> float:
    """Euclidean length of a vector, without BLAS."""
    return float(np.sqrt((vector * vector).sum()))

"""Numbers as MJCF text that MuJoCo parses back to the very same doubles."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

LEAST_INERTIA = 1e-14
"""[kg m²] Of a point mass or a tiny wheel: ten times the least that MuJoCo takes, and felt by nothing that moves."""


def text(values: float | Sequence[float] | np.ndarray) -> str:
    """``repr`` of each double, whole numbers without ``.0``, zero without a sign."""
    return " ".join(repr(float(value) + 0.0).removesuffix(".0") for value in np.atleast_1d(values))

"""A function about cables with mass that data needs and statics computes; the package's ``__init__`` sets it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, ClassVar


class WithMass:
    """The function of ``statics.given_tensions``, which this folder must not import."""

    cut: ClassVar[Callable[..., tuple[Any, Any]]]

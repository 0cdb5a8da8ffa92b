"""What data asks about cables with mass and statics computes; the package's ``__init__`` sets the function."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, ClassVar


class WithMass:
    """The answer of ``statics.given_tensions``, which this folder must not import."""

    cut: ClassVar[Callable[..., tuple[Any, Any]]]

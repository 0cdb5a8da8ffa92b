"""Display of results in notebooks as HTML; ``repr`` in one line is a method of each class."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, ClassVar


class HtmlRepr:
    """Base of classes with a display in notebooks; ``report.notebook`` sets the function that writes it."""

    _in_html: ClassVar[Callable[[Any], str]]

    def _repr_html_(self) -> str:
        return type(self)._in_html(self)

"""How results introduce themselves: ``repr`` in a line, by each class itself, and in a notebook as HTML."""

from __future__ import annotations

from collections.abc import Callable
from typing import ClassVar


class HtmlRepr:
    """What a notebook shows as tables and pictures: by words of a room above, which the package hands down."""

    _in_html: ClassVar[Callable[[object], str]]

    def _repr_html_(self) -> str:
        return type(self)._in_html(self)

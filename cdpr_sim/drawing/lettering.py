"""Names in any script: an installed font for letters that DejaVu Sans lacks, and boxes for those that no font has."""

from __future__ import annotations

import functools
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple, ParamSpec

if TYPE_CHECKING:
    from matplotlib.figure import Figure

P = ParamSpec("P")

BOX = "□"
"""Instead of letters that no font has."""

PICTURES = "emoji", "last resort", "lastresort"
"""In names of fonts whose glyphs are pictures, or boxes for any letter."""


class Font(NamedTuple):
    """An installed font: its name, weight and file."""

    name: str
    weight: int | str
    file: Path


def legible(text: str) -> tuple[str, Font | None]:
    """``text`` with boxes for letters that no font has; and a font of those that DejaVu Sans lacks, or None."""
    lacking = frozenset(letter for letter in text if not letter.isspace() and ord(letter) not in _plain_letters())
    if not lacking:
        return text, None
    font, letters = richest(lacking)
    return "".join(BOX if letter in lacking - letters else letter for letter in text), font


def in_legible_letters(draw: Callable[P, Figure]) -> Callable[P, Figure]:
    """Decorator: all texts of the figure are ``legible``."""

    @functools.wraps(draw)
    def drawn(*args: P.args, **kwargs: P.kwargs) -> Figure:
        from matplotlib.text import Text

        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", "Glyph")  # while texts are measured
            figure = draw(*args, **kwargs)
        for one in figure.findobj(Text):
            assert isinstance(one, Text)
            text, font = legible(one.get_text())
            if text != one.get_text():
                one.set_text(text)
            if font is not None:
                one.set_fontfamily(["DejaVu Sans", font.name])
                one.set_fontweight(font.weight)
        return figure

    return drawn


@functools.lru_cache(maxsize=1)
def _plain_letters() -> frozenset[int]:
    """Those of DejaVu Sans, which matplotlib includes."""
    import matplotlib

    return _letters(str(Path(matplotlib.get_data_path(), "fonts", "ttf", "DejaVuSans.ttf")))


@functools.lru_cache(maxsize=64)
def richest(letters: frozenset[str]) -> tuple[Font | None, frozenset[str]]:
    """The installed font that has most of ``letters``, and those that it has."""
    from matplotlib.font_manager import fontManager

    best: tuple[Font | None, frozenset[str]] = None, frozenset()
    for entry in sorted(fontManager.ttflist, key=lambda one: (one.name, one.style != "normal", one.fname)):
        if not any(word in entry.name.lower() for word in PICTURES):
            known = _letters(entry.fname)
            had = frozenset(letter for letter in letters if ord(letter) in known)
            if len(had) > len(best[1]):
                best = Font(entry.name, entry.weight, Path(entry.fname)), had
    return best


@functools.cache
def _letters(file: str) -> frozenset[int]:
    from matplotlib.ft2font import FT2Font

    try:
        return frozenset(FT2Font(file).get_charmap())
    except (OSError, RuntimeError):  # not a font that matplotlib can use
        return frozenset()

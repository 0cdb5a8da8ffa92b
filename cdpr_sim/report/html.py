"""Tables, sentences and pictures as HTML, for notebooks and the report page: all text escaped, no external address."""

from __future__ import annotations

import base64
from html import escape
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

from rich.markup import escape as plain
from rich.table import Table
from rich.text import Text

STYLE = "\n" + Path(__file__).with_name("fragment.css").read_text(encoding="utf-8")
"""Colours follow the surrounding text, on dark and light backgrounds; only pictures have a white background."""

__all__ = ["EmbeddedImage", "Part", "data", "fragment", "plain", "sentences", "table"]

LONG = 40
"""Number of characters above which a cell may be wrapped."""


class EmbeddedImage(NamedTuple):
    """A PNG file's content, with its alternative text."""

    png: bytes
    description: str


Part = Table | EmbeddedImage | str
"""A string is lines in rich's markup."""


def fragment(*parts: Part) -> str:
    """Parts with their style: the notebook display of an object."""
    return f'<div class="cdpr-sim"><style>{STYLE}</style>{"".join(map(_part, parts))}</div>'


def _part(part: Part) -> str:
    if isinstance(part, EmbeddedImage):
        return f'<img alt="{escape(part.description)}" src="{data(part.png, "image/png")}">'
    return table(part) if isinstance(part, Table) else sentences(part)


def table(sheet: Table) -> str:
    """A table with the same cells as on the command line."""
    text_columns = getattr(sheet, "text_columns", 1)
    columns = [list(column.cells) for column in sheet.columns]
    headings = [str(column.header) for column in sheet.columns]
    parts = [f"<caption>{_lines(str(sheet.title))}</caption>" if sheet.title else ""]
    if any(headings):
        cells = (
            f'<th scope="col"{_kind(place < text_columns)}>{_lines(heading)}</th>'
            for place, heading in enumerate(headings)
        )
        parts.append(f"<thead><tr>{''.join(cells)}</tr></thead>")
    parts.append("<tbody>")
    for number, row in enumerate(sheet.rows):
        cells = []
        for place, (column, described) in enumerate(zip(columns, sheet.columns, strict=True)):
            cell = str(column[number])
            flush = place < text_columns or described.justify == "left"
            kind = _kind(flush, long=len(cell) > LONG, look=str(described.style))
            cells.append(
                f'<th scope="row"{kind}>{_inline(cell)}</th>' if place == 0 else f"<td{kind}>{_inline(cell)}</td>"
            )
        look = f' class="{escape(str(row.style))}"' if row.style else ""
        parts.append(f"<tr{look}>{''.join(cells)}</tr>")
        if row.end_section and number + 1 < len(sheet.rows):
            parts.append("</tbody><tbody>")
    return f"<table>{''.join(parts)}</tbody></table>"


def sentences(*markup: str) -> str:
    """Lines of the command line's output, a paragraph each."""
    lines = (line.strip() for text in markup for line in text.splitlines())
    return "".join(f"<p>{_inline(line)}</p>" for line in lines if line)


def data(content: bytes, kind: str) -> str:
    """Bytes as a data URL."""
    return f"data:{kind};base64,{base64.b64encode(content).decode()}"


def _kind(flush_left: bool, *, long: bool = False, look: str = "") -> str:
    names = " ".join(filter(None, ["text" if flush_left else "", "long" if long else "", escape(look)]))
    return f' class="{names}"' if names else ""


def _lines(markup: str) -> str:
    """A heading of several lines."""
    return "<br>".join(_inline(line) for line in markup.split("\n"))


def _inline(markup: str) -> str:
    """Convert rich's markup to HTML."""
    text = Text.from_markup(markup)
    edges = sorted({0, len(text), *(edge for span in text.spans for edge in (span.start, span.end))})
    parts = []
    for start, end in pairwise(edges):
        looks = " ".join(str(span.style) for span in text.spans if span.start <= start and end <= span.end)
        content = escape(text.plain[start:end])
        parts.append(f'<span class="{escape(looks)}">{content}</span>' if looks else content)
    return "".join(parts)

"""What all tables have in common."""

from __future__ import annotations

from rich import box
from rich.markup import escape
from rich.table import Table


def new_table(title: str, *columns: str, words: int = 1, dense: bool = False) -> Table:
    """A table without rows yet: its first ``words`` columns flush left, for words, the others flush right.

    Args:
        title: may have several lines.
        columns: their headings.
        words: how many of them hold words.
        dense: one blank between two columns, rather than two.
    """
    padding = (0, 1, 0, 0) if dense else (0, 1)
    table = Table(title=escape(title), title_justify="left", box=box.SIMPLE_HEAD, padding=padding, pad_edge=False)
    for number, name in enumerate(columns):
        table.add_column(escape(name), justify="left" if number < words else "right", no_wrap=True)
    return table

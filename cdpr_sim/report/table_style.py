"""Style of all tables."""

from __future__ import annotations

from collections.abc import Iterator

from rich import box
from rich.console import Console, ConsoleOptions, RenderResult
from rich.markup import escape
from rich.segment import Segment
from rich.table import Table
from rich.text import Text

WIDE = 10_000
"""Terminal width at which nothing is truncated."""

CUT = "…"
"""Character with which rich marks truncated text."""


class Sheet(Table):
    """A table that never truncates a number: where it is too wide, its records are printed one below the other.

    A record is a row, headed by its first ``text_columns`` cells; or a column, where ``methods`` are compared.
    """

    text_columns = 1
    methods = False

    def row(self, label: str, *cells: str, style: str | None = None) -> None:
        """Add a row with a label, which is no markup."""
        self.add_row(escape(label), *cells, style=style)

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        """Render the table or its records."""
        drawn = self._drawn(console, options)
        if _cuts(drawn) > _cuts(self._drawn(console, options.update(width=WIDE, max_width=WIDE))):
            if self.title:
                yield Text.from_markup(str(self.title))
            for record in self._columns_below() if self.methods else self._rows_below():
                yield Text("")
                yield record
            yield Text("")
        else:
            yield from drawn

    def _drawn(self, console: Console, options: ConsoleOptions) -> list[Segment]:
        return list(super().__rich_console__(console, options))  # type: ignore[arg-type]

    def _columns_below(self) -> Iterator[Text]:
        labels, *columns = self.columns
        for column in columns:
            pairs = zip(labels.cells, column.cells, strict=True)
            yield _record(_line(column.header), [(_line(label), _line(cell)) for label, cell in pairs])

    def _rows_below(self) -> Iterator[Text]:
        heads = [_line(column.header) for column in self.columns]
        for row in zip(*(column.cells for column in self.columns), strict=True):
            cells = [_line(cell) for cell in row]
            name = Text(", ").join(cell for cell in cells[: self.text_columns] if cell.plain)
            yield _record(name, list(zip(heads[self.text_columns :], cells[self.text_columns :], strict=True)))


def new_table(title: str, *columns: str, text_columns: int = 1, dense: bool = False, methods: bool = False) -> Sheet:
    """A table without rows: its first ``text_columns`` columns are left-aligned, the others right-aligned.

    Args:
        title: may have several lines.
        columns: headings.
        text_columns: number of columns that hold text.
        dense: whether columns are separated by one space instead of two.
        methods: whether the columns are methods to be compared.
    """
    padding = (0, 1, 0, 0) if dense else (0, 1)
    table = Sheet(title=escape(title), title_justify="left", box=box.SIMPLE_HEAD, padding=padding, pad_edge=False)
    table.text_columns, table.methods = text_columns, methods
    for number, name in enumerate(columns):
        table.add_column(escape(name), justify="left" if number < text_columns else "right", no_wrap=True)
    return table


def _cuts(drawn: list[Segment]) -> int:
    return sum(segment.text.count(CUT) for segment in drawn)


def _line(cell: object) -> Text:
    """A cell or a heading on one line, without hyphenation."""
    return Text.from_markup(str(cell).replace("-\n", "").replace("\n", " "))


def _record(name: Text, pairs: list[tuple[Text, Text]]) -> Text:
    """The record's name, and a line for each value."""
    pairs = [(label, value) for label, value in pairs if value.plain]
    wide = max((label.cell_len for label, _ in pairs), default=0)
    lines = [Text("  ").join([label, Text(" " * (wide - label.cell_len)) + value]) for label, value in pairs]
    name.stylize("bold")
    return Text("\n").join([name] * bool(name.plain) + lines)

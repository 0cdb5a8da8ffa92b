"""HTML as tests read it: tags that have to be closed, tables cell by cell, words."""

from html.parser import HTMLParser

VOID = {"img", "meta", "link", "input", "br"}
UNREAD = {"style", "script"}


class Page(HTMLParser):
    """What HTML says.

    Attributes:
        tags: (name, attributes) in order.
        tables: by caption or by the label of what is around it, a dictionary of rows by their first cell.
        words: all that is to be read.
    """

    def __init__(self, text: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.tags: list[tuple[str, dict[str, str]]] = []
        self.tables: list[dict[str, list[str]]] = []
        self.words = ""
        self._row: list[str] = []
        self.feed(text)
        assert not self.open

    @property
    def rows(self) -> dict[str, list[str]]:
        """Of all tables; of rows that are called the same, the first."""
        return {name: row for table in reversed(self.tables) for name, row in table.items()}

    def handle_starttag(self, tag: str, attrs: list) -> None:
        self.tags.append((tag, {name: value or "" for name, value in attrs}))
        if tag not in VOID:
            self.open.append(tag)
        if tag == "table":
            self.tables.append({})
        elif tag == "tr":
            self._row = []
        elif tag in ("td", "th"):
            self._row.append("")
        elif tag == "br" and self._row:
            self._row[-1] += " "

    def handle_startendtag(self, tag: str, attrs: list) -> None:
        self.tags.append((tag, {name: value or "" for name, value in attrs}))

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag
        if tag == "tr":
            self.tables[-1].setdefault(self._row[0], self._row[1:])

    def handle_data(self, data: str) -> None:
        if not UNREAD & set(self.open):
            self.words += data
        if {"td", "th"} & set(self.open):
            self._row[-1] += data

"""What users give: a command, a robot file, a changed file of another project."""

import re
from pathlib import Path

from typer.testing import CliRunner

from cdpr_sim.cli import app

FILES = Path(__file__).parent / "imported"

Changes = dict[str | re.Pattern, str]

ROBOT_FILE = """
name = "mine"
#robot
[platform]
mass = 1.5
size = [0.2, 0.1, 0.1]
#platform
[[cables]]
exit = [0, 0, 1]
anchor = [0, 0, 0.05]
#cable
[[cables]]
exit = [1, 0, 1]
anchor = [0.1, 0, 0.05]
"""
"""With places for more of the robot, of its platform and of its first cable."""


def run(*words: object, columns: int = 100):
    """A command in this process, on a terminal of so many columns."""
    return CliRunner().invoke(app, [str(word) for word in words], env={"COLUMNS": str(columns)})


def row(text: str, label: str) -> list[str]:
    """The words of the line that begins with ``label``."""
    return next(line for line in text.splitlines() if line.strip().startswith(label)).split()


def said(text: str) -> str:
    """Without the line breaks of a terminal."""
    return " ".join(text.split())


def robot_file(folder: Path, changes: Changes) -> Path:
    """A file of two cables, by default of 2 kN."""
    text = ROBOT_FILE
    for old, new in ({"#robot": "axial_stiffness = 2000.0"} | changes).items():
        assert old in text, old
        text = text.replace(old, new, 1)
    (folder / "mine.toml").write_text(text, encoding="utf-8")
    return folder / "mine.toml"


def changed(folder: Path, name: str, changes: Changes) -> Path:
    """A copy of a file of ``imported/``, and of CASPR's cables beside it, with something else in them.

    Of a text, its first occurrence is changed, of a pattern all of them.
    """
    parts = {part: (FILES / part).read_text(encoding="utf-8") for part in {name, name.replace("_bodies", "_cables")}}
    for old, new in changes.items():
        pattern, count = (re.compile(re.escape(old)), 1) if isinstance(old, str) else (old, 0)
        assert any(map(pattern.search, parts.values())), old
        parts = {part: pattern.sub(new, text, count) for part, text in parts.items()}
    for part, text in parts.items():
        (folder / part).write_text(text, encoding="utf-8")
    return folder / name

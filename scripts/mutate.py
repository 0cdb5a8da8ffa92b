"""Put faults in, one at a time, and see whether a test notices: the table that this prints says what is guarded.

    python scripts/mutate.py [ROOM ...]

The faults and the tests that should notice are in mutations.toml. Takes minutes for each room: not part of the tests.
Exit status 1 if one survives that is not explained.
"""

import os
import shutil
import subprocess
import sys
import tempfile
import tomllib
from collections import Counter
from pathlib import Path

from rich.console import Console
from rich.progress import track
from rich.table import Table

ROOT = Path(__file__).parents[1]
ROOMS = tomllib.loads(Path(__file__).with_name("mutations.toml").read_text(encoding="utf-8"))


def passes(tree: Path, tests: list[str]) -> bool:
    """Whether these tests pass in a copy of the repository."""
    words = [sys.executable, "-m", "pytest", "-q", "-x", "-p", "no:cacheprovider", *tests]
    environment = os.environ | {"PYTHONPATH": str(tree), "PYTHONDONTWRITEBYTECODE": "1"}
    ended = subprocess.run(words, cwd=tree, env=environment, capture_output=True, text=True)
    if ended.returncode not in (0, 1):
        raise RuntimeError(f"pytest ended with {ended.returncode}:\n{ended.stdout[-2000:]}{ended.stderr[-2000:]}")
    return ended.returncode == 0


def survives(tree: Path, file: str, right: str, wrong: str, tests: list[str]) -> bool:
    """Whether the tests pass with ``right`` replaced by ``wrong``, which is put right again."""
    path = tree / "cdpr_sim" / file
    text = path.read_text(encoding="utf-8")
    if text.count(right) != 1:
        raise RuntimeError(f"{file}: found {text.count(right)} times, expected once: {right}")
    path.write_text(text.replace(right, wrong), encoding="utf-8")
    try:
        return passes(tree, tests)
    finally:
        path.write_text(text, encoding="utf-8")


def main(wanted: list[str]) -> int:
    counts: dict[str, Counter] = {}
    with tempfile.TemporaryDirectory() as folder:
        tree = Path(folder) / "tree"
        listed = subprocess.run(["git", "ls-files"], cwd=ROOT, capture_output=True, text=True, check=True)
        for name in listed.stdout.splitlines():
            (tree / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(ROOT / name, tree / name)
        for room in wanted or ROOMS:
            tests, counts[room] = ROOMS[room]["tests"], Counter()
            if not passes(tree, tests):
                raise RuntimeError(f"{room}: its tests fail without any fault")
            for file, right, wrong, *reason in track(ROOMS[room]["faults"], room, console=Console(stderr=True)):
                alive = survives(tree, file, right, wrong, tests)
                outcome = ("explained" if reason else "survived") if alive else "killed"
                counts[room][outcome] += 1
                if alive and not reason:
                    print(f"survived: {room}: {file}: {right!r} -> {wrong!r}", flush=True)
    table = Table("room", "faults", "killed", "survived", "explained")
    for room, count in counts.items():
        cells = (count.total(), count["killed"], count["survived"], count["explained"])
        table.add_row(room, *map(str, cells))
    Console().print(table)
    return int(any(count["survived"] for count in counts.values()))


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))

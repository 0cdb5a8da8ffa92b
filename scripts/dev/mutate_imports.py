"""Import damaged files: each importer has to return a robot or a one-sentence error, never another exception.

A file of each format is truncated, or has bytes that are flipped, removed, doubled, or replaced by text that is
difficult to parse: other encodings, entities, aliases, huge numbers, deep brackets. Exit status 1 if an importer does
anything but return a robot or raise an InvalidInput of one line.
"""

import argparse
import sys
import tempfile
import time
import warnings
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table

import cdpr_sim as cdpr

MUTATIONS = 2000  # per file
FILES = Path(__file__).parents[2] / "tests" / "imported"
LONGEST = 1000  # characters of a sentence
SLOWEST = 10.0  # [s] of processor time, per file
ENTITIES = b'<?xml version="1.0"?><!DOCTYPE a [<!ENTITY b "bb"><!ENTITY c "&b;&b;&b;&b;"><!ENTITY d "&c;&c;&c;&c;">]>'
BOMB = ENTITIES + b"<models><robot>&d;</robot></models>"
OUTSIDE = b'<!DOCTYPE a [<!ENTITY b SYSTEM "file:///etc/hostname">]><models><robot name="&b;"/></models>'
ALIASES = b"a: &a [1, 1]\nb: &b [*a, *a, *a]\nc: &c [*b, *b, *b]\npoints: [*c, *c, *c]\nplatform: {mass: *c}\n"
MERGES = b"a: &a {x: 1}\nb: &b {<<: [*a, *a, *a]}\npoints: {<<: [*b, *b, *b]}\n"
CYCLE = b"points: &p [*p]\nplatform: *p\nkinematic_chains: *p\nactuator: *p\n"
SNIPPETS = (
    *(
        b"",
        b"\0",
        b"\xff",
        b"\xef\xbb\xbf",
        b"&b;",
        b"<",
        b">",
        b"]",
        b"}",
        b"[",
        b"{",
        b'"',
        b",",
        b"- ",
        b"*a",
        b"!!",
    ),
    *(b"nan", b"-inf", b"1e999", b"-1", b"0", b"true", b"null", b"9" * 5000, b"[" * 5000, b"<a>" * 5000),
    *(b"!!python/object/apply:os.getcwd []", b"!!timestamp x", b"!!bool x", b"!!float x", b"2001-99-99", b"<<: *a"),
)


def mutated(content: bytes, random: np.random.Generator) -> bytes:
    """Return the file, damaged in one of many ways."""
    kind = random.integers(9)
    at = int(random.integers(len(content) + 1))
    if kind == 0:
        return content[:at]
    if kind == 1:
        damaged = bytearray(content)
        for place in random.integers(len(damaged), size=random.integers(1, 8)):
            damaged[place] ^= 1 << int(random.integers(8))
        return bytes(damaged)
    if kind == 2:
        return content[:at] + content[at + int(random.integers(1, 40)) :]
    if kind == 3:
        return content[:at] + content[at : at + int(random.integers(1, 400))] * 2 + content[at:]
    if kind == 4:
        return content.decode("latin-1").encode(str(random.choice(["utf-16", "utf-32", "utf-16-be", "utf-7", "cp500"])))
    if kind == 5:
        return (BOMB, OUTSIDE, ALIASES, MERGES, CYCLE)[random.integers(5)]
    if kind == 6:
        other = str(random.choice(["utf-16", "ebcdic", "klingon", "utf-7"]))
        return content.replace(b'encoding="utf-8"', f'encoding="{other}"'.encode()) + bytes([random.integers(256)])
    words = content.split(b" ")
    which = int(random.integers(len(words)))
    snippet = SNIPPETS[random.integers(len(SNIPPETS))]
    words[which] = snippet if kind == 7 else words[which] + snippet
    return b" ".join(words)


def answers(file: Path, mutations: int, seed: int, folder: Path) -> Iterator[tuple[str, str]]:
    """The importer's result for each mutation of the file; of CASPR's two files, one is damaged."""
    random = np.random.default_rng(seed)
    parts = [file, *([file.with_name(file.name.replace("_bodies", "_cables"))] if "_bodies" in file.name else [])]
    for _ in range(mutations):
        hit = parts[random.integers(len(parts))]
        for part in parts:
            content = part.read_bytes()
            (folder / part.name).write_bytes(mutated(content, random) if part == hit else content)
        yield answer(folder / file.name)


def answer(file: Path) -> tuple[str, str]:
    """What the importer makes of a file: "robot", "sentence", or what is wrong; and its text."""
    start = time.thread_time()
    try:
        text = repr(cdpr.import_robot(file))
        kind = "robot"
    except cdpr.InvalidInput as error:
        text = str(error)
        kind = "sentence" if text.isprintable() and len(text) < LONGEST else "no sentence"
    except Exception as error:  # the kind of error that this script looks for
        text, kind = f"{error!r:.300}", "another exception"
    return ("too slow" if time.thread_time() - start > SLOWEST else kind), text


def main() -> None:
    parser = argparse.ArgumentParser(description="Import damaged files with every importer.")
    parser.add_argument("--mutations", type=int, default=MUTATIONS, help="per file")
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    warnings.simplefilter("ignore", cdpr.ImplausibleRobot)
    table = Table("file", "robot", "sentence", "wrong", title=f"{options.mutations} mutations of each file")
    wrong = []
    for file in sorted(FILES.glob("*")):
        if "_cables" in file.name:
            continue
        with tempfile.TemporaryDirectory() as folder:
            found = list(answers(file, options.mutations, options.seed, Path(folder)))
        counts = Counter(kind for kind, _ in found)
        bad = [one for one in found if one[0] not in ("robot", "sentence")]
        wrong += bad
        table.add_row(file.name, str(counts["robot"]), str(counts["sentence"]), str(len(bad)))
    Console().print(table)
    for kind, text in wrong[:20]:
        print(f"{kind}: {text}")
    sys.exit(1 if wrong else 0)


if __name__ == "__main__":
    main()

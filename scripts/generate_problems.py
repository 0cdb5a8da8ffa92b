"""Prove the solutions of the problem set again, or draw another set.

``python scripts/generate_problems.py`` proves the solutions of ``problems/`` from what its files state, writes them,
and names the problems whose solutions differ from those before in a digit that both had proved. Exit status 1 if there
are any.

``python scripts/generate_problems.py --draw FOLDER [PER_LEVEL]`` draws problems from the present catalogue.
"""

import json
import sys
from decimal import Decimal
from pathlib import Path

from cdpr_sim.studies.problem_set import FORMAT, LEVELS, read_problems
from studies.problem_drawing import EACH, draw_problems, solutions

FOLDER = Path(__file__).parents[1] / "problems"


def write(folder: Path, level: str, problems: list[dict]) -> None:
    """One file, with a problem per line."""
    head = f'{{"format": {FORMAT}, "level": "{level}", "problems": [\n'
    text = head + ",\n".join(map(json.dumps, problems)) + "\n]}\n"
    (folder / f"{level}.json").write_text(text, encoding="utf-8")


def decimals(value: object) -> list[Decimal]:
    """All decimals of a solution."""
    if isinstance(value, dict):
        return [one for name in ("position", "rotation_matrix", "tensions") for one in decimals(value[name])]
    if isinstance(value, list):
        return [one for entry in value for one in decimals(entry)]
    return [Decimal(str(value))]


def same(one: dict, other: dict) -> bool:
    """Whether two solutions agree: every decimal to two units in the last place of the shorter."""
    known = ("slack", "unstable_directions")
    if one["complete"] != other["complete"] or len(one["equilibria"]) != len(other["equilibria"]):
        return False
    for a, b in zip(one["equilibria"], other["equilibria"], strict=True):
        if any(a[name] != b[name] for name in known):
            return False
        for x, y in zip(decimals(a), decimals(b), strict=True):
            last = max(int(x.as_tuple().exponent), int(y.as_tuple().exponent))
            if abs(x - y) > 2 * Decimal(10) ** last:
                return False
    return True


if "--draw" in sys.argv:
    folder, *more = sys.argv[sys.argv.index("--draw") + 1 :]
    Path(folder).mkdir(exist_ok=True)
    for level in LEVELS:
        drawn = []
        for one in draw_problems(level, int(more[0]) if more else EACH):
            drawn.append(one)
            print(one["name"], len(one["equilibria"]), "complete" if one["complete"] else "", flush=True)
        write(Path(folder), level, drawn)
else:
    changed = []
    read = {one.name: one for one in read_problems(FOLDER)}
    for level in LEVELS:
        problems = json.loads((FOLDER / f"{level}.json").read_text(encoding="utf-8"))["problems"]
        for one in problems:
            proved = solutions(read[one["name"]])
            if not same(one, proved):
                changed.append(one["name"])
                print(one["name"], "differs", flush=True)
            one |= proved
        write(FOLDER, level, problems)
    print(f"{len(read)} problems proved again, {len(changed)} with other solutions")
    sys.exit(1 if changed else 0)

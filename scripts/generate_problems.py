"""Generate the problem set and prove its solutions: ``python scripts/generate_problems.py [FOLDER] [PER_LEVEL]``.

Draws are seeded: the files are the same in each run, except for digits beyond the proved ones.
"""

import json
import sys
from pathlib import Path

from cdpr_sim.studies.problem_set import EACH, FORMAT, LEVELS, draw_problems

folder = Path(sys.argv[1] if len(sys.argv) > 1 else "problems")
each = int(sys.argv[2]) if len(sys.argv) > 2 else EACH
folder.mkdir(exist_ok=True)
for level in LEVELS:
    lines = []
    for one in draw_problems(level, each):
        lines.append(json.dumps(one))
        print(one["name"], len(one["equilibria"]), "complete" if one["complete"] else "", flush=True)
    head = f'{{"format": {FORMAT}, "level": "{level}", "problems": [\n'
    (folder / f"{level}.json").write_text(head + ",\n".join(lines) + "\n]}\n", encoding="utf-8")

"""Scores of solvers on the set of problems, as a table and as JSON. Nothing is computed here but counts and medians."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from rich.table import Table

from cdpr_sim.report.table_style import new_table
from cdpr_sim.studies.problem_set import LEVELS
from cdpr_sim.studies.score import Outcome, Score


def score_table(scores: Sequence[Score]) -> Table:
    """A row per solver and level; answers are counted, one per problem and start."""
    table = new_table(
        "Answers beside proved equilibria",
        "solver", "level", "answers\nasked", "correct\ndigits", "solved", "called\nsolved,\nis not", "no\nanswer",
        "unstable", "ms\neach", words=2, dense=True,
    )  # fmt: skip
    for one in scores:
        for level in LEVELS:
            told = summary(one.of(level))
            if told["asked"]:
                table.add_row(
                    one.solver,
                    level,
                    str(told["asked"]),
                    "" if told["digits"] is None else f"{told['digits']:.1f}",
                    str(told["solved"]),
                    f"[red]{told['false']}[/]" if told["false"] else "0",
                    str(told["unanswered"]),
                    str(told["unstable"]),
                    "" if told["milliseconds"] is None else f"{told['milliseconds']:.1f}",
                )
        table.add_section()
    return table


def summary(outcomes: Sequence[Outcome]) -> dict[str, Any]:
    """Counts of answers; median of correct digits over those given, and of milliseconds."""
    given = [one.digits for one in outcomes if one.claimed]
    seconds = [one.seconds for one in outcomes if np.isfinite(one.seconds)]
    return {
        "asked": len(outcomes),
        "digits": float(np.median(given)) if given else None,
        "solved": sum(one.solved for one in outcomes),
        "false": sum(one.claimed and not one.solved for one in outcomes),
        "unanswered": sum(not one.claimed for one in outcomes),
        "unstable": sum(one.solved and not one.stable for one in outcomes),
        "milliseconds": 1e3 * float(np.median(seconds)) if seconds else None,
    }


def scores_json(scores: Sequence[Score]) -> dict[str, Any]:
    """Per solver and level the counts, and every answer's digits."""
    return {
        one.solver: {level: summary(one.of(level)) for level in LEVELS}
        | {"answers": [[a.problem, a.start, a.digits if a.claimed else None] for a in one.outcomes]}
        for one in scores
    }

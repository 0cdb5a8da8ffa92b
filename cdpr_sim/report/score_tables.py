"""Scores of solvers on the problem set, as a table and as JSON. Only counts and medians are computed here."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from rich.table import Table

from cdpr_sim.crosscheck.problem_set import LEVELS
from cdpr_sim.crosscheck.score import Outcome, Score
from cdpr_sim.report.table_style import new_table


def score_table(scores: Sequence[Score]) -> Table:
    """A row per solver and level, with counts of answers: one per problem and start."""
    table = new_table(
        "Answers compared with proved equilibria",
        "solver", "level", "answers\nrequested", "correct\ndigits", "solved", "false\nclaims", "no\nanswer",
        "unstable", "ms per\nanswer", text_columns=2, dense=True,
    )  # fmt: skip
    for one in scores:
        for level in LEVELS:
            counts = summary(one.of(level))
            if counts["requested"]:
                table.add_row(
                    one.solver,
                    level,
                    str(counts["requested"]),
                    "" if counts["digits"] is None else f"{counts['digits']:.1f}",
                    str(counts["solved"]),
                    f"[red]{counts['false_claims']}[/]" if counts["false_claims"] else "0",
                    str(counts["unanswered"]),
                    str(counts["unstable"]),
                    "" if counts["milliseconds"] is None else f"{counts['milliseconds']:.1f}",
                )
        table.add_section()
    return table


def summary(outcomes: Sequence[Outcome]) -> dict[str, Any]:
    """Counts of answers; medians of correct digits over the answers given, and of milliseconds."""
    given = [one.digits for one in outcomes if one.claimed]
    seconds = [one.seconds for one in outcomes if np.isfinite(one.seconds)]
    return {
        "requested": len(outcomes),
        "digits": float(np.median(given)) if given else None,
        "solved": sum(one.solved for one in outcomes),
        "false_claims": sum(one.claimed and not one.solved for one in outcomes),
        "unanswered": sum(not one.claimed for one in outcomes),
        "unstable": sum(one.solved and not one.stable for one in outcomes),
        "milliseconds": 1e3 * float(np.median(seconds)) if seconds else None,
    }


def scores_json(scores: Sequence[Score]) -> dict[str, Any]:
    """Counts per solver and level, and the digits of every answer."""
    return {
        one.solver: {level: summary(one.of(level)) for level in LEVELS}
        | {"answers": [[a.problem, a.start, a.digits if a.claimed else None] for a in one.outcomes]}
        for one in scores
    }

"""The command that scores solvers on the set of problems with proved equilibria."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

import cdpr_sim as cdpr
from cdpr_sim.cli.options import AsJson
from cdpr_sim.cli.terminal import DISAGREE, errors_as_sentences, print_json, print_parts


def score(
    solver: Annotated[
        list[str],
        typer.Argument(
            metavar="SOLVER...",
            help="newton, fsolve, least_squares, mujoco, root, minimize, rigid; your own module:function, called as "
            "function(robot, rest_lengths, start), with external_wrench= if there is one; or a .json file of answers.",
        ),
    ],
    problems: Annotated[
        Path, typer.Option("--problems", metavar="FOLDER", help="Problem set; default: problems/ of the repository.")
    ] = Path("problems"),
    level: Annotated[str | None, typer.Option("--level", help="lower, average or higher; default: all.")] = None,
    first: Annotated[
        int | None, typer.Option("--first", min=1, help="Number of problems per level; default: all.")
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Count a solver's correct digits and its false claims on problems whose equilibria are proved.

    Exit status: 0 if every claimed solution is correct, 1 if one is not, 2 for invalid input.
    """
    from cdpr_sim.report import score_tables
    from cdpr_sim.studies import problem_set
    from cdpr_sim.studies import score as studies

    with errors_as_sentences():
        if level is not None and level not in problem_set.LEVELS:
            raise cdpr.UnknownName("level", level, problem_set.LEVELS)
        every = problem_set.read_problems(problems)
        chosen = [
            one
            for name in problem_set.LEVELS
            if level in (None, name)
            for one in [problem for problem in every if problem.level == name][:first]
        ]
        scores = [
            studies.score_answers(Path(name), chosen)
            if name.endswith(".json")
            else studies.score(name, studies.solver_called(name), chosen, progress=not as_json)
            for name in solver
        ]
    if as_json:
        print_json(score_tables.scores_json(scores))
    else:
        print_parts(score_tables.score_table(scores))
    wrong = any(one.claimed and not one.solved for each in scores for one in each.outcomes)
    raise typer.Exit(DISAGREE if wrong else 0)

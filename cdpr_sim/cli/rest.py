"""Commands that ask where a platform rests: settle, solve."""

from __future__ import annotations

from typing import Annotated

import typer

import cdpr_sim as cdpr
from cdpr_sim.cli.options import AsJson, MaterialName, Pose, Pretension, RobotName, problem_of
from cdpr_sim.cli.terminal import DISAGREE, Output, busy, errors_as_sentences, print_json
from cdpr_sim.report import as_json as json_of
from cdpr_sim.report import crosscheck as report

METHODS = {"Newton": "newton", "SEECR\nfsolve": "fsolve", "SEECR\nleast_sq.": "least_squares"}
"""The static solvers by their headings."""


def settle(
    robot: RobotName,
    pose: Pose = None,
    material: MaterialName = None,
    pretension: Pretension = None,
    as_json: AsJson = False,
) -> None:
    """Settle the platform in MuJoCo, solve it with Newton and SEECR, and say whether MuJoCo and Newton agree.

    Exit status: 0 if they agree, 1 if they do not, 2 for input that cannot be right or a platform that does not rest.
    """
    with errors_as_sentences():
        problem = problem_of(robot, pose, material, pretension)
        with busy("MuJoCo settles the platform"):
            settled = cdpr.settle(problem)
        outcomes: dict[str, report.Outcome] = {"MuJoCo": settled}
        with busy("The static solvers look for equilibrium (the first run on a machine compiles for half a minute)"):
            outcomes |= {name: _outcome(problem, method) for name, method in METHODS.items()}
        newton = outcomes["Newton"]
        if not isinstance(newton, cdpr.Equilibrium):
            raise newton
        agreement = cdpr.compare(newton, settled)
    if as_json:
        by_method = {METHODS.get(name, "mujoco"): outcome for name, outcome in outcomes.items()}
        print_json(json_of.crosscheck(problem, by_method, agreement))
    else:
        console = Output()
        console.print(report.settle_table(problem, outcomes))
        for outcome in outcomes.values():
            if isinstance(outcome, cdpr.NotConverged):
                console.print(outcome.reason, style="dim", markup=False, highlight=False)
        for note in report.equilibrium_notes(newton):
            console.print(note, highlight=False)
        console.print(report.verdict(agreement), highlight=False)
    raise typer.Exit(0 if agreement.agrees else DISAGREE)


def solve(
    robot: RobotName,
    pose: Pose = None,
    material: MaterialName = None,
    pretension: Pretension = None,
    method: Annotated[str, typer.Option("--method", help="newton, fsolve or least_squares.")] = "newton",
    as_json: AsJson = False,
) -> None:
    """Solve for the static equilibrium with one solver. Exit status 2 if it does not find one."""
    with errors_as_sentences():
        problem = problem_of(robot, pose, material, pretension)
        with busy("Solving (the first run on a machine compiles for half a minute)"):
            result = cdpr.solve(problem, method=method)  # type: ignore[arg-type]
    if as_json:
        print_json(json_of.solution(result))
    else:
        console = Output()
        console.print(report.settle_table(problem, {result.source: result}))
        for note in report.equilibrium_notes(result):
            console.print(note, highlight=False)


def _outcome(problem: cdpr.Problem, method: str) -> report.Outcome:
    try:
        return cdpr.solve(problem, method=method)  # type: ignore[arg-type]
    except cdpr.NotConverged as failure:
        return failure

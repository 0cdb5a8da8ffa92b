"""Commands that ask where a platform rests: settle, solve."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer

import cdpr_sim as cdpr
from cdpr_sim.cli.options import AsJson, MaterialName, Pose, Pretension, RobotName, problem_of
from cdpr_sim.cli.terminal import DISAGREE, Output, busy, errors_as_sentences, print_json

if TYPE_CHECKING:
    from cdpr_sim.report.crosscheck import Outcome

METHODS = "newton", "fsolve", "least_squares"
"""The static solvers."""


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
    from cdpr_sim.report import as_json as json_of
    from cdpr_sim.report import crosscheck as report

    with errors_as_sentences():
        problem = problem_of(robot, pose, material, pretension)
        settled = cdpr.settle(problem, progress=True)
        with busy("The static solvers look for equilibrium"):
            newton, *seecr = (_outcome(problem, method) for method in METHODS)
        if not isinstance(newton, cdpr.Equilibrium):
            raise newton
        agreement = cdpr.compare(newton, settled)
    outcomes = [settled, newton, *seecr]
    if as_json:
        print_json(json_of.crosscheck(problem, outcomes, agreement))
    else:
        console = Output()
        console.print(report.settle_table(problem, outcomes))
        for outcome in outcomes:
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
    from cdpr_sim.report import as_json as json_of
    from cdpr_sim.report import crosscheck as report

    with errors_as_sentences():
        problem = problem_of(robot, pose, material, pretension)
        with busy("Solving"):
            result = cdpr.solve(problem, method=method)  # type: ignore[arg-type]
    if as_json:
        print_json(json_of.solution(result))
    else:
        console = Output()
        console.print(report.settle_table(problem, [result]))
        for note in report.equilibrium_notes(result):
            console.print(note, highlight=False)


def _outcome(problem: cdpr.Problem, method: str) -> Outcome:
    try:
        return cdpr.solve(problem, method=method)  # type: ignore[arg-type]
    except cdpr.NotConverged as failure:
        return failure

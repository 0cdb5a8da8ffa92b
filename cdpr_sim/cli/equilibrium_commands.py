"""Commands that compute one static equilibrium: settle, solve, certify."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Annotated

import typer
from rich.markup import escape

import cdpr_sim as cdpr
from cdpr_sim.cli.options import AsJson, MaterialName, Pose, Pretension, RobotName, problem_of, wrenches_of
from cdpr_sim.cli.terminal import DISAGREE, Output, busy, errors_as_sentences, print_json, print_parts

if TYPE_CHECKING:
    from cdpr_sim.report.crosscheck_tables import Outcome

METHODS = "newton", "fsolve", "least_squares"
"""The static solvers."""


def settle(
    robot: RobotName,
    pose: Pose = None,
    material: MaterialName = None,
    pretension: Pretension = None,
    certify: Annotated[
        bool | None,
        typer.Option(
            "--certify/--no-certify",
            help="Show the proved equilibrium in a column; for planar robots, prove that there are no others. By "
            "default one row shows the proved errors if the extra proof is installed.",
        ),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Settle the platform in MuJoCo, solve with Newton and SEECR, and compare MuJoCo with Newton.

    With the extra proof, each equilibrium found is proved, with a bound of its error.

    Exit status: 0 if they agree, 1 if they do not, 2 for invalid input or if no equilibrium is found.
    """
    from cdpr_sim.proof.complete import quickly_complete
    from cdpr_sim.report import as_json as json_of
    from cdpr_sim.report import crosscheck_tables as report
    from cdpr_sim.report import proof_tables

    with errors_as_sentences():
        problem = problem_of(robot, pose, material, pretension)
        with busy("Solving for the static equilibrium"):
            newton, *seecr = (_outcome(problem, method) for method in METHODS)
        settled = cdpr.settle(problem, progress=True)
        if not isinstance(newton, cdpr.Equilibrium):
            raise newton
        agreement = cdpr.compare(newton, settled)
        outcomes = [settled, newton, *seecr]
        proved = _certificates(outcomes, certify)
        complete = cdpr.certify_all(problem) if certify and quickly_complete(problem) else None
    if as_json:
        answer = json_of.crosscheck(problem, outcomes, agreement, proved)
        print_json(answer if complete is None else answer | json_of.complete(complete))
    else:
        console = Output()
        middle = next((one.midpoint for one in proved if certify and one.equilibrium is newton), None)
        shown = outcomes if middle is None else [middle, *outcomes]
        table = report.settle_table(problem, shown)
        if proved:
            cells = {one.equilibrium.source: proof_tables.proof_cell(one) for one in proved}
            sources = ["" if point is None else point.source for point in map(report.best_point, shown)]
            table.add_row(escape("proved within [mm]"), "", *(cells.get(source, "") for source in sources))
        console.print(table)
        for line in proof_tables.reasons(proved):
            console.print(line, highlight=False)
        if complete is not None:
            console.print(proof_tables.complete_note(complete), highlight=False)
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
    """Solve for the static equilibrium with one solver. Exit status 2 if it finds none."""
    from cdpr_sim.report import as_json as json_of
    from cdpr_sim.report import crosscheck_tables as report

    with errors_as_sentences():
        problem = problem_of(robot, pose, material, pretension)
        with busy("Solving"):
            result = cdpr.solve(problem, method=method)  # type: ignore[arg-type]
    if as_json:
        print_json(json_of.solution(result))
    else:
        print_parts(report.settle_table(problem, [result]), *report.equilibrium_notes(result))


def certify(
    robot: RobotName,
    pose: Pose = None,
    material: MaterialName = None,
    pretension: Pretension = None,
    wrench: Annotated[
        str | None,
        typer.Option(
            "--wrench", metavar="FX,FY,FZ,TX,TY,TZ", help="[N, N m] External wrench at the platform's origin."
        ),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Prove that the equilibrium exists, is locally unique and stable, and which cables are slack.

    The equilibria of MuJoCo and of Newton are proved separately; needs the extra proof. Exit status: 0 if both are
    proved, 1 if one is not, 2 for invalid input.
    """
    from cdpr_sim.report import as_json as json_of
    from cdpr_sim.report import proof_tables as report

    with errors_as_sentences():
        problem = problem_of(robot, pose, material, pretension)
        wrenches = wrenches_of(None if wrench is None else [wrench])
        if wrenches:
            problem = cdpr.Problem.of(problem.robot, problem.pose, problem.rest_lengths, wrenches[0])
        with busy("Settling, solving and proving"):
            proved = [cdpr.certify(method(problem)) for method in (cdpr.settle, cdpr.solve)]
    if as_json:
        print_json(json_of.certificates(proved))
    else:
        print_parts(report.certificate_table(proved), *report.reasons(proved))
    raise typer.Exit(0 if all(one.proved for one in proved) else DISAGREE)


def _outcome(problem: cdpr.Problem, method: str) -> Outcome:
    try:
        return cdpr.solve(problem, method=method)  # type: ignore[arg-type]
    except cdpr.NotConverged as failure:
        return failure


def _certificates(outcomes: Sequence[Outcome], wanted: bool | None) -> list[cdpr.Certificate]:
    """Certificates of all equilibria; by default none where the extra is missing."""
    from cdpr_sim.proof.balls import installed

    if not (installed() if wanted is None else wanted):
        return []
    return [cdpr.certify(one) for one in outcomes if isinstance(one, cdpr.Equilibrium)]

"""Commands that compute one static equilibrium: settle, solve, certify."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, NoReturn

import typer
from rich.markup import escape

import cdpr_sim as cdpr
from cdpr_sim.cli.options import (
    AsJson,
    Details,
    Mass,
    MaterialName,
    PathPoints,
    Pose,
    Pretension,
    RobotName,
    Waypoints,
    Wrench,
    along,
    problem_of,
    robot_of,
    waypoints_of,
    wrench_of,
)
from cdpr_sim.cli.terminal import DISAGREE, busy, print_json, print_parts

if TYPE_CHECKING:
    from scipy.spatial.transform import RigidTransform

    from cdpr_sim.report.crosscheck_tables import Outcome

METHODS = "newton", "fsolve", "least_squares"
"""The static solvers."""


def settle(
    robot: RobotName,
    pose: Pose = None,
    material: MaterialName = None,
    pretension: Pretension = None,
    mass: Mass = None,
    wrench: Wrench = None,
    certify: Annotated[
        bool | None,
        typer.Option(
            "--certify/--no-certify",
            help="Show the proved equilibrium in a column; for planar robots, prove that there are no others. By "
            "default, with --all, one row shows the proved errors if the extra proof is installed and knows such "
            "cables.",
        ),
    ] = None,
    waypoint: Waypoints = None,
    path_points: PathPoints = 11,
    details: Details = False,
    as_json: AsJson = False,
) -> None:
    """Settle the platform in MuJoCo, solve with Newton, and compare the two; with --all, also solve with SEECR.

    With --all and the extra proof, each equilibrium found is proved, with a bound of its error. With waypoints, MuJoCo
    and Newton are compared at each pose of a path, along which cables keep their memory.

    Exit status: 0 if they agree, 1 if they do not, 2 for invalid input or if no equilibrium is found.
    """
    from cdpr_sim.core import extras
    from cdpr_sim.proof.complete import quickly_complete
    from cdpr_sim.report import as_json as json_of
    from cdpr_sim.report import crosscheck_tables as report
    from cdpr_sim.report import proof_tables

    if waypoint:
        if pose is not None or certify or details:
            raise cdpr.InvalidInput("--waypoint: found waypoints and --pose, --certify or --all, expected one of them")
        machine, load = robot_of(robot, material, mass, pretension), wrench_of(wrench)
        _settle_along(machine, along(machine, waypoints_of(waypoint), path_points), load, as_json)
    problem = problem_of(robot, pose, material, pretension, mass, wrench)
    cabling = problem.robot.cabling
    if certify:
        extras.require("proof", "--certify")
        cabling.refuse_memory()
        cabling.refuse_unknown("proof")
    details = details or as_json
    methods = METHODS[:1] if not details or cabling.has_memory.any() else METHODS  # SEECR knows elastic cables only
    if certify is None:
        proving = details and not extras.missing("proof") and not cabling.unknown_to("proof")
    else:
        proving = certify
    with busy("Solving for the static equilibrium"):
        newton, *seecr = (_outcome(problem, method) for method in methods)
    settled = cdpr.settle(problem, progress=True)
    if not isinstance(newton, cdpr.Equilibrium):
        raise newton
    agreement = cdpr.compare(newton, settled)
    outcomes = [settled, newton, *seecr]
    proved = [cdpr.certify(one) for one in outcomes if proving and isinstance(one, cdpr.Equilibrium)]
    complete = cdpr.certify_all(problem) if certify and quickly_complete(problem) else None
    if as_json:
        answer = json_of.crosscheck(problem, outcomes, agreement, proved)
        print_json(answer if complete is None else answer | json_of.complete(complete))
    else:
        middle = next((one.midpoint for one in proved if certify and one.equilibrium is newton), None)
        shown = outcomes if middle is None else [middle, *outcomes]
        table = report.settle_table(problem, shown, details=details)
        if proved:
            cells = {one.equilibrium.source: proof_tables.proof_cell(one) for one in proved}
            sources = ["" if point is None else point.source for point in map(report.best_point, shown)]
            table.add_row(escape("proved within [mm]"), "", *(cells.get(source, "") for source in sources))
        differences = report.verdict(agreement)
        print_parts(
            report.lead(report.verdict_sentence(agreement, settled), problem.pose, settled),
            *([] if agreement.agrees else [differences]),
            *report.equilibrium_notes(newton),
            *proof_tables.reasons(proved),
            *([] if complete is None else [proof_tables.complete_note(complete)]),
            "",
            table,
            *(f"[dim]{escape(one.reason)}[/]" for one in outcomes if isinstance(one, cdpr.NotConverged)),
            *([differences] if agreement.agrees else []),
        )
    raise typer.Exit(0 if agreement.agrees else DISAGREE)


def solve(
    robot: RobotName,
    pose: Pose = None,
    material: MaterialName = None,
    pretension: Pretension = None,
    mass: Mass = None,
    wrench: Wrench = None,
    method: Annotated[str, typer.Option("--method", help="newton, fsolve or least_squares.")] = "newton",
    details: Details = False,
    as_json: AsJson = False,
) -> None:
    """Solve for the static equilibrium with one solver. Exit status 2 if it finds none."""
    from cdpr_sim.report import as_json as json_of
    from cdpr_sim.report import crosscheck_tables as report

    problem = problem_of(robot, pose, material, pretension, mass, wrench)
    with busy("Solving"):
        result = cdpr.solve(problem, method=method)  # type: ignore[arg-type]
    if as_json:
        print_json(json_of.solution(result))
    else:
        verdict = f"[bold]{result.stability.name.capitalize()} equilibrium[/], {result.residual:.1e} N unbalanced."
        table = report.settle_table(problem, [result], details=details)
        print_parts(report.lead(verdict, problem.pose, result), *report.equilibrium_notes(result), "", table)


def certify(
    robot: RobotName,
    pose: Pose = None,
    material: MaterialName = None,
    pretension: Pretension = None,
    mass: Mass = None,
    wrench: Wrench = None,
    as_json: AsJson = False,
) -> None:
    """Prove that the equilibrium exists, is locally unique and stable, and which cables are slack.

    The equilibria of MuJoCo and of Newton are proved separately; needs the extra proof. Exit status: 0 if both are
    proved, 1 if one is not, 2 for invalid input.
    """
    from cdpr_sim.core import extras
    from cdpr_sim.report import as_json as json_of
    from cdpr_sim.report import proof_tables as report

    problem = problem_of(robot, pose, material, pretension, mass, wrench)
    extras.require("proof", "certify")
    problem.robot.cabling.refuse_memory()
    with busy("Settling, solving and proving"):
        proved = [cdpr.certify(method(problem)) for method in (cdpr.settle, cdpr.solve)]
    if as_json:
        print_json(json_of.certificates(proved))
    else:
        print_parts(report.certificate_lead(proved), *report.reasons(proved), "", report.certificate_table(proved))
    raise typer.Exit(0 if all(one.proved for one in proved) else DISAGREE)


def _settle_along(robot: cdpr.Robot, poses: RigidTransform, load: list[float] | None, as_json: bool) -> NoReturn:
    """``settle`` at each pose of a path."""
    from cdpr_sim.crosscheck.check import both
    from cdpr_sim.crosscheck.compare import compare_many
    from cdpr_sim.report import as_json as json_of
    from cdpr_sim.report import crosscheck_tables as report

    problems = cdpr.Problems.of(robot, poses, external_wrench=load)
    with busy("Solving and settling"):
        solved, settled = both(problems, path=bool(robot.cabling.has_memory.any()))
        compared = compare_many(solved, settled)
        agree = compared.agrees
    if as_json:
        print_json(json_of.path(solved, settled, agree))
    else:
        print_parts(*report.path_lead(settled, agree), report.path_table(settled, compared.errors, agree))
    raise typer.Exit(0 if agree.all() else DISAGREE)


def _outcome(problem: cdpr.Problem, method: str) -> Outcome:
    try:
        return cdpr.solve(problem, method=method)  # type: ignore[arg-type]
    except cdpr.NotConverged as failure:
        return failure

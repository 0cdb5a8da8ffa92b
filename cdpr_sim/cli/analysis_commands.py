"""Analysis commands: compensate, sensitivity, equilibria, identify; and score, of solvers."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated, Any

import typer

import cdpr_sim as cdpr
from cdpr_sim.cli.options import AsJson, MaterialName, Pose, Pretension, RobotName, pose_of, problem_of, robot_of
from cdpr_sim.cli.terminal import DISAGREE, busy, print_json, print_parts

BYTES_PER_START = 1000
"""Memory per start pose of the search for equilibria: about 600 measured (``scripts/dev/measure_constants.py``)."""


def compensate(
    robot: RobotName,
    pose: Pose = None,
    material: MaterialName = None,
    limits: Annotated[
        tuple[float, float] | None,
        typer.Option(
            "--tension-limits", metavar="MIN MAX", help="Tension limits [N]; default: the robot's, at most 5 % strain."
        ),
    ] = None,
    prefer: Annotated[str, typer.Option("--prefer", help="smallest (tensions) or stiffest (platform).")] = "smallest",
    arm: Annotated[
        float | None,
        typer.Option("--arm", help="[m] Weight of rotation where only a nearby pose can be held; 0: position only."),
    ] = None,
    least_length: Annotated[
        float | None,
        typer.Option(
            "--least-length",
            help="[m] Least length of a cable; default: 1 % of the characteristic length.",
        ),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Compute unstretched cable lengths that hold the platform at the commanded pose, and verify them in MuJoCo.

    Exit status: 0 if the commanded pose is held, 1 if only a nearby pose can be held or MuJoCo does not confirm it, 2
    for invalid input.
    """
    from cdpr_sim.core.pretension import without_pretension
    from cdpr_sim.report import analysis_tables as report
    from cdpr_sim.report import as_json as json_of
    from cdpr_sim.report.crosscheck_tables import lead

    machine = without_pretension(robot_of(robot, material))  # its own tensions are computed
    problem = cdpr.Problem.of(machine, pose_of(pose) or tuple(machine.home))
    with busy("Computing tensions"):
        compensation = cdpr.compensate(
            problem,
            tension_limits=limits,
            prefer=prefer,  # type: ignore[arg-type]
            arm=arm,
            least_length=least_length,
        )
        verification = cdpr.verify_compensation(compensation)
        before, after, missing = [], [], []
        for method in (cdpr.settle, cdpr.solve):
            # Start at the uncompensated equilibrium, so that the platform has to reach the commanded pose by itself.
            start, lengths = problem.pose, compensation.rest_lengths
            try:
                before.append(method(problem))
                start = before[-1].pose
            except (cdpr.NotConverged, cdpr.NotSettled) as error:
                missing.append(f"before: {error}")
            try:
                after.append(method(problem.robot, start, lengths, external_wrench=problem.external_wrench))
            except (cdpr.NotConverged, cdpr.NotSettled) as error:
                missing.append(f"after, from there: {error}")
    if as_json:
        print_json(json_of.compensation(problem, compensation, verification, before, after) | {"missing": missing})
    else:
        verdict, *reasons = report.compensation_verdict(compensation, verification).split("\n")
        print_parts(
            lead(verdict, problem.pose, *before[:1], *after[:1]) if before or after else verdict,
            *reasons,
            report.compensation_lengths(compensation),
            *([report.missing_results(missing)] if missing else []),
            *(["", report.compensation_table(compensation, before, after)] if before or after else []),
        )
    raise typer.Exit(0 if compensation.exact and verification.held else DISAGREE)


def sensitivity(
    robot: RobotName,
    pose: Pose = None,
    material: MaterialName = None,
    pretension: Pretension = None,
    rows: Annotated[int, typer.Option("--rows", min=1, help="Number of rows, the largest effects first.")] = 20,
    as_json: AsJson = False,
) -> None:
    """Sensitivity of the pose to cable lengths, stiffness, geometry and load, largest first; natural frequencies."""
    from cdpr_sim.report import analysis_tables as report
    from cdpr_sim.report import as_json as json_of

    problem = problem_of(robot, pose, material, pretension)
    with busy("Solving"):
        answer = cdpr.sensitivity(problem)
        effects, modes = answer.effects(), cdpr.natural_modes(answer.equilibrium)
    if as_json:
        print_json(json_of.sensitivity(answer, effects, modes))
    else:
        lines = report.sensitivity_lead(answer, effects, modes)
        print_parts(*lines, report.sensitivity_table(answer, effects[:rows]), report.modes_table(modes))


def equilibria(
    robot: RobotName,
    pose: Pose = None,
    material: MaterialName = None,
    pretension: Pretension = None,
    saddles: Annotated[bool, typer.Option("--saddles", help="Search for unstable equilibria as well.")] = False,
    starts: Annotated[int, typer.Option("--starts", help="Number of start poses.")] = 2000,
    certify: Annotated[bool, typer.Option("--certify", help="Prove the list of equilibria complete.")] = False,
    time_limit: Annotated[
        float, typer.Option("--time-limit", help="[s] Limit for that proof; spatial robots take minutes or longer.")
    ] = 60.0,
    as_json: AsJson = False,
) -> None:
    """Find all equilibria with the cable lengths of the commanded pose, and which of them the robot reaches."""
    from cdpr_sim.core import free_ram
    from cdpr_sim.report import analysis_tables as report
    from cdpr_sim.report import as_json as json_of

    problem = problem_of(robot, pose, material, pretension)
    if starts < 1:
        raise cdpr.InvalidInput(f"starts: found {starts}, expected at least 1")
    free_ram.refuse_beyond(f"--starts {starts}", starts * BYTES_PER_START, "fewer starts")
    if certify:
        from cdpr_sim.proof.complete import refuse_unsearchable

        refuse_unsearchable(problem)
    with busy("Searching for equilibria"):
        found = cdpr.find_equilibria(problem, saddles=saddles, starts=starts)
        followed = cdpr.follow_load(problem)
        reached, _ = found.nearest(followed.reached.pose)
        by_mujoco, _ = found.nearest(cdpr.grow_gravity(problem).pose)
        proved = cdpr.certify_all(problem, time_limit=time_limit) if certify else None
        releases = [  # which oscillate undamped; cables with mass would do so as well
            cdpr.release(one, seconds=2.0 if one.stable else 20.0) for one in found if problem.robot.cabling.massless
        ]
    if as_json:
        answer = json_of.equilibria(problem, found, releases, followed, reached, by_mujoco)
        print_json(answer if proved is None else answer | json_of.complete(proved))
    else:
        same = "MuJoCo reaches the same one" if by_mujoco == reached else f"MuJoCo reaches {by_mujoco + 1} instead"
        lines = [
            f"[bold]{len(found)} {'equilibria' if len(found) > 1 else 'equilibrium'}[/] found, "
            f"{sum(one.stable for one in found)} stable. With gravity increased step by step, the platform reaches "
            f"equilibrium {reached + 1}; {same}.",
            *filter(None, [report.equilibria_note(found)]),
        ]
        if proved is not None:
            from cdpr_sim.report import proof_tables

            missing = [one for one in proved.missing_from(found) if saddles or one.stable]
            lines += [proof_tables.complete_note(proved), proof_tables.missing_note(missing)]
        print_parts(*lines, report.equilibria_table(found, releases, reached))
    raise typer.Exit(0 if by_mujoco == reached else DISAGREE)


def _error(name: str, of: str) -> Any:
    return typer.Option(name, help=f"Standard error of {of}.")


def identify(
    robot: RobotName,
    file: Annotated[
        Path | None, typer.Argument(metavar="MEASUREMENTS", help="CSV with named columns and units.")
    ] = None,
    lengths: Annotated[
        Path | None,
        typer.Option("--lengths", metavar="CSV", help="Lengths at poses that nobody measured: length_1 [mm], ..."),
    ] = None,
    unknown: Annotated[
        list[str] | None,
        typer.Option("--unknown", help="axial_stiffness (default), mass, force_gains, ...; repeatable."),
    ] = None,
    material: MaterialName = None,
    pretension: Pretension = None,
    position_error: Annotated[float | None, _error("--position-error", "a measured coordinate [mm]")] = None,
    rotation_error: Annotated[float | None, _error("--rotation-error", "a measured angle [°]")] = None,
    tension_error: Annotated[float | None, _error("--tension-error", "a measured tension [N]")] = None,
    swivel_error: Annotated[float | None, _error("--swivel-error", "a measured swivel angle [°]")] = None,
    frequency_error: Annotated[float | None, _error("--frequency-error", "a measured natural frequency [Hz]")] = None,
    rest_length_error: Annotated[float | None, _error("--rest-length-error", "a rest length [mm]")] = None,
    length_error: Annotated[float | None, _error("--length-error", "a length at an unknown pose [mm]")] = None,
    gauge: Annotated[
        list[str] | None,
        typer.Option("--gauge", help='Held coordinate of an unknown exit, "exit 3 x"; repeatable; with --lengths.'),
    ] = None,
    robust: Annotated[bool, typer.Option("--robust", help="Count outliers less, by Huber's weights.")] = False,
    as_json: AsJson = False,
) -> None:
    """Fit stiffness, lengths, mass, geometry or gains and zeros of sensors to measurements in equilibrium.

    Exit status 1 if the measurements do not determine all unknowns and their standard errors.

    Columns of the file: commanded_x [mm], commanded_y [mm], commanded_z [mm], measured_z [mm], measured_beta [deg], and
    so on; tension_1 [N], swivel_1 [deg], frequency_1 [Hz], ...; rest_length_1 [mm], ...; mass [kg], force_z [N], ...;
    tension_1_error [N], ...; robot.

    With --lengths, poses are unknown: length_1 [mm], ... of all cables, and tension_3 [N], ... of those that were
    pulled tight.
    """
    from cdpr_sim.report import analysis_tables as report
    from cdpr_sim.report import as_json as json_of

    machine = robot_of(robot, material, pretension=pretension)
    if (file is None) == (lengths is None):
        found = "neither" if file is None else "both"
        raise cdpr.InvalidInput(f"MEASUREMENTS: found {found} of a file and --lengths, expected one of the two")
    measurements = cdpr.read_measurements(file or lengths or "")
    if lengths is not None and measurements.lengths is None:
        raise cdpr.InvalidInput(f"{lengths}: found no column length_1, expected lengths of all cables")
    with busy("Fitting"):
        result = cdpr.identify(
            machine,
            measurements,
            unknown or ["axial_stiffness"],
            position_error=None if position_error is None else 1e-3 * position_error,
            rotation_error=None if rotation_error is None else math.radians(rotation_error),
            tension_error=tension_error,
            swivel_error=None if swivel_error is None else math.radians(swivel_error),
            frequency_error=frequency_error,
            rest_length_error=None if rest_length_error is None else 1e-3 * rest_length_error,
            length_error=None if length_error is None else 1e-3 * length_error,
            gauge=gauge or None,
            robust=robust,
        )
    if as_json:
        print_json(json_of.identification(result))
    else:
        print_parts(report.identification_table(result), report.identification_note(result))
    raise typer.Exit(DISAGREE if result.reasons else 0)


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
        Path | None, typer.Option("--problems", metavar="FOLDER", help="Problem set; default: the 300 of the package.")
    ] = None,
    level: Annotated[str | None, typer.Option("--level", help="lower, average or higher; default: all.")] = None,
    first: Annotated[
        int | None, typer.Option("--first", min=1, help="Number of problems per level; default: all.")
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Count a solver's correct digits and its false claims on problems whose equilibria are proved.

    Exit status: 0 if every claimed solution is correct, 1 if one is not, 2 for invalid input.
    """
    from cdpr_sim.crosscheck import problem_set
    from cdpr_sim.crosscheck import score as scoring
    from cdpr_sim.report import score_tables

    if level is not None and level not in problem_set.LEVELS:
        raise cdpr.UnknownName("level", level, problem_set.LEVELS)
    every = problem_set.read_problems(problems or problem_set.PROBLEMS)
    chosen = [
        one
        for name in problem_set.LEVELS
        if level in (None, name)
        for one in [problem for problem in every if problem.level == name][:first]
    ]
    scores = [
        scoring.score_answers(Path(name), chosen)
        if name.endswith(".json")
        else scoring.score(name, scoring.solver_called(name), chosen, progress=not as_json)
        for name in solver
    ]
    if as_json:
        print_json(score_tables.scores_json(scores))
    else:
        print_parts(score_tables.score_table(scores))
    wrong = any(one.claimed and not one.solved for each in scores for one in each.outcomes)
    raise typer.Exit(DISAGREE if wrong else 0)

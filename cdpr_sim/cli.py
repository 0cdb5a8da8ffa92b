"""The command line: where does the platform end up, and do the two roads agree?"""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated

import typer
from rich import box
from rich.console import Console
from rich.table import Table

import cdpr_sim as cdpr
from cdpr_sim import answer_tables, report
from cdpr_sim import models as model_folders

app = typer.Typer(
    help="Where does the platform of a cable-driven parallel robot really end up? Statics and MuJoCo, cross-checked.",
    no_args_is_help=True,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
    add_completion=False,
)

METHODS = {"Newton": "newton", "SEECR\nfsolve": "fsolve", "SEECR\nleast_sq.": "least_squares"}

RobotName = Annotated[
    str, typer.Argument(metavar="ROBOT", help="A name that `cdpr-sim robots` lists, or a .toml file.")
]
Pose = Annotated[
    tuple[float, float, float] | None,
    typer.Option("--pose", metavar="X Y Z", help="Commanded position [m]; default: the middle of the workspace."),
]
MaterialName = Annotated[str | None, typer.Option("--material", help="Cables: vectran-0.7mm or fishing-0.4mm.")]
AsJson = Annotated[bool, typer.Option("--json", help="Print JSON, in SI units, instead of a table.")]


def main() -> None:
    """The entry point of ``cdpr-sim``."""
    app()


@app.command()
def settle(robot: RobotName, pose: Pose = None, material: MaterialName = None, as_json: AsJson = False) -> None:
    """Settle the platform in MuJoCo, solve it with Newton and SEECR, and say whether MuJoCo and Newton agree.

    Exit status: 0 if they agree, 1 if they do not, 2 for input that cannot be right or a platform that does not rest.
    """
    with _errors_as_sentences():
        problem = _problem(robot, pose, material)
        outcomes: dict[str, report.Outcome] = {}
        with _busy("MuJoCo settles the platform"):
            settled = cdpr.settle(problem.robot, problem.pose)
        outcomes["MuJoCo"] = settled
        with _busy("The static solvers look for equilibrium (the first run on a machine compiles for half a minute)"):
            outcomes |= {name: _outcome(problem, method) for name, method in METHODS.items()}
        newton = outcomes["Newton"]
        if not isinstance(newton, cdpr.Equilibrium):
            raise newton
        agreement = cdpr.compare(newton, settled)
    if as_json:
        _print_json(
            {
                "robot": problem.robot.name,
                "commanded": problem.pose.translation.tolist(),
                "results": {METHODS.get(name, "mujoco"): report.as_dict(outcome) for name, outcome in outcomes.items()},
                "agrees": agreement.agrees,
                "verdict": agreement.verdict.value,
                "reasons": list(agreement.reasons),
            }
        )
    else:
        console = Console()
        console.print(report.settle_table(problem, outcomes))
        for outcome in outcomes.values():
            if isinstance(outcome, cdpr.NotConverged):
                console.print(f"[dim]{outcome.reason}[/]", highlight=False)
        console.print(report.verdict(agreement), highlight=False)
    raise typer.Exit(0 if agreement.agrees else 1)


@app.command()
def solve(
    robot: RobotName,
    pose: Pose = None,
    material: MaterialName = None,
    method: Annotated[str, typer.Option("--method", help="newton, fsolve or least_squares.")] = "newton",
    as_json: AsJson = False,
) -> None:
    """Solve for the static equilibrium with one solver. Exit status 2 if it does not find one."""
    with _errors_as_sentences():
        problem = _problem(robot, pose, material)
        with _busy("Solving (the first run on a machine compiles for half a minute)"):
            result = cdpr.solve(problem.robot, problem.pose, method=method)  # type: ignore[arg-type]
    if as_json:
        _print_json(report.as_dict(result))
    else:
        Console().print(report.settle_table(problem, {result.source: result}))


@app.command()
def compensate(
    robot: RobotName,
    pose: Pose = None,
    material: MaterialName = None,
    limits: Annotated[
        tuple[float, float] | None,
        typer.Option("--tensions", metavar="MIN MAX", help="Limits of tension [N]; default: 1 % of the load, inf."),
    ] = None,
    prefer: Annotated[str, typer.Option("--prefer", help="smallest tensions, or the stiffest platform.")] = "smallest",
    arm: Annotated[
        float | None,
        typer.Option("--arm", help="[m] Where only a near pose can be held: how much rotation counts; 0: not at all."),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Cut the cables to lengths that hold the platform where it is commanded to be, and prove it in MuJoCo.

    Exit status: 0 if the commanded pose is held, 1 if only a pose near it can be, 2 for input that cannot be right.
    """
    with _errors_as_sentences():
        problem = _problem(robot, pose, material)
        machine, commanded = problem.robot, problem.pose
        with _busy("Looking for tensions (the first run on a machine compiles for half a minute)"):
            found = cdpr.compensate(
                machine,
                commanded,
                tension_limits=limits,
                prefer=prefer,  # type: ignore[arg-type]
                arm=arm,
            )
            roads = {"MuJoCo": cdpr.settle, "Newton": cdpr.solve}
            before = {name: road(machine, commanded) for name, road in roads.items()}
            # From where the platform hangs now, so that coming to the commanded pose is its own doing.
            after = {name: road(machine, before[name].pose, found.rest_lengths) for name, road in roads.items()}
    if as_json:
        _print_json(
            {
                "robot": machine.name,
                "commanded": commanded.translation.tolist(),
                "exact": found.exact,
                "distance": found.distance,
                "reasons": list(found.reasons),
                "rest_lengths": found.rest_lengths.tolist(),
                "before": {name.lower(): report.as_dict(result) for name, result in before.items()},
                "after": {name.lower(): report.as_dict(result) for name, result in after.items()},
            }
        )
    else:
        console = Console()
        console.print(answer_tables.compensation_table(found, before, after))
        console.print(answer_tables.compensation_lengths(found), highlight=False)
        console.print(answer_tables.compensation_verdict(found), highlight=False)
    raise typer.Exit(0 if found.exact else 1)


@app.command()
def sensitivity(
    robot: RobotName,
    pose: Pose = None,
    material: MaterialName = None,
    rows: Annotated[int, typer.Option("--rows", min=1, help="How many to print; the rest matters less.")] = 20,
    as_json: AsJson = False,
) -> None:
    """What matters most: mm and degrees per mm of length, per percent of stiffness, per newton; natural frequencies."""
    with _errors_as_sentences():
        problem = _problem(robot, pose, material)
        with _busy("Solving (the first run on a machine compiles for half a minute)"):
            answer = cdpr.sensitivity(cdpr.solve(problem.robot, problem.pose))
            effects, modes = answer.effects(), cdpr.natural_modes(answer.equilibrium)
    if as_json:
        _print_json(
            {
                "robot": problem.robot.name,
                "commanded": problem.pose.translation.tolist(),
                "margin": answer.margin,
                "effects": [vars(effect) for effect in effects],
                "pose": {name: matrix.tolist() for name, matrix in answer.pose.items()},
                "tensions": {name: matrix.tolist() for name, matrix in answer.tensions.items()},
                "frequencies": modes.frequencies.tolist(),
                "shapes": modes.shapes.tolist(),
            }
        )
    else:
        console = Console()
        console.print(answer_tables.sensitivity_table(answer, effects[:rows]))
        console.print(answer_tables.sensitivity_note(answer), highlight=False)
        console.print(answer_tables.modes_table(modes))


@app.command()
def equilibria(
    robot: RobotName,
    pose: Pose = None,
    material: MaterialName = None,
    saddles: Annotated[bool, typer.Option("--saddles", help="Search for the unstable ones as well.")] = False,
    starts: Annotated[int, typer.Option("--starts", help="How many poses to start from.")] = 2000,
    as_json: AsJson = False,
) -> None:
    """All places to rest on the cable lengths of the commanded pose, and which of them the robot reaches."""
    with _errors_as_sentences():
        problem = _problem(robot, pose, material)
        with _busy("Looking for equilibria (the first run on a machine compiles for half a minute)"):
            found = cdpr.find_equilibria(problem.robot, problem.rest_lengths, saddles=saddles, starts=starts)
            followed = cdpr.follow_load(problem.robot, problem.pose)
            reached, _ = found.nearest(followed.reached.pose)
            by_mujoco, _ = found.nearest(cdpr.grow_gravity(problem.robot, problem.pose).pose)
            releases = [cdpr.release(one, seconds=2.0 if one.stable else 20.0) for one in found]
    if as_json:
        _print_json(
            {
                "robot": problem.robot.name,
                "commanded": problem.pose.translation.tolist(),
                "reached": reached,
                "reached_in_mujoco": by_mujoco,
                "jumps": list(followed.jumps),
                "imbalance": found.imbalance,
                "equilibria": [
                    report.as_dict(one) | {"energy": float(energy), "stays_in_mujoco": release.stays}
                    for one, energy, release in zip(found, found.energies, releases, strict=True)
                ],
            }
        )
    else:
        console = Console()
        console.print(answer_tables.equilibria_table(found, releases, reached))
        same = "MuJoCo comes to the same" if by_mujoco == reached else f"MuJoCo comes to {by_mujoco + 1} instead"
        console.print(f"Followed while gravity grows, the platform comes to {reached + 1}; {same}.", highlight=False)
        console.print(answer_tables.equilibria_note(found), highlight=False)
    raise typer.Exit(0 if by_mujoco == reached else 1)


@app.command()
def identify(
    robot: RobotName,
    file: Annotated[Path, typer.Argument(metavar="MEASUREMENTS", help="CSV with named columns and units.")],
    unknown: Annotated[
        list[str] | None,
        typer.Option("--unknown", help="axial_stiffness (the default), axial_stiffness_each, mass, ...; repeatable."),
    ] = None,
    material: MaterialName = None,
    position_error: Annotated[
        float | None, typer.Option("--position-error", help="Standard error of a measured coordinate [mm].")
    ] = None,
    rotation_error: Annotated[
        float | None, typer.Option("--rotation-error", help="Standard error of a measured angle [°].")
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Fit stiffness, rest lengths, mass or centre of mass to measured poses. Exit status 1 if the data cannot tell all.

    Columns of the file: commanded_x [mm], commanded_y [mm], commanded_z [mm], measured_z [mm], measured_beta [deg], and
    so on; rest_length_1 [mm], ...; robot.
    """
    with _errors_as_sentences():
        machine = cdpr.load_robot(robot)
        if material is not None:
            machine = machine.replace(material=material)
        measurements = cdpr.read_measurements(file)
        with _busy("Fitting (the first run on a machine compiles for half a minute)"):
            found = cdpr.identify(
                machine,
                measurements,
                unknown or ["axial_stiffness"],
                position_error=None if position_error is None else 1e-3 * position_error,
                rotation_error=None if rotation_error is None else math.radians(rotation_error),
            )
    if as_json:
        # JSON has no infinity and no nan: what is not known is null.
        errors = [error if math.isfinite(error) else None for error in found.standard_errors.tolist()]
        _print_json(
            {
                "robot": machine.name,
                "unknowns": {
                    name: {"value": value, "standard_error": error, "unit": unit}
                    for name, value, error, unit in zip(
                        found.names, found.values.tolist(), errors, found.units, strict=True
                    )
                },
                "spread": found.spread,
                "reasons": list(found.reasons),
            }
        )
    else:
        console = Console()
        console.print(answer_tables.identification_table(found))
        console.print(answer_tables.identification_note(found), highlight=False)
    raise typer.Exit(1 if found.reasons else 0)


@app.command()
def robots() -> None:
    """List the robots of the catalogue and the materials of cables."""
    console = Console()
    table = Table(
        "robot", "mobility", "cables", "mass", "what", title="Robots", title_justify="left", box=box.SIMPLE_HEAD
    )
    for name in cdpr.list_robots():
        robot = cdpr.load_robot(name)
        table.add_row(name, robot.mobility, str(robot.cables), f"{robot.mass:g} kg", robot.description)
    console.print(table)
    table = Table("material", "EA", "source", title="Cables", title_justify="left", box=box.SIMPLE_HEAD)
    for material in cdpr.MATERIALS.values():
        table.add_row(material.name, f"{material.axial_stiffness:g} N", material.source)
    console.print(table)


@app.command()
def models(
    robot: Annotated[
        list[str] | None, typer.Argument(metavar="[ROBOT]...", help="Default: the whole catalogue.")
    ] = None,
    output: Annotated[Path, typer.Option("-o", "--output", help="Folder to write <robot>/ into.")] = Path("models"),
    pose: Pose = None,
    material: MaterialName = None,
    check: Annotated[bool, typer.Option("--check", help="Write nothing; exit status 1 if a file is stale.")] = False,
    force: Annotated[bool, typer.Option("--force", help="Replace files that differ.")] = False,
) -> None:
    """Write each robot as a MuJoCo model: robot.xml, scene.xml and a README."""
    stale = []
    with _errors_as_sentences():
        for name in robot or cdpr.list_robots():
            problem = _problem(name, pose, material)
            folder, files = output / problem.robot.name, model_folders.model_files(problem.robot, problem.pose)
            if check:
                stale += [folder / file for file in model_folders.stale_models(folder, files)]
            else:
                model_folders.write_models(folder, files, force=force)
                typer.echo(f"{folder}: {', '.join(files)}")
    for path in stale:
        typer.echo(f"{path}: stale, expected what `cdpr-sim models --force` writes", err=True)
    raise typer.Exit(1 if stale else 0)


def _problem(name: str, pose: tuple[float, float, float] | None, material: str | None) -> cdpr.Problem:
    robot = cdpr.load_robot(name)
    if material is not None:
        robot = robot.replace(material=material)
    return cdpr.Problem.of(robot, robot.home if pose is None else pose)


def _outcome(problem: cdpr.Problem, method: str) -> report.Outcome:
    try:
        return cdpr.solve(problem.robot, problem.pose, method=method)  # type: ignore[arg-type]
    except cdpr.NotConverged as failure:
        return failure


@contextmanager
def _errors_as_sentences() -> Iterator[None]:
    """No traceback for a user's mistake: one sentence on standard error, exit status 2."""
    try:
        yield
    except cdpr.CdprError as error:
        typer.echo(f"cdpr-sim: {error}", err=True)
        raise typer.Exit(2) from None


def _busy(what: str):
    return Console(stderr=True).status(f"{what} ...")


def _print_json(value: dict) -> None:
    typer.echo(json.dumps(value, indent=2))

"""The command line: where does the platform end up, and do the two roads agree?"""

from __future__ import annotations

import itertools
import json
import math
import signal
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from rich import box
from rich.console import Console
from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeRemainingColumn
from rich.table import Table

import cdpr_sim as cdpr
from cdpr_sim.report import answers as answer_tables, workspaces as overview, settling as report
from cdpr_sim.analysis.workspace import grids
from cdpr_sim.drawing import maps, pictures
from cdpr_sim.physics import model_files as model_folders
from cdpr_sim.drawing.video import film

app = typer.Typer(
    help="Where does the platform of a cable-driven parallel robot really end up? Statics and MuJoCo, cross-checked.",
    no_args_is_help=True,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
    add_completion=False,
)

COMPENSATED_WAYPOINTS = 61
"""Along a line that is filmed with compensated lengths; in between, their corrections change evenly."""

METHODS = {"Newton": "newton", "SEECR\nfsolve": "fsolve", "SEECR\nleast_sq.": "least_squares"}

RobotName = Annotated[
    str, typer.Argument(metavar="ROBOT", help="A name that `cdpr-sim robots` lists, or a .toml file.")
]
Pose = Annotated[
    tuple[float, float, float] | None,
    typer.Option("--pose", metavar="X Y Z", help="Commanded position [m]; default: the middle of the workspace."),
]
MaterialName = Annotated[str | None, typer.Option("--material", help="Cables: vectran-0.7mm or fishing-0.4mm.")]
RobotNames = Annotated[
    list[str], typer.Argument(metavar="ROBOT...", help="Names that `cdpr-sim robots` lists, or .toml files.")
]
Grid = Annotated[
    tuple[int, int, int] | None,
    typer.Option("--grid", metavar="NX NY NZ", help="Poses along x, y and z of the workspace; default: 40 25 10."),
]
MaterialNames = Annotated[list[str] | None, typer.Option("--material", help="Cables; give it again for several.")]
Limits = Annotated[
    tuple[float, float],
    typer.Option("--limits", metavar="MIN MAX", help="Smallest and largest tension [N] that is feasible."),
]
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


@app.command()
def figures(
    name: Annotated[list[str] | None, typer.Argument(metavar="[NAME]...", help="Default: all of them.")] = None,
    output: Annotated[Path, typer.Option("-o", "--output", help="Folder to write <name>.svg and .png into.")] = Path(
        "figures"
    ),
    force: Annotated[bool, typer.Option("--force", help="Replace files that are there.")] = False,
    names: Annotated[bool, typer.Option("--list", help="List the figures and what they show; draw none.")] = False,
) -> None:
    """Redraw the paper's figures, MuJoCo's points on the static solver's lines, and two figures of our own."""
    if names:
        table = Table("figure", "paper", "what it shows", box=box.SIMPLE_HEAD)
        for one, picture in cdpr.PICTURES.items():
            table.add_row(one, picture.paper, picture.shows)
        Console().print(table)
        return
    with _errors_as_sentences():
        written = cdpr.write_figures(name or cdpr.list_figures(), output, force=force)
        with _busy("Computing and drawing, half a minute for all (the first run on a machine compiles as long)"):
            for _, paths in written:
                typer.echo("\n".join(map(str, paths)))


@app.command()
def sweep(
    robot: RobotNames,
    grid: Grid = None,
    material: MaterialNames = None,
    output: Annotated[
        Path | None,
        typer.Option(
            "-o", "--output", help="Keep the result: a new .nc file, or a .zarr folder, which is gone on with."
        ),
    ] = None,
    limits: Limits = (0.0, float("inf")),
) -> None:
    """Solve for the static equilibrium over whole workspaces: tilt, deviation, slack cables, feasibility."""
    with _errors_as_sentences():
        dataset = cdpr.sweep(robot, grid, material or None, tension_limits=limits, store=output, progress=True)
        Console().print(overview.sweep_table(dataset))


@app.command("map")
def draw_map(
    robot: RobotNames,
    output: Annotated[Path, typer.Option("-o", "--output", help="Picture to write: .png, .svg or .pdf.")] = Path(
        "map.png"
    ),
    material: MaterialNames = None,
    plane: Annotated[str, typer.Option("--plane", help="xz, xy or yz.")] = "xz",
    at: Annotated[float | None, typer.Option("--at", help="Where [m] the plane lies; default: the middle.")] = None,
    points: Annotated[int, typer.Option("--points", help="Poses along the longer side.")] = 181,
    limits: Limits = (0.0, float("inf")),
    force: Annotated[bool, typer.Option("--force", help="Replace a picture that exists.")] = False,
) -> None:
    """Draw tilt, deviation, slack cables and feasibility over a plane of the workspace, side by side."""
    with _errors_as_sentences():
        pictures.check_target(output, force=force)
        robots = [cdpr.load_robot(name) for name in robot]
        section = grids.plane(plane, at, points, robots)
        dataset = cdpr.sweep(robots, section, material or None, tension_limits=limits, progress=True)
        pictures.write(maps.draw_elastic_map(dataset), output)
        Console().print(overview.sweep_table(dataset))
    typer.echo(output)


@app.command()
def check(
    robot: RobotNames,
    grid: Grid = None,
    material: MaterialNames = None,
    output: Annotated[
        Path | None, typer.Option("-o", "--output", help="Picture of where they agree, seen along y.")
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Replace a picture that exists.")] = False,
) -> None:
    """Settle every pose of a grid in MuJoCo and compare each with the solver. Exit status 1 if any disagrees."""
    with _errors_as_sentences():
        if output is not None:
            pictures.check_target(output, force=force)
        result = cdpr.check(robot, grid, material or None, progress=True)
        if output is not None:
            pictures.write(maps.draw_agreement_map(result.across()), output)
    console = Console()
    console.print(overview.check_table(result))
    for line in overview.check_lines(result):
        console.print(line, highlight=False)
    raise typer.Exit(0 if result.agrees else 1)


@app.command()
def video(
    robots: Annotated[list[str], typer.Argument(metavar="ROBOT...", help="One, or several side by side in step.")],
    path: Annotated[
        tuple[float, float] | None,
        typer.Option("--path", metavar="X0 X1", help="Drive from x = X0 to x = X1 [m]; default: across the workspace."),
    ] = None,
    y: Annotated[float | None, typer.Option("--y", help="Of the path [m]; default: the workspace's middle.")] = None,
    z: Annotated[float | None, typer.Option("--z", help="Of the path [m]; default: the workspace's middle.")] = None,
    drop: Annotated[
        bool, typer.Option("--drop", help="No drive: let the platform go at X0, or the workspace's middle.")
    ] = False,
    material: Annotated[
        list[str] | None, typer.Option("--material", help="Cables; given again, materials are shown side by side.")
    ] = None,
    drive_seconds: Annotated[
        float | None, typer.Option("--drive-seconds", help="Duration of the drive; default: nearly static.")
    ] = None,
    seconds: Annotated[float, typer.Option("--seconds", help="Duration of the video.")] = 10.0,
    fps: Annotated[float, typer.Option("--fps", help="Frames per second.")] = 30.0,
    size: Annotated[tuple[int, int], typer.Option("--size", metavar="WIDTH HEIGHT", help="[pixel]")] = (1280, 720),
    compensate: Annotated[
        bool, typer.Option("--compensate", help="Beside each, the same with compensated cable lengths.")
    ] = False,
    exaggerate: Annotated[
        float, typer.Option("--exaggerate", help="Draw deviations this many times as large, and say so.")
    ] = 1.0,
    renderer: Annotated[str, typer.Option("--renderer", help="auto, opengl or raycast (no OpenGL needed).")] = "auto",
    output: Annotated[Path, typer.Option("-o", "--output", help="File: .mp4 or .gif.")] = Path("video.mp4"),
    force: Annotated[bool, typer.Option("--force", help="Replace the file if it exists.")] = False,
) -> None:
    """Film platforms driven along a line by their winches, in MuJoCo, with the static solver's pose as an outline."""
    with _errors_as_sentences(), _tidy_when_terminated(), _progress() as progress:
        film.check_output(output, force=force)
        frames = film.check_settings(seconds, fps, size, exaggerate, renderer)
        shown = []
        for name, cables, cut in itertools.product(
            robots, material or [None], (False, True) if compensate else (False,)
        ):
            robot = _robot(name, cables)
            waypoints = _line(robot, path, y, z)[: 1 if drop else None]
            lengths = None
            if cut:
                waypoints = np.linspace(waypoints[0], waypoints[-1], 1 if drop else COMPENSATED_WAYPOINTS)
                tracked = progress.track(waypoints, description=f"Compensating {robot.name}")
                lengths = [cdpr.compensate(robot, waypoint).rest_lengths for waypoint in tracked]
                robot = robot.replace(name=f"{robot.name}, compensated")
            task = progress.add_task(f"MuJoCo drives {robot.name}", total=1.0)
            trajectory = cdpr.drive(
                robot,
                waypoints,
                seconds=drive_seconds,
                states=frames,
                from_rest=not drop,
                rest_lengths=lengths,
                progress=lambda done, task=task: progress.update(task, completed=done),
            )
            shown.append((trajectory, cdpr.solve_trajectory(trajectory).poses))
        task = progress.add_task("Drawing", total=frames)
        cdpr.write_video(
            output,
            [trajectory for trajectory, _ in shown],
            [static for _, static in shown],
            seconds=seconds,
            fps=fps,
            size=size,
            exaggeration=exaggerate,
            renderer=renderer,  # type: ignore[arg-type]
            force=force,
            progress=lambda done, total: progress.update(task, completed=done),
        )
    typer.echo(output)


def _line(
    robot: cdpr.Robot, path: tuple[float, float] | None, y: float | None, z: float | None
) -> list[tuple[float, float, float]]:
    """The two ends of a path along x."""
    home = robot.home
    x0, x1 = robot.workspace[:, 0] if path is None else path
    return [(x, home[1] if y is None else y, home[2] if z is None else z) for x in (x0, x1)]


def _problem(name: str, pose: tuple[float, float, float] | None, material: str | None) -> cdpr.Problem:
    robot = _robot(name, material)
    return cdpr.Problem.of(robot, robot.home if pose is None else pose)


def _robot(name: str, material: str | None) -> cdpr.Robot:
    robot = cdpr.load_robot(name)
    return robot if material is None else robot.replace(material=material)


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


@contextmanager
def _tidy_when_terminated() -> Iterator[None]:
    """A terminated process cleans up as an interrupted one does."""
    previous = signal.signal(signal.SIGTERM, lambda *_: sys.exit(128 + signal.SIGTERM))
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, previous)


def _busy(what: str):
    return Console(stderr=True).status(f"{what} ...")


def _progress() -> Progress:
    """A bar per task, on standard error, where a terminal can show it."""
    console = Console(stderr=True)
    columns = TextColumn("{task.description}"), BarColumn(), TaskProgressColumn(), TimeRemainingColumn()
    return Progress(*columns, console=console, disable=not console.is_terminal)


def _print_json(value: dict) -> None:
    typer.echo(json.dumps(value, indent=2))

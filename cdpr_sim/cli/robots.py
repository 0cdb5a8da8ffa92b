"""Commands about the robots themselves: robots, import, models."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

import cdpr_sim as cdpr
from cdpr_sim.cli.options import MaterialName, Pose, problem_of
from cdpr_sim.cli.terminal import DISAGREE, Output, errors_as_sentences
from cdpr_sim.core.files import check_place, write_whole
from cdpr_sim.physics.model_files import model_files, stale_models, write_models
from cdpr_sim.report.tables import new_table
from cdpr_sim.robots.importing import FORMATS
from cdpr_sim.robots.writing import as_toml


def robots() -> None:
    """List the robots of the catalogue and the materials of cables."""
    console = Output()
    table = new_table("Robots", "robot", "mobility", "cables", "mass", words=2)
    table.add_column("what")
    for name in cdpr.list_robots():
        robot = cdpr.load_robot(name)
        table.add_row(name, robot.mobility, str(robot.cables), f"{robot.mass:g} kg", robot.description)
    console.print(table)
    table = new_table("Cables", "material", "EA")
    table.add_column("source")
    for material in cdpr.MATERIALS.values():
        table.add_row(material.name, f"{material.axial_stiffness:g} N", material.source)
    console.print(table)


def import_file(
    file: Annotated[
        Path, typer.Argument(metavar="FILE", help=f"Of {', '.join(one.title for one in FORMATS.values())}.")
    ],
    output: Annotated[
        Path | None, typer.Option("-o", "--output", help="Robot file to write; default: the robot's name, with .toml.")
    ] = None,
    format: Annotated[
        str | None, typer.Option("--format", help=f"{', '.join(FORMATS)}; default: what the file looks like.")
    ] = None,
    cables: Annotated[str | None, typer.Option("--cables", help="CASPR's id of a set of cables.")] = None,
    force: Annotated[bool, typer.Option("--force", help="Replace the file if it exists.")] = False,
) -> None:
    """Write another project's robot as a robot file, and say what it left out or assumed."""
    with errors_as_sentences():
        robot = cdpr.import_robot(file, format, cables)
        place = check_place(output or Path(f"{robot.name}.toml"), [".toml"], force=force)
        write_whole({place: as_toml(robot).encode()})
    typer.echo(f"{place}: {robot.name}, {robot.mobility}, {robot.cables} cables, {robot.mass:g} kg")
    for note in robot.notes:
        typer.echo(f"- {note}")


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
    with errors_as_sentences():
        for name in robot or cdpr.list_robots():
            problem = problem_of(name, pose, material)
            folder, files = output / problem.robot.name, model_files(problem.robot, problem.pose)
            if check:
                stale += [folder / file for file in stale_models(folder, files)]
            else:
                write_models(folder, files, force=force)
                typer.echo(f"{folder}: {', '.join(files)}")
    for path in stale:
        typer.echo(f"{path}: stale, expected what `cdpr-sim models --force` writes", err=True)
    raise typer.Exit(DISAGREE if stale else 0)

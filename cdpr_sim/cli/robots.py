"""Commands about the robots themselves: robots, new, schema, show, models."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

import cdpr_sim as cdpr
from cdpr_sim.cli.options import MaterialName, Pose, RobotName, problem_of
from cdpr_sim.cli.terminal import DISAGREE, Output, errors_as_sentences
from cdpr_sim.core.files import check_place, write_whole
from cdpr_sim.physics.model_files import model_files, stale_models, write_models
from cdpr_sim.report.tables import new_table
from cdpr_sim.robots import robot_file


def robots() -> None:
    """List the robots of the catalogue and the materials of cables."""
    console = Output()
    table = new_table("Robots", "robot", "mobility", "cables", "mass", words=2)
    table.add_column("what")
    for name in cdpr.list_robots():
        robot = cdpr.load_robot(name)
        table.add_row(name, robot.mobility, str(robot.cables), f"{robot.mass:g} kg", robot.description)
    console.print(table)
    table = new_table("Cables of one size", "material", "EA")
    table.add_column("source")
    for material in cdpr.MATERIALS.values():
        table.add_row(material.name, f"{material.axial_stiffness:g} N", material.source)
    console.print(table)
    table = new_table("Ropes of any diameter: steel-rope-4mm", "material", "modulus", "fill", "density")
    table.add_column("source")
    for rope in cdpr.ROPES.values():
        table.add_row(
            rope.name, f"{rope.modulus / 1e9:g} GPa", f"{rope.fill:g}", f"{rope.density:g} kg/m³", rope.source
        )
    console.print(table)


def new(
    name: Annotated[str, typer.Argument(metavar="NAME", help="Of the robot; NAME.toml is the file, in this folder.")],
    force: Annotated[bool, typer.Option("--force", help="Replace the file if it exists.")] = False,
) -> None:
    """Write a robot file to begin with, with comments, that runs as it is."""
    with errors_as_sentences():
        path = Path(name if name.endswith(".toml") else f"{name}.toml")
        text = robot_file.template(path.stem)
        write_whole({check_place(path, [".toml"], force=force): text.encode()})
    typer.echo(f"{path}: now `cdpr-sim show {path}` and `cdpr-sim settle {path}`")


def schema(
    document: Annotated[bool, typer.Option("--document", help="Print the page that explains robot files.")] = False,
) -> None:
    """Print the JSON schema of robot files, with which editors check and complete them."""
    typer.echo(robot_file.document() if document else robot_file.json_schema(), nl=not document)


def show(
    robot: RobotName,
    output: Annotated[Path, typer.Option("-o", "--output", help="File: .png.")] = Path("robot.png"),
    pose: Pose = None,
    material: MaterialName = None,
    force: Annotated[bool, typer.Option("--force", help="Replace the file if it exists.")] = False,
) -> None:
    """Draw a robot as commanded, with the numbers of its cables at exits and anchors."""
    with errors_as_sentences():
        problem = problem_of(robot, pose, material)
        check_place(output, [".png"], force=force)
        from cdpr_sim.drawing.still import draw, encoded

        write_whole({output: encoded(draw(problem.robot, problem.pose))})
    typer.echo(output)


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

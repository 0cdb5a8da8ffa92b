"""Commands about the robots themselves: robots, models, view."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

import cdpr_sim as cdpr
from cdpr_sim.cli.options import MaterialName, Pose, RobotName, problem_of
from cdpr_sim.cli.terminal import DISAGREE, Output, errors_as_sentences
from cdpr_sim.physics.look import look
from cdpr_sim.physics.model_files import model_files, stale_models, write_models
from cdpr_sim.report.tables import new_table


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


def models(
    robot: Annotated[
        list[str] | None, typer.Argument(metavar="[ROBOT]...", help="Default: the whole catalogue.")
    ] = None,
    output: Annotated[Path, typer.Option("-o", "--output", help="Folder to write <robot>/ into.")] = Path("models"),
    pose: Pose = None,
    material: MaterialName = None,
    winches: Annotated[
        bool, typer.Option("--winches", help="Add winch.xml, whose actuators wind the cables, and how to use it.")
    ] = False,
    check: Annotated[bool, typer.Option("--check", help="Write nothing; exit status 1 if a file is stale.")] = False,
    force: Annotated[bool, typer.Option("--force", help="Replace files that differ.")] = False,
) -> None:
    """Write each robot as a MuJoCo model: robot.xml, scene.xml and a README."""
    stale = []
    with errors_as_sentences():
        for name in robot or cdpr.list_robots():
            problem = problem_of(name, pose, material)
            folder, files = output / problem.robot.name, model_files(problem.robot, problem.pose, winches=winches)
            if check:
                stale += [folder / file for file in stale_models(folder, files)]
            else:
                write_models(folder, files, force=force)
                typer.echo(f"{folder}: {', '.join(files)}")
    command = "cdpr-sim models --winches --force" if winches else "cdpr-sim models --force"
    for path in stale:
        typer.echo(f"{path}: stale, expected what `{command}` writes", err=True)
    raise typer.Exit(DISAGREE if stale else 0)


def view(robot: RobotName, pose: Pose = None, material: MaterialName = None) -> None:
    """Open MuJoCo's viewer on the robot, with a slider for each winch.

    The sliders' 0 is the length at the commanded pose; to the right the cable is wound in.
    """
    with errors_as_sentences():
        look(problem_of(robot, pose, material))

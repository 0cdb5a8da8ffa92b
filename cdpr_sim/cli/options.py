"""Arguments and options that several commands have, and the robot and the problem that they describe."""

from __future__ import annotations

from typing import Annotated

import typer

import cdpr_sim as cdpr

RobotName = Annotated[
    str, typer.Argument(metavar="ROBOT", help="A name that `cdpr-sim robots` lists, or a .toml file.")
]
RobotNames = Annotated[
    list[str], typer.Argument(metavar="ROBOT...", help="Names that `cdpr-sim robots` lists, or .toml files.")
]
Pose = Annotated[
    tuple[float, float, float] | None,
    typer.Option("--pose", metavar="X Y Z", help="Commanded position [m]; default: the middle of the workspace."),
]
MaterialName = Annotated[
    str | None, typer.Option("--material", help="Cables: vectran-0.7mm, dyneema-2mm, ...; see robots.")
]
MaterialNames = Annotated[list[str] | None, typer.Option("--material", help="Cables; give it again for several.")]
Grid = Annotated[
    tuple[int, int, int] | None,
    typer.Option("--grid", metavar="NX NY NZ", help="Poses along x, y and z of the workspace; default: 40 25 10."),
]
Limits = Annotated[
    tuple[float, float],
    typer.Option("--limits", metavar="MIN MAX", help="Smallest and largest tension [N] that is feasible."),
]
AsJson = Annotated[bool, typer.Option("--json", help="Print JSON, in SI units, instead of a table.")]


def robot_of(name: str, material: str | None) -> cdpr.Robot:
    """The robot called ``name``, on its own cables or on others.

    Raises:
        CdprError: no such robot or material.
    """
    robot = cdpr.load_robot(name)
    return robot if material is None else robot.replace(material=material)


def problem_of(name: str, pose: tuple[float, float, float] | None, material: str | None) -> cdpr.Problem:
    """The robot called ``name``, commanded to ``pose``.

    Raises:
        CdprError: no such robot or material, or a pose that it cannot take.
    """
    robot = robot_of(name, material)
    return cdpr.Problem.of(robot, robot.home if pose is None else pose)

"""Arguments and options that several commands have, and the robot and the problem that they describe."""

from __future__ import annotations

from typing import Annotated

import typer

import cdpr_sim as cdpr

RobotName = Annotated[
    str,
    typer.Argument(metavar="ROBOT", help="A name that `cdpr-sim robots` lists, a .toml file, or another project's."),
]
RobotNames = Annotated[
    list[str],
    typer.Argument(metavar="ROBOT...", help="Names that `cdpr-sim robots` lists, .toml files, or other projects'."),
]
Pose = Annotated[
    tuple[float, float, float] | None,
    typer.Option("--pose", metavar="X Y Z", help="Commanded position [m]; default: the middle of the workspace."),
]
MaterialName = Annotated[
    str | None, typer.Option("--material", help="Cables: vectran-0.7mm, dyneema-2mm, ...; see robots.")
]
Pretension = Annotated[
    float | None,
    typer.Option(
        "--pretension", help="[N] Cables as long as have tensions nearest to this at the pose; default: rigid lengths."
    ),
]
MaterialNames = Annotated[list[str] | None, typer.Option("--material", help="Cables; give it again for several.")]
Grid = Annotated[
    tuple[int, int, int] | None,
    typer.Option("--grid", metavar="NX NY NZ", help="Poses along x, y and z of the workspace; default: 40 25 10."),
]
Limits = Annotated[
    tuple[float, float] | None,
    typer.Option(
        "--limits", metavar="MIN MAX", help="Smallest and largest tension [N] that is feasible; default: the robot's."
    ),
]
Wrenches = Annotated[
    list[str] | None,
    typer.Option(
        "--wrench", metavar="FX,FY,FZ,TX,TY,TZ", help="[N, N m] to be held as well; give it again for a set of them."
    ),
]
AsJson = Annotated[bool, typer.Option("--json", help="Print JSON, in SI units, instead of a table.")]


def wrenches_of(words: list[str] | None) -> list[list[float]] | None:
    """External wrenches as the command line gives them, six numbers with commas each.

    Raises:
        InvalidInput: something else.
    """
    wrenches = []
    for word in words or []:
        try:
            numbers = [float(part) for part in word.split(",")]
        except ValueError:
            numbers = []
        if len(numbers) != 6:
            raise cdpr.InvalidInput(f"--wrench: found {word!r}, expected six numbers FX,FY,FZ,TX,TY,TZ [N, N m]")
        wrenches.append(numbers)
    return wrenches or None


def robot_of(name: str, material: str | None) -> cdpr.Robot:
    """The robot called ``name``, on its own cables or on others; what its import assumed, on standard error.

    Raises:
        CdprError: no such robot or material.
    """
    robot = cdpr.load_robot(name)
    for note in robot.notes:
        typer.echo(f"cdpr-sim: note: {note}", err=True)
    return robot if material is None else robot.replace(material=material)


def problem_of(
    name: str, pose: tuple[float, float, float] | None, material: str | None, pretension: float | None = None
) -> cdpr.Problem:
    """The robot called ``name``, commanded to ``pose``, on rigid lengths or on those for a pretension [N] there.

    Raises:
        CdprError: no such robot or material, a pose that it cannot take, or a pretension that does not balance it.
    """
    robot = robot_of(name, material)
    pose = tuple(robot.home) if pose is None else pose
    return cdpr.Problem.of(robot, pose, None if pretension is None else robot.rest_lengths(pose, pretension))

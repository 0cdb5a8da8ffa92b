"""Arguments and options shared by several commands, and the robot and problem that they describe."""

from __future__ import annotations

from typing import Annotated

import typer

import cdpr_sim as cdpr

RobotName = Annotated[
    str,
    typer.Argument(
        metavar="ROBOT", help="A name listed by `cdpr-sim robots`, a .toml file, or a file of another project."
    ),
]
RobotNames = Annotated[
    list[str],
    typer.Argument(
        metavar="ROBOT...", help="Names listed by `cdpr-sim robots`, .toml files, or files of other projects."
    ),
]
Pose = Annotated[
    tuple[float, float, float] | None,
    typer.Option("--pose", metavar="X Y Z", help="Commanded position [m]; default: the middle of the workspace."),
]
MaterialName = Annotated[
    str | None,
    typer.Option("--material", help="Cable material: vectran-0.7mm, dyneema-2mm, ...; see `cdpr-sim robots`."),
]
Pretension = Annotated[
    float | None,
    typer.Option(
        "--pretension",
        help="[N] Rest lengths whose tensions at the pose are closest to this value; default: rigid lengths.",
    ),
]
MaterialNames = Annotated[list[str] | None, typer.Option("--material", help="Cable material; repeatable.")]
Grid = Annotated[
    tuple[int, int, int] | None,
    typer.Option(
        "--grid", metavar="NX NY NZ", help="Number of poses along x, y and z of the workspace; default: 40 25 10."
    ),
]
Limits = Annotated[
    tuple[float, float] | None,
    typer.Option("--limits", metavar="MIN MAX", help="Tension limits [N] of feasibility; default: the robot's."),
]
Wrenches = Annotated[
    list[str] | None,
    typer.Option(
        "--wrench", metavar="FX,FY,FZ,TX,TY,TZ", help="[N, N m] External wrench to be balanced as well; repeatable."
    ),
]
AsJson = Annotated[bool, typer.Option("--json", help="Print JSON, in SI units, instead of a table.")]


def wrenches_of(words: list[str] | None) -> list[list[float]] | None:
    """Parse external wrenches, six comma-separated numbers each.

    Raises:
        InvalidInput: not six numbers.
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
    """Load the robot ``name``, with other cables if ``material`` is given; print its import notes on standard error.

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
    """Problem of the robot ``name`` at ``pose``, with rigid lengths or with those for a pretension [N] at that pose.

    Raises:
        CdprError: no such robot or material, an invalid pose, or a pretension that does not balance the platform.
    """
    robot = robot_of(name, material)
    pose = tuple(robot.home) if pose is None else pose
    return cdpr.Problem.of(robot, pose, None if pretension is None else robot.rest_lengths(pose, pretension))

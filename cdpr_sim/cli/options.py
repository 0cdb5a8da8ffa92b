"""Arguments and options shared by several commands, and the robot and problem that they describe."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Annotated

import typer

import cdpr_sim as cdpr
from cdpr_sim.cli.command_classes import numbers_in

if TYPE_CHECKING:
    from scipy.spatial.transform import RigidTransform

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
    str | None,
    typer.Option(
        "--pose",
        metavar="X Y Z [ALPHA BETA GAMMA]",
        help="Commanded position [m], and orientation Rz(gamma) Ry(beta) Rx(alpha) [rad]; default: level in the middle "
        "of the workspace.",
    ),
]
Orientation = Annotated[
    tuple[float, float, float],
    typer.Option("--orientation", metavar="ALPHA BETA GAMMA", help="Commanded orientation [rad]."),
]
Waypoints = Annotated[
    list[str] | None,
    typer.Option(
        "--waypoint",
        metavar="X Y Z [ALPHA BETA GAMMA]",
        help="Pose on a path of straight lines [m, rad]; repeatable, at least twice.",
    ),
]
PathPoints = Annotated[
    int, typer.Option("--path-points", help="Number of poses along the path of --waypoint, at equal distances.")
]
MOST_PATH_POINTS = 100_000
"""Largest number of poses along a path."""

Mass = Annotated[
    float | None, typer.Option("--mass", help="[kg] Mass of the platform, with its load; default: the robot's.")
]
Wrench = Annotated[
    str | None,
    typer.Option("--wrench", metavar="FX,FY,FZ,TX,TY,TZ", help="[N, N m] External wrench at the platform's origin."),
]
MaterialName = Annotated[
    str | None,
    typer.Option("--material", help="Cable material: vectran-0.7mm, dyneema-2mm, ...; see `cdpr-sim robots`."),
]
Pretension = Annotated[
    float | None,
    typer.Option(
        "--pretension",
        help="[N] Rest lengths whose tensions balance the weight at the commanded pose and are closest to this value; "
        "default: the robot's, or else rigid lengths. --wrench then moves the platform.",
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
    typer.Option(
        "--tension-limits", metavar="MIN MAX", help="Tension limits [N] of feasibility; default: the robot's."
    ),
]
Wrenches = Annotated[
    list[str] | None,
    typer.Option(
        "--wrenches",
        metavar="FX,FY,FZ,TX,TY,TZ",
        help="[N, N m] External wrench of the wrench-feasible workspace, besides --wrench; repeatable.",
    ),
]
Details = Annotated[bool, typer.Option("--all", help="Print all methods and all details.")]
AsJson = Annotated[bool, typer.Option("--json", help="Print JSON, in SI units, instead of a table.")]


def _numbers(option: str, word: str, counts: Sequence[int], expected: str) -> list[float]:
    """Parse comma-separated numbers.

    Raises:
        InvalidInput: not as many numbers as one of ``counts``.
    """
    numbers = numbers_in(word)
    if len(numbers) not in counts:
        raise cdpr.InvalidInput(f"{option}: found {word!r}, expected {expected}")
    return numbers


def wrench_of(word: str | None, option: str = "--wrench") -> list[float] | None:
    """Parse an external wrench."""
    return None if word is None else _numbers(option, word, [6], "six numbers FX,FY,FZ,TX,TY,TZ [N, N m]")


def wrenches_of(words: list[str] | None) -> list[list[float]] | None:
    """Parse the external wrenches of ``--wrenches``; None without any."""
    return [wrench_of(word, "--wrenches") or [] for word in words or []] or None


def pose_of(word: str | None, option: str = "--pose") -> tuple[float, ...] | None:
    """Parse a pose of three or six numbers."""
    expected = "three numbers X Y Z [m], or six, X Y Z ALPHA BETA GAMMA [m, rad]"
    return None if word is None else tuple(_numbers(option, word.strip(", "), [3, 6], expected))


def waypoints_of(words: list[str] | None) -> list[tuple[float, ...]]:
    """Parse ``--waypoint``; none without that option.

    Raises:
        InvalidInput: not poses, or a single one.
    """
    poses = [pose_of(word, "--waypoint") or () for word in words or []]
    if len(poses) == 1:
        raise cdpr.InvalidInput("--waypoint: found a single one, expected at least two")
    return poses


def along(robot: cdpr.Robot, waypoints: Sequence[tuple[float, ...]], count: int) -> RigidTransform:
    """Poses along straight lines through waypoints, at equal distances.

    Raises:
        InvalidInput: invalid waypoints, or a number of poses that is not from 1 to ``MOST_PATH_POINTS``.
    """
    from cdpr_sim.core.pose_path import PosePath

    if not 1 <= count <= MOST_PATH_POINTS:
        raise cdpr.InvalidInput(f"--path-points: found {count}, expected from 1 to {MOST_PATH_POINTS}")
    return PosePath(robot, [robot.pose(waypoint) for waypoint in waypoints]).evenly(count)


def stops(robot: cdpr.Robot, waypoints: Sequence[tuple[float, ...]]) -> list[tuple[float, str]]:
    """The fraction of the path at which each waypoint lies, and its position as text; for ``along``'s waypoints."""
    from cdpr_sim.core.pose_path import PosePath

    path = PosePath(robot, [robot.pose(waypoint) for waypoint in waypoints])
    names = [", ".join(f"{number:g}" for number in position) for position in path.positions]
    return [(float(at / (path.length or 1.0)), name) for at, name in zip(path.along, names, strict=True)]


def robot_of(
    name: str, material: str | None = None, mass: float | None = None, pretension: float | None = None
) -> cdpr.Robot:
    """Load the robot ``name``, with other cables, another mass [kg] or a pretension [N] if given; notes are printed.

    Notes are those of an import, and which numbers of the cables another material does not change.

    Raises:
        CdprError: no such robot or material, or an invalid mass or pretension.
    """
    robot = cdpr.load_robot(name)
    for note in robot.notes:
        typer.echo(f"cdpr-sim: note: {note}", err=True)
    changes = {"material": material, "mass": mass, "pretension": pretension}
    changes = {field: value for field, value in changes.items() if value is not None}
    if not changes:
        return robot
    changed = robot.replace(**changes)
    if material is not None:
        note_numbers_by_hand(changed, material)
    return changed


def robots_of(
    names: Sequence[str], materials: Sequence[str] | None, mass: float | None, pretension: float | None
) -> list[cdpr.Robot]:
    """Load robots whose cables a sweep replaces by each of ``materials``; notes as in ``robot_of``."""
    robots = [robot_of(name, None, mass, pretension) for name in names]
    for robot in robots:
        for material in materials or ():
            note_numbers_by_hand(robot.replace(material=material), material)
    return robots


def note_numbers_by_hand(robot: cdpr.Robot, material: str) -> None:
    """Print a note about numbers of the cables that were given by hand and so stay with another material."""
    from cdpr_sim.core.describe import numbers_by_hand

    kept = numbers_by_hand(robot)
    if kept:
        typer.echo(
            f"cdpr-sim: note: {robot.name}: given by hand, and not changed by --material {material}: {', '.join(kept)}",
            err=True,
        )


def problem_of(
    name: str,
    pose: str | None,
    material: str | None,
    pretension: float | None = None,
    mass: float | None = None,
    wrench: str | None = None,
) -> cdpr.Problem:
    """Problem of the robot ``name`` at ``pose``, with its rest lengths there.

    Raises:
        CdprError: no such robot or material, an invalid mass, pose or wrench, or a pretension that does not balance the
            platform.
    """
    robot, load = robot_of(name, material, mass, pretension), wrench_of(wrench)
    return cdpr.Problem.of(robot, pose_of(pose) or tuple(robot.home), external_wrench=load)

"""Commands that write videos and pages: video, report."""

from __future__ import annotations

import itertools
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import CancelledError, ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated

import typer

import cdpr_sim as cdpr
from cdpr_sim.cli.options import (
    Mass,
    MaterialName,
    Pose,
    Pretension,
    RobotName,
    Waypoints,
    Wrench,
    along,
    pose_of,
    robot_of,
    waypoints_of,
    wrench_of,
)
from cdpr_sim.cli.terminal import busy, progress_bars, tidy_when_terminated

COMPENSATED_WAYPOINTS = 61
"""Waypoints of a video with compensated lengths; between them the corrections are interpolated linearly."""


def video(
    robots: Annotated[
        list[str], typer.Argument(metavar="ROBOT...", help="One robot, or several side by side, synchronised.")
    ],
    path: Annotated[
        tuple[float, float] | None,
        typer.Option("--path", metavar="X0 X1", help="Drive from x = X0 to x = X1 [m]; default: across the workspace."),
    ] = None,
    y: Annotated[
        float | None, typer.Option("--y", help="y of the path [m]; default: the middle of the workspace.")
    ] = None,
    z: Annotated[
        float | None, typer.Option("--z", help="z of the path [m]; default: the middle of the workspace.")
    ] = None,
    waypoint: Waypoints = None,
    mass: Mass = None,
    pretension: Pretension = None,
    wrench: Wrench = None,
    drop: Annotated[
        bool,
        typer.Option(
            "--drop", help="Release the platform at X0, or at the middle of the workspace, instead of driving it."
        ),
    ] = False,
    material: Annotated[
        list[str] | None,
        typer.Option("--material", help="Cable material; repeatable: materials are shown side by side."),
    ] = None,
    drive_seconds: Annotated[
        float | None,
        typer.Option(
            "--drive-seconds",
            help="Duration of the drive [s]; default: quasi-static. By default, robots on cables with mass or a memory "
            "are settled state by state; with --compensate they are driven within the duration of the video.",
        ),
    ] = None,
    seconds: Annotated[float, typer.Option("--seconds", help="Duration of the video [s].")] = 10.0,
    fps: Annotated[float, typer.Option("--fps", help="Frames per second.")] = 30.0,
    size: Annotated[tuple[int, int], typer.Option("--size", metavar="WIDTH HEIGHT", help="Size [pixel].")] = (
        1280,
        720,
    ),
    compensate: Annotated[
        bool, typer.Option("--compensate", help="Show each robot with compensated cable lengths as well.")
    ] = False,
    exaggerate: Annotated[
        float, typer.Option("--exaggerate", help="Factor by which deviations are drawn larger; stated in the video.")
    ] = 1.0,
    renderer: Annotated[str, typer.Option("--renderer", help="auto, opengl or raycast (needs no OpenGL).")] = "auto",
    output: Annotated[Path, typer.Option("-o", "--output", help="File: .mp4 or .gif.")] = Path("video.mp4"),
    force: Annotated[bool, typer.Option("--force", help="Replace the file if it exists.")] = False,
) -> None:
    """Write a video of platforms that their winches drive along lines in MuJoCo, with the static solver's outline."""
    from cdpr_sim.crosscheck.compensation_check import held
    from cdpr_sim.drawing.video import writing
    from cdpr_sim.report.robot_summary import settled_along, write_both_methods

    with tidy_when_terminated(), progress_bars() as bar, _side_by_side() as start:
        writing.checked_file(output, force=force)
        states = writing.check_settings(seconds, fps, size, exaggerate, renderer)
        wanted = list(itertools.product(robots, material or [None], (False, True) if compensate else (False,)))
        writing.check_count(len(wanted))
        machines = [robot_of(name, cables, mass, pretension) for name, cables, _ in wanted]
        load, through = wrench_of(wrench), waypoints_of(waypoint)
        if through and not (path is None and y is None and z is None):
            raise cdpr.InvalidInput("--waypoint: found waypoints and --path, --y or --z, expected one of them")
        if compensate or drop or drive_seconds is not None:
            for robot in machines:
                robot.cabling.refuse_memory()
        motions: list[Callable[[], cdpr.Trajectory]] = []
        for robot, (_, _, compensated) in zip(machines, wanted, strict=True):
            slow = not robot.cabling.massless or robot.cabling.has_memory.any()
            quasi_static = slow and drive_seconds is None and not drop  # its drive would take long, or have no memory
            waypoints, lengths = (through or _line(robot, path, y, z))[: 1 if drop else None], None
            if quasi_static and not compensate:
                settled = settled_along(robot, along(robot, waypoints, states), seconds, load)
                motions.append(lambda settled=settled: settled)
                continue
            if compensated:
                waypoints = along(robot, waypoints, 1 if drop else COMPENSATED_WAYPOINTS)
                advance, lengths = bar(f"Compensating {robot.name}"), []
                for pose in waypoints:
                    lengths.append(held(cdpr.compensate(robot, pose, external_wrench=load)).rest_lengths)
                    advance(len(lengths) / len(waypoints))
                robot = robot.replace(name=f"{robot.name}, compensated")
            motions.append(
                start(
                    robot,
                    waypoints,
                    seconds=seconds if quasi_static else drive_seconds,
                    states=states,
                    from_rest=not drop,
                    rest_lengths=lengths,
                    external_wrench=load,
                    progress=bar(f"MuJoCo drives {robot.name}"),
                )
            )
        write_both_methods(
            output,
            [motion() for motion in motions],
            seconds=seconds,
            fps=fps,
            size=size,
            exaggeration=exaggerate,
            renderer=renderer,
            force=force,
            progress=bar("Drawing"),
        )
    typer.echo(output)


def report(
    robot: RobotName,
    output: Annotated[Path, typer.Option("-o", "--output", help="File: .html.")] = Path("report.html"),
    pose: Pose = None,
    material: MaterialName = None,
    pretension: Pretension = None,
    grid: Annotated[
        tuple[int, int, int] | None,
        typer.Option("--grid", metavar="NX NY NZ", help="Number of poses settled in MuJoCo; default: 7 5 4."),
    ] = None,
    video: Annotated[
        bool, typer.Option("--video/--no-video", help="Include a video of a drive across the workspace.")
    ] = True,
    force: Annotated[bool, typer.Option("--force", help="Replace the file if it exists.")] = False,
) -> None:
    """Write a self-contained HTML report: an interactive 3D view, the worst poses, maps, tables and a video.

    It opens in any browser, without network access.
    """
    with tidy_when_terminated(), busy("Loading") as status:
        cdpr.write_report(
            output,
            robot_of(robot, material, pretension=pretension),
            pose_of(pose),
            grid=grid,
            video=video,
            force=force,
            progress=lambda what: status.update(f"{what} ..."),
        )
    typer.echo(output)


@contextmanager
def _side_by_side() -> Iterator[Callable[..., Callable[[], cdpr.Trajectory]]]:
    """Run drives in parallel threads.

    The yielded function takes the arguments of ``cdpr.drive``, starts it in a thread, and returns a function that waits
    for the trajectory. An error or Ctrl-C ends all drives.
    """
    from cdpr_sim.drawing.video import writing

    over = threading.Event()

    def start(*arguments, progress: Callable[[float], None], **options) -> Callable[[], cdpr.Trajectory]:
        def advance(done: float) -> None:
            if over.is_set():
                raise CancelledError
            progress(done)

        return threads.submit(cdpr.drive, *arguments, progress=advance, **options).result

    with ThreadPoolExecutor(writing.MOST_ROBOTS) as threads:
        try:
            yield start
        except BaseException:
            over.set()
            threads.shutdown(cancel_futures=True)
            raise


def _line(
    robot: cdpr.Robot, path: tuple[float, float] | None, y: float | None, z: float | None
) -> list[tuple[float, float, float]]:
    """Both ends of a path along x."""
    home = robot.home
    x0, x1 = robot.workspace[:, 0] if path is None else path
    return [(x, home[1] if y is None else y, home[2] if z is None else z) for x in (x0, x1)]

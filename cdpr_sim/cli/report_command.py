"""The command that writes an HTML page: report."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

import cdpr_sim as cdpr
from cdpr_sim.cli.options import MaterialName, Pose, RobotName, pose_of, robot_of
from cdpr_sim.cli.terminal import busy, errors_as_sentences, tidy_when_terminated


def report(
    robot: RobotName,
    output: Annotated[Path, typer.Option("-o", "--output", help="File: .html.")] = Path("report.html"),
    pose: Pose = None,
    material: MaterialName = None,
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
    with errors_as_sentences(), tidy_when_terminated(), busy("Loading") as status:
        cdpr.write_report(
            output,
            robot_of(robot, material),
            pose_of(pose),
            grid=grid,
            video=video,
            force=force,
            progress=lambda what: status.update(f"{what} ..."),
        )
    typer.echo(output)

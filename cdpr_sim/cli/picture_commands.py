"""Commands that draw and film: figures, video."""

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
from cdpr_sim.cli.options import robot_of
from cdpr_sim.cli.terminal import Output, busy, errors_as_sentences, progress_bars, tidy_when_terminated

COMPENSATED_WAYPOINTS = 61
"""Along a line that is filmed with compensated lengths; in between, their corrections change evenly."""


def figures(
    name: Annotated[list[str] | None, typer.Argument(metavar="[NAME]...", help="Default: all of them.")] = None,
    output: Annotated[Path, typer.Option("-o", "--output", help="Folder to write <name>.svg and .png into.")] = Path(
        "figures"
    ),
    force: Annotated[bool, typer.Option("--force", help="Replace files that are there.")] = False,
    names: Annotated[bool, typer.Option("--list", help="List the figures and what they show; draw none.")] = False,
) -> None:
    """Redraw the paper's figures, MuJoCo's points on the static solver's lines, and four figures of our own."""
    from cdpr_sim.report.table_style import new_table
    from cdpr_sim.studies.gallery import paths_of

    if names:
        table = new_table("", "figure", "paper", words=2)
        table.add_column("what it shows")
        for one, picture in cdpr.PICTURES.items():
            table.add_row(one, picture.paper, picture.shows)
        Output().print(table)
        return
    with errors_as_sentences():
        wanted = name or cdpr.list_figures()
        written = iter(paths_of(wanted, output).values())
        with busy("Computing and drawing, a minute for all"):
            cdpr.write_figures(
                wanted, output, force=force, progress=lambda _: typer.echo("\n".join(map(str, next(written))))
            )


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
    import numpy as np

    from cdpr_sim.core.files import check_place
    from cdpr_sim.crosscheck.compensation_check import held
    from cdpr_sim.drawing.video import film
    from cdpr_sim.studies.robot_summary import settled_along, shapes_of

    with errors_as_sentences(), tidy_when_terminated(), progress_bars() as bar, _side_by_side() as start:
        check_place(output, film.SUFFIXES, force=force)
        states = film.check_settings(seconds, fps, size, exaggerate, renderer)
        wanted = list(itertools.product(robots, material or [None], (False, True) if compensate else (False,)))
        film.check_count(len(wanted))
        machines = [robot_of(name, cables) for name, cables, _ in wanted]
        for robot in machines:
            robot.cabling.refuse_mixture("video")  # before it settles at every state
            for option, chosen in (("--compensate", compensate), ("--drop", drop)):
                if chosen:
                    robot.cabling.refuse_weight(option)
        motions: list[Callable[[], cdpr.Trajectory]] = []
        for robot, (_, _, cut) in zip(machines, wanted, strict=True):
            if not robot.cabling.massless:
                ends = _line(robot, path, y, z)
                settled = settled_along(robot, np.linspace(ends[0], ends[-1], states), seconds)
                motions.append(lambda settled=settled: settled)
                continue
            waypoints, lengths = _line(robot, path, y, z)[: 1 if drop else None], None
            if cut:
                waypoints = np.linspace(waypoints[0], waypoints[-1], 1 if drop else COMPENSATED_WAYPOINTS)
                compensated, lengths = bar(f"Compensating {robot.name}"), []
                for waypoint in waypoints:
                    lengths.append(held(cdpr.compensate(robot, waypoint)).rest_lengths)
                    compensated(len(lengths) / len(waypoints))
                robot = robot.replace(name=f"{robot.name}, compensated")
            motions.append(
                start(
                    robot,
                    waypoints,
                    seconds=drive_seconds,
                    states=states,
                    from_rest=not drop,
                    rest_lengths=lengths,
                    progress=bar(f"MuJoCo drives {robot.name}"),
                )
            )
        trajectories = [motion() for motion in motions]
        cdpr.write_video(
            output,
            trajectories,
            [cdpr.solve_trajectory(trajectory).poses for trajectory in trajectories],
            shapes=[shapes_of(trajectory) for trajectory in trajectories],
            seconds=seconds,
            fps=fps,
            size=size,
            exaggeration=exaggerate,
            renderer=renderer,  # type: ignore[arg-type]
            force=force,
            progress=bar("Drawing"),
        )
    typer.echo(output)


@contextmanager
def _side_by_side() -> Iterator[Callable[..., Callable[[], cdpr.Trajectory]]]:
    """What is called as ``cdpr.drive`` is starts it on a thread; the motion is there when what is returned is called.

    An error, and Ctrl-C, end all drives.
    """
    from cdpr_sim.drawing.video import film

    over = threading.Event()

    def start(*asked, progress: Callable[[float], None], **options) -> Callable[[], cdpr.Trajectory]:
        def go_on(done: float) -> None:
            if over.is_set():
                raise CancelledError
            progress(done)

        return threads.submit(cdpr.drive, *asked, progress=go_on, **options).result

    with ThreadPoolExecutor(film.MOST_ROBOTS) as threads:
        try:
            yield start
        except BaseException:
            over.set()
            threads.shutdown(cancel_futures=True)
            raise


def _line(
    robot: cdpr.Robot, path: tuple[float, float] | None, y: float | None, z: float | None
) -> list[tuple[float, float, float]]:
    """The two ends of a path along x."""
    home = robot.home
    x0, x1 = robot.workspace[:, 0] if path is None else path
    return [(x, home[1] if y is None else y, home[2] if z is None else z) for x in (x0, x1)]

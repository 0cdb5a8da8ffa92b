"""Compare controllers: both layouts, both cables, the paper's line and a circle, slow and fast, with a wrong model.

    python scripts/compare_controllers.py
    python scripts/compare_controllers.py --ropes

The first takes several minutes on one core, a part of it for compensation at poses that cannot be held. It prints a
table, draws pictures/controllers.png, and renders the best controller along the line beside the worst that stays in the
picture: pictures/controllers.gif. The second prints what friction and hysteresis of the ropes cost each controller.
"""

import dataclasses
import sys
import time
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.progress import Progress

import cdpr_sim as cdpr
from cdpr_sim.core.files import write_whole
from cdpr_sim.core.materials import PAPER_MATERIALS
from cdpr_sim.drawing.axes import encoded
from studies.controller_comparison import LAYOUTS, PAUSE, Run, TrackingTask, held, rms, rope_runs, runs
from studies.controller_comparison_figures import controllers
from studies.controller_tables import ropes_table, runs_table, summary_table

FILMED = "line", 0.05  # path, top speed [m/s]
IN_SIGHT = 0.06  # [m] largest distance from the reference; beyond it, a platform leaves the picture
SIZE, SECONDS, FPS = (800, 450), 9.2, 8.0  # pixel, s of video, frames per second
FOLDER = Path(__file__).parents[1] / "pictures"


def titled(run: Run) -> cdpr.Trajectory:
    """The motion after the pause; the robot's name, which is the heading, contains the scheme."""
    motion = run.trajectory
    robot = motion.robot.replace(name=f"{run.task.layout}: {run.scheme}", material=run.task.material)
    rows = np.flatnonzero(run.moving)
    problems = dataclasses.replace(motion.problems.take(rows), robot=robot)
    return cdpr.Trajectory.of(
        problems, motion.times[rows] - PAUSE, motion.poses[rows], motion.lengths[rows], motion.tensions[rows]
    )


def main() -> None:
    console, begun = Console(), time.process_time()
    on_ropes = sys.argv[1:] == ["--ropes"]
    with Progress(console=console, transient=True) as progress:
        task = progress.add_task("Tracking", total=1.0)
        found = (rope_runs if on_ropes else runs)(lambda done: progress.update(task, completed=done))
    if on_ropes:
        console.print(ropes_table(found))
        console.print(f"{len(found)} runs, {time.process_time() - begun:.0f} s of one core")
        return
    console.print(runs_table(found))
    console.print(summary_table(found))
    for layout in LAYOUTS:
        for path in ("line", "circle"):
            part = held(TrackingTask(layout, PAPER_MATERIALS[0], path, 0.5))
            console.print(f"{layout}: the platform can be held level along {part:.0%} of the {path}.")
    console.print(f"{len(found)} runs, {time.process_time() - begun:.0f} s of one core")
    FOLDER.mkdir(exist_ok=True)
    write_whole({FOLDER / "controllers.png": encoded(controllers(found))})
    filmed = sorted(
        (
            one
            for one in found
            if (one.task.path, one.task.speed) == FILMED and one.position_errors.max() < IN_SIGHT and not one.fell
        ),
        key=lambda one: rms(one.position_errors),
    )
    best, worst = filmed[0], filmed[-1]
    pair = [titled(best), titled(worst)]
    cdpr.write_video(FOLDER / "controllers.gif", pair, seconds=SECONDS, fps=FPS, size=SIZE, force=True)
    for one in (best, worst):
        console.print(f"In the video: {one.task.layout}, {one.task.material}, {one.scheme}")


if __name__ == "__main__":
    main()

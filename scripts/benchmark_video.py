"""Benchmark of videos: frames per second of each renderer, end to end.

On a shared machine compare the processor times per frame.

Run: python scripts/benchmark_video.py
"""

import os
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import cdpr_sim as cdpr
from cdpr_sim.drawing.video import writing as video
from cdpr_sim.drawing.video.render import OpenGLUnavailable

ROBOTS = ("cogiro", "parallel")
LINE = [(0.17, 0.25, 0.1), (0.63, 0.25, 0.1)]  # m, the paper's
DRIVE_SECONDS = 60.0  # s
FRAMES, FPS = 150, 30.0
SIZE = (640, 480)  # pixel
TILTING = ["video", *ROBOTS, "--path", "0.17", "0.63", "--z", "0.1"]  # 1280 x 720, 300 frames, nearly static
REPEATS = 3


def main() -> None:
    robots = [cdpr.load_robot(name) for name in ROBOTS]
    start = time.perf_counter()
    trajectories = [cdpr.drive(robot, LINE, seconds=DRIVE_SECONDS, states=FRAMES) for robot in robots]
    seconds = time.perf_counter() - start
    print(f"drive: {len(robots) * DRIVE_SECONDS / seconds:.0f} times faster than real time")
    static = [cdpr.solve_trajectory(trajectory).poses for trajectory in trajectories]
    print(f"{SIZE[0]} x {SIZE[1]}, {FRAMES} frames, drawn and encoded; median of {REPEATS}")
    for backend in ("opengl", "raycast"):
        for shown in (1, 2):
            rates, costs = [], []
            for _ in range(REPEATS + 1):
                with tempfile.TemporaryDirectory() as folder:
                    start, before = time.perf_counter(), processor_seconds()
                    try:
                        video.write_video(
                            Path(folder, "video.mp4"),
                            trajectories[-shown:],
                            static[-shown:],
                            seconds=FRAMES / FPS,
                            fps=FPS,
                            size=SIZE,
                            renderer=backend,
                        )
                    except OpenGLUnavailable as error:
                        print(f"{backend:8} skipped: {error}")
                        break
                    rates.append(FRAMES / (time.perf_counter() - start))
                    costs.append(1e3 * (processor_seconds() - before) / FRAMES)
            else:  # the first run compiles
                rate, cost = statistics.median(rates[1:]), statistics.median(costs[1:])
                print(
                    f"{backend:8} {shown} robot(s): {rate:5.1f} frames per second, {cost:4.0f} ms of CPU time per frame"
                )
    tilting_platforms()


def tilting_platforms() -> None:
    """The whole command without OpenGL: start, two drives, the static solver, rendering and encoding."""
    seconds, costs = [], []
    for _ in range(REPEATS):
        with tempfile.TemporaryDirectory() as folder:
            start, before = time.perf_counter(), processor_seconds()
            command = [sys.executable, "-c", "from cdpr_sim.cli import main; main()", *TILTING]
            subprocess.run([*command, "--renderer", "raycast", "-o", "video.mp4"], cwd=folder, check=True)
            seconds.append(time.perf_counter() - start)
            costs.append(processor_seconds() - before)
    print(
        f"cdpr-sim {' '.join(TILTING)}, 1280 x 720, 300 frames, raycast: {statistics.median(seconds):.1f} s, "
        f"{statistics.median(costs):.1f} s of processor time; median of {REPEATS}"
    )


def processor_seconds() -> float:
    """Processor time [s] of this process and its encoders."""
    return sum(os.times()[:4])


if __name__ == "__main__":
    main()

"""Render the README's video: two layouts of DemoBot along the paper's line, side by side; and a small version of it.

One layout stays level. The other tilts, deviates from the line, and half of its cables are slack. The motion is from
MuJoCo; the gold outline is the result of the static solver.

Run: python scripts/make_video.py
"""

from pathlib import Path

from rich.progress import Progress

import cdpr_sim as cdpr

ROBOTS = ("cogiro", "parallel")
LINE = [(0.17, 0.25, 0.1), (0.63, 0.25, 0.1)]  # m, the paper's
DRIVE_SECONDS = None  # s; None: nearly static
SECONDS = 10.0  # s, of video
FOLDER = Path(__file__).parents[1] / "pictures"
FILES = {
    "tilting-platforms.gif": ((800, 450), 10.0)
}  # file: size [pixel], frames per second; .mp4 is supported as well


def main() -> None:
    FOLDER.mkdir(exist_ok=True)
    most = max(round(SECONDS * fps) for _, fps in FILES.values())
    with Progress() as progress:
        trajectories = []
        for name in ROBOTS:
            task = progress.add_task(f"MuJoCo drives {name}", total=1.0)
            trajectories.append(
                cdpr.drive(
                    cdpr.load_robot(name),
                    LINE,
                    seconds=DRIVE_SECONDS,
                    states=most,
                    progress=lambda done, task=task: progress.update(task, completed=done),
                )
            )
        static = [cdpr.solve_trajectory(trajectory).poses for trajectory in trajectories]
        for name, (size, fps) in FILES.items():
            task = progress.add_task(f"Drawing {name}", total=1.0)
            cdpr.write_video(
                FOLDER / name,
                trajectories,
                static,
                seconds=SECONDS,
                fps=fps,
                size=size,
                force=True,
                progress=lambda done, task=task: progress.update(task, completed=done),
            )
    for name in FILES:
        print(f"{FOLDER / name}: {(FOLDER / name).stat().st_size / 1e6:.2f} MB")


if __name__ == "__main__":
    main()

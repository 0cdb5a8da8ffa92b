"""Benchmark of latency: times that a user waits for, with their targets, compared with another checkout.

Run: python scripts/benchmark_latency.py [first] [start] [call] [kernel] [video] [--beside FOLDER]
Numbers are medians over processes, after one that fills the caches. Both checkouts are measured alternately. Timings
vary between runs: compare ratios.
"""

import argparse
import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
from rich import box
from rich.console import Console
from rich.table import Table

import cdpr_sim as cdpr

TARGETS = {
    "first": {
        "first answer, nothing compiled: processor [s]": "a quarter",
        "first answer, nothing compiled [s]": "a quarter",
        "first hundred answers, nothing compiled: processor [s]": "a quarter",
        "first hundred answers, nothing compiled [s]": "a quarter",
    },
    "start": {
        "cdpr-sim --help: processor [s]": "",
        "cdpr-sim --help [s]": "0.35",
        "cdpr-sim settle parallel: processor [s]": "",
        "cdpr-sim settle parallel [s]": "1.0",
    },
    "call": {
        "solve(robot, pose) [µs]": "120",
        "solve(problem) [µs]": "60",
        "settle(robot, pose) [µs]": "1,000",
        "compare(static, settled) [µs]": "200",
    },
    "kernel": {
        "solve_many, cogiro, each pose: processor [µs]": "2",
        "solve_many, parallel, each pose: processor [µs]": "4",
        "settle_many, cogiro, each second of processor": "2,500",
        "settle_many, parallel, each second of processor": "2,500",
    },
    "video": {
        "two robots, 300 frames, no OpenGL: processor [s]": "",
        "two robots, 300 frames, no OpenGL [s]": "12",
    },
}
"""Targets by group, in the order in which the group's function returns its numbers."""

ROUNDS = {"first": 3, "start": 9, "call": 5, "kernel": 5, "video": 3}
CALLS = 200  # poses, each solved once
BATCH, SETTLES, REPEATS = 50_000, 500, 5  # poses in a batch
SEED = 2026

COMMAND = "from cdpr_sim.cli import main; main()"
HUNDRED = "import cdpr_sim as cdpr; robot = cdpr.load_robot('parallel'); cdpr.solve_many(robot, [robot.home] * 100)"
VIDEO = "video cogiro parallel --renderer raycast --force -o"  # 1280 x 720, 10 s at 30 frames a second


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("groups", nargs="*", metavar="GROUP", help=f"{', '.join(TARGETS)}; default: all")
    parser.add_argument("--beside", metavar="FOLDER", help="another checkout, measured alternately with this one")
    parser.add_argument("--inside", choices=MEASURES, help=argparse.SUPPRESS)
    asked = parser.parse_args()
    if asked.inside:  # in a process of its own, whose PYTHONPATH selects the checkout
        print(json.dumps(MEASURES[asked.inside]()))
        return
    if not set(asked.groups) <= set(TARGETS):
        parser.error(f"groups: found {' '.join(asked.groups)}, expected some of {', '.join(TARGETS)}")
    trees = [str(Path(tree).resolve()) for tree in (Path(cdpr.__file__).parents[1], asked.beside) if tree]
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False)
    for column in ("", "target", "here", *(["beside", "here / beside"] if asked.beside else [])):
        table.add_column(column, justify="right" if column else "left")
    for group in asked.groups or TARGETS:
        rounds = [[measured(group, tree) for tree in trees] for _ in range(ROUNDS[group] + 1)][1:]
        for row, (what, target) in enumerate(TARGETS[group].items()):
            found = [statistics.median(one[tree][row] for one in rounds) for tree in range(len(trees))]
            ratio = [f"{found[0] / found[1]:.2f}"] if asked.beside else []
            table.add_row(
                what.replace("[", r"\["),
                target,
                *(f"{value:,.3g}" if value < 1e3 else f"{value:,.0f}" for value in found),
                *ratio,
            )
    Console(width=110).print(table)


def measured(group: str, tree: str) -> list[float]:
    """The numbers of a group, measured by a process that imports this checkout."""
    words = [sys.executable, __file__, "--inside", group]
    done = subprocess.run(words, env=os.environ | {"PYTHONPATH": tree}, capture_output=True, text=True)
    if done.returncode:
        raise SystemExit(f"{tree}: {done.stderr}")
    return json.loads(done.stdout)


def first() -> list[float]:
    with tempfile.TemporaryDirectory() as one, tempfile.TemporaryDirectory() as other:
        return process(COMMAND, "settle", "parallel", NUMBA_CACHE_DIR=one) + process(HUNDRED, NUMBA_CACHE_DIR=other)


def start() -> list[float]:
    return process(COMMAND, "--help") + process(COMMAND, "settle", "parallel")


def video() -> list[float]:
    with tempfile.TemporaryDirectory() as folder:
        return process(COMMAND, *VIDEO.split(), f"{folder}/video.mp4")


def process(code: str, *words: str, **environment: str) -> list[float]:
    """Processor time and wall time [s]."""
    before, begun = os.times(), time.perf_counter()
    command = [sys.executable, "-P", "-c", code, *words]  # -P: PYTHONPATH comes first
    subprocess.run(command, env=os.environ | environment, capture_output=True, check=True)
    after, taken = os.times(), time.perf_counter() - begun
    return [sum(after[2:4]) - sum(before[2:4]), taken]


def call() -> list[float]:
    robot = cdpr.load_robot("parallel")
    poses = positions(robot, CALLS)
    problems = [cdpr.Problem.of(robot, pose) for pose in poses]
    static, settled = [cdpr.solve(one) for one in problems], [cdpr.settle(one) for one in problems]
    return [
        1e6 * each(lambda row: cdpr.solve(robot, poses[row])),
        1e6 * each(lambda row: cdpr.solve(problems[row])),
        1e6 * each(lambda row: cdpr.settle(robot, poses[row])),
        1e6 * each(lambda row: cdpr.compare(static[row], settled[row])),
    ]


def kernel() -> list[float]:
    robots = [cdpr.load_robot(name) for name in ("cogiro", "parallel")]
    solving = [often(lambda robot=robot: cdpr.solve_many(robot, positions(robot, BATCH))) for robot in robots]
    settling = [often(lambda robot=robot: cdpr.settle_many(robot, positions(robot, SETTLES))) for robot in robots]
    return [*(1e6 * seconds / BATCH for seconds in solving), *(SETTLES / seconds for seconds in settling)]


def often(work: Callable[[], object]) -> float:
    """Processor time of all cores [s]; the median of a few runs, without the first."""
    taken = []
    for _ in range(REPEATS + 1):
        begun = time.process_time()
        work()
        taken.append(time.process_time() - begun)
    return statistics.median(taken[1:])


def positions(robot: cdpr.Robot, count: int) -> np.ndarray:
    """Random positions in the workspace, the same in each run."""
    lower, upper = robot.workspace
    return np.random.default_rng(SEED).uniform(lower, upper, (count, 3))


def each(ask: Callable[[int], object]) -> float:
    """Time of one call [s], the median over these poses."""
    return statistics.median(once(lambda row=row: ask(row)) for row in range(CALLS))


def once(work: Callable[[], object]) -> float:
    """Time [s], without the first call."""
    work()
    begun = time.perf_counter()
    work()
    return time.perf_counter() - begun


MEASURES = {"first": first, "start": start, "call": call, "kernel": kernel, "video": video}

if __name__ == "__main__":
    main()

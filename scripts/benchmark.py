"""Benchmark: what users wait for, with its targets, compared with another checkout.

Run: python scripts/benchmark.py [peak] [first] [start] [call] [batch] [answers] [threads] [video] [--beside FOLDER]
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
from cdpr_sim.core.robot_batch import RobotBatch
from cdpr_sim.design.layout_equilibria import Cases, solve_layouts
from cdpr_sim.design.moves import Move, Space
from cdpr_sim.statics import newton

TARGETS = {
    "peak": {
        "a plain loop of products and sums, one core [GFLOP/s]": "",
        "solve_many, cogiro, share of it [%]": "",
        "solve_many, parallel, share of it [%]": "",
    },
    "first": {
        "first answer, nothing compiled: processor [s]": "a quarter",
        "first answer, nothing compiled [s]": "a quarter",
        "first hundred answers, nothing compiled: processor [s]": "4",
        "first hundred answers, nothing compiled [s]": "4",
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
    "batch": {
        "solve_many, cogiro, each pose: processor [µs]": "0.7",
        "solve_many, parallel, each pose: processor [µs]": "1.2",
        "stiffness and frequency, parallel, each pose: processor [µs]": "",
        "feasible, parallel, each pose: processor [µs]": "",
        "sweep of a million poses, cogiro, all quantities: processor [s]": "5",
        "sweep of a million poses, parallel, all quantities: processor [s]": "5",
        "layouts x 18 poses, near the given one, each second of processor": "60,000",
        "layouts x 18 poses, anywhere, each second of processor": "30,000",
        "settle_many, cogiro, each second of processor": "5,000",
        "settle_many, parallel, each second of processor": "4,000",
        "settle_many, sagging cables, each second of processor": "120",
        "check of 10,000 poses, parallel: processor [s]": "3",
    },
    "answers": {
        "find_equilibria with saddles, cogiro: processor [s]": "1",
        "find_equilibria with saddles, parallel: processor [s]": "4",
        "compensate, no exact answer, cogiro: processor [ms]": "30",
        "compensate, no exact answer, parallel: processor [ms]": "30",
        "winch_controls: processor [µs]": "20",
        "rest_lengths: processor [µs]": "15",
    },
    "threads": {
        "solve_many, two threads beside one: times as fast": "",
        "shortfall, two threads beside one: times as fast": "",
        "layouts, two threads beside one: times as fast": "",
        "settle_many, two threads beside one: times as fast": "",
        "settle_many, sagging cables, two threads beside one: times as fast": "",
    },
    "video": {
        "two robots, 300 frames, no OpenGL: processor [s]": "",
        "two robots, 300 frames, no OpenGL [s]": "12",
    },
}
"""Targets by group, in the order in which the group's function returns its numbers."""

ROUNDS = {"peak": 3, "first": 3, "start": 9, "call": 5, "batch": 3, "answers": 3, "threads": 3, "video": 3}
CALLS = 200  # poses, each solved once
BATCH, SETTLES, SAGGING, REPEATS = 50_000, 500, 40, 3  # poses in a batch
LAYOUTS = 2_000
STEP = 2_000  # floating-point operations of a Newton step
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


def batch() -> list[float]:
    cogiro, parallel = (cdpr.load_robot(name) for name in ("cogiro", "parallel"))
    cases, layouts = layouts_of(parallel)
    solved = cdpr.solve_many(parallel, positions(parallel, BATCH))
    few, per_pose, per_million = positions(parallel, 2_000), 1e6 / BATCH, 1e6 / 50_000
    return [
        *(per_pose * often(lambda one=one: cdpr.solve_many(one, positions(one, BATCH))) for one in (cogiro, parallel)),
        per_pose * often(lambda: newton.stiffness_of(solved)),
        per_pose * often(lambda: cdpr.feasible(parallel, positions(parallel, BATCH))),
        *(per_million * often(lambda one=one: cdpr.sweep(one, (50, 40, 25), chunk=None)) for one in (cogiro, parallel)),
        *(LAYOUTS / often(lambda some=some: solve_layouts(some, cases, 1).tilt.max(-1)) for some in layouts),
        *(SETTLES / often(lambda one=one: settled(one, SETTLES, 1)) for one in (cogiro, parallel)),
        SAGGING / often(lambda: settled(sagging(cogiro), SAGGING, 1)),
        10_000 / len(few) * often(lambda: cdpr.check(parallel, poses=few, threads=1)),
    ]


def answers() -> list[float]:
    cogiro, parallel = (cdpr.load_robot(name) for name in ("cogiro", "parallel"))
    poses = positions(parallel, CALLS)
    lengths = [parallel.rest_lengths(pose) for pose in poses]
    return [
        *(often(lambda one=one: cdpr.find_equilibria(one, one.home, saddles=True)) for one in (cogiro, parallel)),
        1e3 * often(lambda: cdpr.compensate(cogiro, (0.05, 0.05, 0.3))),  # [m] where no lengths hold the platform
        1e3 * often(lambda: cdpr.compensate(parallel, (0.17, 0.25, 0.1))),
        1e6 / CALLS * often(lambda: [cdpr.winch_controls(parallel, parallel.home, rest) for rest in lengths]),
        1e6 / CALLS * often(lambda: [parallel.rest_lengths(pose) for pose in poses]),
    ]


def threads() -> list[float]:
    cogiro, parallel = (cdpr.load_robot(name) for name in ("cogiro", "parallel"))
    poses, (cases, (near, _)) = positions(parallel, BATCH), layouts_of(parallel)
    calls: list[Callable[[int], object]] = [
        lambda count: cdpr.solve_many(parallel, poses, threads=count),
        lambda count: cdpr.shortfall(parallel, poses, threads=count),
        lambda count: solve_layouts(near, cases, count),
        lambda count: settled(parallel, SETTLES, count),
        lambda count: settled(sagging(cogiro), SAGGING, count),
    ]
    return [once(lambda ask=ask: ask(1)) / once(lambda ask=ask: ask(2)) for ask in calls]


def settled(robot: cdpr.Robot, count: int, threads: int) -> cdpr.EquilibriumBatch:
    return cdpr.settle_many(robot, positions(robot, count), threads=threads)


def sagging(robot: cdpr.Robot) -> cdpr.Robot:
    return robot.replace(linear_density=2e-3)


def layouts_of(robot: cdpr.Robot) -> tuple[Cases, list[RobotBatch]]:
    """The paper's line in 18 poses; random layouts within 50 mm of the given one, and anywhere in the frame's top."""
    cases = Cases.of(robot, [(x, 0.25, 0.1) for x in np.linspace(0.17, 0.63, 18)])
    layouts = []
    for where in (0.05, [[0.0, 0.0, 0.4], [0.8, 0.5, 0.5]]):  # m
        space = Space.of(robot, [Move("exits", where)])
        tried = np.random.default_rng(SEED).uniform(space.lower, space.upper, (LAYOUTS, len(space)))
        layouts.append(space.layouts(tried))
    return cases, layouts


def peak() -> list[float]:
    """The loop is vectorised by the compiler: 64 independent sums. Newton steps count, what lanes solve besides not."""
    import numba

    @numba.njit(fastmath=True)
    def chains(times, factor):
        sums = np.ones(64)
        for _ in range(times):
            for i in range(64):
                sums[i] = sums[i] * factor + 0.001
        return sums

    times = 1_000_000
    most = 2 * 64e-9 * times / often(lambda: chains(times, 0.999))
    shares = []
    for name in ("cogiro", "parallel"):
        robot = cdpr.load_robot(name)
        poses = positions(robot, BATCH)
        steps = cdpr.solve_many(robot, poses).iterations.sum()
        shares.append(
            1e-7 * STEP * steps / often(lambda robot=robot, poses=poses: cdpr.solve_many(robot, poses)) / most
        )
    return [most, *shares]


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


MEASURES = {
    "peak": peak, "first": first, "start": start, "call": call, "batch": batch, "answers": answers, "threads": threads,
    "video": video,
}  # fmt: skip

if __name__ == "__main__":
    main()

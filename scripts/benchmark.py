"""Benchmark: what users wait for, with its targets, compared with another checkout.

Run: python scripts/benchmark.py [peak] [first] [start] [call] [batch] [layouts] [answers] [threads] [video]
[--beside FOLDER]
Numbers are medians over processes, after one that fills the caches. Both checkouts are measured alternately; nan is
what a checkout cannot do. Timings vary between runs: compare ratios.
"""

import argparse
import json
import math
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
from rich import box
from rich.console import Console
from rich.table import Table

import cdpr_sim as cdpr

ROUNDS = {"start": 9, "call": 5, "answers": 1}
"""Processes for each group; 3 for others."""

CALLS = 200  # poses, each solved once
BATCH, SETTLES, SAGGING, REPEATS = 50_000, 500, 40, 3  # poses in a batch
CHECKED = 2_000  # poses
LAYOUTS = 2_000
STEP = 2_000  # floating-point operations of a Newton step, nearly
SEED = 2026

COMMAND = "from cdpr_sim.cli import main; main()"
HUNDRED = "import cdpr_sim as cdpr; robot = cdpr.load_robot('parallel'); cdpr.solve_many(robot, [robot.home] * 100)"
VIDEO = "video cogiro parallel --renderer raycast --force -o"  # 1280 x 720, 10 s at 30 frames a second

Row = tuple[str, str, float | Callable[[], float]]
"""What is measured, its target, and the number or what measures it."""


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("groups", nargs="*", metavar="GROUP", help=f"{', '.join(GROUPS)}; default: all")
    parser.add_argument("--beside", metavar="FOLDER", help="another checkout, measured alternately with this one")
    parser.add_argument("--inside", choices=GROUPS, help=argparse.SUPPRESS)
    asked = parser.parse_args()
    if asked.inside:  # in a process of its own, whose PYTHONPATH selects the checkout
        print(json.dumps([(what, target, number(found)) for what, target, found in GROUPS[asked.inside]()]))
        return
    if not set(asked.groups) <= set(GROUPS):
        parser.error(f"groups: found {' '.join(asked.groups)}, expected some of {', '.join(GROUPS)}")
    trees = [str(Path(tree).resolve()) for tree in (Path(cdpr.__file__).parents[1], asked.beside) if tree]
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False)
    for column in ("", "target", "here", *(["beside", "here / beside"] if asked.beside else [])):
        table.add_column(column, justify="right" if column else "left")
    for group in asked.groups or GROUPS:
        rounds = [[measured(group, tree) for tree in trees] for _ in range(ROUNDS.get(group, 3) + 1)][1:]
        for row, (what, target, _) in enumerate(rounds[0][0]):
            found = [statistics.median(one[tree][row][2] for one in rounds) for tree in range(len(trees))]
            ratio = [f"{found[0] / found[1]:.2f}"] if asked.beside else []
            table.add_row(
                what.replace("[", r"\["),
                target,
                *(f"{value:,.3g}" if not value >= 1e3 else f"{value:,.0f}" for value in found),
                *ratio,
            )
    Console(width=110).print(table)


def measured(group: str, tree: str) -> list[tuple[str, str, float]]:
    """The rows of a group, measured by a process that imports this checkout."""
    words = [sys.executable, __file__, "--inside", group]
    done = subprocess.run(words, env=os.environ | {"PYTHONPATH": tree}, capture_output=True, text=True)
    if done.returncode:
        raise SystemExit(f"{tree}: {done.stderr}")
    return json.loads(done.stdout)


def number(found: float | Callable[[], float]) -> float:
    """What is measured; nan where the checkout has no such function, argument or module."""
    try:
        return found() if callable(found) else found
    except (AttributeError, ImportError, TypeError):
        return math.nan


def first() -> Iterator[Row]:
    with tempfile.TemporaryDirectory() as folder:
        busy, waited = process(COMMAND, "settle", "parallel", NUMBA_CACHE_DIR=folder)
    yield "first answer, nothing compiled: processor [s]", "a quarter", busy
    yield "first answer, nothing compiled [s]", "a quarter", waited
    with tempfile.TemporaryDirectory() as folder:
        busy, waited = process(HUNDRED, NUMBA_CACHE_DIR=folder)
    yield "first hundred answers, nothing compiled: processor [s]", "4", busy
    yield "first hundred answers, nothing compiled [s]", "4", waited


def start() -> Iterator[Row]:
    busy, waited = process(COMMAND, "--help")
    yield "cdpr-sim --help: processor [s]", "", busy
    yield "cdpr-sim --help [s]", "0.35", waited
    busy, waited = process(COMMAND, "settle", "parallel")
    yield "cdpr-sim settle parallel: processor [s]", "", busy
    yield "cdpr-sim settle parallel [s]", "1.0", waited


def video() -> Iterator[Row]:
    with tempfile.TemporaryDirectory() as folder:
        busy, waited = process(COMMAND, *VIDEO.split(), f"{folder}/video.mp4")
    yield "two robots, 300 frames, no OpenGL: processor [s]", "", busy
    yield "two robots, 300 frames, no OpenGL [s]", "12", waited


def process(code: str, *words: str, **environment: str) -> tuple[float, float]:
    """Processor time and wall time [s]."""
    before, begun = os.times(), time.perf_counter()
    command = [sys.executable, "-P", "-c", code, *words]  # -P: PYTHONPATH comes first
    subprocess.run(command, env=os.environ | environment, capture_output=True, check=True)
    after, taken = os.times(), time.perf_counter() - begun
    return sum(after[2:4]) - sum(before[2:4]), taken


def call() -> Iterator[Row]:
    robot = cdpr.load_robot("parallel")
    poses = positions(robot, CALLS)
    problems = [cdpr.Problem.of(robot, pose) for pose in poses]
    static, settled = [cdpr.solve(one) for one in problems], [cdpr.settle(one) for one in problems]
    yield "solve(robot, pose) [µs]", "120", lambda: 1e6 * each(lambda row: cdpr.solve(robot, poses[row]))
    yield "solve(problem) [µs]", "60", lambda: 1e6 * each(lambda row: cdpr.solve(problems[row]))
    yield "settle(robot, pose) [µs]", "1,000", lambda: 1e6 * each(lambda row: cdpr.settle(robot, poses[row]))
    yield (
        "compare(static, settled) [µs]",
        "200",
        lambda: 1e6 * each(lambda row: cdpr.compare(static[row], settled[row])),
    )


def batch() -> Iterator[Row]:
    from cdpr_sim.statics import newton

    cogiro, parallel = robots = both()
    for robot, target in zip(robots, ("0.7", "1.2"), strict=True):
        work = positions(robot, BATCH)
        yield (
            f"solve_many, {robot.name}, each pose: processor [µs]",
            target,
            lambda robot=robot, work=work: 1e6 / BATCH * often(lambda: cdpr.solve_many(robot, work)),
        )
        over = robot.replace(pulley_radius=0.05 * robot.characteristic_length)
        yield (
            f"solve_many, {robot.name} over pulleys, each pose: processor [µs]",
            "",
            lambda over=over, work=work: 1e6 / BATCH * often(lambda: cdpr.solve_many(over, work)),
        )
    solved = cdpr.solve_many(parallel, positions(parallel, BATCH))
    yield (
        "stiffness and frequency, parallel, each pose: processor [µs]",
        "",
        lambda: 1e6 / BATCH * often(lambda: newton.stiffness_of(solved)),
    )
    yield (
        "feasible, parallel, each pose: processor [µs]",
        "",
        lambda: 1e6 / BATCH * often(lambda: cdpr.feasible(parallel, positions(parallel, BATCH))),
    )
    for robot in robots:
        yield (
            f"sweep of a million poses, {robot.name}, all quantities: processor [s]",
            "5",
            lambda robot=robot: 1e6 / 50_000 * often(lambda: cdpr.sweep(robot, (50, 40, 25), chunk=None)),
        )
    for robot, target in zip(robots, ("5,000", "4,000"), strict=True):
        yield (
            f"settle_many, {robot.name}, each second of processor",
            target,
            lambda robot=robot: SETTLES / often(lambda: settled(robot, SETTLES, 1)),
        )
    yield (
        "settle_many, cogiro with mass of cables, each second of processor",
        "120",
        lambda: SAGGING / often(lambda: settled(with_mass(cogiro), SAGGING, 1)),
    )
    few = positions(parallel, CHECKED)
    yield (
        "check of 10,000 poses, parallel: processor [s]",
        "3",
        lambda: 10_000 / CHECKED * often(lambda: cdpr.check(parallel, poses=few, threads=1)),
    )


def layouts() -> Iterator[Row]:
    """The paper's line in 18 poses; random layouts within 50 mm of the given one, and anywhere in the frame's top."""
    poses, (_, parallel) = [(x, 0.25, 0.1) for x in np.linspace(0.17, 0.63, 18)], both()

    def many(where: float | list) -> Callable[[int], object]:
        from cdpr_sim.design.layout_equilibria import Cases, solve_layouts
        from cdpr_sim.design.moves import Move, Space

        space, cases = Space.of(parallel, [Move("exits", where)]), Cases.of(parallel, poses)
        tried = space.layouts(np.random.default_rng(SEED).uniform(space.lower, space.upper, (LAYOUTS, len(space))))
        return lambda threads: solve_layouts(tried, cases, threads).tilt.max(-1)

    def rate(where: float | list) -> float:
        work = many(where)
        return LAYOUTS / often(lambda: work(1))

    yield "layouts x 18 poses, near the given one, each second of processor", "60,000", lambda: rate(0.05)
    yield (
        "layouts x 18 poses, anywhere, each second of processor",
        "30,000",
        lambda: rate([[0.0, 0.0, 0.4], [0.8, 0.5, 0.5]]),
    )
    yield "layouts, two threads beside one: times as fast", "", lambda: gain(many(0.05))


def answers() -> Iterator[Row]:
    cogiro, parallel = robots = both()
    for robot, target in zip(robots, ("1", "4"), strict=True):
        yield (
            f"find_equilibria with saddles, {robot.name}: processor [s]",
            target,
            lambda robot=robot: often(lambda: cdpr.find_equilibria(robot, robot.home, saddles=True), 1),
        )
    for robot, pose in ((cogiro, (0.05, 0.05, 0.3)), (parallel, (0.17, 0.25, 0.1))):  # no lengths hold them there
        yield (
            f"compensate, no exact answer, {robot.name}: processor [ms]",
            "30",
            lambda robot=robot, pose=pose: 1e3 * often(lambda: cdpr.compensate(robot, pose)),
        )
    poses = positions(parallel, CALLS)
    lengths = [parallel.rest_lengths(pose) for pose in poses]
    yield (
        "winch_controls: processor [µs]",
        "20",
        lambda: 1e6 / CALLS * often(lambda: [cdpr.winch_controls(parallel, parallel.home, rest) for rest in lengths]),
    )
    yield (
        "rest_lengths: processor [µs]",
        "15",
        lambda: 1e6 / CALLS * often(lambda: [parallel.rest_lengths(pose) for pose in poses]),
    )
    found = cdpr.solve(parallel, (0.25, 0.22, 0.1))
    yield "sensitivity, parallel: processor [ms]", "", lambda: 1e3 * often(lambda: cdpr.sensitivity(found))
    yield "natural_modes, parallel: processor [ms]", "", lambda: 1e3 * often(lambda: cdpr.natural_modes(found))
    yield "follow_load, parallel: processor [ms]", "", lambda: 1e3 * often(lambda: cdpr.follow_load(found.problem))
    commanded = positions(parallel, 12)
    measured = np.array([cdpr.solve(parallel.replace(axial_stiffness=8e3), pose).position for pose in commanded])
    data = cdpr.Measurements.of(commanded, measured, coordinates=("x", "y", "z"))
    yield (
        "identify the stiffness from 12 poses, parallel: processor [ms]",
        "",
        lambda: 1e3 * often(lambda: cdpr.identify(parallel, data)),
    )


def threads() -> Iterator[Row]:
    cogiro, parallel = both()
    poses = positions(parallel, 4 * BATCH)
    calls: dict[str, Callable[[int], object]] = {
        "solve_many": lambda count: cdpr.solve_many(parallel, poses, threads=count),
        "shortfall": lambda count: cdpr.shortfall(parallel, poses, threads=count),
        "settle_many": lambda count: settled(parallel, 4 * SETTLES, count),
        "settle_many, mass of cables": lambda count: settled(with_mass(cogiro), 4 * SAGGING, count),
    }
    for what, work in calls.items():
        yield f"{what}, two threads beside one: times as fast", "", lambda work=work: gain(work)


def peak() -> Iterator[Row]:
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
    most = 2 * 64 * times / often(lambda: chains(times, 0.999))
    yield "a plain loop of products and sums, one core [GFLOP/s]", "", 1e-9 * most

    def share(robot: cdpr.Robot) -> float:
        poses = positions(robot, BATCH)
        steps = cdpr.solve_many(robot, poses).iterations.sum()
        return 100 * STEP * float(steps) / often(lambda: cdpr.solve_many(robot, poses)) / most

    for robot in both():
        yield f"solve_many, {robot.name}, share of it [%]", "", lambda robot=robot: share(robot)


def both() -> tuple[cdpr.Robot, cdpr.Robot]:
    return cdpr.load_robot("cogiro"), cdpr.load_robot("parallel")


def with_mass(robot: cdpr.Robot) -> cdpr.Robot:
    return robot.replace(linear_density=2e-3)


def settled(robot: cdpr.Robot, count: int, threads: int) -> cdpr.EquilibriumBatch:
    return cdpr.settle_many(robot, positions(robot, count), threads=threads)


def often(work: Callable[[], object], repeats: int = REPEATS) -> float:
    """Processor time of all cores [s]; the median of a few runs, without the first."""
    return times_of(work, repeats, time.process_time)


def gain(work: Callable[[int], object]) -> float:
    """Elapsed time with one thread over that with two."""
    one, two = (times_of(lambda count=count: work(count), REPEATS, time.perf_counter) for count in (1, 2))
    return one / two


def each(ask: Callable[[int], object]) -> float:
    """Elapsed time of one call [s], the median over these poses."""
    return statistics.median(times_of(lambda row=row: ask(row), 1, time.perf_counter) for row in range(CALLS))


def times_of(work: Callable[[], object], repeats: int, clock: Callable[[], float]) -> float:
    """Time by this clock [s]; the median, without the first run."""
    taken = []
    for _ in range(repeats + 1):
        begun = clock()
        work()
        taken.append(clock() - begun)
    return statistics.median(taken[1:])


def positions(robot: cdpr.Robot, count: int) -> np.ndarray:
    """Random positions in the workspace, the same in each run."""
    lower, upper = robot.workspace
    return np.random.default_rng(SEED).uniform(lower, upper, (count, 3))


GROUPS = {
    "peak": peak, "first": first, "start": start, "call": call, "batch": batch, "layouts": layouts,
    "answers": answers, "threads": threads, "video": video,
}  # fmt: skip

if __name__ == "__main__":
    main()

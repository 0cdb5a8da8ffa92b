"""Benchmark: what users wait for, with its targets, compared with another checkout.

Run: python scripts/benchmarks/benchmark.py [peak] [first] [start] [call] [batch] [sweeps] [layouts] [answers] [threads]
[motion] [video] [frames] [--beside FOLDER]
Numbers are medians over processes, after one that fills the caches. Both checkouts are measured alternately; nan is
what a checkout cannot do. Timings vary between runs: compare ratios.
"""

# pyright: reportAttributeAccessIssue=false
# mujoco ships no type stubs for its compiled modules.
import argparse
import functools
import itertools
import json
import math
import os
import statistics
import subprocess
import sys
import tempfile
import time
import timeit
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
from rich import box
from rich.console import Console
from rich.table import Table

import cdpr_sim as cdpr
from cdpr_sim.drawing.video.render import OpenGLUnavailable

ROUNDS = {"start": 9, "call": 5, "answers": 1, "sweeps": 1}
"""Processes for each group; 3 for others."""

CALLS = 200  # poses, each solved once
BATCH, SETTLES, SAGGING, REPEATS = 50_000, 500, 40, 3  # poses in a batch
CHECKED = 2_000  # poses
LAYOUTS = 2_000
STEP = 2_000  # floating-point operations of a Newton step, nearly
SEED = 2026

COMMAND = "from cdpr_sim.cli import main; main()"
HUNDRED = "import cdpr_sim as cdpr; robot = cdpr.load_robot('parallel'); cdpr.solve_many(robot, [robot.home] * 100)"
SWEEP = "import cdpr_sim as cdpr; cdpr.sweep('parallel', {grid}, store={store!r})"
GRIDS = {10**4: (40, 25, 10), 10**6: (200, 100, 50), 10**7: (400, 250, 100)}  # the last is written to Zarr
LINE = [(0.17, 0.25, 0.1), (0.63, 0.25, 0.1)]  # m, the paper's
SPEED = 0.05  # m/s, largest speed; the mean is smaller by a factor of 1.875
STEPS = 20_000  # of a winch model
FRAMES, FPS, SIZE = 150, 30.0, (640, 480)  # of a video
VIDEO = "video cogiro parallel --renderer raycast --force -o"  # 1280 x 720, 10 s at 30 frames a second

Row = tuple[str, str, float | Callable[[], float]]
"""What is measured, its target, and the number or what measures it."""


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("groups", nargs="*", metavar="GROUP", help=f"{', '.join(GROUPS)}; default: all")
    parser.add_argument("--beside", metavar="FOLDER", help="another checkout, measured alternately with this one")
    parser.add_argument("--inside", choices=GROUPS, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.inside:  # in a process of its own, whose PYTHONPATH selects the checkout
        print(json.dumps([(what, target, number(found)) for what, target, found in GROUPS[options.inside]()]))
        return
    if not set(options.groups) <= set(GROUPS):
        parser.error(f"groups: found {' '.join(options.groups)}, expected some of {', '.join(GROUPS)}")
    trees = [str(Path(tree).resolve()) for tree in (Path(cdpr.__file__).parents[1], options.beside) if tree]
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False)
    for column in ("", "target", "here", *(["beside", "here / beside"] if options.beside else [])):
        table.add_column(column, justify="right" if column else "left")
    for group in options.groups or GROUPS:
        rounds = [[measured(group, tree) for tree in trees] for _ in range(ROUNDS.get(group, 3) + 1)][1:]
        for row, (what, target, _) in enumerate(rounds[0][0]):
            found = [statistics.median(one[tree][row][2] for one in rounds) for tree in range(len(trees))]
            ratio = [f"{found[0] / found[1]:.2f}"] if options.beside else []
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
    """What is measured; nan where the checkout has no such function, argument or module, or the machine no OpenGL."""
    try:
        return found() if callable(found) else found
    except (AttributeError, ImportError, TypeError, OpenGLUnavailable):
        return math.nan


def first() -> Iterator[Row]:
    with tempfile.TemporaryDirectory() as folder:
        busy, waited, _ = process(COMMAND, "settle", "parallel", NUMBA_CACHE_DIR=folder)
    yield "first answer, nothing compiled: processor [s]", "a quarter", busy
    yield "first answer, nothing compiled [s]", "a quarter", waited
    with tempfile.TemporaryDirectory() as folder:
        busy, waited, _ = process(HUNDRED, NUMBA_CACHE_DIR=folder)
    yield "first hundred answers, nothing compiled: processor [s]", "4", busy
    yield "first hundred answers, nothing compiled [s]", "4", waited


def start() -> Iterator[Row]:
    busy, waited, _ = process(COMMAND, "--help")
    yield "cdpr-sim --help: processor [s]", "", busy
    yield "cdpr-sim --help [s]", "0.35", waited
    busy, waited, _ = process(COMMAND, "settle", "parallel")
    yield "cdpr-sim settle parallel: processor [s]", "", busy
    yield "cdpr-sim settle parallel [s]", "1.0", waited


def video() -> Iterator[Row]:
    with tempfile.TemporaryDirectory() as folder:
        busy, waited, _ = process(COMMAND, *VIDEO.split(), f"{folder}/video.mp4")
    yield "two robots, 300 frames, no OpenGL: processor [s]", "", busy
    yield "two robots, 300 frames, no OpenGL [s]", "12", waited


def frames() -> Iterator[Row]:
    """Drawn and encoded; nan without OpenGL."""
    motions = [cdpr.drive(robot, LINE, seconds=60.0, states=FRAMES) for robot in both()]
    static = [cdpr.solve_trajectory(motion).poses for motion in motions]

    def seconds(backend: str, robots: int, clock: Callable[[], float]) -> float:
        with tempfile.TemporaryDirectory() as folder:
            options = dict(seconds=FRAMES / FPS, fps=FPS, size=SIZE, renderer=backend, force=True)
            video = functools.partial(cdpr.write_video, Path(folder, "video.mp4"), **options)
            return times_of(lambda: video(motions[-robots:], static[-robots:]), REPEATS, clock) / FRAMES

    for backend, robots in itertools.product(("opengl", "raycast"), (1, 2)):
        of = functools.partial(seconds, backend, robots)
        what = f"frames of {robots} robot(s), {SIZE[0]} x {SIZE[1]}, {backend}"
        yield f"{what}: each second", "", lambda of=of: 1 / of(time.perf_counter)
        yield f"{what}, each: processor [ms]", "", lambda of=of: 1e3 * of(lambda: sum(os.times()[:4]))


def motion() -> Iterator[Row]:
    import mujoco

    for name in ("cogiro", "parallel", "planar-vertical", "two-cable"):
        robot = cdpr.load_robot(name)
        model = mujoco.MjModel.from_xml_string(cdpr.to_mjcf(robot, robot.home, winches=True))
        cost = often(functools.partial(mujoco.mj_step, model, mujoco.MjData(model), STEPS), 5) / STEPS
        yield f"winch model, {name}: steps per second of processor", "", 1 / cost
        yield f"winch model, {name}: times faster than real time", "", model.opt.timestep / cost
    for robot in both():
        controller, seconds = cdpr.PoseFeedback(cdpr.RigidLengths(robot)), 1.875 * 0.46 / SPEED
        track = functools.partial(
            cdpr.track, robot, LINE, controller, seconds=seconds, sensors=cdpr.Sensors(delay=0.01)
        )
        what = f"track along the paper's line, pose feedback at 100 Hz, {robot.name}"
        yield f"{what}: processor [s]", "", lambda track=track: often(track, 5)
        yield f"{what} [s]", "", lambda track=track: times_of(track, 5, time.perf_counter)


def sweeps() -> Iterator[Row]:
    with tempfile.TemporaryDirectory() as folder:
        for poses, grid in GRIDS.items():
            store = f"{folder}/sweep.zarr" if poses > 10**6 else None
            busy, waited, most = process(SWEEP.format(grid=grid, store=store))
            what = f"sweep of {poses:,} poses, parallel, into {'Zarr' if store else 'memory'}, with the start of Python"
            yield f"{what}: processor [s]", "", busy
            yield f"{what} [s]", "", waited
            yield f"{what}: peak memory [MB]", "", most
    for robot in both():
        yield f"overhead of Dask on one core, {robot.name} [%]", "", functools.partial(overhead, robot)
        for limits in ((0.0, np.inf), (0.1, 3.0)):
            fast, slow = feasibility(robot, limits)
            what = f"feasible, {robot.name}, {limits[0]:g} to {limits[1]:g} N"
            yield f"{what}, each pose: processor [µs]", "", 1e6 * fast
            yield f"{what}, times faster than HiGHS", "", slow / fast


def overhead(robot: cdpr.Robot) -> float:
    """By how much Dask lengthens a sweep [%]."""
    from dask.config import set as configured

    with configured(scheduler="synchronous"):
        chunked = often(lambda: cdpr.sweep(robot, (100, 50, 20)))
    return 100 * (chunked / often(lambda: cdpr.sweep(robot, (100, 50, 20), chunk=None)) - 1)


def feasibility(robot: cdpr.Robot, limits: tuple[float, float]) -> tuple[float, float]:
    """Processor time for each pose [s], and that of HiGHS."""
    from cdpr_sim.analysis.workspace.feasibility import feasible_by_linprog

    poses, few = positions(robot, 2 * BATCH), positions(robot, 200)
    fast = often(lambda: cdpr.feasible(robot, poses, tension_limits=limits))
    slow = often(lambda: [feasible_by_linprog(robot, pose, tension_limits=limits) for pose in few], 1)
    return fast / len(poses), slow / len(few)


def process(code: str, *words: str, **environment: str) -> tuple[float, float, float]:
    """Processor time and wall time [s], and peak memory [MB]."""
    begun, nowhere = time.perf_counter(), subprocess.DEVNULL
    command = [sys.executable, "-P", "-c", code, *words]  # -P: PYTHONPATH comes first
    child = subprocess.Popen(command, env=os.environ | environment, stdout=nowhere, stderr=nowhere)
    _, status, used = os.wait4(child.pid, 0)
    child.returncode = os.waitstatus_to_exitcode(status)
    if child.returncode:
        raise subprocess.CalledProcessError(child.returncode, command)
    return used.ru_utime + used.ru_stime, time.perf_counter() - begun, used.ru_maxrss / 1024


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
    """The loop is vectorised by the compiler: 64 independent sums."""
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
    return statistics.median(timeit.repeat(work, timer=clock, repeat=repeats + 1, number=1)[1:])


def positions(robot: cdpr.Robot, count: int) -> np.ndarray:
    """Random positions in the workspace, the same in each run."""
    lower, upper = robot.workspace
    return np.random.default_rng(SEED).uniform(lower, upper, (count, 3))


GROUPS = {
    "peak": peak, "first": first, "start": start, "call": call, "batch": batch, "sweeps": sweeps, "layouts": layouts,
    "answers": answers, "threads": threads, "motion": motion, "video": video, "frames": frames,
}  # fmt: skip

if __name__ == "__main__":
    main()

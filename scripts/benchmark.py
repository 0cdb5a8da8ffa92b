"""Benchmark: speed and reliability of the static solvers and of MuJoCo in one run.

Run: python scripts/benchmark.py [--quick] [--lanes [POSES]] [--settling [POSES]] [--sagging [POSES]] [--calls]
Times are medians over repetitions on one core unless stated otherwise. Timings vary between runs: compare ratios.
"""

import argparse
import os
import time
from collections.abc import Callable
from functools import partial

import numpy as np
from rich import box
from rich.console import Console
from rich.markup import escape
from rich.table import Table

import cdpr_sim as cdpr
from cdpr_sim.physics import dynamic_relaxation
from cdpr_sim.statics import newton, seecr

ROBOTS = ["cogiro", "parallel"]
STIFFNESSES = [1e2, 1e3, 1e4, 1e5, 1e6, 1e7]  # [N] EA
POSES = 100_000  # random commanded positions in the robot's workspace
SCIPY_POSES = 60  # the first of these positions, for the paper's solvers
SETTLES = 300  # one by one
BATCH = 2_000  # side by side
SAGGING = 128  # on cables with mass
LINES = 100  # lines through the workspace along x, with a pose every millimetre
REPETITIONS = 3
APART, TURNED = 1e-9, 1e-7  # [m], entries of rotation matrices: different answers of two solvers
NOWHERE_HELD = {"cogiro": (0.05, 0.05, 0.3), "parallel": (0.17, 0.25, 0.1)}  # [m] no lengths hold the platform there
SEED = 2024

console = Console(width=110)


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="a tenth of the poses")
    parser.add_argument(
        "--lanes", type=int, nargs="?", const=POSES, metavar="POSES",
        help="only: eight poses at once beside one, their speed and their answers at this many random poses per robot",
    )  # fmt: skip
    parser.add_argument(
        "--settling", type=int, nargs="?", const=BATCH, metavar="POSES",
        help="only: settling with and without Newton's method at its end, and checks, at this many poses per robot",
    )  # fmt: skip
    parser.add_argument(
        "--sagging", type=int, nargs="?", const=SAGGING, metavar="POSES",
        help="only: settling on cables with mass, at this many poses per robot",
    )  # fmt: skip
    parser.add_argument("--calls", action="store_true", help="only: what single calls and large batches take")
    asked = parser.parse_args()
    share = 10 if asked.quick else 1
    if asked.lanes or asked.settling or asked.sagging or asked.calls:
        if asked.lanes:
            lanes(asked.lanes)
        if asked.settling:
            settling(asked.settling)
        if asked.sagging:
            sagging(asked.sagging)
        if asked.calls:
            calls(share)
        return
    static(POSES // share, max(SCIPY_POSES // share, 10))
    neighbours(LINES // share)
    physics(SETTLES // share, BATCH // share)
    sagging(SAGGING // share)
    calls(share)


def static(poses: int, scipy_poses: int) -> None:
    """Solved poses, iterations and time of Newton's method, and of the paper's solvers for the same poses."""
    ours = table(
        f"Newton, {poses:,} random poses per row",
        "robot", "EA [N]", "solved", "stable", "neutral", "largest residual [N]", "iterations", "most", "µs per pose",
    )  # fmt: skip
    theirs = table(
        f"SEECR, the first {scipy_poses} of those poses",
        "robot", "EA [N]", "fsolve fails", "ms per pose", "least_squares fails", "ms per pose",
        "Newton fails", "ms per pose",
    )  # fmt: skip
    for name in ROBOTS:
        robot = cdpr.load_robot(name)
        lower, upper = robot.workspace
        positions = np.random.default_rng(SEED).uniform(lower, upper, (poses, 3))
        newton.solve_many(robot, positions[:100])  # compile
        for stiffness in STIFFNESSES:
            stiff = robot.replace(axial_stiffness=stiffness)
            seconds = [timed(newton.solve_many, stiff, positions) for _ in range(REPETITIONS)]
            solutions = newton.solve_many(stiff, positions)
            stability = solutions.stability
            ours.add_row(
                name,
                f"{stiffness:.0e}",
                f"{solutions.converged.sum():,}",
                f"{(stability == cdpr.Stability.STABLE).mean():.1%}",
                f"{(stability == cdpr.Stability.NEUTRAL).mean():.1%}",
                f"{solutions.residuals.max():.1e}",
                f"{solutions.iterations.mean():.1f}",
                f"{solutions.iterations.max()}",
                f"{1e6 * np.median(seconds) / poses:.2f}",
            )
            some = [cdpr.Problem.of(stiff, position) for position in positions[:scipy_poses]]
            theirs.add_row(
                name,
                f"{stiffness:.0e}",
                *failures(partial(seecr.solve, solver="fsolve"), some),
                *failures(partial(seecr.solve, solver="least_squares"), some),
                *failures(newton.solve, some),
            )
    console.print(ours)
    console.print(theirs)


def lanes(poses: int) -> None:
    """Speed of the solver for eight poses at once beside that for one, and all poses where their answers differ."""
    rows = table(
        f"Eight poses at once beside one, {poses:,} random poses per robot; processor time; "
        f"this machine multiplies and adds {peak():,.0f} times in a nanosecond",
        "robot", "µs, one", "µs, eight", "ratio", "same iterations", "not stable", "further apart", "of those stable",
    )  # fmt: skip
    for name in cdpr.list_robots():
        robot = cdpr.load_robot(name)
        if robot.cabling.bent or not robot.cabling.massless:
            continue
        positions = np.random.default_rng(SEED).uniform(robot.workspace[0], robot.workspace[1], (poses, 3))
        found, seconds = {}, {np.inf: [], 1: []}
        for _ in range(REPETITIONS):
            for newton.LANES_FROM in seconds:
                start = time.process_time()
                found[newton.LANES_FROM] = newton.solve_many(robot, positions)
                seconds[newton.LANES_FROM].append(time.process_time() - start)
        one, eight = found[np.inf], found[1]
        apart = np.abs(one.positions - eight.positions).max(-1) > APART
        apart |= np.abs(one.rotations - eight.rotations).max((-1, -2)) > TURNED
        apart |= one.status != eight.status
        stable = (one.stability == cdpr.Stability.STABLE) & (eight.stability == cdpr.Stability.STABLE)
        same = (one.iterations == eight.iterations).mean()
        slow, fast = (1e6 * min(seconds[number]) / poses for number in (np.inf, 1))
        rows.add_row(
            name, f"{slow:.2f}", f"{fast:.2f}", f"{slow / fast:.1f}", f"{same:.2%}",
            f"{(~stable).mean():.1%}", f"{apart.sum():,}", f"{(apart & stable).sum():,}",
        )  # fmt: skip
        for row in np.flatnonzero(apart & stable)[:5]:
            console.print(
                name, positions[row], "apart by", np.abs(one.positions[row] - eight.positions[row]).max(),
                "eigenvalues", one.eigenvalues[row][[0, -1]], "residuals", one.residuals[row], eight.residuals[row],
            )  # fmt: skip
    console.print(rows)


def calls(share: int) -> None:
    """Processor time of calls whose speed users notice, and how much faster two threads are than one."""
    rows = table(
        f"Single calls and large batches; least processor time of {REPETITIONS}; "
        f"this machine multiplies and adds {peak():,.0f} times in a nanosecond",
        "call", "robot", "unit", "time", "two threads: speed-up",
    )  # fmt: skip
    for name, nearest in NOWHERE_HELD.items():
        robot = cdpr.load_robot(name)
        poses = np.random.default_rng(SEED).uniform(robot.workspace[0], robot.workspace[1], (POSES // share, 3))
        for call, unit, count, function in calls_of(robot, nearest, poses):
            function()
            seconds = []
            for _ in range(REPETITIONS):
                start = time.process_time()
                function()
                seconds.append(time.process_time() - start)
            speed_up = ""
            if isinstance(function, partial):
                one, two = (min(timed(function, threads=n) for _ in range(REPETITIONS)) for n in (1, 2))
                speed_up = f"{one / two:.2f}"
            rows.add_row(call, name, unit, f"{min(seconds) / count:.3g}", speed_up)
    console.print(rows)


def calls_of(
    robot: cdpr.Robot, nearest: tuple[float, float, float], poses: np.ndarray
) -> list[tuple[str, str, float, Callable[..., object]]]:
    """Name, unit and how many of it one call takes per second; those that take threads are ``partial``."""
    few, lengths = poses[:200], [robot.rest_lengths(pose) for pose in poses[:200]]
    single, each = len(few) * 1e-6, len(poses) * 1e-6
    return [
        ("rest_lengths", "µs", single, lambda: [robot.rest_lengths(pose) for pose in few]),
        ("winch_controls", "µs", single, lambda: [cdpr.winch_controls(robot, robot.home, rest) for rest in lengths]),
        ("compensate, no exact answer", "ms", 1e-3, lambda: cdpr.compensate(robot, nearest)),
        ("find_equilibria, saddles", "s", 1.0, lambda: cdpr.find_equilibria(robot, robot.home, saddles=True)),
        ("solve_many", "µs a pose", each, partial(cdpr.solve_many, robot, poses)),
        ("shortfall", "µs a pose", each, partial(cdpr.shortfall, robot, poses)),
        ("sweep, all quantities", "µs a pose", each, lambda: cdpr.sweep(robot, poses=poses)),
    ]


def peak() -> float:
    """Largest number of products with sums per nanosecond of one core: a plain loop, vectorised by the compiler."""
    import numba

    @numba.njit(fastmath=True)
    def chains(times, factor):
        sums = np.ones(64)
        for i in range(64):
            sums[i] = i
        for _ in range(times):
            for i in range(64):
                sums[i] = sums[i] * factor + 0.001
        return sums

    rates, times = [], 2_000_000
    chains(1, 0.999)
    for _ in range(REPETITIONS):
        start = time.process_time()
        chains(times, 0.999)
        rates.append(64e-9 * times / (time.process_time() - start))
    return max(rates)


def neighbours(lines: int) -> None:
    """Iterations from the neighbour's solution instead of the commanded pose, and how often the solution differs."""
    rows = table(
        f"Newton along {lines} lines, a pose every millimetre, from the commanded pose or from the previous solution",
        "robot", "poses", "iterations", "from the neighbour", "other solutions",
    )  # fmt: skip
    for name in ROBOTS:
        robot = cdpr.load_robot(name)
        lower, upper = robot.workspace
        starts = np.random.default_rng(SEED).uniform(lower, upper, (lines, 3))
        along = np.arange(lower[0], upper[0], 1e-3)
        counts, iterations, others = [], [], 0
        before = found = None
        for x in along:
            starts[:, 0] = x
            own = cdpr.solve_many(robot, starts)
            if before is not None:
                lengths = own.rest_lengths
                found = cdpr.solve_many(robot, before.positions, rotations=before.rotations, rest_lengths=lengths)
                turned = np.linalg.norm(found.rotations - own.rotations, axis=(-1, -2))
                moved = np.linalg.norm(found.positions - own.positions, axis=-1)
                others += int(((moved > 1e-6) | (turned > 1e-5)).sum())
                counts.append(own.iterations.mean())
                iterations.append(found.iterations.mean())
            before = own if before is None else found
        poses = lines * (len(along) - 1)
        rows.add_row(
            name, f"{poses:,}", f"{np.mean(counts):.2f}", f"{np.mean(iterations):.2f}", f"{others / poses:.1%}"
        )
    console.print(rows)


def failures(solve: Callable[[cdpr.Problem], object], problems: list[cdpr.Problem]) -> tuple[str, str]:
    """Fraction of problems without an equilibrium, and the median time of a single solve."""
    failed, seconds = 0, []
    for problem in problems:
        start = time.perf_counter()
        try:
            solve(problem)
        except cdpr.NotConverged:
            failed += 1
        seconds.append(time.perf_counter() - start)
    return f"{failed / len(problems):.0%}", f"{1e3 * np.median(seconds):.2f}"


def physics(settles: int, batch: int) -> None:
    """Time to settle poses one by one, and in batches on threads."""
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    rows = table(
        f"MuJoCo, {settles} poses settled one by one and a batch of {batch:,} per row",
        "robot", "EA [N]", "settled", "steps", "most", "ms per settle", "settles/s, 1 thread",
        f"per core, {cores} threads", "residual/weight",
    )  # fmt: skip
    for name in ROBOTS:
        for material in cdpr.MATERIALS:
            robot = cdpr.load_robot(name).replace(material=material)
            lower, upper = robot.workspace
            positions = np.random.default_rng(SEED).uniform(lower, upper, (batch, 3))
            cdpr.settle(robot, positions[0])  # compile the model
            single = [timed(cdpr.settle, robot, position) for position in positions[:settles]]
            one, all_cores = (
                np.median([timed(cdpr.settle_many, robot, positions, threads=threads) for _ in range(REPETITIONS)])
                for threads in (1, 0)
            )
            many = cdpr.settle_many(robot, positions)
            rows.add_row(
                name,
                f"{robot.axial_stiffness[0]:.0e}",
                f"{many.converged.sum():,} of {batch:,}",
                f"{np.median(many.iterations):.0f}",
                f"{many.iterations.max()}",
                f"{1e3 * np.median(single):.2f}",
                f"{batch / one:,.0f}",
                f"{batch / all_cores / cores:,.0f}",
                f"{many.residuals.max() / robot.weight:.1e}",
            )
    console.print(rows)


def settling(poses: int) -> None:
    """Processor time to settle with and without Newton's method, how far the equilibria differ, and to check."""
    rows = table(
        f"Settling {poses:,} random poses on one thread, by motion alone and with Newton's method; processor time",
        "robot", "steps, motion", "1/s", "steps, Newton", "1/s", "apart [m]", "checks, 1/s",
    )  # fmt: skip
    for name in [*ROBOTS, "ipanema-1", "falcon-7"]:
        robot = cdpr.load_robot(name)
        positions = np.random.default_rng(SEED).uniform(robot.workspace[0], robot.workspace[1], (poses, 3))
        cdpr.check(robot, poses=positions[:200], threads=1)  # compile
        found, rates, ready = {}, {}, dynamic_relaxation.READY
        for dynamic_relaxation.READY in (0.0, ready):
            seconds = []
            for _ in range(REPETITIONS):
                start = time.process_time()
                found[dynamic_relaxation.READY] = cdpr.settle_many(robot, positions, threads=1)
                seconds.append(time.process_time() - start)
            rates[dynamic_relaxation.READY] = poses / min(seconds)
        start = time.process_time()
        cdpr.check(robot, poses=positions, threads=1)
        checks = poses / (time.process_time() - start)
        apart = np.nanmax(np.abs(found[0.0].positions - found[ready].positions))
        rows.add_row(
            name, f"{found[0.0].iterations.mean():.1f}", f"{rates[0.0]:,.0f}", f"{found[ready].iterations.mean():.1f}",
            f"{rates[ready]:,.0f}", f"{apart:.0e}", f"{checks:,.0f}",
        )  # fmt: skip
    console.print(rows)


def sagging(poses: int) -> None:
    """Time to settle on cables with mass, one by one and side by side on threads."""
    rows = table(
        f"MuJoCo, cables with mass, {poses} random poses in the middle half of the workspace",
        "robot", "ms per settle", "settles/s, 1 thread", "1/s of processor", "2 threads", "settled", "most steps",
    )  # fmt: skip
    robots = {
        "cogiro": cdpr.load_robot("cogiro").replace(linear_density=5e-3),
        "parallel": cdpr.load_robot("parallel").replace(linear_density=5e-3),
        "cogiro over wheels": cdpr.load_robot("cogiro").replace(
            linear_density=5e-3, pulley_radius=0.01, pulley_axis=(0, 0, -1)
        ),
        "cogiro-crane": cdpr.load_robot("cogiro-crane").replace(linear_density=0.064),
        "cogiro-crane-built": cdpr.load_robot("cogiro-crane-built"),
    }
    for name, robot in robots.items():
        middle, quarter = robot.workspace.mean(0), np.ptp(robot.workspace, axis=0) / 4
        positions = np.random.default_rng(SEED).uniform(middle - quarter, middle + quarter, (poses, 3))
        cdpr.settle(robot, positions[0])  # compile the model
        single = [timed(cdpr.settle, robot, position) for position in positions[: max(poses // 8, 4)]]
        one, two = (
            min(timed(cdpr.settle_many, robot, positions, threads=threads) for _ in range(REPETITIONS))
            for threads in (1, 2)
        )
        start = time.process_time()
        many = cdpr.settle_many(robot, positions, threads=1)
        processor = time.process_time() - start
        rows.add_row(
            name,
            f"{1e3 * np.median(single):.1f}",
            f"{poses / one:,.0f}",
            f"{poses / processor:,.0f}",
            f"{poses / two:,.0f}",
            f"{many.converged.sum():,} of {poses:,}",
            f"{many.iterations.max()}",
        )
    console.print(rows)


def timed(call: Callable[..., object], *arguments: object, **keywords: object) -> float:
    """Time of a call [s]."""
    start = time.perf_counter()
    call(*arguments, **keywords)
    return time.perf_counter() - start


def table(title: str, *columns: str) -> Table:
    """Return an empty table with these columns."""
    made = Table(title=title, title_justify="left", box=box.SIMPLE_HEAD, pad_edge=False)
    for column in columns:
        made.add_column(escape(column), justify="right")
    return made


if __name__ == "__main__":
    main()

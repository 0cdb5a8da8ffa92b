"""Benchmark: speed and reliability of the static solvers and of MuJoCo in one run.

Run: python scripts/benchmarks/benchmark_solvers.py [--quick] [--kinds [POSES]] [--settling [POSES]]
Times are medians over repetitions on one core unless stated otherwise. Timings vary between runs: compare ratios.
"""

import argparse
import os
import time
import timeit
from collections.abc import Callable, Iterable
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
LINES = 100  # lines through the workspace along x, with a pose every millimetre
REPETITIONS = 3
WHEEL = 0.05  # radius of pulleys, in characteristic lengths
NONLINEAR = (20.0, 500.0)  # stiffening
DENSITY = 0.02  # [kg/m]
SEED = 2024

console = Console(width=120)


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="a tenth of the poses")
    parser.add_argument(
        "--kinds", type=int, nargs="?", const=POSES, metavar="POSES",
        help="only: Newton's method by kinds of cables, at this many random poses per robot",
    )  # fmt: skip
    parser.add_argument("--robots", nargs="*", default=ROBOTS, metavar="NAME", help="of --kinds; default: both")
    parser.add_argument(
        "--settling", type=int, nargs="?", const=BATCH, metavar="POSES",
        help="only: settling with and without Newton's method at its end, and checks, at this many poses per robot",
    )  # fmt: skip
    options = parser.parse_args()
    share = 10 if options.quick else 1
    if options.kinds or options.settling:
        if options.kinds:
            kinds(options.kinds, options.robots)
        if options.settling:
            settling(options.settling)
        return
    static(POSES // share, max(SCIPY_POSES // share, 10))
    neighbours(LINES // share)
    physics(SETTLES // share, BATCH // share)


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
            seconds = timeit.repeat(partial(newton.solve_many, stiff, positions), number=1, repeat=REPETITIONS)
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


def kinds(poses: int, names: Iterable[str]) -> None:
    """Processor time of each pose on one thread, by the kinds of cables that each robot may have."""
    rows = table(
        f"Newton, {poses:,} random poses per robot, a tenth of them with mass; processor time, one thread",
        "robot", "cables", "solved", "iterations", "µs per pose",
    )  # fmt: skip
    for name in names:
        robot = cdpr.load_robot(name)
        positions = np.random.default_rng(SEED).uniform(robot.workspace[0], robot.workspace[1], (poses, 3))
        some = {
            "as they are": robot,
            "over pulleys": robot.replace(pulley_radius=WHEEL * robot.characteristic_length),
            "nonlinear": robot.replace(stiffening=NONLINEAR),
            "with mass": robot.replace(linear_density=DENSITY),
        }
        for kind, one in some.items():
            asked = positions if one.cabling.massless else positions[: poses // 10]
            seconds = []
            for _ in range(REPETITIONS):
                start = time.process_time()
                found = newton.solve_many(one, asked, threads=1)
                seconds.append(time.process_time() - start)
            rows.add_row(
                name, kind, f"{found.converged.mean():.2%}", f"{found.iterations.mean():.1f}",
                f"{1e6 * np.median(seconds) / len(asked):.2f}",
            )  # fmt: skip
    console.print(rows)


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
            single = [
                timeit.timeit(partial(cdpr.settle, robot, position), number=1) for position in positions[:settles]
            ]
            one, all_cores = (
                np.median(
                    timeit.repeat(
                        partial(cdpr.settle_many, robot, positions, threads=threads), number=1, repeat=REPETITIONS
                    )
                )
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
        "robot", "steps, motion", "1/s", "steps, Newton", "1/s", "difference [m]", "checks, 1/s",
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
        difference = np.nanmax(np.abs(found[0.0].positions - found[ready].positions))
        rows.add_row(
            name, f"{found[0.0].iterations.mean():.1f}", f"{rates[0.0]:,.0f}", f"{found[ready].iterations.mean():.1f}",
            f"{rates[ready]:,.0f}", f"{difference:.0e}", f"{checks:,.0f}",
        )  # fmt: skip
    console.print(rows)


def table(title: str, *columns: str) -> Table:
    """Return an empty table with these columns."""
    made = Table(title=title, title_justify="left", box=box.SIMPLE_HEAD, pad_edge=False)
    for column in columns:
        made.add_column(escape(column), justify="right")
    return made


if __name__ == "__main__":
    main()

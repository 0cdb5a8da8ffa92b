"""Benchmark of sweeps, feasible workspaces and checks over whole workspaces. Run it on an idle machine.

python scripts/benchmark_sweep.py            # everything: a few minutes on 2 cores
python scripts/benchmark_sweep.py --quick    # without 10⁷ poses, and with a smaller check
"""

from __future__ import annotations

import argparse
import multiprocessing
import os
import resource
import statistics
import tempfile
import time
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import numpy as np

ROBOT, AXIAL_STIFFNESS = "parallel", 10e3  # [N]
GRIDS = {10**4: (40, 25, 10), 10**5: (100, 50, 20), 10**6: (200, 100, 50), 10**7: (400, 250, 100)}  # poses
IN_MEMORY = 10**6  # poses; more are written to Zarr
REPEATS = 3
PAIRS = 5  # for ratios: with and without Dask alternately, under the same load of the machine
CHECK_GRID, QUICK_CHECK_GRID = (40, 25, 10), (20, 13, 6)
SWEEP, FEASIBLE = (12, 9, 10, 9, 13, 11, 15), (12, 14, 12, 9, 15, 8)  # widths of the tables' columns
MATERIALS = ["vectran-0.7mm", "fishing-0.4mm"]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true")
    quick = parser.parse_args().quick
    print(f"{os.cpu_count()} cores, load {os.getloadavg()[0]:.1f}; medians of {REPEATS}\n")

    print(f"Sweep of {ROBOT}, EA = {AXIAL_STIFFNESS:g} N, all quantities, end to end; each in a process of its own")
    _print_row(SWEEP, "poses", "into", "wall [s]", "us/pose", "CPU us/pose", "peak [MB]", "growth [MB]")
    for poses in GRIDS:
        if poses > IN_MEMORY and quick:
            continue
        runs = [in_process(sweep, poses) for _ in range(REPEATS if poses <= IN_MEMORY else 1)]
        wall, cpu, peak, grown = (statistics.median(column) for column in zip(*runs, strict=True))
        into = "memory" if poses <= IN_MEMORY else "Zarr"
        per_pose = [f"{1e6 * seconds / poses:.1f}" for seconds in (wall, cpu)]
        _print_row(SWEEP, f"{poses:,}", into, f"{wall:.2f}", *per_pose, f"{peak:.0f}", f"{grown:.0f}")

    overheads = in_process(dask_overheads, 10**6 if not quick else 10**5)
    print(
        f"\nOverhead of Dask on one core: {100 * statistics.median(overheads):+.1f} % "
        f"(median of {PAIRS}, {100 * min(overheads):+.1f} to {100 * max(overheads):+.1f} %)"
    )

    print("\nStatic feasible workspace, one core")
    _print_row(FEASIBLE, "robot", "limits [N]", "poses/s", "us/pose", "by HiGHS [us]", "ratio")
    for robot in ("parallel", "cogiro"):
        for limits in ((0.0, np.inf), (0.1, 3.0)):
            fast, slow = in_process(feasibility, robot, limits)
            between = f"{limits[0]:g} to {limits[1]:g}"
            values = f"{1 / fast:,.0f}", f"{1e6 * fast:.2f}", f"{1e6 * slow:.0f}", f"{slow / fast:.0f}x"
            _print_row(FEASIBLE, robot, between, *values)

    grid = QUICK_CHECK_GRID if quick else CHECK_GRID
    wall, poses, counts, disagreements = in_process(check, grid)
    print(f"\nCheck of parallel and cogiro, both materials: {poses:,} poses settled and compared in {wall:.1f} s")
    print(f"  {1e3 * wall / poses:.2f} ms per pose; {counts}; disagreements: {disagreements}")


def _print_row(widths: tuple[int, ...], *cells: str) -> None:
    print("".join(f"{cell:>{width}}" for cell, width in zip(cells, widths, strict=True)))


def in_process(function: Callable, *arguments):
    """Return the result of ``function`` in a new process: with its own memory, and no cache except compiled code."""
    with ProcessPoolExecutor(1, mp_context=multiprocessing.get_context("spawn")) as pool:
        return pool.submit(function, *arguments).result()


def the_robot():
    import cdpr_sim as cdpr

    return cdpr.load_robot(ROBOT).replace(axial_stiffness=AXIAL_STIFFNESS)


def sweep(poses: int) -> tuple[float, float, float, float]:
    """Wall time [s], CPU time [s], peak resident memory [MB] and its growth over the warm interpreter [MB]."""
    import cdpr_sim as cdpr

    robot = the_robot()
    cdpr.sweep(robot, (4, 3, 2))  # imports the package and loads the compiled code
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    with tempfile.TemporaryDirectory() as folder:
        store = Path(folder) / "sweep.zarr" if poses > IN_MEMORY else None
        wall, cpu = time.perf_counter(), time.process_time()
        dataset = cdpr.sweep(robot, GRIDS[poses], store=store)
        wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
        assert dataset["tilt"].size == poses
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    return wall, cpu, peak, peak - before


def dask_overheads(poses: int) -> list[float]:
    """CPU time with Dask on one thread divided by that of one NumPy call, minus 1."""
    from dask.config import set as configured

    import cdpr_sim as cdpr

    robot = the_robot()
    cdpr.sweep(robot, (4, 3, 2))
    ratios = []
    for _ in range(PAIRS):
        start = time.process_time()
        cdpr.sweep(robot, GRIDS[poses], chunk=None)
        alone = time.process_time() - start
        start = time.process_time()
        with configured(scheduler="synchronous"):
            cdpr.sweep(robot, GRIDS[poses])
        ratios.append((time.process_time() - start) / alone - 1)
    return ratios


def feasibility(name: str, limits: tuple[float, float]) -> tuple[float, float]:
    """CPU time per pose [s] of the fast method and of HiGHS."""
    import cdpr_sim as cdpr
    from cdpr_sim.analysis.workspace.feasibility import feasible_by_linprog

    robot = cdpr.load_robot(name)
    positions = np.random.default_rng(0).uniform(robot.workspace[0], robot.workspace[1], (100_000, 3))
    cdpr.feasible(robot, positions[:10], tension_limits=limits)
    times = []
    for _ in range(REPEATS):
        start = time.process_time()
        cdpr.feasible(robot, positions, tension_limits=limits)
        times.append((time.process_time() - start) / len(positions))
    start = time.process_time()
    for position in positions[:200]:
        feasible_by_linprog(robot, position, tension_limits=limits)
    return statistics.median(times), (time.process_time() - start) / 200


def check(grid: tuple[int, int, int]) -> tuple[float, int, str, int]:
    """Wall time [s], number of poses, outcomes as text, and the number of disagreements."""
    import cdpr_sim as cdpr
    from cdpr_sim.crosscheck.check import OUTCOMES

    cdpr.check("cogiro", (2, 1, 1))
    start = time.perf_counter()
    result = cdpr.check(["parallel", "cogiro"], grid, MATERIALS)
    wall = time.perf_counter() - start
    codes, numbers = np.unique(result.dataset["outcome"], return_counts=True)
    counts = ", ".join(f"{n:,} {OUTCOMES[code].replace('_', ' ')}" for code, n in zip(codes, numbers, strict=True))
    return wall, result.dataset["outcome"].size, counts, len(result.disagreements)


if __name__ == "__main__":
    main()

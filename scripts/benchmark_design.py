"""Benchmark of layout evaluation: layouts per second, compared with SciPy's solvers. Prints two tables.

Run on an idle machine: python scripts/benchmark_design.py
"""

import os
import statistics
import time
from typing import Literal

import numpy as np

import cdpr_sim as cdpr
from cdpr_sim.core.robot_batch import RobotBatch
from cdpr_sim.design import search
from cdpr_sim.design.layout_equilibria import Cases, solve_layouts
from cdpr_sim.design.moves import Move, Space

ROBOT = "parallel"
POSES = [(x, 0.25, 0.1) for x in np.linspace(0.17, 0.63, 18)]  # m, along the paper's line
NEAR, BOX = 0.05, [[0.0, 0.0, 0.4], [0.8, 0.5, 0.5]]  # m: around the exits; in the top of the frame
LAYOUTS, REPEATS = 3000, 5
FSOLVE_LAYOUTS = 40
GENERATIONS = 100


def main() -> None:
    robot = cdpr.load_robot(ROBOT)
    cases = Cases.of(robot, POSES)
    spaces = {
        "exits within 50 mm": Space.of(robot, [Move("exits", NEAR)]),
        "anywhere in the frame's top": Space.of(robot, [Move("exits", BOX)]),
    }
    rng = np.random.default_rng(0)
    sets = {
        name: space.layouts(rng.uniform(space.lower, space.upper, (LAYOUTS, len(space))))
        for name, space in spaces.items()
    }
    sets["layouts of a search"] = tried(robot)
    solve_layouts(sets["exits within 50 mm"].take(slice(0, 5)), cases)  # compiles
    cores = os.cpu_count() or 1
    print(f"{ROBOT}, {len(POSES)} poses; {cores} cores, load {os.getloadavg()[0]:.1f}; medians of {REPEATS}\n")
    columns = ("one core [1/s]", "by CPU time", "all cores [1/s]", "iterations", "unsolved")
    print(f"{'worst tilt of random layouts':>32}" + "".join(f"{column:>17}" for column in columns))
    for name, layouts in sets.items():
        one, all_cores = (rates(layouts, cases, threads) for threads in (1, cores))
        found = solve_layouts(layouts, cases)
        lost = int((~found.converged).any(1).sum())
        numbers = [*(f"{rate:,.0f}" for rate in (*one, all_cores[0])), f"{found.iterations.mean():.1f}", str(lost)]
        print(f"{name:>32}" + "".join(f"{number:>17}" for number in numbers))
    print(f"\n{'the same with one pose at a time':>32} {'layouts/s':>15} {'unsolved':>12} {'of layouts':>16}")
    for name in spaces:
        layouts = sets[name].take(slice(0, FSOLVE_LAYOUTS))
        for method in ("fsolve", "least_squares"):
            rate, failed = one_by_one(layouts, method)
            print(f"{name:>32} {rate:>15.1f} {failed:>12} {len(layouts):>16}   {method}")


def rates(layouts: RobotBatch, cases: Cases, threads: int) -> tuple[float, float]:
    """Layouts per second, by wall time and by processor time."""
    runs = []
    for _ in range(REPEATS):
        wall, busy = time.perf_counter(), time.process_time()
        solve_layouts(layouts, cases, threads).tilt.max(-1)
        runs.append((len(layouts) / (time.perf_counter() - wall), len(layouts) / (time.process_time() - busy)))
    return statistics.median(run[0] for run in runs), statistics.median(run[1] for run in runs)


def tried(robot: cdpr.Robot) -> RobotBatch:
    """The layouts that a search evaluates, in its order."""
    seen: list[RobotBatch] = []

    def noted(layouts, cases, threads=None):
        seen.append(layouts)
        return solve_layouts(layouts, cases, threads)

    search.solve_layouts = noted
    try:
        cdpr.find_layout(robot, POSES, move=Move("exits", BOX), generations=GENERATIONS, polish=False)
    finally:
        search.solve_layouts = solve_layouts
    names = ("exits", "anchors", "axial_stiffness", "linear_density", "center_of_mass")
    return RobotBatch(robot, *(np.concatenate([getattr(one, name) for one in seen]) for name in names))


def one_by_one(layouts: RobotBatch, method: Literal["fsolve", "least_squares"]) -> tuple[float, int]:
    """Layouts per second, and the number of layouts with a pose that the solver does not solve."""
    failed, began = 0, time.perf_counter()
    for row in range(len(layouts)):
        robot = layouts.robot_at(row)
        try:
            max(cdpr.solve(robot, pose, method=method).tilt for pose in POSES)
        except cdpr.NotConverged:
            failed += 1
    return len(layouts) / (time.perf_counter() - began), failed


if __name__ == "__main__":
    main()

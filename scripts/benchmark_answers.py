"""Benchmark of compensation, sensitivities, modes, equilibria and identification: median times in milliseconds."""

import statistics
import time
from collections.abc import Callable

import numpy as np

import cdpr_sim as cdpr

REPEATS = 7
ROBOTS = ("cogiro", "parallel")
POSE = (0.25, 0.22, 0.1)  # m


def median(call: Callable[[], object]) -> float:
    """Milliseconds per call, without the first call, which compiles."""
    call()
    times = []
    for _ in range(REPEATS):
        start = time.perf_counter()
        call()
        times.append(time.perf_counter() - start)
    return 1e3 * statistics.median(times)


def main() -> None:
    for name in ROBOTS:
        robot = cdpr.load_robot(name)
        found = cdpr.solve(robot, POSE)
        commanded = np.random.default_rng(0).uniform([0.3, 0.15, 0.05], [0.5, 0.35, 0.3], (12, 3))
        measured = np.array([cdpr.solve(robot.replace(axial_stiffness=8e3), pose).position for pose in commanded])
        measurements = cdpr.Measurements.of(commanded, measured, coordinates=("x", "y", "z"))
        solving = median(lambda robot=robot: cdpr.solve(robot, POSE))
        calls: dict[str, Callable[[], object]] = {
            "compensate": lambda robot=robot: cdpr.compensate(robot, POSE),
            "compensate, stiffest": lambda robot=robot: cdpr.compensate(robot, POSE, prefer="stiffest"),
            "sensitivity": lambda found=found: cdpr.sensitivity(found),
            "natural_modes": lambda found=found: cdpr.natural_modes(found),
            "follow_load": lambda robot=robot: cdpr.follow_load(robot, POSE),
            "find_equilibria, 2000 starts": lambda robot=robot: cdpr.find_equilibria(robot, POSE),
            "identify EA, 12 poses": lambda robot=robot, data=measurements: cdpr.identify(robot, data),
        }
        print(f"{name}: one solve {solving:.2f} ms")
        for what, call in calls.items():
            taken = median(call)
            print(f"  {what:30} {taken:9.2f} ms, {taken / solving:8.1f} solves")


if __name__ == "__main__":
    main()

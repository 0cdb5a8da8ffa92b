"""Processor seconds of motions for each simulated second, on cables of any kind, beside another checkout.

python scripts/benchmarks/benchmark_motion.py [OTHER_CHECKOUT]
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

import cdpr_sim as cdpr

REPEATS = 2
"""Of each motion, alternately in both checkouts; the least time counts."""

KINDS: dict[str, dict[str, Any]] = {
    "linear": {},
    "over wheels": {"pulley_radius": 0.01},
    "nonlinear": {"stiffening": (3.0, 2.0)},
    "with mass": {"linear_density": 5e-4},
    "with memory": {"hysteresis": [(0.2, np.inf, 0.3)]},
}


def timed(move: Callable[[], object], seconds: float) -> float:
    """Processor time of a motion, by its duration."""
    start = time.process_time()
    move()
    return (time.process_time() - start) / seconds


def measured() -> dict[str, float]:
    """One measurement of each motion."""
    found = {}
    for name, kind in [("cogiro", kind) for kind in KINDS] + [("parallel", "linear")]:
        moved = motions(cdpr.load_robot(name).replace(**KINDS[kind]))
        found |= {f"{motion} {name}, {kind}": spent for motion, spent in moved.items()}
    return found


def motions(robot: cdpr.Robot) -> dict[str, float]:
    """``timed`` motions of one robot, of those that its cables allow."""
    line, tracked = [robot.home, robot.home + np.array([0.05, 0.0, 0.0])], cdpr.RigidLengths(robot)
    found = {"track": timed(lambda: cdpr.track(robot, line, tracked, seconds=0.3), 0.3)}
    if robot.hysteresis.size == 0:
        rest = cdpr.solve(robot, robot.home)
        found["drive"] = timed(lambda: cdpr.drive(robot, line, seconds=1.0, states=31), 1.0)
        found["release"] = timed(lambda: cdpr.release(rest, seconds=0.3), 0.3)
    return found


def measure_in(checkout: Path) -> dict[str, float]:
    """``measured`` with the package of a checkout."""
    words = {**os.environ, "PYTHONPATH": str(checkout), "OMP_NUM_THREADS": "1"}
    command = [sys.executable, __file__, "--one"]
    return json.loads(subprocess.run(command, env=words, cwd=checkout, capture_output=True, check=True).stdout)


def main() -> None:
    """Print the table."""
    if sys.argv[1:] == ["--one"]:
        measured()  # compiles
        print(json.dumps(measured()))
        return
    checkouts = [Path(__file__).resolve().parents[2], *map(Path, sys.argv[1:2])]
    runs = [[measure_in(checkout.resolve()) for checkout in checkouts] for _ in range(REPEATS)]
    for name in runs[0][0]:
        least = [min(run[k][name] for run in runs) for k in range(len(checkouts))]
        print(f"{name:28s}" + "".join(f"{one:9.4f}" for one in least), f"{least[0] / least[-1]:6.2f}")


if __name__ == "__main__":
    main()

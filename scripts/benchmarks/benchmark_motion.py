"""Processor time of settling and of motions in MuJoCo, on cables of any kind, and equilibria, beside another checkout.

python scripts/benchmarks/benchmark_motion.py [OTHER_CHECKOUT]

Random robots are those of ``scripts/research``; without isolated equilibria, two checkouts may find different ones.
"""

# pyright: reportMissingImports=false
# Random robots are imported from the folders of the tests and of the research scripts.

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
import warnings
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

import cdpr_sim as cdpr

REPEATS = 2
"""Of each measurement, alternately in both checkouts; the least time counts."""

ONE, MANY, HEAVY = 20, 500, 40
"""Poses settled one by one; in a batch; in one on cables with mass."""

ROBOTS, EXTREME = 40, 210
"""Random robots that settle one by one: of each kind with mass; extreme ones on massless cables."""

SAME = 1e-5
"""Largest distance of two equal equilibria, in mean rest lengths, and of their rotation matrices."""

KINDS: dict[str, dict[str, Any]] = {
    "linear": {},
    "over wheels": {"pulley_radius": 0.01},
    "nonlinear": {"stiffening": (3.0, 2.0)},
    "with mass": {"linear_density": 5e-4},
    "with memory": {"hysteresis": [(0.2, np.inf, 0.3)]},
}

CASES = [*(("cogiro", kind) for kind in KINDS), *(("parallel", kind) for kind in KINDS), ("ipanema-1", "linear")]


def spent(move: Callable[[], object], per: float = 1.0) -> float:
    """Processor time of a call [s], over a number."""
    start = time.process_time()
    move()
    return (time.process_time() - start) / per


def measured() -> dict[str, float]:
    """One measurement of each call [s]: of an equilibrium, or of a second of motion."""
    found = {}
    for name, kind in CASES:
        robot = cdpr.load_robot(name).replace(**KINDS[kind])
        calls = settlings(robot) | (motions(robot) if name == "cogiro" or kind == "linear" else {})
        found |= {f"{call}, {name}, {kind}": seconds for call, seconds in calls.items()}
    return found


def settlings(robot: cdpr.Robot) -> dict[str, float]:
    """Of one robot: one by one, many, and along a path."""
    random, many = np.random.default_rng(0), MANY if not robot.linear_density.any() else HEAVY
    lower, upper = robot.workspace
    poses, path = random.uniform(lower, upper, (ONE, 3)), robot.home + np.linspace([0, 0, 0], [0.05, 0, 0], 9)
    rows = random.uniform(lower, upper, (many, 3))
    return {
        "settle": spent(lambda: [cdpr.settle(robot, pose) for pose in poses], ONE),
        "settle_many": spent(lambda: cdpr.settle_many(robot, rows, threads=1), many),
        "settle_path": spent(lambda: cdpr.settle_path(robot, path, threads=1), len(path)),
    }


def motions(robot: cdpr.Robot) -> dict[str, float]:
    """Of one robot, those that its cables allow."""
    line, tracked = [robot.home, robot.home + np.array([0.05, 0.0, 0.0])], cdpr.RigidLengths(robot)
    found = {"track": spent(lambda: cdpr.track(robot, line, tracked, seconds=0.3), 0.3)}
    if robot.hysteresis.size == 0:
        from cdpr_sim.physics.release import grow_gravity

        rest = cdpr.solve(robot, robot.home)
        found["drive"] = spent(lambda: cdpr.drive(robot, line, seconds=1.0, states=31), 1.0)
        found["release"] = spent(lambda: cdpr.release(rest, seconds=0.3), 0.3)
        found["grow_gravity"] = spent(lambda: grow_gravity(robot, robot.home, seconds=1.0), 1.0)
    return found


def random_problems() -> dict[str, Iterator[cdpr.Problem]]:
    """Kinds of random robots, each at a pose."""
    here = Path(__file__).resolve().parents[1]
    sys.path[:0] = [str(here / "research"), str(here.parent / "tests")]
    import stress_test
    import stress_test_real_cables as real

    def extreme(seed: int) -> cdpr.Problem:
        random = np.random.default_rng([0, seed])
        robot, size = stress_test.robot_of(stress_test.KINDS[seed % len(stress_test.KINDS)], random)
        asked = stress_test.inputs_of(stress_test.KINDS[seed % len(stress_test.KINDS)], robot, size, 1, random)
        first = {name: value[0] for name, value in asked.items()}
        return cdpr.Problem.of(robot, first.pop("poses"), **first)

    def made(make: Callable[[int], cdpr.Problem], count: int) -> Iterator[cdpr.Problem]:
        for seed in range(count):
            try:
                yield make(seed)
            except cdpr.InvalidInput:
                continue

    return {
        "random, with mass": made(real.problem_with_mass, ROBOTS),
        "random, of all kinds": made(real.mixed_problem, ROBOTS),
        "random, extreme": made(extreme, EXTREME),
    }


def rests() -> dict[str, dict[str, Any]]:
    """Of random robots: processor time of all, and status, pose and least stiffness of each."""
    found = {}
    for name, problems in random_problems().items():
        rows, seconds = [], 0.0
        for problem in problems:
            start = time.process_time()
            one = cdpr.settle_many(cdpr.Problems.stack([problem]), threads=1)
            seconds += time.process_time() - start
            place = one.positions[0] / problem.rest_lengths.mean(), one.rotations[0].ravel()
            rows.append((int(one.status[0]), np.concatenate(place).tolist(), float(one.eigenvalues[0, 0])))
        found[name] = {"seconds": seconds, "rows": rows}
    return found


def run_in(checkout: Path, what: str) -> Any:
    """``measured`` or ``rests`` with the package of a checkout."""
    words = {**os.environ, "PYTHONPATH": str(checkout), "OMP_NUM_THREADS": "1"}
    command = [sys.executable, __file__, what]
    return json.loads(subprocess.run(command, env=words, cwd=checkout, capture_output=True, check=True).stdout)


def compare(here: dict[str, dict[str, Any]], beside: dict[str, dict[str, Any]]) -> None:
    """Print how many equilibria are the same."""
    for name, one in here.items():
        counts: Counter[str] = Counter()
        for (status, place, _), (other, there, least) in zip(one["rows"], beside[name]["rows"], strict=True):
            if status != other:
                counts[f"{cdpr.Status(other).name} -> {cdpr.Status(status).name}"] += 1
            elif status == cdpr.Status.CONVERGED:
                same = np.abs(np.subtract(place, there)).max() < SAME
                counts["same" if same else "neutral, elsewhere" if least <= 0 else "elsewhere"] += 1
            else:
                counts["neither settles"] += 1
        times = one["seconds"], beside[name]["seconds"]
        print(f"{name:22s} {times[0]:7.1f} {times[1]:7.1f} s {times[0] / times[1]:6.2f}  {dict(counts)}")


def main() -> None:
    """Print the tables."""
    warnings.simplefilter("ignore", cdpr.ImplausibleRobot)
    if sys.argv[1:] == ["times"]:
        measured()  # compiles
        print(json.dumps(measured()))
        return
    if sys.argv[1:] == ["rests"]:
        print(json.dumps(rests()))
        return
    checkouts = [path.resolve() for path in (Path(__file__).resolve().parents[2], *map(Path, sys.argv[1:2]))]
    runs = [[run_in(checkout, "times") for checkout in checkouts] for _ in range(REPEATS)]
    for name in runs[0][0]:
        least = [1e3 * min(run[k][name] for run in runs) for k in range(len(checkouts))]
        print(f"{name:34s}" + "".join(f"{one:9.2f}" for one in least), f"{least[0] / least[-1]:6.2f}")
    if len(checkouts) == 2:
        compare(*(run_in(checkout, "rests") for checkout in checkouts))


if __name__ == "__main__":
    main()

"""Random robots on cables with mass through both methods, certified from outside either.

Of the solver's answers forces balance, each cable that pulls as it is said to ends at its anchor by Irvine's equations
in extended precision, and the platform returns when it is moved. Where there is no answer there is no rest: least
squares from sixty poses anywhere show how much of the load is left unbalanced at best. In MuJoCo every robot settles,
where the solver has it or at another equilibrium that both methods confirm. Exit status 1 if anything is otherwise.
"""

# pyright: reportMissingImports=false
# What the tests are made of is imported from their folder.

import argparse
import sys
import warnings
from collections import Counter
from pathlib import Path

import numpy as np
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

import cdpr_sim as cdpr

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
from sample_problems import random_robot
from test_heavy_kernel import Case, certify, random_case

SOLVES, SETTLES = 10_000, 300
STARTS, EVALUATIONS = 60, 300
NO_REST = 1e-3  # of the load: what is left unbalanced where nothing balances


def least_unbalanced(case: Case) -> float:
    """The least force that least squares leave on the platform, of the load."""
    robot = case.robot
    load = max(robot.weight, np.abs(case.wrench / robot.units).max())
    random, size = np.random.default_rng(0), np.abs(robot.exits).max()
    found = []
    for turned in Rotation.random(STARTS, rng=random).as_matrix():
        at = random.uniform(-1, 1, 3) * size + robot.exits.mean(0) * [1, 1, 0]

        def left(x: np.ndarray, at: np.ndarray = at, turned: np.ndarray = turned) -> np.ndarray:
            turn = Rotation.from_rotvec(x[3:] / robot.characteristic_length).as_matrix()
            return case.unbalanced(at + x[:3], turn @ turned) / load

        found.append(np.abs(least_squares(left, np.zeros(6), max_nfev=EVALUATIONS, x_scale="jac").fun).max())
    return min(found)


def solves(robots: int) -> list[str]:
    """What is wrong among so many, a line each."""
    wrong, certified, restless = [], 0, []
    for seed in range(robots):
        case = random_case(seed)
        if case.status == cdpr.Status.CONVERGED:
            try:
                certify(case)
                certified += 1
            except AssertionError as error:
                wrong.append(f"solve, robot {seed}: {str(error).splitlines()[0] if str(error) else 'not certified'}")
            continue
        restless.append((seed, least_unbalanced(case)))
        if restless[-1][1] < NO_REST:
            wrong.append(f"solve, robot {seed}: {restless[-1][1]:.0e} of the load can be left, and was not found")
    print(f"{certified:,} of {robots:,} robots on cables with mass solved and certified")
    for seed, left in restless:
        print(f"  robot {seed}, under a torque: nothing balances it to better than {left:.1e} of the load")
    return wrong


def settles(robots: int) -> list[str]:
    """The same of MuJoCo."""
    wrong, verdicts, apart = [], Counter(), []
    for seed in range(robots):
        robot, position, random = random_robot(seed, stiffest=1e6)
        density = 10 ** random.uniform(-4, -1) * robot.mass / robot.rest_lengths(position).sum()
        problem = cdpr.Problem.of(robot.replace(linear_density=density), position)
        try:
            found = cdpr.compare(cdpr.solve(problem), cdpr.settle(problem))
        except (cdpr.NotConverged, cdpr.NotSettled) as error:
            wrong.append(f"settle, robot {seed}: {error}")
            continue
        verdicts[found.verdict] += 1
        if found.verdict is cdpr.Verdict.DISAGREE:
            wrong.append(f"settle, robot {seed}: {'; '.join(found.reasons)}")
        if found.verdict is cdpr.Verdict.AGREE:
            apart.append(found.position_error)
    print(f"{sum(verdicts.values())} of {robots} settled in MuJoCo:")
    for verdict, count in verdicts.items():
        print(f"  {count}: {verdict.value}")
    print(f"  those that agree are {np.median(apart):.0e} m apart in the median, {max(apart):.0e} m at most")
    return wrong


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--solves", type=int, default=SOLVES)
    parser.add_argument("--settles", type=int, default=SETTLES)
    options = parser.parse_args()
    warnings.simplefilter("ignore", cdpr.ImplausibleRobot)
    wrong = solves(options.solves) + settles(options.settles)
    print(*wrong, sep="\n")
    sys.exit(1 if wrong else 0)


if __name__ == "__main__":
    main()

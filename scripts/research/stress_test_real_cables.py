"""Stress test: random robots with cables with mass, solved by both methods and checked by independent computations.

A result of the solver is certified if its forces balance by the oracle of the tests, a separate implementation with an
integral along each cable, and if the platform returns after a displacement. Where the solver finds
no equilibrium, least squares from sixty random poses compute the smallest unbalanced load, which has to be large. In
MuJoCo each robot has to settle at the solver's equilibrium, or at another one that both methods confirm. Otherwise the
exit status is 1.
"""

# pyright: reportMissingImports=false
# Sample problems are imported from the folder of the tests.

import argparse
import sys
import warnings
from collections import Counter
from pathlib import Path

import numpy as np
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

import cdpr_sim as cdpr
from cdpr_sim.statics import forces

sys.path.insert(0, str(Path(__file__).parents[2] / "tests"))
import oracle
from sample_problems import random_robot, unbalanced

SOLVES, MIXES, SETTLES, MIXED_SETTLES = 10_000, 10_000, 300, 560
STARTS, EVALUATIONS = 60, 300
BALANCED = 2e-9  # of the load: where the solver stops
UNBALANCED = 1e-3  # of the load: the smallest unbalanced load where no equilibrium exists


def random_robot_with_mass(seed: int) -> tuple[cdpr.Robot, np.ndarray, np.ndarray, np.ndarray]:
    """Two to ten cables, most with mass, some slack, spatial or planar; a position, rest lengths and a wrench."""
    random = np.random.default_rng(seed)
    size, cables, planar = 10 ** random.uniform(-0.3, 1.2), random.integers(2, 11), random.random() < 0.15
    exits = random.uniform(-0.5, 0.5, (cables, 3)) * size
    exits[:, 2] = size * random.uniform(0.3, 1, cables)
    if random.random() < 0.3:
        exits[random.integers(1, cables), 2] = -0.2 * size
    anchors = random.uniform(-0.5, 0.5, (cables, 3)) * size * 10 ** random.uniform(-1.3, -0.4)
    mass = 10 ** random.uniform(-1, 2.5)
    load = 9.81 * mass
    stiffness = load * 10 ** random.uniform(1, 4.5) * random.uniform(1, 2, cables)
    center = random.uniform(-0.1, 0.1, 3) * np.abs(anchors).max() * (random.random() < 0.5)
    wrench = np.zeros(6)
    if random.random() < 0.3:
        wrench[:3] = 0.2 * load * random.normal(size=3)
        if cables > 5:
            wrench[3:] = 0.01 * load * np.abs(anchors).max() * random.normal(size=3)
    position = random.uniform(-0.3, 0.3, 3) * size * [1, 1, 0.4] + [0, 0, 0.1 * size]
    if planar:
        exits[:, 1], anchors[:, 1], center[1], position[1] = 0, 0, 0, 0
        wrench[[1, 3, 5]] = 0
    slack = random.choice([0, random.uniform(-0.02, 0.02), random.uniform(0, 0.4)], cables)
    weights = load / size * 10 ** random.uniform(-5, 0) * random.uniform(1, 3, cables)
    weights *= random.random(cables) < random.choice([0.6, 1.0])
    robot = cdpr.Robot(
        exits, anchors, stiffness, mass, center_of_mass=center, mobility="planar" if planar else "spatial",
        linear_density=weights / 9.81,
    )  # fmt: skip
    return robot, position, robot.rest_lengths(position) * (1 + slack), wrench


def random_mixed_robot(seed: int) -> tuple[cdpr.Robot, np.ndarray, np.ndarray, np.ndarray]:
    """The same of cables with or without wheel, mass, nonlinear law, drive line and reeving.

    Raises:
        InvalidInput: an anchor lies in a wheel.
    """
    random = np.random.default_rng(seed)
    size, cables = 10 ** random.uniform(-0.3, 1.2), random.integers(2, 11)
    exits = random.uniform(-0.5, 0.5, (cables, 3)) * size
    exits[:, 2] = size * random.uniform(0.5, 1, cables)
    anchors = random.uniform(-0.5, 0.5, (cables, 3)) * size * 10 ** random.uniform(-1.3, -0.7)
    mass = 10 ** random.uniform(-1, 2.5)
    load = 9.81 * mass
    axis = random.normal(size=(cables, 3)) * 0.1
    axis[:, 2] = random.choice([-1, 1])
    line = np.random.default_rng([seed, 1])
    robot = cdpr.Robot(
        exits, anchors, load * 10 ** random.uniform(1.5, 4.5) * random.uniform(1, 2, cables), mass,
        linear_density=mass / size * 10 ** random.uniform(-5, -1, cables) * (random.random(cables) < 0.7),
        pulley_radius=size * 10 ** random.uniform(-3, -1.7) * (random.random(cables) < 0.6), pulley_axis=axis,
        stiffening=np.array([random.uniform(0, 100), random.uniform(0, 2e4)]) * (random.random((cables, 1)) < 0.5),
        winch_to_exit=size * line.uniform(0, 2, cables) * (line.random(cables) < 0.5),
        reeving=line.integers(1, 4, cables),
    )  # fmt: skip
    position = random.uniform(-0.2, 0.2, 3) * size * [1, 1, 0.4]
    wrench = np.zeros(6)
    wrench[:3] = 0.2 * load * random.normal(size=3) * (random.random() < 0.3)
    slack = random.choice([0, random.uniform(-0.01, 0.01), random.uniform(0, 0.2)], cables)
    return robot, position, robot.rest_lengths(position) * (1 + slack), wrench


def least_unbalanced(problem: cdpr.Problem) -> float:
    """The smallest net force on the platform that least squares find, as a fraction of the load."""
    robot = problem.robot
    random, size = np.random.default_rng(0), np.abs(robot.exits).max()
    found = []
    for turned in Rotation.random(STARTS, rng=random).as_matrix():
        at = random.uniform(-1, 1, 3) * size + robot.exits.mean(0) * [1, 1, 0]

        def left(x: np.ndarray, at: np.ndarray = at, turned: np.ndarray = turned) -> np.ndarray:
            turn = Rotation.from_rotvec(x[3:] / robot.characteristic_length).as_matrix()
            net = forces.at(problem, at + x[:3], turn @ turned).net_wrench / robot.units
            return net[robot.free] / problem.load

        found.append(np.abs(least_squares(left, np.zeros(6), max_nfev=EVALUATIONS, x_scale="jac").fun).max())
    return min(found)


def certified(equilibrium: cdpr.Equilibrium) -> str:
    """What the oracle of the tests finds wrong: forces that do not balance, or a platform that does not return."""
    problem, rig = equilibrium.problem, oracle.Rig.of(equilibrium.problem.robot)
    ropes = oracle.Ropes(rig, problem.rest_lengths)
    try:
        left = unbalanced(equilibrium)
        there = equilibrium.position, equilibrium.rotation_matrix
        stiffness = oracle.stiffness(rig, *there, ropes, problem.external_wrench)
    except AssertionError as error:
        return str(error)
    values = np.linalg.eigvalsh((stiffness + stiffness.T) / 2)
    if left > BALANCED:
        return f"forces are unbalanced by {left:.1e} of the load"
    return "" if values[0] >= -1e-6 * values[-1] else "the platform does not return"


def solves(robots: int) -> list[str]:
    """Check the solver with so many robots; return one line for each error."""
    wrong, confirmed, missing = [], 0, []
    for seed in range(robots):
        robot, position, rest, wrench = random_robot_with_mass(seed)
        found = cdpr.solve_many(robot, position[None], rest, external_wrench=wrench)
        if found.converged[0]:
            if error := certified(found[0]):
                wrong.append(f"solve, robot {seed}: {error}")
            confirmed += not error
            continue
        missing.append((seed, least_unbalanced(cdpr.Problem.of(robot, position, rest, wrench))))
        if missing[-1][1] < UNBALANCED:
            wrong.append(f"solve, robot {seed}: an equilibrium may exist ({missing[-1][1]:.0e} of the load)")
    print(f"{confirmed:,} of {robots:,} robots with cables with mass solved and certified")
    for seed, left in missing:
        print(f"  robot {seed}, with an external torque: the unbalanced load is at least {left:.1e} of the load")
    return wrong


def settles(first: int, last: int, mixed: bool = False) -> list[str]:
    """Check MuJoCo in the same way, with cables with mass or with cables that mix all properties."""
    wrong, verdicts, differences, left = [], Counter(), [], Counter()
    name, problem_of = ("mixed robot", mixed_problem) if mixed else ("robot", problem_with_mass)
    for seed in range(first, last):
        try:
            problem = problem_of(seed)
            found = cdpr.compare(cdpr.solve(problem), cdpr.settle(problem))
        except cdpr.InvalidInput:  # an anchor that lies in a wheel
            left["refused: an anchor in a wheel"] += 1
            continue
        except cdpr.NotConverged as error:
            left[f"not solved: {error}"] += 1
            continue
        except cdpr.NotSettled as error:
            wrong.append(f"settle, {name} {seed}: {error}")
            continue
        verdicts[found.verdict] += 1
        if found.verdict is cdpr.Verdict.DISAGREE:
            wrong.append(f"settle, {name} {seed}: {'; '.join(found.reasons)}")
        if found.verdict is cdpr.Verdict.AGREE:
            differences.append(found.position_error)
    print(f"{verdicts.total()} of {last - first} {'mixed ' * mixed}robots settled in MuJoCo:")
    for reason, count in (verdicts + left).items():
        print(f"  {count}: {reason.value if isinstance(reason, cdpr.Verdict) else reason}")
    if differences:
        median, largest = np.median(differences), max(differences)
        print(f"  position difference of those that agree: median {median:.0e} m, largest {largest:.0e} m")
    return wrong


def problem_with_mass(seed: int) -> cdpr.Problem:
    """A random robot whose cables have mass."""
    robot, position, random = random_robot(seed, stiffest=1e6)
    density = 10 ** random.uniform(-4, -1) * robot.mass / robot.rest_lengths(position).sum()
    return cdpr.Problem.of(robot.replace(linear_density=density), position)


def mixed_problem(seed: int) -> cdpr.Problem:
    """A random robot that mixes all properties, at a tenth of the slack."""
    robot, position, rest, wrench = random_mixed_robot(seed)
    rigid = robot.rest_lengths(position)
    return cdpr.Problem.of(robot, position, rigid + 0.1 * (rest - rigid), wrench)


def mixes(first: int, last: int) -> list[str]:
    """Check robots that mix all properties of cables, by the oracle."""
    wrong, statuses, refused = [], Counter(), 0
    for seed in range(first, last):
        try:
            robot, position, rest, wrench = random_mixed_robot(seed)
        except cdpr.InvalidInput:  # an anchor that lies in a wheel
            refused += 1
            continue
        found = cdpr.solve_many(robot, position[None], rest, external_wrench=wrench)
        status = cdpr.Status(int(found.status[0]))
        statuses[status] += 1
        if status is not cdpr.Status.CONVERGED:
            print(f"  mixed robot {seed}: {status.sentence}", flush=True)
        elif not robot.cabling.massless:
            if error := certified(found[0]):
                wrong.append(f"mixed robot {seed}: {error}")
            statuses["certified"] += not error
    print(f"robots {first} to {last - 1} that mix all properties ({refused} refused: an anchor in a wheel):")
    for status, count in statuses.items():
        print(f"  {count:,}: {status.sentence if isinstance(status, cdpr.Status) else status}")
    return wrong


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--solves", type=int, default=SOLVES)
    parser.add_argument("--settles", type=int, default=SETTLES)
    parser.add_argument("--mixed-settles", type=int, nargs=2, default=(0, MIXED_SETTLES), metavar=("FIRST", "LAST"))
    parser.add_argument("--mixes", type=int, nargs=2, default=(0, MIXES), metavar=("FIRST", "LAST"))
    options = parser.parse_args()
    warnings.simplefilter("ignore", cdpr.ImplausibleRobot)
    wrong = solves(options.solves) + mixes(*options.mixes) + settles(0, options.settles)
    wrong += settles(*options.mixed_settles, mixed=True)
    print(*wrong, sep="\n")
    sys.exit(1 if wrong else 0)


if __name__ == "__main__":
    main()

"""Stress test: extreme robots solved by both methods, and each result checked by the force balance of this script.

The robots have 1 to 8 cables or are fully constrained, have sizes of 1 cm to 100 m and an EA of 1 N to 100 MN, are
spatial or planar, have external wrenches, no gravity or high pretension, or are nearly degenerate. The poses are
arbitrary. A result is certified if its forces balance to two millionths of the load, computed here in plain NumPy from
the paper's Eq. 3, 4 and 8 to 11. For a sample, the stiffness is also computed by differences and compared with the
reported stability. "Refused" counts invalid input, "no equilibrium" counts problems that were not solved; both are
reported by an error of the package or by a status. Exit status 1 if any result is wrong or any error is not one of the
package's own.
"""

import argparse
import itertools
import sys
import warnings
from collections import Counter
from typing import Any

import numpy as np
from rich.console import Console

import cdpr_sim as cdpr
from cdpr_sim.report.table_style import new_table

SOLVES, SETTLES = 100_000, 1000
ROWS = 90  # rows of one robot in a batch; ten more robots are solved one by one
SAMPLE = 0.1  # share of the results whose stiffness is computed by differences
BALANCED = 2e-6  # of the load; the package guarantees 1e-6, and the two computations differ by rounding
ORTHOGONAL = 1e-12  # rounding of a rotation matrix
NEUTRAL = 1e-9  # of the largest eigenvalue: the package's bound of rounding
DIFFERENCED = 1e-4  # of the largest eigenvalue: MuJoCo's stiffness is computed by real differences
VERDICTS = ("certified", "refused", "no equilibrium")
REFUSED = (cdpr.Status.FALLS, cdpr.Status.NOT_FINITE)
KINDS = ("suspended", "constrained", "pretensioned", "weightless", "wrenched", "degenerate", "planar")


def robot_of(kind: str, random: np.random.Generator) -> tuple[cdpr.Robot, float]:
    """Return a robot and its size [m]."""
    size, platform = 10 ** random.uniform(-2, 2), 10 ** random.uniform(-3, 0)
    cables = int(random.integers(1, 9))
    if kind in ("constrained", "pretensioned") or (kind == "weightless" and random.random() < 0.7):
        corners = np.array(list(itertools.product([-1, 1], repeat=3)), dtype=float)
        exits, anchors = corners * [1, 0.8, 0.6], corners * random.uniform(0.5, 1, 3)
        if random.random() < 0.5:
            anchors[:, 2] *= -1
        if random.random() < 0.5:
            exits = exits + random.uniform(-0.2, 0.2, exits.shape)
    else:
        exits = random.uniform([-1, -1, 0.4], [1, 1, 1], (cables, 3))
        anchors = random.uniform(-1, 1, (cables, 3))
    center = random.uniform(-0.5, 0.5, 3) * (random.random() < 0.5)
    if kind == "degenerate":
        flaw = random.integers(5)
        if flaw == 0:
            exits[:] = exits[0] + 1e-9 * random.normal(size=exits.shape)
        elif flaw == 1:
            anchors[:] = anchors[0]
        elif flaw == 2:
            exits[:, 2] = exits[0, 2]
            anchors[:, 2] = 0
        elif flaw == 3:
            exits[:, 1] = anchors[:, 1] = center[1] = 0
        else:
            exits[:], anchors[:] = exits[0], anchors[0]
    planar = kind == "planar" or (kind != "degenerate" and random.random() < 0.2)
    if planar:
        exits[:, 1] = anchors[:, 1] = center[1] = 0
    stiffness = 10 ** random.uniform(0, 8) * 10 ** random.uniform(-1, 1, len(exits) if random.random() < 0.5 else 1)
    robot = cdpr.Robot(
        size * exits,
        size * platform * anchors,
        np.broadcast_to(stiffness, len(exits)),
        10 ** random.uniform(-3, 3),
        center_of_mass=size * platform * center,
        mobility="planar" if planar else "spatial",
        gravity=0.0 if kind == "weightless" else 9.81,
        platform_size=np.full(3, 2 * size * platform),
        name=kind,
    )
    return robot, size


def inputs_of(kind: str, robot: cdpr.Robot, size: float, rows: int, random: np.random.Generator) -> dict[str, Any]:
    """Return poses (rows, 6), and rest lengths and wrenches if the kind has them."""
    poses = np.hstack(
        [random.uniform(-0.8, 0.4, (rows, 3)) * size, random.normal(size=(rows, 3)) * random.choice([0, 0.3, 3])]
    )
    poses[random.random(rows) < 0.05, :3] = (robot.exits[0] - robot.anchors[0]) + 1e-12 * size  # an anchor on its exit
    if robot.mobility == "planar":
        poses[:, [1, 3, 5]] = 0
    inputs = {"poses": poses}
    if kind in ("pretensioned", "weightless") or random.random() < 0.2:
        matrices = cdpr.Problems.of(robot, poses).rotations
        arms = np.einsum("nij,cj->nci", np.broadcast_to(matrices, (rows, 3, 3)), robot.anchors)
        lengths = np.linalg.norm(robot.exits - poses[:, None, :3] - arms, axis=-1)
        strain = 10 ** random.uniform(-5, -0.5) * random.choice([-0.3, 1])
        inputs["rest_lengths"] = lengths * (1 - strain * random.uniform(0.2, 1, lengths.shape))
        inputs["poses"] = poses + 0.03 * size * random.normal(size=poses.shape) * [
            1,
            0 if robot.mobility == "planar" else 1,
            1,
            0,
            0,
            0,
        ]
    if kind == "wrenched":
        scale = robot.weight * 10 ** random.uniform(-2, 2)
        wrenches = (
            scale * random.normal(size=(rows, 6)) * robot.units * ([1, 1, 1, 0, 0, 0] if random.random() < 0.7 else 1)
        )
        if robot.mobility == "planar":
            wrenches[:, [1, 3, 5]] = 0
        inputs["external_wrench"] = wrenches
    return inputs


def forces(
    problem: cdpr.Problem, position: np.ndarray, matrix: np.ndarray, step: np.ndarray | None = None
) -> np.ndarray:
    """Net force and torque on the platform [N] in the free directions; torques divided by the characteristic length.

    A ``step`` (translation, rotation vector), which may be imaginary, moves the platform with the same cables taut.
    """
    robot = problem.robot
    arms, center = robot.anchors @ matrix.T, matrix @ robot.center_of_mass
    spans = robot.exits - position - arms
    lengths = np.sqrt((spans * spans).sum(1))
    taut = lengths > problem.rest_lengths
    if step is not None:
        arms, center = arms + np.cross(step[3:], arms), center + np.cross(step[3:], center)
        spans = robot.exits - (position + step[:3]) - arms
        lengths = np.sqrt((spans * spans).sum(1))
    stretch = (lengths - problem.rest_lengths) * taut
    tensions = robot.axial_stiffness * stretch / problem.rest_lengths
    pulls = (tensions / np.where(taut, lengths, 1.0))[:, None] * spans
    weight = np.array([0, 0, -robot.mass * robot.gravity])
    force = pulls.sum(0) + weight + problem.external_wrench[:3]
    torque = np.cross(arms, pulls).sum(0) + np.cross(center, weight) + problem.external_wrench[3:]
    return np.concatenate([force, torque / robot.characteristic_length])[robot.free]


def stiffness(problem: cdpr.Problem, position: np.ndarray, matrix: np.ndarray) -> np.ndarray:
    """Eigenvalues [N/m] of the stiffness matrix, by complex-step derivatives, which lose no digits."""
    free, columns = problem.robot.free, []
    for direction in free:
        step = np.zeros(6, dtype=complex)
        step[direction] = 1e-30j / problem.robot.units[direction]
        columns.append(-np.imag(forces(problem, position, matrix, step)) / 1e-30)
    slope = np.array(columns).T
    return np.linalg.eigvalsh((slope + slope.T) / 2)


def verdict_of(found: cdpr.Equilibrium, random: np.random.Generator, matrix: np.ndarray | None = None) -> str:
    """Return "certified" or what is wrong with a result; a row of a batch has its own rotation matrix."""
    problem = found.problem
    turned = found.rotation.as_matrix() if matrix is None else matrix
    if np.abs(turned @ turned.T - np.eye(3)).max() > ORTHOGONAL:
        return "the rotation matrix is not a rotation"
    load = max(problem.robot.weight, np.abs(problem.external_wrench / problem.robot.units).max())
    scale = load or 1e-3 * problem.robot.axial_stiffness.mean()
    left = np.abs(forces(problem, found.position, turned)).max()
    if not left <= BALANCED * scale:
        return f"{left / scale:.1e} of the load unbalanced, reported {found.residual / scale:.1e}"
    if random.random() < SAMPLE:
        values = stiffness(problem, found.position, turned)
        lowest, largest = values[0], np.abs(values).max()
        blur = (DIFFERENCED if found.source == "mujoco" else NEUTRAL) * largest
        if found.stable and lowest < (-blur if found.source == "mujoco" else 0):
            return f"reported stable, with a smallest stiffness of {lowest:.1e} of {largest:.1e} N/m"
        if found.stability is cdpr.Stability.UNSTABLE and lowest > blur:
            return f"reported unstable, with a smallest stiffness of {lowest:.1e} of {largest:.1e} N/m"
    return "certified"


def stress(method: str, asked: int, seed: int) -> tuple[dict[str, Counter], list[str]]:
    """Return the counts by kind of robot, and a description of each wrong result."""
    counts, wrong = {kind: Counter() for kind in KINDS}, []

    def count(kind: str, verdict: str, number: int, row: int | None = None) -> None:
        known = verdict if verdict in VERDICTS else "wrong"
        counts[kind][known] += 1
        if known == "wrong":
            wrong.append(
                f"{method}, {kind}, seed {seed}, robot {number}{'' if row is None else f', row {row}'}: {verdict}"
            )

    def one(kind: str, number: int, random: np.random.Generator) -> None:
        try:
            robot, size = robot_of(kind, random)
            problem = {name: value[0] for name, value in inputs_of(kind, robot, size, 1, random).items()}
            found = {"solve": cdpr.solve, "settle": cdpr.settle}[method](robot, problem.pop("poses"), **problem)
        except (cdpr.NotConverged, cdpr.NotSettled):
            count(kind, "no equilibrium", number)
        except cdpr.CdprError:
            count(kind, "refused", number)
        else:
            count(kind, verdict_of(found, random), number)

    def many(kind: str, number: int, random: np.random.Generator, rows: int) -> None:
        try:
            robot, size = robot_of(kind, random)
            equilibria = cdpr.solve_many(robot, **inputs_of(kind, robot, size, rows, random))
        except cdpr.CdprError:
            for _ in range(rows):
                count(kind, "refused", number)
            return
        for row in range(rows):
            converged = equilibria.converged[row]
            missing = "refused" if equilibria.status[row] in REFUSED else "no equilibrium"
            verdict = verdict_of(equilibria[row], random, equilibria.rotations[row]) if converged else missing
            count(kind, verdict, number, row)

    done = number = 0
    while done < asked:
        kind, random = KINDS[number % len(KINDS)], np.random.default_rng([seed, number])
        rows = min(ROWS if method == "solve" and number % 11 == 0 else 1, asked - done)
        try:
            one(kind, number, random) if rows == 1 else many(kind, number, random, rows)
        except Exception as error:  # any other exception is an error of the package
            count(kind, f"{type(error).__name__}: {error}", number)
        done, number = done + rows, number + 1
    return counts, wrong


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--solves", type=int, default=SOLVES)
    parser.add_argument("--settles", type=int, default=SETTLES)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    warnings.simplefilter("error", RuntimeWarning)
    warnings.simplefilter("ignore", cdpr.ImplausibleRobot)
    table = new_table("Extreme robots", "method", "robots", *VERDICTS, "wrong", text_columns=2)
    complaints = []
    for method, asked in (("solve", options.solves), ("settle", options.settles)):
        counts, wrong = stress(method, asked, options.seed)
        complaints += wrong
        for kind, count in [*counts.items(), ("all", sum(counts.values(), Counter()))]:
            table.add_row(method, kind, *(str(count[name]) for name in (*VERDICTS, "wrong")))
        table.add_section()
    Console().print(table)
    for line in complaints[:20]:
        print(line)
    sys.exit(1 if complaints else 0)


if __name__ == "__main__":
    main()

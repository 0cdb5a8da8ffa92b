"""Prove the solutions of the problem set again, or draw another set.

``python scripts/dev/generate_problems.py`` proves the solutions of the package's problem set from what its files state,
writes them, and names the problems whose solutions differ from those before in a digit that both had proved. Exit
status 1 if there are any.

``python scripts/dev/generate_problems.py --draw FOLDER [PER_LEVEL]`` draws problems from the present catalogue.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator, Sequence
from decimal import Decimal
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from cdpr_sim.core.equilibrium import NotConverged
from cdpr_sim.core.errors import CdprError
from cdpr_sim.core.problem import Problem
from cdpr_sim.core.robot import Robot
from cdpr_sim.crosscheck.problem_set import FORMAT, LEVELS, PROBLEMS, SetProblem, read_problems
from cdpr_sim.proof.certificate import Certificate, certify
from cdpr_sim.proof.complete import certify_all
from cdpr_sim.robots.catalogue import list_robots, load_robot
from cdpr_sim.statics.newton import solve

EACH = 100
"""Number of problems of a level."""

STIFFER, NEARLY_SLACK, NEARLY_NEUTRAL = 100.0, 1e-4, 1e-4
"""Criteria of hard problems: factor on the stiffness; a cable's distance from its rest length as a fraction
of the largest stretch; the softest stiffness as a fraction of the stiffest."""

CABLE_FIELDS = ("exits", "anchors", "axial_stiffness", "linear_density", "pulley_radius", "pulley_axis", "stiffening")
"""Fields of ``Cabling`` in a file; force limits are not needed."""

DRIVE_LINE = ("winch_to_exit", "reeving")
"""Further ones, of robots that have some."""


def written(name: str, problem: Problem, starts: list[RigidTransform], proofs: list[Certificate], *, complete: bool):
    """A problem in the format of its file."""
    robot, cabling = problem.robot, problem.robot.cabling
    names = CABLE_FIELDS + (DRIVE_LINE if any(cabling.has(name).any() for name in DRIVE_LINE) else ())
    fields = {field: getattr(cabling, field).tolist() for field in names}
    fields |= {"mass": robot.mass, "center_of_mass": robot.center_of_mass.tolist()}
    fields |= {"gravity": robot.gravity, "mobility": robot.mobility}
    return {
        "name": name,
        "robot": fields,
        "rest_lengths": problem.rest_lengths.tolist(),
        "external_wrench": problem.external_wrench.tolist(),
        "starts": [
            {"position": start.translation.tolist(), "quaternion": start.rotation.as_quat().tolist()}
            for start in starts
        ],
        **_solutions(proofs, complete),
    }


def solutions(one: SetProblem) -> dict[str, Any]:
    """The entries ``equilibria`` and ``complete`` of a problem of a file, proved again from its other entries."""
    return _solutions(*_answers(one.problem, one.starts))


def _solutions(proofs: Sequence[Certificate], complete: bool) -> dict[str, Any]:
    return {"equilibria": [_proved(one) for one in proofs], "complete": complete}


def _proved(one: Certificate) -> dict[str, Any]:
    entries = one.decimals["rotation"]
    return {
        "position": list(one.decimals["position"]),
        "rotation_matrix": [list(entries[first : first + 3]) for first in (0, 3, 6)],
        "tensions": list(one.decimals["tensions"]),
        "slack": list(one.slack),
        "unstable_directions": one.index,
        "digits": int(one.digits),
    }


def draw_problems(level: str, count: int, seed: int = 0) -> Iterator[dict[str, Any]]:
    """Problems of a level, drawn at random from the catalogue, in the format of files.

    Args:
        level: of ``LEVELS``.
        count: number of problems.
        seed: of the random numbers.
    """
    random = np.random.default_rng([seed, LEVELS.index(level)])
    names, made, drawn = list_robots(), 0, 0
    while made < count:
        name = names[drawn % len(names)]
        drawn += 1
        try:
            candidate = _candidate(level, load_robot(name), random)
        except CdprError:  # an invalid pose of this robot
            continue
        if candidate is not None:
            made += 1
            yield written(f"{level}-{made:03d}-{name}", *candidate[:-1], complete=candidate[-1])


def _candidate(
    level: str, robot: Robot, random: np.random.Generator
) -> tuple[Problem, list[RigidTransform], list[Certificate], bool] | None:
    """A problem of this robot and level with its proofs; or None."""
    robot, wrench = _varied(level, robot, random)
    lower, upper = robot.workspace
    position = np.round(random.uniform(lower, upper), 4)
    lengths = robot.rest_lengths(position)
    if level == "higher" and robot.mobility == "planar":
        lengths = lengths * np.round(random.uniform(0.95, 1.3), 2)
    elif level == "lower" and robot.kind == "fully constrained":
        lengths = lengths * (1 - 5e-4)
    problem = Problem.of(robot, position, lengths, wrench)
    starts = _starts(robot, problem.pose, random)
    proofs, complete = _answers(problem, starts)
    if not proofs or not all(one.proved for one in proofs):
        return None
    return (problem, starts, proofs, complete) if _is_of(level, proofs) else None


def _varied(level: str, robot: Robot, random: np.random.Generator) -> tuple[Robot, np.ndarray | None]:
    """Vary the stiffness, and in some problems the elasticity, a pulley, a force or a torque."""
    factor = STIFFER if level == "higher" else 10 ** random.uniform(-1.0, 0.5)
    changes: dict[str, Any] = {"axial_stiffness": np.round(factor * robot.axial_stiffness, 3)}
    draw, plain = random.random(), robot.cabling.massless and robot.cabling.linear and not robot.cabling.pulleys.any()
    if plain and draw < 0.1:
        changes["stiffening"] = (5.0, 50.0)
    elif plain and draw < 0.2:
        changes["pulley_radius"] = round(0.2 * robot.characteristic_length, 4)
    wrench = None
    if draw > 0.8:
        wrench = np.zeros(6)
        wrench[robot.free] = random.uniform(-0.2, 0.2, len(robot.free)) * robot.weight
        wrench[3:] *= 0.1 * robot.characteristic_length
    return robot.replace(**changes), wrench


def _starts(robot: Robot, commanded: RigidTransform, random: np.random.Generator) -> list[RigidTransform]:
    """Start poses: the commanded pose, one near it, and one far from it, rotated by 40°."""
    extent = np.ptp(robot.workspace, axis=0)
    axis = np.array([0.0, 1.0, 0.0]) if robot.mobility == "planar" else random.normal(size=3)
    axis = axis / np.linalg.norm(axis)
    starts = [commanded]
    for far, angle in ((0.05, 5.0), (0.3, 40.0)):
        moved = np.round(commanded.translation + far * extent * random.uniform(-1, 1, 3), 6)
        starts.append(RigidTransform.from_components(moved, Rotation.from_rotvec(np.radians(angle) * axis)))
    return starts


def _answers(problem: Problem, starts: Sequence[RigidTransform]) -> tuple[list[Certificate], bool]:
    """All equilibria if the list is proved complete; else those that Newton's method finds from the start poses."""
    robot = problem.robot
    if robot.mobility == "planar" and robot.cabling.massless and not robot.cabling.pulleys.any():
        proved = certify_all(problem)  # no time limit: solutions must not depend on a machine's speed
        if proved.complete:
            return list(proved), True
    proofs: list[Certificate] = []
    for start in starts:
        try:
            one = certify(solve(Problem.of(robot, start, problem.rest_lengths, problem.external_wrench)))
        except NotConverged:
            continue
        same = [np.abs(one.position - other.position).max() < 1e-9 for other in proofs]
        if not any(same):
            proofs.append(one)
    return proofs, False


def _stretched(one: Certificate) -> np.ndarray:
    """Which cables are stretched, (cables,): those with mass that are not may be taut (``core.slack``)."""
    return one.equilibrium.lengths > one.equilibrium.rest_lengths


def _is_of(level: str, proofs: list[Certificate]) -> bool:
    stable = [one for one in proofs if one.stable]
    if not stable:
        return False
    if level == "lower":
        return all(_stretched(one).all() for one in stable)
    if level == "average":
        return not all(_stretched(one).all() for one in stable)
    several = len(stable) > 1
    for one in stable:
        equilibrium = one.equilibrium
        stretch = np.abs(equilibrium.lengths - equilibrium.rest_lengths)
        values = np.abs(equilibrium.eigenvalues)
        hard = stretch.min() < NEARLY_SLACK * stretch.max() or values.min() < NEARLY_NEUTRAL * values.max()
        several = several or bool(hard)
    return several


def write(folder: Path, level: str, problems: list[dict]) -> None:
    """One file, with a problem per line."""
    head = f'{{"format": {FORMAT}, "level": "{level}", "problems": [\n'
    text = head + ",\n".join(map(json.dumps, problems)) + "\n]}\n"
    (folder / f"{level}.json").write_text(text, encoding="utf-8")


def decimals(value: object) -> list[Decimal]:
    """All decimals of a solution."""
    if isinstance(value, dict):
        return [one for name in ("position", "rotation_matrix", "tensions") for one in decimals(value[name])]
    if isinstance(value, list):
        return [one for entry in value for one in decimals(entry)]
    return [Decimal(str(value))]


def same(one: dict, other: dict) -> bool:
    """Whether two solutions agree: every decimal to two units in the last place of the shorter."""
    known = ("slack", "unstable_directions")
    if one["complete"] != other["complete"] or len(one["equilibria"]) != len(other["equilibria"]):
        return False
    for a, b in zip(one["equilibria"], other["equilibria"], strict=True):
        if any(a[name] != b[name] for name in known):
            return False
        for x, y in zip(decimals(a), decimals(b), strict=True):
            last = max(int(x.as_tuple().exponent), int(y.as_tuple().exponent))
            if abs(x - y) > 2 * Decimal(10) ** last:
                return False
    return True


def main(words: list[str]) -> None:
    if words[:1] == ["--draw"]:
        folder, *more = words[1:]
        Path(folder).mkdir(exist_ok=True)
        for level in LEVELS:
            drawn = []
            for one in draw_problems(level, int(more[0]) if more else EACH):
                drawn.append(one)
                print(one["name"], len(one["equilibria"]), "complete" if one["complete"] else "", flush=True)
            write(Path(folder), level, drawn)
    else:
        changed = []
        read = {one.name: one for one in read_problems(PROBLEMS)}
        for level in LEVELS:
            problems = json.loads((PROBLEMS / f"{level}.json").read_text(encoding="utf-8"))["problems"]
            for one in problems:
                proved = solutions(read[one["name"]])
                if not same(one, proved):
                    changed.append(one["name"])
                    print(one["name"], "differs", flush=True)
                one |= proved
            write(PROBLEMS, level, problems)
        print(f"{len(read)} problems proved again, {len(changed)} with other solutions")
        sys.exit(1 if changed else 0)


if __name__ == "__main__":
    main(sys.argv[1:])

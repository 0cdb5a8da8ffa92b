"""Correct digits and false claims of solvers on problems whose equilibria are proved.

Correct digits are counted as in NIST's Statistical Reference Datasets, by the log relative error −log10(|q − c|/|c|)
of an answer q to the certified c, 15 at most: here the smaller of the position's (|c| is its distance from the origin)
and the rotation's (the angle in radians). Any proved equilibrium is a solution, stable or not; both are counted.
"""

from __future__ import annotations

import importlib
import json
import math
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import scipy.optimize
from scipy.spatial.transform import RigidTransform, Rotation

from cdpr_sim.core import extras
from cdpr_sim.core.equilibrium import Equilibrium, NotConverged, NotSettled
from cdpr_sim.core.errors import CdprError, InvalidInput, UnknownName
from cdpr_sim.core.files import readable, refuse_irregular
from cdpr_sim.core.pose import Pose, angle_between
from cdpr_sim.core.problem import Problem
from cdpr_sim.core.progress import bar
from cdpr_sim.crosscheck.problem_set import SetProblem
from cdpr_sim.physics.settle import settle
from cdpr_sim.proof.certificate import certify
from cdpr_sim.statics import forces
from cdpr_sim.statics.solve import solve

MOST_DIGITS = 15.0
"""Largest number of correct digits in double precision."""

SOLVED_DIGITS = 3.0
"""A claimed solution with fewer correct digits is false."""


Answer = RigidTransform | None
"""A pose, or None if none was found."""

Solver = Callable[..., Any]
"""(robot, rest_lengths, start) → pose or None; with ``external_wrench=`` if there is one."""


@dataclass(frozen=True)
class Outcome:
    """One answer.

    Attributes:
        problem: the problem's name.
        level: of ``LEVELS``.
        start: index of the start pose.
        claimed: whether a pose was given.
        digits: correct digits; 0 without a pose.
        stable: whether the nearest proved equilibrium is stable.
        seconds: time; nan for answers from a file.
    """

    problem: str
    level: str
    start: int
    claimed: bool
    digits: float
    stable: bool
    seconds: float

    @property
    def solved(self) -> bool:
        """Whether the given pose is an equilibrium to three digits."""
        return self.claimed and self.digits >= SOLVED_DIGITS


@dataclass(frozen=True)
class Score:
    """A solver's answers to all problems from all starts."""

    solver: str
    outcomes: tuple[Outcome, ...]

    def of(self, level: str) -> tuple[Outcome, ...]:
        """Outcomes of one level."""
        return tuple(one for one in self.outcomes if one.level == level)


def score(name: str, solver: Solver, problems: Iterable[SetProblem], *, progress: bool = False) -> Score:
    """Call a solver for every problem from every start, and compare its answers with the proved equilibria.

    Args:
        name: of the solver.
        solver: takes a robot, rest lengths (cables,) [m] and a start, a ``RigidTransform``; if there is an external
            wrench (6,) also ``external_wrench=``. It returns a pose (anything that ``Problem`` takes), or None. An
            exception counts as no answer.
        problems: from ``read_problems``.
        progress: whether to show a progress bar.
    """
    outcomes = []
    problems = list(problems)
    with bar(f"{name} solves", len(problems), show=progress) as advance:
        for one in problems:
            wrench = one.problem.external_wrench
            more = {"external_wrench": wrench} if wrench.any() else {}
            for number, start in enumerate(one.starts):
                begun = time.perf_counter()
                try:
                    answer = solver(one.problem.robot, one.problem.rest_lengths, start, **more)
                except Exception:  # an exception of any type counts as no answer
                    answer = None
                outcomes.append(evaluated(one, number, answer, time.perf_counter() - begun))
            advance(1)
    return Score(name, tuple(outcomes))


def score_answers(path: Path, problems: Iterable[SetProblem]) -> Score:
    """Compare the answers of a file with the proved equilibria.

    Raises:
        InvalidInput: not a file of answers.
    """
    refuse_irregular(path)
    with readable(path):
        text = path.read_text(encoding="utf-8")
    try:
        content = json.loads(text)
        answers = content["answers"]
        outcomes = []
        for one in problems:
            mine = answers.get(one.name) or [None] * len(one.starts)
            for number in range(len(one.starts)):
                given = mine[number] if number < len(mine) else None
                seconds = math.nan
                answer = None
                if given is not None:
                    turn = Rotation.from_quat(given["quaternion"])
                    answer = RigidTransform.from_components(given["position"], turn)
                    seconds = float(given.get("seconds", math.nan))
                outcomes.append(evaluated(one, number, answer, seconds))
        return Score(str(content.get("solver", path.stem)), tuple(outcomes))
    except (ValueError, KeyError, TypeError, AttributeError):
        raise InvalidInput(
            f"{path}: found no file of answers, expected JSON with answers: per problem, a list of position and "
            "quaternion"
        ) from None


def evaluated(one: SetProblem, start: int, answer: Any, seconds: float) -> Outcome:
    """An answer beside the proved equilibrium that it is nearest to."""
    nothing = Outcome(one.name, one.level, start, False, 0.0, False, seconds)
    if answer is None:
        return nothing
    try:
        at = Pose.of(answer)
    except CdprError:
        return nothing
    digits, stable = _digits(one.positions, one.rotations, one.index, at)
    if digits < SOLVED_DIGITS and not one.complete and not extras.missing("proof"):
        try:
            problem = Problem.of(one.problem.robot, at, one.problem.rest_lengths, one.problem.external_wrench)
            found = certify(forces.equilibrium_at(problem, at.transform, iterations=0, source="answer"))
        except CdprError:
            found = None
        if found is not None and found.exists and found.index is not None:  # a proved one that the file does not list
            middle = found.position.mean(0)[None], found.rotation.mean(0)[None]
            digits, stable = max((digits, stable), _digits(*middle, (found.index,), at))
    return Outcome(one.name, one.level, start, True, digits, stable, seconds)


def _digits(positions: np.ndarray, rotations: np.ndarray, index: tuple[int, ...], at: Pose) -> tuple[float, bool]:
    """Correct digits with respect to the closest equilibrium, and whether that is stable."""
    off = np.linalg.norm(positions - at.position, axis=1) / np.linalg.norm(positions, axis=1)
    turned = angle_between(rotations, at.rotation_matrix)
    worst = np.maximum(off, turned)
    nearest = int(np.argmin(worst))
    return min(max(-math.log10(max(worst[nearest], 1e-300)), 0.0), MOST_DIGITS), index[nearest] == 0


def solver_called(name: str) -> Solver:
    """One of ``SOLVERS``, or the ``module:function`` of a user.

    Raises:
        UnknownName: neither of them.
        InvalidInput: a module or function that cannot be imported.
    """
    if name in SOLVERS:
        return SOLVERS[name]
    module, colon, function = name.partition(":")
    if not colon:
        raise UnknownName("solver", name, SOLVERS, "; or module:function, or a .json file of answers")
    try:
        found = getattr(importlib.import_module(module), function)
    except (ImportError, AttributeError, ValueError) as error:
        raise InvalidInput(f"SOLVER: found {name!r}, which cannot be imported: {error}") from None
    if not callable(found):
        raise InvalidInput(f"SOLVER: found {name!r}, which is no function")
    return found


# --- solvers compared in the manual


def _ours(solve_one: Callable[..., Equilibrium], **options: str) -> Solver:
    def solver(robot, rest_lengths, start, external_wrench=None) -> Answer:
        try:
            return solve_one(robot, start, rest_lengths, external_wrench=external_wrench, **options).pose
        except (NotConverged, NotSettled):
            return None

    return solver


def _scipy(function: str) -> Solver:
    """SciPy's solvers on six numbers, a position and a rotation vector from the start, without further measures."""

    def solver(robot, rest_lengths, start, external_wrench=None) -> Answer:
        problem = Problem.of(robot, start, rest_lengths, external_wrench)
        free, units = robot.free, robot.units

        def pose(x) -> RigidTransform:
            step = np.zeros(6)
            step[free] = x
            step /= units
            turned = Rotation.from_rotvec(step[3:]) * start.rotation
            return RigidTransform.from_components(start.translation + step[:3], turned)

        def state(x):
            at = pose(x)
            return forces.at(problem, at.translation, at.rotation.as_matrix())

        first = np.zeros(len(free))
        if function == "rigid":

            def stretch(x):
                return state(x).lengths - problem.rest_lengths

            found = scipy.optimize.least_squares(stretch, first, xtol=1e-15, ftol=1e-15, gtol=1e-15)
        elif function == "root":
            found = scipy.optimize.root(lambda x: (state(x).net_wrench / units)[free], first)
        else:
            torque = problem.external_wrench[3:]
            found = scipy.optimize.minimize(
                lambda x: state(x).energy - torque @ (Rotation.from_matrix(state(x).rotation)
                * start.rotation.inv()).as_rotvec(), first)  # fmt: skip
        return pose(found.x) if found.success else None

    return solver


SOLVERS: dict[str, Solver] = {
    "newton": _ours(solve, method="newton"),
    "fsolve": _ours(solve, method="fsolve"),
    "least_squares": _ours(solve, method="least_squares"),
    "mujoco": _ours(settle),
    "root": _scipy("root"),
    "minimize": _scipy("minimize"),
    "rigid": _scipy("rigid"),
}
"""This package's methods; SciPy's ``root`` and ``minimize``; and rigid cables."""

"""Performance of solvers: success rate and time; and differences between the two methods."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import get_args

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy.typing import ArrayLike

from cdpr_sim.core.equilibrium import NotConverged, Stability
from cdpr_sim.core.materials import PAPER_MATERIALS
from cdpr_sim.core.robot import Robot
from cdpr_sim.crosscheck.compare import Verdict, compare
from cdpr_sim.physics.settle import settle_many
from cdpr_sim.robots.catalogue import PAPER_ROBOTS, load_robot
from cdpr_sim.statics import newton
from cdpr_sim.statics import solve as solvers
from cdpr_sim.statics.solve import Method

REPEATS = 9
"""Repetitions of the timing of the compiled call, which takes less than a millisecond; the median is used."""


@dataclass(frozen=True, eq=False)
class Convergence:
    """Success rate and time of each solver over the cables' stiffness.

    Attributes:
        robot: the robot, apart from its stiffness.
        axial_stiffness: EA, (stiffnesses,) [N].
        poses: number of random commanded poses per stiffness.
        solved: per method, number of poses with balanced forces, (stiffnesses,).
        stable: per method, number of those that are not unstable, (stiffnesses,).
        seconds: per method, time of every pose, solved or not, (stiffnesses, poses) [s].
        compiled_seconds: time per pose of Newton for all poses in one call, (stiffnesses,) [s].
    """

    robot: Robot
    axial_stiffness: Float[np.ndarray, " stiffnesses"]
    poses: int
    solved: Mapping[str, Int[np.ndarray, " stiffnesses"]]
    stable: Mapping[str, Int[np.ndarray, " stiffnesses"]]
    seconds: Mapping[str, Float[np.ndarray, "stiffnesses poses"]]
    compiled_seconds: Float[np.ndarray, " stiffnesses"]


def convergence(
    robot: Robot | None = None,
    *,
    axial_stiffness: ArrayLike = (1e2, 1e3, 1e4, 1e5, 1e6),
    poses: int = 24,
    methods: Sequence[Method] = get_args(Method),
    seed: int = 1,
) -> Convergence:
    """Run every method from the same random level poses of the workspace (default: DemoBot's parallel layout)."""
    robot = load_robot("parallel") if robot is None else robot
    rng = np.random.default_rng(seed)
    stiffness = np.asarray(axial_stiffness, dtype=float)
    commanded = rng.uniform(robot.workspace[0], robot.workspace[1], (poses, 3))
    solved = {method: np.zeros(len(stiffness), dtype=int) for method in methods}
    stable = {method: np.zeros(len(stiffness), dtype=int) for method in methods}
    seconds = {method: np.zeros((len(stiffness), poses)) for method in methods}
    compiled = np.zeros(len(stiffness))
    newton.solve_many(robot, commanded)  # compiles before the timing
    for i, EA in enumerate(stiffness):
        one = robot.replace(axial_stiffness=EA)
        for method in methods:
            for j, position in enumerate(commanded):
                start = time.perf_counter()
                try:
                    found = solvers.solve(one, position, method=method)
                except NotConverged:
                    found = None
                seconds[method][i, j] = time.perf_counter() - start
                if found is not None:
                    solved[method][i] += 1
                    stable[method][i] += found.stability is not Stability.UNSTABLE
        compiled[i] = np.median([_seconds(newton.solve_many, one, commanded) for _ in range(REPEATS)]) / poses
    return Convergence(robot, stiffness, poses, solved, stable, seconds, compiled)


def _seconds(function: Callable[..., object], *arguments: object) -> float:
    start = time.perf_counter()
    function(*arguments)
    return time.perf_counter() - start


@dataclass(frozen=True, eq=False)
class Differences:
    """Differences between the static solver and MuJoCo, for one robot over all materials.

    Attributes:
        name: of the robot.
        position_errors: (poses,) [m].
        rotation_errors: (poses,) [rad].
        tension_errors: (poses,) largest of a pose's cables [N].
        verdicts: one per pose.
    """

    name: str
    position_errors: Float[np.ndarray, " poses"]
    rotation_errors: Float[np.ndarray, " poses"]
    tension_errors: Float[np.ndarray, " poses"]
    verdicts: tuple[Verdict, ...]

    @property
    def neutral(self) -> Bool[np.ndarray, " poses"]:
        """Neutrally stable poses, where the methods may stop at different equilibria of a continuum."""
        return np.array([verdict is Verdict.AGREE_EXCEPT_NEUTRAL for verdict in self.verdicts])

    @property
    def disagreeing(self) -> int:
        """Number of poses at which the two methods disagree."""
        return sum(verdict not in (Verdict.AGREE, Verdict.AGREE_EXCEPT_NEUTRAL) for verdict in self.verdicts)


def differences(
    robots: Sequence[str] = PAPER_ROBOTS, materials: Sequence[str] = PAPER_MATERIALS, *, poses: int = 100, seed: int = 2
) -> tuple[Differences, ...]:
    """Compare both methods from ``poses`` random level poses per robot (default: the paper's) and material.

    Raises:
        NotConverged: the static solver found no equilibrium at some pose.
        NotSettled: MuJoCo did not settle at some pose.
    """
    rng = np.random.default_rng(seed)
    results = []
    for name in robots:
        agreements = []
        for material in materials:
            robot = load_robot(name).replace(material=material)
            commanded = rng.uniform(robot.workspace[0], robot.workspace[1], (poses, 3))
            settled = settle_many(robot, commanded)
            agreements += [
                compare(solvers.solve(robot, position), one) for position, one in zip(commanded, settled, strict=True)
            ]
        results.append(
            Differences(
                name=name,
                position_errors=np.array([one.position_error for one in agreements]),
                rotation_errors=np.array([one.rotation_error for one in agreements]),
                tension_errors=np.array([one.tension_error for one in agreements]),
                verdicts=tuple(one.verdict for one in agreements),
            )
        )
    return tuple(results)

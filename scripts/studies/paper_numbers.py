"""The paper's numbers and ours: performance of SEECR (section III F)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import get_args

import numpy as np
from jaxtyping import Bool, Float, Int

from cdpr_sim.core.materials import PAPER_MATERIALS
from cdpr_sim.robots.catalogue import load_robot
from cdpr_sim.statics.newton import solve_many
from cdpr_sim.statics.solve import Method
from cdpr_sim.studies.lines import PAPER_HEIGHTS, PAPER_LINE, along_x
from cdpr_sim.studies.solvers import timed

PAPER_ITERATIONS, PAPER_SECONDS = (14, 286), (2e-3, 61e-3)
"""Smallest and largest values of SEECR, on an i7-10850H; "less iterations were needed at the center"."""

TRACKER_ACCURACY = 0.065e-3
"""[m] Volumetric, of the C-track that measured DemoBot (section IV)."""

MIDDLE = 0.1
"""[m] Poses within this distance of the middle of the line count as its middle."""


@dataclass(frozen=True, eq=False)
class Performance:
    """One solver on one layout, along the paper's lines.

    Attributes:
        layout: name of the robot.
        method: the solver.
        x: commanded, (poses,) [m]; every line's poses one after the other.
        iterations: (poses,) evaluations as SciPy counts them, or Newton's steps.
        seconds: (poses,), solved or not [s].
        solved: (poses,) whether forces balance at the result.
    """

    layout: str
    method: Method
    x: Float[np.ndarray, " poses"]
    iterations: Int[np.ndarray, " poses"]
    seconds: Float[np.ndarray, " poses"]
    solved: Bool[np.ndarray, " poses"]

    @property
    def middle(self) -> Bool[np.ndarray, " poses"]:
        """Which of the poses are near the middle of the line."""
        return np.abs(self.x - np.mean(PAPER_LINE)) <= MIDDLE


def performance(
    layouts: Sequence[str] = ("cogiro", "parallel"),
    materials: Sequence[str] = PAPER_MATERIALS,
    heights: Sequence[float] = PAPER_HEIGHTS,
    *,
    rows: int = 24,
    methods: Sequence[Method] = get_args(Method),
) -> tuple[Performance, ...]:
    """Every solver at every pose of the paper's lines, one pose at a time; for each layout and method."""
    results = []
    for layout in layouts:
        robots = [load_robot(layout).replace(material=material) for material in materials]
        problems = [
            (robot, position)
            for robot in robots
            for height in heights
            for position in along_x(robot, height, PAPER_LINE, rows)
        ]
        solve_many(robots[0], [position for _, position in problems])  # compiles before the timing
        for method in methods:
            found, solved, seconds = zip(*(timed(robot, position, method) for robot, position in problems), strict=True)
            x = np.array([position[0] for _, position in problems])
            iterations = np.array([0 if one is None else one.iterations for one in found])
            results.append(Performance(layout, method, x, iterations, np.array(seconds), np.array(solved)))
    return tuple(results)

"""Compare the paper's numbers with ours: performance of the solvers, resolution of the tracker, and nylon lines.

Run: python scripts/figures/paper_numbers.py
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import get_args

import numpy as np
from jaxtyping import Bool, Float, Int
from rich.console import Console

import cdpr_sim as cdpr
from cdpr_sim.core.materials import NYLON_FIBRES, NYLON_MODULUS, PAPER_MATERIALS, line_stiffness
from cdpr_sim.report.table_style import new_table
from cdpr_sim.robots.catalogue import load_robot
from cdpr_sim.statics.newton import solve_many
from cdpr_sim.statics.solve import Method
from lines import PAPER_HEIGHTS, PAPER_LINE, along_x, line, paper_lines
from solvers import timed

DIAMETER = 0.4e-3  # [m] of the fishing line
ROWS = 24  # poses along a line


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


console = Console(width=110)


def main() -> None:
    print_performance()
    print_tracker()
    print_nylon()


def print_performance() -> None:
    """Iterations and time of each solver along the paper's line."""
    (fewest, most), (fast, slow) = PAPER_ITERATIONS, (1e3 * seconds for seconds in PAPER_SECONDS)
    results = performance(rows=ROWS)
    rows = new_table(
        f"Along the paper's line: {len(results[0].x)} poses per row, two materials, two heights, one pose at a time",
        "robot", "solver", "solved", "iterations", "in the\nmiddle", "else-\nwhere",
        "ms", "in the\nmiddle", "else-\nwhere", text_columns=0,
    )  # fmt: skip
    for one in results:
        iterations, milliseconds = one.iterations[one.solved], 1e3 * one.seconds[one.solved]
        middle = one.middle[one.solved]
        rows.add_row(
            one.layout,
            one.method,
            f"{one.solved.sum()} of {len(one.solved)}",
            f"{iterations.min()} to {iterations.max()}",
            *(f"{np.median(iterations[where]):.0f}" for where in (middle, ~middle)),
            f"{milliseconds.min():.1f} to {milliseconds.max():.1f}",
            *(f"{np.median(milliseconds[where]):.1f}" for where in (middle, ~middle)),
        )
    console.print(rows)
    console.print(
        f"The paper: {fewest} to {most} iterations, {fast:g} to {slow:g} ms, fewest in the middle. Here: of the poses "
        f"solved; in the middle, within {1e3 * MIDDLE:g} mm of it, and elsewhere, medians. Iterations are "
        "evaluations as SciPy counts them (for least_squares without those for its Jacobian), or Newton's steps.\n",
        highlight=False,
    )


def print_tracker() -> None:
    """How much too low ``cogiro`` is with Vectran, the stiffest cable."""
    vectran = [one for one in paper_lines(["cogiro"], settled_rows=ROWS) if one.robot.material == "vectran-0.7mm"]
    deviations = -1e3 * np.concatenate([one.settled.deviation[:, 2] for one in vectran])
    console.print(
        f"cogiro with Vectran is {deviations.min():.3f} to {deviations.max():.3f} mm too low along the line, "
        f"{np.median(deviations):.3f} mm in the median; the paper's tracker has an accuracy of "
        f"{1e3 * TRACKER_ACCURACY:g} mm.\n",
        highlight=False,
    )


def print_nylon() -> None:
    """How much too low ``parallel`` is at the ends of the line, with the materials and with soft to stiff nylon."""
    rows = new_table(
        "parallel at the ends of the paper's line, settled in MuJoCo (the paper: about 15 mm too low)",
        "cable", "EA [N]", *(f"too low by [mm]\nat z = {z:g} m" for z in PAPER_HEIGHTS), "methods differ\nby [mm]",
        text_columns=0,
    )  # fmt: skip
    cables = [(name, material.axial_stiffness) for name, material in cdpr.MATERIALS.items()]
    low, high = NYLON_FIBRES
    for modulus in (low, NYLON_MODULUS, high):
        cables.append((f"nylon of {modulus / 1e9:.1f} GPa, {1e3 * DIAMETER:g} mm", line_stiffness(modulus, DIAMETER)))
    for name, stiffness in cables:
        robot = cdpr.load_robot("parallel").replace(axial_stiffness=stiffness)
        ends = [line(robot, height, PAPER_LINE, static_rows=2, settled_rows=2) for height in PAPER_HEIGHTS]
        difference = max(np.abs((end.settled.deviation - end.static.deviation)[:, 2]).max() for end in ends)
        deviations = [-1e3 * end.settled.deviation[:, 2].mean() for end in ends]
        rows.add_row(name, f"{stiffness:.0f}", *(f"{one:.1f}" for one in deviations), f"{1e3 * difference:.0e}")
    console.print(rows)


if __name__ == "__main__":
    main()

"""Equilibria along lines and across the width of robots, by both methods: the data of the paper's figures.

A study returns a frozen result that includes its problems. The static method is evaluated at many poses (lines), MuJoCo
at few (points); neither is interpolated or corrected by the other.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from cdpr_sim.analysis.workspace.feasibility import capacity_margin
from cdpr_sim.core.equilibrium_batch import EquilibriumBatch, all_solved
from cdpr_sim.core.materials import PAPER_MATERIALS
from cdpr_sim.core.robot import Robot
from cdpr_sim.physics.settle import settle_many
from cdpr_sim.robots.catalogue import load_robot
from cdpr_sim.statics.newton import solve_many

PAPER_LINE = (0.17, 0.63)
"""[m] Ends of the paper's trajectories along x (section IV)."""

PAPER_HEIGHTS = (0.1, 0.2)
"""[m] The heights z of the paper's trajectories."""

PAPER_TILT, PAPER_DEVIATION = np.radians(20.0), 0.015
"""[rad], [m] Tilt and deviation in z at both ends of the paper's lines, parallel layout, either cable: "approximately
20°" and "about 15 mm". Read from the paper's text (section IV), not from its data."""

COLUMNS = 5
"""Poses drawn side by side across a workspace."""

_SAME_HEIGHT = 1e-9
"""[m]"""

SAME_TENSION = 1e-6
"""[N]"""


# Equilibria by both methods


def homes() -> tuple[EquilibriumBatch, ...]:
    """Equilibrium of each of the four layouts at the middle of its workspace, by the static method (Fig. 6).

    Raises:
        NotConverged: some layout has no equilibrium.
    """
    robots = [load_robot(name) for name in ("planar-vertical", "planar-horizontal", "parallel", "cogiro")]
    return tuple(all_solved(solve_many(robot, robot.home[None])) for robot in robots)


def twins(equilibria: EquilibriumBatch) -> list[list[int]]:
    """Groups of cables with equal tension in all rows, as by symmetry."""
    groups: list[list[int]] = []
    for cable, tensions in enumerate(equilibria.tensions.T):
        for group in groups:
            if np.allclose(tensions, equilibria.tensions[:, group[0]], rtol=0, atol=SAME_TENSION):
                group.append(cable)
                break
        else:
            groups.append([cable])
    return groups


def zones(equilibria: EquilibriumBatch) -> tuple[tuple[float, float, int], ...]:
    """(from, to, number of slack cables) along the commanded x [m], for rows ordered in x."""
    x, slack = equilibria.problems.positions[:, 0], equilibria.slack.sum(1)
    changes = np.flatnonzero(np.diff(slack)) + 1
    starts, ends = np.append(0, changes), np.append(changes, len(equilibria) - 1)
    return tuple((float(x[a]), float(x[b]), int(slack[a])) for a, b in zip(starts, ends, strict=True))


# Along a line (Fig. 7, 8, 10, 11, 12)


@dataclass(frozen=True, eq=False)
class Line:
    """One robot commanded along x at one height, by both methods.

    Attributes:
        static: at many poses, for lines.
        settled: at few poses, for points.
    """

    static: EquilibriumBatch
    settled: EquilibriumBatch

    @property
    def robot(self) -> Robot:
        """The robot."""
        return self.static.robot

    @property
    def height(self) -> float:
        """Commanded z [m]."""
        return float(self.static.problems.positions[0, 2])


@dataclass(frozen=True, eq=False)
class Width:
    """One robot across its workspace: poses to draw, and tensions along the width for each material.

    Attributes:
        poses: a few poses at a few heights, by the static method, with the softest material, which deviates most.
        lines: one per material, all at the same height.
        workspace: outline of the static feasible workspace in the plane of the poses, (points, 3) [m]: from the first
            to the last feasible x at each height; empty if no pose is feasible.
    """

    poses: EquilibriumBatch
    lines: tuple[Line, ...]
    workspace: Float[np.ndarray, "points 3"]

    def feasible(self, height: float) -> tuple[float, float] | None:
        """Range of x [m] of the static feasible workspace at ``height``; None if it is empty."""
        if not len(self.workspace):
            return None
        heights = self.workspace[:, 2]
        row = self.workspace[np.abs(heights - height) <= np.abs(heights - height).min() + _SAME_HEIGHT, 0]
        return float(row.min()), float(row.max())


def line(
    robot: Robot, height: float, ends: tuple[float, float], *, static_rows: int = 601, settled_rows: int = 24
) -> Line:
    """Command ``robot`` level along x from end to end [m] at ``height`` z [m], midway in y.

    Raises:
        NotConverged: the static solver found no equilibrium at some pose.
        NotSettled: MuJoCo did not settle at some pose.
    """
    return Line(
        all_solved(solve_many(robot, along_x(robot, height, ends, static_rows))),
        all_solved(settle_many(robot, along_x(robot, height, ends, settled_rows))),
    )


def across_the_width(
    robot: Robot,
    *,
    pose_heights: Sequence[float] = (0.28, 0.1),
    static_rows: int = 1201,
    settled_rows: int = 25,
) -> Width:
    """``robot`` commanded across its whole workspace along x, with each of the paper's materials.

    Raises:
        NotConverged: the static solver found no equilibrium at some pose.
        NotSettled: MuJoCo did not settle at some pose.
    """
    robots, height = [robot.replace(material=name) for name in PAPER_MATERIALS], PAPER_HEIGHTS[0]
    ends = (float(robot.workspace[0, 0]), float(robot.workspace[1, 0]))
    poses = np.concatenate([along_x(robot, z, ends, COLUMNS) for z in pose_heights])
    softest = min(robots, key=lambda one: one.axial_stiffness.min())
    return Width(
        poses=all_solved(solve_many(softest, poses)),
        lines=tuple(line(one, height, ends, static_rows=static_rows, settled_rows=settled_rows) for one in robots),
        workspace=feasible_outline(robot),
    )


def feasible_outline(robot: Robot, columns: int = 601, rows: int = 71) -> Float[np.ndarray, "points 3"]:
    """Outline of the static feasible workspace in the x-z plane midway in y, up on the left and down on the right [m].

    The poses of the robot's workspace at which rigid cables hold the level platform (in the paper's Fig. 10 and 11
    from ARACHNIS); it does not depend on the cables' stiffness. The capacity margin is zero on the outline.
    """
    (x0, _, z0), (x1, _, z1) = robot.workspace
    x, z = np.linspace(x0, x1, columns), np.linspace(z0, z1, rows)
    grid = np.stack(np.broadcast_arrays(x, robot.home[1], z[:, None]), axis=-1)
    margins = capacity_margin(robot, grid)
    left, right = [], []
    for positions, margin in zip(grid, margins, strict=True):
        held = np.flatnonzero(margin >= 0).tolist()
        if held:
            left.append(_crossing(positions, margin, held[0], held[0] - 1))
            right.append(_crossing(positions, margin, held[-1], held[-1] + 1))
    return np.array(left + right[::-1]).reshape(-1, 3)


def _crossing(positions: np.ndarray, margin: np.ndarray, inside: int, outside: int) -> np.ndarray:
    """Position of zero margin between two neighbours; the first one if the second is outside the grid."""
    if not 0 <= outside < len(positions):
        return positions[inside]
    share = margin[inside] / (margin[inside] - margin[outside])
    return positions[inside] + share * (positions[outside] - positions[inside])


def paper_lines(
    layouts: Sequence[str] = ("parallel", "cogiro"), *, static_rows: int = 601, settled_rows: int = 13
) -> tuple[Line, ...]:
    """The paper's experiment (section IV): every layout (default: the paper's) with every material at every height.

    Raises:
        NotConverged: the static solver found no equilibrium at some pose.
        NotSettled: MuJoCo did not settle at some pose.
    """
    return tuple(
        line(robot.replace(material=material), height, PAPER_LINE, static_rows=static_rows, settled_rows=settled_rows)
        for robot in map(load_robot, layouts)
        for material in PAPER_MATERIALS
        for height in PAPER_HEIGHTS
    )


def along_x(robot: Robot, height: float, ends: tuple[float, float], rows: int) -> Float[np.ndarray, "rows 3"]:
    """Positions along x from end to end [m] at one height, midway in y."""
    x = np.linspace(*ends, rows)
    return np.stack([x, np.full(rows, robot.home[1]), np.full(rows, height)], axis=-1)

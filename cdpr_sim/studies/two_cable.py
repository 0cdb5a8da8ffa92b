"""The two-cable bar by closed forms, the static solver and MuJoCo (the paper's Fig. 3 and 4)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from numpy.typing import ArrayLike

from cdpr_sim.core.equilibrium_batch import EquilibriumBatch
from cdpr_sim.core.robot import Robot
from cdpr_sim.robots.catalogue import load_robot
from cdpr_sim.statics import two_cable_closed_form
from cdpr_sim.studies.lines import PAPER_HEIGHTS, Line, along_x, equilibria_by_mujoco, equilibria_by_statics, line


@dataclass(frozen=True, eq=False)
class Manifold:
    """Equilibria of the two-cable bar, and its drift with decreasing stiffness (Fig. 3).

    Attributes:
        robot: the robot.
        x: (columns,) [m].
        z: (heights,) [m].
        rotation_about_y: the closed form's upright equilibrium, (heights, columns) [rad].
        commanded: level poses, (commands, 3) [m].
        axial_stiffness: EA, (drifts,) [N], stiffest first.
        static: one ``EquilibriumBatch`` per stiffness, a row per command.
        settled: by MuJoCo, for some of the stiffnesses.
    """

    robot: Robot
    x: Float[np.ndarray, " columns"]
    z: Float[np.ndarray, " heights"]
    rotation_about_y: Float[np.ndarray, "heights columns"]
    commanded: Float[np.ndarray, "commands 3"]
    axial_stiffness: Float[np.ndarray, " drifts"]
    static: tuple[EquilibriumBatch, ...]
    settled: tuple[EquilibriumBatch, ...]


@dataclass(frozen=True, eq=False)
class ClosedForms:
    """The two-cable bar by both methods and by two closed forms, of a bar and of a point (Fig. 4).

    Attributes:
        line: the bar commanded along x.
        closed_form: equilibrium rotation about y [rad] at the positions of the static method, (rows,).
        short_bar: by the paper's Eq. 5 and 6, corrected, for a bar of length zero, (rows,) [rad].
        poses: a few poses at a few heights, by the static method.
        settled_poses: the same poses by MuJoCo.
        balanced: the closed form's rotation [rad] at the commanded positions of ``poses``.
    """

    line: Line
    closed_form: Float[np.ndarray, " rows"]
    short_bar: Float[np.ndarray, " rows"]
    poses: EquilibriumBatch
    settled_poses: EquilibriumBatch
    balanced: Float[np.ndarray, " poses"]


def manifold(
    robot: Robot | None = None,
    *,
    commanded: ArrayLike = ((0.18, 0, 0.3), (0.4, 0, 0.3), (0.58, 0, 0.15)),
    stiffest: float = 1e3,
    softest: float = 15.0,
    drifts: int = 49,
    settled_every: int = 12,
    columns: int = 61,
    heights: int = 41,
) -> Manifold:
    """The two-cable robot's manifold over its workspace, and its drift with decreasing EA [N].

    Raises:
        NotConverged: the static solver found no equilibrium at some pose.
        NotSettled: MuJoCo did not settle at some pose.
    """
    robot = load_robot("two-cable") if robot is None else robot
    (left, _, bottom), (right, _, top) = robot.workspace
    x, z = np.linspace(left, right, columns), np.linspace(bottom, top, heights)
    commanded = np.asarray(commanded, dtype=float)
    stiffness = 1 / np.linspace(1 / stiffest, 1 / softest, drifts)  # even steps of drift
    robots = [robot.replace(axial_stiffness=EA) for EA in stiffness]
    return Manifold(
        robot=robot,
        x=x,
        z=z,
        rotation_about_y=np.array([[_upright(robot, [a, 0.0, b]) for a in x] for b in z]),
        commanded=commanded,
        axial_stiffness=stiffness,
        static=tuple(equilibria_by_statics(one, commanded) for one in robots),
        settled=tuple(equilibria_by_mujoco(one, commanded) for one in robots[::settled_every]),
    )


def closed_forms(
    robot: Robot | None = None,
    *,
    height: float = PAPER_HEIGHTS[0],
    pose_heights: Sequence[float] = (0.1, 0.22, 0.34),
    columns: int = 5,
    static_rows: int = 201,
    settled_rows: int = 25,
) -> ClosedForms:
    """The two-cable bar commanded across its workspace, compared with its closed forms.

    Raises:
        NotConverged: the static solver found no equilibrium at some pose.
        NotSettled: MuJoCo did not settle at some pose.
    """
    robot = load_robot("two-cable") if robot is None else robot
    ends = (float(robot.workspace[0, 0]), float(robot.workspace[1, 0]))
    along = line(robot, height, ends, static_rows=static_rows, settled_rows=settled_rows)
    poses = np.concatenate([along_x(robot, z, ends, columns) for z in pose_heights])
    return ClosedForms(
        line=along,
        closed_form=np.array([_upright(robot, position) for position in along.static.positions]),
        short_bar=np.array(
            [two_cable_closed_form.short_bar_rotation(robot, position) for position in along.static.positions]
        ),
        poses=equilibria_by_statics(robot, poses),
        settled_poses=equilibria_by_mujoco(robot, poses),
        balanced=np.array([_upright(robot, position) for position in poses]),
    )


def _upright(robot: Robot, position: ArrayLike) -> float:
    """The closed form's equilibrium with the smallest rotation [rad]."""
    rotations = two_cable_closed_form.equilibrium_rotations(robot, position)
    return float(rotations[np.argmin(np.abs(rotations))])

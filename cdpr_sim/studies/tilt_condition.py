"""Cause of the tilt of a planar platform on parallel cables: intersection of its two sides' forces (paper, Fig. 9)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float
from numpy.typing import ArrayLike

from cdpr_sim.core.robot import Robot
from cdpr_sim.robots.catalogue import load_robot
from cdpr_sim.statics.forces import at, geometry
from cdpr_sim.statics.given_tensions import cut
from cdpr_sim.statics.solve import solve

DIRECTIONS = 10
"""Choices of equal tensions of cables with mass, each with the directions in which they pull under the last."""


@dataclass(frozen=True, eq=False)
class MomentBalance:
    """Moment balance of a planar platform on two pairs of cables (Fig. 9).

    Attributes:
        robot: the robot.
        position: of the platform (and of its centre of mass), (3,) [m].
        rotation: (3, 3).
        slack: (cables,).
        rest_lengths: (cables,) [m], at the commanded pose.
        starts: a point on each side's line of force, (2, 3) [m].
        directions: unit vectors along them, (2, 3).
        point: the paper's name of the midlines' intersection: "H" for horizontal pairs, "V" for vertical ones.
        intersection: of the two lines of force, (3,) [m]; ``point`` for equal tensions in each pair.
        arm: horizontal distance of the centre of mass from there [m], positive to the right.
        moment: of the weight about the intersection [N m], positive as rotation about y: m g arm.
        net_moment: of all forces together about y, by the wrench matrix [N m]; equals ``moment``.
        at_rest: whether the tensions are those of the equilibrium, or equal in each pair.
    """

    robot: Robot
    position: Float[np.ndarray, "3"]
    rotation: Float[np.ndarray, "3 3"]
    slack: Bool[np.ndarray, " cables"]
    rest_lengths: Float[np.ndarray, " cables"]
    starts: Float[np.ndarray, "2 3"]
    directions: Float[np.ndarray, "2 3"]
    point: str
    intersection: Float[np.ndarray, "3"]
    arm: float
    moment: float
    net_moment: float
    at_rest: bool


def equal_pulls(robot: Robot, position: ArrayLike) -> MomentBalance:
    """Moment balance at a level pose, with equal tensions in each pair that carry the weight.

    The intersection is the paper's point H or V, and ``net_moment`` tilts the platform.
    """
    position = np.asarray(position, dtype=float)
    rotation = np.eye(3)
    pulls, tensions = geometry(robot, position, rotation).wrench_matrix, np.zeros(robot.cables)
    for _ in range(1 if robot.cabling.massless else DIRECTIONS):
        pairs = pulls.reshape(6, 2, -1).sum(-1)  # unit tension in both cables of a pair
        sides = np.linalg.solve(pairs[[0, 2]], [0.0, robot.weight])
        tensions = np.repeat(sides, robot.cables // 2)
        pulls = pulls if robot.cabling.massless else cut(robot, position, rotation, tensions)[1]
    return _balance(robot, position, rotation, pulls, tensions, robot.rest_lengths(position), at_rest=False)


def balance_at_rest(robot: Robot, commanded: ArrayLike) -> MomentBalance:
    """Moment balance at the static equilibrium: the lines intersect on the vertical through the centre of mass.

    Raises:
        NotConverged: the static solver found no equilibrium.
    """
    one = solve(robot, np.asarray(commanded, dtype=float))
    rotation = one.rotation.as_matrix()
    pulls = at(one.problem, one.position, rotation).wrench_matrix
    return _balance(robot, one.position, rotation, pulls, one.tensions, one.rest_lengths, at_rest=True)


def moment_balances() -> tuple[MomentBalance, ...]:
    """Cases of Fig. 9: horizontal pairs beside the middle; vertical pairs at the middle, beside it, and at equilibrium.

    Raises:
        NotConverged: the static solver found no equilibrium.
    """
    horizontal, vertical = load_robot("planar-horizontal"), load_robot("planar-vertical")
    middle, beside = np.array([0.4, 0.0, 0.2]), np.array([0.25, 0.0, 0.2])
    return (
        equal_pulls(horizontal, beside),
        equal_pulls(vertical, middle),
        equal_pulls(vertical, beside),
        balance_at_rest(vertical.replace(material="fishing-0.4mm"), beside),
    )


def _balance(
    robot: Robot,
    position: Float[np.ndarray, "3"],
    rotation: Float[np.ndarray, "3 3"],
    wrench_matrix: Float[np.ndarray, "6 cables"],
    tensions: Float[np.ndarray, " cables"],
    rest_lengths: Float[np.ndarray, " cables"],
    *,
    at_rest: bool,
) -> MomentBalance:
    forces = (tensions * wrench_matrix[:3]).T.reshape(2, -1, 3)
    anchors = (position + robot.anchors @ rotation.T).reshape(2, -1, 3)
    side_forces = forces.sum(1)
    starts = np.array([_point_of_action(points, pair) for points, pair in zip(anchors, forces, strict=True)])
    directions = side_forces / np.linalg.norm(side_forces, axis=1, keepdims=True)
    along = np.linalg.solve(
        np.stack([directions[0, [0, 2]], -directions[1, [0, 2]]], -1), (starts[1] - starts[0])[[0, 2]]
    )
    intersection = starts[0] + along[0] * directions[0]
    arm = float(position[0] - intersection[0])
    return MomentBalance(
        robot=robot,
        position=position,
        rotation=rotation,
        slack=tensions <= 0,
        rest_lengths=rest_lengths,
        starts=starts,
        directions=directions,
        point="H" if robot.anchors[0, 2] == robot.anchors[1, 2] else "V",
        intersection=intersection,
        arm=arm,
        moment=robot.weight * arm,
        net_moment=float((wrench_matrix @ tensions)[4]),
        at_rest=at_rest,
    )


def _point_of_action(
    points: Float[np.ndarray, "pair 3"], forces: Float[np.ndarray, "pair 3"]
) -> Float[np.ndarray, "3"]:
    """The point on the line of the resultant of ``forces`` in the x-z plane that is closest to the anchors' middle."""
    total, middle = forces.sum(0), points.mean(0)
    moment = np.cross(points - middle, forces).sum(0)
    return middle + np.cross(total, moment) / (total @ total)

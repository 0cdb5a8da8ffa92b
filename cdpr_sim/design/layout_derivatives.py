"""Exact first derivatives of the equilibria of one layout by its variables, for all cases and variables at once.

The winches know the layout: where an exit moves, the rigid lengths at the commanded pose (paper Eq. 1, 2) change with
it. By the implicit function theorem dx = −(∂F/∂x)⁻¹ ∂F, with F the net wrench and the present set of taut cables;
``analysis.sensitivity`` does the same for one equilibrium and each parameter of the robot.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from cdpr_sim.core.robot import Robot
from cdpr_sim.design.layout_equilibria import Cases
from cdpr_sim.statics import derivatives, forces

CONDITION = 1e12
"""Largest condition number; beyond it some direction is neutrally stable within rounding."""


@dataclass(frozen=True, eq=False)
class Steps:
    """Derivatives of a robot's parameters by the variables: (variables, ...).

    Attributes:
        exits, anchors: (variables, cables, 3).
        axial_stiffness: (variables, cables).
        center: of mass, (variables, 3).
        known: whether the winches know the change and adapt the rest lengths; others are of exits and anchors only.
    """

    exits: Float[np.ndarray, "variables cables 3"]
    anchors: Float[np.ndarray, "variables cables 3"]
    axial_stiffness: Float[np.ndarray, "variables cables"]
    center: Float[np.ndarray, "variables 3"]
    known: bool = True

    @classmethod
    def errors(cls, robot: Robot) -> Steps:
        """An error of each coordinate of each exit and anchor, unknown to the winches."""
        m = robot.cables
        each = np.eye(3 * m).reshape(3 * m, m, 3)
        if robot.mobility == "planar":
            each = each[np.arange(3 * m) % 3 != 1]
        none = np.zeros_like(each)
        exits, anchors = np.concatenate([each, none]), np.concatenate([none, each])
        return cls(exits, anchors, np.zeros((len(exits), m)), np.zeros((len(exits), 3)), known=False)


def layout_derivatives(
    robot: Robot,
    cases: Cases,
    positions: Float[np.ndarray, "cases 3"],
    rotations: Float[np.ndarray, "cases 3 3"],
    rest_lengths: Float[np.ndarray, "cases cables"],
    steps: Steps,
) -> tuple[Float[np.ndarray, "cases variables 6"], Float[np.ndarray, "cases variables cables"]]:
    """Derivatives of (translation [m], left-applied rotation vector [rad]) and of tensions [N] by ``steps``.

    nan in neutrally stable cases. For cables with mass only by steps that are not known.
    """
    state = forces.at(cases.problems(robot, rest_lengths), positions, rotations)
    by, arms = derivatives.pull_by_parameter(state), state.geometry.arms[:, None]
    arm_moves = np.einsum("cij,nmj->cnmi", rotations, steps.anchors)
    force = np.einsum("cmij,cnmj->cnmi", by["exits"], steps.exits[None] - arm_moves)
    if steps.known:
        commanded = forces.geometry(robot, cases.positions, cases.rotations).directions[:, None]
        length_changes = (
            commanded * (steps.exits[None] - np.einsum("cij,nmj->cnmi", cases.rotations, steps.anchors))
        ).sum(-1)
        stiffness_changes = cases.factors[:, None, None] * steps.axial_stiffness
        force += by["rest_lengths"][:, None, ..., 0] * length_changes[..., None]
        force += by["axial_stiffness"][:, None, ..., 0] * stiffness_changes[..., None]
    torque = np.cross(arms, force) + np.cross(arm_moves, state.pulls[:, None])
    weight = np.array([0.0, 0.0, -robot.weight])
    center = np.cross(np.einsum("cij,nj->cni", rotations, steps.center), weight)
    wrench = np.concatenate([force.sum(-2), torque.sum(-2) + center], axis=-1)
    free = robot.free
    slope = derivatives.wrench_slope(state)[:, free][:, :, free]
    scaled = slope / np.outer(robot.units[free], robot.units[free])
    held = np.asarray(np.isfinite(scaled).all((-1, -2)))
    held[held] = np.linalg.cond(scaled[held]) < CONDITION
    pose = np.full(wrench.shape, np.nan)
    pose[held] = 0.0
    found = -np.linalg.solve(slope[held], wrench[held][..., free].swapaxes(-1, -2))
    pose[np.ix_(np.flatnonzero(held), np.arange(len(steps.center)), np.array(free))] = found.swapaxes(-1, -2)
    anchors = pose[..., None, :3] + np.cross(pose[..., None, 3:], arms)
    force -= np.einsum("cmij,cnmj->cnmi", state.cable_stiffness, anchors)
    return pose, (state.pull_directions[:, None] * force).sum(-1) / robot.reeving

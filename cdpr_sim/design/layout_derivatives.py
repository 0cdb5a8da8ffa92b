"""Exact first derivatives of the equilibria of one layout by its variables, for all cases and variables at once.

The winches know the layout: where an exit moves, the rigid lengths at the commanded pose (paper Eq. 1, 2) change with
it. By the implicit function theorem dx = −(∂F/∂x)⁻¹ ∂F, with F the net wrench and the present set of taut cables;
``analysis.sensitivity`` does the same for one equilibrium and each parameter of the robot.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from jaxtyping import Float

from cdpr_sim.design.layout_equilibria import LayoutEquilibria
from cdpr_sim.statics import derivatives, forces

CONDITION = 1e12
"""Largest condition number; beyond it some direction is neutrally stable within rounding."""


def layout_derivatives(
    equilibria: LayoutEquilibria,
    row: int,
    changes: Mapping[str, Float[np.ndarray, "parameters variables"]],
    *,
    known: bool,
) -> tuple[Float[np.ndarray, "cases 6 variables"], Float[np.ndarray, "cases cables variables"]]:
    """Derivatives of (translation [m], left-applied rotation vector [rad]) and of tensions [N] by the variables.

    nan in neutrally stable cases. For cables with mass only by changes that are not known.

    Args:
        equilibria: of the layouts.
        row: the layout.
        changes: derivatives of its parameters by the variables, by the names of ``derivatives.PARAMETERS``.
        known: whether the winches know the changes of exits and anchors and adapt the rest lengths.
    """
    robot, cases, changes = equilibria.layouts.robot_at(row), equilibria.cases, dict(changes)
    problems = cases.problems(robot, equilibria.problems.rest_lengths[row])
    state = forces.at(problems, equilibria.positions[row], equilibria.rotations[row])
    if "axial_stiffness" in changes:
        changes["axial_stiffness"] = cases.factors[:, None, None] * changes["axial_stiffness"]
    if known:
        pulls = forces.geometry(robot, cases.positions, cases.rotations).directions
        exits, anchors = (changes[name].reshape(robot.cables, 3, -1) for name in ("exits", "anchors"))
        by_exits, by_anchors = np.einsum("cmi,miv->cmv", pulls, exits), pulls @ cases.rotations
        changes["rest_lengths"] = by_exits - np.einsum("cmi,miv->cmv", by_anchors, anchors)
    changes = {name: change for name, change in changes.items() if change.any()}
    wrench, tensions = derivatives.along_changes(state, changes)
    free = np.array(robot.free)
    slope = derivatives.wrench_slope(state)[:, free][:, :, free]
    scaled = slope / np.outer(robot.units[free], robot.units[free])
    held = np.asarray(np.isfinite(scaled).all((-1, -2)))
    held[held] = np.linalg.cond(scaled[held]) < CONDITION
    pose = np.where(held[:, None, None], np.zeros(wrench.shape), np.nan)
    pose[np.ix_(np.flatnonzero(held), free)] = -np.linalg.solve(slope[held], wrench[held][:, free])
    return pose, tensions + derivatives.tension_by_pose(state) @ pose

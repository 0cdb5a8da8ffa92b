"""Balance of forces at a pose: what is left of the net force after the friction that holds."""

# pyright: reportAttributeAccessIssue=false
# mujoco ships no type stubs for its compiled modules.
from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import mujoco
import numpy as np
from jaxtyping import Float, Int

from cdpr_sim.anymodel.forces import Net, RestForces
from cdpr_sim.anymodel.friction import FrictionRows, Held, hold, rows_of


@dataclass(frozen=True, eq=False)
class Unbalanced:
    """What remains of the net force on some degrees of freedom.

    Attributes:
        force: (n,) [N, N m].
        residual: its largest part over the largest part of the forces, both by the roots of the masses.
        of_load: the same over the largest force of gravity, actuators and applied forces; 0 without load.
        held: the friction.
    """

    force: Float[np.ndarray, " n"]
    residual: float
    of_load: float
    held: Held


class Balance:
    """Balance of a model's forces, with or without friction that holds."""

    def __init__(self, forces: RestForces, friction: bool) -> None:
        self.forces, self.friction = forces, friction
        model = forces.model
        kinds = model.jnt_type[model.dof_jntid]
        within = np.arange(model.nv) - model.jnt_dofadr[model.dof_jntid]
        floats = (kinds == mujoco.mjtJoint.mjJNT_FREE) & (within < 3)
        self.translates = (kinds == mujoco.mjtJoint.mjJNT_SLIDE) | floats

    def rows(self) -> FrictionRows:
        """The friction that touches at the pose of the last evaluation."""
        forces = self.forces
        return rows_of(forces.model, forces.data) if self.friction else FrictionRows.none()

    def at(self, qpos: Float[np.ndarray, " nq"], parts: list[Int[np.ndarray, "..."]]) -> list[Unbalanced]:
        """The balance of several sets of degrees of freedom at a pose."""
        return self.evaluated(self.forces.net(qpos), self.rows(), parts)

    def evaluated(self, net: Net, rows: FrictionRows, parts: list[Int[np.ndarray, "..."]]) -> list[Unbalanced]:
        """The same of forces and friction that were just evaluated."""
        found, directions = [], rows.directions(self.forces.model, self.forces.data)
        for dofs in parts:
            scale, unloaded = net.scale(dofs), not net.parts[1:4][:, dofs].any()
            held = hold(rows, directions[:, dofs], net.force[dofs], scale)
            force = net.force[dofs] + held.force
            of_load = 0.0 if unloaded else float((np.abs(force) / net.load(dofs)).max(initial=0))
            found.append(Unbalanced(force, float((np.abs(force) / scale).max(initial=0)), of_load, held))
        return found

    def following(
        self, rows: FrictionRows, states: list[Unbalanced]
    ) -> Callable[[Float[np.ndarray, " nq"]], Float[np.ndarray, " nv"]]:
        """The net force near a pose, with the friction of that pose: the same forces along its directions.

        Where the forces balance, its derivative along directions that friction does not hold is exact: whatever else
        friction does acts along those that it holds.
        """
        pulls = rows.limits * np.sum([state.held.use for state in states], axis=0)
        if not np.any(pulls):
            return lambda qpos: self.forces.net(qpos).force

        def force(qpos: np.ndarray) -> np.ndarray:
            net, here = self.forces.net(qpos).force, self.rows()
            return net + here.force(self.forces.model, self.forces.data, here.pulls_of(rows, pulls))

        return force

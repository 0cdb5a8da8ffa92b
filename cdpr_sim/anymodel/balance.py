"""Balance of forces at a pose: what is left of the net force after the friction that holds."""

# pyright: reportAttributeAccessIssue=false
# mujoco ships no type stubs for its compiled modules.
from __future__ import annotations

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
        free: directions that friction does not hold, in columns.
        held: the friction.
        net: the net force before it.
    """

    force: Float[np.ndarray, " n"]
    residual: float
    of_load: float
    free: Float[np.ndarray, "n free"]
    held: Held
    net: Net


class Balance:
    """Balance of a model's forces, with or without friction that holds."""

    def __init__(self, forces: RestForces, friction: bool) -> None:
        self.forces, self.friction = forces, friction
        model = forces.model
        kinds = model.jnt_type[model.dof_jntid]
        within = np.arange(model.nv) - model.jnt_dofadr[model.dof_jntid]
        floats = (kinds == mujoco.mjtJoint.mjJNT_FREE) & (within < 3)
        self.translates = (kinds == mujoco.mjtJoint.mjJNT_SLIDE) | floats

    def at(self, qpos: Float[np.ndarray, " nq"], dofs: Int[np.ndarray, " n"]) -> Unbalanced:
        """The balance at a pose, of the degrees of freedom ``dofs``."""
        return self.evaluated(self.forces.net(qpos), [dofs])[0]

    def evaluated(self, net: Net, parts: list[Int[np.ndarray, "..."]]) -> list[Unbalanced]:
        """The balance of several sets of degrees of freedom, at the pose where the net force was just evaluated."""
        rows = rows_of(self.forces.model, self.forces.data) if self.friction else None
        return [self._of(net, rows, dofs) for dofs in parts]

    def _of(self, net: Net, rows: FrictionRows | None, dofs: Int[np.ndarray, " n"]) -> Unbalanced:
        scale = net.scale(dofs)
        unloaded = not net.parts[1:4][:, dofs].any()
        held = hold(rows, net.force, scale, dofs)
        force = net.force[dofs] + held.force
        of_load = 0.0 if unloaded else float((np.abs(force) / net.load(dofs)).max(initial=0))
        return Unbalanced(force, float((np.abs(force) / scale).max(initial=0)), of_load, held.free, held, net)

    def moved(
        self, qpos: Float[np.ndarray, " nq"], dofs: Int[np.ndarray, " n"], step: Float[np.ndarray, " n"]
    ) -> Float[np.ndarray, " nq"]:
        """The pose after a step of the degrees of freedom ``dofs``."""
        full = np.zeros(self.forces.model.nv)
        full[dofs] = step
        return self.forces.moved(qpos, full)

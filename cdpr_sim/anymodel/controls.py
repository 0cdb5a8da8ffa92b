"""``holding_controls``: the controls within their ranges that hold a pose, and the force that no actuator can give."""

# pyright: reportAttributeAccessIssue=false
# mujoco ships no type stubs for its compiled modules.
from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np
from jaxtyping import Float
from numpy.typing import ArrayLike
from scipy.optimize import lsq_linear

from cdpr_sim.anymodel.forces import Net, RestForces, state_of
from cdpr_sim.anymodel.support import activations_at_rest, refuse_unsupported
from cdpr_sim.core.checks import Frozen, checked_array, refuse_unless

ITERATIONS = 30
"""Linearisations: an actuator's force is piecewise linear in its control, except near the ends of its ranges."""

STEP = 1e-4
"""Of the differences by the controls, as a fraction of their ranges."""

BEST = 1e-13
"""Change of the controls, as a fraction of their ranges, at which the search ends."""


@dataclass(frozen=True, eq=False)
class HoldingControls(Frozen):
    """Controls that hold a pose as well as actuators can.

    Attributes:
        ctrl: (nu,), within their ranges.
        missing: generalised force that no actuator can give, (nv,) [N, N m].
        residual: its largest part over the largest part of the forces, scaled as in ``ModelEquilibrium``; 0 holds.
        at_limit: which controls are at an end of their range, (nu,).
    """

    ctrl: Float[np.ndarray, " nu"]
    missing: Float[np.ndarray, " nv"]
    residual: float
    at_limit: np.ndarray

    @property
    def holds(self) -> bool:
        """Whether the controls hold the pose, to 1e-8 of the largest part of the forces."""
        return self.residual <= 1e-8


def holding_controls(model: Any, qpos: ArrayLike, data: Any = None) -> HoldingControls:
    """The controls within their ranges that hold a pose, and the force that no actuator can give.

    A bounded least-squares problem over the actuators' moments, each force scaled by the root of its mass.
    Activations are those at which the actuators rest. Of controls that hold equally well, those nearest to ``data``'s.

    Args:
        model: a ``mujoco.MjModel``.
        qpos: the pose, (nq,).
        data: a ``mujoco.MjData`` with applied forces, mocap poses, active equality constraints and first controls;
            default: none, and zero controls. It is not changed.

    Returns:
        The controls, and what is left over.

    Raises:
        InvalidInput: a wrong argument, or an actuator with a state or a delay whose force at rest is not known.
    """
    refuse_unless(mujoco.MjModel, model=model)
    refuse_unless(mujoco.MjData | None, data=data)
    refuse_unsupported(model)
    forces = RestForces(model, state_of(model, data))
    pose = checked_array("qpos", qpos, (model.nq,))
    low, high = _ranges(model)
    span = np.where(np.isfinite(high - low), high - low, 1.0)
    dofs = np.arange(model.nv)

    def at(ctrl: np.ndarray) -> Net:
        forces.data.ctrl[:] = ctrl
        act, _ = activations_at_rest(forces.model, forces.data)
        forces.data.act[:] = act
        return forces.net(pose)

    ctrl = np.clip(forces.data.ctrl, low, high)
    for _ in range(ITERATIONS if model.nu else 0):
        net = at(ctrl)
        scale = net.scale(dofs)
        slopes = np.empty((model.nv, model.nu))
        for column in range(model.nu):
            step = np.zeros(model.nu)
            step[column] = STEP * span[column]
            ahead, behind = np.minimum(ctrl + step, high), np.maximum(ctrl - step, low)
            apart = (ahead - behind)[column] / span[column]
            slopes[:, column] = (at(ahead).force - at(behind).force) / (apart or 1.0) / scale
        bounds = (low - ctrl) / span, (high - ctrl) / span
        change = _least(slopes, -net.force / scale, bounds)
        ctrl = np.clip(ctrl + change * span, low, high)
        if np.abs(change).max() < BEST:
            break
    net = at(ctrl)
    residual = float((np.abs(net.force) / net.scale(dofs)).max(initial=0))
    at_limit = (ctrl <= low) | (ctrl >= high)
    return HoldingControls(ctrl, -net.force, residual, at_limit)


def _ranges(model: Any) -> tuple[np.ndarray, np.ndarray]:
    """Least and largest control of each actuator; of an integrator, which rests only at 0, both are 0."""
    limited = np.array(model.actuator_ctrllimited, dtype=bool)
    low = np.where(limited, model.actuator_ctrlrange[:, 0], -np.inf)
    high = np.where(limited, model.actuator_ctrlrange[:, 1], np.inf)
    for actuator in np.flatnonzero(model.actuator_dyntype == mujoco.mjtDyn.mjDYN_INTEGRATOR):
        low[model.actuator_ctrladr[actuator]] = high[model.actuator_ctrladr[actuator]] = 0.0
    return low, high


def _least(matrix: np.ndarray, load: np.ndarray, bounds: tuple[np.ndarray, np.ndarray]) -> np.ndarray:
    """The smallest of the solutions of the bounded least-squares problem."""
    plain = np.linalg.lstsq(matrix, load, rcond=1e-12)[0]
    if np.all(plain >= bounds[0]) and np.all(plain <= bounds[1]):
        return plain
    moves = bounds[1] > bounds[0]
    found = np.zeros(matrix.shape[1])
    if moves.any():
        within = bounds[0][moves], bounds[1][moves]
        found[moves] = lsq_linear(matrix[:, moves], load, within, method="bvls", tol=1e-14).x
    return found

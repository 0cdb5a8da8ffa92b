"""Forces of a model at rest: net generalised force, its parts, and the scale that compares forces with torques.

At zero velocity and zero acceleration ``mj_invConstraint`` gives the forces of the soft constraints in closed form:
no solver has a part in it. The net force is passive - bias + actuators + applied + constraints; it vanishes exactly
where MuJoCo's forward dynamics has no acceleration.
"""

# pyright: reportAttributeAccessIssue=false
# mujoco ships no type stubs for its compiled modules.
from __future__ import annotations

import contextlib
import copy
import time
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np
from jaxtyping import Float, Int
from numpy.typing import ArrayLike

from cdpr_sim.core.checks import checked_array
from cdpr_sim.core.errors import InvalidInput

STATE = ("qpos", "act", "ctrl", "qfrc_applied", "xfrc_applied", "mocap_pos", "mocap_quat", "eq_active")
"""What the forces at rest depend on, beside the model."""

LEAST_ACCELERATION = 1e-3
"""[1/s² of the unit of a coordinate, and a fraction of gravity] Forces that accelerate by less do not count as the
largest part: models without any load have a scale, too."""


@dataclass(frozen=True, eq=False)
class Net:
    """Net generalised force at rest, and its parts.

    Attributes:
        force: (nv,) [N, N m].
        parts: passive, gravity, actuators, applied, constraints: (5, nv).
        size: roots of the masses, (nv,): forces and torques are divided by it before they are compared.
        least: smallest scale, (nv,) in the same units.
    """

    force: Float[np.ndarray, " nv"]
    parts: Float[np.ndarray, "5 nv"]
    size: Float[np.ndarray, " nv"]
    least: Float[np.ndarray, " nv"]

    def scale(self, dofs: Int[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
        """What forces of these degrees of freedom are compared with: their largest part, by the roots of the masses."""
        largest = (np.abs(self.parts[:, dofs]) / self.size[dofs]).max(initial=0)
        return np.maximum(self.size[dofs] * largest, self.least[dofs])

    def load(self, dofs: Int[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
        """The same of gravity, actuators and applied forces alone."""
        largest = (np.abs(self.parts[1:4][:, dofs]) / self.size[dofs]).max(initial=0)
        return np.maximum(self.size[dofs] * largest, self.least[dofs])


class OutOfTime(Exception):
    """The time of the search is spent."""


class RestForces:
    """The forces at rest of a copy of a model, as a function of its pose."""

    def __init__(self, model: Any, state: Any) -> None:
        self.model = copy.copy(model)
        options = self.model.opt
        options.enableflags &= ~int(mujoco.mjtEnableBit.mjENBL_SLEEP | mujoco.mjtEnableBit.mjENBL_INVDISCRETE)
        options.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_AUTORESET | mujoco.mjtDisableBit.mjDSBL_SENSOR)
        options.noslip_iterations = 0  # its forces are no function of the pose; friction that holds is ours
        self.data = mujoco.MjData(self.model)
        write_state(self.data, state)
        self.deadline = float("inf")

    @contextlib.contextmanager
    def until(self, deadline: float) -> Iterator[None]:
        """Evaluations after a time raise ``OutOfTime``."""
        self.deadline = deadline
        try:
            yield
        finally:
            self.deadline = float("inf")

    def net(
        self, qpos: Float[np.ndarray, " nq"], qvel: np.ndarray | float = 0.0, qacc: np.ndarray | float = 0.0
    ) -> Net:
        """The net force at a pose; at a velocity or an acceleration, for derivatives."""
        model, data = self.model, self.data
        if time.monotonic() > self.deadline:
            raise OutOfTime
        data.qpos[:], data.qvel[:] = qpos, qvel
        mujoco.mj_fwdPosition(model, data)
        mujoco.mj_fwdVelocity(model, data)
        mujoco.mj_fwdActuation(model, data)
        data.qacc[:] = qacc
        mujoco.mj_invConstraint(model, data)
        outside = np.array(data.qfrc_applied)
        for body in np.flatnonzero(np.any(data.xfrc_applied, axis=1)):
            force, torque = data.xfrc_applied[body, :3], data.xfrc_applied[body, 3:]
            mujoco.mj_applyFT(model, data, force, torque, data.xipos[body], body, outside)
        parts = np.array([data.qfrc_passive, -data.qfrc_bias, data.qfrc_actuator, outside, data.qfrc_constraint])
        gravity = max(1.0, float(np.linalg.norm(model.opt.gravity)))
        return Net(parts.sum(axis=0), parts, np.sqrt(model.dof_M0), LEAST_ACCELERATION * gravity * model.dof_M0)

    def moved(self, qpos: Float[np.ndarray, " nq"], step: Float[np.ndarray, " nv"]) -> Float[np.ndarray, " nq"]:
        """The pose after a step in the tangent space."""
        there = np.array(qpos)
        mujoco.mj_integratePos(self.model, there, step, 1)
        return there

    def between(self, one: Float[np.ndarray, " nq"], two: Float[np.ndarray, " nq"]) -> Float[np.ndarray, " nv"]:
        """The step in the tangent space from one pose to another."""
        step = np.zeros(self.model.nv)
        mujoco.mj_differentiatePos(self.model, step, 1, one, two)
        return step

    def mass(self) -> Float[np.ndarray, "nv nv"]:
        """The mass matrix at the pose of the last evaluation."""
        full = np.zeros((self.model.nv, self.model.nv))
        mujoco.mj_fullM(self.model, self.data, full)
        return full


def state_of(model: Any, data: Any = None, ctrl: ArrayLike | None = None) -> Any:
    """A new ``MjData`` with what the forces at rest depend on: that of ``data``, with these controls if given.

    Raises:
        InvalidInput: the data of another model or one that is not finite, or controls of another number.
    """
    state = mujoco.MjData(model)
    if data is not None:
        for name in STATE:
            found, expected = len(getattr(data, name)), len(getattr(state, name))
            if found != expected:
                what = "a pose" if name == "qpos" else name
                raise InvalidInput(f"data: found {what} of {found} numbers, expected that of the model, {expected}")
            if not np.isfinite(getattr(data, name)).all():
                raise InvalidInput(f"data: found {name} that is not finite, expected finite numbers")
        write_state(state, data)
    if ctrl is not None:
        state.ctrl[:] = checked_array("ctrl", ctrl, (model.nu,))
    return state


def write_state(to: Any, state: Any) -> None:
    """Copy from one ``MjData`` to another all that the forces at rest depend on."""
    for name in STATE:
        getattr(to, name)[:] = getattr(state, name)

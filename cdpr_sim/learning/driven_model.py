"""A model with winches as actuators, its platform and cables damped as in ``track``: for simulations side by side."""

# pyright: reportAttributeAccessIssue=false
# mujoco ships no type stubs for its compiled modules.
from __future__ import annotations

import mujoco
import numpy as np
from jaxtyping import Float
from numpy.typing import ArrayLike
from scipy.spatial.transform import RigidTransform

from cdpr_sim.core.controller import Command
from cdpr_sim.core.robot import Robot
from cdpr_sim.physics import winches
from cdpr_sim.physics.cable import Law
from cdpr_sim.physics.damping import stiffest
from cdpr_sim.physics.mjcf import place, to_mjcf
from cdpr_sim.physics.sensing import Readings
from cdpr_sim.physics.settle import settle


class DrivenModel:
    """A robot with massless linear cables in MuJoCo, in equilibrium on its first lengths.

    Attributes:
        robot: the robot.
        model, data: in MuJoCo, with the platform and the cables damped.
        readings: of the model's sensors.
        platform: number of the platform's body.
        winch_speed: largest rate at which a rest length changes [m/s].
        fastest: angular frequency of the fastest oscillation [rad/s].
        damping_time: of that oscillation [s].
        reach: shortest and longest lengths that the winches can let out, (2, cables) [m].
        let_out: rest lengths that winches have let out, (cables,) [m].
    """

    def __init__(
        self,
        robot: Robot,
        pose: RigidTransform,
        lengths: Float[np.ndarray, " cables"],
        *,
        winch_speed: float,
        damping: float,
        cable_damping: float,
        winch_force: ArrayLike | None,
    ) -> None:
        self.robot, self.winch_speed = robot, winch_speed
        self.model = model = mujoco.MjModel.from_xml_string(to_mjcf(robot, pose, winches=True, winch_force=winch_force))
        self.data, self.readings = mujoco.MjData(model), Readings(model, robot)
        self.platform, self._written = model.body("platform").id, robot.rest_lengths(pose)
        springs = Law.of(robot.cabling).springs(self._written).stiffness
        square, mass = stiffest(model, robot, springs)
        drag = damping * model.dof_damping[0] / robot.mass  # [1/s]
        model.dof_damping[: len(mass)] = drag * mass.diagonal()
        model.actuator_biasprm[:, 2] = -cable_damping * springs
        damped = drag + cable_damping * square
        self.fastest, self.damping_time = float(np.sqrt(square)), float(1 / damped) if damped else np.inf
        self.reach = winches.reach(robot, self._written)
        self.let_out = self.checked(lengths).rest_lengths
        place(model, self.data, robot, settle(robot, pose, self.let_out).pose)
        self.data.ctrl[:] = self.controls(self.let_out)
        mujoco.mj_forward(model, self.data)

    def checked(self, answer: Command | ArrayLike) -> Command:
        """A controller's return value as a command that the winches can carry out (``winches.checked``)."""
        return winches.checked(self.robot, answer, self.reach)

    def controls(self, rest_lengths: Float[np.ndarray, "*rows cables"]) -> Float[np.ndarray, "*rows cables"]:
        """Controls of the actuators that let out ``rest_lengths`` [m] (``winch_controls``)."""
        extra = Law.of(self.robot.cabling).added
        return winches.controls(self._written + extra, rest_lengths + extra)

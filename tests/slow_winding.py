"""Cables with hysteresis in MuJoCo without being held: winches that turn a little in each time step."""

from __future__ import annotations

import mujoco
import numpy as np
from jaxtyping import Float

import cdpr_sim as cdpr
from cdpr_sim.physics.mjcf import place
from cdpr_sim.physics.simulations import _generated, unit_of

STEP, DAMPING = 0.02, 1.5
"""Time step, in 1/omega of a pendulum as long as the cables, and its damping ratio."""

RESTING = 700
"""Time steps at rest after each step of the path: two oscillations of that pendulum, overdamped."""

LEAST = 1e-14
"""[m] ``springyield`` of an element that holds nothing."""


class Winding:
    """A robot with hysteresis at its first equilibrium on a path, without friction, creep, drive lines and pulleys.

    MuJoCo's springs slide by themselves. From outside come the bound w e of each element, before each time step, and,
    as winches turn, the elements' free lengths: their strain stays.
    """

    def __init__(self, robot: cdpr.Robot, start: cdpr.EquilibriumPath) -> None:
        self.robot, self.model = robot, _generated(robot, True)[0]
        self.data = mujoco.MjData(self.model)
        self.rest = start.rest_lengths[-1].copy()
        place(self.model, self.data, robot, start.poses[-1])
        swing = np.sqrt(9.81 / self.rest.mean())
        self.model.opt.timestep = STEP / swing
        inertia = np.r_[[robot.mass] * 3, np.diag(robot.inertia)]
        self.model.dof_damping[:6] = 2 * DAMPING * swing * inertia / unit_of(robot)
        shape = robot.cables, robot.hysteresis.shape[1]
        self.elements = slice(robot.cables, robot.cables + shape[0] * shape[1])
        self.plastic = self.data.plastic.reshape(*shape, 2)
        self.plastic[:] = (self.rest[:, None] * (1 + start.memory.strains))[..., None]
        self.turn(self.rest)

    def turn(self, rest: Float[np.ndarray, " cables"]) -> None:
        """Winches let out ``rest`` [m]."""
        robot, model = self.robot, self.model
        self.plastic *= (rest / self.rest)[:, None, None]
        self.rest = rest
        self.stiffness = robot.axial_stiffness / rest / unit_of(robot)
        model.tendon_lengthspring[: robot.cables, 1] = rest
        model.tendon_stiffness[: robot.cables] = (1 - robot.hysteresis[..., 0].sum(-1)) * self.stiffness

    def step(self) -> None:
        """One time step, after which springs have slid where their bound is exceeded."""
        robot, model, data = self.robot, self.model, self.data
        mujoco.mj_fwdPosition(model, data)
        stretches = np.maximum(data.ten_length[: robot.cables] - self.rest, 0)[:, None]
        shares, strains, widths = np.moveaxis(robot.hysteresis, -1, 0)
        bounds = np.minimum(strains * self.rest[:, None], widths * stretches)
        model.tendon_springyield[self.elements] = np.maximum(bounds, LEAST).ravel()
        pulling = np.where(stretches > 0, shares * self.stiffness[:, None], 0.0)
        model.tendon_stiffness[self.elements] = pulling.ravel()
        mujoco.mj_step(model, data)

    def wind(self, begin: Float[np.ndarray, "3"], end: Float[np.ndarray, "3"], count: int) -> Float[np.ndarray, "3"]:
        """Wind from pose to pose in ``count`` time steps, and rest: the position then [m]."""
        for rest in cdpr.Problems.of(self.robot, np.linspace(begin, end, count + 1)[1:]).rest_lengths:
            self.turn(rest)
            self.step()
        return self.stay(RESTING)

    def stay(self, count: int) -> Float[np.ndarray, "3"]:
        """Time steps with the winches at rest: the position then [m]."""
        for _ in range(count):
            self.step()
        mujoco.mj_fwdPosition(self.model, self.data)
        return self.data.body("platform").xpos.copy()

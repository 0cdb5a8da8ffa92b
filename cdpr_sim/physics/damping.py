"""What damps the platform of a model, by the argument ``damping`` of ``to_mjcf``.

``"settle"`` damps the platform itself, so that it comes to rest soon: the drag critically damps its slowest
oscillation, that of a pendulum as long as the cables. No real platform has it: one that is cut loose falls slowly.

A *loss factor* damps each cable, which resists stretching by c = eta k/omega [N s/m], with k its stiffness and
omega = sqrt(k/m) the frequency at which the platform's mass m oscillates on this cable alone. There the amplitude
decreases by the factor exp(pi eta) in a period. The damper is viscous: at other frequencies, its loss factor is
proportional to the frequency. ``"none"`` is a loss factor of 0.

MuJoCo's integrator ``discrete`` damps oscillations by itself: by pi omega h in a period with the time step h, which is
ten times a loss factor of 2 % at 16 Hz and 2 ms. So models that do not settle have the integrator ``implicitfast``,
which does not, and a shorter time step.
"""

# pyright: reportAttributeAccessIssue=false
# mujoco ships no type stubs for its compiled modules.
from __future__ import annotations

from typing import Literal, TypeAlias

import mujoco
import numpy as np
from jaxtyping import Float
from scipy.linalg import eigh

from cdpr_sim.core.checks import as_numbers
from cdpr_sim.core.errors import InvalidInput
from cdpr_sim.core.robot import Robot
from cdpr_sim.physics.tendons import Jacobian

Damping: TypeAlias = float | Literal["settle", "none"]
"""What damps the platform: the argument of ``to_mjcf``."""

STEPS = 20
"""Least number of time steps per period of the platform's fastest oscillation where nothing else damps it. The log
decrement of a plumb cable is then the stated one within 2 %."""


def loss_factor(damping: Damping) -> float | None:
    """The loss factor that ``damping`` states; None for ``"settle"``.

    Raises:
        InvalidInput: none of the values.
    """
    if isinstance(damping, str):
        if damping in {"settle", "none"}:
            return None if damping == "settle" else 0.0
    else:
        number = as_numbers("damping", damping, "'settle', 'none' or a loss factor from 0 to 1")
        if number.shape == () and 0 <= number <= 1:
            return float(number)
    raise InvalidInput(f"damping: found {damping!r}, expected 'settle', 'none' or a loss factor from 0 to 1")


def refuse_undamped(robot: Robot, factor: float | None) -> None:
    """Refuse a loss factor above 0 of nonlinear cables: no actuator in MuJoCo is a nonlinear spring with a damper.

    Raises:
        InvalidInput: a nonlinear cable and a loss factor above 0.
    """
    if factor and not robot.cabling.linear:
        cable = int(np.argmax(robot.cabling.nonlinear)) + 1
        raise InvalidInput(
            f"damping: found a loss factor of {factor:g} and cable {cable} with nonlinear elasticity, expected linear "
            "cables, or 'settle' or 'none'"
        )


def relaxation_times(
    robot: Robot, springs: Float[np.ndarray, " cables"], factor: float
) -> Float[np.ndarray, " cables"]:
    """c/k of cables of these stiffnesses [N/m] with this loss factor, (cables,) [s]."""
    return factor * np.sqrt(robot.mass / springs)


def stiffest(
    model: mujoco.MjModel, robot: Robot, springs: Float[np.ndarray, " cables"]
) -> tuple[float, Float[np.ndarray, "free free"]]:
    """Square of the angular frequency of the platform's fastest oscillation [rad²/s²], and its mass matrix [kg, kg m²].

    Where the model is written, with all cables taut, by the tendons' Jacobian and the mass matrix in MuJoCo. Cables
    with mass are as stiff as along their chords.
    """
    data, free = mujoco.MjData(model), np.arange(len(robot.free))
    names = np.where(robot.cabling.with_mass, "chord", "cable")
    cables = np.array([model.tendon(f"{name}_{i + 1}").id for i, name in enumerate(names)])
    mujoco.mj_forward(model, data)
    stretch, mass = Jacobian(model).of(data.ten_J)[cables][:, free].T, np.zeros((len(free), model.nv))
    for coordinate, unit in enumerate(np.eye(len(free), model.nv)):
        mujoco.mj_mulM(model, data, mass[coordinate], unit)
    mass = mass[:, free]
    return float(eigh(stretch * springs @ stretch.T, mass, eigvals_only=True)[-1]), mass


def rounded_down(step: float) -> float:
    """The largest of 1, 2, 5, 10, ... microseconds that is not longer than ``step`` [s]."""
    steps = [digit * 10.0**power for power in range(-6, 0) for digit in (1, 2, 5)]
    return float(f"{max([one for one in steps if one <= step], default=steps[0]):g}")

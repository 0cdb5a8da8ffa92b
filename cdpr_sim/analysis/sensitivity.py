"""Sensitivities: derivatives of an equilibrium by every length, point, stiffness and load on which it depends.

At equilibrium the net wrench F(x, θ) vanishes, so that by the implicit function theorem

    ∂x/∂θ = −(∂F/∂x)⁻¹ ∂F/∂θ,    dtau/dθ = ∂tau/∂θ + ∂tau/∂x ∂x/∂θ,

as long as the same cables without mass stay taut. Derivatives by properties of cables other than points and lengths are
differences of the cables' law, and correct to 1e-10 of the largest; of cables with mass, to 1e-7.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from numpy.typing import ArrayLike

from cdpr_sim.core.cable import PROPERTIES
from cdpr_sim.core.checks import one_of
from cdpr_sim.core.equilibrium import Equilibrium, Stability
from cdpr_sim.core.errors import InvalidInput
from cdpr_sim.core.html_repr import HtmlRepr
from cdpr_sim.core.pose import PoseLike
from cdpr_sim.core.problem import Problem
from cdpr_sim.core.robot import Robot
from cdpr_sim.statics import derivatives, forces, newton


@dataclass(frozen=True)
class Effect:
    """Effect of a small change of one number, in practical units.

    Attributes:
        name: name of the number, such as "exit 3 z".
        parameter: one of ``derivatives.parameters``.
        index: within that parameter, flattened.
        per: the unit of change: "mm", "%", "N" or "N mm".
        position: distance that the platform moves, per unit of change [mm].
        rotation: angle that it turns, per unit of change [°].
        tension: largest change of tension, per unit of change [N].
    """

    name: str
    parameter: str
    index: int
    per: str
    position: float
    rotation: float
    tension: float


@dataclass(frozen=True, eq=False)
class Sensitivity(HtmlRepr):
    """First derivatives of an equilibrium, by the names of its parameters (``derivatives.parameters``).

    Exits and anchors are flattened: x, y, z of cable 1, of cable 2, and so on.

    Attributes:
        equilibrium: the equilibrium.
        pose: derivatives of (translation [m], left-applied rotation vector [rad]), each (6, parameters).
        tensions: derivatives of the tensions [N], each (cables, parameters).
        margin: smallest distance of a cable without mass from its rest length [m]: there it becomes slack or taut, and
            the derivatives jump. Infinite if all cables have mass: their tensions are smooth functions of the pose.
    """

    equilibrium: Equilibrium
    pose: Mapping[str, Float[np.ndarray, "6 parameters"]]
    tensions: Mapping[str, Float[np.ndarray, "cables parameters"]]
    margin: float

    def tilt(self, parameter: str) -> Float[np.ndarray, " parameters"]:
        """Derivative of the tilt [rad] by each number of ``parameter``; at tilt zero, the rate of any tilt.

        Returns:
            (parameters,) [rad] per unit of the parameter, in SI units.
        """
        turning = self.pose[one_of("parameter", parameter, self.pose)][3:]
        axis = self.equilibrium.rotation.as_matrix()[:, 2]
        flat = np.hypot(axis[0], axis[1])
        if flat < 1e-9:
            return np.hypot(turning[0], turning[1])
        # The tilt is the angle of the platform's z axis to the vertical: it increases by rotation about z × axis.
        return (-axis[1] * turning[0] + axis[0] * turning[1]) / flat

    def effects(self) -> list[Effect]:
        """Effects of a millimetre, a percent or a newton of each number, the largest displacement of any anchor first.

        Translations and rotations are compared by the displacement of an anchor at the characteristic length from the
        origin.

        Returns:
            One for each number of each parameter, in millimetres, degrees and newtons.
        """
        robot = self.equilibrium.problem.robot
        found = []
        for parameter in self.pose:
            for index in range(self.pose[parameter].shape[1]):
                per, size = _unit(parameter, index, self.equilibrium)
                step = self.pose[parameter][:, index] * size
                found.append(
                    Effect(
                        name=name_of(parameter, index),
                        parameter=parameter,
                        index=index,
                        per=per,
                        position=1e3 * float(np.linalg.norm(step[:3])),
                        rotation=float(np.degrees(np.linalg.norm(step[3:]))),
                        tension=float(np.abs(self.tensions[parameter][:, index] * size).max()),
                    )
                )
        arm = 1e3 * robot.characteristic_length
        return sorted(found, key=lambda e: -np.hypot(e.position, arm * np.radians(e.rotation)))

    def __repr__(self) -> str:
        numbers = sum(matrix.shape[1] for matrix in self.pose.values())
        name = self.equilibrium.problem.robot.name
        if self.margin == np.inf:
            return f"<Sensitivity of {name!r} to {numbers} numbers>"
        return (
            f"<Sensitivity of {name!r} to {numbers} numbers; "
            f"a cable goes slack or taut within {1e3 * self.margin:.3g} mm of its length>"
        )


def sensitivity(
    equilibrium: Equilibrium | Problem | Robot,
    pose: PoseLike | None = None,
    rest_lengths: ArrayLike | None = None,
    *,
    external_wrench: ArrayLike | None = None,
) -> Sensitivity:
    """The derivatives of an equilibrium by all its parameters.

    Args:
        equilibrium: an equilibrium by either method, without other arguments; or a problem, or a robot with the
            arguments of ``solve``.
        pose: the commanded pose.
        rest_lengths: (cables,) [m]; default: the rigid lengths at ``pose``.
        external_wrench: (6,) [N, N m].

    Returns:
        Derivatives of pose and tensions, by the names of the parameters.

    Raises:
        InvalidInput: some direction is unconstrained, so that the derivatives are infinite; or ropes have a memory.
        NotConverged: there is no equilibrium.
    """
    if isinstance(equilibrium, Robot | Problem):  # before it is solved
        (equilibrium if isinstance(equilibrium, Robot) else equilibrium.robot).cabling.refuse_memory()
    equilibrium = newton.equilibrium_of(equilibrium, pose, rest_lengths, external_wrench)
    problem = equilibrium.problem
    if equilibrium.stability is Stability.NEUTRAL:
        raise InvalidInput(
            f"equilibrium: found a neutral equilibrium of {problem.robot.name!r}, expected a stable one: "
            "the slightest change moves the platform without limit"
        )
    state = forces.at(problem, equilibrium.position, equilibrium.rotation.as_matrix())
    names = derivatives.parameters(problem.robot)
    found = derivatives.by_parameter(state, names)
    by = [found[name] for name in names]
    ends = np.cumsum([wrench.shape[1] for wrench, _ in by])[:-1]
    found = derivatives.of_equilibria(state, *(np.hstack(each) for each in zip(*by, strict=True)))
    poses, tensions = (dict(zip(names, np.split(each, ends, axis=1), strict=True)) for each in found)
    gaps = np.abs(equilibrium.lengths - equilibrium.rest_lengths)
    margin = float(gaps.min(where=problem.cable_weights == 0, initial=np.inf))
    return Sensitivity(equilibrium, poses, tensions, margin)


def _unit(parameter: str, index: int, equilibrium: Equilibrium) -> tuple[str, float]:
    """The unit of change, and its size in SI units."""
    if parameter == "external_wrench":
        return ("N", 1.0) if index < 3 else ("N mm", 1e-3)
    if unit_of(parameter) == "m":
        return "mm", 1e-3
    value = np.ravel(getattr(equilibrium.problem.robot, parameter))[index]
    return "%", 0.01 * abs(float(value))


def unit_of(parameter: str) -> str:
    """The unit in SI of a parameter of equilibria other than a wrench."""
    return PROPERTIES[parameter].unit if parameter in PROPERTIES else {"mass": "kg"}.get(parameter, "m")


def name_of(parameter: str, index: int) -> str:
    """The name of a number, such as "exit 3 z"."""
    if parameter in PROPERTIES:
        return PROPERTIES[parameter].number(index)
    axis = "xyz"[index % 3]
    others = {"rest_lengths": f"rest length {index + 1}", "mass": "mass", "center_of_mass": f"centre of mass {axis}"}
    return others.get(parameter, f"{'force' if index < 3 else 'torque'} {axis}")

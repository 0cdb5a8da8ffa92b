"""``ModelEquilibrium``: static equilibrium of a MuJoCo model, with the evidence that certifies it."""

from __future__ import annotations

import enum
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float

from cdpr_sim.core.checks import Frozen
from cdpr_sim.core.equilibrium import Stability


class NoRest(enum.Enum):
    """Why a model does not come to rest."""

    FALLS = "falls for ever"
    MECHANISM = "a mechanism: nothing resists the force along a direction"
    TURNS = "turns for ever"
    DRIVEN = "an actuator's state grows for ever"
    BELT = "driven for ever by a surface that moves"
    LIMIT_CYCLE = "oscillates for ever about its equilibrium"
    JUMPS = "moves for ever, because its force jumps"
    SLIDES = "slides: friction at its limit does not hold it"
    DIVERGES = "the simulation diverges at every time step"
    NOT_CONVERGED = "no equilibrium was found within the allowed work"


@dataclass(frozen=True, eq=False)
class ContactForce(Frozen):
    """Force of one contact at rest.

    Attributes:
        bodies: names of the two bodies.
        position: [m].
        normal: force along the contact's normal [N], positive pushes the bodies apart.
        friction: force tangential to it that holds the load [N].
        share: friction in use, as a fraction of its limit.
    """

    bodies: tuple[str, str]
    position: Float[np.ndarray, "3"]
    normal: float
    friction: float
    share: float


@dataclass(frozen=True)
class ModelAgreement:
    """Comparison of the two ways to the equilibrium: time steps with kinetic damping, and Newton's method.

    Attributes:
        agrees: whether both found this equilibrium, within the tolerances of ``compare``.
        newton_from: "start" if each way began at the start; "motion" if Newton's method began at the end of the time
            steps; "beside" if time steps began again a micrometre beside the result. The last shows that the model
            stays there, not that two ways lead to it: with loaded friction, equilibria lie side by side.
        position_error: largest distance between a body's two positions [m]; bodies that move in neutral directions too.
        rotation_error: largest angle between a body's two orientations [rad].
        tension_error: largest difference of a tendon's tension [N].
        reasons: why they do not agree, a sentence each.
    """

    agrees: bool
    newton_from: str
    position_error: float
    rotation_error: float
    tension_error: float
    reasons: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class ModelEquilibrium(Frozen):
    """A pose of a model in which all forces balance, the forces there, and the evidence.

    Attributes:
        qpos: the pose, (nq,).
        act: activations of the actuators, (na,).
        ctrl: controls, (nu,).
        tendon_tensions: of each tendon its tension and the parts of it, as ``tendon_tensions`` gives them.
        contact_forces: of the contacts that carry a force.
        residual: largest unbalanced force over the largest part of the forces. Forces [N] and torques [N m] are
            compared after division by the root of the mass of their coordinate (``dof_M0``).
        unbalanced: generalised force that remains, (nv,) [N, N m].
        friction: generalised force of the friction that holds, (nv,) [N, N m]; MuJoCo's friction gives none at rest.
        friction_share: largest friction in use, as a fraction of its limit; 0 without.
        creep: largest speed of a coordinate after 0.5 s of ``mj_step`` from here [m/s, rad/s].
        stiffness_eigenvalues: of the symmetric part of the stiffness on the directions that friction does not hold, in
            the metric of the masses, ascending [1/s²]: squares of angular frequencies.
        growth: largest real part of the eigenvalues of the linearised motion [1/s]; positive grows.
        neutral: joints that can move without a force that resists.
        iterations: time steps and Newton iterations, by name.
        way: "start" (it was at rest), "motion" (time steps, finished by Newton's method), or "newton".
        agreement: of the two ways; None if the start was at rest.
        notes: what a user should know, a sentence each.
    """

    qpos: Float[np.ndarray, " nq"]
    act: Float[np.ndarray, " na"]
    ctrl: Float[np.ndarray, " nu"]
    tendon_tensions: Any
    contact_forces: tuple[ContactForce, ...]
    residual: float
    unbalanced: Float[np.ndarray, " nv"]
    friction: Float[np.ndarray, " nv"]
    friction_share: float
    creep: float
    stiffness_eigenvalues: Float[np.ndarray, " free"]
    growth: float
    stability: Stability
    neutral: tuple[str, ...]
    iterations: dict[str, int]
    way: str
    agreement: ModelAgreement | None
    notes: tuple[str, ...]

    @property
    def stable(self) -> bool:
        """Whether the model returns after any small displacement: no direction is unstable or neutral."""
        return self.stability is Stability.STABLE

    def write(self, data: Any) -> None:
        """Write pose, activations and controls to an ``MjData`` of the model, at zero velocity."""
        data.qpos[:], data.qvel[:], data.ctrl[:] = self.qpos, 0, self.ctrl
        data.act[:] = self.act

    def __repr__(self) -> str:
        agrees = "" if self.agreement is None else f", ways {'agree' if self.agreement.agrees else 'do not agree'}"
        return (
            f"<ModelEquilibrium by {self.way}: residual {self.residual:.1e}, {self.stability.name.lower()}, "
            f"{len(self.contact_forces)} contacts{agrees}>"
        )

"""``Equilibrium``: a static equilibrium of the platform by either method, with the evidence that certifies it."""

from __future__ import annotations

import enum
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Bool, Float
from scipy.spatial.transform import Rotation

from cdpr_sim.core import cable_law, cable_path
from cdpr_sim.core import pose as _pose
from cdpr_sim.core.checks import frozen
from cdpr_sim.core.errors import CdprError
from cdpr_sim.core.html_repr import HtmlRepr
from cdpr_sim.core.pose import Posed, PoseField
from cdpr_sim.core.problem import Problem
from cdpr_sim.core.slack import slack_cables
from cdpr_sim.core.status import NEUTRAL, Status


class Stability(enum.Enum):
    """Behaviour of the platform after a small displacement."""

    STABLE = "it returns"
    NEUTRAL = "it stays displaced: some direction is unconstrained"
    UNSTABLE = "it moves away: the point is a saddle or a maximum of the energy"


class EigenvaluesField:
    """Field of a frozen dataclass that takes an array, or a function that computes it at its first use."""

    def __set_name__(self, owner: type, name: str) -> None:
        self.name = name

    def __set__(self, instance: object, value: np.ndarray | Callable[[], np.ndarray]) -> None:
        vars(instance)[self.name] = value

    def __get__(self, instance: object | None, owner: type) -> np.ndarray:
        if instance is None:
            raise AttributeError(self.name)  # where dataclasses look for a default
        value = vars(instance)[self.name]
        if not isinstance(value, np.ndarray):
            value = vars(instance)[self.name] = frozen(value())
        return value


class _Held:
    """Base with the field ``eigenvalues``."""

    eigenvalues = EigenvaluesField()


@dataclass(frozen=True, eq=False)
class Equilibrium(_Held, Posed, HtmlRepr):
    """A pose, the cables' state there, and the evidence that it is (or is not) a static equilibrium.

    Data only: each method computes its own residual and eigenvalues, by its own means.

    Attributes:
        problem: the problem.
        pose: the platform's pose, a ``RigidTransform``; ``position`` and ``rotation_matrix`` are its plain arrays.
        tensions: tensions of the ropes at their anchors, (cables,) [N]; ``pulls`` are the forces on the platform.
        lengths: (cables,) [m].
        residual: largest unbalanced force [N] over the free directions, torques divided by the robot's
            characteristic length; 0 at equilibrium.
        eigenvalues: eigenvalues of the stiffness matrix on the free directions, ascending [N/m], rotations scaled by
            the characteristic length.
        iterations: Newton iterations, function evaluations (SEECR) or steps (MuJoCo).
        source: "newton", "seecr/fsolve", "seecr/least_squares", "mujoco".
    """

    problem: Problem
    pose: PoseField
    tensions: Float[np.ndarray, " cables"]
    lengths: Float[np.ndarray, " cables"]
    residual: float
    eigenvalues: EigenvaluesField
    iterations: int
    source: str

    @property
    def rotation(self) -> Rotation:
        """Rotation from the platform frame to the base frame."""
        return self.pose.rotation

    @property
    def euler(self) -> Float[np.ndarray, "3"]:
        """(alpha, beta, gamma) [rad] with R = Rz(gamma) Ry(beta) Rx(alpha), the paper's convention."""
        return _pose.euler(self.rotation)

    @property
    def tilt(self) -> float:
        """The angle [rad] between the platform's z axis and the vertical."""
        return float(_pose.tilt_of_matrices(self.rotation_matrix))

    @property
    def deviation(self) -> Float[np.ndarray, "3"]:
        """Position minus commanded position [m]."""
        return self.position - self.problem.position

    @property
    def rest_lengths(self) -> Float[np.ndarray, " cables"]:
        """Unstretched cable lengths l0, (cables,) [m]."""
        return self.problem.rest_lengths

    @property
    def slack(self) -> Bool[np.ndarray, " cables"]:
        """Which cables are slack, (cables,): not stretched, and pulling by at most their own weight.

        Or by at most 1 % of the platform's weight, where that is more; a slack cable without mass has no tension
        (``core.slack``).
        """
        return slack_cables(self.problem, self.lengths, self.tensions)

    @property
    def pulls(self) -> Float[np.ndarray, " cables"]:
        """Forces with which the cables pull on the platform, (cables,) [N]: tensions times parts of line."""
        return self.problem.robot.cabling.pulls(self.tensions)

    @property
    def overloaded(self) -> Bool[np.ndarray, " cables"]:
        """Which cables have a tension above their breaking load, (cables,); none where it is unknown."""
        return self.tensions > self.problem.robot.breaking_load

    @property
    def stability(self) -> Stability:
        """Stable, neutral or unstable, by the smallest eigenvalue of the stiffness matrix."""
        return stability_of(self.eigenvalues)

    @property
    def stable(self) -> bool:
        """Whether the stiffness matrix is positive definite on the free directions."""
        return self.stability is Stability.STABLE

    def __repr__(self) -> str:
        x, y, z = self.position
        return (
            f"<Equilibrium by {self.source}: ({x:.6f}, {y:.6f}, {z:.6f}) m, tilt {np.degrees(self.tilt):.3f}°, "
            f"{int(self.slack.sum())} of {len(self.tensions)} cables slack, residual {self.residual:.1e} N, "
            f"{self.stability.name.lower()}>"
        )


def stability_of(eigenvalues: Float[np.ndarray, " free"]) -> Stability:
    """Stability by the ascending eigenvalues of a stiffness matrix."""
    smallest, scale = eigenvalues[0], np.abs(eigenvalues).max()
    if not smallest >= -NEUTRAL * scale:  # also where it is nan
        return Stability.UNSTABLE
    return Stability.STABLE if smallest > NEUTRAL * scale else Stability.NEUTRAL


class _NoEquilibrium(CdprError):
    """A method did not reach static equilibrium; carries the best point found.

    Attributes:
        reason: the reason as text.
        equilibrium: the best point, its residual included; it is *not* an equilibrium.
    """

    def __init__(self, reason: str, equilibrium: Equilibrium | None = None) -> None:
        super().__init__(reason)
        self.reason = reason
        self.equilibrium = equilibrium

    @classmethod
    def because(cls, status: Status, point: Equilibrium) -> _NoEquilibrium:
        """Exception for a status, with its sentence and the residual of the point."""
        counted = "steps" if point.source == "mujoco" else "iterations"
        robot, where = point.problem.robot, ""
        evidence = f"{point.iterations} {counted}"
        if np.isfinite(point.residual):
            evidence += f", {point.residual:.1e} N still unbalanced"
        if status is Status.OFF_WHEEL:
            at = point if np.isfinite(point.position).all() else point.problem
            found = cable_path.off_wheel(robot.cabling, at.position, at.rotation_matrix)
            where = f": found {found}" if found else ""
        elif status is Status.OVERSTRAINED:
            beyond = robot.cabling.beyond_law(point.lengths, point.rest_lengths)
            beyond |= point.tensions > cable_law.largest_tension(robot.cabling.law_of(robot.axial_stiffness))
            cables = [str(cable + 1) for cable in np.flatnonzero(beyond)]
            evidence = f"cable{'s' if len(cables) > 1 else ''} {', '.join(cables)}"
        reason = f"{robot.name}: {point.source}: {status.sentence}{where} ({evidence})"
        if point.problem.external_wrench[3:].any():
            reason += "; under a torque with a constant direction in space there may be no equilibrium"
        return cls(reason, point)


class NotConverged(_NoEquilibrium):
    """A static solver stopped without reaching equilibrium."""


class NotSettled(_NoEquilibrium):
    """A platform or a model did not come to rest in MuJoCo.

    Attributes:
        case: of ``settle_model``, the ``NoRest`` that says why; None of a robot.
        joints: of ``settle_model``, the names of the joints that do not come to rest.
    """

    def __init__(
        self, reason: str, equilibrium: Any = None, case: enum.Enum | None = None, joints: tuple[str, ...] = ()
    ) -> None:
        super().__init__(reason, equilibrium)
        self.case, self.joints = case, joints

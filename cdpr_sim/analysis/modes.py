"""Natural frequencies and mode shapes of a platform about its equilibrium.

For small motions about a stable equilibrium, M q̈ + K q = 0 with the stiffness matrix K and the mass matrix M of
(translation of the origin, rotation vector), so that the modes solve K q = ω² M q.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from numpy.typing import ArrayLike
from scipy.linalg import eigh, qr

from cdpr_sim.core.checks import refuse_unless
from cdpr_sim.core.equilibrium import Equilibrium, Stability
from cdpr_sim.core.errors import InvalidInput
from cdpr_sim.core.html_repr import HtmlRepr
from cdpr_sim.core.pose import PoseLike
from cdpr_sim.core.problem import Problem
from cdpr_sim.core.robot import Robot
from cdpr_sim.core.status import NEUTRAL
from cdpr_sim.statics import forces, newton

ROUNDING = 1e-6
"""Least component of a unit motion along an axis; smaller ones count as zero."""


@dataclass(frozen=True, eq=False)
class Modes(HtmlRepr):
    """Natural frequencies and mode shapes, slowest first.

    Attributes:
        equilibrium: equilibrium about which the platform oscillates.
        frequencies: (free,) [Hz]; 0 for an unconstrained direction.
        shapes: (free, 6), each a (translation [m], left-applied rotation vector [rad]) of unit kinetic energy at 1/s.
    """

    equilibrium: Equilibrium
    frequencies: Float[np.ndarray, " free"]
    shapes: Float[np.ndarray, "free 6"]

    def __repr__(self) -> str:
        frequencies = ", ".join(f"{one:.3g}" for one in self.frequencies)
        return f"<Modes of {self.equilibrium.problem.robot.name!r}: {frequencies} Hz>"


def natural_modes(
    equilibrium: Equilibrium | Problem | Robot,
    pose: PoseLike | None = None,
    rest_lengths: ArrayLike | None = None,
    *,
    external_wrench: ArrayLike | None = None,
) -> Modes:
    """Natural frequencies and mode shapes about an equilibrium.

    Cables count as springs: their own inertia and oscillation are neglected, also where their mass makes them sag. A
    mode near a cable's own lowest frequency, sqrt(tension/density)/(2 length), couples with it.

    Args:
        equilibrium: an equilibrium by either method, without other arguments; or a problem, or a robot with the
            arguments of ``solve``.
        pose: the commanded pose.
        rest_lengths: (cables,) [m]; default: the rigid lengths at ``pose``.
        external_wrench: (6,) [N, N m].

    Returns:
        (free,) frequencies [Hz], slowest first, and the shape of each.

    Raises:
        InvalidInput: the equilibrium is unstable, or depends on a torque with a constant direction in space.
        NotConverged: there is none.
    """
    equilibrium = newton.equilibrium_of(equilibrium, pose, rest_lengths, external_wrench)
    problem = equilibrium.problem
    if equilibrium.stability is Stability.UNSTABLE:
        raise InvalidInput(
            f"equilibrium: found an unstable equilibrium of {problem.robot.name!r}, expected a stable one"
        )
    if problem.external_wrench[3:].any():
        raise InvalidInput(
            "equilibrium: found one under an external torque, expected none: such a torque is not conservative, and "
            "the platform need not oscillate about the equilibrium"
        )
    frequencies, shapes = modes_of(forces.at(problem, equilibrium.position, equilibrium.rotation.as_matrix()))
    return Modes(equilibrium, frequencies, shapes)


def modes_of(state: forces.State) -> tuple[Float[np.ndarray, " free"], Float[np.ndarray, "free 6"]]:
    """Frequencies [Hz], 0 of directions that are neutral or unstable, and shapes at a state of a single problem."""
    free = state.problem.robot.free
    mass = forces.mass_matrix(state.problem, state.rotation)
    squares, vectors = eigh(state.stiffness_matrix[np.ix_(free, free)], mass[np.ix_(free, free)])
    shapes = np.zeros((len(free), 6))
    shapes[:, free] = np.sqrt(2) * vectors.T
    return np.sqrt(np.maximum(squares, 0.0)) / (2 * np.pi), shapes


def neutral_directions(equilibrium: Equilibrium) -> Float[np.ndarray, "neutral 6"]:
    """The unconstrained directions of an equilibrium of either method, by statics; none where it is stable.

    Without gravity and pretension that is every direction; for a mass whose cables meet in one point, its rotations.

    Args:
        equilibrium: by either method.

    Returns:
        As many (translation of the origin [m], left-applied rotation vector [rad]) as there are neutral directions,
        along single axes where possible; ``core.describe.describe_twist`` describes them.

    Raises:
        InvalidInput: not an equilibrium.
    """
    refuse_unless(Equilibrium, equilibrium=equilibrium)
    problem, free, units = equilibrium.problem, equilibrium.problem.robot.free, equilibrium.problem.robot.units
    state = forces.at(problem, equilibrium.position, equilibrium.rotation.as_matrix())
    values, vectors = np.linalg.eigh((state.stiffness_matrix / np.outer(units, units))[np.ix_(free, free)])
    spanned = vectors[:, np.abs(values) <= NEUTRAL * np.abs(values).max()].T
    twists = np.zeros((len(spanned), 6))
    if len(spanned):  # as single axes: the reduced echelon form of the same space
        _, _, order = qr(spanned, pivoting=True)  # pyright: ignore[reportAssignmentType]
        pivots = np.asarray(order)[: len(spanned)]
        twists[:, free] = (np.linalg.inv(spanned[:, pivots]) @ spanned)[np.argsort(pivots)]
    return np.where(np.abs(twists) > ROUNDING, twists, 0.0) / units

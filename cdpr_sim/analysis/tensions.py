"""Tension distribution: tensions within limits that carry a load at a given pose, and the choice among them.

Tensions tau must balance the load, W tau + w = 0, and lie within limits. Those that do form a polytope (Bouchard et al.
2010, doi:10.1115/1.3211025). Out of it are chosen

- the *smallest*, by Euclidean norm: a least-distance problem, solved exactly by non-negative least squares
  (Lawson and Hanson 1974, ch. 23);
- the *stiffest*: at a fixed pose the stiffness matrix is affine in the tensions when rest lengths follow them, so that
  its smallest eigenvalue is concave in them and cutting planes (Kelley 1960, doi:10.1137/0108053) find its maximum
  between an upper and a lower bound.

Both can keep the smallest eigenvalue above a floor: an equilibrium with balancing tensions need not be stable.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float
from scipy.linalg import null_space
from scipy.optimize import linprog, lsq_linear, nnls

from cdpr_sim.analysis.workspace.feasibility import BALANCED
from cdpr_sim.core.errors import InvalidInput
from cdpr_sim.core.status import NEUTRAL

Array = np.ndarray

CUTS = 200
"""Largest number of cutting planes. DemoBot's eight cables need 1 to 4 (``scripts/dev/measure_constants.py``)."""

GAP = 1e-6
"""Tolerance between the stiffest tensions' stiffness and its upper bound, as a fraction."""


@dataclass(frozen=True, eq=False)
class Demand:
    """Requirements on tensions at one pose: balance a load within limits; and the stiffness that they give.

    Attributes:
        wrench_matrix: W on the free directions, torques per characteristic length, (free, cables).
        load: w on the free directions, in the same units, (free,) [N].
        lower: smallest tension of each cable, (cables,) [N].
        upper: largest tension of each cable, (cables,) [N]; may be infinite.
        stiffness: the stiffness matrix at zero tension with all cables taut, (free, free) [N/m].
        stiffness_by_tension: change of that matrix by a newton of tension in each cable, (cables, free, free) [1/m].
    """

    wrench_matrix: Float[Array, "free cables"]
    load: Float[Array, " free"]
    lower: Float[Array, " cables"]
    upper: Float[Array, " cables"]
    stiffness: Float[Array, "free free"]
    stiffness_by_tension: Float[Array, "cables free free"]

    @cached_property
    def held(self) -> Float[Array, "free held"]:
        """Orthonormal directions in which the load or some cable has an effect; not all if all cables meet in a point.

        A platform whose anchors all lie in one point rotates about it, and its cables have no effect on that.
        """
        parts = (self.wrench_matrix, self.stiffness, *self.stiffness_by_tension)
        sizes = [np.linalg.norm(part) or 1.0 for part in parts]
        vectors, values, _ = np.linalg.svd(np.hstack([part / size for part, size in zip(parts, sizes, strict=True)]))
        return vectors[:, values > NEUTRAL * values[0]]

    @property
    def scale(self) -> float:
        """The size of the load [N]; of the lower limits if there is none."""
        return float(np.linalg.norm(self.load)) or float(np.linalg.norm(self.lower)) or 1.0

    def softest(self, tensions: Float[Array, " cables"]) -> tuple[float, Float[Array, " free"]]:
        """The smallest eigenvalue [N/m] of the stiffness matrix with all cables taut, and its direction.

        Only within the directions of ``held``.
        """
        matrix = self.stiffness + np.einsum("c,cij->ij", tensions, self.stiffness_by_tension)
        values, vectors = np.linalg.eigh(self.held.T @ matrix @ self.held)
        return float(values[0]), self.held @ vectors[:, 0]

    def cut(self, direction: Float[Array, " free"]) -> tuple[Float[Array, " cables"], float]:
        """(g, s) such that the stiffness along ``direction`` is s + g·tau: no smallest eigenvalue is above it."""
        gain = np.einsum("i,cij,j->c", direction, self.stiffness_by_tension, direction)
        return gain, float(direction @ self.stiffness @ direction)


def smallest(demand: Demand, floor: float = -np.inf) -> Float[Array, " cables"] | None:
    """The tensions of least norm that balance the load within limits, with no eigenvalue below ``floor`` [N/m].

    None where there are none.
    """
    gains, least = [], []
    for _ in range(CUTS):
        tensions = _least_norm(demand, gains, least)
        if tensions is None:
            return None
        if not np.isfinite(floor):
            return tensions
        value, direction = demand.softest(tensions)
        if value >= floor - GAP * abs(floor):
            return tensions
        gain, constant = demand.cut(direction)
        gains.append(gain)
        least.append(floor - constant)
    return None


def stiffest(demand: Demand, floor: float = -np.inf) -> Float[Array, " cables"] | None:
    """The tensions that balance the load within limits and maximise the platform's smallest stiffness.

    None where there are none, or where none keep the smallest eigenvalue above ``floor`` [N/m].

    Raises:
        InvalidInput: the stiffness grows without bound with the tensions, and no limit was given.
    """
    start = _least_norm(demand, [], [])
    if start is None:
        return None
    best, best_value = start, demand.softest(start)[0]
    rows, constants = [], []
    tensions = start
    cables = len(demand.lower)
    equality = np.hstack([demand.wrench_matrix, np.zeros((len(demand.load), 1))])
    bounds = [(low, high if np.isfinite(high) else None) for low, high in zip(demand.lower, demand.upper, strict=True)]
    for _ in range(CUTS):
        gain, constant = demand.cut(demand.softest(tensions)[1])
        rows.append(np.append(-gain, 1.0))
        constants.append(constant)
        program = linprog(
            np.append(np.zeros(cables), -1.0),
            A_ub=np.array(rows),
            b_ub=np.array(constants),
            A_eq=equality,
            b_eq=-demand.load,
            bounds=[*bounds, (None, None)],
            method="highs",
        )
        if program.status == 3:
            raise InvalidInput(
                "tension_limits: found no upper limit, expected one: this platform's cables pull against one another, "
                "and its stiffness grows without limit with the tensions"
            )
        if not program.success:
            break
        tensions, bound = program.x[:cables], program.x[-1]
        value = demand.softest(tensions)[0]
        if value > best_value:
            best, best_value = tensions, value
        if bound - best_value <= GAP * max(abs(bound), abs(best_value)):
            break
    return on_the_balance(demand, best) if best_value >= floor - GAP * abs(floor) else None


def nearest(demand: Demand) -> Float[Array, " cables"]:
    """The tensions within limits that leave the smallest residual of the load, (cables,) [N]."""
    scale = demand.scale
    found = lsq_linear(
        demand.wrench_matrix, -demand.load / scale, (demand.lower / scale, demand.upper / scale), method="bvls"
    )
    return found.x * scale


def leftover(demand: Demand) -> Float[Array, " free"]:
    """The smallest residual wrench of tensions within limits, (free,) [N]; zero where they balance the load.

    Where it is not zero it is also a proof (Farkas): along it the load does positive work, while no cable that could
    pull harder gets longer, nor any shorter that could pull less.
    """
    return demand.wrench_matrix @ nearest(demand) + demand.load


def balances(demand: Demand) -> bool:
    """Whether some tensions within limits balance the load."""
    return bool(np.abs(leftover(demand)).max() <= BALANCED * demand.scale)


def _least_norm(demand: Demand, gains: list[Array], least: list[float]) -> Float[Array, " cables"] | None:
    """Least norm under W tau = −w, the limits and gains·tau ≥ least; None where there are none.

    With tau = tau0 + N y, where tau0 is the least-norm solution without limits and N spans the null space of W, the
    norm of tau is least where that of y is: least distance to a polytope.
    """
    W, scale = demand.wrench_matrix, demand.scale
    start = -(np.linalg.pinv(W) @ demand.load)
    if np.abs(W @ start + demand.load).max() > BALANCED * scale:
        return None
    finite = np.isfinite(demand.upper)
    G = np.vstack([np.eye(len(start)), -np.eye(len(start))[finite], *gains])
    h = np.concatenate([demand.lower, -demand.upper[finite], least])
    sizes = np.linalg.norm(G, axis=1)
    G, h = G / sizes[:, None], h / sizes
    violations = (h - G @ start) / scale
    if (violations <= BALANCED).all():
        return np.clip(start, demand.lower, demand.upper)
    N = null_space(W)
    if not N.size:
        return None
    program = np.vstack([(G @ N).T, violations])
    target = np.append(np.zeros(N.shape[1]), 1.0)
    multipliers, distance = nnls(program, target)  # pyright: ignore[reportAssignmentType]
    rest = np.asarray(program @ multipliers) - target
    if distance**2 <= BALANCED:
        return None
    tensions = start - N @ (rest[:-1] / rest[-1]) * scale
    if (h - G @ tensions > 1e3 * BALANCED * scale).any():
        return None
    return np.clip(tensions, demand.lower, demand.upper)


def on_the_balance(demand: Demand, tensions: Float[Array, " cables"]) -> Float[Array, " cables"]:
    """Correct tensions that nearly balance the load by the smallest change that balances it, within their limits."""
    correction = np.linalg.pinv(demand.wrench_matrix) @ (demand.wrench_matrix @ tensions + demand.load)
    return np.clip(tensions - correction, demand.lower, demand.upper)

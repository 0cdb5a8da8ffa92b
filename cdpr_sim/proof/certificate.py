"""Proof that an equilibrium exists and is unique in a box, which cables are slack there, and that it is stable.

Krawczyk's test: with the balance of forces F, its derivatives F', a box X about the point x₀, and any matrix C,

    K(X) = x₀ − C F(x₀) + (1 − C F'(X)) (X − x₀);   K(X) inside X  ⇒  exactly one zero of F in X, and it lies in K(X)

(Krawczyk 1969; Neumaier, Interval Methods for Systems of Equations, 1990, theorem 5.1.8), all in balls. It holds for
F that is piecewise smooth, with an enclosure of F's generalised derivative: a cable that may be stretched or not
contributes all slopes between the two.

At a kink that is too stiff for that, by convexity: if F is strongly monotone with the constant mu on a sphere of radius
r, and |F(x₀)| < mu r, F has exactly one zero in it, which is stable. F' − mu is positive definite if it is for every
choice of stretched or not of the cables that may be either.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float

from cdpr_sim.core.cable import MOST_STRAIN
from cdpr_sim.core.equilibrium import Equilibrium
from cdpr_sim.core.errors import InvalidInput
from cdpr_sim.core.html_repr import HtmlRepr
from cdpr_sim.core.pose import Pose
from cdpr_sim.proof.balance import At, Balance
from cdpr_sim.proof.balls import (
    BITS,
    Ball,
    Balls,
    arithmetic,
    bounds,
    centres,
    exact,
    middle,
    middles,
    norm,
    product,
    solution,
    upper,
    within,
)

NEAR = 1e-7
"""[m] Largest distance of a proved position from the proved equilibrium: a hundred times the error of DemoBot's
settled poses; cables that are 1 % stiffer move DemoBot by 6e-7 m. Beyond 100 m, see ``NEAR_OF_SIZE``."""

NEAR_OF_SIZE = 1e-9
"""The same as a fraction of the largest coordinate, since the rounding of lengths is proportional to it."""

NEAR_TURN = 1e-5
"""[rad] The same for a rotation."""

NEAR_TENSION = 1e-3
"""The same for tensions, as a fraction of the largest of the load and the tensions."""

LARGEST_BOX, SMALLEST_BOX, SHRINK = 1e-7, 1e-25, 1e-2
"""Box sizes in characteristic lengths: the first, the last, and the factor from one to the next. The first
succeeds at 109 of 120 random poses of ``cogiro`` and ``parallel`` with EA from 1e2 to 1e6 N, the third at 119."""

GAP_SHARE = 0.2
"""Fraction of the least distance of a cable from its rest length: a box of this size does not reach the kink."""

POLISH = 12
"""Newton steps in balls to the centre of the box. A good start needs two."""

MOST_KINKS = 6
"""Largest number of cables at their rest length for which both choices, stretched and not, are tried."""

DIGITS = 30
"""Decimal digits of ``Certificate.decimals``, as far as they are proved: balls have 32."""


@dataclass(frozen=True, eq=False)
class Certificate(HtmlRepr):
    """Result of a proof of an equilibrium. Enclosures are (lower, upper), rounded outwards to doubles.

    Attributes:
        equilibrium: the given equilibrium, found by any method.
        exists: whether a box around it is proved to hold exactly one equilibrium; if not, all fields below are unknown
            (nan, inf or None). Beyond a strain of 20 % a nonlinear cable has no law, and there is no equilibrium.
        index: the number of unstable directions, proved; None if not proved.
        slack: for each cable True (proved slack), False (proved taut) or None (neither).
        position: position of the one equilibrium in the box, (2, 3) [m].
        rotation: its rotation matrix, (2, 3, 3).
        tensions: (2, cables) [N].
        digits: proved decimal digits of the position, relative to the robot's largest coordinate.
        decimals: "position" [m], "rotation" (row by row) and "tensions" [N] in decimals, with all proved digits.
        radius: [m] no other equilibrium lies within this distance of the one, rotations times the characteristic
            length.
        position_error: distance of the given equilibrium from the proved one, an upper bound [m].
        rotation_error: the angle between the two, an upper bound [rad].
        tension_error: the largest difference in a cable, an upper bound [N].
        midpoint: midpoint of the enclosures, as an equilibrium whose source is "proof"; None if nothing is proved.
        reasons: what could not be proved and why, a sentence each; empty if everything is proved.
    """

    equilibrium: Equilibrium
    exists: bool
    index: int | None
    slack: tuple[bool | None, ...]
    position: Float[np.ndarray, "2 3"]
    rotation: Float[np.ndarray, "2 3 3"]
    tensions: Float[np.ndarray, "2 cables"]
    digits: float = 0.0
    decimals: dict[str, tuple[str, ...]] = field(default_factory=dict)
    radius: float = math.nan
    position_error: float = math.inf
    rotation_error: float = math.inf
    tension_error: float = math.inf
    midpoint: Equilibrium | None = None
    reasons: tuple[str, ...] = ()

    @property
    def proved(self) -> bool:
        """Whether the given equilibrium is proved: it exists, is near the proved one, and is the only one in its box.

        Each cable is proved taut or slack, in agreement with the equilibrium, and so is its stability.
        """
        return self.exists and not self.reasons

    @property
    def stable(self) -> bool:
        """Whether it is proved stable: the symmetric part of the stiffness is positive definite there."""
        return self.index == 0

    def __repr__(self) -> str:
        if not self.proved:
            return f"<Certificate of {self.equilibrium.problem.robot.name!r}: not proved: {'; '.join(self.reasons)}>"
        words = "stable" if self.stable else f"{self.index} unstable directions"
        return (
            f"<Certificate of {self.equilibrium.problem.robot.name!r}: proved, {words}, {self.digits:.0f} digits, "
            f"{self.equilibrium.source} off by at most {self.position_error:.1e} m>"
        )


@dataclass(frozen=True)
class Enclosure:
    """A box with exactly one equilibrium.

    Attributes:
        box: the coordinates of the box, in the order of ``Balance``.
        image: a smaller box in which the equilibrium lies.
        state: the balance over the image.
        radius: radius of the box [m].
        monotone: whether it was proved by convexity, which proves stability too.
    """

    box: Balls
    image: Balls
    state: At
    radius: float
    monotone: bool = False


def certify(equilibrium: Equilibrium) -> Certificate:
    """Prove an equilibrium of any method. The boxes are chosen automatically.

    The robot's numbers are exact doubles; a pulley's axis is normalised exactly.

    Args:
        equilibrium: from ``solve``, ``settle`` or anywhere else.

    Returns:
        What is proved, and reasons for what is not. A pose that is no equilibrium raises no error.

    Raises:
        InvalidInput: not an ``Equilibrium``; cables with a memory.
        MissingExtra: python-flint is not installed.

    Source: Krawczyk 1969, doi:10.1007/BF02234767; Neumaier 1990; F. Johansson, Arb, doi:10.1109/TC.2017.2690633.
    """
    if not isinstance(equilibrium, Equilibrium):
        raise InvalidInput(f"equilibrium: found {equilibrium!r}, expected an Equilibrium")
    problem = equilibrium.problem
    with arithmetic(BITS):
        balance = Balance(problem, Pose(equilibrium.position, equilibrium.rotation_matrix))
        found, reason = enclose(balance)
        if found is not None:
            reason = beyond_law(balance, found)[1]
        if found is not None and not reason:
            return certificate_of(equilibrium, balance, found)
    cables = problem.robot.cables
    return Certificate(
        equilibrium=equilibrium,
        exists=False,
        index=None,
        slack=(None,) * cables,
        position=np.full((2, 3), np.nan),
        rotation=np.full((2, 3, 3), np.nan),
        tensions=np.full((2, cables), np.nan),
        reasons=(reason,),
    )


def enclose(balance: Balance) -> tuple[Enclosure | None, str]:
    """A box near the start of ``balance`` with exactly one equilibrium, or the reason why none is found."""
    arm = balance.problem.robot.characteristic_length
    centred = _centre(balance, arm)
    if centred is None:
        return None, "a direction is neutral, or no equilibrium is near: the stiffness there cannot be inverted"
    centre, point, inverse = centred
    gaps = [abs(middle(pull.stretch)) for pull in point.pulls]
    if not all(math.isfinite(gap) for gap in gaps):
        cable = next(i for i, gap in enumerate(gaps) if not math.isfinite(gap))
        return None, f"cable {cable + 1} has no path there: its anchor lies at its exit, or inside its pulley's wheel"
    # The law of a cable with mass has no kink.
    gaps = [math.inf if cable.has_mass else gap for cable, gap in zip(balance.cables, gaps, strict=True)]
    for radius in _radii(arm, min(gaps)):
        box, image = _krawczyk(balance, centre, point, inverse, radius)
        if image is not None:
            # The equilibrium is about as far from the centre as Newton's next step leads: the least box that is proved.
            steps = product(inverse, point.forces)[: balance.free]
            size, smaller = max(2 * max(upper(abs(step)) for step in steps), SMALLEST_BOX * arm), None
            while smaller is None and size < radius:
                _, smaller = _krawczyk(balance, centre, point, inverse, size)
                size /= SHRINK
            image = image if smaller is None else smaller
            return Enclosure(box, image, balance.at(image), radius), ""
    for radius in _radii(arm, math.inf):
        found = _monotone(balance, centre, point, radius)
        if found is not None:
            return found, ""
    values = np.abs(np.linalg.eigvals(middles(_condensed(balance, point))))
    nearest, gap = int(np.argmin(gaps)), min(gaps)
    if values.min() <= 1e-12 * values.max():
        return None, "a direction is neutral or nearly so: equilibria are not isolated there, or a fold is near"
    if gap < 1e-6 * arm:
        return None, f"cable {nearest + 1} is within {gap:.0e} m of its rest length, a kink that no box proves"
    return None, "no box about the pose that Newton's steps lead to passes the test: no equilibrium may be near"


def beyond_law(balance: Balance, found: Enclosure) -> tuple[bool | None, str]:
    """Whether some cable is strained beyond the range of its nonlinear law, None if undecided; and a sentence.

    The equations continue laws linearly there, so that a box may enclose what is no equilibrium. Of a cable with mass,
    no strain beyond the range is enclosed (``cables``).
    """
    undecided = ""
    for index, (cable, pull) in enumerate(zip(balance.cables, found.state.pulls, strict=True)):
        if cable.linear or cable.has_mass:
            continue
        strain = cable.strain(pull.stretch)
        if strain > exact(MOST_STRAIN):
            return True, (
                f"cable {index + 1} is strained by {middle(strain):.3%}, beyond the range of its nonlinear law, "
                f"{MOST_STRAIN:.0%}"
            )
        if not strain <= exact(MOST_STRAIN):
            undecided = (
                f"cable {index + 1} is strained by {MOST_STRAIN:.0%} within {float(strain.rad()):.0e}, the end of the "
                "range of its nonlinear law: neither inside nor beyond is proved"
            )
    return (None if undecided else False), undecided


def _radii(arm: float, gap: float) -> Iterator[float]:
    """Decreasing sizes of boxes [m]; one of them just does not reach a kink at the distance ``gap``."""
    radius, kink = LARGEST_BOX * arm, GAP_SHARE * gap
    while radius > SMALLEST_BOX * arm:
        if radius * SHRINK < kink < radius:
            yield kink
        elif radius <= kink or not SMALLEST_BOX * arm <= kink < math.inf:
            yield radius
        radius *= SHRINK


def _centre(balance: Balance, arm: float) -> tuple[Balls, At, Balls] | None:
    """Result of Newton's steps from the start, the balance there, and an approximate inverse of its slope."""
    x = balance.start
    for step in range(POLISH):
        here = balance.at(x)
        slope = middles(here.slope)
        scale = np.abs(slope).max(1)
        if not (np.isfinite(slope).all() and (scale > 0).all()):
            return None
        try:
            inverse = exact(np.linalg.inv(slope / scale[:, None]) / scale)
        except np.linalg.LinAlgError:
            return None
        moved = product(inverse, here.forces)
        longest = np.abs(middles(moved[: balance.free])).max()
        if not longest <= arm:
            return None
        if longest < SMALLEST_BOX * arm or step == POLISH - 1:
            return x, here, inverse
        x = centres(x - moved)
    return None


def _widths(balance: Balance, point: At, radius: float) -> np.ndarray:
    """Widths of a box: ``radius`` in the pose, and in the tensions what results from it."""
    n, widths = balance.free, np.full(balance.unknowns, radius)
    slope = middles(point.slope)
    for first in range(n, balance.unknowns, 3):
        rows = slice(first, first + 3)
        own = 4 * radius * np.abs(np.linalg.solve(slope[rows, rows], slope[rows, :n])).sum(1)
        widths[rows] = np.maximum(own, 0.1 * own.max())  # a planar robot's cables do not move across its plane
    return widths


def _krawczyk(balance: Balance, centre: Balls, point: At, inverse: Balls, radius: float) -> tuple[Balls, Balls | None]:
    """A box X about the centre, and K(X) if it is proved to lie inside."""
    box = centre + within(_widths(balance, point, radius))
    spread = np.eye(len(box), dtype=object) - product(inverse, balance.at(box).slope)
    image = centre - product(inverse, point.forces) + product(spread, box - centre)
    inside = all(b.contains_interior(i) for b, i in zip(box, image, strict=True))
    return box, image if inside else None


def _monotone(balance: Balance, centre: Balls, point: At, radius: float) -> Enclosure | None:
    """Enclosure by convexity, at a kink."""
    if balance.with_mass:
        return None
    box = centre + within(np.full(len(centre), radius))
    over = balance.at(box)
    kinks = _kinks(over)
    if not kinks or len(kinks) > MOST_KINKS or not all(over.pulls[i].stretch.is_finite() for i in kinks):
        return None
    slopes = _slopes(balance, box, kinks)
    least = min(float(np.linalg.eigvalsh((one + one.T) / 2)[0]) for one in map(middles, slopes))
    if not least > 0:
        return None
    mu = exact(least / 2)
    if any(index_of(slope - mu * np.eye(len(slope), dtype=object)) != 0 for slope in slopes):
        return None
    distance = norm(point.forces) / mu
    if not distance < radius:
        return None
    image = centre + within(np.full(len(centre), distance))
    return Enclosure(box, image, balance.at(image), radius, monotone=True)


def _kinks(state: At) -> list[int]:
    """Cables that may be stretched or not."""
    return [i for i, pull in enumerate(state.pulls) if pull.stretched is None]


def _slopes(balance: Balance, box: Balls, kinks: list[int]) -> list[Balls]:
    """Derivatives over a box, with every choice of stretched or not of the cables that may be either."""
    choices = itertools.product((True, False), repeat=len(kinks))
    return [balance.at(box, dict(zip(kinks, choice, strict=True))).slope for choice in choices]


def index_of(slope: Balls) -> int | None:
    """The number of negative directions of every matrix's symmetric part within an enclosure; None if unknown.

    By Sylvester's law: transformed to the middle's eigenvectors, where the pivots of L D Lᵀ have the signs.
    """
    half = middles(slope)
    if not np.isfinite(half).all():
        return None
    Q = exact(np.linalg.eigh((half + half.T) / 2)[1])
    turned = product(product(Q.T, (slope + slope.T) / 2), Q)
    negative = 0
    for k in range(len(turned)):
        pivot = turned[k, k]
        if pivot < 0:
            negative += 1
        elif not pivot > 0:
            return None
        turned[k + 1 :, k + 1 :] -= np.outer(turned[k + 1 :, k] / pivot, turned[k, k + 1 :])
    return negative


def index_over(balance: Balance, found: Enclosure) -> int | None:
    """The number of unstable directions of the equilibrium in an enclosure; None if not proved."""
    if found.monotone:
        return 0
    kinks = _kinks(found.state)
    if kinks and not balance.with_mass and len(kinks) <= MOST_KINKS:
        every = {index_of(slope) for slope in _slopes(balance, found.image, kinks)}
        return every.pop() if len(every) == 1 else None
    return index_of(_condensed(balance, found.state))


def midpoint_of(balance: Balance, found: Enclosure) -> Equilibrium:
    """The midpoints of an enclosure as an equilibrium, whose source is "proof"."""
    state, problem, stiffness = found.state, balance.problem, middles(_condensed(balance, found.state))
    tensions = np.array([middle(pull.tension) for pull in state.pulls])
    idle = np.array([pull.stretched is False and not balance.cables[i].has_mass for i, pull in enumerate(state.pulls)])
    return Equilibrium(
        problem=problem,
        pose=Pose(middles(balance.position(found.image)), middles(state.rotation)),
        tensions=np.where(idle, 0.0, tensions),
        lengths=problem.rest_lengths + np.array([middle(pull.stretch) for pull in state.pulls]),
        residual=max(float(force.abs_upper()) for force in state.forces[: balance.free]),
        eigenvalues=np.linalg.eigvalsh((stiffness + stiffness.T) / 2),
        iterations=0,
        source="proof",
    )


def _condensed(balance: Balance, state: At) -> Balls:
    """The stiffness matrix (free, free): the tensions of cables with mass follow the pose."""
    n, slope = balance.free, state.slope
    if not balance.with_mass:
        return slope
    return slope[:n, :n] - product(slope[:n, n:], solution(slope[n:, n:], slope[n:, :n]))


def certificate_of(equilibrium: Equilibrium | None, balance: Balance, found: Enclosure) -> Certificate:
    """Certificate of an equilibrium near which an enclosure is found; None: of the enclosure's midpoint."""
    problem, midpoint = balance.problem, midpoint_of(balance, found)
    equilibrium = equilibrium or midpoint
    state, reasons = found.state, []
    index = index_over(balance, found)
    slack = tuple(cable.slack(pull) for cable, pull in zip(balance.cables, state.pulls, strict=True))
    position = balance.position(found.image)
    position_error = upper(_norm(position - exact(equilibrium.position)))
    turned = state.rotation - exact(equilibrium.rotation_matrix)
    half_sine = _norm(turned.ravel()) / exact(8).sqrt()  # |R − R'|² = 8 sin²(angle/2)
    rotation_error = upper(2 * half_sine.asin()) if half_sine < 1 else math.pi
    tensions = np.array([pull.tension for pull in state.pulls])
    differences = [upper(abs(off)) for off in tensions - exact(equilibrium.tensions)]
    tension_error = max(differences)
    size = max(float(np.abs(problem.robot.exits).max()), float(np.abs(equilibrium.position).max()))
    near = max(NEAR, NEAR_OF_SIZE * size)
    if not position_error <= near or not rotation_error <= NEAR_TURN:
        reasons.append(
            f"it is up to {position_error:.1e} m and {rotation_error:.1e} rad from the given pose: "
            f"further than {near:.0e} m or {NEAR_TURN:.0e} rad"
        )
    scale = max(problem.load, float(equilibrium.tensions.max()))
    if not tension_error <= NEAR_TENSION * scale:
        cable = int(np.argmax(differences))
        reasons.append(
            f"the tension of cable {cable + 1} is {tension_error:.1e} N from the given one: more than "
            f"{NEAR_TENSION * scale:.1e} N"
        )
    for cable, (proved, called) in enumerate(zip(slack, equilibrium.slack, strict=True)):
        if proved is None:
            pull, own = state.pulls[cable], balance.cables[cable]
            place = f"is within {upper(abs(pull.stretch)):.0e} m of its rest length"
            if pull.stretched is False:
                beyond = upper(abs(own.parts * pull.tension - own.slack_limit))
                place = f"pulls within {beyond:.0e} N by as much as a slack cable may"
            reasons.append(f"cable {cable + 1} {place}: neither taut nor slack is proved")
        elif proved != called:
            words = ("taut", "slack") if called else ("slack", "taut")
            reasons.append(f"cable {cable + 1} is {words[0]}, and the equilibrium calls it {words[1]}")
    if index is None:
        reasons.append("stability is not proved: the stiffness is almost zero in some direction")
    radii = max(float(p.rad()) for p in position)
    return Certificate(
        equilibrium=equilibrium,
        exists=True,
        index=index,
        slack=slack,
        position=bounds(position),
        rotation=bounds(state.rotation),
        tensions=bounds(tensions),
        digits=-math.log10(max(radii / size, 2.0**-BITS)),
        decimals={
            name: tuple(ball.str(DIGITS, radius=False) for ball in proved)
            for name, proved in (("position", position), ("rotation", state.rotation.ravel()), ("tensions", tensions))
        },
        radius=found.radius,
        position_error=position_error,
        rotation_error=rotation_error,
        tension_error=tension_error,
        midpoint=midpoint,
        reasons=tuple(reasons),
    )


def _norm(parts: Balls) -> Ball:
    """An upper bound of the length of a vector that may be zero."""
    return norm(np.array([part.abs_upper() for part in parts]))

"""Proof that an equilibrium exists and is unique in a box, which cables are slack there, and that it is stable.

Krawczyk's test: with the balance of forces F, its derivatives F', a box X about the point x₀, and any matrix C,

    K(X) = x₀ − C F(x₀) + (1 − C F'(X)) (X − x₀);   K(X) inside X  ⇒  exactly one zero of F in X, and it lies in K(X)

(Krawczyk 1969; Neumaier, Interval Methods for Systems of Equations, 1990, theorem 5.1.8), all in balls. It holds for
F that is piecewise smooth, with an enclosure of F's generalised derivative: a cable that may be taut or slack
contributes all slopes between the two.

At a kink that is too stiff for that, by convexity: if F is strongly monotone with the constant mu on a sphere of radius
r, and |F(x₀)| < mu r, F has exactly one zero in it, which is stable. F' − mu is positive definite if it is for every
choice of taut and slack of the cables that may be either.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float

from cdpr_sim.core.equilibrium import Equilibrium
from cdpr_sim.core.errors import InvalidInput
from cdpr_sim.core.html_repr import HtmlRepr
from cdpr_sim.core.pose import Pose
from cdpr_sim.core.problem import Problem
from cdpr_sim.proof.balance import At, Balance, middles
from cdpr_sim.proof.balls import BITS, Ball, Matrix, arithmetic, dot, exact, lower, matrix, middle, upper

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
"""Largest number of cables at their rest length for which every choice of taut and slack is tried."""

ENOUGH_DIGITS = 20
"""Number of decimal digits at which an enclosure is small enough."""

IMAGES = 12
"""Largest number of iterated images, which make the enclosure smaller: two suffice, except for stiff robots with a
small stiffness in some direction."""


@dataclass(frozen=True, eq=False)
class Certificate(HtmlRepr):
    """Result of a proof of an equilibrium. Enclosures are (lower, upper), rounded outwards to doubles.

    Attributes:
        equilibrium: the given equilibrium, found by any method.
        exists: whether a box around it is proved to hold exactly one equilibrium; if not, all fields below are unknown
            (nan, inf or None).
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
    digits: float
    decimals: dict[str, tuple[str, ...]]
    radius: float
    position_error: float
    rotation_error: float
    tension_error: float
    midpoint: Equilibrium | None = None
    reasons: tuple[str, ...] = field(default=())

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

    box: list[Ball]
    image: list[Ball]
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
        arm = problem.robot.characteristic_length
        found, reasons = enclose(balance, arm)
        if found is None:
            return _unproved(equilibrium, reasons)
        return certificate_of(equilibrium, balance, found, problem)


def enclose(balance: Balance, arm: float) -> tuple[Enclosure | None, list[str]]:
    """A box near the start of ``balance`` with exactly one equilibrium, or the reasons why there is none.

    Args:
        balance: the equations.
        arm: the platform's characteristic length [m], of which boxes are fractions.
    """
    centred = _centre(balance, arm)
    if centred is None:
        return None, ["a direction is neutral, or no equilibrium is near: the stiffness there cannot be inverted"]
    centre, point, inverse = centred
    gaps = [abs(middle(pull.stretch)) for pull in point.pulls]
    if not all(math.isfinite(gap) for gap in gaps):
        cable = next(i for i, gap in enumerate(gaps) if not math.isfinite(gap))
        return None, [f"cable {cable + 1} has no path there: its anchor lies at its exit, or inside its pulley's wheel"]
    least = min(gaps)
    for radius in _radii(arm, least):
        found = _krawczyk(balance, centre, point, inverse, radius)
        if found is not None:
            return found, []
    for radius in _radii(arm, math.inf):
        found = _monotone(balance, centre, point, radius)
        if found is not None:
            return found, []
    return None, [_why(balance, point, arm)]


def _radii(arm: float, gap: float) -> Iterator[float]:
    """Decreasing sizes of boxes [m]; one of them just does not reach a kink at the distance ``gap``."""
    radius, kink = LARGEST_BOX * arm, GAP_SHARE * gap
    while radius > SMALLEST_BOX * arm:
        if radius * SHRINK < kink < radius:
            yield kink
        elif radius <= kink or not SMALLEST_BOX * arm <= kink < math.inf:
            yield radius
        radius *= SHRINK


def _centre(balance: Balance, arm: float) -> tuple[list[Ball], At, Matrix] | None:
    """Result of Newton's steps from the start, the balance there, and an approximate inverse of its slope."""
    x = balance.start
    for step in range(POLISH):
        here = balance.at(x)
        slope = middles(here.slope)
        scale = np.abs(slope).max(1)
        if not (np.isfinite(slope).all() and (scale > 0).all()):
            return None
        try:
            inverse = matrix([[exact(v) for v in row] for row in np.linalg.inv(slope / scale[:, None]) / scale])
        except np.linalg.LinAlgError:
            return None
        moved = inverse * matrix([[force] for force in here.forces])
        lengths = [abs(middle(moved[k, 0])) for k in range(balance.free)]
        if not all(map(math.isfinite, lengths)) or max(lengths) > arm:
            return None
        if max(lengths) < SMALLEST_BOX * arm or step == POLISH - 1:
            return x, here, inverse
        x = [(x[k] - moved[k, 0]).mid() for k in range(balance.unknowns)]
    return None


def _krawczyk(balance: Balance, centre: list[Ball], point: At, inverse: Matrix, radius: float) -> Enclosure | None:
    box = _box(balance, centre, point, radius)
    image = _image(centre, point, inverse, box, balance.at(box))
    if image is None or not all(b.contains_interior(i) for b, i in zip(box, image, strict=True)):
        return None
    return Enclosure(box, *_smaller(balance, image, inverse), radius)


def _box(balance: Balance, centre: list[Ball], point: At, radius: float) -> list[Ball]:
    """Box about the centre: of width ``radius`` in the pose, and of the resulting width in the tensions."""
    from flint import arb

    radii = [radius] * balance.free
    slope, n = middles(point.slope), balance.free
    for first in range(n, balance.unknowns, 3):
        rows = slice(first, first + 3)
        widths = 4 * radius * np.abs(np.linalg.solve(slope[rows, rows], slope[rows, :n])).sum(1)
        radii += np.maximum(widths, 0.1 * widths.max()).tolist()  # a planar robot's cables do not move across its plane
    return [x + arb(0, r) for x, r in zip(centre, radii, strict=True)]


def _image(centre: list[Ball], point: At, inverse: Matrix, box: list[Ball], over: At) -> list[Ball] | None:
    """K(X) from the balance at the centre and over the box; None where no bound is found."""
    product = inverse * matrix(over.slope)
    offset = inverse * matrix([[force] for force in point.forces])
    image = []
    for k in range(len(box)):
        total = centre[k] - offset[k, 0]
        for m in range(len(box)):
            total += ((1 if k == m else 0) - product[k, m]) * (box[m] - centre[m])
        if not total.is_finite():
            return None
        image.append(total)
    return image


def _smaller(balance: Balance, image: list[Ball], inverse: Matrix) -> tuple[list[Ball], At]:
    """Iterated images, until enough digits are proved; and the balance over the last."""
    over = balance.at(image)
    for _ in range(IMAGES):
        wide = max(float(x.rad()) / max(abs(middle(x)), 1e-3) for x in image[: balance.free])
        if wide < 10.0**-ENOUGH_DIGITS:
            break
        centre = [x.mid() for x in image]
        next_image = _image(centre, balance.at(centre), inverse, image, over)
        if next_image is None or not all(a.overlaps(b) for a, b in zip(image, next_image, strict=True)):
            break
        image = [a.intersection(b) for a, b in zip(image, next_image, strict=True)]
        over = balance.at(image)
    return image, over


def _monotone(balance: Balance, centre: list[Ball], point: At, radius: float) -> Enclosure | None:
    """Enclosure by convexity, at a kink."""
    from flint import arb

    if balance.with_mass:
        return None
    box = [x + arb(0, radius) for x in centre]
    over = balance.at(box)
    kinks = [i for i, pull in enumerate(over.pulls) if pull.taut is None]
    if not kinks or len(kinks) > MOST_KINKS or not all(over.pulls[i].stretch.is_finite() for i in kinks):
        return None
    slopes = _slopes(balance, box, kinks)
    least = min(float(np.linalg.eigvalsh((one + one.T) / 2)[0]) for one in map(middles, slopes))
    if not least > 0:
        return None
    mu = exact(least / 2)
    for slope in slopes:
        shifted = [[slope[k][m] - (mu if k == m else 0) for m in range(balance.free)] for k in range(balance.free)]
        if index_of(shifted) != 0:
            return None
    distance = dot(point.forces, point.forces).sqrt() / mu
    if not distance < radius:
        return None
    image = [x + arb(0, 1) * distance for x in centre]
    return Enclosure(box, image, balance.at(image), radius, monotone=True)


def _slopes(balance: Balance, box: list[Ball], kinks: Sequence[int]) -> list[list[list[Ball]]]:
    """Derivatives over a box, with every choice of taut and slack of the cables that may be either."""
    choices = itertools.product((True, False), repeat=len(kinks))
    return [balance.at(box, dict(zip(kinks, choice, strict=True))).slope for choice in choices]


def index_of(slope: Sequence[Sequence[Ball]]) -> int | None:
    """The number of negative directions of every matrix's symmetric part within an enclosure; None if unknown.

    By Sylvester's law: transformed to the middle's eigenvectors, where the pivots of L D Lᵀ have the signs.
    """
    n = len(slope)
    half = middles(slope)
    if not np.isfinite(half).all():
        return None
    _, vectors = np.linalg.eigh((half + half.T) / 2)
    Q = matrix([[exact(v) for v in row] for row in vectors])
    symmetric = matrix([[(slope[k][m] + slope[m][k]) / 2 for m in range(n)] for k in range(n)])
    turned = (Q.transpose() * symmetric * Q).tolist()
    negative = 0
    for k in range(n):
        pivot = turned[k][k]
        if pivot < 0:
            negative += 1
        elif not pivot > 0:
            return None
        for i in range(k + 1, n):
            factor = turned[i][k] / pivot
            for j in range(k + 1, n):
                turned[i][j] -= factor * turned[k][j]
    return negative


def index_over(balance: Balance, found: Enclosure) -> int | None:
    """The number of unstable directions of the equilibrium in an enclosure; None if not proved.

    Unknowns of cables with mass are eliminated: their force follows the anchor.
    """
    if found.monotone:
        return 0
    n, slope = balance.free, [list(row) for row in found.state.slope]
    for unknown in reversed(range(n, balance.unknowns)):
        pivot = slope[unknown][unknown]
        if not (pivot > 0 or pivot < 0):
            return None
        others = [k for k in range(unknown) if k < n or k >= unknown - (unknown - n) % 3]
        for k in others:
            factor = slope[k][unknown] / pivot
            for m in others:
                slope[k][m] -= factor * slope[unknown][m]
    kinks = [i for i, pull in enumerate(found.state.pulls) if pull.taut is None]
    if kinks and not balance.with_mass and len(kinks) <= MOST_KINKS:
        every = {index_of([row[:n] for row in one[:n]]) for one in _slopes(balance, found.image, kinks)}
        return every.pop() if len(every) == 1 else None
    return index_of([row[:n] for row in slope[:n]])


def midpoint_of(problem: Problem, balance: Balance, found: Enclosure) -> Equilibrium:
    """The midpoints of an enclosure as an equilibrium, whose source is "proof"."""
    state, n, stiffness = found.state, balance.free, _condensed(balance, found.state)
    tensions = np.array([middle(pull.tension) for pull in state.pulls])
    slack = np.array([pull.taut is False and not balance.cables[i].has_mass for i, pull in enumerate(state.pulls)])
    return Equilibrium(
        problem=problem,
        pose=Pose(np.array([middle(p) for p in balance.position(found.image)]), middles(state.rotation)),
        tensions=np.where(slack, 0.0, tensions),
        lengths=problem.rest_lengths + np.array([middle(pull.stretch) for pull in state.pulls]),
        residual=max(float(force.abs_upper()) for force in state.forces[:n]),
        eigenvalues=np.linalg.eigvalsh((stiffness + stiffness.T) / 2),
        iterations=0,
        source="proof",
    )


def _condensed(balance: Balance, state: At) -> np.ndarray:
    """The stiffness matrix in doubles, (free, free): tensions of cables with mass follow the pose."""
    n, slope = balance.free, middles(state.slope)
    if not balance.with_mass:
        return slope
    return slope[:n, :n] - slope[:n, n:] @ np.linalg.solve(slope[n:, n:], slope[n:, :n])


def certificate_of(
    equilibrium: Equilibrium | None, balance: Balance, found: Enclosure, problem: Problem
) -> Certificate:
    """Certificate of an equilibrium near which an enclosure is found; None: of the enclosure's midpoint."""
    midpoint = midpoint_of(problem, balance, found)
    equilibrium = equilibrium or midpoint
    state, reasons = found.state, []
    index = index_over(balance, found)
    slack = tuple(None if pull.taut is None else not pull.taut for pull in state.pulls)
    position = balance.position(found.image)
    off = [p - exact(v) for p, v in zip(position, equilibrium.position, strict=True)]
    position_error = upper(_norm(off))
    rotation = [entry for row in state.rotation for entry in row]
    turned = [a - exact(v) for a, v in zip(rotation, equilibrium.rotation_matrix.ravel(), strict=True)]
    half_sine = _norm(turned) / exact(8).sqrt()  # |R − R'|² = 8 sin²(angle/2)
    rotation_error = upper(2 * half_sine.asin()) if half_sine < 1 else math.pi
    tensions = [pull.tension for pull in state.pulls]
    differences = [upper(abs(t - exact(v))) for t, v in zip(tensions, equilibrium.tensions, strict=True)]
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
            gap = upper(abs(state.pulls[cable].stretch))
            reasons.append(
                f"cable {cable + 1} is within {gap:.0e} m of its rest length: neither taut nor slack is proved"
            )
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
        position=np.array([[lower(p) for p in position], [upper(p) for p in position]]),
        rotation=np.array([[[end(v) for v in row] for row in state.rotation] for end in (lower, upper)]),
        tensions=np.array([[lower(t) for t in tensions], [upper(t) for t in tensions]]),
        digits=-math.log10(max(radii / size, 2.0**-BITS)),
        decimals={
            name: tuple(ball.str(ENOUGH_DIGITS + 10, radius=False) for ball in proved)
            for name, proved in (("position", position), ("rotation", rotation), ("tensions", tensions))
        },
        radius=found.radius,
        position_error=position_error,
        rotation_error=rotation_error,
        tension_error=tension_error,
        midpoint=midpoint,
        reasons=tuple(reasons),
    )


def _norm(parts: Sequence[Ball]) -> Ball:
    """An upper bound of the length of a vector that may be zero."""
    bounds = [part.abs_upper() for part in parts]
    return dot(bounds, bounds).sqrt()


def _why(balance: Balance, point: At, arm: float) -> str:
    """Reason why no box was found: a neutral direction, a kink, or a pose from which Newton's steps do not converge."""
    values = np.abs(np.linalg.eigvals(_condensed(balance, point)))
    nearest = int(np.argmin([abs(middle(pull.stretch)) for pull in point.pulls]))
    gap = abs(middle(point.pulls[nearest].stretch))
    if values.min() <= 1e-12 * values.max():
        return "a direction is neutral or nearly so: equilibria are not isolated there, or a fold is near"
    if gap < 1e-6 * arm:
        return f"cable {nearest + 1} is within {gap:.0e} m of its rest length, a kink that no box proves"
    return "no box about the pose that Newton's steps lead to passes the test: no equilibrium may be near"


def _unproved(equilibrium: Equilibrium, reasons: list[str]) -> Certificate:
    cables = len(equilibrium.tensions)
    return Certificate(
        equilibrium=equilibrium,
        exists=False,
        index=None,
        slack=(None,) * cables,
        position=np.full((2, 3), np.nan),
        rotation=np.full((2, 3, 3), np.nan),
        tensions=np.full((2, cables), np.nan),
        digits=0.0,
        decimals={},
        radius=math.nan,
        position_error=math.inf,
        rotation_error=math.inf,
        tension_error=math.inf,
        reasons=tuple(reasons),
    )

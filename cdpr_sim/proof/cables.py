"""The force of a cable on its anchor, in balls: its slope, and whether the cable is slack.

The formulas are coded here again from their sources, and not imported from the solvers: a proof could not detect an
error in shared code.

- A straight cable has the length l = |b − a| between its exit a and its anchor b.
- Over a swivelling wheel of radius r at the exit (Pott 2012, doi:10.1007/978-94-007-4620-6_25), with the anchor at the
  height h below the exit along the wheel's axis and at the distance ρ from that axis, l = r θ + s with
  s² = a² + h² − r², a = ρ − r, and θ = atan2(a, h) + atan2(r, s). The cable arrives along n sin θ + e cos θ, with n the
  direction of ρ: the slope of l. Its change is t tᵀ/s, with t = n cos θ − e sin θ, and the swivelling of the wheel.
- Its tension is τ = EA (ε + a2 ε² + a3 ε³) for ε = l/l0 − 1 > 0, and 0 otherwise. Beyond ε = 20 % the equations are
  continued linearly, and what they enclose there is no equilibrium (``certificate.beyond_law``). A rope with n parts of
  line, and the length g between winch and exit, has ε = n (l − l0)/(n l0 + g) and pulls with n τ. Of a cable with the
  rigid length d at its anchor, l0 − d stretches: ε = n (l − l0)/(n (l0 − d) + g).
- A cable with mass adds its tension vector t = (t_h, V) as unknowns: where its weight w per rest length begins, after
  the massless first length c (``Robot.wrapped_lengths``). There it leaves the wheel along u = t/T, at the angle θ =
  atan2(|e × u|, e·u) from the axis e. From there on a rest length L hangs freely (Irvine, Cable Structures, 1981,
  chapter 1), up to the vertical part V + w L and the tension T₁ at its end, along u₁; what is rigid lies along it. With
  the strain ε(T), the inverse of the law, the cable ends at its anchor b if

      b − a = r sin θ (u + e)/(1 + cos θ) + [c + (c + g/n) ε − r θ] u + (t_h δ, T₁ − T)/w + ∫ ε (t_h, V) dx/w + d u₁,

  with δ = 2 artanh(w L/(T + T₁)), and T(x) = T_m cosh x + V_m sinh x, V = dT/dx, over an interval of the length δ.

A cable without mass is slack if it is not stretched: its law has a kink there. One with mass is slack if it also pulls
by at most max(w l0, 1 % of the platform's weight), and its law has no kink (the definition is that of ``core.slack``).

Sections of another material would be further data of ``Cable``.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float

from cdpr_sim.core.cable import MOST_STRAIN
from cdpr_sim.core.problem import Problem
from cdpr_sim.core.robot import Robot
from cdpr_sim.core.slack import SHARE
from cdpr_sim.proof.balls import (
    BITS,
    Ball,
    Balls,
    arithmetic,
    bounds,
    exact,
    middle,
    middles,
    norm,
    within,
    zeros,
)

LARGEST_A = 600.0
"""Largest half length of a catenary's interval of x: its sinh is near the largest double. Such a cable is vertical to
1e-260."""

TERMS, PIECE = 20, 0.25
"""Terms of a Taylor series, and the largest length in x of the part of a cable that one series covers: its remainder is
below 1e-21 for laws whose slope has its complex zeros 0.75 from there, as those of steel ropes."""

MOST_PIECES = 400
"""Largest number of such parts: no more than ``LARGEST_A`` asks for, and more than any cable that pulls."""

START = 1e-12
"""Tolerance of the tension of a cable with mass from which Newton's steps begin, as a fraction of it."""

EYE = np.eye(3, dtype=object)


@dataclass(frozen=True)
class Pull:
    """Force of a cable on its anchor.

    Attributes:
        force: on the anchor, (3,) [N].
        slope: ∂force/∂anchor, (3, 3) [N/m]; 0 of a cable with mass, whose force is minus its unknowns and its weight.
        stretched: True where it is proved longer than its rest length, False where it is proved shorter, None
            otherwise.
        tension: of the rope, at the anchor [N].
        stretch: length minus rest length [m]; of a cable with mass, as if it had none.
        gap: from the anchor to the end of a cable with mass, (3,) [m].
        compliance: ∂gap/∂unknowns, (3, 3) [m/N], of a cable with mass.
    """

    force: Balls
    slope: Balls
    stretched: bool | None
    tension: Ball
    stretch: Ball
    gap: Balls | None = None
    compliance: Balls | None = None


class Cable:
    """One cable of a problem, its data as balls of radius 0."""

    def __init__(self, problem: Problem, index: int) -> None:
        cabling = problem.robot.cabling
        cabling.refuse_memory()
        cabling.refuse_unknown("proof")
        self.exit = exact(cabling.exits[index])
        self.anchor = exact(cabling.anchors[index])
        self.rest_length, self.rigid = exact(problem.rest_lengths[index]), exact(cabling.rigid_length[index])
        self.hanging = self.rest_length - self.rigid  # what is rope of it
        self.axial_stiffness = exact(cabling.axial_stiffness[index])
        self.parts, self.behind = int(cabling.reeving[index]), exact(cabling.winch_to_exit[index])
        self.a2, self.a3 = exact(cabling.stiffening[index])
        self.linear = not cabling.nonlinear[index]
        self.radius = exact(cabling.pulley_radius[index])
        self.over_pulley = bool(cabling.pulleys[index])
        axis = exact(cabling.pulley_axis[index])
        self.axis = axis / norm(axis)
        self.has_mass = bool(cabling.linear_density[index] * problem.robot.gravity > 0)
        self.weight = self.parts * exact(cabling.linear_density[index]) * exact(problem.robot.gravity)
        self.massless = exact(problem.robot.wrapped_lengths[index])
        share = exact(SHARE) * exact(problem.mass) * exact(problem.robot.gravity)
        self.slack_limit = share.max(self.weight * self.hanging)
        self.no_slope = zeros(3, 3)  # of a cable without mass that is not stretched

    def pull(self, at: Balls, unknowns: Balls | None = None, taken_as: bool | None = None) -> Pull:
        """Pull of the cable with its anchor at ``at``, base frame.

        Args:
            at: (3,) [m].
            unknowns: the tension vector where its weight begins, (3,) [N], for a cable with mass.
            taken_as: stretched or not, for a cable whose length may be more or less than its rest length. By default
                force and slope enclose both.
        """
        from_exit = at - self.exit
        if unknowns is None and not self.over_pulley:
            square = from_exit @ from_exit
            if square < self.rest_length * self.rest_length:
                return self._no_pull(square.sqrt() - self.rest_length)
        length, along, curvature = self._path(from_exit)
        stretch = length - self.rest_length
        stretched = True if stretch > 0 else False if stretch < 0 else None
        if unknowns is not None:
            force = -unknowns - [0, 0, self._free_weight()]
            gap, compliance = self._end(unknowns, from_exit)
            if not length.is_finite():  # below the wheel
                gap = np.full(3, length)
            return Pull(force, self.no_slope, stretched, norm(force) / self.parts, stretch, gap, compliance)
        state = taken_as if stretched is None else stretched
        if state is False:
            return self._no_pull(stretch, stretched)
        zero = self.no_slope[0, 0]
        tension, stiffness = self._tension(stretch if stretched else stretch.max(zero))
        if state is None:
            tension, stiffness = tension.union(zero), stiffness.union(zero)
        pulled, stiffness = self.parts * tension, self.parts * self.parts * stiffness
        slope = -(stiffness * along[:, None] * along + pulled * curvature)
        return Pull(-pulled * along, slope, stretched, tension, stretch)

    def _no_pull(self, stretch: Ball, stretched: bool | None = False) -> Pull:
        return Pull(self.no_slope[0], self.no_slope, stretched, self.no_slope[0, 0], stretch)

    def slack(self, pull: Pull) -> bool | None:
        """Whether the cable is proved slack (True), or taut (False); None otherwise."""
        if not self.has_mass:
            return None if pull.stretched is None else not pull.stretched
        beyond = self.parts * pull.tension - self.slack_limit
        if pull.stretched or beyond > 0:
            return False
        return True if pull.stretched is False and beyond <= 0 else None

    def tension_near(self, at: np.ndarray) -> Balls:
        """Balls of radius 0 near the unknowns of a cable with mass with its anchor at ``at``; proves nothing."""
        from scipy.optimize import root  # takes longer to import than proofs of cables without mass

        from_exit = exact(at) - self.exit

        def miss(t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            gap, compliance = self._end(exact(t), from_exit)
            return middles(gap), middles(compliance)

        return exact(root(miss, self._tension_start(from_exit), jac=True, tol=START).x)

    def _tension_start(self, from_exit: Balls) -> np.ndarray:
        """Of a stretched cable that pulls along its massless path; or of one that hangs between points, linear."""
        rest, weight = middle(self.hanging), middle(self.weight)
        hanging, span = middle(self._free_weight()), middles(from_exit) * middle(self.hanging / self.rest_length)
        path, along, _ = self._path(from_exit)
        stretch = middle(path - self.rest_length)
        if stretch > 0:
            tension = self.parts * middle(self._tension(exact(stretch))[0])
            if tension > hanging:
                return tension * middles(along) - [0, 0, hanging / 2]
        across, rise = span[0] ** 2 + span[1] ** 2, span[2] ** 2
        kappa = weight * rest / (2 * self.parts * middle(self.axial_stiffness))

        def beyond(a: float) -> float:  # with the tension (H, V) in the middle, and H sinh(b ± a) = V ± w l0/2
            tangent = math.tanh(a)
            return across * (math.sinh(a) / (a + kappa)) ** 2 + rise * (tangent / (tangent + kappa)) ** 2 - rest**2

        low, high = math.log(1e-150), math.log(LARGEST_A / 2)
        for _ in range(200):
            mean = (low + high) / 2
            low, high = (mean, high) if beyond(math.exp(mean)) < 0 else (low, mean)
        a = math.exp(low)
        return np.array([*(weight * span[:2] / (2 * (a + kappa))), weight * span[2] / (2 * (math.tanh(a) + kappa))]) - [
            0, 0, hanging / 2,
        ]  # fmt: skip

    def _free_weight(self) -> Ball:
        """w L [N]."""
        return self.weight * (self.hanging - self.massless)

    def strain(self, stretch: Ball) -> Ball:
        """ε for this stretch of one part of line, of a cable without mass."""
        return stretch * self.parts / self._rope()

    def _rope(self) -> Ball:
        """The rest length from the winch to the rope's end [m]."""
        return self.hanging * self.parts + self.behind

    def _tension(self, stretch: Ball) -> tuple[Ball, Ball]:
        """τ and its derivative by the length of the rope [N, N/m], for this stretch of one part of line, or none."""
        strain, unit = self.strain(stretch), self.axial_stiffness / self._rope()
        if self.linear:
            return self.axial_stiffness * strain, unit
        curved = strain.min(exact(MOST_STRAIN))
        slope = self._law_slope(curved)
        return self.axial_stiffness * (self._law(curved) + (strain - curved) * slope), unit * slope

    def _path(self, from_exit: Balls) -> tuple[Ball, Balls, Balls]:
        """The length of the path, with its first and second derivatives by the anchor's position."""
        if not self.over_pulley:
            length = norm(from_exit)
            along = from_exit / length
            return length, along, (EYE - along[:, None] * along) / length
        height = from_exit @ self.axis
        radial = from_exit - height * self.axis
        rho = norm(radial)
        beyond = rho - self.radius
        if not beyond > 0:  # below the wheel the formula would give a path that no cable takes
            beyond = exact(math.nan)
        far, atan2 = beyond * beyond + height * height, type(rho).atan2
        free = (far - self.radius * self.radius).sqrt()
        sine = (beyond * free + height * self.radius) / far
        cosine = (height * free - beyond * self.radius) / far
        n, e = radial / rho, self.axis
        turned = cosine * n - sine * e
        length = self.radius * (atan2(beyond, height) + atan2(self.radius, free)) + free
        swivelled = sine / rho * (EYE - e[:, None] * e - n[:, None] * n)
        return length, sine * n + cosine * e, turned[:, None] * turned / free + swivelled

    def _strain(self, tension: Ball) -> tuple[Ball, Ball]:
        """ε(T) and its derivative [1/N], for all parts of line; nan unless ε is proved below ``MOST_STRAIN``."""
        load = tension / (self.parts * self.axial_stiffness)
        if self.linear:
            return load, 1 / (self.parts * self.axial_stiffness)
        strain = self._root(load)
        return strain, 1 / (self.parts * self.axial_stiffness * self._law_slope(strain))

    def _law_slope(self, strain: Any) -> Any:
        return 1 + strain * (2 * self.a2 + strain * (3 * self.a3))

    def _law(self, strain: Any) -> Any:
        return strain * (1 + strain * (self.a2 + strain * self.a3))

    def _root(self, load: Ball) -> Ball:
        """The strain of a load τ/EA, by Newton's interval method."""
        target, low, high = middle(load), 0.0, MOST_STRAIN
        a2, a3 = middle(self.a2), middle(self.a3)
        for _ in range(60):  # the law increases up to MOST_STRAIN
            mean = (low + high) / 2
            low, high = (mean, high) if mean * (1 + mean * (a2 + mean * a3)) < target else (low, mean)
        centre = exact((low + high) / 2)
        for _ in range(2):
            centre = (centre - (self._law(centre) - load.mid()) / self._law_slope(centre)).mid()
        off = self._law(centre) - load
        near = centre + within(2 * (off / self._law_slope(centre)).abs_upper())
        image = centre - off / self._law_slope(near)
        if near > 0 and near < exact(MOST_STRAIN) and self._law_slope(near) > 0 and near.contains(image):
            return image
        return exact(math.nan)

    def _end(self, t: Balls, from_exit: Balls) -> tuple[Balls, Balls]:
        """The gap from the anchor to where a cable with mass ends, (3,) [m], and its derivatives, (3, 3) [m/N]."""
        w, L, W = self.weight, self.hanging - self.massless, self._free_weight()
        across = t[:2] @ t[:2]
        T, V1 = (across + t[2] * t[2]).sqrt(), t[2] + W
        T1 = (across + V1 * V1).sqrt()
        if not L > 0 or not T > 0:
            return exact(np.full(3, np.nan)), exact(np.full((3, 3), np.nan))
        both = T + T1
        delta, mean = 2 * (W / both).atanh() / w, L * (t[2] + V1) / both
        bent = 2 * W * both / ((both * both - W * W) * T * T1) / w
        ends = np.array([*(delta * t[:2]), mean])
        slopes = _bordered(t, delta, -bent, -mean / (T * T1), across * bent)
        stretched, more = self._stretch(t, W, across)
        guided, turning = self._guided(t, T)
        if self.rigid > 0:
            last = np.array([t[0], t[1], V1]) / T1
            guided, turning = guided + self.rigid * last, turning + self.rigid / T1 * (EYE - last[:, None] * last)
        return ends + stretched + guided - from_exit, slopes + more + turning

    def _guided(self, t: Balls, T: Ball) -> tuple[Balls, Balls]:
        """The first part of a cable with mass: on the wheel, the massless length, and what lies behind the exit."""
        u = t / T
        stretching = self.massless + self.behind / self.parts
        strain, slope = self._strain(T)
        free = self.massless + stretching * strain
        beyond, turning = 0 * u, 0 * EYE
        if self.over_pulley:
            e = self.axis
            aside = np.array([e[i - 2] * u[i - 1] - e[i - 1] * u[i - 2] for i in range(3)])  # e × u
            sine, cosine = norm(aside), e @ u
            free -= self.radius * type(T).atan2(sine, cosine)
            beyond = self.radius * sine * (u + e) / (1 + cosine)
            turning = self.radius / (T * sine * (1 + cosine)) * aside[:, None] * aside
        along = stretching * slope - free / T
        return beyond + free * u, turning + along * u[:, None] * u + free / T * EYE

    def _stretch(self, t: Balls, W: Ball, across: Ball) -> tuple[Balls, Balls]:
        """∫ ε (t_h, V) dx/w over the free part, and its derivatives by t."""
        if self.linear:
            per = (self.hanging - self.massless) / (self.parts * self.axial_stiffness)
            return per * (t + np.array([0, 0, W / 2])), per * EYE
        # ε' is the slope of ε(T), and p = (ε' − ε/T)/T: the derivatives are ∫ (ε δᵢⱼ + p vᵢ vⱼ) dx/w with v = (t_h, V).
        strain, strain_V, p, pV, pVV = self._integrals(t[2], W, across)
        return np.array([*(strain * t[:2]), strain_V]), _bordered(t, strain, p, pV, strain + pVV)

    def _integrals(self, V: Ball, W: Ball, across: Ball) -> Balls:
        """∫ (ε, ε V, p, p V, p V²) dx/w along the free part, piece by piece."""
        from flint import ctx

        H = max(math.sqrt(max(middle(across), 0.0)), 1e-300)
        ends = [math.asinh(middle(v) / H) for v in (V, V + W)]
        pieces = max(1, min(MOST_PIECES, math.ceil((ends[1] - ends[0]) / PIECE)))
        total = zeros(5)
        cap, ctx.cap = ctx.cap, TERMS + 1
        try:
            low = V
            for piece in range(pieces):
                last = V + W
                if piece < pieces - 1:
                    last = V + exact(H * math.sinh(ends[0] + (ends[1] - ends[0]) * (piece + 1) / pieces)) - V.mid()
                total = total + self._integrals_over(low, last, across)
                low = last
        finally:
            ctx.cap = cap
        return total / self.weight

    def _integrals_over(self, low: Ball, last: Ball, across: Ball) -> Balls:
        """The same integrals without 1/w where V grows from ``low`` to ``last``."""
        T0, T1 = (across + low * low).sqrt(), (across + last * last).sqrt()
        part = (last - low) / (T0 + T1)
        half, cosine = part.atanh(), (1 - part * part).sqrt() / 2
        T, V = (T0 + T1) * cosine, (low + last) * cosine  # in the middle of the interval of x
        somewhere = within(half.abs_upper())
        cosh, sinh = somewhere.cosh(), somewhere.sinh()
        if not half.is_finite():
            return np.full(5, half)
        around, over = self._series(T, V), self._series(T * cosh + V * sinh, V * cosh + T * sinh)
        totals = []
        for here, anywhere in zip(around, over, strict=True):
            power, total = 2 * half, exact(0)
            for k in range(0, TERMS, 2):
                total += here[k] * power / (k + 1)
                power *= half * half
            totals.append(total + anywhere[TERMS] * power / (TERMS + 1))
        return np.array(totals)

    def _series(self, T: Ball, V: Ball) -> list[Any]:
        """Taylor series in x of (ε, ε V, p, p V, p V²) about a point with this tension and its vertical part."""
        from flint import arb_series, ctx

        EA, terms = self.parts * self.axial_stiffness, ctx.cap
        tension, upright, factorial = [], [], exact(1)
        for k in range(terms):
            factorial *= max(k, 1)
            tension.append((V if k % 2 else T) / factorial)
            upright.append((T if k % 2 else V) / factorial)
        first = self._root(T / EA)
        if not (self._law_slope(first) > 0 and 1 + first * (self.a2 + first * self.a3) > 0):
            return [[exact(math.nan)] * terms] * 5
        load, V_series = arb_series(tension) / EA, arb_series(upright)
        strain, known = arb_series([first]), 1
        try:
            while known < terms:  # Newton's steps double the number of terms
                known = ctx.cap = min(2 * known, terms)
                strain = arb_series(strain.coeffs(), prec=known)
                strain = strain - (self._law(strain) - load) / self._law_slope(strain)
                strain = arb_series([first, *strain.coeffs()[1:]], prec=known)
        finally:
            ctx.cap = terms
        secant = 1 + strain * (self.a2 + strain * self.a3)
        p = -(self.a2 + strain * (2 * self.a3)) / (secant * secant * self._law_slope(strain) * (EA * EA))
        pV = p * V_series
        return [strain, strain * V_series, p, pV, pV * V_series]


def laws(problem: Problem, cables: list[Cable]) -> Float[np.ndarray, "cables law"]:
    """Each cable's row of ``geometry_kernel.Setup.law``."""
    with arithmetic(BITS):
        pairs = [(one.parts * one.axial_stiffness, one._rope() / one.parts) for one in cables]
        ends = np.moveaxis(bounds(np.array(pairs)), 0, -1)  # (cables, 2, 2): EA and the length that stretches
    columns = problem.rest_lengths, ends, problem.robot.stiffening, np.stack(slopes_of_law(problem.robot), 1)
    return np.array([[l0, *EA, *law, *slopes, *whole] for l0, (EA, whole), law, slopes in zip(*columns, strict=True)])


def slopes_of_law(robot: Robot) -> tuple[Float[np.ndarray, " cables"], Float[np.ndarray, " cables"]]:
    """Bounds of 1 + 2 a2 ε + 3 a3 ε² on [0, MOST_STRAIN], beyond which laws are linear: at ends and vertex."""
    a2, a3 = robot.stiffening.T
    vertex = np.divide(-a2, 3 * a3, out=np.zeros_like(a2), where=a3 != 0).clip(0, MOST_STRAIN)
    values = np.array([1 + 2 * a2 * e + 3 * a3 * e * e for e in (np.zeros_like(a2), vertex, MOST_STRAIN)])
    spare = 1e-12 * robot.cabling.nonlinear * np.abs(values).max(0)
    return values.min(0) - spare, values.max(0) + spare


def wheels(cables: list[Cable]) -> Float[np.ndarray, "cables wheel 2"]:
    """Each cable's rows of ``geometry_kernel.Setup.wheels``."""
    with arithmetic(BITS):
        rows = [[one.radius, *one.axis, *(EYE - np.outer(one.axis, one.axis)).ravel()] for one in cables]
        return np.moveaxis(bounds(np.array(rows)), 0, -1).copy()


def largest_wheel(robot: Robot) -> float:
    """The largest distance between an exit and where its cable leaves the wheel: a diameter [m]."""
    return 2 * float(robot.pulley_radius.max())


def _bordered(t: Balls, diagonal: Ball, outer: Ball, mixed: Ball, last: Ball) -> Balls:
    """The symmetric matrix (3, 3) ``diagonal`` + ``outer`` h hᵀ, bordered by ``mixed`` h and ``last``; h = (t₀, t₁)."""
    matrix = np.empty((3, 3), dtype=object)
    matrix[:2, :2] = outer * t[:2, None] * t[:2] + diagonal * EYE[:2, :2]
    matrix[:2, 2] = matrix[2, :2] = mixed * t[:2]
    matrix[2, 2] = last
    return matrix

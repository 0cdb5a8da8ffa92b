"""The force of a cable on its anchor, in balls: its slope, and whether the cable is taut.

The formulas are coded here again from their sources, and not imported from the solvers: a proof could not detect an
error in shared code.

- A straight cable has the length l = |b − a| between its exit a and its anchor b.
- Over a swivelling wheel of radius r at the exit (Pott 2012, doi:10.1007/978-94-007-4620-6_25), with the anchor at the
  height h below the exit along the wheel's axis and at the distance ρ from that axis, l = r θ + s with
  s² = (ρ − r)² + h² − r² and θ = atan2(ρ − r, h) + atan2(r, s). Slope and curvature of l come from its derivatives.
- Its tension is τ = EA (ε + a2 ε² + a3 ε³) for ε = l/l0 − 1 > 0, and 0 otherwise; linear beyond ε = 20 %. A rope with
  n parts of line, and the length g between winch and exit, has ε = n (l − l0)/(n l0 + g) and pulls with n τ.
- A cable with mass adds its tension vector t = (t_h, V) as unknowns: where its weight w per rest length begins, after
  the massless first length c (``Robot.wrapped_lengths``). There it leaves the wheel along u = t/T, at the angle θ =
  atan2(|e × u|, e·u) from the axis e. From there on a rest length L hangs freely (Irvine, Cable Structures, 1981,
  chapter 1), up to the vertical part V + w L and the tension T₁ at the anchor. With the strain ε(T), the inverse of the
  law, the cable ends at its anchor b if

      b − a = r sin θ (u + e)/(1 + cos θ) + [c + (c + g/n) ε − r θ] u + (t_h δ, T₁ − T)/w + ∫ ε (t_h, V) dx/w,

  with δ = 2 artanh(w L/(T + T₁)), and T(x) = T_m cosh x + V_m sinh x, V = dT/dx, over an interval of the length δ.

Sections of another material would be further data of ``Cable``.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from cdpr_sim.core.cable import MOST_STRAIN
from cdpr_sim.core.problem import Problem
from cdpr_sim.proof.balls import Ball, Jet, balls, dot, exact, hull, matrix, middle

LARGEST_A = 600.0
"""Largest half length of a catenary's interval of x: its sinh is near the largest double. Such a cable is vertical to
1e-260."""

TERMS, PIECE = 20, 0.25
"""Terms of a Taylor series, and the largest length in x of the part of a cable that one series covers: its remainder is
below 1e-21 for laws whose slope has its complex zeros 0.75 from there, as those of steel ropes."""

MOST_PIECES = 400
"""Largest number of such parts: no more than ``LARGEST_A`` asks for, and more than any cable that pulls."""

START_STEPS, HALVINGS = 60, 30
"""Newton steps to the tension of a cable with mass, and how often one is halved until the cable ends nearer."""


@dataclass(frozen=True)
class Pull:
    """Force of a cable on its anchor.

    Attributes:
        force: on the anchor, (3,) [N].
        slope: ∂force/∂anchor, (3, 3) [N/m]; 0 of a cable with mass, whose force is minus its unknowns and its weight.
        taut: True where it is proved longer than its rest length, False where it is proved shorter, None otherwise.
        tension: of the rope, at the anchor [N].
        stretch: length minus rest length [m]; of a cable with mass, as if it had none.
        gap: from the anchor to the end of a cable with mass, (3,) [m]; empty without mass.
        compliance: ∂gap/∂unknowns, (3, 3) [m/N].
    """

    force: list[Ball]
    slope: list[list[Ball]]
    taut: bool | None
    tension: Ball
    stretch: Ball
    gap: Sequence[Ball] = ()
    compliance: Sequence[Sequence[Ball]] = ()


class Cable:
    """One cable of a problem, its data as balls of radius 0."""

    def __init__(self, problem: Problem, index: int) -> None:
        cabling = problem.robot.cabling
        cabling.refuse_memory(problem.robot.name)
        self.exit = balls(cabling.exits[index])
        self.anchor = balls(cabling.anchors[index])
        self.rest_length = exact(problem.rest_lengths[index])
        self.axial_stiffness = exact(cabling.axial_stiffness[index])
        self.parts, self.behind = int(cabling.reeving[index]), exact(cabling.winch_to_exit[index])
        self.a2, self.a3 = balls(cabling.stiffening[index])
        self.linear = not cabling.stiffening[index].any()
        self.radius = exact(cabling.pulley_radius[index])
        self.over_pulley = bool(cabling.pulley_radius[index] > 0)
        axis = balls(cabling.pulley_axis[index])
        length = dot(axis, axis).sqrt()
        self.axis = [part / length for part in axis]
        self.has_mass = bool(cabling.linear_density[index] * problem.robot.gravity > 0)
        self.weight = self.parts * exact(cabling.linear_density[index]) * exact(problem.robot.gravity)
        self.massless = exact(problem.robot.wrapped_lengths[index])

    def pull(self, at: Sequence[Ball], unknowns: Sequence[Ball] | None = None, taken_as: bool | None = None) -> Pull:
        """Pull of the cable with its anchor at ``at``, base frame.

        Args:
            at: (3,) [m].
            unknowns: the tension vector where its weight begins, (3,) [N], for a cable with mass.
            taken_as: taut or slack, for a cable whose length may be more or less than its rest length. By default force
                and slope enclose both.
        """
        apart = [b - a for b, a in zip(at, self.exit, strict=True)]
        if unknowns is not None:
            return self._hanging(apart, unknowns)
        zero = exact(0)
        if not self.over_pulley:
            path = None
            square = dot(apart, apart)
            if square < self.rest_length * self.rest_length:
                return _slack(square.sqrt() - self.rest_length)
            length = square.sqrt()
        else:
            path = self._over_wheel(apart)
            length = path.v
        stretch = length - self.rest_length
        taut = True if stretch > 0 else False if stretch < 0 else None
        state = taken_as if taut is None else taut
        if state is False:
            return _slack(stretch, taut)
        tension, stiffness = self._tension(stretch if taut else stretch.max(zero))
        if state is None:
            tension, stiffness = hull(tension, zero), hull(stiffness, zero)
        if path is not None:
            along, curvature = path.d, path.dd
        else:
            along = [part / length for part in apart]
            curvature = [[((1 if i == j else 0) - along[i] * along[j]) / length for j in range(3)] for i in range(3)]
        pulled, stiffness = self.parts * tension, self.parts * self.parts * stiffness
        force = [-pulled * part for part in along]
        slope = [[-(stiffness * along[i] * along[j] + pulled * curvature[i][j]) for j in range(3)] for i in range(3)]
        return Pull(force, slope, taut, tension, stretch)

    def tension_near(self, at: Sequence[float] | np.ndarray) -> list[Ball]:
        """Balls of radius 0 near the unknowns of a cable with mass with its anchor at ``at``; proves nothing."""
        apart = [exact(b) - a for b, a in zip(at, self.exit, strict=True)]
        t = balls(self._tension_start(apart))
        gap, compliance = self._end(t, apart)
        for _ in range(START_STEPS):
            size = dot(gap, gap)
            try:
                step = [
                    row[0].mid() for row in matrix(compliance).mid().solve(matrix([[g] for g in gap]).mid()).tolist()
                ]
            except ZeroDivisionError:
                return t
            if not all(part.is_finite() for part in step):
                return t
            for halving in range(HALVINGS):
                part = exact(0.5**halving)
                tried = [(a - part * b).mid() for a, b in zip(t, step, strict=True)]
                gap, compliance = self._end(tried, apart)
                if dot(gap, gap) < size:
                    break
            else:
                return t
            t = tried
        return t

    def _tension_start(self, apart: Sequence[Ball]) -> np.ndarray:
        """Of a taut cable that pulls along its massless path; or of a slack one that hangs between points, linear."""
        rest, weight = middle(self.rest_length), middle(self.weight)
        hanging = middle(self._free_weight())
        path = self._over_wheel(apart) if self.over_pulley else None
        span = np.array([middle(v) for v in apart])
        length = float(np.linalg.norm(span)) if path is None else middle(path.v)
        along = span / length if path is None else np.array([middle(v) for v in path.d])
        if length > rest:
            tension = self.parts * middle(self._tension(exact(length - rest))[0])
            if tension > hanging:
                return tension * along - [0, 0, hanging / 2]
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
        return self.weight * (self.rest_length - self.massless)

    def _rope(self) -> Ball:
        """Rest length of the rope, from its winch to its end [m]."""
        return self.rest_length * self.parts + self.behind

    def _tension(self, stretch: Ball) -> tuple[Ball, Ball]:
        """τ and its derivative by the length of the rope [N, N/m], for this stretch of one part of line, or none."""
        rope = self._rope()
        strain, unit = stretch * self.parts / rope, self.axial_stiffness / rope
        if self.linear:
            return self.axial_stiffness * strain, unit
        curved = strain.min(exact(MOST_STRAIN))
        slope = 1 + curved * (2 * self.a2 + curved * (3 * self.a3))
        tension = curved * (1 + curved * (self.a2 + curved * self.a3)) + (strain - curved) * slope
        return self.axial_stiffness * tension, unit * slope

    def _over_wheel(self, apart: Sequence[Ball]) -> Jet:
        """The length of the path with its derivatives by the anchor's position."""
        x, y, z = Jet.coordinates(apart)
        ex, ey, ez = self.axis
        height = x * ex + y * ey + z * ez
        radial = [x - height * ex, y - height * ey, z - height * ez]
        rho = (radial[0] * radial[0] + radial[1] * radial[1] + radial[2] * radial[2]).sqrt()
        beyond = rho - self.radius
        if not beyond.v > 0:  # below the wheel the formula would give a path that no cable takes
            nothing = exact(math.nan)
            return Jet(nothing, [nothing] * 3, [[nothing] * 3] * 3)
        free = (beyond * beyond + height * height - self.radius * self.radius).sqrt()
        radius = Jet(self.radius, [exact(0)] * 3, [[exact(0)] * 3] * 3)
        return (beyond.angle(height) + radius.angle(free)) * self.radius + free

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
        from flint import arb

        target, low, high = middle(load), 0.0, MOST_STRAIN
        a2, a3 = middle(self.a2), middle(self.a3)
        for _ in range(60):  # the law increases up to MOST_STRAIN
            mean = (low + high) / 2
            low, high = (mean, high) if mean * (1 + mean * (a2 + mean * a3)) < target else (low, mean)
        centre = exact((low + high) / 2)
        for _ in range(2):
            centre = (centre - (self._law(centre) - load.mid()) / self._law_slope(centre)).mid()
        off = self._law(centre) - load
        within = centre + arb(0, 1) * (2 * (off / self._law_slope(centre)).abs_upper())
        image = centre - off / self._law_slope(within)
        if within > 0 and within < exact(MOST_STRAIN) and self._law_slope(within) > 0 and within.contains(image):
            return image
        return exact(math.nan)

    def _end(self, t: Sequence[Ball], apart: Sequence[Ball]) -> tuple[list[Ball], list[list[Ball]]]:
        """The gap from the anchor to where a cable with mass ends, (3,) [m], and its derivatives, (3, 3) [m/N]."""
        w, L, W = self.weight, self.rest_length - self.massless, self._free_weight()
        across = t[0] * t[0] + t[1] * t[1]
        T, V, V1 = (across + t[2] * t[2]).sqrt(), t[2], t[2] + W
        T1 = (across + V1 * V1).sqrt()
        if not L > 0 or not T > 0:
            return [exact(math.nan)] * 3, [[exact(math.nan)] * 3] * 3
        both = T + T1
        delta, mean = 2 * (W / both).atanh(), L * (V + V1) / both
        bent = 2 * W * both / ((both * both - W * W) * T * T1)
        ends = [t[0] * delta / w, t[1] * delta / w, mean]
        slopes = [[-t[i] * t[j] * bent / w for j in range(2)] for i in range(2)]
        slopes[0][0] += delta / w
        slopes[1][1] += delta / w
        skew = [-t[i] * mean / (T * T1) for i in range(2)]
        slopes = [[*slopes[0], skew[0]], [*slopes[1], skew[1]], [*skew, across * bent / w]]
        stretched, more = self._stretch(t, W, across)
        guided, turning = self._guided(t, T)
        gap = [a + b + c - d for a, b, c, d in zip(ends, stretched, guided, apart, strict=True)]
        rows = zip(slopes, more, turning, strict=True)
        return gap, [[a + b + c for a, b, c in zip(*row, strict=True)] for row in rows]

    def _guided(self, t: Sequence[Ball], T: Ball) -> tuple[list[Ball], list[list[Ball]]]:
        """The first part of a cable with mass: on the wheel, the massless length, and what lies behind the exit."""
        u = [part / T for part in t]
        stretching = self.massless + self.behind / self.parts
        strain, slope = self._strain(T)
        free = self.massless + stretching * strain
        beyond, turning = [exact(0)] * 3, [[exact(0)] * 3] * 3
        if self.over_pulley:
            e = self.axis
            aside = [e[i - 2] * u[i - 1] - e[i - 1] * u[i - 2] for i in range(3)]  # e × u
            sine, cosine = dot(aside, aside).sqrt(), dot(e, u)
            free -= self.radius * type(T).atan2(sine, cosine)
            beyond = [self.radius * sine * (a + b) / (1 + cosine) for a, b in zip(u, e, strict=True)]
            size = self.radius / (T * sine * (1 + cosine))
            turning = [[size * a * b for b in aside] for a in aside]
        along = stretching * slope - free / T
        end = [p + free * a for p, a in zip(beyond, u, strict=True)]
        return end, [
            [turning[i][j] + along * u[i] * u[j] + (free / T if i == j else 0) for j in range(3)] for i in range(3)
        ]

    def _stretch(self, t: Sequence[Ball], W: Ball, across: Ball) -> tuple[list[Ball], list[list[Ball]]]:
        """∫ ε (t_h, V) dx/w over the free part, and its derivatives by t."""
        EA = self.parts * self.axial_stiffness
        if self.linear:
            per = (self.rest_length - self.massless) / EA
            return [per * t[0], per * t[1], per * (t[2] + W / 2)], [
                [per if i == j else exact(0) for j in range(3)] for i in range(3)
            ]
        # ε' is the slope of ε(T), and p = (ε' − ε/T)/T: the derivatives are ∫ (ε δᵢⱼ + p vᵢ vⱼ) dx/w with v = (t_h, V).
        strain, strain_V, p, pV, pVV = self._integrals(t[2], W, across)
        end = [strain * t[0], strain * t[1], strain_V]
        mixed = [[p * t[i] * t[j] for j in range(2)] for i in range(2)]
        mixed[0][0] += strain
        mixed[1][1] += strain
        skew = [pV * t[0], pV * t[1]]
        return end, [[*mixed[0], skew[0]], [*mixed[1], skew[1]], [*skew, strain + pVV]]

    def _integrals(self, V: Ball, W: Ball, across: Ball) -> list[Ball]:
        """∫ (ε, ε V, p, p V, p V²) dx/w along the free part, piece by piece."""
        from flint import ctx

        H = max(math.sqrt(max(middle(across), 0.0)), 1e-300)
        ends = [math.asinh(middle(v) / H) for v in (V, V + W)]
        pieces = max(1, min(MOST_PIECES, math.ceil((ends[1] - ends[0]) / PIECE)))
        total = [exact(0)] * 5
        cap, ctx.cap = ctx.cap, TERMS + 1
        try:
            low = V
            for piece in range(pieces):
                last = V + W
                if piece < pieces - 1:
                    last = V + exact(H * math.sinh(ends[0] + (ends[1] - ends[0]) * (piece + 1) / pieces)) - V.mid()
                total = [a + b for a, b in zip(total, self._integrals_over(low, last, across), strict=True)]
                low = last
        finally:
            ctx.cap = cap
        return [part / self.weight for part in total]

    def _integrals_over(self, low: Ball, last: Ball, across: Ball) -> list[Ball]:
        """The same integrals without 1/w where V grows from ``low`` to ``last``."""
        from flint import arb

        T0, T1 = (across + low * low).sqrt(), (across + last * last).sqrt()
        part = (last - low) / (T0 + T1)
        half, cosine = part.atanh(), (1 - part * part).sqrt() / 2
        T, V = (T0 + T1) * cosine, (low + last) * cosine  # in the middle of the interval of x
        somewhere = arb(0, 1) * half.abs_upper()
        cosh, sinh = somewhere.cosh(), somewhere.sinh()
        if not half.is_finite():
            return [half] * 5
        around, over = self._series(T, V), self._series(T * cosh + V * sinh, V * cosh + T * sinh)
        totals = []
        for here, anywhere in zip(around, over, strict=True):
            power, total = 2 * half, exact(0)
            for k in range(0, TERMS, 2):
                total += here[k] * power / (k + 1)
                power *= half * half
            totals.append(total + anywhere[TERMS] * power / (TERMS + 1))
        return totals

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

    def _hanging(self, apart: Sequence[Ball], t: Sequence[Ball]) -> Pull:
        length = self._over_wheel(apart).v if self.over_pulley else dot(apart, apart).sqrt()
        gap, compliance = self._end(t, apart)
        if not length.is_finite():  # below the wheel
            gap = [length] * 3
        force = [-t[0], -t[1], -(t[2] + self._free_weight())]
        stretch, zero = length - self.rest_length, exact(0)
        return Pull(
            force=force,
            slope=[[zero] * 3] * 3,
            taut=True if stretch > 0 else False if stretch < 0 else None,
            tension=dot(force, force).sqrt() / self.parts,
            stretch=stretch,
            gap=gap,
            compliance=compliance,
        )


def _slack(stretch: Ball, taut: bool | None = False) -> Pull:
    zero = exact(0)
    return Pull([zero] * 3, [[zero] * 3] * 3, taut, zero, stretch)

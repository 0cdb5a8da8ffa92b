"""The force of a cable on its anchor, in balls: its slope, and whether the cable is taut.

The formulas are coded here again from their sources, and not imported from the solvers: a proof could not detect an
error in shared code.

- A straight cable has the length l = |b − a| between its exit a and its anchor b.
- Over a swivelling wheel of radius r at the exit (Pott 2012, doi:10.1007/978-94-007-4620-6_25), with the anchor at the
  height h below the exit along the wheel's axis and at the distance ρ from that axis, l = r θ + s with
  s² = (ρ − r)² + h² − r² and θ = atan2(ρ − r, h) + atan2(r, s). Slope and curvature of l come from its derivatives.
- Its tension is τ = EA (ε + a2 ε² + a3 ε³) for ε = l/l0 − 1 > 0, and 0 otherwise; linear beyond ε = 20 %. A rope with
  n parts of line, and the length g between winch and exit, has ε = n (l − l0)/(n l0 + g) and pulls with n τ.
- A cable with mass is an elastic catenary (Irvine, Cable Structures, 1981, chapter 1): with the tension (H, V) at its
  middle, H sinh(b ± a) = V ± w l0/2, κ = w l0/(2 EA), it spans x = 2 H/w (a + κ) and z = 2 V/w (tanh a + κ), and
  eliminating H, V and b leaves one equation for the unknown a:

      x² [sinh a/(a + κ)]² + z² [tanh a/(tanh a + κ)]² = l0².

Sections of another material would be further data of ``Cable``.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cdpr_sim.core.cable import MOST_STRAIN
from cdpr_sim.core.problem import Problem
from cdpr_sim.proof.balls import Ball, Jet, balls, dot, exact, hull, middle

LARGEST_A = 600.0
"""Largest value of a catenary's unknown: its sinh is near the largest double. Such a cable is vertical to 1e-260."""


@dataclass(frozen=True)
class Pull:
    """Force of a cable on its anchor.

    Attributes:
        force: on the anchor, (3,) [N].
        slope: ∂force/∂anchor at a fixed unknown, (3, 3) [N/m].
        taut: True where it is proved longer than its rest length, False where it is proved shorter, None otherwise.
        tension: of the rope, at the anchor [N].
        stretch: length minus rest length [m].
        by_unknown: ∂force/∂unknown of a cable with mass, (3,); empty otherwise.
        gap: left minus right side of its equation [m²]; None without mass.
        gap_slope: ∂gap/∂anchor, (3,) [m].
        gap_by_unknown: ∂gap/∂unknown [m²].
    """

    force: list[Ball]
    slope: list[list[Ball]]
    taut: bool | None
    tension: Ball
    stretch: Ball
    by_unknown: list[Ball]
    gap: Ball | None = None
    gap_slope: list[Ball] | None = None
    gap_by_unknown: Ball | None = None


class Cable:
    """One cable of a problem, its data as balls of radius 0."""

    def __init__(self, problem: Problem, index: int) -> None:
        cabling = problem.robot.cabling
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
        self.weight = exact(cabling.linear_density[index]) * exact(problem.robot.gravity)

    def pull(self, at: Sequence[Ball], unknown: Ball | None = None, taken_as: bool | None = None) -> Pull:
        """Pull of the cable with its anchor at ``at``, base frame.

        Args:
            at: (3,) [m].
            unknown: a of the catenary, for a cable with mass.
            taken_as: taut or slack, for a cable whose length may be more or less than its rest length. By default force
                and slope enclose both.
        """
        apart = [b - a for b, a in zip(at, self.exit, strict=True)]
        if self.has_mass:
            return self._hanging(apart, unknown)
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
        return Pull(force, slope, taut, tension, stretch, [])

    def energy(self, at: Sequence[Ball]) -> Ball:
        """∫ τ dl [J] of a massless cable with its anchor at ``at``; by another derivation than ``pull``, for tests."""
        apart = [b - a for b, a in zip(at, self.exit, strict=True)]
        length = self._over_wheel(apart).v if self.over_pulley else dot(apart, apart).sqrt()
        strain = ((length - self.rest_length) * self.parts / self._rope()).max(exact(0))
        curved = strain.min(exact(MOST_STRAIN))
        over = strain - curved
        tension = curved + self.a2 * curved**2 + self.a3 * curved**3
        slope = 1 + 2 * self.a2 * curved + 3 * self.a3 * curved**2
        work = curved**2 / 2 + self.a2 * curved**3 / 3 + self.a3 * curved**4 / 4 + over * tension + over**2 * slope / 2
        return self.axial_stiffness * self._rope() * work

    def unknown_near(self, at: Sequence[float] | np.ndarray) -> float:
        """A double near the catenary's a with the anchor at ``at``, by bisection; proves nothing."""
        apart = [b - middle(a) for b, a in zip(at, self.exit, strict=True)]
        across, rise = apart[0] ** 2 + apart[1] ** 2, apart[2] ** 2
        rest, kappa = middle(self.rest_length), middle(self._kappa())

        def gap(a: float) -> float:
            tangent = math.tanh(a)
            return across * (math.sinh(a) / (a + kappa)) ** 2 + rise * (tangent / (tangent + kappa)) ** 2 - rest**2

        low, high = math.log(1e-150), math.log(LARGEST_A / 2)
        for _ in range(200):
            mean = (low + high) / 2
            low, high = (mean, high) if gap(math.exp(mean)) < 0 else (low, mean)
        return math.exp(low)

    def _kappa(self) -> Ball:
        return self.weight * self.rest_length / (2 * self.axial_stiffness)

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

    def _hanging(self, apart: Sequence[Ball], a: Ball) -> Pull:
        x, y, z = apart
        across, w = x * x + y * y, self.weight
        tangent, kappa = a.tanh(), self._kappa()
        flat, upright = a + kappa, tangent + kappa
        sideways, rising = w / (2 * flat), w / (2 * upright)  # H/x and V/z
        end = rising * z + w * self.rest_length / 2
        force = [-sideways * x, -sideways * y, -end]
        zero = exact(0)
        slope = [[-sideways, zero, zero], [zero, -sideways, zero], [zero, zero, -rising]]
        turning = 1 - tangent * tangent
        more = w / (2 * flat * flat)
        by_unknown = [more * x, more * y, z * turning * w / (2 * upright * upright)]
        span, climb = a.sinh() / flat, tangent / upright
        span_slope = (a.cosh() * flat - a.sinh()) / (flat * flat)
        climb_slope = kappa * turning / (upright * upright)
        stretch = (across + z * z).sqrt() - self.rest_length
        return Pull(
            force=force,
            slope=slope,
            taut=True if stretch > 0 else False if stretch < 0 else None,
            tension=dot(force, force).sqrt(),
            stretch=stretch,
            by_unknown=by_unknown,
            gap=across * span * span + z * z * climb * climb - self.rest_length * self.rest_length,
            gap_slope=[2 * x * span * span, 2 * y * span * span, 2 * z * climb * climb],
            gap_by_unknown=2 * (across * span * span_slope + z * z * climb * climb_slope),
        )


def _slack(stretch: Ball, taut: bool | None = False) -> Pull:
    zero = exact(0)
    return Pull([zero] * 3, [[zero] * 3] * 3, taut, zero, stretch, [])

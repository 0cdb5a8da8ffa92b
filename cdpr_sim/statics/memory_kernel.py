"""Laws of cables with a memory in compiled code, by rows of ``MemoryLaw.table``; the laws are described there.

Where a law is linear, a cable is a spring that is linear between knots. A nonlinear one is a curve with the strain eps
of the rope beyond the exit as parameter: with F = EA (eps + a2 eps² + a3 eps³), the stretch delta of the rope behind
the exit, which friction holds between g eps(F/rho) and g eps(F rho), and the force Q(e) by which elements have given
way, linear between knots,

    e = l0 eps + delta,   T = F − Q(e),   and with creep   x = e + C T.

A cable with mass has, besides its own elasticity, the stretch x(T) − l0 eps(T) at its exit: it depends on the tension
there (``any_cable``).
"""

from __future__ import annotations

import numpy as np

from cdpr_sim.core import cable_law
from cdpr_sim.core.cable import COLUMNS
from cdpr_sim.core.compiling import inline, outlined

KIND, CREEP, CREPT, HELD, RHO, KNOTS = range(6)
"""Columns behind those of ``core.cable``: the kind; what each newton makes the cable creep [m/N], and its creep without
that [m]; delta while the rope holds at its exit (nan without friction), and rho; and the first of the knots: stretches
from 0 in ascending order, the forces there, and the slopes that follow."""

ELASTIC, LINEAR, NONLINEAR = 0.0, 1.0, 2.0
"""Kinds: without a memory; with knots of T by x; with knots of Q by e."""

MEMORY_COLUMNS = COLUMNS + KNOTS

CURVE_STEPS = 100
"""Newton steps to a point of a curve; a handful do, and halving its bracket always ends."""

STRAIN_STEPS = 60
"""Newton steps to the strain of a given tension; a handful do."""


@outlined
def strain_of(T, law):
    """(eps, d eps/dT, energy per rest length) under the tension T >= 0: the law, inverted."""
    softest, low, high = 1 / law[0], 0.0, np.inf
    eps = T / law[0]
    if cable_law.linear(law):
        return eps, softest, 0.5 * T * eps
    if cable_law.stiffens(law):
        eps = min(eps, cable_law.M)  # from above, where a law that stiffens is convex
    slope, _ = cable_law.tangent(eps, 1.0, law)
    for _ in range(STRAIN_STEPS):
        slope, e = cable_law.tangent(eps, 1.0, law)
        step = e - T / slope
        if abs(step) <= 4e-16 * eps:
            break
        if step > 0:
            high = eps
        else:
            low = eps
        eps -= step
        if not low < eps < high:
            eps = 2 * low + T / law[0] if high == np.inf else 0.5 * (low + high)
    return eps, 1 / slope, cable_law.energy(eps, 1.0, law)


@outlined
def memory_spring(stretch, rope, behind, law, row):
    """(k, e, energy): the spring k max(e, 0) with the law's tension and slope at this stretch x, and ∫T dx."""
    kind, x = row[KIND], stretch - row[CREPT]
    if kind == ELASTIC:
        k, e = cable_law.tangent(x, rope + behind, law)
        return k, e, cable_law.energy(x, rope + behind, law)
    if kind == LINEAR:
        return _between_knots(x, row)
    if not x > 0:
        k, _ = cable_law.tangent(0.0, rope + behind, law)
        return k, x, 0.0
    eps, low, high = x / (rope + behind), 0.0, np.inf
    T, slope, energy = 0.0, 1.0, 0.0
    for _ in range(CURVE_STEPS):
        there, per_strain, T, slope, energy = _point(eps, rope, behind, law, row)
        missed = there - x
        if missed > 0:
            high = eps
        else:
            low = eps
        step = missed / per_strain
        if abs(step) <= 4e-16 * eps or high - low <= 2e-16 * eps:
            break
        eps -= step
        if not low < eps < high:
            eps = 2 * eps + 2 * step if high == np.inf else 0.5 * (low + high)
    return slope, T / slope, energy


@outlined
def stretch_at_exit(T, rope, behind, law, row):
    """(X, dX/dT, ∫X dT) of a cable with mass, X = x(T) − l0 eps(T), at the tension T > 0 where it leaves its exit."""
    creep, crept = row[CREEP], row[CREPT]
    if row[KIND] == LINEAR:
        n = (len(row) - KNOTS) // 3
        j = 0
        while j + 1 < n and row[KNOTS + j + 1] < np.inf and row[KNOTS + n + j + 1] <= T:
            j += 1
        k = row[KNOTS + 2 * n + j]
        x = row[KNOTS + j] + (T - row[KNOTS + n + j]) / k
        _, _, energy = _between_knots(x, row)
        return (
            x - rope * T / law[0] + crept,
            1 / k - rope / law[0],
            T * (x + crept - 0.5 * rope * T / law[0]) - energy,
        )
    delta, per_newton, work = _behind(T, behind, law, row)
    return delta + creep * T + crept, per_newton + creep, T * (delta + 0.5 * creep * T + crept) - work


@inline
def _between_knots(x, row):
    """``memory_spring`` of a law that is linear between knots."""
    T, k, energy = _on_knots(x, row)
    return (k, T / k, energy) if x > 0 else (k, x, 0.0)


@outlined
def _point(eps, rope, behind, law, row):
    """(x, dx/d eps, T, dT/dx, ∫T dx) of a nonlinear cable whose rope beyond the exit has the strain eps."""
    hard, soft = cable_law.tangent(eps, 1.0, law)
    F = hard * soft
    delta, per_newton, work = _behind(F, behind, law, row)
    e, widening = rope * eps + delta, rope + per_newton * hard
    Q, giving, given = _on_knots(e, row)
    T, rising = F - Q, hard - giving * widening
    x, per_strain = e + row[CREEP] * T, widening + row[CREEP] * rising
    energy = rope * cable_law.energy(eps, 1.0, law) + work - given + 0.5 * row[CREEP] * T * T
    return x, per_strain, T, rising / per_strain, energy


@outlined
def _behind(F, behind, law, row):
    """(delta, d delta/dF, ∫F d delta) of the rope behind the exit, at the force F of the rope beyond it."""
    held, rho = row[HELD], row[RHO]
    if np.isnan(held):
        eps, slope, energy = strain_of(F, law)
        return behind * eps, behind * slope, behind * energy
    stays = 0.0
    if held > 0:
        stays = cable_law.energy(held / behind, 1.0, law)
    eps, slope, energy = strain_of(rho * F, law)
    if behind * eps < held:
        return behind * eps, behind * rho * slope, behind / rho * energy
    eps, slope, energy = strain_of(F / rho, law)
    if behind * eps > held:
        return behind * eps, behind / rho * slope, behind * (rho * energy + (1 / rho - rho) * stays)
    return held, 0.0, behind / rho * stays


@outlined
def _on_knots(x, row):
    """What is linear between knots: its value, slope and integral."""
    n, j, energy = (len(row) - KNOTS) // 3, 0, 0.0
    while j + 1 < n and row[KNOTS + j + 1] <= x:
        part = row[KNOTS + j + 1] - row[KNOTS + j]
        energy += (row[KNOTS + n + j] + 0.5 * row[KNOTS + 2 * n + j] * part) * part
        j += 1
    part, before, slope = x - row[KNOTS + j], row[KNOTS + n + j], row[KNOTS + 2 * n + j]
    return before + slope * part, slope, energy + (before + 0.5 * slope * part) * part

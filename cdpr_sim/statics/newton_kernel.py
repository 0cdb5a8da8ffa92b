"""Newton's method on the energy for static equilibria, with tensions as unknowns of their own; compiled.

Static equilibrium (paper Eq. 3) is a stationary point of the energy of cables and weight,

    V(q) = Σ ½ kᵢ max(lᵢ(q) − l0ᵢ, 0)² + m g z_com(q) − (work of the external wrench),

and it is stable at a minimum. Plain Newton on V converges slowly when cables are stiff: V is then a narrow curved
valley, and a step along its tangent leaves the valley's floor. Four measures make the cost independent of stiffness:

1. *Tensions as unknowns.* The geometric part of the stiffness matrix uses the tensions that the last local model
   predicted, not k (l − l0), which is far off after a curved step (primal-dual Newton).
2. *The unilateral law inside the local model.* Each iteration minimises
   gᵀx + ½ xᵀ(K_geo + λ)x + Σ ½ k max(l − l0 + Jx, 0)² exactly, by a semismooth Newton iteration on the set of taut
   cables (Hintermüller, Ito, Kunisch 2002, doi:10.1137/S1052623401383558); so the step takes account of a cable that
   becomes taut on the way.
3. *Retraction.* If the energy does not fall as the model predicts, the lengths at the trial pose are measured and
   corrected to the predicted ones with the same factorisation (second-order correction; Nocedal and Wright 2006,
   section 18.3, doi:10.1007/978-0-387-40065-5), which returns the step to the valley's floor.
4. *Descent.* A step is accepted only if the true V falls; else λ grows (Levenberg-Marquardt). At a saddle the iteration
   continues along the direction of negative curvature. So it ends at a minimum: a stable equilibrium.

Cables with mass are no springs (``cable_kernel.SaggingState``): their energy is smooth even where a cable sags. It
belongs to the local model's slope and curvature, and the second-order correction is for the slope that the model
missed. The start is an argument: the equilibrium with massless cables is near, and from there a few iterations suffice.

Rotation steps are left-applied rotation vectors times the robot's characteristic length, so that all six
coordinates are lengths.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from cdpr_sim.core.cable import WEIGHT
from cdpr_sim.core.compiling import (
    HEAP,
    by_type,
    inline,
    matrix,
    nowhere,
    of_one_number,
    outlined,
    truths,
    vector,
    where,
)  # fmt: skip
from cdpr_sim.core.status import ACCEPTABLE, IDLE_STRAIN, NEUTRAL, Status
from cdpr_sim.statics import cable_kernel as ck
from cdpr_sim.statics.cable_kernel import (
    BentCables,
    BentState,
    Cables,
    CableState,
    CablesWithMemory,
    SaggingCables,
    SaggingState,
)
from cdpr_sim.statics.matrix_kernel import factorise, substitute

MAX_ITERATIONS = 1000
"""Largest number of iterations. Twelve suffice at random poses of DemoBot (``scripts/dev/measure_constants.py``);
unusual robots need many more."""

MAX_TRANSLATION = 0.5
"""Longest step, as a fraction of the mean cable length."""

LEAST_REACH = 0.1
"""Fraction of the mean rest length that replaces the cable length in that limit where anchors touch their exits."""

MAX_ROTATION = 0.7
"""Longest rotation step [rad]: beyond it the local model is inaccurate."""

FORCE_TOLERANCE = 2e-9
"""Largest unbalanced force at convergence, as a fraction of the load."""

ROUNDING = 8 * np.finfo(float).eps
"""Relative error of a computed length, a few units in the last place: no pose can have a smaller residual. Where
two units are more than ``ACCEPTABLE`` of the load, no pose counts as balanced."""

ENERGY_ROUNDING = 4 * np.finfo(float).eps
"""Relative error of a computed energy: highly tensioned cables store more energy than the load ever changes."""

LARGEST_RESIDUAL = 5e-7
"""Unbalanced force that is tolerated for large loads on cables with mass [N]: ``FORCE_TOLERANCE`` of 250 N."""

POLISHED = 0.01
"""Fraction of the tolerated unbalanced force above which one more step is taken with cables with mass."""

NEARLY_TAUT = 0.5
"""Fraction of the load: a cable counts as taut at the start if a spring that pulls and pushes would push by no more.
With rigid lengths every cable starts exactly at its rest length, and rounding must not decide which of them count."""

MAX_TRIALS = 60
"""Largest number of step lengths tried, each shorter than the last, before the iteration stops."""

SUFFICIENT, LEAST_DECREASE = 0.3, 0.05
"""A step is accepted if the energy falls by this fraction of the decrease that the model predicts; after the last
retraction by the second."""

MAX_RETRACTIONS = 2
"""Largest number of retractions of one step."""

TRUSTED = 0.5
"""If the energy falls by more than this fraction of the predicted decrease, the shift is lowered."""

MAX_TAUT_SETS = 6
"""Largest number of sets of taut cables tried within one local model; two or three suffice, unless they cycle."""

_CONVERGED, _ITERATION_LIMIT = int(Status.CONVERGED), int(Status.ITERATION_LIMIT)
_STALLED, _NOT_FINITE, _OFF_WHEEL = int(Status.STALLED), int(Status.NOT_FINITE), int(Status.OFF_WHEEL)


class Case(NamedTuple):
    """Data of one problem. free: 1 where the platform moves; scale: length of rotations."""

    cables: Cables | BentCables | SaggingCables | CablesWithMemory
    weight: float
    com: np.ndarray
    wrench: np.ndarray
    free: np.ndarray
    scale: float


class Point(NamedTuple):
    """A pose, and the cables' state there."""

    p: np.ndarray
    R: np.ndarray
    c: CableState | BentState | SaggingState


class Model(NamedTuple):
    """The local model at a point: springs' lengths l + Jx, slope g and curvature K − Σ q J Jᵀ of all else.

    L: factors of a matrix; rhs: right-hand side of an equation.
    """

    J: np.ndarray
    q: np.ndarray
    g: np.ndarray
    K: np.ndarray
    L: np.ndarray
    rhs: np.ndarray


@inline
def new_model(room, springs):
    """A model that is to be filled in."""
    return Model(
        matrix(room, springs, 6), vector(room, springs), vector(room, 6), matrix(room, 6, 6), matrix(room, 6, 6),
        vector(room, 6),
    )  # fmt: skip


class Scales(NamedTuple):
    """Scales of forces and positions; thresholds below which shift, unbalanced forces and energies count as zero."""

    load: float
    size: float
    least_shift: float
    force: float
    energy: float


def descent(new_cables: Callable) -> Callable:
    """The solver of one problem, for cables of the type that ``new_cables`` makes."""

    def descend(
        table, rest_lengths, weight, center_of_mass, wrench, free, scale, start_position, start_rotation, position,
        rotation, lengths, tensions, residual, iterations, status,
    ):  # fmt: skip
        """Newton iterations from a pose; there are few arrays, since creating one is slow."""
        m, cables = len(rest_lengths), new_cables(HEAP, table)
        ck.load(cables, table, rest_lengths, ())
        case = Case(cables, weight, center_of_mass, wrench, free, scale)
        here, trial = new_point(HEAP, cables), new_point(HEAP, cables)
        springs = len(here.c.e)
        model = new_model(HEAP, springs)
        x, predicted = vector(HEAP, 6), vector(HEAP, max(m, 6))
        taut, tau = truths(HEAP, springs), vector(HEAP, springs)

        copy_pose(start_position, start_rotation, (), here.p, here.R, ())
        V = measure(case, here)
        scales = scales_of(case, here)
        first_tensions(case, here, scales.load, tau, taut)
        unbalanced, iterations[0], status[0] = np.nan, MAX_ITERATIONS, _ITERATION_LIMIT
        if not math.isfinite(V + scales.force):
            iterations[0], status[0] = 0, _NOT_FINITE
        shift, certified = 0.0, False
        least_reach = LEAST_REACH * ck.mean(cables.l0)
        for iteration in range(iterations[0]):
            unbalanced = fill_slopes(case, here, model)
            if unbalanced <= scales.force:
                if not certified:
                    spring_tensions(here, tau, taut)
                    fill_curvature(case, here, tau, model)
                if certified or is_minimum(here, model) or not _leave_saddle(case, here, model, V, trial):
                    iterations[0], status[0] = iteration, _CONVERGED
                    break
                here, trial = trial, here
                V = _energy(case, here)
                spring_tensions(here, tau, taut)
                shift = 0.0
                continue
            fill_curvature(case, here, tau, model)
            accepted, decrease, V_trial = False, 0.0, V
            longest = MAX_TRANSLATION * max(ck.mean(here.c.l), least_reach)
            # Written inside this function, which is faster: only here the compiler can tell that arrays do not overlap.
            for _ in range(MAX_TRIALS):
                decrease = -np.inf
                if _model_minimum(here, model, shift, taut, x):
                    shorten(x, longest, MAX_ROTATION * case.scale)
                    decrease = model_decrease(here.c, model, x, predicted)
                # A step that changes the energy by no more than its rounding is judged by the forces, in the next
                # iteration.
                rounding = abs(decrease) <= energy_noise(here.c, scales, V)
                if decrease > 0 or rounding:
                    for attempt in range(MAX_RETRACTIONS + 1):
                        V_trial = _measure_at(case, here, x, trial)
                        if rounding or V - V_trial >= SUFFICIENT * decrease or attempt == MAX_RETRACTIONS:
                            break
                        _retract(trial.c, case, trial, model, predicted, x)
                    if V - V_trial >= LEAST_DECREASE * decrease or (rounding and V_trial == V_trial):
                        accepted = True
                        break
                shift = larger_shift(shift, scales)
                for i in range(springs):
                    taut[i] = tau[i] > 0
            if not accepted:
                iterations[0], status[0] = iteration, _STALLED
                break
            # Where forces balance next, the model of this step had a minimum...
            certified = shift == 0.0 and springs > 0
            if V - V_trial > TRUSTED * decrease:
                shift = smaller_shift(shift, scales)
            for i in range(springs):
                tau[i] = here.c.k[i] * max(predicted[i], 0.0)
            here, trial = trial, here
            V = _energy(case, here)
            for i in range(springs):
                certified &= taut[i] == (here.c.e[i] > 0)  # ...with the cables that are actually taut
                taut[i] = predicted[i] > 0
        if status[0] == _CONVERGED:
            left = _polish(here.c, case, here, model, scales, unbalanced, x, trial)
            iterations[0] += left < unbalanced
            unbalanced = left
        if not ck.on_wheels(here.c):
            status[0] = _OFF_WHEEL
        residual[0] = unbalanced
        copy_pose(here.p, here.R, (), position, rotation, ())
        for i in range(m):
            lengths[i] = here.c.l[i]
        ck.fill_tensions(cables, here.c, table, tensions)

    return descend


@inline
def scales_of(case, start):
    """Scales and thresholds of a problem whose start has been measured."""
    A, k, l0 = case.cables.A, case.cables.k, case.cables.l0
    stiffest, stiffness, size = ck.largest(k), 0.0, ck.largest(start.p)
    for i in range(len(A)):
        stiffness += k[i] * l0[i] / len(A)
        for a in range(3):
            size = max(size, abs(A[i, a]))
    load = _load(case, stiffness)
    most, hanging, softer, margin = _tolerances(case.cables)
    return Scales(
        load,
        size,
        softer * max(load, 1e-9 * stiffest * case.scale) / ck.mean(l0),
        min(
            min(FORCE_TOLERANCE * load, most) + ROUNDING * (stiffest * size + hanging),
            ACCEPTABLE * load - margin * ROUNDING * stiffest * size,
        ),
        1e-13 * load * case.scale,
    )


@by_type
def _tolerances(cables):
    """Largest unbalanced force, the cables' own weight, the least shift as a fraction of that of springs, and a margin.

    Slack cables hold the platform by little more than their weight. The margin is the rounding of forces that are
    computed anew from the pose, which of springs is that of their lengths.
    """
    return np.inf, 0.0, 1.0, 0.25


@_tolerances.of(SaggingCables)
def _sagging_tolerances(cables):
    hanging = 0.0
    for i in range(len(cables.l0)):
        hanging += cables.table[i, WEIGHT] * cables.l0[i]
    return LARGEST_RESIDUAL, hanging, 1e-6, 0.0


@by_type
def energy_noise(c, scales, V):
    """Rounding of the energy V."""
    return max(scales.energy, ENERGY_ROUNDING * abs(V))


@energy_noise.of(SaggingState)
def _sagging_energy_noise(c, scales, V):
    noise = 1e13 * scales.energy
    for i in range(len(c.tension)):
        noise += c.tension[i] * scales.size
    return ROUNDING * noise


@inline
def larger_shift(shift, scales):
    """λ after a step that was rejected."""
    return max(4 * shift, scales.least_shift)


@inline
def smaller_shift(shift, scales):
    """λ after a step that can be trusted."""
    return where(shift > scales.least_shift / 64, shift / 8, 0.0)


@inline
def _load(case, stiffness):
    """Scale of forces: weight or external wrench; without both, the force that strains this axial stiffness."""
    load = case.weight
    for a in range(6):
        load = max(load, abs(case.wrench[a]) / (1.0 if a < 3 else case.scale))
    return where(load != 0.0, load, IDLE_STRAIN * stiffness)


@inline
def first_tensions(case, at, load, tau, taut):
    """Tensions as if the platform moved straight down on all cables that pull up."""
    k, u, e = at.c.k, at.c.u, at.c.e
    upward = 0.0
    for i in range(len(tau)):
        pull = max(u[i, 2], 0.0)
        upward += k[i] * (pull * pull)
    for i in range(len(tau)):
        held = k[i] * max(u[i, 2], 0.0) * case.weight / where(upward > 0, upward, 1.0)
        tau[i] = where(upward > 0, held, 0.0)
        taut[i] = k[i] * e[i] >= -NEARLY_TAUT * load


@inline
def spring_tensions(at, tau, taut):
    """Tensions of the cables at their present stretch (paper Eq. 10, 11)."""
    for i in range(len(tau)):
        tau[i] = at.c.k[i] * max(at.c.e[i], 0.0)
        taut[i] = at.c.e[i] > 0


@inline
def new_point(room, cables):
    """A point that is to be measured."""
    return Point(vector(room, 3), matrix(room, 3, 3), ck.new_state(cables, room))


@inline
def copy_pose(p, R, lane, to_p, to_R, to_lane):
    """Copy a position and a rotation matrix: on lanes, those of the lane (w,); otherwise (), all."""
    for a in range(3):
        to_p[(a, *to_lane)] = p[(a, *lane)]
        for b in range(3):
            to_R[(a, b, *to_lane)] = R[(a, b, *lane)]


@inline
def measure(case, at):
    """Fill in the cables' state at ``at.p``, ``at.R``; return V."""
    ck.measure(case.cables, at.p, at.R, at.c)
    return _energy(case, at)


@inline
def _energy(case, at):
    """V without the work of the external torque, which depends on the path and is accumulated step by step."""
    weight, com, wrench = case.weight, case.com, case.wrench
    p, R = at.p, at.R
    V = weight * (p[2] + R[2, 0] * com[0] + R[2, 1] * com[1] + R[2, 2] * com[2])
    for a in range(3):
        V -= wrench[a] * p[a]
    return ck.elastic_energy(case.cables, at.c, V)


@inline
def _measure_at(case, here, x, trial):
    """Measure the pose after the step x; return V there, less the work of the external torque on the way."""
    work = move(case, here, x, trial)
    return measure(case, trial) - work


@inline
def move(case, here, x, trial):
    """Fill in the pose after the step x; return the work of the external torque on the way."""
    wrench, scale = case.wrench, case.scale
    p_here, R_here = here.p, here.R
    p_trial, R_trial = trial.p, trial.R
    for a in range(3):
        p_trial[a] = p_here[a] + x[a]
    _rotate(R_here, x[3] / scale, x[4] / scale, x[5] / scale, R_trial)
    return (wrench[3] * x[3] + wrench[4] * x[4] + wrench[5] * x[5]) / scale


@of_one_number
def turn(angle2):
    """sin(angle)/angle and (1 − cos(angle))/angle², by the angle's square."""
    angle = math.sqrt(angle2)
    if angle > 1e-4:
        return math.sin(angle) / angle, (1 - math.cos(angle)) / angle2
    return 1 - angle2 / 6, 0.5 - angle2 / 24


@inline
def _rotate(R, a, b, c, out):
    """out = exp([a b c]×) R, by Rodrigues' formula."""
    angle2 = a * a + b * b + c * c
    sine, versine = turn(angle2)
    for j in range(3):
        x, y, z = R[0, j], R[1, j], R[2, j]
        along = a * x + b * y + c * z
        out[0, j] = x + sine * (b * z - c * y) + versine * (a * along - angle2 * x)
        out[1, j] = y + sine * (c * x - a * z) + versine * (b * along - angle2 * y)
        out[2, j] = z + sine * (a * y - b * x) + versine * (c * along - angle2 * z)


@inline
def fill_slopes(case, at, model):
    """Fill in J = ∂l/∂x and the load's slope g; return the largest unbalanced force."""
    weight, com, wrench, free, scale = case.weight, case.com, case.wrench, case.free, case.scale
    R, k, e = at.R, at.c.k, at.c.e
    J, g = model.J, model.g
    ck.fill_jacobian(at.c, scale, J)
    g[0], g[1], g[2] = -wrench[0], -wrench[1], weight - wrench[2]
    g[3] = (weight * (R[1, 0] * com[0] + R[1, 1] * com[1] + R[1, 2] * com[2]) - wrench[3]) / scale
    g[4] = (-weight * (R[0, 0] * com[0] + R[0, 1] * com[1] + R[0, 2] * com[2]) - wrench[4]) / scale
    g[5] = -wrench[5] / scale
    ck.subtract_pulls(at.c, scale, g)
    residual = 0.0
    for a in range(6):
        if free[a] == 0.0:
            g[a] = 0.0
            for i in range(len(k)):
                J[i, a] = 0.0
            continue
        force = g[a]
        for i in range(len(k)):
            if nowhere(e[i] > 0):
                continue
            force += where(e[i] > 0, k[i] * e[i], 0.0) * J[i, a]
        residual = where((abs(force) > residual) | (force != force), abs(force), residual)  # nan is no balance
    return residual


@inline
def fill_curvature(case, at, tau, model):
    """Fill in q and the lower half of K: Σ tau ∂²l/∂x² + q J Jᵀ and the weight's part.

    For rotation vectors applied on the left.
    """
    weight, free, scale = case.weight, case.free, case.scale
    q, K = model.q, model.K
    per_scale = 1 / scale
    for a in range(6):
        for b in range(a + 1):
            K[a, b] = 0.0
    ck.add_weight_curvature(weight, case.com, at.R, scale, K)
    for i in range(len(tau)):
        q[i] = 0.0
        if nowhere(tau[i] > 0):
            continue
        q[i] = ck.add_curvature(at.c, i, tau[i], per_scale, K)
    ck.add_stiffness(at.c, scale, K)
    for a in range(6):
        if free[a] == 0.0:
            for b in range(6):
                K[max(a, b), min(a, b)] = 0.0
            K[a, a] = weight / scale + 1.0  # any positive number: this component of the step is 0


@inline
def _model_minimum(at, model, shift, taut, x):
    """Minimise gᵀx + ½ xᵀ(K + shift)x + Σ ½ k max(s + Jx, 0)², starting from the set ``taut``, which is updated.

    False where the quadratic form of some taut set on the way is not positive definite, or where the sets cycle.
    """
    for _ in range(MAX_TAUT_SETS):
        fill_system(at, model, shift, taut)
        if not factorise(model.L, 6):
            return False
        substitute(model.L, model.rhs, x)
        if not update_taut(at, model, x, taut):
            return True
    return False


@inline
def fill_system(at, model, shift, taut):
    """Fill in the lower half of the equation L x = rhs of the minimum if exactly the cables ``taut`` were springs."""
    k, e = at.c.k, at.c.e
    J, g, K, L, rhs = model.J, model.g, model.K, model.L, model.rhs
    for a in range(6):
        rhs[a] = -g[a]
        for b in range(a + 1):
            L[a, b] = K[a, b]
        L[a, a] += shift
    for i in range(len(k)):
        stiffness = where(taut[i], k[i], 0.0)
        pull = stiffness * e[i]
        for a in range(6):
            rhs[a] -= pull * J[i, a]
        ck.add_along(stiffness - model.q[i], J, i, L)


@inline
def update_taut(at, model, x, taut):
    """Set ``taut`` to the cables that are stretched at x in the model; return whether that changed it."""
    changed = False
    for i in range(len(taut)):
        stretch = at.c.e[i]
        for a in range(6):
            stretch += model.J[i, a] * x[a]
        now = stretch > 0
        changed |= now != taut[i]
        taut[i] = now
    return changed


@inline
def shorten(x, longest, largest):
    """Scale x back to a translation of ``longest`` and a rotation of ``largest`` at most."""
    translation = math.sqrt(x[0] * x[0] + x[1] * x[1] + x[2] * x[2])
    rotation = math.sqrt(x[3] * x[3] + x[4] * x[4] + x[5] * x[5])
    factor = max(translation / longest, rotation / largest)
    if nowhere(factor > 1):
        return
    for a in range(6):
        x[a] /= where(factor > 1, factor, 1.0)


@by_type
def model_decrease(c, model, x, predicted):
    """Decrease of the unshifted model along x; fill in the stretches that it predicts."""
    k, e = c.k, c.e
    J, g, K = model.J, model.g, model.K
    decrease = 0.0
    for a in range(6):
        slope = g[a] + 0.5 * K[a, a] * x[a]
        for b in range(a):
            slope += K[a, b] * x[b]
        decrease -= slope * x[a]
    for i in range(len(k)):
        along = 0.0
        for a in range(6):
            along += J[i, a] * x[a]
        predicted[i] = e[i] + along
        before, after = max(e[i], 0.0), max(predicted[i], 0.0)
        decrease += 0.5 * (k[i] * (before * before - after * after) + model.q[i] * along * along)
    return decrease


@model_decrease.of(SaggingState)
def _sagging_decrease(c, model, x, predicted):
    """The same without springs; fill in the slope that the model predicts."""
    decrease = 0.0
    for a in range(6):
        bent = 0.0
        for b in range(6):
            bent += model.K[max(a, b), min(a, b)] * x[b]
        decrease -= (model.g[a] + 0.5 * bent) * x[a]
        predicted[a] = model.g[a] + bent
    return decrease


@by_type
def _retract(c, case, trial, model, predicted, x):
    """Correct x so that the taut cables get the stretch that the model predicts for them."""
    rhs = model.rhs
    fill_correction(c, model, predicted, rhs)
    substitute(model.L, rhs, rhs)
    for a in range(6):
        x[a] += rhs[a]


@inline
def fill_correction(c, model, predicted, rhs):
    """Fill in the right-hand side for the correction by which springs get the stretch ``predicted``."""
    k, e, J = c.k, c.e, model.J
    for a in range(6):
        rhs[a] = 0.0
        for i in range(len(k)):
            rhs[a] -= k[i] * (max(e[i], 0.0) - max(predicted[i], 0.0)) * J[i, a]


@_retract.of(SaggingState)
def _retract_sagging(c, case, trial, model, predicted, x):
    """Correct x so that the slope becomes what the model predicts."""
    rhs = model.rhs
    fill_slopes(case, trial, Model(model.J, model.q, rhs, model.K, model.L, rhs))
    for a in range(6):
        rhs[a] = predicted[a] - rhs[a]
    substitute(model.L, rhs, rhs)
    for a in range(6):
        x[a] += rhs[a]


@by_type
def _polish(c, case, here, model, scales, unbalanced, x, trial):
    """One more Newton step from a minimum, where it balances the forces better; return what remains unbalanced."""
    return unbalanced


@_polish.of(SaggingState)
@outlined
def _polish_sagging(c, case, here, model, scales, unbalanced, x, trial):
    if unbalanced <= POLISHED * scales.force or not is_minimum(here, model):
        return unbalanced
    for a in range(6):
        x[a] = -model.g[a]
    substitute(model.L, x, x)
    V = _measure_at(case, here, x, trial)
    left = fill_slopes(case, trial, model)
    if not (V == V and left < unbalanced):  # nan where a cable has no path
        return unbalanced
    copy_pose(trial.p, trial.R, (), here.p, here.R, ())
    measure(case, here)
    return left


@inline
def is_minimum(at, model):
    """Whether the stiffness matrix with the cables that are taut at the point itself is positive definite."""
    K, L = model.K, model.L
    for a in range(6):
        for b in range(a + 1):
            L[a, b] = K[a, b]
    ck.add_springs(at.c, model.q, model.J, L)
    return factorise(L, 6)


@outlined
def _leave_saddle(case, here, model, V, trial):
    """Step to a lower point along the direction of most negative curvature; False where there is none."""
    H = np.empty((6, 6))
    for a in range(6):
        for b in range(a + 1):
            H[a, b] = model.K[a, b]
    ck.add_springs(here.c, model.q, model.J, H)
    for a in range(6):
        for b in range(a):
            H[b, a] = H[a, b]
    if not math.isfinite(np.abs(H).sum()):  # nothing is known of the saddle, and NumPy would raise an error
        return False
    eigenvalues, directions = np.linalg.eigh(H)
    if eigenvalues[0] >= -NEUTRAL * ck.largest(eigenvalues):
        return False
    x, length, first, largest = np.empty(6), MAX_ROTATION * case.scale, 0, ck.largest(directions[:, 0])
    while abs(directions[first, 0]) < 0.5 * largest:
        first += 1
    if directions[first, 0] < 0.0:  # the sign is the BLAS's: every machine is to try the same side first
        length = -length
    for _ in range(40):
        for sign in range(2):
            for a in range(6):
                x[a] = directions[a, 0] * (length if sign == 0 else -length)
            if _measure_at(case, here, x, trial) < V:
                return True
        length *= 0.5
    return False

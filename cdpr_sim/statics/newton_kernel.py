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

Cables with mass are no springs (SAGGING, ``cable_kernel``): their energy is smooth even where a cable sags. It belongs
to the local model's slope and curvature, and the second-order correction is for the slope that the model missed. The
search starts at the equilibrium with massless cables, which is near: from there a few iterations suffice.

Rotation steps are left-applied rotation vectors times the robot's characteristic length, so that all six
coordinates are lengths.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from cdpr_sim.core.cable import WEIGHT
from cdpr_sim.core.compiling import STRIDE, inline, lent, outlined
from cdpr_sim.core.status import ACCEPTABLE, IDLE_STRAIN, NEUTRAL, Status
from cdpr_sim.statics import cable_kernel as ck
from cdpr_sim.statics.cable_kernel import L0, PREDICTED, PULL, SAGGING, STIFF, TAU, TAUT, WEIGHTS, E, J, K, L, Q
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


SERIES = 1.0
"""[rad²] Square of the largest angle whose sine and cosine are summed as series."""


class Case(NamedTuple):
    """Data of one problem.

    d: of its cables, rows of ``cable_kernel``; table: that of ``Robot.cable_table``; kind: of cables; free: 1 where the
    platform moves; scale: length of rotations.
    """

    d: np.ndarray
    table: np.ndarray
    kind: int
    weight: float
    com: np.ndarray
    wrench: np.ndarray
    free: np.ndarray
    scale: float


class Point(NamedTuple):
    """A pose, and the cables' state there."""

    p: np.ndarray
    R: np.ndarray
    s: np.ndarray


class Model(NamedTuple):
    """The local model at a point: springs' lengths l + Jx, slope g and curvature H − Σ q J Jᵀ of all else.

    w: rows of ``cable_kernel``; A: factors of a matrix; rhs: right-hand side of an equation; x: step.
    """

    w: np.ndarray
    g: np.ndarray
    H: np.ndarray
    A: np.ndarray
    rhs: np.ndarray
    x: np.ndarray


class Scales(NamedTuple):
    """Scales of forces and positions; thresholds below which shift, unbalanced forces and energies count as zero."""

    load: float
    size: float
    least_shift: float
    force: float
    energy: float


def solve_all(
    table, rest_lengths, weight, center_of_mass, wrench, free, scale, heavy, start_position, start_rotation, scratch,
    position, rotation, lengths, tensions, residual, iterations, status,
):  # fmt: skip
    """Equilibria of (rows, columns) of problems, one after another; the arguments are those of ``gufuncs``."""
    rows, columns, m = rest_lengths.shape
    d, here, trial, model, _ = memory(scratch)
    w, x = model.w, model.x
    kind, one_robot = ck.PLAIN, table.strides[0] == 0 and table.strides[1] == 0
    for i in range(rows):
        for j in range(columns):
            if i + j == 0 or not one_robot:
                kind = ck.load_table(d, lent(table[i, j]))
            ck.load_lengths(d, rest_lengths[i, j])
            copy_pose(start_position[i, j], start_rotation[i, j], position[i, j], rotation[i, j])
            iterations[i, j] = 0
            for stage in range(1 + heavy):
                case = Case(
                    d, lent(table[i, j]), SAGGING if stage == 1 else kind, weight[i, j], lent(center_of_mass[i, j]),
                    lent(wrench[i, j]), lent(free), scale[i, j],
                )  # fmt: skip
                copy_pose(position[i, j], rotation[i, j], here.p, here.R)
                V = measure(case, here)
                scales = scales_of(case, here)
                first_tensions(case, here, scales.load, w)
                unbalanced, most, ended = np.nan, MAX_ITERATIONS, _ITERATION_LIMIT
                if not math.isfinite(V + scales.force):
                    most, ended = 0, _NOT_FINITE
                steps, shift, certified = most, 0.0, False
                least_reach = LEAST_REACH * ck.mean(case.d, L0, m)
                for iteration in range(most):
                    unbalanced = fill_slopes(case, here, model)
                    balanced = unbalanced <= scales.force
                    if balanced and certified:
                        steps, ended = iteration, _CONVERGED
                        break
                    if balanced:
                        spring_tensions(here, m, w)
                    fill_curvature(case, here, model)
                    if balanced:
                        lower = np.nan if is_minimum(case, here, model) else _leave_saddle(case, here, model, V, trial)
                        if lower != lower:
                            steps, ended = iteration, _CONVERGED
                            break
                        here, trial, V, shift = trial, here, lower, 0.0
                        spring_tensions(here, m, w)
                        continue
                    accepted, decrease, fall, V_trial = False, 0.0, 0.0, V
                    longest = MAX_TRANSLATION * max(ck.mean(here.s, L, m), least_reach)
                    for _ in range(MAX_TRIALS):
                        decrease = -np.inf
                        if _model_minimum(here, model, shift, m):
                            shorten(x, longest, MAX_ROTATION * case.scale)
                            decrease = model_decrease(case, here, model)
                        # A step that changes the energy by no more than its rounding is judged by the forces, in the
                        # next iteration.
                        rounding = abs(decrease) <= energy_noise(case, here, scales, V)
                        if decrease > 0 or rounding:
                            for attempt in range(MAX_RETRACTIONS + 1):
                                work = move(case, here, x, trial)
                                V_trial = measure(case, trial)
                                fall = V - (V_trial - work)
                                if rounding or fall >= SUFFICIENT * decrease or attempt == MAX_RETRACTIONS:
                                    break
                                _retract(case, trial, model)
                            if fall >= LEAST_DECREASE * decrease or (rounding and V_trial == V_trial):
                                accepted = True
                                break
                        shift = larger_shift(shift, scales)
                        for k in range(m):
                            w[TAUT + k] = 1.0 if w[TAU + k] > 0 else 0.0
                    if not accepted:
                        steps, ended = iteration, _STALLED
                        break
                    # Where forces balance next, the model of this step had a minimum with the cables that are actually
                    # taut.
                    as_predicted = keep_predictions(here, trial, m, w)
                    certified = as_predicted and shift == 0.0 and case.kind != SAGGING
                    if fall > TRUSTED * decrease:
                        shift = smaller_shift(shift, scales)
                    here, trial, V = trial, here, V_trial
                rough = case.kind == SAGGING and unbalanced > POLISHED * scales.force
                if ended == _CONVERGED and rough and is_minimum(case, here, model):
                    left = _polish(case, here, trial, model)
                    if left < unbalanced:
                        here, trial, unbalanced = trial, here, left
                        steps += 1
                if not ck.on_wheels(case.kind, here.s, m):
                    ended = _OFF_WHEEL
                copy_pose(here.p, here.R, position[i, j], rotation[i, j])
                for k in range(m):
                    lengths[i, j, k], tensions[i, j, k] = here.s[L + k], ck.tension(case.kind, here.s, k)
                residual[i, j], status[i, j] = unbalanced, ended
                iterations[i, j] += steps


@inline
def keep_predictions(here, trial, m, w):
    """Let the predicted tensions be those of the next model; return whether the taut cables are those of the trial."""
    changed = 0.0
    for i in range(m):
        changed += abs(w[TAUT + i] - (1.0 if trial.s[E + i] > 0 else 0.0))
        w[TAU + i] = here.s[K + i] * max(w[PREDICTED + i], 0.0)
        w[TAUT + i] = 1.0 if w[PREDICTED + i] > 0 else 0.0
    return changed == 0.0


@inline
def memory(scratch):
    """Data of cables, two points and a model in a scratch array; the number of the first row that is left."""
    scratch = lent(scratch)
    first, second, model = ck.DATA_ROWS, ck.DATA_ROWS + ck.STATE_ROWS, ck.DATA_ROWS + 2 * ck.STATE_ROWS
    small = model + ck.MODEL_ROWS
    return (
        rows_of(scratch, 0, first),
        Point(vector(scratch, small, 0, 3), matrix(scratch, small, 3, 3), rows_of(scratch, first, second)),
        Point(vector(scratch, small, 12, 3), matrix(scratch, small, 15, 3), rows_of(scratch, second, model)),
        Model(
            rows_of(scratch, model, small), vector(scratch, small, 24, 6), matrix(scratch, small, 30, 6),
            matrix(scratch, small, 66, 6), vector(scratch, small, 102, 6), vector(scratch, small, 108, 6),
        ),
        small + 1,
    )  # fmt: skip


@inline
def rows_of(scratch, first, end):
    """Rows of a scratch array."""
    return scratch[first * STRIDE : end * STRIDE]


@inline
def vector(scratch, row, at, n):
    """Memory of n numbers in a row of a scratch array."""
    return scratch[row * STRIDE + at : row * STRIDE + at + n]


@inline
def matrix(scratch, row, at, n):
    """Memory of n times n numbers in a row of a scratch array."""
    return vector(scratch, row, at, n * n).reshape((n, n))


@inline
def scales_of(case, start):
    """Scales and thresholds of a problem whose start has been measured."""
    d, m = case.d, len(case.table)
    stiffest, stiffness, hanging = ck.largest(d, STIFF, m), 0.0, 0.0
    size = max(ck.largest(start.p, 0, 3), d[ck.SIZE])
    for i in range(m):
        stiffness += d[STIFF + i] * d[L0 + i] / m
    load = _load(case, stiffness)
    # Slack cables with mass hold the platform by little more than their weight, so least shifts are smaller. The margin
    # is the rounding of forces that are computed anew from the pose, which of springs is that of their lengths.
    most, softer, margin = np.inf, 1.0, 0.25
    if case.kind == SAGGING:
        most, softer, margin = LARGEST_RESIDUAL, 1e-6, 0.0
        for i in range(m):
            hanging += case.table[i, WEIGHT] * d[L0 + i]
    return Scales(
        load,
        size,
        softer * max(load, 1e-9 * stiffest * case.scale) / ck.mean(d, L0, m),
        min(
            min(FORCE_TOLERANCE * load, most) + ROUNDING * (stiffest * size + hanging),
            ACCEPTABLE * load - margin * ROUNDING * stiffest * size,
        ),
        1e-13 * load * case.scale,
    )


@inline
def energy_noise(case, at, scales, V):
    """Rounding of the energy V."""
    if case.kind != SAGGING:
        return max(scales.energy, ENERGY_ROUNDING * abs(V))
    noise = 1e13 * scales.energy
    for i in range(len(case.table)):
        noise += at.s[ck.TENSION + i] * scales.size
    return ROUNDING * noise


@inline
def larger_shift(shift, scales):
    """λ after a step that was rejected."""
    return max(4 * shift, scales.least_shift)


@inline
def smaller_shift(shift, scales):
    """λ after a step that can be trusted."""
    return shift / 8 if shift > scales.least_shift / 64 else 0.0


@inline
def _load(case, stiffness):
    """Scale of forces: weight or external wrench; without both, the force that strains this axial stiffness."""
    load = case.weight
    for a in range(6):
        load = max(load, abs(case.wrench[a]) / (1.0 if a < 3 else case.scale))
    return load if load != 0.0 else IDLE_STRAIN * stiffness


@inline
def first_tensions(case, at, load, w):
    """Tensions as if the platform moved straight down on all cables that pull up."""
    s, m = at.s, len(case.table)
    upward = 0.0
    for i in range(m):
        pull = max(s[ck.UZ + i], 0.0)
        upward += s[K + i] * (pull * pull)
    each = case.weight / upward if upward > 0 else 0.0
    for i in range(m):
        w[TAU + i] = s[K + i] * max(s[ck.UZ + i], 0.0) * each
        w[TAUT + i] = 1.0 if s[K + i] * s[E + i] >= -NEARLY_TAUT * load else 0.0


@inline
def spring_tensions(at, m, w):
    """Tensions of the cables at their present stretch (paper Eq. 10, 11)."""
    s = at.s
    for i in range(m):
        w[TAU + i] = s[K + i] * max(s[E + i], 0.0)
        w[TAUT + i] = 1.0 if s[E + i] > 0 else 0.0


@inline
def copy_pose(p, R, to_p, to_R):
    """Copy a position and a rotation matrix."""
    for a in range(3):
        to_p[a] = p[a]
        for b in range(3):
            to_R[a, b] = R[a, b]


@outlined
def measure(case, at):
    """Fill in the cables' state at ``at.p``, ``at.R``; return V.

    Without the work of the external torque, which depends on the path and is accumulated step by step.
    """
    weight, com, wrench = case.weight, case.com, case.wrench
    p, R = at.p, at.R
    ck.measure(case.d, case.table, case.kind, p, R, at.s)
    V = weight * (p[2] + R[2, 0] * com[0] + R[2, 1] * com[1] + R[2, 2] * com[2])
    V -= wrench[0] * p[0] + wrench[1] * p[1] + wrench[2] * p[2]
    return V + ck.energy(case.d, case.table, case.kind, at.s)


@inline
def move(case, here, x, trial):
    """Fill in the pose after the step x; return the work of the external torque on the way."""
    wrench, scale = case.wrench, case.scale
    for a in range(3):
        trial.p[a] = here.p[a] + x[a]
    _rotate(here.R, x[3] / scale, x[4] / scale, x[5] / scale, trial.R)
    return (wrench[3] * x[3] + wrench[4] * x[4] + wrench[5] * x[5]) / scale


@inline
def turn(angle2):
    """sin(angle)/angle and (1 − cos(angle))/angle², by the angle's square."""
    if angle2 <= SERIES:
        sine = 1 - angle2 / 210 * (1 - angle2 / 272 * (1 - angle2 / 342))
        sine = 1 - angle2 / 6 * (1 - angle2 / 20 * (1 - angle2 / 42 * (1 - angle2 / 72 * (1 - angle2 / 110 * (
            1 - angle2 / 156 * sine)))))  # fmt: skip
        versine = 1 - angle2 / 240 * (1 - angle2 / 306 * (1 - angle2 / 380))
        versine = 0.5 * (1 - angle2 / 12 * (1 - angle2 / 30 * (1 - angle2 / 56 * (1 - angle2 / 90 * (
            1 - angle2 / 132 * (1 - angle2 / 182 * versine))))))  # fmt: skip
        return sine, versine
    angle = math.sqrt(angle2)
    return math.sin(angle) / angle, (1 - math.cos(angle)) / angle2


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
    R, s, m = at.R, at.s, len(case.table)
    w, g, total = model.w, model.g, model.rhs
    if case.kind != SAGGING:
        ck.fill_jacobian(s, scale, m, w)
    g[0], g[1], g[2] = -wrench[0], -wrench[1], weight - wrench[2]
    g[3] = (weight * (R[1, 0] * com[0] + R[1, 1] * com[1] + R[1, 2] * com[2]) - wrench[3]) / scale
    g[4] = (-weight * (R[0, 0] * com[0] + R[0, 1] * com[1] + R[0, 2] * com[2]) - wrench[4]) / scale
    g[5] = -wrench[5] / scale
    if case.kind == SAGGING:
        ck.subtract_pulls(s, scale, m, g)
    for a in range(6):
        if free[a] == 0.0:
            g[a] = 0.0
        if free[a] == 0.0 or case.kind == SAGGING:
            for i in range(m):
                w[J + a * STRIDE + i] = 0.0
        total[a] = g[a]
    for i in range(m):
        w[PULL + i] = s[K + i] * max(s[E + i], 0.0)
    ck.add_forces(w, PULL, m, total)
    return ck.largest(total, 0, 6)


@inline
def fill_curvature(case, at, model):
    """Fill in q and the lower half of H: Σ tau ∂²l/∂x² + q J Jᵀ and the weight's part.

    For rotation vectors applied on the left.
    """
    weight, free, scale, H = case.weight, case.free, case.scale, model.H
    for a in range(6):
        for b in range(6):
            H[a, b] = 0.0
    ck.add_weight_curvature(weight, case.com, at.R, scale, H)
    ck.add_curvature(case.kind, at.s, scale, len(case.table), model.w, H)
    for a in range(6):
        if free[a] == 0.0:
            for b in range(6):
                H[max(a, b), min(a, b)] = 0.0
            H[a, a] = weight / scale + 1.0  # any positive number: this component of the step is 0


@inline
def _model_minimum(at, model, shift, m):
    """Minimise gᵀx + ½ xᵀ(H + shift)x + Σ ½ k max(s + Jx, 0)², starting from the taut set, which is updated.

    False where the quadratic form of some taut set on the way is not positive definite, or where the sets cycle.
    """
    for _ in range(MAX_TAUT_SETS):
        fill_system(at, model, shift, m)
        if not factorise(model.A, 6):
            return False
        substitute(model.A, model.rhs, model.x)
        if not update_taut(at, model, m):
            return True
    return False


@inline
def fill_system(at, model, shift, m):
    """Fill in the lower half of the equation A x = rhs of the minimum if exactly the taut cables were springs."""
    s, w, rhs = at.s, model.w, model.rhs
    for a in range(6):
        rhs[a] = -model.g[a]
    for i in range(m):
        stiffness = w[TAUT + i] * s[K + i]
        w[PULL + i] = -(stiffness * s[E + i])
        w[WEIGHTS + i] = stiffness - w[Q + i]
    ck.add_forces(w, PULL, m, rhs)
    ck.add_products(w, J, WEIGHTS, m, model.H, model.A)
    for a in range(6):
        model.A[a, a] += shift


@inline
def predict(at, model, m):
    """Fill in the stretches that the model predicts at x."""
    s, w, x = at.s, model.w, model.x
    x0, x1, x2, x3, x4, x5 = x[0], x[1], x[2], x[3], x[4], x[5]
    for i in range(m):
        w[PREDICTED + i] = s[E + i] + (
            w[J + i] * x0 + w[J + STRIDE + i] * x1 + w[J + 2 * STRIDE + i] * x2 + w[J + 3 * STRIDE + i] * x3
            + w[J + 4 * STRIDE + i] * x4 + w[J + 5 * STRIDE + i] * x5
        )  # fmt: skip


@inline
def update_taut(at, model, m):
    """Let those cables be taut that are stretched at x in the model; return whether that changed them."""
    w, changed = model.w, 0.0
    predict(at, model, m)
    for i in range(m):
        now = 1.0 if w[PREDICTED + i] > 0 else 0.0
        changed += abs(now - w[TAUT + i])
        w[TAUT + i] = now
    return changed > 0.0


@inline
def shorten(x, longest, largest):
    """Scale x back to a translation of ``longest`` and a rotation of ``largest`` at most."""
    translation = math.sqrt(x[0] * x[0] + x[1] * x[1] + x[2] * x[2])
    rotation = math.sqrt(x[3] * x[3] + x[4] * x[4] + x[5] * x[5])
    factor = max(translation / longest, rotation / largest)
    if factor > 1:
        for a in range(6):
            x[a] /= factor


@inline
def model_decrease(case, at, model):
    """Decrease of the unshifted model along x.

    Fill in the stretches that it predicts, or of SAGGING cables the slope.
    """
    s, w, g, H, x, m = at.s, model.w, model.g, model.H, model.x, len(case.table)
    decrease = 0.0
    for a in range(6):
        slope = g[a] + 0.5 * H[a, a] * x[a]
        for b in range(a):
            slope += H[a, b] * x[b]
        decrease -= slope * x[a]
    predict(at, model, m)
    if case.kind == SAGGING:
        for a in range(6):
            model.rhs[a] = g[a]
            for b in range(6):
                model.rhs[a] += H[max(a, b), min(a, b)] * x[b]
            w[WEIGHTS + a] = model.rhs[a]
        return decrease
    total = 0.0
    for i in range(m):
        predicted, stretch = w[PREDICTED + i], s[E + i]
        before, after, along = max(stretch, 0.0), max(predicted, 0.0), predicted - stretch
        total += s[K + i] * (before * before - after * after) + w[Q + i] * along * along
    return decrease + 0.5 * total


@inline
def _retract(case, trial, model):
    """Correct x so that the taut cables get the stretch that the model predicts for them.

    With mass, so that the slope becomes what the model predicts.
    """
    s, w, rhs, m = trial.s, model.w, model.rhs, len(case.table)
    if case.kind == SAGGING:
        _fill_missed_slope(case, trial, model)
    else:
        for a in range(6):
            rhs[a] = 0.0
        for i in range(m):
            w[PULL + i] = s[K + i] * (max(w[PREDICTED + i], 0.0) - max(s[E + i], 0.0))
        ck.add_forces(w, PULL, m, rhs)
    substitute(model.A, rhs, rhs)
    for a in range(6):
        model.x[a] += rhs[a]


@inline
def _fill_missed_slope(case, trial, model):
    g = np.empty(6)
    fill_slopes(case, trial, Model(model.w, g, model.H, model.A, model.rhs, model.x))
    for a in range(6):
        model.rhs[a] = model.w[WEIGHTS + a] - g[a]


@inline
def _polish(case, here, trial, model):
    """One more Newton step from a minimum; return what is unbalanced there, nan where a cable has no path."""
    for a in range(6):
        model.x[a] = -model.g[a]
    substitute(model.A, model.x, model.x)
    work = move(case, here, model.x, trial)
    V = measure(case, trial) - work
    left = fill_slopes(case, trial, model)
    return left if V == V else np.nan


@inline
def is_minimum(case, at, model):
    """Whether the stiffness matrix with the cables that are taut at the point itself is positive definite."""
    ck.add_springs(at.s, len(case.table), model.w, model.H, model.A)
    return factorise(model.A, 6)


@inline
def _leave_saddle(case, here, model, V, trial):
    """Step to a lower point along the direction of most negative curvature; return V there, nan where there is none."""
    H = np.empty((6, 6))
    ck.add_springs(here.s, len(case.table), model.w, model.H, H)
    for a in range(6):
        for b in range(a):
            H[b, a] = H[a, b]
    if not math.isfinite(np.abs(H).sum()):  # nothing is known of the saddle, and NumPy would raise an error
        return np.nan
    eigenvalues, directions = np.linalg.eigh(H)
    if eigenvalues[0] >= -NEUTRAL * ck.largest(eigenvalues, 0, 6):
        return np.nan
    x, length, first = np.empty(6), MAX_ROTATION * case.scale, 0
    largest = ck.largest(directions[:, 0], 0, 6)
    while abs(directions[first, 0]) < 0.5 * largest:
        first += 1
    if directions[first, 0] < 0.0:  # the sign is the BLAS's: every machine is to try the same side first
        length = -length
    for _ in range(40):
        for sign in range(2):
            for a in range(6):
                x[a] = directions[a, 0] * (length if sign == 0 else -length)
            work = move(case, here, x, trial)
            lower = measure(case, trial)
            if lower - work < V:
                return lower
        length *= 0.5
    return np.nan

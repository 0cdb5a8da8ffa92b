"""Our static solver: Newton's method on the energy, with the tensions carried along; compiled.

Static equilibrium (paper Eq. 3) is where the energy of cables and weight has no slope,

    V(q) = Σ ½ kᵢ max(lᵢ(q) − l0ᵢ, 0)² + m g z_com(q) − (work of the external wrench),

and stable where it has a minimum. Plain Newton on V creeps when cables are stiff: V is then a narrow curved
valley, and a step along its tangent climbs the wall. Four measures make the cost independent of stiffness:

1. *Carried tensions.* The geometric part of the stiffness matrix uses the tensions that the last local model
   predicted, not k (l − l0), which a curved step has thrown far off (primal-dual Newton).
2. *The unilateral law inside the local model.* Each iteration minimises
   gᵀx + ½ xᵀ(K_geo + λ)x + Σ ½ k max(l − l0 + Jx, 0)² exactly, by a semismooth Newton iteration on the set of taut
   cables (Hintermüller, Ito, Kunisch 2002, doi:10.1137/S1052623401383558); so a cable that would become taut
   on the way is felt before the step is taken.
3. *Retraction.* If the energy does not fall as the model says, the lengths at the trial pose are measured and corrected
   back to the predicted ones with the same factorisation (second-order correction; Nocedal and Wright 2006,
   section 18.3, doi:10.1007/978-0-387-40065-5), which puts the step back on the valley's floor.
4. *Descent.* A step is taken only if the true V falls; else λ grows (Levenberg-Marquardt). At a saddle the iteration
   leaves along the direction of negative curvature. So it ends at a minimum: a pose where a platform can rest.

Rotation steps are left-applied rotation vectors times the robot's characteristic length, so that all six
coordinates are lengths.
"""

from __future__ import annotations

import enum
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numba import float64, guvectorize, int64, njit

from cdpr_sim.core.compiling import built_once
from cdpr_sim.core.equilibrium import NEUTRAL

MAX_ITERATIONS = 1000
"""Tens do for all but the oddest robots: a pendulum of many cables from one point needs hundreds."""

MAX_TRANSLATION = 0.5
"""Longest step, as a fraction of the mean cable length."""

MAX_ROTATION = 0.7
"""Longest step [rad]: beyond it the local model says little about a rotation."""

FORCE_TOLERANCE = 2e-9
"""Largest unbalanced force at convergence, as a fraction of the load."""

ROUNDING = 8 * np.finfo(float).eps
"""Relative error of a computed length, a few units in the last place: below it no pose has a smaller residual."""

PIVOT_ROUNDING = 1e-13
"""A Cholesky pivot smaller than this fraction of its diagonal entry is rounding, not stiffness."""

MAX_TRIALS = 60
"""Steps tried, each shorter than the last, before an iteration gives up."""

MAX_TAUT_SETS = 6
"""Sets of taut cables tried within one local model; two or three do, unless they cycle."""

_jit = njit(cache=True, error_model="numpy")
# Small functions that take dozens of arrays: the calls would cost more than the work.
_inline = njit(cache=True, error_model="numpy", forceinline=True)


class Status(enum.IntEnum):
    """How a solve ended; ``sentence`` says it in words."""

    CONVERGED = 0
    ITERATION_LIMIT = 1
    STALLED = 2
    NOT_FINITE = 3

    @property
    def sentence(self) -> str:
        """What the status means."""
        return {
            Status.CONVERGED: "converged to a minimum of the energy",
            Status.ITERATION_LIMIT: f"no equilibrium within {MAX_ITERATIONS} iterations",
            Status.STALLED: "no step lowers the energy any more, but forces do not balance to tolerance",
            Status.NOT_FINITE: "the input is not finite",
        }[self]


_CONVERGED, _ITERATION_LIMIT, _STALLED, _NOT_FINITE = (int(status) for status in Status)


@built_once
def equilibrium_gufunc() -> Callable:
    """The compiled solver as a NumPy generalised ufunc, which broadcasts and releases the GIL.

    Compiled at the first call and cached on disk, so that importing this module compiles nothing. Arguments: exits
    (m,3), anchors (m,3), axial stiffness (m), rest lengths (m), weight, centre of mass (3), external wrench (6), free
    directions as 0 or 1 (6), characteristic length, starting position (3), starting rotation matrix (3,3).
    Results: position (3), rotation matrix (3,3), lengths (m), residual, iterations, status.
    """
    vector, matrix = float64[:], float64[:, :]
    signature = (matrix, matrix, vector, vector, float64, vector, vector, vector, float64, vector, matrix)
    results = (vector, matrix, vector, vector, int64[:], int64[:])
    return guvectorize(
        [signature + results],
        "(m,c),(m,c),(m),(m),(),(c),(d),(d),(),(c),(c,c)->(c),(c,c),(m),(),(),()",
        cache=True,
    )(_solve_one)


def _solve_one(
    exits, anchors, axial_stiffness, rest_lengths, weight, center_of_mass, wrench, free, scale, start_position,
    start_rotation, position, rotation, lengths, residual, iterations, status,
):  # fmt: skip
    """One element of the gufunc; copies make the compiled inner code work on contiguous arrays."""
    case = _Case(
        exits.copy(), anchors.copy(), axial_stiffness / rest_lengths, rest_lengths.copy(), weight,
        center_of_mass.copy(), wrench.copy(), free.copy(), scale,
    )  # fmt: skip
    rest, residual[0], iterations[0], status[0] = _descend(case, start_position, start_rotation)
    position[:], rotation[:, :], lengths[:] = rest.p, rest.R, rest.l


class _Case(NamedTuple):
    """What is given. A, B: exits, anchors; k = EA/l0; free: 1 where the platform moves; scale: length of rotations."""

    A: np.ndarray
    B: np.ndarray
    k: np.ndarray
    l0: np.ndarray
    weight: float
    com: np.ndarray
    wrench: np.ndarray
    free: np.ndarray
    scale: float


class _Point(NamedTuple):
    """A pose and what is measured there: anchor arms r and directions u in the base frame, l, and s = l - l0."""

    p: np.ndarray
    R: np.ndarray
    r: np.ndarray
    u: np.ndarray
    l: np.ndarray  # noqa: E741
    s: np.ndarray


class _Model(NamedTuple):
    """The local model at a point: lengths l + Jx, slope g of the load, curvature K; L: Cholesky factor last used."""

    J: np.ndarray
    g: np.ndarray
    K: np.ndarray
    L: np.ndarray
    rhs: np.ndarray


class _Scales(NamedTuple):
    """What counts as nothing: the least shift, forces that balance, energies that are rounding."""

    least_shift: float
    force: float
    energy: float


@_inline
def _descend(case, start_position, start_rotation):
    """Newton iterations from a pose: the point they end at, its residual, their number, and the status."""
    m = len(case.k)
    here, trial = _new_point(m), _new_point(m)
    model = _Model(np.empty((m, 6)), np.empty(6), np.empty((6, 6)), np.empty((6, 6)), np.empty(6))
    x, taut, tau, predicted = np.empty(6), np.empty(m, np.bool_), np.empty(m), np.empty(m)

    here.p[:], here.R[:, :] = start_position, start_rotation
    V = _measure(case, here)
    scales = _scales(case, here)
    if not np.isfinite(V + scales.force):
        return here, np.nan, 0, _NOT_FINITE
    _first_tensions(case, here, tau, taut)
    shift, residual, certified = 0.0, np.inf, False
    for iteration in range(MAX_ITERATIONS):
        residual = _slopes(case, here, model)
        if residual <= scales.force:
            if certified:
                return here, residual, iteration, _CONVERGED
            _spring_tensions(case, here, tau, taut)
            _curvature(case, here, tau, model)
            if _is_minimum(case, here, model) or not _leave_saddle(case, here, model, V, trial):
                return here, residual, iteration, _CONVERGED
            here, trial = trial, here
            V = _measure(case, here)
            _spring_tensions(case, here, tau, taut)
            shift = 0.0
            continue
        _curvature(case, here, tau, model)
        accepted, decrease, V_trial = False, 0.0, V
        longest = MAX_TRANSLATION * here.l.mean()
        # Inside this function, since only there the compiler knows that the arrays do not overlap: 1.4 times as fast.
        for _ in range(MAX_TRIALS):
            decrease = -np.inf
            if _model_minimum(case, here, model, shift, taut, x):
                _shorten(x, longest, MAX_ROTATION * case.scale)
                decrease = _model_decrease(case, here, model, x, predicted)
            rounding = abs(decrease) <= scales.energy  # such a step is judged by the forces, next time round
            if decrease > 0 or rounding:
                for attempt in range(3):
                    V_trial = _measure_at(case, here, x, trial)
                    if rounding or V - V_trial >= 0.3 * decrease or attempt == 2:
                        break
                    _retract(case, trial, model, predicted, x)
                if rounding or V - V_trial >= 0.05 * decrease:
                    accepted = True
                    break
            shift = max(4 * shift, scales.least_shift)
            for i in range(m):
                taut[i] = tau[i] > 0
        if not accepted:
            return here, residual, iteration, _STALLED
        certified = shift == 0.0  # where forces balance next, the model that led there had a minimum...
        if V - V_trial > 0.5 * decrease:
            shift = shift / 8 if shift > scales.least_shift / 64 else 0.0
        here, trial = trial, here
        V = _energy(case, here)
        for i in range(m):
            certified &= taut[i] == (here.s[i] > 0)  # ...with the cables that really are taut
            taut[i] = predicted[i] > 0
            tau[i] = case.k[i] * max(predicted[i], 0.0)
    return here, residual, MAX_ITERATIONS, _ITERATION_LIMIT


@_inline
def _scales(case, start):
    load = case.weight
    for a in range(6):
        load = max(load, abs(case.wrench[a]) / (1.0 if a < 3 else case.scale))
    size = max(np.abs(case.A).max(), np.abs(start.p).max())
    return _Scales(
        max(load, 1e-9 * case.k.max() * case.scale) / case.l0.mean(),
        FORCE_TOLERANCE * load + ROUNDING * case.k.max() * size,
        1e-13 * load * case.scale,
    )


@_inline
def _first_tensions(case, at, tau, taut):
    """As if the platform sank straight down on all cables that pull up."""
    upward = 0.0
    for i in range(len(tau)):
        upward += case.k[i] * max(at.u[i, 2], 0.0) ** 2
    for i in range(len(tau)):
        tau[i] = case.k[i] * max(at.u[i, 2], 0.0) * case.weight / upward if upward > 0 else 0.0
        taut[i] = at.s[i] >= 0


@_inline
def _spring_tensions(case, at, tau, taut):
    """The tensions of the cables as they are stretched (paper Eq. 10, 11)."""
    for i in range(len(tau)):
        tau[i] = case.k[i] * max(at.s[i], 0.0)
        taut[i] = at.s[i] > 0


@_inline
def _new_point(m):
    return _Point(np.empty(3), np.empty((3, 3)), np.empty((m, 3)), np.empty((m, 3)), np.empty(m), np.empty(m))


@_inline
def _measure(case, at):
    """Fill in the cables' state at ``at.p``, ``at.R`` (paper Eq. 8, 9); return V."""
    A, B, k, l0 = case.A, case.B, case.k, case.l0
    p, R, r, u, l, s = at.p, at.R, at.r, at.u, at.l, at.s  # noqa: E741
    for i in range(len(k)):
        length2 = 0.0
        for a in range(3):
            r[i, a] = R[a, 0] * B[i, 0] + R[a, 1] * B[i, 1] + R[a, 2] * B[i, 2]
            u[i, a] = A[i, a] - p[a] - r[i, a]
            length2 += u[i, a] ** 2
        l[i] = np.sqrt(length2)
        s[i] = l[i] - l0[i]
        inverse = 1 / l[i]
        for a in range(3):
            u[i, a] *= inverse
    return _energy(case, at)


@_inline
def _energy(case, at):
    """V without the work of the external torque, which depends on the way and is counted step by step."""
    k, weight, com, wrench = case.k, case.weight, case.com, case.wrench
    p, R, s = at.p, at.R, at.s
    V = weight * (p[2] + R[2, 0] * com[0] + R[2, 1] * com[1] + R[2, 2] * com[2])
    for a in range(3):
        V -= wrench[a] * p[a]
    for i in range(len(k)):
        if s[i] > 0:
            V += 0.5 * k[i] * s[i] ** 2
    return V


@_inline
def _measure_at(case, here, x, trial):
    """Measure the pose that the step x leads to; return V there, less the work of the external torque on the way."""
    wrench, scale = case.wrench, case.scale
    p_here, R_here = here.p, here.R
    p_trial, R_trial = trial.p, trial.R
    for a in range(3):
        p_trial[a] = p_here[a] + x[a]
    _rotate(R_here, x[3] / scale, x[4] / scale, x[5] / scale, R_trial)
    work = (wrench[3] * x[3] + wrench[4] * x[4] + wrench[5] * x[5]) / scale
    return _measure(case, trial) - work


@_inline
def _rotate(R, a, b, c, out):
    """out = exp([a b c]×) R, by Rodrigues' formula."""
    angle2 = a * a + b * b + c * c
    angle = np.sqrt(angle2)
    if angle > 1e-4:
        sine, versine = np.sin(angle) / angle, (1 - np.cos(angle)) / angle2
    else:
        sine, versine = 1 - angle2 / 6, 0.5 - angle2 / 24
    for j in range(3):
        x, y, z = R[0, j], R[1, j], R[2, j]
        along = a * x + b * y + c * z
        out[0, j] = x + sine * (b * z - c * y) + versine * (a * along - angle2 * x)
        out[1, j] = y + sine * (c * x - a * z) + versine * (b * along - angle2 * y)
        out[2, j] = z + sine * (a * y - b * x) + versine * (c * along - angle2 * z)


@_inline
def _slopes(case, at, model):
    """Fill in J = ∂l/∂x (minus the columns of the wrench matrix, Eq. 4) and g; return the largest unbalanced force."""
    k, weight, com, wrench, free, scale = case.k, case.weight, case.com, case.wrench, case.free, case.scale
    R, r, u, s = at.R, at.r, at.u, at.s
    J, g = model.J, model.g
    per_scale = 1 / scale
    for i in range(len(k)):
        J[i, 0], J[i, 1], J[i, 2] = -u[i, 0], -u[i, 1], -u[i, 2]
        x, y, z = r[i, 0] * per_scale, r[i, 1] * per_scale, r[i, 2] * per_scale
        J[i, 3] = z * u[i, 1] - y * u[i, 2]
        J[i, 4] = x * u[i, 2] - z * u[i, 0]
        J[i, 5] = y * u[i, 0] - x * u[i, 1]
    g[0], g[1], g[2] = -wrench[0], -wrench[1], weight - wrench[2]
    g[3] = (weight * (R[1, 0] * com[0] + R[1, 1] * com[1] + R[1, 2] * com[2]) - wrench[3]) / scale
    g[4] = (-weight * (R[0, 0] * com[0] + R[0, 1] * com[1] + R[0, 2] * com[2]) - wrench[4]) / scale
    g[5] = -wrench[5] / scale
    residual = 0.0
    for a in range(6):
        if free[a] == 0.0:
            g[a] = 0.0
            J[:, a] = 0.0
            continue
        force = g[a]
        for i in range(len(k)):
            if s[i] > 0:
                force += k[i] * s[i] * J[i, a]
        residual = max(residual, abs(force))
    return residual


@_inline
def _curvature(case, at, tau, model):
    """Fill in the lower half of K: Σ tau ∂²l/∂x² and the weight's part, for rotation vectors applied on the left.

    ∂²l/∂x² = (DᵀD − J Jᵀ)/l + uᵀ∂²d/∂x² with d = A − p − r, D = ∂d/∂x = [−1, [r]×], and
    uᵀ∂²d/∂φ² = (u·r) 1 − ½ (u rᵀ + r uᵀ).
    """
    k, weight, com, free, scale = case.k, case.weight, case.com, case.free, case.scale
    R, r, u, l = at.R, at.r, at.u, at.l  # noqa: E741
    J, K = model.J, model.K
    per_scale = 1 / scale
    for a in range(6):
        for b in range(a + 1):
            K[a, b] = 0.0
    x = (R[0, 0] * com[0] + R[0, 1] * com[1] + R[0, 2] * com[2]) / scale
    y = (R[1, 0] * com[0] + R[1, 1] * com[1] + R[1, 2] * com[2]) / scale
    z = (R[2, 0] * com[0] + R[2, 1] * com[1] + R[2, 2] * com[2]) / scale
    _add_dipole(K, 0.0, 0.0, -weight / scale, x, y, z)
    for i in range(len(k)):
        if tau[i] <= 0:
            continue
        q = tau[i] / l[i]
        x, y, z = r[i, 0] * per_scale, r[i, 1] * per_scale, r[i, 2] * per_scale
        for a in range(6):
            for b in range(a + 1):
                K[a, b] -= q * J[i, a] * J[i, b]
        K[0, 0] += q
        K[1, 1] += q
        K[2, 2] += q
        K[3, 1] -= q * z
        K[3, 2] += q * y
        K[4, 0] += q * z
        K[4, 2] -= q * x
        K[5, 0] -= q * y
        K[5, 1] += q * x
        K[3, 3] += q * (y * y + z * z)
        K[4, 4] += q * (x * x + z * z)
        K[5, 5] += q * (x * x + y * y)
        K[4, 3] -= q * x * y
        K[5, 3] -= q * x * z
        K[5, 4] -= q * y * z
        t = tau[i] / scale
        _add_dipole(K, t * u[i, 0], t * u[i, 1], t * u[i, 2], x, y, z)
    for a in range(6):
        if free[a] == 0.0:
            for b in range(6):
                K[max(a, b), min(a, b)] = 0.0
            K[a, a] = weight / scale + 1.0  # any positive number: the step there is 0


@_inline
def _add_dipole(K, fx, fy, fz, x, y, z):
    """Add (f·r) 1 − ½ (f rᵀ + r fᵀ) to the lower half of the rotations' block."""
    dot = fx * x + fy * y + fz * z
    K[3, 3] += dot - fx * x
    K[4, 4] += dot - fy * y
    K[5, 5] += dot - fz * z
    K[4, 3] -= 0.5 * (fx * y + fy * x)
    K[5, 3] -= 0.5 * (fx * z + fz * x)
    K[5, 4] -= 0.5 * (fy * z + fz * y)


@_inline
def _model_minimum(case, at, model, shift, taut, x):
    """Minimise gᵀx + ½ xᵀ(K + shift)x + Σ ½ k max(s + Jx, 0)², starting from the set ``taut``, which is updated.

    False where the quadratic form of some taut set on the way is not positive definite, or where the sets cycle.
    """
    for _ in range(MAX_TAUT_SETS):
        if not _newton_target(case, at, model, shift, taut, x):
            return False
        if not _update_taut(case, at, model, x, taut):
            return True
    return False


@_inline
def _newton_target(case, at, model, shift, taut, x):
    """The x that would be the minimum if just the cables ``taut`` were springs; False where there is none."""
    k, s = case.k, at.s
    J, g, K, L, rhs = model.J, model.g, model.K, model.L, model.rhs
    for a in range(6):
        rhs[a] = -g[a]
        for b in range(a + 1):
            L[a, b] = K[a, b]
        L[a, a] += shift
    for i in range(len(k)):
        if taut[i]:
            for a in range(6):
                slope = k[i] * J[i, a]
                rhs[a] -= slope * s[i]
                for b in range(a + 1):
                    L[a, b] += slope * J[i, b]
    if not _factorise(L):
        return False
    _substitute(L, rhs, x)
    return True


@_inline
def _update_taut(case, at, model, x, taut):
    """Set ``taut`` to the cables that are stretched at x in the model; return whether that changed it."""
    changed = False
    for i in range(len(case.k)):
        stretch = at.s[i]
        for a in range(6):
            stretch += model.J[i, a] * x[a]
        if (stretch > 0) != taut[i]:
            taut[i] = not taut[i]
            changed = True
    return changed


@_inline
def _factorise(L):
    """Cholesky factor of the lower half of L, in place; False where it is not positive definite."""
    for j in range(6):
        pivot = L[j, j]
        least = PIVOT_ROUNDING * abs(pivot)
        for c in range(j):
            pivot -= L[j, c] ** 2
        if not pivot > least:
            return False
        pivot = np.sqrt(pivot)
        L[j, j] = pivot
        for i in range(j + 1, 6):
            entry = L[i, j]
            for c in range(j):
                entry -= L[i, c] * L[j, c]
            L[i, j] = entry / pivot
    return True


@_inline
def _substitute(L, rhs, x):
    """Solve L Lᵀ x = rhs."""
    for i in range(6):
        value = rhs[i]
        for c in range(i):
            value -= L[i, c] * x[c]
        x[i] = value / L[i, i]
    for i in range(5, -1, -1):
        value = x[i]
        for c in range(i + 1, 6):
            value -= L[c, i] * x[c]
        x[i] = value / L[i, i]


@_inline
def _shorten(x, longest, largest):
    """Scale x back to a translation of ``longest`` and a rotation of ``largest`` at most."""
    translation = np.sqrt(x[0] ** 2 + x[1] ** 2 + x[2] ** 2)
    rotation = np.sqrt(x[3] ** 2 + x[4] ** 2 + x[5] ** 2)
    factor = max(translation / longest, rotation / largest)
    if factor > 1:
        for a in range(6):
            x[a] /= factor


@_inline
def _model_decrease(case, at, model, x, predicted):
    """How far the unshifted model falls along x; fill in the stretches that it predicts."""
    k = case.k
    s = at.s
    J, g, K = model.J, model.g, model.K
    decrease = 0.0
    for a in range(6):
        slope = g[a] + 0.5 * K[a, a] * x[a]
        for b in range(a):
            slope += K[a, b] * x[b]
        decrease -= slope * x[a]
    for i in range(len(k)):
        stretch = s[i]
        for a in range(6):
            stretch += J[i, a] * x[a]
        predicted[i] = stretch
        decrease += 0.5 * k[i] * (max(s[i], 0.0) ** 2 - max(stretch, 0.0) ** 2)
    return decrease


@_inline
def _retract(case, trial, model, predicted, x):
    """Correct x so that the taut cables get the stretch that the model predicted for them."""
    k = case.k
    s_trial = trial.s
    J, L, rhs = model.J, model.L, model.rhs
    for a in range(6):
        rhs[a] = 0.0
        for i in range(len(k)):
            rhs[a] -= k[i] * (max(s_trial[i], 0.0) - max(predicted[i], 0.0)) * J[i, a]
    correction = np.empty(6)
    _substitute(L, rhs, correction)
    for a in range(6):
        x[a] += correction[a]


@_inline
def _is_minimum(case, at, model):
    """Whether the stiffness matrix with the cables that are taut at the point itself is positive definite."""
    k = case.k
    s = at.s
    J, K, L = model.J, model.K, model.L
    for a in range(6):
        for b in range(a + 1):
            L[a, b] = K[a, b]
            for i in range(len(k)):
                if s[i] > 0:
                    L[a, b] += k[i] * J[i, a] * J[i, b]
    return _factorise(L)


@_jit
def _leave_saddle(case, here, model, V, trial):
    """Step to a lower point along the direction of most negative curvature; False where there is none."""
    k, scale = case.k, case.scale
    s_here = here.s
    J, K = model.J, model.K
    H = np.empty((6, 6))
    for a in range(6):
        for b in range(a + 1):
            H[a, b] = K[a, b]
            for i in range(len(k)):
                if s_here[i] > 0:
                    H[a, b] += k[i] * J[i, a] * J[i, b]
            H[b, a] = H[a, b]
    eigenvalues, directions = np.linalg.eigh(H)
    if eigenvalues[0] >= -NEUTRAL * np.abs(eigenvalues).max():
        return False
    x = directions[:, 0] * (MAX_ROTATION * scale)
    for _ in range(40):
        if _measure_at(case, here, x, trial) < V or _measure_at(case, here, -x, trial) < V:
            return True
        x *= 0.5
    return False

"""Static equilibrium of robots whose cables have mass: descent on the energy; compiled.

Static equilibrium is a stationary point of the energy of cables and platform,

    V(q) = Σ Eᵢ(dᵢ(q)) + m g z_com(q) − (work of the external wrench),

with dᵢ from exit to anchor, and it is stable at a minimum. E is the energy of ``any_cable``, of stretch and of the
cable's own weight, smooth even where a cable sags. Newton's method on V with its exact curvature: for a cable with pull
f and stiffness k on an anchor whose arm is r, D = ∂d/∂x = [1, −[r]×],

    ∂²V = Dᵀ k D + [0, (f·r) 1 − ½ (f rᵀ + r fᵀ)].

A step that would not lower V as the local model predicts is first corrected for the forces that the model missed, with
the same factorisation (second-order correction; ``newton_kernel``), and then shortened (Levenberg-Marquardt). At a
saddle the iteration continues along the direction of negative curvature. So it ends at a minimum: a stable equilibrium.

The start is an argument. The equilibrium with massless cables is near: from there a few iterations suffice.
Coordinates are those of ``newton_kernel``: translation, and left-applied rotation vector times a length.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from cdpr_sim.core.cable import ANCHOR, EXIT, RADIUS, STIFFNESS
from cdpr_sim.core.compiling import Kernel, inline, outlined
from cdpr_sim.core.status import ACCEPTABLE, NEUTRAL, Status
from cdpr_sim.statics import cable_kernel as ck
from cdpr_sim.statics.any_cable import any_cable, cable_of, clear_of_wheel
from cdpr_sim.statics.matrix_kernel import factorise, substitute
from cdpr_sim.statics.newton_kernel import (
    FORCE_TOLERANCE,
    MAX_ITERATIONS,
    MAX_ROTATION,
    MAX_TRANSLATION,
    MAX_TRIALS,
    ROUNDING,
    _load,
    _rotate,
    _shorten,
)

LARGEST_RESIDUAL = 5e-7
"""Unbalanced force that is tolerated for large loads [N]: ``FORCE_TOLERANCE`` of 250 N."""

POLISHED = 0.01
"""Fraction of the tolerated unbalanced force above which one more step is taken."""

_CONVERGED, _ITERATION_LIMIT = int(Status.CONVERGED), int(Status.ITERATION_LIMIT)
_STALLED, _NOT_FINITE, _OFF_WHEEL = int(Status.STALLED), int(Status.NOT_FINITE), int(Status.OFF_WHEEL)


def _solve_one(
    table, weights, wrapped, rest_lengths, weight, center_of_mass, wrench, free, scale, start_position,
    start_rotation, position, rotation, lengths, tensions, residual, iterations, status,
):  # fmt: skip
    """One element of the gufunc; copies make the arrays of the compiled inner code contiguous."""
    m = len(rest_lengths)
    case = _Case(
        np.empty((m, table.shape[1])), ck.copied(rest_lengths), ck.copied(weights), ck.copied(wrapped), weight,
        ck.copied(center_of_mass), ck.copied(wrench), ck.copied(free), scale,
    )  # fmt: skip
    for i in range(m):
        for a in range(table.shape[1]):
            case.table[i, a] = table[i, a]
    start = _new_point(m)
    for a in range(3):
        start.p[a] = start_position[a]
        for b in range(3):
            start.R[a, b] = start_rotation[a, b]
    rest, residual[0], iterations[0], status[0] = _descend(case, start)
    if status[0] == _CONVERGED or not residual[0] < np.inf:
        for i in range(m):
            at = _apart(case, rest, i)
            on_wheel = rest.tau[i] >= 0 and clear_of_wheel(at[0], at[1], at[2], _cable(case, i))
            if table[i, RADIUS] > 0 and not on_wheel:
                status[0] = _OFF_WHEEL
    for a in range(3):
        position[a] = rest.p[a]
        for b in range(3):
            rotation[a, b] = rest.R[a, b]
    for i in range(m):
        lengths[i], tensions[i] = rest.l[i], rest.tau[i]


_HEAVY = Kernel(
    "static solver for cables with mass",
    _solve_one,
    "(m,k),(m),(m),(m),(),(c),(d),(d),(),(c),(c,c)->(c),(c,c),(m),(m),(),(),()",
    ("iterations", "status"),
)


def sagging_gufunc() -> Kernel:
    """The solver as a NumPy generalised ufunc.

    Arguments: ``Cabling.packed`` (m,k); weights per rest length (m) [N/m], 0 for massless cables; the first parts of
    the rest lengths that weigh nothing (m), ``Robot.wrapped_lengths``; rest lengths (m), the platform's weight, centre
    of mass (3), external wrench (6), free directions as 0 or 1 (6), characteristic length, starting position (3),
    starting rotation matrix (3,3).
    Results: position (3), rotation matrix (3,3), lengths of the massless paths (m), tensions at the anchors (m),
    residual, iterations, status.
    """
    return _HEAVY


class _Case(NamedTuple):
    """Data of one problem. w: weights per length beyond ``wrapped``; free: 1 where it moves; scale: length."""

    table: np.ndarray
    l0: np.ndarray
    w: np.ndarray
    wrapped: np.ndarray
    weight: float
    com: np.ndarray
    wrench: np.ndarray
    free: np.ndarray
    scale: float


class _Point(NamedTuple):
    """A pose, and the cables' arms, pulls, stiffnesses (xx, xy, yy, xz, yz, zz), lengths and tensions there."""

    p: np.ndarray
    R: np.ndarray
    r: np.ndarray
    f: np.ndarray
    k: np.ndarray
    l: np.ndarray  # noqa: E741
    tau: np.ndarray


@outlined
def _new_point(m):
    return _Point(
        np.empty(3), np.empty((3, 3)), np.empty((m, 3)), np.empty((m, 3)), np.empty((m, 6)), np.empty(m), np.empty(m)
    )


@outlined
def _descend(case, here):
    """Newton iterations from a pose: the last point, its residual, the number of iterations, and the status."""
    trial = _new_point(len(case.l0))
    g, rhs, predicted, x, correction = np.empty(6), np.empty(6), np.empty(6), np.empty(6), np.empty(6)
    K, L = np.empty((6, 6)), np.empty((6, 6))
    V = _measure(case, here)
    size = ck.largest(here.p)
    load = _load(case, ck.mean(case.table[:, STIFFNESS]))
    stiffest, pulling = 0.0, 0.0
    for i in range(len(case.l0)):
        stiffest = max(stiffest, case.table[i, STIFFNESS] / case.l0[i])
        pulling += case.w[i] * case.l0[i]
        for a in range(3):
            size = max(size, abs(case.table[i, EXIT + a]))
    enough = min(FORCE_TOLERANCE * load, LARGEST_RESIDUAL) + ROUNDING * (stiffest * size + pulling)
    enough = min(enough, ACCEPTABLE * load)
    least_shift = 1e-6 * load / ck.mean(case.l0)
    if not np.isfinite(V + enough):
        return here, np.nan, 0, _NOT_FINITE
    shift, residual = 0.0, np.inf
    for iteration in range(MAX_ITERATIONS):
        residual = _slope(case, here, g)
        _curvature(case, here, K)
        if residual <= enough:
            _copy(K, 0.0, L)
            if factorise(L, 6):
                if residual > POLISHED * enough:
                    for a in range(6):
                        rhs[a] = -g[a]
                    substitute(L, rhs, x)
                    _measure_at(case, here, x, trial)
                    residual_there = _slope(case, trial, g)
                    if residual_there < residual:
                        return trial, residual_there, iteration + 1, _CONVERGED
                return here, residual, iteration, _CONVERGED
            if not _leave_saddle(case, here, K, V, trial):
                return here, residual, iteration, _CONVERGED
            here, trial = trial, here
            V, shift = _measure(case, here), 0.0
            continue
        accepted, decrease, fallen, V_trial = False, 0.0, 0.0, V
        noise = load * case.scale
        for i in range(len(here.tau)):
            noise += here.tau[i] * size
        noise *= ROUNDING
        longest = MAX_TRANSLATION * ck.mean(here.l)
        for _ in range(MAX_TRIALS):
            _copy(K, shift, L)
            decrease = -np.inf
            if factorise(L, 6):
                for a in range(6):
                    rhs[a] = -g[a]
                substitute(L, rhs, x)
                _shorten(x, longest, MAX_ROTATION * case.scale)
                decrease = _model(g, K, x, predicted)
            rounding = abs(decrease) <= noise  # such a step is judged by the forces, in the next iteration
            if decrease > 0 or rounding:
                for attempt in range(3):
                    V_trial, work = _measure_at(case, here, x, trial)
                    fallen = V - V_trial + work
                    if rounding or fallen >= 0.3 * decrease or attempt == 2:
                        break
                    _slope(case, trial, rhs)
                    for a in range(6):
                        rhs[a] = predicted[a] - rhs[a]
                    substitute(L, rhs, correction)
                    for a in range(6):
                        x[a] += correction[a]
                if fallen >= 0.05 * decrease or (rounding and fallen == fallen):  # not where a cable has no path
                    accepted = True
                    break
            shift = max(6 * shift, least_shift)
        if not accepted:
            return here, residual, iteration, _STALLED
        if fallen > 0.5 * decrease:
            shift = shift / 6 if shift > least_shift else 0.0
        here, trial, V = trial, here, V_trial
    return here, residual, MAX_ITERATIONS, _ITERATION_LIMIT


@outlined
def _measure(case, at):
    """Fill in the state of the cables at ``at.p``, ``at.R``; return V without the work of the external torque.

    That work depends on the path and is accumulated step by step.
    """
    p, R, r, f, k, B = at.p, at.R, at.r, at.f, at.k, case.table
    V = case.weight * (p[2] + R[2, 0] * case.com[0] + R[2, 1] * case.com[1] + R[2, 2] * case.com[2])
    for a in range(3):
        V -= case.wrench[a] * p[a]
    for i in range(len(case.l0)):
        for a in range(3):
            r[i, a] = R[a, 0] * B[i, ANCHOR] + R[a, 1] * B[i, ANCHOR + 1] + R[a, 2] * B[i, ANCHOR + 2]
        x, y, z = _apart(case, at, i)
        (
            f[i, 0], f[i, 1], f[i, 2], k[i, 0], k[i, 1], k[i, 2], k[i, 3], k[i, 4], k[i, 5], E, _, at.tau[i], at.l[i]
        ) = any_cable(x, y, z, _cable(case, i))  # fmt: skip
        V += E
    return V


@inline
def _cable(case, i):
    return cable_of(case.table[i], case.l0[i], case.w[i], case.wrapped[i])


@inline
def _apart(case, at, i):
    """From exit to anchor of cable i."""
    return (
        at.p[0] + at.r[i, 0] - case.table[i, EXIT], at.p[1] + at.r[i, 1] - case.table[i, EXIT + 1],
        at.p[2] + at.r[i, 2] - case.table[i, EXIT + 2],
    )  # fmt: skip


@outlined
def _measure_at(case, here, x, trial):
    """Measure the pose after the step x; return V there and the work of the external torque on the way."""
    wrench, scale = case.wrench, case.scale
    for a in range(3):
        trial.p[a] = here.p[a] + x[a]
    _rotate(here.R, x[3] / scale, x[4] / scale, x[5] / scale, trial.R)
    return _measure(case, trial), (wrench[3] * x[3] + wrench[4] * x[4] + wrench[5] * x[5]) / scale


@outlined
def _slope(case, at, g):
    """Fill in the slope of V on the free directions; return the largest unbalanced force."""
    weight, com, wrench, scale = case.weight, case.com, case.wrench, case.scale
    R, r, f = at.R, at.r, at.f
    x = weight * (R[1, 0] * com[0] + R[1, 1] * com[1] + R[1, 2] * com[2]) - wrench[3]
    y = -weight * (R[0, 0] * com[0] + R[0, 1] * com[1] + R[0, 2] * com[2]) - wrench[4]
    z = -wrench[5]
    g[0], g[1], g[2] = -wrench[0], -wrench[1], weight - wrench[2]
    for i in range(len(case.l0)):
        for a in range(3):
            g[a] -= f[i, a]
        x -= r[i, 1] * f[i, 2] - r[i, 2] * f[i, 1]
        y -= r[i, 2] * f[i, 0] - r[i, 0] * f[i, 2]
        z -= r[i, 0] * f[i, 1] - r[i, 1] * f[i, 0]
    g[3], g[4], g[5] = x / scale, y / scale, z / scale
    residual = 0.0
    for a in range(6):
        if case.free[a] == 0.0:
            g[a] = 0.0
        if not abs(g[a]) <= residual:  # nan stays
            residual = abs(g[a])
    return residual


@outlined
def _curvature(case, at, K):
    """Fill in the lower half of K, the Hessian of V; directions that are not free get some positive stiffness."""
    scale = case.scale
    for a in range(6):
        for b in range(a + 1):
            K[a, b] = 0.0
    ck.add_weight_curvature(case.weight, case.com, at.R, scale, K)
    for i in range(len(case.l0)):
        x, y, z = at.r[i, 0] / scale, at.r[i, 1] / scale, at.r[i, 2] / scale
        xx, xy, yy, xz, yz, zz = at.k[i]
        K[0, 0] += xx
        K[1, 0] += xy
        K[1, 1] += yy
        K[2, 0] += xz
        K[2, 1] += yz
        K[2, 2] += zz
        # Columns of k D for rotations: k (e × r), of the axes e in turn.
        ax, ay, az = y * xz - z * xy, y * yz - z * yy, y * zz - z * yz
        bx, by, bz = z * xx - x * xz, z * xy - x * yz, z * xz - x * zz
        cx, cy, cz = x * xy - y * xx, x * yy - y * xy, x * yz - y * xz
        K[3, 0] += ax
        K[3, 1] += ay
        K[3, 2] += az
        K[4, 0] += bx
        K[4, 1] += by
        K[4, 2] += bz
        K[5, 0] += cx
        K[5, 1] += cy
        K[5, 2] += cz
        K[3, 3] += y * az - z * ay
        K[4, 3] += z * ax - x * az
        K[4, 4] += z * bx - x * bz
        K[5, 3] += x * ay - y * ax
        K[5, 4] += x * by - y * bx
        K[5, 5] += x * cy - y * cx
        ck._add_dipole(at.f[i, 0] / scale, at.f[i, 1] / scale, at.f[i, 2] / scale, x, y, z, K)
    for a in range(6):
        if case.free[a] == 0.0:
            for b in range(6):
                K[max(a, b), min(a, b)] = 0.0
            K[a, a] = case.weight / scale + 1.0  # this component of the step is 0


@inline
def _copy(K, shift, L):
    """Lower half of K + shift into L."""
    for a in range(6):
        for b in range(a + 1):
            L[a, b] = K[a, b]
        L[a, a] += shift


@inline
def _model(g, K, x, predicted):
    """Decrease of the local model along x; fill in the slope that it predicts there."""
    decrease = 0.0
    for a in range(6):
        bent = 0.0
        for b in range(6):
            bent += K[max(a, b), min(a, b)] * x[b]
        decrease -= (g[a] + 0.5 * bent) * x[a]
        predicted[a] = g[a] + bent
    return decrease


@outlined
def _leave_saddle(case, here, K, V, trial):
    """Step to a lower point along the direction of most negative curvature; False where there is none."""
    H = np.empty((6, 6))
    for a in range(6):
        for b in range(6):
            H[a, b] = K[max(a, b), min(a, b)]
    eigenvalues, directions = np.linalg.eigh(H)
    if eigenvalues[0] >= -NEUTRAL * ck.largest(eigenvalues):
        return False
    x, length = np.empty(6), MAX_ROTATION * case.scale
    for _ in range(40):
        for sign in range(2):
            for a in range(6):
                x[a] = directions[a, 0] * (length if sign == 0 else -length)
            V_trial, work = _measure_at(case, here, x, trial)
            if V_trial - work < V:
                return True
        length *= 0.5
    return False

"""Stiffness and natural frequencies at many equilibria: one compiled gufunc, a microsecond or two per pose.

The stiffness matrix is that of ``statics.stiffness_matrix``, the reference that this is tested against; its eigenvalues
come from Householder's tridiagonal form and the implicit QL iteration (EISPACK's tred1 and imtql1; Golub and Van Loan
2013, sections 8.3.1 and 8.3.3), since for a matrix of six rows a call of LAPACK costs more than its work.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numba import float64, guvectorize, int64, njit

from cdpr_sim.core.compiling import built_once
from cdpr_sim.core.equilibrium import NEUTRAL

QL_SWEEPS = 50
"""Per eigenvalue; two or three do."""

_inline = njit(cache=True, error_model="numpy", forceinline=True)


@built_once
def modes_gufunc() -> Callable:
    """How stiffly the platform is held, as a NumPy generalised ufunc, which broadcasts and releases the GIL.

    Arguments: exits (m,3), anchors (m,3), axial stiffness (m), rest lengths (m), mass, gravity, centre of mass (3),
    inertia (3,3), indices of the free directions (f), characteristic length, position (3), rotation matrix (3,3).
    Results: eigenvalues of the stiffness matrix, ascending, rotations in characteristic lengths (f) [N/m]; the lowest
    natural frequency [Hz], 0 where a direction is held by nothing and nan at a saddle.
    """
    vector, matrix = float64[:], float64[:, :]
    inputs = (matrix, matrix, vector, vector, float64, float64, vector, matrix, int64[:], float64, vector, matrix)
    return guvectorize(
        [(*inputs, vector, vector)],
        "(m,c),(m,c),(m),(m),(),(),(c),(c,c),(f),(),(c),(c,c)->(f),()",
        cache=True,
    )(_modes)


def _modes(
    exits, anchors, axial_stiffness, rest_lengths, mass, gravity, center_of_mass, inertia, free, scale, position,
    rotation, eigenvalues, frequency,
):  # fmt: skip
    """One element of the gufunc."""
    K, M = np.zeros((6, 6)), np.zeros((6, 6))
    _stiffness(exits, anchors, axial_stiffness, rest_lengths, mass * gravity, center_of_mass, position, rotation, K)
    _inertia(mass, center_of_mass, inertia, rotation, M)
    n = len(free)
    on_free, reduced = np.empty((n, n)), np.empty((n, n))
    for a in range(n):
        for b in range(n):
            i, j = free[a], free[b]
            unit = (scale if i >= 3 else 1.0) * (scale if j >= 3 else 1.0)
            on_free[a, b] = K[i, j] / unit
            reduced[a, b] = M[i, j] / unit
    d, e = np.empty(n), np.empty(n)
    # K v = ω² M v is (L⁻¹ K L⁻ᵀ) w = ω² w with M = L Lᵀ.
    if _cholesky(reduced):
        L = reduced
        similar = on_free.copy()
        for side in range(2):
            for b in range(n):
                for a in range(n):
                    value = similar[a, b]
                    for c in range(a):
                        value -= L[a, c] * similar[c, b]
                    similar[a, b] = value / L[a, a]
            if side == 0:
                for a in range(n):
                    for b in range(a):
                        similar[a, b], similar[b, a] = similar[b, a], similar[a, b]
        _eigenvalues(similar, d, e)
        largest = max(abs(d[0]), abs(d[n - 1]))
        if d[0] > NEUTRAL * largest:
            frequency[0] = np.sqrt(d[0]) / (2 * np.pi)
        else:
            frequency[0] = 0.0 if d[0] >= -NEUTRAL * largest else np.nan
    else:
        frequency[0] = np.nan
    _eigenvalues(on_free, d, e)
    for a in range(n):
        eigenvalues[a] = d[a]


@_inline
def _stiffness(A, B, EA, l0, weight, com, p, R, K):
    """Fill in K = Σ (k − tau/l) Jᵀ J + (tau/l) DᵀD + tau [dipole] + the weight's part, as in ``statics``."""
    r, u, J = np.empty(3), np.empty(3), np.empty(6)
    for i in range(len(EA)):
        length2 = 0.0
        for a in range(3):
            r[a] = R[a, 0] * B[i, 0] + R[a, 1] * B[i, 1] + R[a, 2] * B[i, 2]
            u[a] = A[i, a] - p[a] - r[a]
            length2 += u[a] ** 2
        length = np.sqrt(length2)
        if length <= l0[i]:  # nan goes on, and comes out
            continue
        k = EA[i] / l0[i]
        tau = k * (length - l0[i])
        q = tau / length
        for a in range(3):
            u[a] /= length
            J[a] = -u[a]
        J[3], J[4], J[5] = r[2] * u[1] - r[1] * u[2], r[0] * u[2] - r[2] * u[0], r[1] * u[0] - r[0] * u[1]
        for a in range(6):
            for b in range(6):
                K[a, b] += (k - q) * J[a] * J[b]
        rr = r[0] ** 2 + r[1] ** 2 + r[2] ** 2
        for a in range(3):
            K[a, a] += q
            K[3 + a, 3 + a] += q * rr
            for b in range(3):
                K[3 + a, 3 + b] -= q * r[a] * r[b]
        for block in range(2):  # −[r]× above the diagonal, its transpose below
            a, b = (0, 3) if block == 0 else (3, 0)
            s = -q if block == 0 else q
            K[a + 0, b + 1] -= s * r[2]
            K[a + 0, b + 2] += s * r[1]
            K[a + 1, b + 0] += s * r[2]
            K[a + 1, b + 2] -= s * r[0]
            K[a + 2, b + 0] -= s * r[1]
            K[a + 2, b + 1] += s * r[0]
        for a in range(3):
            u[a] *= tau
        _add_dipole(u, r, K)
    for a in range(3):
        r[a] = R[a, 0] * com[0] + R[a, 1] * com[1] + R[a, 2] * com[2]
        u[a] = 0.0
    u[2] = -weight
    _add_dipole(u, r, K)


@_inline
def _add_dipole(f, r, K):
    """Add (f·r) 1 − ½ (f rᵀ + r fᵀ) to the rotations' block."""
    dot = f[0] * r[0] + f[1] * r[1] + f[2] * r[2]
    for a in range(3):
        K[3 + a, 3 + a] += dot
        for b in range(3):
            K[3 + a, 3 + b] -= 0.5 * (f[a] * r[b] + r[a] * f[b])


@_inline
def _inertia(mass, com, inertia, R, M):
    """Fill in M about the platform's origin, for velocity and angular velocity in the base frame."""
    c = np.empty(3)
    for a in range(3):
        c[a] = R[a, 0] * com[0] + R[a, 1] * com[1] + R[a, 2] * com[2]
    cc = c[0] ** 2 + c[1] ** 2 + c[2] ** 2
    for a in range(3):
        M[a, a] = mass
        M[3 + a, 3 + a] += mass * cc
        for b in range(3):
            M[3 + a, 3 + b] -= mass * c[a] * c[b]
            for i in range(3):
                for j in range(3):
                    M[3 + a, 3 + b] += R[a, i] * inertia[i, j] * R[b, j]
    M[0, 4] = M[4, 0] = mass * c[2]
    M[0, 5] = M[5, 0] = -mass * c[1]
    M[1, 3] = M[3, 1] = -mass * c[2]
    M[1, 5] = M[5, 1] = mass * c[0]
    M[2, 3] = M[3, 2] = mass * c[1]
    M[2, 4] = M[4, 2] = -mass * c[0]


@_inline
def _cholesky(L):
    """Cholesky factor in the lower half of L, in place; False where it is not positive definite."""
    for j in range(len(L)):
        for i in range(j, len(L)):
            value = L[i, j]
            for c in range(j):
                value -= L[i, c] * L[j, c]
            if i == j:
                if not value > 0:
                    return False
                L[j, j] = np.sqrt(value)
            else:
                L[i, j] = value / L[j, j]
    return True


@_inline
def _eigenvalues(S, d, e):
    """Eigenvalues of the symmetric S, which is overwritten, ascending into d; nan where it is not finite."""
    n = len(S)
    _tridiagonalise(S, d, e)
    for i in range(n):
        if not (np.isfinite(d[i]) and np.isfinite(e[i])):
            d[:] = np.nan
            return
    for first in range(n):
        for _ in range(QL_SWEEPS):
            last = first
            while last < n - 1:
                if abs(e[last]) <= np.finfo(np.float64).eps * (abs(d[last]) + abs(d[last + 1])):
                    break
                last += 1
            if last == first:
                break
            _ql_sweep(d, e, first, last)
    for i in range(1, n):  # insertion sort
        value, j = d[i], i
        while j > 0 and d[j - 1] > value:
            d[j] = d[j - 1]
            j -= 1
        d[j] = value


@_inline
def _tridiagonalise(S, d, e):
    """Householder reflections: diagonal d and, in e[:-1], the off-diagonal of a tridiagonal matrix similar to S."""
    n = len(S)
    v, w = np.empty(n), np.empty(n)
    for k in range(n - 2):
        norm2 = 0.0
        for i in range(k + 1, n):
            v[i] = S[i, k]
            norm2 += v[i] ** 2
        norm = np.sqrt(norm2)
        if norm == 0.0:
            e[k] = 0.0
            continue
        alpha = -norm if v[k + 1] > 0 else norm
        e[k] = alpha
        v[k + 1] -= alpha
        beta = 2.0 / (norm2 + v[k + 1] ** 2 - (v[k + 1] + alpha) ** 2)
        along = 0.0
        for i in range(k + 1, n):
            w[i] = 0.0
            for j in range(k + 1, n):
                w[i] += S[i, j] * v[j]
            w[i] *= beta
            along += w[i] * v[i]
        for i in range(k + 1, n):
            w[i] -= 0.5 * beta * along * v[i]
        for i in range(k + 1, n):
            for j in range(k + 1, n):
                S[i, j] -= v[i] * w[j] + w[i] * v[j]
    for i in range(n):
        d[i] = S[i, i]
    if n > 1:
        e[n - 2] = S[n - 1, n - 2]
    e[n - 1] = 0.0


@_inline
def _ql_sweep(d, e, first, last):
    """One implicit QL sweep with Wilkinson's shift over the unreduced block from ``first`` to ``last``."""
    g = (d[first + 1] - d[first]) / (2.0 * e[first])
    r = np.hypot(g, 1.0)
    g = d[last] - d[first] + e[first] / (g + (r if g >= 0 else -r))
    s, c, p = 1.0, 1.0, 0.0
    for i in range(last - 1, first - 1, -1):
        f, b = s * e[i], c * e[i]
        r = np.hypot(f, g)
        e[i + 1] = r
        if r == 0.0:
            d[i + 1] -= p
            e[last] = 0.0
            return
        s, c = f / r, g / r
        g = d[i + 1] - p
        r = (d[i] - g) * s + 2.0 * c * b
        p = s * r
        d[i + 1] = g + p
        g = c * r - b
    d[first] -= p
    e[first] = g
    e[last] = 0.0

"""Stiffness and natural frequencies at many equilibria: one compiled gufunc.

The stiffness matrix is that of ``forces``, the reference in its tests.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from cdpr_sim.core.compiling import inline, lent
from cdpr_sim.core.status import NEUTRAL
from cdpr_sim.statics import cable_kernel as ck
from cdpr_sim.statics.cable_kernel import SAGGING, TAU, E, K
from cdpr_sim.statics.matrix_kernel import Tridiagonal, eigenvalues_of, factorise
from cdpr_sim.statics.newton_kernel import matrix, memory, vector


class ModesScratch(NamedTuple):
    """Intermediate results of ``fill_modes``. K, M, S, A: (6, 6); d: eigenvalues (free)."""

    K: np.ndarray
    M: np.ndarray
    S: np.ndarray
    A: np.ndarray
    d: np.ndarray
    tridiagonal: Tridiagonal


def modes_of_all(
    table, rest_lengths, mass, gravity, center_of_mass, inertia, free, scale, heavy, position, rotation, scratch,
    eigenvalues, frequency,
):  # fmt: skip
    """Eigenvalues of the stiffness matrix and lowest natural frequency at (rows, columns) of poses."""
    rows, columns, m = rest_lengths.shape
    n = len(free)
    d, here, _, model, row = memory(scratch)
    scratch = lent(scratch)
    own = ModesScratch(
        matrix(scratch, row, 0, 6), matrix(scratch, row, 36, 6), matrix(scratch, row, 72, 6),
        matrix(scratch, row, 108, 6), vector(scratch, row, 144, n),
        Tridiagonal(vector(scratch, row, 150, n), vector(scratch, row, 156, n), vector(scratch, row, 162, n)),
    )  # fmt: skip
    inertia, free = lent(inertia), lent(free)
    for i in range(rows):
        for j in range(columns):
            cables, R = lent(table[i, j]), lent(rotation[i, j])
            kind = ck.load_table(d, cables)
            if heavy:
                kind = SAGGING
            ck.load_lengths(d, rest_lengths[i, j])
            ck.measure(d, cables, kind, lent(position[i, j]), R, here.s)
            frequency[i, j] = fill_modes(
                kind, here.s, model.w, m, mass[i, j], gravity, lent(center_of_mass[i, j]), inertia, free, scale[i, j],
                R, own,
            )  # fmt: skip
            for a in range(n):
                eigenvalues[i, j, a] = own.d[a]


@inline
def fill_modes(kind, s, w, m, mass, gravity, com, inertia, free, scale, R, own):
    """Fill in the eigenvalues at a pose whose cables have been measured; return the lowest frequency."""
    H, M, S, A, d = own.K, own.M, own.S, own.A, own.d
    n = len(free)
    for a in range(6):
        for b in range(6):
            H[a, b] = 0.0
    ck.fill_jacobian(s, scale, m, w)
    ck.add_weight_curvature(mass * gravity, com, R, scale, H)
    for i in range(m):
        w[TAU + i] = 0.0 if s[E + i] <= 0.0 else s[K + i] * s[E + i]  # lets nan through to the result
    ck.add_curvature(kind, s, scale, m, w, H)
    ck.add_springs(s, m, w, H, H)
    _fill_mass_matrix(mass, com, inertia, R, M)
    for a in range(n):
        for b in range(a + 1):
            i, j = free[a], free[b]
            S[a, b] = H[i, j]
            A[a, b] = M[i, j] / ((scale if i >= 3 else 1.0) * (scale if j >= 3 else 1.0))
    # K v = ω² M v is (L⁻¹ K L⁻ᵀ) w = ω² w with M = L Lᵀ.
    moved = factorise(A, n)
    lowest, largest = 0.0, 0.0
    if moved:
        _reduce(S, A, n)
        eigenvalues_of(S, own.tridiagonal, d)
        lowest, largest = d[0], max(abs(d[0]), abs(d[n - 1]))
    for a in range(n):
        for b in range(a + 1):
            S[a, b] = H[free[a], free[b]]
    eigenvalues_of(S, own.tridiagonal, d)
    rounding = NEUTRAL * largest
    if not (moved and lowest >= -rounding):
        return np.nan
    return math.sqrt(lowest) / (2 * math.pi) if lowest > rounding else 0.0


@inline
def _reduce(S, L, n):
    """Overwrite the lower half of S with that of C⁻¹ S C⁻ᵀ, column by column (LAPACK's DSYGS2).

    C is the Cholesky factor that overwrites the result L of ``factorise``.
    """
    for k in range(n):
        L[k, k] = 1 / math.sqrt(L[k, k])
        for i in range(k + 1, n):
            L[i, k] *= L[k, k]
    for k in range(n):
        S[k, k] /= L[k, k] * L[k, k]
        half = 0.5 * S[k, k]
        for i in range(k + 1, n):
            S[i, k] = S[i, k] / L[k, k] - half * L[i, k]
        for i in range(k + 1, n):
            for j in range(k + 1, i + 1):
                S[i, j] -= S[i, k] * L[j, k] + L[i, k] * S[j, k]
        for i in range(k + 1, n):
            value = S[i, k] - half * L[i, k]
            for c in range(k + 1, i):
                value -= L[i, c] * S[c, k]
            S[i, k] = value / L[i, i]


@inline
def _fill_mass_matrix(mass, com, inertia, R, M):
    """Fill in the lower half of the mass matrix about the platform's origin, for velocity and angular velocity.

    Both are in the base frame.
    """
    x = R[0, 0] * com[0] + R[0, 1] * com[1] + R[0, 2] * com[2]
    y = R[1, 0] * com[0] + R[1, 1] * com[1] + R[1, 2] * com[2]
    z = R[2, 0] * com[0] + R[2, 1] * com[1] + R[2, 2] * com[2]
    for a in range(6):
        for b in range(a + 1):
            M[a, b] = 0.0
    for a in range(3):
        M[a, a] += mass
        for j in range(3):
            turned = R[a, 0] * inertia[0, j] + R[a, 1] * inertia[1, j] + R[a, 2] * inertia[2, j]
            for b in range(a + 1):
                M[3 + a, 3 + b] += turned * R[b, j]
    M[3, 3] += mass * (y * y + z * z)
    M[4, 4] += mass * (x * x + z * z)
    M[5, 5] += mass * (x * x + y * y)
    M[4, 3] -= mass * x * y
    M[5, 3] -= mass * x * z
    M[5, 4] -= mass * y * z
    M[3, 1], M[3, 2] = -mass * z, mass * y
    M[4, 0], M[4, 2] = mass * z, -mass * x
    M[5, 0], M[5, 1] = -mass * y, mass * x

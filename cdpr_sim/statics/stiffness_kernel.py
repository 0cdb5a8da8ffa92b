"""Stiffness and natural frequencies at many equilibria: one compiled gufunc.

The stiffness matrix is that of ``forces``, the reference in its tests.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from cdpr_sim.core.compiling import HEAP, inline, matrix, nowhere, vector, where
from cdpr_sim.core.status import NEUTRAL
from cdpr_sim.statics import cable_kernel as ck
from cdpr_sim.statics.matrix_kernel import Tridiagonal, eigenvalues_of, factorise


class ModesScratch(NamedTuple):
    """Intermediate results of ``fill_modes``. J: (cables, 6); K, M: (6, 6); S, L: (free, 6); d: eigenvalues (free)."""

    J: np.ndarray
    K: np.ndarray
    M: np.ndarray
    S: np.ndarray
    L: np.ndarray
    d: np.ndarray
    tridiagonal: Tridiagonal


@inline
def new_scratch(room, springs, n):
    """Memory of these results."""
    return ModesScratch(
        matrix(room, springs, 6), matrix(room, 6, 6), matrix(room, 6, 6), matrix(room, n, 6), matrix(room, n, 6),
        vector(room, n), Tridiagonal(vector(room, n), vector(room, n), vector(room, n)),
    )  # fmt: skip


def element(new_cables: Callable) -> Callable:
    """An element of the gufunc, for cables of the type that ``new_cables`` makes."""

    def modes(
        table, rest_lengths, mass, gravity, center_of_mass, inertia, free, scale, position, rotation, eigenvalues,
        frequency,
    ):  # fmt: skip
        """Eigenvalues of the stiffness matrix, and the lowest frequency from it and the mass matrix."""
        cables, n = new_cables(HEAP, table), len(free)
        ck.load(cables, table, rest_lengths, ())
        state = ck.new_state(cables, HEAP)
        scratch = new_scratch(HEAP, len(state.e), n)
        ck.measure(cables, position, rotation, state)
        frequency[0] = fill_modes(state, mass, gravity, center_of_mass, inertia, free, scale, rotation, scratch)
        for a in range(n):
            eigenvalues[a] = scratch.d[a]

    return modes


@inline
def fill_modes(state, mass, gravity, com, inertia, free, scale, R, scratch):
    """Fill in the eigenvalues at a pose whose cables have been measured; return the lowest frequency."""
    J, K, M, S, L, d = scratch.J, scratch.K, scratch.M, scratch.S, scratch.L, scratch.d
    n = len(free)
    for a in range(6):
        for b in range(a + 1):
            K[a, b] = 0.0
    ck.fill_jacobian(state, scale, J)
    ck.add_weight_curvature(mass * gravity, com, R, scale, K)
    ck.add_stiffness(state, scale, K)
    for i in range(len(state.e)):
        pull = where(state.e[i] <= 0.0, 0.0, state.k[i] * state.e[i])  # lets nan through to the result
        if nowhere(pull != 0.0):
            continue
        q = ck.add_curvature(state, i, pull, 1 / scale, K)
        ck.add_along(where(state.e[i] > 0, state.k[i], 0.0) - q, J, i, K)
    _fill_mass_matrix(mass, com, inertia, R, M)
    for a in range(n):
        for b in range(a + 1):
            i, j = free[a], free[b]
            S[a, b] = K[i, j]
            L[a, b] = M[i, j] / ((scale if i >= 3 else 1.0) * (scale if j >= 3 else 1.0))
    # K v = ω² M v is (L⁻¹ K L⁻ᵀ) w = ω² w with M = L Lᵀ.
    moved = factorise(L, n)
    lowest, largest = 0.0 * mass, 0.0 * mass
    if not nowhere(moved):
        _reduce(S, L, n)
        eigenvalues_of(S, scratch.tridiagonal, d)
        lowest, largest = d[0], max(abs(d[0]), abs(d[n - 1]))
    for a in range(n):
        for b in range(a + 1):
            S[a, b] = K[free[a], free[b]]
    eigenvalues_of(S, scratch.tridiagonal, d)
    rounding = NEUTRAL * largest
    frequency = where(lowest > rounding, math.sqrt(max(lowest, 0.0)) / (2 * math.pi), 0.0)
    return where(moved & (lowest >= -rounding), frequency, np.nan)


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

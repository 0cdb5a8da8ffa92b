"""Stiffness and natural frequencies at many equilibria: one compiled gufunc.

The stiffness matrix is that of ``forces``, the reference in its tests.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from cdpr_sim.core.compiling import Kernel, inline
from cdpr_sim.core.status import NEUTRAL
from cdpr_sim.statics import cable_kernel as ck
from cdpr_sim.statics.matrix_kernel import eigenvalues_of, factorise


def _element(unpack: Callable) -> Callable:
    """An element of the gufunc, for cables of the type that ``unpack`` makes of the table."""

    def modes(
        table, rest_lengths, mass, gravity, center_of_mass, inertia, free, scale, position, rotation, eigenvalues,
        frequency,
    ):  # fmt: skip
        """Eigenvalues of the stiffness matrix, and the lowest frequency from it and the mass matrix."""
        cables = unpack(table, rest_lengths)
        K, M = np.zeros((6, 6)), np.zeros((6, 6))
        state = ck.new_state(cables)
        J = np.empty((len(state.e), 6))
        ck.measure(cables, position, rotation, state)
        ck.fill_jacobian(state, scale, J)
        ck.add_springs(state, J, K)
        ck.add_weight_curvature(mass * gravity, center_of_mass, rotation, scale, K)
        ck.add_stiffness(state, scale, K)
        for i in range(len(state.e)):
            if not state.e[i] <= 0:  # lets nan through to the result
                ck.add_curvature(state, i, state.k[i] * state.e[i], J, scale, K)
        _inertia(mass, center_of_mass, inertia, rotation, M)
        n = len(free)
        on_free, reduced = np.empty((n, n)), np.empty((n, n))
        for a in range(n):
            for b in range(n):
                i, j = free[a], free[b]
                on_free[a, b] = K[max(i, j), min(i, j)]
                reduced[a, b] = M[i, j] / ((scale if i >= 3 else 1.0) * (scale if j >= 3 else 1.0))
        d, e = np.empty(n), np.empty(n)
        # K v = ω² M v is (L⁻¹ K L⁻ᵀ) w = ω² w with M = L Lᵀ.
        if factorise(reduced, n):
            L = reduced
            similar = np.empty((n, n))
            for a in range(n):
                for b in range(n):
                    similar[a, b] = on_free[a, b]
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
            eigenvalues_of(similar, d, e)
            largest = max(abs(d[0]), abs(d[n - 1]))
            if d[0] > NEUTRAL * largest:
                frequency[0] = np.sqrt(d[0]) / (2 * np.pi)
            else:
                frequency[0] = 0.0 if d[0] >= -NEUTRAL * largest else np.nan
        else:
            frequency[0] = np.nan
        eigenvalues_of(on_free, d, e)
        for a in range(n):
            eigenvalues[a] = d[a]

    return modes


_KERNELS = ck.kernels(
    "stiffness and frequencies", _element, "(m,k),(m),(),(),(c),(c,c),(f),(),(c),(c,c)->(f),()", ("free",)
)


def stiffness_gufunc(*, bent: bool = False, sagging: bool = False, remembering: bool = False) -> Kernel:
    """Stiffness and lowest natural frequency, as a NumPy generalised ufunc.

    Arguments: ``Robot.cable_table`` (m,k), rest lengths (m), mass, gravity, centre of mass (3), inertia (3,3), indices
    of the free directions (f), characteristic length, position (3), rotation matrix (3,3).
    Results: eigenvalues of the stiffness matrix, ascending, rotations in characteristic lengths (f) [N/m]; the lowest
    natural frequency [Hz], 0 where a direction is unconstrained and nan at a saddle.
    """
    return _KERNELS[2 if sagging else 3 if remembering else bent]


@inline
def _inertia(mass, com, inertia, R, M):
    """Fill in the mass matrix M about the platform's origin, for velocity and angular velocity in the base frame."""
    c = np.empty(3)
    for a in range(3):
        c[a] = R[a, 0] * com[0] + R[a, 1] * com[1] + R[a, 2] * com[2]
    cc = c[0] * c[0] + c[1] * c[1] + c[2] * c[2]
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

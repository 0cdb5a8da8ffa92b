"""Symmetric matrices of up to six rows in compiled code: for them, the overhead of a LAPACK call exceeds the work."""

from __future__ import annotations

import math

import numpy as np

from cdpr_sim.core.compiling import inline, nowhere, where

PIVOT_ROUNDING = 1e-13
"""A Cholesky pivot smaller than this fraction of its diagonal entry is rounding, not stiffness."""

QL_SWEEPS = 50
"""Largest number of QL sweeps per eigenvalue; two or three suffice."""


@inline
def factorise(L, n):
    """Cholesky factor of the lower half of L, (n, n), in place; False where it is not positive definite."""
    definite = True
    for j in range(n):
        pivot = L[j, j]
        least = PIVOT_ROUNDING * abs(pivot)
        for c in range(j):
            pivot -= L[j, c] * L[j, c]
        definite &= pivot > least
        if nowhere(definite):
            return definite
        pivot = math.sqrt(where(definite, pivot, 1.0))
        L[j, j] = pivot
        for i in range(j + 1, n):
            entry = L[i, j]
            for c in range(j):
                entry -= L[i, c] * L[j, c]
            L[i, j] = entry / pivot
    return definite


@inline
def substitute(L, rhs, x):
    """Solve L Lᵀ x = rhs; x may be rhs itself."""
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


@inline
def eigenvalues_of(S, d, e):
    """Eigenvalues of the symmetric S, which is overwritten, ascending into d; nan where it is not finite."""
    n = len(S)
    _tridiagonalise(S, d, e)
    for i in range(n):
        if not (math.isfinite(d[i]) and math.isfinite(e[i])):
            for j in range(n):
                d[j] = np.nan
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


@inline
def _tridiagonalise(S, d, e):
    """Householder reflections: diagonal d and, in e[:-1], the off-diagonal of a tridiagonal matrix similar to S."""
    n = len(S)
    v, w = np.empty(n), np.empty(n)
    for k in range(n - 2):
        norm2 = 0.0
        for i in range(k + 1, n):
            v[i] = S[i, k]
            norm2 += v[i] * v[i]
        norm = math.sqrt(norm2)
        if norm == 0.0:
            e[k] = 0.0
            continue
        alpha = -norm if v[k + 1] > 0 else norm
        e[k] = alpha
        v[k + 1] -= alpha
        first, reflected = v[k + 1] + alpha, v[k + 1]
        beta = 2.0 / (norm2 + reflected * reflected - first * first)
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


@inline
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

"""Symmetric matrices of up to six rows in compiled code: for them, the overhead of a LAPACK call exceeds the work."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from cdpr_sim.core.compiling import inline, nowhere, where

PIVOT_ROUNDING = 1e-13
"""A Cholesky pivot smaller than this fraction of its diagonal entry is rounding, not stiffness."""

QL_SWEEPS = 50
"""Largest number of QL sweeps per eigenvalue; two or three suffice."""

ROUNDING = float(np.finfo(float).eps)
"""An off-diagonal entry smaller than this fraction of its neighbours on the diagonal is zero."""


class Tridiagonal(NamedTuple):
    """Intermediate results of ``eigenvalues_of``. e: squares off the diagonal; v, w: vectors of a reflection."""

    e: np.ndarray
    v: np.ndarray
    w: np.ndarray


@inline
def factorise(L, n):
    """Factors L D Lᵀ of the lower half of a matrix, (n, n), in place; False where it is not positive definite.

    Below the diagonal stands L, whose own diagonal is 1; on it the inverse of D; above it D Lᵀ. There are no square
    roots, and one division per row.
    """
    definite = True
    for j in range(n):
        pivot = L[j, j]
        least = PIVOT_ROUNDING * abs(pivot)
        for c in range(j):
            pivot -= L[j, c] * L[c, j]
        definite &= pivot > least
        if nowhere(definite):
            return definite
        L[j, j] = inverse = 1 / where(definite, pivot, 1.0)
        for i in range(j + 1, n):
            entry = L[i, j]
            for c in range(j):
                entry -= L[i, c] * L[c, j]
            L[j, i], L[i, j] = entry, entry * inverse
    return definite


@inline
def substitute(L, rhs, x):
    """Solve L D Lᵀ x = rhs with the result of ``factorise``; x may be rhs itself."""
    for i in range(6):
        value = rhs[i]
        for c in range(i):
            value -= L[i, c] * x[c]
        x[i] = value
    for i in range(5, -1, -1):
        value = x[i] * L[i, i]
        for c in range(i + 1, 6):
            value -= L[c, i] * x[c]
        x[i] = value


@inline
def eigenvalues_of(S, work, d):
    """Eigenvalues of the symmetric S, ascending into d; nan where S is not finite.

    S is overwritten, and only its lower half is read. QL without square roots: the method of Pal, Walker and Kahan, as
    in LAPACK's DSTERF (Parlett 1998, "The symmetric eigenvalue problem", chapter 8, doi:10.1137/1.9781611971163).
    Its error is a few roundings of the largest eigenvalue. A zero off the diagonal needs no case of its own, so that
    matrices on lanes keep the same pace.

    Args:
        S: (n, n).
        work: memory, a ``Tridiagonal`` of vectors (n).
        d: (n).
    """
    n, e = len(d), work.e
    _tridiagonalise(S, work, d)
    total = e[0]
    for i in range(n):
        total += d[i] + e[i]
    for first in range(n - 1):
        for _ in range(QL_SWEEPS):
            least = ROUNDING * (abs(d[first]) + abs(d[first + 1]))
            moves = e[first] > least * least
            if nowhere(moves):
                break
            _ql_sweep(d, e, first, moves)
    for last in range(1, n):  # insertion sort
        for i in range(last, 0, -1):
            d[i - 1], d[i] = min(d[i - 1], d[i]), max(d[i - 1], d[i])
    for i in range(n):
        d[i] = where(total - total == 0.0, d[i], np.nan)


@inline
def _tridiagonalise(S, work, d):
    """Householder reflections: diagonal d, and in e[:-1] the *squares* of the off-diagonal of a tridiagonal matrix."""
    n, e, v, w = len(d), work.e, work.v, work.w
    for k in range(n - 2):
        norm2 = 0.0
        for i in range(k + 1, n):
            v[i] = S[i, k]
            norm2 += v[i] * v[i]
        norm, first = math.sqrt(norm2), v[k + 1]
        e[k] = norm2
        v[k + 1] = where(first > 0.0, first + norm, first - norm)
        size = norm2 + norm * abs(first)  # half the square of v
        beta = where(size > 0.0, 1.0 / where(size > 0.0, size, 1.0), 0.0 * size)  # lets nan through
        along = 0.0
        for i in range(k + 1, n):
            w[i] = 0.0
            for j in range(k + 1, n):
                w[i] += S[max(i, j), min(i, j)] * v[j]
            w[i] *= beta
            along += w[i] * v[i]
        for i in range(k + 1, n):
            w[i] -= 0.5 * beta * along * v[i]
        for i in range(k + 1, n):
            for j in range(k + 1, i + 1):
                S[i, j] -= v[i] * w[j] + w[i] * v[j]
    for i in range(n):
        d[i] = S[i, i]
    if n > 1:
        e[n - 2] = S[n - 1, n - 2] * S[n - 1, n - 2]
    e[n - 1] = 0.0


@inline
def _ql_sweep(d, e, first, moves):
    """One QL sweep with Wilkinson's shift from the last row to ``first``, where ``moves``; e: squares."""
    n = len(d)
    root = math.sqrt(e[first])
    g = (d[first + 1] - d[first]) / (2.0 * root)
    r = math.sqrt(g * g + 1.0)
    shift = d[first] - root / (g + where(g >= 0, r, -r))
    c, s, gamma = 1.0, 0.0, d[n - 1] - shift
    p = gamma * gamma
    for i in range(n - 2, first - 1, -1):
        r = p + e[i]
        if i < n - 2:
            e[i + 1] = where(moves, s * r, e[i + 1])
        inverse, before, old = 1.0 / where(r > 0.0, r, 1.0), c, gamma
        c, s = where(r > 0.0, p * inverse, 1.0), e[i] * inverse
        gamma = c * (d[i] - shift) - s * old
        d[i + 1] = where(moves, old + (d[i] - gamma), d[i + 1])
        p = where(c > 0.0, gamma * gamma / where(c > 0.0, c, 1.0), before * e[i])
    e[first] = where(moves, s * p, e[first])
    d[first] = where(moves, shift + gamma, d[first])

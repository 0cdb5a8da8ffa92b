"""Roots of the net wrench, stable or not, by Levenberg-Marquardt with the exact slope; compiled.

Each start is one element of a gufunc. The formulas are those of ``newton_kernel``: with the cables that are taut at a
pose, its linear system is the stiffness matrix there and the net wrench.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from cdpr_sim.core.compiling import HEAP, inline, matrix, truths, vector
from cdpr_sim.statics import cable_kernel as ck
from cdpr_sim.statics.newton_kernel import (
    Case,
    copy_pose,
    fill_curvature,
    fill_slopes,
    fill_system,
    move,
    new_model,
    new_point,
    spring_tensions,
)

STEPS = 150
"""Largest number of steps per start."""

LONGEST = 2.0
"""Longest step, in characteristic lengths."""

LOWER, HIGHER = 0.1, 5.0
"""Factors of the damping after a step that leaves a smaller wrench, and after one that does not."""

LEAST_DAMPING, MOST_DAMPING = 1e-14, 1e8
"""Damping as a fraction of the mean of the squared slope's diagonal. With the first, a step is Newton's; above the
second, the search ends, in a minimum of the unbalanced force."""


def search(new_cables: Callable) -> Callable:
    """The search from one start, for cables of the type that ``new_cables`` makes."""

    def descend(
        table, rest_lengths, weight, center_of_mass, wrench, free, scale, enough, damping, start_position,
        start_rotation, position, rotation, unbalanced,
    ):  # fmt: skip
        """Steps that make the norm of the net wrench smaller, up to ``enough``."""
        cables = new_cables(HEAP, table)
        ck.load(cables, table, rest_lengths, ())
        case = Case(cables, weight, center_of_mass, wrench, free, scale)
        here, trial = new_point(HEAP, cables), new_point(HEAP, cables)
        springs = len(here.c.e)
        model = new_model(HEAP, springs)
        taut, tau, x = truths(HEAP, springs), vector(HEAP, springs), vector(HEAP, 6)
        slope, normal, gradient = matrix(HEAP, 6, 6), matrix(HEAP, 6, 6), vector(HEAP, 6)
        copy_pose(start_position, start_rotation, (), here.p, here.R, ())
        ck.measure(cables, here.p, here.R, here.c)
        size = fill_wrench(case, here, model, tau, taut)
        moved, share = True, damping
        for _ in range(STEPS):
            if not enough < size < np.inf or share > MOST_DAMPING:
                break
            if moved:
                fill_slope(case, here, model, tau, taut, slope, gradient)
            fill_step(case, slope, gradient, share, normal, x)
            move(case, here, x, trial)
            ck.measure(cables, trial.p, trial.R, trial.c)
            left = fill_wrench(case, trial, model, tau, taut)
            moved = left < size
            if moved:
                here, trial = trial, here
                size = left
                share = max(LOWER * share, LEAST_DAMPING)
            else:
                share *= HIGHER
        unbalanced[0] = size
        copy_pose(here.p, here.R, (), position, rotation, ())

    return descend


@inline
def fill_wrench(case, at, model, tau, taut):
    """Fill in the net wrench on the free directions at a measured pose, ``rhs``, and its parts; return its norm."""
    spring_tensions(at, tau, taut)
    fill_slopes(case, at, model)
    size = 0.0
    for a in range(6):
        model.rhs[a] = -model.g[a]
        for i in range(len(tau)):
            model.rhs[a] -= tau[i] * model.J[i, a]
        size += model.rhs[a] * model.rhs[a]
    return math.sqrt(size)


@inline
def fill_slope(case, at, model, tau, taut, slope, gradient):
    """Fill in the slope of the net wrench at the pose of ``fill_wrench``, and the gradient of half its square.

    The first is that of ``derivatives.wrench_slope``.
    """
    fill_curvature(case, at, tau, model)
    fill_system(at, model, 0.0, taut)
    for a in range(6):
        for b in range(a + 1):
            slope[a, b] = slope[b, a] = -model.L[a, b]
    # The Hessian is symmetric, but the torque turns with the platform.
    for a in range(3):
        b, c = (a + 1) % 3, (a + 2) % 3
        half = 0.5 * model.rhs[3 + a] / case.scale
        slope[3 + b, 3 + c] += half * case.free[3 + b] * case.free[3 + c]
        slope[3 + c, 3 + b] -= half * case.free[3 + b] * case.free[3 + c]
    for a in range(6):
        gradient[a] = 0.0
        for c in range(6):
            gradient[a] += model.rhs[c] * slope[c, a]


@inline
def fill_step(case, slope, gradient, share, normal, x):
    """Fill in the step x with this damping, no longer than ``LONGEST``."""
    free, damped, directions = case.free, 0.0, 0.0
    for a in range(6):
        x[a] = -gradient[a]
        for b in range(a, 6):
            normal[a, b] = 0.0
            for c in range(6):
                normal[a, b] += slope[c, a] * slope[c, b]
        damped += free[a] * normal[a, a]
        directions += free[a]
    for a in range(6):
        normal[a, a] += share * (damped / directions) + 1e-300
    _eliminate(normal, x)
    length = 0.0
    for a in range(6):
        x[a] *= free[a]
        length += x[a] * x[a]
    factor = min(1.0, LONGEST * case.scale / max(math.sqrt(length), 1e-300))
    for a in range(6):
        x[a] *= factor


@inline
def _eliminate(matrix, x):
    """Solve matrix x = x in place, by the upper half of the matrix, which is positive definite.

    Unlike ``factorise``, it accepts pivots that are rounding.
    """
    for c in range(6):
        matrix[c, c] = inverse = 1 / matrix[c, c]
        for a in range(c + 1, 6):
            factor = matrix[c, a] * inverse
            for b in range(a, 6):
                matrix[a, b] -= factor * matrix[c, b]
            x[a] -= factor * x[c]
    for a in range(5, -1, -1):
        for b in range(a + 1, 6):
            x[a] -= matrix[a, b] * x[b]
        x[a] *= matrix[a, a]

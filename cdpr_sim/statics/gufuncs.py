"""The compiled functions of many problems, as NumPy generalised ufuncs: one for each of ``cable_kernel.TYPES``.

Many problems of plain or bent cables are evaluated eight at a time: by the code of ``lanes_kernel``,
``lockstep_kernel`` and ``roots_lanes_kernel``, which are imported then, since they need Numba.
"""

from __future__ import annotations

import numpy as np

from cdpr_sim.core.compiling import Kernel
from cdpr_sim.core.status import Status
from cdpr_sim.statics import balance_kernel, cable_kernel, newton_kernel, roots_kernel, stiffness_kernel


def _solve_pending(kernel: Kernel, given: list[np.ndarray], results: list[np.ndarray]) -> None:
    """What the solver on lanes has left to the solver for one problem."""
    left = results[-1] == Status.PENDING
    if left.any():
        table, rest, weight, center, wrench, free, scale = (one if one.ndim == 1 else one[left] for one in given[:7])
        found = kernel.compiled(table, rest, weight, center, wrench, free, scale, *(one[left] for one in results[:2]))
        found[5][:] += results[5][left]
        for column, one in zip(results, found, strict=True):
            column[left] = one


EQUILIBRIA = cable_kernel.kernels(
    "static solver", newton_kernel.descent,
    "(m,k),(m),(),(c),(d),(d),(),(c),(c,c)->(c),(c,c),(m),(m),(),(),()", "lanes_kernel.solver",
    integers=("iterations", "status"), alike=("free",), finish=_solve_pending,
)  # fmt: skip
"""The solver.

Arguments: ``Robot.cable_table`` (m, k), rest lengths (m), weight, centre of mass (3), external wrench (6), free
directions as 0 or 1 (6), characteristic length, starting position (3), starting rotation matrix (3,3).
Results: position (3), rotation matrix (3,3), lengths of the massless paths (m), tensions at the anchors of all parts of
line (m), residual, iterations, status."""

ROOTS = cable_kernel.kernels(
    "search for saddles", roots_kernel.search,
    "(m,k),(m),(),(c),(d),(d),(),(),(),(c),(c,c)->(c),(c,c),()", "roots_lanes_kernel.search",
    alike=("table", "rest_lengths", "weight", "center_of_mass", "wrench", "free", "scale", "enough", "damping"),
)  # fmt: skip
"""The search for roots of the net wrench.

Arguments: ``Robot.cable_table`` (m, k), rest lengths (m), weight, centre of mass (3), external wrench without a torque
(6), free directions as 0 or 1 (6), characteristic length, norm of the net wrench that ends the search, damping of the
first step, starting position (3), starting rotation matrix (3,3).
Results: position (3), rotation matrix (3,3), norm of the net wrench there, torques per characteristic length. An anchor
may lie in its wheel there, where a cable has no path."""

STIFFNESSES = cable_kernel.kernels(
    "stiffness and frequencies", stiffness_kernel.element,
    "(m,k),(m),(),(),(c),(c,c),(f),(),(c),(c,c)->(f),()", "lockstep_kernel.modes",
    integers=("free",), alike=("gravity", "inertia", "free"),
)  # fmt: skip
"""Stiffness and lowest natural frequency.

Arguments: ``Robot.cable_table`` (m,k), rest lengths (m), mass, gravity, centre of mass (3), inertia (3,3), indices of
the free directions (f), characteristic length, position (3), rotation matrix (3,3).
Results: eigenvalues of the stiffness matrix, ascending, rotations in characteristic lengths (f) [N/m]; the lowest
natural frequency [Hz], 0 where a direction is unconstrained and nan at a saddle."""

_BALANCE = "(m,n),(m),(m),(),(c),(k,d),(f),(),(c),(c,c)->()"
SHORTFALLS = cable_kernel.kernels(
    "balance of forces", balance_kernel.shortfall, _BALANCE, "lockstep_kernel.shortfalls",
    integers=("free",), alike=("free",),
)  # fmt: skip
"""The unbalanced part of the load: inf where the active sets cycle, nan where the input is not finite."""

MARGINS = cable_kernel.kernels("margins of tensions", balance_kernel.margin, _BALANCE, integers=("free",))
"""The largest distance of tensions from limits [N]: nan for cycles and input that is not finite."""

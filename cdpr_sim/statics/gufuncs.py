"""The compiled functions of many problems. All inputs broadcast; results have a row for each problem.

Of each: ``Robot.cable_table`` (m, k), or that of ``MemoryLaw``; lengths in m, forces in N. ``heavy`` is 1 where cables
have mass that counts, else 0.
"""

from __future__ import annotations

from cdpr_sim.core.compiling import Kernel
from cdpr_sim.statics import balance_kernel, newton_kernel, roots_kernel, stiffness_kernel

EQUILIBRIA = Kernel(
    "static solver", newton_kernel.solve_all, "(m,k),(m),(),(c),(d),(d),(),(),(c),(c,c)->(c),(c,c),(m),(m),(),(),()",
    integers=("heavy", "iterations", "status"), alike=("free", "heavy"),
)  # fmt: skip
"""The solver.

Arguments: table, rest lengths (m), weight, centre of mass (3), external wrench (6), free directions as 0 or 1 (6),
characteristic length, heavy, starting position (3), starting rotation matrix (3,3). With ``heavy``, the search begins
with massless cables.
Results: position (3), rotation matrix (3,3), lengths of the massless paths (m), tensions at the anchors of all parts of
line (m), residual, iterations, status."""

ROOTS = Kernel(
    "search for saddles", roots_kernel.search_all, "(m,k),(m),(),(c),(d),(d),(),(),(),(),(c),(c,c)->(c),(c,c),()",
    integers=("heavy",),
    alike=(
        "table", "rest_lengths", "weight", "center_of_mass", "wrench", "free", "scale", "heavy", "enough", "damping"
    ),
)  # fmt: skip
"""The search for roots of the net wrench.

Arguments: table, rest lengths (m), weight, centre of mass (3), external wrench without a torque (6), free directions as
0 or 1 (6), characteristic length, heavy, norm of the net wrench that ends the search, damping of the first step,
starting position (3), starting rotation matrix (3,3).
Results: position (3), rotation matrix (3,3), norm of the net wrench there, torques per characteristic length. An anchor
may lie in its wheel there, where a cable has no path."""

STIFFNESSES = Kernel(
    "stiffness and frequencies", stiffness_kernel.modes_of_all,
    "(m,k),(m),(),(),(c),(c,c),(f),(),(),(c),(c,c)->(f),()", integers=("free", "heavy"),
    alike=("gravity", "inertia", "free", "heavy"),
)  # fmt: skip
"""Stiffness and lowest natural frequency.

Arguments: table, rest lengths (m), mass, gravity, centre of mass (3), inertia (3,3), indices of the free directions
(f), characteristic length, heavy, position (3), rotation matrix (3,3).
Results: eigenvalues of the stiffness matrix, ascending, rotations in characteristic lengths (f) [N/m]; the lowest
natural frequency [Hz], 0 where a direction is unconstrained and nan at a saddle."""

_BALANCE = "(m,n),(m),(m),(),(c),(k,d),(f),(),(c),(c,c)->()"
SHORTFALLS = Kernel(
    "balance of forces", balance_kernel.shortfalls, _BALANCE, integers=("free",), alike=("free",)
)  # fmt: skip
"""The unbalanced part of the load: inf where the active sets cycle, nan where the input is not finite.

Arguments: table, smallest and largest tensions (m), weight, centre of mass (3), external wrenches (k, 6), indices of
the free directions (f), characteristic length, position (3), rotation matrix (3,3)."""

MARGINS = Kernel("margins of tensions", balance_kernel.margins, _BALANCE, integers=("free",), alike=("free",))
"""The largest distance of tensions from limits [N]: nan for cycles and input that is not finite. Arguments as above."""

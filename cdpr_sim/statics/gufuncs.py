"""The compiled functions of many problems, as NumPy generalised ufuncs, by the type of cables.

Many problems of plain or bent cables are evaluated eight at a time: the functions of ``lanes_kernel`` and
``lockstep_kernel``, which are imported then, since they need Numba.
"""

from __future__ import annotations

from typing import Any

from cdpr_sim.core.compiling import Kernel
from cdpr_sim.statics import balance_kernel, cable_kernel, newton_kernel, roots_kernel, stiffness_kernel


def _equilibria_on_lanes(*given: Any) -> Any:
    from cdpr_sim.statics import lanes_kernel

    return lanes_kernel.solve(*given)


def _stiffness_on_lanes(bent: bool, _: Kernel, *given: Any) -> Any:
    from cdpr_sim.statics import lockstep_kernel

    return lockstep_kernel.modes(bent, *given)


def _shortfalls_on_lanes(bent: bool, _: Kernel, *given: Any) -> Any:
    from cdpr_sim.statics import lockstep_kernel

    return lockstep_kernel.shortfalls(bent, *given)


_EQUILIBRIA = cable_kernel.kernels(
    "static solver",
    newton_kernel.descent,
    "(m,k),(m),(),(c),(d),(d),(),(c),(c,c)->(c),(c,c),(m),(m),(),(),()",
    ("iterations", "status"),
    _equilibria_on_lanes,
    ("free",),
)


def _roots_on_lanes(bent: bool, _: Kernel, *given: Any) -> Any:
    from cdpr_sim.statics import roots_lanes_kernel

    return roots_lanes_kernel.search(bent, *given)


_ROOTS = cable_kernel.kernels(
    "search for saddles",
    roots_kernel.search,
    "(m,k),(m),(),(c),(d),(d),(),(),(),(c),(c,c)->(c),(c,c),()",
    (),
    _roots_on_lanes,
    ("table", "rest_lengths", "weight", "center_of_mass", "wrench", "free", "scale", "enough", "damping"),
)

_STIFFNESS = cable_kernel.kernels(
    "stiffness and frequencies",
    stiffness_kernel.element,
    "(m,k),(m),(),(),(c),(c,c),(f),(),(c),(c,c)->(f),()",
    ("free",),
    _stiffness_on_lanes,
    ("gravity", "inertia", "free"),
)

_BALANCE = "(m,n),(m),(m),(),(c),(k,d),(f),(),(c),(c,c)->()"
_SHORTFALLS = cable_kernel.kernels(
    "balance of forces", balance_kernel.shortfall, _BALANCE, ("free",), _shortfalls_on_lanes, ("free",)
)
_MARGINS = cable_kernel.kernels("margins of tensions", balance_kernel.margin, _BALANCE, ("free",))


def equilibrium_gufunc(*, bent: bool = False, sagging: bool = False, has_memory: bool = False) -> Kernel:
    """The solver as a NumPy generalised ufunc, for cables of one type (``cable_kernel``).

    Arguments: ``Robot.cable_table`` (m, k), rest lengths (m), weight, centre of mass (3), external wrench (6), free
    directions as 0 or 1 (6), characteristic length, starting position (3), starting rotation matrix (3,3).
    Results: position (3), rotation matrix (3,3), lengths of the massless paths (m), tensions at the anchors of all
    parts of line (m), residual, iterations, status.
    """
    return _EQUILIBRIA[2 if sagging else 3 if has_memory else bent]


def roots_gufunc(*, bent: bool = False, sagging: bool = False) -> Kernel:
    """The search for roots of the net wrench as a NumPy generalised ufunc, for cables of one type (``cable_kernel``).

    Arguments: ``Robot.cable_table`` (m, k), rest lengths (m), weight, centre of mass (3), external wrench without a
    torque (6), free directions as 0 or 1 (6), characteristic length, norm of the net wrench that ends the search,
    damping of the first step, starting position (3), starting rotation matrix (3,3).
    Results: position (3), rotation matrix (3,3), norm of the net wrench there, torques per characteristic length. An
    anchor may lie in its wheel there, where a cable has no path.
    """
    return _ROOTS[2 if sagging else bent]


def stiffness_gufunc(*, bent: bool = False, sagging: bool = False, has_memory: bool = False) -> Kernel:
    """Stiffness and lowest natural frequency, as a NumPy generalised ufunc.

    Arguments: ``Robot.cable_table`` (m,k), rest lengths (m), mass, gravity, centre of mass (3), inertia (3,3), indices
    of the free directions (f), characteristic length, position (3), rotation matrix (3,3).
    Results: eigenvalues of the stiffness matrix, ascending, rotations in characteristic lengths (f) [N/m]; the lowest
    natural frequency [Hz], 0 where a direction is unconstrained and nan at a saddle.
    """
    return _STIFFNESS[2 if sagging else 3 if has_memory else bent]


def shortfall_gufunc(*, bent: bool = False) -> Kernel:
    """Gufunc of the unbalanced part of the load: inf where the active sets cycle, nan where the input is not finite."""
    return _SHORTFALLS[bent]


def margin_gufunc(*, bent: bool = False) -> Kernel:
    """Gufunc of the largest distance of tensions from limits [N]: nan for cycles and input that is not finite."""
    return _MARGINS[bent]

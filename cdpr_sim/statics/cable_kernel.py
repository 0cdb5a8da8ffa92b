"""Cables in compiled code: their state at a pose, and their parts of the energy, its slope and its curvature.

Path and law are those of ``core.cable_path`` and ``core.cable_law``, compiled; the kernels have no other coding of
them. There are four types of cables: *plain* ones, straight and linear, are compiled separately so that they are as
fast as possible; *bent* ones run over pulleys or have nonlinear laws; *sagging* ones are ``any_cable``, some with mass;
ones *with memory* are bent ones, some with a memory (``memory_kernel``). Sagging ones are no
springs along their paths: their state has pulls and stiffness matrices, and no springs, so that loops over springs are
empty. Kernels are compiled once for each type.
Coordinates are (translation, left-applied rotation vector times ``scale``), six lengths.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from importlib import import_module
from typing import Any, NamedTuple

import numpy as np

from cdpr_sim.core import cable_law, cable_path
from cdpr_sim.core.cable import ANCHOR, AXIS, BEHIND, COLUMNS, EXIT, RADIUS, STIFFENING, STIFFNESS
from cdpr_sim.core.compiling import Kernel, by_type, inline, matrix, nowhere, outlined, vector, where
from cdpr_sim.statics.any_cable import any_cable, cable_of
from cdpr_sim.statics.memory_kernel import memory_spring

NO_LENGTH = np.finfo(float).tiny
"""[m] A slack cable whose anchor touches its exit has the direction 0, rather than 0/0."""


class Cables(NamedTuple):
    """Data of plain cables. A, B: exits, anchors; l0: rest lengths; k: axial stiffness per length that stretches."""

    A: np.ndarray
    B: np.ndarray
    l0: np.ndarray
    k: np.ndarray


class CableState(NamedTuple):
    """State of plain cables at a pose.

    r: arms of the anchors in the base frame; u: directions in which the cables pull; l: lengths; f: inverses of the
    lengths of their free segments; k, e: the tangent springs k max(e, 0) of the law.
    """

    r: np.ndarray
    u: np.ndarray
    l: np.ndarray  # noqa: E741
    f: np.ndarray
    k: np.ndarray
    e: np.ndarray


class BentCables(NamedTuple):
    """Data of cables that may run over pulleys and have nonlinear laws.

    A, B: exits, anchors; l0: rest lengths; k: axial stiffness per length that stretches; EA, a2, a3: coefficients of
    the law; whole: lengths that stretch, with what lies behind the exits; radius, axis: of the pulleys; table: that
    from which they come, of lanes the first one.
    """

    A: np.ndarray
    B: np.ndarray
    l0: np.ndarray
    k: np.ndarray
    EA: np.ndarray
    a2: np.ndarray
    a3: np.ndarray
    whole: np.ndarray
    radius: np.ndarray
    axis: np.ndarray
    table: np.ndarray


class BentState(NamedTuple):
    """State of bent cables at a pose.

    r: arms of the anchors in the base frame; u: directions in which the cables pull; l: lengths; f: inverses of the
    lengths of their free segments; across, bend, clear: of cables over pulleys, else 0; k, e: the tangent springs
    k max(e, 0) of the law; row: a row of scratch numbers, (1, 6).
    """

    r: np.ndarray
    u: np.ndarray
    l: np.ndarray  # noqa: E741
    f: np.ndarray
    across: np.ndarray
    bend: np.ndarray
    clear: np.ndarray
    k: np.ndarray
    e: np.ndarray
    row: np.ndarray


class SaggingCables(BentCables):
    """Data of cables of any kind."""


class CablesWithMemory(BentCables):
    """Data of massless cables of which some have a memory."""


class SaggingState(NamedTuple):
    """State of sagging cables at a pose.

    r: arms of the anchors in the base frame; pull: forces on the anchors; stiffness: xx, xy, yy, xz, yz, zz; l: lengths
    of the massless paths; energy; tension: at the anchors; clear: nan over a pulley without a path; u, k, e: of no
    springs.
    """

    r: np.ndarray
    pull: np.ndarray
    stiffness: np.ndarray
    l: np.ndarray  # noqa: E741
    energy: np.ndarray
    tension: np.ndarray
    clear: np.ndarray
    u: np.ndarray
    k: np.ndarray
    e: np.ndarray


@inline
def new_plain(room, table):
    """Plain cables, to be filled in by ``load``."""
    m = len(table)
    return Cables(matrix(room, m, 3), matrix(room, m, 3), vector(room, m), vector(room, m))


def _new(kind: type) -> Callable:
    """Makes that function for other cables."""

    @inline
    def new_cables(room, table):
        m = len(table)
        return kind(
            matrix(room, m, 3), matrix(room, m, 3), vector(room, m), vector(room, m), vector(room, m), vector(room, m),
            vector(room, m), vector(room, m), vector(room, m), matrix(room, m, 3), table,
        )  # fmt: skip

    new_cables.__qualname__ = f"new_{kind.__name__}"  # by which Numba names machine code
    return new_cables


@by_type
def load(cables, table, rest_lengths, lane):
    """Write the cables of one problem, on lanes into the lane (w,), otherwise (), from the table and rest lengths."""
    _load_plain(cables, table, rest_lengths, lane)


@load.of(BentCables, SaggingCables, CablesWithMemory)
def _load_bent(cables, table, rest_lengths, lane):
    _load_plain(cables, table, rest_lengths, lane)
    for i in range(len(rest_lengths)):
        at = (i, *lane)
        for a in range(3):
            cables.axis[(i, a, *lane)] = table[i, AXIS + a]
        cables.EA[at], cables.whole[at] = table[i, STIFFNESS], rest_lengths[i] + table[i, BEHIND]
        cables.a2[at], cables.a3[at] = table[i, STIFFENING], table[i, STIFFENING + 1]
        cables.radius[at] = table[i, RADIUS]


@inline
def _load_plain(cables, table, rest_lengths, lane):
    for i in range(len(rest_lengths)):
        at = (i, *lane)
        for a in range(3):
            cables.A[(i, a, *lane)], cables.B[(i, a, *lane)] = table[i, EXIT + a], table[i, ANCHOR + a]
        cables.l0[at] = rest_lengths[i]
        cables.k[at] = table[i, STIFFNESS] / (rest_lengths[i] + table[i, BEHIND])


TYPES = {
    "": new_plain,
    " for pulleys and nonlinear laws": _new(BentCables),
    " for cables with mass": _new(SaggingCables),
    " for cables with a memory": _new(CablesWithMemory),
}
"""By what follows the name of a kernel that is compiled for a type of cables."""

PLAIN, BENT, SAGGING, WITH_MEMORY = range(len(TYPES))
"""Their indices; of massless cables without a memory, the index is ``Cabling.bent``."""


def kernels(what: str, element: Callable, layout: str, lanes: str = "", **options: Any) -> list[Kernel]:
    """A kernel for each of ``TYPES``; ``element`` makes its code for one of them.

    Plain and bent cables are also evaluated on lanes, by the code that the function ``lanes`` makes, "module.function".
    Other options are those of ``compiling.Kernel``.
    """

    def on_lanes(new_cables: Callable) -> Callable:
        module, function = lanes.split(".")
        return getattr(import_module(f"cdpr_sim.statics.{module}"), function)(new_cables)

    return [
        Kernel(
            what + name, element(new_cables), layout, **options,
            lanes=partial(on_lanes, new_cables) if lanes and kind in (PLAIN, BENT) else None,
        )
        for kind, (name, new_cables) in enumerate(TYPES.items())
    ]  # fmt: skip


@by_type
def new_state(cables, room):
    """A state of the cables that is to be measured; the stiffness of plain ones is constant."""
    m = len(cables.l0)
    return CableState(
        matrix(room, m, 3), matrix(room, m, 3), vector(room, m), vector(room, m), cables.k, vector(room, m)
    )


@new_state.of(BentCables, CablesWithMemory)
def _new_bent_state(cables, room):
    m = len(cables.l0)
    return BentState(
        matrix(room, m, 3), matrix(room, m, 3), vector(room, m), vector(room, m), matrix(room, m, 3),
        vector(room, m), vector(room, m), vector(room, m), vector(room, m), matrix(room, 1, 6),
    )  # fmt: skip


@new_state.of(SaggingCables)
def _new_sagging_state(cables, room):
    m = len(cables.l0)
    return SaggingState(
        matrix(room, m, 3), matrix(room, m, 3), matrix(room, m, 6), vector(room, m), vector(room, m),
        vector(room, m), vector(room, m), matrix(room, 0, 3), vector(room, 0), vector(room, 0),
    )  # fmt: skip


@by_type
def _law(cables, i, stretch):
    """The tangent spring of cable i."""
    return cable_law.tangent(stretch, cables.whole[i], cables.EA[i], cables.a2[i], cables.a3[i])


@_law.of(CablesWithMemory)
def _memory_law(cables, i, stretch):
    k, e, _ = _memory_spring(cables, i, stretch)
    return k, e


@inline
def _memory_spring(cables, i, stretch):
    """The tangent spring of cable i with a memory, and its energy."""
    behind, row = cables.whole[i] - cables.l0[i], cables.table[i, COLUMNS:]
    return memory_spring(stretch, cables.l0[i], behind, cables.EA[i], cables.a2[i], cables.a3[i], row)


@by_type
def measure(cables, p, R, state):
    """Fill in the cables' state with the platform at p, R (paper Eq. 8, 9)."""
    A, B, l0 = cables.A, cables.B, cables.l0
    r, u, l, e = state.r, state.u, state.l, state.e  # noqa: E741
    for i in range(len(l0)):
        for a in range(3):
            r[i, a] = R[a, 0] * B[i, 0] + R[a, 1] * B[i, 1] + R[a, 2] * B[i, 2]
        length, x, y, z, free = cable_path.path(
            A[i, 0] - p[0] - r[i, 0], A[i, 1] - p[1] - r[i, 1], A[i, 2] - p[2] - r[i, 2]
        )
        inverse = 1 / max(free, NO_LENGTH)
        u[i, 0], u[i, 1], u[i, 2] = x * inverse, y * inverse, z * inverse
        l[i], state.f[i] = length, inverse
        e[i] = length - l0[i]


@measure.of(BentCables, CablesWithMemory)
def _measure_bent(cables, p, R, state):
    A, B, l0 = cables.A, cables.B, cables.l0
    r, u, l, e = state.r, state.u, state.l, state.e  # noqa: E741
    across, bend, clear = state.across, state.bend, state.clear
    for i in range(len(l0)):
        for a in range(3):
            r[i, a] = R[a, 0] * B[i, 0] + R[a, 1] * B[i, 1] + R[a, 2] * B[i, 2]
        x, y, z = A[i, 0] - p[0] - r[i, 0], A[i, 1] - p[1] - r[i, 1], A[i, 2] - p[2] - r[i, 2]
        length, u[i, 0], u[i, 1], u[i, 2], free = cable_path.path(x, y, z)
        for a in range(3):
            across[i, a] = 0.0
        bend[i], clear[i], wheel = 0.0, 0.0, cables.radius[i] > 0
        if not nowhere(wheel):
            ex, ey, ez = cables.axis[i, 0], cables.axis[i, 1], cables.axis[i, 2]
            over = cable_path.pulley_path(x, y, z, ex, ey, ez, cables.radius[i])
            length, free = where(wheel, over[0], length), where(wheel, over[4], free)
            for a in range(3):
                u[i, a], across[i, a] = where(wheel, over[1 + a], u[i, a]), where(wheel, over[5 + a], 0.0)
            bend[i], clear[i] = where(wheel, over[8], 0.0), where(wheel, over[10], 0.0)
        inverse = 1 / free
        for a in range(3):
            u[i, a] *= inverse
        l[i] = length
        state.k[i], e[i] = _law(cables, i, length - l0[i])
        state.f[i] = inverse


@measure.of(SaggingCables)
@outlined
def _measure_sagging(cables, p, R, state):
    A, B, r, f, k = cables.A, cables.B, state.r, state.pull, state.stiffness
    for i in range(len(cables.l0)):
        for a in range(3):
            r[i, a] = R[a, 0] * B[i, 0] + R[a, 1] * B[i, 1] + R[a, 2] * B[i, 2]
        x, y, z = p[0] + r[i, 0] - A[i, 0], p[1] + r[i, 1] - A[i, 1], p[2] + r[i, 2] - A[i, 2]
        (
            f[i, 0], f[i, 1], f[i, 2], k[i, 0], k[i, 1], k[i, 2], k[i, 3], k[i, 4], k[i, 5], state.energy[i], _,
            state.tension[i], state.l[i], state.clear[i],
        ) = any_cable(x, y, z, cable_of(cables.table[i], cables.l0[i]), cables.table[i, COLUMNS:])  # fmt: skip


@by_type
def elastic_energy(cables, state, V):
    """V and the energy of the cables."""
    for i in range(len(cables.l0)):
        if nowhere(state.e[i] > 0):
            continue
        V += where(state.e[i] > 0, cable_law.energy(state.l[i] - cables.l0[i], 1.0, cables.k[i], 0.0, 0.0), 0.0)
    return V


@elastic_energy.of(BentCables)
def _bent_energy(cables, state, V):
    for i in range(len(cables.l0)):
        pulls = (state.e[i] > 0) | (state.e[i] != state.e[i])  # nan without a path, which no step may lead to
        if nowhere(pulls):
            continue
        stretch = state.l[i] - cables.l0[i]
        V += where(pulls, cable_law.energy(stretch, cables.whole[i], cables.EA[i], cables.a2[i], cables.a3[i]), 0.0)
    return V


@elastic_energy.of(CablesWithMemory)
def _memory_energy(cables, state, V):
    for i in range(len(cables.l0)):
        if state.e[i] > 0 or state.e[i] != state.e[i]:
            _, _, energy = _memory_spring(cables, i, state.l[i] - cables.l0[i])
            V += energy
    return V


@elastic_energy.of(SaggingCables)
def _sagging_energy(cables, state, V):
    for i in range(len(cables.l0)):
        V += state.energy[i]
    return V


@by_type
def on_wheels(state):
    """Whether every cable has a path over its wheel."""
    return True


@on_wheels.of(BentState, SaggingState)
def _bent_on_wheels(state):
    on = True
    for i in range(len(state.clear)):
        on &= state.clear[i] >= 0  # nan inside the wheel
    return on


@by_type
def fill_tensions(cables, state, table, tensions):
    """Fill in the tensions at the anchors."""
    for i in range(len(tensions)):
        stretch = 0.0 if state.e[i] <= 0 else state.e[i]  # lets nan through to the result
        tensions[i] = table[i, STIFFNESS] * stretch / (cables.l0[i] + table[i, BEHIND])


@fill_tensions.of(BentCables, CablesWithMemory)
def _fill_bent_tensions(cables, state, table, tensions):
    for i in range(len(tensions)):
        tensions[i] = 0.0 if state.e[i] <= 0 else state.k[i] * state.e[i]


@fill_tensions.of(SaggingCables)
def _fill_sagging_tensions(cables, state, table, tensions):
    for i in range(len(tensions)):
        tensions[i] = state.tension[i]


@inline
def fill_jacobian(state, scale, J):
    """J = ∂l/∂x, (cables, 6): minus the columns of the wrench matrix (Eq. 4)."""
    r, u = state.r, state.u
    per_scale = 1 / scale
    for i in range(len(u)):
        J[i, 0], J[i, 1], J[i, 2] = -u[i, 0], -u[i, 1], -u[i, 2]
        x, y, z = r[i, 0] * per_scale, r[i, 1] * per_scale, r[i, 2] * per_scale
        J[i, 3] = z * u[i, 1] - y * u[i, 2]
        J[i, 4] = x * u[i, 2] - z * u[i, 0]
        J[i, 5] = y * u[i, 0] - x * u[i, 1]


@inline
def _add_plain_curvature(state, i, tau, per_scale, K):
    """The same for plain cables.

    ∂²l/∂x² = (DᵀD − J Jᵀ) f + bend (Dᵀb)(Dᵀb)ᵀ + uᵀ∂²d/∂x² with d = A − p − r, D = ∂d/∂x = [−1, [r]×], b across the
    wheel, and uᵀ∂²d/∂φ² = (u·r) 1 − ½ (u rᵀ + r uᵀ), for rotation vectors φ applied on the left. The part −q J Jᵀ is
    left out, since it is added with that of the spring (``add_along``).
    """
    r, u = state.r, state.u
    q = tau * state.f[i]
    x, y, z = r[i, 0] * per_scale, r[i, 1] * per_scale, r[i, 2] * per_scale
    K[0, 0] += q
    K[1, 1] += q
    K[2, 2] += q
    K[3, 1] -= q * z
    K[3, 2] += q * y
    K[4, 0] += q * z
    K[4, 2] -= q * x
    K[5, 0] -= q * y
    K[5, 1] += q * x
    K[3, 3] += q * (y * y + z * z)
    K[4, 4] += q * (x * x + z * z)
    K[5, 5] += q * (x * x + y * y)
    K[4, 3] -= q * x * y
    K[5, 3] -= q * x * z
    K[5, 4] -= q * y * z
    t = tau * per_scale
    _add_dipole(t * u[i, 0], t * u[i, 1], t * u[i, 2], x, y, z, K)
    return q


@by_type
def add_curvature(state, i, tau, per_scale, K):
    """Add tau ∂²l/∂x² + q J Jᵀ of cable i to the lower half of K, (6, 6); return q = tau f."""
    return _add_plain_curvature(state, i, tau, per_scale, K)


@add_curvature.of(BentState)
def _add_bent_curvature(state, i, tau, per_scale, K):
    if not nowhere(state.bend[i] != 0.0):
        x, y, z = state.r[i, 0] * per_scale, state.r[i, 1] * per_scale, state.r[i, 2] * per_scale
        b, row = state.across, state.row
        row[0, 0], row[0, 1], row[0, 2] = b[i, 0], b[i, 1], b[i, 2]
        row[0, 3] = y * b[i, 2] - z * b[i, 1]
        row[0, 4] = z * b[i, 0] - x * b[i, 2]
        row[0, 5] = x * b[i, 1] - y * b[i, 0]
        add_along(tau * state.bend[i], row, 0, K)
    return _add_plain_curvature(state, i, tau, per_scale, K)


@add_curvature.of(SaggingState)
def _add_no_curvature(state, i, tau, per_scale, K):
    return 0.0


@by_type
def add_stiffness(state, scale, K):
    """Add the curvature of all cables that are no springs to the lower half of K."""


@add_stiffness.of(SaggingState)
@outlined
def _add_sagging_stiffness(state, scale, K):
    """Add the curvature of the cables' energy, Dᵀ k D + [0, (f·r) 1 − ½ (f rᵀ + r fᵀ)] with D = [1, −[r]×]."""
    for i in range(len(state.l)):
        x, y, z = state.r[i, 0] / scale, state.r[i, 1] / scale, state.r[i, 2] / scale
        xx, xy, yy, xz, yz, zz = state.stiffness[i]
        K[0, 0] += xx
        K[1, 0] += xy
        K[1, 1] += yy
        K[2, 0] += xz
        K[2, 1] += yz
        K[2, 2] += zz
        # Columns of k D for rotations: k (e × r), of the axes e in turn.
        ax, ay, az = y * xz - z * xy, y * yz - z * yy, y * zz - z * yz
        bx, by, bz = z * xx - x * xz, z * xy - x * yz, z * xz - x * zz
        cx, cy, cz = x * xy - y * xx, x * yy - y * xy, x * yz - y * xz
        K[3, 0] += ax
        K[3, 1] += ay
        K[3, 2] += az
        K[4, 0] += bx
        K[4, 1] += by
        K[4, 2] += bz
        K[5, 0] += cx
        K[5, 1] += cy
        K[5, 2] += cz
        K[3, 3] += y * az - z * ay
        K[4, 3] += z * ax - x * az
        K[4, 4] += z * bx - x * bz
        K[5, 3] += x * ay - y * ax
        K[5, 4] += x * by - y * bx
        K[5, 5] += x * cy - y * cx
        _add_dipole(state.pull[i, 0] / scale, state.pull[i, 1] / scale, state.pull[i, 2] / scale, x, y, z, K)


@by_type
def subtract_pulls(state, scale, g):
    """Subtract from a slope the pulls of all cables that are no springs."""


@subtract_pulls.of(SaggingState)
def _subtract_sagging_pulls(state, scale, g):
    for i in range(len(state.l)):
        x, y, z = state.r[i, 0] / scale, state.r[i, 1] / scale, state.r[i, 2] / scale
        fx, fy, fz = state.pull[i, 0], state.pull[i, 1], state.pull[i, 2]
        g[0] -= fx
        g[1] -= fy
        g[2] -= fz
        g[3] -= y * fz - z * fy
        g[4] -= z * fx - x * fz
        g[5] -= x * fy - y * fx


@inline
def add_weight_curvature(weight, com, R, scale, K):
    """Add the curvature of m g z_com to the lower half of K."""
    x = (R[0, 0] * com[0] + R[0, 1] * com[1] + R[0, 2] * com[2]) / scale
    y = (R[1, 0] * com[0] + R[1, 1] * com[1] + R[1, 2] * com[2]) / scale
    z = (R[2, 0] * com[0] + R[2, 1] * com[1] + R[2, 2] * com[2]) / scale
    _add_dipole(0.0, 0.0, -weight / scale, x, y, z, K)


@inline
def add_springs(state, q, J, K):
    """Add Σ (k − q) J Jᵀ of all cables to the lower half of K, k of the taut ones only."""
    for i in range(len(state.e)):
        add_along(where(state.e[i] > 0, state.k[i], 0.0) - q[i], J, i, K)


@inline
def add_along(stiffness, J, i, K):
    """Add stiffness J Jᵀ of cable i to the lower half of K."""
    if nowhere(stiffness != 0.0):
        return
    for a in range(6):
        slope = stiffness * J[i, a]
        for b in range(a + 1):
            K[a, b] += slope * J[i, b]


@inline
def _add_dipole(fx, fy, fz, x, y, z, K):
    """Add (f·r) 1 − ½ (f rᵀ + r fᵀ) to the lower half of the rotations' block."""
    dot = fx * x + fy * y + fz * z
    K[3, 3] += dot - fx * x
    K[4, 4] += dot - fy * y
    K[5, 5] += dot - fz * z
    K[4, 3] -= 0.5 * (fx * y + fy * x)
    K[5, 3] -= 0.5 * (fx * z + fz * x)
    K[5, 4] -= 0.5 * (fy * z + fz * y)


# Loops, since Numba compiles whole-array expressions for seconds.


@inline
def mean(vector):
    """Mean of a vector's entries."""
    total = 0.0
    for i in range(len(vector)):
        total += vector[i]
    return total / len(vector)


@inline
def largest(vector):
    """Largest magnitude of a vector's entries; nan if one is nan."""
    most = 0.0
    for i in range(len(vector)):
        most = where((abs(vector[i]) > most) | (vector[i] != vector[i]), abs(vector[i]), most)
    return most

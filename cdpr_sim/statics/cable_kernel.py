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
from typing import NamedTuple

import numpy as np

from cdpr_sim.core import cable_law, cable_path
from cdpr_sim.core.cable import ANCHOR, AXIS, BEHIND, COLUMNS, EXIT, RADIUS, STIFFENING, STIFFNESS
from cdpr_sim.core.compiling import Kernel, by_type, inline, nowhere, outlined, where
from cdpr_sim.statics.any_cable import any_cable, cable_of, pulley_path
from cdpr_sim.statics.memory_kernel import memory_spring

_path = inline(cable_path.path)
inline(cable_law.stiffened)  # which the law calls
_energy = inline(cable_law.energy)
_tangent = inline(cable_law.tangent)

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
    the law; whole: lengths that stretch, with what lies behind the exits; radius, axis: of the pulleys.
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


class SaggingCables(NamedTuple):
    """Data of cables of any kind. A, B, l0, k: as of plain ones; table: ``Robot.cable_table``."""

    A: np.ndarray
    B: np.ndarray
    l0: np.ndarray
    k: np.ndarray
    table: np.ndarray


class CablesWithMemory(NamedTuple):
    """Data of massless cables of which some have a memory. As of bent ones; memory: rows of ``memory_kernel``."""

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
    memory: np.ndarray


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
def unpack(table, rest_lengths):
    """``Robot.cable_table`` and rest lengths, as arrays that are fast to read in compiled code."""
    m = len(rest_lengths)
    A, B, k = np.empty((m, 3)), np.empty((m, 3)), np.empty(m)
    for i in range(m):
        for a in range(3):
            A[i, a], B[i, a] = table[i, EXIT + a], table[i, ANCHOR + a]
        k[i] = table[i, STIFFNESS] / (rest_lengths[i] + table[i, BEHIND])
    return Cables(A, B, rest_lengths, k)


@inline
def unpack_bent(table, rest_lengths):
    """The same for bent cables."""
    m, plain = len(rest_lengths), unpack(table, rest_lengths)
    EA, a2, a3, radius, axis = np.empty(m), np.empty(m), np.empty(m), np.empty(m), np.empty((m, 3))
    whole = np.empty(m)
    for i in range(m):
        for a in range(3):
            axis[i, a] = table[i, AXIS + a]
        EA[i] = table[i, STIFFNESS]
        a2[i], a3[i] = table[i, STIFFENING], table[i, STIFFENING + 1]
        radius[i] = table[i, RADIUS]
        whole[i] = rest_lengths[i] + table[i, BEHIND]
    return BentCables(plain.A, plain.B, plain.l0, plain.k, EA, a2, a3, whole, radius, axis)


@inline
def unpack_sagging(table, rest_lengths):
    """The same for sagging cables."""
    plain = unpack(table, rest_lengths)
    rows = np.empty((len(rest_lengths), table.shape[1]))
    for i in range(len(rows)):
        for a in range(len(rows[i])):
            rows[i, a] = table[i, a]
    return SaggingCables(plain.A, plain.B, plain.l0, plain.k, rows)


@inline
def unpack_with_memory(table, rest_lengths):
    """The same for cables with a memory: their table has further columns (``memory_kernel``)."""
    bent, more = unpack_bent(table, rest_lengths), table.shape[1] - COLUMNS
    memory = np.empty((len(rest_lengths), more))
    for i in range(len(rest_lengths)):
        for a in range(more):
            memory[i, a] = table[i, COLUMNS + a]
    return CablesWithMemory(
        bent.A, bent.B, bent.l0, bent.k, bent.EA, bent.a2, bent.a3, bent.whole, bent.radius, bent.axis, memory
    )


TYPES = {
    "": unpack,
    " for pulleys and nonlinear laws": unpack_bent,
    " for cables with mass": unpack_sagging,
    " for cables with a memory": unpack_with_memory,
}
"""By what follows the name of a kernel that is compiled for a type of cables."""


def kernels(
    what: str, element: Callable, layout: str, integers: tuple[str, ...], many: Callable | None = None,
    alike: tuple[str, ...] = (),
) -> list[Kernel]:  # fmt: skip
    """A kernel for each of ``TYPES``; ``element`` makes its code for one ``unpack``.

    Plain and bent cables are also evaluated on lanes, by ``many`` with the inputs ``alike`` (``compiling.Kernel``); its
    first argument is whether they are bent.
    """
    on_lanes = {} if many is None else {unpack: partial(many, False), unpack_bent: partial(many, True)}
    return [
        Kernel(what + name, element(unpacked), layout, integers, on_lanes.get(unpacked), alike)
        for name, unpacked in TYPES.items()
    ]


def _new_plain_state(cables):
    """An empty state of plain cables; the stiffness is constant."""
    m = len(cables.l0)
    return CableState(np.empty((m, 3)), np.empty((m, 3)), np.empty(m), np.empty(m), cables.k, np.empty(m))


def _new_bent_state(cables):
    """An empty state of bent cables."""
    m = len(cables.l0)
    return BentState(
        np.empty((m, 3)), np.empty((m, 3)), np.empty(m), np.empty(m), np.empty((m, 3)), np.empty(m), np.empty(m),
        np.empty(m), np.empty(m), np.empty((1, 6)),
    )  # fmt: skip


def _new_sagging_state(cables):
    """An empty state of sagging cables."""
    m = len(cables.l0)
    return SaggingState(
        np.empty((m, 3)), np.empty((m, 3)), np.empty((m, 6)), np.empty(m), np.empty(m), np.empty(m), np.empty(m),
        np.empty((0, 3)), np.empty(0), np.empty(0),
    )  # fmt: skip


def _bent_law(cables, i, stretch):
    """The tangent spring of cable i."""
    return _tangent(stretch, cables.whole[i], cables.EA[i], cables.a2[i], cables.a3[i])


def _memory_law(cables, i, stretch):
    """The same, with a memory."""
    k, e, _ = _memory_spring(cables, i, stretch)
    return k, e


@inline
def _memory_spring(cables, i, stretch):
    """Its tangent spring, and its energy."""
    behind = cables.whole[i] - cables.l0[i]
    return memory_spring(stretch, cables.l0[i], behind, cables.EA[i], cables.a2[i], cables.a3[i], cables.memory[i])


_law = by_type({BentCables: _bent_law, CablesWithMemory: _memory_law})


def _measure_plain(cables, p, R, state):
    """Fill in the cables' state with the platform at p, R (paper Eq. 8, 9)."""
    A, B, l0 = cables.A, cables.B, cables.l0
    r, u, l, e = state.r, state.u, state.l, state.e  # noqa: E741
    for i in range(len(l0)):
        for a in range(3):
            r[i, a] = R[a, 0] * B[i, 0] + R[a, 1] * B[i, 1] + R[a, 2] * B[i, 2]
        length, x, y, z, free = _path(A[i, 0] - p[0] - r[i, 0], A[i, 1] - p[1] - r[i, 1], A[i, 2] - p[2] - r[i, 2])
        inverse = 1 / max(free, NO_LENGTH)
        u[i, 0], u[i, 1], u[i, 2] = x * inverse, y * inverse, z * inverse
        l[i], state.f[i] = length, inverse
        e[i] = length - l0[i]


def _measure_bent(cables, p, R, state):
    """Fill in the cables' state with the platform at p, R (paper Eq. 8, 9)."""
    A, B, l0 = cables.A, cables.B, cables.l0
    r, u, l, e = state.r, state.u, state.l, state.e  # noqa: E741
    across, bend, clear = state.across, state.bend, state.clear
    for i in range(len(l0)):
        for a in range(3):
            r[i, a] = R[a, 0] * B[i, 0] + R[a, 1] * B[i, 1] + R[a, 2] * B[i, 2]
        x, y, z = A[i, 0] - p[0] - r[i, 0], A[i, 1] - p[1] - r[i, 1], A[i, 2] - p[2] - r[i, 2]
        length, u[i, 0], u[i, 1], u[i, 2], free = _path(x, y, z)
        for a in range(3):
            across[i, a] = 0.0
        bend[i], clear[i], wheel = 0.0, 0.0, cables.radius[i] > 0
        if not nowhere(wheel):
            ex, ey, ez = cables.axis[i, 0], cables.axis[i, 1], cables.axis[i, 2]
            over = pulley_path(x, y, z, ex, ey, ez, cables.radius[i])
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


@outlined
def _measure_sagging(cables, p, R, state):
    """Fill in the cables' state with the platform at p, R."""
    A, B, r, f, k = cables.A, cables.B, state.r, state.pull, state.stiffness
    for i in range(len(cables.l0)):
        for a in range(3):
            r[i, a] = R[a, 0] * B[i, 0] + R[a, 1] * B[i, 1] + R[a, 2] * B[i, 2]
        x, y, z = p[0] + r[i, 0] - A[i, 0], p[1] + r[i, 1] - A[i, 1], p[2] + r[i, 2] - A[i, 2]
        (
            f[i, 0], f[i, 1], f[i, 2], k[i, 0], k[i, 1], k[i, 2], k[i, 3], k[i, 4], k[i, 5], state.energy[i], _,
            state.tension[i], state.l[i], state.clear[i],
        ) = any_cable(x, y, z, cable_of(cables.table[i], cables.l0[i]), cables.table[i, COLUMNS:])  # fmt: skip


def _plain_energy(cables, state, V):
    for i in range(len(cables.l0)):
        if nowhere(state.e[i] > 0):
            continue
        V += where(state.e[i] > 0, _energy(state.l[i] - cables.l0[i], 1.0, cables.k[i], 0.0, 0.0), 0.0)
    return V


def _bent_energy(cables, state, V):
    for i in range(len(cables.l0)):
        pulls = (state.e[i] > 0) | (state.e[i] != state.e[i])  # nan without a path, which no step may lead to
        if nowhere(pulls):
            continue
        stretch = state.l[i] - cables.l0[i]
        V += where(pulls, _energy(stretch, cables.whole[i], cables.EA[i], cables.a2[i], cables.a3[i]), 0.0)
    return V


def _memory_energy(cables, state, V):
    for i in range(len(cables.l0)):
        if state.e[i] > 0 or state.e[i] != state.e[i]:
            _, _, energy = _memory_spring(cables, i, state.l[i] - cables.l0[i])
            V += energy
    return V


def _sagging_energy(cables, state, V):
    for i in range(len(cables.l0)):
        V += state.energy[i]
    return V


def _plain_on_wheels(state):
    return True


def _bent_on_wheels(state):
    on = True
    for i in range(len(state.clear)):
        on &= state.clear[i] >= 0  # nan inside the wheel
    return on


def _all_springs(cables):
    return len(cables.l0)


def _no_springs(cables):
    return 0


def _fill_plain_tensions(cables, state, table, tensions):
    for i in range(len(tensions)):
        stretch = 0.0 if state.e[i] <= 0 else state.e[i]  # lets nan through to the result
        tensions[i] = table[i, STIFFNESS] * stretch / (cables.l0[i] + table[i, BEHIND])


def _fill_bent_tensions(cables, state, table, tensions):
    for i in range(len(tensions)):
        tensions[i] = 0.0 if state.e[i] <= 0 else state.k[i] * state.e[i]


def _fill_sagging_tensions(cables, state, table, tensions):
    for i in range(len(tensions)):
        tensions[i] = state.tension[i]


new_state = by_type(
    {
        Cables: _new_plain_state,
        BentCables: _new_bent_state,
        SaggingCables: _new_sagging_state,
        CablesWithMemory: _new_bent_state,
    }
)
measure = by_type(
    {
        Cables: _measure_plain,
        BentCables: _measure_bent,
        SaggingCables: _measure_sagging,
        CablesWithMemory: _measure_bent,
    }
)
elastic_energy = by_type(
    {
        Cables: _plain_energy,
        BentCables: _bent_energy,
        SaggingCables: _sagging_energy,
        CablesWithMemory: _memory_energy,
    }
)
springs = by_type(
    {Cables: _all_springs, BentCables: _all_springs, SaggingCables: _no_springs, CablesWithMemory: _all_springs}
)
fill_tensions = by_type(
    {
        Cables: _fill_plain_tensions,
        BentCables: _fill_bent_tensions,
        SaggingCables: _fill_sagging_tensions,
        CablesWithMemory: _fill_bent_tensions,
    }
)
on_wheels = by_type({CableState: _plain_on_wheels, BentState: _bent_on_wheels, SaggingState: _bent_on_wheels})


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
    """Add tau ∂²l/∂x² + q J Jᵀ of cable i to the lower half of K, (6, 6); return q = tau f.

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


def _add_no_curvature(state, i, tau, per_scale, K):
    return 0.0


add_curvature = by_type(
    {CableState: _add_plain_curvature, BentState: _add_bent_curvature, SaggingState: _add_no_curvature}
)


def _add_no_stiffness(state, scale, K):
    pass


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


add_stiffness = by_type(
    {CableState: _add_no_stiffness, BentState: _add_no_stiffness, SaggingState: _add_sagging_stiffness}
)
"""(state, scale, K): add the curvature of all cables that are no springs to the lower half of K."""


def _subtract_no_pulls(state, scale, g):
    pass


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


subtract_pulls = by_type(
    {CableState: _subtract_no_pulls, BentState: _subtract_no_pulls, SaggingState: _subtract_sagging_pulls}
)
"""(state, scale, g): subtract from a slope the pulls of all cables that are no springs."""


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

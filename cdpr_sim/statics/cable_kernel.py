"""Cables in compiled code: their state at a pose, and their parts of the energy, its slope and its curvature.

Path and law are those of ``core.cable_path`` and ``core.cable_law``, compiled; the kernels have no other coding of
them. One array has the numbers of all cables of one robot, whatever their kind: a row for each quantity, a column for
each cable. Row by row, the compiler computes two to eight cables at once, since loops over cables have no branch and
rows have a constant distance (``compiling.STRIDE``). A quantity is the index where its row begins: ``s[UX + i]`` is
that of cable i.

The *kind* of the cables is a number, by which whole loops are skipped: PLAIN cables are straight and linear; BENT ones,
some of them, run over pulleys or have nonlinear laws; those WITH_MEMORY have laws of ``memory_kernel``; SAGGING ones,
some of them, have mass. SAGGING cables are no springs along their paths: they have pulls and stiffness matrices
(``any_cable``), and the spring k max(e, 0) of each has k = 0 and e = −1.

Coordinates are (translation, left-applied rotation vector times ``scale``), six lengths.
"""

from __future__ import annotations

import math

import numpy as np

from cdpr_sim.core import cable_law, cable_path
from cdpr_sim.core.cable import ANCHOR, COLUMNS, EXIT, LAW, RADIUS, STIFFNESS, WHEEL
from cdpr_sim.core.compiling import STRIDE, inline, outlined
from cdpr_sim.statics.any_cable import added, any_cable, cable_of
from cdpr_sim.statics.memory_kernel import memory_spring

PLAIN, BENT, WITH_MEMORY, SAGGING = range(4)
"""Kinds of cables."""

NO_LENGTH = np.finfo(float).tiny
"""[m] A slack cable whose anchor touches its exit has the direction 0, rather than 0/0."""

AX, AY, AZ, BX, BY, BZ, L0, STIFF, WHOLE, ADDED, SIZE, EA = range(0, 12 * STRIDE, STRIDE)
RADII = EA + LAW * STRIDE
"""Data of cables: exits; anchors; rest lengths; axial stiffness per length that stretches; lengths that stretch; what
stretches besides the rest lengths; one number, the largest coordinate of an exit; the law, of which EA is the first
row; and the wheel, of which RADII is."""

RX, RY, RZ, UX, UY, UZ, L, F, K, E = range(0, 10 * STRIDE, STRIDE)
"""State at a pose: arms of the anchors in the base frame; directions in which the cables pull; lengths; inverses of the
lengths of their free segments; the tangent springs K max(E, 0) of the law."""

CX, CY, CZ, BEND, CLEAR = range(10 * STRIDE, 15 * STRIDE, STRIDE)
"""State of cables that are not plain: across, bend and clear of ``cable_path.pulley_path``, 0 without a wheel."""

PX, PY, PZ, XX, XY, YY, XZ, YZ, ZZ, ENERGY, TENSION = range(15 * STRIDE, 26 * STRIDE, STRIDE)
"""State of sagging cables: forces on the anchors, −∂/∂anchor of these, energy, and tension at the anchors."""

DATA_ROWS, STATE_ROWS = 11 + LAW + WHEEL, 26

J, ROW, TAU, Q, TAUT, PULL, WEIGHTS, PREDICTED = (STRIDE * row for row in (0, 6, 12, 13, 14, 15, 16, 17))
"""Rows of the local model: ∂l/∂x, six rows; six rows of scratch; tensions; q; 1 where taut; forces; weights of
products; predicted stretches."""

MODEL_ROWS = 18


@inline
def load_table(d, table):
    """Fill in the data of cables but for their lengths; return their kind, if they have no mass."""
    bent, size = False, 0.0
    for i in range(len(table)):
        d[AX + i], d[AY + i], d[AZ + i] = table[i, EXIT], table[i, EXIT + 1], table[i, EXIT + 2]
        d[BX + i], d[BY + i], d[BZ + i] = table[i, ANCHOR], table[i, ANCHOR + 1], table[i, ANCHOR + 2]
        for k in range(LAW):
            d[EA + k * STRIDE + i] = table[i, STIFFNESS + k]
        for k in range(WHEEL):
            d[RADII + k * STRIDE + i] = table[i, RADIUS + k]
        d[ADDED + i] = added(table[i])
        size = max(size, max(abs(d[AX + i]), max(abs(d[AY + i]), abs(d[AZ + i]))))
        bent |= d[RADII + i] > 0.0 or not cable_law.linear(law(d, i))
    d[SIZE] = size
    if table.shape[1] > COLUMNS:
        return WITH_MEMORY
    return BENT if bent else PLAIN


@inline
def law(d, i):
    """The law of cable i."""
    return cable_law.at(d, EA + i, STRIDE)


@inline
def load_lengths(d, rest_lengths):
    """Fill in rest lengths, and what follows from them."""
    for i in range(len(rest_lengths)):
        d[L0 + i], d[WHOLE + i] = rest_lengths[i], rest_lengths[i] + d[ADDED + i]
        d[STIFF + i] = d[EA + i] / d[WHOLE + i]


@inline
def measure(d, table, kind, p, R, s):
    """Fill in the cables' state s with the platform at p, R (paper Eq. 8, 9)."""
    m = len(table)
    px, py, pz = p[0], p[1], p[2]
    xx, xy, xz, yx, yy, yz, zx, zy, zz = (
        R[0, 0], R[0, 1], R[0, 2], R[1, 0], R[1, 1], R[1, 2], R[2, 0], R[2, 1], R[2, 2]
    )  # fmt: skip
    for i in range(m):
        bx, by, bz = d[BX + i], d[BY + i], d[BZ + i]
        rx, ry, rz = xx * bx + xy * by + xz * bz, yx * bx + yy * by + yz * bz, zx * bx + zy * by + zz * bz
        length, x, y, z, free = cable_path.path(d[AX + i] - px - rx, d[AY + i] - py - ry, d[AZ + i] - pz - rz)
        inverse = 1 / max(free, NO_LENGTH)
        s[RX + i], s[RY + i], s[RZ + i] = rx, ry, rz
        s[UX + i], s[UY + i], s[UZ + i] = x * inverse, y * inverse, z * inverse
        s[L + i], s[F + i] = length, inverse
        s[K + i], s[E + i] = d[STIFF + i], length - d[L0 + i]
    if kind == PLAIN:
        return
    if kind == SAGGING:
        _measure_sagging(d, table, px, py, pz, s)
        return
    wheels = 0.0
    for i in range(m):
        wheels += d[RADII + i]
        s[CX + i], s[CY + i], s[CZ + i], s[BEND + i], s[CLEAR + i] = 0.0, 0.0, 0.0, 0.0, 0.0
    if wheels > 0.0:
        for i in range(m):
            x, y, z = d[AX + i] - px - s[RX + i], d[AY + i] - py - s[RY + i], d[AZ + i] - pz - s[RZ + i]
            wheel = cable_path.wheel_at(d, RADII + i, STRIDE)
            length, x, y, z, free, cx, cy, cz, bend, _, clear = cable_path.pulley_path(x, y, z, wheel)
            over, inverse = d[RADII + i] > 0.0, 1 / free
            s[UX + i], s[UY + i], s[UZ + i] = (
                x * inverse if over else s[UX + i], y * inverse if over else s[UY + i],
                z * inverse if over else s[UZ + i],
            )  # fmt: skip
            s[L + i], s[F + i] = length if over else s[L + i], inverse if over else s[F + i]
            s[CX + i], s[CY + i], s[CZ + i] = cx if over else 0.0, cy if over else 0.0, cz if over else 0.0
            s[BEND + i], s[CLEAR + i] = bend if over else 0.0, clear if over else 0.0
    if kind == WITH_MEMORY:
        for i in range(m):
            s[K + i], s[E + i], _ = _memory_spring(d, table, i, s[L + i] - d[L0 + i])
        return
    for i in range(m):
        s[K + i], s[E + i] = cable_law.tangent(s[L + i] - d[L0 + i], d[WHOLE + i], law(d, i))


@outlined
def _measure_sagging(d, table, px, py, pz, s):
    for i in range(len(table)):
        x, y, z = px + s[RX + i] - d[AX + i], py + s[RY + i] - d[AY + i], pz + s[RZ + i] - d[AZ + i]
        (
            s[PX + i], s[PY + i], s[PZ + i], s[XX + i], s[XY + i], s[YY + i], s[XZ + i], s[YZ + i], s[ZZ + i],
            s[ENERGY + i], _, s[TENSION + i], s[L + i], s[CLEAR + i],
        ) = any_cable(x, y, z, cable_of(table[i], d[L0 + i]), table[i, COLUMNS:])  # fmt: skip
        s[K + i], s[E + i] = 0.0, -1.0


@outlined
def _memory_spring(d, table, i, stretch):
    """The tangent spring of cable i with a memory, and its energy."""
    cable = cable_of(table[i], d[L0 + i])
    return memory_spring(stretch, cable.rope, cable.behind, cable.law, table[i, COLUMNS:])


@inline
def energy(d, table, kind, s):
    """Energy of the cables; nan without a path, which no step may lead to."""
    m, total = len(table), 0.0
    if kind == PLAIN:
        for i in range(m):
            stretch = max(s[E + i], 0.0)
            total += 0.5 * s[K + i] * (stretch * stretch)
    elif kind == BENT:
        for i in range(m):
            # A slack cable's may be 0 times infinity.
            own = cable_law.energy(s[L + i] - d[L0 + i], d[WHOLE + i], law(d, i))
            total += 0.0 if s[E + i] <= 0.0 else own
    elif kind == WITH_MEMORY:
        for i in range(m):
            if not s[E + i] <= 0.0:
                _, _, own = _memory_spring(d, table, i, s[L + i] - d[L0 + i])
                total += own
    else:
        for i in range(m):
            total += s[ENERGY + i]
    return total


@inline
def on_wheels(kind, s, m):
    """Whether every cable has a path over its wheel."""
    off = 0
    if kind != PLAIN:
        for i in range(m):
            off += 0 if s[CLEAR + i] >= 0.0 else 1  # nan inside the wheel
    return off == 0


@inline
def tension(kind, s, i):
    """Tension of cable i at its anchor; nan where its stretch is."""
    if kind == SAGGING:
        return s[TENSION + i]
    return 0.0 if s[E + i] <= 0.0 else s[K + i] * s[E + i]


@inline
def fill_jacobian(s, scale, m, w):
    """Fill in ∂l/∂x: minus the columns of the wrench matrix (Eq. 4)."""
    per_scale = 1 / scale
    for i in range(m):
        ux, uy, uz = s[UX + i], s[UY + i], s[UZ + i]
        x, y, z = s[RX + i] * per_scale, s[RY + i] * per_scale, s[RZ + i] * per_scale
        w[J + i], w[J + STRIDE + i], w[J + 2 * STRIDE + i] = -ux, -uy, -uz
        w[J + 3 * STRIDE + i] = z * uy - y * uz
        w[J + 4 * STRIDE + i] = x * uz - z * ux
        w[J + 5 * STRIDE + i] = y * ux - x * uy


@inline
def add_forces(w, pull, m, g):
    """Add Jᵀ pull to g: the slope of forces along the cables, which begin at ``w[pull]``."""
    f0, f1, f2, f3, f4, f5 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for i in range(m):
        t = w[pull + i]
        f0 += t * w[J + i]
        f1 += t * w[J + STRIDE + i]
        f2 += t * w[J + 2 * STRIDE + i]
        f3 += t * w[J + 3 * STRIDE + i]
        f4 += t * w[J + 4 * STRIDE + i]
        f5 += t * w[J + 5 * STRIDE + i]
    g[0] += f0
    g[1] += f1
    g[2] += f2
    g[3] += f3
    g[4] += f4
    g[5] += f5


@inline
def add_products(w, rows, weights, m, H, A):
    """Fill in the lower half of A = H + Σ weight row rowᵀ of all cables, (6, 6), of six rows that begin at ``w[rows]``.

    Two rows of A at a time: seven sums, which fit into the processor's registers.
    """
    a, b = 0.0, 0.0
    h0, h1, h2, h3, h4, h5 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for i in range(m):
        j0, j1, j2 = w[rows + i], w[rows + STRIDE + i], w[rows + 2 * STRIDE + i]
        j3, j4, j5 = w[rows + 3 * STRIDE + i], w[rows + 4 * STRIDE + i], w[rows + 5 * STRIDE + i]
        a += w[weights + i] * j0 * j0
        t = w[weights + i] * j5
        h0 += t * j0
        h1 += t * j1
        h2 += t * j2
        h3 += t * j3
        h4 += t * j4
        h5 += t * j5
    A[0, 0] = H[0, 0] + a
    A[5, 0], A[5, 1], A[5, 2] = H[5, 0] + h0, H[5, 1] + h1, H[5, 2] + h2
    A[5, 3], A[5, 4], A[5, 5] = H[5, 3] + h3, H[5, 4] + h4, H[5, 5] + h5
    a, b = 0.0, 0.0
    h0, h1, h2, h3, h4 = 0.0, 0.0, 0.0, 0.0, 0.0
    for i in range(m):
        j0, j1, j2 = w[rows + i], w[rows + STRIDE + i], w[rows + 2 * STRIDE + i]
        j3, j4 = w[rows + 3 * STRIDE + i], w[rows + 4 * STRIDE + i]
        t, u = w[weights + i] * j4, w[weights + i] * j1
        a += u * j0
        b += u * j1
        h0 += t * j0
        h1 += t * j1
        h2 += t * j2
        h3 += t * j3
        h4 += t * j4
    A[1, 0], A[1, 1] = H[1, 0] + a, H[1, 1] + b
    A[4, 0], A[4, 1], A[4, 2] = H[4, 0] + h0, H[4, 1] + h1, H[4, 2] + h2
    A[4, 3], A[4, 4] = H[4, 3] + h3, H[4, 4] + h4
    a, b, c = 0.0, 0.0, 0.0
    h0, h1, h2, h3 = 0.0, 0.0, 0.0, 0.0
    for i in range(m):
        j0, j1, j2, j3 = w[rows + i], w[rows + STRIDE + i], w[rows + 2 * STRIDE + i], w[rows + 3 * STRIDE + i]
        t, u = w[weights + i] * j3, w[weights + i] * j2
        a += u * j0
        b += u * j1
        c += u * j2
        h0 += t * j0
        h1 += t * j1
        h2 += t * j2
        h3 += t * j3
    A[2, 0], A[2, 1], A[2, 2] = H[2, 0] + a, H[2, 1] + b, H[2, 2] + c
    A[3, 0], A[3, 1], A[3, 2], A[3, 3] = H[3, 0] + h0, H[3, 1] + h1, H[3, 2] + h2, H[3, 3] + h3


@inline
def add_curvature(kind, s, scale, m, w, H):
    """Add Σ tau ∂²l/∂x² + q J Jᵀ to the lower half of H, (6, 6); fill in q = tau f. tau and q are rows of w.

    ∂²l/∂x² = (DᵀD − J Jᵀ) f + bend (Dᵀb)(Dᵀb)ᵀ + uᵀ∂²d/∂x² with d = A − p − r, D = ∂d/∂x = [−1, [r]×], b across the
    wheel, and uᵀ∂²d/∂φ² = (u·r) 1 − ½ (u rᵀ + r uᵀ), for rotation vectors φ applied on the left. The part −q J Jᵀ is
    left out, since it is added with that of the spring (``add_products``). SAGGING cables have DᵀkD in its place.
    """
    per_scale = 1 / scale
    if kind == SAGGING:
        for i in range(m):
            w[Q + i] = 0.0
        _add_sagging_curvature(s, per_scale, m, H)
        return
    h0, hx, hy, hz = 0.0, 0.0, 0.0, 0.0
    h33, h44, h55, h43, h53, h54 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for i in range(m):
        tau = w[TAU + i]
        q, t = tau * s[F + i], tau * per_scale
        w[Q + i] = q
        x, y, z = s[RX + i] * per_scale, s[RY + i] * per_scale, s[RZ + i] * per_scale
        fx, fy, fz = t * s[UX + i], t * s[UY + i], t * s[UZ + i]
        h0 += q
        hx += q * x
        hy += q * y
        hz += q * z
        h33 += (q * y + fy) * y + (q * z + fz) * z
        h44 += (q * x + fx) * x + (q * z + fz) * z
        h55 += (q * x + fx) * x + (q * y + fy) * y
        h43 += q * x * y + 0.5 * (fx * y + fy * x)
        h53 += q * x * z + 0.5 * (fx * z + fz * x)
        h54 += q * y * z + 0.5 * (fy * z + fz * y)
    H[0, 0] += h0
    H[1, 1] += h0
    H[2, 2] += h0
    H[3, 1] -= hz
    H[3, 2] += hy
    H[4, 0] += hz
    H[4, 2] -= hx
    H[5, 0] -= hy
    H[5, 1] += hx
    H[3, 3] += h33
    H[4, 4] += h44
    H[5, 5] += h55
    H[4, 3] -= h43
    H[5, 3] -= h53
    H[5, 4] -= h54
    if kind == PLAIN:
        return
    bends = 0.0
    for i in range(m):
        bends += abs(w[TAU + i] * s[BEND + i])
    if bends == 0.0:
        return
    for i in range(m):
        x, y, z = s[RX + i] * per_scale, s[RY + i] * per_scale, s[RZ + i] * per_scale
        bx, by, bz = s[CX + i], s[CY + i], s[CZ + i]
        w[ROW + i], w[ROW + STRIDE + i], w[ROW + 2 * STRIDE + i] = bx, by, bz
        w[ROW + 3 * STRIDE + i], w[ROW + 4 * STRIDE + i] = y * bz - z * by, z * bx - x * bz
        w[ROW + 5 * STRIDE + i], w[WEIGHTS + i] = x * by - y * bx, w[TAU + i] * s[BEND + i]
    add_products(w, ROW, WEIGHTS, m, H, H)


@outlined
def _add_sagging_curvature(s, per_scale, m, H):
    """Add the curvature of the cables' energy, Dᵀ k D + [0, (f·r) 1 − ½ (f rᵀ + r fᵀ)] with D = [1, −[r]×]."""
    for i in range(m):
        x, y, z = s[RX + i] * per_scale, s[RY + i] * per_scale, s[RZ + i] * per_scale
        xx, xy, yy, xz, yz, zz = s[XX + i], s[XY + i], s[YY + i], s[XZ + i], s[YZ + i], s[ZZ + i]
        H[0, 0] += xx
        H[1, 0] += xy
        H[1, 1] += yy
        H[2, 0] += xz
        H[2, 1] += yz
        H[2, 2] += zz
        # Columns of k D for rotations: k (e × r), of the axes e in turn.
        ax, ay, az = y * xz - z * xy, y * yz - z * yy, y * zz - z * yz
        bx, by, bz = z * xx - x * xz, z * xy - x * yz, z * xz - x * zz
        cx, cy, cz = x * xy - y * xx, x * yy - y * xy, x * yz - y * xz
        H[3, 0] += ax
        H[3, 1] += ay
        H[3, 2] += az
        H[4, 0] += bx
        H[4, 1] += by
        H[4, 2] += bz
        H[5, 0] += cx
        H[5, 1] += cy
        H[5, 2] += cz
        H[3, 3] += y * az - z * ay
        H[4, 3] += z * ax - x * az
        H[4, 4] += z * bx - x * bz
        H[5, 3] += x * ay - y * ax
        H[5, 4] += x * by - y * bx
        H[5, 5] += x * cy - y * cx
        add_dipole(s[PX + i] * per_scale, s[PY + i] * per_scale, s[PZ + i] * per_scale, x, y, z, H)


@outlined
def subtract_pulls(s, scale, m, g):
    """Subtract from a slope the pulls of SAGGING cables."""
    for i in range(m):
        x, y, z = s[RX + i] / scale, s[RY + i] / scale, s[RZ + i] / scale
        fx, fy, fz = s[PX + i], s[PY + i], s[PZ + i]
        g[0] -= fx
        g[1] -= fy
        g[2] -= fz
        g[3] -= y * fz - z * fy
        g[4] -= z * fx - x * fz
        g[5] -= x * fy - y * fx


@inline
def add_weight_curvature(weight, com, R, scale, H):
    """Add the curvature of m g z_com to the lower half of H."""
    x = (R[0, 0] * com[0] + R[0, 1] * com[1] + R[0, 2] * com[2]) / scale
    y = (R[1, 0] * com[0] + R[1, 1] * com[1] + R[1, 2] * com[2]) / scale
    z = (R[2, 0] * com[0] + R[2, 1] * com[1] + R[2, 2] * com[2]) / scale
    add_dipole(0.0, 0.0, -weight / scale, x, y, z, H)


@inline
def add_springs(s, m, w, H, A):
    """Fill in the lower half of A = H + Σ (k − q) J Jᵀ of all cables, k of the taut ones only."""
    for i in range(m):
        w[WEIGHTS + i] = (s[K + i] if s[E + i] > 0.0 else 0.0) - w[Q + i]
    add_products(w, J, WEIGHTS, m, H, A)


@inline
def add_dipole(fx, fy, fz, x, y, z, H):
    """Add (f·r) 1 − ½ (f rᵀ + r fᵀ) to the lower half of the rotations' block."""
    dot = fx * x + fy * y + fz * z
    H[3, 3] += dot - fx * x
    H[4, 4] += dot - fy * y
    H[5, 5] += dot - fz * z
    H[4, 3] -= 0.5 * (fx * y + fy * x)
    H[5, 3] -= 0.5 * (fx * z + fz * x)
    H[5, 4] -= 0.5 * (fy * z + fz * y)


@inline
def mean(numbers, first, m):
    """Mean of a row."""
    total = 0.0
    for i in range(m):
        total += numbers[first + i]
    return total / m


@inline
def largest(numbers, first, m):
    """Largest magnitude in a row; nan if one is nan."""
    most, total = 0.0, 0.0
    for i in range(m):
        most = max(most, abs(numbers[first + i]))
        total += numbers[first + i]
    return most if total == total else math.nan

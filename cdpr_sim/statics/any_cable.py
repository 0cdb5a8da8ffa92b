"""One cable of any kind: over a wheel or a point, with mass or without, linear or not; compiled.

A cable runs from its exit A over a swivelling wheel of radius r with axis e (r = 0: a point) to its anchor B. The first
part of its rest length L0, ``wrapped``, is massless, and the last, ``rigid``, at the anchor, massless and rigid. The
rest, L = L0 − wrapped − rigid, weighs w per length. ``wrapped`` is about what lies on the wheel. It does not change
with the pose, so that the pull is the slope of an energy. Behind the exit lies a length c of the same cable, which
stretches too. Several parts of line are one cable here (``Cabling.behind``). The law is tau(eps) of
``core.cable_law``.

Let t be the tension vector where weight begins, along the cable, with T = |t| and u = t/T. Complementary energy has t
as its unknown. With G = wrapped + c, psi(eps) = ∫tau d eps, its conjugate psi*(T) = T (1 + eps) − psi, the angle theta
between u and e, the unit vector n across e in the wheel's plane (u = sin theta n + cos theta e), and b = e × n,

    Psi(t) = G psi*(T) − c T − r T (theta − sin theta) + ∫ psi*(|t + w s up|) ds over s from 0 to L
             + rigid |t + w L up|,
    B − A = ∂Psi/∂t = r [(1 − cos theta) n + sin theta e] + f u + (span of the free part, and of the rigid one),
    ∂²Psi/∂t² = G eps'(T) u uᵀ + f/T (1 − u uᵀ) + r/T tan(theta/2) b bᵀ + (compliance of both),

where f = wrapped + G eps − r theta. Psi is convex where the wheel can hold the cable, 0 < theta < pi. The cable's
stiffness is the inverse of this Hessian, and its energy is t·(B − A) − Psi + w L z_B.

The free part of a linear cable is the catenary of ``catenary``, which takes its span and returns t. A nonlinear law is
replaced there by the line that touches it at a tension near. Gauss's rule sums what the line misses; it converges
fast, since a cable that sags much pulls little. So the unknown of the iteration is the span of the free part; Newton's
method takes three or four steps.

An exit that gives way moves by d = C t (``Robot.exit_compliance``): a term ½ tᵀC t more of Psi. Of all cables, d is the
least of ½ dᵀC⁻¹d plus the cable's energy with its exit there. Newton's method has it as its unknown, and begins at that
of a massless cable; all else is that of a cable from the moved exit. The stiffness is (K⁻¹ + C)⁻¹ with K its own.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from numpy.typing import ArrayLike

from cdpr_sim.core import cable_law
from cdpr_sim.core.cable import BEHIND, COLUMNS, GIVES, RADIUS, RIGID, STIFFNESS, WEIGHT, WRAPPED
from cdpr_sim.core.cable_path import pulley_path, wheel_at, wrap_angle
from cdpr_sim.core.compiling import Kernel, inline, outlined
from cdpr_sim.statics.catenary import elastic_catenary
from cdpr_sim.statics.memory_kernel import ELASTIC, KIND, memory_spring, strain_of, stretch_at_exit

MAX_STEPS = 100
"""Newton steps: three or four do, seven nearly always."""

FULL_STEPS = 7
"""After these, a step that does not come nearer is shortened."""

SHORTENED, LEAST_FRACTION = 0.4, 1e-4
"""By how much, and the shortest part of a step that is tried."""

SOLVED = 1e-15
"""Where the cable's end misses its anchor by this fraction of its length, nothing is left but rounding."""

NEARLY_SOLVED = 1e-11
"""Where steps of this fraction do not get shorter any more, rounding keeps them so."""

FIRST_STEPS = 8
"""Newton steps for the first move of an exit."""

LEAST_FALL = 0.9
"""A step of an exit is shortened if its slope is more than this fraction of the slope before it, up or down."""

HALF_ROUND = -1 + 1e-8
"""Cosine of the angle on its wheel from which a cable with mass counts as off it: half round, it has no path."""

NODES, WEIGHTS = np.polynomial.legendre.leggauss(8)
NODES, WEIGHTS = (NODES + 1) / 2, WEIGHTS / 2


class Catenary(NamedTuple):
    """State of a cable, or of many.

    Attributes:
        pull: force on the anchor, base frame, (..., 3) [N].
        stiffness: −∂pull/∂anchor, symmetric, (..., 3, 3) [N/m].
        energy: energy of stretch and of the cable's own weight, which is 0 at height 0, (...) [J].
        exit_tension: tension at the exit, (...) [N].
        anchor_tension: tension at the anchor, the platform's end, (...) [N].
        moved: by how much the exit has moved, base frame, (..., 3) [m].
    """

    pull: Float[np.ndarray, "*batch 3"]
    stiffness: Float[np.ndarray, "*batch 3 3"]
    energy: Float[np.ndarray, "*batch"]
    exit_tension: Float[np.ndarray, "*batch"]
    anchor_tension: Float[np.ndarray, "*batch"]
    moved: Float[np.ndarray, "*batch 3"]


class AnyCable(NamedTuple):
    """What is given of one cable: the wheel, of which the radius is first, lengths [m], the law, and weight [N/m].

    The lengths are what of the rope is massless at the exit, the rope behind it, the rest length from exit to anchor,
    the rope in it, what is rigid of it, and the rope that stretches in all. Last, the exit's compliance along x, y, z
    [m/N].
    """

    wheel: tuple[float, ...]
    wrapped: float
    behind: float
    rest_length: float
    rope: float
    rigid: float
    whole: float
    law: tuple[float, ...]
    weight: float
    cx: float
    cy: float
    cz: float


def any_cables(table: ArrayLike, chords: ArrayLike, rest_lengths: ArrayLike) -> Catenary:
    """What cables do, of every kind; everything broadcasts.

    Args:
        table: rows of ``Robot.cable_table``, (..., columns).
        chords: from exits to anchors, base frame, (..., 3) [m].
        rest_lengths: from exits to anchors, (...) [m].

    Returns:
        Pulls, stiffnesses, energies (with the exit at height 0) and tensions, of all parts of line together; nan where
        a cable has no path: in its wheel, or where its weight would lift it off.
    """
    with np.errstate(all="ignore"):
        return Catenary(*_ANY(table, chords, rest_lengths))


def _all(table, chord, rest_length, scratch, pull, stiffness, energy, exit_tension, anchor_tension, moved):
    """Those of (rows, columns) of cables."""
    for i in range(chord.shape[0]):
        for j in range(chord.shape[1]):
            x, y, z = chord[i, j, 0], chord[i, j, 1], chord[i, j, 2]
            cable = cable_of(table[i, j], rest_length[i, j])
            (
                pull[i, j, 0], pull[i, j, 1], pull[i, j, 2], xx, xy, yy, xz, yz, zz, energy[i, j], exit_tension[i, j],
                anchor_tension[i, j], _, _,
            ) = any_cable(x, y, z, cable, table[i, j, COLUMNS:])  # fmt: skip
            moved[i, j, 0], moved[i, j, 1], moved[i, j, 2] = (
                -cable.cx * pull[i, j, 0],
                -cable.cy * pull[i, j, 1],
                -cable.cz * (pull[i, j, 2] + _hung(cable)),
            )
            stiffness[i, j, 0, 0], stiffness[i, j, 1, 1], stiffness[i, j, 2, 2] = xx, yy, zz
            stiffness[i, j, 0, 1] = stiffness[i, j, 1, 0] = xy
            stiffness[i, j, 0, 2] = stiffness[i, j, 2, 0] = xz
            stiffness[i, j, 1, 2] = stiffness[i, j, 2, 1] = yz


_ANY = Kernel("laws of cables of any kind", _all, "(k),(c),()->(c),(c,c),(),(),(),(c)")


@inline
def cable_of(row, rest_length):
    """The cable of a row of ``Robot.cable_table``."""
    return AnyCable(
        wheel_at(row, RADIUS, 1), row[WRAPPED], row[BEHIND], rest_length,
        rest_length - row[RIGID], row[RIGID], rest_length + added(row), cable_law.at(row, STIFFNESS, 1), row[WEIGHT],
        row[GIVES], row[GIVES + 1], row[GIVES + 2],
    )  # fmt: skip


@inline
def added(row):
    """What stretches besides the rest length (``Cabling.added``)."""
    return row[BEHIND] - row[RIGID]


@inline
def _hung(cable):
    """The weight that a cable's tension at its exit carries besides the pull on its anchor."""
    return cable.weight * (cable.rope - cable.wrapped)


@outlined
def any_cable(x, y, z, cable, row):
    """A cable whose anchor lies at (x, y, z) from its exit; ``row`` is that of its memory, or empty.

    (pull on the anchor x, y, z; stiffness −∂pull/∂anchor xx, xy, yy, xz, yz, zz; energy, with the exit at height 0;
    tension at the exit, at the anchor; length of the massless path; how far it is from leaving its wheel, 0 without
    one). All is nan where the cable has no path. An exit that gives way is where it is without the cable; the length is
    that from where it moves.
    """
    cx, cy, cz = cable.cx, cable.cy, cable.cz
    if cx + cy + cz == 0.0:
        return _from_fixed_exit(x, y, z, cable, row)
    hung, size = _hung(cable), np.sqrt(x * x + y * y + z * z) + cable.rest_length
    dx, dy, dz = _first_move(x, y, z, cable)
    ox, oy, oz, sx, sy, sz, fraction, downhill, last = dx, dy, dz, 0.0, 0.0, 0.0, 1.0, 0.0, np.inf
    M = np.empty((3, 6))
    found = _from_fixed_exit(x - dx, y - dy, z - dz, cable, row)
    solved = False
    for _ in range(MAX_STEPS):
        # What the forces on the exit leave: minus the slope of the energy, times C.
        rx, ry, rz = -cx * found[0] - dx, -cy * found[1] - dy, -cz * (found[2] + hung) - dz
        slope = _over(sx * rx, cx) + _over(sy * ry, cy) + _over(sz * rz, cz)
        can_shorten = downhill > 0.0 and fraction > LEAST_FRACTION and last > NEARLY_SOLVED * size
        if can_shorten and not abs(slope) <= LEAST_FALL * downhill:  # also where there is no path
            fraction *= SHORTENED
            dx, dy, dz = ox + fraction * sx, oy + fraction * sy, oz + fraction * sz
            found = _from_fixed_exit(x - dx, y - dy, z - dz, cable, row)
            continue
        K = (found[3], found[4], found[5], found[6], found[7], found[8])
        _one_plus_product((cx, 0.0, cy, 0.0, 0.0, cz), K, M)
        M[0, 3], M[1, 3], M[2, 3] = rx, ry, rz
        _eliminate(M, 4)
        moves = abs(M[0, 3]) + abs(M[1, 3]) + abs(M[2, 3])
        if moves <= SOLVED * size or (moves >= 0.5 * last and moves < NEARLY_SOLVED * size):
            solved = True
            break
        if not moves < np.inf:
            break
        ox, oy, oz, sx, sy, sz, fraction, last = dx, dy, dz, M[0, 3], M[1, 3], M[2, 3], 1.0, moves
        downhill = _over(sx * rx, cx) + _over(sy * ry, cy) + _over(sz * rz, cz)
        dx, dy, dz = ox + sx, oy + sy, oz + sz
        found = _from_fixed_exit(x - dx, y - dy, z - dz, cable, row)
    K = (found[3], found[4], found[5], found[6], found[7], found[8])
    _one_plus_product(K, (cx, 0.0, cy, 0.0, 0.0, cz), M)
    M[0, 3], M[1, 3], M[2, 3] = K[0], K[1], K[3]
    M[0, 4], M[1, 4], M[2, 4] = K[1], K[2], K[4]
    M[0, 5], M[1, 5], M[2, 5] = K[3], K[4], K[5]
    _eliminate(M, 6)
    n = 0.0 if solved else np.nan
    t = (found[0] + n, found[1] + n, found[2] + hung)
    energy = found[9] + hung * dz + 0.5 * (cx * t[0] * t[0] + cy * t[1] * t[1] + cz * t[2] * t[2])
    return (
        t[0], t[1], found[2] + n, M[0, 3], 0.5 * (M[0, 4] + M[1, 3]), M[1, 4], 0.5 * (M[0, 5] + M[2, 3]),
        0.5 * (M[1, 5] + M[2, 4]), M[2, 5], energy + n, found[10] + n, found[11] + n, found[12], found[13] + n,
    )  # fmt: skip


@inline
def _over(number, c):
    """number/c; 0 where the exit does not move."""
    return number / c if c > 0.0 else 0.0


@outlined
def _first_move(x, y, z, cable):
    """How an exit moves without mass and memory, as if the cable left its wheel where it does from a fixed exit.

    With the length l and the tension T, the cable's direction is that of c − C T u for the chord c: u = c/(l + C T) in
    each coordinate, and its length is 1 at one stretch. The inverse of that length is nearly linear in the stretch, and
    Newton's method on it needs no other measure.
    """
    length, fx, fy, fz, free, _, _, _, _, _, _ = _wheel_path(x, y, z, cable)
    stretch, T = length - cable.rest_length, 0.0
    most, e, ux, uy, uz = stretch, 0.0, 0.0, 0.0, 0.0
    if not (stretch > 0.0 and free > most):
        return 0.0, 0.0, 0.0
    for _ in range(FIRST_STEPS):
        k, over = cable_law.tangent(e, cable.whole, cable.law)
        T, long = k * max(over, 0.0), free - most + e
        px, py, pz = long + cable.cx * T, long + cable.cy * T, long + cable.cz * T
        ux, uy, uz = fx / px, fy / py, fz / pz
        squares = ux * ux + uy * uy + uz * uz
        falls = (
            ux * ux * (1 + cable.cx * k) / px + uy * uy * (1 + cable.cy * k) / py + uz * uz * (1 + cable.cz * k) / pz
        ) / squares
        e = min(max(e + (np.sqrt(squares) - 1) / falls, 0.0), most)
    return cable.cx * T * ux, cable.cy * T * uy, cable.cz * T * uz


@outlined
def _from_fixed_exit(x, y, z, cable, row):
    """``any_cable`` of an exit that does not give way."""
    elastic = len(row) == 0 or row[KIND] == ELASTIC
    straight = cable.wheel[0] == 0.0 and cable.behind == 0.0 and cable.wrapped == 0.0 and cable.rigid == 0.0
    if elastic and straight and cable_law.linear(cable.law):
        half = 0.5 * cable.weight * cable.rest_length
        t, C, U, exit_tension, anchor_tension = _hanging(x, y, z, cable.rest_length, cable.law[0], cable.weight)
        return (
            -t[0], -t[1], -(t[2] + 2 * half), C[0], C[1], C[2], C[3], C[4], C[5], U + half * z, exit_tension,
            anchor_tension, np.sqrt(x * x + y * y + z * z), 0.0,
        )  # fmt: skip
    if cable.weight == 0.0:
        return _massless(x, y, z, cable, row, elastic)
    return _with_mass(x, y, z, cable, row, elastic)


@inline
def _wheel_path(x, y, z, cable):
    """(length, straight piece from wheel to anchor x, y, z, its length, across x, y, z, bend, wrap, clear)."""
    if cable.wheel[0] == 0.0:
        length = np.sqrt(x * x + y * y + z * z)
        return length, x, y, z, length, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    length, fx, fy, fz, free, bx, by, bz, bend, wrap, clear = pulley_path(-x, -y, -z, cable.wheel)
    return length, -fx, -fy, -fz, free, bx, by, bz, bend, wrap, clear


@outlined
def _massless(x, y, z, cable, row, elastic):
    """A spring along the path, whose stretch the part behind the exit shares."""
    length, fx, fy, fz, free, bx, by, bz, bend, _, clear = _wheel_path(x, y, z, cable)
    stretch = length - cable.rest_length
    if elastic:
        k, e = cable_law.tangent(stretch, cable.whole, cable.law)
        energy = cable_law.energy(stretch, cable.whole, cable.law)
    else:
        k, e, energy = memory_spring(stretch, cable.rope, cable.behind, cable.law, row)
    if not (stretch > 0 and e > 0):
        none = 0.0 if stretch <= 0 or e <= 0 else np.nan
        return none, none, none, none, none, none, none, none, none, none, none, none, length, clear
    T, u = k * e, (fx / free, fy / free, fz / free)
    K = _rank_one(_around(T / free, k - T / free, u), T * bend, (bx, by, bz))
    return -T * u[0], -T * u[1], -T * u[2], K[0], K[1], K[2], K[3], K[4], K[5], energy, T, T, length, clear


@outlined
def _with_mass(x, y, z, cable, row, elastic):
    """Newton's method on the span of the free part; what it misses is B − A."""
    radius, rest, law = cable.wheel[0], cable.rest_length, cable.law
    L = cable.rope - cable.wrapped
    G, weight = cable.wrapped + cable.behind, cable.weight * L
    length, fx, fy, fz, free, _, _, _, _, wrap, clear = _wheel_path(x, y, z, cable)
    eps = max((length - rest) / cable.whole, 0.0)
    # The line that touches the law where the cable would be without mass: tau = (eps - (mu - 1)) EAb/mu.
    mu, EAb, nonlinear = 1.0, law[0], not cable_law.linear(law)
    if nonlinear:
        k, e = cable_law.tangent(eps, 1.0, law)
        mu = 1 + eps - e
        EAb = mu * k
    size = np.sqrt(x * x + y * y + z * z) + rest
    if length <= rest:
        part = cable.rope / rest
        fx, fy, fz = x * part, y * part, z * part
    else:
        part = 1 - (cable.wrapped + G * eps - radius * wrap + cable.rigid) / free
        fx, fy, fz = fx * part, fy * part, fz * part
    if not (L > 0 and length >= 0):
        fx = np.nan
    M = np.empty((3, 6))
    ox, oy, oz, sx, sy, sz = fx, fy, fz, 0.0, 0.0, 0.0
    last, before, fraction, solved = np.inf, np.inf, 1.0, False
    t, C, H, U = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 0.0, 0.0, 0.0), 0.0
    D, Psi = (0.0, 0.0, 0.0), 0.0
    for step in range(MAX_STEPS):
        t, C, U, _, _ = _hanging(fx, fy, fz, mu * L, EAb, cable.weight / mu)
        D, H, Psi = _guided(t, cable, G, row, elastic)
        if nonlinear:
            D, H, Psi = _add_missed(t, cable, L, mu, EAb, D, H, Psi)
        if cable.rigid != 0.0:
            D, H, Psi = _add_rigid(t, cable, L, D, H, Psi)
        rx, ry, rz = fx + D[0] - x, fy + D[1] - y, fz + D[2] - z
        missed = abs(rx) + abs(ry) + abs(rz)
        if not missed < np.inf and step == 0:
            break
        if step >= FULL_STEPS and not missed < before and fraction > LEAST_FRACTION and missed > NEARLY_SOLVED * size:
            fraction *= SHORTENED
            fx, fy, fz = ox - fraction * sx, oy - fraction * sy, oz - fraction * sz
            continue
        fraction, before = 1.0, missed
        _one_plus_product(H, C, M)
        M[0, 3], M[1, 3], M[2, 3] = rx, ry, rz
        _eliminate(M, 4)
        ox, oy, oz, sx, sy, sz = fx, fy, fz, M[0, 3], M[1, 3], M[2, 3]
        fx, fy, fz = fx - sx, fy - sy, fz - sz
        moved = abs(sx) + abs(sy) + abs(sz)
        if missed <= SOLVED * size or (moved >= 0.5 * last and moved < NEARLY_SOLVED * size):
            solved = True
            break
        last = moved
    if not solved:
        n = np.nan
        return n, n, n, n, n, n, n, n, n, n, n, n, length, n if radius > 0.0 else clear
    cx, cy, cz = _times(C, sx, sy, sz)  # the last step's own effect
    t = (t[0] - cx, t[1] - cy, t[2] - cz)
    _one_plus_product(C, H, M)
    M[0, 3], M[1, 3], M[2, 3] = C[0], C[1], C[3]
    M[0, 4], M[1, 4], M[2, 4] = C[1], C[2], C[4]
    M[0, 5], M[1, 5], M[2, 5] = C[3], C[4], C[5]
    _eliminate(M, 6)
    _, ex, ey, ez = cable.wheel
    if t[0] * ex + t[1] * ey + t[2] * ez <= HALF_ROUND * np.sqrt(t[0] * t[0] + t[1] * t[1] + t[2] * t[2]):
        clear = np.nan if radius > 0.0 else clear
    # t·(B − A) − Psi; of the free part, t·span − Psi = U − w L/2 (its rise)
    energy = t[0] * D[0] + t[1] * D[1] + t[2] * D[2] - Psi + U - 0.5 * weight * (z - D[2]) + weight * z
    return (
        -t[0], -t[1], -(t[2] + weight), M[0, 3], 0.5 * (M[0, 4] + M[1, 3]), M[1, 4], 0.5 * (M[0, 5] + M[2, 3]),
        0.5 * (M[1, 5] + M[2, 4]), M[2, 5], energy, np.sqrt(t[0] * t[0] + t[1] * t[1] + t[2] * t[2]),
        np.sqrt(t[0] * t[0] + t[1] * t[1] + (t[2] + weight) * (t[2] + weight)), length, clear,
    )  # fmt: skip


@inline
def _hanging(x, y, z, L0, EA, w):
    """Of a linear cable between points: (tension vector where it begins, stiffness, U, tensions at its ends)."""
    flat = np.sqrt(x * x + y * y)
    V, along, skew, upward, across, U, T0, T1 = elastic_catenary(flat, z, L0, EA, w)
    c, s = (x / flat, y / flat) if flat > 0 else (1.0, 0.0)
    C = (
        along * c * c + across * s * s, (along - across) * c * s, along * s * s + across * c * c, skew * c, skew * s,
        upward,
    )  # fmt: skip
    return (across * x, across * y, V - 0.5 * w * L0), C, U, T0, T1


@outlined
def _guided(t, cable, G, row, elastic):
    """Of wheel, massless part and part behind: (∂Psi/∂t, ∂²Psi/∂t², Psi) at the tension vector t."""
    T = np.sqrt(t[0] * t[0] + t[1] * t[1] + t[2] * t[2])
    u = (t[0] / T, t[1] / T, t[2] / T)
    eps, slope, energy = strain_of(T, cable.law)
    f, wider = cable.wrapped + G * eps, G * slope
    Psi = G * (T * (1 + eps) - energy) - cable.behind * T
    if not elastic:  # the rope behind the exit, with all that a memory makes the cable longer
        more, per_newton, work = stretch_at_exit(T, cable.rope, cable.behind, cable.law, row)
        f, wider = cable.wrapped * (1 + eps) + more, cable.wrapped * slope + per_newton
        Psi = cable.wrapped * (T * (1 + eps) - energy) + work
    if cable.wheel[0] == 0.0:
        return (f * u[0], f * u[1], f * u[2]), _around(f / T, wider - f / T, u), Psi
    r, ex, ey, ez = cable.wheel
    cosine = u[0] * ex + u[1] * ey + u[2] * ez
    nx, ny, nz = u[0] - cosine * ex, u[1] - cosine * ey, u[2] - cosine * ez
    sine = np.sqrt(nx * nx + ny * ny + nz * nz)
    nx, ny, nz = nx / sine, ny / sine, nz / sine
    theta = wrap_angle(sine, cosine, 1.0)
    f -= r * theta
    p, q = r * (1 - cosine), r * sine
    D = (p * nx + q * ex + f * u[0], p * ny + q * ey + f * u[1], p * nz + q * ez + f * u[2])
    H = _around(f / T, wider - f / T, u)
    H = _rank_one(H, p / (sine * T), (ey * nz - ez * ny, ez * nx - ex * nz, ex * ny - ey * nx))
    return D, H, Psi - r * T * (theta - sine)


@outlined
def _add_missed(t, cable, L, mu, EAb, D, H, Psi):
    """Add what the free part of a nonlinear cable stretches more than its line, by Gauss's rule."""
    for j in range(len(NODES)):
        m, v = L * WEIGHTS[j], t[2] + cable.weight * L * NODES[j]
        T = np.sqrt(t[0] * t[0] + t[1] * t[1] + v * v)
        u = (t[0] / T, t[1] / T, v / T)
        eps, slope, energy = strain_of(T, cable.law)
        more = m * (1 + eps - mu - T * mu / EAb)
        D = (D[0] + more * u[0], D[1] + more * u[1], D[2] + more * u[2])
        A = _around(more / T, m * (slope - mu / EAb) - more / T, u)
        H = (H[0] + A[0], H[1] + A[1], H[2] + A[2], H[3] + A[3], H[4] + A[4], H[5] + A[5])
        Psi += m * (T * (1 + eps) - energy - mu * T - 0.5 * mu * T * T / EAb)
    return D, H, Psi


@inline
def _add_rigid(t, cable, L, D, H, Psi):
    """Add what is rigid at the anchor, along the tension there."""
    v = t[2] + cable.weight * L
    T = np.sqrt(t[0] * t[0] + t[1] * t[1] + v * v)
    r, u = cable.rigid, (t[0] / T, t[1] / T, v / T)
    A = _around(r / T, -r / T, u)
    H = (H[0] + A[0], H[1] + A[1], H[2] + A[2], H[3] + A[3], H[4] + A[4], H[5] + A[5])
    return (D[0] + r * u[0], D[1] + r * u[1], D[2] + r * u[2]), H, Psi + r * T


# Symmetric matrices as (xx, xy, yy, xz, yz, zz).


@inline
def _around(every, more, u):
    """every 1 + more u uᵀ."""
    x, y, z = more * u[0], more * u[1], more * u[2]
    return every + x * u[0], x * u[1], every + y * u[1], x * u[2], y * u[2], every + z * u[2]


@inline
def _rank_one(S, size, b):
    """S + size b bᵀ."""
    x, y, z = size * b[0], size * b[1], size * b[2]
    return (
        S[0] + x * b[0], S[1] + x * b[1], S[2] + y * b[1], S[3] + x * b[2], S[4] + y * b[2], S[5] + z * b[2]
    )  # fmt: skip


@inline
def _times(S, x, y, z):
    return S[0] * x + S[1] * y + S[3] * z, S[1] * x + S[2] * y + S[4] * z, S[3] * x + S[4] * y + S[5] * z


@inline
def _one_plus_product(P, Q, M):
    """1 + P Q into the first columns of M."""
    columns = (_times(P, Q[0], Q[1], Q[3]), _times(P, Q[1], Q[2], Q[4]), _times(P, Q[3], Q[4], Q[5]))
    for a in range(3):
        M[a, 0], M[a, 1], M[a, 2] = columns[0][a], columns[1][a], columns[2][a]
        M[a, a] += 1.0


@outlined
def _eliminate(M, columns):
    """Solve for the right sides that stand in M beside its first three columns, in place, with pivots."""
    for i in range(3):
        p = i
        for j in range(i + 1, 3):
            if abs(M[j, i]) > abs(M[p, i]):
                p = j
        for k in range(i, columns):
            M[i, k], M[p, k] = M[p, k], M[i, k]
        for j in range(i + 1, 3):
            factor = M[j, i] / M[i, i]
            for k in range(i + 1, columns):
                M[j, k] -= factor * M[i, k]
    for i in range(2, -1, -1):
        for k in range(3, columns):
            for j in range(i + 1, 3):
                M[i, k] -= M[i, j] * M[j, k]
            M[i, k] /= M[i, i]

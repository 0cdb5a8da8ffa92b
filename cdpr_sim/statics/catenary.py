"""One elastic cable with mass: the elastic catenary between its exit A and its anchor B.

Irvine, Cable Structures (1981), chapter 1, as one increasing equation in one number. A cable with weight per length w,
rest length L0 and axial stiffness EA spans x >= 0 horizontally and rises by z from A to B. Let (H, V) be its tension at
mid-length; elsewhere it is (H, V + w (s − L0/2)). With a = ½ asinh((V + w L0/2)/H) − ½ asinh((V − w L0/2)/H) and
kappa = w L0/(2 EA), its two ends are

    x = 2 H/w (a + kappa),   z = 2 V/w (tanh a + kappa),   (w L0/2)² = H² sinh²a + V² tanh²a,

and so F(a) = (z/L0)² [tanh a/(tanh a + kappa)]² + (x/L0)² [sinh a/(a + kappa)]² = 1, where F increases. The mean of the
two ends' tensions is T = w L0/(2 tanh a).

Its energy, of stretch and of its own weight, is w L0 (zA + zB)/2 + U(x, z), and U is convex with the slope (H, V): for
the platform, a cable with mass is a convex potential plus half its weight at the anchor. Without mass it is a spring
that only pulls.
"""

from __future__ import annotations

import math

import numpy as np

from cdpr_sim.core.compiling import inline, of_one_number, outlined

acos, acosh, asinh, atanh, cos, exp, log, log1p = map(
    of_one_number, (math.acos, math.acosh, math.asinh, math.atanh, math.cos, math.exp, math.log, math.log1p)
)
cosh_of, sinh_of = of_one_number(math.cosh), of_one_number(math.sinh)

MASSLESS = 1e-150
"""Largest kappa of a cable that is treated as a massless spring: its weight is far below the rounding of any
tension."""

VERTICAL = 1e-150
"""x/L0 up to which a cable counts as vertical; squares of larger values do not underflow."""

ENOUGH = 1e-9
"""A Newton step shorter than this fraction of a is the last one: its square is rounding."""

ROUNDING = 2 * np.finfo(float).eps
"""Rounding of F − 1, per size of its terms."""

MAX_ITERATIONS = 200
"""Largest number of steps of the iteration. Two or three suffice; bisection alone would need this many."""

SERIES = 0.5
"""Value of a below which sinh a − a and a cosh a − sinh a are summed as series of seven terms: the eighth is 1e-17 of
them."""


@outlined
def elastic_catenary(x, z, L0, EA, w):
    """State of a cable that spans x >= 0 and rises by z from exit to anchor.

    (V, Khh, Khv, Kvv, K, U, tension at the exit, tension at the anchor): V at mid-length; the stiffnesses of (H, V) by
    (x, z), and across the cable's plane, K = H/x; the energy U without w L0 (zA + zB)/2. With e = L0/EA, m = L0/T,
    phi = a/tanh a, c = 1/cosh²a, S = H cosh a, P = (product of the ends' tensions) = S² + c V²:

        det = e² + e m phi + m² (phi − 1) S²/P
        Khh = (e + m S²/P)/det,   Khv = m H V/(P det),   Kvv = (e + m (phi − 1 + c V²/P))/det,   K = 1/(e + m phi)
        U = e/2 (H² + V² − (w L0)²/12) − m/2 (S² − H² phi)
    """
    kappa = 0.5 * w * L0 / EA
    if not kappa > MASSLESS:
        return _spring(x, z, L0, EA) if kappa <= MASSLESS else _unknown()
    X, Z = x / L0, abs(z) / L0
    e, half = L0 / EA, 0.5 * w * L0
    if X <= VERTICAL:
        if kappa >= Z - 1:  # a is infinite: two vertical pieces side by side without horizontal tension
            V = w * z / (2 * (1 + kappa))
            U = 0.5 * e * (V * V - half * half / 3) - 0.5 * L0 / half * (half * half - V * V)
            return V, 0.0, 0.0, 1 / (e + L0 / half), 0.0, U, abs(V - half), abs(V + half)
        a = atanh(kappa / (Z - 1))
    else:
        a = _solve(X, Z, kappa)
    rise, bend = _beyond(a)
    sinh = a + rise
    cosh = np.sqrt(1 + sinh * sinh) if a < SERIES else cosh_of(a)
    tanh = sinh / cosh
    K = 0.5 * w / (a + kappa)
    H, V = K * x, 0.5 * w * z / (tanh + kappa)
    m, above, c = L0 * tanh / half, bend / sinh, 1 / (cosh * cosh)  # above: phi − 1
    S2, cV2 = (H * cosh) * (H * cosh), c * V * V
    P = S2 + cV2
    along, across = S2 / P, cV2 / P
    det = e * e + e * m * (1 + above) + m * m * above * along
    U = 0.5 * e * (H * H + V * V - half * half / 3) - 0.5 * m * ((H * sinh) * (H * sinh) - H * H * above)
    return (
        V, (e + m * along) / det, m * (H / P) * V / det, (e + m * (above + across)) / det, K, U,
        np.sqrt(H * H + (V - half) * (V - half)), np.sqrt(H * H + (V + half) * (V + half)),
    )  # fmt: skip


@inline
def _spring(x, z, L0, EA):
    """State of a massless cable; its direction is arbitrary when it has no length."""
    length = np.sqrt(x * x + z * z)
    if not length > L0:
        return (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0) if length <= L0 else _unknown()
    k, c, s = EA / L0, x / length, z / length
    T = k * (length - L0)
    K = T / length
    return T * s, k * c * c + K * s * s, (k - K) * c * s, k * s * s + K * c * c, K, 0.5 * T * (length - L0), T, T


@inline
def _unknown():
    return np.nan, np.nan, np.nan, np.nan, np.nan, np.nan, np.nan, np.nan


@inline
def _beyond(a):
    """(sinh a − a, a cosh a − sinh a) for a > 0, to full relative precision."""
    if a < SERIES:
        q = a * a
        rise = 1 + q / 72 * (1 + q / 110 * (1 + q / 156 * (1 + q / 210)))
        rise = q * a / 6 * (1 + q / 20 * (1 + q / 42 * rise))
        bend = 1 + q / 54 * (1 + q / 88 * (1 + q / 130 * (1 + q / 180)))
        return rise, q * a / 3 * (1 + q / 10 * (1 + q / 28 * bend))
    grown = exp(a)
    sinh = 0.5 * (grown - 1 / grown)
    return sinh - a, 0.5 * a * (grown + 1 / grown) - sinh


@inline
def _solve(X, Z, kappa):
    """The a > 0 with F(a) = 1: Newton on log F within a bracket. X, Z: x/L0 > 0 and |z|/L0."""
    chord = np.sqrt(X * X + Z * Z)
    stretch = (chord - 1) * (chord + 1)
    noise = ROUNDING * (1 + chord * chord)
    a, low, high = _start(X, Z, chord, kappa), 0.0, np.inf
    for _ in range(MAX_ITERATIONS):
        rise, bend = _beyond(a)
        sinh = a + rise
        cosh = np.sqrt(1 + sinh * sinh) if a < SERIES else (bend + sinh) / a
        tanh = sinh / cosh
        p, q = kappa / (tanh + kappa), (rise - kappa) / (a + kappa)  # 1 − and − 1 of F's brackets
        beyond = stretch - (Z * p) * Z * (2 - p) + (X * q) * (X * (2 + q))  # F − 1
        slope = Z * Z * (1 - p) * p / (cosh * cosh * (tanh + kappa))
        slope = 2 * (slope + X * (1 + q) * (X * (kappa * cosh + bend) / ((a + kappa) * (a + kappa))))
        step = log1p(beyond) * (1 + beyond) / slope
        if abs(step) <= ENOUGH * a or abs(beyond) <= noise:
            return max(a - step, 0.5 * a)
        if beyond > 0:
            high = a
        else:
            low = a
        a -= step
        if not low < a < high:
            a = 2 * low + 1 if high == np.inf else max(0.5 * (low + high), 0.01 * high)
    return a


@inline
def _start(X, Z, chord, kappa):
    """Start near the root: from F's first terms where the cable is nearly straight, else from its exponentials."""
    upright = Z / (1 + kappa)
    if upright < 1 and chord < 1 + kappa:
        y = log(2 * np.sqrt((1 - upright) * (1 + upright)) / X)
        if y > 1:
            return y + log(kappa + y + log(kappa + y + 1))
    # c a³/6 + (chord − 1) a = kappa with c = cos² of the chord's slope
    c = max(X / chord * (X / chord), 1e-30)
    p, q = 6 * (chord - 1) / c, 6 * kappa / c
    if p == 0:
        return q ** (1 / 3)
    size = np.sqrt(abs(p) / 3)
    t = 1.5 * q / (abs(p) * size)
    if p > 0:
        return 2 * size * sinh_of(asinh(t) / 3)
    return 2 * size * (cosh_of(acosh(t) / 3) if t > 1 else cos(acos(t) / 3))

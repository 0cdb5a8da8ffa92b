"""Branch and prune over poses and tensions, compiled: finds every equilibrium and proves that none is missing.

Unknowns are the pose (``geometry_kernel``) and the cables' tensions. With tensions as unknowns of their own a stiffness
EA enters only as 1/EA, and boxes need not be as small as the load over the stiffness. Of a planar robot only x, z and
v_y vary. Intervals are rounded outwards (``interval_kernel``).
"""

from __future__ import annotations

import numpy as np

from cdpr_sim.core import compiling
from cdpr_sim.core.compiling import outlined
from cdpr_sim.proof.contraction_kernel import contract
from cdpr_sim.proof.geometry_kernel import COLUMNS, Setup
from cdpr_sim.proof.krawczyk_kernel import EMPTY, UNIQUE, blown_up, krawczyk, within

SPLIT = 0.4837
"""Fraction at which a box is divided: equilibria often have symmetric coordinates, at which a box should not end."""

AGAIN = 0.8
"""A box is contracted again while some width falls below this fraction of it."""

ROUNDS = 10
"""Largest number of contractions."""

BOXES, BY_BALANCE, BY_KRAWCZYK, PROVED, LEFT, COUNTS = 0, 1, 2, 3, 4, 5
"""Counts of a search: boxes examined; excluded by balances; by Krawczyk's test; proved; undecided."""

TIGHTER = 60
"""Largest number of contractions of a box with one equilibrium."""

THIN = 1e-3
"""Fraction of the widest coordinate below which no coordinate is divided."""


@outlined
def tightened(q, T, setup, o, spin, at):
    """Contract a box with exactly one equilibrium until it hardly shrinks: ``at`` (6,) is near the equilibrium."""
    width, smear = np.inf, np.empty(6)
    for _ in range(TIGHTER):
        last, width = width, 0.0
        for r in setup.rows:
            width = max(width, (q[r, 1] - q[r, 0]) * setup.scales[r])
        if width > 0.9 * last or not contract(q, T, setup, o, spin):
            return
        if krawczyk(q, T, setup, o, spin, at, smear) == EMPTY:
            return


@outlined
def found_at(found, box, at):
    """Store a box and the point near its equilibrium."""
    for r in range(6):
        found[r, 0], found[r, 1], found[r, 2] = box[r, 0], box[r, 1], at[r]


@outlined
def search(setup, boxes, top, found, nf, left, nl, most, counts):
    """Continue a search, depth first, for at most ``most`` boxes.

    Args:
        setup: the problem.
        boxes: pending boxes of poses and tensions, (room, 6 + cables, 2), of which the first ``top`` are filled in.
        top: number of pending boxes.
        found: boxes with exactly one equilibrium: lower, upper and a point near it, (room, 6, 3); ``nf`` are filled in.
        nf: their number.
        left: undecided boxes, (room, 6, 2), of which ``nl`` are filled in.
        nl: their number.
        most: number of boxes to examine.
        counts: counts of the results, (COUNTS,), added to.

    Returns:
        The new top, nf and nl. The search is complete at top = 0; it also stops if the arrays are full.
    """
    m, rows = setup.exits.shape[0], setup.rows
    o, spin, at, smear = np.zeros((m + 1, COLUMNS, 2)), np.empty((9, 2)), np.zeros(6), np.zeros(6)
    box, end = np.empty((6, 2)), counts[BOXES] + most
    while top > 0 and counts[BOXES] < end:
        if nf == found.shape[0] or nl == left.shape[0] or top + 1 >= boxes.shape[0]:
            return top, nf, nl
        top -= 1
        q, T = boxes[top, :6].copy(), boxes[top, 6:].copy()
        counts[BOXES] += 1
        alive, old = True, np.empty((6, 2))
        for _ in range(ROUNDS):
            old[:] = q
            smear[:] = 0.0
            for f in range(nf):
                if within(q, found[f], rows):
                    alive = False
                    break
            if not alive:
                break
            if not contract(q, T, setup, o, spin):
                counts[BY_BALANCE] += 1
                alive = False
                break
            width = 0.0
            for r in rows:
                width = max(width, (q[r, 1] - q[r, 0]) * setup.scales[r])
            if width < setup.newton:
                state = krawczyk(q, T, setup, o, spin, at, smear)
                if state == EMPTY:
                    counts[BY_KRAWCZYK] += 1
                    alive = False
                    break
                if state == UNIQUE:
                    tightened(q, T, setup, o, spin, at)
                    found_at(found[nf], old, at)
                    nf += 1
                    counts[PROVED] += 1
                    alive = False
                    break
            shrunk = 1.0
            for r in rows:
                if old[r, 1] > old[r, 0]:
                    shrunk = min(shrunk, (q[r, 1] - q[r, 0]) / (old[r, 1] - old[r, 0]))
            if shrunk > AGAIN:
                break
        if not alive:
            continue
        widest, width, most_smear = rows[0], -1.0, 0.0
        for r in rows:
            if (q[r, 1] - q[r, 0]) * setup.scales[r] > width:
                widest, width = r, (q[r, 1] - q[r, 0]) * setup.scales[r]
        if width < setup.near and blown_up(q, setup, o, spin, box):
            for r in range(6):
                at[r] = 0.5 * (box[r, 0] + box[r, 1])
            found_at(found[nf], box, at)
            nf += 1
            counts[PROVED] += 1
            continue
        if width < setup.least:
            left[nl] = q
            nl += 1
            counts[LEFT] += 1
            continue
        for r in rows:
            if smear[r] > most_smear and (q[r, 1] - q[r, 0]) * setup.scales[r] > THIN * width:
                widest, most_smear = r, smear[r]
        cut = q[widest, 0] + SPLIT * (q[widest, 1] - q[widest, 0])
        boxes[top, :6], boxes[top, 6:] = q, T
        boxes[top + 1] = boxes[top]
        boxes[top, widest, 1] = boxes[top + 1, widest, 0] = cut
        top += 2
    return top, nf, nl


def _search(
    exits, anchors, law, wheels, center_of_mass, weight, wrench, rows, scales, newton, near, least, boxes, top,
    found, nf, left, nl, most, counts,
):  # fmt: skip
    """``search`` with the fields of ``Setup`` one by one: a signature in Numba's notation has no named tuples."""
    setup = Setup(exits, anchors, law, wheels, center_of_mass, weight, wrench, rows, scales, newton, near, least)
    return search(setup, boxes, top, found, nf, left, nl, most, counts)


SEARCH = compiling.Compiled(
    "search for all equilibria",
    _search,
    "UniTuple(int64, 3)(float64[:, ::1], float64[:, ::1], float64[:, ::1], float64[:, :, ::1], float64[::1], "
    "float64[::1], float64[::1], int64[::1], float64[::1], float64, float64, float64, float64[:, :, ::1], "
    "int64, float64[:, :, ::1], int64, float64[:, :, ::1], int64, int64, int64[::1])",
    error_model="numpy",
    nogil=True,
)
"""``search`` as machine code. Its arguments are the fields of a ``Setup``, and then those of ``search``."""

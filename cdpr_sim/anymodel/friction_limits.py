"""Forces within friction cones: share in use, least share that carries a load, closest force to a load.

``use`` is the force of each row as a fraction of its limit; a cone is a set of rows. Its share is the Euclidean norm
of its rows' fractions, for a pyramid the sum of their magnitudes: 1 is the limit.
"""

from __future__ import annotations

import itertools

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.linalg import null_space

GAP = 1e-7
"""Accuracy of the least share, as a fraction, as long as it may be the limit."""

ROUGH = 1e-3
"""The same where it is below the limit."""

SWEEPS = 500
"""Iterations of the projected gradient method."""


def shares(
    use: Float[np.ndarray, " rows"], cones: Int[np.ndarray, " rows"], corners: Bool[np.ndarray, " cones"]
) -> Float[np.ndarray, " cones"]:
    """The share of each cone in use."""
    round_ = np.sqrt(np.bincount(cones, use**2, len(corners)))
    return np.where(corners, np.bincount(cones, np.abs(use), len(corners)), round_)


def least_share(
    matrix: Float[np.ndarray, "n rows"],
    load: Float[np.ndarray, " n"],
    start: Float[np.ndarray, " rows"],
    cones: Int[np.ndarray, " rows"],
    corners: Bool[np.ndarray, " cones"],
) -> Float[np.ndarray, " rows"]:
    """Of all ``use`` with ``matrix @ use = load`` (``start`` is one), that with the smallest largest share.

    A barrier method: the variables are the largest share s and the null space of the matrix; -log(s² - |u|²) of each
    cone, -log(s - σ u) of each facet of a pyramid.
    """
    norms = np.linalg.norm(matrix, axis=0)
    null = null_space(matrix / max(norms.max(), 1e-300), rcond=1e-11)
    if not null.shape[1]:
        return start
    count = len(corners)
    rows_in = np.bincount(cones, minlength=count)
    smooth_cones = ~corners & (rows_in > 1)
    smooth = smooth_cones[cones]
    member = (np.arange(count)[smooth_cones][:, None] == cones[smooth]).astype(float)
    flat = np.flatnonzero(~smooth_cones)
    facets = np.zeros((sum(2 ** rows_in[cone] for cone in flat), len(start)))
    at = 0
    for cone in flat:
        signs = np.array(list(itertools.product((-1.0, 1.0), repeat=rows_in[cone])))
        facets[at : at + len(signs), cones == cone] = signs
        at += len(signs)
    facets_null, barriers = facets @ null, len(facets) + 2 * int(smooth_cones.sum())
    part = null[smooth]

    def value(use: np.ndarray, s: float, weight: float) -> float:
        slack = s - facets @ use
        discs = s * s - member @ use[smooth] ** 2
        if s <= 0 or slack.min(initial=1) <= 0 or discs.min(initial=1) <= 0:
            return np.inf
        return weight * s - float(np.log(slack).sum()) - float(np.log(discs).sum())

    use, s = np.array(start), 1.1 * float(shares(start, cones, corners).max()) + 1e-3
    weight = barriers / s
    for _ in range(60):
        for _ in range(30):
            size = null.shape[1]
            gradient, hessian = np.zeros(size + 1), np.zeros((size + 1, size + 1))
            gradient[-1] = weight
            inverse = 1 / (s - facets @ use)
            gradient[:-1] += facets_null.T @ inverse
            gradient[-1] -= inverse.sum()
            hessian[:-1, :-1] += (facets_null * inverse[:, None] ** 2).T @ facets_null
            hessian[:-1, -1] -= facets_null.T @ inverse**2
            hessian[-1, -1] += (inverse**2).sum()
            disc, inner = s * s - member @ use[smooth] ** 2, use[smooth]
            slopes = np.column_stack([-2 * member @ (inner[:, None] * part), np.full(len(disc), 2 * s)])  # of the discs
            gradient -= slopes.T @ (1 / disc)
            hessian += (slopes / disc[:, None] ** 2).T @ slopes
            hessian[:-1, :-1] += 2 * (part * (member.T @ (1 / disc))[:, None]).T @ part
            hessian[-1, -1] -= 2 * (1 / disc).sum()
            hessian[:-1, -1] = hessian[-1, :-1] = hessian[:-1, -1] + 0  # symmetric
            ridge = 1e-14 * np.trace(hessian) / len(hessian) * np.eye(len(hessian))
            step = np.linalg.solve(hessian + ridge, -gradient)
            decrement = -float(gradient @ step)
            now, length = value(use, s, weight), 1.0
            while length > 1e-12 and not (
                value(use + length * (null @ step[:-1]), s + length * step[-1], weight) < now - 0.1 * length * decrement
            ):
                length /= 2
            if length <= 1e-12 or decrement < 1e-10:
                break
            use, s = use + length * (null @ step[:-1]), s + length * step[-1]
        gap = barriers / weight
        if gap < GAP * s or s - gap > 1 or (s < 1 and gap < ROUGH * s):
            break
        weight *= 8
    return use


def closest(
    matrix: Float[np.ndarray, "n rows"],
    load: Float[np.ndarray, " n"],
    cones: Int[np.ndarray, " rows"],
    corners: Bool[np.ndarray, " cones"],
) -> Float[np.ndarray, " rows"]:
    """``use`` within the cones that leaves the least of a load that they cannot carry.

    By an accelerated projected gradient; then rows of cones inside their limits are solved exactly, if they stay
    inside.
    """
    pyramids = np.flatnonzero(corners)
    widest = int(np.bincount(cones, minlength=len(corners)).max())
    place = np.full((len(pyramids), widest), -1)
    for number, cone in enumerate(pyramids):
        rows = np.flatnonzero(cones == cone)
        place[number, : len(rows)] = rows
    bound = float(np.linalg.norm(matrix, 2)) ** 2 or 1.0
    use = np.zeros(matrix.shape[1])
    ahead, momentum = use, 1.0
    for _ in range(SWEEPS):
        new = _projected(ahead - matrix.T @ (matrix @ ahead - load) / bound, place, cones, corners)
        if (ahead - new) @ (new - use) > 0:
            momentum = 1.0
        later = (1 + np.sqrt(1 + 4 * momentum**2)) / 2
        ahead, moved = new + (momentum - 1) / later * (new - use), np.abs(new - use).max()
        use, momentum = new, later
        if moved < 1e-10:
            break
    inside = (shares(use, cones, corners) < 1 - 1e-6)[cones]
    if inside.any() and not inside.all():
        exact = np.array(use)
        left = load - matrix[:, ~inside] @ use[~inside] - matrix[:, inside] @ use[inside]
        exact[inside] += np.linalg.lstsq(matrix[:, inside], left, rcond=1e-11)[0]
        if shares(exact, cones, corners).max() <= 1 + 1e-9:
            return exact
    return use


def _projected(use: np.ndarray, place: np.ndarray, cones: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """The closest point within the cones; ``place`` has the rows of each pyramid, filled up with -1."""
    share = shares(use, cones, corners)
    new = np.where((share > 1)[cones] & ~corners[cones], use / np.maximum(share, 1e-300)[cones], use)
    if len(place):
        magnitudes = np.where(place >= 0, np.abs(use[place]), 0.0)
        ordered = -np.sort(-magnitudes, axis=1)
        excess = (np.cumsum(ordered, axis=1) - 1) / np.arange(1, place.shape[1] + 1)
        last = np.maximum((ordered > excess).sum(axis=1) - 1, 0)
        cut = np.maximum(excess[np.arange(len(place)), last], 0)  # none inside the pyramid
        rows = place[place >= 0]
        new[rows] = np.sign(use[rows]) * np.maximum(np.abs(use[rows]) - np.repeat(cut, (place >= 0).sum(axis=1)), 0)
    return new

"""Forces within friction cones: the share of the limits in use, and the force that carries a load with the least.

``use`` is the force of each row as a fraction of its limit; a cone is a set of rows. Its share is the Euclidean norm
of its rows' fractions, for a pyramid the sum of their magnitudes: 1 is the limit.
"""

from __future__ import annotations

import itertools

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.linalg import cho_factor, cho_solve

LEFT = 1e-9
"""Weight of the share beside the square of what is left of the load."""

GAP = 1e-8
"""Accuracy of the share."""

ITERATIONS = 50
"""Of the interior-point method, at most; it needs about fifteen."""

BACK, SHORTEST = 0.99, 1e-6
"""Fraction of the way to the limits that a step goes; and of a step, below which rounding ends the search."""


def shares(
    use: Float[np.ndarray, " rows"], cones: Int[np.ndarray, " rows"], corners: Bool[np.ndarray, " cones"]
) -> Float[np.ndarray, " cones"]:
    """The share of each cone in use."""
    round_ = np.sqrt(np.bincount(cones, use**2, len(corners)))
    return np.where(corners, np.bincount(cones, np.abs(use), len(corners)), round_)


def least_share(
    matrix: Float[np.ndarray, "n rows"],
    load: Float[np.ndarray, " n"],
    cones: Int[np.ndarray, " rows"],
    corners: Bool[np.ndarray, " cones"],
) -> Float[np.ndarray, " rows"]:
    """Of all ``use`` that carry a load, ``matrix @ use = load``, that with the smallest largest share.

    If none within the limits carries it, that which leaves least of it. Minimised is s + |matrix @ use - load|² / 2w
    with the small weight w and the largest share s, up to 1, by a primal-dual interior-point method for second-order
    cones (Vandenberghe, The CVXOPT linear and quadratic cone program solvers, 2010); then ``use`` is corrected by what
    w has left.
    """
    size = float(np.linalg.norm(load))
    if size == 0:
        return np.zeros(matrix.shape[1])
    # Largest share, in the first coordinate of each cone; forces in the others. The last cone is s <= 1.
    slopes, ends = _cones(matrix.shape[1], cones, corners)
    part = np.hstack([matrix / size, np.zeros((len(load), 1))])
    curvature, pull = part.T @ part / LEFT, -part.T @ load / size / LEFT
    pull[-1] = 1.0
    flat = slopes.reshape(-1, slopes.shape[2])
    x = np.zeros(slopes.shape[2])
    x[-1] = 0.5
    room, dual = ends + slopes @ x, np.zeros_like(ends)
    dual[:, 0] = np.abs(pull).max()
    one = np.zeros_like(ends)
    one[:, 0], length = 1.0, 1.0
    for _ in range(ITERATIONS):
        slope = curvature @ x + pull - flat.T @ dual.ravel()
        gap = float((room * dual).sum())
        value = float(x @ curvature @ x / 2 + pull @ x) + 1 / (2 * LEFT)
        if length < SHORTEST or (gap < GAP * max(1.0, 100 * value) and np.abs(slope).max() < 1e-6 * np.abs(pull).max()):
            break
        there, back, inner = _scaling(room, dual)
        hessian = curvature + flat.T @ (back @ back @ slopes).reshape(flat.shape)
        hessian[np.diag_indices_from(hessian)] += 1e-14 * np.trace(hessian) / len(hessian)
        factor = cho_factor(hessian, check_finite=False)

        def step(target: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
            wanted = _apply(back, _divided(inner, target))
            along = cho_solve(factor, flat.T @ wanted.ravel() - slope, check_finite=False)
            opens = slopes @ along
            return along, opens, wanted - _apply(back, _apply(back, opens))

        _, opens, pulls = step(-_product(inner, inner))
        length = min(1.0, _reach(room, opens), _reach(dual, pulls))
        after = float(((room + length * opens) * (dual + length * pulls)).sum())
        centre = (after / gap) ** 3 * gap / len(ends)
        both = _product(_apply(back, opens), _apply(there, pulls))
        along, opens, pulls = step(centre * one - _product(inner, inner) - both)
        length = min(1.0, BACK * _reach(room, opens), BACK * _reach(dual, pulls))
        x = x + length * along
        room, dual = ends + slopes @ x, dual + length * pulls
    use = x[:-1]
    exact = use + np.linalg.lstsq(matrix, load - matrix @ use, rcond=1e-11)[0]
    return exact if shares(exact, cones, corners).max() <= 1 else use


def _cones(
    rows: int, cones: Int[np.ndarray, " rows"], corners: Bool[np.ndarray, " cones"]
) -> tuple[Float[np.ndarray, "all width rows_1"], Float[np.ndarray, "all width"]]:
    """Second-order cones ``ends + slopes @ (use, s)``: of a pyramid, one for each pair of opposite faces."""
    faces: list[np.ndarray] = []
    for cone, pyramid in enumerate(corners):
        here = np.flatnonzero(cones == cone)
        if not pyramid:
            faces.append(np.eye(rows)[here])
            continue
        for signs in itertools.product((1.0, -1.0), repeat=len(here) - 1):
            face = np.zeros((1, rows))
            face[0, here] = (1.0, *signs)
            faces.append(face)
    slopes = np.zeros((len(faces) + 1, 1 + max(map(len, faces)), rows + 1))
    for number, face in enumerate(faces):
        slopes[number, 1 : 1 + len(face), :-1] = face
    slopes[:, 0, -1] = 1.0
    slopes[-1, 0, -1] = -1.0
    ends = np.zeros(slopes.shape[:2])
    ends[-1, 0] = 1.0
    return slopes, ends


def _apply(matrices: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    return np.einsum("cij,cj->ci", matrices, vectors)


def _product(one: np.ndarray, two: np.ndarray) -> np.ndarray:
    """Jordan product of the second-order cone."""
    tail = one[:, :1] * two[:, 1:] + two[:, :1] * one[:, 1:]
    return np.hstack([(one * two).sum(axis=1, keepdims=True), tail])


def _divided(by: np.ndarray, what: np.ndarray) -> np.ndarray:
    """The vector whose Jordan product with ``by`` is ``what``."""
    head = (by[:, 0] * what[:, 0] - (by[:, 1:] * what[:, 1:]).sum(axis=1)) / _determinant(by)
    return np.hstack([head[:, None], (what[:, 1:] - by[:, 1:] * head[:, None]) / np.maximum(by[:, :1], 1e-300)])


def _determinant(vectors: np.ndarray) -> np.ndarray:
    length = np.linalg.norm(vectors[:, 1:], axis=1)
    return np.maximum((vectors[:, 0] - length) * (vectors[:, 0] + length), 1e-300)


def _scaling(room: np.ndarray, dual: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Nesterov and Todd's scaling W and its inverse of each cone, and the point W dual = W⁻¹ room."""
    first, second = np.sqrt(_determinant(room)), np.sqrt(_determinant(dual))
    one, two = room / first[:, None], dual / second[:, None]
    turned = np.hstack([two[:, :1], -two[:, 1:]])
    middle = (one + turned) / np.sqrt(2 * (1 + (one * two).sum(axis=1)))[:, None]
    size = np.sqrt(first / second)[:, None, None]
    head, tail = middle[:, 0], middle[:, 1:]
    there = np.zeros((*room.shape, room.shape[1]))
    there[:, 0, 0] = head
    there[:, 0, 1:] = there[:, 1:, 0] = tail
    there[:, 1:, 1:] = np.eye(tail.shape[1]) + tail[:, :, None] * tail[:, None] / (1 + head)[:, None, None]
    back = np.array(there)
    back[:, 0, 1:] *= -1
    back[:, 1:, 0] *= -1
    return size * there, back / size, _apply(size * there, dual)


def _reach(point: np.ndarray, step: np.ndarray) -> float:
    """Length of a step that stays within the cones."""
    a = step[:, 0] ** 2 - (step[:, 1:] ** 2).sum(axis=1)
    b = point[:, 0] * step[:, 0] - (point[:, 1:] * step[:, 1:]).sum(axis=1)
    c = _determinant(point)
    root = np.sqrt(np.maximum(b * b - a * c, 0.0))
    # Of a t² + 2 b t + c, which is positive at 0, the smallest positive root.
    below = root - b
    with np.errstate(divide="ignore", invalid="ignore"):
        ends = np.where(below > 0, np.where(b > 0, (-b - root) / a, c / below), np.inf)
    return float(np.where(ends > 0, ends, np.inf).min())

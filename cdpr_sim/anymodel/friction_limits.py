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

ROUNDING = 1e-6
"""Accuracy of its other conditions, as a fraction of the largest term."""

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
    faces = _Faces(cones, corners)
    part, aim, rows = matrix / size, load / size, matrix.shape[1]
    curvature = part.T @ part / LEFT
    x = np.append(np.zeros(rows), 0.5)  # use, and s
    room = faces.room(x)
    dual, one = np.zeros_like(room), np.zeros_like(room)
    one[:, 0] = 1.0
    dual[:, 0] = steepest = np.abs(aim @ part).max() / LEFT + 1
    for _ in range(ITERATIONS):
        left = part @ x[:-1] - aim
        slope = np.append(left @ part / LEFT, 1.0) - faces.gathered(dual)
        gap, value = float((room * dual).sum()), x[-1] + float(left @ left) / (2 * LEFT)
        small, rough = gap / max(1.0, 100 * value), np.abs(slope).max() / steepest
        if small < GAP and (rough < ROUNDING or small < GAP / 1000):
            break
        there, back, inner = _scaling(room, dual)
        hessian = faces.curvature(back @ back)
        hessian[:-1, :-1] += curvature
        hessian[np.diag_indices_from(hessian)] *= 1 + 1e-14
        factor = cho_factor(hessian, check_finite=False)

        def step(target: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
            wanted = _apply(back, _divided(inner, target))  # noqa: B023 called in this iteration alone
            along = cho_solve(factor, faces.gathered(wanted) - slope, check_finite=False)  # noqa: B023
            opens = faces.room(along, still=True)
            return along, opens, wanted - _apply(back, _apply(back, opens))  # noqa: B023

        _, opens, pulls = step(-_product(inner, inner))
        length = min(1.0, _reach(room, opens), _reach(dual, pulls))
        after = float(((room + length * opens) * (dual + length * pulls)).sum())
        centre = (max(after, 0.0) / gap) ** 3 * gap / len(room)
        both = _product(_apply(back, opens), _apply(there, pulls))
        along, opens, pulls = step(centre * one - _product(inner, inner) - both)
        length = min(1.0, BACK * _reach(room, opens), BACK * _reach(dual, pulls))
        if not length > SHORTEST:
            break
        x, dual = x + length * along, dual + length * pulls
        room = faces.room(x)
    found = x[:-1]
    exact = found + np.linalg.lstsq(matrix, load - matrix @ found, rcond=1e-11)[0]
    return exact if shares(exact, cones, corners).max() <= 1 else found


class _Faces:
    """The second-order cones |matrices @ use| <= s: of a pyramid, one for each pair of opposite faces; and s <= 1."""

    def __init__(self, cones: Int[np.ndarray, " rows"], corners: Bool[np.ndarray, " cones"]) -> None:
        rows_of = [np.flatnonzero(cones == cone) for cone in range(len(corners))]
        found: list[tuple[np.ndarray, np.ndarray]] = []
        for rows, pyramid in zip(rows_of, corners, strict=True):
            if pyramid:
                every = itertools.product((1.0, -1.0), repeat=len(rows) - 1)
                found += [(rows, np.array([[1.0, *signs]])) for signs in every]
            else:
                found.append((rows, np.eye(len(rows))))
        wide, self.size = max(map(len, rows_of)), len(cones)
        # Filled up with zeros: of the forces, which then come from s, the last variable; and the last cone is s <= 1.
        self.rows = np.full((len(found) + 1, wide), self.size)
        self.matrices = np.zeros((len(found) + 1, max(len(one) for _, one in found), wide))
        for face, (rows, one) in enumerate(found):
            self.rows[face, : len(rows)], self.matrices[face, : len(one), : len(rows)] = rows, one
        self.turned = self.matrices.transpose(0, 2, 1)
        self.heads = np.append(np.ones(len(found)), -1.0)

    def room(self, x: Float[np.ndarray, " variables"], still: bool = False) -> Float[np.ndarray, "faces width"]:
        """The point of each cone; ``still``: its change with a change of the variables."""
        heads = self.heads * x[-1]
        heads[-1] += 0.0 if still else 1.0
        return np.hstack([heads[:, None], _apply(self.matrices, x[self.rows])])

    def gathered(self, dual: Float[np.ndarray, "faces width"]) -> Float[np.ndarray, " variables"]:
        """The transpose of ``room``."""
        out = np.zeros(self.size + 1)
        np.add.at(out, self.rows, _apply(self.turned, dual[:, 1:]))
        out[-1] += self.heads @ dual[:, 0]
        return out

    def curvature(self, metric: Float[np.ndarray, "faces width width"]) -> Float[np.ndarray, "variables variables"]:
        """The metric of all points as one of the variables."""
        out = np.zeros((self.size + 1, self.size + 1))
        own = self.turned @ metric[:, 1:, 1:] @ self.matrices
        np.add.at(out, (self.rows[:, :, None], self.rows[:, None]), own)
        shared = np.zeros(self.size + 1)
        np.add.at(shared, self.rows, self.heads[:, None] * _apply(self.turned, metric[:, 1:, 0]))
        out[-1], out[:, -1] = out[-1] + shared, out[:, -1] + shared
        out[-1, -1] += metric[:, 0, 0].sum()
        return out


def _apply(matrices: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    return (matrices @ vectors[:, :, None])[:, :, 0]


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
    size = max(float(np.abs(step).max()), 1e-300)
    if not np.isfinite(size):
        return 0.0
    step = step / size  # whose square may be too large for a number
    a = step[:, 0] ** 2 - (step[:, 1:] ** 2).sum(axis=1)
    b = point[:, 0] * step[:, 0] - (point[:, 1:] * step[:, 1:]).sum(axis=1)
    c = _determinant(point)
    root = np.sqrt(np.maximum(b * b - a * c, 0.0))
    # Of a t² + 2 b t + c, which is positive at 0, the smallest positive root.
    below = root - b
    with np.errstate(divide="ignore", invalid="ignore"):
        ends = np.where(below > 0, np.where(b > 0, (-b - root) / a, c / below), np.inf)
    return float(np.where(ends > 0, ends, np.inf).min()) / size

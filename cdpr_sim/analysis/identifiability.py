"""What measurements determine of the unknowns that are fitted to them: rank, correlation, prediction of rows left out.

All of it by the slopes of the residuals at the fit, (numbers, unknowns), both over the numbers' standard errors.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

UNSEEN = 1e-6
"""A singular value below this fraction of the largest, with columns of unit length, is rounding: EA and mass together,
which have exactly the same effect, measure 6e-11; EA, offsets and centre of mass, told apart by 12 poses, 0.02
(``scripts/measure_constants.py``)."""

ALIKE = 0.99
"""Correlation above which two unknowns are hardly told apart."""

UNCERTAIN = 1 / 3
"""Standard error of a positive unknown, as a fraction of it, above which the data hardly say how large it is: twice
that is a factor of two."""

WORSE = 1.5
"""Factor by which rows that are left out are predicted worse than with fewer unknowns, above which the others follow
the noise. Unknowns that are determined, and happen to be 0, make it 1.3 with four numbers for each, 1.1 with eight."""

SHARPER = 5.0
"""Factor by which an unknown is more certain without others that do not help to predict, above which they blur it."""

AS_WELL = 1.02
"""Factor between predictions that are as good as one another: of two such, the one with fewer unknowns is named."""


@dataclass(frozen=True)
class Fit:
    """What came of fitting some unknowns.

    Attributes:
        unknowns: as they are asked for.
        prediction: of rows that are left out, as ``prediction_error`` has it.
        errors: standard errors, by the names of the single numbers.
    """

    unknowns: tuple[str, ...]
    prediction: float
    errors: Mapping[str, float]

    def __str__(self) -> str:
        return f"{' and '.join(self.unknowns)} alone" if self.unknowns else "the robot as it was given"


def directions(
    slope: Float[np.ndarray, "numbers unknowns"],
) -> tuple[Float[np.ndarray, " unknowns"], Float[np.ndarray, "unseen unknowns"], Float[np.ndarray, "seen unknowns"]]:
    """Lengths of the columns, 1 for those of nothing; and, with unit columns, the directions unseen and seen."""
    sizes = np.linalg.norm(slope, axis=0)
    seen = np.where(sizes > 0, sizes, 1.0)
    _, singular, rows = np.linalg.svd(slope / seen, full_matrices=True)
    singular = np.append(singular, np.zeros(len(seen) - len(singular)))
    kept = singular > UNSEEN * singular.max(initial=0.0)
    return seen, rows[~kept], rows[kept]


def fitted_basis(slope: Float[np.ndarray, "numbers unknowns"]) -> Float[np.ndarray, "numbers seen"]:
    """Orthonormal directions in which the unknowns move the numbers; the hat matrix is this times its transpose."""
    seen, _, kept = directions(slope)
    basis = (slope / seen) @ kept.T
    return basis / np.linalg.norm(basis, axis=0)


def leverages(slope: Float[np.ndarray, "numbers unknowns"]) -> Float[np.ndarray, " numbers"]:
    """How far each number is fitted by the unknowns: the diagonal of the hat matrix, whose sum is their count."""
    return (fitted_basis(slope) ** 2).sum(1)


def prediction_error(
    slope: Float[np.ndarray, "numbers unknowns"],
    residuals: Float[np.ndarray, " numbers"],
    rows: Int[np.ndarray, " numbers"],
) -> float:
    """Root mean square error of each row's numbers as the other rows predict them, over their standard errors.

    To first order, without fitting again: (1 − H)⁻¹ times the residuals, with H the row's block of the hat matrix
    (Allen 1974, doi:10.1080/00401706.1974.10489157). Infinite where some row alone determines an unknown; nan of a
    single row.
    """
    basis, total = fitted_basis(slope), 0.0
    places = [np.flatnonzero(rows == row) for row in np.unique(rows)]
    if len(places) < 2:
        return np.nan
    for of_row in places:
        kept = np.eye(len(of_row)) - basis[of_row] @ basis[of_row].T
        values, vectors = np.linalg.eigh(kept)
        if values.min() <= UNSEEN:
            return np.inf
        total += float((((residuals[of_row] @ vectors) / values) ** 2).sum())
    return float(np.sqrt(total / len(rows)))


def certainty(
    slope: Float[np.ndarray, "numbers unknowns"], names: Sequence[str], relative: Sequence[bool]
) -> tuple[Float[np.ndarray, " unknowns"], Float[np.ndarray, "unknowns unknowns"], list[str]]:
    """Standard errors of the unknowns for unit errors of the data, correlations, and in words what the data cannot tell.

    Args:
        slope: of the residuals.
        names: of the unknowns.
        relative: of which of them errors are fractions.
    """
    reasons = [f"the data do not depend on {names[i]}" for i in np.flatnonzero(~slope.any(0))]
    seen, unseen, kept = directions(slope)
    blurred = (np.abs(unseen) > 1e-3).any(0)
    for direction in unseen:
        together = np.flatnonzero(np.abs(direction) > 1e-3)
        if len(together) > 1:
            listed = " and ".join([", ".join(names[i] for i in together[:-1]), names[together[-1]]])
            reasons.append(f"the data cannot tell {listed} apart: they can change together without moving the platform")
    sensitivities = np.linalg.norm((slope / seen) @ kept.T, axis=0)
    covariance = (kept.T / sensitivities**2) @ kept / np.outer(seen, seen)
    errors = np.sqrt(np.diag(covariance))
    with np.errstate(invalid="ignore", divide="ignore"):
        correlations = covariance / np.outer(errors, errors)
    errors = np.where(blurred, np.inf, errors)
    correlations[blurred] = correlations[:, blurred] = np.nan
    for i, j in zip(*np.triu_indices(len(names), 1), strict=True):
        if abs(correlations[i, j]) > ALIKE:
            reasons.append(f"{names[i]} and {names[j]} are hardly told apart: correlation {correlations[i, j]:+.4f}")
    reasons += [
        f"the data hardly determine {name}: its standard error is {error:.0%} of it"
        for name, error, of_it in zip(names, errors, relative, strict=True)
        if of_it and UNCERTAIN < error < np.inf
    ]
    return errors, correlations, reasons


def superfluous(asked: Fit, smaller: Sequence[Fit]) -> list[str]:
    """In a sentence, what fewer unknowns do better: predict rows that are left out, or do so with surer numbers."""
    best = min((one.prediction for one in smaller), default=np.inf)
    good = [one for one in smaller if one.prediction <= AS_WELL * best and one.prediction < np.inf]
    if not good:
        return []
    simplest = min(good, key=lambda one: (len(one.unknowns), one.prediction))
    rest = " and ".join(name for name in asked.unknowns if name not in simplest.unknowns)
    worse = asked.prediction / simplest.prediction if simplest.prediction > 0 else np.inf
    if worse > WORSE:
        times = "" if worse == np.inf else f"{worse:.2g} times "
        return [f"the data do not determine {rest}: rows that are left out are predicted {times}better by {simplest}"]
    shared = {name: asked.errors[name] / error for name, error in simplest.errors.items() if name in asked.errors}
    blurred = max(shared, key=lambda name: shared[name], default="")
    if worse >= 1 and blurred and shared[blurred] > SHARPER:
        return [
            f"the data do not ask for {rest}: rows that are left out are predicted as well by {simplest}, and "
            f"{blurred} is {shared[blurred]:.2g} times as certain then"
        ]
    return []

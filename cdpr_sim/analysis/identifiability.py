"""What measurements determine of the unknowns that are fitted to them: rank, correlation, prediction of rows left out.

All of it by the slopes of the residuals at the fit, (numbers, unknowns), both over the standard errors of the numbers.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Float, Int
from scipy.sparse.csgraph import connected_components

UNSEEN = 1e-6
"""A singular value below this fraction of the largest, with columns of unit length, is rounding: EA and mass together,
which have exactly the same effect, measure 6e-11; EA, offsets and centre of mass, distinguished by 12 poses, 0.02
(``scripts/dev/measure_constants.py``)."""

ALIKE = 0.99
"""Correlation above which the data hardly distinguish two unknowns."""

UNCERTAIN = 1 / 3
"""Standard error of a positive unknown, as a fraction of it, above which the data hardly say how large it is: twice
that is a factor of two. Of a centre of mass, as a fraction of the platform's size."""

INVISIBLE = 0.01
"""Of a number's standard error: what changes no residual by more cannot be seen."""

WORSE = 1.5
"""Factor by which rows left out are predicted worse than with fewer unknowns, above which the data do not hold so many.
Unknowns that the data do determine, and that happen to be as they were believed, make it 1.4 at most with four numbers
for each, 1.13 with eight (85 fits of EA and offsets, of EA for each cable, of offsets). Nine unknowns make it 1 to 15
with 24 angles of 0.1° scatter, 2 to 98 with 12 heights (``scripts/dev/measure_constants.py`` repeats some)."""


def directions(
    slope: Float[np.ndarray, "numbers unknowns"],
) -> tuple[Float[np.ndarray, " unknowns"], Float[np.ndarray, "unseen unknowns"], Float[np.ndarray, "seen unknowns"]]:
    """Lengths of the columns, 1 for those of nothing; and, with unit columns, the directions unseen and seen."""
    sizes = np.linalg.norm(slope, axis=0)
    seen = np.where(sizes > 0, sizes, 1.0)
    _, singular, rows = np.linalg.svd(slope / seen, full_matrices=True)
    singular = np.append(singular, np.zeros(len(seen) - len(singular)))
    kept = singular > UNSEEN * singular[0]
    return seen, rows[~kept], rows[kept]


def fitted_basis(slope: Float[np.ndarray, "numbers unknowns"]) -> Float[np.ndarray, "numbers seen"]:
    """Orthonormal directions in which the unknowns move the numbers; the hat matrix is this times its transpose."""
    if slope.shape[1] == 0:
        return slope
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
    """Root mean square of what fits to all other rows miss of each row's numbers, over their standard errors.

    To first order, without fitting again: (1 − H)⁻¹ times the row's residuals, with H its block of the hat matrix
    (Allen 1974, doi:10.1080/00401706.1974.10489157).

    Args:
        slope: of the residuals at the fit to all rows.
        residuals: there.
        rows: to which row each number belongs.

    Returns:
        The error; inf where one row alone determines an unknown, nan of a single row.
    """
    numbers = [np.flatnonzero(rows == row) for row in np.unique(rows)]
    if len(numbers) < 2:
        return np.nan
    basis, total = fitted_basis(slope), 0.0
    for own in numbers:
        values, vectors = np.linalg.eigh(np.eye(len(own)) - basis[own] @ basis[own].T)
        if values[0] <= UNSEEN:
            return np.inf
        total += float((((residuals[own] @ vectors) / values) ** 2).sum())
    return float(np.sqrt(total / len(residuals)))


def certainty(
    slope: Float[np.ndarray, "numbers unknowns"],
    names: list[str],
    sizes: list[tuple[float, str]],
    unseen_as: str = "moving the platform",
) -> tuple[Float[np.ndarray, " unknowns"], Float[np.ndarray, "unknowns unknowns"], list[str]]:
    """Standard errors of the unknowns, correlations, and sentences about what the data do not determine.

    Args:
        slope: of the residuals.
        names: of the unknowns.
        sizes: what the standard error of each is compared with, and its name; inf where there is nothing.
        unseen_as: what changes that the data do not see do without.
    """
    reasons = [f"the data do not depend on {names[i]}" for i in np.flatnonzero(~slope.any(0))]
    seen, unseen, kept = directions(slope)
    blurred = (np.abs(unseen) > 1e-3).any(0)
    for direction in unseen:
        together = np.flatnonzero(np.abs(direction) > 1e-3)
        if len(together) > 1:
            listed = " and ".join([", ".join(names[i] for i in together[:-1]), names[together[-1]]])
            reasons.append(f"the data cannot distinguish {listed}: they can change together without {unseen_as}")
    sensitivities = np.linalg.norm((slope / seen) @ kept.T, axis=0)
    covariance = (kept.T / sensitivities**2) @ kept / np.outer(seen, seen)
    errors = np.sqrt(np.diag(covariance))
    with np.errstate(invalid="ignore", divide="ignore"):
        correlations = covariance / np.outer(errors, errors)
    errors = np.where(blurred, np.inf, errors)
    correlations[blurred] = correlations[:, blurred] = np.nan
    reasons += _alike(names, correlations)
    reasons += [
        f"the data hardly determine {name}: its standard error is {error / size:.0%} of {what}"
        for name, error, (size, what) in zip(names, errors, sizes, strict=True)
        if np.isfinite(error) and error > UNCERTAIN * size
    ]
    return errors, correlations, reasons


def _alike(names: list[str], correlations: Float[np.ndarray, "unknowns unknowns"]) -> list[str]:
    """For each group of unknowns that the data hardly distinguish a sentence: two of a group may do so by others."""
    alike = np.abs(np.nan_to_num(correlations)) > ALIKE
    count, groups = connected_components(alike, directed=False)
    sentences = []
    for which in (np.flatnonzero(groups == group) for group in range(count)):
        if len(which) > 1:
            first, second = np.triu_indices(len(which), 1)
            found = correlations[which[first], which[second]]
            most = found[np.argmax(np.abs(found))]
            said = f"correlation {most:+.4f}" if len(which) == 2 else f"correlations up to {most:+.4f}"
            listed = f"{', '.join(names[i] for i in which[:-1])} and {names[which[-1]]}"
            sentences.append(f"the data hardly distinguish {listed}: {said}")
    return sentences


def too_many(predictions: Mapping[tuple[str, ...], float]) -> list[str]:
    """In a sentence, that fits of fewer unknowns predict rows left out better; nothing where they do not.

    Args:
        predictions: as ``Identification`` has them.
    """
    best, least = best_of_fewer(predictions)
    of_all = next(iter(predictions.values()))
    if not of_all > max(WORSE * least, INVISIBLE):
        return []
    better = f"{of_all / least:.2g} times better by" if 0 < least < of_all < np.inf else "only by"
    return [f"the data do not determine so many unknowns: omitted rows are predicted {better} {described(best)}"]


def best_of_fewer(predictions: Mapping[tuple[str, ...], float]) -> tuple[tuple[str, ...], float]:
    """The fit of fewer unknowns that predicts rows left out best, and how well; inf where none does."""
    _, *fewer = ((error, names) for names, error in predictions.items())
    least, best = min((one for one in fewer if np.isfinite(one[0])), default=(np.inf, ()))
    return best, least


def described(names: Sequence[str]) -> str:
    """Unknowns that are fitted in place of more, as text."""
    return f"{' and '.join(names)} alone" if names else "the robot as it was given"

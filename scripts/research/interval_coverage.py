"""How often the 95 % intervals of ``identify`` hold the true values, over simulated measurements of IRMA4U."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from typing import Any

import numpy as np
from jaxtyping import Bool, Float

import cdpr_sim as cdpr
from cdpr_sim.analysis.identification_model import IdentificationModel

FITS = 80  # per case
LEAST, MOST = 0.93, 0.97


UNKNOWNS = ("axial_stiffness", "rest_length_offsets")
TRUE_EA = 15e3
"""[N]"""

OFFSETS = np.array([4e-3, -3e-3, 2e-3, -5e-3])
"""[m] of the rest lengths of its four cables."""

ERRORS = {"rotation": np.radians(0.2), "tension": 2.0, "swivel": np.radians(0.2)}
"""Standard errors [rad, N, rad]: the noise is normally distributed."""

LENGTH_ERROR = 1e-3
"""[m] of the rest lengths, where they have one."""

CASES = ("stated", "judged", "lengths")
"""Errors are stated, judged from the residuals, or stated with those of the rest lengths."""


def fitted(case: str, fits: int, rows: int = 8, seed: int = 0) -> list[cdpr.Identification]:
    """Fits to simulated measurements.

    Args:
        case: one of ``CASES``.
        fits: count of simulated sets of measurements.
        rows: poses in each.
        seed: of poses and noise.
    """
    robot, rng = cdpr.load_robot("irma4u"), np.random.default_rng(seed)
    true = robot.replace(axial_stiffness=TRUE_EA)
    errors: dict[str, Any] = {} if case == "judged" else {f"{kind}_error": error for kind, error in ERRORS.items()}
    if case == "lengths":
        errors["rest_length_error"] = LENGTH_ERROR
    believed, length_error = robot.replace(axial_stiffness=20e3), LENGTH_ERROR if case == "lengths" else 0.0
    return [cdpr.identify(believed, simulated(true, rows, rng, length_error), UNKNOWNS, **errors) for _ in range(fits)]


def held(found: Sequence[cdpr.Identification], coverage: float = 0.95) -> Bool[np.ndarray, "fits unknowns"]:
    """Whether each interval holds the true value."""
    intervals = np.array([one.intervals(coverage) for one in found])
    truth = np.array([TRUE_EA, *OFFSETS])
    return (intervals[..., 0] < truth) & (truth < intervals[..., 1])


def simulated(robot: cdpr.Robot, rows: int, rng: np.random.Generator, length_error: float = 0.0) -> cdpr.Measurements:
    """Roll, pitch, tensions and swivel angles with noise, of random poses in the workspace."""
    lower, upper = robot.workspace
    poses = rng.uniform(lower, upper, (rows, 3))
    lengths = np.array([robot.rest_lengths(pose) for pose in poses])
    blank = cdpr.Measurements.of(
        poses, np.zeros((rows, 2)), coordinates=("alpha", "beta"), rest_lengths=lengths + OFFSETS,
        tensions=np.zeros((rows, 4)), swivels=np.zeros((rows, 4)),
    )  # fmt: skip
    shown = IdentificationModel(robot, blank, []).shown(np.zeros(0))
    angles, tensions, swivels = shown[:, 3:5], shown[:, 6:10], shown[:, 10:14]
    return cdpr.Measurements.of(
        poses,
        angles + ERRORS["rotation"] * rng.normal(size=angles.shape),
        coordinates=("alpha", "beta"),
        rest_lengths=lengths + length_error * rng.normal(size=lengths.shape),
        tensions=tensions + ERRORS["tension"] * rng.normal(size=tensions.shape),
        swivels=swivels + ERRORS["swivel"] * rng.normal(size=swivels.shape),
    )


def described(held: Bool[np.ndarray, "fits unknowns"], names: Sequence[str] = UNKNOWNS) -> str:
    """Share of the intervals that hold the true value, of EA and of the offsets."""
    share: Float[np.ndarray, " unknowns"] = held.mean(0)
    return f"{100 * held.mean():.1f} % of all, EA {100 * share[0]:.1f} %, offsets {100 * share[1:].mean():.1f} %"


def main() -> None:
    wrong = False
    for case in CASES:
        holds = held(fitted(case, FITS))
        print(f"errors {case:8s} {FITS} fits: {described(holds)}", flush=True)
        wrong |= not LEAST <= holds.mean() <= MOST
    sys.exit(1 if wrong else 0)


if __name__ == "__main__":
    main()

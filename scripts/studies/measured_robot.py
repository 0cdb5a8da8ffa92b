"""A real robot's measurements against models of it: fit to 27 equilibria of IRMA4U, prediction of 8 others.

Cable lengths go in; tensions, roll and pitch, and swivel angles come out, and were measured. The data files say where
they are from. Yaw is not used: its zero drifts during the measurement.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from jaxtyping import Float

import cdpr_sim as cdpr
from cdpr_sim.analysis.identification_model import IdentificationModel
from cdpr_sim.analysis.measurements import KINDS

FITTED, PREDICTED = (Path(__file__).parent / f"irma4u_{rows}_poses.csv" for rows in (27, 8))

RIGID = 1e8
"""EA [N] of cables that stretch by 2 µm: half a per cent of the smallest residual, in lengths."""

START = 294e3
"""EA [N] of a new Dyneema rope of 3 mm (the material ``dyneema-3mm``): where fits of EA start."""

SENSORS = ("rest_length_offsets", "force_gains", "force_offsets", "swivel_zeros", "center_of_mass")
"""What every calibration corrects: the zeros of encoders, load cells and swivel sensors, the gains of load cells, and
the centre of mass."""

FURTHER = ("rest_length_gains", "angle_zeros")
"""What may be wrong beyond that: the winches' transmission ratios, which the authors corrected by up to 2.6 %, and how
the AHRS is mounted."""

MODELS = {
    "rigid": (RIGID, ()),
    "rigid, calibrated": (RIGID, SENSORS),
    "rigid, all": (RIGID, (*SENSORS, *FURTHER)),
    "elastic": (START, ("axial_stiffness",)),
    "elastic, calibrated": (START, ("axial_stiffness", *SENSORS)),
    "with winch gains": (START, ("axial_stiffness", *SENSORS, "rest_length_gains")),
    "with AHRS zeros": (START, ("axial_stiffness", *SENSORS, "angle_zeros")),
    "with a drive line": (START, ("axial_stiffness", *SENSORS, "winch_to_exit")),
    "with an EA per cable": (START, ("axial_stiffness_each", *SENSORS)),
    "elastic, all": (START, ("axial_stiffness", *SENSORS, *FURTHER)),
}
"""EA to start from [N] and unknowns of each model."""

LENGTHENINGS = 8
"""Corrections of the rest lengths by the cables' elongation: their lengths converge to a micrometre in five."""

SHOWN = {"rotation": (180 / np.pi, "°"), "tension": (1.0, "N"), "swivel": (180 / np.pi, "°")}
"""Factor and unit in which kinds of measurements are shown."""

NATURAL = {"yaw": (1.45, 1.80), "roll": (1.61, 1.96), "pitch": (1.51, 2.06)}
"""[Hz] Range of the highest peaks between 0.5 and 3 Hz of the periodograms of the platform's angles, over 0 to 15, 15
to 30 and 30 to 49 s of OldLoggingFiles/FreeMotion02_exp.mat (Vicon, cables locked). Amplitudes are up to 30°, and
energy goes from one mode to another."""

SWINGING = np.array([-0.144, 0.011, 0.566, -0.013, 0.051, 0.008])
"""Mean pose of its last 5 s [m, rad]."""


@dataclass(frozen=True, eq=False)
class MeasuredFit:
    """A model of the robot, fitted and tested.

    Attributes:
        name: of ``MODELS``.
        found: the fit to the 27 poses; None for a model without unknowns.
        fitted: residuals at the 27 poses, by kind, nan where not measured.
        predicted: the same at the 8 poses.
        aicc: information criterion; of a model without unknowns, with judged errors as well.
        unknowns: count of numbers that were fitted.
    """

    name: str
    found: cdpr.Identification | None
    fitted: dict[str, Float[np.ndarray, "rows numbers"]]
    predicted: dict[str, Float[np.ndarray, "rows numbers"]]
    aicc: float
    unknowns: int

    def rms(self, kind: str, predicted: bool = False) -> float:
        """Root mean square of the residuals of a kind, in the unit of ``SHOWN``."""
        residuals = (self.predicted if predicted else self.fitted)[kind]
        return SHOWN[kind][0] * float(np.sqrt(np.nanmean(residuals**2)))


def measured(path: Path) -> cdpr.Measurements:
    """The poses without yaw."""
    data = cdpr.read_measurements(path)
    without = data.measured.copy()
    without[:, 5] = np.nan
    return replace(data, measured=without)


def fits(names: Sequence[str] = tuple(MODELS), robust: bool = False) -> list[MeasuredFit]:
    """Each model fitted to the 27 poses, and its predictions of the 8."""
    data, others, robot = measured(FITTED), measured(PREDICTED), cdpr.load_robot("irma4u")
    found = []
    for name in names:
        stiffness, unknowns = MODELS[name]
        # The fits do not start from what the catalogue took from them.
        given = robot.replace(axial_stiffness=stiffness, center_of_mass=(0, 0, 0.173))
        if unknowns:
            fit = cdpr.identify(given, data, unknowns, robust=robust)
            left, missed, aicc = fit.residuals, fit.predict(others), fit.aicc
        else:
            fit, aicc = None, np.nan
            left, missed = (_without_fit(given, some) for some in (data, others))
        count = len(fit.names) if fit else 0
        found.append(MeasuredFit(name, fit, _by_kind(data, left), _by_kind(others, missed), aicc, count))
    return found


def _without_fit(robot: cdpr.Robot, data: cdpr.Measurements) -> Float[np.ndarray, "rows numbers"]:
    return np.where(data.known, IdentificationModel(robot, data, []).residuals(np.zeros(0)), np.nan)


def swinging_frequencies(stiffness: float) -> Float[np.ndarray, "6"]:
    """Natural frequencies [Hz] at the pose of the free motion, with locked cables of this EA [N].

    The robot of that log is an earlier one, of libs/config/UACDPR_LAB3.mat.
    """
    robot = cdpr.load_robot("irma4u")
    exits, anchors = robot.exits.copy(), robot.anchors.copy()
    exits[:, 0], anchors[:, 2] = 1.068 * np.sign(exits[:, 0]), 0.28
    robot = robot.replace(
        exits=exits, anchors=anchors, mass=12.966, center_of_mass=(0, 0, 0.173), axial_stiffness=stiffness,
        inertia=np.diag([0.18396111, 0.11544751, 0.1864344]),
    )  # fmt: skip
    wanted = robot.rest_lengths(SWINGING)
    lengths = wanted
    for _ in range(LENGTHENINGS):
        lengths = lengths - (cdpr.solve(robot, SWINGING, lengths).lengths - wanted)
    return cdpr.natural_modes(robot, SWINGING, lengths).frequencies


def _by_kind(data: cdpr.Measurements, residuals: Float[np.ndarray, "rows numbers"]) -> dict[str, np.ndarray]:
    return {kind: residuals[:, data.kinds == KINDS.index(kind)] for kind in SHOWN}

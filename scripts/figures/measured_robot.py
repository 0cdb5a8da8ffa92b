"""A real robot, IRMA4U, against rigid and elastic models: fit to 27 measured poses, prediction of 8 others."""

# pyright: reportArgumentType=false, reportCallIssue=false, reportIndexIssue=false
# matplotlib's stubs know neither keyword dictionaries nor grids of axes.
from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from rich.console import Console

import cdpr_sim as cdpr
from cdpr_sim.analysis.identification_model import IdentificationModel
from cdpr_sim.analysis.measurements import KINDS
from cdpr_sim.core.files import write_whole
from cdpr_sim.drawing import style
from cdpr_sim.drawing.figures import canvas, encoded, key, legend_above, styled
from cdpr_sim.report.analysis_tables import identification_note, identification_table
from cdpr_sim.report.table_style import new_table

LEFT_OUT = ("with AHRS zeros", "with a drive line", "with an EA per cable")  # of the figure
LISTED = "elastic, all"  # the model whose unknowns are listed
OUTPUT = Path(__file__).parents[2] / "pictures" / "measured-robot.png"


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


TITLES = {"tension": "tensions [N]", "rotation": "roll and pitch [°]", "swivel": "swivel angles [°]"}
RIGID_COLOR, ELASTIC_COLOR = style.VERMILLION, style.BLUE
SPREAD = 0.16
"""Height over which points of one model are spread, of the distance between models."""


@styled
def draw_measured_robot(fits: Sequence[MeasuredFit]) -> Figure:
    """Residuals of each kind by model: points of the fit pale, predictions hollow, bars one root mean square wide."""
    rigid = min((one for one in fits if one.name.startswith("rigid")), key=lambda one: one.rms("tension", True))
    elastic = next(one for one in fits if one.name == "elastic")
    figure = canvas(
        style.WIDTH,
        6.4,
        f"A real robot's tensions: elastic cables with {elastic.unknowns} fitted number predict them to "
        f"{elastic.rms('tension', True):.2g}\N{NO-BREAK SPACE}N, rigid cables with {rigid.unknowns} numbers to "
        f"{rigid.rms('tension', True):.2g} N",
        "IRMA4U of the University of Bologna, 4 cables. Numbers: root mean square over the predicted poses. Rows: what "
        "the model is fitted with; the names are explained in the manual.",
    )
    looks = {"ls": "none", "marker": "o"}
    handles = [
        key("27 poses of the fit", color=style.MUTED, alpha=0.45, ms=3, **looks),
        key("8 poses predicted", color=style.INK, mfc="white", ms=4, **looks),
        Patch(fc=style.MUTED, alpha=0.3, label="± root mean square of the predictions"),
    ]
    axes = legend_above(figure, handles, 3).subgridspec(1, len(TITLES)).subplots(sharey=True)
    for place, (kind, title) in zip(axes, TITLES.items(), strict=True):
        _panel(place, kind, fits)
        place.set_title(title)
        place.set_xlabel("model less measurement")
    axes[0].set_yticks(range(len(fits)), [_label(one) for one in fits])
    axes[0].set_ylim(len(fits) - 0.45, -0.6)
    return figure


def _label(fit: MeasuredFit) -> str:
    count = {0: "no unknown", 1: "1 unknown"}.get(fit.unknowns, f"{fit.unknowns} unknowns")
    return f"{fit.name}\n{count}"


def _panel(axes: Axes, kind: str, fits: Sequence[MeasuredFit]) -> None:
    random = np.random.default_rng(0)
    factor, unit = SHOWN[kind]
    widest = 0.0
    for place, fit in enumerate(fits):
        color = RIGID_COLOR if fit.name.startswith("rigid") else ELASTIC_COLOR
        fitted, predicted = (factor * some[~np.isnan(some)] for some in (fit.fitted[kind], fit.predicted[kind]))
        size = fit.rms(kind, predicted=True)
        axes.barh(place, 2 * size, left=-size, height=0.62, color=color, alpha=0.16, lw=0)
        rows = place + SPREAD * random.uniform(-1, 1, fitted.size)
        axes.scatter(fitted, rows, s=7, color=color, alpha=0.4, lw=0, zorder=3)
        rows = place + SPREAD * random.uniform(-1, 1, predicted.size)
        axes.scatter(predicted, rows, s=13, facecolor="white", edgecolor=color, lw=0.9, zorder=4)
        axes.annotate(
            f"{size:.2g} {unit}" if unit == "N" else f"{size:.2f}{unit}", (1, place), (-2, 0),
            xycoords=("axes fraction", "data"), textcoords="offset points", ha="right", va="center", fontsize=8.5,
            color=color, bbox={"fc": "white", "ec": "none", "pad": 1.2, "alpha": 0.85}, zorder=6,
        )  # fmt: skip
        widest = max(widest, np.abs(fitted).max(), np.abs(predicted).max())
    axes.axvline(0, color=style.MUTED, lw=style.HAIR, zorder=1)
    axes.set_xlim(-1.08 * widest, 1.7 * widest)
    axes.spines["left"].set_visible(False)
    axes.tick_params(axis="y", length=0)
    axes.grid(axis="x")


def main() -> None:
    console, found = Console(width=120), {}
    table = new_table(
        "Residuals, root mean square: 27 poses fitted, 8 predicted",
        "model", "un-\nknowns", "AICc", "EA [kN]", "tension [N]\nfit", "\npredicted", "roll, pitch [°]\nfit",
        "\npredicted", "swivel [°]\nfit", "\npredicted", dense=True,
    )  # fmt: skip
    for name in MODELS:
        (fit,) = fits([name])
        found[name] = fit
        EA = "-"
        if fit.found and "axial_stiffness" in fit.found.names:
            value, error = fit.found["axial_stiffness"]
            EA = f"{value / 1e3:.1f} ± {error / 1e3:.1f}"
        sizes = [f"{fit.rms(kind, p):.2f}" for kind in ("tension", "rotation", "swivel") for p in (False, True)]
        table.add_row(name, str(fit.unknowns), "-" if np.isnan(fit.aicc) else f"{fit.aicc:.0f}", EA, *sizes)
    console.print(table)
    listed = found[LISTED].found
    assert listed is not None
    console.print(identification_table(listed))
    console.print(identification_note(listed))
    (robust,) = fits(["elastic, calibrated"], robust=True)
    assert robust.found is not None
    value, error = robust.found["axial_stiffness"]
    print(f"By Huber's weights, the calibrated elastic model: EA = {value / 1e3:.1f} ± {error / 1e3:.1f} kN; outliers:")
    print("  " + ("; ".join(map(str, robust.found.outliers)) or "none"))
    each = found["with an EA per cable"].found
    assert each is not None
    print("EA of each cable [kN]: " + ", ".join(f"{each[f'axial_stiffness {i}'][0] / 1e3:.1f}" for i in range(1, 5)))
    print(
        "Natural frequencies with locked cables [Hz]; measured: "
        + ", ".join(f"{name} {low:.2f} to {high:.2f}" for name, (low, high) in NATURAL.items())
    )
    for EA in (RIGID, listed["axial_stiffness"][0]):
        print(f"  EA {EA:9.3g} N: " + ", ".join(f"{one:.2f}" for one in swinging_frequencies(EA)))
    OUTPUT.parent.mkdir(exist_ok=True)
    figure = draw_measured_robot([found[name] for name in MODELS if name not in LEFT_OUT])
    write_whole({OUTPUT: encoded(figure)})
    print(OUTPUT.name)


if __name__ == "__main__":
    main()

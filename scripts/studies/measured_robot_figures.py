"""Figure of a real robot's measurements against models of it. Nothing is computed here but root mean squares."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from cdpr_sim.drawing import style
from studies.measured_robot import SHOWN, MeasuredFit

SIZE = (9.6, 5.2)
TITLES = {"tension": "tensions [N]", "rotation": "roll and pitch [°]", "swivel": "swivel angles [°]"}
RIGID, ELASTIC = style.VERMILLION, style.BLUE
SPREAD = 0.16
"""Height over which points of one model are spread, of the distance between models."""


def draw_measured_robot(fits: Sequence[MeasuredFit]) -> Figure:
    """Residuals of each kind by model: points of the fit pale, predictions dark, bars one root mean square wide."""
    figure = Figure(figsize=SIZE, layout="constrained")
    figure.get_layout_engine().set(w_pad=0.06, h_pad=0.04, wspace=0.03)  # type: ignore[union-attr]
    axes = figure.subplots(1, len(TITLES), sharey=True)
    for place, (kind, title) in zip(axes, TITLES.items(), strict=True):
        _panel(place, kind, fits)
        place.set_title(title, loc="left", fontsize=10, color=style.INK, pad=8)
    axes[0].set_yticks(range(len(fits)), [_label(one) for one in fits], fontsize=9)
    axes[0].set_ylim(len(fits) - 0.45, -0.6)
    axes[1].set_xlabel("model less measurement", color=style.INK)
    handles = [
        axes[0].scatter([], [], s=9, color=style.MUTED, alpha=0.45, lw=0, label="27 poses of the fit"),
        axes[0].scatter([], [], s=16, facecolor="white", edgecolor=style.INK, lw=0.9, label="8 poses predicted"),
        axes[0].plot([], [], color=style.MUTED, lw=6, alpha=0.3, label="± root mean square of the predictions")[0],
    ]
    figure.legend(handles=handles, loc="outside lower center", ncols=3, frameon=False, fontsize=8.5)
    return figure


def _label(fit: MeasuredFit) -> str:
    count = {0: "no unknown", 1: "1 unknown"}.get(fit.unknowns, f"{fit.unknowns} unknowns")
    return f"{fit.name}\n{count}"


def _panel(axes: Axes, kind: str, fits: Sequence[MeasuredFit]) -> None:
    random = np.random.default_rng(0)
    factor, unit = SHOWN[kind]
    widest = 0.0
    for place, fit in enumerate(fits):
        color = RIGID if fit.name.startswith("rigid") else ELASTIC
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
    axes.set_xlim(-1.08 * widest, 1.45 * widest)
    axes.spines[["top", "right", "left"]].set_visible(False)
    axes.tick_params(axis="y", length=0)
    axes.grid(axis="x", color="#ececec", lw=style.HAIR)
    axes.set_axisbelow(True)

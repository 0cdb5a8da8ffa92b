"""Maps along a path, from the datasets of ``sweep`` over poses: a row for each quantity, a line for each robot."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from cdpr_sim.drawing import style
from cdpr_sim.drawing.figures import canvas, styled
from cdpr_sim.drawing.maps import ELASTIC, FACTORS, TITLES, describe_pretension, variants_of

if TYPE_CHECKING:
    import xarray as xr

HELD = ("feasible", "wrench_feasible")
"""Rows of yes or no: what rigid cables could do."""


@styled
def draw_path_map(dataset: xr.Dataset, waypoints: Sequence[tuple[float, str]]) -> Figure:
    """Tilt, deviation, slack cables and feasibility along a path.

    Args:
        dataset: of ``sweep``, over poses at equal distances along the path.
        waypoints: of each, the fraction of the path at which it lies, and its name.
    """
    names = [name for name in (*ELASTIC, "wrench_feasible") if name in dataset]
    fraction = np.linspace(0, 1, dataset.sizes["pose"])
    variants = variants_of(dataset)
    robots = " and ".join(dict.fromkeys(one.robot for one in variants))
    caption = "Static equilibria (Newton) at equal distances along straight lines through the waypoints, x, y, z [m]."
    if "feasible" in names:
        caption += " Feasible: rigid cables could hold the platform at the commanded pose."
    caption = " ".join(filter(None, [caption, describe_pretension(dataset)]))
    figure = canvas(8.5, 1.6 + 1.35 * len(names), f"{robots}: equilibria along a path", caption)
    panels = figure.subplots(len(names), 1, sharex=True, squeeze=False)[:, 0]
    for ax, name in zip(panels, names, strict=True):
        for number, (robot, material, data) in enumerate(variants):
            looks = {"color": style.CABLES[number % len(style.CABLES)], "ls": style.DASHES[number % len(style.DASHES)]}
            values = FACTORS.get(name, 1.0) * data[name].values
            step = "default" if name in FACTORS else "steps-mid"
            ax.plot(fraction, values, **looks, drawstyle=step, label=f"{robot}, {material}", gid=name)
        ax.set_ylabel(TITLES[name])
        for at, _ in waypoints:
            ax.axvline(at, color=style.FAINT, lw=style.HAIR, zorder=0)
        if name in HELD:
            ax.set_ylim(-0.15, 1.15)
            ax.set_yticks([0, 1], ["no", "yes"])
        elif name in FACTORS:
            ax.set_ylim(bottom=0)
        else:
            ax.set_ylim(-0.15, max(1.15, ax.get_ylim()[1]))
            ax.yaxis.set_major_locator(MaxNLocator(integer=True, nbins=5))
    panels[-1].set_xlim(0, 1)
    panels[-1].set_xticks([at for at, _ in waypoints], [name for _, name in waypoints])
    panels[0].legend(loc="lower left", bbox_to_anchor=(0, 1), ncols=2)
    return figure

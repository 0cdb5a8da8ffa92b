"""Tables of whole workspaces: results of a sweep, and their agreement with MuJoCo."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np
from rich.markup import escape
from rich.table import Table

from cdpr_sim.analysis.workspace.grids import AXES, extent_of
from cdpr_sim.analysis.workspace.hull import Hull
from cdpr_sim.core.status import Status
from cdpr_sim.crosscheck.check import AGREEING, OUTCOMES, REFUSED, Check
from cdpr_sim.drawing.maps import variants_of
from cdpr_sim.report.table_style import new_table

if TYPE_CHECKING:
    import xarray as xr

MOST_LISTED = 20
"""Largest number of disagreements listed; the dataset has all."""

_ERRORS = {
    "position_error": ("pos.", 1e3, "mm"),
    "rotation_error": ("rot.", 180 / np.pi, "°"),
    "tension_error": ("tens.", 1.0, "N"),
}

_FEASIBLE = {"feasible": "static feasible workspace", "wrench_feasible": "wrench-feasible workspace"}
"""Feasibility with rigid cables, by variable of a sweep."""

_HEADINGS = {
    "refused": "refused",
    "agree": "agree",
    "agree_except_neutral": "agree,\nneutral",
    "different_equilibria": "other\nequil.",
    "disagree": "dis-\nagree",
    "unsettled": "unset-\ntled",
    "unsolved": "un-\nsolved",
}


def sweep_table(dataset: xr.Dataset) -> Table:
    """A row for each robot and material: tilt, deviation, share of poses with slack cables, share of feasible poses."""
    solved = dataset["status"] == Status.CONVERGED
    poses = int(np.prod([size for name, size in dataset["status"].sizes.items() if name not in {"robot", "material"}]))
    table = new_table(
        f"Static equilibria from {poses:,} commanded poses",
        "robot", "cables", "solved\n%", "median\ntilt °", "worst\ntilt °", "median\ndev. mm", "worst\ndev. mm",
        "slack\n%", "feas\n%", text_columns=2, dense=True,
    )  # fmt: skip
    for robot, material, one in variants_of(dataset.assign(solved=solved)):
        table.add_row(
            escape(robot),
            escape(material),
            f"{100 * float(one['solved'].mean()):.3g}",
            *(f"{np.degrees(value):.2f}" for value in _median_and_worst(one["tilt"])),
            *(f"{1e3 * value:.2f}" for value in _median_and_worst(one["distance"])),
            f"{100 * float((one['slack_count'] > 0).mean()):.3g}",
            f"{100 * float(one['feasible'].mean()):.3g}" if "feasible" in one else "–",
        )
    return table


def sweep_lines(dataset: xr.Dataset) -> Iterator[str]:
    """Size of the feasible workspace with rigid cables, by robot, where the sweep has it; by material if that matters.

    It does where the materials' mass is taken into account.
    """
    feasible = {name: what for name, what in _FEASIBLE.items() if name in dataset}
    unit = ("", "m", "m²", "m³")[sum(dataset.sizes.get(name, 1) > 1 for name in AXES)]
    if feasible and unit:
        for robot in np.atleast_1d(dataset["robot"].values):
            one = dataset.sel(robot=robot) if "robot" in dataset.dims else dataset
            masks = one[[*feasible]]
            for material in masks["material"].values if "material" in masks.dims else [None]:
                each = masks if material is None else masks.sel(material=material)
                parts = ", ".join(f"{what} {extent_of(each[name]):.4g}" for name, what in feasible.items())
                whole = extent_of(each[next(iter(feasible))] | True)
                name = robot if material is None else f"{robot}, {material}"
                yield escape(f"{name} with rigid cables: {parts}, of {whole:.4g} {unit}.")


def check_table(dataset: xr.Dataset) -> Table:
    """A row for each robot and material: numbers of poses by outcome, and the largest differences.

    The dataset is that of a check, or of a sweep with the quantity "settled".
    """
    poses = int(np.prod([size for name, size in dataset["outcome"].sizes.items() if name not in {"robot", "material"}]))
    present = set(np.unique(dataset["outcome"]).tolist())
    always = {"agree", "disagree", "unsettled"}
    outcomes = [name for code, name in enumerate(OUTCOMES) if name in always or code in present]
    headings = [_HEADINGS[name] for name in outcomes] + [f"{name}\n≤ {unit}" for name, _, unit in _ERRORS.values()]
    headings += ["proved"] if "proved" in dataset else []
    table = new_table(f"MuJoCo and Newton at {poses:,} poses", "robot", "cables", *headings, text_columns=2, dense=True)
    for robot, material, one in variants_of(dataset):
        counts = [int((one["outcome"] == OUTCOMES.index(name)).sum()) for name in outcomes]
        agree = one["outcome"] == OUTCOMES.index("agree")
        largest = [float(one[name].where(agree).max()) * factor for name, (_, factor, _) in _ERRORS.items()]
        cells = [
            f"[red]{count}[/]" if count and not name.startswith("agree") and name != "refused" else str(count)
            for name, count in zip(outcomes, counts, strict=True)
        ]
        proved = [str(int(one["proved"].sum()))] if "proved" in dataset else []
        table.add_row(escape(robot), escape(material), *cells, *(f"{value:.0e}" for value in largest), *proved)
    return table


def all_agree(dataset: xr.Dataset) -> bool:
    """Whether the methods agree at every pose of a sweep with the quantity "settled"."""
    return bool(dataset["outcome"].isin([REFUSED, *AGREEING]).all())


def check_lines(check: Check) -> Iterator[str]:
    """Lines below the table: the verdict, and each pose at which the methods do not agree."""
    poses = check.dataset["outcome"].size
    if check.agrees:
        yield f"[bold green]No disagreement at {poses:,} poses; MuJoCo settled at all of them.[/]"
        return
    yield f"[bold red]{len(check.disagreements):,} of {poses:,} poses do not agree:[/]"
    for one in check.disagreements[:MOST_LISTED]:
        x, y, z = one.position
        why = f": {'; '.join(one.reasons)}" if one.reasons else ""
        where = f"{one.robot}, {one.material} at ({x:g}, {y:g}, {z:g}) m"
        yield escape(f"  {where}: {one.outcome.replace('_', ' ')}{why}")
    if len(check.disagreements) > MOST_LISTED:
        yield f"  and {len(check.disagreements) - MOST_LISTED:,} more"


def hull_table(hull: Hull) -> Table:
    """Volume, surface and centroid of a workspace."""
    table = new_table("Boundary of a workspace", "", "")
    table.row("volume [m³]", f"{hull.volume:.6g}")
    table.row("surface [m²]", f"{hull.surface:.6g}")
    table.row("centroid [m]", ", ".join(f"{value:.4g}" for value in hull.centroid))
    table.add_row("triangles", f"{len(hull.triangles):,}")
    return table


def _median_and_worst(values: xr.DataArray) -> tuple[float, float]:
    """Median and largest value over the poses that have an equilibrium."""
    known = values.values[np.isfinite(values.values)]
    return (float(np.median(known)), float(known.max())) if known.size else (np.nan, np.nan)

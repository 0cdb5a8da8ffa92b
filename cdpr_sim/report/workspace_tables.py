"""Whole workspaces as tables for people: what a sweep found, and whether MuJoCo found the same."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np
from rich.markup import escape
from rich.table import Table

from cdpr_sim.analysis.workspace.grids import AXES, extent_of
from cdpr_sim.analysis.workspace.hull import Hull
from cdpr_sim.core.status import Status
from cdpr_sim.crosscheck.check import OUTCOMES, Check
from cdpr_sim.report.table_style import new_table

if TYPE_CHECKING:
    import xarray as xr

MOST_FINDINGS = 20
"""Poses listed one by one; the dataset has them all."""

_ERRORS = {
    "position_error": ("pos.", 1e3, "mm"),
    "rotation_error": ("rot.", 180 / np.pi, "°"),
    "tension_error": ("tens.", 1.0, "N"),
}

_HELD = {"feasible": "as commanded", "wrench_feasible": "against every wrench"}
"""What rigid cables hold, by variables of a sweep."""

_HEADINGS = {
    "refused": "refused",
    "agree": "agree",
    "agree_but_free": "agree,\nfree",
    "different_equilibria": "other\nrest",
    "disagree": "dis-\nagree",
    "unsettled": "unset-\ntled",
    "unsolved": "un-\nsolved",
}


def sweep_table(dataset: xr.Dataset) -> Table:
    """A row for each robot and material: how far, how tilted, how often slack, how much feasible."""
    solved = dataset["status"] == Status.CONVERGED
    poses = int(np.prod([dataset.sizes[name] for name in "xyz"]))
    table = new_table(
        f"Static equilibria from {poses:,} commanded poses",
        "robot", "cables", "solved\n%", "median\ntilt °", "worst\ntilt °", "median\ndev. mm", "worst\ndev. mm",
        "slack\n%", "feas\n%", words=2, dense=True,
    )  # fmt: skip
    for robot, material, one in _variants(dataset.assign(solved=solved)):
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
    """How much of the grid rigid cables hold, by robot; or why that is left out."""
    held = {name: words for name, words in _HELD.items() if name in dataset}
    unit = ("", "m", "m²", "m³")[sum(dataset.sizes[name] > 1 for name in AXES)]
    if not held:
        yield "Cables have mass here: the static feasible workspace takes no account of that, and is left out."
    elif unit:
        for robot in np.atleast_1d(dataset["robot"].values):
            one = dataset.sel(robot=robot) if "robot" in dataset.dims else dataset
            parts = ", and ".join(f"{words} in {extent_of(one[name]):.4g}" for name, words in held.items())
            whole = extent_of(one[next(iter(held))] | True)
            yield escape(f"Rigid cables hold {robot} {parts}, of {whole:.4g} {unit}.")


def check_table(check: Check) -> Table:
    """A row for each robot and material: how many poses agree, how many do not, and the largest differences."""
    dataset = check.dataset
    poses = int(np.prod([dataset.sizes[name] for name in "xyz"]))
    present = set(np.unique(dataset["outcome"]).tolist())
    always = {"agree", "disagree", "unsettled"}
    words = [word for code, word in enumerate(OUTCOMES) if word in always or code in present]
    headings = [_HEADINGS[word] for word in words] + [f"{name}\n≤ {unit}" for name, _, unit in _ERRORS.values()]
    table = new_table(f"MuJoCo and Newton at {poses:,} poses", "robot", "cables", *headings, words=2, dense=True)
    for robot, material, one in _variants(dataset):
        counts = [int((one["outcome"] == OUTCOMES.index(word)).sum()) for word in words]
        agree = one["outcome"] == OUTCOMES.index("agree")
        largest = [float(one[name].where(agree).max()) * factor for name, (_, factor, _) in _ERRORS.items()]
        cells = [
            f"[red]{count}[/]" if count and not word.startswith("agree") and word != "refused" else str(count)
            for word, count in zip(words, counts, strict=True)
        ]
        table.add_row(escape(robot), escape(material), *cells, *(f"{value:.0e}" for value in largest))
    return table


def check_lines(check: Check) -> Iterator[str]:
    """What is to be said below the table: the verdict, and each pose at which the methods do not agree."""
    poses = check.dataset["outcome"].size
    if check.agrees:
        yield f"[bold green]No disagreement at {poses:,} poses, and every platform came to rest.[/]"
        return
    yield f"[bold red]{len(check.disagreements):,} of {poses:,} poses do not agree:[/]"
    for finding in check.disagreements[:MOST_FINDINGS]:
        x, y, z = finding.position
        why = f": {'; '.join(finding.reasons)}" if finding.reasons else ""
        where = f"{finding.robot}, {finding.material} at ({x:g}, {y:g}, {z:g}) m"
        yield escape(f"  {where}: {finding.outcome.replace('_', ' ')}{why}")
    if len(check.disagreements) > MOST_FINDINGS:
        yield f"  and {len(check.disagreements) - MOST_FINDINGS:,} more"


def hull_table(hull: Hull) -> Table:
    """The surface around a workspace in a few numbers."""
    table = new_table("The border of a workspace", "", "")
    table.add_row(escape("volume [m³]"), f"{hull.volume:.6g}")
    table.add_row(escape("surface [m²]"), f"{hull.surface:.6g}")
    table.add_row(escape("centroid [m]"), ", ".join(f"{value:.4g}" for value in hull.centroid))
    table.add_row("triangles", f"{len(hull.triangles):,}")
    return table


def _median_and_worst(values: xr.DataArray) -> tuple[float, float]:
    """Of the poses that have an equilibrium."""
    known = values.values[np.isfinite(values.values)]
    return (float(np.median(known)), float(known.max())) if known.size else (np.nan, np.nan)


def _variants(dataset: xr.Dataset) -> Iterator[tuple[str, str, xr.Dataset]]:
    """Each robot with each material, by name."""
    for robot in np.atleast_1d(dataset["robot"].values):
        one = dataset.sel(robot=robot) if "robot" in dataset.dims else dataset
        for material in np.atleast_1d(one["material"].values):
            chosen = one.sel(material=material) if "material" in one.dims else one
            yield str(robot), str(material), chosen

"""Tables of layout optimisation and clearances."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from rich.markup import escape
from rich.table import Table

from cdpr_sim.analysis.clearance import Clearances
from cdpr_sim.crosscheck.layout_validation import WORSE, LayoutValidation
from cdpr_sim.design.front import Front
from cdpr_sim.design.layout_result import LayoutResult
from cdpr_sim.report.table_style import new_table


def changes_table(result: LayoutResult) -> Table:
    """Every parameter that changed."""
    table = new_table(f"{result.given.name}: changed parameters", "", "before", "after", "change")
    for one in result.changes:
        if one.unit == "m":
            before, after = 1e3 * one.before, 1e3 * one.after
            table.row(one.name, f"{before:.2f} mm", f"{after:.2f} mm", f"{after - before:+.2f} mm")
        else:
            change = f"{100 * (one.after / one.before - 1):+.3g} %"
            table.row(one.name, f"{one.before:.4g} {one.unit}", f"{one.after:.4g} {one.unit}", change)
    return table


def numbers_table(result: LayoutResult, numbers: Sequence[tuple[str, str, str]]) -> Table:
    """Figures of merit before and after."""
    title = f"{result.given.name}: {result.objective.name}, {result.layouts_evaluated:,} layouts evaluated"
    table = new_table(title, "", "before", "after")
    for row in numbers:
        table.add_row(*map(escape, row), style="yellow" if row[-1].endswith(WORSE) else "")
    return table


def clearance_table(clearances: Clearances) -> Table:
    """The ten poses with the smallest distances."""
    equilibria, least = clearances.equilibria, clearances.least.ravel()
    title = f"{equilibria.robot.name}: smallest distances"
    table = new_table(title, "x [mm]", "y [mm]", "z [mm]", "smallest", text_columns=0)
    order = np.argsort(least)[:10]  # without an equilibrium, nan: last
    at = np.broadcast_to(equilibria.problems.positions, (*equilibria.shape, 3)).reshape(-1, 3)
    for row in order[np.isfinite(least[order])]:
        index = tuple(int(i) for i in np.unravel_index(row, equilibria.shape))
        table.add_row(*(f"{1e3 * x:.1f}" for x in at[row]), escape(clearances.nearest(index)))
    return table


def front_table(front: Front) -> Table:
    """The Pareto front: both objectives of each layout."""
    one, other = front.objectives
    table = new_table(f"{front.given.name}: {one.name} against {other.name}", "robot", one.name, other.name)
    table.add_row("as given", *(goal.shown(value) for goal, value in zip(front.objectives, front.before, strict=True)))
    for number, scores in enumerate(front.scores, start=1):
        table.add_row(str(number), *(goal.shown(value) for goal, value in zip(front.objectives, scores, strict=True)))
    return table


def design_json(validation: LayoutValidation) -> dict[str, Any]:
    """A layout and its validation, in SI units."""
    result, scores = validation.layout, (validation.before.score, validation.after.score)
    before_in_mujoco, after_in_mujoco = (None if np.isnan(score) else score for score in scores)
    return {
        "robot": result.given.name,
        "objective": result.objective.name,
        "before": result.before,
        "after": result.after,
        "before_in_mujoco": before_in_mujoco,
        "after_in_mujoco": after_in_mujoco,
        "poses": len(result.cases),
        "poses_in_mujoco": len(validation.cases),
        "agrees": validation.agrees,
        "better": validation.better,
        "changes": [vars(one) for one in result.changes],
        "largest_displacement": result.largest_displacement,
        "exits": result.robot.exits.tolist(),
        "anchors": result.robot.anchors.tolist(),
        "layouts_evaluated": result.layouts_evaluated,
        "generations": len(result.history),
        "message": result.message,
        "warnings": [*validation.side_effects, *result.warnings],
    }

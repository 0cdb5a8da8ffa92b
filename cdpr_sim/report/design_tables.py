"""What moved and what came of it, as tables."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from rich.markup import escape
from rich.table import Table

from cdpr_sim.analysis.clearance import Clearances
from cdpr_sim.crosscheck.layout_validation import LayoutValidation
from cdpr_sim.design.front import Front
from cdpr_sim.design.layout_result import Change, LayoutResult
from cdpr_sim.report.table_style import new_table


def moved_table(found: LayoutResult) -> Table:
    """Every number that is another now."""
    table = new_table(f"{found.given.name}: what moved", "", "before", "after", "by")
    for one in found.moved:
        if one.name.startswith(("EA", "linear")):
            unit = "N" if one.name.startswith("EA") else "kg/m"
            by = f"{100 * (one.after / one.before - 1):+.3g} %"
            table.add_row(escape(one.name), f"{one.before:.4g} {unit}", f"{one.after:.4g} {unit}", by)
        else:
            before, after = 1e3 * one.before, 1e3 * one.after
            table.add_row(escape(one.name), f"{before:.2f} mm", f"{after:.2f} mm", f"{after - before:+.2f} mm")
    return table


def numbers_table(found: LayoutResult, numbers: Sequence[tuple[str, str, str]]) -> Table:
    """Before and after, side by side."""
    table = new_table(
        f"{found.given.name}: {found.objective.name}, {found.tried:,} layouts tried", "", "before", "after"
    )
    for row in numbers:
        table.add_row(*map(escape, row))
    return table


def clearance_table(found: Clearances) -> Table:
    """The poses at which something comes nearest."""
    table = new_table(
        f"{found.equilibria.robot.name}: what comes nearest", "x [mm]", "y [mm]", "z [mm]", "nearest", words=0
    )
    least = found.least.ravel()
    order = np.argsort(np.where(np.isnan(least), np.inf, least))[:10]
    at = np.broadcast_to(found.equilibria.problems.positions, (*found.equilibria.shape, 3)).reshape(-1, 3)
    for row in order[np.isfinite(least[order])]:
        index = tuple(int(i) for i in np.unravel_index(row, found.equilibria.shape))
        table.add_row(*(f"{1e3 * x:.1f}" for x in at[row]), escape(found.nearest(index)))
    return table


def front_table(front: Front) -> Table:
    """Layouts none of which is better in both goals."""
    one, other = front.objectives
    table = new_table(f"{front.given.name}: {one.name} against {other.name}", "robot", one.name, other.name)
    table.add_row("as given", *(goal.shown(value) for goal, value in zip(front.objectives, front.before, strict=True)))
    for number, scores in enumerate(front.scores, start=1):
        table.add_row(str(number), *(goal.shown(value) for goal, value in zip(front.objectives, scores, strict=True)))
    return table


def design_json(proof: LayoutValidation) -> dict[str, Any]:
    """All of it in SI units."""
    found = proof.found

    def moved(one: Change) -> dict[str, Any]:
        return vars(one)

    return {
        "robot": found.given.name,
        "objective": found.objective.name,
        "before": found.before,
        "after": found.after,
        "before_in_mujoco": None if np.isnan(proof.before.score) else proof.before.score,
        "after_in_mujoco": None if np.isnan(proof.after.score) else proof.after.score,
        "poses": len(found.cases),
        "poses_in_mujoco": len(proof.cases),
        "agrees": proof.agrees,
        "better": proof.better,
        "moved": [moved(one) for one in found.moved],
        "furthest_move": found.distance,
        "exits": found.robot.exits.tolist(),
        "anchors": found.robot.anchors.tolist(),
        "layouts_tried": found.tried,
        "generations": len(found.history),
        "message": found.message,
        "warnings": list(found.warnings),
    }

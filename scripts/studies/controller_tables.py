"""Tables of the comparison of control schemes."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from rich.table import Table

from cdpr_sim.report.table_style import new_table
from studies.controller_comparison import ROPES, RopeTask, Run, rms


def runs_table(runs: Sequence[Run]) -> Table:
    """A row for each task and scheme: errors of position and tilt, and tensions."""
    table = new_table(
        "Control schemes with model errors, in MuJoCo",
        "", "mm\nrms", "mm\nmax", "tilt °\nrms", "tilt °\nmax", "N\nlowest", "N\nhighest", dense=True,
    )  # fmt: skip
    robot = task = None
    for run in runs:
        if (run.task.layout, run.task.material) != robot:
            if robot is not None:
                table.add_section()
            robot = run.task.layout, run.task.material
            table.add_row(", ".join(robot), style="bold")
        if run.task != task:
            task = run.task
            table.add_row(f" {task.path}, up to {task.speed:g} m/s")
        errors, tilts = 1e3 * run.position_errors, np.degrees(run.tilts)
        numbers = (rms(errors), errors.max(), rms(tilts), tilts.max(), run.lowest_tension, run.highest_tension)
        table.add_row(f"  {run.scheme}{', falls' if run.fell else ''}", *(f"{number:.2f}" for number in numbers))
    return table


def summary_table(runs: Sequence[Run]) -> Table:
    """A row for each scheme: range of its position errors on each layout at each speed."""
    groups = list(dict.fromkeys((run.task.layout, run.task.speed) for run in runs))
    table = new_table(
        "Position errors [mm], root mean square: range over cables and paths", "",
        *(f"{layout}\n{speed:g} m/s" for layout, speed in groups), dense=True,
    )  # fmt: skip
    for scheme in dict.fromkeys(run.scheme for run in runs):
        cells = []
        for group in groups:
            own = [one for one in runs if one.scheme == scheme and (one.task.layout, one.task.speed) == group]
            errors = [1e3 * rms(one.position_errors) for one in own]
            cells.append(f"{min(errors):.1f} to {max(errors):.1f}" if errors else "")
        table.add_row(scheme, *cells)
    return table


def ropes_table(runs: Sequence[Run]) -> Table:
    """A row for each scheme: its position error on each kind of ropes."""
    table = new_table(
        "Position errors on ropes with a memory [mm], root mean square", "",
        *(ropes.replace(" ", "\n", 1) for ropes in ROPES), dense=True,
    )  # fmt: skip
    for scheme in dict.fromkeys(run.scheme for run in runs):
        errors = {
            run.task.ropes: f"{1e3 * rms(run.position_errors):.3f}{', falls' if run.fell else ''}"
            for run in runs
            if run.scheme == scheme and isinstance(run.task, RopeTask)
        }
        table.add_row(scheme, *(errors.get(ropes, "") for ropes in ROPES))
    return table

"""Tables of the effects of real cables."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from rich.table import Table

from cdpr_sim.report.table_style import new_table
from cdpr_sim.studies.real_cables import CableEffect


def effects_table(effects: Sequence[CableEffect]) -> Table:
    """A row for each robot and property: displacement of the platform, and difference between the methods."""
    poses = max(len(effect.shifts) for effect in effects)
    table = new_table(
        f"Displacement of the platform, over {poses} poses, settled in MuJoCo",
        "", "mm\nmedian", "mm\n95 %", "tilt °\nmedian", "tilt °\n95 %", "method\ndiff.\nnm", dense=True,
    )  # fmt: skip
    last = ""
    for effect in effects:
        if effect.robot != last:
            if last:
                table.add_section()
            table.add_row(effect.robot, style="bold")
        shifts, turns = (np.quantile(values, [0.5, 0.95]) for values in (1e3 * effect.shifts, np.degrees(effect.turns)))
        table.add_row(
            f"  {effect.what}",
            *map(_short, (*shifts, *turns)),
            _short(1e9 * effect.method_difference),
        )
        last = effect.robot
    return table


def _short(value: float) -> str:
    """Two or three digits."""
    return f"{value:.3g}" if value >= 1 else f"{value:.2g}" if value >= 1e-3 else f"{value:.0e}"


def left_out(effects: Sequence[CableEffect]) -> str:
    """Number of poses at which MuJoCo's platform did not settle; empty if none."""
    missing = [f"{one.unsettled} ({one.robot}, {one.what})" for one in effects if one.unsettled]
    return f"Poses left out because MuJoCo's platform did not settle: {', '.join(missing)}." if missing else ""

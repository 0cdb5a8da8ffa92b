"""Lines settled in MuJoCo and compared with statics pose by pose: agreements and table."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
from rich.table import Table

from cdpr_sim.core.equilibrium import Equilibrium
from cdpr_sim.crosscheck.compare import Agreement, compare
from cdpr_sim.report.table_style import new_table
from cdpr_sim.studies.lines import Line


def agreements(line: Line) -> list[Agreement]:
    """Both methods compared pose by pose, at the same poses."""
    return [compare(static, settled) for static, settled in zip(line.static, line.settled, strict=True)]


def line_table(title: str, settled: Iterable[Equilibrium], agreements: Sequence[Agreement]) -> Table:
    """A row per commanded pose: MuJoCo's equilibrium, and the difference between the two methods."""
    table = new_table(
        title,
        "commanded\nx [mm]", "x\n[mm]", "dev. -z\n[mm]", "tilt\n[°]", "about y\n[°]", "taut\ncables",
        "difference\n[nm]", "verdict", text_columns=0, dense=True,
    )  # fmt: skip
    for end, agreement in zip(settled, agreements, strict=True):
        table.add_row(
            f"{1e3 * end.problem.pose.translation[0]:.2f}",
            f"{1e3 * end.position[0]:.2f}",
            f"{-1e3 * end.deviation[2]:.3f}",
            f"{np.degrees(end.tilt):.3f}",
            f"{np.degrees(end.euler[1]):.3f}",
            str(int((~end.slack).sum())),
            f"{1e9 * agreement.position_error:.2f}",
            "agree" if agreement.agrees else "[red]differ[/]",
        )
    return table

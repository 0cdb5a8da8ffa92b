"""One robot along the paper's lines, settled in MuJoCo and compared with statics pose by pose: results and table."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from rich.table import Table

from cdpr_sim.core.equilibrium import Equilibrium
from cdpr_sim.core.equilibrium_batch import EquilibriumBatch
from cdpr_sim.core.materials import PAPER_MATERIALS
from cdpr_sim.crosscheck.compare import Agreement, compare
from cdpr_sim.physics.settle import settle_many
from cdpr_sim.report.table_style import new_table
from cdpr_sim.robots.catalogue import load_robot
from cdpr_sim.statics.newton import solve_many
from cdpr_sim.studies.lines import PAPER_HEIGHTS, PAPER_LINE, all_solved, along_x


@dataclass(frozen=True, eq=False)
class CheckedLine:
    """One robot commanded along x at one height, settled in MuJoCo and compared with statics row by row."""

    settled: EquilibriumBatch
    agreements: tuple[Agreement, ...]


def checked_lines(
    layout: str,
    materials: Sequence[str] = PAPER_MATERIALS,
    heights: Sequence[float] = PAPER_HEIGHTS,
    *,
    ends: tuple[float, float] = PAPER_LINE,
    rows: int = 9,
) -> dict[tuple[str, float], CheckedLine]:
    """Both methods along the paper's line, compared pose by pose, for each material and height z [m].

    Raises:
        NotConverged: the static solver found no equilibrium at some pose.
        NotSettled: MuJoCo did not settle at some pose.
    """
    lines = {}
    for material in materials:
        robot = load_robot(layout).replace(material=material)
        for height in heights:
            settled = all_solved(settle_many(robot, along_x(robot, height, ends, rows)))
            solved = solve_many(settled.problems)
            agreements = tuple(compare(a, b) for a, b in zip(solved, settled, strict=True))
            lines[material, height] = CheckedLine(settled, agreements)
    return lines


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

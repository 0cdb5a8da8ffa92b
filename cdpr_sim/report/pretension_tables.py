"""What pretension does to a fully constrained robot, as a table and sentences for people."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from rich.table import Table

from cdpr_sim.report.table_style import new_table
from cdpr_sim.studies.pretension import ABOVE, FORCE, HELD, MOST_ERROR, TORQUE, Pretension


def pretension_table(study: Pretension) -> Table:
    """A row for each pretension that MuJoCo settled: the softest and the stiffest direction, and what wrenches do."""
    one = study.stiffening
    table = new_table(
        f"{study.robot.name} in the middle, settled in MuJoCo; pushed with {FORCE:g} N, turned with {TORQUE:g} N m",
        "pretension\nN", f"softest\n{one.directions[0]}\nkN/m", f"stiffest\n{one.directions[-1]}\nkN/m",
        *("\n".join([*push.what.rsplit(" ", 1), _unit(push.what)]) for push in study.pushes), words=0, dense=True,
    )  # fmt: skip
    for row, size in enumerate(one.settled_pretensions):
        moved = (
            np.degrees(push.settled_turns[row]) if _unit(push.what) == "°" else 1e3 * push.settled_shifts[row]
            for push in study.pushes
        )
        softest, stiffest = one.settled[row, [0, -1]] / 1e3
        table.add_row(f"{size:.0f}", f"{softest:.1f}", f"{stiffest:.1f}", *(f"{value:.3f}" for value in moved))
    return table


def conclusions(study: Pretension) -> Iterator[str]:
    """What the study comes to, a sentence each."""
    one, robot = study.stiffening, study.robot
    softest, stiffest = one.eigenvalues[[0, -1], 0], one.eigenvalues[[0, -1], -1]
    yield (
        f"On lengths of rigid cables those from below hang slack: the softest direction has {one.rigid[0] / 1e3:.2g} "
        f"kN/m, the stiffest {one.rigid[-1] / 1e3:.0f} kN/m. Pretensions from {one.pretensions[0]:.1f} to "
        f"{one.pretensions[-1]:.1f} N keep all cables taut and within the winches' {robot.force_max[0]:.0f} N: the "
        f"softest direction then has {softest[0] / 1e3:.0f} to {softest[1] / 1e3:.0f} kN/m, at most "
        f"{softest[1] / one.rigid[0]:.0f} times as much as on lengths of rigid cables, the stiffest "
        f"{stiffest[0] / 1e3:.0f} to {stiffest[1] / 1e3:.0f} kN/m, at most {stiffest[1] / one.rigid[-1]:.2f} times as "
        "much."
    )
    taut = "; ".join(f"{push.what}, {push.taut:.0f} N" for push in study.pushes)
    yield f"The pretension from which on no cable hangs slack: {one.pretensions[0]:.1f} N unloaded; {taut}."
    for wrong in study.wrong:
        where = "from above" if wrong.cable == ABOVE else "from below"
        yield (
            f"One cable {where} cut {MOST_ERROR:.0%} ({1e3 * wrong.errors[-1]:.0f} mm) too short at {HELD:g} N moves "
            f"the platform by {1e3 * wrong.shifts[0]:.1f} mm and {np.degrees(wrong.turns[0]):.1f}° and pulls with "
            f"{wrong.tightest[0]:.0f} N; the winches' {robot.force_max[0]:.0f} N are reached at "
            f"{1e3 * wrong.short_by(float(robot.force_max[0])):.1f} mm. As much too long, it moves it by "
            f"{1e3 * wrong.shifts[-1]:.1f} mm and {np.degrees(wrong.turns[-1]):.1f}°, and it hangs slack from "
            f"{1e3 * wrong.errors[np.flatnonzero(wrong.slack)[0]]:.1f} mm on."
        )
    yield f"The methods are {study.apart[0]:.0e} m apart at most, and {study.apart[1]:.0e} of the stiffness."


def _unit(what: str) -> str:
    return "°" if what.startswith("turned") else "mm"

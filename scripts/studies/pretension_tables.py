"""Effect of pretension on a fully constrained robot, as a table and sentences."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from rich.table import Table

from cdpr_sim.report.table_style import new_table
from cdpr_sim.studies.pretension import ABOVE, FORCE, HELD, MOST_ERROR, TORQUE, Pretension


def pretension_table(study: Pretension) -> Table:
    """A row for each pretension settled in MuJoCo: lowest and highest stiffness, displacements under wrenches."""
    one = study.stiffening
    table = new_table(
        f"{study.robot.name} at the middle, settled in MuJoCo; force of {FORCE:g} N, torque of {TORQUE:g} N m",
        "pretension\nN", f"softest\n{one.directions[0]}\nkN/m", f"stiffest\n{one.directions[-1]}\nkN/m",
        *("\n".join([*push.what.rsplit(" ", 1), _unit(push.what)]) for push in study.pushes),
        text_columns=0, dense=True,
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
    """Results of the study, a sentence each."""
    one, robot = study.stiffening, study.robot
    softest, stiffest = one.eigenvalues[[0, -1], 0], one.eigenvalues[[0, -1], -1]
    yield (
        f"With rigid lengths the lower cables are slack: the softest direction has {one.rigid[0] / 1e3:.2g} "
        f"kN/m, the stiffest {one.rigid[-1] / 1e3:.0f} kN/m. Pretensions from {one.pretensions[0]:.1f} to "
        f"{one.pretensions[-1]:.1f} N keep all cables taut and within the winches' {robot.force_max[0]:.0f} N: the "
        f"softest direction then has {softest[0] / 1e3:.0f} to {softest[1] / 1e3:.0f} kN/m, at most "
        f"{softest[1] / one.rigid[0]:.0f} times as much as with rigid lengths, the stiffest "
        f"{stiffest[0] / 1e3:.0f} to {stiffest[1] / 1e3:.0f} kN/m, at most {stiffest[1] / one.rigid[-1]:.2f} times as "
        "much."
    )
    taut = "; ".join(f"{push.what}, {push.taut:.0f} N" for push in study.pushes)
    yield f"Smallest pretension without slack cables: {one.pretensions[0]:.1f} N unloaded; {taut}."
    for wrong in study.wrong:
        where = "upper" if wrong.cable == ABOVE else "lower"
        yield (
            f"One {where} cable {MOST_ERROR:.0%} ({1e3 * wrong.errors[-1]:.0f} mm) too short at {HELD:g} N moves "
            f"the platform by {1e3 * wrong.shifts[0]:.1f} mm and {np.degrees(wrong.turns[0]):.1f}° and has a tension "
            f"of {wrong.largest_tensions[0]:.0f} N; the winches' {robot.force_max[0]:.0f} N are reached at "
            f"{1e3 * wrong.short_by(float(robot.force_max[0])):.1f} mm. The same length too long moves it by "
            f"{1e3 * wrong.shifts[-1]:.1f} mm and {np.degrees(wrong.turns[-1]):.1f}°; the cable is slack from "
            f"{1e3 * wrong.errors[np.flatnonzero(wrong.slack)[0]]:.1f} mm on."
        )
    distance, share = study.method_differences
    yield f"Largest difference between the methods: {distance:.0e} m, and {share:.0e} of the stiffness."


def _unit(what: str) -> str:
    return "°" if what.startswith("turned") else "mm"

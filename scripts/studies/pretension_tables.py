"""Effect of pretension on a fully constrained robot, as a table and sentences."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from rich.table import Table

from cdpr_sim.report.table_style import new_table
from cdpr_sim.studies.pretension import (
    FORCE,
    HELD,
    MOST_ERROR,
    SIDES,
    TORQUE,
    Pretension,
    directions,
    displacements,
    is_torque,
    shifts,
    turns,
)


def pretension_table(study: Pretension) -> Table:
    """A row for each pretension settled in MuJoCo: lowest and highest stiffness, displacements under wrenches."""
    one, names = study.unloaded, directions(study.unloaded.static)
    table = new_table(
        f"{study.robot.name} at the middle, settled in MuJoCo; force of {FORCE:g} N, torque of {TORQUE:g} N m",
        "pretension\nN", f"softest\n{names[0]}\nkN/m", f"stiffest\n{names[-1]}\nkN/m",
        *("\n".join([*what.rsplit(" ", 1), "°" if is_torque(what) else "mm"]) for what in study.pushes),
        text_columns=0, dense=True,
    )  # fmt: skip
    moved = [displacements(what, push.settled) for what, push in study.pushes.items()]
    for row, size in enumerate(one.settled_values):
        softest, stiffest = one.settled.eigenvalues[row, [0, -1]] / 1e3
        table.add_row(f"{size:.0f}", f"{softest:.1f}", f"{stiffest:.1f}", *(f"{values[row]:.3f}" for values in moved))
    return table


def conclusions(study: Pretension) -> Iterator[str]:
    """Results of the study, a sentence each."""
    sizes, eigenvalues, robot = study.unloaded.values, study.unloaded.static.eigenvalues, study.robot
    softest, stiffest = eigenvalues[[0, -1], 0], eigenvalues[[0, -1], -1]
    yield (
        f"With rigid lengths the lower cables are slack: the softest direction has {study.rigid[0] / 1e3:.2g} "
        f"kN/m, the stiffest {study.rigid[-1] / 1e3:.0f} kN/m. Pretensions from {sizes[0]:.1f} to "
        f"{sizes[-1]:.1f} N keep all cables taut and within the winches' {robot.force_max[0]:.0f} N: the "
        f"softest direction then has {softest[0] / 1e3:.0f} to {softest[1] / 1e3:.0f} kN/m, at most "
        f"{softest[1] / study.rigid[0]:.0f} times as much as with rigid lengths, the stiffest "
        f"{stiffest[0] / 1e3:.0f} to {stiffest[1] / 1e3:.0f} kN/m, at most {stiffest[1] / study.rigid[-1]:.2f} times "
        "as much."
    )
    taut = "; ".join(f"{what}, {size:.0f} N" for what, size in study.taut.items())
    yield f"Smallest pretension without slack cables: {sizes[0]:.1f} N unloaded; {taut}."
    limit = float(robot.force_max[0])
    for cable, wrong in study.wrong.items():
        short, long = ((1e3 * shifts(wrong.static)[end], np.degrees(turns(wrong.static)[end])) for end in (0, -1))
        slack = wrong.values[np.flatnonzero(wrong.static.slack.any(-1))[0]]
        yield (
            f"One {SIDES[cable]} cable {MOST_ERROR:.0%} ({1e3 * wrong.values[-1]:.0f} mm) too short at {HELD:g} N "
            f"moves the platform by {short[0]:.1f} mm and {short[1]:.1f}° and has a tension "
            f"of {wrong.static.tensions[0].max():.0f} N; the winches' {limit:.0f} N are reached at "
            f"{1e3 * study.short_by(cable, limit):.1f} mm. The same length too long moves it by "
            f"{long[0]:.1f} mm and {long[1]:.1f}°; the cable is slack from {1e3 * slack:.1f} mm on."
        )
    distance, share = study.method_differences()
    yield f"Largest difference between the methods: {distance:.0e} m, and {share:.0e} of the stiffness."

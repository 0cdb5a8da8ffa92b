"""A bar on 2 cables: under-actuated, it always turns towards the middle; the closed form is the third witness.

Run it: python scripts/settle_two_cable.py
"""

import numpy as np
from rich.console import Console
from rich.table import Table

import cdpr_sim as cdpr
from cdpr_sim.report import settling as report
from cdpr_sim.statics import two_cable

ROBOT = "two-cable"
MATERIALS = ["vectran-0.7mm", "fishing-0.4mm"]
X = np.linspace(0.17, 0.63, 9)  # [m] commanded, the paper's line
Y = 0.0  # [m]
HEIGHTS = [0.1, 0.2]  # [m]

WHY = """
Why: two cables hold two of the three free directions. The bar turns until the lines of both cables and the
vertical through its middle meet in one point, whatever the elasticity; that decides only where along the way
it hangs. The paper's formula is this for a bar of no length.
"""


def main() -> None:
    console = Console()
    checks = {}
    for material in MATERIALS:
        robot = cdpr.load_robot(ROBOT).replace(material=material)
        for z in HEIGHTS:
            checks[material, z] = cdpr.cross_check(robot, [[x, Y, z] for x in X])
            console.print(report.line_table(f"{ROBOT}, {material}, z = {z} m", checks[material, z]))

    robot = cdpr.load_robot(ROBOT)
    table = Table(
        "commanded x", "MuJoCo", "closed form", "short bar (paper, mended)", title="Rotation about y at z = 0.1 m"
    )
    furthest = 0.0
    for check in checks[MATERIALS[0], HEIGHTS[0]]:
        end = check.settled
        closed = two_cable.equilibrium_rotations(robot, end.position)
        nearest = closed[np.argmin(abs(closed - end.euler[1]))]
        furthest = max(furthest, abs(nearest - end.euler[1]))
        short = two_cable.short_bar_rotation(robot, end.position)
        table.add_row(
            f"{1e3 * end.problem.pose.translation[0]:.0f} mm",
            *(f"{np.degrees(angle):.3f}°" for angle in (end.euler[1], nearest, short)),
        )
    console.print(table)
    console.print(
        f"MuJoCo and the closed form are {furthest:.1e} rad apart at most.",
        highlight=False,
    )
    console.print(" ".join(WHY.split()), highlight=False)


if __name__ == "__main__":
    main()

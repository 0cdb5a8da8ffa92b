"""A bar on 2 cables: under-actuated, it always rotates towards the middle. The closed form is an independent reference.

Run: python scripts/settle_two_cable.py
"""

import numpy as np
from rich.console import Console

import cdpr_sim as cdpr
from cdpr_sim.report.table_style import new_table
from cdpr_sim.statics import two_cable_closed_form
from studies.checked_lines import checked_lines, line_table

ROBOT = "two-cable"
MATERIALS = ["vectran-0.7mm", "fishing-0.4mm"]
HEIGHTS = [0.1, 0.2]  # [m], of the paper's lines

WHY = """
Why: two cables constrain two of the three degrees of freedom. The bar rotates until the lines of both cables and the
vertical line through its middle meet in one point. This holds for every stiffness; the stiffness only determines the
position. The paper's formula is the limit for a bar of length zero.
"""


def main() -> None:
    console, lines = Console(), checked_lines(ROBOT, MATERIALS, HEIGHTS)
    for (material, z), line in lines.items():
        console.print(line_table(f"{ROBOT}, {material}, z = {z} m", line.settled, line.agreements))

    robot = cdpr.load_robot(ROBOT)
    headings = "commanded x", "MuJoCo", "closed form", "short bar (paper, corrected)"
    table = new_table("Rotation about y at z = 0.1 m", *headings, text_columns=0)
    furthest = 0.0
    for end in lines[MATERIALS[0], HEIGHTS[0]].settled:
        closed = two_cable_closed_form.equilibrium_rotations(robot, end.position)
        nearest = closed[np.argmin(abs(closed - end.euler[1]))]
        furthest = max(furthest, abs(nearest - end.euler[1]))
        short = two_cable_closed_form.short_bar_rotation(robot, end.position)
        table.add_row(
            f"{1e3 * end.problem.pose.translation[0]:.2f} mm",
            *(f"{np.degrees(angle):.3f}°" for angle in (end.euler[1], nearest, short)),
        )
    console.print(table)
    console.print(f"MuJoCo and the closed form differ by at most {furthest:.1e} rad.", highlight=False)
    console.print(" ".join(WHY.split()), highlight=False)


if __name__ == "__main__":
    main()

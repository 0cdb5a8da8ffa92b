"""DemoBot with 8 cables in vertical parallelograms: away from the middle it tilts and cables become slack.

Run: python scripts/settle_parallel.py
"""

import numpy as np
from rich.console import Console

import cdpr_sim as cdpr
from studies.checked_lines import checked_lines, line_table

ROBOT = "parallel"
MATERIALS = ["vectran-0.7mm", "fishing-0.4mm"]
HEIGHTS = [0.1, 0.2]  # [m], of the paper's lines

WHY = """
Why: a pair of cables keeps the platform level only while both cables have the same tension. Away from the middle the
lines of the four resulting forces and of the weight do not meet in one point. The upper cables of the near side and the
lower cables of the far side then carry the whole load and the others become slack. The platform rotates until the lines
meet. Stiffer cables do not prevent the tilt: it also occurs with rigid cables.
"""


def main() -> None:
    console, lines = Console(), checked_lines(ROBOT, MATERIALS, HEIGHTS)
    for (material, z), line in lines.items():
        console.print(line_table(f"{ROBOT}, {material}, z = {z} m", line.settled, line.agreements))

    for material in MATERIALS:
        ends = [lines[material, z].settled[end] for z in HEIGHTS for end in (0, -1)]
        sags = [-1e3 * e.deviation[2] for e in ends]
        short = [1e3 * abs(e.deviation[0]) for e in ends]
        console.print(
            f"{material}: at the ends of the line the platform tilts by {degrees(min(e.tilt for e in ends))} to "
            f"{degrees(max(e.tilt for e in ends))}, is {min(sags):.1f} to {max(sags):.1f} mm too low and stays "
            f"{min(short):.0f} to {max(short):.0f} mm short of the commanded x, "
            f"with {min(e.slack.sum() for e in ends)} or more of 8 cables slack. "
            "The paper measured about 20° and about 15 mm.",
            highlight=False,
        )
    stiff = cdpr.load_robot(ROBOT).replace(axial_stiffness=1e8)
    first = [lines[MATERIALS[0], z].settled.commanded[0] for z in HEIGHTS]
    tilts = [degrees(cdpr.solve(stiff, pose).tilt) for pose in first]
    console.print(f"With EA = 1e8 N, nearly rigid, the tilt at x = 170 mm is {' and '.join(tilts)}.", highlight=False)
    console.print(" ".join(WHY.split()), highlight=False)


def degrees(angle: float) -> str:
    return f"{np.degrees(angle):.1f}°"


if __name__ == "__main__":
    main()

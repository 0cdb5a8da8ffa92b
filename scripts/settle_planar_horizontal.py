"""A planar robot on 4 cables in horizontal parallelograms: it does not tilt at all.

Run: python scripts/settle_planar_horizontal.py
"""

import numpy as np
from rich.console import Console

from studies.checked_lines import checked_lines, line_table

ROBOT = "planar-horizontal"
MATERIALS = ["vectran-0.7mm", "fishing-0.4mm"]
HEIGHTS = [0.1, 0.2]  # [m], of the paper's lines

WHY = """
Why: at each position the midlines of the two pairs meet in a point H on the vertical line through the centre of mass.
Equal tensions in each pair produce no torque about H, and the weight produces none while the platform is level.
"""


def main() -> None:
    console, lines = Console(), checked_lines(ROBOT, MATERIALS, HEIGHTS)
    for (material, z), line in lines.items():
        console.print(line_table(f"{ROBOT}, {material}, z = {z} m", line.settled, line.agreements))

    settled = [e for line in lines.values() for e in line.settled]
    spread = max(
        max(abs(e.tensions[0] - e.tensions[1]), abs(e.tensions[2] - e.tensions[3])) / e.tensions.max() for e in settled
    )
    tilt = np.degrees(max(e.tilt for e in settled))
    console.print(
        f"Over all lines and materials the platform tilts by {tilt:.1e}° at most, with all "
        f"4 cables taut: the two cables of a pair differ by {spread:.1e} of the tension.",
        highlight=False,
    )
    console.print(" ".join(WHY.split()), highlight=False)


if __name__ == "__main__":
    main()

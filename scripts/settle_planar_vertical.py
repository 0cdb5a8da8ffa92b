"""A planar robot on 4 cables in vertical parallelograms: 4 taut cables in the middle, then 3, then 2 towards the sides.

Run: python scripts/settle_planar_vertical.py
"""

import numpy as np
from rich.console import Console

import cdpr_sim as cdpr
from studies.checked_lines import checked_lines, line_table

ROBOT = "planar-vertical"
MATERIALS = ["vectran-0.7mm", "fishing-0.4mm"]
HEIGHTS = [0.1, 0.2]  # [m], of the paper's lines

WHY = """
Why: the midlines of the two pairs meet in a point V, about which equal tensions in each pair produce no torque. The
line of the weight passes through V only in the middle. Elsewhere the tensions of a pair differ, until one cable after
the other becomes slack. With two taut cables left, the robot is a two-cable robot.
"""


def main() -> None:
    console, lines = Console(), checked_lines(ROBOT, MATERIALS, HEIGHTS)
    for (material, z), line in lines.items():
        console.print(line_table(f"{ROBOT}, {material}, z = {z} m", line.settled, line.agreements))

    finely = np.linspace(0.1, 0.7, 121)
    for material in MATERIALS:
        robot = cdpr.load_robot(ROBOT).replace(material=material)
        taut = (~cdpr.settle_many(robot, [(x, 0.0, 0.1) for x in finely]).slack).sum(1)
        zones = {count: [x for x, n in zip(finely, taut, strict=True) if n == count] for count in (4, 3, 2)}
        console.print(
            f"{material}, z = 0.1 m: "
            + "; ".join(
                f"{count} taut within {1e3 * max(abs(x - 0.4) for x in zone):.0f} mm of the middle"
                for count, zone in zones.items()
                if zone
            ),
            highlight=False,
        )
    console.print(" ".join(WHY.split()), highlight=False)


if __name__ == "__main__":
    main()

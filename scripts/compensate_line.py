"""Draw the errors along the paper's line without and with compensation: pictures/compensation.png."""

from pathlib import Path

import numpy as np

import cdpr_sim as cdpr
from studies.compensated_line import compensated_line
from studies.compensation_figures import draw_compensation

ROBOTS = {"cogiro": "crossed cables (Cogiro), fishing line", "parallel": "parallel cables, fishing line"}
MATERIAL = "fishing-0.4mm"
LINE = [(x, 0.25, 0.1) for x in np.linspace(0.17, 0.63, 24)]  # m, the paper's
ARM = None  # m, weight of rotation where the pose cannot be held; None: the characteristic length, 59 mm
DPI = 150
OUTPUT = Path(__file__).parent.parent / "pictures" / "compensation.png"


def main() -> None:
    lines = []
    for name, title in ROBOTS.items():
        line = compensated_line(cdpr.load_robot(name).replace(material=MATERIAL), title, LINE, arm=ARM)
        for when, results in (("before", line.settled_before), ("after", line.settled_after)):
            shift, turn = 1e3 * line.position_errors(results).max(), np.degrees(line.rotation_errors(results).max())
            print(f"{name}, {when}: errors in MuJoCo of at most {shift:.3g} mm and {turn:.3g}°")
        print(f"{name}: the commanded pose is held at {line.exact.sum()} of {len(LINE)} points")
        lines.append(line)
    OUTPUT.parent.mkdir(exist_ok=True)
    draw_compensation(lines).savefig(OUTPUT, dpi=DPI)
    print(OUTPUT.name)


if __name__ == "__main__":
    main()

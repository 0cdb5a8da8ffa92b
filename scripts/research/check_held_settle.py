"""Cables with hysteresis: equilibria that ``settle_path`` holds, against MuJoCo's own slow winding, without holding.

    python scripts/research/check_held_settle.py        # 41 equilibria on the paper's line, there and back: minutes
    python scripts/research/check_held_settle.py --counts 512 2048 --poses 5

Prints the largest distance [m] from the held equilibria for each number of time steps from pose to pose. It has to
decrease in proportion to their inverse.
"""

# pyright: reportMissingImports=false

import argparse
import itertools
import sys
from pathlib import Path

import numpy as np

import cdpr_sim as cdpr

# The winding is imported from the folder of the tests.
sys.path.insert(0, str(Path(__file__).parents[2] / "tests"))
from slow_winding import Winding

ROPES = {"width 12 %": [(0.2, np.inf, 0.3)], "yields": [(0.2, 5e-5)]}
"""Hysteresis of DemoBot's cables: in proportion to the tension, and with a yield strain within theirs."""

STEPS = 64
"""Held equilibria from pose to pose."""

if __name__ == "__main__":
    parser = argparse.ArgumentParser(description="Held equilibria against slow winding in MuJoCo")
    parser.add_argument("--counts", type=int, nargs="*", default=[512, 2048, 8192], help="time steps from pose to pose")
    parser.add_argument("--poses", type=int, default=21, help="poses on the line")
    options = parser.parse_args()
    line = np.linspace([0.17, 0.25, 0.1], [0.17 + 0.023 * (options.poses - 1), 0.25, 0.1], options.poses)
    path = np.concatenate([line, line[-2::-1]])
    for name, (title, elements) in itertools.product(("cogiro", "parallel"), ROPES.items()):
        robot = cdpr.load_robot(name).replace(hysteresis=elements)
        held = cdpr.settle_path(robot, path, steps=STEPS)
        start = cdpr.settle_path(robot, path[:1])
        for count in options.counts:
            winding = Winding(robot, start)
            found = [winding.wind(*ends, count) for ends in itertools.pairwise(path)]
            most = np.linalg.norm(found - held.positions[1:], axis=1).max()
            print(f"{name}, {title}: {count:6d} time steps: {most:.1e} m; up to {held.slack.sum(1).max()} cables slack")

"""Compensation along the paper's line, before and after, in one picture: pictures/compensation.png."""

from pathlib import Path

import numpy as np

import cdpr_sim as cdpr
from cdpr_sim.studies.compensation_figures import Line, draw_compensation

ROBOTS = {"cogiro": "crossed cables (Cogiro), fishing line", "parallel": "parallel cables, fishing line"}
MATERIAL = "fishing-0.4mm"
X = np.linspace(0.17, 0.63, 24)  # m, the paper's line
Y, Z = 0.25, 0.1  # m
ARM = None  # m, how much rotation counts where no lengths hold the pose; None: the characteristic length, 59 mm
DPI = 150
OUTPUT = Path(__file__).parent.parent / "pictures" / "compensation.png"


def compensated_line(robot: cdpr.Robot, title: str) -> Line:
    """Before and after by both roads; after starts where the uncompensated platform hangs."""
    poses = [(x, Y, Z) for x in X]
    compensations = [cdpr.compensate(robot, pose, arm=ARM) for pose in poses]
    rest_lengths = [one.rest_lengths for one in compensations]
    before = [cdpr.solve(robot, pose) for pose in poses]
    after = [cdpr.solve(robot, start.pose, rest) for start, rest in zip(before, rest_lengths, strict=True)]
    settled = cdpr.settle_many(robot, poses)
    settled_before = [settled.equilibrium(row) for row in range(len(poses))]
    settled = cdpr.settle_many(robot, [one.pose for one in settled_before], np.array(rest_lengths))
    settled_after = [settled.equilibrium(row) for row in range(len(poses))]
    alone = []
    if not all(one.exact for one in compensations):
        rest_lengths = [cdpr.compensate(robot, pose, arm=0).rest_lengths for pose in poses]
        settled = cdpr.settle_many(robot, [one.pose for one in settled_before], np.array(rest_lengths))
        alone = [settled.equilibrium(row) for row in range(len(poses))]
    return Line(title, before, after, settled_before, settled_after, compensations, alone)


def main() -> None:
    lines = [
        compensated_line(cdpr.load_robot(name).replace(material=MATERIAL), title) for name, title in ROBOTS.items()
    ]
    for (name, _), line in zip(ROBOTS.items(), lines, strict=True):
        for when, results in (("before", line.settled_before), ("after", line.settled_after)):
            errors = [
                np.linalg.norm(found.position - one.commanded.translation)
                for found, one in zip(results, line.compensations, strict=True)
            ]
            turns = [
                np.degrees((found.rotation * one.commanded.rotation.inv()).magnitude())
                for found, one in zip(results, line.compensations, strict=True)
            ]
            print(f"{name}, {when}: at most {1e3 * max(errors):.3g} mm and {max(turns):.3g}° off, in MuJoCo")
        print(f"{name}: the commanded pose is held at {sum(c.exact for c in line.compensations)} of {len(X)} points")
    OUTPUT.parent.mkdir(exist_ok=True)
    draw_compensation(lines).savefig(OUTPUT, dpi=DPI)
    print(OUTPUT.name)


if __name__ == "__main__":
    main()

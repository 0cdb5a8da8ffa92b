"""DemoBot with 8 cables in vertical parallelograms: away from the middle it tilts, and cables become slack.

    python scripts/settle_parallel.py [--video FILE]

The winches command poses along x with the lengths of rigid cables. At each of them MuJoCo settles the platform, and the
Newton solver computes the static equilibrium. The exit status is 0 if both agree at every pose.
"""

import argparse
import itertools
import sys

import numpy as np

import cdpr_sim as cdpr
from cdpr_sim.drawing.video.writing import checked_file

ROBOT = "parallel"
MATERIALS = ("vectran-0.7mm", "fishing-0.4mm")  # EA: 10 kN (assumed) and 1 kN
X = np.linspace(0.17, 0.63, 9)  # [m]
Y, HEIGHTS = 0.25, (0.1, 0.2)  # [m]
SECONDS = 20  # [s] of the drive along the line that the video shows

WHY = """\
Why: a pair of cables keeps the platform level only while both have the same tension. Away from the middle,
equal tensions in the pairs cannot balance the weight: some cables become slack, and the platform rotates until
the lines of the others and of the weight meet. Stiffer cables do not prevent it."""


def main() -> int:
    parser = argparse.ArgumentParser(description="Settle DemoBot's parallel layout along the paper's line.")
    parser.add_argument(
        "--video", metavar="FILE", help="write a video of a drive along the line as well (.mp4 or .gif)"
    )
    video = parser.parse_args().video
    if video:
        checked_file(video)
    agree = True
    for material, z in itertools.product(MATERIALS, HEIGHTS):
        robot, line = cdpr.load_robot(ROBOT).replace(material=material), [(x, Y, z) for x in X]
        print(f"\n{ROBOT}, {material}, commanded along x at z = {z} m")
        print("commanded x   MuJoCo: x     deviation z      tilt  taut cables  MuJoCo and Newton")
        for x, static, settled in zip(X, cdpr.solve_many(robot, line), cdpr.settle_many(robot, line), strict=True):
            agreement = cdpr.compare(static, settled)
            agree &= agreement.agrees
            print(
                f"{1e3 * x:8.1f} mm {1e3 * settled.position[0]:9.2f} mm {1e3 * settled.deviation[2]:12.3f} mm"
                f" {np.degrees(settled.tilt):8.3f}° {(~settled.slack).sum():12d}"
                f"  {agreement.verdict.name.lower()}, {1e3 * agreement.position_error:.1e} mm apart"
            )
    print(f"\n{WHY}")
    if video:
        robot = cdpr.load_robot(ROBOT).replace(material=MATERIALS[-1])
        motion = cdpr.drive(robot, [(x, Y, HEIGHTS[0]) for x in (X[0], X[-1])], seconds=SECONDS)
        print(cdpr.write_video(video, motion, cdpr.solve_trajectory(motion).poses))
    return 0 if agree else 1


if __name__ == "__main__":
    try:
        sys.exit(main())
    except cdpr.CdprError as error:
        sys.exit(str(error))

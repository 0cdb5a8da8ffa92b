"""A bar on 2 cables, under-actuated: it rotates towards the middle, as a closed form says that neither method uses.

    python scripts/settle_two_cable.py [--video FILE]

The winches command poses along x with the lengths of rigid cables. At each of them MuJoCo settles the bar, and the
Newton solver computes the static equilibrium. At the bar's position, the closed form gives all rotations in
equilibrium. The exit status is 0 if all three agree at every pose.
"""

import argparse
import itertools
import sys

import numpy as np

import cdpr_sim as cdpr
from cdpr_sim.drawing.video.writing import checked_file
from cdpr_sim.statics import two_cable_closed_form

ROBOT = "two-cable"
MATERIALS = ("vectran-0.7mm", "fishing-0.4mm")  # EA: 10 kN (assumed) and 1 kN
X = np.linspace(0.17, 0.63, 9)  # [m]
Y, HEIGHTS = 0.0, (0.1, 0.2)  # [m]
SAME = 1e-6  # [rad] largest difference from the closed form that counts as agreement
SECONDS = 20  # [s] of the drive along the line that the video shows

WHY = """\
Why: two cables constrain two of the three degrees of freedom. The bar rotates until the lines of both cables
and the vertical line through its middle meet in one point. This holds for every stiffness, which only
determines the position."""


def main() -> int:
    parser = argparse.ArgumentParser(description="Settle a bar on two cables along a line.")
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
        print("commanded x   MuJoCo: x     deviation z   rotation  closed form  MuJoCo and Newton")
        for x, static, settled in zip(X, cdpr.solve_many(robot, line), cdpr.settle_many(robot, line), strict=True):
            agreement = cdpr.compare(static, settled)
            rotation = settled.euler[1]
            closed = two_cable_closed_form.equilibrium_rotations(robot, settled.position)
            nearest = closed[np.argmin(np.abs(closed - rotation))]
            agree &= agreement.agrees and bool(abs(nearest - rotation) <= SAME)
            print(
                f"{1e3 * x:8.1f} mm {1e3 * settled.position[0]:9.2f} mm {1e3 * settled.deviation[2]:12.3f} mm"
                f" {np.degrees(rotation):9.4f}° {np.degrees(nearest):11.4f}°"
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

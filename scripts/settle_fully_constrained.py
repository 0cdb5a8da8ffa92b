"""IPAnema 1, 8 cables that pull against one another: pretension prevents slack cables and makes the robot stiffer.

    python scripts/settle_fully_constrained.py [--video FILE]

The robot is commanded to the middle of its workspace with different pretensions, without and with a load. MuJoCo
settles each case, and the Newton solver computes the static equilibrium. The exit status is 0 if both agree in every
case.
"""

import argparse
import itertools
import sys

import numpy as np

import cdpr_sim as cdpr
from cdpr_sim.drawing.video.writing import checked_file

ROBOT = "ipanema-1"
PRETENSIONS = (90.0, 150.0, 300.0, 600.0)  # [N]; the limit of the winches is 720 N
LOADS = {  # [N], [N m]
    "no load": np.array([0, 0, 0, 0, 0, 0]),
    "100 N down": np.array([0, 0, -100, 0, 0, 0]),
    "2 N m about z": np.array([0, 0, 0, 0, 0, 2]),
}
DRIVEN, SECONDS, REACH = 300.0, 8, np.array([0.4, 0, 0])  # [N], [s], [m] of the drive along x that the video shows

WHY = """\
Why: a fully constrained platform is pulled from all sides, so that all cables can be taut without a load. A
load makes a cable slack where it takes more than its pretension. Rotations are resisted by the tensions as well
as by the stretch, so that the lowest stiffness increases with pretension."""


def main() -> int:
    parser = argparse.ArgumentParser(description="Settle IPAnema 1 with different pretensions.")
    parser.add_argument("--video", metavar="FILE", help="write a video of a drive along x as well (.mp4 or .gif)")
    video = parser.parse_args().video
    if video:
        checked_file(video)
    agree = True
    print("pretension  load              deviation  rotation  slack cables  lowest stiffness  MuJoCo and Newton")
    for (name, load), pretension in itertools.product(LOADS.items(), PRETENSIONS):
        robot = cdpr.load_robot(ROBOT).replace(pretension=pretension)
        static = cdpr.solve(robot, robot.home, external_wrench=load)
        settled = cdpr.settle(robot, robot.home, external_wrench=load)
        agreement = cdpr.compare(static, settled)
        agree &= agreement.agrees
        print(
            f"{pretension:8.0f} N  {name:14} {1e3 * np.linalg.norm(settled.deviation):9.4f} mm"
            f" {np.degrees(settled.rotation.magnitude()):8.4f}° {settled.slack.sum():13d}"
            f" {settled.eigenvalues[0] / 1e3:12.2f} N/mm"
            f"  {agreement.verdict.name.lower()}, {1e3 * agreement.position_error:.1e} mm apart"
        )
    print(f"\n{WHY}")
    if video:
        robot = cdpr.load_robot(ROBOT).replace(pretension=DRIVEN)
        motion = cdpr.drive(robot, [robot.home - REACH, robot.home + REACH], seconds=SECONDS)
        print(cdpr.write_video(video, motion, cdpr.solve_trajectory(motion).poses))
    return 0 if agree else 1


if __name__ == "__main__":
    try:
        sys.exit(main())
    except cdpr.CdprError as error:
        sys.exit(str(error))

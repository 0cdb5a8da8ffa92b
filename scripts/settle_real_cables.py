"""DemoBot on real cables: what pulleys, mass, nonlinear elasticity and drive lines change.

    python scripts/settle_real_cables.py [--video FILE]

One pose is commanded with the lengths of rigid cables of each kind: of plain cables, with each property alone, and
with all of them. MuJoCo settles each case, and the Newton solver computes the static equilibrium. The exit status is
0 if both agree in every case.
"""

import argparse
import sys

import numpy as np

import cdpr_sim as cdpr
from cdpr_sim.drawing.video.writing import checked_file

ROBOTS = ("cogiro", "parallel")
POSE = (0.3, 0.25, 0.1)  # [m]
PROPERTIES = {
    "plain cables": {},
    "pulleys": {"pulley_radius": 0.01, "pulley_axis": (0, 0, 1)},  # [m], assumed: small wheels, cables from below
    "mass of the cables": {"linear_density": 0.0005},  # [kg/m], assumed: Vectran of 0.7 mm, 1.4 g/cm³
    "nonlinear elasticity": {"stiffening": (50.0, 0.0)},  # assumed: twice as stiff at a strain of 1 %, as new ropes
    "rope behind the exits": {"winch_to_exit": 0.5},  # [m], assumed: winches at the floor
}
TOGETHER = {name: value for properties in PROPERTIES.values() for name, value in properties.items()}
END, SECONDS = (0.5, 0.25, 0.1), 10  # [m], [s] of the drive that the video shows

WHY = """\
Why: rope behind the exits stretches as well, so that the platform hangs lower. Pulleys change the directions of
the cables, and so does the cables' mass; the parallel layout, whose tilt depends on these directions, moves
more than the crossed one. Under a few newtons these cables are strained too little for their elasticity to be
nonlinear."""


def main() -> int:
    parser = argparse.ArgumentParser(description="Settle DemoBot with the properties of real cables.")
    parser.add_argument("--video", metavar="FILE", help="write a video of a drive with all properties (.mp4 or .gif)")
    video = parser.parse_args().video
    if video:
        checked_file(video)
    agree = True
    for name in ROBOTS:
        print(f"\n{name}, commanded to {POSE} m")
        print("cables                   deviation x    deviation z      tilt  taut cables  MuJoCo and Newton")
        for what, properties in {**PROPERTIES, "all together": TOGETHER}.items():
            robot = cdpr.load_robot(name).replace(**properties)
            static, settled = cdpr.solve(robot, POSE), cdpr.settle(robot, POSE)
            agreement = cdpr.compare(static, settled)
            agree &= agreement.agrees
            print(
                f"{what:22} {1e3 * settled.deviation[0]:10.3f} mm {1e3 * settled.deviation[2]:11.3f} mm"
                f" {np.degrees(settled.tilt):8.3f}° {(~settled.slack).sum():12d}"
                f"  {agreement.verdict.name.lower()}, {1e3 * agreement.position_error:.1e} mm apart"
            )
    print(f"\n{WHY}")
    if video:
        robot = cdpr.load_robot(ROBOTS[-1]).replace(**TOGETHER)
        motion = cdpr.drive(robot, [POSE, END], seconds=SECONDS)
        static = cdpr.solve_trajectory(motion)
        print(cdpr.write_video(video, motion, static.poses, shapes=cdpr.cable_profiles(motion)))
    return 0 if agree else 1


if __name__ == "__main__":
    try:
        sys.exit(main())
    except cdpr.CdprError as error:
        sys.exit(str(error))

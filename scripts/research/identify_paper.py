"""Compute the axial stiffness, or the rope behind the exits, for the paper's 15 mm, and the consequences."""

import numpy as np

import cdpr_sim as cdpr

ROBOT = "parallel"
ENDS = (0.17, 0.63)  # m, of the paper's line along x
Y = 0.25  # m
HEIGHTS = (0.1, 0.2)  # m, the paper's z1 and z2
DEVIATION = -0.015  # m along z, "about 15 mm" (Sec. IV, Fig. 12a)
ASSUMED = {"vectran": 10e3, "fishing line": 1e3}  # N
RATIO = 10  # the fishing line is "approximately 10 times" softer


def deviations(stiffness: float, height: float) -> str:
    """Deviation in z and rotation about y at the left end, and the deviation of ``cogiro`` in z in the middle."""
    end = cdpr.solve(cdpr.load_robot(ROBOT).replace(axial_stiffness=stiffness), (ENDS[0], Y, height))
    middle = cdpr.solve(cdpr.load_robot("cogiro").replace(axial_stiffness=stiffness), (0.4, Y, height))
    return (
        f"EA {stiffness:9.1f} N: {1e3 * end.deviation[2]:7.2f} mm and {np.degrees(end.euler[1]):5.1f}° at the end, "
        f"{1e3 * middle.deviation[2]:7.2f} mm on cogiro in the middle"
    )


def main() -> None:
    robot = cdpr.load_robot(ROBOT)
    for height in HEIGHTS:
        commanded = np.array([(x, Y, height) for x in ENDS])
        measurements = cdpr.Measurements.of(commanded, commanded[:, 2:] + DEVIATION, coordinates=["z"])
        found = cdpr.identify(robot, measurements)
        stiffness, _ = found["axial_stiffness"]
        print(f"z = {height:g} m: 15 mm at both ends need EA = {stiffness:.1f} N")
        print("  if that is the softer line, the stiffer one is ten times that:")
        print("    fishing ", deviations(stiffness, height))
        print("    vectran ", deviations(RATIO * stiffness, height))
        print("  if it is the stiffer one:")
        print("    vectran ", deviations(stiffness, height))
        print("    fishing ", deviations(stiffness / RATIO, height))
        print("  with rigid cables")
        print("            ", deviations(1e7, height))
        for name, assumed in ASSUMED.items():
            found = cdpr.identify(robot.replace(axial_stiffness=assumed), measurements, "winch_to_exit")
            behind, _ = found["winch_to_exit"]
            crossed = cdpr.load_robot("cogiro").replace(axial_stiffness=assumed, winch_to_exit=behind)
            middle = 1e3 * cdpr.solve(crossed, (0.4, Y, height)).deviation[2]
            print(f"  or {behind:.1f} m of {name} between winch and exit; then {middle:.1f} mm on cogiro in the middle")


if __name__ == "__main__":
    main()

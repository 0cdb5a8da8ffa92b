"""Compare both methods over the workspace of each robot of the catalogue: python scripts/check_zoo.py [ROBOT...].

The rest lengths are those of the commanded poses. Fully constrained robots are also compared with all cables shorter by
a thousandth.
"""

import sys

import cdpr_sim as cdpr
from cdpr_sim.crosscheck.compare import Verdict
from studies.zoo_check import PRETENSION_STRAIN, check_robot

POSES = 200  # random poses without rotation, per robot
HEAD = (
    "robot",
    "drawn in",
    "agree",
    "free",
    "different",
    "disagree",
    "unsolved",
    "diff. [mm]",
    "tension [N]",
    "diff. [N]",
)


def main(names: list[str]) -> None:
    print(f"{POSES} random poses without rotation per row\n")
    print(f"{HEAD[0]:>22}" + "".join(f"{word:>13}" for word in HEAD[1:]))
    for name in names or cdpr.list_robots():
        robot = cdpr.load_robot(name)
        for strain in (0.0, PRETENSION_STRAIN) if robot.kind == "fully constrained" else (0.0,):
            found = check_robot(robot, POSES, strain)
            counts = [found.verdicts[verdict] for verdict in Verdict]
            print(
                f"{name:>22}{strain:>13.1%}"
                + "".join(f"{count:>13}" for count in (*counts, found.unsolved))
                + f"{1e3 * found.position_error:>13.1e}{found.tension:>13.4g}{found.tension_error:>13.1e}",
                flush=True,
            )


if __name__ == "__main__":
    try:
        main(sys.argv[1:])
    except cdpr.CdprError as error:
        sys.exit(f"check_zoo: {error}")

"""DemoBot's layouts along the paper's lines, settled in MuJoCo and compared with statics: which of them tilt, and why.

Run: python scripts/settle_demobot.py [ROBOT...]; default: all five.
"""

import sys
from collections.abc import Iterator, Sequence

import numpy as np
from rich.console import Console
from rich.table import Table

import cdpr_sim as cdpr
from cdpr_sim.core.materials import PAPER_MATERIALS
from cdpr_sim.report.table_style import new_table
from cdpr_sim.statics import two_cable_closed_form
from cdpr_sim.studies.lines import Line, paper_lines
from studies.checked_lines import agreements, line_table

ROWS = 9  # poses of a line


def cogiro(lines: Sequence[Line]) -> Iterator[str]:
    """8 crossed cables: it stays level and nearly straight."""
    for material in PAPER_MATERIALS:
        settled = [e for line in lines if line.robot.material == material for e in line.settled]
        tilt = np.degrees(max(e.tilt for e in settled))
        deviations = [-1e3 * e.deviation[2] for e in settled]
        yield (
            f"{material}: over the whole line the platform tilts by {tilt:.3f}° at most, "
            f"is {min(deviations):.3f} to {max(deviations):.3f} mm "
            f"too low, and at least {min((~e.slack).sum() for e in settled)} of 8 cables are taut."
        )
    yield (
        "Why: on each side of the frame the crossed cables pull from both sides of the platform. Their tensions can "
        "balance the weight at the level pose itself. The only deviation is then that of the stretch under these "
        "tensions: it is ten times larger with cables that are ten times softer."
    )


def parallel(lines: Sequence[Line]) -> Iterator[str]:
    """8 cables in vertical parallelograms: away from the middle it tilts and cables become slack."""
    for material in PAPER_MATERIALS:
        ends = [line.settled[end] for line in lines if line.robot.material == material for end in (0, -1)]
        deviations = [-1e3 * e.deviation[2] for e in ends]
        short = [1e3 * abs(e.deviation[0]) for e in ends]
        yield (
            f"{material}: at the ends of the line the platform tilts by {degrees(min(e.tilt for e in ends))} to "
            f"{degrees(max(e.tilt for e in ends))}, is {min(deviations):.1f} to {max(deviations):.1f} mm too low and "
            f"stays {min(short):.0f} to {max(short):.0f} mm short of the commanded x, "
            f"with {min(e.slack.sum() for e in ends)} or more of 8 cables slack. "
            "The paper measured about 20° and about 15 mm."
        )
    stiff = lines[0].robot.replace(axial_stiffness=1e8)
    first = [line.settled.commanded[0] for line in lines if line.robot.material == PAPER_MATERIALS[0]]
    tilts = [degrees(cdpr.solve(stiff, pose).tilt) for pose in first]
    yield f"With EA = 1e8 N, nearly rigid, the tilt at x = 170 mm is {' and '.join(tilts)}."
    yield (
        "Why: a pair of cables keeps the platform level only while both cables have the same tension. Away from the "
        "middle the lines of the four resulting forces and of the weight do not meet in one point. The upper cables of "
        "the near side and the lower cables of the far side then carry the whole load and the others become slack. The "
        "platform rotates until the lines meet. Stiffer cables do not prevent the tilt: it also occurs with rigid "
        "cables."
    )


def planar_horizontal(lines: Sequence[Line]) -> Iterator[str]:
    """4 cables in horizontal parallelograms: it does not tilt at all."""
    settled = [e for line in lines for e in line.settled]
    pairs = [(e, abs(e.tensions[0] - e.tensions[1]), abs(e.tensions[2] - e.tensions[3])) for e in settled]
    spread = max(max(one, other) / e.tensions.max() for e, one, other in pairs)
    tilt = np.degrees(max(e.tilt for e in settled))
    yield (
        f"Over all lines and materials the platform tilts by {tilt:.1e}° at most, with all "
        f"4 cables taut: the two cables of a pair differ by {spread:.1e} of the tension."
    )
    yield (
        "Why: at each position the midlines of the two pairs meet in a point H on the vertical line through the centre "
        "of mass. Equal tensions in each pair produce no torque about H, and the weight produces none while the "
        "platform is level."
    )


def planar_vertical(lines: Sequence[Line]) -> Iterator[str]:
    """4 cables in vertical parallelograms: 4 are taut in the middle, then 3, then 2 towards the sides."""
    finely = np.linspace(0.1, 0.7, 121)
    for material in PAPER_MATERIALS:
        robot = lines[0].robot.replace(material=material)
        taut = (~cdpr.settle_many(robot, [(x, 0.0, 0.1) for x in finely]).slack).sum(1)
        zones = {count: finely[taut == count] for count in (4, 3, 2)}
        yield f"{material}, z = 0.1 m: " + "; ".join(
            f"{count} taut within {1e3 * np.abs(zone - 0.4).max():.0f} mm of the middle"
            for count, zone in zones.items()
            if zone.size
        )
    yield (
        "Why: the midlines of the two pairs meet in a point V, about which equal tensions in each pair produce no "
        "torque. The line of the weight passes through V only in the middle. Elsewhere the tensions of a pair differ, "
        "until one cable after the other becomes slack. With two taut cables left, the robot is a two-cable robot."
    )


def two_cable(lines: Sequence[Line]) -> Iterator[str | Table]:
    """A bar on 2 cables, under-actuated: it rotates towards the middle. The closed form is an independent reference."""
    robot, line = cdpr.load_robot("two-cable"), lines[0]
    headings = "commanded x", "MuJoCo", "closed form", "short bar (paper, corrected)"
    table = new_table(f"Rotation about y at z = {line.height:g} m", *headings, text_columns=0)
    furthest = 0.0
    for end in line.settled:
        closed = two_cable_closed_form.equilibrium_rotations(robot, end.position)
        nearest = closed[np.argmin(abs(closed - end.euler[1]))]
        furthest = max(furthest, abs(nearest - end.euler[1]))
        short = two_cable_closed_form.short_bar_rotation(robot, end.position)
        table.add_row(
            f"{1e3 * end.problem.pose.translation[0]:.2f} mm",
            *(f"{np.degrees(angle):.3f}°" for angle in (end.euler[1], nearest, short)),
        )
    yield table
    yield f"MuJoCo and the closed form differ by at most {furthest:.1e} rad."
    yield (
        "Why: two cables constrain two of the three degrees of freedom. The bar rotates until the lines of both cables "
        "and the vertical line through its middle meet in one point. This holds for every stiffness; the stiffness "
        "only determines the position. The paper's formula is the limit for a bar of length zero."
    )


def degrees(angle: float) -> str:
    return f"{np.degrees(angle):.1f}°"


CONCLUSIONS = {
    "cogiro": cogiro,
    "parallel": parallel,
    "planar-horizontal": planar_horizontal,
    "planar-vertical": planar_vertical,
    "two-cable": two_cable,
}


def main(names: Sequence[str]) -> None:
    console = Console()
    for name in names or CONCLUSIONS:
        lines = paper_lines([name], static_rows=ROWS, settled_rows=ROWS)
        for line in lines:
            title = f"{name}, {line.robot.material}, z = {line.height:g} m"
            console.print(line_table(title, line.settled, agreements(line)))
        for part in CONCLUSIONS[name](lines):
            console.print(part, highlight=False)


if __name__ == "__main__":
    main(sys.argv[1:])

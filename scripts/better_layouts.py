"""Layout optimisation: `parallel` without tilt, a crane's masts, and the critical dimensions of DemoBot's frame.

Run: python scripts/better_layouts.py. It prints three tables and draws pictures/layout-front.png and
pictures/better-layout.png. With pymoo (the extra `design`) NSGA-II computes the Pareto front as well.
"""

from pathlib import Path

import numpy as np
from rich.console import Console

import cdpr_sim as cdpr
from cdpr_sim.core.files import write_whole
from cdpr_sim.drawing.axes import encoded
from cdpr_sim.report.table_style import new_table
from cdpr_sim.studies.better_layouts import draw_front, picture
from studies.layout_studies import FRAME_TOP, LINE, crane_masts, frame_numbers, level_parallel

SHOWN = 0.16  # m, the largest displacement of an exit of the drawn layout
GENERATIONS = 200  # of NSGA-II
FURTHEST = 0.25  # m, the end of the figure's axis: from 0.16 m on, all layouts are level
FOLDER = Path(__file__).parent.parent / "pictures"


def main() -> None:
    console = Console()
    proofs = level_parallel()
    table = new_table(
        "parallel made level: worst tilt along the paper's line, z = 0.1 m",
        "exits move by [mm]",
        "at these poses [°]",
        "in MuJoCo, twice as fine [°]",
        "slack there, at most",
        "MuJoCo − Newton [mm]",
        "layouts evaluated",
        text_columns=0,
    )
    for proof in proofs:
        found = proof.layout
        table.add_row(
            f"{1e3 * found.largest_displacement:.1f}", f"{np.degrees(found.after):.4g}",
            f"{np.degrees(proof.after.score):.4g}",
            f"{proof.after.settled.slack.sum(-1).max()} of {found.robot.cables}",
            f"{1e3 * proof.after.errors['position_error']:.1e}", f"{found.layouts_evaluated:,}",
        )  # fmt: skip
    console.print(table)
    series = []
    try:
        front = cdpr.find_front(
            cdpr.load_robot("parallel"), LINE, move=cdpr.Move("exits", FRAME_TOP), generations=GENERATIONS
        )
        near = front.scores[front.scores[:, 0] <= FURTHEST]
        series.append((f"NSGA-II, {front.layouts_evaluated:,} layouts", near * [1e3, np.degrees(1)]))
    except cdpr.InvalidInput as error:
        console.print(str(error), highlight=False)
    by_limit = np.array([(proof.layout.largest_displacement, proof.layout.after) for proof in proofs]) * [
        1e3,
        np.degrees(1),
    ]
    confirmed = np.array([(proof.layout.largest_displacement, proof.after.score) for proof in proofs]) * [
        1e3,
        np.degrees(1),
    ]
    series.append(("differential evolution and gradient, one limit each", by_limit))
    figure = draw_front(
        series,
        ("largest displacement of an exit [mm]", "worst tilt along the line [°]"),
        "How far must the exits of parallel move to make it level?",
        "Each point is a layout with both mirrors kept and its exits within the frame, optimised at 18 poses of the "
        "paper's line at z = 0.1 m; hollow: settled in MuJoCo at 35.",
        given=(0.0, float(np.degrees(proofs[0].layout.before))),
        confirmed=confirmed,
    )
    shown = next(proof for proof in proofs if proof.layout.largest_displacement > SHOWN - 1e-3)
    FOLDER.mkdir(exist_ok=True)
    write_whole({
        FOLDER / "layout-front.png": encoded(figure),
        FOLDER / "better-layout.png": encoded(picture(shown)),
    })  # fmt: skip

    table = new_table(
        "crane of 15 m: worst deviation over its workspace, exits on masts ±1 m",
        "cables",
        "before [mm]",
        "after [mm]",
        "in MuJoCo [mm]",
        "MuJoCo − Newton [mm]",
        "masts [m]",
    )
    for what, proof in crane_masts().items():
        found = proof.layout
        masts = found.robot.exits[:, 2] - found.given.exits[:, 2]
        table.add_row(
            what, f"{1e3 * found.before:.2f}", f"{1e3 * found.after:.2f}", f"{1e3 * proof.after.score:.2f}",
            f"{1e3 * proof.after.errors['position_error']:.1e}", f"{masts.min():+.2f} to {masts.max():+.2f}",
        )  # fmt: skip
    console.print(table)

    for name in ("parallel", "cogiro"):
        robot = cdpr.load_robot(name)
        title = f"{name}: effect of an unknown error of 1 mm in the frame along that line, in MuJoCo"
        columns = ("number", "shift, rms [mm]", "most [mm]", "turn, rms [°]", "most [°]", "MuJoCo − Newton [mm]")
        table = new_table(title, *columns)
        for one in frame_numbers(robot)[:3]:
            shifts, turns = 1e3 * one.shifts, np.degrees(one.turns)
            spread = (f"{number:.2f}" for values in (shifts, turns) for number in (_rms(values), values.max()))
            table.add_row(one.name, *spread, f"{1e3 * one.method_difference:.1e}")
        console.print(table)
    print("layout-front.png, better-layout.png")


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt((values**2).mean()))


if __name__ == "__main__":
    main()

"""Layout optimisation: `parallel` without tilt, a crane's masts, and the critical dimensions of DemoBot's frame.

Run: python scripts/figures/better_layouts.py. It prints three tables and draws pictures/layout-front.png and
pictures/better-layout.png. With pymoo (the extra `design`) NSGA-II computes the Pareto front as well.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float
from rich.console import Console

import cdpr_sim as cdpr
from cdpr_sim.core.files import write_whole
from cdpr_sim.core.robot import Robot
from cdpr_sim.crosscheck.layout_validation import LayoutValidation, validate_layout
from cdpr_sim.design.moves import Move, Space
from cdpr_sim.design.search import find_layout
from cdpr_sim.drawing.figures import encoded
from cdpr_sim.physics.settle import settle_many
from cdpr_sim.report.layout_pictures import draw_front, picture
from cdpr_sim.report.table_style import new_table
from cdpr_sim.robots.catalogue import load_robot
from cdpr_sim.statics.newton import solve_many
from real_cables import BELOW, CRANE_DENSITY, CRANE_RADIUS, crane

SHOWN = 0.16  # m, the largest displacement of an exit of the drawn layout
GENERATIONS = 200  # of NSGA-II
FURTHEST = 0.25  # m, the end of the figure's axis: from 0.16 m on, all layouts are level
FOLDER = Path(__file__).parents[2] / "pictures"


LINE = np.array([(x, 0.25, 0.1) for x in np.linspace(0.17, 0.63, 18)])
"""[m] The paper's lower line."""

FRAME_TOP = ((0.0, 0.0, 0.3), (0.8, 0.5, 0.5))
"""[m] Box of DemoBot's exits: its frame's posts and beams, and the space between."""

REACHES = (0.02, 0.04, 0.06, 0.08, 0.1, 0.12, 0.14, 0.16, 0.18, 0.2)
"""[m] Limits of an exit's displacement."""

MAST = 1.0
"""[m] Limit of the displacement of the crane's exits along their masts."""

ERROR = 1e-3
"""[m] Error of a dimension of the frame."""


def level_parallel(reaches: Sequence[float] = REACHES, generations: int = 100) -> list[LayoutValidation]:
    """Minimise the largest tilt of ``parallel`` along the paper's line, for each limit of the exits' displacement."""
    robot, move = load_robot("parallel"), Move("exits", FRAME_TOP)
    return [
        validate_layout(
            find_layout(robot, LINE, move=move, subject_to={"points moved": reach}, generations=generations)
        )
        for reach in reaches
    ]


def crane_masts(generations: int = 40) -> dict[str, LayoutValidation]:
    """Minimise the crane's largest deviation over its workspace, with exits that slide on their masts.

    With cables with mass, with pulleys, and with both.
    """
    poses = np.stack(np.meshgrid([-4.5, 0.0, 4.5], [-3.0, 3.0], [1.0, 3.0], indexing="ij"), axis=-1)
    move = Move("exits", MAST, along=(0, 0, 1))
    mass, pulleys = dict(linear_density=CRANE_DENSITY), dict(pulley_radius=CRANE_RADIUS, pulley_axis=BELOW)
    robots = {
        "4 mm steel rope with mass": crane().replace(**mass),
        "massless rope over pulleys": crane().replace(**pulleys),
        "rope with mass over pulleys": crane().replace(**mass, **pulleys),
    }
    return {
        name: validate_layout(
            find_layout(robot, poses, move=move, symmetry="none", objective="worst deviation", generations=generations)
        )
        for name, robot in robots.items()
    }


@dataclass(frozen=True, eq=False)
class FrameNumber:
    """Effect of an error ``ERROR`` of one dimension of a frame, including its symmetric counterparts.

    Attributes:
        name: of the dimension.
        shifts: displacement of the platform in MuJoCo, at each pose (poses,) [m].
        turns: rotation of the platform (poses,) [rad].
        method_difference: largest distance between MuJoCo and statics over these poses [m].
    """

    name: str
    shifts: Float[np.ndarray, " poses"]
    turns: Float[np.ndarray, " poses"]
    method_difference: float

    def size(self, arm: float) -> float:
        """Root mean square displacement along the line, with rotations weighted by ``arm``."""
        return float(np.sqrt((self.shifts**2 + (arm * self.turns) ** 2).mean()))


def frame_numbers(robot: Robot) -> list[FrameNumber]:
    """Effect of each independent dimension of the exits of ``robot`` along the paper's line, the largest first.

    The error is unknown to the winches: rest lengths are those of the nominal frame. A millimetre is far more than the
    elongation of cables and changes the set of taut cables, so that first derivatives are not sufficient.
    """
    space = Space.of(robot, [Move("exits", ERROR)])
    nominal = settle_many(robot, LINE)
    effects = []
    for number, name in enumerate(space.names):
        wrong = robot.replace(exits=robot.exits + ERROR * space.by["exits"][number])
        built = settle_many(wrong, LINE, nominal.rest_lengths)
        solved = solve_many(wrong, LINE, nominal.rest_lengths)
        effects.append(
            FrameNumber(
                name,
                np.linalg.norm(built.positions - nominal.positions, axis=-1),
                (built.poses.rotation * nominal.poses.rotation.inv()).magnitude(),
                float(np.linalg.norm(built.positions - solved.positions, axis=-1).max()),
            )
        )
    return sorted(effects, key=lambda one: -one.size(robot.characteristic_length))


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

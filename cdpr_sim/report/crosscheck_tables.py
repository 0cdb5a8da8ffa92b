"""Tables that compare both methods, in millimetres, degrees and newtons. Nothing is computed here."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np
from rich.markup import escape
from rich.table import Table
from scipy.spatial.transform import RigidTransform

from cdpr_sim.analysis.modes import neutral_directions
from cdpr_sim.core.describe import describe_cables, describe_twist
from cdpr_sim.core.equilibrium import Equilibrium, NotConverged, NotSettled
from cdpr_sim.core.equilibrium_batch import EquilibriumBatch
from cdpr_sim.core.pose import euler, tilt_of_matrices
from cdpr_sim.core.problem import Problem
from cdpr_sim.core.robot import Robot
from cdpr_sim.crosscheck.compare import Agreement
from cdpr_sim.report.table_style import new_table

Outcome = Equilibrium | NotConverged | NotSettled
"""Outcome of a method: an equilibrium, or the exception with its best point."""

SLACK = "slack"
"""Of a cable, in place of a tension of 0, or before its tension."""

HEADINGS = {
    "mujoco": "MuJoCo",
    "newton": "Newton",
    "proof": "proved",
    "seecr/fsolve": "SEECR\nfsolve",
    "seecr/least_squares": "SEECR\nleast_sq.",
}
"""Column headings by the ``source`` of a result."""


def best_point(outcome: Outcome) -> Equilibrium | None:
    """The equilibrium, or the best point of a method that found none."""
    return outcome if isinstance(outcome, Equilibrium) else outcome.equilibrium


def heading(point: Equilibrium | EquilibriumBatch | None) -> str:
    """Column heading of a result, by its source."""
    return "" if point is None else HEADINGS.get(point.source, point.source)


def tension_cell(slack: bool | np.bool_ | None, tension: str) -> str:
    """A cable's tension, marked if it is slack; a slack cable with mass has a tension, which is shown."""
    if not slack:
        return tension
    return f"{SLACK} {tension}" if any(digit in tension for digit in "123456789") else SLACK


def platform_and_cables(robot: Robot) -> str:
    """Title of a table: the robot, its cables and its platform."""
    return f"{robot.name}, {describe_cables(robot, 'N')}, platform of {robot.mass:g} kg"


def lead(verdict: str, commanded: RigidTransform, *points: Equilibrium) -> str:
    """Five lines, first of what is printed: the verdict, and what matters of one equilibrium, or before → after."""
    now, robot = points[-1], points[-1].problem.robot
    deviations = [1e3 * (one.position - commanded.translation) for one in points]
    distances = " → ".join(f"{np.linalg.norm(one):.3f}" for one in deviations)
    x, y, z = deviations[-1].round(3) + 0.0  # without a negative zero
    level = np.degrees(tilt_of_matrices(commanded.rotation.as_matrix()))
    counts = " → ".join(str(int(one.slack.sum())) for one in points)
    slack = ", ".join(str(cable + 1) for cable in np.flatnonzero(now.slack))
    lines = {
        "deviation": f"{distances} mm: x {x:.3f}, y {y:.3f}, z {z:.3f} mm",
        "tilt": " → ".join(f"{np.degrees(one.tilt):.3f}" for one in points)
        + (f"°, commanded {level:.3f}°" if level > 5e-4 else "°"),
        "slack cables": f"{counts} of {robot.cables}" + (f": {slack}" if slack else ""),
        "highest tension": highest_tension(now),
    }
    return "\n".join([verdict, *(f"{label:<17}{escape(text)}" for label, text in lines.items())])


def highest_tension(equilibrium: Equilibrium) -> str:
    """The highest tension with its share of the breaking load, and the cable with the highest share if another."""
    tensions, loads = equilibrium.tensions, equilibrium.problem.robot.breaking_load
    first = int(np.argmax(tensions))
    nearest = int(np.argmax(tensions / loads))
    text = f"{tensions[first]:.4g} N, cable {first + 1}"
    text += f", {_share(equilibrium, first)}" if np.isfinite(loads[first]) else "; its breaking load is unknown"
    known = nearest != first and tensions[nearest] / loads[nearest] > tensions[first] / loads[first]
    return text + (f"; cable {nearest + 1} {_share(equilibrium, nearest)}" if known else "")


def _share(equilibrium: Equilibrium, cable: int) -> str:
    load = equilibrium.problem.robot.breaking_load[cable]
    share = float(f"{100 * equilibrium.tensions[cable] / load:.2g}")  # two digits, without an exponent from 100 on
    return f"{share:g} % of its breaking load of {load:.4g} N"


def path_lead(settled: EquilibriumBatch, agree: np.ndarray) -> list[str]:
    """Lines that come first: at how many poses the methods agree, and the worst of MuJoCo's equilibria."""
    done = settled.converged
    color = "green" if agree.all() else "red"
    lines = [f"[bold {color}]The methods agree at {int(agree.sum())} of {len(agree)} poses.[/]"]
    if done.any():
        lines.append(
            f"Worst, in MuJoCo: deviation {1e3 * np.linalg.norm(settled.deviation[done], axis=-1).max():.3f} mm, "
            f"tilt {np.degrees(settled.tilt[done].max()):.3f}°, {int(settled.slack[done].sum(-1).max())} of "
            f"{settled.robot.cables} cables slack, tension {settled.tensions[done].max():.4g} N."
        )
    return lines


def path_table(settled: EquilibriumBatch, errors: Mapping[str, np.ndarray], agree: np.ndarray) -> Table:
    """A row for each pose of a path: MuJoCo's equilibrium, its distance from the static one, and whether they agree."""
    table = new_table(
        f"{platform_and_cables(settled.robot)}, MuJoCo along a path",
        "commanded\n[m]", "x [mm]", "y [mm]", "z [mm]", "deviation [mm]", "tilt [°]", "slack", "largest [N]",
        "distance to Newton [mm]", "agree", dense=True,
    )  # fmt: skip
    for row, commanded in enumerate(settled.problems.positions):
        deviation = 1e3 * np.linalg.norm(settled.positions[row] - commanded)
        table.add_row(
            ", ".join(f"{value:.4g}" for value in commanded),
            *(f"{1e3 * value:.3f}" for value in settled.positions[row]),
            f"{deviation:.3f}",
            f"{np.degrees(settled.tilt[row]):.3f}",
            str(int(settled.slack[row].sum())),
            f"{settled.tensions[row].max():.4f}",
            f"{1e3 * errors['position_error'][row]:.1e}",
            "yes" if agree[row] else "[red]no[/]",
        )
    return table


def settle_table(problem: Problem, outcomes: Sequence[Outcome], *, details: bool = True) -> Table:
    """A column per method; a method that found no equilibrium shows its best point, marked.

    Args:
        problem: the problem.
        outcomes: of each method.
        details: whether to show deviations, slack cables, residuals and iterations as well.
    """
    robot = problem.robot
    table = new_table(platform_and_cables(robot), "", "commanded", methods=True)
    points = [best_point(outcome) for outcome in outcomes]
    for outcome, point in zip(outcomes, points, strict=True):
        style = "" if isinstance(outcome, Equilibrium) else "dim"
        table.add_column(escape(heading(point)), justify="right", no_wrap=True, style=style)

    def row(label: str, commanded: str, show: Callable[[Equilibrium], str]) -> None:
        cells = ("" if point is None else show(point) for point in points)
        table.row(label, commanded, *cells)

    start = problem.pose
    row("x [mm]", f"{1e3 * start.translation[0]:.3f}", lambda e: f"{1e3 * e.position[0]:.3f}")
    row("y [mm]", f"{1e3 * start.translation[1]:.3f}", lambda e: f"{1e3 * e.position[1]:.3f}")
    row("z [mm]", f"{1e3 * start.translation[2]:.3f}", lambda e: f"{1e3 * e.position[2]:.3f}")
    if details:
        row("deviation x, y [mm]", "", lambda e: f"{1e3 * np.hypot(*e.deviation[:2]):.3f}")
        row("deviation -z [mm]", "", lambda e: f"{-1e3 * e.deviation[2]:.3f}")
    commanded_tilt = tilt_of_matrices(start.rotation.as_matrix())
    row("tilt [°]", f"{np.degrees(commanded_tilt):.3f}", lambda e: f"{np.degrees(e.tilt):.3f}")
    if details:
        row("about y [°]", f"{np.degrees(euler(start.rotation)[1]):.3f}", lambda e: f"{np.degrees(e.euler[1]):.3f}")
    table.add_section()
    for cable in range(robot.cables):
        slack = next((bool(one.slack[cable]) for one in outcomes if isinstance(one, Equilibrium)), False)
        table.row(
            f"tension {cable + 1} [N]{f', {SLACK}' if slack else ''}",
            "",
            *(_tension(outcome, cable, slack=slack) for outcome in outcomes),
        )
    if details:
        row("slack cables", "", lambda e: f"{int(e.slack.sum())} of {robot.cables}")
    if any(point is not None and point.overloaded.any() for point in points):
        row("overloaded cables", "", lambda e: f"{int(e.overloaded.sum())} of {robot.cables}")
    table.add_section()
    if details:
        row("unbalanced [N]", "", lambda e: f"{e.residual:.1e}")
        row("iterations", "", lambda e: str(e.iterations))
    stabilities = (e.stability.name.lower() if isinstance(e, Equilibrium) else "[red]none[/]" for e in outcomes)
    table.add_row("equilibrium", "", *stabilities)
    return table


def _tension(outcome: Outcome, cable: int, *, slack: bool) -> str:
    """A tension; with a word where an equilibrium differs from the label of its row."""
    point = best_point(outcome)
    if point is None:
        return ""
    differs = isinstance(outcome, Equilibrium) and point.slack[cable] != slack
    return f"{('taut' if slack else SLACK) + ' ' if differs else ''}{point.tensions[cable]:.4f}"


def problem_table(problem: Problem) -> Table:
    """The problem: commanded pose, rest lengths and load."""
    robot, wrench = problem.robot, problem.external_wrench
    table = new_table(platform_and_cables(robot), "", "commanded")
    for axis, value in zip("xyz", problem.pose.translation, strict=True):
        table.row(f"{axis} [mm]", f"{1e3 * value:.3f}")
    for axis, angle in zip("xyz", euler(problem.pose.rotation), strict=True):
        table.row(f"about {axis} [°]", f"{np.degrees(angle):.3f}")
    table.add_section()
    for cable, length in enumerate(problem.rest_lengths, start=1):
        table.row(f"rest length {cable} [mm]", f"{1e3 * length:.3f}")
    table.add_section()
    table.row("weight [N]", f"{robot.weight:.4f}")
    if wrench.any():
        for axis, force, torque in zip("xyz", wrench[:3], wrench[3:], strict=True):
            table.row(f"force along {axis} [N]", f"{force:.4f}")
            table.row(f"torque about {axis} [N m]", f"{torque:.4f}")
    return table


def agreement_table(agreement: Agreement) -> Table:
    """Differences between the two methods, and the residual of each at the other's equilibrium."""
    table = new_table("Statics and MuJoCo", "", "difference")
    table.row("position [mm]", f"{1e3 * agreement.position_error:.1e}")
    table.row("rotation [°]", f"{np.degrees(agreement.rotation_error):.1e}")
    table.row("tension [N]", f"{agreement.tension_error:.1e}")
    table.add_row("slack cables", "the same" if agreement.same_slack else "[red]different[/]")
    if np.isnan(agreement.static_in_mujoco):  # cables with a memory
        return table
    table.add_section()
    table.row("MuJoCo's residual at the static equilibrium [N]", f"{agreement.static_in_mujoco:.1e}")
    table.row("static residual at MuJoCo's equilibrium [N]", f"{agreement.settled_in_statics:.1e}")
    return table


def equilibrium_notes(equilibrium: Equilibrium) -> list[str]:
    """Notes below the table of an equilibrium: neutral directions, pulls of several parts, tensions beyond limits."""
    robot, notes = equilibrium.problem.robot, []
    neutral = () if robot.cabling.has_memory.any() else neutral_directions(equilibrium)
    if len(neutral):
        directions = "; ".join(describe_twist(twist, robot) for twist in neutral)
        notes.append(f"Neutrally stable: {directions if len(neutral) < len(robot.free) else 'all directions'}.")
    for cable in np.flatnonzero(equilibrium.pulls != equilibrium.tensions):
        pull = equilibrium.pulls[cable]
        parts = pull / equilibrium.tensions[cable]
        notes.append(f"Cable {cable + 1}: its {parts:.0f} parts of line pull with {pull:.4g} N.")
    for cable in np.flatnonzero((equilibrium.tensions < robot.force_min) | (equilibrium.tensions > robot.force_max)):
        notes.append(
            f"Cable {cable + 1}: tension {equilibrium.tensions[cable]:.4g} N, outside its limits of "
            f"{robot.force_min[cable]:g} to {robot.force_max[cable]:g} N."
        )
    return notes + overload_notes(equilibrium)


def overload_notes(equilibrium: Equilibrium) -> list[str]:
    """A sentence for each cable above its breaking load."""
    robot = equilibrium.problem.robot
    return [
        f"Cable {cable + 1} would break: tension {equilibrium.tensions[cable]:.4g} N, above its breaking load of "
        f"{robot.breaking_load[cable]:.4g} N."
        for cable in np.flatnonzero(equilibrium.overloaded)
    ]


def verdict_sentence(agreement: Agreement, equilibrium: Equilibrium | None = None) -> str:
    """The verdict as a sentence, with the stability of an equilibrium."""
    text = agreement.verdict.value
    also = "" if equilibrium is None else f" {equilibrium.stability.name.capitalize()} equilibrium."
    return f"[bold {'green' if agreement.agrees else 'red'}]{text[0].upper() + text[1:]}.[/]{also}"


def verdict(agreement: Agreement) -> str:
    """The verdict in a line with the differences, and its reasons in a line each."""
    color = "green" if agreement.agrees else "red"
    head = (
        f"[bold {color}]MuJoCo and Newton: {agreement.verdict.value}[/]: "
        f"position within {1e3 * agreement.position_error:.1e} mm, "
        f"rotation within {np.degrees(agreement.rotation_error):.1e}°, "
        f"tensions within {agreement.tension_error:.1e} N, "
        f"{'the same' if agreement.same_slack else 'different'} slack cables."
    )
    return "\n".join([head, *(f"  - {escape(reason)}" for reason in agreement.reasons)])

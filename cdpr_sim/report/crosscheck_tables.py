"""Both methods as tables for people: millimetres, degrees and newtons, side by side. Nothing is computed here."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence

import numpy as np
from rich.markup import escape
from rich.table import Table

from cdpr_sim.analysis.modes import neutral_directions
from cdpr_sim.core.describe import describe_cables, describe_twist
from cdpr_sim.core.equilibrium import Equilibrium, NotConverged, NotSettled
from cdpr_sim.core.pose import euler, tilt
from cdpr_sim.core.problem import Problem
from cdpr_sim.crosscheck.compare import Agreement
from cdpr_sim.report.table_style import new_table

Outcome = Equilibrium | NotConverged | NotSettled
"""What a method came to: an equilibrium, or the failure that carries its best point."""

SLACK = "slack"

HEADINGS = {
    "mujoco": "MuJoCo",
    "newton": "Newton",
    "proof": "proved",
    "seecr/fsolve": "SEECR\nfsolve",
    "seecr/least_squares": "SEECR\nleast_sq.",
}
"""Of a column, by the source that its numbers carry: nobody who hands in a result says whose it is."""


def best_point(outcome: Outcome) -> Equilibrium | None:
    """The equilibrium, or the best point of a failure."""
    return outcome if isinstance(outcome, Equilibrium) else outcome.equilibrium


def heading(point: Equilibrium | None) -> str:
    """Of the column of a result, by its source."""
    return "" if point is None else HEADINGS.get(point.source, point.source)


def settle_table(problem: Problem, outcomes: Sequence[Outcome]) -> Table:
    """One column per method beside the commanded pose; a method that failed shows its best point, marked as such."""
    robot = problem.robot
    title = f"{robot.name}, {describe_cables(robot, 'N')}, platform of {robot.mass:g} kg"
    table = new_table(title, "", "commanded", methods=True)
    points = [best_point(outcome) for outcome in outcomes]
    for outcome, point in zip(outcomes, points, strict=True):
        style = "" if isinstance(outcome, Equilibrium) else "dim"
        table.add_column(escape(heading(point)), justify="right", no_wrap=True, style=style)

    def row(label: str, commanded: str, show: Callable[[Equilibrium], str]) -> None:
        shown = ("" if point is None else show(point) for point in points)
        table.add_row(escape(label), commanded, *shown)

    start = problem.pose
    row("x [mm]", f"{1e3 * start.translation[0]:.3f}", lambda e: f"{1e3 * e.position[0]:.3f}")
    row("y [mm]", f"{1e3 * start.translation[1]:.3f}", lambda e: f"{1e3 * e.position[1]:.3f}")
    row("z [mm]", f"{1e3 * start.translation[2]:.3f}", lambda e: f"{1e3 * e.position[2]:.3f}")
    row("shift x, y [mm]", "", lambda e: f"{1e3 * np.hypot(*e.deviation[:2]):.3f}")
    row("sag [mm]", "", lambda e: f"{-1e3 * e.deviation[2]:.3f}")
    row("tilt [°]", f"{np.degrees(tilt(start.rotation)):.3f}", lambda e: f"{np.degrees(e.tilt):.3f}")
    row("about y [°]", f"{np.degrees(euler(start.rotation)[1]):.3f}", lambda e: f"{np.degrees(e.euler[1]):.3f}")
    table.add_section()
    for cable in range(robot.cables):
        row(f"tension {cable + 1} [N]", "", lambda e, c=cable: SLACK if e.slack[c] else f"{e.tensions[c]:.4f}")
    row("slack cables", "", lambda e: f"{int(e.slack.sum())} of {robot.cables}")
    if any(point is not None and point.overloaded.any() for point in points):
        row("overloaded cables", "", lambda e: f"{int(e.overloaded.sum())} of {robot.cables}")
    table.add_section()
    row("unbalanced [N]", "", lambda e: f"{e.residual:.1e}")
    row("iterations", "", lambda e: str(e.iterations))
    words = (e.stability.name.lower() if isinstance(e, Equilibrium) else "[red]none[/]" for e in outcomes)
    table.add_row("equilibrium", "", *words)
    return table


def problem_table(problem: Problem) -> Table:
    """What is asked: the commanded pose, how long each cable is, and the load."""
    robot, wrench = problem.robot, problem.external_wrench
    table = new_table(f"{robot.name}, {describe_cables(robot, 'N')}, platform of {robot.mass:g} kg", "", "commanded")
    for axis, value in zip("xyz", problem.pose.translation, strict=True):
        table.add_row(escape(f"{axis} [mm]"), f"{1e3 * value:.3f}")
    for axis, angle in zip("xyz", euler(problem.pose.rotation), strict=True):
        table.add_row(escape(f"about {axis} [°]"), f"{np.degrees(angle):.3f}")
    table.add_section()
    for cable, length in enumerate(problem.rest_lengths, start=1):
        table.add_row(escape(f"rest length {cable} [mm]"), f"{1e3 * length:.3f}")
    table.add_section()
    table.add_row(escape("weight [N]"), f"{robot.weight:.4f}")
    if wrench.any():
        for axis, force, torque in zip("xyz", wrench[:3], wrench[3:], strict=True):
            table.add_row(escape(f"force along {axis} [N]"), f"{force:.4f}")
            table.add_row(escape(f"torque about {axis} [N m]"), f"{torque:.4f}")
    return table


def agreement_table(agreement: Agreement) -> Table:
    """How far the two methods are apart, and how much of the load each leaves unbalanced where the other rests."""
    table = new_table("Statics and MuJoCo", "", "apart by")
    table.add_row(escape("position [mm]"), f"{1e3 * agreement.position_error:.1e}")
    table.add_row(escape("rotation [°]"), f"{np.degrees(agreement.rotation_error):.1e}")
    table.add_row(escape("tension [N]"), f"{agreement.tension_error:.1e}")
    table.add_row("slack cables", "the same" if agreement.same_slack else "[red]others[/]")
    table.add_section()
    table.add_row(escape("MuJoCo finds unbalanced where statics rests [N]"), f"{agreement.static_in_mujoco:.1e}")
    table.add_row(escape("statics finds unbalanced where MuJoCo rests [N]"), f"{agreement.settled_in_statics:.1e}")
    return table


def line_table(title: str, settled: Iterable[Equilibrium], agreements: Sequence[Agreement]) -> Table:
    """One row per commanded pose: where the platform ends up, and how far the two methods are apart."""
    table = new_table(
        title,
        "commanded\nx [mm]", "x\n[mm]", "sag\n[mm]", "tilt\n[°]", "about y\n[°]", "taut\ncables",
        "methods apart\n[nm]", "verdict", words=0, dense=True,
    )  # fmt: skip
    for end, agreement in zip(settled, agreements, strict=True):
        table.add_row(
            f"{1e3 * end.problem.pose.translation[0]:.2f}",
            f"{1e3 * end.position[0]:.2f}",
            f"{-1e3 * end.deviation[2]:.3f}",
            f"{np.degrees(end.tilt):.3f}",
            f"{np.degrees(end.euler[1]):.3f}",
            str(int((~end.slack).sum())),
            f"{1e9 * agreement.position_error:.2f}",
            "agree" if agreement.agrees else "[red]differ[/]",
        )
    return table


def equilibrium_notes(found: Equilibrium) -> list[str]:
    """What is to be said of an equilibrium below its table: what nothing holds, and tensions beyond the limits."""
    robot, notes = found.problem.robot, []
    neutral = neutral_directions(found)
    if len(neutral):
        words = "; ".join(describe_twist(twist, robot) for twist in neutral)
        notes.append(
            f"Held by nothing: {words if len(neutral) < len(robot.free) else 'the platform, in any direction'}."
        )
    for cable in np.flatnonzero((found.tensions < robot.force_min) | (found.tensions > robot.force_max)):
        notes.append(
            f"Cable {cable + 1} pulls {found.tensions[cable]:.4g} N, beyond its limits of {robot.force_min[cable]:g} "
            f"to {robot.force_max[cable]:g} N."
        )
    return notes + overload_notes(found)


def overload_notes(found: Equilibrium) -> list[str]:
    """A sentence for each cable that would break."""
    robot = found.problem.robot
    return [
        f"Cable {cable + 1} would break: it pulls {found.tensions[cable]:.4g} N, beyond its breaking load of "
        f"{robot.breaking_load[cable]:.4g} N."
        for cable in np.flatnonzero(found.overloaded)
    ]


def said(agreement: Agreement) -> str:
    """The verdict as a sentence."""
    found = agreement.verdict.value
    return f"[bold {'green' if agreement.agrees else 'red'}]{found[0].upper() + found[1:]}.[/]"


def verdict(agreement: Agreement) -> str:
    """The verdict in a line, with the differences that it rests on, and its reasons."""
    color = "green" if agreement.agrees else "red"
    head = (
        f"[bold {color}]MuJoCo and Newton: {agreement.verdict.value}[/]: "
        f"position within {1e3 * agreement.position_error:.1e} mm, "
        f"rotation within {np.degrees(agreement.rotation_error):.1e}°, "
        f"tensions within {agreement.tension_error:.1e} N, "
        f"{'the same' if agreement.same_slack else 'other'} cables slack."
    )
    return "\n".join([head, *(f"  - {escape(reason)}" for reason in agreement.reasons)])

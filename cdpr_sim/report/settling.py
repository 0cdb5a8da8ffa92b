"""Results as tables for people: millimetres, degrees and newtons, side by side. Nothing is computed here."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np
from rich import box
from rich.markup import escape
from rich.table import Table

from cdpr_sim.crosscheck.compare import Agreement, CrossCheck
from cdpr_sim.core.equilibrium import Equilibrium
from cdpr_sim.core.errors import NotConverged, NotSettled
from cdpr_sim.core.pose import euler, tilt
from cdpr_sim.core.problem import Problem

Outcome = Equilibrium | NotConverged | NotSettled
"""What a road came to: an equilibrium, or the failure that carries its best point."""

SLACK = "slack"


def best_point(outcome: Outcome) -> Equilibrium | None:
    """The equilibrium, or the best point of a failure."""
    return outcome if isinstance(outcome, Equilibrium) else outcome.equilibrium


def settle_table(problem: Problem, outcomes: Mapping[str, Outcome]) -> Table:
    """One column per road beside the commanded pose; a road that failed shows its best point, marked as such."""
    robot = problem.robot
    table = Table(
        title=f"{robot.name}, {stiffness(problem)}, platform of {robot.mass:g} kg",
        title_justify="left",
        box=box.SIMPLE_HEAD,
        padding=(0, 1),
        pad_edge=False,
    )
    table.add_column("", no_wrap=True)
    table.add_column("commanded", justify="right", no_wrap=True)
    points = {name: best_point(outcome) for name, outcome in outcomes.items()}
    for name, outcome in outcomes.items():
        found = isinstance(outcome, Equilibrium)
        table.add_column(name, justify="right", no_wrap=True, style="" if found else "dim")

    def row(label: str, commanded: str, show: Callable[[Equilibrium], str]) -> None:
        shown = ("" if point is None else show(point) for point in points.values())
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
    table.add_section()
    row("unbalanced [N]", "", lambda e: f"{e.residual:.1e}")
    row("iterations", "", lambda e: str(e.iterations))
    words = (e.stability.name.lower() if isinstance(e, Equilibrium) else "[red]none[/]" for e in outcomes.values())
    table.add_row("equilibrium", "", *words)
    return table


def line_table(title: str, checks: Sequence[CrossCheck]) -> Table:
    """One row per commanded pose: where the platform ends up, and how far the two roads are apart."""
    columns = [
        "commanded x [mm]",
        "x [mm]",
        "sag [mm]",
        "tilt [°]",
        "about y [°]",
        "taut cables",
        "roads apart [nm]",
        "verdict",
    ]
    table = Table(title=escape(title), title_justify="left", box=box.SIMPLE_HEAD, pad_edge=False)
    for column in columns:
        table.add_column(escape(column), justify="right")
    for check in checks:
        end = check.settled
        table.add_row(
            f"{1e3 * end.problem.pose.translation[0]:.0f}",
            f"{1e3 * end.position[0]:.2f}",
            f"{-1e3 * end.deviation[2]:.3f}",
            f"{np.degrees(end.tilt):.3f}",
            f"{np.degrees(end.euler[1]):.3f}",
            str(int((~end.slack).sum())),
            f"{1e9 * check.agreement.position_error:.2f}",
            "agree" if check.agreement.agrees else "[red]differ[/]",
        )
    return table


def stiffness(problem: Problem) -> str:
    """The cables in words."""
    robot = problem.robot
    lowest, highest = robot.axial_stiffness.min(), robot.axial_stiffness.max()
    number = f"EA = {lowest:g} N" if lowest == highest else f"EA = {lowest:g} to {highest:g} N"
    return f"{robot.material} cables ({number})" if robot.material else f"cables with {number}"


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
    return "\n".join([head, *(f"  - {reason}" for reason in agreement.reasons)])


def as_dict(outcome: Outcome) -> dict:
    """An outcome for JSON, in SI units."""
    point = best_point(outcome)
    result: dict = {"equilibrium": isinstance(outcome, Equilibrium)}
    if not isinstance(outcome, Equilibrium):
        result["reason"] = outcome.reason
    if point is not None:
        result |= {
            "source": point.source,
            "position": point.position.tolist(),
            "euler": point.euler.tolist(),
            "tilt": point.tilt,
            "tensions": point.tensions.tolist(),
            "lengths": point.lengths.tolist(),
            "rest_lengths": point.rest_lengths.tolist(),
            "slack": point.slack.tolist(),
            "residual": point.residual,
            "eigenvalues": point.eigenvalues.tolist(),
            "stability": point.stability.name.lower(),
            "iterations": point.iterations,
        }
    return result

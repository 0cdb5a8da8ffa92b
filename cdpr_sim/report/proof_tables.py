"""What is proved, as tables for people: millimetres, degrees and newtons. Nothing is computed here."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from rich.markup import escape
from rich.table import Table

from cdpr_sim.core.describe import describe_cables
from cdpr_sim.core.problem import Problem
from cdpr_sim.proof.certificate import Certificate
from cdpr_sim.proof.complete import CompleteEquilibria
from cdpr_sim.report.crosscheck_tables import SLACK, heading
from cdpr_sim.report.table_style import new_table

MOST_DIGITS = 15
"""Of a proved number that a table prints."""


def certificate_table(found: Sequence[Certificate]) -> Table:
    """One column per method: what is proved of its equilibrium, and how far it is from the proved one at most."""
    robot = found[0].equilibrium.problem.robot
    title = f"{robot.name}, {describe_cables(robot, 'N')}, platform of {robot.mass:g} kg: what is proved"
    table = new_table(title, "", methods=True)
    for one in found:
        style = "" if one.proved else "dim"
        table.add_column(escape(heading(one.equilibrium)), justify="right", no_wrap=True, style=style)
    for axis in range(3):
        table.add_row(
            escape(f"{'xyz'[axis]} [mm]"), *(_interval(1e3 * one.position[:, axis], one.exists) for one in found)
        )
    table.add_section()
    for cable in range(robot.cables):
        cells = (SLACK if one.slack[cable] else _interval(one.tensions[:, cable], one.exists) for one in found)
        table.add_row(escape(f"tension {cable + 1} [N]"), *cells)
    table.add_section()
    table.add_row("equilibrium", *("exists, alone" if one.exists else "[red]not proved[/]" for one in found))
    table.add_row("stability", *map(stability_in_words, found))
    table.add_row("slack cables", *(slack_in_words(one) for one in found))
    table.add_row("digits", *(f"{one.digits:.0f}" if one.exists else "" for one in found))
    table.add_row(escape("no other within [mm]"), *(f"{1e3 * one.radius:.0e}" if one.exists else "" for one in found))
    table.add_section()
    table.add_row(escape("position off by at most [mm]"), *(_bound(1e3 * one.position_error) for one in found))
    table.add_row(escape("rotation off by at most [°]"), *(_bound(np.degrees(one.rotation_error)) for one in found))
    table.add_row(escape("tensions off by at most [N]"), *(_bound(one.tension_error) for one in found))
    table.add_row("proved", *("[bold green]yes[/]" if one.proved else "[bold red]no[/]" for one in found))
    return table


def reasons(found: Sequence[Certificate]) -> list[str]:
    """Why something is not proved, a line each."""
    return [
        f"{escape(heading(one.equilibrium))}: {escape(reason)}.".replace("\n", " ")
        for one in found
        for reason in one.reasons
    ]


def proof_cell(found: Certificate | None) -> str:
    """What a table of results says of one: proved, and how far off it is at most."""
    if found is None:
        return ""
    return f"off by < {1e3 * found.position_error:.0e} mm" if found.proved else "[red]not proved[/]"


def quickly_complete(problem: Problem) -> bool:
    """Whether a proof that none is missing takes milliseconds: planar, massless cables that start at points."""
    robot = problem.robot
    return robot.mobility == "planar" and robot.cabling.massless and not robot.cabling.pulleys.any()


def complete_note(found: CompleteEquilibria) -> str:
    """That these are all equilibria, or what is left open, in a sentence."""
    stable = sum(one.stable for one in found)
    counted = f"{stable} stable and {len(found) - stable} unstable equilibria"
    if found.complete:
        return f"Proved: these cable lengths have {counted}, and no others."
    reasons = "; ".join(dict.fromkeys(one.reason for one in found.undecided)) or f"{found.pending} boxes are pending"
    return f"Proved: {counted}; whether there are others is open: {reasons}."


def missing_note(missing: Sequence[Certificate]) -> str:
    """How many proved equilibria the search from many starts has not found."""
    if not missing:
        return "The search from many starts found each of them."
    return f"[red]The search from many starts missed {len(missing)} of them.[/]"


def stability_in_words(found: Certificate) -> str:
    """Stable, the number of unstable directions, or that it is not known."""
    if found.index is None:
        return "[red]not proved[/]"
    return "stable" if found.stable else f"{found.index} unstable"


def slack_in_words(found: Certificate) -> str:
    """How many are proved slack; and how many are neither proved slack nor taut."""
    unknown = sum(one is None for one in found.slack)
    return f"{sum(map(bool, found.slack))} of {len(found.slack)}" + (f", {unknown} unknown" if unknown else "")


def _interval(ends: np.ndarray, known: bool) -> str:
    """As many decimals as both ends share, 15 at most."""
    if not known:
        return ""
    for digits in range(MOST_DIGITS, 0, -1):
        lower, upper = (np.format_float_positional(end, digits, fractional=False, trim="-") for end in ends)
        if lower == upper:
            return lower
    return f"{ends[0]:.3g} to {ends[1]:.3g}"


def _bound(value: float) -> str:
    return f"{value:.0e}" if np.isfinite(value) else ""

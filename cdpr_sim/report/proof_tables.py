"""Tables of certificates, in millimetres, degrees and newtons. Nothing is computed here."""

from __future__ import annotations

from collections.abc import Sequence
from decimal import ROUND_CEILING, ROUND_FLOOR, Context

import numpy as np
from rich.markup import escape
from rich.table import Table

from cdpr_sim.proof.certificate import Certificate
from cdpr_sim.proof.complete import CompleteEquilibria
from cdpr_sim.report.crosscheck_tables import heading, platform_and_cables, tension_cell
from cdpr_sim.report.table_style import new_table

MOST_DIGITS = 15
"""Largest number of digits printed of a proved value."""


def certificate_lead(proofs: Sequence[Certificate]) -> str:
    """Line that comes first: what is proved of the equilibria of which methods."""
    names = [heading(one.equilibrium) for one in proofs if one.proved]
    if len(names) < len(proofs):
        return f"[bold red]Proved: {' and '.join(names) or 'no equilibrium'}, of {len(proofs)} methods.[/]"
    first = proofs[0]
    whose = " and ".join(names)
    return (
        f"[bold green]Proved:[/] the equilibria of {whose} exist, locally unique, {describe_stability(first)}, "
        f"{describe_slack(first)} cables slack; their errors are at most "
        f"{_bound(1e3 * max(one.position_error for one in proofs))} mm and "
        f"{_bound(max(one.tension_error for one in proofs))} N."
    )


def certificate_table(proofs: Sequence[Certificate]) -> Table:
    """A column per method: the proved equilibrium, and the largest error of the computed one."""
    robot = proofs[0].equilibrium.problem.robot
    table = new_table(f"{platform_and_cables(robot)}: certificates", "", methods=True)
    for one in proofs:
        style = "" if one.proved else "dim"
        table.add_column(escape(heading(one.equilibrium)), justify="right", no_wrap=True, style=style)
    for axis in range(3):
        table.row(f"{'xyz'[axis]} [mm]", *(_interval(1e3 * one.position[:, axis], one.exists) for one in proofs))
    table.add_section()
    for cable in range(robot.cables):
        cells = (tension_cell(one.slack[cable], _interval(one.tensions[:, cable], one.exists)) for one in proofs)
        table.row(f"tension {cable + 1} [N]", *cells)
    table.add_section()
    table.add_row("equilibrium", *("exists, unique" if one.exists else "[red]not proved[/]" for one in proofs))
    table.add_row("stability", *map(describe_stability, proofs))
    table.add_row("slack cables", *map(describe_slack, proofs))
    table.add_row("digits", *(f"{one.digits:.0f}" if one.exists else "" for one in proofs))
    table.row("unique within [mm]", *(_bound(1e3 * one.radius, ROUND_FLOOR) for one in proofs))
    table.add_section()
    table.row("position error at most [mm]", *(_bound(1e3 * one.position_error) for one in proofs))
    table.row("rotation error at most [°]", *(_bound(np.degrees(one.rotation_error)) for one in proofs))
    table.row("tension error at most [N]", *(_bound(one.tension_error) for one in proofs))
    table.add_row("proved", *("[bold green]yes[/]" if one.proved else "[bold red]no[/]" for one in proofs))
    return table


def reasons(proofs: Sequence[Certificate]) -> list[str]:
    """Why something is not proved, a line for each reason with the methods that it holds for."""
    methods: dict[str, list[str]] = {}
    for one in proofs:
        for reason in one.reasons:
            methods.setdefault(reason, []).append(heading(one.equilibrium).replace("\n", " "))
    return [escape(f"{', '.join(names)}: not proved: {reason}.") for reason, names in methods.items()]


def proof_cell(proof: Certificate) -> str:
    """Cell of a results table: the proved bound of the position error [mm]."""
    return _bound(1e3 * proof.position_error) if proof.proved else "[red]no[/]"


def complete_note(proved: CompleteEquilibria) -> str:
    """Whether the list of equilibria is proved complete, in a sentence."""
    stable = sum(one.stable for one in proved)
    counts = f"{stable} stable and {len(proved) - stable} unstable equilibria"
    if proved.complete:
        within = f" Of poses at which {proved.range}." if proved.range else ""
        return f"Proved: these cable lengths have {counts}, and no others.{within}"
    reasons = "; ".join(dict.fromkeys(one.reason for one in proved.undecided)) or f"{proved.pending} boxes are pending"
    return f"Proved: {counts}; whether there are others is undecided: {reasons}."


def missing_note(missing: Sequence[Certificate]) -> str:
    """Number of proved equilibria that the multi-start search did not find."""
    if not missing:
        return "The multi-start search found all of them."
    return f"[red]The multi-start search missed {len(missing)} of them.[/]"


def describe_stability(proof: Certificate) -> str:
    """Stable, unstable with its index, or not proved."""
    if proof.index is None:
        return "[red]not proved[/]"
    return "stable" if proof.stable else f"index {proof.index}"


def describe_slack(proof: Certificate) -> str:
    """Number of cables proved slack, and of those proved neither slack nor taut."""
    unknown = sum(one is None for one in proof.slack)
    return f"{sum(map(bool, proof.slack))} of {len(proof.slack)}" + (f", {unknown} unknown" if unknown else "")


def _interval(ends: np.ndarray, known: bool) -> str:
    """The digits that both ends share, 15 at most."""
    if not known:
        return ""
    for digits in range(MOST_DIGITS, 0, -1):
        lower, upper = (np.format_float_positional(end, digits, fractional=False, trim="-") for end in ends)
        if lower == upper:
            return lower
    return f"{ends[0]:.3g} to {ends[1]:.3g}"


def _bound(value: float, rounding: str = ROUND_CEILING) -> str:
    """One digit, rounded to the side on which the bound still holds: upwards, or downwards by ``ROUND_FLOOR``."""
    if not np.isfinite(value):
        return ""
    return f"{float(Context(prec=1, rounding=rounding).create_decimal_from_float(value)):.0e}"

"""Tables of the analysis: compensation, sensitivity, natural modes, equilibria, identification."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from rich.markup import escape
from rich.table import Table

from cdpr_sim.analysis.compensation import Compensation
from cdpr_sim.analysis.equilibria import Equilibria, unstable_directions
from cdpr_sim.analysis.identifiability import best_of_fewer, described
from cdpr_sim.analysis.identification import Identification
from cdpr_sim.analysis.measurements import KINDS
from cdpr_sim.analysis.modes import Modes
from cdpr_sim.analysis.sensitivity import Effect, Sensitivity
from cdpr_sim.core.describe import describe_cables
from cdpr_sim.core.equilibrium import Equilibrium
from cdpr_sim.crosscheck.compensation_check import CompensationCheck
from cdpr_sim.physics.release import Release
from cdpr_sim.report.crosscheck_tables import heading, overload_notes, tension_cell
from cdpr_sim.report.table_style import new_table


def compensation_table(
    compensation: Compensation, before: Sequence[Equilibrium], after: Sequence[Equilibrium]
) -> Table:
    """Errors of position and rotation with the rigid and the compensated lengths, for each method.

    Args:
        compensation: the compensated rest lengths.
        before: equilibrium of each method with the rigid lengths.
        after: equilibrium of each method with the compensated lengths.
    """
    robot, commanded = compensation.equilibrium.problem.robot, compensation.commanded
    x, y, z = 1e3 * commanded.translation
    results = {
        f"{when}\n{heading(point)}": point
        for when, points in (("before", before), ("after", after))
        for point in points
    }
    title = f"{robot.name}, {describe_cables(robot, 'N')},\ncommanded to ({x:g}, {y:g}, {z:g}) mm"
    table = new_table(title, "", *results, dense=True, methods=True)
    deviations = [1e3 * (point.position - commanded.translation) for point in results.values()]
    rotations = [np.degrees((point.rotation * commanded.rotation.inv()).magnitude()) for point in results.values()]
    for axis, name in enumerate("xyz"):
        table.row(f"error {name} [mm]", *(f"{deviation[axis]:.6f}" for deviation in deviations))
    distances = [float(np.linalg.norm(deviation)) for deviation in deviations]
    table.row("position error [mm]", *map(_small, distances), style="bold")
    table.row("rotation error [°]", *map(_small, rotations), style="bold")
    table.row("tilt [°]", *(f"{np.degrees(point.tilt):.6f}" for point in results.values()))
    table.add_section()
    for cable in range(robot.cables):
        cells = (tension_cell(point.slack[cable], f"{point.tensions[cable]:.3f}") for point in results.values())
        table.row(f"tension {cable + 1} [N]", *cells)
    if any(point.overloaded.any() for point in results.values()):
        counts = (f"{int(point.overloaded.sum())} of {robot.cables}" for point in results.values())
        table.add_row("overloaded cables", *counts, style="red")
    table.add_section()
    table.row("lowest stiffness [N/m]", *(f"{point.eigenvalues[0]:.3g}" for point in results.values()))
    table.add_row("equilibrium", *(point.stability.name.lower() for point in results.values()))
    return table


def _small(error: float) -> str:
    """Six decimals; in exponential notation where these would all be zero."""
    return f"{error:.6f}" if error >= 1e-5 or error == 0 else f"{error:.2e}"


def compensation_lengths(compensation: Compensation) -> str:
    """Difference of rigid and compensated rest length of each cable."""
    robot = compensation.equilibrium.problem.robot
    reductions = 1e3 * (robot.rest_lengths(compensation.commanded) - compensation.rest_lengths)
    return escape("Rest lengths reduced by [mm]: ") + ", ".join(f"{value:.3f}" for value in reductions)


def missing_results(reasons: Sequence[str]) -> str:
    """Why a column of ``compensation_table`` is missing, a line each."""
    return "\n".join(f"  - no result {escape(reason)}" for reason in reasons)


def compensation_verdict(compensation: Compensation, verification: CompensationCheck | None = None) -> str:
    """Outcome of the compensation with its reasons, and with what MuJoCo does not confirm; a line each."""
    held = verification is None or verification.held
    color = "green" if compensation.exact and held else "yellow" if held else "red"
    outcome = compensation.outcome.value if held else "the equilibrium found by statics is not held in MuJoCo"
    head = f"[bold {color}]{outcome[0].upper() + outcome[1:]}[/]"
    if not compensation.exact:
        arm = f"rotation weighted by an arm of {1e3 * compensation.arm:.0f} mm"
        head += f": {1e3 * compensation.distance:.3f} mm away ({arm if compensation.arm else 'position only'})"
    reasons = (
        *compensation.reasons,
        *(verification.reasons if verification else ()),
        *overload_notes(compensation.equilibrium),
    )
    return "\n".join([head + ".", *(f"  - {escape(reason)}" for reason in reasons)])


def sensitivity_table(answer: Sensitivity, effects: Sequence[Effect]) -> Table:
    """Effect of a unit change of each parameter on position, rotation and tensions, in the given order."""
    equilibrium = answer.equilibrium
    robot, (x, y, z) = equilibrium.problem.robot, 1e3 * equilibrium.problem.pose.translation
    where = f"commanded to ({x:g}, {y:g}, {z:g}) mm"
    title = f"{robot.name}, {describe_cables(robot, 'N')},\n{where}: sensitivity, largest first"
    table = new_table(title, "", "per", "mm", "°", "N", dense=True)
    for effect in effects:
        table.add_row(
            escape(effect.name),
            f"1 {effect.per}",
            f"{effect.position:.4g}",
            f"{effect.rotation:.4g}",
            f"{effect.tension:.4g}",
        )
    return table


def sensitivity_lead(answer: Sensitivity, effects: Sequence[Effect], modes: Modes) -> list[str]:
    """Lines that come first: the largest effect of each unit, the lowest frequency, and the range of validity."""
    largest: dict[str, Effect] = {}
    for effect in effects:
        largest.setdefault(effect.per, effect)
    parts = [
        f"{one.name}: {one.position:.3g} mm and {one.rotation:.3g}° per {per}" for per, one in largest.items()
    ]  # fmt: skip
    lines = [f"[bold]Largest effects:[/] {escape('; '.join(parts))}."]
    if len(modes.frequencies):
        lines.append(f"Lowest natural frequency: {modes.frequencies[0]:.3f} Hz.")
    return [*lines, sensitivity_note(answer)]


def sensitivity_note(answer: Sensitivity) -> str:
    """Range in which the derivatives are valid."""
    if answer.margin == np.inf:
        return "Valid near the equilibrium: cables with mass become slack or taut without a jump of the derivatives."
    return (
        "Valid while the set of taut cables does not change: the cable closest to a change is "
        f"{1e3 * answer.margin:.3g} mm of length away from it."
    )


def modes_table(modes: Modes) -> Table:
    """Natural frequencies and mode shapes, scaled to the largest component; components below 0.005 are left out."""
    robot = modes.equilibrium.problem.robot
    directions = ("x", "y", "z", "about x", "about y", "about z")
    table = new_table(f"{robot.name}: natural frequencies", "mode", "Hz", *directions, dense=True)
    for number, (frequency, shape) in enumerate(zip(modes.frequencies, modes.shapes, strict=True), start=1):
        parts = shape * robot.units
        parts = parts / parts[np.abs(parts).argmax()]
        table.add_row(str(number), f"{frequency:.3f}", *("" if abs(p) < 5e-3 else f"{p:.2f}" for p in parts))
    return table


def equilibria_table(found: Equilibria, releases: Sequence[Release] = (), reached: int | None = None) -> Table:
    """Equilibria by increasing energy, with the behaviour of MuJoCo's platform released there, if given."""
    robot = found.problem.robot
    table = new_table(
        f"{robot.name}, {describe_cables(robot, 'N')}:\nequilibria with these cable lengths",
        "", "energy\n[mJ]", "x\n[mm]", "y\n[mm]", "z\n[mm]", "tilt\n[°]", "slack", "lowest\nstiffness\n[N/m]", "index",
        *(["released\nin MuJoCo"] if releases else []), dense=True,
    )  # fmt: skip
    for number, (one, energy) in enumerate(zip(found, found.energies, strict=True)):
        x, y, z = 1e3 * one.position
        table.add_row(
            str(number + 1),
            f"{1e3 * energy:.2f}",
            f"{x:.1f}",
            f"{y:.1f}",
            f"{z:.1f}",
            f"{np.degrees(one.tilt):.1f}",
            str(int(one.slack.sum())),
            f"{one.eigenvalues[0]:.3g}",
            str(unstable_directions(one) or ""),
            *("stays" if one.stays else "leaves" if one.leaves else "neither" for one in releases[number : number + 1]),
            style="bold" if number == reached else "" if one.stable else "dim",
        )
    return table


def equilibria_note(found: Equilibria) -> str:
    """Whether the indices of the equilibria indicate a missing one."""
    if found.imbalance is None:
        return ""
    if found.imbalance == 0:
        return "As many equilibria with an even as with an odd index: no indication that one is missing."
    return (
        f"[yellow]At least {abs(found.imbalance)} missing[/]: there should be as many equilibria with an even as with "
        "an odd index."
    )


_SHOWN = {
    "position": (1e3, " mm"), "rotation": (180 / np.pi, "°"), "tension": (1.0, " N"), "swivel": (180 / np.pi, "°"),
    "frequency": (1.0, " Hz"), "length": (1e3, " mm"),
}  # fmt: skip
"""Factor and unit in which each kind of measured number is shown."""

_UNITS = {"m": (1e3, "mm"), "rad": (180 / np.pi, "°"), "kg/m": (1e3, "g/m")}


def identification_table(result: Identification) -> Table:
    """Each unknown with its standard error and interval, lengths in millimetres, angles in degrees."""
    title = f"{result.robot.name}: identified parameters"
    table = new_table(title, "", "value", "standard error", "95 % interval", dense=True)
    table.add_column("", no_wrap=True)
    rows = zip(result.names, result.units, result.values, result.standard_errors, result.intervals(0.95), strict=True)
    for name, unit, value, error, (lower, upper) in rows:
        size, symbol = _UNITS.get(unit, (1.0, unit))
        accuracy = "undetermined" if np.isinf(error) else "unknown" if np.isnan(error) else f"{size * error:.2g}"
        interval = "" if not np.isfinite(error) else f"{size * lower:.6g} to {size * upper:.6g}"
        table.add_row(escape(name.replace("_", " ")), f"{size * value:.6g}", accuracy, interval, symbol)
    return table


def identification_note(result: Identification) -> str:
    """Residuals of the fit, estimated measurement errors, outliers, and reasons why unknowns are undetermined."""
    kinds = {kind: result.residuals[:, result.kinds == i] for i, kind in enumerate(KINDS)}
    parts = [
        f"{_SHOWN[kind][0] * np.sqrt(np.nanmean(some**2)):.3g}{_SHOWN[kind][1]}"
        for kind, some in kinds.items()
        if some.size and not np.isnan(some).all()
    ]
    head = f"Residuals: {_joined(parts)} (root mean square)."
    if result.repeats.any():
        head += (
            f" {int(result.repeats.sum())} of {len(result.repeats)} rows repeat another one exactly, and do not count."
        )
    if result.estimated and not np.isnan(result.deviance):
        errors = [f"{_SHOWN[kind][0] * result.scatters[kind]:.3g}{_SHOWN[kind][1]}" for kind in result.estimated]
        head += f" Measurement errors estimated from them: {_joined(errors)}."
    error = next(iter(result.predictions.values()))
    fewer, smallest = best_of_fewer(result.predictions)
    if np.isinf(error):
        head += "\nNo prediction of omitted rows: one row alone determines an unknown."
    elif np.isfinite(error):
        head += f"\nOmitted rows are predicted with an error of {error:.2f} standard errors"
        head += f", and of {smallest:.2f} with {described(fewer)}." if np.isfinite(smallest) else "."
    if not np.isnan(result.deviance):
        head += f"\nAICc {result.aicc:.6g}, BIC {result.bic:.6g}: smaller is better, between fits to the same data."
    if result.gauge:
        head += f"\nHeld as given, since lengths do not tell where the frame stands: {_joined([*result.gauge])}."
    outliers = [f"[yellow]-[/] outlier: {escape(str(one))}" for one in result.outliers]
    return "\n".join([head, *(f"[yellow]-[/] {escape(reason)}" for reason in result.reasons), *outliers])


def _joined(parts: list[str]) -> str:
    return " and ".join([", ".join(parts[:-1]), parts[-1]] if len(parts) > 2 else parts)

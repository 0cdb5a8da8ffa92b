"""What follows from statics, as tables for people: compensation, sensitivity, equilibria, identification."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from rich.markup import escape
from rich.table import Table

from cdpr_sim.analysis.compensation import Compensation
from cdpr_sim.analysis.equilibria import Equilibria, unstable_directions
from cdpr_sim.analysis.identifiability import best_of_fewer, described
from cdpr_sim.analysis.identification import Identification
from cdpr_sim.analysis.modes import Modes
from cdpr_sim.analysis.sensitivity import Effect, Sensitivity
from cdpr_sim.core.describe import describe_cables
from cdpr_sim.core.equilibrium import Equilibrium
from cdpr_sim.crosscheck.compensation_check import CompensationCheck
from cdpr_sim.physics.release import Release
from cdpr_sim.report.crosscheck_tables import SLACK, heading, overload_notes
from cdpr_sim.report.table_style import new_table


def compensation_table(
    compensation: Compensation, before: Sequence[Equilibrium], after: Sequence[Equilibrium]
) -> Table:
    """Errors of position and tilt with the rigid and with the compensated lengths, by each method.

    Args:
        compensation: what is told to the winches.
        before: each method's equilibrium with the rigid lengths.
        after: likewise with the compensated lengths.
    """
    robot, commanded = compensation.equilibrium.problem.robot, compensation.commanded
    x, y, z = 1e3 * commanded.translation
    results = {
        f"{when}\n{heading(found)}": found for when, all in (("before", before), ("after", after)) for found in all
    }
    title = f"{robot.name}, {describe_cables(robot, 'N')},\ncommanded to ({x:g}, {y:g}, {z:g}) mm"
    table = new_table(title, "", *results, dense=True, methods=True)
    shifts = [1e3 * (found.position - commanded.translation) for found in results.values()]
    turns = [np.degrees((found.rotation * commanded.rotation.inv()).magnitude()) for found in results.values()]
    for axis, name in enumerate("xyz"):
        table.add_row(escape(f"error {name} [mm]"), *(f"{shift[axis]:.6f}" for shift in shifts))
    distances = [float(np.linalg.norm(shift)) for shift in shifts]
    table.add_row(escape("error of position [mm]"), *map(_small, distances), style="bold")
    table.add_row(escape("error of rotation [°]"), *map(_small, turns), style="bold")
    table.add_row(escape("tilt [°]"), *(f"{np.degrees(found.tilt):.6f}" for found in results.values()))
    table.add_section()
    for cable in range(robot.cables):
        shown = (SLACK if found.slack[cable] else f"{found.tensions[cable]:.3f}" for found in results.values())
        table.add_row(escape(f"tension {cable + 1} [N]"), *shown)
    if any(found.overloaded.any() for found in results.values()):
        counts = (f"{int(found.overloaded.sum())} of {robot.cables}" for found in results.values())
        table.add_row("overloaded cables", *counts, style="red")
    table.add_section()
    table.add_row(escape("softest [N/m]"), *(f"{found.eigenvalues[0]:.3g}" for found in results.values()))
    table.add_row("equilibrium", *(found.stability.name.lower() for found in results.values()))
    return table


def _small(error: float) -> str:
    """With the six decimals of its neighbours; what they would show as nothing, by its size."""
    return f"{error:.6f}" if error >= 1e-5 or error == 0 else f"{error:.2e}"


def compensation_lengths(compensation: Compensation) -> str:
    """How much shorter to cut each cable than if it were rigid at the commanded pose."""
    robot = compensation.equilibrium.problem.robot
    shorter = 1e3 * (robot.rest_lengths(compensation.commanded) - compensation.rest_lengths)
    return escape("Cables shorter by [mm]: ") + ", ".join(f"{value:.3f}" for value in shorter)


def compensation_verdict(compensation: Compensation, hold: CompensationCheck | None = None) -> str:
    """What compensation came to, and why, and what MuJoCo does not confirm if it was asked, in a line each."""
    held = hold is None or hold.held
    color = "green" if compensation.exact and held else "yellow" if held else "red"
    found = compensation.reach.value if held else "what statics finds is not held in MuJoCo"
    head = f"[bold {color}]{found[0].upper() + found[1:]}[/]"
    if not compensation.exact:
        arm = f"a rotation counts as the way of a point {1e3 * compensation.arm:.0f} mm from the platform's origin"
        head += f": {1e3 * compensation.distance:.3f} mm away ({arm if compensation.arm else 'in position alone'})"
    reasons = (
        *compensation.reasons, *(hold.reasons if hold else ()), *overload_notes(compensation.equilibrium),
    )  # fmt: skip
    return "\n".join([head + ".", *(f"  - {escape(reason)}" for reason in reasons)])


def sensitivity_table(answer: Sensitivity, effects: Sequence[Effect]) -> Table:
    """What one unit of change of each number does, as ordered."""
    equilibrium = answer.equilibrium
    robot, (x, y, z) = equilibrium.problem.robot, 1e3 * equilibrium.problem.pose.translation
    where = f"commanded to ({x:g}, {y:g}, {z:g}) mm"
    title = f"{robot.name}, {describe_cables(robot, 'N')},\n{where}: what matters most"
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


def sensitivity_note(answer: Sensitivity) -> str:
    """How far the derivatives hold."""
    return (
        "They hold while the same cables stay taut: the nearest to going slack or taut is "
        f"{1e3 * answer.margin:.3g} mm of its length away."
    )


def modes_table(modes: Modes) -> Table:
    """Natural frequencies, and what each swing is made of: the largest parts of its motion, scaled to the largest."""
    robot = modes.equilibrium.problem.robot
    directions = ("x", "y", "z", "about x", "about y", "about z")
    table = new_table(f"{robot.name}: natural frequencies", "mode", "Hz", *directions, dense=True)
    for number, (frequency, shape) in enumerate(zip(modes.frequencies, modes.shapes, strict=True), start=1):
        parts = shape * robot.units
        parts = parts / parts[np.abs(parts).argmax()]
        table.add_row(str(number), f"{frequency:.3f}", *("" if abs(p) < 5e-3 else f"{p:.2f}" for p in parts))
    return table


def equilibria_table(found: Equilibria, releases: Sequence[Release] = (), reached: int | None = None) -> Table:
    """Lowest energy first, with what MuJoCo's platform does when it is let go there, if it was."""
    robot = found.problem.robot
    table = new_table(
        f"{robot.name}, {describe_cables(robot, 'N')}:\nequilibria of the same cable lengths",
        "", "energy\n[mJ]", "x\n[mm]", "y\n[mm]", "z\n[mm]", "tilt\n[°]", "slack", "softest\n[N/m]", "ways\ndown",
        *(["let go in\nMuJoCo"] if releases else []), dense=True,
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
    """What speaks for and against the list being complete."""
    if found.imbalance is None:
        return ""
    if found.imbalance == 0:
        return "As many with an even as with an odd number of unstable directions: nothing says that one is missing."
    return (
        f"[yellow]At least {abs(found.imbalance)} missing[/]: those with an even and with an odd number of unstable "
        "directions should be as many."
    )


def identification_table(found: Identification) -> Table:
    """Each unknown with its standard error, lengths in millimetres."""
    title = f"{found.robot.name}: what the measurements say"
    table = new_table(title, "", "value", "standard error", dense=True)
    table.add_column("", no_wrap=True)
    for name, unit, value, error in zip(found.names, found.units, found.values, found.standard_errors, strict=True):
        size, shown = (1e3, "mm") if unit == "m" else (1.0, unit)
        known = "undetermined" if np.isinf(error) else f"{size * error:.2g}"
        table.add_row(escape(name.replace("_", " ")), f"{size * value:.6g}", known, shown)
    return table


def identification_note(found: Identification) -> str:
    """What is left, and what the data cannot tell."""
    moved = found.residuals[:, :3][~np.isnan(found.residuals[:, :3])]
    turned = found.residuals[:, 3:][~np.isnan(found.residuals[:, 3:])]
    parts = []
    if moved.size:
        parts.append(f"{1e3 * np.sqrt(np.mean(moved**2)):.3g} mm")
    if turned.size:
        parts.append(f"{np.degrees(np.sqrt(np.mean(turned**2))):.3g}°")
    head = f"Residuals: {' and '.join(parts)} (root mean square)."
    if found.judged:
        said = {"position": f"{1e3 * found.scatters[0]:.3g} mm", "rotation": f"{np.degrees(found.scatters[1]):.3g}°"}
        head += f" Errors of measurement judged from them: {' and '.join(said[kind] for kind in found.judged)}."
    asked = next(iter(found.predictions.values()))
    fewer, least = best_of_fewer(found.predictions)
    if np.isinf(asked):
        head += "\nNo row can be left out: one alone determines an unknown."
    elif np.isfinite(asked):
        head += f"\nRows left out are missed by {asked:.2f} standard errors"
        head += f"; by {least:.2f} with {described(fewer)}." if np.isfinite(least) else "."
    return "\n".join([head, *(f"[yellow]-[/] {escape(reason)}" for reason in found.reasons)])

"""Tables of a robot and its cables; summaries of batches and trajectories."""

from __future__ import annotations

from typing import Any

import numpy as np
from rich.markup import escape
from rich.table import Table

from cdpr_sim.core.describe import describe_cables, describe_origins, some, span
from cdpr_sim.core.equilibrium_batch import EquilibriumBatch
from cdpr_sim.core.robot import Robot
from cdpr_sim.core.status import Status
from cdpr_sim.core.trajectory import Trajectory
from cdpr_sim.report.crosscheck_tables import heading
from cdpr_sim.report.table_style import new_table


def robot_table(robot: Robot) -> Table:
    """Description of a robot."""
    table = new_table(robot.name, "", text_columns=1)
    table.add_column("")  # wraps
    low, high = robot.workspace
    rows = {
        "": robot.description,
        "kind": f"{robot.kind}, {robot.mobility}",
        "cables": f"{robot.cables} {describe_cables(robot)}",
        "cable data": describe_origins(robot),
        "rest lengths": "of rigid cables"
        if robot.pretension is None
        else f"for a pretension of {robot.pretension:g} N",
        "tension limits": _limits(robot),
        "breaking load": _known(robot.breaking_load),
        "platform": f"{robot.mass:g} kg, {_size(robot.platform_size, 1e3)} mm",
        "centre of mass": f"({_point(robot.center_of_mass)}) mm in the platform",
        "frame": f"{_size(np.ptp(robot.frame, axis=0), 1.0)} m",
        "workspace": f"({low[0]:.4g}, {low[1]:.4g}, {low[2]:.4g}) to ({high[0]:.4g}, {high[1]:.4g}, {high[2]:.4g}) m",
        "gravity": f"{robot.gravity:g} m/s²",
        "source": robot.source,
    }
    for label, text in rows.items():
        if text:
            table.add_row(label, escape(" ".join(text.split())))
    return table


def cables_table(robot: Robot) -> Table:
    """Exit point, anchor point and axial stiffness of each cable."""
    headings = (heading for end in ("exit", "anchor") for heading in (f"{end}\nx [mm]", "\ny [mm]", "\nz [mm]"))
    table = new_table("Cables", "cable", *headings, "EA\n[N]")
    cables = zip(robot.exits, robot.anchors, robot.axial_stiffness, strict=True)
    for number, (exit_, anchor, stiffness) in enumerate(cables, start=1):
        table.add_row(str(number), *(f"{1e3 * value:.1f}" for value in (*exit_, *anchor)), f"{stiffness:.6g}")
    return table


def batch_table(equilibria: EquilibriumBatch) -> Table:
    """Summary of a batch: number of equilibria; their deviation, tilt, tensions, residuals and slack cables."""
    name = f"{equilibria.robot.name}, by {heading(equilibria)}".replace("\n", " ")
    table = new_table(f"{name}: {' × '.join(map(str, equilibria.shape))} problems", "", "median", "worst")
    done = equilibria.converged
    table.add_row("equilibria", "", f"{int(done.sum()):,} of {done.size:,}")
    for status in Status:
        count = int((equilibria.status == status).sum())
        if count and status is not Status.CONVERGED:
            table.row(f"none: {status.sentence}", "", f"{count:,}", style="red")
    if done.any():
        for label, values in (_numbers(equilibria, done) | {"unbalanced [N]": equilibria.residuals[done]}).items():
            form = ".1e" if "unbalanced" in label else ".3f"
            table.row(label, f"{np.median(values):{form}}", f"{values.max():{form}}")
        slack = equilibria.slack[done].sum(-1)
        table.add_row("slack cables", f"{np.median(slack):g}", f"{slack.max()} of {equilibria.robot.cables}")
    return table


def trajectory_table(motion: Trajectory) -> Table:
    """Summary of a trajectory, with the time of the worst value."""
    table = new_table(
        f"{motion.robot.name}: {len(motion)} states in {np.ptp(motion.times):.3g} s, by {heading(motion)}",
        "", "at the start", "at the end", "worst", "after [s]",
    )  # fmt: skip
    start, taut = motion.times[0], np.where(motion.slack, np.inf, motion.tensions).min(-1)
    for label, values in (_numbers(motion, ...) | {"slack cables": motion.slack.sum(-1)}).items():
        worst, form = int(np.argmax(values)), "d" if label == "slack cables" else ".3f"
        shown = (f"{values[row]:{form}}" for row in (0, -1, worst))
        table.row(label, *shown, f"{motion.times[worst] - start:.3g}")
    least = int(np.argmin(taut))
    if np.isfinite(taut[least]):
        shown = (f"{taut[row]:.3f}" if np.isfinite(taut[row]) else "" for row in (0, -1, least))
        table.row("smallest tension of a taut cable [N]", *shown, f"{motion.times[least] - start:.3g}")
    return table


def _numbers(equilibria: EquilibriumBatch, rows: Any) -> dict[str, np.ndarray]:
    """Quantities of some rows, (rows,) each, in the units of their labels."""
    deviation = equilibria.deviation[rows]
    return {
        "deviation [mm]": 1e3 * np.linalg.norm(deviation, axis=-1),
        "deviation -z [mm]": -1e3 * deviation[:, 2],
        "tilt [°]": np.degrees(equilibria.tilt[rows]),
        "largest tension [N]": equilibria.tensions[rows].max(-1),
    }


def _limits(robot: Robot) -> str:
    above = _known(robot.force_max)
    if not robot.force_min.any() and not above:
        return ""
    return f"at least {span(robot.force_min)} N, {f'at most {above}' if above else 'without an upper limit'}"


def _known(forces: np.ndarray) -> str:
    """The finite ones, and of how many cables if not of all; "" if there is none."""
    known = np.isfinite(forces)
    return f"{span(forces[known])} N{some(known)}" if known.any() else ""


def _size(edges: np.ndarray, unit: float) -> str:
    return " × ".join(f"{unit * edge:.4g}" for edge in edges)


def _point(point: np.ndarray) -> str:
    return ", ".join(f"{1e3 * value:.4g}" for value in point)

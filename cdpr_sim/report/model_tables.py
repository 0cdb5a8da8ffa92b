"""Tables of any MuJoCo model: its equilibrium, tensions and contacts; findings and time steps."""

# pyright: reportAttributeAccessIssue=false
# mujoco ships no type stubs for its compiled modules.
from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import mujoco
import numpy as np
from rich.markup import escape
from rich.table import Table

from cdpr_sim.anymodel.diagnose import ModelDiagnosis
from cdpr_sim.anymodel.model_equilibrium import ModelEquilibrium
from cdpr_sim.anymodel.names import joint_name
from cdpr_sim.anymodel.tendons import PARTS
from cdpr_sim.drawing.readable_numbers import per_cent
from cdpr_sim.report.table_style import new_table

SHOWN = 5e-5
"""[N] Forces below it are printed as zero, without a sign."""


def rest_lead(equilibrium: ModelEquilibrium) -> Iterator[str]:
    """The answer in a few lines."""
    agreement = equilibrium.agreement
    if agreement is None:
        ways = "It was at rest at the start."
    elif agreement.agrees:
        ways = "Time steps and Newton's method agree."
    else:
        ways = f"Time steps and Newton's method do not agree: {escape('; '.join(agreement.reasons))}."
    yield f"{ways} {equilibrium.stability.name.capitalize()} equilibrium."
    yield f"unbalanced   {equilibrium.residual:.1e} of the largest force"
    if equilibrium.friction_share > 0:
        creep = f"; after 0.5 s MuJoCo creeps at {equilibrium.creep:.2g} m/s or rad/s"
        yield f"friction     {per_cent(min(equilibrium.friction_share, 1.0))} of its limit in use{creep}"
    if equilibrium.neutral:
        yield f"neutral      {escape(', '.join(equilibrium.neutral))}"
    yield from (escape(note) for note in equilibrium.notes)


def pose_table(model: Any, start: Any, equilibrium: ModelEquilibrium) -> Table:
    """Each joint at the start and at rest."""
    table = new_table("", "joint", "", "start", "at rest", text_columns=2)
    for joint in range(model.njnt):
        name, at = joint_name(model, joint), int(model.jnt_qposadr[joint])
        before, after = start[at:], equilibrium.qpos[at:]
        kind = mujoco.mjtJoint(model.jnt_type[joint])
        if kind == mujoco.mjtJoint.mjJNT_SLIDE:
            table.row(name, "mm", f"{1e3 * before[0]:.3f}", f"{1e3 * after[0]:.3f}")
        elif kind == mujoco.mjtJoint.mjJNT_HINGE:
            table.row(name, "°", f"{math.degrees(before[0]):.3f}", f"{math.degrees(after[0]):.3f}")
        else:
            free = kind == mujoco.mjtJoint.mjJNT_FREE
            for row, axis in enumerate("xyz" if free else ""):
                label = name if row == 0 else ""
                table.row(label, f"{axis}, mm", f"{1e3 * before[row]:.3f}", f"{1e3 * after[row]:.3f}")
            turned = np.zeros(3)
            mujoco.mju_subQuat(turned, np.array(after[3 * free :][:4]), np.array(before[3 * free :][:4]))
            angle = math.degrees(float(np.linalg.norm(turned)))
            table.row("" if free else name, "turned, °", f"{0:.3f}", f"{angle:.3f}")
    return table


def tension_table(equilibrium: ModelEquilibrium) -> Table:
    """Tension of each tendon, and those parts that are not zero in all of them."""
    tensions = equilibrium.tendon_tensions
    parts = [part for part in PARTS if np.abs(getattr(tensions, part)).max(initial=0.0) >= SHOWN]
    table = new_table("Tensions [N]", "tendon", "total", *parts)
    for row, name in enumerate(tensions.names):
        label = name + (", slack" if tensions.slack[row] else ", pushes" if tensions.pushes[row] else "")
        table.row(label, _force(tensions.total[row]), *(_force(getattr(tensions, part)[row]) for part in parts))
    return table


def contact_table(equilibrium: ModelEquilibrium) -> Table:
    """Force of each contact."""
    table = new_table("Contacts", "bodies", "normal [N]", "friction [N]", "of its limit")
    for contact in equilibrium.contact_forces:
        numbers = _force(contact.normal), _force(contact.friction), per_cent(min(contact.share, 1.0))
        table.row(" and ".join(contact.bodies), *numbers)
    return table


def findings_lines(diagnosis: ModelDiagnosis) -> Iterator[str]:
    """One line for each finding and note."""
    yield from (f"- {escape(str(one))}" for one in diagnosis.findings)
    if not diagnosis.findings:
        yield "Nothing is wrong that is looked for."
    yield from (f"note: {escape(note)}" for note in diagnosis.notes)


def time_step_lines(model: Any, diagnosis: ModelDiagnosis) -> Iterator[str]:
    """Longest stable time step of each integrator, in a line."""
    if math.isfinite(diagnosis.fastest_period):
        yield f"fastest mode   {1e3 * diagnosis.fastest_period:.4g} ms, without contacts and limits"
    steps = {
        name: f"{1e3 * step:.4g} ms" if math.isfinite(step) else "any"
        for name, step in diagnosis.stable_time_steps.items()
    }
    if steps:
        yield f"stable up to   {', '.join(f'{step} ({name})' for name, step in steps.items())}"
    yield f"time step      {1e3 * model.opt.timestep:.4g} ms"


def _force(value: float) -> str:
    return f"{value if abs(value) >= SHOWN else 0.0:.4f}"

"""How each result introduces itself in a notebook: the tables that the command line prints, as HTML."""

from __future__ import annotations

from functools import singledispatch

import numpy as np

from cdpr_sim.analysis.clearance import Clearances
from cdpr_sim.analysis.compensation import Compensation
from cdpr_sim.analysis.equilibria import Equilibria, LoadPath
from cdpr_sim.analysis.identification import Identification
from cdpr_sim.analysis.modes import Modes
from cdpr_sim.analysis.sensitivity import Sensitivity
from cdpr_sim.analysis.workspace.hull import Hull
from cdpr_sim.core.equilibrium import Equilibrium
from cdpr_sim.core.equilibrium_batch import EquilibriumBatch
from cdpr_sim.core.html_repr import HtmlRepr
from cdpr_sim.core.problem import Problem
from cdpr_sim.core.robot import Robot
from cdpr_sim.core.trajectory import Trajectory
from cdpr_sim.crosscheck.check import Check
from cdpr_sim.crosscheck.compare import Agreement
from cdpr_sim.crosscheck.compensation_check import CompensationCheck
from cdpr_sim.crosscheck.layout_validation import LayoutValidation
from cdpr_sim.design.front import Front
from cdpr_sim.design.layout_result import LayoutResult
from cdpr_sim.proof.certificate import Certificate
from cdpr_sim.proof.complete import CompleteEquilibria
from cdpr_sim.report import analysis_tables, crosscheck_tables, design_tables, html, proof_tables, workspace_tables
from cdpr_sim.report.robot_tables import batch_table, cables_table, robot_table, trajectory_table

EFFECTS = 20
"""Of a sensitivity, the weightiest."""


@singledispatch
def html_of(result: HtmlRepr) -> str:
    """A result as HTML for a notebook: legible on dark and on light paper, everybody's text escaped."""
    return html.fragment(html.sentences(html.plain(repr(result))))


@html_of.register
def _(robot: Robot) -> str:
    from cdpr_sim.drawing import still

    words = f"{robot.name}, commanded to the middle of its workspace"
    warnings = (html.plain(sentence) for sentence in (*robot.warnings, *robot.notes))
    return html.fragment(
        html.picture(still.encoded(still.draw(robot)), words),
        html.table(robot_table(robot)),
        html.table(cables_table(robot)),
        html.sentences(*warnings),
    )


@html_of.register
def _(problem: Problem) -> str:
    return html.fragment(html.table(crosscheck_tables.problem_table(problem)))


@html_of.register
def _(found: Equilibrium) -> str:
    notes = crosscheck_tables.equilibrium_notes(found) if np.isfinite(found.residual) else []
    return html.fragment(
        html.table(crosscheck_tables.settle_table(found.problem, [found])), html.sentences(*map(html.plain, notes))
    )


@html_of.register
def _(equilibria: EquilibriumBatch) -> str:
    return html.fragment(html.table(batch_table(equilibria)))


@html_of.register
def _(motion: Trajectory) -> str:
    return html.fragment(html.table(trajectory_table(motion)), html.sentences("cdpr_sim.show(trajectory) plays it."))


@html_of.register
def _(agreement: Agreement) -> str:
    return html.fragment(
        html.table(crosscheck_tables.agreement_table(agreement)),
        html.sentences(crosscheck_tables.said(agreement), *map(html.plain, agreement.reasons)),
    )


@html_of.register
def _(check: Check) -> str:
    return html.fragment(
        html.table(workspace_tables.check_table(check)), html.sentences(*workspace_tables.check_lines(check))
    )


@html_of.register
def _(found: Compensation) -> str:
    return html.fragment(
        html.table(analysis_tables.compensation_table(found, [], [found.equilibrium])),
        html.sentences(analysis_tables.compensation_lengths(found), analysis_tables.compensation_verdict(found)),
    )


@html_of.register
def _(hold: CompensationCheck) -> str:
    after = [rest for rest in (hold.compensation.equilibrium, hold.stayed) if rest is not None]
    return html.fragment(
        html.table(analysis_tables.compensation_table(hold.compensation, [], after)),
        html.sentences(analysis_tables.compensation_verdict(hold.compensation, hold)),
    )


@html_of.register
def _(modes: Modes) -> str:
    return html.fragment(html.table(analysis_tables.modes_table(modes)))


@html_of.register
def _(answer: Sensitivity) -> str:
    return html.fragment(
        html.table(analysis_tables.sensitivity_table(answer, answer.effects()[:EFFECTS])),
        html.sentences(analysis_tables.sensitivity_note(answer)),
    )


@html_of.register
def _(found: Equilibria) -> str:
    return html.fragment(
        html.table(analysis_tables.equilibria_table(found)), html.sentences(analysis_tables.equilibria_note(found))
    )


@html_of.register
def _(found: Certificate) -> str:
    return html.fragment(
        html.table(proof_tables.certificate_table([found])), html.sentences(*proof_tables.reasons([found]))
    )


@html_of.register
def _(found: CompleteEquilibria) -> str:
    tables = [html.table(proof_tables.certificate_table(found.certificates))] if found.certificates else []
    return html.fragment(*tables, html.sentences(proof_tables.complete_note(found)))


@html_of.register
def _(followed: LoadPath) -> str:
    jumps = ", ".join(f"{100 * load:.3g} %" for load in followed.jumps)
    told = (
        f"It falls to another equilibrium at {jumps} of the load." if jumps else "It follows its load without a jump."
    )
    reached = crosscheck_tables.settle_table(followed.reached.problem, [followed.reached])
    return html.fragment(html.table(reached), html.sentences(told))


@html_of.register
def _(found: Clearances) -> str:
    return html.fragment(html.table(design_tables.clearance_table(found)))


@html_of.register
def _(found: Identification) -> str:
    return html.fragment(
        html.table(analysis_tables.identification_table(found)),
        html.sentences(analysis_tables.identification_note(found)),
    )


@html_of.register
def _(found: LayoutResult) -> str:
    return html.fragment(html.table(design_tables.moved_table(found)), html.sentences(html.plain(str(found))))


@html_of.register
def _(front: Front) -> str:
    return html.fragment(html.table(design_tables.front_table(front)))


@html_of.register
def _(validation: LayoutValidation) -> str:
    return html.fragment(
        html.table(design_tables.moved_table(validation.found)),
        html.sentences(*map(html.plain, validation.sentences)),
    )


@html_of.register
def _(hull: Hull) -> str:
    return html.fragment(html.table(workspace_tables.hull_table(hull)))

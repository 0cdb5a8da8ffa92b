"""Display of results in notebooks: the tables of the command line, as HTML."""

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
"""Number of sensitivities displayed, the largest first."""


@singledispatch
def html_of(result: HtmlRepr) -> str:
    """A result as HTML for a notebook, legible on dark and light backgrounds, with all text escaped."""
    return html.fragment(html.sentences(html.plain(repr(result))))


@html_of.register
def _(robot: Robot) -> str:
    from cdpr_sim.drawing import still

    description = f"{robot.name}, commanded to the middle of its workspace"
    warnings = (html.plain(sentence) for sentence in (*robot.warnings, *robot.notes))
    return html.fragment(
        html.picture(still.encoded(still.draw(robot)), description),
        html.table(robot_table(robot)),
        html.table(cables_table(robot)),
        html.sentences(*warnings),
    )


@html_of.register
def _(problem: Problem) -> str:
    return html.fragment(html.table(crosscheck_tables.problem_table(problem)))


@html_of.register
def _(equilibrium: Equilibrium) -> str:
    notes = crosscheck_tables.equilibrium_notes(equilibrium) if np.isfinite(equilibrium.residual) else []
    return html.fragment(
        html.table(crosscheck_tables.settle_table(equilibrium.problem, [equilibrium])),
        html.sentences(*map(html.plain, notes)),
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
        html.sentences(crosscheck_tables.verdict_sentence(agreement), *map(html.plain, agreement.reasons)),
    )


@html_of.register
def _(check: Check) -> str:
    return html.fragment(
        html.table(workspace_tables.check_table(check)), html.sentences(*workspace_tables.check_lines(check))
    )


@html_of.register
def _(compensation: Compensation) -> str:
    return html.fragment(
        html.table(analysis_tables.compensation_table(compensation, [], [compensation.equilibrium])),
        html.sentences(
            analysis_tables.compensation_lengths(compensation), analysis_tables.compensation_verdict(compensation)
        ),
    )


@html_of.register
def _(verification: CompensationCheck) -> str:
    compensation, settled = verification.compensation, verification.settled_from_compensated
    after = [one for one in (compensation.equilibrium, settled) if one is not None]
    return html.fragment(
        html.table(analysis_tables.compensation_table(compensation, [], after)),
        html.sentences(analysis_tables.compensation_verdict(compensation, verification)),
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
def _(proof: Certificate) -> str:
    return html.fragment(
        html.table(proof_tables.certificate_table([proof])), html.sentences(*proof_tables.reasons([proof]))
    )


@html_of.register
def _(proved: CompleteEquilibria) -> str:
    tables = [html.table(proof_tables.certificate_table(proved.certificates))] if proved.certificates else []
    return html.fragment(*tables, html.sentences(proof_tables.complete_note(proved)))


@html_of.register
def _(path: LoadPath) -> str:
    jumps = ", ".join(f"{100 * load:.3g} %" for load in path.jumps)
    note = f"Jump to another equilibrium at {jumps} of the load." if jumps else "No jump while the load increases."
    reached = crosscheck_tables.settle_table(path.reached.problem, [path.reached])
    return html.fragment(html.table(reached), html.sentences(note))


@html_of.register
def _(clearances: Clearances) -> str:
    return html.fragment(html.table(design_tables.clearance_table(clearances)))


@html_of.register
def _(result: Identification) -> str:
    return html.fragment(
        html.table(analysis_tables.identification_table(result)),
        html.sentences(analysis_tables.identification_note(result)),
    )


@html_of.register
def _(result: LayoutResult) -> str:
    return html.fragment(html.table(design_tables.changes_table(result)), html.sentences(html.plain(str(result))))


@html_of.register
def _(front: Front) -> str:
    return html.fragment(html.table(design_tables.front_table(front)))


@html_of.register
def _(validation: LayoutValidation) -> str:
    return html.fragment(
        html.table(design_tables.changes_table(validation.layout)),
        html.sentences(*map(html.plain, validation.sentences)),
    )


@html_of.register
def _(hull: Hull) -> str:
    return html.fragment(html.table(workspace_tables.hull_table(hull)))

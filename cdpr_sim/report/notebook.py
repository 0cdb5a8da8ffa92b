"""Display of results in notebooks: the tables of the command line, as HTML."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from functools import singledispatch
from typing import Any

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
from cdpr_sim.report import analysis_tables as analysis
from cdpr_sim.report import crosscheck_tables as crosscheck
from cdpr_sim.report import design_tables as design
from cdpr_sim.report import html, proof_tables, workspace_tables
from cdpr_sim.report.robot_tables import batch_table, cables_table, robot_table, trajectory_table

EFFECTS = 20
"""Number of sensitivities displayed, the largest first."""

Content = Iterable[html.Part]


def html_of(result: HtmlRepr) -> str:
    """A result as HTML for a notebook, legible on dark and light backgrounds, with all text escaped."""
    return html.fragment(*content_of(result))


@singledispatch
def content_of(result: Any) -> Content:
    """The tables, pictures and sentences (rich's markup) that a result is displayed by."""
    return [html.plain(repr(result))]


def _robot(robot: Robot) -> Content:
    from cdpr_sim.drawing import still

    yield html.EmbeddedImage(
        still.encoded(still.draw(robot)), f"{robot.name}, commanded to the middle of its workspace"
    )
    yield robot_table(robot)
    yield cables_table(robot)
    yield from map(html.plain, (*robot.warnings, *robot.notes))


def _equilibrium(equilibrium: Equilibrium) -> Content:
    yield crosscheck.settle_table(equilibrium.problem, [equilibrium])
    if np.isfinite(equilibrium.residual):
        yield from map(html.plain, crosscheck.equilibrium_notes(equilibrium))


def _compensation_check(verification: CompensationCheck) -> Content:
    compensation, settled = verification.compensation, verification.settled_from_compensated
    after = [one for one in (compensation.equilibrium, settled) if one is not None]
    yield analysis.compensation_verdict(compensation, verification)
    yield analysis.compensation_table(compensation, [], after)


def _load_path(path: LoadPath) -> Content:
    jumps = ", ".join(f"{100 * load:.3g} %" for load in path.jumps)
    yield crosscheck.settle_table(path.reached.problem, [path.reached])
    yield f"Jump to another equilibrium at {jumps} of the load." if jumps else "No jump while the load increases."


_CONTENT: dict[type, Callable[[Any], Content]] = {
    Robot: _robot,
    Problem: lambda problem: [crosscheck.problem_table(problem)],
    Equilibrium: _equilibrium,
    EquilibriumBatch: lambda equilibria: [batch_table(equilibria)],
    Trajectory: lambda motion: [trajectory_table(motion), "cdpr_sim.show(trajectory) plays it."],
    Agreement: lambda agreement: [
        crosscheck.verdict_sentence(agreement),
        *map(html.plain, agreement.reasons),
        crosscheck.agreement_table(agreement),
    ],
    Check: lambda check: [*workspace_tables.check_lines(check), workspace_tables.check_table(check.dataset)],
    Compensation: lambda found: [
        analysis.compensation_verdict(found),
        analysis.compensation_lengths(found),
        analysis.compensation_table(found, [], [found.equilibrium]),
    ],
    CompensationCheck: _compensation_check,
    Modes: lambda modes: [analysis.modes_table(modes)],
    Sensitivity: lambda answer: [
        analysis.sensitivity_note(answer),
        analysis.sensitivity_table(answer, answer.effects()[:EFFECTS]),
    ],
    Equilibria: lambda found: [analysis.equilibria_table(found), analysis.equilibria_note(found)],
    Certificate: lambda proof: [proof_tables.certificate_table([proof]), *proof_tables.reasons([proof])],
    CompleteEquilibria: lambda proved: [
        *([proof_tables.certificate_table(proved.certificates)] if proved.certificates else []),
        proof_tables.complete_note(proved),
    ],
    LoadPath: _load_path,
    Clearances: lambda clearances: [design.clearance_table(clearances)],
    Identification: lambda found: [analysis.identification_table(found), analysis.identification_note(found)],
    LayoutResult: lambda result: [
        html.plain(str(result)),
        *([design.changes_table(result)] if result.better else []),
    ],
    Front: lambda front: [design.front_table(front)],
    LayoutValidation: lambda validation: [
        *map(html.plain, validation.sentences),
        design.changes_table(validation.layout),
    ],
    Hull: lambda hull: [workspace_tables.hull_table(hull)],
}

for _kind, _content in _CONTENT.items():
    content_of.register(_kind, _content)

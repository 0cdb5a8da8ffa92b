"""How each result introduces itself in a notebook: the tables that the command line prints, as HTML."""

from __future__ import annotations

from functools import singledispatch

import numpy as np

from cdpr_sim.analysis.clearance import Clearances
from cdpr_sim.analysis.compensation import Compensation
from cdpr_sim.analysis.equilibria import Equilibria, Following
from cdpr_sim.analysis.identification import Identification
from cdpr_sim.analysis.modes import Modes
from cdpr_sim.analysis.sensitivity import Sensitivity
from cdpr_sim.analysis.workspace.hull import Hull
from cdpr_sim.core.equilibrium import Equilibrium
from cdpr_sim.core.introduced import Introduced
from cdpr_sim.core.problem import Problem
from cdpr_sim.core.rests import Rests
from cdpr_sim.core.robot import Robot
from cdpr_sim.core.trajectory import Trajectory
from cdpr_sim.crosscheck.check import Check
from cdpr_sim.crosscheck.compare import Agreement
from cdpr_sim.crosscheck.hold import Hold
from cdpr_sim.crosscheck.layout import Proof
from cdpr_sim.design.front import Front
from cdpr_sim.design.layout import Layout
from cdpr_sim.proof.certificate import Certificate
from cdpr_sim.proof.complete import CompleteEquilibria
from cdpr_sim.report import analysis, crosscheck, design, html, proof, workspace
from cdpr_sim.report.robot import cables_table, rests_table, robot_table, trajectory_table

EFFECTS = 20
"""Of a sensitivity, the weightiest."""


@singledispatch
def introduce(result: Introduced) -> str:
    """A result as HTML for a notebook: legible on dark and on light paper, everybody's text escaped."""
    return html.fragment(html.sentences(html.plain(repr(result))))


@introduce.register
def _(robot: Robot) -> str:
    from cdpr_sim.drawing import still

    words = f"{robot.name}, commanded to the middle of its workspace"
    doubts = (html.plain(sentence) for sentence in (*robot.doubts, *robot.notes))
    return html.fragment(
        html.picture(still.encoded(still.draw(robot)), words),
        html.table(robot_table(robot)),
        html.table(cables_table(robot)),
        html.sentences(*doubts),
    )


@introduce.register
def _(problem: Problem) -> str:
    return html.fragment(html.table(crosscheck.problem_table(problem)))


@introduce.register
def _(found: Equilibrium) -> str:
    notes = crosscheck.equilibrium_notes(found) if np.isfinite(found.residual) else []
    return html.fragment(
        html.table(crosscheck.settle_table(found.problem, [found])), html.sentences(*map(html.plain, notes))
    )


@introduce.register
def _(rests: Rests) -> str:
    return html.fragment(html.table(rests_table(rests)))


@introduce.register
def _(motion: Trajectory) -> str:
    return html.fragment(html.table(trajectory_table(motion)), html.sentences("cdpr_sim.show(trajectory) plays it."))


@introduce.register
def _(agreement: Agreement) -> str:
    return html.fragment(
        html.table(crosscheck.agreement_table(agreement)),
        html.sentences(crosscheck.said(agreement), *map(html.plain, agreement.reasons)),
    )


@introduce.register
def _(check: Check) -> str:
    return html.fragment(html.table(workspace.check_table(check)), html.sentences(*workspace.check_lines(check)))


@introduce.register
def _(found: Compensation) -> str:
    return html.fragment(
        html.table(analysis.compensation_table(found, [], [found.equilibrium])),
        html.sentences(analysis.compensation_lengths(found), analysis.compensation_verdict(found)),
    )


@introduce.register
def _(hold: Hold) -> str:
    after = [rest for rest in (hold.compensation.equilibrium, hold.stayed) if rest is not None]
    return html.fragment(
        html.table(analysis.compensation_table(hold.compensation, [], after)),
        html.sentences(analysis.compensation_verdict(hold.compensation, hold)),
    )


@introduce.register
def _(modes: Modes) -> str:
    return html.fragment(html.table(analysis.modes_table(modes)))


@introduce.register
def _(answer: Sensitivity) -> str:
    return html.fragment(
        html.table(analysis.sensitivity_table(answer, answer.effects()[:EFFECTS])),
        html.sentences(analysis.sensitivity_note(answer)),
    )


@introduce.register
def _(found: Equilibria) -> str:
    return html.fragment(html.table(analysis.equilibria_table(found)), html.sentences(analysis.equilibria_note(found)))


@introduce.register
def _(found: Certificate) -> str:
    return html.fragment(html.table(proof.certificate_table([found])), html.sentences(*proof.reasons([found])))


@introduce.register
def _(found: CompleteEquilibria) -> str:
    tables = [html.table(proof.certificate_table(found.certificates))] if found.certificates else []
    return html.fragment(*tables, html.sentences(proof.complete_note(found)))


@introduce.register
def _(followed: Following) -> str:
    jumps = ", ".join(f"{100 * load:.3g} %" for load in followed.jumps)
    told = (
        f"It falls to another equilibrium at {jumps} of the load." if jumps else "It follows its load without a jump."
    )
    reached = crosscheck.settle_table(followed.reached.problem, [followed.reached])
    return html.fragment(html.table(reached), html.sentences(told))


@introduce.register
def _(found: Clearances) -> str:
    return html.fragment(html.table(design.clearance_table(found)))


@introduce.register
def _(found: Identification) -> str:
    return html.fragment(
        html.table(analysis.identification_table(found)), html.sentences(analysis.identification_note(found))
    )


@introduce.register
def _(found: Layout) -> str:
    return html.fragment(html.table(design.moved_table(found)), html.sentences(html.plain(str(found))))


@introduce.register
def _(front: Front) -> str:
    return html.fragment(html.table(design.front_table(front)))


@introduce.register
def _(proof: Proof) -> str:
    return html.fragment(html.table(design.moved_table(proof.found)), html.sentences(*map(html.plain, proof.sentences)))


@introduce.register
def _(hull: Hull) -> str:
    return html.fragment(html.table(workspace.hull_table(hull)))

"""Results as dictionaries for JSON, in SI units: one function per command."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from cdpr_sim.core.cable import PROPERTIES
from cdpr_sim.core.equilibrium import Equilibrium
from cdpr_sim.core.property import REQUIRED
from cdpr_sim.report.crosscheck_tables import Outcome, best_point

if TYPE_CHECKING:
    from cdpr_sim.analysis.compensation import Compensation
    from cdpr_sim.analysis.equilibria import Equilibria, LoadPath
    from cdpr_sim.analysis.identification import Identification
    from cdpr_sim.analysis.modes import Modes
    from cdpr_sim.analysis.sensitivity import Effect, Sensitivity
    from cdpr_sim.anymodel.diagnose import ModelDiagnosis
    from cdpr_sim.anymodel.model_equilibrium import ModelEquilibrium
    from cdpr_sim.core.equilibrium_batch import EquilibriumBatch
    from cdpr_sim.core.problem import Problem
    from cdpr_sim.core.robot import Robot
    from cdpr_sim.crosscheck.compare import Agreement
    from cdpr_sim.crosscheck.compensation_check import CompensationCheck
    from cdpr_sim.physics.release import Release
    from cdpr_sim.proof.certificate import Certificate
    from cdpr_sim.proof.complete import CompleteEquilibria


_NUMBERS = (
    "source", "position", "euler", "tilt", "tensions", "lengths", "rest_lengths", "slack", "overloaded", "residual",
    "eigenvalues",
)  # fmt: skip


def outcome(result: Outcome) -> dict[str, Any]:
    """An equilibrium; or the best point of a method that found none, with the reason."""
    status: dict[str, Any] = {"equilibrium": isinstance(result, Equilibrium)}
    if not isinstance(result, Equilibrium):
        status["reason"] = result.reason
    point = best_point(result)
    if point is None:
        return status
    if (point.pulls != point.tensions).any():
        status |= fields(point, "pulls")
    return (
        status | fields(point, *_NUMBERS) | {"stability": point.stability.name.lower(), "iterations": point.iterations}
    )


def path(solved: EquilibriumBatch, settled: EquilibriumBatch, agree: np.ndarray) -> dict[str, Any]:
    """Both methods at each commanded pose of a path, as lists; null where a method found no equilibrium."""
    columns = ("positions", "tilt", "tensions", "lengths", "residuals")
    methods = {
        name: {column: _finite(getattr(batch, column)) for column in columns} | {"slack": batch.slack.tolist()}
        for name, batch in (("newton", solved), ("mujoco", settled))
    }
    return methods | fields(settled.problems, "positions", "rest_lengths") | {"agrees": agree.tolist()}


def solution(equilibrium: Equilibrium) -> dict[str, Any]:
    """The equilibrium of one solver, and the robot."""
    return outcome(equilibrium) | _robot(equilibrium.problem.robot)


def crosscheck(
    problem: Problem, outcomes: Sequence[Outcome], agreement: Agreement, proved: Sequence[Certificate] = ()
) -> dict[str, Any]:
    """The outcome of each method by its source, their agreement, and the certificates."""
    return (
        _problem(problem)
        | (certificates(proved) if proved else {})
        | {"results": _by_source(outcomes)}
        | fields(agreement, "agrees", "position_error", "rotation_error", "tension_error", "same_slack")
        | {"verdict": agreement.verdict.value, "reasons": list(agreement.reasons)}
    )


def certificates(proved: Sequence[Certificate]) -> dict[str, Any]:
    """The certificate of each method's equilibrium, by its source."""
    return _problem(proved[0].equilibrium.problem) | {
        "certificates": {one.equilibrium.source.rpartition("/")[2]: certificate(one) for one in proved}
    }


def certificate(proof: Certificate) -> dict[str, Any]:
    """Enclosures as [lower, upper]; unknown values are null."""
    enclosures = {
        "position": proof.position.tolist(),
        "rotation_matrix": proof.rotation.tolist(),
        "tensions": proof.tensions.tolist(),
        "decimals": {name: list(digits) for name, digits in proof.decimals.items()},
    } | fields(proof, "digits", "radius", "position_error", "rotation_error", "tension_error")
    found = fields(proof, "proved", "exists", "stable", "index", "slack", "reasons")
    return found | (enclosures if proof.exists else dict.fromkeys(enclosures))


def complete(proved: CompleteEquilibria) -> dict[str, Any]:
    """The proved equilibria, whether the list is complete, and the undecided boxes."""
    return {
        "proved_complete": proved.complete,
        "proved": [certificate(one) for one in proved],
        "undecided": [fields(one, "reason", "boxes") for one in proved.undecided],
    } | fields(proved, "pending", "boxes")


def compensation(
    problem: Problem,
    result: Compensation,
    verification: CompensationCheck,
    before: Sequence[Equilibrium],
    after: Sequence[Equilibrium],
) -> dict[str, Any]:
    """The compensated lengths, and the equilibria of each method with the rigid and with the compensated lengths."""
    return (
        _problem(problem)
        | fields(result, "exact", "distance")
        | fields(verification, "held", "reached_from_commanded")
        | {
            "reasons": [*result.reasons, *verification.reasons],
            "rest_lengths": result.rest_lengths.tolist(),
            "before": _by_source(before),
            "after": _by_source(after),
        }
    )


def sensitivity(answer: Sensitivity, effects: Sequence[Effect], modes: Modes) -> dict[str, Any]:
    """Effects, largest first; all derivatives; natural frequencies and mode shapes."""
    return _problem(answer.equilibrium.problem) | {
        "margin": answer.margin,
        "effects": [vars(effect) for effect in effects],
        "pose": {name: matrix.tolist() for name, matrix in answer.pose.items()},
        "tensions": {name: matrix.tolist() for name, matrix in answer.tensions.items()},
        "frequencies": modes.frequencies.tolist(),
        "mode_shapes": modes.shapes.tolist(),
    }


def equilibria(
    problem: Problem,
    found: Equilibria,
    releases: Sequence[Release],
    path: LoadPath,
    reached: int,
    reached_in_mujoco: int,
) -> dict[str, Any]:
    """Each equilibrium with its energy, and MuJoCo's platform released there if given; which of them are reached."""
    return _problem(problem) | {
        "reached": reached,
        "reached_in_mujoco": reached_in_mujoco,
        "jumps": list(path.jumps),
        "imbalance": found.imbalance,
        "equilibria": [
            outcome(one) | {"energy": float(energy), "stays_in_mujoco": release and release.stays}
            for one, energy, release in zip(found, found.energies, releases or [None] * len(found), strict=True)
        ],
    }


def identification(result: Identification) -> dict[str, Any]:
    """Value and standard error of each unknown; an undetermined or unknown one has the standard error null."""
    unknowns = zip(
        result.names, result.values.tolist(), _finite(result.standard_errors), result.intervals(0.95), result.units,
        strict=True,
    )  # fmt: skip
    return {
        **_robot(result.robot),
        "unknowns": {
            name: {"value": value, "standard_error": error, "interval_95": _finite(interval), "unit": unit}
            for name, value, error, interval, unit in unknowns
        },
        "spread": result.spread,
        "measurement_errors": dict(zip(result.scatters, _finite([*result.scatters.values()]), strict=True)),
        "aicc": _finite([result.aicc])[0],
        "bic": _finite([result.bic])[0],
        "repeated_rows": int(result.repeats.sum()),
        "outliers": [fields(one, "row", "name", "size") for one in result.outliers],
        "predictions": [
            {"unknowns": list(names), "error": _finite([error])[0]} for names, error in result.predictions.items()
        ],
        "reasons": list(result.reasons),
    }


def _by_source(outcomes: Sequence[Outcome]) -> dict[str, Any]:
    """By the last part of the source: "fsolve" for "seecr/fsolve"."""
    return {one["source"].rpartition("/")[2]: one for one in map(outcome, outcomes)}


def _problem(problem: Problem) -> dict[str, Any]:
    return _robot(problem.robot) | {"commanded": problem.pose.translation.tolist()}


def robot(robot: Robot) -> dict[str, Any]:
    """The robot's name, mass and cables, with the source of their numbers, and its geometry."""
    return _robot(robot) | fields(
        robot, "kind", "mobility", "gravity", "center_of_mass", "exits", "anchors", "frame", "workspace", "description",
        "source",
    )  # fmt: skip


def _robot(robot: Robot) -> dict[str, Any]:
    """The robot's name, mass and cables; with those properties of cables in which one of them is not as by default."""
    given = [name for name, one in PROPERTIES.items() if one.default is not REQUIRED and robot.cabling.has(name).any()]
    properties = {name: _finite(getattr(robot, name)) for name in given}
    description = {"robot": robot.name} | fields(robot, "mass", "material", "axial_stiffness")
    description["from_material"] = {name: list(names) for name, names in robot.from_material.items()}
    if robot.pretension is not None:
        description["pretension"] = robot.pretension
    return description | {"cables": properties} if properties else description


def fields(result: object, *names: str) -> dict[str, Any]:
    """Attributes by their names, arrays as lists."""
    values = {name: getattr(result, name) for name in names}
    return {name: value.tolist() if isinstance(value, np.ndarray) else value for name, value in values.items()}


def _finite(values: ArrayLike) -> list:
    """Infinite values as null, since JSON has no infinity."""
    return np.where(np.isfinite(values), values, None).tolist()  # type: ignore[call-overload]


def model_equilibrium(model: Any, equilibrium: ModelEquilibrium) -> dict[str, Any]:
    """Static equilibrium of a MuJoCo model."""
    from cdpr_sim.anymodel.names import joint_name
    from cdpr_sim.anymodel.tendons import PARTS

    tensions, agreement = equilibrium.tendon_tensions, equilibrium.agreement
    ends = [*model.jnt_qposadr[1:].tolist(), int(model.nq)] if model.njnt else []
    return {
        "way": equilibrium.way,
        "stability": equilibrium.stability.name.lower(),
        "agrees": None if agreement is None else agreement.agrees,
        "residual": equilibrium.residual,
        "qpos": equilibrium.qpos.tolist(),
        "act": equilibrium.act.tolist(),
        "ctrl": equilibrium.ctrl.tolist(),
        "joints": {
            joint_name(model, joint): equilibrium.qpos[int(model.jnt_qposadr[joint]) : end].tolist()
            for joint, end in enumerate(ends)
        },
        "tendons": [
            {"name": name, "tension": float(tensions.total[row]), "slack": bool(tensions.slack[row])}
            | {part: float(getattr(tensions, part)[row]) for part in PARTS}
            for row, name in enumerate(tensions.names)
        ],
        "contacts": [
            {"bodies": list(one.bodies), "position": one.position.tolist(), "normal": one.normal}
            | {"friction": one.friction, "share": one.share}
            for one in equilibrium.contact_forces
        ],
        "friction_share": equilibrium.friction_share,
        "creep": equilibrium.creep,
        "stiffness_eigenvalues": equilibrium.stiffness_eigenvalues.tolist(),
        "neutral": list(equilibrium.neutral),
        "iterations": dict(equilibrium.iterations),
        "notes": list(equilibrium.notes),
    }


def diagnosis(found: ModelDiagnosis) -> dict[str, Any]:
    """What is wrong with a MuJoCo model; of a time step without limit, null."""
    return {
        "findings": [
            {"kind": one.kind.name.lower(), "element": one.element, "problem": one.problem, "remedy": one.remedy}
            for one in found.findings
        ],
        "fastest_period": _or_null(found.fastest_period),
        "stable_time_steps": {integrator: _or_null(step) for integrator, step in found.stable_time_steps.items()},
        "notes": list(found.notes),
    }


def _or_null(value: float) -> float | None:
    return value if np.isfinite(value) else None

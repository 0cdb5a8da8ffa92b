"""Results as dictionaries for JSON, in SI units: one function per command."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from cdpr_sim.core.equilibrium import Equilibrium
from cdpr_sim.report.crosscheck_tables import Outcome, best_point

if TYPE_CHECKING:
    from cdpr_sim.analysis.compensation import Compensation
    from cdpr_sim.analysis.equilibria import Equilibria, LoadPath
    from cdpr_sim.analysis.identification import Identification
    from cdpr_sim.analysis.modes import Modes
    from cdpr_sim.analysis.sensitivity import Effect, Sensitivity
    from cdpr_sim.core.problem import Problem
    from cdpr_sim.core.robot import Robot
    from cdpr_sim.crosscheck.compare import Agreement
    from cdpr_sim.crosscheck.compensation_check import CompensationCheck
    from cdpr_sim.physics.release import Release
    from cdpr_sim.proof.certificate import Certificate
    from cdpr_sim.proof.complete import CompleteEquilibria


def outcome(result: Outcome) -> dict[str, Any]:
    """An equilibrium; or the best point of a method that found none, with the reason."""
    status: dict[str, Any] = {"equilibrium": isinstance(result, Equilibrium)}
    if not isinstance(result, Equilibrium):
        status["reason"] = result.reason
    point = best_point(result)
    if point is None:
        return status
    if (point.problem.robot.reeving > 1).any():
        status["pulls"] = point.pulls.tolist()
    return status | {
        "source": point.source,
        "position": point.position.tolist(),
        "euler": point.euler.tolist(),
        "tilt": point.tilt,
        "tensions": point.tensions.tolist(),
        "lengths": point.lengths.tolist(),
        "rest_lengths": point.rest_lengths.tolist(),
        "slack": point.slack.tolist(),
        "overloaded": point.overloaded.tolist(),
        "residual": point.residual,
        "eigenvalues": point.eigenvalues.tolist(),
        "stability": point.stability.name.lower(),
        "iterations": point.iterations,
    }


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
        | {
            "results": _by_source(outcomes),
            "agrees": agreement.agrees,
            "position_error": agreement.position_error,
            "rotation_error": agreement.rotation_error,
            "tension_error": agreement.tension_error,
            "same_slack": agreement.same_slack,
            "verdict": agreement.verdict.value,
            "reasons": list(agreement.reasons),
        }
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
        "digits": proof.digits,
        "radius": proof.radius,
        "position_error": proof.position_error,
        "rotation_error": proof.rotation_error,
        "tension_error": proof.tension_error,
    }
    return {
        "proved": proof.proved,
        "exists": proof.exists,
        "stable": proof.stable,
        "index": proof.index,
        "slack": list(proof.slack),
        "reasons": list(proof.reasons),
    } | (enclosures if proof.exists else dict.fromkeys(enclosures))


def complete(proved: CompleteEquilibria) -> dict[str, Any]:
    """The proved equilibria, whether the list is complete, and the undecided boxes."""
    return {
        "proved_complete": proved.complete,
        "proved": [certificate(one) for one in proved],
        "undecided": [{"reason": one.reason, "boxes": one.boxes} for one in proved.undecided],
        "pending": proved.pending,
        "boxes": proved.boxes,
    }


def compensation(
    problem: Problem,
    result: Compensation,
    verification: CompensationCheck,
    before: Sequence[Equilibrium],
    after: Sequence[Equilibrium],
) -> dict[str, Any]:
    """The compensated lengths, and the equilibria of each method with the rigid and with the compensated lengths."""
    return _problem(problem) | {
        "exact": result.exact,
        "distance": result.distance,
        "held": verification.held,
        "reached_from_commanded": verification.reached_from_commanded,
        "reasons": [*result.reasons, *verification.reasons],
        "rest_lengths": result.rest_lengths.tolist(),
        "before": _by_source(before),
        "after": _by_source(after),
    }


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
    """Each equilibrium with its energy and the behaviour of MuJoCo's platform released there; which are reached."""
    return _problem(problem) | {
        "reached": reached,
        "reached_in_mujoco": reached_in_mujoco,
        "jumps": list(path.jumps),
        "imbalance": found.imbalance,
        "equilibria": [
            outcome(one) | {"energy": float(energy), "stays_in_mujoco": release.stays}
            for one, energy, release in zip(found, found.energies, releases, strict=True)
        ],
    }


def identification(result: Identification) -> dict[str, Any]:
    """Value and standard error of each unknown; an undetermined one has the standard error null."""
    unknowns = zip(result.names, result.values.tolist(), _finite(result.standard_errors), result.units, strict=True)
    return {
        **_robot(result.robot),
        "unknowns": {
            name: {"value": value, "standard_error": error, "unit": unit} for name, value, error, unit in unknowns
        },
        "spread": result.spread,
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


def _robot(robot: Robot) -> dict[str, Any]:
    """The robot's name, mass and cables; with density, nonlinear elasticity, pulleys, drive line and limits, if any."""
    cabling, properties = robot.cabling, {}
    description = {
        "robot": robot.name,
        "mass": robot.mass,
        "material": robot.material,
        "axial_stiffness": robot.axial_stiffness.tolist(),
    }
    if not cabling.massless:
        properties["linear_density"] = cabling.linear_density.tolist()
    if not cabling.linear:
        properties["stiffening"] = cabling.stiffening.tolist()
    if cabling.pulleys.any():
        properties["pulley_radius"] = cabling.pulley_radius.tolist()
        properties["pulley_axis"] = cabling.pulley_axis.tolist()
    if cabling.winch_to_exit.any():
        properties["winch_to_exit"] = cabling.winch_to_exit.tolist()
    if (cabling.reeving > 1).any():
        properties["reeving"] = cabling.reeving.tolist()
    if cabling.force_min.any():
        properties["force_min"] = cabling.force_min.tolist()
    if np.isfinite(cabling.force_max).any():
        properties["force_max"] = _finite(cabling.force_max)
    if np.isfinite(cabling.breaking_load).any():
        properties["breaking_load"] = _finite(cabling.breaking_load)
    return description | {"cables": properties} if properties else description


def _finite(values: Sequence[float] | np.ndarray) -> list[float | None]:
    """Infinite values as null, since JSON has no infinity."""
    return [float(value) if math.isfinite(value) else None for value in values]

"""Results as dictionaries that JSON can hold, in SI units: one function for what each command finds."""

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


def outcome(found: Outcome) -> dict[str, Any]:
    """An equilibrium, or the best point of a method that found none and why."""
    result: dict[str, Any] = {"equilibrium": isinstance(found, Equilibrium)}
    if not isinstance(found, Equilibrium):
        result["reason"] = found.reason
    point = best_point(found)
    if point is None:
        return result
    return result | {
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


def solution(found: Equilibrium) -> dict[str, Any]:
    """What one solver came to, and of which cables."""
    return outcome(found) | _machine(found.problem.robot)


def crosscheck(
    problem: Problem, outcomes: Sequence[Outcome], agreement: Agreement, proved: Sequence[Certificate] = ()
) -> dict[str, Any]:
    """What each method came to, by the source that it names, and whether they agree; and what is proved of each."""
    told = certificates(proved) if proved else {}
    return (
        _asked(problem)
        | told
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


def certificates(found: Sequence[Certificate]) -> dict[str, Any]:
    """What is proved of each method's equilibrium, by the source that it names."""
    return _asked(found[0].equilibrium.problem) | {
        "certificates": {one.equilibrium.source.rpartition("/")[2]: certificate(one) for one in found}
    }


def certificate(found: Certificate) -> dict[str, Any]:
    """Enclosures as [lower, upper]; what is not known is null."""
    known = {
        "position": found.position.tolist(),
        "rotation_matrix": found.rotation.tolist(),
        "tensions": found.tensions.tolist(),
        "decimals": {name: list(digits) for name, digits in found.decimals.items()},
        "digits": found.digits,
        "radius": found.radius,
        "position_error": found.position_error,
        "rotation_error": found.rotation_error,
        "tension_error": found.tension_error,
    }
    return {
        "proved": found.proved,
        "exists": found.exists,
        "stable": found.stable,
        "index": found.index,
        "slack": list(found.slack),
        "reasons": list(found.reasons),
    } | (known if found.exists else dict.fromkeys(known))


def complete(found: CompleteEquilibria) -> dict[str, Any]:
    """The proved list, whether it is complete, and what is left open."""
    return {
        "proved_complete": found.complete,
        "proved": [certificate(one) for one in found],
        "undecided": [{"reason": one.reason, "boxes": one.boxes} for one in found.undecided],
        "pending": found.pending,
        "boxes": found.boxes,
    }


def compensation(
    problem: Problem,
    found: Compensation,
    hold: CompensationCheck,
    before: Sequence[Equilibrium],
    after: Sequence[Equilibrium],
) -> dict[str, Any]:
    """The lengths, and where each method puts the platform with the rigid and with the compensated ones."""
    return _asked(problem) | {
        "exact": found.exact,
        "distance": found.distance,
        "held": hold.held,
        "reached_from_commanded": hold.reached_from_commanded,
        "reasons": [*found.reasons, *hold.reasons],
        "rest_lengths": found.rest_lengths.tolist(),
        "before": _by_source(before),
        "after": _by_source(after),
    }


def sensitivity(answer: Sensitivity, effects: Sequence[Effect], modes: Modes) -> dict[str, Any]:
    """Effects in order of weight, all derivatives, and the natural frequencies."""
    return _asked(answer.equilibrium.problem) | {
        "margin": answer.margin,
        "effects": [vars(effect) for effect in effects],
        "pose": {name: matrix.tolist() for name, matrix in answer.pose.items()},
        "tensions": {name: matrix.tolist() for name, matrix in answer.tensions.items()},
        "frequencies": modes.frequencies.tolist(),
        "shapes": modes.shapes.tolist(),
    }


def equilibria(
    problem: Problem,
    found: Equilibria,
    releases: Sequence[Release],
    followed: LoadPath,
    reached: int,
    reached_in_mujoco: int,
) -> dict[str, Any]:
    """Each place to rest with its energy and what MuJoCo's platform does there, and which are reached."""
    return _asked(problem) | {
        "reached": reached,
        "reached_in_mujoco": reached_in_mujoco,
        "jumps": list(followed.jumps),
        "imbalance": found.imbalance,
        "equilibria": [
            outcome(one) | {"energy": float(energy), "stays_in_mujoco": release.stays}
            for one, energy, release in zip(found, found.energies, releases, strict=True)
        ],
    }


def identification(found: Identification) -> dict[str, Any]:
    """Each unknown's value and standard error; what is not known is null, as JSON has no infinity."""
    unknowns = zip(found.names, found.values.tolist(), _finite(found.standard_errors), found.units, strict=True)
    return {
        **_machine(found.robot),
        "unknowns": {
            name: {"value": value, "standard_error": error, "unit": unit} for name, value, error, unit in unknowns
        },
        "spread": found.spread,
        "predictions": [
            {"unknowns": list(names), "error": _finite([error])[0]} for names, error in found.predictions.items()
        ],
        "reasons": list(found.reasons),
    }


def _by_source(outcomes: Sequence[Outcome]) -> dict[str, Any]:
    """Each under the last word of its source: fsolve, of seecr/fsolve."""
    shown = [outcome(found) for found in outcomes]
    return {one["source"].rpartition("/")[2]: one for one in shown}


def _asked(problem: Problem) -> dict[str, Any]:
    return _machine(problem.robot) | {"commanded": problem.pose.translation.tolist()}


def _machine(robot: Robot) -> dict[str, Any]:
    """The robot's name, mass and cables: weight, law, pulleys, limits of each, where there are any."""
    cabling, properties = robot.cabling, {}
    told = {
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
    if cabling.force_min.any():
        properties["force_min"] = cabling.force_min.tolist()
    if np.isfinite(cabling.force_max).any():
        properties["force_max"] = _finite(cabling.force_max)
    if np.isfinite(cabling.breaking_load).any():
        properties["breaking_load"] = _finite(cabling.breaking_load)
    return told | {"cables": properties} if properties else told


def _finite(values: Sequence[float] | np.ndarray) -> list[float | None]:
    """What is infinite is null, as JSON has no infinity."""
    return [float(value) if math.isfinite(value) else None for value in values]

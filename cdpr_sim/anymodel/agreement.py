"""Agreement of the two ways: of the poses that time steps and Newton's method found."""

# pyright: reportAttributeAccessIssue=false
# mujoco ships no type stubs for its compiled modules.
from __future__ import annotations

import numpy as np
from jaxtyping import Float

from cdpr_sim.anymodel.forces import RestForces
from cdpr_sim.anymodel.judged import Judged
from cdpr_sim.anymodel.model_equilibrium import ModelAgreement
from cdpr_sim.anymodel.tendons import tensions_in
from cdpr_sim.core.tolerances import POSITION_TOLERANCE, ROTATION_TOLERANCE, TENSION_TOLERANCE


def agreement(judged: Judged, other: Float[np.ndarray, " nq"], newton_from: str) -> ModelAgreement:
    """Comparison of the pose that was judged with another.

    Along neutral directions and those that friction holds, equilibria lie side by side: there they may differ.
    """
    forces, pose = judged.balance.forces, judged.qpos
    errors = _errors(forces, pose, other)
    reasons = _reasons(errors)
    if reasons:
        forces.net(pose)
        resisting = judged.resisting_directions  # of unit mass
        along = resisting.T @ (resisting @ (forces.mass() @ forces.between(pose, other)))
        others = _errors(forces, pose, forces.moved(pose, along))
        if not _reasons(others):
            errors, reasons = others, ()
    return ModelAgreement(not reasons, newton_from, *errors, reasons)


def _errors(forces: RestForces, one: np.ndarray, two: np.ndarray) -> tuple[float, float, float]:
    found = []
    for qpos in (one, two):
        forces.net(qpos)
        data = forces.data
        found.append((data.xpos.copy(), data.xquat.copy(), tensions_in(forces.model, data).spring))
    (positions, rotations, tensions), (others, turned, pulls) = found
    position = float(np.linalg.norm(positions - others, axis=1).max(initial=0))
    signed = np.where(np.einsum("ij,ij->i", rotations, turned)[:, None] < 0, -turned, turned)
    sines = np.linalg.norm(rotations - signed, axis=1)  # 2 sin(angle / 4)
    rotation = float(4 * np.arcsin(np.clip(sines / 2, 0, 1)).max(initial=0))
    return position, rotation, float(np.abs(tensions - pulls).max(initial=0))


def _reasons(errors: tuple[float, float, float]) -> tuple[str, ...]:
    limits = (
        ("a body's position", POSITION_TOLERANCE, "m"),
        ("a body's rotation", ROTATION_TOLERANCE, "rad"),
        ("a tendon's tension", TENSION_TOLERANCE, "N"),
    )
    return tuple(
        f"{what} differs by {error:.1e} {unit} (tolerance {limit:.0e})"
        for error, (what, limit, unit) in zip(errors, limits, strict=True)
        if not error <= limit
    )

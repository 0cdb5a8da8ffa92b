"""What is wrong at rest: limits that carry load, soft constraints between masses far apart, steps that soften them."""

# pyright: reportAttributeAccessIssue=false
# mujoco ships no type stubs for its compiled modules.
from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any

import mujoco
import numpy as np

from cdpr_sim.anymodel.constraints import names_of_bodies, softened, touching
from cdpr_sim.anymodel.findings import FindingKind, ModelFinding
from cdpr_sim.anymodel.forces import RestForces
from cdpr_sim.anymodel.names import joint_name, name_of
from cdpr_sim.anymodel.tendons import tensions_in

LOADED = 1e-6
"""A limit carries load if its force is more than this fraction of the largest force, or of the weight."""

FAR_APART = 100.0
"""A constraint's load over the weight of the masses at its ends, above which they are far apart."""


def at_rest(model: Any, state: Any) -> Iterator[ModelFinding]:
    """Findings in the state at rest."""
    forces = RestForces(model, state)
    forces.net(np.array(state.qpos))
    yield from _tendon_limits(model, forces.data)
    yield from _joint_limits(model, forces.data)
    yield from _masses(model, forces.data)
    yield from _softened(model, forces.data)


def _tendon_limits(model: Any, data: Any) -> Iterator[ModelFinding]:
    found = tensions_in(model, data)
    weight = float(model.body_mass.sum() * np.linalg.norm(model.opt.gravity))
    least = LOADED * max(weight, float(np.abs(found.total).max(initial=0.0)))
    for tendon in np.flatnonzero(np.abs(found.limit) > least):
        force, end = float(found.limit[tendon]), model.tendon_range[tendon, int(found.limit[tendon] > 0)]
        unit, length = ("N", " m") if found.spatial[tendon] else ("N or N m", "")
        cable = found.spatial[tendon] and force > 0
        yield ModelFinding(
            FindingKind.LIMIT_CARRIES, f"tendon {name_of(model, 'tendon', int(tendon))!r}",
            f"its range, at {end:.6g}{length}, carries {abs(force):.4g} {unit} at rest, a soft constraint without a "
            "stiffness of its own",
            f'a spring, stiffness="..." springlength="0 {end:.6g}", in place of the range carries it as a cable does'
            if cable else "widen the range, or let a spring or an actuator carry the load",
        )  # fmt: skip


def _joint_limits(model: Any, data: Any) -> Iterator[ModelFinding]:
    size = np.sqrt(model.dof_M0)
    largest = float((np.abs(data.qfrc_constraint) / size).max(initial=0.0)) + float(np.linalg.norm(model.opt.gravity))
    for row in np.flatnonzero(data.efc_type == mujoco.mjtConstraint.mjCNSTR_LIMIT_JOINT):
        joint, force = int(data.efc_id[row]), float(data.efc_force[row])
        if force <= LOADED * largest * size[model.jnt_dofadr[joint]]:
            continue
        kind = model.jnt_type[joint]
        unit = "N" if kind == mujoco.mjtJoint.mjJNT_SLIDE else "N m"
        yield ModelFinding(
            FindingKind.LIMIT_CARRIES, f"joint {joint_name(model, joint)!r}",
            f"its range carries {force:.4g} {unit} at rest",
            "widen the range, or let a spring or an actuator carry the load",
        )  # fmt: skip


def _masses(model: Any, data: Any) -> Iterator[ModelFinding]:
    """Constraints that give way: MuJoCo's are as stiff as the masses at their ends, whatever load they carry."""
    gravity = float(np.linalg.norm(model.opt.gravity))
    if gravity == 0:
        return
    loads: dict[tuple[int, int], list[tuple[float, float]]] = {}
    for number, bodies, force in touching(model, data):
        contact = data.contact[number]
        if contact.solref[0] > 0:
            pair = min(bodies), max(bodies)
            loads.setdefault(pair, []).append((float(force[0]), float(contact.dist - contact.includemargin)))
    for bodies, carried in loads.items():
        names = names_of_bodies(model, bodies)
        load = sum(one for one, _ in carried) * _of_lighter(model, bodies)
        yield from _far_apart(
            f"contact of {names[0]} and {names[1]}", load / gravity,
            max(-gap for _, gap in carried), "negative solref of a geom",
        )  # fmt: skip
    equalities = data.efc_type == mujoco.mjtConstraint.mjCNSTR_EQUALITY
    for number in np.unique(data.efc_id[equalities]):
        joins = mujoco.mjtEq(model.eq_type[number]) in (mujoco.mjtEq.mjEQ_CONNECT, mujoco.mjtEq.mjEQ_WELD)
        if not joins or model.eq_solref[number, 0] <= 0:
            continue
        rows = np.flatnonzero(equalities & (data.efc_id == number))[:3]
        ends = [int(model.eq_obj1id[number]), int(model.eq_obj2id[number])]
        if model.eq_objtype[number] == mujoco.mjtObj.mjOBJ_SITE:
            ends = [int(model.site_bodyid[site]) for site in ends]
        load = float(np.linalg.norm(data.efc_force[rows])) * _of_lighter(model, ends)
        yield from _far_apart(
            f"equality {name_of(model, 'equality', int(number))!r}", load / gravity,
            float(np.linalg.norm(data.efc_pos[rows])), "negative solref",
        )  # fmt: skip


def _of_lighter(model: Any, bodies: Iterable[int]) -> float:
    """The inverse of the mass that gives way most [1/kg], in the pose ``qpos0``."""
    return max(float(model.body_invweight0[body, 0]) for body in bodies)


def _far_apart(element: str, load: float, gap: float, stiff: str) -> Iterator[ModelFinding]:
    if load > FAR_APART:
        yield ModelFinding(
            FindingKind.MASSES, element,
            f"it carries {load:.3g} times the weight of the lighter mass at its ends, and gives way by "
            f"{1e3 * gap:.3g} mm, since MuJoCo's soft constraints are as stiff as these masses",
            f"make the masses more alike, or give a stiffness by a {stiff}",
        )  # fmt: skip


def _softened(model: Any, data: Any) -> Iterator[ModelFinding]:
    """Constraints whose time constant is shorter than two time steps: MuJoCo's ``refsafe`` makes them softer."""
    least = 2 * float(model.opt.timestep)
    for element, reference in softened(model, data).items():
        yield ModelFinding(
            FindingKind.REFSAFE, element,
            f"its time constant, {reference:.4g} s in solref, is shorter than two time steps, so that MuJoCo uses "
            f"{least:.4g} s and the equilibrium depends on the time step",
            f'timestep="{reference / 2:.4g}", or a time constant of at least {least:.4g} s',
        )  # fmt: skip

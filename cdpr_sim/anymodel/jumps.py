"""Forces that jump, where a tendon changes its path or a contact its place: a model may never come to rest there."""

# pyright: reportAttributeAccessIssue=false
# mujoco ships no type stubs for its compiled modules.
from __future__ import annotations

import contextlib
import itertools
import time
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np
from jaxtyping import Float, Int

from cdpr_sim.anymodel.constraints import names_of_bodies, touching
from cdpr_sim.anymodel.forces import OutOfTime, RestForces, write_state
from cdpr_sim.anymodel.names import movers, name_of
from cdpr_sim.anymodel.tendons import tensions_in

JUMP = 0.1
"""Change of a force within ``WITHIN``, as a fraction of the largest force, above which it jumps."""

WITHIN = 1e-10
"""[m, rad] In this distance the stiffest contact of MuJoCo's own models changes its force by less than 1e-4 of it."""

REHEARSED = 900
"""Time steps of the motion in which jumps are looked for; one in each third says that they do not end."""

HALVINGS = 60
"""Halvings of the distance between two poses, at most."""


@dataclass(frozen=True, eq=False)
class Jump:
    """A force that jumps.

    Attributes:
        size: as a fraction of the largest force.
        joints: on which it jumps.
        cause: what changes there.
        qpos: the pose there.
    """

    size: float
    joints: tuple[str, ...]
    cause: str
    qpos: Float[np.ndarray, " nq"]


def lasting_jump(
    forces: RestForces, qpos: Float[np.ndarray, " nq"], dofs: Int[np.ndarray, " n"], deadline: float
) -> Jump | None:
    """The jump of a force that the motion from a pose meets again and again; None if there is none, or no time."""
    with contextlib.suppress(OutOfTime), forces.until(deadline):
        return _lasting(forces, qpos, dofs)
    return None


def _lasting(forces: RestForces, qpos: Float[np.ndarray, " nq"], dofs: Int[np.ndarray, " n"]) -> Jump | None:
    model, data = forces.model, mujoco.MjData(forces.model)
    write_state(data, forces.data)
    data.qpos[:] = qpos
    poses = [np.array(qpos)]
    for _ in range(REHEARSED):
        mujoco.mj_step(model, data)
        if time.monotonic() > forces.deadline:
            raise OutOfTime
        poses.append(np.array(data.qpos))
    if not np.isfinite(poses).all():
        return None
    nets = [forces.net(one) for one in poses]
    scale = nets[0].scale(dofs)
    sizes = [float(_change(one.force, two.force, dofs, scale).max()) for one, two in itertools.pairwise(nets)]
    third, found = REHEARSED // 3, None
    for start in range(0, REHEARSED, third):
        at = start + int(np.argmax(sizes[start : start + third]))
        found = _jump(forces, poses[at], poses[at + 1], dofs, scale)
        if found is None:
            return None
    return found


def _change(one: np.ndarray, two: np.ndarray, dofs: np.ndarray, scale: np.ndarray) -> np.ndarray:
    return np.abs(two - one)[dofs] / scale


def _jump(forces: RestForces, one: np.ndarray, two: np.ndarray, dofs: np.ndarray, scale: np.ndarray) -> Jump | None:
    """The jump between two poses, if halving their distance leaves the change of the force."""
    first, last = forces.net(one).force, forces.net(two).force
    for _ in range(HALVINGS):
        if _change(first, last, dofs, scale).max() < JUMP:
            return None
        apart = forces.between(one, two)
        if np.abs(apart).max() < WITHIN:
            break
        middle = forces.moved(one, apart / 2)
        force = forces.net(middle).force
        if _change(first, force, dofs, scale).max() > _change(force, last, dofs, scale).max():
            two, last = middle, force
        else:
            one, first = middle, force
    else:
        return None
    direction = np.zeros(forces.model.nv)
    direction[dofs] = (last - first)[dofs] / forces.model.dof_M0[dofs]
    size = float(_change(first, last, dofs, scale).max())
    return Jump(size, movers(forces.model, direction), _cause(forces, one, two), two)


def _cause(forces: RestForces, one: np.ndarray, two: np.ndarray) -> str:
    """What changes between two poses: a tendon's path, or else the contact whose force changes most."""
    model, arms, pushes = forces.model, [], []
    for pose in (one, two):
        forces.net(pose)
        data = forces.data
        arms.append(np.array(data.ten_J) * np.repeat(tensions_in(model, data).total, model.ten_J_rownnz))
        pushes.append(_pushes(model, data))
    changes = np.abs(arms[0] - arms[1])
    pairs = {pair: abs(pushes[0].get(pair, 0.0) - pushes[1].get(pair, 0.0)) for pair in pushes[0] | pushes[1]}
    if changes.max(initial=0.0) > max(pairs.values(), default=0.0):
        tendons = np.repeat(np.arange(model.ntendon), model.ten_J_rownnz)
        return f"tendon {name_of(model, 'tendon', int(tendons[np.argmax(changes)]))!r} changes its path"
    bodies = max(pairs, key=lambda pair: pairs[pair], default=(0, 0))
    return f"the contact of {' and '.join(names_of_bodies(model, bodies))} changes its place"


def _pushes(model: Any, data: Any) -> dict[tuple[int, int], float]:
    """The force between each two bodies that touch [N]."""
    found: dict[tuple[int, int], float] = {}
    for _, bodies, force in touching(model, data):
        pair = min(bodies), max(bodies)
        found[pair] = found.get(pair, 0.0) + float(force[0])
    return found

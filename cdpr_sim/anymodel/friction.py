"""Coulomb's friction at rest: which force within its limits holds the load.

MuJoCo's friction is a damper: it gives no force at rest, so that a loaded contact creeps. Here it is an unknown
force: of a contact with elliptic cones, tangential forces with Σ (f_i / mu_i)² ≤ N²; with pyramids, Σ |f_i / mu_i| ≤
N; of a joint or tendon with friction loss, |f| ≤ the loss. Of all forces that balance the load it is the one that
needs the least share of these limits.
"""

# pyright: reportAttributeAccessIssue=false
# mujoco ships no type stubs for its compiled modules.
from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np
from jaxtyping import Bool, Float, Int

from cdpr_sim.anymodel.friction_limits import least_share, shares

NOTHING = 1e-9
"""Rows shorter than this fraction of the longest are rounding: of a planar model, those across its plane."""

SLIDES = 1 - 1e-6
"""Share of a limit from which friction counts as at it, and slides."""

MOST = 400
"""Rows that carry load, at most: of more, those with the largest limits, which is possible but not the least share."""

RANK = 1e-3
"""Directions that rows of unit length hold with a smaller singular value are free: friction has too short a lever
there. A box on a plane could otherwise be held against tilting by corners whose heights differ by a micrometre."""


@dataclass(frozen=True, eq=False)
class FrictionRows:
    """Directions along which friction can act at a pose.

    Attributes:
        directions: generalised force of a unit force, (rows, nv).
        limits: largest force of each, (rows,) [N, N m].
        cones: number of the cone that a row belongs to, (rows,).
        corners: of each cone, whether it is a pyramid.
        contacts: of each cone, the number of its contact; -1 for friction loss.
        names: of each cone, what it is at other poses, too: two geoms and their how many-th contact; or an element.
    """

    directions: Float[np.ndarray, "rows nv"]
    limits: Float[np.ndarray, " rows"]
    cones: Int[np.ndarray, " rows"]
    corners: Bool[np.ndarray, " cones"]
    contacts: Int[np.ndarray, " cones"]
    names: tuple[tuple[int, ...], ...]

    @classmethod
    def none(cls, nv: int) -> FrictionRows:
        """No friction."""
        whole = np.zeros(0, dtype=int)
        return cls(np.zeros((0, nv)), np.zeros(0), whole, np.zeros(0, dtype=bool), whole, ())

    def force(self, pulls: Float[np.ndarray, " rows"]) -> Float[np.ndarray, " nv"]:
        """Generalised force of friction that pulls along each direction [N, N m]."""
        return self.directions.T @ pulls

    def pulls_of(self, other: FrictionRows, pulls: Float[np.ndarray, " others"]) -> Float[np.ndarray, " rows"]:
        """The same pulls as at another pose; 0 of a contact that is not there."""
        known = {name: pulls[other.cones == cone] for cone, name in enumerate(other.names)}
        found = np.zeros(len(self.limits))
        for cone, name in enumerate(self.names):
            rows = self.cones == cone
            if len(known.get(name, ())) == rows.sum():
                found[rows] = known[name]
        return found


@dataclass(frozen=True, eq=False)
class Held:
    """Friction that holds.

    Attributes:
        force: generalised force on the degrees of freedom asked for, (n,) [N, N m].
        use: force of each row as a fraction of its limit, (rows,); 0 of rows that do not touch them.
        share: of each cone, the share of its limit in use, (cones,).
        free: directions that it does not hold, in columns: it does not act along them, or is at its limit.
        apart: directions along which it does not act.
    """

    force: Float[np.ndarray, " n"]
    use: Float[np.ndarray, " rows"]
    share: Float[np.ndarray, " cones"]
    free: Float[np.ndarray, "n free"]
    apart: Float[np.ndarray, "n apart"]

    @property
    def largest(self) -> float:
        """Largest share of a limit in use."""
        return float(self.share.max(initial=0))


def jacobian(model: Any, data: Any) -> Float[np.ndarray, "nefc nv"]:
    """The constraints' Jacobian, dense."""
    full = np.zeros((data.nefc, model.nv))
    if data.nefc and not mujoco.mj_isSparse(model):
        full[:] = data.efc_J.reshape(-1, model.nv)[: data.nefc]
    elif data.nefc:
        mujoco.mju_sparse2dense(full, data.efc_J, data.efc_J_rownnz, data.efc_J_rowadr, data.efc_J_colind)
    return full


def rows_of(model: Any, data: Any) -> FrictionRows:
    """The friction that touches, after an evaluation of the forces, except on moving surfaces: their force is known."""
    jac = jacobian(model, data)
    directions, limits, cones, corners, contacts, names = [], [], [], [], [], []
    kinds = mujoco.mjtConstraint

    def add(rows: list[np.ndarray], most: list[float], pyramid: bool, contact: int, name: tuple[int, ...]) -> None:
        directions.extend(rows)
        limits.extend(most)
        cones.extend([len(corners)] * len(rows))
        corners.append(pyramid)
        contacts.append(contact)
        names.append(name)

    for kind in (int(kinds.mjCNSTR_FRICTION_DOF), int(kinds.mjCNSTR_FRICTION_TENDON)):
        for row in np.flatnonzero((data.efc_type == kind) & (data.efc_frictionloss > 0)):
            add([jac[row]], [data.efc_frictionloss[row]], False, -1, (kind, int(data.efc_id[row])))
    pyramids = model.opt.cone == mujoco.mjtCone.mjCONE_PYRAMIDAL
    seen: Counter[tuple[int, ...]] = Counter()
    for number in range(data.ncon):
        contact = data.contact[number]
        start, tangents, pair = contact.efc_address, contact.dim - 1, (-1, *map(int, contact.geom))
        seen[pair] += 1
        if start < 0 or tangents < 1:
            continue
        here = slice(start, start + (2 * tangents if pyramids else contact.dim))
        normal = data.efc_force[here].sum() if pyramids else data.efc_force[start]
        if not normal > 0 or np.any(data.efc_vel[here] != 0):  # a belt's friction is a known force
            continue
        rough = [i for i in range(tangents) if contact.friction[i] > 0]
        if pyramids:
            rows = [(jac[start + 2 * i] - jac[start + 2 * i + 1]) / (2 * contact.friction[i]) for i in rough]
        else:
            rows = [jac[start + 1 + i] for i in rough]
        if rows:
            add(rows, [contact.friction[i] * normal for i in rough], bool(pyramids), number, (*pair, seen[pair]))
    return FrictionRows(
        np.array(directions).reshape(len(directions), model.nv), np.array(limits), np.array(cones, dtype=int),
        np.array(corners, dtype=bool), np.array(contacts, dtype=int), tuple(names),
    )  # fmt: skip


def hold(
    rows: FrictionRows, net: Float[np.ndarray, " nv"], scale: Float[np.ndarray, " n"], dofs: Int[np.ndarray, " n"]
) -> Held:
    """The friction that balances the net force of ``dofs`` best, and the directions that it leaves free."""
    lengths = np.linalg.norm(rows.directions[:, dofs] / scale, axis=1)
    touch = lengths > NOTHING * lengths.max(initial=0)
    if touch.sum() > MOST:
        force = np.bincount(rows.cones[touch], (lengths * rows.limits)[touch], len(rows.corners))
        touch &= force[rows.cones] > np.sort(force[rows.cones][touch])[-MOST]
    share, use = np.zeros(len(rows.corners)), np.zeros(len(rows.limits))
    if not touch.any():
        return Held(np.zeros(len(dofs)), use, share, np.diag(1 / scale), np.diag(1 / scale))
    directions = rows.directions[touch][:, dofs] / scale
    held, apart = _held_and_free(directions)
    which, cones = np.unique(rows.cones[touch], return_inverse=True)
    corners = rows.corners[which]
    use[touch] = least_share(
        held.T @ (directions.T * rows.limits[touch]), -held.T @ (net[dofs] / scale), cones, corners
    )
    share[which] = found = shares(use[touch], cones, corners)
    _, free = _held_and_free(directions[(found < SLIDES)[cones]])
    force = rows.force(rows.limits * use)[dofs]
    return Held(force, use, share, free / scale[:, None], apart / scale[:, None])


def _held_and_free(
    directions: Float[np.ndarray, "rows n"],
) -> tuple[Float[np.ndarray, "n held"], Float[np.ndarray, "n free"]]:
    """Orthonormal bases of the directions that rows of friction hold, and of those that they leave free."""
    size = directions.shape[1]
    if not len(directions):
        return np.zeros((size, 0)), np.eye(size)
    _, values, basis = np.linalg.svd(directions / np.linalg.norm(directions, axis=1)[:, None])
    rank = int((values > RANK * values[0]).sum())
    return basis[:rank].T, basis[rank:].T

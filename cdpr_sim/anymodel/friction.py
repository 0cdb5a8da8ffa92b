"""Coulomb's friction at rest: which force within its limits holds the load.

MuJoCo's friction is a damper: it gives no force at rest, so that a loaded contact creeps. Here it is an unknown
force: of a contact with elliptic cones, tangential forces with Σ (f_i / mu_i)² ≤ N²; with pyramids, Σ |f_i / mu_i| ≤
N; of a joint or tendon with friction loss, |f| ≤ the loss. Of all forces that balance the load it is the one with
which MuJoCo's contacts creep, least in the metric of their damping, if that is within the limits; otherwise the one
that needs the least share.
"""

# pyright: reportAttributeAccessIssue=false
# mujoco ships no type stubs for its compiled modules.
from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np
from jaxtyping import Bool, Float, Int

from cdpr_sim.anymodel.friction_limits import closest, least_share, shares

NOTHING = 1e-9
"""Rows shorter than this fraction of the longest are rounding: of a planar model, those across its plane."""

SLIDES = 1 - 1e-9
"""Share of a limit from which friction counts as at it."""

RANK = 1e-3
"""Directions that rows of unit length hold with a smaller singular value are free: friction has too short a lever
there. A box on a plane could otherwise be held against tilting by corners whose heights differ by a micrometre."""


@dataclass(frozen=True, eq=False)
class FrictionRows:
    """Directions along which friction can act at a pose.

    Attributes:
        directions: generalised force of a unit force, (rows, nv).
        limits: largest force of each, (rows,) [N, N m].
        damping: MuJoCo's friction force over velocity, (rows,): how it shares the load between rows.
        cones: number of the cone that a row belongs to, (rows,).
        corners: of each cone, whether it is a pyramid.
        contacts: of each cone, the number of its contact; -1 for friction loss.
    """

    directions: Float[np.ndarray, "rows nv"]
    limits: Float[np.ndarray, " rows"]
    damping: Float[np.ndarray, " rows"]
    cones: Int[np.ndarray, " rows"]
    corners: Bool[np.ndarray, " cones"]
    contacts: Int[np.ndarray, " cones"]


@dataclass(frozen=True, eq=False)
class Held:
    """Friction that holds.

    Attributes:
        force: generalised force on the degrees of freedom asked for, (n,) [N, N m].
        share: of each cone that touches them, the share of its limit in use.
        rows: force of each row [N, N m]; 0 of rows that do not touch.
        cones: number of the cone that a row belongs to.
        contacts: of each cone, the number of its contact; -1 for friction loss.
        free: directions that it does not hold, in columns.
    """

    force: Float[np.ndarray, " n"]
    share: Float[np.ndarray, " cones"]
    rows: Float[np.ndarray, " rows"]
    cones: Int[np.ndarray, " rows"]
    contacts: Int[np.ndarray, " cones"]
    free: Float[np.ndarray, "n free"]

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
    directions, limits, damping, cones, corners, contacts = [], [], [], [], [], []
    kinds = mujoco.mjtConstraint

    def add(row: np.ndarray, limit: float, damper: float) -> None:
        directions.append(row)
        limits.append(limit)
        damping.append(damper)
        cones.append(len(corners))

    loss = np.isin(data.efc_type, (int(kinds.mjCNSTR_FRICTION_DOF), int(kinds.mjCNSTR_FRICTION_TENDON)))
    for row in np.flatnonzero(loss):
        if data.efc_frictionloss[row] > 0:
            add(jac[row], data.efc_frictionloss[row], data.efc_D[row] * data.efc_KBIP[row, 1])
            corners.append(False)
            contacts.append(-1)
    pyramids = model.opt.cone == mujoco.mjtCone.mjCONE_PYRAMIDAL
    for number in range(data.ncon):
        contact = data.contact[number]
        start, tangents = contact.efc_address, contact.dim - 1
        if start < 0 or tangents < 1:
            continue
        rows = slice(start, start + (2 * tangents if pyramids else contact.dim))
        normal = data.efc_force[rows].sum() if pyramids else data.efc_force[start]
        if not normal > 0 or np.any(data.efc_vel[rows] != 0):  # a belt's friction is a known force
            continue
        before = len(limits)
        for i in range(tangents):
            mu = contact.friction[i]
            if not mu > 0:
                continue
            first = start + 2 * i if pyramids else start + 1 + i
            row = (jac[first] - jac[first + 1]) / (2 * mu) if pyramids else jac[first]
            damper = data.efc_D[first] * data.efc_KBIP[first, 1] * (2 * mu**2 if pyramids else 1)
            add(row, mu * normal, damper)
        if len(limits) > before:
            corners.append(bool(pyramids))
            contacts.append(number)
    return FrictionRows(
        np.array(directions).reshape(len(directions), model.nv), np.array(limits), np.array(damping),
        np.array(cones, dtype=int), np.array(corners, dtype=bool), np.array(contacts, dtype=int),
    )  # fmt: skip


def hold(
    rows: FrictionRows | None,
    net: Float[np.ndarray, " nv"],
    scale: Float[np.ndarray, " n"],
    dofs: Int[np.ndarray, " n"],
) -> Held:
    """The friction that balances the net force of ``dofs`` best, and the directions that it leaves free."""
    nothing = np.zeros(len(dofs))
    if rows is None or not len(rows.limits):
        none = np.zeros(0, dtype=int)
        return Held(nothing, np.zeros(0), np.zeros(0), none, none, np.eye(len(dofs)))
    lengths = np.linalg.norm(rows.directions[:, dofs] / scale, axis=1)
    touch = lengths > NOTHING * lengths.max(initial=0)
    share, forces = np.zeros(len(rows.corners)), np.zeros(len(rows.limits))
    if not touch.any():
        return Held(nothing, share, forces, rows.cones, rows.contacts, np.eye(len(dofs)))
    directions, limits, damping = rows.directions[touch][:, dofs], rows.limits[touch], rows.damping[touch]
    _, cones = np.unique(rows.cones[touch], return_inverse=True)
    which = np.unique(rows.cones[touch])
    corners = rows.corners[which]
    matrix, load = (directions * limits[:, None] / scale).T, -net[dofs] / scale
    metric = np.sqrt(np.maximum(damping, 1e-300)) / limits
    metric /= metric.max()
    held, _ = _held_and_free(directions / scale)
    use = _balancing(matrix, load, metric, held)
    found = shares(use, cones, corners)
    if found.max() > SLIDES:
        other = least_share(held.T @ matrix, held.T @ (matrix @ use), use, cones, corners)
        fits = shares(other, cones, corners).max() <= 1
        use = other if fits else closest(matrix, load, cones, corners)
        found = shares(use, cones, corners)
    share[which], forces[touch] = found, use * limits
    sticks = (found < SLIDES)[cones]
    _, free = _held_and_free((directions / scale)[sticks])
    free = free / scale[:, None]
    return Held(scale * (matrix @ use), share, forces, rows.cones, rows.contacts, free)


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


def _balancing(matrix: np.ndarray, load: np.ndarray, metric: np.ndarray, held: np.ndarray) -> np.ndarray:
    """The smallest friction in a metric that balances the load along the directions held."""
    return metric * np.linalg.lstsq(held.T @ matrix * metric, held.T @ load, rcond=1e-13)[0]

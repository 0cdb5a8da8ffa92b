"""Coulomb's friction at rest: which force within its limits holds the load.

MuJoCo's friction is a damper: it gives no force at rest, so that a loaded contact creeps. Here it is an unknown
force: of a contact with elliptic cones, tangential forces with Σ (f_i / mu_i)² ≤ N²; with pyramids, Σ |f_i / mu_i| ≤
N; of a joint or tendon with friction loss, |f| ≤ the loss. Of all forces that balance the load it is the one that
needs the least share of these limits.
"""

# pyright: reportAttributeAccessIssue=false
# mujoco ships no type stubs for its compiled modules.
from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np
from jaxtyping import Bool, Float, Int

from cdpr_sim.anymodel.constraints import jacobian
from cdpr_sim.anymodel.friction_limits import least_share, shares

NOTHING = 1e-9
"""Rows shorter than this fraction of the longest are rounding: of a planar model, those across its plane."""

LOADED = 1e-6
"""Share of a friction limit above which friction carries load."""

SLIDES = 1 - 1e-6
"""Share of a limit from which friction counts as at it, and slides."""

MOST = 400
"""Rows that carry load, at most: of more, those with the largest limits, which is possible but not the least share."""

MOST_ROWS = 5
"""Of a cone, at most."""

RANK = 1e-3
"""Directions that rows of unit length hold with a smaller singular value are free: friction has too short a lever
there. A box on a plane could otherwise be held against tilting by corners whose heights differ by a micrometre."""


@dataclass(frozen=True, eq=False)
class FrictionRows:
    """Forces that friction can exert at a pose, each along a row of the constraints' Jacobian or between two of them.

    Attributes:
        ends: rows of the Jacobian, (rows, 2); the direction is their difference by ``factors``; -1 is no row.
        factors: (rows,).
        limits: largest force of each, (rows,) [N, N m].
        cones: number of the cone that a row belongs to, (rows,).
        corners: of each cone, whether it is a pyramid.
        contacts: of each cone, the number of its contact; -1 for friction loss.
        names: of each cone, what it is at other poses, too, (cones, 4): two geoms and their how many-th contact; or a
            kind of constraint and its element.
    """

    ends: Int[np.ndarray, "rows 2"]
    factors: Float[np.ndarray, " rows"]
    limits: Float[np.ndarray, " rows"]
    cones: Int[np.ndarray, " rows"]
    corners: Bool[np.ndarray, " cones"]
    contacts: Int[np.ndarray, " cones"]
    names: Int[np.ndarray, "cones 4"]

    @classmethod
    def none(cls) -> FrictionRows:
        """No friction."""
        whole, real = np.zeros(0, dtype=int), np.zeros(0)
        return cls(whole.reshape(0, 2), real, real, whole, np.zeros(0, dtype=bool), whole, whole.reshape(0, 4))

    def directions(self, model: Any, data: Any) -> Float[np.ndarray, "rows nv"]:
        """Generalised force of a unit force of each, while ``data`` is at their pose."""
        if not len(self.ends):
            return np.zeros((0, model.nv))
        jac = np.vstack([jacobian(model, data), np.zeros(model.nv)])
        return self.factors[:, None] * (jac[self.ends[:, 0]] - jac[self.ends[:, 1]])

    def force(self, model: Any, data: Any, pulls: Float[np.ndarray, " rows"]) -> Float[np.ndarray, " nv"]:
        """Generalised force of friction that pulls along each direction, while ``data`` is at their pose [N, N m]."""
        on_rows, found = np.zeros(data.nefc + 1), np.zeros(model.nv)
        np.add.at(on_rows, self.ends, (self.factors * pulls)[:, None] * (1.0, -1.0))
        if data.nefc:
            mujoco.mj_mulJacTVec(model, data, found, on_rows[:-1])
        return found

    def pulls_of(self, other: FrictionRows, pulls: Float[np.ndarray, " others"]) -> Float[np.ndarray, " rows"]:
        """The same pulls as at another pose; 0 of a contact that is not there."""
        if np.array_equal(self.names, other.names) and np.array_equal(self.cones, other.cones):
            return pulls
        found = np.zeros(len(self.limits))
        _, here, there = np.intersect1d(self._keys(other), other._keys(self), assume_unique=True, return_indices=True)
        found[here] = pulls[there]
        return found

    def _keys(self, other: FrictionRows) -> Int[np.ndarray, " rows"]:
        """A number for each row by the name of its cone and its place there, which both have in common."""
        sizes = 2 + np.maximum(self.names.max(axis=0, initial=0), other.names.max(axis=0, initial=0))
        cones = np.asarray(np.ravel_multi_index(tuple((self.names + 1).T), tuple(sizes)))
        first = np.searchsorted(self.cones, self.cones)
        return MOST_ROWS * cones[self.cones] + np.arange(len(self.cones)) - first


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


def rows_of(model: Any, data: Any) -> FrictionRows:
    """The friction that touches, after an evaluation of the forces, except on moving surfaces: their force is known."""
    kinds = int(mujoco.mjtConstraint.mjCNSTR_FRICTION_DOF), int(mujoco.mjtConstraint.mjCNSTR_FRICTION_TENDON)
    lossy = np.flatnonzero(np.isin(data.efc_type, kinds) & (data.efc_frictionloss > 0))
    losses = len(lossy)
    pyramids = model.opt.cone == mujoco.mjtCone.mjCONE_PYRAMIDAL
    contact, most = data.contact, MOST_ROWS
    tangents = contact.dim - 1
    loaded = (contact.efc_address >= 0) & (tangents > 0)
    lengths = np.where(loaded, 2 * tangents if pyramids else contact.dim, 0)
    rows = np.where(loaded, contact.efc_address, 0)[:, None] + np.arange(2 * most)
    own = np.arange(2 * most) < lengths[:, None]
    rows = np.where(own, rows, 0)
    pushes = np.where(own, np.append(data.efc_force, 0.0)[rows], 0.0)
    normals = pushes.sum(axis=1) if pyramids else pushes[:, 0]
    moves = np.any(own & (np.append(data.efc_vel, 0.0)[rows] != 0), axis=1)  # a belt's friction is a known force
    rough = (np.arange(most) < tangents[:, None]) & (contact.friction > 0)
    touching = np.flatnonzero((normals > 0) & ~moves & rough.any(axis=1))
    owner, axis = np.nonzero(rough[touching])
    start, slip = contact.efc_address[touching][owner], contact.friction[touching][owner, axis]
    if pyramids:
        ends, factors = np.column_stack([start + 2 * axis, start + 2 * axis + 1]), 1 / (2 * slip)
    else:
        ends, factors = np.column_stack([start + 1 + axis, np.full(len(axis), -1)]), np.ones(len(axis))
    names = np.column_stack([np.full(data.ncon, -1), contact.geom, _occurrences(contact.geom)])[touching]
    of_losses = np.column_stack([data.efc_type[lossy], data.efc_id[lossy], np.zeros((losses, 2), dtype=int)])
    return FrictionRows(
        np.vstack([np.column_stack([lossy, np.full(losses, -1)]), ends]).astype(int),
        np.append(np.ones(losses), factors),
        np.append(data.efc_frictionloss[lossy], slip * normals[touching][owner]),
        np.append(np.arange(losses), losses + owner),
        np.append(np.zeros(losses, dtype=bool), np.full(len(touching), bool(pyramids))),
        np.append(np.full(losses, -1), touching),
        np.vstack([of_losses, names]).astype(int),
    )


def _occurrences(pairs: Int[np.ndarray, "n 2"]) -> Int[np.ndarray, " n"]:
    """How many equal pairs stand before each."""
    order = np.lexsort(pairs.T)
    new = np.any(np.diff(pairs[order], axis=0, prepend=-2), axis=1)
    found, place = np.empty(len(pairs), dtype=int), np.arange(len(pairs))
    found[order] = place - np.maximum.accumulate(np.where(new, place, 0))
    return found


def hold(
    rows: FrictionRows,
    directions: Float[np.ndarray, "rows n"],
    net: Float[np.ndarray, " n"],
    scale: Float[np.ndarray, " n"],
) -> Held:
    """The friction that balances the net force of some degrees of freedom best, and the directions it leaves free."""
    directions = directions / scale
    lengths = np.linalg.norm(directions, axis=1)
    touch = lengths > NOTHING * lengths.max(initial=0)
    if touch.sum() > MOST:
        force = np.bincount(rows.cones[touch], (lengths * rows.limits)[touch], len(rows.corners))
        touch &= force[rows.cones] > np.sort(force[rows.cones][touch])[-MOST]
    share, use = np.zeros(len(rows.corners)), np.zeros(len(rows.limits))
    if not touch.any():
        return Held(np.zeros(len(net)), use, share, np.diag(1 / scale), np.diag(1 / scale))
    directions = directions[touch]
    held, apart = _held_and_free(directions)
    which, cones = np.unique(rows.cones[touch], return_inverse=True)
    corners = rows.corners[which]
    use[touch] = least_share(held.T @ (directions.T * rows.limits[touch]), -held.T @ (net / scale), cones, corners)
    share[which] = found = shares(use[touch], cones, corners)
    _, free = _held_and_free(directions[(found < SLIDES)[cones]])
    force = scale * (directions.T @ (rows.limits * use)[touch])
    return Held(force, use, share, free / scale[:, None], apart / scale[:, None])


def _held_and_free(
    directions: Float[np.ndarray, "rows n"],
) -> tuple[Float[np.ndarray, "n held"], Float[np.ndarray, "n free"]]:
    """Orthonormal bases of the directions that rows of friction hold, and of those that they leave free."""
    size = directions.shape[1]
    if not len(directions):
        return np.zeros((size, 0)), np.eye(size)
    unit = directions / np.linalg.norm(directions, axis=1)[:, None]
    squares, basis = np.linalg.eigh(unit.T @ unit)
    holds = squares > RANK**2 * squares[-1]
    return basis[:, holds], basis[:, ~holds]

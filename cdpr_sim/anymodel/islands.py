"""Islands of a model: sets of degrees of freedom that exert forces on each other.

Kinematic trees are connected by tendons with stiffness, by actuators, and by constraints that are active at a pose:
equality constraints, limits and contacts.
"""

# pyright: reportAttributeAccessIssue=false
# mujoco ships no type stubs for its compiled modules.
from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from jaxtyping import Float, Int
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from cdpr_sim.anymodel.forces import RestForces
from cdpr_sim.anymodel.friction import jacobian


def islands_at(
    forces: RestForces, qpos: Float[np.ndarray, " nq"], dofs: Int[np.ndarray, " n"]
) -> list[Int[np.ndarray, "..."]]:
    """The islands among degrees of freedom ``dofs`` at a pose."""
    if not len(dofs):
        return []
    forces.net(qpos)
    groups = groups_of_trees(forces.model, forces.data)[forces.model.dof_treeid[dofs]]
    return [dofs[groups == group] for group in dict.fromkeys(groups.tolist())]


def groups_of_trees(model: Any, data: Any) -> Int[np.ndarray, " trees"]:
    """Number of the island that each kinematic tree belongs to."""
    one, two = [], []
    for coupled in _coupled(model, data):
        trees = np.unique(model.dof_treeid[coupled])
        one += trees[:-1].tolist()
        two += trees[1:].tolist()
    graph = coo_array((np.ones(len(one)), (one, two)), shape=(model.ntree, model.ntree))
    return connected_components(graph, directed=False)[1]


def _coupled(model: Any, data: Any) -> Iterator[np.ndarray]:
    """Degrees of freedom that one tendon, actuator or constraint acts on."""
    for row in jacobian(model, data):
        yield np.flatnonzero(row)
    springs = np.any(np.column_stack([model.tendon_stiffness, model.tendon_stiffnesspoly]), axis=1)
    for tendon in np.flatnonzero(springs):
        start, number = model.ten_J_rowadr[tendon], model.ten_J_rownnz[tendon]
        yield model.ten_J_colind[start : start + number]
    for start, number in zip(data.moment_rowadr, data.moment_rownnz, strict=True):
        yield data.moment_colind[start : start + number]


def coordinates_of(model: Any, dofs: Int[np.ndarray, " n"]) -> Int[np.ndarray, " coordinates"]:
    """The coordinates of ``qpos`` that belong to the joints of degrees of freedom."""
    ends = np.append(model.jnt_qposadr[1:], model.nq).tolist()
    spans = [np.arange(int(model.jnt_qposadr[joint]), ends[joint]) for joint in np.unique(model.dof_jntid[dofs])]
    return np.concatenate([np.zeros(0, dtype=int), *spans])

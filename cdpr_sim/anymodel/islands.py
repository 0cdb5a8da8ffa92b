"""Islands of a model: sets of degrees of freedom that exert forces on each other.

Kinematic trees are connected by tendons with stiffness, by actuators, and by constraints that are active at a pose:
equality constraints, limits and contacts.
"""

# pyright: reportAttributeAccessIssue=false
# mujoco ships no type stubs for its compiled modules.
from __future__ import annotations

from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

from cdpr_sim.anymodel.constraints import jacobian
from cdpr_sim.anymodel.forces import RestForces


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
    return connected_components(csr_array(_coupled(model, data)), directed=False)[1]


def displaced_together(model: Any, data: Any) -> list[list[tuple[int, Int[np.ndarray, "..."]]]]:
    """Sets of degrees of freedom such that no force depends on two of a set (Curtis, Powell and Reid 1974).

    Returns:
        Of each set its degrees of freedom, with those on which the force changes where it is displaced.
    """
    coupled = _coupled(model, data)
    near = coupled.astype(float) @ coupled > 0
    colours = np.full(model.ntree, -1)
    for tree in range(model.ntree):
        taken = set(colours[near[tree]].tolist())
        colours[tree] = next(colour for colour in range(model.ntree) if colour not in taken)
    dofs = [np.flatnonzero(model.dof_treeid == tree) for tree in range(model.ntree)]
    felt = [np.flatnonzero(coupled[tree][model.dof_treeid]) for tree in range(model.ntree)]
    return [
        [(int(dofs[tree][column]), felt[tree]) for tree in trees if column < len(dofs[tree])]
        for trees in (np.flatnonzero(colours == colour) for colour in range(int(colours.max(initial=-1)) + 1))
        for column in range(max(len(dofs[tree]) for tree in trees))
    ]


def _coupled(model: Any, data: Any) -> Bool[np.ndarray, "trees trees"]:
    """Whether two trees exert forces on each other, by an element that acts on both; each does on itself."""
    if not model.ntree:
        return np.zeros((0, 0), dtype=bool)
    acts = [np.logical_or.reduceat(jacobian(model, data) != 0, model.tree_dofadr, axis=1)]
    springs = np.any(np.column_stack([model.tendon_stiffness, model.tendon_stiffnesspoly]), axis=1)
    acts.append(_trees(model, model.ten_J_rownnz * springs, model.ten_J_rowadr, model.ten_J_colind))
    acts.append(_trees(model, data.moment_rownnz, data.moment_rowadr, data.moment_colind))
    every = np.vstack(acts).astype(float)
    return every.T @ every + np.eye(model.ntree) > 0


def _trees(model: Any, counts: np.ndarray, starts: np.ndarray, dofs: np.ndarray) -> Bool[np.ndarray, "rows trees"]:
    """The trees that each row of a sparse matrix acts on."""
    rows = np.repeat(np.arange(len(counts)), counts)
    places = np.arange(len(rows)) - np.repeat(np.cumsum(counts) - counts, counts) + np.repeat(starts, counts)
    found = np.zeros((len(counts), model.ntree), dtype=bool)
    found[rows, model.dof_treeid[dofs[places]]] = True
    return found


def coordinates_of(model: Any, dofs: Int[np.ndarray, " n"]) -> Int[np.ndarray, " coordinates"]:
    """The coordinates of ``qpos`` that belong to the joints of degrees of freedom."""
    ends = np.append(model.jnt_qposadr[1:], model.nq).tolist()
    spans = [np.arange(int(model.jnt_qposadr[joint]), ends[joint]) for joint in np.unique(model.dof_jntid[dofs])]
    return np.concatenate([np.zeros(0, dtype=int), *spans])

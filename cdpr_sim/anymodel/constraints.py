"""The constraints that are active at a pose: their Jacobian, what touches, and what depends on the time step."""

# pyright: reportAttributeAccessIssue=false
# mujoco ships no type stubs for its compiled modules.
from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import mujoco
import numpy as np
from jaxtyping import Float

from cdpr_sim.anymodel.names import name_of


def jacobian(model: Any, data: Any) -> Float[np.ndarray, "nefc nv"]:
    """The constraints' Jacobian, dense."""
    full = np.zeros((data.nefc, model.nv))
    if data.nefc and not mujoco.mj_isSparse(model):
        full[:] = data.efc_J.reshape(-1, model.nv)[: data.nefc]
    elif data.nefc:
        mujoco.mju_sparse2dense(full, data.efc_J, data.efc_J_rownnz, data.efc_J_rowadr, data.efc_J_colind)
    return full


def touching(model: Any, data: Any) -> Iterator[tuple[int, tuple[int, int], Float[np.ndarray, "3"]]]:
    """Contacts of geoms that are constraints: their number, the two bodies, and the force along normal and tangents."""
    six = np.zeros(6)
    for number in np.flatnonzero((data.contact.efc_address >= 0) & (data.contact.geom >= 0).all(axis=1)).tolist():
        mujoco.mj_contactForce(model, data, number, six)
        one, two = model.geom_bodyid[data.contact.geom[number]].tolist()
        yield number, (one, two), six[:3].copy()


def names_of_bodies(model: Any, bodies: tuple[int, int]) -> tuple[str, str]:
    """Of two bodies."""
    return name_of(model, "body", bodies[0]), name_of(model, "body", bodies[1])


def softened(model: Any, data: Any) -> dict[str, float]:
    """Elements whose time constant [s] is shorter than two time steps: MuJoCo's ``refsafe`` makes them softer."""
    found: dict[str, float] = {}
    if model.opt.disableflags & int(mujoco.mjtDisableBit.mjDSBL_REFSAFE):
        return found
    least, kinds = 2 * float(model.opt.timestep), mujoco.mjtConstraint
    for number, bodies, _ in touching(model, data):
        reference = float(data.contact.solref[number, 0])
        if 0 < reference < least:
            found.setdefault(f"contact of {' and '.join(names_of_bodies(model, bodies))}", reference)
    for kind, word, references in (
        (kinds.mjCNSTR_LIMIT_JOINT, "joint", model.jnt_solref),
        (kinds.mjCNSTR_LIMIT_TENDON, "tendon", model.tendon_solref_lim),
        (kinds.mjCNSTR_EQUALITY, "equality", model.eq_solref),
    ):  # fmt: skip
        for number in np.unique(data.efc_id[data.efc_type == kind]):
            if 0 < references[number, 0] < least:
                found[f"{word} {name_of(model, word, int(number))!r}"] = float(references[number, 0])
    return found

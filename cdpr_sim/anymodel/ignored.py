"""Bodies that are left out of an equilibrium: held where they are, with all that hang on them, touching nothing."""

# pyright: reportAttributeAccessIssue=false
# mujoco ships no type stubs for its compiled modules.
from __future__ import annotations

import copy
from typing import Any

import mujoco
import numpy as np
from jaxtyping import Bool, Int

from cdpr_sim.core.checks import listed, refuse_unless
from cdpr_sim.core.errors import InvalidInput, UnknownName


def names_of_ignored(model: Any, ignore: Any) -> tuple[str, ...]:
    """The names that a user gives, one or several.

    Raises:
        InvalidInput, UnknownName: not names of bodies that move.
    """
    names = (ignore,) if isinstance(ignore, str) else tuple(listed("ignore", ignore, "names of bodies"))
    ignored_bodies(model, names)
    return names


def ignored_bodies(model: Any, names: tuple[str, ...]) -> Bool[np.ndarray, " nbody"]:
    """Which bodies are left out: the named ones and their descendants."""
    out = np.zeros(model.nbody, dtype=bool)
    for name in names:
        refuse_unless(str, ignore=name)
        body = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, name)
        if body < 0:
            known = [mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_BODY, one) for one in range(1, model.nbody)]
            raise UnknownName("body", name, [one for one in known if one])
        if body == 0:
            raise InvalidInput("ignore: found the world, expected bodies that move")
        out[body] = True
    for body in range(1, model.nbody):
        out[body] |= out[model.body_parentid[body]]
    return out


def without(model: Any, names: tuple[str, ...]) -> Any:
    """A copy of the model in which the bodies left out touch nothing."""
    out = ignored_bodies(model, names)
    model = copy.copy(model)
    if out.any():
        geoms = out[model.geom_bodyid]
        model.geom_contype[geoms] = model.geom_conaffinity[geoms] = 0
        pairs = np.flatnonzero(geoms[model.pair_geom1] | geoms[model.pair_geom2])
        if len(pairs):
            raise InvalidInput("ignore: found a body with explicit contact pairs, expected one without")
    return model


def free_dofs(model: Any, names: tuple[str, ...]) -> Int[np.ndarray, " n"]:
    """The degrees of freedom of the bodies that are not left out."""
    return np.flatnonzero(~ignored_bodies(model, names)[model.dof_bodyid])

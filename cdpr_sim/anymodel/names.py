"""Names of a model's elements for messages: joints of degrees of freedom, bodies, trees."""

# pyright: reportAttributeAccessIssue=false
# mujoco ships no type stubs for its compiled modules.
from __future__ import annotations

from typing import Any

import mujoco
import numpy as np
from jaxtyping import Float, Int

SHARE = 0.3
"""A degree of freedom takes part in a direction if it moves by more than this fraction of the largest."""

MOST = 3
"""Number of names that a sentence lists."""


def name_of(model: Any, kind: str, number: int) -> str:
    """Name of an element; without one, its kind and number."""
    found = mujoco.mj_id2name(model, getattr(mujoco.mjtObj, f"mjOBJ_{kind.upper()}"), number)
    return found or f"{kind} {number}"


def joint_name(model: Any, joint: int) -> str:
    """Name of a joint; without one, the name of its body."""
    name = mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_JOINT, joint)
    return name or f"joint of {name_of(model, 'body', int(model.jnt_bodyid[joint]))}"


def joints_of(model: Any, dofs: Int[np.ndarray, " n"]) -> tuple[str, ...]:
    """Names of the joints of degrees of freedom, each once, in the order of ``dofs``."""
    return tuple(dict.fromkeys(joint_name(model, int(model.dof_jntid[dof])) for dof in dofs))


def movers(model: Any, direction: Float[np.ndarray, " nv"]) -> tuple[str, ...]:
    """Names of the joints that move most in a direction (by the roots of the masses), the largest first."""
    size = np.abs(direction) * np.sqrt(model.dof_M0)
    order = [dof for dof in np.argsort(-size) if size[dof] > SHARE * size.max(initial=0)]
    return joints_of(model, np.array(order, dtype=int))


def listed(names: tuple[str, ...]) -> str:
    """Up to ``MOST`` names in a sentence."""
    more = len(names) - MOST
    return ", ".join(names[:MOST]) + (f" and {more} more" if more > 0 else "")

"""What a model has that statics alone does not decide, refused by name; activations at rest."""

# pyright: reportAttributeAccessIssue=false
# mujoco ships no type stubs for its compiled modules.
from __future__ import annotations

from typing import Any

import mujoco
import numpy as np
from jaxtyping import Float

from cdpr_sim.anymodel.names import joint_name, name_of
from cdpr_sim.core.errors import InvalidInput

WITH_STATE = {
    int(mujoco.mjtDyn.mjDYN_PID): "the state of a PID controller",
    int(mujoco.mjtDyn.mjDYN_DCMOTOR): "the state of a DC motor",
    int(mujoco.mjtDyn.mjDYN_USER): "dynamics that a callback defines",
}
"""Dynamics of actuators whose activation at rest is not known."""


def refuse_unsupported(model: Any) -> None:
    """Raise ``InvalidInput`` for elements whose forces depend on more than pose and controls."""
    for actuator in range(model.nactuator):
        name = name_of(model, "actuator", actuator)
        if int(model.actuator_dyntype[actuator]) in WITH_STATE:
            raise _found(f"actuator {name!r} with {WITH_STATE[int(model.actuator_dyntype[actuator])]}")
        if model.actuator_plugin[actuator] >= 0 and model.actuator_actnum[actuator] > 0:
            raise _found(f"actuator {name!r} with a plugin that has a state")
        if model.actuator_delay[actuator] > 0:
            raise _found(f"actuator {name!r} with a delay")
        gain, bias = int(model.actuator_gaintype[actuator]), int(model.actuator_biastype[actuator])
        if gain == int(mujoco.mjtGain.mjGAIN_USER) or bias == int(mujoco.mjtBias.mjBIAS_USER):
            raise _found(f"actuator {name!r} with a force that a callback defines")
    for tendon in np.flatnonzero(model.tendon_plasticadr >= 0):
        raise _found(f"plastic tendon {name_of(model, 'tendon', int(tendon))!r}")
    for joint in np.flatnonzero(model.jnt_plasticadr >= 0):
        raise _found(f"plastic joint {joint_name(model, int(joint))!r}")
    for flex in np.flatnonzero(model.flex_rigid == 0):
        raise _found(f"flex {name_of(model, 'flex', int(flex))!r}")
    for plugin in np.flatnonzero(model.plugin_statenum > 0):
        raise _found(f"plugin {name_of(model, 'plugin', int(plugin))!r} with a state")
    if model.opt.enableflags & int(mujoco.mjtEnableBit.mjENBL_IPC):
        raise _found("the option ipc")


def _found(what: str) -> InvalidInput:
    return InvalidInput(f"model: found {what}, expected forces that depend on pose, controls and activations alone")


def activations_at_rest(model: Any, data: Any) -> tuple[Float[np.ndarray, " na"], tuple[str, ...]]:
    """Activations that do not change any more at the controls, and the actuators whose activation grows for ever."""
    activations, growing = np.array(data.act), []
    clamps = not model.opt.disableflags & int(mujoco.mjtDisableBit.mjDSBL_CLAMPCTRL)
    dynamics = mujoco.mjtDyn
    for actuator in range(model.nactuator):
        kind, at = int(model.actuator_dyntype[actuator]), int(model.actuator_actadr[actuator])
        if at < 0 or _disabled(model, actuator):
            continue
        at += model.actuator_actnum[actuator] - 1
        control = model.actuator_ctrladr[actuator]
        value = float(data.ctrl[control])
        if clamps and model.actuator_ctrllimited[control]:
            value = float(np.clip(value, *model.actuator_ctrlrange[control]))
        limited = bool(model.actuator_actlimited[actuator])
        if kind in (int(dynamics.mjDYN_FILTER), int(dynamics.mjDYN_FILTEREXACT), int(dynamics.mjDYN_MUSCLE)):
            if kind == int(dynamics.mjDYN_MUSCLE):
                value = float(np.clip(value, 0, 1))
            activations[at] = np.clip(value, *model.actuator_actrange[actuator]) if limited else value
        elif kind == int(dynamics.mjDYN_INTEGRATOR) and value != 0:
            if limited:
                activations[at] = model.actuator_actrange[actuator][int(value > 0)]
            else:
                growing.append(name_of(model, "actuator", actuator))
    return activations, tuple(growing)


def _disabled(model: Any, actuator: int) -> bool:
    group = int(model.actuator_group[actuator])
    return 0 <= group <= 30 and bool(model.opt.disableactuator & (1 << group))

"""Spatial tendons that push: by a spring of one length, a damper, a range, or an actuator."""

# pyright: reportAttributeAccessIssue=false
# mujoco ships no type stubs for its compiled modules.
from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import mujoco
import numpy as np

from cdpr_sim.anymodel.findings import FindingKind, ModelFinding
from cdpr_sim.anymodel.names import name_of
from cdpr_sim.anymodel.tendons import actuators_on


def pushing(model: Any) -> Iterator[ModelFinding]:
    """Findings on each spatial tendon. Fixed tendons couple joints, and may push."""
    for tendon in range(model.ntendon):
        if model.wrap_type[model.tendon_adr[tendon]] == mujoco.mjtWrap.mjWRAP_JOINT:
            continue
        element = f"tendon {name_of(model, 'tendon', tendon)!r}"
        low, high = model.tendon_lengthspring[tendon]
        spring = model.tendon_stiffness[tendon] or np.any(model.tendon_stiffnesspoly[tendon])
        if spring and low > 0 and not _disabled(model, "SPRING"):
            yield ModelFinding(
                FindingKind.SPRING_PUSHES, element, f"its spring pushes when the tendon is shorter than {low:.6g} m",
                f'springlength="0 {high:.6g}" makes it a cable, which only pulls',
            )  # fmt: skip
        if _damped(model, tendon) and not _disabled(model, "DAMPER"):
            yield ModelFinding(
                FindingKind.DAMPER_PUSHES, element,
                "its damping acts while the tendon is slack as well, and pushes while it shortens",
                'set the damping of the tendon and its actuators to 0 and damp the joints, <joint damping="...">',
            )  # fmt: skip
        if model.tendon_limited[tendon] and model.tendon_range[tendon, 0] > 0 and not _disabled(model, "LIMIT"):
            shortest, longest = model.tendon_range[tendon]
            yield ModelFinding(
                FindingKind.LIMIT_PUSHES, element, f"its range pushes when the tendon is shorter than {shortest:.6g} m",
                f'range="0 {longest:.6g}" makes it a rope, which only pulls',
            )  # fmt: skip
        for actuator in actuators_on(model, tendon):
            yield from _actuator(model, tendon, actuator)


def _disabled(model: Any, what: str) -> bool:
    return bool(model.opt.disableflags & int(getattr(mujoco.mjtDisableBit, f"mjDSBL_{what}")))


def _damped(model: Any, tendon: int) -> bool:
    on_it = actuators_on(model, tendon)
    dampers = model.tendon_damping[tendon], model.tendon_dampingpoly[tendon]
    return any(np.any(one) for one in (*dampers, model.actuator_damping[on_it], model.actuator_dampingpoly[on_it]))


def _actuator(model: Any, tendon: int, actuator: int) -> Iterator[ModelFinding]:
    low, high = force_range(model, actuator)
    if model.tendon_actfrclimited[tendon]:
        low, high = np.clip((low, high), *model.tendon_actfrcrange[tendon])
    gear = float(model.actuator_gear[model.actuator_outadr[actuator], 0])
    push, pull = (high, -low) if gear > 0 else (-low, high)
    if gear == 0 or push <= 0 or _disabled(model, "ACTUATION"):
        return
    most = f"{pull:.6g}" if 0 < pull < math.inf else "F"
    pulls = f'forcerange="-{most} 0"' if gear > 0 else f'forcerange="0 {most}"'
    how = f" with up to {push * abs(gear):.6g} N" if push < math.inf else ""
    largest = "" if most != "F" else ", with F the largest force,"
    yield ModelFinding(
        FindingKind.ACTUATOR_PUSHES, f"actuator {name_of(model, 'actuator', actuator)!r}",
        f"it can push through tendon {name_of(model, 'tendon', tendon)!r}{how}", f"{pulls}{largest} lets it only pull",
    )  # fmt: skip


def force_range(model: Any, actuator: int) -> tuple[float, float]:
    """Smallest and largest force of an actuator, before its gear; infinite where nothing bounds it."""
    gain, bias = mujoco.mjtGain(model.actuator_gaintype[actuator]), mujoco.mjtBias(model.actuator_biastype[actuator])
    low, high = -math.inf, math.inf
    muscle = mujoco.mjtDyn.mjDYN_MUSCLE
    if gain == mujoco.mjtGain.mjGAIN_MUSCLE and model.actuator_dyntype[actuator] == muscle:
        if bias in (mujoco.mjtBias.mjBIAS_MUSCLE, mujoco.mjtBias.mjBIAS_NONE):
            high = 0.0
    elif gain == mujoco.mjtGain.mjGAIN_FIXED and bias == mujoco.mjtBias.mjBIAS_NONE:
        factor = float(model.actuator_gainprm[actuator, 0])
        low, high = sorted(factor * end if factor else 0.0 for end in _inputs(model, actuator))
    if model.actuator_forcelimited[actuator]:
        low, high = np.clip((low, high), *model.actuator_forcerange[actuator])
    return float(low), float(high)


def _inputs(model: Any, actuator: int) -> tuple[float, float]:
    """Range of what the gain multiplies: the control, or the activation that follows it."""
    low, high = -math.inf, math.inf
    dynamics = mujoco.mjtDyn(model.actuator_dyntype[actuator])
    follows = (mujoco.mjtDyn.mjDYN_NONE, mujoco.mjtDyn.mjDYN_FILTER, mujoco.mjtDyn.mjDYN_FILTEREXACT)
    control = int(model.actuator_ctrladr[actuator])
    if dynamics in follows and model.actuator_ctrllimited[control] and not _disabled(model, "CLAMPCTRL"):
        low, high = model.actuator_ctrlrange[control]
    if dynamics == mujoco.mjtDyn.mjDYN_MUSCLE:
        low, high = 0.0, 1.0
    if dynamics != mujoco.mjtDyn.mjDYN_NONE and model.actuator_actlimited[actuator]:
        low, high = np.clip((low, high), *model.actuator_actrange[actuator])
    return float(low), float(high)

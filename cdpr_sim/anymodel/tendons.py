"""``tendon_tensions``: the tension of each tendon of a MuJoCo model, which no field of ``mjData`` has."""

# pyright: reportAttributeAccessIssue=false
# mujoco ships no type stubs for its compiled modules.
from __future__ import annotations

import copy
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np
from jaxtyping import Bool, Float

from cdpr_sim.core.checks import Frozen, refuse_unless
from cdpr_sim.core.errors import InvalidInput
from cdpr_sim.physics.quiet import quiet

PARTS = ("spring", "damper", "limit", "friction", "equality", "actuators")
"""What the tension of a tendon is the sum of, in the order of the table."""

ROUNDING = 1e-9
"""A tendon is slack below this fraction of the largest part of a tension, or of the model's weight if that is more."""


@dataclass(frozen=True, eq=False)
class TendonTensions(Frozen):
    """Tension of each tendon, and the parts that it is the sum of; positive pulls.

    A tension is the force along the tendon: of a spatial tendon in N; of a fixed one, a combination of joints, the
    generalised force for each unit of its length (N or N m). In each array, a row is a tendon, in the model's order.

    Attributes:
        names: of the tendons; of one without a name, its number.
        spatial: whether it runs through sites and around geoms; otherwise it is a fixed tendon.
        lengths: [m], or the unit of a fixed tendon's joints.
        total: the tension.
        spring: of its stiffness.
        damper: of its damping, and that of its actuators' transmissions.
        limit: of its ``range``; positive at the upper end, negative at the lower.
        friction: of its ``frictionloss``.
        equality: of constraints that couple tendons.
        actuators: of all actuators on it together.
        slack: whether no force acts along it.
    """

    names: tuple[str, ...]
    spatial: Bool[np.ndarray, " tendons"]
    lengths: Float[np.ndarray, " tendons"]
    total: Float[np.ndarray, " tendons"]
    spring: Float[np.ndarray, " tendons"]
    damper: Float[np.ndarray, " tendons"]
    limit: Float[np.ndarray, " tendons"]
    friction: Float[np.ndarray, " tendons"]
    equality: Float[np.ndarray, " tendons"]
    actuators: Float[np.ndarray, " tendons"]
    slack: Bool[np.ndarray, " tendons"]

    @property
    def pushes(self) -> Bool[np.ndarray, " tendons"]:
        """Which tendons push."""
        return (self.total < 0) & ~self.slack

    def __len__(self) -> int:
        return len(self.names)

    def __repr__(self) -> str:
        lines = []
        for row, name in enumerate(self.names):
            parts = ", ".join(f"{part} {values[row]:.6g}" for part in PARTS if (values := getattr(self, part))[row])
            unit = " N" if self.spatial[row] else ""
            state = "slack" if self.slack[row] else f"{self.total[row]:.6g}{unit}" + (f" ({parts})" if parts else "")
            lines.append(f"{name}: {state}{', pushes' if self.pushes[row] else ''}")
        return f"TendonTensions({'; '.join(lines)})"


def tendon_tensions(model: Any, data: Any) -> TendonTensions:
    """Tension of each tendon in a state: of its spring, damper, range, friction, couplings and actuators.

    Forward dynamics are evaluated anew on a copy, so the tensions belong to the pose, velocity and controls that
    ``data`` has now, also after ``mj_step`` and after a change of ``qpos``.

    Args:
        model: an ``mujoco.MjModel``.
        data: an ``mujoco.MjData`` of it; it is not changed.

    Returns:
        The tensions and their parts.

    Raises:
        InvalidInput: not a model and its data, or a state whose forces are not finite.
    """
    refuse_unless(mujoco.MjModel, model=model)
    refuse_unless(mujoco.MjData, data=data)
    if len(data.qpos) != model.nq or len(data.ctrl) != model.nu or len(data.ten_length) != model.ntendon:
        raise InvalidInput(
            f"data: found that of another model, with {len(data.qpos)} coordinates, {len(data.ctrl)} controls and "
            f"{len(data.ten_length)} tendons, expected {model.nq}, {model.nu} and {model.ntendon}"
        )
    same, there = copy.copy(model), copy.copy(data)
    same.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_AUTORESET)
    same.opt.enableflags &= ~int(mujoco.mjtEnableBit.mjENBL_SLEEP)
    with quiet():
        mujoco.mj_forward(same, there)
    found = tensions_in(same, there)
    if not np.isfinite(found.total).all():
        name = found.names[int(np.argmin(np.isfinite(found.total)))]
        raise InvalidInput(f"data: found forces that are not finite on tendon {name!r}, expected a finite state")
    return found


def tensions_in(model: Any, data: Any) -> TendonTensions:
    """Tensions from the forces that ``data`` has, of ``mj_forward`` or ``mj_invConstraint``, as they are."""
    at = {part: np.zeros(model.ntendon) for part in PARTS}
    for tendon in range(model.ntendon):
        at["spring"][tendon] = _spring(model, data, tendon)
        at["damper"][tendon] = _damper(model, data, tendon)
        at["limit"][tendon] = _limit(model, data, tendon)
    losses = data.efc_type == mujoco.mjtConstraint.mjCNSTR_FRICTION_TENDON
    np.subtract.at(at["friction"], data.efc_id[losses], data.efc_force[losses])
    for row in np.flatnonzero(data.efc_type == mujoco.mjtConstraint.mjCNSTR_EQUALITY):
        _add_equality(model, data, int(row), at["equality"])
    on_tendons = model.actuator_trntype == mujoco.mjtTrn.mjTRN_TENDON
    outputs = model.actuator_outadr[on_tendons]
    forces = data.actuator_force[outputs] * model.actuator_gear[outputs, 0]
    np.subtract.at(at["actuators"], model.actuator_trnid[on_tendons, 0], forces)
    total = np.sum(list(at.values()), axis=0)
    weight = float(model.body_mass.sum() * np.linalg.norm(model.opt.gravity))
    largest = max(weight, float(np.abs(list(at.values())).max(initial=0.0)))
    return TendonTensions(
        names=tuple(model.tendon(tendon).name or str(tendon) for tendon in range(model.ntendon)),
        spatial=np.array(model.wrap_type[model.tendon_adr] != mujoco.mjtWrap.mjWRAP_JOINT),
        lengths=np.array(data.ten_length),
        total=total,
        slack=np.abs(total) <= ROUNDING * largest,
        **at,
    )  # fmt: skip


def _spring(model: Any, data: Any, tendon: int) -> float:
    """x (k + k_2 x + k_3 x² ...), x the length beyond the ends of ``springlength``."""
    if model.opt.disableflags & int(mujoco.mjtDisableBit.mjDSBL_SPRING):
        return 0.0
    plastic = int(model.tendon_plasticadr[tendon])
    low, high = model.tendon_lengthspring[tendon] if plastic < 0 else data.plastic[plastic : plastic + 2]
    length = float(data.ten_length[tendon])
    beyond = max(length - high, 0.0) + min(length - low, 0.0)
    return beyond * (float(model.tendon_stiffness[tendon]) + _powers(model.tendon_stiffnesspoly[tendon], beyond))


def _damper(model: Any, data: Any, tendon: int) -> float:
    """v (c + c_2 |v| + c_3 v² ...), with the damping of the actuators on the tendon by the square of their gear."""
    if model.opt.disableflags & int(mujoco.mjtDisableBit.mjDSBL_DAMPER):
        return 0.0
    linear, powers = float(model.tendon_damping[tendon]), np.array(model.tendon_dampingpoly[tendon])
    for actuator in actuators_on(model, tendon):
        gear = float(model.actuator_gear[model.actuator_outadr[actuator], 0])
        linear += float(model.actuator_damping[actuator]) * gear**2
        powers = powers + model.actuator_dampingpoly[actuator] * gear**2
    speed = float(data.ten_velocity[tendon])
    return speed * (linear + _powers(powers, abs(speed)))


def _powers(coefficients: np.ndarray, x: float) -> float:
    return float(sum(one * x ** (power + 1) for power, one in enumerate(np.atleast_1d(coefficients))))


def _limit(model: Any, data: Any, tendon: int) -> float:
    """Forces at the ends of ``range``; MuJoCo lists the lower end first, and each only within the margin."""
    rows = (data.efc_type == mujoco.mjtConstraint.mjCNSTR_LIMIT_TENDON) & (data.efc_id == tendon)
    if not rows.any():
        return 0.0
    length, margin = float(data.ten_length[tendon]), float(model.tendon_margin[tendon])
    low, high = model.tendon_range[tendon]
    signs = [sign for sign, room in ((-1.0, length - low), (1.0, high - length)) if room < margin]
    return float(np.dot(signs, data.efc_force[rows]))


def _add_equality(model: Any, data: Any, row: int, tensions: Float[np.ndarray, " tendons"]) -> None:
    """Add a constraint's force to its tendons: L_1 = polynomial of L_2, both from their lengths in ``qpos0``."""
    constraint = int(data.efc_id[row])
    if model.eq_type[constraint] != mujoco.mjtEq.mjEQ_TENDON:
        return
    one, two, force = int(model.eq_obj1id[constraint]), int(model.eq_obj2id[constraint]), float(data.efc_force[row])
    tensions[one] -= force
    if two >= 0:
        slope = np.polynomial.Polynomial(model.eq_data[constraint, :5]).deriv()
        tensions[two] += force * float(slope(data.ten_length[two] - model.tendon_length0[two]))


def actuators_on(model: Any, tendon: int) -> list[int]:
    """Actuators whose transmission is a tendon."""
    on_it = (model.actuator_trntype == mujoco.mjtTrn.mjTRN_TENDON) & (model.actuator_trnid[:, 0] == tendon)
    return [int(actuator) for actuator in np.flatnonzero(on_it)]

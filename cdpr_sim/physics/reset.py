"""Reset of a model of ``to_mjcf`` to a pose: platform, swivels, rest lengths, controls and keyframe, in one call."""

# pyright: reportAttributeAccessIssue=false
# mujoco ships no type stubs for its compiled modules.
from __future__ import annotations

import itertools

import mujoco
import numpy as np
from jaxtyping import Float, Int
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from cdpr_sim.core.checks import checked_array, refuse_unless
from cdpr_sim.core.errors import InvalidInput
from cdpr_sim.core.pose import Pose, PoseLike
from cdpr_sim.core.robot import refuse_out_of_plane
from cdpr_sim.physics.cable import Springs
from cdpr_sim.physics.chains import SEGMENTS, expected_pulls, fixed_ends, hang, shape, straight
from cdpr_sim.physics.exits import Slides
from cdpr_sim.physics.pulleys import ENTRY, Swivels, numbered
from cdpr_sim.physics.tendons import Jacobian
from cdpr_sim.physics.winches import LEAST_SPARE, controls

LEAST_GRAVITY = 1e-100
"""[m/s²] Gravity that has a direction."""

BALANCED = 1e-9
"""Largest residual of tensions that balance the load, as a fraction of the largest load or pull."""


def reset(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    pose: PoseLike,
    *,
    rest_lengths: ArrayLike | None = None,
    pretension: float | None = None,
    prefix: str = "",
) -> None:
    """Reset ``data``, with the platform at rest at ``pose`` and its cables commanded there.

    The model is one of ``to_mjcf``, compiled from text or from a file, alone or in a scene. All else in ``data`` gets
    its initial value, as by ``mj_resetData``. Wheels face their anchors, and exits that give way are where their forces
    balance; winches get the controls, or activations, of the rest lengths, and drums their places. In a model without
    winches, springs get the rest lengths: this changes ``model``. Cables with mass hang between exit and anchor, and
    ``data.xfrc_applied`` corrects the weights of their masses ``node_1_1``, ... and ``end_1`` for the length let out,
    so that the equilibrium of the model is that of cables of these lengths. The keyframe ``commanded`` becomes this
    state. ``mj_forward`` has been called at the end.

    Args:
        model: the model.
        data: its state.
        pose: pose of the platform in the base frame: (x, y, z) [m], a six-vector [m, rad], or a ``RigidTransform``. Of
            a free joint, in the world.
        rest_lengths: unstretched cable lengths, (cables,) [m]; default: the rigid ones at ``pose``, from
            which the platform then deviates.
        pretension: instead, tension [N] of linear cables: their tensions balance the weight at ``pose``, which is then
            an equilibrium, and are as near to this value as possible.
        prefix: of the names, in a model that was attached to another one.

    Raises:
        InvalidInput: not such a model; cables with mass in a model without winches that settles; an invalid pose, or
            rest lengths out of the winches' range; pretension of nonlinear cables or of ones with mass, or none near it
            that balances the weight. ``model`` and ``data`` are then unchanged.
    """
    refuse_unless(mujoco.MjModel, model=model)
    refuse_unless(mujoco.MjData, data=data)
    refuse_unless(str, prefix=prefix)
    parts, at = _Parts(model, prefix), Pose.of(pose)
    if rest_lengths is not None and pretension is not None:
        raise InvalidInput("pretension: found one besides rest_lengths, expected one of them")
    written = model.body_quat.copy()
    state = mujoco.MjData(model)
    try:
        _place(model, state, parts, at)
        mujoco.mj_forward(model, state)
        spans = parts.spans(state)
        lengths = spans.copy()
        shared, ropes = parts.shared, spans + parts.shared
        if rest_lengths is not None:
            asked = checked_array("rest_lengths", rest_lengths, (len(parts.cables),))
            if not (asked > 0).all():
                raise InvalidInput(f"rest_lengths: found {asked.min():g} m, expected more than 0")
            ropes = asked + shared
        elif pretension is not None:
            if parts.frames:
                raise InvalidInput(
                    "pretension: found exits that give way, expected exits that do not move; use rest_lengths for these"
                )
            ropes = ropes / (1 + _strains(model, state, parts, float(checked_array("pretension", pretension, ()))))
        weights = np.zeros((model.nbody, 3))
        if len(parts.heavy):
            lengths[parts.heavy], further = parts.lay(model, state, ropes, weights)
            parts.swivels.face(model, state)
            # Their tendons have the difference from the mean tension that the written pose implies.
            ropes[parts.heavy] += further - parts.uneven[parts.heavy]
        inputs = parts.inputs(model, lengths + shared, ropes)
    except InvalidInput:
        model.body_quat[:] = written
        raise
    qpos = state.qpos.copy()
    mujoco.mj_resetData(model, data)
    data.qpos[:] = qpos
    data.xfrc_applied[:, :3] = weights
    if parts.wound:
        drums = parts.drums >= 0
        data.qpos[model.jnt_qposadr[parts.drums[drums]]] = inputs[drums]
        states = model.actuator_actadr[parts.winches]
        data.ctrl[parts.winches[states < 0]] = inputs[states < 0]
        data.act[states[states >= 0]] = inputs[states >= 0]
    else:
        parts.let_out(model, ropes)
    mujoco.mj_forward(model, data)
    if parts.frames:
        parts.balance_exits(model, data)
    key = _id(model, mujoco.mjtObj.mjOBJ_KEY, f"{prefix}commanded")
    if key >= 0:
        mujoco.mj_setKeyframe(model, data, key)


class _Parts:
    """Indices of the parts of a robot in a model, and constants of its cables, (cables,) each.

    Args:
        model: the model.
        prefix: of the names.

    Attributes:
        platform: body of the platform.
        joints: its joints.
        base: site of the base, or -1.
        anchors: sites of the anchors.
        cables: tendons.
        lines: tendons that are drawn in their place, or -1.
        winches: actuators, or -1 for cables without: all or none.
        dampers: actuators of damped cables, or -1.
        drums: joints of drums, or -1.
        swivels: the wheels.
        frames: the slides of exits that give way.
        offsets: differences between the lengths of tendons, with drums at 0, and cables [m].
        behind: lengths of rope behind the exit, for each part of line [m].
        rigid: what is rigid at the anchors [m].
        shared: c, what stretches besides the rest lengths: the first less the second [m].
        uneven: how much further cables with mass stretch than under their mean tension [m].
        direct: tendons from exit to anchor: the cables, or the chords of those with mass.
        parts_of_line: numbers of parts.
        written: (L + c), the written rest lengths with those [m].
        stiffnesses: n EA [N].
        radii: of the wheels, 0 without [m].
        heavy: indices of the cables with mass; what follows is of these.
        nodes: bodies of their masses, from exit to anchor.
        ends: bodies of the masses at the anchors.
        exits: sites.
        segments: tendons from exit to anchor.
        pulleys: bodies of the wheels, or -1.

    Raises:
        InvalidInput: not a model of ``to_mjcf``, or one with chains of springs.
    """

    def __init__(self, model: mujoco.MjModel, prefix: str) -> None:
        kinds = mujoco.mjtObj
        self.platform = _id(model, kinds.mjOBJ_BODY, f"{prefix}platform")
        count = next(i for i in itertools.count() if _id(model, kinds.mjOBJ_SITE, f"{prefix}exit_{i + 1}") < 0)
        if self.platform < 0 or not count:
            raise InvalidInput(
                f"model: found no body '{prefix}platform' with cables, expected a model of to_mjcf and the prefix of "
                "its names"
            )

        def ids(kind: mujoco.mjtObj, name: str) -> Int[np.ndarray, " cables"]:
            return numbered(model, kind, prefix + name, count)

        self.cables, self.winches = ids(kinds.mjOBJ_TENDON, "cable_{}"), ids(kinds.mjOBJ_ACTUATOR, "winch_{}")
        if (self.cables < 0).any():
            raise InvalidInput(
                f"model: found no tendon '{prefix}cable_{np.argmax(self.cables < 0) + 1}', expected massless cables, "
                "or those with mass in a model with winches or with a damping other than 'settle'"
            )
        self.frames = Slides.of(model, count, prefix)
        first = int(model.body_jntadr[self.platform])
        self.joints = list(range(first, first + int(model.body_jntnum[self.platform])))
        self.base = _id(model, kinds.mjOBJ_SITE, f"{prefix}base")
        self.anchors = ids(kinds.mjOBJ_SITE, "anchor_{}")
        self.lines = np.maximum(ids(kinds.mjOBJ_TENDON, "line_{}"), ids(kinds.mjOBJ_TENDON, "rope_{}"))
        self.dampers, self.drums = ids(kinds.mjOBJ_ACTUATOR, "damped_{}"), ids(kinds.mjOBJ_JOINT, "drum_{}")
        exits, chords = ids(kinds.mjOBJ_SITE, "exit_{}"), ids(kinds.mjOBJ_TENDON, "chord_{}")
        self.swivels = Swivels.of(model, exits, prefix)
        radii = np.zeros(count)
        radii[self.swivels.cables] = self.swivels.radii
        self.offsets, coiled = ENTRY * radii, np.flatnonzero(self.drums >= 0)
        coils = model.body_pos[model.jnt_bodyid[self.drums[coiled]]] - model.site_pos[exits[coiled]]
        self.offsets[coiled] = np.linalg.norm(coils, axis=1)
        user = np.zeros((count, 4))
        user[:, : min(4, model.nuser_tendon)] = model.tendon_user[self.cables, :4]
        self.parts_of_line, self.behind, self.uneven, self.rigid = np.maximum(user[:, 0], 1), *user[:, 1:].T
        self.shared = self.behind - self.rigid
        acting = np.where(self.winches >= 0, self.winches, self.dampers)
        linear = (acting >= 0) & (self.drums < 0)
        bias = model.actuator_biasprm[acting] if model.nu else np.zeros((count, 2))
        springs = np.where(linear, -bias[:, 1], model.tendon_stiffness[self.cables])
        begin = np.where(linear, -bias[:, 0] / springs, model.tendon_lengthspring[self.cables, 1])
        self.written = begin - (self.offsets - self.shared + self.uneven)
        self.stiffnesses = springs * self.written
        self.direct, heavy = np.where(chords >= 0, chords, self.cables), np.flatnonzero(chords >= 0)
        self.heavy, self.radii = heavy, radii
        self.nodes = np.array([ids(kinds.mjOBJ_BODY, f"node_{{}}_{k}")[heavy] for k in range(1, SEGMENTS)]).T
        self.ends, self.exits = ids(kinds.mjOBJ_BODY, "end_{}")[heavy], exits[heavy]
        self.segments = np.array([ids(kinds.mjOBJ_TENDON, f"cable_{{}}_{k}")[heavy] for k in range(1, SEGMENTS + 1)]).T
        self.pulleys = ids(kinds.mjOBJ_BODY, "pulley_{}")[heavy]

    @property
    def wound(self) -> bool:
        """Whether the model has winches."""
        return bool((self.winches >= 0).all())

    def spans(self, data: mujoco.MjData) -> Float[np.ndarray, " cables"]:
        """Lengths of the cables from exit to anchor, with all drums at 0 [m]."""
        coils = np.zeros_like(self.offsets)
        coils[self.heavy] = (self.offsets - ENTRY * self.radii)[self.heavy]  # no chord begins at a drum
        return data.ten_length[self.direct] - (self.offsets - coils)

    def inputs(
        self, model: mujoco.MjModel, lengths: Float[np.ndarray, " cables"], ropes: Float[np.ndarray, " cables"]
    ) -> Float[np.ndarray, " cables"]:
        """Controls or activations at which the winches let out l0, as ``ropes`` = l0 + c, at ``lengths`` = l + c [m].

        Raises:
            InvalidInput: a length out of their range.
        """
        if not self.wound:
            return np.zeros(len(ropes))
        by_speed = model.actuator_dyntype[self.winches] == mujoco.mjtDyn.mjDYN_INTEGRATOR
        units = np.where(self.drums >= 0, lengths, np.where(by_speed, self.written, 1.0))
        inputs = units * controls(self.written, ropes)
        ranges = np.where(
            by_speed[:, None], model.actuator_actrange[self.winches], model.actuator_ctrlrange[self.winches]
        )
        margin = BALANCED * np.abs(ranges).max(1)
        beyond = (inputs < ranges[:, 0] - margin) | (inputs > ranges[:, 1] + margin)
        if beyond.any():
            cable = int(np.argmax(beyond))
            longest, shortest = self.written[cable] / (1 + ranges[cable] / units[cable]) - self.shared[cable]
            raise InvalidInput(
                f"rest_lengths: found {ropes[cable] - self.shared[cable]:.4g} m for cable {cable + 1}, expected "
                f"{shortest:.4g} to {longest:.4g} m, which its winch can let out"
            )
        return inputs

    def balance_exits(self, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        """Move exits that give way to where their forces balance."""

        def forces() -> Float[np.ndarray, "1 dofs"]:
            self.swivels.face(model, data, anchors=True)
            mujoco.mj_forward(model, data)
            return (data.qfrc_spring + data.qfrc_actuator)[None]

        self.frames.settle(data.qpos[None], np.zeros(1, int), np.array([self.written.mean()]), forces)
        forces()

    def let_out(self, model: mujoco.MjModel, ropes: Float[np.ndarray, " cables"]) -> None:
        """Give a model without winches these rest lengths, as l0 + c [m]."""
        ratio, damped = self.written / ropes, self.dampers >= 0
        cables, dampers = self.cables[~damped], self.dampers[damped]
        lengths = ropes - self.shared
        model.tendon_lengthspring[cables, 1] = (lengths + self.offsets + self.uneven)[~damped]
        model.tendon_stiffness[cables] *= ratio[~damped]
        model.tendon_stiffnesspoly[cables] *= ratio[~damped, None] ** np.array([2, 3])
        slopes = (self.stiffnesses / ropes)[damped]
        offsets = (self.offsets - self.shared + self.uneven)[damped]
        model.actuator_biasprm[dampers, 0] = -(self.stiffnesses[damped] + slopes * offsets)
        model.actuator_biasprm[dampers, 1] = -slopes
        model.actuator_biasprm[dampers, 2] *= np.sqrt(ratio[damped])  # the same loss factor
        drawn = self.lines >= 0
        model.tendon_lengthspring[self.lines[drawn], 1] = (1 + LEAST_SPARE) * lengths[drawn]

    def lay(
        self,
        model: mujoco.MjModel,
        data: mujoco.MjData,
        ropes: Float[np.ndarray, " cables"],
        weights: Float[np.ndarray, "bodies 3"],
    ) -> tuple[Float[np.ndarray, " chains"], Float[np.ndarray, " chains"]]:
        """Place the masses as the cables with mass hang with l0, as ``ropes`` = l0 + c [m].

        Sets the ``weights`` [N] by which masses weigh more than in the model.

        Returns:
            Stretched lengths [m], and ``chains.uneven`` here [m].
        """
        cables, behind, radii = self.heavy, self.behind[self.heavy], self.radii[self.heavy]
        rigid = self.rigid[cables]
        lengths = model.tendon_lengthspring[self.segments, 1].copy()
        lengths[:, 0] -= ENTRY * radii
        lengths[:, -1] -= rigid
        fractions = straight(fixed_ends((behind > 0) | (radii > 0), rigid > 0)).lengths
        beyond = lengths[:, 1:].sum(1) / (1 - fractions[:, 0])
        wrapped = lengths[:, 0] - fractions[:, 0] * beyond
        scale = (ropes[cables] - behind - wrapped) / beyond
        if not (scale > 0).all():
            cable = int(np.argmin(scale))
            raise InvalidInput(
                f"rest_lengths: found {(ropes - self.shared)[cables][cable]:.4g} m for cable {cables[cable] + 1}, "
                f"expected more than {wrapped[cable] + rigid[cable]:.4g} m, which lie on its wheel or are rigid"
            )
        rest = fractions * (beyond * scale)[:, None]
        rest[:, 0] += wrapped
        rest[:, -1] += rigid
        stretching = fractions * ropes[cables, None]  # in proportion, also for what lies on the wheel and behind
        ratio = self.written[cables, None] / stretching
        further = np.moveaxis(model.tendon_stiffnesspoly[self.cables[cables]], -1, 0)[..., None]
        springs = Springs(self.stiffnesses[cables, None] / stretching, further[0] * ratio**2, further[1] * ratio**3)
        bodies = np.concatenate([self.nodes, self.ends[:, None]], axis=1)
        written = model.body_mass[bodies][..., None] * model.opt.gravity
        added = written * (scale - 1)[:, None, None]
        weights[bodies] = added
        rotation = data.xmat[self.platform].reshape(3, 3)
        spans = data.site_xpos[self.exits] - data.xpos[self.ends]
        axes = data.xmat[self.pulleys].reshape(-1, 3, 3)[:, :, 2]
        strains = (data.ten_length[self.direct[cables]] - ENTRY * radii) / rest.sum(1) - 1
        whole, stiffness = (written + added).sum(1), self.stiffnesses[cables]
        guess = expected_pulls(spans, strains, stiffness, whole)
        found, reached = hang(written + added, rest, springs, radii, axes, guess, spans)
        folded = ~reached  # near where they hang
        found[folded] = shape(-spans[folded], 0 * spans[folded], rest[folded].sum(1), fractions[folded, ::-1])[:, :-1]
        slides = model.body_jntadr[self.nodes[:, ::-1]][..., None] + np.arange(3)
        data.qpos[model.jnt_qposadr[slides]] = found @ rotation
        mujoco.mj_forward(model, data)
        per_length = np.linalg.norm(whole, axis=1) / (beyond * scale)
        rise = -spans @ model.opt.gravity / max(float(np.linalg.norm(model.opt.gravity)), LEAST_GRAVITY)
        further = (wrapped + behind) * per_length * rise / 2 / stiffness
        return data.ten_length[self.segments].sum(1) - ENTRY * radii, further


def _id(model: mujoco.MjModel, kind: mujoco.mjtObj, name: str) -> int:
    return mujoco.mj_name2id(model, kind.value, name)


def _place(model: mujoco.MjModel, data: mujoco.MjData, parts: _Parts, at: Pose) -> None:
    """Put the platform at a pose, its wheels facing the anchors.

    Raises:
        InvalidInput: out of a planar robot's plane, or an anchor off its wheel.
    """
    adr, kinds = model.jnt_qposadr[parts.joints], model.jnt_type[parts.joints]
    position, rotation = at.position, Rotation.from_matrix(at.rotation_matrix)
    if len(kinds) == 1:
        data.qpos[adr[0] : adr[0] + 7] = [*position, *rotation.as_quat(scalar_first=True)]
    elif kinds[-1] == mujoco.mjtJoint.mjJNT_BALL:
        data.qpos[adr[:3]] = position
        base = model.site_quat[parts.base] if parts.base >= 0 else [1, 0, 0, 0]
        frame, body = (Rotation.from_quat(quat, scalar_first=True) for quat in (base, model.body_quat[parts.platform]))
        data.qpos[adr[3] : adr[3] + 4] = (body.inv() * frame * rotation).as_quat(scalar_first=True)
    else:
        refuse_out_of_plane(at, "the robot")
        data.qpos[adr] = position[0], position[2], np.arctan2(-at.rotation_matrix[2, 0], at.rotation_matrix[0, 0])
    if len(parts.swivels):
        parts.swivels.face(model, data, anchors=True)
        mujoco.mj_forward(model, data)
        points = data.ten_wrapnum[parts.direct[parts.swivels.cables]]
        off = parts.swivels.off_wheel(data.xpos, data.xmat, data.site_xpos, points)
        if off.any():
            raise InvalidInput(
                f"pose: found one at which cable {parts.swivels.cables[np.argmax(off)] + 1} is off its pulley, "
                "expected its anchor beyond the wheel"
            )


def _strains(
    model: mujoco.MjModel, data: mujoco.MjData, parts: _Parts, pretension: float
) -> Float[np.ndarray, " cables"]:
    """Strains of linear cables whose tensions balance the weight, p - W⁺ (W p + w), by MuJoCo's Jacobian and load.

    Raises:
        InvalidInput: nonlinear cables, a negative pretension, or none near it that balances.
    """
    if pretension < 0:
        raise InvalidInput(f"pretension: found {pretension:g} N, expected 0 or more")
    if len(parts.heavy):
        raise InvalidInput("pretension: found cables with mass, expected massless ones; use rest_lengths for these")
    if model.tendon_stiffnesspoly[parts.cables].any():
        raise InvalidInput("pretension: found nonlinear cables, expected linear ones; use rest_lengths for these")
    first = int(model.body_dofadr[parts.platform])
    dofs = np.arange(first, first + int(model.body_dofnum[parts.platform]))
    matrix = -Jacobian(model).of(data.ten_J)[parts.cables][:, dofs].T * parts.parts_of_line
    load = -data.qfrc_bias[dofs].copy()
    turning = slice(3, 6) if len(dofs) == 6 else slice(2, 3)
    arm = np.linalg.norm(model.site_pos[parts.anchors], axis=1).max()
    matrix[turning], load[turning] = matrix[turning] / arm, load[turning] / arm
    wanted = np.full(len(parts.cables), pretension)
    tensions = wanted - np.linalg.pinv(matrix) @ (matrix @ wanted + load)
    scale = max(float(np.abs(load).max()), float(np.abs(tensions).max()))
    if np.abs(matrix @ tensions + load).max() > BALANCED * scale or tensions.min() < -BALANCED * scale:
        raise InvalidInput(
            f"pretension: found no tensions near {pretension:g} N that balance the weight at the pose, expected a "
            "value and a pose for which all cables pull"
        )
    return np.maximum(tensions, 0) * parts.parts_of_line / parts.stiffnesses

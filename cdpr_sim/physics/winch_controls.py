"""Controls of a model's winches from rest lengths."""

from __future__ import annotations

import functools

import numpy as np
from jaxtyping import Float
from numpy.typing import ArrayLike

from cdpr_sim.core.checks import checked_array, frozen, refuse_unless
from cdpr_sim.core.errors import InvalidInput
from cdpr_sim.core.pose import Pose, PoseLike
from cdpr_sim.core.problem import Problem
from cdpr_sim.core.robot import Robot
from cdpr_sim.physics.cable import Law
from cdpr_sim.physics.settle import settle
from cdpr_sim.physics.winches import SERVO, controls, reach


def winch_controls(robot: Robot, pose: PoseLike, rest_lengths: ArrayLike) -> Float[np.ndarray, "*rows cables"]:
    """Controls with which the winches of ``to_mjcf(robot, pose, winches=True)`` let out ``rest_lengths``.

    Args:
        robot: the robot.
        pose: pose at which its model is written, where all controls are 0.
        rest_lengths: unstretched cable lengths l0, (..., cables) [m].

    Returns:
        ``ctrl`` of the actuators ``winch_1``, ..., (..., cables), u = (L + c)/(l0 + c) - 1 with L the rigid lengths at
        ``pose`` and c = ``winch_to_exit``/``reeving``. For nonlinear cables (l + c) u [m], with l their length at the
        equilibrium in MuJoCo from ``pose``.

    Raises:
        InvalidInput: invalid lengths, or lengths out of the winches' range; cables with a memory.
        NotSettled: cables are nonlinear, and the platform does not come to rest on them.
    """
    refuse_unless(Robot, robot=robot)
    at = Pose.of(pose)
    rigid, lowest, highest = _written(robot, at.position.tobytes(), at.rotation_matrix.tobytes())
    wanted = checked_array("rest_lengths", rest_lengths, None)
    if wanted.shape[-1:] != (robot.cables,):
        raise InvalidInput(f"rest_lengths: found an array of shape {wanted.shape}, expected (..., {robot.cables})")
    possible = (wanted >= lowest) & (wanted <= highest)
    if not possible.all():
        *_, cable = place = tuple(np.argwhere(~possible)[0])
        raise InvalidInput(
            f"rest_lengths: found {wanted[place]:g} m for cable {cable + 1}, expected {lowest[cable]:.4g} to "
            f"{highest[cable]:.4g} m, which its winch can let out"
        )
    law = Law.of(robot.cabling)
    extra = law.added
    found = controls(rigid + extra, wanted + extra)
    if not robot.cabling.linear:
        nonlinear = robot.cabling.nonlinear
        servos = SERVO * law.springs(rigid).stiffness
        for row in np.ndindex(wanted.shape[:-1]):
            rest = settle(robot, pose, wanted[row])
            lengths = rest.lengths + extra
            for cable in np.flatnonzero(nonlinear & (robot.cabling.with_mass)):
                # Of a cable with mass, ``lengths`` has the chord. Its tension grows along it by the weight below: the
                # mean is that at half the height.
                rise = robot.exits[cable, 2] - rest.pose.apply(robot.anchors[cable])[2]
                pull = rest.pulls[[cable]] + robot.cable_weights[cable] * rise / 2
                strain = law.some([cable]).strained.stretched(pull)[0][0]
                lengths[cable] = (wanted[row][cable] + extra[cable]) * (1 + strain)
            drawn_in = lengths * found[row] + rest.pulls / servos  # plus the servos' displacement
            found[row][nonlinear] = drawn_in[nonlinear]
    return found


@functools.lru_cache(maxsize=16)
def _written(robot: Robot, position: bytes, rotation: bytes) -> Float[np.ndarray, "3 cables"]:
    """Rest lengths that winches of ``to_mjcf(robot, pose, winches=True)`` let out: at control 0, at least, at most [m].

    Cached, since a control loop asks for those of one model.
    """
    at = Pose(np.frombuffer(position), np.frombuffer(rotation).reshape(3, 3))
    rigid = Problem.of(robot, at).rest_lengths
    robot.cabling.refuse_memory()
    return frozen(np.array([rigid, *reach(robot, rigid)]))

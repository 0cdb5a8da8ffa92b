"""Winches in MuJoCo: what winds the cables of a model, so that ``ctrl`` drives it.

The actuator ``winch_1`` is the whole of cable 1, whose tendon then has no spring of its own. With L the rest length
that belongs to control 0 and u the control, the rest length is l0 = L/(1 + u): a positive control winds in. The tension

    tau = EA/l0 (l - l0) = (EA/L) l (1 + u) - EA   for l > l0,  else 0          (paper Eq. 10, 11)

is bilinear in l and u, which is what MuJoCo's affine gain and bias are. ``forcerange`` begins at 0, so that no cable
pushes; ``gear`` -1 counts tension as a positive force. The stiffness is EA/l0, as it has to be: a shorter cable is a
stiffer one. A cable over a pulley has a tendon that is longer by its straight entry; the constants account for that.
"""

# pyright: reportAttributeAccessIssue=false
# mujoco ships no type stubs for its compiled modules.
from __future__ import annotations

import xml.etree.ElementTree as ET

import mujoco
import numpy as np
from jaxtyping import Float
from numpy.typing import ArrayLike

from cdpr_sim.core.checks import checked_array
from cdpr_sim.core.errors import InvalidInput
from cdpr_sim.core.pose import PoseLike
from cdpr_sim.core.problem import Problem
from cdpr_sim.core.robot import Robot
from cdpr_sim.physics import pulleys
from cdpr_sim.physics.numbers import text

DAMPING = 1e-4
"""[s] A cable's resistance to stretching, as a multiple of its stiffness: quick to calm down, and too little to narrow
the time steps of integrators that treat it explicitly."""

NO_LIMIT = 1e12
"""Strain at which an actuator's force would be cut off: none. MuJoCo has no range that is open at one end only; a lower
limit would keep a motion that has become unstable bounded, so that MuJoCo would not say so."""

SPARE = 0.2
"""By how much winches can pay out and wind in beyond what a level platform needs in its workspace: for one that is
tilted, and more than cables stretch."""

HIDDEN = 4
"""Group of what viewers do not show unless they are asked to."""

SHORTEST = 0.02
"""Of a winch's range, as a fraction of its longest, where the workspace reaches to the exit."""


def winch_controls(robot: Robot, pose: PoseLike, rest_lengths: ArrayLike) -> Float[np.ndarray, "*rows cables"]:
    """Controls with which the winches of ``to_mjcf(robot, pose, winches=True)`` let out ``rest_lengths``.

    Args:
        robot: the robot.
        pose: at which its model is written, where all controls are 0.
        rest_lengths: unstretched cable lengths l0, (..., cables) [m].

    Returns:
        ``ctrl`` of the actuators ``winch_1``, ..., (..., cables): L/l0 - 1 with L the rigid lengths at ``pose``.

    Raises:
        InvalidInput: lengths that cannot be right, or that are out of the winches' range.
    """
    problem = Problem.of(robot, pose)
    wanted = checked_array("rest_lengths", rest_lengths, None)
    if wanted.shape[-1:] != (robot.cables,):
        raise InvalidInput(f"rest_lengths: found an array of shape {wanted.shape}, expected (..., {robot.cables})")
    lowest, highest = reach(robot)
    lowest, highest = np.minimum(lowest, problem.rest_lengths), np.maximum(highest, problem.rest_lengths)
    wrong = ~((wanted >= lowest) & (wanted <= highest))
    if wrong.any():
        *_, cable = place = tuple(np.argwhere(wrong)[0])
        raise InvalidInput(
            f"rest_lengths: found {wanted[place]:g} m for cable {cable + 1}, expected {lowest[cable]:.4g} to "
            f"{highest[cable]:.4g} m, which its winch can let out"
        )
    return problem.rest_lengths / wanted - 1


def reach(robot: Robot) -> tuple[Float[np.ndarray, " cables"], Float[np.ndarray, " cables"]]:
    """Shortest and longest rest length that each winch can let out [m]: what the workspace needs, and some more."""
    lower, upper = robot.workspace
    ends = robot.exits - robot.anchors  # where the platform's origin would have to be, level, for a length of zero
    nearest = np.linalg.norm(ends - np.clip(ends, lower, upper), axis=1)
    furthest = np.linalg.norm(np.maximum(np.abs(ends - lower), np.abs(ends - upper)), axis=1)
    longest = (1 + SPARE) * (furthest + 2 * np.pi * robot.cabling.pulley_radius)
    return np.maximum((1 - SPARE) * nearest, SHORTEST * longest), longest


def add_winches(root: ET.Element, world: ET.Element, robot: Robot, rest_lengths: Float[np.ndarray, " cables"]) -> None:
    """The actuators ``winch_1``, ..., which with a control of 0 let out ``rest_lengths`` [m]; and what is measured."""
    if not robot.cabling.linear:
        raise InvalidInput("stiffening: found cables whose law is not linear, expected linear ones for winches")
    actuators, sensors = ET.SubElement(root, "actuator"), ET.SubElement(root, "sensor")
    lowest, highest = reach(robot)
    for cable, (stiffness, length) in enumerate(zip(robot.axial_stiffness, rest_lengths, strict=True)):
        slope, entry = stiffness / length, pulleys.entries(robot.cabling)[cable]
        winch = ET.SubElement(actuators, "general", name=f"winch_{cable + 1}", tendon=f"cable_{cable + 1}", gear="-1")
        winch.set("gaintype", "affine")
        winch.set("gainprm", text([-slope * entry, -slope, 0]))
        winch.set("biastype", "affine")
        winch.set("biasprm", text([-stiffness - slope * entry, -slope, -DAMPING * slope]))
        winch.set("forcerange", text([0, NO_LIMIT * stiffness]))
        winch.set("ctrlrange", text([min(length / highest[cable] - 1, 0), max(length / lowest[cable] - 1, 0)]))
        ET.SubElement(sensors, "actuatorfrc", name=f"tension_{cable + 1}", actuator=f"winch_{cable + 1}")
    ET.SubElement(world, "site", name="base", group="4")
    for kind, name in (("framepos", "position"), ("framequat", "orientation")):
        sensor = ET.SubElement(sensors, kind, name=name, objtype="xbody", objname="platform")
        sensor.set("reftype", "site")
        sensor.set("refname", "base")


def hang(model: mujoco.MjModel, data: mujoco.MjData) -> None:
    """Let MuJoCo draw slack cables as hanging chains and taut ones as lines; to be called before each picture.

    MuJoCo draws no tendon with an actuator as a chain. So each cable has a twin ``rope_1`` that does nothing: it is
    made as long as the cable now is, and takes its place in the picture where the cable is slack. Cables over pulleys
    have none: they are drawn taut, as in models without winches.
    """
    for winch in range(model.nu):
        prefix, _, i = model.actuator(winch).name.partition("winch_")
        rope = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_TENDON, f"{prefix}rope_{i}")
        if rope < 0:
            continue
        control = np.clip(data.ctrl[winch], *model.actuator_ctrlrange[winch])
        gain, bias = model.actuator_gainprm[winch], model.actuator_biasprm[winch]
        rest_length = (gain[0] * control + bias[0]) / (gain[1] * control + bias[1])  # where the law begins to pull
        cable = model.actuator_trnid[winch, 0]
        slack = data.ten_length[cable] < rest_length
        model.tendon_lengthspring[rope, 1] = rest_length
        model.tendon_group[cable], model.tendon_group[rope] = (HIDDEN, 0) if slack else (0, HIDDEN)

"""Winches in MuJoCo: actuators that wind the cables of a model by ``ctrl``.

The actuator ``winch_1`` replaces the spring of cable 1's tendon. With L the rest length at control 0 and u the
control, the rest length is l0 = L/(1 + u): a positive control winds in. The tension

    tau = EA/l0 (l - l0) = (EA/L) l (1 + u) - EA   for l > l0,  else 0          (paper Eq. 10, 11)

is bilinear in l and u, like MuJoCo's affine gain and bias. ``forcerange`` begins at 0, so that no cable
pushes; ``gear`` -1 makes tension a positive force. The stiffness is EA/l0, as required: a shorter cable is a
stiffer one. The tendon of a cable over a pulley is longer by its straight entry; the constants account for that.

A rope with n parts of line and a length g between winch and exit has the strain (l - l0)/(l0 + c) with c = g/n
(``shared``): the same formulas hold with l + c, l0 + c and L + c in the place of l, l0 and L. The actuator's force is
the pull of all parts, n tau, and EA in it n EA.

A nonlinear cable keeps its spring, since no actuator in MuJoCo is more than linear in length. Its tendon begins
at a drum, a body ``drum_1`` on a slide behind the exit, which the actuator moves: its control q is a length [m], by
which the cable is drawn in behind the exit. The tension is then the law's at the strain (l + q)/L - 1, which equals
the required l/l0 - 1 for q = l (L/l0 - 1), likewise with c. That depends on l; ``winch_controls`` uses its value at
the equilibrium. In
motions about that equilibrium the cable is as stiff as one of length L, and its tension sensor includes the drum's
inertia.
"""

# pyright: reportAttributeAccessIssue=false
# mujoco ships no type stubs for its compiled modules.
from __future__ import annotations

import xml.etree.ElementTree as ET

import mujoco
import numpy as np
from jaxtyping import Float

from cdpr_sim.core.robot import Robot
from cdpr_sim.physics import pulleys
from cdpr_sim.physics.number_format import text

DAMPING = 1e-4
"""[s] A cable's resistance to stretching, as a multiple of its stiffness: large enough to damp oscillations, and too
small to reduce the time steps of integrators that treat it explicitly."""

NO_LIMIT = 1e12
"""Strain of an actuator's largest force: beyond any motion. MuJoCo has no range that is open at one end only; a lower
limit would keep an unstable motion bounded, so that MuJoCo would not report it."""

SPARE = 0.2
"""Range of winches beyond the lengths of a level platform in its workspace, as a fraction: for a tilted platform, and
more than the stretch of cables."""

SERVO = 1e6
"""Stiffness of the servo that holds a drum, as a multiple of the cable's: the drum moves by a millionth of the cable's
stretch."""

DRUM_SWING = 500.0
"""[rad/s] Bandwidth of a drum's servo, critically damped; the drum's inertia follows from it."""

LEAST_SPARE = 1e-9
"""Fraction by which a cable's length exceeds its span, to be drawn hanging. MuJoCo 4.0 draws
nothing at all where it exceeds it by nothing up to 1e-12 (the points of its chain are nan)."""

HIDDEN = 4
"""Group of elements that viewers hide by default."""

SHORTEST = 0.02
"""Shortest length of a winch's range, as a fraction of its longest, where the workspace reaches to the exit."""


def reach(robot: Robot) -> tuple[Float[np.ndarray, " cables"], Float[np.ndarray, " cables"]]:
    """Shortest and longest rest length that each winch can let out [m]: those of the workspace, and some more."""
    lower, upper = robot.workspace
    ends = robot.exits - robot.anchors  # the origin of a level platform for which a length is zero
    nearest = np.linalg.norm(ends - np.clip(ends, lower, upper), axis=1)
    furthest = np.linalg.norm(np.maximum(np.abs(ends - lower), np.abs(ends - upper)), axis=1)
    longest = (1 + SPARE) * (furthest + 2 * np.pi * robot.cabling.pulley_radius)
    return np.maximum((1 - SPARE) * nearest, SHORTEST * longest), longest


def shared(robot: Robot) -> Float[np.ndarray, " cables"]:
    """Length of rope between winch and exit, for each part of line [m]: it stretches with the cable."""
    return robot.winch_to_exit / robot.reeving


def behind(robot: Robot) -> Float[np.ndarray, " cables"]:
    """Difference between the length of each tendon and its cable at control 0 [m]: the part behind the exit."""
    _, longest = reach(robot)
    return pulleys.entries(robot.cabling) + np.where(robot.cabling.stiffening.any(1), longest, 0)


def add_drums(world: ET.Element, robot: Robot, springs: Float[np.ndarray, " cables"]) -> None:
    """The bodies ``drum_1``, ... of nonlinear cables, on slides along which the cables arrive; the last joints.

    ``springs`` are the stiffnesses of the cables' tendons, from ``tendons.springs`` [N/m].
    """
    for cable in np.flatnonzero(robot.cabling.stiffening.any(1)):
        i, axis = cable + 1, robot.cabling.pulley_axis[cable]
        inertia = SERVO * springs[cable] / DRUM_SWING**2
        start = robot.exits[cable] - behind(robot)[cable] * axis
        drum = ET.SubElement(world, "body", name=f"drum_{i}", pos=text(start), gravcomp="1")
        slide = ET.SubElement(drum, "joint", name=f"drum_{i}", type="slide", axis=text(-axis))
        slide.set("armature", text(inertia))
        slide.set("damping", text(2 * DRUM_SWING * inertia))
        mass = pulleys.LIGHT * robot.mass
        ET.SubElement(drum, "inertial", pos="0 0 0", mass=text(mass), diaginertia=text([mass] * 3))
        ET.SubElement(drum, "site", {"name": f"drum_{i}", "class": "exit"})


def add_winches(
    root: ET.Element,
    world: ET.Element,
    robot: Robot,
    rest_lengths: Float[np.ndarray, " cables"],
    springs: Float[np.ndarray, " cables"],
) -> None:
    """The actuators ``winch_1``, ..., which let out ``rest_lengths`` [m] at a control of 0; and the sensors.

    ``springs`` are the stiffnesses of tendons of these rest lengths, from ``tendons.springs`` [N/m].
    """
    actuators, sensors = ET.SubElement(root, "actuator"), ET.SubElement(root, "sensor")
    bounds = np.array([np.minimum(reach(robot)[0], rest_lengths), np.maximum(reach(robot)[1], rest_lengths)])
    stiffnesses, extra = robot.reeving * robot.axial_stiffness, shared(robot)
    for cable, (stiffness, slope) in enumerate(zip(stiffnesses, springs, strict=True)):
        i, length = cable + 1, rest_lengths[cable] + extra[cable]
        shortest, longest = bounds[:, cable] + extra[cable]
        winch = ET.SubElement(actuators, "general", name=f"winch_{i}")
        if robot.cabling.stiffening[cable].any():
            winch.set("joint", f"drum_{i}")
            winch.set("gainprm", text(SERVO * slope))
            winch.set("biastype", "affine")
            winch.set("biasprm", text([0, -SERVO * slope, 0]))
            winch.set("ctrlrange", text([length - longest, length - shortest]))
        else:
            entry = pulleys.entries(robot.cabling)[cable] - extra[cable]
            winch.set("tendon", f"cable_{i}")
            winch.set("gear", "-1")
            winch.set("gaintype", "affine")
            winch.set("gainprm", text([-slope * entry, -slope, 0]))
            winch.set("biastype", "affine")
            winch.set("biasprm", text([-stiffness - slope * entry, -slope, -DAMPING * slope]))
            winch.set("forcerange", text([0, NO_LIMIT * stiffness]))
            winch.set("ctrlrange", text([length / longest - 1, length / shortest - 1]))
        ET.SubElement(sensors, "actuatorfrc", name=f"tension_{i}", actuator=f"winch_{i}")
    ET.SubElement(world, "site", name="base", group="4")
    for kind, name in (("framepos", "position"), ("framequat", "orientation")):
        sensor = ET.SubElement(sensors, kind, name=name, objtype="xbody", objname="platform")
        sensor.set("reftype", "site")
        sensor.set("refname", "base")


def hang(model: mujoco.MjModel, data: mujoco.MjData) -> None:
    """Make MuJoCo draw slack cables as hanging chains and taut ones as lines; to be called before each picture.

    MuJoCo draws no tendon with an actuator as a chain. So each cable has a twin ``rope_1`` without force: it gets the
    present length of the cable, and is drawn in its place where the cable is slack. Cables over pulleys have none: they
    are drawn taut, as in models without winches.
    """
    for winch in range(model.nu):
        prefix, _, i = model.actuator(winch).name.partition("winch_")
        rope = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_TENDON, f"{prefix}rope_{i}")
        if rope < 0:
            continue
        cable = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_TENDON, f"{prefix}cable_{i}")
        if model.actuator_trntype[winch] == mujoco.mjtTrn.mjTRN_JOINT:
            silent = model.tendon_lengthspring[cable, 1]
        else:  # where the law begins to pull
            control = np.clip(data.ctrl[winch], *model.actuator_ctrlrange[winch])
            gain, bias = model.actuator_gainprm[winch], model.actuator_biasprm[winch]
            silent = (gain[0] * control + bias[0]) / (gain[1] * control + bias[1])
        spare = silent - data.ten_length[cable]
        model.tendon_lengthspring[rope, 1] = data.ten_length[rope] + spare
        hangs = spare > LEAST_SPARE * data.ten_length[cable]
        model.tendon_group[cable], model.tendon_group[rope] = (HIDDEN, 0) if hangs else (0, HIDDEN)

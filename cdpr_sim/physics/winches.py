"""Winches in MuJoCo: actuators that wind the cables of a model by ``ctrl``.

They are of two kinds. ``ratio``: the control is L/l0 - 1, and the rest length follows it at once, however fast.
``speed``: the control is a speed, which MuJoCo integrates into the activation w (``dyntype`` integrator).

The actuator ``winch_1`` replaces the spring of cable 1's tendon. With L the rest length at control 0 and u the
control, the rest length is l0 = L/(1 + u): a positive control winds in. The tension

    tau = EA/l0 (l - l0) = (EA/L) l (1 + u) - EA   for l > l0,  else 0          (paper Eq. 10, 11)

is bilinear in l and u, like MuJoCo's affine gain and bias. ``forcerange`` begins at 0, so that no cable
pushes; ``gear`` -1 makes tension a positive force. The stiffness is EA/l0, as required: a shorter cable is a
stiffer one. The tendon of a cable over a pulley is longer by its straight entry; the constants account for that.

A winch of kind ``speed`` has u = w/L, so that l0 = L/(1 + w/L): w [m] is the length that is wound in, up to second
order in w/L. Its rope runs at the speed dw/dt (l0/L)². ``ctrlrange`` is such that no rope runs faster than
``winch_speed`` at any length in its range, and ``actrange`` is that range.

No winch pulls more than ``largest_forces``, however it is controlled: beyond, its cable pulls with that force, as with
a clutch that slips. Without this limit random controls end a simulation within 0.1 s: a control that jumps by its range
changes a rest length by half a metre at once, the linear law answers with 1e4 times the platform's weight, and within
one time step the platform turns by more than a radian (``steady_step``), so that its spin grows from step to step. With
integrators that treat springs explicitly, a cable that is suddenly short is too stiff for the time step, too.

A rope with n parts of line and a length g between winch and exit has the strain (l - l0)/(l0 + c) with c = g/n
(``cable.Law.added``): the same formulas hold with l + c, l0 + c and L + c in the place of l, l0 and L. The actuator's
force is the pull of all parts, n tau, and EA in it n EA.

A nonlinear cable keeps its spring, since no actuator in MuJoCo is more than linear in length. Its tendon begins
at a drum, a body ``drum_1`` on a slide behind the exit, which the actuator moves: its control q is a length [m], by
which the cable is drawn in behind the exit. The tension is then the law's at the strain (l + q)/L - 1, which equals
the required l/l0 - 1 for q = l (L/l0 - 1), likewise with c. That depends on l; ``winch_controls`` uses its value at
the equilibrium. In
motions about that equilibrium the cable is as stiff as one of length L, and its tension sensor includes the drum's
inertia. Its force has no limit; a winch of kind ``speed`` winds in q itself at ``winch_speed``.
"""

# pyright: reportAttributeAccessIssue=false
# mujoco ships no type stubs for its compiled modules.
from __future__ import annotations

import xml.etree.ElementTree as ET
from typing import Literal, TypeAlias, get_args

import mujoco
import numpy as np
from jaxtyping import Float
from numpy.typing import ArrayLike

from cdpr_sim.core.checks import FLAG, as_numbers, shown
from cdpr_sim.core.controller import Command
from cdpr_sim.core.errors import InvalidInput
from cdpr_sim.core.problem import Problem
from cdpr_sim.core.robot import STANDARD_GRAVITY, Robot
from cdpr_sim.physics import pulleys
from cdpr_sim.physics.cable import Law, strengths
from cdpr_sim.physics.number_format import add, add_inertia, text

Kind: TypeAlias = Literal["ratio", "speed"]
"""What the controls of winches are: L/l0 - 1, or a speed."""

WINCH_SPEED = 1.0
"""[m/s] Default of the largest rope speed: of winches of kind ``speed``, and in ``track``."""

LEAST_CAPACITY = 10.0
"""Least of the largest force where none is known, as a multiple of the platform's weight, so that cables of rubber
carry platforms."""

RELAXATION_TIME = 1e-4
"""[s] A cable's resistance to stretching, as a multiple of its stiffness: large enough to damp oscillations, and too
small to reduce the time steps of integrators that treat it explicitly."""

NO_LIMIT = 1e12
"""Strain of an actuator's largest force where it has no limit: beyond any motion. MuJoCo has no range that is open at
one end only."""

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

ROUNDING = 1e-9
"""Rounding of a length, as a fraction."""

HIDDEN = 4
"""Group of elements that viewers hide by default."""

SHORTEST = 0.02
"""Shortest length of a winch's range, as a fraction of its longest, where the workspace reaches to the exit."""


def reach(robot: Robot, written: Float[np.ndarray, " cables"] | None = None) -> Float[np.ndarray, "2 cables"]:
    """Shortest and longest rest length that each winch can let out [m]: those of the workspace, and some more.

    Also those that are ``written`` in its model [m].
    """
    lower, upper = robot.workspace
    ends = robot.exits - robot.anchors  # the origin of a level platform for which a length is zero
    nearest = np.linalg.norm(ends - np.clip(ends, lower, upper), axis=1)
    furthest = np.linalg.norm(np.maximum(np.abs(ends - lower), np.abs(ends - upper)), axis=1)
    longest = (1 + SPARE) * (furthest + pulleys.circumferences(robot.cabling))
    shortest = np.maximum((1 - SPARE) * nearest, robot.cabling.least_lengths + SHORTEST * longest)
    if written is None:
        return np.array([shortest, longest])
    return np.array([np.minimum(shortest, written), np.maximum(longest, written)])


def checked(robot: Robot, answer: Command | ArrayLike, reach: Float[np.ndarray, "2 cables"]) -> Command:
    """A controller's return value as a command that winches with this ``reach`` can carry out.

    Raises:
        InvalidInput: a command that no winch can carry out, or that is out of the range of these.
    """
    command = Command.of(answer, robot.cables)
    lengths, (lowest, highest) = command.rest_lengths, reach
    beyond = ~command.by_tension & ~((lengths >= (1 - ROUNDING) * lowest) & (lengths <= (1 + ROUNDING) * highest))
    if beyond.any():
        cable = int(np.argmax(beyond))
        raise InvalidInput(
            f"rest_lengths: found {lengths[cable]:.4g} m in cable {cable + 1}, expected {lowest[cable]:.4g} to "
            f"{highest[cable]:.4g} m, which its winch can let out"
        )
    return command


def kind_of(winches: bool | Kind) -> Kind | None:
    """The kind of winches that ``winches`` of ``to_mjcf`` selects: None without winches.

    Raises:
        InvalidInput: neither a flag nor a kind.
    """
    if isinstance(winches, FLAG):
        return "ratio" if winches else None
    if isinstance(winches, str) and winches in get_args(Kind):
        return winches
    raise InvalidInput(f"winches: found {winches!r}, expected True, False, 'ratio' or 'speed'")


def largest_forces(robot: Robot, winch_force: ArrayLike | None = None) -> Float[np.ndarray, " cables"]:
    """Largest tension of each winch's rope [N]: ``winch_force``, or what ropes and winches bear (``cable.strengths``).

    Where that is not known, at least ``LEAST_CAPACITY`` of the platform's weight.

    Raises:
        InvalidInput: not one positive number or one per cable; a limit for a nonlinear cable.
    """
    if winch_force is not None:
        forces = as_numbers("winch_force", winch_force, "one number or one per cable")
        if forces.shape not in {(), (robot.cables,)} or not (forces > 0).all():
            raise InvalidInput(
                f"winch_force: found {shown(winch_force)}, expected one positive number or one for each of the "
                f"{robot.cables} cables [N]"
            )
        forces = np.broadcast_to(forces, (robot.cables,)).copy()
        unlimited = robot.cabling.nonlinear & np.isfinite(forces)
        if unlimited.any():
            cable = int(np.argmax(unlimited))
            raise InvalidInput(
                f"winch_force: found {forces[cable]:g} N for cable {cable + 1} with nonlinear elasticity, expected an "
                "infinite one: no actuator in MuJoCo limits the force of a nonlinear spring"
            )
        return forces
    forces, known = strengths(robot.cabling)
    load = robot.mass * (robot.gravity or STANDARD_GRAVITY)
    return np.where(known, forces, np.maximum(forces, LEAST_CAPACITY * load))


def steady_step(robot: Robot, forces: Float[np.ndarray, " cables"]) -> float:
    """Time step [s] within which a cable with its largest force turns a platform at rest by at most a radian.

    MuJoCo's integrators treat gyroscopic torques explicitly: with the step 1.5 times as long, random controls make
    ``segesta`` spin faster and faster.
    """
    arms = robot.anchors - robot.center_of_mass
    moments = np.empty(3)
    mujoco.mju_eig3(moments, np.empty(9), np.empty(4), robot.inertia.ravel())
    torques = robot.cabling.pulls(forces) * np.sqrt((arms * arms).sum(1))
    return float(np.sqrt(moments.min() / max(torques.max(), np.finfo(float).tiny)))


def controls(
    written: Float[np.ndarray, "*#rows cables"], ropes: Float[np.ndarray, "*#rows cables"]
) -> Float[np.ndarray, "*rows cables"]:
    """Controls u that let out ``ropes`` = l0 + c [m], of winches that are ``written`` with L + c [m]."""
    return written / ropes - 1


def behind(robot: Robot) -> Float[np.ndarray, " cables"]:
    """Difference between the length of each tendon and its cable at control 0 [m]: the part behind the exit."""
    _, longest = reach(robot)
    return pulleys.entries(robot.cabling) + np.where(robot.cabling.nonlinear, longest, 0)


def add_drums(world: ET.Element, robot: Robot, springs: Float[np.ndarray, " cables"]) -> None:
    """The bodies ``drum_1``, ... of nonlinear cables, on slides along which the cables arrive; the last joints.

    ``springs`` are the stiffnesses of the cables' tendons, from ``cable.Law`` [N/m].
    """
    for cable in np.flatnonzero(robot.cabling.nonlinear):
        i, axis = cable + 1, pulleys.arriving(robot.cabling)[cable]
        inertia = SERVO * springs[cable] / DRUM_SWING**2
        start = robot.exits[cable] - behind(robot)[cable] * axis
        drum = add(world, "body", name=f"drum_{i}", pos=start, gravcomp=1)
        slide = {"name": f"drum_{i}", "type": "slide"}
        add(drum, "joint", slide, axis=-axis, armature=inertia, damping=2 * DRUM_SWING * inertia)
        mass = pulleys.LIGHT * robot.mass
        add_inertia(drum, mass, mass)
        add(drum, "site", {"name": f"drum_{i}", "class": "exit"})


def add_actuators(
    root: ET.Element,
    world: ET.Element,
    problem: Problem,
    springs: Float[np.ndarray, " cables"],
    *,
    uneven: Float[np.ndarray, " cables"],
    kind: Kind | None,
    forces: Float[np.ndarray, " cables"],
    speed: float,
    damping: Float[np.ndarray, " cables"],
) -> None:
    """The actuators ``winch_1``, ..., and the sensors; or the actuators ``damped_1``, ... of cables without winches.

    Those have no control: each is the spring and the damper of a cable of constant rest length. The ``damping`` of a
    tendon does not know its dead band, so that a slack cable would push. The force of an actuator is clamped as a
    whole, so that it never pushes.

    Args:
        root: the model.
        world: its world body.
        problem: the robot, with its rest lengths at a control, or an activation, of 0.
        springs: stiffnesses of tendons of these rest lengths, from ``cable.Law`` [N/m].
        uneven: by how much cables stretch further than under their mean tension, (cables,) [m].
        kind: what the controls are; None without winches.
        forces: largest tensions of the ropes, (cables,) [N]; may be infinite.
        speed: largest rope speed of the kind ``speed`` [m/s].
        damping: resistance of cables to stretching, as a multiple of their stiffness, (cables,) [s].
    """
    robot, rest_lengths = problem.robot, problem.rest_lengths
    actuators, bounds, extra = ET.SubElement(root, "actuator"), reach(robot, rest_lengths), Law.of(robot.cabling).added
    offsets = pulleys.entries(robot.cabling) - extra + uneven  # of tendons from the lengths l + c that they stretch
    if kind is None:
        for cable, law in enumerate(zip(springs, offsets, damping, strict=True)):
            _add_cable(actuators, f"damped_{cable + 1}", cable, robot, *law, 0.0, np.inf)
        return
    sensors = ET.SubElement(root, "sensor")
    for cable, slope in enumerate(springs):
        i, length = cable + 1, rest_lengths[cable] + extra[cable]
        shortest, longest = bounds[:, cable] + extra[cable]
        if robot.cabling.nonlinear[cable]:
            law = {"name": f"winch_{i}", "joint": f"drum_{i}"}
            bias = [0, -SERVO * slope, 0]
            winch = add(actuators, "general", law, gainprm=SERVO * slope, biastype="affine", biasprm=bias)
            ends, fastest = [length - longest, length - shortest], speed
        else:
            unit = 1.0 if kind == "ratio" else length  # of the input: u, or w = u L
            law = slope, offsets[cable], damping[cable]
            winch = _add_cable(actuators, f"winch_{i}", cable, robot, *law, 1 / unit, forces[cable])
            ends = unit * controls(length, bounds[::-1, cable] + extra[cable])
            fastest = speed * (length / longest) ** 2
        if kind == "ratio":
            winch.set("ctrlrange", text(ends))
        else:
            winch.set("dyntype", "integrator")
            winch.set("actrange", text(ends))
            winch.set("ctrlrange", text([-fastest, fastest]))
        add(sensors, "actuatorfrc", name=f"tension_{i}", actuator=f"winch_{i}")
    add(world, "site", name="base", group=4)
    for what, name in (("framepos", "position"), ("framequat", "orientation")):
        add(sensors, what, name=name, objtype="xbody", objname="platform", reftype="site", refname="base")


def _add_cable(
    actuators: ET.Element,
    name: str,
    cable: int,
    robot: Robot,
    slope: float,
    offset: float,
    damping: float,
    gain: float,
    force: float,
) -> ET.Element:
    """The actuator that is a linear cable: n EA (l (1 + gain u)/L - 1) + damping, and between 0 and n ``force``."""
    law = Law.of(robot.cabling)
    stiffness = law.strained.stiffness[cable]
    return add(
        actuators,
        "general",
        {"name": name, "tendon": f"cable_{cable + 1}", "gear": -1},
        gaintype="affine",
        gainprm=gain * np.array([-slope * offset, -slope, 0]),
        biastype="affine",
        biasprm=[-stiffness - slope * offset, -slope, -damping * slope],
        forcerange=[0, law.parts[cable] * force if np.isfinite(force) else NO_LIMIT * stiffness],
    )


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
            state = model.actuator_actadr[winch]
            control = data.act[state] if state >= 0 else np.clip(data.ctrl[winch], *model.actuator_ctrlrange[winch])
            gain, bias = model.actuator_gainprm[winch], model.actuator_biasprm[winch]
            silent = (gain[0] * control + bias[0]) / (gain[1] * control + bias[1])
        spare = silent - data.ten_length[cable]
        model.tendon_lengthspring[rope, 1] = data.ten_length[rope] + spare
        hangs = spare > LEAST_SPARE * data.ten_length[cable]
        model.tendon_group[cable], model.tendon_group[rope] = (HIDDEN, 0) if hangs else (0, HIDDEN)

"""A robot as a MuJoCo model (MJCF text), and a scene to view it in. ``tendons`` describes the model of a cable."""

# pyright: reportAttributeAccessIssue=false
# mujoco ships no type stubs for its compiled modules.
from __future__ import annotations

import itertools
import xml.etree.ElementTree as ET
from collections.abc import Sequence

import mujoco
import numpy as np
from jaxtyping import Float
from numpy.typing import ArrayLike
from scipy.spatial.transform import RigidTransform, Rotation

from cdpr_sim.core.checks import FLAG, checked_label, positive, refuse_unless
from cdpr_sim.core.pose import PoseLike
from cdpr_sim.core.problem import Problem
from cdpr_sim.core.robot import STANDARD_GRAVITY, Robot
from cdpr_sim.physics import chains, exits, pulleys, tendons
from cdpr_sim.physics.cable import Law
from cdpr_sim.physics.damping import (
    STEPS,
    Damping,
    loss_factor,
    refuse_undamped,
    relaxation_times,
    rounded_down,
    stiffest,
)
from cdpr_sim.physics.number_format import add, magnitude, text
from cdpr_sim.physics.winches import (
    LEAST_SPARE,
    RELAXATION_TIME,
    WINCH_SPEED,
    Kind,
    add_actuators,
    add_drums,
    kind_of,
    largest_forces,
    steady_step,
)

TIMESTEP = 0.002
"""[s] Time step; the discrete integrator is implicit in the cables' springs, so that it need not shrink with their
stiffness."""

RESOLVED = 0.5
"""Time step of an undamped model, in 1/omega of the fastest oscillation of its chains across the cables."""

COLLIDING = {"contype": "1", "conaffinity": "1"}
"""Attributes of a geom that collides with all others that do: MuJoCo's defaults."""

CABLE_COLOR = (0.93, 0.45, 0.13, 1)
PLATFORM_COLOR = (0.16, 0.38, 0.62, 1)
EXIT_COLOR = (0.15, 0.16, 0.18, 1)
ANCHOR_COLOR = (0.95, 0.80, 0.25, 1)
FRAME_COLOR = (0.62, 0.65, 0.69, 1)
PULLEY_COLOR = (0.24, 0.26, 0.29, 1)
BRACKET_COLOR = (0.38, 0.41, 0.45, 1)


def to_mjcf(
    robot: Robot | Problem,
    pose: PoseLike | None = None,
    rest_lengths: ArrayLike | None = None,
    *,
    winches: bool | Kind = False,
    damping: Damping = "settle",
    winch_force: ArrayLike | None = None,
    winch_speed: float = WINCH_SPEED,
    contact: bool = False,
) -> str:
    """The robot with its platform at ``pose``, as MJCF text.

    Names: body ``platform``; sites ``exit_1`` and ``anchor_1``; tendon ``cable_1`` and its sensor ``length_1``, counted
    from 1 as in the paper; keyframe ``commanded``. A spatial platform has the free joint ``platform``, a planar one
    the joints ``x``, ``z`` and ``beta`` (positive about +y), whose coordinates are the base frame's. They come first in
    ``qpos``; a cable over a pulley has a body ``pulley_1`` and, in space, its joint ``swivel_1``. An exit that gives
    way is on a body ``frame_1`` with the joints ``frame_1_x``, ``frame_1_y``, ``frame_1_z``. A cable with mass is a
    chain of tendons ``cable_1_1``, ... with masses ``node_1_1``, ... between them; ``length_1`` is its chord.

    With the default ``damping`` the air is so viscous that the platform's slowest oscillation does not overshoot. No
    real platform has that damping; it brings the model to rest quickly, and does not change the equilibrium. A free
    platform of ``cogiro`` falls at 1.05 m/s after 0.5 s, instead of 4.91 in vacuum. To simulate motions, choose
    another: ``"none"``, or the loss factor of the cables (``physics.damping``); then the integrator is one without
    numerical damping, with a shorter time step.

    With ``winches`` the model is driven: the actuator ``winch_1`` lets out L/(1 + u) of cable 1 at the control u, with
    L the written rest length (``winch_controls`` converts lengths into controls). It starts at 0, and MuJoCo
    clamps it silently to ``ctrlrange``, which covers the workspace. Sensors are ``length_1`` [m], ``tension_1`` [N],
    ``position`` [m] and ``orientation`` (quaternion w x y z) of the platform in the frame of the site ``base``. The air
    has no effect; it is replaced by damping on the platform's joints, in space ``x``, ``y``, ``z`` and the ball joint
    ``rotation``, whose zero is the written orientation. So nothing is lost when the model is attached to another one,
    and any body can be its parent. The force of winches of linear cables is limited, so that the simulation remains
    finite with any controls; the time step is shorter where this force could turn the platform by a radian within it.
    One control winds all segments of a cable with mass, whose masses keep the weights of the written lengths (``reset``
    corrects them); its ``tension_1`` is the mean along the cable.

    Args:
        robot: the robot; or a ``Problem``, without other arguments.
        pose: the commanded pose, where the model starts.
        rest_lengths: unstretched cable lengths, (cables,) [m]; default: the rigid ones at ``pose``.
        winches: let ``ctrl`` drive the winches. ``"ratio"``, as True: the control is u, which the rest length follows
            at once, however fast. ``"speed"``: it is a speed [m/s], whose integral w, the activation, lets out
            L/(1 + w/L): w is the length wound in, up to second order in w/L, and the rope runs at (l0/L)² of the
            control.
        damping: what damps the platform: ``"settle"``, ``"none"``, or a loss factor of linear cables from 0 to 1.
        winch_force: largest tension of the winches' ropes [N], one number or one per cable; infinite for no limit.
            Default: the smaller of ``force_max`` and ``breaking_load``, or 1.5 % of EA where neither is known, and then
            at least ten times the platform's weight. Nonlinear cables have no limit.
        winch_speed: largest rope speed of winches of kind ``"speed"`` [m/s]; a rope shorter than the longest in range
            runs slower.
        contact: let the platform collide with other bodies: by the box that is drawn, of ``platform_size`` about its
            origin. Cables, pulleys and exits collide with nothing.

    Returns:
        An MJCF document, which ``mujoco.MjModel.from_xml_string`` compiles; its numbers parse back exactly.

    Raises:
        InvalidInput: an invalid argument; a loss factor of nonlinear cables; a cable with mass that is too short for
            its pulley; cables with a memory, which would push in such a model where they get slack
            (``physics.rope_memory``).
    """
    problem = Problem.of(robot, pose, rest_lengths)
    refuse_unless(FLAG, contact=contact)
    kind, factor = kind_of(winches), loss_factor(damping)
    robot, settling = problem.robot, factor is None
    robot.cabling.refuse_unknown("simulation")
    robot.cabling.refuse_memory()
    chains.refuse_short(robot, problem.rest_lengths)
    if not settling:
        robot.cabling.refuse_unknown("cable damping", "damping")
    if kind:
        exits.refuse_wound(robot.cabling)
    refuse_undamped(robot, factor)
    forces, speed = largest_forces(robot, winch_force), positive("winch_speed", winch_speed, "m/s")
    drag, viscosity = settling_air(problem)
    root = ET.Element("mujoco", model=robot.name)
    ET.SubElement(root, "compiler", angle="radian", inertiafromgeom="false")
    step = min(TIMESTEP, rounded_down(steady_step(robot, forces))) if kind and np.isfinite(forces).all() else TIMESTEP
    integrator = "discrete" if robot.cabling.massless and settling else "implicitfast"
    air = viscosity if settling and not kind else None
    gravity = [0, 0, -robot.gravity]
    option = add(root, "option", timestep=step, integrator=integrator, gravity=gravity, viscosity=air)
    root.append(_defaults(robot))
    world = ET.SubElement(root, "worldbody")
    for i in np.flatnonzero(~robot.cabling.moving_exits):
        add(world, "site", {"name": f"exit_{i + 1}", "class": "exit"}, pos=robot.exits[i])
    paddles = magnitude(robot.platform_size)  # [m] at which the air calms it within a second, also with stiff cables
    brake = (drag, drag * paddles * paddles) if settling else (0.0, 0.0)
    platform = _add_platform(world, robot, problem.pose, brake if kind else None, contact)
    pulls = np.full(robot.cables, robot.weight)  # against which chains are damped, or resolved
    if kind:
        pulls = np.where(np.isfinite(forces), robot.cabling.pulls(forces), pulls)
    calmed = chains.plucked(step, pulls, 1.0) if settling else None
    driven, masses = bool(kind or factor), not robot.cabling.massless
    whole = masses and bool(kind or not settling)  # the cable's spring is that of one tendon, and not of segments
    resisting = step if masses and not whole else None  # this integrator does not know springs
    uneven, count = chains.uneven(problem), chains.SEGMENTS - 1 if whole else None
    tendon = tendons.add_tendons(root, problem, resisting, wound=driven, nodes=count, uneven=uneven)
    nodes = chains.add_chains(world, platform, tendon, problem, resisting, calmed)
    for i in np.flatnonzero(robot.cabling.moving_exits):
        exits.holder(world, robot, int(i), resisting or 0.0, chains.first_stiffness(root, int(i)))
    pulleys.add_pulleys(world, robot, problem.pose, PULLEY_COLOR)
    springs = Law.of(robot.cabling).springs(problem.rest_lengths).stiffness
    if kind:
        add_drums(world, robot, springs)
    if factor is None:
        times = np.full(robot.cables, step if masses else RELAXATION_TIME)
    else:
        times = relaxation_times(robot, springs, factor)
    sensors = ET.SubElement(root, "sensor")
    for i in range(1, robot.cables + 1):
        tendon = "chord" if robot.cabling.with_mass[i - 1] else "cable"
        add(sensors, "tendonpos", name=f"length_{i}", tendon=f"{tendon}_{i}")
    if driven:
        limits = {"forces": forces, "speed": speed}
        add_actuators(root, world, problem, springs, uneven=uneven, kind=kind, damping=times, **limits)
    keyframes = ET.SubElement(root, "keyframe")
    swivels = pulleys.facing(robot, problem.pose.apply(robot.anchors))[1] if robot.mobility == "spatial" else []
    swivels = exits.beside_slides(robot, swivels)
    at = coordinates(robot, problem.pose)
    if kind and robot.mobility == "spatial":
        at = since_written(at, at[3:])
    drums = np.zeros(int(robot.cabling.nonlinear.sum()) if kind else 0)
    start = np.concatenate([at, nodes, swivels, drums])
    add(keyframes, "key", name="commanded", qpos=start)
    if whole:
        chains.add_proportions(root, _compiled(root), problem)
    if not settling:
        period = 2 * np.pi / np.sqrt(stiffest(_compiled(root), robot, springs)[0])
        swings = chains.swinging(problem, pulls)
        longest = min(period / STEPS, RESOLVED / swings if swings else np.inf)
        option.set("timestep", text(min(step, rounded_down(longest))))
    return _document(root)


def scene_mjcf(robot: Robot | Problem, robot_file: str = "robot.xml", *, contact: bool = False) -> str:
    """A scene around the model in ``robot_file``: the robot's frame, a floor, light and two cameras, as MJCF text.

    Nothing in it has mass or pulls, and without ``contact`` nothing collides: it changes the picture, not the physics.

    Args:
        robot: the robot; or the ``Problem`` for which ``robot_file`` is written, if that has no winches. MuJoCo draws
            no cable whose length equals its rest length, as at the start of a model; with a problem, the scene has
            tendons ``line_1``, ... without force, which are drawn there.
        robot_file: name of the file with the text of ``to_mjcf``.
        contact: let the floor collide with bodies that collide, as the platform of ``to_mjcf(..., contact=True)``. The
            frame collides with nothing.

    Returns:
        An MJCF document that includes ``robot_file`` from its own folder.

    Raises:
        InvalidInput: not a robot, or not the name of a file.
    """
    refuse_unless(Robot | Problem, robot=robot)
    refuse_unless(FLAG, contact=contact)
    checked_label("robot_file", robot_file)
    problem, robot = (robot, robot.robot) if isinstance(robot, Problem) else (None, robot)
    lower, upper = robot.frame
    center, diagonal = (lower + upper) / 2, magnitude(upper - lower) or 1.0
    root = ET.Element("mujoco", model=f"{robot.name} scene")
    ET.SubElement(root, "include", file=robot_file)
    add(root, "statistic", center=center, extent=0.8 * diagonal)
    visual = ET.SubElement(root, "visual")
    ET.SubElement(visual, "headlight", diffuse="0.45 0.45 0.45", ambient="0.35 0.35 0.35", specular="0.1 0.1 0.1")
    ET.SubElement(visual, "rgba", haze="0.86 0.90 0.94 1")
    ET.SubElement(visual, "global", azimuth="125", elevation="-18", offwidth="1920", offheight="1080")
    ET.SubElement(visual, "quality", shadowsize="4096")
    root.append(_assets(diagonal))
    world = ET.SubElement(root, "worldbody")
    light = center + diagonal * np.array([-0.4, -0.8, 2.0])
    add(world, "light", pos=light, dir=center - light, diffuse="0.6 0.6 0.6", directional="true")
    floor = [*center[:2], lower[2] - 0.02 * diagonal]
    plane = {"name": "floor", "class": "drawn", "type": "plane", "pos": floor, "size": "0 0 0.05"}
    add(world, "geom", plane, material="floor", **(COLLIDING if contact else {}))
    for start, end in _edges(lower, upper):
        _rod(world, start, end, 0.006 * diagonal, FRAME_COLOR)
    for start in np.unique(robot.exits, axis=0):
        end = _nearest_on_frame(start, lower, upper)
        if magnitude(end - start) > 1e-3 * diagonal:
            _rod(world, start, end, 0.003 * diagonal, BRACKET_COLOR)
    _camera(world, "front", center, np.array([0.0, -1.0, 0.12]), 1.35 * diagonal)
    _camera(world, "iso", center, np.array([0.75, -1.0, 0.55]), 1.35 * diagonal)
    if problem is not None:
        drawn_tendons = ET.SubElement(root, "tendon")
        for i in np.flatnonzero(~(robot.cabling.pulleys | robot.cabling.with_mass)):
            drawn = float(f"{(1 + LEAST_SPARE) * problem.rest_lengths[i]:.12g}")
            tendons.add_twin(drawn_tendons, f"line_{i + 1}", int(i) + 1, drawn)
    return _document(root)


def coordinates(robot: Robot, pose: RigidTransform) -> Float[np.ndarray, " coordinates"]:
    """MuJoCo's ``qpos`` of the platform at ``pose``: (x, y, z, quaternion w x y z), or planar (x, z, beta)."""
    return coordinates_of(robot, pose.translation, pose.rotation.as_matrix())


def coordinates_of(
    robot: Robot, positions: Float[np.ndarray, "*batch 3"], rotations: Float[np.ndarray, "*#batch 3 3"]
) -> Float[np.ndarray, "*batch coordinates"]:
    """``coordinates`` at many poses."""
    if robot.mobility == "planar":
        beta = np.arctan2(-rotations[..., 2, 0], rotations[..., 0, 0])
        return np.stack(np.broadcast_arrays(positions[..., 0], positions[..., 2], beta), axis=-1)
    quaternions = np.empty((*positions.shape[:-1], 4))
    matrices = np.broadcast_to(rotations, (*positions.shape, 3))
    for quaternion, matrix in zip(quaternions.reshape(-1, 4), matrices.reshape(-1, 9), strict=True):
        mujoco.mju_mat2Quat(quaternion, matrix)
    return np.concatenate([positions, quaternions], axis=-1)


def since_written(
    start: Float[np.ndarray, " coordinates"], written: Float[np.ndarray, "4"]
) -> Float[np.ndarray, " coordinates"]:
    """Coordinates of a platform on slides and a ball joint, whose zero is the written orientation."""
    turned = Rotation.from_quat(written, scalar_first=True).inv() * Rotation.from_quat(start[3:], scalar_first=True)
    return np.concatenate([start[:3], turned.as_quat(scalar_first=True)])


def place(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    robot: Robot,
    pose: RigidTransform,
    moves: Float[np.ndarray, "cables 3"] | None = None,
) -> None:
    """Put the platform of one simulation at ``pose``, with its wheels, and its chains in an approximate profile.

    ``moves`` are those of exits that give way [m]; by default none.
    """
    if moves is not None:
        slides = exits.Slides.of(model, robot.cables)
        data.qpos[slides.coordinates[slides.some]] = moves[slides.some]
    start = coordinates(robot, pose)
    if mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_JOINT, "rotation") >= 0:
        start = since_written(start, model.body("platform").quat)
    data.qpos[: len(start)] = start
    if not robot.cabling.massless:
        chains.Chains.of(model, robot.cabling).place(model, data, robot, pose)
    pulleys.toward_anchors(model, data, robot)


def settling_air(problem: Problem) -> tuple[float, float]:
    """Drag of the platform in a model with the damping ``"settle"`` [N s/m], and viscosity of its air [Pa s].

    It critically damps the slowest oscillation, that of a pendulum as long as the cables.

    A damping coefficient of a free joint is the same number for translation and rotation, whose units differ; a viscous
    medium has separate ones. MuJoCo's drag on a body is 3 pi d eta v, and pi d³ eta against rotation, with d the mean
    edge of the box that has the body's mass and inertia.
    """
    robot = problem.robot
    moments = np.empty(3)
    mujoco.mju_eig3(moments, np.empty(9), np.empty(4), robot.inertia.ravel())  # as MuJoCo computes that box
    edges = np.sqrt(np.maximum(6 / robot.mass * (moments.sum() - 2 * moments), 0))
    swing = np.sqrt((robot.gravity or STANDARD_GRAVITY) / problem.rest_lengths.mean())
    # Rounded: the last digits of principal moments differ between versions of MuJoCo.
    drag, size = float(2 * robot.mass * swing), float(f"{edges.mean():.12g}")
    return drag, drag / (3 * np.pi * size)


def _drawn(size: float) -> float:
    """A size that is only drawn, without digits that nobody sees [m]; MuJoCo refuses 0, to which tiny ones round."""
    return round(size, 6) or size


def _defaults(robot: Robot) -> ET.Element:
    scale = magnitude(np.ptp(np.vstack([robot.exits, robot.frame]), axis=0)) or 1.0
    defaults = ET.Element("default")
    drawn = ET.SubElement(defaults, "default", {"class": "drawn"})
    add(drawn, "geom", contype=0, conaffinity=0, group=2, mass=0)
    for name, size, color in (("exit", 0.006, EXIT_COLOR), ("anchor", 0.004, ANCHOR_COLOR)):
        add(add(defaults, "default", {"class": name}), "site", size=_drawn(size * scale), rgba=color, group=2)
    add(add(defaults, "default", {"class": "cable"}), "tendon", width=_drawn(0.0016 * scale), rgba=CABLE_COLOR)
    if robot.cabling.pulleys.any() or not robot.cabling.massless:
        pulleys.add_defaults(defaults)
    return defaults


def _add_platform(
    world: ET.Element, robot: Robot, pose: RigidTransform, damping: tuple[float, float] | None, contact: bool
) -> ET.Element:
    """The body, free to move in the air, or on joints with this damping [N s/m, N m s]."""
    body = add(world, "body", name="platform", pos=pose.translation)
    along, turning = ((number or None) for number in damping or (None, None))
    if robot.mobility == "planar":
        # The body stays level, so that x and z are exactly the base frame's; ``ref`` sets their zero.
        x, z, _ = coordinates(robot, pose)
        for name, axis, at in (("x", "1 0 0", x), ("z", "0 0 1", z)):
            add(body, "joint", name=name, type="slide", axis=axis, ref=at, damping=along)
        add(body, "joint", name="beta", type="hinge", axis="0 1 0", damping=turning)
    else:
        body.set("quat", text(pose.rotation.as_quat(scalar_first=True)))
        if damping:
            # The slides' axes are the base frame's, expressed in the body's frame.
            for name, axis, at in zip("xyz", pose.rotation.as_matrix(), pose.translation, strict=True):
                add(body, "joint", name=name, type="slide", axis=axis, ref=at, damping=along)
            add(body, "joint", name="rotation", type="ball", damping=turning)
        else:
            ET.SubElement(body, "freejoint", name="platform")
    inertia = robot.inertia
    if np.array_equal(inertia, np.diag(np.diag(inertia))):
        moments = {"diaginertia": np.diag(inertia)}
    else:
        moments = {"fullinertia": inertia[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]}
    add(body, "inertial", pos=robot.center_of_mass, mass=robot.mass, **moments)
    box = {"name": "platform", "class": "drawn", "type": "box"}
    colliding = COLLIDING if contact else {}
    add(body, "geom", box, size=robot.platform_size / 2, rgba=PLATFORM_COLOR, **colliding)
    for i, position in enumerate(robot.anchors, start=1):
        add(body, "site", {"name": f"anchor_{i}", "class": "anchor"}, pos=position)
    # MuJoCo's xfrc_applied acts at a body's centre of mass; a massless child has its own at the platform's origin.
    ET.SubElement(body, "body", name="origin")
    return body


def _assets(diagonal: float) -> ET.Element:
    assets = ET.Element("asset")
    ET.SubElement(
        assets, "texture", type="skybox", builtin="gradient", rgb1="0.93 0.95 0.97", rgb2="0.62 0.70 0.80",
        width="512", height="3072",
    )  # fmt: skip
    ET.SubElement(
        assets, "texture", name="floor", type="2d", builtin="checker", mark="edge", rgb1="0.82 0.84 0.87",
        rgb2="0.78 0.80 0.83", markrgb="0.90 0.91 0.93", width="512", height="512",
    )  # fmt: skip
    squares = text([round(1 / (0.3 * diagonal), 3)] * 2)
    ET.SubElement(assets, "material", name="floor", texture="floor", texuniform="true", texrepeat=squares)
    return assets


def _edges(lower: np.ndarray, upper: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
    """The twelve edges of a box, as pairs of corners."""
    corners = [np.array(corner) for corner in itertools.product(*zip(lower, upper, strict=True))]
    return [(a, b) for a, b in itertools.combinations(corners, 2) if np.count_nonzero(a != b) == 1]


def _nearest_on_frame(point: np.ndarray, lower: np.ndarray, upper: np.ndarray) -> np.ndarray:
    edges = _edges(lower, upper)
    nearest = [np.clip(point, np.minimum(a, b), np.maximum(a, b)) for a, b in edges] or [point]
    return min(nearest, key=lambda candidate: magnitude(candidate - point))


def _rod(world: ET.Element, start: np.ndarray, end: np.ndarray, radius: float, color: Sequence[float]) -> None:
    capsule = {"class": "drawn", "type": "capsule", "fromto": [*start, *end]}
    add(world, "geom", capsule, size=_drawn(radius), rgba=color)


def _camera(world: ET.Element, name: str, target: np.ndarray, direction: np.ndarray, distance: float) -> None:
    """A camera that looks at ``target`` from ``direction``, upright."""
    backwards = direction / magnitude(direction)
    right = np.cross([0.0, 0.0, 1.0], backwards)
    right /= magnitude(right)
    axes = np.round([*right, *np.cross(backwards, right)], 6)
    add(world, "camera", name=name, pos=np.round(target + distance * backwards, 6), xyaxes=axes)


def _compiled(root: ET.Element) -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_string(_document(root))


def _document(root: ET.Element) -> str:
    ET.indent(root, space="  ")
    return ET.tostring(root, encoding="unicode") + "\n"

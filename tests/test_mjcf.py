"""The MJCF is the robot, to the last bit, and nothing but the robot."""

import itertools

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from cdpr_sim.core.errors import InvalidInput
from cdpr_sim.core.pose import tilt_of_matrices
from cdpr_sim.core.problem import Problem
from cdpr_sim.core.robot import Robot
from cdpr_sim.physics.mjcf import scene_mjcf, to_mjcf
from cdpr_sim.physics.settle import settle
from cdpr_sim.robots.catalogue import PAPER_ROBOTS, list_robots, load_robot

ROUNDING = 1e-15
"""MuJoCo diagonalises a full inertia [kg m²] and composes frames [m]: a few rounding errors of numbers below 1."""

AT_REST = 1e-6
"""[m, rad] The model as delivered, stepped for a while with its own viscosity, against the settled pose."""


def compiled(text: str, **files: str) -> mujoco.MjModel:
    """The model of an MJCF text that includes ``files``."""
    assets = {f"{name}.xml": content.encode() for name, content in files.items()}
    return mujoco.MjModel.from_xml_string(text, assets)


def any_robot(seed: int, cables: int = 6, mobility: str = "spatial") -> Robot:
    """A robot whose numbers are no round ones, its centre of mass off the origin."""
    random = np.random.default_rng(seed)
    exits, anchors = random.uniform(-2, 2, (cables, 3)), random.normal(0, 0.1, (cables, 3))
    exits[:, 2] += 4
    center_of_mass = random.normal(0, 0.02, 3)
    if mobility == "planar":
        exits[:, 1] = anchors[:, 1] = center_of_mass[1] = 0
    return Robot(
        exits,
        anchors,
        10 ** random.uniform(2, 7, cables),
        random.uniform(0.1, 10),
        center_of_mass=center_of_mass,
        mobility=mobility,  # type: ignore[arg-type]
        gravity=random.uniform(1, 20),
        name=f"any-{seed}",
    )


ROBOTS = [
    *(load_robot(name) for name in PAPER_ROBOTS),
    any_robot(1),
    any_robot(2, cables=3, mobility="planar"),
]


def commanded(robot: Robot) -> RigidTransform:
    """A pose off the middle of the workspace, tilted about y."""
    position = robot.workspace.mean(0) + np.array([0.0123456789, 0, 0.0987654321])
    return RigidTransform.from_components(position, Rotation.from_rotvec([0, 0.1, 0]))


@pytest.mark.parametrize("robot", ROBOTS, ids=lambda robot: robot.name)
def test_numbers_parse_back_to_the_very_same_doubles(robot):
    """Geometry, mass, inertia, springs, gravity and keyframe in MjModel equal the robot's bit for bit."""
    pose = commanded(robot)
    rest = robot.rest_lengths(pose)
    model = compiled(to_mjcf(robot, pose))
    platform = model.body("platform")
    for i in range(robot.cables):
        np.testing.assert_array_equal(model.site(f"exit_{i + 1}").pos, robot.exits[i])
        np.testing.assert_array_equal(model.site(f"anchor_{i + 1}").pos, robot.anchors[i])
    np.testing.assert_array_equal(model.tendon_stiffness, robot.axial_stiffness / rest)
    np.testing.assert_array_equal(model.tendon_lengthspring[:, 0], 0)
    np.testing.assert_array_equal(model.tendon_lengthspring[:, 1], rest)
    np.testing.assert_array_equal(platform.mass, robot.mass)
    np.testing.assert_array_equal(platform.ipos, robot.center_of_mass)
    np.testing.assert_array_equal(platform.inertia, np.diag(robot.inertia))
    np.testing.assert_array_equal(
        model.geom("platform").size, robot.platform_size / 2
    )  # MuJoCo's boxes have half sizes
    np.testing.assert_array_equal(platform.iquat, [1, 0, 0, 0])
    np.testing.assert_array_equal(model.opt.gravity, [0, 0, -robot.gravity])
    position = pose.translation[[0, 2]] if robot.mobility == "planar" else pose.translation
    np.testing.assert_array_equal(model.key("commanded").qpos[: len(position)], position)


def test_a_full_inertia_survives_its_diagonalisation():
    """Principal moments and axes in MjModel compose to the robot's inertia matrix."""
    inertia = np.array([[4.1e-4, 1e-5, -2e-5], [1e-5, 5.2e-4, 3e-5], [-2e-5, 3e-5, 6.3e-4]])
    robot = load_robot("cogiro").replace(inertia=inertia)
    platform = compiled(to_mjcf(robot, commanded(robot))).body("platform")
    axes = Rotation.from_quat(platform.iquat, scalar_first=True).as_matrix()
    np.testing.assert_allclose(axes @ np.diag(platform.inertia) @ axes.T, inertia, rtol=0, atol=ROUNDING)


@pytest.mark.parametrize("robot", ROBOTS, ids=lambda robot: robot.name)
def test_the_keyframe_is_the_commanded_pose(robot):
    """At the keyframe, body and tendon lengths are where rigid cables would put them; planar beta turns about +y."""
    pose = commanded(robot)
    model = compiled(to_mjcf(robot, pose))
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    mujoco.mj_forward(model, data)
    np.testing.assert_allclose(data.body("platform").xpos, pose.translation, rtol=0, atol=ROUNDING)
    np.testing.assert_allclose(data.body("platform").xmat.reshape(3, 3), pose.rotation.as_matrix(), atol=4 * ROUNDING)
    np.testing.assert_allclose(data.sensordata, robot.rest_lengths(pose), rtol=4 * ROUNDING)
    np.testing.assert_array_equal(data.sensordata, data.ten_length)


@pytest.mark.parametrize("robot", ROBOTS, ids=lambda robot: robot.name)
def test_cables_are_springs_and_nothing_else(robot):
    """No tendon has a range, damping, friction or armature, each of which would move or fake the rest pose."""
    model = compiled(to_mjcf(robot, commanded(robot)))
    assert model.ntendon == robot.cables
    for attribute in ("limited", "damping", "frictionloss", "armature"):
        assert not getattr(model, f"tendon_{attribute}").any()


@pytest.mark.parametrize("name", ["cogiro", "planar-vertical"])
def test_what_is_drawn_weighs_nothing(name):
    """Wheels neither, so that the model may hang on a body that moves; those that swivel weigh a millionth."""
    robot = load_robot(name).replace(pulley_radius=0.05, pulley_axis=(0, 0, 1))
    masses = compiled(to_mjcf(robot, commanded(robot))).body_mass
    assert masses.sum() == pytest.approx(robot.mass, rel=1e-5)


@pytest.mark.parametrize("cables", range(1, 11))
def test_any_number_of_cables_makes_a_model_that_steps_without_a_warning(cables):
    """From 1 to 10 cables, the model compiles and steps, and MuJoCo has nothing to say."""
    robot = any_robot(cables, cables=cables)
    model = compiled(to_mjcf(robot, commanded(robot)))
    data = mujoco.MjData(model)
    mujoco.mj_step(model, data, 200)
    assert np.isfinite(data.qpos).all()
    assert not any(warning.number for warning in data.warning)


@pytest.mark.parametrize("name", list_robots())
def test_the_scene_changes_the_picture_and_not_the_physics(name):
    """Frame, floor and lights add no mass, no joint and no contact, even with the platform in the floor."""
    robot = load_robot(name)
    text = to_mjcf(robot, commanded(robot))
    alone, scene = compiled(text), compiled(scene_mjcf(robot), robot=text)
    assert (scene.nq, scene.nv, scene.ntendon, scene.nbody) == (alone.nq, alone.nv, alone.ntendon, alone.nbody)
    np.testing.assert_array_equal(scene.body_mass, alone.body_mass)
    np.testing.assert_array_equal(scene.body_inertia, alone.body_inertia)
    data = mujoco.MjData(scene)
    data.qpos[1 if robot.mobility == "planar" else 2] = robot.frame[0, 2]
    mujoco.mj_forward(scene, data)
    assert data.ncon == 0


@pytest.mark.parametrize("camera", ["front", "iso"])
@pytest.mark.parametrize("scale", [0.01, 1.0, 50.0])
def test_cameras_frame_the_robot_whatever_its_size(camera, scale):
    """Every corner of the frame is in the picture; from half as far it would not be."""
    robot = load_robot("cogiro")
    robot = Robot(scale * robot.exits, scale * robot.anchors, 1e4, 0.4, frame=scale * robot.frame)
    model = compiled(scene_mjcf(robot), robot=to_mjcf(robot, scale * np.array([0.4, 0.25, 0.2])))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    corners = np.array(list(itertools.product(*robot.frame.T)))

    def in_picture(eye: np.ndarray) -> bool:
        seen = (corners - eye) @ data.cam(camera).xmat.reshape(3, 3)  # x right, y up, z backwards
        height = np.tan(np.radians(model.cam(camera).fovy[0]) / 2)
        up, right = np.abs(seen[:, 1] / seen[:, 2]), np.abs(seen[:, 0] / seen[:, 2])
        return bool((seen[:, 2] < 0).all() and (up < height).all() and (right < 4 / 3 * height).all())

    eye, center = data.cam(camera).xpos, robot.frame.mean(0)
    assert in_picture(eye)
    assert not in_picture(center + 0.5 * (eye - center))


@pytest.mark.parametrize("name", PAPER_ROBOTS)
def test_the_model_as_delivered_comes_to_the_settled_rest(name):
    """Just stepped, as in the viewer, the model ends where ``settle`` does: its viscosity moves no equilibrium."""
    robot = load_robot(name)
    pose = robot.workspace.mean(0) - np.array([0.2, 0, 0])
    model = compiled(to_mjcf(robot, pose))
    data = mujoco.MjData(model)
    mujoco.mj_step(model, data, round(20 / model.opt.timestep))
    rest = settle(robot, pose)
    up = data.body("platform").xmat.reshape(3, 3)
    assert np.linalg.norm(data.body("platform").xpos - rest.position) < AT_REST
    assert abs(tilt_of_matrices(up) - rest.tilt) < AT_REST
    assert np.linalg.norm(rest.deviation) > 10 * AT_REST  # it had somewhere to go


def test_a_problem_is_written_as_it_is():
    """A ``Problem`` in place of (robot, pose, rest lengths), alone; its rest lengths are the springs'."""
    robot = load_robot("cogiro")
    lengths = 1.01 * robot.rest_lengths(commanded(robot))
    problem = Problem.of(robot, commanded(robot), lengths)
    assert to_mjcf(problem) == to_mjcf(robot, commanded(robot), lengths)
    np.testing.assert_array_equal(compiled(to_mjcf(problem)).tendon_lengthspring[:, 1], lengths)
    with pytest.raises(InvalidInput, match="rest_lengths: found one beside a Problem"):
        to_mjcf(problem, rest_lengths=lengths)


def test_the_text_is_readable():
    """Two-space indentation, default classes, names counted from 1."""
    text = to_mjcf(load_robot("planar-vertical"), [0.3, 0, 0.2])
    assert '\n    <site name="exit_1" class="exit" pos="0.04 0 0.486" />\n' in text
    assert '\n      <joint name="beta" type="hinge" axis="0 1 0" />\n' in text
    assert '<key name="commanded" qpos="0.3 0.2 0" />' in text

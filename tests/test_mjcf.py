"""The MJCF is the robot, to the last bit, and nothing but the robot."""

import itertools

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

import cdpr_sim as cdpr
from cdpr_sim.physics.mjcf import scene_mjcf, to_mjcf
from cdpr_sim.robots.catalogue import PAPER_ROBOTS

ROUNDING = 1e-15
"""MuJoCo diagonalises a full inertia [kg m²] and composes frames [m]: a few rounding errors of numbers below 1."""


def compiled(text: str, **files: str) -> mujoco.MjModel:
    """The model of an MJCF text that includes ``files``."""
    assets = {f"{name}.xml": content.encode() for name, content in files.items()}
    return mujoco.MjModel.from_xml_string(text, assets)


def any_robot(seed: int, cables: int = 6, mobility: str = "spatial") -> cdpr.Robot:
    """A robot whose numbers are no round ones, its centre of mass off the origin."""
    random = np.random.default_rng(seed)
    exits, anchors = random.uniform(-2, 2, (cables, 3)), random.normal(0, 0.1, (cables, 3))
    exits[:, 2] += 4
    center_of_mass = random.normal(0, 0.02, 3)
    if mobility == "planar":
        exits[:, 1] = anchors[:, 1] = center_of_mass[1] = 0
    return cdpr.Robot(
        exits, anchors, 10 ** random.uniform(2, 7, cables), random.uniform(0.1, 10), center_of_mass=center_of_mass,
        mobility=mobility, gravity=random.uniform(1, 20), name=f"any-{seed}",  # type: ignore[arg-type]
    )  # fmt: skip


LAW = np.zeros((8, 2))
LAW[2] = 4.0, -2.0

COGIRO = cdpr.load_robot("cogiro")

ROBOTS = [
    *(cdpr.load_robot(name) for name in PAPER_ROBOTS), any_robot(0, cables=3, mobility="planar"),
    *(any_robot(cables, cables) for cables in range(1, 11)),
    COGIRO.replace(stiffening=LAW, name="with a law"),
]  # fmt: skip


def commanded(robot: cdpr.Robot) -> RigidTransform:
    """A pose off the middle of the workspace, tilted about y."""
    position = robot.workspace.mean(0) + np.array([0.0123456789, 0, 0.0987654321])
    return RigidTransform.from_components(position, Rotation.from_rotvec([0, 0.1, 0]))


@pytest.mark.parametrize("robot", ROBOTS, ids=lambda robot: robot.name)
def test_a_model_has_the_robots_own_numbers_and_nothing_else(robot):
    """Bit for bit. No tendon has a range, damping, friction or armature; the keyframe is the commanded pose."""
    pose = commanded(robot)
    rest = robot.rest_lengths(pose)
    model = compiled(to_mjcf(robot, pose))
    platform, free = model.body("platform"), 2 if robot.mobility == "planar" else 3
    for found, expected in (
        ([model.site(f"exit_{i + 1}").pos for i in range(robot.cables)], robot.exits),
        ([model.site(f"anchor_{i + 1}").pos for i in range(robot.cables)], robot.anchors),
        (model.tendon_stiffness, robot.axial_stiffness / rest),
        (
            model.tendon_stiffnesspoly[:, :2],
            (robot.axial_stiffness / rest ** np.array([[2], [3]]) * robot.stiffening.T).T,
        ),
        (model.tendon_lengthspring, np.stack([0 * rest, rest], 1)),
        (platform.mass, robot.mass),
        (platform.ipos, robot.center_of_mass),
        (platform.inertia, np.diag(robot.inertia)),
        (platform.iquat, [1, 0, 0, 0]),
        (model.geom("platform").size, robot.platform_size / 2),  # MuJoCo's boxes have half sizes
        (model.opt.gravity, [0, 0, -robot.gravity]),
        (model.key("commanded").qpos[:free], pose.translation[[0, 2] if free == 2 else [0, 1, 2]]),
        (model.ntendon, robot.cables),
    ):
        np.testing.assert_array_equal(found, expected)
    for attribute in ("limited", "damping", "frictionloss", "armature"):
        assert not getattr(model, f"tendon_{attribute}").any()
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    mujoco.mj_forward(model, data)
    np.testing.assert_allclose(data.body("platform").xpos, pose.translation, rtol=0, atol=ROUNDING)
    np.testing.assert_allclose(data.body("platform").xmat.reshape(3, 3), pose.rotation.as_matrix(), atol=4 * ROUNDING)
    np.testing.assert_allclose(data.sensordata, rest, rtol=4 * ROUNDING)
    np.testing.assert_array_equal(data.sensordata, data.ten_length)
    mujoco.mj_step(model, data, 200)
    assert np.isfinite(data.qpos).all()
    assert not any(warning.number for warning in data.warning)


def test_a_full_inertia_survives_its_diagonalisation():
    """Principal moments and axes in MjModel compose to the robot's inertia matrix."""
    inertia = np.array([[4.1e-4, 1e-5, -2e-5], [1e-5, 5.2e-4, 3e-5], [-2e-5, 3e-5, 6.3e-4]])
    platform = compiled(to_mjcf(COGIRO.replace(inertia=inertia), commanded(COGIRO))).body("platform")
    axes = Rotation.from_quat(platform.iquat, scalar_first=True).as_matrix()
    np.testing.assert_allclose(axes @ np.diag(platform.inertia) @ axes.T, inertia, rtol=0, atol=ROUNDING)


@pytest.mark.parametrize(("name", "swivels"), [("cogiro", 8), ("planar-vertical", 0)])
def test_wheels_are_drawn_where_tendons_wrap_and_weigh_nothing(name, swivels):
    """So that the model may hang on a body that moves; those that swivel weigh a millionth; planar ones do not."""
    robot = cdpr.load_robot(name).replace(pulley_radius=0.05, pulley_axis=(0, 0, 1))
    text = to_mjcf(robot, commanded(robot))
    model = compiled(scene_mjcf(robot), robot=text)
    assert compiled(text).body_mass.sum() == pytest.approx(robot.mass, rel=1e-5)
    assert model.nv == len(robot.free) + swivels
    for i in range(1, robot.cables + 1):
        wheel, groove = model.geom(f"wheel_{i}"), model.geom(f"groove_{i}")
        assert wheel.size[0] == groove.size[0] == 0.05
        np.testing.assert_allclose(wheel.pos, groove.pos, atol=ROUNDING)
        assert (wheel.group[0], groove.group[0]) == (2, 4)


@pytest.mark.parametrize("name", cdpr.list_robots())
def test_the_scene_changes_the_picture_and_not_the_physics(name):
    """Frame, floor and lights add no mass, no joint and no contact, even with the platform in the floor.

    Alone and in its scene, the robot moves the same to the last bit.
    """
    robot = cdpr.load_robot(name)
    text = to_mjcf(robot, commanded(robot))
    alone, scene = compiled(text), compiled(scene_mjcf(robot), robot=text)
    assert (scene.nq, scene.nv, scene.ntendon, scene.nbody) == (alone.nq, alone.nv, alone.ntendon, alone.nbody)
    np.testing.assert_array_equal(scene.body_mass, alone.body_mass)
    np.testing.assert_array_equal(scene.body_inertia, alone.body_inertia)
    moved = [mujoco.MjData(alone), mujoco.MjData(scene)]
    for model, data in zip((alone, scene), moved, strict=True):
        mujoco.mj_step(model, data, 300)
    np.testing.assert_array_equal(moved[0].qpos, moved[1].qpos)
    data = mujoco.MjData(scene)
    data.qpos[1 if robot.mobility == "planar" else 2] = robot.frame[0, 2]
    mujoco.mj_forward(scene, data)
    assert data.ncon == 0


@pytest.mark.parametrize("camera", ["front", "iso"])
@pytest.mark.parametrize("scale", [0.01, 1.0, 50.0])
def test_cameras_frame_the_robot_whatever_its_size(camera, scale):
    """Every corner of the frame is in the picture; from half as far it would not be."""
    robot = cdpr.Robot(scale * COGIRO.exits, scale * COGIRO.anchors, 1e4, 0.4, frame=scale * COGIRO.frame)
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


def test_a_problem_is_written_as_it_is(snapshot):
    """A ``Problem`` in place of (robot, pose, rest lengths); its rest lengths are the springs'; a text to be read."""
    lengths = 1.01 * COGIRO.rest_lengths(commanded(COGIRO))
    problem = cdpr.Problem.of(COGIRO, commanded(COGIRO), lengths)
    assert to_mjcf(problem) == to_mjcf(COGIRO, commanded(COGIRO), lengths)
    np.testing.assert_array_equal(compiled(to_mjcf(problem)).tendon_lengthspring[:, 1], lengths)
    ropes = dict(stiffening=[(0, 0), (4, -2)], pulley_radius=[0, 0.02], linear_density=[0, 1e-3], winch_to_exit=0.5)
    snapshot("mjcf/two-cable.xml", to_mjcf(cdpr.load_robot("two-cable").replace(**ropes), [0.3, 0, 0.2]), 1e-9)

"""``reset`` puts a model of any kind, also one from a file, at a pose, as ``to_mjcf`` would write it there."""

import itertools
from pathlib import Path

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

import cdpr_sim as cdpr
from cdpr_sim.physics.mjcf import scene_mjcf, to_mjcf

MODELS = Path(__file__).parents[1] / "models"

ROUNDING = 1e-12
"""Relative: pose, lengths and springs pass through quaternions and quotients; measured 1e-14."""

COGIRO = cdpr.load_robot("cogiro")
TURNED = RigidTransform.from_components((0.35, 0.22, 0.2), Rotation.from_rotvec([0.05, -0.1, 0.15]))
ROBOTS = {
    "spatial": COGIRO,
    "planar": cdpr.load_robot("planar-vertical"),
    "pulleys": COGIRO.replace(pulley_radius=0.01, pulley_axis=(0, 0, 1)),
    "planar pulleys": cdpr.load_robot("planar-vertical").replace(pulley_radius=0.01, pulley_axis=(0, 0, 1)),
    "drive line": COGIRO.replace(winch_to_exit=0.8, reeving=2),
    "nonlinear": COGIRO.replace(stiffening=(50, 100)),
}


def pose_of(robot: cdpr.Robot) -> RigidTransform:
    """Away from the middle of the workspace, turned."""
    if robot.mobility == "spatial":
        return TURNED
    return RigidTransform.from_components((0.35, 0, 0.2), Rotation.from_rotvec([0, 0.1, 0]))


def forces_of(model: mujoco.MjModel, data: mujoco.MjData) -> np.ndarray:
    """Generalised force of the cables on the platform, at rest."""
    mujoco.mj_forward(model, data)
    return (data.qfrc_passive + data.qfrc_actuator)[: 6 if model.nv >= 6 else 3]


@pytest.mark.parametrize(
    ("name", "kind"),  # nonlinear cables have no loss factor
    [
        each
        for each in itertools.product(ROBOTS, (False, "ratio", "speed", "damped"))
        if each != ("nonlinear", "damped")
    ],
)
def test_a_reset_model_is_the_one_written_at_that_pose(name, kind):
    """Pose, swivels, lengths and forces after a reset from home are those of a model that was written there."""
    robot = ROBOTS[name]
    options = {"damping": 0.02} if kind == "damped" else {"winches": kind, "winch_force": np.inf}
    pose = pose_of(robot)
    lengths = 0.99 * robot.rest_lengths(pose)
    model = mujoco.MjModel.from_xml_string(to_mjcf(robot, robot.home, **options))
    data = mujoco.MjData(model)
    mujoco.mj_step(model, data, 20)
    cdpr.reset(model, data, pose, rest_lengths=lengths)
    other = mujoco.MjModel.from_xml_string(to_mjcf(robot, pose, lengths, **options))
    expected = mujoco.MjData(other)
    mujoco.mj_resetDataKeyframe(other, expected, 0)
    forces = forces_of(other, expected)
    assert np.abs(forces).max() > 10  # taut
    for state in (data, mujoco.MjData(model)):  # as it is, and by its keyframe
        if state is not data:
            mujoco.mj_resetDataKeyframe(model, state, 0)
        found = forces_of(model, state)
        drums = 1e-5 if kind and not robot.cabling.linear else ROUNDING  # a drum yields by a millionth of the stretch
        np.testing.assert_allclose(found, forces, rtol=0, atol=1e2 * drums * np.abs(forces).max())
        body = state.body("platform")
        np.testing.assert_allclose(body.xpos, pose.translation, rtol=0, atol=ROUNDING)
        np.testing.assert_allclose(body.xmat.reshape(3, 3), pose.rotation.as_matrix(), rtol=0, atol=ROUNDING)
        for i in range(1, robot.cables + 1):
            site = f"anchor_{i}"
            np.testing.assert_allclose(state.site(site).xpos, expected.site(site).xpos, rtol=0, atol=ROUNDING)
            if robot.cabling.pulleys.any():
                mine, its = (one.body(f"pulley_{i}").xmat for one in (state, expected))
                np.testing.assert_allclose(mine, its, rtol=0, atol=ROUNDING)
    assert data.time == 0
    assert not data.qvel.any()


@pytest.mark.parametrize("kind", [False, "ratio", "speed"])
@pytest.mark.parametrize("name", ["spatial", "planar", "pulleys", "drive line"])
def test_without_rest_lengths_the_cables_are_rigid_ones(name, kind):
    """The platform starts at the pose with every cable at its rest length: no cable pulls."""
    robot = ROBOTS[name]
    model = mujoco.MjModel.from_xml_string(to_mjcf(robot, robot.home, winches=kind))
    data = mujoco.MjData(model)
    cdpr.reset(model, data, pose_of(robot))
    assert np.abs(forces_of(model, data)).max() < 1e-8 * robot.axial_stiffness.max()
    if kind == "ratio":
        np.testing.assert_allclose(
            data.ctrl, cdpr.winch_controls(robot, robot.home, robot.rest_lengths(pose_of(robot))), rtol=0, atol=ROUNDING
        )


@pytest.mark.parametrize("kind", [False, "ratio", "speed"])
@pytest.mark.parametrize("reeving", [1, 3])
def test_pretension_is_an_equilibrium_at_the_pose(kind, reeving):
    """Its tensions are those of ``Robot.rest_lengths`` with a pretension, which uses statics' formulas."""
    robot = cdpr.load_robot("ipanema-1").replace(reeving=reeving)
    pose, wanted = robot.home + np.array([0.1, 0.05, 0.02]), 200.0
    model = mujoco.MjModel.from_xml_string(to_mjcf(robot, robot.home, winches=kind))
    data = mujoco.MjData(model)
    cdpr.reset(model, data, pose, pretension=wanted)
    weight = robot.weight
    assert np.abs(forces_of(model, data) - data.qfrc_bias[:6]).max() < 1e-7 * weight
    mujoco.mj_step(model, data, 500)
    np.testing.assert_allclose(data.body("platform").xpos, pose, rtol=0, atol=1e-9)
    rest = robot.rest_lengths(pose, wanted)
    if kind == "ratio":
        np.testing.assert_allclose(data.ctrl, cdpr.winch_controls(robot, robot.home, rest), rtol=0, atol=1e-9)
    cdpr.reset(model, data, pose)
    mujoco.mj_step(model, data, 500)
    assert np.abs(data.body("platform").xpos - pose).max() > 1e-6  # the negative control: it sags


@pytest.mark.parametrize("file", ["scene.xml", "winch_scene.xml"])  # which include robot.xml and winch.xml
@pytest.mark.parametrize("name", ["cogiro", "caroca", "planar-vertical"])
def test_models_from_files_are_reset(name, file):
    """Those in ``models/``, of a spatial robot, one with pulleys, and a planar one; they settle as ``solve`` says."""
    robot = cdpr.load_robot(name)
    model = mujoco.MjModel.from_xml_path(str(MODELS / name / file))
    data = mujoco.MjData(model)
    lower, upper = robot.workspace
    pose = robot.home + 0.1 * (upper - lower)
    cdpr.reset(model, data, pose)
    np.testing.assert_allclose(data.body("platform").xpos, pose, rtol=0, atol=ROUNDING)
    mujoco.mj_step(model, data, round(60 / model.opt.timestep))
    np.testing.assert_allclose(data.body("platform").xpos, cdpr.solve(robot, pose).position, rtol=0, atol=1e-6)


def test_an_attached_model_is_reset_in_its_base_frame():
    """On a moved and turned frame, by its prefix."""
    world, part = mujoco.MjSpec(), mujoco.MjSpec.from_string(to_mjcf(COGIRO, COGIRO.home, winches=True))
    turn = Rotation.from_rotvec([0, 0, 0.5])
    frame = world.worldbody.add_frame(pos=[1, 2, 3], quat=turn.as_quat(scalar_first=True))
    world.option.integrator = part.option.integrator
    world.attach(part, prefix="cdpr/", frame=frame)
    model = world.compile()
    data = mujoco.MjData(model)
    cdpr.reset(model, data, TURNED, prefix="cdpr/")
    np.testing.assert_allclose(data.sensor("cdpr/position").data, TURNED.translation, rtol=0, atol=ROUNDING)
    turned = Rotation.from_quat(data.sensor("cdpr/orientation").data, scalar_first=True)
    assert (turned * TURNED.rotation.inv()).magnitude() < 1e-7
    assert np.abs(data.actuator_force).max() < 1e-8 * COGIRO.axial_stiffness.max()


def test_a_model_that_cannot_be_reset_is_left_as_it_was():
    """One sentence each, and neither the model nor its state changes."""
    model = mujoco.MjModel.from_xml_string(
        to_mjcf(ROBOTS["planar pulleys"], ROBOTS["planar pulleys"].home, winches=True)
    )
    data = mujoco.MjData(model)
    mujoco.mj_step(model, data, 3)
    before = data.qpos.copy(), model.body_quat.copy(), model.key_qpos.copy()
    for arguments, words in (
        (((0.3, 0.1, 0.2),), "pose: found y = 0.1 m, but the robot is planar"),
        (((0.3, 0, 0.2, 0.1, 0, 0),), "pose: found a rotation about x or z"),
        (((np.nan, 0, 0),), "pose: found"),
        (((30, 0, 0.2),), r"rest_lengths: found .* m for cable 1, expected .* m, which its winch can let out"),
    ):
        with pytest.raises(cdpr.InvalidInput, match=words):
            cdpr.reset(model, data, *arguments)
        for now, then in zip((data.qpos, model.body_quat, model.key_qpos), before, strict=True):
            np.testing.assert_array_equal(now, then)
    with pytest.raises(cdpr.InvalidInput, match="pretension: found one besides rest_lengths"):
        cdpr.reset(model, data, (0.3, 0, 0.2), rest_lengths=np.ones(4), pretension=3)
    with pytest.raises(cdpr.InvalidInput, match="pretension: found no tensions near 0 N"):
        cdpr.reset(model, data, (0.9, 0, 0.2), pretension=0)
    heavy = COGIRO.replace(linear_density=0.001)
    model = mujoco.MjModel.from_xml_string(to_mjcf(heavy, heavy.home))
    with pytest.raises(cdpr.InvalidInput, match="expected massless cables"):
        cdpr.reset(model, mujoco.MjData(model), heavy.home)
    bare = mujoco.MjModel.from_xml_string("<mujoco/>")
    with pytest.raises(cdpr.InvalidInput, match="model: found no body 'platform' with cables"):
        cdpr.reset(bare, mujoco.MjData(bare), (0, 0, 0))


def test_lines_of_the_scene_follow_a_reset():
    """Twins that are drawn get the new lengths, so that taut and slack cables are drawn as such."""
    problem = cdpr.Problem.of(COGIRO, COGIRO.home)
    files = {"robot.xml": to_mjcf(problem).encode()}
    model = mujoco.MjModel.from_xml_string(scene_mjcf(problem), files)
    cdpr.reset(model, mujoco.MjData(model), TURNED)
    lengths = [model.tendon_lengthspring[model.tendon(f"line_{i}").id, 1] for i in range(1, 9)]
    np.testing.assert_allclose(lengths, COGIRO.rest_lengths(TURNED), rtol=1e-8)

"""``reset`` puts a model of any kind, also one from a file, at a pose, as ``to_mjcf`` would write it there."""

import itertools

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

import cdpr_sim as cdpr

ROUNDING = 1e-12
"""Relative: pose, lengths and springs pass through quaternions and quotients; measured 1e-14."""

COGIRO, PLANAR = cdpr.load_robot("cogiro"), cdpr.load_robot("planar-vertical")
TURNED = RigidTransform.from_components((0.35, 0.22, 0.2), Rotation.from_rotvec([0.05, -0.1, 0.15]))
ROBOTS = {
    "spatial": COGIRO,
    "planar": PLANAR,
    "pulleys": COGIRO.replace(pulley_radius=0.01, pulley_axis=(0, 0, 1)),
    "planar pulleys": PLANAR.replace(pulley_radius=0.01, pulley_axis=(0, 0, 1)),
    "drive line": COGIRO.replace(winch_to_exit=0.8, reeving=2),
    "nonlinear": COGIRO.replace(stiffening=(50, 100)),
}


def pose_of(robot: cdpr.Robot) -> RigidTransform:
    """Away from the middle of the workspace, turned."""
    if robot.mobility == "spatial":
        return TURNED
    return RigidTransform.from_components((0.35, 0, 0.2), Rotation.from_rotvec([0, 0.1, 0]))


def model_of(text: str) -> tuple[mujoco.MjModel, mujoco.MjData]:
    model = mujoco.MjModel.from_xml_string(text)
    return model, mujoco.MjData(model)


def forces_of(model: mujoco.MjModel, data: mujoco.MjData) -> np.ndarray:
    """Generalised force of the cables on the platform, at rest."""
    mujoco.mj_forward(model, data)
    return (data.qfrc_passive + data.qfrc_actuator)[: 6 if model.nv >= 6 else 3]


KINDS = itertools.product(ROBOTS, (False, "ratio", "speed", "damped"))


@pytest.mark.parametrize(("name", "kind"), [one for one in KINDS if one != ("nonlinear", "damped")])
def test_a_reset_model_is_the_one_written_at_that_pose(name, kind):
    """Pose, swivels, lengths and forces after a reset from home are those of a model that was written there.

    Nonlinear cables have no loss factor. Without lengths, no cable pulls.
    """
    robot = ROBOTS[name]
    options = {"damping": 0.02} if kind == "damped" else {"winches": kind, "winch_force": np.inf}
    pose = pose_of(robot)
    lengths = 0.99 * robot.rest_lengths(pose)
    model, data = model_of(cdpr.to_mjcf(robot, robot.home, **options))
    mujoco.mj_step(model, data, 20)
    cdpr.reset(model, data, pose, rest_lengths=lengths)
    other, expected = model_of(cdpr.to_mjcf(robot, pose, lengths, **options))
    mujoco.mj_resetDataKeyframe(other, expected, 0)
    forces = forces_of(other, expected)
    assert np.abs(forces).max() > 10  # taut
    by_keyframe = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, by_keyframe, 0)
    for state in (data, by_keyframe):
        found = forces_of(model, state)
        drums = 1e-5 if kind and not robot.cabling.linear else ROUNDING  # a drum yields by a millionth of the stretch
        np.testing.assert_allclose(found, forces, rtol=0, atol=1e2 * drums * np.abs(forces).max())
        body = state.body("platform")
        np.testing.assert_allclose(body.xpos, pose.translation, rtol=0, atol=ROUNDING)
        np.testing.assert_allclose(body.xmat.reshape(3, 3), pose.rotation.as_matrix(), rtol=0, atol=ROUNDING)
        for i in range(1, robot.cables + 1):
            mine, its = (one.site(f"anchor_{i}").xpos for one in (state, expected))
            np.testing.assert_allclose(mine, its, rtol=0, atol=ROUNDING)
            if robot.cabling.pulleys.any():
                mine, its = (one.body(f"pulley_{i}").xmat for one in (state, expected))
                np.testing.assert_allclose(mine, its, rtol=0, atol=ROUNDING)
    assert data.time == 0
    assert not data.qvel.any()
    cdpr.reset(model, data, pose)
    pulls = 1e-8 if robot.cabling.linear else 1e-6
    assert np.abs(forces_of(model, data)).max() < pulls * robot.axial_stiffness.max()
    if kind == "ratio" and robot.cabling.linear:
        controls = cdpr.winch_controls(robot, robot.home, robot.rest_lengths(pose))
        np.testing.assert_allclose(data.ctrl, controls, rtol=0, atol=ROUNDING)


@pytest.mark.parametrize("kind", [False, "ratio", "speed"])
@pytest.mark.parametrize("reeving", [1, 3])
def test_pretension_is_an_equilibrium_at_the_pose(kind, reeving):
    """Its tensions are those of ``Robot.rest_lengths`` with a pretension, which uses statics' formulas.

    Without it the platform sags: the negative control.
    """
    robot = cdpr.load_robot("ipanema-1").replace(reeving=reeving)
    pose = robot.home + np.array([0.1, 0.05, 0.02])
    model, data = model_of(cdpr.to_mjcf(robot, robot.home, winches=kind))
    cdpr.reset(model, data, pose, pretension=200.0)
    assert np.abs(forces_of(model, data) - data.qfrc_bias[:6]).max() < 1e-7 * robot.weight
    mujoco.mj_step(model, data, 500)
    np.testing.assert_allclose(data.body("platform").xpos, pose, rtol=0, atol=1e-9)
    if kind == "ratio":
        controls = cdpr.winch_controls(robot, robot.home, robot.rest_lengths(pose, 200.0))
        np.testing.assert_allclose(data.ctrl, controls, rtol=0, atol=1e-9)
    cdpr.reset(model, data, pose)
    mujoco.mj_step(model, data, 500)
    assert np.abs(data.body("platform").xpos - pose).max() > 1e-6


def test_an_attached_model_is_reset_in_its_base_frame():
    """On a moved and turned frame, by its prefix."""
    world, part = mujoco.MjSpec(), mujoco.MjSpec.from_string(cdpr.to_mjcf(COGIRO, COGIRO.home, winches=True))
    frame = world.worldbody.add_frame(pos=[1, 2, 3], quat=[np.cos(0.25), 0, 0, np.sin(0.25)])
    world.option.integrator = part.option.integrator
    world.attach(part, prefix="cdpr/", frame=frame)
    model = world.compile()
    data = mujoco.MjData(model)
    cdpr.reset(model, data, TURNED, prefix="cdpr/")
    np.testing.assert_allclose(data.sensor("cdpr/position").data, TURNED.translation, rtol=0, atol=ROUNDING)
    turned = Rotation.from_quat(data.sensor("cdpr/orientation").data, scalar_first=True)
    assert (turned * TURNED.rotation.inv()).magnitude() < 1e-7
    assert np.abs(data.actuator_force).max() < 1e-8 * COGIRO.axial_stiffness.max()


def test_lines_of_the_scene_follow_a_reset():
    """Twins that are drawn get the new lengths, so that taut and slack cables are drawn as such."""
    files = {"robot.xml": cdpr.to_mjcf(COGIRO, COGIRO.home).encode()}
    model = mujoco.MjModel.from_xml_string(cdpr.scene_mjcf(cdpr.Problem.of(COGIRO, COGIRO.home)), files)
    cdpr.reset(model, mujoco.MjData(model), TURNED)
    lengths = [model.tendon_lengthspring[model.tendon(f"line_{i}").id, 1] for i in range(1, 9)]
    np.testing.assert_allclose(lengths, COGIRO.rest_lengths(TURNED), rtol=1e-8)

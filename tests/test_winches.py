"""A model that is driven by its winches: its actuators are the law of its cables, and it rests where ``solve`` says."""

import re
from pathlib import Path

import mujoco
import numpy as np
import pytest
from inputs import run
from scipy.spatial.transform import Rotation

import cdpr_sim as cdpr
from cdpr_sim.physics.winches import hang

AT_REST = 1e-9
"""[m] Measured 1e-10 and less."""

STEPS = {1e3: 5e-3, 1e4: 1e-3, 1e5: 5e-4}
"""EA [N], and the longest time step [s] for it of integrators that do not know springs."""

AWAY = np.array([-0.1, 0, -0.05])
"""[m] From the middle of the workspace, where models are written, to where they are wound."""

ROBOTS = {
    name: cdpr.load_robot(name) for name in ("cogiro", "parallel", "planar-horizontal", "planar-vertical", "two-cable")
}
ROBOTS["pulleys"] = ROBOTS["cogiro"].replace(pulley_radius=0.01, pulley_axis=(0, 0, 1))
COGIRO, PARALLEL = ROBOTS["cogiro"], ROBOTS["parallel"]


def model_of(robot: cdpr.Robot, integrator: str = "discrete", step: float = 0.005, **given) -> mujoco.MjModel:
    """Written in the middle of its workspace."""
    model = mujoco.MjModel.from_xml_string(cdpr.to_mjcf(robot, robot.home, winches=True, **given))
    model.opt.timestep, model.opt.integrator = step, getattr(mujoco.mjtIntegrator, f"mjINT_{integrator.upper()}")
    return model


def controls_of(robot: cdpr.Robot) -> np.ndarray:
    """That wind it to ``AWAY``."""
    return cdpr.winch_controls(robot, robot.home, robot.rest_lengths(robot.home + AWAY))


def wound(model: mujoco.MjModel, controls: np.ndarray) -> mujoco.MjData:
    """Wound evenly from the keyframe for 2 s, then left alone for 13 s."""
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    while data.time < 2:
        data.ctrl = controls * min(1, data.time / 2)
        mujoco.mj_step(model, data)
    data.ctrl = controls
    mujoco.mj_step(model, data, round(13 / model.opt.timestep))
    assert not data.warning.number.any()
    return data


def error(robot: cdpr.Robot, data: mujoco.MjData) -> float:
    """[m] From where ``solve`` says that the platform rests."""
    return float(np.linalg.norm(data.sensor("position").data - cdpr.solve(robot, robot.home + AWAY).position))


DRUMS = {"stiffening": (50, 100), "axial_stiffness": 1e3}
RESTING = [
    *((name, {"axial_stiffness": EA}, "discrete") for name, EA in zip(ROBOTS, [*STEPS] * 2, strict=True)),
    *(("pulleys", {"axial_stiffness": EA}, "Euler") for EA in STEPS),
    *(("planar-vertical", {"axial_stiffness": EA}, "implicitfast") for EA in STEPS),
    ("cogiro", DRUMS, "discrete"), ("planar-vertical", DRUMS, "Euler"), ("pulleys", DRUMS, "implicitfast"),
]  # fmt: skip
"""Robots, changes, and MuJoCo's integrators; cables with a nonlinear law are wound on drums."""


@pytest.mark.parametrize(("name", "changes", "integrator"), RESTING)
def test_it_rests_where_solve_says(name, changes, integrator):
    """Wound from one pose to another, with the longest time step that is advised; with its tensions and slack cables.

    Not so with 1 % more gain on one winch, or drums that get the differences of the lengths.
    """
    robot, stiffness = ROBOTS[name].replace(**changes), changes["axial_stiffness"]
    step = STEPS[stiffness] if integrator != "discrete" else 0.01 if stiffness < 1e5 else 0.005
    step = step if robot.cabling.linear else 0.005
    model = model_of(robot, integrator, step)
    data, static = wound(model, controls_of(robot)), cdpr.solve(robot, robot.home + AWAY)
    assert error(robot, data) < AT_REST
    np.testing.assert_allclose(data.actuator_force, static.tensions, rtol=0, atol=1e-9 * stiffness)
    turned = Rotation.from_quat(data.sensor("orientation").data, scalar_first=True)
    assert (turned * static.rotation.inv()).magnitude() < 10 * AT_REST / robot.characteristic_length
    if not robot.cabling.linear:
        naive = robot.rest_lengths(robot.home) - static.rest_lengths
        assert error(robot, wound(model, naive)) > 1e-5
    elif name == "cogiro":
        model.actuator_gainprm[0] *= 1.01
        assert error(robot, wound(model, controls_of(robot))) > 100 * AT_REST


CRANE, FAR = cdpr.load_robot("cogiro-crane"), np.array([1.0, 0, 0])
WITH_MASS = {
    "points": (CRANE.replace(linear_density=0.064), 1e-8, 1e-7),
    "mixed": (CRANE.replace(
        linear_density=[0.064, 0.0, 0.064, 0.064, 0.0, 0.064, 0.0, 0.03],
        pulley_radius=[0.1, 0.1, 0.0, 0.1, 0.0, 0.0, 0.1, 0.1],
        winch_to_exit=[0.0, 6.0, 6.0, 6.0, 0.0, 0.0, 0.0, 3.0],
        reeving=[1, 1, 1, 2, 1, 1, 1, 1],
        stiffening=[*[(0, 0)] * 5, (100, 2e4), (100, 2e4), (0, 0)],
    ), 4e-6, 1e-5),
}  # fmt: skip
"""[m] Errors at the written lengths: 1e-10 at points; with all properties, what the rope behind and the nonlinear law
change in the mean tension, of which the law's part is the largest: measured 3e-6 where all cables have it. And wound by
0.8 m with corrected weights: the rope behind feels another rise of the cable."""


@pytest.mark.parametrize("kind", WITH_MASS)
def test_a_winch_model_of_cables_with_mass_rests_where_solve_says(kind):
    """At the written lengths by itself, and wound elsewhere by ``reset``, which corrects the weights.

    In 4000 steps of 2 ms; after a reset, which puts it where it rests, in a quarter. With the weights of the written
    lengths, the platform is off by more, 3e-5 m measured at points: the negative control.
    """
    robot, written, corrected = WITH_MASS[kind]
    model = mujoco.MjModel.from_xml_string(cdpr.to_mjcf(robot, robot.home, winches=True))
    data = mujoco.MjData(model)
    mujoco.mj_step(model, data, 4000)
    solved = cdpr.solve(robot, robot.home + FAR)
    lengths, wanted = solved.rest_lengths, solved.position
    assert np.linalg.norm(data.body("platform").xpos - cdpr.solve(robot, robot.home).position) < written
    cdpr.reset(model, data, solved.pose, rest_lengths=lengths)
    assert np.abs(data.ctrl - cdpr.winch_controls(robot, robot.home, lengths))[robot.stiffening[:, 0] == 0].max() < 1e-5
    assert data.xfrc_applied.any()
    mujoco.mj_step(model, data, 1000)
    assert np.linalg.norm(data.body("platform").xpos - wanted) < corrected
    data.xfrc_applied[:] = 0
    mujoco.mj_step(model, data, 1000)
    assert 1e-5 < np.linalg.norm(data.body("platform").xpos - wanted) < 5e-4


def test_a_reset_lays_cables_with_mass_as_they_hang():
    """At the equilibrium of statics nothing moves; with a cable's masses displaced by a millimetre something does.

    Masses of grams to 0.2 kg are in cables of hundreds of newtons, where a millimetre is 16 m/s².
    """
    robot = WITH_MASS["mixed"][0].replace(stiffening=(0.0, 0.0))
    model = mujoco.MjModel.from_xml_string(cdpr.to_mjcf(robot, robot.home, winches="speed"))
    data, solved = mujoco.MjData(model), cdpr.solve(robot, robot.home + FAR)
    cdpr.reset(model, data, solved.pose, rest_lengths=solved.rest_lengths)
    assert np.abs(data.qacc).max() < 0.1
    data.qpos[model.joint("z_1_3").qposadr[0]] += 1e-3
    mujoco.mj_forward(model, data)
    assert np.abs(data.qacc).max() > 1


@pytest.mark.parametrize("stiffening", [(0, 0), (50, 100)])
def test_slack_cables_are_drawn_hanging(stiffening):
    """Each slack cable is many pieces in the picture and each taut one a line, also where it was wound."""
    robot = PARALLEL.replace(stiffening=stiffening)
    model = mujoco.MjModel.from_xml_string(
        cdpr.scene_mjcf(robot, "winch.xml"), {"winch.xml": cdpr.to_mjcf(robot, robot.home, winches=True).encode()}
    )
    data = wound(model, controls_of(robot))
    before = model.tendon_group.copy()
    hang(model, data)
    scene = mujoco.MjvScene(model, 2000)
    everything = mujoco.mjtCatBit.mjCAT_ALL
    mujoco.mjv_updateScene(model, data, mujoco.MjvOption(), None, mujoco.MjvCamera(), everything, scene)
    pieces = [geom.objid for geom in scene.geoms[: scene.ngeom] if geom.objtype == mujoco.mjtObj.mjOBJ_TENDON]
    static = cdpr.solve(robot, robot.home + AWAY)
    assert 0 < static.slack.sum() < robot.cables
    for i, slack in enumerate(static.slack, start=1):
        line, chain = (pieces.count(model.tendon(f"{kind}_{i}").id) for kind in ("cable", "rope"))
        assert (line > 0, chain > 10) == ((False, True) if slack else (True, False))
        if slack:
            length = model.tendon_lengthspring[model.tendon(f"rope_{i}").id, 1]
            rounding = 1e-12 if robot.cabling.linear else 1e-4  # a drum says l (L/l0 - 1), not L - l0
            assert length == pytest.approx(static.rest_lengths[i - 1], abs=rounding)
    hang(model, wound(model, np.zeros(model.nu)))  # in the middle all are taut
    np.testing.assert_array_equal(model.tendon_group, before)


def test_controls_cover_the_workspace_and_say_the_lengths():
    """L/(1 + u) is the rest length that was asked for, one pose or many, and lies in the model's ctrlrange."""
    large = COGIRO.replace(pulley_radius=0.15, pulley_axis=(0, 0, 1))  # half a metre of cable may lie on such a wheel
    for robot in (*ROBOTS.values(), large):
        model = model_of(robot)
        poses = np.random.default_rng(0).uniform(*robot.workspace, (300, 3))
        wanted = cdpr.Problems.of(robot, poses).rest_lengths
        wanted = wanted[np.isfinite(wanted).all(1)]  # cables over large wheels have no way to some places
        controls = cdpr.winch_controls(robot, robot.home, wanted)
        np.testing.assert_allclose(robot.rest_lengths(robot.home) / (1 + controls), wanted, rtol=1e-14)
        np.testing.assert_array_equal(controls[0], cdpr.winch_controls(robot, robot.home, wanted[0]))
        assert ((model.actuator_ctrlrange[:, 0] < controls) & (controls < model.actuator_ctrlrange[:, 1])).all()
    drums = COGIRO.replace(stiffening=(50, 100))  # metres that are wound in: zero at the pose, both ways from there
    wound_in = drums.rest_lengths(drums.home) - cdpr.Problems.of(drums, poses[:10]).rest_lengths
    low, high = model_of(drums).actuator_ctrlrange.T
    assert (wound_in < 0).any()
    assert ((low < wound_in) & (wound_in < high)).all()
    pose = COGIRO.home.copy()  # a pose that is changed in place is another pose
    assert np.abs(cdpr.winch_controls(COGIRO, pose, COGIRO.rest_lengths(COGIRO.home))).max() == 0
    pose += AWAY
    assert np.abs(cdpr.winch_controls(COGIRO, pose, COGIRO.rest_lengths(COGIRO.home + AWAY))).max() == 0


def test_the_guide_beside_the_model_runs(tmp_path, monkeypatch, capsys):
    """As printed, in the folder that ``cdpr-sim models --winches`` writes."""
    assert run("models", "cogiro", "--winches", "-o", str(tmp_path)).exit_code == 0
    monkeypatch.chdir(tmp_path / "cogiro")
    (block,) = re.findall(r"```python\n(.*?)```", Path("README.md").read_text(encoding="utf-8"), flags=re.DOTALL)
    names: dict = {}
    exec(block, names)
    assert names["data"].sensor("cdpr/tension_1").data[0] > 0
    (reset,) = re.findall(r"Reset: `(cdpr\.reset\(.*?\))`", Path("README.md").read_text(encoding="utf-8"))
    home = cdpr.load_robot("cogiro").home
    eval(reset, names | {"cdpr": cdpr, "pose": home})
    np.testing.assert_allclose(names["data"].sensor("cdpr/position").data, home, rtol=0, atol=1e-12)
    assert not names["data"].warning.number.any()
    assert "[" in capsys.readouterr().out

"""A model that is driven by its winches: its actuators are the law of its cables, and it rests where ``solve`` says."""

import re
import sys
import warnings
from pathlib import Path

import mujoco
import numpy as np
import pytest
from inputs import run
from sample_problems import VARIED
from scipy.spatial.transform import RigidTransform, Rotation

import cdpr_sim as cdpr
from cdpr_sim.physics.mjcf import place, scene_mjcf, to_mjcf
from cdpr_sim.physics.winches import hang, reach

MODELS = Path(__file__).parents[1] / "models"

AT_REST = 1e-9
"""[m] Measured 1e-10 and less."""

SAME_FORCE = 1e-14
"""Of EA (1 + u) l/L: the terms of the law are that large, and are added in another order."""

STEPS = {1e3: 5e-3, 1e4: 1e-3, 1e5: 5e-4}
"""EA [N], and the longest time step [s] for it of integrators that do not know springs."""

WINDING, CALMING = 2.0, 13.0
"""[s]"""

AWAY = np.array([-0.1, 0, -0.05])
"""[m] From the middle of the workspace, where models are written, to where they are wound."""

DEMOBOTS = ("cogiro", "parallel", "planar-horizontal", "planar-vertical", "two-cable")
ROBOTS = {name: cdpr.load_robot(name) for name in DEMOBOTS}
ROBOTS["pulleys"] = ROBOTS["cogiro"].replace(pulley_radius=0.01, pulley_axis=(0, 0, 1))


def model_of(
    robot: cdpr.Robot, *, integrator: str = "discrete", step: float = 0.005, force: float | None = None
) -> mujoco.MjModel:
    """Written in the middle of its workspace."""
    model = mujoco.MjModel.from_xml_string(to_mjcf(robot, robot.home, winches=True, winch_force=force))
    model.opt.timestep, model.opt.integrator = step, getattr(mujoco.mjtIntegrator, f"mjINT_{integrator.upper()}")
    return model


def controls_of(robot: cdpr.Robot) -> np.ndarray:
    """That wind it to ``AWAY``."""
    return cdpr.winch_controls(robot, robot.home, robot.rest_lengths(robot.home + AWAY))


def wound(model: mujoco.MjModel, controls: np.ndarray) -> mujoco.MjData:
    """Wound evenly from the keyframe, then left alone."""
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    while data.time < WINDING:
        data.ctrl = controls * min(1, data.time / WINDING)
        mujoco.mj_step(model, data)
    data.ctrl = controls
    mujoco.mj_step(model, data, round(CALMING / model.opt.timestep))
    assert not data.warning.number.any()
    return data


def error(robot: cdpr.Robot, data: mujoco.MjData, prefix: str = "") -> float:
    """[m] From where ``solve`` says that the platform rests."""
    position = data.sensor(f"{prefix}position").data
    return float(np.linalg.norm(position - cdpr.solve(robot, robot.home + AWAY).position))


@pytest.mark.parametrize("robot", ROBOTS.values(), ids=ROBOTS)
def test_each_actuator_is_the_one_sided_law(robot):
    """At any pose and control, the force is EA (l - l0)/l0 where that is positive, and else zero; it never pushes."""
    model, random = model_of(robot, force=np.inf), np.random.default_rng(0)
    data, written = mujoco.MjData(model), robot.rest_lengths(robot.home)
    forces = []
    for pose in random.uniform(*robot.workspace, (50, 3)):
        place(model, data, robot, robot.pose(pose))
        data.ctrl = random.uniform(-0.3, 0.5, model.nu)
        mujoco.mj_forward(model, data)
        lengths, rest = robot.rest_lengths(pose), written / (1 + data.ctrl)
        law = robot.axial_stiffness * np.maximum(lengths - rest, 0) / rest
        found = np.array([data.sensor(f"tension_{i + 1}").data[0] for i in range(robot.cables)])
        np.testing.assert_allclose(found, law, rtol=0, atol=1e4 * 4 * SAME_FORCE * max(1, (lengths / rest).max()))
        np.testing.assert_array_equal(found, data.actuator_force)
        forces.append(found)
    assert np.min(forces) == 0
    assert (np.array(forces) > 0).mean() > 0.1


@pytest.mark.parametrize(
    ("name", "integrator", "stiffness"),
    [
        *((name, "discrete", stiffness) for name, stiffness in zip(ROBOTS, [*STEPS] * 2, strict=True)),
        *(("pulleys", "Euler", stiffness) for stiffness in STEPS),
        *(("planar-vertical", "implicitfast", stiffness) for stiffness in STEPS),
    ],
)
def test_it_rests_where_solve_says(name, integrator, stiffness):
    """Wound from one pose to another, with the longest time step that is advised."""
    robot = ROBOTS[name].replace(axial_stiffness=stiffness)
    step = STEPS[stiffness] if integrator != "discrete" else 0.01 if stiffness < 1e5 else 0.005
    data = wound(model_of(robot, integrator=integrator, step=step), controls_of(robot))
    assert error(robot, data) < AT_REST
    static = cdpr.solve(robot, robot.home + AWAY)
    np.testing.assert_allclose(data.actuator_force, static.tensions, rtol=0, atol=1e-9 * stiffness)
    turned = Rotation.from_quat(data.sensor("orientation").data, scalar_first=True)
    assert (turned * static.rotation.inv()).magnitude() < 10 * AT_REST / robot.characteristic_length


@pytest.mark.parametrize("name", VARIED)
def test_the_catalogue_as_written_rests_where_solve_says(name):
    """From its file, nudged once, as a symmetric one may sit between two rests; ``solve`` is asked from where it is."""
    robot = cdpr.load_robot(name)
    model = mujoco.MjModel.from_xml_path(str(MODELS / name / "winch.xml"))
    data = wound(model, np.zeros(model.nu))
    data.qvel += 1e-3 * np.random.default_rng(0).normal(size=model.nv)
    apart = np.inf
    while not apart < AT_REST and data.time < 200:  # softly held ones take their time
        mujoco.mj_step(model, data, round(10 / model.opt.timestep))
        turned = Rotation.from_quat(data.sensor("orientation").data, scalar_first=True)
        here = RigidTransform.from_components(data.sensor("position").data, turned)
        static = cdpr.solve(robot, here, robot.rest_lengths(robot.home))
        shift = np.linalg.norm(here.translation - static.position)
        apart = shift + robot.characteristic_length * (turned * static.rotation.inv()).magnitude()
    assert apart < AT_REST
    assert np.abs(data.qvel).max() < 1e-6


@pytest.mark.parametrize("integrator", ["discrete", "Euler", "implicitfast"])
@pytest.mark.parametrize("name", ["cogiro", "planar-vertical", "pulleys"])
def test_cables_that_stiffen_are_wound_on_drums(name, integrator):
    """They come to the same rest and tensions as well; not so with the lengths' differences for controls."""
    robot = ROBOTS[name].replace(stiffening=(50, 100), axial_stiffness=1e3)
    static = cdpr.solve(robot, robot.home + AWAY)
    model = model_of(robot, integrator=integrator)
    data = wound(model, controls_of(robot))
    assert error(robot, data) < AT_REST
    np.testing.assert_allclose(data.actuator_force, static.tensions, rtol=0, atol=1e-6)
    linear = cdpr.solve(robot.replace(stiffening=(0, 0)), robot.home + AWAY)
    assert np.linalg.norm(linear.position - static.position) > 1e-5  # the law matters
    naive = robot.rest_lengths(robot.home) - static.rest_lengths
    assert error(robot, wound(model, naive)) > 1e-5


def test_a_gain_that_is_one_percent_off_is_noticed():
    """Negative control: one winch of eight, by 1 % of its stiffness."""
    robot = ROBOTS["cogiro"]
    model = model_of(robot)
    assert error(robot, wound(model, controls_of(robot))) < AT_REST
    model.actuator_gainprm[0] *= 1.01
    assert error(robot, wound(model, controls_of(robot))) > 100 * AT_REST


def test_a_winch_that_pushes_is_noticed():
    """Negative control: cables of `parallel` that go slack at the edge of its workspace, and may not."""
    robot = ROBOTS["parallel"]
    static = cdpr.solve(robot, robot.home + AWAY)
    assert static.slack.any()
    model = model_of(robot)
    model.actuator_forcerange[:, 0] = -model.actuator_forcerange[:, 1]
    data = wound(model, controls_of(robot))
    assert data.actuator_force.min() < 0
    assert error(robot, data) > 1000 * AT_REST


def test_a_tilted_pose_is_where_it_starts():
    """Without the keyframe, too; and the ball joint counts from there."""
    robot = ROBOTS["cogiro"]
    pose = RigidTransform.from_components(robot.home, Rotation.from_rotvec([0.1, -0.2, 0.3]))
    model = mujoco.MjModel.from_xml_string(to_mjcf(robot, pose, winches=True))
    data = mujoco.MjData(model)
    for start in (mujoco.mj_resetData, lambda *both: mujoco.mj_resetDataKeyframe(*both, 0)):
        start(model, data)
        mujoco.mj_forward(model, data)
        np.testing.assert_allclose(data.body("platform").xmat.reshape(3, 3), pose.rotation.as_matrix(), atol=1e-15)
        np.testing.assert_allclose(data.body("platform").xpos, pose.translation, atol=1e-15)
    other = RigidTransform.from_components(robot.home + AWAY, Rotation.from_rotvec([-0.3, 0.2, 0.1]))
    place(model, data, robot, other)
    mujoco.mj_kinematics(model, data)
    np.testing.assert_allclose(data.body("platform").xmat.reshape(3, 3), other.rotation.as_matrix(), atol=1e-15)
    data.qvel[:3] = 1, 2, 3
    mujoco.mj_step1(model, data)
    np.testing.assert_allclose(data.body("platform").cvel[3:], [1, 2, 3], rtol=1e-12)


@pytest.mark.parametrize("name", ["parallel", "planar-vertical"])
def test_attached_to_another_world_nothing_is_lost(name):
    """On a moved and turned frame of a world with the default options, on a body of it even, the rest is the same."""
    robot = ROBOTS[name]
    world, part = mujoco.MjSpec(), mujoco.MjSpec.from_string(to_mjcf(robot, robot.home, winches=True))
    tower = world.worldbody.add_body(pos=[1, 2, 3])
    frame = tower.add_frame(quat=Rotation.from_rotvec([0, 0, 0.5]).as_quat(scalar_first=True))
    world.attach(part, prefix="cdpr/", frame=frame)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # MuJoCo 4 says that the world's integrator is kept
        model = world.compile()
    model.opt.timestep = 1e-3
    assert model.opt.integrator == mujoco.mjtIntegrator.mjINT_EULER
    assert model.key(0).name == "cdpr/commanded"
    assert error(robot, wound(model, controls_of(robot)), "cdpr/") < AT_REST
    model.dof_damping[:] = 0
    model.actuator_biasprm[:, 2] = 0  # the negative control: nothing calms it
    assert error(robot, wound(model, controls_of(robot)), "cdpr/") > 100 * AT_REST


@pytest.mark.parametrize("stiffening", [(0, 0), (50, 100)])
def test_slack_cables_are_drawn_hanging(stiffening):
    """Each slack cable is many pieces in the picture and each taut one a line, also where it was wound."""
    robot = ROBOTS["parallel"].replace(stiffening=stiffening)
    model = mujoco.MjModel.from_xml_string(
        scene_mjcf(robot, "winch.xml"), {"winch.xml": to_mjcf(robot, robot.home, winches=True).encode()}
    )
    data = wound(model, controls_of(robot))
    before = model.tendon_group.copy()
    hang(model, data)
    scene = mujoco.MjvScene(model, 2000)
    everything = mujoco.mjtCatBit.mjCAT_ALL
    mujoco.mjv_updateScene(model, data, mujoco.MjvOption(), None, mujoco.MjvCamera(), everything, scene)
    pieces = [geom.objid for geom in scene.geoms[: scene.ngeom] if geom.objtype == mujoco.mjtObj.mjOBJ_TENDON]
    slack = cdpr.solve(robot, robot.home + AWAY).slack
    assert slack.any()
    assert not slack.all()
    for i in range(robot.cables):
        line, chain = (pieces.count(model.tendon(f"{kind}_{i + 1}").id) for kind in ("cable", "rope"))
        assert (line > 0, chain > 10) == ((False, True) if slack[i] else (True, False))
        if slack[i]:
            length = model.tendon_lengthspring[model.tendon(f"rope_{i + 1}").id, 1]
            rounding = 1e-12 if robot.cabling.linear else 1e-4  # a drum says l (L/l0 - 1), not L - l0
            assert length == pytest.approx(robot.rest_lengths(robot.home + AWAY)[i], abs=rounding)
    hang(model, wound(model, np.zeros(model.nu)))  # in the middle all are taut
    np.testing.assert_array_equal(model.tendon_group, before)


def test_ropes_that_are_drawn_change_no_force():
    """They are springs to MuJoCo: without them each step is the same to the last bit."""
    robot = ROBOTS["parallel"]
    text = to_mjcf(robot, robot.home, winches=True)
    bare = re.sub(r'<spatial name="rope_.*?</spatial>', "", text, flags=re.DOTALL)
    assert bare.count("<spatial") == robot.cables
    one, other = (mujoco.MjModel.from_xml_string(each) for each in (text, bare))
    np.testing.assert_array_equal(wound(one, controls_of(robot)).qpos, wound(other, controls_of(robot)).qpos)


def test_controls_cover_the_workspace_and_say_the_lengths():
    """L/(1 + u) is the rest length that was asked for, one pose or many, and lies in the model's ctrlrange."""
    cogiro = ROBOTS["cogiro"]
    large = cogiro.replace(pulley_radius=0.15, pulley_axis=(0, 0, 1))  # half a metre of cable may lie on such a wheel
    for robot in (*ROBOTS.values(), large):
        model = model_of(robot)
        poses = np.random.default_rng(0).uniform(*robot.workspace, (300, 3))
        wanted = cdpr.Problems.of(robot, poses).rest_lengths
        wanted = wanted[np.isfinite(wanted).all(1)]  # cables over large wheels have no way to some places
        controls = cdpr.winch_controls(robot, robot.home, wanted)
        np.testing.assert_allclose(robot.rest_lengths(robot.home) / (1 + controls), wanted, rtol=1e-14)
        np.testing.assert_array_equal(controls[0], cdpr.winch_controls(robot, robot.home, wanted[0]))
        assert ((model.actuator_ctrlrange[:, 0] < controls) & (controls < model.actuator_ctrlrange[:, 1])).all()
    drums = cogiro.replace(stiffening=(50, 100))  # metres that are wound in: zero at the pose, both ways from there
    wound_in = drums.rest_lengths(drums.home) - cdpr.Problems.of(drums, poses[:10]).rest_lengths
    low, high = model_of(drums).actuator_ctrlrange.T
    assert (wound_in < 0).any()
    assert ((low < wound_in) & (wound_in < high)).all()


def test_a_control_loop_computes_the_winches_of_its_model_once(monkeypatch):
    """Controls for one pose of a model need its ranges once; a pose that is changed in place is another pose."""
    module, calls = sys.modules[cdpr.winch_controls.__module__], []
    monkeypatch.setattr(module, "reach", lambda *given: calls.append(given) or reach(*given))
    robot = cdpr.load_robot("cogiro")
    pose, lengths = robot.home.copy(), robot.rest_lengths(robot.home + AWAY)
    first = [cdpr.winch_controls(robot, pose, lengths) for _ in range(5)]
    assert len(calls) == 1
    pose += AWAY
    assert np.abs(cdpr.winch_controls(robot, pose, lengths)).max() == 0
    np.testing.assert_array_equal(cdpr.winch_controls(robot, robot.home, lengths), first[0])
    assert len(calls) == 2


@pytest.mark.parametrize(
    ("lengths", "message"),
    [
        (np.full(8, 0.0), r"rest_lengths: found 0 m for cable 1, expected 0\.0\d+ to 1\.0\d+ m"),
        (np.r_[np.full(7, 0.5), 9.0], "rest_lengths: found 9 m for cable 8, expected .* to .* m"),
        (np.full(8, np.nan), "rest_lengths: found nan"),
        (np.full(7, 0.5), r"rest_lengths: found an array of shape \(7,\), expected \(..., 8\)"),
        ("long", "rest_lengths: found 'long'"),
    ],
)
def test_lengths_that_no_winch_can_let_out_are_refused(lengths, message):
    """One sentence: the field, what was found, what is expected."""
    robot = ROBOTS["cogiro"]
    with pytest.raises(cdpr.InvalidInput, match=message):
        cdpr.winch_controls(robot, robot.home, lengths)


def test_view_without_a_display_says_so(monkeypatch):
    """One sentence, and the exit status of input that cannot be right."""
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    result = run("view", "cogiro")
    assert result.exit_code == 2
    assert result.stderr.count("\n") == 1
    assert "display: found none" in result.stderr


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

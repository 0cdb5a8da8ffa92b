"""``settle_model`` and ``holding_controls`` on models with closed forms; each answer is judged by ``mj_inverse``."""

import re

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import cdpr_sim as cdpr
from cdpr_sim.anymodel.agreement import agreement
from cdpr_sim.anymodel.balance import Balance
from cdpr_sim.anymodel.forces import RestForces
from cdpr_sim.anymodel.judged import Judged

G = 9.81

JUDGED = 1e-6
"""Largest force that inverse dynamics may need at rest, as a fraction of the largest force of gravity or actuators."""

PENDULUM = """<body name="arm"><joint name="hinge" axis="0 1 0" {joint}/>
<geom type="sphere" size=".05" pos=".5 0 0" mass="2"/></body>"""

FREE_BALL = '<body name="target" pos="3 0 1"><freejoint name="loose"/><geom size=".1"/></body>'

CORNERS = ((0.5, 0.5), (-0.5, 0.5), (0.5, -0.5), (-0.5, -0.5))


def model_of(body: str, rest: str = "", option: str = "") -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_string(f"<mujoco>{option}<worldbody>{body}</worldbody>{rest}</mujoco>")


def on_slope(slope: float, cone: str = "pyramidal") -> mujoco.MjModel:
    """A box on a plane with a coefficient of friction of 0.5; gravity is tilted, so that tan(angle) is ``slope``."""
    angle = np.arctan(slope)
    gravity = f"{G * np.sin(angle):.17g} 0 {-G * np.cos(angle):.17g}"
    box = '<body name="box" pos="0 0 .1"><freejoint name="box"/><geom type="box" size=".1 .1 .1" friction=".5"/></body>'
    floor = '<geom name="floor" type="plane" size="1 1 1" friction=".5"/>'
    return model_of(floor + box, option=f'<option gravity="{gravity}" cone="{cone}"/>')


def box_on_tendons() -> mujoco.MjModel:
    """Thread 971: a box of 1 kg on four upright tendons that have nothing but a range."""
    above = "".join(f'<site name="top{i}" pos="{x} {y} 2"/>' for i, (x, y) in enumerate(CORNERS))
    below = "".join(f'<site name="low{i}" pos="{x} {y} 0"/>' for i, (x, y) in enumerate(CORNERS))
    box = f'<body pos="0 0 1"><freejoint name="box"/><geom type="box" size=".5 .5 .1" mass="1"/>{below}</body>'
    one = '<spatial name="t{0}" limited="true" range="0 1"><site site="top{0}"/><site site="low{0}"/></spatial>'
    return model_of(above + box, f"<tendon>{''.join(one.format(i) for i in range(4))}</tendon>")


def needed(model: mujoco.MjModel, found: cdpr.ModelEquilibrium, start: mujoco.MjData | None = None) -> float:
    """What ``mj_inverse`` needs beside actuators, applied forces and the friction that holds; by the largest load."""
    data = mujoco.MjData(model)
    if start is not None:
        data.qfrc_applied[:] = start.qfrc_applied
    found.write(data)
    mujoco.mj_forward(model, data)
    actuators, data.qacc[:] = data.qfrc_actuator.copy(), 0
    mujoco.mj_inverse(model, data)
    left = data.qfrc_inverse - actuators - data.qfrc_applied - found.friction
    load = np.abs([data.qfrc_bias, actuators, data.qfrc_applied]).max(initial=1e-3 * model.body_mass.sum() * G)
    return float(np.abs(left).max() / load)


LIGHT = PENDULUM.replace('mass="2"', 'mass="1e-3"').replace("arm", "light").replace("hinge", "small")
HEAVY = PENDULUM.replace('mass="2"', 'mass="1e3"').replace('name="arm"', 'name="heavy" pos="0 5 0"')
LIFT = '<body><joint name="lift" type="slide" axis="0 0 1"{}/><geom size=".1" mass="1"/></body>'
SERVO = '<actuator><general joint="lift" gainprm="100" biastype="affine" biasprm="0 -100 0"{}/></actuator>'
SPRUNG = LIFT.format(' stiffness="100" damping="9"')
DRIVEN = '<actuator><general joint="lift" gainprm="20" dyntype="{}"/></actuator>'

BALANCES = {  # a model, the force on its first coordinate, its control, and what its balance leaves, of a load
    "a pendulum": (model_of(PENDULUM.format(joint="")), 0, (), np.cos),
    "a pendulum that needs ten minutes": (model_of(PENDULUM.format(joint='damping="1000"')), 0, (), np.cos),
    "a spring and a weight": (
        model_of(PENDULUM.format(joint='stiffness="30"')), 0, (), lambda q: 30 * q - 2 * G * 0.5 * np.cos(q),
    ),
    **{
        f"a weight on {k:g} N/m": (model_of(LIFT.format(f' stiffness="{k}"')), 0, (), lambda q, k=k: 1 + k * q / G)
        for k in (1e0, 1e3, 1e6, 1e9)
    },
    "a gram beside a ton": (
        model_of(LIGHT.format(joint='stiffness="1e-3"') + HEAVY.format(joint="")), 0, (),
        lambda q: [q[0] - G * 0.5 * np.cos(q[0]), np.cos(q[1])],
    ),
    "a servo and a force": (
        model_of(LIFT.format(""), SERVO.format("")), 4, (0.3,), lambda q: 100 * (0.3 - q) / (G - 4) - 1,
    ),
    "a filter": (
        model_of(LIFT.format(""), SERVO.format(' dyntype="filter" dynprm="1"')), 0, (0.3,),
        lambda q: 100 * (0.3 - q) / G - 1,
    ),
    "a filter beyond its range": (
        model_of(SPRUNG, DRIVEN.format('filterexact" dynprm="0.1" actlimited="true" actrange="0 1')), 0, (3.0,),
        lambda q: (20 * 1.0 - G) / 100 - q,
    ),
    "a filter beyond its control's range": (
        model_of(SPRUNG, DRIVEN.format('filter" dynprm="0.1" ctrlrange="0 2')), 0, (3.0,),
        lambda q: (20 * 2.0 - G) / 100 - q,
    ),
    "nothing that moves": (model_of('<geom size=".1"/>'), 0, (), lambda q: q),
}  # fmt: skip


@pytest.mark.parametrize("name", BALANCES)
def test_a_model_rests_where_the_closed_form_says(name):
    """At a stable equilibrium, by both ways and by ``mj_inverse``; what is given is not changed."""
    model, force, ctrl, left = BALANCES[name]
    data = mujoco.MjData(model)
    data.qfrc_applied[:1] = force
    found = cdpr.settle_model(model, data, ctrl=[*ctrl] or None)
    assert np.abs(left(found.qpos)).max(initial=0) < 1e-7
    assert model.nv == 0 or needed(model, found, data) < JUDGED
    assert found.stable
    assert found.agreement is None or found.agreement.agrees
    assert not data.ctrl.any()


def test_a_pendulum_is_found_by_motion_and_swings_as_its_inertia_says():
    """Its squared frequency is g/l of the compound pendulum, with the sphere's own inertia."""
    found = cdpr.settle_model(BALANCES["a pendulum"][0])
    inertia = 2 * 0.5**2 + 0.4 * 2 * 0.05**2
    assert found.stiffness_eigenvalues == pytest.approx(2 * G * 0.5 / inertia, rel=1e-6)
    assert (found.way, found.agreement.newton_from) == ("motion", "start")  # type: ignore[union-attr]
    assert found.creep < 1e-6
    slow = cdpr.settle_model(BALANCES["a pendulum that needs ten minutes"][0])
    assert slow.way == "motion"
    assert slow.iterations["time steps"] < 3000


def test_a_start_at_rest_is_returned_with_its_stability():
    """An upright pendulum stays, and is unstable; hanging, it stays and is stable."""
    model, data = model_of(PENDULUM.format(joint="")), None
    for angle, stable in ((-np.pi / 2, False), (np.pi / 2, True)):
        data = mujoco.MjData(model)
        data.qpos[:] = angle
        found = cdpr.settle_model(model, data)
        assert found.way == "start"
        assert found.qpos == data.qpos
        assert found.stable is stable


def test_a_box_on_four_limited_tendons_hangs_at_a_quarter_of_its_weight_each():
    """Thread 971 of MuJoCo: 2.4525 N each, all of it in the limit."""
    model = box_on_tendons()
    found = cdpr.settle_model(model)
    assert found.tendon_tensions.total == pytest.approx(np.full(4, G / 4), rel=1e-9)
    assert found.tendon_tensions.limit == pytest.approx(np.full(4, G / 4), rel=1e-9)
    assert found.agreement is not None
    assert found.agreement.agrees
    assert needed(model, found) < JUDGED


def test_poses_are_compared_by_the_tensions_of_nonlinear_tendons():
    """x (k + k2 x), by hand: the linear part alone would be 2 N off."""
    model = mujoco.MjModel.from_xml_string(
        '<mujoco><worldbody><site name="hook" pos="0 0 1"/><body><joint type="slide" axis="0 0 1"/>'
        '<geom size="0.1" mass="1"/><site name="load"/></body></worldbody><tendon>'
        '<spatial stiffness="100 1000" springlength="0 0.9"><site site="hook"/><site site="load"/></spatial>'
        "</tendon></mujoco>"
    )
    forces = RestForces(model, mujoco.MjData(model))
    judged = Judged.at(Balance(forces, True), np.array([0.0]), np.arange(1))
    found = agreement(judged, np.array([-0.01]), "start")  # stretched by 0.1 and by 0.11 m
    assert found.tension_error == pytest.approx(0.11 * (100 + 1000 * 0.11) - 0.1 * (100 + 1000 * 0.1), rel=1e-12)
    assert not found.agrees


@pytest.mark.parametrize("cone", ["pyramidal", "elliptic"])
def test_friction_holds_a_box_on_a_slope_with_the_share_of_coulombs_law(cone):
    """Slope over coefficient: 0.4 / 0.5; MuJoCo's own friction creeps there, and the result says so."""
    model = on_slope(0.4, cone)
    found = cdpr.settle_model(model)
    assert found.friction_share == pytest.approx(0.8, abs=1e-3)  # four corners share the load by their damping
    weight = model.body_mass.sum() * G
    assert found.friction[0] == pytest.approx(-weight * np.sin(np.arctan(0.4)), rel=1e-6)
    assert sum(one.normal for one in found.contact_forces) == pytest.approx(weight * np.cos(np.arctan(0.4)), rel=1e-6)
    assert found.creep > 1e-4
    assert found.notes
    assert needed(model, found) < JUDGED
    assert found.agreement is not None
    assert found.agreement.agrees


def test_a_box_beyond_the_friction_limit_slides():
    """At 0.49 friction of 0.5 holds, at 0.51 it does not; without friction, 0.1 slides."""
    assert cdpr.settle_model(on_slope(0.49)).friction_share == pytest.approx(0.98, abs=1e-3)
    with pytest.raises(cdpr.NotSettled, match="slides"):
        cdpr.settle_model(on_slope(0.51))
    with pytest.raises(cdpr.NotSettled):
        cdpr.settle_model(on_slope(0.1), friction=False, most_steps=2000)


def test_a_body_left_out_does_not_keep_the_others_from_rest():
    """Neither by falling nor by touching: the ball lies in the way of the pendulum."""
    ball = FREE_BALL.replace("3 0 1", "0 0 -.5")
    model = model_of(PENDULUM.format(joint="") + ball)
    found = cdpr.settle_model(model, ignore=["target"])
    assert found.qpos[0] == pytest.approx(np.pi / 2, abs=1e-9)
    assert found.qpos[1:4] == pytest.approx([0, 0, -0.5], abs=0)
    assert not found.contact_forces
    with pytest.raises(cdpr.CdprError, match="target"):
        cdpr.settle_model(model, ignore=["targt"])


def test_neutral_directions_are_named():
    """A cart on a level rail stays anywhere: not stable, and the rail is named; its hanging arm is stable."""
    cart = (
        '<body><joint name="rail" type="slide" axis="1 0 0"/><geom size=".1"/>' + PENDULUM.format(joint="") + "</body>"
    )
    found = cdpr.settle_model(model_of(cart, option='<option><flag contact="disable"/></option>'))
    assert found.neutral == ("rail",)
    assert not found.stable
    assert found.agreement is not None
    assert found.agreement.agrees


ONE_HINGE = '<body><joint name="h"/><geom size=".1" pos="1 0 0"/></body>'
HINGE = model_of(ONE_HINGE, '<actuator><motor joint="h"/></actuator>')
OTHER = mujoco.MjData(model_of('<body mocap="true"/><body><joint/><geom size="1"/></body>'))
PID = """<extension><plugin plugin="mujoco.pid"><instance name="pid"><config key="kp" value="4"/>
<config key="ki" value="4"/><config key="kd" value="0.4"/></instance></plugin></extension>"""

UNDECIDED = {
    "delay": (ONE_HINGE, '<actuator><motor name="m" joint="h" delay=".1" nsample="10"/></actuator>', "'m'.*delay"),
    "PID controller": (ONE_HINGE, '<actuator><pid name="m" joint="h" kp="1" ki="1"/></actuator>', "'m'.*PID"),
    "PID plugin": (
        ONE_HINGE, f'{PID}<actuator><plugin name="m" joint="h" plugin="mujoco.pid" instance="pid" actdim="1"/>'
        "</actuator>", "actuator 'm' with a plugin that has a state",
    ),
    "DC motor": (
        ONE_HINGE,
        '<actuator><dcmotor name="m" joint="h" motorconst="0.05" resistance="2" inductance="1e-3"/></actuator>',
        "'m'.*DC motor",
    ),
    "plastic tendon": (
        ONE_HINGE,
        '<tendon><fixed name="t" stiffness="10" springyield="1"><joint joint="h" coef="1"/></fixed></tendon>',
        "plastic tendon 't'",
    ),
    "flex": (
        '<body name="frame" pos="0 0 1"><flexcomp name="cloth" type="grid" count="3 3 1" spacing=".1 .1 .1" '
        'radius=".01" mass="1"><edge equality="true"/></flexcomp></body>', "", "flex 'cloth'",
    ),
}  # fmt: skip
"""Elements whose forces depend on more than pose and controls; MuJoCo's PID plugin integrates its error in ``act``."""


@pytest.mark.parametrize("name", UNDECIDED)
def test_what_statics_does_not_decide_is_refused_by_name_and_noted_in_a_diagnosis(name):
    """One sentence with the element."""
    *parts, words = UNDECIDED[name]
    model = model_of(*parts)
    with pytest.raises(cdpr.InvalidInput, match=words):
        cdpr.settle_model(model)
    assert re.search(words, cdpr.diagnose_model(model).notes[0])


def spoiled(field: str) -> mujoco.MjData:
    """A state that is not finite."""
    data = mujoco.MjData(HINGE)
    getattr(data, field)[:] = np.nan
    return data


def held(model, data=None, **options):
    return cdpr.holding_controls(model, [0.0], data, **options)


SEARCHES = cdpr.settle_model, cdpr.diagnose_model, held

REFUSED = [
    *((lambda ask=ask: ask(HINGE, OTHER), r"^data: found \w+ of \d numbers, expected that of the model, \d$")
      for ask in SEARCHES),
    *((lambda ask=ask, field=field: ask(HINGE, spoiled(field)), f"^data: found {field} that is not finite")
      for ask in SEARCHES for field in ("qpos", "ctrl", "qfrc_applied")),
    *((lambda ask=ask: ask(HINGE, ctrl=[1.0, 2.0]), "ctrl: found an array of shape") for ask in SEARCHES[:2]),
    *((lambda ask=ask: ask(HINGE, ignore=["nobody"]), "nobody") for ask in SEARCHES[:2]),
    *((lambda ask=ask: ask(HINGE, seconds=0), "seconds: found 0 s, expected more than 0") for ask in SEARCHES[:2]),
    (lambda: cdpr.tendon_tensions(HINGE, mujoco.MjData(model_of(""))), "data: found that of another model, with 0 coo"),
    (lambda: cdpr.tendon_tensions(one := box_on_tendons(), not_finite(one)),
     "forces that are not finite on tendon 't0'"),
]  # fmt: skip
"""Of values that no type forbids; ``test_wrong_types.py`` has wrong types."""


def not_finite(model: mujoco.MjModel) -> mujoco.MjData:
    data = mujoco.MjData(model)
    data.qpos[:] = np.nan
    return data


@pytest.mark.parametrize(("ask", "words"), REFUSED)
def test_wrong_input_is_refused_in_one_sentence(ask, words):
    """By the name of the argument, before any search."""
    with pytest.raises(cdpr.CdprError, match=words) as refused:
        ask()
    assert "\n" not in str(refused.value)


def test_a_softened_time_constant_is_said():
    """``refsafe`` makes the equilibrium depend on the time step; with longer constants there is no such note."""
    for constant, said in ((1e-3, True), (0.02, False)):
        stop = f'limited="true" range="-90 10" solreflimit="{constant} 1"'
        found = cdpr.settle_model(model_of(PENDULUM.format(joint=stop)))
        assert any("time step" in note for note in found.notes) is said


@pytest.mark.slow
def test_a_chain_of_many_bodies_is_settled():
    """Of 160 hinges, above what dense formulas are quick at: each link hangs down."""
    links = "".join(
        '<body pos="0 0 -.1"><joint axis="0 1 0" ref="0"/><geom size=".01" pos="0 0 -.05"/>' for _ in range(160)
    )
    model = model_of(links + "</body>" * 160, option='<option><flag contact="disable"/></option>')
    data = mujoco.MjData(model)
    data.qpos[0] = 0.2
    found = cdpr.settle_model(model, data)
    assert np.abs(np.sin(found.qpos)).max() < 1e-7  # some links have turned over
    assert np.all(np.cos(found.qpos) > 0)
    assert found.stable
    assert needed(model, found) < JUDGED


def test_holding_controls_hold_a_pose_or_say_what_is_missing():
    """A motor of gear 2 gives half of the torque; with a range it gives what it can, and the rest is missing."""
    for limit, control in ((100.0, G / 2), (2.0, 2.0)):
        motor = f'<motor joint="hinge" gear="-2" ctrlrange="-{limit} {limit}" ctrllimited="true"/>'
        model = model_of(PENDULUM.format(joint=""), f"<actuator>{motor}</actuator>")
        found = cdpr.holding_controls(model, [0.0])
        assert found.ctrl == pytest.approx([control], rel=1e-9)
        assert found.missing == pytest.approx([-(G - 2 * control)], abs=1e-9)
        assert found.holds is (limit == 100.0)


def test_holding_controls_are_those_that_settle_model_needs():
    """A servo with the controls for a pose comes to rest at it."""
    model = model_of(PENDULUM.format(joint=""), '<actuator><position joint="hinge" kp="50"/></actuator>')
    held = cdpr.holding_controls(model, [0.4])
    assert held.holds
    assert cdpr.settle_model(model, ctrl=held.ctrl).qpos == pytest.approx([0.4], abs=1e-8)


def test_a_wrong_pose_is_found_by_the_judge():
    """The judge of these tests can fail: a pose beside the equilibrium needs a force."""
    model = model_of(PENDULUM.format(joint=""))
    data = mujoco.MjData(model)
    data.qpos[:] = np.pi / 2
    found = cdpr.settle_model(model, data)
    assert needed(model, found) < JUDGED
    vars(found)["qpos"] = found.qpos + 1e-4
    assert needed(model, found) > JUDGED


CHEAP = ("cogiro", "parallel", "planar-vertical", "two-cable", "caroca", "grab-3")
"""Robots of the catalogue of every kind but cables with mass: spatial, planar, with pulleys, slack cables."""

SAME = 1e-6, 1e-5, 1e-3
"""[m, rad, N] Tolerances of the cross-check of the two methods."""


def same_as_settle(robot: cdpr.Robot, winches: bool = False, other: cdpr.Robot | None = None) -> cdpr.ModelEquilibrium:
    """Settle a robot, or ``settle`` another one, and compare within the tolerances of the cross-check."""
    settled = cdpr.settle(other or robot, robot.home)
    model = mujoco.MjModel.from_xml_string(cdpr.to_mjcf(robot, robot.home, winches=winches))
    found = cdpr.settle_model(model)
    data = mujoco.MjData(model)
    found.write(data)
    mujoco.mj_forward(model, data)
    platform = data.body("platform")
    turned = Rotation.from_matrix(platform.xmat.reshape(3, 3)) * settled.rotation.inv()
    assert np.linalg.norm(platform.xpos - settled.position) < SAME[0]
    assert turned.magnitude() < SAME[1]
    if robot.cabling.massless:
        names = found.tendon_tensions.names
        pulls = [found.tendon_tensions.total[names.index(f"cable_{i + 1}")] for i in range(len(settled.pulls))]
        assert np.abs(pulls - settled.pulls).max() < SAME[2]  # a tendon is all parts of a line together
    assert found.agreement is not None
    assert found.agreement.agrees
    return found


@pytest.mark.parametrize("winches", [False, True])
@pytest.mark.parametrize("name", CHEAP)
def test_robots_rest_where_settle_says(catalogue, name, winches):
    """The MuJoCo model of a robot, given as any model, has the equilibrium of ``settle``: pose and tensions.

    With 1 % less mass it hangs elsewhere: the negative control.
    """
    assert same_as_settle(catalogue[name], winches).residual < 1e-8
    light = catalogue[name].replace(mass=0.99 * catalogue[name].mass)
    with pytest.raises(AssertionError):
        same_as_settle(catalogue[name], winches, light)


@pytest.mark.slow
@pytest.mark.parametrize("name", cdpr.list_robots())
def test_every_robot_of_the_catalogue_rests_where_settle_says(catalogue, name):
    """The same of all, with pulleys, and with chains for cables with mass; one hangs on a single line, neutral."""
    robot = catalogue[name]
    assert same_as_settle(robot).stability is cdpr.settle(robot, robot.home).stability

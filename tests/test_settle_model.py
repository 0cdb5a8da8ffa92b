"""``settle_model`` and ``holding_controls`` on models with closed forms; each answer is judged by ``mj_inverse``."""

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
    load = max(np.abs(data.qfrc_bias).max(), np.abs(actuators).max(), np.abs(data.qfrc_applied).max())
    return float(np.abs(left).max() / max(load, 1e-3 * model.body_mass.sum() * G))


def test_a_pendulum_hangs_down_and_both_ways_agree():
    """Its squared frequency is g/l of the compound pendulum, with the sphere's own inertia."""
    model = model_of(PENDULUM.format(joint=""))
    found = cdpr.settle_model(model)
    assert found.qpos == pytest.approx(np.pi / 2, abs=1e-9)
    inertia = 2 * 0.5**2 + 0.4 * 2 * 0.05**2
    assert found.stiffness_eigenvalues == pytest.approx(2 * G * 0.5 / inertia, rel=1e-6)
    assert needed(model, found) < JUDGED
    assert found.stable
    assert found.way == "motion"
    assert found.agreement is not None
    assert found.agreement.agrees
    assert found.agreement.newton_from == "start"
    assert found.creep < 1e-6


def test_a_spring_and_a_weight_balance_where_the_closed_form_says():
    """k θ = m g l cos θ: torque of the spring about the hinge against that of the weight."""
    model = model_of(PENDULUM.format(joint='stiffness="30"'))
    (angle,) = cdpr.settle_model(model).qpos
    assert 30 * angle == pytest.approx(2 * G * 0.5 * np.cos(angle), rel=1e-8)


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


def test_data_of_another_model_is_refused():
    """Whatever of it differs in number."""
    other = mujoco.MjData(mujoco.MjModel.from_xml_string(
        '<mujoco><worldbody><body mocap="true"/><body><joint/><geom size="1"/></body></worldbody></mujoco>'
    ))  # fmt: skip
    model = mujoco.MjModel.from_xml_string(
        '<mujoco><worldbody><body><joint/><geom size="1"/></body></worldbody></mujoco>'
    )
    for ask in (cdpr.settle_model, cdpr.diagnose_model, lambda model, data: cdpr.holding_controls(model, [0.0], data)):
        with pytest.raises(cdpr.InvalidInput, match=r"^data: found \w+ of \d numbers, expected that of the model, \d$"):
            ask(model, other)


@pytest.mark.parametrize("field", ["qpos", "ctrl", "qfrc_applied"])
def test_a_state_that_is_not_finite_is_refused(field):
    """By its name, before any search."""
    model = model_of(PENDULUM.format(joint=""), '<actuator><motor joint="hinge"/></actuator>')
    data = mujoco.MjData(model)
    getattr(data, field)[:] = np.nan
    for ask in (cdpr.settle_model, cdpr.diagnose_model, lambda model, data: cdpr.holding_controls(model, [0.0], data)):
        with pytest.raises(cdpr.InvalidInput, match=f"^data: found {field} that is not finite"):
            ask(model, data)


BELT = """<geom name="belt" type="plane" size="1 1 .1"{}/>
<body name="box" pos="0 0 .1"><freejoint name="box"/><geom type="box" size=".1 .1 .1" mass="1"/></body>"""


def test_a_belt_drives_a_box_for_ever():
    """By its name, not as an equilibrium or a failure; with a surface that stands still, the box rests."""
    with pytest.raises(cdpr.NotSettled, match="driven for ever by a surface that moves") as caught:
        cdpr.settle_model(model_of(BELT.format(' surfacevel="1 0 0"')))
    assert caught.value.case is cdpr.NoRest.BELT
    assert caught.value.joints == ("box",)
    still = model_of(BELT.format(""))
    assert needed(still, cdpr.settle_model(still)) < JUDGED


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
    with pytest.raises(cdpr.NotSettled, match="slides") as caught:
        cdpr.settle_model(on_slope(0.51))
    assert caught.value.case is cdpr.NoRest.SLIDES
    assert caught.value.joints == ("box",)
    with pytest.raises(cdpr.NotSettled):
        cdpr.settle_model(on_slope(0.1), friction=False, most_steps=2000)


NO_REST = {
    "free fall": (model_of(FREE_BALL), cdpr.NoRest.FALLS, "falls for ever.*target", "loose"),
    "one of two islands": (
        model_of(PENDULUM.format(joint="") + FREE_BALL), cdpr.NoRest.FALLS, "ignore='target'", "loose",
    ),
    "slide without a stop": (
        model_of('<body name="cart"><joint name="rail" type="slide" axis="1 0 1"/><geom size=".1"/></body>'),
        cdpr.NoRest.FALLS, "cart", "rail",
    ),
    "driven hinge": (
        model_of(
            '<body><joint name="wheel" axis="0 0 1" damping=".1"/><geom size=".1" pos="1 0 0"/></body>',
            '<actuator><motor joint="wheel"/></actuator>',
        ),
        cdpr.NoRest.TURNS, "turns for ever.*wheel", "wheel",
    ),
    "negative damping": (
        model_of(
            PENDULUM.format(joint=""),
            '<actuator><general joint="hinge" biastype="affine" biasprm="0 0 .5"/></actuator>',
        ),
        cdpr.NoRest.LIMIT_CYCLE, "oscillat", "hinge",
    ),
}  # fmt: skip
"""Models without rest: the case, words of the sentence, the joint."""


@pytest.mark.parametrize("name", NO_REST)
def test_what_has_no_rest_is_refused_with_the_case_and_the_joint(name):
    """The sentence says which, and so do ``case`` and ``joints``."""
    model, case, words, joint = NO_REST[name]
    with pytest.raises(cdpr.NotSettled, match=words) as caught:
        cdpr.settle_model(model, ctrl=np.ones(model.nu))
    assert caught.value.case is case
    assert joint in caught.value.joints


def test_a_drifting_cart_is_a_mechanism():
    """A steady force along a rail that is nearly a rail without end: nothing resists, and it does not get far."""
    model = model_of(
        '<body><joint name="rail" type="slide" axis="1 0 0"/><geom size=".1" mass="1"/></body>',
        option='<option gravity="1e-3 0 -9.81"/>',
    )
    with pytest.raises(cdpr.NotSettled, match="rail") as caught:
        cdpr.settle_model(model, most_steps=200)
    assert caught.value.case is cdpr.NoRest.MECHANISM
    assert caught.value.equilibrium.residual > 1e-3


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


def test_islands_come_to_rest_each_by_its_own_scale():
    """A gram beside a ton: its balance is not hidden by the larger forces."""
    light = PENDULUM.replace('mass="2"', 'mass="1e-3"').replace("arm", "light").replace("hinge", "small")
    heavy = PENDULUM.replace('mass="2"', 'mass="1e3"').replace('name="arm"', 'name="heavy" pos="0 5 0"')
    model = model_of(light.format(joint='stiffness="1e-3"') + heavy.format(joint=""))
    small, large = cdpr.settle_model(model).qpos
    assert 1e-3 * small == pytest.approx(1e-3 * G * 0.5 * np.cos(small), rel=1e-7)
    assert large == pytest.approx(np.pi / 2, abs=1e-8)


def test_no_degrees_of_freedom_is_an_answer():
    """Nothing can move: at rest, stable."""
    found = cdpr.settle_model(model_of('<geom size=".1"/>'))
    assert found.residual == 0
    assert found.qpos.shape == (0,)
    assert found.stable


@pytest.mark.parametrize("stiffness", [1e0, 1e3, 1e6, 1e9])
def test_soft_and_stiff_springs_carry_a_weight(stiffness):
    """m g / k below, from micrometres to metres."""
    slide = f'<joint name="lift" type="slide" axis="0 0 1" stiffness="{stiffness}"/><geom size=".1" mass="1"/>'
    model = model_of(f"<body>{slide}</body>")
    found = cdpr.settle_model(model)
    assert found.qpos == pytest.approx(-G / stiffness, rel=1e-7)
    assert needed(model, found) < JUDGED


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


def test_applied_forces_and_controls_count():
    """A force on a coordinate, and a servo that holds against the weight: k (u - q) = m g - F on a lift of 1 kg."""
    lift = '<body><joint name="lift" type="slide" axis="0 0 1"/><geom size=".1" mass="1"/></body>'
    model = model_of(lift, '<actuator><position joint="lift" kp="100"/></actuator>')
    data = mujoco.MjData(model)
    data.qfrc_applied[:] = 4
    found = cdpr.settle_model(model, data, ctrl=[0.3])
    assert found.qpos == pytest.approx(0.3 - (G - 4) / 100, rel=1e-9)
    assert needed(model, found, data) < JUDGED
    assert data.ctrl == 0  # what is given is not changed


def test_activations_rest_at_their_controls():
    """Of a filter, at the control; of an integrator, which never rests, a refusal."""
    lift = '<body><joint name="lift" type="slide" axis="0 0 1"/><geom size=".1" mass="1"/></body>'
    servo = 'joint="lift" gainprm="100" biastype="affine" biasprm="0 -100 0"'
    model = model_of(lift, f'<actuator><general {servo} dyntype="filter" dynprm="1"/></actuator>')
    found = cdpr.settle_model(model, ctrl=[0.3])
    assert found.act == pytest.approx([0.3], abs=0)
    assert found.qpos == pytest.approx(0.3 - G / 100, rel=1e-9)
    model = model_of(lift, f'<actuator><general name="winch" {servo} dyntype="integrator"/></actuator>')
    with pytest.raises(cdpr.NotSettled, match="winch") as caught:
        cdpr.settle_model(model, ctrl=[0.3])
    assert caught.value.case is cdpr.NoRest.DRIVEN


ONE_HINGE = '<body><joint name="h"/><geom size=".1" pos="1 0 0"/></body>'

REFUSED = {
    "delay": (
        model_of(ONE_HINGE, '<actuator><motor name="m" joint="h" delay=".1" nsample="10"/></actuator>'), "'m'.*delay",
    ),
    "PID controller": (
        model_of(ONE_HINGE, '<actuator><pid name="m" joint="h" kp="1" ki="1"/></actuator>'), "'m'.*PID",
    ),
    "DC motor": (
        model_of(
            ONE_HINGE,
            '<actuator><dcmotor name="m" joint="h" motorconst="0.05" resistance="2" inductance="1e-3"/></actuator>',
        ),
        "'m'.*DC motor",
    ),
    "plastic tendon": (
        model_of(
            ONE_HINGE,
            '<tendon><fixed name="t" stiffness="10" springyield="1"><joint joint="h" coef="1"/></fixed></tendon>',
        ),
        "plastic tendon 't'",
    ),
    "flex": (
        model_of(
            '<body name="frame" pos="0 0 1"><flexcomp name="cloth" type="grid" count="3 3 1" spacing=".1 .1 .1" '
            'radius=".01" mass="1"><edge equality="true"/></flexcomp></body>',
        ),
        "flex 'cloth'",
    ),
}  # fmt: skip
"""Elements whose forces depend on more than pose and controls."""


@pytest.mark.parametrize("name", REFUSED)
def test_what_statics_does_not_decide_is_refused_by_name(name):
    """One sentence with the element."""
    model, words = REFUSED[name]
    with pytest.raises(cdpr.InvalidInput, match=words):
        cdpr.settle_model(model)


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


def same_as_settle(robot: cdpr.Robot, winches: bool = False) -> cdpr.ModelEquilibrium:
    """Settle a robot by both functions and compare, within the tolerances of the cross-check."""
    settled = cdpr.settle(robot, robot.home)
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
    """The MuJoCo model of a robot, given as any model, has the equilibrium of ``settle``: pose and tensions."""
    assert same_as_settle(catalogue[name], winches).residual < 1e-8


@pytest.mark.slow
@pytest.mark.parametrize("name", cdpr.list_robots())
def test_every_robot_of_the_catalogue_rests_where_settle_says(catalogue, name):
    """The same of all, with pulleys, and with chains for cables with mass; one hangs on a single line, neutral."""
    robot = catalogue[name]
    assert same_as_settle(robot).stability is cdpr.settle(robot, robot.home).stability


def test_another_robot_does_not_rest_there(catalogue):
    """The comparison can fail: with 1 % less mass the platform hangs elsewhere."""
    robot = catalogue["two-cable"]
    settled = cdpr.settle(robot, robot.home)
    model = mujoco.MjModel.from_xml_string(cdpr.to_mjcf(robot, robot.home))
    model.body_mass[:] *= 0.99
    data = mujoco.MjData(model)
    cdpr.settle_model(model).write(data)
    mujoco.mj_forward(model, data)
    assert np.linalg.norm(data.body("platform").xpos - settled.position) > SAME[0]

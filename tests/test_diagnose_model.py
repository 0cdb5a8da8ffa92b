"""``diagnose_model``: each finding shows in ``mj_step``, and the remedy that it names takes the symptom away."""

import re

import mujoco
import numpy as np
import pytest

import cdpr_sim as cdpr
from cdpr_sim import FindingKind

GRAVITY = 9.81  # m/s²

SLIDER = """<mujoco><option gravity="0 0 0"/>
  <worldbody><site name="exit" pos="-0.5 0 0"/>
    <body name="car"><joint name="x" type="slide" axis="1 0 0"/><geom size="0.05" mass="1"/><site name="anchor"/>
    </body></worldbody>
  <tendon><spatial name="cable" {tendon}><site site="exit"/><site site="anchor"/></spatial></tendon>
  <actuator>{actuators}</actuator></mujoco>"""
"""A body of 1 kg that slides, 0.5 m from the exit of its tendon; no gravity."""

HANGING = """<mujoco><option{option}/>
  <worldbody><site name="exit" pos="0 0 1"/>
    <body name="load" pos="0 0 0.5"><joint name="z" type="slide" axis="0 0 1" damping="20"/>
      <geom size="0.05" mass="2"/><site name="anchor"/></body></worldbody>
  <tendon><spatial name="rope" {tendon}><site site="exit"/><site site="anchor"/></spatial></tendon></mujoco>"""
"""A body of 2 kg that hangs on a tendon, 0.5 m below its exit."""

ARM = """<mujoco><worldbody><body name="arm"><joint name="elbow" axis="0 1 0" damping="1" {joint}/>
  <geom type="capsule" fromto="0 0 0 0.5 0 0" size="0.03" mass="1"/></body></worldbody></mujoco>"""
"""An arm that points sideways, and would fall until it hangs."""

ON_FLOOR = """<mujoco><option timestep="{step}"/><worldbody><geom name="floor" type="plane" size="1 1 0.1" {reference}/>
  <body name="box" pos="0 0 0.1"><freejoint/><geom type="box" size="0.1 0.1 0.1" mass="1" {reference}/></body>
  </worldbody></mujoco>"""

STACK = """<mujoco><worldbody><geom name="floor" type="plane" size="1 1 0.1"/>
  <body name="plate" pos="0 0 0.05"><freejoint/><geom type="box" size="0.2 0.2 0.05" mass="{plate}"/></body>
  <body name="block" pos="0 0 0.2"><freejoint/><geom type="box" size="0.1 0.1 0.1" mass="100"/></body>
  </worldbody></mujoco>"""

HOOKED = """<mujoco><option><flag contact="disable"/></option><worldbody>
  <body name="ring"><freejoint/><geom size="0.05" mass="{ring}"/></body>
  <body name="block" pos="0 0 -0.5"><freejoint/><geom size="0.1" mass="100"/></body></worldbody>
  <equality><connect name="hook" body1="ring" anchor="0 0 0"/>
    <connect name="eye" body1="ring" body2="block" anchor="0 0 0"/></equality></mujoco>"""


def chained(link: float) -> str:
    """A block of 100 kg on four links that soft constraints join."""
    links = "".join(f'<body name="link_{i}" pos="0 0 {-0.1 * i}"><freejoint/><geom size="0.02" mass="{link}"/></body>'
                    for i in range(4))  # fmt: skip
    joins = "".join(f'<connect name="pin_{i}" body1="link_{i}" body2="link_{i + 1}" anchor="0 0 -0.05"/>'
                    for i in range(3))  # fmt: skip
    return f"""<mujoco><option><flag contact="disable"/></option><worldbody>{links}
      <body name="block" pos="0 0 -0.4"><freejoint/><geom size="0.1" mass="100"/></body></worldbody>
      <equality><connect name="hook" body1="link_0" anchor="0 0 0.05"/>{joins}
        <connect name="eye" body1="link_3" body2="block" anchor="0 0 -0.05"/></equality></mujoco>"""


CART = """<mujoco><option gravity="1e-5 0 -9.81"/><worldbody>
  <body name="cart"><joint name="rail" type="slide" axis="1 0 0"{joint}/><geom size="0.1" mass="1"/></body>
  </worldbody></mujoco>"""
"""A cart on a rail that is not quite level."""

WHEEL = """<mujoco><worldbody><body name="wheel"><joint name="axle" axis="0 0 1" damping="0.1"{joint}/>
  <geom size="0.1" pos="0.5 0 0" mass="1"/></body></worldbody>
  <actuator><general joint="axle" biastype="affine" biasprm="1 0 0"/></actuator></mujoco>"""
"""A wheel with a constant torque."""

WINCH = """<mujoco><worldbody><body name="lift"><joint name="lift" type="slide" axis="0 0 1" damping="20"/>
  <geom size="0.1" mass="1"/></body></worldbody><actuator><general name="winch" joint="lift" dyntype="integrator"
  gainprm="100" biastype="affine" biasprm="0 -100 0"{actrange}/></actuator></mujoco>"""
"""A lift whose servo integrates its control."""

ON_SLOPE = """<mujoco><option gravity="3 0 -9"/><worldbody><geom name="floor" type="plane" size="1 1 1"{friction}/>
  <body name="box" pos="0 0 0.1"><freejoint name="box"/><geom type="box" size="0.1 0.1 0.1" mass="1"{friction}/></body>
  </worldbody></mujoco>"""

FLUTTER = """<mujoco><worldbody><body name="arm" euler="0 90 0"><joint name="hinge" axis="0 1 0" damping="{damping}"/>
  <geom size="0.05" pos="0.5 0 0.01" mass="2"/></body></worldbody>
  <actuator><general joint="hinge" biastype="affine" biasprm="0 0 0.5"/></actuator></mujoco>"""
"""A pendulum with a drive that follows its speed."""

BELT = """<mujoco><worldbody><geom name="belt" type="plane" size="1 1 0.1"{velocity}/>
  <body name="box" pos="0 0 0.1"><freejoint name="box"/><geom type="box" size="0.1 0.1 0.1" mass="1"/></body>
  </worldbody></mujoco>"""

BALL = """<mujoco><worldbody><body name="ball"{gravcomp}><freejoint name="free"/><geom size="0.1" mass="1"/></body>
  </worldbody></mujoco>"""


def stepped(xml: str, seconds: float, **state: float) -> tuple:
    """A model and its data after some time of ``mj_step``; ``qvel`` and ``ctrl`` of all coordinates at the start."""
    model = mujoco.MjModel.from_xml_string(xml)
    data = mujoco.MjData(model)
    for name, value in state.items():
        getattr(data, name)[:] = value
    mujoco.mj_step(model, data, round(seconds / model.opt.timestep))
    return model, data


def outward(xml: str) -> float:
    """How far the car is pushed from its exit in 0.1 s [m], at a control of 3."""
    _, data = stepped(xml, 0.1, **({"ctrl": 3.0} if "motor" in xml or "position" in xml or "general" in xml else {}))
    return float(max(data.qpos[0], 0.0))


def pushed_back(xml: str) -> float:
    """How far a car is pushed from its exit that begins 0.2 m nearer to it than the model was written for [m]."""
    model = mujoco.MjModel.from_xml_string(xml)
    data = mujoco.MjData(model)
    data.qpos[:] -= 0.2
    start = float(data.qpos[0])
    mujoco.mj_step(model, data, 100)
    return float(data.qpos[0]) - start


def slowed(xml: str) -> float:
    """Speed that a car loses in 0.1 s [m/s] while it moves towards its exit at 1 m/s."""
    return 1.0 + float(stepped(xml, 0.1, qvel=-1.0)[1].qvel[0])


def carried(xml: str) -> float:
    """Force in the limit after 5 s [N, N m]."""
    data = stepped(xml, 5.0)[1]
    kinds = mujoco.mjtConstraint
    at_limit = np.isin(data.efc_type, [kinds.mjCNSTR_LIMIT_TENDON, kinds.mjCNSTR_LIMIT_JOINT])
    return float(np.abs(data.efc_force[at_limit]).sum())


def swings(xml: str) -> float:
    """Distance from the equilibrium [m] that 2000 steps make of 1e-6 m, without MuJoCo's reset of what diverges."""
    model = mujoco.MjModel.from_xml_string(xml)
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_AUTORESET)
    data = mujoco.MjData(model)
    rest = cdpr.settle_model(model).qpos
    data.qpos[:] = rest + 1e-6
    for _ in range(2000):
        mujoco.mj_step(model, data)
        if not abs(data.qpos[0] - rest[0]) < 1e-2:
            return np.inf
    return float(abs(data.qpos[0] - rest[0]))


def by_time_step(xml: str) -> float:
    """Difference of the depth at which the box rests with half the time step [m]."""
    step = float(re.findall(r'timestep="([\d.e-]+)"', xml)[0])
    halved = xml.replace(f'timestep="{step:g}"', f'timestep="{step / 2:g}"')
    assert halved != xml
    depths = [stepped(one, 2.0)[1].qpos[2] for one in (xml, halved)]
    return float(abs(depths[0] - depths[1]))


def sunk(xml: str) -> float:
    """Depth to which the plate has sunk into the floor after 2 s [m]."""
    return 0.05 - float(stepped(xml, 2.0)[1].qpos[2])


def fallen(xml: str) -> float:
    """Depth of the fall in 1 s [m]."""
    return -float(stepped(xml, 1.0)[1].qpos[2])


def moved(xml: str) -> float:
    """Largest change of a coordinate from the fifth to the sixth second [m, rad], at a control of 1."""
    model, data = stepped(xml, 5.0, **({"ctrl": 1.0} if "integrator" in xml else {}))
    before = data.qpos.copy()
    mujoco.mj_step(model, data, round(1.0 / model.opt.timestep))
    return float(np.abs(data.qpos - before).max())


REVERSED = '<general name="winch" tendon="cable" gear="-2" gainprm="-1" ctrlrange="-9 4" {}/>'

FINDINGS = {
    "a spring of one length": (
        SLIDER.format(tendon='stiffness="100" springlength="1"', actuators=""),
        SLIDER.format(tendon='stiffness="100" springlength="0 1"', actuators=""),
        FindingKind.SPRING_PUSHES, "tendon 'cable'", outward, 0.01, 0.0,
    ),
    "a spring of the length at which the model was written": (
        SLIDER.format(tendon='stiffness="100"', actuators=""),
        SLIDER.format(tendon='stiffness="100" springlength="0 0.5"', actuators=""),
        FindingKind.SPRING_PUSHES, "tendon 'cable'", pushed_back, 0.1, 0.0,
    ),
    "a damper": (
        SLIDER.format(tendon='stiffness="100" springlength="0 1" damping="5"', actuators=""),
        SLIDER.format(tendon='stiffness="100" springlength="0 1"', actuators=""),
        FindingKind.DAMPER_PUSHES, "tendon 'cable'", slowed, 0.1, 0.0,
    ),
    "a range that begins above zero": (
        SLIDER.format(tendon='range="0.8 1"', actuators=""), SLIDER.format(tendon='range="0 1"', actuators=""),
        FindingKind.LIMIT_PUSHES, "tendon 'cable'", outward, 0.01, 0.0,
    ),
    "a motor": (
        SLIDER.format(tendon="", actuators='<motor name="winch" tendon="cable" gear="2"/>'),
        SLIDER.format(tendon="", actuators='<motor name="winch" tendon="cable" gear="2" forcerange="-50 0"/>'),
        FindingKind.ACTUATOR_PUSHES, "actuator 'winch'", outward, 0.01, 0.0,
    ),
    "a motor of negative gear": (
        SLIDER.format(tendon="", actuators=REVERSED.format("")),
        SLIDER.format(tendon="", actuators=REVERSED.format('forcerange="0 9"')),
        FindingKind.ACTUATOR_PUSHES, "actuator 'winch'", outward, 0.01, 0.0,
    ),
    "a position servo": (
        SLIDER.format(tendon="", actuators='<position name="winch" tendon="cable" kp="50" forcerange="-20 20"/>'),
        SLIDER.format(tendon="", actuators='<position name="winch" tendon="cable" kp="50" forcerange="-20 0"/>'),
        FindingKind.ACTUATOR_PUSHES, "actuator 'winch'", outward, 0.01, 0.0,
    ),
    "a rope that is only a range": (
        HANGING.format(option="", tendon='range="0 0.5"'),
        HANGING.format(option="", tendon='stiffness="1000" springlength="0 0.5"'),
        FindingKind.LIMIT_CARRIES, "tendon 'rope'", carried, 2 * GRAVITY - 1e-6, 0.0,
    ),
    "a joint at its limit": (
        ARM.format(joint='range="-10 10"'), ARM.format(joint='range="-180 180"'),
        FindingKind.LIMIT_CARRIES, "joint 'elbow'", carried, 2.0, 0.0,
    ),
    **{
        f"a time step of {integrator}": (
            HANGING.format(option=f' integrator="{integrator}" timestep="0.005"',
                           tendon='stiffness="2e6" springlength="0 0.5"'),
            HANGING.format(option=f' integrator="{integrator}" timestep="0.001"',
                           tendon='stiffness="2e6" springlength="0 0.5"'),
            FindingKind.TIME_STEP, "joint 'z'", swings, 1e-2, 1e-6,
        )
        for integrator in ("Euler", "implicit", "implicitfast")
    },
    "a time step of RK4": (
        HANGING.format(option=' integrator="RK4" timestep="0.005"', tendon='stiffness="2e6" springlength="0 0.5"'),
        HANGING.format(option=' integrator="RK4" timestep="0.002"', tendon='stiffness="2e6" springlength="0 0.5"'),
        FindingKind.TIME_STEP, "joint 'z'", swings, 1e-2, 1e-6,
    ),
    "a time constant below two time steps": (
        ON_FLOOR.format(step="0.004", reference='solref="0.002 1"'),
        ON_FLOOR.format(step="0.001", reference='solref="0.002 1"'),
        FindingKind.REFSAFE, "contact of world and box", by_time_step, 1e-5, 1e-10,
    ),
    "a plate that is two hundred times lighter than its load": (
        STACK.format(plate=0.5), STACK.format(plate=50),
        FindingKind.MASSES, "contact of world and plate", sunk, 9e-3, 1e-3,
    ),
    "a ring that is two hundred times lighter than its load": (
        HOOKED.format(ring=0.5), HOOKED.format(ring=50),
        FindingKind.MASSES, "equality 'hook'", lambda xml: -float(stepped(xml, 5.0)[1].qpos[2]), 9e-3, 1e-3,
    ),
    "a chain of light links": (
        chained(0.5), chained(50),
        FindingKind.MASSES, "equality 'pin_1'", lambda xml: -0.4 - float(stepped(xml, 5.0)[1].body("block").xpos[2]),
        0.2, 0.01,
    ),
    "a mechanism": (
        CART.format(joint=""), CART.format(joint=' stiffness="1" damping="1"'),
        FindingKind.NO_REST, "joint 'rail'", moved, 5e-5, 1e-6,
    ),
    "a wheel that turns": (
        WHEEL.format(joint=""), WHEEL.format(joint=' range="-90 90"'),
        FindingKind.NO_REST, "joint 'axle'", moved, 1.0, 1e-6,
    ),
    "an integrator": (
        WINCH.format(actrange=""), WINCH.format(actrange=' actlimited="true" actrange="0 1"'),
        FindingKind.NO_REST, "model", moved, 0.5, 1e-6,
    ),
    "a slope that is too steep": (
        ON_SLOPE.format(friction=' friction="0.1"'), ON_SLOPE.format(friction=' friction="0.5"'),
        FindingKind.NO_REST, "joint 'box'", moved, 1.0, 0.01,
    ),
    "a drive that feeds a swing": (
        FLUTTER.format(damping=0), FLUTTER.format(damping=3),
        FindingKind.NO_REST, "joint 'hinge'", moved, 0.1, 1e-3,
    ),
    "a belt": (
        BELT.format(velocity=' surfacevel="1 0 0"'), BELT.format(velocity=""),
        FindingKind.NO_REST, "joint 'box'", moved, 0.5, 1e-3,
    ),
    "a body that nothing holds": (
        BALL.format(gravcomp=""), BALL.format(gravcomp=' gravcomp="1"'),
        FindingKind.UNSUPPORTED, "joint 'free'", fallen, 1.0, 1e-9,
    ),
}  # fmt: skip
"""Model, the same with the remedy, what is found, of which element; the symptom, at least without, at most with it."""


def found_in(xml: str, kind: FindingKind) -> list:
    """Findings of one kind."""
    model = mujoco.MjModel.from_xml_string(xml)
    ctrl = np.ones(model.nu) if "integrator" in xml else None
    return [one for one in cdpr.diagnose_model(model, ctrl=ctrl) if one.kind is kind]


NO_REST = {
    "a mechanism": cdpr.NoRest.MECHANISM, "a wheel that turns": cdpr.NoRest.TURNS, "an integrator": cdpr.NoRest.DRIVEN,
    "a slope that is too steep": cdpr.NoRest.SLIDES, "a drive that feeds a swing": cdpr.NoRest.LIMIT_CYCLE,
    "a belt": cdpr.NoRest.BELT, "a body that nothing holds": cdpr.NoRest.FALLS,
}  # fmt: skip
"""How ``settle_model`` refuses those that do not come to rest."""


@pytest.mark.parametrize("name", FINDINGS)
def test_the_symptom_shows_and_the_remedy_takes_it_away(name, snapshot):
    """In ``mj_step``; and the finding goes with it, a sentence as reviewed with the element, numbers and the remedy.

    What does not come to rest is refused by ``settle_model``.
    """
    xml, mended, kind, element, symptom, least, most = FINDINGS[name]
    told = found_in(xml, kind)
    assert [one.element for one in told].count(element) == 1
    assert symptom(xml) > least
    assert symptom(mended) <= most
    assert found_in(mended, kind) == []
    if name in NO_REST:
        model, ctrl = mujoco.MjModel.from_xml_string(xml), [1.0] if "integrator" in xml else None
        with pytest.raises(cdpr.NotSettled) as caught:
            cdpr.settle_model(model, ctrl=ctrl)
        assert caught.value.case is NO_REST[name]
        assert [f"joint '{one}'" for one in caught.value.joints] == [element] * (element != "model")
        told.append(caught.value)
    snapshot(f"findings/{name.replace(' ', '-')}.txt", "\n".join(map(str, told)), rel=1e-2)


SERVO = """<mujoco><worldbody><body name="arm"><joint name="elbow" axis="0 1 0" damping="0.5" armature="0.01"/>
  <geom type="capsule" fromto="0 0 0 0.5 0 0" size="0.03" mass="1"/>
  <body name="hand" pos="0.5 0 0"><joint name="wrist" axis="0 1 0"/><geom size="0.04" mass="0.1"/></body>
  </body></worldbody>
  <actuator><position joint="elbow" kp="3000" kv="20"/><position joint="wrist" kp="800" kv="0.5"/>
  </actuator></mujoco>"""
"""An arm with stiff servos."""

DAMPED = HANGING.format(option="", tendon='stiffness="4000" damping="60" springlength="0 0.4"')

ROBOTS = ("two-cable", "parallel", "nist-robocrane", "caroca", "falcon-7")

NEAR, RK4_MARGIN = 0.03, 0.06
"""Of the limit: of Euler and implicitfast on both sides; RK4's limit is conservative."""


def diverges(model: mujoco.MjModel, rest: np.ndarray, step: float) -> bool:
    """Whether a random displacement of 1e-7 grows a thousandfold in 2000 steps."""
    model.opt.timestep = step
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_AUTORESET)
    data, apart = mujoco.MjData(model), np.zeros(model.nv)
    data.qpos[:] = rest
    mujoco.mj_integratePos(model, data.qpos, 1e-7 * np.random.default_rng(1).standard_normal(model.nv), 1)
    for _ in range(2000):
        mujoco.mj_step(model, data)
        mujoco.mj_differentiatePos(model, apart, 1, rest, data.qpos)
        if not np.abs(apart).max() < 1e-4:
            return True
    return False


@pytest.mark.parametrize("integrator", ["Euler", "implicitfast", "RK4"])
@pytest.mark.parametrize("which", ["servo", "damped", *ROBOTS])
def test_the_limit_of_the_time_step_is_where_steps_begin_to_diverge(which, integrator):
    """By ``mj_step`` just below and just above it, with dampers, servos and cables; RK4's is at most 6 % too small."""
    texts = {"servo": SERVO, "damped": DAMPED}
    xml = texts.get(which) or cdpr.to_mjcf(robot := cdpr.load_robot(which), robot.home)
    model = mujoco.MjModel.from_xml_string(xml)
    found = cdpr.diagnose_model(model)
    limit = found.stable_time_steps[integrator]
    model.opt.integrator = getattr(mujoco.mjtIntegrator, f"mjINT_{integrator.upper()}")
    assert not diverges(model, found.equilibrium.qpos, (1 - NEAR) * limit)
    assert diverges(model, found.equilibrium.qpos, (1 + (RK4_MARGIN if integrator == "RK4" else NEAR)) * limit)


def test_the_limits_of_a_mass_on_a_spring_are_those_of_its_frequency():
    """w = 1000 1/s: Euler and implicitfast 2/w, RK4 the root of 8 over w, the period 2 pi/w."""
    model = mujoco.MjModel.from_xml_string(FINDINGS["a time step of Euler"][1].replace('damping="20"', ""))
    found = cdpr.diagnose_model(model)
    assert found.fastest_period == pytest.approx(2e-3 * np.pi, rel=1e-6)
    expected = {"Euler": 2e-3, "implicitfast": 2e-3, "RK4": np.sqrt(8) * 1e-3}
    assert found.stable_time_steps == pytest.approx(expected, rel=1e-3)


PULLS = {
    "a spring with a dead band": ('stiffness="100" springlength="0 1"', ""),
    "a muscle": ("", '<muscle tendon="cable" lengthrange="0.1 1"/>'),
    "a motor whose control pulls": ("", '<motor tendon="cable" ctrlrange="-10 0"/>'),
    "a motor of negative gear whose control pulls": ("", '<motor tendon="cable" gear="-3" ctrlrange="0 10"/>'),
    "a filter whose control pulls": ("", '<general tendon="cable" dyntype="filter" ctrlrange="-10 0"/>'),
    "an integrator whose activation pulls": (
        "", '<intvelocity tendon="cable" kp="3" actrange="-1 0" forcerange="-9 0"/>',
    ),
    "a motor on a tendon whose force only pulls": ('actuatorfrcrange="-10 0"', '<motor tendon="cable"/>'),
    "an actuator without gain": ("", '<general tendon="cable" gainprm="0"/>'),
}  # fmt: skip


@pytest.mark.parametrize(("tendon", "actuators"), PULLS.values(), ids=PULLS)
def test_what_only_pulls_is_not_said_to_push(tendon, actuators):
    """At the largest and the smallest control, nothing pushes."""
    xml = SLIDER.format(tendon=tendon, actuators=actuators)
    model = mujoco.MjModel.from_xml_string(xml)
    assert not [one for one in cdpr.diagnose_model(model) if one.kind.name.endswith("PUSHES")]
    data = mujoco.MjData(model)
    for control in (-5.0, 5.0):
        data.ctrl[:] = control
        assert not cdpr.tendon_tensions(model, data).pushes.any()


def test_a_fixed_tendon_may_push():
    """It couples joints, and has no length between two points."""
    xml = SLIDER.format(tendon="", actuators="").replace(
        "</tendon>", '<fixed name="f" stiffness="9" damping="1"><joint joint="x" coef="1"/></fixed></tendon>'
    )
    assert len(cdpr.diagnose_model(mujoco.MjModel.from_xml_string(xml))) == 0


@pytest.mark.parametrize("name", ROBOTS)
def test_nothing_is_wrong_with_the_models_of_the_catalogue(name):
    """Their cables only pull, their platforms rest, and their time steps are short enough."""
    robot = cdpr.load_robot(name)
    found = cdpr.diagnose_model(mujoco.MjModel.from_xml_string(cdpr.to_mjcf(robot, robot.home)))
    assert list(found) == []
    assert found.notes == ()


def test_what_cannot_be_judged_is_noted():
    """Without an equilibrium, a sentence; without degrees of freedom there is nothing."""
    falling = cdpr.diagnose_model(mujoco.MjModel.from_xml_string(BALL.format(gravcomp="")))
    assert "no equilibrium was found" in falling.notes[0]
    assert falling.equilibrium is None
    empty = cdpr.diagnose_model(mujoco.MjModel.from_xml_string("<mujoco/>"))
    assert len(empty) == 0
    assert empty.stable_time_steps == {}


def test_an_unstable_equilibrium_is_no_matter_of_the_time_step():
    """A pendulum of 1 mm that stands upright falls over with every time step."""
    xml = """<mujoco><worldbody><body><joint name="pivot" axis="0 1 0"/><geom size="1e-3" pos="0 0 1e-3" mass="1"/>
      </body></worldbody></mujoco>"""
    assert found_in(xml, FindingKind.TIME_STEP) == []


def test_bodies_that_are_left_out_are_not_found():
    """As in ``settle_model``: a free target falls, and the rest is judged."""
    model = mujoco.MjModel.from_xml_string(BALL.format(gravcomp=""))
    assert len(cdpr.diagnose_model(model, ignore=["ball"])) == 0


def test_time_steps_that_diverge_on_purpose_leave_no_trace(tmp_path, monkeypatch, capfd):
    """Neither in the terminal nor in MUJOCO_LOG.TXT; and the user's handler of warnings is the one before."""
    monkeypatch.chdir(tmp_path)
    seen: list[str] = []
    mujoco.set_mju_user_warning(seen.append)
    try:
        found = found_in(FINDINGS["a time step of Euler"][0], FindingKind.TIME_STEP)
        assert len(found) == 1
        assert seen == []
        model = mujoco.MjModel.from_xml_string(FINDINGS["a time step of Euler"][0])
        data = mujoco.MjData(model)
        data.qpos[:] = np.nan
        mujoco.mj_step(model, data)
        assert len(seen) == 1
    finally:
        mujoco.set_mju_user_warning(None)
    assert capfd.readouterr() == ("", "")
    assert list(tmp_path.iterdir()) == []

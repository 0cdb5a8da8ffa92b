"""``tendon_tensions``: every tension balances the body that the tendon holds, part by part."""

import mujoco
import numpy as np
import pytest

import cdpr_sim as cdpr
from cdpr_sim.anymodel.tendons import PARTS

MASS, GRAVITY = 2.0, 9.81  # kg, m/s²
EXIT = np.array([0.3, -0.2, 1.0])  # m
POSE, SPEED = np.array([0.1, 0.05, -0.2]), np.array([0.4, -0.3, -0.7])  # m, m/s
LENGTH = float(np.linalg.norm(EXIT - POSE))  # m, 1.241 m
STRETCHING = float((POSE - EXIT) @ SPEED / LENGTH)  # m/s, positive: it lengthens

SOLVED = 1e-9
"""[N] Rounding of MuJoCo's constraint solver at a tolerance of 0; forces are of 1 to 100 N."""

HANGING = """<mujoco><option tolerance="0" iterations="500"/>
  <worldbody><site name="exit" pos="0.3 -0.2 1"/>
    <body name="load"><joint name="x" type="slide" axis="1 0 0"/><joint name="y" type="slide" axis="0 1 0"/>
      <joint name="z" type="slide" axis="0 0 1"/><geom size="0.05" mass="2"/><site name="anchor"/></body></worldbody>
  <tendon><spatial name="cable" {tendon}><site site="exit"/><site site="anchor"/></spatial></tendon>
  <actuator>{actuators}</actuator></mujoco>"""
"""A body of 2 kg on one tendon, free to move; gravity is MuJoCo's default, 9.81 m/s²."""

NOT_PREDICTED = np.nan

FORCES = {
    "spring": ('stiffness="100" springlength="0 1.2"', "", {"spring": 100 * (LENGTH - 1.2)}),
    "spring of one length, compressed": ('stiffness="100" springlength="1.5"', "", {"spring": 100 * (LENGTH - 1.5)}),
    "spring of a polynomial": (
        'stiffness="100 20 -30" springlength="0 1"', "",
        {"spring": 100 * (LENGTH - 1) + 20 * (LENGTH - 1) ** 2 - 30 * (LENGTH - 1) ** 3},
    ),
    "plastic spring": ('stiffness="100" springlength="0 1.2" springyield="9"', "", {"spring": 100 * (LENGTH - 1.2)}),
    "slack": ('stiffness="100" springlength="0 1.3"', "", {}),
    "damper": ('damping="7"', "", {"damper": 7 * STRETCHING}),
    "damper of a polynomial": (
        'damping="7 3 2"', "", {"damper": STRETCHING * (7 + 3 * abs(STRETCHING) + 2 * STRETCHING**2)},
    ),
    "upper limit": ('range="0 1.2"', "", {"limit": NOT_PREDICTED}),
    "lower limit": ('range="1.3 2"', "", {"limit": NOT_PREDICTED}),
    "limit with a margin at both ends": ('range="1.241 1.242" margin="0.02"', "", {"limit": NOT_PREDICTED}),
    "friction": ('frictionloss="5"', "", {"friction": NOT_PREDICTED}),
    "motor": ("", '<motor tendon="cable" gear="-2" ctrlrange="0 10"/>', {"actuators": 2 * 3.0}),
    "motor at its force limit": (
        "", '<motor tendon="cable" gear="-2" ctrlrange="0 10" forcelimited="true" forcerange="0 1"/>',
        {"actuators": 2 * 1.0},
    ),
    "position servo": (
        "", '<position tendon="cable" kp="50" kv="4"/>',
        {"actuators": -(50 * (3.0 - LENGTH) - 4 * STRETCHING)},
    ),
    "two actuators": (
        "", '<motor tendon="cable" gear="-2"/><general tendon="cable" gainprm="-1" ctrlrange="0 1"/>',
        {"actuators": 2 * 3.0 + 1.0},
    ),
    "damping of an actuator": (
        "", '<motor tendon="cable" gear="-2" damping="1.5"/>', {"actuators": 6.0, "damper": 4 * 1.5 * STRETCHING},
    ),
    "all at once": (
        'stiffness="100" springlength="0 1.2" damping="7" range="0 1.2" frictionloss="5"',
        '<motor tendon="cable" gear="-2"/>',
        {"spring": 100 * (LENGTH - 1.2), "damper": 7 * STRETCHING, "limit": NOT_PREDICTED,
         "friction": NOT_PREDICTED, "actuators": 6.0},
    ),
}  # fmt: skip
"""What acts along the tendon: its attributes, actuators (control 3), and the parts that are not zero [N]."""


def in_motion(xml: str) -> tuple:
    """A model, and its data at a pose and a velocity, where the control is 3."""
    model = mujoco.MjModel.from_xml_string(xml)
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:], data.ctrl[:] = POSE, SPEED, 3.0
    return model, data


@pytest.mark.parametrize(("tendon", "actuators", "parts"), FORCES.values(), ids=FORCES)
def test_the_tension_accelerates_the_body_on_it(tendon, actuators, parts):
    """Free-body balance in motion: mass times acceleration is weight plus tension along the tendon."""
    model, data = in_motion(HANGING.format(tendon=tendon, actuators=actuators))
    found = cdpr.tendon_tensions(model, data)
    mujoco.mj_forward(model, data)
    along = (EXIT - POSE) / LENGTH
    net = MASS * data.qacc + [0, 0, MASS * GRAVITY]
    np.testing.assert_allclose(net, found.total[0] * along, atol=SOLVED)
    for part in PARTS:
        value = getattr(found, part)[0]
        expected = parts.get(part, 0.0)
        assert value == pytest.approx(expected, rel=1e-12) if not np.isnan(expected) else abs(value) > 0.1
    assert found.total[0] == pytest.approx(sum(getattr(found, part)[0] for part in PARTS), rel=1e-12)
    assert found.slack[0] == (not parts)
    assert found.pushes[0] == (found.total[0] < 0)


@pytest.mark.parametrize(("option", "part"), [("spring", "spring"), ("damper", "damper"), ("actuation", "actuators")])
def test_forces_that_the_model_disables_are_zero(option, part):
    """With the flag the part goes, and the others balance."""
    xml = HANGING.format(
        tendon='stiffness="100" damping="7" springlength="0 1.2"', actuators='<motor tendon="cable" gear="-2"/>'
    ).replace("<option ", f'<option><flag {option}="disable"/></option><option ')
    model, data = in_motion(xml)
    found = cdpr.tendon_tensions(model, data)
    mujoco.mj_forward(model, data)
    assert getattr(found, part)[0] == 0.0
    net = MASS * data.qacc + [0, 0, MASS * GRAVITY]
    np.testing.assert_allclose(net, found.total[0] * (EXIT - POSE) / LENGTH, atol=SOLVED)


def test_a_plastic_spring_pulls_from_where_it_has_yielded():
    """Stretched by 0.241 m, with a yield of 0.1 m, it slides until it is stretched by 0.1 m: 10 N."""
    model, data = in_motion(HANGING.format(tendon='stiffness="100" springlength="1" springyield="0.1"', actuators=""))
    assert cdpr.tendon_tensions(model, data).spring[0] == pytest.approx(100 * (LENGTH - 1))
    data.qvel[:] = 0
    mujoco.mj_step(model, data)
    assert cdpr.tendon_tensions(model, data).spring[0] == pytest.approx(100 * 0.1)


FIXED = """<mujoco><option tolerance="0" iterations="500"/>
  <worldbody><body name="upper"><joint name="shoulder" axis="0 1 0"/>
    <geom type="capsule" fromto="0 0 0 0 0 -1" size="0.05"/>
    <body name="lower" pos="0 0 -1"><joint name="elbow" axis="0 1 0"/>
      <geom type="capsule" fromto="0 0 0 0 0 -1" size="0.05"/></body></body></worldbody>
  <tendon><fixed name="coupling" {tendon}>
    <joint joint="shoulder" coef="0.5"/><joint joint="elbow" coef="-2"/></fixed></tendon>
  <actuator>{actuators}</actuator></mujoco>"""


@pytest.mark.parametrize(
    ("tendon", "actuators", "part"),
    [
        ('stiffness="10" damping="2" springlength="0.2"', "", "spring"),
        ('range="-0.1 0.1"', "", "limit"),
        ('frictionloss="3"', "", "friction"),
        ("", '<motor tendon="coupling" gear="3"/>', "actuators"),
    ],
)
def test_the_tension_of_a_fixed_tendon_turns_its_joints(tendon, actuators, part):
    """Its torque on a joint is minus the joint's coefficient times the tension; inverse dynamics need no other."""
    model = mujoco.MjModel.from_xml_string(FIXED.format(tendon=tendon, actuators=actuators))
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:], data.ctrl[:] = (0.4, -0.3), (0.5, 1.5), 1.0
    found = cdpr.tendon_tensions(model, data)
    mujoco.mj_forward(model, data)
    bare = mujoco.MjModel.from_xml_string(FIXED.format(tendon="", actuators=""))
    needed = mujoco.MjData(bare)
    needed.qpos[:], needed.qvel[:], needed.qacc[:] = data.qpos, data.qvel, data.qacc
    mujoco.mj_inverse(bare, needed)
    np.testing.assert_allclose(needed.qfrc_inverse, found.total[0] * np.array([-0.5, 2.0]), atol=SOLVED)
    assert abs(getattr(found, part)[0]) > 0.1
    assert not found.spatial[0]


COUPLED = """<mujoco><option tolerance="0" iterations="500"/>
  <worldbody><site name="exit_1" pos="0 0 1"/><site name="exit_2" pos="1 0 1"/>
    <body name="one"><joint name="z_1" type="slide" axis="0 0 1"/><geom size="0.05" mass="2"/>
      <site name="anchor_1"/></body>
    <body name="two" pos="1 0 0"><joint name="z_2" type="slide" axis="0 0 1"/><geom size="0.05" mass="3"/>
      <site name="anchor_2"/></body></worldbody>
  <tendon><spatial name="cable_1"><site site="exit_1"/><site site="anchor_1"/></spatial>
    <spatial name="cable_2"><site site="exit_2"/><site site="anchor_2"/></spatial></tendon>
  <equality>{equality}</equality></mujoco>"""


@pytest.mark.parametrize(
    "equality",
    [
        '<tendon tendon1="cable_1" tendon2="cable_2" polycoef="0 -1 0 0 0"/>',
        '<tendon tendon1="cable_2" tendon2="cable_1" polycoef="0.01 -0.5 0.7 0.2 -0.3"/>',
        '<tendon tendon1="cable_1" polycoef="0.02 0 0 0 0"/>',
    ],
)
def test_coupled_tendons_carry_the_bodies_on_them(equality):
    """A rope over two wheels, a gear between two ropes, a rope of fixed length: each body balances."""
    model = mujoco.MjModel.from_xml_string(COUPLED.format(equality=equality))
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:] = (0.1, -0.15), (0.3, 0.2)
    found = cdpr.tendon_tensions(model, data)
    mujoco.mj_forward(model, data)
    np.testing.assert_allclose(np.array([2.0, 3.0]) * (data.qacc + GRAVITY), found.total, atol=SOLVED)
    np.testing.assert_array_equal(found.equality, found.total)
    assert abs(found.total[0]) > 1


def test_tensions_belong_to_the_state_that_the_data_has_now():
    """After a change of ``qpos`` and after ``mj_step``, without ``mj_forward``; the data stay as they are."""
    model, data = in_motion(HANGING.format(tendon='stiffness="100" springlength="0 1"', actuators=""))
    before = np.zeros(mujoco.mj_stateSize(model, mujoco.mjtState.mjSTATE_INTEGRATION))
    mujoco.mj_step(model, data)
    length = np.array(data.ten_length)
    mujoco.mj_getState(model, data, before, mujoco.mjtState.mjSTATE_INTEGRATION)
    found = cdpr.tendon_tensions(model, data)
    assert found.spring[0] == pytest.approx(100 * (np.linalg.norm(EXIT - data.qpos) - 1), rel=1e-12)
    after = np.empty_like(before)
    mujoco.mj_getState(model, data, after, mujoco.mjtState.mjSTATE_INTEGRATION)
    np.testing.assert_array_equal(before, after)
    np.testing.assert_array_equal(data.ten_length, length)
    assert abs(found.lengths[0] - length[0]) > 1e-4  # the data's own length is that before the step


def test_tensions_read_as_a_table_in_the_order_of_the_model():
    """A slack, a pulling and a pushing tendon without a name."""
    xml = HANGING.format(tendon='stiffness="100" springlength="0 1"', actuators="").replace(
        "</spatial>",
        '</spatial><spatial name="line" range="0 9"><site site="exit"/><site site="anchor"/></spatial>'
        '<spatial stiffness="10" springlength="2"><site site="exit"/><site site="anchor"/></spatial>',
        1,
    )
    model, data = in_motion(xml)
    data.qpos[:] = (0.3, -0.2, -0.5)  # below the exit: 1.5 m long
    found = cdpr.tendon_tensions(model, data)
    assert repr(found) == ("TendonTensions(cable: 50 N (spring 50); line: slack; 2: -5 N (spring -5), pushes)")
    assert len(found) == 3
    assert not found.total.flags.writeable
    bare = mujoco.MjModel.from_xml_string("<mujoco/>")
    assert len(cdpr.tendon_tensions(bare, mujoco.MjData(bare))) == 0

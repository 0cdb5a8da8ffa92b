"""Friction of any model at rest: shares of limits by hand, and what creeps is not at rest."""

import mujoco
import numpy as np
import pytest

import cdpr_sim as cdpr
from cdpr_sim.anymodel import evidence
from cdpr_sim.anymodel.friction_limits import shares

G = 9.81

SLOPE = """<mujoco><option cone="{cone}" gravity="{x} {y} -9.81"/><worldbody><geom type="plane" size="1 1 1"/>
<body name="box" pos="0 0 .01"><freejoint/>
<geom type="box" size=".1 .1 .01" friction=".5" priority="1" density="50"/></body>
</worldbody></mujoco>"""

HINGE = """<mujoco><worldbody><body><joint name="hinge" axis="0 1 0" frictionloss="{loss}"/>
<geom size=".05" pos=".5 0 0" mass="2"/></body></worldbody></mujoco>"""

CREEPS = [  # speeds after half the time and all of it, and whether that is at rest
    (0.03, 0.049, True), (0.03, 0.051, False), (0.04, 0.059, True), (0.04, 0.061, False), (0.4, 0.499, True),
    (0.6, 0.501, False),
]  # fmt: skip


def test_shares_are_norms_of_cones_and_sums_of_pyramids():
    """A row alone, a cone of (0.3, 0.4), a pyramid of (0.3, −0.4)."""
    found = shares(np.array([-0.6, 0.3, 0.4, 0.3, -0.4]), np.array([0, 1, 1, 2, 2]), np.array([False, False, True]))
    assert found == pytest.approx([0.6, 0.5, 0.7])


@pytest.mark.parametrize(("cone", "share"), [("elliptic", 0.5), ("pyramidal", 0.7)])
def test_contacts_share_a_load_across_two_directions(cone, share):
    """A plate of 40 g on a slope of 0.15 by 0.2, with a coefficient of 0.5: 0.25, or 0.35 along a pyramid's edges."""
    model = mujoco.MjModel.from_xml_string(SLOPE.format(cone=cone, x=0.15 * G, y=0.2 * G))
    found = cdpr.settle_model(model)
    weight = model.body_mass.sum() * G
    assert found.friction_share == pytest.approx(share, rel=0.05)
    assert {one.bodies for one in found.contact_forces} == {("world", "box")}
    assert sum(one.normal for one in found.contact_forces) == pytest.approx(weight, rel=1e-6)
    assert sum(one.friction for one in found.contact_forces) == pytest.approx(0.25 * weight, rel=1e-3)
    assert [one.share for one in found.contact_forces] == pytest.approx([share] * 4, rel=0.05)
    for one in found.contact_forces:
        assert one.friction == pytest.approx(0.25 * one.normal, rel=0.05)
        assert np.abs(one.position[:2]) == pytest.approx([0.1, 0.1], abs=1e-3)


def test_friction_loss_of_a_joint_holds_up_to_its_limit():
    """m g l of 9.81 N m against 12 N m; with 9 N m the arm falls to where the rest is carried: cos = 9 / 9.81."""
    held = cdpr.settle_model(mujoco.MjModel.from_xml_string(HINGE.format(loss=12)))
    assert held.qpos == pytest.approx([0], abs=1e-2)
    assert held.friction == pytest.approx([-2 * G * 0.5 * np.cos(held.qpos[0])], rel=1e-6)
    assert held.friction_share == pytest.approx(G * np.cos(held.qpos[0]) / 12, rel=1e-6)
    fallen = cdpr.settle_model(mujoco.MjModel.from_xml_string(HINGE.format(loss=9)))
    assert fallen.qpos[0] > np.arccos(9 / G) - 1e-6
    assert fallen.friction_share <= 1


@pytest.mark.parametrize(("half", "speed", "rests"), CREEPS)
def test_what_moves_ever_faster_does_not_rest_on_friction(half, speed, rests, monkeypatch):
    """Creep of more than 0.05 m/s that grows by half within half the time, or of 0.5 m/s; without friction it may."""
    monkeypatch.setattr(evidence, "creep_of", lambda *asked: (half, speed))
    model = mujoco.MjModel.from_xml_string(HINGE.format(loss=12))
    if rests:
        found = cdpr.settle_model(model)
        assert found.creep == speed
    else:
        with pytest.raises(cdpr.NotSettled, match=f"friction could hold, but after 0.5 s it moves at {speed:.2g} m/s"):
            cdpr.settle_model(model)
    free = mujoco.MjModel.from_xml_string(HINGE.format(loss=0))
    assert cdpr.settle_model(free).creep == speed


def test_what_slides_is_not_said_to_move_away_before_it_has():
    """On a slope of 0.6 with a coefficient of 0.5, after a few time steps; in the end nothing holds it."""
    model = mujoco.MjModel.from_xml_string(SLOPE.format(cone="elliptic", x=0.6 * G, y=0))
    with pytest.raises(cdpr.NotSettled, match=r"^slides: friction at its limit does not hold it: joint joint of box$"):
        cdpr.settle_model(model, most_steps=40)
    steep = mujoco.MjModel.from_xml_string(SLOPE.format(cone="elliptic", x=10 * G, y=0))
    with pytest.raises(cdpr.NotSettled, match=r"^falls for ever: nothing holds body box; ignore='box' leaves it out$"):
        cdpr.settle_model(steep)

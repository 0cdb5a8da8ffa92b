"""Pulleys and laws as MuJoCo has them: plain MjModels against plane geometry and polynomials, without any statics."""

import mujoco
import numpy as np
import pytest
from numpy.testing import assert_allclose

from cdpr_sim.core.robot import Robot
from cdpr_sim.core.status import Status
from cdpr_sim.physics.mjcf import to_mjcf
from cdpr_sim.physics.settle import settle, settle_many
from cdpr_sim.robots.catalogue import load_robot

ROUNDING = 1e-14
"""[m] A few rounding errors of lengths of a metre."""

LAW = 1e-11
"""Relative. A tension is EA times the rounding of a length, of strains of a per mille or more."""

UP, DOWN = (0.0, 0.0, 1.0), (0.0, 0.0, -1.0)
BOX = (0.1, 0.1, 0.1)


def simulated(robot: Robot, pose, rest_lengths) -> tuple[mujoco.MjModel, mujoco.MjData]:
    """The robot's own model at the pose it is written for, as a user would compile it."""
    model = mujoco.MjModel.from_xml_string(to_mjcf(robot, pose, rest_lengths))
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    mujoco.mj_forward(model, data)
    return model, data


def wheel_by_hand(exit_point, axis, radius, anchor):
    """(length, direction from the anchor to where the cable leaves the wheel), by compass: tangents to a circle."""
    apart = anchor - exit_point
    out = apart - (apart @ axis) * axis
    out /= np.linalg.norm(out)
    center = exit_point + radius * out
    x, y = (anchor - center) @ out, (anchor - center) @ axis  # in the wheel's plane
    distance = np.hypot(x, y)
    toward = np.arctan2(y, x)
    # The cable runs from the exit, at angle pi, over the far side of the wheel, through angle pi/2.
    leave = toward + np.arccos(radius / distance)
    point = center + radius * (np.cos(leave) * out + np.sin(leave) * axis)
    free = np.linalg.norm(anchor - point)
    wrap = (np.pi - leave) % (2 * np.pi)
    return radius * wrap + free, (point - anchor) / free


@pytest.mark.parametrize("stiffening", [(0.0, 0.0), (5.0, 0.0), (-1.0, 4.0), (8.0, -15.0)])
@pytest.mark.parametrize("strain", [-0.1, 1e-3, 0.02, 0.15])
def test_mujocos_spring_follows_the_law(stiffening, strain):
    """EA (eps + a2 eps² + a3 eps³) on one plumb cable of every strain, and nothing where it is slack."""
    robot = Robot([[0, 0, 2]], [[0, 0, 0]], 700.0, 1.0, stiffening=stiffening, platform_size=BOX)
    rest = 0.8 / (1 + strain)
    _, data = simulated(robot, [0, 0, 1.2], [rest])
    eps = max((0.8 - rest) / rest, 0)
    expected = 700 * (eps + stiffening[0] * eps**2 + stiffening[1] * eps**3)
    assert_allclose(data.qfrc_spring[2], expected, rtol=LAW)


@pytest.mark.parametrize("seed", range(42))
def test_a_tendon_over_a_wheel_is_as_long_and_pulls_as_its_plane_geometry_says(seed):
    """Entry, arc and tangent; the force on the anchor points along the tangent; the wheel is in balance.

    The last two are planar, with the anchor on either side: their wheels do not swivel.
    """
    random, planar = np.random.default_rng(seed), seed >= 40
    axis = random.normal(size=3)
    axis /= np.linalg.norm(axis)
    radius, exit_ = 10 ** random.uniform(-2.5, -1), random.normal(size=3)
    across = np.cross(axis, random.normal(size=3))
    anchor = exit_ + axis * random.normal() * 0.5 + across / np.linalg.norm(across) * random.uniform(2.1 * radius, 1)
    if planar:
        axis, exit_, anchor = np.array(DOWN), np.array([0, 0, 2.0]), np.array([0.4 * (-1) ** seed, 0, 1.2])
    robot = Robot(
        [exit_], [[0, 0, 0]], 500.0, 1.0, pulley_radius=radius, pulley_axis=axis, gravity=0.0, platform_size=BOX,
        mobility="planar" if planar else "spatial",
    )  # fmt: skip
    length, direction = wheel_by_hand(exit_, axis, radius, anchor)
    _, data = simulated(robot, anchor, [length / 1.05])
    assert_allclose(data.ten_length[0], length + 10 * radius, atol=ROUNDING, rtol=0)
    moves = [0, 2] if planar else [0, 1, 2]
    assert_allclose(data.qfrc_spring[: len(moves)], 500 * 0.05 * direction[moves], atol=500 * 1e-12)
    assert planar == (data.qfrc_spring.size == 3)
    assert planar or abs(data.qfrc_spring[6]) < 500 * 1e-12 * radius


@pytest.mark.parametrize(("mass", "radius"), [(1e-4, 1e-3), (0.4, 1e-5), (1e-6, 1e-6)])
def test_tiny_wheels_and_platforms_settle(mass, radius):
    """MuJoCo takes the wheel of a micrometre and the platform of a milligram; a tiny wheel is nearly a point.

    A cable over a wheel differs from a straight one by less than ten radii.
    """
    robot = load_robot("cogiro").replace(mass=mass, pulley_radius=radius, pulley_axis=UP)
    rest = settle(robot, robot.home)
    point = settle(robot.replace(pulley_radius=0.0), robot.home)
    assert rest.residual < 1e-6 * robot.weight
    part = 10 * radius / point.rest_lengths.min()
    assert np.linalg.norm(rest.deviation - point.deviation) < part * np.linalg.norm(point.deviation) + 1e-15
    mujoco.MjModel.from_xml_string(to_mjcf(robot, robot.home, winches=True))  # what ``track`` runs


@pytest.mark.parametrize(("height", "status"), [(2.0, Status.OFF_WHEEL), (1.7, Status.CONVERGED)])
def test_a_slack_cable_whose_anchor_lies_within_its_wheel_is_no_equilibrium(height, status):
    """Another cable holds the platform there. With the wheel further down it has a path, and the platform rests."""
    exits = [[0, 0, height], [0.1, 0, 4]]
    robot = Robot(exits, [[0, 0, 0]] * 2, 1e4, 1.0, pulley_radius=(0.1, 0.0), pulley_axis=UP, platform_size=BOX)
    assert settle_many(robot, [[0.1, 0, 2.05]], [[3.0, 1.95]]).status[0] == status

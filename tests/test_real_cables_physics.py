"""Pulleys, laws and weight as MuJoCo has them: against closed forms and plain MjModels, without any statics."""

import xml.etree.ElementTree as ET

import mujoco
import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.optimize import brentq
from scipy.spatial.transform import RigidTransform

from cdpr_sim.core.errors import InvalidInput
from cdpr_sim.core.robot import Robot
from cdpr_sim.core.status import Status
from cdpr_sim.physics.chains import SEGMENTS
from cdpr_sim.physics.drive import drive
from cdpr_sim.physics.mjcf import place, scene_mjcf, to_mjcf
from cdpr_sim.physics.pulleys import toward_anchors
from cdpr_sim.physics.sagging.chain_derivatives import ChainDerivatives
from cdpr_sim.physics.sagging.settle_chains import single
from cdpr_sim.physics.settle import residual_of, settle, settle_many, settle_trajectory
from cdpr_sim.physics.tendons import let_out
from cdpr_sim.robots.catalogue import load_robot

ROUNDING = 1e-14
"""[m] A few rounding errors of lengths of a metre."""

LAW = 1e-11
"""Relative. A tension is EA times the rounding of a length, of strains of a per mille or more."""

MOVED = 1e-6
"""[m] What a negative control has to move the platform by."""

UP, DOWN = (0.0, 0.0, 1.0), (0.0, 0.0, -1.0)


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


def lengths_at(robot: Robot, position) -> np.ndarray:
    """Of a level platform's cables over their wheels (cables,) [m]."""
    cabling = robot.cabling
    rows = zip(cabling.exits, cabling.pulley_axis, cabling.pulley_radius, cabling.anchors + position, strict=True)
    return np.array([wheel_by_hand(*row)[0] for row in rows])


def with_pulleys(name: str, radius: float = 0.015, axis=UP, **changes) -> Robot:
    return load_robot(name).replace(pulley_radius=radius, pulley_axis=axis, **changes)


# --- a law that stiffens -------------------------------------------------------------------------------------------


@pytest.mark.parametrize("stiffening", [(0.0, 0.0), (5.0, 0.0), (-1.0, 4.0), (8.0, -15.0)])
@pytest.mark.parametrize("strain", [-0.1, 1e-3, 0.02, 0.15])
def test_mujocos_spring_follows_the_law(stiffening, strain):
    """EA (eps + a2 eps² + a3 eps³) on one plumb cable of every strain, and nothing where it is slack."""
    robot = Robot([[0, 0, 2]], [[0, 0, 0]], 700.0, 1.0, stiffening=stiffening, platform_size=(0.1, 0.1, 0.1))
    rest = 0.8 / (1 + strain)
    _, data = simulated(robot, [0, 0, 1.2], [rest])
    eps = (0.8 - rest) / rest
    expected = 700 * (eps + stiffening[0] * eps**2 + stiffening[1] * eps**3) if strain > 0 else 0.0
    assert_allclose(data.qfrc_spring[2], expected, rtol=LAW)


def test_a_winch_lets_out_cable_of_the_same_law():
    """Each length makes a spring of its own: EA (eps + a2 eps² + a3 eps³), eps by the length that is out now."""
    robot = Robot([[0, 0, 2]], [[0, 0, 0]], 700.0, 1.0, stiffening=(4.0, 9.0), platform_size=(0.1, 0.1, 0.1))
    model, data = simulated(robot, [0, 0, 1.2], [0.79])
    equilibria = np.array([[0.79], [0.7], [0.6]])
    for rest, _ in zip(equilibria[:, 0], let_out(model, robot.cabling, equilibria), strict=False):
        mujoco.mj_forward(model, data)
        eps = (0.8 - rest) / rest
        assert_allclose(data.qfrc_spring[2], 700 * (eps + 4 * eps**2 + 9 * eps**3), rtol=LAW)


def test_the_law_is_written_only_where_there_is_one():
    """A linear cable has one number; a stiffening one three, EA/l0, EA a2/l0² and EA a3/l0³, to the last bit."""
    stiffening = np.zeros((8, 2))
    stiffening[2] = (4.0, -2.0)
    robot = load_robot("cogiro").replace(stiffening=stiffening)
    rest = robot.rest_lengths([0.4, 0.25, 0.2])
    text = to_mjcf(robot, [0.4, 0.25, 0.2])
    counts = [len(one.get("stiffness").split()) for one in ET.fromstring(text).iter("spatial")]
    assert counts == [1, 1, 3, 1, 1, 1, 1, 1]
    model = mujoco.MjModel.from_xml_string(text)
    assert_array_equal(model.tendon_stiffnesspoly[2], 1e4 * stiffening[2] / rest[2] ** np.array([2, 3]))
    assert_array_equal(np.delete(model.tendon_stiffnesspoly, 2, axis=0), 0)


# --- a pulley ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", range(40))
def test_a_tendon_over_a_wheel_is_as_long_and_pulls_as_its_plane_geometry_says(seed):
    """Entry, arc and tangent add up; the force on the anchor points back along the tangent; the wheel is in balance."""
    random = np.random.default_rng(seed)
    axis = random.normal(size=3)
    axis /= np.linalg.norm(axis)
    radius, exit_ = 10 ** random.uniform(-2.5, -1), random.normal(size=3)
    across = np.cross(axis, random.normal(size=3))
    anchor = exit_ + axis * random.normal() * 0.5 + across / np.linalg.norm(across) * random.uniform(2.1 * radius, 1)
    robot = Robot(
        [exit_], [[0, 0, 0]], 500.0, 1.0, pulley_radius=radius, pulley_axis=axis, gravity=0.0,
        platform_size=(0.1, 0.1, 0.1),
    )  # fmt: skip
    length, direction = wheel_by_hand(exit_, axis, radius, anchor)
    _, data = simulated(robot, anchor, [length / 1.05])
    assert_allclose(data.ten_length[0], length + 10 * radius, atol=ROUNDING, rtol=0)
    assert_allclose(data.qfrc_spring[:3], 500 * 0.05 * direction, atol=500 * 1e-12)
    assert abs(data.qfrc_spring[6]) < 500 * 1e-12 * radius


@pytest.mark.parametrize("side", [-1, 1])
def test_a_planar_robots_wheel_is_delivered_on_the_side_of_its_anchor(side):
    """It cannot swivel: the model as written has the way over the wheel that plane geometry says."""
    robot = Robot(
        [[0, 0, 2]], [[0, 0, 0]], 500.0, 1.0, pulley_radius=0.05, pulley_axis=DOWN, gravity=0.0, mobility="planar",
        platform_size=(0.1, 0.1, 0.1),
    )  # fmt: skip
    anchor = np.array([0.4 * side, 0, 1.2])
    length, direction = wheel_by_hand(robot.exits[0], np.array(DOWN), 0.05, anchor)
    _, data = simulated(robot, anchor, [length / 1.05])
    assert_allclose(data.ten_length[0], length + 10 * 0.05, atol=ROUNDING, rtol=0)
    assert_allclose(data.qfrc_spring[:2], 500 * 0.05 * direction[[0, 2]], atol=500 * 1e-12)


def test_many_settle_as_one_by_one():
    """Rows with their own wheels, on one side of the axis and on the other, come out as they do alone."""
    robot = with_pulleys("two-cable", axis=UP, stiffening=(2.0, 0.0))
    poses = np.random.default_rng(2).uniform(*robot.workspace, (6, 3))
    poses[::2, 0] += robot.exits[1, 0] - robot.exits[0, 0]  # beyond the second exit: its wheel is on the other side
    rest = np.array([lengths_at(robot, pose) for pose in poses])
    many = settle_many(robot, poses, rest)
    for row, pose in enumerate(poses):
        one = settle(robot, pose, rest[row])
        assert_allclose(many[row].position, one.position, atol=1e-9)
        assert_allclose(many[row].tensions, one.tensions, atol=1e-6)


def test_what_is_read_of_a_slack_cable_is_its_way_over_a_wheel_that_faces_it():
    """Nothing turns the wheel of a slack cable, and its length is still that round the wheel to the anchor."""
    robot = with_pulleys("parallel")
    rest = settle(robot, [0.3, 0.25, 0.15], lengths_at(robot, [0.3, 0.25, 0.15]))
    assert rest.slack.any()
    anchors = rest.pose.apply(robot.anchors)
    for cable in range(robot.cables):
        length, _ = wheel_by_hand(robot.exits[cable], robot.pulley_axis[cable], 0.015, anchors[cable])
        assert_allclose(rest.lengths[cable], length, atol=1e-13)


def test_a_planar_robots_wheels_do_not_swivel():
    """Its model has the platform's three degrees of freedom and no more; a spatial one has one for each wheel."""
    planar, spatial = with_pulleys("planar-vertical"), with_pulleys("cogiro")
    assert simulated(planar, planar.home, None)[0].nv == 3
    assert simulated(spatial, spatial.home, None)[0].nv == 6 + 8


def test_a_swivels_coordinate_means_the_same_in_every_model_of_a_robot():
    """It is an angle from a direction that belongs to the axis, wherever the model is written for."""
    robot = with_pulleys("cogiro")
    here, there = RigidTransform.from_translation([0.3, 0.2, 0.1]), RigidTransform.from_translation([0.5, 0.3, 0.2])
    seen = []
    for written in (here, there):
        model, data = simulated(robot, written, None)
        place(model, data, robot, there)
        mujoco.mj_forward(model, data)
        seen.append((data.qpos.copy(), data.geom("wheel_3").xpos.copy(), data.ten_length.copy()))
    for first, second in zip(*seen, strict=True):
        assert_allclose(first, second, atol=1e-13)


def test_the_wheel_that_is_drawn_is_the_groove():
    """The scene shows a cylinder as large as the sphere that the tendon wraps, at its place, and it weighs nothing."""
    robot = with_pulleys("cogiro", radius=0.02)
    text = to_mjcf(robot, robot.home)
    model = mujoco.MjModel.from_xml_string(scene_mjcf(robot), {"robot.xml": text.encode()})
    for i in range(1, 9):
        wheel, groove = model.geom(f"wheel_{i}"), model.geom(f"groove_{i}")
        assert_array_equal(groove.size[0], 0.02)
        assert_array_equal(wheel.size[0], 0.02)
        assert_allclose(wheel.pos, groove.pos, atol=1e-15)
        assert (wheel.group[0], groove.group[0]) == (2, 4)
    assert model.body_mass.sum() < robot.mass * (1 + 1e-4)


def test_a_platform_is_driven_over_pulleys_with_cables_that_stiffen():
    """At the end of a slow drive it is where it settles, and what is read on the way is that way."""
    robot = with_pulleys("cogiro", axis=DOWN, stiffening=(3.0, 10.0))
    ends = np.array([[0.35, 0.25, 0.15], [0.37, 0.25, 0.15]])
    rest_lengths = np.array([lengths_at(robot, end) for end in ends])
    motion = drive(robot, ends, states=5, rest_lengths=rest_lengths)
    rest = settle(robot, ends[1], rest_lengths[1])
    assert np.linalg.norm(motion.positions[-1] - rest.position) < 1e-5
    assert_allclose(motion.lengths[-1], rest.lengths, atol=1e-5)
    assert_allclose(motion.tensions[-1], rest.tensions, atol=1e-2)


WRAPPED, ROUNDING = 10, 1e-15
"""A cable over a wheel differs from a straight one by less than so many radii; and of a pose in a robot of a metre."""


@pytest.mark.parametrize(("mass", "radius"), [(1e-4, 1e-3), (0.4, 1e-5), (1e-6, 1e-6)])
def test_tiny_wheels_and_platforms_settle(mass, radius):
    """MuJoCo takes the wheel of a micrometre and the platform of a milligram; a tiny wheel is nearly a point."""
    robot = load_robot("cogiro").replace(mass=mass, pulley_radius=radius, pulley_axis=UP)
    rest = settle(robot, robot.home)
    point = settle(robot.replace(pulley_radius=0.0), robot.home)
    assert rest.residual < 1e-6 * robot.weight
    part = WRAPPED * radius / point.rest_lengths.min()
    assert np.linalg.norm(rest.deviation - point.deviation) < part * np.linalg.norm(point.deviation) + ROUNDING
    mujoco.MjModel.from_xml_string(to_mjcf(robot, robot.home, winches=True))  # what ``track`` runs


def test_a_slack_cable_whose_anchor_lies_within_its_wheel_is_no_equilibrium():
    """Another cable holds the platform there. With the wheel further down it has a path, and the platform rests."""
    for height, equilibria in ((2.0, False), (1.7, True)):
        robot = Robot(
            [[0, 0, height], [0.1, 0, 4]], [[0, 0, 0]] * 2, 1e4, 1.0, pulley_radius=(0.1, 0.0), pulley_axis=UP,
            platform_size=(0.1, 0.1, 0.1),
        )  # fmt: skip
        found = settle_many(robot, [[0.1, 0, 2.05]], [[3.0, 1.95]])
        assert (found.status[0] == Status.CONVERGED) == equilibria


# --- weight --------------------------------------------------------------------------------------------------------


def heavy(name: str, linear_density: float = 5e-4, **changes) -> Robot:
    return load_robot(name).replace(linear_density=linear_density, **changes)


def crane() -> Robot:
    """As large as CoGiRo: a frame of 15 m, 4 mm steel cables of 0.064 kg/m, a platform of 90 kg."""
    small = load_robot("cogiro")
    return Robot(18.75 * small.exits, 18.75 * small.anchors, 1e6, 90.0, linear_density=0.064, name="crane")


def test_a_chain_weighs_what_the_cable_does():
    """Masses between the segments and at the anchor are the cable's beyond its wheel, or but for the piece at the exit.

    The tendons are as long as the cable, and the entry of its wheel.
    """
    robot = heavy("cogiro", np.linspace(1e-4, 8e-4, 8), pulley_radius=[0.01, 0.0] * 4, pulley_axis=UP)
    rest = robot.rest_lengths(robot.home)
    model = mujoco.MjModel.from_xml_string(to_mjcf(robot, robot.home))
    first = (1 + np.polynomial.legendre.leggauss(SEGMENTS)[0][0]) / 2
    for i, radius in enumerate(robot.pulley_radius, start=1):
        masses = [model.body(f"node_{i}_{k}").mass[0] for k in range(1, SEGMENTS)] + [model.body(f"end_{i}").mass[0]]
        beyond = rest[i - 1] - robot.wrapped_lengths[i - 1] if radius > 0 else rest[i - 1] * (1 - first)
        assert_allclose(sum(masses), robot.linear_density[i - 1] * beyond, rtol=1e-13)
        bands = np.array([model.tendon_lengthspring[model.tendon(f"cable_{i}_{k}").id] for k in range(1, SEGMENTS + 1)])
        assert_allclose(bands[:, 1].sum(), rest[i - 1] + 10 * radius, rtol=1e-13)
        assert not bands[:, 0].any()  # a segment that is shorter does not push


def test_a_bar_on_two_slanting_heavy_cables_hangs_as_the_catenary_says():
    """A planar point mass between two like exits: H and sag of the elastic catenary (Irvine 1981), solved here anew."""
    density, stiffness, mass, half, length = 0.3, 5e4, 2.0, 1.5, 1.8
    robot = Robot(
        [[-half, 0, 2], [half, 0, 2]], [[0, 0, 0]] * 2, stiffness, mass, linear_density=density, mobility="planar",
        platform_size=(0.1, 0.1, 0.1), name="washing line",
    )  # fmt: skip
    rest = settle(robot, [0, 0, 1], [length, length])
    weight, at_anchor = density * robot.gravity, mass * robot.gravity / 2

    def across(horizontal: float) -> float:
        s = np.arcsinh(np.array([at_anchor, at_anchor + weight * length]) / horizontal)
        return horizontal * length / stiffness + horizontal / weight * (s[1] - s[0]) - half

    horizontal = brentq(across, 1e-3, 1e3, xtol=1e-14)
    ends = np.hypot(horizontal, [at_anchor, at_anchor + weight * length])
    drop = (ends[1] - ends[0]) / weight + length / stiffness * (at_anchor + weight * length / 2)
    assert_allclose(rest.position, [0, 0, 2 - drop], atol=1e-8)
    assert_allclose(rest.tensions, ends[0], rtol=1e-7)


def test_what_is_left_over_is_counted_with_the_true_springs():
    """Softer ones, which are as good on the way to rest, must not be those that say that it has come."""
    robot = heavy("cogiro")
    rest = settle(robot, robot.home)
    hanging = single(rest.problem, rest.pose)
    right = hanging.residuals(hanging.all)
    hanging.stiffnesses[:] *= 0.5
    assert not hanging.true(hanging.all)
    assert hanging.residuals(hanging.all) == right
    assert hanging.true(hanging.all)


def test_many_heavy_robots_settle_as_one_by_one_and_a_motion_ends_where_it_settles():
    """Rows bring their own stiffnesses; the last state of a motion is the rest, looked at as it is."""
    robot, poses = heavy("parallel"), [[0.3, 0.2, 0.2], [0.5, 0.3, 0.15]]
    many = settle_many(robot, poses, axial_stiffness=[[1e3], [1e4]])
    for row, stiffness in enumerate((1e3, 1e4)):
        alone = settle(robot.replace(axial_stiffness=stiffness), poses[row])
        assert_allclose(many[row].position, alone.position, atol=1e-9)
    rest, motion = settle_trajectory(robot, poses[0])
    assert_allclose(motion.positions[-1], rest.position, atol=1e-9)
    assert_allclose(motion.tensions[-1], rest.tensions, atol=1e-5)
    assert (np.diff(motion.times) > 0).all()


def test_a_cable_that_is_too_light_for_mujoco_is_refused():
    """In one sentence that names it."""
    with pytest.raises(InvalidInput, match=r"linear_density: found 1e-15 kg/m in cable 1"):
        settle(heavy("two-cable", linear_density=1e-15), load_robot("two-cable").home)


# --- negative controls ---------------------------------------------------------------------------------------------


def test_one_percent_more_of_a_radius_or_a_coefficient_shows():
    """In MuJoCo's model alone: the platform comes to rest elsewhere, and forces no longer balance at the true rest."""
    robot = with_pulleys("parallel", axial_stiffness=50.0, stiffening=(5.0, 20.0))
    pose = [0.35, 0.25, 0.15]
    lengths = lengths_at(robot, pose)
    rest = settle(robot, pose, lengths)
    text = to_mjcf(robot, pose, lengths)

    def wrong(change) -> mujoco.MjModel:
        model = mujoco.MjModel.from_xml_string(text)
        change(model)
        return model

    def larger(model: mujoco.MjModel) -> None:
        for i in range(1, 9):
            for name in (f"groove_{i}", f"side_{i}"):
                (model.geom if name.startswith("groove") else model.site)(name).pos *= 1.01
            model.geom(f"groove_{i}").size *= 1.01

    def stiffer(model: mujoco.MjModel) -> None:
        model.tendon_stiffnesspoly[:, 0] *= 1.01

    assert residual_of(rest.problem, rest.pose, model=wrong(lambda model: None)) < 1e-8 * robot.weight
    for change in (larger, stiffer):
        model = wrong(change)
        assert np.linalg.norm(settle(robot, pose, lengths, model=model).position - rest.position) > MOVED
        assert residual_of(rest.problem, rest.pose, model=model) > 1e-5 * robot.weight


def test_a_wheel_that_does_not_face_its_anchor_is_out_of_balance():
    """MuJoCo itself turns it back: by the tension times the sideways offset, which the residual would see."""
    robot = with_pulleys("cogiro")
    pose = [0.4, 0.25, 0.15]
    rest = settle(robot, pose, lengths_at(robot, pose))
    model = mujoco.MjModel.from_xml_string(to_mjcf(robot, pose, rest.rest_lengths))
    data = mujoco.MjData(model)
    place(model, data, robot, rest.pose)
    for turn in (0.01, -0.01):
        data.qpos[7] += turn
        mujoco.mj_forward(model, data)
        assert data.qfrc_spring[6] * turn < 0
        assert abs(data.qfrc_spring[6]) > 1e-3 * 0.015 * rest.tensions[0]
        data.qpos[7] -= turn


def test_what_turns_a_wheel_is_out_of_balance_too():
    """A wheel whose groove lies 0.1 mm beside its swivel's plane: facing the anchor, it is still turned."""
    robot = with_pulleys("cogiro")
    pose = [0.4, 0.25, 0.15]
    rest = settle(robot, pose, lengths_at(robot, pose))
    model = mujoco.MjModel.from_xml_string(to_mjcf(robot, pose, rest.rest_lengths))
    model.geom("groove_3").pos[1] += 1e-4
    data = mujoco.MjData(model)
    place(model, data, robot, rest.pose)
    toward_anchors(model, data, robot)
    mujoco.mj_forward(model, data)
    turning = abs(data.qfrc_spring[6 + 2]) / 0.015
    assert turning > 2 * np.abs((data.qfrc_passive - data.qfrc_bias)[:3]).max()
    assert_allclose(residual_of(rest.problem, rest.pose, model=model), turning, rtol=1e-6)


def test_one_percent_more_of_a_weight_shows():
    """In MuJoCo's model of the crane alone: it comes to rest elsewhere, and out of balance where it rested."""
    robot = crane()
    pose = robot.home + np.array([1.0, 0.5, -1.0])
    rest = settle(robot, pose)
    text = to_mjcf(robot, pose)
    model = mujoco.MjModel.from_xml_string(text)
    assert residual_of(rest.problem, rest.pose, model=model) < 1e-7 * robot.weight
    for i in range(1, 9):
        for name in [f"end_{i}", *(f"node_{i}_{k}" for k in range(1, SEGMENTS))]:
            model.body(name).mass *= 1.01
    moved = settle(robot, pose, model=model)
    assert np.linalg.norm(moved.position - rest.position) > MOVED
    assert residual_of(rest.problem, rest.pose, model=model) > 1e-5 * robot.weight


def test_soft_modes_of_a_chain_are_condensed_out_beside_stiff_ones():
    """Chains with modes from 1e-3 to 1e7 N/m: what their condensation leaves is known, one eigenvalue 0.3 N/m."""
    rng = np.random.default_rng(5)
    kept = np.array([0.3, 2.0, 5.0, 1e3, 1e5, 4e5])
    turn = np.linalg.qr(rng.normal(size=(6, 6)))[0]
    direct, across, within = turn @ np.diag(kept) @ turn.T, [], []
    for _ in range(4):
        modes, stiffnesses = np.linalg.qr(rng.normal(size=(15, 15)))[0], np.geomspace(1e-3, 1e7, 15)
        moved = rng.normal(size=(15, 6))  # modal displacements with which the chain follows the platform
        across.append(modes @ (stiffnesses[:, None] * moved))
        whole = modes @ np.diag(stiffnesses) @ modes.T
        within.append((whole + whole.T) / 2)
        direct = direct + moved.T @ (stiffnesses[:, None] * moved)
    parts = direct, np.stack(across), np.stack(within), np.zeros_like(across)
    found = ChainDerivatives(*(part[None] for part in parts)).stiffness()[0][0]
    rounding = 100 * np.finfo(float).eps * np.linalg.norm(direct)
    assert_allclose(found, kept, rtol=0, atol=rounding)
    # Negative control: an inverse multiplied out loses the soft modes.
    out = [one.T @ np.linalg.pinv(w, hermitian=True) @ one for one, w in zip(across, within, strict=True)]
    lost = np.linalg.eigvalsh(direct - sum(out))
    assert abs(lost[0] - kept[0]) > 100 * rounding

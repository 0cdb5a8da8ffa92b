import dataclasses

import numpy as np
import pytest
from sample_problems import garage_crane
from scipy.spatial.transform import RigidTransform

import cdpr_sim as cdpr
from cdpr_sim.core.pose import moved
from cdpr_sim.crosscheck import compare
from cdpr_sim.crosscheck.compare import Verdict
from cdpr_sim.statics import forces

POSE = (0.2, 0.25, 0.1)


@pytest.fixture(scope="module")
def pair(catalogue):
    robot = catalogue["parallel"]
    return cdpr.solve(robot, POSE), cdpr.settle(robot, POSE)


def test_agreement_measures_the_differences_it_is_given(pair):
    """A settled pose moved by 3 µm and turned by 20 µrad: the errors are those, and the verdict is no agreement."""
    static, settled = pair
    elsewhere = moved(settled.pose, np.array([3e-6, 0, 0, 0, 20e-6, 0]))
    agreement = cdpr.compare(static, dataclasses.replace(settled, pose=elsewhere))
    assert agreement.position_error == pytest.approx(3e-6, rel=1e-3)
    assert agreement.rotation_error == pytest.approx(20e-6, rel=1e-3)
    assert agreement.verdict is Verdict.DISAGREE
    assert any(reason.startswith("position differs by 3.0e-06 m") for reason in agreement.reasons)
    assert any("statics at the settled pose" in reason for reason in agreement.reasons)
    assert any("N (tolerance 4e-05)" in reason for reason in agreement.reasons)  # 1e-5 of 3.92 N


def test_agreement_notices_a_cable_that_is_slack_on_one_method_only(pair):
    """The cable is named, counted from 1."""
    static, settled = pair
    tensions = settled.tensions.copy()
    assert tensions[2] > 0
    tensions[2] = 0
    agreement = cdpr.compare(static, dataclasses.replace(settled, tensions=tensions))
    assert not agreement.same_slack
    assert "cable 3 is slack by one method only" in agreement.reasons


@pytest.mark.parametrize(("beyond", "same"), [(0.5e-7, True), (3e-7, False)])
def test_cable_at_its_rest_length_counts_as_slack_or_taut(pair, beyond, same):
    """Within 1e-7 m of the rest length nobody can tell; three times further everybody can."""
    static, settled = pair
    slack = int(np.flatnonzero(static.slack)[0])
    tensions, lengths = settled.tensions.copy(), settled.lengths.copy()
    tensions[slack], lengths[slack] = 1e-4, settled.rest_lengths[slack] + beyond
    agreement = cdpr.compare(static, dataclasses.replace(settled, tensions=tensions, lengths=lengths))
    assert agreement.same_slack is same
    assert agreement.agrees == same


@pytest.mark.parametrize(("beyond", "same"), [(0.5, True), (3.0, False)])
def test_cable_with_mass_that_pulls_by_the_limit_of_slackness_counts_as_slack_or_taut(beyond, same):
    """Within 1e-6 of the load both are right; three times further one of the methods is wrong."""
    robot = garage_crane(linear_density=2.0)
    static, settled = cdpr.solve(robot, (1.5, 1.5, 0.3)), cdpr.settle(robot, (1.5, 1.5, 0.3))
    assert cdpr.compare(static, settled).same_slack
    cable, away = int(np.flatnonzero(static.slack)[0]), beyond * 1e-6 * robot.weight
    loads = [one.tensions.copy() for one in (static, settled)]
    limit = robot.cable_weights[cable] * static.rest_lengths[cable]
    loads[0][cable], loads[1][cable] = limit - away, limit + away
    agreement = cdpr.compare(
        dataclasses.replace(static, tensions=loads[0]), dataclasses.replace(settled, tensions=loads[1])
    )
    assert agreement.same_slack is same


def test_two_stable_equilibria_are_different_and_no_disagreement(catalogue):
    """The crossed cables also hold a platform that lies on its side: each method confirms the other's pose."""
    robot = catalogue["cogiro"]
    rest_lengths = robot.rest_lengths(robot.home)
    upright = cdpr.solve(robot, robot.home, rest_lengths)
    thrown = cdpr.solve(robot, (0.24, 0.21, 0.03, -2.33, 1.06, 0.91), rest_lengths)
    assert np.degrees(thrown.tilt) > 80
    settled = cdpr.settle(robot, thrown.pose, rest_lengths)
    assert cdpr.compare(thrown, settled).verdict is Verdict.AGREE
    agreement = cdpr.compare(upright, settled)
    assert agreement.verdict is Verdict.DIFFERENT_EQUILIBRIA
    assert not agreement.agrees
    assert agreement.static_in_mujoco < 1e-6
    assert agreement.settled_in_statics < 1e-6


def test_saddle_is_named_as_the_reason():
    """Where SEECR stops at a saddle and MuJoCo goes on, the reason says which of the two is unstable."""
    robot = cdpr.Robot(
        exits=[[-0.1, 0, 1], [0.1, 0, 1]],
        anchors=[[-0.1, 0, 0], [0.1, 0, 0]],
        center_of_mass=[0, 0, 0.2],
        axial_stiffness=50.0,
        mass=1.0,
        mobility="planar",
    )
    saddle = cdpr.solve(robot, (0, 0, 0), method="fsolve")
    agreement = cdpr.compare(saddle, cdpr.settle(robot, (0, 0, 0)))
    assert agreement.verdict is Verdict.DIFFERENT_EQUILIBRIA
    assert "the equilibrium by seecr/fsolve is unstable" in agreement.reasons


def test_platform_that_turns_freely_agrees_in_all_that_is_held(catalogue):
    """On two diagonal cables the platform may turn: rotations differ, and forces balance halfway between."""
    robot = catalogue["parallel"]
    pose = (0.1, 0.1, 0.05)
    static, settled = cdpr.solve(robot, pose), cdpr.settle(robot, pose)
    agreement = cdpr.compare(static, settled)
    assert agreement.verdict is Verdict.AGREE_EXCEPT_NEUTRAL
    assert agreement.agrees
    assert agreement.rotation_error > 0.01
    assert agreement.position_error < 1e-6
    halfway = halfway_between(static, settled)
    assert forces.at(static.problem, halfway.translation, halfway.rotation.as_matrix()).residual < 1e-5 * robot.weight


@pytest.mark.parametrize("scale", [1e-4, 1e4])
def test_verdicts_do_not_depend_on_how_much_a_platform_weighs(catalogue, scale):
    """Grams or tonnes, on cables as much softer or stiffer: what is level, what is balanced and what is not."""
    robot = catalogue["parallel"]
    robot = robot.replace(mass=scale * robot.mass, axial_stiffness=scale * robot.axial_stiffness)
    free = cdpr.compare(cdpr.solve(robot, (0.1, 0.1, 0.05)), cdpr.settle(robot, (0.1, 0.1, 0.05)))
    assert free.verdict is Verdict.AGREE_EXCEPT_NEUTRAL
    static, settled = cdpr.solve(robot, POSE), cdpr.settle(robot, POSE)
    assert cdpr.compare(static, settled).verdict is Verdict.AGREE
    beside = dataclasses.replace(settled, pose=moved(settled.pose, np.array([5e-7, 0, 0, 0, 0, 0])))
    agreement = cdpr.compare(static, beside)
    assert agreement.position_error < compare.POSITION_TOLERANCE
    assert any("statics at the settled pose has" in reason for reason in agreement.reasons)


def halfway_between(a, b):
    return a.pose * RigidTransform.from_exp_coords((a.pose.inv() * b.pose).as_exp_coords() / 2)


def test_names_and_workspaces_do_not_make_problems_different(catalogue):
    """Nor where the platform was released: only what the equilibrium depends on."""
    robot = catalogue["parallel"]
    static = cdpr.solve(robot, (0.3, 0.25, 0.1))
    same = robot.replace(name="the same in another place", workspace=[[0, 0, 0], [1, 1, 1]])
    from_elsewhere = cdpr.settle(same, (0.32, 0.25, 0.12), static.rest_lengths)
    assert cdpr.compare(static, from_elsewhere).verdict is Verdict.AGREE


def same_family(a, b):
    poses = (RigidTransform.concatenate([one.pose]) for one in (a, b))
    return compare.connected(cdpr.Problems.stack([a.problem]), *poses)[0]


def test_poses_are_of_one_family_where_the_energy_is_level_between(catalogue):
    """A mass on one cable turns freely; not when it is lifted by a millimetre, nor against a torque that does work."""
    robot = cdpr.Robot([[0, 0, 1]], [[0, 0, 0]], 1e3, 1.0, platform_size=(0.1, 0.1, 0.1))
    for torque, lift, connected in ((0.0, 0.0, True), (0.0, 1e-3, False), (0.1, 0.0, False)):
        hanging = cdpr.solve(robot, (0, 0, 0.2))
        problem = cdpr.Problem.of(robot, (0, 0, 0.2), external_wrench=[0, 0, 0, 0, 0, torque])
        static = dataclasses.replace(hanging, problem=problem)
        turned = moved(static.pose, np.array([0, 0, lift, 0, 0, 0.5]))
        assert same_family(static, dataclasses.replace(static, pose=turned)) == connected


@pytest.mark.parametrize("size", [0.02, 2.0])
def test_how_level_is_level_goes_with_load_and_size(size):
    """A platform above its slack cable, lifted: the work of its weight over that of its load on its length."""
    robot = cdpr.Robot([[0, 0, 1]], [[0, 0, 0]], 1e3, 2.0, platform_size=(size,) * 3, gravity=10.0)
    above = dataclasses.replace(cdpr.solve(robot, (0, 0, 0.2)), pose=RigidTransform.from_translation([0, 0, 0.9]))
    for share, level in ((0.5, True), (2.0, False)):
        lift = share * compare.LEVEL * robot.characteristic_length
        lifted = dataclasses.replace(above, pose=RigidTransform.from_translation([0, 0, 0.9 + lift]))
        assert same_family(above, lifted) == level
    # A torque that turns it does the work that lifts it, one the other way does not.
    for torque, level in ((20.0 * 0.01 / 0.5, True), (-20.0 * 0.01 / 0.5, False)):
        problem = cdpr.Problem.of(robot, (0, 0, 0.2), external_wrench=[0, 0, 0, 0, 0, torque])
        held = dataclasses.replace(above, problem=problem)
        turned = dataclasses.replace(held, pose=moved(held.pose, np.array([0, 0, 0.01, 0, 0, 0.5])))
        assert same_family(held, turned) == level

"""The cross-check: statics and MuJoCo, which share no physics code, agree on pose, tilt, tensions and slack cables.

And the negative controls: with the model broken ever so slightly, the same checks fail.
"""

import xml.etree.ElementTree as ET

import mujoco
import numpy as np
import pytest
from hypothesis import given, settings
from sample_problems import grid, random_problems

import cdpr_sim as cdpr
from cdpr_sim.crosscheck.compare import CROSS_TOLERANCE, POSITION_TOLERANCE, TENSION_TOLERANCE, Verdict, compare_many
from cdpr_sim.physics.settle import residual_of
from cdpr_sim.robots.catalogue import PAPER_ROBOTS
from cdpr_sim.statics import forces, newton

MATERIALS = ["vectran-0.7mm", "fishing-0.4mm"]

MOST_FREE = 0.08
"""Largest fraction of poses at which a platform may turn freely about two diagonal cables: only on ``parallel``, where
70 of these 1,440 do with Vectran; see test_newton."""


def verdicts_of(solved: cdpr.EquilibriumBatch, settled: cdpr.EquilibriumBatch) -> list[Verdict]:
    """Of every row; the errors are within tolerance wherever the two agree, as ``compare`` says itself elsewhere."""
    assert solved.converged.all()
    assert settled.converged.all()
    many = compare_many(solved, settled)
    assert many.errors["position_error"].max() <= POSITION_TOLERANCE
    assert many.errors["tension_error"].max() <= TENSION_TOLERANCE
    for row in range(len(solved)):
        assert many.agreement(row).agrees, many.agreement(row).reasons
        assert many.agreement(row).same_slack
    return many.verdicts.tolist()


def methods(robot: cdpr.Robot, positions: np.ndarray) -> tuple[cdpr.EquilibriumBatch, cdpr.EquilibriumBatch]:
    """Both methods' answers to the same problems."""
    problems = cdpr.Problems.of(robot, positions)
    return cdpr.solve_many(problems), cdpr.settle_many(problems)


@pytest.mark.parametrize("name", PAPER_ROBOTS)
def test_methods_find_the_same_imbalance_away_from_equilibrium(catalogue, name):
    """Held at poses that are no equilibria, under a wrench: the same unbalanced force, torques over the same length."""
    robot = catalogue[name].replace(center_of_mass=(0.01, 0, -0.005), material="fishing-0.4mm")
    rng = np.random.default_rng(0)
    free = np.isin(np.arange(6), robot.free)
    lengths = 0.99 * robot.rest_lengths(robot.home)
    torques_decide = 0
    for _ in range(20):
        wrench = rng.normal(size=6) * [1, 1, 1, 0.5, 0.5, 0.5] * free
        problem = cdpr.Problem.of(robot, robot.home, lengths, wrench)
        at = robot.pose(np.append(robot.home, [0, 0, 0]) + rng.normal(size=6) * np.repeat([0.01, 0.1], 3) * free)
        state = forces.at(problem, at.translation, at.rotation.as_matrix())
        assert residual_of(problem, at) == pytest.approx(state.residual, rel=1e-9)
        net = np.abs(state.net_wrench)[robot.free]
        torques_decide += state.residual > net[np.array(robot.free) < 3].max()
    assert 0 < torques_decide < 20


@pytest.mark.parametrize("material", MATERIALS)
@pytest.mark.parametrize("name", PAPER_ROBOTS)
def test_methods_agree_over_the_workspace(catalogue, name, material):
    """At each of 300 poses and more the two agree, or differ only where the platform may turn freely."""
    robot = catalogue[name].replace(material=material)
    positions = grid(robot, 300)
    assert len(positions) >= 300
    verdicts = verdicts_of(*methods(robot, positions))
    free = np.mean([verdict is Verdict.AGREE_EXCEPT_NEUTRAL for verdict in verdicts])
    assert free <= (MOST_FREE if name == "parallel" else 0)
    assert (free > 0) == (name == "parallel")


def test_methods_agree_on_random_robots():
    """Soft or stiff, light or heavy, pushed or not: they agree, or each confirms the other's own equilibrium.

    Both start at the commanded pose: unless they are pushed, nearly all end at the same one.
    """
    unpushed = []

    @settings(max_examples=50, database=None)
    @given(random_problems())
    def verify_compensation(problem):
        settled = cdpr.settle(problem)
        agreement = cdpr.compare(newton.solve(problem), settled)
        assert agreement.verdict is not Verdict.DISAGREE, agreement.reasons
        if not problem.external_wrench.any():
            unpushed.append(agreement.agrees)

    verify_compensation()
    assert len(unpushed) > 20
    assert np.mean(unpushed) > 0.9


# --- a torque on a spatial platform, against closed forms of its own -------------------------------------------------

CLOSED_FORM = 1e-7
"""[m, rad, and relative] At rest 1e-9 of the load is unbalanced, on suspensions that weigh a newton per centimetre."""


def both_methods(problem: cdpr.Problem) -> list[cdpr.Equilibrium]:
    """What solve and settle say; and they agree."""
    both = [cdpr.solve(problem), cdpr.settle(problem)]
    assert cdpr.compare(*both).verdict is Verdict.AGREE
    return both


@pytest.mark.parametrize("angle", [0.5, -1.2])
def test_torque_about_the_vertical_twists_a_suspension_on_parallel_cables(angle):
    """Twisted by γ, n cables at radius r lean by their chord 2 r sin(γ/2) and lift the platform: M = m g r² sin γ / h.

    Each carries m g l/(n h), with l² = h² + 4 r² sin²(γ/2); the horizontal parts of the pulls are what turns it back.
    To hang at the height h below its exits, a cable has the rest length l EA/(EA + tau).
    """
    radius, height, mass, cables = 0.3, 1.2, 2.0, 3
    around = np.linspace(0, 2 * np.pi, cables, endpoint=False)
    circle = radius * np.stack([np.cos(around), np.sin(around), np.zeros(cables)], axis=1)
    stiffness = np.array([2e3, 3e3, 5e3])
    robot = cdpr.Robot(circle + np.array([0, 0, 2.0]), circle, stiffness, mass, name="trifilar")
    length = np.hypot(height, 2 * radius * np.sin(angle / 2))
    tension = robot.weight * length / (cables * height)
    torque = robot.weight * radius**2 * np.sin(angle) / height
    rest_lengths = length * stiffness / (stiffness + tension)
    problem = cdpr.Problem.of(robot, (0, 0, 0.8), rest_lengths, [0, 0, 0, 0, 0, torque])
    for rest in both_methods(problem):
        np.testing.assert_allclose(rest.position, [0, 0, 2.0 - height], atol=CLOSED_FORM)
        np.testing.assert_allclose(rest.rotation.as_rotvec(), [0, 0, angle], atol=CLOSED_FORM)
        np.testing.assert_allclose(rest.tensions, tension, rtol=CLOSED_FORM)
        assert rest.stable


@pytest.mark.parametrize(("tilt", "share"), [(0.3, 0.5), (-0.6, 0.3), (0.2, 0.7)])
def test_torque_about_horizontal_axes_tilts_a_trapeze_and_loads_one_rope_more(tilt, share):
    """A bar along x on two plumb ropes: about x it leans until m g d sin(tilt) = M_x, about y M_y = a (tau2 − tau1).

    d is the anchors' height above the centre of mass, which is not the platform's origin, and ±a are their places.
    """
    half, anchor, center, height = 0.25, 0.1, -0.15, 1.3
    anchors = np.array([[-half, 0, anchor], [half, 0, anchor]])
    stiffness = np.array([400.0, 900.0])
    robot = cdpr.Robot(
        anchors + np.array([0, 0, 2.0]), anchors, stiffness, 1.5, center_of_mass=[0, 0, center], name="trapeze"
    )
    tensions = robot.weight * np.array([1 - share, share])
    torque = [robot.weight * (anchor - center) * np.sin(tilt), half * (tensions[1] - tensions[0])]
    rest_lengths = height * stiffness / (stiffness + tensions)
    problem = cdpr.Problem.of(robot, (0, 0, 0.7), rest_lengths, [0, 0, 0, *torque, 0])
    up = np.array([0, -np.sin(tilt), np.cos(tilt)])
    for rest in both_methods(problem):
        np.testing.assert_allclose(rest.rotation.as_rotvec(), [tilt, 0, 0], atol=CLOSED_FORM)
        np.testing.assert_allclose(rest.position, [0, 0, 2.0 + anchor - height] - anchor * up, atol=CLOSED_FORM)
        np.testing.assert_allclose(rest.tensions, tensions, rtol=CLOSED_FORM)
        assert rest.stable


@pytest.mark.parametrize("seed", range(5))
def test_any_wrench_at_any_pose_is_balanced_by_the_tensions_that_it_was_made_of(seed):
    """Choose a pose and tensions; by hand, the wrench and rest lengths that make it an equilibrium; both find it.

    W tau + w_e = 0 with every component of the wrench at work, the centre of mass beside the origin, the pose turned.
    """
    rng = np.random.default_rng(seed)
    exits = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) * [1.0, 0.8, 0.6]
    anchors = -exits[:, [1, 0, 2]] * [-0.1, 0.1, 0.15]  # crossed
    robot = cdpr.Robot(exits, anchors, rng.uniform(1e3, 5e3, 8), 1.0, center_of_mass=(0.02, -0.03, 0.01), name="made")
    pose = robot.pose(np.concatenate([rng.uniform(-0.1, 0.1, 3), rng.uniform(-0.2, 0.2, 3)]))
    tensions = rng.uniform(20, 60, 8)
    arms = anchors @ pose.rotation.as_matrix().T
    cables = exits - pose.translation - arms
    lengths = np.linalg.norm(cables, axis=1)
    pulls = cables * (tensions / lengths)[:, None]
    weight = np.array([0, 0, -robot.mass * 9.81])
    force = -pulls.sum(0) - weight
    torque = -np.cross(arms, pulls).sum(0) - np.cross(pose.rotation.as_matrix() @ robot.center_of_mass, weight)
    rest_lengths = lengths * robot.axial_stiffness / (robot.axial_stiffness + tensions)
    assert np.abs(torque).min() > 0.01
    problem = cdpr.Problem.of(robot, (0, 0, 0), rest_lengths, [*force, *torque])
    for rest in both_methods(problem):
        np.testing.assert_allclose(rest.position, pose.translation, atol=CLOSED_FORM)
        assert (rest.rotation * pose.rotation.inv()).magnitude() < CLOSED_FORM
        np.testing.assert_allclose(rest.tensions, tensions, rtol=1e-4)
        assert rest.stable


# --- negative controls: a broken model must disagree -----------------------------------------------------------------


def stiffer_tendon(root: ET.Element) -> None:
    """Cable 1 is 1 % stiffer."""
    cable = root.find("./tendon/spatial[@name='cable_1']")
    assert cable is not None
    cable.set("stiffness", repr(1.01 * float(cable.attrib["stiffness"])))


def moved_anchor(root: ET.Element) -> None:
    """Anchor 1 sits 1 mm lower on the platform."""
    anchor = root.find(".//site[@name='anchor_1']")
    assert anchor is not None
    x, y, z = (float(number) for number in anchor.attrib["pos"].split())
    anchor.set("pos", f"{x!r} {y!r} {z - 1e-3!r}")


def pushing_cable(root: ET.Element) -> None:
    """Cable 2, slack, is a spring that pushes as well."""
    cable = root.find("./tendon/spatial[@name='cable_2']")
    assert cable is not None
    _, rest_length = cable.attrib["springlength"].split()
    cable.set("springlength", f"{rest_length} {rest_length}")


def tilted_gravity(root: ET.Element) -> None:
    """Gravity leans by 0.1° towards x."""
    option = root.find("./option")
    assert option is not None
    _, _, down = (float(number) for number in option.attrib["gravity"].split())
    angle = np.radians(0.1)
    option.set("gravity", f"{float(-down * np.sin(angle))!r} 0 {float(down * np.cos(angle))!r}")


POSE = (0.17, 0.25, 0.1)
"""On ``parallel``: cable 1 is taut and cable 2 slack."""


def settled_in(model_text: str, robot: cdpr.Robot) -> cdpr.Equilibrium:
    return cdpr.settle(robot, POSE, model=mujoco.MjModel.from_xml_string(model_text))


def test_model_given_as_text_agrees_when_nothing_is_broken(catalogue):
    """The negative controls' own control: written, read and settled unchanged, the model agrees."""
    robot = catalogue["parallel"]
    text = ET.tostring(ET.fromstring(cdpr.to_mjcf(robot, POSE)), encoding="unicode")
    agreement = cdpr.compare(cdpr.solve(robot, POSE), settled_in(text, robot))
    assert agreement.verdict is Verdict.AGREE, agreement.reasons


@pytest.mark.parametrize("break_it", [stiffer_tendon, moved_anchor, pushing_cable, tilted_gravity])
@pytest.mark.parametrize("material", MATERIALS)
def test_broken_model_disagrees(catalogue, material, break_it):
    """One tendon 1 % stiffer, one anchor 1 mm off, one cable that pushes, gravity off by 0.1°: each is noticed."""
    robot = catalogue["parallel"].replace(material=material)
    root = ET.fromstring(cdpr.to_mjcf(robot, POSE))
    break_it(root)
    settled = settled_in(ET.tostring(root, encoding="unicode"), robot)
    agreement = cdpr.compare(cdpr.solve(robot, POSE), settled)
    assert agreement.verdict is Verdict.DISAGREE
    assert agreement.settled_in_statics > 10 * CROSS_TOLERANCE * robot.weight

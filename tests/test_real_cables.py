"""Cables over pulleys, with nonlinear elasticity, with mass. Formulas, both methods, and what is refused."""

import dataclasses
import warnings

import mujoco
import numpy as np
import pytest
from numpy.testing import assert_allclose
from sample_problems import random_robot
from scipy.integrate import quad
from scipy.spatial.transform import Rotation

import cdpr_sim as cdpr
from cdpr_sim.analysis.workspace.feasibility import capacity_margin
from cdpr_sim.core import cable_law, cable_path
from cdpr_sim.core.robot_batch import RobotBatch
from cdpr_sim.crosscheck.compare import Verdict
from cdpr_sim.design.layout_equilibria import Cases, solve_layouts
from cdpr_sim.drawing.cable_curves import cable_curve, wheel_of
from cdpr_sim.statics import derivatives, forces
from cdpr_sim.statics.profiles import catenary

SOFT = 1e3
"""[N] EA with which DemoBot's cables strain by some per mille, so that laws and lengths show."""

KINDS = {
    "pulleys": dict(pulley_radius=0.02),
    "pulleys, arriving from below": dict(pulley_radius=0.01, pulley_axis=(0, 0, 1)),
    "stiffening": dict(stiffening=(8.0, -20.0)),
    "pulleys and stiffening": dict(pulley_radius=0.01, stiffening=(8.0, -20.0)),
}


def robot_with(name: str, kind: str) -> cdpr.Robot:
    return cdpr.load_robot(name).replace(axial_stiffness=SOFT, **KINDS[kind])


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


def test_path_over_a_wheel_is_what_a_compass_draws():
    """Length and direction at 2,000 random wheels and anchors, by tangents to a circle; a point where the wheel is."""
    rng = np.random.default_rng(3)
    seen = 0
    for _ in range(2000):
        axis = rng.normal(size=3)
        axis /= np.linalg.norm(axis)
        radius, exit_point, anchor = 10 ** rng.uniform(-3, -1), rng.uniform(-1, 1, 3), rng.uniform(-1, 1, 3)
        robot = cdpr.Robot(
            [exit_point], [[0, 0, 0]], 1.0, 1.0, pulley_radius=radius, pulley_axis=axis, platform_size=(1, 1, 1)
        )
        length = cable_path.lengths(robot.cabling, anchor, np.eye(3))[0]
        if np.isnan(length):
            continue
        seen += 1
        expected, direction = wheel_by_hand(exit_point, axis, radius, anchor)
        assert length == pytest.approx(expected, rel=1e-12)
        found = forces.geometry(robot, anchor, np.eye(3))
        assert np.abs(found.directions[0] - direction).max() < 1e-10
        point = np.linalg.norm(anchor - exit_point)
        assert point - 1e-12 <= length <= point + 2 * np.pi * radius
    assert seen > 1500


@pytest.mark.parametrize("kind", KINDS)
def test_wrench_and_stiffness_are_the_derivatives_of_the_energy(kind):
    """Net wrench against differences of the energy, its slope against differences of the net wrench."""
    robot = robot_with("cogiro", kind)
    rng, step = np.random.default_rng(4), 1e-6
    problem = cdpr.Problem.of(robot, robot.home, 0.98 * robot.rest_lengths(robot.home))
    for _ in range(5):
        position, rotation = robot.home + rng.uniform(-0.1, 0.1, 3), Rotation.from_rotvec(rng.uniform(-0.3, 0.3, 3))
        state = forces.at(problem, position, rotation.as_matrix())
        assert (state.tensions > 0).any()
        slope = derivatives.wrench_slope(state)
        for a, unit in enumerate(np.eye(6)):
            ends = [
                forces.at(
                    problem,
                    position + sign * step * unit[:3],
                    (Rotation.from_rotvec(sign * step * unit[3:]) * rotation).as_matrix(),
                )
                for sign in (1, -1)
            ]
            by_energy = -(ends[0].energy - ends[1].energy) / (2 * step)
            assert by_energy == pytest.approx(state.net_wrench[a], abs=1e-6 * np.abs(state.net_wrench).max())
            change = (ends[0].net_wrench - ends[1].net_wrench) / (2 * step)
            assert np.abs(change - slope[:, a]).max() < 1e-5 * np.abs(slope).max()


@pytest.mark.parametrize("coefficients", [(0.0, 0.0), (8.0, -20.0), (-1.0, 0.0), (3.0, 5.0)])
def test_law_is_the_polynomial_and_its_energy_the_integral(coefficients):
    """Tension by the polynomial written out; energy by quadrature; the touching spring by differences; and back."""
    a2, a3 = coefficients
    for stretch in (-0.1, 0.0, 0.003, 0.05, 0.2, 0.35):
        law = 1.3, 100.0, a2, a3
        strain = max(stretch, 0) / 1.3
        tension = cable_law.tension(stretch, *law)
        if strain <= 0.2:
            assert tension == pytest.approx(100 * (strain + a2 * strain**2 + a3 * strain**3), abs=1e-12)
        integral, _ = quad(lambda s, law=law: cable_law.tension(s, *law), 0, max(stretch, 0), points=[0.26])
        assert cable_law.energy(stretch, *law) == pytest.approx(integral, abs=1e-12)
        k, e = cable_law.tangent(stretch, *law)
        assert k * max(e, 0) == pytest.approx(tension, abs=1e-12)
        if stretch > 0:
            slope = (cable_law.tension(stretch + 1e-6, *law) - cable_law.tension(stretch - 1e-6, *law)) / 2e-6
            assert k == pytest.approx(slope, rel=1e-7)
            assert cable_law.rest_length_for(1.3 + stretch, tension, 100.0, a2, a3) == pytest.approx(1.3, rel=1e-12)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("name", ["cogiro", "parallel", "planar-vertical"])
def test_both_methods_agree(name, kind):
    """40 poses of each robot: positions, lengths, tensions, slack cables and stiffness, and the verdict of compare."""
    robot = robot_with(name, kind)
    positions = np.random.default_rng(1).uniform(*robot.workspace, (40, 3))
    solved, settled = cdpr.solve_many(robot, positions), cdpr.settle_many(robot, positions)
    assert (solved.status == settled.status).all()
    rows = np.flatnonzero(solved.converged)
    assert len(rows) >= 38  # the others lie under a wheel's footprint
    assert np.abs(solved.positions - settled.positions)[rows].max() < 1e-9
    assert np.abs(solved.lengths - settled.lengths)[rows].max() < 1e-9
    assert np.abs(solved.tensions - settled.tensions)[rows].max() < 1e-6
    assert (solved.slack == settled.slack)[rows].all()
    assert np.abs(solved.eigenvalues / settled.eigenvalues - 1)[rows].max() < 1e-6
    assert cdpr.compare(solved[int(rows[0])], settled[int(rows[0])]).verdict is Verdict.AGREE


@pytest.mark.parametrize(
    ("kind", "change"),
    [("pulleys", dict(pulley_radius=0.0202)), ("stiffening", dict(stiffening=(8.08, -20.0)))],
)
def test_one_percent_in_mujoco_alone_is_noticed(kind, change):
    """Negative control: 1 % more radius, or 1 % more a2, in MuJoCo's model, on the same rest lengths."""
    robot = robot_with("parallel", kind)
    problem = cdpr.Problem.of(robot, (0.2, 0.25, 0.1))
    assert cdpr.compare(cdpr.solve(problem), cdpr.settle(problem)).verdict is Verdict.AGREE
    xml = cdpr.to_mjcf(robot.replace(**change), problem.pose, problem.rest_lengths)
    broken = cdpr.settle(problem, model=mujoco.MjModel.from_xml_string(xml))
    assert cdpr.compare(cdpr.solve(problem), broken).verdict is Verdict.DISAGREE


def test_every_solver_knows_pulleys_and_laws():
    """fsolve finds what Newton finds; compensation holds its pose; a radius' effect is that of changing it."""
    robot = robot_with("cogiro", "pulleys and stiffening")
    pose = (0.3, 0.2, 0.1)
    found = cdpr.solve(robot, pose)
    assert np.abs(cdpr.solve(robot, pose, method="fsolve").position - found.position).max() < 1e-8
    held = cdpr.compensate(robot, pose)
    assert held.exact
    assert np.abs(cdpr.settle(robot, pose, held.rest_lengths).position - pose).max() < 1e-8
    effects = cdpr.sensitivity(found)
    radii, step = robot.cabling.pulley_radius.copy(), 1e-7
    radii[2] += step
    moved = cdpr.solve(robot.replace(pulley_radius=radii), pose, found.rest_lengths)
    by_difference = (moved.position - found.position) / step
    assert np.abs(by_difference - effects.pose["pulley_radius"][:3, 2]).max() < 1e-5
    assert cdpr.feasible(robot, pose)


def test_lengths_that_know_no_pulleys_miss():
    """The headline: DemoBot's pose is off by some 0.7 mm per mm of radius where lengths are those of points."""
    point = cdpr.load_robot("cogiro")
    over = point.replace(pulley_radius=0.03, pulley_axis=(0, 0, 1))
    positions = np.random.default_rng(5).uniform(*point.workspace, (200, 3))
    home = over.rest_lengths(point.home) - point.rest_lengths(point.home)
    points = cable_path.lengths(point.cabling, positions, np.eye(3)) + home
    found = cdpr.solve_many(over, positions, points)
    error = np.linalg.norm(found.positions - positions, axis=1)[found.converged]
    assert 0.2e-3 < np.median(error) / 30 < 2e-3  # metres of error per millimetre of radius


@pytest.mark.parametrize("kind", ["weight", "pulleys", "stiffening"])
def test_random_robots_balance_by_an_independent_hand(kind):
    """200 random robots: the forces of each cable worked out another way add up to the load."""
    rng, balanced = np.random.default_rng(6), 0
    for _ in range(200):
        cables = int(rng.integers(3, 9))
        exits, anchors = rng.uniform([-1, -1, 0.6], [1, 1, 1.5], (cables, 3)), rng.uniform(-0.15, 0.15, (cables, 3))
        mass, stiffness = 10 ** rng.uniform(-1, 2), 10 ** rng.uniform(3, 6)
        own = {
            "weight": dict(linear_density=10 ** rng.uniform(-4, 0, cables) * mass),
            "pulleys": dict(
                pulley_radius=10 ** rng.uniform(-3, -1.2, cables), pulley_axis=rng.normal(size=(cables, 3))
            ),
            "stiffening": dict(stiffening=np.column_stack([rng.uniform(0, 10, cables), rng.uniform(-5, 20, cables)])),
        }[kind]
        robot = cdpr.Robot(exits, anchors, stiffness * mass, mass, **own)
        try:
            found = cdpr.solve(robot, rng.uniform([-0.5, -0.5, -0.2], [0.5, 0.5, 0.4]))
        except cdpr.InvalidInput:
            continue  # an anchor under its wheel's footprint
        assert unbalanced_by_hand(found) < 1e-6 * robot.weight
        balanced += 1
    assert balanced > 120


def unbalanced_by_hand(found: cdpr.Equilibrium) -> float:
    """The largest unbalanced force [N], torques over the characteristic length, cable by cable."""
    robot = found.problem.robot
    force, torque = np.array([0, 0, -robot.weight]), np.zeros(3)
    for cable in range(robot.cables):
        arm = found.rotation_matrix @ robot.anchors[cable]
        pull = pull_by_hand(found, cable, found.position + arm)
        force, torque = force + pull, torque + np.cross(arm, pull)
    return float(np.abs([force, torque / robot.characteristic_length]).max())


def pull_by_hand(found: cdpr.Equilibrium, cable: int, anchor: np.ndarray) -> np.ndarray:
    """The force of one cable on its anchor, by another formula than the package's."""
    robot = found.problem.robot
    cabling, exit_point, rest = robot.cabling, robot.exits[cable], found.rest_lengths[cable]
    EA, (a2, a3) = robot.axial_stiffness[cable], cabling.stiffening[cable]
    weight = cabling.linear_density[cable] * robot.gravity
    if weight > 0:
        # Irvine's catenary, integrated from the force at the anchor to the exit: it must arrive there.
        pull = catenary(exit_point, anchor, rest, EA, weight).pull
        reached = anchor + irvine(pull, rest, EA, weight)
        assert np.abs(reached - exit_point).max() < 1e-7
        return pull
    length, direction = np.linalg.norm(exit_point - anchor), (exit_point - anchor) / np.linalg.norm(exit_point - anchor)
    if cabling.pulley_radius[cable] > 0:
        axis, radius = cabling.pulley_axis[cable], cabling.pulley_radius[cable]
        length, direction = wheel_by_hand(exit_point, axis, radius, anchor)
    strain = max(length / rest - 1, 0)
    assert strain < 0.2
    return EA * (strain + a2 * strain**2 + a3 * strain**3) * direction


def irvine(pull, rest, EA, weight):
    """From the anchor to the exit, of a cable that pulls so on its anchor (Irvine 1981, eq. 1.18 and 1.19)."""
    level, up = np.hypot(*pull[:2]), pull[2]
    ends = np.hypot(level, up), np.hypot(level, up + weight * rest)
    horizontal = level * rest / EA + level / weight * (
        np.arcsinh((up + weight * rest) / level) - np.arcsinh(up / level)
    )
    vertical = rest / EA * (up + 0.5 * weight * rest) + (ends[1] - ends[0]) / weight
    return np.array([*(horizontal * pull[:2] / level), vertical])


# --- weight on some cables, pulleys or laws on others -----------------------------------------------------------------

KINDS_BESIDE = {
    "a pulley": dict(pulley_radius=[0.02] * 7 + [0]),
    "nonlinear elasticity": dict(stiffening=[(8.0, -20.0)] * 7 + [(0, 0)]),
}

POSE = (0.3, 0.25, 0.1)


def mixed(kind: str, density: float = 1e-6) -> cdpr.Robot:
    """DemoBot with mass on the last cable, and a pulley or a law on all others."""
    beside = KINDS_BESIDE[kind]
    return cdpr.load_robot("cogiro").replace(axial_stiffness=SOFT, linear_density=[0] * 7 + [density], **beside)


@pytest.mark.parametrize("kind", KINDS_BESIDE)
def test_both_methods_agree_on_weight_beside_pulleys_or_laws(kind):
    """Statics once solved it as if there were none, and called converged what had 110 N unbalanced."""
    robot = mixed(kind, 5e-3)
    solved, settled = cdpr.solve(robot, POSE), cdpr.settle(robot, POSE)
    assert cdpr.compare(solved, settled).verdict is Verdict.AGREE
    assert unbalanced_by_hand(solved) < 1e-6 * robot.weight
    without = cdpr.solve(robot.replace(linear_density=0.0), POSE)
    assert cdpr.compare(dataclasses.replace(without, problem=solved.problem), settled).verdict is not Verdict.AGREE


def every_property() -> cdpr.Robot:
    """DemoBot with cables that have mass, run over pulleys and stiffen, and one that is plain."""
    return cdpr.load_robot("cogiro").replace(
        linear_density=[5e-4] * 7 + [0], pulley_radius=[0.01] * 7 + [0], stiffening=[[100.0, 2e4]] * 7 + [[0, 0]]
    )


def test_answers_of_statics_take_every_property_together():
    """Each agrees with the equilibrium that ``solve`` finds, or with its shape."""
    robot = every_property()
    found = cdpr.solve(robot, POSE)
    many = cdpr.solve_many(robot, np.tile(POSE, (20, 1)))
    assert found.stable
    assert_allclose(many.positions, np.tile(found.position, (20, 1)), rtol=0, atol=1e-12)
    assert_allclose(many.eigenvalues[3], found.eigenvalues, rtol=1e-9)
    assert_allclose(cdpr.solve(robot, POSE, method="fsolve").position, found.position, rtol=0, atol=1e-8)
    assert_allclose(cdpr.follow_load(robot, POSE).equilibria[-1].position, found.position, rtol=0, atol=1e-9)
    swept = cdpr.sweep(robot, {"x": [POSE[0]], "y": [POSE[1]], "z": [POSE[2]]})
    assert_allclose(swept["position"].values.ravel(), found.position, rtol=0, atol=1e-12)
    lowest = cdpr.find_equilibria(robot, POSE, starts=20)
    assert min(np.abs(one.position - found.position).max() for one in lowest) < 1e-8
    design = solve_layouts(RobotBatch.of([robot]), Cases.of(robot, [POSE]))
    assert_allclose(design.positions[0, 0], found.position, rtol=0, atol=1e-12)
    assert np.isfinite(cdpr.clearances(robot, [POSE]).least).all()


def test_cables_with_mass_are_drawn_from_their_wheels_to_their_anchors():
    """The shape begins on the rim, along it, and ends at the anchor; what it is long has the strain of its tension."""
    robot = every_property()
    equilibria = cdpr.solve_many(robot, [POSE])
    shapes = cdpr.cable_profiles(equilibria, 2000)[0]
    ends = equilibria.positions[0] + robot.anchors @ equilibria.rotations[0].T
    for cable in range(7):
        wheel = wheel_of(robot.cabling, cable, ends[cable])
        start, second = shapes[cable, :2]
        radius = start - wheel.center
        assert np.linalg.norm(radius) == pytest.approx(0.01, rel=1e-3)
        assert abs(radius @ (second - start)) < 1e-2 * 0.01 * np.linalg.norm(second - start)
        assert_allclose(shapes[cable, -1], ends[cable], rtol=0, atol=1e-12)
        drawn = cable_curve(robot.cabling, cable, ends[cable], None, shapes[cable])
        length = np.linalg.norm(np.diff(drawn, axis=0), axis=1).sum()
        assert length == pytest.approx(equilibria.rest_lengths[0, cable], rel=1e-3)
        assert_allclose(drawn[0], robot.exits[cable], rtol=0, atol=1e-12)


def test_check_proves_cables_with_mass_over_pulleys():
    """Each pose of a robot with every property, by both methods."""
    checked = cdpr.check(every_property(), {"x": [POSE[0]], "y": [POSE[1]], "z": [0.1, 0.2]}, certify=True)
    assert checked.dataset.proved.all()


@pytest.mark.parametrize("density", [1e-6, 5e-3])
@pytest.mark.parametrize("kind", KINDS_BESIDE)
def test_settle_is_right_about_weight_beside_pulleys_or_laws(kind, density):
    """Each cable's force by hand adds up to the load; without the pulleys or the law, it does not."""
    robot = mixed(kind, density)
    found = cdpr.settle(robot, POSE)
    assert unbalanced_by_hand(found) < 1e-6 * robot.weight
    ignored = robot.replace(pulley_radius=0.0, stiffening=(0.0, 0.0))
    without = dataclasses.replace(found, problem=dataclasses.replace(found.problem, robot=ignored))
    assert unbalanced_by_hand(without) > 1e-3 * robot.weight


# --- strains beyond which a law is not given --------------------------------------------------------------------------

STRAINED = "a cable is strained by more than 20%, beyond the range of its nonlinear law"


def plumb(mass: float, stiffening: tuple[float, float]) -> cdpr.Robot:
    """A mass on one cable with EA = 100 N."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", cdpr.ImplausibleRobot)
        return cdpr.Robot(
            [[0, 0, 2]], [[0, 0, 0]], 100.0, mass, stiffening=stiffening, platform_size=(0.1, 0.1, 0.1), name="plumb"
        )


LIMIT_MASS = {(8.0, -20.0): 100 * 0.36 / 9.81, (0.0, -8.0): 100 * 0.136 / 9.81, (0.0, 1000.0): 100 * 8.2 / 9.81}
"""[kg] That strain the cable by 20 %: EA (0.2 + 0.04 a2 + 0.008 a3)/g."""


@pytest.mark.parametrize("law", LIMIT_MASS)
def test_both_methods_answer_up_to_the_strain_a_law_is_given_for_and_refuse_beyond(law):
    """They continued it in two ways, 0.118 of strain apart. 0.1 % below both agree with the cubic; above: no."""
    light, heavy = (plumb(factor * LIMIT_MASS[law], law) for factor in (0.999, 1.001))
    roots = np.roots([*law[::-1], 1, -light.weight / 100])
    strain = min(root.real for root in roots if abs(root.imag) < 1e-9 and root.real > 0)
    assert 0.19 < strain < 0.2
    for answer in (cdpr.solve, cdpr.settle, lambda *asked: cdpr.solve(*asked, method="fsolve")):
        assert answer(light, (0, 0, 1)).lengths[0] - 1 == pytest.approx(strain, abs=1e-6)
        with pytest.raises((cdpr.NotConverged, cdpr.NotSettled), match=rf"plumb: .*: {STRAINED} \(cable 1\)"):
            answer(heavy, (0, 0, 1))
    for many in (cdpr.solve_many(heavy, [(0, 0, 1)] * 2), cdpr.settle_many(heavy, [(0, 0, 1)] * 2)):
        assert (many.status == cdpr.Status.OVERSTRAINED).all()
    linear = heavy.replace(stiffening=(0, 0))
    for answer in (cdpr.solve, cdpr.settle):  # the negative control: a linear law holds for every strain
        assert answer(linear, (0, 0, 1)).lengths[0] - 1 == pytest.approx(linear.weight / 100, rel=1e-6)


def test_both_methods_refuse_the_same_poses_of_soft_robots():
    """Laws that stiffen, and laws that would fall beyond 20 %, where MuJoCo's platform runs away."""
    random, seen = np.random.default_rng(5), set()
    for k, stiffness in enumerate(10 ** random.uniform(0.3, 1.7, 15)):
        name = ["cogiro", "parallel", "planar-vertical"][k % 3]
        law = [(8.0, -20.0), (0.0, -8.0), (-2.0, 0.0), (0.0, 1000.0), (20.0, 100.0)][k % 5]
        robot = cdpr.load_robot(name).replace(axial_stiffness=stiffness, stiffening=law)
        poses = random.uniform(*robot.workspace, (10, 3))
        solved, settled = cdpr.solve_many(robot, poses), cdpr.settle_many(robot, poses)
        assert (solved.status == settled.status).all()
        assert np.abs(solved.positions - settled.positions)[solved.converged].max(initial=0) < 1e-8
        seen |= {*solved.status.tolist()}
    assert seen == {cdpr.Status.CONVERGED, cdpr.Status.OVERSTRAINED}


def test_what_follows_from_a_law_ends_where_it_does():
    """Beside a cable with mass, of all equilibria, in layouts and sweeps; of tensions that are asked for."""
    law = (0.0, -8.0)
    light, heavy = (plumb(factor * LIMIT_MASS[law], law) for factor in (0.999, 1.001))
    beside = mixed("nonlinear elasticity", 5e-3)
    with pytest.raises(cdpr.NotSettled, match=rf"{STRAINED} \(cables 1, 4\)"):
        cdpr.settle(beside.replace(axial_stiffness=[2.0] * 7 + [SOFT]), POSE)
    with pytest.raises(cdpr.NotConverged, match=STRAINED):
        cdpr.find_equilibria(heavy, (0, 0, 1), starts=20)
    one = {"x": [0.0], "y": [0.0], "z": [1.0]}
    swept = cdpr.sweep(heavy, one)
    assert swept["status"].item() == cdpr.Status.OVERSTRAINED
    assert np.isnan(swept["tilt"].item())
    assert STRAINED in cdpr.check(heavy, one).disagreements[0].reasons[0]
    soft = cdpr.load_robot("cogiro").replace(axial_stiffness=20.0, stiffening=law)
    found = solve_layouts(RobotBatch.of([soft, soft.replace(axial_stiffness=5.0)]), Cases.of(soft, [POSE]))
    assert found.status.tolist() == [[cdpr.Status.CONVERGED], [cdpr.Status.OVERSTRAINED]]
    strain = 1 / light.rest_lengths((0, 0, 1), [light.weight])[0] - 1
    assert 100 * (strain - 8 * strain**3) == pytest.approx(light.weight, rel=1e-12)
    with pytest.raises(cdpr.InvalidInput, match=r"tensions: found 13.61 N in cable 1, expected at most 13.6 N"):
        heavy.rest_lengths((0, 0, 1), [heavy.weight])
    with pytest.raises(cdpr.InvalidInput, match=r"tensions: found a smallest tension of 3 N in cable 1, .* 2.72 N"):
        cdpr.compensate(soft, POSE, tensions=(3.0, 9.0))
    assert cdpr.compensate(soft, POSE, tensions=(0.1, 9.0)).tension_limits[1] == pytest.approx(2.72)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (dict(linear_density=-1.0), "linear_density: found -1 kg/m in cable 1"),
        (dict(pulley_radius=[0, 0, -0.1, 0, 0, 0, 0, 0]), "pulley_radius: found -0.1 m in cable 3"),
        (
            dict(pulley_radius=[0, 1e-7, 0, 0, 0, 0, 0, 0]),
            "pulley_radius: found 1e-07 m in cable 2, expected 0, for a point",
        ),
        (dict(pulley_radius=0.02, pulley_axis=(0, 0, 0)), "pulley_axis: found an axis of length zero in cable 1"),
        (dict(stiffening=(-3.0, 0.0)), "stiffening: .* tension falls before a strain of 20%"),
        (dict(stiffening=(0.0, -9.0)), "stiffening: .* tension falls"),
        (dict(stiffening=(-13.0, 50.0)), "stiffening: .* tension falls"),  # by 1 − 26 eps + 150 eps², amid
        (dict(stiffening=(1.0, 0.0, 0.0)), "stiffening: found an array of shape"),
    ],
)
def test_cables_that_cannot_be_are_refused(catalogue, change, message):
    """One sentence that names the field and the cable."""
    with pytest.raises(cdpr.InvalidInput, match=message):
        catalogue["cogiro"].replace(**change)


def test_anchor_at_a_wheel_is_refused():
    """Inside the wheel, and below it, where the cable would leave it."""
    robot = cdpr.Robot([[0, 0, 1]], [[0, 0, 0]], 1e3, 1.0, pulley_radius=0.1, platform_size=(0.1, 0.1, 0.1))
    for x, z in ((0.1, 0.95), (0.05, 0.2)):
        with pytest.raises(cdpr.InvalidInput, match="anchor of cable 1 inside or below its pulley's wheel"):
            cdpr.solve(robot, (x, 0, z))


def on_one_wheel(rng: np.random.Generator, axis: tuple[float, float, float]) -> tuple[cdpr.Robot, np.ndarray]:
    """A platform on one cable over a pulley, and where it is commanded to."""
    robot = cdpr.Robot(
        [[0, 0, 2]], [rng.uniform(-0.1, 0.1, 3)], 10 ** rng.uniform(3, 6), 10 ** rng.uniform(-1, 1.5),
        pulley_radius=rng.uniform(0.01, 0.1), pulley_axis=axis, name="one",
    )  # fmt: skip
    return robot, rng.uniform([0.3, -1, 0.2], [1, 1, 1.5])


def test_a_platform_on_one_wheel_hangs_plumb_from_its_far_side():
    """The cable arrives from below, goes half round the wheel and hangs two radii from the axis, wherever it began."""
    rng = np.random.default_rng(0)
    for trial in range(60):
        robot, pose = on_one_wheel(rng, (0, 0, 1))
        for method in (cdpr.solve, cdpr.settle)[: 2 if trial < 4 else 1]:
            found = method(robot, pose)
            anchor = found.pose.apply(robot.anchors)[0]
            assert np.hypot(*anchor[:2]) == pytest.approx(2 * robot.cabling.pulley_radius[0], rel=1e-6)
            assert found.tensions[0] == pytest.approx(robot.weight, rel=1e-6)


def test_no_equilibrium_under_a_wheel_is_an_answer():
    """A plumb cable that arrives from above hangs on the axis, under the wheel: both methods name cable and wheel."""
    rng = np.random.default_rng(0)
    for trial in range(20):
        robot, pose = on_one_wheel(rng, (0, 0, -1))
        for method, kind in ((cdpr.solve, cdpr.NotConverged), (cdpr.settle, cdpr.NotSettled))[: 2 if trial < 4 else 1]:
            with pytest.raises(kind, match="anchor of cable 1 inside or below its pulley's wheel") as told:
                method(robot, pose)
            assert f"expected a larger distance than the radius, {robot.cabling.pulley_radius[0]:g} m" in str(
                told.value
            )


def test_the_descent_passes_under_wheels_to_equilibria_beyond():
    """Robots on one to five cables: no search ends at the edge of a wheel's footprint, where no force balances."""
    rng, ended = np.random.default_rng(0), []
    for _ in range(200):
        cables = int(rng.integers(1, 6))
        robot = cdpr.Robot(
            rng.uniform([-1, -1, 0.9], [1, 1, 1.6], (cables, 3)), rng.uniform(-0.15, 0.15, (cables, 3)),
            10 ** rng.uniform(3, 6), 10 ** rng.uniform(-1, 1.5), center_of_mass=rng.uniform(-0.05, 0.05, 3),
            pulley_radius=rng.uniform(0.02, 0.15, cables), pulley_axis=rng.normal(size=(cables, 3)),
            platform_size=(0.3, 0.3, 0.3),
        )  # fmt: skip
        many = cdpr.solve_many(robot, rng.uniform([-0.6, -0.6, -0.2], [0.6, 0.6, 0.4])[None])
        ended.append(cdpr.Status(int(many.status[0])))
    assert set(ended) == {cdpr.Status.CONVERGED, cdpr.Status.OFF_WHEEL}
    assert ended.count(cdpr.Status.CONVERGED) > 150


@pytest.mark.parametrize("height", [-0.4, 0.3])
def test_the_continued_path_goes_on_smoothly_under_a_wheel(height):
    """On both sides of the wheel, its length grows as its direction says, and across the edge it does not jump."""
    axis, radius, step = (0.0, 0.0, 1.0), 0.1, 1e-6

    def path(rho: float) -> np.ndarray:
        return np.array(cable_path.pulley_path(-rho, 0.0, -height, *axis, radius))

    for rho in (0.02, 0.06, 0.0999, 0.1001, 0.15):
        _, x, _, _, free, *_, clear = path(rho)
        slope = (path(rho + step)[0] - path(rho - step)[0]) / (2 * step)
        assert slope == pytest.approx(-x / free, abs=1e-8)
        assert clear == pytest.approx(rho - radius, abs=1e-15)
    assert np.abs(path(radius - 1e-9) - path(radius + 1e-9)).max() < 1e-6


def test_questions_about_a_pose_under_a_wheel_are_refused():
    """Of a single pose in a sentence, as ``solve`` refuses it; of many, each row by its status, nan, or False."""
    robot = cdpr.load_robot("cogiro").replace(pulley_radius=0.05)
    under = robot.exits[2] - robot.anchors[2] + [0.01, 0.0, -0.3]
    questions = (cdpr.shortfall, cdpr.feasible, cdpr.closed_form_feasible, capacity_margin)
    for ask in (cdpr.solve, cdpr.settle, *questions):
        limits = {} if ask in (cdpr.solve, cdpr.settle) else dict(tension_limits=(0, 100))
        with pytest.raises(
            cdpr.InvalidInput, match=r"anchor of cable 3 inside or below its pulley.s wheel, 0.01 m from the pulley's"
        ):
            ask(robot, under, **limits)
    both = np.array([under, robot.home])
    for many in (cdpr.solve_many(robot, both), cdpr.settle_many(robot, both)):
        assert many.status.tolist() == [cdpr.Status.OFF_WHEEL, cdpr.Status.CONVERGED]
        with pytest.raises((cdpr.NotConverged, cdpr.NotSettled), match="found the anchor of cable 3"):
            many[0]
    assert np.isnan(cdpr.shortfall(robot, both)).tolist() == [True, False]
    assert cdpr.feasible(robot, both).tolist() == [False, True]


def test_robot_file_says_what_cables_are(tmp_path):
    """For all cables, and for one of its own."""
    text = """
name = "mine"
axial_stiffness = 1000.0
pulley = { radius = 0.02, axis = [0, 0, 1] }
stiffening = [2.0, 0.0]
platform = { mass = 1.0 }
cables = [
    { exit = [0, 0, 1], anchor = [0.1, 0, 0] },
    { exit = [1, 0, 1], anchor = [-0.1, 0, 0], pulley = { radius = 0.03 }, stiffening = [0.0, 0.0] },
]
"""
    file = tmp_path / "mine.toml"
    file.write_text(text)
    cabling = cdpr.load_robot(file).cabling
    assert cabling.pulley_radius.tolist() == [0.02, 0.03]
    assert cabling.pulley_axis.tolist() == [[0, 0, 1], [0, 0, -1]]
    assert cabling.stiffening.tolist() == [[2, 0], [0, 0]]
    file.write_text(text.replace("radius = 0.03", "radus = 0.03"))
    with pytest.raises(cdpr.RobotFileError, match="did you mean 'radius'"):
        cdpr.load_robot(file)


# --- weight on both methods ------------------------------------------------------------------------------------------


DEMOBOT = ("cogiro", "parallel", "planar-vertical", "planar-horizontal", "two-cable")


def crane() -> cdpr.Robot:
    """As large as CoGiRo: 15 m, 4 mm steel cables of 0.064 kg/m, a platform of 90 kg."""
    small = cdpr.load_robot("cogiro")
    return cdpr.Robot(18.75 * small.exits, 18.75 * small.anchors, 1e6, 90.0, linear_density=0.064, name="crane")


@pytest.mark.parametrize("name", [*DEMOBOT, "crane"])
def test_methods_agree_on_heavy_cables(name):
    """12 poses each, slack cables among them: DemoBot with 0.5 g/m to 1e-8 m and 1e-7 rad, so the crane of 15 m."""
    robot = crane() if name == "crane" else cdpr.load_robot(name).replace(linear_density=5e-4)
    for position in np.random.default_rng(3).uniform(*robot.workspace, (12, 3)):
        problem = cdpr.Problem.of(robot, position)
        solved, settled = cdpr.solve(problem), cdpr.settle(problem)
        assert np.linalg.norm(solved.position - settled.position) < 1e-8
        assert (solved.rotation * settled.rotation.inv()).magnitude() < 1e-7
        assert np.abs(solved.tensions - settled.tensions).max() < 1e-6
        assert (solved.slack == settled.slack).all()


def heavy_problem(seed: int) -> cdpr.Problem:
    """One of the random robots of scripts/stress_test_real_cables.py that MuJoCo settles."""
    robot, position, random = random_robot(seed, stiffest=1e6)
    density = 10 ** random.uniform(-4, -1) * robot.mass / robot.rest_lengths(position).sum()
    return cdpr.Problem.of(robot.replace(linear_density=density), position)


def test_one_percent_more_weight_in_mujoco_alone_is_noticed():
    """Negative control: on the crane, whose cables have mass, and on the same rest lengths."""
    robot = crane()
    problem = cdpr.Problem.of(robot, robot.home)
    solved = cdpr.solve(problem)
    assert cdpr.compare(solved, cdpr.settle(problem)).verdict is Verdict.AGREE
    heavier = robot.replace(linear_density=1.01 * robot.cabling.linear_density)
    xml = cdpr.to_mjcf(heavier, problem.pose, problem.rest_lengths)
    broken = cdpr.settle(problem, model=mujoco.MjModel.from_xml_string(xml))
    assert cdpr.compare(solved, broken).verdict is Verdict.DISAGREE


@pytest.mark.parametrize(
    ("seed", "why"),
    [
        (98, "one taut cable hardly holds it against turning"),
        (155, "so does this one, and it starts radians away"),
        (56, "a slack cable hangs folded, with no pull sideways"),
        (201, "slack cables bend within a hundredth of their length"),
        (247, "0.3 N/m hold it, and one cable is a third too long"),
    ],
)
def test_robots_on_hard_heavy_cables_settle_where_statics_has_them(seed, why):
    """Of 300 random ones (scripts/stress_test_real_cables.py) those that did not settle, or settled 0.1 mm off."""
    problem = heavy_problem(seed)
    found = cdpr.compare(cdpr.solve(problem), cdpr.settle(problem))
    assert found.agrees, why
    assert found.position_error < 3e-7

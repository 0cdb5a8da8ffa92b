"""Cables over pulleys, with nonlinear elasticity, with mass. Formulas, both methods, and what is refused."""

import warnings

import numpy as np
import pytest
from numpy.testing import assert_allclose
from sample_problems import random_robot
from scipy.integrate import quad
from test_real_cables_physics import crane, wheel_by_hand

import cdpr_sim as cdpr
from cdpr_sim.analysis.workspace.feasibility import capacity_margin
from cdpr_sim.core import cable_law, cable_path
from cdpr_sim.core.robot_batch import RobotBatch
from cdpr_sim.crosscheck.compare import Verdict
from cdpr_sim.design.layout_equilibria import Cases, solve_layouts
from cdpr_sim.drawing.cable_curves import cable_curve, wheel_of
from cdpr_sim.statics import forces

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


def test_path_over_a_wheel_is_what_a_compass_draws():
    """Length and direction at 500 random wheels and anchors, by tangents to a circle; a point where the wheel is."""
    rng, count = np.random.default_rng(3), 500
    axes, radii = rng.normal(size=(count, 3)), 10 ** rng.uniform(-3, -1, count)
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    exits, anchors = rng.uniform(-1, 1, (2, count, 3))
    robot = cdpr.Robot(exits, anchors, 1.0, 1.0, pulley_radius=radii, pulley_axis=axes, platform_size=(1, 1, 1))
    lengths = cable_path.lengths(robot.cabling, np.zeros(3), np.eye(3))
    directions = forces.geometry(robot, np.zeros(3), np.eye(3)).directions
    points = np.linalg.norm(anchors - exits, axis=1)
    seen = np.flatnonzero(np.isfinite(lengths))
    assert len(seen) > 375
    for i in seen:
        expected, direction = wheel_by_hand(exits[i], axes[i], radii[i], anchors[i])
        assert lengths[i] == pytest.approx(expected, rel=1e-12)
        assert np.abs(directions[i] - direction).max() < 1e-10
        assert points[i] - 1e-12 <= lengths[i] <= points[i] + 2 * np.pi * radii[i]


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
    """15 poses of each robot: positions, lengths, tensions, slack cables and stiffness, and the verdict of compare."""
    robot = robot_with(name, kind)
    positions = np.random.default_rng(1).uniform(*robot.workspace, (15, 3))
    solved, settled = cdpr.solve_many(robot, positions), cdpr.settle_many(robot, positions)
    assert (solved.status == settled.status).all()
    rows = np.flatnonzero(solved.converged)
    assert len(rows) >= 13  # the others lie under a wheel's footprint
    assert np.abs(solved.positions - settled.positions)[rows].max() < 1e-9
    assert np.abs(solved.lengths - settled.lengths)[rows].max() < 1e-9
    assert np.abs(solved.tensions - settled.tensions)[rows].max() < 1e-6
    assert (solved.slack == settled.slack)[rows].all()
    assert np.abs(solved.eigenvalues / settled.eigenvalues - 1)[rows].max() < 1e-6
    assert cdpr.compare(solved[int(rows[0])], settled[int(rows[0])]).verdict is Verdict.AGREE


def test_random_robots_balance_by_an_independent_hand():
    """100 random robots, each cable with or without wheel and law: forces worked out another way add up to the load."""
    rng, balanced = np.random.default_rng(6), 0
    for _ in range(100):
        cables = int(rng.integers(3, 9))
        exits, anchors = rng.uniform([-1, -1, 0.6], [1, 1, 1.5], (cables, 3)), rng.uniform(-0.15, 0.15, (cables, 3))
        mass, stiffness = 10 ** rng.uniform(-1, 2), 10 ** rng.uniform(3, 6)
        laws = np.column_stack([rng.uniform(0, 10, cables), rng.uniform(-5, 20, cables)])
        robot = cdpr.Robot(
            exits, anchors, stiffness * mass, mass, stiffening=laws * rng.integers(0, 2, (cables, 1)),
            pulley_radius=10 ** rng.uniform(-3, -1.2, cables) * rng.integers(0, 2, cables),
            pulley_axis=rng.normal(size=(cables, 3)),
        )  # fmt: skip
        try:
            found = cdpr.solve(robot, rng.uniform([-0.5, -0.5, -0.2], [0.5, 0.5, 0.4]))
        except cdpr.InvalidInput:
            continue  # an anchor under its wheel's footprint
        assert unbalanced_by_hand(found) < 1e-6 * robot.weight
        balanced += 1
    assert balanced > 60


def unbalanced_by_hand(found: cdpr.Equilibrium) -> float:
    """The largest unbalanced force [N], torques over the characteristic length, cable by cable."""
    robot = found.problem.robot
    force, torque = np.array([0, 0, -robot.weight]), np.zeros(3)
    for cable in range(robot.cables):
        arm = found.rotation_matrix @ robot.anchors[cable]
        anchor, exit_point = found.position + arm, robot.exits[cable]
        length = np.linalg.norm(exit_point - anchor)
        direction = (exit_point - anchor) / length
        if robot.pulley_radius[cable] > 0:
            length, direction = wheel_by_hand(exit_point, robot.pulley_axis[cable], robot.pulley_radius[cable], anchor)
        strain, (a2, a3) = max(length / found.rest_lengths[cable] - 1, 0), robot.stiffening[cable]
        assert strain < 0.2
        pull = robot.axial_stiffness[cable] * (strain + a2 * strain**2 + a3 * strain**3) * direction
        force, torque = force + pull, torque + np.cross(arm, pull)
    return float(np.abs([force, torque / robot.characteristic_length]).max())


# --- every property together ------------------------------------------------------------------------------------------

POSE = (0.3, 0.25, 0.1)


def every_property() -> cdpr.Robot:
    """DemoBot with cables that have mass, run over pulleys and stiffen, and one that is plain."""
    return cdpr.load_robot("cogiro").replace(
        linear_density=[5e-4] * 7 + [0], pulley_radius=[0.01] * 7 + [0], stiffening=[[100.0, 2e4]] * 7 + [[0, 0]]
    )


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
    beside = cdpr.load_robot("cogiro").replace(
        linear_density=[0] * 7 + [5e-3], stiffening=[(8.0, -20.0)] * 7 + [(0, 0)]
    )
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


def test_anchor_at_a_wheel_is_refused():
    """Inside the wheel, and below it, where the cable would leave it."""
    robot = cdpr.Robot([[0, 0, 1]], [[0, 0, 0]], 1e3, 1.0, pulley_radius=0.1, platform_size=(0.1, 0.1, 0.1))
    for x, z in ((0.1, 0.95), (0.05, 0.2)):
        with pytest.raises(cdpr.InvalidInput, match=r"anchor of cable 1 inside (or below )?its pulley's wheel"):
            cdpr.solve(robot, (x, 0, z))


def test_a_search_that_comes_to_a_wheels_rim_ends_with_a_status():
    """An error of the package, one row of a batch, and no equilibrium there in a list: not an error of NumPy."""
    robot = cdpr.Robot(
        [[1, 0, 1], [1, 0, 1]], [[0.3, -0.2, -0.2], [0, -0.2, 0.1]], 1000, 1, pulley_radius=0.3,
        pulley_axis=(0, 0, 1), platform_size=(1, 1, 1),
    )  # fmt: skip
    pose, sound = (0.6, 0.7, 0.8), (1.2, -0.4, 0.8)
    with pytest.raises(cdpr.NotConverged):
        cdpr.solve(robot, pose)
    many = cdpr.solve_many(robot, [pose, sound])
    assert many.converged.tolist() == [False, True]
    assert np.isfinite(many.eigenvalues[1]).all()
    assert all(one.residual < 1e-6 for one in cdpr.find_equilibria(robot, pose, starts=50))
    with pytest.raises(cdpr.NotSettled, match=r"inside its pulley's wheel, 0\.2\d+ m from the wheel's centre"):
        cdpr.settle(robot, pose)


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
    for _ in range(100):
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
    assert ended.count(cdpr.Status.CONVERGED) > 75


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


# --- weight on both methods ------------------------------------------------------------------------------------------


DEMOBOT = ("cogiro", "parallel", "planar-vertical", "planar-horizontal", "two-cable")


@pytest.mark.parametrize("name", [*DEMOBOT, "crane"])
def test_methods_agree_on_heavy_cables(name):
    """12 poses each, slack cables among them: DemoBot with 0.5 g/m to 1e-8 m and 1e-7 rad, so the crane of 15 m."""
    robot = crane() if name == "crane" else cdpr.load_robot(name).replace(linear_density=5e-4)
    problems = cdpr.Problems.of(robot, np.random.default_rng(3).uniform(*robot.workspace, (12, 3)))
    solved, settled = cdpr.solve_many(problems), cdpr.settle_many(problems)
    assert np.linalg.norm(solved.positions - settled.positions, axis=1).max() < 1e-8
    assert (solved.poses.rotation * settled.poses.rotation.inv()).magnitude().max() < 1e-7
    assert np.abs(solved.tensions - settled.tensions).max() < 1e-6
    assert (solved.slack == settled.slack).all()


def heavy_problem(seed: int) -> cdpr.Problem:
    """One of the random robots of scripts/stress_test_real_cables.py that MuJoCo settles."""
    robot, position, random = random_robot(seed, stiffest=1e6)
    density = 10 ** random.uniform(-4, -1) * robot.mass / robot.rest_lengths(position).sum()
    return cdpr.Problem.of(robot.replace(linear_density=density), position)


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

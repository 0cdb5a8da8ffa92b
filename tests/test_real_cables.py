"""Where nonlinear laws, wheels and drive lines end, and what is answered there; closed forms for both methods.

Equilibria of all mixtures of cable properties are in ``test_matrix.py``.
"""

import mujoco
import numpy as np
import pytest

import cdpr_sim as cdpr
from cdpr_sim.analysis.workspace.feasibility import capacity_margin, feasible_by_linprog
from cdpr_sim.core.robot_batch import RobotBatch
from cdpr_sim.design.layout_equilibria import Cases, feasible_cases, solve_layouts
from cdpr_sim.statics.profiles import profile

POSE = (0.3, 0.25, 0.1)
BOX, UP = (0.1, 0.1, 0.1), (0.0, 0.0, 1.0)
METHODS = ((cdpr.solve, cdpr.NotConverged), (cdpr.settle, cdpr.NotSettled))


# --- strains beyond which a law is not given --------------------------------------------------------------------------

STRAINED = "a cable is strained by more than 20%, beyond the range of its nonlinear law"


def plumb(mass: float, stiffening: tuple[float, float]) -> cdpr.Robot:
    """A mass on one cable with EA = 100 N."""
    return cdpr.Robot([[0, 0, 2]], [[0, 0, 0]], 100.0, mass, stiffening=stiffening, platform_size=BOX, name="plumb")


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
    """Of all equilibria, in layouts and sweeps, in ``check``; of tensions that are asked for."""
    law = (0.0, -8.0)
    light, heavy = (plumb(factor * LIMIT_MASS[law], law) for factor in (0.999, 1.001))
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
    assert cdpr.compensate(soft, POSE, tensions=(0.1, 9.0)).tension_limits[1] == pytest.approx(2.72)


# --- anchors under wheels ---------------------------------------------------------------------------------------------


def test_a_search_that_comes_to_a_wheels_rim_ends_with_a_status():
    """An error of the package, one row of a batch, and no equilibrium there in a list: not an error of NumPy."""
    robot = cdpr.Robot(
        [[1, 0, 1], [1, 0, 1]], [[0.3, -0.2, -0.2], [0, -0.2, 0.1]], 1000, 1, pulley_radius=0.3, pulley_axis=UP,
        platform_size=(1, 1, 1),
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


def test_a_platform_on_one_wheel_hangs_plumb_from_its_far_side_or_nowhere():
    """A cable that arrives from below goes half round the wheel and hangs two radii from the axis, wherever it began.

    One that arrives from above would hang on the axis, under the wheel: both methods name cable and wheel.
    """
    random = np.random.default_rng(0)
    for trial in range(40):
        robot = cdpr.Robot(
            [[0, 0, 2]], [random.uniform(-0.1, 0.1, 3)], 10 ** random.uniform(3, 6), 10 ** random.uniform(-1, 1.5),
            pulley_radius=random.uniform(0.01, 0.1), pulley_axis=UP,
        )  # fmt: skip
        pose = random.uniform([0.3, -1, 0.2], [1, 1, 1.5])
        for method, error in METHODS[: 2 if trial < 4 else 1]:
            found = method(robot, pose)
            anchor = found.pose.apply(robot.anchors)[0]
            assert np.hypot(*anchor[:2]) == pytest.approx(2 * robot.pulley_radius[0], rel=1e-6)
            assert found.tensions[0] == pytest.approx(robot.weight, rel=1e-6)
            with pytest.raises(error, match="anchor of cable 1 inside or below its pulley's wheel") as told:
                method(robot.replace(pulley_axis=(0, 0, -1)), pose)
            assert f"expected a larger distance than the radius, {robot.pulley_radius[0]:g} m" in str(told.value)


def test_the_descent_passes_under_wheels_to_equilibria_beyond():
    """Robots on one to five cables: no search ends at the edge of a wheel's footprint, where no force balances."""
    random, ended = np.random.default_rng(0), []
    for _ in range(100):
        cables = int(random.integers(1, 6))
        robot = cdpr.Robot(
            random.uniform([-1, -1, 0.9], [1, 1, 1.6], (cables, 3)), random.uniform(-0.15, 0.15, (cables, 3)),
            10 ** random.uniform(3, 6), 10 ** random.uniform(-1, 1.5), center_of_mass=random.uniform(-0.05, 0.05, 3),
            pulley_radius=random.uniform(0.02, 0.15, cables), pulley_axis=random.normal(size=(cables, 3)),
            platform_size=(0.3, 0.3, 0.3),
        )  # fmt: skip
        ended.append(int(cdpr.solve_many(robot, random.uniform([-0.6, -0.6, -0.2], [0.6, 0.6, 0.4])[None]).status[0]))
    assert set(ended) == {cdpr.Status.CONVERGED, cdpr.Status.OFF_WHEEL}
    assert ended.count(cdpr.Status.CONVERGED) > 75


def test_of_many_poses_those_under_a_wheel_have_a_status():
    """Or nan, or False; a single one is refused in a sentence (``test_refusals_analysis.py``)."""
    robot = cdpr.load_robot("cogiro").replace(pulley_radius=0.05)
    both = np.array([robot.exits[2] - robot.anchors[2] + [0.01, 0.0, -0.3], robot.home])
    for many in (cdpr.solve_many(robot, both), cdpr.settle_many(robot, both)):
        assert many.status.tolist() == [cdpr.Status.OFF_WHEEL, cdpr.Status.CONVERGED]
        with pytest.raises((cdpr.NotConverged, cdpr.NotSettled), match="found the anchor of cable 3"):
            many[0]
    assert np.isnan(cdpr.shortfall(robot, both)).tolist() == [True, False]
    assert cdpr.feasible(robot, both).tolist() == [False, True]


@pytest.mark.parametrize(("mass", "radius"), [(1e-4, 1e-3), (0.4, 1e-5), (1e-6, 1e-6)])
def test_tiny_wheels_and_platforms_settle(mass, radius):
    """MuJoCo takes the wheel of a micrometre and the platform of a milligram; a tiny wheel is nearly a point.

    A cable over a wheel differs from a straight one by less than ten radii.
    """
    robot = cdpr.load_robot("cogiro").replace(mass=mass, pulley_radius=radius, pulley_axis=UP)
    rest = cdpr.settle(robot, robot.home)
    point = cdpr.settle(robot.replace(pulley_radius=0.0), robot.home)
    assert rest.residual < 1e-6 * robot.weight
    part = 10 * radius / point.rest_lengths.min()
    assert np.linalg.norm(rest.deviation - point.deviation) < part * np.linalg.norm(point.deviation) + 1e-15
    mujoco.MjModel.from_xml_string(cdpr.to_mjcf(robot, robot.home, winches=True))  # what ``track`` runs


@pytest.mark.parametrize(("height", "status"), [(2.0, cdpr.Status.OFF_WHEEL), (1.7, cdpr.Status.CONVERGED)])
def test_a_slack_cable_whose_anchor_lies_within_its_wheel_is_no_equilibrium(height, status):
    """Another cable holds the platform there. With the wheel further down it has a path, and the platform rests."""
    exits = [[0, 0, height], [0.1, 0, 4]]
    robot = cdpr.Robot(exits, [[0, 0, 0]] * 2, 1e4, 1.0, pulley_radius=(0.1, 0.0), pulley_axis=UP, platform_size=BOX)
    assert cdpr.settle_many(robot, [[0.1, 0, 2.05]], [[3.0, 1.95]]).status[0] == status


# --- rope behind the exits, and parts of line ------------------------------------------------------------------------


def test_force_limits_are_those_of_the_ropes():
    """Not of all parts of line: feasible by linear programming, of layouts; margins are where limits begin to fail."""
    random = np.random.default_rng(0)
    robot = cdpr.load_robot("ipanema-1").replace(reeving=random.integers(1, 4, 8))
    positions, limits = random.uniform(*robot.frame, (30, 3)), (20.0, 250.0)
    can = cdpr.feasible(robot, positions, tension_limits=limits)
    assert 0 < can.sum() < len(can)
    assert [feasible_by_linprog(robot, at, tension_limits=limits) for at in positions] == can.tolist()
    assert (cdpr.feasible(robot.replace(reeving=1), positions, tension_limits=limits) != can).any()
    margins = capacity_margin(robot, positions, tension_limits=limits)
    assert ((margins > 0) == can).all()
    row = int(np.argmax((margins > 1) & (margins < 100)))
    for share, expected in ((0.999, True), (1.001, False)):
        shift = share * margins[row]
        assert cdpr.feasible(robot, positions[row], tension_limits=(20 + shift, 250 - shift)) == expected
    share = feasible_cases(RobotBatch.of([robot]), Cases.of(robot, positions), tuple(np.full((2, 8), [[20], [250]])))
    assert share.mean(-1)[0] == pytest.approx(can.mean())


def test_parts_of_line_share_an_implausible_weight():
    """A weight that stretches one part by 8 % stretches four by 2 %: only the first is doubted."""
    mass = 0.08 * 8 * 1e3 / 9.81
    fields = cdpr.load_robot("cogiro")._given | {"axial_stiffness": 1e3, "mass": mass, "inertia": None}
    assert any("stretch by" in sentence for sentence in cdpr.Robot(**fields).warnings)
    assert not any("stretch by" in sentence for sentence in cdpr.Robot(**fields | {"reeving": 4}).warnings)


def test_a_massless_cable_is_drawn_straight_however_little_it_is_stretched():
    """At a strain of 1e-6 the weight with which slack cables are drawn would let it sag by 1e-7 of its length."""
    points = profile([0, 0, 0.0], [3, 0, -1.0], np.sqrt(10) / (1 + 1e-6), 1e5, 0.0, 7)
    np.testing.assert_allclose(points, np.linspace(0, 1, 7)[:, None] * [3, 0, -1], atol=1e-15)


def test_a_rest_length_is_more_than_what_is_rigid():
    """Of one problem it is refused; of many, that row has no answer."""
    robot = cdpr.load_robot("cogiro").replace(rigid_length=0.25)
    rest = robot.rest_lengths(POSE)
    rest[2] = 0.25
    with pytest.raises(cdpr.InvalidInput, match=r"found 0\.25 m in cable 3, expected more than its rigid_length"):
        cdpr.solve(robot, POSE, rest)
    batch = cdpr.solve_many(robot, np.array([POSE, POSE]), np.array([rest + 0.1, rest]))
    assert batch.converged.tolist() == [True, False]


def test_a_rigid_end_that_would_lie_on_a_wheel_is_refused_at_the_commanded_pose():
    """Many poses get the status of a cable that leaves its wheel; a shorter rigid end is none of it."""
    robot = cdpr.load_robot("cogiro").replace(pulley_radius=0.02)
    assert cdpr.solve(robot.replace(rigid_length=0.4), robot.home).stable
    long = robot.replace(rigid_length=0.45)
    with pytest.raises(cdpr.InvalidInput, match=r"the rigid end of cable 2 on its pulley's wheel, 0\.441 m"):
        cdpr.solve(long, robot.home)
    assert cdpr.solve_many(long, robot.home[None]).status[0] == cdpr.Status.OFF_WHEEL

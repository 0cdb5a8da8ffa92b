"""Pulleys, weight and laws in figures, films and the study: what is shown is what there is."""

import io

import numpy as np
import pytest
from drawn_figures import UP, properties
from matplotlib.colors import same_color
from matplotlib.figure import Figure
from matplotlib.patches import Polygon
from rich.console import Console

import cdpr_sim as cdpr
import paper_ends
import real_cables
import robots_on_axes as drawing
import tilt_condition
from cdpr_sim.drawing import style
from cdpr_sim.drawing.cable_curves import cable_curve
from cdpr_sim.physics.model_files import model_files
from cdpr_sim.statics import two_cable_closed_form

POSE = (0.3, 0.25, 0.1)

POLYGON = 2e-3
"""Of a wheel's arc drawn by 24 points to the turn, relative: 1 − sin(x)/x at x = 7.5° is 2.9e-3 of the arc alone."""

PARABOLA = 0.05
"""A parabola for what hangs, relative: the length of a slack cable's, to second order; a catenary's sag w L²/(8 T)."""


def length(curve: np.ndarray) -> float:
    return float(np.linalg.norm(np.diff(curve, axis=0), axis=1).sum())


@pytest.mark.parametrize(
    ("name", "axis", "radius"),
    [("planar-vertical", UP, 0.015), ("planar-vertical", (0.0, 0.0, -1.0), 0.015), ("cogiro", UP, 0.02)],
)
def test_cables_over_pulleys_are_drawn_as_long_as_mujoco_has_them(catalogue, name, axis, radius):
    """Wheels face their anchors; taut cables leave on the tangent, with MuJoCo's lengths; slack ones are longer."""
    robot = catalogue[name].replace(pulley_radius=radius, pulley_axis=axis)
    equilibria = cdpr.settle_many(robot, [(0.2, robot.home[1], 0.15)])
    in_space = robot.mobility == "spatial"
    ax, slack = Figure().add_subplot(projection="3d" if in_space else None), equilibria.slack[0]
    drawing.draw_pose(ax, equilibria, 0)
    if in_space:
        lines = [np.transpose(line.get_data_3d()) for line in ax.lines]
        curves, wheels = lines[::2], [wheel[:-1] for wheel in lines[1::2]]
    else:
        assert [same_color(line.get_color(), style.SLACK_CABLE) for line in ax.lines] == slack.tolist()
        lines = [line.get_xydata() for line in ax.lines]
        wheels = [patch.get_xy()[:-1] for patch in ax.patches if isinstance(patch, Polygon)][-4:]
        curves, wheels = ([np.insert(one, 1, 0, axis=1) for one in some] for some in (lines, wheels))
    assert any(slack) or in_space
    expected = np.where(slack, equilibria.rest_lengths[0], equilibria.lengths[0])
    anchors = equilibria.positions[0] + robot.anchors @ equilibria.rotations[0].T
    for cable, (curve, wheel) in enumerate(zip(curves, wheels, strict=True)):
        assert length(curve) == pytest.approx(expected[cable], rel=PARABOLA if slack[cable] else POLYGON)
        assert curve[[0, -1]] == pytest.approx(np.array([robot.exits[cable], anchors[cable]]))
        center = wheel.mean(0)
        assert np.linalg.norm(wheel - center, axis=1) == pytest.approx(radius)
        across = np.cross(center - robot.exits[cable], UP)
        assert across @ (anchors[cable] - robot.exits[cable]) == pytest.approx(0, abs=1e-12)
        if not slack[cable]:
            assert np.linalg.norm(curve[-2] - center) == pytest.approx(radius)
            assert (curve[-2] - center) @ (curve[-1] - curve[-2]) == pytest.approx(0, abs=1e-12)


def test_shapes_are_given_or_need_not_be(catalogue):
    """Sheared where a cable ends elsewhere; straight without mass; and none over a pulley."""
    robot = catalogue["cogiro"]
    shape = np.array([[0.0, 0, 1], [0.2, 0, 0.5], [0.4, 0, 0.6]])  # its exit stays, its middle goes half as far
    sheared = cable_curve(robot.replace(linear_density=0.0005).cabling, 0, shape[-1] + [0.1, 0, -0.2], shape=shape)
    np.testing.assert_allclose(sheared, [[0, 0, 1], [0.25, 0, 0.4], [0.5, 0, 0.4]])
    equilibria = cdpr.solve_many(robot.replace(stiffening=(20.0, 0.0)), [POSE])
    assert not equilibria.slack.any()
    shapes = cdpr.cable_profiles(equilibria, points=3)[0]
    assert shapes[:, 1] == pytest.approx((shapes[:, 0] + shapes[:, 2]) / 2, abs=1e-8)
    over = cdpr.solve_many(robot.replace(pulley_radius=0.02, pulley_axis=UP), [POSE])
    assert np.isnan(cdpr.cable_profiles(over)).all()


def test_a_models_readme_says_which_law_holds(catalogue):
    """In the folder of models; EA alone, or with the parameters of what is added."""
    robot = catalogue["cogiro"]
    assert "a2 eps²" in model_files(robot.replace(stiffening=(20.0, 0.0)))["README.md"]
    over = model_files(robot.replace(pulley_radius=0.02, pulley_axis=UP))["README.md"]
    assert "tension is EA (l - l0)/l0 beyond" in over


def test_studies_take_account_of_real_cables_where_they_can(catalogue):
    """The closed form of two cables holds for any law; at rest, lines of force meet under all that has weight."""
    bar, four = catalogue["two-cable"], catalogue["planar-vertical"]
    turned = [two_cable_closed_form.equilibrium_rotations(one, (0.3, 0, 0.2))
              for one in (bar, bar.replace(stiffening=(20.0, 0.0)))]  # fmt: skip
    assert turned[0] == pytest.approx(turned[1])
    hung = four.replace(linear_density=0.01, material="fishing-0.4mm")
    for robot in (hung, four.replace(pulley_radius=0.01)):
        assert abs(tilt_condition.balance_at_rest(robot, np.array([0.25, 0.0, 0.2])).arm) < 1e-6
    given, plain = (tilt_condition.equal_pulls(robot, np.array([0.3, 0.0, 0.2])) for robot in (hung, four))
    assert given.net_moment == pytest.approx(given.moment, abs=1e-9)
    assert abs(given.moment - plain.moment) > 1e-3  # negative control: the directions are not those of the chords


# The study


def test_point_exit_lengths_change_as_straight_cables_do(catalogue):
    """Right at home; elsewhere off by what wheels take up."""
    robot = catalogue["cogiro"].replace(pulley_radius=0.02, pulley_axis=UP)
    home, there = robot.home, np.array(POSE)
    lengths = real_cables.point_exit_lengths(robot, [home, there])
    for cable, (exit_point, anchor) in enumerate(zip(robot.exits, robot.anchors, strict=True)):
        at_home = robot.rest_lengths(home)[cable]
        change = np.linalg.norm(there + anchor - exit_point) - np.linalg.norm(home + anchor - exit_point)
        assert lengths[:, cable] == pytest.approx([at_home, at_home + change], abs=1e-12)


@pytest.mark.parametrize("number", [1, 2])
def test_effects_are_differences_of_single_solves(number):
    """Each row against solves made one by one; MuJoCo and statics together to 1e-7 m."""
    case = real_cables.cases()[number]
    commanded, plain = case.commanded(2), case.robot
    effects = {effect.what: effect for effect in real_cables.effects(case, 2)}
    over = plain.replace(pulley_radius=case.radius, pulley_axis=UP)
    heavy, driven = plain.replace(linear_density=case.density), plain.replace(winch_to_exit=case.behind)
    told = real_cables.point_exit_lengths(over, commanded)
    for row, pose in enumerate(commanded):
        alone = {robot: cdpr.solve(robot, pose) for robot in (plain, over, heavy, driven)}
        pairs = {
            real_cables.UNAWARE: (cdpr.solve(over, pose, told[row]), alone[over]),
            real_cables.AWARE: (alone[over], alone[plain]),
            real_cables.MASS: (alone[heavy], alone[plain]),
            real_cables.BEHIND: (alone[driven], alone[plain]),
        }
        for what, (one, other) in pairs.items():
            found = effects[what]
            assert found.unsettled == 0
            assert found.method_difference < 1e-7
            assert found.shifts[row] == pytest.approx(np.linalg.norm(one.position - other.position), abs=2e-7)
            assert found.turns[row] == pytest.approx(abs(one.tilt - other.tilt), abs=1e-5)
        off = np.linalg.norm(alone[plain].deviation)
        assert effects[real_cables.ELASTICITY].shifts[row] == pytest.approx(off, abs=2e-7)


@pytest.fixture(scope="module")
def ends() -> tuple[paper_ends.PaperEnd, ...]:
    """At the ends of the paper's lines."""
    return paper_ends.paper_ends()


def test_pulleys_unknown_to_the_winches_cost_more_than_half_a_millimetre_per_millimetre():
    """The headline, on both of DemoBot's layouts and on both methods; elasticity costs the level layout far less."""
    study = real_cables.real_cables(2)
    for one in study.growths[:2]:
        assert 0.5 < one.rate < 0.95
        assert one.settled[-1] == pytest.approx(one.shifts[-1], abs=1e-7)
        assert one.shifts[0] == pytest.approx(0, abs=1e-9)
    by_name = {(effect.robot, effect.what): np.median(effect.shifts) for effect in study.effects}
    crossed = study.effects[0].robot
    assert by_name[crossed, real_cables.UNAWARE] > 20 * by_name[crossed, real_cables.ELASTICITY]


def test_nothing_explains_the_papers_15_mm(ends):
    """Weight and law leave the sag; pulleys from below lift; from above they sag unequally and lower the other."""
    plain, weight, law, below, above, wide = (one.downward_deviations for one in ends)
    solved = cdpr.solve(cdpr.load_robot("parallel"), (0.17, 0.25, 0.1))
    assert plain[0] == pytest.approx(-solved.deviation[2], abs=1e-7)
    assert np.abs(weight - plain).max() < 1e-6
    assert np.abs(law - plain).max() < 2e-6
    assert (below < plain - 0.004).all()
    assert (above < 0.010).all()
    assert wide[0] == pytest.approx(0.015, abs=1e-5)
    assert wide[1] < 0.012
    assert (ends[-1].crossed_deviations < -0.005).all()


def test_the_tables_fit_a_terminal(ends):
    """80 columns, nothing cut off."""
    for table in (real_cables.effects_table(properties().effects), paper_ends.ends_table(ends)):
        text = io.StringIO()
        Console(width=80, file=text).print(table)
        assert "…" not in text.getvalue()

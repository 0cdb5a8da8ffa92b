"""Pulleys, weight and laws in words, JSON, figures, videos and the study: what is shown is what there is."""

import io
import json
from importlib import resources

import matplotlib

matplotlib.use("Agg")

import mujoco
import numpy as np
import pytest
from matplotlib.colors import same_color
from matplotlib.figure import Figure
from matplotlib.patches import Polygon
from test_real_cables_physics import wheel_by_hand
from typer.testing import CliRunner

import cdpr_sim as cdpr
from cdpr_sim.cli import app
from cdpr_sim.core.describe import describe_cables, describe_properties, describe_twist
from cdpr_sim.drawing import axes as drawing
from cdpr_sim.drawing import style
from cdpr_sim.drawing.cable_curves import cable_curve
from cdpr_sim.drawing.video.scene import Stage
from cdpr_sim.drawing.video.writing import _captions, _footnote
from cdpr_sim.physics.model_files import model_files
from cdpr_sim.statics import two_cable_closed_form
from cdpr_sim.studies import real_cables, tilt_condition
from studies import crane_as_built, paper_ends
from studies import real_cable_tables as tables

UP = (0.0, 0.0, 1.0)
POSE = (0.3, 0.25, 0.1)

POLYGON = 2e-3
"""Of a wheel's arc drawn by 24 points to the turn, relative: 1 − sin(x)/x at x = 7.5° is 2.9e-3 of the arc alone."""

PARABOLA = 0.05
"""A parabola for what hangs, relative: the length of a slack cable's, to second order; a catenary's sag w L²/(8 T)."""


@pytest.fixture(scope="module")
def real(catalogue) -> dict[str, cdpr.Robot]:
    """DemoBot's crossed layout with each property."""
    robot = catalogue["cogiro"]
    return {
        "pulley": robot.replace(pulley_radius=0.02, pulley_axis=UP),
        "law": robot.replace(stiffening=(20.0, 0.0)),
        "heavy": robot.replace(linear_density=0.0005),
    }


def test_words_say_what_the_cables_are(real):
    """Weight, law and pulleys; of how many, where not of all."""
    assert describe_properties(real["pulley"]) == ("over pulleys of 20 mm radius",)
    assert describe_properties(real["law"]) == ("nonlinear with a2 = 20, a3 = 0",)
    assert describe_cables(real["heavy"], "N") == "vectran-0.7mm cables (EA = 10000 N), 0.5 g/m"
    mixed = real["heavy"].replace(
        linear_density=[0.064] + [0.0] * 7, pulley_radius=[0.0] + [0.01] * 6 + [0.02], material=None
    )
    assert describe_properties(mixed) == ("64 g/m (1 of 8)", "over pulleys of 10 to 20 mm radius (7 of 8)")


def test_a_motion_is_told_in_millimetres_and_degrees(catalogue):
    """A millimetre, and the angle that is as far at the characteristic length."""
    robot = catalogue["cogiro"]
    twist = np.array([robot.characteristic_length, 0, 0, 0, -1.0, 0])
    angle = np.degrees(1e-3 / robot.characteristic_length)
    assert describe_twist(twist, robot) == f"+1 mm x, -{angle:.2g}° about y"
    assert describe_twist(np.eye(6)[4], robot) == "rotation about y"


def test_plain_cables_are_described_as_ever(catalogue):
    """Nothing new is said of them, in words or JSON."""
    assert describe_cables(catalogue["cogiro"]) == "vectran-0.7mm cables (EA = 10 kN)"
    assert describe_properties(catalogue["cogiro"]) == ()
    answer = CliRunner().invoke(app, ["solve", "cogiro", "--json"])
    assert "cables" not in json.loads(answer.stdout)


def test_settle_and_solve_say_it_in_title_and_json(tmp_path):
    """From a robot file, through both commands."""
    file = tmp_path / "mine.toml"
    file.write_text(f"pulley = {{ radius = 0.01, axis = [0, 0, 2] }}\n{text_of('cogiro')}")
    words = [str(file), "--pose", *map(str, POSE)]
    shown = CliRunner().invoke(app, ["settle", *words])
    assert "over pulleys of 10 mm radius" in " ".join(shown.stdout.split())
    for command in ("settle", "solve"):
        found = json.loads(CliRunner().invoke(app, [command, *words, "--json"]).stdout)
        assert found["cables"] == {"pulley_radius": [0.01] * 8, "pulley_axis": [[0, 0, 1]] * 8}


def text_of(robot: str) -> str:
    """The robot's file."""
    return (resources.files("cdpr_sim.robots") / "zoo" / f"{robot}.toml").read_text(encoding="utf-8")


def test_captions_and_model_readmes_say_it_too(real):
    """In a video's caption, and in the README of a model folder, with the law that holds."""
    trajectory = at_rest(real["pulley"])
    assert "over pulleys of 20 mm radius" in _captions(trajectory)[0]
    assert "has settled at every state" in _footnote([trajectory], 1.0)
    assert "a2 eps²" in model_files(real["law"])["README.md"]
    assert "tension is EA (l - l0)/l0 beyond" in model_files(real["pulley"])["README.md"]


def drawn(
    robot: cdpr.Robot, equilibria: cdpr.EquilibriumBatch, shapes=None
) -> tuple[list[np.ndarray], list[np.ndarray], list[bool]]:
    """What ``draw_cables`` draws of the first row: cables and wheels, (points, 2) each, and which cables are slack."""
    ax = Figure().add_subplot()
    drawing.draw_cables(
        ax,
        robot,
        equilibria.positions[0],
        equilibria.rotations[0],
        equilibria.slack[0],
        equilibria.rest_lengths[0],
        shapes,
    )
    wheels = [patch.get_xy()[:-1] for patch in ax.patches if isinstance(patch, Polygon)]
    slack = [same_color(line.get_color(), style.SLACK_CABLE) for line in ax.lines]
    return [line.get_xydata() for line in ax.lines], wheels, slack


def length(curve: np.ndarray) -> float:
    return float(np.linalg.norm(np.diff(curve, axis=0), axis=1).sum())


@pytest.mark.parametrize("axis", [UP, (0.0, 0.0, -1.0)])
def test_cables_over_pulleys_are_drawn_as_long_as_mujoco_has_them(catalogue, axis):
    """In a planar robot the picture is to scale: taut cables have MuJoCo's lengths, slack ones their rest lengths."""
    robot = catalogue["planar-vertical"].replace(pulley_radius=0.015, pulley_axis=axis)
    equilibria = cdpr.settle_many(robot, [(0.2, 0.0, 0.15)])
    curves, wheels, slack = drawn(robot, equilibria)
    assert slack == equilibria.slack[0].tolist()
    assert any(slack)
    expected = np.where(equilibria.slack[0], equilibria.rest_lengths[0], equilibria.lengths[0])
    for curve, whole, hangs in zip(curves, expected, slack, strict=True):
        assert length(curve) == pytest.approx(whole, rel=PARABOLA if hangs else POLYGON)
    anchors = equilibria.positions[0] + robot.anchors @ equilibria.rotations[0].T
    for cable, (curve, wheel) in enumerate(zip(curves, wheels, strict=True)):
        assert curve[0] == pytest.approx(robot.exits[cable, [0, 2]])
        assert curve[-1] == pytest.approx(anchors[cable, [0, 2]])
        center = robot.exits[cable, [0, 2]] + [np.sign(anchors[cable, 0] - robot.exits[cable, 0]) * 0.015, 0]
        assert np.linalg.norm(wheel - center, axis=1) == pytest.approx(0.015)
        if not slack[cable]:  # it leaves the wheel on the tangent
            leaves = curve[-2] - center
            assert np.linalg.norm(leaves) == pytest.approx(0.015)
            assert leaves @ (curve[-1] - curve[-2]) == pytest.approx(0, abs=1e-12)


def test_in_space_a_cable_leaves_its_wheel_on_the_tangent(real):
    """Read back from the axes: wheels turned to their anchors, cables on them, taut ones as long as MuJoCo has them."""
    equilibria = cdpr.settle_many(real["pulley"], [POSE])
    robot = equilibria.robot
    ax = Figure().add_subplot(projection="3d")
    drawing.draw_pose(ax, equilibria, 0)
    curves = [np.array(line.get_data_3d()).T for line in ax.lines]
    cables, wheels = curves[::2], curves[1::2]
    expected = np.where(equilibria.slack[0], equilibria.rest_lengths[0], equilibria.lengths[0])
    for curve, whole, hangs in zip(cables, expected, equilibria.slack[0], strict=True):
        assert length(curve) == pytest.approx(whole, rel=PARABOLA if hangs else POLYGON)
    anchors = equilibria.positions[0] + robot.anchors @ equilibria.rotations[0].T
    for cable, (curve, wheel) in enumerate(zip(cables, wheels, strict=True)):
        center = wheel[:-1].mean(0)
        assert np.linalg.norm(wheel - center, axis=1) == pytest.approx(0.02)
        across = np.cross(center - robot.exits[cable], UP)
        assert across @ (anchors[cable] - robot.exits[cable]) == pytest.approx(0, abs=1e-12)
        if not equilibria.slack[0, cable]:
            assert (curve[-2] - center) @ (curve[-1] - curve[-2]) == pytest.approx(0, abs=1e-12)


def test_heavy_cables_hang_in_their_true_shape(catalogue):
    """Ends where the cable ends; slack ones as long as they are, taut ones with the sag w L²/(8 T)."""
    robot = catalogue["planar-vertical"].replace(linear_density=0.005)
    equilibria = cdpr.solve_many(robot, [(0.2, 0.0, 0.15)])
    shapes = cdpr.cable_profiles(equilibria, points=401)
    assert shapes.shape == (1, 4, 401, 3)
    curves, wheels, slack = drawn(robot, equilibria, shapes[0])
    assert not wheels
    assert slack == equilibria.slack[0].tolist()
    assert set(slack) == {True, False}
    anchors = equilibria.positions[0] + robot.anchors @ equilibria.rotations[0].T
    for cable, curve in enumerate(curves):
        start, end = robot.exits[cable, [0, 2]], anchors[cable, [0, 2]]
        assert curve[[0, -1]] == pytest.approx(np.array([start, end]))
        if slack[cable]:
            assert length(curve) == pytest.approx(equilibria.rest_lengths[0, cable], rel=2e-4)
            continue
        weight, span = 0.005 * robot.gravity, np.abs(end - start)[0]
        chord = np.linalg.norm(end - start)
        pull = equilibria.tensions[0, cable] * span / chord
        order = np.argsort(curve[:, 0])
        middle = (start + end) / 2
        sag = middle[1] - np.interp(middle[0], *curve[order].T)
        assert sag == pytest.approx(weight * chord * span / (8 * pull), rel=PARABOLA)


def test_a_heavy_cable_drawn_to_another_place_is_sheared(real):
    """Where deviations are exaggerated: its exit stays, its end goes there, its middle half as far."""
    cabling, shape = real["heavy"].cabling, np.array([[0.0, 0, 1], [0.2, 0, 0.5], [0.4, 0, 0.6]])
    end = shape[-1] + [0.1, 0.0, -0.2]
    np.testing.assert_allclose(cable_curve(cabling, 0, end, shape=shape), [[0, 0, 1], [0.25, 0, 0.4], [0.5, 0, 0.4]])


def test_a_massless_cable_has_a_straight_shape_and_one_over_a_pulley_none(real):
    """Shapes of robots without weight are what is drawn anyhow."""
    equilibria = cdpr.solve_many(real["law"], [POSE])
    assert not equilibria.slack.any()
    shapes = cdpr.cable_profiles(equilibria, points=3)[0]
    assert shapes[:, 1] == pytest.approx((shapes[:, 0] + shapes[:, 2]) / 2, abs=1e-8)
    assert np.isnan(cdpr.cable_profiles(cdpr.solve_many(real["pulley"], [POSE]))).all()
    with pytest.raises(cdpr.InvalidInput, match="points: found 1"):
        cdpr.cable_profiles(equilibria, points=1)


def at_rest(robot: cdpr.Robot, pose=POSE) -> cdpr.Trajectory:
    """Two states of the platform at rest there."""
    return cdpr.Trajectory.through(cdpr.solve_many(robot, [pose, pose]), np.array([0.0, 1.0]))


def capsules(stage: Stage, color: np.ndarray) -> np.ndarray:
    """Ends of all lines of this colour, (lines, 2, 3)."""
    found = []
    for geom in stage.scene.geoms[: stage.scene.ngeom]:
        if geom.type == mujoco.mjtGeom.mjGEOM_CAPSULE and np.allclose(geom.rgba, color, atol=1e-6):
            half = geom.size[2] * geom.mat.reshape(3, 3)[:, 2]
            found.append([geom.pos - half, geom.pos + half])
    return np.array(found)


def test_videos_draw_cables_from_their_wheels(real):
    """MuJoCo's own tendons, which begin before the wheels, are not drawn; the wheels face their anchors."""
    trajectory = at_rest(real["pulley"])
    robot = trajectory.robot
    stage = Stage(trajectory, largest_tension=2.0)
    stage.set(0)
    tendons = [g for g in stage.scene.geoms[: stage.scene.ngeom] if g.objtype == mujoco.mjtObj.mjOBJ_TENDON]
    assert not tendons
    for cable in range(robot.cables):
        lines = capsules(stage, stage.model.tendon_rgba[cable])
        ends = lines.reshape(-1, 3)
        assert np.linalg.norm(ends - robot.exits[cable], axis=1).min() < 1e-6
        wheel = stage.data.geom(f"wheel_{cable + 1}").xpos
        away = trajectory.poses[0].apply(robot.anchors[cable]) - robot.exits[cable]
        assert np.cross(UP, wheel - robot.exits[cable]) @ away == pytest.approx(0, abs=1e-9)


def test_videos_draw_heavy_cables_in_the_shape_they_are_given(real):
    """Corner by corner, and as many as they have."""
    trajectory = at_rest(real["heavy"])
    shapes = cdpr.cable_profiles(trajectory, points=9)
    stage = Stage(trajectory, largest_tension=2.0, shapes=shapes)
    stage.set(1)
    for cable in range(trajectory.robot.cables):
        ends = capsules(stage, stage.model.tendon_rgba[cable]).reshape(-1, 3)
        for point in shapes[1, cable]:
            assert np.linalg.norm(ends - point, axis=1).min() < 1e-6


def test_heavy_cables_are_not_drawn_without_their_shape(real):
    """Figures and videos refuse, in a sentence; so do shapes of something else."""
    trajectory, ax = at_rest(real["heavy"]), Figure().add_subplot()
    robot, message = real["heavy"], "shapes: found none of .*0.0005 kg/m"
    with pytest.raises(cdpr.InvalidInput, match=message):
        drawing.draw_cables(ax, robot, np.array(POSE), np.eye(3), [False] * 8)
    with pytest.raises(cdpr.InvalidInput, match=message):
        drawing.draw_pose(Figure().add_subplot(projection="3d"), trajectory, 0)
    with pytest.raises(cdpr.InvalidInput, match=message):
        Stage(trajectory, largest_tension=2.0)
    with pytest.raises(cdpr.InvalidInput, match="expected 2 states of 8 cables"):
        Stage(trajectory, largest_tension=2.0, shapes=cdpr.cable_profiles(trajectory)[:1])


def test_a_video_drives_cables_with_mass(tmp_path, monkeypatch):
    """With rigid and with compensated lengths."""
    file, video = tmp_path / "mine.toml", tmp_path / "mine.gif"
    file.write_text(f"linear_density = 0.0005\n{text_of('planar-vertical')}")
    motions = []
    monkeypatch.setattr("cdpr_sim.cli.picture_commands.COMPENSATED_WAYPOINTS", 3)
    monkeypatch.setattr(
        "cdpr_sim.studies.robot_summary.write_both_methods", lambda _, trajectories, **__: motions.extend(trajectories)
    )
    words = ["--compensate", "--path", "0.4", "0.41", "--drive-seconds", "0.2", "--seconds", "0.5", "--fps", "10"]
    answer = CliRunner().invoke(app, ["video", str(file), *words, "-o", str(video)])
    assert answer.exit_code == 0, answer.output
    assert [motion.status[-1] for motion in motions] == [cdpr.Status.MOVING] * 2


def test_studies_refuse_what_they_take_no_account_of(catalogue):
    """The closed form of two cables, and the moment balance of the paper's Fig. 9."""
    bar, four = catalogue["two-cable"], catalogue["planar-vertical"]
    for changes, message in (({"linear_density": 0.01}, "0.01 kg/m"), ({"pulley_radius": 0.01}, "pulleys of 0.01 m")):
        with pytest.raises(cdpr.InvalidInput, match=f"two-cable closed form: found .*{message}"):
            two_cable_closed_form.equilibrium_rotations(bar.replace(**changes), (0.3, 0.0, 0.2))
    law = bar.replace(stiffening=(20.0, 0.0))
    assert two_cable_closed_form.equilibrium_rotations(law, (0.3, 0, 0.2)) == pytest.approx(
        two_cable_closed_form.equilibrium_rotations(bar, (0.3, 0, 0.2))
    )
    hung = four.replace(linear_density=0.01, material="fishing-0.4mm")
    assert abs(tilt_condition.balance_at_rest(hung, np.array([0.25, 0.0, 0.2])).arm) < 1e-6  # along sagging cables too
    given = tilt_condition.equal_pulls(hung, np.array([0.3, 0.0, 0.2]))
    assert given.net_moment == pytest.approx(given.moment, abs=1e-9)
    plain = tilt_condition.equal_pulls(four, np.array([0.3, 0.0, 0.2]))
    assert abs(given.moment - plain.moment) > 1e-3  # negative control: the directions are not those of the chords
    over = tilt_condition.balance_at_rest(four.replace(pulley_radius=0.01), np.array([0.25, 0.0, 0.2]))
    assert abs(over.arm) < 1e-6  # the lines of force of cables over pulleys meet above the centre of mass as well


def test_a_sweep_of_heavy_robots_has_all_quantities(real, catalogue):
    """As many as of massless cables; two of them by the functions for one pose."""
    grid = (2, 1, 1)
    heavy, plain = cdpr.sweep(real["heavy"], grid), cdpr.sweep(catalogue["cogiro"], grid)
    assert set(plain.data_vars) == set(heavy.data_vars)
    solved = cdpr.solve(real["heavy"], [float(heavy[axis][0]) for axis in "xyz"])
    assert float(heavy.tilt[0, 0, 0]) == pytest.approx(solved.tilt)
    assert float(heavy.frequency[0, 0, 0]) == pytest.approx(cdpr.natural_modes(solved).frequencies[0], rel=1e-9)


# The study


def test_point_exit_lengths_change_as_straight_cables_do(real):
    """Right at home; elsewhere off by what wheels take up."""
    robot = real["pulley"]
    home, there = robot.home, np.array(POSE)
    lengths = real_cables.point_exit_lengths(robot, [home, there])
    for cable, (exit_point, anchor) in enumerate(zip(robot.exits, robot.anchors, strict=True)):
        at_home, _ = wheel_by_hand(exit_point, np.array(UP), 0.02, home + anchor)
        change = np.linalg.norm(there + anchor - exit_point) - np.linalg.norm(home + anchor - exit_point)
        assert lengths[:, cable] == pytest.approx([at_home, at_home + change], abs=1e-12)


@pytest.mark.parametrize("number", [1, 2])
def test_effects_are_differences_of_single_solves(number):
    """Each row against solves made one by one; MuJoCo and statics together to 1e-7 m."""
    case = real_cables.cases()[number]
    commanded = case.commanded(2)
    effects = {effect.what: effect for effect in real_cables.effects(case, 2)}
    over = case.robot.replace(pulley_radius=case.radius, pulley_axis=UP)
    heavy = case.robot.replace(linear_density=case.density)
    driven = case.robot.replace(winch_to_exit=case.behind)
    told = real_cables.point_exit_lengths(over, commanded)
    for row, pose in enumerate(commanded):
        plain, aware = cdpr.solve(case.robot, pose), cdpr.solve(over, pose)
        unaware, weighing = cdpr.solve(over, pose, told[row]), cdpr.solve(heavy, pose)
        pairs = {
            real_cables.UNAWARE: (unaware, aware),
            real_cables.AWARE: (aware, plain),
            real_cables.MASS: (weighing, plain),
            real_cables.BEHIND: (cdpr.solve(driven, pose), plain),
        }
        for what, (one, other) in pairs.items():
            found = effects[what]
            assert found.unsettled == 0
            assert found.method_difference < 1e-7
            assert found.shifts[row] == pytest.approx(np.linalg.norm(one.position - other.position), abs=2e-7)
            assert found.turns[row] == pytest.approx(abs(one.tilt - other.tilt), abs=1e-5)
        assert effects[real_cables.ELASTICITY].shifts[row] == pytest.approx(np.linalg.norm(plain.deviation), abs=2e-7)


def test_the_crane_as_it_is_is_all_properties_at_once():
    """Displaced from the plain crane by all, and from the whole by what is left out: against single solves."""
    case = real_cables.cases()[2]
    (pose,) = case.commanded(1)
    given = dict(
        pulley_radius=case.radius, pulley_axis=UP, linear_density=case.density, winch_to_exit=case.behind,
        stiffening=real_cables.STIFFENING,
    )  # fmt: skip
    none = dict(pulley_radius=0.0, linear_density=0.0, winch_to_exit=0.0, stiffening=(0.0, 0.0))
    whole = cdpr.solve(case.robot.replace(**given), pose)
    found = {effect.what: effect for effect in crane_as_built.together(case, 1)}
    assert all(one.unsettled == 0 and one.method_difference < 1e-9 for one in found.values())
    others = {crane_as_built.TOGETHER: case.robot}
    for name, what in (
        ("pulley_radius", real_cables.AWARE), ("linear_density", real_cables.MASS),
        ("winch_to_exit", real_cables.BEHIND), ("stiffening", real_cables.NONLINEAR),
    ):  # fmt: skip
        others[f"without {what}"] = case.robot.replace(**given | {name: none[name]})
    assert found.keys() == others.keys()
    for what, robot in others.items():
        shift = np.linalg.norm(cdpr.solve(robot, pose).position - whole.position)
        assert found[what].shifts[0] == pytest.approx(shift, abs=1e-9)
        assert shift > 1e-5


@pytest.fixture(scope="module")
def study() -> real_cables.RealCables:
    """All of it, over a few poses."""
    return real_cables.real_cables(2)


@pytest.fixture(scope="module")
def ends() -> tuple[paper_ends.PaperEnd, ...]:
    """At the ends of the paper's lines."""
    return paper_ends.paper_ends()


def test_pulleys_unknown_to_the_winches_cost_more_than_half_a_millimetre_per_millimetre(study):
    """The headline, on both of DemoBot's layouts and on both methods; elasticity costs the level layout far less."""
    for one in study.growths[:2]:
        assert 0.5 < one.rate < 0.95
        assert one.settled[-1] == pytest.approx(one.shifts[-1], abs=1e-7)
        assert one.shifts[0] == pytest.approx(0, abs=1e-9)
    by_name = {(effect.robot, effect.what): np.median(effect.shifts) for effect in study.effects}
    crossed = study.effects[0].robot
    assert by_name[crossed, real_cables.UNAWARE] > 20 * by_name[crossed, real_cables.ELASTICITY]


def test_nothing_explains_the_papers_15_mm(ends):
    """Weight and law leave the sag; pulleys from below lift; from above they sag unequally and lower the other."""
    plain, weight, law, below, above, wide = ends
    solved = cdpr.solve(cdpr.load_robot("parallel"), (0.17, 0.25, 0.1))
    assert plain.downward_deviations[0] == pytest.approx(-solved.deviation[2], abs=1e-7)
    assert np.abs(weight.downward_deviations - plain.downward_deviations).max() < 1e-6
    assert np.abs(law.downward_deviations - plain.downward_deviations).max() < 2e-6
    assert (below.downward_deviations < plain.downward_deviations - 0.004).all()
    assert (above.downward_deviations < 0.010).all()
    assert wide.downward_deviations[0] == pytest.approx(0.015, abs=1e-5)
    assert wide.downward_deviations[1] < 0.012
    assert (wide.crossed_deviations < -0.005).all()


def test_the_tables_fit_a_terminal(study, ends):
    """80 columns, nothing cut off, every property named."""
    from rich.console import Console

    for table in (tables.effects_table(study.effects), paper_ends.ends_table(ends)):
        text = io.StringIO()
        Console(width=80, file=text).print(table)
        assert "…" not in text.getvalue()
    assert tables.left_out(study.effects) == ""

"""What studies' figures say is what was computed: data, units and legends, of results that are made up.

Each method's numbers are its own there, so that one drawn as the other is noticed.
"""

import dataclasses

import numpy as np
import pytest
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.colors import same_color, to_hex
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from scipy.spatial.transform import Rotation

import cdpr_sim as cdpr
from cdpr_sim.core.equilibrium_batch import EquilibriumBatch
from cdpr_sim.core.pose import Pose
from cdpr_sim.core.problem import Problems
from cdpr_sim.crosscheck.layout_validation import LayoutValidation
from cdpr_sim.drawing import style
from cdpr_sim.statics import two_cable_closed_form
from cdpr_sim.studies import (
    better_layouts,
    lines,
    lines_figures,
    pretension,
    real_cables,
    solvers,
    tilt_condition,
    two_cable,
)
from studies import compensated_line, compensation_figures, controller_comparison, controller_comparison_figures

RANDOM = np.random.default_rng(15)


def made_up(robot: cdpr.Robot, commanded, slack=()) -> EquilibriumBatch:
    """Somewhere near each command, turned about y alone; ``slack``: (row, cable) of the cables that are."""
    commanded = np.asarray(commanded, dtype=float)
    rows = len(commanded)
    tensions = RANDOM.uniform(0.5, 2.0, (rows, robot.cables))
    for row, cable in slack:
        tensions[row, cable] = 0.0
    problems = Problems.of(robot, commanded)
    return EquilibriumBatch(
        problems=problems,
        positions=commanded + RANDOM.uniform(0.005, 0.02, (rows, 3)) * [1, 0, -1],
        rotations=Rotation.from_rotvec(RANDOM.uniform(0.05, 0.3, (rows, 1)) * [0, 1, 0]).as_matrix(),
        lengths=problems.rest_lengths * np.where(tensions > 0, 1.001, 0.98),
        tensions=tensions,
        residuals=np.zeros(rows),
        iterations=np.zeros(rows, dtype=int),
        status=np.zeros(rows, dtype=int),
        source="made up",
        stiffness=np.ones((rows, len(robot.free))),
    )


def by_gid(figure: Figure | Axes) -> dict[str, Line2D]:
    """Lines that have an id; of those with the same one, the last."""
    axes = figure.axes if isinstance(figure, Figure) else [figure]
    return {str(line.get_gid()): line for ax in axes for line in ax.lines if line.get_gid()}


def legend(of: Figure | Axes) -> dict[str, Artist]:
    """What stands before each of its words."""
    (one,) = of.legends if isinstance(of, Figure) else [of.get_legend()]
    return dict(zip([text.get_text() for text in one.get_texts()], one.legend_handles, strict=True))


def looks(artist: Artist) -> tuple:
    """By which a reader tells one series from another."""
    if isinstance(artist, Line2D):
        return to_hex(artist.get_color()), artist.get_linestyle(), str(artist.get_marker())
    assert isinstance(artist, Patch)
    return to_hex(artist.get_facecolor(), keep_alpha=True), to_hex(artist.get_edgecolor())


# Tensions along the width, and poses


@pytest.fixture(scope="module")
def width() -> lines.Width:
    """A planar robot, of whose four cables the first is slack on the left, and none on the right."""
    robot = cdpr.load_robot("planar-vertical")
    along = lines.along_x(robot, 0.1, (0.1, 0.7), 7)
    static, settled = made_up(robot, along, [(0, 0), (1, 0), (2, 0), (0, 1)]), made_up(robot, along[::3])
    poses = made_up(robot, [(0.2, 0, 0.28), (0.6, 0, 0.1)], [(0, 0), (1, 0)])
    return lines.Width(poses, (lines.Line(static, settled),), np.empty((0, 3)))


def test_a_legend_of_tensions_names_each_cable_and_zone(width):
    """Numbers from 1, sides by their exits; the look of a name is that of its line."""
    figure = lines_figures.planar(width)
    ax = next(ax for ax in figure.axes if ax.get_ylabel() == "tension [N]")
    names, drawn = legend(ax), by_gid(ax)
    robot = width.poses.robot
    for cable in range(4):
        side = "left" if robot.exits[cable, 0] < 0.4 else "right"
        entry = names.pop(f"cable {cable + 1} ({side})")
        assert looks(entry)[:2] == looks(drawn[f"static {cable}"])[:2]
        assert looks(entry)[2] == looks(drawn[f"mujoco {cable}"])[2]
        assert looks(entry)[0] == to_hex(style.LEFT if side == "left" else style.RIGHT)
        for method, equilibria in (("static", width.lines[0].static), ("mujoco", width.lines[0].settled)):
            points = np.transpose([equilibria.problems.positions[:, 0], equilibria.tensions[:, cable]])
            np.testing.assert_array_equal(drawn[f"{method} {cable}"].get_xydata(), points)
    zones = {patch.get_gid(): patch for patch in ax.patches if str(patch.get_gid()).startswith("zone")}
    assert list(names) == ["1 cable slack", "2 cables slack"]
    for count, entry in zip((1, 2), names.values(), strict=True):
        assert looks(entry) == looks(zones[f"zone-{count}-slack"])
        assert looks(entry)[0][:7] == style.ZONES[count - 1][0]  # yellow, and red where more are slack
    rotations = np.concatenate([width.poses.rotations, width.lines[0].static.rotations])
    tilt = np.degrees(np.arccos(rotations[:, 2, 2])).max()
    title = f"planar-vertical: up to {tilt:.2g}° of tilt, and up to 2 of 4 cables slack"
    assert figure.get_suptitle().replace("\n", " ") == title
    assert ax.get_xlabel() == "commanded x [m]"


def test_a_legend_of_poses_names_what_is_where(width):
    """What looks like a platform at rest is where it rests; dashed, where it was commanded; dotted cables are slack."""
    figure = lines_figures.planar(width)
    fronts = [ax for ax in figure.axes if ax.get_ylabel() == "z [m]"]
    names, equilibria = legend(fronts[-1]), width.poses
    assert set(names) == {"commanded pose", "platform at equilibrium", "taut cable", "slack cable"}
    assert fronts[-1].get_xlabel() == "x [m]"
    for ax, row in zip(fronts, (0, 1), strict=True):  # the higher one above
        boxes = [patch for patch in ax.patches if len(patch.get_path().vertices) == 5 and hasattr(patch, "get_xy")]
        middles = {}
        for what in ("commanded pose", "platform at equilibrium"):
            (box,) = (box for box in boxes if looks(box) == looks(names[what]) and not hasattr(box, "get_width"))
            middles[what] = box.get_xy()[:-1].mean(0)
        np.testing.assert_allclose(middles["commanded pose"], equilibria.problems.positions[row][[0, 2]])
        np.testing.assert_allclose(middles["platform at equilibrium"], equilibria.positions[row][[0, 2]])
        cables = [line for line in ax.lines if line.get_marker() == "None"]
        for cable, line in enumerate(cables):
            what = "slack cable" if cable == 0 else "taut cable"
            assert looks(line)[0] == looks(names[what])[0]
            np.testing.assert_allclose(line.get_xydata()[0], equilibria.robot.exits[cable, [0, 2]])


def test_the_papers_line_has_each_series_under_its_name():
    """Two layouts, two materials: colour and marker of a name are those of its line and its points."""
    robots = [
        cdpr.load_robot(name).replace(material=material)
        for name in ("parallel", "cogiro")
        for material in ("vectran-0.7mm", "fishing-0.4mm")
    ]
    along = lines.along_x(robots[0], 0.1, (0.17, 0.63), 3)
    shown = [lines.Line(made_up(one, along), made_up(one, along)) for one in robots]
    figure = lines_figures.paper_line(shown)
    sag, turn = map(by_gid, figure.axes)
    names, drawn = legend(figure.axes[0]), sag
    for one, line in zip(robots, shown, strict=True):
        label = f"{one.name}, {one.material}"
        for method, equilibria in (("static", line.static), ("mujoco", line.settled)):
            x, deviation = equilibria.positions[:, 0], 1e3 * (equilibria.positions - along)[:, 2]
            np.testing.assert_allclose(sag[f"{method} {label}"].get_xydata(), np.transpose([x, deviation]))
            beta = np.degrees(np.arctan2(equilibria.rotations[:, 0, 2], equilibria.rotations[:, 0, 0]))
            np.testing.assert_allclose(turn[f"{method} {label}"].get_xydata(), np.transpose([x, beta]))
        assert looks(names[label])[0] == looks(drawn[f"static {label}"])[0]
        assert looks(names[label])[2] == looks(drawn[f"mujoco {label}"])[2]
        assert same_color(drawn[f"mujoco {label}"].get_mec(), names[label].get_mec())
        assert names[label].get_linewidth() == drawn[f"static {label}"].get_linewidth()
    assert len({looks(names[f"{one.name}, {one.material}"]) for one in robots}) == 4
    assert [ax.get_ylabel() for ax in figure.axes] == ["deviation in z [mm]", "rotation about y [°]"]
    bars = [sorted(line.get_ydata()[0] for line in ax.lines if line.get_gid() == "paper") for ax in figure.axes]
    assert bars == [[-15.0, -15.0], pytest.approx([-20.0, 20.0])]  # "about 15 mm", "approximately 20°"
    said = []
    for own in (shown[:2], shown[2:]):
        turned = np.concatenate([np.arccos(line.static.rotations[:, 2, 2]) for line in own])
        sags = np.concatenate([(along - line.static.positions)[:, 2] for line in own])
        said.append((f"{np.degrees(turned.max()):.2g}°", f"{1e3 * sags.max():.2g} mm"))
    (tilt, fall), (other_tilt, other_fall) = said
    title = f"parallel tilts {tilt} and deviates {fall} downwards, cogiro {other_tilt} and {other_fall} downwards"
    assert title in figure.get_suptitle().replace("\n", " ")


def test_layouts_have_their_cables_to_the_left_and_right():
    """In the legend's colours, by their exits, from them to the anchors; numbers count from 1."""
    robots = map(cdpr.load_robot, ("planar-vertical", "planar-horizontal", "parallel", "cogiro"))
    homes = [made_up(robot, robot.home[None]) for robot in robots]
    figure = lines_figures.layouts(homes)
    names = legend(figure.axes[0])
    for ax, equilibria in zip(figure.axes, homes, strict=True):
        lines_drawn = [line for line in ax.lines if line.get_marker() == "None"]
        assert [text.get_text() for text in ax.texts] == [str(i + 1) for i in range(equilibria.robot.cables)]
        anchors = equilibria.positions[0] + equilibria.robot.anchors @ equilibria.rotations[0].T
        for exit_, anchor, line, number in zip(equilibria.robot.exits, anchors, lines_drawn, ax.texts, strict=True):
            color = looks(names["cable to the left" if exit_[0] < 0.4 else "cable to the right"])[0]
            assert same_color(line.get_color(), color)
            assert same_color(number.get_color(), color)
            ends = np.transpose(line.get_data_3d()) if ax.name == "3d" else line.get_xydata()
            planar = slice(None) if ax.name == "3d" else [0, 2]
            np.testing.assert_allclose(ends, np.array([exit_, anchor])[:, planar])


def test_the_tilt_condition_says_how_far_and_how_much():
    """Beside the middle the midlines of upright pairs meet 25 mm beside the weight's line: similar triangles."""
    figure = tilt_condition.draw_moment_balances(tilt_condition.moment_balances())
    half, drop, reach, beside = 0.0515, 0.468 - 0.2, 0.36, 0.15  # m: exits at 0.04 and 0.76 m, platform at 0.25 m
    share = half / (reach - half)
    arm = share * beside  # beyond the anchors, both midlines go on by that share of their way
    point = [0.4 - beside - arm, 0.2 - share * drop]
    ax = figure.axes[2]
    (meeting,) = (line for line in ax.lines if line.get_gid() == "meeting point")
    np.testing.assert_allclose(meeting.get_xydata()[0], point)
    moment = 1e3 * 0.4 * 9.81 * arm
    words = f"the weight passes {1e3 * arm:.0f} mm beside it: 3.92 N × {1e3 * arm:.0f} mm = {moment:.0f} N mm"
    assert ax.get_title(loc="left").splitlines()[1] == words
    assert [ax.texts[-1].get_text() for ax in figure.axes] == ["H", "V", "V", "intersection"]
    names = legend(figure.axes[3])
    vertical = [line for line in ax.lines if looks(line)[:2] == looks(names["line of the weight"])[:2]]
    np.testing.assert_allclose([line.get_xdata() for line in vertical], [[0.25, 0.25]])
    sides = [line.get_xydata() for line in ax.lines if looks(line)[:2] == looks(names["line of a side's force"])[:2]]
    for ends, middle in zip(sides, ((0.04, 0.468), (0.76, 0.468)), strict=True):  # between the two exits of a pair
        assert ends[:, 1].max() == pytest.approx(0.486)
        along, there, to_middle = ends[1] - ends[0], point - ends[0], middle - ends[0]
        assert along[0] * there[1] == pytest.approx(along[1] * there[0], abs=1e-12)
        assert along[0] * to_middle[1] == pytest.approx(along[1] * to_middle[0], abs=1e-12)


# Two cables


@pytest.fixture(scope="module")
def forms() -> two_cable.TwoCableBar:
    robot = cdpr.load_robot("two-cable")
    along = lines.along_x(robot, 0.2, (0.2, 0.6), 5)
    few = [(0.3, 0, 0.3), (0.5, 0, 0.2)]
    return two_cable.TwoCableBar(
        lines.Line(made_up(robot, along), made_up(robot, along[::2])),
        made_up(robot, few),
        made_up(robot, few),
    )


def test_four_witnesses_of_the_bars_tilt_are_drawn_under_their_names(forms):
    """In degrees, over the x where the bar rests; below, what the closed forms differ by from the solver."""
    figure = two_cable.draw_closed_form(forms)
    top, bottom = figure.axes
    static, settled = forms.line.static, forms.line.settled
    beta = np.degrees(static.euler[:, 1])
    closed, short = (
        np.degrees([form(static.robot, position) for position in static.positions])
        for form in (two_cable.upright, two_cable_closed_form.short_bar_rotation)
    )
    drawn = {str(line.get_label()): line for line in top.lines}
    for name, x, y in (
        ("closed form, with the bar's length", static.positions[:, 0], closed),
        ("closed form of a short bar (paper, corrected)", static.positions[:, 0], short),
        ("static solver", static.positions[:, 0], beta),
        ("MuJoCo, settled", settled.positions[:, 0], np.degrees(settled.euler[:, 1])),
    ):
        np.testing.assert_allclose(drawn[name].get_xydata(), np.transpose([x, y]))
    errors = {str(line.get_label()): line.get_ydata() for line in bottom.lines}
    np.testing.assert_allclose(errors["closed form"], closed - beta)
    np.testing.assert_allclose(errors["short bar"], short - beta)
    most = np.abs(short - beta).max()
    assert figure.get_suptitle().replace("\n", " ").endswith(f"has an error of up to {most:.1f}° of tilt")
    assert (bottom.get_xlabel(), bottom.get_ylabel()) == ("x of the bar [m]", "error to static solver [°]")


def test_the_bars_three_poses_are_drawn_under_their_names(forms):
    """Level where it was commanded, as it would have to tilt there, and where and how it rests by either method."""
    figure = two_cable.draw_poses(forms)
    (ax,) = figure.axes
    names, equilibria = legend(ax), forms.poses
    commanded = equilibria.problems.positions
    anchors = equilibria.robot.anchors[[0, -1]]
    for name, positions, turns in (
        ("commanded, level", commanded, np.zeros(2)),
        (
            "closed form: equilibrium tilt there",
            commanded,
            [two_cable.upright(equilibria.robot, position) for position in commanded],
        ),
        ("static solver: equilibrium", equilibria.positions, equilibria.euler[:, 1]),
    ):
        bars = [line.get_xydata() for line in ax.lines if looks(line) == looks(names[name])]
        turned = [at + Rotation.from_euler("y", turn).apply(anchors) for at, turn in zip(positions, turns, strict=True)]
        np.testing.assert_allclose(bars, np.array(turned)[..., [0, 2]], atol=1e-12)
    settled = forms.settled_poses
    ends = [settled.positions + settled.rotations @ anchor for anchor in (np.zeros(3), *anchors)]
    points = np.concatenate([line.get_xydata() for line in ax.lines if line.get_gid() == "mujoco"])
    np.testing.assert_allclose(points, np.concatenate(ends)[:, [0, 2]])
    shift = 1e3 * np.abs(equilibria.positions - commanded)[:, 0].max()
    assert f"deviates up to {shift:.0f} mm" in figure.get_suptitle().replace("\n", " ")
    robot = "two-cable, vectran-0.7mm cables (EA = 10 kN), bar of 102 mm and 0.4 kg, 2 commanded poses"
    assert figure.get_supxlabel().replace("\n", " ").startswith(robot)


def test_the_drifts_colours_are_the_bars(monkeypatch):
    """A piece of the curve has the colour that stands beside its stiffness."""
    monkeypatch.setattr(two_cable, "SURFACE", (25, 19))  # for each point of which a quartic is solved
    robot = cdpr.load_robot("two-cable")
    commanded, stiffness = np.array([[0.2, 0, 0.3]]), np.array([1000.0, 100.0, 50.0, 15.0])
    robots = [robot.replace(axial_stiffness=EA) for EA in stiffness]
    study = two_cable.Manifold(*(tuple(made_up(one, commanded) for one in robots) for _ in range(2)))
    figure = two_cable.draw_manifold(study)
    front = next(ax for ax in figure.axes if "front view" in ax.get_title(loc="left"))
    bar = next(ax for ax in figure.axes if ax.get_ylabel() == "axial stiffness EA [N]")
    places = {float(label.get_text()): at for label, at in zip(bar.get_yticklabels(), bar.get_yticks(), strict=True)}
    (mesh,) = bar.collections[-1:]
    pieces = [line for line in front.lines if line.get_linewidth() == 3.2]
    for piece, EA in zip(pieces, stiffness, strict=False):
        np.testing.assert_allclose(piece.get_color(), np.ravel(mesh.to_rgba([places[EA]])), atol=0.01)
    for gid, method in (("static 0", study.static), ("mujoco", study.settled)):
        points = np.concatenate([line.get_xydata() for line in front.lines if line.get_gid() == gid])
        np.testing.assert_array_equal(points, np.concatenate([one.positions[:, [0, 2]] for one in method]))


# Solvers


def test_each_solver_is_drawn_under_its_name():
    """Shares in per cent, and the median and the tenths of its times in milliseconds, in the same colour."""
    methods = ("newton", "fsolve", "least_squares")
    solved = dict(zip(methods, np.array([[10, 10], [9, 4], [8, 1]]), strict=True))
    seconds = {method: RANDOM.uniform(1, 2, (2, 11)) * 10.0**-i for i, method in enumerate(methods)}
    robot = cdpr.load_robot("parallel")
    study = solvers.Convergence(robot, np.array([1e2, 1e4]), 10, solved, solved, seconds, np.array([1e-5, 2e-5]))
    figure = solvers.draw_convergence(study)
    left, right = figure.axes
    names = dict(zip(("Newton (ours)", "SEECR, fsolve", "SEECR, least_squares"), methods, strict=True))
    bars = {str(container[0].get_gid()): container for container in right.containers}
    assert set(legend(left)) == set(names)
    for name, entry in legend(left).items():
        method = names[name]
        shares = by_gid(left)[method]
        assert looks(entry) == looks(shares)
        np.testing.assert_allclose(shares.get_xydata(), np.transpose([[1e2, 1e4], 10 * solved[method]]))
        middle = bars[method][0]
        assert looks(middle) == looks(shares)
        ordered = 1e3 * np.sort(seconds[method])  # of eleven, the sixth, and the second and the tenth
        np.testing.assert_allclose(middle.get_ydata(), ordered[:, 5])
        ends = np.array([segment[:, 1] for segment in bars[method][2][0].get_segments()])
        np.testing.assert_allclose(ends, ordered[:, [1, 9]])
    np.testing.assert_allclose(by_gid(right)["compiled"].get_ydata(), [1e-2, 2e-2])
    assert (left.get_ylabel(), right.get_ylabel()) == ("poses solved [%]", "time per pose [ms]")
    assert "EA = 10 kN, Newton solves 100 %, fsolve 40 %, least_squares 10 %" in figure.get_suptitle().replace(
        "\n", " "
    )


def test_each_difference_of_the_methods_is_drawn_in_its_panel():
    """Positions in m, rotations in degrees, tensions in N; with what counts as the same, and crosses where free."""
    agree, free = cdpr.Verdict.AGREE, cdpr.Verdict.AGREE_EXCEPT_NEUTRAL
    study = {
        name: [
            cdpr.Agreement(
                verdict, (), *(scale * 10.0 ** RANDOM.uniform(-12, -9) for scale in (1, 10, 100)), True, 0.0, 0.0
            )
            for verdict in (agree, agree, agree, free)
        ]
        for name in ("first", "second")
    }
    figure = solvers.draw_agreement(study)
    panels = {
        "difference in position [m]": ("position_error", 1.0, 1e-6),
        "difference in rotation [°]": ("rotation_error", 180 / np.pi, np.degrees(1e-5)),
        "largest difference in a tension [N]": ("tension_error", 1.0, 1e-3),
    }
    names = legend(figure)
    assert [ax.get_xlabel() for ax in figure.axes] == list(panels)
    for ax, (field, unit, tolerance) in zip(figure.axes, panels.values(), strict=True):
        for name, agreements in study.items():
            curve, cross = by_gid(ax)[name], by_gid(ax)[f"{name} neutral"]
            values = unit * np.array([getattr(one, field) for one in agreements])
            np.testing.assert_allclose(curve.get_xdata(), np.sort(values[:3]))
            np.testing.assert_allclose(curve.get_ydata(), [100 / 3, 200 / 3, 100])
            np.testing.assert_allclose(cross.get_xdata(), values[3:])
            assert looks(names[name])[:2] == looks(curve)[:2]
        (line,) = (line for line in ax.lines if looks(line)[:2] == looks(names["tolerance"])[:2])
        np.testing.assert_allclose(line.get_xdata(), tolerance)


# Pretension


@pytest.fixture(scope="module")
def stretched() -> pretension.Pretension:
    robot = cdpr.load_robot("ipanema-1")

    def some(values: np.ndarray, largest: np.ndarray) -> pretension.Series:
        """Largest tensions as given."""
        both = []
        for rows in (len(values), len(values[::2])):
            found = made_up(robot, np.tile(robot.home, (rows, 1)))
            pulls = found.tensions * (largest[:rows] / found.tensions.max(-1))[:, None]
            stiffness = np.sort(RANDOM.uniform(1e4, 5e5, (rows, 6)))
            both.append(dataclasses.replace(found, tensions=pulls, stiffness=stiffness))
        return pretension.Series(values, 2, *both)

    sizes, errors = np.array([80.0, 150.0, 300.0, 600.0]), np.linspace(-0.01, 0.01, 5)
    largest = np.array([1200.0, 700, 300, 400, 500])
    return pretension.Pretension(
        some(sizes, sizes), {what: some(sizes, sizes) for what in pretension.PUSHES},
        dict(zip(pretension.PUSHES, (110.0, 120.0, 130.0, 140.0, 160.0), strict=True)),
        {cable: some(errors, largest * (1 - cable / 10)) for cable in (pretension.ABOVE, pretension.BELOW)},
        np.sort(RANDOM.uniform(1e3, 2e3, 6)), made_up(robot, robot.home[None], [(0, 4), (0, 5)]),
    )  # fmt: skip


def test_stiffnesses_and_pushes_are_drawn_in_their_units(stretched):
    """kN/m by direction, mm by forces, degrees by torques; MuJoCo's points are MuJoCo's."""
    figure = pretension.draw_pretension(stretched)
    _, stiffness, forces, torques, *_ = figure.axes
    one, drawn = stretched.unloaded, by_gid(stiffness)
    for mode, name in enumerate(pretension.directions(one.static)):
        np.testing.assert_allclose(drawn[f"static {name}"].get_ydata(), one.static.eigenvalues[:, mode] / 1e3)
        np.testing.assert_allclose(drawn[f"mujoco {name}"].get_ydata(), one.settled.eigenvalues[:, mode] / 1e3)
        (said,) = (text for text in stiffness.texts if text.get_text() == name)
        assert same_color(said.get_color(), drawn[f"static {name}"].get_color())
    assert stiffness.get_ylabel() == "stiffness [kN/m]"
    (rigid,) = (text.get_text() for text in stiffness.texts if "rigid" in text.get_text())
    assert rigid.startswith(f"{stretched.rigid[0] / 1e3:.2g} kN/m with rigid lengths")
    EA, pull = stretched.robot.axial_stiffness[0] / 1e3, stretched.robot.force_max[0]
    assert f"EA = {EA:.0f} kN, winches of {pull:.0f} N; platform of 25 kg" in figure.get_supxlabel().replace("\n", " ")
    assert f"up to {one.static.eigenvalues[-1, 0] / stretched.rigid[0]:.0f} times stiffer" in figure.get_suptitle()
    for ax, moved, words in (
        (forces, lambda found: 1e3 * np.linalg.norm(found.deviation, axis=1), "displacement under 100 N [mm]"),
        (torques, lambda found: np.degrees(found.tilt), "rotation under 2 N m [°]"),  # made up: about y alone
    ):
        assert ax.get_ylabel() == words
        names, drawn = legend(ax), by_gid(ax)
        for what in [what for what in stretched.pushes if what.startswith("turned") == (ax is torques)]:
            push, limit, taut = stretched.pushes[what], stretched.taut[what], drawn[f"static {what}"]
            slack, values = one.values <= limit, moved(push.static)
            np.testing.assert_allclose(taut.get_xdata(), [limit, *one.values[~slack]])
            np.testing.assert_allclose(taut.get_ydata()[1:], values[~slack])
            dotted = drawn[f"slack {what}"]
            np.testing.assert_allclose(dotted.get_xdata(), [*one.values[slack], limit])
            np.testing.assert_allclose(dotted.get_ydata()[:-1], values[slack])
            assert dotted.get_linestyle() != taut.get_linestyle() == "-"
            np.testing.assert_allclose(drawn[f"mujoco {what}"].get_ydata(), moved(push.settled))
            entry = names.pop(f"{what}: taut from {limit:.0f} N")
            assert looks(entry)[0] == looks(taut)[0]
            assert looks(entry)[2] == looks(drawn[f"mujoco {what}"])[2]
        assert list(names) == ["dotted: cables slack"]


def test_a_wrong_length_is_told_of_the_right_cable(stretched):
    """Where the platform is, in mm, and how hard the tightest cable pulls, in N, by each method; too short is left."""
    figure = pretension.draw_pretension(stretched)
    misses, overload = figure.axes[4:6]
    names = legend(misses)
    assert list(names) == ["upper cable", "lower cable"]
    for (cable, wrong), entry in zip(stretched.wrong.items(), names.values(), strict=True):
        both = (wrong.static, wrong.settled)
        for ax, (static, settled) in (
            (misses, [1e3 * np.linalg.norm(one.deviation, axis=1) for one in both]),
            (overload, [one.tensions.max(1) for one in both]),
        ):
            line = by_gid(ax)[f"static {cable}"]
            assert same_color(line.get_color(), entry.get_color())
            np.testing.assert_allclose(line.get_xydata(), np.transpose([1e3 * wrong.values, static]))
            points = [
                one for one in ax.lines if one.get_mfc() == "white" and same_color(one.get_mec(), line.get_color())
            ]
            hollow = next(one for one in points if len(one.get_xdata()) == 3)
            np.testing.assert_allclose(hollow.get_xydata(), np.transpose([1e3 * wrong.settled_values, settled]))
    assert misses.get_ylabel() == "displacement of the platform [mm]"
    assert overload.get_ylabel() == "largest tension [N]"
    limit = float(stretched.robot.force_max[0])
    short = np.interp(limit, [300, 700, 1200], [0, 5, 10])  # mm
    said = [text.get_text() for text in overload.texts]
    assert said == [f"the winches' {limit:g} N", f"{short:.0f} mm too short"]
    length = 1e3 * stretched.robot.rest_lengths(stretched.robot.home)[0]
    assert f"one length {100 * short / length:.1f} % too short overloads it" in figure.get_suptitle().replace("\n", " ")


# Compensation


def test_before_and_after_compensation_are_drawn_as_they_are():
    """By either method, in mm and degrees, each under its name."""
    robot, poses = cdpr.load_robot("cogiro"), [(0.3, 0.25, 0.1), (0.4, 0.25, 0.1)]
    compensations = [cdpr.compensate(robot, pose) for pose in poses]
    kinds = ("before", "after", "settled_before", "settled_after")
    away = {kind: RANDOM.uniform(1e-3, 1e-2, 2) for kind in kinds}
    turned = {kind: RANDOM.uniform(0.01, 0.1, 2) for kind in kinds}

    def equilibria(kind: str) -> list[cdpr.Equilibrium]:
        moved = [
            Pose(np.array(pose) - np.array([0, 0, far]), Rotation.from_euler("y", turn).as_matrix())
            for pose, far, turn in zip(poses, away[kind], turned[kind], strict=True)
        ]
        return [dataclasses.replace(one.equilibrium, pose=at) for one, at in zip(compensations, moved, strict=True)]

    line = compensated_line.CompensatedLine("title", *(equilibria(kind) for kind in kinds), compensations)
    figure = compensation_figures.draw_compensation([line])
    words = {
        "rigid lengths": "before",
        "… in MuJoCo": "settled_before",
        "compensated lengths": "after",
        "… in MuJoCo ": "settled_after",
    }
    for ax, label, numbers, unit in zip(
        figure.axes,
        ("position error [mm]", "rotation error [°]"),
        (away, turned),
        (1e3, 180 / np.pi),
        strict=True,
    ):
        assert ax.get_ylabel() == label
        drawn = {str(one.get_label()): one for one in ax.lines}
        for word, kind in words.items():
            np.testing.assert_allclose(drawn[word].get_xdata(), [300, 400])
            np.testing.assert_allclose(drawn[word].get_ydata(), unit * numbers[kind])
            assert looks(legend(figure)[word]) == looks(drawn[word])
    assert figure.axes[-1].get_xlabel() == "commanded x [mm]"
    powers = [int(np.ceil(np.log10(most))) for most in (1e3 * away[kinds[3]].max(), np.degrees(turned[kinds[3]].max()))]
    said = [ax.texts[0].get_text() for ax in figure.axes]
    assert said == [
        f"compensated: at most $10^{{{power}}}${unit}" for power, unit in zip(powers, (" mm", "°"), strict=True)
    ]


# Real cables


def test_what_real_cables_do_is_drawn_in_its_row_and_under_its_name():
    """Medians and 95 % of each property in its row, in the robot's colour; growth with the radius, by either method."""
    robots = ["DemoBot, crossed (cogiro)", "DemoBot, parallel", "crane of 15 m"]
    effects = tuple(
        real_cables.CableEffect(robot, what, RANDOM.uniform(1e-3, 9e-3, 21), RANDOM.uniform(0, 1, 21), 1e-9, 0)
        for robot in robots
        for what in real_cables.ROWS
    )
    ax = Figure().add_subplot()
    real_cables._effects(ax, effects)
    rows = {label.get_text(): at for label, at in zip(ax.get_yticklabels(), ax.get_yticks(), strict=True)}
    called = {name: name for name in ("elasticity", "mass of the cables", "nonlinear elasticity")}
    names, drawn = legend(ax), by_gid(ax)
    assert list(names) == robots
    for one in effects:
        ordered = 1e3 * np.sort(one.shifts)  # of 21, the eleventh and the twentieth
        point, reach = drawn[f"median {one.robot} {one.what}"], drawn[f"range {one.robot} {one.what}"]
        np.testing.assert_allclose(point.get_xdata(), [ordered[10]])
        np.testing.assert_allclose(reach.get_xdata(), [ordered[10], ordered[19]])
        assert looks(point)[2] == looks(names[one.robot])[2]
        assert looks(reach)[0] == looks(names[one.robot])[0]
        if one.what in called:
            assert abs(point.get_ydata()[0] - rows[called[one.what]]) < 0.5
    assert ax.get_xlabel() == "displacement of the platform: median, and up to 95 % of poses [mm]"


def test_errors_that_grow_with_the_pulleys_are_drawn_as_each_method_has_them():
    """From below and from above, over radii in mm, with so many mm per mm; the crane in words."""
    radii = np.array([0.0, 0.01, 0.02])
    growths = tuple(
        real_cables.Growth(title, axis, radii, np.outer(radii, RANDOM.uniform(0.5, 1.0, 5)), radii[::2],
                           np.outer(radii[::2], RANDOM.uniform(0.5, 1.0, 5)))
        for title, axis in (("DemoBot, parallel", real_cables.BELOW), ("DemoBot, parallel", real_cables.ABOVE),
                            ("crane of 15 m", real_cables.BELOW))
    )  # fmt: skip
    ax = Figure().add_subplot()
    real_cables._growth(ax, growths)
    names = legend(ax)
    rates = [np.median(one.shifts[1]) / 0.01 for one in growths]
    for one, rate, arriving in zip(growths[:2], rates, ("from below", "from above"), strict=False):
        static, settled = (by_gid(ax)[f"{method} DemoBot, parallel {arriving}"] for method in ("static", "mujoco"))
        np.testing.assert_allclose(
            static.get_xydata(), np.transpose([[0, 10, 20], 1e3 * np.median(one.shifts, axis=1)])
        )
        np.testing.assert_allclose(settled.get_xydata(), np.transpose([[0, 20], 1e3 * np.median(one.settled, axis=1)]))
        assert looks(names.pop(f"parallel, {arriving}: {rate:.2f} mm per mm"))[:2] == looks(static)[:2]
    assert next(iter(names)) == f"not drawn: crane, from below: {rates[2]:.2f} mm per mm"
    assert (ax.get_xlabel(), ax.get_ylabel()) == ("radius of the pulleys [mm]", "position error [mm]")
    assert (real_cables.BELOW[2], real_cables.ABOVE[2]) == (1, -1)  # the way a cable goes that arrives from there


def test_the_robots_that_real_cables_move_are_drawn_as_they_hang(monkeypatch):
    """A platform 5 mm beside where its winches believe it to be; ropes that sag by 3 to 10 mm, each by its own."""
    robot = cdpr.load_robot("cogiro").replace(pulley_radius=0.02, pulley_axis=(0, 0, 1))
    equilibria = made_up(robot, [(0.3, 0.25, 0.1)])
    equilibria = dataclasses.replace(equilibria, positions=np.array([[0.303, 0.25, 0.096]]))
    ax = Figure().add_subplot()
    real_cables._pulleys(ax, equilibria)
    assert ax.get_title() == "DemoBot with 20 mm pulleys unknown to its winches: error of 5 mm"
    names = legend(ax)
    believed = [line for line in ax.lines if looks(line) == looks(names["commanded, with point exits"])]
    for line, exit_, anchor in zip(believed, robot.exits, np.array([0.3, 0.25, 0.1]) + robot.anchors, strict=True):
        np.testing.assert_allclose(line.get_xydata(), [exit_[[0, 2]], anchor[[0, 2]]])
    heavy = robot.replace(pulley_radius=0.0, linear_density=0.01)
    equilibria = made_up(heavy, [(0.3, 0.25, 0.1)], [(0, 7)])
    sags = np.linspace(0.003, 0.010, 8)
    anchors = equilibria.positions[0] + heavy.anchors @ equilibria.rotations[0].T
    middles = (heavy.exits + anchors) / 2 - sags[:, None] * np.array([0, 0, 1])
    ax = Figure().add_subplot()
    profiles = np.stack([heavy.exits, middles, anchors], axis=1)[None]
    monkeypatch.setattr(real_cables, "cable_profiles", lambda _: profiles)
    real_cables._ropes_with_mass(ax, equilibria)
    assert ax.get_title() == "The crane on steel ropes, with a sag of 3 to 10 mm"
    (inset,) = ax.child_axes
    assert inset.get_title() == "sag [mm], from exit to anchor"
    for line, sag in zip(inset.lines, sags, strict=True):
        np.testing.assert_allclose(line.get_ydata(), [0, -1e3 * sag, 0], atol=1e-12)
    slack = [same_color(line.get_color(), legend(ax)["slack rope"].get_color()) for line in inset.lines]
    assert slack == [False] * 7 + [True]


# Control


def test_runs_of_controllers_are_drawn_under_their_names():
    """Speed by colour, path by marker, cable by filling; errors in mm and degrees, tensions from lowest to highest."""
    robot = cdpr.load_robot("cogiro")
    tasks = [
        controller_comparison.TrackingTask(layout, material, path, speed)
        for layout in ("cogiro", "parallel")
        for material, path, speed in (("vectran-0.7mm", "line", 0.05), ("fishing-0.4mm", "circle", 0.5))
    ]
    runs = []
    for task in tasks:
        equilibria = made_up(robot, np.tile(robot.home, (4, 1)))
        trajectory = cdpr.Trajectory.through(equilibria, controller_comparison.PAUSE + np.arange(4.0))
        runs.append(controller_comparison.Run(task, controller_comparison.TENSIONS, trajectory, False))
    figure = controller_comparison_figures.controllers(runs)
    key, *panels = figure.axes
    names, grid = legend(key), np.reshape(panels, (2, 3))
    assert [ax.get_xlabel() for ax in grid[1]] == ["position error [mm]", "tilt error [°]", "tension [N]"]
    titles = [ax.get_title(loc="left") or ax.get_title() for ax in grid[:, 0]]
    assert titles == ["crossed cables (cogiro): position", "parallel cables: position"]
    ticks = dict(zip([tick.get_text() for tick in grid[1, 2].get_xticklabels()], grid[1, 2].get_xticks(), strict=True))
    assert ticks.pop("slack") < 0.1
    assert {float(word): at for word, at in ticks.items()} == {at: at for at in (0.1, 1.0, 10.0)}
    for row, layout in zip(grid, ("cogiro", "parallel"), strict=True):
        own = [run for run in runs if run.task.layout == layout]
        height = [label.get_text() for label in grid[0, 0].get_yticklabels()].index("tensions\n(force control)")
        points = [
            [line for line in ax.lines if line.get_gid() == f"rms {controller_comparison.TENSIONS}"] for ax in row[:2]
        ]
        ranges = [line for line in row[2].lines if line.get_gid() == f"tensions {controller_comparison.TENSIONS}"]
        for run, shift, turn, pull in zip(own, *points, ranges, strict=True):
            equilibria = run.trajectory
            away = 1e3 * np.linalg.norm(equilibria.positions - equilibria.problems.positions, axis=1)
            tilts = np.degrees(np.arccos(equilibria.rotations[:, 2, 2]))
            for point, values in ((shift, away), (turn, tilts)):
                np.testing.assert_allclose(point.get_xdata(), [np.sqrt(np.mean(values**2))])
                assert abs(point.get_ydata()[0] - height) < 0.5
            np.testing.assert_allclose(pull.get_xdata(), [equilibria.tensions.min(), equilibria.tensions.max()])
            slow, line = run.task.speed == 0.05, run.task.path == "line"
            speed = names["up to 0.05 m/s" if slow else "up to 0.5 m/s"]
            assert looks(shift)[0] == looks(turn)[0] == looks(pull)[0] == looks(speed)[0]
            assert looks(shift)[2] == looks(names["line" if line else "circle"])[2]
            hollow = [str(artist.get_mfc()) == "white" for artist in (shift, names[run.task.material])]
            assert hollow == [run.task.material == "fishing-0.4mm"] * 2


# Layouts


@pytest.fixture(scope="module")
def proof() -> LayoutValidation:
    """A search that has hardly begun; both robots with rests that are made up."""
    found = cdpr.find_layout(
        cdpr.load_robot("parallel"), [(0.3, 0.25, 0.1), (0.5, 0.25, 0.1)], move=[cdpr.Move("exits", 0.01)],
        objective="worst deviation", generations=1,
    )  # fmt: skip
    true = cdpr.validate_layout(found)
    sides = []
    for side, slack, agree in ((true.before, [(0, 0), (0, 1), (1, 0)], 1), (true.after, [(2, 3)], 2)):
        settled = made_up(side.robot, side.settled.problems.positions, slack)
        agrees = np.arange(len(side.agrees)) < agree
        sides.append(dataclasses.replace(side, settled=settled, agrees=agrees, score=agree * 0.0123))
    return dataclasses.replace(true, before=sides[0], after=sides[1])


def test_a_layouts_numbers_are_mujocos_before_and_after(proof):
    """Degrees, millimetres, newtons; the worst before the mean, the lowest before the highest."""
    rows = {what: words for what, *words in better_layouts.numbers(proof)}
    move = np.linalg.norm(proof.layout.robot.exits - proof.layout.given.exits, axis=1).max()
    expected = {
        "worst deviation, in MuJoCo": ["12.3 mm", "24.6 mm"],
        "most slack cables": ["2", "1"],
        "Newton and MuJoCo agree at": ["1 of 3", "2 of 3"],
        "largest displacement of a point": ["", f"{1e3 * move:.3g} mm"],
        "worst, mean tilt": [],
        "worst, mean deviation": [],
        "lowest, highest tension": [],
    }
    for equilibria in (proof.before.settled, proof.after.settled):
        tilts = np.degrees(np.arccos(equilibria.rotations[:, 2, 2]))
        away = 1e3 * np.linalg.norm(equilibria.positions - equilibria.problems.positions, axis=1)
        expected["worst, mean tilt"].append(f"{tilts.max():.3g}°, {tilts.mean():.3g}°")
        expected["worst, mean deviation"].append(f"{away.max():.3g} mm, {away.mean():.3g} mm")
        expected["lowest, highest tension"].append(f"0 N, {equilibria.tensions.max():.3g} N")
    assert rows == expected


def test_a_front_is_drawn_in_its_goals_units(proof):
    """Tilt in degrees to the right, deviation in millimetres up; the given robot where it stands."""
    found = proof.layout
    goals = tuple(dataclasses.replace(found.objective, name=name, unit=unit, size=size)
                  for name, unit, size in (("tilt", "°", np.pi / 180), ("deviation", "mm", 1e-3)))  # fmt: skip
    scores = np.array([[0.1, 0.02], [0.2, 0.01]])
    front = cdpr.Front(found.given, goals, np.array([0.3, 0.03]), scores, found.equilibria.layouts, found.cases, 99)
    (ax,) = better_layouts.pareto_picture(front).axes
    drawn = {str(line.get_label()): line.get_xydata() for line in ax.lines}
    np.testing.assert_allclose(drawn["NSGA-II, 99 layouts"], np.transpose([np.degrees([0.1, 0.2]), [20, 10]]))
    np.testing.assert_allclose(drawn["as given"], [[np.degrees(0.3), 30]])
    assert (ax.get_xlabel(), ax.get_ylabel()) == ("tilt [°]", "deviation [mm]")


def test_a_clearance_map_is_of_the_poses_that_it_names(monkeypatch):
    """Each cell is the smallest distance there in mm; a share of those beyond what is enough is free."""
    monkeypatch.setattr(better_layouts, "CLEARANCE_POINTS", 3)
    robot = cdpr.load_robot("cogiro")
    figure = better_layouts.clearance_map(robot, "xz", 0.2, 0.005, None)
    ax = figure.axes[0]
    shown = np.asarray(ax.images[0].get_array())
    x0, x1, z0, z1 = ax.images[0].get_extent()
    rows, columns = shown.shape
    poses = [
        (x0 + (i + 0.5) * (x1 - x0) / columns, 0.2, z0 + (j + 0.5) * (z1 - z0) / rows)
        for j in range(rows)
        for i in range(columns)
    ]
    least = cdpr.clearances(robot, poses).least
    np.testing.assert_allclose(shown.ravel(), 1e3 * least, rtol=1e-6)
    assert (ax.get_xlabel(), ax.get_ylabel()) == ("commanded x [m]", "commanded z [m]")
    assert f"at {(least > 0.005).mean():.0%} of these poses" in figure.get_suptitle().replace("\n", " ")
    assert 0 < (least > 0.005).mean() < 1
    said = figure.get_supxlabel().replace("\n", " ")
    assert "y = 0.2 m" in said
    assert f" {1e3 * least.min():.3g} mm" in said

"""Figures contain the data they claim, and say what they show."""

import dataclasses
import functools
import re

import matplotlib
import numpy as np
import pytest
from matplotlib.colors import same_color
from matplotlib.figure import Figure
from matplotlib.text import Text

import cdpr_sim as cdpr
from cdpr_sim.analysis.workspace.feasibility import feasible_by_linprog
from cdpr_sim.drawing import axes, cable_curves, style
from cdpr_sim.studies import gallery
from cdpr_sim.studies import lines as studies
from cdpr_sim.studies import lines_figures as figures
from cdpr_sim.studies import pretension as pretension_studies
from cdpr_sim.studies import real_cables as real_cables_studies
from cdpr_sim.studies import solvers as solver_studies
from cdpr_sim.studies import tilt_condition as balance
from cdpr_sim.studies import two_cable as two_cable_studies
from studies.compensated_line import CompensatedLine
from studies.compensation_figures import draw_compensation

ON_LINE = 1e-7
"""A point's distance from a line, as a fraction of the line's range: 1.5e-9 measured, since each settled row has a
static row of the same command; a point of the other material is 4e-2 off, and a marker 1e-2 wide."""

LENGTH = 0.02
"""Of a hanging cable's drawn length, relative: the parabola's length to second order, for slack up to a tenth."""


@functools.cache
def two_cable_bar() -> two_cable_studies.TwoCableBar:
    return two_cable_studies.two_cable_bar(static_rows=33, settled_rows=5)


def across_the_width(name: str) -> studies.Width:
    """With fewer heights of the outline, that of the tensions among them."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(studies, "feasible_outline", functools.partial(studies.feasible_outline, rows=15))
        return studies.across_the_width(cdpr.load_robot(name), static_rows=151, settled_rows=7)


COMPUTED = {
    "two-cable-manifold": lambda: two_cable_studies.manifold(drifts=5, settled_every=2),
    "two-cable-poses": two_cable_bar,
    "two-cable-closed-form": two_cable_bar,
    "layouts": studies.homes,
    "tilt-condition": balance.moment_balances,
    "paper-line": lambda: studies.paper_lines(static_rows=151, settled_rows=4),
    "convergence": lambda: solver_studies.convergence(axial_stiffness=[1e2, 1e4], poses=1),
    "agreement": lambda: solver_studies.differences(["parallel", "two-cable"], poses=6),
    "real-cables": lambda: real_cables_studies.real_cables(poses=1),
    "fully-constrained": lambda: pretension_studies.pretension(points=21, every=10, errors=11),
} | {
    name: functools.partial(across_the_width, name)
    for name in ("planar-vertical", "planar-horizontal", "cogiro", "parallel")
}


class Results(dict):
    """Small results for every picture, by its name, each computed when it is first asked for."""

    def __missing__(self, name: str):
        self[name] = COMPUTED[name]()
        return self[name]


@pytest.fixture(scope="module")
def results() -> Results:
    return Results()


@pytest.fixture(scope="module", params=gallery.PICTURES)
def drawn(request, results) -> Figure:
    """Every figure, laid out as it is when it is written."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(two_cable_studies, "SURFACE", (25, 19))  # for each point of which a quartic is solved
        figure = gallery.PICTURES[request.param].draw(results[request.param])
    figure.draw_without_rendering()
    return figure


def artist(figure: Figure, gid: str, panel: int = 0):
    """The artist with that id in the ``panel``-th of the axes that have one."""
    found = [a for ax in figure.axes for a in ax.get_children() if a.get_gid() == gid]
    return found[panel]


def distance_from_line(points, line) -> float:
    """Of the farthest point from a line over x, as a fraction of the line's range."""
    x, y = line.get_data()
    order = np.argsort(x)
    apart = points.get_ydata() - np.interp(points.get_xdata(), x[order], y[order])
    return float(np.abs(apart).max() / np.ptp(y))


def test_every_picture_has_a_title_labels_with_units_and_a_legend(drawn):
    """A stranger can read it: what it shows, of what, in which units; and which series is which."""
    assert len(drawn.get_suptitle()) > 20
    assert len(drawn.get_supxlabel()) > 20
    for ax in drawn.axes:
        names = [ax.get_ylabel()] if ax.get_label() == "<colorbar>" else [ax.get_xlabel(), ax.get_ylabel()]
        if hasattr(ax, "get_zlabel"):
            names.append(ax.get_zlabel())
        shared_x = not ax.xaxis.get_tick_params().get("labelbottom", True)
        shared_y = not ax.yaxis.get_tick_params().get("labelleft", True)
        rows_named = all(re.search("[a-z]{3}", label.get_text()) for label in ax.get_yticklabels())
        for name, needless in zip(names, (shared_x, shared_y or rows_named, False), strict=False):
            assert re.search(r"\[(m|mm|°|N|kN/m|ms|%)\]$", name) or (needless and not name), (ax, names)
    assert drawn.legends or any(ax.get_legend() for ax in drawn.axes)


def test_no_word_runs_out_of_the_picture(drawn):
    """Titles and captions are wrapped to the figure's width."""
    box = drawn.bbox
    words = drawn.findobj(Text)
    ticks = {id(label) for ax in drawn.axes for axis in ax._axis_map.values() for label in axis.findobj(Text)}
    ticks -= {id(label) for ax in drawn.axes for label in (ax.xaxis.label, ax.yaxis.label)}  # those beyond the limits
    for text in words:
        if text.get_text() and id(text) not in ticks:
            extent = text.get_window_extent()
            assert extent.x0 >= box.x0 - 1, text
            assert extent.x1 <= box.x1 + 1, text
            assert extent.y0 >= box.y0 - 1, text
            assert extent.y1 <= box.y1 + 1, text


def test_a_file_depends_on_the_results_alone(results):
    """No dates, no random ids; a user's style does not get in, and the house's style is not left behind."""
    width = results["planar-vertical"]
    pose = cdpr.solve_many(width.poses.robot, width.poses.problems.positions[:1])
    few = dataclasses.replace(width, poses=pose, lines=width.lines[:1])
    before = dict(matplotlib.rcParams)
    once = gallery.encoded(figures.planar(few), "svg")
    assert dict(matplotlib.rcParams) == before
    with matplotlib.rc_context({"font.size": 30, "lines.linewidth": 9, "axes.facecolor": "black"}):
        assert gallery.encoded(figures.planar(few), "svg") == once
    others = dataclasses.replace(few, lines=width.lines[1:])
    assert gallery.encoded(figures.planar(others), "svg") != once


@pytest.mark.parametrize("name", ["planar-vertical", "planar-horizontal", "cogiro", "parallel"])
def test_tensions_are_the_results(name, results):
    """Fig. 7, 8, 10, 11: every cable's line and points, for both materials."""
    figure = gallery.PICTURES[name].draw(results[name])
    paper = {"planar-vertical": "Fig. 7", "planar-horizontal": "Fig. 8", "cogiro": "Fig. 10", "parallel": "Fig. 11"}
    assert gallery.PICTURES[name].paper == paper[name]
    assert figure.get_supxlabel().replace("\n", " ").endswith(f"(Paper, {paper[name]})")
    for panel, line in enumerate(results[name].lines):
        for group in studies.twins(line.static):
            drawn_line = artist(figure, f"static {group[0]}", panel)
            assert np.array_equal(drawn_line.get_xdata(), line.static.problems.positions[:, 0])
            assert np.array_equal(drawn_line.get_ydata(), line.static.tensions[:, group[0]])
            for cable in group:
                points = artist(figure, f"mujoco {cable}", panel)
                assert np.array_equal(points.get_ydata(), line.settled.tensions[:, cable])
                assert distance_from_line(points, drawn_line) < ON_LINE


def test_titles_say_how_far_it_tilts_and_how_many_cables_go_slack(results):
    """In the words of the results, and not of the paper."""
    titles = {
        name: gallery.PICTURES[name].draw(results[name]).get_suptitle() for name in ("planar-horizontal", "cogiro")
    }
    assert titles["planar-horizontal"] == "planar-horizontal: no tilt, and no cable slack"
    tilt = np.degrees(max(line.static.tilt.max() for line in results["cogiro"].lines))
    poses = np.degrees(results["cogiro"].poses.tilt.max())
    assert f"up to {max(tilt, poses):.2g}° of tilt" in titles["cogiro"]


def test_points_of_a_wrong_data_set_are_off_the_line(results):
    """Negative control: MuJoCo's points of one material do not lie on the other's line."""
    width = results["planar-vertical"]
    soft, stiff = width.lines
    swapped = dataclasses.replace(width, lines=(dataclasses.replace(soft, settled=stiff.settled), stiff))
    figure = figures.planar(swapped)
    assert distance_from_line(artist(figure, "mujoco 0"), artist(figure, "static 0")) > 1e5 * ON_LINE


@pytest.mark.parametrize("name", ["planar-vertical", "parallel"])
def test_zones_are_shaded_where_cables_are_slack(name, results):
    """Each zone of the results, and no other; another zone for one pair than for two."""
    figure = gallery.PICTURES[name].draw(results[name])
    axes = [ax for ax in figure.axes if ax.get_ylabel() == "tension [N]"]
    for ax, line in zip(axes, results[name].lines, strict=True):
        shaded = [p for p in ax.patches if str(p.get_gid()).startswith("zone-")]
        found = {(p.get_x(), round(p.get_x() + p.get_width(), 12), p.get_gid()) for p in shaded}
        assert found == {(a, round(b, 12), f"zone-{n}-slack") for a, b, n in studies.zones(line.static) if n}
        assert len({p.get_facecolor() for p in shaded}) == 2


def test_slack_cables_are_drawn_as_slack(results):
    """One dotted, coloured curve for each slack cable of each drawn pose, a plain line for each taut one."""
    width = results["planar-vertical"]
    figure = figures.planar(width)
    lines = [line for ax in figure.axes if ax.get_ylabel() == "z [m]" for line in ax.lines]
    dotted = [line for line in lines if same_color(line.get_color(), style.SLACK_CABLE)]
    straight = [line for line in lines if same_color(line.get_color(), style.INK) and line.get_marker() == "None"]
    assert len(dotted) == width.poses.slack.sum() > 0
    assert len(straight) == (~width.poses.slack).sum()
    assert not any(line.get_linestyle() == "-" for line in dotted)


def test_a_slack_cable_hangs_as_long_as_it_is():
    """The drawn curve ends where the cable does and has its rest length; a taut one is straight."""
    start, end = np.array([0.0, 0.0, 1.0]), np.array([0.5, 0.0, 0.7])
    straight = float(np.linalg.norm(end - start))
    for rest in (straight, 1.02 * straight, 1.1 * straight):
        curve = cable_curves.sagging_curve(start, end, rest, points=201)
        assert curve[[0, -1]] == pytest.approx(np.array([start, end]))
        assert np.linalg.norm(np.diff(curve, axis=0), axis=1).sum() == pytest.approx(rest, rel=LENGTH)
        below = np.interp(curve[1:-1, 0], [0.0, 0.5], [1.0, 0.7]) - curve[1:-1, 2]
        assert (below > 1e-4).all() if rest > straight else np.abs(below).max() < 1e-12


def test_a_turned_platform_and_its_slack_cables_are_drawn_where_they_are():
    """In the x-z plane, 30° about y: its right end lower, its top to the right; a slack cable 1.1 times as long."""
    robot = cdpr.Robot(
        exits=[[0, 0, 0.6], [1, 0, 1]], anchors=[[-0.2, 0, 0], [0.2, 0, 0]], axial_stiffness=1e3, mass=1,
        platform_size=(0.4, 0.1, 0.2), mobility="planar",
    )  # fmt: skip
    position, c, s = np.array([0.5, 0, 0.4]), np.sqrt(3) / 2, 0.5
    rotation = np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])
    ax = Figure().add_subplot()
    axes.draw_platform(ax, robot, position, rotation)
    outline = ax.patches[0].get_xy()[:-1]
    corners = [(x, z) for x in (-0.2, 0.2) for z in (-0.1, 0.1)]
    expected = [(0.5 + c * x + s * z, 0.4 - s * x + c * z) for x, z in corners]
    np.testing.assert_allclose(sorted(outline.tolist()), sorted(expected))
    straight = np.hypot(0.5 - 0.2 * c, 0.6 - 0.4 - 0.2 * s)  # from (0, 0.6) to the left end, which is higher
    axes.draw_cables(ax, robot, position, rotation, [True, False], [1.1 * straight, 1.0])
    slack, taut = (line.get_xydata() for line in ax.lines)
    assert np.linalg.norm(np.diff(slack, axis=0), axis=1).sum() == pytest.approx(1.1 * straight, rel=LENGTH)
    assert slack[[0, -1]] == pytest.approx(np.array([[0, 0.6], [0.5 - 0.2 * c, 0.4 + 0.2 * s]]))
    assert taut == pytest.approx(np.array([[1, 1], [0.5 + 0.2 * c, 0.4 - 0.2 * s]]))


def test_a_pose_in_space_is_drawn_where_it_is(monkeypatch):
    """The platform's box where it rests, as large as it is, and the outline where it was commanded, level."""
    drawn: dict[str, np.ndarray] = {}
    for kind in ("Poly3DCollection", "Line3DCollection"):
        make = getattr(axes, kind)
        monkeypatch.setattr(axes, kind, lambda at, *a, k=kind, m=make, **b: m(drawn.setdefault(k, at), *a, **b))
    robot, row = cdpr.load_robot("parallel").replace(material="fishing-0.4mm"), 1
    equilibria = cdpr.solve_many(robot, [(0.4, 0.25, 0.2), (0.2, 0.25, 0.1)])
    ax = Figure().add_subplot(projection="3d")
    axes.draw_frame(ax, robot, exits=False)
    assert (ax.get_xlabel(), ax.get_ylabel(), ax.get_zlabel()) == ("x [m]", "y [m]", "z [m]")
    np.testing.assert_allclose([ax.get_xlim(), ax.get_ylim(), ax.get_zlim()], robot.frame.T)
    drawn.clear()
    axes.draw_pose(ax, equilibria, row)
    half = robot.platform_size / 2
    signs = np.array([(a, b, c) for a in (-1, 1) for b in (-1, 1) for c in (-1, 1)])
    expected = {
        "Line3DCollection": equilibria.problems.positions[row] + half * signs,
        "Poly3DCollection": np.array(
            [equilibria.positions[row] + equilibria.rotations[row] @ (half * one) for one in signs]
        ),
    }
    for kind, corners in expected.items():
        found = np.unique(np.round(np.concatenate(drawn[kind]), 9), axis=0)
        np.testing.assert_allclose(found, np.unique(np.round(corners, 9), axis=0), atol=1e-9)
    for cable, line in enumerate(ax.lines):
        curve = np.array(line.get_data_3d()).T
        anchor = equilibria.positions[row] + equilibria.rotations[row] @ robot.anchors[cable]
        np.testing.assert_allclose(curve[[0, -1]], [robot.exits[cable], anchor], atol=1e-12)
        slack = bool(equilibria.slack[row, cable])
        assert (len(curve) > 2, same_color(line.get_color(), style.SLACK_CABLE)) == (slack, slack)


def test_the_papers_line_is_drawn_from_both_methods(results):
    """Fig. 12: eight lines of each quantity, MuJoCo's points on them, and the paper's values where its text says."""
    lines = results["paper-line"]
    figure = figures.paper_line(lines)
    heights = sorted({line.height for line in lines})
    for line in lines:
        column, label = heights.index(line.height), f"{line.robot.name}, {line.robot.material}"
        for row, values in enumerate((1e3 * line.static.deviation[:, 2], np.degrees(line.static.euler[:, 1]))):
            ax = figure.axes[row * len(heights) + column]
            drawn_line, points = (
                next(a for a in ax.lines if a.get_gid() == f"{method} {label}") for method in ("static", "mujoco")
            )
            assert np.array_equal(drawn_line.get_xdata(), line.static.positions[:, 0])
            assert np.array_equal(drawn_line.get_ydata(), values)
            assert distance_from_line(points, drawn_line) < ON_LINE
    parallel = [line.static for line in lines if line.robot.name == "parallel"]
    tilt = np.degrees(max(np.abs(equilibria.euler[:, 1]).max() for equilibria in parallel))
    sag = 1e3 * max((-equilibria.deviation[:, 2]).max() for equilibria in parallel)
    assert f"parallel tilts {tilt:.2g}° and deviates {sag:.2g} mm downwards" in figure.get_suptitle()
    reported = [sorted({float(a.get_ydata()[0]) for a in ax.lines if a.get_gid() == "paper"}) for ax in figure.axes]
    assert reported[:2] == [[-1e3 * studies.PAPER_DEVIATION]] * 2 == [[-15.0]] * 2
    assert reported[2:] == [pytest.approx([-20.0, 20.0])] * 2


def test_tilt_condition_marks_where_the_forces_meet(results):
    """Fig. 9: one meeting point per case, at its place, and the moment in words."""
    cases = results["tilt-condition"]
    figure = balance.draw_moment_balances(cases)
    for ax, case in zip(figure.axes, cases, strict=True):
        point = next(a for a in ax.lines if a.get_gid() == "meeting point")
        assert point.get_xydata()[0] == pytest.approx(case.intersection[[0, 2]])
        assert ("no moment" in ax.get_title(loc="left")) == (abs(case.moment) < 1e-6)


def test_static_feasible_workspace_is_drawn_where_linear_programming_finds_it(results):
    """Fig. 11: outline in space, extent above the tensions; HiGHS holds poses just inside and none just outside."""
    width = results["parallel"]
    figure = figures.spatial(width)
    drawn = [line for ax in figure.axes for line in ax.lines if line.get_gid() == "feasible"]
    assert len(drawn) == 1 + len(width.lines)
    first, last = drawn[1].get_xdata()
    step = 2e-3  # two columns of the outline's grid
    robot = width.poses.robot
    assert all(feasible_by_linprog(robot, [x, 0.25, 0.1]) for x in (first + step, last - step))
    assert not any(feasible_by_linprog(robot, [x, 0.25, 0.1]) for x in (first - step, last + step))


def test_agreement_is_named_as_judged(results):
    """Where the methods disagree the title says so."""
    measured = results["agreement"]
    assert "agree at all 24 poses" in solver_studies.draw_agreement(measured).get_suptitle()
    disagree, free, agree = cdpr.Verdict.DISAGREE, cdpr.Verdict.AGREE_EXCEPT_NEUTRAL, cdpr.Verdict.AGREE
    for verdicts, title in (
        ([disagree] * 12, "agree at 12 of 24 poses; at 12 they disagree"),
        ([free] * 4 + [agree] * 8, "agree at 20 of 24 poses; 4 are neutrally stable"),
        ([free] * 4 + [disagree, *[agree] * 7], "agree at 19 of 24 poses; 4 are neutrally stable; at 1 they disagree"),
    ):
        pairs = zip(measured["parallel"], verdicts, strict=True)
        others = measured | {"parallel": [dataclasses.replace(one, verdict=verdict) for one, verdict in pairs]}
        assert title in solver_studies.draw_agreement(others).get_suptitle().replace("\n", " ")


def test_where_no_lengths_hold_the_pose_is_shaded():
    """A column for each robot; on the crossed cables no pose is out of reach, on the parallel ones some are."""
    lines, poses = [], [(x, 0.25, 0.1) for x in (0.2, 0.3, 0.4)]
    for robot in map(cdpr.load_robot, ("cogiro", "parallel")):
        held, at_rest = ([ask(robot, pose) for pose in poses] for ask in (cdpr.compensate, cdpr.solve))
        lines.append(CompensatedLine(robot.name, at_rest, at_rest, at_rest, at_rest, held))
    out_of_reach = [sum(not one.exact for one in line.compensations) for line in lines]
    assert out_of_reach[0] == 0 < out_of_reach[1]
    assert [len(ax.patches) for ax in draw_compensation(lines).axes[:2]] == out_of_reach

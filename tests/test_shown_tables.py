"""What a person reads is what was computed: every column with its unit and sign, against numbers worked out by hand.

The results are made up, all of their numbers different, so that no two could be swapped unnoticed.
"""

import dataclasses
import inspect
import io
import math
from unittest.mock import Mock

import numpy as np
import pytest
import xarray as xr
from rich.console import Console
from sample_problems import garage_crane
from scipy.spatial.transform import RigidTransform, Rotation
from scipy.stats import t

import cdpr_sim as cdpr
from cdpr_sim.analysis.compensation import Compensation, CompensationOutcome
from cdpr_sim.analysis.equilibria import Equilibria, LoadPath
from cdpr_sim.analysis.identification import Identification, Outlier
from cdpr_sim.analysis.modes import Modes
from cdpr_sim.analysis.sensitivity import Effect, Sensitivity
from cdpr_sim.core.cable import Cabling
from cdpr_sim.core.equilibrium_batch import EquilibriumBatch
from cdpr_sim.core.problem import Problems
from cdpr_sim.core.status import Status
from cdpr_sim.crosscheck.check import OUTCOMES
from cdpr_sim.crosscheck.compare import Agreement, Verdict
from cdpr_sim.crosscheck.compensation_check import CompensationCheck
from cdpr_sim.crosscheck.layout_validation import LayoutValidation, ValidatedRobot
from cdpr_sim.design.layout_result import Change, LayoutResult
from cdpr_sim.design.objectives import OBJECTIVES
from cdpr_sim.physics.release import Release
from cdpr_sim.report import (
    analysis_tables,
    as_json,
    crosscheck_tables,
    design_tables,
    html_page,
    proof_tables,
    robot_tables,
    workspace_tables,
)
from cdpr_sim.studies.robot_summary import View
from studies.checked_lines import line_table

COMMANDED = (0.4, 0.25, 0.2)

DEGREES = {
    "mujoco": (3.0, 20.0),
    "newton": (4.0, 21.0),
    "seecr/fsolve": (5.0, 22.0),
    "seecr/least_squares": (6.0, 23.0),
}
"""By source, the turns about x and then about y of its made-up result."""


def made_up(
    source: str, tensions=(1.25, 0.0, 2.5, 3.75), eigenvalues=(12.5, 40.0, 90.0), **changes
) -> cdpr.Equilibrium:
    """A result of ``source`` for a planar robot's four cables, 11 mm to the right of and 7 mm below the commanded."""
    turned = Rotation.from_euler("xy", DEGREES[source], degrees=True)
    number = list(DEGREES).index(source)
    problem = cdpr.Problem.of(cdpr.load_robot("cogiro"), COMMANDED)
    place = np.array(COMMANDED) + [0.011, 0.003, -0.007] + np.array([1e-3, 2e-3, -3e-3]) * number
    values = dict(
        problem=problem,
        pose=RigidTransform.from_components(place, turned),
        tensions=np.tile(tensions, 2) + 0.125 * number * (np.tile(tensions, 2) > 0),
        lengths=np.full(8, 0.5),
        residual=1e-9 * 10.0**number,
        eigenvalues=np.array([*eigenvalues, 100.0, 110.0, 120.0]) + number,
        iterations=100 + number,
        source=source,
    )
    return cdpr.Equilibrium(**(values | changes))


def printed(table) -> list[str]:
    """Its lines, on a screen of 200 columns."""
    screen = Console(file=io.StringIO(), width=200)
    screen.print(table)
    return screen.file.getvalue().splitlines()


def columns(table) -> dict[str, list[str]]:
    """Cells by heading, the heading on one line."""
    return {str(c.header).replace("-\n", "").replace("\n", " ").replace("\\", ""): list(c.cells) for c in table.columns}


def cells(lines: list[str], label: str, count: int) -> list[str]:
    """The last ``count`` cells of the printed row that begins with ``label``."""
    (line,) = (line for line in lines if line.strip().startswith(label))
    return line.split()[-count:]


def test_settle_shows_each_result_under_the_name_of_its_own_source():
    """All columns and units; the order in which results are handed in does not matter."""
    results = [made_up(source) for source in DEGREES]
    problem = results[0].problem
    lines = printed(crosscheck_tables.settle_table(problem, results))
    heads = [line for line in lines if "MuJoCo" in line]
    assert heads[0].split()[-4:] == ["MuJoCo", "Newton", "fsolve", "least_sq."]
    assert cells(lines, "x [mm]", 5) == ["400.000", "411.000", "412.000", "413.000", "414.000"]
    assert cells(lines, "y [mm]", 5) == ["250.000", "253.000", "255.000", "257.000", "259.000"]
    assert cells(lines, "z [mm]", 5) == ["200.000", "193.000", "190.000", "187.000", "184.000"]
    assert cells(lines, "deviation -z [mm]", 4) == ["7.000", "10.000", "13.000", "16.000"]  # downwards is positive
    shifts = [math.hypot(11 + n, 3 + 2 * n) for n in range(4)]
    assert cells(lines, "deviation x, y [mm]", 4) == [f"{shift:.3f}" for shift in shifts]
    # Ry(b) Rx(a) takes the vertical to an angle whose cosine is cos a cos b.
    tilts = [math.acos(math.cos(math.radians(a)) * math.cos(math.radians(b))) for a, b in DEGREES.values()]
    assert cells(lines, "tilt [°]", 5) == ["0.000", *(f"{math.degrees(tilt):.3f}" for tilt in tilts)]
    # Rz Ry Rx = Ry(b) Rx(a) has beta = b.
    assert cells(lines, "about y [°]", 5) == ["0.000", "20.000", "21.000", "22.000", "23.000"]
    assert cells(lines, "tension 1 [N]", 4) == ["1.2500", "1.3750", "1.5000", "1.6250"]
    assert cells(lines, "tension 2 [N], slack", 4) == ["0.0000"] * 4
    assert cells(lines, "tension 8 [N]", 4) == ["3.7500", "3.8750", "4.0000", "4.1250"]
    assert cells(lines, "slack cables", 12) == ["2", "of", "8"] * 4
    assert cells(lines, "unbalanced [N]", 4) == ["1.0e-09", "1.0e-08", "1.0e-07", "1.0e-06"]
    assert cells(lines, "iterations", 4) == ["100", "101", "102", "103"]
    swapped = columns(crosscheck_tables.settle_table(problem, results[::-1]))
    assert {name: swapped[name] for name in columns(crosscheck_tables.settle_table(problem, results))} == columns(
        crosscheck_tables.settle_table(problem, results)
    )


def test_what_matters_comes_first_in_five_lines():
    """Verdict, deviation, tilt, slack cables, and the highest tension against the breaking load; before → after."""
    robot = cdpr.load_robot("cogiro").replace(breaking_load=[2.0] * 7 + [100.0])
    problem = cdpr.Problem.of(robot, (*COMMANDED, 0, math.radians(25), 0))
    before, after = made_up("mujoco", problem=problem), made_up("newton", problem=problem)
    after = dataclasses.replace(after, tensions=np.array([1.0, 0, 1, 1, 1, 0, 1.5, 30]))
    said = crosscheck_tables.lead("so it is", problem.pose, before, after).replace("\\", "").splitlines()
    distances = math.hypot(11, 3, 7), math.hypot(12, 5, 10)
    tilts = [
        math.degrees(math.acos(math.cos(math.radians(a)) * math.cos(math.radians(b)))) for a, b in ((3, 20), (4, 21))
    ]
    assert said == [
        "so it is",
        f"deviation        {distances[0]:.3f} → {distances[1]:.3f} mm: x 12.000, y 5.000, z -10.000 mm",
        f"tilt             {tilts[0]:.3f} → {tilts[1]:.3f}°, commanded 25.000°",
        f"slack cables     2 → 2 of 8: {', '.join(str(c + 1) for c in np.flatnonzero(after.slack))}",
        "highest tension  30 N, cable 8, 30 % of its breaking load of 100 N; cable 7 75 % of its breaking load of 2 N",
    ]


def test_a_cable_that_is_slack_in_one_method_alone_is_marked_in_its_column():
    """Its tension is printed as well."""
    slack, taut = made_up("mujoco"), made_up("newton")
    taut = dataclasses.replace(taut, lengths=np.full(8, 2.0), tensions=np.full(8, 1.0))
    lines = printed(crosscheck_tables.settle_table(slack.problem, [slack, taut]))
    assert cells(lines, "tension 2 [N], slack", 3) == ["0.0000", "taut", "1.0000"]
    lines = printed(crosscheck_tables.settle_table(slack.problem, [taut, slack]))
    assert cells(lines, "tension 2 [N]", 3) == ["1.0000", "slack", "0.0000"]


def test_a_commanded_tilt_is_in_degrees():
    """25° about y, commanded: 25° of tilt."""
    problem = cdpr.Problem.of(cdpr.load_robot("cogiro"), (*COMMANDED, 0, math.radians(25), 0))
    lines = printed(crosscheck_tables.settle_table(problem, []))
    assert cells(lines, "tilt [°]", 1) == cells(lines, "about y [°]", 1) == ["25.000"]


def test_json_says_the_same_under_the_same_names():
    """In SI units."""
    results = [made_up(source) for source in DEGREES]
    everything = as_json.crosscheck(results[0].problem, results[::-1], agreement(Verdict.AGREE))
    assert (everything["robot"], everything["mass"], everything["material"]) == ("cogiro", 0.4, "vectran-0.7mm")
    assert everything["axial_stiffness"] == [1e4] * 8
    assert everything["commanded"] == list(COMMANDED)
    differences = [everything[f"{what}_error"] for what in ("position", "rotation", "tension")]
    assert differences == [2e-3, math.radians(3), 4.0]
    assert everything["same_slack"] is True
    told = everything["results"]
    assert sorted(told) == ["fsolve", "least_squares", "mujoco", "newton"]
    for number, name in enumerate(["mujoco", "newton", "fsolve", "least_squares"]):
        one = told[name]
        assert one["position"] == pytest.approx([0.411 + 1e-3 * number, 0.253 + 2e-3 * number, 0.193 - 3e-3 * number])
        assert one["tilt"] == pytest.approx(
            math.acos(math.cos(math.radians(3 + number)) * math.cos(math.radians(20 + number)))
        )
        assert one["euler"][1] == pytest.approx(math.radians(20 + number))
        assert one["tensions"][:2] == [1.25 + 0.125 * number, 0.0]
        assert one["slack"] == [False, True, False, False] * 2
        assert one["residual"] == 1e-9 * 10.0**number
        assert one["eigenvalues"][0] == 12.5 + number
        assert (one["iterations"], one["stability"]) == (100 + number, "stable")


def agreement(verdict: Verdict, **changes) -> Agreement:
    values = dict(
        verdict=verdict, reasons=(), position_error=2e-3, rotation_error=math.radians(3), tension_error=4.0,
        same_slack=True, static_in_mujoco=5.0, settled_in_statics=6.0,
    )  # fmt: skip
    return Agreement(**(values | changes))


def test_the_verdict_gives_its_differences_in_the_units_that_it_names():
    """Two millimetres, three degrees, four newtons."""
    text = crosscheck_tables.verdict(agreement(Verdict.DISAGREE, reasons=("because",), same_slack=False))
    assert (
        "position within 2.0e+00 mm, rotation within 3.0e+00°, tensions within 4.0e+00 N, different slack cables"
        in text
    )
    assert text.startswith("[bold red]")
    assert text.endswith("  - because")
    assert crosscheck_tables.verdict(agreement(Verdict.AGREE)).startswith("[bold green]")
    said = f"<Agreement: {Verdict.AGREE.value}: 2.0e+00 mm, 3.0e+00° and 4.0e+00 N difference, different slack cables>"
    assert repr(agreement(Verdict.AGREE, same_slack=False)) == said


def test_a_problem_and_an_agreement_say_each_number_under_its_name():
    """All rows, of numbers that all differ, in millimetres, degrees, newtons and newton metres."""
    wrench, lengths = [1.25, -2.5, 3.75, 0.5, -0.75, 0.875], 0.5 + 0.01 * np.arange(8)
    problem = cdpr.Problem.of(cdpr.load_robot("cogiro"), [0.41, 0.26, 0.12, 0.01, -0.02, 0.03], lengths, wrench)

    def rows(table) -> list[tuple[str, ...]]:
        return [*zip(*([cell.replace("\\", "") for cell in column.cells] for column in table.columns), strict=True)]

    assert rows(crosscheck_tables.problem_table(problem)) == [
        ("x [mm]", "410.000"), ("y [mm]", "260.000"), ("z [mm]", "120.000"),
        ("about x [°]", "0.573"), ("about y [°]", "-1.146"), ("about z [°]", "1.719"),
        *((f"rest length {cable + 1} [mm]", f"{500 + 10 * cable}.000") for cable in range(8)),
        ("weight [N]", "3.9240"),
        ("force along x [N]", "1.2500"), ("torque about x [N m]", "0.5000"),
        ("force along y [N]", "-2.5000"), ("torque about y [N m]", "-0.7500"),
        ("force along z [N]", "3.7500"), ("torque about z [N m]", "0.8750"),
    ]  # fmt: skip
    for same_slack, told in ((True, "the same"), (False, "[red]different[/]")):
        assert rows(crosscheck_tables.agreement_table(agreement(Verdict.DISAGREE, same_slack=same_slack))) == [
            ("position [mm]", "2.0e+00"), ("rotation [°]", "3.0e+00"), ("tension [N]", "4.0e+00"),
            ("slack cables", told), ("MuJoCo's residual at the static equilibrium [N]", "5.0e+00"),
            ("static residual at MuJoCo's equilibrium [N]", "6.0e+00"),
        ]  # fmt: skip


def test_a_line_is_listed_with_how_far_the_methods_are_apart():
    """Millimetres, degrees, cables that are taut, and nanometres."""
    ends = [made_up("mujoco"), made_up("newton")]
    agreements = [agreement(Verdict.AGREE, position_error=1.5e-9), agreement(Verdict.DISAGREE, position_error=2.5e-6)]
    shown = columns(line_table("title", ends, agreements))
    tilts = [math.acos(math.cos(math.radians(a)) * math.cos(math.radians(b))) for a, b in ((3, 20), (4, 21))]
    assert shown == {
        "commanded x [mm]": ["400.00", "400.00"], "x [mm]": ["411.00", "412.00"], "dev. -z [mm]": ["7.000", "10.000"],
        "tilt [°]": [f"{math.degrees(tilt):.3f}" for tilt in tilts], "about y [°]": ["20.000", "21.000"],
        "taut cables": ["6", "6"], "difference [nm]": ["1.50", "2500.00"], "verdict": ["agree", "[red]differ[/]"],
    }  # fmt: skip


def compensation(**changes) -> Compensation:
    values = dict(
        commanded=RigidTransform.from_translation(COMMANDED), equilibrium=made_up("newton"),
        outcome=CompensationOutcome.NEAREST,
        distance=0.0123, arm=0.055, reasons=("so it is",), tension_limits=np.ones((2, 8)), reached=None,
    )  # fmt: skip
    return Compensation(**(values | changes))


def test_the_tension_of_a_slack_cable_with_mass_is_shown():
    """By settle, certify and compensate, and in the report's picture; of a slack cable without mass the word alone."""
    robot, pose = garage_crane(linear_density=2.0), (1.5, 1.5, 0.3)
    problem, one = cdpr.Problem.of(robot, pose), cdpr.solve(robot, pose)
    cable = int(np.flatnonzero(one.slack)[0])
    tension, row = one.tensions[cable], f"tension {cable + 1} [N]"
    assert cells(printed(crosscheck_tables.settle_table(problem, [one])), row, 2) == ["slack", f"{tension:.4f}"]
    found = printed(analysis_tables.compensation_table(compensation(), [one], [one]))
    assert cells(found, row, 4) == ["slack", f"{tension:.3f}"] * 2
    proved = cells(printed(proof_tables.certificate_table([cdpr.certify(one)])), row, 2)
    assert proved[0] == "slack"
    assert float(proved[1]) == pytest.approx(tension)
    view = View(problem, one, one, None, cdpr.cable_profiles(cdpr.solve_many(robot, [pose]))[0])
    assert html_page._drawn(robot, view)["cables"][cable]["label"] == f"slack {tension:.3g} N"
    assert as_json.solution(one)["tensions"][cable] == tension


def test_compensation_shows_errors_in_millimetres_and_degrees_by_method():
    """From the commanded pose; the angle of Ry(20°) Rx(3°) is 2 acos(cos 10° cos 1.5°)."""
    before, after = [made_up("mujoco"), made_up("newton")], [made_up("newton"), made_up("mujoco")]
    shown = columns(analysis_tables.compensation_table(compensation(), before, after))
    assert list(shown) == ["", "before MuJoCo", "before Newton", "after Newton", "after MuJoCo"]
    rows = dict(
        zip([label.replace("\\", "") for label in shown[""]], zip(*list(shown.values())[1:], strict=True), strict=True)
    )
    assert rows["error x [mm]"] == ("11.000000", "12.000000", "12.000000", "11.000000")
    assert rows["error z [mm]"][:2] == ("-7.000000", "-10.000000")
    assert rows["position error [mm]"][0] == f"{math.hypot(11, 3, 7):.6f}"
    half = math.cos(math.radians(10)) * math.cos(math.radians(1.5))
    assert rows["rotation error [°]"][0] == f"{math.degrees(2 * math.acos(half)):.6f}"
    assert rows["tension 1 [N]"][:2] == ("1.250", "1.375")
    tilts = [math.acos(math.cos(math.radians(a)) * math.cos(math.radians(b))) for a, b in ((3, 20), (4, 21))]
    assert rows["tilt [°]"][:2] == tuple(f"{math.degrees(tilt):.6f}" for tilt in tilts)
    assert rows["lowest stiffness [N/m]"][:2] == ("12.5", "13.5")
    assert rows["equilibrium"] == ("stable",) * 4


def test_compensated_cables_are_shorter_by_what_is_said():
    """Cut by 1 to 8 mm; the verdict names the distance and the arm in millimetres."""
    robot = cdpr.load_robot("cogiro")
    cut = robot.rest_lengths(COMMANDED) - 1e-3 * np.arange(1, 9)
    problem = cdpr.Problem.of(robot, COMMANDED, cut)
    found = compensation(equilibrium=made_up("newton", problem=problem))
    text = analysis_tables.compensation_lengths(found).replace("\\", "")
    assert text == "Rest lengths reduced by [mm]: 1.000, 2.000, 3.000, 4.000, 5.000, 6.000, 7.000, 8.000"
    said = analysis_tables.compensation_verdict(found, CompensationCheck(found, found.equilibrium, found.equilibrium))
    assert "12.300 mm away (rotation weighted by an arm of 55 mm)" in said
    assert "so it is" in said


@pytest.mark.parametrize(
    ("exact", "stays", "reached_from_commanded", "color"),
    [(True, True, True, "green"), (False, True, True, "yellow"), (False, True, False, "yellow"),
     (True, False, False, "red")],
)  # fmt: skip
def test_what_mujoco_confirms_of_a_compensation_is_told(exact, stays, reached_from_commanded, color):
    """The colour of the verdict, and in JSON whether the pose is held and whether the platform comes there."""
    outcome = CompensationOutcome.EXACT if exact else CompensationOutcome.NEAREST
    found = compensation(outcome=outcome, distance=0.0 if exact else 0.0123)
    elsewhere = made_up("seecr/fsolve")
    hold = CompensationCheck(
        found, found.equilibrium if stays else elsewhere, found.equilibrium if reached_from_commanded else elsewhere
    )
    assert analysis_tables.compensation_verdict(found, hold).startswith(f"[bold {color}]")
    expected = [] if stays and reached_from_commanded else ["these lengths hold it" if stays else "it is not held"]
    assert len(hold.reasons) == len(expected)
    assert all(words in reason for words, reason in zip(expected, hold.reasons, strict=True))
    told = as_json.compensation(found.equilibrium.problem, found, hold, [elsewhere], [found.equilibrium])
    assert (told["held"], told["reached_from_commanded"], told["exact"]) == (stays, reached_from_commanded, exact)
    assert told["before"]["fsolve"]["position"] == elsewhere.position.tolist()
    assert told["after"]["newton"]["position"] == found.equilibrium.position.tolist()


def test_sensitivity_and_modes_name_their_units():
    """Millimetres, degrees and newtons per unit; hertz."""
    effect = Effect("exit 3 z", "exits", 8, "mm", 1.5, 2.5, 3.5)
    shown = columns(analysis_tables.sensitivity_table(Sensitivity(made_up("newton"), {}, {}, 4e-3), [effect]))
    assert shown == {"": ["exit 3 z"], "per": ["1 mm"], "mm": ["1.5"], "°": ["2.5"], "N": ["3.5"]}
    assert "the cable closest to a change is 4 mm of length away" in analysis_tables.sensitivity_note(
        Sensitivity(made_up("newton"), {}, {}, 4e-3)
    )
    one = made_up("newton")
    shape = np.zeros((1, 6))
    shape[0, [0, 4]] = 2.0, 1.0 / one.problem.robot.characteristic_length  # a rotation half as far as the translation
    table = columns(analysis_tables.modes_table(Modes(one, np.array([7.25]), shape)))
    assert (table["mode"], table["Hz"], table["x"], table["about y"]) == (["1"], ["7.250"], ["1.00"], ["0.50"])
    assert table["y"] == table["about x"] == [""]
    told = as_json.sensitivity(Sensitivity(one, {}, {}, 4e-3), [effect], Modes(one, np.array([7.25]), shape))
    assert (told["margin"], told["frequencies"], told["mode_shapes"]) == (4e-3, [7.25], shape.tolist())


def test_equilibria_are_listed_with_what_mujoco_does_there():
    """Millijoules, millimetres, degrees; what stays, leaves or neither."""
    places = (made_up("mujoco"), made_up("newton", eigenvalues=(-3.0, 40.0, 90.0)))
    found = Equilibria(places[0].problem, places, np.array([0.0125, 0.25]), 10, saddles=True)
    releases = [Release(1e-6, 1e-6, 2.0), Release(1e-3, 1e-6, 2.0)]
    table = analysis_tables.equilibria_table(found, releases, reached=0)
    assert [row.style for row in table.rows] == ["bold", "dim"]  # where one gets, and what is not stable
    shown = columns(table)
    assert shown["energy [mJ]"] == ["12.50", "250.00"]
    assert (shown["x [mm]"], shown["y [mm]"], shown["z [mm]"]) == (
        ["411.0", "412.0"],
        ["253.0", "255.0"],
        ["193.0", "190.0"],
    )
    tilts = [math.acos(math.cos(math.radians(a)) * math.cos(math.radians(b))) for a, b in ((3, 20), (4, 21))]
    assert shown["tilt [°]"] == [f"{math.degrees(tilt):.1f}" for tilt in tilts]
    assert shown["slack"] == ["2", "2"]
    assert shown["lowest stiffness [N/m]"] == ["12.5", "-2"]
    assert shown["index"] == ["", "1"]
    assert shown["released in MuJoCo"] == ["stays", "leaves"]
    told = as_json.equilibria(places[0].problem, found, releases, LoadPath(np.ones(1), places[:1], (0.5,)), 0, 1)
    assert [one["energy"] for one in told["equilibria"]] == [0.0125, 0.25]
    assert [one["stays_in_mujoco"] for one in told["equilibria"]] == [True, False]
    assert (told["reached"], told["reached_in_mujoco"], told["imbalance"], told["jumps"]) == (0, 1, 0, [0.5])


def test_equilibria_that_are_missing_are_counted():
    """Three stable ones without a saddle lack at least three; with as many odd ones nothing is known to be missing."""
    minima, saddle = [made_up(source) for source in list(DEGREES)[:3]], made_up("newton", eigenvalues=(-3, 40, 90))
    for places, said in (([*minima], "At least 3 missing"), ([minima[0], saddle], "no indication that one is missing")):
        found = Equilibria(minima[0].problem, tuple(places), np.zeros(len(places)), 10, saddles=True)
        assert said in analysis_tables.equilibria_note(found)


def test_what_moved_in_a_layout_is_told_in_its_unit():
    """Millimetres of points; newtons, kilograms per metre and per cent of cables."""
    moved = (
        Change("exit 3 z", 0.25, 0.2375),
        Change("EA of cable 2", 1000.0, 1250.0),
        Change("linear density of cable 2", 2.0, 1.0),
    )
    layout = Mock(spec=LayoutResult, given=cdpr.load_robot("cogiro"), changes=moved)
    assert columns(design_tables.changes_table(layout)) == {
        "": ["exit 3 z", "EA of cable 2", "linear density of cable 2"],
        "before": ["250.00 mm", "1000 N", "2 kg/m"],
        "after": ["237.50 mm", "1250 N", "1 kg/m"],
        "change": ["-12.50 mm", "+25 %", "-50 %"],
    }


def states(rows: int) -> cdpr.Trajectory:
    """Of ``cogiro``, all numbers different; cables are slack in two of them."""
    random, robot = np.random.default_rng(21), cdpr.load_robot("cogiro")
    commanded = random.uniform([0.2, 0.15, 0.1], [0.6, 0.35, 0.25], (rows, 3))
    problems = Problems.of(robot, commanded)
    tensions = random.uniform(0.5, 2.0, (rows, 8))
    tensions[1, 2] = tensions[3, 4:7] = 0.0
    turns = Rotation.from_rotvec(random.uniform(-0.2, 0.2, (rows, 3)))
    poses = RigidTransform.from_components(commanded + random.uniform(-0.02, 0.02, (rows, 3)), turns)
    lengths = problems.rest_lengths * np.where(tensions > 0, 1.001, 0.98)
    return cdpr.Trajectory.of(problems, 2.5 + 0.25 * np.arange(rows), poses, lengths, tensions)


def quantities(batch: EquilibriumBatch) -> dict[str, np.ndarray]:
    """What tables sum up, row by row, from positions and rotations."""
    off = batch.positions - batch.problems.positions
    return {
        "deviation [mm]": 1000 * np.sqrt((off**2).sum(1)),
        "deviation -z [mm]": -1000 * off[:, 2],
        "tilt [°]": np.degrees(np.arccos(batch.rotations[:, 2, 2])),
        "largest tension [N]": batch.tensions.max(1),
        "slack cables": (batch.tensions == 0).sum(1),
    }


def test_a_motion_is_summed_up_with_the_time_of_the_worst():
    """Each quantity at the start, at the end, at its worst, and when that was since the start."""
    motion = states(6)
    taut = np.where(motion.tensions > 0, motion.tensions, np.inf).min(1)
    expected = {
        name: [*values[[0, -1]], values.max(), 0.25 * values.argmax()] for name, values in quantities(motion).items()
    }
    expected["smallest tension of a taut cable [N]"] = [*taut[[0, -1]], taut.min(), 0.25 * taut.argmin()]
    shown = columns(robot_tables.trajectory_table(motion))
    headings, rows = [*shown], zip(*shown.values(), strict=True)
    assert headings == ["", "at the start", "at the end", "worst", "after [s]"]
    told = {row[0].replace("\\", ""): [float(cell) for cell in row[1:]] for row in rows}
    assert told.keys() == expected.keys()
    for name, values in expected.items():
        assert told[name] == pytest.approx(values, abs=6e-4), name
    assert len({tuple(values) for values in expected.values()}) == len(expected)


def test_a_batch_is_summed_up_by_median_and_worst():
    """Of what is in equilibrium; what is not is counted by its reason."""
    motion = states(6)
    status = np.array([0, 0, 0, 0, Status.STALLED, 0])
    batch = EquilibriumBatch(**{
        field.name: getattr(motion, field.name) for field in dataclasses.fields(EquilibriumBatch)
    } | {"status": status, "residuals": 1e-9 * np.arange(1.0, 7.0), "source": "newton"})  # fmt: skip
    done = status == 0
    expected = {name: (np.median(values[done]), values[done].max()) for name, values in quantities(batch).items()}
    shown = columns(robot_tables.batch_table(batch))
    assert [*shown] == ["", "median", "worst"]
    told = {row[0].replace("\\", ""): row[1:] for row in zip(*shown.values(), strict=True)}
    assert told.pop("equilibria") == ("", "5 of 6")
    assert told.pop(f"none: {Status.STALLED.sentence}") == ("", "1")
    assert told.pop("unbalanced [N]") == ("3.0e-09", "6.0e-09")
    assert told.pop("slack cables") == ("0", "3 of 8")
    del expected["slack cables"]
    assert told.keys() == expected.keys()
    for name, values in expected.items():
        assert [float(cell) for cell in told[name]] == pytest.approx(values, abs=6e-4), name


def test_a_layouts_json_says_each_number_of_its_own_method():
    """By statics and by MuJoCo, before and after; what MuJoCo does not confirm is null or false."""
    given, robot = cdpr.load_robot("parallel"), cdpr.load_robot("cogiro")
    layout = Mock(
        spec=LayoutResult, given=given, robot=robot, objective=OBJECTIVES["worst tilt"], before=0.5, after=0.125,
        cases=[1] * 3, changes=(), largest_displacement=0.01, layouts_evaluated=40, history=[0] * 7, message="done",
        warnings=("near its end",),
    )  # fmt: skip
    effects = ("more slack cables",)
    for score, better in ((0.25, True), (np.nan, False)):
        sides = Mock(spec=ValidatedRobot, score=0.75), Mock(spec=ValidatedRobot, score=score)
        told = design_tables.design_json(
            Mock(
                spec=LayoutValidation,
                layout=layout,
                cases=[1] * 5,
                before=sides[0],
                after=sides[1],
                agrees=True,
                better=better,
                side_effects=effects,
            )
        )
        in_mujoco = None if np.isnan(score) else score
        assert [told[name] for name in ("before", "after", "before_in_mujoco", "after_in_mujoco")] == [
            0.5, 0.125, 0.75, in_mujoco,
        ]  # fmt: skip
        assert (told["agrees"], told["better"], told["poses"], told["poses_in_mujoco"]) == (True, better, 3, 5)
        assert (told["layouts_evaluated"], told["generations"], told["largest_displacement"]) == (40, 7, 0.01)
        assert told["warnings"] == ["more slack cables", "near its end"]
        assert (told["robot"], told["exits"]) == ("parallel", robot.exits.tolist())


def test_what_comes_nearest_is_listed_first():
    """In millimetres, at the pose where it does."""
    poses = [(0.25, 0.25, 0.1), (0.4, 0.25, 0.1), (0.55, 0.3, 0.2)]
    found = cdpr.clearances(cdpr.load_robot("cogiro"), poses, points=5)
    order = sorted(range(3), key=lambda row: found.least[row])
    assert order != [0, 1, 2]
    shown = columns(design_tables.clearance_table(found))
    for axis, name in enumerate("xyz"):
        assert shown[f"{name} [mm]"] == [f"{1000 * poses[row][axis]:.1f}" for row in order]
    distances = [float(words.split()[-2]) for words in shown["smallest"]]
    assert distances == pytest.approx([1000 * found.least[row] for row in order], rel=0.01)


def identification(robot: cdpr.Robot | None = None) -> Identification:
    robot = robot or cdpr.load_robot("cogiro")
    return Identification(
        robot=robot,
        names=("axial_stiffness", "rest_length_offset 3", "mass"), units=("N", "m", "kg"),
        values=np.array([1234.5, 0.0021, 0.4]), standard_errors=np.array([6.7, 0.00031, np.inf]),
        correlations=np.eye(3), residuals=np.array([[3e-3, 4e-3, np.nan, np.radians(2), np.nan, np.nan, 3.5]]),
        spread=1.5, scatters={"position": 5e-3, "rotation": math.radians(6), "tension": 3.0},
        estimated=("position", "rotation"), reasons=("mass is unknown",),
        predictions={("axial_stiffness", "mass"): 3.4567, ("mass",): np.inf, ("axial_stiffness",): 1.2345},
        degrees_of_freedom=1, deviance=10.0, outliers=(Outlier(1, "tension 1", -4.56),),
        kinds=np.array([0, 0, 0, 1, 1, 1, 2]),
        given=robot, requested=("axial_stiffness", "mass"), repeats=np.zeros(1, dtype=bool),
    )  # fmt: skip


def test_identification_shows_lengths_in_millimetres_and_the_rest_in_its_unit():
    """And what the data do not determine; residuals as root mean squares; intervals by Student's t or the logarithm."""
    shown = analysis_tables.identification_table(identification())
    table = [list(column.cells) for column in shown.columns]
    wide = float(t.ppf(0.975, 1))
    ratio = math.exp(wide * 6.7 / 1234.5)
    assert table == [
        ["axial stiffness", "rest length offset 3", "mass"], ["1234.5", "2.1", "0.4"], ["6.7", "0.31", "undetermined"],
        [f"{1234.5 / ratio:.6g} to {1234.5 * ratio:.6g}", f"{2.1 - 0.31 * wide:.6g} to {2.1 + 0.31 * wide:.6g}", ""],
        ["N", "mm", "kg"],
    ]  # fmt: skip
    note = analysis_tables.identification_note(identification())
    assert f"Residuals: {math.sqrt((9 + 16) / 2):.3g} mm, 2° and 3.5 N (root mean square)." in note
    assert "outlier: row 1: tension 1 is 4.6 standard errors off" in note
    assert "estimated from them: 5 mm and 6°" in note
    assert (
        "\nOmitted rows are predicted with an error of 3.46 standard errors, and of 1.23 with axial_stiffness alone.\n"
        in note
    )
    assert repr(identification()).endswith("mass = 0.4 ± inf kg; mass is unknown>")
    told = as_json.identification(identification())
    offset = told["unknowns"]["rest_length_offset 3"]
    assert offset.pop("interval_95") == pytest.approx([0.0021 - 0.00031 * wide, 0.0021 + 0.00031 * wide])
    assert offset == {"value": 0.0021, "standard_error": 0.00031, "unit": "m"}
    assert told["unknowns"]["mass"]["interval_95"] == [0.0, None]
    assert told["outliers"] == [{"row": 1, "name": "tension 1", "size": -4.56}]
    assert told["aicc"] is None  # four numbers for five parameters
    assert told["bic"] == pytest.approx(10 + 5 * math.log(4))
    assert told["unknowns"]["mass"]["standard_error"] is None
    assert told["predictions"][0] == {"unknowns": ["axial_stiffness", "mass"], "error": 3.4567}
    assert told["predictions"][1] == {"unknowns": ["mass"], "error": None}


def over_x(**variables) -> xr.Dataset:
    """Numbers at four poses along x, of one robot."""
    data = {name: (("x", "y", "z"), np.array(values).reshape(4, 1, 1)) for name, values in variables.items()}
    return xr.Dataset(data, coords={"x": range(4), "y": [0], "z": [0], "robot": "mine", "material": "rope"})


def test_a_sweep_is_summed_up_column_by_column():
    """Of those solved, in degrees and millimetres; of all, in per cent."""
    fine, bad = Status.CONVERGED, Status.STALLED
    dataset = over_x(
        status=[fine, fine, fine, bad], tilt=[*np.radians([1.0, 2.0, 6.0]), np.nan],
        distance=[0.010, 0.020, 0.050, np.nan], slack_count=[0, 1, 2, 3], feasible=[True, False, False, False],
    )  # fmt: skip
    shown = columns(workspace_tables.sweep_table(dataset))
    assert {name: values[0] for name, values in shown.items()} == {
        "robot": "mine", "cables": "rope", "solved %": "75", "median tilt °": "2.00", "worst tilt °": "6.00",
        "median dev. mm": "20.00", "worst dev. mm": "50.00", "slack %": "75", "feas %": "25",
    }  # fmt: skip


def test_a_check_is_counted_outcome_by_outcome():
    """And the largest differences are those of poses that agree."""
    agree, apart = OUTCOMES.index("agree"), OUTCOMES.index("disagree")
    dataset = over_x(
        outcome=[agree, agree, agree, apart], position_error=[1e-9, 2e-9, 3e-9, 1.0],
        rotation_error=np.radians([1e-7, 4e-7, 2e-7, 90.0]), tension_error=[5e-8, 1e-8, 2e-8, 9.0],
    )  # fmt: skip
    shown = columns(workspace_tables.check_table(dataset))
    assert shown["agree"] == ["3"]
    assert shown["disagree"] == ["[red]1[/]"]
    assert shown["unsettled"] == ["0"]
    assert (shown["pos. ≤ mm"], shown["rot. ≤ °"], shown["tens. ≤ N"]) == (["3e-06"], ["4e-07"], ["5e-08"])


def test_json_says_why_there_is_none_and_what_cables_take():
    """The reason of a failure; limits of force, of which an infinite one is none."""
    failed = as_json.outcome(cdpr.NotConverged("because", made_up("newton")))
    assert (failed["equilibrium"], failed["reason"]) == (False, "because")
    robot = cdpr.load_robot("cogiro").replace(force_min=0.5, force_max=[7.0] * 7 + [np.inf])
    told = as_json.solution(made_up("newton", problem=cdpr.Problem.of(robot, COMMANDED)))
    assert told["cables"] == {"force_min": [0.5] * 8, "force_max": [7.0] * 7 + [None]}


def test_json_has_every_property_of_cables_that_is_not_as_by_default():
    """Whatever properties there are, each with a value of its own, and no property that is as by default."""
    parameters = inspect.signature(cdpr.Robot).parameters
    of_cables = (parameters[field.name] for field in dataclasses.fields(Cabling))
    usual = {one.name: one.default for one in of_cables if one.default is not one.empty} | {"breaking_load": np.inf}
    memories = {"pulley_friction": 0.05, "hysteresis": [(0.1, 1e-3, 0.5)], "creep": [(4e4, 60.0)]}
    given = {name: np.where(np.isinf(value), 50.0, np.add(value, 1.0)) for name, value in usual.items() if value != ()}
    given |= memories
    assert "pulley_axis" in given
    without, elastic = ["pulley_axis", *memories], given.keys() - {"linear_density", "stiffening"}
    every = [given.keys() - memories.keys(), elastic, memories, given.keys() - set(without), ["linear_density"], []]
    for names in every:
        robot = cdpr.load_robot("cogiro").replace(**({"breaking_load": np.inf} | {name: given[name] for name in names}))
        shown = as_json.identification(identification(robot=robot)).get("cables", {})
        assert shown.keys() - {"pulley_axis"} == set(names) - {"pulley_axis"}
        assert ("pulley_axis" in shown) == ("pulley_radius" in names)
        for name, values in shown.items():
            np.testing.assert_array_equal(values, getattr(robot, name))

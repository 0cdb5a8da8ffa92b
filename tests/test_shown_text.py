"""What a person reads is what was computed: help, tables, sentences, JSON, and the display in notebooks.

Results are made up (``made_up.py``), all of their numbers different. Whole texts are compared with those reviewed in
``snapshots/`` (``pytest --update-snapshots`` writes them); of each quantity, a row of ``SHOWN`` has the number, worked
out here, that must stand under its heading.
"""

import contextlib
import copy
import dataclasses
import importlib
import inspect
import io
import json
import math
import pickle
import pkgutil
import re
from collections.abc import Callable, Iterator
from unittest.mock import Mock

import made_up
import mujoco
import numpy as np
import pytest
from drawn_figures import properties
from made_up import ANGLES, HOSTILE, PLAIN, REAL, SHIFT, SOURCES, agreement, certificate, compensation, equilibrium
from page_reader import Page
from rich.console import Console
from rich.table import Table
from rich.text import Text
from sample_problems import garage_crane
from scipy.stats import t
from typer.testing import CliRunner

import cdpr_sim as cdpr
import real_cables
from cdpr_sim.analysis.compensation import CompensationOutcome
from cdpr_sim.cli import COMMANDS, app
from cdpr_sim.core.cable import Cabling
from cdpr_sim.core.describe import describe_cables, describe_properties, describe_twist
from cdpr_sim.core.errors import MissingExtra
from cdpr_sim.core.html_repr import HtmlRepr
from cdpr_sim.crosscheck.compare import Verdict
from cdpr_sim.crosscheck.compensation_check import CompensationCheck
from cdpr_sim.drawing.readable_numbers import per_cent, plain, power_of_ten
from cdpr_sim.drawing.video import render
from cdpr_sim.physics.release import Release
from cdpr_sim.report import (
    analysis_tables,
    as_json,
    crosscheck_tables,
    design_tables,
    html,
    model_tables,
    notebook,
    proof_tables,
    robot_tables,
    score_tables,
    workspace_tables,
)  # fmt: skip
from cdpr_sim.report.table_style import Sheet

UNKNOWN = cdpr.NotConverged("stalled [here]", equilibrium())
STAYS = [Release(1e-6, 1e-6, 2.0), Release(1e-3, 1e-6, 2.0), Release(1e-6, 2e-6, 3.0), Release(2e-4, 3e-5, 2.0)]
EVERY = [equilibrium(source) for source in SOURCES]
CUT = dataclasses.replace(
    EVERY[1].problem, rest_lengths=PLAIN.rest_lengths(made_up.POSES[PLAIN][:3]) - 1e-3 * np.arange(1, 5)
)
HOLD = CompensationCheck(compensation(), EVERY[1], EVERY[2])
ERRORS = {"position_error": 1e-10 * np.arange(1.0, 7.0)}
AGREE = np.array([True, True, True, True, False, True])
LAID = made_up.layout()

RESULTS = [
    made_up.path(),     REAL, EVERY[0].problem, EVERY[1], made_up.batch(), made_up.states(), agreement(),
    made_up.checked(),
    compensation(), HOLD,
    made_up.modes(), made_up.sensitivity(), made_up.equilibria(), certificate(), made_up.complete(),
    made_up.load_path(),
    made_up.clearances(), made_up.identification(), LAID, made_up.front(), made_up.validation(), made_up.HULL,
]  # fmt: skip
"""One of each class that a notebook displays."""

OUTPUTS = {
    **{f"notebook {type(one).__name__}": lambda one=one: [repr(one), *notebook.content_of(one)] for one in RESULTS},
    "robot": lambda: [robot_tables.robot_table(PLAIN), robot_tables.cables_table(PLAIN), as_json.robot(PLAIN)],
    "settle": lambda: [
        crosscheck_tables.lead("so it is", EVERY[0].problem.pose, *EVERY[:2]),
        *(crosscheck_tables.highest_tension(dataclasses.replace(
            EVERY[1], problem=cdpr.Problem.of(PLAIN.replace(breaking_load=loads), made_up.POSES[PLAIN]),
            tensions=np.array([1.0, 0.0, 1.5, 30.0]))) for loads in ([2.0, 2.0, 2.0, 100.0], [2.0, 2.0, 2.0, np.inf])),
        crosscheck_tables.settle_table(EVERY[0].problem, [*EVERY[:4], UNKNOWN, cdpr.NotSettled("sways")]),
        crosscheck_tables.settle_table(EVERY[0].problem, EVERY[:2], details=False),
        *crosscheck_tables.equilibrium_notes(EVERY[1]), *crosscheck_tables.equilibrium_notes(equilibrium(robot=REAL)),
        crosscheck_tables.verdict(agreement()), crosscheck_tables.verdict(agreement(Verdict.AGREE, same_slack=True)),
        crosscheck_tables.verdict_sentence(agreement(Verdict.AGREE), EVERY[1]),
        repr(agreement(Verdict.AGREE, same_slack=True)),
        as_json.crosscheck(EVERY[0].problem, [*EVERY[3::-1]], agreement(), [certificate(), certificate("mujoco")]),
    ],
    "settle where one cable is slack in one method": lambda: [
        crosscheck_tables.settle_table(EVERY[0].problem, both)
        for taut in [dataclasses.replace(EVERY[1], lengths=np.full(4, 2.0), tensions=np.full(4, 1.0))]
        for both in ([EVERY[0], taut], [taut, EVERY[0]])
    ],
    "settle along a path": lambda: [
        *crosscheck_tables.path_lead(made_up.batch(source="mujoco"), AGREE),
        crosscheck_tables.path_table(made_up.batch(source="mujoco"), ERRORS, AGREE),
        as_json.path(made_up.batch(), made_up.batch(source="mujoco", factor=2.0), AGREE),
    ],
    "solve": lambda: [as_json.solution(EVERY[2]), as_json.outcome(UNKNOWN), as_json.outcome(equilibrium(robot=REAL)),
    repr(EVERY[1])],
    "compensate": lambda: [
        *(analysis_tables.compensation_verdict(*one) for one in (
            (compensation(CompensationOutcome.EXACT, distance=0.0, reasons=()),), (compensation(arm=0.0), HOLD),
            (compensation(), CompensationCheck(compensation(), EVERY[1], EVERY[1])),
            (compensation(CompensationOutcome.EXACT), CompensationCheck(compensation(), EVERY[2], EVERY[2])),
        )),
        analysis_tables.compensation_lengths(compensation(equilibrium=equilibrium(problem=CUT))),
        analysis_tables.compensation_table(compensation(), EVERY[:2], EVERY[1::-1]),
        as_json.compensation(EVERY[0].problem, compensation(), HOLD, EVERY[2:4], EVERY[:2]),
    ],
    "sensitivity": lambda: [
        *analysis_tables.sensitivity_lead(made_up.sensitivity(), made_up.EFFECTS, made_up.modes()),
        analysis_tables.sensitivity_table(made_up.sensitivity(), made_up.EFFECTS),
        analysis_tables.modes_table(made_up.modes()),
        analysis_tables.sensitivity_note(made_up.sensitivity(np.inf)),
        as_json.sensitivity(made_up.sensitivity(), made_up.EFFECTS, made_up.modes()),
    ],
    "equilibria": lambda: [
        analysis_tables.equilibria_table(made_up.equilibria(), STAYS, reached=1),
        analysis_tables.equilibria_note(made_up.equilibria()),
        analysis_tables.equilibria_note(made_up.equilibria(saddles=False)),
        *notebook.content_of(made_up.load_path(())),
        as_json.equilibria(EVERY[0].problem, made_up.equilibria(), STAYS, made_up.load_path(), 0, 1),
        as_json.equilibria(EVERY[0].problem, made_up.equilibria(), (), made_up.load_path(), 0, 1)["equilibria"][0],
    ],
    "certify": lambda: [
        proof_tables.certificate_lead([certificate(), certificate("mujoco", position_error=4.56e-8,
        tension_error=1e-9)]),
        proof_tables.certificate_lead([certificate(), made_up.no_certificate()]),
        proof_tables.certificate_table([certificate(), made_up.no_certificate(), certificate("mujoco", index=2)]),
        *proof_tables.reasons([certificate(), made_up.no_certificate()]),
        proof_tables.proof_cell(certificate()), proof_tables.proof_cell(made_up.no_certificate()),
        *map(proof_tables.complete_note, (
            made_up.complete(), made_up.complete(made_up.UNDECIDED), made_up.complete(pending=17))),
        proof_tables.missing_note([]), proof_tables.missing_note([certificate()]),
        as_json.certificates([certificate(), made_up.no_certificate()]),
        as_json.complete(made_up.complete(made_up.UNDECIDED)),
    ],
    "identify": lambda: [
        analysis_tables.identification_table(made_up.identification()),
        analysis_tables.identification_note(made_up.identification()),
        analysis_tables.identification_note(made_up.identification(
            predictions={("mass",): np.inf}, reasons=(), outliers=(), estimated=(), degrees_of_freedom=100)),
        as_json.identification(made_up.identification()),
    ],
    "design": lambda: [
        design_tables.changes_table(LAID), design_tables.numbers_table(LAID, [("this", "1 mm", "2 mm"), ("[that]", "3",
        "4, worse")]),
        str(LAID), str(made_up.layout(after=0.6)), repr(made_up.layout(after=0.6)), *made_up.validation(0.8,
        4).sentences,
        repr(made_up.validation(0.8, 4)), design_tables.design_json(made_up.validation()),
        design_tables.design_json(made_up.validation(math.nan)), design_tables.front_table(made_up.front()),
    ],
    "workspace": lambda: [
        workspace_tables.sweep_table(made_up.swept()), *workspace_tables.sweep_lines(made_up.swept()),
        workspace_tables.check_table(made_up.checked().dataset), *workspace_tables.check_lines(made_up.checked()),
        *workspace_tables.check_lines(dataclasses.replace(made_up.checked(), disagreements=())),
        *workspace_tables.check_lines(dataclasses.replace(made_up.checked(),
        disagreements=made_up.checked().disagreements * 23)),
        f"all agree: {workspace_tables.all_agree(made_up.checked().dataset)}",
    ],
    "any model": lambda: [
        *model_tables.rest_lead(made_up.model_rest()), *model_tables.rest_lead(made_up.model_rest(
            agreement=dataclasses.replace(made_up.model_rest().agreement, agrees=True), friction_share=0, neutral=())),
        *model_tables.rest_lead(made_up.model_rest(agreement=None, friction_share=1 + 1e-12)),
        model_tables.pose_table(made_up.MODEL, made_up.MODEL.qpos0, made_up.model_rest()),
        model_tables.tension_table(made_up.model_rest()), model_tables.contact_table(made_up.model_rest()),
        as_json.model_equilibrium(made_up.MODEL, made_up.model_rest()), repr(made_up.model_rest()),
        repr(made_up.tendons()),
    ],
    "diagnosis": lambda: [
        *model_tables.findings_lines(made_up.diagnosis()), *model_tables.findings_lines(made_up.diagnosis(findings=())),
        *model_tables.time_step_lines(made_up.MODEL, made_up.diagnosis()),
        *model_tables.time_step_lines(made_up.MODEL, made_up.diagnosis(fastest_period=np.inf, stable_time_steps={})),
        as_json.diagnosis(made_up.diagnosis()), as_json.diagnosis(made_up.diagnosis(fastest_period=np.inf)),
        repr(made_up.diagnosis()),
    ],
    "real cables": lambda: [real_cables.effects_table(effects := properties().effects[5:9]),
    real_cables.left_out(effects)],
    "score": lambda: [score_tables.score_table(made_up.scores()), score_tables.scores_json(made_up.scores())],
}  # fmt: skip
"""By name: what a command prints, or a notebook displays; ``dict``: JSON."""


def plainly(markup: object) -> str:
    return Text.from_markup(str(markup).replace("-\n", "").replace("\n", " ")).plain


def rows(table: Table) -> dict[str, list[str]]:
    """Cells by the first of their row, headings first; what is marked by a colour is not told apart."""
    cells = zip(*([column.header, *column.cells] for column in table.columns), strict=True)
    return {plainly(first): [plainly(one) for one in others] for first, *others in reversed([*cells])}


def written(part: object) -> str:
    """With all markup, a table's cells separated by bars, and styles of its rows and columns in brackets.

    Which columns are left-aligned or may be broken, how far they are apart, and what is below what on a narrow screen.
    """
    if isinstance(part, Table):
        heads = [
            f"{column.header}{' ←' * (column.justify == 'left')}{' wraps' * (not column.no_wrap)}"
            + (f" ({column.style})" if column.style else "")
            for column in part.columns
        ]
        if isinstance(part, Sheet):
            below = "columns" if part.methods else f"rows named by {part.text_columns}"
            heads[-1] += f"   padding {part.padding}, {below} below each other"
        lines = [" | ".join(heads).replace("\n", "\\n")]
        for number, row in enumerate(part.rows):
            style, end = f" ({row.style})" * bool(row.style), "\n" * row.end_section
            lines.append(" | ".join(str(column._cells[number]) for column in part.columns) + style + end)
        return "\n".join([str(part.title or ""), *lines])
    if isinstance(part, html.EmbeddedImage):
        assert part.png.startswith(b"\x89PNG")
        return f"picture: {part.description}"
    if not isinstance(part, dict):
        return str(part)
    text = json.dumps(part, indent=1, allow_nan=False, ensure_ascii=False)
    return re.sub(r"\[[^][{}]*\]", lambda array: re.sub(r"\n\s*", " ", array[0]), text)  # arrays of numbers in a line


@pytest.mark.parametrize("command", ["", *COMMANDS])
def test_help_is_as_reviewed(command, snapshot, monkeypatch):
    """Of each command: what it does, its arguments and options with their units and defaults."""
    monkeypatch.setenv("COLUMNS", "100")
    result = CliRunner().invoke(app, [*command.split(), "--help"], prog_name="cdpr-sim")
    assert result.exit_code == 0
    snapshot(f"help/{command or 'cdpr-sim'}.txt", result.stdout)


@pytest.mark.parametrize("output", OUTPUTS)
def test_outputs_are_as_reviewed(output, snapshot):
    """Every word, number, unit, heading and colour of tables, sentences and JSON; JSON has neither nan nor infinity."""
    snapshot(f"outputs/{output.replace(' ', '-')}.txt", "\n\n".join(map(written, OUTPUTS[output]())), rel=1e-9)


def test_tables_are_printed_as_reviewed(snapshot):
    """On a wide screen, and on one that is too narrow, where no number is cut off: records below one another."""
    for width in (120, 40):
        screen = Console(file=io.StringIO(), width=width)
        screen.print(
            crosscheck_tables.settle_table(EVERY[0].problem, EVERY[:2]), analysis_tables.modes_table(made_up.modes())
        )
        snapshot(f"printed/{width}-columns.txt", screen.file.getvalue())
        assert "…" not in screen.file.getvalue()


# Numbers, worked out by hand

TILT = [math.degrees(math.acos(math.cos(math.radians(a)) * math.cos(math.radians(b)))) for a, b, _ in ANGLES.values()]
"""Rz(c) Ry(b) Rx(a) takes the vertical to an angle whose cosine is cos a cos b."""

AWAY = [1e3 * SHIFT + n * np.array([1, 2, -3]) for n in range(5)]
"""[mm]"""

COMMANDED = 1e3 * np.array(made_up.POSES[PLAIN][:3])

TENSIONS = [np.where(made_up.TENSIONS > 0, made_up.TENSIONS + 0.125 * n, 0) for n in range(5)]

MOTION = made_up.states()
OFF = 1e3 * (MOTION.positions - MOTION.problems.positions)
DEVIATION, TILTS = np.sqrt((OFF**2).sum(1)), np.degrees(np.arccos(MOTION.rotations[:, 2, 2]))
SMALLEST = np.where(MOTION.tensions > 0, MOTION.tensions, np.inf).min(1)
DONE = [0, 1, 2, 3, 5]
WIDE = float(t.ppf(0.975, 1))


def worst(values: np.ndarray, at: int | None = None) -> list[float]:
    """At the start, at the end, the largest, and when that was since the start."""
    at = int(values.argmax()) if at is None else at
    return [values[0], values[-1], values[at], 0.25 * at]


def summed(values: np.ndarray) -> list[float]:
    """Median and largest of what is in equilibrium."""
    return [float(np.median(values[DONE])), float(values[DONE].max())]


SHOWN = [  # output, which of its tables, label, numbers in its unit, decimals
    ("settle", 0, "x [mm]", [COMMANDED[0], *(COMMANDED[0] + away[0] for away in AWAY[:4])], 3),
    ("settle", 0, "deviation -z [mm]", [-away[2] for away in AWAY[:4]], 3),  # downwards is positive
    ("settle", 0, "tilt [°]", [math.degrees(math.acos(math.cos(0.02) * math.cos(0.03))), *TILT[:4]], 3),
    ("settle", 0, "tension 3 [N]", [one[2] for one in TENSIONS[:4]], 4),
    ("notebook Trajectory", 0, "deviation [mm]", worst(DEVIATION), 3),
    ("notebook Trajectory", 0, "smallest tension of a taut cable [N]", worst(SMALLEST, int(SMALLEST.argmin())), 3),
    ("notebook EquilibriumBatch", 0, "tilt [°]", summed(TILTS), 3),
    ("compensate", 0, "error x [mm]", [AWAY[n][0] for n in (0, 1, 1, 0)], 6),
    ("equilibria", 0, "2", [250, *(COMMANDED + AWAY[1]), TILT[1], 1, 13.5], 1),
    ("identify", 0, "rest length offset 3", [2.1, 0.31, 2.1 - 0.31 * WIDE, 2.1 + 0.31 * WIDE], 5),
    ("notebook Hull", 0, "centroid [m]", [0.5, 0.75, 1.25], 3),
    ("workspace", 0, HOSTILE, [75, 2, 6, 20, 50, 75, 25], 2),
    ("workspace", 1, HOSTILE, [3, 1, 0, 3e-6, 4e-7, 5e-8, 2], 12),
]  # fmt: skip
"""One of each kind of number; all others were reviewed in the snapshots."""


@pytest.mark.parametrize(
    ("output", "number", "label", "expected", "decimals"), SHOWN, ids=[f"{row[0]}, {row[2]}" for row in SHOWN]
)
def test_each_number_is_under_its_heading_in_its_unit(output, number, label, expected, decimals):
    """As many decimals as are printed, of numbers that the made-up results give by hand."""
    table = [part for part in OUTPUTS[output]() if isinstance(part, Table)][number]
    cells = [
        number for cell in rows(table)[label] for number in re.findall(r"(?<!\w)-?\d[\d.]*(?:e-?\d+)?(?!\w|-)", cell)
    ]
    assert [float(cell) for cell in cells][: len(expected)] == pytest.approx(expected, abs=0.6 * 10.0**-decimals)


def test_the_order_of_results_changes_no_number():
    """Each result is under the name of its own source."""
    tables = [crosscheck_tables.settle_table(EVERY[0].problem, some) for some in (EVERY[:4], EVERY[3::-1])]
    columns = [{str(column.header): list(column.cells) for column in table.columns} for table in tables]
    assert columns[0] == columns[1]


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
        shown = as_json.robot(robot).get("cables", {})
        assert shown.keys() - {"pulley_axis"} == set(names) - {"pulley_axis"}
        assert ("pulley_axis" in shown) == ("pulley_radius" in names)
        for name, values in shown.items():
            np.testing.assert_array_equal(values, getattr(robot, name))


def test_the_tension_of_a_slack_cable_with_mass_is_shown():
    """Beside the word, by compensate and certify; of a slack cable without mass the word alone."""
    robot, pose = garage_crane(linear_density=2.0), (1.5, 1.5, 0.3)
    one = cdpr.solve(robot, pose)
    cable = int(np.flatnonzero(one.slack)[0])
    found = rows(analysis_tables.compensation_table(compensation(), [one], [one]))
    assert found[f"tension {cable + 1} [N]"] == [f"slack {one.tensions[cable]:.3f}"] * 2
    assert (
        rows(crosscheck_tables.settle_table(one.problem, [one]))[f"tension {cable + 1} [N], slack"][-1]
        == f"{one.tensions[cable]:.4f}"
    )


NUMBERS = [
    (plain, [0.0619, 3.81, 41.17, 170, 12345.6], ["0.062", "3.8", "41", "170", "12,346"]),
    (power_of_ten, [8e-8, 1e-7, 3.0], ["10⁻⁷", "10⁻⁷", "10¹"]),
    (per_cent, [0, 1e-6, 0.005, 0.424, 0.9992, 1], ["0 %", "0.1 %", "0.5 %", "42 %", "99.9 %", "100 %"]),
    (describe_properties, [PLAIN, REAL, REAL.replace(stiffening=(20.0, 0.5), pretension=2.0)], [
        (), ("64 to 128 g/m (2 of 3)", "over pulleys of 40 to 60 mm radius", "1.5 m from winch to exit",
        "2 to 3 parts of line (2 of 3)"),
        ("64 to 128 g/m (2 of 3)", "nonlinear with a2 = 20, a3 = 0.5", "over pulleys of 40 to 60 mm radius",
         "1.5 m from winch to exit", "2 to 3 parts of line (2 of 3)", "2 N of pretension")]),
    (describe_cables, [PLAIN, PLAIN.replace(material="fishing-0.4mm")], [
        "cables with EA = 1.1 kN to 1.4 kN", "fishing-0.4mm cables (EA = 1 kN)"]),
    (lambda twist: describe_twist(np.array(twist) / PLAIN.units, PLAIN), [(1, 0, 0, 0, -1, 0), (0, 0, 0, 0, 2, 0), (0,
    -3, 0, 0, 0, 0)], [
        f"+1 mm x, -{math.degrees(1e-3 / PLAIN.characteristic_length):.2g}° about y", "rotation about y",
        "translation along y"]),
]  # fmt: skip


def test_numbers_and_cables_are_put_into_words():
    """No exponents, and neither all nor nothing is claimed of a part; properties of cables with their units."""
    for words, values, expected in NUMBERS:
        assert [words(value) for value in values] == expected


# In a notebook


def test_every_public_result_is_among_them():
    """A new kind of result is asked for its display here, too; and other public data says in a line what it is."""
    public = {name: getattr(cdpr, name) for name in cdpr.__all__ if inspect.isclass(getattr(cdpr, name))}
    assert {name for name, kind in public.items() if issubclass(kind, HtmlRepr)} == {
        type(one).__name__ for one in RESULTS
    }
    for kind in filter(dataclasses.is_dataclass, public.values()):
        arrays = any("np.ndarray" in str(field.type) for field in dataclasses.fields(kind))
        assert not arrays or any("__repr__" in vars(one) for one in kind.__mro__[:-1]), kind


@pytest.mark.parametrize("result", RESULTS, ids=lambda one: type(one).__name__)
def test_a_notebook_displays_the_tables_of_the_command_line(result):
    """The same cells, in well-formed HTML that fetches nothing; names are read, not obeyed; in a terminal, a line."""
    parts, text = list(notebook.content_of(result)), result._repr_html_()
    page = Page(text)
    expected = [rows(part) for part in parts if isinstance(part, Table)]
    for table, one in zip(page.tables, expected, strict=True):
        told = {label: [cell.replace("- ", "") for cell in row] for label, row in table.items()}
        assert told == {label: row for label, row in one.items() if label in table}
        assert len(table) >= len(one) - 1  # headings that are all empty are left out
    assert expected
    assert all(
        plainly(line).strip() in page.words for part in parts if isinstance(part, str) for line in part.splitlines()
    )
    assert "http" not in text.split("</style>")[1]
    assert all(values.get("src", "data:").startswith("data:") for _, values in page.tags)
    assert not any("onerror" in values for _, values in page.tags)
    assert HOSTILE in page.words or HOSTILE not in repr(result)
    said = repr(result)
    assert len(said) < 340
    assert said.startswith((f"<{type(result).__name__}", f"{type(result).__name__}("))
    assert "\n" not in said
    assert "array" not in said


def test_colours_of_a_display_follow_those_around_it():
    """None is set but mixtures with that of the text around; pictures bring their white paper along."""
    colors = re.findall(r"(?:^|[;{\s])(?:color|background|border[a-z-]*):([^;}]+)", html.STYLE)
    assert len(colors) >= 8
    for color in colors:
        assert color.strip() in ("inherit", "none", "0", "collapse", "white", "4px") or "currentColor" in color, color
    assert html.STYLE.count("white;") == 1


# Copies


def parts_of(value: object, name: str = "") -> Iterator[tuple[str, object]]:
    """What a value holds, down to arrays, numbers and words, by names."""
    if isinstance(value, Mock):
        return
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        yield name, type(value)
        for field in dataclasses.fields(value):
            if hasattr(value, field.name):  # a controller has not planned yet
                yield from parts_of(getattr(value, field.name), f"{name}.{field.name}")
    elif isinstance(value, (tuple, list)):
        yield name, (type(value), len(value))
        for i, one in enumerate(value):
            yield from parts_of(one, f"{name}[{i}]")
    else:
        yield name, value if isinstance(value, np.ndarray) else repr(value)


FROZEN = cdpr.Robot, cdpr.Problem, cdpr.Problems, cdpr.Equilibrium, cdpr.EquilibriumBatch, Cabling
"""Of whose arrays nothing can be written: MuJoCo's model of a robot is kept, and would answer with the old numbers."""


def assert_copies(value: object) -> None:
    """Between processes and within one: the same to the bit; neither can be written to where the other cannot."""
    frozen = isinstance(value, FROZEN)
    for other in (pickle.loads(pickle.dumps(value)), copy.deepcopy(value), copy.copy(value)):
        mine, theirs = dict(parts_of(value)), dict(parts_of(other))
        assert mine.keys() == theirs.keys()
        for name, one in mine.items():
            if isinstance(one, np.ndarray):
                np.testing.assert_array_equal(one, theirs[name], err_msg=name)
                assert one.flags.writeable == theirs[name].flags.writeable, name  # type: ignore[attr-defined]
                assert not (frozen and one.flags.writeable), name
            else:
                assert one == theirs[name], name


LIFTED = """<mujoco><worldbody>
  <geom type="plane" size="1 1 1"/><site name="above" pos="0 0 2"/>
  <body pos="0 0 0.1"><freejoint/><geom type="box" size="0.1 0.1 0.1" mass="1"/><site name="top" pos="0 0 0.1"/></body>
</worldbody>
<tendon><spatial stiffness="1" springlength="1"><site site="above"/><site site="top"/></spatial></tendon></mujoco>"""
"""A box on the floor, with a tendon that pushes when it is short."""


def worst_reach(equilibria) -> np.ndarray:
    """An objective of a user's."""
    return np.linalg.norm(equilibria.positions, axis=-1).max(-1)


def test_results_survive_pickle_and_copies(catalogue):
    """Between processes of a pool, and in a notebook; so does all that tracks and senses."""
    robot, pose = catalogue["parallel"], (0.285, 0.25, 0.1)
    rigid = cdpr.RigidLengths(robot)
    found = cdpr.find_layout(robot, [pose], objective=worst_reach, within=0.005, generations=1, population=8, threads=1)
    front = cdpr.find_front(robot, [pose], within=0.005, generations=1, population=5, threads=1)
    mocked = (type(LAID), type(made_up.front()), type(made_up.validation()))
    model = mujoco.MjModel.from_xml_string(LIFTED)
    rest, told = cdpr.settle_model(model), cdpr.diagnose_model(model)
    values = [
        *(one for one in RESULTS if not isinstance(one, mocked)), found, front, cdpr.validate_layout(found),
        robot, robot.cabling, cdpr.Problems.of(robot, [pose]), cdpr.Memory.fresh(robot), made_up.EFFECTS[0], STAYS[0],
        cdpr.Measurements.of([pose], [pose], coordinates=("x", "y", "z"), robot=robot.name),
        rigid, cdpr.ElasticLengths(robot), cdpr.HeldTensions(robot), cdpr.LengthsAndTensions(robot),
        cdpr.PoseFeedback(rigid), cdpr.Command.of(robot.rest_lengths(pose), robot.cables), cdpr.Sensors(),
        cdpr.MATERIALS["vectran-0.7mm"], cdpr.ROPES["dyneema"], cdpr.Move("exits", 0.01), CompensationOutcome.EXACT,
        cdpr.Stability.STABLE, cdpr.Status.CONVERGED, Verdict.AGREE,
        rest, rest.contact_forces[0], rest.agreement, rest.tendon_tensions, cdpr.NoRest.FALLS, cdpr.FindingKind.NO_REST,
        told, told.findings[0], cdpr.holding_controls(model, rest.qpos),
    ]  # fmt: skip
    for value in values:
        assert_copies(value)
    public = {name for name in cdpr.__all__ if inspect.isclass(getattr(cdpr, name))}
    errors = {name for name in public if issubclass(getattr(cdpr, name), Exception)}
    only_controllers_see = {"Controller", "Measurement", "Reference"}
    assert public - errors - {type(value).__name__ for value in values} == only_controllers_see


def all_errors() -> set[type[Exception]]:
    """Every exception and warning of the package, but for those that others derive from privately."""
    for module in pkgutil.walk_packages(cdpr.__path__, "cdpr_sim."):
        if not module.name.endswith("__main__"):
            with contextlib.suppress(MissingExtra):  # cdpr_sim.jax without JAX
                importlib.import_module(module.name)
    found, waiting = set(), [cdpr.CdprError, cdpr.ImplausibleRobot]
    while waiting:
        one = waiting.pop()
        found |= {one} if one.__module__.startswith("cdpr_sim") and not one.__name__.startswith("_") else set()
        waiting += one.__subclasses__()
    return found


def raised(ask: Callable[[], object]) -> Exception:
    with pytest.raises(Exception) as caught:  # noqa: PT011
        ask()
    return caught.value


def test_errors_survive_pickle_and_copies():
    """An exception that cannot be pickled hangs a ``multiprocessing.Pool``; all say the same, and carry the same."""
    errors = [
        raised(lambda: cdpr.load_robot("cogir")), raised(lambda: cdpr.load_robot("x" * 100)),
        raised(lambda: cdpr.solve(PLAIN, (np.nan, 0, 0))), raised(lambda: cdpr.load_robot(__file__ + ".toml")),
        cdpr.NotConverged("stalled", EVERY[1]), cdpr.NotSettled("sways", EVERY[0]), cdpr.PlatformFell("fell",
        made_up.states()),
        cdpr.BadCommand("nan", made_up.states()), cdpr.StoreError("full"), cdpr.CdprError("on purpose"),
        cdpr.ImplausibleRobot("in millimetres"), cdpr.InvalidInput("mass: found 0"), render.OpenGLUnavailable("none"),
        MissingExtra("python-flint"),
    ]  # fmt: skip
    assert {type(error) for error in errors} == all_errors()
    for error in errors:
        for other in (pickle.loads(pickle.dumps(error)), copy.deepcopy(error), copy.copy(error)):
            assert (type(other), str(other), vars(other).keys()) == (type(error), str(error), vars(error).keys())
        for value in vars(error).values():
            assert_copies(value)
    assert "did you mean cogiro" in str(errors[0])

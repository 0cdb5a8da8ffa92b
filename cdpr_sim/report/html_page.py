"""A page in one file, which loads nothing from the network: a robot to turn, and the results of both methods.

The robot is drawn on the page's own canvas: a dozen lines and a box need no WebGL and no library of megabytes, print as
they are, and turn by keyboard.
"""

from __future__ import annotations

import io
import json
import math
import os
import tempfile
from collections.abc import Callable
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from rich.markup import escape as plain
from rich.table import Table
from rich.text import Text

from cdpr_sim.analysis.workspace.grids import GridLike
from cdpr_sim.core.checks import FLAG, refuse_unless
from cdpr_sim.core.describe import newtons
from cdpr_sim.core.equilibrium import Equilibrium
from cdpr_sim.core.files import check_place, write_whole
from cdpr_sim.core.pose import PoseLike
from cdpr_sim.core.robot import Robot
from cdpr_sim.core.status import Status
from cdpr_sim.crosscheck.check import OUTCOMES
from cdpr_sim.drawing import maps
from cdpr_sim.drawing.cable_curves import cable_curve, wheel_of
from cdpr_sim.drawing.video.film import write_video
from cdpr_sim.report import crosscheck_tables, html, workspace_tables
from cdpr_sim.report.analysis_tables import modes_table
from cdpr_sim.report.robot_tables import cables_table, robot_table, trajectory_table
from cdpr_sim.report.table_style import new_table
from cdpr_sim.robots.catalogue import load_robot
from cdpr_sim.studies.robot_summary import RobotSummary, View, portray

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SUFFIXES = (".html", ".htm")

FILM_SIZE, FILM_RATE = (640, 360), 12.0
"""[pixel], [frames per second] Some 0.3 MB (``scripts/measure_constants.py``)."""

DIGITS = 7
"""Of a coordinate on the page: a tenth of a micrometre of a metre."""

FRONT = (0.0, 0.0)
"""Degrees around and above from which a planar robot is seen; others are from a little beside and above."""

BESIDE = (25.0, 15.0)

POLICY = "default-src 'none'; img-src data:; media-src data:; style-src 'unsafe-inline'; script-src 'unsafe-inline'"
"""What the browser lets the page do: nothing but what is in it."""

_MAPS = {
    "tilt": ("Tilt of the platform", "How far its upright axis leans from the vertical. Dark is bad."),
    "distance": ("Deviation", "How far the platform ends up from where it was commanded. Dark is bad."),
    "slack_count": ("Slack cables", "How many cables carry nothing, and leave the platform to the others."),
    "feasible": (
        "Feasibility",
        "Where cables that pull, and do not stretch, could hold the platform just as commanded (static feasible "
        "workspace).",
    ),
}
"""What each map shows, and how to read it."""

_HERE = Path(__file__).parent


def write_report(
    path: str | Path,
    robot: str | Robot,
    pose: PoseLike | None = None,
    *,
    grid: GridLike | None = None,
    video: bool = True,
    force: bool = False,
    progress: Callable[[str], None] = lambda _: None,
) -> Path:
    """Write a page about a robot, to be opened in any browser and handed on: a single file, without network access.

    It shows the robot in space, to turn by mouse, slider or arrow keys, where it rests and where it was commanded, the
    tensions and which cables are slack, by MuJoCo and by the static solver; the worst poses of its workspace; maps of
    tilt, deviation, slack cables and feasibility; a film of a drive across; and the numbers that it is made of.

    Args:
        path: of the file, ending in .html.
        robot: the robot, its name in the catalogue, or a .toml file.
        pose: that it begins with; default: the middle of the workspace.
        grid: counts (nx, ny, nz) over the workspace, or coordinates {"x": ..., "y": ..., "z": ...} [m], of the poses
            that are settled in MuJoCo; default: (7, 5, 4).
        video: whether to film a drive.
        force: replace a file that is there.
        progress: called with what begins, in words.

    Returns:
        The path.

    Raises:
        InvalidInput: a path that cannot be written, a file that is there, a pose or a grid that cannot be right.
        UnknownName: no such robot.
        StoreError: a full disk.
    """
    refuse_unless(FLAG, video=video, force=force)
    refuse_unless(Callable, progress=progress)
    path = check_place(path, SUFFIXES, force=force)
    refuse_unless(Robot | str | os.PathLike, robot=robot)
    machine = robot if isinstance(robot, Robot) else load_robot(robot)
    robot_summary = portray(machine, pose, grid=grid, motion=video, progress=progress)
    progress("Drawing")
    write_whole({path: html_page(robot_summary).encode()})
    return path


def html_page(robot_summary: RobotSummary) -> str:
    """The page as text."""
    robot, views = robot_summary.robot, (robot_summary.first, *robot_summary.worst)
    sections = {
        "The robot, to turn": _scene(robot_summary, views),
        "The worst poses": _worst(robot_summary),
        "Maps of the workspace": _maps(robot_summary),
        "A drive across": _film(robot_summary),
        "Its numbers": _numbers(robot_summary),
        "How to read this": _explained(robot_summary),
    }
    names = {title: f"section-{number}" for number, title in enumerate(sections, start=1) if sections[title]}
    links = "".join(f'<a href="#{name}">{title}</a>' for title, name in names.items())
    body = "".join(
        f'<section aria-labelledby="{name}"><h2 id="{name}">{title}</h2>{sections[title]}</section>'
        for title, name in names.items()
    )
    return (
        '<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8">'
        f'<meta http-equiv="Content-Security-Policy" content="{POLICY}">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        '<link rel="icon" href="data:,">'
        f"<title>{escape(robot.name)}: where the platform really ends up</title>"
        f"<style>{(_HERE / 'page.css').read_text(encoding='utf-8')}</style></head><body>"
        f'<header><h1>{escape(robot.name)}</h1><p class="lead">{escape(robot.description)}</p>'
        f'<nav aria-label="Sections">{links}</nav>{_summary(robot_summary)}</header><main>{body}</main>'
        f"<footer><p>Written by cdpr_sim {escape(_version())}. The page is all in this one file.</p></footer>"
        f'<script type="application/json" id="scene">{_embedded(_data(robot, views))}</script>'
        f"<script>{(_HERE / 'page.js').read_text(encoding='utf-8')}</script></body></html>\n"
    )


def _summary(robot_summary: RobotSummary) -> str:
    """What a stranger should take along: where it rests here, where it is worst, and whether the two methods agree."""
    poses = robot_summary.check.dataset["outcome"].size
    lines = list(workspace_tables.check_lines(robot_summary.check))
    told = [_words(robot_summary.robot, robot_summary.first)]
    if robot_summary.worst and robot_summary.check.agrees:
        away, tilt = _short(1e3 * robot_summary.most[0]), _short(math.degrees(robot_summary.most[1]))
        told.append(f"At the {poses:,} poses that were settled it is up to {away} mm away and tilted by up to {tilt}°.")
    no = "" if robot_summary.check.agrees else " no"
    return f'<div class="verdict{no}">{html.sentences(*map(plain, told), *lines)}</div>'


def _scene(robot_summary: RobotSummary, views: tuple[View, ...]) -> str:
    turn, height = FRONT if robot_summary.robot.mobility == "planar" else BESIDE
    names = ["asked for", *(f"worst {n}" for n in range(1, len(views)))]
    options = "".join(
        f"<option>{name}: ({_millimetres(view)}) mm</option>" for name, view in zip(names, views, strict=True)
    )
    answers = "".join(
        f'<div data-view="{number}"{" hidden" if number else ""}>{_answer(view)}</div>'
        for number, view in enumerate(views)
    )
    method = crosscheck_tables.heading(crosscheck_tables.best_point(views[0].settled))
    return f"""
<div class="side"><figure>
<canvas id="robot" tabindex="0" role="img" aria-label="{escape(_words(robot_summary.robot, views[0]))}"
 aria-describedby="keys"></canvas>
<ul class="legend">
<li><svg viewBox="0 0 30 14" aria-hidden="true"><rect x="4" y="2" width="22" height="10" fill="var(--platform)"
 stroke="var(--ink)"/></svg>platform at rest, by {escape(method)}</li>
<li><svg viewBox="0 0 30 14" aria-hidden="true"><rect x="4" y="2" width="22" height="10" fill="none"
 stroke="var(--commanded)" stroke-dasharray="4 3"/></svg>where it was commanded</li>
<li><svg viewBox="0 0 30 14" aria-hidden="true"><path d="M1 7H29" stroke="var(--ink)" stroke-width="1.6"/></svg>taut
 cable and its tension</li>
<li><svg viewBox="0 0 30 14" aria-hidden="true"><path d="M1 7H29" stroke="var(--slack)" stroke-width="2.4"
 stroke-dasharray="1 5" stroke-linecap="round"/></svg>slack cable</li>
</ul>
<div class="controls">
<label class="wide" for="pose">Pose<select id="pose">{options}</select></label>
<label for="turn">Turn<input id="turn" type="range" min="-180" max="180" step="any" value="{turn:g}"></label>
<label for="height">From above<input id="height" type="range" min="-10" max="90" step="any" value="{height:g}"></label>
<label for="zoom">Zoom<input id="zoom" type="range" min="1" max="10" step="any" value="1"></label>
<label for="tensions"><input id="tensions" type="checkbox" checked>tensions</label>
<label for="commanded"><input id="commanded" type="checkbox" checked>commanded pose</label>
<button id="reset" type="button">Reset the view</button>
</div>
<p class="keys" id="keys">Drag the picture, move the sliders, or give it the keyboard: arrow keys turn it, + and −
 zoom in on the platform, Home goes back.</p>
<figcaption id="said" aria-live="polite"></figcaption>
<noscript><p>This picture turns where scripts are allowed.</p></noscript>
</figure><div>{answers}</div></div>"""


def _answer(view: View) -> str:
    """Both methods' numbers at one pose, a column for each, and whether they agree."""
    table = crosscheck_tables.settle_table(view.problem, [view.settled, view.solved])
    lines = [plain(found.reason) for found in (view.settled, view.solved) if not isinstance(found, Equilibrium)]
    if view.agreement is not None:
        lines.append(crosscheck_tables.verdict(view.agreement))
    return _wide(table) + html.sentences(*lines)


def _worst(robot_summary: RobotSummary) -> str:
    if not robot_summary.worst:
        return ""
    buttons = "".join(
        f'<button type="button" data-show="{number}">Show {number} above</button>'
        for number in range(1, len(robot_summary.worst) + 1)
    )
    axes = robot_summary.check.dataset
    counts = " × ".join(str(axes.sizes[name]) for name in "xyz")
    return (
        html.sentences(
            f"Of {counts} poses along x, y and z of the workspace: those where the methods do not agree, if any, and "
            "then those where the platform ends up farthest from where it was commanded, turning counted by what its "
            "anchors see. Of poses that are equally far off, to a thousandth, as by symmetry, one is listed."
        )
        + _wide(_worst_table(robot_summary), "The worst poses")
        + f'<div class="controls">{buttons}</div>'
        + _wide(workspace_tables.check_table(robot_summary.check))
    )


def _worst_table(robot_summary: RobotSummary) -> Table:
    """A row for each pose, with a column for each method, headed by the source that its result carries."""
    methods = [
        next(
            (
                crosscheck_tables.heading(point)
                for view in robot_summary.worst
                if (point := crosscheck_tables.best_point(pick(view)))
            ),
            "",
        )
        for pick in (lambda view: view.settled, lambda view: view.solved)
    ]
    shown: dict[str, Callable[[Equilibrium], str]] = {
        "deviation\n[mm]": lambda rest: f"{1e3 * np.linalg.norm(rest.deviation):.3f}",
        "tilt\n[°]": lambda rest: f"{np.degrees(rest.tilt):.3f}",
        "slack\ncables": lambda rest: ", ".join(str(one + 1) for one in np.flatnonzero(rest.slack)) or "none",
    }
    headings = [f"{label}\n{method}" for label in shown for method in methods]
    table = new_table("", "pose", "commanded to\nx, y, z [mm]", *headings, "methods\napart\n[mm]", "verdict")
    for number, view in enumerate(robot_summary.worst, start=1):
        cells = [
            show(found) if isinstance(found, Equilibrium) else "[red]no rest[/]"
            for show in shown.values()
            for found in (view.settled, view.solved)
        ]
        apart = "" if view.agreement is None else f"{1e3 * view.agreement.position_error:.1e}"
        table.add_row(str(number), _millimetres(view), *cells, apart, _verdict(view))
    return table


def _verdict(view: View) -> str:
    if view.agreement is None:
        return "[red]no answer[/]"
    words = view.agreement.verdict.name.lower().replace("_", " ")
    return f"[green]{words}[/]" if view.agreement.agrees else f"[red]{words}[/]"


def _maps(robot_summary: RobotSummary) -> str:
    figures, why_there = [], ""
    dataset, data = robot_summary.plane, robot_summary.check.dataset
    if dataset is not None:
        place = f" at y = {_short(1e3 * float(dataset['y'][0]))} mm" * (robot_summary.robot.mobility == "spatial")
        if place and robot_summary.worst:
            why_there = f"Maps{place}: the first of the worst poses lies there."
        for name, (what, how) in _MAPS.items():
            if name in dataset:
                figure = maps.draw_elastic_map(dataset, names=[name])
                figures.append(_figure(figure, f"{what}{place}, {_range(dataset, name)}", how))
    if dataset is not None and min(data.sizes["x"], data.sizes["z"]) > 1:
        across = robot_summary.check.across()
        agree = int((data["outcome"] == OUTCOMES.index("agree")).sum())
        words = f"Where MuJoCo and the static solver agree: plainly at {agree} of {data['outcome'].size} poses"
        why = "The worst along y of the poses that were settled in MuJoCo; beside it, how far the two are apart."
        figures.append(_figure(maps.draw_agreement_map(across), words, why, "both"))
    return f'{html.sentences(why_there)}<div class="maps">{"".join(figures)}</div>' if figures else ""


def _range(dataset: Any, name: str) -> str:
    """Of a map, in words: what those read who do not see it."""
    values = dataset[name].values[dataset["status"].values == Status.CONVERGED].astype(float)
    if not values.size:
        return "no equilibrium anywhere"
    if name == "feasible":
        return f"at {100 * dataset[name].values.mean():.3g} % of the poses"
    size, unit = {"tilt": (180 / np.pi, "°"), "distance": (1e3, " mm"), "slack_count": (1.0, "")}[name]
    least, most = (f"{round(size * end, 3):g}{unit}" for end in (values.min(), values.max()))
    return f"from {least} to {most}"


def _figure(figure: Figure, words: str, why: str, kind: str = "one") -> str:
    buffer = io.BytesIO()
    figure.savefig(buffer, format="svg", metadata={"Date": None})
    picture = f'<img alt="Map: {escape(words)}." src="{html.data(buffer.getvalue(), "image/svg+xml")}">'
    return (
        f'<figure class="{kind}">{_scrolling(picture, words)}'
        f"<figcaption><b>{escape(words)}.</b> {escape(why)}</figcaption></figure>"
    )


def _film(robot_summary: RobotSummary) -> str:
    motion = robot_summary.motion
    if motion is None:
        return ""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "film.mp4"
        shapes, seconds = robot_summary.shapes, len(motion) / FILM_RATE
        write_video(path, motion, robot_summary.static, shapes=shapes, seconds=seconds, fps=FILM_RATE, size=FILM_SIZE)
        source = html.data(path.read_bytes(), "video/mp4")
    words = (
        f"Film: the winches drive {robot_summary.robot.name} along x in MuJoCo; the yellow outline "
        "is the static solver's pose."
    )
    return (
        f'<figure><video controls loop muted playsinline preload="auto" aria-label="{escape(words)}" src="{source}">'
        f"</video><figcaption>{escape(words)}</figcaption></figure>{_wide(trajectory_table(motion))}"
    )


def _numbers(robot_summary: RobotSummary) -> str:
    robot = robot_summary.robot
    modes = [] if robot_summary.modes is None else [_wide(modes_table(robot_summary.modes))]
    said = html.sentences(*map(plain, (*robot.warnings, *robot.notes)))
    return "".join([_wide(robot_table(robot)), _wide(cables_table(robot)), *modes, said])


def _explained(robot_summary: RobotSummary) -> str:
    return html.sentences(
        "A [bold]cable-driven parallel robot[/] moves a platform by winding cables. Cables stretch and can only pull, "
        "so that the platform does not end up where its winches, which believe in rigid cables, [bold]command[/] it: "
        "it sags, shifts and tilts, and some cables go [bold]slack[/].",
        "Its true pose is computed by two methods that share no physics code: [bold]MuJoCo[/] lets a model "
        "of it come to rest, and [bold]Newton[/] solves for the pose where all forces balance. Each column is headed "
        "by the method that its numbers come from. They [bold]agree[/] where position, rotation, tensions and slack "
        "cables are the same and each finds the other's pose at rest; they agree but for what is [bold]free[/] where "
        "nothing holds the platform in some direction, and it may rest anywhere along it.",
        "[bold]Sag[/] is how much lower the platform hangs than commanded, [bold]deviation[/] its distance from there, "
        "[bold]tilt[/] the angle between its upright axis and the vertical.",
        *map(plain, robot_summary.missing),
    )


def _words(robot: Robot, view: View) -> str:
    """A view in a sentence, for those who do not see it as well."""
    head = f"{robot.name}, commanded to ({_millimetres(view)}) mm"
    rest = _rest(view)
    if rest is None:
        return f"{head}, does not come to rest in MuJoCo."
    slack = [str(cable + 1) for cable in np.flatnonzero(rest.slack)]
    said = f"cable{'s' if len(slack) > 1 else ''} {', '.join(slack)} slack" if slack else "no cable slack"
    place, away = ", ".join(_short(1e3 * value) for value in rest.position), 1e3 * float(np.linalg.norm(rest.deviation))
    return (
        f"{head}, comes to rest at ({place}) mm, {_short(away)} mm away, tilted by {_short(math.degrees(rest.tilt))}°, "
        f"{said}."
    )


def _rest(view: View) -> Equilibrium | None:
    return view.settled if isinstance(view.settled, Equilibrium) else None


def _millimetres(view: View) -> str:
    return ", ".join(_short(1e3 * value) for value in view.problem.pose.translation)


def _short(value: float) -> str:
    """A number in a sentence, which a table has in full: 5.29, 0.07, 1,780."""
    return f"{value:,.0f}" if abs(value) >= 1000 else f"{round(value, 2) + 0.0:g}"


def _data(robot: Robot, views: tuple[View, ...]) -> dict[str, Any]:
    """What the canvas draws."""
    anchors = views[0].problem.pose.translation + robot.anchors @ views[0].problem.pose.rotation.as_matrix().T
    wheels = [wheel_of(robot.cabling, cable, anchor) for cable, anchor in enumerate(anchors)]
    return {
        "robot": {
            "frame": _rounded(robot.frame),
            "platform": _rounded(robot.platform_size),
            "exits": _rounded(robot.exits),
            "wheels": [_rounded(wheel.arc()) for wheel in wheels if wheel is not None],
        },
        "views": [_drawn(robot, view) for view in views],
    }


def _drawn(robot: Robot, view: View) -> dict[str, Any]:
    rest = _rest(view)
    pose = view.problem.pose if rest is None else rest.pose
    anchors = pose.translation + robot.anchors @ pose.rotation.as_matrix().T
    cabling = robot.cabling if rest is not None else robot.replace(linear_density=0.0).cabling  # no rest, no shape
    cables = []
    for cable, anchor in enumerate(anchors):
        slack = rest is not None and bool(rest.slack[cable])
        length = float(rest.rest_lengths[cable]) if rest is not None and slack else None
        shape = None if view.shapes is None else view.shapes[cable]
        way = cable_curve(cabling, cable, anchor, length, shape)
        words = (
            "" if rest is None else crosscheck_tables.SLACK if slack else newtons(float(f"{rest.tensions[cable]:.3g}"))
        )
        cables.append({"way": _rounded(way), "slack": slack, "words": words})
    return {
        "words": _words(robot, view),
        "commanded": _placed(view.problem.pose),
        "platform": _placed(pose),
        "cables": cables,
    }


def _placed(pose: Any) -> dict[str, Any]:
    return {"position": _rounded(pose.translation), "rotation": _rounded(pose.rotation.as_matrix())}


def _rounded(values: np.ndarray) -> list:
    return np.round(values, DIGITS).tolist()


def _embedded(value: dict[str, Any]) -> str:
    """JSON that nothing in it can end."""
    return json.dumps(value, allow_nan=False, separators=(",", ":")).replace("<", "\\u003c")


def _wide(table: Table, title: str = "") -> str:
    """A table that scrolls by itself where the page is too narrow for it."""
    return _scrolling(html.table(table), title or " ".join(Text.from_markup(str(table.title)).plain.split()))


def _scrolling(content: str, label: str) -> str:
    return f'<div class="wide-content" tabindex="0" role="region" aria-label="{escape(label)}">{content}</div>'


def _version() -> str:
    import cdpr_sim

    return str(cdpr_sim.__version__)

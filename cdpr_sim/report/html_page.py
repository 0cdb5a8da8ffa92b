"""Self-contained HTML report of a robot: an interactive 3D view, and the results of both methods.

The robot is drawn on a 2D canvas: a dozen lines and a box need neither WebGL nor a large library, can be printed, and
rotate by keyboard.
"""

from __future__ import annotations

import json
import math
import os
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from rich.markup import escape as plain
from rich.table import Table
from rich.text import Text

from cdpr_sim.analysis.workspace.grids import GridLike
from cdpr_sim.core import extras
from cdpr_sim.core.checks import FLAG, refuse_unless
from cdpr_sim.core.describe import newtons
from cdpr_sim.core.equilibrium import Equilibrium
from cdpr_sim.core.files import check_place, write_whole
from cdpr_sim.core.pose import PoseLike
from cdpr_sim.core.robot import Robot, without_mass
from cdpr_sim.core.status import Status
from cdpr_sim.crosscheck.check import OUTCOMES
from cdpr_sim.drawing import maps
from cdpr_sim.drawing.cable_curves import cable_curve, wheel_of, with_moved_exits
from cdpr_sim.report import crosscheck_tables, html, workspace_tables
from cdpr_sim.report.analysis_tables import modes_table
from cdpr_sim.report.robot_summary import RobotSummary, View, summarise, write_both_methods
from cdpr_sim.report.robot_tables import cables_table, robot_table, trajectory_table
from cdpr_sim.report.table_style import new_table
from cdpr_sim.robots.catalogue import load_robot

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SUFFIXES = (".html", ".htm")

VIDEO_SIZE, VIDEO_RATE = (640, 360), 12.0
"""[pixel], [frames per second] About 0.3 MB (``scripts/dev/measure_constants.py``)."""

DIGITS = 7
"""Decimals of a coordinate on the page: 0.1 µm."""

FRONT = (0.0, 0.0)
"""Azimuth and elevation [°] of the view of a planar robot; ``BESIDE`` for other robots."""

BESIDE = (25.0, 15.0)

POLICY = "default-src 'none'; img-src data:; media-src data:; style-src 'unsafe-inline'; script-src 'unsafe-inline'"
"""Content security policy: the page may use only its own content."""

_MAPS = {
    "tilt": ("Tilt of the platform", "Angle between the platform's z axis and the vertical. Dark is large."),
    "distance": ("Deviation", "Distance between the equilibrium and the commanded position. Dark is large."),
    "slack_count": ("Slack cables", "Number of cables that are not stretched and hardly pull."),
    "feasible": (
        "Feasibility",
        "Poses that rigid cables can hold exactly as commanded (static feasible workspace).",
    ),
}
"""Title and explanation of each map."""

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
    """Write a self-contained HTML report of a robot, which opens in any browser without network access.

    It shows the robot in 3D (rotated by mouse, sliders or arrow keys) at the commanded pose and at equilibrium, with
    tensions and slack cables, by MuJoCo and by the static solver; the worst poses of its workspace; maps of tilt,
    deviation, slack cables and feasibility; a video of a drive across the workspace; and tables of its parameters.

    Args:
        path: of the file, ending in .html.
        robot: the robot, its name in the catalogue, or a .toml file.
        pose: shown first; default: the middle of the workspace.
        grid: counts (nx, ny, nz) over the workspace, or coordinates {"x": ..., "y": ..., "z": ...} [m], of the poses
            that are settled in MuJoCo; default: (7, 5, 4).
        video: whether to include a video of a drive.
        force: whether to replace an existing file.
        progress: called with a description of each step.

    Returns:
        The path.

    Raises:
        InvalidInput: a path that cannot be written, an existing file, an invalid pose or grid.
        UnknownName: no such robot.
        StoreError: a full disk.
        MissingExtra: a library of the extra ``report``, or of ``video`` if ``video``, is not installed.
    """
    refuse_unless(FLAG, video=video, force=force)
    refuse_unless(Callable, progress=progress)
    path = check_place(path, SUFFIXES, force=force)
    extras.require("report", "write_report")
    if video:
        extras.require("video", "write_report with video")
    refuse_unless(Robot | str | os.PathLike, robot=robot)
    summary = summarise(
        robot if isinstance(robot, Robot) else load_robot(robot), pose, grid=grid, motion=video, progress=progress
    )
    progress("Drawing")
    write_whole({path: html_page(summary).encode()})
    return path


def html_page(summary: RobotSummary) -> str:
    """The page as text."""
    import jinja2
    from markupsafe import Markup

    import cdpr_sim

    def as_html(part: Table | str | Sequence[str]) -> Markup:
        """Tables, and sentences in rich's markup."""
        if isinstance(part, Table):
            return Markup(html.table(part))
        return Markup(html.sentences(*([part] if isinstance(part, str) else part)))

    robot, views, video = summary.robot, (summary.first, *summary.worst), _video(summary)
    turn, height = FRONT if robot.mobility == "planar" else BESIDE
    modes = [] if summary.modes is None else [modes_table(summary.modes)]
    titles = {
        "3D view": True, "The worst poses": summary.worst, "Maps of the workspace": summary.plane is not None,
        "Drive across the workspace": video, "Parameters": True, "Explanation": True,
    }  # fmt: skip
    page = jinja2.Environment(
        loader=jinja2.FileSystemLoader(_HERE), autoescape=True, undefined=jinja2.StrictUndefined, trim_blocks=True,
        lstrip_blocks=True,
    )  # fmt: skip
    page.filters |= {
        "html": as_html,
        "heading": lambda sheet: " ".join(Text.from_markup(str(sheet.title)).plain.split()),
    }
    return page.get_template("html_page.html.jinja").render(
        robot=robot,
        version=cdpr_sim.__version__,
        policy=POLICY,
        style=Markup((_HERE / "html_page.css").read_text(encoding="utf-8")),
        script=Markup((_HERE / "html_page.js").read_text(encoding="utf-8")),
        scene=Markup(_embedded(_data(robot, views))),
        sections={title: f"section-{number}" for number, title in enumerate(titles, start=1) if titles[title]},
        agrees=summary.check.agrees,
        summary=_summary(summary),
        method=_heading(views[0].settled),
        turn=f"{turn:g}",
        height=f"{height:g}",
        views=[_shown(robot, view, number) for number, view in enumerate(views)],
        worst=_worst(summary) if summary.worst else None,
        place=_place(summary) if summary.worst else "",
        maps=_maps(summary),
        video=video,
        parameters=[robot_table(robot), cables_table(robot), *modes],
        notes=[plain(note) for note in (*robot.warnings, *robot.notes)],
        missing=[plain(sentence) for sentence in summary.missing],
    )


def _summary(summary: RobotSummary) -> list[str]:
    """Summary: the equilibrium at the first pose, the worst pose, and whether the two methods agree."""
    poses = summary.check.dataset["outcome"].size
    sentences = [_description(summary.robot, summary.first)]
    if summary.worst and summary.check.agrees:
        away, tilt = _short(1e3 * summary.most[0]), _short(math.degrees(summary.most[1]))
        sentences.append(
            f"At the {poses:,} poses settled, the deviation is up to {away} mm and the tilt up to {tilt}°."
        )
    return [*map(plain, sentences), *workspace_tables.check_lines(summary.check)]


def _shown(robot: Robot, view: View, number: int) -> dict[str, Any]:
    """One pose: its name, results of both methods, a column for each, and whether they agree."""
    lines = [plain(result.reason) for result in (view.settled, view.solved) if not isinstance(result, Equilibrium)]
    if view.agreement is not None:
        lines.append(crosscheck_tables.verdict(view.agreement))
    return {
        "name": f"worst {number}" if number else "requested",
        "commanded": _millimetres(view),
        "description": _description(robot, view),
        "table": crosscheck_tables.settle_table(view.problem, [view.settled, view.solved]),
        "lines": lines,
    }


def _worst(summary: RobotSummary) -> dict[str, Any]:
    data = summary.check.dataset
    return {
        "counts": " × ".join(str(data.sizes[name]) for name in "xyz"),
        "table": _worst_table(summary),
        "check": workspace_tables.check_table(data),
    }


def _worst_table(summary: RobotSummary) -> Table:
    """A row for each pose, with a column for each method, headed by the source of its result."""
    outcomes = zip(*((view.settled, view.solved) for view in summary.worst), strict=True)
    methods = [next(filter(None, map(_heading, of_method)), "") for of_method in outcomes]
    shown: dict[str, Callable[[Equilibrium], str]] = {
        "deviation\n[mm]": lambda point: f"{1e3 * np.linalg.norm(point.deviation):.3f}",
        "tilt\n[°]": lambda point: f"{np.degrees(point.tilt):.3f}",
        "slack\ncables": lambda point: ", ".join(str(one + 1) for one in np.flatnonzero(point.slack)) or "none",
    }
    headings = [f"{label}\n{method}" for label in shown for method in methods]
    table = new_table("", "pose", "commanded to\nx, y, z [mm]", *headings, "diff.\n[mm]", "verdict")
    for number, view in enumerate(summary.worst, start=1):
        cells = [
            show(result) if isinstance(result, Equilibrium) else "[red]none[/]"
            for show in shown.values()
            for result in (view.settled, view.solved)
        ]
        difference = "" if view.agreement is None else f"{1e3 * view.agreement.position_error:.1e}"
        table.add_row(str(number), _millimetres(view), *cells, difference, _verdict(view))
    return table


def _heading(outcome: crosscheck_tables.Outcome) -> str:
    return crosscheck_tables.heading(crosscheck_tables.best_point(outcome))


def _verdict(view: View) -> str:
    if view.agreement is None:
        return "[red]no result[/]"
    name = view.agreement.verdict.name.lower().replace("_", " ").replace(" except", ",")  # to fit on A4
    return f"[green]{name}[/]" if view.agreement.agrees else f"[red]{name}[/]"


def _place(summary: RobotSummary) -> str:
    """Where the plane of the maps is; empty for planar robots."""
    if summary.plane is None or summary.robot.mobility != "spatial":
        return ""
    return f" at y = {_short(1e3 * float(summary.plane['y'][0]))} mm"


def _maps(summary: RobotSummary) -> list[dict[str, str]]:
    dataset, data, place = summary.plane, summary.check.dataset, _place(summary)
    if dataset is None:
        return []
    figures = [
        _map(maps.draw_elastic_map(dataset, names=[name]), f"{title}{place}, {_range(dataset, name)}", explanation)
        for name, (title, explanation) in _MAPS.items()
        if name in dataset
    ]
    if min(data.sizes["x"], data.sizes["z"]) > 1:
        across = summary.check.across()
        agree = int((data["outcome"] == OUTCOMES.index("agree")).sum())
        title = (
            f"Agreement of MuJoCo and the static solver, at {agree} of {data['outcome'].size} poses without reservation"
        )
        explanation = (
            "Worst outcome along y over the poses settled in MuJoCo, and the difference between the two methods."
        )
        figures.append(_map(maps.draw_agreement_map(across), title, explanation, "both"))
    return figures


def _range(dataset: Any, name: str) -> str:
    """Range of a map's values, for its alternative text."""
    values = dataset[name].values[dataset["status"].values == Status.CONVERGED].astype(float)
    if not values.size:
        return "no equilibrium anywhere"
    if name == "feasible":
        return f"at {100 * dataset[name].values.mean():.3g} % of the poses"
    size, unit = {"tilt": (180 / np.pi, "°"), "distance": (1e3, " mm"), "slack_count": (1.0, "")}[name]
    least, most = (f"{round(size * end, 3):g}{unit}" for end in (values.min(), values.max()))
    return f"from {least} to {most}"


def _map(figure: Figure, title: str, explanation: str, kind: str = "one") -> dict[str, str]:
    from cdpr_sim.drawing.figures import encoded

    source = html.data(encoded(figure, "svg"), "image/svg+xml")
    return {"title": title, "explanation": explanation, "kind": kind, "source": source}


def _video(summary: RobotSummary) -> dict[str, Any] | None:
    motion = summary.motion
    if motion is None:
        return None
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "film.mp4"
        write_both_methods(path, [motion], seconds=len(motion) / VIDEO_RATE, fps=VIDEO_RATE, size=VIDEO_SIZE)
        source = html.data(path.read_bytes(), "video/mp4")
    return {"robot": summary.robot.name, "source": source, "table": trajectory_table(motion)}


def _description(robot: Robot, view: View) -> str:
    """A view in a sentence, also its alternative text."""
    head = f"{robot.name}, commanded to ({_millimetres(view)}) mm"
    settled = _settled(view)
    if settled is None:
        return f"{head}, does not settle in MuJoCo."
    slack = [str(cable + 1) for cable in np.flatnonzero(settled.slack)]
    cables = f"cable{'s' if len(slack) > 1 else ''} {', '.join(slack)} slack" if slack else "no cable slack"
    place = ", ".join(_short(1e3 * value) for value in settled.position)
    deviation, tilt = 1e3 * float(np.linalg.norm(settled.deviation)), math.degrees(settled.tilt)
    return f"{head}: equilibrium at ({place}) mm, deviation {_short(deviation)} mm, tilt {_short(tilt)}°, {cables}."


def _settled(view: View) -> Equilibrium | None:
    return view.settled if isinstance(view.settled, Equilibrium) else None


def _millimetres(view: View) -> str:
    return ", ".join(_short(1e3 * value) for value in view.problem.pose.translation)


def _short(value: float) -> str:
    """A number rounded for a sentence: 5.29, 0.07, 1,780."""
    return f"{value:,.0f}" if abs(value) >= 1000 else f"{round(value, 2) + 0.0:g}"


def _data(robot: Robot, views: tuple[View, ...]) -> dict[str, Any]:
    """Data of the 3D view."""
    anchors = views[0].problem.pose.apply(robot.anchors)
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
    settled = _settled(view)
    pose = view.problem.pose if settled is None else settled.pose
    anchors = pose.apply(robot.anchors)
    # Without an equilibrium there is no cable profile: cables are drawn straight.
    moved = without_mass(robot) if settled is None else with_moved_exits(robot, anchors, settled.tensions, view.shapes)
    cabling = moved.cabling
    cables = []
    for cable, anchor in enumerate(anchors):
        slack = settled is not None and bool(settled.slack[cable])
        length = float(settled.rest_lengths[cable]) if settled is not None and slack else None
        shape = None if view.shapes is None else view.shapes[cable]
        curve = cable_curve(cabling, cable, anchor, length, shape)
        if settled is None:
            label = ""
        else:
            tension = float(f"{settled.tensions[cable]:.3g}")
            label = crosscheck_tables.tension_cell(slack, newtons(tension))
        cables.append({"curve": _rounded(curve), "slack": slack, "label": label})
    return {
        "description": _description(robot, view),
        "commanded": _placed(view.problem.pose),
        "platform": _placed(pose),
        "cables": cables,
    }


def _placed(pose: Any) -> dict[str, Any]:
    return {"position": _rounded(pose.translation), "rotation": _rounded(pose.rotation.as_matrix())}


def _rounded(values: np.ndarray) -> list:
    return np.round(values, DIGITS).tolist()


def _embedded(value: dict[str, Any]) -> str:
    """JSON escaped so that its content cannot close the script element."""
    return json.dumps(value, allow_nan=False, separators=(",", ":")).replace("<", "\\u003c")

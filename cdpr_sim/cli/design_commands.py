"""Commands for the layout of exits and anchors: design, front, clearances."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.markup import escape

import cdpr_sim as cdpr
from cdpr_sim.cli.command_classes import numbers_in
from cdpr_sim.cli.options import AsJson, MaterialName, Pretension, RobotName, robot_of
from cdpr_sim.cli.terminal import DISAGREE, busy, print_json, print_parts, progress_bars

if TYPE_CHECKING:
    import numpy as np

GRID = (5, 3, 3)
VIDEO_SECONDS, VIDEO_FPS = 8.0, 25.0

MOST_FILES = 1000
"""Largest number of robot files written for a Pareto front."""

OBJECTIVES = (
    "worst tilt, mean tilt, worst deviation, mean deviation, most slack cables, mean slack cables, lowest tension, "
    "highest tension, softest stiffness, lowest frequency, feasible volume (share of poses that rigid cables hold), "
    "worst sensitivity (of the pose to errors of exits and anchors), points moved (of exits and anchors, the one that "
    "moved most) or size of frame (diagonal of the box around the exits)"
)
"""For ``--help``."""

BYTES_PER_CASE = 200
"""Memory per pose, before the search begins."""

Positions = Annotated[
    tuple[int, int, int] | None,
    typer.Option(
        "--grid", metavar="NX NY NZ", help="Number of poses along x, y and z of the workspace; default: 5 3 3."
    ),
]
Line = Annotated[
    tuple[float, float, float, float, float, float] | None,
    typer.Option("--line", metavar="X0 Y0 Z0 X1 Y1 Z1", help="Poses along a line [m], instead of a grid."),
]
Points = Annotated[int, typer.Option("--points", min=2, help="Number of poses along that line.")]

Moves = Annotated[
    list[str] | None,
    typer.Option(
        "--move",
        metavar="WHAT[=RANGE]",
        help="exits, anchors, pulleys, center_of_mass [m], axial_stiffness or diameter [factor]; repeatable. RANGE "
        "as for --within.",
    ),
]
Within = Annotated[
    str,
    typer.Option(
        "--within",
        metavar="RANGE",
        help="[m] Default range of --move: one number, or DX,DY,DZ, or the corners of a box, X0,Y0,Z0,X1,Y1,Z1.",
    ),
]
Along = Annotated[
    tuple[float, float, float] | None,
    typer.Option("--along", metavar="X Y Z", help="Points move only along this direction (rail, mast)."),
]
SymmetryName = Annotated[str, typer.Option("--symmetry", help="detected, none, half-turn, mirror-x or mirror-y.")]
Seed = Annotated[int, typer.Option("--seed", min=0, help="Random seed; the same seed gives the same layout.")]
Generations = Annotated[int, typer.Option("--generations", min=1, help="Maximum number of generations.")]


def design(
    robot: RobotName,
    move: Moves = None,
    within: Within = "0.05",
    along: Along = None,
    symmetry: SymmetryName = "detected",
    objective: Annotated[str, typer.Option("--objective", help=f"{OBJECTIVES}.")] = "worst tilt",
    grid: Positions = None,
    line: Line = None,
    points: Points = 18,
    tensions: Annotated[
        tuple[float, float] | None, typer.Option("--tension-limits", metavar="MIN MAX", help="Tension limits [N].")
    ] = None,
    taut: Annotated[bool, typer.Option("--taut", help="All cables must be taut.")] = False,
    stable: Annotated[bool, typer.Option("--stable", help="All equilibria must be stable.")] = False,
    clearance: Annotated[float | None, typer.Option("--clearance", help="Minimum clearance of cables [m].")] = None,
    limit: Annotated[
        list[str] | None,
        typer.Option(
            "--limit", metavar="OBJECTIVE=VALUE", help="Limit of any objective, in SI units (m, rad); repeatable."
        ),
    ] = None,
    stiffness: Annotated[
        list[float] | None,
        typer.Option(
            "--stiffness", help="Factor on the cables' stiffness to optimise for; repeatable, the worst counts."
        ),
    ] = None,
    material: MaterialName = None,
    pretension: Pretension = None,
    seed: Seed = 0,
    generations: Generations = 200,
    store: Annotated[
        Path | None, typer.Option("--store", help=".npz file from which an interrupted search is resumed.")
    ] = None,
    output: Annotated[Path | None, typer.Option("-o", "--output", help="Robot file to write: .toml.")] = None,
    picture: Annotated[
        Path | None, typer.Option("--picture", help="Figure before and after: .png, .svg or .pdf.")
    ] = None,
    video: Annotated[
        Path | None, typer.Option("--video", help="Video of both layouts side by side: .mp4 or .gif.")
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Replace files that exist.")] = False,
    as_json: AsJson = False,
) -> None:
    """Optimise the layout, and validate the result in MuJoCo. Ctrl-C keeps the best layout so far.

    Exit status: 0 if the layout is better in MuJoCo, at the poses and between them, and MuJoCo agrees with statics; 1
    if not. If no better layout is found, nothing is written.
    """
    from cdpr_sim.core import extras
    from cdpr_sim.core.files import check_place
    from cdpr_sim.drawing import maps
    from cdpr_sim.drawing.video import writing
    from cdpr_sim.report import design_tables as report
    from cdpr_sim.report import layout_pictures as shown
    from cdpr_sim.report.robot_summary import write_both_methods

    for path, suffixes, name in (
        (output, (".toml",), "output"), (picture, maps.SUFFIXES, "picture"), (video, writing.SUFFIXES, "video"),
    ):  # fmt: skip
        if path is not None:
            check_place(path, suffixes, force=force, field=name)
    if video is not None:
        extras.require("video", "--video")
    machine = robot_of(robot, material, pretension=pretension)
    subject_to = {
        "tensions": tensions, "all taut": taut or None, "stable": stable or None, "clearance": clearance,
    }  # fmt: skip
    subject_to |= dict(_limit(one) for one in limit or [])
    result = cdpr.find_layout(
        machine,
        _poses(machine, grid, line, points),
        move=[_move(one, within, along) for one in move or ["exits"]],
        symmetry=symmetry,
        objective=objective,
        subject_to={name: value for name, value in subject_to.items() if value is not None},
        stiffness=stiffness or None,
        seed=seed,
        generations=generations,
        store=store,
        progress=True,
    )
    if not result.better:
        output = picture = video = None
        if not as_json:
            print_parts(f"{escape(result.none_better)} Nothing is written.")
            raise typer.Exit(DISAGREE)
    with busy("Settling both layouts in MuJoCo"):
        validation = cdpr.validate_layout(result)
    if output is not None:
        cdpr.write_robot(output, result.robot, force=force)
    if picture is not None:
        with busy("Drawing"):
            maps.write(shown.picture(validation), picture)
    if video is not None:
        motions = shown.driven(validation, round(VIDEO_SECONDS * VIDEO_FPS), VIDEO_SECONDS)
        with progress_bars() as bar:
            options = dict(seconds=VIDEO_SECONDS, fps=VIDEO_FPS, force=force, progress=bar("Drawing"))
            write_both_methods(video, motions, **options)
    if as_json:
        print_json(report.design_json(validation))
    else:
        lead, *others = validation.sentences
        tables = report.numbers_table(result, shown.numbers(validation)), report.changes_table(result)
        print_parts(f"[bold]{escape(lead)}[/]", *map(escape, others), *tables, result.message)
        for path in filter(None, (output, picture, video)):
            typer.echo(path)
    raise typer.Exit(0 if validation.agrees and validation.better else DISAGREE)


def front(
    robot: RobotName,
    output: Annotated[Path, typer.Option("-o", "--output", help="Folder for front.png and one robot file per layout.")],
    objectives: Annotated[
        tuple[str, str], typer.Option("--objectives", metavar="ONE OTHER", help=f"Two of: {OBJECTIVES}.")
    ] = ("points moved", "worst tilt"),
    move: Moves = None,
    within: Within = "0.05",
    along: Along = None,
    symmetry: SymmetryName = "detected",
    grid: Positions = None,
    line: Line = None,
    points: Points = 18,
    material: MaterialName = None,
    pretension: Pretension = None,
    seed: Seed = 0,
    generations: Generations = 200,
    max_files: Annotated[
        int, typer.Option("--max-files", min=2, max=MOST_FILES, help="Maximum number of robot files.")
    ] = 20,
    force: Annotated[bool, typer.Option("--force", help="Replace files that exist.")] = False,
) -> None:
    """Compute the Pareto front of two objectives: layouts as a table, a figure and robot files.

    Exit status 1, and nothing is written, if no layout is better than the given one by either objective.
    """
    from cdpr_sim.core.files import new_folder, refuse_existing, write_whole
    from cdpr_sim.drawing.figures import encoded
    from cdpr_sim.report import design_tables as report
    from cdpr_sim.report.layout_pictures import pareto_picture
    from cdpr_sim.robots.robot_file_text import as_toml

    with new_folder(output):
        machine = robot_of(robot, material, pretension=pretension)
        picture = output / "front.png"
        refuse_existing(
            [picture, *(output / f"robot-{number}.toml" for number in range(1, max_files + 1))], force=force
        )
        pareto = cdpr.find_front(
            machine,
            _poses(machine, grid, line, points),
            objectives,
            move=[_move(one, within, along) for one in move or ["exits"]],
            symmetry=symmetry,
            seed=seed,
            generations=generations,
            population=max(max_files, 100),
            progress=True,
        )
        if not pareto.better:
            print_parts(f"{escape(pareto.none_better)} Nothing is written.")
            raise typer.Exit(DISAGREE)
        pareto = pareto.thinned(max_files)
        files = {picture: encoded(pareto_picture(pareto))}
        files |= {
            output / f"robot-{row + 1}.toml": as_toml(pareto.robot(row)).encode() for row in range(len(pareto))
        }  # fmt: skip
        write_whole(files)
    count = f"{pareto.layouts_evaluated:,} layouts evaluated"
    note = f"{count}, by statics alone; `design` validates a layout in MuJoCo."
    print_parts(note, *pareto.warnings, report.front_table(pareto))
    for path in files:
        typer.echo(path)


def clearances(
    robot: RobotName,
    grid: Positions = None,
    line: Line = None,
    points: Points = 18,
    min_distance: Annotated[
        float, typer.Option("--min-distance", help="[m] A smaller distance counts as interference.")
    ] = 0.0,
    fitting: Annotated[
        float | None,
        typer.Option(
            "--fitting", help="[m] Length ignored at both ends of each cable; default: half the characteristic length."
        ),
    ] = None,
    material: MaterialName = None,
    pretension: Pretension = None,
    picture: Annotated[
        Path | None, typer.Option("-o", "--output", help="Map of the interference-free workspace: .png, .svg or .pdf.")
    ] = None,
    plane: Annotated[str, typer.Option("--plane", help="Plane of the map: xz, xy or yz.")] = "xz",
    at: Annotated[float | None, typer.Option("--at", help="Position of that plane [m]; default: the middle.")] = None,
    force: Annotated[bool, typer.Option("--force", help="Replace a picture that exists.")] = False,
) -> None:
    """Distances between cables, platform and frame at equilibrium. Exit status 1 if any is below --min-distance."""
    from cdpr_sim.analysis import clearance
    from cdpr_sim.core.files import check_place
    from cdpr_sim.drawing import maps
    from cdpr_sim.report import design_tables as report

    machine = robot_of(robot, material, pretension=pretension)
    if picture is not None:
        check_place(picture, maps.SUFFIXES, force=force, field="output")
        from cdpr_sim.report.layout_pictures import clearance_map

        with busy("Computing clearances"):
            maps.write(clearance_map(machine, plane, at, min_distance, fitting), picture)
    with busy("Solving"):
        each = machine.cables * clearance.POINTS * clearance.BYTES_PER_POINT
        distances = cdpr.clearances(machine, _poses(machine, grid, line, points, each), fitting=fitting)
    free = distances.free(min_distance)
    print_parts(
        f"Interference-free (distance above {1e3 * min_distance:g} mm) at {int(free.sum())} of {free.size} poses; "
        f"{1e3 * distances.fitting:.3g} mm at both ends of each cable ignored.",
        report.clearance_table(distances),
    )
    raise typer.Exit(0 if free.all() else DISAGREE)


def _poses(
    robot: cdpr.Robot,
    grid: tuple[int, int, int] | None,
    line: tuple[float, ...] | None,
    points: int,
    each: int = BYTES_PER_CASE,
) -> np.ndarray:
    import numpy as np

    from cdpr_sim.analysis.workspace.grids import as_grid
    from cdpr_sim.core import free_ram
    from cdpr_sim.core.checks import checked_array

    if line is not None:
        if grid is not None:
            raise cdpr.InvalidInput("line: found a line and a grid, expected one of the two")
        free_ram.refuse_beyond(f"points: {points:,} poses", each * points, "fewer")
        ends = checked_array("line", line, (6,))
        return np.linspace(ends[:3], ends[3:], points)
    if grid is None:
        nx, ny, nz = (1 if edge == 0 else n for edge, n in zip(np.ptp(robot.workspace, axis=0), GRID, strict=True))
        grid = nx, ny, nz
    axes = as_grid(grid, [robot])
    count = math.prod(len(values) for values in axes.values())
    free_ram.refuse_beyond(f"grid: {count:,} poses", each * count, "fewer")
    return np.stack(np.meshgrid(*axes.values(), indexing="ij"), axis=-1)


def _limit(word: str) -> tuple[str, float]:
    name, _, value = word.partition("=")
    try:
        return name.strip(), float(value)
    except ValueError:
        raise cdpr.InvalidInput(f"limit: found {word!r}, expected a name, = and a number") from None


def _move(word: str, within: str, along: tuple[float, float, float] | None) -> cdpr.Move:
    what, equals, reach = word.partition("=")
    return cdpr.Move(what, _reach("move", word, reach) if equals else _reach("within", within, within), along=along)


def _reach(option: str, word: str, reach: str) -> Any:
    """A range of ``cdpr.Move``: one distance or factor, two, three, or the two corners of a box."""
    numbers = numbers_in(reach)
    if len(numbers) == 6:
        return numbers[:3], numbers[3:]
    if len(numbers) not in (1, 2, 3):
        name = "a name, = and " if option == "move" else ""
        raise cdpr.InvalidInput(f"{option}: found {word!r}, expected {name}a number, or 2, 3 or 6 with commas")
    return numbers if len(numbers) > 1 else numbers[0]

"""Commands over whole workspaces: sweep, map, check."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

import cdpr_sim as cdpr
from cdpr_sim.cli.options import (
    Grid,
    Limits,
    Mass,
    MaterialNames,
    Orientation,
    PathPoints,
    Pretension,
    RobotNames,
    Waypoints,
    Wrench,
    Wrenches,
    along,
    robots_of,
    stops,
    waypoints_of,
    wrench_of,
    wrenches_of,
)
from cdpr_sim.cli.terminal import DISAGREE, print_parts

if TYPE_CHECKING:
    import xarray as xr

LEVEL = (0.0, 0.0, 0.0)
"""Default orientation [rad]."""

MOST_POINTS = 2000
"""Largest number of poses along the longer side of a map."""


def sweep(
    robot: RobotNames,
    grid: Grid = None,
    material: MaterialNames = None,
    pretension: Pretension = None,
    output: Annotated[
        Path | None,
        typer.Option(
            "-o",
            "--output",
            help="Store of the result: a new .nc file, or a .zarr folder, which is resumed if it exists.",
        ),
    ] = None,
    limits: Limits = None,
    wrench: Wrench = None,
    wrenches: Wrenches = None,
    settle: Annotated[
        bool,
        typer.Option("--settle", help="Also settle every pose in MuJoCo, and compare. Exit status 1 on disagreement."),
    ] = False,
) -> None:
    """Solve for the static equilibria of a grid: tilt, deviation, slack cables, feasibility."""
    from cdpr_sim.analysis.workspace.sweep import default_quantities
    from cdpr_sim.report import workspace_tables as report

    robots = robots_of(robot, material, None, pretension)
    dataset = cdpr.sweep(
        robots,
        grid,
        material or None,
        external_wrench=wrench_of(wrench),
        tension_limits=limits,
        wrenches=wrenches_of(wrenches),
        quantities=[*default_quantities(robots), "settled"] if settle else None,
        store=output,
        progress=True,
    )
    _print(dataset)
    if settle:
        print_parts(report.check_table(dataset))
        raise typer.Exit(0 if report.all_agree(dataset) else DISAGREE)


def draw_map(
    robot: RobotNames,
    output: Annotated[Path, typer.Option("-o", "--output", help="Picture to write: .png, .svg or .pdf.")] = Path(
        "map.png"
    ),
    material: MaterialNames = None,
    pretension: Pretension = None,
    plane: Annotated[str, typer.Option("--plane", help="xz, xy or yz.")] = "xz",
    at: Annotated[float | None, typer.Option("--at", help="Position of the plane [m]; default: the middle.")] = None,
    points: Annotated[int, typer.Option("--points", help="Number of poses along the longer side.")] = 181,
    limits: Limits = None,
    wrench: Wrench = None,
    wrenches: Wrenches = None,
    mass: Mass = None,
    orientation: Orientation = LEVEL,
    waypoint: Waypoints = None,
    path_points: PathPoints = 181,
    force: Annotated[bool, typer.Option("--force", help="Replace a picture that exists.")] = False,
) -> None:
    """Draw tilt, deviation, slack cables and feasibility over a plane of the workspace, or along a path."""
    from cdpr_sim.analysis.workspace import grids
    from cdpr_sim.core.files import check_place
    from cdpr_sim.drawing import maps, path_maps

    check_place(output, maps.SUFFIXES, force=force, field="output")
    robots = robots_of(robot, material, mass, pretension)
    if points > MOST_POINTS:
        raise cdpr.InvalidInput(
            f"points: found {points}, expected at most {MOST_POINTS}, which exceeds the pixels of a map; for "
            "more, use a .nc or .zarr store of `cdpr-sim sweep`"
        )
    through = waypoints_of(waypoint)
    if through and (plane != "xz" or at is not None):
        raise cdpr.InvalidInput("--waypoint: found waypoints and --plane or --at, expected one of them")
    poses = along(robots[0], through, path_points) if through else None
    section = grids.plane(plane, at, points, robots) if poses is None else None
    dataset = cdpr.sweep(
        robots,
        section,
        material or None,
        poses=poses,
        orientation=orientation,
        external_wrench=wrench_of(wrench),
        tension_limits=limits,
        wrenches=wrenches_of(wrenches),
        quantities=maps.QUANTITIES,
        progress=True,
    )
    if through:
        figure = path_maps.draw_path_map(dataset, stops(robots[0], through))
    else:
        names = [name for name in (*maps.ELASTIC, "wrench_feasible") if name in dataset]
        figure = maps.draw_elastic_map(dataset, names=names)
    maps.write(figure, output)
    _print(dataset)
    typer.echo(output)


def _print(dataset: xr.Dataset) -> None:
    from cdpr_sim.report import workspace_tables as report

    print_parts(report.sweep_table(dataset), *report.sweep_lines(dataset))


def check(
    robot: RobotNames,
    grid: Grid = None,
    material: MaterialNames = None,
    pretension: Pretension = None,
    output: Annotated[Path | None, typer.Option("-o", "--output", help="Map of the agreement, seen along y.")] = None,
    certify: Annotated[
        bool, typer.Option("--certify", help="Prove the equilibria of both methods (extra proof), 0.03 s a pose.")
    ] = False,
    mass: Mass = None,
    orientation: Orientation = LEVEL,
    wrench: Wrench = None,
    waypoint: Waypoints = None,
    path_points: PathPoints = 50,
    force: Annotated[bool, typer.Option("--force", help="Replace a picture that exists.")] = False,
) -> None:
    """Settle every pose of a grid or a path in MuJoCo and compare it with the solver. Exit status 1 on disagreement."""
    from cdpr_sim.core.files import check_place
    from cdpr_sim.drawing import maps
    from cdpr_sim.report import workspace_tables as report

    if output is not None:
        check_place(output, maps.SUFFIXES, force=force, field="output")
    robots, through = robots_of(robot, material, mass, pretension), waypoints_of(waypoint)
    if through and output is not None:
        raise cdpr.InvalidInput("--output: found one for a path, expected a grid: a map shows a plane of it")
    result = cdpr.check(
        robots,
        grid,
        material or None,
        poses=along(robots[0], through, path_points) if through else None,
        orientation=orientation,
        external_wrench=wrench_of(wrench),
        certify=certify,
        progress=True,
    )
    if output is not None:
        maps.write(maps.draw_agreement_map(result.across()), output)
    print_parts(*report.check_lines(result), report.check_table(result.dataset))
    raise typer.Exit(0 if result.agrees else DISAGREE)

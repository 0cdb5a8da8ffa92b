"""Commands for robot descriptions: robots, new, schema, show, import, models, view."""

from __future__ import annotations

import functools
import hashlib
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, get_args

import typer

import cdpr_sim as cdpr
from cdpr_sim.cli.options import AsJson, Mass, MaterialName, Pose, Pretension, RobotName, pose_of, problem_of, robot_of
from cdpr_sim.cli.terminal import DISAGREE, print_json, print_listing, print_parts

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def robots() -> None:
    """List the robots of the catalogue and the cable materials."""
    from cdpr_sim.robots import robot_file

    for kind, machines in _by_kind().items():
        rows = [(one.name, one.mobility, str(one.cables), f"{one.mass:g} kg", one.description) for one in machines]
        headings = ("robot", "mobility", "cables", "mass", "description")
        print_listing(f"Robots: {kind}", headings, rows, text_columns=2)
    headings = ("material", "EA", "breaks at", "source")
    print_listing("Cables of fixed diameter", headings, robot_file.material_rows())
    headings = ("material", "modulus", "fill", "density", "strength", "source")
    print_listing("Ropes of any diameter, for example steel-rope-4mm", headings, robot_file.rope_rows())


def new(
    name: Annotated[str, typer.Argument(metavar="NAME", help="Name of the robot; writes NAME.toml in this folder.")],
    source: Annotated[
        str | None,
        typer.Option("--from", metavar="ROBOT", help="Copy this robot, of the catalogue or a file, instead."),
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Replace the file if it exists.")] = False,
) -> None:
    """Write a commented robot file to start from; it is valid as it is."""
    from cdpr_sim.core.files import check_place, write_whole
    from cdpr_sim.robots import robot_file

    path = Path(f"{name.removesuffix('.toml')}.toml")
    called = path.name.removesuffix(".toml")
    if not called.strip():
        raise cdpr.InvalidInput(f"name: found {name!r}, expected a name of the robot, as in `cdpr-sim new mine`")
    text = robot_file.template(called) if source is None else robot_file.copied(source, called)
    write_whole({check_place(path, [".toml"], force=force): text.encode()})
    if called in cdpr.list_robots():
        typer.echo(
            f"cdpr-sim: note: {called} is a robot of the catalogue as well: commands take the name for that robot, and "
            f"{path} for this file",
            err=True,
        )
    typer.echo(f"{path}: now `cdpr-sim show {path}` and `cdpr-sim settle {path}`")


def schema(
    document: Annotated[
        bool, typer.Option("--document", help="Print the documentation of robot files (Markdown).")
    ] = False,
) -> None:
    """Print the JSON schema of robot files, for checking and completion in editors."""
    from cdpr_sim.robots import robot_file

    typer.echo(robot_file.document() if document else robot_file.json_schema(), nl=not document)


def show(
    robots: Annotated[
        list[str] | None,
        typer.Argument(metavar="[ROBOT]...", help="One robot, or several in one figure; default: all."),
    ] = None,
    output: Annotated[Path, typer.Option("-o", "--output", help="File: .png.")] = Path("robot.png"),
    pose: Pose = None,
    material: MaterialName = None,
    pretension: Pretension = None,
    force: Annotated[bool, typer.Option("--force", help="Replace the file if it exists.")] = False,
    as_json: AsJson = False,
) -> None:
    """Describe a robot, and draw it with cable numbers at exits and anchors; or draw several robots in one figure."""
    from cdpr_sim.core.files import check_place, write_whole
    from cdpr_sim.drawing import still
    from cdpr_sim.report import as_json as json_of
    from cdpr_sim.report.robot_tables import robot_table

    check_place(output, [".png"], force=force)
    if robots and len(robots) == 1:
        robot = robot_of(robots[0], material, pretension=pretension)
        if as_json:
            print_json(json_of.robot(robot))
        else:
            print_parts(robot_table(robot))
        figure = still.draw(robot, robot.pose(pose_of(pose) or tuple(robot.home)))
    else:
        if pose is not None:
            raise cdpr.InvalidInput("--pose: found a pose and several robots, expected one robot")
        if as_json or pretension is not None:
            option = "--json" if as_json else "--pretension"
            raise cdpr.InvalidInput(f"{option}: found it with several robots, expected one robot")
        everyone = [robot.name for kind in _by_kind().values() for robot in kind]
        figure = still.sheet([robot_of(name, material) for name in robots or everyone])
    write_whole({output: still.encoded(figure)})
    if not as_json:
        typer.echo(output)


def import_file(
    file: Annotated[
        Path,
        typer.Argument(
            metavar="FILE",
            help="CASPR's XML, WireX's wcrfx, cdpyr's JSON or YAML, oKermorgant/cdpr's YAML, the Bologna group's JSON, "
            "MuJoCo's XML, Hangprinter's config.g, or UACDPR's .mat.",
        ),
    ],
    output: Annotated[
        Path | None, typer.Option("-o", "--output", help="Robot file to write; default: <robot's name>.toml.")
    ] = None,
    format: Annotated[
        str | None,
        typer.Option(
            "--format", help="caspr, wirex, cdpyr, gazebo, bologna, mjcf, hangprinter, uacdpr; default: detected."
        ),
    ] = None,
    cables: Annotated[str | None, typer.Option("--cables", help="Id of CASPR's cable set.")] = None,
    force: Annotated[bool, typer.Option("--force", help="Replace the file if it exists.")] = False,
) -> None:
    """Convert a robot of another project to a robot file, and list what was left out or assumed."""
    robot = cdpr.import_robot(file, format, cables)
    place = cdpr.write_robot(output or Path(f"{robot.name}.toml"), robot, force=force)
    typer.echo(f"{place}: {robot.name}, {robot.mobility}, {robot.cables} cables, {robot.mass:g} kg")
    for note in robot.notes:
        typer.echo(f"- {note}")


def models(
    robot: Annotated[
        list[str] | None, typer.Argument(metavar="[ROBOT]...", help="Robots; default: the whole catalogue.")
    ] = None,
    output: Annotated[Path, typer.Option("-o", "--output", help="Folder for <robot>/.")] = Path("models"),
    pose: Pose = None,
    material: MaterialName = None,
    mass: Mass = None,
    pretension: Pretension = None,
    winches: Annotated[
        bool,
        typer.Option(
            "--winches",
            help="Add winch.xml, winch_scene.xml and winch_speed.xml, with actuators that wind the cables.",
        ),
    ] = False,
    damping: Annotated[
        str,
        typer.Option(
            "--damping",
            help="What damps the platform: settle (an artificial drag that brings it to rest soon), none, or a loss "
            "factor of the cables from 0 to 1.",
        ),
    ] = "settle",
    contact: Annotated[
        bool, typer.Option("--contact", help="Let the platform, a box, collide with other bodies and the floor.")
    ] = False,
    check: Annotated[
        bool, typer.Option("--check", help="Write nothing; exit status 1 if a file is out of date.")
    ] = False,
    force: Annotated[bool, typer.Option("--force", help="Replace files that differ.")] = False,
) -> None:
    """Write MuJoCo models: robot.xml, scene.xml, a README and a picture for each robot."""
    from cdpr_sim.drawing import still
    from cdpr_sim.physics.damping import loss_factor
    from cdpr_sim.physics.model_files import INDEX, PICTURE, model_files, models_index

    stale, sources, damped = [], [], damping
    with suppress(ValueError):
        damped = float(damping)
    loss_factor(damped)  # type: ignore[arg-type]  # refuses what is none
    for name in robot or cdpr.list_robots():
        problem = problem_of(name, pose, material, pretension, mass)
        options = dict(damping=damped, contact=contact)
        folder, files = output / problem.robot.name, model_files(problem, **options)  # type: ignore[arg-type]
        sources.append("".join(text for file, text in files.items() if file.endswith(".xml")))
        if winches:
            files = model_files(problem, winches=True, **options)  # type: ignore[arg-type]
        draw = functools.partial(still.draw, problem.robot, problem.pose)
        stale += _renewed(folder, files, folder / PICTURE, draw, sources[-1], check=check, force=force)
        if not check:
            typer.echo(f"{folder}: {', '.join([*files, PICTURE])}")
    if not robot:
        kinds = _by_kind()
        draw = functools.partial(still.sheet, [robot for kind in kinds.values() for robot in kind])
        index = {"README.md": models_index(kinds)}
        stale += _renewed(output, index, output / INDEX, draw, "".join(sources), check=check, force=force)
    command = "cdpr-sim models --winches --force" if winches else "cdpr-sim models --force"
    for path in stale:
        typer.echo(f"{path}: out of date, expected what `{command}` writes", err=True)
    raise typer.Exit(DISAGREE if stale else 0)


def view(robot: RobotName, pose: Pose = None, material: MaterialName = None, pretension: Pretension = None) -> None:
    """Open the robot in MuJoCo's viewer, with a slider for each winch.

    A slider's 0 is the length at the commanded pose; moving it to the right winds the cable in.
    """
    from cdpr_sim.physics.viewer import open_viewer

    open_viewer(problem_of(robot, pose, material, pretension))


def _renewed(
    folder: Path,
    files: dict[str, str],
    picture: Path,
    draw: Callable[[], Figure],
    source: str,
    *,
    check: bool,
    force: bool,
) -> list[Path]:
    """Write ``files`` and the picture of ``source`` where they differ from the existing ones, or only list them.

    Raises:
        InvalidInput: an existing file differs and ``force`` is false.
    """
    from cdpr_sim.core.files import refuse_existing, write_whole
    from cdpr_sim.drawing import still
    from cdpr_sim.physics.model_files import stale_models, write_models

    stamp = hashlib.sha256(source.encode()).hexdigest()
    drawn = still.stamp_of(picture) == stamp
    if check:
        return [folder / file for file in stale_models(folder, files)] + ([] if drawn else [picture])
    if not drawn:
        refuse_existing([picture], force=force)
    write_models(folder, files, force=force)
    if not drawn:
        write_whole({picture: still.small(still.encoded(draw()), stamp)})
    return []


def _by_kind() -> dict[str, list[cdpr.Robot]]:
    """Robots of the catalogue by kind."""
    from cdpr_sim.core.robot import Kind

    kinds: dict[str, list[cdpr.Robot]] = {kind: [] for kind in get_args(Kind)}
    for name in cdpr.list_robots():
        robot = cdpr.load_robot(name)
        kinds[robot.kind].append(robot)
    return kinds

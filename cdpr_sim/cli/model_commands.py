"""Commands for any MuJoCo model: settle-model, diagnose."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

import cdpr_sim as cdpr
from cdpr_sim.cli.command_classes import numbers_in
from cdpr_sim.cli.options import AsJson
from cdpr_sim.cli.terminal import DISAGREE, print_json, print_parts

ModelFile = Annotated[
    Path, typer.Argument(metavar="MODEL", help="A MuJoCo model: MJCF (.xml), URDF, or a compiled .mjb.")
]
Keyframe = Annotated[
    str | None,
    typer.Option(
        "--keyframe", metavar="K", help="Keyframe to start from, by name or number; default: the initial pose."
    ),
]
Controls = Annotated[
    str | None,
    typer.Option("--ctrl", metavar="U1 U2 ...", help="Controls; default: those of the keyframe, or zeros."),
]
Ignored = Annotated[
    list[str] | None,
    typer.Option("--ignore", metavar="BODY", help="Hold this body where it is, and let it touch nothing; repeatable."),
]
Seconds = Annotated[float, typer.Option("--seconds", help="[s] Time after which the search ends.")]


def settle_model(
    file: ModelFile,
    keyframe: Keyframe = None,
    ctrl: Controls = None,
    ignore: Ignored = None,
    save: Annotated[
        Path | None,
        typer.Option("--save", metavar="FILE", help="Write a copy of the model with this pose as keyframe `rest`."),
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Replace the file if it exists.")] = False,
    seconds: Seconds = 60.0,
    as_json: AsJson = False,
) -> None:
    """Compute the static equilibrium of any MuJoCo model: pose, tensions of its tendons, contact forces.

    Exit status: 0 at an equilibrium that both ways agree on, 1 if they do not or if it is unstable, 2 if the model does
    not come to rest, or for invalid input.
    """
    from cdpr_sim.anymodel.model_file import check_copy, read_model, save_at_rest, start_of
    from cdpr_sim.core.equilibrium import Stability
    from cdpr_sim.core.files import check_place
    from cdpr_sim.report import as_json as json_of
    from cdpr_sim.report import model_tables as report

    if save is not None:
        check_place(save, [".xml"], force=force)
    model = read_model(file)
    if save is not None:
        check_copy(file, save)
    start = start_of(model, keyframe)
    found = cdpr.settle_model(
        model, start, ctrl=_numbers(ctrl, model.nu), ignore=ignore or (), seconds=seconds, progress=not as_json
    )
    if save is not None:
        save_at_rest(file, save, found, start)
    if as_json:
        print_json(json_of.model_equilibrium(model, found))
    else:
        pose = (
            report.pose_table(model, start.qpos, found) if model.njnt else "The model has no joints: nothing can move."
        )
        print_parts(*report.rest_lead(found), pose)
        if len(found.tendon_tensions):
            print_parts(report.tension_table(found))
        if found.contact_forces:
            print_parts(report.contact_table(found))
        if save is not None:
            typer.echo(f"{save}: keyframe rest")
    disagree = found.agreement is not None and not found.agreement.agrees
    raise typer.Exit(DISAGREE if disagree or found.stability is Stability.UNSTABLE else 0)


def diagnose(
    file: ModelFile,
    keyframe: Keyframe = None,
    ctrl: Controls = None,
    ignore: Ignored = None,
    seconds: Seconds = 30.0,
    as_json: AsJson = False,
) -> None:
    """List what is wrong with a MuJoCo model, with the remedies: tendons that push, time steps, loads without support.

    Exit status: 0 if nothing is found, 1 if something is, 2 for invalid input.
    """
    from cdpr_sim.anymodel.model_file import read_model, start_of
    from cdpr_sim.report import as_json as json_of
    from cdpr_sim.report import model_tables as report

    model = read_model(file)
    start = start_of(model, keyframe)
    found = cdpr.diagnose_model(
        model, start, ctrl=_numbers(ctrl, model.nu), ignore=ignore or (), seconds=seconds, progress=not as_json
    )
    if as_json:
        print_json(json_of.diagnosis(found))
    else:
        print_parts(*report.findings_lines(found), *report.time_step_lines(model, found))
    raise typer.Exit(DISAGREE if found.findings else 0)


def _numbers(word: str | None, count: int) -> list[float] | None:
    """Parse ``--ctrl``.

    Raises:
        InvalidInput: not as many numbers as the model has controls.
    """
    if word is None:
        return None
    numbers = numbers_in(word.strip(", "))
    if len(numbers) != count:
        raise cdpr.InvalidInput(f"--ctrl: found {word!r}, expected {count} numbers, one for each control of the model")
    return numbers

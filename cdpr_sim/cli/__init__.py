"""The command line: static equilibria by statics and by MuJoCo, and whether the two methods agree."""

import os
from typing import Annotated

import typer

from cdpr_sim.cli import (
    analysis_commands,
    design_commands,
    equilibrium_commands,
    model_commands,
    picture_commands,
    robot_commands,
    workspace_commands,
)
from cdpr_sim.cli.command_classes import CommandGroup, CommandWithHelp
from cdpr_sim.cli.terminal import STATUSES, plain_letters_where_needed

app = typer.Typer(
    cls=CommandGroup,
    help="Static equilibria of cable-driven parallel robots, computed by statics and by MuJoCo, and compared.",
    epilog=STATUSES,
    no_args_is_help=True,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
    add_completion=False,
)

COMMANDS = {
    "settle": equilibrium_commands.settle,
    "solve": equilibrium_commands.solve,
    "certify": equilibrium_commands.certify,
    "compensate": analysis_commands.compensate,
    "sensitivity": analysis_commands.sensitivity,
    "equilibria": analysis_commands.equilibria,
    "identify": analysis_commands.identify,
    "design": design_commands.design,
    "front": design_commands.front,
    "clearances": design_commands.clearances,
    "robots": robot_commands.robots,
    "new": robot_commands.new,
    "schema": robot_commands.schema,
    "show": robot_commands.show,
    "import": robot_commands.import_file,
    "models": robot_commands.models,
    "view": robot_commands.view,
    "sweep": workspace_commands.sweep,
    "map": workspace_commands.draw_map,
    "check": workspace_commands.check,
    "score": analysis_commands.score,
    "settle-model": model_commands.settle_model,
    "diagnose": model_commands.diagnose,
    "video": picture_commands.video,
    "report": picture_commands.report,
}
"""Commands by name, in the order of ``--help``."""

for name, command in COMMANDS.items():
    app.command(name, cls=CommandWithHelp)(command)


def _print_version(requested: bool) -> None:
    if requested:
        import cdpr_sim

        typer.echo(f"cdpr-sim {cdpr_sim.__version__}")
        raise typer.Exit


@app.callback()
def _options(
    version: Annotated[
        bool, typer.Option("--version", callback=_print_version, is_eager=True, help="Print the version.")
    ] = False,
) -> None:
    pass


def main() -> None:
    """The entry point of ``cdpr-sim``."""
    plain_letters_where_needed()
    os.environ.pop("MPLBACKEND", None)  # commands write files, in which no backend of windows takes part
    app()

"""The command line: where does the platform end up, and do the two roads agree?"""

from typing import Annotated

import typer

from cdpr_sim.cli import answers, design, page, pictures, rest, robots, score, workspace
from cdpr_sim.cli.commands import Command, Commands
from cdpr_sim.cli.terminal import STATUSES, plain_letters_where_needed

app = typer.Typer(
    cls=Commands,
    help="Where does the platform of a cable-driven parallel robot really end up? Statics and MuJoCo, cross-checked.",
    epilog=STATUSES,
    no_args_is_help=True,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
    add_completion=False,
)

COMMANDS = {
    "settle": rest.settle,
    "solve": rest.solve,
    "certify": rest.certify,
    "compensate": answers.compensate,
    "sensitivity": answers.sensitivity,
    "equilibria": answers.equilibria,
    "identify": answers.identify,
    "design": design.design,
    "front": design.front,
    "clearances": design.clearances,
    "robots": robots.robots,
    "new": robots.new,
    "schema": robots.schema,
    "show": robots.show,
    "import": robots.import_file,
    "models": robots.models,
    "view": robots.view,
    "figures": pictures.figures,
    "sweep": workspace.sweep,
    "map": workspace.draw_map,
    "check": workspace.check,
    "score": score.score,
    "video": pictures.video,
    "report": page.report,
}
"""In the order of ``--help``."""

for name, command in COMMANDS.items():
    app.command(name, cls=Command)(command)


def _say_version(asked: bool) -> None:
    if asked:
        import cdpr_sim

        typer.echo(f"cdpr-sim {cdpr_sim.__version__}")
        raise typer.Exit


@app.callback()
def _options(
    version: Annotated[
        bool, typer.Option("--version", callback=_say_version, is_eager=True, help="Print the version.")
    ] = False,
) -> None:
    pass


def main() -> None:
    """The entry point of ``cdpr-sim``."""
    plain_letters_where_needed()
    app()

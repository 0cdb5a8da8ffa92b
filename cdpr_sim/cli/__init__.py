"""The command line: where does the platform end up, and do the two roads agree?"""

import typer

from cdpr_sim.cli import answers, pictures, rest, robots, workspace

app = typer.Typer(
    help="Where does the platform of a cable-driven parallel robot really end up? Statics and MuJoCo, cross-checked.",
    no_args_is_help=True,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
    add_completion=False,
)

COMMANDS = {
    "settle": rest.settle,
    "solve": rest.solve,
    "compensate": answers.compensate,
    "sensitivity": answers.sensitivity,
    "equilibria": answers.equilibria,
    "identify": answers.identify,
    "robots": robots.robots,
    "models": robots.models,
    "figures": pictures.figures,
    "sweep": workspace.sweep,
    "map": workspace.draw_map,
    "check": workspace.check,
    "video": pictures.video,
}
"""In the order of ``--help``."""

for name, command in COMMANDS.items():
    app.command(name)(command)


def main() -> None:
    """The entry point of ``cdpr-sim``."""
    app()

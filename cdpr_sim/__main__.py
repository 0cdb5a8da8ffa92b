"""``python -m cdpr_sim``, and the command ``cdpr-sim``; Ctrl-C is handled from the first import on."""

import sys


def main() -> None:
    """The command line."""
    try:
        from cdpr_sim.cli import main as run

        run()
    except KeyboardInterrupt:  # before a command can handle it: importing takes a second
        sys.exit(130)


if __name__ == "__main__":
    main()

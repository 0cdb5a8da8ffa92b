"""``python -m cdpr_sim``, and the command ``cdpr-sim``; Ctrl-C is handled from the first import on."""

import signal
import sys
from types import FrameType


def main() -> None:
    """The command line."""
    interrupts: list[int] = []

    def interrupt(number: int, frame: FrameType | None) -> None:
        interrupts.append(number)
        signal.default_int_handler(number, frame)

    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:  # not where a shell has it ignored
        signal.signal(signal.SIGINT, interrupt)
    try:
        from cdpr_sim.cli import main as run

        run()
    except KeyboardInterrupt:  # before a command can handle it: importing takes a second
        sys.exit(130)
    except ImportError:
        if not interrupts:
            raise
        sys.exit(130)  # modules in C report an interrupt during their import as this


if __name__ == "__main__":
    main()

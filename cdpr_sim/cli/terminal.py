"""Terminal input and output of all commands: error messages, exit statuses, progress, JSON."""

from __future__ import annotations

import errno
import json
import os
import signal
import sys
import traceback
import warnings
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING, Any

import typer
from rich.console import Console

import cdpr_sim as cdpr

if TYPE_CHECKING:
    from rich.status import Status
    from rich.table import Table


LEAST_WIDTH, USUAL_WIDTH = 20, 80
"""[characters] Smallest width in which records can be read; the one used instead of a smaller one."""


class Output(Console):
    """Standard output; a closed pipe raises an error, which ``outside_world`` turns into an exit status."""

    def __init__(self) -> None:
        super().__init__()
        if self.width < LEAST_WIDTH:  # as by COLUMNS=0, with which rich would print nothing
            self.width = USUAL_WIDTH

    def on_broken_pipe(self) -> None:
        """Re-raise the error being handled; rich would exit with 1, which means that the methods disagree."""
        raise


DISAGREE, MISTAKE, OUTSIDE, INTERRUPTED = 1, 2, 3, 128 + signal.SIGINT
"""Exit statuses: a negative answer, invalid input, a failure outside the program, Ctrl-C."""

STATUSES = (
    f"Exit status: 0 for success; {DISAGREE} if the answer is negative (the methods disagree, a file is out of date, "
    f"the pose cannot be held); {MISTAKE} for invalid input or if no equilibrium is found; {OUTSIDE} "
    "for system errors: a full disk, a closed pipe, not enough memory; "
    f"{INTERRUPTED} if interrupted."
)
"""For ``--help``."""


OURS = (cdpr.ImplausibleRobot, cdpr.StoreRepaired)
"""Warnings of the package."""


@contextmanager
def errors_as_sentences() -> Iterator[None]:
    """Print errors of the user or the system as one sentence on standard error, and exit with their status.

    A warning about an implausible robot or a repaired store is printed as one line and is no error.
    """
    with warnings_as_lines():
        try:
            yield
        except KeyboardInterrupt:
            raise typer.Exit(INTERRUPTED) from None
        except cdpr.StoreError as error:
            raise _ended(str(error), OUTSIDE) from None
        except cdpr.CdprError as error:
            raise _ended(str(error), MISTAKE) from None
        except MemoryError:
            raise _ended("out of memory; expected a smaller request, or a store on disk", OUTSIDE) from None
        except Exception as error:  # of the import of MuJoCo
            found = os.environ.get("MUJOCO_GL")
            if found is None or not any(
                "gl_context" in frame.filename for frame in traceback.extract_tb(error.__traceback__)
            ):
                raise
            sentence = (
                f"MUJOCO_GL: found {found!r}, which MuJoCo cannot use here, expected egl, glfw, disable, or no value"
            )
            raise _ended(sentence, MISTAKE) from None


@contextmanager
def outside_world() -> Iterator[None]:
    """Report failed output by the exit status: a closed pipe silently, other errors in one sentence."""
    try:
        try:
            yield
        finally:
            if sys.stdout is not None:
                sys.stdout.flush()
    except KeyboardInterrupt:
        raise typer.Exit(INTERRUPTED) from None
    except OSError as error:
        _discard_output()
        if error.errno == errno.EPIPE:
            raise typer.Exit(OUTSIDE) from None
        where = f"{error.filename}: " if error.filename else ""
        raise _ended(f"{where}{error.strerror or error}", OUTSIDE) from None


def plain_letters_where_needed() -> None:
    """Print "?" for characters that the terminal cannot encode (``PYTHONIOENCODING=ascii``), instead of failing."""
    for stream in (sys.stdout, sys.stderr):
        with suppress(AttributeError, ValueError):
            stream.reconfigure(errors="replace")  # type: ignore[union-attr]


@contextmanager
def warnings_as_lines() -> Iterator[None]:
    """Print each warning of the package once, as a line on standard error; other warnings as usual."""
    printed: set[str] = set()

    def show(message, category, filename, lineno, file=None, line=None) -> None:
        if not issubclass(category, OURS):
            usual(message, category, filename, lineno, file, line)
        elif str(message) not in printed:
            printed.add(str(message))
            typer.echo(f"cdpr-sim: warning: {message}", err=True)

    with warnings.catch_warnings():
        for category in OURS:
            warnings.simplefilter("always", category)
        usual, warnings.showwarning = warnings.showwarning, show
        yield


@contextmanager
def tidy_when_terminated() -> Iterator[None]:
    """Clean up on SIGTERM as on Ctrl-C."""
    previous = signal.signal(signal.SIGTERM, lambda *_: sys.exit(128 + signal.SIGTERM))
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, previous)


def busy(what: str) -> Status:
    """Status line on standard error during a longer computation."""
    return Console(stderr=True).status(f"{what} ...")


@contextmanager
def progress_bars() -> Iterator[Callable[[str], Callable[[float], None]]]:
    """Progress bars on standard error, if it is a terminal.

    ``bar = bars(label)`` adds one, and ``bar(fraction)`` sets the completed fraction, 0 to 1.
    """
    from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeRemainingColumn

    console = Console(stderr=True)
    text = TextColumn("{task.description}", markup=False)
    columns = text, BarColumn(), TaskProgressColumn(), TimeRemainingColumn()
    with Progress(*columns, console=console, disable=not console.is_terminal) as progress:

        def add(label: str) -> Callable[[float], None]:
            task = progress.add_task(label, total=1.0)
            return lambda done: progress.update(task, completed=done)

        yield add


def print_parts(*parts: Table | str) -> None:
    """Print tables, and lines in rich's markup, on standard output; numbers in lines are not coloured."""
    console = Output()
    for part in parts:
        console.print(part, highlight=False)


def print_listing(title: str, headings: Sequence[str], rows: Iterable[Sequence[str]], *, text_columns: int = 1) -> None:
    """Print a table whose last column is text, too."""
    from cdpr_sim.report.table_style import new_table

    *others, last = headings
    table = new_table(title, *others, text_columns=text_columns)
    table.add_column(last)
    for row in rows:
        table.add_row(*row)
    print_parts(table)


def print_json(value: dict[str, Any]) -> None:
    """Print indented JSON on standard output."""
    typer.echo(json.dumps(value, indent=2))


def _ended(sentence: str, status: int) -> typer.Exit:
    with suppress(OSError):  # standard error may be the same closed pipe
        typer.echo(f"cdpr-sim: {' '.join(sentence.split())}", err=True)
    return typer.Exit(status)


def _discard_output() -> None:
    """Redirect the remaining buffer to the null device, since Python would try to write it again at exit."""
    with suppress(OSError, ValueError, AttributeError):
        null = os.open(os.devnull, os.O_WRONLY)
        os.dup2(null, sys.stdout.fileno())
        os.close(null)

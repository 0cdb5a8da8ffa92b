"""What all commands do with a terminal: mistakes as sentences, exit statuses, something to look at meanwhile, JSON."""

from __future__ import annotations

import errno
import json
import os
import signal
import sys
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING, Any

import typer
from rich.console import Console

import cdpr_sim as cdpr

if TYPE_CHECKING:
    from rich.status import Status


class Output(Console):
    """Standard output; a pipe that nobody reads is an error, for ``outside_world`` to make an exit status of."""

    def on_broken_pipe(self) -> None:
        """Called where the error is at hand; rich would end with the status that means that the methods disagree."""
        raise


DISAGREE, MISTAKE, OUTSIDE, INTERRUPTED = 1, 2, 3, 128 + signal.SIGINT
"""Exit statuses: a negative answer, invalid input, a failure outside the program, Ctrl-C."""

STATUSES = (
    f"Exit status: 0 if all is well; {DISAGREE} if the answer is negative (the methods disagree, a file is stale, "
    f"the pose cannot be held); {MISTAKE} for input that cannot be right and for poses without an answer; {OUTSIDE} "
    "for what lies outside: a full disk, a closed pipe, too little memory; "
    f"{INTERRUPTED} if interrupted."
)
"""For ``--help``."""


@contextmanager
def errors_as_sentences() -> Iterator[None]:
    """No traceback for what is not our mistake: one sentence on standard error, and its exit status.

    An implausible robot is a line there as well, and no error.
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
            raise _ended("out of memory; expected a smaller request, or a store to compute into", OUTSIDE) from None


@contextmanager
def outside_world() -> Iterator[None]:
    """What is printed arrives, or the status says that it did not: a closed pipe in silence, all else in a sentence."""
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
    """A terminal that cannot show a letter shows a question mark: ``PYTHONIOENCODING=ascii`` is no reason to fail."""
    for stream in (sys.stdout, sys.stderr):
        with suppress(AttributeError, ValueError):
            stream.reconfigure(errors="replace")  # type: ignore[union-attr]


@contextmanager
def warnings_as_lines() -> Iterator[None]:
    """A line on standard error for each robot that is implausible, once; other warnings as ever."""
    said: set[str] = set()

    def show(message, category, filename, lineno, file=None, line=None) -> None:
        if not issubclass(category, cdpr.ImplausibleRobot):
            usual(message, category, filename, lineno, file, line)
        elif str(message) not in said:
            said.add(str(message))
            typer.echo(f"cdpr-sim: warning: {message}", err=True)

    with warnings.catch_warnings():
        warnings.simplefilter("always", cdpr.ImplausibleRobot)
        usual, warnings.showwarning = warnings.showwarning, show
        yield


@contextmanager
def tidy_when_terminated() -> Iterator[None]:
    """A terminated process cleans up as an interrupted one does."""
    previous = signal.signal(signal.SIGTERM, lambda *_: sys.exit(128 + signal.SIGTERM))
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, previous)


def busy(what: str) -> Status:
    """A word on standard error while something takes its time."""
    return Console(stderr=True).status(f"{what} ...")


@contextmanager
def progress_bars() -> Iterator[Callable[[str], Callable[[float], None]]]:
    """Bars on standard error, where a terminal can show them.

    ``bar = bars(what)`` adds one, and ``bar(fraction)`` moves it to the fraction that is done, 0 to 1.
    """
    from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeRemainingColumn

    console = Console(stderr=True)
    text = TextColumn("{task.description}", markup=False)
    columns = text, BarColumn(), TaskProgressColumn(), TimeRemainingColumn()
    with Progress(*columns, console=console, disable=not console.is_terminal) as progress:

        def add(what: str) -> Callable[[float], None]:
            task = progress.add_task(what, total=1.0)
            return lambda done: progress.update(task, completed=done)

        yield add


def print_json(value: dict[str, Any]) -> None:
    """On standard output, indented."""
    typer.echo(json.dumps(value, indent=2))


def _ended(sentence: str, status: int) -> typer.Exit:
    with suppress(OSError):  # standard error may be the same closed pipe
        typer.echo(f"cdpr-sim: {' '.join(sentence.split())}", err=True)
    return typer.Exit(status)


def _discard_output() -> None:
    """What is left in the buffer has nowhere to go; Python would try again at its end, and complain."""
    with suppress(OSError, ValueError, AttributeError):
        null = os.open(os.devnull, os.O_WRONLY)
        os.dup2(null, sys.stdout.fileno())
        os.close(null)

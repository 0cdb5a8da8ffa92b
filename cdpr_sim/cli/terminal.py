"""What all commands do with a terminal: mistakes as sentences, something to look at while waiting, JSON."""

from __future__ import annotations

import json
import signal
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import typer
from rich.console import Console
from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeRemainingColumn
from rich.status import Status

import cdpr_sim as cdpr


@contextmanager
def errors_as_sentences() -> Iterator[None]:
    """No traceback for a user's mistake: one sentence on standard error, exit status 2."""
    try:
        yield
    except cdpr.CdprError as error:
        typer.echo(f"cdpr-sim: {error}", err=True)
        raise typer.Exit(2) from None


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
    console = Console(stderr=True)
    columns = TextColumn("{task.description}"), BarColumn(), TaskProgressColumn(), TimeRemainingColumn()
    with Progress(*columns, console=console, disable=not console.is_terminal) as progress:

        def add(what: str) -> Callable[[float], None]:
            task = progress.add_task(what, total=1.0)
            return lambda done: progress.update(task, completed=done)

        yield add


def print_json(value: dict[str, Any]) -> None:
    """On standard output, indented."""
    typer.echo(json.dumps(value, indent=2))

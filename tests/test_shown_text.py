"""Texts that a person reads, as they were when they were reviewed: ``pytest --update-snapshots`` writes them."""

import pytest
from typer.testing import CliRunner

from cdpr_sim.cli import COMMANDS, app


@pytest.mark.parametrize("command", ["", *COMMANDS])
def test_help_is_as_reviewed(command, snapshot, monkeypatch):
    """Of each command: what it does, its arguments and options with their units and defaults."""
    monkeypatch.setenv("COLUMNS", "100")
    result = CliRunner().invoke(app, [*command.split(), "--help"], prog_name="cdpr-sim")
    assert result.exit_code == 0
    snapshot(f"help/{command or 'cdpr-sim'}.txt", result.stdout)

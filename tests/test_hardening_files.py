"""What lies beside the code: licence, citation, changes, how to contribute; and what an installed package brings."""

import os
import re
import subprocess
import sys
import tomllib
from pathlib import Path

from typer.testing import CliRunner

import cdpr_sim as cdpr
from cdpr_sim.cli import app

ROOT = Path(cdpr.__file__).parents[1]
VERSION = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["version"]


def test_the_licence_is_mit_and_the_package_says_so():
    """By name in the metadata as well."""
    text = (ROOT / "LICENSE").read_text()
    assert text.startswith("MIT License\n")
    assert "the cdpr_sim authors" in text
    assert tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["license"] == "MIT"


def test_the_package_brings_its_types():
    """``py.typed`` beside ``__init__.pyi``, as type checkers ask for."""
    assert (ROOT / "cdpr_sim" / "py.typed").exists()


def test_the_version_is_that_of_the_metadata_and_costs_no_import():
    """Asked for, nothing heavy is loaded."""
    program = "import sys, cdpr_sim; print(cdpr_sim.__version__, 'numpy' in sys.modules)"
    told = subprocess.run([sys.executable, "-c", program], cwd=ROOT, capture_output=True, text=True, timeout=60)
    version, heavy = told.stdout.split()
    assert heavy == "False"
    assert version in (VERSION, "unknown")
    assert cdpr.__version__ == version
    assert CliRunner().invoke(app, ["--version"]).stdout == f"cdpr-sim {version}\n"


def test_the_citation_names_the_version_and_the_paper():
    """What people need to cite both."""
    text = (ROOT / "CITATION.cff").read_text()
    assert text.startswith("cff-version: 1.2.0\n")
    assert f"\nversion: {VERSION}\n" in text
    assert "Towards Solving Cable-Driven Parallel Robot Inaccuracy due to Cable Elasticity" in text
    assert "ICRA 2024" in text
    for key in ("message", "title", "authors", "type", "license"):
        assert re.search(rf"^{key}:", text, re.MULTILINE), key


def test_the_changelog_has_the_version():
    """And what is to come."""
    headings = re.findall(r"^## (.+)$", (ROOT / "CHANGELOG.md").read_text(), re.MULTILINE)
    assert headings[0] == "Unreleased"
    assert VERSION in headings


def test_what_contributors_are_sent_to_is_there():
    """Every path of "to change X, touch Y", and every folder of the package is somebody's."""
    text = (ROOT / "CONTRIBUTING.md").read_text()
    assert "To change X, touch Y" in text
    places = set(re.findall(r"`((?:cdpr_sim|tests|\.ci)/[^`]*|pyproject\.toml)`", text))
    for place in places:
        assert (ROOT / place).exists(), place
    for folder in (ROOT / "cdpr_sim").iterdir():
        if (folder / "__init__.py").exists():
            assert any(place.startswith(f"cdpr_sim/{folder.name}/") for place in places), folder.name
    for link in re.findall(r"\]\(([^)#:]+)\)", text):
        assert (ROOT / link).exists(), link


def test_the_table_of_files_that_a_change_touches_names_files_and_counts_them():
    """Every path exists in the package or in the repository, but for new files; and each row's count is its own."""
    table = (
        (ROOT / "CONTRIBUTING.md").read_text().partition("## How many files a change touches")[2].partition("\n## ")[0]
    )
    rows = re.findall(r"^\| [^|]+ \| (\d+)(?: more)? \| ([^|]+) \|$", table, re.MULTILINE)
    assert len(rows) > 10
    for count, cell in rows:
        paths = re.findall(r"`([^`]+)`", cell)
        assert len(set(paths)) == int(count), cell
        for path in paths:
            assert "NAME" in path or (ROOT / path).exists() or (ROOT / "cdpr_sim" / path).exists(), path


def test_ci_leaves_the_folder_that_it_is_called_in_as_it_is(tmp_path):
    """README's tests run in a copy, with what is not committed yet, and a developer's .venv is not touched."""
    here, beside = tmp_path / "checkout", tmp_path / "beside"
    (here / ".ci").mkdir(parents=True)
    (here / ".ci" / "run").write_bytes((ROOT / ".ci" / "run").read_bytes())
    (here / ".venv").mkdir()
    (here / ".venv" / "mine").write_text("mine")
    (here / "new.py").write_text("")
    (here / "README.md").write_text(
        "<!-- tests -->\n```sh\nls -A > $SEEN && mkdir .venv && touch made && exit 7\n```\n"
    )
    beside.mkdir()
    for browser in ("chromium", "chromedriver"):  # as if they were installed
        (beside / browser).touch(0o755)
    before = {path: path.stat().st_mtime_ns for path in here.rglob("*")}
    place = os.environ | {
        "PATH": f"{beside}:{os.environ['PATH']}",
        "SEEN": str(tmp_path / "seen"),
        "TMPDIR": str(beside),
    }
    done = subprocess.run(["bash", here / ".ci" / "run"], env=place, capture_output=True, text=True, timeout=60)
    assert done.returncode == 7, done.stderr
    assert (tmp_path / "seen").read_text().split() == [".ci", "README.md", "new.py"]
    assert {path: path.stat().st_mtime_ns for path in here.rglob("*")} == before
    assert {path.name for path in beside.iterdir()} == {"chromium", "chromedriver"}

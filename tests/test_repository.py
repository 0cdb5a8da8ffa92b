"""What lies beside the code: licence, citation, changes, how to contribute, and the script of all checks."""

import os
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import conftest
import pytest
from inputs import run

import cdpr_sim as cdpr

ROOT = Path(cdpr.__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
VERSION = PROJECT["version"]


def test_the_licence_the_types_and_the_version_are_those_of_the_metadata():
    """MIT, ``py.typed`` beside ``__init__.pyi``; to ask for the version loads nothing heavy."""
    assert (ROOT / "LICENSE").read_text().startswith("MIT License\n")
    assert "the cdpr_sim authors" in (ROOT / "LICENSE").read_text()
    assert PROJECT["license"] == "MIT"
    assert (ROOT / "cdpr_sim" / "py.typed").exists()
    program = "import sys, cdpr_sim; print(cdpr_sim.__version__, 'numpy' in sys.modules)"
    told = subprocess.run([sys.executable, "-c", program], cwd=ROOT, capture_output=True, text=True, timeout=60)
    version, heavy = told.stdout.split()
    assert (version in (VERSION, "unknown"), heavy) == (True, "False")
    assert cdpr.__version__ == version
    assert run("--version").stdout == f"cdpr-sim {version}\n"


def test_the_citation_and_the_changelog_have_the_version():
    """And name the paper; what is to come is first."""
    text = (ROOT / "CITATION.cff").read_text()
    assert text.startswith("cff-version: 1.2.0\n")
    assert f"\nversion: {VERSION}\n" in text
    assert "Towards Solving Cable-Driven Parallel Robot Inaccuracy due to Cable Elasticity" in text
    assert "ICRA 2024" in text
    for key in ("message", "title", "authors", "type", "license"):
        assert re.search(rf"^{key}:", text, re.MULTILINE), key
    headings = re.findall(r"^## (.+)$", (ROOT / "CHANGELOG.md").read_text(), re.MULTILINE)
    assert headings[0] == "Unreleased"
    assert VERSION in headings


def test_what_contributors_are_sent_to_is_there():
    """Every path of "to change X, touch Y", each folder of the package, and each row's files, which it counts."""
    text = (ROOT / "CONTRIBUTING.md").read_text()
    places = set(re.findall(r"`((?:cdpr_sim|tests|\.ci)/[^`]*|pyproject\.toml)`", text.partition("To change X")[2]))
    assert [place for place in places if not (ROOT / place).exists() and "NAME" not in place] == []
    for folder in (ROOT / "cdpr_sim").iterdir():
        if (folder / "__init__.py").exists():
            assert any(place.startswith(f"cdpr_sim/{folder.name}/") for place in places), folder.name
    assert [link for link in re.findall(r"\]\(([^)#:]+)\)", text) if not (ROOT / link).exists()] == []
    table = text.partition("## How many files a change touches")[2].partition("\n## ")[0]
    rows = re.findall(r"^\| [^|]+ \| (\d+)(?: more)? \| ([^|]+) \|$", table, re.MULTILINE)
    assert len(rows) > 10
    for count, cell in rows:
        paths = re.findall(r"`([^`]+)`", cell)
        assert len(set(paths)) == int(count), cell
        for path in paths:
            assert "NAME" in path or (ROOT / path).exists() or (ROOT / "cdpr_sim" / path).exists(), path


CI = """\
place=$1 && shift
git() { command git -c user.name=me -c user.email=me@example.org "$@"; }
mkdir -p checkout/.ci checkout/.venv beside && cd checkout
cp "$place"/.ci/{run,floor.txt} .ci
touch .venv/mine pyproject.toml removed.py
echo .venv > .gitignore
printf '%s\\n' '<!-- tests -->' '```sh' "$*" '```' > README.md
git init -q && git add . && git commit -qm all && rm removed.py && touch new.py
cat > ../beside/python3 <<'END' # makes environments without their programs
[ "$2" != venv ] || { mkdir -p "$3/bin" && for name in pip ruff python mkdocs pyright; do
    ln -s "$(type -P true)" "$3/bin/$name"; done; }
END
touch ../beside/{google-chrome,chromedriver}
echo 'echo libEGL.so.1' > ../beside/ldconfig && chmod +x ../beside/*
"""
"""A checkout with an environment, a removed file and a new one; README's tests are a command of ours."""


def ci(tmp_path: Path, command: str) -> subprocess.Popen:
    """``.ci/run``, where README's tests are ``command`` and all other programs do nothing."""
    subprocess.run(["bash", "-euc", CI, "ci", str(ROOT), command], cwd=tmp_path, check=True)
    environment = os.environ | {
        "PATH": f"{tmp_path / 'beside'}:{os.environ['PATH']}",
        "CDPR_SIM_CI": str(tmp_path / "place"),
        "AT": str(tmp_path),
    }
    words = ["bash", tmp_path / "checkout" / ".ci" / "run"]
    return subprocess.Popen(words, env=environment, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)


def test_ci_leaves_the_folder_that_it_is_called_in_as_it_is(tmp_path):
    """README's tests run in a copy of what a commit would contain, and a developer's .venv is not touched."""
    process = ci(tmp_path, "ls -A > $AT/seen && mkdir .venv && touch made && exit 7")
    said, _ = process.communicate(timeout=60)
    assert process.returncode == 7, said
    expected = [".ci", ".gitignore", "README.md", "new.py", "pyproject.toml"]
    assert sorted((tmp_path / "seen").read_text().split()) == sorted(expected)
    assert {path.name for path in (tmp_path / "checkout").iterdir()} == {*expected, ".git", ".venv"}
    assert [path.name for path in (tmp_path / "checkout" / ".venv").iterdir()] == ["mine"]


def test_ci_fails_where_a_test_is_skipped_that_could_have_run(tmp_path):
    """It installs Chromium; the tests of JAX have a step of their own."""
    line = "SKIPPED [1] tests/test_html_page.py:335: Chromium and its driver are not installed"
    allowed = "SKIPPED [1] tests/test_jax.py:15: could not import 'jax': No module named 'jax'"
    process = ci(tmp_path, f"echo \"{allowed}\"; echo '{line}'; echo '5 passed, 2 skipped in 1.00s'")
    said, _ = process.communicate(timeout=60)
    assert process.returncode == 1, said
    assert f"\n5 passed, 2 skipped in 1.00s\n{line}\n== failed: these tests were skipped" in said


def test_of_two_runs_of_ci_one_waits_for_the_other(tmp_path):
    """And says so; both share compiled code and environments."""
    (tmp_path / "place").mkdir()
    with (tmp_path / "place" / "lock").open("w") as lock:
        fcntl = pytest.importorskip("fcntl", reason="Windows has no locks of this kind")
        fcntl.flock(lock, fcntl.LOCK_EX)
        process = ci(tmp_path, "exit 7")
        assert process.stdout is not None
        assert "this one waits until it ends" in process.stdout.readline()
        assert process.poll() is None
    process.communicate(timeout=60)
    assert process.returncode == 7


def test_every_dependency_with_an_oldest_version_has_tests_that_run_with_it():
    """All but those of the manual, which ``.ci/run --all`` builds with them, and MJX; each test exists."""
    named = {name for names in conftest.FLOOR for name in names.split(", ")}
    oldest = {line.partition("==")[0] for line in (ROOT / ".ci" / "floor.txt").read_text().split()}
    assert oldest - named == {"mujoco-mjx", "mkdocs-material", "mkdocstrings", "latex2mathml"}
    for test in (test for tests in conftest.FLOOR.values() for test in tests):
        file, _, function = test.partition("::")
        assert f"def {function}" in (ROOT / "tests" / file).read_text(), test

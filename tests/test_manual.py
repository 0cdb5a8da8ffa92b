"""README and the manual say what is so: their Python and their commands run, their links lead somewhere."""

import hashlib
import importlib.util
import inspect
import json
import os
import re
import shlex
import shutil
import signal
import subprocess
import sys
import tomllib
from collections.abc import Callable, Iterator
from pathlib import Path
from types import ModuleType
from typing import Any, get_type_hints

import pytest

import cdpr_sim as cdpr
import paper_figures
from cdpr_sim.cli import COMMANDS
from cdpr_sim.core import compiling

ROOT = Path(__file__).parents[1]
FILES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").rglob("*.md"))]
PAGES = {str(path.relative_to(ROOT)): path.read_text(encoding="utf-8") for path in FILES}
README = PAGES["README.md"]

BLOCK = re.compile(r"^ *```(\w*)([^\n]*)\n(.*?)^ *```$", flags=re.DOTALL | re.MULTILINE)
"""A fenced block: its language, what stands beside that, its text."""

LINK = re.compile(r"\]\((?!\w+:|#)([^)#\s]+)")

COMMAND = re.compile(r"(?:^|.* && \.venv/bin/)cdpr-sim (.*)")
"""A command, or one behind its installation, which runs from the wheel."""

ELSEWHERE = ("python3 -m venv", ".venv/bin/", "pip install", ".ci/run")
"""Commands that install, test or build: .ci/run has them."""

SOONER = {"video": "--drive-seconds 1 --seconds 0.5", "report": "--grid 3 1 2", "map": "--points 5"}
"""Options that are added to commands that draw: of an option given twice, the last one counts."""

ROUNDING = 1e-6
"""Of errors and unbalanced forces, in the units of tables: rounding, which no two machines share. None prints more."""

NUMBER = re.compile(r"(?<![\w.])-?\d+(?:\.\d*)?(?:e[+-]?\d+)?")

VALUE = re.compile(r"[A-Z]\w+\.[A-Z]+|True|False")
"""Of an enumeration, or a truth value."""

DATA = {"", "text", "csv", "toml", "yaml"}
"""What is shown and not run; a ``title`` makes it a file for what follows."""

NEEDED = {"docs/how-to/gradients.md": "jax", "docs/how-to/warp.md": "mujoco_warp"}
"""Libraries of pages that only .ci/run has installed."""


@pytest.fixture(scope="session")
def run_page(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Callable[..., list]]:
    """Runs blocks of a page in new processes in a folder, with a wheel that is built where sources changed.

    It has one place, since compiled code belongs to a place, and what was compiled for the checkout.
    """
    filelock = pytest.importorskip("filelock")
    shared, wheel = tmp_path_factory.getbasetemp(), ROOT / ".pytest_cache" / "wheel"
    files = sorted(path for path in (ROOT / "cdpr_sim").rglob("*.*") if "__pycache__" not in path.parts)
    packed = [ROOT / "pyproject.toml", *(path for path in files if path.is_file())]
    key = hashlib.sha256(b"\0".join(path.read_bytes() for path in packed)).hexdigest()
    wheel.parent.mkdir(exist_ok=True)
    with filelock.FileLock(wheel.with_suffix(".lock")):
        if not (wheel / key).exists():
            shutil.rmtree(wheel, ignore_errors=True)
            install = [sys.executable, "-m", "pip", "install", "-q", "--no-deps", "--target", str(wheel)]
            install += ["--no-build-isolation"] if importlib.util.find_spec("hatchling") else []
            subprocess.run([*install, str(ROOT)], check=True, timeout=100)
            (wheel / key).touch()
        for path in files:
            if (same := wheel / path.relative_to(ROOT)).exists():
                shutil.copystat(path, same)  # Numba takes code of other dates for that of other sources
        hand_over_compiled_code(wheel)
    path = os.pathsep.join([str(wheel / "bin"), os.environ["PATH"]])
    one_thread = {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}  # a fork has no other thread
    server = subprocess.Popen(
        [sys.executable, Path(__file__).with_name("page_server.py")], cwd=shared, text=True, start_new_session=True,
        stdin=subprocess.PIPE, stdout=subprocess.PIPE,
        env={**os.environ, **one_thread, "PYTHONPATH": str(wheel), "PATH": path, "COLUMNS": "100"},
    )  # fmt: skip
    assert server.stdin
    assert server.stdout

    def run(page: str, folder: Path, blocks: list) -> list:
        print(json.dumps([page, str(folder), blocks]), file=server.stdin, flush=True)
        assert server.stdout.readline() == "done\n"
        return json.loads((folder / "answers").read_text())

    yield run
    os.killpg(server.pid, signal.SIGKILL)
    server.communicate()


def hand_over_compiled_code(wheel: Path) -> None:
    """Copies what Numba keeps for the checkout's sources to where it looks for the wheel's, which are the same.

    If Numba finds no use for it, it compiles.
    """
    ask = [sys.executable, "-c", "from cdpr_sim.core import compiling; print(compiling.place() or '')"]
    answer = subprocess.run(
        ask, check=True, capture_output=True, text=True, env={**os.environ, "PYTHONPATH": str(wheel)}
    )
    mine, theirs = compiling.place(), answer.stdout.strip()
    for source in {path.parent for path in (ROOT / "cdpr_sim").rglob("*.py")} if mine and theirs else ():
        here, there = (
            f"{folder.name}_{hashlib.sha1(str(folder).encode()).hexdigest()}"
            for folder in (source, wheel / source.relative_to(ROOT))
        )
        for kept in mine.glob(f"*/{here}"):
            shutil.copytree(kept, Path(theirs, kept.parent.name, there), dirs_exist_ok=True)


def comparable(text: str) -> list[str]:
    """Lines as every machine prints them: with what is rounding called 0."""
    zero = re.sub(r"\d\.\d+e-\d+", lambda one: "0" if float(one[0]) < ROUNDING else one[0], text)
    return [" ".join(line.split()) for line in zero.splitlines() if line.strip()]


def unprinted(comment: str, printed: str) -> list[str]:
    """What a comment beside ``print`` claims and is not printed: numbers, as precise as they are given, and values."""
    numbers = [float(one) for one in NUMBER.findall(printed)]
    missing = [one for one in VALUE.findall(comment) if one not in printed]
    for one in NUMBER.findall(comment):
        half = 0.5 * 10.0 ** -len(one.partition(".")[2])
        if not any(abs(float(one) - number) <= half * (1 + 1e-9) for number in numbers):
            missing.append(one)
    return missing


def steps(page: str, folder: Path) -> list[tuple[str, int, Any]]:
    """What a page has to be run or compared: (language, line, text or words). Files that it shows are written."""
    found: list[tuple[str, int, Any]] = []
    for block in BLOCK.finditer(PAGES[page]):
        language, beside, text = block.groups()
        line = PAGES[page][: block.start(3)].count("\n") + 1
        title = re.search(r'title="([^"]+)"', beside)
        if language == "python":
            found.append((language, line, text))
        elif language == "sh":
            for command in text.replace("\\\n", " ").splitlines():
                if runs := COMMAND.match(command):
                    words = shlex.split(runs[1])
                    found.append((language, line, words + SOONER.get(words[0], "").split()))
                elif command.startswith("python scripts/"):
                    assert (ROOT / shlex.split(command)[1]).is_file(), f"{page}, line {line}: {command}"
                else:
                    assert command.startswith(ELSEWHERE), f"{page}, line {line}: nothing runs {command!r}"
        else:
            assert language in DATA, f"{page}, line {line}: nothing runs {language!r}"
            if language == "toml":
                tomllib.loads(text)
            if (title and title[1] == "prints") or (page == "README.md" and language == "text"):
                found.append(("prints", line, comparable(text)))
            elif title:
                (folder / title[1]).write_text(text, encoding="utf-8")
    return found


@pytest.mark.timeout(400)  # the first page on a machine compiles what it calls, once more for the wheel's place
@pytest.mark.parametrize("page", [page for page in PAGES if BLOCK.search(PAGES[page])])
def test_blocks_run_as_printed(page, tmp_path, run_page):
    """In order, from the installed wheel, in a folder that is not the clone; they print what is shown.

    README shows some of the rows that its command prints, and other pages all of them.
    """
    if page in NEEDED:
        pytest.importorskip(NEEDED[page])
    every = steps(page, tmp_path)
    run = [one for one in every if one[0] != "prints"]
    answers = iter(run_page(page, tmp_path, run) if run else [])
    printed: Any = ""
    for language, line, what in every:
        if language == "prints":
            rows = comparable(printed)
            assert what == [row for row in rows if row in what or page != "README.md"], f"{page}, line {line}"
            continue
        printed, error = next(answers)
        assert not error, f"{page}, line {line}:\n{error}"
        for at, said in printed.items() if language == "python" else ():
            shown = what.splitlines()[int(at) - line]
            assert unprinted(shown.partition("  # ")[2], said) == [], f"{page}, line {at}: {shown}, printed {said}"


def test_pages_run_from_the_wheel_and_faults_are_named_by_page_and_line(tmp_path, run_page):
    """Negative controls: a name that a page does not define, one of another page, and a command that fails."""
    (where, _), (_, error) = run_page("a.md", tmp_path, [
        ("python", 3, "import cdpr_sim\nprint(cdpr_sim.__file__)"), ("python", 9, "\nundefined")
    ])  # fmt: skip
    assert Path(where["4"].strip()).parents[1].name == "wheel"
    assert 'File "a.md", line 10' in error
    assert "NameError" in run_page("b.md", tmp_path, [("python", 1, "cdpr_sim")])[0][1]
    assert "exit status 2: " in run_page("c.md", tmp_path, [("sh", 1, ["settle", "nobody"])])[0][1]


@pytest.mark.parametrize("page", PAGES)
def test_links_lead_to_files(page):
    """Every relative link, where the repository is browsed; of the manual that is built, mkdocs checks them."""
    here = (ROOT / page).parent
    assert [link for link in LINK.findall(PAGES[page]) if not (here / link).exists()] == []


def test_readme_is_short_and_its_commands_stand_behind_their_markers():
    """.ci/run takes the two commands from README by these."""
    assert README.count("\n") <= 150
    for marker, word in (("main job", "cdpr-sim settle"), ("tests", "pytest")):
        assert re.search(rf"<!-- {marker} -->\n```sh\n.*{word}.*\n```\n", README)
    assert "libegl1" in README  # what OpenGL needs of the system


def test_what_is_shown_and_not_printed_is_noticed():
    """Negative controls: one digit, one cable, an error that is no rounding, a word."""
    (shown,) = (text for language, _, text in BLOCK.findall(README) if language == "text")
    assert "fsolve" not in shown  # where it stalls depends on rounding
    for old, new, same in (
        ("26.420", "26.421", False),
        ("4 of 8", "3 of 8", False),
        ("e-11 mm", "e-04 mm", False),
        ("e-11 mm", "e-12 mm", True),
        ("agree", "disagree", False),
    ):
        assert old in shown
        assert (comparable(shown.replace(old, new, 1)) == comparable(shown)) is same, (old, new)
    assert unprinted("[0.13 6.16] m, 280 N: Verdict.AGREE", "0.1267 6.16 279.6 Verdict.AGREE") == []
    assert unprinted("0.13 281 Verdict.AGREE False", "0.1257 279.6 Verdict.DISAGREE 0.12") == [
        "Verdict.AGREE",
        "False",
        "281",
    ]


def test_every_picture_is_in_the_gallery_with_a_command():
    """Beside each, or above the next one's title, stands what made it."""
    gallery = PAGES["docs/gallery.md"]
    shown = re.findall(r"\(\.\./(pictures/[^)]+)\)", gallery)
    assert sorted(shown) == sorted(f"pictures/{path.name}" for path in (ROOT / "pictures").iterdir())
    for name in shown:
        assert re.match(r"\)\n\n(!\[[^\n]*\n\n)?```sh\n(python scripts/|cdpr-sim )", gallery.partition(name)[2]), name


def test_every_figure_that_the_gallery_names_is_one():
    """And what its command is given."""
    named = re.findall(r"^\| `([\w-]+)` \|", PAGES["docs/gallery.md"], flags=re.MULTILINE)
    named += re.findall(r"paper_figures\.py ([\w-]+)", PAGES["docs/gallery.md"])
    assert set(named) <= paper_figures.PICTURES.keys()


def test_every_robot_is_on_its_page():
    """Once each."""
    named = re.findall(r"`([\w-]+)`(?=[,` |])", "\n".join(re.findall(r"^\|([^|]+)\|", PAGES["docs/robots.md"], re.M)))
    assert sorted(named) == sorted(cdpr.list_robots())


def test_every_public_name_is_in_the_api():
    """Once each."""
    named = re.findall(r"^::: cdpr_sim\.(\w+)$", "\n".join(PAGES.values()), flags=re.MULTILINE)
    assert sorted(named) == sorted(cdpr.__all__)


def test_public_functions_say_what_they_return():
    """A section of the docstring, but where nothing is returned."""
    functions = [(name, getattr(cdpr, name)) for name in cdpr.__all__]
    for name, one in list(functions):
        if inspect.isclass(one):
            functions += [(f"{name}.{of}", method) for of, method in vars(one).items() if not of.startswith("_")]
    checked = 0
    for name, one in functions:
        function = getattr(one, "__func__", one)
        if inspect.isfunction(function) and function.__module__.startswith("cdpr_sim"):
            returns = function.__annotations__.get("return")
            assert returns in ("None", None) or "\nReturns:" in inspect.getdoc(function), name
            checked += 1
    assert checked > 80


@pytest.fixture(scope="module")
def hooks() -> ModuleType:
    """What builds the manual."""
    spec = importlib.util.spec_from_file_location("hooks", ROOT / "docs" / "hooks.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_the_page_of_commands_has_every_option(hooks):
    """As typer knows them."""
    page = hooks.commands()
    for name, command in COMMANDS.items():
        assert f"\n## {name}\n" in page
        section = page.partition(f"\n## {name}\n")[2].partition("\n## ")[0]
        for hint in get_type_hints(command, include_extras=True).values():
            for flag in getattr(next(iter(getattr(hint, "__metadata__", ())), None), "param_decls", None) or ():
                assert flag in section, (name, flag)

"""Compiled code gives the answers of interpreted code, is built once, and its cache never stands in the way."""

import ast
import errno
import importlib.util
import os
import pickle
import re
import shutil
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from types import ModuleType, SimpleNamespace

import numba
import numpy as np
import pytest
from numba.core import config

import cdpr_sim as cdpr
from cdpr_sim.core import code_cache, compiling

PACKAGE = Path(cdpr.__file__).parent

FOREVER = 120.0
"""Seconds: the scripts below take three, on a machine that does other things as well thirty."""


def start(folder: Path, text: str, name: str = "script.py", words: Sequence[str] = (), **place) -> subprocess.Popen:
    """A script that is run by itself, with the machine code of this folder alone."""
    script = folder / name
    if not script.exists() or script.read_text() != text:  # Numba 0.61 compiles anew what has another time
        script.write_text(text)
    environment = os.environ | {"PYTHONPATH": str(PACKAGE.parent), "NUMBA_CACHE_DIR": str(folder / "cache")} | place
    pipes = dict(stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    return subprocess.Popen([sys.executable, name, *words], cwd=folder, env=environment, **pipes)


def finished(process: subprocess.Popen) -> tuple[list[str], str]:
    """The words that it printed, and what it said beside them; a process that waits for ever is killed."""
    try:
        printed, said = process.communicate(timeout=FOREVER)
    except subprocess.TimeoutExpired:
        process.kill()
        pytest.fail(f"it waits for ever, and said {process.communicate()}")
    assert process.returncode == 0, said
    return printed.split(), said


INTERPRETED = """
import sys, numpy as np, cdpr_sim as cdpr
for name in sys.argv[1:]:
    np.save(f"{name}.npy", cdpr.solve_many(cdpr.load_robot(name), np.load("poses.npy")).positions)
assert "numba" not in sys.modules
"""


def test_few_answers_are_interpreted_and_many_compiled_and_they_are_the_same(catalogue, tmp_path):
    """To the last bit; over pulleys to rounding, since NumPy has an arctan2 of its own; for very many to 1e-9 m."""
    names, poses = ["parallel", "planar-vertical", "irma4u"], np.random.default_rng(0).uniform(0.3, 0.5, (20, 3))
    poses[:, 1] = 0
    np.save(tmp_path / "poses.npy", poses)
    finished(start(tmp_path, INTERPRETED, words=names))
    for name in names:
        interpreted, tolerance = np.load(tmp_path / f"{name}.npy"), 1e-12 if name == "irma4u" else 0.0
        for times, within in ((compiling.FEW // 20 + 1, tolerance), (compiling.LANES_FROM // 20, 1e-9)):
            many = cdpr.solve_many(catalogue[name], np.tile(poses, (times, 1))).positions
            np.testing.assert_allclose(many, np.tile(interpreted, (times, 1)), rtol=0, atol=within)


# --- once ---------------------------------------------------------------------------------------------------------

DOUBLED = """
import sys
import numpy as np
from cdpr_sim.core import compiling

def times(factor):
    def scaled(value, result):
        result[0] = factor * value
    return scaled

kernel, many = compiling.Kernel("double", times(2.0), "()->()"), np.arange(1000.0)
"""

SEVERAL = (
    DOUBLED
    + """
kernels = {"two": compiling.Kernel("twofold", times(2.0), "()->()"),
           "three": compiling.Kernel("threefold", times(3.0), "()->()")}
print(kernel(many).sum(), *(kernels[name].compiled(1.0) for name in sys.argv[1:]))
"""
)


def contents(folder: Path) -> dict[str, bytes]:
    """Of all files in it."""
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def test_processes_that_come_at_once_all_compile_and_the_next_loads(tmp_path):
    """Nobody waits, it is said, and what they leave is loaded by the next one in silence, and not changed by it."""
    at_once = [start(tmp_path, SEVERAL, words=[name]) for name in ("two", "three")]
    for process, answer in zip(at_once, ("2.0", "3.0"), strict=True):
        printed, said = finished(process)
        assert printed == ["999000.0", answer]
        assert "cdpr_sim compiles its double: up to a minute, once on this machine" in said
    before = contents(tmp_path / "cache")
    assert len(before) == 12  # of each kernel an index and code, of the function and of its loop
    assert finished(start(tmp_path, SEVERAL, words=["two", "three"])) == (["999000.0", "2.0", "3.0"], "")
    assert contents(tmp_path / "cache") == before


@pytest.fixture
def empty_cache(monkeypatch, tmp_path) -> Path:
    """A folder without machine code."""
    monkeypatch.setattr(code_cache, "folder", lambda: tmp_path)
    return tmp_path


def doubled(value, result):
    result[0] = 2.0 * value


def several_doubled() -> np.ndarray:
    """By a new kernel, of more values than are interpreted."""
    return compiling.Kernel("test", doubled, "()->()")(np.ones(compiling.FEW + 1))


@pytest.mark.parametrize("wrong", ["empty", "truncated", "of another Numba", "of other sources", "lost", "no code"])
def test_a_cache_that_cannot_be_used_is_left_as_it_is(empty_cache, caplog, wrong):
    """What is compiled instead is kept beside it, and found there from then on."""
    several_doubled()
    for index in empty_cache.rglob("*.nb[ci]" if wrong == "no code" else "*.nbi"):
        if wrong == "lost":
            index.unlink()
        elif wrong in ("empty", "no code"):
            index.write_bytes(b"")
        elif wrong == "truncated":
            index.write_bytes(index.read_bytes()[:-20])
        else:
            version, rest = numba.__version__, index.read_bytes()[len(pickle.dumps(numba.__version__, -1)) :]
            stamp, names = pickle.loads(rest)
            found = ("0.1", stamp) if wrong == "of another Numba" else (version, "another")
            index.write_bytes(pickle.dumps(found[0], -1) + pickle.dumps((found[1], names), -1))
    before = contents(empty_cache)
    assert (several_doubled() == 2.0).all()
    beside = contents(empty_cache)
    assert before.items() < beside.items()
    assert len(caplog.messages) == 2
    assert (several_doubled() == 2.0).all()
    assert contents(empty_cache) == beside
    assert len(caplog.messages) == 2


@pytest.mark.parametrize("error", [KeyboardInterrupt(), OSError(errno.ENOSPC, "No space left on device")])
def test_a_compilation_that_fails_leaves_nothing(empty_cache, error, monkeypatch):
    """Neither Ctrl-C nor a full disk; the latter is one sentence. Numba's settings are the user's again."""
    monkeypatch.setitem(vars(config), "CACHE_DIR", "theirs")
    optimised = config.OPT

    def fail():
        with compiling._optimised(1):
            (Path(vars(config)["CACHE_DIR"]) / "part").mkdir(parents=True)
            raise error

    with pytest.raises((KeyboardInterrupt, cdpr.StoreError)) as raised:
        code_cache.fetch("test", fail, fail)
    assert list(empty_cache.iterdir()) == []
    assert vars(config)["CACHE_DIR"] == "theirs"
    assert vars(config)["OPT"] is optimised
    if isinstance(error, OSError):
        expected = (
            f"compiled code: cannot be written to {empty_cache}: No space left on device; expected space, or NUMBA"
        )
        assert str(raised.value).startswith(expected)


# --- nobody waits for ever ----------------------------------------------------------------------------------------

IN_THREADS = (
    DOUBLED
    + """
import threading
threads = [threading.Thread(target=lambda: print(f"{kernel(many).sum()}\\n", end="")) for _ in range(8)]
for thread in threads:
    thread.start()
for thread in threads:
    thread.join()
"""
)


def test_threads_that_come_at_once_compile_once_also_in_a_script_called_coverage(tmp_path):
    """Numba's import runs a module of that name: it waited for its threads, which waited for that import."""
    printed, said = finished(start(tmp_path, IN_THREADS, "coverage.py"))
    assert printed == ["999000.0"] * 8
    assert said.count("compiles its double") == 1


FORK = (
    DOUBLED
    + """
import os, threading, time
import cdpr_sim
there = threading.Event()

def here(*_):
    there.set()
    time.sleep(0.05)

if WHERE == "imports":
    class Finder:
        def find_spec(self, name, path=None, target=None):
            if name == "numba.np.ufunc":
                here()
    sys.meta_path.insert(0, Finder())
else:
    from numba.core import event
    class Listener(event.Listener):
        on_start = on_end = here
    event.register("numba:run_pass", Listener())

thread = threading.Thread(target=lambda: kernel(many))
thread.start()
there.wait()
child = os.fork()
if child == 0:
    try:
        print(kernel(many).sum(), flush=True)
    except cdpr_sim.CdprError as error:
        print(error, flush=True)
    os._exit(0)
os.waitpid(child, 0)
thread.join()
"""
)


@pytest.mark.skipif(not hasattr(os, "fork"), reason="there is nothing to inherit")
@pytest.mark.parametrize(
    ("where", "said"),
    [
        ("imports", "compiled code: this process was forked while another thread of its parent"),
        ("compiles", "999000.0"),
    ],
)
def test_a_child_that_is_forked_amid_an_import_refuses_and_amid_a_compilation_computes(tmp_path, where, said):
    """Locks of Python and of Numba were inherited from a thread that does not exist in the child."""
    printed, _ = finished(start(tmp_path, f"WHERE = {where!r}" + FORK))
    assert " ".join(printed).startswith(said)


INTERRUPTS = (
    DOUBLED
    + """
import random, signal
from concurrent.futures import ThreadPoolExecutor

compiling.import_numba()
compiling.code_cache.fetch = lambda *_: len  # nothing is compiled: all time is spent around the lock
random.seed(0)
armed = False

def interrupt(*_):
    global armed
    if armed:
        armed = False
        raise KeyboardInterrupt

def ask(one):
    one._compiled = None
    return one.compiled

signal.signal(signal.SIGALRM, interrupt)
other, kept, pool = compiling.Kernel("other", times(1.0), "()->()"), [], ThreadPoolExecutor(1)
for _ in range(1000):
    try:
        armed = True
        signal.setitimer(signal.ITIMER_REAL, random.uniform(5e-6, 1e-4))
        while True:
            ask(kernel)
    except KeyboardInterrupt as error:
        kept.append(error)  # as a notebook keeps the last one: with its frames
    pool.submit(ask, other).result(timeout=10)
print(len(kept))
"""
)


@pytest.mark.skipif(not hasattr(os, "fork"), reason="alarms are POSIX")
def test_no_interrupt_leaks_the_lock(tmp_path):
    """Ctrl-C, wherever it comes: another thread gets what it asks for at once."""
    assert finished(start(tmp_path, INTERRUPTS))[0] == ["1000"]


def test_waiting_for_another_threads_import_of_numba_is_said_and_ends(monkeypatch, caplog):
    """It may never finish, for example where it waits for this thread."""
    unfinished = SimpleNamespace(__spec__=SimpleNamespace(_initializing=True))
    monkeypatch.setitem(sys.modules, "numba", unfinished)
    monkeypatch.setattr(compiling, "PATIENCE", (0.02, 0.1))
    with pytest.raises(cdpr.CdprError, match=f"another thread of process {os.getpid()} has not finished importing"):
        compiling.import_numba()
    assert caplog.messages == [f"cdpr_sim waits for another thread of process {os.getpid()}, which imports Numba"]


# --- of these sources ---------------------------------------------------------------------------------------------


def imported(path: Path) -> set[Path]:
    """The files of this package that a file imports, anywhere in it."""
    found = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
        if isinstance(node, ast.ImportFrom):
            names = [str(node.module), *(f"{node.module}.{alias.name}" for alias in node.names)]
        files = {PACKAGE.parent.joinpath(*name.split(".")).with_suffix(".py") for name in names}
        found |= {file for file in files if file.is_file() and file.is_relative_to(PACKAGE)}
    return found


def test_another_text_in_any_source_that_is_compiled_is_another_cache(tmp_path):
    """Numba looks at one file's date. All kernels, whatever else imports Numba, and all that these import."""
    compiled = re.compile(r"^\s*(import numba|from numba)|(compiling\.Compiled|\bKernel)\(", re.MULTILINE)
    waiting = {path for path in PACKAGE.rglob("*.py") if compiled.search(path.read_text(encoding="utf-8"))}
    waiting |= {*PACKAGE.glob("*/*_kernel.py"), *PACKAGE.glob("statics/gufuncs.py")}
    reached = set()
    while waiting:
        reached.add(path := waiting.pop())
        waiting |= imported(path) - reached
    assert {path.relative_to(PACKAGE).as_posix() for path in reached} == set(code_cache.SOURCES)
    package = tmp_path / "cdpr_sim"
    shutil.copytree(PACKAGE, package, ignore=shutil.ignore_patterns("__pycache__"))
    before = cache_of(package).digest()
    for name in code_cache.SOURCES:
        file, text = package / name, (package / name).read_text(encoding="utf-8")
        file.write_text(text + "\nONE_MORE = 1\n", encoding="utf-8")
        assert cache_of(package).digest() != before, name
        file.write_text(text, encoding="utf-8")
    assert cache_of(package).digest() == before == code_cache.digest()


def cache_of(package: Path) -> ModuleType:
    """``core.code_cache`` of a copy of the package."""
    spec = importlib.util.spec_from_file_location("cache_of_a_copy", package / "core" / "code_cache.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


# --- where it is kept ---------------------------------------------------------------------------------------------


def test_a_system_install_computes_for_a_user_without_a_home(tmp_path):
    """From a package and with a home that cannot be written to, not even by root: it compiles, and says where to."""
    package = tmp_path / "site" / "cdpr_sim"
    shutil.copytree(PACKAGE, package, ignore=shutil.ignore_patterns("__pycache__"))
    (package / "__pycache__").write_text("")
    (tmp_path / "tmp").mkdir()
    place = dict(PYTHONPATH=str(package.parent), TMPDIR=str(tmp_path / "tmp"), HOME="/dev/null")
    script = DOUBLED + "import cdpr_sim\nprint(kernel(many).sum(), cdpr_sim.__file__)"
    printed, said = finished(start(tmp_path, script, **place, NUMBA_CACHE_DIR="", XDG_CACHE_HOME=""))
    assert printed == ["999000.0", str(package / "__init__.py")]
    for words, line in zip(("set NUMBA_CACHE_DIR", "compiles its double"), said.splitlines(), strict=True):
        assert words in line
    (kept,) = (tmp_path / "tmp").glob("cdpr_sim-*")
    assert list(kept.rglob("*.nbi"))
    assert kept.stat().st_mode & 0o077 == 0  # this user's alone, since machine code is loaded from it


def test_code_of_other_versions_and_of_killed_processes_is_cleared_away(monkeypatch, tmp_path):
    """A folder for each version of the sources would grow for ever."""
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    here = code_cache.folder.__wrapped__()  # chosen anew
    (here.parent / "0123456789abcdef").mkdir()
    for name, age in (("solver-0", 0.0), (".now", 0.0), (".killed", code_cache.ABANDONED + 60)):
        (here / name).mkdir()
        os.utime(here / name, (time.time() - age,) * 2)
    assert code_cache.folder.__wrapped__() == here
    assert [path.name for path in here.parent.iterdir()] == [code_cache.digest()]
    assert {path.name for path in here.iterdir()} == {"solver-0", ".now"}

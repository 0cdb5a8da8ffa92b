"""Machine code is built once, whoever comes first, and is never that of other sources."""

import ast
import errno
import importlib.util
import os
import pickle
import re
import shutil
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from types import FunctionType, ModuleType, SimpleNamespace

import numba
import numpy as np
import pytest
from numba.core import config, serialize

import cdpr_sim as cdpr
from cdpr_sim.core import code_cache, compiling
from cdpr_sim.statics import gufuncs

PACKAGE = Path(cdpr.__file__).parent


# --- late ---------------------------------------------------------------------------------------------------------


def sum_of(values, times, total, entries):
    """An element: scaled sum, and how many entries."""
    total[0] = 0.0
    entries[0] = len(values)
    for value in values:
        total[0] += times * value


def kernel() -> compiling.Kernel:
    """A new one, of that."""
    return compiling.Kernel("test sum", sum_of, "(n),()->(),()", ("entries",))


@pytest.fixture
def empty_cache(monkeypatch, tmp_path) -> None:
    """A folder without machine code."""
    monkeypatch.setattr(code_cache, "folder", lambda: tmp_path)


def test_few_elements_are_interpreted_and_more_are_compiled(empty_cache):
    """Up to FEW in all, and with the same answers and shapes; then the machine code is kept."""
    one, values = kernel(), np.arange(5.0)
    total, entries = one(values, 2.0)
    assert (total, entries) == (20.0, 5)
    assert np.shape(total) == np.shape(entries) == ()
    many = np.tile(values, (2, 2, 1))
    np.testing.assert_array_equal(one(many, [1.0, 3.0])[0], [[10.0, 30.0]] * 2)
    assert one._left == compiling.FEW - 5
    assert one._compiled is None
    more = one._left + 1
    several, counted = one(np.tile(values, (more, 1)), 1.0)
    assert one._compiled is not None
    np.testing.assert_array_equal(several, [10.0] * more)
    assert counted.dtype == entries.dtype == np.int64
    assert one(values, 2.0) == (20.0, 5)


def test_that_it_compiles_is_said_once(empty_cache, caplog):
    """One line as soon as something is compiled; none where it is loaded, and none while few elements are asked for."""
    kernel()(np.zeros((compiling.FEW, 2)), 1.0)
    assert not caplog.messages
    kernel()(np.zeros((compiling.FEW + 1, 2)), 1.0)
    assert caplog.messages == ["cdpr_sim compiles its test sum: up to a minute, once on this machine"]
    kernel()(np.zeros((compiling.FEW + 1, 2)), 1.0)
    assert len(caplog.messages) == 1


def test_code_is_found_whether_modules_were_compiled_or_their_bytecode_was_read(empty_cache, caplog):
    """In the latter case, a function has another pickle, since its code and module have two equal names of the file."""

    def kernel_of(term) -> compiling.Kernel:
        def total_of(values, total):
            total[0] = 0.0
            for value in values:
                total[0] += term(value)

        return compiling.Kernel("test total", total_of, "(n)->()")

    code = (lambda value: 5.0 * value).__code__
    terms = [FunctionType(code, {"__file__": file}) for file in (code.co_filename, "".join(list(code.co_filename)))]
    assert serialize.dumps(terms[0]) != serialize.dumps(terms[1])
    for term in map(compiling.inline, terms):
        np.testing.assert_array_equal(kernel_of(term)(np.ones((compiling.FEW + 1, 2))), 10.0)
    assert len(caplog.messages) == 1


@pytest.mark.parametrize("name", ["parallel", "planar-vertical", "irma4u"])
def test_interpreted_and_compiled_answers_are_the_same(catalogue, name, monkeypatch):
    """To the last bit; over pulleys to rounding, since NumPy has an arctan2 of its own."""
    robot = catalogue[name]
    solver = gufuncs.EQUILIBRIA[robot.cabling.bent]
    at = np.random.default_rng(0).uniform(robot.exits.min(0), robot.exits.max(0), (30, 3)) - [0, 0, 0.1]
    monkeypatch.setattr(solver, "_left", 0)
    compiled = cdpr.solve_many(robot, at)
    assert solver._compiled is not None
    monkeypatch.setattr(solver, "_compiled", None)
    monkeypatch.setattr(solver, "_left", len(at))
    interpreted = cdpr.solve_many(robot, at)
    assert solver._left == 0
    tolerance = 1e-12 if robot.cabling.bent else 0.0
    np.testing.assert_allclose(interpreted.positions, compiled.positions, rtol=0, atol=tolerance)
    np.testing.assert_allclose(interpreted.rotations, compiled.rotations, rtol=0, atol=tolerance)
    np.testing.assert_array_equal(interpreted.status, compiled.status)


# --- once ---------------------------------------------------------------------------------------------------------


def test_machine_code_is_built_once_however_many_threads_ask(empty_cache, monkeypatch):
    """Eight threads at once: one build, and all get its result."""
    built, got, one = [], [], kernel()
    build = one._build

    def slowly():
        time.sleep(0.05)
        built.append(build())
        return built[0]

    monkeypatch.setattr(one, "_build", slowly)
    threads = [threading.Thread(target=lambda: got.append(one.compiled)) for _ in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(built) == 1
    assert got == built * 8


DOUBLED = """
import numpy as np
from cdpr_sim.core import compiling

def doubled(value, result):
    result[0] = 2.0 * value

kernel, many = compiling.Kernel("double", doubled, "()->()"), np.arange(1000.0)
"""


def start(folder: Path, text: str, name: str = "script.py", words: Sequence[str] = ()) -> subprocess.Popen:
    """A script that is run by itself, with the machine code of this folder alone."""
    script = folder / name
    if not script.exists() or script.read_text() != text:  # Numba 0.61 compiles anew what has another time
        script.write_text(text)
    environment = os.environ | {"PYTHONPATH": str(PACKAGE.parent), "NUMBA_CACHE_DIR": str(folder / "cache")}
    pipes = dict(stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    return subprocess.Popen([sys.executable, name, *words], cwd=folder, env=environment, **pipes)  # type: ignore[call-overload]


def finished(process: subprocess.Popen) -> tuple[list[str], str]:
    """The words that it printed, and what it said beside them; a process that waits for ever is killed."""
    try:
        printed, said = process.communicate(timeout=FOREVER)
    except subprocess.TimeoutExpired:
        process.kill()
        pytest.fail(f"it waits for ever, and said {process.communicate()}")
    assert process.returncode == 0, said
    return printed.split(), said


SEVERAL = (
    DOUBLED
    + """
import sys

def times(factor):
    def scaled(value, result):
        result[0] = factor * value
    return scaled

kernels = {"two": compiling.Kernel("twofold", times(2.0), "()->()"),
           "three": compiling.Kernel("threefold", times(3.0), "()->()")}
print(kernel(many).sum(), *(kernels[name].compiled(1.0) for name in sys.argv[1:]))
"""
)


def test_processes_that_come_at_once_all_compile_and_one_publishes(tmp_path):
    """Nobody waits, nothing is left but one folder for each kernel, and the next process loads all.

    Numba names code by its function and how many came before it: what two processes compiled of one function is told
    apart.
    """
    at_once = [start(tmp_path, SEVERAL, words=[name]) for name in ("two", "three")]
    for process, answer in zip(at_once, ("2.0", "3.0"), strict=True):
        printed, said = finished(process)
        assert printed == ["999000.0", answer]
        assert "compiles its double" in said
    published = [path for place in (tmp_path / "cache" / "cdpr_sim").glob("*/*") for path in place.iterdir()]
    assert {path.name for path in published} == {"double-0", "twofold-0", "threefold-0"}
    before = [contents(path) for path in published]
    assert [len(files) for files in before] == [4, 4, 4]  # an index and code, of the function and of its loop
    assert finished(start(tmp_path, SEVERAL, words=["two", "three"])) == (["999000.0", "2.0", "3.0"], "")
    assert [contents(path) for path in published] == before


def contents(folder: Path) -> dict[str, bytes]:
    """Of all files in it."""
    return {path.name: path.read_bytes() for path in folder.rglob("*") if path.is_file()}


@pytest.mark.parametrize("wrong", ["empty", "of another Numba", "of other sources", "lost"])
def test_a_published_folder_that_cannot_be_used_is_left_as_it_is(empty_cache, tmp_path, wrong):
    """What is compiled instead is published beside it, and found there from then on."""
    values, answer = np.ones((compiling.FEW + 1, 2)), np.full(compiling.FEW + 1, 2.0)
    kernel()(values, 1.0)
    for index in (tmp_path / "test_sum-0").rglob("*.nbi"):
        if wrong == "lost":
            index.unlink()
        elif wrong == "empty":
            index.write_bytes(b"")
        else:
            version, rest = numba.__version__, index.read_bytes()[len(pickle.dumps(numba.__version__, -1)) :]
            stamp, names = pickle.loads(rest)
            found = ("0.1", stamp) if wrong == "of another Numba" else (version, "another")
            index.write_bytes(pickle.dumps(found[0], -1) + pickle.dumps((found[1], names), -1))
    before = contents(tmp_path / "test_sum-0")
    np.testing.assert_array_equal(kernel()(values, 1.0)[0], answer)
    assert contents(tmp_path / "test_sum-0") == before
    beside = contents(tmp_path / "test_sum-1")
    assert len(beside) == 4
    np.testing.assert_array_equal(kernel()(values, 1.0)[0], answer)
    assert {path.name for path in tmp_path.iterdir()} == {"test_sum-0", "test_sum-1"}
    assert contents(tmp_path / "test_sum-1") == beside


@pytest.mark.parametrize("error", [KeyboardInterrupt(), OSError(errno.ENOSPC, "No space left on device")])
def test_a_compilation_that_fails_leaves_nothing(empty_cache, tmp_path, error):
    """Neither Ctrl-C nor a full disk; the latter is one sentence."""

    def fail():
        (Path(vars(config)["CACHE_DIR"]) / "part").mkdir(parents=True)
        raise error

    with pytest.raises((KeyboardInterrupt, cdpr.StoreError)) as raised:
        code_cache.fetch("test", fail, fail)
    assert list(tmp_path.iterdir()) == []
    if isinstance(error, OSError):
        expected = f"compiled code: cannot be written to {tmp_path}: No space left on device; expected space, or NUMBA"
        assert str(raised.value).startswith(expected)


# --- nobody waits for ever ----------------------------------------------------------------------------------------

FOREVER = 120.0
"""Seconds: the scripts below take three, on a machine that does other things as well thirty."""

IN_THREADS = (
    DOUBLED
    + """
import threading
threads = [threading.Thread(target=lambda: print(f"{kernel(many).sum()}\\n", end="")) for _ in range(2)]
for thread in threads:
    thread.start()
for thread in threads:
    thread.join()
"""
)


def test_a_script_called_coverage_is_not_run_by_numbas_import(tmp_path):
    """It was run again there, and waited for its threads, which waited for that import."""
    assert finished(start(tmp_path, IN_THREADS, "coverage.py"))[0] == ["999000.0"] * 2


FORK = (
    DOUBLED
    + """
import os, sys, threading, time
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
other, kept, pool = compiling.Kernel("other", doubled, "()->()"), [], ThreadPoolExecutor(1)
for _ in range(ROUNDS):
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
    rounds = 3000
    assert finished(start(tmp_path, f"ROUNDS = {rounds}" + INTERRUPTS))[0] == [str(rounds)]


def test_waiting_for_another_threads_import_of_numba_is_said_and_ends(monkeypatch, caplog):
    """It may never finish, for example where it waits for this thread."""
    unfinished = SimpleNamespace(__spec__=SimpleNamespace(_initializing=True))
    monkeypatch.setitem(sys.modules, "numba", unfinished)  # type: ignore[arg-type]
    monkeypatch.setattr(compiling, "PATIENCE", (0.02, 0.1))
    with pytest.raises(cdpr.CdprError, match=f"another thread of process {os.getpid()} has not finished importing"):
        compiling.import_numba()
    assert caplog.messages == [f"cdpr_sim waits for another thread of process {os.getpid()}, which imports Numba"]


# --- of these sources ---------------------------------------------------------------------------------------------


def imported(path: Path) -> set[Path]:
    """The files of this package that a file imports, anywhere in it."""
    tree, found = ast.parse(path.read_text(encoding="utf-8")), set()
    for node in ast.walk(tree):
        names = []
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            names = [str(node.module), *(f"{node.module}.{alias.name}" for alias in node.names)]
        for name in names:
            file = PACKAGE.parent.joinpath(*name.split(".")).with_suffix(".py")
            found |= {file} if file.is_file() and file.is_relative_to(PACKAGE) else set()
    return found


def test_the_sources_are_all_that_compiled_code_is_made_of():
    """What is compiled, and all that it imports from this package, however far; and nothing beside it."""
    uses_numba = re.compile(r"^\s*(import numba|from numba)", re.MULTILINE)
    compiled = {path for path in PACKAGE.rglob("*.py") if uses_numba.search(path.read_text(encoding="utf-8"))}
    others = {
        PACKAGE / "drawing" / "video" / "raycast.py",
        *(PACKAGE / "statics" / f"{x}.py" for x in ("catenary", "gufuncs")),
    }
    kernels = {*PACKAGE.glob("*/*_kernel.py"), *others, PACKAGE / "core" / "lanes.py"}
    assert compiled - {PACKAGE / "core" / "compiling.py", PACKAGE / "core" / "code_cache.py"} <= kernels
    reached, waiting = set(), list(kernels)
    while waiting:
        path = waiting.pop()
        reached.add(path)
        waiting += imported(path) - reached
    assert {path.relative_to(PACKAGE).as_posix() for path in reached} == set(code_cache.SOURCES)


def cache_of(package: Path) -> ModuleType:
    """``core.code_cache`` of a copy of the package."""
    spec = importlib.util.spec_from_file_location("cache_of_a_copy", package / "core" / "code_cache.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_another_constant_in_any_source_is_another_digest(tmp_path):
    """Numba looks at one file's date; we look at all texts: one constant more or less is other machine code."""
    package = tmp_path / "cdpr_sim"
    shutil.copytree(PACKAGE, package, ignore=shutil.ignore_patterns("__pycache__"))
    before = cache_of(package).digest()
    assert before == code_cache.digest()
    for name in code_cache.SOURCES:
        file, text = package / name, (package / name).read_text(encoding="utf-8")
        file.write_text(text + "\nONE_MORE = 1\n", encoding="utf-8")
        assert cache_of(package).digest() != before, name
        file.write_text(text, encoding="utf-8")
    status = package / "core" / "status.py"
    changed = status.read_text(encoding="utf-8").replace("NEUTRAL = 1e-9", "NEUTRAL = 2e-9")
    status.write_text(changed, encoding="utf-8")
    assert cache_of(package).digest() != before
    status.write_text(changed.replace("NEUTRAL = 2e-9", "NEUTRAL = 1e-9"), encoding="utf-8")
    assert cache_of(package).digest() == before


def test_machine_code_lies_in_the_folder_of_its_digest(catalogue):
    """Of the solver, of the stiffness and of the ray caster; and none where Numba would have put it by itself."""
    from cdpr_sim.drawing.video import raycast

    assert cdpr.solve_many(catalogue["cogiro"], [(0.4, 0.25, 0.2)] * (compiling.FEW + 1)).stable.all()
    folder = code_cache.folder()
    assert folder.name == code_cache.digest()
    assert raycast._DRAW.compiled
    kept = {path.name.split(".")[0] for path in folder.rglob("*.nbi")}
    assert {"guf-newton_kernel", "guf-stiffness_kernel", "raycast"} <= kept


# --- where it is kept ---------------------------------------------------------------------------------------------


@pytest.fixture
def places(monkeypatch, tmp_path) -> dict[str, Path]:
    """A package folder, a home and a folder for temporary files of its own; what Numba is told is not set."""
    found = {name: tmp_path / name for name in ("given", "package", "home", "temporary")}
    for place in found.values():
        place.mkdir()
    code_cache.digest()  # of the true package, and kept
    monkeypatch.setattr(code_cache, "_PACKAGE", found["package"])
    monkeypatch.setattr(tempfile, "tempdir", str(found["temporary"]))
    monkeypatch.setenv("HOME", str(found["home"]))
    for name in ("NUMBA_CACHE_DIR", "XDG_CACHE_HOME"):
        monkeypatch.delenv(name, raising=False)
    return found


def block(place: Path) -> None:
    """Make a folder one that nothing can be written into, whoever tries: root may write where bits forbid it."""
    place.rmdir()
    place.write_text("a file where a folder would have to be")


def where() -> Path:
    """The folder that is chosen, anew."""
    return code_cache.folder.__wrapped__()


def test_machine_code_is_kept_with_the_package_or_where_numba_is_told_to(places, monkeypatch):
    """Beside the sources; unless NUMBA_CACHE_DIR says otherwise."""
    assert where() == places["package"] / "__pycache__" / "compiled" / code_cache.digest()
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(places["given"]))
    assert where().is_relative_to(places["given"])
    assert where().name == code_cache.digest()


def test_read_only_package_keeps_its_code_at_home_or_with_temporary_files(places, monkeypatch, caplog):
    """Installed by another user: in the cache folder of one's own; without a home, among the temporary files.

    Those are this user's alone, since machine code is loaded from them; that they do not last is said once.
    """
    block(places["package"])
    assert where().is_relative_to(places["home"] / ".cache" / "cdpr_sim")
    monkeypatch.setenv("XDG_CACHE_HOME", str(places["given"]))
    assert where().is_relative_to(places["given"] / "cdpr_sim")
    block_all = [places["home"], places["given"]]
    for place in block_all:
        shutil.rmtree(place)
        place.mkdir()
        block(place)
    first = where()
    assert first.parent.parent == places["temporary"]
    assert first.parent.stat().st_mode & 0o077 == 0
    assert first == where()  # found again by the next process
    assert len(caplog.messages) == 1
    assert "no lasting folder can be written; set NUMBA_CACHE_DIR" in caplog.messages[0]
    first.parent.chmod(0o777)
    for somebodys in ("folder", "file"):
        elsewhere = where()
        assert elsewhere.parent != first.parent
        assert elsewhere.parent.parent == places["temporary"]
        assert list(elsewhere.iterdir()) == []
        if somebodys == "folder":
            shutil.rmtree(first.parent)
            first.parent.write_text("somebody else's")
    monkeypatch.setattr(tempfile, "tempdir", str(places["temporary"] / "nowhere"))
    expected = r"found no folder for compiled code that can be written to .* expected NUMBA_CACHE_DIR"
    with pytest.raises(cdpr.StoreError, match=expected):
        where()


def test_a_user_without_a_home_has_none_made(places, monkeypatch):
    """Where nobody knows whose home ``~`` is, it is no folder's name."""
    block(places["package"])
    monkeypatch.setattr(os.path, "expanduser", lambda path: path)
    monkeypatch.chdir(places["home"])
    where()
    assert list(places["home"].iterdir()) == []


COMPUTE = """
import numpy as np
import cdpr_sim as cdpr
import cdpr_sim.drawing.video.raycast
from cdpr_sim.core.compiling import Kernel

def doubled(value, result):
    result[0] = 2.0 * value

robot = cdpr.load_robot("cogiro")
print(Kernel("double", doubled, "()->()")(np.ones(1000)).sum(), cdpr.solve(robot, robot.home).stable, cdpr.__file__)
"""
"""Code that compiles in a second, and an import that would compile at once."""


def test_a_system_install_computes_for_a_user_without_a_home(tmp_path):
    """From a package and with a home that cannot be written to, not even by root: it compiles, and says where to."""
    package = tmp_path / "site" / "cdpr_sim"
    shutil.copytree(Path(cdpr.__file__).parent, package, ignore=shutil.ignore_patterns("__pycache__"))
    (package / "__pycache__").write_text("")
    (tmp_path / "tmp").mkdir()
    (tmp_path / "compute.py").write_text(COMPUTE)
    environment = {
        name: value for name, value in os.environ.items() if name not in ("NUMBA_CACHE_DIR", "XDG_CACHE_HOME")
    }
    environment |= {"PYTHONPATH": str(package.parent), "TMPDIR": str(tmp_path / "tmp"), "HOME": "/dev/null"}
    result = subprocess.run(
        [sys.executable, "compute.py"], cwd=tmp_path, env=environment, capture_output=True, text=True, timeout=600
    )
    assert result.returncode == 0, result.stderr
    assert result.stdout.split() == ["2000.0", "True", str(package / "__init__.py")]
    where, what = result.stderr.splitlines()
    assert "set NUMBA_CACHE_DIR" in where
    assert "compiles its double" in what
    assert list((tmp_path / "tmp").rglob("*.nbi"))


def test_code_of_other_versions_is_cleared_away(places):
    """A folder for each version of the sources would grow for ever; so would private ones of killed processes."""
    old = places["package"] / "__pycache__" / "compiled" / "0123456789abcdef"
    old.mkdir(parents=True)
    (old / "newton_kernel.nbi").touch()
    here = where()
    assert here.is_dir()
    assert not old.exists()
    (here / "solver-0").mkdir()
    for private, age in ((".now", 0.0), (".killed", code_cache.ABANDONED + 60)):
        (here / private).mkdir()
        os.utime(here / private, (time.time() - age,) * 2)
    assert where() == here
    assert {path.name for path in here.iterdir()} == {"solver-0", ".now"}


def test_numbas_own_setting_holds_outside(empty_cache, tmp_path, monkeypatch):
    """Users compile functions of their own: those go where Numba is told, also after ours has failed."""
    monkeypatch.setitem(vars(config), "CACHE_DIR", "theirs")
    optimised = config.OPT

    def compile():
        with compiling._optimised(1):
            assert Path(vars(config)["CACHE_DIR"]).is_relative_to(tmp_path)
            assert config.OPT == 1 != optimised
            1 / 0  # noqa: B018

    with pytest.raises(ZeroDivisionError):
        code_cache.fetch("test", compile, compile)
    assert vars(config)["CACHE_DIR"] == "theirs"
    assert vars(config)["OPT"] is optimised


def test_loading_forbids_compiling_to_this_thread_alone(empty_cache, tmp_path):
    """Another thread may compile functions of the user's meanwhile; here it would write to what is published."""
    (tmp_path / "test-0").mkdir()

    def load():
        assert ThreadPoolExecutor(1).submit(lambda: numba.njit(lambda x: x + 1)(1)).result() == 2
        return numba.njit(lambda x: x + 1)(1)

    assert code_cache.fetch("test", load, lambda: "compiled") == "compiled"

"""Compiled code gives the answers of interpreted code, is built once, and its cache never stands in the way."""

import ast
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

import cdpr_sim as cdpr
from cdpr_sim.core import compiling
from cdpr_sim.statics import cable_kernel
from cdpr_sim.statics.newton import stiffness_of

PACKAGE = Path(cdpr.__file__).parent

FOREVER = 120.0
"""Seconds: the scripts below take three, on a machine that does other things as well thirty."""


def start(folder: Path, text: str, name: str = "script.py", words: Sequence[str] = (), **place) -> subprocess.Popen:
    """A script that is run by itself, with the machine code of this folder alone."""
    (folder / name).write_text(text)
    if not (folder / "doubles.py").exists():  # Numba compiles anew what has another time
        (folder / "doubles.py").write_text(DOUBLED)
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


KINDS = {
    "plain": {},
    "pulleys": {"pulley_radius": 0.1},
    "nonlinear": {"stiffening": (20.0, 500.0)},
    "mass": {"linear_density": 0.05},
    "pulleys, nonlinear, mass": {"pulley_radius": 0.1, "stiffening": (20.0, 500.0), "linear_density": 0.05},
    "frame": {"exit_compliance": (1e-5, 0, 3e-5), "linear_density": [0.02, 0.0] * 4, "pulley_radius": [0.1, 0] * 4},
    "memory": {
        "hysteresis": [(0.2, 2e-4, 0.05)],
        "creep": [(1e5, 60.0)],
        "pulley_friction": 0.03,
        "winch_to_exit": 2.0,
    },
}


@pytest.mark.parametrize("kind", KINDS)
def test_interpreted_and_compiled_answers_are_the_same_to_the_last_bit(catalogue, monkeypatch, kind):
    """Equilibria, stiffness and frequencies, and the balance of forces."""
    robot = catalogue["parallel"].replace(**KINDS[kind])
    poses = np.random.default_rng(0).uniform(0.3, 0.5, (8, 3))
    many = np.tile(poses, (compiling.FEW // len(poses) + 1, 1))

    def answers(poses: np.ndarray) -> list[np.ndarray]:
        found = cdpr.solve_many(robot, poses)
        each = [found.positions, found.rotations, found.tensions, found.lengths, found.residuals, found.iterations]
        if kind != "memory":
            each += [*stiffness_of(found), cdpr.shortfall(robot, poses, tension_limits=(1.0, 500.0))]
        return [*each, found.eigenvalues]

    compiled = answers(many)
    monkeypatch.setattr(compiling, "INTERPRETED", True)
    for one, other in zip(compiled, answers(poses), strict=True):
        np.testing.assert_array_equal(one.reshape(-1, *other.shape), np.broadcast_to(other, (13, *other.shape)))


def test_few_answers_need_no_numba_and_many_are_the_same(catalogue, tmp_path):
    """Also over pulleys, and in a process of its own."""
    names, poses = ["parallel", "planar-vertical", "irma4u"], np.random.default_rng(0).uniform(0.3, 0.5, (20, 3))
    poses[:, 1] = 0
    np.save(tmp_path / "poses.npy", poses)
    finished(start(tmp_path, INTERPRETED, words=names))
    for name in names:
        many = cdpr.solve_many(catalogue[name], np.tile(poses, (compiling.FEW // 20 + 1, 1))).positions
        np.testing.assert_array_equal(many, np.tile(np.load(tmp_path / f"{name}.npy"), (len(many) // 20, 1)))


INTERPRETED = """
import sys, numpy as np, cdpr_sim as cdpr
for name in sys.argv[1:]:
    np.save(f"{name}.npy", cdpr.solve_many(cdpr.load_robot(name), np.load("poses.npy")).positions)
assert "numba" not in sys.modules
"""


# --- once ---------------------------------------------------------------------------------------------------------

DOUBLED = """
import sys
import numpy as np
from cdpr_sim.core import compiling

def doubled(value, scratch, result):
    for i in range(value.shape[0]):
        for j in range(value.shape[1]):
            result[i, j] = 2.0 * value[i, j]

def tripled(value, scratch, result):
    for i in range(value.shape[0]):
        for j in range(value.shape[1]):
            result[i, j] = 3.0 * value[i, j]

kernel, many = compiling.Kernel("double", doubled, "()->()"), np.arange(1000.0)
other = compiling.Kernel("triple", tripled, "()->()")
"""
"""A module that the scripts below import."""

BOTH = "from doubles import *\nprint(kernel(many).sum(), other(many).sum())\n"
ANSWERS = ["999000.0", "1498500.0"]


def contents(folder: Path) -> dict[str, bytes]:
    """Of all files in it."""
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def test_processes_that_come_at_once_all_compile_and_the_next_loads(tmp_path):
    """Nobody waits, it is said, and what they leave is loaded by the next one in silence, and not changed by it."""
    said = ""
    for process in [start(tmp_path, BOTH) for _ in range(3)]:
        printed, words = finished(process)
        assert printed == ANSWERS
        said += words
    for what in ("double", "triple"):
        assert f"cdpr_sim compiles its {what}: up to a minute, once on this machine" in said
    before = contents(tmp_path / "cache")
    assert len(before) == 4  # of each kernel an index and code
    printed, said = finished(start(tmp_path, BOTH))
    assert printed == ANSWERS
    assert "compiles its" not in said  # a busy machine may say that it still loads
    assert contents(tmp_path / "cache") == before


@pytest.fixture
def empty_cache(monkeypatch, tmp_path) -> Path:
    """A folder without machine code."""
    monkeypatch.setattr(compiling, "place", lambda: tmp_path)
    return tmp_path


def doubled(value, scratch, result):
    for i in range(value.shape[0]):
        for j in range(value.shape[1]):
            result[i, j] = 2.0 * value[i, j]


def several_doubled() -> np.ndarray:
    """By a new kernel, of more values than are interpreted."""
    return compiling.Kernel("test", doubled, "()->()")(np.ones(compiling.FEW + 1))


@pytest.mark.parametrize("wrong", ["empty", "truncated", "of another Numba", "of other sources", "lost", "no code"])
def test_a_cache_that_cannot_be_used_is_built_anew(empty_cache, caplog, wrong):
    """It is cleared if Numba cannot read it, and that is said; the next one loads what is kept then."""
    several_doubled()
    for index in empty_cache.rglob("*.nbc" if wrong == "no code" else "*.nbi"):
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
    damaged = contents(empty_cache)
    assert (several_doubled() == 2.0).all()
    anew = contents(empty_cache)
    assert anew != damaged
    cleared = [message for message in caplog.messages if "cannot be used, and is removed" in message]
    assert len(cleared) == (wrong in ("empty", "truncated", "no code"))
    said = len(caplog.messages)
    assert (several_doubled() == 2.0).all()
    assert contents(empty_cache) == anew
    assert len(caplog.messages) == said


def test_kept_code_that_is_compiled_all_the_same_is_no_silent_wait(empty_cache, caplog, monkeypatch):
    """As if Numba did not take it for its own: a word after a while, none if it is loaded before that."""
    several_doubled()
    caplog.clear()
    several_doubled()
    assert caplog.messages == []
    monkeypatch.setattr(compiling, "LOADING", 0.01)
    numbas = numba.njit

    def slow(**options):
        def decorate(function):
            code = numbas(**options)(function)
            load = code.compile
            code.compile = lambda signature: (time.sleep(1.0), load(signature))
            return code

        return decorate

    monkeypatch.setattr(numba, "njit", slow)
    several_doubled()
    assert caplog.messages == ["cdpr_sim still loads its test, or compiles it anew: up to a minute"]


def test_an_error_of_the_code_itself_is_raised(empty_cache):
    """No cache is at fault, and none is cleared."""

    def wrong(value, scratch, result):
        result[0, 0] = value.no_such_attribute

    with pytest.raises(numba.errors.TypingError):
        compiling.Kernel("wrong", wrong, "()->()")(np.ones(compiling.FEW + 1))


FULL = """
import resource, signal
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
resource.setrlimit(resource.RLIMIT_FSIZE, (4096, 4096))
"""


@pytest.mark.skipif(sys.platform == "win32", reason="limits are POSIX")
def test_a_full_disk_costs_one_compilation_in_each_process_and_one_sentence(tmp_path):
    """What was compiled is used all the same."""
    for _ in range(2):
        printed, said = finished(start(tmp_path, FULL + BOTH))
        assert printed == ANSWERS
        compiles, kept, *_ = said.splitlines()
        assert compiles == "cdpr_sim compiles its double: up to a minute, once on this machine"
        assert re.fullmatch(r"cdpr_sim: the compiled code cannot be kept in .*double: File too large", kept)
        assert len(said.splitlines()) == 4


def test_numbas_own_switch_interprets_all(tmp_path):
    """NUMBA_DISABLE_JIT, of which a debugger is in need."""
    assert finished(start(tmp_path, BOTH, NUMBA_DISABLE_JIT="1")) == (ANSWERS, "")
    assert contents(tmp_path / "cache") == {}


@pytest.mark.parametrize("setting", ["NUMBA_OPT=9", "NUMBA_LOOP_VECTORIZE=x", "NUMBA_CACHE_LOCATOR_CLASSES=x"])
def test_senseless_settings_of_numba_are_ignored(tmp_path, setting):
    """Numba itself warns of the first two by the text of a traceback, and raises an error because of the last."""
    name, value = setting.split("=")
    printed, said = finished(start(tmp_path, BOTH, **{name: value}))
    assert printed == ANSWERS
    for line in said.splitlines():
        assert line.startswith("cdpr_sim compiles its"), line


def test_a_setting_with_which_numba_cannot_be_imported_is_named_in_one_sentence(tmp_path):
    """It raises an error because of a negative number of threads."""
    printed, said = finished(start(tmp_path, REFUSED, NUMBA_NUM_THREADS="-1"))
    assert " ".join(printed).startswith("compiled code: Numba cannot be imported: Number of threads specified must be")
    assert "NUMBA_NUM_THREADS=-1" in printed
    assert said == ""


def test_a_setting_with_which_llvm_would_abort_the_process_is_refused(tmp_path):
    """A feature that it does not know but that has a sign, LLVM ignores."""
    printed, said = finished(start(tmp_path, REFUSED, NUMBA_CPU_FEATURES="+avx2,foo"))
    assert " ".join(printed) == (
        "compiled code: found NUMBA_CPU_FEATURES=+avx2,foo, expected '+' or '-' before each feature"
    )
    assert said == ""


REFUSED = """
from doubles import *
from cdpr_sim import CdprError
try:
    kernel(many)
except CdprError as error:
    print(error)
"""


# --- nobody waits for ever ----------------------------------------------------------------------------------------

IN_THREADS = """
from doubles import *
import threading
threads = [threading.Thread(target=lambda: print(f"{kernel(many).sum()}\\n", end="")) for _ in range(8)]
for thread in threads:
    thread.start()
for thread in threads:
    thread.join()
"""


def test_threads_that_come_at_once_compile_once_also_in_a_script_called_coverage(tmp_path):
    """Numba's import runs a module of that name: it waited for its threads, which waited for that import."""
    printed, said = finished(start(tmp_path, IN_THREADS, "coverage.py"))
    assert printed == ["999000.0"] * 8
    assert said.count("compiles its double") == 1


FORK = """
from doubles import *
import os, threading, time
import cdpr_sim
there = threading.Event()

if WHERE == "imports":
    class Finder:
        def find_spec(self, name, path=None, target=None):
            if name == "numba.np.ufunc":
                there.set()
                time.sleep(0.05)
    sys.meta_path.insert(0, Finder())
else:
    build = compiling.Compiled._build
    def builds(*given):
        there.set()
        return build(*given)
    compiling.Compiled._build = builds

thread = threading.Thread(target=lambda: kernel(many))
thread.start()
there.wait()
child = os.fork()
if child == 0:
    try:
        print(kernel(many).sum(), other(many).sum(), flush=True)
    except cdpr_sim.CdprError as error:
        print(error, flush=True)
    os._exit(0)
os.waitpid(child, 0)
thread.join()
"""


@pytest.mark.skipif(not hasattr(os, "fork"), reason="there is nothing to inherit")
@pytest.mark.parametrize(
    ("where", "said"),
    [
        ("imports", "compiled code: this process was forked while another thread of its parent"),
        ("compiles", "999000.0 1498500.0"),
    ],
)
def test_a_child_that_is_forked_amid_an_import_refuses_and_amid_a_compilation_computes(tmp_path, where, said):
    """Locks of Python and of Numba were inherited from a thread that does not exist in the child."""
    printed, _ = finished(start(tmp_path, f"WHERE = {where!r}" + FORK))
    assert " ".join(printed).startswith(said)


CTRL_C = """
from doubles import *
import random, signal

def interrupt(*_):
    raise KeyboardInterrupt

compiling.import_numba()
random.seed(int(sys.argv[1]))
signal.signal(signal.SIGALRM, interrupt)
interrupted = 0
for attempt in range(100):
    if interrupted == 3:
        break
    other._compiled = None
    signal.setitimer(signal.ITIMER_REAL, random.uniform(0.001, 0.4))
    try:
        other.compiled
    except KeyboardInterrupt:
        interrupted += 1
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
print(interrupted > 0, kernel(many).sum(), other(many).sum())
"""


@pytest.mark.skipif(not hasattr(os, "fork"), reason="alarms are POSIX")
def test_ctrl_c_amid_a_compilation_spoils_nothing(tmp_path):
    """The same process compiles it later, and another one loads what it keeps."""
    printed, _ = finished(start(tmp_path, CTRL_C, words=["0"]))
    assert printed == ["True", *ANSWERS]
    printed, said = finished(start(tmp_path, BOTH))
    assert printed == ANSWERS
    assert "compiles its" not in said


INTERRUPTS = """
from doubles import *
import random, signal
from concurrent.futures import ThreadPoolExecutor

compiling.import_numba()
compiling.Compiled._build = lambda *_: len  # nothing is compiled: all time is spent around the lock
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
kept, pool = [], ThreadPoolExecutor(1)
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


# --- several cables at once ---------------------------------------------------------------------------------------


def geometry(d, table, p, R, s, w, m):
    cable_kernel.measure(d, table, cable_kernel.PLAIN, p, R, s)
    cable_kernel.fill_jacobian(s, 1.0, m, w)


def pulleys_and_laws(d, table, p, R, s, w, m):
    cable_kernel.measure(d, table, cable_kernel.BENT, p, R, s)


def with_a_branch(d, table, p, R, s, w, m):
    for i in range(m):
        if s[i] > 0.0:  # divides, which may not be done in advance
            w[i] = d[i] / s[i] + p[0]
            if w[i] > 1.0:
                break


ARITHMETIC = {
    "packed": r"v?(?:add|sub|mul|div|sqrt)pd\b|f(?:add|sub|mul|div|sqrt)\s+v\d+\.2d",
    "single": r"v?(?:add|sub|mul|div|sqrt)sd\b|f(?:add|sub|mul|div|sqrt)\s+d\d+",
}
"""Instructions of x86 and of ARM, of several doubles and of one."""


@pytest.mark.parametrize(("loops", "several"), [(geometry, True), (pulleys_and_laws, True), (with_a_branch, False)])
def test_loops_over_cables_compute_several_at_once(monkeypatch, loops, several):
    """An `if`, or rows whose distance the compiler does not know, would unravel them without a word."""
    monkeypatch.setattr(compiling, "place", lambda: None)
    rows, matrix = "float64[::1]", "float64[:, ::1]"
    signature = f"void({rows}, Array(float64, 2, 'A', readonly=True), {rows}, {matrix}, {rows}, {rows}, int64)"
    code = compiling.Compiled("loops", loops, signature, error_model="numpy").compiled
    (text,) = code.inspect_asm().values()
    packed, single = (len(re.findall(ARITHMETIC[kind], text)) for kind in ("packed", "single"))
    assert packed + single > 0
    assert (packed > single / 2) == several, (packed, single)


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
    assert {path.relative_to(PACKAGE).as_posix() for path in reached} == set(compiling.SOURCES)
    package = tmp_path / "cdpr_sim"
    shutil.copytree(PACKAGE, package, ignore=shutil.ignore_patterns("__pycache__"))
    before = cache_of(package).digest()
    for name in compiling.SOURCES:
        file, text = package / name, (package / name).read_text(encoding="utf-8")
        file.write_text(text + "\nONE_MORE = 1\n", encoding="utf-8")
        assert cache_of(package).digest() != before, name
        file.write_text(text, encoding="utf-8")
    assert cache_of(package).digest() == before == compiling.digest()


def cache_of(package: Path) -> ModuleType:
    """``core.compiling`` of a copy of the package."""
    spec = importlib.util.spec_from_file_location("cache_of_a_copy", package / "core" / "compiling.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


# --- where it is kept ---------------------------------------------------------------------------------------------


def test_a_system_install_computes_for_a_user_without_a_home(tmp_path):
    """From a package and with a home that cannot be written to, not even by root: it compiles, and says what is so."""
    package = tmp_path / "site" / "cdpr_sim"
    shutil.copytree(PACKAGE, package, ignore=shutil.ignore_patterns("__pycache__"))
    (package / "__pycache__").write_text("")
    place = dict(PYTHONPATH=str(package.parent), HOME="/dev/null", NUMBA_CACHE_DIR="", XDG_CACHE_HOME="")
    printed, said = finished(start(tmp_path, BOTH + "print(compiling.__file__)", **place))
    assert printed == [*ANSWERS, str(package / "core" / "compiling.py")]
    for words, line in zip(("kept nowhere", "its double", "its triple"), said.splitlines(), strict=True):
        assert words in line


def test_code_of_other_sources_is_cleared_away_and_that_of_another_processor_is_not(monkeypatch, tmp_path):
    """A folder for each version of the sources would grow for ever; a home may be shared by several machines."""
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    compiling._place.cache_clear()
    here = compiling.place()
    for folder in (here.parents[1] / "0123456789abcdef", here.with_name("another")):
        folder.mkdir()
    compiling._place.cache_clear()
    assert compiling.place() == here
    assert [path.name for path in here.parents[1].iterdir()] == [compiling.digest()]
    assert {path.name for path in here.parent.iterdir()} == {compiling.compiler(), "another"}
    monkeypatch.setenv("NUMBA_OPT", "1")
    assert compiling.compiler.__wrapped__() != compiling.compiler()

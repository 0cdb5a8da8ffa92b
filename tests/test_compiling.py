"""Machine code is built once, whoever comes first, and is never that of other sources."""

import ast
import importlib.util
import multiprocessing
import os
import re
import shutil
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from numba.core import config
from numba.core.dispatcher import Dispatcher

import cdpr_sim as cdpr
from cdpr_sim.core import compiling
from cdpr_sim.statics import newton_kernel

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
    """No machine code, and nothing that was compiled in this process is known."""
    monkeypatch.setattr(compiling, "_folder", lambda: tmp_path)
    monkeypatch.setattr(compiling, "_ready", set())


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
    several, counted = one(np.tile(values, (6, 1)), 1.0)  # more than are left
    assert one._compiled is not None
    np.testing.assert_array_equal(several, [10.0] * 6)
    assert counted.dtype == entries.dtype == np.int64
    assert one(values, 2.0) == (20.0, 5)


def test_that_it_compiles_is_said_once(empty_cache, caplog):
    """One line as soon as something is compiled; none where it is loaded, and none while few elements are asked for."""
    kernel()(np.zeros((compiling.FEW, 2)), 1.0)
    assert not caplog.messages
    kernel()(np.zeros((compiling.FEW + 1, 2)), 1.0)
    assert caplog.messages == ["cdpr_sim compiles its test sum: some seconds, once on this machine"]
    compiling._ready.clear()
    kernel()(np.zeros((compiling.FEW + 1, 2)), 1.0)
    assert len(caplog.messages) == 1


def test_first_answers_need_no_numba():
    """Settled, solved by each method and compared: a few poses are there before Numba would be imported."""
    code = (
        "import sys, cdpr_sim as cdpr; problem = cdpr.Problem.of(cdpr.load_robot('parallel'), (0.3, 0.25, 0.1)); "
        "found = [cdpr.solve(problem, method=method) for method in ('newton', 'fsolve', 'least_squares')]; "
        "assert cdpr.compare(found[0], cdpr.settle(problem)).agrees; "
        "assert 'numba' not in sys.modules; "
        "cdpr.solve_many(problem.robot, [(0.3, 0.25, 0.1)] * 11); assert 'numba' in sys.modules"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


@pytest.mark.parametrize("name", ["parallel", "planar-vertical", "irma4u"])
def test_interpreted_and_compiled_answers_are_the_same(catalogue, name, monkeypatch):
    """To the last bit; over pulleys to rounding, since NumPy has an arctan2 of its own."""
    robot = catalogue[name]
    solver = newton_kernel.equilibrium_gufunc(bent=robot.cabling.bent)
    at = np.random.default_rng(0).uniform(robot.exits.min(0), robot.exits.max(0), (30, 3)) - [0, 0, 0.1]
    compiled = cdpr.solve_many(robot, at)
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
    build = one._built

    def slowly():
        time.sleep(0.05)
        built.append(build())
        return built[0]

    monkeypatch.setattr(one, "_built", slowly)
    threads = [threading.Thread(target=lambda: got.append(one.compiled)) for _ in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(built) == 1
    assert got == built * 8


def stay_inside(log: str) -> None:
    with compiling.first_use("test"):
        with open(log, "a") as file:
            file.write("in\n")
        time.sleep(0.2)
        with open(log, "a") as file:
            file.write("out\n")


def test_processes_compile_one_after_the_other(tmp_path: Path):
    """Nobody enters while another is inside."""
    log = tmp_path / "log"
    context = multiprocessing.get_context("spawn")
    processes = [context.Process(target=stay_inside, args=(str(log),)) for _ in range(2)]
    for process in processes:
        process.start()
    for process in processes:
        process.join()
    assert log.read_text().split() == ["in", "out"] * 2


def test_nested_first_uses_do_not_wait_for_themselves():
    """One thing may need another while it is being compiled."""
    with compiling.first_use("test outer"), compiling.first_use("test inner"):
        assert {"test outer", "test inner"}.isdisjoint(compiling._ready)
    assert {"test outer", "test inner"} <= compiling._ready


VARIANTS = """
import sys
from cdpr_sim.core.compiling import Kernel

def times(factor):
    def scaled(value, result):
        result[0] = factor * value
    return scaled

kernels = {"double": Kernel("twofold", times(2.0), "()->()"), "triple": Kernel("threefold", times(3.0), "()->()")}
print(*(kernels[name].compiled(1.0) for name in sys.argv[1:]))
"""


def test_what_two_processes_compiled_of_one_function_is_told_apart(tmp_path):
    """Numba names code by its function and how many came before it: one of the two was taken for the other."""
    (tmp_path / "variants.py").write_text(VARIANTS)
    environment = os.environ | {"PYTHONPATH": str(PACKAGE.parent), "NUMBA_CACHE_DIR": str(tmp_path / "cache")}

    def said_by_a_process(*names: str) -> list[str]:
        words = [sys.executable, "variants.py", *names]
        return subprocess.check_output(words, cwd=tmp_path, env=environment, text=True).split()

    assert said_by_a_process("double") == ["2.0"]
    assert said_by_a_process("triple") == ["3.0"]
    assert said_by_a_process("double", "triple") == ["2.0", "3.0"]


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
    others = {PACKAGE / "statics" / "catenary.py", PACKAGE / "drawing" / "video" / "raycast.py"}
    others |= {PACKAGE / "proof" / "search_kernel.py"}
    kernels = {*(PACKAGE / "statics").glob("*_kernel.py"), *others}
    assert compiled - {PACKAGE / "core" / "compiling.py"} <= kernels
    reached, waiting = set(), list(kernels)
    while waiting:
        path = waiting.pop()
        reached.add(path)
        waiting += imported(path) - reached
    assert {path.relative_to(PACKAGE).as_posix() for path in reached} == set(compiling.SOURCES)


def compiling_of(package: Path) -> ModuleType:
    """``core.compiling`` of a copy of the package."""
    spec = importlib.util.spec_from_file_location("compiling_of_a_copy", package / "core" / "compiling.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_another_constant_in_any_source_is_another_digest(tmp_path):
    """Numba looks at one file's date; we look at all texts: one constant more or less is other machine code."""
    package = tmp_path / "cdpr_sim"
    shutil.copytree(PACKAGE, package, ignore=shutil.ignore_patterns("__pycache__"))
    before = compiling_of(package).digest()
    assert before == compiling.digest()
    for name in compiling.SOURCES:
        file, text = package / name, (package / name).read_text(encoding="utf-8")
        file.write_text(text + "\nONE_MORE = 1\n", encoding="utf-8")
        assert compiling_of(package).digest() != before, name
        file.write_text(text, encoding="utf-8")
    status = package / "core" / "status.py"
    changed = status.read_text(encoding="utf-8").replace("NEUTRAL = 1e-9", "NEUTRAL = 2e-9")
    status.write_text(changed, encoding="utf-8")
    assert compiling_of(package).digest() != before
    status.write_text(changed.replace("NEUTRAL = 2e-9", "NEUTRAL = 1e-9"), encoding="utf-8")
    assert compiling_of(package).digest() == before


def test_machine_code_lies_in_the_folder_of_its_digest(catalogue):
    """Of the solver, of the stiffness and of the ray caster; and none where Numba would have put it by itself."""
    from cdpr_sim.drawing.video import raycast

    assert cdpr.solve_many(catalogue["cogiro"], [(0.4, 0.25, 0.2)] * (compiling.FEW + 1)).stable.all()
    folder = compiling._folder()
    assert folder.name == compiling.digest()
    kept = {path.name.split(".")[0] for path in folder.rglob("*.nbi")}
    assert {"guf-newton_kernel", "guf-stiffness_kernel"} <= kept
    functions = [one for one in vars(raycast).values() if isinstance(one, Dispatcher)]
    assert len(functions) > 5
    for function in functions:
        assert Path(function._cache.cache_path).is_relative_to(folder), function  # type: ignore[attr-defined]


# --- where it is kept ---------------------------------------------------------------------------------------------


@pytest.fixture
def places(monkeypatch, tmp_path) -> dict[str, Path]:
    """A package folder, a home and a folder for temporary files of its own; what Numba is told is not set."""
    found = {name: tmp_path / name for name in ("given", "package", "home", "temporary")}
    for place in found.values():
        place.mkdir()
    compiling.digest()  # of the true package, and kept
    monkeypatch.setattr(compiling, "_PACKAGE", found["package"])
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
    return compiling._folder.__wrapped__()


def test_machine_code_is_kept_with_the_package_or_where_numba_is_told_to(places, monkeypatch):
    """Beside the sources; unless NUMBA_CACHE_DIR says otherwise."""
    assert where() == places["package"] / "__pycache__" / "compiled" / compiling.digest()
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(places["given"]))
    assert where().is_relative_to(places["given"])
    assert where().name == compiling.digest()


def test_read_only_package_keeps_its_code_at_home_or_with_temporary_files(places, monkeypatch):
    """Installed by another user: in the cache folder of one's own; without a home, among the temporary files."""
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
    assert first == where()  # found again by the next process
    shutil.rmtree(first.parent)
    first.parent.write_text("somebody else's")
    elsewhere = where()
    assert elsewhere.parent.parent == places["temporary"]
    assert list(elsewhere.iterdir()) == []


def test_code_of_other_versions_is_cleared_away(places):
    """A folder for each version of the sources would grow for ever."""
    old = places["package"] / "__pycache__" / "compiled" / "0123456789abcdef"
    old.mkdir(parents=True)
    (old / "newton_kernel.nbi").touch()
    assert where().is_dir()
    assert not old.exists()


def test_numbas_own_setting_holds_outside(monkeypatch):
    """Users compile functions of their own: those go where Numba is told, also after ours has failed."""
    monkeypatch.setitem(vars(config), "CACHE_DIR", "theirs")
    optimised = config.OPT
    with compiling.first_use("test setting"), compiling._optimised(1):
        assert vars(config)["CACHE_DIR"] == str(compiling._folder())
        assert config.OPT == 1 != optimised
    assert vars(config)["CACHE_DIR"] == "theirs"
    assert vars(config)["OPT"] is optimised
    with pytest.raises(ZeroDivisionError), compiling.first_use("test setting that fails"):
        1 / 0  # noqa: B018
    assert vars(config)["CACHE_DIR"] == "theirs"
    assert "test setting that fails" not in compiling._ready

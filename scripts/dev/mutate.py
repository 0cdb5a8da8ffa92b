"""Mutation testing: insert faults drawn at random, one at a time, and count how many the tests detect.

    python scripts/dev/mutate.py [FOLDER ...] [--tests FILE ...] [--count COUNT] [--seed SEED] [--jobs JOBS]
        [--markdown]
    python scripts/dev/mutate.py [FOLDER ...] --without FILE [FILE ...] [--count COUNT] [--seed SEED] [--markdown]

Faults are of five kinds: an operator or a number is changed, two arguments are exchanged or one is left out, two
returned fields are exchanged, or a default is changed. They are drawn by lines: a line of the folders of cdpr_sim (by
default all folders), then a fault of that line. Any test may detect them, or any test of the given files.

With ``--without``, the question is whether some files of tests are needed: for each of them, the first COUNT faults of
the draw in functions that the file's tests execute, how many the tests of all files detect, and how many those of the
other files alone.

First the tests run once, and the functions that each test executes are recorded; the record of a file of tests is
used again as long as neither it nor a file that its tests execute changes. Then the tests are collected once, and for
each fault the process is forked, the changed function gets its new code, and the tests that execute it run, the fastest
first, until one fails. Where Numba compiles the function, the forks interpret all kernels, and a failure counts only if
the same test passes without the fault in a fork that also interprets them. Code that runs during imports is tested in a
process that imports everything again.

The script is not part of the tests: a fault takes seconds, the record as long as the test suite takes, twice.
"""

import argparse
import ast
import copy
import datetime
import functools
import gc
import hashlib
import importlib
import itertools
import json
import multiprocessing
import os
import queue
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time
import traceback
from collections import Counter, defaultdict
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor, as_completed
from contextlib import suppress
from pathlib import Path
from types import CodeType, FunctionType
from typing import Any, NamedTuple

from rich.console import Console
from rich.table import Table

ROOT = Path(__file__).parents[2]
RECORD = "CDPR_SIM_EXECUTED"
"""Names the file that pytest writes the executed functions of each test to, if this module is its plugin."""

DETECTED, ONLY_LEFT_OUT, SURVIVED = "detected", "detected by the files left out alone", "survived"
"""Outcomes."""

PRELOADED = ["numba", "mujoco", "scipy.optimize", "scipy.spatial.transform", "matplotlib.figure", "xarray"]
PRELOADED += ["dask.array", "pydantic", "typer", "PIL.ImageDraw", "__main__"]
"""Modules that take long to import, except plugins of pytest."""

READ_SIGNATURES = "tests/test_public_api.py::"
"""Tests that execute no function, and detect faults in what is defined during imports."""

PATIENCE = 5
"""A test that takes this many times longer than without the fault, and more than half a minute, has detected it."""

LONGEST = 900
"""Seconds for the tests of one fault, by the times that were recorded; the fastest tests run first."""

INTERPRETED = 150
"""Seconds for the tests of one fault in a kernel. Tests that evaluate thousands of poses do not end in this time."""

OTHER = {
    ast.Add: ast.Sub, ast.Sub: ast.Add, ast.Mult: ast.Div, ast.Div: ast.Mult, ast.Pow: ast.Mult, ast.Lt: ast.GtE,
    ast.LtE: ast.Gt, ast.Gt: ast.LtE, ast.GtE: ast.Lt, ast.Eq: ast.NotEq, ast.NotEq: ast.Eq, ast.And: ast.Or,
    ast.Or: ast.And, ast.BitAnd: ast.BitOr, ast.BitOr: ast.BitAnd, ast.Is: ast.IsNot, ast.IsNot: ast.Is,
    ast.In: ast.NotIn, ast.NotIn: ast.In, ast.USub: ast.UAdd,
}  # fmt: skip
"""Replacements of operators."""


class Fault(NamedTuple):
    """A change of the code of a file of cdpr_sim at one place."""

    kind: str
    file: str
    place: int
    right: str
    wrong: str

    def texts(self, tree: Path) -> tuple[Path, str, str]:
        """The text of the file without and with the fault."""
        path = tree / "cdpr_sim" / self.file
        text = path.read_text(encoding="utf-8")
        return path, text, text[: self.place] + self.wrong + text[self.place + len(self.right) :]

    @property
    def line(self) -> int:
        """Number of the line."""
        return _text(ROOT / "cdpr_sim" / self.file)[: self.place].count("\n") + 1

    def __str__(self) -> str:
        right, wrong = (" ".join(code.split()) for code in (self.right, self.wrong))
        return f"{self.kind}: {self.file}, line {self.line}: `{right}` put as `{wrong}`"


_text = functools.cache(functools.partial(Path.read_text, encoding="utf-8"))

Changes = list[tuple[str, CodeType, CodeType]]
"""File, right and wrong code of functions."""


# The faults of a file


def _operators(node: ast.AST) -> Iterator[ast.AST]:
    if isinstance(node, ast.BinOp | ast.BoolOp | ast.UnaryOp) and type(node.op) in OTHER:
        other = copy.deepcopy(node)
        other.op = OTHER[type(node.op)]()
        yield other
    elif isinstance(node, ast.Compare) and type(node.ops[0]) in OTHER:
        compared = copy.deepcopy(node)
        compared.ops[0] = OTHER[type(node.ops[0])]()
        yield compared


def _changed_constant(value: object) -> Any:
    if isinstance(value, bool):
        return not value
    if isinstance(value, int):
        return value + 1
    return 2 * value + 1e-3 if isinstance(value, float) else None


def _constants(node: ast.AST) -> Iterator[ast.AST]:
    if isinstance(node, ast.Constant) and (value := _changed_constant(node.value)) is not None:
        yield ast.Constant(value)


def _exchanged(node: ast.AST, elements: Callable[[Any], list[ast.expr]]) -> Iterator[ast.AST]:
    """Each pair of neighbours among the elements of a node exchanged, where they differ."""
    for k in range(len(elements(node)) - 1):
        other = copy.deepcopy(node)
        some = elements(other)
        a, b = some[k], some[k + 1]
        if not any(isinstance(one, ast.Starred) for one in (a, b)) and ast.dump(a) != ast.dump(b):
            some[k : k + 2] = [b, a]
            yield other


def _arguments(node: ast.AST) -> Iterator[ast.AST]:
    if not isinstance(node, ast.Call):
        return
    yield from _exchanged(node, lambda call: call.args)
    for k, keyword in enumerate(node.keywords):
        if keyword.arg is not None:
            other = copy.deepcopy(node)
            del other.keywords[k]
            yield other


def _fields(node: ast.AST) -> Iterator[ast.AST]:
    """Neighbours exchanged in a returned tuple, or the values of two keywords of a returned call."""
    if not isinstance(node, ast.Return):
        return
    if isinstance(node.value, ast.Tuple):
        yield from _exchanged(node, lambda one: one.value.elts)
    if isinstance(node.value, ast.Call):
        yield from _exchanged(node, lambda one: one.value.args)
        for k in range(len(node.value.keywords) - 1):
            other = copy.deepcopy(node)
            assert isinstance(other.value, ast.Call)
            a, b = other.value.keywords[k : k + 2]
            if a.arg and b.arg and ast.dump(a.value) != ast.dump(b.value):
                a.value, b.value = b.value, a.value
                yield other


def drawn(file: str) -> list[Fault]:
    """All faults of a file that a draw can choose, except in types."""
    text = (ROOT / "cdpr_sim" / file).read_bytes()
    starts = [0, *itertools.accumulate(len(line) for line in text.splitlines(keepends=True))]
    nodes = list(ast.walk(ast.parse(text)))
    no_code: set[int] = set()
    defaults: set[int] = set()
    for node in nodes:
        types = [getattr(node, name, None) for name in ("annotation", "returns")]
        types += [node] if isinstance(node, ast.JoinedStr) else []  # Python 3.11 misplaces what is in it
        no_code.update(id(one) for some in types if some is not None for one in ast.walk(some))
        if isinstance(node, ast.arguments):
            defaults.update(id(one) for one in [*node.defaults, *node.kw_defaults])
        if isinstance(node, ast.ClassDef):
            defaults.update(id(one.value) for one in node.body if isinstance(one, ast.AnnAssign))
    found = []
    for node in nodes:
        if id(node) in no_code or not isinstance(node, ast.expr | ast.Return):
            continue
        begin, end = (
            starts[line - 1] + column
            for line, column in ((node.lineno, node.col_offset), (node.end_lineno or 0, node.end_col_offset or 0))
        )
        right, place = text[begin:end].decode(), len(text[:begin].decode())
        number = "default" if id(node) in defaults else "number"
        for kind, changes in (
            ("operator", _operators), (number, _constants), ("argument", _arguments), ("field", _fields),
        ):  # fmt: skip
            for other in changes(node):
                code = ast.unparse(other)
                found.append(Fault(kind, file, place, right, code if kind == "field" else f"({code})"))
    return found


def sample(folders: list[str], seed: int) -> Iterator[Fault]:
    """Faults in the order of the draw: one of each line that has any, the lines in random order."""
    files = [path.relative_to(ROOT / "cdpr_sim") for path in sorted((ROOT / "cdpr_sim").rglob("*.py"))]
    by_line: defaultdict[tuple[str, int], list[Fault]] = defaultdict(list)
    for file in files:
        if not folders or file.parts[0] in folders:
            for fault in drawn(file.as_posix()):
                by_line[fault.file, fault.line].append(fault)
    draw = random.Random(seed)
    for line in draw.sample(sorted(by_line), len(by_line)):
        yield draw.choice(by_line[line])


def covered_by(tests: list[str], faults: Iterator[Fault], record: "Record", count: int) -> dict[str, list[Fault]]:
    """The first ``count`` faults in functions that each file's tests execute."""
    found: dict[str, list[Fault]] = {file: [] for file in tests}
    for fault in faults:
        missing = [file for file in tests if len(found[file]) < count]
        if not missing:
            break
        changed = _changed(*fault.texts(ROOT))
        if changed:
            by = {one.partition("::")[0] for one in record.of(names_of(fault, changed))}
            for file in by.intersection(missing):
                found[file].append(fault)
    return found


def tests_of(fault: Fault, changed: "Changes", record: "Record") -> list[str]:
    """The tests that execute the changed functions, the fastest first.

    The record lacks functions that only compiled code called: then also the tests that execute another function of the
    file, and those that execute any kernel.
    """
    some = record.of(names_of(fault, changed))
    if fault.file in _compiled():
        some += record.of({fault.file})
        some += record.of({f"core/compiling.py:{name}" for name in ("Kernel.__call__", "Compiled.compiled")})
    return list(dict.fromkeys(some))


def names_of(fault: Fault, changed: "Changes") -> set[str]:
    """Names of the changed functions in the record."""
    return {f"{fault.file}:{old.co_qualname}" for _, old, _ in changed}


# In pytest's process: which functions each test executes


def pytest_configure(config: Any) -> None:
    """Record the functions that each test executes; its setup may be shared with other tests of its file."""
    import pytest

    place = os.environ.get(RECORD)
    if place is None:
        return
    clock = time.monotonic  # tests replace it
    seen: dict[int, CodeType] = {}  # by id, since hashing code takes long
    folder = f"{config.rootpath}/cdpr_sim/"

    def note(frame: Any, event: str, _: Any) -> None:
        if event == "call":
            seen[id(frame.f_code)] = frame.f_code

    def names() -> list[str]:
        own = [code for code in [*seen.values()] if code.co_filename.startswith(folder)]
        return sorted({f"{code.co_filename.removeprefix(folder)}:{code.co_qualname}" for code in own})

    threading.setprofile(note)  # applies to all threads that start from now on

    def watch(item: Any, who: str) -> Iterator[Any]:
        seen.clear()
        begin, passed = clock(), True
        sys.setprofile(note)
        try:
            return (yield)
        except BaseException as error:
            passed = isinstance(error, pytest.skip.Exception) or item.get_closest_marker("xfail") is not None
            raise
        finally:
            sys.setprofile(None)
            with open(f"{place}-{os.getpid()}", "a", encoding="utf-8") as file:
                file.write(json.dumps([who, clock() - begin, names(), passed]) + "\n")

    class Watch:
        @pytest.hookimpl(wrapper=True)
        def pytest_runtest_setup(self, item: Any) -> Iterator[Any]:
            return (yield from watch(item, item.nodeid.partition("::")[0]))

        @pytest.hookimpl(wrapper=True)
        def pytest_runtest_call(self, item: Any) -> Iterator[Any]:
            return (yield from watch(item, item.nodeid))

    config.pluginmanager.register(Watch())


class Record(NamedTuple):
    """``seconds`` of each test and of each file's setup; ``tests`` of each function, and of each file of cdpr_sim."""

    seconds: dict[str, float]
    tests: dict[str, set[str]]

    def of(self, names: set[str]) -> list[str]:
        """The tests that execute a function or file, the fastest first."""
        by = set().union(*(self.tests.get(name, set()) for name in names))
        return sorted(
            (one for one in self.seconds if "::" in one and {one, one.partition("::")[0]} & by),
            key=self.seconds.__getitem__,
        )

    def within(self, tests: list[str], seconds: float) -> list[str]:
        """As many of the tests as run in this time, each with the setup of its file."""
        some, files, total = [], set(), 0.0
        for one in tests:
            file = one.partition("::")[0]
            total += self.seconds.get(one, 0.0) + self.seconds.get(file, 0.0) * (file not in files)
            files.add(file)
            if total > seconds and some:
                break
            some.append(one)
        return some


def recorded(tree: Path, tests: list[str], jobs: int) -> Record:
    """Run the tests once, file by file only where it or what it executes has changed since they last passed."""
    files = tests or sorted(f"tests/{path.name}" for path in (tree / "tests").glob("test_*.py"))
    for _ in range(2):  # a test that fails now and then runs again
        stale = [file for file in files if not _is_fresh(tree, file)]
        if stale:
            _record(tree, stale, jobs)
    if stale := [file for file in files if not _is_fresh(tree, file)]:
        raise RuntimeError(f"tests fail without a fault: {', '.join(stale)}")
    seconds: defaultdict[str, float] = defaultdict(float)
    executed_by: defaultdict[str, set[str]] = defaultdict(set)
    for file in files:
        for who, took, functions in json.loads(_kept(tree, file).read_text(encoding="utf-8"))["tests"]:
            seconds[who] += took
            for one in functions:
                executed_by[one].add(who)
                executed_by[one.partition(":")[0]].add(who)
    return Record(dict(seconds), dict(executed_by))


def _kept(tree: Path, file: str) -> Path:
    """The record of a file of tests."""
    return tree.with_name(f"{tree.name}-executed") / f"{Path(file).stem}.json"


def _record(tree: Path, files: list[str], jobs: int) -> None:
    """Run files of tests, and keep what they executed of those that pass."""
    part = tree / "executed"
    for old in tree.glob("executed-*"):
        old.unlink()
    command = [sys.executable, "-m", "pytest", "-q", "-n", str(jobs), "-p", "no:cacheprovider", "-p", "mutate"]
    paths = os.pathsep.join([str(tree), str(tree / "scripts" / "dev")])
    environment = {**os.environ, RECORD: str(part), "PYTHONPATH": paths}
    done = subprocess.run([*command, *files], cwd=tree, env=environment, check=False)
    if done.returncode not in (0, 1):
        raise RuntimeError("pytest did not run all tests")
    found: defaultdict[str, list] = defaultdict(list)
    failed: set[str] = set()
    for one in sorted(tree.glob("executed-*")):
        for line in one.read_text(encoding="utf-8").splitlines():
            who, took, functions, passed = json.loads(line)
            file = who.partition("::")[0]
            found[file].append((who, took, functions))
            failed.update([] if passed else [file])
    for file in set(files) - failed:
        executed = {one.partition(":")[0] for _, _, functions in found[file] for one in functions}
        needed = [*_modules(tree, file), *(f"cdpr_sim/{one}" for one in executed)]
        state = {one: _digest(tree / one) for one in needed}
        _kept(tree, file).parent.mkdir(exist_ok=True)
        _kept(tree, file).write_text(json.dumps({"digests": state, "tests": found[file]}), encoding="utf-8")


def _is_fresh(tree: Path, file: str) -> bool:
    """Whether nothing that the record of a file of tests depends on has changed."""
    if not _kept(tree, file).exists():
        return False
    state = json.loads(_kept(tree, file).read_text(encoding="utf-8"))["digests"]
    return state.keys() >= set(_modules(tree, file)) and all(_digest(tree / one) == state[one] for one in state)


def _digest(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()[:12] if path.exists() else ""


def _modules(tree: Path, file: str) -> list[str]:
    """A file of tests, and the modules of the tests that it needs."""
    found, new = [], [file, "tests/conftest.py"]
    while new:
        found.append(one := new.pop())
        for node in ast.walk(ast.parse((tree / one).read_text(encoding="utf-8"))):
            names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            names += [node.module or ""] if isinstance(node, ast.ImportFrom) else []
            paths = [f"tests/{name}.py" for name in names]
            new += [path for path in paths if (tree / path).exists() and path not in [*found, *new]]
    return sorted(found)


# In a process that has collected the tests: one fork for each fault


class Loop:
    """A plugin of pytest: run the tests of one fault after another, each in a fork."""

    def __init__(
        self, tree: Path, faults: list[Fault], record: Record, left_out: list[str], longest: float, answers: Any
    ) -> None:
        self.tree, self.faults, self.record, self.answers = tree, faults, record, answers
        self.left_out, self.longest = left_out, longest

    def pytest_runtestloop(self, session: Any) -> bool:
        """Send the outcome of each fault to the parent process; None if this process cannot decide it."""
        items = {item.nodeid: item for item in session.items}
        for fault in self.faults:
            changed = _changed(*fault.texts(self.tree))
            if changed is None:
                self.answers.put(None)
                continue
            some = [one for one in tests_of(fault, changed, self.record) if one in items]
            some = self.record.within(some, self.longest)
            few = [one for one in some if one.partition("::")[0] in self.left_out]
            outcome = SURVIVED
            for tests, detected in ([one for one in some if one not in few], DETECTED), (few, ONLY_LEFT_OUT):
                if tests and not self._pass(session, [items[one] for one in tests], fault, changed):
                    outcome = detected
                    break
            self.answers.put(outcome)
        return True

    def _pass(self, session: Any, tests: list, fault: Fault, changed: Changes) -> bool:
        if fault.file not in _compiled():
            files = {item.nodeid.partition("::")[0] for item in tests}
            names = files.union(item.nodeid for item in tests)
            seconds = 30 + int(PATIENCE * sum(self.record.seconds.get(one, 0.0) for one in names))
            return _forked(session, tests, functools.partial(_patch, changed), seconds)
        begin = time.monotonic()
        for test in tests:
            left = int(INTERPRETED - (time.monotonic() - begin))
            if left < 1:
                break
            seconds = min(left, 15)
            wrong = _forked(session, [test], functools.partial(_patch_interpreted, changed), seconds)
            if not wrong and _forked(session, [test], functools.partial(_patch_interpreted, []), 2 * seconds):
                return False
        return True


def _forked(session: Any, items: list, prepare: Callable[[], None], seconds: int) -> bool:
    """Whether the tests pass in a fork of this process."""
    pid = os.fork()
    if pid:
        status = os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1])
        if status == 2:
            raise RuntimeError("a fork failed, and no test")
        return status == 0
    from _pytest.main import pytest_runtestloop

    status = 2
    try:
        os.setpgid(0, 0)  # its processes end with it
        signal.signal(signal.SIGALRM, lambda *_: os.killpg(0, signal.SIGKILL))
        signal.alarm(seconds)
        session.items = items
        prepare()
        with suppress(session.Failed, session.Interrupted):  # detected by the first test that fails
            pytest_runtestloop(session)
        status = int(session.testsfailed > 0)
    except BaseException:
        traceback.print_exc()
    finally:
        os._exit(status)


def _functions(code: CodeType) -> Iterator[CodeType]:
    """The code objects of a module's functions, methods and nested functions, in order."""
    for one in code.co_consts:
        if isinstance(one, CodeType):
            yield from [one] if one.co_flags & 1 else []  # CO_OPTIMIZED is set for functions, not for classes
            yield from _functions(one)


def _rest(code: CodeType) -> tuple:
    """The module's code that runs when it is imported."""
    there = [one for one in code.co_consts if not (isinstance(one, CodeType) and one.co_flags & 1)]
    return code.co_code, [_rest(one) if isinstance(one, CodeType) else one for one in there]


def _compiled() -> set[str]:
    from cdpr_sim.core import compiling

    return set(compiling.SOURCES)


def _changed(path: Path, right: str, wrong: str) -> Changes | None:
    """Functions that differ in the second text; None if code outside of functions differs."""
    before, after = (compile(text, path, "exec") for text in (right, wrong))
    functions = [list(_functions(code)) for code in (before, after)]
    names = [[one.co_qualname for one in some] for some in functions]
    if _rest(before) != _rest(after) or names[0] != names[1]:
        return None
    return [
        (str(path), a, b) for a, b in zip(*functions, strict=True) if a != b.replace(co_firstlineno=a.co_firstlineno)
    ]


def _patch_interpreted(changed: Changes) -> None:
    """The same, and Python interprets what Numba would compile."""
    from cdpr_sim.core import compiling

    compiling.INTERPRETED = True
    if changed:
        _patch(changed)


def _patch(changed: Changes) -> None:
    """Replace the code of functions in all places that refer to them; import modules that are not imported yet."""
    for path, *_ in changed:
        importlib.import_module(".".join(Path(path).relative_to(Path.cwd()).with_suffix("").parts))
    living = [one for one in gc.get_objects() if isinstance(one, FunctionType)]
    patched = 0
    for path, old, new in changed:
        for one in living:
            code = one.__code__
            same = code.co_filename == path and code.co_qualname == old.co_qualname
            if same and ("<lambda>" not in old.co_qualname or code.co_firstlineno == old.co_firstlineno):
                one.__code__ = new
                patched += 1
    if not patched:
        raise RuntimeError(f"nothing runs the code of {changed[0][0]} that was changed")


def run_loop(tree: Path, tests: list[str], loop: tuple) -> None:
    """Collect the tests and run the loop with these arguments, which puts its results into their queue."""
    import pytest

    os.chdir(tree)
    sys.path[:0] = [str(tree)]
    os.environ["PYTHONPATH"] = str(tree)
    with open(tree / f"output-{os.getpid()}", "w") as file:
        os.dup2(file.fileno(), 1)
        os.dup2(file.fileno(), 2)
    os._exit(int(pytest.main(["-q", "-x", "-p", "no:cacheprovider", *tests], plugins=[Loop(tree, *loop)])))


# In the process that counts the faults


def outcomes(
    tree: Path, faults: list[Fault], record: Record, left_out: list[str], longest: float, jobs: int
) -> Iterator[tuple[Fault, str]]:
    """Each fault and its outcome; of code that runs during imports last."""
    context = multiprocessing.get_context("forkserver")
    files = sorted({one.partition("::")[0] for one in record.seconds})
    running, again = [], []
    for part in (faults[k::jobs] for k in range(jobs)):
        answers = context.SimpleQueue()
        process = context.Process(target=run_loop, args=(tree, files, (part, record, left_out, longest, answers)))
        process.start()
        running.append((process, answers, iter(part)))
    while running:
        time.sleep(0.05)
        for one in [*running]:
            process, answers, part = one
            ended = not process.is_alive()
            while not answers.empty():
                fault, outcome = next(part), answers.get()
                if outcome is None:
                    again.append(fault)
                else:
                    yield fault, outcome
            if ended:
                running.remove(one)
                if next(part, None) is not None:
                    output = (tree / f"output-{process.pid}").read_text()
                    raise RuntimeError(f"pytest ended too early:\n{output[-2000:]}")
    trees: queue.SimpleQueue[Path] = queue.SimpleQueue()
    for k in range(min(jobs, len(again))):
        trees.put(tree.with_name(f"{tree.name}-{k}"))
    with ThreadPoolExecutor(jobs) as pool:
        running = {pool.submit(survives, tree, trees, fault, record, longest): fault for fault in again}
        for one in as_completed(running):
            yield running[one], SURVIVED if one.result() else DETECTED


def survives(tree: Path, trees: queue.SimpleQueue[Path], fault: Fault, record: Record, longest: float) -> bool:
    """Return whether the tests pass in a process that imports the fault, in a copy of the tree."""
    tests = record.of({fault.file}) or sorted({one.partition("::")[0] for one in record.seconds})
    tests = record.within(tests, longest)
    tests += [one for one in record.seconds if one.startswith(READ_SIGNATURES) and one not in tests]
    own = trees.get()
    try:
        shutil.copytree(tree, own, dirs_exist_ok=True)
        path, right, wrong = fault.texts(own)
        compile(wrong, path, "exec")  # any test would detect a syntax error
        path.write_text(wrong, encoding="utf-8")
        (own / "tests-of-a-fault").write_text("\n".join(tests))
        command = [sys.executable, "-m", "pytest", "-q", "-x", "-p", "no:cacheprovider", "@tests-of-a-fault"]
        environment = {**os.environ, "PYTHONPATH": str(own), "PYTHONDONTWRITEBYTECODE": "1"}
        quiet: dict[str, Any] = dict(stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        process = subprocess.Popen(command, cwd=own, env=environment, start_new_session=True, **quiet)
        try:
            return process.wait(PATIENCE * longest) == 0
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGKILL)
            print(
                f"not decided within {PATIENCE * longest:.0f} s, counted as survived: {fault}",
                file=sys.stderr,
                flush=True,
            )
            return True
        finally:
            path.write_text(right, encoding="utf-8")
    finally:
        trees.put(own)


def copied_tree() -> Path:
    """Copy the repository, always to the same place, so that compiled code can be used again."""
    name = hashlib.sha256(str(ROOT).encode()).hexdigest()[:8]
    tree = Path(tempfile.gettempdir()).resolve() / f"cdpr_sim-mutate-{name}"
    listed = subprocess.run(["git", "ls-files"], cwd=ROOT, capture_output=True, text=True, check=True).stdout
    shutil.rmtree(tree / "tests", ignore_errors=True)
    for file in listed.splitlines():
        if (ROOT / file).exists():
            (tree / file).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(ROOT / file, tree / file)
    return tree


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    folders = sorted(path.name for path in (ROOT / "cdpr_sim").iterdir() if (path / "__init__.py").exists())
    parser.add_argument("folders", nargs="*", choices=[*folders, []], metavar="FOLDER", help=", ".join(folders))
    parser.add_argument("--tests", nargs="+", default=[], metavar="FILE", help="files of tests, by default all")
    parser.add_argument("--without", nargs="+", default=[], metavar="FILE", help="files of tests: are they needed?")
    parser.add_argument("--count", type=int, help="number of faults: 100 by default, of each file without 40")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument(
        "--longest", type=float, default=LONGEST, help="seconds for the tests of one fault, as recorded"
    )
    parser.add_argument("--jobs", type=int, default=os.cpu_count(), help="processes that run tests")
    parser.add_argument("--markdown", action="store_true", help="print the table for docs/mutations.md")
    options = parser.parse_args()
    tree = copied_tree()
    record = recorded(tree, options.tests, options.jobs)
    multiprocessing.get_context("forkserver").set_forkserver_preload(PRELOADED)
    draw = sample(options.folders, options.seed)
    covered: dict[str, list[Fault]] = {}
    if options.without:
        covered = covered_by(options.without, draw, record, options.count or 40)
        faults = list(dict.fromkeys(itertools.chain.from_iterable(covered.values())))
    else:
        faults = list(itertools.islice(draw, options.count or 100))
    found, begin = {}, time.monotonic()
    for fault, outcome in outcomes(tree, faults, record, options.without, options.longest, options.jobs):
        found[fault] = outcome
        if outcome != DETECTED:
            print(f"{outcome}: {fault}", flush=True)
        if len(found) % 10 == 0:
            print(f"{len(found)} of {len(faults)}, {time.monotonic() - begin:.0f} s", file=sys.stderr, flush=True)
    rows = table_of_files(covered, found) if options.without else table_of_kinds(found)
    commit = subprocess.run(["git", "rev-parse", "--short", "HEAD"], cwd=ROOT, capture_output=True, text=True).stdout
    if options.markdown:
        print(f"{datetime.date.today()}, commit {commit.strip()}, --seed {options.seed}:\n")
        for row in (rows[0], ("---", *["---:"] * (len(rows[0]) - 1)), *rows[1:]):
            print(f"| {' | '.join(row)} |")
        print("\n| not detected | judged |\n|---|---|")
        for fault, outcome in found.items():
            if outcome != DETECTED:
                words = str(fault).replace("|", "\\|")
                print(f"| {words} | {'' if outcome == SURVIVED else outcome} |")
    else:
        table = Table(*rows[0])
        for row in rows[1:]:
            table.add_row(*row)
        Console().print(table)
    return 0


def table_of_kinds(found: dict[Fault, str]) -> list[tuple[str, ...]]:
    """Rows: how many faults of each kind were detected."""
    rows = [("kind", "faults", "detected", "survived", "% detected")]
    for kind in [*sorted({fault.kind for fault in found}), "all"]:
        some = [outcome for fault, outcome in found.items() if kind in (fault.kind, "all")]
        detected = some.count(DETECTED)
        rate = 100 * detected / max(len(some), 1)
        rows.append((kind, str(len(some)), str(detected), str(len(some) - detected), f"{rate:.0f}"))
    return rows


def table_of_files(covered: dict[str, list[Fault]], found: dict[Fault, str]) -> list[tuple[str, ...]]:
    """Rows: how many faults are detected with and without the files."""
    rows = [("file", "lines", "faults", "detected with", "detected without")]
    for file, faults in covered.items():
        lines = len((ROOT / file).read_text(encoding="utf-8").splitlines())
        counts = Counter(found[fault] for fault in faults)
        alone = counts[DETECTED]
        rows.append((file, str(lines), str(len(faults)), str(alone + counts[ONLY_LEFT_OUT]), str(alone)))
    return rows


if __name__ == "__main__":
    sys.exit(main())

"""Mutation testing: insert faults drawn at random, one at a time, and count how many the tests detect.

    python scripts/mutate.py [FOLDER ...] [--tests FILE ...] [--count COUNT] [--seed SEED] [--jobs JOBS] [--markdown]

Faults are of five kinds, as many of each: an operator or a number is changed, two arguments are exchanged or one is
left out, two returned fields are exchanged, or a default is changed. They are drawn from all files of the folders of
cdpr_sim (by default all folders), and any test may detect them, or any test of the given files.

First these tests run once, and the functions that each test executes are recorded; the record is used again
as long as no file changes. Then the tests are collected once, and for each fault the process is forked, the changed
function gets its new code, and the tests that execute it run, the fastest first, until one fails. Code that runs during
imports and code that Numba compiles is tested in a process that imports everything again.

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
from contextlib import suppress
from pathlib import Path
from types import CodeType, FunctionType
from typing import Any, NamedTuple

from rich.console import Console
from rich.table import Table

ROOT = Path(__file__).parents[1]
RECORD = "CDPR_SIM_EXECUTED"
"""Names the file that pytest writes the executed functions of each test to, if this module is its plugin."""

PRELOADED = ["numba", "mujoco", "scipy.optimize", "scipy.spatial.transform", "matplotlib.figure", "xarray"]
PRELOADED += ["dask.array", "pydantic", "typer", "PIL.ImageDraw", "__main__"]
"""Modules that take long to import, except plugins of pytest."""

READ_SIGNATURES = "tests/test_public_api.py::"
"""Tests that execute no function, and detect faults in what is defined during imports."""

PATIENCE = 5
"""A test that takes this many times longer than without the fault, and more than half a minute, has detected it."""

LONGEST = 900
"""Seconds for the tests of one fault in a new process; the fastest tests run first."""

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

    def __str__(self) -> str:
        line = self.texts(ROOT)[1][: self.place].count("\n") + 1
        right, wrong = (" ".join(code.split()) for code in (self.right, self.wrong))
        return f"{self.kind}: {self.file}, line {line}: `{right}` put as `{wrong}`"


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


def sample(folders: list[str], count: int, seed: int) -> list[Fault]:
    """Faults drawn from the files of the folders, as many of each kind."""
    files = [path.relative_to(ROOT / "cdpr_sim") for path in sorted((ROOT / "cdpr_sim").rglob("*.py"))]
    by_kind: defaultdict[str, list[Fault]] = defaultdict(list)
    for file in files:
        if not folders or file.parts[0] in folders:
            for fault in drawn(file.as_posix()):
                by_kind[fault.kind].append(fault)
    draw = random.Random(seed)
    piles = [draw.sample(some, len(some)) for _, some in sorted(by_kind.items())]
    return [pile[k] for k in range(max(map(len, piles), default=0)) for pile in piles if k < len(pile)][:count]


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

    def watch(who: str) -> Iterator[Any]:
        seen.clear()
        begin = clock()
        sys.setprofile(note)
        try:
            return (yield)
        finally:
            sys.setprofile(None)
            with open(f"{place}-{os.getpid()}", "a", encoding="utf-8") as file:
                file.write(json.dumps([who, clock() - begin, names()]) + "\n")

    class Watch:
        @pytest.hookimpl(wrapper=True)
        def pytest_runtest_setup(self, item: Any) -> Iterator[Any]:
            return (yield from watch(item.nodeid.partition("::")[0]))

        @pytest.hookimpl(wrapper=True)
        def pytest_runtest_call(self, item: Any) -> Iterator[Any]:
            return (yield from watch(item.nodeid))

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


def recorded(tree: Path, digest: str, tests: list[str], jobs: int) -> Record:
    """Run the tests once, or read the record of the last run of the same tests and sources."""
    some = hashlib.sha256(" ".join([digest, *sorted(tests)]).encode()).hexdigest()[:12]
    place = tree.with_name(f"{tree.name}-executed-{some}")
    if not place.exists():
        part = tree / "executed"
        for old in tree.glob("executed-*"):
            old.unlink()
        command = [sys.executable, "-m", "pytest", "-q", "-n", str(jobs), "-p", "no:cacheprovider", "-p", "mutate"]
        paths = os.pathsep.join([str(tree), str(tree / "scripts")])
        done = subprocess.run(
            [*command, *tests], cwd=tree, env={**os.environ, RECORD: str(part), "PYTHONPATH": paths}, check=False
        )
        if done.returncode:
            raise RuntimeError("tests fail without a fault")
        place.write_text("".join(one.read_text(encoding="utf-8") for one in sorted(tree.glob("executed-*"))))
    seconds: defaultdict[str, float] = defaultdict(float)
    executed_by: defaultdict[str, set[str]] = defaultdict(set)
    for line in place.read_text(encoding="utf-8").splitlines():
        who, took, functions = json.loads(line)
        seconds[who] += took
        for one in functions:
            executed_by[one].add(who)
            executed_by[one.partition(":")[0]].add(who)
    return Record(dict(seconds), dict(executed_by))


# In a process that has collected the tests: one fork for each fault


class Loop:
    """A plugin of pytest: run the tests of one fault after another, each in a fork."""

    def __init__(self, tree: Path, faults: list[Fault], record: Record, answers: Any) -> None:
        self.tree, self.faults, self.record, self.answers = tree, faults, record, answers

    def pytest_runtestloop(self, session: Any) -> bool:
        """Send to the parent process whether each fault survives; None if this process cannot decide it."""
        items = {item.nodeid: item for item in session.items}
        for fault in self.faults:
            changed = _changed(*fault.texts(self.tree))
            if changed is None:
                self.answers.put(None)
                continue
            some = self.record.of({f"{fault.file}:{old.co_qualname}" for _, old, _ in changed})
            files = {one.partition("::")[0] for one in some}
            seconds = 30 + int(PATIENCE * sum(self.record.seconds.get(one, 0.0) for one in files.union(some)))
            chosen = [items[one] for one in some if one in items]
            self.answers.put(not chosen or _forked(session, chosen, functools.partial(_patch, changed), seconds))
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
    from cdpr_sim.core import code_cache

    return set(code_cache.SOURCES)


def _changed(path: Path, right: str, wrong: str) -> list[tuple[str, CodeType, CodeType]] | None:
    """Functions that differ in the second text; None if code outside of functions or compiled code differs."""
    before, after = (compile(text, path, "exec") for text in (right, wrong))
    functions = [list(_functions(code)) for code in (before, after)]
    names = [[one.co_qualname for one in some] for some in functions]
    if _rest(before) != _rest(after) or names[0] != names[1] or path.as_posix().split("/cdpr_sim/")[-1] in _compiled():
        return None
    return [
        (str(path), a, b) for a, b in zip(*functions, strict=True) if a != b.replace(co_firstlineno=a.co_firstlineno)
    ]


def _patch(changed: list[tuple[str, CodeType, CodeType]]) -> None:
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


def run_tests(tree: Path, tests: list[str], loop: tuple | None) -> None:
    """Run pytest and exit with its status; with a loop's arguments, put its results into the queue."""
    import pytest

    os.chdir(tree)
    sys.path[:0] = [str(tree)]
    os.environ["PYTHONPATH"] = str(tree)
    with open(tree / f"output-{os.getpid()}", "w") as file:
        os.dup2(file.fileno(), 1)
        os.dup2(file.fileno(), 2)
    plugins = [] if loop is None else [Loop(tree, *loop)]
    os._exit(int(pytest.main(["-q", "-x", "-p", "no:cacheprovider", *tests], plugins=plugins)))


# In the process that counts the faults


def outcomes(tree: Path, faults: list[Fault], record: Record) -> Iterator[tuple[Fault, bool]]:
    """Return whether each fault survives."""
    context = multiprocessing.get_context("forkserver")
    answers = context.SimpleQueue()
    files = sorted({one.partition("::")[0] for one in record.seconds})
    process = context.Process(target=run_tests, args=(tree, files, (faults, record, answers)))
    process.start()
    again = []
    for fault in faults:
        while answers.empty():
            if not process.is_alive() and answers.empty():
                raise RuntimeError(f"pytest ended too early:\n{(tree / f'output-{process.pid}').read_text()[-2000:]}")
            time.sleep(0.05)
        alive = answers.get()
        if alive is None:
            again.append(fault)
        else:
            yield fault, alive
    process.join()
    for fault in again:
        yield fault, survives(tree, fault, record)


def survives(tree: Path, fault: Fault, record: Record) -> bool:
    """Return whether the tests pass in a process that imports the fault; the file is restored afterwards."""
    tests = record.of({fault.file}) or sorted({one.partition("::")[0] for one in record.seconds})
    tests += [one for one in record.seconds if one.startswith(READ_SIGNATURES) and one not in tests]
    path, right, wrong = fault.texts(tree)
    times = path.stat()
    compile(wrong, path, "exec")  # any test would detect a syntax error
    listed = tree / "tests-of-a-fault"
    listed.write_text("\n".join(tests))
    path.write_text(wrong, encoding="utf-8")
    process = multiprocessing.get_context("forkserver").Process(target=run_tests, args=(tree, [f"@{listed}"], None))
    try:
        process.start()
        process.join(LONGEST)
        if process.exitcode is None:
            process.kill()
            process.join()
            print(f"not decided within {LONGEST} s, counted as survived: {fault}", file=sys.stderr, flush=True)
            return True
        return process.exitcode == 0
    finally:
        path.write_text(right, encoding="utf-8")
        os.utime(path, ns=(times.st_atime_ns, times.st_mtime_ns))  # its cached bytecode is valid again


def copied_tree() -> tuple[Path, str]:
    """Copy the repository, always to the same place, so that compiled code can be used again; and a digest of it."""
    name = hashlib.sha256(str(ROOT).encode()).hexdigest()[:8]
    tree = Path(tempfile.gettempdir()).resolve() / f"cdpr_sim-mutate-{name}"
    listed = subprocess.run(["git", "ls-files"], cwd=ROOT, capture_output=True, text=True, check=True).stdout
    digest = hashlib.sha256()
    shutil.rmtree(tree / "tests", ignore_errors=True)
    for file in listed.splitlines():
        if (ROOT / file).exists():
            (tree / file).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(ROOT / file, tree / file)
            if file.endswith(".py"):
                digest.update((ROOT / file).read_bytes())
    return tree, digest.hexdigest()[:12]


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    folders = sorted(path.name for path in (ROOT / "cdpr_sim").iterdir() if (path / "__init__.py").exists())
    parser.add_argument("folders", nargs="*", choices=[*folders, []], metavar="FOLDER", help=", ".join(folders))
    parser.add_argument("--tests", nargs="+", default=[], metavar="FILE", help="files of tests, by default all")
    parser.add_argument("--count", type=int, default=100, help="number of faults, 100 by default")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--jobs", type=int, default=os.cpu_count(), help="processes that record the tests")
    parser.add_argument("--markdown", action="store_true", help="print the table for docs/mutations.md")
    options = parser.parse_args()
    faults = sample(options.folders, options.count, options.seed)
    tree, digest = copied_tree()
    record = recorded(tree, digest, options.tests, options.jobs)
    multiprocessing.get_context("forkserver").set_forkserver_preload(PRELOADED)
    counts: defaultdict[str, Counter] = defaultdict(Counter)
    survivors, begin = [], time.monotonic()
    for number, (fault, alive) in enumerate(outcomes(tree, faults, record), 1):
        for key in (fault.kind, "all"):
            counts[key]["survived" if alive else "detected"] += 1
        if alive:
            survivors.append(fault)
            print(f"survived: {fault}", flush=True)
        if number % 10 == 0:
            print(f"{number} of {len(faults)}, {time.monotonic() - begin:.0f} s", file=sys.stderr, flush=True)
    rows: list[tuple[str, ...]] = [("kind", "faults", "detected", "survived", "% detected")]
    for name in [*sorted(counts.keys() - {"all"}), "all"]:
        count = counts[name]
        rate = 100 * count["detected"] / max(count.total(), 1)
        rows.append((name, str(count.total()), str(count["detected"]), str(count["survived"]), f"{rate:.0f}"))
    if options.markdown:
        commit = subprocess.run(
            ["git", "rev-parse", "--short", "HEAD"], cwd=ROOT, capture_output=True, text=True
        ).stdout
        print(f"{datetime.date.today()}, commit {commit.strip()}, --seed {options.seed}:\n")
        for row in (rows[0], ("---", *["---:"] * 4), *rows[1:]):
            print(f"| {' | '.join(row)} |")
        print("\n| survived | judged |\n|---|---|")
        for fault in survivors:
            words = str(fault).replace("|", "\\|")
            print(f"| {words} | |")
    else:
        table = Table(*rows[0])
        for row in rows[1:]:
            table.add_row(*row)
        Console().print(table)
    return 0


if __name__ == "__main__":
    sys.exit(main())

"""Mutation testing: insert faults one at a time, and print a table of how many the tests detect.

    python scripts/mutate.py [FOLDER ...] [--markdown] [--sample COUNT [--seed SEED]]

mutations.toml lists the faults and the tests that should detect them. With ``--sample``, that number of faults is drawn
at random from the same files, and any test may detect them. A fault takes seconds; the script is not part of the tests.
Exit status 1 if a fault survives without an explanation.

The tests of a folder are collected once. For each fault the process is forked, the changed functions get their new
code, and the tests that execute them run, the fastest first, until one fails. Code that runs during imports and code
that Numba compiles is tested in a process that imports everything again.
"""

import argparse
import ast
import datetime
import functools
import gc
import hashlib
import importlib
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
import tomllib
import traceback
from collections import Counter, defaultdict
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from types import CodeType, FunctionType
from typing import Any, NamedTuple

from rich.console import Console
from rich.table import Table

ROOT = Path(__file__).parents[1]
FOLDERS = tomllib.loads(Path(__file__).with_name("mutations.toml").read_text(encoding="utf-8"))
PRELOADED = ["numba", "mujoco", "scipy.optimize", "scipy.spatial.transform", "matplotlib.figure", "xarray"]
PRELOADED += ["dask.array", "pydantic", "typer", "PIL.ImageDraw", "__main__"]
"""Modules that take long to import, except plugins of pytest."""

PATIENCE = 5
"""A test that takes this many times longer than without the fault, and more than half a minute, has detected it."""

OTHER = {
    ast.Add: ast.Sub, ast.Sub: ast.Add, ast.Mult: ast.Div, ast.Div: ast.Mult, ast.Pow: ast.Mult, ast.Lt: ast.GtE,
    ast.LtE: ast.Gt, ast.Gt: ast.LtE, ast.GtE: ast.Lt, ast.Eq: ast.NotEq, ast.NotEq: ast.Eq, ast.And: ast.Or,
    ast.Or: ast.And, ast.BitAnd: ast.BitOr, ast.BitOr: ast.BitAnd,
}  # fmt: skip
"""Replacements of operators for random faults."""


class Fault(NamedTuple):
    """A change of a file, at the only occurrence or at ``place``; ``reason``: why it cannot change any result."""

    file: str
    right: str
    wrong: str
    reason: str = ""
    place: int | None = None

    def texts(self, tree: Path) -> tuple[Path, str, str]:
        """The text of the file without and with the fault."""
        path = tree / "cdpr_sim" / self.file
        text = path.read_text(encoding="utf-8")
        if self.place is None and text.count(self.right) != 1:
            raise RuntimeError(f"{self.file}: found {text.count(self.right)} times, expected once: {self.right}")
        start = text.index(self.right) if self.place is None else self.place
        return path, text, text[:start] + self.wrong + text[start + len(self.right) :]

    def __str__(self) -> str:
        right, wrong = (" ".join(code.split()) for code in (self.right, self.wrong))
        if self.place is None:
            return f"{self.file}: `{right}` put as `{wrong}`"
        line = self.texts(ROOT)[1][: self.place].count("\n") + 1
        return f"{self.file}, line {line}: `{right}` put as `{wrong}`"


# In a separate process, which has imported the slow modules already


class Loop:
    """A plugin of pytest: run the tests without a fault, and then with one fault after another, each in a fork."""

    def __init__(self, tree: Path, faults: list[Fault], answers: Any, interpreted: bool) -> None:
        self.tree, self.faults, self.answers, self.interpreted = tree, faults, answers, interpreted

    def pytest_runtestloop(self, session: Any) -> bool:
        """Send to the parent process whether each fault survives; None if this process cannot decide it."""
        items, place = session.items, self.tree / "passed"
        place.unlink(missing_ok=True)
        alive = self._fork(session, items, lambda: _record(session, f"{self.tree}/cdpr_sim/", place))
        self.answers.put(alive)
        lines = [line.split("\t") for line in place.read_text(encoding="utf-8").splitlines()] if alive else []
        took: defaultdict[str, float] = defaultdict(float)
        for who, seconds, *_ in lines:
            took[who] += float(seconds)
        for fault in self.faults if alive else []:
            changed = _changed(*fault.texts(self.tree), self.interpreted)
            if changed is None:
                self.answers.put(None)
                continue
            names = {f"{path}:{old.co_qualname}" for path, old, _ in changed}
            by = {who for who, _, *passed in lines if names & set(passed)}
            some = [item for item in items if {item.nodeid, item.nodeid.partition("::")[0]} & by]
            some.sort(key=lambda item: took[item.nodeid])
            files = {item.nodeid.partition("::")[0] for item in some}
            seconds = 30 + int(PATIENCE * sum(took[who] for who in files.union(item.nodeid for item in some)))
            self.answers.put(not some or self._fork(session, some, functools.partial(_patch, changed), seconds))
        self.answers.put(self._fork(session, items[:1], lambda: None))
        return True

    def _fork(self, session: Any, items: list, prepare: Any, seconds: int = 0) -> bool:
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


def _record(session: Any, folder: str, place: Path) -> None:
    """Record the functions that each test executes; its setup may be shared with other tests of its file."""
    import pytest

    seen: set[str] = set()

    def note(frame: Any, event: str, _: Any) -> None:
        if event == "call" and frame.f_code.co_filename.startswith(folder):
            seen.add(f"{frame.f_code.co_filename}:{frame.f_code.co_qualname}")

    threading.setprofile(note)  # applies to all threads that start from now on

    def watch(who: str) -> Iterator[Any]:
        seen.clear()
        begin = time.monotonic()
        sys.setprofile(note)
        try:
            return (yield)
        finally:
            sys.setprofile(None)
            with open(place, "a", encoding="utf-8") as file:
                file.write("\t".join([who, f"{time.monotonic() - begin:.3f}", *seen]) + "\n")

    class Watch:
        @pytest.hookimpl(wrapper=True)
        def pytest_runtest_setup(self, item: Any) -> Iterator[Any]:
            return (yield from watch(item.nodeid.partition("::")[0]))

        @pytest.hookimpl(wrapper=True)
        def pytest_runtest_call(self, item: Any) -> Iterator[Any]:
            return (yield from watch(item.nodeid))

    session.config.pluginmanager.register(Watch())


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


def _changed(path: Path, right: str, wrong: str, interpreted: bool) -> list[tuple[str, CodeType, CodeType]] | None:
    """Functions that differ in the second text; None if code outside of functions or compiled code differs."""
    before, after = (compile(text, path, "exec") for text in (right, wrong))
    functions = [list(_functions(code)) for code in (before, after)]
    names = [[one.co_qualname for one in some] for some in functions]
    kernel = path.stem.endswith(("_kernel", "catenary"))
    if _rest(before) != _rest(after) or names[0] != names[1] or (kernel and not interpreted):
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


def run_tests(tree: Path, tests: list[str], interpreted: bool, faults: list[Fault], answers: Any) -> None:
    """Run pytest and exit with its status; with faults, put the results into the queue."""
    import pytest

    os.chdir(tree)
    sys.path[:0] = [str(tree)]
    os.environ["PYTHONPATH"] = str(tree)
    with open(tree / "output", "w") as file:
        os.dup2(file.fileno(), 1)
        os.dup2(file.fileno(), 2)
    if interpreted:
        from cdpr_sim.core import compiling

        compiling.FEW = sys.maxsize  # kernels stay interpreted for any number of poses
    loop = [Loop(tree, faults, answers, interpreted)] if faults else []
    os._exit(int(pytest.main(["-q", "-x", "-p", "no:cacheprovider", *tests], plugins=loop)))


# In the process that counts the faults


def outcomes(tree: Path, groups: list[tuple[dict, list[Fault]]]) -> Iterator[tuple[Fault, bool]]:
    """Return whether each fault survives."""
    context = multiprocessing.get_context("forkserver")
    answers, interpreted = context.SimpleQueue(), groups[0][0].get("interpreted", False)
    tests = list(dict.fromkeys(test for group, _ in groups for test in group["tests"]))
    faults = [(group, fault) for group, some in groups for fault in some]
    asked = [fault for _, fault in faults]
    process = context.Process(target=run_tests, args=(tree, tests, interpreted, asked, answers))
    begin = time.monotonic()
    process.start()
    if not _answer(process, answers, tree):
        raise RuntimeError(f"tests fail without a fault:\n{(tree / 'output').read_text()[-2000:]}")
    seconds = 30 + PATIENCE * (time.monotonic() - begin)
    again = []
    for group, fault in faults:
        alive = _answer(process, answers, tree)
        if alive is None:
            again.append((group, fault))
        else:
            yield fault, alive
    if not _answer(process, answers, tree):
        raise RuntimeError("a test that passed before fails after all of them, without a fault")
    process.join()
    for group, fault in again:
        yield fault, survives(tree, fault, group["tests"], interpreted, seconds)


def _answer(process: Any, answers: Any, tree: Path) -> bool | None:
    while answers.empty():
        if not process.is_alive() and answers.empty():
            raise RuntimeError(f"pytest ended too early:\n{(tree / 'output').read_text()[-2000:]}")
        time.sleep(0.05)
    return answers.get()


def survives(tree: Path, fault: Fault, tests: list[str], interpreted: bool, seconds: float) -> bool:
    """Return whether the tests pass in a process that imports the fault; the file is restored afterwards."""
    path, right, wrong = fault.texts(tree)
    times = path.stat()
    compile(wrong, path, "exec")  # any test would detect a syntax error
    path.write_text(wrong, encoding="utf-8")
    process = multiprocessing.get_context("forkserver").Process(
        target=run_tests, args=(tree, tests, interpreted, [], None)
    )
    try:
        process.start()
        process.join(seconds)
        if process.exitcode is None:
            process.kill()
            process.join()
        return process.exitcode == 0
    finally:
        path.write_text(right, encoding="utf-8")
        os.utime(path, ns=(times.st_atime_ns, times.st_mtime_ns))  # its cached bytecode is valid again


def drawn(file: str) -> list[Fault]:
    """Faults of all operators and numbers of a file, except in types."""
    text, found = (ROOT / "cdpr_sim" / file).read_text(encoding="utf-8"), []
    nodes, lines = list(ast.walk(ast.parse(text))), text.splitlines(keepends=True)
    types = [getattr(node, name, None) for node in nodes for name in ("annotation", "returns")]
    no_code = {id(node) for one in types if one is not None for node in ast.walk(one)}
    for node in nodes:
        if id(node) in no_code:
            continue
        right = ast.get_source_segment(text, node) or ""
        if isinstance(node, ast.BinOp | ast.BoolOp) and type(node.op) in OTHER:
            node.op = OTHER[type(node.op)]()
        elif isinstance(node, ast.Compare) and type(node.ops[0]) in OTHER:
            node.ops[0] = OTHER[type(node.ops[0])]()
        elif isinstance(node, ast.Constant) and type(node.value) in (int, float):
            number: Any = node.value
            node.value = number + 1 if isinstance(number, int) else 2 * number + 1e-3
        else:
            continue
        column = len(lines[node.lineno - 1].encode()[: node.col_offset].decode())
        place = sum(map(len, lines[: node.lineno - 1])) + column
        found.append(Fault(file, right, f"({ast.unparse(node)})", place=place))
    return found


def faults_of(groups: list[dict], count: int, seed: int) -> list[tuple[dict, list[Fault]]]:
    """The faults of a folder, listed or ``count`` random ones, with the group of tests that should detect them."""
    if not count:
        return [(group, [Fault(group["file"], *words) for words in group["faults"]]) for group in groups]
    groups = [group | {"tests": ["tests"]} for group in groups]
    all_of_them = [(group, fault) for group in groups for fault in drawn(group["file"])]
    chosen = random.Random(seed).sample(all_of_them, min(count, len(all_of_them)))
    return [(group, [fault for own, fault in chosen if own is group]) for group in groups]


def count_folder(tree: Path, folder: str, count: int, seed: int, equivalent: list[Fault]) -> Counter:
    """Test the faults of a folder and count the outcomes; print survivors, or add them to the equivalent faults."""
    counts: Counter = Counter()
    everything = faults_of(FOLDERS[folder], count, seed)
    for interpreted in (False, True):
        groups = [pair for pair in everything if pair[1] and pair[0].get("interpreted", False) == interpreted]
        begin = time.monotonic()
        for fault, alive in outcomes(tree, groups) if groups else []:
            counts[("equivalent" if fault.reason else "survived") if alive else "killed"] += 1
            if alive and fault.reason:
                equivalent.append(fault)
            elif fault.reason:
                print(f"detected, although listed as equivalent: {fault}", flush=True)
            elif alive:
                print(f"survived: {fault}", flush=True)
            if counts.total() == 1 or counts.total() % 20 == 0:
                print(f"{folder}: {counts.total()}, {time.monotonic() - begin:.0f} s", file=sys.stderr, flush=True)
    return counts


def copied_tree() -> Path:
    """Copy the repository, always to the same place, so that compiled code can be used again."""
    tree = (
        Path(tempfile.gettempdir()).resolve() / f"cdpr_sim-mutate-{hashlib.sha256(str(ROOT).encode()).hexdigest()[:8]}"
    )
    listed = subprocess.run(["git", "ls-files"], cwd=ROOT, capture_output=True, text=True, check=True).stdout
    for name in listed.splitlines():
        (tree / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy2(ROOT / name, tree / name)
    return tree


def main() -> int:
    asked = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    asked.add_argument("folders", nargs="*", choices=[*FOLDERS, []], metavar="FOLDER", help=", ".join(FOLDERS))
    asked.add_argument("--markdown", action="store_true", help="print the table for docs/mutations.md")
    asked.add_argument("--sample", type=int, default=0, metavar="COUNT", help="number of random faults per folder")
    asked.add_argument("--seed", type=int, default=0)
    options = asked.parse_args()
    multiprocessing.get_context("forkserver").set_forkserver_preload(PRELOADED)
    counts: dict[str, Counter] = {}
    equivalent: list[Fault] = []
    commit = subprocess.run(["git", "rev-parse", "--short", "HEAD"], cwd=ROOT, capture_output=True, text=True)
    tree = copied_tree()
    for name in options.folders or FOLDERS:
        counts[name] = count_folder(tree, name, options.sample, options.seed, equivalent)
    counts["all"] = sum(counts.values(), Counter())
    rows: list[tuple[str, ...]] = [("folder", "faults", "killed", "equivalent", "survived", "% killed")]
    for name, count in counts.items():
        numbers = count.total(), count["killed"], count["equivalent"], count["survived"]
        rate = 100 * count["killed"] / max(count["killed"] + count["survived"], 1)
        rows.append((name, *map(str, numbers), f"{rate:.0f}"))
    if options.markdown:
        print(f"{datetime.date.today()}, commit {commit.stdout.strip()}:\n")
        for row in (rows[0], ("---", *["---:"] * 5), *rows[1:]):
            print(f"| {' | '.join(row)} |")
        for fault in equivalent:
            print(f"- {fault}: {fault.reason}.")
    else:
        table = Table(*rows[0])
        for row in rows[1:]:
            table.add_row(*row)
        Console().print(table)
    return int(counts["all"]["survived"] > 0)


if __name__ == "__main__":
    sys.exit(main())

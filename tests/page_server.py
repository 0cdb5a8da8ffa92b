"""Runs pages of the manual as their readers do: ``python page_server.py``, which reads one request in JSON from a line.

A page has a process for its Python, in which nothing of cdpr_sim was imported before, and each command has another one.
They are forks of this process, which has imported other libraries: that takes longest.
"""

import contextlib
import json
import os
import runpy
import shutil
import sys
import traceback
from collections.abc import Callable


def python(requests: int, replies: int) -> None:
    """Executes blocks of Python, one after another; replies what each line printed, and the error."""
    names: dict = {"__name__": "__main__"}
    with open(requests) as blocks, open(replies, "w") as out:
        for request in blocks:
            page, line, text = json.loads(request)
            told: dict[int, str] = {}

            def said_beside(*values: object, told: dict[int, str] = told) -> None:
                at = sys._getframe(1).f_lineno
                told[at] = " ".join([told.get(at, ""), *map(str, values)])

            names["print"], error = said_beside, ""
            try:
                exec(compile("\n" * (line - 1) + text, page, "exec"), names)
            except BaseException:
                error = traceback.format_exc()
            out.write(json.dumps([told, error]) + "\n")
            out.flush()


def command(words: list[str]) -> int:
    """Runs the installed script; its exit status."""
    sys.argv = ["cdpr-sim", *words]
    with contextlib.ExitStack() as files:
        for number, name in ((1, "stdout"), (2, "stderr")):
            os.dup2(files.enter_context(open(name, "w")).fileno(), number)
        try:
            runpy.run_path(shutil.which("cdpr-sim") or "", run_name="__main__")
        except SystemExit as ended:
            return ended.code if isinstance(ended.code, int) else int(ended.code is not None)
        except BaseException:
            traceback.print_exc()
            return 1
        finally:
            sys.stdout.flush()
            sys.stderr.flush()
    return 0


def forked(work: Callable[[], int | None]) -> int:
    """The process that does the work, in a fork."""
    if pid := os.fork():
        return pid
    status = 1
    try:
        status = work() or 0
    finally:
        os._exit(status)


def page(name: str, folder: str, blocks: list) -> None:
    """Runs the blocks (language, line, text or words of a command) until one fails, and writes what they said."""
    os.chdir(folder)
    ends = os.pipe(), os.pipe()

    def session() -> None:
        os.close(ends[0][1])
        python(ends[0][0], ends[1][1])

    pid, answers = forked(session), []
    os.close(ends[1][1])
    with open(ends[0][1], "w") as requests, open(ends[1][0]) as replies:
        for language, line, what in blocks:
            if language == "python":
                requests.write(json.dumps([name, line, what]) + "\n")
                requests.flush()
                answers.append(json.loads(replies.readline() or '[{}, "its process has ended"]'))
            else:
                status = os.waitstatus_to_exitcode(os.waitpid(forked(lambda: command(what)), 0)[1])  # noqa: B023
                with open("stdout") as out, open("stderr") as err:
                    said, complaint = out.read(), err.read()
                answers.append([said, f"exit status {status}: {complaint}" if status else ""])
            if answers[-1][1]:
                break
    os.waitpid(pid, 0)
    with open("answers", "w") as file:
        json.dump(answers, file)


def main() -> None:
    """Answers requests until there are no more."""
    import distributed  # noqa: F401
    import h5netcdf  # noqa: F401
    import jaxtyping  # noqa: F401
    import jinja2  # noqa: F401
    import matplotlib.backends.backend_agg
    import matplotlib.figure  # noqa: F401
    import mujoco  # noqa: F401
    import numba  # noqa: F401
    import pydantic  # noqa: F401
    import scipy.optimize
    import scipy.spatial.transform  # noqa: F401
    import typer  # noqa: F401
    import xarray  # noqa: F401
    import yaml  # noqa: F401

    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)  # what libraries print while they are loaded is no answer
    for line in sys.stdin:
        request = json.loads(line)
        os.waitpid(forked(lambda: page(*request)), 0)  # noqa: B023
        print("done", file=answers, flush=True)


if __name__ == "__main__":
    main()

import multiprocessing
import threading
import time
from pathlib import Path

from cdpr_sim.core import compiling


def test_builder_runs_once_however_many_threads_ask():
    """Eight threads at once: one build, and all get its result."""
    built = []

    @compiling.built_once
    def build():
        time.sleep(0.05)
        built.append(object())
        return built[0]

    got: list = []
    threads = [threading.Thread(target=lambda: got.append(build())) for _ in range(8)]
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
    processes = [context.Process(target=stay_inside, args=(str(log),)) for _ in range(3)]
    for process in processes:
        process.start()
    for process in processes:
        process.join()
    assert log.read_text().split() == ["in", "out"] * 3


def test_nested_first_uses_do_not_wait_for_themselves():
    """One thing may need another while it is being compiled."""
    with compiling.first_use("test outer"), compiling.first_use("test inner"):
        pass

"""Compiles all kernels before the tests begin: side by side, each once, and within the time limit of no test."""

import logging
from concurrent.futures import ProcessPoolExecutor, wait
from multiprocessing import get_context

from cdpr_sim.core import compiling


def all_compiled() -> dict[str, compiling.Compiled]:
    """By the names of their folders; the solver, which takes longest, comes first."""
    from cdpr_sim.drawing.video import raycast
    from cdpr_sim.proof import search_kernel
    from cdpr_sim.statics import any_cable, gufuncs

    given = [value for module in (gufuncs, any_cable, search_kernel, raycast) for value in vars(module).values()]
    return {one.folder: one for one in given if isinstance(one, compiling.Compiled)}


def missing() -> list[str]:
    """What is kept nowhere; what is kept but cannot be loaded, the tests compile."""
    place = compiling.place()
    return [name for name in all_compiled() if place is None or not any(place.glob(f"{name}/*/*.nbc"))]


def compile_one(name: str) -> None:
    """In a process of its own, silently."""
    logging.disable()
    _ = all_compiled()[name].compiled


def compile_all(names: list[str], processes: int) -> None:
    """By so many processes. What cannot be compiled, the tests report."""
    with ProcessPoolExecutor(processes, get_context("spawn")) as pool:
        wait([pool.submit(compile_one, name) for name in names])

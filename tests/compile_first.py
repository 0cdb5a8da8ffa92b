"""Compiles all kernels before the tests begin: side by side, each once, and within the time limit of no test."""

import logging
from concurrent.futures import ProcessPoolExecutor, wait
from multiprocessing import get_context

from cdpr_sim.core import code_cache, compiling

UNUSED = {
    "margins_of_tensions_for_cables_with_a_memory", "margins_of_tensions_for_cables_with_mass",
    "margins_of_tensions_for_pulleys_and_nonlinear_laws", "balance_of_forces_for_cables_with_a_memory",
    "balance_of_forces_for_cables_with_mass", "search_for_saddles_for_cables_with_a_memory",
}  # fmt: skip
"""What no test needs: to compile it would take 10 s of two processors."""


def all_compiled() -> dict[str, compiling.Compiled]:
    """By the names of their folders; code on lanes, which takes longest, comes first."""
    from cdpr_sim.drawing.video import raycast
    from cdpr_sim.proof import search_kernel
    from cdpr_sim.statics import any_cable, gufuncs

    given = [value for module in (gufuncs, any_cable, search_kernel, raycast) for value in vars(module).values()]
    given = [one for value in given for one in (value if isinstance(value, list) else [value])]
    scalar = [one for one in given if isinstance(one, compiling.Compiled)]
    on_lanes = [one._of_many for one in scalar if isinstance(one, compiling.Kernel) and one._lanes is not None]
    named = {compiling._as_name(one._what): one for one in on_lanes + scalar}
    return {name: one for name, one in named.items() if name not in UNUSED}


def missing() -> list[str]:
    """What nothing has been published of; what is published for another version of Numba is compiled by the tests."""
    return [name for name in all_compiled() if not (code_cache.folder() / f"{name}-0").is_dir()]


def compile_one(name: str) -> None:
    """In a process of its own, silently."""
    logging.disable()
    _ = all_compiled()[name].compiled


def compile_all(names: list[str], processes: int) -> None:
    """By so many processes. What cannot be compiled, the tests report."""
    with ProcessPoolExecutor(processes, get_context("spawn")) as pool:
        wait([pool.submit(compile_one, name) for name in names])

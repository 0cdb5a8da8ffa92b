"""Batches that are divided among threads: compiled code runs beside others, as it releases Python's lock."""

from __future__ import annotations

import itertools
import math
import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np

from cdpr_sim.core.checks import MOST_THREADS, whole


def checked_threads(threads: int) -> int:
    """The number of threads; 0 is one per processor.

    Raises:
        InvalidInput: not a number of threads.
    """
    return whole("threads", threads, 0, MOST_THREADS) or os.cpu_count() or 1


def on_threads(
    function: Callable[..., tuple[np.ndarray, ...]], arguments: Sequence[Any], axes: Sequence[int], threads: int,
    least: float,
) -> tuple[np.ndarray, ...]:  # fmt: skip
    """Results of ``function``, computed in pieces of the batch along its first axis.

    Args:
        function: of arguments that broadcast before their own axes; its results have the batch's axes first.
        arguments: its arguments.
        axes: number of axes that each argument has of its own.
        threads: number of threads.
        least: number of elements for which a piece is worth a thread; no piece has fewer.
    """
    if threads == 1:
        return function(*arguments)
    before = [np.shape(one)[: np.ndim(one) - own] for one, own in zip(arguments, axes, strict=True)]
    loop = np.broadcast_shapes(*before)
    pieces = min(2 * threads, loop[0] // max(math.ceil(least / max(math.prod(loop[1:]), 1)), 1)) if loop else 1
    if pieces < 2:
        return function(*arguments)
    divides = [len(shape) == len(loop) and shape[0] > 1 for shape in before]

    def part(first: int, last: int) -> tuple[np.ndarray, ...]:
        return function(*(one[first:last] if each else one for one, each in zip(arguments, divides, strict=True)))

    edges = np.linspace(0, loop[0], pieces + 1).astype(int).tolist()
    with ThreadPoolExecutor(threads) as pool:
        parts = list(pool.map(part, *zip(*itertools.pairwise(edges), strict=True)))
    return tuple(np.concatenate(column) for column in zip(*parts, strict=True))

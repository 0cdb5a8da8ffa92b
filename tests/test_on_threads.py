"""Batches that are divided among threads."""

import threading

import numpy as np
import pytest

import cdpr_sim as cdpr
from cdpr_sim.analysis.workspace.feasibility import capacity_margin
from cdpr_sim.core import on_threads

ROWS = 2500
"""More than two pieces' worth."""

MASSES = np.linspace(0.2, 0.6, ROWS)

BATCHES = {
    "solve_many": lambda robot, poses, n: cdpr.solve_many(robot, poses, mass=MASSES, threads=n).positions,
    "few long rows": lambda robot, poses, n: (
        cdpr.solve_many(robot, np.resize(poses, (5, 700, 3)), threads=n).positions  # two pieces: one row is too few
    ),
    "columns": lambda robot, poses, n: cdpr.solve_many(robot, poses[:, None], mass=[0.3, 0.5], threads=n).tensions,
    "broadcast": lambda robot, poses, n: cdpr.solve_many(robot, poses[:1], mass=MASSES, threads=n).rotations,
    "shortfall": lambda robot, poses, n: cdpr.shortfall(robot, poses, threads=n),
    "feasible": lambda robot, poses, n: cdpr.feasible(robot, poses, threads=n),
    "capacity_margin": lambda robot, poses, n: capacity_margin(robot, poses, threads=n),
    "find_layout": lambda robot, poses, n: (
        cdpr.find_layout(
            robot, poses[:40], within=0.01, generations=1, population=60, polish=False, threads=n
        ).robot.exits  # 2,400 problems at once
    ),
}


@pytest.mark.parametrize("name", BATCHES)
def test_threads_change_no_result(catalogue, name, monkeypatch):
    """One thread or three, to the last bit; and there are three."""
    used, submitted = set(), on_threads.ThreadPoolExecutor.submit

    def submit(self, function, *arguments):
        return submitted(self, lambda: (used.add(threading.get_ident()), function(*arguments))[1])

    monkeypatch.setattr(on_threads.ThreadPoolExecutor, "submit", submit)
    robot = catalogue["parallel"]
    poses = np.random.default_rng(0).uniform(*robot.workspace, (ROWS, 3))
    one = BATCHES[name](robot, poses, 1)
    assert not used
    np.testing.assert_array_equal(BATCHES[name](robot, poses, 3), one)
    assert used


@pytest.mark.parametrize("threads", [-1, 1025])
def test_an_impossible_number_of_threads_is_refused(catalogue, threads):
    """A sentence with the field and what is expected."""
    for call in (cdpr.solve_many, cdpr.shortfall, cdpr.feasible, capacity_margin):
        with pytest.raises(cdpr.InvalidInput, match=rf"threads: found {threads}, expected 0 to 1,?024"):
            call(catalogue["cogiro"], np.array([0.4, 0.25, 0.1]), threads=threads)

"""Cables with mass settle side by side: no row has an effect on another one, nor has the number of threads."""

import numpy as np
import pytest

import cdpr_sim as cdpr
from cdpr_sim.physics.sagging import chain_simulations, settle_chains
from cdpr_sim.physics.sagging.stepping import Stepping

READ = ("positions", "rotations", "lengths", "tensions", "residuals", "eigenvalues", "iterations", "status")

NEAR, ALIKE = 1e-11, 1e-7
"""[m], and a fraction of the largest tension: some versions of NumPy round by the number of rows, which a search that
ends at a small unbalanced force carries on. Measured with NumPy 2.0: 2e-9 of a tension."""

WHEELS = {"pulley_radius": 0.01, "pulley_axis": (0, 0, -1), "stiffening": (3.0, 2.0)}


def stacked(name: str) -> cdpr.Problems:
    """Rows of one robot that settle in different ways: with and without a wrench, taut and with a slack cable."""
    robot = cdpr.load_robot("cogiro").replace(linear_density=5e-4, **(WHEELS if name == "wheels" else {}))
    problems = []
    for i, position in {0: (0.3, 0.25, 0.1), 2: (0.5, 0.2, 0.15), 3: (0.35, 0.22, 0.12)}.items():
        lengths = robot.rest_lengths(position) * np.where(np.arange(8) == i, 1 + 0.02 * i, 1.0)
        problems.append(cdpr.Problem.of(robot, position, lengths, [0.1 * i, 0, 0, 0, 0, 0]))
    return cdpr.Problems.stack(problems)


def differing(
    some: cdpr.EquilibriumBatch, others: cdpr.EquilibriumBatch, rows: list[int] | slice = slice(None)
) -> list[str]:
    """What is not the same to the last bit, in these rows of the others."""
    return [name for name in READ if not np.array_equal(getattr(some, name), getattr(others, name)[rows])]


def assert_near(some: cdpr.EquilibriumBatch, others: cdpr.EquilibriumBatch, rows: list[int]) -> None:
    """After the same steps, the same equilibria as these rows of the others, up to what rounding changes."""
    np.testing.assert_array_equal(some.status, others.status[rows])
    np.testing.assert_array_equal(some.iterations, others.iterations[rows])
    np.testing.assert_allclose(some.positions, others.positions[rows], rtol=0, atol=NEAR)
    np.testing.assert_allclose(some.tensions, others.tensions[rows], rtol=0, atol=ALIKE * others.tensions.max())


@pytest.mark.parametrize("name", ["exits", "wheels"])
def test_rows_are_the_same_with_any_others_beside_them(name, monkeypatch):
    """On two threads and in another order to the last bit, in parts and alone to rounding."""
    problems = stacked(name)
    settled = cdpr.settle_many(problems, threads=1)
    assert settled.converged.all()
    assert not differing(cdpr.settle_many(problems, threads=2), settled)
    order = [2, 0, 1]
    assert not differing(cdpr.settle_many(problems.take(np.array(order)), threads=1), settled, order)
    assert_near(cdpr.settle_many(problems.take(np.array([1])), threads=1), settled, [1])
    alone = cdpr.settle(problems[1])
    np.testing.assert_allclose(alone.position, settled.positions[1], rtol=0, atol=NEAR)
    assert alone.iterations == settled.iterations[1]
    monkeypatch.setattr(settle_chains, "ROWS", 2)
    assert_near(cdpr.settle_many(problems, threads=1), settled, [0, 1, 2])


def test_rows_with_time_steps_in_common_take_others(monkeypatch):
    """Negative control: if the shortest time step of all rows were that of each, a row would take other steps alone."""
    problems, advance = stacked("exits"), Stepping.advance
    alone = [cdpr.settle(problems[row]).iterations for row in range(len(problems))]
    assert cdpr.settle_many(problems, threads=1).iterations.tolist() == alone
    monkeypatch.setattr(
        Stepping, "advance", lambda self, at, longest: advance(self, at, np.full_like(longest, longest.min()))
    )
    assert cdpr.settle_many(problems, threads=1).iterations.tolist() != alone


@pytest.mark.parametrize("threads", [1, 2])
def test_mujoco_computes_on_as_many_threads_as_asked(threads, monkeypatch):
    """The argument comes to MuJoCo."""
    used, batch = [], chain_simulations.Batch

    def made(model, rows, threads):
        used.append(threads)
        return batch(model, rows, threads)

    monkeypatch.setattr(chain_simulations, "Batch", made)
    cdpr.settle_many(stacked("exits"), threads=threads)
    assert used == [threads]

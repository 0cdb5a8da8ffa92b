import numpy as np
import pytest
from scipy.optimize import minimize

import cdpr_sim as cdpr
from cdpr_sim.analysis import tensions as distribution
from cdpr_sim.analysis.compensation import demand_at
from cdpr_sim.statics import forces

SAME = 1e-5
"""Relative difference from SLSQP's answer, which stops at 1e-10 of the objective: the root of that in the tensions."""


def demand(name: str, position, lower=0.0, upper=np.inf) -> distribution.Demand:
    robot = cdpr.load_robot(name)
    problem = cdpr.Problem.of(robot, position)
    limits = (np.full(robot.cables, lower), np.full(robot.cables, upper))
    return demand_at(problem, problem.pose, *limits)


@pytest.mark.parametrize(("lower", "upper"), [(0.0, np.inf), (0.35, np.inf), (0.2, 1.06)])
def test_smallest_tensions_are_those_of_a_general_optimiser(lower, upper):
    """Least-distance programming against SLSQP, with limits that bind and without."""
    there = demand("cogiro", (0.25, 0.2, 0.15), lower, upper)
    found = distribution.smallest(there)
    assert found is not None
    bounds = [(lower, None if np.isinf(upper) else upper)] * 8
    constraint = {"type": "eq", "fun": lambda t: there.wrench_matrix @ t + there.load}
    general = minimize(lambda t: t @ t, np.full(8, 0.5), bounds=bounds, constraints=constraint, options={"ftol": 1e-14})
    assert np.abs(there.wrench_matrix @ found + there.load).max() < 1e-12 * there.scale
    assert found.min() >= lower
    assert found.max() <= upper
    assert found == pytest.approx(general.x, rel=SAME, abs=SAME)


def tried(there: distribution.Demand, around: np.ndarray, spread: float) -> np.ndarray:
    """Random tensions within 0.04 to 5 N that balance the same load."""
    null = np.linalg.svd(there.wrench_matrix)[2][6:]
    others = around + np.random.default_rng(0).normal(size=(2000, 2)) @ null * spread
    others = others[((others >= 0.04) & (others <= 5)).all(1)]
    assert len(others) > 50
    return others


def test_stiffest_tensions_beat_every_other_and_the_smallest_may_have_to_hold_the_platform():
    """No random tensions have a larger smallest eigenvalue.

    Asked for a stiffness that the smallest lack: just that, and no random tensions that have it are smaller.
    """
    there = demand("cogiro", (0.25, 0.2, 0.15), 0.04, 5.0)
    best, least = distribution.stiffest(there), distribution.smallest(there)
    value, low = there.softest(best)[0], there.softest(least)[0]
    assert value > low
    for other in tried(there, least, 0.7):
        assert there.softest(other)[0] <= value * (1 + 2 * distribution.GAP)
    floor = 0.5 * (low + value)
    found = distribution.smallest(there, floor)
    assert there.softest(found)[0] == pytest.approx(floor, rel=10 * distribution.GAP)
    assert np.abs(there.wrench_matrix @ found + there.load).max() < 1e-9 * there.scale
    for other in tried(there, found, 0.3):
        if there.softest(other)[0] >= floor:
            assert np.linalg.norm(other) >= np.linalg.norm(found) * (1 - 2 * distribution.GAP)
    assert distribution.smallest(there, 1.001 * value) is None


def test_stiffness_is_affine_in_the_tensions():
    """What the cutting planes rest on: read off at tensions other than those it was built from."""
    there = demand("parallel", (0.4, 0.25, 0.1))
    robot = cdpr.load_robot("parallel")
    tensions = np.random.default_rng(1).uniform(0.1, 2, 8)
    lengths = robot.rest_lengths((0.4, 0.25, 0.1))
    rest = lengths * robot.axial_stiffness / (robot.axial_stiffness + tensions)
    problem = cdpr.Problem.of(robot, (0.4, 0.25, 0.1), rest)
    expected = forces.at(problem, problem.pose.translation, problem.pose.rotation.as_matrix()).eigenvalues[0]
    assert there.softest(tensions)[0] == pytest.approx(expected, rel=1e-9)


def test_where_nothing_balances_the_leftover_proves_it():
    """Farkas: along the wrench left over the load gains and every cable gets shorter or stays as long."""
    there = demand("parallel", (0.17, 0.25, 0.1))
    assert distribution.smallest(there) is None
    assert distribution.stiffest(there) is None
    left = distribution.leftover(there)
    assert left @ there.load > 0
    assert (there.wrench_matrix.T @ left >= -1e-9 * there.scale).all()
    # Negative control: where tensions balance the load, nothing is left over.
    assert np.abs(distribution.leftover(demand("cogiro", (0.17, 0.25, 0.1)))).max() < 1e-9

"""``least_share``: forces within friction cones, against linear programmes, closed forms and a load too large."""

import numpy as np
import pytest
from scipy.optimize import linprog

from cdpr_sim.anymodel import friction_limits
from cdpr_sim.anymodel.friction_limits import least_share, shares


def drawn(seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A matrix of full row rank, a load that forces within moderate limits carry, and the cones of two rows each."""
    rng = np.random.default_rng(seed)
    cones = np.repeat(np.arange(rng.integers(3, 20)), 2)
    matrix = rng.standard_normal((rng.integers(2, len(cones)), len(cones))) * 10.0 ** rng.uniform(-2, 0, len(cones))
    return matrix, matrix @ rng.uniform(-0.4, 0.4, len(cones)), cones


def by_linear_programme(matrix: np.ndarray, load: np.ndarray, cones: np.ndarray) -> float:
    """The least share of pyramids: forces as differences of two that are not negative."""
    rows, count = len(cones), cones.max() + 1
    faces = np.zeros((count, 2 * rows + 1))
    faces[cones, np.arange(rows)] = faces[cones, rows + np.arange(rows)] = 1
    faces[:, -1] = -1
    equal = np.hstack([matrix, -matrix, np.zeros((len(matrix), 1))])
    return linprog(np.eye(2 * rows + 1)[-1], faces, np.zeros(count), equal, load, (0, None)).fun


@pytest.mark.parametrize("seed", range(10))
def test_pyramids_carry_a_load_with_the_share_of_the_linear_programme(seed):
    """And all of the load."""
    matrix, load, cones = drawn(seed)
    pyramids = np.ones(cones.max() + 1, dtype=bool)
    use = least_share(matrix, load, cones, pyramids)
    assert matrix @ use == pytest.approx(load, abs=1e-12 * np.linalg.norm(load))
    assert shares(use, cones, pyramids).max() == pytest.approx(by_linear_programme(matrix, load, cones), rel=1e-3)


@pytest.mark.parametrize("seed", range(10))
def test_round_cones_lie_between_the_pyramids_inside_and_around_them(seed):
    """|u|_2 <= |u|_1 <= sqrt(2) |u|_2 of two rows, and so do the least shares."""
    matrix, load, cones = drawn(seed)
    pyramids = np.ones(cones.max() + 1, dtype=bool)
    use = least_share(matrix, load, cones, ~pyramids)
    share, outer = shares(use, cones, ~pyramids).max(), by_linear_programme(matrix, load, cones)
    assert matrix @ use == pytest.approx(load, abs=1e-12 * np.linalg.norm(load))
    assert outer / np.sqrt(2) * (1 - 1e-3) <= share <= outer * (1 + 1e-3)


def test_unequal_contacts_share_a_load_by_their_limits():
    """Limits of 1 and 3 N carry 2 N with half of each; the matrix has the forces at the limits."""
    use = least_share(np.array([[1.0, 3.0]]), np.array([2.0]), np.arange(2), np.zeros(2, dtype=bool))
    assert use == pytest.approx([0.5, 0.5], rel=1e-6)


@pytest.mark.parametrize("pyramids", [False, True])
def test_a_load_too_large_leaves_the_rest_at_the_limit(pyramids):
    """5 N against limits of 1 and 3 N: 1 N is left."""
    corners = np.full(2, pyramids)
    use = least_share(np.array([[1.0, 3.0]]), np.array([5.0]), np.arange(2), corners)
    assert 5 - use @ [1, 3] == pytest.approx(1, abs=1e-4)
    assert shares(use, np.arange(2), corners) == pytest.approx([1, 1], abs=1e-4)


def test_no_load_needs_no_friction():
    """Nor does it divide by zero."""
    assert not least_share(np.eye(2), np.zeros(2), np.zeros(2, dtype=int), np.zeros(1, dtype=bool)).any()


@pytest.mark.parametrize("size", [1e-200, 1.0, 1e200])
def test_steps_of_any_size_reach_the_limits(size):
    """From (1, 0) along (-1, 1) the cone ends after a half, in any unit; a step that is no number goes nowhere."""
    point, step = np.array([[1.0, 0.0]]), np.array([[-1.0, 1.0]])
    assert friction_limits._reach(point, size * step) * size == pytest.approx(0.5)
    assert friction_limits._reach(point, np.inf * step) == 0

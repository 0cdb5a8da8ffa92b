import numpy as np
import pytest
from sample_problems import paper_line
from scipy.optimize import OptimizeResult

import cdpr_sim as cdpr
from cdpr_sim.statics import seecr


def test_first_guess_falls_by_the_mean_vertical_component(catalogue):
    """m g l_vmean/EA on two-cable: exits at z = 0.5 m, anchors at the platform's own height."""
    problem = cdpr.Problem.of(catalogue["two-cable"], (0.4, 0, 0.2))
    np.testing.assert_allclose(seecr.initial_deviation(problem), [0, 0, -0.4 * 9.81 * 0.3 / 10e3, 0, 0, 0])


def test_stalled_least_squares_is_not_an_answer(catalogue):
    """At x = 0.285 m SciPy reports success, far from equilibrium: we say so, and carry the point."""
    robot = catalogue["parallel"]
    with pytest.raises(cdpr.NotConverged, match=r"stopped with .* N unbalanced") as error:
        cdpr.solve(robot, (0.285, 0.25, 0.1), method="least_squares")
    stalled = error.value.equilibrium
    assert stalled is not None
    assert stalled.residual > 0.1
    assert stalled.source == "seecr/least_squares"
    truth = cdpr.solve(robot, (0.285, 0.25, 0.1))
    assert np.degrees(truth.tilt - stalled.tilt) > 4


def test_every_answer_of_seecr_is_an_equilibrium(catalogue):
    """On the parallel layout either forces balance, or it raises; which of the two, rounding decides at some poses."""
    robot = catalogue["parallel"]
    answers = 0
    for pose in paper_line(robot, 8)[[1, 10]]:  # in its left half, which the right one mirrors
        for method in ("fsolve", "least_squares"):
            try:
                result = cdpr.solve(robot, pose, method=method)
            except cdpr.NotConverged as failure:
                assert failure.equilibrium is not None
                assert failure.equilibrium.residual > seecr.RESIDUAL_TOLERANCE * robot.weight
            else:
                assert result.residual <= seecr.RESIDUAL_TOLERANCE * robot.weight
                assert result.iterations > 0
                answers += 1
    assert answers > 0


@pytest.mark.parametrize("method", ["fsolve", "least_squares"])
def test_what_scipy_calls_a_success_is_checked(catalogue, method, monkeypatch):
    """A solver that stops at its first guess and reports success is refused, and the guess is carried."""

    def stops(function, guess, full_output=False):
        found = OptimizeResult(x=guess, nfev=1, message="converged")
        return (found.x, found, 1, found.message) if full_output else found

    monkeypatch.setattr(seecr.optimize, method, stops)
    problem = cdpr.Problem.of(catalogue["parallel"], (0.17, 0.25, 0.1))
    with pytest.raises(cdpr.NotConverged, match="SciPy: converged") as failure:
        cdpr.solve(problem, method=method)
    assert failure.value.equilibrium is not None
    guess = problem.position + seecr.initial_deviation(problem)[:3]
    np.testing.assert_array_equal(failure.value.equilibrium.position, guess)


def test_unknown_method_is_refused_with_the_nearest(catalogue):
    """A typo gets the nearest valid name."""
    with pytest.raises(cdpr.UnknownName, match="did you mean newton"):
        cdpr.solve(catalogue["cogiro"], (0.4, 0.25, 0.1), method="newtn")

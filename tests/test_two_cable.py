import numpy as np
import pytest
from sample_problems import grid

import cdpr_sim as cdpr
from cdpr_sim.statics import two_cable_closed_form

ROTATION = 1e-7
"""[rad] The solver's residual of 8e-9 N on a bar whose rotation is held by about 0.2 N m/rad, divided by 0.05 m."""


def test_tensions_are_the_solvers(catalogue):
    """Two unknown tensions from two force balances, no elasticity in sight."""
    robot = catalogue["two-cable"]
    for pose in grid(robot, 20):
        result = cdpr.solve(robot, pose)
        np.testing.assert_allclose(
            two_cable_closed_form.tensions(robot, result.position, result.euler[1]), result.tensions, atol=1e-6
        )


def test_closed_form_notices_an_anchor_that_is_moved(catalogue):
    """Negative control: a bar 2 mm longer leaves the manifold."""
    robot = catalogue["two-cable"]
    longer = robot.replace(anchors=robot.anchors * (52 / 51))
    result = cdpr.solve(longer, (0.2, 0, 0.1))
    rotations = two_cable_closed_form.equilibrium_rotations(robot, result.position)
    assert np.abs(rotations - result.euler[1]).min() > 100 * ROTATION


def test_level_bar_in_the_middle_rests_level_or_turned_over(catalogue):
    """By symmetry; turned over is where the quartic loses its leading term."""
    rotations = two_cable_closed_form.equilibrium_rotations(catalogue["two-cable"], (0.4, 0, 0.2))
    np.testing.assert_allclose(np.abs(rotations), [np.pi, 0], atol=1e-12)


def test_the_papers_formula_is_the_limit_of_a_short_bar(catalogue):
    """Mended Eq. 5 and 6 are the closed form for b → 0, with an error of first order in b."""
    robot = catalogue["two-cable"]
    errors = []
    for shrink in (1e-2, 1e-3):
        short = robot.replace(anchors=robot.anchors * shrink)
        rotations = two_cable_closed_form.equilibrium_rotations(short, (0.2, 0, 0.1))
        errors.append(np.abs(rotations - two_cable_closed_form.short_bar_rotation(short, (0.2, 0, 0.1))).min())
    assert errors[0] < 1e-2
    assert errors[0] / errors[1] == pytest.approx(10, rel=0.1)


def test_cables_that_would_have_to_push_are_no_equilibrium(catalogue):
    """Beside both exits the quartic has roots at which one cable pushes: those are left out."""
    bar = catalogue["two-cable"]
    for x in (0.2, 0.4, 0.9, 1.2):
        for beta in two_cable_closed_form.equilibrium_rotations(bar, (x, 0, 0.2)):
            assert (two_cable_closed_form.tensions(bar, (x, 0, 0.2), beta) > 0).all()

"""Robots that nobody builds on purpose: cables of no length, loads of nothing, pretension of a thousand weights."""

import itertools

import numpy as np
import pytest
from sample_problems import unbalanced

import cdpr_sim as cdpr
from cdpr_sim.core.status import ACCEPTABLE, Status
from cdpr_sim.statics import forces

FRAME = np.array(list(itertools.product([0, 4], [0, 3], [0, 3])), dtype=float)
CUBE = np.array(list(itertools.product([-0.1, 0.1], repeat=3)))
TOUCHING = np.array([0.1, 2.9, 0.1])
"""Where the cube's third anchor lies on its exit."""

GRID_ROUNDING = np.array([1e-13, 0, 0])
"""[m] What a grid leaves of a cable of length zero."""


def robot(**changes) -> cdpr.Robot:
    """A 10 kg cube in a room of 4 x 3 x 3 m, a cable to each corner."""
    return cdpr.Robot(FRAME, CUBE, **({"axial_stiffness": 1e5, "mass": 10.0} | changes))


@pytest.mark.parametrize("method", [cdpr.solve_many, cdpr.settle_many])
def test_a_cable_shorter_than_rounding_is_refused_and_a_row_of_a_batch(method):
    """A grid may touch an exit: it once came back converged with the whole weight unbalanced; others are answered."""
    with pytest.raises(cdpr.InvalidInput, match=r"rest length of 1.0e-13 m in cable 3, expected more than 4.0e-09 m"):
        cdpr.solve(robot(), TOUCHING + GRID_ROUNDING)
    equilibria = method(robot(), [TOUCHING, TOUCHING + GRID_ROUNDING, (2, 1.5, 1.5)])
    assert [Status(status) for status in equilibria.status] == [Status.NOT_FINITE, Status.NOT_FINITE, Status.CONVERGED]
    with pytest.raises(cdpr.CdprError, match="shorter than rounding"):
        equilibria[1]
    assert np.isfinite(equilibria.poses.translation[2]).all()


@pytest.mark.parametrize("method", [cdpr.solve, cdpr.settle])
def test_an_anchor_that_starts_on_its_exit_with_slack_cable_falls_into_it(method):
    """A cable of length zero that is let out is no error, and pulls nowhere: the mass hangs below in the end."""
    hanging = cdpr.Robot([[0, 0, 3]], [[0, 0, 0.1]], 1e4, 2.0, platform_size=(0.2, 0.2, 0.2))
    found = method(hanging, (0, 0, 2.9), [1.5])
    assert found.position == pytest.approx([0, 0, 2.9 - 1.5 * (1 + hanging.weight / 1e4)], abs=1e-8)


@pytest.mark.parametrize(("stiffness", "mass"), [(3e4, 1e-6), (3e5, 1e-5), (1e5, 10.0)])
@pytest.mark.parametrize("gap", [1e-8, 1e-6, 1e-3, 1.0])
def test_what_is_called_converged_balances(stiffness, mass, gap):
    """However stiff, light and short: what is left is below a millionth of the load, or it is not an equilibrium."""
    machine = robot(axial_stiffness=stiffness, mass=mass)
    try:
        found = cdpr.solve(machine, TOUCHING + gap * np.array([1, -1, 1]))
    except cdpr.NotConverged as failure:
        assert failure.equilibrium.residual > 1e-9 * machine.weight
        return
    assert unbalanced(found) <= ACCEPTABLE


@pytest.mark.parametrize("name", ["parallel", "ipanema-1"])
def test_a_batch_accepts_what_solve_accepts(name):
    """Cables with mass, so stiff that rounding is a millionth of the load: one bound for a row and for one problem."""
    machine = cdpr.load_robot(name)
    machine = machine.replace(axial_stiffness=3e10 * machine.mass, linear_density=1e-4)
    equilibria = cdpr.solve_many(machine, np.random.default_rng(0).uniform(*machine.workspace, (400, 3)))
    state = forces.at(equilibria.problems, equilibria.positions, equilibria.rotations)
    within = state.residual <= 1.001 * ACCEPTABLE * machine.weight  # reading a pose moves it by the last bit
    assert within[equilibria.converged].all()
    assert (equilibria.residuals[equilibria.converged] > 0.1 * ACCEPTABLE * machine.weight).any()
    for row in range(0, 400, 40):
        try:
            cdpr.solve(machine, equilibria.problems.positions[row])
            alone = Status.CONVERGED
        except cdpr.NotConverged as failure:
            alone = Status(int(equilibria.status[row]))
            assert alone.sentence in str(failure)
        assert equilibria.status[row] == alone


@pytest.mark.parametrize("method", ["newton", "fsolve", "least_squares"])
@pytest.mark.parametrize("mobility", ["spatial", "planar"])
def test_without_load_pretension_alone_is_an_equilibrium(method, mobility):
    """Without gravity the cables' own forces are the measure: a pretensioned platform is in the middle."""
    machine, middle, start = robot(gravity=0), (2, 1.5, 1.5), (2.01, 1.49, 1.5)
    if mobility == "planar":
        rows = [0, 1, 4, 5]
        machine = cdpr.Robot(FRAME[rows] * [1, 0, 1], CUBE[rows] * [1, 0, 1], 1e5, 10, mobility="planar", gravity=0)
        middle, start = (2, 0, 1.5), (2.01, 0, 1.49)
    found = cdpr.solve(machine, start, 0.999 * machine.rest_lengths(middle), method=method)
    assert found.tensions.min() > 90
    assert found.stable
    assert found.position == pytest.approx(middle, abs=1e-9)


def test_without_load_slack_cables_hold_any_pose():
    """Nothing pulls: it is at rest where it is, and neutral."""
    machine = robot(gravity=0)
    found = cdpr.solve(machine, (2, 1.5, 1.5), 1.1 * machine.rest_lengths((2, 1.5, 1.5)))
    assert found.slack.all()
    assert found.position == pytest.approx([2, 1.5, 1.5])
    assert found.stability is cdpr.Stability.NEUTRAL


def test_a_thousand_weights_of_pretension_do_not_hide_the_weight():
    """The energy of tight cables has more rounding than the load has energy: what is rounding follows the energy."""
    random, machine = np.random.default_rng(3), robot(axial_stiffness=5e7, mass=1.0, name="tight")
    poses = random.uniform([1.5, 1, 1], [2.5, 2, 2], (50, 3))
    lengths = np.array([machine.rest_lengths(pose) for pose in poses]) * random.uniform(0.975, 0.98, (50, 8))
    equilibria = cdpr.solve_many(machine, poses, lengths)
    assert equilibria.converged.all()
    assert (equilibria.tensions.max(-1) > 1e4 * machine.weight).all()
    assert max(unbalanced(one) for one in equilibria) < 3 * ACCEPTABLE  # a rounding of 5e7 N is 1e-8 N

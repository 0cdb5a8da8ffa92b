"""Which poses rigid cables can hold; ``test_matrix.py`` judges shortfalls by least squares."""

import numpy as np
import pytest
from sample_problems import symmetric_pair
from scipy.optimize import linprog

import cdpr_sim as cdpr
from cdpr_sim.analysis.workspace.feasibility import (
    capacity_margin,
    closed_form_feasible,
    feasible_by_linprog,
)
from cdpr_sim.statics import forces

FIRST_ORDER = 0.03
"""Error of the first order in weight over tension [N]: 0.012 measured, for cables of 6 N under 270 to 360 N."""


SAME_MARGIN = 1e-9
"""[N] Between the compiled margin and HiGHS's: 5e-11 measured."""

ROBOTS = {name: {} for name in ("parallel", "planar-vertical", "two-cable")} | {
    "cogiro": {"pulley_radius": [0.01] * 4 + [0.0] * 4, "pulley_axis": (0, 0, 1)}
}


@pytest.mark.parametrize("name", ROBOTS)
@pytest.mark.parametrize("limits", [(0, np.inf), (0.1, 3.0)])
def test_margin_is_what_linear_programming_finds(name, limits):
    """The largest t with tau_min + t <= tau <= tau_max - t in balance with each wrench; its sign is feasibility."""
    robot = cdpr.load_robot(name).replace(**ROBOTS[name])
    positions = np.random.default_rng(3).uniform(*robot.workspace, (10, 3))
    wrenches = robot.weight * np.array([[0.0] * 6, [0.2, 0, -0.3, 0, 0, 0]])
    asked = {"tension_limits": limits, "wrenches": wrenches}
    found = capacity_margin(robot, positions, **asked)
    assert ((found >= -SAME_MARGIN) == cdpr.feasible(robot, positions, **asked)).all()
    m, upper = robot.cables, np.full(robot.cables, limits[1])
    A = np.vstack([np.column_stack([-np.eye(m), np.ones(m)]), np.column_stack([np.eye(m), np.ones(m)])])
    b = np.concatenate([np.full(m, -limits[0]), np.minimum(upper, 1e6)])
    for position, margin in zip(positions, found, strict=True):
        free, margins = robot.free, []
        W = (forces.geometry(robot, position, np.eye(3)).wrench_matrix / robot.units[:, None])[free]
        for wrench in wrenches:
            problem = cdpr.Problem.of(robot, position, external_wrench=wrench)
            load = (forces.load_wrench(problem, np.eye(3)) / robot.units)[free]
            held = linprog(
                np.append(np.zeros(m), -1.0), A_ub=A, b_ub=b, A_eq=np.column_stack([W, np.zeros(len(W))]),
                b_eq=-load, bounds=[(None, None)] * m + [(None, float(np.linalg.norm(load)))],
            )  # fmt: skip
            margins.append(held.x[-1] if held.status == 0 else -np.inf)
        assert margin == pytest.approx(min(margins), abs=SAME_MARGIN)


def test_cables_with_mass_are_held_where_their_catenaries_are():
    """The only tensions of six cables, by the equilibrium there, whose ends differ by the weight times the height.

    Negative control: without the cables' weight the margin is wrong by more than their whole weight on a cable. Limits
    that are closer to each other than the ends' tensions hold nothing.
    """
    massless = cdpr.load_robot("nist-robocrane")
    robot, pose = massless.replace(linear_density=0.2), np.add(massless.home, (0.3, -0.2, 0.1))
    low = cdpr.solve(robot, pose, cdpr.compensate(robot, pose).rest_lengths).tensions
    high = low + robot.cable_weights * (robot.exits - pose - robot.anchors)[:, 2]
    for room in (5.0, 0.1, -0.1):
        limits = {"tension_limits": (low - room, high + room)}
        assert capacity_margin(robot, pose, **limits) == pytest.approx(room, abs=FIRST_ORDER)
        for method in (cdpr.feasible, closed_form_feasible, feasible_by_linprog):
            assert method(robot, pose, **limits) == (room > 0)
        assert capacity_margin(massless, pose, **limits) < room - 3
        assert not cdpr.feasible(massless, pose, **limits) or room > 3
    asked = {"tension_limits": (300.0, 300.1)}
    assert cdpr.shortfall(robot, robot.home, **asked) == np.inf
    assert not cdpr.feasible(robot, robot.home, **asked)
    assert not closed_form_feasible(robot, robot.home, **asked)


PAIR = symmetric_pair(angle=0.5).robot
TENSION = PAIR.weight / (2 * np.cos(0.5))
"""[N] By symmetry."""


@pytest.mark.parametrize(
    ("limits", "missing"),
    [
        ((0, TENSION * (1 + 1e-8)), 0), ((0, TENSION * (1 - 1e-8)), 1e-8), ((TENSION * (1 - 1e-8), np.inf), 0),
        ((TENSION * (1 + 1e-8), np.inf), 1e-8), ((0, 0), 1), ((0, TENSION / 2), 0.5),
    ],
)  # fmt: skip
def test_a_symmetric_pair_holds_exactly_what_its_limits_allow(limits, missing):
    """tau = m g / (2 cos angle); what is missing is a share of the load."""
    assert cdpr.feasible(PAIR, [0.0, 0, 0], tension_limits=limits) == (missing == 0)
    assert cdpr.shortfall(PAIR, [0.0, 0, 0], tension_limits=limits) == pytest.approx(missing, rel=1e-6, abs=1e-14)


def test_pair_holds_its_point_only_between_its_exits():
    """Outside the exits nothing pulls back; beside an exit's vertical, the border is exact; nor without numbers.

    An anchor on its exit has no direction; none of these is an error, since a sweep may hold some.
    """
    x = np.array([-1.5, -1 - 1e-6, -1 + 1e-6, 0.3, 1 - 1e-6, 1 + 1e-6, 1.5]) * np.sin(0.5)
    positions = np.vstack([np.stack([x, 0 * x, 0 * x], axis=-1), [np.nan, 0, 0], PAIR.exits[0]])
    np.testing.assert_array_equal(cdpr.feasible(PAIR, positions), [0, 0, 1, 1, 1, 0, 0, 0, 0])
    np.testing.assert_array_equal(np.isnan(cdpr.shortfall(PAIR, positions)), [0, 0, 0, 0, 0, 0, 0, 1, 1])

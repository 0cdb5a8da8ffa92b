"""The cross-check: statics and MuJoCo, which share no physics code, agree on pose, tilt, tensions and slack cables.

What is wrong by 1 % is noticed: ``test_negative_controls.py``.
"""

import numpy as np
import pytest
from sample_problems import grid

import cdpr_sim as cdpr
from cdpr_sim.crosscheck.compare import POSITION_TOLERANCE, TENSION_TOLERANCE, Verdict, compare_many
from cdpr_sim.robots.catalogue import PAPER_ROBOTS

MOST_FREE = 0.08
"""Largest fraction of poses at which a platform may turn freely about two diagonal cables: only on ``parallel``, where
70 of these 1,440 do with Vectran; see test_newton."""


@pytest.mark.parametrize("poses", [300, pytest.param(1200, marks=pytest.mark.slow)])
@pytest.mark.parametrize("material", ["vectran-0.7mm", "fishing-0.4mm"])
@pytest.mark.parametrize("name", PAPER_ROBOTS)
def test_methods_agree_over_the_workspace(catalogue, name, material, poses):
    """At each pose of a grid the two agree, or differ only where the platform may turn freely."""
    robot = catalogue[name].replace(material=material)
    problems = cdpr.Problems.of(robot, grid(robot, poses))
    solved, settled = cdpr.solve_many(problems), cdpr.settle_many(problems)
    assert solved.converged.all()
    assert settled.converged.all()
    many = compare_many(solved, settled)
    assert many.errors["position_error"].max() <= POSITION_TOLERANCE
    assert many.errors["tension_error"].max() <= TENSION_TOLERANCE
    assert len(problems) >= 0.9 * poses
    for row in range(len(problems)):
        assert many.agreement(row).agrees, many.agreement(row).reasons
        assert many.agreement(row).same_slack
    free = np.mean(many.verdicts == Verdict.AGREE_EXCEPT_NEUTRAL)
    assert free <= (MOST_FREE if name == "parallel" else 0)
    assert (free > 0) == (name == "parallel")


CLOSED_FORM = 1e-7
"""[m, rad, and relative] At rest 1e-9 of the load is unbalanced, on suspensions that weigh a newton per centimetre."""


@pytest.mark.parametrize("angle", [0.5, -1.2])
def test_torque_about_the_vertical_twists_a_suspension_on_parallel_cables(angle):
    """Twisted by γ, n cables at radius r lean by their chord 2 r sin(γ/2) and lift the platform: M = m g r² sin γ / h.

    Each carries m g l/(n h), with l² = h² + 4 r² sin²(γ/2); the horizontal parts of the pulls are what turns it back.
    To hang at the height h below its exits, a cable has the rest length l EA/(EA + tau).
    """
    radius, height, mass, cables = 0.3, 1.2, 2.0, 3
    around = np.linspace(0, 2 * np.pi, cables, endpoint=False)
    circle = radius * np.stack([np.cos(around), np.sin(around), np.zeros(cables)], axis=1)
    stiffness = np.array([2e3, 3e3, 5e3])
    robot = cdpr.Robot(circle + np.array([0, 0, 2.0]), circle, stiffness, mass, name="trifilar")
    length = np.hypot(height, 2 * radius * np.sin(angle / 2))
    tension = robot.weight * length / (cables * height)
    torque = robot.weight * radius**2 * np.sin(angle) / height
    rest_lengths = length * stiffness / (stiffness + tension)
    problem = cdpr.Problem.of(robot, (0, 0, 0.8), rest_lengths, [0, 0, 0, 0, 0, torque])
    for rest in (cdpr.solve(problem), cdpr.settle(problem)):
        np.testing.assert_allclose(rest.position, [0, 0, 2.0 - height], atol=CLOSED_FORM)
        np.testing.assert_allclose(rest.rotation.as_rotvec(), [0, 0, angle], atol=CLOSED_FORM)
        np.testing.assert_allclose(rest.tensions, tension, rtol=CLOSED_FORM)
        assert rest.stable

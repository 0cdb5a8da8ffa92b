"""One cable of any kind, and robots that mix them, against the oracle."""

import itertools

import numpy as np
import oracle
import pytest
from oracle import Rig

import cdpr_sim as cdpr
from cdpr_sim.statics import forces

ENDS = 1e-10
"""Relative difference of a pull from that of a cable which ends at its anchor, by the oracle's integral; measured 2e-11
for nonlinear cables that sag deeply, and 4e-12 for the others."""

PROPORTIONAL = 0.02
"""Relative deviation from proportionality of the change by a small property and by a tenth of it."""

KINDS = list(
    itertools.product(
        (0.0, 0.1), ((0.0, 0.0), (100.0, 2e4)), (0.996, 0.99999, 1.01, 1.1), [(3, 4, -6), (-2, 1, 0.4), (0.5, 0, -8)],
        [1, -1], (0.0, 6.0),
    )
)  # fmt: skip
"""Radius of the wheel; law; rest length over that of the path: taut, just taut, slack and sagging; span; which way the
wheel's axis points; length behind the exit."""


def every_kind(**changes) -> cdpr.Problem:
    """A robot with a cable of each kind, all of which end at one anchor."""
    radius, law, slackness, span, sign, behind = map(np.array, zip(*KINDS, strict=True))
    robot = cdpr.Robot(
        -span, np.zeros_like(span), 1e5, 1.0, platform_size=(0.1, 0.1, 0.1), linear_density=0.6 / 9.81, stiffening=law,
        pulley_radius=radius, pulley_axis=sign[:, None] * np.array([0.1, -0.2, np.sqrt(0.95)]), winch_to_exit=behind,
    )  # fmt: skip
    rest = slackness * robot.rest_lengths((0, 0, 0))
    return cdpr.Problem.of(robot.replace(**changes), (0, 0, 0), rest)


def pulls(problem: cdpr.Problem) -> np.ndarray:
    """On the anchors, (cables, 3)."""
    return forces.at(problem, problem.position, np.eye(3)).pulls


def test_every_cable_pulls_as_one_that_ends_at_its_anchor() -> None:
    """Over wheels and points, linear or not, taut and slack."""
    problem = every_kind()
    rig, found = Rig.of(problem.robot), pulls(problem)
    mine = oracle.balance(rig, problem.position, np.eye(3), oracle.Ropes(rig, problem.rest_lengths)).pulls
    far = np.linalg.norm(found - mine, axis=1) / np.linalg.norm(mine, axis=1)
    assert (far <= ENDS).all()


@pytest.mark.parametrize("beside", [True, False], ids=["beside the others", "alone"])
@pytest.mark.parametrize("name", ["pulley_radius", "linear_density", "winch_to_exit", "stiffening"])
def test_every_property_vanishes_smoothly(name, beside) -> None:
    """Where a radius, a weight, a length behind the exit or a coefficient tends to 0, the pull changes in proportion.

    From exactly 0, where other code may be taken; the other three properties are there or not, cables taut and slack.
    """
    given = dict(pulley_radius=0.1, stiffening=(100.0, 2e4), linear_density=0.06, winch_to_exit=6.0)
    if not beside:
        given = dict(pulley_radius=0.0, stiffening=(0.0, 0.0), linear_density=0.0, winch_to_exit=0.0)
        given |= {"linear_density": 0.06} if name != "linear_density" else {}
    small = {"pulley_radius": 1e-5, "stiffening": (1e-3, 0.0), "linear_density": 1e-8, "winch_to_exit": 1e-3}[name]

    def pull(part: float) -> np.ndarray:
        return pulls(every_kind(**given | {name: part * np.array(small)}))

    none = pull(0.0)
    large, tenth = pull(1.0) - none, pull(0.1) - none
    scale = np.abs(large).max(1)
    assert np.isfinite(large).all()
    assert (scale > 0).any()
    assert (np.abs(large - 10 * tenth).max(1) <= PROPORTIONAL * scale + 1e-11 * np.abs(none).max(1) + 1e-9).all()

"""What simulation refuses, and what cables cannot be: in one sentence, with the field, what was found and expected."""

from __future__ import annotations

import re

import mujoco
import numpy as np
import pytest
from test_settle_path import ELEMENTS

import cdpr_sim as cdpr
from cdpr_sim.analysis.workspace.feasibility import capacity_margin

POSE = (0.3, 0.25, 0.15)
COGIRO = cdpr.load_robot("cogiro")
ROPES = COGIRO.replace(hysteresis=ELEMENTS)
SHORT = cdpr.Problem.of(COGIRO.replace(linear_density=5e-4, pulley_radius=0.03, pulley_axis=(0, 0, 1)), POSE)
WHEELS = COGIRO.replace(pulley_radius=0.05)
UNDER = WHEELS.exits[2] - WHEELS.anchors[2] + [0.01, 0.0, -0.3]
ON_A_WHEEL = cdpr.Robot([[0, 0, 1]], [[0, 0, 0]], 1e3, 1.0, pulley_radius=0.1, platform_size=(0.1, 0.1, 0.1))
LONG = cdpr.load_robot("ipanema-1").replace(axial_stiffness=1e4, winch_to_exit=500.0, force_max=np.inf)
TEXT = cdpr.to_mjcf(COGIRO, POSE)
FALLING = (0.0, -8.0)  # a law that ends at 13.6 N of 100 N
PLUMB = cdpr.Robot([[0, 0, 2]], [[0, 0, 0]], 100.0, 13.61 / 9.81, stiffening=FALLING, platform_size=(0.1, 0.1, 0.1))


def settled_in(text: str, robot: cdpr.Robot, **given) -> cdpr.Equilibrium:
    return cdpr.settle(robot, POSE, model=mujoco.MjModel.from_xml_string(text), **given)


HAS_MEMORY = "^robot: found hysteresis in cable 1, expected"
TOO_SHORT = r"^rest_lengths: found \S+ m in cable 1, with mass and over a pulley of 0\.03 m, expected at least 0\.\d+ m"
IS_UNDER = r"anchor of cable 3 inside or below its pulley.s wheel, 0.01 m from the pulley's"

REFUSALS = [
    (lambda: cdpr.settle_many(cdpr.Problems.of(COGIRO, [POSE] * 2, mass=[0.4, 0.5])), "mass: found one per problem"),
    (lambda: settled_in(TEXT.replace('<body name="origin" />', ""), COGIRO, external_wrench=[1, 0, 0, 0, 0, 0]),
     "origin"),
    (lambda: cdpr.to_mjcf(SHORT, rest_lengths=np.ones(8)), "rest_lengths: found one beside a Problem"),
    (lambda: cdpr.settle(COGIRO.replace(linear_density=1e-15), POSE), "linear_density: found 1e-15 kg/m in cable 1"),
    (lambda: cdpr.release(cdpr.settle(ROPES, POSE)), HAS_MEMORY),
    (lambda: settled_in(TEXT, ROPES), HAS_MEMORY),
    (lambda: cdpr.settle(SHORT), TOO_SHORT),
    (lambda: cdpr.to_mjcf(SHORT), TOO_SHORT),
    (lambda: cdpr.settle_trajectory(SHORT), TOO_SHORT),
    (lambda: cdpr.solve(WHEELS, UNDER), IS_UNDER),
    (lambda: cdpr.settle(WHEELS, UNDER), IS_UNDER),
    (lambda: cdpr.shortfall(WHEELS, UNDER, tension_limits=(0, 100)), IS_UNDER),
    (lambda: cdpr.feasible(WHEELS, UNDER, tension_limits=(0, 100)), IS_UNDER),
    (lambda: cdpr.closed_form_feasible(WHEELS, UNDER, tension_limits=(0, 9)), IS_UNDER),
    (lambda: capacity_margin(WHEELS, UNDER, tension_limits=(0, 100)), IS_UNDER),
    (lambda: cdpr.solve(ON_A_WHEEL, (0.1, 0, 0.95)), "anchor of cable 1 inside its pulley's wheel"),
    (lambda: cdpr.solve(ON_A_WHEEL, (0.05, 0, 0.2)), "anchor of cable 1 inside or below its pulley's wheel"),
    (lambda: PLUMB.rest_lengths((0, 0, 1), [PLUMB.weight]),
     "tensions: found 13.61 N in cable 1, expected at most 13.6 N"),
    (lambda: cdpr.compensate(COGIRO.replace(axial_stiffness=20.0, stiffening=FALLING), POSE, tensions=(3.0, 9.0)),
     "tensions: found a smallest tension of 3 N in cable 1, .* 2.72 N"),
    (lambda: LONG.rest_lengths(LONG.home, tensions=700.0),
     r"tensions: found .* N in cable \d, under which the rope between"),
]  # fmt: skip
"""A call, and words of the sentence."""

FIELDS = [
    ({"winch_to_exit": 1e9}, "winch_to_exit: found 1e"),
    ({"reeving": 1.5}, "reeving: found 1.5 parts of line in cable 1, expected a whole number from 1 to 100"),
    ({"reeving": [1, 0] + [1] * 6}, "reeving: found 0 parts of line in cable 2, expected a whole number"),
    ({"reeving": 1000}, "reeving: found 1000 parts"),
]
"""Drive lines that cannot be."""

REFUSALS += [(lambda change=change: COGIRO.replace(**change), sentence) for change, sentence in FIELDS]


@pytest.mark.parametrize(("ask", "sentence"), REFUSALS)
def test_it_is_refused_in_one_sentence(ask, sentence):
    """With the field, what was found, and what is expected."""
    with pytest.raises(cdpr.InvalidInput, match=sentence) as refused:
        ask()
    assert "\n" not in str(refused.value)


def test_what_is_refused_of_one_problem_is_a_status_of_many_or_no_refusal_elsewhere():
    """A chain too short for its wheel is no obstacle to statics; a picture has no forces."""
    found = cdpr.settle_many(cdpr.Problems.stack([SHORT, SHORT]))
    assert (found.status == cdpr.Status.TOO_SHORT).all()
    assert np.isnan(found.positions).all()
    assert cdpr.solve(SHORT).stable
    assert cdpr.draw(ROPES).axes
    beside = COGIRO.replace(
        axial_stiffness=[2.0] * 7 + [1e3], linear_density=[0] * 7 + [5e-3], stiffening=[(8.0, -20.0)] * 7 + [(0, 0)]
    )
    with pytest.raises(cdpr.NotSettled, match=r"beyond the range of its nonlinear law \(cables 1, 4\)"):
        cdpr.settle(beside, (0.3, 0.25, 0.1))


@pytest.mark.parametrize("rigid", [0.0, 0.05])
def test_a_chain_may_be_as_short_as_its_refusal_says(rigid):
    """A cable with mass over a wheel, with and without a rigid end: 2 % less is refused, 2 % more is not."""
    robot = cdpr.load_robot("cogiro").replace(linear_density=0.05, pulley_radius=0.01, rigid_length=rigid)
    rest = robot.rest_lengths(robot.home)
    short = np.where(np.arange(8) == 2, 0.1, rest)
    with pytest.raises(cdpr.InvalidInput, match="its chain's first mass could touch the wheel") as refused:
        cdpr.to_mjcf(robot, robot.home, short)
    found = re.search(r"in cable 3, .* expected at least (\S+) m", str(refused.value))
    assert found is not None
    least = float(found[1])
    with pytest.raises(cdpr.InvalidInput, match="could touch the wheel"):
        cdpr.to_mjcf(robot, robot.home, np.where(np.arange(8) == 2, 0.98 * least, rest))
    assert cdpr.to_mjcf(robot, robot.home, np.where(np.arange(8) == 2, 1.02 * least, rest))

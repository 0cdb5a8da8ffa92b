"""Motions of robots whose ropes have a memory: the law in each time step, held tensions, and what controllers plan."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from test_track import ByTime

import cdpr_sim as cdpr

SHARE, WIDTH, FRICTION, BEHIND = 0.2, 0.3, 0.05, 0.5
HYSTERESIS = {"hysteresis": [(SHARE, np.inf, WIDTH)]}
RUBBING = {"winch_to_exit": BEHIND, "pulley_friction": FRICTION}

LAW = 1e-9
"""[N] Rounding of tensions: lengths are rounded to 1e-16 m, on cables of 1e4 N/m."""

SOFT = 0.04
"""EA as a fraction of DemoBot's: of ropes so soft the time step is as long as ``track`` takes it."""

AT_REST = 1e-9
"""[m] By which a platform moves that rests."""

OTHER_LENGTH = 2e-3
"""Strain of the plumb cable: with rope behind the exit, stiffness under a held tension is that of the rope's length
beyond the exit, under a held length that of the rest length."""

WEIGHT, LENGTH, STIFFNESS = 9.81, 2.0, 1e4
"""[N], [m], [N] Load, rest length and EA of the plumb cable."""


def swung(first: float, seconds: float) -> Callable[[float], np.ndarray]:
    """There, back and there again along 46 mm of the paper's line, smoothly; then at rest."""
    return lambda time: np.array([first - 0.023 * (1 - np.cos(3 * np.pi * min(time / seconds, 1.0))), 0.25, 0.1])


def moved(robot: cdpr.Robot, first: float, seconds: float, rest: float, **options) -> cdpr.Trajectory:
    poses = swung(first, seconds)
    winches = ByTime(lambda time: robot.rest_lengths(poses(time)), robot.rest_lengths(poses(0.0)))
    return cdpr.track(robot, [poses(0.0)], winches, seconds=seconds + rest, **options)


def pulled(motion: cdpr.Trajectory, width: float) -> np.ndarray:
    """Tensions of cables that are as long as in ``motion``, by one element of hysteresis: stop operators [N]."""
    strain, tensions = np.zeros(motion.robot.cables), []
    for length, rest in zip(motion.lengths, motion.rest_lengths, strict=True):
        e = np.maximum(length - rest, 0)
        held = np.clip(e - strain * rest, -width * e, width * e)
        strain = np.where(e > 0, (e - held) / rest, 0)
        tensions.append(motion.robot.axial_stiffness / rest * ((1 - SHARE) * e + SHARE * held))
    return np.array(tensions)


def rubbed(motion: cdpr.Trajectory, c: float) -> np.ndarray:
    """The same by friction at the exit: the point of the rope there stays, or follows a limit [N]."""
    rho, out, tensions = (1 + c / 2) / (1 - c / 2), None, []
    for length, rest in zip(motion.lengths, motion.rest_lengths, strict=True):
        e = np.maximum(length - rest, 0)
        low, middle, high = (rest + x * BEHIND * e / (rest + x * BEHIND) for x in (1 / rho, 1.0, rho))
        out = middle if out is None else np.clip(out, low, high)
        tensions.append(motion.robot.axial_stiffness / rest * np.maximum(length - out, 0))
    return np.array(tensions)


@pytest.mark.parametrize(("name", "first"), [("cogiro", 0.308), ("parallel", 0.354)])
@pytest.mark.parametrize(
    ("changes", "law", "value"), [(HYSTERESIS, pulled, WIDTH), (RUBBING, rubbed, FRICTION)], ids=["loop", "friction"]
)
def test_tensions_are_those_of_the_lengths_so_far(name, first, changes, law, value):
    """A state for each time step: the law along the recorded lengths gives the recorded tensions, slack included.

    No cable pushes. With a width, or a friction, that is 1 % larger the tensions are others.
    """
    robot = cdpr.load_robot(name).replace(**changes)
    motion = moved(robot, first, 0.06, 0.06, rate=4000.0, cable_damping=0.0)
    np.testing.assert_allclose(motion.tensions, law(motion, value), rtol=0, atol=LAW)
    assert (motion.tensions >= 0).all()
    assert (motion.tensions == 0).any()
    assert np.abs(motion.tensions - law(motion, 1.01 * value)).max() > 1e5 * LAW


def plumb(**changes) -> cdpr.Robot:
    """A weight on a single plumb cable of 2 m, in a plane."""
    given = dict(exits=[[0, 0, 3.0]], anchors=[[0, 0, 0]], axial_stiffness=STIFFNESS, mass=WEIGHT / 9.81, name="plumb")
    given |= dict(center_of_mass=[0, 0, -0.1], platform_size=[0.1] * 3, workspace=[[-1, -1, 0], [1, 1, 2]])
    return cdpr.Robot(**given | changes)


def pulling(tension: Callable[[float], float]) -> ByTime:
    """A winch that holds a tension after the plumb cable's length."""
    first, held = np.array([LENGTH]), np.array([True])
    return ByTime(lambda time: cdpr.Command(first, np.array([tension(time)]), held), first)


@pytest.mark.parametrize("behind", [0.0, 1.5])
def test_a_held_tension_arrives_less_or_more_friction(behind):
    """Between T/rho and rho T the weight is held by a rope that sticks; beyond, it is pulled with T/rho or rho T."""
    c = 0.1
    robot, rho = plumb(pulley_friction=c, winch_to_exit=behind), (1 + c / 2) / (1 - c / 2)

    def under(tension: float) -> cdpr.Trajectory:
        return cdpr.track(robot, [[0, 0, 1.0]], pulling(lambda time: tension), seconds=0.15, damping=0.0)

    for tension in (0.95 * WEIGHT, 1.05 * WEIGHT):
        still = under(tension)
        most = OTHER_LENGTH * np.ptp([LENGTH, still.lengths[0, 0]]) if behind else AT_REST
        assert np.abs(still.positions - still.positions[0]).max() < most
        np.testing.assert_allclose(still.tensions[:, 0], WEIGHT, rtol=OTHER_LENGTH if behind else 1e-6)
    for tension, arrives in ((1.2 * WEIGHT, 1.2 * WEIGHT / rho), (0.8 * WEIGHT, 0.8 * WEIGHT * rho)):
        moving = under(tension)
        np.testing.assert_allclose(moving.tensions[2:, 0], arrives, rtol=1e-9)
        rise = (arrives / WEIGHT - 1) * 9.81 * moving.times[-1] ** 2 / 2
        np.testing.assert_allclose(moving.positions[-1, 2] - moving.positions[0, 2], rise, rtol=0.05)
        wound = moving.rest_lengths[-1, 0] - moving.rest_lengths[0, 0]
        np.testing.assert_allclose(wound, -rise, rtol=0.05)


def test_a_held_tension_moves_the_memory_of_its_rope():
    """A rope that is pulled with 9 N after 2 N, and again after 12 N, is then stretched further, by its loop."""
    robot, tensions = plumb(hysteresis=[(0.3, np.inf, 0.5)], creep=[(4e4, 1e3)]), np.array([2.0, 9.0, 12.0, 9.0])
    winches = pulling(lambda time: tensions[round(100 * time) - 1])
    motion = cdpr.track(robot, [[0, 0, 1.0]], winches, seconds=0.04, damping=0.0, cable_damping=0.0)
    np.testing.assert_allclose(motion.tensions[1:, 0], tensions, rtol=1e-9)
    strains = (motion.lengths / motion.rest_lengths - 1)[1:, 0]
    assert strains[3] - strains[1] > 5e-6
    elastic = cdpr.track(plumb(), [[0, 0, 1.0]], winches, seconds=0.04, damping=0.0, cable_damping=0.0)
    strains = (elastic.lengths / elastic.rest_lengths - 1)[1:, 0]
    np.testing.assert_allclose(strains, tensions / STIFFNESS, rtol=1e-6)


@pytest.mark.parametrize(
    "controller", [cdpr.ElasticLengths, cdpr.HeldTensions, cdpr.LengthsAndTensions], ids=lambda one: one.__name__
)
def test_controllers_plan_with_the_elastic_robot(controller):
    """For a robot whose cables have a memory, and for the same robot with elastic cables, they command the same."""
    elastic = cdpr.load_robot("cogiro")
    elastic = elastic.replace(axial_stiffness=SOFT * elastic.axial_stiffness, winch_to_exit=BEHIND)
    robot = elastic.replace(**HYSTERESIS | RUBBING, creep=[(4e5, 600.0)])
    options: dict[str, Any] = dict(seconds=0.05, rate=100.0)
    planned, plain = (cdpr.track(robot, [[0.3, 0.25, 0.1]], controller(one), **options) for one in (robot, elastic))
    np.testing.assert_array_equal(planned.rest_lengths, plain.rest_lengths)
    np.testing.assert_array_equal(planned.positions, plain.positions)

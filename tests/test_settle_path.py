"""Cables with a memory in MuJoCo: its own slow winding, stiffness, and what no cable does."""

from __future__ import annotations

import itertools

import mujoco
import numpy as np
import pytest
from slow_winding import Winding
from test_track_of_ropes import LENGTH, STIFFNESS, WEIGHT, plumb

import cdpr_sim as cdpr
from cdpr_sim.core.status import Status
from cdpr_sim.learning.tasks import Task
from cdpr_sim.physics.rope_memory import RopeStep

AGREE = 1e-9
"""[m] Between equilibria of the same path; settling ends within 1e-9 of the load, 1e-10 m where a cable is nearly
slack."""

SLOW, FIRST_ORDER = 4e-6, 0.4
"""[m] Winding in time steps is first order in them: with 256 and 1024 for 23 mm, 6.4 and 1.4 micrometres on cogiro,
10.6 and 2.6 on parallel; the second is this fraction of the first, or less."""

SEEN = 1e-7
"""[m] Least effect of a memory that is wrong by 1 %."""

ELEMENTS = [(0.1, 5e-5), (0.1, np.inf, 0.3)]
"""Of hysteresis: one that yields within DemoBot's strains, and one with a width in proportion to the tension."""

LINE = np.linspace([0.17, 0.25, 0.1], [0.63, 0.25, 0.1], 7)
"""The paper's line."""


@pytest.mark.parametrize(("name", "first", "slack"), [("cogiro", 0.308, 0), ("parallel", 0.354, 4)])
def test_mujoco_alone_winds_slowly_to_the_same_equilibria(name, first, slack):
    """Its own springs slide while the winches turn in small steps of time, and with smaller ones come nearer.

    What is held is so what MuJoCo does. Only the bound of the elements is set from outside, and winding moves what they
    remember, a strain. On ``parallel``, cables get slack and taut again. At rest nothing slides: 1e-9 m in ten seconds.
    """
    robot = cdpr.load_robot(name).replace(hysteresis=[(0.2, np.inf, 0.3)])
    path = np.array([[first + step * 0.023, 0.25, 0.1] for step in (0, -1, -2, -1, 0)])
    held = cdpr.settle_path(robot, path, steps=8)
    assert held.slack.sum(1).max() == slack
    begun, apart = cdpr.settle_path(robot, path[:1]), []
    for count in (256, 1024):
        winding = Winding(robot, begun)
        found = np.array([winding.wind(*ends, count) for ends in itertools.pairwise(path)])
        apart.append(np.linalg.norm(found - held.positions[1:], axis=1).max())
    assert apart[1] < min(SLOW, FIRST_ORDER * apart[0])
    stayed = winding.stay(int(10 / winding.model.opt.timestep))
    assert np.linalg.norm(stayed - found[-1]) < AGREE
    elastic = cdpr.settle_many(robot.replace(hysteresis=()), path)
    assert np.linalg.norm(elastic.positions - held.positions, axis=1).max() > 2 * apart[1]


def test_no_cable_pushes(monkeypatch):
    """A cable that is let out until it is slack; without the bound by its own stretch it would push before."""
    robot = cdpr.load_robot("cogiro").replace(hysteresis=[(0.3, 2e-5)])
    rest = np.tile(robot.rest_lengths(robot.home), (40, 1))
    rest[:, 0] += np.linspace(0, 3e-4, 40)
    poses = np.tile(robot.home, (40, 1))
    path = cdpr.settle_path(robot, poses, rest)
    assert (path.tensions >= 0).all()
    assert path.slack[-1, 0]
    assert path.memory.strains[0, 0] == 0
    assert not path.slack[0, 0]
    monkeypatch.setattr(RopeStep, "bounds", lambda self, stretches: np.broadcast_to(self.yields, self.elements.shape))
    assert cdpr.settle_path(robot, poses, rest).tensions.min() < -1e-4


def test_stiffness_is_that_of_what_slides_and_what_sticks():
    """Of the plumb cable: elements slide; with a little less load all stick; some slide back; the same with creep."""
    modulus, elapsed = 4e4, 1.0
    robot = plumb(hysteresis=[(0.2, 1e-4), (0.1, np.inf, 0.25)], creep=[(modulus, 60.0)])
    loads, wrench = np.array([9.0, 8.99, 3.0, 2.9]), np.zeros((4, 6))
    wrench[:, 2] = WEIGHT - loads
    options = dict(external_wrench=wrench, times=[0, 0, 0, 60 * elapsed])
    path = cdpr.settle_path(robot, np.tile([0, 0, 3 - LENGTH], (4, 1)), **options)
    np.testing.assert_allclose(path.tensions[:, 0], loads, rtol=0, atol=1.1e-9 * WEIGHT)
    slopes = np.array([0.7 + 0.1 * 0.25, 1.0, 0.7 - 0.1 * 0.25, 0.7 - 0.1 * 0.25])
    growing = 1 - (1 - np.exp(-elapsed)) / elapsed
    slopes[3] /= 1 + slopes[3] * STIFFNESS / modulus * growing
    np.testing.assert_allclose(path.eigenvalues[:, -1], STIFFNESS / LENGTH * slopes, rtol=1e-6)


def test_paths_side_by_side_are_those_of_each_alone_and_end_alone():
    """Of three paths one has no equilibrium in its second step: it ends there, and the others do not notice."""
    robot = cdpr.load_robot("parallel").replace(hysteresis=ELEMENTS, winch_to_exit=0.5, pulley_friction=0.05)
    paths = np.stack([LINE, LINE + np.array([0, 0, 0.1]), LINE[::-1]], axis=1)[:4]
    paths[1, 1, 2] = 3.0
    found = cdpr.settle_path(robot, paths)
    assert found.status[:, 1].tolist() == [Status.CONVERGED, Status.FALLS, Status.FALLS, Status.FALLS]
    assert np.isnan(found.memory.tensions).all(-1).tolist() == [False, True, False]
    for one in (0, 2):
        alone = cdpr.settle_path(robot, paths[:, one])
        np.testing.assert_allclose(found.positions[:, one], alone.positions, rtol=0, atol=AGREE)
        np.testing.assert_allclose(found.memory.beyond[one], alone.memory.beyond, rtol=0, atol=AGREE)
    with pytest.raises(cdpr.NotSettled):
        found[1, 1]
    with pytest.raises(cdpr.InvalidInput, match="without an equilibrium at its end"):
        cdpr.settle_path(robot, paths[2:], memory=found.memory)


def test_one_equilibrium_is_the_first_of_a_path():
    """``settle`` and ``settle_many`` start from new ropes; robots without memory have paths too."""
    for changes in (dict(hysteresis=ELEMENTS, winch_to_exit=0.5, pulley_friction=0.05), dict(stiffening=(20, 0))):
        robot = cdpr.load_robot("cogiro").replace(**changes)
        path = cdpr.settle_path(robot, LINE)
        one, many = cdpr.settle(robot, LINE[0]), cdpr.settle_many(robot, LINE)
        np.testing.assert_allclose(one.position, path.positions[0], rtol=0, atol=1e-12)
        np.testing.assert_allclose(many.positions[0], path.positions[0], rtol=0, atol=1e-12)
        apart = np.linalg.norm(many.positions - path.positions, axis=1).max()
        assert apart > SEEN if "hysteresis" in changes else apart < AGREE
        np.testing.assert_array_equal(path.memory.tensions, path.tensions[-1])


def test_what_does_not_know_memory_refuses_it():
    """In one sentence: models would push where cables get slack, and motions would have another memory."""
    robot = cdpr.load_robot("cogiro").replace(hysteresis=ELEMENTS)
    elastic = robot.replace(hysteresis=())
    model = mujoco.MjModel.from_xml_string(cdpr.to_mjcf(elastic, elastic.home))
    found, moved = cdpr.settle(robot, robot.home), [robot.home, LINE[0]]
    refusals = {
        "to_mjcf": lambda: cdpr.to_mjcf(robot, robot.home),
        "drive": lambda: cdpr.drive(robot, moved),
        "release": lambda: cdpr.release(found),
        "a winch in MuJoCo": lambda: cdpr.winch_controls(robot, robot.home, found.rest_lengths),
        "model": lambda: cdpr.settle(robot, robot.home, model=model),
        "cdpr_sim.learning": lambda: Task(robot),
    }
    for refused in refusals.values():
        with pytest.raises(cdpr.InvalidInput, match=r"^robot: found hysteresis in cable 1, expected") as caught:
            refused()
        assert "\n" not in str(caught.value)
    assert cdpr.draw(robot).axes  # a picture has no forces

"""Cables with a memory in MuJoCo: the path of statics, its own slow winding, stiffness, and what no cable does."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from slow_winding import Winding

import cdpr_sim as cdpr
from cdpr_sim.core.status import Status
from cdpr_sim.physics.rope_memory import RopeStep
from cdpr_sim.report.robot_summary import settled_along, solved_along

AGREE = 1e-9
"""[m] Farthest anchor, between equilibria of the same path; settling ends within 1e-9 of the load. Measured: 4e-13 m on
cogiro, 8e-11 on parallel, 2e-11 on the crane and on ipanema-1."""

SLOW, FIRST_ORDER = 4e-6, 0.4
"""[m] Winding in time steps is first order in them: with 256 and 1024 for 23 mm, 6.4 and 1.4 micrometres on cogiro,
10.6 and 2.6 on parallel; the second is this fraction of the first, or less."""

SEEN = 1e-7
"""[m] Least effect of a memory."""

ELEMENTS = [(0.1, 5e-5), (0.1, np.inf, 0.3)]
"""Of hysteresis: one that yields within DemoBot's strains, and one with a width in proportion to the tension."""

CREEP = [(4e4, 600.0), (2e4, 60.0)]
MEMORY = dict(hysteresis=ELEMENTS, winch_to_exit=0.5, pulley_friction=0.05, creep=CREEP)
CRANE = dict(hysteresis=[(0.1, 3e-4), (0.1, np.inf, 0.3)], winch_to_exit=6.0, pulley_friction=0.05)
HEAVY = CRANE | dict(creep=[(4e6, 60.0)], pulley_radius=0.1, linear_density=0.064)
LAW = {"stiffening": (100.0, 2e4)}

SOME = dict(
    hysteresis=[ELEMENTS, [], ELEMENTS, []] * 2, pulley_friction=[0.05, 0.0, 0.05, 0.0] * 2,
    creep=[CREEP, [], [], []] * 2, winch_to_exit=0.5, stiffening=[(0, 0), (0, 0), (100, 2e4), (100, 2e4)] * 2,
    pulley_radius=[0.0, 0.01] * 4,
)  # fmt: skip
"""Of DemoBot: each mixture of a memory, a law and a wheel on another cable."""

LINE = np.linspace([0.17, 0.25, 0.1], [0.63, 0.25, 0.1], 9)
"""The paper's line."""


def there_and_back(robot: cdpr.Robot, every: int) -> np.ndarray:
    """The paper's line, or one of its kind across another robot's workspace, and back."""
    line = LINE
    if robot.name not in ("cogiro", "parallel"):
        line = robot.home + np.linspace(-0.3, 0.3, 9)[:, None] * [np.ptp(robot.workspace[:, 0]), 0, 0]
    return np.concatenate([line, line[-2::-1]])[::every]


def apart(one: cdpr.EquilibriumPath, other: cdpr.EquilibriumPath) -> float:
    """Largest distance of the same anchor [m]."""
    ends = [path.positions[:, None] + path.robot.anchors @ np.swapaxes(path.rotations, 1, 2) for path in (one, other)]
    return float(np.linalg.norm(ends[0] - ends[1], axis=-1).max())


@pytest.mark.parametrize(
    ("name", "changes", "slack"),
    [
        ("parallel", MEMORY, True),
        ("ipanema-1", CRANE, True),
        ("cogiro-crane", CRANE | dict(reeving=2), False),
        ("cogiro", SOME, False),
        ("cogiro", SOME | dict(linear_density=[5e-4, 5e-4, 0, 5e-4, 0, 0, 0, 0]), False),
        ("cogiro-crane", HEAVY | LAW | dict(hysteresis=()), False),
        ("cogiro", dict(linear_density=5e-4, pulley_radius=0.01, winch_to_exit=0.5) | LAW, False),
    ],
    ids=["slack", "slack, tight", "reeved crane", "each another kind", "some with mass", "nonlinear, mass", "elastic"],
)
def test_both_methods_come_to_the_same_equilibria_there_and_back(name, changes, slack):
    """With a memory, a command leads elsewhere on the way back; resumed from the other method's memory, to the same."""
    robot = cdpr.load_robot(name).replace(**changes)
    path = there_and_back(robot, every=2 if robot.cabling.linear and robot.cabling.massless else 4)
    times = 10.0 * np.arange(len(path))
    solved, settled = cdpr.solve_path(robot, path, times=times), cdpr.settle_path(robot, path, times=times)
    assert solved.converged.all()
    assert settled.converged.all()
    assert apart(solved, settled) < AGREE
    assert settled.slack.any() == slack
    loop = np.linalg.norm(settled.positions - settled.positions[::-1], axis=1).max()
    assert loop > 100 * AGREE if "pulley_friction" in changes else loop < AGREE
    assert all(cdpr.compare(*both).agrees for both in zip(solved, settled, strict=True))
    first = cdpr.settle(robot, path[0]), cdpr.settle_many(robot, path[:2])[0]
    assert max(np.abs(one.position - settled.positions[0]).max() for one in first) < AGREE
    later = times[:2] + times[-1]  # resumed from the other's memory
    again = cdpr.settle_path(robot, path[:2], times=later, memory=solved.memory)
    assert apart(again, cdpr.solve_path(robot, path[:2], times=later, memory=settled.memory)) < AGREE


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
    begun, far = cdpr.settle_path(robot, path[:1]), []
    for count in (256, 1024):
        winding = Winding(robot, begun)
        found = np.array([winding.wind(*ends, count) for ends in itertools.pairwise(path)])
        far.append(np.linalg.norm(found - held.positions[1:], axis=1).max())
    assert far[1] < min(SLOW, FIRST_ORDER * far[0])
    stayed = winding.stay(int(10 / winding.model.opt.timestep))
    assert np.linalg.norm(stayed - found[-1]) < AGREE
    elastic = cdpr.settle_many(robot.replace(hysteresis=()), path)
    assert np.linalg.norm(elastic.positions - held.positions, axis=1).max() > 2 * far[1]


def test_no_cable_pushes(monkeypatch):
    """A cable that is let out until it is slack; without the bound by its own stretch it would push before."""
    robot = cdpr.load_robot("cogiro").replace(hysteresis=[(0.3, 2e-5)])
    rest = np.tile(robot.rest_lengths(robot.home), (40, 1))
    rest[:, 0] += np.linspace(0, 3e-4, 40)
    poses = np.tile(robot.home, (40, 1))
    path = cdpr.settle_path(robot, poses, rest)
    assert (path.tensions >= 0).all()
    assert path.slack[[0, -1], 0].tolist() == [False, True]
    assert path.memory.strains[0, 0] == 0
    monkeypatch.setattr(RopeStep, "bounds", lambda self, stretches: np.broadcast_to(self.yields, self.elements.shape))
    assert cdpr.settle_path(robot, poses, rest).tensions.min() < -1e-4


def test_stiffness_is_that_of_what_slides_and_what_sticks():
    """Of the plumb cable: elements slide; with a little less load all stick; some slide back; the same with creep."""
    modulus, elapsed, weight, length, stiffness = 4e4, 1.0, 9.81, 2.0, 1e4
    ropes = dict(hysteresis=[(0.2, 1e-4), (0.1, np.inf, 0.25)], creep=[(modulus, 60.0)])
    robot = cdpr.Robot([[0, 0, 3.0]], [[0, 0, 0]], stiffness, 1.0, platform_size=[0.1] * 3, **ropes)
    loads, wrench = np.array([9.0, 8.99, 3.0, 2.9]), np.zeros((4, 6))
    wrench[:, 2] = weight - loads
    options = dict(external_wrench=wrench, times=[0, 0, 0, 60 * elapsed])
    path = cdpr.settle_path(robot, np.tile([0, 0, 3 - length], (4, 1)), **options)
    np.testing.assert_allclose(path.tensions[:, 0], loads, rtol=0, atol=1.1e-9 * weight)
    slopes = np.array([0.7 + 0.1 * 0.25, 1.0, 0.7 - 0.1 * 0.25, 0.7 - 0.1 * 0.25])
    growing = 1 - (1 - np.exp(-elapsed)) / elapsed
    slopes[3] /= 1 + slopes[3] * stiffness / modulus * growing
    np.testing.assert_allclose(path.eigenvalues[:, -1], stiffness / length * slopes, rtol=1e-6)


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


def test_check_and_video_follow_a_path():
    """``check`` along poses, and the states of a video."""
    robot = cdpr.load_robot("cogiro").replace(**MEMORY)
    path = there_and_back(robot, every=4)
    checked = cdpr.check(robot, poses=path)
    assert checked.agrees
    assert np.isnan(checked.dataset["static_in_mujoco"]).all()
    one_by_one = cdpr.settle_many(robot, path)
    assert np.linalg.norm(one_by_one.positions - cdpr.settle_path(robot, path).positions, axis=1).max() > SEEN
    motion = settled_along(robot, path, 60.0)
    np.testing.assert_allclose(solved_along(motion).positions, motion.positions, rtol=0, atol=AGREE)

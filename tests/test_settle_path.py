"""Cables with a memory in MuJoCo: closed forms, MuJoCo's own slow winding, and what no cable does."""

from __future__ import annotations

import itertools

import mujoco
import numpy as np
import pytest
from slow_winding import Winding

import cdpr_sim as cdpr
from cdpr_sim.core.status import Status
from cdpr_sim.learning.tasks import Task
from cdpr_sim.physics.rope_memory import RopeStep

WEIGHT, LENGTH, STIFFNESS = 9.81, 2.0, 1e4
"""[N], [m], [N] Load, rest length and EA of the plumb cable."""

STOPPED = 1e-11
"""[m] Settling ends within 1e-9 of the weight; a cable that slides is half as stiff as EA/l0."""

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
"""The paper's line; there and back:"""

CYCLE = np.concatenate([LINE, LINE[-2::-1]])


def plumb(**changes) -> cdpr.Robot:
    """A weight on a single plumb cable of 2 m."""
    given = dict(exits=[[0, 0, 3.0]], anchors=[[0, 0, 0]], axial_stiffness=STIFFNESS, mass=WEIGHT / 9.81, name="plumb")
    return cdpr.Robot(**given | dict(center_of_mass=[0, 0, -0.1], platform_size=[0.1] * 3) | changes)


def loaded(robot: cdpr.Robot, loads: np.ndarray, **options) -> tuple[np.ndarray, object]:
    """Stretches [m] of the plumb cable under these loads [N] one after another."""
    wrench = np.zeros((len(loads), 6))
    wrench[:, 2] = WEIGHT - loads
    path = cdpr.settle_path(robot, np.tile([0, 0, 3 - LENGTH], (len(loads), 1)), external_wrench=wrench, **options)
    assert (path.status == Status.CONVERGED).all()
    np.testing.assert_allclose(path.tensions[:, 0], loads, rtol=0, atol=1.1e-9 * WEIGHT)
    return path.lengths[:, 0] - LENGTH, path


def returned(robot: cdpr.Robot, stretches: list[float], start: float) -> list[float]:
    """Loads of the plumb cable that is stretched from ``start`` to one of ``stretches`` [m] after the other."""
    state = [0.0] * len(robot.hysteresis[0])
    loads = []
    for e in [start, *stretches]:
        pull = (1 - robot.hysteresis[0, :, 0].sum()) * e
        for j, (share, strain, width) in enumerate(robot.hysteresis[0]):
            bound = min(strain * LENGTH, width * e)
            held = min(max(e - state[j], -bound), bound)
            state[j], pull = e - held, pull + share * held
        loads.append(pull * STIFFNESS / LENGTH)
    return loads


def test_a_plumb_cable_follows_its_elements():
    """Loads that a calculation by hand gives for a sequence of stretches give these stretches back."""
    robot = plumb(hysteresis=[(0.2, 4e-4), (0.1, np.inf, 0.25)])
    stretches = [1e-3, 2e-3, 1.7e-3, 1.2e-3, 1.9e-3, 0.4e-3, 2.5e-3]
    loads = np.array(returned(robot, stretches[1:], stretches[0]))
    found, _ = loaded(robot, loads)
    np.testing.assert_allclose(found, stretches, rtol=0, atol=STOPPED)
    wrong, _ = loaded(robot.replace(hysteresis=[(0.2, 1.01 * 4e-4), (0.1, np.inf, 0.25)]), loads)
    assert np.abs(wrong - stretches).max() > SEEN


def test_friction_holds_a_plumb_weight_within_its_band():
    """Loading and unloading end at the two ends of the band, e = T (l0 + x g)/EA; a small change in it is elastic."""
    c, behind = 0.1, 1.5
    robot, rho = plumb(pulley_friction=c, winch_to_exit=behind), (1 + c / 2) / (1 - c / 2)
    found, path = loaded(robot, np.array([5.0, 10.0, 9.9, 5.0, 10.0]))
    out, back = (LENGTH + behind / rho) / STIFFNESS, (LENGTH + behind * rho) / STIFFNESS
    expected = [5 * (LENGTH + behind) / STIFFNESS, 10 * out, 10 * out - 0.1 * LENGTH / STIFFNESS, 5 * back, 10 * out]
    np.testing.assert_allclose(found, expected, rtol=0, atol=STOPPED)
    np.testing.assert_allclose(path.memory.beyond, LENGTH + 10 * behind / rho / STIFFNESS - 0, rtol=0, atol=1e-5)
    wrong, _ = loaded(robot.replace(pulley_friction=1.01 * c), np.array([5.0, 10.0]))
    assert abs(wrong[1] - found[1]) > SEEN


def test_creep_is_the_exponential():
    """Under a constant load e(t) = T l0 (1/EA + Σ (1 − exp(−t/tau))/EA1), in whatever steps; removed, it recovers."""
    modulus, tau = np.array([4e4, 2e4]), np.array([60.0, 600.0])
    robot = plumb(creep=list(zip(modulus, tau, strict=True)))
    times = np.array([0.0, 5, 5, 60, 2000])
    found, path = loaded(robot, np.full(5, WEIGHT), times=times)
    strain = 1 / STIFFNESS + ((1 - np.exp(-times[:, None] / tau)) / modulus).sum(-1)
    np.testing.assert_allclose(found, WEIGHT * LENGTH * strain, rtol=0, atol=2 * STOPPED)
    assert path.memory.time == 2000
    less, _ = loaded(robot, np.array([1.0, 1.0]), times=[2000, 2e5], memory=path.memory)
    assert less[1] < less[0] - 1e-4
    np.testing.assert_allclose(less[1], LENGTH * (1 / STIFFNESS + (1 / modulus).sum()), rtol=0, atol=1e-9)


def test_creep_in_series_with_elements_is_in_equilibrium_with_both():
    """Strains of creep and of the elements add up, at the tension of the end of the step, within and at the bounds."""
    robot = plumb(hysteresis=[(0.2, 2e-4), (0.1, np.inf, 0.25)], creep=[(4e4, 60.0)])
    loads, times = np.array([4.0, 9.0, 9.0, 3.0, 3.0, 8.0]), np.array([0, 0, 30, 40, 500, 510.0])
    found, _ = loaded(robot, loads, times=times)
    crept, before, elastic = 0.0, 0.0, []
    for load, step in zip(loads, np.diff(times, prepend=0.0), strict=True):
        left = np.exp(-step / 60)
        mean = (1 - left) / (step / 60) if step else 1.0
        crept = left * crept + ((mean - left) * before + (1 - mean) * load) / 4e4
        before = load
        elastic.append(LENGTH * crept)
    np.testing.assert_allclose(returned(robot, list(found - elastic)[1:], float(found[0])), loads, rtol=1e-8)


@pytest.mark.parametrize(("name", "first", "slack"), [("cogiro", 0.308, 0), ("parallel", 0.354, 4)])
def test_mujoco_alone_winds_slowly_to_the_same_equilibria(name, first, slack):
    """Its own springs slide while the winches turn in small steps of time, and with smaller ones come nearer.

    What is held is so what MuJoCo does. Only the bound of the elements is set from outside, and winding moves what they
    remember, a strain. On ``parallel``, cables get slack and taut again. At rest nothing slides: 1e-9 m in a minute.
    """
    robot = cdpr.load_robot(name).replace(hysteresis=[(0.2, np.inf, 0.3)])
    path = np.array([[first + step * 0.023, 0.25, 0.1] for step in (0, -1, -2, -1, 0)])
    held = cdpr.settle_path(robot, path, steps=64)
    assert held.slack.sum(1).max() == slack
    begun, apart = cdpr.settle_path(robot, path[:1]), []
    for count in (256, 1024):
        winding = Winding(robot, begun)
        found = np.array([winding.wind(*ends, count) for ends in itertools.pairwise(path)])
        apart.append(np.linalg.norm(found - held.positions[1:], axis=1).max())
    assert apart[1] < min(SLOW, FIRST_ORDER * apart[0])
    stayed = winding.stay(int(60 / winding.model.opt.timestep))
    assert np.linalg.norm(stayed - found[-1]) < AGREE
    elastic = cdpr.settle_many(robot.replace(hysteresis=()), path)
    assert np.linalg.norm(elastic.positions - held.positions, axis=1).max() > 2 * apart[1]


def test_no_cable_pushes(monkeypatch):
    """A cable that is let out until it is slack; without the bound by its own stretch it would push before."""
    robot = cdpr.load_robot("cogiro").replace(hysteresis=[(0.3, 2e-5)])
    rest = np.tile(robot.rest_lengths(robot.home), (60, 1))
    rest[:, 0] += np.linspace(0, 3e-4, 60)
    poses = np.tile(robot.home, (60, 1))
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
    _, path = loaded(robot, np.array([9.0, 8.99, 3.0, 2.9]), times=[0, 0, 0, 60 * elapsed])
    slopes = np.array([0.7 + 0.1 * 0.25, 1.0, 0.7 - 0.1 * 0.25, 0.7 - 0.1 * 0.25])
    growing = 1 - (1 - np.exp(-elapsed)) / elapsed
    slopes[3] /= 1 + slopes[3] * STIFFNESS / modulus * growing
    np.testing.assert_allclose(path.eigenvalues[:, -1], STIFFNESS / LENGTH * slopes, rtol=1e-6)


def test_a_path_goes_on_from_its_memory():
    """In two parts as in one; from a memory that is 1 % wrong it goes elsewhere."""
    robot = cdpr.load_robot("parallel").replace(hysteresis=ELEMENTS, winch_to_exit=0.5, pulley_friction=0.05)
    whole = cdpr.settle_path(robot, CYCLE)
    first = cdpr.settle_path(robot, CYCLE[:9])
    second = cdpr.settle_path(robot, CYCLE[9:], memory=first.memory)
    np.testing.assert_allclose(second.positions, whole.positions[9:], rtol=0, atol=AGREE)
    np.testing.assert_allclose(second.memory.strains, whole.memory.strains, rtol=0, atol=AGREE)
    np.testing.assert_allclose(second.memory.beyond, whole.memory.beyond, rtol=0, atol=AGREE)
    assert np.linalg.norm(cdpr.settle_path(robot, CYCLE[9:]).positions - second.positions, axis=1).max() > 10 * SEEN


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


def test_small_steps_change_nothing_where_loads_grow_and_shrink():
    """More steps between loads that the path goes through anyway: the same stretches, whatever the elements."""
    robot = plumb(hysteresis=ELEMENTS, winch_to_exit=1.0, pulley_friction=0.05)
    loads = np.array([5.0, 9.0, 4.0, 7.0])
    few, _ = loaded(robot, loads)
    many, _ = loaded(robot, loads, steps=7)
    np.testing.assert_allclose(many, few, rtol=0, atol=2 * STOPPED)


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
    for name, refused in refusals.items():
        with pytest.raises(cdpr.InvalidInput, match=f"^{name}: found hysteresis in cable 1, expected") as caught:
            refused()
        assert "\n" not in str(caught.value)
    assert cdpr.draw(robot).axes  # a picture has no forces

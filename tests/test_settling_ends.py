"""Settling of cables with mass ends: bounds, a line that says how far it is, Ctrl-C; and folded chains take no time."""

import contextlib
import re
import signal

import numpy as np
import pytest

import cdpr_sim as cdpr
from cdpr_sim.physics.dynamic_relaxation import Relaxation
from cdpr_sim.physics.sagging import chain_relaxation
from cdpr_sim.physics.sagging.approach import SHORTER
from cdpr_sim.physics.sagging.chain_relaxation import ChainRelaxation
from cdpr_sim.physics.sagging.stepping import Stepping

SOLVES = 1000
"""Systems of equations that settling the folded chain below takes at most: 65 measured. With Newton's method sought in
vain for the pulls of a folded chain there were 13,604; with three nudges for the error of a free rotation, 1,830."""


@pytest.fixture
def beside_a_folded_chain() -> cdpr.Problem:
    """A mass on a cable with nonlinear elasticity, beside five metres of slack cable."""
    robot = cdpr.Robot(
        exits=[[0, 0, 1], [0.3, 0, 1]],
        anchors=[[0, 0, 0], [0, 0, 0]],
        platform_size=(0.05, 0.05, 0.05),
        axial_stiffness=[1e3, 1e5],
        stiffening=[(50, 0), (0, 0)],
        linear_density=[0, 1e-3],
        mass=1.0,
        name="beside a slack cable",
    )
    return cdpr.Problem.of(robot, (0, 0, 0.3), [0.69, 5.0])


def test_a_folded_chain_takes_no_newton_steps(beside_a_folded_chain, monkeypatch):
    """Nothing pulls one of its segments, and no pulls are sought: it rests where the tension and half its weight do."""
    solves, solve = [], np.linalg.solve
    monkeypatch.setattr(np.linalg, "solve", lambda a, b: (solves.append(0), solve(a, b))[1])
    settled = cdpr.settle(beside_a_folded_chain)
    assert len(solves) < SOLVES
    weights = beside_a_folded_chain.robot.weight + 5.0 * 1e-3 * 9.81 * np.array([0, 1])
    assert weights[0] < settled.tensions[0] < weights[1]
    strain = settled.lengths[0] / 0.69 - 1
    assert settled.tensions[0] == pytest.approx(1e3 * (strain + 50 * strain**2), rel=1e-6)


@pytest.mark.parametrize(("density", "size"), [(0.0, 0.05), (0.0, 0.01), (0.05, 0.05)])
def test_a_free_rotation_beside_stiff_directions_is_neutral(density, size, monkeypatch):
    """Anchors on a line across the axes, far below the exits: it rotates about that line, and nothing nudges it."""
    line = size * np.array([1, 1, 0.3])
    robot = cdpr.Robot(
        exits=[[-11, -9, 10], [10, -10, 9], [9, 10, 11], [-10, 11, 10]],
        anchors=[-line, line, line, -line],
        platform_size=(size, size, size),
        axial_stiffness=1e4,
        linear_density=density,
        mass=1.0,
        name="bar",
    )
    for relaxation in (ChainRelaxation, Relaxation):
        monkeypatch.setattr(relaxation, "nudge", lambda *_: pytest.fail("it was nudged"))
    settled = cdpr.settle(robot, (0, 0, 0))
    assert settled.stability is cdpr.Stability.NEUTRAL
    assert settled.eigenvalues[0] == 0 < settled.eigenvalues[1]


def test_settling_ends_at_its_bounds_in_a_sentence(beside_a_folded_chain, monkeypatch):
    """Time steps, and steps that are tried near rest: whichever are used up, ``NotSettled`` carries the last state."""
    monkeypatch.setattr(chain_relaxation, "STEPS", 20)
    monkeypatch.setattr(chain_relaxation, "MOST_STEPS", 30)
    monkeypatch.setattr(chain_relaxation, "MOST_APPROACHES", 0)
    with pytest.raises(
        cdpr.NotSettled, match=r"no equilibrium was reached within the allowed iterations or time steps \(30 time steps"
    ) as stopped:
        cdpr.settle(beside_a_folded_chain)
    assert stopped.value.equilibrium is not None
    assert 30 <= stopped.value.equilibrium.iterations <= 30 + chain_relaxation.LOOK


def test_steps_tried_near_rest_are_bounded_in_all(beside_a_folded_chain, monkeypatch):
    """However often the platform comes near: the bound is of the sum, but for the last one's shortened ones."""
    tried, approach = [], chain_relaxation.approach

    def counting(*args):
        reached, count = approach(*args)
        tried.append(count.sum())
        return np.zeros_like(reached), count

    monkeypatch.setattr(chain_relaxation, "approach", counting)
    monkeypatch.setattr(chain_relaxation, "MOST_APPROACHES", 7)
    monkeypatch.setattr(chain_relaxation, "STEPS", 300)
    monkeypatch.setattr(chain_relaxation, "MOST_STEPS", 600)
    with contextlib.suppress(cdpr.NotSettled):
        cdpr.settle(beside_a_folded_chain)
    assert 7 <= sum(tried) < 7 + SHORTER


@pytest.fixture
def taut() -> cdpr.Problem:
    """One that settles in some fifty time steps."""
    return cdpr.Problem.of(cdpr.load_robot("cogiro").replace(linear_density=5e-4), (0.3, 0.25, 0.1))


def test_settling_says_how_far_it_is_when_asked(taut, monkeypatch):
    """Time steps and what is unbalanced, and of many poses which; nothing unless asked."""
    shown, said = [], []

    @contextlib.contextmanager
    def saying(show):
        shown.append(show)
        yield said.append

    monkeypatch.setattr("cdpr_sim.physics.settle.saying", saying)
    problems = cdpr.Problems.stack([taut] * 2)
    cdpr.settle_many(problems, progress=True)
    cdpr.settle(taut)
    assert shown == [True, False]
    assert re.fullmatch(r"MuJoCo settles the platform: pose 1 of 2: 5 time steps, \S+ N of 3.92 N unbalanced", said[0])
    assert any("pose 2 of 2" in words for words in said)


def test_an_interrupt_ends_settling_and_leaves_nothing_changed(taut, monkeypatch):
    """Ctrl-C in the middle: the next settling is the same to the last bit."""
    before = cdpr.settle(taut)
    advance, steps = Stepping.advance, []
    started = signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell's background processes ignore it

    def interrupted(self, at, longest):
        steps.append(longest)
        if len(steps) == 3:
            signal.raise_signal(signal.SIGINT)
        return advance(self, at, longest)

    with monkeypatch.context() as patch:
        patch.setattr(Stepping, "advance", interrupted)
        with pytest.raises(KeyboardInterrupt):
            cdpr.settle(taut)
    signal.signal(signal.SIGINT, started)
    assert len(steps) == 3
    assert np.array_equal(cdpr.settle(taut).position, before.position)

"""Equilibria along a path, by statics, of ropes with friction, hysteresis and creep; ``test_matrix.py`` judges each."""

import pickle

import numpy as np
import pytest
from test_refusals_motion import with_memory

import cdpr_sim as cdpr
from cdpr_sim.core.status import Status

EA, BEHIND = 1e4, 0.7
"""[N], [m] of the plumb cable, of one metre."""

EXACT = 5e-12
"""[m] Where statics and a closed form differ by rounding, and by a residual of 2e-9 of 10 N over 5 kN/m."""

SEEN = 1e-9
"""[m] The accuracy that is claimed; one percent of friction or of a yield strain changes more."""

ELEMENTS = [(0.15, 4e-5), (0.1, 1.5e-4, 0.8), (0.1, np.inf, 0.2)]

THERE = np.linspace([0.2, 0.25, 0.1], [0.6, 0.25, 0.1], 9)
AND_BACK = np.concatenate([THERE, THERE[-2::-1]])

FRICTION, HYSTERESIS = dict(pulley_friction=0.05, winch_to_exit=0.5), dict(hysteresis=ELEMENTS)
ALL = dict(
    pulley_friction=0.1, winch_to_exit=0.8, hysteresis=ELEMENTS, creep=[(4e4, 3.0)], reeving=2, pulley_radius=0.01
)


def plumb(**changes) -> cdpr.Robot:
    """Half a kilogram below one cable."""
    return cdpr.Robot([[0, 0, 2.0]], [[0, 0, 0]], EA, 0.5, gravity=0.0, platform_size=(0.1, 0.1, 0.1), **changes)


def under(robot: cdpr.Robot, forces, **others) -> tuple[np.ndarray, cdpr.EquilibriumPath]:
    """Stretches [m] of the plumb cable of one metre under these forces downwards [N]."""
    wrenches = np.zeros((len(forces), 6))
    wrenches[:, 2] = -np.asarray(forces)
    path = cdpr.solve_path(robot, np.tile([0.0, 0, 1.0], (len(forces), 1)), external_wrench=wrenches, **others)
    assert path.converged.all()
    return 1 - path.positions[:, 2], path


# --- closed forms ----------------------------------------------------------------------------------------------------


def test_the_area_of_a_loop_is_the_work_of_its_elements():
    """Between two stretches an element of the share s and the bound b = y L costs 2 s K b (change − 2 b) a cycle."""
    s, y, low, high = 0.2, 1e-4, 4e-4, 9e-4
    K, b, loose = EA / (1 + BEHIND), y * (1 + BEHIND), 1 - s
    corners = [(low + 2 * b, 1), (high, 1), (high - 2 * b, -1), (low, -1)]
    forces = [K * (loose * e + sign * s * b) for e, sign in corners]
    stretches, _ = under(plumb(hysteresis=[(s, y)], winch_to_exit=BEHIND), [*forces, *forces])
    assert stretches[4:] == pytest.approx([e for e, _ in corners], abs=EXACT)
    e, f = stretches[4:], np.array(forces)
    area = abs(np.dot(e, np.roll(f, 1)) - np.dot(f, np.roll(e, 1))) / 2
    assert area == pytest.approx(2 * s * K * b * (high - low - 2 * b), rel=1e-8)


@pytest.mark.parametrize("steps", [1, 100])
def test_creep_under_a_tension_that_grows_in_time_is_exact_in_one_step(steps):
    """A ramp of the load: Σ T'/EA1 (t − tau (1 − exp(−t/tau)))."""
    EA1, tau, end = 3e4, 60.0, 100.0
    stretches, _ = under(plumb(creep=[(EA1, tau)]), [1, 5], times=[0, end], steps=steps)
    rate = 4 / end
    by_hand = 5 / EA + 1 / EA1 * -np.expm1(-end / tau) + rate / EA1 * (end + tau * np.expm1(-end / tau))
    assert stretches[-1] == pytest.approx(by_hand, abs=EXACT)


# --- what does not matter --------------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", [FRICTION, HYSTERESIS], ids=["friction", "hysteresis"])
def test_more_steps_change_nothing_where_stretches_are_monotone(kind):
    """DemoBot's crossed cables, there and back: commands alone, and eight steps from each to the next."""
    robot = cdpr.load_robot("cogiro").replace(**kind)
    few, many = (cdpr.solve_path(robot, AND_BACK, steps=steps) for steps in (1, 8))
    assert np.abs(few.positions - many.positions).max() < EXACT
    assert few.memory.strains == pytest.approx(many.memory.strains, abs=EXACT)


def test_small_steps_go_along_the_commanded_poses():
    """Four steps between two commands are those of a path with the poses between them, in a quarter of the time."""
    random, robot = np.random.default_rng(0), with_memory()
    poses = random.uniform([0.2, 0.2, 0.1, 0, 0, 0], [0.6, 0.3, 0.12, 0, 0.1, 0], (4, 6))
    times, fine = np.array([0.0, 100.0, 300.0, 300.0]), np.arange(13) / 4
    steps = cdpr.solve_path(robot, poses, times=times, steps=4)
    between = np.stack([np.interp(fine, np.arange(4), column) for column in poses.T], axis=1)
    path = cdpr.solve_path(robot, between, times=np.interp(fine, np.arange(4), times))
    np.testing.assert_allclose(steps.tensions, path.tensions[::4], rtol=0, atol=1e-7)
    np.testing.assert_allclose(steps.memory.strains, path.memory.strains, rtol=0, atol=1e-10)
    at_once = cdpr.solve_path(robot, poses, times=times)
    assert np.abs(at_once.tensions - steps.tensions).max() > 1e-5


def test_a_path_goes_on_from_its_memory():
    """Two halves, the second with the memory of the first, are the whole path; and a memory can be kept in a file."""
    robot = cdpr.load_robot("parallel").replace(**ALL)
    whole = cdpr.solve_path(robot, AND_BACK, times=np.arange(17.0))
    assert (whole.tensions >= 0).all()
    assert (whole.tensions == 0).any()  # slack and taut again
    half = cdpr.solve_path(robot, AND_BACK[:9], times=np.arange(9.0))
    memory = pickle.loads(pickle.dumps(half.memory))
    ended = cdpr.solve_path(robot, AND_BACK[8:], times=np.arange(8.0, 17.0), memory=memory)
    assert np.abs(ended.positions - whole.positions[8:]).max() < SEEN
    fresh = cdpr.solve_path(robot, AND_BACK[8:], times=np.arange(8.0, 17.0))
    assert np.abs(fresh.positions - whole.positions[8:]).max() > 100 * SEEN


def test_a_step_without_equilibrium_ends_its_path():
    """Above all exits the platform falls: all later steps say so, no memory is left, and the other path goes on."""
    robot = cdpr.load_robot("cogiro").replace(**FRICTION)
    poses = np.repeat(THERE[:4, None], 2, axis=1)
    poses[1, 0, 2] = 0.6
    path = cdpr.solve_path(robot, poses)
    assert path.status[:, 0].tolist() == [Status.CONVERGED, *[Status.FALLS] * 3]
    assert path.converged[:, 1].all()
    assert np.isnan(path.memory.tensions[0]).all()
    with pytest.raises(cdpr.NotConverged):
        path[1, 0]

"""Equilibria along a path, by statics, of ropes with friction, hysteresis and creep; ``test_matrix.py`` judges each."""

import pickle
from itertools import pairwise

import numpy as np
import pytest

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


def test_friction_holds_until_one_end_of_its_band():
    """Loads up and down: the ratio of the tensions reaches rho, then 1/rho; in between the rope does not slip."""
    c = 0.05
    rho = (1 + c / 2) / (1 - c / 2)
    robot = plumb(pulley_friction=c, winch_to_exit=BEHIND)
    stretches, path = under(robot, [5, 10, 10 / rho, 9.7 / rho**2, 5, 5 * rho])
    slips = [5 * (1 + BEHIND), 10 * (1 + BEHIND / rho), None, 9.7 / rho**2 * (1 + BEHIND * rho), 5 * (1 + BEHIND * rho)]
    for found, slip in zip(stretches, slips, strict=False):
        assert slip is None or found == pytest.approx(slip / EA, abs=EXACT)
    assert stretches[2] - stretches[1] == pytest.approx((10 / rho - 10) / EA, abs=EXACT)  # held: l0/EA
    assert stretches[5] - stretches[4] == pytest.approx((5 * rho - 5) / EA, abs=EXACT)
    assert path.memory.beyond == pytest.approx(1 + stretches[5] - 5 * rho / EA, abs=EXACT)


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


def test_creep_is_exponential_and_recovers():
    """Under 5 N: T/EA + Σ T/EA1 (1 − exp(−t/tau)), whatever the steps of time; unloaded, the terms decay."""
    terms = [(3e4, 60.0), (5e4, 3600.0)]
    robot = plumb(creep=terms, winch_to_exit=BEHIND)
    times = np.array([0, 0, 1, 30, 60, 600, 7200, 1e6])
    stretches, path = under(robot, [5.0] * 8, times=times)
    by_hand = [5 / EA + sum(5 / EA1 * -np.expm1(-t / tau) for EA1, tau in terms) for t in times]
    assert stretches == pytest.approx((1 + BEHIND) * np.array(by_hand), abs=EXACT)
    assert path.memory.time == 1e6
    left, _ = under(robot, [1e-3, 1e-3], times=[1e6, 1e6 + 60], memory=path.memory)
    by_hand = [1e-3 / EA + sum((5 - 1e-3) / EA1 * np.exp(-t / tau) + 1e-3 / EA1 for EA1, tau in terms) for t in (0, 60)]
    assert left == pytest.approx((1 + BEHIND) * np.array(by_hand), abs=EXACT)


@pytest.mark.parametrize("steps", [1, 100])
def test_creep_under_a_tension_that_grows_in_time_is_exact_in_one_step(steps):
    """A ramp of the load: Σ T'/EA1 (t − tau (1 − exp(−t/tau)))."""
    EA1, tau, end = 3e4, 60.0, 100.0
    stretches, _ = under(plumb(creep=[(EA1, tau)]), [1, 5], times=[0, end], steps=steps)
    rate = 4 / end
    by_hand = 5 / EA + 1 / EA1 * -np.expm1(-end / tau) + rate / EA1 * (end + tau * np.expm1(-end / tau))
    assert stretches[-1] == pytest.approx(by_hand, abs=EXACT)


def test_cycles_only_cost_work():
    """Stretched and let go at random: as much is got back as was put in, less a loss that is never negative."""
    robot, random = plumb(hysteresis=ELEMENTS, pulley_friction=0.1, winch_to_exit=BEHIND), np.random.default_rng(3)
    for _ in range(3):
        turns = np.concatenate([[0.01], random.uniform(0.01, 6, 6), [0.01]])
        forces = np.concatenate([np.linspace(one, other, 30) for one, other in pairwise(turns)])
        stretches, path = under(robot, [*forces, *forces])
        assert (path.tensions > 0).all()
        e, f = stretches[len(forces) :], forces
        assert ((f[1:] + f[:-1]) / 2 * np.diff(e)).sum() > 1e-3 * 6**2 / EA


# --- what does not matter --------------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", [FRICTION, HYSTERESIS], ids=["friction", "hysteresis"])
def test_more_steps_change_nothing_where_stretches_are_monotone(kind):
    """DemoBot's crossed cables, there and back: commands alone, and eight steps from each to the next."""
    robot = cdpr.load_robot("cogiro").replace(**kind)
    few, many = (cdpr.solve_path(robot, AND_BACK, steps=steps) for steps in (1, 8))
    assert np.abs(few.positions - many.positions).max() < EXACT
    assert few.memory.strains == pytest.approx(many.memory.strains, abs=EXACT)


def test_the_same_command_twice_changes_nothing():
    """Friction and hysteresis do not depend on time, nor creep on commands: only time moves the platform."""
    robot = cdpr.load_robot("cogiro").replace(**ALL)
    path = cdpr.solve_path(robot, np.repeat(AND_BACK, 2, axis=0), times=np.repeat(np.arange(17.0), 2))
    assert np.abs(path.positions[::2] - path.positions[1::2]).max() < EXACT


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


def test_one_step_from_new_ropes_is_solve():
    """``solve`` and ``solve_many``; and friction, creep and elements that do not yield change nothing then."""
    robot = cdpr.load_robot("cogiro").replace(**ALL)
    path, many, one = cdpr.solve_path(robot, THERE[:1]), cdpr.solve_many(robot, THERE), cdpr.solve(robot, THERE[0])
    assert (one.position == path[0].position).all()
    assert (one.position == many[0].position).all()
    assert one.eigenvalues == pytest.approx(path.eigenvalues[0])
    plain = cdpr.load_robot("cogiro").replace(winch_to_exit=0.5)
    new = plain.replace(pulley_friction=0.1, creep=[(1e4, 1.0)], hysteresis=[(0.2, np.inf)])
    assert np.abs(cdpr.solve_many(plain, THERE).positions - cdpr.solve_many(new, THERE).positions).max() < EXACT


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

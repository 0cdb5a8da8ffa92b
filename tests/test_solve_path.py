"""Equilibria along a path, by statics, of ropes with friction, hysteresis and creep.

The laws are written again here, for one cable at a time: stop operators, a rope that slips at its exit, terms of creep.
"""

import pickle

import numpy as np
import pytest
from scipy.optimize import brentq
from test_real_cables import wheel_by_hand

import cdpr_sim as cdpr
from cdpr_sim.core.memory import Memory
from cdpr_sim.core.status import Status
from cdpr_sim.statics.memory_kernel import MEMORY_COLUMNS
from cdpr_sim.statics.memory_law import MemoryLaw

EA, BEHIND = 1e4, 0.7
"""[N], [m] of the plumb cable, of one metre."""

EXACT = 5e-12
"""[m] Where statics and a closed form differ by rounding, and by a residual of 2e-9 of 10 N over 5 kN/m."""

SEEN = 1e-9
"""[m] The accuracy that is claimed; one percent of friction or of a yield strain changes more."""

BALANCED = 1e-8
"""Unbalanced force over the weight; the solver's own tolerance is 2e-9."""

ELEMENTS = [(0.15, 4e-5), (0.1, 1.5e-4, 0.8), (0.1, np.inf, 0.2)]

THERE = np.linspace([0.2, 0.25, 0.1], [0.6, 0.25, 0.1], 9)
AND_BACK = np.concatenate([THERE, THERE[-2::-1]])


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


def test_friction_holds_until_one_end_of_its_band():
    """Loads up and down: the ratio of the tensions reaches rho, then 1/rho; in between the rope does not slip."""
    c = 0.05
    rho = (1 + c / 2) / (1 - c / 2)
    robot = plumb(pulley_friction=c, winch_to_exit=BEHIND)
    stretches, path = under(robot, [5, 10, 10 / rho, 9.7 / rho**2, 5, 5 * rho])
    x = [1, 1 / rho, None, rho, rho, None]
    slips = [5 * (1 + BEHIND), 10 * (1 + BEHIND / rho), None, 9.7 / rho**2 * (1 + BEHIND * rho), 5 * (1 + BEHIND * rho)]
    for found, ratio, slip in zip(stretches, x, slips, strict=False):
        if ratio is not None:
            assert found == pytest.approx(slip / EA, abs=EXACT)
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


def test_creep_under_a_tension_that_grows_in_time_is_exact_in_one_step():
    """A ramp of the load: one step and a hundred give the same, which is Σ T'/EA1 (t − tau (1 − exp(−t/tau)))."""
    EA1, tau, end = 3e4, 60.0, 100.0
    robot = plumb(creep=[(EA1, tau)])
    once, _ = under(robot, [1, 5], times=[0, end])
    often, _ = under(robot, [1, 5], times=[0, end], steps=100)
    rate = 4 / end
    by_hand = 5 / EA + 1 / EA1 * -np.expm1(-end / tau) + rate / EA1 * (end + tau * np.expm1(-end / tau))
    assert once[-1] == pytest.approx(by_hand, abs=EXACT)
    assert often[-1] == pytest.approx(by_hand, abs=EXACT)


class ByHand:
    """One cable of a robot, with its memory."""

    def __init__(self, robot: cdpr.Robot, cable: int) -> None:
        self.n, self.EA = int(robot.reeving[cable]), robot.axial_stiffness[cable]
        self.g, self.c = robot.winch_to_exit[cable] / self.n, robot.pulley_friction[cable]
        self.a2, self.a3 = robot.stiffening[cable]
        self.elements = [tuple(row) for row in robot.hysteresis[cable] if row[0] > 0]
        self.terms = [tuple(row) for row in robot.creep[cable] if np.isfinite(row[0])]
        self.zeta, self.zc, self.lo, self.T = [0.0] * len(self.elements), [0.0] * len(self.terms), None, 0.0

    def step(self, length: float, rest: float, seconds: float, tension: float) -> float:
        """The tension by the laws, where creep takes the ``tension`` that statics found."""
        whole = rest + self.g
        for i, (EA1, tau) in enumerate(self.terms):
            x = seconds / tau
            p = -np.expm1(-x) / x if x else 1.0
            self.zc[i] = np.exp(-x) * self.zc[i] + (p - np.exp(-x)) * self.T / EA1 + (1 - p) * tension / EA1
        self.T = tension
        e = length - rest - whole * sum(self.zc)
        if e <= 0:
            self.zeta, self.lo = [0.0] * len(self.elements), rest
            return 0.0
        gave_way = 0.0
        for j, (share, y, w) in enumerate(self.elements):
            bound = min(y * whole, w * e)
            stretched = min(max(e - self.zeta[j] * whole, -bound), bound)
            self.zeta[j] = (e - stretched) / whole
            gave_way += share * (e - stretched)
        rho = (1 + self.c / 2) / (1 - self.c / 2)
        mean = self.EA * (1 / (rest + self.g / rho) + 1 / (rest + self.g * rho)) / 2
        if self.lo is None:
            pull = self.tau(e / whole) - self.EA / whole * gave_way
        else:  # the rope's point at the exit stays, or slips to an end of the band
            stays = self.tau((e - (self.lo - rest)) / rest)
            pull = min(max(stays, self.slips(e, rest, rho)), self.slips(e, rest, 1 / rho)) - mean * gave_way
        self.lo = rest + e - rest * self.strain(pull + mean * gave_way)
        return pull

    def tau(self, strain: float) -> float:
        """The elastic law."""
        return self.EA * strain * (1 + max(strain, 0) * (self.a2 + self.a3 * strain))

    def strain(self, pull: float) -> float:
        """Its inverse."""
        if not self.a2:
            return pull / self.EA
        return brentq(lambda strain: self.tau(strain) - pull, 0, 0.2, xtol=1e-16)

    def slips(self, e: float, rest: float, x: float) -> float:
        """The tension before the exit with which a rope slips there, with x of it behind: e = l0 eps + g eps'."""
        if not self.a2:
            return self.EA * e / (rest + x * self.g)
        return brentq(lambda T: rest * self.strain(T) + self.g * self.strain(x * T) - e, 0, self.tau(0.1), xtol=1e-13)


def residuals_by_hand(path: cdpr.EquilibriumPath, robot: cdpr.Robot) -> np.ndarray:
    """Largest unbalanced force of each step over the weight, by ``ByHand`` at the poses that were found."""
    cables, left = [ByHand(robot, cable) for cable in range(robot.cables)], []
    for row, seconds in enumerate(np.diff(path.times, prepend=path.times[0])):
        position, rotation = path.positions[row], path.rotations[row]
        weight = np.array([0, 0, -robot.weight])
        force, torque = weight, np.cross(rotation @ robot.center_of_mass, weight)
        for cable, one in enumerate(cables):
            arm = rotation @ robot.anchors[cable]
            if robot.pulley_radius[cable] > 0:
                wheel = robot.exits[cable], robot.pulley_axis[cable], robot.pulley_radius[cable]
                length, direction = wheel_by_hand(*wheel, position + arm)
            else:
                apart = robot.exits[cable] - position - arm
                length = np.linalg.norm(apart)
                direction = apart / length
            tension = one.step(length, path.rest_lengths[row, cable], seconds, path.tensions[row, cable])
            assert tension == pytest.approx(path.tensions[row, cable], abs=BALANCED * robot.weight)
            pull = one.n * tension * direction
            force, torque = force + pull, torque + np.cross(arm, pull)
        left.append(np.abs(np.concatenate([force, torque / robot.characteristic_length])).max() / robot.weight)
    return np.array(left)


KINDS = {
    "friction": dict(pulley_friction=0.05, winch_to_exit=0.5),
    "hysteresis": dict(hysteresis=ELEMENTS),
    "creep": dict(creep=[(4e4, 3.0), (9e4, 40.0)]),
    "friction and hysteresis": dict(pulley_friction=0.05, winch_to_exit=0.5, hysteresis=ELEMENTS),
    "all at once": dict(
        pulley_friction=0.1, winch_to_exit=0.8, hysteresis=ELEMENTS, creep=[(4e4, 3.0)], reeving=2, pulley_radius=0.01
    ),
    "all with a nonlinear law": dict(
        pulley_friction=[0.1, 0] * 4, winch_to_exit=0.8, hysteresis=[ELEMENTS, ELEMENTS[:1], [], []] * 2,
        creep=[(4e4, 3.0)], reeving=2, stiffening=[(400.0, 2e6)] * 7 + [(0, 0)],
    ),
}  # fmt: skip


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("name", ["cogiro", "parallel"])
def test_forces_balance_with_the_laws_by_hand_there_and_back(name, kind):
    """17 steps, where cables of `parallel` get slack and taut; and a hundredth less friction or yield is noticed."""
    robot = cdpr.load_robot(name).replace(**KINDS[kind])
    path = cdpr.solve_path(robot, AND_BACK, times=np.arange(17.0))
    assert path.converged.all()
    assert residuals_by_hand(path, robot).max() < BALANCED
    assert (path.tensions >= 0).all()
    assert ((path.eigenvalues > 0).all() and path.stable.all()) or name == "parallel"


@pytest.mark.parametrize("kind", ["friction", "hysteresis"])
def test_more_steps_change_nothing_where_stretches_are_monotone(kind):
    """DemoBot's crossed cables, there and back: commands alone, and eight steps from each to the next."""
    robot = cdpr.load_robot("cogiro").replace(**KINDS[kind])
    few, many = (cdpr.solve_path(robot, AND_BACK, steps=steps) for steps in (1, 8))
    assert np.abs(few.positions - many.positions).max() < EXACT
    assert few.memory.strains == pytest.approx(many.memory.strains, abs=EXACT)


def test_the_same_command_twice_changes_nothing():
    """Friction and hysteresis do not depend on time, nor creep on commands: only time moves the platform."""
    robot = cdpr.load_robot("cogiro").replace(**KINDS["all at once"])
    twice = np.repeat(AND_BACK, 2, axis=0)
    path = cdpr.solve_path(robot, twice, times=np.repeat(np.arange(17.0), 2))
    assert np.abs(path.positions[::2] - path.positions[1::2]).max() < EXACT


def test_a_slack_cable_never_pushes_and_cycles_only_cost_work():
    """The law at random lengths from slack to taut: it pulls, and a closed cycle never gives work back."""
    cables, rng = 40, np.random.default_rng(3)
    robot = plumb(hysteresis=ELEMENTS, pulley_friction=0.1, winch_to_exit=BEHIND)
    memory, rest = Memory.fresh(robot, (cables,)), np.ones((cables, 1))
    turns = rng.uniform(-3e-4, 6e-4, (6, cables))
    turns[0] = -1e-4  # slack, where a cycle begins and ends with the same memory
    cycle = np.concatenate(
        [np.linspace(one, other, 60)[1:] for one, other in zip(turns, np.roll(turns, -1, 0), strict=True)]
    )
    work, stretch, tension = np.zeros(cables), turns[0], np.zeros(cables)
    for following in [*cycle, *cycle]:
        law = MemoryLaw(robot, robot.axial_stiffness, rest, memory, 0.0)
        pull = _of_knots(*np.moveaxis(law.table()[..., MEMORY_COLUMNS:].reshape(cables, 3, -1), 1, 0), following)
        assert ((pull > 0) == (following > 0)).all()
        memory = law.after(1 + following[:, None], pull[:, None], 0.0)
        work += (tension + pull) / 2 * (following - stretch)
        stretch, tension = following, pull
    assert (work > 1e-6 * EA * 6e-4**2).all()


def _of_knots(stretches, tensions, slopes, at):
    """Laws, one per row, that are linear between knots."""
    at = np.maximum(at, 0.0)
    j = np.arange(len(at)), (stretches <= at[:, None]).sum(1) - 1
    return tensions[j] + slopes[j] * (at - stretches[j])


def test_a_path_goes_on_from_its_memory():
    """Two halves, the second with the memory of the first, are the whole path; and a memory can be kept in a file."""
    robot = cdpr.load_robot("parallel").replace(**KINDS["all at once"])
    whole = cdpr.solve_path(robot, AND_BACK, times=np.arange(17.0))
    half = cdpr.solve_path(robot, AND_BACK[:9], times=np.arange(9.0))
    memory = pickle.loads(pickle.dumps(half.memory))
    rest = cdpr.solve_path(robot, AND_BACK[8:], times=np.arange(8.0, 17.0), memory=memory)
    assert np.abs(rest.positions - whole.positions[8:]).max() < SEEN
    fresh = cdpr.solve_path(robot, AND_BACK[8:], times=np.arange(8.0, 17.0))
    assert np.abs(fresh.positions - whole.positions[8:]).max() > 100 * SEEN


def test_paths_side_by_side_are_those_paths():
    """Three heights at once, as (steps, 3) equilibria."""
    robot = cdpr.load_robot("cogiro").replace(**KINDS["all at once"])
    heights = AND_BACK[:, None] + [[0, 0, 0], [0, 0, 0.05], [0, 0, 0.1]]
    paths = cdpr.solve_path(robot, heights, times=np.arange(17.0), steps=2)
    assert paths.shape == (17, 3)
    for one in range(3):
        alone = cdpr.solve_path(robot, heights[:, one], times=np.arange(17.0), steps=2)
        assert np.abs(paths.positions[:, one] - alone.positions).max() < EXACT
        assert paths.eigenvalues[:, one] == pytest.approx(alone.eigenvalues, rel=1e-9)
        assert paths.memory.beyond[one] == pytest.approx(alone.memory.beyond, abs=EXACT)


def test_one_step_from_new_ropes_is_solve():
    """``solve`` and ``solve_many``; and friction, creep and elements that do not yield change nothing then."""
    robot = cdpr.load_robot("cogiro").replace(**KINDS["all at once"])
    path, many = cdpr.solve_path(robot, THERE[:1]), cdpr.solve_many(robot, THERE)
    one = cdpr.solve(robot, THERE[0])
    assert (one.position == path[0].position).all()
    assert (one.position == many[0].position).all()
    assert one.eigenvalues == pytest.approx(path.eigenvalues[0])
    plain = cdpr.load_robot("cogiro").replace(winch_to_exit=0.5)
    new = plain.replace(pulley_friction=0.1, creep=[(1e4, 1.0)], hysteresis=[(0.2, np.inf)])
    assert np.abs(cdpr.solve_many(plain, THERE).positions - cdpr.solve_many(new, THERE).positions).max() < EXACT


@pytest.mark.parametrize("changes", [{}, {"linear_density": 0.01}, {"pulley_radius": 0.01, "stiffening": (5, 0)}])
def test_a_path_of_ropes_without_memory_is_solve_many(changes):
    """Also with mass, pulleys and nonlinear laws: the same equilibria, from another start."""
    robot = cdpr.load_robot("cogiro").replace(**changes)
    path, many = cdpr.solve_path(robot, THERE), cdpr.solve_many(robot, THERE)
    assert np.abs(path.positions - many.positions).max() < SEEN
    assert path.eigenvalues == pytest.approx(many.eigenvalues, rel=1e-6)


def test_a_step_without_equilibrium_ends_its_path():
    """Above all exits the platform falls: all later steps say so, no memory is left, and the other path goes on."""
    robot = cdpr.load_robot("cogiro").replace(**KINDS["friction"])
    poses = np.repeat(THERE[:4, None], 2, axis=1)
    poses[1, 0, 2] = 0.6
    path = cdpr.solve_path(robot, poses)
    assert path.status[:, 0].tolist() == [Status.CONVERGED, *[Status.FALLS] * 3]
    assert path.converged[:, 1].all()
    assert np.isnan(path.memory.tensions[0]).all()
    with pytest.raises(cdpr.NotConverged):
        path[1, 0]
    with pytest.raises(cdpr.InvalidInput, match="memory: found that of a path without an equilibrium at its end"):
        cdpr.solve_path(robot, THERE[:2, None].repeat(2, 1), memory=path.memory)


REFUSED = {
    "certify_all": lambda robot: cdpr.certify_all(robot, robot.rest_lengths(robot.home)),
    "find_layout": lambda robot: cdpr.find_layout(robot, [robot.home], move="exits", within=0.01),
}
"""Beside those of ``test_matrix.py``."""


@pytest.mark.parametrize("answer", REFUSED)
def test_answers_that_do_not_know_a_memory_refuse_it_in_one_sentence(answer):
    """None of them takes the elastic law in its place."""
    robot = cdpr.load_robot("cogiro").replace(**KINDS["friction and hysteresis"])
    with pytest.raises(cdpr.InvalidInput, match="found pulley_friction and hysteresis in cable 1, expected") as refused:
        REFUSED[answer](robot)
    assert "\n" not in str(refused.value)

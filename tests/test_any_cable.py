"""One cable of any kind, and robots that mix them: certified by equations of cable and wheel, written again here."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

import cdpr_sim as cdpr
from cdpr_sim.core.cable import AXIS, BEHIND, COLUMNS, RADIUS, STIFFENING, STIFFNESS, WEIGHT, WRAPPED
from cdpr_sim.core.status import Status
from cdpr_sim.statics import forces
from cdpr_sim.statics.any_cable import any_cables
from cdpr_sim.statics.cable_kernel import SAGGING
from cdpr_sim.statics.gufuncs import EQUILIBRIA

ROBOTS = 40
"""Random ones; 10,000 were tried when this was written, without drive lines, and ``scripts/stress_test_real_cables.py``
tries as many as one likes."""

MOST_UNSOLVED = 1
"""Of them: robots of which a cable leaves its wheel, or comes to the end of one, half round it; the status says so."""

HALF_ROUND = (819, 991, 2194, 2995)
"""Robots whose energy decreases until a cable with mass lies half round its wheel, 1e-7 rad from it at most."""

ENDS = 1e-11
"""How far off its anchor a cable may end that is pulled as it is said to, per size of what is spanned."""

SAGGING_ENDS = 1e-8
"""The same where a nonlinear cable sags deeply: 2e-9 at most in 10,000 robots, what Gauss's eight
points miss."""

LARGEST_RESIDUAL = 1e-6
"""Unbalanced force [N] that no answer may have."""

DIFFERENCES = 2e-6
"""Relative error of differences of fourth order with steps of a micrometre."""


PROPORTIONAL = 0.02
"""Relative deviation from proportionality of the change by a small property and by a tenth of it."""

LAWS = {"linear": (0.0, 0.0), "nonlinear": (100.0, 2e4)}
WHEELS = {"point": 0.0, "wheel": 0.1}
BEHIND_EXITS = (0.0, 6.0)
RESTS = {"taut": 0.996, "just taut": 0.99999, "slack": 1.01, "sagging": 1.1}


class Cables:
    """What is given of cables, row by row, and what they do."""

    def __init__(self, span, slackness, radius, axis, stiffness, law, weight, behind=0.0):
        self.span = np.atleast_2d(span).astype(float)
        n = len(self.span)
        self.radius, self.stiffness, self.weight, self.behind = (
            np.broadcast_to(v, n).astype(float) for v in (radius, stiffness, weight, behind)
        )
        self.axis, self.law = np.broadcast_to(axis, (n, 3)), np.broadcast_to(law, (n, 2))
        theta, s = massless_path(self.span, self.radius, self.axis)
        self.length = self.radius * theta + s
        self.rest, self.wrapped = self.length * slackness, self.radius * theta
        self.table = np.zeros((n, COLUMNS))
        self.table[:, STIFFNESS], self.table[:, STIFFENING : STIFFENING + 2] = self.stiffness, self.law
        self.table[:, RADIUS], self.table[:, AXIS : AXIS + 3] = self.radius, self.axis
        self.table[:, BEHIND], self.table[:, WEIGHT], self.table[:, WRAPPED] = self.behind, self.weight, self.wrapped

    def at(self, moved=0.0, **changed):
        table = self.table.copy()
        table[:, WEIGHT] = changed.get("weight", self.weight)
        return any_cables(table, self.span + moved, self.rest)


def massless_path(span, radius, axis):
    """(angle on the wheel, straight piece): the tangent from the anchor to the circle, in the wheel's plane."""
    z = (span * axis).sum(1)
    rho = np.linalg.norm(span - z[:, None] * axis, axis=1)
    to_centre = np.hypot(rho - radius, z)
    s = np.sqrt(to_centre**2 - radius**2)
    # Of the angle at the centre from the exit to the anchor, the right triangle of the tangent takes its own.
    theta = np.mod(np.arctan2(z, radius - rho) - np.arctan2(s, radius), 2 * np.pi)
    return np.where(radius > 0, theta, 0.0), s


def strain_under(tension, stiffness, a2, a3):
    """Of the law, by bisection; beyond 20 % it goes on straight."""
    y = tension / stiffness
    end = 0.2 + 0.04 * a2 + 0.008 * a3
    low, high = np.zeros_like(y), np.full_like(y, 0.2)
    for _ in range(70):
        e = (low + high) / 2
        above = e + a2 * e**2 + a3 * e**3 > y
        low, high = np.where(above, low, e), np.where(above, e, high)
    beyond = 0.2 + (y - end) / (1 + 0.4 * a2 + 0.12 * a3)
    return np.where(y > end, beyond, (low + high) / 2)


def misses(cables, pull):
    """How far from its anchor each cable ends which is pulled so, by the wheel's geometry and an integral of its shape.

    None of the package's formulas: a massless piece that leaves the wheel along the tension's direction, with what the
    stretch of the part behind the exit adds to it, and then dr = (1 + eps) t/T ds with t growing by the weight. In
    extended precision.
    """
    pull, span, rest, wrapped, radius, weight, EA, axis, behind = (
        np.asarray(v, np.longdouble)
        for v in (
            pull,
            cables.span,
            cables.rest,
            cables.wrapped,
            cables.radius,
            cables.weight,
            cables.stiffness,
            cables.axis,
            cables.behind,
        )
    )
    a2, a3 = cables.law.T.astype(np.longdouble)
    L = rest - wrapped
    up = np.array([0, 0, 1], np.longdouble)
    t = -pull - (weight * L)[:, None] * up
    T = np.linalg.norm(t, axis=1)
    u = t / T[:, None]
    cosine = (u * axis).sum(1)
    n = u - cosine[:, None] * axis
    sine = np.linalg.norm(n, axis=1)
    n = n / sine[:, None]
    theta = np.arctan2(sine, cosine)
    lift_off = radius[:, None] * ((1 - cosine)[:, None] * n + sine[:, None] * axis)
    strain = strain_under(T, EA, a2, a3)
    straight = wrapped * (1 + strain) + behind * strain - np.where(radius > 0, radius * theta, 0)
    end = np.where(radius[:, None] > 0, lift_off, 0) + straight[:, None] * u
    # The free part: along s where the cable is nearly straight, else along q with t_z = H sinh q.
    points, parts = np.polynomial.legendre.leggauss(60)
    points, parts = (points.astype(np.longdouble) + 1) / 2, parts.astype(np.longdouble) / 2
    H, first, last = np.hypot(t[:, 0], t[:, 1]), t[:, 2], -pull[:, 2]
    q0, q1 = np.arcsinh(first / H), np.arcsinh(last / H)
    bent = weight * L > 0.1 * T
    q = q0[:, None] + (q1 - q0)[:, None] * points
    s = np.where(
        bent[:, None],
        (H[:, None] * np.sinh(q) - first[:, None]) / np.where(weight == 0, 1, weight)[:, None],
        L[:, None] * points,
    )
    ds = (
        np.where(bent[:, None], (H / np.where(weight == 0, 1, weight) * (q1 - q0))[:, None] * np.cosh(q), L[:, None])
        * parts
    )
    along = np.stack([*np.broadcast_arrays(t[:, :1], t[:, 1:2], first[:, None] + weight[:, None] * s)], -1)
    tension = np.linalg.norm(along, axis=-1)
    stretched = 1 + strain_under(tension, EA[:, None], a2[:, None], a3[:, None])
    end = end + (along * (stretched / tension * ds)[..., None]).sum(1)
    return np.linalg.norm(end - span, axis=1).astype(float)


def every_kind(weight=0.6, stiffness=1e5):
    """A row for each wheel, law, slackness, direction, axis and length behind the exit."""
    kinds = list(
        itertools.product(
            WHEELS.values(), LAWS.values(), RESTS.values(), [(3, 4, -6), (-2, 1, 0.4), (0.5, 0, -8)], [1, -1],
            BEHIND_EXITS,
        )
    )  # fmt: skip
    radius, law, slackness, span, sign, behind = map(np.array, zip(*kinds, strict=True))
    axis = sign[:, None] * np.array([0.1, -0.2, np.sqrt(0.95)])
    return Cables(span, slackness, radius, axis, stiffness, law, weight, behind)


def test_every_cable_ends_at_its_anchor() -> None:
    """Over wheels and points, linear or not, taut and slack: what is said to pull reaches from exit to anchor."""
    cables = every_kind()
    pull = cables.at().pull
    scale = np.linalg.norm(cables.span, axis=1)
    assert (misses(cables, pull) <= ENDS * scale).all()
    assert (misses(cables, 1.001 * pull) > 1e3 * ENDS * scale).all()  # the certificate sees a thousandth


@pytest.mark.parametrize("name", ["weight", "radius", "stiffness", "law", "behind"])
def test_the_certificate_sees_each_property(name) -> None:
    """One percent more weight, radius, stiffness, nonlinearity or length behind the exit is another cable."""
    cables = every_kind()
    pull, value = cables.at().pull, getattr(cables, name)
    felt = (value != 0) if value.ndim == 1 else (value != 0).any(1)
    felt &= (cables.rest < 0.99999 * cables.length) | (name in ("weight", "radius"))
    setattr(cables, name, 1.01 * value)
    assert (misses(cables, pull)[felt] > 10 * ENDS * np.linalg.norm(cables.span, axis=1)[felt]).all()


def test_pull_is_the_slope_of_the_energy_and_stiffness_that_of_the_pull() -> None:
    """By differences of fourth order: energy, pull and stiffness are one potential; the stiffness is symmetric."""
    cables, h = every_kind(), 1e-6
    here = cables.at()
    slopes, columns = [], []
    for axis in np.eye(3):
        there = [cables.at(k * h * axis) for k in (-2, -1, 1, 2)]
        energy, pull = ([getattr(one, name) for one in there] for name in ("energy", "pull"))
        slopes.append((energy[0] - 8 * energy[1] + 8 * energy[2] - energy[3]) / (12 * h))
        columns.append((pull[0] - 8 * pull[1] + 8 * pull[2] - pull[3]) / (12 * h))
    largest = np.abs(here.pull).max(1)
    # Rounding of the energy, a few units of its last place, over the step.
    assert (
        np.abs(np.array(slopes).T + here.pull).max(1) <= DIFFERENCES * largest + 4e-16 * np.abs(here.energy) / h
    ).all()
    difference = np.abs(-np.stack(columns, -1) - here.stiffness).max((1, 2))
    assert (difference <= DIFFERENCES * np.abs(here.stiffness).max((1, 2))).all()
    np.testing.assert_array_equal(here.stiffness, here.stiffness.swapaxes(1, 2))


def random_robot(seed: int):
    """Two to ten cables, each with or without wheel, mass, nonlinear law, drive line, some slack; and its problem."""
    random = np.random.default_rng(seed)
    size, cables = 10 ** random.uniform(-0.3, 1.2), random.integers(2, 11)
    exits = random.uniform(-0.5, 0.5, (cables, 3)) * size
    exits[:, 2] = size * random.uniform(0.5, 1, cables)
    anchors = random.uniform(-0.5, 0.5, (cables, 3)) * size * 10 ** random.uniform(-1.3, -0.7)
    mass = 10 ** random.uniform(-1, 2.5)
    load = 9.81 * mass
    axis = random.normal(size=(cables, 3)) * 0.1
    axis[:, 2] = random.choice([-1, 1])
    line = np.random.default_rng([seed, 1])
    robot = cdpr.Robot(
        exits, anchors, load * 10 ** random.uniform(1.5, 4.5) * random.uniform(1, 2, cables), mass,
        linear_density=mass / size * 10 ** random.uniform(-5, -1, cables) * (random.random(cables) < 0.7),
        pulley_radius=size * 10 ** random.uniform(-3, -1.7) * (random.random(cables) < 0.6), pulley_axis=axis,
        stiffening=np.array([random.uniform(0, 100), random.uniform(0, 2e4)]) * (random.random((cables, 1)) < 0.5),
        winch_to_exit=size * line.uniform(0, 2, cables) * (line.random(cables) < 0.5),
        reeving=line.integers(1, 4, cables),
    )  # fmt: skip
    position = random.uniform(-0.2, 0.2, 3) * size * [1, 1, 0.4]
    wrench = np.zeros(6)
    wrench[:3] = 0.2 * load * random.normal(size=3) * (random.random() < 0.3)
    slack = random.choice([0, random.uniform(-0.01, 0.01), random.uniform(0, 0.2)], cables)
    return robot, position, robot.rest_lengths(position) * (1 + slack), wrench


def certify(equilibrium) -> None:
    """Forces balance, and each is that of a cable that ends at its anchor; by equations of this file alone."""
    problem, robot = equilibrium.problem, equilibrium.problem.robot
    rotation = equilibrium.rotation.as_matrix()
    state = forces.at(problem, equilibrium.position, rotation)
    arms = robot.anchors @ rotation.T
    cables = Cables(
        equilibrium.position + arms - robot.exits, 1.0, robot.pulley_radius, robot.pulley_axis,
        robot.reeving * robot.axial_stiffness, robot.stiffening, robot.reeving * robot.linear_density * robot.gravity,
        robot.winch_to_exit / robot.reeving,
    )  # fmt: skip
    np.testing.assert_allclose(cables.length, equilibrium.lengths, rtol=1e-10)
    cables.rest, cables.wrapped = problem.rest_lengths, robot.wrapped_lengths
    assert state.hanging is not None
    pull = state.hanging.pull
    pulling = np.linalg.norm(pull, axis=1) > 0
    size = np.abs(robot.exits).max()
    ends = np.where(robot.stiffening.any(1) & (cables.rest > cables.length), SAGGING_ENDS, ENDS)
    assert (misses(cables, np.where(pulling[:, None], pull, 1.0)) <= ends * size)[pulling].all()
    assert (pulling | ((robot.linear_density == 0) & (cables.length <= cables.rest))).all()
    np.testing.assert_allclose(np.linalg.norm(pull, axis=1), equilibrium.pulls, rtol=1e-6, atol=1e-6)
    weight = np.array([0, 0, -robot.weight])
    net = np.r_[pull.sum(0) + weight, np.cross(arms, pull).sum(0)] + problem.external_wrench
    rounding = 1e-13 * size * (state.hanging.stiffness.max() + (robot.cable_weights * cables.rest).sum())
    assert np.abs(net / robot.units).max() <= LARGEST_RESIDUAL + rounding


def test_random_robots_of_mixed_cables_rest_where_forces_balance() -> None:
    """Wheels, masses, laws, drive lines in any mixture: nearly all are solved, and every answer is certified."""
    assert EQUILIBRIA[SAGGING].compiled  # Python takes seconds for the first hundred
    solved, asked = 0, 0
    for seed in range(ROBOTS):
        try:
            robot, position, rest, wrench = random_robot(seed)
        except cdpr.InvalidInput:  # an anchor that lies in a wheel
            continue
        if robot.cabling.massless:
            continue
        found = cdpr.solve_many(robot, position[None], rest, external_wrench=wrench)
        asked += 1
        if found.status[0] == Status.CONVERGED:
            certify(found[0])
            solved += 1
    assert solved >= asked - MOST_UNSOLVED
    assert asked > 0.9 * ROBOTS


@pytest.mark.parametrize("seed", HALF_ROUND)
def test_a_cable_that_comes_half_round_its_wheel_is_said_to_leave_it(seed) -> None:
    """The search ends there, since a wheel holds no more; no equilibrium is returned, and the status is not a limit."""
    robot, position, rest, wrench = random_robot(seed)
    assert EQUILIBRIA[SAGGING].compiled  # Python takes minutes for a thousand iterations
    found = cdpr.solve_many(robot, position[None], rest, external_wrench=wrench)
    assert Status(int(found.status[0])) is Status.OFF_WHEEL


@pytest.mark.parametrize("beside", [True, False], ids=["beside the others", "alone"])
@pytest.mark.parametrize("name", ["radius", "weight", "behind", "law"])
def test_every_property_vanishes_smoothly(name, beside) -> None:
    """Where a radius, a weight, a length behind the exit or a coefficient tends to 0, the pull changes in proportion.

    From exactly 0, where other code may be taken; the other three properties are there or not, cables taut and slack.
    """
    cables = every_kind()
    given = {"radius": 0.1, "law": LAWS["nonlinear"], "weight": 0.6, "behind": 6.0}
    if not beside:
        given = {"radius": 0.0, "law": LAWS["linear"], "weight": 0.6 * (name != "weight"), "behind": 0.0}
    small = {"radius": 1e-6, "law": 1e-3, "weight": 1e-7, "behind": 1e-3}[name]

    def pull(size):
        value = (size, 0.0) if name == "law" else size
        one = given | {name: value}
        found = Cables(cables.span, 1.0, one["radius"], cables.axis, 1e5, one["law"], one["weight"], one["behind"])
        found.rest = cables.rest
        return found.at().pull

    none = pull(0.0)
    large, tenth = pull(small) - none, pull(small / 10) - none
    scale = np.abs(large).max(1)
    assert np.isfinite(large).all()
    assert (scale > 0).any()
    assert (np.abs(large - 10 * tenth).max(1) <= PROPORTIONAL * scale + 1e-11 * np.abs(none).max(1) + 1e-9).all()

"""Robots whose cables have mass: where the compiled solver lets them rest, certified from outside it."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from test_any_cable import ENDS, Cables, misses

import cdpr_sim as cdpr
from cdpr_sim.core.cable import WEIGHT, WRAPPED
from cdpr_sim.core.status import Status
from cdpr_sim.statics.cable_kernel import SAGGING
from cdpr_sim.statics.gufuncs import EQUILIBRIA
from cdpr_sim.statics.profiles import catenary

ROBOTS = range(100, 200)
"""Random ones; ``scripts/stress_test_real_cables.py`` tries 10,000."""

LARGEST_RESIDUAL = 1e-6
"""Unbalanced force [N] that no answer may have."""


class Case:
    """A robot, the question it is asked, and the answer."""

    def __init__(self, robot, position, rest_lengths, weights, wrench):
        self.robot, self.rest, self.weights, self.wrench = robot, rest_lengths, weights, wrench
        free = np.zeros(6)
        free[robot.free] = 1.0
        asked = (robot.weight, robot.center_of_mass, self.wrench, free, robot.characteristic_length)
        with np.errstate(all="ignore"):
            given = (robot.cabling.packed, self.rest, *asked, position, np.eye(3))
            start_position, start_rotation, *_, self.massless_status = EQUILIBRIA[0](*given)
            table = robot.cabling.packed.copy()
            table[:, WEIGHT], table[:, WRAPPED] = self.weights, robot.wrapped_lengths
            found = EQUILIBRIA[SAGGING](table, self.rest, *asked, start_position, start_rotation)
        self.position, self.rotation, self.lengths, self.tensions, self.residual, self.iterations, self.status = found

    def anchors(self, position, rotation):
        return position + self.robot.anchors @ rotation.T

    def pulls(self, position, rotation):
        return catenary(
            self.robot.exits, self.anchors(position, rotation), self.rest, self.robot.axial_stiffness, self.weights
        ).pull

    def unbalanced(self, position, rotation):
        """Forces and torques over characteristic lengths, on the free directions."""
        arms, pulls = self.robot.anchors @ rotation.T, self.pulls(position, rotation)
        weight = np.array([0, 0, -self.robot.weight])
        net = np.r_[
            pulls.sum(0) + weight, np.cross(arms, pulls).sum(0) + np.cross(rotation @ self.robot.center_of_mass, weight)
        ]
        return ((net + self.wrench) / self.robot.units)[self.robot.free]

    def stiffness(self, step=1e-8):
        """By central differences of the unbalanced forces, with steps too short to slacken most cables."""
        columns = []
        for direction in self.robot.free:
            there = []
            for sign in (step, -step):
                x = np.zeros(6)
                x[direction] = sign * self.robot.characteristic_length / self.robot.units[direction]
                moved = self.position + x[:3], Rotation.from_rotvec(x[3:]).as_matrix() @ self.rotation
                there.append(self.unbalanced(*moved))
            columns.append((there[1] - there[0]) / (2 * step * self.robot.characteristic_length))
        matrix = np.array(columns)
        return 0.5 * (matrix + matrix.T)


def ends_off(case: Case) -> float:
    """How far from its anchor a cable ends at most that is pulled as it is said to, per size of the robot."""
    pulls, robot = case.pulls(case.position, case.rotation), case.robot
    some = (case.weights > 0) & (np.hypot(pulls[:, 0], pulls[:, 1]) > 0)
    span = case.anchors(case.position, case.rotation) - robot.exits
    cables = Cables(span[some], 1.0, 0.0, (0, 0, 1), robot.axial_stiffness[some], (0.0, 0.0), case.weights[some])
    cables.rest = case.rest[some]
    return float(misses(cables, pulls[some]).max(initial=0) / np.abs(robot.exits).max())


def random_case(seed: int) -> Case:
    """Two to ten cables, some of them massless, some slack; light and heavy, spatial and planar, loaded or not."""
    random = np.random.default_rng(seed)
    size, cables, planar = 10 ** random.uniform(-0.3, 1.2), random.integers(2, 11), random.random() < 0.15
    exits = random.uniform(-0.5, 0.5, (cables, 3)) * size
    exits[:, 2] = size * random.uniform(0.3, 1, cables)
    if random.random() < 0.3:
        exits[random.integers(1, cables), 2] = -0.2 * size
    anchors = random.uniform(-0.5, 0.5, (cables, 3)) * size * 10 ** random.uniform(-1.3, -0.4)
    mass = 10 ** random.uniform(-1, 2.5)
    load = 9.81 * mass
    stiffness = load * 10 ** random.uniform(1, 4.5) * random.uniform(1, 2, cables)
    center = random.uniform(-0.1, 0.1, 3) * np.abs(anchors).max() * (random.random() < 0.5)
    wrench = np.zeros(6)
    if random.random() < 0.3:
        wrench[:3] = 0.2 * load * random.normal(size=3)
        if cables > 5:
            wrench[3:] = 0.01 * load * np.abs(anchors).max() * random.normal(size=3)
    position = random.uniform(-0.3, 0.3, 3) * size * [1, 1, 0.4] + [0, 0, 0.1 * size]
    if planar:
        exits[:, 1], anchors[:, 1], center[1], position[1] = 0, 0, 0, 0
        wrench[[1, 3, 5]] = 0
    robot = cdpr.Robot(
        exits, anchors, stiffness, mass, center_of_mass=center, mobility="planar" if planar else "spatial"
    )
    slack = random.choice([0, random.uniform(-0.02, 0.02), random.uniform(0, 0.4)], cables)
    weights = load / size * 10 ** random.uniform(-5, 0) * random.uniform(1, 3, cables)
    weights *= random.random(cables) < random.choice([0.6, 1.0])
    return Case(robot, position, robot.rest_lengths(position) * (1 + slack), weights, wrench)


def certify(case: Case) -> None:
    """Forces balance, each is that of a cable which ends at its anchor, and the platform returns when it is moved."""
    assert case.status == Status.CONVERGED
    load = max(case.robot.weight, np.abs(case.wrench / case.robot.units).max())
    stiffest = (case.robot.axial_stiffness / case.rest).max()
    size = np.abs(case.robot.exits).max()
    rounding = 8 * np.finfo(float).eps * (2 * stiffest * size + (case.weights * case.rest).sum())
    net = np.abs(case.unbalanced(case.position, case.rotation)).max()
    assert net == pytest.approx(case.residual, abs=2 * rounding)
    assert net <= min(2e-9 * load, LARGEST_RESIDUAL) + 2 * rounding
    assert ends_off(case) <= ENDS
    # Shorter steps where a massless cable is just taut: across its kink, differences are no slope.
    eigenvalues = (np.linalg.eigvalsh(case.stiffness(step)) for step in (1e-8, 1e-10))
    assert any(values[0] >= -1e-6 * values[-1] for values in eigenvalues)
    found = catenary(
        case.robot.exits, case.anchors(case.position, case.rotation), case.rest, case.robot.axial_stiffness,
        case.weights,
    )  # fmt: skip
    np.testing.assert_allclose(case.tensions, found.anchor_tension, rtol=1e-9, atol=rounding)


def test_random_heavy_robots_come_to_rest() -> None:
    """Every one where springs alone do, too: about a torque that no rest can balance the platform turns for ever."""
    cases = [random_case(seed) for seed in ROBOTS]
    held = [case for case in cases if case.massless_status == Status.CONVERGED]
    assert len(held) >= 0.99 * len(ROBOTS)
    for case in held:
        certify(case)
    assert np.mean([case.iterations for case in held]) < 10

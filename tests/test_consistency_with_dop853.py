"""MuJoCo's platform on moving winches, against SciPy's DOP853: a rigid body on the oracle's massless cables."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import oracle
import pytest
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

import cdpr_sim as cdpr

RATE, SECONDS = 50.0, 0.2
"""[Hz, s] Of the winches' commands, between which they run evenly."""

TO = 1e-10
"""To which the reference is integrated, as a fraction and in SI units."""

FINE = (500.0, 1000.0)
"""[Hz] Of the controller, and so of the steps, which are as long as its periods."""

ORDER = 0.3
"""By how much the order may differ from 2. Measured: 2.01 with taut cables, 2.00 and 2.02 where some go slack."""

NEAR = 1e-3
"""Error of position with the steps that ``track`` takes by itself, as a fraction of the way. Measured: 2e-4 at most."""

LEADING = 0.03
"""Largest error at the first of ``FINE``, as a fraction of the error of a motion that is one step ahead of its winches.
Measured: 0.006 and 0.014."""

WRONG = 0.1
"""Largest error at the last of ``FINE``, as a fraction of that with exits that give way by 1 % more. Measured: 0.04."""

POINTS = cdpr.load_robot("ipanema-1").replace(
    pulley_radius=0.0,
    center_of_mass=(0.03, -0.02, 0.04),
    inertia=[[0.9, 0.1, -0.05], [0.1, 0.7, 0.08], [-0.05, 0.08, 0.5]],
)
"""IPAnema 1 over points, with its centre of mass and its principal axes away from the anchors' middle and axes."""

WHEELS = POINTS.replace(pulley_radius=0.05, winch_to_exit=1.5, reeving=[1, 2] * 4)

SOFT = np.outer([1.0, 0.5, 0.0, 2.0] * 2, [1.0, 0.3, 0.7]) * (1.0 / POINTS.axial_stiffness)[:, None]
"""[m/N] Exits that give way by up to twice as much as a metre of rope; some do not."""


@dataclass
class Winches:
    """A controller that lets out lengths by time alone."""

    lengths: Callable[[float], np.ndarray]

    def start(self, reference) -> np.ndarray:
        return self.lengths(0.0)

    def command(self, time, pose, measurement) -> np.ndarray:
        return self.lengths(time)


def winding(robot: cdpr.Robot, shorter: float, uneven: float) -> Winches:
    """Lengths that are ``shorter`` than rigid ones by a fraction and swing, each cable by its own share of ``uneven``.

    Even between two commands at ``RATE``.
    """
    share = np.sin(np.arange(robot.cables) * 2.3 + 0.3)

    def smooth(time: float) -> np.ndarray:
        swing = 1 - np.cos(10 * time)
        rigid = robot.rest_lengths(robot.home + 0.02 * swing * np.array([1, 0.5, 0.2]))
        return rigid * (1 - shorter) + uneven * share * swing

    def lengths(time: float) -> np.ndarray:
        whole, part = divmod(time * RATE + 1e-9, 1)
        return (1 - part) * smooth(whole / RATE) + part * smooth((whole + 1) / RATE)

    return Winches(lengths)


def acceleration(rig: oracle.Rig, y, rest_lengths, rates, damping, cable_damping):
    """Newton's and Euler's equations about the platform's origin; y: position, quaternion, velocity, body's spin."""
    R, v, spin = Rotation.from_quat(y[3:7]).as_matrix(), y[7:10], y[10:]
    arms = rig.anchors @ R.T
    behind = rig.winch_to_exit / rig.reeving
    slopes = rig.reeving * rig.axial_stiffness / (rest_lengths + behind)

    # Exits that give way do under springs: those robots have cables without damping.
    span = y[:3] + arms - rig.exits
    theta, straight, leaving = oracle.over_wheel(
        rig, span - oracle.exit_moves(rig, oracle.Ropes(rig, rest_lengths), span)
    )
    stretch = rig.pulley_radius * theta + straight - rest_lengths
    growth = (leaving * (v + np.cross(R @ spin, arms))).sum(1) - rates
    pull = slopes * (stretch + cable_damping * growth)
    pulls = -np.maximum(pull, 0)[:, None] * leaving
    m, c, weight = rig.mass, rig.center_of_mass, np.array([0, 0, -rig.mass * rig.gravity])
    at_origin = rig.inertia + m * (c @ c * np.eye(3) - np.outer(c, c))
    cross = np.cross(np.eye(3), c)  # cross @ x = c × x
    matrix = np.block([[m * np.eye(3), -m * R @ cross], [m * cross @ R.T, at_origin]])
    force = pulls.sum(0) + weight - damping * m * v - m * R @ np.cross(spin, np.cross(spin, c))
    torque = R.T @ (np.cross(arms, pulls).sum(0) + np.cross(R @ c, weight))
    torque -= damping * np.diag(at_origin) * spin + np.cross(spin, at_origin @ spin)
    return np.linalg.solve(matrix, np.concatenate([force, torque]))


def reference(robot, winches, start, damping, cable_damping):
    """Positions and rotations at each command, (rows, 3) and (rows, 3, 3)."""
    rig, rigid = oracle.Rig.of(robot), robot.rest_lengths(robot.home)
    damping *= 2 * np.sqrt(rig.gravity / rigid.mean())  # of critical, of a pendulum as long as the cables

    def slope(time, y, rates):
        spin = y[10:]
        turn = Rotation.from_quat(y[3:7]).as_quat()
        turning = 0.5 * np.append(turn[3] * spin + np.cross(turn[:3], spin), -turn[:3] @ spin)
        return np.concatenate(
            [y[7:10], turning, acceleration(rig, y, winches.lengths(time), rates, damping, cable_damping)]
        )

    states = [np.concatenate([start.translation, start.rotation.as_quat(), np.zeros(6)])]
    for tick in range(round(SECONDS * RATE)):  # where the winches' speed changes the integration begins anew
        span = (tick / RATE, (tick + 1) / RATE * (1 - 1e-12))
        rates = (RATE * (winches.lengths(span[1]) - winches.lengths(span[0])),)
        states.append(solve_ivp(slope, span, states[-1], method="DOP853", rtol=TO, atol=TO, args=rates).y[:, -1])
    found = np.array(states)
    return found[:, :3], Rotation.from_quat(found[:, 3:7]).as_matrix()


@pytest.mark.parametrize(
    ("robot", "shorter", "uneven", "damping", "cable_damping"),
    [
        (POINTS, 0.005, 0.0, 0.0, 0.0),
        (POINTS, 0.002, 0.03, 0.05, 2.5e-4),
        (WHEELS, 0.005, 0.0, 0.05, 2.5e-4),
        (POINTS.replace(exit_compliance=SOFT), 0.005, 0.0, 0.0, 0.0),
        (WHEELS.replace(exit_compliance=SOFT), 0.005, 0.0, 0.05, 0.0),
    ],
    ids=["taut, undamped", "slack in turns, damped", "wheels and drive lines", "soft frame", "soft frame, wheels"],
)
def test_motions_are_those_of_a_rigid_body_on_springs_and_of_second_order(
    robot, shorter, uneven, damping, cable_damping
):
    """Half the step, a quarter of the error; the error of a motion that leads its winches by one step is far larger.

    So is that with exits that give way by 1 % more.
    """
    words = {"damping": damping, "cable_damping": cable_damping, "seconds": SECONDS}
    winches = winding(robot, shorter, uneven)
    motions = [cdpr.track(robot, [robot.home], winches, rate=rate, **words) for rate in (RATE, *FINE)]
    positions, rotations = reference(robot, winches, motions[0].poses[0], damping, cable_damping)
    way = np.linalg.norm(positions - positions[0], axis=1).max()
    assert way > 0.02
    assert (motions[-1].tensions == 0).any() == (uneven > 0)
    errors = []
    for motion, rate in zip(motions, (RATE, *FINE), strict=True):
        rows = slice(None, None, round(rate / RATE))
        turns = Rotation.from_matrix(motion.rotations[rows].swapaxes(1, 2) @ rotations)
        off = np.linalg.norm(motion.positions[rows] - positions, axis=1)
        errors.append((off.max(), turns.magnitude().max()))
    assert errors[0][0] < NEAR * way
    np.testing.assert_allclose(np.log2(np.divide(*errors[1:])), 2, atol=ORDER)
    if robot.exit_compliance.any():
        softer = robot.replace(exit_compliance=1.01 * robot.exit_compliance)
        other = cdpr.track(softer, [robot.home], winches, rate=FINE[1], **words)
        off = np.linalg.norm(other.positions[:: round(FINE[1] / RATE)] - positions, axis=1).max()
        assert errors[2][0] < WRONG * off
    leading = motions[1].positions[1 :: round(FINE[0] / RATE)] - positions[:-1]
    assert errors[1][0] < LEADING * np.linalg.norm(leading, axis=1).max()

"""Cables with mass in motion: winches let chains out, and the platform rests where statics says."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform

import cdpr_sim as cdpr
from cdpr_sim.core.controller import Reference
from cdpr_sim.core.pose_path import PosePath
from cdpr_sim.core.problem import Problem
from cdpr_sim.physics.mjcf import settling_air
from cdpr_sim.physics.sagging.chain_motion import ChainMotion
from cdpr_sim.physics.sagging.settle_chains import at_rest

LAW = (100.0, 2e4)
LIGHT = {"linear_density": 5e-4, "pulley_radius": 0.01}
UP = (0.0, 0.0, 1.0)

MIXED = {
    "linear_density": [0.064, 0.0, 0.064, 0.064, 0.0, 0.064, 0.0, 0.03],
    "pulley_radius": [0.1, 0.1, 0.0, 0.05, 0.0, 0.1, 0.1, 0.0],
    "stiffening": [LAW, LAW, LAW, (0, 0), (0, 0), (0, 0), (0, 0), (0, 0)],
}
"""Each of the eight kinds of cable once."""

DRIVE_LINES = {"winch_to_exit": [6.0, 0.0, 3.0, 0.0, 2.0, 0.0, 0.0, 1.0], "reeving": [1, 2] * 4}

RESTS = 1e-9
"""[m] Between a platform that has come to rest after its chains were wound, and statics: 1e-10 m measured."""

AS_WRITTEN = 1e-5
"""[m] Least error on the crane with the weights of the chains before they were wound: 3.3e-5 m measured."""

NEARLY = 1e-4
"""[m] By which a drive of 0.1 m in 7.5 s lags behind its equilibria: 2.7e-5 m measured; in 0.4 s, 1.3e-2 m."""

LAGS = 0.02
"""Fraction by which tensions of that drive differ from those at rest: 0.007 measured."""

HELD = 1e-3
"""Fraction by which winches miss a tension while the platform moves."""

ALIKE = 0.2
"""Fraction of a platform's largest deviation from its equilibria by which two integrators may differ: 0.09 measured, in
proportion to the time step."""

EVERY = {**MIXED, **DRIVE_LINES}
LINE = [(1.0, 1.0, 2.0), (0.5, 0.6, 1.8)]

FROM_BELOW = {**LIGHT, "pulley_axis": UP, "stiffening": LAW}

WOUND = {
    "crane of all kinds": ("cogiro-crane", EVERY, LINE[0], (0.2, 0.3, 1.5), 2.0, 10.0),
    "cogiro": ("cogiro", FROM_BELOW, (0.3, 0.2, 0.15), (0.325, 0.21, 0.16), 1.0, 0.5),
}


@pytest.mark.parametrize("name", WOUND)
def test_after_winding_the_platform_rests_where_statics_says(name):
    """Cables of every kind, by decimetres and metres: springs, laws and weights of all segments follow the lengths.

    Negative control: with the masses of the lengths before, the platform goes elsewhere.
    """
    robot, changes, start, goal, winding, hold = WOUND[name]
    robot = cdpr.load_robot(robot).replace(**changes)
    problem = Problem.of(robot, start)
    lengths = robot.rest_lengths(goal)
    simulation = at_rest(problem, problem.pose)
    masses = simulation.masses.copy()
    motion = ChainMotion(simulation, max(0.002, 0.01 / simulation.swing[0]), viscosity=settling_air(problem)[1])
    change = lengths - problem.rest_lengths
    motion.advance(winding, lambda passed: problem.rest_lengths + min(passed / winding, 1.0) * change)
    motion.advance(hold)
    wanted = cdpr.solve(robot, goal, lengths).position
    assert np.linalg.norm(motion.look().positions[0] - wanted) < RESTS
    if name == "crane of all kinds":
        simulation.masses[:] = masses
        motion.advance(1.0)
        assert np.linalg.norm(motion.look().positions[0] - wanted) > AS_WRITTEN


def test_a_slow_drive_passes_through_the_equilibria_and_a_fast_one_does_not():
    """With every kind of cable and drive line; tensions and lengths too."""
    robot = cdpr.load_robot("cogiro-crane").replace(**EVERY)
    line = [LINE[0], np.average(LINE, axis=0, weights=[0.85, 0.15])]
    slow = cdpr.drive(robot, line, seconds=7.5, states=6)
    static = cdpr.solve_trajectory(slow)
    assert np.linalg.norm(slow.positions - static.positions, axis=1).max() < NEARLY
    np.testing.assert_allclose(slow.positions[0], static.positions[0], rtol=0, atol=RESTS)
    np.testing.assert_allclose(slow.tensions, static.tensions, rtol=LAGS)
    np.testing.assert_allclose(slow.lengths, static.lengths, rtol=0, atol=NEARLY)
    massless = cdpr.solve_many(robot.replace(linear_density=0.0), slow.commanded)
    assert np.linalg.norm(massless.positions - static.positions, axis=1).max() > 2 * NEARLY
    fast = cdpr.drive(robot, line, seconds=0.4, states=6)
    assert np.linalg.norm(fast.positions - static.positions, axis=1).max() > 10 * NEARLY


def test_a_platform_that_is_released_drops_onto_its_sagging_cables():
    """From the commanded pose, which it leaves at once, to its equilibrium."""
    robot = cdpr.load_robot("cogiro-crane").replace(**EVERY)
    motion = cdpr.drive(robot, LINE[:1], seconds=7.0, states=15, from_rest=False)
    equilibrium = cdpr.solve(robot, LINE[0])
    assert np.abs(motion.deviation[0]).max() == 0
    assert np.linalg.norm(motion.deviation[1:], axis=1).max() > np.linalg.norm(equilibrium.deviation)
    np.testing.assert_allclose(motion.positions[-1], equilibrium.position, rtol=0, atol=1e-6)


def test_without_gravity_cables_are_driven_as_massless_ones():
    """They weigh nothing there, for settling as well."""
    robot = cdpr.load_robot("ipanema-1").replace(gravity=0.0)
    line, words = [(0, 0, 1), (0.1, 0, 1)], {"seconds": 1.0, "states": 5}
    plain, motion = (cdpr.drive(one, line, **words) for one in (robot, robot.replace(linear_density=0.01)))
    np.testing.assert_array_equal(motion.positions, plain.positions)
    np.testing.assert_array_equal(motion.tensions, plain.tensions)


def test_a_drive_past_a_wheel_is_refused():
    """Where a cable with mass becomes too short for a chain over its wheel; in one sentence, before it moves."""
    robot = cdpr.load_robot("cogiro").replace(linear_density=5e-4, pulley_radius=0.018, pulley_axis=UP)
    with pytest.raises(cdpr.InvalidInput, match=r"^rest_lengths: found \S+ m in cable \d, with mass and over a pulley"):
        cdpr.drive(robot, [(0.4, 0.25, 0.1), (0.2, 0.15, 0.35)], seconds=1.0)


def test_released_on_sagging_cables_a_platform_stays_at_a_stable_equilibrium_and_leaves_a_saddle():
    """The crane with every kind of cable; and a bar on two nonlinear cables with mass, upright and turned over."""
    crane = cdpr.load_robot("cogiro-crane").replace(**EVERY)
    assert cdpr.release(cdpr.solve(crane, LINE[0]), seconds=0.2).stays
    bar = cdpr.load_robot("two-cable").replace(axial_stiffness=1000.0, linear_density=0.002, stiffening=LAW)
    found = cdpr.find_equilibria(bar, bar.home, saddles=True, starts=30)
    assert found.stable
    assert found.unstable
    for one in found:
        went = cdpr.release(one, seconds=0.1 if one.stable else 5.0)
        assert (went.stays, went.leaves) == (one.stable, not one.stable), went


class Tensions:
    """Winches that start with the rigid lengths and then hold these tensions."""

    def __init__(self, robot: cdpr.Robot, tensions: np.ndarray) -> None:
        self.robot, self.tensions = robot, tensions

    def start(self, reference: cdpr.Reference) -> np.ndarray:
        return self.robot.rest_lengths(reference.pose(0.0))

    def command(self, time: float, pose: object, measurement: cdpr.Measurement) -> cdpr.Command:
        return cdpr.Command(self.start_lengths(pose), self.tensions, np.ones(self.robot.cables, bool))

    def start_lengths(self, pose: object) -> np.ndarray:
        return self.robot.rest_lengths(pose)  # type: ignore[arg-type]


def test_a_tracked_platform_on_sagging_cables_stays_in_equilibrium_and_moves_with_its_winches():
    """With every kind of cable, nonlinear ones too: at rest to rounding, and in motion near its equilibria."""
    robot = cdpr.load_robot("cogiro-crane").replace(**EVERY)
    still = cdpr.track(robot, LINE[:1], cdpr.RigidLengths(robot), seconds=0.1)
    equilibrium = cdpr.solve(robot, LINE[0])
    assert np.linalg.norm(still.positions - equilibrium.position, axis=1).max() < RESTS
    np.testing.assert_allclose(still.tensions[-1], equilibrium.tensions, rtol=1e-7)
    motion = cdpr.track(robot, [LINE[0], (0.985, 0.985, 2.0)], cdpr.RigidLengths(robot), seconds=0.4)
    static = cdpr.solve_trajectory(motion)
    assert np.linalg.norm(motion.positions - static.positions, axis=1).max() < 10 * NEARLY
    assert np.linalg.norm(motion.positions[-1] - equilibrium.position) > 100 * NEARLY


def test_winches_hold_the_tensions_of_sagging_ropes():
    """At the platform's end, from tensions that were others; those of an equilibrium, in which the platform stays."""
    robot = cdpr.load_robot("cogiro-crane").replace(**{**EVERY, "stiffening": [LAW, LAW] + [(0.0, 0.0)] * 6})
    wanted = cdpr.compensate(robot, LINE[0]).tensions
    motion = cdpr.track(robot, LINE[:1], Tensions(robot, wanted), seconds=0.1)
    assert np.abs(motion.tensions[0] - wanted).max() > 1.0
    np.testing.assert_allclose(motion.tensions[-1], wanted, rtol=HELD)


@pytest.mark.parametrize("changes", [{}, {"pulley_radius": 0.01, "winch_to_exit": 0.5, "reeving": 2}])
def test_nonlinear_massless_cables_are_tracked(changes):
    """At rest where solve says, with the tensions that winches hold; with a vanishing law, as linear cables move."""
    linear = cdpr.load_robot("cogiro").replace(material="fishing-0.4mm", **changes)
    robot, line = linear.replace(stiffening=LAW), [(0.3, 0.2, 0.15), (0.35, 0.2, 0.15)]
    still = cdpr.track(robot, line[:1], cdpr.RigidLengths(robot), seconds=0.1)
    equilibrium = cdpr.solve(robot, line[0])
    assert np.linalg.norm(still.positions - equilibrium.position, axis=1).max() < RESTS
    np.testing.assert_allclose(still.tensions[-1], equilibrium.tensions, rtol=1e-7, atol=1e-8)
    some = linear.replace(stiffening=[LAW, LAW] + [(0.0, 0.0)] * 6)
    wanted = cdpr.compensate(some, line[0]).tensions
    held = cdpr.track(some, line[:1], Tensions(some, wanted), seconds=0.1)
    assert np.abs(held.tensions[0] - wanted).max() > 10 * HELD
    np.testing.assert_allclose(held.tensions[-1], wanted, rtol=HELD)
    # Two integrators, and damping of lengths in the one and of strains in the other, which is 0 here.
    limit = linear.replace(stiffening=(1e-9, 0.0))
    motions = [
        cdpr.track(one, line, cdpr.RigidLengths(linear), seconds=0.25, cable_damping=0.0) for one in (linear, limit)
    ]
    apart = np.linalg.norm(motions[0].positions - motions[1].positions, axis=1).max()
    swing = np.linalg.norm(motions[0].positions - cdpr.solve_trajectory(motions[0]).positions, axis=1).max()
    assert apart < ALIKE * swing


def test_a_trace_of_mass_does_not_change_which_cables_are_held_by_tension():
    """The choice is by the stiffness of the others, which sagging cables have as well."""
    chosen, at_pose = [], cdpr.Measurement(0.0, RigidTransform.identity(), np.zeros(8), np.zeros(8))
    for density in (0.0, 1e-6):
        robot = cdpr.load_robot("cogiro").replace(linear_density=density)
        controller = cdpr.LengthsAndTensions(robot)
        controller.start(Reference(PosePath(robot, [robot.pose((0.3, 0.2, 0.15))]), 1.0, 0.0))
        command = controller.command(0.0, robot.pose((0.3, 0.2, 0.15)), at_pose)
        chosen.append(np.flatnonzero(command.by_tension).tolist())
    assert chosen == [[4, 5]] * 2

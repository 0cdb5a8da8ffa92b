"""Release a platform in MuJoCo without damping, to see whether it stays; or increase gravity slowly from zero.

Checks of equilibria by the physics side alone: this module uses no formula of statics.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from numpy.typing import ArrayLike

from cdpr_sim.core.checks import refuse_unless
from cdpr_sim.core.equilibrium import Equilibrium, NotSettled
from cdpr_sim.core.errors import InvalidInput
from cdpr_sim.core.pose import PoseLike, distance
from cdpr_sim.core.problem import Problem, Problems
from cdpr_sim.core.robot import Robot
from cdpr_sim.physics.cable import Law
from cdpr_sim.physics.chains import refuse_short
from cdpr_sim.physics.derivatives import Derivatives
from cdpr_sim.physics.drive import duration
from cdpr_sim.physics.mjcf import TIMESTEP, settling_air
from cdpr_sim.physics.motion import CALM, Motion
from cdpr_sim.physics.quiet import quiet
from cdpr_sim.physics.settle import at_rest, settle, single, weighs, without_weight

NUDGE = 1e-6
"""[m] Displacement of a platform along its direction of least stiffness before the release. Less than most taut cables'
stretch, and more than the 1e-9 m of an equilibrium's rounding."""

STAYS, LEAVES = 3.0, 100.0
"""Largest deviation of a stable platform, in initial displacements; 1.0 is measured
(``scripts/dev/measure_constants.py``). By conservation of energy a stable platform deviates no
further than its displacement along the direction of least stiffness; the deviation of an unstable one grows
exponentially."""

FINEST = 0.5
"""Time step of the undamped motion, in 1/omega of an upper bound of its fastest oscillation."""

WATCHED = 0.002
"""[s] Time between two evaluations of the deviation."""

RAMP = 20.0
"""[s] Time in which gravity grows to its full value: tens of times the period of DemoBot's slowest oscillation."""


GROWING = 0.02
"""Time step while gravity grows, as a fraction of 1/omega of the slowest oscillation, if more than that of the model:
the air damps that oscillation critically, and an implicit step all that are faster."""


@dataclass(frozen=True)
class Release:
    """Motion of a platform that was displaced and released.

    Attributes:
        largest_deviation: largest distance from the equilibrium [m], rotations scaled by the characteristic length.
        displacement: initial displacement [m].
        seconds: duration of the motion.
    """

    largest_deviation: float
    displacement: float
    seconds: float

    @property
    def stays(self) -> bool:
        """Whether it deviated no further than its initial displacement, except for rounding."""
        return self.largest_deviation <= STAYS * self.displacement

    @property
    def leaves(self) -> bool:
        """Whether it deviated a hundred times as far as its initial displacement."""
        return self.largest_deviation >= LEAVES * self.displacement

    def __repr__(self) -> str:
        verdict = "stays" if self.stays else "leaves" if self.leaves else "neither stays nor leaves"
        return (
            f"<Release: {verdict}: deviates by {1e6 * self.largest_deviation:.3g} µm in {self.seconds:.3g} s, "
            f"displaced by {1e6 * self.displacement:.3g} µm>"
        )


def release(equilibrium: Equilibrium, *, seconds: float = 10.0) -> Release:
    """Displace the platform by a micrometre along its direction of least stiffness, and release it undamped.

    The simulation stops as soon as the platform ``leaves``. Cables with mass follow the displacement and are then free;
    time steps are implicit in their springs, which damps a platform that oscillates, while one that leaves still does.

    Args:
        equilibrium: of either method, stable or not.
        seconds: longest duration of the motion.

    Returns:
        The largest deviation [m], and with it whether the platform ``stays`` or ``leaves``.

    Raises:
        InvalidInput: an equilibrium under an external wrench; a cable with mass that is too short for its pulley;
            cables with a memory.
        NotSettled: cables with mass do not come to rest with the platform at the equilibrium.
    """
    refuse_unless(Equilibrium, equilibrium=equilibrium)
    problem = equilibrium.problem
    robot, pose = problem.robot, equilibrium.pose
    robot.cabling.refuse_memory()
    if problem.external_wrench.any():
        raise InvalidInput("equilibrium: found one under an external wrench, expected gravity only")
    seconds, heavy = duration(seconds), weighs(robot)
    if heavy:
        refuse_short(robot, problem.rest_lengths)
    with quiet():
        simulation = at_rest(problem, pose, held=True) if heavy else single(_massless(problem), pose)
        row = simulation.all
        simulation.residuals(row)
        derivatives = Derivatives.of(simulation, row)
        nudge = NUDGE * derivatives.stiffness()[1]
        step = simulation.in_dofs(row, nudge)
        step[:, simulation.slides] = derivatives.following(nudge)
        simulation.qpos[:] = simulation.displaced(simulation.qpos, step)
        springs = Law.of(robot.cabling).steepest(problem.rest_lengths)
        motion = Motion(simulation, min(FINEST / _fastest(springs, equilibrium), WATCHED))
        largest_deviation = NUDGE
        while motion.time < seconds and largest_deviation < LEAVES * NUDGE:
            motion.advance(WATCHED)
            away = distance(motion.pose, pose, robot.characteristic_length)
            largest_deviation = max(largest_deviation, away)
    return Release(largest_deviation, NUDGE, motion.time)


def grow_gravity(
    robot: Robot | Problem,
    pose: PoseLike | None = None,
    rest_lengths: ArrayLike | None = None,
    *,
    seconds: float = RAMP,
) -> Equilibrium:
    """Equilibrium in MuJoCo after gravity has grown slowly from zero, starting at ``pose`` in viscous air.

    Cables with mass are massless while gravity grows; the platform then settles on the cables with their mass.

    Args:
        robot: the robot; or a ``Problem``, without other arguments.
        pose: initial pose of the platform.
        rest_lengths: unstretched cable lengths, (cables,) [m]; default: the rigid ones at ``pose``.
        seconds: time in which gravity grows.

    Returns:
        The equilibrium at which the platform comes to rest in MuJoCo under full gravity.

    Raises:
        InvalidInput: an invalid argument.
        NotSettled: it does not come to rest, or MuJoCo warns of its motion.
    """
    problem = Problem.of(robot, pose, rest_lengths)
    if problem.external_wrench.any():
        raise InvalidInput("external_wrench: found one, expected gravity only, which grows")
    seconds, robot = duration(seconds), problem.robot
    robot.cabling.refuse_memory()
    light = _massless(problem)
    with quiet():
        simulation = single(light, problem.pose)
        longest = max(TIMESTEP, GROWING / simulation.swing[0])
        motion = Motion(simulation, longest, viscosity=settling_air(light)[1], theta=CALM)
        steps = max(int(seconds / longest), 1)
        gravity = motion.model.opt.gravity
        gravity[2] = -robot.gravity / steps
        for step, _ in enumerate(motion.steps(steps * longest), start=2):
            gravity[2] = -robot.gravity * min(step, steps) / steps
    if any(warning.number for warning in motion.data.warning):
        raise NotSettled(f"{robot.name}: the simulation in MuJoCo became unstable while gravity grew")
    return settle(robot, motion.pose, problem.rest_lengths)


def _massless(problem: Problem) -> Problem:
    """The same problem on massless cables."""
    return without_weight(Problems.stack([problem]))[0]


def _fastest(stiffness: Float[np.ndarray, " cables"], equilibrium: Equilibrium) -> float:
    """An upper bound of the highest angular frequency [rad/s]: all springs at the farthest anchor, least inertia.

    Args:
        stiffness: of the cables [N/m]; of nonlinear ones, at the largest strain.
        equilibrium: the equilibrium.
    """
    robot = equilibrium.problem.robot
    reach = np.linalg.norm(robot.anchors - robot.center_of_mass, axis=1).max()
    springs = float(stiffness.sum())
    return float(np.sqrt(springs * (1 / robot.mass + reach**2 / np.linalg.eigvalsh(robot.inertia)[0])))

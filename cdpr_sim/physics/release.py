"""Release a platform in MuJoCo without damping, to see whether it stays; or increase gravity slowly from zero.

Checks of equilibria by the physics side alone: this module uses no formula of statics.
"""

# pyright: reportAttributeAccessIssue=false
# mujoco ships no type stubs for its compiled modules.
from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import mujoco
import numpy as np
from jaxtyping import Float
from numpy.typing import ArrayLike
from scipy.spatial.transform import RigidTransform, Rotation

from cdpr_sim.core.cable import MOST_STRAIN
from cdpr_sim.core.checks import refuse_unless
from cdpr_sim.core.equilibrium import Equilibrium, NotSettled
from cdpr_sim.core.errors import InvalidInput
from cdpr_sim.core.pose import PoseLike, distance, moved
from cdpr_sim.core.problem import Problem, Problems
from cdpr_sim.core.robot import Robot
from cdpr_sim.physics import pulleys, tendons
from cdpr_sim.physics.batch import simulations_of
from cdpr_sim.physics.chains import refuse_short
from cdpr_sim.physics.drive import duration
from cdpr_sim.physics.mjcf import place, to_mjcf
from cdpr_sim.physics.quiet import quiet
from cdpr_sim.physics.sagging import settle_chains
from cdpr_sim.physics.sagging.chain_derivatives import ChainDerivatives
from cdpr_sim.physics.sagging.chain_motion import LEAST_AHEAD, ChainMotion
from cdpr_sim.physics.settle import settle, weighs, without_weight

NUDGE = 1e-6
"""[m] Displacement of a platform along its direction of least stiffness before the release. Less than most taut cables'
stretch, and more than the 1e-9 m of an equilibrium's rounding."""

STAYS, LEAVES = 3.0, 100.0
"""Largest deviation of a stable platform, in initial displacements; 1.0 is measured
(``scripts/dev/measure_constants.py``). By conservation of energy a stable platform deviates no
further than its displacement along the direction of least stiffness; the deviation of an unstable one grows
exponentially."""

FINEST = 0.1
"""Time step of the undamped motion, in 1/omega of an upper bound of its fastest oscillation."""

COARSEST = 0.5
"""The same on cables with mass, whose steps are implicit: the fastest oscillation is damped by an eighth of the
critical damping at most, a slow one hardly."""

WATCHED = 0.002
"""[s] Time between two evaluations of the deviation."""

RAMP = 20.0
"""[s] Time in which gravity grows to its full value: tens of times the period of DemoBot's slowest oscillation."""


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
    seconds, arm = duration(seconds), robot.characteristic_length
    if weighs(robot):
        refuse_short(robot, problem.rest_lengths)
        with quiet():
            return _release_chains(equilibrium, seconds)
    problem = without_weight(Problems.stack([problem]))[0]
    robot = problem.robot
    with simulations_of(Problems.stack([dataclasses.replace(problem, pose=pose)])) as simulations:
        softest = simulations.read(simulations.qpos.copy()).softest[0]
    step = np.zeros(6)
    step[robot.free] = NUDGE * softest
    step[3:] /= arm
    model = mujoco.MjModel.from_xml_string(to_mjcf(robot, pose, problem.rest_lengths))
    model.opt.viscosity = model.dof_damping[:] = 0
    model.opt.integrator = mujoco.mjtIntegrator.mjINT_RK4
    stiffer = 1 + np.abs(robot.cabling.stiffening) @ [2 * MOST_STRAIN, 3 * MOST_STRAIN**2]
    model.opt.timestep = FINEST / _fastest(model.tendon_stiffness * stiffer, equilibrium)
    data = mujoco.MjData(model)
    place(model, data, robot, moved(pose, step))
    largest_deviation, watched = NUDGE, 0
    chunk = max(int(WATCHED / model.opt.timestep), 1)
    while watched * model.opt.timestep < seconds and largest_deviation < LEAVES * NUDGE:
        mujoco.mj_step(model, data, nstep=chunk)
        watched += chunk
        largest_deviation = max(largest_deviation, distance(_pose(data), pose, arm))
    return Release(largest_deviation, NUDGE, watched * model.opt.timestep)


def _release_chains(equilibrium: Equilibrium, seconds: float) -> Release:
    problem, pose = equilibrium.problem, equilibrium.pose
    robot = problem.robot
    simulation = settle_chains.at_rest(problem, pose, held=True)
    row = simulation.all
    simulation.residuals(row)
    derivatives = ChainDerivatives.of(simulation, row)
    nudge = NUDGE * derivatives.stiffness()[1]
    step = simulation.in_dofs(row, nudge)
    step[:, simulation.slides] = derivatives.following(nudge)
    simulation.qpos[:] = simulation.displaced(simulation.qpos, step)
    springs = tendons.springs(robot.cabling, robot.axial_stiffness, problem.rest_lengths)
    longest = min(COARSEST / _fastest(springs, equilibrium), WATCHED)
    motion = ChainMotion(simulation, longest, ahead=LEAST_AHEAD)
    largest_deviation = NUDGE
    for _ in range(int(np.ceil(seconds / WATCHED))):
        if largest_deviation >= LEAVES * NUDGE:
            break
        motion.advance(WATCHED)
        away = distance(motion.look().poses[0], pose, robot.characteristic_length)
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
    massless = robot.replace(linear_density=0.0)
    model = mujoco.MjModel.from_xml_string(to_mjcf(massless, problem.pose, problem.rest_lengths))
    data = mujoco.MjData(model)
    place(model, data, massless, problem.pose)
    mujoco.mj_kinematics(model, data)
    steps = max(int(seconds / model.opt.timestep), 1)
    for step in range(steps):
        model.opt.gravity[2] = -robot.gravity * (step + 1) / steps
        mujoco.mj_step(model, data)
    if any(warning.number for warning in data.warning):
        raise NotSettled(f"{robot.name}: the simulation in MuJoCo became unstable while gravity grew")
    return settle(robot, _pose(data), problem.rest_lengths)


def _pose(data: mujoco.MjData) -> RigidTransform:
    body = data.body("platform")
    return RigidTransform.from_components(body.xpos, Rotation.from_quat(body.xquat, scalar_first=True))


def _fastest(stiffness: Float[np.ndarray, " cables"], equilibrium: Equilibrium) -> float:
    """An upper bound of the highest angular frequency [rad/s]: all springs at the farthest anchor, least inertia.

    Or the oscillation of a wheel about its axis, if that is faster.

    Args:
        stiffness: of the cables [N/m]; of nonlinear ones, at the largest strain.
        equilibrium: the equilibrium.
    """
    robot = equilibrium.problem.robot
    reach = np.linalg.norm(robot.anchors - robot.center_of_mass, axis=1).max()
    springs = float(stiffness.sum())
    fastest = float(np.sqrt(springs * (1 / robot.mass + reach**2 / np.linalg.eigvalsh(robot.inertia)[0])))
    if robot.cabling.pulleys.any():
        fastest = max(fastest, pulleys.swivelling(robot, float(equilibrium.pulls.max())))
    return fastest

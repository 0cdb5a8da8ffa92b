"""Let a platform go in MuJoCo, undamped, and see whether it stays; or let gravity grow slowly, and see where it ends.

The physics side's own word on equilibria: no formula of statics stands here.
"""

# pyright: reportAttributeAccessIssue=false
# mujoco ships no type stubs for its compiled modules.
from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import RigidTransform, Rotation

from cdpr_sim.core.cable import MOST_STRAIN
from cdpr_sim.core.checks import positive, refuse_unless
from cdpr_sim.core.equilibrium import Equilibrium, NotSettled
from cdpr_sim.core.errors import InvalidInput
from cdpr_sim.core.pose import PoseLike, distance, moved
from cdpr_sim.core.problem import Problem, Problems
from cdpr_sim.core.robot import Robot
from cdpr_sim.physics import chains, pulleys
from cdpr_sim.physics.batch import simulations_of
from cdpr_sim.physics.drive import MOST_SECONDS
from cdpr_sim.physics.mjcf import place, to_mjcf
from cdpr_sim.physics.settle import settle

NUDGE = 1e-6
"""[m] How far a platform is displaced along its softest direction before it is let go. Less than most taut cables'
stretch, and more than the 1e-9 m that an equilibrium's rounding leaves open."""

STAYS, LEAVES = 3.0, 100.0
"""In nudges; 1.0 is measured (``scripts/measure_constants.py``). Energy forbids a stable platform to stray further than
it was displaced along its softest direction; one that leaves grows exponentially."""

FINEST = 0.1
"""Time step of the undamped motion, over the 1/omega of an upper bound of its fastest swing."""

RAMP = 20.0
"""[s] in which gravity grows to its full size: tens of times DemoBot's slowest swing."""


@dataclass(frozen=True)
class Release:
    """What became of a platform that was displaced by a nudge and let go.

    Attributes:
        largest_deviation: the farthest it came [m], rotations scaled by the characteristic length.
        nudge: how far it was displaced [m].
        seconds: how long it was watched.
    """

    largest_deviation: float
    nudge: float
    seconds: float

    @property
    def stays(self) -> bool:
        """Whether it strayed no further than it was displaced, but for rounding."""
        return self.largest_deviation <= STAYS * self.nudge

    @property
    def leaves(self) -> bool:
        """Whether it strayed a hundred times as far as it was displaced."""
        return self.largest_deviation >= LEAVES * self.nudge

    def __repr__(self) -> str:
        said = "stays" if self.stays else "leaves" if self.leaves else "neither stays nor leaves"
        return (
            f"<Release: {said}: strayed {1e6 * self.largest_deviation:.3g} µm in {self.seconds:.3g} s, nudged by "
            f"{1e6 * self.nudge:.3g} µm>"
        )


def release(equilibrium: Equilibrium, *, seconds: float = 10.0) -> Release:
    """Displace the platform a micrometre along its softest direction, let it go undamped, and see how far it strays.

    Stops as soon as it has left.

    Args:
        equilibrium: of either method, stable or not.
        seconds: how long it is watched at most.

    Returns:
        How far it strayed [m], and so whether it ``stays`` or ``leaves``.

    Raises:
        InvalidInput: an equilibrium under an external wrench, or on cables that have weight.
    """
    refuse_unless(Equilibrium, equilibrium=equilibrium)
    problem = equilibrium.problem
    robot, pose = problem.robot, equilibrium.pose
    if problem.external_wrench.any():
        raise InvalidInput("equilibrium: found one under an external wrench, expected gravity alone")
    seconds, arm = _duration(seconds), robot.characteristic_length
    chains.refuse_weight(robot, "releasing a platform")
    with simulations_of(Problems.stack([dataclasses.replace(problem, pose=pose)])) as simulations:
        softest = simulations.read(simulations.qpos.copy()).softest[0]
    step = np.zeros(6)
    step[robot.free] = NUDGE * softest
    step[3:] /= arm
    model = mujoco.MjModel.from_xml_string(to_mjcf(robot, pose, problem.rest_lengths))
    model.opt.viscosity = model.dof_damping[:] = 0
    model.opt.integrator = mujoco.mjtIntegrator.mjINT_RK4
    model.opt.timestep = FINEST / _fastest(model, equilibrium)
    data = mujoco.MjData(model)
    place(model, data, robot, moved(pose, step))
    largest_deviation, watched = NUDGE, 0
    chunk = max(int(0.002 / model.opt.timestep), 1)
    while watched * model.opt.timestep < seconds and largest_deviation < LEAVES * NUDGE:
        mujoco.mj_step(model, data, nstep=chunk)
        watched += chunk
        largest_deviation = max(largest_deviation, distance(_pose(data), pose, arm))
    return Release(largest_deviation, NUDGE, watched * model.opt.timestep)


def grow_gravity(
    robot: Robot | Problem,
    pose: PoseLike | None = None,
    rest_lengths: ArrayLike | None = None,
    *,
    seconds: float = RAMP,
) -> Equilibrium:
    """Where MuJoCo's platform rests after gravity has grown slowly from nothing, starting at ``pose`` in viscous air.

    Args:
        robot: the robot; or a ``Problem`` that is ready, alone.
        pose: where the platform starts.
        rest_lengths: unstretched cable lengths, (cables,) [m]; default: the rigid ones at ``pose``.
        seconds: how long gravity grows.

    Returns:
        The equilibrium at which MuJoCo's platform comes to rest under all of gravity.

    Raises:
        InvalidInput: an argument that cannot be right; cables that have weight.
        NotSettled: it does not come to rest, or MuJoCo warns of its motion.
    """
    problem = Problem.of(robot, pose, rest_lengths)
    if problem.external_wrench.any():
        raise InvalidInput("external_wrench: found one, expected gravity alone, which grows")
    seconds, robot = _duration(seconds), problem.robot
    chains.refuse_weight(robot, "growing gravity")
    model = mujoco.MjModel.from_xml_string(to_mjcf(robot, problem.pose, problem.rest_lengths))
    data = mujoco.MjData(model)
    place(model, data, robot, problem.pose)
    mujoco.mj_kinematics(model, data)
    steps = max(int(seconds / model.opt.timestep), 1)
    for step in range(steps):
        model.opt.gravity[2] = -robot.gravity * (step + 1) / steps
        mujoco.mj_step(model, data)
    if any(warning.number for warning in data.warning):
        raise NotSettled(f"{robot.name}: MuJoCo found its motion unstable while gravity grew")
    return settle(robot, _pose(data), problem.rest_lengths)


def _duration(seconds: float) -> float:
    if positive("seconds", seconds, "s") > MOST_SECONDS:
        raise InvalidInput(f"seconds: found {seconds:g}, expected more than 0 and at most {MOST_SECONDS:g}")
    return float(seconds)


def _pose(data: mujoco.MjData) -> RigidTransform:
    body = data.body("platform")
    return RigidTransform.from_components(body.xpos, Rotation.from_quat(body.xquat, scalar_first=True))


def _fastest(model: mujoco.MjModel, equilibrium: Equilibrium) -> float:
    """An upper bound of the fastest swing [rad/s]: every spring at the farthest anchor, against the least inertia.

    Springs that stiffen as they are at the largest strain; or a wheel's swing about its axis, where that is faster.
    """
    robot = equilibrium.problem.robot
    reach = np.linalg.norm(robot.anchors - robot.center_of_mass, axis=1).max()
    stiffer = 1 + np.abs(robot.cabling.stiffening) @ [2 * MOST_STRAIN, 3 * MOST_STRAIN**2]
    springs = float((model.tendon_stiffness * stiffer).sum())
    fastest = float(np.sqrt(springs * (1 / robot.mass + reach**2 / np.linalg.eigvalsh(robot.inertia)[0])))
    if robot.cabling.pulleys.any():
        fastest = max(fastest, pulleys.swivelling(robot, float(equilibrium.tensions.max())))
    return fastest

"""Settling: let the platform come to rest in MuJoCo, and read its equilibrium out of MuJoCo.

The second method for a static equilibrium is independent of the first: it uses no formula of statics.
MuJoCo moves the platform and computes its pose, cable lengths and spring forces; a tension is the force that MuJoCo
applies when all other springs are switched off; the residual is the remaining generalised force at zero velocity; the
stiffness is the change of that force when the platform is displaced. ``dynamic_relaxation`` describes the motion.
"""

# pyright: reportAttributeAccessIssue=false
# mujoco ships no type stubs for its compiled modules.
from __future__ import annotations

import dataclasses
from collections.abc import Callable
from contextlib import nullcontext

import mujoco
import numpy as np
from jaxtyping import Float, Int
from numpy.typing import ArrayLike
from scipy.spatial.transform import RigidTransform

from cdpr_sim.core.checks import FLAG, MOST_THREADS, refuse_unless, whole
from cdpr_sim.core.equilibrium import Equilibrium, NotSettled
from cdpr_sim.core.equilibrium_batch import EquilibriumBatch
from cdpr_sim.core.errors import InvalidInput
from cdpr_sim.core.memory import Memory
from cdpr_sim.core.pose import PoseLike, poses_of
from cdpr_sim.core.problem import Problem, Problems
from cdpr_sim.core.progress import saying
from cdpr_sim.core.robot import Robot, without_mass
from cdpr_sim.core.status import Status
from cdpr_sim.core.trajectory import Trajectory
from cdpr_sim.physics.chains import refuse_short, too_short
from cdpr_sim.physics.dynamic_relaxation import Frames
from cdpr_sim.physics.quiet import quiet
from cdpr_sim.physics.settling import Settling
from cdpr_sim.physics.simulations import Simulations, simulations_of

HEAVY_ROWS, ROWS = 256, 4096
"""Rows that settle side by side, on chains and else: with more, each costs no less, and on chains they need 0.2 MB
each."""


def settle(
    robot: Robot | Problem,
    pose: PoseLike | None = None,
    rest_lengths: ArrayLike | None = None,
    *,
    external_wrench: ArrayLike | None = None,
    model: mujoco.MjModel | None = None,
    progress: bool = False,
) -> Equilibrium:
    """Equilibrium at which the platform comes to rest in MuJoCo, released at ``pose`` with zero velocity.

    A platform that its cables do not hold there falls until they are taut, however far: there is no contact. Where
    cables have mass, the platform is released at the equilibrium with massless cables. Cables with a memory start as
    new ropes; ``settle_path`` follows a path.

    Args:
        robot: the robot; or a ``Problem``, without other arguments.
        pose: initial pose of the platform: (x, y, z) [m], a six-vector [m, rad], or a ``RigidTransform``.
        rest_lengths: unstretched cable lengths, (cables,) [m]; default: the rigid ones at ``pose``.
        external_wrench: force [N] and torque [N m] on the platform's origin, in the base frame, besides gravity.
        model: settle this model of the robot instead of the generated one, with its own springs, masses and gravity.
            Its names must be those of ``to_mjcf``.
        progress: show the progress on standard error, where cables have mass.

    Returns:
        The equilibrium by MuJoCo's own pose, forces and stiffness; its ``source`` is "mujoco".

    Raises:
        InvalidInput: an invalid pose, length or wrench; a cable with mass that is too short for its pulley.
        NotSettled: it never comes to rest, MuJoCo warns of its motion, or a nonlinear cable is strained by more than 20
            %; carries the last state.
    """
    refuse_unless(FLAG, progress=progress)
    problem = Problem.of(robot, pose, rest_lengths, external_wrench)
    if weighs(problem.robot, model):
        refuse_short(problem.robot, problem.rest_lengths)
    return _settled(Problems.stack([problem]), model=model, progress=progress)[0]


def settle_trajectory(
    robot: Robot | Problem,
    pose: PoseLike | None = None,
    rest_lengths: ArrayLike | None = None,
    *,
    external_wrench: ArrayLike | None = None,
    model: mujoco.MjModel | None = None,
) -> tuple[Equilibrium, Trajectory]:
    """``settle``, and the motion to the equilibrium, time step by time step (their lengths vary).

    ``settle`` ends with Newton's method; here, if no cable has mass, the motion is simulated to the equilibrium. Where
    cables have mass, it is a motion in a viscous medium, begins at the equilibrium with massless cables, and its last
    state is the equilibrium that ``settle`` finds.

    Args:
        robot: the robot; all arguments are those of ``settle``.
        pose: initial pose of the platform.
        rest_lengths: (cables,) [m].
        external_wrench: (6,) [N, N m].
        model: settle this model instead.

    Returns:
        The equilibrium, as by ``settle``; and the motion, (steps,) with times [s].

    Raises:
        InvalidInput: an invalid pose, length or wrench.
        NotSettled: as ``settle``.
    """
    problem = Problem.of(robot, pose, rest_lengths, external_wrench)
    if weighs(problem.robot, model):
        refuse_short(problem.robot, problem.rest_lengths)
        one = Problems.stack([problem])
        with simulations_of(settled_without_mass(one), model=model) as simulations:
            seen = [(motion.time, motion.look()) for motion in Settling(simulations).damped()]
        equilibrium = _settled(one, model=model)[0]
        times = [time for time, _ in seen]
        times.append(2 * times[-1] - times[-2])
        read = {name: [getattr(state, name)[0] for _, state in seen] for name in ("poses", "lengths", "tensions")}
        for name, column in read.items():
            column.append(getattr(equilibrium, name.replace("poses", "pose")))
        commands, at = Problems.stack([problem] * len(times)), RigidTransform.concatenate(read["poses"])
        return equilibrium, Trajectory.of(
            commands, np.array(times), at, np.array(read["lengths"]), np.array(read["tensions"])
        )
    frames: Frames = []
    equilibrium = _settled(Problems.stack([problem]), model=model, frames=frames)[0]
    times, qpos = (np.array(column) for column in zip(*frames, strict=True))
    commands = Problems.stack([problem] * len(times))
    with simulations_of(without_weight(commands), model=model) as simulations:
        simulations.qpos[:] = qpos
        simulations.residuals(simulations.all)
        seen = simulations.observe(simulations.all)
    return equilibrium, Trajectory.of(commands, times, seen.poses, seen.lengths, seen.tensions)


def settle_many(
    robot: Robot | Problems,
    poses: RigidTransform | ArrayLike | None = None,
    rest_lengths: ArrayLike | None = None,
    *,
    external_wrench: ArrayLike | None = None,
    rotations: ArrayLike | None = None,
    axial_stiffness: ArrayLike | None = None,
    threads: int = 0,
    progress: bool = False,
) -> EquilibriumBatch:
    """Settle one robot from many poses, side by side on threads; the same motions as ``settle`` one by one.

    Args:
        robot: the robot; or (rows,) ``Problems``, without other arguments.
        poses: initial poses of the platform, (rows, 3) [m], (rows, 6) [m, rad], a stack of transforms, or a list of
            poses of any kind.
        rest_lengths: (cables,) for all or (rows, cables) [m]; default: the rigid ones at each pose.
        external_wrench: (6,) for all or (rows, 6) [N, N m].
        rotations: (rows, 3, 3), if ``poses`` are positions; default: level.
        axial_stiffness: EA [N], a number, or with the cables last: (rows, cables), or (rows, 1) for all cables alike.
        threads: 0 for one per processor.
        progress: show the progress on standard error, where cables have mass.

    Returns:
        A row for each pose. The status marks a row that is not finite, or at which the platform would fall.

    Raises:
        InvalidInput: shapes that do not fit or are ambiguous, or invalid numbers.
    """
    refuse_unless(FLAG, progress=progress)
    problems = Problems.of(
        robot, poses, rest_lengths, external_wrench, rotations=rotations, axial_stiffness=axial_stiffness
    )
    whole("threads", threads, 0, MOST_THREADS)
    if len(problems.shape) != 1:
        raise InvalidInput(f"poses: found problems of shape {problems.shape}, expected rows: (rows,)")
    refusals = refused(problems)
    can = refusals == Status.PENDING
    if can.all():
        return _settled(problems, threads=threads, progress=progress)
    columns = unread(problems.robot, refusals)
    if can.any():
        found = _settled(problems.take(np.flatnonzero(can)), threads=threads, progress=progress)
        for name, column in columns.items():
            column[can] = getattr(found, name)
    return EquilibriumBatch(problems=problems, **columns, source="mujoco")


def unread(robot: Robot, status: Int[np.ndarray, " rows"]) -> dict[str, np.ndarray]:
    """Columns of an ``EquilibriumBatch`` with this status, before anything has been read: nan."""
    sizes = dict(positions=(3,), rotations=(3, 3), lengths=(robot.cables,), tensions=(robot.cables,), residuals=())
    sizes["stiffness"] = (len(robot.free),)
    columns = {name: np.full((len(status), *size), np.nan) for name, size in sizes.items()}
    return columns | {"iterations": np.zeros(len(status), dtype=int), "status": status.copy()}


def residual_of(problem: Problem, pose: PoseLike, *, model: mujoco.MjModel | None = None) -> float:
    """The largest unbalanced force [N] in MuJoCo on the platform held at ``pose``; zero at equilibrium.

    Torques are divided by the robot's characteristic length, as in ``Equilibrium.residual``.

    Raises:
        InvalidInput: an invalid pose.
    """
    at = problem.robot.placed(pose)
    poses = poses_of(at.position[None], at.rotation_matrix[None])
    return float(residuals_of(Problems.stack([problem]), poses, model=model, threads=1)[0])


def residuals_of(
    problems: Problems, poses: RigidTransform, *, model: mujoco.MjModel | None = None, threads: int = 0
) -> Float[np.ndarray, " rows"]:
    """``residual_of`` for (rows,) problems, each at its own pose, (rows,) [N].

    Args:
        problems: the problems.
        poses: a stack, one for each.
        model: the model to use instead of the generated one.
        threads: 0 for one per processor.
    """
    found, possible = np.full(len(problems), np.nan), np.arange(len(problems))
    heavy = weighs(problems.robot, model)
    if heavy:
        short = too_short(problems.robot, np.broadcast_to(problems.rest_lengths, (len(found), problems.robot.cables)))
        possible = possible[~short.any(1)]
    else:
        problems = without_weight(problems)
    problems = released(problems, poses.translation, poses.rotation.as_matrix())
    for rows in _chunks(possible, heavy):
        with simulations_of(problems.take(rows), model=model, threads=threads) as simulations:
            rests = Settling(simulations).settle_held() if heavy else np.ones(len(rows), dtype=bool)
            unbalanced = simulations.unbalanced if heavy else simulations.residuals
            found[rows] = np.where(rests, unbalanced(simulations.all), np.nan)
    return found


def _settled(
    problems: Problems,
    *,
    model: mujoco.MjModel | None = None,
    threads: int = 1,
    frames: Frames | None = None,
    progress: bool = False,
) -> EquilibriumBatch:
    """Settle (rows,) problems that can be solved; ``frames`` collects the motion of the first one."""
    refuse_unless(mujoco.MjModel | None, model=model)
    if model is not None:
        problems.robot.cabling.refuse_memory()
    heavy = weighs(problems.robot, model)
    with saying(progress) if heavy else nullcontext() as say:

        def report(state: str) -> None:
            assert say is not None
            say(f"MuJoCo settles the platform: {state}")

        shown = report if progress and say is not None else None
        starts = settled_without_mass(problems, threads) if heavy else problems
        columns, _ = come_to_rest(starts, model=model, threads=threads, frames=frames, say=shown)
    return EquilibriumBatch(problems=problems, **columns, source="mujoco")


def come_to_rest(
    problems: Problems,
    *,
    model: mujoco.MjModel | None = None,
    memory: tuple[Memory, float] | None = None,
    threads: int = 1,
    frames: Frames | None = None,
    say: Callable[[str], None] | None = None,
) -> tuple[dict[str, np.ndarray], Memory | None]:
    """Settle each of (rows,) problems from its pose.

    Args:
        problems: the problems.
        model: the model to use instead of the generated one.
        memory: of cables with one, (rows,), and the time since then [s]; default: that of new ropes.
        threads: 0 for one per processor.
        frames: collects the motion of the first one on massless cables.
        say: is called from time to time with the progress as text.

    Returns:
        Columns of an ``EquilibriumBatch``; and the memory, without the time, None where no cable has one.

    Raises:
        InvalidInput: a mass per problem, since all rows have one model.
    """
    heavy = weighs(problems.robot, model)
    if not heavy:
        problems = without_weight(problems)
    count, found, memories = len(problems), [], []
    for rows in _chunks(np.arange(count), heavy):

        def report(row: int, progress: str, first: int = int(rows[0])) -> None:
            if say is not None:
                say(f"pose {first + row + 1} of {count}: {progress}" if count > 1 else progress)

        with simulations_of(
            problems if len(rows) == count else problems.take(rows),
            model=model,
            memory=None if memory is None else (memory[0][rows], memory[1]),
            threads=threads,
        ) as simulations:
            shown = frames if rows[0] == 0 else None
            found.append(Settling(simulations, report if say is not None else None, shown).settle())
            after = simulations.remembered()
            memories.append({} if after is None else after.arrays)
    columns, remembered = (
        {name: np.concatenate([part[name] for part in parts]) for name in parts[0]} for parts in (found, memories)
    )
    return columns, Memory(**remembered, time=np.nan) if remembered else None


def _chunks(rows: Int[np.ndarray, " rows"], heavy: bool) -> list[Int[np.ndarray, " some"]]:
    """Rows that settle side by side."""
    most = HEAVY_ROWS if heavy else ROWS
    return [rows[first : first + most] for first in range(0, len(rows), most)]


def at_rest(problem: Problem, start: RigidTransform, *, held: bool = False) -> Simulations:
    """Simulation of one problem on cables with mass, at the equilibrium to which its platform settles from ``start``.

    If it is ``held`` there, whatever pulls it, its chains settle.

    Raises:
        NotSettled: it does not settle, or its chains do not.
    """
    simulations = single(problem, start)
    settling = Settling(simulations)
    if not (settling.settle_held() if held else settling.settle()["status"] == Status.CONVERGED)[0]:
        what = "the cables with mass" if held else "the platform on cables with mass"
        raise NotSettled(f"{problem.robot.name}: {what} did not come to rest in MuJoCo")
    return simulations


def single(problem: Problem, start: RigidTransform) -> Simulations:
    """Simulation of one problem for a motion, released at ``start``."""
    with quiet():
        simulations = Simulations(problem.robot, 1, moves=True)
        place = start.translation[None], start.rotation.as_matrix()[None]
        simulations.start(released(Problems.stack([problem]), *place))
    return simulations


def settled_without_mass(problems: Problems, threads: int = 1) -> Problems:
    """The problems from where platforms on massless cables come to rest; from the commanded pose where they do not."""
    light, _ = come_to_rest(without_weight(problems), threads=threads)
    rested = np.isfinite(light["residuals"])[:, None]
    positions = np.where(rested, light["positions"], problems.positions)
    return released(problems, positions, np.where(rested[..., None], light["rotations"], problems.rotations))


def released(
    problems: Problems, positions: Float[np.ndarray, "rows 3"], rotations: Float[np.ndarray, "rows 3 3"]
) -> Problems:
    """The same problems, with platforms that start from these poses."""
    return dataclasses.replace(problems, positions=positions, rotations=rotations, singles=())


def refused(problems: Problems) -> Int[np.ndarray, " rows"]:
    """Why MuJoCo cannot settle each of (rows,) problems, as a status; ``PENDING`` where it can."""
    refusals = problems.refusals.copy()
    if weighs(problems.robot):
        short = too_short(problems.robot, problems.rest_lengths).any(-1)
        refusals[short & (refusals == Status.PENDING)] = Status.TOO_SHORT
    return refusals


def weighs(robot: Robot, model: mujoco.MjModel | None = None) -> bool:
    """Whether some cables have mass; a given model has chains for exactly the cables with mass of its robot."""
    return not robot.cabling.massless and (robot.gravity > 0 or model is not None)


def without_weight(problems: Problems) -> Problems:
    """The same problems with massless cables."""
    if problems.robot.cabling.massless:
        return problems
    return dataclasses.replace(problems, robot=without_mass(problems.robot), singles=())

"""``settle_model``: static equilibrium of any MuJoCo model, by time steps and by Newton's method."""

# pyright: reportAttributeAccessIssue=false
# mujoco ships no type stubs for its compiled modules.
from __future__ import annotations

import time
from collections.abc import Callable, Iterable
from typing import Any

import mujoco
import numpy as np
from numpy.typing import ArrayLike

from cdpr_sim.anymodel.balance import Balance
from cdpr_sim.anymodel.evidence import equilibrium_at
from cdpr_sim.anymodel.forces import OutOfTime, RestForces, state_of
from cdpr_sim.anymodel.ignored import free_dofs, names_of_ignored, without
from cdpr_sim.anymodel.judged import Judged
from cdpr_sim.anymodel.model_equilibrium import ModelEquilibrium, NoRest
from cdpr_sim.anymodel.motion import STALLS, STEPS, Motion, MotionEnd
from cdpr_sim.anymodel.names import listed
from cdpr_sim.anymodel.newton import newton
from cdpr_sim.anymodel.refusal import refusal
from cdpr_sim.anymodel.support import activations_at_rest, refuse_unsupported
from cdpr_sim.core.checks import FLAG, positive, refuse_unless, whole
from cdpr_sim.core.equilibrium import NotSettled
from cdpr_sim.core.errors import InvalidInput
from cdpr_sim.core.progress import saying
from cdpr_sim.physics.quiet import quiet

RESIDUAL = 1e-8
"""Unbalanced force of an equilibrium, as a fraction of the largest part of the forces: of a start, and aimed at."""

ACCEPTABLE = 1e-7
"""And where Newton's method cannot do better, because the force jumps where contacts come and go."""

OF_LOAD = 1e-7
"""And as a fraction of the largest force of gravity, actuators and applied forces, where there is any."""

MOTION_RESIDUAL = 1e-7
"""Residual at which time steps end; the last part is Newton's."""

NUDGES = 3
"""Number of times that a model is pushed off an unstable equilibrium which the motion ended in."""

NUDGE = 0.02
"""[m, rad] The push."""

IN_VAIN = 6
"""Number of stalls of the motion without a residual of half the size, after which the search ends."""

BESIDE = 1e-6
"""[m, rad] Distance from the result at which time steps begin again, where neither way found it by itself. It is the
tolerance of the position, so that it shows that the model stays there, and no more: loaded friction lets equilibria lie
side by side, and from 1e-5 the motion ends in another."""

MOST_DOFS = 2000
"""Degrees of freedom, at most: the modes of 2000 take some 10 s."""

SHARE_OF_NEWTON = 0.3
"""Share of the time that Newton's method from the start may take."""

SHARE_OF_SEARCH = 0.8
"""Share of the time that the search may take; the rest is for the evidence."""


def settle_model(
    model: Any,
    data: Any = None,
    *,
    ctrl: ArrayLike | None = None,
    ignore: Iterable[str] = (),
    friction: bool = True,
    most_steps: int = STEPS,
    seconds: float = 60.0,
    progress: bool = False,
) -> ModelEquilibrium:
    """Static equilibrium of a MuJoCo model, near the pose from which it starts.

    Two ways lead to it: time steps with kinetic damping, and Newton's method on the forces at rest. The motion's end
    is the result, Newton's method from the start the check. A start at which all forces balance is returned as it is.

    Args:
        model: a ``mujoco.MjModel``.
        data: a ``mujoco.MjData``: where the motion starts, with controls, activations, applied forces, mocap poses and
            active equality constraints; default: the model's initial pose, ``qpos0``. It is not changed.
        ctrl: controls, (nu,); default: those of ``data``.
        ignore: names of bodies that are held where they are, with all bodies that hang on them; they touch nothing.
        friction: whether friction within Coulomb's limits holds; otherwise it gives no force, as MuJoCo's at rest.
        most_steps: largest number of time steps.
        seconds: time after which the search ends [s].
        progress: whether to show progress on standard error.

    Returns:
        The equilibrium, with its forces and the evidence.

    Raises:
        NotSettled: the model has no equilibrium, or none was found: the sentence names the case and the joint; ``case``
            and ``joints`` as data, ``equilibrium`` the best pose found.
        InvalidInput: a wrong argument, or a model with elements whose forces depend on more than pose and controls.
    """
    refuse_unless(mujoco.MjModel, model=model)
    refuse_unless(mujoco.MjData | None, data=data)
    refuse_unless(FLAG, friction=friction, progress=progress)
    seconds, most_steps = positive("seconds", seconds, "s"), whole("most_steps", most_steps, 1)
    refuse_unsupported(model)
    if model.nv > MOST_DOFS:
        raise InvalidInput(
            f"model: found {model.nv} degrees of freedom, expected at most {MOST_DOFS}: the stiffness is a full matrix"
        )
    names = names_of_ignored(model, ignore)
    left = without(model, names)
    forces = RestForces(left, state_of(model, data, ctrl))
    act, growing = activations_at_rest(forces.model, forces.data)
    if growing:
        reason = f"{NoRest.DRIVEN.value}: actuator {listed(growing)} integrates its control, which rests only at 0"
        raise NotSettled(reason, None, NoRest.DRIVEN)
    forces.data.act[:] = act
    balance, dofs = Balance(forces, friction), free_dofs(model, names)
    with saying(progress) as say, quiet():
        return _settled(left, balance, dofs, most_steps, time.monotonic() + seconds, say)


def _settled(
    model: Any, balance: Balance, dofs: np.ndarray, most_steps: int, deadline: float, say: Callable[[str], None]
) -> ModelEquilibrium:
    """The equilibrium by both ways."""
    forces, start = balance.forces, np.array(balance.forces.data.qpos)
    counts = {"time steps": 0, "newton": 0}

    def rests(qpos: np.ndarray, residual: float = ACCEPTABLE) -> bool:
        return Judged.at(balance, qpos, dofs).rests(residual, OF_LOAD)

    def by_newton(qpos: np.ndarray, until: float) -> np.ndarray:
        say("Newton's method")
        end, count = newton(balance, qpos, dofs, tolerance=RESIDUAL, deadline=until)
        counts["newton"] += count
        return end

    def by_motion(motion: Motion, until: float) -> MotionEnd:
        end = motion.run(
            tolerance=MOTION_RESIDUAL,
            steps=most_steps - counts["time steps"],
            deadline=(time.monotonic() + until) / 2,
            report=lambda count: say(f"{count} time steps"),
        )
        counts["time steps"] += end.steps
        return end

    late = deadline  # of the evidence
    deadline -= (1 - SHARE_OF_SEARCH) * (deadline - time.monotonic())
    if rests(start, RESIDUAL):
        try:
            return equilibrium_at(model, Judged.at(balance, start, dofs), dofs, counts, "start", late)
        except NotSettled as error:
            if error.case is not NoRest.SLIDES:  # a start at which friction could hold bodies that jam may have a rest
                raise
    now = time.monotonic()
    alone = by_newton(start, now + SHARE_OF_NEWTON * (deadline - now))
    motion, found, nudges, lowest, in_vain = Motion(balance, start, dofs), None, 0, np.inf, 0
    while True:
        ended = by_motion(motion, deadline)
        polished = by_newton(ended.qpos, deadline)
        if not rests(polished) and rests(ended.qpos):
            polished = ended.qpos
        if not rests(polished):
            in_vain = in_vain + 1 if ended.residual > lowest / 2 else 0
            lowest = min(lowest, ended.residual)
            if ended.reason == STALLS and in_vain < IN_VAIN:
                continue
            break
        found = Judged.at(balance, polished, dofs)
        push = _push(found, deadline) if nudges < NUDGES else None
        if push is None:
            break
        nudges += 1
        motion = Motion(balance, forces.moved(polished, NUDGE * push), dofs)
    if found is None and not rests(alone):
        raise refusal(model, Judged.at(balance, polished, dofs), dofs, counts, ended, start, late)
    if found is None:
        judged = Judged.at(balance, alone, dofs)
        return equilibrium_at(model, judged, dofs, counts, "newton", late, [("start", lambda: ended.qpos)])

    def beside() -> np.ndarray:
        there = forces.moved(found.qpos, BESIDE * found.elastic_direction)
        return by_motion(Motion(balance, there, dofs, sticks=True), late).qpos

    others = [("motion", lambda: ended.qpos), ("beside", beside)]
    if rests(alone):
        others.insert(0, ("start", lambda: alone))
    return equilibrium_at(model, found, dofs, counts, "motion", late, others)


def _push(judged: Judged, deadline: float) -> np.ndarray | None:
    """The largest of a push along unstable directions is 1; None if there are none, or no time to find them."""
    try:
        with judged.balance.forces.until(deadline):
            unstable = judged.unstable_directions
    except OutOfTime:
        return None
    push = np.sum(unstable, axis=0)
    return push / np.abs(push).max() if unstable else None

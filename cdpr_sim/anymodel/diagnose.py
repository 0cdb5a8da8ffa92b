"""``diagnose_model``: what in a MuJoCo model makes tendons push, limits carry load, time steps diverge, bodies fall."""

# pyright: reportAttributeAccessIssue=false
# mujoco ships no type stubs for its compiled modules.
from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Any

import mujoco
from numpy.typing import ArrayLike

from cdpr_sim.anymodel.at_rest import at_rest
from cdpr_sim.anymodel.findings import FindingKind, ModelFinding
from cdpr_sim.anymodel.forces import state_of
from cdpr_sim.anymodel.ignored import names_of_ignored
from cdpr_sim.anymodel.model_equilibrium import ModelEquilibrium, NoRest
from cdpr_sim.anymodel.names import listed
from cdpr_sim.anymodel.pushing import pushing
from cdpr_sim.anymodel.settle_model import settle_model
from cdpr_sim.anymodel.time_steps import CALM, GROWN, INTEGRATORS, LIMIT_OF, StableSteps, growth, stable_steps
from cdpr_sim.core.checks import FLAG, positive, refuse_unless
from cdpr_sim.core.equilibrium import NotSettled
from cdpr_sim.core.errors import InvalidInput
from cdpr_sim.physics.quiet import quiet

SHORTER = 8
"""Number of shorter time steps, each half the one before, that are rehearsed."""

MARGIN = 0.8
"""Of the limit: the longest time step that is proposed."""

REMEDIES = {
    NoRest.FALLS: "support it by a contact, a joint or a tendon, set gravcomp=\"1\" on its bodies, or leave it out",
    NoRest.MECHANISM: "give this direction a stiffness, a limit or an actuator",
    NoRest.TURNS: "limit the joint, or set its actuator's control to 0",
    NoRest.DRIVEN: "set the control to 0, or limit the activation by actrange",
    NoRest.BELT: "set the surface's velocity to 0, or leave the body out",
    NoRest.JUMPS: "give the tendon's geom a sidesite, or use geoms without edges",
    NoRest.SLIDES: "raise the friction, or support it",
    NoRest.LIMIT_CYCLE: "damp the joints",
}  # fmt: skip
"""What to change in a model that does not come to rest."""


@dataclass(frozen=True, eq=False)
class ModelDiagnosis:
    """What is wrong with a model; a sequence of its findings.

    Attributes:
        findings: what is wrong, in the order of ``FindingKind``.
        equilibrium: the equilibrium at which limits, masses and time steps were judged; None if there is none.
        fastest_period: of the fastest mode [s], without contacts and limits; infinite if nothing oscillates, not a
            number if it was not computed.
        stable_time_steps: longest stable time step by integrator [s], "Euler", "implicitfast" (and "implicit") and
            "RK4"; empty if it was not computed.
        notes: what could not be judged, a sentence each.
    """

    findings: tuple[ModelFinding, ...]
    equilibrium: ModelEquilibrium | None
    fastest_period: float
    stable_time_steps: dict[str, float]
    notes: tuple[str, ...]

    def __len__(self) -> int:
        return len(self.findings)

    def __iter__(self) -> Iterator[ModelFinding]:
        return iter(self.findings)

    def __getitem__(self, number: int) -> ModelFinding:
        return self.findings[number]

    def __repr__(self) -> str:
        return f"<ModelDiagnosis: {len(self)} findings: {' '.join(map(str, self.findings)) or 'none'}>"


def diagnose_model(
    model: Any,
    data: Any = None,
    *,
    ctrl: ArrayLike | None = None,
    ignore: Iterable[str] = (),
    seconds: float = 30.0,
    progress: bool = False,
) -> ModelDiagnosis:
    """What in a MuJoCo model makes tendons push, limits carry load, steps diverge or bodies fall; and the remedies.

    Limits, masses and the time step are judged at the equilibrium that ``settle_model`` finds; without one, the time
    step where the motion starts. The time step is called too long only where ``mj_step`` with it makes a small
    displacement grow a thousandfold in 200 steps, and with the proposed one does not.

    Args:
        model: a ``mujoco.MjModel``.
        data: a ``mujoco.MjData``: where the search for the equilibrium starts, as in ``settle_model``; it is not
            changed.
        ctrl: controls, (nu,); default: those of ``data``.
        ignore: names of bodies that are left out of the equilibrium, as in ``settle_model``.
        seconds: time after which the search for the equilibrium ends [s].
        progress: whether to show progress on standard error.

    Returns:
        The findings, and the longest stable time steps.

    Raises:
        InvalidInput: a wrong argument.
    """
    refuse_unless(mujoco.MjModel, model=model)
    refuse_unless(mujoco.MjData | None, data=data)
    refuse_unless(FLAG, progress=progress)
    seconds, ignore = positive("seconds", seconds, "s"), names_of_ignored(model, ignore)
    start = state_of(model, data, ctrl)
    findings, notes, equilibrium = list(pushing(model)), [], None
    try:
        equilibrium = settle_model(model, start, ignore=ignore, seconds=seconds, progress=progress)
    except NotSettled as error:
        findings += _without_rest(model, error)
        notes.append(f"limits and masses were not judged: no equilibrium was found: {error}")
    except InvalidInput as error:
        notes.append(f"limits and masses were not judged: {error}")
    if equilibrium is not None:
        equilibrium.write(start)
        findings += at_rest(model, start)
    steps = stable_steps(model, start)
    if steps is None:
        notes.append(f"the time step was not judged: the model has {model.nv} degrees of freedom")
    else:
        with quiet():
            findings += _time_step(model, start, steps)
    order = list(FindingKind)
    return ModelDiagnosis(
        tuple(sorted(findings, key=lambda one: order.index(one.kind))), equilibrium,
        math.nan if steps is None else steps.fastest_period, {} if steps is None else steps.longest, tuple(notes),
    )  # fmt: skip


def _without_rest(model: Any, error: NotSettled) -> Iterator[ModelFinding]:
    """The finding that a model does not come to rest, if it is known why."""
    remedy = REMEDIES.get(error.case) if isinstance(error.case, NoRest) else None
    if remedy is None:
        return
    falls = error.case is NoRest.FALLS
    element = f"joint {listed(error.joints)!r}" if error.joints else "model"
    problem = "gravity has no support here, and it falls for ever" if falls else str(error)
    yield ModelFinding(FindingKind.UNSUPPORTED if falls else FindingKind.NO_REST, element, problem, remedy)


def _time_step(model: Any, state: Any, steps: StableSteps) -> Iterator[ModelFinding]:
    """The finding that the time step is too long, if motion with it grows and motion with a shorter one does not."""
    given, name = float(model.opt.timestep), INTEGRATORS[int(model.opt.integrator)]
    limit = steps.longest.get(LIMIT_OF.get(name, ""), math.inf)
    if limit >= given or growth(model, state, given, steps.direction) <= GROWN:
        return
    proposed = _round_down(MARGIN * limit)
    for _ in range(SHORTER):
        if growth(model, state, proposed, steps.direction) <= CALM:
            break
        proposed = _round_down(proposed / 2)
    else:
        return  # it grows at every time step: the equilibrium itself is unstable
    yield ModelFinding(
        FindingKind.TIME_STEP, f"joint {listed(steps.joints)!r}",
        f"the time step, {given:.6g} s, is too long for its motion: the fastest mode has a period of "
        f"{steps.fastest_period:.3g} s, and {name} is stable up to {limit:.3g} s",
        f'timestep="{proposed:.6g}"{_other(steps, name, given)}',
    )  # fmt: skip


def _other(steps: StableSteps, name: str, given: float) -> str:
    """The integrator that is stable with the given time step, if there is one."""
    better = next((one for one, step in steps.longest.items() if MARGIN * step >= given and one != name), None)
    return f', or integrator="{better}"' if better else ""


def _round_down(step: float) -> float:
    """To one of 1, 2, 5 times a power of ten."""
    power = 10.0 ** math.floor(math.log10(step))
    return max(digit for digit in (1.0, 2.0, 5.0) if digit * power <= step * (1 + 1e-12)) * power

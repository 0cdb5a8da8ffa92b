"""Objectives: a number for each layout, from its equilibria in all cases."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from jaxtyping import Float

from cdpr_sim.core.checks import as_numbers, one_of, shown
from cdpr_sim.core.errors import InvalidInput
from cdpr_sim.design.layout_equilibria import LayoutEquilibria, feasible_cases
from cdpr_sim.statics import derivatives, forces

Limits = tuple[np.ndarray, np.ndarray]
Scores = Float[np.ndarray, " layouts"]
Each = Callable[[LayoutEquilibria, Limits], Float[np.ndarray, "layouts cases"]]

NO_LIMITS: Limits = (np.array(0.0), np.array(np.inf))

SHARE, LEAST = 1e-4, 1e-6
"""Smallest improvement: relative, what four printed digits show; and in the objective's unit, below which a number is
rounding."""


@dataclass(frozen=True)
class Objective:
    """A number to be minimised or maximised.

    Attributes:
        name: of the objective.
        unit: for display.
        size: SI value of that unit.
        score: (layouts,) in SI units, a function of the equilibria and the tension limits.
        largest: whether the number is maximised.
        each: the quantity of every case, (layouts, cases) in SI units; None where a layout has one number only.
        quantity: its name.
        smooth: quantity with a gradient: "tilt", "deviation" or "tensions"; "" without one.
        equilibria: whether it needs an equilibrium in every case.
    """

    name: str
    unit: str
    size: float
    score: Callable[[LayoutEquilibria, Limits], Scores]
    largest: bool = False
    each: Each | None = None
    quantity: str = ""
    smooth: str = ""
    equilibria: bool = True

    @classmethod
    def of(cls, given: Any) -> Objective:
        """Objective by name; or a function ``LayoutEquilibria`` → (layouts,), to be minimised.

        Raises:
            UnknownName: no such objective.
            InvalidInput: neither a name nor a function.
        """
        if isinstance(given, Objective):
            return given
        if isinstance(given, str):
            return OBJECTIVES[one_of("objective", given, OBJECTIVES, renamed)]
        if not callable(given):
            raise InvalidInput(f"objective: found {shown(given)}, expected a name or a function of the equilibria")
        name = getattr(given, "__name__", "your function")
        return cls(name, "", 1.0, partial(_by_users, given, name))

    def __reduce__(self) -> str | tuple[Any, ...]:
        """Copy objectives of the table by name, since most of their functions cannot be pickled."""
        return (Objective.of, (self.name,)) if OBJECTIVES.get(self.name) is self else super().__reduce__()

    def shown(self, value: float, digits: int = 4) -> str:
        """The value with its unit; nan means that there is no equilibrium at some pose."""
        if np.isnan(value):
            return "no equilibrium at some pose"
        value = 0.0 if abs(value) < LEAST * self.size else value
        return f"{value / self.size:.{digits}g}{'' if self.unit in ('°', '') else ' '}{self.unit}"

    def better(self, a: float, b: float) -> bool:
        """Whether ``a`` is better than ``b`` by more than rounding; any number is better than nan, no equilibrium."""
        if not np.isfinite([a, b]).all():
            return bool((np.isnan(b) and not np.isnan(a)) or (a > b if self.largest else a < b))
        return bool((a - b if self.largest else b - a) > max(SHARE * abs(b), LEAST * self.size))


def _by_users(
    function: Callable[[LayoutEquilibria], Any], name: str, equilibria: LayoutEquilibria, _: Limits
) -> Scores:
    scores, layouts = function(equilibria), len(equilibria)
    try:
        found = as_numbers("objective", scores)
    except InvalidInput:
        raise InvalidInput(f"objective: {name} returned {shown(scores)}, expected numbers") from None
    if found.shape != (layouts,):
        raise InvalidInput(
            f"objective: {name} returned shape {found.shape}, expected ({layouts},), one for each layout"
        )
    return found


def _distance(equilibria: LayoutEquilibria) -> np.ndarray:
    return np.linalg.norm(equilibria.deviation, axis=-1)


def _slack(equilibria: LayoutEquilibria) -> np.ndarray:
    return equilibria.slack.sum(-1).astype(float)


def _error(equilibria: LayoutEquilibria) -> np.ndarray:
    """Root mean square displacement of the platform per independent error of each coordinate of exits and anchors.

    Rotations are weighted by the characteristic length.
    """
    count, found = 3 * equilibria.robot.cables, np.empty(equilibria.shape)
    axes = (0, 2) if equilibria.robot.mobility == "planar" else (0, 1, 2)
    each = np.eye(count)[:, np.isin(np.arange(count) % 3, axes)]
    none = np.zeros_like(each)
    errors = {"exits": np.hstack([each, none]), "anchors": np.hstack([none, each])}
    for row in range(len(equilibria)):
        robot, held = equilibria.layouts.robot_at(row), equilibria.held[row]
        problems = equilibria.cases.problems(robot, equilibria.problems.rest_lengths[row]).take(held)
        state = forces.at(problems, equilibria.positions[row][held], equilibria.rotations[row][held])
        pose, _ = derivatives.of_equilibria(state, *derivatives.along_changes(state, errors))
        found[row, held] = np.sqrt(((pose * robot.units[:, None]) ** 2).sum((-1, -2)))
    return np.where(equilibria.held, found, np.inf)


def _of_cases(
    name: str,
    unit: str,
    size: float,
    reduce: Callable[..., np.ndarray],
    quantity: str,
    of: Callable[[LayoutEquilibria], np.ndarray],
    **more: Any,
) -> Objective:
    """The worst, the mean or the least of a quantity over all cases."""
    score = lambda equilibria, _: reduce(of(equilibria), axis=-1)  # noqa: E731
    return Objective(name, unit, size, score, each=lambda equilibria, _: of(equilibria), quantity=quantity, **more)


def _feasible(equilibria: LayoutEquilibria, limits: Limits) -> np.ndarray:
    return feasible_cases(equilibria.layouts, equilibria.cases, limits).astype(float)


_ALL = (
    _of_cases("worst tilt", "°", np.pi / 180, np.max, "tilt", lambda r: r.tilt, smooth="tilt"),
    _of_cases("mean tilt", "°", np.pi / 180, np.mean, "tilt", lambda r: r.tilt),
    _of_cases("worst deviation", "mm", 1e-3, np.max, "deviation", _distance, smooth="deviation"),
    _of_cases("mean deviation", "mm", 1e-3, np.mean, "deviation", _distance),
    _of_cases("most slack cables", "", 1.0, np.max, "slack cables", _slack),
    _of_cases("mean slack cables", "", 1.0, np.mean, "slack cables", _slack),
    _of_cases(
        "lowest tension", "N", 1.0, np.min, "lowest tension", lambda r: r.tensions.min(-1), largest=True,
        smooth="tensions",
    ),
    _of_cases("highest tension", "N", 1.0, np.max, "highest tension", lambda r: r.tensions.max(-1), smooth="tensions"),
    _of_cases(
        "softest stiffness", "N/m", 1.0, np.min, "lowest stiffness", lambda r: r.eigenvalues[..., 0], largest=True
    ),
    _of_cases("lowest frequency", "Hz", 1.0, np.min, "lowest frequency", lambda r: r.frequencies, largest=True),
    Objective(
        "feasible volume", "%", 0.01, lambda equilibria, limits: _feasible(equilibria, limits).mean(-1), largest=True,
        each=_feasible, quantity="feasibility", equilibria=False,
    ),
    _of_cases("worst sensitivity", "mm/mm", 1.0, np.max, "sensitivity", _error),
    Objective("points moved", "mm", 1e-3, lambda equilibria, _: equilibria.layouts.displacements),
    Objective("size of frame", "m", 1.0, lambda r, _: np.linalg.norm(np.ptp(r.layouts.exits, axis=1), axis=-1)),
)  # fmt: skip
OBJECTIVES = {one.name: one for one in _ALL}
"""Objectives by name. "feasible volume" is the share of the poses that rigid cables hold within the tension limits;
"worst sensitivity" the root mean square displacement of the platform per error of all coordinates of exits and anchors;
"points moved" how far the point of the layout moved that moved most; "size of frame" the diagonal of the box around the
exits."""

_RENAMED = {"displacement": "points moved"}


def renamed(name: str) -> list[str]:
    """The present name of an objective that had another one."""
    return [_RENAMED[name]] if name in _RENAMED else []

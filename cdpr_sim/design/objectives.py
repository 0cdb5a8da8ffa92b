"""Objectives: a number for each layout, from its equilibria in all cases."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from jaxtyping import Float

from cdpr_sim.core.checks import as_numbers, shown
from cdpr_sim.core.errors import InvalidInput, UnknownName
from cdpr_sim.design.layout_derivatives import layout_derivatives
from cdpr_sim.design.layout_equilibria import LayoutEquilibria, feasible_share

Limits = tuple[np.ndarray, np.ndarray]
Scores = Float[np.ndarray, " layouts"]


@dataclass(frozen=True)
class Objective:
    """A number to be minimised or maximised.

    Attributes:
        name: of the objective.
        unit: for display.
        size: SI value of that unit.
        largest: whether the number is maximised.
        score: (layouts,) in SI units, a function of the equilibria and the tension limits.
        smooth: quantity with a gradient: "tilt", "deviation" or "tensions"; "" without one.
        equilibria: whether it needs an equilibrium in every case.
    """

    name: str
    unit: str
    size: float
    score: Callable[[LayoutEquilibria, Limits], Scores]
    largest: bool = False
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
            if given not in OBJECTIVES:
                raise UnknownName("objective", given, OBJECTIVES)
            return OBJECTIVES[given]
        if not callable(given):
            raise InvalidInput(f"objective: found {shown(given)}, expected a name or a function of the equilibria")
        name = getattr(given, "__name__", "your function")
        return cls(name, "", 1.0, partial(_by_users, given, name))

    def __reduce__(self) -> str | tuple[Any, ...]:
        """Copy objectives of the table by name, since most of their functions cannot be pickled."""
        return (Objective.of, (self.name,)) if OBJECTIVES.get(self.name) is self else super().__reduce__()

    def shown(self, value: float) -> str:
        """The value with its unit; nan means that there is no equilibrium at some pose."""
        if np.isnan(value):
            return "no equilibrium at some pose"
        return f"{value / self.size:.4g}{'' if self.unit in ('°', '') else ' '}{self.unit}"

    def better(self, a: float, b: float) -> bool:
        """Whether ``a`` is better than ``b``."""
        return a > b if self.largest else a < b


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
        pose, _ = layout_derivatives(equilibria, row, errors, known=False)
        units = equilibria.layouts.robot_at(row).units
        found[row] = np.sqrt(((pose * units[:, None]) ** 2).sum((-1, -2)))
    return np.where(np.isnan(found), np.inf, found)


def _over_cases(
    reduce: Callable[..., np.ndarray], of: Callable[[LayoutEquilibria], np.ndarray]
) -> Callable[[LayoutEquilibria, Limits], Scores]:
    return lambda equilibria, _: reduce(of(equilibria), axis=-1)


_worst, _mean, _least = (partial(_over_cases, reduce) for reduce in (np.max, np.mean, np.min))


_ALL = (
    Objective("worst tilt", "°", np.pi / 180, _worst(lambda r: r.tilt), smooth="tilt"),
    Objective("mean tilt", "°", np.pi / 180, _mean(lambda r: r.tilt)),
    Objective("worst deviation", "mm", 1e-3, _worst(_distance), smooth="deviation"),
    Objective("mean deviation", "mm", 1e-3, _mean(_distance)),
    Objective("most slack cables", "", 1.0, _worst(lambda equilibria: equilibria.slack.sum(-1).astype(float))),
    Objective("mean slack cables", "", 1.0, _mean(lambda equilibria: equilibria.slack.sum(-1).astype(float))),
    Objective("lowest tension", "N", 1.0, _least(lambda r: r.tensions.min(-1)), largest=True, smooth="tensions"),
    Objective("highest tension", "N", 1.0, _worst(lambda r: r.tensions.max(-1)), smooth="tensions"),
    Objective("softest stiffness", "N/m", 1.0, _least(lambda r: r.eigenvalues[..., 0]), largest=True),
    Objective("lowest frequency", "Hz", 1.0, _least(lambda r: r.frequencies), largest=True),
    Objective(
        "feasible volume", "%", 0.01,
        lambda equilibria, limits: feasible_share(equilibria.layouts, equilibria.cases, limits),
        largest=True, equilibria=False,
    ),
    Objective("worst sensitivity", "mm/mm", 1.0, _worst(_error)),
    Objective("displacement", "mm", 1e-3, lambda equilibria, _: equilibria.layouts.displacements),
    Objective("size of frame", "m", 1.0, lambda r, _: np.linalg.norm(np.ptp(r.layouts.exits, axis=1), axis=-1)),
)  # fmt: skip
OBJECTIVES = {one.name: one for one in _ALL}
"""Objectives by name. "feasible volume" is the share of the poses that rigid cables hold within the tension limits;
"worst sensitivity" the root mean square displacement of the platform per error of all coordinates of exits and anchors;
"displacement" that of the point that moved most; "size of frame" the diagonal of the box around the exits."""

NO_LIMITS: Limits = (np.array(0.0), np.array(np.inf))
